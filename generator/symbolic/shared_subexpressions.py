"""Expressions as directed acyclic graphs: a common subexpression is visited once.

Derived expressions repeat their subexpressions; as a tree, nested ones grow exponentially. A
subexpression in ``Shared`` is opaque to SymPy, which would search it for signs and factors wherever
it occurs; in C it is a temporary.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from operator import attrgetter
from typing import Any, ClassVar
from weakref import WeakValueDictionary

import sympy as sp

from .construction import rebuilt

__all__ = ["Shared", "expand_shared", "name_of", "parts_of", "share", "share_repeated",
           "structure_of", "substitute", "symbols_of", "text_of", "tree_size"]

#: ``share_repeated`` leaves subexpressions of so many nodes and fewer where they are: a temporary
#: in C would cost more than to write them again.
_SHARED_SIZE = 8

#: The name of a symbol; ``str`` is slow, as it calls a printer.
name_of = attrgetter("name")


@lru_cache(maxsize=2**10)
def text_of(e: sp.Expr | str) -> str:
    """Return an expression as text; cached, as comments and manifest print the same expressions."""
    return str(e)


class Shared(sp.Function):  # type: ignore[misc]
    """The value of its argument, a real number: the identity."""

    nargs = 1
    is_extended_real = True
    #: Argument → its only instance: equal parts are identical, and are compared by identity.
    _instances: ClassVar[WeakValueDictionary[sp.Basic, Shared]] = WeakValueDictionary()

    def __new__(cls, argument: sp.Expr, **options: Any) -> Any:
        """Return the one instance of an argument; a number stays a number."""
        node = cls._instances.get(argument)
        if node is None:
            node = super().__new__(cls, argument, **options)
            if isinstance(node, cls):
                cls._instances[argument] = node
        return node

    @classmethod
    def eval(cls, argument: sp.Expr) -> sp.Expr | None:
        """Return a number unchanged."""
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
        """Return the value of the argument to ``prec`` bits."""
        return self.args[0]._eval_evalf(prec)


def share(e: sp.Expr) -> sp.Expr:
    """Return e as number · Shared(factor); atoms are not wrapped."""
    coefficient, factor = e.as_coeff_Mul()
    return e if factor.is_Atom or isinstance(factor, Shared) else coefficient * Shared(factor)


def share_repeated(expressions: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Return the expressions with ``Shared`` around subexpressions that recur.

    Only subexpressions of more than ``_SHARED_SIZE`` nodes are shared.
    """
    subexpressions = list(parts_of(expressions))
    sizes: dict[sp.Basic, int] = {}
    uses: dict[sp.Basic, int] = {}
    # arguments come first: their sizes and replacements are known when they are needed
    for e in subexpressions:
        sizes[e] = 1 + sum(sizes[a] for a in e.args)
        for a in e.args:
            uses[a] = uses.get(a, 0) + 1
    replacement: dict[sp.Basic, sp.Basic] = {}
    for e in subexpressions:
        node = rebuilt(e, (replacement[a] for a in e.args))
        recurs = uses.get(e, 0) > 1 and sizes[e] > _SHARED_SIZE and isinstance(e, sp.Expr)
        replacement[e] = share(node) if recurs else node
    return [replacement[e] for e in expressions]


def expand_shared(e: sp.Expr) -> sp.Expr:
    """Return e without ``Shared``."""
    replacement: dict[sp.Basic, sp.Basic] = {}
    for node in parts_of([e]):
        arguments = [replacement[a] for a in node.args]
        replacement[node] = (arguments[0] if isinstance(node, Shared) else
                             rebuilt(node, arguments))
    return replacement[e]


def parts_of(expressions: Iterable[sp.Basic]) -> Iterator[sp.Basic]:
    """Yield every different subexpression once, arguments before the expressions of them.

    Depth first with a stack: expressions are deeper than Python's recursion.
    """
    visited: set[sp.Basic] = set()
    stack = [(e, False) for e in expressions]
    while stack:
        e, has_arguments_done = stack.pop()
        if has_arguments_done:
            yield e
        elif e not in visited:
            visited.add(e)
            stack.append((e, True))
            stack += [(argument, False) for argument in e.args]


def tree_size(expressions: Sequence[sp.Basic]) -> int:
    """Return the number of nodes of the expressions as trees, with repeated subexpressions."""
    sizes: dict[sp.Basic, int] = {}
    for e in parts_of(expressions):
        sizes[e] = 1 + sum(sizes[a] for a in e.args)
    return sum(sizes[e] for e in expressions)


def symbols_of(expressions: Iterable[sp.Basic]) -> set[sp.Symbol]:
    """Return the symbols in any of the expressions."""
    return {e for e in parts_of(expressions) if e.is_Symbol}


def structure_of(expressions: Iterable[sp.Basic]) -> tuple[Hashable, list[sp.Symbol]]:
    """Return expressions without the names of their symbols, and the symbols in their order there.

    Equal structures are the same expressions but for the symbols, which replace each other place by
    place. No expression is built, which would cost more than what equal structures save.
    """
    numbers: dict[sp.Basic, int] = {}
    nodes: list[Hashable] = []
    symbols: list[sp.Symbol] = []
    expressions = list(expressions)
    for e in parts_of(expressions):
        numbers[e] = len(numbers)
        if e.is_Symbol:
            symbols.append(e)
            nodes.append(None)
        elif e.args:
            nodes.append((e.func, *(numbers[a] for a in e.args)))
        else:  # a decimal equals the fraction of its value
            nodes.append((e.func, e, getattr(e, "_prec", None)))
    return (*nodes, *(numbers[e] for e in expressions)), symbols


def substitute(expressions: Sequence[sp.Expr], mapping: Mapping[sp.Expr, sp.Expr]) -> list[sp.Expr]:
    """Return the expressions with subexpressions replaced simultaneously."""
    replacement: dict[sp.Basic, sp.Basic] = dict(mapping)
    for e in parts_of(expressions):
        if e not in replacement:
            replacement[e] = rebuilt(e, (replacement[a] for a in e.args))
    return [replacement[e] for e in expressions]
