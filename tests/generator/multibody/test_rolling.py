"""Discs, spheres and ellipsoids that roll on a plane: rows, heights, starts, refusals."""

import numpy as np
import pytest
from scipy.optimize import minimize

import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.generator.models.model_file import load_model
from gyrospark.generator.systems.numeric_system import numeric
from gyrospark.runtime.rigid_body.quaternion import left_matrix, rotation_matrix

Q = np.array([0.7, 0.4, -0.3, 0.5]) / np.sqrt(0.99)
OMEGA = np.array([0.3, -0.5, 2.0])
NORMAL = np.array([1.0, 2.0, 4.0]) / np.sqrt(21)
MIDDLE = np.array([0.02, -0.01, 0.05])


def stone(shape, plane=None, **body):
    """Return a body on a plane, with a shape that does not sit at its centre of mass."""
    build = gs.Multibody("stone")
    build.rolls("foot", build.body("s", mass=1.3, inertia=(0.02, 0.03, 0.04), quaternion=Q,
                                   angular_velocity=OMEGA, **body),
                on_body=MIDDLE, **shape, **(plane or {}))
    return build.model()


def points(shape):
    """Return the points of the surface of a shape, from its middle, as a function of two angles."""
    (kind, size), = shape.items()
    if kind == "disc":
        return lambda a: np.array([size * np.cos(a[0]), size * np.sin(a[0]), 0.0])
    axes = np.broadcast_to(size, 3)
    return lambda a: axes * [np.cos(a[0]) * np.cos(a[1]), np.sin(a[0]) * np.cos(a[1]), np.sin(a[1])]


TURNTABLE = {"normal": NORMAL, "at": (0.1, 0.2, 0.3), "turning": 1.5}


@pytest.mark.parametrize(("shape", "plane"), [
    ({"disc": 0.4}, TURNTABLE), ({"sphere": 0.4}, {}), ({"ellipsoid": (0.2, 0.3, 0.5)}, TURNTABLE)],
    ids=["disc on a turntable", "sphere on the floor", "ellipsoid on a turntable"])
def test_the_lowest_point_touches_the_plane_and_moves_with_it(shape, plane):
    """The contact agrees with a minimisation over the surface, which knows no support function."""
    model = stone(shape, plane)
    n, origin = np.array(plane.get("normal", (0, 0, 1.0))), np.array(plane.get("at", (0, 0, 0.0)))
    q, x = model.q0[:4], model.q0[4:]
    R, surface = rotation_matrix(q), points(shape)

    def above(angles):
        return n @ (x + R @ (MIDDLE + surface(angles)) - origin)

    best = min((minimize(above, start, method="BFGS", tol=1e-11)
                for start in ((0.1, 0.1), (2.0, -0.5), (4.0, 0.5))), key=lambda result: result.fun)
    assert best.fun == pytest.approx(0.0, abs=1e-12)
    rates = numeric(model.system, model.parameters).H_p(model.q0, model.p0)
    omega = 2 * left_matrix(q) @ rates[:4]
    np.testing.assert_allclose(omega, OMEGA, atol=1e-14)
    contact = x + R @ (MIDDLE + surface(best.x))
    carried = plane.get("turning", 0.0) * np.cross(n, contact - origin)
    velocity = rates[4:] + R @ np.cross(omega, MIDDLE + surface(best.x))
    np.testing.assert_allclose(velocity, carried, atol=1e-6)  # angles are known to √ε


def test_points_do_not_roll_and_positions_follow_from_rolling():
    model = stone({"sphere": 0.4})
    lower = rotation_matrix(Q) @ MIDDLE
    assert model.q0[6] == pytest.approx(0.4 - lower[2], rel=1e-15)
    omega, arm = rotation_matrix(Q) @ OMEGA, lower - [0, 0, 0.4]
    np.testing.assert_allclose(model.p0[4:], -1.3 * np.cross(omega, arm), rtol=1e-14)
    build = gs.Multibody("bead")
    with pytest.raises(InputError, match="'bead'"):
        build.rolls("foot", build.point_mass("bead", mass=1.0), sphere=0.1)


def test_a_body_about_a_fixed_point_may_roll():
    """The height of a cone's end on the floor follows from the fixed point; slips are two rows."""
    mill = gs.Multibody("mill")
    stone = mill.top("stone", mass=2.0, inertia=(0.7, 0.7, 0.1), centre=(0, 0, 0.5),
                     at=(0, 0, 0.3), rotation=[[0, 0, 1], [1, 0, 0], [0, 1, 0]],
                     angular_velocity=(0, 2.0, -4.0))
    mill.rolls("rim", stone, disc=0.3, on_body=(0, 0, 0.6))
    model = mill.model(redundant="leave out")
    rates = numeric(model.system, model.parameters).f(model.q0, model.p0)
    assert np.abs(rates).max() < 1e-14


def cart():
    """Return a builder with an axle and two wheels."""
    build = gs.Multibody("cart")
    axle = build.body("axle", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0, 0, 0.2))
    for side, name in ((-0.5, "left"), (0.5, "right")):
        build.rotor(name, axle, mass=0.3, inertia=(0.006, 0.003), axis=(0, 1, 0), at=(0, side, 0.2),
                    rate=3.0)
        build.rolls(f"{name}_rim", name, disc=0.2)
    return build


def test_two_wheels_on_one_line_are_redundant():
    with pytest.raises(InputError, match="right_rim") as refused:
        cart().model()
    assert "redundant" in str(refused.value)
    build = cart()
    model = build.model(redundant="leave out")
    assert model.system.velocity_count == 3
    assert len(build.redundancy.left_out) == 1
    assert model.p0[4] == pytest.approx(3.0 * 0.2, rel=1e-14)  # the axle's, of 1 kg


@pytest.mark.parametrize(("shape", "body", "named"), [
    ({}, {}, "disc, sphere and ellipsoid"),
    ({"disc": 1.0, "sphere": 1.0}, {}, "disc and sphere"),
    ({"disc": -1.0}, {}, "-1"),
    ({"ellipsoid": 1.0}, {}, "ellipsoid"),
    ({"sphere": 0.4}, {"position": (0, 0, 1.0)}, "above"),
    ({"sphere": 0.4}, {"position": (0, 0, 0.1)}, "below"),
])
def test_refused(shape, body, named):
    with pytest.raises(InputError, match=named):
        stone(shape, **body)


@pytest.mark.slow  # a stepper of one system
def test_a_ball_on_a_turntable_moves_on_a_circle_at_two_sevenths_of_its_rate():
    """The forces of the plane at the stages also carry its momentum and its weight."""
    build = gs.Multibody("turntable")
    ball = build.body("ball", mass=0.3, inertia=[0.4 * 0.3 * 0.05**2] * 3, velocity=(0, 0.2, 0),
                      position=(0.5, 0, 0.05))
    build.rolls("table", ball, sphere=0.05, turning=3.5)
    model = build.model()
    step = gs.stepper("G-L", 3, system=model.system)
    run = step.integrate(model.q0, model.p0, dt=0.01, steps=200, parameters=model.parameters)
    x, v = (run.q[:, 4:6], run.p[:, 4:6] / 0.3)
    z, rate = x[:, 0] + 1j * x[:, 1], 2 / 7 * 3.5
    circle = z[0] + (v[0, 0] + 1j * v[0, 1]) * (np.exp(1j * rate * run.t) - 1) / (1j * rate)
    assert np.abs(z - circle).max() < 1e-8
    height = model.system.constraint_names.index("table: height")
    np.testing.assert_allclose(run.multipliers[..., height], -0.3 * 9.81, rtol=1e-9)
    pushed = -0.01 * np.tensordot(run.reactions, [5 / 18, 8 / 18, 5 / 18], axes=(1, 0))
    np.testing.assert_allclose(np.diff(run.p[:, 4:6], axis=0), pushed, atol=1e-14)


def test_model_files_have_them(tmp_path):
    file = tmp_path / "marble.toml"
    file.write_text("""
name = "marble"
bodies = [{name = "ball", mass = 0.5, inertia = [0.002, 0.002, 0.002], position = [1, 0, 0.1]}]
joints = [{name = "table", type = "rolls", bodies = ["ball"], sphere = 0.1, turning = "30 rpm"}]
""", encoding="utf-8")
    model = load_model(file)
    assert model.system.velocity_constraint_names == ("table: slip 1", "table: slip 2")
    assert model.system.constraint_names[1] == "table: height"
    assert model.parameters["table_turning"] == pytest.approx(np.pi)
    np.testing.assert_allclose(model.p0[4:] / 0.5, [0, np.pi, 0], atol=1e-15)
