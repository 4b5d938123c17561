"""Conservative parts of robots in MJCF files: bodies, joints, equalities and springs.

Left out are contact, limits, friction, dampers, motors, tendons and the free joint of the base,
which is fixed. The same text goes to gyrospark and to MuJoCo.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from gyrospark.core.arguments import as_path
from gyrospark.core.errors import InputError
from gyrospark.generator.models.bounded_xml import Element
from gyrospark.generator.models.mjcf import parse_mjcf
from gyrospark.generator.models.mjcf_document import check_document
from gyrospark.generator.multibody.model import Model
from gyrospark.generator.parsing.text_file import model_text

__all__ = ["conservative_text", "model_of"]

_ELEMENTS = ("compiler", "option", "default", "worldbody", "body", "frame", "inertial", "joint",
             "freejoint", "equality", "connect", "weld", "keyframe", "key")
#: Attributes that stay, of elements that lose others.
_STAYS = {"option": ("gravity", "timestep"), "key": ("name", "qpos"),
          "joint": ("name", "class", "type", "pos", "axis", "ref", "stiffness", "springref",
                    "armature", "joint1", "joint2", "polycoef", "active")}


def conservative_text(path: Path) -> str:
    """Return the conservative elements of a file and of its includes, as MJCF.

    Raises
    ------
    InputError
        If the file is not MJCF, or has more than one body on the ground.
    """
    text = model_text(as_path("path", path, "robot.xml"))
    try:
        top, _ = check_document(text, path)
    except InputError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None
    bases = [body for world in top.all("worldbody") for body in world.all("body")]
    if len(bases) != 1:
        raise InputError(f"The model file {str(path)!r} has {len(bases)} bodies on the ground; "
                         "give one of a single robot.")
    base = bases[0]
    held = [joint for joint in base.children if joint.name == "freejoint"
            or (joint.name, joint.attributes.get("type")) == ("joint", "free")]
    base.children = [child for child in base.children if child not in held]
    for key in (key for keys in top.all("keyframe") for key in keys.children):
        numbers = key.attributes.get("qpos", "").split()
        key.attributes["qpos"] = " ".join(numbers[7 * len(held):])
    return ElementTree.tostring(_stripped(top), encoding="unicode")


def _stripped(element: Element) -> ElementTree.Element:
    stays = _STAYS.get(element.name, element.attributes)
    made = ElementTree.Element(element.name, {
        key: e for key, e in element.attributes.items() if key in stays})
    made.extend(_stripped(child) for child in element.children if child.name in _ELEMENTS)
    return made


def model_of(path: Path, text: str) -> Model:
    """Return the model of such a text, at its first keyframe if there is one."""
    first = ElementTree.fromstring(text).find("keyframe/key")
    keyframe = None if first is None else 0
    return parse_mjcf(text, path, keyframe=keyframe).model(redundant="leave out")
