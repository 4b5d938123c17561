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
``axis_a`` in that of the first, ``axis_b`` in that of the second, ``at`` in space at the start. All
else, and ``without`` and ``redundant``, as in a model file (``multibody_file``). The start is moved
to where the loops are closed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_path, shown
from ...core.errors import InputError
from ...core.exact_numbers import decimal
from ...core.inertia import RepName
from ...core.mesh_files import located
from ...core.warnings import warn
from ..multibody.body import GROUND
from ..multibody.model import Model
from ..multibody.multibody import Multibody
from ..parsing.text_file import model_text
from .bounded_xml import read_xml
from .mjcf import parse_mjcf
from .multibody_file import finished, join, telling
from .robot_tree import IDENTITY, Mount
from .sdf import parse_sdf
from .toml_tables import TomlTable, load_toml
from .urdf import parse_urdf

__all__ = ["Loops", "load_mjcf", "load_sdf", "load_urdf", "read_loops", "read_mjcf",
           "read_sdf", "read_urdf", "robot_model"]

#: In the text of a URDF file that closes loops itself.
_LOOP = "<constraint"
#: Keys of a joint → the link they refer to.
_POINTS = {"on_a": 0, "on_body": 0, "on_b": 1}
#: Settings of all formats, and those of URDF and SDF.
_COMMON = ("ignore", "gravity", "limits")
_PLACED = ("base", "position", "quaternion", "velocity", "angular_velocity")
_AXES = {"axis": 0, "axis_on_body": 0, "axis_a": 0, "axis_b": 1}


def read_urdf(
    path: str | Path, *, base: Literal["fixed", "floating"] = "fixed",
    angles: Mapping[str, float | str] | None = None,
    rates: Mapping[str, float | str] | None = None,
    ignore: str | Iterable[str] = (), gravity: ArrayLike = (0.0, 0.0, -9.81),
    position: ArrayLike = (0.0, 0.0, 0.0), quaternion: ArrayLike | None = None,
    velocity: ArrayLike | None = None, angular_velocity: ArrayLike | None = None,
    rep: RepName = "gamma", loops: str | Path | None = None, limits: float | None = None,
) -> Multibody:
    """Return the bodies and joints of a URDF file, to which more can be added.

    Parameters
    ----------
    path : path
        The file, at most 1 MiB of UTF-8; macros of xacro expanded.
    base : {"fixed", "floating"}
        Whether the root link is space, or a body.
    angles, rates : mapping of str to float or text, optional
        Angles or travels of joints at the start, and their rates (rad, m, rad/s, m/s; "45 deg",
        "10 rpm" are texts); 0 by default. Joints with <mimic> follow theirs.
    ignore : names
        What to do without that a file has: "limits", "friction", "collision", "contact",
        "gazebo", "extension", or "all". What is there and is not ignored is refused.
        <visual>, <sensor>, <transmission> and what controllers have move nothing.
    gravity : three floats
        In space.
    position, quaternion : optional
        Where the frame of the root link is in space.
    velocity, angular_velocity : three floats, optional
        Of a floating root: of its centre of mass in space, and in its own axes.
    rep : {"gamma", "alpha"}
        Inertia representation.
    loops : path, optional
        A TOML file with the joints that close loops, which URDF has not (``loops``).
    limits : float, optional
        Stiffness of one-sided springs at the ends of joint ranges, N m/rad or N/m, as in
        ``joint_spring``. By default limits are refused or ignored.

    Returns
    -------
    Multibody
        Bodies named as the first of the links that are fixed to each other, joints as joints,
        with ``_`` for what no name in C has; axes of a body are those of its link.

    Raises
    ------
    InputError
        With file, link or joint, and cure.
    """
    return _read(path, loops, base=base, angles=angles, rates=rates, ignore=ignore,
                 gravity=gravity, position=position, quaternion=quaternion, velocity=velocity,
                 angular_velocity=angular_velocity, rep=rep, limits=limits)[0]


def load_urdf(
    path: str | Path, *, base: Literal["fixed", "floating"] = "fixed",
    angles: Mapping[str, float | str] | None = None,
    rates: Mapping[str, float | str] | None = None,
    ignore: str | Iterable[str] = (), gravity: ArrayLike = (0.0, 0.0, -9.81),
    position: ArrayLike = (0.0, 0.0, 0.0), quaternion: ArrayLike | None = None,
    velocity: ArrayLike | None = None, angular_velocity: ArrayLike | None = None,
    rep: RepName = "gamma", loops: str | Path | None = None, limits: float | None = None,
) -> Model:
    """Return the model of a robot in URDF: ``read_urdf(...).model()``, with its arguments.

    With ``loops``, that file decides on redundant constraints.

    Its system has the quantities JOINT_angle and JOINT_rate, or JOINT_travel and JOINT_speed.

    Raises
    ------
    InputError
        With file, link or joint, and cure.
    """
    build, closing, loop = _read(
        path, loops, base=base, angles=angles, rates=rates, ignore=ignore, gravity=gravity,
        position=position, quaternion=quaternion, velocity=velocity,
        angular_velocity=angular_velocity, rep=rep, limits=limits)
    if closing is not None:
        return closing.model(build)
    return _without_redundant(build, path) if loop else build.model()


def read_mjcf(
    path: str | Path, *, keyframe: str | int | None = None,
    angles: Mapping[str, Any] | None = None, rates: Mapping[str, Any] | None = None,
    ignore: str | Iterable[str] = (), gravity: ArrayLike | None = None, rep: RepName = "gamma",
    limits: float | None = None, loops: str | Path | None = None,
) -> Multibody:
    """Return the bodies, joints and actuators of an MJCF file, to which more can be added.

    Parameters
    ----------
    path : path
        The file, at most 1 MiB of UTF-8 with all that it includes from its folder. MuJoCo's
        compiler reads it, of the extra ``robots``.
    keyframe : str or int, optional
        Name or number of the <key> that gives the start; by default qpos0, at rest.
    angles, rates : mapping of str, optional
        Coordinates of joints at the start, in place of the keyframe's, and their rates: rad, m,
        rad/s and m/s, or texts with a unit, "45 deg", "10 rpm"; of ball and free joints as many
        numbers as in qpos and qvel. Closed loops are then projected.
    ignore : names
        What to do without that a file has: "contact", "limits", "friction", "fluid", "tendon",
        "actuator", "deformable", or "all". What is there and is not ignored is refused. Sensors,
        cameras, lights, materials and settings of the solver move nothing.
    gravity : three floats, optional
        In space; by default that of <option>.
    rep : {"gamma", "alpha"}
        Inertia representation.
    limits : float, optional
        Stiffness of elastic ends of the ranges of joints, as for ``read_urdf``. Ranges of tendons
        and efforts are among the limits to ignore still.
    loops : path, optional
        A TOML file with more joints between bodies of the file, as for ``read_urdf``.

    Returns
    -------
    Multibody
        Bodies named as the first of those that move as one, in whose axes they are; joints, and
        an input for each actuator, named as in the file with ``_`` for what no name in C has.
        Geoms of groups 0 to 2 are drawn. Equalities are exact constraints here, and soft in MuJoCo.

    Raises
    ------
    InputError
        With file, line, and cure.
    """
    return _read_mjcf(path, loops, keyframe=keyframe, angles=angles, rates=rates, ignore=ignore,
                      gravity=gravity, rep=rep, limits=limits)[0]


def load_mjcf(
    path: str | Path, *, keyframe: str | int | None = None,
    angles: Mapping[str, Any] | None = None, rates: Mapping[str, Any] | None = None,
    ignore: str | Iterable[str] = (), gravity: ArrayLike | None = None, rep: RepName = "gamma",
    limits: float | None = None, loops: str | Path | None = None,
) -> Model:
    """Return the model of a robot in MJCF: ``read_mjcf(...).model()``, with its arguments.

    Redundant constraints of its loops are left out, with a warning that names them. Its system has
    the quantities JOINT_angle and JOINT_rate, or JOINT_travel and JOINT_speed.

    Raises
    ------
    InputError
        With file, line, and cure.
    """
    build, closing = _read_mjcf(path, loops, keyframe=keyframe, angles=angles, rates=rates,
                                ignore=ignore, gravity=gravity, rep=rep, limits=limits)
    return _without_redundant(build, path) if closing is None else closing.model(build)


def _read_mjcf(
    path: str | Path, loops: str | Path | None, **options: Any
) -> tuple[Multibody, Loops | None]:
    """Return a robot, and the joints that a file adds to it."""
    file = as_path("path", path, "robot.xml")
    closing = None if loops is None else read_loops(as_path("loops", loops, "loops.toml"))
    return _located(parse_mjcf(model_text(file), file, close=closing.close if closing else None,
                               **options), file), closing


def read_sdf(
    path: str | Path, *, base: Literal["fixed", "floating"] | None = None,
    angles: Mapping[str, float | str] | None = None,
    rates: Mapping[str, float | str] | None = None,
    ignore: str | Iterable[str] = (), gravity: ArrayLike | None = None,
    position: ArrayLike = (0.0, 0.0, 0.0), quaternion: ArrayLike | None = None,
    velocity: ArrayLike | None = None, angular_velocity: ArrayLike | None = None,
    rep: RepName = "gamma", limits: float | None = None,
) -> Multibody:
    """Return the bodies and joints of an SDF file with one model, to which more can be added.

    A joint whose child has a parent already closes a loop: of the joints of a link that is a child
    twice, the first in the file belongs to the tree.

    Parameters
    ----------
    path : path
        The file, at most 1 MiB of UTF-8.
    base : {"fixed", "floating"}, optional
        Whether the root link is space, or a body; by default a body unless a joint has the parent
        ``world``.
    angles, rates : mapping of str to float or text, optional
        Of joints of the tree, as for ``read_urdf``. Closed loops are then projected.
    ignore : names
        "limits", "friction", "collision", "plugin", "extension", or "all", as for ``read_urdf``.
    gravity : three floats, optional
        In space axes; default: gravity of the file's world, 9.8 m/s² down where the world has
        none, else (0, 0, -9.81).
    position, quaternion : optional
        Where the world of the file is in space, in which the model has its <pose>.
    velocity, angular_velocity, rep, limits : optional
        As for ``read_urdf``.

    Raises
    ------
    InputError
        With file, line, link or joint, and cure.
    """
    file = as_path("path", path, "robot.sdf")
    return _located(parse_sdf(
        model_text(file), file, base=base, angles=angles, rates=rates, ignore=ignore,
        gravity=gravity, position=position, quaternion=quaternion, velocity=velocity,
        angular_velocity=angular_velocity, rep=rep, limits=limits), file)


def load_sdf(
    path: str | Path, *, base: Literal["fixed", "floating"] | None = None,
    angles: Mapping[str, float | str] | None = None,
    rates: Mapping[str, float | str] | None = None,
    ignore: str | Iterable[str] = (), gravity: ArrayLike | None = None,
    position: ArrayLike = (0.0, 0.0, 0.0), quaternion: ArrayLike | None = None,
    velocity: ArrayLike | None = None, angular_velocity: ArrayLike | None = None,
    rep: RepName = "gamma", limits: float | None = None,
) -> Model:
    """Return the model of a robot in SDF: ``read_sdf(...).model()``, with its arguments.

    Redundant constraints of its loops are left out, with a warning that names them.

    Raises
    ------
    InputError
        With file, line, link or joint, and cure.
    """
    return _without_redundant(read_sdf(
        path, base=base, angles=angles, rates=rates, ignore=ignore, gravity=gravity,
        position=position, quaternion=quaternion, velocity=velocity,
        angular_velocity=angular_velocity, rep=rep, limits=limits), path)


def robot_model(
    text: str, path: str | Path, rep: str | None, settings: Mapping[str, str]
) -> Model:
    """Return the model of a robot's file, with settings as a command has them.

    A file that ends in .xml is MJCF, URDF or SDF, as its outermost element says.

    Raises
    ------
    InputError
        With file and cure.
    """
    kind = _outermost(text, path) if str(path).endswith(".xml") else Path(path).suffix[1:]
    if kind == "sdf":
        build = parse_sdf(text, path, **read_settings(settings, rep, _PLACED))
        return _without_redundant(build, path)
    own = dict(settings)
    loops = read_loops(own.pop("loops")) if "loops" in own else None
    close = loops.close if loops else None
    urdf = kind in ("robot", "urdf")
    if urdf:
        build = parse_urdf(text, path, close=close, **read_settings(own, rep, _PLACED))
    else:
        build = parse_mjcf(text, path, close=close, **read_settings(own, rep, ("keyframe",)))
    if loops:
        return loops.model(build)
    return build.model() if urdf and _LOOP not in text else _without_redundant(build, path)


def read_settings(
    settings: Mapping[str, str], rep: str | None, own: Sequence[str]
) -> dict[str, Any]:
    """Return arguments of a reader for settings as a command has them.

    ``ignore=limits,collision``, ``gravity=0,0,-1.62``, ``limits=1000``, ``JOINT=0.5`` or
    ``JOINT="30 deg"`` for an angle or travel, ``JOINT.rate=1``, several numbers for ball and free
    joints, ``root=0,0,1,1,0,0,0``; and the keys of a format, ``base=floating``, ``keyframe=home``.
    """
    options: dict[str, Any] = {"angles": {}, "rates": {}, "rep": rep or "gamma"}
    for key, text in settings.items():
        if key not in (*_COMMON, *own):
            joint, _, rate = key.rpartition(".")
            kind, name = ("rates", joint) if rate == "rate" else ("angles", key)
            parts = [_number_or_text(part) for part in text.split(",")]
            options[kind][name] = parts if len(parts) > 1 else parts[0]
        elif key == "ignore":
            options[key] = [name.strip() for name in text.split(",")]
        elif key in ("base", "keyframe"):
            options[key] = text
        else:
            numbers = [_number_or_text(part) for part in text.split(",")]
            for part in numbers:
                if isinstance(part, str):
                    raise InputError(f"{key}={shown(part)} is no number; write for example "
                                     f"{key}=0.5.")
            options[key] = numbers[0] if key == "limits" else numbers
    return options


def _number_or_text(text: str) -> float | str:
    """Return a number, or a text, which may be an angle with a unit."""
    number = decimal(text)
    return text if number is None else float(number)


def _outermost(text: str, path: str | Path) -> str:
    try:
        return read_xml(text).name
    except InputError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None


def _without_redundant(builder: Multibody, path: str | Path) -> Model:
    """Return the model without redundant constraints, which planar loops have."""
    try:
        model = builder.model(redundant="leave out")
    except InputError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None
    if builder.redundancy and builder.redundancy.left_out:
        warn(f"{builder.redundancy} They are left out.")
    return model


def _located(builder: Multibody, path: Path) -> Multibody:
    """Return bodies and joints with the paths of meshes that the file at ``path`` names."""
    builder._visuals = {name: [located(shape, path) for shape in shapes]
                        for name, shapes in builder._visuals.items()}
    return builder


def _read(
    path: str | Path, loops: str | Path | None, **options: Any
) -> tuple[Multibody, Loops | None, bool]:
    """Return a robot, what closes its loops, and whether it has some of its own."""
    file = as_path("path", path, "robot.urdf")
    closing = None if loops is None else read_loops(as_path("loops", loops, "loops.toml"))
    close = None if closing is None else closing.close
    text = model_text(file)
    return _located(parse_urdf(text, file, close=close, **options), file), closing, _LOOP in text


@dataclass(frozen=True)
class Loops:
    """Joints and springs that close the loops of a robot."""

    content: TomlTable

    def close(self, builder: Multibody, links: Mapping[str, Mount]) -> None:
        """Add the joints, between links."""
        known = {"ground": Mount(GROUND, IDENTITY, IDENTITY), **links}
        frames = {name: mount.frame for name, mount in known.items()}

        def one(table: TomlTable) -> Any:
            names = table.strings("bodies")

            def in_bodies(values: dict[str, Any]) -> dict[str, Any]:
                mounts = [known[name] for name in names]
                points = {key: mounts[i].inner.x + mounts[i].inner.R @ np.array(values[key], float)
                          for key, i in _POINTS.items() if key in values}
                axes = {key: mounts[i].space.R @ np.array(values[key], float)
                        for key, i in _AXES.items() if key in values}
                in_space = {"axis": "axis_in_space", "axis_on_body": "axis_in_space"}
                return {in_space.get(key, key): one
                        for key, one in (values | points | axes).items()}

            return join(builder, frames, table, in_bodies)

        for table in self.content.tables("joints"):
            telling(table, one, table)

    def model(self, builder: Multibody) -> Model:
        """Return the model, without the redundant constraints that the file names."""
        try:
            return finished(builder, self.content)
        except InputError as error:
            if str(error).startswith("The model file"):
                raise
            raise self.content.file_error(str(error)) from None


def read_loops(path: str | Path) -> Loops:
    """Return the loops of a TOML file.

    Raises
    ------
    InputError
        With file, key and cure.
    """
    content = load_toml(model_text(path), Path(path))
    content.allow("joints", "without", "redundant")
    if not content.tables("joints"):
        raise content.file_error("it closes no loop; write [[joints]].")
    return Loops(content)
