"""MJCF: what it describes, against closed forms, bodies put together by hand and MuJoCo."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import pytest

import gyrospark as gs
from robots import Motion

EPS = np.finfo(float).eps


def written(tmp_path, inside, name="robot.xml", **top):
    told = "".join(f' {key}="{value}"' for key, value in top.items())
    path = tmp_path / name
    path.write_text(f"<mujoco{told}>{inside}</mujoco>", encoding="utf-8")
    return path


def hinged(parts, joint='<joint name="j" axis="0 1 0"/>', before="", after=""):
    return (f'{before}<worldbody><body name="b">{joint}{parts}</body></worldbody>{after}')


def body_of(path, **options):
    """Return mass, centre and inertia of the only body, in the axes of its frame."""
    build = gs.read_mjcf(path, ignore="all", **options)
    (body,) = build._components.bodies
    J = np.array(build._components.inertia[body])
    return (build._components.values[str(body.mass)], build._components.bodies[body].x,
            np.diag(J) if J.ndim == 1 else J)


# ---------------------------------------------------------------- geoms


def revolved(pieces):
    """Return V, I/ρ across and along of a solid of revolution, from pieces of its profile.

    ∫ π r² dz, ∫ π (r⁴/4 + r² z²) dz and ∫ π r⁴/2 dz by Gauss–Legendre, exact for these profiles.
    """
    z, w = np.polynomial.legendre.leggauss(8)
    V = across = along = 0.0
    for low, high, square in pieces:
        x, weight = (high - low) / 2 * z + (high + low) / 2, (high - low) / 2 * w
        r2 = square(x)
        V += math.pi * weight @ r2
        across += math.pi * weight @ (r2**2 / 4 + r2 * x**2)
        along += math.pi * weight @ (r2**2 / 2)
    return V, across, along


R, H = 0.3, 0.7
SOLIDS = {
    "sphere": (f"{R}", [(-R, R, lambda z: R**2 - z**2)]),
    "cylinder": (f"{R} {H}", [(-H, H, lambda z: R**2 + 0 * z)]),
    "capsule": (f"{R} {H}", [(-H, H, lambda z: R**2 + 0 * z),
                             (H, H + R, lambda z: R**2 - (z - H) ** 2),
                             (-H - R, -H, lambda z: R**2 - (z + H) ** 2)]),
    "ellipsoid": (f"{R} {R} {H}", [(-H, H, lambda z: R**2 * (1 - z**2 / H**2))]),
}


@pytest.mark.parametrize("kind", SOLIDS)
def test_geoms_have_the_mass_of_their_shape(tmp_path, kind):
    """Volume and moments by quadrature of the profile, turned and moved."""
    size, profile = SOLIDS[kind]
    V, across, along = revolved(profile)
    path = written(tmp_path, hinged(
        f'<geom type="{kind}" size="{size}" density="500" pos="0.1 0.2 0.3" zaxis="1 0 0"/>'))
    m, x, J = body_of(path)
    assert m == pytest.approx(500 * V, rel=8 * EPS)
    assert np.abs(x - [0.1, 0.2, 0.3]).max() <= 4 * EPS
    assert np.abs(J - 500 * np.diag([along, across, across])).max() <= 16 * EPS * J.max()


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


@pytest.mark.parametrize(("name", "content", "tolerance"), [
    ("box.stl", stl(), 1e-6), ("box.obj", obj(), 64 * EPS)])
def test_meshes_have_the_mass_of_what_they_enclose(tmp_path, name, content, tolerance):
    """A box of triangles is one: 8abc, (b² + c²)/3; STL has seven digits."""
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / name).write_bytes(content)
    m, x, J = body_of(written(tmp_path, MESH.replace("FILE", name)))
    box = body_of(written(tmp_path, hinged('<geom type="box" size=".1 .2 .3" pos="1 0 0"/>')))
    assert m == pytest.approx(box[0], rel=tolerance)
    assert m == pytest.approx(1000 * 8 * 0.006, rel=tolerance)
    assert np.abs(x - box[1]).max() <= tolerance
    assert np.abs(J - box[2]).max() <= tolerance * box[2].max()


@pytest.mark.parametrize(("content", "said"), [
    (obj(FACES[1:]), "closed"), (obj([f[::-1] for f in FACES]), "volume is -"),
    (b"v 0 0", "no OBJ|no triangles"), (b"", "no triangles"), (None, "box.obj"),
    (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\n" * 2_000_001, "2000001"),
], ids=["open", "inside out", "cut off", "empty", "missing", "two million"])
def test_bad_meshes_are_refused(tmp_path, content, said):
    (tmp_path / "m").mkdir()
    if content is not None:
        (tmp_path / "m" / "box.obj").write_bytes(content)
    with pytest.raises(gs.InputError, match=said) as caught:
        gs.read_mjcf(written(tmp_path, MESH.replace("FILE", "box.obj")), ignore="all")
    assert "\n" not in str(caught.value)
    assert "box.obj" in str(caught.value)


# ---------------------------------------------------------------- one body


def test_an_armature_adds_to_the_inertia(tmp_path):
    """θ'' = (τ − m g l cos θ − c θ' − k (θ − θ₀))/(I + m l² + a), with gear on the motor."""
    path = written(tmp_path, hinged(
        '<inertial pos="0.5 0 0" mass="2" diaginertia=".1 .3 .25"/>',
        joint='<joint name="j" axis="0 -1 0" armature=".7" damping=".4" stiffness="3" '
              'springref="30"/>',
        after='<actuator><motor name="m" joint="j" gear="5"/></actuator>'
              '<keyframe><key name="k" qpos=".8" qvel="-1.5" ctrl=".6"/></keyframe>'))
    motion = Motion(gs.load_mjcf(path, keyframe="k"))
    torque = 5 * 0.6 - 2 * 9.81 * 0.5 * math.cos(0.8) - 0.4 * -1.5 - 3 * (0.8 - math.pi / 6)
    wanted = torque / (0.3 + 2 * 0.25 + 0.7)
    assert motion.value("j_angle") == pytest.approx(0.8, rel=4 * EPS)
    assert motion.value("j_rate") == pytest.approx(-1.5, rel=4 * EPS)
    assert motion.acceleration("j_rate") == pytest.approx(wanted, rel=1e-14)


def test_armatures_of_balls_and_free_joints(tmp_path):
    """Of the ground's ball a on each moment; of a free body a mass a without weight, too."""
    shape = '<inertial pos="0 0 0" mass="2" diaginertia="1 2 2.5"/>'
    w, a = np.array([0.3, -0.5, 0.7]), 0.4
    path = written(tmp_path, hinged(shape, f'<joint name="j" type="ball" armature="{a}"/>'))
    build = gs.read_mjcf(path, rates={"j": w})
    for k in range(3):
        build.quantity(f"w{k}", build._components.body(
            "b", "it").angular_velocity[k])
    motion = Motion(build.model())
    J = np.diag([1, 2, 2.5]) + a * np.eye(3)
    wanted = np.linalg.solve(J, np.cross(J @ w, w))
    assert [motion.acceleration(f"w{k}") for k in range(3)] == pytest.approx(wanted, rel=1e-12)
    path = written(tmp_path, hinged(shape, f'<joint name="j" type="free" armature="{a}"/>'))
    build = gs.read_mjcf(path)
    build.quantity("v", build._components.body("b", "it").velocity[2])
    assert Motion(build.model()).acceleration("v") == pytest.approx(-9.81 * 2 / 2.4, rel=1e-12)


def test_a_slide_with_a_position_actuator(tmp_path):
    """m s'' = kp (u − s) − kv s' − g m sin 30° with a + m in place of m, along a tilted axis."""
    path = written(tmp_path, hinged(
        '<geom size="0.1" mass="3"/>', before='<default><position kp="50"/></default>',
        joint='<joint name="s" type="slide" axis="0.8660254037844387 0 0.5" ref=".2" '
              'armature="1"/>',
        after='<actuator><position name="p" joint="s" kv="2"/></actuator>'))
    build = gs.read_mjcf(path, angles={"s": 0.5}, rates={"s": 0.25})
    motion = Motion(build.model())
    assert motion.q[:7] == pytest.approx([1, 0, 0, 0, 0.3 * math.cos(math.pi / 6), 0, 0.15])
    wanted = (50 * (0 - 0.5) - 2 * 0.25 - 3 * 9.81 * 0.5) / 4
    assert motion.acceleration("s_speed") == pytest.approx(wanted, rel=1e-13)


def test_a_free_body_falls_and_turns(tmp_path):
    """Euler's equations about the centre of mass; qvel has the velocity of the frame."""
    path = written(tmp_path, '<worldbody><body name="b" pos="0 0 1" euler="0 0 90"><freejoint '
                   'name="root"/><inertial pos="0 0.5 0" mass="2" diaginertia=".1 .2 .25"/></body>'
                   '</worldbody>')
    build = gs.read_mjcf(path, rates={"root": [1, 2, 3, 0.4, 0.5, 0.6]})
    (body,) = build._components.bodies
    for k in range(3):
        build.quantity(f"w{k}", body.angular_velocity[k])
        build.quantity(f"v{k}", body.velocity[k])
    motion = Motion(build.model())
    w, J = np.array([0.4, 0.5, 0.6]), np.array([0.1, 0.2, 0.25])
    wanted = np.cross(J * w, w) / J
    assert [motion.acceleration(f"w{k}") for k in range(3)] == pytest.approx(wanted, rel=1e-13)
    assert [motion.acceleration(f"v{k}") for k in range(3)] == pytest.approx([0, 0, -9.81],
                                                                             abs=1e-13)
    turned = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])  # 90 degrees about z
    v = [1, 2, 3] + turned @ np.cross(w, [0, 0.5, 0])
    assert [motion.value(f"v{k}") for k in range(3)] == pytest.approx(v, rel=1e-14)


# ---------------------------------------------------------------- joints in a row


def mass_matrix(place, mass, inertia, q):
    """Return M(q) of one body, by complex steps of its placement."""
    J = []
    for k in range(len(q)):
        x, R = place(q + 1e-30j * np.eye(len(q))[k])
        turned = place(q)[1].real.T
        W = (R.imag / 1e-30) @ turned
        J.append(np.r_[x.imag / 1e-30, turned @ [W[2, 1], W[0, 2], W[1, 0]]])
    J = np.array(J).T
    return J.T @ np.diag([mass] * 3 + inertia) @ J


def lagrange(place, mass, inertia, armature, q, v, g=9.81):
    """Return q'' of one body whose frame is at ``place(q)``, by derivatives of its Lagrangian.

    M q'' = −M' q' + ½ ∂(q'ᵀ M q')/∂q − V_q; derivatives by complex and central differences.
    """
    h = 1e-4
    weights = ((h, 8 / 12), (-h, -8 / 12), (2 * h, -1 / 12), (-2 * h, 1 / 12))

    def slope(f, k):
        return sum(c * f(q + d * np.eye(len(q))[k]) for d, c in weights) / h

    n = range(len(q))
    M = partial(mass_matrix, place, mass, inertia)
    dM = [slope(M, k) for k in n]
    force = np.array([v @ dM[k] @ v / 2 - mass * g * slope(lambda q: place(q)[0].real[2], k)
                      for k in n]) - sum(v[k] * dM[k] for k in n) @ v
    return np.linalg.solve(M(q) + np.diag(armature), force)


def spun(axis, angle):
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def test_joints_in_a_row_with_armature(tmp_path):
    """A slide and two skew hinges in one body, against Lagrange's equations of three angles."""
    axes = [(0, 0.6, 0.8), (1, 0, 0.5), (0.2, 1, 0)]
    points = [(0, 0, 0), (0, 0.1, 0), (0.05, 0, -0.2)]
    parts = "".join(
        f'<joint name="j{k}" type="{kind}" axis="{" ".join(map(str, axis))}" '
        f'pos="{" ".join(map(str, point))}" armature="{a}"/>' for k, (kind, axis, point, a) in
        enumerate(zip(("slide", "hinge", "hinge"), axes, points, (0.3, 0.02, 0.05), strict=True)))
    path = written(tmp_path, hinged(
        '<inertial pos="0.1 0.2 -0.3" mass="1.5" diaginertia=".05 .06 .04"/>', joint=parts))
    q, v = np.array([0.2, 0.7, -1.1]), np.array([0.5, -1.2, 2.0])

    def place(q):
        x, R = q[0] * np.array(axes[0]), np.eye(3)
        for k in (1, 2):
            at = x + R @ points[k]
            R = R @ spun(axes[k], q[k])
            x = at - R @ points[k]
        return x + R @ [0.1, 0.2, -0.3], R

    names = ["j0", "j1", "j2"]
    model = gs.load_mjcf(path, angles=dict(zip(names, map(float, q), strict=True)),
                         rates=dict(zip(names, map(float, v), strict=True)))
    assert (model.system.n, model.system.m) == (10, 7)
    motion = Motion(model)
    wanted = lagrange(place, 1.5, [0.05, 0.06, 0.04], (0.3, 0.02, 0.05), q, v)
    quantities = ["j0_speed", "j1_rate", "j2_rate"]
    assert [motion.value(name) for name in quantities] == pytest.approx(v, rel=1e-14)
    found = np.array([motion.acceleration(name) for name in quantities])
    assert np.abs(found - wanted).max() <= 1e-10 * np.abs(wanted).max()  # of the differences


def test_two_crossing_hinges_and_two_slides_without_armature(tmp_path):
    """A universal joint and a plane, whose coordinates have springs, against Lagrange's equations.

    The springs k q take the place of gravity: their forces are −k q.
    """
    cross = written(tmp_path, hinged(
        '<inertial pos="0.1 0.2 -0.3" mass="1.5" diaginertia=".05 .06 .04"/>',
        before='<option gravity="0 0 0"/>',
        joint='<joint name="a" axis="1 0 0" stiffness="3" springref="0"/>'
              '<joint name="b" axis="0 1 0" stiffness="2"/>'))
    q, v = np.array([0.4, -0.7]), np.array([1.5, -2.0])

    def place(q):
        R = spun((1, 0, 0), q[0]) @ spun((0, 1, 0), q[1])
        return R @ [0.1, 0.2, -0.3], R

    motion = Motion(gs.load_mjcf(cross, angles={"a": 0.4, "b": -0.7}, rates={"a": 1.5, "b": -2.0}))
    free = lagrange(place, 1.5, [0.05, 0.06, 0.04], (0, 0), q, v, g=0)
    wanted = free - np.linalg.solve(mass_matrix(place, 1.5, [0.05, 0.06, 0.04], q),
                                    np.array([3, 2]) * q)
    assert [motion.value("a_angle"), motion.value("b_angle")] == pytest.approx(q, abs=1e-15)
    assert [motion.acceleration("a_rate"), motion.acceleration("b_rate")] == pytest.approx(
        wanted, rel=1e-9)
    plane = written(tmp_path, hinged(
        '<geom size="0.1" mass="2"/>',
        joint='<joint name="x" type="slide" axis="1 0 0" stiffness="3"/>'
              '<joint name="y" type="slide" axis="0.6 0.8 0" damping="0.5"/>'))
    motion = Motion(gs.load_mjcf(plane, angles={"x": 0.3, "y": 1.0}, rates={"y": 2.0}))
    M = 2 * np.array([[1, 0.6], [0.6, 1]])
    wanted = np.linalg.solve(M, [-3 * 0.3, -0.5 * 2.0])
    assert motion.value("y_speed") == pytest.approx(2.0, rel=1e-14)
    assert [motion.acceleration("x_speed"), motion.acceleration("y_speed")] == pytest.approx(
        wanted, rel=1e-13)


# ---------------------------------------------------------------- more bodies

BAR = '<inertial pos="{0} 0 0" mass="1" diaginertia=".001 {1} {1}"/>'
FOUR_BAR = f"""<compiler angle="radian"/>
<default><joint axis="0 -1 0"/><default class="stiff"><joint armature=".02" damping=".1"/></default>
</default><worldbody><body name="frame" pos="0 0 .5">
<body name="crank" childclass="stiff"><joint name="crank"/>{BAR.format(0.2, 0.4**2 / 12)}
<body name="coupler" pos=".4 0 0"><joint name="elbow" class="main"/>{BAR.format(0.5, 1 / 12)}
<body name="rocker" pos="1 0 0"><joint name="wrist"/>{BAR.format(0.35, 0.7**2 / 12)}
<site name="tip" pos=".7 0 0"/>
</body></body></body><site name="pin" pos="1.1 0 0"/></body></worldbody>
<equality><connect name="loop" site1="tip" site2="pin"/></equality>
"""
ANGLES = {"crank": 1.2, "elbow": -0.9, "wrist": -1.9}


def test_classes_and_loops_are_those_put_together_by_hand(tmp_path):
    """A four-bar of sites, with classes of joints, is the one of a builder."""
    with pytest.warns(gs.InputWarning, match="left out"):
        found = Motion(gs.load_mjcf(written(tmp_path, FOUR_BAR), angles=ANGLES))
    build = gs.Multibody("hand")
    tilt, x, above = 0.0, np.array([0, 0, 0.5]), build.ground
    for name, length, angle in (("crank", 0.4, 1.2), ("elbow", 1.0, -0.9), ("wrist", 0.7, -1.9)):
        tilt += angle
        along = np.array([math.cos(tilt), 0, math.sin(tilt)])
        body = build.body(f"{name}_bar", mass=1, inertia=(0.001, length**2 / 12, length**2 / 12),
                          position=x + length / 2 * along,
                          rotation=spun((0, -1, 0), tilt))
        build.revolute(name, above, body, axis_in_space=(0, -1, 0), at=x, angle=angle)
        build.quantity(f"{name}_rate", build.rate(name))
        if name != "elbow":
            build.flywheel(f"{name}_wheel", name, inertia=0.02)
            build.joint_spring(f"{name}_damper", name, damping=0.1)
        x, above = x + length * along, body
    build.ball("loop", above, "ground", on_a=(0.35, 0, 0), on_b=(1.1, 0, 0.5))
    wanted = Motion(build.model(redundant="leave out"))
    for name in ("crank", "elbow", "wrist"):
        assert found.acceleration(f"{name}_rate") == pytest.approx(
            wanted.acceleration(f"{name}_rate"), rel=1e-11)


PAIR = """<worldbody>
<body name="a"><joint name="a" axis="0 0 1" armature=".1"/><geom size=".1" mass="1" pos=".3 0 0"/>
</body><body name="b" pos="1 0 0"><joint name="b" axis="0 0 1" ref="10"/>
<geom size=".1" mass="2" pos=".2 0 0"/></body></worldbody>"""


@pytest.mark.parametrize(("equality", "law"), [
    ('<joint joint1="a" joint2="b" polycoef="0.1 -2 0 0 0"/>', lambda b: 0.1 - 2 * b),
    ('<joint joint1="a" joint2="b" polycoef="0 1 0.5 0 -1"/>', lambda b: b + b**2 / 2 - b**4),
    ('<tendon tendon1="s" tendon2="t" polycoef="0 1.5 0 0 0"/>', lambda b: 1.5 * b / 2),
])
def test_laws_of_joints_are_kept(tmp_path, equality, law):
    """q_a = f(q_b − ref), at the start and after a hundred steps; the rate by f'."""
    path = written(tmp_path, PAIR + '<tendon><fixed name="s"><joint joint="a" coef="2"/></fixed>'
                   '<fixed name="t"><joint joint="b" coef="1"/></fixed></tendon>'
                   f"<equality>{equality}</equality>")
    model = gs.load_mjcf(path, ignore="contact", angles={"a": law(0.4),
                                                           "b": 0.4 + math.radians(10)})
    motion = Motion(model)
    b = motion.value("b_angle") - math.radians(10)
    assert motion.value("a_angle") == pytest.approx(law(b), abs=1e-14)
    assert motion.value("a_rate") == pytest.approx(0, abs=1e-14)


def test_welds_hold(tmp_path):
    """Two bodies in a free fall turn as one, of the inertia of both."""
    inner = '<inertial pos="0 0 0" mass="{}" diaginertia=".1 .2 .25"/><freejoint name="{}"/>'
    path = written(tmp_path, f'<worldbody><body name="a">{inner.format(1, "a")}</body>'
                   f'<body name="b" pos="1 0 0" euler="30 0 0">{inner.format(3, "b")}</body>'
                   '</worldbody><equality><weld body1="a" body2="b"/></equality>')
    build = gs.read_mjcf(path)
    w = np.array([0.3, -0.2, 0.5])
    a, b = build._components.bodies
    build._components.bodies[a].omega = w
    build._components.bodies[b].omega = spun((1, 0, 0), -math.pi / 6) @ w
    build._components.bodies[a].v = np.cross(w, [-0.75, 0, 0])
    build._components.bodies[b].v = np.cross(w, [0.25, 0, 0])
    for k in range(3):
        build.quantity(f"w{k}", a.angular_velocity[k])
    motion = Motion(build.model())
    R = spun((1, 0, 0), math.pi / 6)
    J = (np.diag([0.1, 0.2, 0.25]) + R @ np.diag([0.1, 0.2, 0.25]) @ R.T
         + 1 * 3 / 4 * np.diag([0, 1, 1]))
    wanted = np.linalg.solve(J, np.cross(J @ w, w))
    assert [motion.acceleration(f"w{k}") for k in range(3)] == pytest.approx(wanted, rel=1e-12)


def test_the_example_is_what_it_says():
    """A loop, a motor that holds a speed against its armature, and shapes; no mesh."""
    build = gs.read_mjcf("examples/pumpjack.xml", keyframe="running")
    assert {link.name for link in build._components.connections} >= {
        "crank_joint", "pin", "saddle", "rope", "loop", "crank_rotor", "drive_motor"}
    assert build._components.values["drive"] == 2.0
    assert [shape.kind for shape in build._visuals["beam"]] == ["bar", "box"]


# ---------------------------------------------------------------- files


def test_files_are_included_from_their_folder(tmp_path):
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "leg.xml").write_text(
        '<mujocoinclude><body name="b"><joint name="j"/><geom size=".1"/></body></mujocoinclude>')
    build = gs.read_mjcf(written(
        tmp_path, '<worldbody><include file="parts/leg.xml"/></worldbody>'))
    assert [body.name for body in build._components.bodies] == ["b"]
    assert [shape.kind for shape in build._visuals["b"]] == ["sphere"]


ONE = '<worldbody><body name="b"><joint name="j"/><geom size=".1"/></body></worldbody>'
TOUCHING = ONE.replace("<worldbody>", '<worldbody><geom type="plane" size="1 1 1"/>')
BAD = [
    (TOUCHING, "contact.*2"), (ONE.replace('name="j"', 'name="j" range="0 1"'), "limits"),
    (ONE.replace('name="j"', 'name="j" frictionloss="1"'), "friction"),
    ('<option density="1000"/>' + ONE, "fluid"),
    (ONE + '<actuator><muscle joint="j"/></actuator>', "actuator"),
    ("<worldbdy/>", "worldbdy.*worldbody"), (ONE.replace("<geom", "<gem"), "<gem>.*geom"),
    (ONE.replace("size", "siez"), "siez.*size"), (ONE.replace(".1", "-1"), "size='-1'"),
    (ONE.replace(".1", "nan"), "'nan'"), (ONE.replace('"j"', '"j" class="x"'), "'x'"),
    (ONE.replace('"j"', '"j" type="hing"'), "'hing'.*hinge"),
    (ONE.replace('"j"', '"j" type="ball" stiffness="1"'), "stiffness"),
    (ONE.replace('<geom size=".1"/>', ""), "'b'.*mass"), ("<worldbody/>", "nothing moves"),
    (ONE.replace('<joint name="j"/>', ""), "nothing moves"),
    (ONE.replace('<joint name="j"/>', '<joint name="j"/><joint name="k" axis="1 0 1"/>'),
     "hinge, hinge.*armature"),
    ('<compiler coordinate="global"/>' + ONE, "global"),
    ("<default><default class='a'><default class='a'/></default></default>" + ONE, "'a'.*already"),
    ("<default><default/></default>" + ONE, "no name"),
    ('<include file="../other.xml"/>' + ONE, "folder"),
    ('<include file="/etc/passwd"/>' + ONE, "folder"),
    ('<include file="robot.xml"/>' + ONE, "already"),
    ('<include file="none.xml"/>' + ONE, "none.xml"),
    (ONE + '<equality><connect body1="b" body2="c" anchor="0 0 0"/></equality>', "'c'"),
    (ONE + '<equality><joint joint1="j" joint2="i"/></equality>', "'i'"),
    (ONE + '<actuator><motor joint="i"/></actuator>', "'i'"),
    (ONE.replace("<geom", "<composite/><geom"), "<composite>"),
    ('<asset><mesh name="m" file="../m.stl"/></asset>' + ONE.replace('size=".1"', 'mesh="m"'),
     "folder"),
    (ONE.replace('<geom size=".1"/>', '<geom mesh="m"/>'), "'m'"),
]


@pytest.mark.parametrize(("inside", "said"), BAD, ids=lambda x: "")
def test_bad_files_are_refused(tmp_path, inside, said):
    with pytest.raises(gs.InputError, match=said) as caught:
        gs.load_mjcf(written(tmp_path, inside))
    assert "robot.xml" in str(caught.value)
    assert "\n" not in str(caught.value)


BOMB = """<?xml version="1.0"?>
<!DOCTYPE mujoco [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>
<mujoco model="&b;"/>
"""


@pytest.mark.parametrize(("text", "said"), [
    (BOMB, "line 2.*type"), ("<mujoco>" + "<body>" * 100_000, "64"),
    (" " * 10_000_000, "1048576"), ("", "element"), ("<svg/>", "<svg>"),
], ids=["bomb", "deep", "ten megabytes", "empty", "another format"])
def test_files_cannot_grow(tmp_path, text, said):
    path = tmp_path / "bad.xml"
    path.write_text(text, encoding="utf-8")
    for load in (gs.load_mjcf, gs.load_model):
        with pytest.raises(gs.InputError, match=said):
            load(path)


@pytest.mark.parametrize(("options", "said"), [
    ({"keyframe": "hom"}, "'hom'.*home"), ({"keyframe": 3}, "3.*home"),
    ({"angles": {"i": 1}}, "'i'"), ({"angles": {"j": "x"}}, "'x'"), ({"ignore": "limit"}, "limits"),
    ({"rates": {"j": [1, 2]}}, "'j'"), ({"gravity": 3}, "gravity"), ({"rep": "beta"}, "'beta'"),
])
def test_bad_starts_are_refused(tmp_path, options, said):
    path = written(tmp_path, ONE + '<keyframe><key name="home" qpos="1"/></keyframe>')
    with pytest.raises(gs.InputError, match=said):
        gs.load_mjcf(path, **options)


def test_the_command_runs_it(tmp_path, gyrospark):
    """An actuator is an input, the keyframe a setting; what is wrong ends in one line."""
    path = written(tmp_path, ONE + '<actuator><motor name="m" joint="j"/></actuator>'
                   '<keyframe><key name="k" qpos=".5" ctrl=".25"/></keyframe>')
    run = ("run", path, "--scheme", "IMS", "--steps", "5", "--json")
    done = gyrospark(*run, "--set", "keyframe=k", "--set", "j.rate=2")
    assert done.code == 0, done.stderr
    document = done.document
    assert document["parameters"]["m"] == 0.25
    assert document["quantities"]["j_angle"] == pytest.approx(0.5 + 2 * 5 * 0.002, rel=1e-2)
    for setting, said in (("keyframe=x", "'x'"), ("i=3", "'i'"), ("ignore=all the rest", "limits")):
        failed = gyrospark(*run, "--set", setting)
        assert failed.code == 2
        assert failed.stderr.count("\n") == 1
        assert said in failed.stderr


def test_a_file_adds_joints(tmp_path):
    """A rod between points in the axes of the file's bodies, as put there by hand."""
    inside = ('<worldbody><body name="base" pos="0 0 1"/><body name="b" pos="0 0 2" euler="0 20 0">'
              '<joint name="j" type="ball"/><geom size=".1" pos=".5 0 .2"/></body></worldbody>')
    path = written(tmp_path, inside)
    loops = tmp_path / "loops.toml"
    loops.write_text('[[joints]]\nname = "tie"\ntype = "rod"\nbodies = ["base", "b"]\n'
                     'on_a = [1, 0, 0]\non_b = [0.4, 0, 0.1]\n', encoding="utf-8")
    told = {"ignore": "all", "rates": {"j": (0.0, 0.0, 1.0)}}
    build = gs.read_mjcf(path, **told)
    build.rod("tie", "ground", "b", on_a=(1, 0, 1), on_b=(-0.1, 0, -0.1))
    found = Motion(gs.load_mjcf(path, loops=loops, **told))
    by_hand = Motion(build.model())
    assert found.dp == pytest.approx(by_hand.dp, rel=1e-12, abs=1e-12)
    assert found.multipliers == pytest.approx(by_hand.multipliers, rel=1e-12, abs=1e-12)
    assert abs(found.multipliers[-1]) > 0.1


# ---------------------------------------------------------------- looks

LOOKS = """<asset>
  <texture name="flat" type="2d" builtin="flat" rgb1="1 .5 0"/><material name="tan" texture="flat"/>
  <material name="blue" rgba="0 0 1 1"/>
  <mesh file="meshes/a.stl" scale="2 1 1" refpos="1 0 0" refquat="0 0 0 1"/></asset>
<worldbody><geom type="plane" size="1 1 1"/><geom type="box" size=".1 .2 .3" pos="0 0 1"/>
  <body name="b" pos="0 0 2"><joint/><inertial pos=".5 0 0" mass="1" diaginertia="1 1 1"/>
    <geom type="ellipsoid" size=".1 .2 .3" rgba="1 0 0 1" material="blue"/>
    <geom type="capsule" fromto="0 0 0 0 0 2" size=".1" material="tan"/>
    <geom type="cylinder" size=".1 .2" group="3"/><geom size=".1" rgba="1 1 1 0"/>
    <body name="c" pos="1 0 0"><geom type="mesh" mesh="a" material="blue" mass="0"/></body></body>
  <body name="d"><joint/><inertial mass="1" diaginertia="1 1 1"/>
    <geom size=".2" group="3"/></body></worldbody>"""


def test_bodies_look_as_their_geoms(tmp_path):
    """Groups 0 to 2 are drawn, materials have colours, a mesh is where its reference puts it."""
    (tmp_path / "meshes").mkdir()
    path = written(tmp_path, LOOKS)
    tetrahedron = np.array([[[0, 0, 0], [0, 1, 0], [1, 0, 0]], [[0, 0, 0], [1, 0, 0], [0, 0, 1]],
                            [[0, 0, 0], [0, 0, 1], [0, 1, 0]], [[1, 0, 0], [0, 1, 0], [0, 0, 1]]])
    (tmp_path / "meshes" / "a.stl").write_text("".join(
        f"vertex {x} {y} {z}\n" for x, y, z in tetrahedron.reshape(-1, 3).tolist()))
    found = gs.read_mjcf(path, ignore="all")._visuals
    (box,) = found[""]
    assert (box.kind, box.size.tolist(), box.centre.tolist()) == ("box", [0.1, 0.2, 0.3], [0, 0, 1])
    ellipsoid, capsule, mesh = found["b"]
    assert (ellipsoid.kind, ellipsoid.size.tolist(), ellipsoid.colour) == (
        "sphere", [0.1, 0.2, 0.3], "#ff0000")
    assert ellipsoid.centre.tolist() == [-0.5, 0, 0]  # from the centre of mass
    assert (capsule.kind, capsule.size.tolist(), capsule.colour) == (
        "bar", [0.1, 0.1, 1.0], "#ff8000")
    assert (mesh.file, mesh.colour) == (str(tmp_path / "meshes" / "a.stl"), "#0000ff")
    corner = mesh.centre + mesh.axes @ (mesh.size * [1, 0, 0])
    assert corner == pytest.approx([0.5 + 1 - 2, 0, 0], abs=1e-15)  # (2 − 1) turned by 180°
    assert [shape.kind for shape in found["d"]] == ["sphere"]  # of nothing else to be seen
    (tmp_path / "meshes" / "a.stl").unlink()
    assert [shape.kind for shape in gs.read_mjcf(path, ignore="all")._visuals["b"]] == ["disc"]


# ---------------------------------------------------------------- limits, damping ratios


def test_ranges_are_elastic_on_wish(tmp_path):
    """V = ½ k d² beyond a range in degrees: energy, and the force that a deflected hinge feels."""
    path = written(tmp_path, hinged('<geom size=".1" pos="0 0 -1"/>', '<joint name="j" '
                                    'axis="0 1 0" range="-10 20"/>'))
    with pytest.raises(gs.InputError, match="limits"):
        gs.read_mjcf(path)
    still = Motion(gs.load_mjcf(path, ignore="limits", angles={"j": "30 deg"}))
    limited = Motion(gs.load_mjcf(path, limits=50.0, angles={"j": "30 deg"}))
    mass = 4 / 3 * math.pi * 0.1**3 * 1000
    inertia = mass * (0.4 * 0.1**2 + 1)
    assert limited.acceleration("j_rate") - still.acceleration("j_rate") == pytest.approx(
        -50 * math.radians(10) / inertia, rel=1e-12)
    inside = [Motion(gs.load_mjcf(path, angles={"j": 0.1}, **told)).acceleration("j_rate")
              for told in ({"limits": 50.0}, {"ignore": "all"})]
    assert inside[0] == inside[1]


def test_a_damping_ratio_of_one_is_critical(tmp_path):
    """Of a slide of mass 3 with a gear: kv = 2 ζ √(kp m), and none beside a kv."""
    inside = ('<worldbody><body><joint name="j" type="slide"/><geom size=".1" mass="3"/></body>'
              '</worldbody><actuator><position joint="j" kp="12" dampratio="0.5" gear="2"{}/>'
              '</actuator>')
    motion = Motion(gs.load_mjcf(written(tmp_path, inside.format("")), gravity=(0, 0, 0),
                                 rates={"j": 1.0}))
    assert motion.acceleration("j_speed") == pytest.approx(
        -2 * 2 * 0.5 * 2 * math.sqrt(12 * 3 / 4) / 3, rel=1e-12)
    with pytest.raises(gs.InputError, match="dampratio"):
        gs.read_mjcf(written(tmp_path, inside.format(' kv="1"')))
