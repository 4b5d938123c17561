"""float128: bytes and numbers, steps against 50 digits, order 2s up to s = 8, and refusals."""

from __future__ import annotations

import pickle
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from math import log2

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
import systems
from gyrospark.core.errors import CompilerError, InputError
from gyrospark.core.real_types import REALS, round_binary
from gyrospark.generator.spec import Spec
from gyrospark.runtime.bindings import binary128
from gyrospark.runtime.compilation.compiler import _refuse_without_quad, find_compiler
from gyrospark.runtime.rigid_body.problems import fast_top
from python_newton import integrate
from reference import reference
from strategies import random_case, tableau_of

EPS = mp.mpf(2) ** -112
TOP = {"I1": 0.3, "I2": 0.31, "I3": 0.2, "mgl": 5.0, "gamma": 0.27}
START = [0.5, 0.5, -0.5, 0.5], [0.25, 0.75, 1.5, 0.5]
ONE = 0x3FFF << 112


@pytest.fixture(scope="module", autouse=True)
def _binary128(tmp_path_factory):
    try:
        _refuse_without_quad(find_compiler(), tmp_path_factory.mktemp("probe"))
    except CompilerError as error:
        pytest.skip(f"no binary128 here: {error}")


def stepper(scheme, stages=None):
    return systems.stepper("heavy_top", scheme, stages, "float128")


def start(step):
    return step.project(*START, parameters=TOP)


def largest(x):
    return max(abs(entry) for entry in np.ravel(x))


def bytes_of(bits):
    return np.array([bits >> 64 * i & (2**64 - 1) for i in (0, 1)], dtype="<u8").tobytes()


def number(bits):
    return binary128.from_bytes(np.frombuffer(bytes_of(bits), dtype=np.uint8)[None])[0]


def bits_of(value):
    return int.from_bytes(binary128.to_bytes(np.array([value], dtype=object)).tobytes(), "little")


@settings(max_examples=150)
@given(st.integers(0, 2**128 - 1))
def test_every_number_keeps_its_bytes(bits):
    value, exponent, fraction = number(bits), bits >> 112 & 0x7FFF, bits & (2**112 - 1)
    if exponent == 0x7FFF:
        assert mp.isnan(value) if fraction else mp.isinf(value)
        return
    significand = fraction + 2**112 * (exponent > 0)
    exact = significand * Fraction(2) ** (max(exponent, 1) - 16383 - 112)
    assert binary128.exact(value) == (-exact if bits >> 127 else exact)
    assert bits_of(value) == (bits if significand else 0)  # mpmath has no −0


@pytest.mark.parametrize(("bits", "text"), [
    (0, "0.0"), (ONE, "1.0"), (ONE | 1 << 127, "-1.0"), (0x7FFF << 112, "+inf"),
    (0xFFFF << 112, "-inf"), (0x7FFF << 112 | 1 << 111, "nan"),
])
def test_known_numbers(bits, text):
    assert str(number(bits)) == text
    assert bits_of(number(bits)) == bits


def test_ends_of_the_range():
    assert binary128.exact(number(1)) == Fraction(2) ** -16494  # the least subnormal number
    assert binary128.exact(number(1 << 112)) == Fraction(2) ** -16382
    assert bits_of(mp.mpf(2) ** -16496) == 0
    assert bits_of(mp.mpf(2) ** 16384) == 0x7FFF << 112
    assert bits_of(mp.mpf(3) * mp.mpf(2) ** -16495) == 2  # a tie, to even


@settings(max_examples=100)
@given(st.integers(1, 2**300), st.integers(-400, 100), st.booleans())
def test_more_bits_are_rounded_to_even(mantissa, exponent, negative):
    exact = (-1) ** negative * mantissa * Fraction(2) ** exponent
    with mp.workprec(400):
        value = mp.mpf(mantissa) * mp.mpf(2) ** exponent * (-1) ** negative
    assert binary128.exact(number(bits_of(value))) == round_binary(exact, 113)
    assert binary128.exact(binary128.quad(value)) == round_binary(exact, 113)


@settings(max_examples=80)
@given(st.floats(allow_nan=False, allow_infinity=False) | st.integers(-2**100, 2**100))
def test_other_types_are_taken_by_value(value):
    assert binary128.exact(binary128.quad(value)) == Fraction(value)
    if isinstance(value, float):
        assert binary128.exact(binary128.quad(np.longdouble(value) / 3)) == Fraction(
            *(np.longdouble(value) / 3).as_integer_ratio())


def test_arithmetic_has_113_bits_whatever_mpmath_is_set_to():
    with mp.workprec(20):
        third = binary128.quad(1) / 3
    assert binary128.exact(third) == round_binary(Fraction(1, 3), 113)
    assert pickle.loads(pickle.dumps(third)) == third


def test_literals_and_coefficients_are_correctly_rounded():
    step, real = stepper("G-L", 2), REALS["float128"]
    with mp.workdps(60):
        value = mp.mpf(real.literal(Fraction(1, 3)).removesuffix("F128"))
    assert binary128.exact(binary128.quad(value)) == round_binary(Fraction(1, 3), 113)
    compiled = step.binding.coefficients()
    exact = np.ravel(np.array(tableau_of("G-L", 2).A, dtype=object))
    expected = [round_binary(binary128.exact(x), 113) for x in exact]
    assert all(number in compiled for number in expected)


@pytest.mark.parametrize("method", [
    ("G-L", 2), *(pytest.param(method, marks=pytest.mark.slow)  # seconds of mpmath each
                  for method in (("IMS", None), ("EMS", None), ("LIIIA-B", 3)))], ids=str)
def test_a_step_against_fifty_digits(method):
    step, rng = stepper(*method), np.random.default_rng(5)
    for index in range(3):
        case = random_case(rng, "gamma")
        parameters = {name: binary128.quad(x) * 10 / 9 for name, x in case.parameters.items()}
        q, p = step.project(case.q, case.p, parameters=parameters)
        case = replace(case, q=q, p=p, dt=binary128.quad(case.dt) / 3 * (-1) ** index,
                       parameters=parameters)
        exact = reference(Spec(*method), case).step()
        for solver in ("auto", "newton", "python"):
            end = integrate(step, q, p, dt=case.dt, steps=1, parameters=case.parameters,
                            solver=solver)
            with mp.workdps(50):
                errors = [largest(exact.q - end.q[1]), largest(exact.p - end.p[1])]
                assert errors[0] <= 32 * EPS
                assert errors[1] <= 32 * EPS * largest(exact.p)


@pytest.mark.parametrize("stages", [
    2, *(pytest.param(s, marks=pytest.mark.slow) for s in (1, 3, 4, 5, 6, 7, 8))])
def test_order_is_twice_the_stages(stages):
    """The fast top's differences, at 126 rad/s over 1/128 s, fall by 2²ˢ as dt is halved."""
    top = fast_top()
    parameters = {name: top.parameters[name] for name in ("I1", "I2", "I3", "mgl")}
    parameters["gamma"] = gs.gamma(top.inertia)
    step = stepper("G-L", stages)
    q, p = step.project(top.q0, top.p0, parameters=parameters)
    ends = [step.integrate(q, p, dt=2.0**-e, steps=2 ** (e - 7), parameters=parameters).q[-1]
            for e in (8, 9, 10)]
    errors = [float(largest(b - a)) for a, b in pairwise(ends)]
    assert 1e-33 < errors[1] < errors[0] < 1e-2
    assert abs(log2(errors[0] / errors[1]) - 2 * stages) < 0.1


def test_constraints_hold_to_round_off_and_the_manifest_says_float128(monkeypatch):
    """The run is stored across chunks."""
    monkeypatch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", 10)
    step = stepper("G-L", 2)
    run = step.integrate(*start(step), dt=2.0**-6, steps=200, every=7, parameters=TOP)
    assert step.manifest.real == "float128"
    assert step.name == "heavy_top_gl2_gamma_float128"
    assert 0 < run.report.constraint_max < 4 * EPS
    assert run.report.momentum_constraint_max < 8 * EPS
    assert isinstance(run.report.constraint_max, float)
    assert run.q.dtype == object
    assert run.q.shape == (30, 4)
    assert type(run.q[3, 1]) is binary128.mpf
    assert run.axis().dtype == float
    assert largest(run.g_errors) <= 4 * EPS


@pytest.mark.parametrize(("q", "message"), [
    ([1, 0, 0], "shape"),
    ([1, 0, 0, float("nan")], "not finite"),
    ([1, 0, 0, mp.inf], "not finite"),
    ([1, 0, 0, mp.mpf(2) ** 16384], "too large"),
    ([1, 0, 0, "0"], "real numbers"),
    ([1, 0, 0, mp.mpc(0, 1)], "real numbers"),
])
def test_unusable_states(q, message):
    with pytest.raises(InputError, match=message):
        stepper("G-L", 2).step(q, [0, 1, 0, 0], dt=0.1, parameters=TOP)


def test_a_start_consistent_in_double_alone_is_refused():
    step = stepper("G-L", 2)
    with pytest.raises(InputError, match="constraints"):
        step.step([np.cos(0.3), np.sin(0.3), 0, 0], [0, 0, 1, 0], dt=0.01, parameters=TOP)


def test_a_compiler_without_binary128_says_so(monkeypatch, tmp_path):
    real = find_compiler()
    script = tmp_path / "cc"
    script.write_text("#!/bin/sh\n"
                      f"case \"$1\" in --version) exec {real.command[0]} --version;; esac\n"
                      "echo \"error: unknown type name '_Float128'\" >&2; exit 1\n")
    script.chmod(0o755)
    monkeypatch.setenv("CC", str(script))
    with pytest.raises(CompilerError, match=r"float128.*gcc 7") as caught:
        gs.stepper("G-L", 1, "gamma", system="free_body", real="float128")
    assert "_Float128" in caught.value.stderr
