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

import numpy as np

from ...core.arguments import listed, shown
from ...core.errors import InputError
from ...core.exact_numbers import Rounded, exact
from ...core.inertia import (
    InertiaLike,
    Moments,
    as_moments,
    as_moments_or_tensor,
    is_tensor,
    moments_of,
    real_array,
    tensor_of_inverse,
)
from ...core.registry import GAMMA_RULES, RULES

__all__ = ["MEANS", "MEANS_BY_SYMBOL", "gamma_by_rule", "gamma_fast", "gamma_h", "gamma_h_tilde",
           "gamma_m", "gamma_m_tilde", "has_inertia", "is_inertia_parameter", "known_inertia",
           "principal_moments"]


def gamma_m(inertia: InertiaLike) -> float:
    """Return γ_m = (I₁ + I₂ + I₃)/3, the arithmetic mean of the principal moments (48), in kg m².

    Raises
    ------
    InputError
        Unless there are three finite moments above 0, or a tensor that has such.
    """
    return _mean(inertia, principal_moments(inertia), _arithmetic)


def gamma_h(inertia: InertiaLike) -> float:
    """Return γ_h = 3/(1/I₁ + 1/I₂ + 1/I₃), the harmonic mean (47), in kg m².

    Raises
    ------
    InputError
        Unless there are three finite moments above 0, or a tensor that has such.
    """
    return _mean(inertia, principal_moments(inertia), _harmonic)


def gamma_m_tilde(inertia: InertiaLike) -> float:
    """Return γ̃_m = (I_a + I_b)/2, the mean of the two largest moments (50), in kg m².

    The smallest moment is left out, whichever axis it belongs to; it may be exactly 0.

    Raises
    ------
    InputError
        Unless there are three finite moments, the smallest at least 0, the others above 0, or a
        tensor with moments above 0.
    """
    return _mean(inertia, _two_or_three(inertia), _arithmetic, largest=2)


def gamma_h_tilde(inertia: InertiaLike) -> float:
    """Return γ̃_h = 2/(1/I_a + 1/I_b), the harmonic mean of the two largest moments (50), in kg m².

    The smallest moment is left out, whichever axis it belongs to; it may be exactly 0.

    Raises
    ------
    InputError
        Unless there are three finite moments, the smallest at least 0, the others above 0, or a
        tensor with moments above 0.
    """
    return _mean(inertia, _two_or_three(inertia), _harmonic, largest=2)


#: The means of the registry by their names, and by the paper's symbols.
MEANS: dict[str, Callable[[InertiaLike], float]] = {
    rule.name: globals()[rule.function] for rule in GAMMA_RULES.values() if rule.is_mean}
MEANS_BY_SYMBOL = {GAMMA_RULES[name].symbol: mean for name, mean in MEANS.items()}


def gamma_fast(inertia: InertiaLike, omega: Sequence[float]) -> float:
    """Return the γ of fastest fixed-point convergence: 1.1 times the moment about a fast axis.

    For a body that is symmetric about the axis it spins about (Ω in body axes, rad/s); for any
    other, γ_m, which is best there already. From 6 stages on the solution no longer depends on γ,
    only the number of iterations does, and it is safe; with fewer stages γ changes the accuracy,
    and γ_m or γ_h is the choice.

    Raises
    ------
    InputError
        For moments no body can have, and for Ω that is not three finite numbers.
    """
    found = real_array(omega)
    if found is None or found.shape != (3,) or not np.isfinite(found).all():
        raise InputError(f"omega = {shown(omega)} is not an angular velocity; give three finite "
                         "numbers in body axes.")
    moments, spin = principal_moments(inertia), found.tolist()
    if is_tensor(inertia):
        _, axes = np.linalg.eigh(np.array(inertia, dtype=float) / moments[2])
        spin = (axes.T @ found).tolist()
    fast = max(range(3), key=lambda axis: abs(spin[axis]))
    others = [axis for axis in range(3) if axis != fast]
    first, second = (moments[axis] for axis in others)
    symmetric = abs(first - second) <= 0.05 * (first + second)
    dominant = abs(spin[fast]) >= 3 * math.hypot(*(spin[axis] for axis in others))
    return 1.1 * moments[fast] if symmetric and dominant else gamma_m(inertia)


def principal_moments(inertia: InertiaLike) -> Moments:
    """Return the three principal moments I₁, I₂, I₃ as floats, in kg m².

    Those of a tensor come in rising order.

    Raises
    ------
    InputError
        Unless there are three finite moments above 0, or a tensor that has such.
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


def gamma_by_rule(name: str, rule: str, parameters: Mapping[str, Any]) -> float:
    """Return γ or α by the name of a mean, from the inertia among the parameters.

    Raises
    ------
    InputError
        For another word, and where the inertia is not among the parameters.
    """
    if rule not in MEANS:
        raise InputError(f"Parameter {name} = {shown(rule)} is neither a number nor one of the "
                         f"rules {listed(RULES)}.")
    for entries in reversed(inertia_names(name)):
        values = tuple(map(parameters.get, entries))
        if {*map(type, values)} == {float}:
            return _mean_of_floats(rule, name, (*entries,), values)
    return MEANS[rule](known_inertia(name, parameters))


@lru_cache(maxsize=256)
def _mean_of_floats(
    rule: str, name: str, entries: tuple[str, ...], values: tuple[float, ...]
) -> float:
    """Return γ or α by an inertia in plain floats: most calls give the one of the call before."""
    return MEANS[rule](known_inertia(name, dict(zip(entries, values, strict=True))))


def known_inertia(name: str, parameters: Mapping[str, Any]) -> Moments:
    """Return the moments that belong to an inertia parameter: I1.. for gamma, a_I1.. for a_gamma.

    Of a body with a tensor, a_K11.. tell them.

    Raises
    ------
    InputError
        If they are not all there.
    """
    wanted, inverse = inertia_names(name)
    if {*inverse} <= parameters.keys():
        return moments_of(tensor_of_inverse([parameters[entry] for entry in inverse]))
    missing = [moment for moment in wanted if moment not in parameters]
    if missing:
        raise InputError(
            f"{name} cannot be chosen: the moment {missing[0]!r} of its body is no parameter; "
            f"give a number, or the moments to choose_gamma(..., bodies={{{name!r}: (I1, I2, "
            "I3)})."
        )
    return principal_moments(tuple(parameters[moment] for moment in wanted))


def _two_or_three(inertia: InertiaLike) -> Moments:
    """Return the principal moments, of which the smallest may be 0."""
    if is_tensor(inertia):
        return principal_moments(inertia)
    return moments_of(as_moments(inertia, zeros=1))


def _arithmetic(moments: Sequence[Any]) -> Any:
    return sum(moments) / len(moments)


def _harmonic(moments: Sequence[Any]) -> Any:
    return len(moments) / sum(1 / moment for moment in moments)


def _mean(
    given: InertiaLike, moments: Moments, rule: Callable[[Sequence[Any]], Any],
    largest: int = 3,
) -> float:
    """Return a mean of the largest moments: of floats in doubles, of wider numbers exactly.

    Fractions then give a fraction, anything else a number of 113 bits.
    """
    whole = [exact(moment) for moment in given]
    if None in whole or whole == [Fraction(moment) for moment in moments]:
        of_doubles: float = rule(sorted(moments)[-largest:] if largest < 3 else moments)
        return of_doubles
    mean: Any = rule(sorted(x for x in whole if isinstance(x, Fraction))[-largest:])
    if all(isinstance(moment, (float, int)) for moment in given):
        return Rounded(mean)
    if all(isinstance(moment, (Fraction, float, int)) for moment in given):
        return mean  # type: ignore[no-any-return]
    from ..bindings.binary128 import rounded  # mpmath costs time

    return rounded(mean)  # type: ignore[no-any-return]
