"""Arithmetic text: exact values, and a refusal with position and cure for everything else."""

from __future__ import annotations

from fractions import Fraction

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.core.errors import InputError
from gyrospark.generator.parsing.exact_expressions import decimal_digits, parse_expression

SQRT2, SQRT3 = sp.sqrt(2), sp.sqrt(3)


@pytest.mark.parametrize(("text", "value"), [
    ("7", 7), (" 1 /\t3\n", sp.Rational(1, 3)), ("0.25", sp.Rational(1, 4)),
    (".5", sp.Rational(1, 2)), ("5.", 5), ("1e-3", sp.Rational(1, 1000)), ("2.5E+2", 250),
    ("0.1 + 0.2", sp.Rational(3, 10)), ("-2**2", -4), ("2**-1", sp.Rational(1, 2)),
    ("2**3**2", 512), ("8/4/2", 1), ("8-4-2", 2), ("2 - -3", 5), ("-+-2", 2), ("2*-3", -6),
    ("-(1/2 - 1)", sp.Rational(1, 2)), ("0**0", 1), ("sqrt(0)", 0), ("sqrt(8)", 2 * SQRT2),
    ("sqrt(1/4)", sp.Rational(1, 2)), ("2**0.5", SQRT2), ("2**(-3/2)", SQRT2 / 4),
    ("1/4 - sqrt(3)/6", sp.Rational(1, 4) - SQRT3 / 6),
    ("(3 - sqrt(3))/6", sp.Rational(1, 2) - SQRT3 / 6), ("sqrt(3)*sqrt(3)", 3),
    ("sqrt(2)*sqrt(3)", sp.sqrt(6)), ("1/sqrt(2)", SQRT2 / 2),
    ("sqrt(3/28 + sqrt(30)/70)", sp.sqrt(sp.Rational(3, 28) + sp.sqrt(30) / 70)),
    ("(1 + sqrt(2))**-2", (1 + SQRT2) ** -2), ("(1 + sqrt(2))**0", 1),
    ("(1 + sqrt(2))**1", 1 + SQRT2), ("-" * 3999 + "1", -1), ("(" * 50 + "1" + ")" * 50, 1),
    ("2**64**1", 2**64),
])
def test_value(text: str, value: sp.Expr) -> None:
    assert parse_expression(text) == value


HOSTILE = [
    ("", "empty"), (" \n", "empty"), ("1" * 4001, "4001 characters"),
    ("__import__", "__import__ is unknown"), ("__import__('os').system('true')", "meaning"),
    ("sqrt", "no argument"), ("exec(1)", "exec.*unknown"), ("lambda: 1", "meaning"),
    ("nan", "nan.*unknown"), ("inf", "inf.*unknown"), ("I", "I is unknown"), ("x^2", r"'\^'"),
    ("1;2", "meaning"), ("1,5", "cannot follow"), ("sqrt(1,5)", "2 arguments"), ("\x00", "meaning"),
    ("\ud800", "meaning"), ("١", "meaning"), ("1\u00a0", "meaning"), ("(1", "character 1"),
    ("1)", "cannot follow"), ("()", "is missing"), ("sqrt()", "is missing"), ("1+", "is missing"),
    ("*1", "is missing"), ("1 2", "cannot follow"), ("2(3)", "cannot follow"),
    ("1.2.3", "cannot follow"), ("1_000", "cannot follow"), ("0x10", "cannot follow"),
    ("1/0", "divides"), ("1/(1 - 1)", "divides"), ("0**-1", "divides"),
    ("1/(sqrt(2)**2 - 2)", "divides"), ("1/((1 + sqrt(2))**2 - 3 - 2*sqrt(2))", "from zero"),
    ("((1 + sqrt(2))**2 - 3 - 2*sqrt(2))**-1", "from zero"), ("sqrt(-1)", "negative"),
    ("(-8)**0.5", "negative"), ("sqrt(1 - sqrt(2))", "negative"),
    ("sqrt((1 + sqrt(2))**2 - 3 - 2*sqrt(2))", "from zero"), ("8**(1/3)", "half-integer"),
    ("2**65", "half-integer"), ("2**sqrt(2)", "half-integer"), ("2**64**64**64", "half-integer"),
    ("((((2**64)**64)**64)**64)**64", "bits"), ("(" * 3000, "nested deeper"),
    ("(" * 51 + "1" + ")" * 51, "nested deeper"), ("sqrt(" * 51 + "1" + ")" * 51, "nested deeper"),
    ("2**" * 60 + "1", "nested deeper"), ("9" * 101, "101 digits"), ("1e401", "decimal exponent"),
    ("1e-401", "decimal exponent"), ("1e" + "9" * 3000, "decimal exponent"),
    ("*".join(["1e400"] * 600), "bits"),
    ("+".join(f"1/{n}" for n in range(10**6 + 1, 10**6 + 390)), "bits"),
    ("sqrt(" + "9" * 100 + ")", "under a root"),
    ("1+sqrt(2)*(1+sqrt(3)*(" * 24 + "sqrt(5)" + "))" * 24, "inside"),
    ("sqrt(1+" * 40 + "1" + ")" * 40, "inside"),
    ("+".join(f"sqrt({p})" for p in sp.primerange(600)), "100 different radicals"),
    ("*".join(f"sqrt({p})" for p in sp.primerange(600)), "100 different radicals"),
    ("*".join(["sqrt(99999999999999999999999999999999999999)"] * 80), "product"),
    ("(" * 8 + "1+sqrt(2)" + ")**64" * 8, "bits"),
]


@pytest.mark.parametrize(("text", "reason"), HOSTILE)
def test_refused(text: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason) as caught:
        parse_expression(text)
    message = str(caught.value)
    assert len(message) < 400
    assert message.endswith(".")
    message.encode()  # printable anywhere, lone surrogates included


@pytest.mark.parametrize(
    ("text", "position"),
    [("1 + foo", 5), ("1/0", 2), ("(1", 3), ("2 $ 3", 3), ("1 + sqrt(-1)", 5), ("1 + 1e999", 5)],
)
def test_position_counts_from_1(text: str, position: int) -> None:
    with pytest.raises(InputError, match=rf"\(character {position}, "):
        parse_expression(text)


def test_names() -> None:
    x = sp.Symbol("x")
    names = {"x": x, "half": sp.Rational(1, 2), "pi": sp.pi, "zero": x - x}
    assert parse_expression("half*x**2 - sqrt(x)", names) == x**2 / 2 - sp.sqrt(x)
    assert parse_expression("1/(x + 1)", names) == 1 / (x + 1)
    assert parse_expression("2*pi", names) == 2 * sp.pi
    with pytest.raises(InputError, match="negative"):
        parse_expression("sqrt(3 - pi)", names)
    with pytest.raises(InputError, match="divides"):
        parse_expression("1/zero", names)
    with pytest.raises(InputError, match=r"half, pi, x, zero, sqrt\(…\)"):
        parse_expression("y", names)


def test_one_limit_on_radicals_for_several_texts() -> None:
    met: set[sp.Expr] = set()
    for p in sp.primerange(500):
        parse_expression(f"1/2 - sqrt({p})", radicals=met)
    assert met == {sp.sqrt(p) for p in sp.primerange(500)}
    for p in (503, 509, 521, 523, 541):
        parse_expression(f"sqrt({p})", radicals=met)
    with pytest.raises(InputError, match="decimals"):
        parse_expression("sqrt(547)", radicals=met)


@pytest.mark.parametrize(("text", "digits"), [
    ("1/3", None), ("sqrt(3)/6", None), ("0.25", None), ("0.12345678", None),
    ("0.5000000000000000", None), ("1e3", None), ("0e-300", None), ("0.123456789", 9),
    ("0.12345678900", 11), ("0.21132486540519", 14), ("2.1132486540519e-1", 14),
    ("0.5*0.2113248654 - 0.123456789012", 10), ("1e-17", 17),
])
def test_digits(text: str, digits: int | None) -> None:
    assert decimal_digits(text, 8) == digits


def test_digits_without_an_exemption() -> None:
    assert decimal_digits("0.25 + 1/2") == 2
    assert decimal_digits("1/2") is None


@st.composite
def expressions(draw: st.DrawFn, depth: int = 3) -> tuple[str, sp.Expr | None]:
    """Draw a text with its value by SymPy's own operators; None if that divides by zero."""
    kind = draw(st.sampled_from("n" if depth == 0 else "nsabmdp"))
    if kind == "n":
        number = draw(st.fractions(0, 9, max_denominator=9))
        return f"({number})", sp.Rational(number.numerator, number.denominator)
    if kind == "s":
        radicand = draw(st.integers(0, 30))
        return f"sqrt({radicand})", sp.sqrt(radicand)
    left, a = draw(expressions(depth=depth - 1))
    if kind == "p":
        power = draw(st.integers(0, 3))
        return f"({left})**{power}", None if a is None else a**power
    right, b = draw(expressions(depth=depth - 1))
    sign = {"a": "+", "b": "-", "m": "*", "d": "/"}[kind]
    text = f"({left}){sign}({right})"
    if a is None or b is None or (kind == "d" and sp.expand(b) == 0):
        return text, None
    return text, {"+": a + b, "-": a - b, "*": a * b}[sign] if kind != "d" else a / b


@given(expressions())
@settings(max_examples=25)
def test_agrees_with_operators(drawn: tuple[str, sp.Expr | None]) -> None:
    text, value = drawn
    if value is None:
        with pytest.raises(InputError, match="divides by"):
            parse_expression(text)
    else:
        assert sp.expand(parse_expression(text) - value) == 0


@given(st.fractions())
@settings(max_examples=30)
def test_reads_fractions(number: Fraction) -> None:
    assert parse_expression(str(number)) == sp.Rational(number.numerator, number.denominator)


@given(st.decimals(allow_nan=False, allow_infinity=False, places=12, min_value=-99, max_value=99))
@settings(max_examples=30)
def test_reads_decimals_exactly(number: object) -> None:
    exact = Fraction(str(number))
    assert parse_expression(str(number)) == sp.Rational(exact.numerator, exact.denominator)
