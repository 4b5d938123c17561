"""SymPy expressions as C text, with a count of the operations they cost.

Numbers are printed by ``Real.literal`` of ``core/real_types.py``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from fractions import Fraction

import sympy as sp

from ...core.errors import InputError
from ...core.real_types import Real, round_binary
from ..symbolic.cardinal_functions import Numeric
from ..symbolic.construction import has_minus
from ..symbolic.phases import Phase

__all__ = ["ON_LANES", "SWITCHES", "CPrinter"]

_SUM, _PRODUCT, _ATOM = 1, 2, 3
#: SymPy function → function of <math.h>, without suffix.
_FUNCTIONS = {getattr(sp, name): name for name in (
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh", "acosh",
    "atanh", "exp", "log", "floor",
)} | {sp.Abs: "fabs"}
#: Functions with a switch, defined in ``templates/switches.c.jinja``.
SWITCHES = frozenset({"choose", "maximum", "minimum", "sign"})
#: Functions that take all lanes at once.
ON_LANES = SWITCHES | {"fabs"}
#: Powers up to this exponent are written as products.
_LARGEST_PRODUCT = 16


class CPrinter:
    """Prints expressions as C and counts their operations.

    Parameters
    ----------
    real : Real
        The floating-point type; fixes literals and the suffix of ``<math.h>`` functions.
    names : mapping
        C text for each symbol; a symbol without an entry keeps its own name.
    prefix : str
        Prefix of functions of lanes or dual numbers; empty for plain numbers.
    explicit : bool
        Whether products in sums have parentheses, as MISRA C asks for.
    """

    def __init__(self, real: Real, names: Mapping[sp.Symbol, str], prefix: str = "", *,
                 explicit: bool = False) -> None:
        self.real = real
        self.names = dict(names)
        self.prefix = prefix
        self.explicit = explicit
        self.operations: Counter[str] = Counter()
        #: Names of the called functions, of <math.h> (without suffix) and of the engine.
        self.functions: set[str] = set()

    def __call__(self, expression: sp.Expr) -> str:
        """Return C text for the expression."""
        text, _ = self._text(expression)
        return text

    def number(self, e: sp.Expr) -> str:
        """Return C text of the kernel's type: on lanes, a number becomes ``splat(number)``.

        C does not convert a number to lanes.
        """
        text = self(e)
        return f"splat({text})" if self.on_lanes and e.is_number else text

    @property
    def on_lanes(self) -> bool:
        """Whether values are lanes."""
        return self.prefix == "lanes_"

    def _call(self, name: str, *arguments: sp.Expr, suffix: bool = True) -> str:
        """Return a call and count it; functions of single lanes take the number of lanes first."""
        self.functions.add(name)
        self.operations[name] += 1
        type_suffix = "" if self.prefix or not suffix else self.real.suffix.lower()
        lane_by_lane = self.on_lanes and name not in ON_LANES
        texts = [*(["c->_used"] if lane_by_lane else []), *map(self.number, arguments)]
        return f"{self.prefix}{name}{type_suffix}({', '.join(texts)})"

    def _text(self, e: sp.Expr) -> tuple[str, int]:
        """Return C text and its precedence: _SUM, _PRODUCT or _ATOM."""
        if e.is_Symbol:
            return self.names.get(e, e.name), _ATOM
        if e.is_Rational:
            return self._rational(e)
        if e.is_number and e.is_real and e.is_finite:
            # an irrational number such as π: 60 digits, rounded once
            text = self.real.literal(Fraction(str(sp.N(e, 60))))
            return text, _SUM if text.startswith("-") else _ATOM
        if e.is_Add:
            return self._sum(e), _SUM
        if e.is_Mul:
            return self._product(e)
        if e.is_Pow:
            return self._power(e.base, e.exp)
        if e.func in _FUNCTIONS:
            return self._call(_FUNCTIONS[e.func], *e.args), _ATOM
        if isinstance(e, Phase):
            return self._phase(e), _ATOM
        if isinstance(e, Numeric):
            return self._call(e.c_name, *e.args, suffix=False), _ATOM
        if isinstance(e, sp.sign):
            return self._call("sign", *e.args, suffix=False), _ATOM
        raise InputError(f"No C is known for {e.func.__name__!r} in {e}; write it with + - * /, "
                         f"powers, sqrt, {', '.join(f.__name__ for f in _FUNCTIONS)}, sign, "
                         "Heaviside, Min, Max, Piecewise, ceiling, Mod.")

    def _phase(self, e: Phase) -> str:
        """Return phase(c_high, c_low, …), the call of a phase with the number c = c_high + c_low.

        c_high is c in the type, c_low what is missing: together twice the digits. Of an irrational
        number 90 digits are taken, more than two numbers of 113 bits have.
        """
        number, *arguments = e.args
        exact = Fraction(str(sp.N(number, 90))) if not number.is_Rational else Fraction(
            int(number.p), int(number.q))
        high = round_binary(exact, self.real.bits)
        texts = map(self.real.literal, (high, exact - high))
        self.functions |= {"phase", "sin", "cos", "atan2", "fma"}
        return f"phase({', '.join([*texts, *map(self.number, arguments)])})"

    def _within(self, e: sp.Expr, level: int) -> str:
        """Return the text of e, in parentheses if its precedence is below ``level``."""
        text, precedence = self._text(e)
        return text if precedence >= level else f"({text})"

    def _rational(self, e: sp.Rational) -> tuple[str, int]:
        """Return a literal if the denominator is a power of two (exact), else a quotient."""
        ratio = Fraction(int(e.p), int(e.q))
        denominator = ratio.denominator
        if denominator & (denominator - 1) == 0 and denominator <= 2**20:
            text = self.real.literal(ratio)
            return text, _PRODUCT if ratio < 0 else _ATOM
        # the C compiler divides two literals once, correctly rounded if both are exact
        numerator, divisor = Fraction(ratio.numerator), Fraction(denominator)
        if max(abs(numerator), divisor) > 2**self.real.bits:
            text = self.real.literal(ratio)
            return text, _PRODUCT if ratio < 0 else _ATOM
        return f"{self.real.literal(numerator)}/{self.real.literal(divisor)}", _PRODUCT

    def _sum(self, e: sp.Add) -> str:
        """Return a sum in C, terms with a minus sign last."""
        self.operations["add"] += len(e.args) - 1
        positive = [a for a in e.args if not has_minus(a)]
        negative = [a for a in e.args if has_minus(a)]
        text = " + ".join(self._term(a, _SUM) for a in positive)
        for a in negative:
            text += (" - " if text else "-") + self._term(-a, _PRODUCT)
        return text

    def _term(self, e: sp.Expr, level: int) -> str:
        """Return a term of a sum, in parentheses below the precedence ``level`` of its place.

        MISRA C (``explicit``) asks for parentheses around products, too.
        """
        text, precedence = self._text(e)
        bare = precedence == _ATOM or (precedence >= level and not self.explicit)
        return text if bare else f"({text})"

    def _product(self, e: sp.Mul) -> tuple[str, int]:
        """Return a product or quotient in C, and its precedence."""
        if has_minus(e):
            return f"-{self._within(-e, _PRODUCT)}", _PRODUCT
        numerator: list[sp.Expr] = []
        denominator: list[sp.Expr] = []
        for a in e.args:
            # 1/a.q, where a.q is no power of two: x/3 has one rounding error, (1/3) x has two; an
            # a.q beyond the type's largest number has no literal, and 1/a.q has one
            if a.is_Rational and a.p == 1 and (a.q & (a.q - 1)) and a.q < 2**self.real.exponent:
                denominator.append(sp.Integer(a.q))
            elif a.is_Pow and a.exp.is_Rational and a.exp < 0:
                denominator.append(a.base ** (-a.exp))
            else:
                numerator.append(a)
        if products := max(len(numerator) - 1, 0) + max(len(denominator) - 1, 0):
            self.operations["mul"] += products
        text = "*".join(self._within(a, _PRODUCT) for a in numerator)
        if not denominator:
            return text, _PRODUCT
        self.operations["div"] += 1
        divisor = "*".join(self._within(a, _PRODUCT) for a in denominator)
        if len(denominator) > 1 or not self._is_atom(denominator[0]):
            divisor = f"({divisor})"
        return f"{text or self.real.literal(Fraction(1))}/{divisor}", _PRODUCT

    def _is_atom(self, e: sp.Expr) -> bool:
        """Whether e needs no parentheses as a divisor: a symbol or a positive integer."""
        return bool(e.is_Symbol or (e.is_Integer and e > 0))

    def _power(self, base: sp.Expr, exponent: sp.Expr) -> tuple[str, int]:
        """Return base^exponent in C and its precedence, which decides on parentheses.

        Integers up to 16 give products, halves a sqrt, all others a pow. A negative exponent gives
        the quotient 1/base^(−exponent).
        """
        if exponent.is_Rational and exponent < 0:
            self.operations["div"] += 1
            text, precedence = self._power(base, -exponent)
            divisor = text if precedence == _ATOM else f"({text})"
            return f"{self.real.literal(Fraction(1))}/{divisor}", _PRODUCT
        if exponent == 1:
            return self._text(base)
        if exponent.is_Integer and exponent <= _LARGEST_PRODUCT:
            self.operations["mul"] += int(exponent) - 1
            return power_by_halving(self._within(base, _ATOM), int(exponent)), _PRODUCT
        if exponent == sp.Rational(1, 2):
            return self._call("sqrt", base), _ATOM
        if exponent.is_Rational and exponent.q == 2:  # x^(5/2) = x² √x, cheaper than pow
            integer_power = self._within(base ** sp.Integer((exponent.p - 1) // 2), _PRODUCT)
            if integer_power.startswith("-"):
                integer_power = f"({integer_power})"
            self.operations["mul"] += 1
            return f"{integer_power}*{self(sp.sqrt(base))}", _PRODUCT
        return self._call("pow", base, exponent), _ATOM


def power_by_halving(factor: str, n: int) -> str:
    """Return factorⁿ as a product of equal halves, which the compiler computes once."""
    if n <= 4:
        return "*".join([factor] * n)
    half = power_by_halving(factor, n // 2)
    return f"({half})*({half})" + (f"*{factor}" if n % 2 else "")
