"""Periodic orbits of the discrete motion, z = Φ_h^N(z), by Newton's method in T(T*M).

Unknowns are y in z + B y, where B is a basis of the tangent space at z, the time step h unless the
period is fixed, and a parameter if one is free:

    Bᵀ (Φ_h^N(z) − z) = 0,   v·B y = 0,   c(z) = c(z_0)

with v the rate of change along the orbit, and c the fixed quantities, such as the energy. Lengths
are those of q/max|q| and p/max|p|, so that results do not depend on units; B is orthonormal in
these. Orbits of
a Hamiltonian system form families, whose members differ in energy and period; conservation of
energy makes one of these equations follow from the others. Symmetries add families. So each step is
the least squares solution of least norm, without singular values that are round-off of the
residual.

A symplectic map conserves no energy exactly, and instead of a family it has pairs of isolated
orbits, at two phases within a step. Between these |Φ_h^N(z) − z| is of the order e^(−c/h). If that
is below 1e-7, the iteration ends there; if it is larger, the phase v·B y is left free.

The monodromy matrix M = BᵀΦ' has the Floquet multipliers as its eigenvalues. For a Hamiltonian
system MᵀΩM = Ω, and 1 is a double eigenvalue with one eigenvector: half of its digits are lost.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_items, check_stepper, count_text, few, shown, unknown
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import GyrosparkError, InputError
from ...core.exact_numbers import Number
from ...core.html import card, table
from ...core.progress import Progress, log_progress
from ...core.records import dataclass
from ...core.start import HasStart, Start
from ..bindings.array_checks import as_positive_count
from ..derivatives.tangent_space import Tangents
from ..integration.run_arguments import StartNumbers
from ..integration.starts import merged_start
from .unitary_frame import canonical_form, tangent_projection

if TYPE_CHECKING:
    from ..results.tangent_rows import TangentRows
    from ..results.trajectory import Trajectory
    from ..steppers.stepper import Stepper

__all__ = ["PeriodicOrbit", "periodic_orbit"]

#: Singular values below this multiple of the relative residual, within bounds, are none.
_RESIDUAL_SHARE, _LEAST, _MOST = 10.0, 1e-12, 1e-3
#: Steps whose states are looked at for the sizes of q and p.
_SAMPLES = 64
#: An orbit is closed if its gap is below this many ε|z|; from this many ε|z|√steps on an iteration
#: may stagnate.
_CLOSED, _STAGNATED = 8, 64
#: Halvings of a Newton increment that makes the residual larger.
_HALVINGS = 6
#: Residuals below this part of a state may stagnate or grow.
_SMALL = 1e-7
#: From below this part on, the phase is left free where an iteration stagnates.
_NEAR = 1e-3
#: A state that moves by less than this part of it in a period does not move.
_STILL = 1e-6


@explain_arguments
@dataclass(frozen=True, eq=False)
class PeriodicOrbit:
    """A periodic orbit of a stepper: after ``steps`` steps of ``dt`` it is where it began.

    Attributes
    ----------
    q, p : array, shape (n,)
        A state of the orbit.
    dt : number
    steps : int
    parameters : dict
        With the value found, where one was free.
    t0 : number
        Time of the state, for what depends on it.
    multipliers : array of complex, shape (2 (n − m),)
        Floquet multipliers, the largest first.
    monodromy : array, shape (2 (n − m), 2 (n − m))
        The derivative of the map z → Φ_h^N(z) in the basis.
    basis : array, shape (2 n, 2 (n − m))
        Orthonormal basis of the tangent space at (q, p), rows q and p.
    symplectic_defect : float
        |MᵀωM − ω| in parts of |M|², with ω = BᵀΩB, where B is orthonormal in parts of the orbit.
    iterations : int
        Newton iterations.
    residuals : tuple of float
        |Φ_h^N(z) − z| at the start and after each of them, of q in parts of the largest |q| of the
        orbit, of p in parts of the largest |p|.
    """

    q: Array
    p: Array
    dt: Any
    steps: int
    parameters: dict[str, Any]
    t0: Any
    multipliers: Array
    monodromy: Array = field(repr=False)
    basis: Array = field(repr=False)
    symplectic_defect: float
    iterations: int
    residuals: tuple[float, ...]
    _stepper: Stepper = field(repr=False)

    @property
    def period(self) -> Any:
        """The time steps · dt of one revolution."""
        return self.steps * self.dt

    @property
    def _multiplier_texts(self) -> str:
        """The first multipliers as text; one text stands for a conjugate pair."""
        return few(_text(value) for value in self.multipliers if value.imag >= 0)

    def __repr__(self) -> str:
        return (f"<PeriodicOrbit of {self._stepper.name}: period {float(self.period):.12g} s, "
                f"{count_text(self.steps, 'step')}; multipliers {self._multiplier_texts}; closed "
                f"to {self.residuals[-1]:.1e} after {self.iterations} iterations>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the period, the multipliers and the last defect."""
        return card(f"Periodic orbit of {self._stepper.name}", table([
            ("period", f"{float(self.period):.12g} s"), ("steps", f"{self.steps:,}"),
            ("multipliers", self._multiplier_texts), ("defect", f"{self.residuals[-1]:.1e}")]))

    def run(self, periods: int = 1, every: int = 1) -> Trajectory:
        """Return the trajectory of this number of revolutions."""
        return self._stepper.integrate(
            Start(self.q, self.p, self.parameters, self.t0), dt=self.dt,
            steps=as_positive_count("periods", periods) * self.steps, every=every)

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw the coordinates over a period, and the multipliers beside the unit circle.

        Returns a matplotlib figure, which Jupyter shows, and writes it where a path is given.
        """
        from ..plotting.analysis_plots import draw_orbit  # matplotlib is optional

        return draw_orbit(self, path)


def periodic_orbit(
    stepper: Stepper, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *, dt: Number,
    steps: int, parameters: Mapping[str, Number] | None = None,
    fix: str | Sequence[str] | None = "energy", free: str | None = None, max_iterations: int = 20,
    progress: Progress = None,
) -> PeriodicOrbit:
    """Return the periodic orbit z = Φ_dt^N(z) near a start, with a period near N dt.

    Parameters
    ----------
    start, p
        As of ``Stepper.integrate``: a state near the orbit, on the constraints.
    dt : number
        The time step to begin with; it is solved for, unless the period is fixed.
    steps : int
        Steps N of a period.
    parameters : mapping
        As of ``Stepper.integrate``.
    fix : str, sequence of str, or None
        Which orbit of a family: "energy" keeps that of the start, "period" keeps dt, the name of a
        coordinate or momentum keeps its value. Two of them with ``free``. None where the orbit is
        isolated: limit cycles of systems with damping. A system that depends on time has the
        period of its driving force: "period".
    free : str, optional
        A parameter that is solved for too.
    max_iterations : int
        Newton iterations, each one run of N steps with tangents, and more where it is damped.
    progress : callable or bool, optional
        As of ``Stepper.integrate``; a function is called with the number of iterations done.

    Raises
    ------
    InputError
        For unusable arguments, with the allowed ones.
    GyrosparkError
        If Newton's method does not converge, with the gap reached, or comes to an equilibrium.
    StepFailed
        When a step at the start finds no solution.
    """
    check_stepper(stepper)
    search = OrbitSearch(stepper, merged_start(stepper, start, p, parameters), dt=dt,
                         steps=as_positive_count("steps", steps, minimum=1), fix=fix, free=free)
    limit = as_positive_count("max_iterations", max_iterations, minimum=1)
    with log_progress(f"closing an orbit of {stepper.name}", limit, progress) as report:
        return search.orbit(limit, report)


@dataclass(frozen=True)
class Guess:
    """A state z = (q, p), time step and parameters, with Φ_h^N(z) − z and tangents.

    ``units`` are the sizes of q and p in the orbit, an entry for each of z.
    """

    z: Array
    dt: Any
    parameters: dict[str, Any]
    gap: Array
    tangents: TangentRows
    units: Array

    @property
    def gap_size(self) -> float:
        """|Φ_h^N(z) − z| in ``units``."""
        return float(np.linalg.norm(self.gap.astype(float) / self.units))

    @property
    def state_size(self) -> float:
        """|z| in ``units``, of which gaps are parts; the least positive number where z = 0."""
        return max(float(np.linalg.norm(self.z.astype(float) / self.units)), 1e-300)


class _PeriodTangents(NamedTuple):
    """Derivatives of z(T) = Φ^N(z) in the units of a guess.

    B is an orthonormal basis, in these units, of the tangent space of the constraints at z.
    """

    end: Array  # Φ'B, shape (2 n, 2 (n − m))
    start: Array  # B, of the same shape
    by_step: Array  # ∂Φ^N/∂h, shape (2 n,)
    by_parameter: Array  # of z and of z(T) by the free parameter, by h without one; (2, 2 n)


class OrbitSearch:
    """Newton's method for one orbit."""

    def __init__(
        self, stepper: Stepper, start: StartNumbers, *, dt: Number, steps: int,
        fix: str | Sequence[str] | None, free: str | None,
    ) -> None:
        """Check the fixed and the free variables, and keep the starting values of the fixed ones.
        """
        run = stepper._resolve(stepper._run_arguments(start, dt=dt, steps=steps))
        self.stepper, self.steps, self.t0, self.free = stepper, steps, run.t0, free
        self.start = run
        self.time_dependent = stepper.binding.time is not None
        self.phase_fixed = not self.time_dependent
        self.fixed = _names_of_fixed(stepper, fix, time_dependent=self.time_dependent)
        if free is not None and not (
                isinstance(free, str) and free in stepper.parameter_domains):
            raise unknown("parameter", free, stepper.parameter_domains)
        z = np.concatenate([run.q, run.p])
        self.fixed_values = {name: self._value(name, z, run.parameters) for name in self.fixed
                             if name != "period"}
        self.epsilon = float(stepper.binding.epsilon)
        #: Of the first guess: sizes of q and p, and by name the changes of fixed quantities that
        #: count as large.
        self.units: Array | None = None
        self.fixed_scales: dict[str, float] = {}

    def orbit(
        self, iteration_limit: int, report: Callable[..., Any] | None = None
    ) -> PeriodicOrbit:
        """Return the orbit; ``report`` is called with the number of iterations so far.

        Where Newton's method stagnates close to an orbit with the phase fixed, the phase is left
        free. Raises GyrosparkError if it does not converge, or comes to an equilibrium.
        """
        start = self.start
        guess = self._evaluate(start.q, start.p, start.dt, dict(start.parameters))
        B = self._tangents(guess).start  # a basis of the tangent space
        for name, fixed_value in self.fixed_values.items():
            slope = float(np.linalg.norm(self._slope(name, guess, B)))
            self.fixed_scales[name] = max(abs(float(fixed_value)), slope * guess.state_size) or 1.0
        gaps = [guess.gap_size]  # |Φ_h^N(z) − z| of each guess so far
        while not self._is_closed(guess, gaps):
            if report is not None:
                report(len(gaps) - 1)
            # None: no part of the increment brings z nearer to an orbit, or the limit is reached
            next_guess = self._newton_step(guess) if len(gaps) <= iteration_limit else None
            is_close = self.phase_fixed and guess.gap_size < _NEAR * guess.state_size
            if next_guess is None and not is_close:
                raise self._failure(guess, gaps)
            stagnates = next_guess is None or next_guess.gap_size > max(
                guess.gap_size / 2, self._stagnation_level(guess))
            # isolated orbits have one phase within a step (module docstring): the search goes on
            # with a free phase, from the next guess, or without one from the same
            if is_close and stagnates:
                self.phase_fixed = False
            if next_guess is not None:
                guess = next_guess
                gaps.append(guess.gap_size)
        if report is not None:
            report(len(gaps) - 1)
        # |∂Φ^N/∂h h| = |v| T: an equilibrium closes after any period
        path_length = float(np.linalg.norm(self._tangents(guess).by_step) * abs(float(guess.dt)))
        if not self.time_dependent and path_length <= _STILL * guess.state_size:
            raise GyrosparkError("Newton's method came to an equilibrium, which is no orbit; fix "
                                 "the energy or a coordinate, or begin farther from it.")
        return self._result(guess, gaps)

    def _failure(self, guess: Guess, gaps: list[float]) -> GyrosparkError:
        """Return the error of a search that did not converge; ``gaps`` are its |Φ(z) − z|."""
        return GyrosparkError(
            f"Newton's method found no periodic orbit of {count_text(self.steps, 'step')}: after "
            f"{count_text(len(gaps) - 1, 'iteration')} the end is off the start by {gaps[-1]:.2e} "
            f"({min(gaps):.2e} at best, {gaps[0]:.2e} at first), with dt = {float(guess.dt):.6g}; "
            "give a state and a dt nearer to an orbit, more steps, or something else to fix.")

    def _is_closed(self, guess: Guess, gaps: list[float]) -> bool:
        """Whether the residual is round-off, or the gap small and not halved by a Newton step.

        The residual is the gap Φ(z) − z with the changes of fixed quantities. ``gaps`` are the
        sizes of the gap before each iteration so far.
        """
        if self._residual(guess) <= _CLOSED * self.epsilon * guess.state_size:
            return True
        stagnant = len(gaps) > 1 and gaps[-1] >= gaps[-2] / 2
        return stagnant and guess.gap_size <= self._stagnation_level(guess)

    def _stagnation_level(self, guess: Guess) -> float:
        """Return the gap below which an iteration may stagnate."""
        round_off = _STAGNATED * self.epsilon * math.sqrt(self.steps)
        return guess.state_size * (max(_SMALL, round_off) if self.phase_fixed else round_off)

    def _newton_step(self, guess: Guess) -> Guess | None:
        """Return the guess after a Newton increment, halved while the residual grows.

        None if it grows still after the last halving.
        """
        increment, B = self._increment(guess)
        residual, damping = self._residual(guess), 1.0
        for _ in range(_HALVINGS + 1):
            trial = self._moved_guess(guess, B, increment * damping)
            if trial is not None and self._residual(trial) < max(
                    residual, _SMALL * guess.state_size):
                return trial
            damping /= 2
        return None

    def _increment(self, guess: Guess) -> tuple[Array, Array]:
        """Return the Newton increment (dy, dh, dθ), and the basis B, in the units of the guess.

            (Bᵀ Φ' B − 1) dy + Bᵀ ∂Φ^N/∂h dh + Bᵀ (∂Φ^N/∂θ − ∂z/∂θ) dθ = −Bᵀ (Φ^N(z) − z)
            v·B dy = 0  (if the phase is fixed),   dc = c(z_0) − c(z)  for each fixed quantity c

        by least squares of least norm. Columns are scaled to length 1, and each row after the first
        block to length 1 of its entries by y.
        """
        Phi, B, by_step, by_parameter = self._tangents(guess)
        dim = B.shape[1]
        columns = [B.T @ Phi - np.eye(dim)]
        start_derivatives = [B]
        if "period" not in self.fixed:
            columns.append((B.T @ by_step)[:, None])
            start_derivatives.append(np.zeros((2 * self.stepper.n, 1)))
        if self.free is not None:
            start_by_parameter, end_by_parameter = by_parameter
            columns.append((B.T @ (end_by_parameter - start_by_parameter))[:, None])
            start_derivatives.append(start_by_parameter[:, None])
        # A (dy, dh, dθ) = right_side, and D = ∂(q, p)/∂(y, h, θ) at the start
        A, D = np.hstack(columns), np.hstack(start_derivatives)
        right_side = [*(-B.T @ (guess.gap.astype(float) / guess.units))]
        rows: list[tuple[Array, float]] = []  # slope by the unknowns, and its right side
        if self.phase_fixed:  # ∂Φ^N/∂h = N v on the orbit
            rows.append((np.pad(by_step @ B, (0, A.shape[1] - dim)), 0.0))
        for name in self.fixed_values:
            change = self._value(name, guess.z, guess.parameters) - self.fixed_values[name]
            rows.append((self._slope(name, guess, D), -float(change)))
        for slope, value in rows:
            size = float(np.linalg.norm(slope[:dim])) or 1.0
            A = np.vstack([A, slope / size])
            right_side.append(value / size)
        norms = np.linalg.norm(A, axis=0)
        norms[norms == 0] = 1.0
        # far from the orbit, small singular values are no more than the size of the residual
        share = _RESIDUAL_SHARE * guess.gap_size / guess.state_size
        cutoff = min(max(share, _LEAST), _MOST) if self.phase_fixed else _LEAST
        return np.linalg.lstsq(A / norms, np.array(right_side), rcond=cutoff)[0] / norms, B

    def _moved_guess(self, guess: Guess, B: Array, increment: Array) -> Guess | None:
        """Return the guess after an increment; None if dt changes sign or the run fails.

        The increment is (dy, dh, dθ), without dh where the period is fixed, without dθ where no
        parameter is free. The state moves by B dy in the units of the guess, ``B`` a basis of its
        tangent space, and is projected onto the constraints.
        """
        binding, dim = self.stepper.binding, B.shape[1]
        # behind dy come dh, unless the period is fixed, and dθ, if a parameter is free
        further_increments = list(increment[dim:])
        dt = guess.dt
        if "period" not in self.fixed:
            dt = guess.dt + binding.number(Fraction(further_increments.pop(0)))
        parameters = dict(guess.parameters)
        if self.free is not None:
            parameters[self.free] += binding.number(Fraction(further_increments.pop(0)))
        if not float(dt) * float(guess.dt) > 0:
            return None
        z = guess.z + binding.to_real(guess.units * (B @ increment[:dim]))
        n = self.stepper.n
        try:
            q, p = self.stepper.project(z[:n], z[n:], parameters=parameters, t=self.t0)
            return self._evaluate(q, p, dt, parameters)
        except GyrosparkError:  # no constraints, or no step, that far away: half as far
            return None

    def _evaluate(self, q: Array, p: Array, dt: Any, parameters: dict[str, Any]) -> Guess:
        """Return the guess q, p, shapes (n,), with its gap z(T) − z(0) and the tangents of its run.

        z is (q, p), shape (2 n,), T = ``steps`` · dt.
        """
        run = self.stepper.integrate(
            Start(q, p, parameters, self.t0), dt=dt, steps=self.steps,
            every=max(self.steps // _SAMPLES, 1), tangents=Tangents(
                start="all", dt=True, parameters=() if self.free is None else (self.free,)))
        assert run.tangents is not None
        if self.units is None:
            sizes = [np.linalg.norm(x.astype(float), axis=1).max() or 1.0 for x in (run.q, run.p)]
            self.units = np.repeat(sizes, self.stepper.n)
        start, end = np.concatenate([run.q[0], run.p[0]]), np.concatenate(self._projected_end(run))
        return Guess(start, dt, parameters, end - start, run.tangents, self.units)

    def _projected_end(self, run: Trajectory) -> tuple[Array, Array]:
        """Return the last (q, p), projected onto f = 0 where the scheme keeps g = 0 alone."""
        if self.stepper.manifest.scheme.keeps_momentum_constraint:
            return run.q[-1], run.p[-1]
        return self.stepper.project(run.q[-1], run.p[-1], parameters=run.parameters, t=run.t[-1])

    def _tangents(self, guess: Guess) -> _PeriodTangents:
        """Return the derivatives of z(T) = Φ^N(z) of a guess, in doubles and its units."""
        names, start = guess.tangents.names, guess.tangents.start.astype(float)
        end = np.concatenate([guess.tangents.q[-1], guess.tangents.p[-1]]).astype(float)
        dim = 2 * (self.stepper.n - self.stepper.m)
        k = names.index(self.free or "dt")  # column of by_parameter
        # the end of the gap is projected onto f = 0, and so are its tangents
        if not self.stepper.manifest.scheme.keeps_momentum_constraint:
            binding, n = self.stepper._derivative_binding(), self.stepper.n
            z = guess.z + guess.gap
            _, projection = tangent_projection(
                binding, binding.module.parameters(guess.parameters, self.t0), z[:n].copy(),
                z[n:].copy())
            end = projection @ end
        start, end = start / guess.units[:, None], end / guess.units[:, None]
        # the directions of the start are B R, so that Φ'B = end R⁻¹
        B, R = np.linalg.qr(start[:, :dim])
        return _PeriodTangents(
            end=np.linalg.solve(R.T, end[:, :dim].T).T, start=B, by_step=end[:, names.index("dt")],
            by_parameter=np.array([start[:, k], end[:, k]]))

    def _value(self, name: str, z: Array, parameters: Mapping[str, Any]) -> Any:
        """Return the energy, or a coordinate or momentum by its name, of a state z."""
        n = self.stepper.n
        if name == "energy":
            return self.stepper.energy(z[:n], z[n:], parameters=parameters, t=self.t0)[()]
        return z[self._names().index(name)]

    def _slope(self, name: str, guess: Guess, D: Array) -> Array:
        """Return the derivatives of a fixed quantity by the unknowns; of the energy by differences.

        ``D`` has the derivatives of (q, p) at the start by the unknowns, a column for each, in the
        units of the guess.
        """
        if name != "energy":
            entry = self._names().index(name)
            slope: Array = guess.units[entry] * D[entry]
            return slope
        n, scale = self.stepper.n, 1e-5 * guess.state_size
        # central differences: each unknown moves the state by the same length
        norms = np.linalg.norm(D, axis=0)
        sizes = scale / np.maximum(norms, 1e-300)
        sizes[norms == 0] = 0
        z = self.stepper.binding.to_real((D * sizes).T * guess.units)
        states = np.concatenate([guess.z + z, guess.z - z])
        H = self.stepper.energy(states[:, :n], states[:, n:], parameters=guess.parameters,
                                t=self.t0)
        k = D.shape[1]
        difference = (H[:k] - H[k:]).astype(float)
        slopes: Array = np.divide(difference, 2 * sizes, out=np.zeros(k), where=sizes > 0)
        # behind the coordinates of the start D may have a column of the parameter, the last one
        if self.free is not None and k > 2 * (n - self.stepper.m):
            slopes[-1] += self._energy_by_parameter(guess)
        return slopes

    def _energy_by_parameter(self, guess: Guess) -> float:
        """Return ∂H/∂θ ≈ (H(θ + h) − H(θ − h))/2h of the free parameter θ at a fixed state."""
        assert self.free is not None
        theta = guess.parameters[self.free]
        h = 1e-5 * (abs(float(theta)) or 1.0)
        above, below = (float(self._value("energy", guess.z, guess.parameters | {self.free: x}))
                        for x in (theta + h, theta - h))
        return (above - below) / (2 * h)

    def _names(self) -> list[str]:
        """Return the names of the entries of z = (q, p)."""
        system = self.stepper.manifest.system
        return [*system.coordinates, *system.momenta]

    def _fixed_residual(self, guess: Guess) -> float:
        """Return the largest change of a fixed quantity in parts of its scale."""
        return max((abs(float(self._value(name, guess.z, guess.parameters) - fixed_value))
                    / self.fixed_scales[name]
                    for name, fixed_value in self.fixed_values.items()), default=0.0)

    def _residual(self, guess: Guess) -> float:
        """Return the norm of the gap and of the change of fixed quantities, in units of z."""
        return math.hypot(guess.gap_size, self._fixed_residual(guess) * guess.state_size)

    def _result(self, guess: Guess, gaps: list[float]) -> PeriodicOrbit:
        """Return the orbit with its multipliers, the eigenvalues of M = Bᵀ Φ B, the largest first.
        """
        tangents = self._tangents(guess)
        Phi, B = tangents.end, tangents.start
        M = B.T @ Phi
        # the basis of the result is orthonormal without units: its columns are those of units · B R
        basis = guess.tangents.start.astype(float)[:, : len(M)]
        R = B.T @ (basis / guess.units[:, None])
        omega = B.T @ canonical_form(self.stepper.n) @ B
        defect = float(np.abs(M.T @ omega @ M - omega).max() / max(np.abs(M).max(), 1.0) ** 2)
        multipliers = np.linalg.eigvals(M).astype(complex)
        # rounded, so that the two of a conjugate pair stay next to each other
        order = np.lexsort((-multipliers.imag, np.round(multipliers.real, 6),
                            -np.round(np.abs(multipliers), 6)))
        return PeriodicOrbit(
            guess.z[: self.stepper.n], guess.z[self.stepper.n :], guess.dt, self.steps,
            guess.parameters, self.t0, multipliers=multipliers[order],
            monodromy=np.linalg.solve(R, M @ R), basis=basis, symplectic_defect=defect,
            iterations=len(gaps) - 1, residuals=tuple(gaps), _stepper=self.stepper)


def _names_of_fixed(
    stepper: Stepper, fix: str | Sequence[str] | None, *, time_dependent: bool
) -> tuple[str, ...]:
    """Return the names of the fixed quantities: of a list, of one name, or none.

    Raises InputError for an unknown name, and for a time-dependent system whose period is not
    fixed.
    """
    names: tuple[str, ...] = ()
    if fix is not None:
        names = (fix,) if isinstance(fix, str) else tuple(as_items("fix", fix, "names"))
    system = stepper.manifest.system
    allowed = ["energy", "period", *system.coordinates, *system.momenta]
    for name in names:
        if not isinstance(name, str) or name not in allowed:
            raise unknown("name in fix", name, allowed)
    if time_dependent and "period" not in names:
        raise InputError(f"fix = {shown(fix)} leaves the period free, but {stepper.name} depends "
                         "on time: its orbits have the period of what drives it; give "
                         "fix='period'.")
    return names


def _text(value: complex) -> str:
    """Return a Floquet multiplier in few digits, with ± for a conjugate pair."""
    if value.imag < 1e-6:
        return f"{value.real:.6g}"
    return f"{value.real:.6g} ± {value.imag:.6g}i"
