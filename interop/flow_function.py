"""The base of the functions of all libraries: their arguments and refusals."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..core.arguments import choose
from ..core.errors import InputError
from ..core.event import Impact
from ..core.warnings import warn
from ..runtime.bindings.array_checks import as_numbers, converted_to
from ..runtime.steppers.stepper import Stepper
from .discrete_flow import DiscreteFlow

__all__ = ["FlowFunction", "no_second_order", "no_third_order", "on_mapped_axis"]

#: Choices for second derivatives.
_SECOND_ORDER = ("exact", "differences", "refuse")


class FlowFunction(ABC):
    """N steps of a stepper as a function of a library: (q, p, parameters) → (q, p).

    The steps have no impacts: contacts and stops of a model are left out, as in runs from q and p,
    with a warning.

    Parameters
    ----------
    stepper : Stepper
        With real="double".
    steps : int
        Number of steps.
    dt : float, optional
        Time step of calls that give none.
    second_order : {"exact", "differences", "refuse"}
        Systems that have no exact second derivatives (see ``Stepper.hessian``) take "differences":
        central ones of order 4 of the first derivatives, about ten digits where a run is not
        sensitive. The start is moved along the constraints alone.

    Raises
    ------
    InputError
        For a stepper of another type of numbers, and unless ``steps`` is a whole number.

    Attributes
    ----------
    names : list of str
        The parameters in the order of an array of them.
    failures : deque of str
        The reasons of the last results that are NaN.
    """

    #: Whether the library gives vectors the shape of a column.
    _columns = False
    #: The library's own arrays, which may be symbols, and how a list of them becomes one.
    _arrays: tuple[type, ...]
    _stack: str

    def __init__(self, stepper: Stepper, steps: int, dt: Any, second_order: str) -> None:
        self._has_second = choose("second_order", second_order, _SECOND_ORDER) != "refuse"
        self._flow = DiscreteFlow(stepper, steps, exact=second_order == "exact")
        impacts = [event.name for event in stepper._model_events if isinstance(event, Impact)]
        if impacts:
            warn(f"The model of {stepper.name} has the impacts {', '.join(impacts)}, and steps in "
                 "another library have none: bodies pass through. Take step.integrate(model) and "
                 "its gradients for runs with impacts.")
        self._dt = dt
        self.names, self.failures = self._flow.names, self._flow.failures

    def __call__(
        self, q: Any, p: Any, parameters: Mapping[str, Any] | Any, *, dt: Any = None,
        t0: Any = 0.0, inputs: Any = None,
    ) -> tuple[Any, Any]:
        """Return (q, p) after N steps; NaN where one fails, with the reason in ``failures``.

        Parameters
        ----------
        q, p : array, shape (n,)
            The start, which is projected onto the constraints: see ``Stepper.project``.
        parameters : dict of scalars, or array in the order of ``names``
            Without the inputs.
        dt, t0 : scalar
            Time step and time at the start.
        inputs : array, shape (steps, inputs) or (inputs,)
            The inputs of each step, or one row for all steps.

        Raises
        ------
        InputError
            For names, shapes and number types that do not fit the stepper.
        """
        z = self._evaluate(self._components_of(q, p, parameters, self._dt if dt is None else dt, t0,
                                               inputs))
        return z[: self._flow.n], z[self._flow.n :]

    @abstractmethod
    def _evaluate(self, parts: list[tuple[Any, tuple[int, ...]]]) -> Any:
        """Return F(x); ``parts`` are the components of x, each with the shape to broadcast to."""

    def _array(self, name: str, argument: Any) -> Any:
        """Return an array of the library unchanged, and other numbers as an array of NumPy.

        Raises InputError for entries that are no real numbers, and for a list with symbols of the
        library.
        """
        if isinstance(argument, self._arrays):
            kind = getattr(argument, "dtype", None)
            if getattr(kind, "kind", "f") in "cb":
                raise InputError(f"{name} has entries of type {kind}; give real numbers.")
            return argument
        try:
            return converted_to(np.float64, as_numbers(name, argument))
        except InputError:
            raise
        except (TypeError, ValueError, RuntimeError):
            raise InputError(f"{name} is a list with symbols of the library; make it one array, by "
                             f"{self._stack}.") from None

    def _shape(self, value: Any) -> tuple[int, ...]:
        """Return the shape of an argument, as NumPy has shapes."""
        return np.shape(value)

    def _components_of(
        self, q: Any, p: Any, parameters: Any, dt: Any, t0: Any, inputs: Any
    ) -> list[tuple[Any, tuple[int, ...]]]:
        """Return the components of x in their order, each with its full shape; refuse other shapes.

        Parameters are a dict, a component for each, or one vector.
        """
        flow, count = self._flow, len(self._flow.input_names)
        arguments: list[tuple[str, Any, tuple[int, ...]]] = [("q", q, (flow.n,)),
                                                             ("p", p, (flow.n,))]
        if isinstance(parameters, Mapping):
            arguments += [(f"Parameter {name}", argument, ()) for name, argument in
                          zip(self.names, flow.parameters(parameters), strict=True)]
        else:
            arguments.append(("parameters", parameters, (len(self.names),)))
        if dt is None:
            raise InputError("dt is not given; give it here or where this function is made.")
        arguments += [("dt", dt, ()), ("t0", t0, ())]
        if count and inputs is None:
            raise InputError(f"inputs are not given; give {', '.join(flow.input_names)}, "
                             f"shape ({flow.steps}, {count}) or ({count},).")
        if inputs is not None:
            arguments.append(("inputs", inputs, (flow.steps, count)))
        arguments = [(name, self._array(name, argument), shape)
                     for name, argument, shape in arguments]
        for name, argument, shape in arguments:
            given_shape, allowed = self._shape(argument), {shape}
            if name == "inputs":
                allowed.add((count,))
            # one number needs no axis; to CasADi columns of one number have none
            if shape[-1:] == (1,):
                allowed |= {(), shape[:-1] if self._columns else ()}
            if given_shape not in allowed:
                raise InputError(f"{name} has shape {given_shape}; give shape {shape}.")
        return [(argument, shape) for _, argument, shape in arguments]


def on_mapped_axis(
    function: Callable[..., Any], arrays: Sequence[Any], axes: Sequence[int | None], size: int,
    move: Callable[[Any, int, int], Any], repeat: Callable[[Any, int, int], Any],
) -> tuple[Any, int]:
    """Return a function of arrays of which ``axes`` are mapped, and the mapped axis of the result.

    The mapped axis, of length ``size``, is put before the axis of points and merged with it; if x,
    the first array, has none, before the axis of directions: all of them follow one run. The
    library moves an axis, ``move(array, axis, new_axis)``, and inserts one of equal entries,
    ``repeat(array, axis, size)``.
    """
    mapped_axis = 0 if axes[0] is not None else 1
    point_rows = []
    for i, (array, axis) in enumerate(zip(arrays, axes, strict=True)):
        if i == 0 and axis is None:
            point_rows.append(array)
            continue
        mapped = (repeat(array, mapped_axis, size) if axis is None
                  else move(array, axis, mapped_axis))
        # not −1: an axis of length 0 may be mapped
        count = mapped.shape[mapped_axis + 1]
        point_rows.append(mapped.reshape(*mapped.shape[:mapped_axis], size * count,
                                         *mapped.shape[mapped_axis + 2 :]))
    result = function(*point_rows)
    return result.reshape(*result.shape[:mapped_axis], size, count,
                          *result.shape[mapped_axis + 1 :]), mapped_axis


def no_second_order(cure: str = "") -> InputError:
    """Return the refusal of a second derivative; ``cure`` is one of the library."""
    return InputError("Second derivatives of steps are refused by second_order=\"refuse\", which "
                      f"was given{cure}; leave it out, and they are exact.")


def no_third_order() -> InputError:
    """Return the refusal of a third derivative."""
    return InputError("Steps have first and second derivatives, and a third one is asked for; take "
                      "differences of second ones.")
