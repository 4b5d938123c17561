"""Joints, springs, gears and motors, each against a closed form of its accelerations."""

import inspect
import math

import numpy as np
import pytest
import sympy as sp
from scipy.spatial.transform import Rotation

import gyrospark as gs
from gyrospark.generator.multibody.coordinates import Arm, Chain
from gyrospark.generator.multibody.joints import Align, Connection, Revolute, Rod, Spring
from gyrospark.generator.multibody.multibody import JOINTS
from gyrospark.generator.systems.numeric_system import numeric
from robots import Motion

BOX = {"mass": 2.0, "inertia": (0.3, 0.4, 0.5)}
EPS = np.finfo(float).eps


def builder(name="one", gravity=(0, 0, -9.81)):
    return gs.Multibody(name, gravity=gravity)


def test_a_box_on_a_slope_with_spring_and_motor():
    """A prismatic joint has s'' = (−k (s − rest) + F)/m + g·e."""
    build = builder()
    e = np.array([3.0, 0, -4.0]) / 5
    build.body("box", **BOX, position=(1, 2, 3), quaternion=(0.1, 0.7, -0.5, 0.5))
    slope = build.prismatic("slope", "ground", "box", axis=e, at=(1, 2, 3), speed=0.7, travel=0.2)
    build.joint_spring("coil", slope, stiffness=50.0, rest=0.05)
    build.motor("push", slope, force=4.0)
    build.quantity("s", build.travel(slope))
    build.quantity("v", build.speed(slope))
    motion = Motion(build.model())
    assert (motion.value("s"), motion.value("v")) == pytest.approx((0.2, 0.7), rel=1e-14)
    assert motion.acceleration("s") == pytest.approx(0.7, rel=1e-14)
    expected = (-50.0 * (0.2 - 0.05) + 4.0) / 2 + 9.81 * 0.8
    assert motion.acceleration("v") == pytest.approx(expected, rel=1e-12)
    assert np.abs(motion.dq[:4]).max() <= 1e-14  # it does not turn


def test_a_damped_pair_on_a_line():
    """A spring with damper between two points has μ d'' = −k (d − length) − c d'."""
    build = builder(gravity=(0, 0, 0))
    build.body("one", **BOX, position=(0, 0, 0))
    build.body("two", **BOX, position=(2.0, 0, 0), velocity=(0.5, 0, 0))
    build.spring("line", "one", "two", stiffness=40.0, length=1.5, damping=3.0)
    build.quantity("rate", (sp.Symbol("two_px", real=True) - sp.Symbol("one_px", real=True)) / 2)
    motion = Motion(build.model())
    assert motion.value("rate") == pytest.approx(0.5, rel=1e-14)
    assert motion.acceleration("rate") == pytest.approx(-40 * 0.5 - 3 * 0.5, rel=1e-12)


@pytest.mark.parametrize(("travel", "speed"), [
    pytest.param(0.0, 0.0, marks=pytest.mark.slow), (0.25, 0.4)])
def test_a_slider_off_its_place_on_a_spinning_carrier(travel, speed):
    """The slider moves with the carrier at its own place, ω × (r + d), before any projection."""
    build = builder()
    build.body("carrier", mass=1.0, inertia=(0.1, 0.1, 0.1), angular_velocity=(0, 0, 3.0))
    build.body("box", **BOX, position=(1, 0, 0))
    build.revolute("axle", "ground", "carrier", axis=(0, 0, 1), at=(0, 0, 0), rate=3.0)
    slide = build.prismatic("slide", "carrier", "box", axis=(1, 0, 0), at=(0.3, 0, 0),
                            on_b=(0, 0, 0), travel=travel, speed=speed)
    build.quantity("s", build.travel(slide))
    build.quantity("v", build.speed(slide))
    model = build.model(redundant="leave out")
    np.testing.assert_allclose(model.p0[-3:], [2 * speed, 2 * 3.0 * (1 + travel), 0], atol=1e-14)
    numbers = dict(zip(model.system.q, model.q0, strict=True)) | dict(
        zip(model.system.p, model.p0, strict=True)) | {
        symbol: model.parameters[str(symbol)] for symbol in model.system.parameters}
    s, v = (float(model.system.quantities[name].subs(numbers)) for name in "sv")
    assert (s, v) == pytest.approx((travel, speed), abs=1e-14)


def test_cylinder_on_a_pole():
    """A cylindrical joint falls along the pole and turns about it independently."""
    build = builder()
    build.body("ring", **BOX)
    pole = build.cylindrical("pole", "ground", "ring", axis=(0, 0, 1), at=(0, 0, 0),
                             on_b=(0, 0, 0), rate=3.0, speed=1.0)
    build.motor("brake", pole, torque=-0.2 * build.rate(pole))
    build.quantity("s", build.travel(pole))
    build.quantity("v", build.speed(pole))
    build.quantity("theta", build.angle(pole))
    build.quantity("w", build.rate(pole))
    motion = Motion(build.model())
    for name, rate in (("s", 1.0), ("v", -9.81), ("theta", 3.0), ("w", -0.2 * 3.0 / 0.5)):
        assert motion.acceleration(name) == pytest.approx(rate, rel=1e-12), name


def test_the_angle_of_a_screw_counts_all_turns():
    """θ = 2π s/h holds with its rate 3.4 turns from the pose in which s = 0."""
    build = builder()
    build.body("nut", **BOX)
    thread = build.screw("thread", "ground", "nut", axis=(0, 0, 1), at=(0, 0, 0),
                         on_b=(0, 0, 0), lead=0.05, travel=0.17, rate=2.0)
    build.quantity("theta", build.angle(thread))
    build.quantity("w", build.rate(thread))
    motion = Motion(build.model())
    assert motion.value("theta") == pytest.approx(3.4 * 2 * math.pi, rel=1e-14)
    assert motion.value("w") == pytest.approx(2.0, rel=1e-14)
    rate = 9.81 * 2 * math.pi / 0.05 / (1 + 0.5 * (2 * math.pi / 0.05)**2 / 2.0)
    assert motion.acceleration("theta") == pytest.approx(2.0, rel=1e-12)
    assert motion.acceleration("w") == pytest.approx(-rate, rel=1e-12)


def test_a_puck_on_a_slope():
    """A planar joint falls in the plane, and turns steadily about its normal."""
    build = builder()
    n = np.array([0, 0.6, 0.8])
    build.body("puck", mass=1.0, inertia=(0.1, 0.1, 0.2), velocity=(1.0, 0.8, -0.6),
               rotation=np.array([[1, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]]))
    build.planar("plane", "ground", "puck", axis=n, at=(0, 0, 0), on_b=(0, 0, 0), rate=2.0)
    build.quantity("theta", build.angle("plane"))
    build.quantity("w", build.rate("plane"))
    motion = Motion(build.model())
    down = np.array([0, 0, -9.81]) + 9.81 * 0.8 * n
    assert np.abs(motion.dq[4:7] - [1.0, 0.8, -0.6]).max() <= 1e-14
    assert np.abs(motion.dp[4:7] - down).max() <= 1e-13
    assert motion.acceleration("theta") == pytest.approx(2.0, rel=1e-13)
    assert abs(motion.acceleration("w")) <= 1e-13


def test_universal_joint_between_shafts():
    """tan θ₂ = cos β tan θ₁ and I₁ θ₁'² + I₂ θ₂'² hold; two bearings make three rows redundant."""
    bend, angle, rate = 0.6, 0.7, 2.0
    build = builder("cardan", (0, 0, 0))
    along = np.array([math.cos(bend), math.sin(bend), 0.0])
    turned = np.array([[along[0], -along[1], 0], [along[1], along[0], 0], [0, 0, 1]])
    build.body("one", mass=1.0, inertia=(0.2, 0.1, 0.1), position=(-1, 0, 0))
    build.body("two", mass=1.0, inertia=(0.3, 0.2, 0.2), position=along, rotation=turned)
    build.revolute("in", "ground", "one", axis=(1, 0, 0), at=(-1, 0, 0), angle=angle, rate=rate)
    build.universal("cross", "one", "two", axis_a=(0, 0, 1), axis_b=(-along[1], along[0], 0),
                    at=(0, 0, 0))
    build.revolute("out", "ground", "two", axis=along, at=along)
    for name, joint in (("one", "in"), ("two", "out")):
        build.quantity(name, build.angle(joint))
        build.quantity(f"{name}_rate", build.rate(joint))
    with pytest.raises(gs.InputError, match=r"16.*'cardan'"):
        build.model()
    motion = Motion(build.model(redundant="leave out"))
    assert motion.system.m == 13  # 14 coordinates, one freedom
    assert len(build.redundancy.left_out) == 3
    assert motion.value("one") == pytest.approx(angle, rel=1e-13)
    assert np.tan(motion.value("two")) == pytest.approx(np.cos(bend) * np.tan(angle), rel=1e-13)
    shape = 1 - (np.sin(bend) * np.sin(angle)) ** 2
    slope = np.cos(bend) / shape  # dθ₂/dθ₁, and its own slope by θ₁
    bent = np.cos(bend) * np.sin(bend) ** 2 * np.sin(2 * angle) / shape**2
    assert motion.value("two_rate") == pytest.approx(slope * rate, rel=1e-13)
    assert motion.acceleration("one_rate") == pytest.approx(
        -0.3 * slope * bent * rate**2 / (0.2 + 0.3 * slope**2), rel=1e-12)


def test_gears_turn_as_often_as_they_like():
    """17 θ₁ + 43 θ₂ = 0 holds over ten turns to the rounding ε of an angle."""
    build = builder("gears", (0, 0, 0))
    for name, x in (("small", 0.0), ("large", 1.0)):
        build.body(name, mass=1.0, inertia=(0.1, 0.1, 0.05), position=(x, 0, 0))
        build.revolute(f"axle_{name}", "ground", name, axis=(0, 0, 1), at=(x, 0, 0))
    build.gear("mesh", "axle_small", "axle_large", teeth=(34, 86))
    model = build.model()
    numbers = numeric(model.system, model.parameters)
    for angle in np.linspace(0, 20 * np.pi, 97):
        q = model.q0.copy()
        q[[0, 3, 7, 10]] = [f(a) for a in (angle / 2, -17 / 86 * angle) for f in (np.cos, np.sin)]
        assert np.abs(numbers.g(q)).max() <= (17 + 43) * 20 * np.pi * EPS
    q[10] = np.sin(-17 / 86 * angle + 0.01)
    assert np.abs(numbers.g(q)).max() > 0.1


def test_a_rack_an_elevator_and_a_finger():
    """Couples of travels, of angle and travel, and of angles have c₂ = ratio c₁ + offset."""
    ratio = 0.3137
    build = builder("coupled", (0, 0, 0))
    for name in "abcd":
        build.body(name, mass=1.0, inertia=(0.1, 0.1, 0.1))
    for name, speed, travel in (("a", 0.8, 0.0), ("b", 0.8 * ratio, 0.25)):
        slide = build.prismatic(f"s{name}", "ground", name, axis=(1, 0, 0), at=(0, 0, 0),
                                on_b=(0, 0, 0), speed=speed, travel=travel)
        build.quantity(name, build.speed(slide))
    for name, rate, angle in (("c", 0.4 * ratio, 0.0), ("d", 0.4 * ratio**2, -0.1)):
        hinge = build.revolute(f"s{name}", "ground", name, axis=(0, 0, 1), at=(0, 0, 0),
                               on_b=(0, 0, 0), rate=rate, angle=angle)
        build.quantity(name, build.rate(hinge))
    build.couple("ab", "sa", "sb", ratio=ratio, offset=0.25)
    build.couple("bc", "sb", "sc", ratio=0.5, offset=-0.125)
    build.couple("cd", "sc", "sd", ratio=ratio, offset=-0.1)
    build.motor("push", "sa", force=3.0 * sp.cos(build.time))
    motion = Motion(build.model())
    assert motion.system.n - motion.system.m == 1
    mass = 1 + ratio**2 + 0.1 * (ratio / 2) ** 2 + 0.1 * (ratio**2 / 2) ** 2
    for name, share in (("a", 1), ("b", ratio), ("c", ratio / 2), ("d", ratio**2 / 2)):
        assert motion.value(name) == pytest.approx(0.8 * share, rel=1e-13), name
        assert motion.acceleration(name) == pytest.approx(3 / mass * share, rel=1e-12), name


def test_wrong_joints_are_refused():
    build = builder()
    build.body("a", **BOX)
    build.body("b", **BOX)
    build.ball("ball", "a", "b", at=(0, 0, 0))
    build.revolute("hinge", "ground", "a", axis=(0, 0, 1), at=(0, 0, 0))
    for call, message in [
        (lambda: build.screw("s", "a", "b", axis=(0, 0, 1), lead=0.0), "lead.*'s'.*0"),
        (lambda: build.universal("u", "a", "b", axis_a=(1, 0, 0), axis_b=(1, 1, 0)),
         "right angles"),
        (lambda: build.angle("ball"), "'ball'.*angle"),
        (lambda: build.travel("hinge"), "'hinge'.*travel.*angle"),
        (lambda: build.angle("hing"), "'hing'"),
        (lambda: build.gear("g", "hinge", "ball", teeth=(1, 2)), "'ball'.*angle"),
        (lambda: build.gear("g", "hinge", "hinge", teeth=(1, 0)), r"teeth.*\(1, 0\)"),
        (lambda: build.motor("m", "hinge"), "torque"),
        (lambda: build.motor("m", "hinge", force=1.0), "travel"),
        (lambda: build.prismatic("p", "a", "b", axis=(0, 0, 0)), "axis.*'p'"),
        (lambda: build.couple("c", "ball", "hinge"), "'ball'.*coordinate"),
        (lambda: build.model(redundant="maybe"), "redundant 'maybe'"),
        (lambda: build.joint_spring("s", "hinge"), "'s'.*stiffness.*damping"),
        (lambda: build.joint_spring("s", "hinge", damping=1, rest=1), "'s'.*stiffness"),
        (lambda: build.joint_spring("s", "hinge", damping=-1), "damping.*'s'.*-1.*0 or more"),
        (lambda: build.spring("s", "a", "b", stiffness=1, damping=-2), "damping.*'s'.*-2.*0 or"),
        (lambda: build.spring("s", "a", "b", stiffness=1, length=-2), "length.*'s'.*-2.*0 or"),
    ]:
        with pytest.raises(gs.InputError, match=message):
            call()


def test_files_have_what_acts_on_joints(tmp_path):
    """Gear, coupling, spring, motor and measures in TOML make the same system as in Python."""
    (tmp_path / "wheels.toml").write_text(WHEELS, encoding="utf-8")
    loaded = gs.load_model(tmp_path / "wheels.toml")
    build = builder("wheels", (0, 0, 0))
    for name, x in (("one", 0.0), ("two", 1.0)):
        build.body(name, mass=1.0, inertia=(0.1, 0.1, 0.2), position=(x, 0, 0))
        build.revolute(f"axle_{name}", "ground", name, axis=(0, 0, 1), at=(x, 0, 0),
                       **({"angle": math.pi / 6} if name == "one" else {}))
    build.gear("mesh", "axle_one", "axle_two", teeth=(1, 2))
    build.joint_spring("coil", "axle_one", damping=0.1, stiffness=2, rest=(-1, 9))
    build.motor("drive", "axle_two", torque=sp.Rational(1, 4) - build.angle("axle_one"))
    build.quantity("turned", build.angle("axle_one"))
    built = build.model()
    assert loaded.system == built.system
    assert loaded.parameters == pytest.approx(built.parameters)
    for old, new, message in [
        ('joints = ["axle_one"]', 'joints = []', "0 names"),
        ("teeth = [1, 2]", "teeth = [1, 2, 3]", "teeth"),
        ("axle_one_angle", "axle_one_travel", "axle_one_travel"),
        ("damping = 0.1", "damping = -0.1", "damping.*-0.1.*0 or more"),
    ]:
        assert old in WHEELS
        (tmp_path / "wheels.toml").write_text(WHEELS.replace(old, new), encoding="utf-8")
        with pytest.raises(gs.InputError, match=message):
            gs.load_model(tmp_path / "wheels.toml")


WHEELS = """
name = "wheels"
gravity = [0, 0, 0]
bodies = [
    {name = "one", mass = 1, inertia = [0.1, 0.1, 0.2], position = [0, 0, 0]},
    {name = "two", mass = 1, inertia = [0.1, 0.1, 0.2], position = [1, 0, 0]},
]
joints = [
    {name = "axle_one", type = "revolute", bodies = ["ground", "one"], axis = [0, 0, 1], \
     at = [0, 0, 0], angle = "30 deg"},
    {name = "axle_two", type = "revolute", bodies = ["ground", "two"], axis = [0, 0, 1], \
     at = [1, 0, 0]},
    {name = "mesh", type = "gear", joints = ["axle_one", "axle_two"], teeth = [1, 2]},
]
forces = [
    {name = "coil", type = "joint_spring", joints = ["axle_one"], damping = 0.1, stiffness = 2, \
     rest = [-1, 9]},
    {name = "drive", type = "motor", joints = ["axle_two"], torque = "1/4 - axle_one_angle"},
]
quantities = {turned = "axle_one_angle"}
"""


@pytest.mark.parametrize(("travel", "force"), [(-0.2, 800 * 0.15), (0.03, 0.0), (0.3, -800 * 0.2)])
def test_a_spring_is_slack_in_an_interval(travel, force):
    """The spring has V = ½ k d² on both sides of the interval, and no force inside."""
    build = builder(gravity=(0, 0, 0))
    build.body("box", **BOX)
    slide = build.prismatic("slide", "ground", "box", axis=(1, 0, 0), at=(0, 0, 0), travel=travel,
                            speed=1.0)
    build.joint_spring("ends", slide, stiffness=800.0, rest=(-0.05, 0.1))
    build.quantity("v", build.speed(slide))
    motion = Motion(build.model())
    assert motion.acceleration("v") == pytest.approx(force / 2, rel=1e-12, abs=1e-12)
    assert motion.energy() == pytest.approx(1.0 + force**2 / 1600, rel=1e-12)
    with pytest.raises(gs.InputError, match="lower"):
        build.joint_spring("ends_too", slide, stiffness=1.0, rest=(0.1, 0))


def test_a_ball_turns_a_flywheel():
    """From rest, j₂ ω₂' + a (ω₂' − ω₁') = τ and j₁ ω₁' = a (ω₂' − ω₁')."""
    build = builder(gravity=(0, 0, 0))
    j1, j2, a, torque = 0.3, 0.2, 0.1, np.array([1.0, -2.0, 0.5])
    first = build.body("first", mass=1, inertia=(j1,) * 3, position=(1, 0, 0))
    second = build.body("second", mass=1, inertia=(j2,) * 3, quaternion=(0.1, 0.7, -0.5, 0.5))
    ball = build.ball("ball", first, second, on_a=(0, 0, 0), on_b=(0, 0, 0))
    build.flywheel("rotor", ball, inertia=a)
    build.torque(second, torque)
    for k in range(3):
        build.quantity(f"u{k}", first.angular_velocity[k])
        build.quantity(f"w{k}", second.angular_velocity[k])
    model = build.model()
    assert all(s.is_positive for s in model.system.parameters if "inertia" in str(s))
    motion = Motion(model)
    w = torque * (j1 + a) / (j1 * j2 + a * (j1 + j2))
    R = Rotation.from_quat([0.7, -0.5, 0.5, 0.1]).as_matrix()
    assert [motion.acceleration(f"w{k}") for k in range(3)] == pytest.approx(w, rel=1e-12)
    assert [motion.acceleration(f"u{k}") for k in range(3)] == pytest.approx(
        R @ w * a / (j1 + a), rel=1e-12)
    with pytest.raises(gs.InputError, match="ratio"):
        build.flywheel("another", ball, inertia=a, ratio=2.0)


TOPS = """
name = "tops"
bodies = [
    {name = "outer", mass = 1, inertia = [0.1, 0.1, 0.2], angular_velocity = [1, 2, 3]},
    {name = "inner", mass = 1, inertia = [0.1, 0.1, 0.2]},
]
joints = [
    {name = "foot", type = "fixed_point", bodies = ["outer"], at = [0, 0, 0], \
     on_body = [0, 0, -0.5]},
    {name = "middle", type = "ball", bodies = ["outer", "inner"], at = [0, 0, 0.5]},
    {name = "axis", type = "align", bodies = ["outer", "inner"], axis = [0, 3, 4], rate = "30 rpm"},
]
"""


def test_model_files_have_the_joints_of_python():
    methods = {name for name, thing in vars(gs.Multibody).items()
               if inspect.isfunction(thing) and not name.startswith("_")
               and {"a", "b"} <= set(inspect.signature(thing).parameters)}
    # MJCF's robots have joints that are mappings; contacts and latches have tables of their own.
    methods -= {"chain", "contact", "latch"}
    assert methods | {"fixed_point", "rolls"} == {*JOINTS, "spring"}


def test_align_in_a_file(tmp_path):
    """``align`` beside a ball, which makes a hinge, gives the same system as in Python."""
    (tmp_path / "tops.toml").write_text(TOPS, encoding="utf-8")
    loaded = gs.load_model(tmp_path / "tops.toml")
    build = gs.Multibody("tops")
    for name, options in (("outer", {"angular_velocity": (1, 2, 3)}), ("inner", {})):
        build.body(name, mass=1, inertia=(0.1, 0.1, 0.2), **options)
    build.fixed_point("foot", "outer", at=(0, 0, 0), on_body=(0, 0, -0.5))
    build.ball("middle", "outer", "inner", at=(0, 0, 0.5))
    build.align("axis", "outer", "inner", axis=(0, 3, 4), rate=np.pi)
    built = build.model()
    assert loaded.system.constraints == built.system.constraints
    assert loaded.system.constraint_names[-2:] == ("axis: axis 1", "axis: axis 2")
    assert loaded.p0 == pytest.approx(built.p0, abs=1e-14)
    (tmp_path / "tops.toml").write_text(TOPS.replace("axis = [0, 3, 4], ", ""), encoding="utf-8")
    with pytest.raises(gs.InputError, match="axis"):
        gs.load_model(tmp_path / "tops.toml")


def kinds_of(base):
    """Yield the kinds of connections under a base, and theirs, that have no kinds under them."""
    for kind in base.__subclasses__():
        yield from kinds_of(kind) if kind.__subclasses__() else [kind]


def test_each_kind_of_connection_contributes_to_the_system():
    """A kind gives equations, an energy or forces; the arm of a universal joint is measured."""
    kinds = set(kinds_of(Connection)) - {Arm}
    assert kinds >= {Align, Revolute, Rod, Spring, Chain}
    for kind in kinds:
        defined = {name for base in kind.__mro__ if base not in (Connection, object)
                   for name in vars(base)}
        assert defined & {"equations", "energy", "forces"}, kind
