"""Robots: an MJCF or SDF file; a URDF file, and a TOML file of the joints that close its loops.

    [[joints]]
    name = "closing"
    type = "revolute"
    bodies = ["coupler", "base"]
    on_a = [0.8, 0, 0]
    on_b = [1, 0, 0]
    axis = [0, 0, 1]
    redundant = "leave out"

``bodies`` are links; ``on_a``, ``on_b`` and ``on_body`` are in the frames of these, ``axis`` and
``axis_a`` in the frame of the first, ``axis_b`` in the frame of the second, ``at`` in space at the
start. All else, and ``without`` and ``redundant``, are as in a model file (``multibody_file``). The
start is moved to a state in which the loops are closed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ...core.arguments import as_path, join_or, proposal, shown
from ...core.errors import ArgumentError, InputError
from ...core.exact_numbers import decimal
from ...core.inertia import RepName
from ...core.mesh_files import locate_all
from ...core.records import dataclass
from ...core.warnings import warn
from ..multibody.body import GROUND
from ..multibody.model import Model
from ..multibody.multibody import Multibody
from ..parsing.text_file import is_robot, model_text
from .bounded_xml import read_xml
from .mjcf_builder import parse_mjcf
from .multibody_file import build_from, build_model, join
from .robot_options import MjcfOptions, SdfOptions, UrdfOptions
from .robot_tree import IDENTITY, Mount
from .sdf import parse_sdf
from .toml_tables import TomlFileError, TomlTable, load_toml
from .urdf import parse_urdf

__all__ = ["NO_OPTIONS", "Loops", "RobotFormat", "load_robot", "read_loops", "read_settings",
           "refuse_other_options", "robot_format", "robot_model"]

NO_OPTIONS: Mapping[str, Any] = MappingProxyType({})

#: Text that a URDF file contains if it closes loops itself.
_LOOP = "<constraint"
#: Keys of points and of axes of a joint → the link in whose frame they are, 0 or 1.
_POINTS = {"on_a": 0, "on_body": 0, "on_b": 1}
_AXES = {"axis": 0, "axis_on_body": 0, "axis_a": 0, "axis_b": 1}


@dataclass(frozen=True)
class RobotFormat:
    """A format of robots' files: its parser, and the options that it takes."""

    name: str
    parse: Callable[..., Multibody]
    options: tuple[str, ...]


#: Outermost element → the format.
FORMATS = {
    "robot": RobotFormat("URDF", parse_urdf, tuple(UrdfOptions.__annotations__)),
    "mujoco": RobotFormat("MJCF", parse_mjcf, tuple(MjcfOptions.__annotations__)),
    "sdf": RobotFormat("SDF", parse_sdf, tuple(SdfOptions.__annotations__)),
}


def robot_format(text: str, path: str | Path) -> RobotFormat:
    """Return the format of a robot's file by its suffix, and of an .xml file by its root element.

    An .xml file with an unknown root element is read, and refused, as MJCF.
    """
    ending = Path(path).suffix
    if ending == ".xml":
        return FORMATS.get(_outermost(text, path), FORMATS["mujoco"])
    return FORMATS["robot" if ending == ".urdf" else "sdf"]


def refuse_other_options(kind: str, allowed: Sequence[str], options: Iterable[str]) -> None:
    """Refuse options of other formats than ``kind``, which takes those in ``allowed``.

    Raises ArgumentError with the formats that take the option.
    """
    for name in options:
        if name not in allowed:
            formats = [file_format.name for file_format in FORMATS.values()
                       if name in file_format.options]
            formats += ["TOML"] * (name == "set")
            belongs = f" belongs to {join_or(formats)}" if formats else (
                f" is no option of model files{proposal(name, allowed)}")
            raise ArgumentError(f"{name}={belongs}; a file in {kind} takes {join_or(allowed)}.")


def load_robot(
    path: str | Path, rep: RepName | None = None, options: Mapping[str, Any] = NO_OPTIONS
) -> Multibody:
    """Return the bodies and joints of a robot's file; ``gyrospark.Multibody.from_file``."""
    file = as_path("path", path, "robot.urdf")
    if not is_robot(file):
        raise InputError(f"The model file {str(file)!r} is no robot's; give a file ending in "
                         ".urdf, .xml or .sdf, or build the bodies in Python.")
    builder, _ = _read_robot(model_text(file), file, rep, options)
    builder._visuals = locate_all(builder._visuals, file)
    return builder


def robot_model(text: str, path: str | Path, rep: str | None, options: Mapping[str, Any]) -> Model:
    """Return the model of a robot's file; its meshes have the names of the file.

    Raises InputError with file and cure.
    """
    builder, loops = _read_robot(text, path, rep, options)
    if loops is not None:
        return loops.model(builder)
    # a URDF file without loops is a tree, whose constraints are independent
    if robot_format(text, path).name == "URDF" and _LOOP not in text:
        return builder.model()
    return _without_redundant(builder, path)


def _read_robot(
    text: str, path: str | Path, rep: str | None, options: Mapping[str, Any]
) -> tuple[Multibody, Loops | None]:
    """Return the bodies and joints of a robot's file, and the loop joints of a TOML file, or None.

    ``options`` are the options of ``load_model``; ``loops`` among them names the TOML file.
    """
    file_format = robot_format(text, path)
    present = {name: value for name, value in options.items() if value is not None}
    refuse_other_options(file_format.name, file_format.options, present)
    if "loops" not in present:
        return file_format.parse(text, path, rep or "gamma", present), None
    loops = read_loops(as_path("loops", present.pop("loops"), "loops.toml"))
    return file_format.parse(text, path, rep or "gamma", present, loops.close), loops


def read_settings(settings: Mapping[str, str], text: str, path: str | Path) -> dict[str, Any]:
    """Return the options of a robot's file for the settings of a command, key → text.

    Settings are ``ignore=limits,collision``, ``gravity=0,0,-1.62``, ``limits=1000``,
    ``limits=stops``, ``JOINT=0.5`` or ``JOINT="30 deg"`` for an angle or travel, ``JOINT.rate=1``,
    several numbers for ball and free joints, ``root=0,0,1,1,0,0,0``; and the keys of a format,
    ``base=floating``, ``keyframe=home``.
    """
    keys = robot_format(text, path).options
    options: dict[str, Any] = {"angles": {}, "rates": {}}
    for key, value in settings.items():
        # a key that is no option of the format is the name of a joint, and so are "angles" and
        # "rates", which no command sets as a whole
        if key not in keys or key in options:
            joint, _, rate = key.rpartition(".")
            kind, name = ("rates", joint) if rate == "rate" else ("angles", key)
            entries = [_number_or_text(word) for word in value.split(",")]
            options[kind][name] = entries if len(entries) > 1 else entries[0]
        elif key == "ignore":
            options[key] = [name.strip() for name in value.split(",")]
        # limits are a number, or a text that the option refuses if it is not "stops"
        elif key in ("base", "keyframe", "loops") or (key == "limits" and decimal(value) is None):
            options[key] = value
        else:
            numbers = [_number_or_text(word) for word in value.split(",")]
            for number in numbers:
                if isinstance(number, str):
                    raise InputError(f"{key}={shown(number)} is no number; write for example "
                                     f"{key}=0.5.")
            options[key] = numbers[0] if key == "limits" else numbers
    return options


def _number_or_text(text: str) -> float | str:
    """Return a text as a number, if it is one; else unchanged, as it may be "30 deg"."""
    number = decimal(text)
    return text if number is None else float(number)


def _outermost(text: str, path: str | Path) -> str:
    """Return the name of a file's root element, which determines the format."""
    try:
        return read_xml(text).name
    except InputError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None


def _without_redundant(builder: Multibody, path: str | Path) -> Model:
    """Return the model without redundant constraints, which planar loops have, with a warning."""
    try:
        model = builder.model(redundant="leave out")
    except InputError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None
    if builder.redundancy and builder.redundancy.left_out:
        warn(f"{builder.redundancy} They are left out.")
    return model


@dataclass(frozen=True)
class Loops:
    """Joints and springs that close the loops of a robot."""

    content: TomlTable

    def close(self, builder: Multibody, links: Mapping[str, Mount]) -> None:
        """Add the joints that close the loops, each between two links of the robot.

        ``links``: name of a link → its frame in the model's body and in space.
        """
        mount_of = {"ground": Mount(GROUND, IDENTITY, IDENTITY), **links}
        frames = {name: mount.frame for name, mount in mount_of.items()}

        for table in self.content.tables("joints"):
            build_from(table, lambda table: join(builder, frames, table, partial(
                _builder_arguments, mount_of, table.strings("bodies"))))

    def model(self, builder: Multibody) -> Model:
        """Return the model, without the constraints that the file leaves out."""
        try:
            return build_model(builder, self.content)
        except TomlFileError:  # an error of a key, which names the file already
            raise
        except InputError as error:
            raise self.content.file_error(str(error)) from None


def _builder_arguments(
    mount_of: Mapping[str, Mount], names: Sequence[str], values: dict[str, Any]
) -> dict[str, Any]:
    """Return the builder's arguments of a [[joints]] table, written in the frames of two links.

    A body may consist of several links with fixed joints between them. Joints of the builder take
    points in body axes, as they are in every pose, and axes in space axes of the initial pose.
    """
    mounts = [mount_of[name] for name in names]
    points = {key: mounts[i].inner.x + mounts[i].inner.R @ np.array(values[key], float)
              for key, i in _POINTS.items() if key in values}
    axes = {key: mounts[i].space.R @ np.array(values[key], float)
            for key, i in _AXES.items() if key in values}
    # the attitude of the second link in the axes of the first
    turns = {"rotation": mounts[0].inner.R @ np.array(values["rotation"])
             @ mounts[1].inner.R.T} if "rotation" in values else {}
    in_space = {"axis": "axis_in_space", "axis_on_body": "axis_in_space"}
    return {in_space.get(key, key): argument
            for key, argument in (values | points | axes | turns).items()}


def read_loops(path: str | Path) -> Loops:
    """Return the loops of a TOML file.

    Raises InputError with file, key and cure.
    """
    content = load_toml(model_text(path), Path(path))
    content.allow("joints", "without", "redundant")
    if not content.tables("joints"):
        raise content.file_error("it closes no loop; write [[joints]].")
    return Loops(content)
