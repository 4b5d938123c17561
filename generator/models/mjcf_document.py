"""The text of an MJCF file: includes, default classes, settings of the compiler, placements.

    include   a file of the same folder or below it, once; its children take the place of <include>
    default   attribute = own, else of ``class``, else of the nearest ``childclass``, else of main

Whatever is read from an attribute is a bounded number or a name; errors name the line.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import listed, proposal, shown
from ...core.errors import InputError
from ..multibody.initial_poses import onto, rotation
from ..parsing.text_file import UnusableFileError, read_text
from .bounded_xml import Element, read_xml
from .urdf_robot import NUMBER, Placement, turn

__all__ = ["Document", "Given", "Settings", "read_document"]

Array = NDArray[np.float64]

MAX_FILES = 16
MAX_BYTES = 2**20
#: Element → the attributes it may have; those of others are not looked at.
KNOWN = {name: frozenset(keys.split()) for name, keys in {
    "compiler": "autolimits boundmass boundinertia settotalmass balanceinertia strippath "
                "coordinate angle fitaabb eulerseq meshdir texturedir discardvisual usethread "
                "fusestatic inertiafromgeom inertiagrouprange saveinertial assetdir alignfree "
                "exactmeshinertia convexhull",
    "body": "name childclass pos quat axisangle xyaxes zaxis euler mocap gravcomp user sleep",
    "frame": "name childclass pos quat axisangle xyaxes zaxis euler",
    "inertial": "pos quat mass diaginertia axisangle xyaxes zaxis euler fullinertia",
    "freejoint": "name group align",
    "joint": "name class type group pos axis springdamper limited actuatorfrclimited "
             "solreflimit solimplimit solreffriction solimpfriction stiffness range "
             "actuatorfrcrange actuatorgravcomp margin ref springref armature damping "
             "frictionloss user joint1 joint2 polycoef active solref solimp",
    "geom": "name class type pos quat contype conaffinity condim group priority size material "
            "friction mass density shellinertia solmix solref solimp margin gap fromto axisangle "
            "xyaxes zaxis euler hfield mesh fitscale rgba fluidshape fluidcoef user",
    "connect": "name class active body1 body2 anchor site1 site2 solref solimp",
    "weld": "name class active body1 body2 relpose anchor torquescale site1 site2 solref solimp",
}.items()}
#: Ways to say an attitude, of which an element has one at most.
ATTITUDES = ("quat", "axisangle", "euler", "xyaxes", "zaxis")


@dataclass(frozen=True)
class Given:
    """The attributes of an element with those of its default classes."""

    tag: str
    line: int
    values: Mapping[str, str]

    def error(self, why: str) -> InputError:
        """Return the error of this element: "line 3: <joint> 'knee' …"."""
        name = f" {shown(self.values['name'])}" if "name" in self.values else ""
        return InputError(f"line {self.line}: <{self.tag}>{name} {why}")

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def text(self, key: str, default: str | None = None) -> str:
        """Return an attribute."""
        if key not in self.values:
            if default is not None:
                return default
            raise self.error(f"has no {key}; write {key}=\"…\".")
        return self.values[key]

    def choice(self, key: str, allowed: tuple[str, ...], default: str) -> str:
        """Return an attribute that is one of some words."""
        found = self.text(key, default)
        if found not in allowed:
            raise self.error(f"has {key}={shown(found)}; choose {listed(allowed)}"
                             f"{proposal(found, allowed)}.")
        return found

    def flag(self, key: str, default: bool) -> bool:
        """Return an attribute that is true or false."""
        return self.choice(key, ("true", "false"), "true" if default else "false") == "true"

    def numbers(
        self, key: str, least: int, most: int | None = None, default: list[float] | None = None
    ) -> list[float]:
        """Return finite numbers of an attribute, from ``least`` to ``most`` of them."""
        if default is not None and key not in self.values:
            return default
        words, upper = self.text(key).split(), most or least
        values = [float(word) for word in words if NUMBER.fullmatch(word)]
        if (not least <= len(words) <= upper or len(values) != len(words)
                or not np.isfinite(values).all()):
            count = f"{least}" if least == upper else f"{least} to {upper}"
            raise self.error(f"has {key}={shown(self.values[key])}; write {count} finite "
                             f"number{'s' if upper > 1 else ''}.")
        return values

    def number(self, key: str, default: float | None = None) -> float:
        """Return a finite number."""
        return self.numbers(key, 1, default=None if default is None else [default])[0]

    def whole(self, key: str, default: int) -> int:
        """Return a whole number."""
        found = float(self.number(key, default))
        if not found.is_integer():
            raise self.error(f"has {key}={shown(self.values[key])}; write a whole number.")
        return int(found)

    def vector(self, key: str, default: tuple[float, float, float] | None = None) -> Array:
        """Return three numbers."""
        return np.array(self.numbers(key, 3, default=None if default is None else [*default]))

    def direction(self, key: str, default: tuple[float, float, float] | None = None) -> Array:
        """Return a unit vector."""
        return self._unit(key, self.vector(key, default))

    def _unit(self, key: str, v: Array) -> Array:
        size = float(np.linalg.norm(v))
        if size < 1e-10:
            raise self.error(f"has {key}={shown(self.text(key, ''))}, which has no direction; "
                             "write other numbers.")
        found: Array = v / size
        return found

    def place(self, settings: Settings) -> Placement:
        """Return pos with quat, axisangle, euler, xyaxes or zaxis."""
        told = [key for key in ATTITUDES if key in self.values]
        if len(told) > 1:
            raise self.error(f"has {' and '.join(told)}; write one of them.")
        return Placement(self.vector("pos", (0.0, 0.0, 0.0)), self._attitude(settings))

    def _attitude(self, settings: Settings) -> Array:
        if "quat" in self.values:
            return rotation(self._unit("quat", np.array(self.numbers("quat", 4))))
        if "axisangle" in self.values:
            *axis, angle = self.numbers("axisangle", 4)
            return turn(self._unit("axisangle", np.array(axis)), angle * settings.angle)
        if "euler" in self.values:
            R = np.eye(3)
            for letter, angle in zip(settings.euler, self.numbers("euler", 3), strict=True):
                step = turn(np.eye(3)["xyz".index(letter.lower())], angle * settings.angle)
                R = R @ step if letter.islower() else step @ R
            return R
        if "xyaxes" in self.values:
            both = np.array(self.numbers("xyaxes", 6))
            x = self._unit("xyaxes", both[:3])
            y = self._unit("xyaxes", both[3:] - x * (x @ both[3:]))
            return np.stack([x, y, np.cross(x, y)], axis=1)
        if "zaxis" in self.values:
            return rotation(onto(self.direction("zaxis")))
        return np.eye(3)


@dataclass
class Settings:
    """What <compiler> elements say together: the last of each attribute.

    Attributes
    ----------
    angle : float
        Radians of one unit of angle.
    euler : str
        Three of xyzXYZ: small letters turn about axes that turn along, capitals about fixed ones.
    from_geoms : {"auto", "true", "false"}
        Whether inertia is taken from geoms: where there is no <inertial>, always, or never.
    groups : tuple of two int
        Groups of geoms that have mass.
    """

    angle: float = math.radians(1)
    euler: str = "xyz"
    from_geoms: str = "auto"
    groups: tuple[float, float] = (0, 5)
    total_mass: float = -1.0
    bound_mass: float = 0.0
    bound_inertia: float = 0.0
    balance: bool = False
    autolimits: bool = True
    meshes: str = ""
    exact_meshes: bool = False

    def take(self, given: Given) -> None:
        """Set what a <compiler> says."""
        if given.text("coordinate", "local") != "local":
            raise given.error("has coordinate='global'; save the file with local coordinates.")
        if "angle" in given:
            unit = given.choice("angle", ("degree", "radian"), "degree")
            self.angle = math.radians(1) if unit == "degree" else 1.0
        self.euler = given.text("eulerseq", self.euler)
        if len(self.euler) != 3 or not set(self.euler) <= set("xyzXYZ"):
            raise given.error(f"has eulerseq={shown(self.euler)}; write three of xyzXYZ.")
        self.from_geoms = given.choice("inertiafromgeom", ("auto", "true", "false"),
                                       self.from_geoms)
        low, high = given.numbers("inertiagrouprange", 2, default=[*self.groups])
        self.groups = (low, high)
        self.total_mass = given.number("settotalmass", self.total_mass)
        self.bound_mass = given.number("boundmass", self.bound_mass)
        self.bound_inertia = given.number("boundinertia", self.bound_inertia)
        self.balance = given.flag("balanceinertia", self.balance)
        self.autolimits = given.flag("autolimits", self.autolimits)
        self.meshes = given.text("meshdir", given.text("assetdir", self.meshes))
        self.exact_meshes = given.flag("exactmeshinertia", self.exact_meshes)


@dataclass
class Document:
    """An MJCF file with what it includes.

    Attributes
    ----------
    top : Element
        <mujoco>, nothing included any more.
    folder : Path
        Where files it names are.
    """

    top: Element
    folder: Path
    settings: Settings = field(default_factory=Settings)
    classes: dict[str, dict[str, dict[str, str]]] = field(
        default_factory=lambda: {"main": {}})

    def given(self, element: Element, inherited: str = "main", kind: str = "") -> Given:
        """Return the attributes of an element, ``kind`` being its name in defaults."""
        allowed = KNOWN.get(element.name)
        for key in element.attributes if allowed else ():
            if allowed and key not in allowed:
                raise InputError(f"line {element.line}: <{element.name}> has {key}, which is no "
                                 f"attribute of it{proposal(key, allowed)}; correct or remove it.")
        name = element.attributes.get("class", inherited)
        if name not in self.classes:
            raise InputError(f"line {element.line}: <{element.name}> is of class {shown(name)}, "
                             f"which no <default> has{proposal(name, self.classes)}; correct it.")
        defaults = self.classes[name].get(kind or element.name, {})
        return Given(element.name, element.line, {**defaults, **element.attributes})

    def sections(self, name: str) -> Iterator[Element]:
        """Yield the children of all outermost elements of a name."""
        for section in self.top.all(name):
            yield from section.children

    def inherit(self, element: Element, inherited: str) -> str:
        """Return the class of what is in an element."""
        name = element.attributes.get("childclass", inherited)
        if name not in self.classes:
            raise InputError(f"line {element.line}: <{element.name}> has childclass {shown(name)}, "
                             f"which no <default> has{proposal(name, self.classes)}; correct it.")
        return name


def read_document(
    text: str, path: Path, shared: Mapping[str, Mapping[str, Collection[str]]]
) -> Document:
    """Return the document of a text that was read from a file.

    ``shared`` is element → other elements and the attributes that a default of the first sets for
    these too: those that actuators of all kinds have in common.

    Raises
    ------
    InputError
        "line 3: …; cure."
    """
    top = read_xml(text)
    if top.name != "mujoco":
        raise InputError(f"line {top.line}: its outermost element is <{shown(top.name)[1:-1]}>, "
                         "not <mujoco>; give an MJCF file.")
    folder = path.parent
    _include(top, folder, [path.name], len(text))
    document = Document(top, folder)
    for element in top.all("compiler"):
        document.settings.take(document.given(element))
    for element in top.all("default"):
        _defaults(document, element, "main", document.classes["main"], shared)
    return document


def _include(element: Element, folder: Path, files: list[str], size: int) -> int:
    """Put the children of included files in place of <include>; return the bytes so far."""
    found: list[Element] = []
    for child in element.children:
        if child.name != "include":
            size = _include(child, folder, files, size)
            found.append(child)
            continue
        name = child.attributes.get("file", "")
        inner, size = _included(name, folder, files, size, child.line)
        size = _include(inner, folder, files, size)
        found += inner.children
    element.children = found
    return size


def _included(
    name: str, folder: Path, files: list[str], size: int, line: int
) -> tuple[Element, int]:
    def refuse(why: str) -> InputError:
        return InputError(f"line {line}: it includes {shown(name)}, {why}")

    if not name or not (folder / name).resolve().is_relative_to(folder.resolve()):
        raise refuse("which is not in the folder of the file; move it there.")
    plain = (folder / name).resolve().relative_to(folder.resolve()).as_posix()
    if plain in files:
        raise refuse("which is there already; a file is included once.")
    if len(files) >= MAX_FILES:
        raise refuse(f"and {MAX_FILES} files are the most; put some into one.")
    files.append(plain)
    try:
        text = read_text(folder / name, MAX_BYTES - size)
        return read_xml(text), size + len(text)
    except (UnusableFileError, InputError) as error:
        raise refuse(f"which is not usable: {error}") from None


def _defaults(
    document: Document, element: Element, name: str, base: Mapping[str, Mapping[str, str]],
    shared: Mapping[str, Mapping[str, Collection[str]]],
) -> None:
    """Enter the class of a <default>, which has what ``base`` has and more, and those in it."""
    own = {kind: dict(values) for kind, values in base.items()}
    for child in element.children:
        if child.name == "default":
            continue
        own.setdefault(child.name, {}).update(child.attributes)
        for other, keys in shared.get(child.name, {}).items():
            own.setdefault(other, {}).update(
                {key: e for key, e in child.attributes.items() if key in keys})
    document.classes[name] = own
    for child in element.all("default"):
        below = child.attributes.get("class", "")
        if not below or below in document.classes:
            raise InputError(f"line {child.line}: a <default> in {shown(name)} is of class "
                             f"{shown(below)}, {'which is there already' if below else 'no name'}; "
                             "give it a name of its own.")
        _defaults(document, child, below, own, shared)
