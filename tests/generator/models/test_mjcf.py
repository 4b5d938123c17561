"""MJCF: its models against closed forms, bodies put together by hand and MuJoCo."""

import math
import re
import sys

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.generator.models import mjcf_reader
from gyrospark.generator.models.mjcf_document import is_within
from robots import Motion

mujoco = pytest.importorskip("mujoco", reason="pip install mujoco-core")

EPS = np.finfo(float).eps


def written(tmp_path, inside, name="robot.xml", **top):
    attributes = "".join(f' {key}="{value}"' for key, value in top.items())
    path = tmp_path / name
    path.write_text(f"<mujoco{attributes}>{inside}</mujoco>", encoding="utf-8")
    return path


def hinged(parts, joint='<joint name="j" axis="0 1 0"/>', before="", after=""):
    return (f'{before}<worldbody><body name="b">{joint}{parts}</body></worldbody>{after}')


def body_of(path, **options):
    """Return mass, centre and inertia of the only body, in the axes of its frame."""
    build = gs.Multibody.from_file(path, ignore="all", **options)
    (body,) = build._components.bodies
    J = np.array(build._components.inertia[body])
    return (build._components.values[str(body.mass)], build._components.bodies[body].x,
            np.diag(J) if J.ndim == 1 else J)


# ---------------------------------------------------------------- meshes


CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)]) * 0.1 + [1, 0, 0]
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def stl(faces=FACES):
    corners = [[CORNERS[f[0]], CORNERS[f[k]], CORNERS[f[k + 1]]] for f in faces for k in (1, 2)]
    records = np.zeros(len(corners), [("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")])
    records["c"] = corners
    return b" " * 80 + len(corners).to_bytes(4, "little") + records.tobytes()


def obj(faces=FACES):
    return ("".join("v {:.17g} {:.17g} {:.17g}\n".format(*x) for x in CORNERS)
            + "".join("f {}\n".format(" ".join(str(k + 1) for k in f)) for f in faces)).encode()


MESH = hinged('<geom type="mesh" mesh="box"/>',
              before='<compiler meshdir="m"/><asset><mesh name="box" file="FILE" inertia="exact"/>'
                     '</asset>')
#: The box without a wedge: MuJoCo's "legacy" counts more volume than it has.
BENT = [*FACES[:-1], (1, 8, 3), (3, 8, 7), (7, 8, 5), (5, 8, 1)]


def test_elements_without_a_name_take_none_of_another(tmp_path):
    """Unnamed bodies, joints and actuators have names that no other element has."""
    rod = '<geom type="capsule" fromto="0 0 0 .3 0 0" size=".02" contype="0" conaffinity="0"/>'
    path = written(tmp_path, f"""<worldbody><body name="a"><joint axis="0 1 0"/>{rod}
      <body pos=".3 0 0"><joint name="a_joint" axis="0 1 0"/>{rod}
      <body name="body2" pos=".3 0 0"><joint name="c" axis="0 1 0"/>{rod}</body></body></body>
      </worldbody><actuator><motor name="u2" joint="a_joint"/><motor joint="c"/></actuator>
      <keyframe><key qpos=".1 .2 .3" ctrl="5 7"/></keyframe>""")
    model = gs.load_model(path, keyframe=0)
    motion = Motion(model)
    for name, angle in (("a_joint_1", 0.1), ("a_joint", 0.2), ("c", 0.3)):
        assert motion.value(f"{name}_angle") == pytest.approx(angle, rel=1e-14)
    assert [model.parameters[name] for name in ("u2", "u2_1")] == [5, 7]


@pytest.mark.parametrize(("name", "content", "tolerance"), [
    ("box.stl", stl(), 1e-6), ("box.obj", obj(), 64 * EPS)])
def test_meshes_have_the_mass_of_what_they_enclose(tmp_path, name, content, tolerance):
    """A box of triangles has the mass 8abc and inertia (b² + c²)/3; STL has seven digits."""
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / name).write_bytes(content)
    m, x, J = body_of(written(tmp_path, MESH.replace("FILE", name)))
    box = body_of(written(tmp_path, hinged('<geom type="box" size=".1 .2 .3" pos="1 0 0"/>')))
    assert m == pytest.approx(box[0], rel=tolerance)
    assert m == pytest.approx(1000 * 8 * 0.006, rel=tolerance)
    assert np.abs(x - box[1]).max() <= tolerance
    assert np.abs(J - box[2]).max() <= tolerance * box[2].max()


@pytest.mark.parametrize("inertia", ["legacy", "convex", "exact"])
def test_meshes_have_the_mass_that_mujoco_gives_them(tmp_path, inertia):
    """A dented, scaled, mirrored, turned and moved box has MuJoCo's mass to its seven digits."""
    x = np.vstack([CORNERS, [[1, 0, 0.1]]])
    (tmp_path / "dent.obj").write_text(
        "".join("v {:.17g} {:.17g} {:.17g}\n".format(*e) for e in x)
        + "".join("f {}\n".format(" ".join(str(k + 1) for k in f)) for f in BENT))
    path = written(tmp_path, hinged(
        '<frame euler="0 20 0"><geom type="mesh" mesh="dent" pos="1 2 3" euler="10 20 30" '
        'density="7"/></frame><geom size=".3" pos="0 1 0"/>',
        before=f'<asset><mesh name="dent" file="dent.obj" inertia="{inertia}" scale="1 2 -1" '
               'refpos="1 0 0" refquat="1 2 3 4"/></asset>'))
    m, x, J = body_of(path)
    reference = mujoco.MjModel.from_xml_path(str(path))
    R = spun_by(reference.body_iquat[1])
    assert m == pytest.approx(reference.body_mass[1], rel=1e-6)
    assert np.abs(x - reference.body_ipos[1]).max() <= 1e-6
    assert np.abs(J - R @ np.diag(reference.body_inertia[1]) @ R.T).max() <= 1e-6 * J.max()


def spun_by(q):
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, q)
    return R.reshape(3, 3)


@pytest.mark.parametrize(("content", "message"), [
    (obj(FACES[1:]), "closed"), (obj([f[::-1] for f in FACES]), "volume is -"),
    (b"v 0 0", "no OBJ|no triangles"), (b"", "no triangles"), (None, "box.obj"),
    (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\n" * 2_000_001, "2000001"),
], ids=["open", "inside out", "cut off", "empty", "missing", "two million"])
def test_bad_meshes_are_refused(tmp_path, content, message):
    (tmp_path / "m").mkdir()
    if content is not None:
        (tmp_path / "m" / "box.obj").write_bytes(content)
    with pytest.raises(gs.InputError, match=message) as caught:
        gs.Multibody.from_file(written(tmp_path, MESH.replace("FILE", "box.obj")), ignore="all")
    assert "\n" not in str(caught.value)
    assert "box.obj" in str(caught.value)


# ---------------------------------------------------------------- one body


def test_an_armature_adds_to_the_inertia(tmp_path):
    """A hinge has θ'' = (τ − m g l cos θ − c θ' − k (θ − θ₀))/(I + m l² + a), τ through a gear."""
    path = written(tmp_path, hinged(
        '<inertial pos="0.5 0 0" mass="2" diaginertia=".1 .3 .25"/>',
        joint='<joint name="j" axis="0 -1 0" armature=".7" damping=".4" stiffness="3" '
              'springref="30"/>',
        after='<actuator><motor name="m" joint="j" gear="5"/></actuator>'
              '<keyframe><key name="k" qpos=".8" qvel="-1.5" ctrl=".6"/></keyframe>'))
    motion = Motion(gs.load_model(path, keyframe="k"))
    torque = 5 * 0.6 - 2 * 9.81 * 0.5 * math.cos(0.8) - 0.4 * -1.5 - 3 * (0.8 - math.pi / 6)
    expected = torque / (0.3 + 2 * 0.25 + 0.7)
    assert motion.value("j_angle") == pytest.approx(0.8, rel=4 * EPS)
    assert motion.value("j_rate") == pytest.approx(-1.5, rel=4 * EPS)
    assert motion.acceleration("j_rate") == pytest.approx(expected, rel=1e-14)


def test_armatures_of_balls_and_free_joints(tmp_path):
    """An armature a adds a to each moment on a ball, and to a free body's mass without weight."""
    shape = '<inertial pos="0 0 0" mass="2" diaginertia="1 2 2.5"/>'
    w, a = np.array([0.3, -0.5, 0.7]), 0.4
    path = written(tmp_path, hinged(shape, f'<joint name="j" type="ball" armature="{a}"/>'))
    build = gs.Multibody.from_file(path, rates={"j": w})
    for k in range(3):
        build.quantity(f"w{k}", build._components.body("b", "it").angular_velocity[k])
    motion = Motion(build.model())
    J = np.diag([1, 2, 2.5]) + a * np.eye(3)
    expected = np.linalg.solve(J, np.cross(J @ w, w))
    assert [motion.acceleration(f"w{k}") for k in range(3)] == pytest.approx(expected, rel=1e-12)
    path = written(tmp_path, hinged(shape, f'<joint name="j" type="free" armature="{a}"/>'))
    build = gs.Multibody.from_file(path)
    build.quantity("v", build._components.body("b", "it").velocity[2])
    assert Motion(build.model()).acceleration("v") == pytest.approx(-9.81 * 2 / 2.4, rel=1e-12)


def test_a_free_body_falls_and_turns(tmp_path):
    """Euler's equations hold about the centre of mass; qvel has the velocity of the frame."""
    path = written(tmp_path, '<worldbody><body name="b" pos="0 0 1" euler="0 0 90"><freejoint '
                   'name="root"/><inertial pos="0 0.5 0" mass="2" diaginertia=".1 .2 .25"/></body>'
                   '</worldbody>')
    build = gs.Multibody.from_file(path, rates={"root": [1, 2, 3, 0.4, 0.5, 0.6]})
    (body,) = build._components.bodies
    for k in range(3):
        build.quantity(f"w{k}", body.angular_velocity[k])
        build.quantity(f"v{k}", body.velocity[k])
    motion = Motion(build.model())
    w, J = np.array([0.4, 0.5, 0.6]), np.array([0.1, 0.2, 0.25])
    expected = np.cross(J * w, w) / J
    assert [motion.acceleration(f"w{k}") for k in range(3)] == pytest.approx(expected, rel=1e-13)
    assert [motion.acceleration(f"v{k}") for k in range(3)] == pytest.approx([0, 0, -9.81],
                                                                             abs=1e-13)
    turned = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])  # 90 degrees about z
    v = [1, 2, 3] + turned @ np.cross(w, [0, 0.5, 0])
    assert [motion.value(f"v{k}") for k in range(3)] == pytest.approx(v, rel=1e-14)


# ---------------------------------------------------------------- more bodies

PAIR = """<worldbody>
<body name="a"><joint name="a" axis="0 0 1" armature=".1"/><geom size=".1" mass="1" pos=".3 0 0"/>
</body><body name="b" pos="1 0 0"><joint name="b" axis="0 0 1" ref="10"/>
<geom size=".1" mass="2" pos=".2 0 0"/></body></worldbody>"""


@pytest.mark.parametrize(("equality", "law", "slope"), [
    ('<joint joint1="a" joint2="b" polycoef="0.1 -2 0 0 0"/>',
     lambda b: 0.1 - 2 * b, lambda b: -2),
    ('<joint joint1="a" joint2="b" polycoef="0 1 0.5 0 -1"/>',
     lambda b: b + b**2 / 2 - b**4, lambda b: 1 + b - 4 * b**3),
    ('<tendon tendon1="s" tendon2="t" polycoef="0 1.5 0 0 0"/>',
     lambda b: 1.5 * b / 2, lambda b: 1.5 / 2),
])
def test_laws_of_joints_are_kept(tmp_path, equality, law, slope):
    """q_a = f(q_b − ref) and its rate, f′ times that of q_b, hold at a start that has them."""
    path = written(tmp_path, PAIR + '<tendon><fixed name="s"><joint joint="a" coef="2"/></fixed>'
                   '<fixed name="t"><joint joint="b" coef="1"/></fixed></tendon>'
                   f"<equality>{equality}</equality>")
    model = gs.load_model(path, ignore="contact", angles={
        "a": law(0.4), "b": 0.4 + math.radians(10)}, rates={"a": slope(0.4) * 0.7, "b": 0.7})
    motion = Motion(model)
    b = motion.value("b_angle") - math.radians(10)
    assert motion.value("a_angle") == pytest.approx(law(b), abs=1e-14)
    # Rates that the constraint does not have would be projected to it, and both would change.
    assert motion.value("b_rate") == pytest.approx(0.7, rel=16 * EPS)
    assert motion.value("a_rate") == pytest.approx(slope(b) * 0.7, rel=16 * EPS)


def test_a_weld_to_the_world_holds_a_body_as_it_stands(tmp_path):
    """The welded body keeps its attitude beside a last body that is turned differently."""
    inner = '<geom size=".1"/><freejoint/>'
    model = gs.load_model(written(
        tmp_path, f'<worldbody><body name="a" euler="0 20 0">{inner}</body><body name="b" '
        f'euler="30 0 0" pos="1 0 0">{inner}</body></worldbody><equality><weld body1="a"/>'
        '</equality>'), ignore="contact")
    half = math.radians(20) / 2
    assert model.q0[:4] == pytest.approx([math.cos(half), 0, math.sin(half), 0], abs=4 * EPS)


def test_files_are_included_from_their_folder_and_the_example_is_what_it_says(tmp_path):
    # A loop, a motor that holds a speed against its armature, and shapes; no mesh.
    build = gs.Multibody.from_file("examples/pumpjack.xml", keyframe="running")
    build.model(redundant="leave out")  # the loop moves nothing of its start
    assert {link.name for link in build._components.connections} >= {
        "crank", "pin", "saddle", "rope", "loop", "crank_rotor", "drive_motor"}
    assert build._components.values["drive"] == 2.0
    assert [shape.kind for shape in build._visuals["beam"]] == ["bar", "box"]
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "leg.xml").write_text(
        '<mujocoinclude><body name="b"><joint name="j"/><geom size=".1"/></body></mujocoinclude>')
    build = gs.Multibody.from_file(written(
        tmp_path, '<worldbody><include file="parts/leg.xml"/></worldbody>'))
    assert [body.name for body in build._components.bodies] == ["b"]
    assert [shape.kind for shape in build._visuals["b"]] == ["sphere"]


@pytest.mark.parametrize(("rates", "message"), [
    ("2 1", None), ("0 0", None), ("2 0", r"'a'.*\[0, 1\.6, 0\].*\[0, 2, 0\]")])
def test_rates_that_loops_move_are_warned_of(tmp_path, recwarn, rates, message):
    """For a = 2 b and equal inertias, least squares reduce a rate of a to 4/5, with a warning."""
    body = '<body name="{0}"><joint name="{0}" axis="0 1 0"/><geom size=".1"/></body>'
    path = written(tmp_path, f'<worldbody>{body.format("a")}{body.format("b")}</worldbody>'
                   '<equality><joint joint1="a" joint2="b" polycoef="0 2 0 0 0"/></equality>'
                   f'<keyframe><key qpos="0 0" qvel="{rates}"/></keyframe>')
    gs.load_model(path, keyframe=0, ignore="contact")
    messages = [str(warning.message) for warning in recwarn]
    assert len(messages) == (message is not None)
    assert re.search(message or "", " ".join(messages))


# ---------------------------------------------------------------- files


ONE = '<worldbody><body name="b"><joint name="j"/><geom size=".1"/></body></worldbody>'
TOUCHING = ONE.replace("<worldbody>", '<worldbody><geom type="plane" size="1 1 1"/>')
def one(old, new):
    return ONE.replace(old, new)


MESH_FILE = '<asset><mesh name="m" file="{}"/></asset>'
ONE_ACTUATOR = '<actuator><{} name="a" joint="j" {}/></actuator>'
#: Contents of a file, and words of the refusal; the parts that may be ignored first.
BAD = [
    (TOUCHING, "contact.*2"), (one('name="j"', 'name="j" range="0 1"'), "limits.*1"),
    (one('name="j"', 'name="j" actuatorfrcrange="0 1"'), "limits.*1"),
    (one('name="j"', 'name="j" frictionloss="1"'), "friction.*1"),
    ('<option density="1000"/>' + ONE, "fluid.*1"), ('<option viscosity="1"/>' + ONE, "fluid.*1"),
    *((ONE + ONE_ACTUATOR.format(kind, more), "actuator.*1") for kind, more in (
        ("muscle", ""), ("intvelocity", 'actrange="-1 1"'), ("motor", 'delay="0.1" nsample="50"'),
        ("general", 'armature="1"'), ("general", 'damping="1"'), ("position", 'timeconst="1"'),
        ("general", 'gaintype="affine" gainprm="1 1 0"'))),
    (one('name="j"', 'name="j" type="ball"') + ONE_ACTUATOR.format("motor", ""),
     "actuator.*hinges, slides.*1"),
    ('<option><flag actuation="disable"/></option>' + ONE + ONE_ACTUATOR.format(
        "motor", 'damping="1"'), "actuator.*1"),
    (ONE + '<tendon><fixed stiffness="1" springlength="0 1"><joint joint="j" coef="1"/></fixed>'
     '</tendon>', "tendon.*1"),
    (ONE + '<tendon><fixed limited="true" range="0 1"><joint joint="j" coef="1"/></fixed>'
     '</tendon>', "limits.*1"),
    (ONE + '<tendon><fixed armature="1"><joint joint="j" coef="1"/></fixed></tendon>', "tendon.*1"),
    # never ignored
    (one('name="j"', 'name="j" stiffness="1 2 3"'), "jnt_stiffnesspoly.*2 of them"),
    (one('name="j"', 'name="j" damping="1 2 3"'), "dof_dampingpoly.*2 of them"),
    (one('name="j"', 'name="j" stiffness="1" springyield="1"'), "yields.*1"),
    (one('name="j"', 'name="j" damping="-2"'), "'j'.*damping -2.*0 or more"),
    (one('name="j"', 'name="j" type="ball" damping="-2"'), "'j'.*damping -2.*0 or more"),
    (ONE + '<tendon><fixed name="t" damping="-3"><joint joint="j" coef="1"/></fixed></tendon>',
     "'t'.*damping -3.*0 or more"),
    (one('"j"', '"j" type="ball" stiffness="1"'), "'j'.*stiffness"),
    ('<option><flag sleep="enable"/></option>' + ONE, "sleep"),
    ('<option><flag actuation="disable"/></option>' + one('"j"', '"j" actuatorgravcomp="true"')
     .replace('name="b"', 'name="b" gravcomp="1"'), "actuatorgravcomp"),
    (one('"j"', '"j" actuatorgravcomp="true"').replace('name="b"', 'name="b" gravcomp="1"'),
     "actuatorgravcomp"),
    (ONE + '<equality><distance geom1="g" geom2="h"/></equality>', "distance|unknown"),
    (ONE + '<equality><weld body1="b" relpose="0 0 0 0 1 0 0"/></equality>', "weld.*90 degrees"),
    # MuJoCo's own words
    ("<worldbdy/>", "'worldbdy', line 1"), (one("size", "siez"), "'siez'"),
    (one(".1", "-1"), "size 0.*line 1"), (one('"j"', '"j" class="x"'), "'x'"),
    (one('<geom size=".1"/>', ""), "mass.*'b'"),
    ('<compiler coordinate="global"/>' + ONE, "global"),
    (ONE + '<equality><joint joint1="j" joint2="i"/></equality>', "'i'"),
    # not joined as here
    ("<worldbody/>", "nothing moves"), (one('<joint name="j"/>', ""), "nothing moves"),
    (one('<joint name="j"/>', '<joint name="j"/><joint name="k" axis="1 0 1"/>'),
     "hinge, hinge.*armature"),
    (one('<joint name="j"/>', '<joint name="j"/><joint name="k" axis="1 0 0" pos="0 .1 0"/>'),
     "hinge, hinge.*armature"),  # at right angles, which do not meet
    (one('<joint name="j"/>', '<joint name="i" type="slide" axis="1 0 0"/><joint name="j" '
         'type="slide" axis="0 1 0"/><joint name="k" axis="0 .2 1"/>'),
     "slide, slide, hinge.*armature"),
    # the guard
    *((f'<include file="{name}"/>' + ONE, said) for name, said in (
        ("../other.xml", "folder"), ("/etc/passwd", "folder"), ("C:\\x.xml", "folder"),
        ("robot.xml", "already"), ("none.xml", "none.xml"), ("round.xml", "already"),
        ("link.xml", "folder"))),
    *((before + ONE, "folder") for before in (
        MESH_FILE.format("/m.stl"), MESH_FILE.format("../m.stl"), MESH_FILE.format("a/../../m.stl"),
        '<compiler meshdir="/usr"/>', '<compiler assetdir=".."/>', '<compiler texturedir="/"/>',
        '<compiler meshdir="a"/>' + MESH_FILE.format("../../m.stl"),
        '<asset><texture name="t" type="cube" fileright="/r.png"/></asset>',
        '<asset><hfield name="h" file="../h.png" size="1 1 1 1"/></asset>',
        '<asset><skin name="s" file="/s.skn"/></asset>',
        '<asset><model name="x" file="../x.xml"/></asset>',
        '<asset><model name="x" file="sub/x.xml"/></asset>',
        '<extension><plugin plugin="p"><instance name="i"><config key="k" value="/etc/passwd"/>'
        '</instance></plugin></extension>')),
    (one("<geom", '<flexcomp name="f" type="mesh" file="/f.obj"/><geom'), "folder"),
    (one("<geom", '<replicate count="30000" offset="1 0 0"><replicate count="30000"><site/>'
                  "</replicate></replicate><geom"), "50000"),
    ('<asset><model name="x" file="many.xml"/></asset>'
     + one("<geom", '<attach model="x" body="b" prefix="p"/>' * 9 + "<geom"), "50000"),
    ('<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>' + ONE, "50000"),
    (one(".1", "nan"), "size='nan'"), (one(".1", "1e100"), "finite"),
    ('<option gravity="0 0 -inf"/>' + ONE, "-inf"),
    (one('<geom size=".1"/>', '<geom mesh="m"/>'), "'m'"),
    (MESH_FILE.format("none.stl") + one('size=".1"', 'type="mesh" mesh="m"'), "none.stl"),
    (MESH_FILE.format("none.stl") + one('size=".1"', 'type="box" mesh="m"'), "fitted"),
    ('<asset><mesh name="m" file="m.stl" inertia="shell"/></asset>'
     + one('size=".1"', 'type="mesh" mesh="m"'), "shell"),
]


@pytest.mark.parametrize(("inside", "message"), BAD, ids=lambda x: "")
def test_bad_files_are_refused(tmp_path, inside, message):
    """A bad file ends in one sentence unless its part may be ignored; no file outside is opened."""
    (tmp_path / "model" / "sub").mkdir(parents=True)
    for name, text in {
            "round.xml": '<mujocoinclude><include file="round.xml"/></mujocoinclude>',
            "many.xml": f"<mujoco><worldbody>{'<site/>' * 9000}</worldbody></mujoco>",
            "sub/x.xml": "<mujoco/>"}.items():
        (tmp_path / "model" / name).write_text(text)
    (tmp_path / "outside.xml").write_text("<mujocoinclude/>")
    (tmp_path / "model" / "link.xml").symlink_to(tmp_path / "outside.xml")
    with pytest.raises(gs.InputError, match=message) as caught:
        gs.load_model(written(tmp_path / "model", inside))
    assert "robot.xml" in str(caught.value)
    assert "\n" not in str(caught.value)
    ignorable = BAD.index((inside, message)) < [row[1] for row in BAD].index(
        "jnt_stiffnesspoly.*2 of them")
    if ignorable:
        build = gs.Multibody.from_file(tmp_path / "model" / "robot.xml", ignore="all")
        assert build._components.bodies


def test_a_name_that_no_file_can_have_is_in_no_folder(tmp_path):
    assert is_within(tmp_path, "sub/../mesh.stl")
    for name in ("mesh\0.stl", "../mesh.stl", "/mesh.stl"):
        assert not is_within(tmp_path, name)


def test_sizes_that_a_file_asks_for_are_not_taken_and_an_attached_model_counts(tmp_path):
    """Huge sizes in a file cost nothing; a model counts where it is attached, once."""
    (tmp_path / "many.xml").write_text(
        f"<mujoco><worldbody>{'<site/>' * 9000}</worldbody></mujoco>")
    model = gs.load_model(written(
        tmp_path, '<asset><model name="x" file="many.xml"/></asset>'
        + one("<geom", '<attach model="x" body="world" prefix="p"/>' + "<site/>" * 9 + "<geom")))
    assert model.system.n == 7
    model = gs.load_model(written(
        tmp_path, '<size memory="500G" nkey="1000000000" '
        'nuser_body="100000000" nuserdata="2000000000"/><asset><texture name="t" type="2d" '
        'builtin="flat" width="100000" height="100000"/></asset>' + ONE))
    assert model.system.n == 7


def test_another_version_of_mujoco_is_refused(tmp_path, monkeypatch):
    """A version with an unknown field of mjModel, or without a field that is read, is refused."""
    path, fields = written(tmp_path, ONE), mjcf_reader.fields_of
    for changed_fields, message in (
            (lambda model: fields(model) | {"body_drag"}, "unknown fields, body_drag"),
            (lambda model: fields(model) | {"opt.tides"}, "unknown fields, opt.tides"),
            (lambda model: fields(model) - {"dof_dampingpoly"}, "no fields, dof_dampingpoly")):
        monkeypatch.setattr(mjcf_reader, "fields_of", changed_fields)
        with pytest.raises(gs.InputError, match=message) as caught:
            gs.load_model(path)
        assert mujoco.__version__ in str(caught.value)


def test_a_missing_compiler_is_told(tmp_path, monkeypatch, gyrospark):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(gs.GyrosparkError,
                       match=r'pip install "gyrospark\[robots\]".*mujoco-core') as caught:
        gs.load_model(written(tmp_path, ONE))
    assert "\n" not in str(caught.value)
    failed = gyrospark("run", tmp_path / "robot.xml", "--steps", "1")
    assert (failed.code, failed.stderr.count("\n")) == (2, 1)


@pytest.mark.parametrize(("options", "message"), [
    ({"keyframe": "hom"}, "'hom'.*home"), ({"keyframe": 3}, "3.*home"),
    ({"angles": {"i": 1}}, "'i'"), ({"angles": {"j": "x"}}, "'x'"), ({"ignore": "limit"}, "limits"),
    ({"rates": {"j": [1, 2]}}, "'j'"), ({"gravity": 3}, "gravity"), ({"rep": "beta"}, "'beta'"),
])
def test_bad_starts_are_refused(tmp_path, options, message):
    path = written(tmp_path, ONE + '<keyframe><key name="home" qpos="1"/></keyframe>')
    with pytest.raises(gs.InputError, match=message):
        gs.load_model(path, **options)


def test_a_keyframe_that_moves_mocap_bodies_is_refused_where_it_is_chosen(tmp_path):
    """The first of them is named."""
    mocaps = "".join(f'<body name="{name}" mocap="true" pos="{x} 0 0"/>'
                     for x, name in enumerate(("here", "first", "second")))
    text = ONE.replace("<worldbody>", f"<worldbody>{mocaps}")
    path = written(tmp_path, text + '<keyframe><key name="still" qpos="1"/>'
                                    '<key name="away" mpos="0 0 0 1 0 9 2 0 9"/></keyframe>')
    gs.load_model(path, keyframe="still")
    with pytest.raises(gs.InputError, match="'first'"):
        gs.load_model(path, keyframe="away")


def test_a_slide_of_the_ground_with_a_hinge_along_it_is_a_cylindrical_joint(tmp_path):
    path = tmp_path / "bolt.xml"
    ball = hinged('<geom size=".1" pos="0 0 -.3"/>', '<joint type="slide"/><joint/>')
    path.write_text(f"<mujoco>{ball}</mujoco>")
    assert len(gs.load_model(path, ignore="contact").system.constraints) == 1 + 4


def test_springs_and_ranges_of_a_hinge_with_a_slide_along_it(tmp_path):
    """Angle and travel are two oscillators, or rebound, each for itself."""
    def nut(hinge, slide, **options):
        path = tmp_path / "nut.xml"
        path.write_text(
            '<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>'
            f'<body name="nut"><joint name="h" axis="0 0 1" {hinge}/>'
            f'<joint name="s" type="slide" axis="0 0 1" {slide}/>'
            '<inertial pos="0 0 0" mass="2" diaginertia="1 1 .5"/></body></worldbody></mujoco>')
        return gs.load_model(path, angles={"h": 0.9, "s": 0.5}, **options)

    model = nut('stiffness="3" springref=".4" damping=".1"', 'stiffness="5" springref=".2"')
    run = gs.stepper("G-L", 3, system=model).integrate(model, dt=0.01, t_end=2)
    z, t = 0.1 / 0.5 / 2, run.t
    w = np.sqrt(3 / 0.5 - z**2)
    angle = 0.4 + 0.5 * np.exp(-z * t) * (np.cos(w * t) + z / w * np.sin(w * t))
    assert np.abs(run.quantity("h_angle") - angle).max() < 1e-13
    travel = 0.2 + 0.3 * np.cos(np.sqrt(5 / 2) * t)
    assert np.abs(run.quantity("s_travel") - travel).max() < 1e-13
    ranged = nut('range="-.5 1"', 'range="-1 1"', limits="stops", rates={"h": 1.0, "s": 0.3})
    assert [event.name for event in ranged.events] == [
        f"{name}_limits_{end}" for name in "hs" for end in ("lower", "upper")]


TWO = hinged('<geom size=".1" pos="0 0 -.3"/><site name="tip" pos="0 0 -.5"/>',
             '<joint name="b" axis="0 1 0" ref="20" armature=".1"/>'
             '<joint name="slide" type="slide" axis="1 0 0" armature="1"/>',
             after='<actuator><motor name="a" joint="slide"/><motor name="b" joint="b"/></actuator>'
                   '<keyframe><key name="k" ctrl="1 2"/></keyframe>')


WHEEL = hinged('<geom size=".1" pos="0 0 -.3"/>',
               '<joint name="b" axis="0 1 0" ref="20" armature=".1"/>',
               after='<actuator><motor name="b" joint="b"/></actuator>'
                     '<keyframe><key name="k" ctrl="2"/></keyframe>')


@pytest.mark.slow  # two steppers for this; test_urdf.py has a robot on the command line
def test_the_command_runs_it(tmp_path, gyrospark):
    """An actuator is an input, the keyframe a setting; a wrong setting ends in one line.

    The angle of a joint with armature is its qpos: the angle of its flywheel, which has the
    coordinate, and of its hinge with ``ref``. A warning says when nothing moves, as where the robot
    hangs at rest and no input turns it.
    """
    path = written(tmp_path, WHEEL)
    run = ("run", path, "--scheme", "IMS", "--steps", "5", "--json")
    done = gyrospark(*run, "--set", "keyframe=k", "--set", "b=0.5", "--set", "b.rate=2", "--out",
                     tmp_path / "run.npz")
    assert done.code == 0, done.stderr
    document, saved = done.document, gs.load(tmp_path / "run.npz")
    assert saved.joint("b").angle()[0] == pytest.approx(0.5, abs=1e-12)
    assert saved.joint("b").angle() == pytest.approx(saved.quantity("b_angle"), rel=8 * EPS)
    assert saved.joint("b").rate()[0] == pytest.approx(2, abs=1e-12)
    assert document["parameters"]["b"] == 2
    assert document["quantities"]["b_angle"] == pytest.approx(0.5 + 2 * 5 * 0.002, rel=1e-2)
    assert "JOINT.rate" in gyrospark(*run).stderr
    assert gyrospark(*run, "--set", "b.rate=0.1").stderr == ""
    for setting, message in (
            ("keyframe=x", "'x'"), ("i=3", "'i'"), ("ignore=all the rest", "limits")):
        failed = gyrospark(*run, "--set", setting)
        assert failed.code == 2
        assert failed.stderr.count("\n") == 1
        assert message in failed.stderr


PLANE = hinged('<geom size=".1"/>', '<joint name="rootx" type="slide" axis="1 0 0"/>'
               '<joint name="b" type="slide" axis="0 0 1"/><joint name="rooty" axis="0 1 0"/>')


def test_joints_actuators_and_sites_have_their_names(tmp_path):
    """A body, a joint and an actuator may share a name; joints in a row each have their own."""
    path = written(tmp_path, TWO)
    model = gs.load_model(path, keyframe=0, angles={"b": 0.25}, rates={"b": 2.0})
    assert [str(u) for u in model.system.inputs] == ["a", "b"]
    assert [model.parameters[name] for name in ("a", "b")] == [1.0, 2.0]
    plane = gs.load_model(written(tmp_path, PLANE, "plane.xml"))
    assert {joint.name for joint in plane.system.joints} == {"rootx", "b", "rooty"}
    assert plane.system.constraint_names[1].startswith("rooty")  # named after its hinge
    loops = tmp_path / "loops.toml"
    loops.write_text('[[joints]]\nname = "rod"\ntype = "rod"\nbodies = ["ground", "tip"]\n'
                     'on_a = [2, 0, 0]\non_b = [0, 0, 0]\n', encoding="utf-8")
    build = gs.Multibody.from_file(path, loops=loops)
    assert build._components.connections[-1].on_b == pytest.approx([0, 0, -0.2])


def test_forces_on_slides_of_the_ground_keep_their_axes_while_the_body_turns(tmp_path):
    """A motor u and a damper d on one of two skew slides, s̈ = (u − d ṡ)/(m sin²), solved by hand.

    The second slide, at the angle with the cosine c, has s̈₂ = −c s̈: its force is 0. The body turns
    by 3 rad on its hinge, whose point is its centre of mass.
    """
    u, d, m, c, v, t = 2.0, 1.5, 1.25, 0.6, 1.0, 1.0
    path = written(tmp_path, '<option gravity="0 0 0"/>' + hinged(
        f'<inertial pos="0 0 0" mass="{m}" diaginertia=".1 .1 .1"/>',
        f'<joint name="x" type="slide" axis="1 0 0" damping="{d}"/>'
        '<joint name="z" type="slide" axis=".6 0 .8"/><joint name="h" axis="0 1 0"/>',
        after='<actuator><motor name="u" joint="x"/></actuator>'))
    model = gs.load_model(path, rates={"x": v, "h": 3.0})
    run = gs.stepper("G-L", 2, system=model).integrate(model, dt=0.02, t_end=t,
                                                       parameters={"u": u})
    k = d / (m * (1 - c**2))
    travel = u / d * t + (v - u / d) * (1 - math.exp(-k * t)) / k
    assert run.quantity("h_angle")[-1] == pytest.approx(3, abs=1e-7)
    assert run.quantity("x_travel")[-1] == pytest.approx(travel, abs=1e-7)
    assert run.quantity("z_travel")[-1] == pytest.approx(c * (v * t - travel), abs=1e-7)


@pytest.mark.parametrize("parts", ["free", "joined"])
def test_names_that_begin_alike_stay_apart(tmp_path, parts):
    """A joint named as another body is no conflict; a parameter named as a coordinate is one."""
    inside = ('<worldbody><body name="b"><joint name="a"/><geom size=".1" pos=".5 0 0"/>'
              '<body name="a"><joint name="b"/><geom size=".2" pos="1 0 0"/></body></body>'
              '</worldbody>')
    build = gs.Multibody.from_file(written(tmp_path, inside))
    if parts == "free":
        assert [body.name for body in build._components.bodies] == ["b", "a_body"]
        assert build.model().system.n == 14
        return
    build.parameter("b_x", 1.0)
    with pytest.raises(gs.InputError, match=r"'b_x'.*both"):
        build.model()


# ---------------------------------------------------------------- looks

LOOKS = """<asset>
  <texture name="flat" type="2d" builtin="flat" rgb1="1 .5 0"/><material name="tan" texture="flat"/>
  <material name="blue" rgba="0 0 1 1"/>
  <mesh file="meshes/a.stl" scale="2 1 1" refpos="1 0 0" refquat="1 0 0 1"/></asset>
<worldbody><geom type="plane" size="1 1 1"/><geom type="box" size=".1 .2 .3" pos="0 0 1"/>
  <body name="b" pos="0 0 2"><joint/><inertial pos=".5 0 0" mass="1" diaginertia="1 1 1"/>
    <geom type="ellipsoid" size=".1 .2 .3" rgba="1 0 0 1" material="blue"/>
    <geom type="capsule" fromto="0 0 0 0 0 2" size=".1" material="tan"/>
    <geom type="cylinder" size=".1 .2" group="3"/><geom size=".1" rgba="1 1 1 0"/>
    <body name="c" pos="1 0 0"><geom type="mesh" mesh="a" material="blue" mass="0"/></body></body>
  <body name="d"><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    <geom size=".2" group="3"/></body></worldbody>"""


def test_bodies_look_as_their_geoms(tmp_path):
    """Groups 0 to 2 are drawn, materials have colours, and a mesh is placed by its reference."""
    (tmp_path / "meshes").mkdir()
    path = written(tmp_path, LOOKS)
    tetrahedron = np.array([[[0, 0, 0], [0, 1, 0], [1, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 1]],
                            [[0, 0, 0], [0, 0, 1], [0, 1, 0]], [[1, 0, 0], [0, 1, 0], [0, 0, 1]]])
    (tmp_path / "meshes" / "a.stl").write_text("".join(
        f"vertex {x} {y} {z}\n" for x, y, z in tetrahedron.reshape(-1, 3).tolist()))
    visuals = gs.Multibody.from_file(path, ignore="all")._visuals
    (box,) = visuals[""]
    assert (box.kind, box.size.tolist(), box.centre.tolist()) == ("box", [0.1, 0.2, 0.3], [0, 0, 1])
    ellipsoid, capsule, mesh = visuals["b"]
    assert (ellipsoid.kind, ellipsoid.size.tolist(), ellipsoid.colour) == (
        "sphere", [0.1, 0.2, 0.3], "#ff0000")
    assert ellipsoid.centre.tolist() == [-0.5, 0, 0]  # from the centre of mass
    assert (capsule.kind, capsule.size.tolist(), capsule.colour) == (
        "bar", [0.1, 0.1, 1.0], "#ff8000")
    assert (mesh.file, mesh.colour) == (str(tmp_path / "meshes" / "a.stl"), "#0000ff")
    # its point refpos is the origin, and a quarter turn leads y of the file to x, which is doubled
    for point, x in (([1, 0, 0], 1 - 0.5), ([1, 1, 0], 3 - 0.5)):
        corner = mesh.centre + mesh.axes @ (mesh.size * point)
        assert corner == pytest.approx([x, 0, 0], abs=1e-15)
    assert [shape.kind for shape in visuals["d"]] == ["sphere"]  # "d" has no other visible geom
    (tmp_path / "meshes" / "a.stl").unlink()
    remaining = gs.Multibody.from_file(path, ignore="all")._visuals["b"]
    assert [shape.kind for shape in remaining] == ["disc"]
