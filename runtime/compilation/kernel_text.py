"""The kernels in the C of a stepper, read back and evaluated by NumPy or mpmath.

A kernel is a function without loops or branches: declarations of constants, assignments, sums of
products in twice the working precision, a result. The generator writes each as
``returns name(const constants *c, const double q[4], double g[1])``. What is read here is the text
that the compiler gets, so its values are a second way to all that the compiler makes of it.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ...core.real_types import Real
from ...core.records import dataclass

__all__ = ["Arithmetic", "Bounded", "KernelText", "RunningError", "arithmetic", "evaluate",
           "kernels_of"]

_KERNEL = re.compile(
    r"^(?:static |inline |INLINE |NOINLINE |ONCE |LANES_ONCE )*"
    r"(?P<returns>void|float|double|long double|_Float\d+|lanes) (?P<name>\w+)\(\s*"
    r"const (?P<constants>constants|lanes_constants|parameters_t) \*c(?P<arrays>[^(){};]*)\)\n"
    r"{\n(?P<body>.*?)^}\n", re.MULTILINE | re.DOTALL)
_PREPARE = re.compile(
    r"^static void prepare\(const parameters_t \*par, constants \*c\)\n{\n(?P<body>.*?)^}\n",
    re.MULTILINE | re.DOTALL)
#: A loop of ``prepare`` over the rows of a table.
_LOOP = re.compile(r"^ *for \(int i = 0; i < \d+; \+\+i\)\n(?P<statement>[^;]*;\n)", re.MULTILINE)
_ROW = re.compile(r"{ (\d+)(.*) }")
_FIELD = re.compile(r"offsetof\(parameters_t, (\w+)\)")
_ARRAY = re.compile(r"(const )?[\w ]+ (\w+)((?:\[\d+\])+)")
_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
#: A token of an expression: a number, a name with its indices or with "(", a sign.
_TOKEN = re.compile(r"\s*(?:(?P<number>0[xX][\da-fA-F]*\.?[\da-fA-F]*[pP][+-]?\d+"
                    r"|(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)(?:F\d+|[fFlL])?"
                    r"|(?P<name>[A-Za-z_]\w*(?:->\w+)?(?:\[\d+\])*)(?P<call>\(?)|(?P<sign>[-+*/(),]))")
_STATEMENT = re.compile(
    r"(?:const [\w ]+ (?P<local>\w+)|(?P<place>[\w>-]+(?:\[\d+\])*)) = (?P<value>.*)")
_RETURN = re.compile(r"return (?P<value>.*)")
_SUM = re.compile(r"[\w ]+ sum\[2\]")
_NO_SUM = re.compile(r"sum\[[01]\] = (?:0|splat\(0\))")
#: A product in twice the working precision, and it as one statement.
_PRODUCT = re.compile(
    r"{ const [\w ]+ factors\[\] = { (?P<factors>[^{}]*) }; (?:lanes_)?add_product\([^{}]*\); }")
_FACTORS = re.compile(r"product (?P<factors>.*)")
_UNUSED = re.compile(r"\(void\)\w+(?:->\w+)?(?:, \(void\)\w+(?:->\w+)?)*")
#: Operator → how tightly it binds, and what it computes.
_OPERATORS: dict[str, tuple[int, Callable[..., Any]]] = {
    "+": (1, operator.add), "-": (1, operator.sub), "*": (2, operator.mul),
    "/": (2, operator.truediv), "negate": (3, operator.neg)}

#: An expression in reverse Polish notation: what is done ("number", "name", "call", or an
#: operator), a text, how many arguments.
Expression = list[tuple[str, str, int]]


class UnreadableError(Exception):
    """Unsupported C: a loop, a branch, an unknown call."""


@dataclass(frozen=True)
class KernelText:
    """A kernel as it is written: where its numbers come from, its statements, its outputs."""

    name: str
    returns: str
    #: Type of ``c``: ``constants``, ``lanes_constants``, ``parameters_t``.
    constants: str
    #: Name → shape of each array, in the order of the arguments.
    inputs: dict[str, tuple[int, ...]]
    outputs: dict[str, tuple[int, ...]]
    #: Arguments in order, inputs and outputs.
    order: tuple[str, ...]
    body: str

    @property
    def on_lanes(self) -> bool:
        """Whether it computes with lanes of numbers."""
        return self.constants == "lanes_constants"

    @property
    def fields(self) -> tuple[str, ...]:
        """Names of its constants, as written after ``c->``."""
        return tuple(sorted(set(re.findall(r"c->((?!_used\b)\w+(?:\[\d+\])?)", self.body))))

    @property
    def statements(self) -> list[tuple[str, str, list[Expression]]]:
        """The statements: kind, target, and a list of the expression.

        Kinds are local, place, product, return, and clear, which has no expression.
        """
        return _statements(self.body)

    @property
    def refusal(self) -> str:
        """The first C in its body that is not read here; empty if all is."""
        try:
            return "" if self.statements else "an empty body"
        except UnreadableError as error:
            return repr(str(error))


def kernels_of(source: str) -> list[KernelText]:
    """Return the kernels in the text of a stepper, and how its constants are prepared.

    A kernel is a function whose arrays have numbers as sizes; the engine's have names.
    """
    kernels = [kernel for match in _KERNEL.finditer(source)
               if (kernel := _kernel(match)) is not None]
    prepare = _PREPARE.search(source)
    if prepare is None:
        return kernels
    body = _LOOP.sub(lambda loop: _unroll(loop["statement"], source), prepare["body"])
    outputs: dict[str, tuple[int, ...]] = dict.fromkeys(
        re.findall(r"^ *c->(\w+(?:\[\d+\])?) =", body, re.MULTILINE), ())
    names: dict[str, tuple[int, ...]] = dict.fromkeys(re.findall(r"par->(\w+)", body), ())
    preparation = KernelText("prepare", "void", "constants", inputs=names, outputs=outputs,
                             order=(), body=body)
    return [preparation, *kernels] if outputs else kernels


def _unroll(statement: str, source: str) -> str:
    """Return the statement of a loop once for each row of its table.

    A row ``{ k, offsetof(parameters_t, m), ... }`` has the index of a constant and the parameters
    that it is computed from: ``table[i][0]`` becomes k, ``parameter_at(par, table[i][1])`` m.
    """
    statement = re.sub(r"\s+", " ", statement)  # lines may be broken
    table = re.search(r"(\w+)\[i\]", statement)
    assert table is not None
    _, _, rows = source.partition(f"static const size_t {table[1]}[")
    rows_of_c = []
    for target, fields in _ROW.findall(rows[: rows.index("};")]):
        row = f"{statement}\n".replace(f"{table[1]}[i][0]", target)
        for k, name in enumerate(_FIELD.findall(fields), start=1):
            row = row.replace(f"parameter_at(par, {table[1]}[i][{k}])", f"par->{name}")
        rows_of_c.append(row)
    return "".join(rows_of_c)


def _kernel(match: re.Match[str]) -> KernelText | None:
    """Return a function as a kernel; None for one with other arguments."""
    try:
        arrays = _arrays(match["arrays"], match["returns"])
    except UnreadableError:
        return None
    return KernelText(match["name"], match["returns"], match["constants"], *arrays, match["body"])


class _Arrays(NamedTuple):
    """The array arguments of a kernel: shapes by name, and all names in order."""

    inputs: dict[str, tuple[int, ...]]
    outputs: dict[str, tuple[int, ...]]
    order: tuple[str, ...]


def _arrays(text: str, returns: str) -> _Arrays:
    """Return the array arguments in the text of an argument list; "" is a returned number."""
    inputs: dict[str, tuple[int, ...]] = {}
    outputs: dict[str, tuple[int, ...]] = {} if returns == "void" else {"": ()}
    order = []
    for argument in filter(None, map(str.strip, text.split(","))):
        if (array := _ARRAY.fullmatch(argument)) is None:
            raise UnreadableError(argument)
        is_input, name, sizes = array.groups()
        (inputs if is_input else outputs)[name] = tuple(map(int, re.findall(r"\d+", sizes)))
        order.append(name)
    return _Arrays(inputs, outputs, tuple(order))


@lru_cache(maxsize=64)
def _statements(body: str) -> list[tuple[str, str, list[Expression]]]:
    """Return the statements of a body, as ``KernelText.statements`` has them; cached."""
    return [parsed for line in _lines(body) if (parsed := _parse(line)) is not None]


def _lines(body: str) -> Iterator[str]:
    """Yield the statements of a body, each in one line without its semicolon."""
    text = re.sub(r"\s+", " ", _COMMENT.sub("", body)).strip()
    text = _PRODUCT.sub(r"product \g<factors>;", text)
    if text and not text.endswith(";"):
        raise UnreadableError(text[-40:])
    yield from (line.strip() for line in text.split(";")[:-1])


def _parse(line: str) -> tuple[str, str, list[Expression]] | None:
    """Return the kind, target and expressions of a statement; None for declarations."""
    if _UNUSED.fullmatch(line) or _SUM.fullmatch(line):
        return None
    if _NO_SUM.fullmatch(line):
        return "clear", "", []
    if product := _FACTORS.fullmatch(line):
        return "product", "", [_expression(f"({product['factors']})".replace(", ", ")*("))]
    if result := _RETURN.fullmatch(line):
        return "return", "", [_expression(result["value"])]
    if assigned := _STATEMENT.fullmatch(line):
        kind = "local" if assigned["local"] else "place"
        return kind, assigned["local"] or assigned["place"], [_expression(assigned["value"])]
    raise UnreadableError(line)


class _ShuntingYard:
    """Dijkstra's shunting yard: operators are on a stack until their operands are written."""

    def __init__(self) -> None:
        self.output: Expression = []
        self.stack: list[str] = []  # operators, "(" and functions followed by "("
        self.argument_counts: list[int] = []  # of each open parenthesis

    def open(self, function: str = "") -> None:
        """Begin a parenthesis, or the arguments of a function."""
        self.stack.append(f"{function}(")
        self.argument_counts.append(1)

    def close(self) -> None:
        """End the innermost parenthesis; that of a function's arguments becomes a call."""
        function, count = self.stack.pop()[:-1], self.argument_counts.pop()
        if function:
            self.output.append(("call", function, count))

    def release(self, binding: int) -> None:
        """Move the operators that bind at least as tightly from the stack to the output."""
        while self.stack and self.stack[-1] in _OPERATORS and (
                _OPERATORS[self.stack[-1]][0] >= binding):
            self.output.append((self.stack.pop(), "", 0))


def _expression(text: str) -> Expression:
    """Return an expression of C in reverse Polish notation, by Dijkstra's shunting yard."""
    # how many lanes a function computes, its first argument: here each point is one lane
    text = text.replace("c->_used, ", "")
    yard = _ShuntingYard()
    position, follows_operand = 0, False
    while position < len(text):
        token = _TOKEN.match(text, position)
        if token is None:
            raise UnreadableError(text)
        position, sign = token.end(), token["sign"]
        if token["call"]:
            function = _base_name(token["name"])
            if function not in _FUNCTIONS:
                raise UnreadableError(f"{token['name']} is no known function")
            yard.open(function)
        elif not sign:
            kind = "number" if token["number"] else "name"
            yard.output.append((kind, token[kind], 0))  # an operand has no arguments
        elif sign == "(":
            yard.open()
        elif sign in (")", ","):
            yard.release(binding=0)  # all operators, down to a parenthesis
            if not yard.argument_counts:
                raise UnreadableError(text)
            if sign == ")":
                yard.close()
            else:
                yard.argument_counts[-1] += 1
        elif sign in ("+", "-") and not follows_operand:  # of a number: + changes nothing
            if sign == "-":
                yard.stack.append("negate")
        else:  # operators to the left that bind as tightly are computed first
            binding, _ = _OPERATORS[sign]
            yard.release(binding)
            yard.stack.append(sign)
        follows_operand = not token["call"] and sign in (None, ")")
    yard.release(binding=0)
    if yard.stack:
        raise UnreadableError(text)
    return yard.output


# ---------------------------------------------------------------- numbers


@dataclass(frozen=True)
class Arithmetic:
    """How literals are read and functions evaluated, on arrays of points."""

    #: A literal of C, or a double, as a number of this arithmetic: rounded to the stepper's type.
    number: Callable[[Any], Any]
    functions: Any  # numpy, or a context of mpmath

    def array(self, values: Any, count: int | None = None) -> Any:
        """Return numbers of a type with fewer digits as numbers of this arithmetic."""
        values = values if count is None else np.broadcast_to(values, (count,))
        if self.functions is not np:
            return np.array([self.functions.mpf(x) for x in values], dtype=object)
        return np.asarray(values).astype(type(self.number(0.0)))

    def call(self, name: str, arguments: list[Any]) -> Any:
        """Return the value of a function of C at arrays of points."""
        if name in ("choose", "maximum", "minimum", "sign"):
            return self._switch(name, arguments)
        if name == "phase":  # of time.c.jinja, at points where a time is no late one
            high, low, s, t, b = arguments
            angle = (high + low) * s * t + b
            return self.call("atan2", [self.call("sin", [angle]), self.call("cos", [angle])])
        if name.removesuffix("_slope") in _CARDINAL:
            return self._cardinal(name, arguments[0])
        if self.functions is not np:
            function = getattr(self.functions, "power" if name == "pow" else name)
            real_function = _nan_where_complex(function, self.functions.nan)
            return np.frompyfunc(real_function, nin=len(arguments), nout=1)(*arguments)
        return getattr(self.functions, _NUMPY.get(name, name))(*arguments)

    def _switch(self, name: str, arguments: list[Any]) -> Any:
        """Return a piecewise function: choose(a, b, x, y) is x where a < b, and y elsewhere."""
        if name == "sign":
            x = arguments[0]
            return np.where(x < 0, -1, np.where(x > 0, 1, x))
        a, b = arguments[:2]
        x, y = {"choose": arguments[2:], "maximum": [b, a], "minimum": [a, b]}[name]
        return np.where(a < b, x, np.where(a >= b, y, a + b))  # as in C: of NaN comes NaN

    def _cardinal(self, name: str, z: Any) -> Any:
        """Return f(z)/z, or its derivative (f'(z) - f(z)/z)/z; points are never at z = 0."""
        function = _CARDINAL[name.removesuffix("_slope")]
        ratio = self.call(function, [z]) / z
        if not name.endswith("_slope"):
            return ratio
        return (_DERIVATIVES[function](self, z) - ratio) / z


def _nan_where_complex(function: Callable[..., Any], nan: Any) -> Callable[..., Any]:
    """Return a function of mpmath that is NaN where it is complex or infinite, as C's are."""
    def value(*arguments: Any) -> Any:
        """Return the function's value, NaN where it is not real."""
        try:
            number = function(*arguments)
        except (ValueError, ZeroDivisionError):
            return nan
        return nan if hasattr(number, "_mpc_") else number

    return value


_NUMPY = {"fabs": "abs", "asin": "arcsin", "acos": "arccos", "atan": "arctan", "pow": "power",
          "atan2": "arctan2", "asinh": "arcsinh", "acosh": "arccosh", "atanh": "arctanh"}
_CARDINAL = {"sinc": "sin", "sinhc": "sinh", "asinhc": "asinh", "atanc": "atan",
             "atanhc": "atanh"}
_DERIVATIVES: dict[str, Callable[[Arithmetic, Any], Any]] = {
    "sin": lambda by, z: by.call("cos", [z]),
    "sinh": lambda by, z: by.call("cosh", [z]),
    "asinh": lambda by, z: 1 / by.call("sqrt", [1 + z * z]),
    "atan": lambda by, z: 1 / (1 + z * z),
    "atanh": lambda by, z: 1 / (1 - z * z),
}
_FUNCTIONS = {"sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh",
              "acosh", "atanh", "exp", "log", "floor", "sqrt", "pow", "fabs", "choose", "maximum",
              "minimum", "sign", "splat", "phase", *_CARDINAL,
              *(f"{name}_slope" for name in _CARDINAL)}


def _base_name(text: str) -> str:
    """Return the name of a function of C without prefix for lanes and suffix of the type."""
    name = text.removeprefix("lanes_")
    for suffix in ("f128", "f64", "f", "l"):
        if name not in _FUNCTIONS and name.removesuffix(suffix) in _FUNCTIONS:
            return name.removesuffix(suffix)
    return name


def arithmetic(real: Real, *, wide: bool) -> Arithmetic:
    """Return the arithmetic of a type, or one with more digits for the same numbers."""
    if real.bits <= 24:
        dtype = np.float64 if wide else np.float32
        return Arithmetic(lambda text: dtype(np.float32(_double(text))), np)
    if real.bits <= 53:
        long = np.longdouble if wide else np.float64  # which are the same on some machines
        return Arithmetic(lambda text: long(_double(text)), np)
    from mpmath import MPContext

    context, working = MPContext(), MPContext()
    working.prec = real.bits
    context.prec = real.bits * (2 if wide else 1)
    return Arithmetic(lambda text: context.mpf(working.mpf(_exact(text))), context)


_HEXADECIMAL = re.compile(r"0[xX]([\da-fA-F]*)\.?([\da-fA-F]*)[pP]([+-]?\d+)")


def _double(literal: Any) -> float:
    """Return a literal of C, or a number, as a double."""
    is_hexadecimal = isinstance(literal, str) and _HEXADECIMAL.fullmatch(literal)
    return float.fromhex(literal) if is_hexadecimal else float(literal)


def _exact(literal: Any) -> Any:
    """Return a literal of C as mpmath takes it: a hexadecimal one as an integer and a power of 2.
    """
    parts = _HEXADECIMAL.fullmatch(literal) if isinstance(literal, str) else None
    return literal if parts is None else (int(parts[1] + parts[2], 16),
                                          int(parts[3]) - 4 * len(parts[2]))


@dataclass(frozen=True)
class Bounded:
    """Values with a bound of their round-off in units of ε, by a running error analysis.

    |δ(x ± y)| ≤ |δx| + |δy| + ε|x ± y|, |δ(xy)| ≤ |y||δx| + |x||δy| + ε|xy|, and likewise for
    quotients (Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., section 3.3).
    """

    value: Any
    error: Any

    def __add__(self, other: Bounded) -> Bounded:
        return self._of(self.value + other.value, self.error + other.error)

    def __sub__(self, other: Bounded) -> Bounded:
        return self._of(self.value - other.value, self.error + other.error)

    def __mul__(self, other: Bounded) -> Bounded:
        return self._of(self.value * other.value,
                        abs(other.value) * self.error + abs(self.value) * other.error)

    def __truediv__(self, other: Bounded) -> Bounded:
        ratio = self.value / other.value
        return self._of(ratio, (self.error + abs(ratio) * other.error) / abs(other.value))

    def __neg__(self) -> Bounded:
        return Bounded(-self.value, self.error)

    def _of(self, value: Any, error: Any) -> Bounded:
        return Bounded(value, error + abs(value))


@dataclass(frozen=True)
class RunningError:
    """The arithmetic of ``Bounded`` numbers."""

    by: Arithmetic

    def number(self, text: Any) -> Bounded:
        """Return a literal, which is exact."""
        value = self.by.number(text)
        return Bounded(value, 0 * value)

    def call(self, name: str, arguments: list[Bounded]) -> Bounded:
        """Return a function f of C with a bound of its error, in units of ε.

        δf = Σᵢ |∂f/∂xᵢ| δxᵢ + 4 |f|, where the derivatives are forward differences and the last
        term is the error of the mathematical library. A switch takes the errors of all arguments.
        """
        values = [x.value for x in arguments]
        value = self.by.call(name, values)
        if name in ("choose", "maximum", "minimum", "sign", "floor"):
            return Bounded(value, sum((x.error for x in arguments), 0 * value))
        error = 4 * abs(value)
        for i, x in enumerate(arguments):
            step = 2.0**-20 * abs(x.value)
            neighbour = self.by.call(name, [*values[:i], x.value + step, *values[i + 1 :]])
            error = error + abs(neighbour - value) * (x.error / step)
        return Bounded(value, error)


def evaluate(
    kernel: KernelText, by: Arithmetic | RunningError, values: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the outputs of a kernel: its name in C, without ``c->``, → array over the points.

    Parameters
    ----------
    kernel, by
        What is evaluated, and in which numbers.
    values : mapping
        ``q[0]``, ``c->k1``, ... → array over the points, in numbers of ``by``.
    """
    value_of = dict(values)
    outputs: dict[str, Any] = {}
    with np.errstate(all="ignore"):
        for kind, name, expressions in kernel.statements:
            if kind == "clear":  # a sum of products begins, in twice the working precision in C
                value_of["sum[0]"] = value_of["sum[1]"] = by.number("0")
                continue
            value = _value(expressions[0], by, value_of)
            if kind == "product":
                value_of["sum[0]"] = value_of["sum[0]"] + value
            elif kind == "local":
                value_of[name] = value
            else:
                outputs[name.removeprefix("c->")] = value_of[name] = value
    return outputs


def _value(expression: Expression, by: Arithmetic | RunningError, inputs: Mapping[str, Any]) -> Any:
    """Return the value of an expression in postfix order."""
    stack: list[Any] = []
    for kind, text, count in expression:
        if kind == "number":
            stack.append(by.number(text))
        elif kind == "name":
            stack.append(inputs[text])
        elif kind == "negate":
            stack.append(-stack.pop())
        elif kind == "call":
            arguments = stack[len(stack) - count:]
            del stack[len(stack) - count:]
            stack.append(arguments[0] if text == "splat" else by.call(text, arguments))
        else:
            second, first = stack.pop(), stack.pop()
            stack.append(_OPERATORS[kind][1](first, second))
    return stack[0]
