"""Real numbers of any kind, exactly; rounded once; as text and back."""

from __future__ import annotations

import copy
import math
import pickle
from decimal import Decimal
from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.core.exact_numbers import Rounded, as_double, decimal, digits_of, exact, nearest
from gyrospark.runtime.bindings import binary128
from gyrospark.runtime.bindings.real_numbers import as_float, from_text, rounding

LONG = np.finfo(np.longdouble)


def whole(x):
    return Fraction(*x.as_integer_ratio())


@pytest.mark.parametrize(("value", "number"), [
    (3, Fraction(3)), (np.int8(-3), Fraction(-3)), (0.1, Fraction(0.1)), (-0.0, Fraction(0)),
    (np.float32(0.1), Fraction(float(np.float32(0.1)))),
    (np.longdouble(1) / 3, whole(np.longdouble(1) / 3)),
    (Decimal("0.1"), Fraction(1, 10)), (Fraction(1, 3), Fraction(1, 3)),
    (mp.mpf(1) / 4, Fraction(1, 4)),
    (binary128.quad(1) / 3, binary128.exact(binary128.quad(1) / 3)),
    (sp.Rational(1, 3), Fraction(1, 3)), (sp.Integer(7), Fraction(7)),
    (sp.Float("0.5", 50), Fraction(1, 2)), (Rounded(Fraction(1, 3)), Fraction(1, 3)),
    (Decimal("1e-99999999"), Fraction(0)), (mp.mpf(2) ** -99999999, Fraction(0)),
])
def test_numbers_of_any_kind(value, number):
    assert exact(value) == number
    assert isinstance(exact(value), Fraction)


@pytest.mark.parametrize("value", [sp.pi / 9, sp.sqrt(2), -sp.E**3, mp.pi, mp.phi], ids=str)
def test_constants_have_more_digits_than_any_type(value):
    """This holds for constants of mpmath, too, at any setting of its precision."""
    with mp.workdps(70):
        expected = mp.mpf(value) if not isinstance(value, sp.Expr) else mp.mpf(sp.N(value, 70))
    fraction = exact(value)
    with mp.workdps(70):
        assert abs(mp.mpf(fraction.numerator) / fraction.denominator
                   - expected) < abs(expected) * 1e-68


@pytest.mark.parametrize(("value", "number"), [
    (np.inf, math.inf), (-mp.inf, -math.inf), (Decimal("-inf"), -math.inf),
    (Fraction(10**10000), math.inf),
    (Decimal("-1e99999999"), -math.inf), (mp.mpf(2) ** 99999999, math.inf),
])
def test_infinity(value, number):
    assert exact(value) == number


@pytest.mark.parametrize("value", [np.nan, mp.nan, Decimal("nan"), np.longdouble("nan")], ids=str)
def test_nan(value):
    assert math.isnan(exact(value))


@pytest.mark.parametrize("value", [
    True, np.bool_(0), "0.1", "auto", None, 1j, mp.mpc(1), sp.Symbol("x"), sp.I, sp.oo, sp.nan,
    [1], np.array(1.0), np.timedelta64(1), np.datetime64("2020"), b"1"], ids=repr)
def test_what_is_no_real_number(value):
    assert exact(value) is None


DIGITS = st.text("0123456789", max_size=40)  # a regular expression takes a second to prepare


@given(st.sampled_from(["", "+", "-"]), st.tuples(DIGITS, st.sampled_from([".", ""]), DIGITS),
       st.one_of(st.just(""), st.integers(-999, 999).map("e{}".format),
                 st.integers(0, 999).map("E+{}".format)))
@settings(max_examples=15)
def test_decimals_are_read_exactly(sign, digits, exponent):
    text = f"{sign}{''.join(digits) if any(digits[::2]) else '0'}{exponent}"
    assert decimal(text) == Fraction(Decimal(text))
    assert as_double(decimal(text)) == float(text)


@pytest.mark.parametrize("text", ["nan", "-inf", "Infinity", " 1e-3\n", "1e999999999999999999"])
def test_words_and_ends_of_the_range(text):
    value = decimal(text)
    assert math.isnan(value) if text == "nan" else float(value) == float(text)
    assert decimal("-1e-99999999999999") == 0


@pytest.mark.parametrize("text", ["", "1_0", "٣", "0x1", "1e", "--1", "1 2", "pi", "1,5", "."])
def test_what_says_no_number(text):
    assert decimal(text) is None


fractions = st.builds(lambda m, d, e: Fraction(m, d) * Fraction(2) ** e,
                      st.integers(-2**200, 2**200), st.integers(1, 10**6), st.integers(-300, 300))


@given(fractions)
@settings(max_examples=60)
def test_the_nearest_number_of_a_type(value):
    """No neighbour is nearer; a tie goes to the even one."""
    for dtype in (np.float32, np.float64, np.longdouble):
        with np.errstate(over="ignore"):
            rounded = as_float(value, dtype)
            neighbours = [np.nextafter(rounded, dtype(end)) for end in (-np.inf, np.inf)]
        assert type(rounded) is dtype
        if np.isfinite(rounded) and np.isfinite(neighbours).all():
            error = abs(whole(rounded) - value)
            assert all(error <= abs(whole(x) - value) for x in neighbours)
    assert as_float(value, np.float64) == as_double(value)
    mantissa, exponent = nearest(value, 113, -16494)
    assert binary128.exact(binary128.round_to_quad(value)) == mantissa * Fraction(2) ** exponent


@pytest.mark.parametrize("x", [LONG.max, LONG.tiny, LONG.smallest_subnormal, LONG.tiny * 3 / 7])
def test_ends_of_the_long_doubles(x):
    for sign in (1, -1):
        assert as_float(whole(sign * x), np.longdouble) == sign * x
    assert as_float(2 * whole(LONG.max), np.longdouble) == np.inf
    assert as_float(whole(LONG.smallest_subnormal) / 2, np.longdouble) == 0  # a tie, to even


def test_ties_go_to_the_even_number():
    assert nearest(Fraction(2**60 + 2**7), 53, -2000) == (2**52, 8)
    assert nearest(Fraction(2**60 + 3 * 2**7), 53, -2000) == (2**52 + 2, 8)
    assert nearest(Fraction(2**54 - 1), 53, -2000) == (2**53, 1)  # one bit more: the next power


@given(fractions)
@settings(max_examples=60)
def test_digits_give_the_number_back(value):
    for real in ("long-double", "float128"):
        number = rounding(real)(value)
        if np.isfinite(float(number)) or not value:
            text = digits_of(number)
            assert from_text(text, real) == number
            assert isinstance(text, float) == (float(number) == number)


def test_short_decimals_stay_short():
    assert digits_of(binary128.round_to_quad(Fraction(1, 10))) == "0.1"
    assert digits_of(rounding("long-double")(Fraction(1, 10))) == "0.1"
    assert digits_of(binary128.quad(0.1)) == 0.1
    assert from_text(0.1, "float128") == binary128.quad(0.1)


@pytest.mark.parametrize(("value", "real"), [
    ("0.1", "double"), (None, "float128"), ("x", "float128"), ("nan", "float128"), (True, "double"),
    (10**30, "double"), ([1], "long-double"), (math.inf, "float128")])
def test_what_no_file_of_ours_holds(value, real):
    with pytest.raises(ValueError, match=r"number|huge"):
        from_text(value, real)


def test_a_double_that_knows_its_digits():
    tenth = Rounded(Fraction(1, 10))
    assert tenth == 0.1
    assert type(tenth + 1) is float
    assert repr(tenth) == "0.1"
    for copied in (copy.deepcopy(tenth), copy.copy(tenth), pickle.loads(pickle.dumps(tenth))):
        assert copied.whole == Fraction(1, 10)
    assert Rounded(Fraction(10) ** 400) == math.inf
    assert binary128.quad(tenth) == binary128.round_to_quad(Fraction(1, 10)) != binary128.quad(0.1)
