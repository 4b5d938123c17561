"""Derivatives of sums over element templates, by iteration, and by factors where that is slow."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import budget
import gyrospark as gs
from derivative_cases import difference, transposition_defect
from structured_systems import BEADS, beads, made_beads, start_of_beads


@cache
def stepper(scheme):
    """Return a stepper of four beads with forces and a drive, its derivatives compiled."""
    step = made_beads(scheme, 2 if scheme == "G-L" else None, True)
    with budget.shared():
        step._derivative_binding()
    return step


def start_of(step):
    return gs.Start(*start_of_beads(step, 0.4), BEADS, 0.4)


@pytest.mark.slow  # a module for this
def test_accelerations_are_second_differences():
    """To h², of rods on a pivot that moves."""
    step, h = stepper("G-L"), 2.0**-8
    start = start_of(step)
    accelerations = step.accelerations(start.q, start.p, parameters=BEADS, t=start.t)
    ahead, back = (step.integrate(start, dt=dt, steps=1).q[1] for dt in (h, -h))
    wanted = (ahead + back - 2 * start.q) / h**2
    assert np.abs(accelerations.q - wanted).max() < 1e-3 * np.abs(wanted).max()


# The iteration contracts by 0.003 to 0.02 a time at 0.02, and by 0.05 to 0.1 at 0.1; at 0.3, with
# 0.4, J is factorised.
@pytest.mark.parametrize(("real", "dt"), [
    ("double", 0.02),
    *(pytest.param("float128", dt, marks=pytest.mark.slow) for dt in (0.02, 0.3))])
def test_tangents_are_the_limits_of_differences(real, dt):
    """By the start, a parameter, dt and the start time."""
    step = stepper("G-L") if real == "double" else gs.stepper("G-L", 2, system=beads(4), real=real)
    size, close = {"double": (2.0**-11, 1e-10), "float128": (2.0**-36, 2e-20)}[real]
    start = start_of(step)
    directions = gs.Tangents("all", ["c"], dt=True, t0=True)
    tangents = step.integrate(start, dt=dt, steps=1, tangents=directions).tangents
    along = tangents.start[:, :-3].T

    def moved(dz, shift, c=0, by_dt=0, by_t0=0):
        parameters = BEADS | {"c": BEADS["c"] + c * shift}
        t = 0.4 + by_t0 * shift
        state = step.consistent(start.q + shift * dz[:8], start.p + shift * dz[8:],
                                parameters=parameters, t=t)
        run = step.integrate(gs.Start(state.q, state.p, parameters, t),
                             dt=dt + by_dt * shift, steps=1)
        return np.concatenate([run.q[-1], run.p[-1]])

    still = 0 * along[0]
    columns = [difference(lambda e, dz=dz: moved(dz, e), size) for dz in along]
    columns += [difference(lambda e, more=more: moved(still, e, **more), size)
                for more in ({"c": 1}, {"by_dt": 1}, {"by_t0": 1})]
    expected, rows = np.array(columns).T, tangents.together()[-1]
    errors = np.abs(rows - expected) / np.abs(expected).max(axis=1)[:, None]
    assert float(errors.max()) < close  # of differences, as for other systems


@pytest.mark.parametrize("dt", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("scheme", [
    "G-L", pytest.param("EMS", marks=pytest.mark.slow)])  # test_steps.py has its mean values
def test_cotangents_are_transposed(scheme, dt):
    step = stepper(scheme)
    assert transposition_defect(step, start_of(step), dt) <= 200 * step.binding.epsilon
