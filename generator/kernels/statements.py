"""A kernel as statements: temporaries for shared subexpressions, then the outputs.

Statements are independent of a language: ``kernel`` prints C, tests evaluate them in NumPy.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import sympy as sp

from ...core.records import dataclass
from ..symbolic.construction import apply_function, rebuilt
from ..symbolic.shared_subexpressions import Shared, name_of, parts_of, symbols_of, tree_size
from .common_subexpressions import common_subexpressions

__all__ = ["Kernel", "Statements", "entries", "statements_of"]

#: Number of nodes of the expression trees up to which arguments are sorted.
_LARGEST_TREE = 100_000


@dataclass(frozen=True)
class Kernel:
    """A function of arrays: symbols in, expressions out.

    Attributes
    ----------
    name, doc : str
        Name and comment, an equation, of the C function.
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
    #: Whether polynomials are summed in twice the working precision, as their terms nearly cancel.
    compensated: bool = False
    #: Whether common factors of sums and products are extracted, in quadratic time.
    factors: bool = True

    @cached_property
    def statements(self) -> Statements:
        """The statements, the same for numbers, lanes and dual numbers."""
        return statements_of(self)


@dataclass(frozen=True)
class Statements:
    """The assignments of a kernel, in order.

    Attributes
    ----------
    shared : list of (Symbol, Expr)
        Temporaries and their definitions, which use earlier temporaries only.
    outputs : list of (str, Expr)
        C text of each output entry, and its expression in inputs, constants and temporaries.
    """

    shared: list[tuple[sp.Symbol, sp.Expr]]
    outputs: list[tuple[str, sp.Expr]]


def statements_of(kernel: Kernel) -> Statements:
    """Return the statements of a kernel: common subexpressions become temporaries.

    1. ``Shared`` parts become symbols, so that they are computed once in any case.
    2. Common subexpressions of their definitions and of the outputs are found.
    3. Bases of powers get temporaries: x² is x*x in C.
    """
    targets = entries(kernel)
    if not kernel.factors:
        temporaries, reduced = _name_recurring([e for _, e in targets])
        return Statements(temporaries, _replace_outputs(targets, reduced))
    shared, replaced = _replace_shared([e for _, e in targets])
    expressions = [*shared.values(), *replaced]
    # whole trees are compared to sort arguments, which takes too long in deep ones
    temporaries, reduced = common_subexpressions(
        expressions, sp.numbered_symbols("_t", real=True),
        sort=tree_size(expressions) <= _LARGEST_TREE)
    definitions, outputs = reduced[: len(shared)], reduced[len(shared) :]
    if shared:  # a temporary of step 2 may use one of step 1, and the other way round
        temporaries = _sort_definitions(temporaries, dict(zip(shared, definitions, strict=True)))
        temporaries, outputs = _drop_unused(temporaries, outputs)
    temporaries, outputs = _name_bases(temporaries, outputs)
    return Statements(temporaries, _replace_outputs(targets, outputs))


def _replace_outputs(
    targets: list[tuple[str, sp.Expr]], reduced: list[sp.Expr]
) -> list[tuple[str, sp.Expr]]:
    """Return the output entries with reduced expressions in place of their own."""
    return [(target, e) for (target, _), e in zip(targets, reduced, strict=True)]


def _name_recurring(
    expressions: list[sp.Expr],
) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Name each subexpression that recurs, is ``Shared`` or the base of a power.

    Linear time: each subexpression is visited once, and common factors are not sought. Returns
    the temporaries with their definitions, and the expressions in them.
    """
    subexpressions = list(parts_of(expressions))
    uses = Counter(a for e in subexpressions for a in e.args)
    uses.update(expressions)
    # a second use of the argument of ``Shared`` and of a base makes it a temporary
    uses.update(e.args[0] for e in subexpressions if isinstance(e, Shared) or _multiplies(e))
    new_symbols = sp.numbered_symbols("_t", real=True)
    names: dict[sp.Basic, sp.Symbol] = {}
    replacement: dict[sp.Basic, sp.Basic] = {}
    for e in subexpressions:
        arguments = [replacement[a] for a in e.args]
        if isinstance(e, Shared):
            replacement[e] = arguments[0]
            continue
        reduced = rebuilt(e, arguments)
        # x and −x need no temporary
        if uses[e] > 1 and not reduced.is_Atom and not (-reduced).is_Symbol:
            if reduced not in names:
                names[reduced] = next(new_symbols)
            reduced = names[reduced]
        replacement[e] = reduced
    return _drop_unused([(symbol, e) for e, symbol in names.items()],
                        [replacement[e] for e in expressions])


def _multiplies(e: sp.Basic) -> bool:
    """Whether the C of e is a product in which its base occurs several times."""
    return bool(e.is_Pow and (2 * e.exp).is_Integer and abs(e.exp) > 1)


def entries(kernel: Kernel) -> list[tuple[str, sp.Expr]]:
    """Return the C text and the expression of each output entry: "v[1][2]", or "" if returned."""
    return list(_entries(kernel.outputs))


def _entries(outputs: Mapping[str, Any]) -> Iterator[tuple[str, sp.Expr]]:
    """Yield the C name and the expression of each entry of the outputs."""
    for array, output in outputs.items():
        if not isinstance(output, list):
            yield "", output
            continue
        for i, row in enumerate(output):
            if isinstance(row, list):
                yield from ((f"{array}[{i}][{j}]", entry) for j, entry in enumerate(row))
            else:
                yield f"{array}[{i}]", row


def _replace_shared(expressions: list[sp.Expr]) -> tuple[dict[sp.Symbol, sp.Expr], list[sp.Expr]]:
    """Return the definitions of new symbols for ``Shared`` parts, and expressions in them.

    Parts with equal definitions have one symbol; an atom, a symbol or a number, needs none.
    """
    new_symbols = sp.numbered_symbols("_s", real=True)
    replacement: dict[sp.Basic, sp.Basic] = {}
    symbols: dict[sp.Basic, sp.Symbol] = {}  # by definition: different parts may become equal
    for e in parts_of(expressions):
        arguments = [replacement[a] for a in e.args]
        if not isinstance(e, Shared):
            replacement[e] = rebuilt(e, arguments)
        elif arguments[0].is_Atom:
            replacement[e] = arguments[0]
        else:
            if arguments[0] not in symbols:
                symbols[arguments[0]] = next(new_symbols)
            replacement[e] = symbols[arguments[0]]
    return {s: e for e, s in symbols.items()}, [replacement[e] for e in expressions]


def _sort_definitions(
    temporaries: list[tuple[sp.Symbol, sp.Expr]], definitions: dict[sp.Symbol, sp.Expr]
) -> list[tuple[sp.Symbol, sp.Expr]]:
    """Return temporaries and definitions in an order in which each uses earlier ones only.

    A depth-first search lists a symbol after all symbols of its definition.
    """
    definition_of = dict(temporaries) | definitions
    ordered: dict[sp.Symbol, sp.Expr] = {}

    def visit(symbol: sp.Symbol) -> None:
        """Add a symbol's definition to ``ordered``, the definitions that it uses first."""
        # inputs and constants have no definition
        if symbol not in ordered and symbol in definition_of:
            # by name: a set of symbols has another order in each process
            for operand in sorted(definition_of[symbol].free_symbols, key=name_of):
                visit(operand)
            ordered[symbol] = definition_of[symbol]

    for symbol in definition_of:
        visit(symbol)
    return list(ordered.items())


def _drop_unused(
    temporaries: list[tuple[sp.Symbol, sp.Expr]], outputs: list[sp.Expr]
) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Return the temporaries and outputs without unused temporaries, and without other names.

    A temporary that is defined as another symbol is another name; that symbol takes its place.
    """
    alias_of: dict[sp.Symbol, sp.Expr] = {}
    distinct: list[tuple[sp.Symbol, sp.Expr]] = []
    for symbol, definition in temporaries:
        e = definition.xreplace(alias_of)
        if e.is_Symbol:
            alias_of[symbol] = e
        else:
            distinct.append((symbol, e))
    outputs = [e.xreplace(alias_of) for e in outputs]
    # backwards, as a temporary is used by later ones and by outputs only
    live = symbols_of(outputs)
    for symbol, e in reversed(distinct):
        if symbol in live:
            live |= e.free_symbols
    return [(symbol, e) for symbol, e in distinct if symbol in live], outputs


def _name_bases(
    temporaries: list[tuple[sp.Symbol, sp.Expr]], outputs: list[sp.Expr]
) -> tuple[list[tuple[sp.Symbol, sp.Expr]], list[sp.Expr]]:
    """Define a temporary for every base of an integer power, as the C of x² is x*x.

    If x^¼ or x^¾ occurs, all half powers become powers of √x, as one pow costs as much as ten
    square roots.
    """
    new_symbols = sp.numbered_symbols("_u", real=True)
    definitions: list[tuple[sp.Symbol, sp.Expr]] = []
    symbol_of: dict[sp.Expr, sp.Symbol] = {}
    expressions = [*(e for _, e in temporaries), *outputs]
    # bases with a fourth root
    fourth_roots = {power.base for power in parts_of(expressions)
                    if power.is_Pow and _has_denominator(power, q=4)}

    def temporary(base: sp.Expr) -> sp.Symbol:
        """Return the temporary of a base, and define it if it is new."""
        if base not in symbol_of:
            symbol_of[base] = next(new_symbols)
            definitions.append((symbol_of[base], base))
        return symbol_of[base]

    def rename(e: sp.Expr) -> sp.Expr:
        """Return e with temporaries for the bases of its powers."""
        if e.is_Atom:
            return e
        # before its arguments are renamed, as ``fourth_roots`` has the original bases
        by_root = e.is_Pow and e.base in fourth_roots and (
            _has_denominator(e, q=2) or _has_denominator(e, q=4))
        e = apply_function(e.func, [rename(a) for a in e.args])
        if by_root:
            return temporary(sp.sqrt(e.base)) ** (2 * e.exp)
        return temporary(e.base) ** e.exp if _multiplies(e) and not e.base.is_Atom else e

    for symbol, e in temporaries:
        # the temporaries of its bases come before it
        definition = rename(e)
        definitions.append((symbol, definition))
    return definitions, [rename(e) for e in outputs]


def _has_denominator(e: sp.Pow, q: int) -> bool:
    """Whether the exponent is a fraction with the denominator q."""
    return bool(e.exp.is_Rational and e.exp.q == q)
