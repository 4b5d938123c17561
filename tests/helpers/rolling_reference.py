"""The rattleback in 30 digits, from equations without multipliers: ``rattleback.json``.

With the angular velocity w in the body's axes, the contact r(u), u = R(q)ᵀe_z and the velocity of
the centre v = r x w in the body's axes (Kane and Levinson 1982),

    (J - m [r][r]) w' = -w x J w + m r x (-w x r' + w x v + g u),   r' = r_u u x w.

Extrapolation of the explicit midpoint rule (Gragg, Bulirsch, Stoer) in 42 digits integrates them;
two lengths of steps tell how many digits are right. None of it is code of the package.

    python tests/helpers/rolling_reference.py        writes tests/data/rattleback.json
"""

import json
from decimal import Decimal, getcontext
from pathlib import Path

from rolling_systems import RATTLEBACK, rattleback_state

FILE = Path(__file__).parents[1] / "data" / "rattleback.json"


def _cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def _dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def _solve(A, b):
    """Return A⁻¹b of three equations, by Cramer's rule."""
    columns = list(zip(*A, strict=True))
    d = _dot(columns[0], _cross(columns[1], columns[2]))
    return [_dot(b, _cross(columns[1], columns[2])) / d,
            _dot(columns[0], _cross(b, columns[2])) / d,
            _dot(columns[0], _cross(columns[1], b)) / d]


def _rates(y, k):
    """Return the rates of x, y, the quaternion and w."""
    q, w = y[2:6], y[6:]
    a, b, c, d = q
    R = [[a*a + b*b - c*c - d*d, 2*(b*c - a*d), 2*(b*d + a*c)],
         [2*(b*c + a*d), a*a - b*b + c*c - d*d, 2*(c*d - a*b)],
         [2*(b*d - a*c), 2*(c*d + a*b), a*a - b*b - c*c + d*d]]
    u = R[2]
    Mu = [_dot(row, u) for row in k["M"]]
    root = _dot(u, Mu).sqrt()
    r = [-e / root for e in Mu]
    r[2] += k["h"]
    u_rate = _cross(u, w)
    Mu_rate = [_dot(row, u_rate) for row in k["M"]]
    along = _dot(Mu, u_rate) / root**3
    r_rate = [-e / root + f * along for e, f in zip(Mu_rate, Mu, strict=True)]
    v = _cross(r, w)
    Jw = [i * e for i, e in zip(k["J"], w, strict=True)]
    push = [-e + f + k["g"] * h for e, f, h in zip(_cross(w, r_rate), _cross(w, v), u, strict=True)]
    right = [-e + k["m"] * f for e, f in zip(_cross(w, Jw), _cross(r, push), strict=True)]
    rr = _dot(r, r)
    A = [[(k["J"][i] + k["m"] * rr if i == j else 0) - k["m"] * r[i] * r[j] for j in range(3)]
         for i in range(3)]
    L = [[-b, a, d, -c], [-c, -d, a, b], [-d, c, -b, a]]
    turn = [(w[0] * L[0][i] + w[1] * L[1][i] + w[2] * L[2][i]) / 2 for i in range(4)]
    return [*(_dot(row, v) for row in R[:2]), *turn, *_solve(A, right)]


def _extrapolated(y, h, k, columns):
    """Return y after h: midpoint steps of h/2, h/4, h/6, …, extrapolated in h²."""
    table = []
    for j in range(1, columns + 1):
        n = 2 * j
        step = h / n
        before, now = y, [a + step * b for a, b in zip(y, _rates(y, k), strict=True)]
        for _ in range(n - 1):
            before, now = now, [a + 2 * step * b
                                for a, b in zip(before, _rates(now, k), strict=True)]
        row = [[(a + b + step * c) / 2
                for a, b, c in zip(before, now, _rates(now, k), strict=True)]]
        for i, old in enumerate(table):
            ratio = Decimal(n) / (n - 2 * (i + 1))
            row.append([a + (a - b) / (ratio**2 - 1) for a, b in zip(row[-1], old, strict=True)])
        table = row
    return table[-1]


def reference(end, steps, columns):
    """Return coordinates, and w, of the rattleback at a time."""
    P = {name: Decimal(float(value)) for name, value in RATTLEBACK.items()}
    turn = [[P["ce"], P["se"], 0], [-P["se"], P["ce"], 0], [0, 0, 1]]
    axes = [P["a"], P["b"], P["c"]]
    M = [[sum(turn[e][i] * axes[e]**2 * turn[e][j] for e in range(3)) for j in range(3)]
         for i in range(3)]
    k = {"M": M, "m": P["m"], "g": P["gravity"], "h": P["h"],
         "J": [P["I1"], P["I2"], P["I3"]]}
    q0, _ = rattleback_state()
    q = [Decimal(float(e)) for e in q0[3:]]
    size = _dot(q, q).sqrt()
    y = [Decimal(0), Decimal(0), *(e / size for e in q), Decimal(0), Decimal(0), Decimal(-5)]
    for _ in range(steps):
        y = _extrapolated(y, Decimal(end) / steps, k, columns)
    return y


if __name__ == "__main__":
    getcontext().prec = 42
    rough, fine = reference(6, 4500, 16), reference(6, 6000, 16)
    error = max(abs(a - b) for a, b in zip(rough, fine, strict=True))
    print("two lengths of steps differ by", f"{error:.2e}")
    names = ["x", "y", "q0", "q1", "q2", "q3", "w1", "w2", "w3"]
    FILE.write_text(json.dumps({"t": 6, **{name: f"{value:.30e}" for name, value
                                           in zip(names, fine, strict=True)}}, indent=1) + "\n")
