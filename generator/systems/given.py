"""What a caller gives of a system: expressions without text, names for messages."""

from __future__ import annotations

from collections.abc import Iterable

import sympy as sp
from sympy.core.sympify import _sympify
from sympy.logic.boolalg import Boolean

from ...errors import InputError
from ...naming import shown
from ..algebra.switches import as_switches

__all__ = ["as_expression", "few"]

#: Names that are shown of a list.
_FEW = 6


def few(names: Iterable[object]) -> str:
    """Return the first of some names, and how many there are if that is not all."""
    found = [str(name) for name in names]
    first = ", ".join(found[:_FEW]) or "none"
    return first if len(found) <= _FEW else f"{first}, … ({len(found)})"


def as_expression(value: object) -> sp.Expr:
    """Return a SymPy expression or a plain number as an expression; text is refused.

    Its Piecewise, Max, Min, Heaviside, Mod and the like become functions of ``switches``.
    """
    try:
        made = _sympify(value)  # strict: never parses text
    except (sp.SympifyError, TypeError, ValueError, AttributeError):
        made = None
    if isinstance(made, Boolean) and not isinstance(made, sp.Expr):
        raise InputError(f"{shown(value)} is a condition, no expression; write 1 where it holds "
                         f"and 0 elsewhere as Piecewise((1, {shown(value)}), (0, True)).")
    if not isinstance(made, sp.Expr) or made.is_Matrix or isinstance(value, bool):
        cure = "call it with symbols" if callable(value) else "build it from symbols and numbers"
        raise InputError(f"{shown(value)} is no SymPy expression; {cure}.")
    if made.has(sp.nan, sp.zoo, sp.oo, -sp.oo, sp.I):
        raise InputError(f"The expression {shown(made)} is not real and finite; write another.")
    return as_switches(made)
