"""Steps of a splitting in NumPy, from its parts alone, and the equations of motion for comparison.

The state of a splitting is (q, l, p_r, t): coordinates of the system, angular momenta in space
axes, momenta of points.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gyrospark.generator.multibody.rigid_body import rotation_matrix
from gyrospark.generator.splitting.kicks import space_matrix
from gyrospark.generator.symbolic.shared_subexpressions import (
    Shared,
    parts_of,
    share_repeated,
    substitute,
)

Q = sp.symbols("q0:4", real=True)
_rotation = sp.lambdify([Q], rotation_matrix(Q))
_space = sp.lambdify([Q], space_matrix(Q))


def product(a, b):
    """Return the quaternion product a b."""
    return np.array([a[0] * b[0] - a[1:] @ b[1:],
                     *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


def exponential(w):
    """Return exp(w) of a pure quaternion w."""
    size = math.sqrt(w @ w)
    return np.array([math.cos(size), *(w * np.sinc(size / math.pi))])


def turn(x, w):
    """Return a vector turned by the rotation vector w."""
    c = _rotation(exponential(w / 2))
    return c @ x


def compiled(arguments, rows):
    """Return a function of the arguments in which repeated parts are temporaries."""
    rows = share_repeated(rows)
    parts = [e for e in parts_of(rows) if isinstance(e, Shared)]
    names = {e: sp.Symbol(f"temporary{k}") for k, e in enumerate(parts)}
    found = substitute([*(e.args[0] for e in parts), *rows], names)
    pairs, rows = list(zip(names.values(), found, strict=False)), found[len(parts):]
    return sp.lambdify(arguments, rows, cse=lambda _: (pairs, rows))


@dataclass
class State:
    """q of all coordinates, l of each body, p of all coordinates (points only), t."""

    q: np.ndarray
    l: np.ndarray  # noqa: E741
    p: np.ndarray
    t: float = 0.0


class Flows:
    """The flows of a splitting with numbers for its parameters."""

    def __init__(self, splitting, values):
        self.s, system = splitting, splitting.system
        self.values = {x: values[str(x)] for x in system.parameters}
        momenta = [x for body in splitting.bodies for x in body.l]
        self._arguments = [*system.q, *momenta, *system.p, system.time or sp.Symbol("t_unused")]
        self.kick_of = self._function(splitting.kick)
        self.gradient_of = self._function(splitting.gradient) if splitting.has_gradient else None

    def _number(self, e):
        return float(sp.sympify(e).xreplace(self.values))

    def _function(self, kick):
        rows = [e for N in kick.torques for e in N] + list(kick.forces)
        return compiled(self._arguments, substitute(rows, self.values))

    def start(self, q, p):
        """Return the state of q and p of the system."""
        l = [_space(q[list(b.q)]) @ p[list(b.q)] / 2 for b in self.s.bodies]  # noqa: E741
        return State(np.array(q, float), np.array(l), np.array(p, float))

    def momenta(self, x):
        """Return p of the system."""
        p = x.p.copy()
        for body, l in zip(self.s.bodies, x.l, strict=True):  # noqa: E741
            p[list(body.q)] = 2 * _space(x.q[list(body.q)]).T @ l
        return p

    def kick(self, x, t, kappa=0.0):
        """Kick for a time t with V + kappa G; with other forces by the midpoint rule."""
        l, p = x.l.copy(), x.p.copy()  # noqa: E741
        for part in (t / 2, t) if self.s.other_forces else (t,):
            at = [*x.q, *x.l.ravel(), *x.p, x.t]
            rates = np.array(self.kick_of(*at), float)
            if kappa:
                rates += kappa * np.array(self.gradient_of(*at), float)
            count = 3 * len(self.s.bodies)
            x.l, x.p = l + part * rates[:count].reshape(-1, 3), p.copy()
            for i, F in zip(self.s.points, rates[count:], strict=True):
                x.p[i] += part * F

    def free(self, x, t):
        """Run the exact flow of rotations, translations, drag and the time."""
        for b, body in enumerate(self.s.bodies):
            k = self._number(body.drag)
            s = (1 - math.exp(-k * t)) / k if k else t
            q, l = x.q[list(body.q)], x.l[b]  # noqa: E741
            for axis in body.axes:
                e = np.array([self._number(y) for y in axis.axis])
                rate = s * self._number(axis.d) * (_rotation(q) @ e) @ l + t * self._number(axis.c)
                q = product(q, exponential(rate * e / 2))
            q = product(exponential(s * self._number(body.a) * l / 2), q)
            x.q[list(body.q)], x.l[b] = q, l * math.exp(-k * t)
        move = self.s.translation
        if move is not None:
            drag = {i: self._number(k) for i, k in move.drag.items()}
            reach = {i: x.p[i] * (-math.expm1(-drag[i] * t) / drag[i] if i in drag else t)
                     for i in move.coordinates}
            for (i, j), e in move.inverse_mass.items():
                x.q[i] += self._number(e) * reach[j]
            for i, v in move.velocity.items():
                x.q[i] += t * self._number(v)
            for i, k in drag.items():
                x.p[i] *= math.exp(-k * t)
        for space in self.s.space:
            w = -t * np.array([self._number(e) for e in space.omega])
            for b in space.bodies:
                places = list(self.s.bodies[b].q)
                x.q[places], x.l[b] = product(exponential(w / 2), x.q[places]), turn(x.l[b], w)
            for places in space.points:
                for array in (x.q, x.p):
                    part = turn(np.array([array[i] if i >= 0 else 0.0 for i in places]), w)
                    for i, value in zip(places, part, strict=True):
                        array[i] = value if i >= 0 else array[i]
        x.t += t

    def further(self, x, t, *, backward=False):
        """Run the rotations beyond the exact flow, in their order or in reverse order."""
        for b, body in enumerate(self.s.bodies):
            for axis in body.further[::-1] if backward else body.further:
                places = list(body.q)
                e = np.array([self._number(y) for y in axis.axis])
                rate = self._number(axis.d) * (_rotation(x.q[places]) @ e) @ x.l[b]
                x.q[places] = product(x.q[places],
                                      exponential(t * (rate + self._number(axis.c)) * e / 2))

    def strang(self, x, h):
        """Run a symmetric step of order 2."""
        self.kick(x, h / 2)
        self.further(x, h / 2)
        self.free(x, h)
        self.further(x, h / 2, backward=True)
        self.kick(x, h / 2)

    def forward4(self, x, h):
        """Run Chin's forward step of order 4 with force gradients."""
        root, kappa = math.sqrt(3), -(2 - math.sqrt(3)) / 24 * h**2
        self.free(x, (1 - 1 / root) / 2 * h)
        self.kick(x, h / 2, kappa)
        self.free(x, h / root)
        self.kick(x, h / 2, kappa)
        self.free(x, (1 - 1 / root) / 2 * h)


def motion(system, values, q, p, t_end, steps):
    """Return q, p of ṗ = −H_q + F − g_qᵀλ at t_end by classical Runge-Kutta steps."""
    time = system.time or sp.Symbol("t_unused")
    known = {x: values[str(x)] for x in system.parameters}
    forces = system.forces or [sp.Integer(0)] * system.n
    right = sp.lambdify([*system.q, *system.p, time], [
        [e.xreplace(known) for e in system.H_p],
        [(F - e).xreplace(known) for F, e in zip(forces, system.H_q, strict=True)]], cse=True)
    blocks = [[system.q.index(x) for x in system.q if x in g.free_symbols]
              for g in system.constraints]

    def rates(y, t):
        n = system.n
        q_rate, p_rate = (np.array(e, float) for e in right(*y, t))
        for at in blocks:
            q = y[:n][at]
            p_rate[at] -= q * (q @ p_rate[at] + y[n:][at] @ q_rate[at]) / (q @ q)
        return np.concatenate([q_rate, p_rate])

    y, h = np.concatenate([q, p]), t_end / steps
    for k in range(steps):
        t = k * h
        k1 = rates(y, t)
        k2 = rates(y + h / 2 * k1, t + h / 2)
        k3 = rates(y + h / 2 * k2, t + h / 2)
        k4 = rates(y + h * k3, t + h)
        y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return y[: system.n], y[system.n :]
