"""Starts: angles and travels of joints set the pose; given velocities hold or are refused."""

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

import gyrospark as gs
from gyrospark import InputError
from gyrospark.errors import InputWarning
from robots import Motion

EPS = np.finfo(float).eps
#: Round-off of a start: a projection of some tens of coordinates, of size 1 to 10.
ROUNDING = 2**10 * EPS
BODY = {"mass": 1.0, "inertia": (0.1, 0.2, 0.3)}


def rod(body=(), **hinge):
    """Return a builder of a rod along x, hinged at the origin about −y: its angle lifts it."""
    build = gs.Multibody("rod", gravity=(0, 0, 0))
    build.body("rod", mass=1.0, inertia=(0.1, 0.1, 0.1), position=(0.5, 0, 0), **dict(body))
    build.revolute("h", "ground", "rod", axis=(0, -1, 0), at=(0, 0, 0), **hinge)
    return build


def four_bar(**hinges):
    """Return a builder of crank 0.4, coupler and rocker in the plane z = 0, the crank upwards."""
    build = gs.Multibody("four_bar", gravity=(0, 0, 0))
    points = np.array([[0, 0, 0], [0, 0.4, 0], [0.9, 0.8, 0], [1.0, 0, 0]])
    frames = ["ground", "crank", "coupler", "rocker", "ground"]
    for k in range(3):
        build.body(frames[k + 1], **BODY, position=(points[k] + points[k + 1]) / 2)
    for k in range(4):
        build.revolute(f"h{k}", frames[k], frames[k + 1], axis=(0, 0, 1), at=points[k],
                       **hinges.get(f"h{k}", {}))
    return build


def pose_of(model, name):
    """Return rotation and position of a body at the start."""
    first = [str(x) for x in model.system.q].index(f"{name}_q0")
    q = model.q0[first : first + 7]
    return Rotation.from_quat(q[[1, 2, 3, 0]]), q[4:]


def motion_of(model, name, moments):
    """Return velocity of the centre of mass, of mass 1, and angular velocity in body axes."""
    first = [str(x) for x in model.system.p].index(f"{name}_p0")
    q, p = model.q0[first : first + 4], model.p0[first : first + 7]
    a, b, c, d = q
    L = np.array([[-b, a, d, -c], [-c, -d, a, b], [-d, c, -b, a]])
    return p[4:], L @ p[:4] / 2 / np.array(moments)


def test_a_hinge_starts_at_its_angle():
    build = rod(angle=0.5, rate=2.0)
    build.quantity("angle", build.angle("h"))
    build.quantity("rate", build.rate("h"))
    model = build.model()
    motion = Motion(model)
    assert motion.value("angle") == pytest.approx(0.5, abs=4 * EPS)
    assert motion.value("rate") == pytest.approx(2.0, rel=4 * EPS)
    np.testing.assert_allclose(pose_of(model, "rod")[1],
                               [0.5 * math.cos(0.5), 0, 0.5 * math.sin(0.5)], atol=4 * EPS)


def test_the_same_in_a_file(tmp_path):
    file = tmp_path / "rod.toml"
    file.write_text("""
name = "rod"
gravity = [0, 0, 0]
bodies = [{name = "rod", mass = 1, inertia = [0.1, 0.1, 0.1], position = [0.5, 0, 0]}]
joints = [
    {name = "h", type = "revolute", bodies = ["ground", "rod"], axis = [0, -1, 0], \
     at = [0, 0, 0], angle = "30 deg"},
]
""", encoding="utf-8")
    np.testing.assert_allclose(gs.load_model(file).q0, rod(angle=math.pi / 6).model().q0,
                               atol=4 * EPS)
    file.write_text(file.read_text(encoding="utf-8").replace(
        ', angle = "30 deg"', "").replace("position", "velocity = [0, 1, 1], position"),
        encoding="utf-8")
    with pytest.raises(InputError, match=r"velocity.*'rod'.*\[0, 1, 1\].*nearest"):
        gs.load_model(file)


def test_joints_of_a_tree_move_what_is_beyond_them():
    """Poses are products of exponentials about the axes of the description."""
    rng = np.random.default_rng(3)
    build = gs.Multibody("tree")
    kinds = {"r": ("revolute", {"angle": 0.7, "rate": 1.0}), "p": ("prismatic", {"travel": 0.3}),
             "c": ("cylindrical", {"travel": -0.2, "angle": 4.0, "speed": 0.5}),
             "s": ("screw", {"travel": 0.1, "lead": 0.4}), "b": ("ball", {}),
             "i": ("revolute", {"angle": 0.6, "rate": -0.4}), "h": ("chain", {"angle": 0.9})}
    rotation, shift, parent, expected = Rotation.identity(), np.zeros(3), "ground", {}
    for name, (kind, options) in kinds.items():
        x, pivot, axis = rng.normal(size=(3, 3))
        axis /= np.linalg.norm(axis)
        drawn = Rotation.random(random_state=int(100 * abs(x[0])))
        build.body(name, **BODY, position=x, rotation=drawn)
        travel, slide = options.get("travel", 0.0), np.zeros(3)
        if kind == "chain":  # a hinge, then a slide along another axis
            slide = np.array([0.1, -0.2, 0.3])
            build.chain("jh", parent, name, [
                {"name": "turn", "axis": axis, "inertia": 0.1, "at": pivot, "rate": 0.5, **options},
                {"name": "slide", "axis": slide, "inertia": 0.2, "speed": 0.3,
                 "travel": np.linalg.norm(slide)}])
        else:
            frames = (name, parent) if name == "i" else (parent, name)  # outward, or inward
            axis_option = {} if kind == "ball" else {"axis_in_space": axis}
            getattr(build, kind)(f"j{name}", *frames, at=pivot, **axis_option, **options)
        angle = options.get(
            "angle", 2 * math.pi * travel / options["lead"] if kind == "screw" else 0.0)
        turn = Rotation.from_rotvec((-angle if name == "i" else angle) * axis)
        # r -> R (turn (r + slide - pivot) + pivot + travel axis) + shift
        shift = rotation.apply(pivot + travel * axis + turn.apply(slide - pivot)) + shift
        rotation = rotation * turn
        expected[name], parent = (rotation * drawn, rotation.apply(x) + shift), name
    model = build.model()
    assert build.start.q_moved <= ROUNDING  # joints hold where the tree takes them
    for name, (attitude, x) in expected.items():
        turned, position = pose_of(model, name)
        assert (turned * attitude.inv()).magnitude() <= ROUNDING
        np.testing.assert_allclose(position, x, atol=ROUNDING)
    assert build.start.p_moved <= ROUNDING  # and so do rates along it


def test_the_other_angles_of_a_loop_follow():
    """The pin between coupler and rocker is the meet of two circles."""
    model = four_bar(h0={"angle": 0.5, "rate": 2.0}).model(redundant="leave out")
    turn, _ = pose_of(model, "crank")
    assert turn.as_rotvec()[2] == pytest.approx(0.5, abs=ROUNDING)
    pins = Rotation.from_rotvec([0, 0, 0.5]).apply([0, 0.4, 0]), np.array([1.0, 0, 0])
    radii = np.linalg.norm([0.9, 0.4]), np.linalg.norm([0.1, 0.8])
    d = pins[1] - pins[0]
    size = np.linalg.norm(d)
    along = (radii[0] ** 2 - radii[1] ** 2 + size**2) / (2 * size)
    across = math.sqrt(radii[0] ** 2 - along**2)  # on the side of the description
    pin = pins[0] + along * d / size + across * np.array([-d[1], d[0], 0]) / size
    turn, position = pose_of(model, "rocker")
    np.testing.assert_allclose(position, (pin + pins[1]) / 2, atol=ROUNDING)
    _, omega = motion_of(model, "crank", BODY["inertia"])
    assert omega[2] == pytest.approx(2.0, rel=ROUNDING)


@pytest.mark.slow  # two searches
def test_two_angles_of_a_loop_that_agree_are_taken():
    model = four_bar(h0={"angle": 0.5, "rate": 2.0}).model(redundant="leave out")
    turn, _ = pose_of(model, "rocker")
    both = four_bar(h0={"angle": 0.5}, h3={"angle": -turn.as_rotvec()[2]}).model(
        redundant="leave out")
    np.testing.assert_allclose(both.q0, model.q0, atol=ROUNDING)


def test_an_angle_and_a_travel_of_a_slider_crank_are_moved_by_their_last_digits_alone():
    """The nearest start has the least sin²(θ − θ₀) + (s − s₀)² on s = cos θ + √(4 − sin² θ) − 3."""
    def start(travel):
        build = gs.Multibody("crank", gravity=(0, 0, 0))
        for name, x in (("crank", 0.5), ("slider", 3.0)):
            build.body(name, **BODY, position=(x, 0, 0))
        build.revolute("hinge", "ground", "crank", axis=(0, 0, 1), at=(0, 0, 0), angle=0.5)
        build.prismatic("slide", "ground", "slider", axis=(1, 0, 0), at=(3, 0, 0), travel=travel)
        build.rod("rod", "crank", "slider", on_a=(0.5, 0, 0), on_b=(0, 0, 0))
        q = build.model().q0
        return 2 * math.atan2(q[3], q[0]), q[11] - 3

    def travel_of(angle):
        return math.cos(angle) + math.sqrt(4 - math.sin(angle) ** 2) - 3

    exact = travel_of(0.5)
    for travel in (exact, None):  # without a warning
        assert start(travel) == pytest.approx((0.5, exact), abs=ROUNDING)
    with pytest.warns(InputWarning, match=f"'hinge'.*'slide'.*{exact:.7f}"):
        angle, travel = start(round(exact, 7))
    assert travel == pytest.approx(travel_of(angle), abs=ROUNDING)
    h = 1e-4
    slope = (travel_of(angle + h) - travel_of(angle - h)) / (2 * h)
    assert math.sin(angle - 0.5) + (travel - round(exact, 7)) * slope == pytest.approx(0, abs=1e-15)
    far = exact + 0.05
    nearest = minimize_scalar(lambda x: math.sin(x - 0.5) ** 2 + (travel_of(x) - far) ** 2,
                              bounds=(0.3, 0.6), options={"xatol": 1e-12}).x
    with pytest.raises(InputError, match=f"'hinge' {str(nearest)[:7]}.*0.5.*'slide'.*{far:.9g}"):
        start(far)


def test_a_rate_is_kept_where_a_quaternion_is_off_by_round_off():
    """Rates of gears stay, though the row of the wheel's |q| = 1 is 0 but for its round-off."""
    build = rod(rate=1.5)
    build.body("wheel", **BODY, position=(1, 0, 0.2), quaternion=(1, 0, 1e-18, 0))
    build.revolute("axle", "ground", "wheel", axis=(0, -1, 0), at=(1, 0, 0))
    build.gear("mesh", "h", "axle", teeth=(2, 3))
    build.flywheel("disc", "axle", inertia=0.03)
    _, omega = motion_of(build.model(), "wheel", BODY["inertia"])
    np.testing.assert_allclose(omega, (0, 1, 0), atol=ROUNDING)


@pytest.mark.parametrize(("hinges", "message"), [
    pytest.param({"h0": {"angle": 0.5}, "h1": {"angle": 0.0}}, "'h0'.*0.5.*'h1'",
                 marks=pytest.mark.slow),  # a search for two seconds
    ({"h0": {"rate": 3.0}, "h3": {"rate": 1.0}}, "'h.'.*nearest"),
])
def test_contradicting_joints_are_refused(hinges, message):
    with pytest.raises(InputError, match=message):
        four_bar(**hinges).model(redundant="leave out")


def test_a_speed_that_no_motion_changes_is_refused_unless_it_is_that_speed():
    """A top's fixed point lies on the axis of a slider: it turns about the axis, and never slides.
    """
    def start(**speed):
        build = gs.Multibody("top")
        build.top("t", mass=1.0, inertia=(1, 1, 1), centre=(0, 0, 1), angular_velocity=(0, 0, 2))
        build.cylindrical("c", "t", "ground", axis=(0, 0, 1), at=(0, 0, 1), **speed)
        return build.model(redundant="leave out").start

    with pytest.raises(InputError, match=r"'c'.* 0\.5\b.* 0\b"):
        start(speed=0.5)
    assert np.array_equal(start(speed=0.0).p, start().p)


def test_degrees_and_positions_that_are_moved_are_warned_of():
    with pytest.warns(InputWarning, match=r"45.*radians.*0\.785398"):
        rod(angle=45)
    build = gs.Multibody("off")
    build.body("a", **BODY, position=(0.5, 0, 0))
    build.revolute("h", "ground", "a", axis=(0, 0, 1), at=(0, 0, 0), on_b=(-0.4999, 0, 0))
    with pytest.warns(InputWarning, match=r"position of 'a'.*\[0.5, 0, 0\].*\[0\.49"):
        build.model()


def test_a_velocity_is_kept_where_the_joints_allow_it():
    """An angular velocity that is not given follows; a contradicting one is refused."""
    velocity, omega = motion_of(rod({"velocity": (0, 0, 1)}).model(), "rod", (0.1, 0.1, 0.1))
    np.testing.assert_allclose(velocity, [0, 0, 1], atol=ROUNDING)
    np.testing.assert_allclose(omega, [0, -2, 0], atol=ROUNDING)
    for body, hinge, message in (
            ({"velocity": (0, 1, 1)}, {}, r"'rod'.*\[0, 1, 1\].*nearest.* 1\]"),
            ({"velocity": (0, 0, 1)}, {"rate": 3.0}, "nearest"),
            ({"angular_velocity": (0, -2, 0)}, {"rate": 3.0}, "nearest")):
        with pytest.raises(InputError, match=message):
            rod(body, **hinge).model()
    with pytest.warns(InputWarning, match="taken"):  # typed with four digits
        rod({"velocity": (0, 0.0001, 1)}).model()


def test_a_sphere_on_a_turntable_keeps_its_velocity():
    build = gs.Multibody("table")
    build.body("ball", mass=1.0, inertia=[0.4 * 0.1**2] * 3, position=(0.5, 0, 0.1),
               velocity=(0.2, 0.3, 0))
    build.rolls("table", "ball", sphere=0.1, turning=2.0)
    velocity, omega = motion_of(build.model(), "ball", [0.4 * 0.1**2] * 3)
    np.testing.assert_allclose(velocity, [0.2, 0.3, 0], atol=ROUNDING)
    # v + ω × (−r n) is the plane's velocity Ω n × x at the contact; ω along n stays as small
    np.testing.assert_allclose(omega, [(2.0 * 0.5 - 0.3) / 0.1, 0.2 / 0.1, 0], atol=ROUNDING * 10)


@pytest.mark.parametrize(("mass", "inertia", "radius"), [
    (1.0, 1000.0, "31.6 m"), (1000.0, 1e-5, "0.0001 m"), (1.0, 0.02, "")])
def test_slips_of_units_are_warned_of(mass, inertia, radius):
    """A radius of gyration out of proportion to joints at 0.5 m is warned of as a slip of units."""
    build = gs.Multibody("slip")
    build.body("a", mass=mass, inertia=[inertia] * 3, position=(0.5, 0, 0))
    build.revolute("h", "ground", "a", axis=(0, 0, 1), at=(0, 0, 0))
    if not radius:
        build.model()
        return
    with pytest.warns(InputWarning, match=f"'a'.*gyration {radius}.*0.5 m.*units"):
        build.model()


def test_small_bodies_without_joints_are_no_slips_of_units():
    build = gs.Multibody("dust")
    build.body("a", mass=1e-6, inertia=[1e-18] * 3, position=(0.5, 0, 0))
    build.body("b", **BODY)
    build.model()


def test_another_satellite_starts_with_momenta_of_its_own_inertia():
    moments, omega = (100.0, 120.0, 30.0), (0.0, 0.0011, 2e-4)
    model = gs.models.satellite(inertia=moments)
    p = gs.Start.of_body(model.q0, omega, moments).p
    assert np.abs(model.p0 - p).max() <= 4 * np.finfo(float).eps * np.abs(p).max()


def test_what_hangs_on_a_top_turns_about_its_fixed_point():
    build = gs.Multibody("held")
    top = build.top("top", mass=1, inertia=(1, 2, 2.5), centre=(0.5, 0, 0), at=(1.0, 2.0, 0.5))
    rod = build.body("rod", **BODY, position=(2.5, 2.0, 0.5))
    build.revolute("hinge", "ground", top, axis=(0, 0, 1), at=(1.0, 2.0, 0.5), angle=0.7)
    build.ball("pin", top, rod, at=(2.0, 2.0, 0.5))
    q = build.model(redundant="leave out").q0
    assert q[8:] == pytest.approx([1 + 1.5 * np.cos(0.7), 2 + 1.5 * np.sin(0.7), 0.5], abs=ROUNDING)
