"""Tables common to all model files: parameters, formulas, quantities, run length."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import sympy as sp

from ...core.errors import InputError
from ...core.warnings import warn
from ..parsing.grammar import UNITS
from ..parsing.tokens import names_in, shorten
from ..symbolic.switching_functions import Where
from .formulas import parse_formula
from .toml_tables import Known, TomlTable

__all__ = ["Formulas", "ParameterValues", "divisors", "run_length"]

#: Far more than a system typed by hand has: the C has a struct member for each.
MAX_PARAMETERS = 200
#: Characters of all formulas of a file together.
MAX_CHARACTERS = 20_000


class ParameterValues:
    """The values of [parameters] and [inputs]; each may be a formula of the ones above."""

    def __init__(self, content: TomlTable) -> None:
        """Read [parameters] and [inputs], whose names numbers and formulas of the file may have."""
        table, inputs = content.table("parameters"), content.table("inputs")
        if len(table.content) > MAX_PARAMETERS:
            raise content.error("parameters", f"has {len(table.content)} entries and at most "
                                              f"{MAX_PARAMETERS} are allowed; write fewer.")
        #: Values by name, with the names that other numbers of the file mention.
        self.values = Known()
        # one object for all tables: a value may be a formula of those above it
        table.constants = inputs.constants = content.constants = self.values
        for name in table.items():
            table.symbol(name, name)
            self.values[name] = table.number(name, UNITS)
        for name in inputs.items():
            inputs.symbol(name, name)
            if name in self.values:
                raise inputs.error(name, "is among [parameters] too; give it once.")
            self.values[name] = inputs.number(name, UNITS)


@dataclass
class Formulas:
    """Reader of the formulas of a file.

    ``characters`` counts the characters read so far; ``mentioned`` has the names in formulas.
    """

    content: TomlTable
    numbers: ParameterValues
    characters: int = 0
    mentioned: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.parameters = {name: sp.Symbol(name, real=True) for name in self.numbers.values}

    def read(
        self, table: TomlTable, key: str, text: str, names: Mapping[str, sp.Expr],
        constants: Iterable[sp.Symbol] = (),
    ) -> sp.Expr:
        """Return the formula of a key as an expression.

        It may contain ``names`` and the file's parameters; exponents may contain the parameters
        and the symbols ``constants``. Raises InputError with file, key and cure.
        """
        self.characters += len(text)
        if self.characters > MAX_CHARACTERS:
            raise self.content.file_error(
                f"up to {table.where}{key}, its formulas have {self.characters} characters and at "
                f"most {MAX_CHARACTERS} are allowed; write them shorter.")
        self.refuse_clash(names)
        try:
            formula = parse_formula(text, {**self.parameters, **names},
                                    frozenset([*self.parameters.values(), *constants]))
            self.mentioned |= names_in(text)
            return formula
        except InputError as error:
            raise table.error(key, f"cannot be read as a formula: {error}") from None

    def read_all(
        self, table: TomlTable, key: str, names: Mapping[str, sp.Expr],
        constants: Iterable[sp.Symbol] = (), count: int | None = None,
    ) -> list[sp.Expr]:
        """Return the formulas of a list, ``count`` of them if it is given; see ``read``."""
        return [self.read(table, f"{key}, entry {i},", text, names, constants)
                for i, text in enumerate(table.formulas(key, count), 1)]

    def quantities(
        self, names: Mapping[str, sp.Expr], constants: Iterable[sp.Symbol] = ()
    ) -> dict[str, sp.Expr]:
        """Return name → formula of [quantities]; see ``read``."""
        table = self.content.table("quantities")
        return {table.symbol(name, name): self.read(table, name, table.formula(name), names,
                                                    constants) for name in table.items()}

    def refuse_clash(self, names: Mapping[str, Any]) -> None:
        """Refuse a parameter with one of ``names``, which formulas read as something else."""
        for name in self.parameters:
            if name in names:
                raise self.content.file_error(
                    f"[parameters] {name} has the name of something else in this model "
                    f"({shorten(', '.join(names), 120)}); choose another name.")

    def warn_of_unused(self) -> None:
        """Warn of parameters that nothing in the file uses."""
        mentioned = self.mentioned | self.numbers.values.mentioned
        for name in self.content.table("parameters").items():
            if name not in mentioned:
                warn(f"[parameters] {name} is in no formula and no other number of the file; "
                     "remove it, or write it where it is meant.")

    def in_use(
        self, expressions: Iterable[sp.Expr]
    ) -> tuple[dict[sp.Symbol, sp.Symbol], dict[str, float]]:
        """Return the parameters that a system's expressions contain: their symbols and values.

        The first dict leads from the symbols of the formulas to the symbols of the system. These
        differ for a parameter that a formula divides by: it is declared nonzero, and refused if it
        is 0. A parameter that only other numbers of the file need is left out.
        """
        formulas = list(expressions)
        present = set().union(*(e.free_symbols for e in formulas))
        in_denominators = set().union(*(divisors(e) for e in formulas))
        system_symbols, values = {}, {}
        for name, symbol in self.parameters.items():
            if symbol not in present:
                continue
            values[name] = self.numbers.values[name]
            system_symbols[symbol] = symbol
            if symbol in in_denominators:
                system_symbols[symbol] = sp.Symbol(name, real=True, nonzero=True)
                if values[name] == 0:
                    raise self.content.file_error(f"[parameters] {name} is 0, and a formula "
                                                  "divides by it; write another number.")
        return system_symbols, values


def divisors(expression: sp.Expr) -> set[sp.Symbol]:
    """Return the symbols that an expression divides by, whichever sides of conditions hold."""
    denominators, stack = set(), [expression]
    while stack:
        e = stack.pop()
        # symbols alone: a symbol can be declared nonzero, a sum cannot
        if e.is_Pow and e.base.is_Symbol and e.exp.is_number and e.exp.is_negative:
            denominators.add(e.base)
        # the two sides of an if(...), not its condition
        stack += e.args[:2] if isinstance(e, Where) else e.args
    return denominators


def run_length(content: TomlTable) -> dict[str, Any]:
    """Return dt and steps of [run] and the description, for a ``Model``."""
    run = content.table("run")
    run.allow("dt", "steps")
    if "dt" in run and run.number("dt") == 0:
        raise run.error("dt", "is 0, which makes no step; write a time step in seconds.")
    return {"dt": run.number("dt") if "dt" in run else None,
            "steps": run.count("steps") if "steps" in run else None,
            "description": content.text("description", "")}
