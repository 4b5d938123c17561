"""What the Python calls take for time steps, parameters and counts, and what they refuse."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import mpmath as mp
import numpy as np
import sympy as sp

import gyrospark as gs
from calls import PARAMETERS, RUN, TOP, refused


def test_time_step_of_any_real_type(gl3):
    expected = gl3.step(TOP.q0, TOP.p0, dt=0.0078125, parameters=PARAMETERS)
    for dt in (Fraction(1, 128), np.float32(0.0078125), np.longdouble(0.0078125),
               sp.Rational(1, 128), Decimal("0.0078125"), mp.mpf(2) ** -7, sp.Float(2) ** -7,
               sp.sqrt(sp.Rational(1, 2)) ** 14):
        assert np.array_equal(gl3.step(TOP.q0, TOP.p0, dt=dt, parameters=PARAMETERS), expected)


def test_a_model_keeps_the_digits_of_its_time_step():
    assert replace(gs.models.double_pendulum(), dt=Fraction(1, 3)).dt == Fraction(1, 3)


def test_more_states_than_memory_are_refused(gl3):
    for steps in (10**15, 2**62):
        with refused(r"every"):
            gl3.integrate(TOP.q0, TOP.p0, steps=steps, **RUN)


def test_large_limits_are_taken(gl3):
    made = gl3.integrate(TOP.q0, TOP.p0, steps=3, every=10**15,
                         solver=gs.Solver("auto", max_iterations=10**15), **RUN)
    assert made.q.shape == (2, 4)
