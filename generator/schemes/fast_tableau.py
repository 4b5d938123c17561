"""Tables of the fixed-point iteration: scaled, rounded so that the map stays symplectic."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import zip_longest
from typing import Any

import mpmath as mp

from ...core.real_types import Real, round_binary
from ..tableaux.multipliers import multiplier_inverse
from ..tableaux.tableau import Tableau

__all__ = ["FastTableau"]

Row = list[Fraction]


@dataclass(frozen=True)
class FastTableau:
    """The coefficients of the scaled unknowns, rounded so that the map stays symplectic.

    Nodes are in lane order: constraint nodes 1, …, p − 1, and last node p where g is asked for,
    node 0 where a multiplier acts; node 0 has Q̃_0 = q.
    """

    tableau: Tableau

    @cached_property
    def centres(self) -> dict[str, Any]:
        """Every part as exact rationals within 2^−500 of the coefficients."""
        return self.tableau.map_enclosures(lambda e: e.centre)

    @cached_property
    def refusal(self) -> str | None:
        """Why this tableau has no fast path; None if it has one."""
        part = self.centres
        p = self.tableau.p
        if 0 in [*part["b"], *part["b_hat"]]:
            return "a weight b_i is zero, and the scaled stages divide by it"
        if 0 in part["b_tilde"][:p]:
            return "a weight b~_j is zero, and the scaled multipliers divide by it"
        if any(part["A_bar"][0]):
            return "the first constraint node is not the start of the step"
        if p and self._inverse is None:
            return "the matrix A- A~ of the multipliers is singular"
        return None

    @property
    def _slack(self) -> Fraction:
        """How far decimals may be from a pair x, 1 − x: as far as conditions on them allow."""
        digits = self.tableau.digits_given
        if digits is None:
            return Fraction(0)
        weights = [*self.centres["b"], *self.centres["b_tilde"]]
        smallest: Fraction = min(abs(w) for w in weights if w)
        return Fraction(1, 10 ** (digits - 1)) / smallest**2

    @property
    def _inverse(self) -> mp.matrix | None:
        return multiplier_inverse(self.tableau)

    @cached_property
    def scaled(self) -> dict[str, list[Row]]:
        """μ, μ̂, ν and ν̃ before rounding, all nodes 0..p in their own order."""
        part, s, p = self.centres, self.tableau.s, self.tableau.p
        b, b_hat, b_tilde = part["b"], part["b_hat"], part["b_tilde"]
        return {
            "mu": [[part["A"][i][j] / b[j] for j in range(s)] for i in range(s)],
            "mu_hat": [[part["A_hat"][i][j] / b_hat[j] for j in range(s)] for i in range(s)],
            "nu": [[part["A_bar"][row][j] / b[j] for j in range(s)] for row in range(p + 1)],
            "nu_tilde": [[part["A_tilde"][i][j] / (b_tilde[j] or 1) for j in range(p + 1)]
                         for i in range(s)],
        }

    @property
    def _acting(self) -> list[int]:
        """Nodes where multipliers act, in lane order."""
        return [*range(1, self.tableau.p), 0]

    @property
    def _asked(self) -> list[int]:
        """Nodes where g is asked for, in lane order."""
        return [*range(1, self.tableau.p), self.tableau.p]

    def _in_lanes(self, name: str, table: list[Row]) -> list[Row]:
        """Return the rows or columns of a table that belong to nodes in lane order."""
        if name == "nu":
            return [table[row] for row in self._asked]
        return [[row[j] for j in self._acting] for row in table] if name == "nu_tilde" else table

    def tables(self, real: Real) -> dict[str, list[Row]]:
        """Return μ, μ̂, ν, ν̃ and the scaled M⁻¹ as numbers of that type, row by row."""
        part, exact, bits = self.centres, self.scaled, real.bits
        slack = max(Fraction(1, 2**bits), self._slack)
        mu, mu_hat = _paired(exact["mu"], exact["mu_hat"], bits, slack)
        onward = _onward(part["c"], part["b"], list(range(self.tableau.s)), bits)
        if not self.tableau.p:
            return {"mu": mu, "mu_hat": mu_hat, "onward": onward}
        nu, nu_tilde = _paired(exact["nu"], exact["nu_tilde"], bits, slack)
        assert self._inverse is not None
        return {
            "mu": mu,
            "mu_hat": mu_hat,
            "nu": self._in_lanes("nu", nu),
            "nu_tilde": self._in_lanes("nu_tilde", nu_tilde),
            "inverse": [
                [round_binary(_fraction(self._inverse[j, row - 1]) * part["b_tilde"][j], bits)
                 for row in self._asked]
                for j in self._acting
            ],
            "onward": onward,
            "onward_nodes": _onward(part["c_tilde"], part["b_tilde"], self._acting, bits),
        }

    def halves(self, real: Real) -> dict[str, list[Row]]:
        """Return μ, μ̂, ν and ν̃ split by symmetry in time; empty where that saves nothing.

        Where T_ij + T_i'j' = 1 (i', j' counted from the other end),

            T_ij = ½ + o_ij + e_ij,  T_i'j = ½ + o_ij − e_ij,  o_ij' = −o_ij,  e_ij' = e_ij.

        A row holds o_ij and e_ij of the first half of the columns, then e_ij of the one in the
        middle; there are rows of the first half, and one in the middle, which has no e. As of ν and
        ν̃ the row, or column, of the end is left out: it is all ones.

        Of μ̂ and ν̃ they are those of μ and ν with the other sign, transposed, o for e: so
        μ̂_ij = 1 − μ_ji and ν̃_ij = 1 − ν_ji hold of rounded numbers exactly.
        """
        s, inner = self.tableau.s, max(self.tableau.p - 1, 0)
        pairs = [("mu", "mu_hat", s), *([("nu", "nu_tilde", inner)] if self.tableau.p else [])]
        found: dict[str, list[Row]] = {}
        for name, dual, rows in pairs:
            table = self._in_lanes(name, self.scaled[name])
            other = self._in_lanes(dual, self.scaled[dual])
            slack = max(self._slack, Fraction(1, 2**400))
            ones = [*table[rows:], [row[rows] for row in other if len(row) > rows]]
            if (not _is_halved_cheaper(s) or not _is_symmetric(table[:rows], slack)
                    or any(abs(e - 1) > slack for row in ones for e in row)
                    or any(abs(table[j][i] + other[i][j] - 1) > slack
                           for i in range(s) for j in range(rows))):
                return {}
            odd, even = _halved(table[:rows], real.bits)
            found[name] = _half_rows(odd, even)
            found[dual] = _half_rows(_opposite(even), _opposite(odd))
        return found

    def rounding_errors(self, real: Real) -> list[Fraction]:
        """Return how far the entries of μ, μ̂, ν and ν̃ are from the exact ones."""
        rounded = self.tables(real)
        return [x - y for name, table in self.scaled.items() if name in rounded
                for given, row in zip(rounded[name], self._in_lanes(name, table), strict=True)
                for x, y in zip(given, row, strict=True)]

    def is_symplectic(self, real: Real) -> bool:
        """Whether the rounded tables fulfil μ̂_ij = 1 − μ_ji and ν̃_ij = 1 − ν_ji exactly."""
        tables = self.tables(real)
        s, p = self.tableau.s, self.tableau.p
        stages = all(tables["mu_hat"][i][j] + tables["mu"][j][i] == 1
                     for i in range(s) for j in range(s))
        nodes = all(tables["nu_tilde"][i][j] + tables["nu"][j][i] == 1
                    for i in range(s) for j in range(p - 1))
        return stages and nodes


def _is_halved_cheaper(s: int) -> bool:
    """Whether sums and differences save more multiplications than they take additions."""
    pairs = s // 2
    return s * s > pairs * s + 7 * pairs + s % 2 * (pairs + 2)


def _is_symmetric(table: list[Row], slack: Fraction) -> bool:
    return all(abs(x + y - 1) <= slack
               for row, mirrored in zip(table, table[::-1], strict=True)
               for x, y in zip(row, mirrored[::-1], strict=True))


def _halved(table: list[Row], bits: int) -> tuple[list[Row], list[Row]]:
    """Return o_ij and e_ij of the first half of rows and columns, and of those in the middle."""
    rows, columns = len(table), len(table[0])
    odd = [[round_binary((row[j] - row[columns - 1 - j]) / 2, bits) for j in range(columns // 2)]
           for row in table[: -(-rows // 2)]]
    even = [[round_binary((row[j] + row[columns - 1 - j] - 1) / 2, bits)
             for j in range(-(-columns // 2))] for row in table[: rows // 2]]
    return odd, even


def _opposite(table: list[Row]) -> list[Row]:
    return [[-row[j] for row in table] for j in range(len(table[0]))]


def _half_rows(odd: list[Row], even: list[Row]) -> list[Row]:
    """Return rows as they are multiplied; that in the middle, which has no e, is filled up."""
    none = [Fraction(0)] * len(even[0])
    return [[*o, *e] for o, e in zip_longest(odd, even, fillvalue=none)]


def _onward(nodes: Row, weights: Row, order: list[int], bits: int) -> list[Row]:
    """Return w_i ℓ_j(1 + c_i)/w_j: values at the nodes, continued by their polynomial for a step.

    Where two nodes coincide there is no such polynomial; the last values themselves are used.
    """
    c, w = [nodes[i] for i in order], [weights[i] for i in order]
    if len(set(c)) < len(c):
        return [[Fraction(int(i == j)) for j in range(len(c))] for i in range(len(c))]
    table = []
    for i, at in enumerate(c):
        row = []
        for j, own in enumerate(c):
            value = w[i] / w[j]
            for other in c[:j] + c[j + 1 :]:
                value *= (1 + at - other) / (own - other)
            row.append(round_binary(value, bits))
        table.append(row)
    return table


def _fraction(value: mp.mpf) -> Fraction:
    sign, mantissa, exponent, _ = value._mpf_
    size = Fraction(int(mantissa)) * Fraction(2) ** int(exponent)
    return -size if sign else size


def _paired(
    x: list[Row], y: list[Row], bits: int, slack: Fraction
) -> tuple[list[Row], list[Row]]:
    """Round two tables so that y_ij = 1 − x_ji is exact wherever it holds to a slack.

    Of such a pair the member of at least ½ is rounded; 1 minus it is a binary number again.
    """
    x_rounded = [[round_binary(e, bits) for e in row] for row in x]
    y_rounded = [[round_binary(e, bits) for e in row] for row in y]
    for i, row in enumerate(y):
        for j, value in enumerate(row):
            if abs(value + x[j][i] - 1) > slack:
                continue  # not a symplectic pair: each stays as it is
            if value >= x[j][i]:
                x_rounded[j][i] = 1 - y_rounded[i][j]
            else:
                y_rounded[i][j] = 1 - x_rounded[j][i]
    return x_rounded, y_rounded
