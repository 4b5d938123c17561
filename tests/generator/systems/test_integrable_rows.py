"""Rows of velocity constraints whose combinations are rates of functions of position."""

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.core.errors import InputWarning
from gyrospark.generator.systems.integrable_rows import (
    _rational,
    row_integrals,
    warn_of_row_integrals,
)
from gyrospark.generator.systems.numeric_system import numeric

x, y, th, f1, f2 = q = sp.symbols("x y th f1 f2", real=True)
vx, vy, w, w1, w2 = v = sp.symbols("vx vy w w1 w2", real=True)
p = sp.symbols("px py pth pf1 pf2", real=True)
b, r = sp.symbols("b r", positive=True)
t = sp.Symbol("t", real=True)
FORWARD, ACROSS = sp.cos(th) * vx + sp.sin(th) * vy, sp.cos(th) * vy - sp.sin(th) * vx
CAR = (FORWARD + b * w - r * w1, FORWARD - b * w - r * w2, ACROSS)


def car(*rows, **options):
    """Return a car with two driven wheels at a distance b from its middle."""
    return gs.System(q, p, (b, r), sum(e**2 for e in p) / 2, velocities=v, name="car",
                     velocity_constraints=rows, **options)


@pytest.mark.parametrize(("rows", "combination"), [
    (CAR, {"A0": 1, "A1": -1}),
    ((ACROSS,), None),
    ((vx - y * w, vy + x * w), None),  # x²+y² is kept, but by coefficients that are not constant
    ((vx - w1 * sp.cos(th), vy - w1 * sp.sin(th)), None),
    ((vx - w1 * sp.cos(th), vy - w1 * sp.sin(th), w - 2 * w1), {"A2": 1}),
    ((vx - r * w1,), {"A0": 1}),
    ((x * vx + y * vy - w,), {"A0": 1}),
    ((sp.exp(y) * (vx - r * w1),), {"A0": 1}),
    ((vx - sp.cos(2 * t),), {"A0": 1}),
])
def test_combinations_that_are_rates(rows, combination):
    system = car(*rows, **({"time": t} if any(e.has(t) for e in rows) else {}))
    integrals = row_integrals(system)
    assert [integral.rows for integral in integrals] == (
        [] if combination is None else [combination])
    for integral in integrals:  # its rate is a multiple of the combination
        phi = integral.expression
        rate = sp.Add(*(phi.diff(s) * u for s, u in zip(q, v, strict=True)), phi.diff(t))
        row = sp.Add(*(k * system.velocity_constraints[int(name[1:])]
                       for name, k in integral.rows.items()))
        ratio = sp.simplify(rate / row)
        assert not ratio.free_symbols & {*v}


def test_an_integral_takes_the_place_of_a_row():
    declared = car(*CAR, velocity_constraint_names=("left rim", "right rim", "axle"))
    reduced = declared.with_row_integrals()
    assert reduced.constraint_names == ("left rim",)
    assert reduced.velocity_constraint_names == ("right rim", "axle")
    values = {"b": 0.4, "r": 0.1, "left_rim_0": 0.0}
    rng = np.random.default_rng(3)
    positions, momenta = rng.standard_normal((2, 5))
    moved = gs.consistent(reduced, positions, momenta, parameters=values)
    before = numeric(declared, values)  # the same velocities
    assert np.abs(before.A(moved.q) @ moved.p).max() < 1e-14


def test_a_system_without_integrals_stays_and_echelon_rows_have_any_order():
    system = car(ACROSS)
    assert system.with_row_integrals() is system
    with pytest.warns(InputWarning, match=r"with_row_integrals"):
        warn_of_row_integrals(car(vx - r * w1))
    # With the largest entry of a column in a later row, and a column without a pivot.
    rows = np.array([[0.0, 0.0, 2.0], [0.5, 0.25, 3.0]])
    assert [*_rational(rows)] == [[1, sp.Rational(1, 2), 0], [0, 0, 1]]
