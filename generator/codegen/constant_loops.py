"""Loops over tables of constants: a formula of many constants is generated once."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from ...core.records import dataclass

__all__ = ["ConstantLoop", "split_constants"]

#: Fewer constants with one formula are assigned one by one.
_FEW = 64
_PARAMETER = re.compile(r"par->(\w+)")


@dataclass(frozen=True)
class ConstantLoop:
    """One formula, with the index and the parameter names of each constant that it defines."""

    name: str
    formula: str
    rows: Sequence[tuple[int, tuple[str, ...]]]


def split_constants(constants_c: Mapping[str, str]) -> tuple[dict[int, str], list[ConstantLoop]]:
    """Return index → C of the constants that are assigned one by one, and the loops of the others.

    ``constants_c`` maps the name of each constant to its C, with parameters as ``par->name``.
    Formulas are equal if they differ only in the names of their parameters. N single assignments
    would take the compiler O(N²) time, as it inlines them at the start of each run function.
    """
    # formula without the names of parameters → index and parameters of each constant
    instances_of: dict[str, list[tuple[int, tuple[str, ...]]]] = {}
    for index, text in enumerate(constants_c.values()):
        formula = _PARAMETER.sub("par->", text)
        instances_of.setdefault(formula, []).append((index, tuple(_PARAMETER.findall(text))))
    loops: list[ConstantLoop] = []
    for formula, instances in instances_of.items():
        if len(instances) >= _FEW:
            table = f"constants{len(loops)}"
            head, *tails = formula.split("par->")
            # column 0 of a row of the table is the index of the constant
            loop_formula = head + "".join(f"parameter_at(par, {table}[i][{column}]){tail}"
                                          for column, tail in enumerate(tails, start=1))
            loops.append(ConstantLoop(table, loop_formula, instances))
    looped = {index for loop in loops for index, _ in loop.rows}
    return ({index: text for index, text in enumerate(constants_c.values())
             if index not in looped}, loops)
