"""Lyapunov exponents of a run by QR (Benettin et al., Meccanica 15, 1980), MEGNO, finite-time ones.

Directions V are taken along by the derivative of each step; after every r steps V = Q R, and the
exponents are the means of log R_ii over time. Q is orthonormal in the coordinates of
``unitary_frame``, and its columns begin as an isotropic flag. The derivative of a symplectic step
keeps both, so that R_ii and R_jj with i + j = 2 (n − m) + 1 are inverse to each other after any
time: exponents are pairs ± λ to round-off. In a Euclidean norm they are pairs but for a term c/t.

MEGNO is Y = (2/t) ∫ s d log|δ|, and its mean over time tends to 2 where a motion is regular, to
λ t/2 where it is chaotic (Cincotta, Simó, Astron. Astrophys. Suppl. 147, 2000). Covariant vectors
are found backwards through the stored R (Ginelli et al., Phys. Rev. Lett. 99, 130601, 2007).
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_flag, check_stepper, count_text, few
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.exact_numbers import Number
from ...core.html import card, table
from ...core.progress import Progress, as_progress, log_progress
from ...core.records import dataclass
from ...core.solver import Solver, SolverName
from ...core.start import HasStart
from ...core.warnings import warn
from ..bindings.array_checks import as_positive_count
from ..bindings.inputs import Inputs
from ..derivatives.kept_steps import linearisation_error, pieces, refuse_run
from ..integration.run_arguments import step_count
from ..integration.starts import merged_start
from .unitary_frame import UnitaryFrame, canonical_form, isotropic_flag

if TYPE_CHECKING:
    from ..derivatives.binding import KeptSteps
    from ..integration.run_arguments import RunArguments
    from ..steppers.stepper import Stepper

__all__ = ["Lyapunov", "lyapunov"]

#: Most blocks, and least, whose means give statistical errors.
_BLOCKS = 32, 4
#: Growth ratio of directions between two decompositions that leaves half of the digits.
_SPREAD = 1e8


@explain_arguments
@dataclass(frozen=True, eq=False)
class Lyapunov:
    """Lyapunov exponents of a run, with their statistical errors and running means.

    Attributes
    ----------
    exponents : array, shape (k,)
        Means of log R_ii over time, in 1/s, in the order of the directions: falling but for
        statistical errors.
    errors : array, shape (k,)
        Standard errors from means over blocks of time, the largest of 4, 8, 16 and 32 blocks; NaN
        with fewer than 4 decompositions.
    times : array, shape (rows,)
        Times since the start, |t − t0|, at each decomposition.
    running : array, shape (rows, k)
        The exponents up to each time.
    megno : float
        The mean over time of Y = (2/t) ∫ s d log|δ| of the first direction.
    running_megno : array, shape (rows,)
        The same up to each time.
    ftle : float
        log σ_max(Φ')/t at the end, in the kinetic metric made compatible with Ω: the largest
        growth rate of a direction, with ``count`` among the propagated directions only.
    running_ftle : array, shape (rows,)
    volume_rate : float
        ½ log(det(VᵀΩV)/det(V₀ᵀΩV₀))/t of all directions, in 1/s: the sum of all exponents, 0 for a
        Hamiltonian system; NaN with ``count``.
    symplectic_defect : float
        The largest change of Ω(v_i, v_j) between two decompositions in parts of |v_i||v_j|.
    covariant : array, shape (rows + 1, 2 n, k), or None
        Covariant Lyapunov vectors of the start and each row, of length 1 in the metric, with
        ``covariant=True``. Those near both ends have not converged.
    dt : number
    steps, every : int
    """

    exponents: Array
    errors: Array
    times: Array
    running: Array
    megno: float
    running_megno: Array
    ftle: float
    running_ftle: Array
    volume_rate: float
    symplectic_defect: float
    covariant: Array | None = field(repr=False)
    dt: Any
    steps: int
    every: int
    name: str

    @property
    def pairing(self) -> float:
        """The largest |λ_i + λ_j| of a pair, i + j = 2 (n − m) + 1; NaN with ``count``."""
        if np.isnan(self.volume_rate):
            return float("nan")
        return float(np.abs(self.exponents + self.exponents[::-1]).max())

    def __repr__(self) -> str:
        exponents = few(f"{value:.4g} ± {error:.1g}"
                        for value, error in zip(self.exponents, self.errors, strict=True))
        return (f"<Lyapunov of {self.name}: {exponents} /s over {self.times[-1]:.6g} s; MEGNO "
                f"{self.megno:.4g}>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the exponents, and MEGNO."""
        rows = [(f"λ{i}", f"{value:.6g}", f"{error:.2g}") for i, (value, error) in enumerate(
            zip(self.exponents, self.errors, strict=True), 1)]
        return card(f"Lyapunov exponents of {self.name}", table(
            [*rows, ("MEGNO", f"{self.megno:.4g}", "")], ("", "1/s", "standard error")))

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw the running exponents and MEGNO against time.

        Returns a matplotlib figure, which Jupyter shows, and writes it where a path is given.
        """
        from ..plotting.analysis_plots import draw_exponents  # matplotlib is optional

        return draw_exponents(self, path)


def lyapunov(
    stepper: Stepper, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *, dt: Number,
    t_end: Number | None = None, steps: int | None = None,
    parameters: Mapping[str, Number] | None = None,
    inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None, count: int | None = None,
    every: int = 10, solver: SolverName | Solver = "auto", covariant: bool = False,
    progress: Progress = None,
) -> Lyapunov:
    """Return the Lyapunov exponents of the run from a start, or from (q, p).

    λ_i = lim (1/t) Σ log R_ii. The directions are tangent to the constraints; there are
    2 (n − m) exponents.

    Parameters
    ----------
    start, p, dt, t_end, steps, parameters, inputs, solver
        As of ``Stepper.integrate``.
    count : int, optional
        How many exponents, from the largest on; all by default.
    every : int
        Steps between two QR decompositions.
    covariant : bool
        Compute covariant Lyapunov vectors too, backwards along the run: for k exponents
        2 n k + k² numbers are kept at each decomposition.
    progress : callable or bool, optional
        As of ``integrate``.

    Raises
    ------
    InputError
        For what ``integrate`` refuses, for a ``count`` beyond 2 (n − m), and for steps whose
        derivatives are not defined.
    StepFailed
        When a step finds no solution.

    Notes
    -----
    The arithmetic of exponents is in double, in steppers of wider types too. A stepper in a
    co-moving frame gives those of the motion in its frame, which are the same. At an unstable
    equilibrium the largest one is the growth rate beside it, which is no chaos.
    """
    check_stepper(stepper)
    state = merged_start(stepper, start, p, parameters)
    step_total = as_positive_count("steps", step_count(steps, t_end, state.t, dt), minimum=1)
    vector_count = _vector_count(stepper, count)
    with_covariant = as_flag("covariant", covariant)
    as_progress(progress)
    run = stepper._resolve(stepper._run_arguments(
        state, dt=dt, steps=step_total, every=every, inputs=inputs, solver=solver))
    refuse_run(run)
    stepper._warn(run)
    benettin = Benettin(stepper, run, vector_count, with_covariant)
    with log_progress(f"exponents of {stepper.name}", run.steps, progress) as report:
        for steps_so_far in benettin.advance():
            if report is not None:
                report(steps_so_far)
    return benettin.result()


def _vector_count(stepper: Stepper, count: int | None) -> int:
    """Return the number of exponents, by default the dimension of the tangent spaces."""
    size = 2 * (stepper.n - stepper.m)
    vector_count = size if count is None else as_positive_count("count", count, minimum=1)
    if not size:
        raise InputError(f"{stepper.name} has no exponents: it has as many constraints as "
                         "coordinates, so that nothing moves.")
    if vector_count > size:
        raise InputError(f"count = {vector_count} is more than the dimension 2 (n − m) = {size} of "
                         f"the tangent spaces of {stepper.name}; give at most {size}.")
    return vector_count


class Benettin:
    """Directions along a run, with a QR decomposition after every ``run.every`` steps.

    Attributes
    ----------
    frame : UnitaryFrame
        Coordinates of the directions at the last decomposition.
    unit, V : array, shapes (2 d, k) and (2 n, k)
        The directions after the last decomposition: their orthonormal coordinates in ``frame``; and
        as (dq, dp), which steps advance in place.
    full : bool
        Whether the directions span the tangent space, k = 2 d.
    ends, logs, largest : list
        At each decomposition: steps before it, log R_ii, and the logarithm of the largest singular
        value of the product of all R, which is ``product`` · e^``scale``.
    volume, defect, spread : float
        The logarithm of the change of volume, the largest change of Ω, and the largest ratio of
        growth factors so far.
    units, factors : list of array
        With ``covariant``, V and R of each decomposition.
    """

    def __init__(self, stepper: Stepper, run: RunArguments, count: int,
                 with_covariant: bool) -> None:
        """Begin with the first ``count`` directions of an isotropic flag at the start."""
        self.stepper, self.run, self.binding = stepper, run, stepper._derivative_binding()
        self.with_covariant, self._stored_run = with_covariant, self.binding.begin(run)
        self.frame = self._frame(step=0, q=run.q, p=run.p)
        self.unit = isotropic_flag(self.frame.J)[:, :count]
        self.full = count == len(self.frame.J)
        self.V = self._directions()
        self.start_volume = self._log_volume()
        self.ends: list[int] = []
        self.logs: list[Array] = []
        self.largest: list[float] = []
        self.product, self.scale, self.volume, self.defect = np.eye(count), 0.0, 0.0, 0.0
        self.spread = 1.0
        self.units, self.factors = [self.V.copy()], list[Array]()

    def advance(self) -> Iterator[int]:
        """Integrate the run with its directions, orthonormalised after every ``every`` steps.

        Yields the number of finished steps after each piece of the run, for the progress.
        """
        every = self.run.every
        for steps in pieces(self.stepper, self.run, self._stored_run):
            index = 0
            # up to the next decomposition, or to the end of the piece
            while index < steps.count:
                step = steps.first + index
                count = min(every - step % every, steps.count - index)
                self._propagate(_sub_steps(steps, index, count))
                index += count
                if (step + count) % every == 0 or step + count == self.run.steps:
                    self._decompose(step + count, steps.q[index], steps.p[index])
            yield steps.first + steps.count
        if self.spread > _SPREAD:
            warn(f"Between two decompositions directions grow {self.spread:.1e} times more than "
                 f"others, which leaves them fewer than half of their digits; give an every below "
                 f"{every}, a smaller dt, or a unit of time nearer to the motion's.")

    def _propagate(self, steps: KeptSteps) -> None:
        """Propagate the directions V by the derivatives of stored steps, in place."""
        derivative_module = self.binding.module
        # parameters and times stay, and no row of the tangents is stored on the way
        no_change, no_rows = derivative_module.new(self.binding.rows,
                                                   self.V.shape[1]), derivative_module.new(0)
        status = self.binding.integrate_tangent(
            self.run, self._stored_run.parameters, steps, no_change,
            every=steps.first + steps.count + 1, rows=no_rows, multipliers=no_rows,
            tangents=self.V)
        if status:
            raise linearisation_error(steps.first, status)

    def _decompose(self, step: int, q: Array, p: Array) -> None:
        """Replace the directions by an orthonormal basis of their span, and store log R_ii.

        c = Q R, shape (2 d, count), are the directions in unitary coordinates of the state q, p
        after ``step`` steps, where Ω is J. Raises InputError if they are not finite.
        """
        form_before = self.unit.T @ self.frame.J @ self.unit
        self.frame = self._frame(step, q, p)
        with np.errstate(all="ignore"):  # numbers that are not finite are refused
            c = self.frame.coordinates(self.V)
        if not np.isfinite(c).all():
            raise InputError(f"Directions are not finite after {count_text(step, 'step')}; give an "
                             "every below "
                             f"{self.run.every}, or a smaller dt.")
        self._measure_symplecticity(c, form_before)
        # LAPACK's R may have negative diagonal entries; growth factors are R_ii > 0.
        Q, R = np.linalg.qr(c)
        signs = np.where(np.diag(R) < 0, -1.0, 1.0)
        self.unit, R = Q * signs, R * signs[:, None]
        growth = np.diag(R)
        self.spread = max(self.spread, float(growth.max() / growth.min()))
        # The product of all R has the singular values of Φ'; its logarithm of size avoids overflow.
        self.product = R @ self.product
        size = float(np.linalg.norm(self.product, 2))
        self.product, self.scale = self.product / size, self.scale + float(np.log(size))
        self.ends.append(step)
        self.logs.append(np.log(growth))
        self.largest.append(self.scale)
        self.V = self._directions()
        if self.full:
            self.start_volume = self._log_volume()
        if self.with_covariant:
            self.units.append(self.V.copy())
            self.factors.append(R)

    def _measure_symplecticity(self, c: Array, form_before: Array) -> None:
        """Update the symplectic defect, and the volume's growth, by the present directions c.

        The defect is the largest |Ω(c_i, c_j) − Ω_ij|/(|c_i| |c_j|), 0 for a symplectic map, with
        Ω_ij of ``form_before``, of the same directions after the last decomposition.
        """
        sizes = np.linalg.norm(c, axis=0)
        change = c.T @ self.frame.J @ c - form_before
        self.defect = max(self.defect, float(np.abs(change / np.outer(sizes, sizes)).max()))
        if self.full:
            self.volume += self._log_volume() - self.start_volume

    def _frame(self, step: int, q: Array, p: Array) -> UnitaryFrame:
        """Return the unitary frame of the state after ``step`` steps."""
        # the state after the last step has the inputs of that step
        run = self.run.at_step(min(step, self.run.steps - 1))
        t = self.run.t0 + step * self.run.dt
        try:
            with np.errstate(all="ignore"):
                return UnitaryFrame(self.binding, run.parameters, t, q, p)
        except np.linalg.LinAlgError as error:
            raise InputError(f"The metric of the state after {count_text(step, 'step')} is not "
                             "finite: its "
                             "energy is no double; take other units, or fewer steps.") from error

    def _directions(self) -> Array:
        """Return the orthonormal directions (δq, δp) of now, shape (2 n, count)."""
        directions: Array = np.ascontiguousarray(
            self.binding.module.to_real(self.frame.directions(self.unit)))
        return directions

    def _log_volume(self) -> float:
        """Return ½ log|det(VᵀΩV)|, 0 where V does not span the space."""
        if not self.full:
            return 0.0
        V = self.V.astype(float)
        return float(np.linalg.slogdet(V.T @ canonical_form(self.binding.n) @ V)[1]) / 2

    def result(self) -> Lyapunov:
        """Return exponents, MEGNO and growth rates from the logarithms of R_ii.

            λ_i(t) = (1/t) Σ log R_ii
            Y(t) = (2/t) Σ (t_k − Δt_k/2) log R_11,   MEGNO(t) = (1/t) Σ (Y_{k−1} + Y_k)/2 Δt_k

        with the times t_k of the decompositions, the intervals Δt_k before them, and Y_0 = 0.
        """
        logs, dt = np.array(self.logs), abs(float(self.run.dt))
        times = np.array(self.ends) * dt
        # the last interval may be shorter than the others
        lengths = np.diff(times, prepend=0.0)
        running = np.cumsum(logs, axis=0) / times[:, None]
        Y = 2 * np.cumsum(logs[:, 0] * (times - lengths / 2)) / times
        megno = np.cumsum((Y + np.append(0.0, Y[:-1])) / 2 * lengths) / times
        ftle = np.array(self.largest) / times
        return Lyapunov(
            exponents=running[-1].copy(), errors=_errors(logs, lengths), times=times,
            running=running, megno=float(megno[-1]), running_megno=megno, ftle=float(ftle[-1]),
            running_ftle=ftle, volume_rate=self.volume / times[-1] if self.full else float("nan"),
            symplectic_defect=self.defect,
            covariant=self._covariant() if self.with_covariant else None, dt=self.run.dt,
            steps=self.run.steps, every=self.run.every, name=self.stepper.name)

    def _covariant(self) -> Array:
        """Return covariant vectors V_k C_k, backwards by C_k = R_{k+1}⁻¹ C_{k+1}, normalised."""
        # backwards C converges from any triangular matrix at the end
        C: Array = np.eye(self.unit.shape[1])
        vectors = [self.units[-1].astype(float) @ C]
        for V, R in zip(reversed(self.units[:-1]), reversed(self.factors), strict=True):
            C = np.linalg.solve(R, C)
            C /= np.linalg.norm(C, axis=0)
            vectors.append(V.astype(float) @ C)
        return np.array(vectors[::-1])


def _sub_steps(steps: KeptSteps, begin: int, count: int) -> KeptSteps:
    """Return ``count`` of the stored steps, from index ``begin`` on."""
    increments, states = slice(begin, begin + count), slice(begin, begin + count + 1)
    return replace(steps, first=steps.first + begin, q=steps.q[states], p=steps.p[states],
                   x=steps.x[increments])


def _errors(logs: Array, lengths: Array) -> Array:
    """Return the standard errors of Σ logs/Σ lengths, shape (count,), by means over blocks.

    ``logs`` has log R_ii of each interval, shape (intervals, count), ``lengths`` its duration in s,
    shape (intervals,). Of B equal blocks the error is the standard deviation of their means over
    √B; of B = 4, 8, 16, 32 the largest is taken, since blocks that are too short are correlated.
    """
    block_limit, fewest_blocks = _BLOCKS
    errors: Array = np.full(logs.shape[1], np.nan)
    blocks = fewest_blocks
    while blocks <= min(block_limit, len(logs)):
        edges = np.arange(blocks) * len(logs) // blocks
        means = np.add.reduceat(logs, edges) / np.add.reduceat(lengths, edges)[:, None]
        errors = np.fmax(errors, means.std(axis=0, ddof=1) / np.sqrt(blocks))
        blocks *= 2
    return errors
