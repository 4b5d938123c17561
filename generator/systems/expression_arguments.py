"""Arguments of a system: expressions without text, names for messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import sympy as sp
from sympy.core.sympify import _sympify
from sympy.logic.boolalg import Boolean

from ...core.arguments import shown
from ...core.errors import InputError
from ...core.html import formula
from ..symbolic.shared_subexpressions import parts_of
from ..symbolic.switching_functions import as_switches

__all__ = ["as_expression", "as_sequence", "refuse_unless_symbols", "shown_formula"]

#: Parts of an expression that is shown as a formula.
_LARGEST_FORMULA = 400
#: Atoms that no real expression contains.
_NO_NUMBERS = {sp.nan, sp.zoo, sp.oo, -sp.oo, sp.I}


def as_sequence(name: str, value: object) -> Sequence[object]:
    """Return the entries of a sequence as a tuple; refuse text, an expression and a mapping.

    ``name`` is the argument's name in the message.
    """
    if isinstance(value, (str, sp.Basic, Mapping)) or not isinstance(value, Iterable):
        raise InputError(f"{name} = {shown(value)} is no sequence; write it as a list.")
    return tuple(value)


def refuse_unless_symbols(system: str, field: str, entries: Iterable[object]) -> None:
    """Refuse entries of coordinates, momenta, parameters, … that are no symbols."""
    for entry in entries:
        if not isinstance(entry, sp.Symbol):
            raise InputError(f"System {system!r} has {shown(entry)} in {field}, which is no "
                             "symbol; make it with sympy.Symbol.")


def as_expression(value: object) -> sp.Expr:
    """Return a SymPy expression or a plain number as an expression.

    Its Piecewise, Max, Min, Heaviside, Mod and the like become functions of
    ``switching_functions``. Raises InputError for text, equations, conditions, matrices and
    numbers that are not real and finite.
    """
    try:
        expression = _sympify(value)  # strict: never parses text
    except (sp.SympifyError, TypeError, ValueError, AttributeError):
        expression = None
    if isinstance(expression, sp.Equality) and all(isinstance(e, sp.Expr) for e in expression.args):
        raise InputError(f"{shown(value)} is an equation, no expression; write its left side minus "
                         f"its right one, {expression.lhs - expression.rhs}.")
    if isinstance(expression, Boolean) and not isinstance(expression, sp.Expr):
        raise InputError(f"{shown(value)} is a condition, no expression; write 1 where it holds "
                         f"and 0 elsewhere as Piecewise((1, {shown(value)}), (0, True)).")
    if not isinstance(expression, sp.Expr) or expression.is_Matrix or isinstance(value, bool):
        cure = "call it with symbols" if callable(value) else "build it from symbols and numbers"
        raise InputError(f"{shown(value)} is no SymPy expression; {cure}.")
    if not _NO_NUMBERS.isdisjoint(parts_of([expression])):
        raise InputError(f"The expression {shown(expression)} is not real and finite; write "
                         "another.")
    return as_switches(expression)


def shown_formula(e: sp.Expr) -> str:
    """Return an expression as a formula for notebooks; a long one as its numbers of terms."""
    size = sum(1 for _ in sp.preorder_traversal(e))
    if size > _LARGEST_FORMULA:
        return f"{len(sp.Add.make_args(e))} terms with {size:,} parts"
    return formula(sp.latex(e))
