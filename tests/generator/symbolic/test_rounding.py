"""Running error bounds: above what rounding does, and not far above it."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.generator.symbolic.numeric_evaluation import Evaluator, evaluate, mp_context
from gyrospark.generator.symbolic.rounding_errors import rounding
from gyrospark.generator.symbolic.switching_functions import Max, Where
from strategies import EPS

x, y = sp.symbols("x y", real=True)
EXPRESSIONS = [
    1 - sp.cos(x), x**2 - y**2, sp.sqrt(x**2 + y**2) - 3, sp.exp(x) / (1 + y**2) - sp.sinh(y),
    (x + y) ** 5 - x**5, 1 / (x - y), x * y * (x + y) * sp.sin(x * y), sp.log(x**2 + 1) * sp.Abs(y),
    (x**2 + 1) ** y, sp.Rational(1, 3) * x + sp.tanh(y) - sp.atan(x),
    Max(x**2 - y, sp.exp(y)), Where(x, y, x**3 - x, y / 3), sp.sign(x) * y**2 + sp.floor(5 * y),
]


@settings(max_examples=30, derandomize=True)
@given(e=st.sampled_from(EXPRESSIONS), a=st.floats(-3, 3), b=st.floats(-3, 3),
       scale=st.sampled_from([1.0, 1e-3, 1e-6]))
def test_doubles_are_off_by_no_more(e: sp.Expr, a: float, b: float, scale: float) -> None:
    """Errors against 40 digits, at exact doubles, lie below the bound."""
    point = {x: a * scale, y: b * scale}
    context = mp_context(40)
    try:
        exact = Evaluator({s: context.mpf(v) for s, v in point.items()}, mp=context)(e)
    except ZeroDivisionError:
        return
    value, bound = float(evaluate([e], point)[0]), float(rounding([e], point, {})[0])
    if np.isfinite([value, bound]).all():  # √0 has no slope
        assert abs(value - exact) <= 2 * EPS * bound + 1e-300


def test_cancellation_is_counted() -> None:
    """The bound of 1 − cos x is 2 for any small x; the bound of x² − y² grows with the squares."""
    small = {x: 1e-6, y: 1e-6}
    assert rounding([1 - sp.cos(x)], small, {})[0] == pytest.approx(2, rel=1e-6)
    assert rounding([x**2 - y**2], {x: 3.0, y: 3.0}, {})[0] == pytest.approx(2 * 27, rel=0.2)


def test_errors_of_symbols_and_of_steps_that_look_at_them() -> None:
    # |f'| δx is added to the error of the operation itself.
    for e, slope, own_error in (
            (x**3, 12.0, 8.0), (sp.exp(x), np.exp(2), np.exp(2)), (x * y, 5.0, 10.0)):
        bound = rounding([e], {x: 2.0, y: 5.0}, {x: 100.0, y: 0.0})[0]
        assert bound == pytest.approx(100 * slope + own_error)
    # sign x is 1 or −1, however x is rounded; of two sides either may be taken.
    point, errors = {x: 0.0, y: 2.0}, {x: 1e6, y: 3.0}
    assert rounding([sp.sign(x)], point, errors)[0] == 0
    assert rounding([Max(x, y)], point, errors)[0] == 1e6 + 2
    assert rounding([Where(x, 1, y, sp.Integer(0))], point, errors)[0] == 3 + 2


def test_many_points_and_constants() -> None:
    points = {x: np.linspace(0, 1, 5), y: 2.0}
    bounds = rounding([x, sp.Integer(7), sp.Float(0.1), x * y], points, {})
    assert bounds.shape == (4, 5)
    assert (bounds[0] == points[x]).all()
    assert (bounds[1] == 0).all()
    assert bounds[2] == pytest.approx(0.1)
    assert bounds[3] == pytest.approx(6 * points[x])
    assert rounding([], points, {}).shape == (0, 5)
    assert mp.mp.dps == 15  # nobody's precision is changed
