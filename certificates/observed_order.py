"""The order of a tableau as measured: the error of one step, in many digits.

    e(h) = |Φ_h(y) − φ_h(y)| = C h^{order+1} + …,   order = log2 e(h)/e(h/2) − 1

φ is one step of Gauss-Lobatto with two stages more, the order of which is higher by four at least.
The problem is a particle on a curve with a non-separable Hamiltonian and a force that depends on
time: no order condition is trivial on it. Residuals are evaluated in mpmath; the iteration matrix
is a double inverse, which gains about ten digits an iteration.
"""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import mpmath as mp
import numpy as np
import sympy as sp

from ..generator.systems.system import System
from ..generator.tableaux.families import gauss_lobatto
from ..generator.tableaux.tableau import FIELDS, NumericTableau, Tableau

__all__ = ["HiddenOrderError", "observed_order"]

#: Factor by which steps are shortened, _TIMES times at most, while the order seems higher than it
#: is proved to be, or is no whole number: an error of 1e-12 in one coefficient shows at last.
_SHORTER, _TIMES = mp.mpf(2) ** -24, 5
#: Least ratio of a step's error to the effect of the rounding of a tableau's decimals, and the
#: largest distance of a slope from a whole number.
_CLEAR, _NEAR = 8, 0.1


class HiddenOrderError(ArithmeticError):
    """The rounding of a tableau's decimals is worth more than the errors of a step."""


def observed_order(tableau: Tableau) -> float:
    """Return the measured order; within 0.1 of a whole number for a method of that order.

    Raises HiddenOrderError if a tableau is given in too few decimals for its order to show;
    ArithmeticError if a step's equations are singular or their iteration does not converge.
    """
    h = mp.mpf(1) / (128 * max(4, tableau.s))  # the next term then shows by at most 0.05
    order = mp.nan
    for k in range(_TIMES + 1):
        slope = _slope(tableau, h * _SHORTER**k)
        if slope is None:
            break
        order = slope
        if abs(order - round(order)) < _NEAR and round(order) <= tableau.order:
            break
    if tableau.decimal_digits is not None and not abs(order - mp.nint(order)) < _NEAR:
        order = _order_of_longer_steps(tableau, h, tableau.decimal_digits)
    return float(order)


def _order_of_longer_steps(tableau: Tableau, h: Any, digits_given: int) -> float:
    """Return the order in the shortest steps that show one above the rounding of decimals."""
    for k in range(1, 7):
        order = _slope(tableau, h * 2**k)
        if order is not None and abs(order - round(order)) < _NEAR:
            return order
    raise HiddenOrderError(f"hidden by the rounding of {digits_given} digits")


def _slope(tableau: Tableau, h: Any) -> float | None:
    """Return log2 e(h)/e(h/2) − 1; None if e(h/2) is within the rounding of the decimals."""
    reference = gauss_lobatto(tableau.s + 2)  # no order is above 2s
    # the reference's error is about h^(its order + 1): digits below this, and 40 and more to spare
    digits = 40 + 6 * reference.s + math.ceil(-(reference.order + 3) * mp.log10(h))
    with mp.workdps(digits):
        exact, method = (_Spark(t.numeric(digits), t.s, t.p) for t in (reference, tableau))
        y = exact.start()
        half = method.step(y, h / 2)
        error = _largest_difference(half, exact.step(y, h / 2))
        if tableau.decimal_digits is not None:
            differently_rounded = _Spark(_rounded_differently(method.tab, tableau.decimal_digits),
                                         tableau.s, tableau.p)
            if not error > _CLEAR * _largest_difference(half, differently_rounded.step(y, h / 2)):
                return None
        return float(mp.log(_largest_difference(method.step(y, h), exact.step(y, h)) / error,
                            2)) - 1


def _rounded_differently(coefficients: NumericTableau, digits_given: int) -> NumericTableau:
    """Return the tableau with every coefficient off by half a unit of its last digit."""
    draw, unit = random.Random(7), mp.mpf(10) ** -digits_given / 2

    def shifted(entry: Any) -> Any:
        """Return a coefficient, or a list of them, off by half a unit up or down; a 0 is exact."""
        if isinstance(entry, list):
            return [shifted(e) for e in entry]
        return entry + draw.choice((-unit, unit)) if entry else entry

    return NumericTableau(**{name: shifted(getattr(coefficients, name)) for name in FIELDS})


def _largest_difference(y: list[Any], z: list[Any]) -> Any:
    """Return max |y_i − z_i| of two states (q, p, t)."""
    return mp.norm(mp.matrix(y) - mp.matrix(z), mp.inf)


def test_problem() -> System:
    """Return H, g and F(t) with no symmetry, separability or linearity to hide an error."""
    q = sp.symbols("q0:2", real=True)
    p = sp.symbols("p0:2", real=True)
    t = sp.Symbol("t", real=True)
    H = (
        p[0] ** 2 * (1 + q[1] ** 2 / 3) / 2 + p[1] ** 2 / 2 + p[0] * p[1] * q[0] / 4
        + q[1] + q[0] ** 2 * q[1] / 3
    )
    return System(q, p, (), H, (q[0] ** 2 + q[1] ** 2 + q[0] ** 3 / 5 - 1,), name="test_problem",
                  forces=(sp.cos(t), sp.sin(2 * t) / 2), time=t)


@cache
def _functions() -> dict[str, Callable[..., Any]]:
    """Return H_q, H_p, G, g of (*q, *p), F of (t,) of the test problem: name → mpmath function."""
    system = test_problem()
    variables = [*system.q, *system.p]
    expressions = {"H_q": system.H_q, "H_p": system.H_p, "G": system.G[0],
                   "g": system.constraints[0]}
    functions = {name: sp.lambdify(variables, expression, "mpmath")
                 for name, expression in expressions.items()}
    return functions | {"F": sp.lambdify([system.time], list(system.forces), "mpmath")}


@dataclass
class _Spark:
    """A step of a SPARK method on the test problem, with plain loops in mpmath.

    Attributes
    ----------
    tab : NumericTableau
        Its coefficients.
    s, p : int
        Numbers of its stages and of the multipliers Λ_l of a step.
    """

    tab: NumericTableau
    s: int
    p: int

    def start(self) -> list[Any]:
        """Return a state (q, p, t) with g(q) = 0 and g_q H_p = 0: five numbers."""
        f = _functions()
        q0 = mp.mpf(2) / 5
        q = [q0, mp.sqrt(1 - q0**2 - q0**3 / 5)]
        p = [mp.mpf(1), mp.mpf(0)]
        # G does not depend on p: 0 stands in its arguments
        p[1] = mp.findroot(lambda x: mp.fdot(f["G"](*q, 0, 0), f["H_p"](*q, p[0], x)), -1.0)
        return [*q, *p, mp.mpf(1) / 3]

    def step(self, y: list[Any], h: Any) -> list[Any]:
        """Return the state one step later; p₁ is projected along Gᵀ onto G H_p(q₁, p₁) = 0."""
        x = self._solve(y, h)
        s, q, p = self.s, y[:2], y[2:4]
        k, k_hat = self._rates(x)
        q1 = [q[a] + h * mp.fdot(self.tab.b, (row[a] for row in k)) for a in range(2)]
        force = self._forces(q, k, x[4 * s :], h)
        p1 = [
            p[a] + h * mp.fdot(self.tab.b_hat, (row[a] for row in k_hat))
            + h * mp.fdot(self.tab.b_tilde[: self.p], (row[a] for row in force))
            for a in range(2)
        ]
        G = _functions()["G"](*q1, 0, 0)

        def defect(impulse: Any) -> Any:
            """Return G H_p(q₁, p₁ − Gᵀ impulse), which is to vanish."""
            momentum = [p1[a] - impulse * G[a] for a in range(2)]
            return mp.fdot(G, _functions()["H_p"](*q1, *momentum))

        impulse = defect(0) / (defect(0) - defect(1))  # H is quadratic in p: linear in the impulse
        return [*q1, *(p1[a] - impulse * G[a] for a in range(2)), y[4] + h]

    def _rates(self, x: list[Any]) -> tuple[list[Any], list[Any]]:
        """Return the rates k_i and k̂_i of the stages, pairs of numbers, from the unknowns x.

        x = (k_1, …, k_s, k̂_1, …, k̂_s, Λ_0, …), with two numbers in each rate.
        """
        s = self.s
        return ([x[2 * i : 2 * i + 2] for i in range(s)],
                [x[2 * s + 2 * i : 2 * s + 2 * i + 2] for i in range(s)])

    def _forces(self, q: list[Any], k: list[Any], multipliers: list[Any], h: Any) -> list[Any]:
        """Return k̃_l = −G(Q̃_l)Λ_l, l = 0..p−1, the constraint force at each of its nodes."""
        force = []
        for row, multiplier in zip(self.tab.A_bar[: self.p], multipliers, strict=True):
            Q = [q[a] + h * mp.fdot(row, (rate[a] for rate in k)) for a in range(2)]
            force.append([-multiplier * g for g in _functions()["G"](*Q, 0, 0)])
        return force

    def _residual(self, x: list[Any], y: list[Any], h: Any) -> list[Any]:
        """Return the residual of the equations of the stages, with 2s + 2s + p numbers.

        k_i = H_p(Q_i, P_i), k̂_i = −H_q(Q_i, P_i) + F(t + c_i h) without constraint forces, and
        g = 0 at the nodes of the constraints after the first, divided by h².
        """
        f, s, q, p = _functions(), self.s, y[:2], y[2:4]
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
            F = f["F"](y[4] + self.tab.c[i] * h)
            by_k_hat += [a + b - c for a, b, c in zip(k_hat[i], f["H_q"](*Q, *P), F, strict=True)]
        constraints = []
        for row in self.tab.A_bar[1:]:
            Q = [q[a] + h * mp.fdot(row, (rate[a] for rate in k)) for a in range(2)]
            constraints.append(f["g"](*Q, 0, 0) / h**2)  # of the size of the multipliers
        return [*by_k, *by_k_hat, *constraints]

    def _solve(self, y: list[Any], h: Any) -> list[Any]:
        """Return the unknowns (k, k̂, Λ) of a step by Newton's method, with an inverse Jacobian in
        doubles.

        The inverse is evaluated again only while an iteration gains less than two digits.
        """
        f, s = _functions(), self.s
        H_p, H_q = f["H_p"](*y[:4]), f["H_q"](*y[:4])
        # begin with the rates of the start in every stage, and without constraint forces
        x = [*(list(H_p) * s), *([-e for e in H_q] * s), *([mp.mpf(0)] * self.p)]
        inverse = None
        size, floor = mp.inf, mp.mpf(10) ** (12 - mp.mp.dps) / h**2  # as constraints are divided
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
        """Return dr/dx of a step h from y in doubles; ``r`` is the residual at x.

        The difference is half the working digits: its quotient has the other half.
        """
        delta = mp.mpf(10) ** (-mp.mp.dps // 2)
        columns = []
        for i in range(len(x)):
            neighbour = [*x[:i], x[i] + delta, *x[i + 1 :]]
            residual = self._residual(neighbour, y, h)
            columns.append([float((a - b) / delta) for a, b in zip(residual, r, strict=True)])
        return np.array(columns).T


def _inverse(matrix: Any) -> Any:
    """Return the inverse of a matrix; raise ArithmeticError if it is singular."""
    try:
        return np.linalg.inv(matrix)
    except np.linalg.LinAlgError as error:
        raise ArithmeticError("A step's equations are singular.") from error
