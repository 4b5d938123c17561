"""A compiled stepper: steps, trajectories, ensembles, and what a step solves, from Python."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import GyrosparkError, InputError
from ...exact import Number
from ...naming import choose
from ...projection import Projection, project, report
from ...real import REALS, RealName
from ..build.manifest import read_manifest, remarks_of
from ..build.module import load_module, provenance
from ..call.binding import REASONS, SOLVERS, Binding, SolverName
from ..call.checks import as_callback, as_positive_count, as_real, as_step
from ..call.compiled_constraints import CompiledConstraints
from ..choice.gamma_choice import with_choice
from .consistency import defects_of_starts
from .ensemble import Ensemble, integrate_members
from .held import Held
from .integration import Run, integrate
from .parameters import as_parameters
from .trajectory import Trajectory

__all__ = ["SOLVERS", "Stepper"]

Array = NDArray[Any]


class Stepper:
    """A stepper compiled from generated C.

    Make one with ``gyrospark.stepper(...)``. Instances may be used from many threads at once; all
    they hold between calls is, for each thread, the trajectory that ``step`` goes on with.

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
    remarks : list of str
        What a tableau of your own lacks: symplecticity, symmetry, sweeps, the order its weights
        would allow; and where H or forces switch, as |x| does at 0. Empty for what lacks nothing.
    """

    def __init__(self, name: str, files: dict[str, str]) -> None:
        self.name = name
        self.files = dict(files)
        self.manifest = read_manifest(name, files)
        module = load_module(name, files)
        self.binding = _binding_type(self.manifest["real"])(module, name, self.manifest)
        self.n, self.m = self.binding.n, self.binding.m
        self.unknowns = self.binding.unknowns
        self.order = int(self.manifest["scheme"]["order"])
        self.remarks = [remark for _, remark in remarks_of(self.manifest)]
        self.parameter_domains: dict[str, str] = self.manifest["system"]["parameters"]
        self._local = threading.local()

    def __repr__(self) -> str:
        return f"<Stepper {self.name}: order {self.order}, {self.unknowns} unknowns>"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by sources: another process, or another machine, compiles them or has them."""
        return _stepper_of, (self.name, tuple(sorted(self.files.items())))

    @property
    def provenance(self) -> dict[str, str]:
        """What the bits of a result depend on beside its arguments: source, compiler, CPU."""
        return provenance(self.files)

    # ------------------------------------------------------------ stepping

    def step(
        self,
        q: ArrayLike,
        p: ArrayLike,
        *,
        dt: Number,
        parameters: Mapping[str, Any],
        t0: Number = 0.0,
        solver: SolverName = "auto",
        tolerance: Number | None = None,
        max_iterations: int = 50,
    ) -> tuple[Array, Array]:
        """Return (q, p) one step of ``dt`` seconds later; see ``integrate``.

        A call that is given what the last one in this thread returned, and the rest as before
        (``t0`` one ``dt`` on, where the system depends on time), goes on where that ended: a loop
        of calls gives the bits of ``integrate``, and costs as few sweeps.
        """
        given = (dt, solver, tolerance, max_iterations, parameters)
        held: Held | None = getattr(self._local, "held", None)
        self._local.held = None
        if held is None or not held.goes_on(q, p, t0, given):
            run = self.checked_run(q, p, dt=dt, steps=1, every=1, parameters=parameters, t0=t0,
                                   solver=solver, tolerance=tolerance,
                                   max_iterations=max_iterations)
            held = Held(self.binding, run, given) if solver != "python" else None
        if held is None or held.advance():
            run = run if held is None else held.run_from(q, p, t0)
            end = integrate(self.binding, self.manifest, run)  # says why, if it fails again
            return end.q[-1], end.p[-1]
        self._local.held = held
        return held.state

    def integrate(
        self,
        q: ArrayLike,
        p: ArrayLike,
        *,
        dt: Number,
        steps: int,
        parameters: Mapping[str, Any],
        t0: Number = 0.0,
        every: int = 1,
        solver: SolverName = "auto",
        tolerance: Number | None = None,
        max_iterations: int = 50,
        progress: Callable[[int], None] | None = None,
    ) -> Trajectory:
        """Integrate ``steps`` steps of ``dt`` seconds from (q, p).

        Parameters
        ----------
        q, p : array_like, shape (n,)
            Consistent start: g(q) = 0 and g_q H_p = 0 (for a body |q| = 1 and qᵀp = 0).
        dt : float
            Time step; negative integrates backwards. As ``t0`` and the parameters, a real number
            of any type, rounded once to the stepper's own: with ``real="float128"`` mpmath
            numbers, ``Decimal("0.1")`` and ``Fraction(1, 3)`` keep 34 digits, and a Python float
            is the binary number that it holds.
        steps : int
            Number of steps, 0 or more.
        parameters : mapping
            Exactly the parameters in ``parameter_domains``. For ``gamma`` or ``alpha``, ``"m"``,
            ``"h"``, ``"mt"`` and ``"ht"`` are the means of the moments beside it; ``"auto"`` is
            replaced by what ``gyrospark.choose_gamma`` finds for this start and dt,
            ``"auto-energy"`` by the same with its aim at the energy. ``Trajectory.parameters`` has
            the number.
        t0 : float
            Time at the start, in seconds: for forces and quantities that depend on time. Step k
            starts at t0 + k dt, counted, not summed up.
        every : int
            Store every so many steps, and the last.
        solver : {"auto", "newton", "fixed-point", "python"}
            ``auto`` sweeps (fixed point with a Schur correction of the multipliers) from values
            predicted out of the past steps, and takes a step with Newton where sweeps do not
            converge; ``fixed-point`` sweeps only; ``newton`` is full Newton in C from a constant
            guess, ``python`` the same driven from Python.
        tolerance : float, optional
            Bound on the last increment relative to the state; by default down to round-off.
        max_iterations : int
            Iterations (of each kind) before a step counts as failed.
        progress : callable, optional
            Called now and then with the number of steps done.

        Raises
        ------
        InputError
            For unusable arguments; an inconsistent start is refused with its defect.
        StepFailed
            When a step finds no solution; carries everything before it.
        Stopped
            After Ctrl-C, as a ``KeyboardInterrupt`` that carries everything computed until then.
        """
        parameters = with_choice(self, q, p, dt=dt, steps=steps, parameters=parameters,
                                 t0=t0)
        run = self.checked_run(q, p, dt=dt, steps=steps, every=every, parameters=parameters, t0=t0,
                               solver=solver, tolerance=tolerance, max_iterations=max_iterations)
        return integrate(self.binding, self.manifest, run, as_callback("progress", progress))

    def integrate_ensemble(
        self,
        q: ArrayLike,
        p: ArrayLike,
        *,
        dt: Number | ArrayLike,
        steps: int,
        parameters: Mapping[str, Any] | Sequence[Mapping[str, Number]],
        t0: Number | ArrayLike = 0.0,
        every: int = 1,
        solver: SolverName = "auto",
        tolerance: Number | None = None,
        max_iterations: int = 50,
        workers: int | None = None,
    ) -> Ensemble:
        """Integrate many trajectories; the leading axis of q, p is the trajectory.

        ``dt``, ``t0`` and each parameter are one number for all, or one for each trajectory; a
        list of dicts does as well. A trajectory that fails is NaN from its failed step on and has
        its reason in ``Ensemble.failures``; the others are not touched.

        With solvers ``auto`` and ``fixed-point`` trajectories run side by side in the lanes of a
        vector register, batches of them on ``workers`` threads (default: all cores). What a
        trajectory gives does not depend on its neighbours; it may differ by round-off from
        ``integrate``, which puts the stages of one step into lanes.

        Ctrl-C raises ``Stopped``, a ``KeyboardInterrupt`` that carries what is computed until then.
        """
        choose("solver", solver, SOLVERS)
        return integrate_members(
            self, q, p, dt, t0, parameters, workers,
            steps=steps, every=every, solver=solver, tolerance=tolerance,
            max_iterations=max_iterations,
        )

    # ------------------------------------------------------------ what a step solves

    def residual(
        self, x: ArrayLike, q: ArrayLike, p: ArrayLike, *, dt: Number,
        parameters: Mapping[str, Number], t: Number = 0.0,
    ) -> Array:
        """Return r(x), shape (unknowns,): (B.1) for SPARK, (53) or (61) for IMS and EMS.

        ``t`` is the time at the start of the step.
        """
        unknowns, state, run = self._at(x, q, p, dt, parameters, t)
        return self.binding.residual(run, self._step(dt), *state, unknowns, self.binding.work())

    def jacobian(
        self, x: ArrayLike, q: ArrayLike, p: ArrayLike, *, dt: Number,
        parameters: Mapping[str, Number], t: Number = 0.0,
    ) -> Array:
        """Return ∂r/∂x, shape (unknowns, unknowns)."""
        unknowns, state, run = self._at(x, q, p, dt, parameters, t)
        return self.binding.jacobian(run, self._step(dt), *state, unknowns, self.binding.work())

    def guess(
        self, q: ArrayLike, p: ArrayLike, *, dt: Number, parameters: Mapping[str, Number],
        t: Number = 0.0,
    ) -> Array:
        """Return the x from which a step's iteration starts."""
        state, run = self._state(q, p), self._parameters(parameters, t)
        x = self.binding.guess(run, self._step(dt), *state, self.binding.work())
        return x + self._origin(*state)

    # ------------------------------------------------------------ about a state

    def energy(self, q: ArrayLike, p: ArrayLike, *, parameters: Mapping[str, Number]) -> Array:
        """Return H(q, p) in the stepper's own representation; leading axes are kept."""
        shape, q_rows, p_rows = self._state_rows(q, p)
        H = self.binding.hamiltonian(self._parameters(parameters), q_rows, p_rows)
        return H.reshape(shape)

    def quantities(
        self, q: ArrayLike, p: ArrayLike, *, parameters: Mapping[str, Number],
        t: Number | ArrayLike = 0.0,
    ) -> dict[str, Array]:
        """Return each quantity of the system at states (q, p); leading axes are kept.

        ``t`` is one time for all states, or one for each.
        """
        shape, q_rows, p_rows = self._state_rows(q, p)
        times = self.binding.numbers("t", t)
        if times.shape not in ((), shape):
            raise InputError(f"t has shape {times.shape}; give one time, or shape {shape}.")
        t_rows = self._cast(np.broadcast_to(times, shape)).reshape(-1)
        values = self.binding.quantities(self._parameters(parameters), t_rows, q_rows, p_rows)
        return {name: values[:, i].reshape(shape)
                for i, name in enumerate(self.binding.quantity_names)}

    def defects(
        self, q: ArrayLike, p: ArrayLike, *, parameters: Mapping[str, Number]
    ) -> tuple[Array, Array]:
        """Return g(q) and the constraint on the momenta (qᵀp for a body), m entries each."""
        q_one, p_one = self._state(q, p)
        g, f = self.binding.defects(self._parameters(parameters), q_one[None], p_one[None])
        return g[0], f[0]

    def project(
        self, q: ArrayLike, p: ArrayLike, *, parameters: Mapping[str, Number]
    ) -> tuple[Array, Array]:
        """Return the state moved onto the constraints: q/|q| and p without its part along q.

        In general q moves along g_qᵀ onto g = 0, then p along g_qᵀ onto g_q H_p = 0.
        """
        state, run = self._state(q, p), self._parameters(parameters)
        return self._projected(*state, run)

    def consistent(
        self, q: ArrayLike, p: ArrayLike, *, parameters: Mapping[str, Number]
    ) -> Projection:
        """Return what ``project`` does, with a report of what was moved.

        The report's numbers are floats: |g| and the momentum constraint before and after by the
        constraints' names, and the coordinate and the momentum that moved furthest. To print it
        is to read it.

        Raises
        ------
        InputError
            Where it cannot be done, with the names of the constraints that are in the way.
        """
        old, run = self._state(q, p), self._parameters(parameters)
        new = self._projected(*old, run)
        numeric = CompiledConstraints(self.binding, self.manifest, run)
        states = np.stack([old[0], new[0], new[0]]), np.stack([old[1], old[1], new[1]])
        g, f = self.binding.defects(run, *map(np.ascontiguousarray, states))
        return report(numeric, old, new, (g[0], g[1]), (f[1], f[2]))

    def _projected(self, q: Array, p: Array, parameters: Any) -> tuple[Array, Array]:
        """Return the projected state: by compiled code, else by damped steps from Python."""
        q_near, p_near = q.copy(), p.copy()
        status = self.binding.project(parameters, q_near, p_near)
        if not status:
            return q_near, p_near
        if self.binding.dtype is not np.float64:
            raise GyrosparkError(
                f"The state {q}, {p} cannot be projected: {REASONS[status]}; give a nearer one."
            )
        with np.errstate(all="ignore"):
            made = project(CompiledConstraints(self.binding, self.manifest, parameters), q, p)
        return made.q, made.p

    # ------------------------------------------------------------ inside

    def _state(self, q: ArrayLike, p: ArrayLike) -> tuple[Array, Array]:
        as_array = self.binding.array
        return as_array("q", q, (self.n,)), as_array("p", p, (self.n,))

    def _state_rows(
        self, q: ArrayLike, p: ArrayLike
    ) -> tuple[tuple[int, ...], Array, Array]:
        """Return the leading axes of q and p, and both as rows of the stepper's own type."""
        q_rows, p_rows = self.binding.numbers("q", q), self.binding.numbers("p", p)
        shape = q_rows.shape
        if shape[-1:] != (self.n,) or p_rows.shape != shape:
            raise InputError(f"q and p have shapes {shape} and {p_rows.shape}; "
                             f"give (..., {self.n}) for both.")
        q_rows, p_rows = (self._cast(a).reshape(-1, self.n) for a in (q_rows, p_rows))
        return shape[:-1], q_rows, p_rows

    def _cast(self, numbers: Array) -> Array:
        """Return a copy in the stepper's own type; what is beyond its range is infinite."""
        return self.binding.converted(numbers)

    def _step(self, dt: Number) -> Any:
        return as_step(dt, self.binding.number)

    def _parameters(self, given: Mapping[str, Number], t: Number = 0.0) -> Any:
        number = self.binding.number
        return self.binding.parameters(as_parameters(given, self.parameter_domains, number),
                                       as_real("t", t, number))

    def _at(
        self, x: ArrayLike, q: ArrayLike, p: ArrayLike, dt: Number,
        parameters: Mapping[str, Number], t: Number,
    ) -> tuple[Array, tuple[Array, Array], Any]:
        self._step(dt)
        state = self._state(q, p)
        unknowns = self.binding.array("x", x, (self.unknowns,)) - self._origin(*state)
        return unknowns, state, self._parameters(parameters, t)

    def _origin(self, q: Array, p: Array) -> Array:
        """Return what the compiled code leaves out of x: IMS and EMS solve for increments."""
        origin = self.binding.new(self.unknowns)
        if self.manifest["scheme"]["unknowns_are_state"]:
            origin[: 2 * self.n] = np.concatenate([q, p])
        return origin

    def checked_run(
        self, q: ArrayLike, p: ArrayLike, *, dt: Number, steps: int, every: int,
        parameters: Mapping[str, Any], solver: SolverName, tolerance: Number | None,
        max_iterations: int, t0: Number = 0.0,
    ) -> Run:
        """Return the arguments of ``integrate`` as a run, or raise InputError."""
        run = self._run(q, p, dt, steps, every, parameters, solver, tolerance, max_iterations, t0)
        with np.errstate(over="ignore", invalid="ignore"):  # the steps judge what is not finite
            self._refuse_inconsistent(run)
        return run

    def _run(
        self, q: ArrayLike, p: ArrayLike, dt: Number, steps: int, every: int,
        parameters: Mapping[str, Any], solver: SolverName, tolerance: Number | None,
        max_iterations: int, t0: Number,
    ) -> Run:
        choose("solver", solver, SOLVERS)
        if solver == "fixed-point" and not self.binding.lanes:
            raise InputError(f"{self.name} has no solver fixed-point: "
                             f"{self.manifest['fast_path']['reason']}; choose auto or newton.")
        number = self.binding.number
        bound = None if tolerance is None else as_real("tolerance", tolerance, number)
        if bound is not None and bound <= 0:
            raise InputError(f"tolerance = {tolerance} is not positive; give none for round-off.")
        return Run(
            *self._state(q, p),
            self._step(dt),
            as_positive_count("steps", steps),
            as_positive_count("every", every, least=1),
            as_parameters(parameters, self.parameter_domains, number),
            solver,
            bound,
            as_positive_count("max_iterations", max_iterations, least=1),
            as_real("t0", t0, number),
        )

    def _refuse_inconsistent(self, run: Run) -> None:
        """Refuse a start that is off the constraints by more than round-off."""
        if not self.m:
            return
        parameters = self.binding.parameters(run.parameters, run.t0)
        found = defects_of_starts(
            self.binding, self.manifest["scheme"]["keeps_momentum_constraint"], parameters,
            run.q[None], run.p[None], np.array([run.dt]))
        g, f, g_bound, f_bound = (float(x[0]) for x in (found.g, found.f, found.g_bound,
                                                        found.f_bound))
        if not found.consistent[0]:
            q_size = float(np.linalg.norm(run.q.astype(float)))
            norm = f", |q| = {q_size:.15g}" if self.manifest["system"]["rigid_body"] else ""
            what = "q^T p" if self.manifest["system"]["rigid_body"] else "the momentum constraint"
            raise InputError(
                f"The start is off the constraints: |g(q)| = {g:.3e}{norm}, {what} = {f:.3e} "
                f"(allowed {g_bound:.1e} and {f_bound:.1e}). "
                "`q, p = stepper.project(q, p, parameters=...)` moves it onto them."
            )


@lru_cache(maxsize=64)
def _stepper_of(name: str, files: tuple[tuple[str, str], ...]) -> Stepper:
    """Return the stepper of these sources: the same one to all that ask in a process."""
    return Stepper(name, dict(files))


def _binding_type(real: RealName) -> type[Binding]:
    """Return the class for a floating-point type; only float128 costs the import of mpmath."""
    if not REALS[real].in_mpmath:
        return Binding
    from ..call.quad_binding import QuadBinding

    return QuadBinding
