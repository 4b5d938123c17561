"""Switching functions: x where a < b and y elsewhere, max, min, |u| and sign u.

SymPy's Piecewise, Max, Min and Heaviside are converted to these when a system is made
(``as_switches``), and so are min(...) and if(...) of a model file. They are opaque to SymPy,
which would search conditions for what they imply, compare the arguments of a Max whenever it is
made anew, and put Dirac's delta into derivatives.

A switch w is the argument whose sign selects the side: a − b, or u. Derivatives are those of the
side where w is, at w = 0 that of one side or the mean of both; steps have none. Both sides are
computed, and one of them is taken: what the other one is there, finite or not, does not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache, reduce
from types import MappingProxyType
from typing import Any

import sympy as sp
from sympy.functions.elementary.piecewise import ExprCondPair
from sympy.logic.boolalg import Boolean, BooleanAtom

from ...core.errors import InputError
from .cardinal_functions import Numeric
from .shared_subexpressions import parts_of

__all__ = ["COMPARISONS", "Chooser", "Max", "Min", "Switch", "Where", "as_switches",
           "depends_by_steps", "every", "has_sides", "heaviside", "largest", "on_side", "remainder",
           "sides", "smallest", "some", "switches_of"]

#: A condition: returns the expression that has the first value where it holds, else the second.
Chooser = Callable[[sp.Expr, sp.Expr], sp.Expr]

ZERO, HALF, ONE = sp.Integer(0), sp.Rational(1, 2), sp.Integer(1)


class Switch(Numeric):
    """A function whose side depends on its first two arguments, a < b or not."""

    #: Which arguments it is below, where a < b, and above.
    branches: tuple[int, int]

    def pick(self, below: sp.Expr, above: sp.Expr) -> sp.Expr:
        """Return the switch with other values below and above."""
        raise NotImplementedError

    def _eval_derivative(self, s: sp.Symbol) -> sp.Expr:
        return self.pick(*(self.args[i].diff(s) for i in self.branches))

    def _eval_is_extended_real(self) -> Any:
        return all(self.args[i].is_extended_real for i in self.branches) or None


class Where(Switch):
    """x where a < b, y where not; no number where a or b is none."""

    nargs = 4
    branches = (2, 3)
    c_name = "choose"

    @classmethod
    def eval(cls, a: sp.Expr, b: sp.Expr, x: sp.Expr, y: sp.Expr) -> sp.Expr | None:
        """Return x or y where it is known which."""
        if x == y or a == b:
            return y
        if a.is_number and b.is_number:
            return x if a < b else y
        return None

    def pick(self, below: sp.Expr, above: sp.Expr) -> sp.Expr:
        """Return ``below`` where a < b, ``above`` where not."""
        return Where(*self.args[:2], below, above)

    @staticmethod
    def value(a: Any, b: Any, x: Any, y: Any) -> Any:
        """Return the value at mpmath numbers."""
        return x if a < b else y

    def _sympystr(self, printer: Any) -> str:
        x, y = map(printer.doprint, self.args[2:])
        return f"if({_condition_text(self, printer)}, {x}, {y})"


def _condition_text(e: Where, printer: Any, *, holds: bool = True) -> str:
    """Return where x holds, or where y does: a < b, or what ``every`` made a product of."""
    a, b = e.args[:2]
    steps = sp.Mul.make_args(b)
    if a != 0 or not all(isinstance(s, Where) and set(s.args[2:]) == {ZERO, ONE} for s in steps):
        return f"{printer.doprint(a)} {'<' if holds else '>='} {printer.doprint(b)}"
    text = " and ".join(_condition_text(step, printer, holds=step.args[2] == 1)
                        for step in sorted(steps, key=sp.default_sort_key))
    return text if holds else f"not ({text})"


class _Extreme(Switch):
    nargs = 2

    @classmethod
    def eval(cls, a: sp.Expr, b: sp.Expr) -> sp.Expr | None:
        """Return a or b where it is known which; arguments have SymPy's order."""
        if a == b:
            return a
        if a.is_number and b.is_number:
            return cls.value(a, b)
        return cls(b, a) if a.compare(b) > 0 else None

    def pick(self, below: sp.Expr, above: sp.Expr) -> sp.Expr:
        """Return ``below`` where a < b, ``above`` where a > b, and their mean where a = b."""
        a, b = self.args
        return Where(a, b, below, Where(b, a, above, (below + above) / 2))

    def _sympystr(self, printer: Any) -> str:
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
        return all(a.is_extended_nonnegative for a in self.args) or None


# ---------------------------------------------------------------- what an expression switches on


def sides(e: sp.Basic) -> tuple[sp.Expr, sp.Expr, sp.Expr] | None:
    """Return w and the values of e where w < 0 and where w > 0; None where e is no switch."""
    if isinstance(e, Switch):
        below, above = (e.args[i] for i in e.branches)
        return e.args[0] - e.args[1], below, above
    if isinstance(e, sp.Abs):
        return e.args[0], -e.args[0], e.args[0]
    if isinstance(e, sp.sign):
        return e.args[0], -ONE, ONE
    return None


@lru_cache(maxsize=2**14)
def has_sides(e: sp.Expr) -> bool:
    """Whether there is a switch in e."""
    return any(isinstance(part, (Switch, sp.Abs, sp.sign)) for part in parts_of([e]))


def switches_of(expressions: Iterable[sp.Expr]) -> list[sp.Expr]:
    """Return every switch w, and the argument of every floor, of the expressions.

    One that is made of other steps, as that of a condition of two comparisons, is left out.
    """
    found: dict[sp.Expr, None] = {}
    for part in parts_of(expressions):
        told = sides(part)
        w = told[0] if told is not None else part.args[0] if isinstance(part, sp.floor) else None
        if w is not None and -w not in found and on_side(w, lambda _: ZERO).free_symbols:
            found.setdefault(w)
    return sorted(found, key=str)


def on_side(e: sp.Expr, side: Callable[[sp.Expr], sp.Expr | None]) -> sp.Expr:
    """Return e with its sides weighed: ``side`` says for each w how much that of w > 0 counts.

    0 or 1 takes a side; None leaves the switch as it is. For a floor it says its value.
    """
    known: dict[sp.Basic, sp.Basic] = {}
    for part in parts_of([e]):
        arguments = [known[a] for a in part.args]
        made = part.func(*arguments) if arguments else part
        told, new = sides(part), sides(made)
        if told is not None and new is not None and (weight := side(told[0])) is not None:
            made = weight * new[2] + (1 - weight) * new[1]
        elif isinstance(part, sp.floor) and (value := side(part.args[0])) is not None:
            made = value
        known[part] = made
    return known[e]


def depends_by_steps(expressions: Iterable[sp.Expr], symbols: Iterable[sp.Symbol]) -> bool:
    """Whether the expressions switch where any of the symbols changes.

    A derivative by it that vanishes does not mean, then, that they do not depend on it.
    """
    wanted = set(symbols)
    return any(not w.free_symbols.isdisjoint(wanted) for w in switches_of(expressions))


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
    """Return the condition that holds where this one does not."""
    return lambda yes, no: condition(no, yes)


def every(conditions: Sequence[Chooser]) -> Chooser:
    """Return the condition that all of these hold: the product of 1 and 0 for each is above 0."""
    if len(conditions) == 1:
        return conditions[0]
    return lambda yes, no: Where(ZERO, sp.Mul(*(c(ONE, ZERO) for c in conditions)), yes, no)


def some(conditions: Sequence[Chooser]) -> Chooser:
    """Return the condition that any of these holds."""
    return negation(every([negation(c) for c in conditions]))


#: As signs.
COMPARISONS: Mapping[str, Callable[[sp.Expr, sp.Expr], Chooser]] = MappingProxyType({
    "<": less,
    "<=": lambda a, b: at_least(b, a),
    ">": lambda a, b: less(b, a),
    ">=": at_least,
    "==": equal,
    "!=": lambda a, b: negation(equal(a, b)),
})

# ---------------------------------------------------------------- functions made of switches


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


# ---------------------------------------------------------------- what SymPy says otherwise

_RELATIONS = {
    sp.StrictLessThan: COMPARISONS["<"], sp.LessThan: COMPARISONS["<="],
    sp.StrictGreaterThan: COMPARISONS[">"], sp.GreaterThan: COMPARISONS[">="],
    sp.Equality: COMPARISONS["=="], sp.Unequality: COMPARISONS["!="],
}
_JUNCTIONS: dict[type[sp.Basic], Callable[[Sequence[Chooser]], Chooser]] = {
    sp.And: every, sp.Or: some, sp.Not: lambda c: negation(c[0]),
}


#: SymPy's function → the same made of others.
_WRITTEN: dict[type[sp.Basic], Callable[..., sp.Expr]] = {
    sp.Max: largest,
    sp.Min: smallest,
    sp.Heaviside: heaviside,
    sp.Mod: remainder,
    sp.ceiling: lambda u: -sp.floor(-u),
    sp.frac: lambda u: u - sp.floor(u),
    # SymPy's for |e^z| of a symbol that is not declared real; all our numbers are
    sp.re: lambda u: u,
    sp.im: lambda _: ZERO,
    sp.conjugate: lambda u: u,
}


@lru_cache(maxsize=2**12)
def as_switches(e: sp.Expr) -> sp.Expr:
    """Return e with switching functions for Piecewise, Max, Min, Heaviside, Mod, ceiling and frac.

    Raises
    ------
    InputError
        For conditions other than comparisons, And, Or and Not, and for a Piecewise that leaves
        open what holds where none of its conditions does.
    """
    if not any(isinstance(part, (sp.Piecewise, *_WRITTEN)) for part in parts_of([e])):
        return e
    known: dict[sp.Basic, Any] = {}
    for part in parts_of([e]):
        arguments = [known[a] for a in part.args]
        if isinstance(part, BooleanAtom):
            known[part] = less(ZERO, ONE) if part else less(ONE, ZERO)
        elif part.func in _RELATIONS:
            known[part] = _RELATIONS[part.func](*arguments)
        elif part.func in _JUNCTIONS:
            known[part] = _JUNCTIONS[part.func](arguments)
        elif isinstance(part, Boolean) and not isinstance(part, sp.Expr):
            raise _not_understood(part)
        elif isinstance(part, ExprCondPair):
            known[part] = arguments
        elif isinstance(part, sp.Piecewise):
            known[part] = _piecewise(part, arguments)
        elif part.func in _WRITTEN:
            known[part] = _WRITTEN[part.func](*arguments)
        else:
            known[part] = part.func(*arguments) if arguments else part
    return known[e]


def _piecewise(e: sp.Piecewise, pieces: Sequence[tuple[sp.Expr, Chooser]]) -> sp.Expr:
    if not _is_complete([condition for _, condition in e.args]):
        raise InputError(f"{e} has no value where none of its conditions holds; end it with "
                         "(value, True).")
    value = pieces[-1][0]
    for pair, (expression, condition) in reversed(list(zip(e.args, pieces, strict=True))[:-1]):
        if isinstance(condition, sp.Basic):
            raise _not_understood(pair.cond)
        value = condition(expression, value)
    return value


def _not_understood(condition: sp.Basic) -> InputError:
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
