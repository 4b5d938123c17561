"""A model: a system together with the numbers to run it with."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import (
    as_integer,
    as_items,
    as_mapping,
    as_text,
    choose,
    count_text,
    few,
    shown,
)
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.event import Event, Impact, events_of_model
from ...core.exact_numbers import exact
from ...core.frozen_dict import FrozenDict
from ...core.html import card, table
from ...core.inertia import Inertia, as_moments_or_tensor, real_array
from ...core.records import dataclass
from ...core.registry import FRAMES, RULES
from ...core.shapes import Shape
from ...core.start import Start
from ...core.units import base_units
from ..systems.system import System

__all__ = ["Model", "exact_array"]

#: Depth at most, relative to the coordinates, of a gap that touches in an equilibrium: it is above
#: the error of the coordinates.
_TOUCH = 1e-12


@explain_arguments
@dataclass(frozen=True, eq=False)
class Model:
    """A system, its parameters and a state to start from.

    Attributes
    ----------
    system : System
        H, constraints, forces and quantities; its name is the model's.
    parameters : mapping of str to number
        The value of every parameter of the system, but for those in ``bodies``, which may be
        left to be chosen. Real numbers of any type; steppers round them to their own.
    q0, p0 : ndarray, shape (n,)
        State at t = 0, read-only; of floats, or of objects where numbers with more digits are
        given.
    bodies : mapping of str to tuple
        Name of each inertia parameter (γ or α of a body) → the body's I₁, I₂, I₃ in kg m², or its
        tensor, 3 × 3.
    rules : mapping of str to str
        Name of an inertia parameter without a value → the rule by which a run finds it, "m" where
        nothing is said: "m", "h", "mt", "ht", "auto" or "auto-energy".
    dt, steps : float and int, or None
        A time step in s and a number of steps that suit the model, where it names them.
    description : str
        One sentence for people.
    frame : str
        "symmetries" where its steppers shall have co-moving frames, whose rates are the least
        squares of the start unless a run is given others.
    events : tuple of Event and Impact
        Events and impacts of its runs, unless these are given others:
        ``events=[*model.events, another]``; impacts stay unless others are given.
    units : mapping of str to str
        SI unit of parameters, inputs, coordinates, momenta or quantities, "kg.m2" or "N.m/rad";
        manifests complete them by those that follow.
    visuals : mapping of str to sequence of Shape
        What pages and exports draw bodies with, by the names of bodies; "" is the ground.
    """

    system: System
    parameters: Mapping[str, float]
    q0: Array
    p0: Array
    bodies: Mapping[str, Inertia] = field(default_factory=dict)
    dt: float | None = None
    steps: int | None = None
    description: str = ""
    frame: str = ""
    rules: Mapping[str, str] = field(default_factory=dict)
    events: Sequence[Event | Impact] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    visuals: Mapping[str, Sequence[Shape]] = field(default_factory=dict)

    #: The digest of the system, where it comes from a cache and is not made yet.
    system_digest: ClassVar[str | None] = None

    @classmethod
    def of_numbers(cls, numbers: Any, system_digest: str, make: Callable[[], Model]) -> Model:
        """Return a model from its numbers; its system is made when it is first asked for.

        Parameters
        ----------
        numbers : RunDefaults
            Numbers, name and description of the model that ``make`` returns.
        system_digest : str
            The digest of the system.
        """
        q0, p0 = np.array(numbers.q0), np.array(numbers.p0)
        for state in (q0, p0):
            state.setflags(write=False)
        # without __init__, whose checks need the system
        model = object.__new__(cls)
        model.__dict__.update(
            parameters=FrozenDict(numbers.parameters), q0=q0, p0=p0,
            bodies=FrozenDict({name: as_moments_or_tensor(inertia)
                                     for name, inertia in numbers.bodies.items()}),
            dt=numbers.dt, steps=numbers.steps, description=numbers.description,
            frame="symmetries" if "frame" in numbers.rules else "",
            rules=FrozenDict({name: rule for name, rule in numbers.rules.items()
                              if name != "frame"}), events=numbers.events,
            units=FrozenDict({}), visuals=FrozenDict(numbers.visuals),
            system_digest=system_digest, _name=numbers.name,
            _make=make)
        return model

    if not TYPE_CHECKING:
        def __getattr__(self, name: str) -> Any:
            """Return the system of a model made by ``of_numbers``, at its first use.

            Python calls this for missing attributes only.
            """
            if name != "system" or "_make" not in self.__dict__:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            return self.__dict__.setdefault("system", self._make().system)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields for pickle, with the system in place of the function that makes it."""
        state = {**self.__dict__, "system": self.system}
        state.pop("_make", None)
        return state

    def __post_init__(self) -> None:
        """Check every field, and replace mappings by immutable ones."""
        # a frozen dataclass refuses assignments: __setattr__ of object replaces its fields
        if not isinstance(self.system, System):
            raise InputError(f"system = {shown(self.system)} is no gyrospark.System.")
        as_text("description", self.description)
        if not isinstance(self.frame, str) or self.frame:
            choose("frame", self.frame, FRAMES)
        object.__setattr__(self, "events", events_of_model(
            self.events, [*self.system.quantities],
            [*map(str, (*self.system.q, *self.system.p))]))
        for name in ("q0", "p0"):
            object.__setattr__(self, name, self._state(name, getattr(self, name)))
        values = {name: self._number(f"parameter {name!r}", value) for name, value in as_mapping(
            "parameters", self.parameters, "{'m': 1.0}").items()}
        bodies = {name: as_moments_or_tensor(inertia) for name, inertia in as_mapping(
            "bodies", self.bodies, "{'gamma': (I1, I2, I3)}").items()}
        object.__setattr__(self, "parameters", FrozenDict(values))
        object.__setattr__(self, "bodies", FrozenDict(bodies))
        object.__setattr__(self, "rules", FrozenDict(self._checked_rules()))
        object.__setattr__(self, "visuals", FrozenDict(self._checked_visuals()))
        object.__setattr__(self, "units", FrozenDict(self._checked_units()))
        if self.dt is not None:
            object.__setattr__(self, "dt", self._number("dt", self.dt))
        if self.steps is not None:
            object.__setattr__(self, "steps", self._count(self.steps))
        self._refuse_wrong_parameters()

    def _checked_rules(self) -> Mapping[str, Any]:
        """Return the rules of γ and α; refuse one for a parameter with a value, or of no body."""
        rules = as_mapping("rules", self.rules, "{'gamma': 'auto'}")
        for name, rule in rules.items():
            choose(f"rules[{name!r}]", rule, RULES)
            if name not in self.bodies or name in self.parameters:
                raise InputError(f"Model {self.name!r} has a rule for {name!r}, which is no "
                                 "inertia parameter without a value; leave it out.")
        return rules

    def _checked_visuals(self) -> dict[str, tuple[Any, ...]]:
        """Return the shapes of each body of the system, and of the ground under \"\"."""
        visuals = {name: tuple(as_items(f"visuals[{name!r}]", shapes, "shapes")) for name, shapes
                   in as_mapping("visuals", self.visuals, "{'arm': [shape]}").items()}
        for name, shapes in visuals.items():
            choose("body of a visual", name, ["", *(body.name for body in self.system.bodies)])
            for shape in shapes:
                if not isinstance(shape, Shape):
                    raise InputError(f"visuals[{name!r}] has {shown(shape)}; give instances of "
                                     "gyrospark.Shape.")
        return visuals

    def _checked_units(self) -> Mapping[str, Any]:
        """Return the units by name; refuse unknown names and units."""
        units = as_mapping("units", self.units, "{'mgl': 'N.m'}")
        names_with_units = [*map(str, (*self.system.parameters, *self.system.q, *self.system.p)),
                 *self.system.quantities]
        for name, unit in units.items():
            choose("name of a number with a unit", name, names_with_units)
            base_units(unit)
        return units

    def _refuse_wrong_parameters(self) -> None:
        """Refuse values of other parameters than the system's, and a parameter without one."""
        names = {str(symbol) for symbol in self.system.parameters}
        for name in (*self.parameters, *self.bodies):
            if name not in names:
                raise InputError(f"Model {self.name!r} has a value for {name!r}, which is no "
                                 "parameter of its system; the parameters are "
                                 f"{', '.join(sorted(names)) or 'none'}.")
        unset = sorted(names - {*self.parameters, *self.bodies})
        if unset:
            raise InputError(f"Model {self.name!r} has no value for its parameter {unset[0]!r}; "
                             "give one.")

    def __repr__(self) -> str:
        steps = "" if self.steps is None else f", {count_text(self.steps, 'step')}"
        run = "" if self.dt is None else f"; dt = {self.dt:g} s{steps}"
        counts = {"coordinate": self.system.n, "constraint": self.system.m,
                  "parameter": len(self.parameters), "body": len(self.bodies)}
        parts = ", ".join(count_text(count, noun) for noun, count in counts.items())
        return f"<Model {self.name}: {parts}{run}>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the numbers, and the system's formulas."""
        rows = [("about", self.description or self.name),
                ("step", "none named" if self.dt is None else f"{self.dt:g} s"),
                ("steps", "none named" if self.steps is None else f"{self.steps:,}"),
                ("parameters", few(f"{name} = {float(x):g}" for name, x in
                                   self.parameters.items())),
                ("q₀", few(f"{x:.6g}" for x in self.q0.astype(float))),
                ("p₀", few(f"{x:.6g}" for x in self.p0.astype(float)))]
        return card(f"Model {self.name}", table(rows), self.system._repr_html_())

    @property
    def name(self) -> str:
        """The system's name."""
        name: str = self.__dict__.get("_name") or self.system.name
        return name

    @property
    def start(self) -> Start:
        """Where a run of it starts; γ and α without a value are found by its rules."""
        # the rates of a co-moving frame are found by a rule, too: the least squares of the start
        rules = {**self.rules, **({"frame": "start"} if self.frame else {})}
        return Start(self.q0, self.p0, self.parameters).of_model(
            self.bodies, rules, span=(self.dt, self.steps), events=self.events)

    def equilibrium(self) -> Model:
        """Return the model that starts at rest in static equilibrium, near its start.

        H_q + g_qᵀλ = F and g = 0 at p = 0 and t = 0: the rest shape of a cable or a beam under its
        loads. Of several equilibria a stable one is preferred; a start at an unstable one stays
        there, with a warning.

        Raises
        ------
        InputError
            For a system that moves where its momenta are 0, one from a Lagrangian or with velocity
            constraints, where no equilibrium is reached, and where contacts or stops would hold it.
        """
        from ..symbolic.numeric_evaluation import evaluate
        from ..systems.equilibrium import equilibrium

        values = {**dict.fromkeys(self.bodies, 1.0), **self.parameters}  # γ moves nothing at rest
        q, _ = equilibrium(self.system, values, self.q0)
        gaps = [event.quantity for event in self.events if isinstance(event, Impact)]
        numbers = dict(zip(self.system.q, q, strict=True)) | {
            x: float(values[str(x)]) for x in self.system.parameters}
        if self.system.time is not None:
            numbers[self.system.time] = 0.0
        sizes = evaluate([self.system.quantities[name] for name in gaps], numbers)
        depth = _TOUCH * max(np.abs(self.q0).max(), np.abs(q).max())
        for name, size in zip(gaps, sizes, strict=True):
            if not size >= -depth:
                raise InputError(f"Model {self.name!r} is in equilibrium where the gap {name!r} is "
                                 f"{size:.6g}, below 0; forces of contacts and stops are not in "
                                 "the equilibrium: give a joint or a spring in their place.")
        return replace(self, q0=q, p0=np.zeros(len(q)))

    def in_type(self, number: Callable[[Fraction], Any]) -> Model:
        """Return the model with all numbers rounded once, by ``number``: Fraction → type."""
        def round_to_type(value: Any) -> Any:
            """Return a number, or a tuple of numbers, rounded to the type."""
            if isinstance(value, tuple):
                return tuple(map(round_to_type, value))
            fraction = exact(value)
            # symbols and None are no numbers and stay as they are
            return number(fraction) if isinstance(fraction, Fraction) else value

        q0, p0 = (np.array([round_to_type(x) for x in values]) for values in (self.q0, self.p0))
        return replace(
            self, q0=q0, p0=p0, dt=round_to_type(self.dt),
            parameters={name: round_to_type(x) for name, x in self.parameters.items()},
            bodies={name: round_to_type(inertia) for name, inertia in self.bodies.items()})

    def _state(self, name: str, values: ArrayLike) -> Array:
        """Return q0 or p0 as doubles, or with more digits if they would lose some."""
        state, count = real_array(values), self.system.n
        if state is None or state.shape != (count,) or not np.isfinite(state).all():
            raise InputError(f"{name} of model {self.name!r} is {shown(values)}; give "
                             f"{count} finite numbers.")
        fractions = [exact(x) for x in np.array(values, dtype=object).flat]  # None: no number
        # numbers that doubles would round keep their digits, for steppers of wider types
        if None not in fractions and fractions != [Fraction(x) for x in state]:
            is_long = isinstance(values, np.ndarray) and values.dtype == np.longdouble
            state = np.array(values, dtype=np.longdouble if is_long else object)
        state.setflags(write=False)
        return state

    def _number(self, name: str, value: Any) -> Any:
        """Return a finite number in its own type: steppers of wide types use all its digits."""
        number = real_array(value)
        if number is None or number.ndim or not np.isfinite(number):
            raise InputError(f"{name} of model {self.name!r} is {shown(value)}; give a finite "
                             "number.")
        return float(number) if exact(value) is None else value

    def _count(self, value: Any) -> int:
        """Return the number of steps, or refuse a value that is no whole number ≥ 0."""
        count = as_integer(value)
        if count is None or count < 0:
            raise InputError(f"steps of model {self.name!r} is {shown(value)}; give a whole number "
                             "from 0 on.")
        return count


def exact_array(values: Sequence[float]) -> Array:
    """Return an object array, in which ``Rounded`` doubles keep their exact values."""
    return np.array(values, dtype=object)
