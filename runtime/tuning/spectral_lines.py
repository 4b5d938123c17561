"""Rates of a frame from the spectrum of one motion, without further runs.

In the joint eigenvectors of the A_i a frame shifts frequencies and changes nothing else,
c_j(ν) → c_j(ν − α_j·ω). A method of some order sees of the motion

    M_k(ω) = Σ_j Σ_ν |c_j(ν)|² (ν − α_j·ω)^2k,

a convex polynomial of ω, which Newton's method minimises.
"""

from __future__ import annotations

import numpy as np

from ...core.arrays import Array

__all__ = ["SpectralLines"]

#: Parameter β of the Kaiser window: a line leaks less than round-off into other frequencies.
_KAISER = 38.0
#: Lines below this part of the strongest are left out: round-off, and what the window leaks.
_FAINT = 1e-13
#: The part of the power in the last eighth of the band above which lines may be folded into it.
_FOLDED = 1e-10


class SpectralLines:
    """The lines of q and p of a motion, sampled evenly.

    Parameters
    ----------
    q, p : ndarray, shape (rows, n)
    dt : float
        Between two rows.
    generators : list of ndarray
        The A_i, which commute.
    """

    def __init__(self, q: Array, p: Array, dt: float, generators: list[Array]) -> None:
        """Compute power |c_j(ν)|², frequency ν and shifts α_j of each line, in flat arrays.

        c_j(ν) = Σ_t w(t) (V⁻¹ x(t))_j exp(−iνt) for x = q, p and ν in rad/s, with the Kaiser window
        w and the common eigenvectors V of the generators, A_k V = V diag(i α_jk); q and p are
        (rows, n), dt apart. Powers of q sum to 1, powers of p too; faint lines are left out.
        """
        # the generators commute: eigenvectors of a combination with irrational weights are those of
        # all
        mixed = sum((A / np.sqrt(i + 2) for i, A in enumerate(generators)),
                    np.zeros_like(generators[0]))
        _, vectors = np.linalg.eig(mixed)
        inverse = np.linalg.inv(vectors)
        shifts = np.array([np.einsum("ji,ik,kj->j", inverse, A,
                                     vectors).imag for A in generators]).T
        frequencies = 2 * np.pi * np.fft.fftfreq(len(q), dt)
        window = np.kaiser(len(q), _KAISER)[:, None]
        # modes that no frame shifts add a constant to M_k
        rotating = np.abs(shifts).max(axis=1) > 1e-9
        power, nu, alpha = [], [], []
        # p moves by −Aᵀ: of a rotation that is A, and p has the modes of q; else it has other ones
        for x in (q, p) if all(np.array_equal(A, -A.T) for A in generators) else (q,):
            modes = (x @ inverse.T)[:, rotating]
            spectrum = np.abs(np.fft.fft(window * modes, axis=0)) ** 2
            spectrum /= spectrum.sum() or 1.0
            power.append(spectrum.ravel())
            nu.append(np.broadcast_to(frequencies[:, None], spectrum.shape).ravel())
            # a row of shifts for each line; axes are frequencies, modes, generators
            line_shifts = np.broadcast_to(shifts[rotating], (*spectrum.shape, shifts.shape[1]))
            alpha.append(line_shifts.reshape(-1, shifts.shape[1]))
        self._power, self._nu, self._alpha = (np.concatenate(x) for x in (power, nu, alpha))
        self._band = float(np.abs(frequencies).max())
        # power close to the highest frequency is of a faster motion, which the sampling folds
        outer_band = np.abs(self._nu) > 0.875 * self._band
        self.is_resolved = bool(self._power[outer_band].sum() <= _FOLDED * self._power.sum())
        strong = self._power > _FAINT * self._power.max(initial=0)
        self._power, self._nu, self._alpha = (
            x[strong] for x in (self._power, self._nu, self._alpha))

    def minimise(self, k: int, start: Array) -> Array:
        """Return the ω that minimises M_k(ω) = Σ |c|² (ν − α·ω)^2k.

        The sum is over the spectral lines: powers |c|², frequencies ν, and shifts α, shape
        (lines, rates); ω and ``start`` have the shape (rates,), rad/s. By Newton's
        method; frequencies are divided by the band, so that powers do not overflow.
        """
        omega = np.array(start, dtype=float)
        for _ in range(60):
            shifted = (self._nu - self._alpha @ omega) / self._band
            gradient = self._alpha.T @ (self._power * shifted ** (2 * k - 1))
            weighted = self._alpha * (self._power * shifted ** (2 * k - 2))[:, None]
            hessian = (2 * k - 1) * self._alpha.T @ weighted / self._band
            step = np.linalg.lstsq(hessian, gradient, rcond=1e-12)[0]
            omega = omega + step
            if np.abs(step).max() <= 1e-9 * max(np.abs(omega).max(), 1e-9 * self._band):
                break
        return omega
