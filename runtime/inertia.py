"""The means of the principal moments that the paper recommends for γ (or α): (47), (48), (50).

Moments with more digits than a double's (mpmath numbers, Decimal, Fraction) have means with more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, Literal

from ..errors import InputError
from ..exact import Rounded, exact

__all__ = [
    "AIMS", "MEANS", "MEANS_BY_SYMBOL", "Aim", "gamma_fast", "gamma_h", "gamma_h_tilde", "gamma_m",
    "gamma_m_tilde", "principal_moments",
]


def gamma_m(inertia: Sequence[float]) -> float:
    """Return γ_m = (I₁ + I₂ + I₃)/3, the arithmetic mean of the principal moments (48), in kg m².

    Raises
    ------
    InputError
        Unless there are three finite moments above 0.
    """
    return _mean(inertia, principal_moments(inertia), _arithmetic)


def gamma_h(inertia: Sequence[float]) -> float:
    """Return γ_h = 3/(1/I₁ + 1/I₂ + 1/I₃), the harmonic mean (47), in kg m².

    Raises
    ------
    InputError
        Unless there are three finite moments above 0.
    """
    return _mean(inertia, principal_moments(inertia), _harmonic)


def gamma_m_tilde(inertia: Sequence[float]) -> float:
    """Return γ̃_m = (I_a + I_b)/2, the mean of the two largest moments (50), in kg m².

    The smallest moment is left out, whichever axis it belongs to; it may be exactly 0.

    Raises
    ------
    InputError
        Unless there are three finite moments, the smallest at least 0, the others above 0.
    """
    return _mean(inertia, principal_moments(inertia, zeros=1), _arithmetic, largest=2)


def gamma_h_tilde(inertia: Sequence[float]) -> float:
    """Return γ̃_h = 2/(1/I_a + 1/I_b), the harmonic mean of the two largest moments (50), in kg m².

    The smallest moment is left out, whichever axis it belongs to; it may be exactly 0.

    Raises
    ------
    InputError
        Unless there are three finite moments, the smallest at least 0, the others above 0.
    """
    return _mean(inertia, principal_moments(inertia, zeros=1), _harmonic, largest=2)


#: The four by the names that options and files give them, and by the paper's symbols.
MEANS: dict[str, Callable[[Sequence[float]], float]] = {
    "m": gamma_m, "h": gamma_h, "mt": gamma_m_tilde, "ht": gamma_h_tilde}
MEANS_BY_SYMBOL = dict(zip(("γ_m", "γ_h", "γ̃_m", "γ̃_h"), MEANS.values(), strict=True))

#: What a chosen value is to make small, by the names that stand for "choose it".
Aim = Literal["motion", "energy"]
AIMS: dict[str, Aim] = {"auto": "motion", "auto-energy": "energy"}


def gamma_fast(inertia: Sequence[float], omega: Sequence[float]) -> float:
    """Return the γ with which sweeps converge fastest: 1.1 times the moment about a fast axis.

    For a body that is symmetric about the axis it spins about (Ω in body axes, rad/s); for any
    other, γ_m, which is best there already. From 6 stages on the solution no longer depends on γ,
    only the number of sweeps does, and it is safe; with fewer stages γ changes the accuracy, and
    γ_m or γ_h is the choice.

    Raises
    ------
    InputError
        For moments no body can have, and for Ω that is not three finite numbers.
    """
    moments = principal_moments(inertia)
    if len(omega) != 3 or not all(math.isfinite(x) for x in omega):
        raise InputError(f"omega = {list(omega)} is not an angular velocity; give three finite "
                         "numbers in body axes.")
    fast = max(range(3), key=lambda axis: abs(omega[axis]))
    others = [axis for axis in range(3) if axis != fast]
    first, second = (moments[axis] for axis in others)
    symmetric = abs(first - second) <= 0.05 * (first + second)
    dominant = abs(omega[fast]) >= 3 * math.hypot(*(omega[axis] for axis in others))
    return 1.1 * moments[fast] if symmetric and dominant else gamma_m(inertia)


def principal_moments(inertia: Sequence[float], *, zeros: int = 0) -> tuple[float, float, float]:
    """Return the three principal moments I₁, I₂, I₃ as floats, in kg m².

    Raises
    ------
    InputError
        Unless there are three finite moments above 0; up to ``zeros`` of them may be 0.
    """
    try:
        moments = [_number(moment) for moment in inertia]
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(
            f"The inertia {inertia!r} is not three numbers; give I1, I2 and I3 in kg m²."
        ) from error
    if len(moments) != 3:
        raise InputError(
            f"The inertia has {len(moments)} moments; give the three principal moments I1, I2, I3."
        )
    for axis, moment in enumerate(moments, start=1):
        vanishing_allowed = moment == 0 and moments.count(0.0) <= zeros
        if not math.isfinite(moment) or (moment <= 0 and not vanishing_allowed):
            raise InputError(f"The moment I{axis} = {moment!r} kg m² must be finite and above 0.")
    I1, I2, I3 = moments
    return I1, I2, I3


def _number(value: object) -> float:
    if isinstance(value, (str, bytes)):
        raise TypeError("text is not a number")
    return float(value)  # type: ignore[arg-type]


def _arithmetic(moments: Sequence[Any]) -> Any:
    return sum(moments) / len(moments)


def _harmonic(moments: Sequence[Any]) -> Any:
    return len(moments) / sum(1 / moment for moment in moments)


def _mean(
    given: Sequence[Any], moments: Sequence[float], rule: Callable[[Sequence[Any]], Any],
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
    from .quad import rounded  # mpmath costs time

    return rounded(mean)  # type: ignore[no-any-return]
