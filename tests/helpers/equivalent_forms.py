"""Systems, and other ways to write the same: for tests of canonical forms."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import sympy as sp

from gyrospark.generator.normal_forms.terms import placeholder
from gyrospark.generator.systems.system import System

HALF = sp.Rational(1, 2)


def stand_ins(moving: Sequence[sp.Symbol],
              still: Sequence[sp.Symbol] = ()) -> dict[sp.Symbol, sp.Symbol]:
    """Return the placeholders of symbols that move, and of parameters."""
    return {s: placeholder(index, side is moving, frozenset(s.assumptions0.items()))
            for side in (moving, still) for index, s in enumerate(side)}


def links(count: int, *, equal: bool = True) -> System:
    """Return masses in space that hang from each other, by springs and rods in turn.

    Equal ones share their parameters, others have parameters of their own.
    """
    q, p = sp.symbols(f"x0:{3 * count}", real=True), sp.symbols(f"p0:{3 * count}", real=True)
    grav = sp.Symbol("g", real=True)
    constants = [sp.symbols("m k l" if equal else f"m{i} k{i} l{i}", positive=True)
                 for i in range(count)]
    X, P = ([side[3 * i : 3 * i + 3] for i in range(count)] for side in (q, p))
    H: sp.Expr = sp.Integer(0)
    g, above = [], (0, 0, 0)
    for (m, k, length), x, y in zip(constants, X, P, strict=True):
        square = sum((a - b) ** 2 for a, b in zip(x, above, strict=True))
        H += sum(e**2 for e in y) / (2 * m) + m * grav * x[2]
        if len(g) * 2 <= X.index(x):
            g.append(square - length**2)
        else:
            H += k * (sp.sqrt(square) - length) ** 2 / 2
        above = x
    used = H.free_symbols.union(*(e.free_symbols for e in g))
    parameters = dict.fromkeys(s for symbols in constants for s in symbols if s in used)
    return System(q, p, (*parameters, grav), H, g, name="links")


def lattice(count: int, potential: Callable[[sp.Expr], sp.Expr], *more: sp.Symbol,
            site: Callable[[sp.Expr], sp.Expr] = lambda x: sp.Integer(0)) -> System:
    """Return equal masses on a line with a potential of the differences, and one of each place."""
    q, p = sp.symbols(f"x0:{count}", real=True), sp.symbols(f"p0:{count}", real=True)
    m = sp.Symbol("m", positive=True)
    H = sum(y**2 for y in p) / (2 * m) + sum(map(site, q))
    return System(q, p, (m, *more), H + sum(potential(y - x) for x, y in pairwise(q)),
                  name="lattice")


# ---------------------------------------------------------------- other ways to write it


def everywhere(change: Callable[[sp.Expr], sp.Expr]) -> Callable[[System], System]:
    """Return a function that rewrites H, g and F of a system by one change."""
    return lambda system: replace(
        system, H=change(system.H), constraints=tuple(map(change, system.constraints)),
        forces=tuple(map(change, system.forces)))


def out_of_order(e: sp.Expr) -> sp.Expr:
    """Return sums and products in an order of their own, which SymPy is not asked to mend."""
    if e.is_Atom:
        return e
    arguments = [out_of_order(a) for a in e.args]
    if e.is_Add or e.is_Mul:
        random.Random(str(e)).shuffle(arguments)
        return e.func(*arguments, evaluate=False)
    return e.func(*arguments)


def without_powers(e: sp.Expr) -> sp.Expr:
    """Return x·x in place of x²."""
    if e.is_Atom:
        return e
    arguments = [without_powers(a) for a in e.args]
    if e.is_Pow and e.exp == 2:
        return sp.Mul(arguments[0], arguments[0], evaluate=False)
    return e.func(*arguments, evaluate=False) if e.is_Add or e.is_Mul else e.func(*arguments)


def nested(e: sp.Expr) -> sp.Expr:
    """Return sums by halves, each times 2 and over 2."""
    if not e.is_Add or len(e.args) < 2:
        return e
    middle = len(e.args) // 2
    halves = (nested(sp.Add(*e.args[:middle])), nested(sp.Add(*e.args[middle:])))
    return sp.Add(*(sp.Mul(2, sp.Mul(HALF, half, evaluate=False), evaluate=False)
                    for half in halves), evaluate=False)


def by_sum(e: sp.Expr) -> sp.Expr:
    """Return a sum as the result of ``sp.Sum(...).doit()``."""
    i = sp.Symbol("i", integer=True)
    terms = sp.Add.make_args(e)
    indexed = sp.IndexedBase("part")
    total = sp.Sum(indexed[i], (i, 0, len(terms) - 1)).doit()
    return total.xreplace({indexed[index]: term for index, term in enumerate(terms)})


def in_decimals(e: sp.Expr) -> sp.Expr:
    """Return 0.5 in place of 1/2."""
    return e.xreplace({x: sp.Float(x) for x in e.atoms(sp.Rational)
                       if not x.is_Integer and x.q in (2, 4, 8)})


TEN = {
    "as it is": lambda e: e,
    "expanded": sp.expand,
    "with common denominators": sp.together,
    "factored": sp.factor_terms,
    "by Sum": by_sum,
    "out of order": out_of_order,
    "in decimals": in_decimals,
    "x x": without_powers,
    "nested": nested,
    "twice negative": lambda e: -sp.expand(-e),
    "common factors of what is expanded": lambda e: sp.factor_terms(sp.expand(e)),
}


def rewritten(e: sp.Expr, draw: random.Random) -> sp.Expr:
    """Return an expression with random parts multiplied out, factored, over one bar, …"""
    if e.is_Atom:
        return e
    e = e.func(*(rewritten(a, draw) for a in e.args))
    small = e.is_Add and len(e.args) <= 8 and len(e.free_symbols) <= 6
    change: Any = draw.choice([
        sp.expand, sp.expand, sp.factor_terms, nested, out_of_order,
        sp.together if small else sp.expand, sp.factor if small else sp.factor_terms,
        *[lambda e: e] * 6])
    return e if e.is_Pow and change in (nested, out_of_order) else change(e)
