"""A gradient does not depend on where its steps were kept; a run does not depend on tangents."""

from __future__ import annotations

import numpy as np

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP

RUN = {"dt": 1e-3, "steps": 4000, "every": 250, "parameters": PARAMETERS}


def equal(a, b):
    """Whether two gradients agree bit for bit."""
    return np.array_equal(a.vector(), b.vector()) and np.array_equal(a.inputs, b.inputs)


def test_inputs_have_the_same_bits_from_checkpoints():
    step = systems.differentiable("pushed_pendulum")
    rows = np.random.default_rng(6).normal(size=(3000, 2))
    run = step.integrate([0.6, -0.8], [0.4, 0.3], dt=1e-3, steps=3000, every=10, inputs=rows,
                         parameters={"k": 9.81})
    w = {"q": run.q, "p": 2 * run.p}
    wrt = ("start", "inputs", "k", "dt")
    whole, pieces = (step.gradient(run, w, wrt=wrt, memory=m) for m in ("256 MB", "500 kB"))
    assert whole.inputs.shape == rows.shape
    assert equal(whole, pieces)


def test_a_run_has_its_bits_with_tangents():
    step, given = systems.differentiable("heavy_top"), RUN | {"steps": 600}
    alone = step.integrate(TOP.q0, TOP.p0, **given)
    beside = step.integrate(TOP.q0, TOP.p0, **given,
                            tangents=gs.Tangents(parameters=["I3", "mgl"], dt=True))
    for name in ("t", "q", "p", "multipliers", "iterations", "energies", "g_errors", "f_errors"):
        assert np.array_equal(getattr(alone, name), getattr(beside, name))
    again = step.integrate(TOP.q0, TOP.p0, **given | {"every": 50}, tangents=gs.Tangents(
        start=beside.tangents.start[:, 3], parameters=["mgl"]))
    for column, other in ((3, 0), (7, 1)):  # alone, and stored at other states
        assert np.array_equal(again.tangents.q[-1, :, other], beside.tangents.q[-1, :, column])


def test_a_gradient_is_the_sum_of_tangents():
    """The same of a run whose last state is no stored multiple, and of one step."""
    step = systems.differentiable("heavy_top")
    for steps, every in ((101, 10), (1, 1), (1, 5)):
        run = step.integrate(TOP.q0, TOP.p0, **RUN | {"steps": steps, "every": every},
                             tangents=gs.Tangents(parameters=["I1", "gamma"], dt=True))
        rng = np.random.default_rng(8)
        w = {"q": rng.normal(size=run.q.shape), "p": rng.normal(size=run.p.shape)}
        sums = sum((w[k][:, :, None] * getattr(run.tangents, k)).sum(axis=(0, 1)) for k in w)
        gradient = step.gradient(run, w)
        pulled = [*gradient.start, *(gradient[k] for k in ("I1", "gamma", "dt"))]
        assert np.abs(sums - pulled).max() < 1e-12 * np.abs(sums).max()
