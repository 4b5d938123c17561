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

    Formulas are equal if they differ only in the names of their parameters. N single assignments
    would take the compiler O(N²) time, as it inlines them at the start of each run function.
    """
    instances_of: dict[str, list[tuple[int, tuple[str, ...]]]] = {}
    for index, text in enumerate(constants_c.values()):
        instances_of.setdefault(_PARAMETER.sub("par->", text), []).append(
            (index, tuple(_PARAMETER.findall(text))))
    loops: list[ConstantLoop] = []
    for formula, instances in instances_of.items():
        if len(instances) >= _FEW:
            name, *pieces = f"constants{len(loops)}", *formula.split("par->")
            loop_formula = pieces[0] + "".join(f"parameter_at(par, {name}[i][{k}]){suffix}"
                                               for k, suffix in enumerate(pieces[1:], start=1))
            loops.append(ConstantLoop(name, loop_formula, instances))
    looped = {index for loop in loops for index, _ in loop.rows}
    return ({index: text for index, text in enumerate(constants_c.values())
             if index not in looped}, loops)
