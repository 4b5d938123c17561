"""Mechanisms near their change points, and which solver takes their steps."""

import numpy as np
import pytest

import gyrospark as gs
import systems
from mechanisms import GRAVITY, parallelogram, parallelogram_at, slider_crank, slider_crank_at

EPSILON = np.finfo(float).eps
LOOPS = {"parallelogram": (parallelogram, parallelogram_at(1.9, 3.0)),
         "slider_crank": (slider_crank, slider_crank_at(0.3, 3.0))}


@pytest.mark.parametrize(("name", "scheme"), [
    ("slider_crank", ("EMS", None)), ("parallelogram", ("G-L", 1))], ids=str)
@pytest.mark.slow  # a thousand steps beside a change point, with three loops
def test_constraints_hold_where_their_matrix_is_nearly_singular(name, scheme):
    """Sweeps are judged by g too: they left 1.5e-13 beside a change point, Newton 2e-16.

    Places are at most 2, whose last place moves g = |a − b|² − 1 by 4 ε: two of them for sweeps.
    """
    make, start = LOOPS[name]
    step = gs.stepper(*scheme, system=make())
    for solver, most in (("auto", 8), ("newton", 4)):
        made = step.integrate(*start, dt=0.01, steps=1000, parameters=GRAVITY, solver=solver)
        assert made.report.constraint_max <= most * EPSILON
    many = step.integrate_ensemble(np.array([start[0]] * 2), np.array([start[1]] * 2), dt=0.01,
                                   steps=1000, parameters=GRAVITY)
    assert not many.failures
    assert many.members[1].report.constraint_max <= 8 * EPSILON


def test_a_start_at_a_change_point_is_reported():
    """No smaller time step cures it."""
    step, run = systems.stepper("slider_crank"), {"dt": 0.01, "steps": 3, "parameters": GRAVITY}
    with pytest.raises(gs.StepFailed, match="change point") as caught:
        step.integrate(*np.round(slider_crank_at(np.pi / 2, 3.0), 15), **run)
    for constraint in ("'g0'", "'g1'", "'g2'"):
        assert constraint in str(caught.value)
    assert "smaller" not in str(caught.value)
    assert caught.value.dt is None
    assert len(step.integrate(*LOOPS["slider_crank"][1], **run)) == 4
