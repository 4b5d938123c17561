"""SDF: trees as in URDF, loops closed by joints, bad files."""

import numpy as np
import pytest

import gyrospark as gs
from robots import Motion

LINK = """<link name="{name}"><pose{frame}>{pose}</pose><inertial><pose>{x} 0 0 0 0 0</pose><mass>1
</mass><inertia><ixx>.001</ixx><iyy>{I}</iyy><izz>{I}</izz></inertia></inertial></link>"""
BARS = (("crank", "0 0 .5 0 -1.2 0", 0.4, ""), ("coupler", ".4 0 0 0 .9 0", 1.0, "crank"),
        ("rocker", "1 0 0 0 1.9 0", 0.7, "coupler"))
#: The bars of a four-bar with the pin of the last one, where the file places them.
LINKS = "".join(LINK.format(name=name, pose=pose, x=length / 2, I=length**2 / 12,
                            frame=f' relative_to="{above}"' if above else "")
                for name, pose, length, above in BARS)
JOINT = ('<joint name="{child}_pin" type="revolute"><parent>{parent}</parent><child>{child}</child>'
         '<axis><xyz>0 -1 0</xyz><dynamics><damping>.1</damping><spring_stiffness>2'
         '</spring_stiffness><spring_reference>.3</spring_reference></dynamics></axis></joint>')
JOINTS = "".join(JOINT.format(parent=parent, child=child) for parent, child in (
    ("world", "crank"), ("crank", "coupler"), ("coupler", "rocker")))
CLOSE = ('<joint name="loop" type="{}"><pose relative_to="rocker">.7 0 0 0 0 0</pose>'
         '<parent>world</parent><child>rocker</child><axis><xyz>0 1 0</xyz></axis></joint>')


def written(tmp_path, inside):
    path = tmp_path / "bars.sdf"
    path.write_text(f'<sdf version="1.7"><model name="bars">{inside}</model></sdf>')
    return path


def by_hand(closing):
    """Return the motion of the bars of the file, put together in space by the builder."""
    build = gs.Multibody("hand")
    tilt, x, above = 0.0, np.array([0, 0, 0.5]), build.ground
    for (name, _, length, _), turned in zip(BARS, (1.2, -0.9, -1.9), strict=True):
        tilt += turned
        along = np.array([np.cos(tilt), 0, np.sin(tilt)])
        body = build.body(name, mass=1, inertia=(0.001, length**2 / 12, length**2 / 12),
                          position=x + length / 2 * along,
                          quaternion=(np.cos(tilt / 2), 0, -np.sin(tilt / 2), 0))
        pin = build.revolute(f"{name}_pin", above, body, axis_in_space=(0, -1, 0), at=x)
        build.joint_spring(f"{name}_spring", pin, stiffness=2, damping=0.1, rest=0.3)
        build.quantity(f"{name}_pin_rate", build.rate(pin))
        x, above = x + length * along, body
    if closing:
        build.ball("loop", "ground", above, on_b=(0.35, 0, 0), at=x)
    return Motion(build.model(redundant="leave out"))


@pytest.mark.parametrize("closing", [
    pytest.param("", marks=pytest.mark.slow), CLOSE.format("ball"),
    pytest.param(CLOSE.format("revolute"), marks=pytest.mark.slow)], ids=["", "ball", "revolute"])
def test_bars_are_those_put_together_by_hand(tmp_path, closing):
    """A triple pendulum, and a four-bar with a joint more, have the accelerations by hand."""
    path = written(tmp_path, LINKS + JOINTS + closing)
    if closing:
        with pytest.warns(gs.errors.InputWarning, match="loop"):
            motion = Motion(gs.load_model(path))
    else:
        motion = Motion(gs.load_model(path))
    reference = by_hand(bool(closing))
    for name, *_ in BARS:
        assert motion.acceleration(f"{name}_pin_rate") == pytest.approx(
            reference.acceleration(f"{name}_pin_rate"), rel=1e-10)


#: A parallelogram in the xz plane: from the ground up, across, and down to the ground again.
SIDE = """<link name="{0}"><pose>{1}</pose><inertial><mass>1</mass><inertia><ixx>.1</ixx><iyy>.1
</iyy><izz>.1</izz></inertia></inertial></link><joint name="{0}_pin" type="revolute"><pose
relative_to="__model__">{2}</pose><parent>{3}</parent><child>{0}</child><axis><xyz>0 1 0</xyz>
</axis></joint>"""
SIDES = "".join(SIDE.format(*side) for side in (
    ("left", "0 0 .5 0 0 0", "0 0 0 0 0 0", "world"),
    ("top", ".5 0 1 0 0 0", "0 0 1 0 0 0", "left"),
    ("right", "1 0 .5 0 0 0", "1 0 1 0 0 0", "top")))
LAST = ('<joint name="last" type="{}"><pose relative_to="__model__">1 0 0 0 0 0</pose>'
        "<parent>world</parent><child>right</child><axis><xyz>0 1 0</xyz>{}</axis></joint>")
TILTED = {"left_pin": 0.4, "top_pin": -0.4, "right_pin": 0.4}


def test_springs_and_ranges_of_a_joint_that_closes_a_loop(tmp_path):
    """The last pin of a parallelogram stores V = k θ²/2, and k (θ − end)²/2 beyond its range."""
    spring = "<dynamics><spring_stiffness>7</spring_stiffness></dynamics>"
    limit = "<limit><lower>-.1</lower><upper>.1</upper></limit>"
    for inside, energy, options in ((spring, 7 * 0.4**2 / 2, {}),
                                    (limit, 9 * 0.3**2 / 2, {"limits": 9.0})):
        path = written(tmp_path, SIDES + LAST.format("revolute", inside))
        with pytest.warns(gs.errors.InputWarning, match="redundant"):
            model = gs.load_model(path, angles=TILTED, gravity=(0, 0, 0), **options)
        assert Motion(model).energy() == pytest.approx(energy, rel=1e-12)
    with pytest.warns(gs.errors.InputWarning, match="redundant"):
        model = gs.load_model(path, limits="stops")
    assert len(model.events) == 2


def test_a_spring_of_a_slide_that_closes_a_loop(tmp_path):
    """A link on two slides: the second one's spring stores V = k x²/2."""
    first = SIDE.format("left", "0 0 .5 0 0 0", "0 0 0 0 0 0", "world")
    second = LAST.format("prismatic", "<dynamics><spring_stiffness>7</spring_stiffness></dynamics>")
    path = written(tmp_path, first.replace("revolute", "prismatic")
                   + second.replace("<child>right", "<child>left"))
    with pytest.warns(gs.errors.InputWarning, match="redundant"):
        model = gs.load_model(path, angles={"left_pin": 0.4}, gravity=(0, 0, 0))
    assert Motion(model).energy() == pytest.approx(7 * 0.4**2 / 2, rel=1e-12)


def test_a_loop_that_starts_turned_out_of_its_joint_is_refused(tmp_path):
    """A slide does not turn, so that angles that turn its body by 0.4 rad close no loop."""
    path = written(tmp_path, SIDES + LAST.format("prismatic", ""))
    with pytest.raises(gs.InputError, match=r"'last_loop'.*22\.9"):
        gs.load_model(path, angles={"left_pin": 0.4})


def test_angles_move_the_tree(tmp_path):
    """Angles count from the pose of the link in the file; a root without a joint floats."""
    path = written(tmp_path, LINKS + JOINTS)
    motion = Motion(gs.load_model(path, angles={"coupler_pin": "90 deg"},
                                  rates={"rocker_pin": 2.0}))
    assert motion.value("coupler_pin_angle") == pytest.approx(np.pi / 2, rel=1e-14)
    assert motion.value("rocker_pin_rate") == pytest.approx(2.0, rel=1e-14)
    floating = gs.load_model(written(tmp_path, LINKS + JOINTS.replace(
        JOINT.format(parent="world", child="crank"), "")))
    assert floating.system.n - floating.system.m == 6 + 2
    x = 0.2 * np.array([np.cos(1.2), 0, np.sin(1.2)]) + [0, 0, 0.5]
    assert floating.q0[4:7] == pytest.approx(x, abs=1e-15)
    fixed = gs.load_model(tmp_path / "bars.sdf", base="fixed")
    assert fixed.system.n - fixed.system.m == 2


@pytest.mark.parametrize(("base", "message"), [
    ("floating", "floating.*'crank_pin'"), ("fixd", "'fixd'.*fixed or floating")])
def test_what_hangs_on_the_world_does_not_float(tmp_path, base, message):
    with pytest.raises(gs.InputError, match=message):
        gs.load_model(written(tmp_path, LINKS + JOINTS), base=base)


@pytest.mark.parametrize(("inside", "message"), [
    ("<robot/>", "<robot>.*<sdf>"), ("<sdf version='1.7'/>", "0 models"),
    ("<sdf version='1.7'><model name='a'/><model name='b'/></sdf>", "2 models"),
    ("", "<link>"), (LINKS + JOINTS.replace("revolute", "gearbox"), "'gearbox'"),
    (LINKS + JOINTS.replace("<child>rocker", "<child>rockr"), "'rockr'.*rocker"),
    (LINKS + JOINTS.replace("<parent>crank", "<parent>bars"), "'coupler_pin'.*'bars'"),
    (LINKS + JOINTS.replace("<parent>world</parent>", ""), "<parent>"),
    (LINKS + JOINTS.replace("<xyz>", "<xyz expressed_in='here'>"), "'crank_pin'.*'here'"),
    (LINKS.replace("<mass>1\n</mass>", "") + JOINTS, "'crank'.*<mass>"),
    (LINKS.replace("<pose>0 0 .5", "<pose degrees='true' rotation_format='quat_xyzw'>0 0 .5 0")
     + JOINTS, "degrees.*quaternion"),
    (LINKS + JOINTS.replace("0 -1 0", "0 0 0"), "zero"), (LINKS + JOINTS + LINKS, "'crank'"),
    (LINKS.replace('relative_to="crank"', 'relative_to="rocker"') + JOINTS, "circle"),
    (LINKS.replace('relative_to="crank"', 'relative_to="frame"') + JOINTS, "'frame'"),
    (LINKS.replace("<mass>1", "<mass>-1") + JOINTS, r"line \d+.*'crank'"),
    (LINKS.replace("<ixx>.001", "<ixx>-.001") + JOINTS, r"line \d+.*'crank'"),
    (LINKS.replace("<ixx>.001", "<ixx>nan") + JOINTS, "'nan'"),
    (LINKS + JOINTS.replace("<damping>.1", "<damping>-.1"), r"damping.*-0\.1"),
    (LINKS + JOINTS + "<plugin/>", "plugin"), (LINKS + JOINTS + "<include/>", "<include>"),
    (LINKS.replace("<ixx>.001</ixx>", "") + JOINTS, "<ixx>"),
    (LINKS.replace("<pose>0 0 .5", "<pose degrees='no'>0 0 .5") + JOINTS, "'no'"),
    (LINKS.replace("<pose>0 0 .5", "<pose rotation_format='euler'>0 0 .5") + JOINTS, "'euler'"),
    (LINKS.replace("<pose>0 0 .5 0 -1.2 0", "<pose rotation_format='quat_xyzw'>0 0 .5 0 0 0 0")
     + JOINTS, "quaternion"),
    (LINKS + JOINTS.replace("</axis>", "<mimic joint='crank_pinn'/></axis>", 1), "'crank_pinn'"),
    (LINKS + JOINTS.replace("</axis>", "<mimic/></axis>"), "joint="),
    (LINKS + JOINTS + CLOSE.format("revolute").replace(
        "</axis>", "<mimic joint='crank_pin'/></axis>"), "'loop'.*<mimic>"),
    (LINKS + JOINTS.replace("</axis>", "<limit><lower>-1</lower></limit></axis>"), "limits"),
    (LINKS.replace("<inertia>", "<inertia>1", 1) + JOINTS, "<inertia>.*'1'"),
    (LINKS, "roots"),
    (LINKS + JOINTS + CLOSE.format("ball").replace(">world<", ">crank<").replace(
        "<child>rocker", "<child>world"), "'loop'.*'world'.*swap"),
    (LINKS + JOINTS.replace("<parent>world", "<parent>rocker"), "cycle.*swap <parent>"),
])
def test_bad_files_are_refused(tmp_path, inside, message):
    path = written(tmp_path, inside)
    if inside.startswith(("<sdf", "<robot")):
        path.write_text(inside)
    with pytest.raises(gs.InputError, match=message) as caught:
        gs.load_model(path)
    assert "bars.sdf" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_links_look_as_their_file_says(tmp_path):
    """Shapes and colours of <visual> are placed by their poses in the axes of the body."""
    visual = ("<visual name='v'><pose>.1 0 0 0 0 0</pose><geometry><cylinder><radius>.1</radius>"
              "<length>.4</length></cylinder></geometry><material><diffuse>0 1 0 1</diffuse>"
              "</material></visual><visual name='w'><geometry><box><size>2 4 6</size></box>"
              "</geometry></visual><visual name='x'><geometry><mesh><uri>a.stl</uri><scale>2 2 2"
              "</scale></mesh></geometry></visual>")
    pinned = '<joint name="crank_pin" type="revolute"><pose>.3 0 0 0 0 0</pose>'
    path = written(tmp_path, LINKS.replace("</inertial></link>", "</inertial>" + visual + "</link>")
                   + JOINTS.replace('<joint name="crank_pin" type="revolute">', pinned))
    (tmp_path / "a.stl").write_text("vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n")
    disc, box, mesh = gs.Multibody.from_file(path)._visuals["crank"]
    assert (disc.kind, disc.size.tolist(), disc.colour) == ("disc", [0.1, 0.1, 0.2], "#00ff00")
    assert disc.centre == pytest.approx([0.1 - 0.2, 0, 0], abs=1e-15)  # from the centre of mass
    assert box.size.tolist() == [1, 2, 3]
    assert (mesh.file, mesh.size.tolist()) == (str(tmp_path / "a.stl"), [2, 2, 2])


#: A rod of 2 kg and inertia .1 kg m² whose centre of mass is .5 m from a hinge about y.
ARM = """<link name="arm">{link}<inertial><pose>.5 0 0 0 0 0</pose><mass>2</mass>
<inertia><ixx>.01</ixx><iyy>.1</iyy><izz>.1</izz></inertia></inertial></link>"""
PIN = """<joint name="pin" type="revolute"><parent>{parent}</parent><child>{child}</child>
<axis><xyz>0 1 0</xyz></axis></joint>"""
HELD = PIN.format(parent="world", child="arm")
FREE_FALL = 2 * 9.81 * 0.5 / (0.1 + 2 * 0.25)


def turning(tmp_path, text, **options):
    """Return the angular acceleration of the pin of a file."""
    path = tmp_path / "arm.sdf"
    path.write_text(text)
    return Motion(gs.load_model(path, **options)).acceleration("pin_rate")


def model(inside, attributes="", version="1.11"):
    return f'<sdf version="{version}"><model name="m"{attributes}>{inside}</model></sdf>'


def test_a_link_may_be_without_weight(tmp_path):
    """<gravity> takes away a link's weight: all of it alone, half of it beside an equal link."""
    for flag, share in (("false", 0.0), ("true", 1.0), ("0", 0.0)):
        acceleration = turning(
            tmp_path, model(ARM.format(link=f"<gravity>{flag}</gravity>") + HELD))
        assert acceleration == pytest.approx(share * FREE_FALL, rel=1e-13, abs=1e-13)
    weightless = ARM.format(link="<gravity>false</gravity>").replace('"arm"', '"other"')
    bolt = """<joint name="bolt" type="fixed"><parent>arm</parent><child>other</child></joint>"""
    both = turning(tmp_path, model(ARM.format(link="") + weightless + bolt + HELD))
    assert both == pytest.approx(FREE_FALL / 2, rel=1e-13)


@pytest.mark.parametrize(("pose", "attributes", "share"), [
    ("<pose>1 2 3 .5 0 .3</pose>", "", np.cos(0.5)),
    ("<pose degrees='true'>1 2 3 0 60 0</pose>", "", 0.5),
    ("<pose rotation_format='quat_xyzw'>0 0 0 .6 0 0 .8</pose>", "", 0.28),
    ("<pose>0 0 0 .5 0 0</pose><frame name='f'><pose>1 0 0 .2 0 0</pose></frame>",
     " placement_frame='f'", np.cos(0.3)),
])
def test_the_model_is_at_its_pose(tmp_path, pose, attributes, share):
    """Gravity turns a hinge tilted by the pose with its share normal to the axis."""
    acceleration = turning(tmp_path, model(pose + ARM.format(link="") + HELD, attributes))
    assert acceleration == pytest.approx(share * FREE_FALL, rel=1e-13)


@pytest.mark.parametrize("outside", [
    PIN.format(parent="world", child="m::arm"),
    PIN.format(parent="here", child="m::there") + "<frame name='here'><pose>1 0 0 0 0 0</pose>"
    "</frame>",
    PIN.format(parent="world", child="m").replace("<axis>", "<pose relative_to='m::arm'/><axis>"),
])
def test_joints_of_the_world_hold_the_model(tmp_path, outside):
    """A joint beside the model, whose ends may be frames, acts as a joint of the model."""
    inside = ARM.format(link="") + "<frame name='there' attached_to='arm'/>"
    text = (f"<sdf version='1.11'><world name='w'><gravity>0 0 -9.81</gravity>{outside}"
            f"<model name='m'><pose>3 0 0 0 0 0</pose>{inside}</model></world></sdf>")
    assert turning(tmp_path, text) == pytest.approx(FREE_FALL, rel=1e-13)


@pytest.mark.parametrize(("world", "g"), [
    ("<gravity>0 0 -1.5</gravity>", 1.5), ("", 9.8),
    ("<physics type='ode'><gravity>0 0 -1.5</gravity></physics>", 1.5),
])
def test_gravity_is_that_of_the_world(tmp_path, world, g):
    """<gravity> counts also in <physics>, its place before version 1.6; without it g is 9.8."""
    text = (f"<sdf version='1.5'><world name='w'>{world}<model name='m'>{ARM.format(link='')}"
            f"{HELD}</model></world></sdf>")
    assert turning(tmp_path, text) == pytest.approx(FREE_FALL * g / 9.81, rel=1e-13)
    with pytest.raises(gs.InputError, match="line 1"):
        turning(tmp_path, text.replace(
            "<model", "<physics><gravity>0 0 -3</gravity></physics><model", 1).replace(
            "<world name='w'>", "<world name='w'><physics><gravity>0 0 -2</gravity></physics>"))


def test_an_axis_may_follow_another(tmp_path):
    """<mimic> inside <axis> makes q₂ = 2 (q₁ − .1) + .3: one freedom, with both arms' inertia."""
    second = ARM.format(link="<pose>0 1 0 0 0 0</pose>").replace('"arm"', '"other"')
    follower = PIN.format(parent="world", child="other").replace('"pin"', '"second"').replace(
        "</xyz>", """</xyz><mimic joint="pin"><multiplier>2</multiplier><offset>.3</offset>
        <reference>.1</reference></mimic>""")
    path = tmp_path / "arms.sdf"
    path.write_text(model(ARM.format(link="") + second + HELD + follower))
    motion = Motion(gs.load_model(path, angles={"pin": 0.4}))
    assert motion.system.n - motion.system.m == 1
    assert motion.value("second_angle") == pytest.approx(0.9, rel=1e-13)
    torque = 2 * 9.81 * 0.5 * (np.cos(0.4) + 2 * np.cos(0.9))
    assert motion.acceleration("pin_rate") == pytest.approx(torque / (0.6 * 5), rel=1e-12)
    for element, angle in (("<multiplier>2</multiplier>", 0.6), ("<offset>.3</offset>", 0.3),
                         ("<reference>.1</reference>", 0.4)):  # their defaults are 1, 0, 0
        path.write_text(path.read_text().replace(element, ""))
        motion = Motion(gs.load_model(path, angles={"pin": 0.4}))
        assert motion.value("second_angle") == pytest.approx(angle, rel=1e-13)


def test_endless_ranges_have_no_ends(tmp_path):
    endless = HELD.replace("</axis>", "<limit><lower>-inf</lower><upper>inf</upper></limit></axis>")
    acceleration = turning(tmp_path, model(ARM.format(link="") + endless))
    assert acceleration == pytest.approx(FREE_FALL, rel=1e-13)
    with pytest.raises(gs.InputError, match="limits"):
        turning(tmp_path, model(ARM.format(link="") + endless.replace(">inf", ">1")))


def test_a_link_without_inertia_has_that_of_the_standard(tmp_path):
    """A wheel on the tip of the arm has 1 kg and 1 kg m², with a warning."""
    bare = """<link name="tip"><pose>1 0 0 0 0 0</pose></link><joint name="bolt" type="fixed">
    <parent>arm</parent><child>tip</child></joint>"""
    with pytest.warns(gs.errors.InputWarning, match="tip"):
        acceleration = turning(tmp_path, model(ARM.format(link="") + bare + HELD))
    assert acceleration == pytest.approx(9.81 * 2 / (0.6 + 1 + 1), rel=1e-13)
