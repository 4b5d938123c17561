"""Derivatives of sums, products, powers and functions by SymPy's rules, in fewer operations.

The result is SymPy's, term by term. SymPy differentiates every factor of a product zero times for
each term, and evaluates the logarithm of every base to multiply it by zero. A function with a
switch (``switching_functions``) has the derivative of its active branch: a step has the derivative
0, not Dirac's delta.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import sympy as sp
from sympy.core.function import ArgumentIndexError

from ...core.errors import InputError
from .construction import product_of, sum_of
from .shared_subexpressions import Shared, name_of, parts_of, share, substitute
from .switching_functions import Switch, Where, has_sides

__all__ = ["along", "derivative", "slopes"]


@lru_cache(maxsize=2**14)
def derivative(e: sp.Expr, x: sp.Symbol) -> sp.Expr:
    """Return ∂e/∂x, by the rules of sums, products, powers and functions in turn."""
    if e.is_Atom:
        return sp.Integer(int(e == x))
    if e.is_Add:
        return sum_of([derivative(term, x) for term in e.args])
    if e.is_Mul:
        return sum_of(_product_terms(e.args, x))
    if e.is_Pow and e.exp.is_number:
        inner = derivative(e.base, x)
        rate = product_of([e, product_of([inner, e.exp]), 1 / e.base])
        # where a base with a switch stays at 0: (√max(x, 0))' = 0 for x < 0, not 0/0
        if 0 < e.exp < 1 and has_sides(e.base):
            return Where(sp.Integer(0), sp.Abs(inner), rate, sp.Integer(0))  # rate if 0 < |inner|
        return rate
    if e.is_Pow:  # (u^v)' = u^v (v' log u + u' v/u)
        by_base, by_exponent = (derivative(argument, x) for argument in e.args)
        return e * (by_exponent * sp.log(e.base) + by_base * e.exp / e.base)
    if isinstance(e, Shared):
        return share(derivative(e.args[0], x))
    if isinstance(e, (sp.sign, sp.floor)):
        return sp.Integer(0)
    if isinstance(e, Switch):
        return e.pick(*(derivative(e.args[i], x) for i in e.branches))
    if e.is_Function:  # the chain rule; SymPy counts arguments from 1
        inner = [derivative(argument, x) for argument in e.args]
        return sp.Add(*(_partial(e, i) * d for i, d in enumerate(inner, 1) if d != 0))
    return sp.diff(e, x)


def _partial(e: sp.Expr, i: int) -> sp.Expr:
    """Return the derivative of a function by its argument i, or raise InputError if none is known.
    """
    try:
        return e.fdiff(i)
    except ArgumentIndexError as error:
        raise InputError(f"No derivative of {e.func.__name__!r} by its argument {i} is known in "
                         f"{e}; write it with other functions.") from error


def _product_terms(factors: tuple[sp.Expr, ...], x: sp.Symbol) -> list[sp.Expr]:
    """Return the nonzero terms f_1 … f_i' … f_n of the derivative of a product."""
    slopes_of_factors = [derivative(factor, x) for factor in factors]
    return [product_of([*factors[:i], slope, *factors[i + 1:]])
            for i, slope in enumerate(slopes_of_factors) if slope != 0]


def along(
    expressions: Sequence[sp.Expr], symbols: Sequence[sp.Symbol], direction: Sequence[sp.Symbol]
) -> list[sp.Expr]:
    """Return the directional derivatives Σ_k d_k ∂e/∂x_k, in forward mode.

    Each shared subexpression is differentiated once: the result is d/dε e(x + ε d) at ε (``step``)
    = 0.
    """
    step = sp.Symbol("_step", real=True)
    displaced = substitute(expressions, {x: x + step * d
                                         for x, d in zip(symbols, direction, strict=True)})
    return substitute([derivative(e, step) for e in displaced], {step: sp.Integer(0)})


@lru_cache(maxsize=16)
def slopes(e: sp.Expr, symbols: tuple[sp.Symbol, ...]) -> list[sp.Expr]:
    """Return the derivatives by each symbol, in reverse mode: shared nodes are visited once.

    The adjoint of a node is the derivative of e by it; that of a symbol sums adjoint(node) ×
    ∂(node)/∂(symbol). The total length is a small multiple of the length of e, for any number of
    symbols.
    """
    nodes = [node for node in parts_of([e]) if isinstance(node, Shared)]
    # a symbol for each node: its argument and e are short expressions in these
    names = {node: sp.Symbol(f"_r{i}", real=True) for i, node in enumerate(nodes)}
    *arguments, root = substitute([*(node.args[0] for node in nodes), e], names)
    # symbol → terms of its adjoint
    terms: dict[sp.Symbol, list[sp.Expr]] = {}

    def add_products(adjoint: sp.Expr, argument: sp.Expr) -> None:
        """Add adjoint · ∂(argument)/∂x to the terms of each symbol x in the argument of a node."""
        for term in sp.Add.make_args(argument):
            for x in sorted(term.free_symbols, key=name_of):
                terms.setdefault(x, []).append(adjoint * derivative(term, x))

    add_products(sp.Integer(1), root)  # e itself has the adjoint 1
    # a node comes after those that it contains: backwards, its adjoint is complete when it is used
    for node, argument in zip(reversed(nodes), reversed(arguments), strict=True):
        if names[node] in terms:
            add_products(share(sp.Add(*terms[names[node]])), argument)
    node_of = {symbol: node for node, symbol in names.items()}
    return substitute([sp.Add(*terms.get(x, ())) for x in symbols], node_of)
