"""Common subexpressions of expressions: SymPy's algorithm and results, in a fraction of its time.

``sympy.cse`` builds and compares expressions; here they are nodes of a graph, one for each
different expression, and are compared by identity. A node may have another form, which the graph
is searched in: −e for a sum or product with more minus signs than plus signs, 1/e for a power with
a negative exponent, and for sums and products that share several arguments, one of a part that
they have in common.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import groupby
from operator import attrgetter
from typing import Any

import sympy as sp

from ..symbolic.construction import apply_function, has_minus, negative

__all__ = ["common_subexpressions"]


class _Node:
    """An expression, or a function of nodes that is not evaluated: ``expression`` is None."""

    __slots__ = ("arguments", "expression", "form", "function", "has_minus", "is_shared",
                 "is_tracked", "is_visited", "size", "symbol")

    def __init__(
        self, function: type[sp.Basic], arguments: list[_Node], expression: Any = None
    ) -> None:
        """Make a node of a function and its arguments; ``expression`` is its SymPy form."""
        self.function, self.arguments = function, arguments
        self.expression: Any = expression
        #: An equal expression that is built and searched in place of it, or None.
        self.form: _Node | None = None
        #: Whether a form has been sought; whether the node has occurred; whether it has recurred.
        self.is_tracked = self.is_visited = self.is_shared = False
        #: Its temporary.
        self.symbol: sp.Symbol | None = None
        self.size: int = 1 + sum(a.size for a in arguments) if expression is not None else 1
        self.has_minus = expression is not None and _has_minus(expression, arguments)


def _has_minus(e: sp.Basic, arguments: Sequence[_Node]) -> bool:
    """Return whether e has more minus signs than −e: ``could_extract_minus_sign``."""
    if not e.is_Add:
        return has_minus(e)
    # terms with a minus sign less terms without; in a tie, SymPy's order decides between e and −e
    surplus = 2 * sum(a.has_minus for a in arguments) - len(arguments)
    return surplus > 0 or (surplus == 0 and bool(e.sort_key() < negative(e).sort_key()))


def common_subexpressions(
    expressions: Sequence[sp.Expr], symbols: Iterator[sp.Symbol], *, sort: bool = True
) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Return temporaries with their definitions, in order, and the expressions in them.

    Parameters
    ----------
    expressions : sequence of Expr
    symbols : iterator of Symbol
        Names of the temporaries; those that occur in the expressions are skipped.
    sort : bool
        Whether temporaries are numbered in the canonical order of arguments.
    """
    graph = _Graph()
    roots = [graph.node(e) for e in expressions]
    # forms are the equal expressions that are searched in place of nodes, see ``_Node.form``;
    # sums and products are collected on the way
    for root in roots:
        graph.set_forms(root)
    # as in ``sympy.cse``: common parts of sums and products first, then what recurs as a whole
    _share_arguments(sp.Add, list(graph.sums))
    _share_arguments(sp.Mul, list(graph.products))
    for root in roots:
        _mark_shared(root)
    names = {e.name for e in graph.nodes if e.is_Symbol}
    temporaries = _Temporaries(graph, (s for s in symbols if s.name not in names), sort)
    reduced = [temporaries.expression(root) for root in roots]
    return temporaries.definitions, reduced


class _Graph:
    """The nodes of expressions, and the sums and products among them."""

    def __init__(self) -> None:
        """Make an empty graph, with its sums and products apart for the sharing of their arguments.
        """
        self.nodes: dict[sp.Basic, _Node] = {}
        #: In the order in which they were met.
        self.sums: dict[_Node, None] = {}
        self.products: dict[_Node, None] = {}

    def node(self, e: sp.Basic) -> _Node:
        """Return the node of an expression."""
        node = self.nodes.get(e)
        if node is None:
            node = self.nodes[e] = _Node(e.func, [self.node(a) for a in e.args], e)
        return node

    def set_forms(self, node: _Node) -> None:
        """Set the forms of a node and of its subexpressions, and collect sums and products.

        A node with a minus sign becomes (−1) · positive, xⁿ with n < 0 becomes (x⁻ⁿ)⁻¹: the
        positive expressions may recur. A product of a number and a sum is not collected, as SymPy
        multiplies the number into the sum.
        """
        if node.is_tracked or not node.arguments:
            return
        node.is_tracked = True
        for argument in node.arguments:
            self.set_forms(argument)
        e = node.expression
        # a node with a minus sign is −1 times its opposite, which is searched in its place
        if node.has_minus and not (opposite := negative(e)).is_Atom:
            positive = self.node(opposite)
            node.form = _Node(sp.Mul, [self.node(sp.S.NegativeOne), positive])
            positive.is_tracked = True
            node, e = positive, opposite
        if e.is_Mul:
            if not (len(e.args) == 2 and e.args[0].is_Number and e.args[1].is_Add):
                self.products[node] = None
        elif e.is_Add:
            self.sums[node] = None
        elif e.is_Pow and has_minus(e.exp):
            node.form = _Node(sp.Pow, [self.node(e.base**-e.exp), self.node(sp.S.NegativeOne)])

    def in_order(self, node: _Node) -> list[_Node]:
        """Return the arguments of a sum or product in canonical order: short ones first.

        A factor such as −2 counts as (−1) · 2, as in ``sympy.cse``.
        """
        if node.expression is None or not (node.expression.is_Mul or node.expression.is_Add):
            return node.arguments
        arguments = node.arguments
        number = arguments[0].expression
        if node.expression.is_Mul and arguments[0].has_minus and number.is_Number and (
                number is not sp.S.NegativeOne):
            arguments = [self.node(sp.S.NegativeOne), self.node(-number), *arguments[1:]]
        ordered = list[_Node]()
        for _, group in groupby(sorted(arguments, key=_SIZE), key=_SIZE):
            same_size = list(group)
            # SymPy's key visits whole trees: only where sizes do not decide
            if len(same_size) > 1:
                same_size.sort(key=lambda a: sp.default_sort_key(a.expression))
            ordered += same_size
        return ordered


class _Temporaries:
    """The temporaries of the nodes that recur, with their definitions in order."""

    def __init__(self, graph: _Graph, new_symbols: Iterator[sp.Symbol], sort: bool) -> None:
        """Take names from ``new_symbols``, in the canonical order of arguments if ``sort``."""
        self._graph, self._new_symbols, self._sort = graph, new_symbols, sort
        self.definitions: list[tuple[sp.Symbol, sp.Expr]] = []

    def expression(self, node: _Node) -> sp.Expr:
        """Return the expression of a node in terms of temporaries; a node that recurs becomes one.

        ``node.form`` is an equal expression that is built in place of the node, if it has one.
        """
        if not node.arguments:
            return node.expression
        if node.symbol is not None:
            return node.symbol
        form = node.form or node
        arguments = self._graph.in_order(form) if self._sort else form.arguments
        new_arguments = [self.expression(a) for a in arguments]
        # an expression without temporaries is kept, in place of building an equal one
        if form.expression is None or any(
                a is not b.expression for a, b in zip(new_arguments, arguments, strict=True)):
            expression = apply_function(form.function, new_arguments)
        else:
            expression = form.expression
        if not node.is_shared:
            return expression
        node.symbol = next(self._new_symbols)
        self.definitions.append((node.symbol, expression))
        return node.symbol


_SIZE = attrgetter("size")


def _mark_shared(node: _Node) -> None:
    """Mark the nodes that recur among a node and its subexpressions."""
    if not node.arguments:  # symbols and numbers need no temporary
        return
    if node.is_visited:
        node.is_shared = True
        return
    node.is_visited = True
    for argument in (node.form or node).arguments:
        _mark_shared(argument)


class _ArgumentSets:
    """The arguments of sums, or of products, as sets of numbers, whose intersections are fast.

    The sums, or products, are numbered, too; they are called functions below.

    Attributes
    ----------
    arguments_of : list of set of int
        For each function, the numbers of its arguments.
    rewritten : set of int
        The functions whose arguments have changed.
    """

    def __init__(self, nodes: Sequence[_Node]) -> None:
        """Number the arguments of ``nodes``, the functions, in the order in which they occur."""
        self._number_of: dict[_Node, int] = {}
        self.arguments_of = [
            {self._number_of.setdefault(a, len(self._number_of)) for a in node.arguments}
            for node in nodes]
        self._arguments = list(self._number_of)
        # for each argument, the functions that contain it, without those that are finished
        self._functions_of: list[set[int]] = [set() for _ in self._arguments]
        for i, numbers in enumerate(self.arguments_of):
            for a in numbers:
                self._functions_of[a].add(i)
        self.rewritten = set[int]()

    def number(self, node: _Node) -> int:
        """Return the number of an argument, a new one if it has none."""
        if node not in self._number_of:
            self._number_of[node] = len(self._arguments)
            self._arguments.append(node)
            self._functions_of.append(set())
        return self._number_of[node]

    def nodes(self, numbers: set[int]) -> list[_Node]:
        """Return the arguments of these numbers, in order."""
        return [self._arguments[a] for a in sorted(numbers)]

    def replace(self, i: int, common: set[int], replacement: int) -> None:
        """Replace the arguments ``common`` of function i by one argument."""
        for a in common:
            self._functions_of[a].discard(i)
        self.arguments_of[i] = (self.arguments_of[i] - common) | {replacement}
        self._functions_of[replacement].add(i)
        self.rewritten.add(i)

    def functions_sharing_arguments(self, i: int) -> list[int]:
        """Return the functions after i with two or more arguments of i, the fewest first."""
        counts = Counter(j for a in self.arguments_of[i] for j in self._functions_of[a] if j > i)
        return [j for count, j in sorted((count, j) for j, count in counts.items()) if count > 1]

    def finish(self, i: int) -> None:
        """Remove function i from the comparisons that follow."""
        for a in self.arguments_of[i]:
            self._functions_of[a].discard(i)


def _share_arguments(function: type[sp.Expr], nodes: list[_Node]) -> None:
    """Set the forms of sums, or products, with common arguments: a + b + c = (a + b) + c.

    a + b + c and a + b + d become s + c and s + d with s = a + b. Short sums come first. The common
    part of two is also taken out of all longer ones that have it. This is SymPy's
    ``match_common_args``, whose order is kept.
    """
    nodes.sort(key=lambda node: len(node.arguments))
    sets = _ArgumentSets(nodes)
    for i, node in enumerate(nodes):
        related = sets.functions_sharing_arguments(i)
        for position, j in enumerate(related):
            common = sets.arguments_of[i] & sets.arguments_of[j]
            if len(common) < 2:  # an earlier function has taken arguments away from i
                continue
            # if j contains all arguments of i, i itself becomes an argument of j
            if len(common) == len(sets.arguments_of[i]):
                replacement = sets.number(node)
            else:
                replacement = sets.number(_Node(function, sets.nodes(common)))
                sets.replace(i, common, replacement)
            sets.replace(j, common, replacement)
            for k in related[position + 1:]:
                if common <= sets.arguments_of[k]:
                    sets.replace(k, common, replacement)
        if i in sets.rewritten:
            node.form = _Node(function, sets.nodes(sets.arguments_of[i]))
        sets.finish(i)
