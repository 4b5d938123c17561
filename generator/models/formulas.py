"""Formulas of model files: arithmetic text in named symbols, read into SymPy expressions.

The grammar is that of ``grammar`` with the functions below and the constant pi. Decimals are read
exactly: 0.1 is 1/10. Constants are computed by ``bounded_numbers``; a formula is bounded by the
length of its text, by its exponents, by the digits of its coefficients and by the number of terms
it would have if it were multiplied out, all checked before SymPy is asked for anything.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import sympy as sp
from mpmath import mp

from ...core.errors import InputError
from ...core.exact_numbers import Rounded, exact
from ...core.records import dataclass
from ..parsing import bounded_numbers as numbers
from ..parsing.bounded_numbers import Value, rational
from ..parsing.grammar import parse_quantity
from ..parsing.tokens import RefusedError, shorten
from ..symbolic import switching_functions
from ..symbolic.numeric_evaluation import as_rational

__all__ = ["CONSTANTS", "FUNCTIONS", "parse_formula", "parse_number"]

#: An exponent multiplies the bits of its base's coefficients and the terms of its expansion.
MAX_EXPONENT = 64
#: Terms of the expansion: SymPy multiplies out 5000 in 1.4 s, and derives them by six coordinates
#: in 21 s.
MAX_TERMS = 5000
#: Bits of the coefficients, 3613 digits: Python writes integers of at most 4300 as text.
MAX_BITS = 12_000
#: Quotients, roots, powers and functions inside one another: derivatives and discrete gradients
#: grow exponentially with it.
MAX_LEVEL = 5  # beside one another, the sides of an if(...) do not count
#: Largest |x| of a function of a constant: its relative error of 1e-96 (``INTERVAL``) is one of at
#: most 1e-93 in exp(x), which ``NEARLY_ONE`` encloses.
MAX_ARGUMENT = 1000
#: Bits of the integers into which SymPy turns a fractional power of a number: 12**(7/9) becomes
#: 2**(5/9)*18**(1/3), and 12**0.7777777777 would need a number of 10^10 bits. It then looks for
#: their factors, which takes seconds from 20,000 bits on unless division by small primes finds all.
MAX_ROOT_BITS = 10_000
MAX_SMOOTH_ROOT_BITS = 1_000_000
#: Divisors below this are tried, and what they leave is a large factor.
_SMALL_PRIMES = 1000

#: Name → the function and its number of arguments; −2: two or more.
FUNCTIONS: Mapping[str, tuple[Callable[..., sp.Expr], int]] = MappingProxyType({
    "sqrt": (sp.sqrt, 1), "exp": (sp.exp, 1), "log": (sp.log, 1),
    "sin": (sp.sin, 1), "cos": (sp.cos, 1), "tan": (sp.tan, 1),
    "asin": (sp.asin, 1), "acos": (sp.acos, 1), "atan": (sp.atan, 1), "atan2": (sp.atan2, 2),
    "sinh": (sp.sinh, 1), "cosh": (sp.cosh, 1), "tanh": (sp.tanh, 1),
    "abs": (sp.Abs, 1), "sign": (sp.sign, 1), "heaviside": (switching_functions.heaviside, 1),
    "min": (switching_functions.smallest, -2), "max": (switching_functions.largest, -2),
    "floor": (sp.floor, 1), "mod": (switching_functions.remainder, 2),
    "if": (switching_functions.Where, 3),
})
CONSTANTS: Mapping[str, sp.Expr] = MappingProxyType({"pi": sp.pi})

#: Allowed functions of a formula once SymPy has evaluated it.
_KNOWN = frozenset([sp.exp, sp.log, sp.sin, sp.cos, sp.tan, sp.asin, sp.acos, sp.atan, sp.atan2,
                    sp.sinh, sp.cosh, sp.tanh, sp.cot, sp.coth, sp.Abs, sp.sign, sp.floor,
                    switching_functions.Where, switching_functions.Min, switching_functions.Max])


@dataclass(frozen=True)
class _Condition:
    """A condition with the formulas that it compares, whose bounds a choice inherits."""

    chooser: switching_functions.Chooser  # (yes, no) → the expression that chooses
    holds: bool | None  # None where it depends on symbols
    compared: tuple[Value, ...]


def parse_formula(
    text: str, names: Mapping[str, sp.Expr], exponents: frozenset[sp.Symbol] = frozenset()
) -> sp.Expr:
    """Return the formula of a text, e.g. "m*g*l*cos(theta)".

    Parameters
    ----------
    text : str
        In the grammar of ``grammar``.
    names : mapping
        Values of names, besides the functions and pi.
    exponents : set of Symbol
        Symbols allowed in exponents, besides numbers from −64 to 64: parameters.

    Raises
    ------
    InputError
        With the position and the cure, for whatever is no formula, or one too large to derive a
        stepper from.
    """
    return _parse_formula(text, names, exponents, units={})


def _parse_formula(
    text: str, names: Mapping[str, sp.Expr], exponents: frozenset[sp.Symbol],
    units: Mapping[str, str],
) -> sp.Expr:
    """Return a formula as an expression; refuse numbers that no double can hold.

    ``names`` has the symbols of the formula, ``exponents`` those that may stand in an exponent,
    ``units`` the factor of each unit as text.
    """
    arithmetic = _Formulas({**CONSTANTS, **names}, exponents)
    formula = parse_quantity(text, arithmetic, "a formula such as m*g*z", units).exact
    for number in formula.atoms(sp.Rational):
        # doubles end at 2¹⁰²⁴ and 2⁻¹⁰²²; lengths in bits give log₂ to within 1
        if number != 0 and abs(int(number.p).bit_length() - int(number.q).bit_length()) > 1000:
            raise InputError(f"The formula {shorten(text)!r} contains a number of size "
                             f"{sp.N(number, 3)}, which no double can hold; choose other units.")
    return formula


def parse_number(
    text: str, values: Mapping[str, float] = MappingProxyType({}),
    units: Mapping[str, str] = MappingProxyType({}),
) -> float:
    """Return the number of a text, e.g. "pi/6" or "2*r", with the values of other names.

    The double carries more digits than any type has. ``units`` are those of ``grammar`` that
    it may have: "30 deg" is pi/6. Raises InputError with the position and the cure, for whatever is
    no finite number.
    """
    names = {name: as_rational(value) for name, value in values.items()}
    number = exact(_parse_formula(text, names, exponents=frozenset(), units=units))
    return Rounded(number) if isinstance(number, Fraction) else math.nan


class _Formulas:
    """SymPy expressions; each operation is checked before it is carried out."""

    functions: Mapping[str, int] = MappingProxyType({n: count for n, (_, count)
                                                     in FUNCTIONS.items()})

    def __init__(self, names: Mapping[str, sp.Expr], exponents: frozenset[sp.Symbol]) -> None:
        self.names = names
        self.exponents = exponents

    def literal(self, digits: int, exponent: int) -> Value:
        """Return the decimal digits · 10^exponent, exactly."""
        return rational(sp.Integer(digits) * sp.Integer(10) ** exponent)

    def value_of(self, name: str) -> Value:
        """Return the value of a name: exact if it is a number, else one term of a formula."""
        expression = self.names[name]
        if expression.is_number:
            return numbers.value_of(expression)
        return Value(expression, enclosure=None, bits=1, terms=len(sp.Add.make_args(expression)))

    def add(self, terms: Sequence[Value]) -> Value:
        """Return the sum; of numbers alone by exact arithmetic."""
        constants = [t for t in terms if t.is_number]
        if len(constants) == len(terms):
            return numbers.add(constants)
        return _formula(terms, levels=0, terms=sum(t.terms for t in terms), operation=sp.Add)

    def multiply(self, factors: Sequence[Value]) -> Value:
        """Return the product; of numbers alone by exact arithmetic."""
        constants = [f for f in factors if f.is_number]
        if len(constants) == len(factors):
            return numbers.multiply(constants)
        return _formula(factors, levels=0, terms=math.prod(f.terms for f in factors),
                        operation=sp.Mul)

    def negative(self, value: Value) -> Value:
        """Return −value."""
        return self.multiply([rational(sp.Integer(-1)), value])

    def reciprocal(self, value: Value) -> Value:
        """Return 1/value, one level deeper than ``value``; a number's is exact."""
        if value.is_number:
            return numbers.reciprocal(value)
        return _formula([value], levels=1, terms=value.terms, operation=lambda e: 1 / e)

    def power(self, base: Value, exponent: Value) -> Value:
        """Return base^exponent; refuse roots and exponents whose expansion could become long.

        A number to a number is evaluated; a sum of k terms to the power n counts C(k + n − 1, n)
        terms.
        """
        self.check_exponent(exponent)
        e = exponent.exact
        _refuse_long_root(base.exact, e)
        if base.is_number:
            if e.is_Rational and e.q <= 2:
                return numbers.power(base, rational(e))
            if not _number(base) > 0:
                raise RefusedError(f"{shorten(str(base.exact))} has no power {shorten(str(e))}; "
                                   "write a base above 0, or an integer exponent")
            if exponent.is_number:
                return self.constant_value(sp.Pow, mp.power, [base, exponent])
        # bounds of the expansion, a product of ``size`` bases
        size = math.floor(abs(_number(exponent))) if exponent.is_number else 1
        terms = math.comb(base.terms + size - 1, size)
        # the base itself, with the bits that the numbers of the product may have
        bounded_base = replace(base, bits=base.bits * max(size, 1))
        # a whole power is a product at the same level, a quotient or root is one level deeper,
        # any other power two
        levels = 0 if e.is_Integer and e >= 0 else 1 if e.is_Rational else 2
        return _formula([bounded_base, exponent], levels, terms, sp.Pow)

    def check_exponent(self, exponent: Value) -> None:
        """Refuse an exponent that varies in a run, or is too large to expand."""
        e = exponent.exact
        if not exponent.is_number:
            strange = sorted(map(str, e.free_symbols - self.exponents))
            if strange:
                raise RefusedError(f"The exponent depends on {strange[0]}; write numbers and "
                                   "parameters alone there, or use exp and log")
        elif abs(_number(exponent)) > MAX_EXPONENT:
            raise RefusedError(f"The exponent {shorten(str(e), 20)} is not within ±{MAX_EXPONENT}; "
                               "lower it")

    def call(self, function: str, arguments: Sequence[Value]) -> Value:
        """Return the value of a function: a formula where an argument is no number.

        Of numbers, the value is exact where it is rational, else a number of mpmath.
        """
        constants = [a for a in arguments if a.is_number]
        make, _ = FUNCTIONS[function]
        # SymPy makes exp(c*log(x)) the power x**c
        if function == "exp":
            for term in sp.Add.make_args(arguments[0].exact):
                factor, logarithm = term.as_coeff_Mul()
                if logarithm.func is sp.log:
                    self.check_exponent(rational(factor))
                    _refuse_long_root(logarithm.args[0], factor)
        # a remainder by 0 is refused as a division by 0
        if function == "mod" and arguments[1].is_number:
            numbers.reciprocal(arguments[1])
        if len(constants) < len(arguments):
            return _formula(arguments, levels=1, terms=sum(a.terms for a in arguments),
                            operation=make)
        if function in numbers.FUNCTIONS:
            return numbers.FUNCTIONS[function](*constants)
        return self.constant_value(make, getattr(mp, function), constants)

    # ------------------------------------------------------------ conditions

    def compare(self, sign: str, a: Value, b: Value) -> _Condition:
        """Return the condition a < b, or another sign; of two numbers it is decided at once."""
        chooser = switching_functions.COMPARISONS[sign](a.exact, b.exact)
        if not a.is_number or not b.is_number:
            return _Condition(chooser, holds=None, compared=(a, b))
        # a < b as (sign of a − b) < 0: the sign is certain, whatever roots the numbers contain
        order = sp.Integer(numbers.order(a, b))
        compare = switching_functions.COMPARISONS[sign]
        holds = compare(order, sp.Integer(0))(sp.Integer(1), sp.Integer(0))
        return _Condition(chooser, holds=holds == 1, compared=())

    def join(self, word: str, conditions: Sequence[_Condition]) -> _Condition:
        """Return conditions joined by ``and`` or ``or``; those that are decided need no code."""
        # one true condition decides "or", one false condition decides "and"; the chooser of a
        # decided condition is not used
        deciding_value = word == "or"
        if any(c.holds is deciding_value for c in conditions):
            return _Condition(conditions[0].chooser, holds=deciding_value, compared=())
        undecided = [c for c in conditions if c.holds is None]
        if not undecided:
            return _Condition(conditions[0].chooser, holds=not deciding_value, compared=())
        together = switching_functions.any_of if deciding_value else switching_functions.every
        return _Condition(together([c.chooser for c in undecided]), holds=None,
                          compared=tuple(t for c in undecided for t in c.compared))

    def choose(self, condition: _Condition, yes: Value, no: Value) -> Value:
        """Return yes or no if the condition is decided, else the formula that chooses."""
        if condition.holds is not None:
            return yes if condition.holds else no
        # the compared formulas count in the bounds; the condition's own expression contains them
        parts = (*condition.compared, yes, no)
        return _formula(parts, levels=0, terms=sum(a.terms for a in parts),
                        operation=lambda *expressions: condition.chooser(*expressions[-2:]))

    def constant_value(
        self, make: Callable[..., sp.Expr], number: Callable[..., Any], arguments: list[Value]
    ) -> Value:
        """Return a function of constants, which must be a real number of at most 10^50.

        ``make`` is SymPy's function, ``number`` the function of mpmath, which is evaluated first:
        SymPy takes very long for some arguments.
        """
        argument_values = [_number(a) for a in arguments]
        if any(abs(x) > MAX_ARGUMENT for x in argument_values):
            raise RefusedError(f"A function of {mp.nstr(max(argument_values, key=abs), 5)} is "
                               f"asked for, which is not within ±{MAX_ARGUMENT}; work the number "
                               "out")
        with mp.workdps(100):
            try:
                result = number(*argument_values)
            except (ValueError, ZeroDivisionError):
                result = mp.nan
            is_real = not isinstance(result, mp.mpc) and mp.isfinite(result)
            if not is_real or abs(result) > mp.mpf(10)**50:
                raise RefusedError("This function of "
                                   f"{', '.join(mp.nstr(x, 5) for x in argument_values)} is no "
                                   "real number of moderate size; write another argument")
        # bounds of the length of the exact expression, and of its depth
        bits = sum(a.bits for a in arguments) + 1
        level = max(a.level for a in arguments) + 1
        if level > numbers.MAX_LEVEL or bits > MAX_BITS:
            raise RefusedError("This constant is too long; work it out and write a decimal")
        expression = make(*(a.exact for a in arguments))
        if expression.is_Rational:
            return rational(expression)
        _refuse_unreal_or_unknown(expression)
        # an interval around the 95 digits that are certain
        return Value(expression, numbers.INTERVAL.mpf(mp.nstr(result, 95)) * numbers.NEARLY_ONE,
                     bits, level)


def _number(value: Value) -> Any:
    """Return a constant as mpmath's number, with 90 digits or more."""
    with mp.workdps(100):  # more than the 96 of an interval, so that the conversion adds no error
        if value.is_rational:
            return mp.mpf(int(value.exact.p)) / int(value.exact.q)
        return mp.mpf(value.interval.mid)


def _formula(
    arguments: Sequence[Value], levels: int, terms: int, operation: Callable[..., sp.Expr]
) -> Value:
    """Carry out an operation if its bounds permit it; the result may be a constant.

    ``levels`` is added to the largest level of the arguments; ``terms`` is the number of terms
    that the result would have if it were multiplied out. Raises RefusedError beyond a bound.
    """
    # a carry for each operand; constants are folded, and do not lie inside one another
    bits = sum(a.bits + 1 for a in arguments)
    level = max((a.level for a in arguments if not a.is_number), default=0) + levels
    if level > MAX_LEVEL:
        raise RefusedError(f"More than {MAX_LEVEL} quotients, roots and functions lie inside one "
                           "another here; simplify the formula")
    if bits > MAX_BITS:
        raise RefusedError(f"The coefficients of this formula may need {bits} bits and at most "
                           f"{MAX_BITS} are allowed; lower its powers or round its numbers")
    if terms > MAX_TERMS:
        raise RefusedError(f"Multiplied out, this has {terms if terms < 10**9 else 'over 10^9'} "
                           f"terms and at most {MAX_TERMS} are allowed; lower its powers")
    expression = operation(*(a.exact for a in arguments))
    _refuse_unreal_or_unknown(expression)
    # powers of equal bases have been added: their sum is bounded, too
    for factor in sp.Mul.make_args(expression):
        e = factor.exp if factor.is_Pow else sp.Integer(1)
        if e.is_number and abs(e) > MAX_EXPONENT:
            raise RefusedError(f"This is the power {shorten(str(e), 20)} of "
                               f"{shorten(str(factor.base), 30)}, which is not within "
                               f"±{MAX_EXPONENT}; lower it")
    if expression.is_number:
        return numbers.value_of(expression)
    return Value(expression, enclosure=None, bits=bits, level=level, terms=terms)


def _refuse_long_root(base: sp.Expr, exponent: sp.Expr) -> None:
    """Refuse a fractional power of numbers whose exponent has many digits.

    SymPy searches such numbers for powers q, exponent = p/q, in time that grows with their bits and
    with q and the roots inside; numbers with small prime factors are faster.
    """
    # whole powers and square roots are fast
    if not exponent.is_Rational or exponent.q <= 2:
        return
    for factor in sp.Mul.make_args(base):
        if not factor.is_number:
            continue
        roots = [e.exp.q for e in factor.atoms(sp.Pow) if e.exp.is_Rational]
        rationals = [x for x in factor.atoms(sp.Rational) if x not in (1, -1)]
        bits = sum(max(int(x.p).bit_length(), int(x.q).bit_length()) for x in rationals)
        limit = MAX_SMOOTH_ROOT_BITS if all(map(_is_smooth, rationals)) else MAX_ROOT_BITS
        if bits * exponent.q * math.prod(roots) > limit:
            raise RefusedError(f"The exponent {shorten(str(sp.N(exponent, 10)), 20)} of the number "
                               f"{shorten(str(factor), 30)} has too many digits; work the number "
                               "out, or round the exponent")


def _is_smooth(x: sp.Rational) -> bool:
    """Whether numerator and denominator have prime factors below ``_SMALL_PRIMES`` only."""
    cofactor = abs(int(x.p)) * int(x.q)
    for divisor in range(2, _SMALL_PRIMES):
        while cofactor and cofactor % divisor == 0:
            cofactor //= divisor
    return cofactor <= 1


def _refuse_unreal_or_unknown(e: sp.Expr) -> None:
    """Refuse a complex, infinite or undefined expression, and functions that are not in C here."""
    if e.has(sp.I, sp.nan, sp.zoo, sp.oo, sp.S.NegativeInfinity):
        raise RefusedError("This is not a real number for any value of its symbols; write another "
                           "argument")
    unknown = sorted({type(f).__name__ for f in e.atoms(sp.Function) if f.func not in _KNOWN})
    if unknown:
        raise RefusedError(f"This is {shorten(str(e), 40)}, and {unknown[0]} is not known "
                           "here; write it another way")
