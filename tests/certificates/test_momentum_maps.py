"""Momentum maps of textbooks are derived, proved and named; no others are."""

from __future__ import annotations

import sys
from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
import systems
from generic_systems import EXAMPLES
from gyrospark.certificates.momentum_maps import MAX_COORDINATES, _echelon, momentum_maps
from gyrospark.certificates.near_symmetries import NEAR, _relative
from gyrospark.generator.multibody.rigid_body import body_system, heavy_top, mgl, rotation_matrix
from gyrospark.generator.symbolic.numeric_evaluation import evaluate
from gyrospark.generator.symmetry.linear_fields import known_fields
from gyrospark.runtime.rigid_body.quaternion import left_matrix
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix as attitude

SPACE = [f"angular momentum about e{k}" for k in (1, 2, 3)]
BODY = [f"angular momentum about the body's axis {k}" for k in (1, 2, 3)]
LINEAR = [f"linear momentum along e{k}" for k in (1, 2, 3)]

m1, m2, k, length, g = sp.symbols("m1 m2 k length g", positive=True)
masses = {"m1": 1.0, "m2": 2.5}


def points(count):
    """Return coordinates and momenta of points in space."""
    names = [f"{c}{i}" for i in range(count) for c in "xyz"]
    return tuple(tuple(sp.Symbol(prefix + name, real=True) for name in names)
                 for prefix in ("", "p"))


def square(x):
    return sum(e**2 for e in x)


def maps_of(problem):
    """Return the maps of a heavy top at a problem's state and parameters."""
    parameters = problem.parameters | {"gamma": gs.gamma(problem.inertia)}
    return momentum_maps(heavy_top("gamma"), parameters, problem.q0, problem.p0)


def test_heavy_top():
    """There is a map about the vertical for any parameters, about the figure axis if I1 = I2."""
    vertical, figure = maps_of(gs.problems.fast_top())
    assert (vertical.name, figure.name) == (SPACE[2], BODY[2])
    assert vertical.any_parameters
    assert not figure.any_parameters
    assert all(J.everywhere and J.turns_constraints and J.proof == "expanded"
               for J in (vertical, figure))
    top = gs.problems.fast_top()
    maps = momentum_maps(heavy_top("gamma"), top.parameters | {"I2": 0.0021, "gamma": 0.0015},
                         top.q0, top.p0)
    assert [J.name for J in maps] == SPACE[2:]


def test_free_body():
    """A body without forces has three in space, one for any mgl; one more if it is symmetric."""
    maps = maps_of(gs.problems.free_body())
    assert sorted(J.name for J in maps) == SPACE
    assert [J.name for J in maps if J.any_parameters] == SPACE[2:]
    body = gs.problems.free_body((2.0, 1.0, 1.0))
    assert sorted(J.name for J in maps_of(body)) == [*SPACE, BODY[0]]


def test_fields_of_each_body_add_up_to_those_of_all():
    system = systems.case("double_top").system.system
    momenta = {field.name: field.momentum(system.q, system.p) for field in known_fields(system)}
    parts = [name for name in momenta if name.startswith(f"{SPACE[1]} of ")]
    assert sum("body" in name for name in parts) == 2
    assert sp.expand(momenta[SPACE[1]] - sum(momenta[name] for name in parts)) == 0


def test_values_are_the_momenta_of_mechanics():
    """They equal l = ½ L(q) p and R l, which the runtime writes down by itself."""
    rng = np.random.default_rng(5)
    q, p = rng.standard_normal((2, 50, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    body = np.einsum("kij,kj->ki", left_matrix(q), p) / 2
    space = np.einsum("kij,kj->ki", attitude(q), body)
    # R l takes a component of p along q, which is no momentum of the body, to nothing; so does J.
    expected = dict(zip((*SPACE, *BODY), (*space.T, *body.T), strict=True))
    maps_of_a_ball = maps_of(gs.problems.free_body((1.0, 1.0, 1.0)))
    assert sorted(J.name for J in maps_of_a_ball) == [*SPACE, *BODY]
    for J in maps_of_a_ball:
        np.testing.assert_allclose(J.values(q, p), expected[J.name], atol=1e-14)
        assert (np.abs(J.values(q, p)) <= J.sizes(q, p)).all()


def test_symmetry_on_the_constraint_only():
    """R11 = 1 − 2(q2² + q3²) turns like a vector for |q| = 1 only: the motion keeps J."""
    q = sp.symbols("q0:4", real=True)
    R = rotation_matrix(q)
    R11, R21 = 1 - 2 * (q[2] ** 2 + q[3] ** 2), R[1, 0]
    system = body_system("poorly_written", "gamma", mgl * (R[2, 2] + R11**2 + R21**2), (mgl,))
    parameters = {"I1": 1.0, "I2": 2.0, "I3": 2.5, "mgl": 0.7, "gamma": 1.8}
    (momentum_map,) = momentum_maps(system, parameters, [0.8, 0.6, 0, 0], [0.06, -0.08, 0.2, 0.3])
    assert momentum_map.name == SPACE[2]
    assert not momentum_map.everywhere
    assert momentum_map.on_constraints
    assert momentum_map.proof == "random points"
    well = body_system("well_written", "gamma", mgl * (R[2, 2] + R[0, 0]**2 + R21**2), (mgl,))
    (momentum_map,) = momentum_maps(well, parameters, [0.8, 0.6, 0, 0], [0.06, -0.08, 0.2, 0.3])
    assert momentum_map.name == SPACE[2]
    assert momentum_map.everywhere


def spring(gravity=0):
    q, p = points(2)
    stretch = sp.sqrt(square(a - b for a, b in zip(q[:3], q[3:], strict=True))) - length
    H = square(p[:3]) / (2 * m1) + square(p[3:]) / (2 * m2) + k * stretch**2 / 2
    return gs.System(q, p, (m1, m2, k, length, *([g] if gravity else ())),
                     H + gravity * (m1 * q[2] + m2 * q[5]), name="spring")


SPRING = masses | {"k": 3.0, "length": 1.0}
STATE = [0, 0, 0, 1.2, 0.3, -0.2], [0.1, 0.2, 0.3, 0.3, -0.2, 0.1]


def test_two_masses_with_a_spring():
    """Six maps of space hold for any masses; the inner angular momentum depends on m1 and m2."""
    maps = momentum_maps(spring(), SPRING, *STATE)
    assert sorted(J.name for J in maps if J.any_parameters) == [*SPACE, *LINEAR]
    inner = [J for J in maps if not J.any_parameters]
    rng = np.random.default_rng(6)
    q, p = rng.standard_normal((2, 60, 6))
    r, relative = q[:, 3:] - q[:, :3], (masses["m1"] * p[:, 3:] - masses["m2"] * p[:, :3])
    expected = np.cross(r, relative)
    values = [J.values(q, p) for J in maps if J.any_parameters]
    weights = np.linalg.matrix_rank(np.array([*values, *expected.T, *(J.values(q, p)
                                                                       for J in inner)]), tol=1e-9)
    assert weights == len(maps) == 9


@pytest.mark.parametrize("count", [1, pytest.param(7, marks=pytest.mark.slow)])
def test_chain_of_points(count):
    """Rods from the origin have the vertical map, also beyond the full search (21 coordinates)."""
    q, p = points(count)
    ends = [(0, 0, 0), *(q[i : i + 3] for i in range(0, 3 * count, 3))]
    rods = [square(a - b for a, b in zip(*pair, strict=True)) - length**2
            for pair in pairwise(ends)]
    system = gs.System(q, p, (m1, length, g), square(p) / (2 * m1) + m1 * g * sum(q[2::3]), rods,
                       name="chain")
    q0 = np.cumsum([[0.6, 0.0, -0.8]] * count, axis=0).ravel()
    p0 = [0, 0.1, 0] * count
    maps = momentum_maps(system, {"m1": 1.0, "length": 1.0, "g": 9.81}, q0, p0)
    assert [J.name for J in maps] == SPACE[2:]
    assert maps[0].any_parameters
    assert maps[0].turns_constraints
    assert (3 * count > MAX_COORDINATES) == (count == 7)


def test_another_centre():
    """Attraction by a fixed point has a map about that point, whose place is a parameter."""
    x, y, a, b, c = sp.symbols("x y a b c", real=True)
    system = gs.System((x, y), (a, b), (c,),
                       (a**2 + b**2) / 2 - 1 / sp.sqrt((x - c) ** 2 + (y - 1) ** 2), name="kepler")
    (J,) = momentum_maps(system, {"c": 0.3}, [1.0, 0.2], [0.25, 0.9])
    assert not J.any_parameters
    assert J.proof == "expanded"
    ratio = sp.simplify(J.J / ((x - sp.Rational(0.3)) * b - (y - 1) * a))
    assert abs(ratio) == 1


@settings(max_examples=3, derandomize=True)
@given(down=st.tuples(*[st.integers(-3, 3)] * 3).filter(any))
def test_gravity_in_any_direction(down):
    """A spherical pendulum keeps the angular momentum about gravity, and nothing else."""
    q, p = points(1)
    V = sum(a * x for a, x in zip(down, q, strict=True))
    system = gs.System(q, p, (m1,), square(p) / (2 * m1) + m1 * V, (square(q) - 1,), name="tilted")
    (J,) = momentum_maps(system, {"m1": 2.0}, [0.6, 0, 0.8], [0.8, 0.3, -0.6])
    rng = np.random.default_rng(7)
    x, y = rng.standard_normal((2, 20, 3))
    expected = np.cross(x, y) @ np.array(down)
    ratio = J.values(x, y) / expected
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)
    expected_name = {(0, 0): SPACE[2]}.get(down[:2])
    assert J.name == expected_name if expected_name else J.name.startswith("angular momentum about")


@settings(max_examples=6, derandomize=True)
@given(scale=st.floats(-6, 6), stretch=st.sampled_from([0.0, 1e-3, 1.0]))
def test_no_symmetry_is_invented_in_any_units(scale, stretch):
    """An oscillator that is round to one part in a thousand has no invariant angular momentum."""
    x, y, a, b = sp.symbols("x y a b", real=True)
    s = sp.Symbol("s", positive=True)
    H = (a**2 + b**2) / (2 * m1) + k * (x**2 + y**2 + s * x**2 * y**2) / 2
    parameters = {"m1": 10**scale, "k": 3.0, "s": 1 + stretch}
    system = gs.System((x, y), (a, b), (m1, k, s), H, name="oscillator")
    assert momentum_maps(system, parameters, [0.3, -0.2], [0.25, 0.35]) == []
    round_one = gs.System((x, y), (a, b), (m1, k, s),
                          (a**2 + b**2) / (2 * m1) + k * (x**2 + s * y**2) / 2, name="oscillator")
    maps = momentum_maps(round_one, parameters, [0.3, -0.2], [0.25, 0.35])
    assert [J.name for J in maps] == ([] if stretch else ["angular momentum"])


def plane(H, values, **more):
    """Return the maps of a system in the plane."""
    x, y, a, b = sp.symbols("x y a b", real=True)
    parameters = tuple(H.free_symbols - {x, y, a, b})
    system = gs.System((x, y), (a, b), parameters, H, name="plane", **more)
    return momentum_maps(system, values, [0.3, -0.2], [0.25, 0.35])


@pytest.mark.parametrize("size", [1e-6, 1e-11])
def test_near_symmetries_are_reported(size):
    """For I₂ = I₁ (1 + size) the figure axis has its distance from a symmetry, and no proof."""
    top = gs.problems.fast_top()
    parameters = top.parameters | {"I2": top.parameters["I1"] * (1 + size), "gamma": 0.0015}
    vertical, *near_maps = momentum_maps(heavy_top("gamma"), parameters, top.q0, top.p0)
    assert vertical.name == SPACE[2]
    assert vertical.any_parameters
    assert vertical.proof == "expanded"
    assert vertical.symmetry_defect == 0
    if size < 1e-6:
        (figure,) = near_maps
        assert figure.name == BODY[2]
        assert not figure.everywhere
        assert not figure.on_constraints
        assert figure.proof == "random points"
        assert 0.1 * size < figure.symmetry_defect < 10 * size
    else:  # too far from one
        assert near_maps == []


def test_a_rate_that_overflows_is_no_symmetry():
    """Terms inf and −inf at one point have the sum NaN; at the other point they cancel."""
    assert _relative(np.array([[np.inf, 2.0], [-np.inf, -2.0]])) > NEAR
    assert _relative(np.array([[2.0], [-2.0]])) == 0


def test_parameters_are_the_doubles_that_they_are():
    """0.1 + 0.2 is not 0.3: masses that differ by an ulp have no common angular momentum."""
    x, y, a, b, m = sp.symbols("x y a b m", real=True)
    H = a**2 / (2 * m1) + b**2 / (2 * m) + (x**2 + y**2) ** 2
    (exact,) = plane(H, {"m1": 0.3, "m": 0.3})
    assert exact.everywhere
    (near_map,) = plane(H, {"m1": 0.3, "m": 0.1 + 0.2})
    assert not near_map.everywhere
    assert 1e-17 < near_map.symmetry_defect < 1e-15


def test_directions_that_are_no_fractions_are_not_proved():
    """Gravity at an angle of 0.3 has a map about (sin 0.3, 0, cos 0.3), up to last digits."""
    (x, y, z), p = points(1)
    angle = sp.Symbol("angle", real=True)
    H = square(p) / (2 * m1) + z * sp.cos(angle) + x * sp.sin(angle)
    system = gs.System((x, y, z), p, (m1, angle), H, (square((x, y, z)) - 1,), name="inclined")
    (J,) = momentum_maps(system, {"m1": 1.0, "angle": 0.3}, [0.6, 0, 0.8], [0.8, 0.3, -0.6])
    assert J.name == "angular momentum about (0.29552, 0, 0.955336)"
    assert not J.everywhere
    assert J.symmetry_defect < 100 * sys.float_info.epsilon  # sums of some tens of terms


def test_constraints_that_turn_into_one_another():
    """The components of x₁ = x₂, which joins two points, turn like a vector, exactly."""
    q, p = points(2)
    differences = [a - b for a, b in zip(q[:3], q[3:], strict=True)]
    system = gs.System(q, p, (m1, m2, g), square(p[:3]) / (2 * m1) + square(p[3:]) / (2 * m2)
                       + g * (q[2] + q[5]) + square(q[:3]) ** 2, differences, name="joined")
    maps = momentum_maps(system, masses | {"g": 2.0}, [0.1, 0.2, 0.3] * 2, [0.1, 0.2, 0.3] * 2)
    vertical = next(J for J in maps if J.name == SPACE[2])
    assert vertical.any_parameters
    assert vertical.everywhere
    assert not vertical.turns_constraints


@pytest.mark.parametrize("potential", ["exp", "root"])
def test_functions_of_the_distance(potential):
    """Any function of x² + y² turns; a function of x² + k y² turns for k = 1 only."""
    x, y, a, b = sp.symbols("x y a b", real=True)
    u = x**2 + k * y**2
    V = {"exp": sp.exp(-u), "root": sp.cbrt(1 + u)}
    H = (a**2 + b**2) / 2 + V[potential]
    (J,) = plane(H, {"k": 1.0})
    assert J.everywhere
    assert all(not J.everywhere for J in plane(H, {"k": 1 + 1e-12}))


def test_a_theorem_of_addition_is_known():
    """(tan x − tan y)/(1 + tan x tan y) depends on x − y: the sum of the momenta stays."""
    x, y, a, b = sp.symbols("x y a b", real=True)
    s, t = sp.tan(x), sp.tan(y)
    (J,) = plane((a**2 + b**2) / 2 + ((s - t) / (1 + s * t)) ** 2, {})
    assert a + b == J.J
    assert J.everywhere
    assert J.proof == "exact arithmetic at random points"


@pytest.mark.parametrize("name", EXAMPLES)
def test_systems_without_symmetry(name):
    example = EXAMPLES[name]
    assert momentum_maps(example.symbolic, example.parameters, example.q, example.p) == []


def test_what_vanishes_on_the_constraints_is_dropped():
    """In the plane z = 0 every z J' is "conserved"; only the three maps of the plane remain."""
    q, p = points(1)
    system = gs.System(q, p, (m1,), square(p) / (2 * m1), (q[2],), name="plane")
    maps = momentum_maps(system, {"m1": 1.0}, [0.3, 0.4, 0.0], [1.0, -0.5, 0.0])
    assert sorted(J.name for J in maps) == [SPACE[2], "momentum px0", "momentum py0"]


def test_cyclic_coordinate():
    """A spherical pendulum in angles has p_phi, although no coordinate is Cartesian."""
    theta, phi, a, b = sp.symbols("theta phi a b", real=True)
    H = (a**2 + b**2 / sp.sin(theta) ** 2) / (2 * m1) + m1 * g * sp.cos(theta)
    system = gs.System((theta, phi), (a, b), (m1, g), H, name="angles")
    (J,) = momentum_maps(system, {"m1": 1.0, "g": 9.81}, [1.0, 0.0], [0.1, 0.3])
    assert J.name == "momentum b"
    assert str(J.J) == "b"


def test_forces_count():
    """A wind along e1 destroys p_x and two rotations; drag destroys every map."""
    q, p = points(1)
    t, c = sp.Symbol("t", real=True), sp.Symbol("c", positive=True)
    wind = gs.System(q, p, (m1,), square(p) / (2 * m1), name="wind", time=t,
                     forces=(sp.sin(t), 0, 0))
    maps = momentum_maps(wind, {"m1": 1.0}, [0.1, 0.2, 0.3], [0.3, 0.1, -0.2])
    assert [J.name for J in maps] == ["momentum py0", "momentum pz0", SPACE[0]]
    drag = gs.System(q, p, (m1, c), square(p) / (2 * m1), name="drag",
                     forces=tuple(-c * x for x in p))
    assert momentum_maps(drag, {"m1": 1.0, "c": 0.1}, [0.1, 0.2, 0.3], [0.3, 0.1, -0.2]) == []


def test_brackets_vanish_numerically():
    """{J, H} by differences of J and H themselves, independent of the derivation, vanishes."""
    system = spring(g)
    rng, h = np.random.default_rng(8), 1e-5
    symbols = [*system.q, *system.p]
    x = rng.standard_normal(12)
    values = {s: (SPRING | {"g": 9.81})[str(s)] for s in system.parameters}

    def slope(e):
        moved = x[:, None] + h * np.hstack([np.eye(12), -np.eye(12)])
        values_moved = evaluate([e], values | dict(zip(symbols, moved, strict=True)))[0]
        return (values_moved[:12] - values_moved[12:]) / (2 * h)

    H = slope(system.H)
    maps = momentum_maps(system, SPRING | {"g": 9.81}, *STATE)
    assert [J.name for J in maps if J.any_parameters] == [SPACE[2], *LINEAR[:2]]
    for J in maps:
        by_J = slope(J.J)
        bracket = by_J[:6] @ H[6:] - by_J[6:] @ H[:6]
        assert abs(bracket) < 1e-8 * np.linalg.norm(by_J) * np.linalg.norm(H)


def test_a_space_of_symmetries_has_the_simplest_basis():
    """Two translations that come mixed are separated."""
    x, y, u, v = sp.symbols("x y u v", real=True)
    plane = gs.System([x, y], [u, v], [], u**2 / 2 + v**2 / 2)
    along_x, along_y = np.zeros((2, 2, 3))
    along_x[0, 2] = along_y[1, 2] = 1
    space = np.array([along_x + along_y, along_x - along_y]).reshape(2, 6).T / np.sqrt(2)
    basis = _echelon(space, plane)
    assert [dict(field.weights) for field in basis] == [{(0, 2): 1}, {(1, 2): 1}]
