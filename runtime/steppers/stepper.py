"""A compiled stepper: steps, trajectories and ensembles from Python."""

from __future__ import annotations

import os
import textwrap
import threading
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_flag, as_mapping, count_text, few
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.event import Event, Impact, as_events, as_impacts
from ...core.exact_numbers import Number, Numbers
from ...core.html import card, table
from ...core.incompatibilities import refuse_together
from ...core.progress import Progress, log_progress
from ...core.records import replace_fields
from ...core.registry import function_of
from ...core.solver import AUTO, Solver, SolverName, as_solver
from ...core.start import HasStart
from ..bindings.array_checks import as_positive_count, as_real
from ..bindings.binding import SOLVERS, Binding
from ..bindings.inputs import InputRows, Inputs, as_inputs
from ..compilation.stepper_module import load_module, provenance
from ..integration.call_memory import CallMemory
from ..integration.consistency import (
    refuse_inconsistent,
    refuse_singular_mass,
    refuse_undefined_energy,
)
from ..integration.linear_frequency import warn_of_frequency
from ..integration.run_arguments import (
    OPEN,
    Integration,
    Origin,
    RunArguments,
    StartNumbers,
    end_of_run,
    has_searches,
    in_scaled_time,
    span_of,
    warn_of_late_start,
    warn_of_negative,
)
from ..integration.starts import (
    Span,
    events_or_own,
    merged_start,
    merged_starts,
    span_or_own,
    steps_of_all,
)
from ..integration.step_loop import FIRST_STEPS, ChunkSize, integrate
from ..results.missed_rates import warn_of_missed_rate
from ..results.rotation_rate import Rotations
from ..results.trajectory import Trajectory
from .differentiation import Derive
from .dynamics import Dynamics
from .simulation import ContinuedStep, Simulation

if TYPE_CHECKING:  # what a run of steps alone does not need is imported by the calls that do
    from ..derivatives.tangent_space import Tangents
    from ..devices.ensemble import DeviceName
    from .ensemble import Ensemble

__all__ = ["SOLVERS", "Stepper", "stepper_of"]

#: Characters of H that notebooks show.
_LONGEST = 300
#: The progress of a run too short to show it.
_QUIET = nullcontext()


@explain_arguments
class Stepper(Dynamics):
    """A stepper compiled from generated C.

    Make one with ``gyrospark.stepper(...)``. Instances may be used from many threads at once; all
    they hold between calls is, for each thread, the trajectory that ``step`` continues, and the
    checked arguments of the last call.

    Attributes
    ----------
    name : str
        E.g. ``heavy_top_gl3_gamma``.
    n, m : int
        Coordinates and constraints.
    unknowns : int
        Length of x in ``residual`` and ``jacobian``: for SPARK (B.2), k_1..k_s, k̂_1..k̂_s,
        Λ_0..Λ_{p−1}; for IMS and EMS q_k, p_k, λ.
    order : int
        Order of convergence, as derived by the generator.
    manifest : dict
        All that the generator says of the stepper.
    symmetries : tuple of Symmetry, with name, A, J and condition
        Symmetries along which a co-moving frame may move.
    warnings : list of str
        Properties that a tableau of your own lacks: symplecticity, symmetry, fixed-point iteration,
        the order that its weights allow; and where H or forces switch, as |x| does at 0.
    """

    order: int
    warnings: list[str]
    #: The largest rotation in a step, which integrations warn of.
    rotations: Rotations

    def __init__(self, name: str, files: dict[str, str], derive: Derive | None = None) -> None:
        """Load the module of ``files``; ``derive`` generates further C when it is first needed."""
        super().__init__(name, files, derive)
        self.order = int(self.manifest.scheme.order)
        self.warnings = [text for _, text in self.manifest.warnings]
        self.rotations = Rotations(self.manifest)
        self._local = threading.local()
        self._memory = CallMemory()
        self._impacts: Binding | None = None

    def __repr__(self) -> str:
        unknowns = count_text(self.unknowns, "unknown")
        return f"<Stepper {self.name}: order {self.order}, {unknowns}>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: method, system, and the arguments of a run."""
        system, scheme = self.manifest.system, self.manifest.scheme
        domains = self.parameter_domains.items()
        velocity_constraints = count_text(self.binding.rows, "velocity constraint")
        rows = [("method", f"{scheme.method}, order {self.order}, "
                 + count_text(self.unknowns, "unknown")),
                ("system", f"{system.name}: {count_text(self.n, 'coordinate')}, "
                 + count_text(self.m, "constraint")
                 + f", {velocity_constraints}" * bool(self.binding.rows)),
                ("H", textwrap.shorten(str(system.hamiltonian), _LONGEST, placeholder=" …")),
                ("parameters", few(name if domain == "real" else f"{name} ({domain})"
                                   for name, domain in domains)),
                *((label, few(names)) for label, names in (
                    ("inputs", self.binding.input_names), ("bodies", system.bodies),
                    ("joints", system.joints),
                    ("quantities", system.quantities),
                    ("frame", [s.name for s in self.symmetries])) if names),
                ("numbers", self.manifest.real), *(("note", text) for text in self.warnings)]
        return card(f"Stepper {self.name}", table(rows))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by sources: another process, or another machine, compiles them or has them."""
        return stepper_of, (self.name, tuple(sorted(self.files.items())), self._portable_derive())

    @property
    def _provenance(self) -> dict[str, str]:
        """Source, compiler and CPU, on which the bits of a result depend beside its arguments."""
        return provenance(self.files)

    # ------------------------------------------------------------ stepping

    def step(
        self,
        start: HasStart | ArrayLike,
        p: ArrayLike | None = None,
        /,
        *,
        dt: Number,
        parameters: Mapping[str, Number] | None = None,
        inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None,
        solver: SolverName | Solver = "auto",
    ) -> tuple[Array, Array]:
        """Return (q, p) one step of ``dt`` seconds later, from a start or (q, p).

        ``inputs`` hold in this step alone.

        If a call starts at the state that the last call in this thread returned (where the system
        depends on time, one ``dt`` later), with the other arguments unchanged, the solver's memory
        persists: a loop of calls gives the bits of ``integrate``, and costs as few iterations.

        Raises
        ------
        InputError
            For unusable arguments and an inconsistent start; in scaled time, and for a start with
            impacts, which single steps do not take.
        StepFailed
            When the step finds no solution.
        """
        state = merged_start(self, start, p, parameters)
        input_rows = as_inputs(inputs, self.binding, 1)
        if input_rows is not None:
            # inputs among the parameters have no effect beside ``inputs``, and are not compared
            parameter_values = as_mapping("parameters", state.parameters, example="{'m': 1.0}")
            state = replace_fields(state, parameters={
                name: value for name, value in parameter_values.items()
                if name not in self.binding.input_names})
        step = self._continued_step(state, dt, solver, input_rows)
        if input_rows is not None:
            step.feed(input_rows.at(0))
        if step.advance(1):
            # it has failed: without the memory of earlier steps it may succeed, else the error
            # raised here has the reason
            run = step.run_from(state.q, state.p, state.t).with_inputs(input_rows)
            end = integrate(self.binding, self.manifest, run)
            return end.q[-1], end.p[-1]
        self._local.previous_step = step
        return step.q.copy(), step.p.copy()

    def _continued_step(
        self, state: StartNumbers, dt: Number, solver: Any, input_rows: InputRows | None
    ) -> ContinuedStep:
        """Return the step of this thread's last call if ``state`` continues it, else a new one.

        Threads share a stepper, and not the memory of its solver. Until the step has succeeded the
        thread has none: a step that fails leaves no memory to go on from.
        """
        # the names of inputs are compared too: a call without them does not hold the last ones
        arguments = (dt, solver, input_rows is None, state.parameters)
        previous_step: ContinuedStep | None = getattr(self._local, "previous_step", None)
        self._local.previous_step = None
        if previous_step is not None and previous_step.continues(
                state.q, state.p, state.t, arguments):
            return previous_step
        run = self._checked_run(self._run_arguments(
            state, dt=dt, steps=1, inputs=input_rows, solver=solver))
        self._warn(run)
        # work memory that a step has used needs no initialisation
        work = None if previous_step is None else previous_step.work
        return ContinuedStep(self.binding, run, arguments, work)

    def start(
        self,
        start: HasStart | ArrayLike,
        p: ArrayLike | None = None,
        /,
        *,
        dt: Number | None = None,
        dtau: Number | None = None,
        parameters: Mapping[str, Number] | None = None,
        solver: SolverName | Solver = "auto",
        record: bool = False,
    ) -> Simulation:
        """Return a simulation from a start, or from (q, p), that is advanced by its caller.

        The arguments are those of ``integrate``.
        ``sim.advance(10)`` takes ten steps of ``dt``; ``sim.t``, ``sim.q``, ``sim.p``,
        ``sim.report`` and ``sim.quantity(name)`` are the state after them. It is, to the bit, the
        state of ``integrate`` after as many steps, into however many calls they are divided. With
        ``record=True`` every state is kept, and ``sim.trajectory`` is what ``integrate`` returns,
        with the inputs that ``advance`` was given.

        Raises
        ------
        InputError
            As ``integrate`` does.
        """
        # as those of ``integrate``, with no t_end, 0 steps and every = 1
        call_arguments = (dt, dtau, None, 0, 1, solver)
        plan = self._memory.recall(self, start, p, call_arguments, parameters)
        if plan is not None:
            return Simulation(self, plan.run, as_flag("record", record))
        method = as_solver(solver)
        state = merged_start(self, start, p, parameters)
        run = self._resolve(self._run_arguments(
            state, dt=span_or_own(self.binding, start, Span(dt, dtau))[0], steps=0, solver=method,
            scaled=True))
        self._memory.keep(self, start, call_arguments, parameters, state, Integration(run))
        self._warn(run)
        return Simulation(self, run, as_flag("record", record))

    @overload
    def integrate(
        self, start: HasStart, /, *, dt: Number | None = None, dtau: Number | None = None,
        t_end: Number | None = None,
        steps: int | None = None, parameters: Mapping[str, Number] | None = None,
        inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None, every: int = 1,
        t_eval: ArrayLike | None = None,
        events: Event | Impact | Sequence[Event | Impact] | None = None,
        tangents: Tangents | None = None, solver: SolverName | Solver = "auto",
        out: str | os.PathLike[str] | None = None, progress: Progress = None,
    ) -> Trajectory: ...

    @overload
    def integrate(
        self, q: ArrayLike, p: ArrayLike, /, *, dt: Number | None = None,
        dtau: Number | None = None, t_end: Number | None = None, steps: int | None = None,
        parameters: Mapping[str, Number] | None = None,
        inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None, every: int = 1,
        t_eval: ArrayLike | None = None,
        events: Event | Impact | Sequence[Event | Impact] | None = None,
        tangents: Tangents | None = None, solver: SolverName | Solver = "auto",
        out: str | os.PathLike[str] | None = None, progress: Progress = None,
    ) -> Trajectory: ...

    def integrate(
        self,
        start: HasStart | ArrayLike,
        p: ArrayLike | None = None,
        /,
        *,
        dt: Number | None = None,
        dtau: Number | None = None,
        t_end: Number | None = None,
        steps: int | None = None,
        parameters: Mapping[str, Number] | None = None,
        inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None,
        every: int = 1,
        t_eval: ArrayLike | None = None,
        events: Event | Impact | Sequence[Event | Impact] | None = None,
        tangents: Tangents | None = None,
        solver: SolverName | Solver = "auto",
        out: str | os.PathLike[str] | None = None,
        progress: Progress = None,
    ) -> Trajectory:
        """Integrate from a start up to the time ``t_end``, or ``steps`` steps of ``dt`` seconds.

        Parameters
        ----------
        start : Start, or array_like of shape (n,)
            A model, a problem, a ``Start``, a row of a trajectory, a simulation; or the
            coordinates q at t = 0, followed by p. It is consistent: g(q) = 0 and g_q H_p = 0 (for
            a body |q| = 1 and qᵀp = 0). The start of a model or a problem is moved there, with a
            warning where this is more than round-off.
        p : array_like, shape (n,), optional
            The momenta, where the first argument is q.
        dt : float, optional
            Time step; negative integrates backwards; by default that of a model. As the parameters
            and the time of a start, a real number of any type, rounded once to the stepper's own:
            with ``real="float128"`` mpmath numbers, ``Decimal("0.1")`` and ``Fraction(1, 3)`` keep
            34 digits, and a Python float is the binary number that it holds. ``gyrospark.tune``
            finds the step for an error.
        dtau : float
            In place of ``dt``, of a system with a ``time_scale`` σ: the constant step of τ, of
            which t takes steps ∫σ dτ.
        t_end : float, optional
            Time of the last state. Step k starts at t0 + k dt, counted, not summed up; where t_end
            lies between two steps, the last one is a real step of a part of Δt, and a longer run
            goes on from ``Trajectory.grid_end``, the state of the last whole step.
        steps : int, optional
            Number of steps, 0 or more, in place of ``t_end``; by default that of a model.
        parameters : mapping, optional
            Values that win over those of the start; together all of ``parameter_domains``, and
            rates of ``symmetries`` if wanted. Where ``gamma`` or ``alpha`` is left out it is the
            mean γ_m of the moments beside it, or by the rule of the model; rates that are left out
            are 0, or of a model with a frame the least squares of its start. ``gyrospark.tune``
            searches both; ``Trajectory.parameters`` has the numbers.
        inputs : mapping or array_like, optional
            The system's inputs, which are constant within a step: by name, a number or one for
            each step; or an array with a column for each, shape (steps, inputs) or (inputs,).
            ``gs.Inputs(rows, hold=4)`` holds each row for several steps. By default the inputs of
            the start, or those among the parameters, for the whole run.
        every : int
            Store every so many steps, and the last.
        t_eval : array_like, shape (N,), optional
            Return the states at these times instead, each by a real step of a part of Δt: see
            ``Trajectory.at``. They lie between the start and the end of the run, in any order. If
            an event or an impact ends the run, later times are left out.
        events : Event, or a list of them, optional
            Where a quantity crosses a level: in ``Trajectory.events`` by name. By default those of
            a model; ``()`` looks for none. Every step is looked at, stored or not; a crossing is
            solved for by short real steps, to some units in the last place of its time. A terminal
            event ends the run: its state is the last row, behind the stored ones. Or impacts,
            ``gs.Impact("gap", restitution=0.8)``: there the momenta jump, and the run continues on
            its grid; see ``Trajectory.impacts``. Those of a model stay unless others are given.
        tangents : Tangents, optional
            Directions whose derivatives are computed along the run: ``Trajectory.tangents``, at
            ``t_eval``, at events and in the last row of a terminal one too. A row at a given time
            moves with dt and the start's time by its part of a step alone.
        solver : {"auto", "newton", "fixed-point"} or Solver
            How the equations of a step are solved; ``gs.Solver`` adds tolerance and iterations.
        out : path, optional
            A Zarr store, ``"night.zarr"``, to which states are streamed while the next ones are
            computed: memory stays constant, and the run is returned as a ``Trajectory`` whose
            arrays are read from it. After any interruption (a signal, ``kill -9``, a power cut, a
            full disk) the store is whole up to its last commit, a few seconds before, and
            ``gyrospark.resume`` continues it to the bits of an uninterrupted run. Not with
            ``t_eval``, ``tangents`` and inputs that change.
        progress : callable or bool, optional
            A function is called now and then with the number of steps done. True shows the share
            that is done, False does not; by default an interactive Python and a notebook show it
            after a second.

        Returns
        -------
        Trajectory
            The states of the start, of every ``every``-th step and of the last, or at ``t_eval``;
            its ``report`` has the errors and iterations of all steps.

        Raises
        ------
        InputError
            For unusable arguments; an inconsistent start is refused with its defect. If the store
            ``out`` exists.
        StorageError
            If the store cannot be written, or another process writes to it.
        StepFailed
            When a step finds no solution; carries everything before it.
        Stopped
            After Ctrl-C, as a ``KeyboardInterrupt`` that carries everything computed until then.
        """
        # a call that differs from the last one by its state alone has the arguments that were
        # checked there
        call_arguments, recalled = (dt, dtau, t_end, steps, every, solver), None
        if inputs is None and events is None:
            recalled = self._memory.recall(self, start, p, call_arguments, parameters)
        plan = recalled or self._integration(
            start, p, Span(dt, dtau, t_end, steps), parameters=parameters, inputs=inputs,
            every=every, events=events, solver=solver)
        if plan.impacts:
            from ..events.impact_observer import refuse_unusable

            refuse_unusable(self, plan.run, plan.impacts)
        if out is not None:
            refuse_together(stored="a stored run (out)", t_eval=t_eval is not None and "t_eval",
                            tangents=tangents is not None and "tangents")
            return self._record(plan, out, progress)
        trajectory = self._integrate_plan(plan, t_eval, progress, repeated=recalled is not None)
        if tangents is None:
            return trajectory
        from ..derivatives.tangent_run import with_tangents

        return with_tangents(self, tangents, trajectory)

    def _integrate_plan(
        self, plan: Integration, t_eval: ArrayLike | None, progress: Progress, *, repeated: bool
    ) -> Trajectory:
        """Return the trajectory of a plan: whole steps, a partial last step, states at ``t_eval``.

        The start of a ``repeated`` call has been checked for warnings by the call before.
        """
        run = plan.run
        observed_events: Any = plan.events
        if t_eval is not None:
            from ..integration.dense_output import stored_steps_at

            run = replace(run, stored_steps=stored_steps_at(self, run, t_eval, run.rest))
        # after a warning of the start there is none of stored states; none at all without steps
        start_warned = bool(run.steps) and not repeated and self._warn(run)
        trajectory = self._steps_of(plan, run, progress)
        # an open end, t_end in scaled time, is reached after as many steps as the trajectory has;
        # derivatives of the run repeat these
        run = run.until(trajectory.report.steps) if run.open_end else run
        if run.steps and run.rows > 1 and not start_warned:
            self._warn_of_motion(trajectory, run)
        if run.rest:
            from ..events.last_step import ended_between

            trajectory = ended_between(self, run, observed_events, trajectory)
        trajectory = trajectory.made_by(self, Origin(
            run, () if plan.impacts else observed_events, rest=run.rest, impacts=plan.impacts))
        if t_eval is None:
            return trajectory
        # the times were checked against all steps; a terminal event ends the run earlier, and so
        # does an impact after which a gap stays closed
        if plan.impacts or any(event.terminal and len(trajectory.events.get(event.name, ()))
                               for event in observed_events):
            from ..integration.dense_output import times_reached

            t_eval = times_reached(self, trajectory, t_eval)
        return self._at(trajectory, t_eval)

    def _steps_of(self, plan: Integration, run: RunArguments, progress: Progress) -> Trajectory:
        """Return the whole steps of a plan, with its events.

        ``run`` has the plan's arguments; its stored rows may be chosen by ``t_eval``.
        """
        # a plan with ``constants`` repeats an earlier call, whose chunks of steps serve again
        first = FIRST_STEPS if plan.constants is None else self._memory.chunk_steps
        # a run that ends before the first look at the clock shows no share that is done
        quiet = progress is None and run.steps <= first and not run.open_end
        with _QUIET if quiet else log_progress(
                f"integrating {self.name}", run.steps, progress) as report:
            if plan.events:
                from ..events.observer import integrate_observed

                return integrate_observed(self, run, plan.events, report, plan.end_event)
            pace = ChunkSize(first=first)
            trajectory = integrate(self.binding, self.manifest, run, report,
                                   constants=plan.constants, pace=pace)
            if plan.constants is not None:
                self._memory.chunk_steps = pace.most
            return trajectory

    def _warn_of_motion(self, trajectory: Trajectory, run: RunArguments) -> None:
        """Warn where a step turns a body too far, or does not follow a fast motion."""
        self.rotations.warn_of(trajectory)
        if self.binding.clocked:
            warn_of_missed_rate(trajectory)
        # where fixed-point iteration converged, ω Δt of the fastest mode is small
        if trajectory.report.newton_steps and run.solver == "auto" and not self.rotations.bodies:
            warn_of_frequency(self.binding, run, self.order)

    def integrate_ensemble(
        self,
        starts: HasStart | Sequence[HasStart] | ArrayLike,
        p: ArrayLike | None = None,
        /,
        *,
        dt: Number | ArrayLike | None = None,
        dtau: Number | ArrayLike | None = None,
        t_end: Number | None = None,
        steps: int | None = None,
        parameters: Mapping[str, Numbers] | Sequence[Mapping[str, Number]] | None = None,
        inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None,
        every: int = 1,
        events: Event | Impact | Sequence[Event | Impact] | None = None,
        tangents: Tangents | None = None,
        solver: SolverName | Solver = "auto",
        workers: int | None = None,
        device: DeviceName | None = None,
        progress: Progress = None,
    ) -> Ensemble:
        """Integrate many trajectories: from several starts, or from rows of q and p.

        With solvers ``auto`` and ``fixed-point`` they run side by side in the lanes of a vector
        register, in batches on threads. The bits of a trajectory do not depend on the others; they
        may differ by round-off from those of ``integrate``, which puts the stages of one step into
        lanes. The code of these lanes is compiled by the first call that needs it, and cached. With
        impacts, and with ``t_end`` in scaled time, each trajectory is integrated by itself, with
        the bits of ``integrate``.

        Parameters
        ----------
        starts : list of starts, Start, or array_like of shape (N, n)
            N starts; or one start, with a column of N numbers among its parameters, its times or
            in ``parameters``, or with q and p of shape (N, n); or rows of q, followed by p.
        p : array_like, shape (N, n), optional
            The momenta, where the first argument is q.
        dt : float or array_like, shape (N,), optional
            Time step in s, one for all or one for each; by default that of a model.
        dtau : float or array_like, shape (N,), optional
            In place of ``dt``, in scaled time: rows of equal number are at equal τ, and ``t``
            differs.
        t_end : float, optional
            Time of the last state of all trajectories, in s, which may lie between two steps; the
            numbers of whole steps must be equal. In scaled time they differ, and arrays are NaN
            after the end of a trajectory. With impacts it is the end of a whole step.
        steps : int, optional
            Number of steps, 0 or more, in place of ``t_end``; by default that of a model.
        parameters : mapping, or sequence of N mappings, optional
            Values that win over those of the starts, each one number for all or N numbers.
        inputs : mapping or array_like, optional
            Those of ``integrate`` for all, or with a leading axis: shape (N, steps) by name, or an
            array (N, steps, inputs).
        every : int
            Store every so many steps, and the last.
        events : Event or Impact, or a list of either, optional
            As of ``integrate``, in each trajectory; by default those of the model of the starts,
            ``()`` for none. Terminal events are refused.
        tangents : Tangents, optional
            Directions of each trajectory: ``Ensemble.tangents[i]`` has the bits of ``integrate``.
            Not with impacts.
        solver : {"auto", "newton", "fixed-point"} or Solver
            As of ``integrate``.
        workers : int, optional
            Threads, 1 or more; by default one for each core.
        device : {"cpu", "cuda"}, optional
            "cuda": each trajectory is a thread of an NVIDIA card, with the bits of profile control;
            docs/cuda.md has what a card refuses. By default arrays on a card are integrated there,
            and all others on the CPU.
        progress : callable or bool, optional
            As of ``integrate``; a function is called with the steps of all trajectories together.

        Returns
        -------
        Ensemble
            Arrays with the leading axis N, and each trajectory in ``members``; of arrays on a card
            a ``DeviceEnsemble`` of arrays of their library. A trajectory whose step fails is NaN
            from there on and has its reason in ``failures``; the others are not touched.

        Raises
        ------
        InputError
            For unusable arguments, among them columns of different lengths, starts with different
            events or impacts, and unequal numbers of steps.
        CompilerError
            If the code of the lanes is not compiled yet and there is no compiler.
        MissingDependencyError
            For ``device="cuda"`` without its packages.
        Stopped
            After Ctrl-C, as a ``KeyboardInterrupt`` that carries what is computed until then.
        """
        from .ensemble import EnsembleEnd, integrate_members

        dt, steps = span_or_own(self.binding, starts, Span(dt, dtau, t_end, steps))
        # in scaled time each run takes as many steps as it needs up to t_end; count = 1 stands for
        # them
        is_open = self.binding.clocked and steps is None and t_end is not None
        state = merged_starts(self, starts, p, parameters, impacts=True)
        events = events_or_own(starts, events)
        impacts = as_impacts(events, self.manifest.system.event_quantities, state.impacts)
        # last_parts: times from the last whole step to t_end, one for all or for each trajectory
        count, last_parts = (1, []) if is_open else steps_of_all(
            steps, t_end, state.t, dt, whole_steps=device is not None or bool(impacts))
        return integrate_members(
            # impacts, if there are any, take the place of events
            self, state, dt, workers, impacts or events, inputs, tangents, device, progress,
            EnsembleEnd(open_end=t_end if is_open else None,
                        last_part=(t_end, last_parts) if any(last_parts) else None),
            steps=count, every=every, solver=as_solver(solver))

    # ------------------------------------------------------------ inside

    def _integration(
        self, start: HasStart | ArrayLike, p: ArrayLike | None, span: Span, *,
        parameters: Mapping[str, Number] | None = None,
        inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None, every: int = 1,
        events: Event | Impact | Sequence[Event | Impact] | None = None,
        solver: SolverName | Solver = "auto",
    ) -> Integration:
        """Return the checked arguments of ``integrate``; searched parameters have numbers.

        ``span`` are dt, dtau, t_end and steps; the other arguments are those of ``integrate``. A
        call without inputs and events is kept: an equal call takes its arguments from there.
        """
        (dt, steps), t_end = span_or_own(self.binding, start, span), span.t_end
        has_default_events = events is None
        state = merged_start(self, start, p, parameters, impacts=True)
        events, names = events_or_own(start, events), self.manifest.system.event_quantities
        impacts = as_impacts(events, names, state.impacts)
        observed_events: Any = impacts or as_events(events, names)
        clock, end_event = self.manifest.system.clock, ""
        # in scaled time the number of steps to t_end is not known: an event at t_end ends the run
        if clock is not None and steps is None and t_end is not None:
            end = end_of_run(clock, observed_events, state.t, t_end, dt)
            observed_events, end_event = (*observed_events, end), end.name
            steps, t_end = OPEN, None
        count, remainder = span_of(steps, t_end, state.t, dt)
        # the part of a step at the end has a row of inputs of its own
        input_rows: Any = as_inputs(inputs, self.binding, count + 1) if remainder else inputs
        run = self._resolve(self._run_arguments(
            state, dt=dt, steps=count, every=every, inputs=input_rows, solver=as_solver(solver),
            scaled=True))
        number = self.binding.number
        end_time = {"t_end": as_real("t_end", t_end, number),
                    "rest": number(remainder)} if remainder else {}
        plan = Integration(replace_fields(run, open_end=bool(end_event), **end_time),
                           observed_events, impacts, end_event)
        if inputs is None and has_default_events:
            self._memory.keep(self, start, (*span, every, solver), parameters, state, plan)
        return plan

    def _record(
        self, plan: Integration, out: str | os.PathLike[str], progress: Progress = None, *,
        resume: bool = False,
    ) -> Trajectory:
        """Return a run streamed to the store ``out``; ``resume`` continues that of an old store."""
        inputs = plan.run.inputs
        # ``throughout`` has NaN, which is not equal to itself, for inputs of several values
        changing = inputs is not None and any(x != x for x in inputs.throughout.values())
        refuse_together(stored="a stored run (out)",
                        changing_inputs=changing and "inputs that change along the run",
                        open_end=plan.run.open_end and "t_end in scaled time")
        stored: Trajectory = function_of("storage.record", "record")(
            self, replace(plan.run, inputs=None), plan.events, out, resume=resume,
            progress=progress)
        return stored

    def _impact_binding(self) -> Binding:
        """Calls of runs with impacts, derived and compiled when first called."""
        with self._deriving:
            if self._impacts is None:
                module = load_module(self.name, self._derivative_files(), "impacts")
                self._impacts = self._bind(module)
        return self._impacts

    def _at(
        self, trajectory: Trajectory, times: ArrayLike, *, workers: int | None = None
    ) -> Trajectory:
        """Return the states of a run at times between its steps; see ``Trajectory.at``."""
        from ..derivatives.tangent_run import with_tangents
        from ..integration.dense_output import between

        states = between(self, trajectory, times, workers)
        # tangents are computed by the same run once more, which only ``_origin`` knows
        if trajectory.tangents is None or trajectory._origin is None:
            return states
        return with_tangents(self, trajectory.tangents, states)

    def _parameters_with_inputs(self, parameters: Any, inputs: Any) -> Any:
        """Return the parameters of one run or of many, with a number for each input.

        Without ``inputs`` none is added. ``parameters`` is a dict or a list of dicts; other
        arguments are returned unchanged, for the checks of the caller to refuse.
        """
        if inputs is None and type(parameters) is dict:
            return dict(parameters)
        # inputs that are not checked yet: any number serves, for the steps overwrite it
        first_inputs = inputs.first if isinstance(inputs, InputRows) else dict.fromkeys(
            self.binding.input_names if inputs is not None else (), 1.0)
        if isinstance(parameters, Mapping):
            return {**parameters, **first_inputs}
        if not first_inputs or not isinstance(parameters, Sequence):
            return parameters
        return [{**values, **first_inputs} if isinstance(values, Mapping) else values
                for values in parameters]

    def _run_arguments(
        self, start: StartNumbers, *, dt: Number, steps: int, every: int = 1,
        inputs: InputRows | Inputs | Mapping[str, Any] | ArrayLike | None = None,
        solver: SolverName | Solver = "auto", scaled: bool = False,
    ) -> RunArguments:
        """Return the arguments of ``integrate`` as a record, checked but for the parameters.

        Callers that are not ``scaled`` are refused scaled time. Raises InputError for any other
        argument that is unusable.
        """
        method = as_solver(solver)
        if method is not AUTO:
            self._refuse_solver(method)
        number = self.binding.number
        bound = None if method.tolerance is None else as_real("tolerance", method.tolerance, number)
        count = as_positive_count("steps", steps)
        input_rows = as_inputs(inputs, self.binding, count)
        q, p = self._state(start.q, start.p)
        step = self._step(dt, scaled=scaled)
        return replace_fields(  # the constructor of a frozen dataclass takes longer
            object.__new__(RunArguments), q=q, p=p, dt=step, steps=count,
            every=as_positive_count("every", every, minimum=1),
            parameters=self._parameters_with_inputs(start.parameters, input_rows),
            solver=method.kind,
            tolerance=bound, max_iterations=method.max_iterations,
            t0=as_real("t", start.t, number), inputs=input_rows,
            excess=start.excess if scaled else 0.0)

    def _refuse_solver(self, method: Solver) -> None:
        """Raise InputError for a solver that the steps do not have."""
        is_plain = method == Solver(method.kind)  # without a tolerance or iterations of its own
        refuse_together(
            splitting=not self.binding.solves and f"the scheme splitting of {self.name}",
            solver=method != AUTO and f"solver = {method.kind if is_plain else method!r}",
            fixed_point=method.kind == "fixed-point" and "solver = 'fixed-point'",
            newton_only=not self.binding.lanes
            and f"{self.name} ({self.manifest.fast_path.reason})")

    def _resolve(self, run: RunArguments) -> RunArguments:
        """Return a checked run, with numbers for γ and other parameters that a search finds."""
        if has_searches(run.parameters):
            from ..tuning.tune import tuned_run

            run = tuned_run(self, run)
        return self._checked_run(run)

    def _checked_run(self, run: RunArguments) -> RunArguments:
        """Return a run with its parameters as numbers; its start must be consistent.

        Raises InputError if it is not. In scaled time its state has t and −H as further coordinate
        and momentum.
        """
        run = replace_fields(run, parameters=self.check_parameters(run.parameters))
        run = in_scaled_time(self.binding, run)
        if self.manifest.system.velocity_names:
            with np.errstate(over="ignore", invalid="ignore"):  # steps refuse what is not finite
                refuse_singular_mass(self.binding, self.manifest, run)
        refuse_inconsistent(self.binding, self.manifest, run)
        refuse_undefined_energy(self.binding, run)
        return run.with_inputs(run.inputs)

    def _run_of(self, start: StartNumbers, **options: Any) -> RunArguments:
        """Return a checked run from a start; ``options`` are those of ``_run_arguments``."""
        return self._resolve(self._run_arguments(start, **options))

    def _run(self, run: RunArguments) -> Trajectory:
        """Return the trajectory of a checked run, without warnings and events: for pilot runs."""
        return integrate(self.binding, self.manifest, run)

    def _warn(self, run: RunArguments) -> bool:
        """Warn of γ below 0, of a late start, and where a body turns too far in a step.

        Return whether a warning of too large a rotation was given.
        """
        warn_of_negative(run.parameters)
        warn_of_late_start(self.binding, run.t0, run.dt, run.steps)
        dt = run.dt
        if self.binding.clocked and self.rotations.bodies:
            dt = dt * self.binding.time_scales(self.binding.parameters(run.parameters),
                                               run.q[None], run.p[None])[0]
        return self.rotations.warn(run.parameters, dt, run.q[None], run.p[None])


@lru_cache(maxsize=64)
def stepper_of(
    name: str, files: tuple[tuple[str, str], ...], derive: Derive | None = None
) -> Stepper:
    """Return the stepper of generated files, the same object for equal files in a process."""
    return Stepper(name, dict(files), derive)
