"""Separation bounds: a number with radicals is proved zero, or not zero.

Every such number is E = U/(mΛ) with algebraic integers U, Λ and a positive integer m, in a field
of degree at most D, the product of the degrees of the different roots in E. If all conjugates of
U are at most u and those of Λ at most λ, then E ≠ 0 has |norm U| ≥ 1, so

    |E| ≥ 1/(u^(D−1) m λ)

(Burnikel, Funke, Mehlhorn, Schirra and Schmitt, ESA 2001). An interval around E that contains
zero and is narrower than this proves E = 0; one without zero proves E ≠ 0.
"""

from __future__ import annotations

from math import lcm, prod
from typing import Any

import sympy as sp
from mpmath import mp
from mpmath.ctx_iv import MPIntervalContext

from ...core.errors import TableauError
from ...core.records import dataclass

__all__ = ["Rounding", "enclosure", "vanishes", "vanishes_to"]

#: The time of a proof grows with the bits: a file may ask for more than anybody waits for.
MAX_BITS = 100_000
#: Largest change of a condition per change of an entry.
_SLOPE = mp.mpf(3) / 2
#: Largest error of a condition in units of the last digit, for any number of rounded entries.
_MAX_UNITS = 10


@dataclass(frozen=True)
class _Bound:
    """E = U/(mΛ): all conjugates of U are at most u, those of Λ at most λ."""

    u: int
    m: int = 1
    λ: int = 1
    roots: frozenset[tuple[sp.Expr, int]] = frozenset()


def vanishes(expression: sp.Expr) -> bool:
    """Whether an exact real number is zero.

    Raises ``TableauError`` if the proof would need more than ``MAX_BITS`` bits.
    """
    if expression.is_Rational:
        return bool(expression == 0)
    if not _contains_zero(expression, bits=256):
        return False
    bits = _separation_bits(expression)
    return _contains_zero(expression, bits)


@dataclass(frozen=True)
class Rounding:
    """Uncertainty of a tableau in decimals.

    Attributes
    ----------
    digits : int
        Number of digits after the point of its least precise entry.
    entries : int
        Number of entries that are taken to be rounded.
    """

    digits: int
    entries: int

    @property
    def bound(self) -> Any:
        """Bound of the residual of a condition that the exact entries satisfy.

        Each entry is off by half a unit in the last digit. Derivatives of conditions by an entry
        are about 1, as nodes and weights are between 0 and 1; the bound takes 3/2. Conditions
        seldom have more than 20 entries: the bound is ten units at most.
        """
        unit = mp.mpf(10) ** -min(self.digits, 50)
        return min(_SLOPE * self.entries / 2, _MAX_UNITS) * unit


def vanishes_to(expression: sp.Expr, rounding: Rounding | None) -> bool:
    """Whether a number is zero: exactly, or to the precision of rounded decimals."""
    if rounding is None:
        return vanishes(expression)
    return bool(abs(enclosure(expression)).b < rounding.bound)


def enclosure(expression: sp.Expr, bits: int = 256) -> Any:
    """Return an mpmath interval that contains an exact real number."""
    interval = MPIntervalContext()
    interval.prec = bits + 64
    return _value(expression, interval, cache={})


def _contains_zero(expression: sp.Expr, bits: int) -> bool:
    """Whether zero is within 2^−bits of the number; False is a proof that it is not zero."""
    working = bits
    while True:
        interval = enclosure(expression, working)
        if 0 not in interval:
            return False
        # 256 bits are a first test, which proves nothing if zero is within the interval
        if abs(interval).b < mp.ldexp(1, -bits) or bits == 256:
            return True
        working *= 2  # the interval is wide by cancellation


def _separation_bits(expression: sp.Expr) -> int:
    """Return n such that the number is zero or at least 2^−n."""
    bound = _bound(expression, cache={})
    degree = prod(k for _, k in bound.roots)
    bits = (degree - 1) * bound.u.bit_length() + (bound.m * bound.λ).bit_length() + 1
    if bits > MAX_BITS:
        raise TableauError(f"Whether {str(expression)[:60]}… is zero would take {bits} bits to "
                           f"prove and at most {MAX_BITS} are allowed; write the tableau with "
                           "fewer radicals or in decimals.")
    return bits


def _bound(e: sp.Expr, cache: dict[sp.Expr, _Bound]) -> _Bound:
    """Return the bound of a number, from the cache if it has it."""
    if e not in cache:
        cache[e] = _new_bound(e, cache)
    return cache[e]


def _new_bound(e: sp.Expr, cache: dict[sp.Expr, _Bound]) -> _Bound:
    """Return the bound of a number E = U/(mΛ) from the bounds of its operands.

    A product has u = Π u_i, m = Π m_i, λ = Π λ_i; a sum has the common denominators
    m = lcm(m_i), λ = Π λ_i and u = Σ u_i (m/m_i)(λ/λ_i).
    """
    if e.is_Rational:
        return _Bound(max(1, abs(int(e.p))), int(e.q))
    if e.is_Pow:
        return _power_bound(_bound(e.base, cache), e)
    operands = [_bound(argument, cache) for argument in e.args]
    # a root that occurs twice counts once in the degree of the field
    roots = frozenset().union(*(operand.roots for operand in operands))
    λ = prod(operand.λ for operand in operands)
    if e.is_Mul:
        return _Bound(prod(b.u for b in operands), prod(b.m for b in operands), λ, roots)
    m = lcm(*(operand.m for operand in operands))
    u = sum(operand.u * (m // operand.m) * (λ // operand.λ) for operand in operands)
    return _Bound(u, m, λ, roots)


def _power_bound(base: _Bound, e: sp.Expr) -> _Bound:
    """Return the bound of a power E^(n/k), where ``base`` is the bound of E = U/(mΛ)."""
    k, n = int(e.exp.q), int(e.exp.p)
    u, m, λ, roots = base.u, base.m, base.λ, base.roots
    if k > 1:  # with L = mΛ: (U/L)^(1/k) = (U L^(k−1))^(1/k)/L
        u = int(sp.integer_nthroot(u * (m * λ) ** (k - 1), k)[0]) + 1  # rounded up
        roots |= {(e.base, k)}
    if n < 0:  # (U/(mΛ))⁻¹ = mΛ/U
        u, m, λ = m * λ, 1, u
    return _Bound(u ** abs(n), m ** abs(n), λ ** abs(n), roots)




def _value(e: sp.Expr, interval: Any, cache: dict[sp.Expr, Any]) -> Any:
    """Return an interval that contains a number, from the cache if it has it."""
    if e not in cache:
        cache[e] = _value_from_operands(e, interval, cache)
    return cache[e]


def _value_from_operands(e: sp.Expr, interval: Any, cache: dict[sp.Expr, Any]) -> Any:
    """Return an interval that contains a number with radicals, by those of its operands.

    ``interval`` is mpmath's context of intervals; ``cache`` has intervals by expression.
    """
    if e.is_Rational:
        return interval.mpf(int(e.p)) / int(e.q)
    if e.is_Pow:
        root = _value(e.base, interval, cache)
        for _ in range(int(e.exp.q).bit_length() - 1):  # roots are square roots of square roots
            root = interval.sqrt(root)
        return root ** int(e.exp.p)
    # a sum or a product
    operands = [_value(argument, interval, cache) for argument in e.args]
    return sum(operands[1:], operands[0]) if e.is_Add else prod(operands[1:], start=operands[0])
