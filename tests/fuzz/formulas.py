"""Formulas as text: grown by the grammar, changed, or anything."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

from gyrospark.core.errors import InputError
from gyrospark.generator.models.formulas import FUNCTIONS, parse_formula, parse_number
from gyrospark.generator.parsing.exact_expressions import parse_expression

from .choices import Choices
from .judging import refuse_unless_sentence
from .mutations import changed_text

NUMBERS = ("0", "1", "2", "3", "1/2", "0.1", "1e-3", "64", "65", "1e400", "1e-400", "9.81", "5e307",
           "1e9999", "0x10", "1_000", "12345678901234567890", "0.33333333333333333", ".5", "1.",
           "1e")
NAMES = ("x", "y", "m", "k", "pi", "t", "q0", "__import__", "lambda", "E", "I", "nan")
SIGNS = ("<", "<=", ">", ">=", "==", "!=")
WORDS = (*NUMBERS, *NAMES, *FUNCTIONS, "+", "-", "*", "/", "**", "(", ")", ",", "^", "//", ";",
         *SIGNS, "and", "or", "=")
SEEDS = (
    "3/2*m/k**3*(x**2 + y**2)", "sqrt(x**2 + y**2 - 2*x*y) - k", "atan2(x, -y)", "-2**2", "2**3**2",
    "m*9.81*x*sin(y)", "exp(-x**2)*tanh(k)", "(x + y + 1)**9", "1/(1 + 1/(1 + 1/x))", "pi/6",
    "(1/4 + sqrt(3)/6)*sqrt(2 + sqrt(5))", "x**k + m**(-k/2)", "acos(x)*log(1 + y**2)",
    "if(x < -k, m*(x + k)**2, if(x < k, 0, m*(x - k)**2))", "max(0, sqrt(x**2 + y**2) - k)**2",
    "if(0 < t < 1 or x == y and y != 2, min(x, y, 1), mod(t, 2))", "abs(x)*x*heaviside(floor(y))",
)


def grown(choices: Choices, names: Sequence[str], depth: int = 4) -> str:
    """Return a text of the grammar, rarely long."""
    kind = choices.below(10 if depth else 2)
    if kind == 0:
        return choices.pick(NUMBERS[:8] if choices.below(8) else NUMBERS)
    if kind in (1, 2):
        return choices.pick(names)
    a = grown(choices, names, depth - 1)
    if kind == 3:
        function = choices.pick(tuple(FUNCTIONS))
        count = abs(FUNCTIONS[function][1]) + choices.below(2) * (FUNCTIONS[function][1] < 0)
        if function == "if":
            a = f"{a} {choices.pick(SIGNS)} {grown(choices, names, depth - 1)}"
        further_arguments = "".join(f", {grown(choices, names, depth - 1)}"
                                    for _ in range(count - 1))
        return f"{function}({a}{further_arguments})"
    if kind == 4:
        return f"-({a})"
    if kind == 5:
        return f"({a})**{choices.pick(('2', '3', '-1', '(1/2)', '9', '64', 'k', '(-k)', '0'))}"
    return f"({a}) {'+-*/'[kind - 6]} ({grown(choices, names, depth - 1)})"


def formula(choices: Choices, names: Sequence[str] = NAMES) -> str:
    """Return a formula, good or bad."""
    kind = choices.below(4)
    if kind == 0:
        return changed_text(choices.pick(SEEDS), choices, WORDS)
    if kind == 1:
        return changed_text(grown(choices, names), choices, WORDS)
    if kind == 2:
        return grown(choices, names)
    return "".join(choices.pick(WORDS) for _ in range(choices.below(40)))


@cache
def symbols() -> dict[str, Any]:
    import sympy as sp

    return {name: sp.Symbol(name, real=True) for name in ("x", "y", "m", "k", "q0", "t")}


def check(data: bytes) -> str:
    """Read one text as a formula, as a number of a model file, and as a tableau's entry."""
    choices = Choices(data)
    kind = choices.below(6)
    text = (choices.rest().decode("utf-8", "surrogateescape") if choices.one_in(4)
            else formula(choices))
    names = symbols()
    try:
        if kind < 3:
            parse_formula(text, names, frozenset([names["k"], names["m"]]))
        elif kind < 5:
            parse_number(text, {"k": 2.5})
        else:
            parse_expression(text)
    except InputError as error:
        refuse_unless_sentence(error)
        return "refused"
    return "accepted"
