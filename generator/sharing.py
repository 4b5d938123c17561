"""Expressions as graphs: what they share is visited once.

Derived expressions repeat their parts, nested ones exponentially often when written out as trees.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import sympy as sp

__all__ = ["parts_of", "substitute", "symbols_of"]


def parts_of(expressions: Iterable[sp.Basic]) -> Iterator[sp.Basic]:
    """Yield every different subexpression once, arguments before what is made of them."""
    seen: set[sp.Basic] = set()
    stack = [(e, False) for e in expressions]
    while stack:
        e, complete = stack.pop()
        if complete:
            yield e
        elif e not in seen:
            seen.add(e)
            stack.append((e, True))
            stack += [(argument, False) for argument in e.args]


def symbols_of(expressions: Iterable[sp.Basic]) -> set[sp.Symbol]:
    """Return the symbols in any of the expressions."""
    return {e for e in parts_of(expressions) if e.is_Symbol}


def substitute(
    expressions: Sequence[sp.Expr], mapping: Mapping[sp.Expr, sp.Expr]
) -> list[sp.Expr]:
    """Return the expressions with parts replaced, all at once."""
    known: dict[sp.Basic, sp.Basic] = dict(mapping)
    for e in parts_of(expressions):
        if e not in known:
            arguments = [known[a] for a in e.args]
            same = all(a is b for a, b in zip(arguments, e.args, strict=True))
            known[e] = e if same else e.func(*arguments)
    return [known[e] for e in expressions]
