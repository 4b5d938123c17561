"""Driven joints, moving points and motors of multibody models against formulas of one angle."""

import numpy as np
import pytest
import sympy as sp
from scipy.spatial.transform import Rotation

import gyrospark as gs
from gyrospark.core.errors import InputError
from robots import Motion
from strategies import EPS

MASS, INERTIA, ARM, GRAVITY = 0.8, 0.05, 0.4, 9.81
Z = (0, 0, 1)


def hanging(name="hanging"):
    return gs.Multibody(name, gravity=(0, -GRAVITY, 0))


def rod(build, name, **more):
    return build.body(name, mass=MASS, inertia=(INERTIA, 0.01, INERTIA), **more)


def angles(run, body):
    """Return the angle of a body about z, unwound."""
    R = run.rotation(body).as_matrix()
    return np.unwrap(np.arctan2(R[:, 1, 0], R[:, 0, 0]))


def test_a_body_at_a_point_that_moves():
    """It has (I + m d²) φ'' = −m d (P''_x cos φ + (g + P''_y) sin φ), φ from −y."""
    build = hanging("shaken_body")
    t = build.time
    pivot = build.moving_point("pivot", ((sp.cos(3 * t) - 1) / 5, (sp.cos(4 * t) - 1) / 10, 0))
    rod(build, "b")
    build.revolute("hinge", pivot, "b", axis=Z, on_b=(0, ARM, 0), at=(0, 0, 0), angle=0.3, rate=0.7)
    build.quantity("w", build.rate("hinge"))
    motion = Motion(build.model())
    turning = -1.8 * np.cos(0.3) + (GRAVITY - 1.6) * np.sin(0.3)
    expected = -MASS * ARM * turning / (INERTIA + MASS * ARM**2)
    assert motion.value("w") == pytest.approx(0.7, rel=1e-14)
    assert motion.acceleration("w") == pytest.approx(expected, rel=1e-12)


def test_a_driven_hinge_turns_as_prescribed_and_reports_its_torque():
    build = hanging("turned")
    t, rate = build.time, build.parameter("rate", 1.5)
    rod(build, "b")
    hinge = build.revolute("shaft", build.ground, "b", axis=Z, at=(0, 0, 0), on_b=(0, ARM, 0))
    law = rate * t + t**3 / 3
    build.drive("engine", hinge, angle=law)
    model = build.model()
    assert model.system.m == model.system.n  # no freedom remains
    step = gs.stepper("G-L", 3, system=model.system)
    run = step.integrate(model.q0, model.p0, dt=0.01, steps=80, parameters=model.parameters)
    f = 1.5 * run.t + run.t**3 / 3
    assert np.abs(angles(run, "b") - f).max() <= 64 * EPS
    rates = run.angular_velocity("b")[:, 2]
    assert np.abs(rates - (1.5 + run.t**2)).max() <= 256 * EPS
    row = model.system.constraint_names.index("engine: angle")
    torque = run.multipliers[:, -1, row]  # on b
    expected = (INERTIA + MASS * ARM**2) * 2 * run.t + MASS * GRAVITY * ARM * np.sin(f)
    assert np.abs(torque - expected[1:]).max() <= 1e-5
    assert np.abs(run.joint("engine").torque() - np.outer(expected, Z)).max() <= 1e-5
    assert np.abs(run.joint("engine").force()).max() == 0
    assert np.abs(run.joint("engine").angle() - f).max() <= 64 * EPS
    gain = run.energies - run.energies[0]
    assert np.abs(gain - run.work).max() <= 1e-12  # all of it is the engine's


@pytest.mark.parametrize("angle", [6.0, 0.4])
def test_all_angles_of_a_joint_between_two_bodies_are_one(angle):
    """A quantity and a spring have one angle in any attitude: H − T is ½ k (θ − rest)²."""
    build = gs.Multibody("one_angle", gravity=(0, 0, 0))
    moments = {"a": (0.1, 0.2, 0.3), "b": (0.2, 0.1, 0.3)}
    attitudes = {"a": (0.3, 0.2, 0.5), "b": (1.3, 0.1, -0.7)}
    for name, inertia in moments.items():
        body = build.top(name, mass=1, inertia=inertia, centre=(0, 0, 0),
                         rotation=Rotation.from_euler("ZXZ", attitudes[name]))
        for i, rate in enumerate(body.angular_velocity):
            build.quantity(f"{name}{i}", rate)
    build.align("pin", "a", "b", axis_in_space=np.array([0.6, 0.0, 0.8]), angle=angle, rate=3.0)
    build.quantity("turned", build.angle("pin"))
    build.joint_spring("spring", "pin", stiffness=2.0, rest=0.1)
    motion = Motion(build.model())
    assert motion.value("turned") == pytest.approx(angle, rel=1e-14)
    assert motion.acceleration("turned") == pytest.approx(3.0, rel=1e-13)
    spin = sum(moment * motion.value(f"{name}{i}") ** 2 / 2
               for name, inertia in moments.items() for i, moment in enumerate(inertia))
    assert motion.energy() == pytest.approx(spin + (angle - 0.1) ** 2, rel=1e-12)


def driven_about_an_oblique_axis():
    driven = gs.Multibody("one_driven", gravity=(0, 0, 0))
    driven.top("b", mass=1, inertia=(0.2, 0.1, 0.3), centre=(0, 0, 0),
              rotation=Rotation.from_euler("ZXZ", (1.3, 0.1, -0.7)))
    driven.align("pin", "ground", "b", axis=(0.6, 0.0, 0.8))
    driven.drive("engine", "pin", angle=6.0 + driven.time / 2)
    driven.quantity("turned", driven.angle("pin"))
    return driven.model()


def test_a_drive_and_a_quantity_have_one_angle():
    """They agree beyond half a turn, from a tilted start at 6 rad and 1/2 rad/s."""
    motion = Motion(driven_about_an_oblique_axis())
    assert motion.value("turned") == pytest.approx(6.0, rel=1e-14)
    assert motion.acceleration("turned") == pytest.approx(0.5, rel=1e-13)


def test_a_rate_is_that_of_the_law_but_for_its_rounding():
    """A rate of 0.6 is accepted where the law has 0.2 · 3, 0.6 + 1e-16 in doubles."""
    build = hanging("rounded")
    rod(build, "b", position=(0, -0.4, 0))
    build.revolute("shaft", "ground", "b", axis=Z, at=(0, 0, 0), rate=0.6)
    build.drive("engine", "shaft", angle=0.2 * sp.sin(3 * build.time))
    build.quantity("w", build.rate("shaft"))
    assert Motion(build.model()).value("w") == pytest.approx(0.6, rel=1e-14)


def test_a_motor_turns_by_its_law():
    """A servo on a body in no gravity has the torque k (target − φ) − c φ'."""
    build = gs.Multibody("servo", gravity=(0, 0, 0))
    k, c = build.parameter("k", 2.0), build.parameter("c", 0.05)
    build.top("b", mass=1, inertia=(0.1, 0.1, INERTIA), centre=(0, 0, 0))
    build.align("shaft", "ground", "b", axis=Z, angle=0.25, rate=3.0)
    build.motor("motor", "shaft", torque=k * (1 - build.angle("shaft")) - c * build.rate("shaft"))
    build.quantity("w", build.rate("shaft"))
    expected = (2 * 0.75 - 0.05 * 3) / INERTIA
    assert Motion(build.model()).acceleration("w") == pytest.approx(expected, rel=1e-12)
    pair = gs.Multibody("servo_pair", gravity=(0, 0, 0))  # and back on the other body
    bodies = {name: pair.top(name, mass=1, inertia=(0.1, 0.1, INERTIA), centre=(0, 0, 0))
              for name in "ab"}
    pair.align("fix", "ground", "a", axis=Z)
    pair.align("shaft", "a", "b", axis=Z)
    pair.motor("motor", "shaft", torque=sp.cos(pair.time) - pair.rate("shaft") / 100)
    for name in "ab":
        pair.quantity(f"w_{name}", bodies[name].angular_velocity[2])
    motion = Motion(pair.model())
    for name, sign in (("a", -1), ("b", 1)):  # cos 0, and no rate yet
        assert motion.acceleration(f"w_{name}") == pytest.approx(sign / INERTIA, rel=1e-12)


def test_wrong_use_ends_in_one_sentence():
    build = hanging("wrong")
    t = build.time
    rod(build, "b")
    hinge = build.revolute("shaft", build.ground, "b", axis=Z, at=(0, 0, 0), on_b=(0, ARM, 0),
                           rate=2.0)
    angled = hanging("angled")
    rod(angled, "b")
    angled.revolute("shaft", "ground", "b", axis=Z, at=(0, 0, 0), on_b=(0, ARM, 0), angle=0.5)
    for message, call in (
        ("both", lambda: build.drive("engine", hinge, angle=t)),
        ("start", lambda: build.drive("engine", hinge, angle=sp.sqrt(t))),
        ("one angle", lambda: angled.drive("engine", "shaft", angle=1 + angled.time)),
        ("contains 'z'", lambda: build.drive("engine", hinge, angle=sp.Symbol("z"))),
        ("shift", lambda: build.drive("engine", "shift", angle=t)),
        ("start", lambda: build.moving_point("p", (1 / t, 0, 0))),
        ("used twice", lambda: build.moving_point("b", (t, 0, 0))),
        ("components", lambda: build.moving_point("p", (t, 0))),
    ):
        with pytest.raises(InputError, match=message):
            call()
    build.drive("engine", hinge, angle=2 * t)
    build.drive("other", hinge, angle=2 * t)
    with pytest.raises(InputError, match="redundant"):
        build.model()
    ground = build.moving_point("p", (t, 0, 0))
    with pytest.raises(InputError, match="two bodies"):
        build.ball("nothing", ground, build.ground, at=(0, 0, 0))


FILE = """
name = "driven"
gravity = [0, -9.81, 0]
points = [{name = "pivot", path = ["sin(w*t)/5", 0, 0]}]
bodies = [
    {name = "upper", mass = 0.8, inertia = [0.05, 0.01, 0.05], position = [0, -0.4, 0]},
    {name = "lower", mass = 0.8, inertia = [0.05, 0.01, 0.05], position = [0, -1.2, 0]},
]
joints = [
    {name = "shaft", type = "revolute", bodies = ["pivot", "upper"], axis = [0, 0, 1], \
     at = [0, 0, 0]},
    {name = "pin", type = "revolute", bodies = ["upper", "lower"], axis = [0, 0, 1], \
     at = [0, -0.8, 0]},
]
drives = [{name = "engine", joint = "shaft", angle = "sin(2*t)"}]
forces = [
    {name = "servo", type = "motor", joints = ["pin"], torque = "k*(1 - pin_angle) - pin_rate/10"},
]
parameters = {w = 3, k = 2}
"""


def test_a_file_has_drives_motors_and_points(gyrospark, tmp_path):
    path = tmp_path / "driven.toml"
    path.write_text(FILE, encoding="utf-8")
    model = gs.load_model(path)
    build = hanging("driven")
    for name, y in (("upper", -0.4), ("lower", -1.2)):
        rod(build, name, position=(0, y, 0))
    w, k = build.parameter("w", 3.0), build.parameter("k", 2.0)
    build.moving_point("pivot", (sp.sin(w * build.time) / 5, 0, 0))
    build.revolute("shaft", "pivot", "upper", axis=Z, at=(0, 0, 0))
    build.revolute("pin", "upper", "lower", axis=Z, at=(0, -0.8, 0))
    build.drive("engine", "shaft", angle=sp.sin(2 * build.time))
    build.motor("servo", "pin", torque=k * (1 - build.angle("pin")) - build.rate("pin") / 10)
    built = build.model()
    assert np.abs(model.q0.astype(float) - built.q0).max() <= 4 * EPS
    assert np.abs(model.p0.astype(float) - built.p0).max() <= 4 * EPS
    assert dict(model.parameters) == dict(built.parameters)
    assert model.system == built.system
    for bad, message in ((FILE.replace('joint = "shaft"', 'joint = "shift"'), "shift"),
                         (FILE.replace('"sin(2*t)"', '"sin(2*upper_q0)"'), "upper_q0"),
                         (FILE.replace('"sin(w*t)/5"', '"1/t"'), "finite")):
        path.write_text(bad, encoding="utf-8")
        answer = gyrospark("run", path)
        assert answer.code == 2
        assert message in answer.stderr
        assert answer.stderr.count("\n") == 1


def test_dampers_know_how_fast_a_point_moves():
    """All dampers have s'' = −8 s − s'/2 with s = z − sin(5 t)/5 at t = 0."""
    build = gs.Multibody("shaken", gravity=(0, 0, 0))
    build.moving_point("P", (0, 0, sp.sin(5 * build.time) / 5))
    rails = {}
    for name in ("points", "spring", "motor"):
        build.body(name, mass=1.0, inertia=(1.0, 1.0, 1.0))
        rails[name] = build.prismatic(f"{name}_rail", "P", name, axis=(0, 0, 1), on_a=(0, 0, 0),
                                      on_b=(0, 0, 0), travel=0.3, speed=-1.0)
        build.quantity(f"{name}_speed", build.speed(rails[name]))
    build.spring("pull", "P", "points", stiffness=8.0)
    build.spring("damper", "P", "points", stiffness=0.0, length=1.0, damping=0.5)
    build.joint_spring("of_joint", rails["spring"], stiffness=8.0, damping=0.5)
    rail = rails["motor"]
    build.motor("servo", rail, force=-8 * build.travel(rail) - build.speed(rail) / 2)
    motion = Motion(build.model())
    for name in rails:
        assert motion.value(f"{name}_speed") == pytest.approx(-1.0, rel=1e-14)
        assert motion.acceleration(f"{name}_speed") == pytest.approx(-8 * 0.3 + 0.5, rel=1e-12)


def test_gears_and_drives_act_on_flywheels():
    """A gear of a geared rotor adds its inertia; a drive of a rotor turns its joint."""
    build = gs.Multibody("geared", gravity=(0, 0, 0))
    for k, rate in ((1, 1.0), (2, -4.0)):
        build.body(f"b{k}", mass=1, inertia=(0.1, 0.1, 0.2), position=(k, 0, 0))
        build.revolute(f"h{k}", "ground", f"b{k}", axis_in_space=(0, 0, 1), at=(k, 0, 0), angle=k,
                       rate=rate)
        build.quantity(f"w{k}", build.rate(f"h{k}"))
    build.flywheel("rotor", "h1", inertia=0.01, ratio=2.0)
    build.gear("mesh", "rotor", "h2", teeth=(2, 1))
    build.motor("push", "h1", torque=3.0)
    motion = Motion(build.model())
    expected = 3 / (0.2 + 0.01 * 2**2 + 0.2 * 4**2)
    assert motion.acceleration("w1") == pytest.approx(expected, rel=1e-12)
    assert motion.acceleration("w2") == pytest.approx(-4 * expected, rel=1e-12)

    build = gs.Multibody("driven", gravity=(0, 0, 0))
    build.body("b", mass=1, inertia=(0.1, 0.1, 0.2))
    build.revolute("h", "ground", "b", axis_in_space=(0, 0, 1), at=(0, 0, 0))
    build.flywheel("rotor", "h", inertia=0.01, ratio=5.0)
    build.drive("drive", "rotor", angle=3 * build.time + 10 * build.time**2)
    build.quantity("w", build.rate("h"))
    motion = Motion(build.model())
    assert motion.value("w") == pytest.approx(3 / 5, rel=1e-14)


def test_the_angle_of_a_screw_is_its_travel_driven_or_beyond_a_turn():
    """θ = 2π s/h for the law of a drive, which sets s at the start, and for a given travel."""
    lead, begin = 0.4, 7.5
    build = gs.Multibody("screws", gravity=(0, 0, -GRAVITY))
    t = build.time
    for name, x in (("driven", 0.0), ("free", 1.0)):
        build.body(name, mass=MASS, inertia=(0.1, 0.1, INERTIA), position=(x, 0, 0.03))
    # the points of the second screw are 3 cm apart along its axis, where its travel is 0
    thread = build.screw("thread", "ground", "driven", lead=lead, axis=Z, at=(0, 0, 0))
    build.screw("fall", "ground", "free", lead=lead, axis=Z, on_a=(1, 0, 0), on_b=(0, 0, 0),
                travel=0.6)
    build.drive("engine", thread, angle=begin + t)
    for measure in ("angle", "travel"):
        build.quantity(f"driven_{measure}", getattr(build, measure)("thread"))
    model = build.model()
    run = gs.stepper("IMS", system=model).integrate(model, dt=0.01, steps=20)
    law = begin + run.t
    for angle in (run.quantity("driven_angle"), run.joint("thread").angle(),
                  2 * np.pi / lead * run.quantity("driven_travel")):
        assert np.abs(angle - law).max() <= 256 * EPS
    fall = run.body("free").position()[:, 2] - 0.03
    assert fall[0] == pytest.approx(0.6, abs=16 * EPS)
    assert np.abs(run.joint("fall").angle() - 2 * np.pi / lead * fall).max() <= 256 * EPS
    angled = gs.Multibody("angled_screw")
    angled.body("b", mass=1, inertia=(0.1, 0.1, 0.2))
    angled.screw("thread", "ground", "b", lead=lead, axis=Z, at=(0, 0, 0), travel=0.05)
    with pytest.raises(InputError, match=r"'engine'.*0\.785.*travel"):
        angled.drive("engine", "thread", angle=angled.time)
    angled.drive("engine", "thread", angle=np.pi / 4 + angled.time)
    assert angled.model().q0[-1] == pytest.approx(0.05, abs=EPS)


def test_a_gear_begins_where_a_screw_stands():
    """The travel of a screw turns the other wheel no more than the angle of a hinge does."""
    build = gs.Multibody("geared_screw", gravity=(0, 0, 0))
    for name, x in (("nut", 0), ("wheel", 1)):
        build.body(name, mass=1, inertia=(0.1, 0.1, 0.2), position=(x, 0, 0))
    build.screw("thread", "ground", "nut", lead=0.5, axis=Z, at=(0, 0, 0), travel=0.1)
    build.revolute("hinge", "ground", "wheel", axis=Z, at=(1, 0, 0))
    build.gear("mesh", "thread", "hinge", teeth=(1, 2))
    np.testing.assert_allclose(build.model().q0[7:11], [1, 0, 0, 0], atol=16 * EPS)


def test_a_derivative_by_time_of_a_measure_is_warned_of():
    """The derivative is 0, because the symbols of joints do not depend on the time."""
    build = gs.Multibody("turning", gravity=(0, 0, 0))
    build.body("b", mass=1, inertia=(0.1, 0.1, 0.2))
    build.revolute("h", "ground", "b", axis_in_space=(0, 0, 1), at=(0, 0, 0))
    with pytest.warns(UserWarning, match="'acceleration' is 0"):
        build.quantity("acceleration", sp.diff(build.rate("h"), build.time))
    build.quantity("rate", build.rate("h"))  # no warning
