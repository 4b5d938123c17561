"""The means of the moments: values of the paper, order of axes, bounds, refusals."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gyrospark as gs
from gyrospark.core.errors import InputError

RULES = ["m", "h", "mt", "ht"]

moments = st.tuples(*[st.floats(1e-9, 1e9)] * 3)


def test_formulas_of_the_paper():
    for inertia in ([1, 2, 6], np.array([1, 2, 6]), np.array([1.0, 2.0, 6.0]), (1, 2, 6)):
        assert gs.gamma(inertia) == 3
        assert type(gs.gamma(inertia)) is float
    assert gs.gamma((1, 2, 6), "h") == pytest.approx(3 / (1 + 1 / 2 + 1 / 6))
    assert gs.gamma((1, 2, 6), "mt") == 4
    assert gs.gamma((1, 2, 6), "ht") == pytest.approx(3)


@given(moments)
def test_axis_order_does_not_matter(inertia):
    for rule in RULES:
        values = [gs.gamma(order, rule) for order in itertools.permutations(inertia)]
        assert values == pytest.approx([values[0]] * 6, rel=1e-15)


@given(moments)
def test_means_lie_between_the_moments_and_harmonic_below_arithmetic(inertia):
    least, middle, most = sorted(inertia)
    up = 1 + 1e-15
    assert least <= gs.gamma(inertia, "h") * up
    assert gs.gamma(inertia, "h") <= gs.gamma(inertia) * up
    assert gs.gamma(inertia) <= most * up
    assert middle <= gs.gamma(inertia, "ht") * up
    assert gs.gamma(inertia, "ht") <= gs.gamma(inertia, "mt") * up
    assert gs.gamma(inertia, "h") <= gs.gamma(inertia, "ht") * up


@given(moments)
def test_tilde_is_the_limit_of_a_vanishing_moment(inertia):
    least, middle, most = sorted(inertia)
    expected = gs.gamma((least, middle, most), "mt"), gs.gamma((least, middle, most), "ht")
    for flat in ([0, middle, most], [middle, 0, most], [middle, most, 0]):
        assert (gs.gamma(flat, "mt"), gs.gamma(flat, "ht")) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(("inertia", "words"), [
    ((1, 2), "has 2 moments"), ((1, 2, 3, 4), "has 4 moments"), ((), "has 0 moments"),
    ((1, -2, 3), "I2 = -2.0"), ((1, 2, math.nan), "I3 = nan"), ((math.inf, 2, 3), "I1 = inf"),
    ((0, 1, 0), "I1 = 0.0"), (("1", "2", "3"), "three"), ((1, None, 3), "three"),
    ((1, 2j, 3), "three"), (3, "three"), ((1, 2, 10**400), "three")])
def test_refusals(rule, inertia, words):
    with pytest.raises(InputError, match=words):
        gs.gamma(inertia, rule)
    if rule in ("m", "h"):  # a vanishing moment needs the tilde
        with pytest.raises(InputError, match=r"I3 = 0\.0 kg m²"):
            gs.gamma((1, 2, 0), rule)
    with pytest.raises(InputError, match=r"'fast'.*ht"):
        gs.gamma((1, 2, 2), "fast")
