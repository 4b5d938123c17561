"""∮ p·dq by its spectral derivative: against closed forms, and where it cannot be trusted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
from gyrospark.certificates.loop_invariant import closed_loop, loop_drift, loop_integral
from strategies import EPS

TOP = gs.problems.fast_top()
PARAMETERS = TOP.parameters | {"gamma": gs.gamma(TOP.inertia)}
SIZES = (np.full(4, 1.0), np.full(4, 0.2))


def waves(points, coefficients):
    """Return Σ_k c_k cos ks + d_k sin ks for rows (c_k, d_k), shape (points, n)."""
    s = 2 * np.pi * np.arange(points)[:, None] / points
    return sum(c * np.cos(k * s) + d * np.sin(k * s) for k, (c, d) in enumerate(coefficients, 1))


def test_area_of_an_ellipse():
    s = 2 * np.pi * np.arange(16) / 16
    q, p = (3 * np.cos(s))[:, None], (0.5 * np.sin(s))[:, None]
    value, scale, tail = loop_integral(q, p)
    assert abs(value + 1.5 * np.pi) <= 8 * EPS
    assert abs(scale - 3 * np.pi) <= 16 * EPS  # p dq has one sign, q dp the other
    least_sizes = np.array([3.0]), np.array([0.5])  # 4 · (3 · 0.5 + 0.5 · 3) around
    assert abs(loop_integral(q, p, least_sizes)[1] - 12) <= 0.2
    assert tail == 0.0


@settings(max_examples=5)
@given(seed=st.integers(0, 2**32 - 1), modes=st.integers(1, 7), n=st.integers(1, 5))
def test_any_band_limited_curve(seed, modes, n):
    """∮ p·dq = π Σ_k k (c_k^p d_k^q − d_k^p c_k^q) exactly, wherever the curve lies."""
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal((2, modes, 2, n))
    q, p = waves(32, a) + 10, waves(32, b) - 7
    expected = np.pi * sum(k * (y[0] @ x[1] - y[1] @ x[0])
                           for k, (x, y) in enumerate(zip(a, b, strict=True), 1))
    value, size, _ = loop_integral(q, p)
    assert abs(value - expected) <= 64 * EPS * (size + abs(expected))
    assert abs(value) <= size * (1 + 8 * EPS)


@pytest.mark.parametrize("error", [1e-13, 1e-9])
def test_a_map_that_is_nearly_canonical_is_seen(error):
    """q → (1 + ε) q changes the area by ε; a shear does not change it."""
    s = 2 * np.pi * np.arange(64)[:, None] / 64
    q, p = np.exp(np.cos(s)), np.sin(s + 0.3)
    value, size, _ = loop_integral(q, p)
    sheared, _, _ = loop_integral(q + p**2, p)
    assert abs(sheared - value) <= 16 * EPS * size
    stretched, _, _ = loop_integral((1 + error) * q, p)
    assert abs((stretched - value) / value - error) <= 64 * EPS


def test_a_coarse_curve_is_found_by_its_spectrum():
    s = 2 * np.pi * np.arange(256) / 256
    q, p = (1 / (1.1 - np.cos(s)))[:, None], np.sin(s)[:, None]
    tails = [loop_integral(q[::step], p[::step])[2] for step in (8, 4, 2, 1)]
    assert tails[0] > 1e-3
    assert tails[1] < tails[0] / 10
    assert tails[-1] < 1e-12


def test_loop_lies_on_the_constraints():
    step = gs.stepper("G-L", 2)
    q, p = closed_loop(step, TOP.q0, TOP.p0, SIZES, 0.1, 32, PARAMETERS)
    assert np.abs(np.einsum("ki,ki->k", q, q) - 1).max() <= 4 * EPS
    assert np.abs(np.einsum("ki,ki->k", q, p)).max() <= 4 * EPS
    assert np.abs(q - TOP.q0).max() > 0.05


@pytest.mark.parametrize(("scheme", "stages", "kept"), [("G-L", 2, True), ("EMS", None, False)])
def test_drift_of_schemes(scheme, stages, kept):
    """SPARK drifts by 1e-13 of ∮|p dq| in 400 steps; EMS and IMS by a million times as much."""
    loop = loop_drift(gs.stepper(scheme, stages), TOP.q0, TOP.p0, SIZES, dt=1e-3, steps=400,
                      parameters=PARAMETERS)
    assert loop.is_resolved
    assert abs(loop.start) > 1e-4 * loop.scale
    assert loop.halfway <= loop.drift
    assert loop.drift <= 1e-13 * loop.scale if kept else loop.drift > 1e-8 * loop.scale


@pytest.mark.slow  # thousands of steps of a loop
def test_a_smaller_loop_where_a_large_one_tears():
    """A pencil on its tip parts neighbours by e^30; no loop is resolved, and the result says so."""
    parameters = {"I1": 1.0, "I2": 1.0, "I3": 0.01, "mgl": 9.0, "gamma": 0.5}
    upright = np.array([1.0, 0, 0, 0]), np.array([0, 1e-3, 0, 0])
    step = gs.stepper("G-L", 3)
    short = loop_drift(step, *upright, SIZES, dt=0.02, steps=100, parameters=parameters)
    assert short.is_resolved
    assert short.drift <= 1e-13 * short.scale
    no_room = loop_drift(step, *upright, (1e9 * SIZES[0], SIZES[1]), dt=0.02, steps=300,
                         parameters=parameters)
    assert no_room is None or not no_room.is_resolved or no_room.drift <= 1e-12 * no_room.scale
