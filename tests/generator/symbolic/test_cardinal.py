"""Cardinal functions and their derivatives: the C of every type against mpmath."""

from __future__ import annotations

import subprocess
from pathlib import Path

import jinja2
import mpmath as mp
import pytest
import sympy as sp

from gyrospark.core.real_types import REALS
from gyrospark.generator.codegen.emit import TEMPLATES
from gyrospark.generator.symbolic.cardinal_functions import (
    Asinhc,
    Atanc,
    Atanhc,
    Sinc,
    Sinhc,
    c_names_with_needs,
)
from gyrospark.generator.symbolic.numeric_evaluation import Evaluator
from gyrospark.generator.symbolic.phases import Phase

FUNCTIONS = [f for g in (Sinc, Sinhc, Asinhc, Atanc, Atanhc) for f in (g, g.slope)]
#: Around 0, where the form of a derivative changes, moderate and large.
POINTS = [0.0, 1e-300, 1e-35, 1e-20, 1e-9, 1e-5, 1e-3, 0.03, 0.3, 0.55, 0.75, 0.77, 0.9, 0.99,
          0.9999, 1.0, 1.0001, 1.3, 2.0, 3.5, 10.0, 40.0, 80.0, 1e4, 1e9]
PRINT = {"float": "%.60g", "double": "%.60g", "long-double": "%.60Lg"}


def program(real, tmp_path: Path):
    """Return the numbers that a C program prints: every function at every point."""
    names = {f.c_name for f in FUNCTIONS}
    environment = jinja2.Environment(loader=jinja2.FileSystemLoader(TEMPLATES), trim_blocks=True,
                                     lstrip_blocks=True, undefined=jinja2.StrictUndefined)
    body = environment.get_template("cardinal.c.jinja").render(
        cardinals=names, suffix=real.suffix.lower(), limits=real.limits)
    if real.name == "float128":
        show = "char text[90]; strfromf128(text, sizeof text, \"%.60g\", f(x)); puts(text);"
    else:
        show = f"printf(\"{PRINT[real.name]}\\n\", f(x));"
    calls = "\n".join(f"show({name}, {point.hex()}{real.suffix});" for name, point in cases(real))
    source = tmp_path / "cardinal.c"
    source.write_text(f"""#define __STDC_WANT_IEC_60559_TYPES_EXT__ 1
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
typedef {real.c_type} real;
{body}
static void show(real (*f)(real), real x) {{ {show} }}
int main(void) {{
{calls}
return 0;
}}
""")
    binary = tmp_path / "cardinal"
    flags = ["-O2", "-std=c11", "-Wall", "-Wextra", "-Werror"]
    done = subprocess.run(["cc", *flags, str(source), "-lm", "-o", str(binary)],
                          capture_output=True, text=True, check=False)
    if done.returncode and real.name == "float128":
        pytest.skip("no _Float128 here")
    assert not done.returncode, done.stderr
    return subprocess.run([binary], capture_output=True, text=True, check=True).stdout.split()


def cases(real):
    smallest = 1e-37 if real.name == "float" else 0.0
    for f in FUNCTIONS:
        for point in POINTS:
            if point and point < smallest:
                continue
            if f in (Atanhc, Atanhc.slope) and point >= 1:
                continue
            if f in (Sinhc, Sinhc.slope) and point > 80:
                continue
            yield f.c_name, point


@pytest.mark.parametrize("real", REALS.values(), ids=REALS)
def test_C_of_cardinal_functions_is_right_to_a_few_eps(real, tmp_path):
    values = {f.c_name: f.value for f in FUNCTIONS}
    printed = program(real, tmp_path)
    with mp.workdps(80):
        for (name, point), text in zip(cases(real), printed, strict=True):
            z = mp.mpf(float.fromhex(point.hex()))
            if real.name == "float":
                with mp.workprec(24):
                    z = +z
            exact = values[name](z)
            # Two or three roundings in a function; in a derivative, a difference of terms three
            # times as large as itself and a dozen roundings. Below 1e-30 all of it is below 1.
            bound = (40 if name.endswith("slope") else 4) * mp.ldexp(1, 1 - real.bits)
            assert abs(mp.mpf(text) - exact) <= bound * abs(exact), (name, point, text)


@pytest.mark.parametrize("f", FUNCTIONS, ids=lambda f: f.c_name)
def test_derivative_in_mpmath_is_that_of_the_function(f):
    if f not in (Sinc, Sinhc, Asinhc, Atanc, Atanhc):
        return
    with mp.workdps(40):
        for z in (mp.mpf("0.4"), mp.mpf("1e-3"), mp.mpf("0.93")):
            assert abs(mp.diff(f.value, z) - f.slope.value(z)) < mp.mpf(10) ** -15


@pytest.mark.parametrize("f", [Sinc, Sinhc, Asinhc, Atanc, Atanhc], ids=lambda f: f.c_name)
@pytest.mark.parametrize("bits", [4, 20, 50])
def test_derivative_in_mpmath_loses_no_digit_near_0(f, bits):
    """f' and f/z agree to z^2 near 0: the digits that they share must not count as precision."""
    z = mp.ldexp(mp.mpf(3) / 4, -bits)
    with mp.workprec(113):
        slope = f.slope.value(z)
    with mp.workprec(2000):
        exact = f.slope.value(z)
    assert abs(slope - exact) <= mp.ldexp(abs(exact), -110)


def test_values_and_symmetry_in_symbols():
    z = sp.Symbol("z", real=True)
    for f in (Sinc, Sinhc, Asinhc, Atanc, Atanhc):
        assert f(sp.Integer(0)) == 1
        assert f(-z) == f(z)
        assert f.slope(sp.Integer(0)) == 0
        assert f.slope(-z) == -f.slope(z)
        assert sp.diff(f(3 * z), z) == 3 * f.slope(3 * z)
        assert abs(sp.N(f(sp.Rational(1, 3)), 30) - f.value(mp.mpf(1) / 3)) < 1e-14


def test_phases_are_angles_without_full_turns():
    c, s, start, b = sp.Rational(3, 2), sp.Integer(2), sp.Integer(10**6), sp.Rational(7, 10)
    phase = Phase(c, s, start, b)
    with mp.workdps(40):
        exact = mp.mpf(3 * 10**6) + mp.mpf(7) / 10
        turns = (exact - phase.value(mp.mpf(1.5), mp.mpf(2), mp.mpf(10**6), mp.mpf(7) / 10)
                 ) / (2 * mp.pi)
        assert abs(turns - mp.nint(turns)) < 1e-30
        assert abs(turns * 2 * mp.pi - exact) <= mp.pi
    x, y = sp.symbols("x y", real=True)
    evaluator = Evaluator({x: 2.0, y: 1e6})
    assert evaluator(sp.sin(phase.func(c, x, y, b))) == pytest.approx(mp.sin(exact), abs=1e-9)


def test_only_what_is_called_is_written():
    assert c_names_with_needs(frozenset({"sin", "atanc_slope"})) == {
        "atanc", "atanc_slope", "sinc_slope"}
    assert c_names_with_needs(frozenset({"sin", "pow"})) == frozenset()
