"""An expression with conditions as a piecewise function of one variable, and its limits.

    if(x < -a, k*(x + a)**2/2, if(x < a, 0, k*(x - a)**2/2))

has the variable x, the limits −a and a, and three pieces. The variable is a symbol, a linear
combination of symbols, a sum of squares or its root, or a common subexpression.
Which of two limits is the lower one is said by their difference, if its sign is known, or by the
places where the conditions stand: the one with −a is asked beyond that with a, so a > −a, or it
would never matter.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import sympy as sp

from ..parsing.tokens import shorten
from .identities import compare
from .shared_subexpressions import parts_of
from .switching_functions import Where, sides

__all__ = ["NotPiecewiseError", "PiecewiseForm", "piecewise_form_of", "selects_side"]


class NotPiecewiseError(Exception):
    """An expression is no continuous piecewise function of one variable; the reason."""


@dataclass(frozen=True)
class PiecewiseForm:
    """The pieces of an expression.

    Attributes
    ----------
    variable : Expr
        s, what the limits are compared with.
    symbol : Symbol
        Its symbol in the other attributes.
    whole : Expr
        The expression itself.
    limits : list of Expr
        b_1, …, b_n, ascending, without the variable.
    parts : list of Expr
        n + 1 expressions without conditions: what holds below b_1, between b_1 and b_2, …
    assumed : list of tuple of 2 Expr
        Neighbouring limits (low, high) of which the places of the conditions alone say that
        low ≤ high.
    """

    variable: sp.Expr
    symbol: sp.Symbol
    whole: sp.Expr
    limits: list[sp.Expr]
    parts: list[sp.Expr]
    assumed: list[tuple[sp.Expr, sp.Expr]]


def selects_side(e: sp.Basic, symbols: set[sp.Symbol]) -> bool:
    """Whether e itself is a condition, a sign or a floor that the assumptions on symbols decide."""
    if isinstance(e, Where):
        return not symbols.isdisjoint(e.args[0].free_symbols | e.args[1].free_symbols)
    return isinstance(e, (sp.sign, sp.floor)) and not e.free_symbols.isdisjoint(symbols)


def _has_sides(e: sp.Expr, symbols: set[sp.Symbol]) -> bool:
    return any(selects_side(part, symbols) for part in parts_of([e]))


def piecewise_form_of(e: sp.Expr, symbols: set[sp.Symbol]) -> PiecewiseForm:
    """Return the pieces of an expression that is proved continuous.

    Parameters
    ----------
    e : Expr
        With conditions or signs in it.
    symbols : set of Symbol
        What can change; all other symbols are parameters.

    Raises
    ------
    ScatteredError
        If its conditions compare more than one variable with limits, or pieces do not meet.
    """
    first = next(_comparisons([e], symbols), None)
    if first is None:
        raise NotPiecewiseError("it has a floor, which jumps")
    variable, _, _ = _split(first, symbols)
    others = sorted(map(str, (e.free_symbols - variable.free_symbols) & symbols))
    if others:
        raise NotPiecewiseError(f"it depends on {', '.join(others)} besides {_short(variable)}, "
                                "which its conditions compare")
    symbol, whole = _in_one_symbol(e, variable, symbols)
    limits = _sorted_limits(whole, symbol)
    parts = [_between(whole, symbol, limits, i) for i in range(len(limits) + 1)]
    for limit, (below, above) in zip(limits, pairwise(parts), strict=True):
        at = [part.xreplace({symbol: limit}) for part in (below, above)]
        if any(value.has(sp.nan, sp.zoo, sp.oo, -sp.oo) for value in at):
            raise NotPiecewiseError(f"it has no value where {_short(variable)} = {_short(limit)}")
        if not compare(at[:1], at[1:]).holds:
            raise NotPiecewiseError(f"it jumps from {_short(at[0])} to {_short(at[1])} where "
                                    f"{_short(variable)} = {_short(limit)}")
    assumed = [pair for pair in pairwise(limits) if not _is_below(*pair, set())]
    return PiecewiseForm(variable, symbol, whole, limits, parts, assumed)


def _short(e: sp.Expr) -> str:
    return shorten(str(e), 40)


def _comparisons(expressions: Iterable[sp.Expr], symbols: set[sp.Symbol]) -> Iterator[sp.Expr]:
    """Yield the w of every condition and sign that has no other one inside."""
    for part in parts_of(expressions):
        told = sides(part) if selects_side(part, symbols) else None  # None of a floor
        if told is not None and not _has_sides(told[0], symbols):
            yield told[0]


def _split(w: sp.Expr, symbols: set[sp.Symbol]) -> tuple[sp.Expr, sp.Expr, bool]:
    """Return s, b and whether w rises with s, for w = c (s − b) with a c of known sign."""
    terms = sp.Add.make_args(sp.expand(w))
    moving = [t for t in terms if not t.free_symbols.isdisjoint(symbols)]
    factor, variable = moving[0].as_independent(*symbols, as_Add=False)
    if len(moving) > 1:
        variable = sp.expand(sp.Add(*moving) / factor)
    if not (factor.is_positive or factor.is_negative):
        raise NotPiecewiseError(f"the sign of {_short(factor)} is not known: declare it positive")
    rest = sp.Add(*(t for t in terms if t not in moving))
    return variable, -rest / factor, bool(factor.is_positive)


def _in_one_symbol(
    e: sp.Expr, variable: sp.Expr, symbols: set[sp.Symbol]
) -> tuple[sp.Symbol, sp.Expr]:
    """Return a symbol for the variable, and e with it in place of all that can change."""
    root = variable.is_Pow and variable.exp == sp.Rational(1, 2)
    symbol = sp.Symbol("_s", real=True, **({"nonnegative": True} if root else {}))
    for replacements in _solutions(variable, symbol, symbols, root):
        found = {_without(e.xreplace(replacement), symbols) for replacement in replacements}
        if len(found) == 1 and found.isdisjoint({None}):
            return symbol, found.pop()
    raise NotPiecewiseError(f"its pieces are no functions of {_short(variable)}, which its "
                            "conditions compare")


def _without(e: sp.Expr, symbols: set[sp.Symbol]) -> sp.Expr | None:
    """Return e if it does not depend on the symbols, or its expansion; None if both do."""
    return next((form for form in (e, sp.expand(e)) if form.free_symbols.isdisjoint(symbols)), None)


def _solutions(
    variable: sp.Expr, symbol: sp.Symbol, symbols: set[sp.Symbol], root: bool
) -> Iterator[list[dict[sp.Expr, sp.Expr]]]:
    """Yield all that must replace something at once so that the variable becomes the symbol."""
    yield [{variable: symbol}]
    square, value = (variable.base, symbol**2) if root else (variable, symbol)
    for x in sorted(variable.free_symbols & symbols, key=str):
        for power in (1, 2):
            unknown = sp.Dummy("unknown", real=True)
            body = square.xreplace({x**power: unknown})
            slope = sp.diff(body, unknown)
            if x not in body.free_symbols and slope.free_symbols.isdisjoint({*symbols, unknown}):
                found = (value - sp.expand(body - slope * unknown)) / slope
                yield [{x: found}] if power == 1 else [{x: sp.sqrt(found)}, {x: -sp.sqrt(found)}]


# ---------------------------------------------------------------- limits in order


def _sorted_limits(whole: sp.Expr, symbol: sp.Symbol) -> list[sp.Expr]:
    limits: dict[sp.Expr, None] = {}
    for w in _comparisons([whole], {symbol}):
        variable, limit, _ = _split(w, {symbol})
        if variable != symbol:
            raise NotPiecewiseError(f"its conditions compare {_short(w)} with 0, which is not "
                                    "linear in the variable")
        limits.setdefault(sp.expand(limit))
    before = _ordered_by_position(whole, symbol)
    left, order = list(limits), []
    while left:
        lowest = [a for a in left
                  if all(a == b or _is_below(a, b, before) for b in left)]
        if len(lowest) != 1:
            raise NotPiecewiseError("the order of its limits "
                                    f"{' and '.join(map(_short, left[:2]))} is not known")
        order += lowest
        left.remove(lowest[0])
    return order


def _is_below(a: sp.Expr, b: sp.Expr, before: set[tuple[sp.Expr, sp.Expr]]) -> bool:
    difference = b - a
    if difference.is_positive or difference.is_negative:
        return bool(difference.is_positive)
    return (a, b) in before


def _ordered_by_position(whole: sp.Expr, symbol: sp.Symbol) -> set[tuple[sp.Expr, sp.Expr]]:
    """Return pairs (a, b), a below b: b is asked for above a, or the variable lies between."""
    found: set[tuple[sp.Expr, sp.Expr]] = set()
    for part in parts_of([whole]):
        if not isinstance(part, Where):
            continue
        a, b, below, above = part.args
        between = [f for f in sp.Mul.make_args(b) if isinstance(f, Where)] if a == 0 else []
        if between:
            lower = [limit for f in between for limit, up in _limit(f, symbol) if up]
            upper = [limit for f in between for limit, up in _limit(f, symbol) if not up]
            found |= {(low, high) for low in lower for high in upper}
            continue
        for limit, up in _limit(Where(a, b, 0, 1), symbol):
            if not up:
                below, above = above, below
            found |= {(other, limit) for other in _limits_in(below, symbol)}
            found |= {(limit, other) for other in _limits_in(above, symbol)}
    return found


def _limits_in(e: sp.Expr, symbol: sp.Symbol) -> Iterator[sp.Expr]:
    for w in _comparisons([e], {symbol}):
        yield sp.expand(_split(w, {symbol})[1])


def _limit(step: sp.Expr, symbol: sp.Symbol) -> Iterator[tuple[sp.Expr, bool]]:
    """Yield the limit of a step from 0 to 1 or back, and whether it goes up with the variable."""
    told = sides(step) if selects_side(step, {symbol}) else None
    if told is None or _has_sides(told[0], {symbol}):
        return
    _, limit, rises = _split(told[0], {symbol})
    yield sp.expand(limit), rises == (told[1] == 0)


# ---------------------------------------------------------------- what holds in between


def _between(whole: sp.Expr, symbol: sp.Symbol, limits: Sequence[sp.Expr], i: int) -> sp.Expr:
    """Return the expression between limits i − 1 and i, both excluded."""
    known: dict[sp.Basic, sp.Basic] = {}
    for part in parts_of([whole]):
        arguments = [known[a] for a in part.args]
        made = part.func(*arguments) if arguments else part
        told = sides(made) if selects_side(made, {symbol}) else None
        if told is not None:
            _, limit, rises = _split(told[0], {symbol})
            made = told[1 + (rises == (limits.index(sp.expand(limit)) < i))]
        known[part] = made
    found: sp.Expr = known[whole]
    if _has_sides(found, {symbol}):
        raise NotPiecewiseError("it has a condition or a floor that its pieces do not tell")
    return found
