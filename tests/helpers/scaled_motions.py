"""Motions of systems in scaled time by a second way: equations without multipliers, constraints or
time scale, in other coordinates, by extrapolation of order 24 in 40 digits.

``MOTIONS`` has names of the catalogue; ``states(name)`` has (q, p) at the start and at ``t_end`` in
long double, from ``data/scaled_motions.json``, which ``PYTHONPATH=. python
tests/helpers/scaled_motions.py`` writes.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
import sympy as sp

from benchmarks.extrapolation import extrapolated

DIGITS = Path(__file__).parent.parent / "data" / "scaled_motions.json"
Numbers = Sequence[Any]
Formulas = tuple[Callable[..., list[Any]], list[Any], Callable[[Any, Numbers], list[Any]]]


@dataclass(frozen=True)
class Motion:
    """y' = rates(t, y), y(t0) = start; ``formulas`` returns rates, start, and (q, p) of t and y."""

    t_end: str
    formulas: Callable[[], Formulas]
    t0: str = "0"
    steps: int = 60


def digits(name: str) -> list[list[str]]:
    """Return (q, p) at the start and at the end, of which twice as many steps have 20 digits."""
    motion = MOTIONS[name]
    with mp.workdps(40):
        rates, start, state = motion.formulas()
        begin, end = mp.mpf(motion.t0), mp.mpf(motion.t_end)
        coarse, fine = (state(end, extrapolated(
            lambda _, z: [mp.mpf(1), *rates(z[0], z[1:])], [begin, *start], (end - begin) / steps,
            steps, 12)[1:]) for steps in (motion.steps, 2 * motion.steps))
        assert max(abs(x - y) for x, y in zip(coarse, fine, strict=True)) < mp.mpf(10) ** -20
        return [[mp.nstr(x, 22) for x in numbers] for numbers in (state(begin, start), fine)]


def states(name: str) -> tuple[Any, Any]:
    """Return (q, p) at the start and at the end in long double."""
    stored = json.loads(DIGITS.read_text(encoding="utf-8"))[name]
    start, end = (np.array([np.longdouble(x) for x in numbers]) for numbers in stored)
    return start, end


# ---------------------------------------------------------------- orbits


def kepler(e: str) -> Callable[[], Formulas]:
    """Return Kepler's motion from the pericentre, in closed form: E − e sin E = t."""
    def formulas() -> Formulas:
        number = mp.mpf(e)

        def state(t: Any, z: Numbers) -> list[Any]:
            E = mp.findroot(lambda E: E - number * mp.sin(E) - t, (t, t + number),
                            solver="anderson", tol=mp.mpf(10) ** -60)
            across, rate = mp.sqrt(1 - number**2), 1 / (1 - number * mp.cos(E))
            return [mp.cos(E) - number, across * mp.sin(E),
                    -mp.sin(E) * rate, across * mp.cos(E) * rate]

        return lambda t, z: [], [], state

    return formulas


def _pair() -> Any:
    """Return the motion of masses 1/2 on a rod of length 1/20, each pulled by 1/(2 r²), by its
    angle."""
    length = mp.mpf(1) / 20

    def state(t: Any, z: Numbers) -> list[Any]:
        c, s = length / 2 * mp.cos(z[2]), length / 2 * mp.sin(z[2])
        return [z[0] - c, z[1] - s, z[0] + c, z[1] + s, (z[3] + s * z[5]) / 2,
                (z[4] - c * z[5]) / 2, (z[3] - s * z[5]) / 2, (z[4] + c * z[5]) / 2]

    def rates(t: Any, z: Numbers) -> list[Any]:
        ax, ay, bx, by = state(t, z)[:4]
        ra, rb = mp.hypot(ax, ay) ** 3, mp.hypot(bx, by) ** 3
        fa, fb = (-ax / ra / 2, -ay / ra / 2), (-bx / rb / 2, -by / rb / 2)
        difference = (mp.cos(z[2]) * (fb[1] - fa[1]) - mp.sin(z[2]) * (fb[0] - fa[0]))
        return [*z[3:], fa[0] + fb[0], fa[1] + fb[1], 2 * difference / length]

    speed = mp.sqrt(mp.mpf("1.7") / mp.mpf("0.3"))
    start = [mp.mpf("0.3"), mp.mpf(0), mp.pi / 2, mp.mpf(0), speed, mp.mpf(-4)]
    return rates, start, state


def _pendulum() -> Any:
    """Return the motion on the breathing ellipse x = (l + sin 2t / 4) cos a, y = sin a, with
    forces."""
    t, a, rate = sp.symbols("t a w")
    angle = sp.Function("a")(t)
    m, k, g, length = map(sp.Rational, (1.1, 7.0, 2.0, 1.4))  # the catalogue's doubles
    x, y = (length + sp.sin(2 * t) / 4) * sp.cos(angle), sp.sin(angle)
    L = m * (x.diff(t)**2 + y.diff(t)**2) / 2 - k * x**4 / 4 - g * y * x
    F = (-m * x.diff(t) / 5, sp.sin(3 * t) / 5)
    speed, slope = angle.diff(t), sp.Symbol("b")
    equation = (L.diff(speed).diff(t) - L.diff(angle)
                - F[0] * x.diff(angle) - F[1] * y.diff(angle))
    equation = equation.subs(angle.diff(t, 2), slope).subs(speed, rate).subs(angle, a)
    remainder = equation.subs(slope, 0)
    acceleration = sp.lambdify([t, a, rate], -remainder / (equation.diff(slope)), "mpmath")
    state = [e.subs(speed, rate).subs(angle, a) for e in (x, y, m * x.diff(t), m * y.diff(t))]
    return (lambda time, z: [z[1], acceleration(time, *z)], [mp.mpf("0.8"), mp.mpf("-0.3")],
            sp.lambdify([t, (a, rate)], state, "mpmath"))


def _satellite() -> Any:
    """Return position, quaternion and body rates, by Euler's equations."""
    inertia, mass = [mp.mpf(text) for text in ("1.3", "1", "0.7")], mp.mpf("0.01")

    def rates(t: Any, z: Numbers) -> list[Any]:
        x, v, (a, b, c, d), w = z[:3], z[3:6], z[6:10], z[10:]
        R = [[1 - 2 * (c*c + d*d), 2 * (b*c - a*d), 2 * (b*d + a*c)],
             [2 * (b*c + a*d), 1 - 2 * (b*b + d*d), 2 * (c*d - a*b)],
             [2 * (b*d - a*c), 2 * (c*d + a*b), 1 - 2 * (b*b + c*c)]]
        r2 = sum(e * e for e in x)
        r = mp.sqrt(r2)
        n = [sum(R[i][j] * x[i] for i in range(3)) / r for j in range(3)]
        In = [moment * e for moment, e in zip(inertia, n, strict=True)]
        pull = [3 * sum(R[i][j] * In[j] for j in range(3)) / r2**2 for i in range(3)]
        radial = mp.mpf("7.5") * sum(e * f for e, f in zip(n, In, strict=True)) / r2**2
        spun = [moment * e for moment, e in zip(inertia, w, strict=True)]
        torque = [3 / r**3 * (n[i-2] * In[i-1] - n[i-1] * In[i-2]) for i in range(3)]
        turn = [w[i-2] * spun[i-1] - w[i-1] * spun[i-2] for i in range(3)]
        return [*v, *(-e / r**3 - mass * (f - radial * e / r)
                      for e, f in zip(x, pull, strict=True)),
                (-b*w[0] - c*w[1] - d*w[2]) / 2, (a*w[0] + c*w[2] - d*w[1]) / 2,
                (a*w[1] - b*w[2] + d*w[0]) / 2, (a*w[2] + b*w[1] - c*w[0]) / 2,
                *((e - f) / moment for e, f, moment in zip(torque, turn, inertia, strict=True))]

    def state(t: Any, z: Numbers) -> list[Any]:
        a, b, c, d = z[6:10]
        m = [2 * mass * moment * rate for moment, rate in zip(inertia, z[10:], strict=True)]
        return [*z[:3], *z[6:10], *z[3:6], -b*m[0] - c*m[1] - d*m[2], a*m[0] - d*m[1] + c*m[2],
                d*m[0] + a*m[1] - b*m[2], -c*m[0] + b*m[1] + a*m[2]]

    start = [mp.mpf("0.3"), mp.mpf(0), mp.mpf(0), mp.mpf(0),
             mp.sqrt(mp.mpf("1.7") / mp.mpf("0.3")), mp.mpf(0),
             *(mp.mpf(text) for text in ("0.9", "0.1", "0.3", "0.3", "0.2", "0.1", "2"))]
    return rates, start, state


MOTIONS = {
    "eccentric": Motion("5.3", kepler("0.6"), steps=1),
    "very_eccentric": Motion("5.9", kepler("0.9"), steps=1),
    "tethered_pair": Motion("2.7", _pair),
    "scaled_pendulum": Motion("1.8", _pendulum, "0.3", 15),
    "eccentric_satellite": Motion("3.6", _satellite, steps=80),
}


if __name__ == "__main__":
    DIGITS.write_text(json.dumps({name: digits(name) for name in MOTIONS}, indent=1) + "\n",
                      encoding="utf-8")
