"""The constraints of a compiled stepper, with difference quotients for their derivatives.

Compiled code projects on its own; this is for its failures: damped steps, and names in messages.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .binding import Binding

__all__ = ["CompiledConstraints"]

Array = NDArray[Any]


class CompiledConstraints:
    """g, f and their derivatives at given parameters, in double."""

    def __init__(self, binding: Binding, manifest: dict[str, Any], parameters: Any) -> None:
        self._binding, self._parameters = binding, parameters
        system = manifest["system"]
        self.coordinates, self.momenta = system["coordinates"], system["momenta"]
        default = [f"g{i}" for i in range(binding.m)]
        self.constraint_names = system.get("constraint_names", default)

    def g(self, q: Array) -> Array:
        """Return g(q), shape (m,)."""
        g: Array = self._defects(q[None], np.zeros((1, len(q))))[0][0]
        return g

    def f(self, q: Array, p: Array) -> Array:
        """Return the constraint on the momenta, shape (m,)."""
        f: Array = self._defects(q[None], p[None])[1][0]
        return f

    def G(self, q: Array) -> Array:
        """Return g_q, shape (m, n), by central differences: nine digits, enough for Newton."""
        h = _step(q) * np.eye(len(q))
        g, _ = self._defects(np.vstack([q + h, q - h]), np.zeros((2 * len(q), len(q))))
        slopes: Array = (g[: len(q)] - g[len(q) :]).T / (2 * h[0, 0])
        return slopes

    def W(self, q: Array, p: Array, G: Array) -> Array:
        """Return (∂f/∂p) Gᵀ, shape (m, m), by central differences along the rows of G."""
        h = _step(p) / max(float(np.linalg.norm(G, axis=1).max(initial=0.0)), 1e-300)
        _, f = self._defects(np.tile(q, (2 * len(G), 1)), np.vstack([p + h * G, p - h * G]))
        matrix: Array = (f[: len(G)] - f[len(G) :]).T / (2 * h)
        return matrix

    def _defects(self, q: Array, p: Array) -> tuple[Array, Array]:
        states = (np.ascontiguousarray(x, dtype=self._binding.dtype) for x in (q, p))
        g, f = self._binding.defects(self._parameters, *states)
        return g.astype(float), f.astype(float)


def _step(x: Array) -> float:
    size = float(np.linalg.norm(x))
    return 2.0**-17 * (size or 1.0)
