"""Values of expressions in finite fields: a test for zero without rounding errors.

Every double is a fraction, and a fraction is a number modulo a prime. A rational function that
vanishes identically vanishes modulo every prime (without a zero denominator); any other one is
nonzero at a random point with a probability of 1 − degree/prime or more (Schwartz and Zippel).
Other functions are replaced by rational ones:

- a root √u by an s with s² = u, at points where u has one,
- sin, cos, tan, exp, sinh, cosh, tanh of Σ n_k u_k by rational functions of Π z_k^(n_k) with a
  random z_k for each different u_k, so that the addition theorems hold,
- any other function by a random number for each different argument. An identity that holds for
  any such numbers holds for the function; identities of the function itself are not detected.
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

#: Functions of x that are rational in z = exp(ix), and in z = exp(x).
_CIRCULAR = {sp.sin, sp.cos, sp.tan}
_HYPERBOLIC = {sp.exp, sp.sinh, sp.cosh, sp.tanh}
#: Batches of random points, until roots are replaced by random numbers.
_BATCHES = 40
#: How far below 2³¹ primes are looked for.
_PRIME_RANGE = 86_000


def primes() -> Iterator[int]:
    """Yield primes below 2³¹, the largest first, that have √−1 and √2: p ≡ 9 (mod 16).

    There are a few hundred of them, and most expressions have values modulo nearly all.
    """
    # 16 | p − 9: then 8 | p − 1, so that there is an eighth root of 1, with √−1 and √2; and half of
    # all residues have a root, which is found by one power
    yield from filter(_is_prime, range(2**31 - 7, 2**31 - _PRIME_RANGE, -16))


_is_prime = cache(sp.isprime)


@cache
def _eighth_root(prime: int) -> int:
    """Return a primitive eighth root of 1; its square is √−1."""
    candidates = (pow(n, (prime - 1) // 8, prime) for n in count(2))
    return next(c for c in candidates if pow(c, 4, prime) == prime - 1)


class UnsuitablePrimeError(ArithmeticError):
    """A number such as √2 does not exist modulo this prime; try the next one."""


class Residues:
    """Random points modulo a prime, and the values of expressions there.

    Parameters
    ----------
    prime : int
        One of ``primes``.
    symbols : iterable of Symbol
        Symbols that get a random value at each point.
    expressions : sequence of Expr
        The expressions that are evaluated.
    size : int
        Number of points.
    constants : dict
        Residues of numbers such as sin(0.3), the same at all points of a prime; entries are added.
    seed : int
        Seed of the random numbers.

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
        self.values = self._values_at_usable_points(list(expressions))

    def __getitem__(self, e: sp.Expr) -> Residue:
        """Return the values of a symbol or of one of the expressions, shape (points,)."""
        return self.values[e]

    def _values_at_usable_points(self, expressions: list[sp.Expr]) -> dict[sp.Basic, Residue]:
        """Draw points until ``size`` of them have all roots and no division by zero.

        If too few have all roots, roots are replaced by random numbers.
        """
        outputs, subexpressions = [*self._symbols, *expressions], list(parts_of(expressions))
        # a point without √u is dropped, on average one of two for each root: with many roots none
        # may remain
        for self._with_roots in (True, False):
            batches: list[list[Residue]] = []
            for _ in range(_BATCHES):
                batches.append(self._batch(outputs, subexpressions))
                if sum(len(batch[0]) for batch in batches) >= self.size:
                    columns = [np.concatenate(c)[: self.size] for c in zip(*batches, strict=True)]
                    return dict(zip(outputs, columns, strict=True))
        raise UnsuitablePrimeError(f"no point modulo {self.prime} has all the values")

    def _batch(
        self, outputs: Sequence[sp.Basic], subexpressions: Sequence[sp.Basic]
    ) -> list[Residue]:
        """Return the values of ``outputs`` at the usable ones of ``size`` random points."""
        self._random_values: dict[Any, Residue] = {}
        self._usable = np.ones(self.size, dtype=bool)
        values: dict[sp.Basic, Residue] = {s: self._draw() for s in self._symbols}
        for e in subexpressions:
            if e not in values:
                values[e] = self._value(e, values)
        return [values[e][self._usable] for e in outputs]

    # ------------------------------------------------------------ one expression

    def _value(self, e: sp.Basic, values: Mapping[sp.Basic, Residue]) -> Residue:
        """Return an expression modulo the prime, from the residues of its arguments."""
        p = self.prime
        # a float is the binary number that it is, not the decimal that it was
        if e.is_Rational or e.is_Float:
            return self._number(sp.Rational(e))
        if isinstance(e, Shared):
            return values[e.args[0]]
        if e.is_Add:
            return reduce(lambda a, b: (a + b) % p, (values[a] for a in e.args))
        if e.is_Mul:
            return reduce(lambda a, b: a * b % p, (values[a] for a in e.args))
        if e.func in _CIRCULAR or e.func in _HYPERBOLIC:
            return self._exponential(e)
        if e.is_Pow and (e.exp.is_Rational or e.exp.is_Float):
            return self._power_of(e.base, sp.Rational(e.exp), values[e.base])
        return self._random_values_for(e)

    def _number(self, x: sp.Rational) -> Residue:
        """Return p q⁻¹ modulo the prime of a fraction p/q, at every point."""
        residue = int(x.p) * pow(int(x.q), -1, self.prime) % self.prime
        return np.full(self.size, residue)

    def _draw(self) -> Residue:
        """Return random numbers other than 0."""
        return self._rng.integers(1, self.prime, self.size)

    def _random_values_for(self, e: Any) -> Residue:
        """Return random numbers for an expression without rules; one number for a constant."""
        if e not in self._random_values:
            if getattr(e, "free_symbols", None):
                self._random_values[e] = self._draw()
            else:
                draw = int(self._rng.integers(1, self.prime))
                self._random_values[e] = np.full(self.size, self._constants.setdefault(e, draw))
        return self._random_values[e]

    # ------------------------------------------------------------ powers and roots

    def _power(self, x: Residue, n: int) -> Residue:
        """Return xⁿ by repeated squaring; points with x = 0 and n < 0 are marked unusable."""
        if n < 0:
            self._usable &= x != 0
            n %= self.prime - 1  # Fermat: x^(p − 1) = 1
        power = np.ones_like(x)
        while n:
            if n & 1:
                power = power * x % self.prime
            x, n = x * x % self.prime, n >> 1
        return power

    def _power_of(self, e: sp.Expr, exponent: sp.Rational, base: Residue) -> Residue:
        """Return base^exponent, by square roots and by one root of odd order.

        ``base`` has the residues of e. A root of odd order r (``odd``) is unique,
        x^(1/r mod prime − 1), if r and prime − 1 are coprime.
        """
        q = int(exponent.q)
        # q = 2^twos · odd
        twos = (q & -q).bit_length() - 1
        odd = q >> twos
        if gcd(odd, self.prime - 1) > 1:
            raise UnsuitablePrimeError(f"numbers have several roots modulo {self.prime}")
        if q > 1 and not self._with_roots:
            root = self._random_values_for(sp.Pow(e, sp.Rational(1, q), evaluate=False))
        else:
            root = self._power(base, pow(odd, -1, self.prime - 1)) if odd > 1 else base
            for _ in range(twos):
                root = self._square_root(root)
            # a number has no root at any point, however many are drawn
            if q > 1 and not (self._usable.any() or e.free_symbols):
                raise UnsuitablePrimeError(f"{e} has no such root modulo {self.prime}")
        return self._power(root, int(exponent.p))

    def _square_root(self, x: Residue) -> Residue:
        """Return a square root of x; points without one are marked unusable.

        By Tonelli and Shanks it is, with p − 1 = 8 m and m odd, x^((m+1)/2) times an eighth root
        of 1.
        """
        p = self.prime
        root = candidate = self._power(x, ((p - 1) // 8 + 1) // 2)
        for _ in range(3):  # (r ζᵏ)² = r² ζ²ᵏ with ζ⁸ = 1: one of four candidates is a root
            candidate = candidate * _eighth_root(p) % p
            root = np.where(candidate * candidate % p == x, candidate, root)
        self._usable &= root * root % p == x
        return root

    # ------------------------------------------------------------ exponentials

    def _exponential(self, e: sp.Function) -> Residue:
        """Return sin, exp, … of Σ n_k u_k as rational functions of z = Π z_k^(n_k)."""
        p, circular = self.prime, e.func in _CIRCULAR
        z = np.ones(self.size, dtype=np.int64)
        for unit, n in _terms(e.args[0]):
            # z_k stands for exp(u_k/d) with the common denominator d of all n_k: powers are whole
            steps = n * self._units[unit]
            z = z * self._power(self._random_values_for((unit, circular)), int(steps)) % p
        inverse = self._power(z, -1)
        # sin = (z − 1/z)/2i and cos = (z + 1/z)/2 with i = √−1; sinh and cosh without i
        i = _eighth_root(p) ** 2 % p if circular else 1
        odd = (z - inverse) * pow(2 * i, -1, p) % p
        even = (z + inverse) * pow(2, -1, p) % p
        if e.func in (sp.tan, sp.tanh):
            return odd * self._power(even, -1) % p
        return {sp.exp: z, sp.sin: odd, sp.sinh: odd}.get(e.func, even)  # even: cos and cosh


def _terms(argument: sp.Expr) -> list[tuple[Any, sp.Rational]]:
    """Return pairs (u_k, n_k) with argument = Σ n_k u_k, where n_k is rational."""
    terms = []
    for term in sp.Add.make_args(sp.expand(argument)):
        factor, unit = term.as_coeff_Mul()
        if factor.is_Float:
            factor = sp.Rational(factor)
        terms.append((unit, factor) if factor.is_Rational else (term, sp.Integer(1)))
    return terms


def _angular_units(expressions: Sequence[sp.Expr]) -> dict[Any, int]:
    """Return u → d: all multiples n of u in arguments are integer multiples of 1/d."""
    units: dict[Any, int] = {}
    for e in parts_of(expressions):
        if e.func in _CIRCULAR or e.func in _HYPERBOLIC:
            for unit, n in _terms(e.args[0]):
                units[unit] = lcm(units.get(unit, 1), int(n.q))
    return units


# ---------------------------------------------------------------- identities

#: Suitable primes, and random points modulo each of them, at which expressions must vanish.
_PRIMES, _POINTS = 3, 20


def exactly(e: sp.Expr) -> sp.Expr:
    """Return the expression with every floating-point number as an exact fraction."""
    return e.xreplace({x: sp.Rational(x) for x in e.atoms(sp.Float)})


def identically_zero(sums: Sequence[Sequence[sp.Expr]]) -> str:
    """Return the method by which sums of terms are shown to vanish identically; "" if they do not.

    "expanded": all expansions are 0, a proof. "exact arithmetic at random points": expansion is
    too long, or does not decide.
    """
    exact = [[exactly(e) for e in terms] for terms in sums]
    totals = [sp.Add(*terms, evaluate=False) for terms in exact]
    nonzero = [e for e in totals if e != 0]
    # values refute fast; only sums without a nonzero value are expanded
    if nonzero and not vanish(nonzero):
        return ""
    proved = all(map(is_small, totals)) and all(
        sp.expand(sp.Add(*map(sp.expand, terms))) == 0 for terms in exact)
    return "expanded" if proved else "exact arithmetic at random points"


def vanish(expressions: Sequence[sp.Expr]) -> bool:
    """Whether all expressions vanish at random points modulo three suitable primes."""
    symbols = sorted(set().union(*(e.free_symbols for e in expressions)), key=str)
    prime_count = 0
    for prime in primes():
        # a prime may divide a denominator, or lack a root that the expressions have
        try:
            residues = Residues(prime, symbols, expressions, _POINTS, constants={}, seed=0)
        except UnsuitablePrimeError:
            continue
        if any(residues[e].any() for e in expressions):
            return False
        prime_count += 1
        if prime_count == _PRIMES:
            return True
    return False
