"""Expressions as graphs: what they share is visited once.

Derived expressions repeat their parts, nested ones exponentially often when expanded as trees.
A part in ``Shared`` is opaque to SymPy, which would search it for signs and factors again and
again wherever it occurs; in C it is a temporary.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from operator import attrgetter
from typing import Any, ClassVar
from weakref import WeakValueDictionary

import sympy as sp

__all__ = ["Shared", "expand_shared", "name_of", "parts_of", "share", "share_repeated",
           "substitute", "symbols_of", "text_of", "tree_size"]


#: SymPy prints a symbol by the way of a printer.
name_of = attrgetter("name")


@lru_cache(maxsize=2**10)
def text_of(e: sp.Expr | str) -> str:
    """Return an expression as text; cached, as comments and manifest print the same expressions."""
    return str(e)


class Shared(sp.Function):  # type: ignore[misc]
    """The value of its argument, a real number: the identity."""

    nargs = 1
    is_extended_real = True
    #: Of each argument one part: what is equal is the same, and need not be compared.
    _made: ClassVar[WeakValueDictionary[sp.Basic, Shared]] = WeakValueDictionary()

    def __new__(cls, argument: sp.Expr, **options: Any) -> Any:
        """Return the part of an argument, the one that there is."""
        found = cls._made.get(argument)
        if found is None:
            found = super().__new__(cls, argument, **options)
            if isinstance(found, cls):
                cls._made[argument] = found
        return found

    @classmethod
    def eval(cls, argument: sp.Expr) -> sp.Expr | None:
        """Return a number as it is."""
        return argument if argument.is_Number else None

    @property
    def free_symbols(self) -> set[sp.Symbol]:
        """The symbols in the argument, collected once."""
        if not hasattr(self, "_symbols"):
            self._symbols = self.args[0].free_symbols
        return set(self._symbols)

    def fdiff(self, argindex: int = 1) -> sp.Expr:
        """Return 1."""
        return sp.Integer(1)

    def _eval_evalf(self, prec: int) -> Any:
        return self.args[0]._eval_evalf(prec)


def share(e: sp.Expr) -> sp.Expr:
    """Return e as a shared part, but for its numerical factor."""
    number, rest = e.as_coeff_Mul()
    return e if rest.is_Atom or isinstance(rest, Shared) else number * Shared(rest)


def share_repeated(expressions: Sequence[sp.Expr], size: int = 8) -> list[sp.Expr]:
    """Return the expressions with every part of more than ``size`` nodes shared that recurs."""
    parts = list(parts_of(expressions))
    sizes: dict[sp.Basic, int] = {}
    uses: dict[sp.Basic, int] = {}
    for e in parts:
        sizes[e] = 1 + sum(sizes[a] for a in e.args)
        for a in e.args:
            uses[a] = uses.get(a, 0) + 1
    known: dict[sp.Basic, sp.Basic] = {}
    for e in parts:
        made = e.func(*(known[a] for a in e.args)) if e.args else e
        recurs = uses.get(e, 0) > 1 and sizes[e] > size and isinstance(e, sp.Expr)
        known[e] = share(made) if recurs else made
    return [known[e] for e in expressions]


def expand_shared(e: sp.Expr) -> sp.Expr:
    """Return e without ``Shared``."""
    known: dict[sp.Basic, sp.Basic] = {}
    for part in parts_of([e]):
        arguments = [known[a] for a in part.args]
        same = all(a is b for a, b in zip(arguments, part.args, strict=True))
        if isinstance(part, Shared):
            known[part] = arguments[0]
        else:
            known[part] = part if same else part.func(*arguments)
    return known[e]


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


def tree_size(expressions: Sequence[sp.Basic]) -> int:
    """Return how many nodes the expressions would have if nothing were shared."""
    sizes: dict[sp.Basic, int] = {}
    for e in parts_of(expressions):
        sizes[e] = 1 + sum(sizes[a] for a in e.args)
    return sum(sizes[e] for e in expressions)


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
