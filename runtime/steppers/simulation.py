"""Trajectories whose solver memory (predictor, compensation terms) persists between calls.

``AdvancingRun`` is what both users of it share: ``Simulation``, which its caller advances by any
number of steps, and a loop of ``Stepper.step``, which gives each call the end of the one before. As
long as it does, with the same time step, parameters and solver, compiled code goes on in the memory
of that call: a step then has the iterations and the bits of a step inside ``integrate``. Any
other call starts anew, as ``integrate`` does. ``RecordingRun`` keeps every state of a simulation as
well.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import count_text, few, proposal, shown
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import AbsentError, InputError, StepFailed, Stopped
from ...core.exact_numbers import Number
from ...core.frozen_dict import FrozenDict
from ...core.html import card, table
from ...core.incompatibilities import refuse_together
from ...core.interrupts import catch_ctrl_c
from ...core.manifest import Manifest
from ...core.records import FixedAttributes, replace_fields
from ...core.start import Start
from ..bindings.array_checks import as_positive_count, as_real
from ..bindings.binding import Binding
from ..bindings.inputs import InputRows
from ..bindings.run_memory import Rows, RunRecord, RunState, WorkMemory
from ..compilation.body_columns import body_named, joint_named
from ..integration.consistency import refuse_inconsistent
from ..integration.failure import diagnose
from ..integration.run_arguments import RunArguments, steps_until, warn_of_negative
from ..integration.step_loop import (
    FIRST_STEPS,
    ChunkSize,
    ended_at,
    integrate,
    trajectory_of,
)
from ..results.diagnostics import Report
from ..results.outputs import place_of_quantity
from ..results.present_motion import PresentBody, PresentJoint, PresentPlaced, body_at_present
from ..results.start_of_row import start_of_row
from ..results.trajectory import Trajectory

if TYPE_CHECKING:
    from .stepper import Stepper

__all__ = ["AdvancingRun", "Simulation"]


class AdvancingRun:
    """A run with its own solver memory; compiled code advances ``steps``, ``q`` and ``p``."""

    def __init__(self, binding: Binding, run: RunArguments, work: WorkMemory | None = None) -> None:
        """Begin at the start of a run; ``work`` is memory to be used again, else new memory."""
        self.run, self.binding = run, binding
        self.q, self.p = run.q.copy(), run.p.copy()
        self.work = binding.work() if work is None else work
        self._advance = binding.function("advance")
        self._state = binding.pointer(self.q), binding.pointer(self.p)
        options = binding.options(run.tolerance, run.max_iterations, run.solver)
        binding.function("begin")(self.work, binding.parameters(run.parameters, run.t0), options,
                                  run.dt, *self._state)

    @property
    def steps(self) -> int:
        """The number of steps since the start."""
        return int(self.record.steps)

    @property
    def record(self) -> RunRecord:
        """The running record."""
        return self.binding.record_of(self.work)

    def advance(self, steps: int) -> int:
        """Take up to ``steps`` steps; return the status, 0 or the code of the step that failed."""
        return int(self._advance(self.work, steps, *self._state))

    def feed(self, row: Array) -> None:
        """Continue with other inputs, a row of them in the order of their names."""
        self.binding.function("set_inputs")(self.work, self.binding.pointer(row))

    def set_inputs(self, parameters: dict[str, Any]) -> None:
        """Continue with parameters of which inputs alone differ."""
        self.run = replace(self.run, parameters=parameters)
        row = self.binding.new(len(self.binding.input_names))
        row[:] = [parameters[name] for name in self.binding.input_names]
        self.feed(row)

    def set_parameters(self, parameters: dict[str, Any]) -> None:
        """Continue with other values of the parameters."""
        self.run = replace(self.run, parameters=parameters)
        self.binding.function("set_parameters")(
            self.work, self.binding.parameters(parameters, self.run.t0))

    @property
    def image(self) -> tuple[Any, ...]:
        """Copies of q, p and the solver memory as bytes: all that changes from step to step."""
        return self.q.copy(), self.p.copy(), self.binding.image(self.work).tobytes()

    @image.setter
    def image(self, image: tuple[Any, ...]) -> None:
        """Restore a copy in place: compiled code keeps the addresses of q, p and the memory."""
        self.q[:], self.p[:] = image[:2]
        memory = self.binding.image(self.work)
        memory[:] = np.frombuffer(image[2], dtype=np.uint8)

    def trajectory(self, manifest: Manifest) -> Trajectory:
        """Return the present state as a trajectory of one row, with the record of all steps so far.
        """
        t = self.run.t0 + self.steps * self.run.dt
        # ``every`` beyond the number of steps: only the start of this run, the present, is a row
        run = replace(self.run, q=self.q, p=self.p, t0=t, steps=self.steps + 1,
                      every=self.steps + 2)
        rows = Rows.allocate(self.binding, 1)
        rows.q[0], rows.p[0] = self.q, self.p
        return replace_fields(trajectory_of(self.binding, manifest, run, lambda: rows, self.record,
                                            self.q.copy(), self.p.copy()), every=1)


class ContinuedStep(AdvancingRun):
    """A trajectory of ``Stepper.step``: the caller passes all arguments again at each step."""

    def __init__(
        self, binding: Binding, run: RunArguments, arguments: tuple[Any, ...],
        work: WorkMemory | None = None,
    ) -> None:
        """Begin as ``AdvancingRun`` does; ``arguments`` are those that each call repeats."""
        super().__init__(binding, run, work)
        #: The caller's arguments beside the state, before any check: equal ones need none again.
        #: The last one, the parameters, is copied: callers may change their dict.
        *self._arguments, self._parameters = *arguments[:-1], dict(arguments[-1])

    def continues(self, q: Any, p: Any, t0: Any, arguments: tuple[Any, ...]) -> bool:
        """Whether (q, p, t0) is the end of the last step, and the other arguments are the same."""
        run = self.run
        return (
            type(q) is np.ndarray and type(p) is np.ndarray
            and q.dtype == self.q.dtype and p.dtype == self.p.dtype
            and np.array_equal(q, self.q) and np.array_equal(p, self.p)
            and (self.binding.time is None or t0 == run.t0 + self.steps * run.dt)
            and all(map(_equal, arguments[:-1], self._arguments))
            and _equal_numbers(arguments[-1], self._parameters)
        )

    def run_from(self, q: Any, p: Any, t0: Any) -> RunArguments:
        """Return a run of one step from (q, p) at t0, which are checked already."""
        return replace(self.run, q=np.array(q, self.q.dtype), p=np.array(p, self.p.dtype), t0=t0)


class RecordingRun(AdvancingRun):
    """A run in several calls that stores every state."""

    def __init__(self, binding: Binding, run: RunArguments) -> None:
        """Begin as ``AdvancingRun`` does, with rows for the first states and inputs."""
        super().__init__(binding, run)
        self._run_state = RunState(self.q, self.p, binding.report(), self.work)
        self._failed = False
        self._rows = Rows.allocate(binding, FIRST_STEPS + 1)
        self._rows.q[0], self._rows.p[0] = run.q, run.p
        #: The inputs of each step, and whether any were given.
        self._inputs, self._has_inputs = binding.new(FIRST_STEPS, len(binding.input_names)), False
        self._integrate_piece(0)  # initialises the solver memory and the record

    @property
    def record(self) -> RunRecord:
        """The running record."""
        return self._run_state.record

    def advance(self, steps: int) -> int:
        """Take up to ``steps`` steps and store their states; return the status, 0 on success."""
        if self._failed:
            raise InputError(
                f"Step {self.steps + 1:,} of this simulation found no solution, and what it "
                "records ends there; start another one from sim.q and sim.p.")
        self._make_room(self.steps + steps)
        self._inputs[self.steps : self.steps + steps] = [
            self.run.parameters[name] for name in self.binding.input_names]
        status = self._integrate_piece(steps)
        self._failed = status != 0
        return status

    def _integrate_piece(self, steps: int) -> int:
        """Integrate ``steps`` steps into the rows behind those of earlier steps; return the status.
        """
        return self.binding.integrate(
            self.run.constants(self.binding), steps, every=1, state=self._run_state,
            rows=self._rows[self.steps + 1 :])

    def _make_room(self, steps: int) -> None:
        """Enlarge the memory for rows to ``steps`` steps, at least to twice its size."""
        if steps > len(self._inputs):
            self._move_rows(max(steps, 2 * len(self._inputs)), self._rows, self._inputs)

    def _move_rows(self, room: int, rows: Rows, inputs: Array) -> None:
        """Move the rows of all steps so far into memory for ``room`` steps."""
        step_count = self.steps
        self._rows, self._inputs = (Rows.allocate(self.binding, room + 1),
                                    self.binding.new(room, inputs.shape[1]))
        self._rows.assign(np.s_[: step_count + 1], rows[: step_count + 1])
        self._inputs[:step_count] = inputs[:step_count]

    def feed(self, row: Array) -> None:
        """Note that inputs were given; ``advance`` reads them from the parameters of the run."""
        self._has_inputs = True

    def set_parameters(self, parameters: dict[str, Any]) -> None:
        """Refuse other values of the parameters: a trajectory has one of each."""
        refuse_together(recording="a simulation with record=True",
                        new_parameters="other values of its parameters")

    @property
    def image(self) -> tuple[Any, ...]:
        """Copies of q, p, solver memory, record, and the rows and inputs of all steps so far."""
        step_count = self.steps
        return (*super().image, self.binding.image(self.record).tobytes(),
                self._rows[: step_count + 1].copy(), self._inputs[:step_count].copy(),
                self._has_inputs, self._failed)

    @image.setter
    def image(self, image: tuple[Any, ...]) -> None:
        """Restore a copy, with its rows and inputs."""
        # the entries of the image as the getter lists them; super() can read a property, not set it
        AdvancingRun.image.__set__(self, image[:3])  # type: ignore[attr-defined]
        report, rows, inputs, self._has_inputs, self._failed = image[3:]
        # the record first: ``steps``, the number of rows that are moved, is read from it
        self.binding.image(self.record)[:] = np.frombuffer(report, dtype=np.uint8)
        self._move_rows(max(self.steps, FIRST_STEPS), rows, inputs)

    def trajectory(self, manifest: Manifest) -> Trajectory:
        """Return all states, and the inputs of each step."""
        step_count = self.steps
        rows = self._rows[: step_count + 1].copy()
        inputs = InputRows(self.binding.input_names, self._inputs[None, :step_count].copy(),
                           hold=1)
        run = replace(self.run, steps=step_count).with_inputs(inputs if self._has_inputs else None)
        # a copy: the simulation may go on
        record = self.binding.report()
        self.binding.image(record)[:] = self.binding.image(self.record)
        return trajectory_of(self.binding, manifest, run, lambda: rows, record, self.q.copy(),
                             self.p.copy())


@explain_arguments
class _SimulationLock:
    """The lock of a simulation, for which a second thread is refused in place of waiting."""

    def __init__(self) -> None:
        self._lock = threading.Lock()

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise InputError("This simulation is in use by another thread; give each thread its "
                             "own, by copy().")

    def __exit__(self, *_: object) -> None:
        self._lock.release()


class Simulation(FixedAttributes):
    """Trajectory advanced by its caller: ``Stepper.start`` makes it, ``advance`` takes steps.

    However the steps are shared out among calls, their bits are those of one ``integrate``. One
    thread at a time may use it; ``copy`` gives another its own.

    Attributes
    ----------
    dt : number
        The time step, in the stepper's own type.
    """

    _CURE = ("set sim.parameters, or an input by sim.input['NAME']; from another state or with "
            "another dt start another one, step.start(sim.start.replace(q=..., p=...), dt=...)")

    dt: Any

    def __init__(self, stepper: Stepper, run: RunArguments, record: bool = False) -> None:
        """``record`` keeps all states, for ``trajectory``; else the present one alone."""
        if not isinstance(run, RunArguments):
            raise InputError(f"{shown(run)} is no checked start of a simulation; call "
                             "step.start(start, dt=...), which checks it and returns one.")
        self._stepper = stepper
        self._run = (RecordingRun if record else AdvancingRun)(stepper.binding, run)
        self._lock = _SimulationLock()
        self.dt = run.dt
        self._present = _PresentState(self)
        self._bodies: dict[str | None, PresentBody | PresentPlaced] = {}
        self._joints: dict[str | None, PresentJoint] = {}

    def __repr__(self) -> str:
        size = f"{float(self.dt):.6g} s" + " of τ" * self._run.binding.clocked
        return (f"<Simulation by {self._stepper.name}: {count_text(self.steps, 'step')} of {size}, "
                f"t = {float(self.t):.6g} s>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the time, the state and the errors so far."""
        rows = [("t", f"{float(self.t):.6g} s"), ("steps", f"{self.steps:,}"),
                *((name, few(f"{float(x):.6g}" for x in values))
                  for name, values in (("q", self.q), ("p", self.p)))]
        return card(f"Simulation by {self._stepper.name}", table(rows))

    # ------------------------------------------------------------ stepping

    def advance(self, steps: int = 1, **inputs: Number) -> None:
        """Take ``steps`` steps.

        Inputs of the system, by name, hold from these steps on: ``sim.advance(10, u=0.3)``.

        Raises
        ------
        InputError
            If ``steps`` is no whole number of at least 0, for an unknown input or one that is no
            number, or if another thread is at it.
        StepFailed
            When a step finds no solution. The simulation stays at the last step that did: with
            other parameters it may go on, unless it records, or a new one may start there with
            another ``dt``.
        Stopped
            After Ctrl-C in a call of many steps, as a ``KeyboardInterrupt``; the simulation is at
            the last step done.
        """
        # a control loop takes a step a call: the usual numbers pass without the check
        if type(steps) is not int or not 0 <= steps <= FIRST_STEPS:
            steps = as_positive_count("steps", steps)
        values = self._inputs(inputs) if inputs else None
        with self._lock:
            if values is not None:
                self._run.set_inputs(values)
            status = (self._run.advance(steps) if steps <= FIRST_STEPS
                      else self._advance_in_chunks(steps))
        if status:
            raise self._failure(status)

    def advance_to(self, t: Number, **inputs: Number) -> None:
        """Take steps of dt to the last time t0 + k dt that is not beyond ``t``.

        A controller of any period calls it with its own times; a time that differs from a step's
        by the rounding of decimals alone counts as the step's. Inputs hold from these steps on, as
        in ``advance``, whose errors it raises.

        Raises
        ------
        InputError
            If ``t`` is no number, or lies behind the time that is reached.
        """
        if self._run.binding.clocked:
            raise InputError("advance_to(t) counts steps of one length, and steps in scaled time "
                             "adapt; call advance() until sim.t is there, or integrate(..., "
                             "t_end=...).")
        steps = steps_until(t, self._run.run.t0, self.dt) - self.steps
        if steps < 0:
            raise InputError(f"t = {float(t):.15g} s lies behind {float(self.t):.15g} s, the time "
                             "that this simulation has reached; give a later time, or keep a "
                             "copy() to go on from.")
        self.advance(steps, **inputs)

    def _inputs(self, inputs: Mapping[str, Number]) -> dict[str, Any]:
        """Return all parameters by name, with new values of some inputs; refuse other names."""
        binding = self._run.binding
        for name in inputs:
            if name not in binding.input_names:
                raise _no_input(name, binding.input_names)
        return self._run.run.parameters | {
            name: as_real(f"Input {name}", x, binding.number) for name, x in inputs.items()}

    def _advance_in_chunks(self, steps: int) -> int:
        """Take many steps in chunks, between which Ctrl-C can stop them; return the status.

        A chunk is as long as the clock allows a user to wait. Raises Stopped after Ctrl-C.
        """
        pace, status, steps_done = ChunkSize(), 0, 0
        with catch_ctrl_c() as interrupts:
            while steps_done < steps and not status and not interrupts.is_requested:
                count = min(pace.begin(), steps - steps_done)
                status = self._run.advance(count)
                pace.end(count)
                steps_done += count
        if interrupts.is_requested and not status:
            raise Stopped(f"{ended_at(steps_done, steps)} The simulation is there.",
                          interrupts.signal)
        return status

    # ------------------------------------------------------------ what there is

    @property
    def steps(self) -> int:
        """Steps done since the start."""
        return self._run.steps

    @property
    def t(self) -> Any:
        """Time t0 + k dt after k steps, in seconds: counted, not summed up.

        In scaled time it is a coordinate.
        """
        present_run = self._run
        if present_run.binding.clocked:
            return present_run.binding.time_of(present_run.q)
        return present_run.run.t0 + self.steps * self.dt

    @property
    def q(self) -> Array:
        """Coordinates, shape (n,): a copy."""
        return self._run.q[: self._run.binding.shown].copy()

    @property
    def p(self) -> Array:
        """Momenta, shape (n,): a copy."""
        return self._run.p[: self._run.binding.shown].copy()

    @property
    def start(self) -> Start:
        """The present state, parameters and inputs, from which another run may start."""
        present_run = self._run
        parameters = present_run.run.parameters
        inputs = {name: parameters[name] for name in present_run.binding.input_names}
        state = start_of_row(self.q, self.p, self.t, parameters, inputs)
        # p[-1] is e: a run from here keeps the present value of H + e, which round-off moved from 0
        if present_run.binding.clocked:
            state._excess = self._stepper.energy(state) + present_run.p[-1]
        return state

    @property
    def trajectory(self) -> Trajectory:
        """Every state so far as a ``Trajectory``: what ``integrate`` returns for the same inputs.

        It is a copy: what is advanced later does not change it. A state takes 2n + 3 numbers, its
        multipliers and its inputs, of memory that grows as a list does.

        Raises
        ------
        InputError
            Where the simulation was started without ``record=True``; while another thread uses it.
        """
        if not self._records:
            raise AbsentError("This simulation keeps its last state alone; start it by "
                              "step.start(..., record=True) for sim.trajectory.")
        with self._lock:
            trajectory = self._run.trajectory(self._stepper.manifest)
        return trajectory.made_by(self._stepper)

    @property
    def report(self) -> Report:
        """Diagnostics over every step so far.

        Energy errors leave out what a change of parameters does to H: ``energy_start`` changes
        with it.
        """
        present_run = self._run
        return Report.read(present_run.record, present_run.q, present_run.p, present_run.binding)

    def body(self, name: str | None = None) -> PresentBody | PresentPlaced:
        """Return a rigid body at the present state, with the methods of ``run.body``.

        Its arrays are those of one state: ``sim.body("bus").angular_velocity()`` has shape (3,).
        It follows the simulation, so that a control loop may ask for it once.

        Parameters
        ----------
        name : str, optional
            Which of several bodies.

        Raises
        ------
        InputError
            Where there is no body, or several and none is named.
        """
        try:
            return self._bodies[name]
        # TypeError: a list, say, is no key, and ``body_named`` refuses it with a sentence
        except (KeyError, TypeError):
            body_name, layout = body_named(self._stepper.manifest, name)
        return self._bodies.setdefault(name, body_at_present(self._present, body_name, layout))

    def joint(self, name: str | None = None) -> PresentJoint:
        """Return a joint at the present state, with the methods of ``run.joint``.

        ``angle()`` and ``rate()`` are numbers, ``force()`` and ``torque()`` those at the start of
        the step that would follow with the present inputs, which is solved and discarded.

        Parameters
        ----------
        name : str, optional
            Which of several joints.

        Raises
        ------
        InputError
            Where there is no joint, or several and none is named.
        """
        try:
            return self._joints[name]
        except (KeyError, TypeError):
            joint_name, layout = joint_named(self._stepper.manifest, name)
        return self._joints.setdefault(name, PresentJoint(self._present, joint_name, layout))

    @property
    def input(self) -> MutableMapping[str, Any]:
        """The present values of the system's inputs, by name.

        ``sim.input["torque"] = 0.3`` holds from the next step on, as in ``advance``.

        Raises
        ------
        InputError
            For an unknown input, or one that is no number.
        """
        return _InputValues(self)

    def _set_inputs(self, inputs: Mapping[str, Number]) -> None:
        """Give inputs that hold from the next step on."""
        values = self._inputs(inputs)
        with self._lock:
            self._run.set_inputs(values)

    def quantity(self, name: str) -> Any:
        """Return a quantity of the system, at the state and the time reached.

        Raises
        ------
        InputError
            If the system has no quantity of that name.
        """
        column = place_of_quantity(self._stepper.manifest, name)
        present_run, t = self._run, self.t
        binding = present_run.binding
        time = binding.new(1)
        time[0] = t
        parameters = binding.parameters(present_run.run.parameters, t)
        # one state: row 0, with a column for each quantity
        return binding.quantities(parameters, time, present_run.q[None],
                                  present_run.p[None])[0, column]

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The parameters, as numbers; to change some, set them all.

        ``sim.parameters = sim.parameters | {"torque": 0.3}`` holds from the next step on.

        Raises
        ------
        InputError
            As ``integrate`` does; also where the state is off the constraints with the new ones.
            The simulation then keeps the old ones.
        """
        return FrozenDict(self._run.run.parameters)

    @parameters.setter
    def parameters(self, parameters: Mapping[str, Number]) -> None:
        present_run, stepper = self._run, self._stepper
        checked_parameters = stepper.check_parameters(parameters)
        if present_run.binding.clocked:
            raise InputError("A simulation in scaled time keeps its parameters: -H at its start is "
                             "one of its numbers. Start another one from sim.start, by "
                             "step.start(sim.start, parameters=...).")
        warn_of_negative(checked_parameters)
        if not present_run.binding.has_finite_energy(
                present_run.binding.parameters(checked_parameters, self.t), present_run.q,
                present_run.p):
            raise InputError("H has no finite value at the present state with these parameters, as "
                             "of the root of a negative number or beyond the largest number; give "
                             "others.")
        # these alone can move the state off its constraints
        deciding = stepper.manifest.system.start_parameters
        if any(checked_parameters[name] != present_run.run.parameters[name] for name in deciding):
            refuse_inconsistent(present_run.binding, stepper.manifest,
                                replace(present_run.run, q=present_run.q, p=present_run.p,
                                        parameters=checked_parameters))
        with self._lock:
            present_run.set_parameters(checked_parameters)

    # ------------------------------------------------------------ copies

    def copy(self) -> Simulation:
        """Return another simulation at the same state, with the same past: it takes the same steps.
        """
        return _simulation(self._stepper, self._run.run, self._image(), self._records)

    __copy__ = copy

    def __deepcopy__(self, memo: dict[int, Any]) -> Simulation:
        return self.copy()

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the stepper's sources and the bytes of the memory."""
        return _unpickle, (self._stepper, self._stepper._provenance, self._run.run, self._image(),
                           self._records)

    @property
    def _records(self) -> bool:
        """Whether every state is kept."""
        return isinstance(self._run, RecordingRun)

    def _image(self) -> tuple[Any, ...]:
        """Return state and memory of the run between two steps."""
        with self._lock:
            return self._run.image

    # ------------------------------------------------------------ inside

    def _failure(self, status: int) -> StepFailed:
        """Return the error of the next step, which failed with ``status``, and its diagnosis.

        Its trajectory has the states that the simulation keeps: the last one, or all.
        """
        present_run, manifest, step_count = self._run, self._stepper.manifest, self.steps
        start, t = present_run.run, self.t
        # ``every`` beyond the number of steps: only the present state is a row
        run = replace(start, q=present_run.q.copy(), p=present_run.p.copy(),
                      t0=start.t0 + step_count * start.dt, steps=step_count + 1,
                      every=step_count + 2)
        diagnosis = diagnose(present_run.binding, manifest, run, status, run.q, run.p, t)
        return StepFailed(step=step_count + 1, t=float(t),
                          trajectory=present_run.trajectory(manifest), **asdict(diagnosis))


class _PresentState:
    """The state of a simulation, as its bodies and joints read it: arrays of one state."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation, self._run = simulation, simulation._run
        # Compiled code writes into these.
        coordinate_count = self._run.binding.shown
        self.q, self.p = self._run.q[:coordinate_count], self._run.p[:coordinate_count]
        self.manifest = simulation._stepper.manifest
        self.body, self.quantity = simulation.body, simulation.quantity
        self.quantities = tuple(self.manifest.system.quantities)

    @property
    def parameters(self) -> dict[str, Any]:
        """The parameters, as numbers."""
        return self._run.run.parameters

    def next_step(self) -> Trajectory:
        """Return the step that would follow; the simulation stays where it is."""
        present_run = self._run
        start = present_run.run
        run = replace(start, q=present_run.q.copy(), p=present_run.p.copy(),
                      t0=start.t0 + present_run.steps * start.dt, steps=1, every=1)
        return integrate(present_run.binding, self.manifest, run)


class _InputValues(FixedAttributes, MutableMapping[str, Any]):
    """The inputs of a simulation; to set one holds from its next step on."""

    _CURE = "set an input by its name, sim.input['NAME'] = 0.3"

    def __init__(self, simulation: Simulation) -> None:
        self._simulation = simulation
        self._names = simulation._run.binding.input_names

    def __contains__(self, name: object) -> bool:
        return name in self._names

    def __getitem__(self, name: str) -> Any:
        if name not in self._names:
            raise _no_input(name, self._names)
        return self._simulation._run.run.parameters[name]

    def get(self, name: str, default: Any = None) -> Any:
        """Return the value of an input, or another one where there is none."""
        return self[name] if name in self._names else default

    def __setitem__(self, name: str, value: Number) -> None:
        self._simulation._set_inputs({name: value})

    def __delitem__(self, name: str) -> None:
        raise InputError(f"Input {name!r} cannot be deleted: each step has a value of it; set it "
                         "to 0.")

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)

    def __repr__(self) -> str:
        return f"<inputs of {self._simulation!r}: {dict(self)}>"


def _no_input(name: Any, names: list[str]) -> InputError:
    """Return the refusal of a name that no input has, with the nearest name."""
    return InputError(f"{shown(name)} is no input of this system, which has "
                      f"{', '.join(names) or 'none'}{proposal(name, names)}.")


def _simulation(
    stepper: Stepper, run: RunArguments, image: tuple[Any, ...], record: bool
) -> Simulation:
    """Return a simulation in the state of another one, of which ``image`` has copies."""
    simulation = Simulation(stepper, run, record)
    simulation._run.image = image
    return simulation


def _unpickle(
    stepper: Stepper, provenance: dict[str, str], run: RunArguments, image: tuple[Any, ...],
    record: bool = False,
) -> Simulation:
    """Return a simulation from a pickle; refuse the memory of other code.

    ``provenance`` names source, compiler and CPU of the process that pickled it: the layout of the
    memory, and the bits of a step, depend on them.
    """
    own_provenance = stepper._provenance
    differs = [name for name in own_provenance if own_provenance[name] != provenance.get(name)]
    if differs:
        raise InputError(
            f"The simulation was pickled with another {' and another '.join(differs)}: what its "
            "memory holds means something else here. Pickle sim.t, sim.q and sim.p instead, and "
            "start from these.")
    return _simulation(stepper, run, image, record)


def _equal(a: Any, b: Any) -> bool:
    """Whether two arguments are equal and of one type; arrays, whose == is an array, never are."""
    return type(a) is type(b) and not isinstance(a, np.ndarray) and bool(a == b)


def _equal_numbers(a: Any, b: Mapping[str, Any]) -> bool:
    """Whether ``a`` is a dict with the keys of ``b`` and equal numbers of equal types."""
    return isinstance(a, dict) and a.keys() == b.keys() and all(_equal(a[k], b[k]) for k in b)
