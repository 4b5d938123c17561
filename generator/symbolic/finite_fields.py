"""Expressions in finite fields: whether they vanish is decided without any rounding.

Every double is a fraction, and a fraction is a number modulo a prime. A rational function that
vanishes for all values of its symbols vanishes modulo every prime; one that does not vanish is
nonzero at a random point but for a chance of degree/prime. What is no rational function is made
one, with all that its definition knows of it:

- roots: an s with s² = u, at points where u has one,
- sin, cos, tan, exp, sinh, cosh, tanh of Σ n_k u_k: Π z_k^(n_k) with a random z_k for each
  different u_k, so that theorems of addition hold,
- any other function: a random number for each different argument. What holds for any numbers in
  its place holds for the function; what holds of that function alone is not seen.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache, reduce
from itertools import count
from math import gcd, lcm
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from .bounded_algebra import is_small
from .shared_subexpressions import Shared, parts_of

__all__ = ["Residues", "UnsuitablePrimeError", "exactly", "identically_zero", "primes",
           "vanish"]

Residue = NDArray[np.int64]

#: Functions that are rational in exp(x) or exp(ix): numerator and denominator in z and 1/z.
_CIRCULAR = {sp.sin, sp.cos, sp.tan}
_HYPERBOLIC = {sp.exp, sp.sinh, sp.cosh, sp.tanh}
#: Batches of points that are drawn for one whose roots all exist, before roots count as unknown.
_BATCHES = 40


def primes() -> Iterator[int]:
    """Yield primes below 2³¹, the largest first, that have √−1 and √2: p ≡ 9 (mod 16).

    A few hundred: an expression that none of them is suitable for is not to be had.
    """
    p = 2**31
    for _ in range(4000):
        p = int(sp.prevprime(p))
        if p % 16 == 9:
            yield p


@cache
def _eighth_root(prime: int) -> int:
    """Return a number whose powers are the eight roots of 1: its second power is √−1."""
    candidates = (pow(n, (prime - 1) // 8, prime) for n in count(2))
    return next(c for c in candidates if pow(c, 4, prime) == prime - 1)


class UnsuitablePrimeError(ArithmeticError):
    """Modulo this prime a number such as √2 does not exist; another will do."""


class Residues:
    """Random points modulo a prime, and the values of expressions there.

    Parameters
    ----------
    prime : int
        One of ``primes``.
    symbols : iterable of Symbol
        What gets a random value at each point.
    expressions : sequence of Expr
        All that will be asked for: which roots and angles there are.
    size : int
        Number of points.
    constants : dict
        Values of numbers such as sin(0.3), which are the same at all points of a prime.
    seed : int
        Of the random numbers.

    Raises
    ------
    UnsuitablePrimeError
        If an expression is no number modulo this prime.
    """

    def __init__(
        self, prime: int, symbols: Iterable[sp.Symbol], expressions: Sequence[sp.Expr], size: int,
        constants: dict[Any, int], seed: int,
    ) -> None:
        self.prime, self.size, self._constants = prime, size, constants
        self._rng = np.random.default_rng([seed, prime])
        self._units = _angular_units(expressions)
        self._symbols = list(symbols)
        self.values = self._usable_values(list(expressions))

    def __getitem__(self, e: sp.Expr) -> Residue:
        """Return the values of a symbol or of one of the expressions, shape (points,)."""
        return self.values[e]

    def _usable_values(self, expressions: list[sp.Expr]) -> dict[sp.Basic, Residue]:
        """Draw points until there are enough with all roots and no division by zero."""
        wanted, parts = [*self._symbols, *expressions], list(parts_of(expressions))
        for self._with_roots in (True, False):
            found: list[list[Residue]] = []
            for _ in range(_BATCHES):
                found.append(self._batch(wanted, parts))
                if sum(len(columns[0]) for columns in found) >= self.size:
                    columns = [np.concatenate(c)[: self.size] for c in zip(*found, strict=True)]
                    return dict(zip(wanted, columns, strict=True))
        raise UnsuitablePrimeError(f"no point modulo {self.prime} has all the values")

    def _batch(self, wanted: Sequence[sp.Basic], parts: Sequence[sp.Basic]) -> list[Residue]:
        """Return the values at as many random points as are usable."""
        self._drawn: dict[Any, Residue] = {}
        self._usable = np.ones(self.size, dtype=bool)
        known: dict[sp.Basic, Residue] = {s: self._draw() for s in self._symbols}
        for part in parts:
            if part not in known:
                known[part] = self._value(part, known)
        return [known[e][self._usable] for e in wanted]

    # ------------------------------------------------------------ one expression

    def _value(self, e: sp.Basic, known: Mapping[sp.Basic, Residue]) -> Residue:
        p = self.prime
        if e.is_Rational or e.is_Float:
            return self._number(sp.Rational(e))
        if isinstance(e, Shared):
            return known[e.args[0]]
        if e.is_Add:
            return reduce(lambda a, b: (a + b) % p, (known[a] for a in e.args))
        if e.is_Mul:
            return reduce(lambda a, b: a * b % p, (known[a] for a in e.args))
        if e.func in _CIRCULAR or e.func in _HYPERBOLIC:
            return self._exponential(e)
        if e.is_Pow and (e.exp.is_Rational or e.exp.is_Float):
            return self._power_of(e.base, sp.Rational(e.exp), known[e.base])
        return self._unknown(e)

    def _number(self, x: sp.Rational) -> Residue:
        value = int(x.p) * pow(int(x.q), -1, self.prime) % self.prime
        return np.full(self.size, value)

    def _draw(self) -> Residue:
        """Return random numbers other than 0."""
        return self._rng.integers(1, self.prime, self.size)

    def _unknown(self, e: Any) -> Residue:
        """Return random numbers for what nothing is known of, one where nothing in it varies."""
        if e not in self._drawn:
            if getattr(e, "free_symbols", None):
                self._drawn[e] = self._draw()
            else:
                draw = int(self._rng.integers(1, self.prime))
                self._drawn[e] = np.full(self.size, self._constants.setdefault(e, draw))
        return self._drawn[e]

    # ------------------------------------------------------------ powers and roots

    def _power(self, x: Residue, n: int) -> Residue:
        """Return xⁿ; where x = 0 and n < 0 the point is dropped."""
        if n < 0:
            self._usable &= x != 0
            n %= self.prime - 1
        result = np.ones_like(x)
        while n:
            if n & 1:
                result = result * x % self.prime
            x, n = x * x % self.prime, n >> 1
        return result

    def _power_of(self, e: sp.Expr, exponent: sp.Rational, base: Residue) -> Residue:
        """Return base^(p/q): square roots, and odd ones where every number has just one."""
        q = int(exponent.q)
        twos = (q & -q).bit_length() - 1
        odd = q >> twos
        if gcd(odd, self.prime - 1) > 1:
            raise UnsuitablePrimeError(f"numbers have several roots modulo {self.prime}")
        if q > 1 and not self._with_roots:
            root = self._unknown(sp.Pow(e, sp.Rational(1, q), evaluate=False))
        else:
            root = self._power(base, pow(odd, -1, self.prime - 1)) if odd > 1 else base
            for _ in range(twos):
                root = self._square_root(root)
            if q > 1 and not (self._usable.any() or e.free_symbols):
                raise UnsuitablePrimeError(f"{e} has no such root modulo {self.prime}")
        return self._power(root, int(exponent.p))

    def _square_root(self, x: Residue) -> Residue:
        """Return a root of x; points where there is none are dropped.

        By Tonelli's and Shanks's method: x^((m+1)/2) with p − 1 = 8 m is one but for an eighth root
        of 1.
        """
        p = self.prime
        root = near = self._power(x, ((p - 1) // 8 + 1) // 2)
        for _ in range(3):
            near = near * _eighth_root(p) % p
            root = np.where(near * near % p == x, near, root)
        self._usable &= root * root % p == x
        return root

    # ------------------------------------------------------------ exponentials

    def _exponential(self, e: sp.Function) -> Residue:
        """Return sin, exp, … of Σ n_k u_k by Π z_k^(n_k)."""
        p, circular = self.prime, e.func in _CIRCULAR
        z = np.ones(self.size, dtype=np.int64)
        for unit, n in _terms(e.args[0]):
            steps = n * self._units[unit]
            z = z * self._power(self._unknown((unit, circular)), int(steps)) % p
        inverse = self._power(z, -1)
        i = _eighth_root(p) ** 2 % p if circular else 1
        odd = (z - inverse) * pow(2 * i, -1, p) % p
        even = (z + inverse) * pow(2, -1, p) % p
        if e.func in (sp.tan, sp.tanh):
            return odd * self._power(even, -1) % p
        return {sp.exp: z, sp.sin: odd, sp.sinh: odd}.get(e.func, even)


def _terms(argument: sp.Expr) -> list[tuple[Any, sp.Rational]]:
    """Return the argument as multiples of different terms."""
    found = []
    for term in sp.Add.make_args(sp.expand(argument)):
        factor, rest = term.as_coeff_Mul()
        if factor.is_Float:
            factor = sp.Rational(factor)
        found.append((rest, factor) if factor.is_Rational else (term, sp.Integer(1)))
    return found


def _angular_units(expressions: Sequence[sp.Expr]) -> dict[Any, int]:
    """Return by what each term of an argument is divided so that all its multiples are whole."""
    units: dict[Any, int] = {}
    for e in parts_of(expressions):
        if e.func in _CIRCULAR or e.func in _HYPERBOLIC:
            for unit, n in _terms(e.args[0]):
                units[unit] = lcm(units.get(unit, 1), int(n.q))
    return units


# ---------------------------------------------------------------- identities

_PRIMES, _POINTS = 3, 20


def exactly(e: sp.Expr) -> sp.Expr:
    """Return the expression with every floating-point number as the fraction that it is."""
    return e.xreplace({x: sp.Rational(x) for x in e.atoms(sp.Float)})


def identically_zero(sums: Sequence[Sequence[sp.Expr]]) -> str:
    """Return how it is known that sums, given by their terms, vanish identically.

    "expanded" where multiplying out leaves nothing: a proof. "exact arithmetic at random points"
    where that is too long or does not decide it, empty where a sum is not seen to vanish.
    """
    exact = [[exactly(e) for e in terms] for terms in sums]
    whole = [sp.Add(*terms, evaluate=False) for terms in exact]
    rest = [e for e in whole if e != 0]
    if rest and not vanish(rest):
        return ""
    proved = all(map(is_small, whole)) and all(
        sp.expand(sp.Add(*map(sp.expand, terms))) == 0 for terms in exact)
    return "expanded" if proved else "exact arithmetic at random points"


def vanish(expressions: Sequence[sp.Expr]) -> bool:
    """Whether all vanish at random points modulo three suitable primes."""
    symbols = sorted(set().union(*(e.free_symbols for e in expressions)), key=str)
    found = 0
    for prime in primes():
        try:
            at = Residues(prime, symbols, expressions, _POINTS, {}, 0)
        except UnsuitablePrimeError:
            continue
        if any(at[e].any() for e in expressions):
            return False
        found += 1
        if found == _PRIMES:
            return True
    return False
