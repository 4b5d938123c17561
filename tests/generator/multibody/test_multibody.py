"""The builder of bodies and joints: symbols, order, start; H and g against mechanics in NumPy."""

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import gyrospark as gs
from gyrospark.generator.symbolic.numeric_evaluation import evaluate
from gyrospark.generator.systems.numeric_system import NumericSystem, numeric
from gyrospark.runtime.rigid_body.quaternion import angular_velocity, rotation_matrix
from strategies import EPS, unit_quaternions

INERTIA = (0.3, 0.32, 0.06)


def unit(q):
    return np.array(q) / np.linalg.norm(q)


def energy_of(system, parameters, q, p):
    """Return H with numbers."""
    values = dict(zip([*system.q, *system.p], [*q, *p], strict=True))
    return evaluate([system.H], values | {s: parameters[str(s)] for s in system.parameters})[0]


vectors = st.tuples(*[st.floats(-2, 2)] * 3)


def pair(rep="gamma", **b):
    """Return a builder with a top and a body on it."""
    build = gs.Multibody("pair")
    top = build.top("a", mass=1.5, inertia=INERTIA, centre=(0, 0.1, 0.3), at=(1, 0, 2), rep=rep,
                    quaternion=unit([0.9, 0.3, -0.1, 0.2]), angular_velocity=(1, 2, 30))
    body = build.body("b", mass=0.5, inertia=(0.02, 0.03, 0.04), rep=rep,
                      quaternion=unit([1, -2, 0.5, 0.1]), angular_velocity=(3, -1, 20), **b)
    build.ball("joint", top, body, on_a=(0.1, 0, 0.6), on_b=(0, 0.2, -0.3))
    return build


def test_names_and_order():
    model = pair().model()
    assert [str(x) for x in model.system.q] == [
        "a_q0", "a_q1", "a_q2", "a_q3", "b_q0", "b_q1", "b_q2", "b_q3", "b_x", "b_y", "b_z"]
    assert [str(x) for x in model.system.p][-4:] == ["b_p3", "b_px", "b_py", "b_pz"]
    assert model.system.constraint_names == (
        "a: unit quaternion", "b: unit quaternion", "joint: x", "joint: y", "joint: z")
    assert dict(model.bodies) == {"a_gamma": INERTIA, "b_gamma": (0.02, 0.03, 0.04)}
    assert model.parameters["b_gamma"] == pytest.approx(0.03)
    assert {"a_m", "a_I1", "gravity_z", "joint_a_x", "joint_a_z", "joint_b_y"} <= set(
        model.parameters)
    assert "joint_a_y" not in model.parameters  # zero stays zero
    assert "gravity_x" not in model.parameters


@pytest.mark.parametrize("rep", ["gamma", "alpha"])
def test_hamiltonian_is_the_energy(rep):
    """H at the start's q and p is the sum of ½ Ω·JΩ + ½ m v² + m g z of both bodies."""
    build = pair(rep)
    model = build.model()
    q, p = model.q0, model.p0
    qs, moments = (q[:4], q[4:8]), (INERTIA, (0.02, 0.03, 0.04))
    omegas = [angular_velocity(x, y, J)
              for x, y, J in zip(qs, (p[:4], p[4:8]), moments, strict=True)]
    energy = sum(0.5 * w @ (np.array(J) * w) for w, J in zip(omegas, moments, strict=True))
    energy += 0.5 * p[8:] @ p[8:] / 0.5 + 0.5 * 9.81 * q[10]
    energy += 1.5 * 9.81 * (2 + (rotation_matrix(qs[0]) @ [0, 0.1, 0.3])[2])
    H = energy_of(model.system, model.parameters, q, p)
    assert abs(H - energy) <= 16 * EPS * abs(energy)
    # p = 2 Lᵀ J Ω of the requested Ω, and the point of b moves with the point of a.
    assert np.abs(omegas[0] - [1, 2, 30]).max() < 1e-13 * 30
    assert np.abs(omegas[1] - [3, -1, 20]).max() < 1e-13 * 30
    Ra, Rb = (rotation_matrix(x) for x in qs)
    v = Ra @ np.cross([1, 2, 30], [0.1, 0, 0.6]) - Rb @ np.cross([3, -1, 20], [0, 0.2, -0.3])
    assert np.abs(p[8:] / 0.5 - v).max() < 1e-13 * 30
    x = [1, 0, 2] + Ra @ [0.1, 0, 0.6] - Rb @ [0, 0.2, -0.3]
    assert np.abs(q[8:] - x).max() < 1e-15 * 8
    assert max(build.start.after.values()) <= 4 * EPS
    assert max(build.start.hidden_after.values()) <= 64 * EPS * np.abs(p).max()


@pytest.mark.filterwarnings("ignore:The inertia of")  # joints anywhere, also at the centre
@settings(max_examples=4)
@given(unit_quaternions(), unit_quaternions(), vectors, vectors)
def test_a_body_is_where_joints_put_it(qa, qb, on_a, on_b):
    """The point in space and the points on the bodies give the same start."""
    def start(**joint):
        build = gs.Multibody("placed")
        qa_first, qb_first = (Rotation.from_quat(q[[1, 2, 3, 0]]) for q in (qa, qb))
        a = build.body("a", mass=1, inertia=INERTIA, position=(1, 2, 3), rotation=qa_first)
        b = build.body("b", mass=1, inertia=INERTIA, rotation=qb_first)
        build.ball("joint", a, b, **joint)
        return build.model()

    point = np.array([1, 2, 3]) + rotation_matrix(qa) @ on_a
    by_bodies = start(on_a=on_a, on_b=on_b)
    by_point = start(at=point, on_b=on_b)
    assert np.abs(by_bodies.q0 - by_point.q0).max() <= 64 * EPS
    assert np.abs(by_bodies.q0[11:] - (point - rotation_matrix(qb) @ on_b)).max() <= 64 * EPS


def test_springs_forces_and_expressions():
    build = gs.Multibody("sprung", gravity=(0, 0, 0))
    a = build.body("a", mass=2.0, inertia=INERTIA, position=(0, 0, 1), velocity=(1, 0, 0),
                   quaternion=(0.8, 0, 0.6, 0), angular_velocity=(0.1, 0.2, 0.3))
    build.spring("s", build.ground, a, stiffness=3.0, length=0.5, on_b=(0, 0.5, 0))
    build.spring("soft", build.ground, a, stiffness=2.0, on_a=(1, 0, 0))
    c = build.parameter("c", 0.7, positive=True)
    build.force(a, [-c * v for v in a.velocity], on_body=(0.2, 0, 0))
    build.torque(a, (0, 0, sp.sin(build.time)))
    build.quantity("height", a.point((0, 0, 0.1))[2])
    model = build.model()
    R = rotation_matrix(model.q0[:4])
    system, values = model.system, dict(zip(model.system.q, model.q0, strict=True))
    values |= dict(zip(system.p, model.p0, strict=True))
    values |= {s: model.parameters[str(s)] for s in system.parameters} | {build.time: 0.4}
    potential = 1.5 * (np.linalg.norm(np.array([0, 0, 1]) + R @ [0, 0.5, 0]) - 0.5) ** 2
    potential += 1.0 * 2.0
    kinetic = 1.0 + 0.5 * np.array(INERTIA) @ np.array([0.1, 0.2, 0.3]) ** 2
    H = energy_of(system, model.parameters, model.q0, model.p0)
    assert pytest.approx(potential + kinetic, rel=1e-14) == H
    # The power of all forces: F·v of the point where it acts, τ·Ω of the torque.
    F = evaluate(system.forces, values)
    velocity = NumericSystem(system, model.parameters).H_p(model.q0, model.p0)
    point = [1, 0, 0] + R @ np.cross([0.1, 0.2, 0.3], [0.2, 0, 0])
    power = np.dot([-0.7, 0, 0], point) + 0.3 * np.sin(0.4)
    assert F @ velocity == pytest.approx(power, rel=1e-13)
    assert evaluate([system.quantities["height"]], values)[0] == pytest.approx(1 + 0.1 * R[2, 2])
    assert system.time == build.time


def test_rods_keep_the_distance_of_the_start_and_chains_are_free_or_held():
    build = gs.Multibody("bola", gravity=(0, 0, 0))
    a, b = (build.body(name, mass=1, inertia=INERTIA, position=x)
            for name, x in (("a", (0, 0, 0)), ("b", (3, 4, 0))))
    build.rod("rod", a, b)
    model = build.model()
    assert model.parameters["rod_length"] == pytest.approx(5)
    assert model.system.constraint_names[-1] == "rod: length"
    build = gs.Multibody("rods")
    free = build.chain_of_rods(POINTS[:2], mass=1.0, a=None, name="a")
    build.chain_of_rods(POINTS[1:3], mass=1.0, a=free[0], name="b")
    system = build.model().system
    assert system.n - system.m == 9  # six of the first, three of the second


HIP = {"name": "hip", "axis": (1, 0, 0), "inertia": 0.1}


def hinge(build, body):
    return build.revolute("hinge", build.ground, body, axis=(1, 0, 0), at=(0, 0, 0))


@pytest.mark.parametrize(("wrong", "message"), [
    (lambda b, x: b.body("a", mass=1, inertia=INERTIA), "'a'.*twice"),
    (lambda b, x: b.body("2a", mass=1, inertia=INERTIA), "'2a'"),
    (lambda b, x: b.body("c", mass=0, inertia=INERTIA), r"mass.*'c'.*0\.0"),
    (lambda b, x: b.body("c", mass=1, inertia=(1, -1, 1)), "inertia of 'c'"),
    (lambda b, x: b.body("c", mass=1, inertia=(1, 1)), "inertia.*'c'.* 2"),
    (lambda b, x: b.body("c", mass=1, inertia=INERTIA, rep="beta"), "'beta'.*gamma"),
    (lambda b, x: b.body("c", mass=1, inertia=INERTIA, quaternion=(0,) * 4), "is zero"),
    (lambda b, x: b.body("c", mass=1, inertia=INERTIA, rotation=2 * np.eye(3)), "no rotation"),
    (lambda b, x: b.body("c", mass=1, inertia=INERTIA, position=(0, 0, np.nan)), "position of 'c'"),
    (lambda b, x: b.body("c", mass=1, inertia=INERTIA, quaternion=(1, 0, 0, 0),
                         rotation=np.eye(3)), "'c'.*quaternion.*rotation"),
    (lambda b, x: b.body("c", mass=1, inertia=INERTIA, quaternion=np.eye(4)), "quaternion.*'c'"),
    (lambda b, x: b.chain("leg", b.ground, x, []), "'leg'.* 0 .*6"),
    (lambda b, x: b.chain("leg", b.ground, x, [{"name": "hip", "axis": (1, 0, 0)}]),
     "'hip'.*'leg'.*inertia"),
    (lambda b, x: b.drive("d", b.chain("leg", b.ground, x, [HIP]) and "hip", angle=b.time),
     "'d'.*'hip'.*chain"),
    (lambda b, x: b.flywheel("v", b.flywheel("w", hinge(b, x), inertia=1), inertia=1), "'v'.*'w'"),
    (lambda b, x: b.law("l", [hinge(b, x)], lambda angle: 1.0), "'l'.*coordinate"),
    (lambda b, x: b.law("l", [hinge(b, x)], lambda: 1.0), "'l'.* 1 "),
    (lambda b, x: b.ball("j", x, x), "to itself"),
    (lambda b, x: b.ball("j", x, "floor"), "'floor'"),
    (lambda b, x: b.ball("j", b.ground, x) and b.model(), "position"),
    (lambda b, x: b.revolute("j", b.ground, x, axis=(0, 0, 0)), "axis.*'j'"),
    (lambda b, x: b.spring("j", b.ground, x, stiffness=1, length=-1), "length.*'j'"),
    (lambda b, x: b.force(x, (1, 2)), "2 components"),
    (lambda b, x: b.force(x, {3.0, 1.0, 2.0}), "'a'.*list"),  # a set has no order
    (lambda b, x: gs.body_system("c", "gamma", 0, torque={3.0, 1.0, 2.0}), "torque.*list"),
    (lambda b, x: b.potential("x**2"), "SymPy"),
    (lambda b, x: b.potential(sp.Symbol("u")) or b.model(), "'u'.*no value"),
    (lambda b, x: b.input("idle") and b.model(), "'idle'.*force"),
    (lambda b, x: b.model(without=["j: x"]), "no constraint 'j: x'"),
])
def test_errors_name_value_and_cure(wrong, message):
    build = gs.Multibody("broken")
    body = build.body("a", mass=1, inertia=INERTIA)
    with pytest.raises(gs.InputError, match=message):
        wrong(build, body)


@pytest.mark.parametrize("length", [5e-324, 1e-200, 1e300])
def test_length_of_an_axis_does_not_matter(length):
    """The axis may be so long or short that its square is beyond the doubles."""
    starts = []
    for axis in ((0, 3, 4), (0, 3 * length, 4 * length)):
        build = gs.Multibody("door")
        body = build.body("a", mass=1, inertia=INERTIA, position=(1, 0, 0))
        build.revolute("hinge", build.ground, body, at=(0, 0, 0), axis=axis, rate=2.0)
        starts.append(build.model().p0)
    np.testing.assert_allclose(starts[1], starts[0], rtol=4 * EPS, atol=4 * EPS)


def test_empty_builders_and_starts_beyond_the_doubles_are_refused():
    build = gs.Multibody("comet")
    body = build.body("a", mass=1, inertia=INERTIA, position=(1e200, 0, 0))
    build.revolute("hinge", build.ground, body, at=(0, 0, 0), axis=(0, 0, 1), rate=1e200)
    with pytest.raises(gs.InputError, match=r"'comet'.*doubles"):
        build.model()
    with pytest.raises(gs.InputError, match="no body"):
        gs.Multibody("empty").model()


def test_expressions_of_a_body():
    """Velocity of a point, angular velocity and momentum equal vectors in NumPy."""
    build = gs.Multibody("thrown")
    body = build.body("a", mass=2.0, inertia=INERTIA, position=(1, 2, 3), velocity=(4, 5, 6),
                      quaternion=unit([0.5, -0.1, 0.7, 0.3]), angular_velocity=(0.3, -0.6, 0.9))
    model = build.model()
    R, omega = rotation_matrix(model.q0[:4]), np.array([0.3, -0.6, 0.9])
    values = dict(zip(model.system.q, model.q0, strict=True))
    values |= dict(zip(model.system.p, model.p0, strict=True))
    values |= {s: model.parameters[str(s)] for s in model.system.parameters}
    values |= dict(zip(body.inertia, INERTIA, strict=True))
    r = (0.2, -0.4, 0.1)
    for expression, expected in (
        (body.point(r), [1, 2, 3] + R @ r),
        (body.point_velocity(r), [4, 5, 6] + R @ np.cross(omega, r)),
        (body.angular_velocity, omega),
        (body.angular_momentum, R @ (np.array(INERTIA) * omega)),
        (body.centre_of_mass, [1, 2, 3]),
    ):
        assert np.abs(evaluate(expression, values) - expected).max() <= 16 * EPS * 8


POINTS = np.array([(0, 0, 0), (0.3, 0, -0.4), (0.4, 0.5, -0.6), (0, 0.5, -1.0)])


@pytest.mark.parametrize(("points", "axis", "freedom"), [
    (POINTS, None, 9), (POINTS * (1, 0, 1) + (0, 2, 0), (0, 1, 0), 3)], ids=["balls", "hinges"])
def test_rods_lead_from_point_to_point(points, axis, freedom):
    build = gs.Multibody("rods")
    rods = build.chain_of_rods(points, mass=[1.0, 2.0, 3.0], radius=0.02, axis=axis)
    model = build.model()
    assert model.system.n - model.system.m == freedom
    values = numeric(model.system, model.parameters, 0.0)
    assert np.abs(values.g(model.q0)).max() < 1e-15
    for rod, start, end in zip(rods, points[:-1], points[1:], strict=True):
        half = np.linalg.norm(end - start) / 2
        q = dict(zip(map(str, model.system.q), model.q0, strict=True))
        for point, expected in (((-half, 0, 0), start), ((half, 0, 0), end)):
            position = [float(e.subs({x: q[str(x)] for x in e.free_symbols}))
                        for e in rod.point(point)]
            np.testing.assert_allclose(position, expected, rtol=0, atol=1e-15)
    m, length = 3.0, np.linalg.norm(points[3] - points[2])
    across = m * (3 * 0.02**2 + length**2) / 12
    moments = [model.parameters[f"rod_3_I{k}"] for k in (1, 2, 3)]
    np.testing.assert_allclose(moments, [m * 0.02**2 / 2, across, across], rtol=4e-16)


@pytest.mark.parametrize(("arguments", "words"), [
    ({"points": [(0, 0, 0)]}, "points"), ({"points": "abc"}, "points"),
    ({"points": [(0, 0, 0), (0, 0, 0)]}, "1 and 2"), ({"mass": [1.0]}, "mass.*3 rods"),
    ({"mass": -1.0}, "rod_1.*above"), ({"radius": 0.0}, "radius"), ({"a": "nobody"}, "'nobody'")])
def test_what_is_no_chain_is_refused(arguments, words):
    with pytest.raises(gs.InputError, match=words):
        gs.Multibody("rods").chain_of_rods(**{"points": POINTS, "mass": 1.0} | arguments)
