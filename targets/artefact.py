"""The input of a target, its result, and how files are written."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._version import __version__
from ..core.arguments import few
from ..core.calls import explain_arguments
from ..core.errors import GyrosparkError, InputError
from ..core.html import card, table
from ..core.manifest import Manifest

if TYPE_CHECKING:
    import jinja2

    from . import Target

__all__ = ["EXAMPLE_STEPS", "MARKER", "Built", "Options", "Written", "check_out", "fill_template",
           "literal", "parameter_fields", "place", "refuse_names", "staging", "template_values"]

#: The marker file of an artefact: only folders that have it are written over.
MARKER = "gyrospark.json"

#: Steps of the examples that artefacts have, and of checks.
EXAMPLE_STEPS = 2000

_TEXTS = Path(__file__).with_name("texts")


@dataclass(frozen=True)
class Written:
    """A stepper as text.

    Attributes
    ----------
    manifest : mapping
        The stepper's manifest.
    sources : mapping of str to str
        ``NAME.h``, ``NAME.c`` (which compiles alone) and ``NAME.json``.
    """

    manifest: Manifest
    sources: Mapping[str, str]

    @property
    def name(self) -> str:
        """The prefix of the C."""
        return str(self.manifest.name)


@dataclass(frozen=True)
class Options:
    """The numbers of a start, and the choices for a target.

    Attributes
    ----------
    dt : float
        Time step in s.
    q, p : tuple of float
        The state at the start, on the constraints.
    parameters : mapping of str to float
        Every member of the parameters' struct in C, in its order.
    description : str
        One sentence about the model.
    max_iterations : int
        Of a step.
    steppers : tuple of Written
        All that go into the artefact, where it takes several schemes; the first is the one that
        ``files`` gets.
    rates : tuple of float
        q' = H_p at the start, for targets that have velocities.
    """

    dt: float
    q: tuple[float, ...]
    p: tuple[float, ...]
    parameters: Mapping[str, float]
    description: str = ""
    max_iterations: int = 50
    steppers: tuple[Written, ...] = ()
    rates: tuple[float, ...] = ()


@explain_arguments
@dataclass(frozen=True, eq=False)
class Built:
    """A written artefact.

    Attributes
    ----------
    target : Target
        Description in one line.
    path : Path
        The file or folder.
    files : tuple of str
        Names of the files in the folder; of a file its own.
    platforms : tuple of str
        The platforms of its binaries.
    stepper : Written
        The C in it, with its manifest.
    options : Options
        Its start and choices.
    """

    target: Target
    path: Path
    files: tuple[str, ...]
    platforms: tuple[str, ...]
    stepper: Written
    options: Options

    def __repr__(self) -> str:
        return f"<Built {self.target.name} of {self.stepper.name}: {str(self.path)!r}>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: path, files and start."""
        return card(f"Built {self.target.name} of {self.stepper.name}", table([
            ("path", self.path), ("files", few(self.files)), ("platforms", few(self.platforms)),
            ("step", f"{self.options.dt:g} s"), ("parameters", few(
                f"{name} = {x:g}" for name, x in self.options.parameters.items()))]))

    def check(self) -> str:
        """Load the artefact again and compare its bits with the same C compiled here.

        Returns
        -------
        str
            A sentence on the compared bits.

        Raises
        ------
        InputError
            Where a tool that loads it is missing, with the cure.
        GyrosparkError
            Where it does not load, or a bit differs.
        """
        return self.target.load().check(self)


def parameter_fields(manifest: Manifest) -> list[str]:
    """Return the names of the members of the parameters' struct, all real numbers."""
    system = manifest.system
    time = [system.time] if system.time else []
    return [*system.parameters, *time] or ["none"]


@cache
def _environment() -> jinja2.Environment:
    """Return Jinja's environment for texts of targets, where a misspelt name is an error."""
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEXTS), undefined=jinja2.StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True, autoescape=False)


def fill_template(template: str, **values: Any) -> str:
    """Return a template of ``texts/`` with values in it; a file without placeholders unchanged."""
    if not values:
        return _TEXTS.joinpath(template).read_text(encoding="utf-8")
    return _environment().get_template(f"{template}.jinja").render(values)


def template_values(
    manifest: Manifest, sources: Mapping[str, str], options: Options
) -> dict[str, Any]:
    """Return the values for the templates of several targets, by the name that a template uses.

    "parameters" are pairs of name and value, "units" has ", UNIT" or "" for each parameter. Numbers
    are texts of the stepper's own type, each as exact as the type holds it.
    """
    system, name = manifest.system, manifest.name
    header = sources[f"{name}.h"]
    q, p, parameter_texts = ([literal(x, manifest.real) for x in numbers]
                             for numbers in (options.q, options.p, options.parameters.values()))
    units = {number.name: number.unit for number in system.numbers if number.unit}
    return {
        "name": name, "NAME": name.upper(), "version": __version__,
        "about": f"{manifest.scheme.method} for {system.name.replace('_', ' ')}",
        "description": " ".join(options.description.split()) or "A mechanical system.",
        "n": len(options.q), "real": manifest.real,
        "suffix": "f" if manifest.real == "float" else "",  # of literals in C
        "dt": literal(options.dt, manifest.real),
        "q": q, "p": p, "parameters": [*zip(options.parameters, parameter_texts, strict=True)],
        "units": {name: f", {units[name]}" if name in units else "" for name in options.parameters},
        "inputs": system.inputs,
        "velocities": [number.name for number in system.numbers if number.role == "velocity"],
        "quantities": [*system.quantities],
        "quantities_take_time": system.quantities_take_time,
        "max_iterations": options.max_iterations, "steps": EXAMPLE_STEPS,
        "work_size": work_size(name, header)}


def literal(x: float, real: str) -> str:
    """Return a number as text that every language reads as the stepper's own number."""
    if real != "float":
        return repr(x)
    rounded = np.float32(x)
    short = str(rounded)
    # C may read the text as a double and round that: the short text of a float is safe only if
    # this gives the same float
    return short if np.float32(float(short)) == rounded else repr(float(rounded))


def work_size(name: str, header: str) -> int:
    """Return the bytes of a trajectory's memory, from the declaration of its struct in the header.

    int64_t and double are aligned to 8 there, as on all platforms of targets.
    """
    import cffi

    # cffi reads declarations alone, without directives of the preprocessor
    declared = "\n".join(line for line in header.splitlines() if not line.startswith("#")
                         and line != 'extern "C" {' and line != "}")
    types = cffi.FFI()
    types.cdef(declared)
    size: int = types.sizeof(f"struct {name}_work")
    return size


def refuse_names(manifest: Manifest, reserved: Collection[str], language: str) -> None:
    """Refuse members of the parameters' struct that are reserved words of a language."""
    for field_ in parameter_fields(manifest):
        if field_ in reserved:
            raise InputError(f"{language} keeps the name {field_!r} for itself, which is a "
                             f"parameter of {manifest.system.name}; call it otherwise, such "
                             f"as {field_ + '_'!r}.")


# ---------------------------------------------------------------- writing


def check_out(out: Path, suffix: str) -> None:
    """Refuse an output path that exists and is no unchanged artefact, before anything is derived.

    ``suffix`` is the ending of the artefact's file, "" where it is a folder. Raises InputError for
    another ending, for files that gyrospark did not write, or that were changed since.
    """
    if suffix and out.suffix != suffix:  # programs know such files by their ending
        raise InputError(f"--out {str(out)!r} does not end in {suffix}, as this artefact does; "
                         f"write {str(out.with_suffix(suffix))!r}.")
    if not out.parent.is_dir() or not os.access(out.parent, os.W_OK):
        raise InputError(f"--out {str(out)!r}: the folder {str(out.parent)!r} is not there or "
                         "cannot be written; make it or choose another.")
    if not os.path.lexists(out) or (out.is_dir() and not any(out.iterdir())):
        return
    cure = "remove it, or choose another --out"
    # only what carries the marker of this package, and is unchanged, may be written over
    if out.is_file():
        if MARKER.encode() not in out.read_bytes():
            raise InputError(f"--out {str(out)!r} is a file that gyrospark did not write; {cure}.")
        return
    try:
        digests = json.loads((out / MARKER).read_text(encoding="utf-8"))["files"]
        # files that were removed since are no loss
        changed_files = [name for name, digest in digests.items()
                         if (out / name).is_file() and _digest(out / name) != digest]
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise InputError(f"--out {str(out)!r} is there and no artefact of gyrospark; "
                         f"{cure}.") from None
    if changed_files:
        raise InputError(f"--out {str(out)!r} holds {changed_files[0]!r}, which was changed since "
                         f"it was written; move it away, or choose another --out.")


def _digest(path: Path) -> str:
    """Return the SHA-256 of a file, by which a marker knows whether the file was changed."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


@contextlib.contextmanager
def staging(out: Path, files: Mapping[str, str | bytes]) -> Iterator[Path]:
    """Yield a temporary folder beside ``out`` with the files in it, which is removed afterwards."""
    try:
        # on the file system of ``out``, so that the artefact is moved there by a rename
        folder = Path(tempfile.mkdtemp(prefix=f".{out.name}.", suffix=".part", dir=out.parent))
        try:
            for name, content in files.items():
                path = folder / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content.encode() if isinstance(content, str) else content)
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    except OSError as error:
        raise GyrosparkError(f"--out {str(out)!r} cannot be written: "
                             f"{error.strerror or error}.") from error


def place(artefact: Path, out: Path, facts: Mapping[str, Any]) -> tuple[str, ...]:
    """Move an artefact to ``out``, complete or not at all; return the names of its files.

    A folder gets a marker, with ``facts`` about the artefact. An existing artefact is written over
    file by file, so that other files in its folder stay.
    """
    if artefact.is_file():
        artefact.replace(out)
        return (out.name,)
    names = sorted(path.relative_to(artefact).as_posix() for path in artefact.rglob("*")
                   if path.is_file())
    marker = {**facts, "generator": __version__,
              "files": {name: _digest(artefact / name) for name in names}}
    (artefact / MARKER).write_text(json.dumps(marker, indent=2) + "\n", encoding="utf-8")
    artefact.chmod(0o755)  # mkdtemp's is for its owner alone
    if not out.is_dir() or not any(out.iterdir()):
        artefact.replace(out)
        return (*names, MARKER)
    # each file is replaced at once: a reader never finds it missing
    old_files: Sequence[str] = [*json.loads((out / MARKER).read_text(encoding="utf-8"))["files"]]
    for name in (*names, MARKER):
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (artefact / name).replace(out / name)
    for name in set(old_files) - {*names}:
        (out / name).unlink(missing_ok=True)
    return (*names, MARKER)
