"""A kernel as statements: what it shares is computed once, under a name, in any language.

Neutral data: names, expressions, places of the outputs. ``kernel`` prints C of it,
a test evaluates it in NumPy.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import sympy as sp

from ..symbolic.shared_subexpressions import Shared, name_of, parts_of, symbols_of, tree_size

__all__ = ["Kernel", "Statements", "entries", "statements_of"]

#: Nodes of expressions written out as trees, up to which SymPy orders their arguments.
_LARGEST_TREE = 100_000


@dataclass(frozen=True)
class Kernel:
    """A C function to be: arrays of symbols in, arrays of expressions out.

    Attributes
    ----------
    name, doc : str
        Of the C function; ``doc`` is its comment, an equation.
    inputs : mapping
        Name of each input array → its symbols.
    outputs : mapping
        Name of each output array → nested lists of expressions (vector or matrix); a bare
        expression makes the function return it.
    """

    name: str
    doc: str
    inputs: Mapping[str, Sequence[sp.Symbol]]
    outputs: Mapping[str, Any]
    #: Add up the terms of polynomials in twice the working precision: for sums that nearly cancel.
    compensated: bool = False
    #: Look for factors that several sums or products have in common: that takes as many squared.
    factors: bool = True

    @cached_property
    def statements(self) -> Statements:
        """The kernel in statements: the same for numbers and lanes."""
        return statements_of(self)


@dataclass(frozen=True)
class Statements:
    """What a kernel does, in order.

    Attributes
    ----------
    shared : list of (Symbol, Expr)
        Subexpressions with names of their own, each behind those it is made of.
    outputs : list of (str, Expr)
        Place of each output entry, and its expression in inputs, constants and shared names.
    """

    shared: list[tuple[sp.Symbol, sp.Expr]]
    outputs: list[tuple[str, sp.Expr]]


def statements_of(kernel: Kernel) -> Statements:
    """Return the statements of a kernel."""
    places = entries(kernel)
    if not kernel.factors:
        shared, reduced = _by_parts([e for _, e in places])
        return Statements(shared,
                          [(place, e) for (place, _), e in zip(places, reduced, strict=True)])
    definitions, outputs = _unfolded([e for _, e in places])
    expressions = [*definitions.values(), *outputs]
    # SymPy compares whole trees to bring arguments into order: in deep ones that takes for ever.
    order = "canonical" if tree_size(expressions) <= _LARGEST_TREE else "none"
    fresh = sp.numbered_symbols("_t", real=True)
    shared, reduced = sp.cse(expressions, symbols=fresh, order=order)
    named, reduced = reduced[: len(definitions)], reduced[len(definitions) :]
    if definitions:
        shared = _in_order(shared, dict(zip(definitions, named, strict=True)))
        shared, reduced = _needed(shared, reduced)
    shared, reduced = _name_bases(shared, reduced)
    return Statements(shared, [(place, e) for (place, _), e in zip(places, reduced, strict=True)])


def _by_parts(
    expressions: list[sp.Expr],
) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Name each part that recurs, is ``Shared`` or the base of a power; go through parts once."""
    parts = list(parts_of(expressions))
    uses = Counter(a for e in parts for a in e.args)
    uses.update(expressions)
    uses.update(a for e in parts for a in e.args[:1] if isinstance(e, Shared) or _multiplies(e))
    fresh = sp.numbered_symbols("_t", real=True)
    names: dict[sp.Basic, sp.Symbol] = {}
    known: dict[sp.Basic, sp.Basic] = {}
    for e in parts:
        arguments = [known[a] for a in e.args]
        if isinstance(e, Shared):
            known[e] = arguments[0]
            continue
        same = all(a is b for a, b in zip(arguments, e.args, strict=True))
        made = e if same else e.func(*arguments)
        if uses[e] > 1 and not made.is_Atom and not (-made).is_Symbol:
            if made not in names:
                names[made] = next(fresh)
            made = names[made]
        known[e] = made
    return _needed([(symbol, e) for e, symbol in names.items()], [known[e] for e in expressions])


def _multiplies(e: sp.Basic) -> bool:
    """Whether C writes e as its base several times."""
    return bool(e.is_Pow and (2 * e.exp).is_Integer and abs(e.exp) > 1)


def entries(kernel: Kernel) -> list[tuple[str, sp.Expr]]:
    """Return each output entry with its place, "v[1][2]", or "" of what the function returns."""
    return list(_entries(kernel.outputs))


def _entries(outputs: Mapping[str, Any]) -> Iterator[tuple[str, sp.Expr]]:
    for array, value in outputs.items():
        if not isinstance(value, list):
            yield "", value
            continue
        for i, row in enumerate(value):
            if isinstance(row, list):
                yield from ((f"{array}[{i}][{j}]", entry) for j, entry in enumerate(row))
            else:
                yield f"{array}[{i}]", row


def _unfolded(
    expressions: list[sp.Expr],
) -> tuple[dict[sp.Symbol, sp.Expr], list[sp.Expr]]:
    """Return symbols for the parts in ``Shared`` with their definitions, and the rest in them."""
    fresh = sp.numbered_symbols("_s", real=True)
    known: dict[sp.Basic, sp.Basic] = {}
    symbols: dict[sp.Basic, sp.Symbol] = {}  # by definition: some parts become the same
    for e in parts_of(expressions):
        arguments = [known[a] for a in e.args]
        same = all(a is b for a, b in zip(arguments, e.args, strict=True))
        if not isinstance(e, Shared):
            known[e] = e if same else e.func(*arguments)
        elif arguments[0].is_Atom:
            known[e] = arguments[0]
        else:
            if arguments[0] not in symbols:
                symbols[arguments[0]] = next(fresh)
            known[e] = symbols[arguments[0]]
    return {s: e for e, s in symbols.items()}, [known[e] for e in expressions]


def _in_order(
    shared: list[tuple[sp.Symbol, sp.Expr]], definitions: dict[sp.Symbol, sp.Expr]
) -> list[tuple[sp.Symbol, sp.Expr]]:
    """Return shared subexpressions and definitions, each behind those it is made of."""
    known, done = dict(shared) | definitions, dict[sp.Symbol, sp.Expr]()

    def visit(symbol: sp.Symbol) -> None:
        if symbol not in done and symbol in known:
            for other in sorted(known[symbol].free_symbols, key=name_of):
                visit(other)
            done[symbol] = known[symbol]

    for symbol in known:
        visit(symbol)
    return list(done.items())


def _needed(
    shared: list[tuple[sp.Symbol, sp.Expr]], reduced: list[sp.Expr]
) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Leave out second names of what has one, and what cancelled where it was used."""
    first: dict[sp.Symbol, sp.Expr] = {}
    kept: list[tuple[sp.Symbol, sp.Expr]] = []
    for symbol, given in shared:
        e = given.xreplace(first)
        if e.is_Symbol:
            first[symbol] = e
        else:
            kept.append((symbol, e))
    reduced = [e.xreplace(first) for e in reduced]
    used = symbols_of(reduced)
    for symbol, e in reversed(kept):
        if symbol in used:
            used |= e.free_symbols
    return [(symbol, e) for symbol, e in kept if symbol in used], reduced


def _name_bases(
    shared: list[tuple[sp.Symbol, sp.Expr]], reduced: list[sp.Expr]
) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Give every base of an integer power a name of its own: C writes x² as x*x.

    Where x^¼ or x^¾ occurs, all half powers become powers of √x: pow costs ten square roots.
    """
    fresh = sp.numbered_symbols("_u", real=True)
    named: list[tuple[sp.Symbol, sp.Expr]] = []
    known: dict[sp.Expr, sp.Symbol] = {}
    fourth_roots = {part.base for e in (*(e for _, e in shared), *reduced)
                    for part in parts_of([e]) if part.is_Pow and _has_denominator(part, 4)}

    def symbol_of(e: sp.Expr) -> sp.Symbol:
        if e not in known:
            known[e] = next(fresh)
            named.append((known[e], e))
        return known[e]

    def name(e: sp.Expr) -> sp.Expr:
        if e.is_Atom:
            return e
        by_root = e.is_Pow and e.base in fourth_roots and (
            _has_denominator(e, 2) or _has_denominator(e, 4))
        e = e.func(*(name(a) for a in e.args))
        if by_root:
            return symbol_of(sp.sqrt(e.base)) ** (2 * e.exp)
        return symbol_of(e.base) ** e.exp if _multiplies(e) and not e.base.is_Atom else e

    for symbol, e in shared:
        value = name(e)
        named.append((symbol, value))
    return named, [name(e) for e in reduced]


def _has_denominator(e: sp.Pow, q: int) -> bool:
    return bool(e.exp.is_Rational and e.exp.q == q)
