"""Quadrature nodes as roots of rational polynomials, exact and in certified enclosures.

    Lobatto: d^{s−2}/dx^{s−2} [x^{s−1}(x−1)^{s−1}]   (A.17)
    Gauss:   d^s/dx^s [x^s(x−1)^s]                    (A.18)
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from itertools import pairwise

import mpmath as mp
import sympy as sp

from ..errors import TableauError

__all__ = ["Enclosure", "enclose_roots", "exact_roots", "gauss_polynomial", "lobatto_polynomial"]

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
    return _derivative_of_bump(s, s)


@lru_cache
def lobatto_polynomial(s: int) -> sp.Poly:
    """Return the polynomial (A.17) whose s roots are the Lobatto nodes, 0 and 1 included."""
    if s < 2:
        raise TableauError(f"A Lobatto quadrature has at least 2 nodes, not {s}.")
    return _derivative_of_bump(s - 1, s - 2)


def _derivative_of_bump(power: int, times: int) -> sp.Poly:
    polynomial = sp.Poly(x * (x - 1), x, domain="QQ") ** power
    for _ in range(times):
        polynomial = polynomial.diff(x)
    return polynomial.monic()


@lru_cache
def enclose_roots(polynomial: sp.Poly, bits: int = BITS) -> tuple[Enclosure, ...]:
    """Return enclosures of radius 2^−bits of all roots, ascending, each proved by a sign change.

    The polynomial must have only real simple roots; as many disjoint brackets as its degree
    prove that none is missing.
    """
    integer = [int(c) for c in polynomial.clear_denoms()[1].all_coeffs()]
    slopes = [int(c) for c in (polynomial.clear_denoms()[1]).diff().all_coeffs()]
    with mp.workprec(128):
        guesses = sorted(map(mp.re, mp.polyroots(integer, maxsteps=500, extraprec=128)))
    with mp.workprec(bits + 64):
        for _ in range(bits.bit_length() - 5):  # each Newton step doubles the correct bits
            if not all(mp.polyval(slopes, r) for r in guesses):
                raise TableauError(f"The roots of {polynomial.as_expr()} are not simple and real.")
            guesses = [r - mp.polyval(integer, r) / mp.polyval(slopes, r) for r in guesses]
        numerators = [int(mp.nint(mp.ldexp(guess, bits))) for guess in guesses]
    step = Fraction(1, 2**bits)
    enclosures = []
    for numerator in numerators:
        centre = numerator * step
        if _value(integer, centre) == 0:
            enclosures.append(Enclosure(centre))
        elif _value(integer, centre - step) * _value(integer, centre + step) < 0:
            enclosures.append(Enclosure(centre, step))
        else:
            raise TableauError(f"No sign change of {polynomial.as_expr()} near {float(centre)}.")
    if any(b.centre - a.centre <= 2 * step for a, b in pairwise(enclosures)):
        raise TableauError(f"The roots of {polynomial.as_expr()} are not distinct.")
    return tuple(enclosures)


def _value(coefficients: list[int], at: Fraction) -> Fraction:
    result = Fraction(0)
    for coefficient in coefficients:
        result = result * at + coefficient
    return result


@lru_cache
def exact_roots(polynomial: sp.Poly) -> tuple[sp.Expr, ...]:
    """Return the roots in ascending order, in radicals where they are short, else as CRootOf.

    The roots lie symmetric about ½, so with y = x − ½ the polynomial is even or odd in y: a
    polynomial in y² of half the degree, and radicals stay short while that is at most 2.
    """
    roots: list[sp.Expr] = []
    for factor, _ in polynomial.factor_list()[1]:
        roots.extend(_short_radicals(factor) or factor.real_roots(radicals=False))
    return tuple(sorted(roots, key=lambda root: sp.N(root, 30)))


def _short_radicals(factor: sp.Poly) -> list[sp.Expr] | None:
    if factor.degree() == 1:
        return [-factor.all_coeffs()[1] / factor.all_coeffs()[0]]
    y, u = sp.symbols("y u")
    shifted = sp.Poly(factor.as_expr().subs(x, y + sp.Rational(1, 2)), y)
    if factor.degree() > 4 or any(power[0] % 2 for power in shifted.monoms()):
        return None
    in_squares = sp.Poly([shifted.coeff_monomial(y**k) for k in range(factor.degree(), -1, -2)], u)
    squares = sp.roots(in_squares, quartics=False, cubics=False)
    return [sp.Rational(1, 2) + sign * sp.sqrt(square) for square in squares for sign in (-1, 1)]
