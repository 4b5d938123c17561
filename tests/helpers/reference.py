"""A second stepper, in 50 digits, that shares no formula with gyrospark's generator.

The heavy top is typed by hand from the paper with its errata, not derived; the scheme is the
literal (53), (61) with (58)/(59) of erratum 5, or (A.1)-(A.7) with T1 and T2. The tableau's
numbers come from ``gs.tableau(...).numeric(60)``; tests/generator/tableaux/test_tableau.py proves
these.

One residual serves three kinds of numbers, NumPy arrays of float, complex or mpmath.mpf: the first
solves, the second differentiates (complex step), the third refines. With a frozen inverse of the
double Jacobian every evaluation in mpf gains about 14 digits, so a step costs about five.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mpmath as mp
import numpy as np

from strategies import Case, left, tableau_of

DIGITS = 50
WORKING_DIGITS = 62
#: Of the increments, relative to the unknowns; beyond DIGITS - 5 nothing is asked.
CONVERGED = 1e-45

Array = np.ndarray
Number = Callable[[Any], Any]


def numbers(values: Any, number: Number) -> Array:
    """Return an array of the same shape in other numbers; doubles turn into mpf exactly."""
    values = np.asarray(values, dtype=object)
    out = np.empty(values.shape, dtype=object)
    for index, value in np.ndenumerate(values):
        out[index] = number(value)
    return out if number is mp.mpf else out.astype(float)


def doubles(values: Any) -> Array:
    """Return the nearest doubles."""
    return np.array([float(x) for x in np.ravel(values)]).reshape(np.shape(values))


# ---------------------------------------------------------------- systems


@dataclass(frozen=True)
class Equations:
    """A system in some kind of numbers, as functions of arrays.

    ``mean_gradient(q0, p0, q1, p1)`` returns D_qH and D_pH of EMS, ``mean_constraint(q0, q1)`` its
    Ḡ; neither is needed by other schemes. ``F(q, p, t)`` are forces beside −H_q.
    """

    H: Callable[..., Any]
    H_q: Callable[..., Array]
    H_p: Callable[..., Array]
    g: Callable[..., Array]
    G: Callable[..., Array]
    mean_gradient: Callable[..., tuple[Array, Array]] | None = None
    mean_constraint: Callable[..., Array] | None = None
    F: Callable[..., Array] | None = None

    def minus_p_rate(self, q: Array, p: Array, t: Any) -> Array:
        """Return H_q − F."""
        return self.H_q(q, p) if self.F is None else self.H_q(q, p) - self.F(q, p, t)


#: A system: what kind of numbers → its equations in them.
System = Callable[[Number], Equations]


def heavy_top(parameters: dict[str, float], rep: str) -> System:
    """Return the heavy top, H = T + mgl qᵀKq, typed by hand in each kind of numbers."""

    def equations(number: Number) -> Equations:
        I1, I2, I3 = (number(parameters[name]) for name in ("I1", "I2", "I3"))
        mgl, weight = number(parameters["mgl"]), 1 / number(parameters[rep])
        shift = weight if rep == "gamma" else 0 * weight
        D = np.array([1 / I1 - shift, 1 / I2 - shift, 1 / I3 - shift])
        K = np.array([1, -1, -1, 1])

        def turned(x: Array, twice_l: Array) -> Array:
            return left(x).T @ (D * twice_l) / 4

        def H(q: Array, p: Array) -> Any:
            w = left(q) @ p
            extra = p @ p if rep == "gamma" else (q @ p) ** 2
            return (w @ (D * w) + weight * extra) / 8 + mgl * (q @ (K * q))

        def H_p(q: Array, p: Array) -> Array:
            extra = p if rep == "gamma" else (q @ p) * q
            return turned(q, left(q) @ p) + weight * extra / 4

        def H_q(q: Array, p: Array) -> Array:
            kinetic = turned(p, left(p) @ q)
            if rep == "alpha":
                kinetic = kinetic + weight * (p @ q) * p / 4
            return kinetic + 2 * mgl * K * q

        def mean_gradient(q0: Array, p0: Array, q1: Array, p1: Array) -> tuple[Array, Array]:
            q, p = (q0 + q1) / 2, (p0 + p1) / 2
            w = (left(q0) @ p0 + left(q1) @ p1) / 2  # the mean of L(q)p; of L(p)q it is −w
            D_q = turned(p, -w) + 2 * mgl * K * q  # ∂V*/∂q of a quadratic form: at the mean
            if rep == "gamma":
                return D_q, weight * p / 4 + turned(q, w)
            d = (q0 @ p0 + q1 @ p1) / 2
            return D_q + weight * d * p / 4, turned(q, w) + weight * d * q / 4

        return Equations(
            H, H_q, H_p,
            g=lambda q: np.array([q @ q - 1]),
            G=lambda q: np.array([2 * q]),
            mean_gradient=mean_gradient,
            mean_constraint=lambda q0, q1: np.array([q0 + q1]),
        )

    return equations


# ---------------------------------------------------------------- schemes


@dataclass(frozen=True)
class Coefficients:
    """A tableau in some kind of numbers."""

    A: Array
    A_hat: Array
    A_tilde: Array
    A_bar: Array
    b: Array
    b_hat: Array
    b_tilde: Array


def coefficients(scheme: str, stages: int, number: Number) -> Coefficients:
    tableau = tableau_of(scheme, stages)
    return Coefficients(*(numbers(getattr(tableau, name), number)
                          for name in Coefficients.__dataclass_fields__))


def spark_stages(
    e: Equations, t: Coefficients, dt: Any, q: Array, p: Array, x: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return k, k̂, k̃ of l = 0..p−1, and Q_i, P_i, Q̃_l of (A.7)."""
    s, n = len(t.b), len(q)
    k, k_hat = x[: s * n].reshape(s, n), x[s * n : 2 * s * n].reshape(s, n)
    multipliers = x[2 * s * n :].reshape(len(t.b_tilde) - 1, -1)
    Q, Q_tilde = q + dt * (t.A @ k), q + dt * (t.A_bar @ k)
    if multipliers.size:
        k_tilde = np.array([-(e.G(Q_l).T @ Lambda)
                            for Q_l, Lambda in zip(Q_tilde[:-1], multipliers, strict=True)])
    else:
        k_tilde = 0 * Q_tilde[:-1]
    P = p + dt * (t.A_hat @ k_hat + t.A_tilde[:, :-1] @ k_tilde)
    return k, k_hat, k_tilde, Q, P, Q_tilde


def spark_residual(
    e: Equations, t: Coefficients, dt: Any, q: Array, p: Array, x: Array, time: Any = 0
) -> Array:
    """Return (B.1) of erratum 11; stage i is at time + c_i dt, with c_i the row sums of A."""
    k, k_hat, _, Q, P, Q_tilde = spark_stages(e, t, dt, q, p, x)
    times = [time + dt * sum(row) for row in t.A]
    rates = [k_i - e.H_p(Q_i, P_i) for k_i, Q_i, P_i in zip(k, Q, P, strict=True)]
    forces = [k_i + e.minus_p_rate(Q_i, P_i, t_i)
              for k_i, Q_i, P_i, t_i in zip(k_hat, Q, P, times, strict=True)]
    return np.concatenate([*rates, *forces, *(e.g(Q_l) for Q_l in Q_tilde[1:])])


def mean_residual(
    e: Equations, scheme: str, dt: Any, q: Array, p: Array, x: Array, time: Any = 0
) -> Array:
    """Return (53) or (61); x = (q_k, p_k, λ)."""
    n = len(q)
    q1, p1, multiplier = x[:n], x[n : 2 * n], x[2 * n :]
    if scheme == "EMS":
        (D_q, D_p), G = e.mean_gradient(q, p, q1, p1), e.mean_constraint(q, q1)
    else:
        q_mean, p_mean = (q + q1) / 2, (p + p1) / 2
        D_q, D_p, G = e.H_q(q_mean, p_mean), e.H_p(q_mean, p_mean), e.G(q_mean)
    force = G.T @ multiplier if len(multiplier) else 0 * q
    if e.F is not None:
        force = force - e.F((q + q1) / 2, (p + p1) / 2, time + dt / 2)
    return np.concatenate([(q1 - q) / dt - D_p, (p1 - p) / dt + D_q + force, e.g(q1)])


@dataclass(frozen=True)
class Method:
    """A scheme on a system, from one state: its residual in any kind of numbers."""

    system: System
    scheme: str
    stages: int | None
    q: Array
    p: Array
    dt: float
    t: float = 0.0

    @property
    def n(self) -> int:
        return len(self.q)

    @property
    def m(self) -> int:
        return len(self.system(float).g(self.q))

    @property
    def p_nodes(self) -> int:
        """The number of multipliers that T1 determines for each constraint."""
        return len(tableau_of(self.scheme, self.stages).b_tilde) - 1

    def at(self, number: Number) -> tuple[Equations, Any, Array, Array]:
        return (self.system(number), number(self.dt), numbers(self.q, number),
                numbers(self.p, number))

    def residual(self, number: Number) -> Callable[[Array], Array]:
        """Return r(x) for x in these numbers (complex x goes with ``float``)."""
        e, dt, q, p = self.at(number)
        if self.stages is None:
            return lambda x: mean_residual(e, self.scheme, dt, q, p, x, number(self.t))
        t = coefficients(self.scheme, self.stages, number)
        return lambda x: spark_residual(e, t, dt, q, p, x, number(self.t))

    def guess(self) -> Array:
        """Return the start of the iteration: the rates, or the state, at the start of the step."""
        e, _, q, p = self.at(float)
        if self.stages is None:
            return np.concatenate([q, p, np.zeros(self.m)])
        rates = [np.tile(e.H_p(q, p), self.stages), np.tile(-e.H_q(q, p), self.stages)]
        return np.concatenate([*rates, np.zeros(self.m * self.p_nodes)])

    def jacobian(self, x: Array) -> Array:
        """Return dr/dx at doubles x from central differences in 62 digits, as doubles.

        With h = 1e-18 the truncation is 1e-36 and the round-off 1e-44, both relative.
        """
        with mp.workdps(WORKING_DIGITS):
            residual, x = self.residual(mp.mpf), numbers(x, mp.mpf)
            return differentiate(residual, x, mp.mpf(10) ** -18)

    def step(self) -> Step:
        """Return the step's end and multipliers as mpf, right to 45 digits."""
        with mp.workdps(WORKING_DIGITS):
            x = solve(self.residual(float), self.residual(mp.mpf), self.guess())
            e, dt, q, p = self.at(mp.mpf)
            if self.stages is None:
                return Step(x[: self.n], x[self.n : 2 * self.n], x[None, 2 * self.n :], x)
            t = coefficients(self.scheme, self.stages, mp.mpf)
            k, k_hat, k_tilde, *_ = spark_stages(e, t, dt, q, p, x)
            q1 = q + dt * (t.b @ k)
            P = p + dt * (t.b_hat @ k_hat + t.b_tilde[:-1] @ k_tilde)
            first = x[2 * self.n * self.stages :].reshape(self.p_nodes, -1)
            if not self.m:
                return Step(q1, P, first, x)
            G, weight = e.G(q1), dt * t.b_tilde[-1]
            last = self._project(q1, P, G)  # T2
            return Step(q1, P - G.T @ last, np.vstack([first, last[None] / weight]), x)

    def _project(self, q1: Array, P: Array, G: Array) -> Array:
        """Return μ with G H_p(q1, P − Gᵀμ) = 0 (A.6)."""

        def hidden(number: Number) -> Callable[[Array], Array]:
            e = self.system(number)
            position, momentum, normal = (a if number is mp.mpf else doubles(a) for a in (q1, P, G))
            return lambda mu: normal @ e.H_p(position, momentum - normal.T @ mu)

        return solve(hidden(float), hidden(mp.mpf), np.zeros(self.m))


@dataclass(frozen=True)
class Step:
    """The end of a step: q, p, multipliers (nodes × constraints), and T1's unknowns."""

    q: Array
    p: Array
    multipliers: Array
    x: Array


def reference(spec: Any, case: Case) -> Method:
    """Return the heavy top's method for a spec and a case."""
    return Method(heavy_top(case.parameters, spec.rep), spec.scheme, spec.stages, case.q, case.p,
                  case.dt)


# ---------------------------------------------------------------- solving


def differentiate(residual: Callable[[Array], Array], x: Array, h: Any) -> Array:
    """Return the Jacobian by central differences, as doubles."""
    columns = []
    for j in range(len(x)):
        forward, backward = x.copy(), x.copy()
        step = h * max(1, abs(x[j]))
        forward[j] += step
        backward[j] -= step
        columns.append(doubles((residual(forward) - residual(backward)) / (2 * step)))
    return np.array(columns).T


def complex_step(residual: Callable[[Array], Array], x: Array) -> Array:
    """Return the Jacobian in double by the complex step, right to round-off."""
    columns = []
    for j in range(len(x)):
        z = x.astype(complex)
        z[j] += 1e-30j
        columns.append(np.imag(residual(z)) / 1e-30)
    return np.array(columns).T


def solve(
    in_double: Callable[[Array], Array], in_digits: Callable[[Array], Array], x: Array
) -> Array:
    """Return the root near x in mpf: chord iterations in double, then in 62 digits."""
    x = np.asarray(x, dtype=float)
    for _ in range(2):
        inverse = np.linalg.inv(complex_step(in_double, x))
        previous = np.inf
        for _ in range(60):
            dx = inverse @ in_double(x)
            size = relative(dx, x)
            if not size < previous:
                break
            x, previous = x - dx, size
    inverse = np.linalg.inv(complex_step(in_double, x))
    x = numbers(x, mp.mpf)
    for _ in range(20):
        r = in_digits(x)
        size = max(abs(r_i) for r_i in r)
        if size == 0:
            return x
        dx = numbers(inverse @ doubles(r / size), mp.mpf) * size
        x = x - dx
        if relative(dx, x) < CONVERGED:
            return x
    raise AssertionError(f"the reference did not converge: {mp.nstr(relative(dx, x))}")


def relative(dx: Array, x: Array) -> Any:
    """Return the largest increment relative to the largest unknown, or to one."""
    return max(abs(d) for d in dx) / max(1, *(abs(x_i) for x_i in x))
