"""Arguments of a system: expressions without text, names for messages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import sympy as sp
from sympy.concrete.expr_with_limits import ExprWithLimits
from sympy.core.sympify import _sympify
from sympy.logic.boolalg import Boolean
from sympy.polys.rootoftools import RootOf

from ...core.arguments import shown
from ...core.errors import InputError
from ...core.html import formula
from ..symbolic.shared_subexpressions import parts_of
from ..symbolic.switching_functions import as_switches

__all__ = ["as_expression", "as_sequence", "refuse_other_assumptions", "refuse_unless_symbols",
           "shown_formula"]

#: Parts of an expression that is shown as a formula.
_LARGEST_FORMULA = 400
#: Atoms that no real expression contains.
_NO_NUMBERS = {sp.nan, sp.zoo, sp.oo, -sp.oo, sp.I}
#: Assumptions of a positive symbol, which runs check of parameters, not of coordinates.
_CHECKED = frozenset(sp.Symbol("x", positive=True).assumptions0.items())
#: Expressions with a variable that is no symbol of the system: sums, integrals, roots, …
_BINDERS = (ExprWithLimits, sp.Subs, sp.Limit, sp.RootSum, RootOf)


def as_sequence(name: str, value: object) -> Sequence[object]:
    """Return the entries of a sequence as a tuple; refuse text, expressions, mappings and sets.

    ``name`` is the argument's name in the message.
    """
    is_set = isinstance(value, (set, frozenset))  # keys of a dict, another Set, have an order
    if is_set or isinstance(value, (str, sp.Basic, Mapping)) or not isinstance(value, Iterable):
        unordered = ", it has no order" if is_set else ""
        raise InputError(f"{name} = {shown(value)} is no sequence{unordered}; write it as a list.")
    return tuple(value)


def refuse_unless_symbols(system: str, field: str, entries: Iterable[object]) -> None:
    """Refuse entries of coordinates, momenta, parameters, … that are no symbols.

    SymPy simplifies by the assumptions of a symbol: sin(π n) is 0 for an integer n. Those that no
    run checks are refused, too.
    """
    for entry in entries:
        if not isinstance(entry, sp.Symbol):
            raise InputError(f"System {system!r} has {shown(entry)} in {field}, which is no "
                             "symbol; make it with sympy.Symbol.")
        assumptions = {*entry.assumptions0.items()} - _CHECKED
        if field in ("parameters", "inputs") and entry.is_nonnegative and not entry.is_positive:
            assumptions.add(("nonnegative", True))
        if assumptions:
            # the shortest of "negative", "extended_negative", …
            name, holds = min(assumptions, key=lambda item: (not item[1], len(item[0]), item[0]))
            if not entry.is_commutative:
                name, holds = "commutative", False
            raise InputError(f"System {system!r} has the symbol {str(entry)!r} in {field}, which "
                             f"is declared with {name}={holds}, by which SymPy simplifies and "
                             "which no run checks; declare it with real=True, positive=True or "
                             "nonzero=True alone.")


def refuse_other_assumptions(
    label: str, system: str, unknown: Iterable[sp.Symbol], declared: Iterable[sp.Symbol]
) -> None:
    """Refuse unknown symbols that have the name of a declared symbol, but other assumptions.

    ``label`` is the expression that contains them, in the message.
    """
    names = {str(s) for s in unknown} & {str(s) for s in declared}
    if names:
        raise InputError(f"{label} of system {system!r} contains a symbol {min(names)!r} with "
                         f"other assumptions than the declared {min(names)!r}, such as real=True, "
                         "which makes it another symbol; take one and the same for both.")


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
    nodes = [*parts_of([expression])]
    if not _NO_NUMBERS.isdisjoint(nodes) or any(map(_is_complex, nodes)):
        raise InputError(f"The expression {shown(expression)} is not real and finite; write "
                         "another.")
    constant = next((node for node in nodes if isinstance(node, sp.AtomicExpr)
                     and not (node.is_number or node.free_symbols)), None)
    if constant is not None:
        raise InputError(f"{shown(constant)} in {shown(expression)} is neither a symbol nor a "
                         "number; write the formula in numbers and symbols of one system of units, "
                         "such as SI, without sympy.physics.units.")
    unevaluated = next((node for node in nodes if isinstance(node, _BINDERS)), None)
    if unevaluated is not None:
        raise InputError(f"{shown(unevaluated)} has a variable of its own; write its value, which "
                         "doit() or evalf() may give.")
    return as_switches(expression)


def _is_complex(e: sp.Basic) -> bool:
    """Whether an expression without symbols has an imaginary part, such as asin(2) or (−1)^⅓."""
    if not (isinstance(e, sp.Pow | sp.Function) and e.is_number) or e.is_extended_real:
        return False
    return bool(e.is_extended_real is False or sp.im(e.evalf()) != 0)


def shown_formula(e: sp.Expr) -> str:
    """Return an expression as a formula for notebooks; a long one as its numbers of terms."""
    size = sum(1 for _ in sp.preorder_traversal(e))
    if size > _LARGEST_FORMULA:
        return f"{len(sp.Add.make_args(e))} terms with {size:,} parts"
    return formula(sp.latex(e))
