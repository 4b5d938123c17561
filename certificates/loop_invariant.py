"""The loop invariant ∮ p·dq of a map, over a closed curve of states on the constraint manifold.

In scaled time t is among q and e among p: ∮ p·dq + e dt.

    I = ∮ Σ_i p_i dq_i/ds ds  ≈  2π/M Σ_k p(s_k)·q'(s_k),   s_k = 2πk/M,

with q' from the discrete Fourier transform of q: for an analytic curve the error falls like a
power with exponent M, and finite differences would hide 1e-12 behind their own 1e-7. A map is
symplectic on the constraint manifold if and only if it keeps I of every loop (Poincaré).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..core.arrays import Array
from ..core.errors import GyrosparkError
from ..runtime.results.outputs import full_states
from ..runtime.steppers.stepper import Stepper
from .measurements import step_keyword

__all__ = ["LoopDrift", "closed_loop", "loop_drift", "loop_integral"]

#: Radii that are tried, in units of the motion's own sizes, and numbers of points.
_RADII = (0.1, 0.025, 0.006, 0.0015, 4e-4, 1e-4, 2.5e-5)
_POINTS = (64, 128, 256)


@dataclass(frozen=True)
class LoopDrift:
    """The change of a loop's integral ∮ p·dq over a run.

    Attributes
    ----------
    start : float
        ∮ p·dq at the start.
    scale : float
        ∮ Σ s_i |dq_i| + r_i |dp_i| at its largest, with the round-off r and s of q and p in units
        of ε: the effect on ∮ p·dq of an error ε in the states.
    drift : float
        Largest |I_k − I_0| over the measured instants.
    halfway : float
        The same over the first half of the run.
    points : int
        M.
    radius : float
        Of the loop, in units of the motion's own sizes.
    tail : float
        Largest of the last eighth of the spectrum, relative to the loop, at any instant.
    steps : int
        Steps of the run.
    epsilon : float
        ε of the stepper's type.
    """

    start: float
    scale: float
    drift: float
    halfway: float
    points: int
    radius: float
    tail: float
    steps: int
    epsilon: float

    @property
    def is_resolved(self) -> bool:
        """Whether the spectral derivative is converged to round-off.

        The aliasing error of I, relative to the loop, is the product of mode k of p and its mirror
        image M − k of q; it must be below ε/2.
        """
        return self.tail**2 <= self.epsilon / 2


class LoopIntegral(NamedTuple):
    """∮ p·dq of a loop, its round-off scale ∮ Σ s_i |dq_i| + r_i |dp_i|, the spectrum's tail."""

    value: float
    scale: float
    tail: float


def loop_integral(
    q: Array, p: Array, rounded: tuple[Array, Array] | None = None,
    epsilon: float = float(np.finfo(float).eps),
) -> LoopIntegral:
    """Return ∮ p·dq = (2π/M) Σ_k p(x_k)·q′(x_k), with the spectral derivative q′ of the states.

    Parameters
    ----------
    q, p : arrays, shape (M, n)
        States at equal steps of the parameter along a closed curve, M even.
    rounded : pair of arrays, shape (n,), optional
        Lower bounds of the sizes of q and p that round-off is relative to, beside |q| and |p|.
    epsilon : float
        ε of the type that the states were computed in.
    """
    M = len(q)
    modes = [np.fft.rfft(x, axis=0) for x in (q, p)]
    wave_numbers = np.arange(len(modes[0]))[:, None]
    wave_numbers[-1] = 0  # the highest mode of an even number of points has no derivative
    slopes = [np.fft.irfft(1j * wave_numbers * mode, M, axis=0) for mode in modes]
    # ∮ dq = 0, so p less its mean gives the same number with less round-off.
    integral = ((p - p.mean(axis=0)) * slopes[0]).sum() * 2 * np.pi / M
    least_r, least_s = rounded or (np.zeros(1), np.zeros(1))
    r, s = np.maximum(np.abs(q), least_r), np.maximum(np.abs(p), least_s)
    scale = (np.abs(slopes[0]) * s + np.abs(slopes[1]) * r).sum() * 2 * np.pi / M
    tail = max(_tail(mode, x, epsilon) for mode, x in zip(modes, (q, p), strict=True))
    return LoopIntegral(float(integral), float(scale), tail)


def _tail(modes: Array, x: Array, epsilon: float) -> float:
    """Return the largest of the last eighth of a spectrum relative to the largest mode of all.

    ``modes`` has the shape (M/2 + 1, n), ``x`` the points of the curve. 0 if the last modes are
    round-off of x, which has a spectrum without decay.
    """
    sizes = np.abs(modes).max(axis=1)
    floor = 4 * epsilon * np.sqrt(len(x)) * np.abs(x).max()
    largest = sizes[1:].max()  # without mode 0, the mean
    last = sizes[-max(1, len(sizes) // 8) :].max()
    return float(last / largest) if last > floor else 0.0


def closed_loop(
    stepper: Stepper, q0: Array, p0: Array, sizes: tuple[Array, Array], radius: float,
    points: int, parameters: Mapping[str, float],
) -> tuple[Array, Array]:
    """Return a closed curve of states around a start, moved onto the constraints.

        q(s) = q₀ + r (u cos s + v sin s),  p(s) = p₀ + r (w cos s + z sin s)

    with u, v, w, z drawn from a seeded generator and scaled by ``sizes``, then ``project``. Shape
    (points, n) each. The projection is analytic and so is the curve: sums over its points converge
    exponentially to the integral.
    """
    rng = np.random.default_rng(27)
    s = 2 * np.pi * np.arange(points)[:, None] / points
    circle = [np.cos(s), np.sin(s)]
    curves = [
        x0 + radius * size[: len(x0)] * sum(wave * rng.standard_normal(len(x0)) for wave in circle)
        for x0, size in zip((q0, p0), sizes, strict=True)
    ]
    # drawn states are off the constraints
    states = [stepper.project(*state, parameters=parameters) for state in zip(*curves, strict=True)]
    q, p = (np.array(components, dtype=float) for components in zip(*states, strict=True))
    return q, p


def loop_drift(
    stepper: Stepper, q0: Array, p0: Array, sizes: tuple[Array, Array],
    rounded: tuple[Array, Array] | None = None, *, dt: float, steps: int,
    parameters: Mapping[str, float],
) -> LoopDrift | None:
    """Return the change of ∮ p·dq around a start in a run; None if no loop can be integrated.

    ``sizes`` are the half widths, shape (n,) each, of a loop of radius 1 in q and p; ``rounded``
    are lower bounds of the sizes that round-off is relative to (``loop_integral``). The result is
    for the largest radius and the fewest points with which the spectrum of the curve is resolved at
    the start, at the end and at seven instants between.
    """
    smoothest: LoopDrift | None = None
    for radius in _RADII:
        for points in _POINTS:
            drift = _integrated_loop(stepper, q0, p0, sizes, rounded, radius, points, dt, steps,
                                     parameters)
            if drift is None:
                break  # too large a loop: no step or no projection from some of its states
            if smoothest is None or drift.tail < smoothest.tail:
                smoothest = drift
            if drift.is_resolved:
                return drift
            if drift.tail > 1e-3:
                break  # more points would not be enough
    return smoothest


def _integrated_loop(
    stepper: Stepper, q0: Array, p0: Array, sizes: tuple[Array, Array],
    rounded: tuple[Array, Array] | None, radius: float, points: int, dt: float, steps: int,
    parameters: Mapping[str, float],
) -> LoopDrift | None:
    """Return the drift of ∮p·dq of a loop of one radius and number of points; None if a run fails.

    The states of the loop (``closed_loop``) are an ensemble, integrated together; the drift is the
    largest change of the integral at eight times. ``rounded`` are bounds as of ``loop_integral``.
    """
    try:
        q, p = closed_loop(stepper, q0, p0, sizes, radius, points, parameters)
        ensemble = stepper.integrate_ensemble(q, p, steps=steps, parameters=parameters,
                                              every=max(1, steps // 8), **step_keyword(stepper, dt))
    except GyrosparkError:
        return None
    if ensemble.failures:
        return None
    # in scaled time the extended system is integrated, with t and e among q and p
    states = [full_states(member) for member in ensemble.members] if stepper.binding.clocked else (
        zip(ensemble.q, ensemble.p, strict=True))
    # shape (points, times, n) each
    q, p = (np.array(rows, dtype=float) for rows in zip(*states, strict=True))
    integrals = [loop_integral(q[:, k], p[:, k], rounded, stepper.binding.epsilon)
                 for k in range(q.shape[1])]
    start = integrals[0].value
    changes = [abs(integral.value - start) for integral in integrals]
    return LoopDrift(
        start=start, scale=max(integral.scale for integral in integrals), drift=max(changes),
        halfway=max(changes[: len(changes) // 2 + 1]), points=points, radius=radius,
        tail=max(integral.tail for integral in integrals), steps=steps,
        epsilon=stepper.binding.epsilon,
    )
