"""A SPARK tableau with exact coefficients; ``numeric`` and ``map_enclosures`` round them once.

        c │ A      │ Â      │ Ã        c̃ │ Ā
          │ bᵀ     │ b̂ᵀ     │ b̃ᵀ

k_i = H_p(Q_i, P_i), k̂_i = −H_q(Q_i, P_i), k̃_j = −g_q(Q̃_j)ᵀ Λ_j; A weights k in Q_i, Â weights k̂
and Ã weights k̃ in P_i, Ā weights k in Q̃_j (A.7). Stages i = 1..s, constraint nodes j = 0..p.
"""

from __future__ import annotations

import numbers
from collections.abc import Callable
from dataclasses import field
from functools import cached_property
from typing import Any

import mpmath as mp
import sympy as sp

from ...core.arguments import count_text
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.html import card, formula, table
from ...core.records import dataclass
from .enclosures import enclose_part, map_entries, widest_radius
from .node_algebra import Nodes, ValueNodes
from .nodes import BITS, Enclosure, exact_roots
from .separation_bounds import Rounding

__all__ = ["FIELDS", "NumericTableau", "Tableau"]

#: Most digits of ``numeric``.
MAX_DIGITS = 1000

#: The tables of a tableau, in the order of files, C and reports, each with the node sets of its
#: rows and columns ("s": s stages, "p": p + 1 constraint nodes).
FIELDS: dict[str, str] = {
    "A": "ss",
    "A_hat": "ss",
    "A_tilde": "sp",
    "A_bar": "ps",
    "b": "s",
    "b_hat": "s",
    "b_tilde": "p",
    "c": "s",
    "c_tilde": "p",
}


#: Butcher tables of notebooks: caption, matrix, last row, nodes.
_BUTCHER = (("A, b: velocities, in q", "A", "b", "c"),
            ("Â, b̂: forces, in p", "A_hat", "b_hat", "c"),
            ("Ã, b̃: constraint forces, in p", "A_tilde", "b_tilde", "c"),
            ("Ā: velocities, in q at the constraint nodes", "A_bar", "", "c_tilde"))
#: Largest number of stages whose exact entries are shown; digits of all others.
_EXACT_STAGES, _SHOWN_DIGITS = 3, 12
#: Characters of an entry that is shown exactly.
_SHORT = 30


@dataclass(frozen=True)
class NumericTableau:
    """The tableau's entries as numbers, under the tableau's own attribute names."""

    A: list[list[Any]]
    A_hat: list[list[Any]]
    A_tilde: list[list[Any]]
    A_bar: list[list[Any]]
    b: list[Any]
    b_hat: list[Any]
    b_tilde: list[Any]
    c: list[Any]
    c_tilde: list[Any]

    def __repr__(self) -> str:
        return f"<NumericTableau: {count_text(len(self.b), 'stage')}, p = {len(self.c_tilde) - 1}>"


@explain_arguments
@dataclass(frozen=True, eq=False)
class Tableau:
    """An (s, p)-SPARK tableau (A.1)-(A.7).

    Attributes
    ----------
    name : str
        A short C identifier: ``gl3``, ``liiiab4``, or the name of a user's tableau.
    stages, constraints : Nodes
        The nodes c_1..c_s and c̃_0..c̃_p with their exact arithmetic.
    basis : dict
        The tables named in ``FIELDS``, as exact matrices over the two node algebras.
    A, A_hat, A_tilde, A_bar, b, b_hat, b_tilde, c, c_tilde : nested tuples of Expr
        The exact coefficients: rationals and radicals while these are short, polynomials in
        ``CRootOf`` nodes beyond.
    claims : dict
        Claims of the family or the file, which ``conditions`` proves or refutes: ``order``,
        and the largest k of ``B``, ``C``, ``C_hat``, …; ``symmetric``, ``symplectic`` and
        ``L_stable`` are 1 for a property, 0 for its absence, and missing if nothing is claimed.
    rounding : Rounding or None
        Precision of a tableau in decimals; None if exact.
    """

    name: str
    stages: Nodes
    constraints: Nodes
    basis: dict[str, Any]
    claims: dict[str, int] = field(default_factory=dict)
    rounding: Rounding | None = None

    @property
    def decimal_digits(self) -> int | None:
        """Digits after the point of the least precise decimal entry; None for an exact tableau."""
        return None if self.rounding is None else self.rounding.digits

    def __repr__(self) -> str:
        order = f", order {self.claims['order']}" if "order" in self.claims else ""
        # a proof takes time: its result is shown where it has been computed already
        if self.is_given_in_numbers and {"order", "free_order"} <= vars(self).keys():
            order = f", proved order {self.order} with constraints, {self.free_order} without"
        return f"<Tableau {self.name}: {self.s} stages, p = {self.p}{order}>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: Butcher tables, with exact entries if they are short."""
        digits = self.numeric(digits=_SHOWN_DIGITS)
        exact = self if self.s <= _EXACT_STAGES else digits

        def cell(entry: Any, number: Any) -> Any:
            """Return an entry as a formula if it is exact and short, else its digits."""
            if isinstance(entry, sp.Expr) and len(str(entry)) <= _SHORT:
                return formula(sp.latex(entry))
            return mp.nstr(number, _SHOWN_DIGITS)

        def cells(entries: Any, numeric: Any) -> list[Any]:
            """Return the cells of a row, from its exact entries and their digits."""
            return [cell(e, x) for e, x in zip(entries, numeric, strict=True)]

        def line(name: str) -> list[Any]:
            """Return the cells of the vector of this name."""
            return cells(getattr(exact, name), getattr(digits, name))

        tables: list[str] = []
        for caption, matrix, weights, nodes in _BUTCHER:
            rows = [[node, *cells(entries, numeric)] for node, entries, numeric in zip(
                line(nodes), getattr(exact, matrix), getattr(digits, matrix), strict=True)]
            last_row = [["", *line(weights)]] if weights else []
            tables += [f"<p>{caption}</p>", table(rows + last_row)]
        return card(f"Tableau {self.name}: {self.s} stages, p = {self.p}", *tables)

    @property
    def s(self) -> int:
        """Number of stages."""
        return self.stages.size

    @property
    def p(self) -> int:
        """Number of constraint nodes after the first; the multipliers are Λ_0..Λ_p."""
        return self.constraints.size - 1

    @property
    def is_given_in_numbers(self) -> bool:
        """Whether the coefficients were given as numbers instead of derived."""
        return isinstance(self.stages, ValueNodes)

    @cached_property
    def order(self) -> int:
        """The order of convergence that the simplifying conditions prove."""
        from .conditions import order  # the conditions are written in terms of this class

        return order(self)

    @cached_property
    def free_order(self) -> int:
        """The proved order for systems without constraints, by A and Â alone."""
        from .conditions import order

        return order(self, constrained=False)

    def __getattr__(self, name: str) -> Any:
        if name not in FIELDS:
            raise AttributeError(f"A tableau has no attribute {name!r}.")
        coefficients = self._evaluate(name)
        object.__setattr__(self, name, coefficients)  # cached: __getattr__ is not called again
        return coefficients

    def nodes_of(self, name: str) -> list[Nodes]:
        """Return the node sets of the rows and columns of a table."""
        return [self.stages if kind == "s" else self.constraints for kind in FIELDS[name]]

    @cached_property
    def enclosures(self) -> dict[str, Any]:
        """Every table as nested tuples of certified enclosures, for correct rounding."""
        return self._enclosures(BITS)

    def _enclosures(self, bits: int) -> dict[str, Any]:
        """Return enclosures of every table, with nodes of radius 2^−bits."""
        enclosed: dict[tuple[int, ...], Any] = {}
        enclosures = {}
        for name in FIELDS:  # identical matrices, such as Â = A, are enclosed once
            key = (id(self.basis[name]), *map(id, self.nodes_of(name)))
            if key not in enclosed:
                enclosed[key] = enclose_part(self.basis[name].to_list(), self.nodes_of(name), bits)
            enclosures[name] = enclosed[key]
        return enclosures

    def numeric(self, digits: int = 50) -> NumericTableau:
        """Return the coefficients as nested lists of mpmath numbers.

        They are correct to ``digits`` digits after the point: enclosures are refined until all
        are narrower than 10^−digits.

        Raises
        ------
        InputError
            If ``digits`` is no whole number from 1 to 1000.
        """
        count = checked_digits(digits)

        def to_number(value: Enclosure) -> Any:
            """Return the centre of an enclosure, with some digits more than asked for."""
            with mp.workdps(count + 5):
                return mp.mpf(value.centre.numerator) / value.centre.denominator

        return NumericTableau(**map_entries(self._refine(count), to_number))

    def _refine(self, digits: int) -> dict[str, Any]:
        """Return enclosures of width 10^−digits at most."""
        bits, parts = BITS, self.enclosures
        while widest_radius(parts) * 2 * 10**digits > 1:
            bits = max(bits + 128, digits * 10 // 3 + 128)
            parts = self._enclosures(bits)
        return parts

    def map_enclosures(self, function: Callable[[Enclosure], Any]) -> dict[str, Any]:
        """Return every table as nested lists, with the function applied to each entry."""
        return map_entries(self.enclosures, function)

    def _evaluate(self, name: str) -> tuple[Any, ...]:
        """Return a table evaluated at its exact nodes u and v: Σ_kl C_kl uᵏ vˡ."""
        rows = self.basis[name].to_list()
        node_sets = self.nodes_of(name)
        is_matrix = len(node_sets) == 2
        if self.is_given_in_numbers:  # the entries in ``basis`` are the values at the nodes
            return tuple(tuple(row) if is_matrix else row[0] for row in rows)
        roots = [exact_roots(nodes.polynomial)  # type: ignore[attr-defined]
                 for nodes in node_sets]
        if not is_matrix:  # a vector has one column, the power v⁰
            return tuple(polynomial_value(rows, u, sp.Integer(0)) for u in roots[0])
        return tuple(tuple(polynomial_value(rows, u, v) for v in roots[1])
                     for u in roots[0])


def checked_digits(digits: Any) -> int:
    """Return a number of digits; raises ``InputError`` unless it is an integer from 1 to 1000."""
    is_integer = isinstance(digits, numbers.Integral) and not isinstance(digits, bool)
    if not is_integer or not 1 <= digits <= MAX_DIGITS:
        raise InputError(f"digits = {digits!r} is not usable; give a whole number from 1 to "
                         f"{MAX_DIGITS}.")
    return int(digits)


def polynomial_value(coefficients: list[list[Any]], u: sp.Expr, v: sp.Expr) -> sp.Expr:
    """Return Σ_kl C_kl uᵏ vˡ; expanded if u and v are of the form a + b√c."""
    if is_quadratic(u) and is_quadratic(v):
        return _quadratic_value(coefficients, u, v)
    return sp.Add(*(
        sp.QQ.to_sympy(entry) * u**k * v**l
        for k, row in enumerate(coefficients)
        for l, entry in enumerate(row)  # noqa: E741
        if entry
    ))


def _quadratic_value(coefficients: list[list[Any]], u: sp.Expr, v: sp.Expr) -> sp.Expr:
    """Return Σ_kl C_kl uᵏ vˡ of u = a + b√c and v = a' + b'√d as a sum of 1, √c, √d and √c√d.

    The factors are rational: uᵏ = r_k + s_k √c, vˡ = r'_l + s'_l √d (``_powers``).
    """
    root_u, (rationals_u, factors_u) = _powers(u, len(coefficients))
    root_v, (rationals_v, factors_v) = _powers(v, len(coefficients[0]))
    unit = sp.Integer(1)
    terms = []
    # (1 or √c, its coefficients in uᵏ) with (1 or √d, its coefficients in vˡ)
    for a, x_powers in ((unit, rationals_u), (root_u, factors_u)):
        for b, y_powers in ((unit, rationals_v), (root_v, factors_v)):
            factor = sp.QQ(0)
            for row, x in zip(coefficients, x_powers, strict=True):
                for entry, y in zip(row, y_powers, strict=True):
                    factor += entry * x * y
            terms.append(sp.QQ.to_sympy(factor) * a * b)
    return sp.Add(*terms)


def _powers(number: sp.Expr, count: int) -> tuple[sp.Expr, tuple[list[Any], list[Any]]]:
    """Return √c and the lists r_k, s_k with (a + b√c)ᵏ = r_k + s_k √c, k < count.

    r_(k+1) = a r_k + b c s_k and s_(k+1) = a s_k + b r_k.
    """
    rational, irrational = number.as_coeff_Add()
    factor, root = irrational.as_coeff_Mul()
    a, b, c = map(sp.QQ.from_sympy, (rational, factor, root**2))
    rationals, factors = [sp.QQ(1)], [sp.QQ(0)]
    for _ in range(count - 1):
        r, s = rationals[-1], factors[-1]
        rationals.append(a * r + b * c * s)
        factors.append(a * s + b * r)
    return root, (rationals, factors)


def is_quadratic(number: sp.Expr) -> bool:
    """Whether the only radicals of a number are square roots of rationals."""
    return not number.has(sp.CRootOf) and all(
        power.base.is_Rational for power in number.atoms(sp.Pow)
    )
