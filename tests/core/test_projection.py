"""Consistent states: onto g = 0 and g_q H_p = 0, by dense and by sparse matrices."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.sparse import csr_array

import gyrospark as gs
import systems
from gyrospark.core.projection import dependent_rows, project_momenta, solve_sparse
from gyrospark.generator.systems import numeric_system
from gyrospark.generator.systems.numeric_system import NumericSystem, find_colours, numeric
from gyrospark.runtime.bindings.binding import CompiledConstraints
from strategies import EPS

x, y, z, a, b, c = sp.symbols("x y z a b c", real=True)
w = sp.Symbol("w", positive=True)
NAMES = ("sphere", "wave")


def curve():
    return gs.System((x, y, z), (a, b, c), (w,), (a**2 + b**2 + 2 * c**2) / 2 + w * z,
                     (x**2 + y**2 + z**2 - 1, x**4 - y - z / 8), name="curve",
                     constraint_names=NAMES)


@pytest.mark.parametrize("q", [(1, 0.2, 0.3), (5, 9, 1), (-3, 0.1, 40), (100, -3, 1e3)])
def test_any_start_is_moved_onto_the_constraints(q):
    p = np.array([1.0, 2.0, 3.0])
    moved = gs.consistent(curve(), q, p, parameters={"w": 1.0})
    assert max(moved.after.values()) <= 8 * EPS
    assert max(moved.hidden_after.values()) <= 16 * EPS * 4
    X, Y, Z = moved.q
    G = np.array([[2 * X, 2 * Y, 2 * Z], [4 * X**3, -1, -0.125]])
    assert np.abs(G @ (moved.p * [1, 1, 2])).max() <= 64 * EPS
    assert moved.q_moved == np.abs(moved.q - q).max()
    assert moved.p_moved == np.abs(moved.p - p).max()
    assert moved.q_name == "xyz"[np.argmax(np.abs(moved.q - q))]
    assert moved.p_name == "abc"[np.argmax(np.abs(moved.p - p))]
    assert moved.before["sphere"] == pytest.approx(abs(np.dot(q, q) - 1))
    # The momenta move along G^T only: their part along the curve stays.
    tangent = np.cross(*G)
    assert abs(tangent @ (moved.p - p)) <= 64 * EPS * np.linalg.norm(tangent) * moved.p_moved


def test_the_move_is_the_shortest_to_first_order():
    """q₁ − q₀ = −G⁺ g + O(g²): halving the distance quarters the remainder."""
    on_curve = gs.consistent(curve(), (0.6, 0.1, 0.8), (0, 0, 0), parameters={"w": 1.0}).q
    push = np.array([1.0, -2.0, 0.5])
    remainders = []
    for size in (1e-2, 5e-3, 2.5e-3):
        q = on_curve + size * push
        moved = gs.consistent(curve(), q, (0, 0, 0), parameters={"w": 1.0}).q
        numeric = NumericSystem(curve(), {"w": 1.0})
        first = -np.linalg.pinv(numeric.G(q)) @ numeric.g(q)
        remainders.append(np.linalg.norm(moved - q - first))
    assert remainders[0] / remainders[1] == pytest.approx(4, rel=0.1)
    assert remainders[1] / remainders[2] == pytest.approx(4, rel=0.05)


def test_consistent_states_stay():
    model = gs.models.double_top()
    moved = gs.consistent(model.system, model.q0, model.p0, parameters=model.parameters)
    assert moved.q_moved <= 2 * EPS
    assert moved.p_moved <= 4 * EPS * np.abs(model.p0).max()


@pytest.mark.parametrize(("parameters", "said"), [
    ({"w": "2"}, "w = '2'"), ({"w": 1.0, "k": 3.0}, "'k'"), ({}, "'w'"),
])
def test_parameters_are_those_of_the_system(parameters, said):
    with pytest.raises(gs.InputError, match=said):
        gs.consistent(curve(), (0.6, 0.1, 0.8), (0, 0, 0), parameters=parameters)


def test_a_symbol_that_is_positive_takes_no_other_number():
    length = sp.Symbol("l", positive=True)
    circle = gs.System((x, y), (a, b), (length,), a**2 + b**2, (x**2 + y**2 - length**2,))
    with pytest.raises(gs.InputError, match=r"l = -1\.0"):
        gs.consistent(circle, (0.6, 0.8), (0, 0), parameters={"l": -1.0})


def test_gamma_of_a_problem_has_its_rule():
    body = gs.problems.free_body()
    moved = gs.consistent(gs.body_system("body", "gamma", sp.Integer(0)), body)
    np.testing.assert_array_equal(moved.q, body.q0)


@pytest.mark.parametrize("rules", [{"frame": "start"}, {"gamma": "auto"}])
def test_constraints_do_not_depend_on_numbers_left_to_a_search(rules):
    """Rates of a frame and γ: q/|q|, and p without its part along q, as with numbers for them."""
    step, case = systems.stepper("heavy_top_in_frame"), systems.case("heavy_top_in_frame")
    left_out = {"omega_body", *rules}
    numbers = {name: x for name, x in case.parameters.items() if name not in left_out}
    q, p = (x + 0.01 for x in systems.start("heavy_top_in_frame", step))
    start = gs.Start(q, p, numbers).of_model({"gamma": gs.problems.fast_top().inertia}, rules)
    unit = q / np.sqrt(q @ q)
    for moved in (gs.consistent(step, start), gs.Start(*step.project(start), numbers)):
        np.testing.assert_allclose(moved.q, unit, rtol=0, atol=2 * EPS)
        np.testing.assert_allclose(moved.p, p - (unit @ p) * unit, rtol=0,
                                   atol=8 * EPS * np.abs(p).max())
    g, f = step.defects(start)
    assert g == pytest.approx(q @ q - 1, abs=4 * EPS)
    assert f == pytest.approx(q @ p, abs=8 * EPS * np.abs(p).max())


def test_report_reads_as_a_table():
    text = str(gs.consistent(curve(), (1, 0.2, 0.3), (1, 2, 3), parameters={"w": 1.0}))
    assert "1.97" in text.splitlines()[0]
    assert "sphere" in text
    assert "|g_q H_p|" in text
    assert len(text.splitlines()) == 4


def test_failures_name_the_constraint():
    massless = gs.System((x, y), (a, b), (), a**2 / 2 + b, (y - 1,), name="massless")
    with pytest.raises(gs.InputError, match="G H_pp Gᵀ is singular"):
        gs.consistent(massless, (0.0, 1.0), (1.0, 0.5), parameters={})
    with pytest.raises(gs.InputError, match=r"'sphere'.*vanishes"):
        gs.consistent(curve(), (0, 0, 0), (0, 0, 0), parameters={"w": 1.0})
    contradictory = gs.System((x, y, z), (a, b, c), (), (a**2 + b**2 + c**2) / 2,
                              (x**2 + y**2 + z**2 - 1, z + 2), name="apart",
                              constraint_names=("sphere", "plane"))
    with pytest.raises(gs.InputError, match=r"'(sphere|plane)' stays at|'sphere', 'plane'"):
        gs.consistent(contradictory, (1, 2, 3), (0, 0, 0), parameters={})
    H = (a**2 + b**2 + c**2) / 2
    parallel = gs.System((x, y, z), (a, b, c), (), H, (x**2 + y**2 - 1, y - x**2 / 4),
                         name="parallel", constraint_names=("circle", "curve"))
    with pytest.raises(gs.InputError, match=r"'circle', 'curve'.*leave out 'curve'"):
        gs.consistent(parallel, (0, 2, 0), (0, 0, 0), parameters={})  # both gradients are along y
    for g, words in ((1 / x - y, "finite gradient"), (sp.sqrt(x) - y, "'g0' stays at.*2.000e")):
        edge = gs.System((x, y), (a, b), (), (a**2 + b**2) / 2, (g,), name="edge")
        with pytest.raises(gs.InputError, match=words):
            gs.consistent(edge, (0, 2), (0, 0), parameters={})


@pytest.mark.parametrize("speed", [0.6, 1.2])
def test_momenta_of_a_driven_point_have_its_speed_below_that_of_light(speed):
    """x = v t has p = v/√(1 − v²) with H = √(1 + p²), whose speeds are below 1."""
    t = sp.Symbol("t", real=True)
    cart = gs.System((x, y), (a, b), (w,), sp.sqrt(1 + a**2 + b**2), (x - w * t,), time=t,
                     name="cart", constraint_names=("rail",))
    if speed < 1:
        moved = gs.consistent(cart, (0, 0), (0.5, 0), parameters={"w": speed})
        assert moved.p[0] == pytest.approx(speed / np.sqrt(1 - speed**2), rel=1e-12)
    else:
        with pytest.raises(gs.InputError, match=r"'rail'.*nearer"):
            gs.consistent(cart, (0, 0), (0.5, 0), parameters={"w": speed})


def test_arguments_are_checked():
    with pytest.raises(gs.InputError, match="give shape"):
        gs.consistent(curve(), (1, 0), (0, 0, 0), parameters={"w": 1})
    with pytest.raises(gs.InputError, match=r"neither a gyrospark\.System"):
        gs.consistent("curve", (1, 0, 0), (0, 0, 0), parameters={"w": 1})


def test_complex_steps_agree_with_derived_formulas():
    """g_q and W by complex steps agree with the system's own symbolic derivatives."""
    model = gs.models.double_pendulum()
    numeric, system = NumericSystem(model.system, model.parameters), model.system
    values = dict(zip((*system.q, *system.p), (*model.q0, *model.p0), strict=True))
    values |= {s: model.parameters[str(s)] for s in system.parameters}
    G = np.array([[float(e.xreplace(values)) for e in row] for row in system.G])
    H_pp = np.array([[float(sp.sympify(e).xreplace(values)) for e in row] for row in system.H_pp])
    normals = numeric.G(model.q0)
    assert np.abs(normals - G).max() <= 8 * EPS
    assert np.abs(numeric.W(model.q0, model.p0, normals) - G @ H_pp @ G.T).max() <= 1e-12


def test_dependent_rows():
    rng = np.random.default_rng(7)
    free = rng.standard_normal((5, 9))
    rows = np.vstack([free, free[1] - 2 * free[3], 1e-6 * free[0]])
    assert dependent_rows(rows) == ([0, 1, 3, 5, 6], [5, 6])
    assert dependent_rows(free) == ([], [])
    assert dependent_rows(np.zeros((1, 3))) == ([0], [0])
    nearly = np.array([[0, 1, 0], [0.01, 1, 0], [1, 0, 0]])
    assert dependent_rows(nearly) == ([0, 1, 2], [1])  # x is 100 times y − y'


def test_an_angle_may_be_a_constraint():
    """atan2 has a slope off the real axis too: a point is moved onto the ray at 1/2 rad."""
    x, y, a, b = sp.symbols("x y a b", real=True)
    ray = gs.System((x, y), (a, b), (), (a**2 + b**2) / 2, (sp.atan2(y, x) - sp.Rational(1, 2),),
                    name="ray")
    state = gs.consistent(ray, [1.0, 0.5], [0.1, 0.2], parameters={})
    assert abs(np.arctan2(state.q[1], state.q[0]) - 0.5) <= 4 * np.finfo(float).eps
    assert abs(state.q[0] * state.p[1] - state.q[1] * state.p[0]) <= 1e-16


def _banded(rng: np.random.Generator, m: int, n: int, band: int) -> np.ndarray:
    i, j = np.indices((m, n))
    return np.where(abs(i * n - j * m) <= band * n, rng.standard_normal((m, n)), 0)


@pytest.mark.parametrize(("m", "n", "band"), [(1, 3, 0), (40, 70, 2), (97, 150, 3)])
def test_solutions_are_those_of_dense_matrices(m, n, band):
    rng = np.random.default_rng(m)
    G, scale, y = _banded(rng, m, n, band), 10.0 ** rng.uniform(-9, 9, m), rng.standard_normal(m)
    A = G @ G.T + np.eye(m)
    expected = np.linalg.solve(A, y / scale) / scale
    assert solve_sparse(csr_array(A * np.outer(scale, scale)), y) == pytest.approx(
        expected, rel=1e-8)
    indefinite = A - 1.01 * np.linalg.eigvalsh(A)[0] * np.eye(m)
    with pytest.raises(np.linalg.LinAlgError):
        solve_sparse(csr_array(indefinite * np.outer(scale, scale)), y)


def test_dependent_rows_of_sparse_matrices_are_those_of_dense_ones():
    G = _banded(np.random.default_rng(7), 40, 70, 2)
    assert dependent_rows(csr_array(G)) == dependent_rows(G) == ([], [])
    G[30] = 2 * G[28] - G[29]
    assert dependent_rows(csr_array(G)) == dependent_rows(G) == ([28, 29, 30], [30])
    G[7] = 0
    assert dependent_rows(csr_array(G)) == dependent_rows(G) == ([7, 28, 29, 30], [7, 30])
    with pytest.raises(np.linalg.LinAlgError):
        solve_sparse(csr_array(np.diag([1, np.nan])), np.ones(2))


def test_no_row_has_a_colour_twice():
    rows = [sorted(np.random.default_rng(k).choice(30, 5, replace=False).tolist())
            for k in range(40)]
    colours = find_colours(rows, 30)
    assert all(len({*colours[row]}) == len(row) for row in rows)
    assert colours.max() < 30
    assert find_colours([[k, k + 1] for k in range(29)], 30).max() == 1


@pytest.mark.parametrize("make", [
    lambda: gs.models.chain(5), gs.models.double_pendulum, gs.models.four_bar,
    lambda: _driven()])
def test_models_are_the_same_with_sparse_matrices(monkeypatch, make):
    dense = make()
    monkeypatch.setattr(numeric_system, "_SPARSE", 0)
    sparse = make()
    assert np.allclose(sparse.q0, dense.q0, atol=1e-14)
    assert np.allclose(sparse.p0, dense.p0, atol=1e-12 * abs(dense.p0).max())
    numbers = {**dense.parameters, **dict.fromkeys(dense.bodies, 0.02)}
    moved = gs.consistent(sparse.system, dense.q0 + 1e-3, dense.p0 + 1e-3, parameters=numbers)
    monkeypatch.undo()
    expected = gs.consistent(dense.system, dense.q0 + 1e-3, dense.p0 + 1e-3, parameters=numbers)
    assert np.allclose(moved.q, expected.q, atol=1e-13)
    assert np.allclose(moved.p, expected.p, atol=1e-12)
    assert np.abs(moved.q - dense.q0).max() > 1e-5


def test_sparse_matrices_are_the_dense_ones(monkeypatch):
    model = gs.models.chain(3)
    q, p = model.q0, np.linspace(0.5, 1.5, len(model.p0))
    dense, sparse = (numeric(model.system, model.parameters) for _ in range(2))
    G, H_p, W = dense.G(q), dense.H_p(q, p), dense.W(q, p, dense.G(q))
    monkeypatch.setattr(numeric_system, "_SPARSE", 0)
    assert np.abs(sparse.G(q).toarray() - G).max() <= 4 * EPS * np.abs(G).max()
    assert np.abs(sparse.H_p(q, p) - H_p).max() <= 16 * EPS * np.abs(H_p).max()
    # W is by differences over 1e-3 of p: round-off of 1e3 ε
    assert np.abs(sparse.W(q, p, sparse.G(q)).toarray() - W).max() <= 1e5 * EPS * np.abs(W).max()


def _driven() -> gs.Model:
    """Return a body on a point that moves: constraints depend on t."""
    build = gs.Multibody("driven")
    body = build.body("a", mass=1.0, inertia=(0.1, 0.2, 0.3), angular_velocity=(1, 2, 3))
    point = build.moving_point("hook", (build.time, 2 * build.time**2, 0))
    build.ball("joint", point, body, on_b=(0, 0, 0.5), on_a=(0, 0, 0))
    return build.model()


def test_redundant_constraints_have_their_names_with_sparse_matrices(monkeypatch):
    monkeypatch.setattr(numeric_system, "_SPARSE", 0)
    build = gs.Multibody("two")
    body = build.body("a", mass=1.0, inertia=(0.1, 0.2, 0.3))
    for name in ("one", "other"):
        build.fixed_point(name, body, at=(0, 0, 0), on_body=(0, 0, 0.5))
    with pytest.raises(gs.InputError, match="other: x"):
        build.model()


@pytest.mark.parametrize("name", ["relativistic", "heavy_top"])
def test_compiled_constraints_lead_to_the_momenta_of_compiled_steps(name):
    """Damped steps from Python, which go on where the compiled ones fail, have W by differences."""
    case, step = systems.case(name), systems.stepper(name)
    q, p = systems.start(name, step)
    constraints = CompiledConstraints(
        step.binding, step.manifest, step.binding.parameters(dict(case.parameters)))
    moved = p + np.linspace(0.2, 0.3, step.n) * np.abs(p).max()
    expected = step.project(q, moved, parameters=case.parameters)[1]
    # they are along g_q by differences, which has nine digits
    assert np.abs(project_momenta(constraints, q, moved) - expected).max() < 1e-9 * np.abs(p).max()
    if name == "relativistic":  # the top's f is qᵀp
        G = constraints.G(q)
        exact = NumericSystem(case.system, case.parameters).W(q, p, G)
        assert constraints.W(q, p, G) == pytest.approx(exact, rel=1e-6)
