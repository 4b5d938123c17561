"""The shortest form of a sum of terms, derived from the terms alone.

Candidates are common factors, powers of sums, products, common denominators and coefficients.
The result depends on the terms only, never on the given expression.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator

import sympy as sp

from .common_factors import doubled, factors_of, square_root, without_common
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
    scaled,
    term,
    total_of,
    varies,
)

__all__ = ["Compact", "cost"]

#: Most terms of a sum whose common coefficients are sought beyond equal ones.
_LARGEST_LINES = 400
#: Limit of products of terms per term of the sum; the total is limited as well.
_WORK = 20

#: Product of variables → its coefficient.
Coefficients = dict[Monomial, Terms]


def cost(expressions: Iterable[sp.Expr]) -> int:
    """Return the additions and products of expressions, each subexpression once.

    Constants cost nothing: they are computed once a run.
    """
    seen: set[sp.Basic] = set()
    total = 0
    stack: list[sp.Basic] = list(expressions)
    while stack:
        e = stack.pop()
        if e in seen or not e.args:
            continue
        seen.add(e)
        parts = [a for a in e.args if varies(a)]
        if not parts:
            continue
        if e.is_Add:
            total += len(parts) - (len(parts) == len(e.args))
        elif e.is_Mul:
            number = sp.Mul(*(a for a in e.args if a not in parts))
            total += len(parts) - is_power_of_two(number)
        elif e.is_Pow and e.exp.is_Rational:
            whole = abs(int(e.exp))
            total += max(whole - 1, 0) if whole < 4 else whole.bit_length()
            total += (4 if e.exp < 0 else 0) + (0 if e.exp.is_Integer else 8)
        else:
            total += 10
        stack += parts
    return total


def is_power_of_two(number: sp.Expr) -> bool:
    """Whether a number is ±2ⁿ with n ≥ 0: a product with it is a sum, or nothing."""
    return bool(number.is_Integer and abs(int(number)).bit_count() == 1)


class Compact:
    """Shortest forms of sums of terms, with a cache.

    Parameters
    ----------
    form : NormalForm
        Expands and divides.
    """

    def __init__(self, form: NormalForm) -> None:
        self.form = form
        self._known: dict[frozenset[tuple[Monomial, Number]], sp.Expr] = {}
        self._split: dict[Monomial, tuple[Monomial, Monomial]] = {}

    def __call__(self, terms: Terms) -> sp.Expr:
        """Return the terms in their shortest form."""
        key = frozenset(terms.items())
        if key not in self._known:
            self._known[key] = self._found(terms)
        return self._known[key]

    def _found(self, terms: Terms) -> sp.Expr:
        if len(terms) <= 1:
            return expression_of(terms)
        self.form.spend(_WORK * len(terms))
        outer, value, inner = without_common(terms)
        root, left = square_root(inner)
        if root and not left:
            value, root = doubled(value, root, 2)
            return sp.Mul(term(outer, value), self(root) ** 2)
        if not outer and is_power_of_two(rational(value)):  # SymPy takes it into the sum anyway
            value, inner = (1 if value > 0 else -1), scaled(inner, abs(value))
        value, inner = doubled(value, inner)
        if value == -1 and not outer:
            return negated(self(inner))
        if outer or value != 1:
            return sp.Mul(term(outer, value), self(inner))
        return self._shortest_sum(terms)

    def _shortest_sum(self, terms: Terms) -> sp.Expr:
        """Return the cheapest form; of several, the shorter or earlier one."""
        powers, rest = split_off_powers(terms, self)
        if 4 * len(rest) <= len(terms):
            return self._with_powers(powers, rest)
        found = list(dict.fromkeys(self._candidates(terms, powers, rest)))
        costs = [cost([e]) for e in found]
        cheapest = [e for e, c in zip(found, costs, strict=True) if c == min(costs)]
        return cheapest[0] if len(cheapest) == 1 else min(cheapest, key=sp.count_ops)

    def _candidates(
        self, terms: Terms, powers: list[Power], rest: Terms
    ) -> Iterator[sp.Expr]:
        factors = factors_of(terms)
        if factors is not None:
            yield self._product_of(factors)
        if powers:
            yield self._with_powers(powers, rest)
        products = products_of(terms)
        if products is not None:
            yield sp.Add(*(self._product_of([(f, 1), (h, 1)]) for f, h in products))
        squares = squares_of(terms)
        if squares is not None:
            yield self._sum_of_squares(squares)
        together = self._over_one_bar(terms)
        if together is not None:
            yield together
        yield from self._by_coefficients(terms)
        yield expression_of(terms)

    def _with_powers(self, powers: list[Power], rest: Terms) -> sp.Expr:
        return sp.Add(*(sp.Mul(term(*outer), power) for outer, power in powers), self(rest))

    def _product_of(self, factors: list[tuple[Terms, int]]) -> sp.Expr:
        value: Number = 1
        made = []
        for factor, n in factors:
            outer, own, inner = without_common(factor)
            value, inner = doubled(value * own**n, inner, n)
            made.append((term(outer) * self(inner)) ** n)
        return sp.Mul(rational(value), *made)

    def _sum_of_squares(self, squares: list[tuple[Number, Terms]]) -> sp.Expr:
        """Return a sum of squares, those with the same number together."""
        by_number: dict[Number, list[sp.Expr]] = defaultdict(list)
        for a, root in squares:
            by_number[a].append(self(root) ** 2)
        return sp.Add(*(sp.Mul(rational(a), sp.Add(*own)) for a, own in by_number.items()))

    # ------------------------------------------------------------ coefficients in common

    def split(self, m: Monomial) -> tuple[Monomial, Monomial]:
        """Return the variable and the constant factors of a monomial."""
        if m not in self._split:
            still = frozenset((base, n) for base, n in m
                              if not (varies(base) or (not isinstance(n, int) and varies(n))))
            self._split[m] = m - still, still
        return self._split[m]

    def _by_coefficients(self, terms: Terms) -> Iterator[sp.Expr]:
        """Yield sums over common coefficients, Σ_j b_j P_j with P_j free of parameters."""
        coefficients: Coefficients = defaultdict(dict)
        for m, a in terms.items():
            moving, still = self.split(m)
            coefficients[moving][still] = a
        if len(coefficients) < 2 or len({m for c in coefficients.values() for m in c}) < 2:
            return
        if len(coefficients) <= _LARGEST_LINES:
            yield self._sum_over(common_coefficients(coefficients))
        yield self._sum_over(grouped(
            (still, moving, a) for moving, c in coefficients.items() for still, a in c.items()))

    def _sum_over(self, parts: list[tuple[Terms, Terms]]) -> sp.Expr:
        return sp.Add(*(self._product(b, part) for b, part in parts))

    def _product(self, b: Terms, part: Terms) -> sp.Expr:
        """Return a product; a numeric factor comes first, not in one of its sums."""
        if len(b) == 1:
            return self(self.form.product([b, part]))
        outer, value, inner = without_common(part)
        value, inner = doubled(value, inner)
        return sp.Mul(self(b), term(outer, value), self(inner))

    # ------------------------------------------------------------ bars

    def _over_one_bar(self, terms: Terms) -> sp.Expr | None:
        """Return the terms with a common denominator for each sum."""
        for base in sorted({b for m in terms for b, n in m if is_below(b, n)}, key=base_key):
            powers = {m: dict(m).get(base, 0) for m in terms}
            lowest = min(filter(is_rational, powers.values()))
            bar = frozenset([(base, lowest)])
            numerator = {m - bar: a for m, a in terms.items() if powers[m] == lowest}
            left = {m: a for m, a in terms.items() if powers[m] != lowest}
            before = len(left)
            for m in sorted(left, key=order):
                higher = plain_exponent(powers[m] - lowest)
                if isinstance(higher, int):
                    rest = {m - {(base, powers[m])}: left[m]}
                    above = self.form.product([rest, self.form.terms(base**higher)])
                    longer = total_of(numerator, above)
                    if len(longer) <= len(numerator) + 1:
                        numerator = longer
                        del left[m]
            if len(left) < before:
                return sp.Add(sp.Mul(base**lowest, self(numerator)), self(left))
        return None


def negated(e: sp.Expr) -> sp.Expr:
    """Return −e, with the sign moved into the first sum with fewer signs for it."""
    for a in sp.Mul.make_args(e):
        if a.is_Add and a.could_extract_minus_sign():
            return sp.Mul(*(-b if b == a else b for b in sp.Mul.make_args(e)))
    return -e


# ---------------------------------------------------------------- coefficients in common


def grouped(products: Iterable[tuple[Monomial, Monomial, Number]]) -> list[tuple[Terms, Terms]]:
    """Return the sum of products a·m·n as one of products of each m with a sum."""
    found: dict[Monomial, Terms] = defaultdict(dict)
    for m, other, a in products:
        found[m][other] = a
    return [({m: 1}, part) for m, part in found.items()]


def common_coefficients(found: Coefficients) -> list[tuple[Terms, Terms]]:
    """Return the fewest coefficients b_j, with P_j, that give the terms Σ_j b_j P_j.

    Of all coefficients that occur, up to a number, those that occur most often are taken first, as
    long as they are independent.
    """
    counts = Counter(map(line_of, found.values()))
    lines = sorted(counts, key=lambda line: (-counts[line], len(line),
                                             [(order(m), a) for m, a in line]))
    system: Echelon[Monomial] = Echelon(order)
    basis: list[Terms] = [dict(line) for line in lines if system.add(dict(line))]
    parts: list[Terms] = [{} for _ in basis]
    for moving, c in found.items():
        for j, a in system.solve(c).items():
            parts[j][moving] = a
    return list(zip(basis, parts, strict=True))


def line_of(c: Terms) -> tuple[tuple[Monomial, Number], ...]:
    """Return the terms in order, over the coefficient of the first."""
    terms = sorted(c.items(), key=lambda pair: order(pair[0]))
    return tuple((m, quotient(a, terms[0][1])) for m, a in terms)
