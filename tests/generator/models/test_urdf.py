"""URDF: its models against Pinocchio and bodies put together by hand; bad files."""

import math
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import gyrospark as gs
from command_line import refused
from gyrospark.api import Derivation
from gyrospark.generator.models.robot_builder import plain_name
from gyrospark.generator.models.robots import read_settings
from gyrospark.generator.symbolic.numeric_evaluation import evaluate
from robots import ARM, BAR, Motion

START = {"angles": {"shoulder": 0.4, "slide-1": -0.15, "wheel": 2.0},
         "rates": {"shoulder": -1.1, "slide-1": 0.7, "wheel": 9.0}}
EPS = np.finfo(float).eps


HINGE = """<robot name="hinge"><link name="base"/>
  <link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
  <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.2"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/>
  <axis xyz="0 1 0"/></joint></robot>
"""
LIMITED = HINGE.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><limit lower="-1" upper="1" '
                        'effort="9" velocity="9"/>')


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(ARM, encoding="utf-8")
    return path


def changed(tmp_path, *pairs):
    text = ARM
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new)
    path = tmp_path / "changed.urdf"
    path.write_text(text, encoding="utf-8")
    return path


def test_an_arm_has_its_masses_weight_and_damper(arm):
    """A link fixed to another makes one body with it; the shoulder alone has damping."""
    model = gs.load_model(arm, ignore="limits", gravity=(1.0, -2.0, 0.5), **START)
    motion, system = Motion(model), model.system
    assert (system.n, system.m) == (21, 18)
    assert model.parameters["upper_arm_m"] == pytest.approx(2.9, abs=4 * EPS)
    assert [body.name for body in system.bodies] == ["upper_arm", "slider", "wheel"]
    for name, value in (("shoulder_angle", 0.4), ("slide_1_travel", -0.15), ("wheel_angle", 2.0),
                        ("shoulder_rate", -1.1), ("slide_1_speed", 0.7), ("wheel_rate", 9.0)):
        assert abs(motion.value(name) - value) <= 64 * EPS * max(1, abs(value)), name
    values = dict(zip((*system.q, *system.p), (*model.q0, *np.zeros(system.n)), strict=True))
    values |= {parameter: model.parameters[str(parameter)] for parameter in system.parameters}
    mass = sum(model.parameters[f"{body.name}_m"] for body in system.bodies)
    weight = -evaluate(system.H_q, values).reshape(-1, 7)[:, 4:].sum(axis=0)
    assert np.abs(weight - mass * np.array([1.0, -2.0, 0.5])).max() <= 64 * EPS * 9.81 * mass
    force = evaluate(system.forces, values | dict(zip(system.p, motion.p, strict=True)))
    assert force @ motion.dq == pytest.approx(-0.3 * 1.1**2, rel=1e-12)  # -c ω²


def test_a_base_of_mass_zero_is_one_without_inertial(arm, tmp_path):
    moments = " ".join(f'{key}="0"' for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
    massless = changed(tmp_path, ('<link name="base"/>', '<link name="base"><inertial><mass '
                                  f'value="0"/><inertia {moments}/></inertial></link>'))
    model, expected = (gs.load_model(path, ignore="limits", **START) for path in (massless, arm))
    assert model.parameters == expected.parameters


def files_of_robots():
    """Return name → path of the robots of PyPI's example-robot-data, none without that package."""
    try:
        files = metadata.files("example-robot-data") or []
    except metadata.PackageNotFoundError:
        return {}
    return {file.name: Path(str(file.locate())) for file in files if file.name.endswith(".urdf")}


@pytest.mark.parametrize("name", ["ur5_robot", "xarm7", "go2", "solo12", "allegro_right_hand"])
def test_robots_from_pypi_move_as_pinocchio_has_it(name):
    """All joints of arms, legs and a hand have Pinocchio's accelerations at random states."""
    pin = pytest.importorskip("pinocchio", reason="pip install gyrospark[pinocchio]")
    path = files_of_robots().get(f"{name}.urdf")
    if path is None:
        pytest.skip("pip install example-robot-data (131 MB) to test real robots")
    reference = pin.buildModelFromUrdf(str(path))
    rng = np.random.default_rng(7)
    q, v, tau = pin.neutral(reference), rng.uniform(-1, 1, reference.nv), np.zeros(reference.nv)
    damping = {joint.attrib["name"]: float(dynamics.attrib.get("damping", 0))
               for joint in ElementTree.parse(path).getroot().iter("joint")
               for dynamics in joint.iter("dynamics")}
    angles, rates = {}, {}
    for joint, key in zip([*reference.joints][1:], [*reference.names][1:], strict=True):
        angles[key], rates[key] = float(rng.uniform(-1, 1)), float(v[joint.idx_v])
        q[joint.idx_q:joint.idx_q + joint.nq] = (
            angles[key] if joint.nq == 1 else (math.cos(angles[key]), math.sin(angles[key])))
        tau[joint.idx_v] = -damping.get(key, 0) * rates[key]
    motion = Motion(gs.load_model(path, ignore="all", angles=angles, rates=rates))
    expected = pin.aba(reference, reference.createData(), q, v, tau)
    accelerations = np.array([motion.acceleration(f"{plain_name(key)}_rate") for key in angles])
    order = [joint.idx_v for joint in [*reference.joints][1:]]
    assert np.abs(accelerations - expected[order]).max() <= 1e-12 * np.abs(expected).max()


FLOATING = (('<link name="base"/>', '<link name="base"><inertial><mass value="3"/>'
             '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.12" iyz="0" izz="0.08"/></inertial>'
             '</link>'),
            ('<dynamics damping="0.3"/>', ""))


def test_quaternions_are_rotations(tmp_path):
    """quat_xyzw of URDF 1.1, of any length, gives the same quarter turn about x as rpy."""
    turned = [("rpy=\"0.3 0.1 -0.4\"", attribute) for attribute in (
        f'rpy="{math.pi / 2} 0 0"', 'quat_xyzw="3 0 0 3"')]
    accelerations = [Motion(gs.load_model(changed(
        tmp_path, pair, ('<robot name="arm">', '<robot name="arm" version="1.1">')),
        ignore="limits", **START)).acceleration("wheel_rate") for pair in turned]
    assert accelerations[0] == pytest.approx(accelerations[1], rel=1e-12)


def test_a_floating_base_moves_as_pinocchio_has_it(tmp_path):
    pin = pytest.importorskip("pinocchio", reason="pip install gyrospark[pinocchio]")
    path = changed(tmp_path, *FLOATING)
    reference = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
    v = [0.5, 0.1, 2.0, 0.3, 1.0, -0.4]  # of the base, whose centre of mass is its origin
    model = gs.load_model(path, base="floating", ignore="limits", velocity=v[:3],
                         angular_velocity=v[3:], **START)
    a, s, w = START["angles"].values()
    q = np.array([0, 0, 0, 0, 0, 0, 1, a, s, math.cos(w), math.sin(w)])
    expected = pin.aba(reference, reference.createData(), q,
                       np.array([*v, *START["rates"].values()]), np.zeros(9))
    motion = Motion(model)
    accelerations = [motion.acceleration(name)
                     for name in ("shoulder_rate", "slide_1_speed", "wheel_rate")]
    assert np.abs(accelerations - expected[6:]).max() <= 1e-12 * np.abs(expected).max()


def test_a_floating_base_carries_the_tree(arm):
    """With all joints at rest, bodies move as one with v + ω × (x − x₀)."""
    v, w = np.array([0.5, 0, 2]), np.array([0.3, 1, -0.4])
    path = changed(arm.parent, *FLOATING)
    model = gs.load_model(path, base="floating", ignore="limits", velocity=v, angular_velocity=w)
    x, p = (z.reshape(-1, 7)[:, 4:] for z in (model.q0, model.p0))
    masses = np.array([model.parameters[f"{body.name}_m"] for body in model.system.bodies])
    assert np.abs(p / masses[:, None] - v - np.cross(w, x - x[0])).max() <= 64 * EPS
    with pytest.raises(gs.InputError, match=r"angular_velocity.*floating"):
        gs.load_model(path, ignore="limits", velocity=v)


FOLLOWERS = """<link name="slider"><inertial><mass value="1.2"/>
  <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.3"/></inertial></link>
  <link name="rim"><inertial><mass value="0.4"/>
  <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="slide-1" type="prismatic"><parent link="arm"/><child link="slider"/>
  <axis xyz="0 0.6 0.8"/><mimic joint="shoulder" multiplier="-0.2" offset="0.05"/></joint>
  <joint name="wheel" type="continuous"><parent link="slider"/><child link="rim"/>
  <axis xyz="1 0 0"/><mimic joint="shoulder" multiplier="3"/></joint></robot>
"""


def test_followers_follow(tmp_path):
    """<mimic> makes a travel −0.2 θ + 0.05 and an angle 3 θ of the shoulder's θ."""
    path = tmp_path / "followers.urdf"
    path.write_text(HINGE.replace("</robot>", FOLLOWERS), encoding="utf-8")
    model = gs.load_model(path, ignore="limits", angles={"shoulder": 0.5}, rates={"shoulder": 2.0})
    assert model.system.m == 20
    motion = Motion(model)
    a, s, w = map(motion.value, ("shoulder_angle", "slide_1_travel", "wheel_angle"))
    assert a == pytest.approx(0.5, abs=8 * EPS)
    assert s == pytest.approx(0.05 - 0.2 * a, abs=8 * EPS)
    assert w == pytest.approx(3 * a, abs=8 * EPS)
    for derivative in (motion.value, motion.acceleration):
        a, s, w = map(derivative, ("shoulder_rate", "slide_1_speed", "wheel_rate"))
        assert abs(a) > 0.1
        assert s == pytest.approx(-0.2 * a, rel=1e-12)
        assert w == pytest.approx(3 * a, rel=1e-12)
    with pytest.raises(gs.InputError, match=r"'wheel'.*'shoulder'"):
        gs.load_model(path, ignore="limits", angles={"wheel": 1.0})


def test_more_can_be_added(arm):
    """A motor and a loop are added: a rod to the ground holds the wheel's centre."""
    build = gs.Multibody.from_file(arm, ignore="limits", **START)
    build.motor("drive", "shoulder", torque=2.0 - build.rate("shoulder"))
    build.rod("tie", "ground", "wheel", on_a=(2, 0, 0))
    with pytest.warns(gs.errors.InputWarning, match="angular velocity"):
        model = build.model()
    assert model.system.m == 19
    assert build.start.after["tie: length"] <= 64 * EPS


def test_angles_and_rates_have_units_and_beyond_a_turn_warn(arm):
    # Numbers have units as in a model file; a number with its unit needs no warning.
    motion = Motion(gs.load_model(
        arm, ignore="limits", angles={"shoulder": "90 deg - 0.1 rad", "wheel": "45 rad",
                                      "slide-1": "1/4"},
        rates={"shoulder": "10 rpm", "slide-1": 0.5, "wheel": "pi/4"}))
    for name, value in (("shoulder_angle", math.pi / 2 - 0.1),
                        ("wheel_angle", 45), ("slide_1_travel", 0.25),
                        ("shoulder_rate", math.pi / 3), ("slide_1_speed", 0.5),
                        ("wheel_rate", math.pi / 4)):
        assert motion.value(name) == pytest.approx(value, rel=1e-13), name
    # Angles of hinges are warned of; a travel of 45 m and a rate of 45 rad/s are not.
    with pytest.warns(gs.errors.InputWarning, match="shoulder.*45 deg"):
        gs.load_model(arm, ignore="limits", angles={"shoulder": 45, "slide-1": 45},
                     rates={"wheel": 45})
    with pytest.raises(gs.InputError, match="unit deg"):
        gs.load_model(arm, ignore="limits", angles={"slide-1": "45 deg"})


def test_the_command_runs_it(arm, gyrospark):
    """The command takes settings by name, and refuses parts that are not ignored by a sentence."""
    arm.write_text(BAR.replace('"continuous">', '"revolute"><limit lower="-1" upper="1" effort="9" '
                               'velocity="9"/>'), encoding="utf-8")

    def run(*settings):
        options = [argument for setting in settings for argument in ("--set", setting)]
        return gyrospark("run", arm, "--scheme", "IMS", "--dt", "1e-3", "--steps", "20", "--json",
                         *options)

    done = run("ignore=limits", "elbow=0.4", "elbow.rate=3")
    assert done.code == 0, done.stderr
    assert done.document["steps"] == 20
    for settings, message in [
        ((), 'limits="stops"'), ((), "limits=1000"), (("ignore=limit",), "'limit'; choose limits"),
        (("ignore=limits", "wrist=1"), "'wrist'"), (("ignore=limits", "elbow=x"), "'elbow' is 'x'"),
        (("ignore=limits", "base=flying"), "'flying'"), (("limits=1000,2000",), "'1000,2000'"),
        (("limits=stop",), "'stops'"),
    ]:
        failed = run(*settings)
        assert failed.code == 2
        assert failed.stderr.count("\n") == 1
        assert message in failed.stderr, failed.stderr


def test_a_run_without_times_is_refused_before_it_is_derived(arm, gyrospark, monkeypatch):
    """The refusal names step and span together, before any derivation."""
    monkeypatch.setattr(Derivation, "record", lambda self: pytest.fail("derived"))
    for options, words in (((), ["--dt", "--t-end"]), (("--dt", "1e-3"), ["--steps", "--t-end"])):
        refused(gyrospark("run", arm, "--set", "ignore=all", *options), *words)


MASS = '<mass value="1.2"/>'
BAD = [
    ([('child link="slider"', 'child link="base"')], "cycle|roots"),
    ([('parent link="base"', 'parent link="wheel"')], "'base'|cycle|roots"),
    ([(MASS, '<mass value="0"/>')], "'slider'.*mass"),
    ([(MASS, '<mass value="-1"/>')], "'slider'.*mass is -1"),
    ([(MASS, '<mass value="1,2"/>')], "'1,2'"),
    ([(MASS, '<mass value="nan"/>')], "value='nan'"),
    ([(MASS, "")], "'slider'.*<mass>"),
    ([('ixx="0.01"', 'ixx="-0.01"')], r"'slider'.*-0\.01"),
    ([('damping="0.3"', 'damping="-0.3"')], r"damping is -0\.3"),
    ([('<axis xyz="0 0.6 0.8"/>', "")], "'slide-1'.*<axis>"),
    ([('<axis xyz="0 0.6 0.8"/>', '<axis xyz="0 0 0"/>')], "<axis>.*zero"),
    ([('type="continuous"', 'type="continous"')],
     "'wheel'.*'continous'.*continuous"),
    ([('child link="plate"', 'child link="plat"')], "'plat'"),
    ([('<link name="plate">', '<link name="slider">')], "'slider'.*twice"),
    ([('<link name="base"/>', '<link name="base"/><link name="lost"/>')],
     "2 roots, 'base', 'lost'"),
    ([('child link="wheel"', 'child link="slider"')],
     "'slider'.*'slide-1'.*'wheel'"),
    ([('<parent link="slider"/>', "")], "'wheel'.*<parent>"),
    ([('<parent link="slider"/>', "<parent/>")], "'wheel'.*<parent>.*link="),
    ([('<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0"\n      izz="0.0015"/>', "")],
     "'plate'.*<inertia>"),
    ([('<axis xyz="1 0 0"/>', '<axis xyz="1 0 0"/><mimic joint="flange"/>')], "'wheel'.*'flange'"),
    ([('<axis xyz="1 0 0"/>', '<axis xyz="1 0 0"/><mimic joint="wheel"/>')], "'wheel'.*itself"),
    ([("</robot>", "")], "element"),
    ([('<link name="plate">', '<link name="plate">heavy')], "<link>.*'heavy'"),
    ([("</inertial>", "<!-- -->2</inertial>")], "<inertial>.*'2'"),
    ([('<robot name="arm">', '<robot name="arm" xmlns:xacro="http://x"><xacro:include/>')],
     "xacro"),
    ([("<robot", "<sdf"), ("</robot", "</sdf")], "<sdf>"),
    ([('<link name="plate">', '<link name="plate" xmlns:xacro="http://x"><xacro:if/>')], "xacro"),
    ([('rpy="0.1 -0.2 0.3"', 'quat_xyzw="0 0 0 1"')], "line 6: <origin> has quat_xyzw=.*1.1"),
    ([('<robot name="arm">', '<robot name="arm" version="1.1">'),
      ('rpy="0.1 -0.2 0.3"', 'quat_xyzw="0 0 0 0"')], "0 0 0 1"),
    ([('<robot name="arm">', '<robot name="arm" version="1.1">'),
      ('rpy="0.1 -0.2 0.3"', 'rpy="0 0 0" quat_xyzw="0 0 0 1"')], "of them"),
    ([('<robot name="arm">', '<robot name="arm" version="3">')], "'3'; choose 1.0"),
    ("<robot/>", "<link>"), ('<robot><link name="one"/></robot>', "moves"),
    ("<robot><link/></robot>", "line 1.*<link>.*name="),
]


@pytest.mark.parametrize(("pairs", "message"), BAD, ids=lambda x: x if isinstance(x, str) else "")
def test_bad_files_are_refused(tmp_path, pairs, message):
    path = changed(tmp_path, *(pairs if isinstance(pairs, list) else ()))
    if isinstance(pairs, str):
        path.write_text(pairs, encoding="utf-8")
    with pytest.raises(gs.InputError, match=message) as caught:
        gs.load_model(path, ignore="all")
    assert ".urdf" in str(caught.value)
    assert "\n" not in str(caught.value)


# ---------------------------------------------------------------- loops

FOUR_BAR = """<robot name="four_bar">
  <link name="base"/>
  <link name="frame"/>
  <joint name="bolt" type="fixed"><origin xyz="0 0 0.5"/><parent link="base"/>
  <child link="frame"/></joint>
""" + "".join(f"""<link name="{name}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="1"/>
  <inertia ixx="0.001" ixy="0" ixz="0" iyy="{length**2 / 12}" iyz="0" izz="{length**2 / 12}"/>
  </inertial></link>
  <joint name="{name}_pin" type="revolute"><origin xyz="{x} 0 0"/><parent link="{parent}"/>
  <child link="{name}"/><axis xyz="0 -1 0"/></joint>""" for name, parent, x, length in (
    ("crank", "frame", 0, 0.4), ("coupler", "crank", 0.4, 1.0), ("rocker", "coupler", 1.0, 0.7))
) + "</robot>"
CLOSING = """
redundant = "leave out"
[[joints]]
name = "closing"
type = "revolute"
bodies = ["rocker", "frame"]
on_a = [0.7, 0, 0]
on_b = [1.1, 0, 0]
axis = [0, 1, 0]
"""


ANGLES = {"crank_pin": 1.2, "coupler_pin": -0.9, "rocker_pin": -1.9}


MOVED = r"'crank_pin' 1\.18.*given 1\.2"


def test_a_loop_has_the_rotation_of_its_links(tmp_path):
    """Links a2 and b2, turned in their bodies by 0.7 and −0.4, have θ_b = θ_a + 0.7 + 0.3 + 0.4."""
    robot, loops = tmp_path / "doors.urdf", tmp_path / "loops.toml"
    parts = "".join(f'''<link name="{x}"><inertial><mass value="1"/><inertia ixx=".3" iyy=".2"
        izz=".25" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="{x}2"/>
        <joint name="{x}_hinge" type="continuous"><parent link="base"/><child link="{x}"/>
        <axis xyz="0 0 1"/></joint><joint name="{x}3" type="fixed"><parent link="{x}"/>
        <child link="{x}2"/><origin rpy="0 0 {turn}"/></joint>'''
        for x, turn in (("a", 0.7), ("b", -0.4)))
    robot.write_text(f'<robot name="doors"><link name="base"/>{parts}</robot>')
    loops.write_text("""redundant = "leave out"
[[joints]]
name = "both"
type = "fixed"
bodies = ["a2", "b2"]
on_a = [0, 0, 0]
on_b = [0, 0, 0]
rotation = [["cos(0.3)", "-sin(0.3)", 0], ["sin(0.3)", "cos(0.3)", 0], [0, 0, 1]]
""")
    with pytest.warns(match="left out"):  # and no warning that the loop moves the start
        motion = Motion(gs.load_model(robot, loops=loops, angles={"a_hinge": 0.2, "b_hinge": 1.6}))
    assert motion.value("b_hinge_angle") == pytest.approx(1.6, rel=1e-14)


@pytest.mark.slow  # two steppers of a loop
def test_the_command_closes_loops_by_another_file(tmp_path, gyrospark):
    """A changed file of loops gives another run: the cache belongs to the file as it was."""
    robot, loops = tmp_path / "bars.urdf", tmp_path / "loops.toml"
    robot.write_text(FOUR_BAR)
    loops.write_text(CLOSING)
    run = ["run", robot, "--set", f"loops={loops}", "--dt", "5e-3", "--steps", "200", "--json",
           *(argument for name, value in ANGLES.items()
             for argument in ("--set", f"{name}={value}"))]
    answer = gyrospark(*run)
    assert answer.code == 0, answer.stderr
    loops.write_text(CLOSING.replace("1.1", "1.0"))
    assert gyrospark(*run).document != answer.document


@pytest.mark.parametrize("kind", [pytest.param("ball", marks=pytest.mark.slow), "revolute"])
def test_loops_are_closed_by_constraints_of_the_file(tmp_path, kind):
    """<constraint> of urdfdom's proposal makes the same four-bar as a file of loops."""
    robot, loops = tmp_path / "bars.urdf", tmp_path / "loops.toml"
    robot.write_text(FOUR_BAR)
    loops.write_text(CLOSING)
    constraint = f"""<constraint name="closing" type="{kind}"><parent link="rocker"/>
      <parent_origin xyz=".7 0 0" rpy=".2 0 0"/><parent_axis xyz="0 .980066577841242
      -.198669330795061"/><child link="frame"/><child_origin xyz="1.1 0 0"/></constraint></robot>"""
    with pytest.warns(gs.errors.InputWarning, match=MOVED), pytest.warns(match="closing"):
        reference = Motion(gs.load_model(robot, loops=loops, angles=ANGLES))
    robot.write_text(FOUR_BAR.replace("</robot>", constraint))
    with pytest.warns(gs.errors.InputWarning, match=MOVED), pytest.warns(match="closing"):
        motion = Motion(gs.load_model(robot, angles=ANGLES))
    for name in ("crank", "coupler", "rocker"):
        assert motion.acceleration(f"{name}_pin_rate") == pytest.approx(
            reference.acceleration(f"{name}_pin_rate"), rel=1e-10)
    for old, new in (("rocker", "rockr"), (kind, "hinge"), ("parent_axis", "axis")):
        robot.write_text(FOUR_BAR.replace("</robot>", constraint.replace(old, new)))
        if (old, kind) != ("parent_axis", "ball"):
            with pytest.raises(gs.InputError, match="closing.*" + new):
                gs.load_model(robot, angles=ANGLES)


@pytest.mark.parametrize(("text", "message"), [
    ("", "[[joints]]"),
    (CLOSING.replace("rocker", "rockr"), "'rockr'"),
    (CLOSING.replace("on_a", "onn"), "onn"), (CLOSING.replace("revolute", "hinge"), "'hinge'"),
    (CLOSING.replace('"frame"]', '"rocker"]'), "itself"),
    (CLOSING.replace("[0, 1, 0]", "[0, 0, 0]"), "'closing'"),
    (CLOSING.replace('redundant = "leave out"', ""), "are redundant"),
    (CLOSING.replace('"leave out"', '"drop"'), "'drop'"),
    (CLOSING.replace("bodies =", "links ="), "bodies"), ("joints = 3", "joints"),
    (CLOSING + "\n[run]\ndt = 1", "run"),
])
def test_bad_loops_are_refused(tmp_path, text, message):
    robot, loops = tmp_path / "bars.urdf", tmp_path / "loops.toml"
    robot.write_text(FOUR_BAR)
    loops.write_text(text)
    with pytest.raises(gs.InputError) as caught:
        gs.load_model(robot, loops=loops, angles=ANGLES)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert "loops.toml" in str(caught.value)


def test_joints_whose_names_differ_in_a_hyphen_keep_their_quantities(arm):
    """``slide-1`` and a shoulder renamed ``slide_1`` both have a coordinate to show."""
    text = ARM.replace('name="shoulder"', 'name="slide_1"')
    arm.write_text(text, encoding="utf-8")
    motion = Motion(gs.load_model(arm, ignore="limits", angles={"slide_1": 0.3, "slide-1": 0.2}))
    assert motion.value("slide_1_angle") == pytest.approx(0.3, rel=1e-14)
    assert motion.value("slide_1_1_travel") == pytest.approx(0.2, rel=1e-14)


@pytest.mark.parametrize(("text", "ending", "name", "ends"), [
    (LIMITED, "urdf", "shoulder", (-1, 1)),  # a missing end is 0 in URDF 1.0, and none in 1.2
    (LIMITED.replace('lower="-1" ', ""), "urdf", "shoulder", (0, 1)),
    (LIMITED.replace('lower="-1" ', "").replace("<robot", '<robot version="1.2"'), "urdf",
     "shoulder", (None, 1)),
    ('<mujoco><worldbody><body><geom size=".1" pos="0 0 -1"/><joint name="j" axis="0 1 0" '
     'range="-10 20"/></body></worldbody></mujoco>', "xml", "j", np.radians([-10, 20])),
    ('<sdf version="1.11"><model name="m"><link name="arm"><inertial><pose>.5 0 0 0 0 0</pose>'
     "<mass>2</mass><inertia><ixx>.1</ixx><iyy>.1</iyy><izz>.1</izz></inertia></inertial></link>"
     '<joint name="pin" type="revolute"><parent>world</parent><child>arm</child><axis>'
     "<xyz>0 1 0</xyz><limit><lower>-1e16</lower><upper>.5</upper></limit></axis></joint></model>"
     "</sdf>", "sdf", "pin", (None, 0.5)),
])
def test_ranges_are_elastic_or_stops_on_wish(tmp_path, text, ending, name, ends):
    """A range stores V = ½ k d² beyond an end, or has a gap to each end and one restitution."""
    if ending == "xml":
        pytest.importorskip("mujoco")
    path = tmp_path / f"arm.{ending}"
    path.write_text(text, encoding="utf-8")
    lower, upper = ends
    for limits, cure in ((None, "limits"), (-1, "limits.*-1.*above 0"),
                         ("stop", "limits.*'stops'.*number"),
                         ("1000", "limits.*1000.*'stops'.*number")):
        with pytest.raises(gs.InputError, match=cure):
            gs.load_model(path, limits=limits)
    below = (-0.7, 0) if lower is None else (lower - 0.3, 0.3)
    for angle, beyond in ((upper + 0.4, 0.4), below):
        free, elastic = (Motion(gs.load_model(path, angles={name: angle}, **options)).energy()
                         for options in ({"ignore": "limits"}, {"limits": 40.0}))
        assert elastic - free == pytest.approx(40 * beyond**2 / 2, rel=1e-12, abs=1e-12)
    model = gs.load_model(path, **read_settings({"limits": "stops", name: "0.1"}, text, path))
    motion, both = Motion(model), lower is not None
    gaps = {"lower": 0.1 - lower} if both else {}
    for impact, (side, gap) in zip(model.events, (gaps | {"upper": upper - 0.1}).items(),
                                   strict=True):
        assert impact.name == f"{name}_limits" + f"_{side}" * both
        assert motion.value(impact.quantity) == pytest.approx(gap, abs=1e-12)
        assert impact.restitution == "restitution"
    assert (model.parameters["restitution"], model.parameters["gravity_z"]) == (1, -9.81)
