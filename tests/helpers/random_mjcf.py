"""Random robots in MJCF, and their accelerations in MuJoCo with equalities that hold exactly."""

from __future__ import annotations

import mujoco
import numpy as np

import gyrospark as gs
from gyrospark.generator.models.mjcf_reader import read_mjcf_robot
from gyrospark.generator.models.robot_builder import plain_name
from gyrospark.generator.multibody.body import dot
from robots import Motion

FLAGS = ("gravity", "spring", "damper", "actuation", "equality", "clampctrl", "limit", "contact",
         "frictionloss", "constraint", "warmstart", "eulerdamp")


class Writer:
    """Writes one robot; each choice is one of a random generator."""

    def __init__(self, rng, loops):
        self.rng, self.loops = rng, loops
        self.bodies, self.joints, self.sites, self.degrees = [], [], [], bool(rng.integers(2))

    def chance(self, p):
        return self.rng.random() < p

    def pick(self, *choices):
        return choices[self.rng.integers(len(choices))]

    def numbers(self, count, low=-1.0, high=1.0):
        return " ".join(f"{x:.3f}" for x in self.rng.uniform(low, high, count))

    def angle(self, low, high):
        return f"{self.rng.uniform(low, high) * (57.3 if self.degrees else 1):.3f}"

    def attitude(self):
        """Return no attitude, or one of the five ways to write it."""
        angles = " ".join(self.angle(-1, 1) for _ in range(3))
        return self.pick("", "", f'quat="{self.numbers(4)}"', f'euler="{angles}"',
                         f'axisangle="{self.numbers(3)} {self.angle(-1, 1)}"',
                         f'xyaxes="{self.numbers(6)}"', f'zaxis="{self.numbers(3)}"')

    def classes(self):
        """Return defaults in three levels, of joints, geoms and actuators of several kinds."""
        actuators = [self.pick(
            '<general gainprm="2" biastype="affine" biasprm="0.1 -1 -0.2"/>', '<motor gear="3"/>',
            '<position kp="7"/>', '<velocity kv="0.7"/>', '<general gear="-2"/>',
            '<damper kv="0.4" ctrlrange="0 1"/>' if self.chance(0.2) else "",
            '<general dyntype="integrator" actrange="-1 1"/>' if self.chance(0.1) else "")
            for _ in range(3)]
        joints = [f'<joint damping="{self.numbers(1, 0, 1)}" {self.spring()} {attribute}/>'
                  for attribute in ("", f'armature="{self.numbers(1, 0.05, 0.3)}"', 'axis="0 1 0"')]
        geoms = ('<geom contype="0" conaffinity="0" density="700"/>',
                 '<geom type="capsule" size="0.05 0.2"/>',
                 f'<geom density="{self.numbers(1, 100, 3000)}"/>')
        low, middle, high = (j + g + a for j, g, a in zip(joints, geoms, actuators, strict=True))
        return (f'<default>{low}<default class="middle">{middle}<default class="high">{high}'
                '<equality active="true"/></default></default></default>')

    def spring(self):
        return self.pick("", "", f'stiffness="{self.numbers(1, 0, 5)}" '
                                 f'springref="{self.angle(-1, 1)}"', 'springdamper="0.3 0.8"')

    def geom(self):
        kind = self.pick("sphere", "capsule", "cylinder", "box", "ellipsoid")
        size = self.numbers(3, 0.05, 0.3)
        mass = self.pick("", "", f'mass="{self.numbers(1, 0.2, 3)}"', 'density="400"')
        touch = 'contype="1"' if self.chance(0.02) else ""
        if kind != "sphere" and self.chance(0.3):
            size = self.numbers(self.pick(1, 2) if kind in ("box", "ellipsoid") else 1, 0.05, 0.2)
            pose = f'fromto="{self.numbers(6)}"'
        else:
            pose = f'pos="{self.numbers(3)}" {self.attitude()}'
        shell = ' shellinertia="true"' if kind != "ellipsoid" and self.chance(0.1) else ""
        group = f'group="{self.rng.integers(6)}"' if self.chance(0.3) else ""
        return f'<geom type="{kind}" size="{size}" {pose} {mass} {touch} {group}{shell}/>'

    def joint(self, kind, extra=""):
        """Return a joint; now and then one with a force that no model has."""
        name = f"j{len(self.joints)}"
        self.joints.append((name, kind))
        if kind in ("free", "ball"):
            armature = f'armature="{self.numbers(1, 0, 0.3)}"' if self.chance(0.4) else ""
            damping = self.numbers(1, 0, 1) if kind == "ball" else "0"
            align = "" if kind == "ball" else f'align="{self.pick("true", "false", "auto")}"'
            return (f'<joint name="{name}" type="{kind}" stiffness="0" springdamper="0 0" '
                    f'damping="{damping}" {armature}/>') if not align or self.chance(0.5) else (
                        f'<freejoint name="{name}" {align}/>')
        strange = "" if not self.chance(0.04) else self.pick(
            'frictionloss="0.1"', 'range="-1 1"', 'stiffness="1 2"', 'damping="0.1 0 0.2"',
            'actuatorfrcrange="-1 1"', 'stiffness="1" springyield="0.4"')
        pose = f'pos="{self.numbers(3, -0.3, 0.3)}" axis="{self.numbers(3)}"'
        ref = f'ref="{self.angle(-0.5, 0.5)}"' if self.chance(0.4) else ""
        defaults = self.pick("", "", 'class="middle"', 'class="high"')
        if "stiffness" in strange or "damping" in strange:
            defaults = ""
        return f'<joint name="{name}" type="{kind}" {defaults} {pose} {ref} {strange} {extra}/>'

    def row(self, first):
        """Return the joints of a body."""
        kinds = ["hinge", "hinge", "slide", "ball"] if not self.loops else ["hinge", "slide"]
        if first and self.chance(0.6 if self.loops else 0.35):
            return self.joint("free")
        if self.chance(0.2):
            return "".join(self.joint(self.pick("hinge", "slide"), 'armature="0.1"')
                           for _ in range(self.rng.integers(2, 4)))
        return self.joint(self.pick(*kinds))

    def body(self, depth, first=False):
        name = f"b{len(self.bodies)}"
        self.bodies.append(name)
        joints = "" if not first and self.chance(0.12) else self.row(first)
        inertia = "".join(self.geom() for _ in range(self.rng.integers(1, 3)))
        if self.chance(0.3):
            J = self.rng.normal(size=(3, 3))
            J = J @ J.T + 0.1 * np.eye(3)
            J = 0.1 * (np.trace(J) * np.eye(3) - J)
            inertia_text = self.pick(
                f'diaginertia="{self.numbers(3, 0.2, 0.3)}" {self.attitude()}',
                'fullinertia="{}"'.format(" ".join(
                    f"{J[k]:.4f}" for k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))))
            inertia += (f'<inertial pos="{self.numbers(3, -0.3, 0.3)}" '
                        f'mass="{self.numbers(1, 0.3, 3)}" {inertia_text}/>')
        if self.chance(0.2):
            inertia = f'<frame pos="{self.numbers(3)}" {self.attitude()}>{inertia}</frame>'
            inertia = inertia if "<inertial" not in inertia else ""
        inertia = inertia or '<geom size="0.2"/>'
        site = f's{len(self.sites)}'
        self.sites.append(site)
        inertia += f'<site name="{site}" pos="{self.numbers(3, -0.3, 0.3)}" {self.attitude()}/>'
        children = "".join(self.body(depth - 1) for _ in range(self.rng.integers(0, 3))
                           if depth and len(self.bodies) < (4 if self.loops else 3))
        defaults = self.pick("", "", 'childclass="middle"', 'childclass="high"')
        gravcomp = f'gravcomp="{self.numbers(1, -1, 1.5)}"' if self.chance(0.2) else ""
        return (f'<body name="{name}" pos="{self.numbers(3)}" {self.attitude()} {defaults} '
                f'{gravcomp}>'
                f"{joints}{inertia}{children}</body>")

    def tendons(self, single):
        if len(single) < 1 or not self.chance(0.4):
            return "", []
        elements = []
        for k in range(self.rng.integers(1, 3)):
            parts = "".join(f'<joint joint="{name}" coef="{self.numbers(1, 0.3, 1)}"/>'
                            for name in self.rng.choice(single, min(2, len(single)), False))
            spring_length = self.pick("", f'springlength="{self.numbers(1, 0, 1)}"',
                                      'springlength="-0.2 0.3"' if self.chance(0.2) else "")
            strange = 'armature="0.2"' if self.chance(0.05) else ""
            elements.append(f'<fixed name="t{k}" stiffness="{self.numbers(1, 0, 3)}" '
                            f'damping="{self.numbers(1, 0, 1)}" {spring_length} '
                            f'{strange}>{parts}</fixed>')
        return f"<tendon>{''.join(elements)}</tendon>", [f"t{k}" for k in range(len(elements))]

    def actuators(self, single, tendons):
        elements = []
        for k in range(self.rng.integers(0, 4) if single else 0):
            kind, extra = self.pick(
                ("motor", ""), ("position", 'kp="3"'), ("position", 'kp="4" dampratio="0.6"'),
                ("velocity", ""), ("general", 'gaintype="affine" gainprm="1 0 -0.3"'),
                ("general", 'biastype="affine" biasprm="0.5 -2 -0.1"'), ("motor", 'gear="-2"'),
                ("general", ""))
            if self.chance(0.06):
                kind, extra = self.pick(
                    ("motor", 'armature="0.2"'), ("motor", 'damping="0.3"'), ("intvelocity", ""),
                    ("motor", 'delay="0.01" nsample="10"'), ("position", 'timeconst="0.1"'),
                    ("motor", 'ctrlrange="-0.1 0.1"'), ("motor", 'forcerange="-0.1 0.1"'))
            acts = f'tendon="{self.pick(*tendons)}"' if tendons and self.chance(0.3) else (
                f'{self.pick("joint", "jointinparent")}="{self.pick(*single)}"')
            defaults = self.pick("", "", 'class="middle"', 'class="high"')
            elements.append(f'<{kind} name="a{k}" {acts} {defaults} group="{self.rng.integers(4)}" '
                            f'{extra}/>')
        return f"<actuator>{''.join(elements)}</actuator>", len(elements)

    def equalities(self, single, tendons):
        elements = []
        for _ in range(self.rng.integers(1, 3) if self.loops else int(self.chance(0.05))):
            ends = self.rng.permutation(["world", *self.bodies])[:2]
            kinds = ["connect", "connect", "sites", "weld", "weld"]
            kinds += ["joint", "joint"] if len(single) > 1 else []
            kinds += ["tendon"] if len(tendons) > 1 else []
            kind = self.pick(*kinds)
            activity = 'active="false"' if self.chance(0.1) else ""
            if kind == "connect":
                elements.append(f'<connect body1="{ends[0]}" body2="{ends[1]}" '
                                f'anchor="{self.numbers(3)}" {activity}/>')
            elif kind == "sites" and len(self.sites) > 1:
                first_end, second_end = self.rng.choice(self.sites, 2, False)
                elements.append(f'<connect site1="{first_end}" site2="{second_end}" {activity}/>')
            elif kind == "weld":
                pose = self.pick("", f'anchor="{self.numbers(3)}"', "relpose")
                if pose == "relpose":
                    pose = (f'anchor="{self.numbers(3, -.2, .2)}" '
                            f'relpose="{self.numbers(3)} {self.numbers(4)}"')
                elements.append(f'<weld body1="{ends[0]}" body2="{ends[1]}" {pose} {activity}/>')
            elif kind == "joint":
                first_end, second_end = self.rng.choice(single, 2, False)
                elements.append(f'<joint joint1="{first_end}" joint2="{second_end}" '
                                f'polycoef="{self.numbers(self.rng.integers(1, 6), -.5, .5)}" '
                                f'{activity}/>')
            elif kind == "tendon":
                elements.append('<tendon tendon1="t0" tendon2="t1" '
                                f'polycoef="{self.numbers(2, 0.2, .8)}" {activity}/>')
        return f"<equality>{''.join(elements)}</equality>"

    def robot(self):
        """Return the text of a robot with one keyframe for its qpos, qvel and ctrl to come."""
        rng, unit = self.rng, "degree" if self.degrees else "radian"
        world = self.body(2, True)
        if self.chance(0.1):
            world += '<replicate count="2" offset="1 0 0"><body pos="0 3 0"><joint class="high" ' \
                     'armature="0.1"/><geom size="0.1" pos="0.2 0 0"/></body></replicate>'
        single = [name for name, kind in self.joints if kind in ("hinge", "slide")]
        tendons, cords = self.tendons(single)
        actuators, _ = self.actuators(single, cords)
        flags = " ".join(f'{flag}="disable"' for flag in FLAGS if self.chance(0.05))
        sleep = 'sleep="enable"' if self.chance(0.01) else ""
        groups = f'actuatorgroupdisable="{rng.integers(4)}"' if self.chance(0.15) else ""
        medium = 'density="1.2"' if self.chance(0.02) else ""
        settings = " ".join(option for option, p in (
            ('inertiafromgeom="true"', 0.1), ('inertiagrouprange="0 3"', 0.1),
            ('boundmass="0.3"', 0.1), ('boundinertia="0.02"', 0.1), ('balanceinertia="true"', 0.1),
            ('alignfree="true"', 0.1), ('fusestatic="true"', 0.1), ('autolimits="false"', 0.1),
            (f'eulerseq="{self.pick("zyx", "XYZ", "zXz")}"', 0.3)) if self.chance(p))
        return (f'<mujoco model="random"><compiler angle="{unit}" {settings}/>'
                f'<option timestep="0.003" gravity="{self.numbers(3, -10, 10)}" {groups} {medium} '
                f'wind="{self.numbers(3)}"><flag {flags} {sleep}/></option>{self.classes()}'
                f"<worldbody>{world}</worldbody>{tendons}{actuators}"
                f"{self.equalities(single, cords)}</mujoco>")


def random_robot(seed, loops=False):
    """Return the text of a robot with a keyframe that begins somewhere and moves; None for none.

    Robots that MuJoCo itself does not compile have none.
    """
    rng = np.random.default_rng([seed, loops])
    text = Writer(rng, loops).robot()
    try:
        m = mujoco.MjModel.from_xml_string(text)
    except ValueError:
        return None
    d = mujoco.MjData(m)
    if not loops:
        mujoco.mj_integratePos(m, d.qpos, rng.uniform(-1, 1, m.nv), 1.0)
    state = {"qpos": d.qpos, "qvel": rng.uniform(-1, 1, m.nv) * (0.1 if loops else 1),
             "ctrl": rng.uniform(-1, 1, m.nu)}
    values = " ".join(f'{key}="{" ".join(map(repr, map(float, x)))}"' for key, x in state.items()
                      if len(x))
    return text.replace("</mujoco>", f'<keyframe><key name="k" {values}/></keyframe></mujoco>')


def exact_acceleration(m, d):
    """Return q'' of M q'' = f + Jᵀλ, J q'' = −J' q', J' q' by differences of fourth order."""
    mujoco.mj_forward(m, d)
    M = np.zeros((m.nv, m.nv))
    mujoco.mj_fullM(m, d, M)
    f = d.qfrc_passive + d.qfrc_actuator - d.qfrc_bias
    J = jacobian(m, d)
    if not len(J):
        return np.linalg.solve(M, f)
    rate, h = np.zeros(len(J)), 1e-3
    for step, weight in ((1, 8 / 12), (-1, -8 / 12), (2, -1 / 12), (-2, 1 / 12)):
        displaced = mujoco.MjData(m)
        displaced.qpos[:], displaced.qvel[:] = d.qpos, d.qvel
        mujoco.mj_integratePos(m, displaced.qpos, d.qvel, step * h)
        mujoco.mj_forward(m, displaced)
        rate += weight / h * jacobian(m, displaced) @ d.qvel
    W = J @ np.linalg.solve(M, J.T)
    forces = np.linalg.lstsq(W, -rate - J @ np.linalg.solve(M, f), rcond=1e-10)[0]
    return np.linalg.solve(M, f + J.T @ forces)


def jacobian(m, d):
    """Return the rows of equalities, dense."""
    rows = np.zeros((d.nefc, m.nv))
    if mujoco.mj_isSparse(m):
        mujoco.mju_sparse2dense(rows, d.efc_J, d.efc_J_rownnz, d.efc_J_rowadr, d.efc_J_colind)
    else:
        rows[:] = d.efc_J.reshape(d.nefc, m.nv)
    return rows[d.efc_type[:d.nefc] == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)]


def compare(path, m=None, qpos=None, qvel=None, **options):
    """Return the largest difference of accelerations, over the largest of them or 1.

    They are compared at keyframe k, or at positions and velocities in a model of MuJoCo that lacks
    some parts. Where loops move the start, MuJoCo takes the state of the model.
    """
    robot = read_mjcf_robot(path.read_text(), path)
    if m is None:
        m = mujoco.MjModel.from_xml_path(str(path))
        options["keyframe"] = "k"
    d = mujoco.MjData(m)
    if qpos is None:
        d.qpos[:], d.qvel[:], d.ctrl[:] = m.key_qpos[0], m.key_qvel[0], m.key_ctrl[0]
    else:
        d.qpos[:], d.qvel[:] = qpos, qvel
        options |= {argument: {joint.name: x[index:index + n] if n > 1 else float(x[index])
                               for k, joint in enumerate(robot.joints.values())
                               for index, n in [(start[k], getattr(joint, count))]}
                    for argument, x, start, count in (("angles", qpos, m.jnt_qposadr, "count"),
                                                      ("rates", qvel, m.jnt_dofadr, "freedoms"))}
    build = gs.Multibody.from_file(path, **options)
    names = {body.name: body for body in build._components.bodies}
    rows, arms = {}, {}  # from the origin of axes to the centre of mass
    for k, joint in enumerate(robot.joints.values()):
        v = m.jnt_dofadr[k]
        if joint.count == 1:
            suffix = ("angle", "rate") if joint.kind == "hinge" else ("travel", "speed")
            rows[v] = [f"{plain_name(joint.name)}_{quantity}"
                       for quantity in suffix], m.jnt_qposadr[k]
            continue
        body = names[plain_name(robot.bodies[joint.body].name)]
        above = robot.limb(robot.bodies[joint.body].above)
        turning = body.direction(body.angular_velocity)
        if above >= 0:
            parent = names[plain_name(robot.bodies[above].name)]
            turning = [x - y for x, y in zip(turning, parent.direction(parent.angular_velocity),
                                             strict=True)]
        for i in range(3):
            build.quantity(f"w{k}_{i}", dot(body.rotation.col(i), turning))
            rows[v + joint.freedoms - 3 + i] = [f"w{k}_{i}"], -1
            if joint.kind == "free":
                q = m.jnt_qposadr[k]
                arms[k] = turned(d.qpos[q + 3:q + 7]).T @ (
                    build._components.bodies[body].x - d.qpos[q:q + 3])
                build.quantity(f"v{k}_{i}", body.velocity[i])
                rows[v + i] = [f"v{k}_{i}"], -1
    model = build.model(redundant="leave out")
    motion = Motion(model)
    loops = m.neq and robot.equalities
    for v, (quantities, q) in rows.items():
        if loops and q >= 0:
            d.qpos[q], d.qvel[v] = (motion.value(name) for name in quantities)
    for k, joint in enumerate(robot.joints.values()):
        if loops and joint.kind == "free":
            take_free(m, d, k, motion, robot.bodies[joint.body].name, arms[k])
        elif loops and joint.kind == "ball":
            raise gs.InputError("a ball in a loop is not compared here")
    expected = exact_acceleration(m, d)
    for k, arm in arms.items():
        v, q = m.jnt_dofadr[k], m.jnt_qposadr[k]
        w, spin = d.qvel[v + 3:v + 6], expected[v + 3:v + 6]
        expected[v:v + 3] += turned(d.qpos[q + 3:q + 7]) @ (
            np.cross(spin, arm) + np.cross(w, np.cross(w, arm)))
    accelerations = np.zeros(m.nv)
    for v, (quantities, _) in rows.items():
        accelerations[v] = motion.acceleration(quantities[-1])
    return np.abs(accelerations - expected).max() / max(np.abs(expected).max(), 1.0)


def take_free(m, d, k, motion, name, arm):
    """Set qpos and qvel of a free joint from a body of the model, ``arm`` its centre."""
    coordinates = dict(zip(map(str, motion.system.q), motion.q, strict=True))
    q, v = m.jnt_qposadr[k], m.jnt_dofadr[k]
    d.qpos[q + 3:q + 7] = [coordinates[f"{name}_q{i}"] for i in range(4)]
    d.qvel[v + 3:v + 6] = w = [motion.value(f"w{k}_{i}") for i in range(3)]
    R = turned(d.qpos[q + 3:q + 7])
    d.qpos[q:q + 3] = np.array([coordinates[f"{name}_{axis}"] for axis in "xyz"]) - R @ arm
    d.qvel[v:v + 3] = [motion.value(f"v{k}_{i}") for i in range(3)] - R @ np.cross(w, arm)


def turned(q):
    R = np.zeros(9)
    mujoco.mju_quat2Mat(R, q)
    return R.reshape(3, 3)
