"""A sweep as a TOML file.

    name = "gamma-dt"                # of the picture; the file's name by default
    model = "fast-top"               # or a model file, relative to this one
    scheme = "G-L 2"                 # or an axis
    steps = 1000                     # or t_end = 1.0
    keep = ["energy_error_max"]      # results; all by default

    [settings]                       # arguments of a built-in problem
    [parameters]                     # gamma = "h"

    [grid]                           # axes, in order
    gamma = { from = 4e-4, to = 4e-3, count = 100, spacing = "log" }
    dt = [1e-3, 2e-3]
    start = { angular_velocity = [[0, 0, 100], [0, 0, 120]] }
    point = { I1 = [2e-3, 3e-3], mgl = [0.4, 0.5] }            # vary together
    drawn = { count = 50, seed = 7, I3 = { from = 5e-4, to = 9e-4 } }

    [events]                         # first time and count of each cell
    low = "height=0.1 down"

Also: stages, order, rep, real, frame, dt, dtau, every, solver, tolerance, max_iterations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..core.arguments import as_integer, proposal
from ..core.errors import InputError
from ..core.event import Event, event_of_text
from ..core.former_names import former_argument
from ..core.registry import RULES
from ..core.start import Rule
from ..generator.models.toml_tables import load_toml, number_of_text
from ..generator.parsing.text_file import UnusableFileError, read_text
from ..generator.spec import is_model_file
from .plan import plan
from .study import Study, as_table
from .sweep_model import NamedModel

__all__ = ["StudyFile", "load_study", "parse_study"]

#: Some 10^6 numbers of lists of points, which a file may hold.
_MOST_BYTES = 2**24
_OPTIONS: dict[str, tuple[type, ...]] = {
    "scheme": (str,), "stages": (int,), "order": (int,), "rep": (str,), "real": (str,),
    "frame": (str,), "dt": (int, float), "dtau": (int, float), "steps": (int,),
    "t_end": (int, float), "every": (int,),
    "solver": (str,), "tolerance": (int, float), "max_iterations": (int,),
}
_KEYS = {"name", "model", "keep", "settings", "parameters", "grid", "events", *_OPTIONS}


@dataclass(frozen=True)
class StudyFile:
    """Contents of a study file: the study, and the results to store."""

    study: Study
    keep: list[str] | None


def load_study(path: Path) -> StudyFile:
    """Return the study of a TOML file.

    Raises InputError naming file, key and cure.
    """
    try:
        text = read_text(path, _MOST_BYTES)
    except UnusableFileError as error:
        raise InputError(f"The study file {str(path)!r} is not usable: {error}") from None
    return parse_study(text, path)


def parse_study(text: str, path: Path) -> StudyFile:
    """Return the study that a file's text describes; ``path`` is where it lies.

    Raises InputError.
    """
    where = f"The study file {str(path)!r}"
    content = dict(load_toml(text, path, "study file").content)
    for key in content:
        if key not in _KEYS and (cure := former_argument("sweep", key, ())):
            raise InputError(f"{where} has the key {key!r} of earlier versions; {cure}.")
        if key not in _KEYS:
            raise InputError(f"{where} has the unknown key {key!r}; it may have "
                             f"{', '.join(sorted(_KEYS))}{proposal(key, _KEYS)}.")
    try:
        return StudyFile(_study(content, path), _keep(content))
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _study(content: dict[str, Any], path: Path) -> Study:
    """Return the study that a file describes; a model file is named relative to it."""
    model = _text(content, "model")
    if is_model_file(model):
        model = str(path.parent / model)
    options = {key: content[key] for key in _OPTIONS if key in content}
    for key, option in options.items():
        count = as_integer(option)
        if _OPTIONS[key] == (int,) and count is not None:
            options[key] = count  # 1e3 is a float in TOML
        elif isinstance(option, bool) or not isinstance(option, _OPTIONS[key]):
            kind = "text" if str in _OPTIONS[key] else "a number"
            raise InputError(f"{key} = {option!r} is not {kind}.")
    name = content.get("name", path.stem)
    if not isinstance(name, str):
        raise InputError(f"name = {name!r} is not text.")
    settings, grid, numbers, events = (as_table(content.get(table, {}), table)
                                       for table in ("settings", "grid", "parameters", "events"))
    # the text of a rule, such as gamma = "h"
    parameters = {key: Rule(option) if option in RULES else option
                  for key, option in numbers.items()}
    study = plan(NamedModel(model, settings), grid, parameters=parameters, events=_events(events),
                 **options)
    return replace(study, name=name)


def _events(table: Mapping[str, Any]) -> list[Event]:
    """Return the events of the table [events], each given by a text."""
    for name, text in table.items():
        if not isinstance(text, str):
            raise InputError(f'[events] {name} = {text!r} is not text; write for example {name} = '
                             '"height=0.1 down".')
    return [event_of_text(text, name, number_of_text) for name, text in table.items()]


def _text(content: dict[str, Any], key: str) -> str:
    """Return the text under a key, or refuse another type."""
    text = content.get(key)
    if not isinstance(text, str):
        raise InputError(f"{key} = {text!r} is not text; write for example {key} = "
                         '"fast-top", or the name of a model file.')
    return text


def _keep(content: dict[str, Any]) -> list[str] | None:
    """Return the names of results to keep, None for all; refuse anything but a list of names."""
    keep = content.get("keep")
    if keep is None:
        return None
    if not isinstance(keep, list) or not all(isinstance(name, str) for name in keep):
        raise InputError(f"keep = {keep!r} is no list of results; write for example "
                         '["energy_error_max", "status"].')
    return keep
