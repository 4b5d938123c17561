"""Registries of names: systems, problems, models, frames, rules for γ.

    system     H and g alone: a stepper can be made for it
    problem    a system of the paper with its numbers and, where known, its exact motion
    model      bodies put together, with their numbers

Python (``gs.problems``, ``gs.models``, ``stepper(system=...)``), the command line, certificates
and sweeps all look names up here. An entry costs nothing until it is made.
"""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

from .arguments import join_or, proposal, shown
from .errors import InputError
from .records import dataclass

__all__ = ["AIMS", "FRAMES", "MEANS", "MODELS", "PROBLEMS", "RULES", "SYSTEMS", "Aim", "Entry",
           "Mean", "entry_named", "function_of", "unknown_name"]

_PACKAGE = __name__.partition(".")[0]
_HOME = Path(__file__).resolve().parents[1]

#: The error that a search for γ or a frame minimises.
Aim = Literal["motion", "energy"]
#: A mean of the moments of inertia.
Mean = Literal["m", "h", "mt", "ht"]

#: What ``frame`` may be: co-moving frames along the symmetries of a system (docs/frames.md).
FRAMES = ("symmetries",)


def function_of(home: str, name: str) -> Any:
    """Return a function of a higher package, which is imported when it is asked for."""
    return getattr(import_module(f"{_PACKAGE}.{home}"), name)


@dataclass(frozen=True)
class Entry:
    """A name, and the module of the function that makes its system, problem or model.

    Attributes
    ----------
    name : str
        As on the command line; ``-`` and ``_`` are the same there.
    kind : {"system", "problem", "model"}
        What ``make`` returns: a System, a Problem or a Model.
    home : str
        The module of the function, which is called as the entry with ``_``.
    """

    name: str
    kind: Literal["system", "problem", "model"]
    home: str

    def make(self, *arguments: Any, **options: Any) -> Any:
        """Make the named problem, model or system; a system takes ``rep`` as its argument."""
        return self._function(*arguments, **options)

    @property
    def about(self) -> str:
        """Description: the first sentence of the docstring of its function."""
        first = inspect.getdoc(self._function) or ""
        return " ".join(first.partition("\n\n")[0].split()).removeprefix("Return ")

    @property
    def options(self) -> list[str]:
        """The names of the arguments that ``make`` takes, but for ``rep``."""
        return [name for name in inspect.signature(self._function).parameters if name != "rep"]

    @property
    def _function(self) -> Any:
        """The function that makes it; names have "-" where Python has "_"."""
        return function_of(self.home, self.name.replace("-", "_"))


def _entries(kind: Literal["system", "problem", "model"], home: str, *names: str
             ) -> dict[str, Entry]:
    """Return entries by name: problems, models or systems that functions of the module ``home``
    make."""
    return {name: Entry(name, kind, home) for name in names}


SYSTEMS = _entries("system", "generator.multibody.rigid_body", "heavy_top", "free_body")
PROBLEMS = _entries("problem", "runtime.rigid_body.problems", "fast-top", "regular-precession",
                    "free-body")
MODELS = _entries("model", "generator.multibody.models", "lagrange_top", "satellite",
                  "double_pendulum", "double_top", "gimbal", "four_bar", "delta_robot",
                  "stewart_platform", "chain")


#: Means of the moments of inertia that the paper recommends for γ and α: name → symbol.
MEANS = {"m": "γ_m", "h": "γ_h", "mt": "γ̃_m", "ht": "γ̃_h"}
#: Searches by pilot runs that a file may ask for: name → the error that they make small.
AIMS: dict[str, Aim] = {"auto": "motion", "auto-energy": "energy"}
#: What a model says of a γ without a value.
RULES = (*MEANS, *AIMS)


def entry_named(name: Any, label: str = "problem") -> Entry:
    """Return the problem or model of a name.

    Raises InputError naming them all.
    """
    for entry in (*PROBLEMS.values(), *MODELS.values()):
        if isinstance(name, str) and name.replace("_", "-") == entry.name.replace("_", "-"):
            return entry
    raise unknown_name(label, name, [*PROBLEMS, *MODELS])


def unknown_name(label: str, name: Any, names: Sequence[str]) -> InputError:
    """Return the error for an unknown name, with the closest of names and example files.
    """
    files = {path.stem: f"examples/{path.name}" for path in (_HOME / "examples").glob("*.toml")}
    return InputError(f"Unknown {label} {shown(name)}; choose {join_or(names)}, or a model file "
                      f"ending in .toml, .urdf, .xml or .sdf{proposal(name, names, spelt=files)}.")
