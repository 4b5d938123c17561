"""The bodies, joints, actuators and equalities that an MJCF file describes, each number checked.

What moves a robot otherwise than its bodies, joints and actuators (``EXTRAS``) is never passed over
unasked: it is counted, and refused unless its name is among those to ignore. What only looks,
measures or configures a solver moves nothing and is not read.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import proposal, shown
from ...core.errors import InputError
from ...core.mesh_files import read_triangles
from .bounded_xml import Element
from .closed_mesh import Volume, convex_hull, mesh_volume
from .mjcf_document import Document, Given
from .mjcf_geoms import Geom, geom_mass, geom_shape
from .urdf_robot import IDENTITY, Placement, RobotLink
from .urdf_tree import combine

__all__ = ["ACTUATORS", "COMMON", "EXTRAS", "MjcfActuator", "MjcfBody", "MjcfEquality",
           "MjcfJoint", "MjcfKey", "MjcfRobot", "MjcfTendon",
           "read_mjcf_robot"]

Array = NDArray[np.float64]

#: Ignorable part of a file → its meaning.
EXTRAS = {
    "contact": "shapes that may touch",
    "limits": "ends of the range of a joint, a tendon or an effort",
    "friction": "dry friction of a joint or a tendon",
    "fluid": "a medium with density, viscosity or wind",
    "tendon": "springs and dampers along tendons",
    "actuator": "actuators with states, or on other things than joints",
    "deformable": "flexible parts",
}
MAX_BODIES = 500
SECTIONS = ("compiler", "option", "size", "statistic", "visual", "asset", "default", "worldbody",
            "contact", "deformable", "equality", "tendon", "actuator", "sensor", "keyframe",
            "custom", "extension")
BODY_PARTS = ("inertial", "joint", "freejoint", "geom", "site", "camera", "light", "body", "frame")
#: What makes bodies out of others.
MACROS = ("replicate", "attach", "composite", "flexcomp", "plugin")
#: Actuators that are an effort on a coordinate.
ACTUATORS = ("general", "motor", "position", "velocity", "damper", "intvelocity", "cylinder",
             "muscle", "adhesion", "plugin", "dcmotor")
#: Attributes that a default of one kind of actuator sets for all.
_SHARED = ("gear", "ctrllimited", "ctrlrange", "forcelimited", "forcerange")
COMMON: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    kind: {other: _SHARED for other in ACTUATORS if other != kind} for kind in ACTUATORS}
#: Default colour of geoms in MuJoCo; a material replaces it.
_GREY = (0.5, 0.5, 0.5, 1.0)
KINDS = ("hinge", "slide", "ball", "free")


@dataclass(eq=False)
class MjcfJoint:
    """A joint: its axis and point in the axes of its body, its value where the file places it."""

    name: str
    kind: str
    body: int
    axis: Array
    point: Array
    ref: float
    stiffness: float
    rest: float
    damping: float
    armature: float
    range: tuple[float, float] | None
    given: Given

    @property
    def count(self) -> int:
        """How many numbers of qpos it has."""
        return {"free": 7, "ball": 4}.get(self.kind, 1)


@dataclass(eq=False)
class MjcfBody:
    """A body where the file places it in the one above, whose number is ``above``, −1 for space."""

    name: str
    above: int
    place: Placement
    link: RobotLink
    gravcomp: float
    joints: list[MjcfJoint]
    geoms: list[Geom]


@dataclass(frozen=True, eq=False)
class MjcfActuator:
    """An effort on Σ coefficient · coordinate of joints, the length of what it acts on.

    effort = gear (gain u + bias₀ + bias₁ gear length + (bias₂ + drag u) gear rate); with a damping
    ``ratio`` ζ, bias₂ = −2 ζ √(−bias₁ m), m the effective inertia 1/(J M⁻¹ Jᵀ).
    """

    name: str
    joints: tuple[tuple[str, float], ...]
    gear: float
    gain: float
    bias: tuple[float, float, float]
    drag: float
    ratio: float = 0.0


@dataclass(frozen=True, eq=False)
class MjcfTendon:
    """A fixed tendon, of length Σ coefficient · coordinate of joints, as a spring and damper."""

    joints: tuple[tuple[str, float], ...]
    stiffness: float
    rest: float
    damping: float


@dataclass(frozen=True, eq=False)
class MjcfEquality:
    """An equality between what ``ends`` name: bodies, sites, joints or tendons."""

    name: str
    kind: str
    ends: tuple[str, ...]
    sites: bool
    given: Given


@dataclass(frozen=True, eq=False)
class MjcfKey:
    """A keyframe."""

    name: str
    given: Given


@dataclass(eq=False)
class MjcfRobot:
    """All that is read; bodies come after those they hang on."""

    name: str
    document: Document
    bodies: list[MjcfBody] = field(default_factory=list)
    joints: dict[str, MjcfJoint] = field(default_factory=dict)
    sites: dict[str, tuple[int, Placement]] = field(default_factory=dict)
    geoms: list[Geom] = field(default_factory=list)
    tendons: dict[str, MjcfTendon] = field(default_factory=dict)
    actuators: list[MjcfActuator] = field(default_factory=list)
    equalities: list[MjcfEquality] = field(default_factory=list)
    keys: list[MjcfKey] = field(default_factory=list)
    gravity: Array = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    dt: float = 0.002
    off: frozenset[str] = frozenset()
    extras: Counter[str] = field(default_factory=Counter)
    limits: float | None = None  # stiffness of the ends of ranges of joints

    def limb(self, body: int) -> int:
        """Return the body it moves with: the nearest one at or above that has joints."""
        while body >= 0 and not self.bodies[body].joints:
            body = self.bodies[body].above
        return body


def read_mjcf_robot(document: Document, name: str) -> MjcfRobot:
    """Return what a document describes.

    Raises
    ------
    InputError
        With the line, what is wrong with it, and the cure.
    """
    return _Reader(document, name).read()


class _Reader:
    def __init__(self, document: Document, name: str) -> None:
        self.document = document
        self.robot = MjcfRobot(document.top.attributes.get("model", name) or name, document)
        self.touching: set[tuple[int, int, int]] = set()
        self.meshes = {self._mesh_name(e): e for e in document.sections("asset")
                       if e.name == "mesh"}
        self.volumes: dict[str, Volume] = {}
        self.masses: list[RobotLink] = []  # of the geoms of the body that is being read
        self.weigh = False  # whether they give it its mass
        self.moves = False  # whether it does

    def read(self) -> MjcfRobot:
        robot, document = self.robot, self.document
        for element in document.top.children:
            if element.name not in SECTIONS:
                raise InputError(f"line {element.line}: <{shown(element.name)[1:-1]}> is no part "
                                 f"of MJCF{proposal(element.name, SECTIONS)}; remove it.")
        self._options()
        for element in document.top.all("worldbody"):
            self._parts(element, -1, IDENTITY, "main")
        if len(robot.bodies) > MAX_BODIES:
            raise InputError(f"it has {len(robot.bodies)} bodies and at most {MAX_BODIES} are "
                             "allowed.")
        self._adjust_masses()
        robot.extras["deformable"] += len([*document.sections("deformable")])
        for element in document.sections("tendon"):
            self._tendon(element)
        for element in document.sections("actuator"):
            self._actuator(element)
        for element in document.sections("equality"):
            self._equality(element)
        for element in document.sections("keyframe"):
            given = document.given(element)
            robot.keys.append(MjcfKey(given.text("name", ""), given))
        self._contacts()
        return robot

    # ------------------------------------------------------------ options

    def _options(self) -> None:
        robot, off = self.robot, set()
        for element in self.document.top.all("option"):
            given = self.document.given(element)
            robot.gravity = given.vector("gravity", (*robot.gravity,))
            robot.dt = given.number("timestep", robot.dt)
            robot.extras["fluid"] += sum(
                any(given.numbers(key, 1, 3, [0.0])) for key in ("density", "viscosity", "wind"))
            for flags in element.all("flag"):
                off |= {key for key, e in flags.attributes.items() if e == "disable"}
        robot.off = frozenset(off)
        if "gravity" in off:
            robot.gravity = np.zeros(3)

    # ------------------------------------------------------------ bodies

    def _parts(self, element: Element, body: int, place: Placement, inherited: str) -> None:
        """Read what is in <body>, <worldbody> or <frame>, which is at ``place`` in the body."""
        for child in element.children:
            if child.name in MACROS:
                raise InputError(f"line {child.line}: <{child.name}> makes parts of others; save "
                                 "the file with them written out, as MuJoCo does.")
            if child.name not in BODY_PARTS:
                raise InputError(f"line {child.line}: <{shown(child.name)[1:-1]}> is no part of a "
                                 f"body{proposal(child.name, BODY_PARTS)}; remove it.")
            if child.name == "frame":
                at = place.then(self.document.given(child).place(self.document.settings))
                self._parts(child, body, at, self.document.inherit(child, inherited))
            elif child.name == "body":
                self._body(child, body, place, self.document.inherit(child, inherited))
            elif child.name in ("joint", "freejoint"):
                self._joint(child, body, place, inherited)
            elif child.name == "geom":
                self._geom(child, body, place, inherited)
            elif child.name == "site" and "name" in child.attributes:
                given = self.document.given(child, inherited)
                at = Placement(np.zeros(3), np.eye(3)) if "fromto" in given else given.place(
                    self.document.settings)
                self.robot.sites[given.text("name")] = body, place.then(at)

    def _body(self, element: Element, above: int, place: Placement, inherited: str) -> None:
        given = self.document.given(element)
        number = len(self.robot.bodies)
        name = given.text("name", "") or f"body{number + 1}"
        if any(body.name == name for body in self.robot.bodies):
            raise given.error("is there twice; rename one of them.")
        body = MjcfBody(name, above, place.then(given.place(self.document.settings)),
                        RobotLink(name, 0.0, np.zeros(3), np.zeros((3, 3))),
                        given.number("gravcomp", 0.0), [], [])
        self.robot.bodies.append(body)
        kept, self.masses = self.masses, []
        inertial = element.first("inertial")
        from_geoms = self.document.settings.from_geoms
        weigh, moves = self.weigh, self.moves
        self.moves = moves or any(_joints(element))
        self.weigh = (self.moves or self.document.settings.total_mass > 0) and (
            from_geoms == "true" or (from_geoms == "auto" and inertial is None))
        self._parts(element, number, IDENTITY, inherited)
        if inertial is not None and from_geoms != "true":
            body.link = self._inertial(self.document.given(inertial), name)
        elif self.masses:
            mass, centre, inertia = combine([(IDENTITY, link) for link in self.masses])
            body.link = RobotLink(name, mass, centre, inertia)
        self.masses, self.weigh, self.moves = kept, weigh, moves

    def _inertial(self, given: Given, name: str) -> RobotLink:
        place = given.place(self.document.settings)
        mass = given.number("mass")
        if mass < 0:
            raise given.error(f"has the mass {mass:g}; it must be above 0.")
        if "fullinertia" in given:
            xx, yy, zz, xy, xz, yz = given.numbers("fullinertia", 6)
            J = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        else:
            J = np.diag(given.numbers("diaginertia", 3, default=[0.0, 0.0, 0.0]))
        least = float(np.linalg.eigvalsh(J).min())
        if least < -1e-9 * float(np.abs(J).max()):
            raise given.error(f"has the principal moment {least:.3g}; none may be below 0.")
        return RobotLink(name, mass, place.x, place.R @ J @ place.R.T)

    def _geom(self, element: Element, body: int, place: Placement, inherited: str) -> None:
        given = self.document.given(element, inherited)
        shape = geom_shape(given, self.document.settings)
        if shape.mesh:
            shape = self._with_file(given, shape)
        if "material" in given and shape.colour in (None, _GREY):
            shape = replace(shape, colour=self._material(given.text("material")))
        if body >= 0 and self.weigh:
            link = geom_mass(given, shape, self.document.settings, self._volume)
            if link is not None:
                self.masses.append(_moved(link, place))
        masks = given.whole("contype", 1), given.whole("conaffinity", 1)
        if any(masks):
            self.touching.add((body, *masks))
        at = place.then(Placement(shape.position, shape.rotation))
        geoms = self.robot.geoms if body < 0 else self.robot.bodies[body].geoms
        geoms.append(shape.moved(at.x, at.R))

    def _joint(self, element: Element, body: int, place: Placement, inherited: str) -> None:
        robot = self.robot
        given = self.document.given(element, inherited)
        if body < 0:
            raise given.error("is in <worldbody>, which does not move; put it into a body.")
        kind = "free" if element.name == "freejoint" else given.choice("type", KINDS, "hinge")
        owner = robot.bodies[body]
        name = given.text("name", "") or f"{owner.name}_joint{len(owner.joints) or ''}"
        if name in robot.joints:
            raise given.error("is there twice; rename one of them.")
        if kind == "free" and (owner.above >= 0 or owner.joints):
            raise given.error("is free, which is for bodies of <worldbody> without another joint.")
        turns = self.document.settings.angle if kind == "hinge" else 1.0
        stiffness, damping = (self._linear(given, key) for key in ("stiffness", "damping"))
        if np.any(given.numbers("springdamper", 2, default=[0.0, 0.0])):
            raise given.error("has springdamper; write stiffness and damping.")
        if robot.off & {"passive", "spring"}:
            stiffness = 0.0
        if robot.off & {"passive", "damper"}:
            damping = 0.0
        ref = given.number("ref", 0.0) * turns if kind in ("hinge", "slide") else 0.0
        joint = MjcfJoint(
            name, kind, body, place.R @ given.direction("axis", (0.0, 0.0, 1.0)),
            place.x + place.R @ given.vector("pos", (0.0, 0.0, 0.0)), ref, stiffness,
            given.number("springref", 0.0) * turns, damping, given.number("armature", 0.0),
            self._range(given, kind, turns), given)
        if "springref" not in given:
            joint.rest = 0.0
        if joint.armature < 0:
            raise given.error(f"has armature={joint.armature:g}; it must be 0 or more.")
        owner.joints.append(joint)
        robot.joints[name] = joint
        robot.extras["limits"] += self._limited(given, "actuatorfrclimited", "actuatorfrcrange")
        if "frictionloss" not in robot.off:
            robot.extras["friction"] += given.number("frictionloss", 0.0) != 0

    def _linear(self, given: Given, key: str) -> float:
        first, *higher = given.numbers(key, 1, 3, [0.0])
        if any(higher):
            raise given.error(f"has {key}={given.text(key)!r}, a polynomial; write its first "
                              "number alone.")
        if first < 0:
            raise given.error(f"has {key}={first:g}; it must be 0 or more.")
        return first

    def _range(self, given: Given, kind: str, turns: float) -> tuple[float, float] | None:
        if kind == "free" or "limit" in self.robot.off or not self._limited(
                given, "limited", "range"):
            return None
        lower, upper = given.numbers("range", 2, default=[0.0, 0.0])
        return lower * turns, upper * turns

    def _limited(self, given: Given, flag: str, key: str) -> bool:
        said = given.choice(flag, ("true", "false", "auto"), "auto")
        return said == "true" or (said == "auto" and key in given
                                  and self.document.settings.autolimits)

    # ------------------------------------------------------------ meshes and masses

    def _mesh_name(self, element: Element) -> str:
        given = self.document.given(element)
        file = given.text("file", "")
        return given.text("name", "") or file.replace("\\", "/").rpartition("/")[2].rpartition(
            ".")[0] or file

    def _with_file(self, given: Given, shape: Geom) -> Geom:
        """Return the geom with the file and the scale of its mesh."""
        if shape.mesh not in self.meshes:
            raise given.error(f"has mesh={shown(shape.mesh)}, which no <asset> has"
                              f"{proposal(shape.mesh, self.meshes)}; correct it.")
        mesh = self.document.given(self.meshes[shape.mesh])
        path = Path(self.document.settings.meshes) / mesh.text("file", "")
        R, x = self._reference(mesh)
        return replace(shape, file=str(path) if "file" in mesh else "",
                       inner=Placement(-R.T @ x, R.T),
                       scale=tuple(mesh.numbers("scale", 3, default=[1.0] * 3)))

    def _reference(self, mesh: Given) -> tuple[Array, Array]:
        """Return refquat as a matrix, and refpos: the axes of a mesh in those of its file."""
        turned = mesh.numbers("refquat", 4, default=[1.0, 0, 0, 0])
        at = Given(mesh.tag, mesh.line, {"quat": " ".join(map(str, turned))})
        return at.place(self.document.settings).R, mesh.vector("refpos", (0.0, 0.0, 0.0))

    def _material(self, name: str) -> tuple[float, ...] | None:
        """Return the colour of a material of <asset> and its texture, if it has one."""
        assets = {(e.name, e.attributes.get("name", "")): e
                  for e in self.document.sections("asset")}
        try:
            given = self.document.given(assets["material", name])
            colour = given.numbers("rgba", 4, default=[1.0] * 4)
            if "texture" in given:
                texture = self.document.given(assets["texture", given.text("texture")])
                if "builtin" not in texture:
                    return tuple(colour) if "rgba" in given else None
                tint = texture.numbers("rgb1", 3, default=[0.8] * 3)
                colour = [*np.multiply(colour[:3], tint), colour[3]]
            return tuple(colour)
        except (InputError, KeyError):
            return None

    def _volume(self, geom: Given, name: str) -> Volume:
        """Return the volume of a mesh of <asset>."""
        if name not in self.meshes:
            raise geom.error(f"has mesh={shown(name)}, which no <asset> has; correct it.")
        if name not in self.volumes:
            self.volumes[name] = self._measure(self.document.given(self.meshes[name]))
        return self.volumes[name]

    def _measure(self, given: Given) -> Volume:
        settings = self.document.settings
        way = given.choice("inertia", ("convex", "exact", "legacy", "shell"),
                           "exact" if settings.exact_meshes else "convex")
        if way in ("legacy", "shell") or "vertex" in given:
            raise given.error("has its vertices written out or inertia='legacy' or 'shell', and "
                              "gives mass to a body; give that body an <inertial>, or write "
                              "inertia='exact'.")
        file = given.text("file")
        path = (self.document.folder / settings.meshes / file).resolve()
        if not path.is_relative_to(self.document.folder.resolve()):
            raise given.error(f"names the file {shown(file)}, which is not in the folder of the "
                              "model; move it there.")
        try:
            corners = read_triangles(path) * given.numbers("scale", 3, default=[1.0] * 3)
            R, x = self._reference(given)
            corners = (corners - x) @ R
            return mesh_volume(convex_hull(corners) if way == "convex" else corners)
        except InputError as error:
            raise given.error(f"gives mass to a body, and its file {shown(file)} is not usable: "
                              f"{error}") from None

    def _adjust_masses(self) -> None:
        """Do what settotalmass, boundmass, boundinertia and balanceinertia ask for."""
        settings, bodies = self.document.settings, self.robot.bodies
        for body in bodies:
            link = body.link
            mass, J = max(link.mass, settings.bound_mass), link.inertia
            moments, axes = np.linalg.eigh(J)
            changed = np.maximum(moments, settings.bound_inertia)
            if settings.balance and changed.sum() < 2 * changed.max():
                changed = np.full(3, changed.mean())
            if (changed != moments).any():
                J = axes @ np.diag(changed) @ axes.T
            body.link = RobotLink(link.name, mass, link.centre, J)
        total = sum(body.link.mass for body in bodies)
        if settings.total_mass > 0 and total > 0:
            k = settings.total_mass / total
            for body in bodies:
                body.link = RobotLink(body.name, k * body.link.mass, body.link.centre,
                                      k * body.link.inertia)

    def _contacts(self) -> None:
        """Count bodies with geoms that may touch those of another one."""
        robot = self.robot
        if robot.off & {"contact"}:
            return
        touching = {(robot.limb(body), *masks) for body, *masks in self.touching}
        found: set[int] = set()
        for (a, type_a, with_a), (b, type_b, with_b) in combinations(touching, 2):
            near = -1 not in (a, b) and (self._above(a) == b or self._above(b) == a)
            if a != b and not near and (type_a & with_b or type_b & with_a):
                found |= {a, b}
        robot.extras["contact"] += len(found) + len([
            e for e in self.document.sections("contact") if e.name == "pair"])

    def _above(self, limb: int) -> int:
        return self.robot.limb(self.robot.bodies[limb].above)

    # ------------------------------------------------------------ tendons, actuators, equalities

    def _tendon(self, element: Element) -> None:
        robot, given = self.robot, self.document.given(element, kind="tendon")
        name = given.text("name", f"tendon{len(robot.tendons) + 1}")
        told = {key: self._linear(given, key) for key in ("stiffness", "damping", "armature")}
        rest = given.numbers("springlength", 1, 2, [-1.0])
        slack = rest[0] != rest[-1]  # a range without a force
        robot.extras["tendon"] += any(told.values()) and (
            element.name != "fixed" or slack or told["armature"] > 0)
        robot.extras["limits"] += self._limited(given, "limited", "range")
        robot.extras["friction"] += given.number("frictionloss", 0.0) != 0
        if element.name != "fixed":
            return
        found = []
        for child in element.all("joint"):
            part = self.document.given(Element("coef", child.attributes, child.line))
            found.append((self._coordinate(part, part.text("joint")), part.number("coef")))
        length = sum(c * robot.joints[joint].rest for joint, c in found)
        robot.tendons[name] = MjcfTendon(
            tuple(found), 0.0 if slack else told["stiffness"],
            length if rest[0] == -1 else rest[0], told["damping"])

    def _coordinate(self, given: Given, name: str) -> str:
        """Return the name of a joint that has one coordinate."""
        joint = self.robot.joints.get(name)
        if joint is None:
            raise given.error(f"names {shown(name)}, which is no joint"
                              f"{proposal(name, self.robot.joints)}; correct it.")
        if joint.kind not in ("hinge", "slide"):
            raise given.error(f"acts on {shown(name)}, a {joint.kind} joint, which has no single "
                              "coordinate; remove it.")
        return name

    def _actuator(self, element: Element) -> None:
        robot = self.robot
        if element.name not in ACTUATORS:
            raise InputError(f"line {element.line}: <{shown(element.name)[1:-1]}> is no actuator"
                             f"{proposal(element.name, ACTUATORS)}; remove it.")
        given = self.document.given(element)
        law = self._law(given)
        joint = given.text("joint", given.text("jointinparent", ""))
        if joint:
            found = robot.joints.get(joint)
            acts: tuple[tuple[str, float], ...] = ()
            if found is None or found.kind in ("hinge", "slide"):
                acts = ((self._coordinate(given, joint), 1.0),)
        else:
            tendon = robot.tendons.get(given.text("tendon", ""))
            acts = tendon.joints if tendon else ()
        if law is None or not acts:
            robot.extras["actuator"] += 1
            return
        if "actuation" in robot.off:
            return
        ranges = [("forcelimited", "forcerange")]
        if "clampctrl" not in robot.off:
            ranges.append(("ctrllimited", "ctrlrange"))
        robot.extras["limits"] += any(self._limited(given, *pair) for pair in ranges)
        gain, bias, drag = law
        ratio = given.number("dampratio", 0.0)
        if given.tag == "general" and gain == -bias[1] and bias[2] > 0:
            ratio, bias = bias[2], (bias[0], bias[1], 0.0)
        gear = given.numbers("gear", 1, 6, [1.0])[0]
        if ratio and (ratio < 0 or not gear or bias[1] > 0 or bias[2]):
            raise given.error(f"has dampratio={ratio:g}; it must be above 0, without kv and with a "
                              "gear and a kp above 0.")
        name = given.text("name", "") or f"u{len(robot.actuators) + 1}"
        robot.actuators.append(MjcfActuator(name, acts, gear, gain, bias, drag, ratio))

    def _law(self, given: Given) -> tuple[float, tuple[float, float, float], float] | None:
        """Return gain, bias and drag of an actuator; None where its effort is another one."""
        if given.number("timeconst", 0.0):
            return None
        if given.tag == "motor":
            return 1.0, (0.0, 0.0, 0.0), 0.0
        if given.tag == "position":
            kp = given.number("kp", 1.0)
            return kp, (0.0, -kp, -given.number("kv", 0.0)), 0.0
        if given.tag in ("velocity", "damper"):
            kv = given.number("kv", 1.0)
            return (kv, (0.0, 0.0, -kv), 0.0) if given.tag == "velocity" else (
                0.0, (0.0, 0.0, 0.0), -kv)
        if given.tag != "general" or given.text("dyntype", "none") != "none":
            return None
        gain, bias = ((given.numbers(key, 1, 10, [default]) + [0.0] * 3)[:3]
                      for key, default in (("gainprm", 1.0), ("biasprm", 0.0)))
        kind = given.text("gaintype", "fixed"), given.text("biastype", "none")
        if kind[0] not in ("fixed", "affine") or kind[1] not in ("none", "affine") or (
                kind[0] == "affine" and gain[1]):
            return None
        return (gain[0], (bias[0], bias[1], bias[2]) if kind[1] == "affine" else (0.0, 0.0, 0.0),
                gain[2] if kind[0] == "affine" else 0.0)

    def _equality(self, element: Element) -> None:
        given = self.document.given(element, kind="equality")
        if element.name not in ("connect", "weld", "joint", "tendon"):
            raise given.error("is no equality of bodies, joints or tendons; remove it.")
        if not given.flag("active", True) or "equality" in self.robot.off:
            return
        what = "body" if element.name in ("connect", "weld") else element.name
        sites = what == "body" and "site1" in given
        what = "site" if sites else what
        ends = tuple(given.text(f"{what}{k}") for k in (1, 2) if k == 1 or f"{what}2" in given)
        names: dict[str, Collection[str]] = {
            "body": ["world", *(body.name for body in self.robot.bodies)],
            "site": self.robot.sites, "joint": self.robot.joints, "tendon": self.robot.tendons}
        known = names[what]
        for end in ends:
            if end not in known:
                raise given.error(f"names {shown(end)}, which is no {what}"
                                  f"{' of joints' if what == 'tendon' else ''}"
                                  f"{proposal(end, known)}; correct it.")
            if what == "joint":
                self._coordinate(given, end)
        name = given.text("name", f"equality{len(self.robot.equalities) + 1}")
        self.robot.equalities.append(MjcfEquality(name, element.name, ends, sites, given))


def _joints(element: Element) -> Iterator[Element]:
    """Yield the joints of a body, also those in its frames."""
    for child in element.children:
        if child.name in ("joint", "freejoint"):
            yield child
        elif child.name == "frame":
            yield from _joints(child)


def _moved(link: RobotLink, place: Placement) -> RobotLink:
    """Return a mass whose frame is at ``place``, in the frame outside."""
    return RobotLink(link.name, link.mass, place.x + place.R @ link.centre,
                     place.R @ link.inertia @ place.R.T)
