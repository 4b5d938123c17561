"""The bodies, joints, actuators and equalities of an MJCF file, as MuJoCo compiles them.

MuJoCo resolves defaults, classes, frames, ranges, fromto, inertia of geoms and elements that make
others; no field that moves something is passed over (``mjcf_fields``). Parts that move a robot
besides its bodies, joints and actuators (``EXTRAS``) are counted, and refused unless ``ignore`` has
their name.
"""

from __future__ import annotations

import itertools
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...core.arguments import shown
from ...core.arrays import Floats
from ...core.errors import InputError, MissingDependencyError
from ...core.extras import install
from ...core.shapes import Shape, ShapeKind
from ...core.warnings import warn
from ..multibody.initial_poses import rotation
from .mjcf_cables import MjcfCable, expand_cables, write_xml
from .mjcf_document import check_document
from .mjcf_fields import ENABLE_FLAGS, check_fields, count_refused, fields_of, flags_of
from .mjcf_meshes import MeshGeom, remove_files
from .robot_tree import Placement, Robot, RobotBody, RobotJoint, RobotLink
from .robot_visuals import Look, colour_of

__all__ = ["EXTRAS", "CompiledMjcf", "MjcfActuator", "MjcfEquality", "MjcfKey",
           "MjcfRobot", "MjcfTendon", "compile_mjcf", "read_mjcf_robot"]

#: Ignorable part of a file → its meaning.
EXTRAS = {
    "contact": "shapes that may touch",
    "limits": "ends of the range of a joint, a tendon or an effort",
    "friction": "dry friction of a joint or a tendon",
    "fluid": "a medium with density or viscosity",
    "tendon": "springs and dampers along tendons",
    "actuator": "actuators with states, or on anything but hinges, slides and fixed tendons",
    "deformable": "flexible parts",
}
#: Derivation and C grow with the number of bodies; as many as links of a URDF file.
MAX_BODIES = 500
#: Kind of a geom → the sizes that its shape has.
_DRAWN: Mapping[str, tuple[ShapeKind, tuple[int, int, int]]] = {
    "sphere": ("sphere", (0, 0, 0)), "ellipsoid": ("sphere", (0, 1, 2)), "box": ("box", (0, 1, 2)),
    "cylinder": ("disc", (0, 0, 1)), "capsule": ("bar", (0, 0, 1))}
#: Default colour of geoms, which a material replaces.
_GREY = np.array([0.5, 0.5, 0.5, 1], np.float32)


@dataclass(frozen=True, eq=False)
class MjcfActuator:
    """An effort on the length l = Σ coefficient · coordinate of joints.

    effort = gear (gain u + bias₀ + bias₁ gear l + (bias₂ + drag u) gear l̇), where u is entry
    ``control`` of MuJoCo's ctrl. ``joints`` has (name, coefficient).
    """

    name: str
    control: int
    joints: tuple[tuple[str, float], ...]
    gear: float
    gain: float
    bias: tuple[float, float, float]
    drag: float


@dataclass(frozen=True, eq=False)
class MjcfTendon:
    """A fixed tendon, of length Σ coefficient · coordinate of joints, as a spring and damper."""

    joints: tuple[tuple[str, float], ...]
    stiffness: float
    rest: float
    damping: float


@dataclass(frozen=True, eq=False)
class MjcfEquality:
    """An equality of two ends.

    ``data`` has MuJoCo's numbers: for "connect" the points; for "weld" the anchor on the second,
    then the pose of the second in the first; for "joint" and "tendon" the coefficients of a
    polynomial.
    """

    name: str
    kind: str  # "connect", "weld", "joint" or "tendon"
    ends: tuple[Any, ...]  # (body, placement in it) of bodies or sites; names of joints or tendons
    sites: bool  # whether the ends are sites
    data: Floats


@dataclass(frozen=True, eq=False)
class MjcfKey:
    """A keyframe; ``moved_mocap`` names a body that it places otherwise than the file."""

    name: str
    qpos: Floats
    qvel: Floats
    ctrl: Floats
    moved_mocap: str


@dataclass(eq=False)
class MjcfRobot(Robot):
    """Tree of bodies, and the elements of MJCF only: sites, tendons, actuators, keyframes.

    ``off`` has MuJoCo's flags that are switched off; ``sites``, by name, the number of the body and
    the placement in it. ``looks`` has groups of geoms and their shapes by the number of the body,
    −1 for the ground. ``extras`` counts the parts of ``EXTRAS`` by name.
    """

    off: frozenset[str] = frozenset()
    sites: dict[str, tuple[int, Placement]] = field(default_factory=dict)
    looks: dict[int, list[tuple[int, Look]]] = field(default_factory=dict)
    tendons: dict[str, MjcfTendon] = field(default_factory=dict)
    actuators: list[MjcfActuator] = field(default_factory=list)
    equalities: list[MjcfEquality] = field(default_factory=list)
    keys: list[MjcfKey] = field(default_factory=list)
    cables: list[MjcfCable] = field(default_factory=list)
    extras: Counter[str] = field(default_factory=Counter)


class CompiledMjcf(NamedTuple):
    """A file compiled by MuJoCo, and the contents that its compiler does not see."""

    model: Any  # mujoco.MjModel
    meshes: list[MeshGeom]
    cables: list[MjcfCable]


def compile_mjcf(text: str, path: Path) -> CompiledMjcf:
    """Compile a text that was read from a file; cables are compiled as chains of bodies.

    Raises InputError with the reason and the cure, MuJoCo's own words among them;
    MissingDependencyError without MuJoCo.
    """
    top, files = check_document(text, path)
    cables = expand_cables(top)
    if cables:
        text = write_xml(top)
    try:
        import mujoco
    except ImportError:
        raise MissingDependencyError(
            f"The file {str(path)!r} is MJCF, which MuJoCo's compiler reads, and it is not "
            f"installed; `pip install \"gyrospark[robots]\"` or {install('robots')} cures it."
        ) from None
    with warnings.catch_warnings(record=True) as captured:
        warnings.simplefilter("always")
        try:
            spec = mujoco.MjSpec.from_string(text, include=files)
            meshes = remove_files(mujoco, spec, path.parent)
            model = spec.compile()
        # a ValueError, too, but with a sentence of its own
        except InputError:
            raise
        except (ValueError, RuntimeError, MemoryError) as error:
            # MuJoCo's lines in one, with a number for an element without a name
            reason = ", ".join(" ".join(line.split()).replace("name '', id", "number").rstrip(".,")
                               for line in str(error).splitlines() if line)
            raise InputError(f"MuJoCo does not compile it: {reason}; correct it.") from None
    for message in dict.fromkeys(str(warning.message) for warning in captured):
        warn(f"MuJoCo warns of {str(path)!r}: {message}.")
    check_fields(fields_of(model), mujoco.__version__)
    return CompiledMjcf(model, meshes, cables)


def read_mjcf_robot(text: str, path: Path) -> MjcfRobot:
    """Return the bodies, joints and actuators of the text of an MJCF file.

    Raises InputError with the fault of the text and its cure; MissingDependencyError without
    MuJoCo.
    """
    compiled = compile_mjcf(text, path)
    meshes = {mesh.name: mesh for mesh in compiled.meshes}
    robot = _Reader(compiled.model, meshes, path.stem).read()
    robot.cables = compiled.cables
    return robot


class _Reader:
    """Reader of a compiled model, ``m`` as in MuJoCo's own programs.

    MuJoCo's body 0 is the world, here the ground with the number −1, so that numbers differ by 1.
    """

    def __init__(self, model: Any, meshes: Mapping[str, MeshGeom], name: str) -> None:
        """Read options and flags of a compiled model; refuse flags that no model here has.

        ``meshes`` are the geoms of meshes by name; ``name`` is the robot's name by default.
        """
        import mujoco

        self.m, self.meshes, self.mujoco = model, meshes, mujoco
        # the first of MuJoCo's names is the model's, "MuJoCo Model" by default
        options, title = model.opt, model.names.split(b"\0")[0].decode()
        disabled = flags_of(options.disableflags, _members(mujoco.mjtDisableBit))
        enabled = flags_of(options.enableflags, _members(mujoco.mjtEnableBit))
        if "" in disabled or not enabled <= ENABLE_FLAGS:
            flags = ", ".join(sorted(enabled - ENABLE_FLAGS)) or "unknown"
            raise InputError(f"it has a <flag> of <option> that no model here has, {flags}; leave "
                             "it out.")
        if "constraint" in disabled:
            disabled |= {"equality", "limit", "contact", "frictionloss"}
        # gravity compensation is a passive force of MuJoCo, and those end with both of these flags
        if {"spring", "damper"} <= disabled or not model.ngravcomp:
            disabled.add("gravcomp")
        self.robot = MjcfRobot(
            title if title not in ("", "MuJoCo Model") else name, "an MJCF", "body",
            gravity=np.zeros(3) if "gravity" in disabled else np.array(options.gravity),
            dt=float(options.timestep), off=frozenset(disabled))

    def read(self) -> MjcfRobot:
        """Return the robot; elements that have no counterpart here are counted in ``extras``."""
        m, robot = self.m, self.robot
        if m.nbody > MAX_BODIES + 1:
            raise InputError(f"it has {m.nbody - 1} bodies and at most {MAX_BODIES} are allowed.")
        robot.extras = count_refused(m, robot.off)
        # body 0 of MuJoCo is the world, here the ground, −1
        robot.looks[-1] = self._looks(0)
        for body in range(1, m.nbody):
            self._add_body(body)
        for k in range(m.nsite):
            name = m.site(k).name
            # loop joints of another file refer to sites by name
            if name:
                robot.sites[name] = self._body_place(
                    m.site_bodyid[k], m.site_pos[k], m.site_quat[k])
        for k in range(m.ntendon):
            self._add_tendon(k)
        for k in range(m.nactuator):
            self._add_actuator(k)
        if "equality" not in robot.off:
            for k in range(m.neq):
                # one that is not active at the start holds nothing
                if m.eq_active0[k]:
                    self._add_equality(k)
        for k in range(m.nkey):
            self._add_keyframe(k)
        if "contact" not in robot.off:
            self._count_contacts()
        return robot

    def _body_place(self, body: int, x: Floats, q: Floats) -> tuple[int, Placement]:
        """Return the number of a body here, and the placement at x with the quaternion q."""
        return int(body) - 1, Placement(np.array(x), rotation(q))

    def _member(self, enumeration: str, number: int) -> str:
        """Return the name of a member of an enumeration: "hinge" of mjtJoint."""
        members = {value: name for name, value in _members(getattr(self.mujoco, enumeration))}
        return members.get(int(number), "").partition("_")[2].lower()

    @cached_property
    def _joint_names(self) -> list[str]:
        """Names of all joints; a joint without one is called BODY_joint, BODY_joint1, ….

        The number counts the nameless and named joints of the body before it.
        """
        m, counts, substitutes = self.m, Counter[int](), []
        for k in range(m.njnt):
            body = int(m.jnt_bodyid[k])
            substitutes.append(f"{self._body_names[body]}_joint{counts[body] or ''}")
            counts[body] += 1
        return _unique([m.joint(k).name for k in range(m.njnt)], substitutes)

    @cached_property
    def _body_names(self) -> list[str]:
        """The names of all bodies, the world first; those without a name are numbered."""
        return _fill_names([self.m.body(k).name for k in range(self.m.nbody)], "body", first=0)

    @cached_property
    def _tendon_names(self) -> list[str]:
        """The names of all tendons; those without a name are tendon1, tendon2, …."""
        names = [self.m.tendon(k).name for k in range(self.m.ntendon)]
        return _fill_names(names, "tendon", first=1)

    @cached_property
    def _actuator_names(self) -> list[str]:
        """The names of all actuators; those without a name are u1, u2, …."""
        return _fill_names([self.m.actuator(k).name for k in range(self.m.nactuator)], "u", first=1)

    # ------------------------------------------------------------ bodies

    def _add_body(self, k: int) -> None:
        """Add a body: its inertia about the centre of mass in its own axes, and its joints."""
        m, robot = self.m, self.robot
        name, R = self._body_names[k], rotation(m.body_iquat[k])
        link = RobotLink(name, float(m.body_mass[k]), np.array(m.body_ipos[k]),
                         R @ np.diag(m.body_inertia[k]) @ R.T)
        above, placement = self._body_place(m.body_parentid[k], m.body_pos[k], m.body_quat[k])
        first = m.body_jntadr[k]
        joints = [self._joint(j) for j in range(first, first + m.body_jntnum[k])]
        gravcomp = 0.0 if "gravcomp" in robot.off else float(m.body_gravcomp[k])
        robot.bodies.append(RobotBody(name, above, placement, link, gravcomp, joints))
        robot.looks[k - 1] = self._looks(k)
        robot.joints |= {joint.name: joint for joint in joints}

    def _joint(self, k: int) -> RobotJoint:
        """Return joint k; springs, dampers and ranges that a flag disables are left out.

        Raises InputError for gravity compensation by an actuator where none acts.
        """
        m, disabled, kind = self.m, self.robot.off, self._member("mjtJoint", self.m.jnt_type[k])
        # the first coordinate and the first rate of the joint
        q, v, has_coordinate = m.jnt_qposadr[k], m.jnt_dofadr[k], kind in ("hinge", "slide")
        if m.jnt_actgravcomp[k] and m.body_gravcomp.any() and (
                "actuation" in disabled or not m.nactuator):
            raise InputError(
                f"joint {shown(self._joint_names[k])} has actuatorgravcomp, and "
                f"{'actuation is disabled' if m.nactuator else 'the file has no actuator'}, so "
                "that MuJoCo compensates nothing there; leave actuatorgravcomp or gravcomp out.")
        is_limited = m.jnt_limited[k] and kind != "free" and "limit" not in disabled
        low, high = map(float, m.jnt_range[k])
        return RobotJoint(
            name=self._joint_names[k], kind=kind,
            body=int(m.jnt_bodyid[k]) - 1,  # body 0 of MuJoCo is the world, −1 here
            axis=np.array(m.jnt_axis[k]), point=np.array(m.jnt_pos[k]),
            ref=float(m.qpos0[q]) if has_coordinate else 0.0,
            stiffness=0.0 if "spring" in disabled else float(m.jnt_stiffness[k]),
            rest=float(m.qpos_spring[q]) if has_coordinate else 0.0,
            damping=self._damping(f"joint {shown(self._joint_names[k])}", m.dof_damping[v]),
            armature=float(m.dof_armature[v]), range=(low, high) if is_limited else None)

    def _damping(self, owner: str, coefficient: float) -> float:
        """Return a damper's coefficient, or 0 where a flag disables dampers; refuse one below 0."""
        if coefficient < 0:
            raise InputError(f"{owner} has damping {coefficient:g}, which would add energy; write "
                             "0 or more.")
        return 0.0 if "damper" in self.robot.off else float(coefficient)

    def _looks(self, body: int) -> list[tuple[int, Look]]:
        """Return (group, look) of the geoms of a body, without planes and invisible ones."""
        m, looks = self.m, []
        for k in range(m.ngeom):
            # a geom in MuJoCo's default grey has the colour of its material, if it has one
            material = int(m.geom_matid[k])
            rgba = m.geom_rgba[k]
            if material >= 0 and np.array_equal(rgba, _GREY):
                rgba = m.mat_rgba[material]
            if m.geom_bodyid[k] != body or not rgba[3]:
                continue
            _, placement = self._body_place(body, m.geom_pos[k], m.geom_quat[k])
            colour = "" if np.array_equal(rgba, _GREY) else colour_of(rgba.tolist())
            mesh, kind = self.meshes.get(m.geom(k).name), self._member("mjtGeom", m.geom_type[k])
            if mesh is not None and mesh.shape is not None:
                look = placement.then(mesh.inner), mesh.shape(colour)
            elif mesh is None and kind in _DRAWN:
                shape_kind, sizes = _DRAWN[kind]
                size = np.array(m.geom_size[k])[[*sizes]]
                look = placement, Shape(shape_kind, size, colour=colour)
            else:
                continue
            looks.append((int(m.geom_group[k]), look))
        return looks

    def _count_contacts(self) -> None:
        """Count, as extras, the bodies whose geoms may collide with geoms of another body.

        Two geoms collide if the type of one is among the affinities of the other; parent and child
        do not, unless ``filterparent`` is off.
        """
        m = self.m
        # bodies that are welded together are one; each kind of geom of a body counts once
        geom_kinds = {(int(m.body_weldid[m.geom_bodyid[k]]), int(m.geom_contype[k]),
                       int(m.geom_conaffinity[k])) for k in range(m.ngeom)}
        colliding: set[int] = set()
        for (a, type_a, affinity_a), (b, type_b, affinity_b) in combinations(
                sorted(geom_kinds), 2):
            if a == b or not (type_a & affinity_b or type_b & affinity_a):
                continue
            # 0 is the world, with which its children do collide
            are_neighbours = 0 not in (a, b) and "filterparent" not in self.robot.off and (
                m.body_weldid[m.body_parentid[a]] == b or m.body_weldid[m.body_parentid[b]] == a)
            if not are_neighbours:
                colliding |= {a, b}
        self.robot.extras["contact"] += len(colliding)

    # ------------------------------------------------------------ tendons, actuators, equalities

    def _add_tendon(self, k: int) -> None:
        """Add a tendon: a fixed one is Σ c_i q_i of joints; a spatial one is counted as extra."""
        m, disabled, extras = self.m, self.robot.off, self.robot.extras
        wraps = range(m.tendon_adr[k], m.tendon_adr[k] + m.tendon_num[k])
        is_fixed = all(self._member("mjtWrap", m.wrap_type[wrap]) == "joint" for wrap in wraps)
        low, high = map(float, m.tendon_lengthspring[k])
        stiffness = 0.0 if "spring" in disabled else float(m.tendon_stiffness[k])
        damping = self._damping(f"tendon {shown(self._tendon_names[k])}", m.tendon_damping[k])
        # a spring that is slack between two lengths, and springs and dampers of spatial tendons
        extras["tendon"] += bool((stiffness and (not is_fixed or low != high))
                                 or (damping and not is_fixed))
        self.robot.tendons[self._tendon_names[k]] = MjcfTendon(
            tuple((self._joint_names[m.wrap_objid[wrap]], float(m.wrap_prm[wrap]))
                  for wrap in wraps) if is_fixed else (),
            stiffness=stiffness if low == high else 0.0, rest=low,
            damping=damping if is_fixed else 0.0)

    def _add_actuator(self, k: int) -> None:
        """Add actuator k, or count it as an extra part if it is none of ``MjcfActuator``.

        Actuators with states, plugins, delays or an inertia of their own are extra parts, and so
        are those that act on anything but hinges, slides and fixed tendons.
        """
        m, robot = self.m, self.robot
        group = int(m.actuator_group[k])
        has_inertia_or_damper = (m.actuator_armature[k] or m.actuator_damping[k]
                                 or m.actuator_dampingpoly[k].any())
        # a disabled actuator does nothing; its armature and damping act nevertheless; groups from 0
        # to 30 have a bit in ``disableactuator``
        if not has_inertia_or_damper and ("actuation" in robot.off or (
                0 <= group <= 30 and m.opt.disableactuator >> group & 1)):
            return
        joints = self._driven_joints(k)
        gain_law, bias_law = (
            self._member(f"mjt{law.title()}", getattr(m, f"actuator_{law}type")[k])
            for law in ("gain", "bias"))
        gain, bias = m.actuator_gainprm[k], m.actuator_biasprm[k]
        is_extra = (
            m.actuator_dyntype[k] or m.actuator_plugin[k] >= 0 or m.actuator_delay[k]
            or m.actuator_history[k].any() or has_inertia_or_damper
            or (m.actuator_ctrlnum[k], m.actuator_outnum[k]) != (1, 1)
            # gain[1] makes the gain depend on the length, gain[2] on the rate, which is ``drag``
            or gain_law not in ("fixed", "affine") or (gain_law == "affine" and gain[1])
            or bias_law not in ("none", "affine"))
        if is_extra or not joints:
            robot.extras["actuator"] += 1
            return
        control = int(m.actuator_ctrladr[k])
        robot.extras["limits"] += bool(m.actuator_forcelimited[k] or (
            m.actuator_ctrllimited[control] and "clampctrl" not in robot.off))
        b0, b1, b2 = map(float, bias[:3] if bias_law == "affine" else np.zeros(3))
        robot.actuators.append(MjcfActuator(
            self._actuator_names[k], control, joints,
            gear=float(m.actuator_gear[m.actuator_outadr[k]][0]), gain=float(gain[0]),
            bias=(b0, b1, b2), drag=float(gain[2]) if gain_law == "affine" else 0.0))

    def _driven_joints(self, k: int) -> tuple[tuple[str, float], ...]:
        """Return (name, coefficient) of the joints whose sum actuator k drives; () for others."""
        m, robot = self.m, self.robot
        kind, target = self._member("mjtTrn", m.actuator_trntype[k]), int(m.actuator_trnid[k][0])
        if kind == "tendon":
            return [*robot.tendons.values()][target].joints
        if kind in ("joint", "jointinparent"):
            joint = self._joint_names[target]
            # ball and free joints have no single coordinate along which to act
            if robot.joints[joint].kind in ("hinge", "slide"):
                return ((joint, 1.0),)
        return ()

    def _add_equality(self, k: int) -> None:
        """Add equality k with its two ends: placements of bodies or sites, joints or tendons.

        Raises InputError for an equality of other things.
        """
        m, robot = self.m, self.robot
        kind, data = self._member("mjtEq", m.eq_type[k]), np.array(m.eq_data[k])
        name = m.equality(k).name or f"equality{k + 1}"
        numbers = [int(n) for n in (m.eq_obj1id[k], m.eq_obj2id[k])]
        sites = self._member("mjtObj", m.eq_objtype[k]) == "site"
        if kind in ("connect", "weld"):
            joined_parts: list[Any] = [
                self._body_place(m.site_bodyid[n], m.site_pos[n], m.site_quat[n])
                if sites else (n - 1, Placement(np.zeros(3), np.eye(3))) for n in numbers]
        elif kind in ("joint", "tendon"):
            names = self._joint_names if kind == "joint" else [*robot.tendons]
            joined_parts = [names[n] for n in numbers if n >= 0]
        # flexible parts are counted as deformable
        elif kind.startswith("flex"):
            return
        else:
            raise InputError(f"<{kind}> {shown(name)} is no equality of bodies, joints or tendons; "
                             "remove it.")
        robot.equalities.append(MjcfEquality(name, kind, tuple(joined_parts), sites, data))

    def _add_keyframe(self, k: int) -> None:
        """Add a keyframe; a moved mocap body is noted, as it is refused if the keyframe is chosen.
        """
        m = self.m
        positions, attitudes = m.key_mpos[k].reshape(-1, 3), m.key_mquat[k].reshape(-1, 4)
        moved_mocap = ""
        for b in range(m.nbody):
            # −1 for a body that is no mocap
            mocap = m.body_mocapid[b]
            if mocap >= 0 and not (np.array_equal(positions[mocap], m.body_pos[b])
                                   and np.array_equal(attitudes[mocap], m.body_quat[b])):
                moved_mocap = m.body(b).name
                break
        self.robot.keys.append(MjcfKey(
            m.key(k).name, np.array(m.key_qpos[k]), np.array(m.key_qvel[k]),
            np.array(m.key_ctrl[k]), moved_mocap))


def _fill_names(names: Sequence[str], kind: str, first: int) -> list[str]:
    """Return names of which empty ones are replaced by the kind and a number, ``first`` or more."""
    return _unique(names, [f"{kind}{number}" for number in range(first, first + len(names))])


def _unique(names: Sequence[str], substitutes: Sequence[str]) -> list[str]:
    """Return names of which empty ones are replaced by substitutes; one in use gets a number."""
    used_names = {*names}
    unique_names = []
    for name, substitute in zip(names, substitutes, strict=True):
        candidates = (f"{substitute}_{count}" if count else substitute
                      for count in itertools.count())
        unique_names.append(name or next(x for x in candidates if x not in used_names))
        used_names.add(unique_names[-1])
    return unique_names


def _members(enumeration: Any) -> list[tuple[str, int]]:
    """Return name and number of each member of one of MuJoCo's enumerations."""
    return [(name, int(value)) for name, value in enumeration.__members__.items()]
