"""The shortest form of a sum of terms, derived from the terms alone.

Candidates are common factors, powers of sums, products, common denominators and coefficients.
The result depends on the terms only, never on the user's expression.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator

import sympy as sp

from .common_factors import absorb_factor_two, factors_of, square_root, without_common
from .expansion import NormalForm
from .products_of_sums import Echelon, Power, products_of, split_off_powers, squares_of
from .terms import (
    Monomial,
    Number,
    Terms,
    base_key,
    expression_of,
    is_below,
    is_rational,
    order,
    plain_exponent,
    quotient,
    rational,
    scale_terms,
    term,
    total_of,
    varies,
)

__all__ = ["Compact", "cost"]

#: Most terms of a sum whose common coefficients are sought beyond equal ones.
_LARGEST_LINES = 400
#: Limit of products of terms per term of the sum; the total is limited as well.
_PRODUCTS_PER_TERM = 20

#: Product of variables → its coefficient.
Coefficients = dict[Monomial, Terms]


def cost(expressions: Iterable[sp.Expr]) -> int:
    """Return the number of additions and products of expressions, each subexpression once.

    Divisions count 4, roots 8, functions 10. Constants cost nothing: they are computed once a run.
    """
    visited: set[sp.Basic] = set()
    total = 0
    stack: list[sp.Basic] = list(expressions)
    while stack:
        e = stack.pop()
        if e in visited or not e.args:
            continue
        visited.add(e)
        variable_args = [a for a in e.args if varies(a)]
        if variable_args:
            total += _own_cost(e, variable_args)
            stack += variable_args
    return total


def _own_cost(e: sp.Expr, variable_args: list[sp.Expr]) -> int:
    """Return the operations of e itself, without those of its arguments.

    ``variable_args`` are the arguments that depend on a variable; constants cost nothing.
    """
    if e.is_Add:
        # n variable terms take n − 1 additions, and one more with a constant term
        return len(variable_args) - (len(variable_args) == len(e.args))
    if e.is_Mul:
        constant_factor = sp.Mul(*(a for a in e.args if a not in variable_args))
        return len(variable_args) - is_power_of_two(constant_factor)
    if e.is_Pow and e.exp.is_Rational:
        exponent = abs(int(e.exp))
        # n − 1 products, or about log₂ n squares
        products = max(exponent - 1, 0) if exponent < 4 else exponent.bit_length()
        return products + (4 if e.exp < 0 else 0) + (0 if e.exp.is_Integer else 8)
    return 10


def is_power_of_two(e: sp.Expr) -> bool:
    """Whether e is ±2ⁿ with n ≥ 0; ``cost`` counts no product with such a number."""
    return bool(e.is_Integer and abs(int(e)).bit_count() == 1)


class Compact:
    """Shortest forms of sums of terms, with a cache.

    Parameters
    ----------
    form : NormalForm
        Expands and divides.
    """

    def __init__(self, form: NormalForm) -> None:
        self.form = form
        self._forms: dict[frozenset[tuple[Monomial, Number]], sp.Expr] = {}
        self._split: dict[Monomial, tuple[Monomial, Monomial]] = {}

    def __call__(self, terms: Terms) -> sp.Expr:
        """Return the terms in their shortest form."""
        key = frozenset(terms.items())
        if key not in self._forms:
            self._forms[key] = self._shortest(terms)
        return self._forms[key]

    def _shortest(self, terms: Terms) -> sp.Expr:
        """Return the shortest form: common factors outside, then a square, then ``_shortest_sum``.
        """
        if len(terms) <= 1:
            return expression_of(terms)
        self.form.spend(_PRODUCTS_PER_TERM * len(terms))
        outer, content, inner = without_common(terms)
        root, remainder = square_root(inner)
        if root and not remainder:  # a perfect square
            content, root = absorb_factor_two(content, root, n=2)
            return sp.Mul(term(outer, content), self(root) ** 2)
        # 2 (x + y) stays 2 x + 2 y: SymPy multiplies numbers into a sum
        if not outer and is_power_of_two(rational(content)):
            content, inner = (1 if content > 0 else -1), scale_terms(inner, abs(content))
        content, inner = absorb_factor_two(content, inner)
        if content == -1 and not outer:
            return negate(self(inner))
        if outer or content != 1:
            return sp.Mul(term(outer, content), self(inner))
        return self._shortest_sum(terms)

    def _shortest_sum(self, terms: Terms) -> sp.Expr:
        """Return the cheapest candidate; if costs are equal, the shorter, then the first one."""
        powers, remainder = split_off_powers(terms, self)
        if 4 * len(remainder) <= len(terms):  # powers take most terms: nothing else is shorter
            return self._with_powers(powers, remainder)
        candidates = list(dict.fromkeys(self._candidates(terms, powers, remainder)))
        costs = [cost([e]) for e in candidates]
        cheapest = [e for e, c in zip(candidates, costs, strict=True) if c == min(costs)]
        return cheapest[0] if len(cheapest) == 1 else min(cheapest, key=sp.count_ops)

    def _candidates(self, terms: Terms, powers: list[Power], remainder: Terms) -> Iterator[sp.Expr]:
        """Yield forms of a sum: factored, with powers, as products, as squares, over a denominator.

        ``powers`` and ``remainder`` are the sum as Σ a sⁿ + remainder. Of forms of equal length the
        first one is taken, so that their order is a part of the normal form.
        """
        factors = factors_of(terms)
        if factors is not None:
            yield self._product_of(factors)
        if powers:
            yield self._with_powers(powers, remainder)
        products = products_of(terms)
        if products is not None:
            yield sp.Add(*(self._product_of([(f, 1), (h, 1)]) for f, h in products))
        squares = squares_of(terms)
        if squares is not None:
            yield self._sum_of_squares(squares)
        over_denominator = self._over_common_denominator(terms)
        if over_denominator is not None:
            yield over_denominator
        yield from self._by_coefficients(terms)
        yield expression_of(terms)

    def _with_powers(self, powers: list[Power], remainder: Terms) -> sp.Expr:
        """Return Σ a sⁿ + remainder."""
        return sp.Add(*(sp.Mul(term(*outer), power) for outer, power in powers), self(remainder))

    def _product_of(self, factors: list[tuple[Terms, int]]) -> sp.Expr:
        """Return Π sⁿ of pairs (s, n), with all numbers in front."""
        number: Number = 1
        powers = []
        for factor, n in factors:
            outer, content, inner = without_common(factor)
            number, inner = absorb_factor_two(number * content**n, inner, n)
            powers.append((term(outer) * self(inner)) ** n)
        return sp.Mul(rational(number), *powers)

    def _sum_of_squares(self, squares: list[tuple[Number, Terms]]) -> sp.Expr:
        """Return Σ a (s_1² + s_2² + …): squares with the same number a have it in common."""
        squares_by: dict[Number, list[sp.Expr]] = defaultdict(list)
        for a, root in squares:
            squares_by[a].append(self(root) ** 2)
        return sp.Add(*(sp.Mul(rational(a), sp.Add(*sums)) for a, sums in squares_by.items()))

    # ------------------------------------------------------------ common coefficients

    def split(self, m: Monomial) -> tuple[Monomial, Monomial]:
        """Return the variable and the constant factors of a monomial."""
        if m not in self._split:
            constants = frozenset((base, n) for base, n in m
                                  if not (varies(base) or (not isinstance(n, int) and varies(n))))
            self._split[m] = m - constants, constants
        return self._split[m]

    def _by_coefficients(self, terms: Terms) -> Iterator[sp.Expr]:
        """Yield sums over common coefficients, Σ_j b_j P_j with P_j free of parameters."""
        coefficients: Coefficients = defaultdict(dict)
        for m, a in terms.items():
            variables, constants = self.split(m)
            coefficients[variables][constants] = a
        # one product of variables, or one of constants: they are common factors already
        if len(coefficients) < 2 or len({m for c in coefficients.values() for m in c}) < 2:
            return
        if len(coefficients) <= _LARGEST_LINES:
            yield self._sum_over(common_coefficients(coefficients))
        yield self._sum_over(group_by_factor(
            (constants, variables, a)
            for variables, c in coefficients.items() for constants, a in c.items()))

    def _sum_over(self, products: list[tuple[Terms, Terms]]) -> sp.Expr:
        """Return Σ_j b_j P_j of pairs (b_j, P_j)."""
        return sp.Add(*(self._product(b, polynomial) for b, polynomial in products))

    def _product(self, b: Terms, polynomial: Terms) -> sp.Expr:
        """Return the product b P, with numbers in front, not inside a sum."""
        if len(b) == 1:
            return self(self.form.product([b, polynomial]))
        outer, content, inner = without_common(polynomial)
        content, inner = absorb_factor_two(content, inner)
        return sp.Mul(self(b), term(outer, content), self(inner))

    # ------------------------------------------------------------ common denominators

    def _over_common_denominator(self, terms: Terms) -> sp.Expr | None:
        """Return the sum with the terms over a sum b combined in one fraction, or None.

        A term c bᵏ joins the numerator of bⁿ, n < k, as c bᵏ⁻ⁿ, if the numerator gets at most one
        term longer.
        """
        for base in sorted({b for m in terms for b, n in m if is_below(b, n)}, key=base_key):
            exponent_of = {m: dict(m).get(base, 0) for m in terms}
            lowest = min(filter(is_rational, exponent_of.values()))
            denominator = frozenset([(base, lowest)])
            numerator = {m - denominator: a for m, a in terms.items() if exponent_of[m] == lowest}
            remainder = {m: a for m, a in terms.items() if exponent_of[m] != lowest}
            term_count = len(remainder)
            for m in sorted(remainder, key=order):
                higher = plain_exponent(exponent_of[m] - lowest)
                if not isinstance(higher, int):  # a root or a symbol is no factor of the numerator
                    continue
                cofactor = {m - {(base, exponent_of[m])}: remainder[m]}
                expanded = self.form.product([cofactor, self.form.terms(base**higher)])
                extended = total_of(numerator, expanded)
                if len(extended) <= len(numerator) + 1:
                    numerator = extended
                    del remainder[m]
            # without a term that joined the numerator nothing is gained
            if len(remainder) < term_count:
                return sp.Add(sp.Mul(base**lowest, self(numerator)), self(remainder))
        return None


def negate(e: sp.Expr) -> sp.Expr:
    """Return −e, with the sign moved into the first sum that has fewer minus signs then."""
    for a in sp.Mul.make_args(e):
        if a.is_Add and a.could_extract_minus_sign():
            return sp.Mul(*(-b if b == a else b for b in sp.Mul.make_args(e)))
    return -e


# ---------------------------------------------------------------- common coefficients


def group_by_factor(
    products: Iterable[tuple[Monomial, Monomial, Number]],
) -> list[tuple[Terms, Terms]]:
    """Return Σ a m n as Σ_m m (Σ_n a n), as pairs of factors."""
    sums: dict[Monomial, Terms] = defaultdict(dict)
    for m, n, a in products:
        sums[m][n] = a
    return [({m: 1}, inner) for m, inner in sums.items()]


def common_coefficients(coefficients: Coefficients) -> list[tuple[Terms, Terms]]:
    """Return the fewest pairs (b_j, P_j) with terms = Σ_j b_j P_j.

    b_j is a basis of these coefficients: independent ones, the most frequent first, where
    coefficients that differ by a number count as equal.
    """
    counts = Counter(map(line_of, coefficients.values()))
    # the most frequent, then the shortest first; the last key makes the order unique
    lines = sorted(counts, key=lambda line: (-counts[line], len(line),
                                             [(order(m), a) for m, a in line]))
    echelon: Echelon[Monomial] = Echelon(order)
    basis: list[Terms] = [dict(line) for line in lines if echelon.add(dict(line))]
    polynomials: list[Terms] = [{} for _ in basis]
    for variables, c in coefficients.items():
        for j, a in echelon.solve(c).items():
            polynomials[j][variables] = a
    return list(zip(basis, polynomials, strict=True))


def line_of(c: Terms) -> tuple[tuple[Monomial, Number], ...]:
    """Return the terms in order, divided by the coefficient of the first."""
    terms = sorted(c.items(), key=lambda pair: order(pair[0]))
    return tuple((m, quotient(a, terms[0][1])) for m, a in terms)
