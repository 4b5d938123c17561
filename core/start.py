"""Where a motion starts: one record for all that integrates, and who has one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from .arguments import as_mapping, few, shown
from .errors import InputError
from .event import Impact
from .exact_numbers import Number
from .frozen_dict import FrozenDict
from .html import card, table
from .inertia import InertiaLike
from .records import FixedAttributes, dataclass
from .registry import function_of

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

    from .event import Event, Impact

__all__ = ["GAMMA_M", "HasStart", "Rule", "Start", "as_start", "has_start",
           "without_events"]


@dataclass(frozen=True)
class Rule:
    """A parameter of a model without a number: γ or α of a body, or the rate of a frame.

    Attributes
    ----------
    name : str
        A mean of the moments or a search, of ``registry.RULES``; "start": the rate of the start's
        least squares.
    inertia : sequence of numbers, optional
        The body's inertia, where it is not among the parameters.
    """

    name: str
    inertia: Any = None


#: The default of γ, (I₁ + I₂ + I₃)/3: the paper recommends it (48) beside γ_h (47), whose errors
#: are large where the moments differ much (Table 6).
GAMMA_M = Rule("m")


class HasStart(Protocol):
    """A start, or an object with a start: a model, a problem, a simulation."""

    @property
    def start(self) -> Start:
        """Where it starts."""


def _copy(name: str, value: Any) -> Any:
    """Return a copy of numbers, of whatever array type they are.

    Raises InputError for an iterator, which can be read once, and for a value that has no copies.
    """
    if isinstance(value, Iterator):
        raise InputError(f"{name} = {shown(value)} has numbers that can be read once only; give "
                         "them in a list or an array.")
    try:
        return copy(value)
    except TypeError as error:
        raise InputError(f"{name} = {shown(value)} is no array of numbers.") from error


class Start(FixedAttributes):
    """A state with its parameters, its time and inputs: where an integration starts.

    ``Model.start``, ``Simulation.start``, the problems' ``start`` and a row of a trajectory,
    ``run[-1]``, are starts. γ and α that are left out are found by rule, γ_m unless the model
    says another, from the inertia that the run has in the end. The numbers of a model or a problem
    are typed, or meet the constraints for other parameters: a run moves them onto its constraints,
    with a warning where this is more than round-off.

    Parameters
    ----------
    q, p : array_like, shape (n,), or (k, n) for an ensemble
        Coordinates and momenta, on the constraints.
    parameters : mapping of str to number, optional
        Values by name; those that a run is given win over them.
    t : number, or array_like of shape (k,) for an ensemble
        Time in seconds.
    inputs : mapping of str to number, optional
        One value of each input, held as long as the run is given no others.

    Raises
    ------
    InputError
        For parameters or inputs that are no dict.

    Examples
    --------
    >>> import gyrospark as gs
    >>> top = gs.problems.fast_top()
    >>> gs.Start(top.q0, top.p0, top.parameters)
    <Start: 4 coordinates, t = 0 s, I1, I2, I3, mgl>
    """

    _CURE = "start.replace(q=...), of q, p, parameters, t and inputs, returns another start"

    q: Any
    p: Any
    t: Any
    parameters: Mapping[str, Number]
    inputs: Mapping[str, Number]

    def __init__(
        self, q: ArrayLike, p: ArrayLike, parameters: Mapping[str, Number] | None = None,
        t: Number | ArrayLike = 0.0, inputs: Mapping[str, Number] | None = None,
    ) -> None:
        """Copy the numbers, which are checked by the steps that take them."""
        # arrays that the caller changes later do not change the start
        self.q, self.p, self.t = (_copy(*pair) for pair in (("q", q), ("p", p), ("t", t)))
        self.parameters = FrozenDict(
            as_mapping("parameters", {} if parameters is None else parameters, "{'m': 1.0}"))
        self.inputs = FrozenDict(
            as_mapping("inputs", {} if inputs is None else inputs, "{'u': 0.3}"))
        #: Inertia of the bodies by the names of γ or α, and the rules of these and of the frame.
        self._inertias: Mapping[str, Any] = {}
        self._rules: Mapping[str, str] = {}
        #: Time step and number of steps of the model's runs, None where it names none.
        self._span: tuple[Any, Any] = None, None
        #: Events and impacts of the model's runs.
        self._events: tuple[Event | Impact, ...] = ()
        #: Whether it is a model's, whose numbers steps move onto the constraints of their run.
        self._nominal = False
        #: Parameters that some steppers of the system do not have.
        self._spare: frozenset[str] = frozenset()
        #: H + e in scaled time, with the momentum e of t: 0 at the start of a run, where e = −H,
        #: and changed by the steps. A row has it, so that a run from (q, −p) leads back to the
        #: start of the run.
        self._excess: Any = 0.0

    def __repr__(self) -> str:
        names = few([*self.parameters, *self.inputs])
        return f"<Start: {np.shape(self.q)[-1]} coordinates, t = {self._times} s, {names}>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the numbers."""
        rows = [(name, few(f"{float(x):.6g}" for x in values))
                for name, values in (("q", np.ravel(self.q)), ("p", np.ravel(self.p)))]
        numbers = {**self.parameters, **self.inputs}
        rows += [("t", f"{self._times} s"),
                 ("parameters", few(f"{name} = {float(x):.6g}" for name, x in numbers.items()))]
        return card("Start", table(rows))

    @property
    def _times(self) -> str:
        """The time, or the first few of several, as text."""
        return few(f"{float(x):.6g}" for x in np.ravel(np.array(self.t, dtype=object)))

    @property
    def start(self) -> Start:
        """Itself."""
        return self

    @classmethod
    def of_body(
        cls, attitude: ArrayLike | Rotation, omega: ArrayLike, inertia: InertiaLike,
        parameters: Mapping[str, Number] | None = None,
    ) -> Start:
        """Return the start of one body with an attitude and an angular velocity.

        Parameters
        ----------
        attitude : array_like or scipy.spatial.transform.Rotation
            Unit quaternion, scalar first, shape (4,) or (N, 4); or the rotation from body to space
            axes, a 3 × 3 matrix or SciPy's, one or N.
        omega : array_like, shape (3,) or (N, 3)
            Angular velocity Ω in body axes, in rad/s.
        inertia : array_like
            About the fixed point, in kg m²: principal moments I₁, I₂, I₃, or the tensor in body
            axes, 3 × 3, for a system that has such (``Multibody``, a model file).
        parameters : mapping of str to number, optional
            As of any start.

        Returns
        -------
        Start
            With q and p = 2 L(q)ᵀ J Ω (82), in kg m²/s, each of shape (4,) or (N, 4).

        Raises
        ------
        InputError
            If an argument is not of that kind.

        Examples
        --------
        >>> import gyrospark as gs
        >>> gs.Start.of_body([1, 0, 0, 0], [0, 5, 100], (0.001, 0.001, 0.002)).p
        array([0.   , 0.   , 0.01 , 0.4  ])
        """
        state_of_body = function_of("runtime.rigid_body.quaternion", "state_of_body")
        q, p = state_of_body(attitude, omega, inertia)
        return cls(q, p, parameters)

    def replace(self, **changes: Any) -> Start:
        """Return a start with other ``q``, ``p``, ``parameters``, ``t`` or ``inputs``.

        All else of a model or of a row of a run stays, such as bodies, rules and events.
        """
        present_values = {name: getattr(self, name)
                          for name in ("q", "p", "parameters", "t", "inputs")}
        if unknown_names := changes.keys() - present_values.keys():
            raise InputError(f"replace has no argument {min(unknown_names)!r}; it takes "
                             f"{', '.join(present_values)}.")
        start = Start(**present_values | changes)
        for name in ("_inertias", "_rules", "_span", "_events", "_spare", "_excess"):
            setattr(start, name, getattr(self, name))
        start._nominal = self._nominal and changes.keys().isdisjoint(("q", "p"))
        return start

    def of_model(
        self, inertias: Mapping[str, Any], rules: Mapping[str, str],
        spare: frozenset[str] = frozenset(), span: tuple[Any, Any] = (None, None),
        events: Sequence[Event | Impact] = (),
    ) -> Self:
        """Set a model's bodies, its rules for γ and α, dt, steps and events; return the start."""
        self._inertias, self._rules, self._spare, self._span = inertias, rules, spare, span
        self._events, self._nominal = tuple(events), True
        return self


def without_events(start: Start) -> Start:
    """Return the start of a run without the model's events and impacts; all else is the same."""
    start = start.replace()
    start._events = ()
    return start


def has_start(value: Any) -> TypeGuard[HasStart]:
    """Whether a value has a start: of a protocol, ``isinstance`` takes as long as some steps."""
    return hasattr(type(value), "start") or hasattr(value, "start")  # a property is not evaluated


def as_start(value: Any) -> Start:
    """Return the start of an object that has one.

    Raises InputError for anything else.
    """
    start = getattr(value, "start", None)
    if not isinstance(start, Start):
        raise InputError(f"start = {shown(value)} is no start; give a model, a problem, a row of a "
                         "trajectory such as run[-1], gs.Start(q, p, parameters), or q and p.")
    return start
