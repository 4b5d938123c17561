"""Tableau files: the documented example, every part of the format, and malicious files."""

from __future__ import annotations

import errno
import json
import re
from decimal import ROUND_FLOOR, ROUND_HALF_EVEN, Decimal
from pathlib import Path
from typing import Any

import pytest
import sympy as sp

from gyrospark.core.errors import TableauError
from gyrospark.generator.tableaux import tableau_file
from gyrospark.generator.tableaux.conditions import check_tableau
from gyrospark.generator.tableaux.families import gauss_lobatto, lobatto_iiiab
from gyrospark.generator.tableaux.tableau import FIELDS, Tableau
from gyrospark.generator.tableaux.tableau_file import read_tableau
from processes import ROOT

EXAMPLE = ROOT / "examples" / "tableaux" / "gauss_lobatto_2.json"


def example() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(EXAMPLE.read_text(encoding="utf-8"))
    return content


def content_of(tableau: Tableau, digits: int | None = None) -> dict[str, Any]:
    """Write a tableau out as it would stand in a file; with digits, in decimals."""

    def entry(value: sp.Expr) -> Any:
        return str(value) if digits is None or value.is_Integer else str(sp.N(value, digits))

    content: dict[str, Any] = {"name": tableau.name, "symmetric": True}
    content["order"] = tableau.claims["order"]
    for key in FIELDS:
        rows = getattr(tableau, key)
        content[key] = [
            [entry(value) for value in row] if isinstance(row, tuple) else entry(row)
            for row in rows
        ]
    return content


@pytest.fixture
def read(tmp_path: Path) -> Any:
    def reader(content: Any) -> Tableau:
        path = tmp_path / "tableau.json"
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            text = content if isinstance(content, str) else json.dumps(content)
            path.write_text(text, encoding="utf-8")
        return read_tableau(path)

    return reader


def failed(tableau: Tableau) -> list[str]:
    return [condition.name for condition in check_tableau(tableau) if not condition.holds]


def test_examples_are_gauss_lobatto_2_and_in_the_docstring() -> None:
    tableau = read_tableau(EXAMPLE)
    for key in FIELDS:
        assert getattr(tableau, key) == getattr(gauss_lobatto(2), key)
    assert (tableau.name, tableau.s, tableau.p, tableau.decimal_digits) == ("my_gl2", 2, 2, None)
    assert tableau.claims == {"order": 4, "symmetric": 1}
    assert tableau.order == 4
    assert failed(tableau) == []
    documented = re.search(r"\{.*?\n    \}", str(tableau_file.__doc__), re.DOTALL)
    assert documented is not None
    assert json.loads(documented.group()) == example()


@pytest.mark.parametrize(("family", "s"), [(gauss_lobatto, 1), (lobatto_iiiab, 3)])
def test_families_survive_the_way_through_a_file(read: Any, family: Any, s: int) -> None:
    tableau = read(content_of(family(s)))
    for key in FIELDS:
        assert getattr(tableau, key) == getattr(family(s), key)
    assert failed(tableau) == []
    assert tableau.order == family(s).order


@pytest.mark.parametrize("digits", [12, 40])
def test_decimals_are_checked_to_the_digits_they_have(read: Any, digits: int) -> None:
    tableau = read(content_of(gauss_lobatto(3), digits))
    assert tableau.decimal_digits is not None
    assert digits - 2 < tableau.decimal_digits <= digits
    assert failed(tableau) == []
    assert tableau.order == 6


@pytest.mark.parametrize("weight", ["0.500000001", "0.499999999", "0.5000000001"])
def test_half_a_unit_is_what_digits_allow(read: Any, weight: str) -> None:
    """A rounded weight a unit off its last digit is another number and breaks the conditions."""
    tableau = read(example() | {"b": [weight, "1/2"]})
    assert tableau.decimal_digits == len(weight) - 2
    assert "B" in failed(tableau)
    assert tableau.order < 4


@pytest.mark.parametrize("rounding", [ROUND_HALF_EVEN, ROUND_FLOOR])
def test_every_rounding_of_all_entries_is_allowed(read: Any, rounding: Any) -> None:
    """Entries rounded to nine digits, or cut, which is less exact, fulfil all conditions."""

    def cut(entry: Any) -> Any:
        if isinstance(entry, list):
            return [cut(item) for item in entry]
        return entry if not isinstance(entry, str) or "." not in entry else str(
            Decimal(entry).quantize(Decimal("1e-9"), rounding))

    content = content_of(gauss_lobatto(2), 30)
    assert failed(read(content | {key: cut(content[key]) for key in FIELDS})) == []


def test_decimals_are_exact_and_short_ones_leave_the_tableau_exact(read: Any) -> None:
    content = example()
    content["A"][0][0] = 0.25
    tableau = read(json.dumps(content).replace('"1/4 - sqrt(3)/6"', "-0.038675134594812882254"))
    assert tableau.A[0] == (sp.Rational(1, 4), sp.Rational("-0.038675134594812882254"))
    assert tableau.decimal_digits == 21
    assert failed(tableau) == []
    content = example()
    content["A"][0][0], content["b"] = 0.25, ["0.5", 0.5]
    assert read(content).decimal_digits is None


def test_parts_may_be_left_out_and_A_hat_and_b_hat_are_read(read: Any) -> None:
    content = example()
    for key in ("c", "c_tilde", "order", "symmetric"):
        del content[key]
    tableau = read(content)
    assert tableau.claims == {}
    assert tableau.A_hat == tableau.A
    assert tableau.b_hat == tableau.b
    assert tableau.c == gauss_lobatto(2).c
    assert tableau.c_tilde == gauss_lobatto(2).c_tilde
    assert failed(tableau) == []
    content = example()
    content["A_hat"] = [[1, 2], [3, 4]]
    content["b_hat"] = ["1/3", "2/3"]
    tableau = read(content)
    assert tableau.A_hat == ((1, 2), (3, 4))
    assert tableau.b_hat == (sp.Rational(1, 3), sp.Rational(2, 3))


@pytest.mark.parametrize(("key", "row", "condition"), [
    ("A", 0, "symplectic, forces"), ("A_tilde", 1, "symplectic, constraints"), ("A_bar", 1, "C̄"),
])
def test_a_perturbed_tableau_is_refuted(read: Any, key: str, row: int, condition: str) -> None:
    content = example()
    content[key][row][0] = f"{content[key][row][0]} + 1/10**50"
    assert condition in failed(read(content))


def test_perturbed_decimals_and_wrong_claims_are_refuted(read: Any) -> None:
    content = content_of(gauss_lobatto(3), 20)
    content["A"][1][0] = str(sp.Rational(content["A"][1][0]) + sp.Rational(1, 10**15))
    assert "symplectic, forces" in failed(read(content))
    assert failed(read(example() | {"order": 5})) == ["order"]


def test_confluent_nodes_a_byte_order_mark_32_stages_and_order_100_are_allowed(read: Any) -> None:
    content = example()
    content["c"] = ["1/2", "1/2"]
    assert "C" in failed(read(content))
    assert read(b"\xef\xbb\xbf" + EXAMPLE.read_bytes()).s == 2
    tableau = read(filled())
    assert (tableau.s, tableau.p) == (32, 32)
    assert read(example() | {"order": 100}).claims["order"] == 100


def changed(**changes: Any) -> dict[str, Any]:
    return example() | changes


def without(key: str) -> dict[str, Any]:
    return {name: value for name, value in example().items() if name != key}


def with_entry(entry: Any) -> dict[str, Any]:
    content = example()
    content["A_tilde"][1][2] = entry
    return content


def filled(**changes: Any) -> dict[str, Any]:
    """Return the largest tableau, of zeros but for the changes."""
    s = 32
    zeros = {"A": [[0] * s] * s, "A_tilde": [[0] * (s + 1)] * s, "A_bar": [[0] * s] * (s + 1),
             "b": [0] * s, "b_tilde": [0] * s + [1]}  # fmt: skip
    return {"name": "filled", **zeros, **changes}


HOSTILE_FILES: list[tuple[str, Any, str]] = [
    ("empty", "", "not JSON"),
    ("not json", "{", "not JSON"),
    ("not utf-8", b'{"name": "\xff"}', "not UTF-8"),
    ("utf-16", '{"name": "x"}'.encode("utf-16"), "not UTF-8"),
    ("list", "[]", "a list of 0"),
    ("number", "1", "'1'"),
    ("null", "null", "holds null"), ("true", "true", "holds true"),
    ("empty object", "{}", "'name' is missing"),
    ("deep lists", "[" * 500_000, "nested"),
    ("deep objects", '{"A":' * 200_000, "nested"),
    ("too large", " " * (2**20 + 1), "1048576"),
    ("duplicate", '{"name": "a", "name": "b"}', "'name'.*twice"),
    ("duplicate inside", '{"A": [{"x": 1, "x": 2}]}', "'x'.*twice"),
    ("nan", '{"A": NaN}', "NaN.*coefficient"),
    ("infinity", '{"A": [[-Infinity]]}', "-Infinity.*coefficient"),
    ("unknown key", changed(B=[1]), "'B' is unknown"),
    ("long key", changed(**{"k" * 10_000: 1}), "is unknown"),
    ("surrogate key", '{"\\ud800": 1}', "is unknown"),
    *((f"no {key}", without(key), f"'{key}'") for key in
      ("name", "A", "A_tilde", "A_bar", "b", "b_tilde")),
    *((f"name {name!r}", changed(name=name), "name is ") for name in
      ("", "GL2", "2gl", "_x", "a-b", "a b", "é", "int", "a" * 41, "a\n", "\ud800", 1, 1.5, None,
       [])),
    *((f"order {order!r}", changed(order=order), "order is ") for order in
      (0, -1, 101, 4.0, "4", True, None, 10**30)),
    *((f"symmetric {value!r}", changed(symmetric=value), "symmetric is ")
      for value in (1, "yes", None)),
    ("b no list", changed(b="1/2"), "b is '1/2'.*list"),
    ("no stages", changed(b=[]), "b has 0 entries"),
    ("one constraint node", changed(b_tilde=[1]), "b_tilde has 1 entries"),
    ("33 stages", changed(b=[0] * 33), "b has 33 entries"),
    ("500 stages", changed(b=["$"] * 500, A=[["$"] * 300] * 500), "b has 500 entries"),
    ("34 constraint nodes", changed(b_tilde=[1] * 34), "b_tilde has 34 entries"),
    ("A no list", changed(A=1), "A is '1'.*2 rows"),
    ("A object", changed(A={}), "A is .*object"),
    ("A too short", changed(A=[[0, 0]]), "A .*1 rows.* 2"),
    ("A ragged", changed(A=[[0, 0], [0]]), "A, row 2, .*1 entries.* 2"),
    ("A flat", changed(A=[0, 0]), "A, row 1, .*'0'.* 2 entries"),
    ("A_tilde", changed(A_tilde=[[0, 0], [0, 0]]), "A_tilde, row 1, .*2 entries.* 3"),
    ("A_bar", changed(A_bar=[[0, 0], [0, 0]]), "A_bar .*2 rows.* 3"),
    ("A_hat", changed(A_hat=[[0] * 3] * 3), "A_hat .*3 rows.* 2"),
    ("c", changed(c=[0, 0, 0]), "c .*3 entries.* 2"),
    ("c_tilde", changed(c_tilde=[0, 0]), "c_tilde .*2 entries.* 3"),
    ("b_hat", changed(b_hat=[0]), "b_hat .*1 entries.* 2"),
    *((f"entry {entry!r}", with_entry(entry), "A_tilde, row 2, column 3 ")
      for entry in (True, False, None, [], {}, [1])),
    *((f"entry {entry[:20]!r}", with_entry(entry), "A_tilde, row 2, column 3: ")
      for entry in ("", "x", "1/0", "__import__('os')", "NaN", "2**64**64**64", "(" * 4000,
                    "1" * 5000, "sqrt(-1)", "\ud800")),
    ("huge integer", '{"A": ' + "9" * 500_000 + "}", "is missing"),
    ("long integer", with_entry(10**200), "column 3: .*201 digits"),
    ("decimal exponent", json.dumps(with_entry(7)).replace("7", "1e99999999"), "exponent"),
    ("vector entry", changed(b=["1/2", "1/0"]), "b, entry 2: "),
    ("zero weight", changed(b_tilde=[1, 1, 0]), "last b_tilde"),
    ("zero weight, decimals", changed(b_tilde=[1, 1, 0.0]), "last b_tilde"),
    ("hidden zero weight", changed(b_tilde=[1, 1, "(1 + sqrt(2))**2 - 3 - 2*sqrt(2)"]),
     "last b_tilde"),
    ("too many radicals",
     filled(b_tilde=["+".join(f"sqrt({p})" for p in sp.primerange(100 * n, 100 * n + 99))
                     for n in range(1, 34)]), "100.*radical"),
    ("too much text",
     filled(b_tilde=[f"{n}" + "+1" * 1900 for n in range(1, 34)]), "36000"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("content", "reason"), [case[1:] for case in HOSTILE_FILES],
    ids=[ascii(case[0]) for case in HOSTILE_FILES],
)
def test_refused(read: Any, content: Any, reason: str) -> None:
    with pytest.raises(TableauError, match=reason) as caught:
        read(content)
    message = str(caught.value)
    assert "tableau.json" in message
    assert len(message) < 700
    message.encode()


@pytest.mark.parametrize(("name", "reason"), [
    ("none.json", "such file"), (".", "regular"), ("/dev/zero", "regular")])
def test_paths_of_no_file(tmp_path: Path, name: str, reason: str) -> None:
    with pytest.raises(TableauError, match=reason):
        read_tableau(tmp_path / name)


def test_unreadable_file(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise PermissionError(errno.EACCES, "no entry")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(TableauError, match=r"no entry"):
        read_tableau(EXAMPLE)
