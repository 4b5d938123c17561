"""The frequency of the linearised motion at the start of a run, where steps needed Newton's method.

M is the derivative of a step that is 2^10 times shorter, by central differences along the tangent
space of the constraints; its eigenvalues are exp(iωΔt/2^10). A step whose fixed-point iteration
converges has small ωΔt: only where Newton's method took over is the frequency computed, from 4n
short steps.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array
from ...core.warnings import warn
from ..bindings.binding import Binding
from ..results.rotation_rate import LOST, phase_error

if TYPE_CHECKING:
    from .run_arguments import RunArguments

__all__ = ["fastest_frequency", "warn_of_frequency"]

#: Coordinates up to which the derivative of a step is computed; in float128, whose steps are slow.
_MOST_COORDINATES, _MOST_IN_FLOAT128 = 64, 14
#: The step of M, as a part of the run's.
_PART = 2.0**-10
#: Fast modes with less than this part of the motion, such as stiff springs at rest, are no loss.
_SHARE = 0.1
#: Singular values of a projection are 1 for tangents; below this one they are round-off.
_REMOVED = 0.1


def warn_of_frequency(binding: Binding, run: RunArguments, order: int) -> None:
    """Warn where the method does not follow the fastest mode that moves at the start of a run."""
    omega = fastest_frequency(binding, run, order)
    if omega is None:
        return
    # the phase error falls with dt: the largest dt that loses no phase, to a tenth
    dt = abs(float(run.dt))
    bound = dt * omega
    while phase_error(order, bound) > LOST:
        bound *= 0.9
    warn(f"The linearised motion at the start has {omega:.3g} rad/s, {omega * dt:.3g} rad a step, "
         f"which a method of order {order} does not follow: its phase errs by about "
         f"{100 * phase_error(order, omega * dt):.0f} %, however well the energy is kept. Take a "
         f"dt below {bound / omega:.2g}.")


def fastest_frequency(binding: Binding, run: RunArguments, order: int) -> float | None:
    """Return the largest frequency ω in rad/s of modes that move and that steps do not follow.

    None where all such modes are followed, or cannot be computed. With z' ≈ M z for a short step in
    coordinates of the tangent space, M = V diag(exp(iωδ)) V⁻¹ and δ = 2⁻¹⁰ Δt; the rates of the
    start in the modes V say how much of the motion each mode has.
    """
    n = binding.n
    most = _MOST_IN_FLOAT128 if binding.dtype is object else _MOST_COORDINATES
    if n > most or binding.rows:
        return None
    short_step = _ShortStep(binding, run)
    start = np.concatenate([run.q, run.p]).astype(float)
    change = short_step.end(start) - start
    # one scale for q and one for p: their sizes, and those that the motion reaches in a step of Δt,
    # for momenta of a motion that starts from rest
    sizes = [np.abs(start[half]).max() + np.abs(change[half]).max() / _PART
             for half in (slice(0, n), slice(n, 2 * n))]
    scale = np.repeat([size or 1.0 for size in sizes], n)
    basis = short_step.tangent_basis(start, scale)
    if basis is None:
        return None
    M = short_step.derivative(start, scale, basis)
    if not np.isfinite(M).all():
        return None
    factors, modes = np.linalg.eig(M)
    omega = np.abs(np.angle(factors)) / abs(short_step.dt)
    is_fast = np.array([phase_error(order, w * abs(float(run.dt))) > LOST for w in omega])
    if not is_fast.any():
        return None
    rates = np.linalg.lstsq(modes, (basis.T @ (change / scale)).astype(complex), rcond=None)[0]
    # amplitude = rate/|exp(iωδ) − 1|; a mode that drifts, ω = 0, is counted over the run
    motions = modes * (rates / np.maximum(np.abs(factors - 1), _PART / run.steps))
    fast_size = np.linalg.norm(motions[:, is_fast].sum(axis=1))
    if fast_size < _SHARE * np.linalg.norm(motions, axis=0).sum():
        return None
    return float(omega[is_fast].max())


class _ShortStep:
    """A step of 2⁻¹⁰ Δt from states z = (q, p) near the start of a run, in doubles, (2 n,).

    ``nudge`` is the size of differences relative to the state: their error and the round-off of
    the stepper's type are alike.
    """

    def __init__(self, binding: Binding, run: RunArguments) -> None:
        """Take the parameters and inputs of the first step, and full Newton iterations."""
        self._binding, self._work = binding, binding.work()
        self._parameters = binding.parameters(run.at_step(0).parameters, run.t0)
        self._options = binding.options(tolerance=None, max_iterations=50, solver="newton")
        self.dt = float(run.dt) * _PART
        self.nudge = float(max(binding.epsilon, np.finfo(float).eps)) ** (1 / 3)

    def end(self, z: Array) -> Array:
        """Return the state after the step; NaN where it fails."""
        binding = self._binding
        status, q, p = binding.step(self._parameters, self._options,
                                    binding.number(Fraction(self.dt)), *self._halves(z), self._work)
        return z * math.nan if status else np.concatenate([q, p]).astype(float)

    def project_state(self, z: Array) -> Array:
        """Return the state moved onto the constraints; NaN where that fails."""
        q, p = self._halves(z)  # projected in place
        failed = self._binding.project(self._parameters, q, p)
        return z * math.nan if failed else np.concatenate([q, p]).astype(float)

    def _halves(self, z: Array) -> tuple[Array, Array]:
        """Return q and p of a state, copies in the stepper's type."""
        n = self._binding.n
        return self._binding.to_real(z[:n]), self._binding.to_real(z[n:])

    def derivative(self, start: Array, scale: Array, basis: Array) -> Array:
        """Return M = ∂(end)/∂(start) in the columns of ``basis``, (2 n, k), shape (k, k).

        Central differences of scaled states z/scale, each moved onto the constraints.
        """
        columns = []
        for e in basis.T:
            move = self.nudge * scale * e
            forth = self.end(self.project_state(start + move))
            back = self.end(self.project_state(start - move))
            columns.append(basis.T @ ((forth - back) / scale / (2 * self.nudge)))
        return np.array(columns).T

    def tangent_basis(self, start: Array, scale: Array) -> Array | None:
        """Return an orthonormal basis of dz/scale tangent to the constraints, shape (2 n, k).

        P = ∂(projected z)/∂z by central differences, each entry moved by a part of its scale; the
        range of P = U Σ Vᵀ is spanned by the columns of U. None where a projection fails.
        """
        moves = self.nudge * np.diag(scale)
        tangents = np.array([
            (self.project_state(start + e) - self.project_state(start - e))
            / (2 * self.nudge * scale) for e in moves]).T
        if not np.isfinite(tangents).all():
            return None
        U, lengths, _ = np.linalg.svd(tangents)
        # directions that the projection removes have singular values of round-off
        return np.asarray(U[:, lengths > _REMOVED * lengths[0]])
