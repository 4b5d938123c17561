"""Steps that cross a switch of H or the forces: the side is taken, and such steps are counted."""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs

x, p, t = sp.symbols("x p t", real=True)
c = sp.Symbol("c", positive=True)
RUN = {"dt": 0.0313, "steps": 400, "parameters": {"c": 0.1}}


@cache
def swing(name, force):
    """An oscillator with a force that switches sides."""
    return gs.stepper("G-L", stages=2, system=gs.System(
        (x,), (p,), (c,), p**2 / 2 + x**2 / 2, forces=(force,), time=t, name=name))


def kinked():
    """Continuous forces with a kink in x and one in time."""
    return swing("kinked", c * (sp.Piecewise((t - 1, t > 1), (0, True)) - sp.Abs(x) * p))


def changes(values):
    return int((np.diff(np.sign(values)) != 0).sum())


@pytest.mark.slow  # 1 CPU s; other cases run all its branches
def test_continuous_forces_are_counted_and_differentiated():
    """Derivatives are continuous, and the limits of differences."""
    step, run_options = kinked(), RUN | {"t0": 2.0}
    run = step.integrate([1.0], [0.02], **run_options, tangents=gs.Tangents(None, ["c"]))
    assert run.tangents.switched_steps == changes(run.q[:, 0]) > 0
    for memory in ("256 MB", "80 kB"):
        assert run.gradient({"q": [1.0]}, memory=memory).switched_steps == changes(run.q[:, 0])
    low, high = (step.integrate([1.0], [0.02], **run_options | {"parameters": {"c": 0.1 + e}})
                 for e in (-1e-5, 1e-5))
    slope = (high.q[-1, 0] - low.q[-1, 0]) / 2e-5
    assert run.gradient({"q": [1.0]})["c"] == pytest.approx(slope, rel=1e-6)


def test_forces_that_jump_are_warned_of():
    step = swing("dry", -c * sp.Piecewise((p, x < 0), (2 * p, True)))
    run = step.integrate([1.0], [0.02], **RUN)
    crossed = changes(run.q[:, 0])
    with pytest.warns(gs.InputWarning, match=f"^{crossed} steps"):
        assert run.gradient({"q": [1.0]}).switched_steps == crossed
    still = step.integrate([1.0], [0.02], **RUN | {"steps": 3})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert still.gradient({"q": [1.0]}).switched_steps == 0


def test_switches_of_the_time_are_counted():
    step = kinked()
    run = step.integrate([1.0], [0.0], **RUN | {"steps": 20}, t0=0.7)
    assert run.gradient({"q": [1.0]}).switched_steps == 1
    late = step.integrate([1.0], [0.0], **RUN | {"steps": 20}, t0=2.0)
    assert late.gradient({"q": [1.0]}).switched_steps == 0
