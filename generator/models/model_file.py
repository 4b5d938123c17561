"""A user's own model, read from a TOML file, or a robot from URDF (``urdf``), MJCF
(``mjcf_builder``) or SDF (``sdf``).

A body with a fixed point, ``single_body_file``:

    name = "satellite"
    potential = "3*mu/(2*r**3)*(I1*R31**2 + I2*R32**2 + I3*R33**2)"
    [body]
    inertia = [1.0, 2.0, 3.0]
    [parameters]
    mu = 3.986e14
    r = 7e6
    [start]
    euler = [0, "30 deg", 0]
    angular_velocity = [0, 0, 0.001]
    [run]
    dt = 10
    steps = 1000

or any holonomic Hamiltonian system, ``system_file``:

    name = "pendulum"
    [system]
    coordinates = ["x", "y"]
    momenta = ["px", "py"]
    hamiltonian = "(px**2 + py**2)/(2*m) + m*g*y"
    constraints = ["x**2 + y**2 - l**2"]
    [parameters]
    m = 1
    g = 9.81
    l = 0.5
    [units]
    m = "kg"
    l = "m"
    [start]
    q = [0.5, 0]
    p = [0, 0]
    [events]
    bottom = "x=0 up"

or several bodies with joints, ``multibody_file``. With ``frame = "symmetries"`` its steppers have
co-moving frames. Formulas are read by ``formulas``;
wherever a number stands, a text such as "pi/6" may stand too, and an angle or a rate in text may
have a unit. ``description``, ``[run]``, ``[quantities]``, ``[events]`` and forces may be left out.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ...core.arguments import as_mapping, as_path, choose, join_or, proposal, shown
from ...core.errors import InputError
from ...core.event import Event, event_of_text
from ...core.inertia import REPS, RepName
from ...core.mesh_files import locate_all
from ...core.records import dataclass
from ...core.registry import FRAMES, SYSTEMS
from ...core.warnings import capture_warnings, warn
from ..multibody.model import Model
from ..parsing.grammar import UNITS
from ..parsing.reserved_names import KEYWORDS
from ..parsing.text_file import is_robot, model_text
from .common_tables import Formulas, ParameterValues
from .multibody_file import read_bodies
from .robots import NO_OPTIONS, read_settings, refuse_other_options, robot_model
from .single_body_file import read_body
from .system_file import read_system
from .toml_tables import TomlFileError, TomlTable, load_toml

__all__ = ["ModelFile", "load_model", "parse_model", "read_model"]

NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")

#: Table of a kind of model → its reader.
KINDS: Mapping[str, Callable[[TomlTable, str, Formulas, str | None], Model]] = {
    "body": read_body,
    "system": read_system,
    "bodies": read_bodies,
}


@dataclass(frozen=True)
class ModelFile:
    """Contents of a model file.

    Attributes
    ----------
    model : Model
        The system with its numbers.
    free : list of str
        The parameters from which no other number of the file is computed, so that a run may change
        their values alone.
    """

    model: Model
    free: list[str]


def load_model(
    path: str | Path, rep: RepName | None = None, options: Mapping[str, Any] = NO_OPTIONS
) -> Model:
    """Return the model of a TOML file, or of a robot's; ``gyrospark.load_model`` with ``options``.

    Raises
    ------
    InputError
        With file, key and cure, for whatever in the file is no model.
    """
    file = as_path("path", path, "top.toml")
    chosen_rep = None if rep is None else choose("representation", rep, REPS)
    text = model_text(file)
    present = {name: value for name, value in options.items() if value is not None}
    if not is_robot(file):
        refuse_other_options("TOML", ("set",), present)
        settings = as_mapping("set", present.get("set", {}), "{'m': 2.0}")
        return read_model(text, file, chosen_rep, {
            key: _toml_text(key, value) for key, value in settings.items()}).model
    with capture_warnings() as messages:
        model = robot_model(text, file, chosen_rep, present)
    _warn_of_file(file, messages)
    return replace(model, visuals=locate_all(model.visuals, file))


def parse_model(text: str, path: str | Path, rep: str | None = None) -> Model:
    """Return the model of a text that was read from a file; see ``load_model``."""
    return read_model(text, path, rep).model


def read_model(
    text: str, path: str | Path, rep: str | None = None,
    settings: Mapping[str, str] = MappingProxyType({}),
) -> ModelFile:
    """Return the contents of a text, with other values for some of its keys.

    ``rep`` is the caller's representation of rotations, in place of the file's. A key of
    ``settings`` is a parameter, or a table and a key: ``"start.euler"``; a value is text as it
    would stand in the file, quotes left out. Raises InputError with file, key and cure, for
    whatever in the file is no model.
    """
    with capture_warnings() as messages:
        content = _parse_model(text, path, rep, settings)
    _warn_of_file(path, messages)
    return content


def _warn_of_file(path: str | Path, messages: Iterable[str]) -> None:
    """Issue the warnings of a model file with its name, each text once."""
    for message in dict.fromkeys(messages):
        warn(f"In the model file {str(path)!r}: {message}")


def _kind_of(content: TomlTable) -> str:
    """Return the one key of ``KINDS`` that a file has; refuse none and several."""
    # several bodies may be point masses or segments of beams alone
    kinds = [kind for kind in KINDS
             if kind in content or (kind == "bodies" and (
                 "point_masses" in content or "beams" in content))]
    if len(kinds) != 1:
        headers = {kind: f"[[{kind}]]" if kind == "bodies" else f"[{kind}]" for kind in KINDS}
        tables = ", ".join(headers[kind] for kind in kinds) or "none of them"
        raise content.file_error(f"it must have one table among {', '.join(headers.values())} "
                                 f"and has {tables}; write one.")
    return kinds[0]


def _parse_model(
    text: str, path: str | Path, rep: str | None, settings: Mapping[str, str]
) -> ModelFile:
    """Return the contents of a text, with the values of ``settings``; see ``read_model``.

    Warnings do not name the file, errors do.
    """
    if is_robot(path):
        options = read_settings(settings, text, path)
        return ModelFile(robot_model(text, path, rep, options), free=[])
    content = load_toml(text, Path(path))
    for key, value in settings.items():
        _set_key(content, key, value)
    kind = _kind_of(content)
    content.require("name", *(() if kind == "bodies" else ("start",)))
    formulas = Formulas(content, ParameterValues(content))
    try:
        model = _with_inputs(KINDS[kind](content, _name(content), formulas, rep), content)
        model = _with_units(_with_events(model, content), content)
        if "frame" in content:
            model = replace(model, frame=content.choice("frame", FRAMES, default=""))
        formulas.warn_of_unused()
        # free parameters: no other number of the file is computed from them, so that a run may
        # change them alone
        mentioned = formulas.numbers.values.mentioned
        return ModelFile(model, [name for name in model.parameters if name in content.table(
            "parameters") and name not in mentioned])
    except TomlFileError:  # an error of a key, which names the file already
        raise
    except InputError as error:  # of a builder, which does not know the file
        raise content.file_error(str(error)) from None


def _with_inputs(model: Model, content: TomlTable) -> Model:
    """Return the model with the parameters in [inputs] as inputs; their values are the defaults."""
    symbols = {str(x): x for x in model.system.parameters}
    table = content.table("inputs")
    for name in table.items():
        if name not in symbols:
            raise table.error(name, "is in no force; write it where it acts, or remove it.")
    inputs = tuple(symbols[name] for name in table.items())
    return replace(model, system=replace(model.system, inputs=inputs)) if inputs else model


def _with_units(model: Model, content: TomlTable) -> Model:
    """Return the model with the units of [units], by name; they replace those it has already."""
    table = content.table("units")
    units = {name: table.text(name) for name in table.items()}
    return replace(model, units={**model.units, **units}) if units else model


def _with_events(model: Model, content: TomlTable) -> Model:
    """Return the model with the events of [events], after those it has already.

    A text such as "x=0 up" has a quantity, a level and a direction.
    """
    table = content.table("events")

    def read(name: str) -> Event:
        """Return the event that the text of a key describes, its level with units."""
        def level(text: str) -> float:
            """Return the number of a level, which may be a formula of parameters."""
            return TomlTable({name: text}, table.where, table.file_error, table.constants).number(
                name, UNITS)

        return event_of_text(table.text(name), table.symbol(name, name), level)

    return replace(model, events=[*model.events, *(read(name) for name in table.items())])


def _name(content: TomlTable) -> str:
    """Return the model's name, or refuse one that is no name in C or is a built-in system's."""
    name = content.text("name")
    if not NAME.fullmatch(name) or name in KEYWORDS:
        raise content.error("name", f"is {name!r}; write at most 40 lower case letters, digits and "
                                    "'_', with a letter first, and no keyword of C.")
    if name in SYSTEMS:
        raise content.error("name", f"is {name!r}, which is a built-in system; choose another.")
    return name


def _toml_text(key: str, value: Any) -> str:
    """Return the text of a value as it would stand in the file."""
    if isinstance(value, str):
        return value
    with suppress(TypeError, ValueError):
        if value is not None:
            return json.dumps(value.tolist() if hasattr(value, "tolist") else value,
                              allow_nan=False)
    raise InputError(f"set[{key!r}] = {shown(value)} is no text, finite number or list of "
                         "these; write it as in the file.")


def _table_at(content: TomlTable, path: Iterable[str]) -> dict[str, Any] | None:
    """Return the table at a path of keys, or of names in arrays such as [[bodies]]; None if absent.
    """
    table: Any = content.content
    for word in path:
        if isinstance(table, list):
            table = next((entry for entry in table if isinstance(entry, dict)
                          and entry.get("name") == word), None)
        else:
            table = table.get(word) if isinstance(table, dict) else None
    return table if isinstance(table, dict) else None


def _set_key(content: TomlTable, key: str, value: str) -> None:
    """Replace a value of the file, or add a key to a table.

    ``key`` is a parameter, a key above all tables, such as "gravity", or tables and a key with dots
    between: "body.inertia", or "bodies.upper.mass" for an entry of [[bodies]] by its name. Raises
    InputError for a parameter, a key above all tables or a table that the file has not.
    """
    parameter_names = list(content.table("parameters").content)
    # above all tables: numbers, texts and lists of them
    top_keys = [name for name, entry in content.content.items() if not isinstance(entry, dict)
                and not (isinstance(entry, list) and any(isinstance(e, dict) for e in entry))]
    known_keys = [*parameter_names, *top_keys]
    if "." in key:
        *path, last = key.split(".")
    else:
        path, last = ([] if key in top_keys and key not in parameter_names else ["parameters"]), key
    table = _table_at(content, path)
    if table is None or ("." not in key and last not in known_keys):
        choices = [f"its {kind} {join_or(keys)}" for kind, keys in (
            ("parameter", parameter_names), ("key", top_keys)) if keys]
        example = "body.inertia" if "body" in content.content else "start.euler"
        raise content.file_error(
            f"it has no {shown(key)}; set {', '.join([*choices, 'or a table and a key'])}, such as "
            f"{example}{proposal(key, known_keys)}.")
    table[last] = _value(value)


def _value(text: str) -> Any:
    """Return the value of a text as in TOML; a text that is no TOML is a formula without quotes."""
    try:
        return tomllib.loads(f"value = {text}")["value"] if "\n" not in text else text
    except (ValueError, RecursionError):
        return text
