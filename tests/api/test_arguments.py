"""Accepted and refused arguments of Python calls, starts on and off the constraint, and results."""

from __future__ import annotations

import json
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import PARAMETERS, RUN, TOP, equal, refused
from gyrospark import api
from gyrospark.api import stepper_of
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from processes import ROOT


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
    projected_twice = gl3.project(q, p, parameters=PARAMETERS)
    assert np.allclose(projected_twice, (q, p), rtol=0, atol=1e-16)


def test_hopeless_projection_is_an_error(gl3):
    with pytest.raises(gs.GyrosparkError, match="projected"):
        gl3.project([0, 0, 0, 0], TOP.p0, parameters=PARAMETERS)


@pytest.mark.parametrize("dt", [1e-5, 1e-2])
def test_results_of_long_runs_are_starts_again(dt):
    """EMS lets qᵀp oscillate; each of its states is accepted as a start."""
    step = systems.stepper("heavy_top", "EMS")
    for inertia in ((0.002, 0.0013, 0.0008), (1.0, 0.9, 0.1)):
        body = gs.problems.free_body(inertia, (3.0, -4.0, 10.0))
        run = {"dt": dt, "parameters": body.parameters | {"gamma": 0.7 * gs.gamma(inertia)}}
        trajectory = step.integrate(body.q0, body.p0, steps=3000, **run)
        for k in range(0, 3001, 100):
            step.step(trajectory.q[k], trajectory.p[k], **run)


@pytest.mark.parametrize(("steps", "every"), [(0, 5), (1, 1), (7, 3), (6, 3), (2, 5),
                                              (8193, 4096), (4097, 1)])
def test_every_stores_every_kth_and_the_last(steps, every, gl3):
    full_run = gl3.integrate(TOP.q0, TOP.p0, steps=steps, **RUN)
    thinned = gl3.integrate(TOP.q0, TOP.p0, steps=steps, every=every, **RUN)
    rows = sorted({*range(0, steps + 1, every), steps})
    assert len(thinned) == len(rows)
    for name in ("t", "q", "p", "energies", "g_errors", "f_errors"):
        assert np.array_equal(getattr(thinned, name), getattr(full_run, name)[rows]), name
    if steps:
        assert np.array_equal(thinned.multipliers, full_run.multipliers[np.array(rows[1:]) - 1])
        iterations_max = [full_run.iterations[a:b].max() for a, b in pairwise(rows)]
        assert thinned.iterations.tolist() == iterations_max
    assert thinned.report == full_run.report
    assert thinned.t[-1] == steps * 1e-3


def test_shapes_are_those_of_the_contract(step):
    trajectory = step.integrate(TOP.q0, TOP.p0, steps=5, **RUN)
    nodes = step.manifest.scheme.multipliers
    assert trajectory.t.shape == (6,)
    assert trajectory.q.shape == trajectory.p.shape == (6, 4)
    assert trajectory.multipliers.shape == (5, nodes)
    assert trajectory.iterations.shape == (5,)
    assert trajectory.energy().shape == (6,)
    assert trajectory.angular_velocity().shape == trajectory.axis().shape == (6, 3)
    assert trajectory.q.dtype == trajectory.p.dtype == np.float64
    assert trajectory.iterations.dtype.kind == "i"
    assert np.array_equal(trajectory.q[0], TOP.q0)
    assert np.array_equal(trajectory.t, np.arange(6) * 1e-3)
    x = step.guess(TOP.q0, TOP.p0, **RUN)
    assert x.shape == (step.unknowns,)
    assert step.residual(x, TOP.q0, TOP.p0, **RUN).shape == (step.unknowns,)
    assert step.jacobian(x, TOP.q0, TOP.p0, **RUN).shape == (step.unknowns, step.unknowns)


def test_no_steps_give_the_start(step):
    trajectory = step.integrate(TOP.q0, TOP.p0, steps=0, **RUN)
    assert np.array_equal(trajectory.q, [TOP.q0])
    assert trajectory.iterations.shape == (0,)
    assert trajectory.multipliers.shape == (0, step.manifest.scheme.multipliers)
    assert trajectory.report.steps == 0
    assert trajectory.report.energy_start == trajectory.energy()[0]
    assert trajectory.report.energy_error_max == 0
    assert trajectory.report.iterations_mean == 0
    assert trajectory.report.q == tuple(TOP.q0)


def test_report_is_of_every_step(step):
    """The report covers every step, not only the stored ones; means run over k = 0..N."""
    full_run = step.integrate(TOP.q0, TOP.p0, steps=100, **RUN)
    thinned = step.integrate(TOP.q0, TOP.p0, steps=100, every=33, **RUN)
    assert thinned.report == full_run.report
    report, errors = full_run.report, np.abs(full_run.energy() - full_run.energy()[0])
    assert report.energy_error_max == pytest.approx(errors.max(), rel=1e-9, abs=4e-15)
    assert report.energy_error_mean == pytest.approx(errors.mean(), rel=1e-9, abs=4e-15)
    g, f = full_run.constraint_errors()
    assert report.constraint_max == pytest.approx(g.max(), abs=3e-16)
    assert report.momentum_constraint_max == pytest.approx(f.max(), abs=1e-16)
    assert report.iterations == full_run.iterations.sum()
    assert report.iterations_max == full_run.iterations.max()
    assert report.q == tuple(full_run.q[-1])


def test_progress_counts_up_to_the_end(gl3):
    reports = []
    gl3.integrate(TOP.q0, TOP.p0, steps=10_001, every=7, progress=reports.append, **RUN)
    assert reports == sorted(reports)
    assert reports[-1] == 10_001
    reports.clear()
    gl3.integrate(TOP.q0, TOP.p0, steps=20_000, every=20_000, progress=reports.append, **RUN)
    assert len(reports) >= 4  # Ctrl-C is heard as often, however seldom states are stored


def test_exception_of_progress_is_passed_on(gl3):
    def stop(done):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        gl3.integrate(TOP.q0, TOP.p0, steps=10_000, progress=stop, **RUN)


def test_arrays_are_converted_by_value(gl3):
    """The same numbers in any form have the same bits; the caller's array stays unchanged."""
    wide = np.zeros((4, 6))
    wide[:, 3] = TOP.q0
    backwards = TOP.q0[::-1].copy()
    matrix = np.asfortranarray(np.array([TOP.q0, TOP.p0]))
    expected = gl3.integrate(TOP.q0, TOP.p0, steps=3, **RUN)
    swapped = TOP.q0.astype(TOP.q0.dtype.newbyteorder())
    for q in (TOP.q0.tolist(), tuple(TOP.q0.tolist()), wide[:, 3], backwards[::-1], matrix[0],
              TOP.q0.astype(np.longdouble), swapped, np.float64(1) * TOP.q0, memoryview(TOP.q0)):
        bytes_of_q = np.array(q).tobytes()
        assert equal(gl3.integrate(q, TOP.p0, steps=3, **RUN), expected)
        assert np.array(q).tobytes() == bytes_of_q


def test_integers_and_other_floats_are_converted():
    step = systems.stepper("heavy_top")
    q, p = [1, 0, 0, 0], [0, 1, 2, -3]
    expected = step.step(np.array(q, dtype=float), np.array(p, dtype=float), **RUN)
    for kind in (int, np.int8, np.int64, np.float16, np.float32, np.longdouble, np.uint8):
        q1 = np.array(q).astype(kind)
        p1 = p if kind is np.uint8 else np.array(p).astype(kind)
        state = step.step(q1, p1, **RUN)
        assert np.array_equal(state, expected)
        assert state[0].dtype == np.float64


def test_exact_numbers_are_converted(gl3):
    """Each is rounded once, to the nearest double."""
    expected = gl3.step([0.6, 0.8, 0, 0], [0, 0, 1, 2], **RUN)
    for q in ([Fraction(3, 5), Fraction(4, 5), 0, 0], [Decimal("0.6"), Decimal("0.8"), 0, 0],
              [sp.Rational(3, 5), sp.Rational(4, 5), sp.Integer(0), 0],
              [mp.mpf("0.6"), mp.mpf("0.8"), mp.mpf(0), 0],
              np.array([0.6, 0.8, 0, 0], dtype=object)):
        assert np.array_equal(gl3.step(q, [0, 0, 1, 2], **RUN), expected)


def test_energy_of_many_states(gl3):
    """Leading axes stay; NaN, which fills a failed ensemble member, stays NaN."""
    trajectory = gl3.integrate(TOP.q0, TOP.p0, steps=5, **RUN)
    assert np.array_equal(gl3.energy(trajectory.q, trajectory.p, parameters=PARAMETERS),
                          trajectory.energy())
    q, p = (np.stack([values, values]).astype(np.longdouble)
            for values in (trajectory.q, trajectory.p))
    q[1, 2] = np.nan
    H = gl3.energy(q, p, parameters=PARAMETERS)
    assert np.array_equal(H[0], trajectory.energy())
    assert np.isnan(H[1]).tolist() == [False, False, True, False, False, False]
    assert gl3.energy(TOP.q0, TOP.p0, parameters=PARAMETERS).shape == ()
    for q, p in ((trajectory.q, trajectory.p[1:]), (trajectory.q[:, :3], trajectory.p[:, :3]),
                 (1.0, 1.0)):
        with refused("shape"):
            gl3.energy(q, p, parameters=PARAMETERS)


def test_unusable_unknowns_are_refused(gl3):
    for bad in (np.zeros(26), np.zeros((27, 1)), np.full(27, np.nan), np.zeros(27, complex), None):
        with refused("^x "):
            gl3.residual(bad, TOP.q0, TOP.p0, **RUN)
        with refused("^x "):
            gl3.jacobian(bad, TOP.q0, TOP.p0, **RUN)


def test_too_large_for_float_is_refused():
    """A number that overflows on conversion is named, without a warning."""
    step = systems.stepper("heavy_top", real="float")
    with refused("float32"):
        step.defects([1e300, 0, 0, 0], [0, 0, 0, 0], parameters=PARAMETERS)


def test_time_step_of_any_real_type(gl3):
    expected = gl3.step(TOP.q0, TOP.p0, dt=0.0078125, parameters=PARAMETERS)
    for dt in (Fraction(1, 128), np.float32(0.0078125), np.longdouble(0.0078125),
               sp.Rational(1, 128), Decimal("0.0078125"), mp.mpf(2) ** -7, sp.Float(2) ** -7,
               sp.sqrt(sp.Rational(1, 2)) ** 14):
        assert np.array_equal(gl3.step(TOP.q0, TOP.p0, dt=dt, parameters=PARAMETERS), expected)


def test_a_model_keeps_the_digits_of_its_time_step():
    assert replace(gs.models.double_pendulum(), dt=Fraction(1, 3)).dt == Fraction(1, 3)


def test_more_states_than_memory_are_refused(gl3):
    for steps in (10**15, 2**62):
        with refused(r"every"):
            gl3.integrate(TOP.q0, TOP.p0, steps=steps, **RUN)


def test_large_limits_are_taken(gl3):
    trajectory = gl3.integrate(TOP.q0, TOP.p0, steps=3, every=10**15,
                               solver=gs.Solver("auto", max_iterations=10**15), **RUN)
    assert trajectory.q.shape == (2, 4)


@pytest.mark.parametrize(("arguments", "words"), [
    (("RK4",), "'RK4'.*LIIIA-B, Radau-L or splitting"), (("RK4",), "'RK4'.*tableau"),
    ((3,), "3.*IMS"),
    (("G-L", 0), "0.*1 to 16"), (("G-L", -1), "-1"),
    (("G-L", 17), "17.*16"), (("G-L", "three"), "'three'"), (("G-L", 2.5), "2.5.*whole"),
    (("G-L", True), "True.*whole"), (("LIIIA-B", 1), "1.*2 to 16"), (("IMS", 2), "no stages"),
    (("IMS", None, "beta"), "'beta'.*gamma"),
], ids=str)
def test_unusable_stepper_choice_is_refused(arguments, words):
    with refused(words):
        gs.stepper(*arguments)


def test_whole_numbers_of_any_type_count_stages():
    for two in (np.int64(2), 2.0, np.float32(2)):
        assert gs.stepper("G-L", two).name == "heavy_top_gl2_gamma"


def test_problems_of_a_sweep_have_the_stepper_of_the_process():
    assert stepper_of(Spec.from_arguments("G-L", 2)) is stepper_of(Spec.from_arguments("G-L", 2))


def test_unusable_system_and_tableau_are_refused():
    tableau = gs.tableau("G-L", 2)
    pendulum = gs.System(sp.symbols("x:2"), sp.symbols("y:2"), (),
                         H=sum(y**2 for y in sp.symbols("y:2")) / 2,
                         constraints=[sum(x**2 for x in sp.symbols("x:2")) - 1], name="p")
    for options, words in [
        ({"scheme": "IMS", "system": "car"}, "'car'.*heavy_top, free_body.*model file"),
        ({"scheme": "IMS", "system": 42}, "42"),
        ({"scheme": "IMS", "real": "quad"}, "'quad'.*double"),
        ({"tableau": tableau, "real": "quad"}, "'quad'"),
        ({"tableau": tableau, "rep": "beta"}, "'beta'"),
        ({"tableau": tableau, "system": "car"}, "'car'"),
        ({"tableau": tableau, "scheme": "G-L"}, "leave out"),
        ({"tableau": tableau, "stages": 2}, "leave out"),
        ({"tableau": tableau, "order": 4}, "order = 4.*leave out"),
        ({"tableau": tableau, "composition": "SABAG6"}, "'SABAG6'.*leave out"),
        ({"tableau": 42}, "42"),
        ({"tableau": [[1]]}, "tableau"),
        ({"tableau": "none.json"}, "'none.json'"),
        ({"tableau": "none.json", "scheme": "IMS"}, "leave out"),
        ({"tableau": "none.json", "order": 2}, "order = 2.*leave out"),
        ({"tableau": "none.json", "composition": "SABAG6"}, "'SABAG6'.*leave out"),
        ({"scheme": "IMS", "system": pendulum, "rep": "gamma"}, "rep"),
    ]:
        with refused(words):
            gs.stepper(**options)


def test_tableau_object_goes_with_any_named_system(monkeypatch):
    """It does as the named scheme does; free_body is not silently replaced by heavy_top."""
    tableau = gs.tableau(ROOT / "examples" / "tableaux" / "radau_plain_2.json")
    source = generate(Spec.of_tableau("gamma", "free_body"), tableau=tableau).source
    monkeypatch.setattr(api, "stepper_of", lambda *given, **more: given)
    spec, system, of_object = gs.stepper(tableau=tableau, system="free_body", rep="gamma")[:3]
    assert (spec.system, system, of_object) == ("free_body", None, tableau)
    assert source.name.startswith("free_body_")
    assert set(json.loads(source.manifest)["system"]["parameters"]) == {"I1", "I2", "I3", "gamma"}


def test_unusable_tableau_request_is_refused():
    for arguments, words in [(("IMS",), "SPARK"), (("G-L", 0), "1 to 16"), (("RK4", 4), "'RK4'"),
                             (("none.json",), "'none.json'"), ((Path("none"),), "'none'"),
                             ((ROOT / "examples/tableaux/gauss_lobatto_2.json", 2), "leave out")]:
        with refused(words):
            gs.tableau(*arguments)
    with refused("name"):
        gs.tableau("G-L", 2, name="mine")
