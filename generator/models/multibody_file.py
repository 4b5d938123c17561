"""The model file of several bodies: [[bodies]], [[joints]], [[forces]], gravity.

    name = "double_top"
    [[bodies]]
    name = "upper"
    mass = 1
    inertia = [0.1, 0.1, 0.02]
    position = [0, 0, 0.5]
    angular_velocity = [0, 0, 50]
    [[bodies]]
    name = "lower"
    mass = 1
    inertia = [0.1, 0.1, 0.02]
    position = [0, 0, 1.5]
    [[joints]]
    name = "foot"
    type = "fixed_point"
    bodies = ["upper"]
    at = [0, 0, 0]
    [[joints]]
    name = "hip"
    type = "ball"
    bodies = ["upper", "lower"]
    at = [0, 0, 1]

Keys are arguments of ``multibody``. Symbols of formulas are, for a body named a, a_q0..a_q3, a_x,
a_y, a_z, a_R11..a_R33, and in forces and quantities its momenta, a_omega1..a_omega3 (body axes)
and t, besides the file's parameters; for a joint named j, j_angle and j_rate, j_travel and j_speed.
Point masses are tables [[point_masses]] with name, mass, position and velocity; wheels in
[[rotors]] with name, bodies, mass, inertia = [along, across], axis, at or on_body, and rate: its
bearing is the joint NAME_bearing. Beams are tables [[beams]] whose keys are arguments of
``Multibody.beam``; their frames are NAME_first, NAME_last and the segments NAME_1, NAME_2, …, and
symbols of an end are NAME_last_x, _y, _z and _R11.._R33. ``axis`` is in space at the start,
``axis_on_body`` in the axes of the first body. What acts on joints has ``joints`` in place of
bodies:

    [[joints]]
    name = "mesh"
    type = "gear"
    joints = ["first", "second"]
    teeth = [17, 43]
    [[forces]]
    name = "drive"
    type = "motor"
    joints = ["first"]
    torque = "2 - 0.1*first_rate"

Impacts are tables [[contacts]], [[stops]] and [[latches]], whose keys are arguments of
``Multibody.contact``, with bodies or a gap, of ``Multibody.stop`` and ``Multibody.latch``; a
restitution may name a parameter:

    [[contacts]]
    name = "floor"
    bodies = ["upper"]
    box = [0.1, 0.1, 0.5]
    restitution = 0.8
    [[stops]]
    name = "end"
    joint = "first"
    upper = "120 deg"
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from typing import Any, cast

import sympy as sp

from ...core.arguments import count_text
from ...core.errors import InputError
from ...core.inertia import REPS, RepName
from ...core.warnings import warn
from ..multibody.beam import Beam, BeamEnd
from ..multibody.body import Body, Frame, Particle
from ..multibody.initial_poses import Attitude
from ..multibody.model import Model
from ..multibody.multibody import AXES, CoordinateName, Multibody
from ..multibody.multibody import JOINTS as KINDS
from ..parsing.grammar import ANGLES, RATES
from .common_tables import Formulas, run_length
from .single_body_file import ATTITUDES, inertia_numbers, read_attitude, read_rep
from .toml_tables import TomlFileError, TomlTable, Units

__all__ = ["build_from", "build_model", "join", "read_bodies"]

#: Bodies, point masses, rotors and beams of a file: costs are measured up to 100 bodies
#: (docs/solving.md).
MAX_BODIES = 100
#: Segments of all beams: costs are measured up to 1000, derived in 100 s (docs/beams.md).
MAX_SEGMENTS = 1000
POINTS = ("on_a", "on_b")

#: Type of a joint → all arguments of the method that makes it.
JOINTS = {kind: inspect.signature(getattr(Multibody, kind)).parameters
          for kind in (*KINDS, "gear", "couple", "flywheel")}
#: Keys of a table of [[beams]].
BEAM = {key: parameter for key, parameter in inspect.signature(Multibody.beam).parameters.items()
        if key != "self"}
#: Type of a force → its keys besides name, type and bodies, or joints.
FORCES = {
    "spring": ("stiffness", "length", "damping", *POINTS),
    "force": ("force", "on_body"),
    "torque": ("torque",),
    "joint_spring": ("stiffness", "damping", "rest", "coordinate"),
    "motor": ("torque", "force"),
}
#: Types that act on so many joints.
ON_JOINTS = {"gear": 2, "couple": 2, "flywheel": 1, "joint_spring": 1, "motor": 1}
#: Keys whose text may have a unit.
WITH_UNITS = {"rate": RATES, "rate_a": RATES, "rate_b": RATES, "turning": RATES, "angle": ANGLES,
              "twist": ANGLES}


def read_bodies(content: TomlTable, name: str, formulas: Formulas, rep: str | None) -> Model:
    """Return the model of a file with [[bodies]]; ``rep``, unless None, replaces every body's.

    Raises InputError with file, key and cure; for redundant constraints with a smallest set to
    leave out.
    """
    content.allow("name", "description", "frame", "bodies", "point_masses", "rotors", "beams",
                  "joints", "forces", "gravity", "potential", "without", "redundant", "parameters",
                  "inputs", "run", "quantities", "points", "drives", "events", "units",
                  "time_scale", "contacts", "stops", "latches")
    gravity = content.vector("gravity", 3) if "gravity" in content else (0.0, 0.0, -9.81)
    builder = Multibody(name, gravity=gravity, **run_length(content))
    bodies = _add_bodies(content, builder, rep)
    _add_other_frames(content, builder, bodies, rep)
    # The system lists its parameters in the order in which they are added: before the points, whose
    # paths may contain them; without points, behind the numbers of joints.
    has_points = bool(content.tables("points"))
    if has_points:
        _add_parameters(builder, formulas)
    for table in content.tables("points"):
        bodies[table.text("name", "")] = build_from(
            table, lambda table: _add_point(builder, table, formulas))
    for table in content.tables("joints"):
        build_from(table, lambda table: join(builder, bodies, table))
    # from here on, formulas may have coordinates, angles and travels of joints, ``position``;
    # formulas of forces and quantities may also have rates, momenta and t, ``motion``
    position, motion = _symbols_of_formulas(builder, bodies, formulas.parameters)
    if not has_points:
        _add_parameters(builder, formulas)
    for table in content.tables("drives"):
        build_from(table, lambda table: _add_drive(builder, table, formulas))
    for table in content.tables("forces"):
        build_from(table, lambda table: _add_force(builder, bodies, table, formulas, motion))
    # t is the time, unless the file has a parameter of this name
    time = {} if "t" in formulas.parameters else {"t": builder.time}
    _add_impacts(content, builder, bodies, formulas, position | time)
    if "potential" in content:
        builder.potential(formulas.read(content, "potential", content.formula("potential"),
                                        position | time))
    for key, e in formulas.quantities(motion).items():
        builder.quantity(key, e)
    if "time_scale" in content:
        builder.time_scale(formulas.read(content, "time_scale", content.formula("time_scale"),
                                         motion))
    return build_model(builder, content)


def _add_other_frames(
    content: TomlTable, builder: Multibody, bodies: dict[str, Frame], rep: str | None
) -> None:
    """Add point masses, rotors and beams; ``bodies``, frames by name, gets theirs."""
    for kind, make in (("point_masses", _add_point_mass), ("rotors", _add_rotor)):
        for table in content.tables(kind):
            bodies[table.text("name", "")] = build_from(table, partial(make, builder, bodies))
    for table in content.tables("beams"):
        beam = build_from(table, lambda table: _add_beam(builder, table, rep))
        bodies |= {frame.name: frame for frame in (*beam.segments, beam.first, beam.last)}


def _add_impacts(
    content: TomlTable, builder: Multibody, bodies: Mapping[str, Frame], formulas: Formulas,
    position: Mapping[str, sp.Expr],
) -> None:
    """Add contacts, latches and stops; ``position`` has the names that gaps may contain."""
    for kind, own_key in (("contacts", "restitution"), ("latches", "close")):
        for table in content.tables(kind):
            build_from(table, partial(_add_contact, builder, bodies, formulas=formulas,
                                      position=position, own_key=own_key))
    for table in content.tables("stops"):
        build_from(table, lambda table: _add_stop(builder, table, formulas))


def build_model(builder: Multibody, content: TomlTable) -> Model:
    """Return the model, without the constraints that the file leaves out.

    ``without`` names them, and ``redundant = "leave out"`` leaves out all that others imply.
    """
    redundant = content.choice("redundant", ("refuse", "leave out"), "refuse")
    model = builder.model(without=content.strings("without"), redundant=cast("Any", redundant))
    if builder.redundancy and builder.redundancy.left_out:
        warn(f"{builder.redundancy} They are left out, as the file asks.")
    return model


def _add_parameters(builder: Multibody, formulas: Formulas) -> None:
    """Add the file's parameters to the builder, with their values."""
    for parameter, value in formulas.numbers.values.items():
        builder.parameter(parameter, value)


def _add_point(builder: Multibody, table: TomlTable, formulas: Formulas) -> Frame:
    """Add a point of the ground that moves by formulas of t, and return it."""
    table.allow("name", "path")
    table.require("name", "path")
    path = formulas.read_all(table, "path", {"t": builder.time}, count=3)
    return builder.moving_point(table.symbol("name", table.text("name")), path)


def _add_drive(builder: Multibody, table: TomlTable, formulas: Formulas) -> None:
    """Add a driven joint, whose angle is a formula of t."""
    table.allow("name", "joint", "angle")
    table.require("name", "joint", "angle")
    law = formulas.read(table, "angle", table.formula("angle"), {"t": builder.time})
    builder.drive(table.symbol("name", table.text("name")), table.text("joint"), angle=law)


def _add_bodies(content: TomlTable, builder: Multibody, rep: str | None) -> dict[str, Frame]:
    """Add the bodies of [[bodies]]; return frames by name, the ground among them."""
    tables = content.tables("bodies")
    count = len(tables) + sum(len(content.tables(kind))
                              for kind in ("point_masses", "rotors", "beams"))
    if not 1 <= count <= MAX_BODIES:
        raise content.error("bodies", f"has {count} tables with point_masses, rotors and beams; "
                                      f"write 1 to {MAX_BODIES}.")
    segments = sum(table.count("count") for table in content.tables("beams") if "count" in table)
    if segments > MAX_SEGMENTS:
        raise content.error("beams", f"have {segments} segments; write a count of at most "
                                     f"{MAX_SEGMENTS} for all together.")
    frames: dict[str, Frame] = {"ground": builder.ground}
    for table in tables:
        table.allow("name", "mass", "inertia", "rep", *REPS, "position", *ATTITUDES, "velocity",
                    "angular_velocity")
        table.require("name", "mass", "inertia")
        name = table.symbol("name", table.text("name"))
        frames[name] = build_from(table, lambda table: _add_body(builder, table, rep))
    return frames


def _add_body(builder: Multibody, table: TomlTable, rep: str | None) -> Body:
    """Add a rigid body of [[bodies]]; ``rep``, unless None, replaces the table's."""
    representation = read_rep(table) if rep is None else rep
    vectors = {key: table.vector(key, 3) for key in ("position", "velocity") if key in table}
    if "angular_velocity" in table:
        vectors["angular_velocity"] = table.vector("angular_velocity", 3, RATES)
    q = read_attitude(table)
    return builder.body(
        table.text("name"), mass=table.number("mass"), inertia=inertia_numbers(table),
        rep=cast("RepName", representation),
        weight=table.number(representation) if representation in table else None,
        rotation=None if q is None else Attitude(q), **cast("dict[str, Any]", vectors),
    )


def _add_point_mass(builder: Multibody, bodies: Mapping[str, Frame], table: TomlTable) -> Body:
    """Add a point mass; ``bodies`` is not used, but belongs to the signature of ``_add_rotor``."""
    table.allow("name", "mass", "position", "velocity")
    table.require("name", "mass")
    vectors = {key: table.vector(key, 3) for key in ("position", "velocity") if key in table}
    return builder.point_mass(table.symbol("name", table.text("name")), mass=table.number("mass"),
                              **cast("dict[str, Any]", vectors))


def _add_rotor(builder: Multibody, bodies: Mapping[str, Frame], table: TomlTable) -> Body:
    """Add a wheel on a body; its bearing is a joint that motors may name."""
    table.allow("name", "bodies", "mass", "inertia", *AXES, "at", "on_body", "rate")
    table.require("name", "bodies", "mass", "inertia")
    vectors = {key: table.vector(key, 3) for key in (*AXES, "at", "on_body") if key in table}
    return builder.rotor(
        table.symbol("name", table.text("name")), *_frames(table, bodies, count=1),
        mass=table.number("mass"), inertia=table.vector("inertia", 2),
        rate=table.number("rate", RATES) if "rate" in table else 0.0,
        **cast("dict[str, Any]", vectors))


def _add_beam(builder: Multibody, table: TomlTable, rep: str | None) -> Beam:
    """Add a beam or cable; ``rep``, unless None, replaces the table's."""
    table.allow(*BEAM)
    table.require(*(key for key, parameter in BEAM.items() if parameter.default is parameter.empty))
    # the keys of a beam are the arguments of ``Multibody.beam``: vectors or numbers by their type
    values: dict[str, Any] = {}
    for key, parameter in BEAM.items():
        if key not in table or key in ("name", "count", "bending", "points", "rep"):
            continue
        if "ArrayLike" in str(parameter.annotation):
            values[key] = table.vector(key, 3, RATES if key == "angular_velocity" else {})
        else:
            values[key] = table.number(key, WITH_UNITS.get(key, {}))
    values["bending"] = table.vector("bending", 2) if isinstance(
        table.content["bending"], list) else table.number("bending")
    if "points" in table:
        values["points"] = table.rows("points", 3)
    values["rep"] = table.choice("rep", REPS, "gamma") if rep is None else rep
    return builder.beam(table.symbol("name", table.text("name")), count=table.count("count"),
                        **values)


def build_from(table: TomlTable, build: Callable[[TomlTable], Any]) -> Any:
    """Return ``build(table)``; an InputError of it gets the file and the table."""
    try:
        return build(table)
    except TomlFileError:  # an error of the table's own keys, which names file, table and key
        raise
    except InputError as problem:
        raise table.file_error(f"{table.where}{problem}") from None


def _symbols_of_formulas(
    builder: Multibody, bodies: Mapping[str, Frame], reserved: Collection[str]
) -> tuple[dict[str, sp.Expr], dict[str, sp.Expr]]:
    """Return name → expression of the symbols in formulas of position, and of position and motion.

    Position: coordinates, axes of bodies, angles and travels of joints. Motion: also momenta,
    angular velocities, rates of joints and t. A measure of a joint with one of the names
    ``reserved``, which parameters have, is left out.
    """
    position: dict[str, sp.Expr] = {}
    motion: dict[str, sp.Expr] = {"t": builder.time}
    for name, body in bodies.items():
        # an end of a beam has a place, but no coordinates of its own
        if isinstance(body, BeamEnd):
            position |= {f"{name}_{x}": e for x, e in zip("xyz", body.point(), strict=True)}
            position |= _axes(name, body.segment)
        elif isinstance(body, Particle):
            position |= {str(x): x for x in body.x}
            motion |= {str(x): x for x in body.p_x}
        elif isinstance(body, Body):
            position |= {str(x): x for x in (*body.q, *body.x)}
            position |= _axes(name, body)
            motion |= {str(x): x for x in (*body.p, *body.p_x)}
            motion |= {f"{name}_omega{i}": e for i, e in enumerate(body.angular_velocity, 1)}
    for kind, symbols in builder.measured(reserved).items():
        (position if kind in ("angle", "travel") else motion).update(symbols)
    return position, position | motion


def _axes(name: str, body: Body) -> dict[str, sp.Expr]:
    """Return NAME_R11 … NAME_R33 → the entries of R(q) of a body, from its axes to space."""
    R = body.rotation
    return {f"{name}_R{i + 1}{j + 1}": R[i, j] for i in range(3) for j in range(3)}


def join(
    builder: Multibody, bodies: Mapping[str, Frame], table: TomlTable,
    locate: Callable[[dict[str, Any]], dict[str, Any]] = dict,
) -> None:
    """Call the method of the joint's type with the keys of its table.

    The keys are the method's keyword arguments, whose annotations say whether they are vectors,
    pairs or numbers. ``locate`` converts points and axes of the table to the builder's arguments;
    by default they are these arguments already.
    """
    # keyword arguments of the methods: the others are the name and the bodies or joints
    keys = {kind: {key: parameter for key, parameter in parameters.items()
                   if parameter.kind is parameter.KEYWORD_ONLY}
            for kind, parameters in JOINTS.items()}
    kind = _kind(table, {kind: tuple(names) for kind, names in keys.items()})
    table.require("name", *(key for key, parameter in keys[kind].items()
                            if parameter.default is parameter.empty))
    frames: Sequence[Frame | str] = (
        _joints(table, kind) if kind in ON_JOINTS else
        _frames(table, bodies, 2 if "b" in JOINTS[kind] else 1))
    values: dict[str, Any] = {}
    for key, parameter in keys[kind].items():
        if key not in table:
            continue
        annotation = str(parameter.annotation)
        if key == "rotation":
            values[key] = table.matrix(key, 3)
        elif "ArrayLike" in annotation:
            values[key] = table.vector(key, 3)
        elif "tuple" in annotation:
            values[key] = table.vector(key, 2)
        else:
            # an offset has the unit of the second joint's coordinate
            units = (_units_of(builder, frames[1], f"{table.text('name')!r}") if key == "offset"
                     else WITH_UNITS.get(key, {}))
            values[key] = table.number(key, units)
    getattr(builder, kind)(table.symbol("name", table.text("name")), *frames, **locate(values))


def _add_force(
    builder: Multibody, bodies: Mapping[str, Frame], table: TomlTable, formulas: Formulas,
    motion: Mapping[str, sp.Expr],
) -> None:
    """Add a motor, a spring, or a force or torque on a body.

    ``motion`` has the names that formulas of forces may contain.
    """
    kind = _kind(table, FORCES)
    points = {key: table.vector(key, 3) for key in ("on_body", *POINTS) if key in table}
    if kind == "motor":
        table.require("name")
        efforts = {key: formulas.read(table, key, table.formula(key), motion)
                   for key in FORCES[kind] if key in table}
        builder.motor(table.symbol("name", table.text("name")), *_joints(table, kind), **efforts)
        return
    if kind in ("spring", "joint_spring"):
        _add_spring(builder, bodies, table, kind, points)
        return
    table.require(kind)
    (body,) = _frames(table, bodies, count=1)
    if not isinstance(body, Body | BeamEnd):
        raise table.error("bodies", "is the ground, which nothing moves; name a body.")
    entries = formulas.read_all(table, kind, motion, count=3)
    getattr(builder, kind)(body, entries, **points)


def _add_spring(
    builder: Multibody, bodies: Mapping[str, Frame], table: TomlTable, kind: str,
    points: Mapping[str, Any],
) -> None:
    """Add a spring between two points, or one in a joint: ``kind`` "spring" or "joint_spring"."""
    # a joint spring may be a damper alone, which has no rest
    is_damper = kind == "joint_spring" and "damping" in table and "rest" not in table
    table.require("name", *([] if is_damper else ["stiffness"]))
    frames: Sequence[Frame | str] = (
        _joints(table, kind) if kind in ON_JOINTS else _frames(table, bodies, count=2))
    numbers: dict[str, Any] = {}
    if kind == "joint_spring":
        numbers["coordinate"] = _chosen_coordinate(table)
    for key in FORCES[kind]:
        if key not in table or key in (*POINTS, "coordinate"):
            continue
        # an interval of rest has two numbers
        units = (_units_of(builder, frames[0], f"Spring {table.text('name')!r}",
                           _chosen_coordinate(table)) if key == "rest" else {})
        has_interval = key == "rest" and isinstance(table.content[key], list)
        numbers[key] = (tuple(table.vector(key, 2, units)) if has_interval
                        else table.number(key, units))
    getattr(builder, kind)(table.symbol("name", table.text("name")), *frames, **numbers, **points)


def _add_contact(
    builder: Multibody, bodies: Mapping[str, Frame], table: TomlTable, formulas: Formulas,
    position: Mapping[str, sp.Expr], own_key: str,
) -> None:
    """Add a contact of bodies, or of a gap; with ``own_key`` = "close" a latch.

    ``own_key`` is the key that contacts and latches do not share, "restitution" or "close".
    ``position`` has the names that a gap may contain: coordinates, time and parameters.
    """
    table.allow("name", "bodies", "gap", "on_a", "on_b", "normal", "radius", "box", own_key)
    table.require("name", *(() if "bodies" in table else ("gap",)),
                  *(("close",) if own_key == "close" else ()))
    values: dict[str, Any] = {key: table.vector(key, 3) for key in ("on_a", "on_b", "normal", "box")
                              if key in table and not table.is_matrix(key)}
    if table.is_matrix("on_a"):
        values["on_a"] = table.rows("on_a", 3)
    if "radius" in table:
        values["radius"] = table.vector("radius", 2) if isinstance(
            table.content["radius"], list) else table.number("radius")
    if "gap" in table:
        values["gap"] = formulas.read_all(table, "gap", position) if isinstance(
            table.content["gap"], list) else formulas.read(
                table, "gap", table.formula("gap"), position)
    # one name is the body a, which touches the ground
    if "bodies" in table:
        names = "ab" if len(table.strings("bodies")) == 2 else "a"
        values |= zip(names, _frames(table, bodies, len(names)), strict=True)
    if own_key == "close":
        builder.latch(table.text("name"), close=table.strings("close"), **values)
    else:
        builder.contact(table.text("name"), **values, **_restitution(table, formulas))


def _add_stop(builder: Multibody, table: TomlTable, formulas: Formulas) -> None:
    """Add an end of the range of a joint, or both."""
    table.allow("name", "joint", "lower", "upper", "restitution", "coordinate")
    table.require("name", "joint")
    units = _units_of(builder, table.text("joint"), f"Stop {table.text('name')!r}",
                      _chosen_coordinate(table))
    bounds: dict[str, Any] = {key: table.number(key, units) for key in ("lower", "upper")
                              if key in table}
    builder.stop(table.text("name"), table.text("joint"), **bounds, **_restitution(table, formulas),
                 coordinate=_chosen_coordinate(table))


def _units_of(
    builder: Multibody, joint: Any, label: str, coordinate: CoordinateName | None = None
) -> Units:
    """Return the units of a joint's coordinate in a file: angles have some, travels none.

    ``label`` begins the message for what is no joint; ``coordinate`` is the one that is chosen.
    """
    slides = "travel" in builder._components.joint(joint, label).MEASURES
    return {} if (coordinate or ("travel" if slides else "angle")) == "travel" else ANGLES


def _chosen_coordinate(table: TomlTable) -> CoordinateName | None:
    """Return the choice of a joint's coordinate, None where there is none."""
    return cast("CoordinateName", table.text("coordinate")) if "coordinate" in table else None


def _restitution(table: TomlTable, formulas: Formulas) -> dict[str, Any]:
    """Return a restitution, a number or the name of a parameter, if there is one."""
    e = table.content.get("restitution")
    if isinstance(e, str) and e in formulas.parameters:
        formulas.mentioned.add(e)
        return {"restitution": formulas.parameters[e]}
    return {} if e is None else {"restitution": table.number("restitution")}


def _kind(table: TomlTable, kinds: Mapping[str, tuple[str, ...]]) -> str:
    """Return the type of a joint or force; refuse keys other than ``kinds[type]``."""
    table.require("type")
    kind = table.choice("type", tuple(kinds), default="")
    frames_key = "joints" if kind in ON_JOINTS else "bodies"
    table.require(frames_key)
    table.allow("name", "type", frames_key, *kinds[kind])
    return kind


def _joints(table: TomlTable, kind: str) -> list[str]:
    """Return the names under ``joints``, as many as a joint or force of this type acts on."""
    names = table.strings("joints")
    if len(names) != ON_JOINTS[kind]:
        raise table.error("joints", f"has {count_text(len(names), 'name')}; write "
                                    f"{ON_JOINTS[kind]}.")
    return names


def _frames(table: TomlTable, bodies: Mapping[str, Frame], count: int) -> list[Frame]:
    """Return the frames whose names are under the key ``bodies``, ``count`` of them."""
    names = table.strings("bodies")
    if len(names) != count:
        raise table.error("bodies", f"has {count_text(len(names), 'name')}; write {count}.")
    for name in names:
        if name not in bodies:
            raise table.error("bodies", f"names {name!r}, which is none of "
                                        f"{', '.join(bodies)}; correct it.")
    return [bodies[name] for name in names]
