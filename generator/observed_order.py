"""The order of a tableau as measured: one step against two half steps, in many digits.

    e(h) = |Φ_h(y) − Φ_{h/2}(Φ_{h/2}(y))| = C h^{order+1} + …,   order = log2 e(h)/e(h/2) − 1

The problem is a particle on a curve with a non-separable Hamiltonian: no order condition is
trivial on it. Residuals are evaluated in mpmath; the iteration matrix is a double inverse, which
gains about ten digits an iteration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import mpmath as mp
import numpy as np
import sympy as sp

from .system import System
from .tableau import NumericTableau, Tableau

__all__ = ["observed_order"]


def observed_order(tableau: Tableau) -> float:
    """Return the measured order; within 0.1 of a whole number for a method of that order.

    Raises
    ------
    ArithmeticError
        If a step's equations are singular or their iteration does not converge.
    """
    digits = 40 + 6 * max(tableau.s, tableau.p)
    h = mp.mpf(1) / (64 * max(4, tableau.s))  # the next term then shows by at most 0.05
    with mp.workdps(digits):
        method = _Spark(tableau.numeric(digits), tableau.s, tableau.p)
        y = method.start()
        errors = []
        for step in (h, h / 2):
            whole = method.step(y, step)
            halves = method.step(method.step(y, step / 2), step / 2)
            errors.append(mp.norm(mp.matrix(whole) - mp.matrix(halves), mp.inf))
        return float(mp.log(errors[0] / errors[1], 2)) - 1


def test_problem() -> System:
    """Return H and g with no symmetry, separability or linearity to hide an error."""
    q = sp.symbols("q0:2", real=True)
    p = sp.symbols("p0:2", real=True)
    H = (
        p[0] ** 2 * (1 + q[1] ** 2 / 3) / 2 + p[1] ** 2 / 2 + p[0] * p[1] * q[0] / 4
        + q[1] + q[0] ** 2 * q[1] / 3
    )
    return System(q, p, (), H, (q[0] ** 2 + q[1] ** 2 + q[0] ** 3 / 5 - 1,), name="test_problem")


@dataclass
class _Spark:
    """(A.1)-(A.7) on the test problem, with plain loops in mpmath."""

    tab: NumericTableau
    s: int
    p: int

    @cached_property
    def functions(self) -> dict[str, Callable[..., Any]]:
        system = test_problem()
        variables = [*system.q, *system.p]
        parts = {"H_q": system.H_q, "H_p": system.H_p, "G": system.G[0],
                 "g": system.constraints[0]}
        return {name: sp.lambdify(variables, part, "mpmath") for name, part in parts.items()}

    def start(self) -> list[Any]:
        """Return a consistent state."""
        f = self.functions
        q0 = mp.mpf(2) / 5
        q = [q0, mp.sqrt(1 - q0**2 - q0**3 / 5)]
        p = [mp.mpf(1), mp.mpf(0)]
        p[1] = mp.findroot(lambda x: mp.fdot(f["G"](*q, 0, 0), f["H_p"](*q, p[0], x)), -1.0)
        return [*q, *p]

    def step(self, y: list[Any], h: Any) -> list[Any]:
        """Return the state one step later."""
        x = self._solve(y, h)
        s, q, p = self.s, y[:2], y[2:]
        k, k_hat = self._rates(x)
        q1 = [q[a] + h * mp.fdot(self.tab.b, (row[a] for row in k)) for a in range(2)]
        force = self._forces(q, k, x[4 * s :], h)
        p1 = [
            p[a] + h * mp.fdot(self.tab.b_hat, (row[a] for row in k_hat))
            + h * mp.fdot(self.tab.b_tilde[: self.p], (row[a] for row in force))
            for a in range(2)
        ]
        G = self.functions["G"](*q1, 0, 0)

        def defect(impulse: Any) -> Any:
            momentum = [p1[a] - impulse * G[a] for a in range(2)]
            return mp.fdot(G, self.functions["H_p"](*q1, *momentum))

        impulse = defect(0) / (defect(0) - defect(1))  # H is quadratic in p: linear in the impulse
        return [*q1, *(p1[a] - impulse * G[a] for a in range(2))]

    def _rates(self, x: list[Any]) -> tuple[list[Any], list[Any]]:
        s = self.s
        return ([x[2 * i : 2 * i + 2] for i in range(s)],
                [x[2 * s + 2 * i : 2 * s + 2 * i + 2] for i in range(s)])

    def _forces(self, q: list[Any], k: list[Any], multipliers: list[Any], h: Any) -> list[Any]:
        """Return k̃_l = −G(Q̃_l)Λ_l, l = 0..p−1."""
        force = []
        for row, multiplier in zip(self.tab.A_bar[: self.p], multipliers, strict=True):
            Q = [q[a] + h * mp.fdot(row, (rate[a] for rate in k)) for a in range(2)]
            force.append([-multiplier * g for g in self.functions["G"](*Q, 0, 0)])
        return force

    def _residual(self, x: list[Any], y: list[Any], h: Any) -> list[Any]:
        """Return (B.1)."""
        f, s, q, p = self.functions, self.s, y[:2], y[2:]
        k, k_hat = self._rates(x)
        force = self._forces(q, k, x[4 * s :], h)
        by_k: list[Any] = []
        by_k_hat: list[Any] = []
        for i in range(s):
            Q = [q[a] + h * mp.fdot(self.tab.A[i], (row[a] for row in k)) for a in range(2)]
            P = [
                p[a] + h * mp.fdot(self.tab.A_hat[i], (row[a] for row in k_hat))
                + h * mp.fdot(self.tab.A_tilde[i][: self.p], (row[a] for row in force))
                for a in range(2)
            ]
            by_k += [a - b for a, b in zip(k[i], f["H_p"](*Q, *P), strict=True)]
            by_k_hat += [a + b for a, b in zip(k_hat[i], f["H_q"](*Q, *P), strict=True)]
        constraints = []
        for row in self.tab.A_bar[1:]:
            Q = [q[a] + h * mp.fdot(row, (rate[a] for rate in k)) for a in range(2)]
            constraints.append(f["g"](*Q, 0, 0) / h**2)  # of the size of the multipliers
        return [*by_k, *by_k_hat, *constraints]

    def _solve(self, y: list[Any], h: Any) -> list[Any]:
        """Return the unknowns (B.2) by Newton with a fixed double inverse."""
        f, s = self.functions, self.s
        x = [*(list(f["H_p"](*y)) * s), *([-e for e in f["H_q"](*y)] * s), *([mp.mpf(0)] * self.p)]
        inverse = None
        size, floor = mp.inf, mp.mpf(10) ** (12 - mp.mp.dps)
        for iteration in range(200):
            r = self._residual(x, y, h)
            previous, size = size, max(abs(e) for e in r)
            if size < floor:
                return x
            if inverse is None or (iteration < 12 and size > previous / 100):
                inverse = _inverse(self._jacobian(x, y, h, r))
            x = [a - mp.fdot(row, r) for a, row in zip(x, inverse.tolist(), strict=True)]
        raise ArithmeticError("The measurement of the order did not converge.")

    def _jacobian(self, x: list[Any], y: list[Any], h: Any, r: list[Any]) -> Any:
        """Return dr/dx in double precision, from differences far below it."""
        tiny = mp.mpf(10) ** (-mp.mp.dps // 2)
        columns = []
        for i in range(len(x)):
            moved = [*x[:i], x[i] + tiny, *x[i + 1 :]]
            shifted = self._residual(moved, y, h)
            columns.append([float((a - b) / tiny) for a, b in zip(shifted, r, strict=True)])
        return np.array(columns).T


def _inverse(matrix: Any) -> Any:
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError as error:
        raise ArithmeticError("A step's equations are singular.") from error
