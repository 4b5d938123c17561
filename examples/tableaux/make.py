"""Derive the tableaux of this folder exactly and write them as JSON: python make.py [FOLDER].

A symplectic SPARK tableau follows from its nodes. Choose c_1..c_s and c̃_0 = 0 < … < c̃_p = 1:

    A, Ā  integrals of the Lagrange polynomials on c, to c_i and to c̃_l: C(s), C̄(s), ā_pj = b_j
    b, b̃  interpolatory weights on c and on c̃
    Â     b_i â_ij + b_j a_ji = b_i b_j          symplecticity of the forces
    Ã     b_i ã_ij + b̃_j ā_ji = b_i b̃_j          the same for constraint forces; ã_ip = 0

`gyrospark verify FILE` proves and measures the order.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import sympy as sp

x = sp.Symbol("x")
Table = dict[str, Any]


def weights(nodes: Sequence[sp.Expr], end: sp.Expr) -> list[sp.Expr]:
    """Return ∫₀^end ℓ_j(x) dx for the Lagrange polynomials of the nodes."""
    found = []
    for j, own in enumerate(nodes):
        others = [c for i, c in enumerate(nodes) if i != j]
        lagrange = sp.prod([(x - c) / (own - c) for c in others], start=sp.Integer(1))
        primitive = sp.integrate(sp.expand(lagrange), x)
        found.append(sp.radsimp(sp.expand(primitive.subs(x, end))))
    return found


def collocation(name: str, c: Sequence[sp.Expr], c_tilde: Sequence[sp.Expr], order: int) -> Table:
    """Return the symplectic SPARK tableau on these nodes."""
    b, b_tilde = weights(c, sp.Integer(1)), weights(c_tilde, sp.Integer(1))
    A, A_bar = [weights(c, end) for end in c], [weights(c, end) for end in c_tilde]
    return {
        "name": name,
        "order": order,
        "A": A,
        "A_hat": partner(A, b, b),
        "A_tilde": partner(A_bar, b, b_tilde),
        "A_bar": A_bar,
        "b": b,
        "b_tilde": b_tilde,
        "c": list(c),
        "c_tilde": list(c_tilde),
    }


def partner(
    a: list[list[sp.Expr]], b: list[sp.Expr], b_columns: list[sp.Expr]
) -> list[list[sp.Expr]]:
    """Return the symplectic partner a'_ij = b'_j (1 − a_ji/b_i) of a."""
    return [
        [sp.radsimp(sp.expand(weight * (1 - row[i] / b[i])))
         for row, weight in zip(a, b_columns, strict=True)]
        for i in range(len(b))
    ]


def radau_nodes(s: int) -> list[sp.Expr]:
    """Return the nodes of Radau IIA, the zeros of d^{s−1}/dx^{s−1} [x^{s−1}(x − 1)^s]."""
    return sorted(sp.roots(sp.diff(x ** (s - 1) * (x - 1) ** s, x, s - 1), x), key=sp.N)


def gauss_nodes(s: int) -> list[sp.Expr]:
    """Return the zeros of d^s/dx^s [x^s(x − 1)^s]."""
    return sorted(sp.roots(sp.diff((x * (x - 1)) ** s, x, s), x), key=sp.N)


def lobatto_nodes(s: int) -> list[sp.Expr]:
    """Return the zeros of d^{s−2}/dx^{s−2} [x^{s−1}(x − 1)^{s−1}]."""
    return sorted(sp.roots(sp.diff((x * (x - 1)) ** (s - 1), x, s - 2), x), key=sp.N)


def lobatto_d(s: int) -> Table:
    """Return Lobatto IIID for the motion, IIIA and IIIB for the constraints (Jay), p = s − 1.

    IIIC has a_i1 = b_1 and C(s − 1); IIID is the mean of IIIC and its symplectic partner.
    """
    table = collocation(f"lobatto_iiid_{s}", lobatto_nodes(s), lobatto_nodes(s), 2 * s - 2)
    b, c = table["b"], table["c"]
    iiic = []
    for end in c:
        unknown = sp.symbols(f"a1:{s}")
        row = [b[0], *unknown]
        conditions = [
            sum((a * node**k for a, node in zip(row, c, strict=True)), sp.Integer(0))
            - end ** (k + 1) / sp.Integer(k + 1)
            for k in range(s - 1)
        ]
        solved = sp.solve(conditions, unknown)
        iiic.append([b[0], *(sp.nsimplify(solved[a]) for a in unknown)])
    other = partner(iiic, b, b)
    A = [[(u + v) / 2 for u, v in zip(*rows, strict=True)]
         for rows in zip(iiic, other, strict=True)]
    return table | {"A": A, "A_hat": A, "symmetric": True}


def plain(name: str, table: Table, order: int) -> Table:
    """Return the tableau with Â = A, which is not symplectic."""
    return table | {"name": name, "order": order, "A_hat": table["A"], "symplectic": False}


def tables() -> list[Table]:
    """Return the tableaux of this folder."""
    radau = collocation("radau_iia_2", radau_nodes(2), lobatto_nodes(3), 3)
    return [
        collocation("my_gl2", gauss_nodes(2), lobatto_nodes(3), 4) | {"symmetric": True},
        collocation("gauss_3_2", gauss_nodes(3), lobatto_nodes(3), 4) | {"symmetric": True},
        radau,
        plain("radau_plain_2", radau, 3),
        lobatto_d(3),
    ]


def entry(value: sp.Expr) -> int | str:
    """Return a coefficient for the file: an integer, or an expression as text."""
    return int(value) if value.is_Integer else str(value)


def text(table: Table) -> str:
    """Return the JSON text of a tableau, one row per line."""
    lines = []
    for key, part in table.items():
        if not isinstance(part, list):
            lines.append(f"  {json.dumps(key)}: {json.dumps(part)}")
        elif isinstance(part[0], list):
            rows = [json.dumps([entry(value) for value in row]) for row in part]
            lines.append(f'  "{key}": [' + (",\n" + " " * (len(key) + 7)).join(rows) + "]")
        else:
            lines.append(f'  "{key}": {json.dumps([entry(value) for value in part])}')
    return "{\n" + ",\n".join(lines) + "\n}\n"


def main(folder: Path) -> None:
    """Write every tableau; ``my_gl2`` is the hand-written example of the README."""
    for table in tables():
        if table["name"] != "my_gl2":
            (folder / f"{table['name']}.json").write_text(text(table), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
