"""The memory of a stepper's last call, for calls that repeat it.

A loop calls with other states, and with the same step, parameters and solver: what these were
checked to be, and their compiled structs, serve again. The state is checked in each call, by the
same bounds. A state that is not plainly within them is checked as in a first call, which moves it,
warns or refuses.
"""

from __future__ import annotations

import operator
from collections.abc import Mapping
from types import NoneType
from typing import TYPE_CHECKING, Any

from ...core.errors import GyrosparkError
from ...core.records import dataclass, replace_fields
from ...core.solver import Solver, as_solver
from ...core.start import Start, as_start, has_start
from ..bindings.array_checks import as_real
from ..results.rotation_rate import Limits, are_slow
from .run_arguments import (
    IMMUTABLE,
    Integration,
    depends_on_time,
    has_searches,
    negative_parameters,
)
from .step_loop import FIRST_STEPS

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper
    from .run_arguments import StartNumbers

__all__ = ["CallMemory"]

#: Types of arguments that are the same as long as they are the same object.
_FIXED = {*IMMUTABLE, NoneType, bool, str, tuple, Solver}


@dataclass(frozen=True)
class _Call:
    """A call whose arguments were usable, and its run."""

    #: The arguments beside the state and the parameters.
    arguments: tuple[Any, ...]
    #: Names and values of the argument ``parameters``; None without it.
    parameters: tuple[list[str], list[Any]] | None
    #: Names and values of each dict of the start; None for a call by (q, p).
    start: list[tuple[list[str], list[Any]] | None] | None
    #: The start's span, and its parameters that a stepper may ignore.
    span_and_spare: tuple[Any, ...]
    plan: Integration
    limits: Limits

    def has_arguments(self, arguments: tuple[Any, ...], parameters: Any) -> bool:
        """Whether these are the arguments of the call, beside its state."""
        # the objects of the call first: equality of types and values takes longer
        return (all(map(operator.is_, arguments, self.arguments))
                or all(map(_is_same, arguments, self.arguments))) and (
                    _are_same(parameters, self.parameters))

    def has_start(self, start: Any) -> bool:
        """Whether a start differs in q, p and t alone from the start of the call."""
        return (type(start) is Start and self.start is not None and not start._events
                and (start._span, start._spare) == self.span_and_spare
                and all(map(_are_same, _dicts_of(start), self.start)))


class CallMemory:
    """Memory of the last call of one stepper; threads may share it."""

    def __init__(self) -> None:
        self._last: _Call | None = None
        #: Steps that a chunk of the last call took at its end, with which the same call begins.
        self.chunk_steps = FIRST_STEPS

    def recall(
        self, stepper: Stepper, start: Any, p: Any, arguments: tuple[Any, ...], parameters: Any
    ) -> Integration | None:
        """Return the run of a call that differs from the last one by its state alone, or None.

        A state that is not plainly usable gives None, too.
        """
        last_call = self._last
        if last_call is None or not last_call.has_arguments(arguments, parameters):
            return None
        binding, run, constants = stepper.binding, last_call.plan.run, last_call.plan.constants
        if p is None:
            start = getattr(start, "start", None)  # of a model, or of a row of a run
            if not last_call.has_start(start):
                return None
            q, p, t0 = start.q, start.p, start.t
        elif last_call.start is None:  # a call by (q, p), as the last one was
            q, t0 = start, run.t0
        else:
            return None
        try:
            q, p = stepper._state(q, p)
            t0 = t0 if last_call.start is None else as_real("t", t0, binding.number)
        except GyrosparkError:
            return None  # refused by the checks of another call, whose sentence knows the start
        if not are_slow(last_call.limits, q.tolist(), p.tolist()):
            return None
        assert constants is not None  # ``keep`` computes them
        if not (binding.is_consistent(constants.parameters, q, p)
                and binding.has_finite_energy(constants.parameters, q, p)):
            return None
        return replace_fields(last_call.plan, run=replace_fields(run, q=q, p=p, t0=t0,
                                                                 parameters=run.parameters.copy()))

    def keep(
        self, stepper: Stepper, start: Any, arguments: tuple[Any, ...], parameters: Any,
        state: StartNumbers, plan: Integration,
    ) -> None:
        """Store a call for the next one, if no check of it depends on its state.

        ``arguments`` are dt, dtau, t_end, steps, every and solver; ``state`` has all parameters;
        ``plan`` is the checked run.
        """
        run, binding = plan.run, stepper.binding
        _, _, t_end, _, _, solver = arguments
        of_start = as_start(start) if has_start(start) else None
        dicts = [] if of_start is None else _dicts_of(of_start)
        limits = stepper.rotations.limits(run.parameters, run.dt)
        # not stored: runs with checks that depend on the state or on its time, and arguments or
        # parameters that may change though they stay the same object
        if (limits is None or plan.events or t_end is not None  # ``events`` has impacts, too
                or depends_on_time(binding) or binding.clocked
                or stepper.manifest.system.velocity_names
                or not {*map(type, (*arguments, as_solver(solver).tolerance))} <= _FIXED
                or not all({*map(type, x.values())} <= _FIXED for x in (parameters or {}, *dicts))
                or has_searches(state.parameters) or negative_parameters(run.parameters)):
            return
        self._last = _Call(
            arguments, parameters=_entries(parameters),
            start=None if of_start is None else [*map(_entries, dicts)],
            span_and_spare=() if of_start is None else (of_start._span, of_start._spare),
            plan=replace_fields(plan, run=replace_fields(run, parameters=run.parameters.copy()),
                                constants=run.constants(binding)), limits=limits)
        self.chunk_steps = FIRST_STEPS


def _dicts_of(start: Start) -> tuple[Mapping[str, Any], ...]:
    """Return the dicts of a start on which a run depends beside its state."""
    return start.parameters, start.inputs, start._inertias, start._rules


def _entries(mapping: Mapping[str, Any] | None) -> tuple[list[str], list[Any]] | None:
    """Return the names and the objects of a dict; None of None."""
    return None if mapping is None else ([*mapping], [*mapping.values()])


def _are_same(mapping: Any, last_entries: tuple[list[str], list[Any]] | None) -> bool:
    """Return whether a dict has the names of ``_entries``, in their order, and the same objects."""
    if mapping is None or last_entries is None:
        return mapping is last_entries
    names, objects = last_entries
    return (isinstance(mapping, dict) and len(mapping) == len(names)
            and all(map(operator.is_, mapping.values(), objects)) and [*mapping] == names)


def _is_same(a: Any, b: Any) -> bool:
    """Return whether two arguments are one object, or equal numbers of Python's float or int.

    Two solvers are the same if their fields are.
    """
    if type(a) is Solver and type(b) is Solver:
        return (a.kind == b.kind and a.max_iterations == b.max_iterations
                and _is_same(a.tolerance, b.tolerance))
    return a is b or (type(a) is type(b) and type(a) in (float, int)
                             and a == b)
