"""Cables of MJCF, ``<composite type="cable">``, as chains of bodies with ball joints.

MuJoCo had them until its version 4, with the plugin mujoco.elasticity.cable. Segment i of length h
bends and twists against the one before it with the moment (E I_y, E I_z, G J)/h times the angle; E
is ``bend`` and G is ``twist``, in Pa, and for geoms of radius r, or half sides a ≥ b (Saint-Venant)

    I = π r⁴/4, J = π r⁴/2;    I_y = (2 z)³ (2 y)/12, J = a b³ (16/3 − 3.36 (b/a) (1 − b⁴/(12 a⁴)))
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import NamedTuple
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from ...core.arguments import join_or, shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import quaternion_of_matrix
from ...core.records import dataclass
from ..multibody.initial_poses import rotation, unit
from .bounded_xml import Element
from .xml_numbers import NUMBER

__all__ = ["MjcfCable", "expand_cables", "write_xml"]

PLUGIN = "mujoco.elasticity.cable"
#: Segments of one cable, which a file names by a number alone; each is a body of the model.
MAX_SEGMENTS = 200
#: Attributes of a cable from which its bodies are made.
_COMPOSITE = ("type", "prefix", "count", "offset", "vertex", "initial", "curve", "size")
_KEYS = ("twist", "bend", "flat", "vmax")
#: Attributes of the parts of a cable, which go to each of its joints, geoms and sites.
_PARTS = {
    "joint": "kind group stiffness damping armature limited range margin solreflimit solimplimit "
             "frictionloss solreffriction solimpfriction user",
    "geom": "type contype conaffinity condim group priority size material rgba friction mass "
            "density solmix solref solimp margin gap user",
    "site": "group size material rgba user"}
#: Attributes of ball joints that a free joint has not.
_OF_BALLS = ("damping", "armature", "frictionloss")


@dataclass(frozen=True, eq=False)
class MjcfCable:
    """Names of the bodies of a cable in their order, and G J, E I_y and E I_z in N m²."""

    name: str
    bodies: tuple[str, ...]
    stiffness: tuple[float, float, float]
    #: Whether it is straight without moments; else as the file places it.
    is_flat: bool


def expand_cables(top: Element) -> list[MjcfCable]:
    """Replace the cables of a document by chains of bodies, without their plugin; return them.

    The elements below ``top`` are changed. Raises InputError, "line 3: …; cure.".
    """
    instances: dict[str, Element] = {}
    for extension in top.all("extension"):
        for plugin in extension.all("plugin"):
            if plugin.attributes.get("plugin") == PLUGIN:
                instances |= {instance.attributes.get("name", ""): instance
                              for instance in plugin.all("instance")}
        extension.children = [plugin for plugin in extension.children
                              if plugin.attributes.get("plugin") != PLUGIN]
    # defaults of joints, geoms or sites would hold for the segments, too: they are refused
    has_defaults = any(child.name in _PARTS for default in top.all("default")
                       for child in default.children)
    return [cable for world in top.all("worldbody")
            for cable in _expand(world, instances, "the main <default>" if has_defaults else "")]


def _expand(
    element: Element, instances: Mapping[str, Element], defaults: str
) -> Iterator[MjcfCable]:
    """Replace the cables in an element by bodies, and yield them.

    ``instances`` are the configurations of the plugin by name; ``defaults`` names what would change
    the parts of a cable here, "" if nothing would.
    """
    if "childclass" in element.attributes:
        defaults = "a childclass"
    for k, child in enumerate(element.children):
        if child.name == "composite":
            if element.name == "replicate" or defaults:
                raise _refusal(child, f"is below {defaults or '<replicate>'}, which would change "
                               "the parts of a cable; write it elsewhere, or name the class.")
            element.children[k], cable = _cable(child, instances)
            yield cable
        elif child.name == "plugin" and (child.attributes.get("plugin") == PLUGIN
                                         or child.attributes.get("instance") in instances):
            raise InputError(f"line {child.line}: the plugin {PLUGIN} acts on a single body; write "
                             '<composite type="cable"> for the whole cable.')
        else:
            inner_defaults = "<replicate>" if element.name == "replicate" else defaults
            yield from _expand(child, instances, inner_defaults)


def _refusal(element: Element, why: str) -> InputError:
    """Return an error with the line and the name of an element."""
    return InputError(f"line {element.line}: <{element.name}> {why}")


def _cable(composite: Element, instances: Mapping[str, Element]) -> tuple[Element, MjcfCable]:
    """Return the first body of a cable, which contains its further bodies, and its stiffnesses.

    B = (G J, E I_y, E I_z) of the section, about the tangent and across it, as in MuJoCo.
    """
    values = composite.attributes
    kind, initial = values.get("type", ""), values.get("initial", "ball")
    if kind != "cable":
        raise _refusal(composite, f"has type={shown(kind)}, and cables alone are read; MuJoCo 4 "
                       "has none: write <flexcomp>.")
    _allow(composite, _COMPOSITE)
    if initial not in ("ball", "free", "none"):
        raise _refusal(composite, f"has initial={shown(initial)}; choose ball, free or none.")
    parts = _attributes_of_kinds(composite)
    form, sizes = _form(composite, parts["geom"])
    material, section = _material(composite, instances), _section(form, sizes)
    names = [f"{values.get('prefix', '')}B_{k}" for k in _labels(len(_curve(composite)) - 1)]
    cable = MjcfCable(values.get("prefix", "") + "cable", tuple(names),
                      (material.G * section.J, material.E * section.I_y, material.E * section.I_z),
                      material.is_flat)
    return _bodies(composite, initial, parts, form, sizes), cable


def _attributes_of_kinds(composite: Element) -> dict[str, dict[str, str]]:
    """Return the attributes that all joints, geoms and sites of a cable have, by kind of part."""
    parts: dict[str, dict[str, str]] = {"joint": {}, "geom": {}, "site": {}}
    for child in composite.children:
        if child.name in parts:
            _allow(child, _PARTS[child.name].split())
            if parts[child.name] or child.attributes.get("kind", "main") != "main":
                raise _refusal(child, 'is a second one, or has another kind than "main"; a cable '
                               "has one for all its segments.")
            parts[child.name] = {key: value for key, value in child.attributes.items()
                                 if key != "kind"}
        elif child.name not in ("plugin", "skin"):
            raise _refusal(child, "is no part of a cable; remove it.")
    return parts


def _form(composite: Element, geom: Mapping[str, str]) -> tuple[str, list[float]]:
    """Return the type of a cable's geoms and its sizes in m; refuse other types and sizes."""
    form, text = geom.get("type", "sphere"), geom.get("size", "")
    sizes = _numbers(composite, "size of its geom", text)
    # a box's first size is half its length, which the curve gives: it alone need not be above 0
    count, first = (3, 1) if form == "box" else (1, 0)
    if form not in ("capsule", "cylinder", "box") or len(sizes) < count or not all(
            x > 0 for x in sizes[first:count]):
        raise _refusal(composite, f"has a geom of type {shown(form)} and size {shown(text)}; "
                       "write a capsule or cylinder with its radius, or a box with three sizes, "
                       "above 0.")
    return form, sizes


def _allow(element: Element, names: Iterable[str]) -> None:
    """Refuse attributes of an element that are not among ``names``."""
    for key in element.attributes:
        if key not in names:
            raise _refusal(element, f"has {key}, which a cable has not here; choose "
                           f"{join_or([*names])}, and place it by a <frame>.")


def _numbers(element: Element, key: str, text: str, largest_count: float = math.inf) -> list[float]:
    """Return the finite numbers of the text of ``key``, ``largest_count`` at most, or refuse it."""
    words = text.split()
    if not all(map(NUMBER.fullmatch, words)) or len(words) > largest_count or not np.isfinite(
            [float(e) for e in words]).all():
        limit = f", up to {largest_count} of them" if largest_count < math.inf else ""
        raise _refusal(element, f"has {key} {shown(text)}; write finite numbers{limit}.")
    return [float(word) for word in words]


class _Material(NamedTuple):
    """Moduli of a cable, which are 0 without a plugin."""

    G: float  # shear modulus, Pa
    E: float  # Young's modulus, Pa
    is_flat: bool  # whether the cable is straight without moments, instead of as it starts


def _material(composite: Element, instances: Mapping[str, Element]) -> _Material:
    """Return the material that the plugin of a cable describes, or one of the ``instances``.

    Raises InputError for another plugin, for unknown keys, and for moduli below 0.
    """
    config: dict[str, str] = {}
    for plugin in composite.all("plugin"):
        name, instance = (plugin.attributes.get(key, "") for key in ("plugin", "instance"))
        if name not in ("", PLUGIN) or (instance and instance not in instances):
            raise _refusal(plugin, f"is {shown(name or instance)}; a cable has {PLUGIN}, or an "
                           "instance of it.")
        for entry in (instances[instance] if instance else plugin).all("config"):
            key = entry.attributes.get("key", "")
            if key not in _KEYS:
                raise _refusal(entry, f"has the key {shown(key)}; choose {join_or(_KEYS)}.")
            config[key] = entry.attributes.get("value", "")
    if config.get("flat", "false") not in ("true", "false"):
        raise _refusal(composite, f"has flat {shown(config['flat'])}; write true or false.")
    moduli = []  # G, then E
    for key in ("twist", "bend"):
        modulus = _numbers(composite, key, config.get(key, "0"))
        if len(modulus) != 1 or modulus[0] < 0:
            raise _refusal(composite, f"has {key} {shown(config[key])}; write one number in Pa, 0 "
                           "or more.")
        moduli += modulus
    return _Material(G=moduli[0], E=moduli[1], is_flat=config.get("flat") == "true")


class _Section(NamedTuple):
    """Moments of area of a section, in m⁴."""

    J: float  # torsion constant
    I_y: float
    I_z: float


def _section(form: str, sizes: list[float]) -> _Section:
    """Return the moments of area of the section of a geom, a circle or a rectangle.

    Circle: J = π r⁴/2, I = π r⁴/4. Rectangle with half sides a ≥ b: J = a b³ (16/3 − 3.36 (b/a)
    (1 − (b/a)⁴/12)), an approximation of Saint-Venant's series (Roark). ``sizes`` has r, or half
    the length and the half sides along y and z.
    """
    if form != "box":
        I_across = math.pi * sizes[0] ** 4 / 4
        return _Section(2 * I_across, I_across, I_across)
    y, z = sizes[1:3]
    a, b = max(y, z), min(y, z)
    J = a * b**3 * (16 / 3 - 3.36 * b / a * (1 - (b / a) ** 4 / 12))
    return _Section(J, (2 * z) ** 3 * 2 * y / 12, (2 * y) ** 3 * 2 * z / 12)


def _labels(count: int) -> list[str]:
    """Return MuJoCo's labels of the segments: "first", "1", "2", …, "last"."""
    return ["first", *map(str, range(1, count - 1)), "last"]


def _curve(composite: Element) -> Array:
    """Return the ends of the segments in a row, shape (segments + 1, 3), as MuJoCo places them:
    the points of ``vertex``, or of the formulas in ``curve``.
    """
    values = composite.attributes
    numbers = {key: _numbers(composite, key, values.get(key, default), largest_count)
               for key, default, largest_count in (
                   ("vertex", "", math.inf), ("count", "1", 3), ("size", "1 0 0", 3))}
    counts = numbers["count"]
    count = round(counts[0]) if counts and not numbers["vertex"] else len(numbers["vertex"]) // 3
    is_whole = counts[1:] == [1.0] * len(counts[1:]) and all(map(float.is_integer, counts))
    if (not is_whole or len(numbers["vertex"]) % 3 or (numbers["vertex"] and "count" in values)
            or count - 1 not in range(2, MAX_SEGMENTS + 1)):
        raise _refusal(composite, f"has count {shown(values.get('count', ''))}; write vertex, or "
                       f'count="N 1 1" points in a line, for 2 to {MAX_SEGMENTS} segments.')
    if numbers["vertex"]:
        points: Array = np.reshape(numbers["vertex"], (-1, 3))
    else:
        points = _points_of_formulas(composite, numbers["size"], count)
    edges = np.diff(points, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    tangents = edges / np.where(lengths, lengths, 1)[:, None]
    # frames are carried along by the shortest rotations, which divide by 1 + a·b (``_frames``)
    if not (lengths > 1e-12 * np.abs(points).max()).all() or not all(
            a @ b > -1 + 1e-6 for a, b in pairwise(tangents)):
        raise _refusal(composite, "has points of its curve that coincide, or a curve that turns "
                       "back; write other points.")
    return points


def _points_of_formulas(composite: Element, size: list[float], count: int) -> Array:
    """Return points of ``curve`` at equidistant s from 0 to 1, shape (count, 3).

    ``curve`` has up to three words for x, y and z, ``size`` length, radius and half turns.
    """
    length, radius, turns = (size + [0.0] * 3)[:3]
    s = np.arange(count) / (count - 1)
    shapes = {"s": length * s, "cos(s)": radius * np.cos(math.pi * turns * s),
              "sin(s)": radius * np.sin(math.pi * turns * s), "0": 0 * s}
    text = composite.attributes.get("curve", "")
    words = text.split()
    if len(words) > 3 or not {*words} <= shapes.keys():
        raise _refusal(composite, f"has curve={shown(text)}; write up to three of "
                       f"{join_or(shapes)}.")
    return np.stack([shapes[word] for word in (words + ["0"] * 3)[:3]], axis=1)


def _bodies(
    composite: Element, initial: str, parts: Mapping[str, Mapping[str, str]], form: str,
    sizes: list[float],
) -> Element:
    """Return the first body of a chain of segments, each inside the one before it.

    The x axis of a body is the tangent, its origin the beginning of its segment; ball joints are
    at the origins, and the first body has the joint ``initial``. Sites mark both ends. ``parts``
    has the attributes of joints, geoms and sites; ``form`` and ``sizes`` are as of ``_form``.
    """
    values, line, points = composite.attributes, composite.line, _curve(composite)
    prefix, edges = values.get("prefix", ""), np.diff(points, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    offset = (_numbers(composite, "offset", values.get("offset", ""), 3) + [0.0] * 3)[:3]
    frames = _frames(edges / lengths[:, None])
    bodies: list[Element] = []
    for k, label in enumerate(_labels(len(edges))):
        length = float(lengths[k])
        # attitude and origin in the frame of the segment before
        q = quaternion_of_matrix(frames[k - 1].T @ frames[k] if k else frames[k])
        x = points[0] + offset if k == 0 else [float(lengths[k - 1]), 0.0, 0.0]
        body = Element("body", {"name": f"{prefix}B_{label}", "pos": _text(x), "quat": _text(q)},
                       line)
        if k or initial != "none":
            body.children.append(_joint(f"{prefix}J_{label}", parts["joint"], line,
                                        is_free=k == 0 and initial == "free"))
        # half edges of a box, the first along the segment; or the radius of a capsule or cylinder
        extent = ({"pos": _text([length / 2, 0, 0]), "size": _text([length / 2, *sizes[1:3]])}
                  if form == "box" else
                  {"fromto": _text([0, 0, 0, length, 0, 0]), "size": _text(sizes[:1])})
        body.children.append(Element(
            "geom", {**parts["geom"], "name": f"{prefix}G{k}", **extent}, line))
        if label in ("first", "last"):
            body.children.append(Element("site", {
                **parts["site"], "name": f"{prefix}S_{label}",
                "pos": _text([length if k else 0.0, 0, 0])}, line))
        if bodies:
            bodies[-1].children.append(body)
        bodies.append(body)
    return bodies[0]


def _joint(name: str, attributes: Mapping[str, str], line: int, *, is_free: bool) -> Element:
    """Return a ball joint, or a free one, which has none of the balls' own attributes (damping)."""
    attributes = {key: text for key, text in attributes.items()
                  if not (is_free and key in _OF_BALLS)}
    return Element("joint", {"group": "3", **attributes, "name": name,
                             "type": "free" if is_free else "ball"}, line)


def _frames(t: Array) -> list[Array]:
    """Return the axes of segments with unit tangents, shape (segments, 3), as MuJoCo has them.

    Each is a rotation matrix with the tangent as its first column. The third axis is the binormal
    at the start, transported in parallel. If the start is straight, each segment has an attitude of
    its own, q ∝ (1 + t_x, 0, −t_z, t_y), or (t_y, t_z, 0, 1 − t_x) for t_x ≤ 0.
    """
    z = np.cross(t[0], t[1])
    if np.linalg.norm(z) <= 1e-9:
        return [rotation(unit(np.array([1 + x, 0, -z, y] if x > 0 else [y, z, 0, 1 - x])))
                for x, y, z in t]
    z = z / np.linalg.norm(z)
    frames = [np.stack([t[0], np.cross(z, t[0]), z], axis=1)]
    for a, b in pairwise(t):
        # the shortest rotation from a to b: 1 + K + K²/(1 + a·b) with K v = (a × b) × v
        K = np.cross(np.eye(3), np.cross(a, b))
        frames.append((np.eye(3) + K + K @ K / (1 + a @ b)) @ frames[-1])
    return frames


def _text(numbers: Iterable[float]) -> str:
    """Return numbers as the text of an attribute, with all digits."""
    return " ".join(repr(float(x)) for x in numbers)


def write_xml(element: Element) -> str:
    """Return an element, with all elements in it, as XML."""
    attributes = "".join(f" {key}={quoteattr(value)}" for key, value in element.attributes.items())
    return (f"<{element.name}{attributes}>{escape(element.text)}"
            f"{''.join(map(write_xml, element.children))}</{element.name}>")
