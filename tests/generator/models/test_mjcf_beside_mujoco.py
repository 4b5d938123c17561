"""Accelerations of robots in MJCF beside MuJoCo's: random ones, and each feature."""

import pytest

import gyrospark as gs

mujoco = pytest.importorskip("mujoco", reason="pip install mujoco-core")

from random_mjcf import compare, random_robot  # noqa: E402

# MuJoCo gets the start as the loops moved it.
pytestmark = pytest.mark.filterwarnings("ignore:MuJoCo warns", "ignore:.*left out",
                                        "ignore:The loops move the start")
#: Rounding of one solve of a system of 7 coordinates a body, in units of the largest number.
CLOSE = 1e-8


def compare_robots(tmp_path, seeds, loops):
    """Return the numbers of robots that were compared, and that were refused by a sentence."""
    compared, refusals, apart = 0, [], {}
    for seed in seeds:
        text = random_robot(seed, loops)
        if text is None:
            continue
        path = tmp_path / f"{seed}.xml"
        path.write_text(text)
        try:
            difference = compare(path)
            compared += 1
            if not difference <= CLOSE:
                apart[seed] = difference
        except gs.InputError as error:
            refusals.append(str(error))
    assert not apart
    assert not any("\n" in sentence for sentence in refusals)
    return compared, len(refusals)


@pytest.mark.parametrize(("seeds", "loops"), [
    pytest.param((17,), False, marks=pytest.mark.slow), ((5, 18), True)])
def test_random_robots_move_as_in_mujoco(tmp_path, seeds, loops):
    """Robots with free, ball, slide and hinge joints, tendons, gravcomp or loops move as there."""
    assert compare_robots(tmp_path, seeds, loops) == (len(seeds), 0)


@pytest.mark.slow  # 1,200 robots are derived, half a second each
@pytest.mark.parametrize(("first", "loops"), [
    *((first, False) for first in range(0, 1250, 125)), *((first, True) for first in (0, 125))])
def test_many_random_robots_move_as_in_mujoco(tmp_path, first, loops):
    """Random robots of all features of MJCF agree with MuJoCo or are refused by a sentence."""
    compared, refused = compare_robots(tmp_path, range(first, first + 125), loops)
    assert compared >= 30
    assert compared + refused >= 90


ARM = ('<worldbody><body name="b"><joint name="j" axis="0 1 0"/><geom size=".1" pos=".5 0 0"/>'
       "{}</body></worldbody>")
KEY = '<keyframe><key name="k" qpos="{}" qvel="{}" {}/></keyframe>'
ONE_KEY = KEY.format("0.3", "0.7", 'ctrl="2"')
MOTOR = '<actuator><{} joint="j"/></actuator>'
CORD = ('<tendon><fixed stiffness="3" damping="2" springlength=".1"><joint joint="j" coef="2"/>'
        "</fixed></tendon>")
FREE = ('<worldbody><body name="b" gravcomp="{}"><freejoint align="true"/><geom size=".1" '
        'pos=".3 .1 0"/><geom size=".2" pos="0 .4 .1"/></body></worldbody>')
FREE_KEY = KEY.format("1 2 3 .5 .5 -.5 .5", "1 2 3 -1 1 .5", "")


def row(*joints):
    """Return a body with several joints, each by kind, axis and further attributes."""
    return "<worldbody><body>" + "".join(
        f'<joint name="j{k}" type="{kind}" axis="{axis}" {attributes}/>'
        for k, (kind, axis, attributes) in enumerate(joints)) + (
        '<inertial pos=".1 .2 -.3" mass="1.5" diaginertia=".05 .06 .04"/></body></worldbody>')


BAR = ('<body name="{0}" pos="{1}"><joint name="{0}" {2}/><inertial pos="{3} 0 0" mass="1" '
       'diaginertia=".001 .1 .1"/>')
FEATURES = {
    "a four-bar of sites with classes": '<default><joint axis="0 -1 0"/><default class="stiff">'
    '<joint armature=".02" damping=".1"/></default></default><worldbody>'
    '<body name="frame" pos="0 0 .5" childclass="stiff">' + BAR.format("crank", "0 0 0", "", ".2")
    + BAR.format("coupler", ".4 0 0", 'class="main"', ".5")
    + BAR.format("rocker", "1 0 0", "", ".3")
    + '<site name="tip" pos=".7 0 0"/></body></body></body><site name="pin" pos="1.1 0 0"/></body>'
    '</worldbody><equality><connect name="loop" site1="tip" site2="pin"/></equality>'
    + KEY.format("1.2 -.9 -1.9", "0 0 0", ""),
    "general default of another kind": "<default><general gainprm='3' biastype='affine' "
    "biasprm='1 -2 -3'/></default>" + ARM.format("") + MOTOR.format("general") + ONE_KEY,
    "position after a general default": "<default><general gear='2' biasprm='1 0 0'/></default>"
    + ARM.format("") + MOTOR.format("position") + ONE_KEY,
    "motor after a position default": "<default><position kp='5' kv='2'/></default>"
    + ARM.format("") + MOTOR.format("motor") + ONE_KEY,
    "springs of tendons disabled": '<option><flag spring="disable"/></option>' + ARM.format("")
    + CORD + KEY.format("0.3", "0.7", ""),
    "dampers of tendons disabled": '<option><flag damper="disable"/></option>' + ARM.format("")
    + CORD + KEY.format("0.3", "0.7", ""),
    "gravcomp with springs and dampers disabled": '<option><flag spring="disable" damper="disable"'
    "/></option>" + FREE.format(1) + FREE_KEY,
    "a lone negative gravcomp": FREE.format(-1) + FREE_KEY,
    "a disabled group of actuators": '<option actuatorgroupdisable="2"/>' + ARM.format("")
    + '<actuator><motor joint="j" group="2"/></actuator>' + ONE_KEY,
    "fromto of a box with two sizes": ARM.format(
        '<geom type="box" size=".1 .3" fromto="0 0 0 1 1 0"/>') + KEY.format("0.3", "0.7", ""),
    "fromto of an ellipsoid": ARM.format(
        '<geom type="ellipsoid" size=".1 .3" fromto="0 0 0 1 1 0"/>')
    + KEY.format("0.3", "0.7", ""),
    "a weld with relpose and anchor": FREE.format(0)[:-len("</worldbody>")]
    + '<body name="c"><freejoint/><geom size=".1"/></body></worldbody><equality><weld body1="b" '
    'body2="c" anchor=".1 .2 .3" relpose="0 0 1 1 1 0 0"/></equality>' + KEY.format(
        "0 0 0 1 0 0 0 .1 .5 1.3 1 1 0 0", "1 2 3 -1 1 .5 0 0 0 0 0 0", ""),
    "align with a keyframe": FREE.format(0) + FREE_KEY,
    "total mass with fused bodies": '<compiler settotalmass="7" fusestatic="true"/>' + ARM.format(
        '<body pos="1 0 0"><geom size=".1"/></body>') + KEY.format("0.3", "0.7", ""),
    "a slide with a position actuator": "<default><position kp='50'/></default>" + row(
        ("slide", "0.87 0 0.5", 'ref=".2" armature="1"'))
    + '<actuator><position joint="j0" kv="2"/></actuator>' + KEY.format(".5", ".25", ""),
    "a chain of a slide and two skew hinges": row(
        ("slide", "0 .6 .8", 'armature=".3"'), ("hinge", "1 0 .5", 'armature=".02" pos="0 .1 0"'),
        ("hinge", ".2 1 0", 'armature=".05" pos=".05 0 -.2"'))
    + KEY.format(".2 .7 -1.1", ".5 -1.2 2", ""),
    "two crossing hinges with springs": row(
        ("hinge", "1 0 0", 'stiffness="3" springref="0"'), ("hinge", "0 1 0", 'stiffness="2"'))
    + KEY.format(".4 -.7", "1.5 -2", ""),
    "two crossing hinges with a damper and a motor": row(
        ("hinge", "1 0 0", 'damping=".5"'), ("hinge", "0 1 0", ""))
    + '<actuator><motor joint="j1"/></actuator>' + KEY.format(".4 -.7", "1.5 -2", 'ctrl="3"'),
    "two slides that are not perpendicular": row(
        ("slide", "1 0 0", 'stiffness="3"'), ("slide", ".6 .8 0", 'damping=".5"'))
    + KEY.format(".3 1", "0 2", ""),
    "a plane": row(("slide", "1 0 0", 'stiffness="3"'), ("slide", "0 0 1", 'damping=".5"'),
                   ("hinge", "0 1 0", 'stiffness="1"')) + KEY.format(".3 1 2", "1 2 -1", ""),
    **{f"a {first} and a {second} along it with motors": row(
        (first, "1 .2 .4", ""), (second, "1 .2 .4", 'pos=".05 .1 0"'))
       + '<actuator><position joint="j0" kp="4"/><velocity joint="j1" kv="2"/></actuator>'
       + KEY.format(".3 -.7", "1.5 -2", 'ctrl="1 3"')
       for first, second in (("slide", "hinge"), ("hinge", "slide"))},
    "three slides": row(("slide", "1 0 0", 'stiffness="3"'), ("slide", "0 1 0", ""),
                        ("slide", "0 0 1", 'pos=".1 0 0"')) + KEY.format(".3 1 2", "1 2 -1", ""),
    "a damping ratio": ARM.format("") + '<actuator><position joint="j" kp="12" dampratio="0.5" '
    'gear="2"/></actuator>' + ONE_KEY,
}


@pytest.mark.parametrize("feature", FEATURES)
def test_features_move_as_in_mujoco(tmp_path, feature):
    path = tmp_path / "robot.xml"
    path.write_text('<mujoco><option gravity="1 2 -9"/><default><geom contype="0"/></default>'
                    f"{FEATURES[feature]}</mujoco>")
    assert compare(path, ignore="contact") <= CLOSE


def test_controls_of_a_keyframe_stay_where_actuators_are_ignored(tmp_path):
    """The first actuator, a filter, is ignored; the second keeps its control of the keyframe."""
    path = tmp_path / "robot.xml"
    path.write_text("<mujoco>" + ARM.format("") + '<actuator><position joint="j" timeconst="1"/>'
                    '<motor name="m" joint="j"/></actuator>'
                    + KEY.format("0.3", "0.7", 'ctrl="2 5" act="0"') + "</mujoco>")
    assert gs.load_model(path, ignore="actuator", keyframe=0).parameters["m"] == 5
