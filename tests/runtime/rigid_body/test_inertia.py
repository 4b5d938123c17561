"""The means of the moments: values of the paper, order of axes, bounds, refusals."""

from __future__ import annotations

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.runtime.rigid_body.gamma_rules import gamma_h, gamma_h_tilde, gamma_m, gamma_m_tilde

ALL = [gamma_m, gamma_h, gamma_m_tilde, gamma_h_tilde]
FAST_TOP = (0.002, 0.002, 0.0008)

moments = st.tuples(*[st.floats(1e-9, 1e9)] * 3)


@pytest.mark.parametrize(
    ("function", "value"),
    [
        (gamma_m, 1 / 625),
        (gamma_h, 1 / 750),
        (gamma_m_tilde, 0.002),
        (gamma_h_tilde, 0.002),
    ],
)
def test_fast_top(function, value):
    assert function(FAST_TOP) == pytest.approx(value, rel=4e-16)


def test_formulas_of_the_paper():
    assert gamma_m((1, 2, 6)) == 3
    assert gamma_h((1, 2, 6)) == pytest.approx(3 / (1 + 1 / 2 + 1 / 6))
    assert gamma_m_tilde((1, 2, 6)) == 4
    assert gamma_h_tilde((1, 2, 6)) == pytest.approx(3)


@given(moments)
def test_axis_order_does_not_matter(inertia):
    for function in ALL:
        values = [function(order) for order in itertools.permutations(inertia)]
        assert values == pytest.approx([values[0]] * 6, rel=1e-15)


@given(moments)
def test_means_lie_between_the_moments_and_harmonic_below_arithmetic(inertia):
    least, middle, most = sorted(inertia)
    up = 1 + 1e-15
    assert least <= gamma_h(inertia) * up
    assert gamma_h(inertia) <= gamma_m(inertia) * up
    assert gamma_m(inertia) <= most * up
    assert middle <= gamma_h_tilde(inertia) * up
    assert gamma_h_tilde(inertia) <= gamma_m_tilde(inertia) * up
    assert gamma_h(inertia) <= gamma_h_tilde(inertia) * up


@given(moments)
def test_tilde_is_the_limit_of_a_vanishing_moment(inertia):
    least, middle, most = sorted(inertia)
    expected = gamma_m_tilde((least, middle, most)), gamma_h_tilde((least, middle, most))
    for flat in ([0, middle, most], [middle, 0, most], [middle, most, 0]):
        assert (gamma_m_tilde(flat), gamma_h_tilde(flat)) == pytest.approx(expected, rel=1e-15)


def test_sequences_of_every_kind():
    for inertia in ([1, 2, 6], (1, 2, 6), np.array([1, 2, 6]), np.array([1.0, 2.0, 6.0])):
        value = gamma_m(inertia)
        assert value == 3
        assert type(value) is float


@pytest.mark.parametrize("function", ALL)
@pytest.mark.parametrize(
    ("inertia", "words"),
    [
        ((1, 2), "has 2 moments"),
        ((1, 2, 3, 4), "has 4 moments"),
        ((), "has 0 moments"),
        ((1, -2, 3), "I2 = -2.0"),
        ((1, 2, math.nan), "I3 = nan"),
        ((math.inf, 2, 3), "I1 = inf"),
        ((0, 1, 0), "I1 = 0.0"),
        (("1", "2", "3"), "three"),
        ((1, None, 3), "three"),
        ((1, 2j, 3), "three"),
        (3, "three"),
        ((1, 2, 10**400), "three"),
    ],
)
def test_refusals(function, inertia, words):
    with pytest.raises(InputError, match=words):
        function(inertia)


@pytest.mark.parametrize("function", [gamma_m, gamma_h])
def test_a_vanishing_moment_needs_the_tilde(function):
    with pytest.raises(InputError, match=r"I3 = 0\.0 kg m²"):
        function((1, 2, 0))


# ---------------------------------------------------------------- the γ of fewest sweeps


def test_gamma_fast_is_for_symmetric_bodies_that_spin_about_their_axis():
    from gyrospark import gamma_fast

    top = (0.002, 0.002, 0.0008)
    assert gamma_fast(top, [0, 5, 100]) == 1.1 * 0.0008
    assert gamma_fast((0.0008, 0.002, 0.002), [-100, 5, 0]) == 1.1 * 0.0008
    assert gamma_fast(top, [60, 5, 100]) == gamma_m(top)  # not about its axis
    assert gamma_fast((0.002, 0.0013, 0.0008), [0, 0, 100]) == gamma_m((0.002, 0.0013, 0.0008))
    for omega in ([1, 2], [0, 0, np.nan], [0, np.inf, 0]):
        with pytest.raises(gs.InputError, match="three"):
            gamma_fast(top, omega)


@pytest.mark.slow  # a stepper of eight stages
def test_gamma_fast_costs_no_sweeps_and_changes_nothing():
    """It saved a tenth of them until starts were learnt from the motion; now they are the same."""
    top, step = gs.problems.fast_top(), gs.stepper("G-L", 8)
    run = {"dt": 0.02, "steps": 200}
    many, few = (step.integrate(top.q0, top.p0, parameters=top.parameters | {"gamma": g}, **run)
                 for g in (gamma_m(top.inertia), gs.gamma_fast(top.inertia, [0, 0, 126])))
    assert few.iterations.mean() < 1.05 * many.iterations.mean()
    assert np.abs(few.q - many.q).max() < 1e-11


def test_exact_moments_have_exact_means():
    third, half, fifth = Fraction(1, 3), Fraction(1, 2), Fraction(1, 5)
    moments = (third, half, fifth)
    assert gamma_m(moments) == (third + half + fifth) / 3
    assert gamma_m_tilde(moments) == (third + half) / 2
    assert gamma_h_tilde(moments) == 2 / (1 / third + 1 / half)
