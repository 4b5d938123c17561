"""Tables of a TOML file of unknown origin, read key by key; every refusal names file and key."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

from ...core.arguments import as_integer, proposal
from ...core.errors import InputError
from ...core.exact_numbers import Rounded, decimal, exact
from ..parsing.grammar import UNITS
from ..parsing.tokens import names_in, shorten
from .formulas import CONSTANTS, FUNCTIONS, parse_number

__all__ = ["SYMBOL", "Known", "TomlFileError", "TomlTable", "Units", "load_toml", "number_of_text"]

#: Python's reader of TOML takes time quadratic in the number of parts of a dotted key.
MAX_DOTS = 64
Units: TypeAlias = Mapping[str, str]
UNIT_WORDS = {unit.partition("/")[0] for unit in UNITS}
SYMBOL = re.compile("[A-Za-z][A-Za-z0-9_]{0,39}")


class TomlFileError(InputError):
    """An InputError whose message names the TOML file: callers pass it on as it is."""


def load_toml(text: str, path: Path, kind: str = "model file") -> TomlTable:
    """Return the outermost table of a TOML text; ``kind`` and ``path`` begin its errors."""
    def error(reason: str) -> InputError:
        """Return an error that names the file."""
        return TomlFileError(f"The {kind} {str(path)!r} is not usable: {reason}")

    for number, line in enumerate(text.splitlines(), 1):
        if line.count(".") > MAX_DOTS:
            raise error(f"line {number} has {line.count('.')} dots and at most {MAX_DOTS} are "
                        "allowed; break the line.")
    try:
        content = tomllib.loads(text, parse_float=_exact_double)
    except RecursionError:
        raise error("its brackets are nested too deeply; write lists of numbers.") from None
    # TOMLDecodeError is a ValueError, and so is the error for an integer of 5000 digits
    except ValueError as problem:
        raise error(f"it is not TOML ({shorten(str(problem), 120)}); correct that place.") from None
    return TomlTable(content, where="", error=error)


def number_of_text(text: str) -> Any:
    """Return a number as decimals, as arithmetic such as "pi/2", or with a unit, "30 deg"."""
    number = decimal(text)
    return TomlTable({text: text}, where="", error=InputError).number(
        text, UNITS) if number is None else number


def _exact_double(text: str) -> float:
    """Return a number of TOML as a double that keeps the exact value of its decimals."""
    # TOML allows "_" between digits, as in 1_000.5
    number = decimal(text.replace("_", ""))
    return Rounded(number) if isinstance(number, Fraction) else float(text)


class Known(dict[str, float]):
    """Values of names in arithmetic text; ``mentioned`` has the names that texts contained."""

    def __init__(self, values: Mapping[str, float] = MappingProxyType({})) -> None:
        """Begin with these values, none of which a text has mentioned."""
        super().__init__(values)
        self.mentioned: set[str] = set()


class TomlTable:
    """A table of the file; ``where`` is its heading, such as "[body] "."""

    def __init__(
        self, content: Mapping[str, Any], where: str, error: Callable[[str], InputError],
        constants: Known | None = None,
    ) -> None:
        """Wrap a table of a file.

        ``where`` is its heading in errors, ``error`` makes one that names the file; ``constants``
        are the names that its numbers may contain.
        """
        self.content = content
        self.where = where
        self.file_error = error
        self.constants = Known() if constants is None else constants

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def error(self, key: str, reason: str) -> InputError:
        """Return an error with file, table and key; ``reason`` continues the sentence."""
        return self.file_error(f"{self.where}{shorten(key)} {reason}")

    def allow(self, *keys: str) -> None:
        """Refuse every other key."""
        for key in self.content:
            if key not in keys:
                key_text = repr(shorten(key))
                raise self.file_error(f"the key {self.where}{key_text} is unknown; allowed are "
                                      f"{', '.join(keys)}{proposal(key, keys)}.")

    def require(self, *keys: str) -> None:
        """Refuse a table without one of the keys."""
        for key in keys:
            if key not in self.content:
                raise self.file_error(f"the key {self.where}{key} is missing; add it.")

    def table(self, key: str) -> TomlTable:
        """Return a table; an empty one if the key is not there."""
        value = self.content.get(key, {})
        if not isinstance(value, dict):
            raise self.error(key, f"is {describe(value)}; write a table, [{key}].")
        return TomlTable(value, f"[{key}] ", self.file_error, self.constants)

    def tables(self, key: str) -> list[TomlTable]:
        """Return the tables of an array of tables, [[key]]."""
        value = self.content.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise self.error(key, f"is {describe(value)}; write tables, each under [[{key}]].")
        return [TomlTable(item, f"[[{key}]] {i}, ", self.file_error, self.constants)
                for i, item in enumerate(value, 1)]

    def text(self, key: str, default: str | None = None) -> str:
        """Return a text of printable characters."""
        value = self.content.get(key, default)
        if not isinstance(value, str) or not value.isprintable() or len(value) > 500:
            raise self.error(key, f"is {describe(value)}; write one line of text in quotes.")
        return value

    def choice(self, key: str, allowed: Sequence[str], default: str) -> str:
        """Return the text of a key, one of ``allowed``; ``default`` if the key is not there."""
        value = self.content.get(key, default)
        if not isinstance(value, str) or value not in allowed:
            raise self.error(key, f"is {describe(value)}; choose {' or '.join(allowed)}"
                                  f"{proposal(value, allowed)}.")
        return value

    def formula(self, key: str) -> str:
        """Return the text of a formula; a number is one too."""
        return self._formula(key, self.content.get(key))

    def formulas(self, key: str, count: int | None = None) -> list[str]:
        """Return a list of formulas, none if the key is not there."""
        entries = self._list(key, count, "formulas in quotes")
        return [self._formula(f"{key}, entry {i},", value) for i, value in enumerate(entries, 1)]

    def _formula(self, key: str, value: Any) -> str:
        """Return the text of a formula; a number is written as a decimal with all its digits."""
        if isinstance(value, str):
            return value
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return decimals(self._float(key, value))
        raise self.error(key, f"is {describe(value)}; write a formula in quotes.")

    def names(self, key: str) -> list[str]:
        """Return a list of names of symbols."""
        entries = self._list(key, count=None, content="names in quotes")
        return [self.symbol(f"{key}, entry {i},", value) for i, value in enumerate(entries, 1)]

    def strings(self, key: str) -> list[str]:
        """Return a list of texts, none if the key is not there."""
        entries = self._list(key, count=None, content="texts in quotes")
        for i, value in enumerate(entries, 1):
            if not isinstance(value, str) or not value.isprintable() or len(value) > 100:
                raise self.error(f"{key}, entry {i},", f"is {describe(value)}; write a short text "
                                                       "in quotes.")
        return list(entries)

    def symbol(self, key: str, name: Any) -> str:
        """Return a name that formulas can use."""
        if not isinstance(name, str) or not SYMBOL.fullmatch(name):
            raise self.error(key, f"is {describe(name)}; write a name of at most 40 letters, "
                                  "digits and '_' that begins with a letter.")
        if name in FUNCTIONS or name in CONSTANTS:
            raise self.error(key, f"is {name!r}, which formulas know as something else; choose "
                                  "another name.")
        return name

    def number(self, key: str, units: Units = MappingProxyType({})) -> float:
        """Return a finite number; it may be written as text, such as "40*pi"."""
        return self._number(key, self.content.get(key), units)

    def vector(self, key: str, count: int, units: Units = MappingProxyType({})) -> list[float]:
        """Return ``count`` numbers; in text they may have one of the units of ``grammar``."""
        entries = self._list(key, count, f"{count} numbers")
        return [self._number(f"{key}, entry {i},", value, units)
                for i, value in enumerate(entries, 1)]

    def is_matrix(self, key: str) -> bool:
        """Whether a key has a list of rows."""
        value = self.content.get(key)
        return isinstance(value, list) and any(isinstance(row, list) for row in value)

    def is_plain(self, key: str) -> bool:
        """Whether the numbers of a list have no unit, nor π in place of one."""
        value = self.content.get(key)
        return isinstance(value, list) and not any(
            isinstance(x, str) and names_in(x) & {*UNIT_WORDS, "pi"} for x in value)

    def matrix(self, key: str, count: int) -> list[list[float]]:
        """Return ``count`` rows of ``count`` numbers."""
        self._list(key, count, f"{count} rows")
        return self.rows(key, count)

    def rows(self, key: str, width: int) -> list[list[float]]:
        """Return rows of ``width`` numbers, any number of them."""
        # a table whose keys name the rows in errors
        entries = self._list(key, count=None, content=f"rows of {width}")
        rows = TomlTable(dict(enumerate_rows(key, entries)), self.where, self.file_error,
                         self.constants)
        return [rows.vector(row, width) for row in rows.content]

    def items(self) -> Iterator[str]:
        """Yield the keys."""
        return iter(self.content)

    def count(self, key: str) -> int:
        """Return a whole number from 0 on."""
        value = self.content.get(key)
        count = as_integer(value)
        # the sum of two such counts fits in 64-bit integers
        if count is None or not 0 <= count < 2**62:
            raise self.error(key, f"is {describe(value)}; write a whole number from 0 on.")
        return count

    def _list(self, key: str, count: int | None, content: str) -> list[Any]:
        """Return the list of a key, with ``count`` entries, or any number if ``count`` is None.

        ``content`` names the entries in the error. Without ``count`` a missing key is [].
        """
        value = self.content.get(key, [] if count is None else None)
        if not isinstance(value, list):
            raise self.error(key, f"is {describe(value)}; write a list of {content}.")
        if count is not None and len(value) != count:
            raise self.error(key, f"has {len(value)} entries; write {content}.")
        return value

    def _number(self, key: str, value: Any, units: Units) -> float:
        """Return a number, or a text with a formula and a unit of ``units``, as a double."""
        if isinstance(value, str):
            try:
                number = self._float(key, parse_number(value, self.constants, units))
                self.constants.mentioned |= names_in(value) & self.constants.keys()
                return number
            except InputError as problem:
                raise self.error(key, f"is no number: {problem}") from None
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            raise self.error(key, f"is {describe(value)}; write a number.")
        return self._float(key, value)

    def _float(self, key: str, value: float) -> float:
        """Return a finite number; with more digits than a double it keeps its fraction."""
        number = value if isinstance(value, float) else Rounded(Fraction(value))
        if not math.isfinite(number):
            raise self.error(key, f"is {number}; write a finite number.")
        return number


def enumerate_rows(key: str, rows: Sequence[Any]) -> Iterator[tuple[str, Any]]:
    """Yield each row of a matrix with its name in messages, "KEY, row 1,"."""
    for i, row in enumerate(rows, 1):
        yield f"{key}, row {i},", row


def decimals(number: float) -> str:
    """Return a number as a formula with its exact value: a decimal, or a fraction."""
    fraction = exact(number)
    if fraction == Fraction(repr(number)):
        return repr(number)
    assert isinstance(fraction, Fraction)
    return f"{fraction.numerator}/{fraction.denominator}"


def describe(value: Any) -> str:
    """Describe a value of a file in one short line."""
    if value is None:
        return "missing"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, int) and abs(value) >= 10**18:  # Python may refuse to write it out
        return "a huge integer"
    return shorten(repr(value))
