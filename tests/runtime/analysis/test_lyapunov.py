"""Lyapunov exponents: of linear systems, regular and chaotic motions; pairs, volumes, vectors."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import by_names
from chaotic_pendulum import PARAMETERS, pendulum, released
from gyrospark.runtime.analysis.unitary_frame import (
    UnitaryFrame,
    _inverse_mass,
    canonical_form,
    isotropic_flag,
)

#: A pendulum that stands on its head, at which x'' = x.
SADDLE = {"q": [0.0, 1.0], "p": [0.0, 0.0], "parameters": {"m": 1.0, "g": 1.0, "l": 1.0}}


def test_saddle():
    """Exponents ±1; their vectors are along (x, u) = (1, ±1)."""
    found = by_names(gs.lyapunov, systems.differentiable("pendulum"), **SADDLE, dt=0.01,
                     steps=4000, every=10, covariant=True)
    later = found.running[-1] * found.times[-1] - found.running[199] * found.times[199]
    rates = later / (found.times[-1] - found.times[199])  # without the first seconds
    assert np.abs(rates - [1, -1]).max() < 1e-9  # of order 4
    assert found.pairing < 1e-13
    assert abs(found.ftle - 1) < 1e-8  # the flow is symmetric, of norm e^t
    slopes = found.covariant[200, 2] / found.covariant[200, 0]
    assert np.abs(slopes - [1, -1]).max() < 1e-7


def test_small_oscillations():
    """Periods are equal, so that directions do not even grow linearly."""
    found = gs.lyapunov(systems.differentiable("pendulum"), [1e-4, -np.sqrt(1 - 1e-8)], [0.0, 0.0],
                        dt=0.05, steps=4000, every=50, parameters={"m": 1.0, "g": 2.0, "l": 1.0})
    assert np.abs(found.exponents).max() < 5e-3
    assert abs(found.megno) < 0.1
    assert found.symplectic_defect < 1e-13


def test_damping_contracts_volume():
    """The sum of the exponents of x'' = −k x − c x' is the rate of the volume, −c."""
    values = systems.case("driven_oscillator").parameters
    found = gs.lyapunov(systems.differentiable("driven_oscillator"), [0.0], [0.0], dt=0.02,
                        steps=1000, parameters=values)
    assert abs(found.volume_rate + values["c"]) < 1e-9  # of the form, ½ log det
    assert abs(found.exponents.sum() + values["c"]) < 1e-9


def test_regular_motion():
    """A large oscillation of a plane pendulum: 0 within errors, MEGNO 2."""
    found = gs.lyapunov(systems.differentiable("pendulum"), [np.sin(2.9), -np.cos(2.9)], [0, 0],
                        dt=0.05, steps=8000, every=40, parameters={"m": 1.0, "g": 1.0, "l": 1.0})
    assert np.all(np.abs(found.exponents) < 3 * found.errors)
    assert found.exponents[0] < 0.02
    assert abs(found.megno - 2) < 0.25
    assert found.pairing < 1e-13


@pytest.mark.slow  # thousands of steps of a stepper with three stages
@pytest.mark.parametrize(("every", "steps"), [(40, 1500), (1, 6000), (40, 6000)])
def test_chaotic_pendulum_is_paired(every, steps):
    """Pairs at any time, though no exponent has converged; the volume is measured without R."""
    found = gs.lyapunov(pendulum(stages=3), *released(2, 2), dt=0.01, steps=steps, every=every,
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
    for row in (0, 80):
        ahead = step.integrate(run.q[row], run.p[row], dt=0.01, steps=200, every=200,
                               parameters=PARAMETERS, tangents=gs.Tangents(start=V[row]))
        end = np.concatenate([ahead.tangents.q[-1], ahead.tangents.p[-1]])
        cosines = np.abs((end * V[row + 20]).sum(axis=0)) / (
            np.linalg.norm(end, axis=0) * np.linalg.norm(V[row + 20], axis=0))
        assert np.abs(cosines - 1).max() < 1e-6


def test_frame_is_unitary():
    """Ω is J, orthogonal and skew; coordinates of directions are those that made them."""
    step, (q, p) = pendulum(), released(0.5, 2)
    frame = UnitaryFrame(step._derivative_binding(), PARAMETERS, 0.0, q, p)
    J, unit = frame.J, np.eye(4)
    assert np.abs(J + J.T).max() < 1e-14
    assert np.abs(J @ J + unit).max() < 1e-14
    B = frame.directions(unit)
    assert np.abs(B.T @ canonical_form(4) @ B - J).max() < 1e-14
    assert np.abs(frame.coordinates(B) - unit).max() < 1e-14
    flag = isotropic_flag(J)
    assert np.abs(flag.T @ flag - unit).max() < 1e-14
    assert np.abs(flag[:, :2].T @ J @ flag[:, :2]).max() < 1e-14


def test_progress_and_display():
    done = []
    found = gs.lyapunov(pendulum(), *released(2, 2), dt=0.01, steps=1200, parameters=PARAMETERS,
                        progress=done.append)
    assert done[-1] == 1200
    assert done == sorted(done)
    assert f"{found.exponents[0]:.4g}" in repr(found)
    above, below = found.plot().axes
    assert [line.get_ydata()[-1] for line in above.get_lines()[:4]] == found.exponents.tolist()
    assert below.get_lines()[0].get_ydata()[-1] == found.megno
    assert (above.get_ylabel(), below.get_xlabel()) == ("exponents so far [1/s]", "t [s]")


def test_too_few_decompositions():
    """Half of the digits are lost where directions grow 1e8 times more than others."""
    with pytest.warns(gs.errors.InputWarning, match="every"):
        by_names(gs.lyapunov, systems.differentiable("pendulum"), **SADDLE, dt=0.1, steps=400,
                 every=200)


def test_a_start_near_rest_has_the_metric_of_one_at_rest():
    """A kinetic energy of 1e-18 J has no digit beside a potential one of 1 J."""
    at_rest, near_rest = (
        by_names(gs.lyapunov, systems.differentiable("pendulum"), **SADDLE | {"p": [p, 0.0]},
                 dt=0.01, steps=200, every=10) for p in (0.0, 1e-9))
    assert abs(near_rest.ftle - at_rest.ftle) < 1e-7  # the motion moves by 1e-8


@pytest.mark.slow  # derivatives compiled for this
@pytest.mark.parametrize("k", [0.0, 1e3])
def test_the_metric_is_that_of_small_momenta(k):
    """H is not quadratic in p: differences of larger momenta would give another H_pp.

    T = (1 + x²/4) √(m² + p²): H_pp at p = 0, of which differences by p miss the share (p/m)².
    """
    binding, q = systems.differentiable("relativistic")._derivative_binding(), np.array([0.8, 0.77])
    H_pp = _inverse_mass(binding, {"m": 0.8, "k": k}, 0.0, q, np.array([6e-3, -8e-3]))
    assert H_pp == pytest.approx(1.16 / 0.8 * np.eye(2), rel=1e-3, abs=1e-3)


def test_a_state_without_a_finite_energy_is_refused():
    with pytest.raises(gs.InputError, match="H = inf"):
        gs.lyapunov(systems.differentiable("driven_oscillator"), [1e200], [0.0], dt=0.05,
                    steps=100, parameters=systems.case("driven_oscillator").parameters)


@pytest.mark.parametrize(("change", "word"), [
    ({"count": 5}, "4"), ({"count": 0}, "count"), ({"every": 0}, "every"), ({"steps": 0}, "steps"),
    ({"covariant": 1}, "covariant"), ({"progress": 3}, "progress"),
    ({"parameters": {"g": 9.81}}, "l"),
    ({"q": [1, 0, 3, 0]}, "constraints"),
])
def test_bad_input(change, word):
    q, p = released(2, 2)
    given = {"q": q, "p": p, "dt": 0.01, "steps": 100, "parameters": PARAMETERS} | change
    with pytest.raises(gs.InputError, match=word):
        by_names(gs.lyapunov, pendulum(), **given)
