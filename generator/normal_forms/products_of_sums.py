"""Products, squares and powers of sums in a sum of terms.

**Products** e(a, b) = Σ_k f_k(a) h_k(b), as of two rotations. A kind is a set of symbols whose
powers add up to the same number in all terms; the symbols of a are some kinds, those of b the other
kinds. The products are a rank decomposition: h_k are the rows of the echelon form of the
coefficients of e, a matrix of the terms of a by the terms of b.

**Squares** Σ_k a_k (± m_1 ± m_2 …)², as T of a body with numeric moments. A square of a monomial,
a m², belongs to a sum with the number a. A mixed term is ±2 a m n, or a sum of such products, as
q_0 q_1 p_0 p_1 = (q_0 p_1)(q_1 p_0) = (q_0 p_0)(q_1 p_1). If only one choice of signs gives its
coefficient, m and n belong to one sum.

**Powers** of springs, rods and vector potentials:

    a (√u − l)²      in   a u − 2 a l √u + a l²
    a (x − y − l)²   in   a x² − 2 a x y + a y² − 2 a l x + 2 a l y + a l²
    a (x − y)ⁿ       in   its terms, by the binomial coefficients
    a (x + A)²       in   a x² + 2 a x A + a A²

A term such as a y², or the constant, may belong to several powers: each takes its share. A power
that would add a term is refused, so that the constant of H, and rounding errors, do not grow.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Mapping
from fractions import Fraction
from itertools import combinations, product
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import sympy as sp

from ..systems.elimination_order import connected_components
from .terms import (
    ONE,
    Monomial,
    Number,
    Terms,
    add_to,
    base_key,
    divides,
    inverse,
    multiply_monomials,
    order,
    quotient,
    scale_terms,
    total_of,
    varies,
)

__all__ = ["Echelon", "Power", "products_of", "split_off_powers", "squares_of"]

Key = TypeVar("Key", bound=Hashable)
#: Most terms, kinds of symbols and products of a product decomposition.
_MOST_TERMS, _MOST_KINDS, _MOST_PRODUCTS = 400, 6, 4


def products_of(terms: Terms) -> list[tuple[Terms, Terms]] | None:
    """Return the fewest pairs (f_k, h_k) with terms = Σ f_k h_k; None if there are none or > 4.

    The bases of each kind of symbols are all in the factors f_k, or all in the h_k.
    """
    has_integer_powers = all(isinstance(n, int) for m in terms for _, n in m)
    if not 4 <= len(terms) <= _MOST_TERMS or not has_integer_powers:
        return None
    all_kinds = kinds(terms)
    variable_kinds = [kind for kind in all_kinds if any(map(varies, kind))]
    if len(variable_kinds) < 2 or len(all_kinds) > _MOST_KINDS:
        return None
    # all ways to divide the kinds among f and h; the first variable kind belongs to f
    other_kinds = [kind for kind in all_kinds if kind != variable_kinds[0]]
    products: list[tuple[Terms, Terms]] | None = None
    for count in range(len(other_kinds)):
        for subset in combinations(other_kinds, count):
            f_bases = variable_kinds[0].union(*subset)
            # both factors must depend on variables
            if any(varies(base) for kind in variable_kinds for base in kind - f_bases):
                pairs = _decomposition(terms, f_bases)
                if products is None or len(pairs) < len(products):
                    products = pairs
    return products if products is not None and 1 < len(products) <= _MOST_PRODUCTS else None


def kinds(terms: Terms) -> list[frozenset[sp.Expr]]:
    """Return disjoint sets of bases; the exponents of each set add up to the same in every term.

    The differences of the exponents of two terms span a space; each set is a 0/1 vector of its
    orthogonal complement. An empty list is returned if the complement has no such basis.
    """
    bases = sorted({base for m in terms for base, _ in m}, key=base_key)
    first = dict(next(iter(terms)))
    echelon: Echelon[sp.Expr] = Echelon(base_key)
    for m in terms:
        powers = dict(m)
        differences = {base: powers.get(base, 0) - first.get(base, 0) for base in bases}
        echelon.add({base: n for base, n in differences.items() if n})
    reduced = echelon.echelon_rows()
    sets = []
    # a vector of the orthogonal complement for each column without a pivot
    for free in (base for base in bases if base not in reduced):
        weights = {free: 1} | {pivot: -row[free] for pivot, row in reduced.items() if free in row}
        if any(weight != 1 for weight in weights.values()):
            return []
        sets.append(frozenset(weights))
    are_disjoint = sum(map(len, sets)) == len(frozenset().union(*sets))
    return sets if are_disjoint else []


def _decomposition(terms: Terms, f_bases: frozenset[sp.Expr]) -> list[tuple[Terms, Terms]]:
    """Return the pairs (f_k, h_k), if f_k depends on ``f_bases`` and h_k on the other bases."""
    rows: dict[Monomial, dict[Monomial, Number]] = defaultdict(dict)
    for m, a in terms.items():
        f_part = frozenset(pair for pair in m if pair[0] in f_bases)
        rows[f_part][m - f_part] = a
    echelon: Echelon[Monomial] = Echelon(order)
    for row in rows.values():
        echelon.add(row)
    return [({f_part: row[pivot] for f_part, row in rows.items() if pivot in row}, dict(h))
            for pivot, h in echelon.echelon_rows().items()]


#: Most squares of monomials, and most products that give one term, of sums of squares.
_MOST_SQUARES, _MOST_ROOT_PAIRS = 64, 3


def squares_of(terms: Terms) -> list[tuple[Number, Terms]] | None:
    """Return pairs (a_k, s_k) with terms = Σ a_k s_k²; None if there are none."""
    if not all(isinstance(k, int) and k > 0 for m in terms for _, k in m):
        return None
    # monomials m of the terms a m²
    roots = {frozenset((base, k // 2) for base, k in m): a for m, a in terms.items()
             if not any(k % 2 for _, k in m)}
    if not roots or len(roots) > _MOST_SQUARES or len(roots) == len(terms):
        return None  # without mixed terms there is nothing to combine
    # a mixed term 2 a m n of (m ± n)² joins the roots m and n, with this sign
    neighbours: dict[Monomial, list[tuple[Monomial, int]]] = defaultdict(list)
    for t, a in terms.items():
        if any(k % 2 for _, k in t):
            signs = _signs(t, a, roots)
            if signs is None:
                return None
            for (m, n), sign in signs:
                neighbours[m].append((n, sign))
                neighbours[n].append((m, sign))
    sums = _connected_sums(roots, neighbours)
    # signs were chosen term by term: the squares must give exactly these terms
    remainder = dict(terms)
    for a, root in sums:
        for m, b in root.items():
            for n, c in root.items():
                add_to(remainder, multiply_monomials(m, n).monomial, -a * b * c)
    return None if remainder else sums


def _signs(
    t: Monomial, a: Number, roots: dict[Monomial, Number]
) -> list[tuple[tuple[Monomial, Monomial], int]] | None:
    """Return the pairs (m, n) of roots and their signs s with a t = Σ 2 s a_m m n.

    Returns None if no choice of signs gives a, and no pair if several do: then other terms
    determine the sums.
    """
    # roots m and n with m n = t, whose squares have the same coefficient
    pairs: set[frozenset[Monomial]] = set()
    for m in roots:
        if divides(m, t):
            n = multiply_monomials(t, inverse(m)).monomial
            if n in roots and roots[n] == roots[m]:
                pairs.add(frozenset([m, n]))
    if len(pairs) > _MOST_ROOT_PAIRS:
        return None
    # in the order of monomials, not of sets: equal sums have equal forms in every process
    ordered = sorted((tuple(sorted(pair, key=order)) for pair in pairs),
                     key=lambda pair: tuple(map(order, pair)))
    solutions: list[tuple[int, ...]] = []
    for signs in product((-1, 0, 1), repeat=len(ordered)):
        coefficient = sum(2 * s * roots[m] for s, (m, _) in zip(signs, ordered, strict=True))
        if coefficient == a:
            solutions.append(signs)
    if len(solutions) != 1:
        return [] if solutions else None
    return [((m, n), s) for (m, n), s in zip(ordered, solutions[0], strict=True) if s]


def _connected_sums(
    roots: dict[Monomial, Number], neighbours: dict[Monomial, list[tuple[Monomial, int]]]
) -> list[tuple[Number, Terms]]:
    """Return (a, s) of each connected sum s = m ± n ± …, whose first monomial has the sign +.

    ``roots`` are the monomials with the coefficients of their squares; ``neighbours`` the
    monomials that mixed terms join to each, with the sign of the product.
    """
    sums: list[tuple[Number, Terms]] = []
    visited: set[Monomial] = set()
    for first in sorted(roots, key=order):
        if first in visited:
            continue
        # all monomials that mixed terms join to the first one, each with its sign against it
        signs: Terms = {first: 1}
        stack = [first]
        while stack:
            m = stack.pop()
            for n, sign in neighbours[m]:
                if n not in signs:
                    signs[n] = sign * signs[m]
                    stack.append(n)
        visited |= signs.keys()
        sums.append((roots[first], signs))
    return sums


if TYPE_CHECKING:
    from .shortest_sum import Compact


Pair = tuple[sp.Expr, sp.Expr]
#: A constant factor, as a term, and a power of a sum.
Power = tuple[tuple[Monomial, Number], sp.Expr]

#: Most terms of a radicand whose root is tried in third and fourth powers.
_LARGEST_LENGTH = 30
_HALF = sp.Rational(1, 2)


def split_off_powers(
    terms: Terms, compact: Compact, momenta: frozenset[sp.Symbol] | None = None
) -> tuple[list[Power], Terms]:
    """Return powers of sums, and the remaining terms.

    With ``momenta``, only squares a (p + A(q))² are split off; without, only the other powers.
    """
    splitter = _PowerSplitter(dict(terms), compact)
    if momenta is None:
        splitter.take_lengths()
        splitter.take_pairs()
        splitter.take_shifted_squares()
    else:
        splitter.take_completed_squares(momenta)
    return splitter.powers, splitter.remainder


class _PowerSplitter:
    """Splits powers of sums off terms, one after the other."""

    def __init__(self, terms: Terms, compact: Compact) -> None:
        """Sort the terms by their variables: each product of variables → the constants it is times.
        """
        self.remainder = terms
        self.compact = compact
        self.form = compact.form
        self.powers: list[Power] = []
        #: Product of variables → the constants it is multiplied by.
        self.constants_of: dict[Monomial, list[Monomial]] = defaultdict(list)
        for m in terms:
            variables, constants = compact.split(m)
            self.constants_of[variables].append(constants)

    def _take(self, outer: tuple[Monomial, Number], root: Terms, n: int, second: Terms) -> bool:
        """Subtract a (r + s)ⁿ, where n a s is ``second``, if the remainder has its terms.

        ``outer`` is a, ``root`` is r. A coefficient of the remainder must have the sign of the
        subtracted one and be at least as large; only the terms of a rⁿ may lack, if the number of
        terms does not grow. Returns whether the power was subtracted.
        """
        m, a = outer
        shift = self.form.product([second, {inverse(m): quotient(1, n * a)}])
        terms = self.form.product([{m: a}, *[total_of(root, shift)] * n])
        optional = self.form.product([{m: a}, *[root] * n])
        # the share b of a coefficient c: 0 < b/c ≤ 1; a missing term gives b/(−b) = −1
        if not all(0 < quotient(b, self.remainder.get(k, -b)) <= 1 for k, b in terms.items()
                   if k not in optional):
            return False
        remainder = total_of(self.remainder, scale_terms(terms, -1))
        if len(remainder) > len(self.remainder):
            return False
        self.remainder = remainder
        self.powers.append((outer, sp.Add(self.compact(root), self.compact(shift)) ** n))
        return True

    def _take_powers_of_sums(self, first: Terms, root: Terms, n: int, second: Terms) -> None:
        """Subtract a (r + s)ⁿ for each a in ``first``, with n a s one term of ``second`` or all.

        r is ``root``.
        """
        for m in sorted(first, key=order):
            subsets = [{b: second[b]} for b in sorted(second, key=order)]
            for subset in [*subsets, second] if len(subsets) > 1 else subsets:
                if self._take((m, first[m]), root, n, subset):
                    second = {b: c for b, c in second.items() if b not in subset}
                    break

    # ------------------------------------------------------------ lengths √u

    def take_lengths(self) -> None:
        """Subtract a (√u + s)ⁿ, n = 4, 3, 2, from the remainder: u a sum, as x² + y², s constant.

        Each u whose root occurs in a term is tried, those with the longest products of variables
        first. The terms a √uⁿ give a, the terms n a s √u^(n−1) give s.
        """
        sums = {base for m in self.remainder for base, n in m if base.is_Add and n == _HALF}
        for base in sorted(sums, key=lambda base: (-self._variable_count(base), base_key(base))):
            root: Terms = {frozenset([(base, _HALF)]): 1}
            powers: list[Terms] = [{ONE: 1}, root]  # entry k is √u^k
            highest = 4 if len(self.form.terms(base)) <= _LARGEST_LENGTH else 2
            for _ in range(highest - 1):
                powers.append(self.form.product([powers[-1], root]))
            for n in range(highest, 1, -1):
                leading, next_lower = (self._common_constants(powers[k]) for k in (n, n - 1))
                self._take_powers_of_sums(leading, root, n, next_lower)

    def _variable_count(self, base: sp.Expr) -> int:
        """Return the largest number of variable bases in a term of a sum."""
        return max(len(self.compact.split(m)[0]) for m in self.form.terms(base))

    def _common_constants(self, u: Terms) -> Terms:
        """Return the constants a of all a·u in the remaining terms.

        Only the terms of u with the most variable factors are compared: other powers may have
        changed the coefficients of the other terms.
        """
        factors = {m: self.compact.split(m) for m in u}
        highest = max(len(moving) for moving, _ in factors.values())
        compared = [m for m in u if len(factors[m][0]) == highest]
        first = min(compared, key=order)
        common: Terms = {}
        for constants in self.constants_of.get(factors[first][0], ()):
            a = multiply_monomials(constants, inverse(factors[first][1])).monomial
            ratios = [quotient(self.remainder.get(multiply_monomials(a, k).monomial, 0), u[k])
                      for k in compared]
            # all ratios have one sign: the smallest is the share of u
            if all(r > 0 for r in ratios) or all(r < 0 for r in ratios):
                common[a] = smaller(*ratios)
        return common

    # ------------------------------------------------------------ squares of p + A

    def take_completed_squares(self, momenta: frozenset[sp.Symbol]) -> None:
        """Subtract a (p + A)², where A depends on no momenta, for each p with such terms."""
        terms_with: dict[sp.Symbol, list[Monomial]] = defaultdict(list)
        for m in self.remainder:
            for x in {x for base, _ in m for x in base.free_symbols & momenta}:
                terms_with[x].append(m)
        for x in sorted(terms_with, key=base_key):
            linear, square = self._cofactors(x, terms_with[x], momenta)
            if len(square) != 1:
                continue
            (factor, a), = square.items()
            # a is constant, and A is not: a p² + 2 a p A
            has_variable_shift = any(self.compact.split(m)[0] for m in linear)
            if not self.compact.split(factor)[0] and has_variable_shift:
                self._take((factor, a), {frozenset([(x, 1)]): 1}, n=2, second=linear)

    def _cofactors(
        self, x: sp.Symbol, monomials: Iterable[Monomial], momenta: frozenset[sp.Symbol]
    ) -> tuple[Terms, Terms]:
        """Return the cofactors of a momentum x and of x² in the remaining terms.

        ``monomials`` are the terms with x. Both are empty if x has another power, or a cofactor
        contains momenta.
        """
        linear: Terms = {}
        square: Terms = {}
        for m in monomials:
            cofactor = frozenset(power for power in m if power[0] != x)
            cofactors = {1: linear, 2: square}.get(dict(m).get(x, 0))
            has_momenta = any(not momenta.isdisjoint(base.free_symbols) for base, _ in cofactor)
            if cofactors is None or m not in self.remainder or has_momenta:
                return {}, {}
            cofactors[cofactor] = self.remainder[m]
        return linear, square

    # ------------------------------------------------------------ powers of x ± y

    def take_pairs(self) -> None:
        """Subtract powers of sums and differences of two bases, a (x ± y)ⁿ.

        ``mixed`` maps the constant factor and the degree n to the pairs (x, y), and these to the
        coefficients of x^(n−k) yᵏ by k.
        """
        mixed: dict[tuple[Monomial, int], dict[Pair, dict[int, Number]]]
        mixed = defaultdict(lambda: defaultdict(dict))
        for m, a in self.remainder.items():
            variables, constants = self.compact.split(m)
            # terms c xⁿ⁻ᵏ yᵏ of two variables
            if len(variables) == 2 and all(isinstance(n, int) and n > 0 for _, n in variables):
                (x, n), (y, k) = sorted(variables, key=lambda pair: base_key(pair[0]))
                mixed[constants, n + k][x, y][k] = a
        for constants, n in sorted(mixed, key=lambda key: (key[1], order(key[0]))):
            power_of = {pair: self._power_of(constants, n, pair, by_power)
                        for pair, by_power in mixed[constants, n].items()}
            # pairs with a variable in common share its pure power: all of them, or none
            for group in _group_by_base(power_of):
                powers = {pair: power for pair in group if (power := power_of[pair])}
                if len(powers) == len(group):
                    self._take_group(constants, n, powers)

    def _power_of(
        self, constants: Monomial, n: int, pair: Pair, by_power: dict[int, Number]
    ) -> tuple[Number, int] | None:
        """Return a and the sign of a (x ± y)ⁿ; None if the terms are not those of such a power.

        ``by_power``: k → coefficient of xⁿ⁻ᵏ yᵏ, 0 < k < n, without the factor ``constants``.

        Binomial theorem: the coefficient of xⁿ⁻ᵏ yᵏ is a C(n, k) (±1)ᵏ. For n = 2 the signs of
        x² and y² determine the sign of a.
        """
        if len(by_power) < n - 1:
            return None  # (x ± y)ⁿ has all n − 1 mixed terms
        if n == 2:
            # a x² ± 2 a x y + a y²: both squares have the sign of a
            squares = [self.remainder.get(constants | {(z, 2)}, 0) for z in pair]
            if squares[0] * squares[1] <= 0:
                return None
            a = quotient(max(by_power[1], -by_power[1]), 2 if squares[0] > 0 else -2)
            return a, 1 if by_power[1] * a > 0 else -1
        sign = 1 if by_power[1] * by_power[2] > 0 else -1
        a = quotient(by_power[1], n * sign)
        is_binomial = all(b == a * math.comb(n, k) * sign**k for k, b in by_power.items())
        return (a, sign) if is_binomial else None

    def _take_group(
        self, constants: Monomial, n: int, powers: dict[Pair, tuple[Number, int]]
    ) -> None:
        """Subtract a (x ± y)ⁿ for every pair of a coupled group, or for none.

        They are subtracted if fewer terms remain, or if all xⁿ are present: a sum of squares.
        """
        # coefficients of the pure powers xⁿ in Σ a (x ± y)ⁿ, and in the remainder
        subtracted: dict[sp.Expr, Number] = defaultdict(lambda: 0)
        for (x, y), (a, sign) in powers.items():
            subtracted[x] += a
            subtracted[y] += a * sign**n
        present = {x: self.remainder.get(constants | {(x, n)}, 0) for x in subtracted}
        # each (x ± y)ⁿ replaces n − 1 mixed terms
        terms_after = len(powers) + sum(present[x] != subtracted[x] for x in subtracted)
        terms_before = (n - 1) * len(powers) + sum(a != 0 for a in present.values())
        # the share a of each xⁿ that is present: 0 < a/b ≤ 1; a missing one gives a/(−a) = −1
        is_covered = n % 2 == 0 and all(
            0 < quotient(a, present[x] or -a) <= 1 for x, a in subtracted.items())
        # a sum of squares is kept even where it is no shorter: it has no cancellation
        if terms_after >= terms_before and not is_covered:
            return
        for (x, y), (a, sign) in powers.items():
            root: Terms = {frozenset([(x, 1)]): 1, frozenset([(y, 1)]): sign}
            if n > 2 or not self._take((constants, a), root, n=2,
                                       second=self._linear_constant(x, y, sign)):
                power = self.form.product([{constants: -a}, *[root] * n])
                self.remainder = total_of(self.remainder, power)
                self.powers.append(((constants, a), self.compact(root) ** n))

    def _linear_constant(self, x: sp.Expr, y: sp.Expr, sign: int) -> Terms:
        """Return the first of the constants b of b (x ± y) in the remaining terms."""
        for constants in sorted(self.constants_of.get(frozenset([(x, 1)]), ()), key=order):
            b, c = (self.remainder.get(constants | {(z, 1)}, 0) for z in (x, y))
            if b * c * sign > 0:
                return {constants: smaller(b, c * sign)}
        return {}

    # ------------------------------------------------------------ squares of x + s

    def take_shifted_squares(self) -> None:
        """Subtract squares a (x + s)² of one base and a constant."""
        for variables in sorted(self.constants_of, key=order):
            if len(variables) != 1:
                continue
            (base, n), = variables
            if n == 2:
                root: Terms = {frozenset([(base, 1)]): 1}
                self._take_powers_of_sums(self._constants_times(base, n=2), root, n=2,
                                          second=self._constants_times(base, n=1))

    def _constants_times(self, base: sp.Expr, n: int) -> Terms:
        """Return the constants a of all terms a baseⁿ that remain."""
        power = frozenset([(base, n)])
        return {constants: self.remainder[constants | power]
                for constants in self.constants_of.get(power, ())
                if constants | power in self.remainder}


def smaller(*numbers: Number) -> Number:
    """Return the number that is closest to zero."""
    return min(numbers, key=lambda a: Fraction(max(a, -a)))


def _group_by_base(pairs: Iterable[Pair]) -> list[list[Pair]]:
    """Return groups of pairs; pairs with a common base are in one group."""
    ordered = sorted(pairs, key=lambda pair: tuple(map(base_key, pair)))
    index_of: dict[sp.Expr, int] = {}
    for pair in ordered:
        for base in pair:
            index_of.setdefault(base, len(index_of))
    groups = connected_components(frozenset(map(index_of.__getitem__, pair)) for pair in ordered)
    group_of = {a: i for i, group in enumerate(groups) for a in group}
    sorted_groups: list[list[Pair]] = [[] for _ in groups]
    for pair in ordered:
        sorted_groups[group_of[index_of[pair[0]]]].append(pair)
    return sorted_groups


# ---------------------------------------------------------------- exact elimination


class Echelon(Generic[Key]):
    """Sparse rational vectors in echelon form, each a linear combination of the added vectors.

    Parameters
    ----------
    order : function
        The key of an order of the entries; the first entry of a vector becomes its pivot.
    """

    def __init__(self, order: Callable[[Key], Any]) -> None:
        self.order = order
        self._rows: list[tuple[Key, dict[Key, Number], dict[int, Number]]] = []

    def _reduce(
        self, vector: Mapping[Key, Number], coefficients: Mapping[int, Number]
    ) -> tuple[dict[Key, Number], dict[int, Number]]:
        """Return the vector minus combinations of the rows, and the combination, by elimination."""
        remainder, combination = dict(vector), dict(coefficients)
        for pivot, row, row_combination in self._rows:
            if pivot in remainder:
                a = remainder[pivot]
                _subtract(remainder, a, row)
                _subtract(combination, a, row_combination)
        return remainder, combination

    def add(self, vector: Mapping[Key, Number]) -> bool:
        """Add a vector; return False, and leave it out, if it depends on those before."""
        # the remainder is the vector itself, 1 time, minus a combination of those before
        remainder, combination = self._reduce(vector, {len(self._rows): 1})
        if not remainder:
            return False
        pivot = min(remainder, key=self.order)
        a = remainder[pivot]
        self._rows.append((pivot, {k: quotient(b, a) for k, b in remainder.items()},
                           {j: quotient(b, a) for j, b in combination.items()}))
        return True

    def solve(self, vector: Mapping[Key, Number]) -> dict[int, Number]:
        """Return c_j with vector = Σ_j c_j v_j, of a vector that depends on the added v_j.

        j counts the independent vectors, for which ``add`` returned True.
        """
        _, combination = self._reduce(vector, coefficients={})
        return {j: -a for j, a in combination.items()}

    def echelon_rows(self) -> dict[Key, dict[Key, Number]]:
        """Return the reduced echelon form, rows by their pivots."""
        rows: dict[Key, dict[Key, Number]] = {}
        for pivot, row, _ in reversed(self._rows):
            reduced_row = dict(row)
            for lower_pivot, lower_row in rows.items():
                if lower_pivot in reduced_row:
                    _subtract(reduced_row, reduced_row[lower_pivot], lower_row)
            rows[pivot] = reduced_row
        return {pivot: rows[pivot] for pivot in sorted(rows, key=self.order)}


def _subtract(vector: dict[Any, Number], a: Number, row: Mapping[Any, Number]) -> None:
    """Subtract a · row from a sparse vector in place; entries that become 0 are removed."""
    for k, b in row.items():
        difference = vector.get(k, 0) - a * b
        if difference:
            vector[k] = difference
        else:
            vector.pop(k, None)
