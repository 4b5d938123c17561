"""Consistent states: onto g = 0 and g_q H_p = 0, with names and sizes of what was moved."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.core.projection import dependent_rows
from gyrospark.generator.systems.numeric_system import NumericSystem
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
    # The momenta move along G^T only: what they do along the curve is kept.
    along = np.cross(*G)
    assert abs(along @ (moved.p - p)) <= 64 * EPS * np.linalg.norm(along) * moved.p_moved


def test_the_move_is_the_shortest_to_first_order():
    """q₁ − q₀ = −G⁺ g + O(g²): halving the distance quarters what is left."""
    near = gs.consistent(curve(), (0.6, 0.1, 0.8), (0, 0, 0), parameters={"w": 1.0}).q
    push = np.array([1.0, -2.0, 0.5])
    rest = []
    for size in (1e-2, 5e-3, 2.5e-3):
        q = near + size * push
        moved = gs.consistent(curve(), q, (0, 0, 0), parameters={"w": 1.0}).q
        numeric = NumericSystem(curve(), {"w": 1.0})
        first = -np.linalg.pinv(numeric.G(q)) @ numeric.g(q)
        rest.append(np.linalg.norm(moved - q - first))
    assert rest[0] / rest[1] == pytest.approx(4, rel=0.1)
    assert rest[1] / rest[2] == pytest.approx(4, rel=0.05)


def test_consistent_states_stay():
    model = gs.models.double_top()
    moved = gs.consistent(model.system, model.q0, model.p0, parameters=model.parameters)
    assert moved.q_moved <= 2 * EPS
    assert moved.p_moved <= 4 * EPS * np.abs(model.p0).max()


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
    apart = gs.System((x, y, z), (a, b, c), (), (a**2 + b**2 + c**2) / 2,
                      (x**2 + y**2 + z**2 - 1, z + 2), name="apart",
                      constraint_names=("sphere", "plane"))
    with pytest.raises(gs.InputError, match=r"'(sphere|plane)' stays at|'sphere', 'plane'"):
        gs.consistent(apart, (1, 2, 3), (0, 0, 0), parameters={})


def test_arguments_are_checked():
    with pytest.raises(gs.InputError, match=r"'w'.*value"):
        gs.consistent(curve(), (1, 0, 0), (0, 0, 0), parameters={})
    with pytest.raises(gs.InputError, match="give shape"):
        gs.consistent(curve(), (1, 0), (0, 0, 0), parameters={"w": 1})
    with pytest.raises(gs.InputError, match=r"neither a gyrospark\.System"):
        gs.consistent("curve", (1, 0, 0), (0, 0, 0), parameters={"w": 1})


def test_complex_steps_agree_with_derived_formulas():
    """g_q and W by complex steps, against the system's own symbolic derivatives."""
    model = gs.models.double_pendulum()
    numeric, system = NumericSystem(model.system, model.parameters), model.system
    values = dict(zip((*system.q, *system.p), (*model.q0, *model.p0), strict=True))
    values |= {s: model.parameters[str(s)] for s in system.parameters}
    G = np.array([[float(e.xreplace(values)) for e in row] for row in system.G])
    H_pp = np.array([[float(sp.sympify(e).xreplace(values)) for e in row] for row in system.H_pp])
    found = numeric.G(model.q0)
    assert np.abs(found - G).max() <= 8 * EPS
    assert np.abs(numeric.W(model.q0, model.p0, found) - G @ H_pp @ G.T).max() <= 1e-12


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
    found = gs.consistent(ray, [1.0, 0.5], [0.1, 0.2], parameters={})
    assert abs(np.arctan2(found.q[1], found.q[0]) - 0.5) <= 4 * np.finfo(float).eps
    assert abs(found.q[0] * found.p[1] - found.q[1] * found.p[0]) <= 1e-16
