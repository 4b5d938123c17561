"""What the Python calls take for states and unknowns, and what they refuse."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import mpmath as mp
import numpy as np
import sympy as sp

import gyrospark as gs
import systems
from calls import PARAMETERS, RUN, TOP, equal, refused


def test_arrays_are_converted_by_value(gl3):
    """The same numbers in any dress give the same bits; the caller's array is not written to."""
    wide = np.zeros((4, 6))
    wide[:, 3] = TOP.q0
    backwards = TOP.q0[::-1].copy()
    matrix = np.asfortranarray(np.array([TOP.q0, TOP.p0]))
    expected = gl3.integrate(TOP.q0, TOP.p0, steps=3, **RUN)
    swapped = TOP.q0.astype(TOP.q0.dtype.newbyteorder())
    for q in (TOP.q0.tolist(), tuple(TOP.q0.tolist()), wide[:, 3], backwards[::-1], matrix[0],
              TOP.q0.astype(np.longdouble), swapped, np.float64(1) * TOP.q0, memoryview(TOP.q0)):
        before = np.array(q).tobytes()
        assert equal(gl3.integrate(q, TOP.p0, steps=3, **RUN), expected)
        assert np.array(q).tobytes() == before


def test_integers_and_other_floats_are_converted():
    step = systems.stepper("heavy_top")
    q, p = [1, 0, 0, 0], [0, 1, 2, -3]
    expected = step.step(np.array(q, dtype=float), np.array(p, dtype=float), **RUN)
    for kind in (int, np.int8, np.int64, np.float16, np.float32, np.longdouble, np.uint8):
        q1 = np.array(q).astype(kind)
        p1 = p if kind is np.uint8 else np.array(p).astype(kind)
        made = step.step(q1, p1, **RUN)
        assert np.array_equal(made, expected)
        assert made[0].dtype == np.float64


def test_exact_numbers_are_converted(gl3):
    """Each rounded once: to the double next to it."""
    expected = gl3.step([0.6, 0.8, 0, 0], [0, 0, 1, 2], **RUN)
    for q in ([Fraction(3, 5), Fraction(4, 5), 0, 0], [Decimal("0.6"), Decimal("0.8"), 0, 0],
              [sp.Rational(3, 5), sp.Rational(4, 5), sp.Integer(0), 0],
              [mp.mpf("0.6"), mp.mpf("0.8"), mp.mpf(0), 0],
              np.array([0.6, 0.8, 0, 0], dtype=object)):
        assert np.array_equal(gl3.step(q, [0, 0, 1, 2], **RUN), expected)


def test_energy_of_many_states(gl3):
    """Leading axes are kept; NaN, which fills a failed ensemble member, stays NaN."""
    made = gl3.integrate(TOP.q0, TOP.p0, steps=5, **RUN)
    assert np.array_equal(gl3.energy(made.q, made.p, parameters=PARAMETERS), made.energy())
    q, p = (np.stack([part, part]).astype(np.longdouble) for part in (made.q, made.p))
    q[1, 2] = np.nan
    H = gl3.energy(q, p, parameters=PARAMETERS)
    assert np.array_equal(H[0], made.energy())
    assert np.isnan(H[1]).tolist() == [False, False, True, False, False, False]
    assert gl3.energy(TOP.q0, TOP.p0, parameters=PARAMETERS).shape == ()
    for q, p in ((made.q, made.p[1:]), (made.q[:, :3], made.p[:, :3]), (1.0, 1.0)):
        with refused("shape"):
            gl3.energy(q, p, parameters=PARAMETERS)


def test_unusable_unknowns_are_refused(gl3):
    for bad in (np.zeros(26), np.zeros((27, 1)), np.full(27, np.nan), np.zeros(27, complex), None):
        with refused("^x "):
            gl3.residual(bad, TOP.q0, TOP.p0, **RUN)
        with refused("^x "):
            gl3.jacobian(bad, TOP.q0, TOP.p0, **RUN)


def test_too_large_for_float_is_refused():
    """What overflows on conversion is named, without a warning."""
    step = systems.stepper("heavy_top", real="float")
    with refused("float32"):
        step.defects([1e300, 0, 0, 0], [0, 0, 0, 0], parameters=PARAMETERS)


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
