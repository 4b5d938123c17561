"""A gradient does not depend on where its steps were kept; a run does not depend on tangents."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP

RUN = {"dt": 1e-3, "steps": 4000, "every": 250, "parameters": PARAMETERS}


def equal(a, b):
    """Whether two gradients agree bit for bit."""
    return np.array_equal(a.vector(), b.vector()) and np.array_equal(a.inputs, b.inputs)


@pytest.fixture(scope="module")
def swing(gl3):
    """A run of the fast top, and cotangents at its stored states."""
    run = gl3.integrate(TOP.q0, TOP.p0, **RUN)
    rng = np.random.default_rng(5)
    return run, {"q": rng.normal(size=run.q.shape), "p": rng.normal(size=run.p.shape)}


def test_checkpoints_have_the_bits_of_a_gradient(gl3, swing):
    """4000 steps take 1.1 MB: with less, pieces of the run are done again."""
    run, w = swing
    whole, pieces = (gl3.gradient(run, w, memory=memory) for memory in ("256 MB", "1 MB"))
    assert equal(whole, pieces)
    odd = gl3.integrate(TOP.q0, TOP.p0, **RUN | {"steps": 3001, "every": 7})
    ends = {"q": np.ones(odd.q.shape), "p": odd.p}
    assert equal(gl3.gradient(odd, ends), gl3.gradient(odd, ends, memory="700 kB"))


@pytest.mark.slow  # 2 CPU s; other cases run all its branches
def test_checkpoints_of_float128_have_the_bits_of_a_gradient():
    """Its steps are called one by one; they too go on from the checkpoint."""
    step = systems.differentiable("heavy_top", real="float128")
    start = step.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
    run = step.integrate(*start, **RUN | {"steps": 400, "every": 50})
    w = {"q": run.q, "p": run.p}
    whole, pieces = (step.gradient(run, w, memory=memory) for memory in ("256 MB", "210 kB"))
    assert equal(whole, pieces)


def test_running_backwards_has_the_digits_of_a_gradient(gl3, swing):
    run, w = swing
    whole, back = (gl3.gradient(run, w, memory=memory).vector() for memory in ("256 MB", "none"))
    assert np.abs(whole - back).max() < 1e-7 * np.abs(whole).max()


def test_a_stepper_that_was_sent_has_the_same_gradient(gl3, swing):
    run, w = swing
    found = gl3.gradient(run, w)
    sent = pickle.loads(pickle.dumps(gl3))
    assert equal(found, sent.gradient(pickle.loads(pickle.dumps(run)), w))


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


def test_a_run_has_its_bits_with_tangents(gl3):
    given = RUN | {"steps": 600}
    alone = gl3.integrate(TOP.q0, TOP.p0, **given)
    beside = gl3.integrate(TOP.q0, TOP.p0, **given,
                           tangents=gs.Tangents(parameters=["I3", "mgl"], dt=True))
    for name in ("t", "q", "p", "multipliers", "iterations", "energies", "g_errors", "f_errors"):
        assert np.array_equal(getattr(alone, name), getattr(beside, name))
    again = gl3.integrate(TOP.q0, TOP.p0, **given | {"every": 50}, tangents=gs.Tangents(
        start=beside.tangents.start[:, 3], parameters=["mgl"]))
    for column, other in ((3, 0), (7, 1)):  # alone, and stored at other states
        assert np.array_equal(again.tangents.q[-1, :, other], beside.tangents.q[-1, :, column])


def test_a_gradient_is_the_sum_of_tangents(gl3, swing):
    """The same of a run whose last state is no stored multiple, and of one step."""
    for steps, every in ((101, 10), (1, 1), (1, 5)):
        run = gl3.integrate(TOP.q0, TOP.p0, **RUN | {"steps": steps, "every": every},
                            tangents=gs.Tangents(parameters=["I1", "gamma"], dt=True))
        rng = np.random.default_rng(8)
        w = {"q": rng.normal(size=run.q.shape), "p": rng.normal(size=run.p.shape)}
        sums = sum((w[k][:, :, None] * getattr(run.tangents, k)).sum(axis=(0, 1)) for k in w)
        gradient = gl3.gradient(run, w)
        pulled = [*gradient.start, *(gradient[k] for k in ("I1", "gamma", "dt"))]
        assert np.abs(sums - pulled).max() < 1e-12 * np.abs(sums).max()


@pytest.mark.parametrize("hold", [1, 4])
def test_inputs_that_are_held(hold):
    """A row of inputs is held for ``hold`` steps: against differences of whole runs."""
    step = systems.differentiable("pushed_pendulum")
    rows = np.random.default_rng(7).normal(size=(5, 2))
    given = {"dt": 0.05, "steps": 5 * hold, "parameters": {"k": 9.81}, "hold": hold}

    def last(rows):
        return step.integrate([0.6, -0.8], [0.4, 0.3], inputs=rows, **given)

    gradient = step.gradient(last(rows), {"q": np.array([1.0, 2.0])}, wrt=["inputs"])
    assert gradient.inputs.shape == rows.shape
    for place in ((0, 0), (2, 1), (4, 0)):
        shift = np.zeros(rows.shape)
        shift[place] = 1e-5
        slope = (last(rows + shift).q[-1] - last(rows - shift).q[-1]) @ [1.0, 2.0] / 2e-5
        assert abs(slope - gradient.inputs[place]) < 1e-8 * np.abs(gradient.inputs).max()
