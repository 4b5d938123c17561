"""Switching functions: x where a < b and y elsewhere, max, min, |u| and sign u.

The constructor of a system converts SymPy's Piecewise, Max, Min and Heaviside to these functions
(``as_switches``), and the parser of model files min(...) and if(...). They are opaque to SymPy,
which would simplify conditions, compare the arguments of a Max whenever it is rebuilt, and put
Dirac's delta into derivatives.

A switch w is the expression whose sign selects the side (branch): a − b, or u. The derivative is
the derivative of the selected side, at w = 0 of one side or the mean of both; a step has the
derivative 0. In C both sides are evaluated and one is selected; the other may be infinite or NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache, reduce
from types import MappingProxyType
from typing import Any, NamedTuple

import sympy as sp
from sympy.functions.elementary.piecewise import ExprCondPair
from sympy.logic.boolalg import Boolean, BooleanAtom

from ...core.errors import InputError
from .cardinal_functions import Numeric
from .shared_subexpressions import parts_of

__all__ = [
    "COMPARISONS",
    "Chooser",
    "Max",
    "Min",
    "Switch",
    "Where",
    "any_of",
    "as_switches",
    "depends_by_steps",
    "every",
    "has_sides",
    "heaviside",
    "largest",
    "on_side",
    "remainder",
    "sides",
    "smallest",
    "switches_of",
]

#: A condition as a function (x, y) → the expression that is x where it holds and y elsewhere.
Chooser = Callable[[sp.Expr, sp.Expr], sp.Expr]

ZERO, HALF, ONE = sp.Integer(0), sp.Rational(1, 2), sp.Integer(1)


class Switch(Numeric):
    """A function whose side depends on its first two arguments, a < b or not."""

    #: Indices of the arguments that are its value for a < b and for a ≥ b.
    branches: tuple[int, int]

    def pick(self, below: sp.Expr, above: sp.Expr) -> sp.Expr:
        """Return the switch with other values for a < b and a ≥ b."""
        raise NotImplementedError

    def _eval_derivative(self, s: sp.Symbol) -> sp.Expr:
        """Return the derivative of the selected branch."""
        return self.pick(*(self.args[i].diff(s) for i in self.branches))

    def _eval_is_extended_real(self) -> Any:
        """Return True if both branches are real, else None, unknown."""
        return all(self.args[i].is_extended_real for i in self.branches) or None


class Where(Switch):
    """x where a < b, y elsewhere; NaN if a or b is NaN."""

    nargs = 4
    branches = (2, 3)
    c_name = "choose"

    @classmethod
    def eval(cls, a: sp.Expr, b: sp.Expr, x: sp.Expr, y: sp.Expr) -> sp.Expr | None:
        """Return x or y if the condition is decided."""
        if x == y or a == b:
            return y
        if a.is_number and b.is_number:
            return x if a < b else y
        return None

    def pick(self, below: sp.Expr, above: sp.Expr) -> sp.Expr:
        """Return ``below`` where a < b, ``above`` elsewhere."""
        return Where(*self.args[:2], below, above)

    @staticmethod
    def value(a: Any, b: Any, x: Any, y: Any) -> Any:
        """Return the value at mpmath numbers."""
        return x if a < b else y

    def _sympystr(self, printer: Any) -> str:
        """Return ``if(a < b, x, y)``, as model files have it."""
        x, y = map(printer.doprint, self.args[2:])
        return f"if({_condition_text(self, printer)}, {x}, {y})"


def _condition_text(e: Where, printer: Any, *, holds: bool = True) -> str:
    """Return the condition of e, or its negation, as text of model files: a < b, or a conjunction.

    ``holds`` is False for the negation.
    """
    factors = _factors_of_conjunction(e)
    if not factors:
        a, b, _, _ = e.args
        return f"{printer.doprint(a)} {'<' if holds else '>='} {printer.doprint(b)}"
    texts = []
    for factor in factors:
        _, _, if_true, _ = factor.args  # 1 for a condition, 0 for its negation
        texts.append(_condition_text(factor, printer, holds=if_true == 1))
    text = " and ".join(texts)
    return text if holds else f"not ({text})"


def _factors_of_conjunction(e: Where) -> list[Where]:
    """Return the factors of a condition 0 < Π factors, which ``every`` makes; else none.

    The factor of a condition c is Where(c, 1, 0), of its negation Where(c, 0, 1).
    """
    a, b, _, _ = e.args
    factors = sp.Mul.make_args(b)
    is_conjunction = a == 0 and all(
        isinstance(factor, Where) and set(factor.args[2:]) == {ZERO, ONE} for factor in factors)
    return sorted(factors, key=sp.default_sort_key) if is_conjunction else []


class _Extreme(Switch):
    """The larger or the smaller of a and b; ``value`` of a subclass says which."""

    @classmethod
    def eval(cls, a: sp.Expr, b: sp.Expr) -> sp.Expr | None:
        """Return a or b if the order is decided; arguments are sorted by SymPy's order."""
        if a == b:
            return a
        if a.is_number and b.is_number and a.is_extended_real and b.is_extended_real:
            return cls.value(a, b)  # complex numbers, such as asin(2), have no order
        return cls(b, a) if a.compare(b) > 0 else None

    def pick(self, below: sp.Expr, above: sp.Expr) -> sp.Expr:
        """Return ``below`` where a < b, ``above`` where a > b, and their mean where a = b."""
        a, b = self.args
        return Where(a, b, below, Where(b, a, above, (below + above) / 2))

    def _sympystr(self, printer: Any) -> str:
        """Return ``max(a, b)`` or ``min(a, b)``, as model files have it."""
        return f"{type(self).__name__.lower()}({', '.join(map(printer.doprint, self.args))})"


class Max(_Extreme):
    """The larger of a and b."""

    branches = (1, 0)
    c_name = "maximum"

    @staticmethod
    def value(a: Any, b: Any) -> Any:
        """Return the value at mpmath numbers."""
        return a if a > b else b

    def _eval_is_extended_nonnegative(self) -> Any:
        """Return True if a or b is ≥ 0, else None, unknown."""
        return any(a.is_extended_nonnegative for a in self.args) or None


class Min(_Extreme):
    """The smaller of a and b."""

    branches = (0, 1)
    c_name = "minimum"

    @staticmethod
    def value(a: Any, b: Any) -> Any:
        """Return the value at mpmath numbers."""
        return a if a < b else b

    def _eval_is_extended_nonnegative(self) -> Any:
        """Return True if a and b are ≥ 0, else None, unknown."""
        return all(a.is_extended_nonnegative for a in self.args) or None


# ---------------------------------------------------------------- switches of an expression


class Sides(NamedTuple):
    """A switch: an expression whose value is selected by the sign of w."""

    w: sp.Expr
    below: sp.Expr  # its value for w < 0
    above: sp.Expr  # its value for w > 0


def sides(e: sp.Basic) -> Sides | None:
    """Return the two sides of a comparison, |w| or sign(w); None for other expressions."""
    if isinstance(e, Switch):
        below, above = (e.args[i] for i in e.branches)
        return Sides(e.args[0] - e.args[1], below, above)
    if isinstance(e, sp.Abs):
        return Sides(e.args[0], -e.args[0], e.args[0])
    if isinstance(e, sp.sign):
        return Sides(e.args[0], -ONE, ONE)
    return None


@lru_cache(maxsize=2**14)
def has_sides(e: sp.Expr) -> bool:
    """Whether e contains a switch."""
    return any(isinstance(node, (Switch, sp.Abs, sp.sign)) for node in parts_of([e]))


def switches_of(expressions: Iterable[sp.Expr]) -> list[sp.Expr]:
    """Return every switch w, and the argument of every floor, of the expressions.

    A switch that depends on other steps only, as in a condition of two comparisons, is omitted.
    """
    switches: dict[sp.Expr, None] = {}
    for node in parts_of(expressions):
        switch = sides(node)
        floor_argument = node.args[0] if isinstance(node, sp.floor) else None
        w = switch.w if switch is not None else floor_argument
        if w is not None and -w not in switches and on_side(w, lambda _: ZERO).free_symbols:
            switches.setdefault(w)
    return sorted(switches, key=str)


def on_side(e: sp.Expr, side: Callable[[sp.Expr], sp.Expr | None]) -> sp.Expr:
    """Return e with each switch replaced by (1 − s) (side w < 0) + s (side w > 0).

    The weight s = side(w) selects a side by 0 or 1; None leaves the switch unchanged. For a floor,
    side(argument) is its value.
    """
    replacement: dict[sp.Basic, sp.Basic] = {}
    for node in parts_of([e]):
        arguments = [replacement[a] for a in node.args]
        rebuilt = node.func(*arguments) if arguments else node
        # ``side`` is asked about the original w, the sides may contain replaced switches
        original, replaced = sides(node), sides(rebuilt)
        if (original is not None and replaced is not None
                and (weight := side(original.w)) is not None):
            rebuilt = weight * replaced.above + (1 - weight) * replaced.below
        elif isinstance(node, sp.floor) and (floor_value := side(node.args[0])) is not None:
            rebuilt = floor_value
        replacement[node] = rebuilt
    return replacement[e]


def depends_by_steps(expressions: Iterable[sp.Expr], symbols: Iterable[sp.Symbol]) -> bool:
    """Whether a switch of the expressions depends on any of the symbols.

    Then the expressions may depend on a symbol although the derivative by it is 0.
    """
    symbol_set = set(symbols)
    return any(not w.free_symbols.isdisjoint(symbol_set) for w in switches_of(expressions))


# ---------------------------------------------------------------- conditions


def less(a: sp.Expr, b: sp.Expr) -> Chooser:
    """Return the condition a < b."""
    return lambda yes, no: Where(a, b, yes, no)


def at_least(a: sp.Expr, b: sp.Expr) -> Chooser:
    """Return the condition a ≥ b."""
    return negation(less(a, b))


def equal(a: sp.Expr, b: sp.Expr) -> Chooser:
    """Return the condition a = b."""
    return every([at_least(a, b), at_least(b, a)])


def negation(condition: Chooser) -> Chooser:
    """Return the negation of a condition."""
    return lambda yes, no: condition(no, yes)


def every(conditions: Sequence[Chooser]) -> Chooser:
    """Return the conjunction of conditions: the product of their values 1 or 0 is above 0."""
    if len(conditions) == 1:
        return conditions[0]
    return lambda yes, no: Where(ZERO, sp.Mul(*(c(ONE, ZERO) for c in conditions)), yes, no)


def any_of(conditions: Sequence[Chooser]) -> Chooser:
    """Return the disjunction of conditions."""
    return negation(every([negation(c) for c in conditions]))


#: Sign of a comparison → function of its two sides.
COMPARISONS: Mapping[str, Callable[[sp.Expr, sp.Expr], Chooser]] = MappingProxyType({
    "<": less,
    "<=": lambda a, b: at_least(b, a),
    ">": lambda a, b: less(b, a),
    ">=": at_least,
    "==": equal,
    "!=": lambda a, b: negation(equal(a, b)),
})

# ---------------------------------------------------------------- functions defined by switches


def largest(*arguments: sp.Expr) -> sp.Expr:
    """Return the largest of some expressions."""
    return reduce(Max, arguments)


def smallest(*arguments: sp.Expr) -> sp.Expr:
    """Return the smallest of some expressions."""
    return reduce(Min, arguments)


def heaviside(u: sp.Expr, at_zero: sp.Expr = HALF) -> sp.Expr:
    """Return 0 where u < 0, 1 where u > 0, and ½ in between, as SymPy's Heaviside."""
    return Where(u, ZERO, ZERO, Where(ZERO, u, ONE, at_zero))


def remainder(a: sp.Expr, b: sp.Expr) -> sp.Expr:
    """Return a − b ⌊a/b⌋, which has the sign of b."""
    return a - b * sp.floor(a / b)


# ---------------------------------------------------------------- conversion from SymPy

_RELATIONS = {
    sp.StrictLessThan: COMPARISONS["<"], sp.LessThan: COMPARISONS["<="],
    sp.StrictGreaterThan: COMPARISONS[">"], sp.GreaterThan: COMPARISONS[">="],
    sp.Equality: COMPARISONS["=="], sp.Unequality: COMPARISONS["!="],
}
_JUNCTIONS: dict[type[sp.Basic], Callable[[Sequence[Chooser]], Chooser]] = {
    sp.And: every, sp.Or: any_of, sp.Not: lambda c: negation(c[0]),
}


#: SymPy function → its definition by other functions.
_DEFINITIONS: dict[type[sp.Basic], Callable[..., sp.Expr]] = {
    sp.Max: largest,
    sp.Min: smallest,
    sp.Heaviside: heaviside,
    sp.Mod: remainder,
    sp.ceiling: lambda u: -sp.floor(-u),
    sp.frac: lambda u: u - sp.floor(u),
    # SymPy returns these for |e^z| if z is not declared real; here all symbols are real
    sp.re: lambda u: u,
    sp.im: lambda _: ZERO,
    sp.conjugate: lambda u: u,
}


@lru_cache(maxsize=2**12)
def as_switches(e: sp.Expr) -> sp.Expr:
    """Return e with switching functions for Piecewise, Max, Min, Heaviside, Mod, ceiling and frac.

    Raises InputError for conditions other than comparisons, And, Or and Not, and for a Piecewise
    without a value where none of its conditions holds.
    """
    if not any(isinstance(node, (sp.Piecewise, *_DEFINITIONS)) for node in parts_of([e])):
        return e
    # a condition is replaced by a Chooser, a pair of Piecewise by its two parts
    replacement: dict[sp.Basic, Any] = {}
    for node in parts_of([e]):
        arguments = [replacement[a] for a in node.args]
        if isinstance(node, BooleanAtom):
            replacement[node] = less(ZERO, ONE) if node else less(ONE, ZERO)
        elif node.func in _RELATIONS:
            replacement[node] = _RELATIONS[node.func](*arguments)
        elif node.func in _JUNCTIONS:
            replacement[node] = _JUNCTIONS[node.func](arguments)
        elif isinstance(node, Boolean) and not isinstance(node, sp.Expr):
            raise _condition_error(node)
        elif isinstance(node, ExprCondPair):
            replacement[node] = arguments
        elif isinstance(node, sp.Piecewise):
            replacement[node] = _piecewise(node, arguments)
        elif node.func in _DEFINITIONS:
            replacement[node] = _DEFINITIONS[node.func](*arguments)
        elif any(not isinstance(a, sp.Basic) for a in arguments):  # conditions, in a set for one
            raise _condition_error(node)
        else:
            replacement[node] = node.func(*arguments) if arguments else node
    return replacement[e]


def _piecewise(e: sp.Piecewise, pieces: Sequence[tuple[sp.Expr, Chooser | sp.Basic]]) -> sp.Expr:
    """Return a Piecewise as nested choices, the last piece innermost.

    ``pieces`` has each expression with the function that chooses, (x, otherwise) ↦ choice; a
    condition that was not understood is a SymPy object still, and refused.
    """
    if not _is_complete([condition for _, condition in e.args]):
        raise InputError(f"{e} has no value where none of its conditions holds; end it with "
                         "(value, True).")
    # the last piece has no condition: it is the value where no other condition holds; the others
    # follow from the last but one to the first
    choice = pieces[-1][0]
    for (_, condition), (expression, choose) in zip(e.args[-2::-1], pieces[-2::-1], strict=True):
        if isinstance(choose, sp.Basic):
            raise _condition_error(condition)
        choice = choose(expression, choice)
    return choice


def _condition_error(condition: sp.Basic) -> InputError:
    """Return the error of a condition that is no comparison and no junction of comparisons."""
    return InputError(f"The condition {condition} of a Piecewise is not understood; write it with "
                      "<, <=, >, >=, Eq, Ne, And, Or and Not.")


def _is_complete(conditions: Sequence[Any]) -> bool:
    """Whether one of the conditions always holds, as far as SymPy decides."""
    together = sp.Or(*conditions)
    if together in (sp.true, sp.false):
        return bool(together)
    try:
        return len(together.free_symbols) == 1 and together.as_set() == sp.S.Reals
    except (NotImplementedError, TypeError, ValueError, AttributeError):
        return False
