"""Tables of the fixed-point iteration: scaled, rounded so that the map stays symplectic."""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from itertools import zip_longest
from typing import Any

import mpmath as mp

from ...core.real_types import Real, round_binary
from ...core.records import dataclass
from ..tableaux.multipliers import multiplier_inverse
from ..tableaux.tableau import Tableau

__all__ = ["FastTableau"]

Row = list[Fraction]


@dataclass(frozen=True)
class FastTableau:
    """The coefficients of the scaled unknowns, rounded so that the map stays symplectic.

    Lane order of nodes: 1, …, p − 1, then node p for the rows g(Q̃_l) = 0 and node 0 for the
    multipliers Λ_j; node 0 has Q̃_0 = q.
    """

    tableau: Tableau

    @cached_property
    def centres(self) -> dict[str, Any]:
        """Every table as rationals within 2^−500 of the exact coefficients."""
        return self.tableau.map_enclosures(lambda e: e.centre)

    @cached_property
    def refusal(self) -> str | None:
        """Return why a tableau has no fast path; None if it has one."""
        coefficients = self.centres
        if 0 in [*coefficients["b"], *coefficients["b_hat"]]:
            return "a weight b_i is zero, and the scaled stages divide by it"
        if 0 in coefficients["b_tilde"][: self.tableau.p]:
            return "a weight b~_j is zero, and the scaled multipliers divide by it"
        if any(coefficients["A_bar"][0]):
            return "the first constraint node is not the start of the step"
        if self._inverse is None:
            return "the matrix A- A~ of the multipliers is singular"
        return None

    @property
    def _tolerance(self) -> Fraction:
        """Tolerance of x + y = 1: 0 for an exact tableau.

        For decimals it is ten units of the last digit over the square of the smallest weight.
        """
        # decimals satisfy a_ij/b_j + â_ji/b̂_i = 1 to their last digit over the weights they are
        # divided by
        digits = self.tableau.decimal_digits
        if digits is None:
            return Fraction(0)
        weights = [*self.centres["b"], *self.centres["b_tilde"]]
        smallest: Fraction = min(abs(w) for w in weights if w)
        return Fraction(1, 10 ** (digits - 1)) / smallest**2

    @property
    def _inverse(self) -> mp.matrix | None:
        """M⁻¹ of M = Ā Ã without its first row, p × p; None if M is singular."""
        return multiplier_inverse(self.tableau)

    @cached_property
    def scaled_coefficients(self) -> dict[str, list[Row]]:
        """Entries over weights before rounding, nodes 0..p in ascending order.

        μ_ij = a_ij/b_j, μ̂_ij = â_ij/b̂_j, ν_lj = ā_lj/b_j and ν̃_il = ã_il/b̃_l.
        """
        coefficients = self.centres
        # column p of Ã is 0, as is b̃_p of some methods: 0/1 in place of 0/0
        nonzero_b_tilde = [weight or Fraction(1) for weight in coefficients["b_tilde"]]
        return {
            "mu": _over_weights(coefficients["A"], coefficients["b"]),
            "mu_hat": _over_weights(coefficients["A_hat"], coefficients["b_hat"]),
            "nu": _over_weights(coefficients["A_bar"], coefficients["b"]),
            "nu_tilde": _over_weights(coefficients["A_tilde"], nonzero_b_tilde),
        }

    @property
    def _multiplier_nodes(self) -> list[int]:
        """Nodes of the multipliers, in lane order."""
        return [*range(1, self.tableau.p), 0]

    @property
    def _constraint_nodes(self) -> list[int]:
        """Nodes l of g(Q̃_l) = 0, in lane order."""
        return [*range(1, self.tableau.p), self.tableau.p]

    def _in_lanes(self, name: str, table: list[Row]) -> list[Row]:
        """Return the rows or columns of a table that belong to nodes in lane order."""
        if name == "nu":
            return [table[row] for row in self._constraint_nodes]
        if name == "nu_tilde":
            return [[row[j] for j in self._multiplier_nodes] for row in table]
        return table

    def tables(self, real: Real) -> dict[str, list[Row]]:
        """Return μ, μ̂, ν, ν̃, the scaled M⁻¹ and the extrapolation as numbers of the type.

        "onward" has w_i ℓ_j(1 + c_i)/w_j, which continues the stages of a step to the next one.
        """
        coefficients, exact, bits = self.centres, self.scaled_coefficients, real.bits
        tolerance = max(Fraction(1, 2**bits), self._tolerance)
        # pairs with μ_ij + μ̂_ji = 1 are rounded so that this holds exactly
        mu, mu_hat = _round_pairs(exact["mu"], exact["mu_hat"], bits, tolerance)
        onward = _extrapolation_weights(coefficients["c"], coefficients["b"],
                                        list(range(self.tableau.s)), bits)
        nu, nu_tilde = _round_pairs(exact["nu"], exact["nu_tilde"], bits, tolerance)
        return {
            "mu": mu,
            "mu_hat": mu_hat,
            "nu": self._in_lanes("nu", nu),
            "nu_tilde": self._in_lanes("nu_tilde", nu_tilde),
            "inverse": self._scaled_inverse(bits),
            "onward": onward,
            "onward_nodes": _extrapolation_weights(coefficients["c_tilde"], coefficients["b_tilde"],
                                                   self._multiplier_nodes, bits),
        }

    def _scaled_inverse(self, bits: int) -> list[Row]:
        """Return b̃_j (M⁻¹)_jl of the multiplier nodes j and the constraint nodes l, rounded."""
        inverse = self._inverse
        assert inverse is not None
        table: list[Row] = []
        for j in self._multiplier_nodes:
            weight = self.centres["b_tilde"][j]
            # columns of the inverse belong to the nodes 1, …, p
            table.append([round_binary(_fraction(inverse[j, node - 1]) * weight, bits)
                          for node in self._constraint_nodes])
        return table

    def even_odd_tables(self, real: Real) -> dict[str, list[Row]]:
        """Return μ, μ̂, ν and ν̃ split into odd and even parts: sums then take half the products.

        Let T be one of the tables, and i', j' counted from the other end. For a tableau that is
        symmetric in time, T_ij + T_i'j' = 1, and

            T_ij = ½ + o_ij + e_ij,  T_i'j = ½ + o_ij − e_ij,  o_ij' = −o_ij,  e_ij' = e_ij.

        A row has o_ij and e_ij of the first half of the columns, then e_ij of the middle column.
        The rows are the first half of the rows, and the middle row, which has e = 0. The last row
        of ν and column of ν̃, of the end of the step, are omitted: they are all ones.

        The tables of μ̂ and ν̃ are the negative transposes of those of μ and ν with o and e
        exchanged, so that μ̂_ij = 1 − μ_ji and ν̃_ij = 1 − ν_ji hold exactly in rounded numbers.
        Empty if the tableau is not symmetric, or has too few stages for a saving.
        """
        s, p = self.tableau.s, self.tableau.p
        if not _is_split_cheaper(s):
            return {}
        # size: the number of rows that are split, stages or inner nodes
        pairs = [("mu", "mu_hat", s)]
        if p:
            pairs.append(("nu", "nu_tilde", p - 1))
        # centres are within 2^−500 of the exact coefficients; quotients lose some digits
        tolerance = max(self._tolerance, Fraction(1, 2**400))
        tables: dict[str, list[Row]] = {}
        for name, dual, size in pairs:
            table = self._in_lanes(name, self.scaled_coefficients[name])
            dual_table = self._in_lanes(dual, self.scaled_coefficients[dual])
            # the end of the step, node p: Q̃_p = q + Σ_j b_j k_j is the row of ones, and the
            # multiplier of node 0 acts on all stages with its full weight, the column of ones
            ones = [*table[size:], [row[size] for row in dual_table if len(row) > size]]
            has_ones = all(abs(e - 1) <= tolerance for row in ones for e in row)
            is_symplectic = all(abs(table[j][i] + dual_table[i][j] - 1) <= tolerance
                                for i in range(s) for j in range(size))
            if not (has_ones and is_symplectic and _is_symmetric(table[:size], tolerance)):
                return {}
            odd, even = _split_even_odd(table[:size], real.bits)
            tables[name] = _half_rows(odd, even)
            tables[dual] = _half_rows(_negative_transpose(even), _negative_transpose(odd))
        return tables

    def rounding_errors(self, real: Real) -> list[Fraction]:
        """Return the rounding errors of the entries of μ, μ̂, ν and ν̃."""
        rounded = self.tables(real)
        errors: list[Fraction] = []
        for name, table in self.scaled_coefficients.items():
            for rounded_row, row in zip(rounded[name], self._in_lanes(name, table), strict=True):
                errors += [x - y for x, y in zip(rounded_row, row, strict=True)]
        return errors

    def is_symplectic(self, real: Real) -> bool:
        """Whether the rounded tables fulfil μ̂_ij = 1 − μ_ji and ν̃_ij = 1 − ν_ji exactly."""
        tables = self.tables(real)
        s, p = self.tableau.s, self.tableau.p
        stages = all(tables["mu_hat"][i][j] + tables["mu"][j][i] == 1
                     for i in range(s) for j in range(s))
        nodes = all(tables["nu_tilde"][i][j] + tables["nu"][j][i] == 1
                    for i in range(s) for j in range(p - 1))
        return stages and nodes


def _is_split_cheaper(s: int) -> bool:
    """Whether the split tables save more multiplications than they cost additions: from s = 7 on.
    """
    pairs = s // 2
    # Operations of ``even_odd_columns`` (engine/gyrospark/fixed_point/state.h) for an entry of q.
    # A pair of columns: x_j − x_j', x_j + x_j' and its part of Σx; once the half of Σx
    of_columns = 3 * pairs + 1
    # a pair of rows: s products, and for either row odd ± even and its base
    of_rows = pairs * (s + 4)
    # the middle row if s is odd: products of odd parts alone, and its base
    of_middle_row = s % 2 * (pairs + 1)
    return s * s > of_columns + of_rows + of_middle_row


def _over_weights(table: list[Row], weights: Row) -> list[Row]:
    """Return a_ij/b_j of a table and the weights b."""
    return [[a / b for a, b in zip(row, weights, strict=True)] for row in table]


def _is_symmetric(table: list[Row], tolerance: Fraction) -> bool:
    """Whether T_ij + T_i'j' = 1, where i' and j' are counted from the other end."""
    return all(abs(x + y - 1) <= tolerance
               for row, mirrored in zip(table, table[::-1], strict=True)
               for x, y in zip(row, mirrored[::-1], strict=True))


def _split_even_odd(table: list[Row], bits: int) -> tuple[list[Row], list[Row]]:
    """Return o_ij and e_ij for the first half of rows and columns and the middle ones.

    With j' = n − 1 − j: T_ij − T_ij' = 2 o_ij and T_ij + T_ij' − 1 = 2 e_ij. The middle column has
    o = 0, the middle row e = 0: these are left out.
    """
    row_count, column_count = len(table), len(table[0])
    rows_with_middle, columns_with_middle = (row_count + 1) // 2, (column_count + 1) // 2
    odd = [[round_binary((row[j] - row[column_count - 1 - j]) / 2, bits)
            for j in range(column_count // 2)] for row in table[:rows_with_middle]]
    even = [[round_binary((row[j] + row[column_count - 1 - j] - 1) / 2, bits)
             for j in range(columns_with_middle)] for row in table[:row_count // 2]]
    return odd, even


def _negative_transpose(table: list[Row]) -> list[Row]:
    """Return −Tᵀ."""
    return [[-row[j] for row in table] for j in range(len(table[0]))]


def _half_rows(odd: list[Row], even: list[Row]) -> list[Row]:
    """Return the rows (o, e); the middle row has zeros for e."""
    zeros = [Fraction(0)] * len(even[0])
    return [[*o, *e] for o, e in zip_longest(odd, even, fillvalue=zeros)]


def _extrapolation_weights(nodes: Row, weights: Row, order: list[int], bits: int) -> list[Row]:
    """Return w_i ℓ_j(1 + c_i)/w_j, which extrapolates values w_j y_j at the nodes by one step.

    ℓ_j are the Lagrange polynomials of the nodes c, and the engine keeps values times their
    weights w. ``order`` has the nodes that take part, entries are rounded to ``bits`` bits. If two
    nodes coincide, the identity is returned: the values are not extrapolated.
    """
    c, w = [nodes[i] for i in order], [weights[i] for i in order]
    if len(set(c)) < len(c):
        return [[Fraction(int(i == j)) for j in range(len(c))] for i in range(len(c))]
    table = []
    for i, node in enumerate(c):
        row = []
        for j, c_j in enumerate(c):
            weight = w[i] / w[j]
            # ℓ_j(1 + c_i): the stages of the next step lie one step further
            for c_k in c[:j] + c[j + 1 :]:
                weight *= (1 + node - c_k) / (c_j - c_k)
            row.append(round_binary(weight, bits))
        table.append(row)
    return table


def _fraction(x: mp.mpf) -> Fraction:
    """Return the exact value of an mpmath number, (−1)^sign · mantissa · 2^exponent."""
    sign, mantissa, exponent, _ = x._mpf_
    size = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
    return -size if sign else size


def _round_pairs(
    x: list[Row], y: list[Row], bits: int, tolerance: Fraction
) -> tuple[list[Row], list[Row]]:
    """Round two tables so that y_ij = 1 − x_ji is exact if it holds within the tolerance.

    The larger number of a pair, ≥ ½, is rounded: 1 minus it is then exact (Sterbenz).
    """
    x_rounded = [[round_binary(e, bits) for e in row] for row in x]
    y_rounded = [[round_binary(e, bits) for e in row] for row in y]
    for i, row in enumerate(y):
        for j, y_ij in enumerate(row):
            if abs(y_ij + x[j][i] - 1) > tolerance:
                continue  # not a symplectic pair: both are rounded separately
            # x + y = 1, so the larger is at least ½, and 1 minus its rounded value is exact
            # (Sterbenz)
            if y_ij >= x[j][i]:
                x_rounded[j][i] = 1 - y_rounded[i][j]
            else:
                y_rounded[i][j] = 1 - x_rounded[j][i]
    return x_rounded, y_rounded
