"""Expressions as C: the emitted statements, read and run by an interpreter of this file's own.

The interpreter knows the four operations, calls and subscripts, in any type of number. In rational
numbers it compares the C with SymPy exactly; only roots, powers and functions need tolerances.
"""

import ast
import math
import random
import re
from collections import Counter
from fractions import Fraction
from functools import cache
from itertools import chain

import mpmath
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.core.errors import InputError
from gyrospark.core.real_types import REALS
from gyrospark.generator.kernels.c_printer import CPrinter
from gyrospark.generator.kernels.kernel import Constants, emit_kernel, wrap
from gyrospark.generator.kernels.statements import Kernel
from gyrospark.generator.multibody.rigid_body import heavy_top
from gyrospark.generator.schemes.step_equations import (
    MeanScheme,
    SparkScheme,
    common_kernels,
    hoist_constants,
)
from gyrospark.generator.symbolic.switching_functions import Max, Min, Where
from gyrospark.generator.systems.system import System
from gyrospark.generator.tableaux.families import gauss_lobatto

DOUBLE = REALS["double"]
QUARTER, THIRD, HALF = sp.Rational(1, 4), sp.Rational(1, 3), sp.Rational(1, 2)
x, y, z = sp.symbols("x y z", positive=True)
q, p = sp.symbols("q0:4", real=True), sp.symbols("p0:4", real=True)

# ---------------------------------------------------------------- an interpreter of the emitted C

STATEMENT = re.compile(
    r"(?:const (?P<type>float|double|long double|_Float128) (?P<name>[a-z]\w*)"
    r"|(?P<target>\w+(?:\[\d+\]){1,2})|(?P<returned>return)) ?=? ?(?P<value>[^=;]+);"
)
#: Sums in twice the working precision; the interpreter adds the products exactly.
ADD_PRODUCT = re.compile(
    r"\{ const (?:float|double|long double|_Float128) factors\[\] = \{ (.*) \}; "
    r"add_product\(sum, (\d+), factors\); \}")
ALLOWED = re.compile(r"[\w\s.,+*/()\[\]-]*")
LITERAL = re.compile(r"(?<![\w.\]])(\d[\d.]*(?:e[+-]?\d+)?)(F128|[fL]?)(?![\w.\]])")
MATH = ("sqrt", "pow", "sin", "cos", "tan", "exp", "log")
OPERATIONS = {ast.Add: "add", ast.Sub: "add", ast.Mult: "mul", ast.Div: "div"}


def python_name(text):
    """Return C text with c->k and the array lambda as names that Python can have."""
    return re.sub(r"\blambda\b", "lambda_", text.replace("->", "__"))


class Interpreter:
    """Runs statements of C in numbers of a given type, and counts their operations."""

    def __init__(self, number, values, suffix=""):
        self.number = number
        self.values = {python_name(name): value for name, value in values.items()}
        self.suffix = suffix
        self.operations = Counter()

    def run(self, lines):
        for line in lines:
            text = re.sub(r"\s+", " ", line)
            if self.add_up(text):
                continue
            statement = STATEMENT.fullmatch(text)
            assert statement, line
            value = self.evaluate(statement["value"])
            name = statement["name"] or statement["target"] or "return"
            assert name not in self.values, f"{name} is assigned twice"
            self.values[name] = value
        return self.values

    def add_up(self, text):
        """Run a statement of a compensated sum; return whether it is one."""
        if re.fullmatch(r"(float|double|long double|_Float128) sum\[2\];", text):
            return True
        if text in ("sum[0] = 0;", "sum[1] = 0;"):
            self.total = self.number(0)
            return True
        counted = self.operations.copy()
        if product := ADD_PRODUCT.fullmatch(text):
            factors = re.split(r", (?![^(]*\))", product[1])
            assert len(factors) == int(product[2]), text
            self.total += math.prod(map(self.evaluate, factors))
            self.operations = counted + Counter(product=1)
        elif ends := re.fullmatch(r"(\w+\[\d+\]) = sum\[0\] \+ sum\[1\];", text):
            assert ends[1] not in self.values
            self.values[ends[1]] = self.total
        return bool(product or ends)

    def evaluate(self, text):
        text = python_name(text)
        assert ALLOWED.fullmatch(text), text
        assert "--" not in text, "two signs in a row are a decrement in C"
        assert "++" not in text, "two signs in a row are an increment in C"
        assert "**" not in text
        assert "//" not in text
        self.literals = []

        def keep(match):
            assert match[2] == self.suffix, f"{match[0]} is no literal of this type"
            assert "." in match[1] or "e" in match[1], f"{match[0]} is an integer of C"
            self.literals.append(match[1])
            return f"literal({len(self.literals) - 1})"

        subscripts = re.split(r"(\[\d+\])", text)
        safe = "".join(piece if piece.startswith("[") else LITERAL.sub(keep, piece)
                       for piece in subscripts)
        return self.visit(ast.parse(safe.strip(), mode="eval").body)

    def visit(self, node):
        if isinstance(node, ast.BinOp):
            left, right = self.visit(node.left), self.visit(node.right)
            if not (isinstance(node.op, ast.Div) and is_literal(node.left)
                    and is_literal(node.right)):  # 1.0/3.0 is a constant
                self.operations[OPERATIONS[type(node.op)]] += 1
            return {"Add": left.__add__, "Sub": left.__sub__, "Mult": left.__mul__,
                    "Div": left.__truediv__}[type(node.op).__name__](right)
        if isinstance(node, ast.UnaryOp):
            assert isinstance(node.op, ast.USub)
            return -self.visit(node.operand)
        if isinstance(node, ast.Call):
            if node.func.id == "literal":
                return self.number(self.literals[node.args[0].value])
            name = node.func.id.removesuffix(self.suffix.lower()) if self.suffix else node.func.id
            assert name in MATH
            self.operations[name] += 1
            return call(self.number, name, [self.visit(a) for a in node.args])
        return self.values[ast.unparse(node)]


def is_literal(node):
    if isinstance(node, ast.UnaryOp):
        node = node.operand
    return isinstance(node, ast.Call) and getattr(node.func, "id", "") == "literal"


def call(number, name, arguments):
    if number is mpmath.mpf:
        return mpmath.power(*arguments) if name == "pow" else getattr(mpmath, name)(*arguments)
    if name == "pow" and arguments[1].denominator == 1:
        return arguments[0] ** int(arguments[1])
    return number(getattr(math, name)(*arguments))


def run_text(text, values, number=Fraction, suffix=""):
    interpreter = Interpreter(number, values, suffix)
    return interpreter.evaluate(text), dict(sorted(interpreter.operations.items()))


def printed(e, real=DOUBLE, names=None):
    printer = CPrinter(real, names or {})
    return printer(e), without_zeros(printer.operations)


def without_zeros(operations):
    return {kind: count for kind, count in sorted(operations.items()) if count}


def run_kernel(kernel, constants, point, real=DOUBLE, number=Fraction):
    """Emit a kernel, run its C; return outputs by C name, counted operations, emitted kernel."""
    emitted = emit_kernel(kernel, constants, real)
    values = {f"c__{symbol}": number_of(definition.xreplace(point), number)
              for definition, symbol in constants.definitions.items()}
    for array, symbols in kernel.inputs.items():
        values |= {f"{array}[{i}]": number_of(point[s], number) for i, s in enumerate(symbols)}
    interpreter = Interpreter(number, values, real.suffix)
    return interpreter.run(emitted.lines), interpreter.operations, emitted


def number_of(value, number):
    if number is mpmath.mpf:
        return mpmath.mpf(str(sp.N(value, 60)))
    return Fraction(int(value.p), int(value.q))


def expected_of(kernel, constants, point):
    """Return the outputs by C name, from SymPy."""
    expressions = {}
    for array, value in kernel.outputs.items():
        if not isinstance(value, list):
            expressions["return"] = value
        for i, row in enumerate(value if isinstance(value, list) else []):
            if isinstance(row, list):
                expressions |= {f"{array}[{i}][{j}]": e for j, e in enumerate(row)}
            else:
                expressions[f"{array}[{i}]"] = row
    return {name: constants.expand_shared(sp.sympify(e)).xreplace(point)
            for name, e in expressions.items()}


def draw_rational(draw):
    return sp.Rational(draw.choice([-1, 1]) * draw.randint(1, 99), draw.randint(1, 99))


def random_point(symbols, seed=5):
    draw = random.Random(seed)
    return {s: abs(v) if s.is_positive else v
            for s, v in zip(symbols, iter(lambda: draw_rational(draw), None), strict=False)}


@cache
def schemes_of(rep):
    reduced, constants = hoist_constants(heavy_top(rep))
    return constants, [
        *common_kernels(reduced),
        *SparkScheme(reduced, gauss_lobatto(1)).kernels(),
        *MeanScheme(reduced, discrete=True).kernels(),
        *MeanScheme(reduced, discrete=False).kernels(),
    ]


def test_the_interpreter_reads_C_as_C_does_and_refuses_what_is_no_double():
    values = {"x": Fraction(2), "a[1][0]": Fraction(3), "c__k": Fraction(5)}
    value, counted = run_text("-x*x + 3.0/c->k/2.5 - (x - a[1][0])*1e-3", values)
    assert value == -4 + Fraction(6, 25) + Fraction(1, 1000)
    assert counted == {"add": 3, "div": 2, "mul": 2}
    for wrong in ("1/3", "x*2", "--x", "2.0f*x", "x ? 1.0 : 2.0", "x**2.0", "__import__('os')"):
        with pytest.raises((AssertionError, KeyError)):
            run_text(wrong, values)


# ---------------------------------------------------------------- the kernels of the heavy top


@cache
def runs_of(rep):
    """Return each kernel of a representation with its C run at a random rational point."""
    constants, kernels = schemes_of(rep)
    runs = []
    for kernel in kernels:
        point = random_point([*constants.parameters, *chain(*kernel.inputs.values())])
        runs.append((kernel, point, *run_kernel(kernel, constants, point)))
    return constants, runs


@pytest.mark.parametrize("rep", [pytest.param("alpha", marks=pytest.mark.slow), "gamma"])
def test_every_kernel_of_the_heavy_top_computes_its_expressions_exactly_and_is_counted(rep):
    constants, runs = runs_of(rep)
    for kernel, point, outputs, _, _ in runs:
        for name, value in expected_of(kernel, constants, point).items():
            assert outputs[name] == Fraction(int(value.p), int(value.q)), (kernel.name, name)
    for kernel, _, _, counted, result in runs_of(rep)[1]:
        assert result.operations == without_zeros(counted), kernel.name
        assert result.temporaries == sum(line.startswith("const ") for line in result.lines)


@pytest.mark.parametrize("rep", ["alpha", "gamma"])
def test_hessian_kernel_copies_the_other_half_instead_of_computing_it(rep):
    constants, kernels = schemes_of(rep)
    (lines,) = [emit_kernel(kernel, constants, DOUBLE).lines for kernel in kernels
                if kernel.name == "hessian"]
    values = dict(re.fullmatch(r"(\S+) = (.*);", re.sub(r"\s+", " ", line)).groups()
                  for line in lines if line.startswith(("H_qq", "H_pp")))
    for array in ("H_qq", "H_pp"):
        for i in range(4):
            for j in range(i):
                lower, upper = values[f"{array}[{i}][{j}]"], values[f"{array}[{j}][{i}]"]
                assert lower in (upper, f"{array}[{j}][{i}]")
                assert not re.search("[-+*/]", lower)


@pytest.mark.parametrize("real", REALS.values(), ids=REALS)
def test_kernels_are_written_in_the_type_asked_for(real):
    constants, kernels = schemes_of("gamma")
    for kernel in kernels[:9]:  # the kernels of the stages
        point = random_point([*constants.parameters, *chain(*kernel.inputs.values())])
        outputs, _, emitted = run_kernel(kernel, constants, point, real)  # asserts the suffixes
        assert all(line.startswith(f"const {real.c_type} ") for line in emitted.lines
                   if line.startswith("const "))
        types = re.findall(r"\b(?:long double|double|float|_Float128)\b", emitted.signature)
        assert set(types) <= {real.c_type}
        assert emitted.returns in ("void", real.c_type)
        assert outputs


# ---------------------------------------------------------------- the printer, case by case

RATIONAL = {
    "negative coefficient": -3 * x, "minus one": -x * y, "minus a sum": -(x + y) * z,
    "negative first": -x + y, "all negative": -x - y - 2, "minus of a difference": x - (y - z) * 2,
    "third": THIRD * x, "minus a third": -x / 3, "third alone": THIRD + x,
    "minus a third alone": x - THIRD, "two thirds": 2 * x / 3, "two thirds below": 2 / (3 * x),
    "five sevenths of a quotient": 5 * x / (7 * y * z), "binary fraction": x * sp.Rational(-5, 8),
    "power of two below": x / 4 + y / 1024, "large integer": 10**7 * x + 12345678, "square": x**2,
    "cube and fourth": x**3 - y**4, "reciprocal": 1 / x, "power -2": x**-2,
    "power -2 of a sum": (x + y) ** -2, "power -1 of a product": 1 / (x * y),
    "quotient": (x + y) / (x - 3 * y), "quotient of powers": x**2 * y**-3 / (z + 1),
    "quotient in a product": z * (x / y) * (1 / (x + y)), "minus below": x / (-y - z),
    "product of sums": (x + y) * (y + z) * (z - x),
    "power of a product of sums": ((x - y) * (y + 2 * z)) ** 2, "nested": 1 / (1 + 1 / (1 + 1 / x)),
    "symbol": x, "zero": sp.Integer(0), "minus two": sp.Integer(-2),
    "thirds only": sp.Rational(-7, 3),
}
IRRATIONAL = {
    "power 5": x**5, "power -5": x**-5, "power 5 of a sum": (x + y) ** 5, "root": sp.sqrt(x),
    "root of a sum": sp.sqrt(x + 2 * y), "power 3/2": x ** sp.Rational(3, 2),
    "power 3/2 of a sum": (x + y) ** sp.Rational(3, 2),
    "power 5/2 of a sum": -(x + y) ** sp.Rational(5, 2), "power -1/2": 1 / sp.sqrt(x),
    "power -3/2": y * (x**2 + y) ** sp.Rational(-3, 2), "power 11/2": x ** sp.Rational(11, 2),
    "fourth roots": (x + y) ** QUARTER + y * (x + y) ** -(3 * QUARTER) - sp.sqrt(x + y),
    "power 3/4": x ** (3 * QUARTER), "cube root": x**THIRD, "power -1/3": z * (x + y) ** -THIRD,
    "symbol as exponent": x**y + 2**-x, "root of two": sp.sqrt(2) * x + sp.sqrt(2) / 3,
    "pi": sp.pi * x - sp.pi, "e": sp.E * x, "sine": sp.sin(x + y) ** 2,
    "cosine below": -1 / sp.cos(x), "tangent and logarithm": sp.tan(x) * sp.log(1 + y),
    "exponential": sp.exp(-x * y / 3), "golden ratio": sp.GoldenRatio * x,
    "nested functions": sp.exp(sp.sin(sp.sqrt(x)) - 1 / y),
}
CASES = RATIONAL | IRRATIONAL
POINT = {x: sp.Rational(7, 5), y: sp.Rational(3, 11), z: sp.Rational(2, 9)}


@pytest.mark.parametrize("e", [pytest.param(e, id=name) for name, e in CASES.items()])
def test_values_and_counted_operations_are_those_of_the_expression(e):
    """Values agree to the digits of a literal where a number is rounded to one, else to 45."""
    kernel = Kernel("f", "", {"v": [x, y, z]}, {"f": e})
    with mpmath.workdps(50):
        outputs, counted, emitted = run_kernel(kernel, Constants(()), POINT, number=mpmath.mpf)
        value = mpmath.mpf(str(sp.N(e.xreplace(POINT), 50)))
        rounded_constants = e.has(sp.pi, sp.E, sp.GoldenRatio, sp.sqrt(2))
        relative = mpmath.mpf("4e-16" if rounded_constants else "1e-45")
        assert abs(outputs["return"] - value) <= relative * (1 + abs(value))
    assert without_zeros(emitted.operations) == without_zeros(counted)


@pytest.mark.parametrize(("e", "text", "operations"), [
    (x, "x", {}), (2 * x + y, "y + 2.0*x", {"add": 1, "mul": 1}),
    (x**2 * y, "y*x*x", {"mul": 2}), (x**4, "x*x*x*x", {"mul": 3}),
    (x**-2, "1.0/(x*x)", {"div": 1, "mul": 1}), (x / 3, "x/3.0", {"div": 1}),
    (x / (3 * y), "x/(3.0*y)", {"div": 1, "mul": 1}), (-x / 4, "-0.25*x", {"mul": 1}),
    (x - y - z, "x - y - z", {"add": 2}), (sp.sqrt(x) / y, "sqrt(x)/y", {"div": 1, "sqrt": 1}),
    (x ** sp.Rational(3, 2), "x*sqrt(x)", {"mul": 1, "sqrt": 1}),
    (x**5, "(x*x)*(x*x)*x", {"mul": 4}), (x**17, "pow(x, 17.0)", {"pow": 1}),
    (x**THIRD, "pow(x, 1.0/3.0)", {"pow": 1}),
    (sp.sin(x) * sp.exp(y), "exp(y)*sin(x)", {"exp": 1, "mul": 1, "sin": 1}),
])
def test_text_and_operations_of_small_expressions(e, text, operations):
    assert printed(e) == (text, operations)


@pytest.mark.parametrize(
    ("real", "text"),
    [("float", "0.5f*a->x*sinf(sqrtf(y))/3.0f"), ("double", "0.5*a->x*sin(sqrt(y))/3.0"),
     ("long-double", "0.5L*a->x*sinl(sqrtl(y))/3.0L"),
     ("float128", "0.5F128*a->x*sinf128(sqrtf128(y))/3.0F128")],
)
def test_names_suffixes_and_literals_of_each_type(real, text):
    e = sp.Mul(HALF, x, sp.sin(sp.sqrt(y)), sp.Pow(3, -1, evaluate=False), evaluate=False)
    assert CPrinter(REALS[real], {x: "a->x"})(e) == text


@pytest.mark.parametrize("number", [
    sp.Rational("0.123456789012345678901"), sp.Rational(10**400 + 7, 3 * 10**400),
    sp.Rational(2**60 + 1, 3**40), -sp.Rational(3**50, 2**70 + 1), sp.Float("0.1", 400),
])
def test_long_fractions_are_rounded_once(number):
    text = CPrinter(REALS["double"], {})(sp.Rational(number))
    # Python divides integers of any length with one rounding
    exact = sp.Rational(number)
    assert float(text) == int(exact.p) / int(exact.q)


@pytest.mark.parametrize(("real", "power"), [
    ("double", 1024), ("float", 128), ("long-double", 16384), ("float128", 16384)])
def test_numbers_beyond_a_type_are_refused(real, power):
    printer, large = CPrinter(REALS[real], {}), sp.Integer(2) ** power
    assert float(printer(1 / (large**2 * 2**300)).rstrip("fLF128")) == 0
    assert printer(large / 2)
    for e in (large, -large, sp.sqrt(2) * large, sp.exp(sp.Integer(power))):
        with pytest.raises(InputError, match=f"{real}.*wider"):
            printer(e)


@pytest.mark.parametrize(("real", "low", "tiny"), [
    ("double", 310, 400), ("float", 40, 60), ("long-double", 4940, 5000), ("float128", 4940, 5000)])
def test_factors_below_a_type_are_rounded_once(real, low, tiny):
    """1/10^n is a subnormal number, or 0, though 10^n is beyond the type."""
    printer = CPrinter(REALS[real], {})
    for factor in (1, 7):  # one rule for 1/10^n and 7/10^n
        literal = printer(factor * x / sp.Integer(10)**tiny).removesuffix("*x")
        assert float(literal.rstrip("fLF128")) == 0
        literal = printer(factor * x / sp.Integer(10)**low).removesuffix("*x")
        value = mpmath.mpf(literal.removesuffix("F128").rstrip("fL"))
        # subnormal numbers near 2^bits smallest ones have some bits left
        assert abs(value * mpmath.mpf(10)**low / factor - 1) < 1e-4


@pytest.mark.parametrize("name", ["fourth roots", "power 3/4"])
def test_fourth_roots_are_square_roots_of_square_roots(name):
    kernel = Kernel("f", "", {"v": [x, y, z]}, {"f": IRRATIONAL[name]})
    emitted = emit_kernel(kernel, Constants(()), REALS["double"])
    assert "sqrt" in emitted.operations
    assert "pow" not in emitted.operations


def test_two_signs_never_meet():
    root = sp.Symbol("r", real=True)
    assert "--" not in printed(-((-root) ** 3))[0]
    assert "--" not in printed(x - (-2 * y))[0]
    assert "--" not in printed(-sp.Mul(-1, x, evaluate=False))[0]
    r = sp.Symbol("r", real=True)
    assert "--" not in printed(-((-r) ** sp.Rational(3, 2)))[0]


@pytest.mark.parametrize(("e", "text"), [
    (sp.Abs(y - x), "fabs(x - y)"), (sp.sign(q[0]), "sign(q0)"), (sp.floor(x / 2), "floor(0.5*x)"),
    (Max(x, y), "maximum(x, y)"), (Min(1, x), "minimum(1.0, x)"),
    (Where(x, y, x**2, 0), "choose(x, y, x*x, 0.0)"),
])
def test_functions_with_two_sides(e, text):
    assert printed(e)[0] == text
    assert CPrinter(REALS["double"], {}, "lanes_")(Max(x, 1)) == "lanes_maximum(splat(1.0), x)"


@pytest.mark.parametrize("e", [sp.erf(x), sp.Max(x, y), sp.Function("f")(x)])
def test_function_without_a_C_name_is_refused(e):
    with pytest.raises(InputError, match=f"'{e.func.__name__}'"):
        printed(e)


@pytest.mark.parametrize(("e", "number"), [
    (sp.I * x, "ImaginaryUnit"), (sp.oo * sp.I, "Infinity"), (sp.zoo, "ComplexInfinity"),
    (sp.nan, "NaN"), (x + sp.I, "ImaginaryUnit")])
def test_number_that_is_not_real_and_finite_is_refused(e, number):
    with pytest.raises(InputError, match=f"'{number}'"):
        printed(e)


LEAVES = st.sampled_from([x, y, z, sp.Integer(2), sp.Integer(-3), THIRD, -HALF, sp.Rational(5, 7)])


def grow(children):
    pairs = st.tuples(children, children)
    return st.one_of(
        pairs.map(lambda t: t[0] + t[1]),
        pairs.map(lambda t: t[0] - t[1]),
        pairs.map(lambda t: t[0] * t[1]),
        pairs.map(lambda t: t[0] / (1 + t[1] ** 2)),
        st.tuples(children, st.sampled_from([2, 3, 4])).map(lambda t: t[0] ** t[1]),
        children.map(lambda e: (2 + e**2) ** -3),
    )


def numbers_are_short(e):
    """Return whether every integer in e is a double; longer ones are rounded when printed."""
    return all(max(abs(n.p), n.q) < 2**53 for n in e.atoms(sp.Rational))


EXPRESSIONS = st.recursive(LEAVES, grow, max_leaves=8).filter(numbers_are_short)


@settings(max_examples=10, derandomize=True)
@given(st.lists(EXPRESSIONS, min_size=1, max_size=4))
def test_kernels_of_random_expressions_are_exact_and_counted(expressions):
    constants = Constants((z,))
    kernel = Kernel("f", "", {"v": [x, y]}, {"f": [constants.hoist(e) for e in expressions]})
    outputs, counted, emitted = run_kernel(kernel, constants, POINT)
    for name, value in expected_of(kernel, constants, POINT).items():
        assert outputs[name] == Fraction(int(value.p), int(value.q))
    assert without_zeros(emitted.operations) == without_zeros(counted)


POLYNOMIALS = st.recursive(
    st.sampled_from([x, y, z, sp.Integer(1), sp.Integer(-3), -HALF]),
    lambda children: st.tuples(children, children).flatmap(
        lambda t: st.sampled_from([t[0] + t[1], t[0] - t[1], t[0] * t[1], t[0] ** 2])),
    max_leaves=8,
)


@settings(max_examples=20, derandomize=True)
@given(st.lists(POLYNOMIALS, min_size=1, max_size=3))
def test_compensated_kernels_of_random_polynomials_add_up_their_terms(expressions):
    kernel = Kernel("f", "", {"v": [x, y, z]}, {"f": expressions}, compensated=True)
    outputs, counted, emitted = run_kernel(kernel, Constants(()), POINT)
    for name, value in expected_of(kernel, Constants(()), POINT).items():
        assert outputs[name] == Fraction(int(value.p), int(value.q))
    assert emitted.operations == without_zeros(counted)
    assert emitted.operations == {
        "product": sum(len(sp.Add.make_args(sp.expand(e))) for e in expressions)}


@pytest.mark.parametrize("e", [x / y - 1, sp.sqrt(x) - y, THIRD * x - y, sp.exp(x), x**-2 - 1])
def test_compensation_is_left_out_where_the_terms_are_no_exact_products(e):
    kernel = Kernel("f", "", {"v": [x, y]}, {"f": [e]}, compensated=True)
    plain = Kernel("f", "", {"v": [x, y]}, {"f": [e]})
    assert emit_kernel(kernel, Constants(()), DOUBLE) == emit_kernel(plain, Constants(()), DOUBLE)


# ---------------------------------------------------------------- kernels, piece by piece


def test_common_subexpressions_are_computed_once_and_equal_outputs_copied():
    e = (x + y) ** 2 + (x + y) ** 3 * z
    emitted = emit_kernel(Kernel("f", "", {"v": [x, y, z]}, {"f": e}), Constants(()), DOUBLE)
    assert sum("v[0] + v[1]" in line for line in emitted.lines) == 1
    assert emitted.operations["add"] == 2
    e = x * y + 1
    kernel = Kernel("f", "", {"v": [x, y]}, {"f": [e, e], "g": [[e, x], [x, e]]})
    outputs, _, emitted = run_kernel(kernel, Constants(()), POINT)
    assert {outputs[n] for n in ("f[0]", "f[1]", "g[0][0]", "g[1][1]")} == {Fraction(76, 55)}
    assert emitted.operations == {"add": 1, "mul": 1}


def test_signatures_and_long_statements():
    constants = Constants((z,))
    kernel = Kernel("f", "f", {"a": [x], "b": [y]}, {"u": [x], "W": [[x, 2 * x]]})
    emitted = emit_kernel(kernel, constants, DOUBLE)
    assert emitted.signature == (
        "const constants *c, const double a[1], const double b[1], double u[1], double W[1][2]")
    assert (emitted.returns, emitted.unused, emitted.constants) == ("void", ["c", "b"], frozenset())
    scalar = emit_kernel(Kernel("g", "g", {"a": [x]}, {"g": z * x}), constants, DOUBLE)
    assert (scalar.returns, scalar.unused, scalar.constants) == ("double", [], {"z"})
    assert scalar.lines[-1].startswith("return ")
    statement = "x = " + " + ".join(f"a{i}*b{i}" for i in range(40)) + ";"
    wrapped = wrap(statement)
    assert max(map(len, wrapped.splitlines())) <= 104
    assert "\n" in wrapped
    assert re.sub(r"\n\s+", " ", wrapped) == statement
    assert wrap("x = y;") == "x = y;"
    assert wrap("x = " + "y" * 200 + ";") == "x = " + "y" * 200 + ";"


@pytest.mark.parametrize("name", ["t", "u", "_t", "k", "d", "c", "q"])
def test_symbols_called_like_temporaries_are_not_mixed_up_with_them(name):
    a, b = sp.symbols(f"{name}0:2", real=True)
    e = sp.sin((a + b) ** 2) + (a + b) ** 4 + (a * b + 1) * (a * b + 2) / (a + b) ** 2
    kernel = Kernel("f", "", {"v": [a, b]}, {"f": e})
    point = {a: sp.Rational(1, 3), b: sp.Rational(1, 7)}
    with mpmath.workdps(40):
        outputs, _, _ = run_kernel(kernel, Constants(()), point, number=mpmath.mpf)
        assert abs(outputs["return"] - mpmath.mpf(str(sp.N(e.xreplace(point), 40)))) < 1e-36


@pytest.mark.parametrize("names", ["t0 u0 c0", "d0 qm0 k0", "dq0 pm0 lambda0"])
def test_system_whose_symbols_are_called_like_the_generators_own_has_right_kernels(names):
    a, b, c0 = sp.symbols(names, real=True)
    momenta = sp.symbols("v0:2", real=True)
    H = (momenta[0] ** 2 + momenta[1] ** 2) / (2 + c0**2) + (a + b) ** 4 * c0
    system = System((a, b), momenta, (c0,), H, (a**2 + c0 * b**2 - 1,), name="named")
    reduced, constants = hoist_constants(system)
    kernels = [*common_kernels(reduced), *SparkScheme(reduced, gauss_lobatto(1)).kernels(),
               *MeanScheme(reduced, discrete=True).kernels()]
    for kernel in kernels:
        point = random_point([c0, *chain(*kernel.inputs.values())])
        outputs, _, _ = run_kernel(kernel, constants, point)
        for output, value in expected_of(kernel, constants, point).items():
            assert outputs[output] == Fraction(int(value.p), int(value.q)), (kernel.name, output)
    by_name = {kernel.name: kernel for kernel in kernels}
    step = by_name["constraint_increment"]
    d = step.inputs["d"]
    assert not set(d) & {a, b, c0, *momenta}
    shifted = {s: s + t for s, t in zip((a, b), d, strict=True)}
    g = system.constraints[0]
    assert sp.expand(constants.expand_shared(step.outputs["dg"][0]) - g.xreplace(shifted) + g) == 0
