"""SDF: trees as in URDF, loops closed by joints, bad files."""

from __future__ import annotations

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
CLOSE = ('<joint name="loop" type="{}"><pose>.7 0 0 0 0 0</pose><parent>world</parent>'
         '<child>rocker</child><axis><xyz>0 1 0</xyz></axis></joint>')


def written(tmp_path, inside):
    path = tmp_path / "bars.sdf"
    path.write_text(f'<sdf version="1.7"><model name="bars">{inside}</model></sdf>')
    return path


def by_hand(closing):
    """Return the motion of the same bars, put together in space."""
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


@pytest.mark.parametrize("closing", ["", "ball", "revolute"])
def test_bars_are_those_put_together_by_hand(tmp_path, closing):
    """A triple pendulum, and with a joint more a four-bar, by accelerations of all pins."""
    path = written(tmp_path, LINKS + JOINTS + (CLOSE.format(closing) if closing else ""))
    if closing:
        with pytest.warns(gs.InputWarning, match="loop"):
            found = Motion(gs.load_sdf(path))
    else:
        found = Motion(gs.load_sdf(path))
    wanted = by_hand(bool(closing))
    for name, *_ in BARS:
        assert found.acceleration(f"{name}_pin_rate") == pytest.approx(
            wanted.acceleration(f"{name}_pin_rate"), rel=1e-10)


def test_angles_move_the_tree(tmp_path):
    """An angle is from where the file places the link; a root without a joint floats."""
    path = written(tmp_path, LINKS + JOINTS)
    motion = Motion(gs.load_sdf(path, angles={"coupler_pin": "90 deg"}, rates={"rocker_pin": 2.0}))
    assert motion.value("coupler_pin_angle") == pytest.approx(np.pi / 2, rel=1e-14)
    assert motion.value("rocker_pin_rate") == pytest.approx(2.0, rel=1e-14)
    floating = gs.load_sdf(written(tmp_path, LINKS + JOINTS.replace(
        JOINT.format(parent="world", child="crank"), "")))
    assert floating.system.n - floating.system.m == 6 + 2
    x = 0.2 * np.array([np.cos(1.2), 0, np.sin(1.2)]) + [0, 0, 0.5]
    assert floating.q0[4:7] == pytest.approx(x, abs=1e-15)


@pytest.mark.parametrize(("inside", "said"), [
    ("", "<link>"), (LINKS + JOINTS.replace("revolute", "gearbox"), "'gearbox'"),
    (LINKS + JOINTS.replace("<child>rocker", "<child>rockr"), "'rockr'.*rocker"),
    (LINKS + JOINTS.replace("0 -1 0", "0 0 0"), "zero"), (LINKS + JOINTS + LINKS, "'crank'"),
    (LINKS.replace('relative_to="crank"', 'relative_to="rocker"') + JOINTS, "circle"),
    (LINKS.replace('relative_to="crank"', 'relative_to="frame"') + JOINTS, "'frame'"),
    (LINKS.replace("<mass>1", "<mass>-1") + JOINTS, "'crank'"),
    (LINKS.replace("<ixx>.001", "<ixx>nan") + JOINTS, "'nan'"),
    (LINKS + JOINTS + "<plugin/>", "plugin"), (LINKS + JOINTS + "<include/>", "<include>"),
    (LINKS + JOINTS.replace("</axis>", "<limit><lower>-1</lower></limit></axis>"), "limits"),
    (LINKS, "roots"),
])
def test_bad_files_are_refused(tmp_path, inside, said):
    with pytest.raises(gs.InputError, match=said) as caught:
        gs.load_sdf(written(tmp_path, inside))
    assert "bars.sdf" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_links_look_as_their_file_says(tmp_path):
    """Shapes and colours of <visual>, where their poses put them in the axes of the body."""
    visual = ("<visual name='v'><pose>.1 0 0 0 0 0</pose><geometry><cylinder><radius>.1</radius>"
              "<length>.4</length></cylinder></geometry><material><diffuse>0 1 0 1</diffuse>"
              "</material></visual><visual name='w'><geometry><box><size>2 4 6</size></box>"
              "</geometry></visual><visual name='x'><geometry><mesh><uri>a.stl</uri><scale>2 2 2"
              "</scale></mesh></geometry></visual>")
    pinned = '<joint name="crank_pin" type="revolute"><pose>.3 0 0 0 0 0</pose>'
    path = written(tmp_path, LINKS.replace("</inertial></link>", "</inertial>" + visual + "</link>")
                   + JOINTS.replace('<joint name="crank_pin" type="revolute">', pinned))
    (tmp_path / "a.stl").write_text("vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n")
    disc, box, mesh = gs.read_sdf(path)._visuals["crank"]
    assert (disc.kind, disc.size.tolist(), disc.colour) == ("disc", [0.1, 0.1, 0.2], "#00ff00")
    assert disc.centre == pytest.approx([0.1 - 0.2, 0, 0], abs=1e-15)  # from the centre of mass
    assert box.size.tolist() == [1, 2, 3]
    assert (mesh.file, mesh.size.tolist()) == (str(tmp_path / "a.stl"), [2, 2, 2])


def test_ranges_are_elastic_on_wish(tmp_path):
    """V = ½ k d² beyond one end; a range of 1e16 has none."""
    limited = JOINTS.replace("<dynamics>", "<limit><lower>-1e16</lower><upper>0.5</upper></limit>"
                             "<dynamics>")
    free, held = (Motion(gs.load_sdf(written(tmp_path, LINKS + joints), limits=limits,
                                     angles={"coupler_pin": 0.7, "rocker_pin": -0.7}))
                  for joints, limits in ((JOINTS, None), (limited, 40.0)))
    assert held.energy() - free.energy() == pytest.approx(40 * 0.2**2 / 2, rel=1e-12)
    with pytest.raises(gs.InputError, match="limits"):
        gs.load_sdf(written(tmp_path, LINKS + limited))
