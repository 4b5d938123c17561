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
    """Sweeps end by the size of g too: they once left 1.5e-13 near a change point, Newton 2e-16.

    Coordinates are at most 2; a last bit of one moves g = |a − b|² − 1 by 4 ε, and sweeps may be
    off by two of them.
    """
    make, start = LOOPS[name]
    step = gs.stepper(*scheme, system=make())
    for solver, bound in (("auto", 8), ("newton", 4)):
        run = step.integrate(*start, dt=0.01, steps=1000, parameters=GRAVITY, solver=solver)
        assert run.report.constraint_max <= bound * EPSILON
    ensemble = step.integrate_ensemble(np.array([start[0]] * 2), np.array([start[1]] * 2), dt=0.01,
                                       steps=1000, parameters=GRAVITY)
    assert not ensemble.failures
    assert ensemble.members[1].report.constraint_max <= 8 * EPSILON


def test_a_start_at_a_change_point_is_reported():
    """The error at a change point names the constraints and does not advise a smaller step."""
    step, run = systems.stepper("slider_crank"), {"dt": 0.01, "steps": 3, "parameters": GRAVITY}
    with pytest.raises(gs.StepFailed, match="change point") as caught:
        step.integrate(*np.round(slider_crank_at(np.pi / 2, 3.0), 15), **run)
    for constraint in ("'g0'", "'g1'", "'g2'"):
        assert constraint in str(caught.value)
    assert "smaller" not in str(caught.value)
    assert caught.value.dt is None
    assert len(step.integrate(*LOOPS["slider_crank"][1], **run)) == 4
