"""Constants of a run as loops over tables: equal formulas of many parameters are written once."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

__all__ = ["ConstantLoop", "split_constants"]

#: Formulas that fewer constants have are written one by one.
_FEW = 64
_PARAMETER = re.compile(r"par->(\w+)")


@dataclass(frozen=True)
class ConstantLoop:
    """One formula, and for each constant that has it the place and the names of its parameters."""

    name: str
    formula: str
    rows: Sequence[tuple[int, tuple[str, ...]]]


def split_constants(constants_c: Mapping[str, str]) -> tuple[dict[int, str], list[ConstantLoop]]:
    """Return place → C of the constants to be written one by one, and the loops of the others.

    Formulas are equal if they differ in the names of their parameters alone. As one assignment for
    each of N constants, which the compiler inlines wherever a run begins, they take it O(N²) time.
    """
    rows: dict[str, list[tuple[int, tuple[str, ...]]]] = {}
    for place, text in enumerate(constants_c.values()):
        rows.setdefault(_PARAMETER.sub("par->", text), []).append(
            (place, tuple(_PARAMETER.findall(text))))
    loops: list[ConstantLoop] = []
    for formula, found in rows.items():
        if len(found) >= _FEW:
            name, *parts = f"constants{len(loops)}", *formula.split("par->")
            made = parts[0] + "".join(f"parameter_at(par, {name}[i][{k}]){rest}"
                                      for k, rest in enumerate(parts[1:], start=1))
            loops.append(ConstantLoop(name, made, found))
    looped = {place for loop in loops for place, _ in loop.rows}
    return ({place: text for place, text in enumerate(constants_c.values())
             if place not in looped}, loops)
