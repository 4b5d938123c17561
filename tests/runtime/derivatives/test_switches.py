"""Steps that cross a switch of H or the forces: the side is taken, and such steps are counted."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs

x, p, t = sp.symbols("x p t", real=True)
c = sp.Symbol("c", positive=True)
RUN = {"dt": 0.0313, "steps": 400, "parameters": {"c": 0.1}}


@pytest.fixture(scope="module")
def step():
    """An oscillator with drag that jumps at x = 0, and a force that begins at t = 1."""
    drag, push = (sp.Piecewise((p, x < 0), (2 * p, True)),
                  sp.Piecewise((t - 1, t > 1), (0, True)))
    return gs.stepper("G-L", stages=1, system=gs.System(
        (x,), (p,), (c,), p**2 / 2 + x**2 / 2, forces=(c * (push - drag),), time=t, name="dry"))


def changes(values):
    return int((np.diff(np.sign(values)) != 0).sum())


def test_forces_that_jump_are_warned_of(step):
    with pytest.warns(gs.errors.InputWarning, match="steps"):
        run = step.integrate(gs.Start([1.0], [0.02], t=2.0), **RUN,
                             tangents=gs.Tangents(None, ["c"]))
    crossed = changes(run.q[:, 0])
    assert run.tangents.switched_steps == crossed > 0
    for memory in ("256 MB", "80 kB"):
        with pytest.warns(gs.errors.InputWarning, match=f"^{crossed} steps"):
            assert run.gradient({"q": [1.0]}, memory=memory).switched_steps == crossed


@pytest.mark.parametrize(("t0", "count"), [(0.7, 1), (2.0, 0)])
def test_switches_of_the_time_are_counted(step, t0, count):
    """Without one there is no warning."""
    run = step.integrate(gs.Start([1.0], [0.0], t=t0), **RUN | {"steps": 20})
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        assert run.gradient({"q": [1.0]}).switched_steps == count
    assert len(told) == count
