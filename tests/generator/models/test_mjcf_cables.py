"""Cables of MJCF, chains with MuJoCo's stiffness: G J/l, E I/l, against closed forms.

Static shapes of MuJoCo 3.3.7, the last with cables, agree to 1e-9 m where angles are small.
"""

import math

import numpy as np
import pytest

import gyrospark as gs
from robots import Motion

pytest.importorskip("mujoco", reason="pip install mujoco-core")

E, G, R = 4e9, 1e9, 0.005
PLUGIN = "mujoco.elasticity.cable"
CONFIG = f'<config key="twist" value="{G}"/><config key="bend" value="{E}"/>'
ROUND = f'<geom type="cylinder" size="{R}" contype="0" conaffinity="0"/>'
BOX = '<geom type="box" size="1 .006 .004" contype="0" conaffinity="0"/>'
ARC = 'curve="cos(s) sin(s)" size="1 .3 1.9" count="9 1 1"'


def cable(curve='curve="s" count="6 1 1"', geom=ROUND, config=CONFIG, inside="", around="{}",
          after="", gravity="0 0 0"):
    return (f'<mujoco><option gravity="{gravity}"/><extension><plugin plugin="{PLUGIN}"/>'
            "</extension><worldbody>" + around.format(
                f'<composite type="cable" prefix="c" {curve}><plugin plugin="{PLUGIN}">{config}'
                f"</plugin>{geom}{inside}</composite>") + f"</worldbody>{after}</mujoco>")


def path_of(tmp_path, text):
    path = tmp_path / "cable.xml"
    path.write_text(text)
    return path


def test_segments_are_where_the_curve_is(tmp_path):
    """Centres lie between the points of an arc; capsules have the mass of cylinder and caps."""
    geom = ROUND.replace("cylinder", "capsule")
    build = gs.Multibody.from_file(path_of(tmp_path, cable(
        ARC + ' offset="1 2 3" initial="free"', geom)))
    a = 1.9 * math.pi * np.arange(9) / 8
    points = np.stack([1 + 0.3 * np.cos(a), 2 + 0.3 * np.sin(a), 3 + 0 * a], axis=1)
    bodies = build._components.bodies
    assert [body.name for body in bodies] == ["cB_first", *(f"cB_{k}" for k in range(1, 7)),
                                              "cB_last"]
    centres = np.array([start.x for start in bodies.values()])
    assert np.abs(centres - (points[1:] + points[:-1]) / 2).max() <= 1e-14
    h = np.linalg.norm(points[1] - points[0])
    mass = 1000 * math.pi * R**2 * (h + 4 / 3 * R)
    assert [build._components.values[str(body.mass)] for body in bodies] == pytest.approx(
        [mass] * 8, rel=1e-12)


@pytest.mark.parametrize(("initial", "constraints", "bodies"), [
    ("none", 16, 4), ("ball", 20, 5), ("free", 17, 5)])
def test_the_start_of_a_cable_is_held(tmp_path, initial, constraints, bodies):
    """The start is held rigidly, by a ball or not: 3 rows for each ball, 1 for each quaternion."""
    model = gs.load_model(path_of(tmp_path, cable(f'curve="s" count="6 1 1" initial="{initial}"')))
    assert (len(model.system.constraints), len(model.q0)) == (constraints, 7 * bodies)


def test_a_cantilever_bends_by_its_weight(tmp_path):
    """Joints turn by M_k l/(E I) + O(angle²), M_k the moment of the weight beyond."""
    N = 5
    h, mass = 1 / N, 1000 * math.pi * R**2 / N
    stiff = CONFIG.replace(str(E), "1e13")
    model = gs.load_model(path_of(tmp_path, cable('curve="s" count="6 1 1" initial="none"',
                                                  config=stiff, gravity="0 0 -9.81"))).equilibrium()
    angles = [mass * 9.81 * sum((j - k + 0.5) * h for j in range(k, N)) * h
              / (1e13 * math.pi * R**4 / 4) for k in range(1, N)]
    centre = -sum(x * (N - k - 0.5) * h for k, x in enumerate(angles, 1))
    assert model.q0[-1] == pytest.approx(centre, rel=1e-6)


@pytest.mark.parametrize(("axis", "stiffness"), [
    (0, G * 0.006 * 0.004**3 * (16 / 3 - 3.36 / 1.5 * (1 - 1.5**-4 / 12))),
    (1, E * 0.008**3 * 0.012 / 12), (2, E * 0.012**3 * 0.008 / 12)])
def test_a_turned_joint_stores_energy(tmp_path, axis, stiffness):
    """V is (2/l) B sin²(θ/2), which is ½ (B/l) θ² + O(θ⁴), about each axis of a box."""
    q = np.zeros(4)
    q[0], q[1 + axis] = math.cos(0.2), math.sin(0.2)
    path = path_of(tmp_path, cable('curve="s" count="6 1 1" initial="none"', BOX))
    energy = Motion(gs.load_model(path, angles={"cJ_2": q})).energy()
    assert energy == pytest.approx(2 / 0.2 * stiffness * math.sin(0.2) ** 2, rel=1e-12)


@pytest.mark.parametrize(("flat", "share", "around"), [
    ("false", 0, "{}"), ("true", 1, '<body name="post" quat="1 2 -3 .5">{}</body>')])
def test_the_rest_shape_is_that_of_the_file_or_flat(tmp_path, around, flat, share):
    """An arc of 342 degrees has its energy, though quaternions along it change their sign."""
    path = path_of(tmp_path, cable(ARC + ' initial="none"', around=around,
                                   config=CONFIG + f'<config key="flat" value="{flat}"/>'))
    angle, B = 1.9 * math.pi / 8, E * math.pi * R**4 / 4
    energy = 7 * 2 / (0.6 * math.sin(angle / 2)) * B * math.sin(angle / 2) ** 2
    assert Motion(gs.load_model(path)).energy() == pytest.approx(
        share * energy, rel=1e-12, abs=1e-12 * energy)


def test_vertices_may_be_unequal_and_a_plugin_shared(tmp_path):
    """Each joint has the length of the segment before it, and the moduli of a plugin instance."""
    text = cable('vertex="0 0 0 .1 0 0 .4 0 0 .6 0 0"').replace(
        f'<plugin plugin="{PLUGIN}"/>', f'<plugin plugin="{PLUGIN}"><instance name="i">{CONFIG}'
        "</instance></plugin>").replace(f'<plugin plugin="{PLUGIN}">{CONFIG}</plugin><geom',
                                        '<plugin instance="i"/><geom')
    B, q = E * math.pi * R**4 / 4, [math.cos(0.2), 0, math.sin(0.2), 0]
    for joint, h in (("cJ_1", 0.1), ("cJ_last", 0.3)):
        energy = Motion(gs.load_model(path_of(tmp_path, text), angles={joint: q})).energy()
        assert energy == pytest.approx(2 / h * B * math.sin(0.2) ** 2, rel=1e-12)


@pytest.mark.parametrize("ends", [
    pytest.param('body1="load" body2="cB_last" anchor="0 0 .1"', marks=pytest.mark.slow),
    'site1="hook" site2="cS_last"'])
def test_a_load_hangs_on_the_end(tmp_path, ends):
    """A body connected to the last segment adds its rows and its weight to damped joints."""
    load = ('<body name="load" pos="1 0 -.1"><freejoint/><geom size=".05" contype="0" '
            'conaffinity="0"/><site name="hook" pos="0 0 .1"/></body>')
    model = gs.load_model(path_of(tmp_path, cable(
        inside='<joint kind="main" damping=".015"/>', around="{}" + load, gravity="0 0 -9.81",
        after=f"<equality><connect {ends}/></equality>")))
    assert len(model.system.constraints) == 6 + 3 * 6
    still = Motion(model)
    assert still.energy() == pytest.approx(
        9.81 * (1000 * 4 / 3 * math.pi * 0.05**3 * -0.1), rel=1e-12)


@pytest.mark.parametrize(("text", "message"), [
    (cable().replace('type="cable"', 'type="grid"'), "flexcomp"),
    (cable('curve="s" count="2 1 1"'), "count"), (cable('curve="s" count="3 3 1"'), "count"),
    (cable('curve="s" count="1000 1 1"'), "200"), (cable('curve="t" count="6"'), "curve"),
    (cable('vertex="0 0 0 1 0 0 0 0 0 1 0 0"'), "turns"),
    (cable('curve="0" count="6"'), "coincide"), (cable('curve="s" count="6" size="x"'), "finite"),
    (cable('curve="s" count="6" initial="weld"'), "initial"),
    (cable('curve="s" count="6.4 1 1"'), "6.4"), (cable('curve="s" count="6" size="1 0 0 2"'), "3"),
    (cable('curve="s" count="6" offset="0 0 1 2"'), "offset"),
    (cable(config='<config key="flat" value="yes"/>'), "yes"),
    (cable('curve="s" count="6" quat="1 0 0 0"'), "quat"),
    (cable(geom='<geom type="sphere" size=".1"/>'), "sphere"),
    (cable(geom='<geom type="capsule" size="-1"/>'), "size"),
    (cable(geom=ROUND.replace("size", 'pos="0 0 1" size')), "pos"),
    (cable(config='<config key="bend" value="-1"/>'), "bend"),
    (cable(config='<config key="young" value="1"/>'), "young"),
    (cable(inside='<joint kind="twist"/>'), "kind"), (cable(inside="<tendon/>"), "tendon"),
    (cable(inside='<plugin plugin="other"/>'), "other"),
    (cable(inside='<joint kind="main" stiffness="1"/>'), "stiffness"),
    (cable(around='<body childclass="k">{}</body>'), "childclass"),
    (cable(around='<replicate count="2" offset="0 1 0">{}</replicate>'), "replicate"),
    (cable().replace("<worldbody>", "<default><geom density='1'/></default><worldbody>"),
     "default"),
    (cable(around='<body><joint/>' + ROUND + f'<plugin plugin="{PLUGIN}"/></body>'), "composite"),
], ids=lambda x: "")
def test_bad_cables_are_refused(tmp_path, text, message):
    with pytest.raises(gs.InputError, match=message) as caught:
        gs.Multibody.from_file(path_of(tmp_path, text))
    assert "\n" not in str(caught.value)
