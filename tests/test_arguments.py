"""What the Python calls take and refuse, and what they give back: shapes, failures, files."""

from __future__ import annotations

import copy
import json
import pickle
import threading
import zipfile
from concurrent.futures import ThreadPoolExecutor
from decimal import Decimal
from fractions import Fraction
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from processes import FAST_TOP, ROOT, python

TOP = gs.problems.fast_top()
PARAMETERS = TOP.parameters | {"gamma": gs.gamma_m(TOP.inertia)}
RUN = {"dt": 1e-3, "parameters": PARAMETERS}
SCHEMES = [("IMS", None), ("EMS", None), ("G-L", 1), ("G-L", 3), ("LIIIA-B", 2), ("LIIIA-B", 4)]


def identify(scheme):
    return f"{scheme[1] or ''}{scheme[0]}"


@pytest.fixture(params=SCHEMES, ids=identify)
def step(request):
    """A stepper of each kind."""
    return gs.stepper(*request.param)


@pytest.fixture(scope="module")
def gl3():
    return gs.stepper("G-L", stages=3, rep="gamma")


def equal(a, b):
    """Whether two trajectories agree bit for bit."""
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in
               ("t", "q", "p", "multipliers", "iterations", "energies", "g_errors", "f_errors"))


def refused(message):
    """Expect an InputError, which is a ValueError, with a sentence that has these words."""
    return pytest.raises(gs.InputError, match=message)


# ---------------------------------------------------------------- arrays


def test_arrays_are_converted_by_value(gl3):
    """The same numbers in any dress give the same bits; the caller's array is not written to."""
    wide = np.zeros((4, 6))
    wide[:, 3] = TOP.q0
    backwards = TOP.q0[::-1].copy()
    matrix = np.asfortranarray(np.array([TOP.q0, TOP.p0]))
    expected = gl3.integrate(TOP.q0, TOP.p0, steps=3, **RUN)
    swapped = TOP.q0.astype(TOP.q0.dtype.newbyteorder())
    for q in (TOP.q0.tolist(), tuple(TOP.q0.tolist()), wide[:, 3], backwards[::-1], matrix[0],
              TOP.q0.astype(np.longdouble), swapped, np.float64(1) * TOP.q0, memoryview(TOP.q0)):
        before = np.array(q).tobytes()
        assert equal(gl3.integrate(q, TOP.p0, steps=3, **RUN), expected)
        assert np.array(q).tobytes() == before


def test_integers_and_other_floats_are_converted():
    step = gs.stepper("G-L", 2)
    q, p = [1, 0, 0, 0], [0, 1, 2, -3]
    expected = step.step(np.array(q, dtype=float), np.array(p, dtype=float), **RUN)
    for kind in (int, np.int8, np.int64, np.float16, np.float32, np.longdouble, np.uint8):
        q1 = np.array(q).astype(kind)
        p1 = p if kind is np.uint8 else np.array(p).astype(kind)
        made = step.step(q1, p1, **RUN)
        assert np.array_equal(made, expected)
        assert made[0].dtype == np.float64


def test_float32_start_is_converted_by_value_then_judged(gl3):
    """A float32 unit quaternion is none in double: refused, never reinterpreted."""
    with refused("off the constraints"):
        gl3.step(TOP.q0.astype(np.float32), TOP.p0, **RUN)


BAD_STATES = {
    "short": [1, 0, 0],
    "long": [1, 0, 0, 0, 0],
    "matrix": [[1, 0, 0, 0]],
    "column": [[1], [0], [0], [0]],
    "scalar": 1.0,
    "empty": [],
    "ragged": [1, [0, 0], 0, 0],
    "NaN": [1, 0, np.nan, 0],
    "inf": [1, 0, np.inf, 0],
    "-inf": [1, 0, -np.inf, 0],
    "complex": np.array([1, 0, 0, 0], dtype=complex),
    "bool": [True, False, False, False],
    "words": ["1", "0", "0", "0"],
    "bytes": b"1000",
    "objects": np.array([1, 0, 0, 0], dtype=object),
    "fractions": [Fraction(1), 0, 0, 0],
    "decimals": [Decimal(1), 0, 0, 0],
    "symbols": [sp.Integer(1), 0, 0, 0],
    "huge integers": [10**400, 0, 0, 0],
    "None": None,
    "with None": [None, 0, 0, 0],
    "dict": {"q": 1},
    "set": {1, 2, 3, 4},
    "dates": np.array(["2026-01-01"] * 4, dtype="datetime64[D]"),
    "records": np.zeros(4, dtype=[("a", float)]),
}


@pytest.mark.parametrize("bad", BAD_STATES.values(), ids=BAD_STATES.keys())
def test_unusable_state_is_refused(bad, gl3):
    """By every call that takes a state, with the name of the argument."""
    good = [1, 0, 0, 0]
    calls = [
        lambda q, p: gl3.step(q, p, **RUN),
        lambda q, p: gl3.integrate(q, p, steps=2, **RUN),
        lambda q, p: gl3.residual(np.zeros(27), q, p, **RUN),
        lambda q, p: gl3.jacobian(np.zeros(27), q, p, **RUN),
        lambda q, p: gl3.guess(q, p, **RUN),
        lambda q, p: gl3.defects(q, p, parameters=PARAMETERS),
        lambda q, p: gl3.project(q, p, parameters=PARAMETERS),
    ]
    for call in calls:
        with refused("^q ") as caught:
            call(bad, [0, 0, 0, 0])
        assert isinstance(caught.value, ValueError)
        with refused("^p "):
            call(good, bad)


@pytest.mark.parametrize("bad", [b for k, b in BAD_STATES.items() if k not in (
    "matrix", "NaN", "inf", "-inf")], ids=str)
def test_unusable_states_have_no_energy(bad, gl3):
    with refused("^q "):
        gl3.energy(bad, bad, parameters=PARAMETERS)


def test_energy_of_many_states(gl3):
    """Leading axes are kept; NaN, which fills a failed ensemble member, stays NaN."""
    made = gl3.integrate(TOP.q0, TOP.p0, steps=5, **RUN)
    assert np.array_equal(gl3.energy(made.q, made.p, parameters=PARAMETERS), made.energy())
    q, p = (np.stack([part, part]).astype(np.longdouble) for part in (made.q, made.p))
    q[1, 2] = np.nan
    H = gl3.energy(q, p, parameters=PARAMETERS)
    assert np.array_equal(H[0], made.energy())
    assert np.isnan(H[1]).tolist() == [False, False, True, False, False, False]
    assert gl3.energy(TOP.q0, TOP.p0, parameters=PARAMETERS).shape == ()
    for q, p in ((made.q, made.p[1:]), (made.q[:, :3], made.p[:, :3]), (1.0, 1.0)):
        with refused("shape"):
            gl3.energy(q, p, parameters=PARAMETERS)


def test_unusable_unknowns_are_refused(gl3):
    for bad in (np.zeros(26), np.zeros((27, 1)), np.full(27, np.nan), np.zeros(27, complex), None):
        with refused("^x "):
            gl3.residual(bad, TOP.q0, TOP.p0, **RUN)
        with refused("^x "):
            gl3.jacobian(bad, TOP.q0, TOP.p0, **RUN)


def test_too_large_for_float_is_refused():
    """What overflows on conversion is named, without a warning."""
    step = gs.stepper("IMS", real="float")
    with refused("float32"):
        step.defects([1e300, 0, 0, 0], [0, 0, 0, 0], parameters=PARAMETERS)


# ---------------------------------------------------------------- numbers


BAD_NUMBERS = {"None": None, "word": "0.1", "NaN": np.nan, "inf": np.inf, "-inf": -np.inf,
               "complex": 1j, "bool": True, "list": [0.1], "array": np.array([0.1]),
               "huge": 10**400, "-huge": -10**400, "decimal": Decimal("0.1"), "bytes": b"1"}


@pytest.mark.parametrize("bad", BAD_NUMBERS.values(), ids=BAD_NUMBERS.keys())
def test_unusable_time_step_is_refused(bad, gl3):
    with refused("^dt = "):
        gl3.step(TOP.q0, TOP.p0, dt=bad, parameters=PARAMETERS)
    with refused("^dt = "):
        gl3.residual(np.zeros(27), TOP.q0, TOP.p0, dt=bad, parameters=PARAMETERS)


def test_zero_time_step_is_refused(gl3):
    for zero in (0, 0.0, -0.0, np.float32(0), Fraction(0)):
        with refused("dt = 0 .*negative"):
            gl3.step(TOP.q0, TOP.p0, dt=zero, parameters=PARAMETERS)


def test_time_step_of_any_real_type(gl3):
    expected = gl3.step(TOP.q0, TOP.p0, dt=0.0078125, parameters=PARAMETERS)
    for dt in (Fraction(1, 128), np.float32(0.0078125), np.longdouble(0.0078125),
               sp.Rational(1, 128)):
        assert np.array_equal(gl3.step(TOP.q0, TOP.p0, dt=dt, parameters=PARAMETERS), expected)


@pytest.mark.parametrize("bad", BAD_NUMBERS.values(), ids=BAD_NUMBERS.keys())
@pytest.mark.parametrize("name", ["I1", "mgl", "gamma"])
def test_unusable_parameter_is_named(bad, name, gl3):
    with refused(f"Parameter {name} = "):
        gl3.step(TOP.q0, TOP.p0, dt=1e-3, parameters=PARAMETERS | {name: bad})


@pytest.mark.parametrize(("name", "value", "cure"), [
    ("gamma", 0, "other than 0"), ("gamma", -0.0, "other than 0"), ("I1", 0, "above 0"),
    ("I2", -1e-3, "above 0"), ("I3", -0.0, "above 0"),
])
def test_parameter_outside_its_domain_is_refused(name, value, cure, gl3):
    with refused(f"Parameter {name} = .*{cure}"):
        gl3.step(TOP.q0, TOP.p0, dt=1e-3, parameters=PARAMETERS | {name: value})


def test_parameter_names_are_checked(gl3):
    for name in PARAMETERS:
        with refused(f"'{name}' is not given.*I1, I2, I3, mgl, gamma"):
            gl3.step(TOP.q0, TOP.p0, dt=1e-3,
                     parameters={k: v for k, v in PARAMETERS.items() if k != name})
    with refused("'alpha' is unknown.*takes I1"):
        gl3.step(TOP.q0, TOP.p0, dt=1e-3, parameters=PARAMETERS | {"alpha": 1})
    for bad in (None, 3, [1, 2], "gamma"):
        with refused("parameters = "):
            gl3.step(TOP.q0, TOP.p0, dt=1e-3, parameters=bad)


def test_alpha_zero_is_refused():
    step = gs.stepper("G-L", 2, "alpha")
    parameters = TOP.parameters | {"alpha": 0}
    with refused("Parameter alpha = 0"):
        step.step(TOP.q0, TOP.p0, dt=1e-3, parameters=parameters)


@pytest.mark.parametrize("bad", [-1, 1.0, 2.5, "3", None, np.nan, True, [3], 2**64, 10**30])
def test_unusable_counts_are_refused(bad, gl3):
    with refused("steps"):
        gl3.integrate(TOP.q0, TOP.p0, steps=bad, **RUN)
    if not isinstance(bad, int) or bad < 0 or isinstance(bad, bool):
        with refused("^every = "):
            gl3.integrate(TOP.q0, TOP.p0, steps=3, every=bad, **RUN)
        with refused("^max_iterations = "):
            gl3.integrate(TOP.q0, TOP.p0, steps=3, max_iterations=bad, **RUN)


def test_zero_counts_are_refused_where_they_make_no_sense(gl3):
    with refused("every = 0"):
        gl3.integrate(TOP.q0, TOP.p0, steps=3, every=0, **RUN)
    with refused("max_iterations = 0"):
        gl3.integrate(TOP.q0, TOP.p0, steps=3, max_iterations=0, **RUN)


def test_more_states_than_memory_are_refused(gl3):
    for steps in (10**15, 2**62):
        with refused(r"every"):
            gl3.integrate(TOP.q0, TOP.p0, steps=steps, **RUN)


def test_large_limits_are_taken(gl3):
    made = gl3.integrate(TOP.q0, TOP.p0, steps=3, every=10**15, max_iterations=10**15, **RUN)
    assert made.q.shape == (2, 4)


def test_solver_and_tolerance_are_checked(gl3):
    for bad in ("fast", "", None, 3, "Newton"):
        with refused("solver.*auto, newton, python"):
            gl3.step(TOP.q0, TOP.p0, solver=bad, **RUN)
    for bad in (0, -1e-9, np.nan, np.inf, "1e-9", True):
        with refused("tolerance"):
            gl3.step(TOP.q0, TOP.p0, tolerance=bad, **RUN)


# ---------------------------------------------------------------- choices


@pytest.mark.parametrize(("arguments", "words"), [
    (("RK4",), "'RK4'.*IMS, EMS, G-L or LIIIA-B"), ((3,), "3.*IMS"), ((None,), "No scheme"),
    (("G-L",), "not given.*1 to 16"), (("G-L", 0), "0.*1 to 16"), (("G-L", -1), "-1"),
    (("G-L", 17), "17.*16"), (("G-L", "three"), "'three'"), (("G-L", 2.0), "2.0.*whole"),
    (("G-L", True), "True.*whole"), (("LIIIA-B", 1), "1.*2 to 16"), (("IMS", 2), "no stages"),
    (("IMS", None, "beta"), "'beta'.*alpha or gamma"),
], ids=str)
def test_unusable_stepper_choice_is_refused(arguments, words):
    with refused(words):
        gs.stepper(*arguments)


def test_numpy_integers_count_stages():
    assert gs.stepper("G-L", np.int64(2)).name == "heavy_top_gl2_gamma"


def test_unusable_system_and_tableau_are_refused():
    tableau = gs.tableau("G-L", 2)
    pendulum = gs.System("p", sp.symbols("x:2"), sp.symbols("y:2"), (),
                         H=sum(y**2 for y in sp.symbols("y:2")) / 2,
                         constraints=[sum(x**2 for x in sp.symbols("x:2")) - 1])
    for options, words in [
        ({"scheme": "IMS", "system": "car"}, "'car'.*heavy_top or free_body"),
        ({"scheme": "IMS", "system": 42}, "42"),
        ({"scheme": "IMS", "real": "quad"}, "'quad'.*double"),
        ({"tableau": tableau, "real": "quad"}, "'quad'"),
        ({"tableau": tableau, "rep": "beta"}, "'beta'"),
        ({"tableau": tableau, "system": "car"}, "'car'"),
        ({"tableau": tableau, "scheme": "G-L"}, "leave out"),
        ({"tableau": tableau, "stages": 2}, "leave out"),
        ({"tableau": 42}, "42"),
        ({"tableau": [[1]]}, "tableau"),
        ({"tableau": "none.json"}, "'none.json'"),
        ({"tableau": "none.json", "scheme": "IMS"}, "leave out"),
        ({"scheme": "IMS", "system": pendulum, "rep": "gamma"}, "rep"),
    ]:
        with refused(words):
            gs.stepper(**options)


def test_tableau_object_goes_with_any_named_system():
    """As the named scheme does; free_body is not silently taken for heavy_top."""
    tableau = gs.tableau("G-L", 2)
    step = gs.stepper(tableau=tableau, system="free_body", rep="alpha")
    assert step.name.startswith("free_body_")
    assert set(step.parameter_domains) == {"I1", "I2", "I3", "alpha"}


def test_unusable_tableau_request_is_refused():
    for arguments, words in [(("IMS",), "no SPARK tableau"), (("G-L",), "not given"),
                             (("G-L", 0), "1 to 16"), (("RK4", 4), "'RK4'"),
                             (("none.json",), "'none.json'"), ((Path("none"),), "'none'"),
                             ((ROOT / "examples/tableaux/gauss_lobatto_2.json", 2), "leave out")]:
        with refused(words):
            gs.tableau(*arguments)


# ---------------------------------------------------------------- the constraint


@pytest.mark.parametrize(("dq", "dp"), [(1e-10, 0), (-1e-6, 0), (0.5, 0), (0, 1e-9), (1e-12, 1e-3)])
def test_start_off_the_constraint_is_refused_and_projection_cures_it(dq, dp, step):
    q, p = TOP.q0 * (1 + dq), TOP.p0 + dp * TOP.q0 * np.linalg.norm(TOP.p0)
    momentum_free = not step.manifest["scheme"]["keeps_momentum_constraint"]
    if not (momentum_free and dq == 0 and dp < 1e-3):
        with refused(r"off the constraints.*project\(q, p, parameters=...\)") as caught:
            step.step(q, p, **RUN)
        g, f = step.defects(q, p, parameters=PARAMETERS)
        assert f"|g(q)| = {abs(g[0]):.3e}" in str(caught.value)
        assert f"q^T p = {abs(f[0]):.3e}" in str(caught.value)
    q, p = step.project(q, p, parameters=PARAMETERS)
    assert abs(q @ q - 1) < 1e-15
    assert abs(q @ p) < 1e-16
    step.step(q, p, **RUN)


def test_large_momentum_defect_is_refused_by_every_scheme(step):
    with refused(r"q\^T p = "):
        step.step(TOP.q0, TOP.p0 + 0.1 * TOP.q0, **RUN)


def test_projection_is_orthogonal_and_idempotent(gl3):
    q, p = gl3.project(2 * TOP.q0, TOP.p0 + 0.3 * TOP.q0, parameters=PARAMETERS)
    assert np.allclose(q, TOP.q0, rtol=0, atol=1e-15)
    assert np.allclose(p, TOP.p0, rtol=0, atol=1e-16)
    again = gl3.project(q, p, parameters=PARAMETERS)
    assert np.allclose(again, (q, p), rtol=0, atol=1e-16)


def test_hopeless_projection_is_an_error(gl3):
    with pytest.raises(gs.GyrosparkError, match="cannot be projected"):
        gl3.project([0, 0, 0, 0], TOP.p0, parameters=PARAMETERS)


def test_results_are_starts_again(step):
    """Steps in a loop equal one integration bit for bit, whatever the scheme does to qᵀp."""
    q, p = TOP.q0, TOP.p0
    made = step.integrate(q, p, steps=60, **RUN)
    for k in range(60):
        q, p = step.step(q, p, **RUN)
        assert np.array_equal(q, made.q[k + 1])
        assert np.array_equal(p, made.p[k + 1])


@pytest.mark.parametrize("dt", [1e-5, 1e-2])
@pytest.mark.parametrize("scheme", ["IMS", "EMS"])
def test_results_of_long_runs_are_starts_again(scheme, dt):
    """IMS and EMS let qᵀp oscillate; whatever they return, they take."""
    step = gs.stepper(scheme)
    for inertia in ((0.002, 0.0013, 0.0008), (1.0, 0.9, 0.1)):
        body = gs.problems.free_body(inertia, (3.0, -4.0, 10.0))
        run = {"dt": dt, "parameters": body.parameters | {"gamma": 0.7 * gs.gamma_m(inertia)}}
        made = step.integrate(body.q0, body.p0, steps=3000, **run)
        for k in range(0, 3001, 100):
            step.step(made.q[k], made.p[k], **run)


# ---------------------------------------------------------------- shapes


@pytest.mark.parametrize(("steps", "every"), [(0, 1), (0, 5), (1, 1), (7, 3), (6, 3), (2, 5),
                                              (8193, 4096), (9000, 5000), (4097, 1)])
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
    nodes = step.manifest["scheme"]["multipliers"]
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
    assert made.multipliers.shape == (0, step.manifest["scheme"]["multipliers"])
    assert made.report.steps == 0
    assert made.report.energy_start == made.energy()[0]
    assert made.report.energy_error_max == 0
    assert made.report.iterations_mean == 0
    assert made.report.q == tuple(TOP.q0)


def test_negative_step_goes_back(step):
    """dt < 0 integrates backwards; forth and back ends at the start to round-off."""
    forth = step.integrate(TOP.q0, TOP.p0, steps=50, **RUN)
    back = step.integrate(forth.q[-1], forth.p[-1], dt=-1e-3, steps=50, parameters=PARAMETERS)
    assert back.t[-1] == -0.05
    assert np.abs(back.q[-1] - TOP.q0).max() < 1e-12
    assert np.abs(back.p[-1] - TOP.p0).max() < 1e-13


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


def test_python_solver_keeps_the_same_books(step):
    """The same counts, rows and report from the Newton that Python drives."""
    for steps, every in ((0, 1), (7, 3), (4, 1)):
        a = step.integrate(TOP.q0, TOP.p0, steps=steps, every=every, **RUN)
        b = step.integrate(TOP.q0, TOP.p0, steps=steps, every=every, solver="python", **RUN)
        assert len(a) == len(b)
        assert np.abs(a.q - b.q).max() < 1e-13
        assert np.abs(a.p - b.p).max() < 1e-14
        assert a.iterations.shape == b.iterations.shape
        assert np.abs(a.iterations - b.iterations).max(initial=0) <= 1
        assert a.report.steps == b.report.steps
        assert b.report.constraint_max < 1e-14


def test_newton_is_what_auto_chooses(gl3):
    auto = gl3.integrate(TOP.q0, TOP.p0, steps=9, **RUN)
    newton = gl3.integrate(TOP.q0, TOP.p0, steps=9, solver="newton", **RUN)
    assert np.abs(auto.q - newton.q).max() < 1e-13


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


def test_result_is_the_callers_own(gl3):
    """Changing what came back changes nothing else."""
    first = gl3.integrate(TOP.q0, TOP.p0, steps=3, **RUN)
    kept = first.q.copy()
    first.q[:] = 0
    assert np.array_equal(gl3.integrate(TOP.q0, TOP.p0, steps=3, **RUN).q, kept)
    q, p = gl3.step(TOP.q0, TOP.p0, **RUN)
    q[:] = p[:] = 0
    assert TOP.q0[0] != 0


# ---------------------------------------------------------------- failing steps


def late_failures():
    """Find runs that fail in the middle, by large steps and few iterations."""
    found = []
    for scheme in (("G-L", 2), ("EMS", None), ("LIIIA-B", 3)):
        step = gs.stepper(*scheme)
        for dt, most in product(np.arange(0.03, 0.2, 0.0005).tolist(), (4, 6, 8, 50)):
            options = {"dt": dt, "parameters": PARAMETERS, "max_iterations": most}
            try:
                step.integrate(TOP.q0, TOP.p0, steps=200, **options)
            except gs.StepFailed as failure:
                if failure.step > 4:
                    found.append((step, options, failure))
                    break
    return found


@pytest.fixture(scope="module")
def failures():
    found = late_failures()
    assert len(found) == 3
    return found


def test_failed_step_carries_everything_before_it(failures):
    """Bit for bit what a shorter run returns; step, time and reason are told."""
    for step, options, failure in failures:
        before = failure.step - 1
        shorter = step.integrate(TOP.q0, TOP.p0, steps=before, **options)
        assert equal(failure.trajectory, shorter)
        assert failure.trajectory.report == shorter.report
        assert failure.t == before * options["dt"]
        assert failure.reason in ("not converged", "singular matrix", "not finite")
        assert f"Step {failure.step} at t = " in str(failure)
        assert failure.reason in str(failure)


@pytest.mark.parametrize("every", [2, 3, 1000])
def test_failed_step_between_stored_ones(every, failures):
    """The rows that were complete are there; the report knows the last good state."""
    for step, options, failure in failures:
        with pytest.raises(gs.StepFailed) as caught:
            step.integrate(TOP.q0, TOP.p0, steps=200, every=every, **options)
        assert caught.value.step == failure.step
        made, whole = caught.value.trajectory, failure.trajectory
        assert made.report == whole.report
        kept = np.arange(0, failure.step, every)
        assert np.array_equal(made.q[: len(kept)], whole.q[kept])
        assert np.array_equal(made.t[: len(kept)], whole.t[kept])
        assert made.report.q == tuple(whole.q[-1])


def test_failed_step_by_python(failures):
    for step, options, _ in failures:
        with pytest.raises(gs.StepFailed) as caught:
            step.integrate(TOP.q0, TOP.p0, steps=200, solver="python", **options)
        assert caught.value.reason in ("not converged", "singular matrix", "not finite")
        assert len(caught.value.trajectory) == caught.value.step


def test_one_iteration_is_not_enough(step):
    for solver in ("newton", "python"):
        with pytest.raises(gs.StepFailed, match="Step 1 at t = 0 s failed: not conv") as caught:
            step.step(TOP.q0, TOP.p0, max_iterations=1, solver=solver, **RUN)
        assert len(caught.value.trajectory) == 1
        assert caught.value.trajectory.multipliers.shape[0] == 0


@pytest.mark.parametrize("dt", [1e300, -1e300, 1e-320, 1e30])
def test_hopeless_time_step_fails_or_works_without_a_warning(dt, step):
    """No exception but StepFailed; what is returned is finite and on the constraint."""
    for solver in ("auto", "python"):
        try:
            q, p = step.step(TOP.q0, TOP.p0, dt=dt, parameters=PARAMETERS, solver=solver)
        except gs.StepFailed as failure:
            assert failure.step == 1  # noqa: PT017 (it may fail and need not)
            continue
        assert np.isfinite(q).all()
        assert np.isfinite(p).all()
        assert abs(q @ q - 1) < 1e-12


@pytest.mark.parametrize("changes", [{"I1": 1e-310}, {"gamma": 1e-310}, {"gamma": 1e308},
                                     {"mgl": 1e308}, {"I1": 1e308, "I2": 1e308, "I3": 1e308},
                                     {"gamma": 5e-324}], ids=str)
def test_parameters_at_the_edge_fail_cleanly(changes, step):
    """What is returned is finite; or it is StepFailed: no warning, no hang, no NaN passed off."""
    for solver in ("auto", "python"):
        try:
            made = step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=3, solver=solver,
                                  parameters=PARAMETERS | changes)
        except gs.StepFailed:
            continue
        assert np.isfinite(made.q).all()
        assert np.isfinite(made.p).all()


def test_failure_can_be_sent_to_another_process(failures):
    """A worker's exception that cannot be pickled would hang its pool."""
    for _, _, failure in failures:
        for other in (pickle.loads(pickle.dumps(failure)), copy.copy(failure)):
            assert (other.step, other.t, other.reason) == (failure.step, failure.t, failure.reason)
            assert equal(other.trajectory, failure.trajectory)
            assert str(other) == str(failure)
    error = gs.CompilerError("no", command=["cc"], stderr="why")
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), again.command, again.stderr) == ("no", ["cc"], "why")


# ---------------------------------------------------------------- files


@pytest.fixture
def saved(tmp_path, gl3):
    made = gl3.integrate(TOP.q0, TOP.p0, steps=20, every=3, **RUN)
    return made, made.save(tmp_path / "top.npz")


def test_saved_is_loaded_bit_for_bit(saved):
    made, path = saved
    again = gs.Trajectory.load(path)
    assert equal(made, again)
    for name in ("dt", "every", "parameters", "report", "manifest"):
        assert getattr(made, name) == getattr(again, name)
    assert np.array_equal(again.axis(), made.axis())
    assert [p.name for p in path.parent.iterdir()] == ["top.npz"]


@pytest.mark.parametrize("real", ["float", "long-double"])
def test_other_types_are_saved_too(real, tmp_path):
    step = gs.stepper("IMS", real=real)
    q, p = step.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
    made = step.integrate(q, p, steps=5, **RUN)
    again = gs.Trajectory.load(made.save(tmp_path / "top"))
    assert equal(made, again)
    assert again.q.dtype == made.q.dtype == step.binding.dtype


def test_failed_trajectory_is_saved_too(failures, tmp_path):
    for _, _, failure in failures:
        path = failure.trajectory.save(tmp_path / "part.npz")
        assert equal(gs.Trajectory.load(path), failure.trajectory)


def test_names_of_files(saved, tmp_path, monkeypatch):
    made, _ = saved
    monkeypatch.chdir(tmp_path)
    assert made.save("a.b") == Path("a.b.npz")
    assert made.save(str(tmp_path / "c")) == tmp_path / "c.npz"
    for bad in ("", ".", "/"):
        with refused("no file name"):
            made.save(bad)
    for bad in ("none/top.npz", "/dev/null/top.npz", "/proc/top.npz"):
        with pytest.raises(gs.GyrosparkError, match="cannot be written"):
            made.save(bad)
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(gs.GyrosparkError, match="cannot be written"):
        made.save("folder.npz")
    assert not list(tmp_path.glob(".*"))


def test_file_in_the_way_is_replaced_whole(saved):
    made, path = saved
    path.write_bytes(b"something else")
    made.save(path)
    assert equal(gs.Trajectory.load(path), made)


def test_damaged_files_are_refused(saved, tmp_path):
    """Cut off anywhere, or with bytes changed: InputError, or the same numbers."""
    made, path = saved
    good = path.read_bytes()
    rng = np.random.default_rng(5)
    bad = tmp_path / "bad.npz"
    for size in (0, 1, 4, 30, 100, len(good) // 2, len(good) - 30, len(good) - 1):
        bad.write_bytes(good[:size])
        with refused("bad.npz"):
            gs.Trajectory.load(bad)
    for _ in range(300):
        content = bytearray(good)
        for place in rng.integers(0, len(good), rng.integers(1, 4)):
            content[place] ^= int(rng.integers(1, 256))
        bad.write_bytes(content)
        try:
            again = gs.Trajectory.load(bad)
        except gs.InputError as error:
            assert "bad.npz" in str(error)  # noqa: PT017 (it may be refused and need not)
        else:
            assert equal(again, made)


def test_foreign_files_are_refused(tmp_path):
    np.savez(tmp_path / "foreign.npz", t=np.zeros(3))
    np.save(tmp_path / "array.npy", np.zeros(3))
    (tmp_path / "text.npz").write_text("t, q\n0, 1\n", encoding="utf-8")
    with zipfile.ZipFile(tmp_path / "zip.npz", "w") as archive:
        archive.writestr("about.npy", b"not an array")
    (tmp_path / "pickle.npz").write_bytes(pickle.dumps({"about": 1}))
    (tmp_path / "folder.npz").mkdir()
    for name in ("foreign.npz", "array.npy", "text.npz", "zip.npz", "pickle.npz", "none.npz",
                 "folder.npz"):
        with refused(name):
            gs.Trajectory.load(tmp_path / name)


class Bomb:
    """Would write a file if it were unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_nothing_in_a_file_is_executed(saved, tmp_path):
    _, path = saved
    with np.load(path) as file:
        content = dict(file)
    for name in content:
        trap = content | {name: np.array([Bomb(tmp_path / "evil")], dtype=object)}
        np.savez(tmp_path / "bomb.npz", allow_pickle=True, **trap)
        with refused("bomb.npz"):
            gs.Trajectory.load(tmp_path / "bomb.npz")
    assert not (tmp_path / "evil").exists()


def rewritten(path, target, **changes):
    """Copy a trajectory file with changed arrays; ``about`` is given as changes of its keys."""
    with np.load(path) as file:
        content = dict(file)
    about = json.loads(str(content["about"]))
    about.update(changes.pop("about", {}))
    np.savez(target, **(content | {"about": np.array(json.dumps(about))} | changes))
    return target


def test_inconsistent_files_are_refused(saved, tmp_path):
    made, path = saved
    bad = tmp_path / "bad.npz"
    for changes in ({"about": {"format": 2}}, {"about": {"report": {}}},
                    {"about": {"manifest": {}}}, {"q": made.q[:-1]}, {"q": made.q[:, :3]},
                    {"t": made.t[None]},
                    {"multipliers": made.multipliers[1:]}, {"iterations": made.iterations[1:]},
                    {"energies": made.energies[1:]}):
        with refused(r"bad\.npz"):
            gs.Trajectory.load(rewritten(path, bad, **changes))
    assert equal(gs.Trajectory.load(rewritten(path, bad)), made)


# ---------------------------------------------------------------- rotation, picture, extras


def test_rotation_there_and_back(gl3):
    rotation_class = pytest.importorskip("scipy.spatial.transform").Rotation
    made = gl3.integrate(TOP.q0, TOP.p0, steps=20, **RUN)
    rotation = made.rotation()
    assert isinstance(rotation, rotation_class)
    assert np.allclose(rotation.as_matrix()[:, :, 2], made.axis(), rtol=0, atol=4e-16)
    q, p = gs.state_from_rotation(rotation, made.angular_velocity(), TOP.inertia)
    sign = np.sign((q * made.q).sum(axis=1))[:, None]
    assert np.allclose(sign * q, made.q, rtol=0, atol=4e-16)
    assert np.allclose(sign * p, made.p, rtol=0, atol=1e-15)
    gl3.step(q[5], p[5], **RUN)


def test_what_is_no_body_has_no_axis():
    x, y = sp.symbols("x y", real=True)
    px, py = sp.symbols("px py", real=True)
    pendulum = gs.System("disc", (x, y), (px, py), (), H=(px**2 + py**2) / 2 + y,
                         constraints=[x**2 + y**2 - 1])
    made = gs.stepper("G-L", 2, system=pendulum).integrate([1, 0], [0, 1], dt=0.01, steps=3,
                                                           parameters={})
    for call in (made.axis, made.rotation, made.angular_velocity):
        with pytest.raises(gs.GyrosparkError, match="'disc' is not one rigid body"):
            call()
    assert made.energy().shape == (4,)


@pytest.mark.parametrize("ending", ["png", "svg", "pdf", "PNG"])
def test_picture_is_written(ending, tmp_path, gl3):
    pytest.importorskip("matplotlib")
    path = tmp_path / f"top.{ending}"
    made = gl3.integrate(TOP.q0, TOP.p0, steps=20, **RUN)
    assert made.plot(path) is not None
    start = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[ending.lower()]
    assert path.read_bytes().startswith(start)


@pytest.mark.parametrize("name", ["top.txt", "top", "top.npz", "top.jpeg", ".png", ""])
def test_other_pictures_are_refused(name, tmp_path, gl3):
    made = gl3.integrate(TOP.q0, TOP.p0, steps=2, **RUN)
    with refused(r"\.png, \.svg, \.pdf"):
        made.plot(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_pictures_of_special_trajectories(tmp_path, gl3):
    """One state, a resting body, more states than a picture has points, no body: no warning."""
    pytest.importorskip("matplotlib")
    gl3.integrate(TOP.q0, TOP.p0, steps=0, **RUN).plot(tmp_path / "one.png")
    gl3.integrate([1, 0, 0, 0], [0, 0, 0, 0], steps=3, **RUN).plot(tmp_path / "rest.png")
    gl3.integrate(TOP.q0, TOP.p0, steps=45_000, **RUN).plot(tmp_path / "many.png")
    gs.stepper("IMS", real="float").integrate([1, 0, 0, 0], [0, 0, 0, 0], steps=3, **RUN).plot(
        tmp_path / "float.png")
    with pytest.raises(gs.GyrosparkError, match="cannot be written"):
        gl3.integrate(TOP.q0, TOP.p0, steps=2, **RUN).plot(tmp_path / "none" / "top.png")
    assert len(list(tmp_path.iterdir())) == 4


@pytest.mark.parametrize(("module", "call", "cure"), [
    ("matplotlib", "made.plot('top.png')", "matplotlib"),
    ("scipy", "made.rotation()", "scipy"),
    ("scipy", "gs.state_from_rotation(None, [0, 0, 1], top.inertia)", "scipy"),
])
def test_missing_extra_is_told_with_the_cure(module, call, cure):
    code = FAST_TOP + (
        f"import sys\nsys.modules['{module}'] = None\n"
        "made = gs.stepper('IMS').integrate(top.q0, top.p0, dt=1e-3, steps=2, "
        "parameters=parameters)\n"
        f"try:\n    {call}\nexcept gs.MissingDependencyError as error:\n    print(error)\n"
        "    assert isinstance(error, ImportError)\n"
    )
    said = python(code)
    assert f"pip install {cure}" in said
    assert said.count("\n") == 1


# ---------------------------------------------------------------- ensembles and threads


def members(count=6):
    """Return starts, time steps and parameters of different members."""
    rng = np.random.default_rng(3)
    q = rng.standard_normal((count, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    q /= np.linalg.norm(q, axis=1)[:, None]
    omega = rng.standard_normal((count, 3)) * 20
    p = np.array([gs.momentum(*state, TOP.inertia) for state in zip(q, omega, strict=True)])
    step = gs.stepper("G-L", 3)
    states = [step.project(*state, parameters=PARAMETERS) for state in zip(q, p, strict=True)]
    q, p = (np.array(part) for part in zip(*states, strict=True))
    return q, p, np.linspace(1e-4, 1e-3, count), np.linspace(0.5, 2, count) * PARAMETERS["gamma"]


def test_ensemble_equals_single_runs_bit_for_bit(step):
    q, p, dts, gammas = members()
    many = step.integrate_ensemble(q, p, dt=dts, steps=20, every=3,
                                   parameters=PARAMETERS | {"gamma": gammas})
    listed = step.integrate_ensemble(q, p, dt=dts, steps=20, every=3, workers=2,
                                     parameters=[PARAMETERS | {"gamma": g} for g in gammas])
    assert len(many) == 6
    assert not many.failures
    assert many.q.shape == many.p.shape == (6, 8, 4)
    assert many.t.shape == (6, 8)
    assert many.multipliers.shape == (6, 7, step.manifest["scheme"]["multipliers"])
    assert many.iterations.shape == (6, 7)
    for i in range(6):
        one = step.integrate(q[i], p[i], dt=dts[i], steps=20, every=3,
                             parameters=PARAMETERS | {"gamma": gammas[i]})
        assert equal(many.members[i], one)
        assert equal(listed.members[i], one)
        for name in ("t", "q", "p", "multipliers", "iterations"):
            assert np.array_equal(getattr(many, name)[i], getattr(one, name))


def test_failing_member_does_not_touch_the_others(gl3):
    q, p, dts, _ = members()
    dts[2] = 5.0
    many = gl3.integrate_ensemble(q, p, dt=dts, steps=12, parameters=PARAMETERS)
    with pytest.raises(gs.StepFailed) as caught:
        gl3.integrate(q[2], p[2], dt=5.0, steps=12, parameters=PARAMETERS)
    failure = many.failures[2]
    assert list(many.failures) == [2]
    assert (failure.step, failure.reason) == (caught.value.step, caught.value.reason)
    rows = failure.step
    assert np.array_equal(many.q[2, :rows], caught.value.trajectory.q)
    assert np.isnan(many.q[2, rows:]).all()
    assert np.isnan(many.t[2, rows:]).all()
    assert np.isnan(many.multipliers[2, rows - 1:]).all()
    assert not many.iterations[2, rows - 1:].any()
    for i in (0, 1, 3, 4, 5):
        assert equal(many.members[i], gl3.integrate(q[i], p[i], dt=dts[i], steps=12,
                                                    parameters=PARAMETERS))


def test_unusable_member_is_named(gl3):
    q, p, dts, gammas = members()
    gammas[3] = 0
    with refused("Trajectory 3: Parameter gamma"):
        gl3.integrate_ensemble(q, p, dt=dts, steps=3, parameters=PARAMETERS | {"gamma": gammas})
    dts[4] = np.nan
    with refused("Trajectory 4: dt"):
        gl3.integrate_ensemble(q, p, dt=dts, steps=3, parameters=PARAMETERS)
    q[1] *= 1.1
    with refused("Trajectory 1: The start is off"):
        gl3.integrate_ensemble(q, p, dt=1e-3, steps=3, parameters=PARAMETERS)


@pytest.mark.parametrize(("changes", "words"), [
    ({"q": [1, 0, 0, 0]}, "q has shape"), ({"q": np.zeros((5, 4))}, "shapes"),
    ({"q": np.zeros((0, 4)), "p": np.zeros((0, 4))}, "shapes"),
    ({"q": [[1, 0], [1]]}, "q is ragged"), ({"q": None}, "^q "), ({"q": np.zeros((6, 4), complex)},
                                                                  "^q "),
    ({"dt": [1e-3] * 5}, "^dt has shape"), ({"dt": "1e-3"}, "^dt "), ({"dt": None}, "^dt "),
    ({"dt": [1j] * 6}, "^dt "), ({"dt": True}, "^dt "), ({"dt": [[1e-3] * 6]}, "^dt has shape"),
    ({"parameters": None}, "parameters"), ({"parameters": [PARAMETERS] * 5}, "5 sets"),
    ({"parameters": [1] * 6}, "parameters"),
    ({"parameters": PARAMETERS | {"gamma": [1.0] * 5}}, "Parameter gamma has shape"),
    ({"parameters": PARAMETERS | {"gamma": "1"}}, "Parameter gamma"),
    ({"parameters": PARAMETERS | {"gamma": None}}, "Parameter gamma"),
    ({"steps": -1}, "steps"), ({"steps": 2.5}, "steps"), ({"every": 0}, "every"),
    ({"workers": -1}, "workers"), ({"workers": 0}, "workers"), ({"workers": 1.5}, "workers"),
    ({"solver": "fast"}, "solver"),
], ids=str)
def test_unusable_ensemble_argument_is_refused(changes, words, gl3):
    q, p, _, _ = members()
    options = {"q": q, "p": p, "dt": 1e-3, "steps": 3, "parameters": PARAMETERS} | changes
    with refused(words):
        gl3.integrate_ensemble(options.pop("q"), options.pop("p"), **options)


def test_ensemble_stops_when_one_member_is_refused(gl3):
    """The members that run are not finished for nobody: this would take hours."""
    q, p, _, _ = members(2)
    q[1] *= 1.1
    with refused("Trajectory 1"):
        gl3.integrate_ensemble(q, p, dt=1e-5, steps=10**9, every=10**9, parameters=PARAMETERS,
                               workers=2)


def test_sixteen_threads_on_one_stepper(step):
    """Re-entrant: all at once, each with its own state and Δt, as if alone."""
    q, p, _, _ = members(16)
    dts = np.linspace(1e-4, 1e-3, 16)
    alone = [step.integrate(q[i], p[i], dt=dts[i], steps=150, parameters=PARAMETERS)
             for i in range(16)]
    gate = threading.Barrier(16)

    def work(i):
        gate.wait()
        return [step.integrate(q[i], p[i], dt=dts[i], steps=150, parameters=PARAMETERS)
                for _ in range(3)]

    with ThreadPoolExecutor(16) as pool:
        for i, results in enumerate(pool.map(work, range(16))):
            for made in results:
                assert equal(made, alone[i])


def test_threads_may_ask_for_the_same_stepper():
    gate = threading.Barrier(8)

    def work(_):
        gate.wait()
        return gs.stepper("LIIIA-B", 3).step(TOP.q0, TOP.p0, **RUN)

    with ThreadPoolExecutor(8) as pool:
        results = list(pool.map(work, range(8)))
    assert all(np.array_equal(results[0], r) for r in results)
