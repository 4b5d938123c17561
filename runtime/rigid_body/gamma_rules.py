"""The means of the principal moments that the paper recommends for γ (or α): (47), (48), (50).

An inertia is three principal moments, or the tensor in body axes, 3 × 3, in kg m². Moments with
more digits than a double's (mpmath numbers, Decimal, Fraction) have means with more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any

from ...core.arguments import choose
from ...core.errors import InputError
from ...core.exact_numbers import Rounded, as_double, exact
from ...core.inertia import (
    InertiaLike,
    Moments,
    as_moments,
    as_moments_or_tensor,
    is_tensor,
    moments_of,
    tensor_of_inverse,
)
from ...core.registry import MEANS, Mean
from ...core.start import Rule

__all__ = ["gamma", "gamma_by_rule", "has_inertia", "inertia_names", "inertia_of",
           "is_inertia_parameter", "known_inertia", "mean_inertia", "principal_moments"]


def gamma(inertia: InertiaLike, rule: Mean = "m") -> float:
    """Return a mean of the principal moments, which the paper recommends for γ and α, in kg m².

    Parameters
    ----------
    inertia : sequence of three numbers, or 3 × 3
        The principal moments, or the tensor in body axes. Fractions have an exact arithmetic mean.
    rule : {"m", "h", "mt", "ht"}
        γ_m = (I₁ + I₂ + I₃)/3 (48), γ_h = 3/(1/I₁ + 1/I₂ + 1/I₃) (47); γ̃_m and γ̃_h are the same
        means of the two largest moments (50), the smallest of which may be 0.

    Raises
    ------
    InputError
        Unless there are three finite moments above 0, or a tensor that has such; for another rule.

    Examples
    --------
    >>> import gyrospark as gs
    >>> gs.gamma((1, 2, 6)), gs.gamma((1, 2, 6), "mt")
    (3.0, 4.0)
    """
    return mean_inertia(inertia, choose("rule", rule, MEANS))


def mean_inertia(inertia: InertiaLike, rule: str = "m") -> float:
    """Return a mean of the principal moments, in kg m², as ``gamma`` for a checked rule."""
    of_two_largest = rule.endswith("t")
    # a mean of the two largest moments exists if the smallest is 0
    moments = _two_or_three(inertia) if of_two_largest else principal_moments(inertia)
    mean = _arithmetic if rule.startswith("m") else _harmonic
    return _mean(inertia, moments, mean, largest=2 if of_two_largest else 3)


def principal_moments(inertia: InertiaLike) -> Moments:
    """Return the three principal moments I₁, I₂, I₃ as floats, in kg m².

    Those of a tensor come in rising order. Raises InputError unless there are three finite moments
    above 0, or a tensor that has such.
    """
    return moments_of(as_moments_or_tensor(inertia))


def is_inertia_parameter(name: str) -> bool:
    """Whether a parameter has the name of a body's γ or α: gamma, a_gamma, …"""
    return name.rpartition("_")[2] in ("gamma", "alpha")


def has_inertia(name: str, parameters: Mapping[str, Any]) -> bool:
    """Whether a parameter is γ or α of a body whose inertia is among the parameters too."""
    prefix = name.removesuffix("gamma").removesuffix("alpha")
    return is_inertia_parameter(name) and not parameters.keys().isdisjoint(
        (f"{prefix}I1", f"{prefix}K11"))


def inertia_names(name: str) -> tuple[list[str], list[str]]:
    """Return the names of the moments that belong to an inertia parameter, and of the entries of
    J⁻¹."""
    prefix = name.removesuffix("gamma").removesuffix("alpha")
    return ([f"{prefix}I{axis}" for axis in (1, 2, 3)],
            [f"{prefix}K{pair}" for pair in ("11", "12", "13", "22", "23", "33")])


def gamma_by_rule(name: str, rule: Rule, parameters: Mapping[str, Any]) -> float:
    """Return γ or α as a mean of the inertia among the parameters, else of the inertia of the rule.

    Raises InputError for a search, and where there is no inertia.
    """
    if rule.name not in MEANS:
        kind = "gamma" if is_inertia_parameter(name) else "frame"
        raise InputError(f"Parameter {name} is left to a search ({rule.name}), which looks at a "
                         "single run; give a number, such as that of gyrospark.tune(step, start, "
                         f"dt=..., {kind}='auto').parameters.")
    # most calls give moments as floats, for which the mean needs no further checks; entries of J⁻¹
    # come first, as in ``known_inertia``
    for names_of_inertia in reversed(inertia_names(name)):
        inertia = tuple(map(parameters.get, names_of_inertia))
        if {*map(type, inertia)} == {float}:
            return _mean_of_floats(rule.name, name, (*names_of_inertia,), inertia)
    return mean_inertia(inertia_of(name, rule, parameters), rule.name)


@lru_cache(maxsize=256)
def _mean_of_floats(
    rule: str, name: str, entries: tuple[str, ...], entry_values: tuple[float, ...]
) -> float:
    """Return γ or α from an inertia in plain floats; cached, because most calls repeat the last."""
    return mean_inertia(known_inertia(name, dict(zip(entries, entry_values, strict=True))), rule)


def inertia_of(name: str, rule: Rule, parameters: Mapping[str, Any]) -> InertiaLike:
    """Return the inertia for a rule: from the parameters if they have it, else of the rule."""
    if rule.inertia is not None and not has_inertia(name, parameters):
        inertia: InertiaLike = rule.inertia
        return inertia
    return known_inertia(name, parameters)


def known_inertia(name: str, parameters: Mapping[str, Any]) -> Moments:
    """Return the principal moments of an inertia parameter's body: I1.. for gamma, a_I1.. for
    a_gamma, or those of the tensor a_K11...

    Raises InputError if the parameters lack one of them.
    """
    moment_names, inverse = inertia_names(name)
    if {*inverse} <= parameters.keys():
        return moments_of(tensor_of_inverse([*map(parameters.__getitem__, inverse)]))
    unset = [moment for moment in moment_names if moment not in parameters]
    if unset:
        raise InputError(f"{name} cannot be chosen: the moment {unset[0]!r} of its body is no "
                         "parameter; give a number.")
    return principal_moments(tuple(parameters[moment] for moment in moment_names))


def _two_or_three(inertia: InertiaLike) -> Moments:
    """Return the principal moments, of which the smallest may be 0 if they are given themselves."""
    if is_tensor(inertia):
        return principal_moments(inertia)
    return moments_of(as_moments(inertia, zeros=1))


def _arithmetic(moments: Sequence[Any]) -> Any:
    """Return (Σ I)/N."""
    return sum(moments) / len(moments)


def _harmonic(moments: Sequence[Any]) -> Any:
    """Return N/Σ 1/I."""
    return len(moments) / sum(1 / moment for moment in moments)


def _mean(
    inertia: InertiaLike, moments: Moments, rule: Callable[[Sequence[Any]], Any],
    largest: int = 3,
) -> float:
    """Return a mean of the largest moments: of floats in doubles, of wider numbers exactly.

    ``moments`` are the principal moments of ``inertia`` as floats, ``rule`` is a mean of a list.
    Fractions give a fraction, other wide numbers a number of 113 bits.
    """
    exact_moments = [exact(moment) for moment in inertia]
    # the rows of a tensor are no numbers, and moments that are doubles lose nothing
    if None in exact_moments or exact_moments == [Fraction(moment) for moment in moments]:
        summands = sorted(moments)[-largest:] if largest < 3 else moments
        mean_of_doubles: float = rule(summands)
        # sums beyond the largest double, and of 1/I where I is below its reciprocal, are exact
        return mean_of_doubles if 0 < mean_of_doubles < math.inf else as_double(
            rule([Fraction(moment) for moment in summands]))
    mean: Any = rule(sorted(x for x in exact_moments if isinstance(x, Fraction))[-largest:])
    if all(isinstance(moment, (float, int)) for moment in inertia):
        return Rounded(mean)
    if all(isinstance(moment, (Fraction, float, int)) for moment in inertia):
        return mean  # type: ignore[no-any-return]
    from ..bindings.binary128 import round_to_quad  # mpmath costs time

    return round_to_quad(mean)  # type: ignore[no-any-return]
