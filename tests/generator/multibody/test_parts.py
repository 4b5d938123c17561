"""Point masses and rotors: closed forms, other people's digits, the gyrostat's equations."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.generator.models.model_file import parse_model
from gyrospark.generator.multibody.initial_poses import onto, rotation
from robots import Motion
from strategies import EPS


def spherical() -> gs.Multibody:
    build = gs.Multibody("bob_on_a_rod")
    bob = build.point_mass("bob", mass=1.0, position=(1, 0, 0), velocity=(0, 1, 0))
    build.rod("rod", "ground", bob)
    return build


SPHERICAL = """
name = "bob_on_a_rod"
point_masses = [{name = "bob", mass = 1, position = [1, 0, 0], velocity = [0, 1, 0]}]
joints = [{name = "rod", type = "rod", bodies = ["ground", "bob"]}]
quantities = {height = "bob_z"}
run = {dt = 0.01, steps = 10}
"""


def test_files_have_points():
    model = parse_model(SPHERICAL, "bob.toml")
    built = spherical().model()
    assert model.system.H == built.system.H
    assert model.system.constraints == built.system.constraints
    assert model.p0.tolist() == built.p0.tolist()
    pendulum = {str(s): s for s in (*built.system.q, *built.system.p)}
    numbers = {s: built.parameters[str(s)] for s in built.system.parameters}
    x, y, z, u, v, w = (pendulum[f"bob_{name}"] for name in ("x", "y", "z", "px", "py", "pz"))
    H = built.system.H.subs(numbers)
    assert H.equals((u**2 + v**2 + w**2) / 2 + 9.81 * z)
    assert (built.system.constraints[0].subs(numbers)).equals(x**2 + y**2 + z**2 - 1)


def test_points_on_springs_and_balls():
    """A spring acts on both its ends; a ball passes on a position, and the start moves with it."""
    build = gs.Multibody("molecule", gravity=(0, 0, 0))
    build.point_mass("a", mass=2.0, position=(0, 0, 0))
    build.point_mass("b", mass=3.0, position=(1.5, 0, 0))
    build.spring("bond", "a", "b", stiffness=30.0, length=1.0)
    motion = Motion(build.model())
    np.testing.assert_allclose(motion.dp, [15, 0, 0, -15, 0, 0], rtol=1e-14)

    build = gs.Multibody("laden")
    rod = build.body("bar", mass=1.0, inertia=(0.1, 0.1, 0.01), position=(0, 0, 0.5),
                     angular_velocity=(1.0, 0, 0))
    build.point_mass("load", mass=5.0)
    build.ball("grip", rod, "load", on_a=(0, 0, 0.5))  # the load has one point
    model = build.model()
    assert model.q0[-3:].tolist() == [0, 0, 1]
    assert model.p0[-3:] == pytest.approx([0, -2.5, 0])


def gyrostat(C: float, across: float, e: np.ndarray, omega: np.ndarray, rate: float) -> np.ndarray:
    """Return Ω̇ of J'Ω̇ = (J Ω + C ν e) × Ω with constant h = C (e·Ω + ν), J' without C."""
    bus, arm, mass = np.diag([9.0, 8.0, 5.0]), np.array([0.3, 0.0, 0.1]), 80 * 4 / 84
    bare = bus + across * (np.eye(3) - np.outer(e, e))
    bare += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))  # about the common centre of mass
    return np.linalg.solve(bare, np.cross(bare @ omega + C * (e @ omega + rate) * e, omega))


def test_a_body_with_a_rotor_is_a_gyrostat():
    e, omega, rate = np.array([1, 2, 2]) / 3, np.array([0.4, -0.3, 0.5]), 60.0
    build = gs.Multibody("gyrostat", gravity=(0, 0, 0))
    bus = build.body("bus", mass=80.0, inertia=(9, 8, 5), angular_velocity=omega)
    wheel = build.rotor("wheel", bus, mass=4.0, inertia=(0.2, 0.11), axis=3 * e,
                        at=(0.3, 0, 0.1), rate=rate)
    build.quantity("spin", wheel.angular_velocity[2])
    for i, x in enumerate(bus.angular_velocity):
        build.quantity(f"omega{i}", x)
    model = build.model()
    assert (model.system.n, model.system.m) == (14, 7)
    motion = Motion(model)
    accelerations = [motion.acceleration(f"omega{i}") for i in range(3)]
    np.testing.assert_allclose(accelerations, gyrostat(0.2, 0.11, e, omega, rate), rtol=1e-11)
    assert abs(motion.acceleration("spin")) < 1e-11  # e·Ω + ν


@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0, -1), (1, 2, -2), (1e-9, 0, -1), (0, -3, 0)])
def test_the_third_axis_is_turned_onto_the_rotors(axis):
    q = onto(np.array(axis, dtype=float))
    assert abs(q @ q - 1) < 4 * EPS
    expected = np.array(axis) / np.linalg.norm(axis)
    assert np.abs(rotation(q)[:, 2] - expected).max() < 8 * EPS


@pytest.mark.parametrize(("call", "words"), [
    (lambda b: b.revolute("h", "bus", "bob", axis=(0, 0, 1), at=(1, 0, 0)),
     "'h'.*axes.*'bob'"),
    (lambda b: b.align("h", "bus", "bob", axis=(0, 0, 1)), "'h'.*axes.*'bob'"),
    (lambda b: b.universal("h", "bob", "bus", axis_a=(0, 0, 1), axis_b=(1, 0, 0)), "axes"),
    (lambda b: b.revolute("h", "grond", "bus", axis=(0, 0, 1), at=(0, 0, 0)),
     "'h'.*'grond'.*ground"),
    (lambda b: b.torque("bob", (0, 0, 1)), "torque.*'bob'"),
    (lambda b: b.force("bob", (0, 0, 1), on_body=(0.3, 0, 0)), r"\(0\.3, 0, 0\).*'bob'"),
    (lambda b: b.spring("s", "bob", "bus", stiffness=1, on_a=(0, 0.5, 0)), "on_a.*'s'.*'bob'"),
    (lambda b: b.fixed_point("s", "bob", at=(0, 0, 0), on_body=(0, 1, 0)), "on_b of 's'.*'bob'"),
    (lambda b: b.rod("s", "bus", "bob", on_b=(0, 1, 0)), "on_b of 's'.*'bob'"),
    (lambda b: b.contact("s", "bob", box=(1, 1, 1)), r"box.*'s'.*1, 1, 1.*'bob'"),
    (lambda b: b.contact("s", "bus", "bob", normal=(0, 0, 1)), "normal.*'s'.*axes.*'bob'"),
    (lambda b: b.point_mass("dot", mass=-1), r"mass.*'dot'.*-1\.0"),
    (lambda b: b.point_mass("bob", mass=1), "'bob'.*twice"),
    (lambda b: b.point_mass("dot", mass=1, position=(1, 2)), "position.*'dot'"),
    (lambda b: b.rotor("w", "bus", mass=1, inertia=(1, 1, 1), axis=(0, 0, 1), at=(0, 0, 0)),
     "inertia.*'w'.* 2"),
    (lambda b: b.rotor("w", "bus", mass=1, inertia=(1, 0.1), axis=(0, 0, 1), at=(0, 0, 0)),
     "inertia of 'w'"),
    (lambda b: b.rotor("w", "bus", mass=1, inertia=(1, 0.6), axis=(0, 0, 0), at=(0, 0, 0)),
     "axis.*'w'"),
    (lambda b: b.rotor("w", "bob", mass=1, inertia=(1, 0.6), axis=(0, 0, 1), at=(0, 0, 0)),
     "axes.*'bob'"),
])
def test_what_cannot_be_is_refused_in_a_sentence(call, words):
    build = gs.Multibody("parts")
    build.body("bus", mass=1, inertia=(1, 1, 1))
    build.point_mass("bob", mass=1)
    with pytest.raises(gs.InputError, match=words):
        call(build)
