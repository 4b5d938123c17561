"""Quadrature nodes as roots of rational polynomials, exact and in certified enclosures.

    Lobatto: d^{s−2}/dx^{s−2} [x^{s−1}(x−1)^{s−1}]   (A.17)
    Gauss:   d^s/dx^s [x^s(x−1)^s]                    (A.18)
    Radau:   d^{s−1}/dx^{s−1} [x^{s−1}(x−1)^s]        of Radau IIA, with the node 1
"""

from __future__ import annotations

from fractions import Fraction
from functools import lru_cache
from itertools import pairwise
from typing import Any

import mpmath as mp
import sympy as sp

from ...core.errors import TableauError
from ...core.records import dataclass

__all__ = ["Enclosure", "enclose_roots", "exact_roots", "gauss_polynomial", "lobatto_polynomial",
           "radau_polynomial"]

x = sp.Symbol("x")
#: Enclosures of roots have radius 2^−BITS; enough for 120 certified digits at s = 16.
BITS = 512


@dataclass(frozen=True)
class Enclosure:
    """A real number within ``radius`` of the rational ``centre``; radius 0 means exact."""

    centre: Fraction
    radius: Fraction = Fraction(0)


@lru_cache
def gauss_polynomial(s: int) -> sp.Poly:
    """Return the s-th shifted Legendre polynomial (A.18), up to a constant factor."""
    return _rodrigues(s, s, s)


@lru_cache
def lobatto_polynomial(s: int) -> sp.Poly:
    """Return the polynomial (A.17) whose s roots are the Lobatto nodes, 0 and 1 included."""
    if s < 2:
        raise TableauError(f"A Lobatto quadrature has at least 2 nodes, not {s}.")
    return _rodrigues(s - 1, s - 1, s - 2)


@lru_cache
def radau_polynomial(s: int) -> sp.Poly:
    """Return the polynomial whose s roots are the nodes of Radau IIA, 1 included."""
    return _rodrigues(s - 1, s, s - 1)


def _rodrigues(m: int, n: int, order: int) -> sp.Poly:
    """Return d^order/dx^order [x^m (x−1)^n], monic (Rodrigues' formula)."""
    polynomial = sp.Poly(x, x, domain="QQ") ** m * sp.Poly(x - 1, x, domain="QQ") ** n
    for _ in range(order):
        polynomial = polynomial.diff(x)
    return polynomial.monic()


@lru_cache
def enclose_roots(polynomial: sp.Poly, bits: int = BITS) -> tuple[Enclosure, ...]:
    """Return enclosures of radius 2^−bits of all roots, ascending, each proved by a sign change.

    The polynomial must have only real simple roots: as many disjoint enclosures as its degree
    contain all of them. Raises TableauError if roots are not real, not simple, or too close for
    2^−bits.
    """
    integer = [int(c) for c in polynomial.clear_denoms()[1].all_coeffs()]
    try:
        numerators = _rounded_roots(integer, sorted(_approximate_roots(integer)), bits)
    except ArithmeticError:
        raise TableauError(f"The roots of {polynomial.as_expr()} are not simple and "
                           "real.") from None
    step = Fraction(1, 2**bits)
    enclosures = []
    for numerator in numerators:
        # in whole numbers: the signs of f on both sides of the rounded root are exact
        low, middle, high = (_scaled_polynomial(integer, numerator + i, bits) for i in (-1, 0, 1))
        if middle != 0 and (low < 0) == (high < 0):
            raise TableauError(f"No sign change of {polynomial.as_expr()} near "
                               f"{float(numerator * step)}.")
        # f = 0 at the rounded root: it is exact
        enclosures.append(Enclosure(numerator * step, step if middle else Fraction(0)))
    # enclosures of radius 1 in these units would overlap
    if any(right - left <= 2 for left, right in pairwise(numerators)):
        raise TableauError(f"The roots of {polynomial.as_expr()} are not distinct.")
    return tuple(enclosures)


def _approximate_roots(integer: list[int]) -> list[Any]:
    """Return the roots of a polynomial with real roots only, the largest first.

    Newton's method converges monotonically to the largest root from above. The next root is the
    largest after deflation: Σ 1/(x − root) is subtracted from f′/f (Maehly).
    """
    roots: list[Any] = []
    with mp.workprec(256):
        start = _upper_bound(integer) + 1
        for _ in integer[1:]:
            roots.append(_next_root(integer, roots, start))
    return roots


def _upper_bound(integer: list[int]) -> Any:
    """Return an upper bound of the roots of a xⁿ + b xⁿ⁻¹ + c xⁿ⁻² + …, if all are real.

    It is −b/(n a) + √((n − 1)((n − 1) b² − 2 n a c))/(n |a|), by Laguerre and Samuelson. The
    radicand is n²(n − 1) a² times the variance of the roots. Raises ArithmeticError if it is
    negative.
    """
    n = len(integer) - 1
    a, b, c = [*integer, 0][:3]  # c = 0 for n = 1
    spread = (n - 1) * ((n - 1) * mp.mpf(b) ** 2 - 2 * n * a * c)
    if spread < 0:
        raise ArithmeticError("Some roots are not real.")
    return (mp.sqrt(spread) / abs(a) - mp.mpf(b) / a) / n


def _next_root(integer: list[int], roots: list[Any], start: Any) -> Any:
    """Return the largest root of f that is not in ``roots``: x ← x − 1/(f′/f − Σ 1/(x − root)).

    ``integer`` are the coefficients of f, ``start`` is beyond its largest root: from there Newton's
    method for f/Π (x − root) falls to the root without passing it.
    """
    x = start
    for _ in range(500):
        f, slope = mp.polyval(integer, x, derivative=True)
        if f == 0:
            return x
        change = 1 / (slope / f - mp.fsum(1 / (x - root) for root in roots))
        x -= change
        if abs(change) < mp.ldexp(1, -100):
            return x
    raise ArithmeticError("Newton's method does not converge.")


def _rounded_roots(integer: list[int], roots: list[Any], bits: int) -> list[int]:
    """Return 2^bits times the roots, rounded; each Newton step doubles the number of right bits.

    The working precision includes the bits of the coefficients, as terms cancel.
    """
    with mp.workprec(bits + 64 + max(map(int.bit_length, integer))):
        # about 100 bits are right at the start: n steps make 100 · 2ⁿ of them
        for _ in range(max(bits.bit_length() - 5, 0)):
            pairs = [mp.polyval(integer, r, derivative=True) for r in roots]
            roots = [r - f / slope for r, (f, slope) in zip(roots, pairs, strict=True)]
        return [int(mp.nint(mp.ldexp(root, bits))) for root in roots]


def _scaled_polynomial(integer: list[int], numerator: int, bits: int) -> int:
    """Return the integer 2^(bits · degree) f(numerator/2^bits), by Horner's scheme."""
    scaled = 0
    for k, coefficient in enumerate(integer):
        scaled = scaled * numerator + (coefficient << (bits * k))
    return scaled


@lru_cache
def exact_roots(polynomial: sp.Poly) -> tuple[sp.Expr, ...]:
    """Return the roots in ascending order, in short radicals if possible, else as CRootOf.

    If the roots are symmetric about their mean (½ for Gauss and Lobatto), the polynomial is even
    or odd in y = x − mean: a polynomial of half the degree in y², with short radicals up to
    degree 2.
    """
    roots: list[sp.Expr] = []
    for factor, _ in polynomial.factor_list()[1]:
        roots.extend(_short_radicals(factor) or factor.real_roots(radicals=False))
    return tuple(sorted(roots, key=lambda root: sp.N(root, 30)))


def _short_radicals(factor: sp.Poly) -> list[sp.Expr] | None:
    """Return the roots of an irreducible factor as square roots; None if they have other radicals.

    With the mean of the roots as the origin, a polynomial in y² of degree 4 at most has roots
    y = ±√u.
    """
    # the sum of the roots of a xⁿ + b xⁿ⁻¹ + … is −b/a
    a, b = factor.all_coeffs()[:2]
    if factor.degree() == 1:
        return [-b / a]
    y, u = sp.symbols("y u")
    mean = -b / (a * factor.degree())
    shifted = sp.Poly(factor.as_expr().subs(x, y + mean), y)
    if factor.degree() > 4 or any(power[0] % 2 for power in shifted.monoms()):
        return None
    in_squares = sp.Poly([shifted.coeff_monomial(y**k) for k in range(factor.degree(), -1, -2)], u)
    squares = sp.roots(in_squares, quartics=False, cubics=False)
    return [mean + sign * sp.sqrt(square) for square in squares for sign in (-1, 1)]
