"""A pendulum that has all that derivatives are by."""

from __future__ import annotations

import sympy as sp

import gyrospark as gs

x, y, px, py, t = sp.symbols("x y px py t", real=True)
m, g, length, c, a = sp.symbols("m g l c a", positive=True)
u = sp.Symbol("u", real=True)

#: A pendulum whose pivot moves, with a spring that time changes, damping and an input.
DRIVEN = gs.System((x, y), (px, py), (m, g, length, c, a),
                   H=(px**2 + py**2) / (2 * m) + m * g * y + a * sp.cos(3 * t) * x**2,
                   constraints=[x**2 + (y - a * sp.sin(2 * t))**2 - length**2],
                   forces=(-c * px * py + u, -c * py + sp.sin(5 * t)), time=t, inputs=(u,),
                   quantities={"along": x * sp.cos(t) + a * px - y * length},
                   name="driven")
VALUES = {"m": 1.1, "g": 9.81, "l": 0.9, "c": 0.3, "a": 0.2, "u": 0.4}
