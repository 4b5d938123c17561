"""Derivatives of a stepper: of one step, and of functions of a run."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_flag, as_mapping, choose, shown, unknown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.event import Event
from ...core.exact_numbers import Number
from ...core.incompatibilities import refuse_together
from ...core.records import dataclass
from ...core.registry import function_of
from ...core.solver import Solver, SolverName
from ...core.start import HasStart
from ..bindings.array_checks import as_numbers, as_real
from ..bindings.inputs import Inputs, as_inputs
from ..bindings.run_memory import DEFAULT_MEMORY
from ..compilation.stepper_module import load_module
from ..integration.run_arguments import Origin, StartNumbers, span_of
from ..integration.starts import after_start, merged_start
from ..results.outputs import full_states
from ..results.trajectory import Trajectory
from .evaluation import Evaluation

if TYPE_CHECKING:  # what calls of derivatives alone need is imported by them
    from ..derivatives.binding import DerivativeBinding
    from ..derivatives.gradient import Gradient
    from ..derivatives.kept_steps import SingleStep
    from ..derivatives.points import RunRows
    from ..derivatives.second_order import Hessian, SecondBinding, Slopes
    from ..derivatives.tangent_space import TangentSpace
    from ..integration.run_arguments import RunArguments

__all__ = ["Derive", "Differentiation"]


@dataclass(frozen=True)
class Derive:
    """How the files of a stepper with derivatives are made.

    Attributes
    ----------
    files : callable
        Returns header, source and manifest by their names; where the files are not known yet, with
        ``second=True`` those of second derivatives, with ``control=True`` those of profile control.
    portable : bool
        Whether another process can call it: it holds no system and no tableau of this one.
    known : bool
        Whether the files were derived before.
    further : Derive, optional
        What derives the others where those of derivatives are known.
    """

    files: Callable[..., dict[str, str]]
    portable: bool
    known: bool = False
    further: Derive | None = None

    @property
    def beyond_first(self) -> Derive | None:
        """Derivation of modules beyond first derivatives; None if it is no longer known."""
        return self.further if self.known else self


class Differentiation(Evaluation):
    """Methods of ``Stepper`` for derivatives; their module is compiled at the first use."""

    #: The name of each constraint.
    constraint_names: list[str]

    def __init__(self, name: str, files: dict[str, str], derive: Derive | None = None) -> None:
        """Begin without modules of derivatives: these are derived and compiled at the first call.
        """
        super().__init__(name, files)
        self._derive = derive
        self._first_order: DerivativeBinding | None = None
        self._second_order: SecondBinding | None = None
        self._controls: dict[str, str] = {}
        self._jumps: Any = None
        self._deriving = threading.Lock()
        self.constraint_names = list(self.manifest.system.constraint_names)

    def _derivative_binding(self) -> DerivativeBinding:
        """Calls of tangents and adjoints, derived and compiled when first called."""
        from ..derivatives.binding import DerivativeBinding, QuadDerivativeBinding

        with self._deriving:
            if self._first_order is None:
                module = load_module(self.name, self._derivative_files(), "derivatives")
                binding = self._bind(module)
                quad = self.manifest.real == "float128"
                kind = QuadDerivativeBinding if quad else DerivativeBinding
                self._first_order = kind(
                    binding, self.binding, self.manifest.scheme.keeps_momentum_constraint)
        return self._first_order

    def _derivative_files(self) -> dict[str, str]:
        """Return header, source and manifest with the derivatives of a step, file name → text.

        The first call derives them; ``_derive`` then carries the texts, so that they are derived
        once and are pickled with the stepper.
        """
        if self._derive is None:
            raise InputError(
                f"Stepper {self.name} was read from a file, or sent to this process before "
                "its derivatives were first used; make it with gyrospark.stepper(...).")
        files = self._derive.files()
        # ``files`` of the new one returns the texts; ``further`` derives what comes after them,
        # such as second derivatives
        self._derive = Derive(partial(dict, files), portable=True, known=True,
                              further=self._derive.beyond_first)
        return files

    def _more_files(self, subject: str, **kinds: bool) -> dict[str, str]:
        """Return the files of one further module, file name → text, derived now.

        ``kinds`` selects the module, as in ``second=True``; ``subject`` begins the relative clause
        of the error: "before its second derivatives were first used". Raises InputError for a
        stepper without a derivation.
        """
        derive = self._derive.beyond_first if self._derive is not None else None
        if derive is None:
            raise InputError(
                f"Stepper {self.name} was read from a file, or sent to this process before "
                f"{subject} first used; make it with gyrospark.stepper(...).")
        return derive.files(**kinds)

    def _second_binding(self) -> SecondBinding:
        """Calls of derivatives of adjoints, derived and compiled when first called."""
        from ..derivatives.second_order import SecondBinding

        first_order = self._derivative_binding()
        with self._deriving:
            if self._second_order is None:
                refuse_together(second=f"second derivatives of {self.name}",
                                frame=bool(self.symmetries) and "its co-moving frame")
                files = self._more_files("its second derivatives were", second=True)
                binding = self._bind(load_module(self.name, files, "second"))
                self._second_order = SecondBinding(binding, first_order)
        return self._second_order

    def _jump_binding(self) -> Callable[..., None]:
        """Return fill(parameters, t, *arrays), for derivatives of impulses and rates of gaps.

        Its C is derived and compiled at the first call.
        """
        with self._deriving:
            if self._jumps is None:
                # n differentiates φ_q and g_q again: its C is written with second derivatives
                files = self._more_files("derivatives of its impacts were", second=True)
                binding = self._bind(load_module(self.name, files, "jumps"))
                if not hasattr(binding.lib, f"{self.name}_impacts_by_state"):
                    raise InputError(
                        f"The gaps of {self.name} are too long for derivatives; use differences of "
                        "runs.")
                self._jumps = binding
        binding = self._jumps

        def fill(parameters: Any, t: Any, *arrays: Array) -> None:
            """Fill the arrays with the jump's derivatives; parameters are of the first module."""
            time = binding.new(1)
            time[0] = t
            binding.function("impacts_by_state")(
                # both modules declare this struct, as two types of cffi: an integer carries the
                # address across
                binding.ffi.cast(f"{self.name}_parameters *", int(
                    self._derivative_binding().module.ffi.cast("uintptr_t", parameters))),
                *map(binding.pointer, (time, *arrays)))

        return fill

    def _control_files(self) -> dict[str, str]:
        """Header, source and manifest of profile control, derived when first called."""
        with self._deriving:
            if not self._controls:
                self._controls.update(
                    self._more_files("its code for a card was", control=True))
        return self._controls

    def _portable_derive(self) -> Derive | None:
        """Return the picklable derivation for another process; None if there is none."""
        derive = self._derive
        if derive is None or not derive.portable:
            return None
        further = derive.further if derive.further and derive.further.portable else None
        return replace(derive, further=further)

    # ------------------------------------------------------------ one step

    def jvp(
        self, start: HasStart | ArrayLike, /, *direction: ArrayLike, dt: Number,
        parameters: Mapping[str, Number] | None = None, d: Mapping[str, Number] | None = None,
        inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None, project: bool = False,
    ) -> tuple[Array, Array, Array, Array]:
        """Return (q1, p1) of a step and its derivative (dq1, dp1) along a direction.

        ``jvp(start, dq, dp, dt=…)`` or ``jvp(q, p, dq, dp, dt=…)``. q1 and p1 have the shape (n,),
        dq1 and dp1 the shape of dq.

        Parameters
        ----------
        start, q, p, dt, parameters, inputs
            As of ``step``.
        dq, dp : array_like, shape (n,) or (n, k)
            Directions of the start, tangent to the constraints.
        d : mapping of str to number, optional
            The direction of parameters, inputs, "dt" and "t0"; 0 of those left out. Parameters and
            times that move the constraints move the start too, by the derivative of
            ``consistent``.
        project : bool
            Project (dq, dp) onto the tangent space, instead of refusing what leaves it.

        Raises
        ------
        InputError
            For a direction off the constraints, naming the constraint, and for unknown names.
        StepFailed
            As the step does.
        """
        p, dq, dp = after_start("dq, dp", direction)
        run = self._single(start, p, dt, parameters, inputs)
        n = self.n
        shape = as_numbers("dq", dq).shape
        # one direction as vectors, or k of them as columns
        flat = len(shape) == 1
        as_flag("project", project)
        dz = self._direction(dq, dp, d, shape[1] if len(shape) == 2 else 1)
        single_step, space = self._kept_step(run)
        if not project:
            space.refuse_off(dz[: 2 * n])
        directions = single_step.tangent(space.project(dz))
        directions = directions[:, 0] if flat else directions
        return single_step.end[:n], single_step.end[n:], directions[:n], directions[n:]

    def vjp(
        self, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *, dt: Number,
        parameters: Mapping[str, Number] | None = None, wrt: str | Sequence[str] | None = None,
        inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None,
    ) -> tuple[Array, Array, Callable[..., Gradient]]:
        """Return (q1, p1) of a step, and a function that takes cotangents of them backwards.

        ``back(wq, wp)`` is a ``Gradient``: the transposed derivative of the step applied to
        (wq, wp). ``back(wq, wp, multipliers)`` has the cotangent of the step's multipliers in
        addition, in their shape. ``wrt`` is as of ``gradient``; the others are as of ``step``.

        Raises
        ------
        InputError
            For an unusable or inconsistent start, unknown names, cotangents of another shape.
        StepFailed
            As the step does.
        """
        from ..derivatives.gradient import Gradient, names_of
        from ..derivatives.kept_steps import multiplier_shape

        run = self._single(start, p, dt, parameters, inputs)
        names = names_of(self, wrt)  # type: ignore[arg-type]
        single_step, space = self._kept_step(run)
        binding, n = self._derivative_binding().module, self.n

        def back(wq: ArrayLike, wp: ArrayLike, multipliers: ArrayLike | None = None) -> Gradient:
            """Return the gradient by start and parameters from cotangents of the step's end."""
            w = np.concatenate([binding.array("wq", wq, (n,)), binding.array("wp", wp, (n,))])
            forces = None if multipliers is None else binding.array(
                "multipliers", multipliers,
                multiplier_shape(self)).ravel()  # type: ignore[arg-type]
            return Gradient.of_cotangent(space, single_step.adjoint(w, forces), names)

        return single_step.end[:n], single_step.end[n:], back

    def hvp(
        self, start: HasStart | ArrayLike, /, *directions: ArrayLike, dt: Number,
        parameters: Mapping[str, Number] | None = None, d: Mapping[str, Number] | None = None,
        inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None, project: bool = False,
    ) -> Gradient:
        """Return the derivative of Φ'(z)ᵀ (wq, wp), the cotangents of ``vjp``, along a direction.

        ``hvp(start, dq, dp, wq, wp, dt=…)`` or ``hvp(q, p, dq, dp, wq, wp, dt=…)`` returns
        Σ_a w_a ∇²Φ_a v, where Φ(q, p; θ, Δt, t0) is a step from a start that is projected onto the
        constraints. Exact, as ``vjp`` is.

        Parameters
        ----------
        start, q, p, dq, dp, dt, parameters, d, inputs, project
            As of ``jvp``, with one direction.
        wq, wp : array_like, shape (n,)
            The cotangent of the end.

        Raises
        ------
        InputError
            As of ``jvp``; for systems that have no second derivatives.
        """
        from ..derivatives.gradient import Gradient, names_of
        from ..derivatives.second_order import step_slope

        p, dq, dp, wq, wp = after_start("dq, dp, wq, wp", directions)
        run = self._single(start, p, dt, parameters, inputs)
        binding, n = self._derivative_binding().module, self.n
        single_step, space = self._kept_step(run)
        dz = self._direction(dq, dp, d, 1)[:, 0].copy()
        if not as_flag("project", project):
            space.refuse_off(dz[: 2 * n, None])
        w = np.concatenate([binding.array("wq", wq, (n,)), binding.array("wp", wp, (n,))])
        stepper: Any = self  # a ``Stepper``, of which this class is a base
        slope = step_slope(stepper, run, space, single_step.end, single_step.unknowns,
                           np.ascontiguousarray(space.project(dz[:, None])[:, 0]), w)
        labels = [*binding.parameter_names, "dt", "t0"]
        # inputs of one step are parameters of the module
        columns = [2 * n + labels.index(u) for u in binding.input_names]
        numbers = dict(zip(labels, slope[2 * n :].tolist(), strict=True))
        return Gradient(value=None, q=slope[:n].copy(), p=slope[n : 2 * n].copy(),
                        _normals=space.normals, inputs=slope[columns][None],
                        wrt=names_of(stepper, wrt=None), _numbers=numbers)

    def _direction(
        self, dq: ArrayLike, dp: ArrayLike, d: Mapping[str, Number] | None, count: int
    ) -> Array:
        """Return directions with all rows (q, p, parameters, dt, t0), shape (rows, count).

        ``dq`` and ``dp`` have shape (n,), for count = 1, or (n, count). ``d`` has the slopes of
        parameters, dt and t0 by name, equal in all columns; names without an entry have slope 0.
        """
        binding, n = self._derivative_binding(), self.n
        derivatives = binding.module
        dz: Array = derivatives.new(binding.rows, count)
        for block, (name, x) in enumerate((("dq", dq), ("dp", dp))):
            columns = as_numbers(name, x)
            dz[block * n : (block + 1) * n] = derivatives.array(
                name, columns[:, None] if columns.ndim == 1 else columns, (n, count))
        names = [*derivatives.parameter_names, "dt", "t0"]
        for name, slope in as_mapping("d", {} if d is None else d, "{'m': 1.0}").items():
            if name not in names:
                raise unknown("name in d", name, names)
            dz[2 * n + names.index(name)] = as_real(f"d[{name!r}]", slope, derivatives.number)
        return dz

    def _single(self, start: Any, p: Any, dt: Number, parameters: Any, inputs: Any) -> RunArguments:
        """Return a checked run of one step, whose inputs are among its parameters.

        The derivatives by inputs are then derivatives by parameters.
        """
        state = merged_start(self, start, p, parameters)
        values = dict(as_mapping("parameters", state.parameters, "{'m': 1.0}"))
        if inputs is not None:  # one step: they are parameters
            input_rows = as_inputs(inputs, self.binding, 1)
            values |= {} if input_rows is None else input_rows.first
        return self._run_of(replace(state, parameters=values), dt=dt, steps=1)

    def _run_of(self, start: StartNumbers, **options: Any) -> RunArguments:
        """Return a checked run from a start; ``Stepper`` has it."""
        raise NotImplementedError

    def _kept_step(self, run: RunArguments) -> tuple[SingleStep, TangentSpace]:
        """Return the solved step of ``run``, and the tangent space at its start."""
        from ..derivatives.kept_steps import SingleStep
        from ..derivatives.tangent_space import TangentSpace

        stepper: Any = self
        single_step = SingleStep(stepper, run)
        return single_step, TangentSpace(self._derivative_binding(), single_step.parameters, run.q,
                                         run.p,
                                         self.constraint_names)

    # ------------------------------------------------------------ runs

    def gradient(
        self, run: Trajectory, cotangents: Mapping[str, ArrayLike] | None = None, *,
        loss: Callable[[Trajectory], tuple[Any, Mapping[str, ArrayLike]]] | None = None,
        wrt: str | Sequence[str] | None = None, memory: str = DEFAULT_MEMORY,
        solver: SolverName = "auto",
    ) -> Gradient:
        """Return the gradient of a function of a run, by the adjoint of its steps.

        Parameters
        ----------
        run : Trajectory
            A run that this stepper integrated, or that was read from its file. Its steps are
            repeated.
        cotangents : mapping
            "q" and "p": derivatives of the function by the rows of the run, shape (rows, n), or
            (n,) for the last one alone; "t": by their times, (rows,), or a number. "multipliers":
            by those of the run, in their shape, or by those of the last row. "events": the
            same of crossings, {"x": {"t": ..., "q": ..., "p": ...}}. The last row of a run that a
            terminal event ended moves with the event.
        loss : callable, optional
            In place of ``cotangents``: a function of the trajectory that returns its value and
            cotangents; or an expression of SymPy in coordinates, momenta, time and parameters by
            their names, which is summed over the stored states.
        wrt : str or sequence of str, optional
            Among "start" (coordinates of the tangent space), "q", "p", parameters, "dt", "t0",
            "inputs"; by default the start and all parameters. It orders ``Gradient.vector``.
        memory : str
            Bytes that the stored steps may take, such as "256 MB"; a longer run stores checkpoints,
            and its pieces are repeated. "none" runs backwards in time and stores nothing, and
            refuses a gradient where this does not lead back to the start.
        solver : {"auto", "newton", "fixed-point"}
            Solver of the run.

        Returns
        -------
        Gradient
            Parameters that move the constraints move the start too: see ``consistent``.

        Raises
        ------
        InputError
            For unknown names, with the nearest; for cotangents of another shape; for too little
            memory, with how much is needed.
        """
        from ..derivatives.gradient import cotangents_of, gradient_of, names_of

        stepper: Any = self
        names = names_of(stepper, wrt)
        value, cotangents = _value_and_cotangents(run, cotangents, loss)
        rows_by_kind = self._rows_by_kind(run, solver)
        # The end of the repeated run is compared with the last row, if this is the end of a step:
        # it may be an event or a time within a step, and a run at ``t_eval`` may have no rows.
        q, p = full_states(run)
        end = None if rows_by_kind.points or not len(q) else (q[-1], p[-1])
        return gradient_of(stepper, rows_by_kind.run,
                           cotangents_of(stepper, rows_by_kind, cotangents), names, memory, value,
                           end)

    def hessian(
        self, run: Trajectory, cotangents: Mapping[str, ArrayLike] | None = None, *,
        loss: Any = None, slopes: Slopes | None = None, wrt: str | Sequence[str] | None = None,
        memory: str = DEFAULT_MEMORY, solver: SolverName = "auto",
    ) -> Hessian:
        """Return the second derivatives of a function of a run, exact as its gradient is.

        Each column is the derivative of the adjoint along a direction; docs/derivatives.md has its
        cost.

        Parameters
        ----------
        run, cotangents, loss, wrt, memory, solver
            As of ``gradient``. ``wrt`` may not name "q", "p" or "inputs", and the function may not
            depend on events or on states within steps. All steps are kept in memory.
        slopes : callable, optional
            The second derivatives of the function by the states of the run. For directions
            {"q": (rows, n), "p": (rows, n), "t": (rows,), "parameters": {name: number}} it returns
            the changes of the cotangents, in their form. None where they do not change, as for a
            function that is linear in the states; an expression of SymPy in ``loss`` needs none.

        Returns
        -------
        Hessian

        Raises
        ------
        InputError
            As of ``gradient``; for systems that have no second derivatives: those of a Lagrangian,
            in a co-moving frame, or of more than 28 coordinates.
        """
        from ..derivatives.gradient import cotangents_of, names_of
        from ..derivatives.second_order import hessian_of

        stepper: Any = self
        names = names_of(stepper, wrt)
        self._refuse_scaled(second="second derivatives")
        has_impacts = isinstance(run, Trajectory) and run.report.impacts > 0
        refuse_together(second="second derivatives",
                        impacts=has_impacts and "a run with impacts")
        value, cotangents = _value_and_cotangents(run, cotangents, loss)
        if hasattr(loss, "free_symbols") and slopes is None:
            slopes = function_of("generator.systems.run_functions", "slopes_over_states")(loss, run)
        rows_by_kind = self._rows_by_kind(run, solver)
        # checks cotangents of stored states as ``gradient`` checks them
        checked = partial(cotangents_of, stepper, rows_by_kind)
        return hessian_of(stepper, rows_by_kind.run, checked(cotangents), slopes, checked, names,
                          memory, value)

    def _rows_by_kind(self, run: Trajectory, solver: SolverName = "auto") -> RunRows:
        """Return the run of the whole steps of a trajectory, with its rows sorted by their kinds.

        A trajectory that was read from a file has no arguments: they are its first row and its
        number of steps.
        """
        from ..derivatives.points import SAME_STEP, rows_of
        from ..integration.dense_output import refuse_forgotten, refuse_of_another

        choose("solver", solver, ["auto", "newton", "fixed-point"])
        if not isinstance(run, Trajectory):
            raise InputError(f"run = {shown(run)} is no trajectory; give what integrate returned.")
        refuse_of_another(self, run)  # type: ignore[arg-type]
        origin: Origin | None = run._origin
        if run.report.impacts and not (run._laws if origin is None else origin.impacts):
            raise InputError("The laws of this trajectory's impacts are not in its file, which an "
                             "earlier version wrote; integrate again for derivatives.")
        if origin is None:
            refuse_forgotten(self, run)  # type: ignore[arg-type]
            # a file has times, and no number of whole steps; a part of one may follow them
            steps = int(float(run.elapsed[-1] / run.dt) + SAME_STEP)
            arguments = self._run_of(
                StartNumbers(run.q[0], run.p[0], dict(run.parameters), run.t[0], run[0]._excess),
                dt=run.dt, steps=steps, every=run.every, inputs=run._inputs, solver=solver,
                scaled=True)
        else:
            arguments = origin.run if solver == "auto" else replace(origin.run, solver=solver)
        return rows_of(self, run, arguments)  # type: ignore[arg-type]

    def value_and_gradient(
        self, loss: Callable[[Trajectory], tuple[Any, Mapping[str, ArrayLike]]],
        start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *, wrt: str | Sequence[str],
        dt: Number, t_end: Number | None = None, steps: int | None = None,
        parameters: Mapping[str, Number] | None = None,
        inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None, every: int = 1,
        t_eval: ArrayLike | None = None, events: Event | Sequence[Event] = (),
        solver: SolverName | Solver = "auto", memory: str = DEFAULT_MEMORY,
    ) -> Callable[[ArrayLike], tuple[float, Array]]:
        """Return f(x) → (loss, gradient), for ``scipy.optimize.minimize(f, x0, jac=True)``.

        Parameters
        ----------
        loss : callable
            A function of the trajectory that returns its value and cotangents, as of ``gradient``.
        start, p, dt, t_end, steps, parameters, inputs, every, t_eval, events, solver
            As of ``integrate``: what x does not replace. The part "start" of x has 2 (n − m)
            numbers y in z = consistent(z0 + B y), where B is the basis at (q, p). The
            derivative of consistent is a difference of fourth order where it moves a state.
            γ and α that are left out are the means of the moments at the start, for every x.
        wrt : sequence of str
            The parts of x in their order, among "start", "inputs" (all rows, row by row),
            parameters, "dt", "t0".

        Returns
        -------
        callable
            f(x) → (loss, gradient), x and gradient of shape (N,): a run, and its adjoint.

        Raises
        ------
        InputError
            For unknown names, with the nearest, and what ``integrate`` refuses; from f for an x of
            another length, and a loss that returns no value and cotangents.
        StepFailed
            From f, when a step finds no solution.
        """
        from ..derivatives.gradient import names_of
        from ..derivatives.value_and_gradient import Objective

        stepper: Any = self
        state = merged_start(self, start, p, parameters)
        count, remainder = span_of(steps, t_end, state.t, dt)
        return Objective(
            stepper, loss, state, names_of(stepper, wrt), dt,
            {"t_end": t_end} if remainder else {"steps": count}, inputs, memory,
            {"every": every, "t_eval": t_eval, "events": events, "solver": solver})


def _value_and_cotangents(run: Trajectory, cotangents: Any, loss: Any) -> tuple[Any, Any]:
    """Return f and its cotangents ∂f/∂x, by the names of the arrays x of the run.

    Either ``cotangents`` are given, and f is None, or ``loss`` computes both from the run.
    """
    from ..derivatives.gradient import loss_of, value_of

    if (cotangents is None) == (loss is None):
        raise InputError("Give either cotangents or loss.")
    return (None, cotangents) if loss is None else value_of(loss_of(loss), run)
