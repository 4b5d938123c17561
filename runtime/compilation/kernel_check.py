"""Comparison of each compiled kernel with NumPy's value of its statements, once per compilation.

A compiler can err: correct C, a wrong object and no warning. When a stepper is compiled, a function
is appended to its text that evaluates each kernel, of numbers or of lanes, at given points. Its
values are compared with those of ``kernel_text`` in more digits. The difference allowed is a
multiple of the round-off measured at the same points, by evaluating the statements a second time in
the working precision.
"""

from __future__ import annotations

import re
import sys
import zlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.real_types import Real
from ...core.records import dataclass
from .kernel_text import (
    Arithmetic,
    Bounded,
    KernelText,
    RunningError,
    arithmetic,
    evaluate,
)

__all__ = ["CheckFunction", "KernelMismatch", "Kind", "check_functions", "differences"]

#: Kernels of numbers, or of lanes.
Kind = Literal["numbers", "lanes"]

#: Points at which a kernel is evaluated: a multiple of every number of lanes.
POINTS = 16
#: Multiple of the measured round-off by which a compiled kernel may be off. Contraction to FMA and
#: the order of sums make errors of the size of NumPy's; the largest of 16 of these is never tiny.
SLACK = 64
#: How points are drawn, in turn until values are finite: lowest and highest of each number.
RANGES = ((-1.0, 1.0), (0.25, 1.0), (0.0, 0.0625))
#: Range of constants and parameters, most of which are positive.
POSITIVE = (0.25, 1.0)

#: Functions around the kernels are compiled for size, which takes less time.
_COLD = "static __attribute__((cold, noinline)) "


@dataclass(frozen=True)
class KernelMismatch:
    """A kernel whose compiled value differs from its statements."""

    kernel: str
    place: str
    compiled: float
    expected: float
    allowed: float

    def __str__(self) -> str:
        label = f"{self.place} of {self.kernel}" if self.place else self.kernel
        return (f"{label} is {self.compiled:.17g} where its statements give {self.expected:.17g} "
                f"(round-off explains {self.allowed:.1e})")


@dataclass(frozen=True)
class CheckFunction:
    """The C function of one object that evaluates its kernels of one kind."""

    name: str
    kind: Kind
    kernels: tuple[KernelText, ...]
    #: Kernel that is not evaluated → the C in it that is not read.
    unread: Mapping[str, str]

    @property
    def declaration(self) -> str:
        """Its C declaration, which has no type but C's own."""
        return (f"void {self.name}(int kernel, long points, const double *in, double *high, "
                "double *low, void *memory);")

    @property
    def text(self) -> str:
        """The C of the function: it evaluates the kernel of a number at each point.

        ``in`` has a row of inputs for each point; the value of an output is ``high + low``, of
        which ``low`` has what a type longer than double has beyond ``high``. ``memory`` holds the
        inputs x of a point and behind them the outputs y; on lanes, of LANES points.
        """
        on_lanes = self.kind == "lanes"
        value, step = ("lanes", "LANES") if on_lanes else ("real", "1")
        sizes = [f"{{ {len(inputs_of(kernel))}, {len(outputs_of(kernel))} }}"
                 for kernel in self.kernels]
        get = "lane_get(y + e, l)" if on_lanes else "y[e]"
        put = ("lane_set(x + e, l, (real)in[l*size + e]);" if on_lanes
               else "x[e] = (real)in[l*size + e];")
        cases = "".join(self._case(number, kernel) for number, kernel in enumerate(self.kernels))
        # the definition begins with the declaration without its semicolon; without a kernel the
        # table has a row of 0, as C has no empty arrays
        return f"""
/* For the check of this object: values of one kernel, its inputs and outputs in rows. */
{_COLD}void set_{self.kind}({value} *x, int size, const double *in)
{{
    for (int e = 0; e < size; ++e)
        for (int l = 0; l < {step}; ++l)
            {put}
}}

{_COLD}void get_{self.kind}(
    const {value} *y, int size, double *high, double *low)
{{
    for (int e = 0; e < size; ++e)
        for (int l = 0; l < {step}; ++l) {{
            const real value = {get};
            high[l*size + e] = (double)value;
            low[l*size + e] = (double)(value - (real)(double)value);
        }}
}}

{self.declaration}
{self.declaration[:-1]}
{{
    static const int sizes[{max(len(sizes), 1)}][2] = {{ {', '.join(sizes) or '{ 0, 0 }'} }};
    const int *size = sizes[kernel];
    {value} *x = memory, *y = x + size[0];
    for (long i = 0; i < points; i += {step}) {{
        set_{self.kind}(x, size[0], in + i*size[0]);
        switch (kernel) {{
{cases}        default:
            break;
        }}
        get_{self.kind}(y, size[1], high + i*size[1], low + i*size[1]);
    }}
}}
"""

    def _case(self, number: int, kernel: KernelText) -> str:
        """Return the C that calls a kernel on inputs in x and has its outputs in y."""
        if kernel.name == "prepare":
            return _block(number, _preparation(kernel))
        lines = [f"{kernel.constants} c;", "clear(&c, sizeof c);"]
        lines += [f"c.{name} = x[{e}];" for e, name in enumerate(kernel.fields)]
        if kernel.on_lanes:
            lines.append("c._used = LANES;")
        # arrays follow each other: inputs behind the constants in x, outputs behind the result in y
        offsets = {"x": len(kernel.fields), "y": 1 if "" in kernel.outputs else 0}
        arguments = ["&c"]
        for name in kernel.order:
            memory, shape = ("x", kernel.inputs[name]) if name in kernel.inputs else (
                "y", kernel.outputs[name])
            value = "lanes" if kernel.on_lanes else "real"
            cast = f"({value} (*)[{shape[1]}])" if len(shape) == 2 else ""
            arguments.append(f"{cast}({memory} + {offsets[memory]})")
            offsets[memory] += int(np.prod(shape))
        call = f"{kernel.name}({', '.join(arguments)});"
        return _block(number, [*lines, f"y[0] = {call}" if "" in kernel.outputs else call])


_CLEAR = f"""
{_COLD}void clear(void *memory, size_t size)
{{
    for (size_t i = 0; i < size; ++i)
        ((unsigned char *)memory)[i] = 0;
}}
"""


def _preparation(kernel: KernelText) -> list[str]:
    """Return the C that calls ``prepare``, from parameters in x to constants in y.

    It reads and writes fields of two structs, which are no arrays: they are set by offsets.
    """
    parameters, constants = (", ".join(f"offsetof({kind}, {name})" for name in names)
                             for kind, names in (("parameters_t", kernel.inputs),
                                                 ("constants", kernel.outputs)))
    return [
        f"{kernel.constants} c;", "clear(&c, sizeof c);",
        "parameters_t par;", "clear(&par, sizeof par);",
        f"static const size_t fields[{max(len(kernel.inputs), 1)}] = {{ {parameters or 0} }};",
        f"static const size_t places[{len(kernel.outputs)}] = {{ {constants} }};",
        "for (int e = 0; e < size[0]; ++e)",
        "    *(real *)(void *)((char *)&par + fields[e]) = x[e];",
        "prepare(&par, &c);",
        "for (int e = 0; e < size[1]; ++e)",
        "    y[e] = *(const real *)(const void *)((const char *)&c + places[e]);"]


def _block(number: int, lines: Iterable[str]) -> str:
    """Return the case of a kernel's number, in C, with the lines in a block of its own."""
    body = "".join(f"            {line}\n" for line in lines)
    return f"        case {number}: {{\n{body}            break;\n        }}\n"


def inputs_of(kernel: KernelText) -> list[str]:
    """Return the arguments that a kernel reads, in C: parameters or constants, then arrays."""
    if kernel.name == "prepare":
        return [f"par->{name}" for name in kernel.inputs]
    return [f"c->{name}" for name in kernel.fields] + _places(kernel.inputs)


def outputs_of(kernel: KernelText) -> list[str]:
    """Return the entries that a kernel computes, in C; "" is its return value."""
    return _places(kernel.outputs)


def _places(arrays: Mapping[str, tuple[int, ...]]) -> list[str]:
    """Return the entries of arrays in C, such as "q[0]", from name → shape."""
    return [name + "".join(f"[{i}]" for i in index)
            for name, shape in arrays.items() for index in np.ndindex(*shape)]


def check_functions(
    prefix: str, kernels: Sequence[KernelText], kinds: Iterable[Kind]
) -> list[CheckFunction]:
    """Return the check functions of an object, one for each of these kinds of kernels."""
    functions = []
    for kind in kinds:
        # without outputs there is nothing to compare
        kernels_of_kind = [k for k in kernels
                           if k.on_lanes == (kind == "lanes") and outputs_of(k)]
        if kernels_of_kind:
            refusals = {k.name: k.refusal for k in kernels_of_kind if k.refusal}
            functions.append(CheckFunction(
                f"{prefix}_evaluate_{kind}", kind,
                tuple(k for k in kernels_of_kind if k.name not in refusals), refusals))
    return functions


def check_text(functions: Iterable[CheckFunction], source: str) -> str:
    """Return the C to be appended to the text of an object.

    A user's parameter may have the name of one of its macros, which are not needed any more.
    """
    texts = [function.text for function in functions]
    names = {name for function in functions for kernel in function.kernels
             for name in (*kernel.fields, *kernel.inputs, *kernel.outputs)}
    macros = sorted(names & set(re.findall(r"^ *# *define (\w+)", source, re.MULTILINE)))
    return "".join([*(f"#undef {name}\n" for name in macros), _CLEAR, *texts]) if texts else ""


class KernelComparison(NamedTuple):
    """Kernels compared with their statements."""

    mismatches: list[KernelMismatch]  # at most one for each kernel
    compared: dict[str, int]  # kernel → number of outputs that are finite at two points or more
    unchecked: dict[str, str]  # kernel with outputs that were not compared → reason


def differences(
    module: Any, functions: Iterable[CheckFunction], real: Real, points: int = POINTS
) -> KernelComparison:
    """Compare the kernels of a module with their statements at random points, a multiple of 16."""
    comparison = KernelComparison(mismatches=[], compared={}, unchecked={})
    mismatches, compared, unchecked = comparison
    working, wide = arithmetic(real, wide=False), arithmetic(real, wide=True)
    for function in functions:
        unchecked |= {name: f"{text} is not read" for name, text in function.unread.items()}
        for number, kernel in enumerate(function.kernels):
            mismatch, nonfinite = _worst_mismatch(module, function, number, working, wide, real,
                                                  points)
            compared[kernel.name] = len(outputs_of(kernel)) - len(nonfinite)
            mismatches += [] if mismatch is None else [mismatch]
            if nonfinite:
                outputs = ", ".join(nonfinite[:3]) + (", ..." if len(nonfinite) > 3 else "")
                unchecked[kernel.name] = f"{outputs or 'its value'} is finite at no random point"
    return comparison


def _worst_mismatch(
    module: Any, function: CheckFunction, number: int, working: Arithmetic, wide: Arithmetic,
    real: Real, count: int,
) -> tuple[KernelMismatch | None, list[str]]:
    """Return the worst mismatch of a kernel, if there is one, and the outputs nowhere finite.

    With the outputs y of the compiled kernel, y₀ of its statements in more digits (``wide``) and y₁
    of its statements in the stepper's type (``working``), at ``count`` random points, an output is
    accepted if

        |y − y₀| ≤ SLACK · max(|y₁ − y₀|, ε |y₀|),

    maxima over the points on the right; else if it is within SLACK times the bound of a running
    error analysis. The worst has the largest ratio ``excess`` of error and allowed error.
    """
    kernel, epsilon = function.kernels[number], 2.0 ** (1 - real.bits)
    # the same points in every process, which hash() of a text would not give
    random = np.random.default_rng(zlib.crc32(kernel.name.encode()))
    pending_outputs, worst_mismatch, excess = dict.fromkeys(outputs_of(kernel)), None, 1.0
    for lowest, highest in RANGES:
        points = {name: _random_numbers(random, *(POSITIVE if "->" in name else (lowest, highest)),
                                        count)
                  for name in inputs_of(kernel)}
        y0, y1 = (evaluate(kernel, by, {name: by.array(x) for name, x in points.items()})
                  for by in (wide, working))
        y = _evaluate_kernel(module, function, number, points, count, wide)
        bounds: dict[str, Any] = {}
        for output in list(pending_outputs):
            finite, compiled, expected, errors, round_off = _errors_of(
                y[output], y0[output], y1[output], wide, count)
            if len(errors) < 2:
                continue  # outside of where a root or a logarithm is real: drawn from elsewhere
            del pending_outputs[output]
            allowed = SLACK * max(round_off, epsilon * np.abs(expected).max(), sys.float_info.min)
            largest = int(errors.argmax())
            # rounding may cancel in NumPy, and not with FMA: then the measured round-off is too
            # small, and its bound decides, which takes longer to evaluate
            if errors[largest] > allowed:
                bounds = bounds or _bounds(kernel, wide, points)
                bound = _doubles(bounds[output], count)[finite].max()
                allowed = max(allowed, SLACK * float(epsilon * bound))
            if errors[largest] > excess * allowed:
                excess = errors[largest] / allowed
                worst_mismatch = KernelMismatch(kernel.name, output, compiled[largest],
                                                expected[largest], allowed)
        if not pending_outputs:
            break
    return worst_mismatch, list(pending_outputs)


class _Errors(NamedTuple):
    """Errors of an output of a compiled kernel at the points where its statements are finite."""

    finite: NDArray[np.bool_]  # which of all points these are
    compiled: NDArray[np.float64]
    expected: NDArray[np.float64]
    errors: NDArray[np.float64]  # ∞ where the compiled value is NaN
    round_off: float  # the largest error of the statements in the stepper's type


def _errors_of(y: Any, y0: Any, y1: Any, wide: Arithmetic, count: int) -> _Errors:
    """Return |y − y₀| and max |y₁ − y₀| of an output; letters as of ``_worst_mismatch``."""
    expected, rounded = _doubles(y0, count), _doubles(y1, count)
    finite = np.isfinite(expected) & np.isfinite(rounded)
    with np.errstate(all="ignore"):
        errors, round_off = (np.abs(_doubles(outputs - y0, count)[finite])
                             for outputs in (y, wide.array(y1, count)))
    errors[np.isnan(errors)] = np.inf
    return _Errors(finite, _doubles(y, count)[finite], expected[finite], errors,
                   float(round_off.max(initial=0.0)))


def _bounds(
    kernel: KernelText, by: Arithmetic, points: Mapping[str, NDArray[np.float64]]
) -> dict[str, Any]:
    """Return bounds of the round-off of each output, in units of ε."""
    results = evaluate(kernel, RunningError(by), {
        name: Bounded(by.array(x), by.array(np.zeros_like(x))) for name, x in points.items()})
    return {output: x.error for output, x in results.items()}


def _random_numbers(
    random: np.random.Generator, lowest: float, highest: float, count: int
) -> NDArray[np.float64]:
    """Return random odd multiples of 2^-20, which every type holds exactly."""
    return (2 * np.round(random.uniform(lowest, highest, count) * 2.0**19) + 1) * 2.0**-20


def _evaluate_kernel(
    module: Any, function: CheckFunction, number: int,
    points: Mapping[str, NDArray[np.float64]], count: int, wide: Arithmetic,
) -> dict[str, Any]:
    """Return the values of a compiled kernel, output → array over the points.

    ``points`` maps each input to its values at ``count`` points.
    """
    outputs, ffi = outputs_of(function.kernels[number]), module.ffi
    rows = np.stack(list(points.values()), axis=1) if points else np.zeros((count, 1))
    high, low = (np.zeros((count, len(outputs))) for _ in range(2))
    memory = np.zeros(64 * (len(points) + len(outputs) + 1), dtype=np.uint8)  # lanes of 64 bytes
    getattr(module.lib, function.name)(
        number, count, *(ffi.from_buffer("double[]", array) for array in (rows, high, low)),
        ffi.from_buffer("char[]", memory) + -memory.ctypes.data % 64)
    return {output: wide.array(high[:, e]) + wide.array(low[:, e])
            for e, output in enumerate(outputs)}


def _doubles(values: Any, count: int) -> NDArray[np.float64]:
    """Return numbers of any type as doubles, one for each of ``count`` points."""
    return np.broadcast_to(np.asarray(values, dtype=np.float64), (count,)).copy()
