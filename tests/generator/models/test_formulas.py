"""Formulas of model files: their values, against SymPy's own operators, and refusals."""

from __future__ import annotations

import math

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.core.errors import InputError
from gyrospark.generator.models.formulas import FUNCTIONS, parse_formula, parse_number
from gyrospark.generator.symbolic.switching_functions import Max, Min, Where

x, y = sp.symbols("x y", real=True)
k = sp.Symbol("k", real=True)
NAMES = {"x": x, "y": y, "k": k}
Q = sp.Rational


def read(text: str) -> sp.Expr:
    return parse_formula(text, NAMES, frozenset([k]))


@pytest.mark.parametrize(("text", "value"), [
    ("x**2 + 0.1*y", x**2 + Q(1, 10) * y), ("-x**2", -(x**2)), ("x**-1", 1 / x),
    ("x**(3/2)", x ** Q(3, 2)), ("x**0.25", x ** Q(1, 4)), ("x**k", x**k),
    ("(12*x)**0.7777", (12 * x) ** Q(7777, 10000)), ("2**(k + 1)", 2 ** (k + 1)),
    ("pi*x", sp.pi * x), ("sin(pi/6)", Q(1, 2)), ("sqrt(2)*x", sp.sqrt(2) * x),
    ("sqrt(1 + x**2)", sp.sqrt(1 + x**2)), ("exp(x)*log(y)", sp.exp(x) * sp.log(y)),
    ("tan(x) + asin(x) + acos(x)", sp.tan(x) + sp.asin(x) + sp.acos(x)),
    ("atan(x) + atan2(y, x)", sp.atan(x) + sp.atan2(y, x)),
    ("sinh(x)*cosh(y)/tanh(x*y)", sp.sinh(x) * sp.cosh(y) / sp.tanh(x * y)),
    ("1.5e-3*x", Q(3, 2000) * x), ("x - x + 1", sp.Integer(1)),
    ("abs(x)*x + sqrt(x**2)", x * sp.Abs(x) + sp.Abs(x)),
    ("max(0, x, y - 1)**2", Max(Max(0, x), y - 1) ** 2),
    ("min(max(x, -1), 1)", Min(Max(x, -1), 1)), ("sign(x)*floor(y)", sp.sign(x) * sp.floor(y)),
    ("mod(x, 2)", x - 2 * sp.floor(x / 2)),
    ("heaviside(x)", Where(x, 0, 0, Where(0, x, 1, Q(1, 2)))),
    ("if(x < 0, x**2, 2*x**2)", Where(x, 0, x**2, 2 * x**2)),
    ("if(x >= y, 1, if(k == 0, x, y))", Where(
        x, y, Where(0, Where(k, 0, 0, 1) * Where(0, k, 0, 1), x, y), 1)),
    ("if(0 < x <= 1, k, 0)", Where(0, Where(0, x, 1, 0) * Where(1, x, 0, 1), k, 0)),
    ("if(x < 0 or y < 0 and x < 9, 1, 2)", Where(0, Where(x, 0, 0, 1) * Where(
        0, Where(x, 9, 1, 0) * Where(y, 0, 1, 0), 0, 1), 2, 1)),
    ("if(k > 0, 1/k, 0)*x", x * Where(0, k, 1 / k, 0)),
    ("if(pi < 3.15 and 2 != 3, x, 1/0*y)".replace("1/0", "5"), x),
    ("if(1 > 2 or x < 1, x, y)", Where(x, 1, x, y)),
    ("max(pi, 3)*abs(-2) + mod(-7, 3) + floor(-pi) + heaviside(0)*x",
     2 * sp.pi + 2 - 4 + x / 2),
    ("(x + y)**64", (x + y) ** 64),
    ("sin(" * 5 + "x" + ")" * 5, sp.sin(sp.sin(sp.sin(sp.sin(sp.sin(x)))))),
])
def test_formula(text: str, value: sp.Expr) -> None:
    assert read(text) == value


REFUSED = [
    ("", "empty"), ("x.y", "meaning"), ("x^2", r"write \*\*"), ("__import__('os')", "meaning"),
    ("__class__", "__class__ is unknown"), ("x.__class__", "meaning"), ("eval(x)", "eval.*unknown"),
    ("gamma(x)", "gamma.*unknown"), ("Abs(x)", "Abs.*unknown"), ("max(x)", "2 or more"),
    ("abs(x, y)", "2 arguments"), ("x < 1", "condition"), ("max(x < 1, 2)", "condition"),
    ("if", "no argument"), ("if(x, 1, 2)", "comparison"), ("if(x < 1, 2)", "2 arguments"),
    ("if(x < 1, 2, 3, 4)", "4 arguments"), ("if(x = 1, 2, 3)", "write == for"),
    ("if(x < 1 and, 2, 3)", "is missing"), ("if(x < 1 and y, 2, 3)", "comparison"),
    ("if((x < 1), 2, 3)", "condition"), ("if(x < 1, 1/0, 3)", "divides"),
    ("if(x < y, x, sqrt(-x**2))", "real number"),
    ("min(sqrt(2), 1.414213562373095048801688724209698078569671875376948073176679737990732478462107"
     "038850387534327641572)", "90 digits"),
    ("floor(1e95*pi)", "whole number"), ("mod(x, 0)", "divides"),
    ("abs(abs(abs(abs(abs(abs(x - 1) - 1) - 1) - 1) - 1) - 1)", "inside"),
    ("if(x < 1, 1, " * 60 + "0" + ")" * 60, "nested deeper"), ("sin", "no argument"),
    ("sin()", "is missing"), ("sin(x, y)", "2 arguments"), ("atan2(x)", "1 argument"),
    ("x, y", "cannot follow"), ("nan", "unknown"), ("inf*x", "unknown"), ("I*x", "unknown"),
    ("x/0", "divides"), ("x/(y - y)", "divides"), ("sqrt(-1)", "negative"),
    ("log(0)", "real number"), ("log(-1)*x", "real number"), ("asin(2)", "real number"),
    ("tan(pi/2)", "real number"), ("atan2(0, 0)", "real number"), ("exp(1000)", "moderate"),
    ("exp(1e9)", "not within ±1000"), ("exp(exp(exp(9)))", "within|moderate"),
    ("sqrt(-x**2)", "real number"), ("sqrt(-x**2)*abs(x)", "real number"), ("x**y", "depends on y"),
    ("(-2)**k", "power k"), ("(-8)**(1/3)", "power 1/3"), ("x**65", "not within ±64"),
    ("x**10**9", "not within ±64"), ("2**2**2**2**2**2", "not within ±64"),
    ("x**-1e300", "not within ±64"), ("(x**8)**9", "power 72 of x"),
    ("((((x*3)**8)**8)**8)**8", "not within ±64"), ("((1e99*x + y)**64)**64", "bits"),
    ("(x + y + k + 1)**64", "47905 terms"), ("((x + y)**9 + k)**9*(x + 1)**64", "terms"),
    ("1e400*x", "double"), ("(x + (x + (x + 1)**k)**k)**k", "inside"),
    ("1/(x + 1/(" * 5 + "x" + "))" * 5, "inside"), ("(" * 60 + "x" + ")" * 60, "nested deeper"),
    ("x+" * 2000 + "x", "4001 characters"), ("((12*k)*90.777*12)**0.7777", "digits"),
    ("(30259*x)**0.997", "digits"), ("9" * 101, "101 digits"),
]


@pytest.mark.parametrize(("text", "reason"), REFUSED)
def test_refused_at_once(text: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason) as caught:
        read(text)
    message = str(caught.value)
    assert len(message) < 1000
    assert message.endswith(".")


@pytest.mark.parametrize(("text", "position"), [("x + foo", 5), ("x**65", 2), ("x*log(0)", 3),
                                                ("sin(x) $", 8), ("2*sqrt(-x**2)", 3)])
def test_position_counts_from_1(text: str, position: int) -> None:
    with pytest.raises(InputError, match=rf"\(character {position}, "):
        read(text)


def test_numbers() -> None:
    assert parse_number("40*pi") == 40 * math.pi
    assert parse_number("2*r", {"r": 0.1}) == 0.2
    assert parse_number("1e-3") == 1e-3
    assert parse_number("max(2, 3*r) + if(r < 3, abs(-r), 0)", {"r": 2}) == 8
    with pytest.raises(InputError, match="x is unknown"):
        parse_number("x")


UNARY = ["abs", "sign", "floor", "heaviside",
         "sqrt", "exp", "log", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh"]


@st.composite
def formulas(draw: st.DrawFn, depth: int = 3) -> tuple[str, sp.Expr]:
    """Draw a text with its value by SymPy's own operators; infinities may be among them."""
    kind = draw(st.sampled_from("nx" if depth == 0 else "nxfabmdp"))
    if kind == "n":
        number = draw(st.fractions(-9, 9, max_denominator=9))
        return f"({number})", Q(number.numerator, number.denominator)
    if kind == "x":
        name = draw(st.sampled_from(sorted(NAMES)))
        return name, NAMES[name]
    left, a = draw(formulas(depth=depth - 1))
    if kind == "f":
        name = draw(st.sampled_from(UNARY))
        return f"{name}({left})", FUNCTIONS[name][0](a)
    if kind == "p":
        power = draw(st.sampled_from([0, 1, 2, 3, -1, -2, Q(1, 2), Q(3, 2)]))
        return f"({left})**({power})", a**power
    right, b = draw(formulas(depth=depth - 1))
    sign = {"a": "+", "b": "-", "m": "*", "d": "/"}[kind]
    value = {"a": a + b, "b": a - b, "m": a * b}.get(kind)
    return f"({left}){sign}({right})", a / b if value is None else value


@given(formulas())
@settings(max_examples=30)
def test_agrees_with_operators(drawn: tuple[str, sp.Expr]) -> None:
    text, value = drawn
    try:
        expression = read(text)
    except InputError:
        return
    point = {x: Q(7, 10), y: Q(3, 7), k: Q(6, 5)}
    assert not expression.has(sp.nan, sp.zoo, sp.oo, sp.I)
    difference = sp.N((expression - value).xreplace(point), 40)
    assert expression == value or abs(difference) < sp.Float("1e-30")
