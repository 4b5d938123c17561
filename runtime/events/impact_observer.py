"""Runs with impacts: gaps that close, where the momenta jump and the run continues on its grid.

Compiled code takes the steps, locates the impacts and applies the law (``engine``, run/impacts.h);
here it is called in pieces, and the impacts become records.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import count_text
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.event import Impact, with_restitutions
from ...core.incompatibilities import LARGEST, refuse_together
from ...core.records import replace_fields
from ...core.warnings import warn
from ..bindings.array_checks import as_real
from ..bindings.real_numbers import aligned_zeros
from ..bindings.run_memory import Rows, RunConstants, RunState
from ..integration.run_arguments import RunArguments
from ..results.crossings import Crossings, Impacts
from ..results.diagnostics import Report
from ..results.trajectory import Trajectory
from .detection import Memory
from .location import TerminalEvent

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["ImpactObserver", "refuse_unusable"]

#: Status codes with which compiled code returns before the end, beside failures of a step: its
#: memory for impacts is full; a gap stays closed; a gap is negative at the start; no motion changes
#: a gap; H is not quadratic; a terminal impact.
_FULL, _REST, _INSIDE, _UNMOVABLE, _NOT_QUADRATIC, _LATCHED = range(16, 22)
#: Impacts that one call returns at most, and those that wait to be stored.
_CAPACITY, _MOST = 1024, 2**14
_WORD = re.compile(r"[^\W\d]\w*")


class ImpactObserver:
    """Observer of the impacts of a run, which its caller stores.

    Attributes
    ----------
    events : tuple of Impact
    end : TerminalEvent or None
        The gap that ends the run: one that stays closed, or of a terminal impact.

    Raises
    ------
    InputError
        For a gap that is negative at the start.
    """

    #: No state after the last step is needed.
    terminal = False

    def __init__(self, stepper: Stepper, run: RunArguments, events: tuple[Impact, ...]) -> None:
        """Collect the arguments of C that are the same for all pieces, and check the start."""
        self.events = events
        self.end: TerminalEvent | None = None
        self._stepper, self._run = stepper, run
        binding = self._own = stepper._impact_binding()
        self._memory = aligned_zeros(int(binding.function("impact_size")()))
        self._constants = run.constants(binding)
        names = list(stepper.manifest.system.quantities)
        self._gaps = np.array([names.index(impact.quantity) for impact in events], np.intc)
        # a gap moves with the coordinates that stand in its expression
        self._depends = np.array([np.isin(
            stepper.manifest.system.coordinates,
            _WORD.findall(stepper.manifest.system.quantities[impact.quantity]))
            for impact in events], np.intc)
        self._restitution = binding.to_real(np.array([
            as_real("restitution", impact.restitution, binding.number)
            for impact in with_restitutions(events, run.parameters)]))
        self._ends = np.array([impact.terminal for impact in events], np.intc)
        #: Written by C: the round-off of each gap, and the time since the last whole step.
        self._margins, self._since = binding.new(len(events)), binding.new(1)
        self._places, self._hits = list[Array](), list[Array]()
        start = RunState.at_start(stepper.binding, run.q, run.p)
        # a call of 0 steps: C checks that the gaps are open, and computes H
        self._call(steps=0, every=1, state=start, rows=Rows.allocate(stepper.binding, 0))
        self._start_energy = float(start.record.energy_start)

    @property
    def full(self) -> bool:
        """Whether the impacts should be stored before the run continues."""
        return sum(map(len, self._places)) >= _MOST

    @property
    def memory(self) -> Memory:
        """The round-off of the gaps, with which a run resumes after whole steps."""
        no_rows = self._own.new(0, self._own.n)
        return Memory(q=no_rows, p=no_rows, closed=np.zeros(len(self.events), bool),
                      margins=self._margins.copy())

    def resume(self, _state: RunState, memory: Memory) -> None:
        """Continue from a state after whole steps, with the round-off of the gaps there."""
        self._margins[:] = memory.margins

    def advance(
        self, constants: RunConstants, steps: int, every: int, state: RunState, rows: Rows
    ) -> int:
        """Advance as ``binding.integrate`` does, up to a gap that stays closed.

        If there are more impacts than one call returns, it advances to the end of the present step.
        """
        first_step = state.steps
        status = self._call(steps, every, state, rows)
        # ``_since`` is the time since the last whole step: 0 at the end of a step
        while status == _FULL and self._since[0]:
            row = (state.steps - first_step) // every
            previous_iterations = rows.iterations[row]
            status = self._call(steps=1, every=1, state=state, rows=rows[row:])
            rows.iterations[row] = max(previous_iterations, rows.iterations[row])
        return 0 if status == _FULL else status

    def close(self, _state: RunState, _ahead: Any = None) -> None:
        """Do nothing: no impact waits for a next step."""

    def take_crossings(self, _stop: Any = None) -> dict[str, Impacts]:
        """Return the impacts since the last call, event's name → impacts.

        C gives a pair (gap, step) and a row (time since the start of the step, impulse μ, lost
        energy, work, q, p⁻, p⁺) for each impact.
        """
        binding, run = self._own, self._run
        # empty arrays first: a run without impacts has nothing to concatenate
        places = np.concatenate([np.zeros((0, 2), np.dtype("l")), *self._places])
        impact_rows = np.concatenate([binding.new(0, 4 + 3 * binding.n), *self._hits])
        self._places, self._hits = [], []
        impacts: dict[str, Impacts] = {}
        for i, event in enumerate(self.events):
            selected = places[:, 0] == i
            steps, rows = places[selected, 1], impact_rows[selected]
            time_in_step, impulse, lost, work = rows[:, :4].T.astype(binding.number_type)
            q, before, after = (block.copy() for block in np.split(rows[:, 4:], 3, axis=1))
            elapsed = binding.times(0 * run.t0, run.dt, steps) + time_in_step
            impacts[event.name] = Impacts(
                run.t0 + elapsed, q, after, steps, rising=np.zeros(len(steps), bool),
                elapsed=elapsed, p_before=before, impulse=impulse, energy_lost=lost, work=work)
        return impacts

    def add_impacts(self, report: Report, count: int) -> Report:
        """Return the report with ``count`` impacts, whose losses are no error of the energy."""
        return replace(report, energy_start=self._start_energy, impacts=count)

    def results(self, trajectory: Trajectory, impacts: dict[str, Impacts]) -> Trajectory:
        """Return a trajectory with its impacts."""
        count = sum(map(len, impacts.values()))
        return replace_fields(trajectory, report=self.add_impacts(trajectory.report, count),
                              impacts=impacts, _laws=self.events,
                              events={name: hits.crossings for name, hits in impacts.items()})

    def _call(self, steps: int, every: int, state: RunState, rows: Rows) -> int:
        """Take steps up to the last one or a terminal event; return 0 or the status of a failure.

        C returns before the end if its memory for impacts is full, if a gap stays closed or a
        terminal impact happens, which sets ``end``, and for starts and systems that have no
        impacts, which raise InputError. The impacts of the call are appended to ``_places`` and
        ``_hits``.
        """
        binding, constants, primal = self._own, self._constants, self._stepper.binding

        def shared(kind: str, struct: Any) -> Any:
            """Return a pointer to a struct of the stepper's own module."""
            # structs of two modules of cffi have two types, and the same layout
            address = int(primal.ffi.cast("uintptr_t", struct))
            return binding.ffi.cast(f"{binding.name}_{kind} *", address)

        count = binding.ffi.new("long *")
        # an impact in each row, as ``take_crossings`` reads them; one more pair is for the gap that
        # stops C
        places = np.zeros((_CAPACITY + 1, 2), np.dtype("l"))
        hits = binding.new(_CAPACITY, 4 + 3 * binding.n)
        status = int(binding.function("integrate_impacts")(
            constants.parameters, constants.options, *binding.input_arguments(constants.inputs)[:2],
            self._run.t0, constants.dt, steps, every, len(self._gaps),
            *(binding.ffi.from_buffer("int[]", x) for x in (self._gaps, self._depends)),
            binding.pointer(self._restitution), binding.ffi.from_buffer("int[]", self._ends),
            *map(binding.pointer,
                 (self._margins, state.q, state.p, rows.q, rows.p, rows.multipliers)),
            binding.ffi.from_buffer("int[]", rows.iterations, require_writable=True),
            *([binding.pointer(rows.work)] if binding.has_forces else []),
            binding.pointer(self._since),
            _CAPACITY, count, binding.ffi.from_buffer("long[]", places, require_writable=True),
            binding.pointer(hits), shared("report", state.record), shared("work", state.work),
            binding.ffi.cast("void *", binding.ffi.from_buffer(self._memory))))
        self._places.append(places[: count[0]].copy())
        self._hits.append(hits[: count[0]].copy())
        # after the impacts C writes the number of the gap that stopped it; of a gap below 0 at the
        # start, where there are no impacts, its value is in place of the first one
        return self._status_of(status, int(places[count[0], 0]), state, gap_at_start=hits[0, 0])

    def _status_of(self, status: int, gap: int, state: RunState, gap_at_start: Any) -> int:
        """Return 0 for a call that ended the run, which sets ``end``, else the status of C.

        ``gap`` is the index of the gap that stopped C. Warns of a gap that stays closed, and raises
        InputError for a start or a system without impacts.
        """
        if status in (_REST, _LATCHED):
            self.end = self._end(gap, state)
            if status == _REST:
                warn(f"The run ends at t = {float(self.end.at.t[0]):.9g} s, after {state.steps:,} "
                     f"of {count_text(self._run.steps, 'step')}: impacts of "
                     f"{self.events[gap].name!r} follow "
                     "each other faster than times resolve, and it stays closed. Go on from "
                     "run[-1] with a system that has the gap as a constraint.")
            return 0
        self._refuse(status, self.events[gap].quantity, gap_at_start)
        return status

    def _refuse(self, status: int, gap: str, gap_at_start: Any) -> None:
        """Raise InputError for a status of C that refuses the start or the system."""
        if status == _INSIDE:
            raise InputError(f"The gap {gap!r} is {float(gap_at_start):.6g} at the start, below 0; "
                             "start where it is open.")
        if status == _UNMOVABLE:
            raise InputError(f"No motion on the constraints changes the gap {gap!r}, which "
                             "closes: its gradient depends on theirs; leave its impact out.")
        if status == _NOT_QUADRATIC:
            raise InputError(f"H of {self._stepper.name} is not quadratic in p, so that the law of "
                             "impacts does not reverse the rate of a gap; take H = T(q, p) + V(q).")

    def _end(self, gap: int, state: RunState) -> TerminalEvent:
        """Return the end of the run in the present state, in which a gap is closed.

        No step ends there: its row has multipliers of NaN, and no iterations.
        """
        binding, run = self._own, self._run
        steps = np.array([state.steps])
        elapsed = binding.times(0 * run.t0, run.dt, steps) + self._since.astype(binding.number_type)
        t, q, p = run.t0 + elapsed, state.q[None].copy(), state.p[None].copy()
        # multipliers and iterations are of steps
        row = Rows(q, p, binding.new(1, binding.multipliers) + np.nan, np.zeros(1, np.intc),
                   binding.new(1) + self._stepper.binding.work_done(state.record))
        crossing = Crossings(t, q, p, steps, rising=np.zeros(1, bool), elapsed=elapsed)
        return TerminalEvent(gap, crossing, row)


def refuse_unusable(
    stepper: Stepper, run: RunArguments, impacts: tuple[Impact, ...], **call_features: Any
) -> None:
    """Refuse impacts in a run, or with a scheme or system, that cannot have any.

    ``call_features`` are further features of the call, as ``refuse_together`` takes them.
    """
    system, binding = stepper.manifest.system, stepper.binding
    refuse_together(
        impacts="impacts", splitting=not binding.solves and "the scheme splitting",
        frame=bool(stepper.symmetries) and "a co-moving frame", scaled=binding.clocked
        and "a time_scale", velocity_constraints=bool(binding.rows) and "velocity constraints",
        large=binding.n > LARGEST and f"{binding.n} coordinates",
        energy=stepper.manifest.scheme.exact_energy and "energy=True",
        float128=stepper.manifest.real == "float128" and "real='float128'", **call_features)
    # an impact changes momenta at one q and t: a gap that depends on them would jump itself, as
    # one of inputs would between two steps
    moving_names = {*system.momenta, *system.velocity_names, *binding.input_names}
    for impact in with_restitutions(impacts, run.parameters):
        if impact.quantity not in system.quantities:
            raise InputError(f"{impact.quantity!r} is no quantity of {system.name}; declare the "
                             f"gap, quantities={{'gap': {impact.quantity}}}.")
        moving = moving_names & {*_WORD.findall(system.quantities[impact.quantity])}
        if moving:
            raise InputError(f"The gap {impact.quantity!r} depends on {min(moving)}; a gap is a "
                             "function of coordinates, parameters and time.")
        if run.dt < 0 and impact.restitution != 1:
            raise InputError(f"dt = {float(run.dt):g} runs backwards, where an impact with "
                             f"restitution = {impact.restitution} has no state before it; take "
                             "restitution=1, or a positive dt.")
