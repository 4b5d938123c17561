"""Equality of two expressions as functions: proved by algebra, or seen at random points.

Polynomials are compared term by term. Other functions have no such normal form; they are evaluated
with 60 digits at random points of their domain. Analytic functions that agree there to 30 digits
are equal with overwhelming probability; the result is then "seen", not "proved". A difference at
one point refutes.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Any

import mpmath as mp
import sympy as sp

from ...core.records import dataclass
from .cardinal_functions import Numeric
from .shared_subexpressions import Shared, parts_of, symbols_of
from .switching_functions import Where

__all__ = ["IdentityCheck", "compare", "evaluate", "is_refuted"]

#: Half of the digits may cancel; numbers that agree in the other half count as equal.
_DIGITS = 60
_TOLERANCE = mp.mpf(10) ** (-_DIGITS // 2)
#: Points where two sides are compared, out of so many that are drawn: a root may be real at few.
_POINTS = 8
_TRIES = 400
#: Rational functions with more operations are not brought to a common denominator.
_MOST_OPERATIONS = 3000


@dataclass(frozen=True)
class IdentityCheck:
    """Result of a comparison; ``how`` says how it was found.

    ``residual`` is the largest difference as text, "0" if equal.
    """

    holds: bool
    how: str
    residual: str


def compare(
    left: Sequence[sp.Expr], right: Sequence[sp.Expr], small: Sequence[sp.Symbol] = (),
    *, thorough: bool = True,
) -> IdentityCheck:
    """Compare two lists of expressions, entry by entry.

    The symbols in ``small`` have values of about 0.1 at the random points. Without ``thorough``,
    only polynomials are compared by algebra.
    """
    pairs, differences = _differences(left, right, small)
    count = 0
    for difference in differences:
        if difference > _TOLERANCE:
            return IdentityCheck(holds=False, how="refuted", residual=mp.nstr(difference, 3))
        count += 1
    if all(_is_equal(a, b, thorough) for a, b in pairs):
        return IdentityCheck(holds=True, how="proved", residual="0")
    if not count:
        return IdentityCheck(holds=False, how="not decided",
                             residual=f"no real value at {_TRIES} random points")
    return IdentityCheck(
        holds=True, how=f"seen at {count} random points to {_DIGITS // 2} digits", residual="0")


def is_refuted(
    left: Sequence[sp.Expr], right: Sequence[sp.Expr], small: Sequence[sp.Symbol] = ()
) -> bool:
    """Return whether ``compare`` refutes equality; nothing is proved."""
    _, differences = _differences(left, right, small)
    return any(difference > _TOLERANCE for difference in differences)


def _differences(
    left: Sequence[sp.Expr], right: Sequence[sp.Expr], small: Sequence[sp.Symbol]
) -> tuple[list[tuple[sp.Expr, sp.Expr]], Iterator[Any]]:
    """Return the pairs that differ in form, and their largest difference at each random point.

    The differences are computed one by one, as the caller takes them.
    """
    pairs = [(a, b) for a, b in zip(left, right, strict=True) if a != b]
    points = _points(pairs, set(small)) if pairs else iter(())
    return pairs, (max(_difference(a, b, values) for a, b in pairs) for values in points)


def _is_equal(a: sp.Expr, b: sp.Expr, thorough: bool) -> bool:
    """Whether algebra proves a = b: polynomials by expansion, ratios of them by the numerator."""
    symbols = symbols_of([a, b])
    if all(e.is_polynomial(*symbols) for e in (a, b)):
        return bool(sp.expand(a - b) == 0)
    rational = thorough and all(e.is_rational_function(*symbols) for e in (a, b))
    if rational and sp.count_ops(a) + sp.count_ops(b) < _MOST_OPERATIONS:
        return bool(sp.numer(sp.together(a - b)).expand() == 0)
    return False


def _points(
    pairs: Sequence[tuple[sp.Expr, sp.Expr]], small: set[sp.Symbol]
) -> Iterator[dict[sp.Basic, Any]]:
    """Yield the values of all subexpressions at up to 8 random points where these are real.

    A pair has the two sides of an equation; the symbols in ``small`` get a tenth of a value.
    """
    expressions = [e for pair in pairs for e in pair]
    symbols = sorted(symbols_of(expressions), key=str)
    generator, count = random.Random(1), 0
    for attempt in range(_TRIES):
        # sizes and signs alternate, as functions may be real in a part of their domain only
        size = (1, Fraction(1, 4), 4)[attempt % 3]
        lowest = -1 if attempt % 2 else Fraction(1, 4)
        point = {}
        for s in symbols:
            low = Fraction(1, 4) if s.is_positive else lowest
            point[s] = (low + (1 - low) * Fraction(generator.getrandbits(40), 2**40)) * size
            if s in small:
                point[s] /= 10
        try:
            values = evaluate(expressions, point)
        except (ValueError, ArithmeticError):
            continue
        yield values
        count += 1
        if count == _POINTS:
            return


def _difference(a: sp.Expr, b: sp.Expr, values: Mapping[sp.Basic, Any]) -> Any:
    """Return |a − b| / max(1, |a|, |b|)."""
    return abs(values[a] - values[b]) / max(1, abs(values[a]), abs(values[b]))


def evaluate(
    expressions: Sequence[sp.Expr], point: Mapping[sp.Symbol, Fraction], digits: int = _DIGITS
) -> dict[sp.Basic, Any]:
    """Return the value of every subexpression at a point, as mpmath numbers.

    Raises ``ValueError`` or ``ArithmeticError`` if a value is not a finite real number; in the
    branches of a ``Where`` it becomes NaN, which is allowed in the branch that is not selected.
    """
    # a side that is not selected may be undefined
    sides = set(parts_of(s for e in parts_of(expressions) if isinstance(e, Where)
                         for s in e.args[2:]))
    with mp.workdps(digits):
        values: dict[sp.Basic, Any] = {
            s: mp.mpf(x.numerator) / x.denominator for s, x in point.items()
        }
        for e in parts_of(expressions):
            if e not in values:
                values[e] = _value_if_any(e, [values[a] for a in e.args])
                if e not in sides and not mp.isfinite(values[e]):
                    raise ValueError(f"{e} is not a finite real number here.")
        for e in expressions:
            if not mp.isfinite(values[e]):
                raise ValueError(f"{e} is not a finite real number here.")
        return values


def _value_if_any(e: sp.Basic, arguments: list[Any]) -> Any:
    """Return the value of e; NaN if it is undefined, infinite or complex."""
    # of a Where, the two numbers that it compares; the branch that is not selected may be NaN
    needed = arguments[:2] if isinstance(e, Where) else arguments
    if not all(map(mp.isfinite, needed)):
        return mp.nan
    try:
        number = _value(e, arguments)
    except (ValueError, ArithmeticError):
        return mp.nan
    return mp.nan if isinstance(number, mp.mpc) or not mp.isfinite(number) else number


def _value(e: sp.Basic, arguments: list[Any]) -> Any:
    """Return a function's mpmath value from the values of its arguments."""
    if e.is_Add:
        return mp.fsum(arguments)
    if e.is_Mul:
        return mp.fprod(arguments)
    if e.is_Pow:
        return mp.power(*arguments)
    if isinstance(e, Shared):
        return arguments[0]
    if isinstance(e, Numeric):
        return e.value(*arguments)
    if e.is_Rational:
        return mp.mpf(int(e.p)) / int(e.q)
    if e.is_number and not e.args:  # π, e and decimals
        return e._to_mpmath(mp.mp.prec)
    # other functions have the same names in mpmath
    function = {"Abs": mp.fabs}.get(e.func.__name__) or getattr(mp, e.func.__name__, None)
    if function is None:
        raise ValueError(f"{e.func.__name__!r} has no value here.")
    return function(*arguments)
