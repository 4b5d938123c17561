"""States of a co-moving frame in space, z = S(k h ω) z̃, and the derivatives of S.

S = diag(e^X, e^(−Xᵀ)) with X = k h Σ ω_i A_i. A derivative along dX is the upper right block of the
exponential of [[X, dX], [0, X]] (Van Loan, IEEE Trans. Automat. Control 23, 1978).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...core.arrays import Array
from ...core.incompatibilities import refuse_together

if TYPE_CHECKING:
    from ..integration.manifest_symmetries import Symmetry
    from ..integration.run_arguments import RunArguments
    from .binding import DerivativeBinding

__all__ = ["FrameMotion"]

#: Terms of the Taylor series of an exponential whose argument is at most 1/4 in norm.
_TERMS = 26


class FrameMotion:
    """The motion S(k h ω) of a frame in a run; ``moves`` is False for a stepper without a frame."""

    def __init__(
        self, binding: DerivativeBinding, symmetries: tuple[Symmetry, ...], run: RunArguments
    ) -> None:
        """Compute the generator Σ ω_i A_i of (q, p), (2 n, 2 n), with the run's rates ω_i."""
        derivative_module, n = binding.module, binding.n
        self.n, self.dt, self._row_count = n, run.dt, binding.rows
        #: Whether there is a frame: without symmetries S = 1.
        self.moves = bool(symmetries)
        #: For each symmetry: the row of its rate ω_i in a direction, and A_i for (q, p).
        self._rate_rows, self._lifted = [], []
        for symmetry in symmetries:
            A = derivative_module.new(n, n)
            # an array of objects has numbers of float128, to which doubles are added
            A += np.array(symmetry.A, dtype=A.dtype if A.dtype != object else float)
            lifted = derivative_module.new(2 * n, 2 * n)
            # the flow of A lifted to the cotangent space: q' = A q, p' = −Aᵀ p
            lifted[:n, :n], lifted[n:, n:] = A, -A.T
            self._lifted.append(lifted)
            self._rate_rows.append(2 * n + derivative_module.parameter_names.index(symmetry.name))
        self._generator = derivative_module.new(2 * n, 2 * n)
        for lifted, symmetry in zip(self._lifted, symmetries, strict=True):
            self._generator += lifted * run.parameters[symmetry.name]
        self._new, self._binding = derivative_module.new, binding

    def matrix(self, k: int) -> Array:
        """Return S = exp(k Δt Σ ω_i A_i) after k steps, shape (2 n, 2 n)."""
        return self._exponential(self._generator * (k * self.dt))

    def refuse_rotating_multipliers(self, run: RunArguments) -> None:
        """Refuse derivatives of multipliers in a frame that turns constraints, G(S q) S ≠ G(q).

        Raises InputError for such a frame: its multipliers turn as well.
        """
        n = self.n
        parameters = self._binding.module.parameters(run.parameters, run.t0)
        G = self._binding.constraint_derivatives(parameters, run.q, run.p).g[:, :n]
        for lifted in self._lifted:
            # half a radian: constraints that are invariant have the same G there, in the frame's
            # axes
            S = self._exponential(lifted / 2)
            z = S @ np.concatenate([run.q, run.p])
            turned = self._binding.constraint_derivatives(
                parameters, z[:n].copy(), z[n:].copy()).g[:, :n] @ S[:n, :n]
            if float(np.abs(turned - G).max()) > 1e-6 * float(np.abs(G).max()):
                refuse_together(multiplier_derivatives="derivatives of multipliers",
                                turning_frame="this co-moving frame")

    def in_space(self, k: int, z: Array, dz: Array, tangents: Array) -> tuple[Array, Array]:
        """Return the state S z, (2 n,), and its directions S dz̃ + dS z, (2 n, k), in space.

        z is the state in the frame after k steps, ``tangents`` are its directions dz̃, (2 n, k), and
        ``dz``, (rows, k), those of the start, with the rates of the frame.
        """
        if not self.moves:
            return z, tangents
        S = self.matrix(k)
        return S @ z, S @ tangents + self.own_derivatives(k, z) @ dz

    def own_derivatives(self, k: int, z: Array) -> Array:
        """Return dS z by the rows of a direction, shape (2 n, rows), of a state z of the frame.

        S = e^X with X = k Δt Σ ω_i A_i. Its derivative by ω_i is the upper right block of

            exp([[X, k Δt A_i], [0, X]])       (Van Loan, IEEE Trans. Autom. Control 1978)
        """
        derivatives: Array = self._new(2 * self.n, self._row_count)
        X, size = self._generator * (k * self.dt), 2 * self.n
        block = self._new(2 * size, 2 * size)
        block[:size, :size] = block[size:, size:] = X
        for index, lifted in zip(self._rate_rows, self._lifted, strict=True):
            block[:size, size:] = lifted * (k * self.dt)
            derivatives[:, index] = self._exponential(block)[:size, size:] @ z
        # by Δt: dS/dΔt = k (Σ ω_i A_i) S, as X commutes with its own multiple
        derivatives[:, -2] = k * (self._generator @ (self._exponential(X) @ z))
        return derivatives

    def _exponential(self, X: Array) -> Array:
        """Return e^X = (Σ_j (X/2^k)^j/j!)^(2^k), k = ``halvings``, in any floating-point type.

        The exponential of SciPy is of doubles alone.
        """
        largest = max(float(np.abs(row).sum()) for row in X)
        # |X/2^k| ≤ ¼ in the norm of row sums, where _TERMS terms reach the round-off of every type
        halvings = max(0, int(np.ceil(np.log2(largest))) + 2) if largest > 0 else 0
        X = X / 2**halvings
        unit = self._new(*X.shape)
        unit[np.arange(len(X)), np.arange(len(X))] = 1
        series = unit.copy()
        for term in range(_TERMS, 0, -1):  # Horner: 1 + X (1 + X/2 (1 + X/3 ...))
            series = unit + X @ series / term
        for _ in range(halvings):
            series = series @ series
        return series
