"""An expression with conditions as a piecewise function of one variable, and its limits.

    if(x < -a, k*(x + a)**2/2, if(x < a, 0, k*(x - a)**2/2))

has the variable x, the limits −a and a, and three pieces. The variable is a symbol, a linear
combination of symbols, a sum of squares or its root, or a common subexpression. The order of two
limits follows from the sign of their difference, if it is known, or from the nesting of the
conditions: x < a is tested where x < −a does not hold, which is pointless unless −a < a.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import sympy as sp

from ...core.records import dataclass
from ..parsing.tokens import shorten
from .identities import compare
from .shared_subexpressions import parts_of
from .switching_functions import Where, sides

__all__ = ["NotPiecewiseError", "PiecewiseForm", "piecewise_form_of", "selects_side"]


class NotPiecewiseError(Exception):
    """An expression is no continuous piecewise function of one variable, for the given reason."""


@dataclass(frozen=True)
class PiecewiseForm:
    """The pieces of an expression.

    Attributes
    ----------
    variable : Expr
        The variable s that is compared with the limits.
    symbol : Symbol
        The symbol of s in the other attributes.
    whole : Expr
        The expression in s.
    limits : list of Expr
        b_1, …, b_n, ascending, independent of s.
    parts : list of Expr
        n + 1 expressions without conditions, for s < b_1, b_1 < s < b_2, …
    assumed : list of tuple of 2 Expr
        Neighbouring limits (low, high) for which low ≤ high follows from the nesting of the
        conditions alone.
    """

    variable: sp.Expr
    symbol: sp.Symbol
    whole: sp.Expr
    limits: list[sp.Expr]
    parts: list[sp.Expr]
    assumed: list[tuple[sp.Expr, sp.Expr]]


def selects_side(e: sp.Basic, symbols: set[sp.Symbol]) -> bool:
    """Whether e itself is a condition, a sign or a floor with an argument in the symbols."""
    if isinstance(e, Where):
        return not symbols.isdisjoint(e.args[0].free_symbols | e.args[1].free_symbols)
    return isinstance(e, (sp.sign, sp.floor)) and not e.free_symbols.isdisjoint(symbols)


def _has_sides(e: sp.Expr, symbols: set[sp.Symbol]) -> bool:
    """Whether e contains a condition, a sign or a floor with an argument in the symbols."""
    return any(selects_side(node, symbols) for node in parts_of([e]))


def piecewise_form_of(e: sp.Expr, symbols: set[sp.Symbol]) -> PiecewiseForm:
    """Return the pieces of an expression that is proved continuous.

    Parameters
    ----------
    e : Expr
        An expression with conditions or signs.
    symbols : set of Symbol
        The variables; all other symbols are parameters.

    Raises
    ------
    NotPiecewiseError
        If the conditions compare more than one variable with limits, if the order of the limits is
        not known, or if two pieces differ at their limit.
    """
    first = next(_comparisons([e], symbols), None)
    if first is None:
        raise NotPiecewiseError("it has a floor, which jumps")
    variable = _as_comparison(first, symbols).variable
    other_symbols = sorted(map(str, (e.free_symbols - variable.free_symbols) & symbols))
    if other_symbols:
        raise NotPiecewiseError(f"it depends on {', '.join(other_symbols)} besides "
                                f"{_short(variable)}, which its conditions compare")
    symbol, in_symbol = _in_one_symbol(e, variable, symbols)
    limits = _sorted_limits(in_symbol, symbol)
    parts = [_piece_between(in_symbol, symbol, limits, i) for i in range(len(limits) + 1)]
    for limit, (below, above) in zip(limits, pairwise(parts), strict=True):
        _refuse_jump(below.xreplace({symbol: limit}), above.xreplace({symbol: limit}),
                     f"where {_short(variable)} = {_short(limit)}")
    # the sign of the difference does not decide these: their order follows from the nesting alone
    assumed = [pair for pair in pairwise(limits) if not _is_below(*pair, known_order=set())]
    return PiecewiseForm(variable, symbol, in_symbol, limits, parts, assumed)


def _refuse_jump(below: sp.Expr, above: sp.Expr, location: str) -> None:
    """Refuse values of neighbouring pieces at their limit that differ or are infinite.

    ``location`` says in the error where the limit is: "where x = a".
    """
    if any(limit_value.has(sp.nan, sp.zoo, sp.oo, -sp.oo) for limit_value in (below, above)):
        raise NotPiecewiseError(f"it has no value {location}")
    if not compare([below], [above]).holds:
        raise NotPiecewiseError(f"it jumps from {_short(below)} to {_short(above)} {location}")


def _short(e: sp.Expr) -> str:
    """Return the first 40 characters of e for a message."""
    return shorten(str(e), 40)


def _comparisons(expressions: Iterable[sp.Expr], symbols: set[sp.Symbol]) -> Iterator[sp.Expr]:
    """Yield the argument w of every condition w < 0 and sign w that contains no other one."""
    for node in parts_of(expressions):
        switch = sides(node) if selects_side(node, symbols) else None  # None of a floor
        if switch is not None and not _has_sides(switch.w, symbols):
            yield switch.w


class _Comparison(NamedTuple):
    """The sign of w = c (s − b): w > 0 is s > b if w rises with s, and s < b if not."""

    variable: sp.Expr  # s, which has the symbols
    limit: sp.Expr  # b, which has none of them
    rises: bool  # whether c > 0


def _as_comparison(w: sp.Expr, symbols: set[sp.Symbol]) -> _Comparison:
    """Return w = c (s − b) as a comparison of s with b.

    s (``variable``) has the terms of w with the symbols, divided by the coefficient c (``factor``)
    of the first. Raises NotPiecewiseError if the sign of c is not known.
    """
    terms = sp.Add.make_args(sp.expand(w))
    variable_terms = [t for t in terms if not t.free_symbols.isdisjoint(symbols)]
    factor, variable = variable_terms[0].as_independent(*symbols, as_Add=False)
    if len(variable_terms) > 1:
        variable = sp.expand(sp.Add(*variable_terms) / factor)
    if not (factor.is_positive or factor.is_negative):
        raise NotPiecewiseError(f"the sign of {_short(factor)} is not known: declare it positive")
    constant = sp.Add(*(t for t in terms if t not in variable_terms))
    return _Comparison(variable, -constant / factor, bool(factor.is_positive))


def _in_one_symbol(
    e: sp.Expr, variable: sp.Expr, symbols: set[sp.Symbol]
) -> tuple[sp.Symbol, sp.Expr]:
    """Return a symbol s for the variable, and e as an expression of s and parameters."""
    is_root = variable.is_Pow and variable.exp == sp.Rational(1, 2)
    symbol = sp.Symbol("_s", real=True, **({"nonnegative": True} if is_root else {}))
    for replacements in _solutions(variable, symbol, symbols, is_root):
        forms = {_free_of(e.xreplace(replacement), symbols) for replacement in replacements}
        # one form, in s alone, whichever solution is taken
        if len(forms) == 1 and forms.isdisjoint({None}):
            return symbol, forms.pop()
    raise NotPiecewiseError(f"its pieces are no functions of {_short(variable)}, which its "
                            "conditions compare")


def _free_of(e: sp.Expr, symbols: set[sp.Symbol]) -> sp.Expr | None:
    """Return e or its expansion, the first that is independent of the symbols, or None."""
    return next((form for form in (e, sp.expand(e)) if form.free_symbols.isdisjoint(symbols)), None)


def _solutions(
    variable: sp.Expr, symbol: sp.Symbol, symbols: set[sp.Symbol], is_root: bool
) -> Iterator[list[dict[sp.Expr, sp.Expr]]]:
    """Yield lists of substitutions that turn the variable into the symbol s.

    First s itself; then, for each symbol x in which s (or s², of a root) is linear or quadratic,
    the solutions for x. A list has two substitutions, x = ±√…, if the variable is even in x: both
    must agree.
    """
    yield [{variable: symbol}]
    square, target = (variable.base, symbol**2) if is_root else (variable, symbol)
    for x in sorted(variable.free_symbols & symbols, key=str):
        for power in (1, 2):
            unknown = sp.Dummy("unknown", real=True)
            rewritten = square.xreplace({x**power: unknown})
            # linear in x, or in x²: the rest over the slope is the solution
            slope = sp.diff(rewritten, unknown)
            is_linear = slope.free_symbols.isdisjoint({*symbols, unknown})
            if x not in rewritten.free_symbols and is_linear:
                solution = (target - sp.expand(rewritten - slope * unknown)) / slope
                values = [solution] if power == 1 else [sp.sqrt(solution), -sp.sqrt(solution)]
                yield [{x: value} for value in values]


# ---------------------------------------------------------------- order of the limits


def _sorted_limits(e: sp.Expr, symbol: sp.Symbol) -> list[sp.Expr]:
    """Return the limits of all conditions of e on the variable ``symbol``, in ascending order.

    Raises NotPiecewiseError for other conditions, and limits whose order is not known.
    """
    limits: dict[sp.Expr, None] = {}
    for w in _comparisons([e], {symbol}):
        variable, limit, _ = _as_comparison(w, {symbol})
        if variable != symbol:
            raise NotPiecewiseError(f"its conditions compare {_short(w)} with 0, which is not "
                                    "linear in the variable")
        limits.setdefault(sp.expand(limit))
    known_order = _order_by_position(e, symbol)
    unsorted, ordered = list(limits), []
    while unsorted:
        # the limit that is below all others, if the order of these is known
        lowest = [a for a in unsorted
                  if all(a == b or _is_below(a, b, known_order) for b in unsorted)]
        if len(lowest) != 1:
            raise NotPiecewiseError("the order of its limits "
                                    f"{' and '.join(map(_short, unsorted[:2]))} is not known")
        ordered += lowest
        unsorted.remove(lowest[0])
    return ordered


def _is_below(a: sp.Expr, b: sp.Expr, known_order: set[tuple[sp.Expr, sp.Expr]]) -> bool:
    """Whether a ≤ b by the sign of b − a, or else by the nesting: pairs (a, b) in ``known_order``.
    """
    difference = b - a
    if difference.is_positive or difference.is_negative:
        return bool(difference.is_positive)
    return (a, b) in known_order


def _order_by_position(e: sp.Expr, symbol: sp.Symbol) -> set[tuple[sp.Expr, sp.Expr]]:
    """Return pairs of limits (a, b) with a ≤ b by the nesting of the conditions.

    b is tested where the variable is above a, or a condition holds between a and b.
    """
    pairs: set[tuple[sp.Expr, sp.Expr]] = set()
    for node in parts_of([e]):
        if not isinstance(node, Where):
            continue
        a, b, below, above = node.args
        # a product of steps that is compared with 0 is an interval: rising steps are its lower ends
        steps = [f for f in sp.Mul.make_args(b) if isinstance(f, Where)] if a == 0 else []
        if steps:
            step_limits = [step_limit for f in steps for step_limit in _step_limit(f, symbol)]
            pairs |= {(low, high) for low, rises in step_limits if rises
                      for high, also_rises in step_limits if not also_rises}
            continue
        # limits in the branch below a limit are below it, limits in the other branch above
        step = Where(a, b, 0, 1)
        for limit, rises in _step_limit(step, symbol):
            if not rises:
                below, above = above, below
            pairs |= {(inner_limit, limit) for inner_limit in _limits_in(below, symbol)}
            pairs |= {(limit, inner_limit) for inner_limit in _limits_in(above, symbol)}
    return pairs


def _limits_in(e: sp.Expr, symbol: sp.Symbol) -> Iterator[sp.Expr]:
    """Yield the limits of the conditions in e on the variable."""
    for w in _comparisons([e], {symbol}):
        yield sp.expand(_as_comparison(w, {symbol}).limit)


def _step_limit(step: sp.Expr, symbol: sp.Symbol) -> Iterator[tuple[sp.Expr, bool]]:
    """Yield the limit of a step function, and whether it rises from 0 to 1 with the variable.

    Nothing is yielded for a step that does not depend on the variable, or depends on another step.
    """
    switch = sides(step) if selects_side(step, {symbol}) else None
    if switch is None or _has_sides(switch.w, {symbol}):
        return
    _, limit, rises = _as_comparison(switch.w, {symbol})
    # a step that is 0 for w < 0 rises where w rises
    yield sp.expand(limit), rises == (switch.below == 0)


# ---------------------------------------------------------------- pieces between the limits


def _piece_between(e: sp.Expr, symbol: sp.Symbol, limits: Sequence[sp.Expr], i: int) -> sp.Expr:
    """Return the expression for values of ``symbol`` between limits i − 1 and i, both excluded.

    ``limits`` ascend; the first and the last piece are unbounded. A side is selected by the sign
    of a w that is linear in ``symbol``: ``sides`` returns (w, value for w < 0, value for w > 0).
    """
    replacement: dict[sp.Basic, sp.Basic] = {}
    for node in parts_of([e]):
        arguments = [replacement[a] for a in node.args]
        rebuilt = node.func(*arguments) if arguments else node
        switch = sides(rebuilt) if selects_side(rebuilt, {symbol}) else None
        if switch is not None:
            _, limit, rises = _as_comparison(switch.w, {symbol})
            is_above = limits.index(sp.expand(limit)) < i
            # w > 0 above the limit if w rises there, else below it
            is_positive = rises == is_above
            rebuilt = switch.above if is_positive else switch.below
        replacement[node] = rebuilt
    piece: sp.Expr = replacement[e]
    if _has_sides(piece, {symbol}):
        raise NotPiecewiseError("it has a condition or a floor whose side is open within a piece")
    return piece
