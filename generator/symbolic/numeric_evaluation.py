"""Values of expressions, by recursion over the expression in NumPy or mpmath.

No code is generated. Values may be arrays, for many points at once, and complex: the complex step
f'(x) = Im f(x + iε)/ε has no cancellation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import reduce
from operator import add, mul
from typing import Any

import mpmath
import numpy as np
import sympy as sp

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.exact_numbers import exact
from .phases import Phase
from .shared_subexpressions import Shared
from .switching_functions import Switch

__all__ = ["Evaluator", "as_rational"]

#: SymPy function of one argument → its name in NumPy; mpmath has its inverses without "arc".
_FUNCTIONS = {
    sp.sin: "sin", sp.cos: "cos", sp.tan: "tan", sp.exp: "exp", sp.log: "log",
    sp.sinh: "sinh", sp.cosh: "cosh", sp.tanh: "tanh",
    sp.asin: "arcsin", sp.acos: "arccos", sp.atan: "arctan",
    sp.asinh: "arcsinh", sp.acosh: "arccosh", sp.atanh: "arctanh",
}


class Evaluator:
    """Values of expressions at given values of their symbols; every subtree is computed once."""

    def __init__(self, values: Mapping[sp.Symbol, Any], *, mp: Any = None) -> None:
        """Take the values of symbols; ``mp`` is a context of mpmath, or None to compute in NumPy.
        """
        self._values: dict[sp.Basic, Any] = dict(values)
        self._mp = mp

    def __call__(self, e: sp.Expr) -> Any:
        """Return the value of an expression, with the shape of the values of the symbols."""
        value = self._values.get(e)  # each look-up takes a hash of an expression
        if value is None:
            value = self._values[e] = self._compute(e)
        return value

    def _compute(self, e: sp.Expr) -> Any:
        """Return the value of an expression from the values of its arguments, each computed once.
        """
        if e.is_number and not e.free_symbols:
            return self._number(e)
        if e.is_Add:
            return reduce(add, map(self, e.args))
        if e.is_Mul:
            return reduce(mul, map(self, e.args))
        if e.is_Pow:
            return self._power(e)
        if e.func in _FUNCTIONS:
            return self._function(_FUNCTIONS[e.func])(self(e.args[0]))
        if e.func is sp.atan2:
            return self._angle(*map(self, e.args))
        if isinstance(e, Switch):
            return self._switch(e)
        if isinstance(e, Shared):
            return self(e.args[0])
        if isinstance(e, Phase):  # number · s · t0 + b, which C reduces modulo 2π
            number, s, start, b = map(self, e.args)
            return number * s * start + b
        if e.func in (sp.Abs, sp.sign, sp.floor):
            return self._of_sign(e.func, self(e.args[0]))
        raise InputError(f"{e} cannot be computed: no value is known for "
                         f"{str(e) if e.is_Symbol else e.func.__name__!r}.")

    def _number(self, e: sp.Expr) -> Any:
        """Return a number, rational or irrational, to the digits of mpmath or as a double."""
        if self._mp is not None:
            return self._mp.mpmathify(e.evalf(self._mp.dps))
        return np.float64(float(e))

    def _power(self, e: sp.Pow) -> Any:
        """Return base**exponent, as C computes it: a root, an integer power, or any other."""
        base, exponent = self(e.base), e.exp
        # sqrt is rounded correctly, a power of ½ is not
        if exponent == sp.Rational(1, 2):
            return self._function("sqrt")(base)
        if exponent.is_Integer:
            return base ** int(exponent)
        return base ** self(exponent)

    def _switch(self, e: Switch) -> Any:
        """Return the selected branch; mpmath does not evaluate the other one, which may raise."""
        a, b = map(self, e.args[:2])
        below, above = (e.args[i] for i in e.branches)
        if self._mp is not None:
            return self(below) if a.real < b.real else self(above)
        return np.where(np.real(a) < np.real(b), self(below), self(above))[()]

    def _angle(self, y: Any, x: Any) -> Any:
        """Return atan2(y, x), for complex numbers continued analytically from the real parts."""
        real_angle = self._function("arctan2")(np.real(y), np.real(x))
        if not (np.iscomplexobj(y) or np.iscomplexobj(x)):
            return real_angle
        # (x, y) in axes that are rotated by the real angle: the angle that is left is imaginary
        c, s = self._function("cos")(real_angle), self._function("sin")(real_angle)
        return real_angle + self._function("arctan")((y * c - x * s) / (x * c + y * s))

    def _of_sign(self, function: type[sp.Function], u: Any) -> Any:
        """Return |u|, sign u or floor u; of complex u by the sign of Re u, so |u| is analytic."""
        if function is sp.floor:
            return np.floor(np.real(u)) if self._mp is None else self._mp.floor(u.real)
        sign = np.sign(np.real(u)) if self._mp is None else self._mp.sign(u.real)
        return sign if function is sp.sign else sign * u

    def _function(self, name: str) -> Callable[..., Any]:
        """Return the function with a name of NumPy, or mpmath's: arcsin is its asin."""
        function: Callable[..., Any] = (
            getattr(np, name) if self._mp is None
            else getattr(self._mp, name.replace("arc", "a")))
        return function


def evaluate(expressions: Sequence[sp.Expr], values: Mapping[sp.Symbol, Any]) -> Array:
    """Return the values, shape (number of expressions, *broadcast shape of ``values``).

    Overflow and division by zero give infinity or NaN, where Python's floats would raise.
    """
    evaluator = Evaluator({symbol: np.asarray(v)[()] for symbol, v in values.items()})
    shape = np.broadcast_shapes(*(np.shape(v) for v in values.values()))
    with np.errstate(all="ignore"):
        rows = [evaluator(e) for e in expressions]
    # assignment broadcasts each row, which costs less than ``np.broadcast_to``
    types = {np.asarray(row).dtype for row in rows}
    array = np.empty((len(rows), *shape), np.result_type(*types) if types else float)
    for k, row in enumerate(rows):
        array[k] = row
    return array


def mp_context(digits: int) -> Any:
    """Return a new mpmath context, so that the global precision does not change."""
    context = mpmath.MPContext()
    context.dps = digits
    return context


def as_rational(value: Any) -> sp.Rational:
    """Return a finite real number of any type as an exact SymPy rational."""
    fraction = exact(value)
    if not isinstance(fraction, Fraction):
        raise TypeError(f"{value!r} is no finite real number")
    return sp.Rational(fraction.numerator, fraction.denominator)
