"""Units in FMI's spelling: products and quotients of SI units, "kg.m2", "N.m/rad", "m/s2"."""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from typing import TypeAlias

from .arguments import proposal, shown
from .errors import InputError

__all__ = ["DIMENSIONLESS", "Dimensions", "base_units", "product_dimensions", "unit_name"]

#: Base unit → exponent, without zeros.
Dimensions: TypeAlias = Mapping[str, Fraction]

_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
#: Coherent units with names of their own.
_NAMED = {
    "N": "kg.m/s2", "J": "kg.m2/s2", "W": "kg.m2/s3", "Pa": "kg/m/s2", "Hz": "1/s", "C": "A.s",
    "V": "kg.m2/s3/A", "Ohm": "kg.m2/s3/A2", "F": "A2.s4/kg/m2", "H": "kg.m2/s2/A2",
    "Wb": "kg.m2/s2/A", "T": "kg/s2/A",
}
#: Spellings that people expect where several are possible; J before N.m, of equal dimensions.
_USUAL = ("J", "N", "W", "N/m", "N.s/m", "N.m.s", "Pa")
_FACTOR = re.compile(r"(1|[A-Za-z]+)(-?\d+)?")
DIMENSIONLESS: Dimensions = {}


def product_dimensions(*parts: tuple[Dimensions, Fraction | int]) -> dict[str, Fraction]:
    """Return the dimensions of a product of powers."""
    exponents: dict[str, Fraction] = {}
    for dimensions, power in parts:
        for unit, exponent in dimensions.items():
            exponents[unit] = exponents.get(unit, Fraction(0)) + exponent * power
    return {unit: exponent for unit, exponent in exponents.items() if exponent}


def base_units(text: str) -> dict[str, Fraction]:
    """Return the exponents of kg, m, s, A, K, mol, cd and rad of a unit.

    A dot multiplies, a slash divides by the next factor, a number behind a name is its exponent;
    "1" is the unit of a pure number. Raises InputError for text that is no product of SI units
    without prefixes.
    """
    dimensions: dict[str, Fraction] = {}
    parts = re.split(r"([./])", text if isinstance(text, str) else "")
    # "kg.m2/s" is split into kg . m2 / s: a factor, and the sign before each further one
    for sign, factor in zip([".", *parts[1::2]], parts[::2], strict=True):
        match = _FACTOR.fullmatch(factor.strip())
        name = match[1] if match else ""
        if not match or (name != "1" and name not in _BASE and name not in _NAMED):
            unit_names = [*_BASE, *_NAMED]
            raise InputError(f"The unit {shown(text)} is no product of {', '.join(unit_names)}; "
                             'write one such as "kg.m2" or "N.m/rad"'
                             f"{proposal(factor, unit_names)}.")
        factor_dimensions: dict[str, Fraction] = {}
        if name in _BASE:
            factor_dimensions = {name: Fraction(1)}
        elif name != "1":
            factor_dimensions = base_units(_NAMED[name])
        power = int(match[2] or 1) * (1 if sign == "." else -1)
        dimensions = product_dimensions((dimensions, 1), (factor_dimensions, power))
    return dimensions


def unit_name(dimensions: Dimensions) -> str | None:
    """Return the spelling of dimensions; None if an exponent is no whole number."""
    if any(e.denominator != 1 for e in dimensions.values()):
        return None
    for usual_name in _USUAL:
        if base_units(usual_name) == dimensions:
            return usual_name
    above: list[str] = []
    below: list[str] = []
    for unit in _BASE:
        power = int(dimensions.get(unit, 0))
        if power:
            factor = unit if abs(power) == 1 else f"{unit}{abs(power)}"
            (above if power > 0 else below).append(factor)
    return "/".join([".".join(above) or "1", *below])
