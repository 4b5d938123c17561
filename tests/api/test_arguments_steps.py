"""Starts on and off the constraint; what ``step`` and ``integrate`` give back."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import PARAMETERS, RUN, TOP, refused

# ---------------------------------------------------------------- the constraint


@pytest.mark.parametrize(("dq", "dp"), [
    (1e-10, 0), (-1e-6, 0), (0.5, 0), (0, 1e-9), (0, 10), (1e-12, 1e-3)])
def test_start_off_the_constraint_is_refused_and_projection_cures_it(dq, dp, step):
    q, p = TOP.q0 * (1 + dq), TOP.p0 + dp * TOP.q0 * np.linalg.norm(TOP.p0)
    momentum_free = not step.manifest.scheme.keeps_momentum_constraint
    if not (momentum_free and dq == 0 and dp < 1e-3):
        with refused("constraints"):
            step.start(q, p, **RUN)
        with refused(r"constraints.*project\(") as caught:
            step.step(q, p, **RUN)
        g, f = step.defects(q, p, parameters=PARAMETERS)
        assert f"|g(q)| = {abs(g[0]):.3e}" in str(caught.value)
        assert f"q^T p = {abs(f[0]):.3e}" in str(caught.value)
    q, p = step.project(q, p, parameters=PARAMETERS)
    assert abs(q @ q - 1) < 1e-15
    assert abs(q @ p) < 1e-16
    step.step(q, p, **RUN)


def test_projection_is_orthogonal_and_idempotent(gl3):
    q, p = gl3.project(2 * TOP.q0, TOP.p0 + 0.3 * TOP.q0, parameters=PARAMETERS)
    assert np.allclose(q, TOP.q0, rtol=0, atol=1e-15)
    assert np.allclose(p, TOP.p0, rtol=0, atol=1e-16)
    again = gl3.project(q, p, parameters=PARAMETERS)
    assert np.allclose(again, (q, p), rtol=0, atol=1e-16)


def test_hopeless_projection_is_an_error(gl3):
    with pytest.raises(gs.GyrosparkError, match="projected"):
        gl3.project([0, 0, 0, 0], TOP.p0, parameters=PARAMETERS)


@pytest.mark.parametrize("dt", [1e-5, 1e-2])
def test_results_of_long_runs_are_starts_again(dt):
    """EMS lets qᵀp oscillate; whatever it returns, it takes."""
    step = systems.stepper("heavy_top", "EMS")
    for inertia in ((0.002, 0.0013, 0.0008), (1.0, 0.9, 0.1)):
        body = gs.problems.free_body(inertia, (3.0, -4.0, 10.0))
        run = {"dt": dt, "parameters": body.parameters | {"gamma": 0.7 * gs.gamma(inertia)}}
        made = step.integrate(body.q0, body.p0, steps=3000, **run)
        for k in range(0, 3001, 100):
            step.step(made.q[k], made.p[k], **run)


# ---------------------------------------------------------------- shapes


@pytest.mark.parametrize(("steps", "every"), [(0, 5), (1, 1), (7, 3), (6, 3), (2, 5),
                                              (8193, 4096), (4097, 1)])
def test_every_stores_every_kth_and_the_last(steps, every, gl3):
    whole = gl3.integrate(TOP.q0, TOP.p0, steps=steps, **RUN)
    made = gl3.integrate(TOP.q0, TOP.p0, steps=steps, every=every, **RUN)
    rows = sorted({*range(0, steps + 1, every), steps})
    assert len(made) == len(rows)
    for name in ("t", "q", "p", "energies", "g_errors", "f_errors"):
        assert np.array_equal(getattr(made, name), getattr(whole, name)[rows]), name
    if steps:
        assert np.array_equal(made.multipliers, whole.multipliers[np.array(rows[1:]) - 1])
        most = [whole.iterations[a:b].max() for a, b in pairwise(rows)]
        assert made.iterations.tolist() == most
    assert made.report == whole.report
    assert made.t[-1] == steps * 1e-3


def test_shapes_are_those_of_the_contract(step):
    made = step.integrate(TOP.q0, TOP.p0, steps=5, **RUN)
    nodes = step.manifest.scheme.multipliers
    assert made.t.shape == (6,)
    assert made.q.shape == made.p.shape == (6, 4)
    assert made.multipliers.shape == (5, nodes)
    assert made.iterations.shape == (5,)
    assert made.energy().shape == (6,)
    assert made.angular_velocity().shape == made.axis().shape == (6, 3)
    assert made.q.dtype == made.p.dtype == np.float64
    assert made.iterations.dtype.kind == "i"
    assert np.array_equal(made.q[0], TOP.q0)
    assert np.array_equal(made.t, np.arange(6) * 1e-3)
    x = step.guess(TOP.q0, TOP.p0, **RUN)
    assert x.shape == (step.unknowns,)
    assert step.residual(x, TOP.q0, TOP.p0, **RUN).shape == (step.unknowns,)
    assert step.jacobian(x, TOP.q0, TOP.p0, **RUN).shape == (step.unknowns, step.unknowns)


def test_no_steps_give_the_start(step):
    made = step.integrate(TOP.q0, TOP.p0, steps=0, **RUN)
    assert np.array_equal(made.q, [TOP.q0])
    assert made.iterations.shape == (0,)
    assert made.multipliers.shape == (0, step.manifest.scheme.multipliers)
    assert made.report.steps == 0
    assert made.report.energy_start == made.energy()[0]
    assert made.report.energy_error_max == 0
    assert made.report.iterations_mean == 0
    assert made.report.q == tuple(TOP.q0)


def test_report_is_of_every_step(step):
    """Not only of the stored ones; means run over k = 0..N."""
    whole = step.integrate(TOP.q0, TOP.p0, steps=100, **RUN)
    made = step.integrate(TOP.q0, TOP.p0, steps=100, every=33, **RUN)
    assert made.report == whole.report
    report, errors = whole.report, np.abs(whole.energy() - whole.energy()[0])
    assert report.energy_error_max == pytest.approx(errors.max(), rel=1e-9, abs=4e-15)
    assert report.energy_error_mean == pytest.approx(errors.mean(), rel=1e-9, abs=4e-15)
    g, f = whole.constraint_errors()
    assert report.constraint_max == pytest.approx(g.max(), abs=3e-16)
    assert report.momentum_constraint_max == pytest.approx(f.max(), abs=1e-16)
    assert report.iterations == whole.iterations.sum()
    assert report.iterations_max == whole.iterations.max()
    assert report.q == tuple(whole.q[-1])


def test_progress_counts_up_to_the_end(gl3):
    seen = []
    gl3.integrate(TOP.q0, TOP.p0, steps=10_001, every=7, progress=seen.append, **RUN)
    assert seen == sorted(seen)
    assert seen[-1] == 10_001
    seen.clear()
    gl3.integrate(TOP.q0, TOP.p0, steps=20_000, every=20_000, progress=seen.append, **RUN)
    assert len(seen) >= 4  # Ctrl-C is heard as often, however seldom states are kept


def test_exception_of_progress_is_passed_on(gl3):
    def stop(done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        gl3.integrate(TOP.q0, TOP.p0, steps=10_000, progress=stop, **RUN)
