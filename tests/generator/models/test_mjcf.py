"""MJCF: what it describes, against closed forms, bodies put together by hand and MuJoCo."""

from __future__ import annotations

import math

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
    (obj(FACES[1:]), "not closed"), (obj([f[::-1] for f in FACES]), "volume is -"),
    (b"v 0 0", "no OBJ|no triangles"), (b"", "no triangles"), (None, "no such file"),
    (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\n" * 2_000_001, "2000001 triangles"),
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


def lagrange(place, mass, inertia, armature, q, v, g=9.81):
    """Return q'' of one body whose frame is at ``place(q)``, by derivatives of its Lagrangian.

    M q'' = −M' q' + ½ ∂(q'ᵀ M q')/∂q − V_q; derivatives by complex and central differences.
    """
    def mass_matrix(q):
        J = []
        for k in range(len(q)):
            step = q + 1e-30j * np.eye(len(q))[k]
            x, R = place(step)
            turning = (R.imag / 1e-30) @ place(q)[1].real.T
            J.append(np.r_[x.imag / 1e-30, place(q)[1].real.T @ [turning[2, 1], turning[0, 2],
                                                                turning[1, 0]]])
        J = np.array(J).T
        return J.T @ np.diag([mass] * 3 + inertia) @ J + np.diag(armature)

    h = 1e-4
    weights = ((h, 8 / 12), (-h, -8 / 12), (2 * h, -1 / 12), (-2 * h, 1 / 12))

    def slope(f, k):
        return sum(c * f(q + d * np.eye(len(q))[k]) for d, c in weights) / h

    n = range(len(q))
    dM = [slope(mass_matrix, k) for k in n]
    force = np.array([v @ dM[k] @ v / 2 - mass * g * slope(lambda q: place(q)[0].real[2], k)
                      for k in n]) - sum(v[k] * dM[k] for k in n) @ v
    return np.linalg.solve(mass_matrix(q), force)


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
