"""Units in FMI's spelling."""

from __future__ import annotations

from fractions import Fraction

import pytest

from gyrospark.core.errors import InputError
from gyrospark.core.units import base_units, product_dimensions, unit_name


@pytest.mark.parametrize(("text", "expected"), [
    ("kg.m2", {"kg": 1, "m": 2}), ("N.m/rad", {"kg": 1, "m": 2, "s": -2, "rad": -1}),
    ("J.s", {"kg": 1, "m": 2, "s": -1}), ("m.s-2", {"m": 1, "s": -2}), ("1/s", {"s": -1}),
    ("1", {}), ("Hz.s", {}),
])
def test_units_are_powers_of_base_units(text, expected):
    assert base_units(text) == expected


@pytest.mark.parametrize("text", ["kg·m²", "", "km", "m/", "deg", "N m", "kg.m^2", 3, None])
def test_other_text_is_refused(text):
    with pytest.raises(InputError, match=r'such as "kg\.m2"'):
        base_units(text)


@pytest.mark.parametrize("unit", ["J", "N", "kg.m2", "1/kg/m2", "m/s2", "rad/s", "1", "N.m.s"])
def test_names_are_read_again(unit):
    assert unit_name(base_units(unit)) == unit


def test_roots_of_units_have_no_name():
    half = product_dimensions((base_units("m"), Fraction(1, 2)))
    assert half == {"m": Fraction(1, 2)}
    assert unit_name(half) is None
