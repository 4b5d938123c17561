"""Lyapunov exponents: of linear systems, regular and chaotic motions; pairs, volumes, vectors."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from chaotic_pendulum import PARAMETERS, pendulum, released
from gyrospark.runtime.analysis.unitary_frame import (
    UnitaryFrame,
    canonical_form,
    isotropic_flag,
)


@cache
def linear(damped=False):
    """H = p²/2 − k q²/2, and a damping force −c p."""
    q, p = sp.symbols("q p", real=True)
    k, c = sp.symbols("k c", real=True)
    H = p**2 / 2 - k * q**2 / 2
    if damped:
        system = gs.System((q,), (p,), (k, c), H, forces=[-c * p], name="damped_line")
    else:
        system = gs.System((q,), (p,), (k,), H, name="line")
    return gs.stepper("G-L", 4, system=system)


@pytest.mark.slow  # 1 CPU s; other cases run all its branches
def test_saddle():
    """An inverted pendulum has ±√k; its covariant vectors are (1, ±√k)."""
    found = gs.lyapunov(linear(), [0.0], [0.0], dt=0.02, steps=2000, parameters={"k": 4.0},
                        covariant=True)
    assert np.abs(found.exponents - [2, -2]).max() < 3 * found.errors.max() < 0.2
    later = found.running[-1] * found.times[-1] - found.running[99] * found.times[99]
    rates = later / (found.times[-1] - found.times[99])  # without the first seconds
    assert np.abs(rates - [2, -2]).max() < 1e-13
    assert found.pairing < 1e-14
    assert abs(found.ftle - 2) < 0.02
    slopes = found.covariant[50, 1] / found.covariant[50, 0]
    assert np.abs(slopes - [2, -2]).max() < 1e-13


def test_oscillator():
    """Periods are equal, so that directions do not even grow linearly."""
    found = gs.lyapunov(linear(), [1.0], [0.0], dt=0.05, steps=20_000, every=50,
                        parameters={"k": -2.0})
    assert np.abs(found.exponents).max() < 1e-3
    assert abs(found.megno) < 0.1
    assert found.symplectic_defect < 1e-13


@pytest.mark.slow  # 1 CPU s; other cases run all its branches
def test_damping_contracts_volume():
    """Exponents (−c ± √(c² + 4 k))/2 of a damped saddle; their sum is the rate of the volume."""
    found = gs.lyapunov(linear(damped=True), [0.0], [0.0], dt=0.02, steps=2000,
                        parameters={"k": 2.0, "c": 1.0})
    rates = np.diff(found.running[[99, -1]] * found.times[[99, -1], None], axis=0)[0]
    rates /= found.times[-1] - found.times[99]
    assert np.abs(rates - [1, -2]).max() < 1e-13
    assert abs(found.volume_rate + 1) < 1e-13  # of the form, ½ log det: the trace −c
    assert abs(found.exponents.sum() - found.volume_rate) < 1e-12


def test_regular_motion():
    """A large oscillation of a plane pendulum: 0 within errors, MEGNO 2."""
    found = gs.lyapunov(systems.differentiable("pendulum"), [np.sin(2.9), -np.cos(2.9)], [0, 0],
                        dt=0.05, steps=8000, every=40, parameters={"g": 1.0, "l": 1.0})
    assert np.all(np.abs(found.exponents) < 3 * found.errors)
    assert found.exponents[0] < 0.02
    assert abs(found.megno - 2) < 0.25
    assert found.pairing < 1e-13


@pytest.mark.parametrize(("every", "steps"), [
    (40, 1500), *(pytest.param(every, 6000, marks=pytest.mark.slow) for every in (1, 40))])
def test_chaotic_pendulum_is_paired(every, steps):
    """Pairs at any time, though no exponent has converged; the volume is measured without R."""
    found = gs.lyapunov(pendulum(), *released(2, 2), dt=0.01, steps=steps, every=every,
                        parameters=PARAMETERS)
    assert found.pairing < 1e-12
    assert np.abs(found.running + found.running[:, ::-1]).max() < 1e-10
    assert abs(found.volume_rate) < 1e-13
    assert found.symplectic_defect < 1e-13
    assert found.exponents[0] > 0.5
    if steps == 6000:
        assert abs(found.exponents[0] - 1.265) < 2 * found.errors[0] < 0.4  # in a Euclidean norm
        assert abs(found.exponents[1]) < 2 * found.errors[1]
        assert found.megno == pytest.approx(0.5 * 60 * found.exponents[0], rel=0.2)
        assert found.ftle > found.exponents[0]


def test_first_exponents_alone():
    """With count directions are the same ones."""
    arguments = {"dt": 0.01, "steps": 500, "parameters": PARAMETERS}
    every, some = (gs.lyapunov(pendulum(), *released(2, 2), count=count, **arguments)
                   for count in (None, 2))
    assert np.abs(every.exponents[:2] - some.exponents).max() < 1e-12
    assert np.isnan(some.pairing)
    assert np.isnan(some.volume_rate)


def test_covariant_vectors_follow_the_run():
    """The derivative of the run takes each to a multiple of the later one."""
    step, (q, p) = pendulum(), released(2, 2)
    found = gs.lyapunov(step, q, p, dt=0.01, steps=2000, parameters=PARAMETERS, covariant=True)
    run = step.integrate(q, p, dt=0.01, steps=2000, every=10, parameters=PARAMETERS)
    V = found.covariant
    ahead = step.integrate(run.q[80], run.p[80], dt=0.01, steps=200, every=200,
                           parameters=PARAMETERS, tangents=gs.Tangents(start=V[80]))
    end = np.concatenate([ahead.tangents.q[-1], ahead.tangents.p[-1]])
    cosines = np.abs((end * V[100]).sum(axis=0)) / (
        np.linalg.norm(end, axis=0) * np.linalg.norm(V[100], axis=0))
    assert np.abs(cosines - 1).max() < 1e-6


def test_frame_is_unitary():
    """Ω is J, orthogonal and skew; coordinates of directions are those that made them."""
    step, (q, p) = pendulum(), released(0.5, 2)
    frame = UnitaryFrame(step.derivative_binding(), PARAMETERS, 0.0, q, p)
    J, unit = frame.J, np.eye(4)
    assert np.abs(J + J.T).max() < 1e-14
    assert np.abs(J @ J + unit).max() < 1e-14
    B = frame.directions(unit)
    assert np.abs(B.T @ canonical_form(4) @ B - J).max() < 1e-14
    assert np.abs(frame.coordinates(B) - unit).max() < 1e-14
    flag = isotropic_flag(J)
    assert np.abs(flag.T @ flag - unit).max() < 1e-14
    assert np.abs(flag[:, :2].T @ J @ flag[:, :2]).max() < 1e-14


@pytest.mark.parametrize("real", ["float128", pytest.param("float", marks=pytest.mark.slow)])
@pytest.mark.slow  # 2 CPU s; other cases run all its branches
def test_other_types(real):
    step = pendulum(real=real)
    found = gs.lyapunov(step, *released(2, 2, step), dt=0.01, steps=20, parameters=PARAMETERS)
    same = gs.lyapunov(pendulum(), *released(2, 2), dt=0.01, steps=20, parameters=PARAMETERS)
    bound = 1e-3 if real == "float" else 1e-8
    assert np.abs(found.exponents - same.exponents).max() < bound
    assert found.pairing < (1e-5 if real == "float" else 1e-13)


def test_progress_and_display():
    done = []
    found = gs.lyapunov(pendulum(), *released(2, 2), dt=0.01, steps=1200, parameters=PARAMETERS,
                        progress=done.append)
    assert done[-1] == 1200
    assert done == sorted(done)
    assert f"{found.exponents[0]:.4g}" in repr(found)


def test_too_few_decompositions():
    """Half of the digits are lost where directions grow 1e8 times more than others."""
    with pytest.warns(gs.InputWarning, match="every"):
        gs.lyapunov(linear(), [0.0], [0.0], dt=0.1, steps=200, every=100, parameters={"k": 4.0})


@pytest.mark.parametrize(("change", "word"), [
    ({"count": 5}, "4"), ({"count": 0}, "count"), ({"every": 0}, "every"), ({"steps": 0}, "steps"),
    ({"covariant": 1}, "covariant"), ({"progress": 3}, "progress"),
    ({"parameters": {"g": 9.81}}, "l"), ({"solver": "python"}, "python"),
    ({"q": [1, 0, 3, 0]}, "constraints"), ({"stepper": "G-L"}, "stepper"),
])
def test_bad_input(change, word):
    q, p = released(2, 2)
    given = {"stepper": pendulum(), "q": q, "p": p, "dt": 0.01, "steps": 100,
             "parameters": PARAMETERS} | change
    with pytest.raises(gs.InputError, match=word):
        gs.lyapunov(**given)
