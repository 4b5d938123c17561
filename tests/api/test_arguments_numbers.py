"""What the Python calls take for time steps, parameters and counts, and what they refuse."""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from calls import PARAMETERS, RUN, TOP, refused

BAD_NUMBERS = {"None": None, "word": "0.1", "NaN": np.nan, "inf": np.inf, "-inf": -np.inf,
               "complex": 1j, "bool": True, "list": [0.1], "array": np.array([0.1]),
               "huge": 10**400, "-huge": -10**400, "bytes": b"1", "decimal NaN": Decimal("NaN"),
               "symbol": sp.Symbol("x"), "interval": np.timedelta64(1), "complex mpmath": mp.mpc(1),
               "beyond": mp.mpf(10) ** 400, "infinite": mp.inf, "far beyond": Decimal("1e999999")}


@pytest.mark.parametrize("bad", BAD_NUMBERS.values(), ids=BAD_NUMBERS.keys())
def test_unusable_time_step_is_refused(bad, gl3):
    with refused("^dt = "):
        gl3.step(TOP.q0, TOP.p0, dt=bad, parameters=PARAMETERS)
    with refused("^dt = "):
        gl3.residual(np.zeros(27), TOP.q0, TOP.p0, dt=bad, parameters=PARAMETERS)


def test_zero_time_step_is_refused(gl3):
    for zero in (0, 0.0, -0.0, np.float32(0), Fraction(0)):
        with refused("dt = 0 .*negative"):
            gl3.step(TOP.q0, TOP.p0, dt=zero, parameters=PARAMETERS)


def test_time_step_of_any_real_type(gl3):
    expected = gl3.step(TOP.q0, TOP.p0, dt=0.0078125, parameters=PARAMETERS)
    for dt in (Fraction(1, 128), np.float32(0.0078125), np.longdouble(0.0078125),
               sp.Rational(1, 128), Decimal("0.0078125"), mp.mpf(2) ** -7, sp.Float(2) ** -7,
               sp.sqrt(sp.Rational(1, 2)) ** 14):
        assert np.array_equal(gl3.step(TOP.q0, TOP.p0, dt=dt, parameters=PARAMETERS), expected)


@pytest.mark.parametrize("bad", BAD_NUMBERS.values(), ids=BAD_NUMBERS.keys())
@pytest.mark.parametrize("name", ["I1", "mgl", "gamma"])
def test_unusable_parameter_is_named(bad, name, gl3):
    with refused(f"Parameter {name} = "):
        gl3.step(TOP.q0, TOP.p0, dt=1e-3, parameters=PARAMETERS | {name: bad})


@pytest.mark.parametrize(("name", "value", "cure"), [
    ("gamma", 0, "other than 0"), ("gamma", -0.0, "other than 0"), ("I1", 0, "above 0"),
    ("I2", -1e-3, "above 0"), ("I3", -0.0, "above 0"),
])
def test_parameter_outside_its_domain_is_refused(name, value, cure, gl3):
    with refused(f"Parameter {name} = .*{cure}"):
        gl3.step(TOP.q0, TOP.p0, dt=1e-3, parameters=PARAMETERS | {name: value})


def test_parameter_names_are_checked(gl3):
    for name in PARAMETERS:
        with refused(f"'{name}'.*I1, I2, I3, mgl, gamma"):
            gl3.step(TOP.q0, TOP.p0, dt=1e-3,
                     parameters={k: v for k, v in PARAMETERS.items() if k != name})
    with refused("'alpha'.*I1"):
        gl3.step(TOP.q0, TOP.p0, dt=1e-3, parameters=PARAMETERS | {"alpha": 1})
    for bad in (None, 3, [1, 2], "gamma"):
        with refused("parameters = "):
            gl3.step(TOP.q0, TOP.p0, dt=1e-3, parameters=bad)


def test_alpha_zero_is_refused():
    step = gs.stepper("G-L", 2, "alpha")
    parameters = TOP.parameters | {"alpha": 0}
    with refused("Parameter alpha = 0"):
        step.step(TOP.q0, TOP.p0, dt=1e-3, parameters=parameters)


@pytest.mark.parametrize("bad", [-1, 2.5, "3", None, np.nan, True, [3], 2**64, 10**30])
def test_unusable_counts_are_refused(bad, gl3):
    with refused("steps"):
        gl3.integrate(TOP.q0, TOP.p0, steps=bad, **RUN)
    if not isinstance(bad, int) or bad < 0 or isinstance(bad, bool):
        with refused("^every = "):
            gl3.integrate(TOP.q0, TOP.p0, steps=3, every=bad, **RUN)
        with refused("^max_iterations = "):
            gl3.integrate(TOP.q0, TOP.p0, steps=3, max_iterations=bad, **RUN)


def test_zero_counts_are_refused_where_they_make_no_sense(gl3):
    with refused("every = 0"):
        gl3.integrate(TOP.q0, TOP.p0, steps=3, every=0, **RUN)
    with refused("max_iterations = 0"):
        gl3.integrate(TOP.q0, TOP.p0, steps=3, max_iterations=0, **RUN)


def test_more_states_than_memory_are_refused(gl3):
    for steps in (10**15, 2**62):
        with refused(r"every"):
            gl3.integrate(TOP.q0, TOP.p0, steps=steps, **RUN)


def test_large_limits_are_taken(gl3):
    made = gl3.integrate(TOP.q0, TOP.p0, steps=3, every=10**15, max_iterations=10**15, **RUN)
    assert made.q.shape == (2, 4)


def test_solver_and_tolerance_are_checked(gl3):
    for bad in ("fast", "", None, 3, "Newton"):
        with refused("solver.*auto, newton, fixed-point"):
            gl3.step(TOP.q0, TOP.p0, solver=bad, **RUN)
    for bad in (0, -1e-9, np.nan, np.inf, "1e-9", True):
        with refused("tolerance"):
            gl3.step(TOP.q0, TOP.p0, tolerance=bad, **RUN)
