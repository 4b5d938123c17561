"""One body or joint of a trajectory against finite differences, Newton-Euler and closed forms."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sympy as sp

import budget
import gyrospark as gs
import systems
from calls import RUN, TOP
from gyrospark.core.errors import InputWarning
from gyrospark.core.json_records import UnfitError
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.runtime.compilation.body_columns import bodies_of, body_named, joint_named, joints_of
from gyrospark.runtime.compilation.manifest import parse_manifest, read_manifest
from gyrospark.runtime.results.joint_motion import shortest_rotation
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix
from stores import record

EPS = float(np.finfo(float).eps)
DT = 1e-3


def run(model, steps=300, name=None, scheme=("G-L", 2), **options):
    step = systems.stepper(name, *scheme) if name else gs.stepper(*scheme, system=model.system)
    return step.integrate(model.q0, model.p0, steps=steps, parameters=dict(model.parameters),
                          **{"dt": DT} | options)


@pytest.fixture(scope="module")
def four_bar():
    return run(gs.models.four_bar(), name="four_bar")


@pytest.fixture(scope="module")
def tops():
    return run(gs.models.double_top(), name="double_top", dt=1e-4)


def slope(values, dt):
    """Return central differences, right to dt² of the third derivative over 6."""
    return (values[2:] - values[:-2]) / (2 * dt)


# ---------------------------------------------------------------- bodies


def test_the_fast_top_is_asked_without_a_name(gl3):
    motion = gl3.integrate(TOP.q0, TOP.p0, steps=50, **RUN)
    body = motion.body()
    assert body.name == "body"
    assert np.array_equal(body.attitude, motion.q)
    assert np.array_equal(body.angular_velocity(), motion.angular_velocity())
    assert np.array_equal(body.inertia, np.diag(TOP.inertia))
    assert np.abs(body.rotation().as_matrix() - body.rotation_matrix()).max() < 8 * EPS
    assert np.abs(body.euler("zyx", degrees=True)
                  - body.rotation().as_euler("zyx", degrees=True)).max() < 180 * 64 * EPS
    assert np.abs(body.position((0, 0, 0.1)) - 0.1 * motion.axis()).max() < 4 * EPS
    mgl = TOP.parameters["mgl"]
    potential = mgl * motion.axis()[:, 2]
    assert np.abs(body.kinetic_energy() + potential - motion.energy()).max() < 7 * 16 * EPS
    with pytest.raises(gs.InputError, match=r"'heavy_top'.*mass.*'body'"):
        body.momentum()
    with pytest.raises(gs.InputError, match="centre"):
        body.position()


def test_angular_velocity_is_that_of_the_attitude(tops):
    """Differences of the attitude, RᵀṘ, have the angular velocity, in both frames."""
    for name, fast in (("a", 40), ("b", 70)):
        body = tops.body(name)
        R = body.rotation_matrix()
        turning = np.einsum("kji,kjl->kil", R[1:-1], slope(R, 1e-4))
        omega = np.stack([turning[:, 2, 1], turning[:, 0, 2], turning[:, 1, 0]], axis=1)
        bound = fast * (fast * 1e-4) ** 2
        assert np.abs(omega - body.angular_velocity()[1:-1]).max() < bound
        space = np.einsum("kij,kj->ki", R, body.angular_velocity("body"))
        assert np.abs(body.angular_velocity(frame="space") - space).max() < fast * 8 * EPS


def test_positions_velocities_and_momenta(tops):
    upper, parameters = tops.body("b"), tops.parameters
    assert np.array_equal(upper.position(), tops.q[:, 8:11])
    assert np.array_equal(upper.momentum(), 0.4 * (tops.p[:, 8:11] / 0.4))
    lower = tops.body("a")
    assert np.abs(lower.position() - 0.25 * lower.axis()).max() < 2 * EPS
    assert lower.mass == parameters["a_m"] == 1.0
    for body, point in ((lower, None), (upper, None), (upper, (0.1, 0.2, -0.3))):
        error = slope(body.position(point), 1e-4) - body.velocity(point)[1:-1]
        assert np.abs(error).max() < 70 * 0.4 * (70e-4) ** 2
    weight = sum(9.81 * body.mass * body.position()[:, 2] for body in (lower, upper))
    energy = lower.kinetic_energy() + upper.kinetic_energy() + weight
    assert np.abs(energy - tops.energy()).max() < 64 * EPS * np.abs(energy).max()


def test_momenta_change_by_forces_and_torques(tops):
    """The upper top, which is free, has ṗ = F and l̇ = M of the joint's point and gravity."""
    upper, joint = tops.body("b"), tops.joint()
    weight = np.array([0, 0, -9.81 * upper.mass])
    force, arm = joint.force(), joint.position() - upper.position()
    size = np.abs(force).max()
    assert np.abs(slope(upper.momentum(), 1e-4) - (force + weight)[1:-1]).max() < 3e-3 * size
    torque = np.cross(arm, force)
    error = slope(upper.angular_momentum(), 1e-4) - torque[1:-1]
    assert np.abs(error).max() < 3e-3 * np.abs(torque).max()
    assert np.abs(joint.torque()).max() == 0  # a ball
    assert np.abs(np.linalg.norm(upper.angular_momentum("body"), axis=1)
                  - np.linalg.norm(upper.angular_momentum(), axis=1)).max() < 1e-13


@pytest.fixture(scope="module")
def tied():
    return systems.run("tied", systems.stepper("tied", "IMS"), 20, dt=DT)


def test_what_nothing_uses_is_still_known(tied):
    """Without gravity no formula has the mass and the arm of a top; the views have both."""
    assert "a_m" not in tied.parameters
    body = tied.body("a")
    assert body.mass == 2.5
    assert np.abs(body.position()[0] - [1.1, 2, 3.3]).max() < 8 * EPS
    assert np.abs(body.velocity()[0] - [0, 0.1, 0]).max() < 8 * EPS


def test_a_rod_pulls_along_itself(tied):
    """The force of the rod on each ball is m r Ω²."""
    force, along = tied.joint("rod").force(), tied.body("b").position()
    assert np.abs(force - 0.5 * 9 * along).max() < 1e-4
    with pytest.raises(gs.InputError, match=r"'rod'.*axis"):
        tied.joint("rod").angle()
    for one_state in (tied[-1:], tied[:1]):
        with pytest.raises(gs.InputError, match=r"'rod'.*state"):
            one_state.joint("rod").force()


def test_total_momenta_of_segments_that_attract_one_another():
    """Σ m ẋ and Σ (l + x × m ẋ) are sums over the bodies, and the same in each state."""
    motion = systems.run("beam", systems.stepper("beam", "IMS"), 40, dt=1e-2)
    bodies = [motion.body(name) for name in motion.bodies]
    p = sum(body.mass * body.velocity() for body in bodies)
    turning = sum(body.angular_momentum() + np.cross(body.position(), body.mass * body.velocity())
                  for body in bodies)
    for total, expected in ((motion.total_momentum(), p),
                            (motion.total_angular_momentum(), turning)):
        assert np.abs(total - expected).max() < 32 * EPS * np.abs(expected).max()
        assert np.abs(total - total[0]).max() < 40 * 8 * EPS * np.abs(total).max()


def test_total_momenta_are_of_free_bodies(tied):
    """A top held at a point has no momentum of its own: the sum is refused."""
    with pytest.raises(gs.InputError, match="'tied'"):
        tied.total_momentum()


# ---------------------------------------------------------------- joints


def pendulum(rate=0.5):
    """Return a bar of 2 kg that swings about x, held half a metre above its centre."""
    build = gs.Multibody("swing_hinge")
    c, s = np.cos(1.0), np.sin(1.0)
    bar = build.body("bar", mass=2.0, inertia=(0.3, 0.3, 0.1), angular_velocity=(rate, 0, 0),
                     rotation=[[1, 0, 0], [0, c, -s], [0, s, c]])
    build.revolute("pin", build.ground, bar, axis=(2, 0, 0), at=(0, 0, 0), on_b=(0, 0, 0.5))
    return build.model()


def pull(motion):
    """Return the pin's force on the bar in closed form, from angle and rate: m ẍ − m g."""
    body = motion.body("bar")
    arm, rate = -0.5 * body.axis(), body.angular_velocity()[:, :1]
    weight = np.array([0, 0, -2 * 9.81])
    spin = np.cross(arm, weight) / (0.3 + 2 * 0.25)
    return 2 * (np.cross(spin, arm) - rate**2 * arm) - weight


@pytest.mark.parametrize(("scheme", "inside", "ends"), [
    (("G-L", 2), 2, 2), *(pytest.param(*row, marks=pytest.mark.slow)  # each derives a model
                          for row in ((("G-L", 3), 4, 3), (("IMS",), 2, 2)))])
def test_the_reaction_of_a_pendulum_in_closed_form(scheme, inside, ends):
    """The error has the stated orders, inside the run and at its ends."""
    model, errors = pendulum(), []
    for dt in (0.02, 0.01):
        motion = run(model, round(0.6 / dt), scheme=scheme, dt=dt)
        error = np.abs(motion.joint("pin").force() - pull(motion)).max(axis=1)
        errors.append((error[1:-1].max(), max(error[0], error[-1])))
    (wide, wide_ends), (fine, fine_ends) = errors
    assert np.log2(wide / fine) > inside - 0.3
    assert np.log2(wide_ends / fine_ends) > ends - 0.3
    assert wide < 0.1


def test_a_hinge_holds_more_and_turns():
    motion = run(pendulum(), 600)
    joint, body = motion.joint(), motion.body()
    assert joint.bodies == ("", "bar")
    force = pull(motion)
    assert np.abs(joint.force() - force).max() < 1e-5 * np.abs(force).max()
    assert np.abs(joint.force("bar") - np.einsum(
        "kji,kj->ki", body.rotation_matrix(), joint.force())).max() < 64 * EPS * 20
    assert np.abs(joint.torque()).max() < 1e-9  # a bar in a plane does not lean on its hinge
    assert np.abs(joint.angle() - body.euler("xyz")[:, 0]).max() < 1e-12
    assert np.abs(joint.angle(degrees=True)[0] - np.degrees(1.0)) < 1e-12
    assert np.abs(joint.rate() - body.angular_velocity()[:, 0]).max() < 1e-12
    assert np.abs(joint.position()).max() < 1e-13


#: Each joint that slides or turns along an axis: its kind, and its arguments.
ROW = {"pivot": ("revolute", {"axis": (0, 0, 1), "at": (0, 0, 0), "rate": 0.5}),
       "plane": ("planar", {"axis": (1, 0, 2), "at": (0, 0.1, 0.3), "rate": 0.3}),
       "slide": ("prismatic", {"axis": (1, 2, 2), "at": (0.5, 0.1, 0.3), "speed": 0.7}),
       "pole": ("cylindrical", {"axis": (2, 0, 1), "at": (1, 0, 0.5), "speed": -0.4, "rate": 0.8}),
       "thread": ("screw", {"axis": (0, 1, 1), "at": (1.4, 0.1, 0.5), "lead": 0.2, "rate": 1.5})}


@cache
def sliding_model(in_a_row):
    """Return the model of a body on each joint, or of a slide on a pivot, which hang on a moving
    point, and of a nut on a thread of the ground."""
    build, before = gs.Multibody("sliding", gravity=(0, -9.81, 0)), "hand"
    build.moving_point("hand", (sp.sin(3 * build.time) / 4, build.time**2, 0))
    for i, name in enumerate(ROW if in_a_row else ("pivot", "slide", "thread")):
        kind, options = ROW[name]
        body = build.body(f"on_{name}", mass=2.0, inertia=(0.3, 0.2, 0.25),
                          position=(0.4 * i, 0.1, 0.6))
        getattr(build, kind)(name, before, body, **options)
        before = body if in_a_row or name == "pivot" else "ground"
    build.quantity("s_speed", build.speed("slide"))
    build.quantity("nut_rate", build.rate("thread"))
    return build.model()


@cache
def sliding(in_a_row):
    """Return the run of the model."""
    with budget.shared():
        return run(sliding_model(in_a_row), 150)


@pytest.mark.parametrize("case", ["linkage", "apart", pytest.param(
    "row", marks=pytest.mark.slow)])  # seventeen seconds of deriving
def test_reactions_obey_newton_and_euler(case, four_bar):
    """m ẍ and l̇ of each body are the reactions of its joints and gravity, with the stated sign."""
    trajectory = four_bar if case == "linkage" else sliding(case == "row")
    assert trajectory.joints == {"linkage": ("hinge0", "hinge1", "hinge2", "hinge3"),
                                 "apart": ("pivot", "slide", "thread"), "row": (*ROW,)}[case]
    for name in trajectory.bodies:
        body = trajectory.body(name)
        force, torque = np.array([0, -9.81 * body.mass, 0]), np.zeros(3)
        for joint in map(trajectory.joint, trajectory.joints):
            sign = (joint.bodies[1] == name) - (joint.bodies[0] == name)
            force = force + sign * joint.force()
            arm = joint.position() - body.position()
            torque = torque + sign * (joint.torque() + np.cross(arm, joint.force()))
        error = slope(body.momentum(), DT) - force[1:-1]
        assert np.abs(error).max() < 1e-3 * np.abs(force).max()
        error = slope(body.angular_momentum(), DT) - torque[1:-1]
        assert np.abs(error).max() < 1e-3 * np.abs(torque).max()


def test_a_hinge_at_a_point_that_moves():
    motion = sliding(in_a_row=False)
    pivot = motion.joint("pivot")
    assert np.abs(slope(pivot.angle(), DT) - pivot.rate()[1:-1]).max() < 1e-4
    point = np.stack([np.sin(3 * motion.t) / 4, motion.t**2, 0 * motion.t], axis=1)
    assert np.abs(pivot.position() - point).max() < 64 * EPS


@pytest.mark.parametrize("in_a_row", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_joints_that_slide_are_known(in_a_row):
    """Pictures know which joints slide; an older store has no force of a slide."""
    joints = joints_of(sliding(in_a_row).manifest)
    assert [name for name, joint in joints.items() if joint.slides] == [
        name for name in joints if name != "pivot"]
    assert replace(joints["slide"], pulls=None).slides


def test_accelerations_of_slides_are_those_of_their_speeds():
    """The rows of joints by geometry agree with derivatives of quantities by each momentum."""
    run, model = sliding(in_a_row=False), sliding_model(in_a_row=False)
    with budget.shared():
        step = gs.stepper("G-L", 2, system=model.system)
        motion = step.accelerations(run[100])
    for joint, quantity in (("slide", "s_speed"), ("thread", "nut_rate")):
        assert motion.joint(joint) == pytest.approx(motion.quantities[quantity], rel=1e-12)
    M, M_of_quantities = (step.mass_matrix(run[100], joints=joints)
                          for joints in (["slide", "thread"], ["s", "nut"]))
    assert np.abs(M - M_of_quantities).max() < 1e-12 * np.abs(M).max()
    slope_of_speed = np.diff(run.quantity("s_speed")[99:102:2]) / (2 * DT)
    assert motion.joint("slide") == pytest.approx(slope_of_speed[0], abs=1e-3)


def test_angles_count_whole_turns(four_bar):
    """A wheel of a gimbal at 150 rad/s has a state every 2 steps; bars have angles in the plane."""
    motion = run(gs.models.gimbal(), 400, "gimbal", ("IMS", None), every=2)
    outer, inner = (motion.body(name).angular_velocity("space") for name in ("outer", "inner"))
    assert np.abs(inner[0] - outer[0] - [-0.3, 0, 0]).max() < 1e-12  # the rings' axis is x
    spindle = motion.joint("spindle")
    assert spindle.angle()[-1] == pytest.approx(150 * 0.4, rel=0.05)
    turned_by_rate = np.cumsum(np.diff(motion.t) * (spindle.rate()[1:] + spindle.rate()[:-1]) / 2)
    assert np.abs(np.diff(spindle.angle()).cumsum() - turned_by_rate).max() < 0.1
    with pytest.raises(gs.InputError, match=r"'spindle'.*point"):
        spindle.position()
    coupler, crank = (four_bar.body(name).euler("xyz")[:, 2] for name in ("coupler", "crank"))
    for name, turn in (("hinge0", crank), ("hinge1", coupler - crank)):  # of the ground, of a bar
        angle = four_bar.joint(name).angle()
        assert np.abs(np.sin(angle - turn)).max() < 1e-12
        assert np.abs(slope(angle, DT) - four_bar.joint(name).rate()[1:-1]).max() < 1e-3


def test_turns_that_rates_do_not_tell_are_warned_of():
    """A bar falls over and over, at 5 to 14 rad/s: angles warn of states more than 0.1 s apart."""
    model = pendulum(12.0)
    step = gs.stepper("G-L", 2, system=model.system)

    def run(every=1):
        return step.integrate(model.q0, model.p0, dt=5e-3, steps=1000, every=every,
                              parameters=dict(model.parameters))

    turned = run().joint().angle()
    assert abs(turned[-1] - turned[0]) > 20
    thinned = run(20).joint()
    assert np.abs(thinned.angle() - turned[::20]).max() < 1e-12  # no warning: it would be an error
    for every in (100, 1000):
        ends = run(every)
        with pytest.warns(InputWarning, match="every"):
            angle = ends.joint().angle()
        assert np.abs(np.sin((angle - turned[::every]) / 2)).max() < 1e-9
    cured = ends.at(np.linspace(0, 5, 101)).joint().angle()  # as the warning says
    assert np.abs(cured - turned[::10]).max() < 1e-9


def test_where_states_are_left_out_the_start_has_no_reaction(four_bar):
    thin = run(gs.models.four_bar(), name="four_bar", every=10)
    force, full = thin.joint("hinge1").force(), four_bar.joint("hinge1").force()[::10]
    assert np.isnan(force[0]).all()
    assert np.abs(force[1:] - full[1:]).max() < 1e-5 * np.abs(full).max()


def test_reactions_between_steps():
    """States a step apart, as many as the run has, but not its own, have a step each."""
    stored = run(pendulum(), 60, dt=0.01)
    times = np.append(0.0, stored.t[:-1] + 0.004)
    between = stored.at(times[1:])
    error = np.abs(between.joint("pin").force() - pull(between))[1:]
    assert error.max() < 1e-4 * 31
    as_many = stored.at(np.concatenate([times, [0.6]])[:61])
    assert np.isnan(as_many.joint("pin").force()[0]).all()
    assert np.array_equal(stored.at(stored.t).joint("pin").force(), stored.joint("pin").force())


def test_the_shortest_way_between_axes():
    for a, b in np.random.default_rng(3).normal(size=(20, 2, 3)):
        a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
        normal = np.cross(a, b) / np.linalg.norm(np.cross(a, b))
        for end in (b, -a, a):
            R = shortest_rotation(a, end, normal)
            assert np.abs(R @ R.T - np.eye(3)).max() < 1e-13
            assert np.abs(R @ a - end).max() < 1e-13
        assert np.abs(shortest_rotation(a, b, normal) @ normal - normal).max() < 1e-13


def test_names_that_are_not_there(four_bar, tops, gl3):
    with pytest.raises(gs.InputError, match=r"4 joints.*joint\('hinge0'\)"):
        four_bar.joint()
    with pytest.raises(gs.InputError, match=r"Unknown joint .*'hing1'"):
        four_bar.joint("hing1")
    with pytest.raises(gs.InputError, match=r"Unknown body .*'bus'"):
        four_bar.body("bus")
    with pytest.raises(gs.InputError, match="joints"):
        gl3.integrate(TOP.q0, TOP.p0, steps=1, **RUN).joint()
    build = gs.Multibody("hand")
    build.rod("string", build.moving_point("grip", (0, 0, sp.sin(build.time))),
              build.point_mass("bob", mass=0.5, position=(0, 0, -1)))
    source = generate(Spec.from_arguments("G-L", 2), system=build.model().system).source
    manifest = read_manifest(source.name, source.files())
    with pytest.raises(gs.InputError, match=r"'bob'.*point.*bob_x, bob_y, bob_z.*q\[:, 0:3\]"):
        body_named(manifest, "bob")
    with pytest.raises(gs.InputError, match="string: length"):
        joint_named(manifest, "string")
    with pytest.raises(gs.InputError, match=r"'ground'.*body or space"):
        tops.body("a").angular_velocity(frame="ground")
    with pytest.raises(gs.InputError, match=r"[Ff]rame.*'joint'"):
        tops.joint().force("ground")
    with pytest.raises(gs.InputError, match=r"on_body = .*point"):
        tops.body("a").position((0, 1))
    with pytest.raises(gs.InputError, match="degrees = 3"):
        tops.body("a").euler("zyx", degrees=3)
    x, y = sp.symbols("x y")
    with pytest.raises(gs.InputError, match=r"joints = .*Multibody"):
        gs.System([x], [y], [], y**2, joints=[3])


# ---------------------------------------------------------------- views of a trajectory


def test_the_satellite_in_its_orbit():
    """Ω is against axes at rest: RᵀṘ against axes of the orbit lacks their rate n about y."""
    model = gs.models.satellite()
    motion = run(model, 60, "satellite", dt=model.dt)
    R, omega = motion.rotation().as_matrix(), motion.angular_velocity()
    turning = np.diff(R, axis=0) / motion.dt
    middle = (R[1:] + R[:-1]) / 2
    relative = np.einsum("tji,tjk->tik", middle, turning)  # RᵀṘ = skew(Ω relative)
    relative = np.stack([relative[:, 2, 1], relative[:, 0, 2], relative[:, 1, 0]], axis=1)
    n = model.parameters["n"]
    absolute = relative + n * middle[:, 1, :]
    assert np.abs(absolute - (omega[1:] + omega[:-1]) / 2).max() < 1e-5 * np.abs(omega).max()
    assert np.abs(relative - (omega[1:] + omega[:-1]) / 2).max() > 0.1 * n


def test_several_bodies_are_asked_for_by_name(tops):
    motion = tops
    assert motion.bodies == ("a", "b")
    for view in ("rotation", "axis", "angular_velocity"):
        with pytest.raises(gs.InputError, match=r"'double_top'.*2, a, b.*body\('a'\)"):
            getattr(motion, view)()
        with pytest.raises(gs.InputError, match=r"'c'.*a or b"):
            getattr(motion, view)("c")
    assert np.abs(motion.angular_velocity("a")[0] - [0.2, 0, 40]).max() < 40 * 8 * EPS
    assert np.abs(motion.angular_velocity("b")[0] - [0, 0.3, 70]).max() < 70 * 8 * EPS
    assert np.abs(motion.rotation(body="b").as_matrix()
                  - rotation_matrix(motion.q[:, 4:8])).max() < 8 * EPS
    assert np.array_equal(motion.axis("b"), rotation_matrix(motion.q[:, 4:8])[..., 2])


def test_views_go_with_a_trajectory_into_its_file(tops, tmp_path):
    motion = tops
    again = gs.load(motion.save(tmp_path / "two.npz"))
    assert again.bodies == motion.bodies
    assert np.array_equal(again.angular_velocity("b"), motion.angular_velocity("b"))
    case, step = systems.case("satellite"), systems.stepper("satellite")
    stored = record(step, *systems.start("satellite", step), dt=case.dt, steps=4,
                       parameters=case.parameters, out=tmp_path / "satellite.zarr")
    assert stored[:].axis().shape == (5, 3)


@pytest.mark.parametrize("spoil", [
    lambda body: body.update(q=["a_q0", "a_q1", "a_q2"]),
    lambda body: body.update(q=["a_q0", "a_q1", "a_q2", "z"]),
    lambda body: body.update(inertia=["a_I1", "a_I2"]),
    lambda body: body.update(inertia=["a_I1", "a_I2", "none"]),
    lambda body: body.update(inertia=[["a_I1"], "a_I2", "a_I3"]),
    lambda body: body.pop("inertia"), lambda body: body.update(q=3),
    lambda body: body.update(x=["b_x", "b_y"]), lambda body: body.update(mass="none"),
    lambda body: body.update(mass=True), lambda body: body.update(centre=[0.0, 1.0]),
    lambda body: body.update(centre="a_m"), lambda body: body.update(origin=[0.0, 0.0, np.inf]),
], ids=range(13))
def test_a_manifest_with_another_body_is_damaged(spoil, tops):
    content = tops.manifest.as_json()
    assert list(bodies_of(parse_manifest(content))) == ["a", "b"]
    spoil(content["system"]["bodies"]["a"])
    with pytest.raises(UnfitError, match=r"system\.bodies\.a"):
        parse_manifest(content)


@pytest.mark.parametrize("spoil", [
    lambda joint: joint.update(bodies=["a", "c"]), lambda joint: joint.update(bodies=["a"]),
    lambda joint: joint.update(on_a=[0.0]), lambda joint: joint.update(axis_b=["none", 0.0, 0.0]),
    lambda joint: joint.pop("constraints"), lambda joint: joint["constraints"].update(other=None),
    lambda joint: joint["constraints"]["joint: x"].update(kind="magic"),
    lambda joint: joint["constraints"]["joint: x"].update(on_a=[]),
], ids=range(8))
def test_a_manifest_with_another_joint_is_damaged(spoil, tops):
    content = tops.manifest.as_json()
    assert list(joints_of(parse_manifest(content))) == ["joint"]
    spoil(content["system"]["joints"]["joint"])
    with pytest.raises(UnfitError, match=r"system\.joints\.joint"):
        parse_manifest(content)


def test_what_is_called_a_rigid_body_is_one():
    x, y = sp.symbols("x y", real=True)
    with pytest.raises(gs.InputError, match=r"'a'.*1 coordinates"):
        gs.System([x], [y], [], y**2, name="a", rigid_body=True)
    q, p = sp.symbols("q0:4", real=True), sp.symbols("p0:4", real=True)
    with pytest.raises(gs.InputError, match="moments I1, I2, I3"):
        gs.System(q, p, [x], x * sum(e**2 for e in p), name="a", rigid_body=True)
