"""Time in Lagrangians: M(q, t), b(q, t), V(q, t), g(q, t); M is factored at times of stages."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import refused
from strategies import EPS
from time_lagrangians import c, k, one, t, wire

NUMBERS = {"w": 2.5, "a": 0.3, "b": 0.25, "g": 9.0}


@pytest.mark.slow  # a stepper for this
def test_bead_on_a_wire_that_turns():
    """r = r₀ cosh wt, pushed by the moment 2 m w r ṙ: a rheonomic constraint in M(q)."""
    step = gs.stepper("G-L", 3, system=wire())
    numbers = {"m": 1.5, "w": 2.0}
    p = step.momenta([0.5, 0.0], [0.0, 2.0], parameters=numbers)
    run = step.integrate([0.5, 0.0], p, dt=0.01, steps=100, parameters=numbers)
    r, speed = 0.5 * np.cosh(2 * run.t), np.sinh(2 * run.t)
    np.testing.assert_allclose(run.q, np.transpose([r, 2 * run.t]), rtol=0, atol=64 * EPS)
    np.testing.assert_allclose(run.velocities, np.transpose([speed, 2 + 0 * r]), atol=256 * EPS)
    moment = -2 * 1.5 * 2 * r[-1] * speed[-1]  # λ has the sign of g_q: ṗ = … − g_qᵀλ
    assert abs(run.multipliers[-1, -1] / moment - 1) < 1e-6  # of a lower order than the state
    np.testing.assert_allclose(run.work, run.energies - run.energies[0], rtol=0, atol=1e-12)
    with refused("constraint"):
        step.integrate(gs.Start([0.5, 0.0], p, t=1.0), dt=0.01, steps=1, parameters=numbers)


def test_states_between_steps_and_crossings():
    """``at`` against half the step, an event where a coordinate passes its level."""
    step = systems.stepper("shaken")
    p = step.momenta([0.5], [0.1], parameters=NUMBERS)
    run, fine = (step.integrate([0.5], p, dt=0.02 / n, steps=100 * n, parameters=NUMBERS,
                                events=[gs.Event("x", level=0.2)]) for n in (1, 2))
    between = run.at(fine.t)
    np.testing.assert_allclose(between.q, fine.q, rtol=0, atol=1e-6)
    np.testing.assert_allclose(between.velocities, fine.velocities, rtol=0, atol=1e-5)
    found, same = run.events["x"], fine.events["x"]
    assert len(found.t) == len(same.t) >= 2
    np.testing.assert_allclose(found.t, same.t, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.q, 0.2, rtol=0, atol=8 * EPS)


def test_time_that_nobody_declared_is_refused():
    x, v, _ = one("x")
    with refused("unknown.*'t'.*time"):
        gs.System.from_lagrangian(t * v**2, [x], [v], [])
    with refused("Constraint 0.*'t'.*holonomic"):
        gs.System.from_lagrangian(v**2 + c**2, [x, k], [v, c], [], [x - t])
