"""The frequency of the linearised motion at the start of a run, where steps needed Newton's method.

M is the derivative of a step that is 2^10 times shorter, by central differences along the tangent
space of the constraints; its eigenvalues are exp(iωΔt/2^10). A step whose fixed-point iteration
converges has small ωΔt: only where Newton's method took over is the frequency computed, from 4n
short steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array
from ...core.warnings import warn
from ..bindings.binding import Binding
from ..results.rotation_rate import LOST, phase_error

if TYPE_CHECKING:
    from .run_arguments import RunArguments

__all__ = ["fastest_frequency", "warn_of_frequency"]

#: Coordinates up to which the derivative of a step is computed.
_MOST_COORDINATES = 64
#: The step of M, as a part of the run's.
_PART = 2.0**-10
#: Differences relative to the state: their error and their round-off are alike.
_NUDGE = float(np.finfo(float).eps) ** (1 / 3)
#: Fast modes with less than this part of the motion, such as stiff springs at rest, are no loss.
_SHARE = 0.1


def warn_of_frequency(binding: Binding, run: RunArguments, order: int) -> None:
    """Warn where the method does not follow the fastest mode that moves at the start of a run."""
    omega = fastest_frequency(binding, run, order)
    if omega is None:
        return
    dt = abs(float(run.dt))
    bound = dt * omega
    while phase_error(order, bound) > LOST:
        bound *= 0.9
    warn(f"The linearised motion at the start has {omega:.3g} rad/s, {omega * dt:.3g} rad a step, "
         f"which a method of order {order} does not follow: its phase errs by about "
         f"{100 * phase_error(order, omega * dt):.0f} %, however well the energy is kept. Take a "
         f"dt below {bound / omega:.2g}.")


def fastest_frequency(binding: Binding, run: RunArguments, order: int) -> float | None:
    """Return the largest ω of modes that move and are not followed; None where there is none.

    With z' ≈ M z of a short step, in coordinates of the tangent space: M = V diag(exp(iωδ)) V⁻¹,
    δ = 2^−10 Δt. The rates of the start in the modes V say how much of the motion each one has.
    """
    n = binding.n
    if n > _MOST_COORDINATES or binding.dtype is not np.float64 or binding.rows:
        return None
    parameters = binding.parameters(run.at_step(0).parameters, run.t0)
    work, dt = binding.work(), float(run.dt) * _PART
    options = binding.options(None, 50, "newton")

    def end(z: Array) -> Array:
        """Return the state after a short step."""
        status, q, p = binding.step(parameters, options, dt, z[:n].copy(), z[n:].copy(), work)
        return np.concatenate([q, p]) if status == 0 else np.full(2 * n, math.nan)

    def projected(z: Array) -> Array:
        """Return a state, moved onto the constraints."""
        q, p = z[:n].copy(), z[n:].copy()
        return np.concatenate([q, p]) if not binding.project(parameters, q, p) else z * math.nan

    start = np.concatenate([run.q, run.p]).astype(float)
    velocity = end(start) - start
    # Momenta of a motion that starts from rest are those of some steps.
    sizes = [np.abs(start[half]).max() + np.abs(velocity[half]).max() / _PART
             for half in (slice(0, n), slice(n, 2 * n))]
    scale = np.repeat([size or 1.0 for size in sizes], n)
    basis = _tangent_basis(projected, start, scale)
    if basis is None:
        return None
    M = np.array([basis.T @ ((end(projected(start + _NUDGE * scale * e))
                              - end(projected(start - _NUDGE * scale * e))) / scale / (2 * _NUDGE))
                  for e in basis.T]).T
    if not np.isfinite(M).all():
        return None
    factors, modes = np.linalg.eig(M)
    omega = np.abs(np.angle(factors)) / abs(dt)
    fast = np.array([phase_error(order, w * abs(float(run.dt))) > LOST for w in omega])
    if not fast.any():
        return None
    rates = np.linalg.lstsq(modes, (basis.T @ (velocity / scale)).astype(complex), rcond=None)[0]
    # amplitude = rate/|exp(iωδ) − 1|; a mode that drifts, ω = 0, is counted over the run
    parts = modes * (rates / np.maximum(np.abs(factors - 1), _PART / run.steps))
    if np.linalg.norm(parts[:, fast].sum(axis=1)) < _SHARE * np.linalg.norm(parts, axis=0).sum():
        return None
    return float(omega[fast].max())


def _tangent_basis(
    projected: Callable[[Array], Array], start: Array, scale: Array
) -> Array | None:
    """Return an orthonormal basis of dz/scale tangent to the constraints, (2n, k); None if none.

    P = ∂(projected z)/∂z by central differences, each entry moved by a part of its scale; the range
    of P = U Σ Vᵀ is spanned by the columns of U.
    """
    moves = _NUDGE * np.diag(scale)
    tangents = np.array([(projected(start + e) - projected(start - e)) / (2 * _NUDGE * scale)
                         for e in moves]).T
    if not np.isfinite(tangents).all():
        return None
    U, lengths, _ = np.linalg.svd(tangents)
    # directions that the projection removes have singular values of round-off
    return np.asarray(U[:, lengths > _SHARE * lengths[0]])
