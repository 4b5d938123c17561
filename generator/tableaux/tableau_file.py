"""A user's tableau, from a JSON file or from Python.

    {
      "name": "my_gl2",
      "order": 4,
      "symmetric": true,
      "A": [["1/4", "1/4 - sqrt(3)/6"], ["1/4 + sqrt(3)/6", "1/4"]],
      "A_tilde": [["1/6", "1/3 - sqrt(3)/6", 0], ["1/6", "1/3 + sqrt(3)/6", 0]],
      "A_bar": [[0, 0], ["1/4 + sqrt(3)/8", "1/4 - sqrt(3)/8"], ["1/2", "1/2"]],
      "b": ["1/2", "1/2"],
      "b_tilde": ["1/6", "2/3", "1/6"],
      "c": ["1/2 - sqrt(3)/6", "1/2 + sqrt(3)/6"],
      "c_tilde": [0, "1/2", 1]
    }

An entry is a string in the grammar of ``exact_expressions``, a JSON integer or a JSON decimal;
decimals have the exact value of their text. A decimal of more than 8 digits after the point is
taken to be rounded, and the conditions on the tableau are then checked to its digits.

``A_hat`` (default: A), ``b_hat`` (b), ``c`` (row sums of A) and ``c_tilde`` (row sums of A_bar)
are optional, and so are the claims ``order``, ``symmetric`` and ``symplectic`` (true or false),
which are checked if present. A Butcher tableau has none of ``A_tilde``, ``A_bar`` and ``b_tilde``:
they are derived, and ``A_hat`` as the symplectic partner of A (``completion``). With s = len(b) and
p + 1 = len(b_tilde), A and A_hat are s × s, A_tilde is s × (p + 1) and A_bar is (p + 1) × s;
``name`` becomes part of the names in the generated C code.
"""

from __future__ import annotations

import json
import math
import numbers
import re
from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any, NoReturn

import mpmath as mp
import numpy as np
import sympy as sp

from ...core.arguments import shown
from ...core.errors import InputError, TableauError
from ..parsing.exact_expressions import decimal_digits, parse_expression
from ..parsing.reserved_names import KEYWORDS
from ..parsing.text_file import UnusableFileError, read_text
from .completion import complete_tableau, matrix
from .node_algebra import ValueNodes
from .separation_bounds import Rounding
from .tableau import FIELDS, Tableau

__all__ = ["butcher_tableau", "read_tableau"]

#: A file may come from a stranger: 32² entries of 60 digits have a tenth of the bytes.
MAX_BYTES = 2**20
MAX_STAGES = 32
#: Characters of all different entries that are not plain numbers; 4-stage Gauss-Lobatto, expanded
#: from its nested radicals, has 28 000.
MAX_EXPRESSION_CHARACTERS = 36_000
#: Decimals with at most this many digits after the point are exact.
EXACT_DIGITS = 8
MAX_ORDER = 100

REQUIRED = ("name", "A", "b")
#: Present together, or derived together.
CONSTRAINTS = ("A_tilde", "A_bar", "b_tilde")
#: Default of a missing part: another part, or the row sums of another part.
DEFAULTS = {"A_hat": "A", "b_hat": "b"}
ROW_SUMS = {"c": "A", "c_tilde": "A_bar"}
CLAIMS = ("order", "symmetric", "symplectic")

NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
PLAIN_NUMBER = re.compile(r"\s*[+-]?[0-9.]+([eE][+-]?[0-9]+)?\s*")


class _Number(str):
    """A number of a JSON file, as its text."""

    __slots__ = ()


def read_tableau(path: Path) -> Tableau:
    """Return the tableau of a JSON file.

    Raises ``TableauError``, with file, key, row and column, for a file that cannot be read, is
    larger than 1 MiB or not JSON; keys that are unknown, missing or repeated; tables whose shapes
    do not fit; more than 32 stages or constraint intervals; entries that are no numbers; and a last
    b_tilde of 0, by which the step divides.
    """
    reader = _Reader(f"The tableau file {str(path)!r}")
    return reader.tableau(reader.load(Path(path)))


def butcher_tableau(name: str, parts: Mapping[str, Any]) -> Tableau:
    """Return the tableau of arrays of numbers and texts; values None are omitted.

    Raises TableauError for the same reasons as ``read_tableau``, and if A, b and c cannot be
    completed.
    """
    reader = _Reader("The tableau")
    content = {key: reader.as_json(key, entries)
               for key, entries in parts.items() if entries is not None}
    return reader.tableau({"name": name, **content})


class _Reader:
    """Converts the JSON content of a file, or the arrays of a user, to a tableau."""

    def __init__(self, source: str) -> None:
        """Begin a file with no entry read; ``source`` names it in errors."""
        self.source = source
        self.values: dict[str, sp.Expr] = {}  # text of an entry → value
        self.radicals: set[sp.Expr] = set()
        self.characters = 0
        self.digits: dict[str, int] = {}  # text of a rounded entry → digits after the point
        self.rounded = 0  # number of rounded entries

    def error(self, reason: str) -> TableauError:
        """Return an error that names the source."""
        return TableauError(f"{self.source} is not usable: {reason}")

    def tableau(self, content: dict[str, Any]) -> Tableau:
        """Return the tableau of JSON: lists of texts and ``_Number``."""
        self.check_keys(content)
        claims = self.claims(content)
        name = self.name(content["name"])
        self.check_shapes(content)  # before any entry is parsed
        parts = {key: self.parse_part(key, content[key]) for key in FIELDS if key in content}
        for key, source in ROW_SUMS.items():
            if source in parts:
                parts.setdefault(key, [[sp.Add(*row)] for row in parts[source]])
        rounding = (Rounding(digits=min(self.digits.values()), entries=self.rounded)
                    if self.digits else None)
        if "b_tilde" not in parts:  # a Butcher tableau
            return complete_tableau(name, parts, claims, rounding)
        self.check_last_weight(parts["b_tilde"][-1][0])
        basis = {key: matrix(rows) for key, rows in parts.items()}
        for key, source in DEFAULTS.items():
            basis.setdefault(key, basis[source])  # the same object: Â = A is recognised
        stages, constraints = (ValueNodes([row[0] for row in parts[key]], rounding)
                               for key in ("c", "c_tilde"))
        return Tableau(name, stages, constraints, {key: basis[key] for key in FIELDS}, claims,
                       rounding)

    # ------------------------------------------------------------ the file

    def load(self, path: Path) -> dict[str, Any]:
        """Return the JSON object of the file, numbers as ``_Number``."""
        try:
            # numbers keep their text: a double has fewer digits
            content = json.loads(
                self.text(path),
                object_pairs_hook=self.unique_keys,
                parse_int=_Number,
                parse_float=_Number,
                parse_constant=self.refuse_constant,
            )
        except json.JSONDecodeError as error:
            raise self.error(f"it is not JSON ({error}); compare it with the example.") from None
        except RecursionError:
            raise self.error("its lists are nested too deeply; a matrix is a list of "
                             "rows.") from None
        if not isinstance(content, dict):
            raise self.error(f"it holds {_describe(content)}; write one JSON object with the keys "
                             f"{', '.join(REQUIRED)}.")
        return content

    def text(self, path: Path) -> str:
        """Return the text of a file, or refuse one that is too long or no text."""
        try:
            return read_text(path, MAX_BYTES)
        except UnusableFileError as error:
            raise self.error(str(error)) from None

    def unique_keys(self, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        """Return the pairs of a JSON object as a dict, or refuse a key that occurs twice."""
        content: dict[str, Any] = {}
        for key, value in pairs:
            if key in content:
                raise self.error(f"the key {_quote(key)} is there twice; remove one of them.")
            content[key] = value
        return content

    def refuse_constant(self, constant: str) -> NoReturn:
        """Refuse NaN and Infinity, which Python's reader of JSON accepts."""
        raise self.error(f"{constant} is not a coefficient; write a finite number.")

    def as_json(self, key: str, entries: Any) -> Any:
        """Return an array as nested lists of texts; numbers keep all their digits.

        ``key`` names the table in errors. Raises TableauError for entries that are no finite
        numbers.
        """
        entries = entries.tolist() if hasattr(entries, "tolist") else entries
        if isinstance(entries, (list, tuple)):
            return [self.as_json(key, entry) for entry in entries]
        if isinstance(entries, mp.mpf):
            bits = entries.man.bit_length()
            # beyond a double, as many decimal digits as the binary number has
            if bits > 53:
                return mp.nstr(entries, math.floor(bits * math.log10(2)))
            entries = float(entries)
        is_number = isinstance(entries, (numbers.Rational, float, np.floating, Decimal, sp.Expr,
                                         str))
        if isinstance(entries, bool) or not is_number or str(entries) in ("nan", "inf", "-inf"):
            raise self.error(f"{key} has the entry {shown(entries)}; write a finite number or a "
                             'text such as "1/2".')
        return str(entries)

    # ------------------------------------------------------------ the content

    def check_keys(self, content: dict[str, Any]) -> None:
        """Refuse unknown keys, missing keys, and a part of the constraint coefficients alone."""
        allowed = [*dict.fromkeys((*REQUIRED, *FIELDS, *CLAIMS))]
        for key in content:
            if key not in allowed:
                raise self.error(
                    f"the key {_quote(key)} is unknown; known are {', '.join(allowed)}.")
        missing_keys = [key for key in REQUIRED if key not in content]
        if missing_keys:
            raise self.error(f"the key {missing_keys[0]!r} is missing; add it.")
        constraint_keys = [key for key in (*CONSTRAINTS, "c_tilde") if key in content]
        missing_constraint_keys = [key for key in CONSTRAINTS if key not in content]
        if constraint_keys and missing_constraint_keys:
            raise self.error(f"it has {constraint_keys[0]!r} without "
                             f"{missing_constraint_keys[0]!r}; give "
                             f"{', '.join(CONSTRAINTS)}, or none of them, to have them derived.")

    def claims(self, content: dict[str, Any]) -> dict[str, int]:
        """Return the claimed order and properties; those that are not claimed have no entry."""
        claims = {}
        if "order" in content:
            order = content["order"]
            is_whole = isinstance(order, _Number) and re.fullmatch("[1-9][0-9]{0,2}", order)
            if not is_whole or int(order) > MAX_ORDER:
                raise self.error(f"order is {_describe(order)}; write an integer from 1 to "
                                 f"{MAX_ORDER}.")
            claims["order"] = int(order)
        for key in CLAIMS[1:]:
            if key in content:
                if not isinstance(content[key], bool):
                    raise self.error(f"{key} is {_describe(content[key])}; write true or false.")
                claims[key] = int(content[key])
        return claims

    def name(self, name: Any) -> str:
        """Return the tableau's name; refuse a name that is no identifier in C."""
        # a number of the file is a text as well, of the class _Number
        is_text = isinstance(name, str) and not isinstance(name, _Number)
        if not is_text or not NAME.fullmatch(name) or name in KEYWORDS:
            raise self.error(f"name is {_describe(name)}; write a C identifier of at most 40 lower "
                             "case letters, digits and _, with a letter first, that is no keyword "
                             "of C.")
        return str(name)

    # ------------------------------------------------------------ shapes

    def check_shapes(self, content: dict[str, Any]) -> None:
        """Refuse coefficients whose shapes do not follow from the lengths of ``b`` and ``b_tilde``.

        ``check_keys`` refuses coefficients of constraints without ``b_tilde``.
        """
        length_of = {"s": self.length("b", content["b"], "s", low=1, high=MAX_STAGES)}
        if "b_tilde" in content:
            length_of["p"] = self.length("b_tilde", content["b_tilde"], "p + 1", low=2,
                                         high=MAX_STAGES + 1)
        for key, node_sets in FIELDS.items():
            if key in content:
                self.check_shape(key, content[key], [length_of[nodes] for nodes in node_sets])

    def length(self, key: str, entries: Any, meaning: str, low: int, high: int) -> int:
        """Return the number of entries of a list, which must be from ``low`` to ``high``.

        ``meaning`` names the number in errors, as "p + 1".
        """
        if not isinstance(entries, list):
            raise self.error(f"{key} is {_describe(entries)}; write a list of numbers.")
        if not low <= len(entries) <= high:
            raise self.error(f"{key} has {len(entries)} entries, which is {meaning}; allowed are "
                             f"{low} to {high}.")
        return len(entries)

    def check_shape(self, key: str, entries: Any, shape: list[int], row: str = "") -> None:
        """Refuse a list that has another shape than a vector (n,) or a matrix (m, n).

        ``row`` is the number of the row in errors, as ", row 1,"; empty for a whole table.
        """
        name = f"{key}{row}"
        elements = "rows" if len(shape) == 2 else "entries"
        if not isinstance(entries, list):
            raise self.error(f"{name} is {_describe(entries)}; write a list of {shape[0]} "
                             f"{elements}.")
        if len(entries) != shape[0]:
            raise self.error(f"{name} has {len(entries)} {elements}; write {shape[0]}, which the "
                             "lengths of b and b_tilde ask for.")
        if len(shape) == 2:
            for row_number, row_entries in enumerate(entries, 1):
                self.check_shape(key, row_entries, shape[1:], f", row {row_number},")

    # ------------------------------------------------------------ entries

    def parse_part(self, key: str, entries: list[Any]) -> list[list[sp.Expr]]:
        """Return a matrix as rows of exact numbers; a vector is a column."""
        if len(FIELDS[key]) == 1:
            return [[self.entry(f"{key}, entry {i}", entry)] for i, entry in enumerate(entries, 1)]
        return [
            [self.entry(f"{key}, row {i}, column {j}", entry) for j, entry in enumerate(row, 1)]
            for i, row in enumerate(entries, 1)
        ]

    def entry(self, where: str, entry: Any) -> sp.Expr:
        """Return an entry as an exact number; equal texts are parsed once."""
        if not isinstance(entry, str):
            raise self.error(
                f"{where} is {_describe(entry)}; write a number or a text such as \"1/2\"."
            )
        if entry not in self.values:
            self.values[entry] = self.parse(where, str(entry))
        self.rounded += entry in self.digits
        return self.values[entry]

    def parse(self, where: str, text: str) -> sp.Expr:
        """Return the exact number of a text, and note the digits of a decimal."""
        if not PLAIN_NUMBER.fullmatch(text):
            self.characters += len(text)
        if self.characters > MAX_EXPRESSION_CHARACTERS:
            raise self.error(f"up to {where}, its expressions have {self.characters} characters "
                             f"and at most {MAX_EXPRESSION_CHARACTERS} are allowed; write "
                             "decimals.")
        try:
            coefficient = parse_expression(text, radicals=self.radicals)
            digits = decimal_digits(text, EXACT_DIGITS)
        except InputError as error:
            raise self.error(f"{where}: {error}") from None
        if digits is not None:
            self.digits[text] = digits
        return coefficient

    def check_last_weight(self, weight: sp.Expr) -> None:
        """Refuse a last b̃ that is 0: T2 divides by it."""
        # an irrational expression of 0 has a round-off of about 1e-30
        size = abs(weight) if weight.is_Rational else abs(sp.N(weight, 30))
        if size == 0 or (not weight.is_Rational and size < sp.Float("1e-25")):
            raise self.error("the last b_tilde is 0, and the step divides by it; give the last "
                             "constraint node a weight.")


def _describe(value: Any) -> str:
    """Return a short description of a JSON value, for an error."""
    if isinstance(value, dict):
        return "a JSON object"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if value is None or isinstance(value, bool):
        return json.dumps(value)
    return _quote(value)


def _quote(value: Any) -> str:
    """Return the first 60 characters of a JSON value in quotation marks."""
    text = str(value)
    return repr(text if len(text) <= 60 else text[:60] + "…")
