"""Options of several commands. ``Spec`` checks their values."""

from __future__ import annotations

import logging
import os
import re
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar, get_args

import click

from ..core.arguments import choose, join_or, proposal
from ..core.errors import InputError
from ..core.exact_numbers import Rounded, decimal
from ..core.file_formats import ending_of, endings
from ..core.inertia import REPS
from ..core.progress import TERMINAL
from ..core.real_types import REALS
from ..core.registry import FRAMES, MODELS, SYSTEMS
from ..core.solver import Solver, SolverName
from ..generator.schemes.named_schemes import DEFAULT_SCHEME, DEFAULT_STAGES, SCHEMES
from ..generator.spec import Spec
from ..generator.tableaux.compositions import COMPOSITIONS

__all__ = ["DEFAULT", "PATH", "Grouped", "check_ending", "check_folder", "check_no_file",
           "check_picture", "check_writable", "completing", "frame_option", "is_given",
           "json_option", "method_options", "optional", "real_number", "solver_from", "spec_from",
           "stepper_options", "whole_number"]

Number = TypeVar("Number", int, float)

#: What is taken where no scheme is named, in words.
DEFAULT = f"{DEFAULT_SCHEME} with {DEFAULT_STAGES} stages"


class _PathName(click.Path):
    """A path that is not empty: the text of a shell variable that is unset is no folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path; raises click.BadParameter, as ``click.Path`` does."""
        if value == "":
            self.fail("'' is no path; give one.", param, ctx)
        return super().convert(value, param, ctx)


#: The type of options and arguments that are paths.
PATH = _PathName(path_type=Path)
#: Endings of what is written to folders.
_FILES = (".c", ".h", ".json", ".html", ".csv", *endings("picture"))


def stepper_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of ``gs.stepper`` but --frame."""
    return method_options(click.option(
        "--system", metavar="NAME or FILE", shell_complete=completing([*SYSTEMS, *MODELS]),
        help=f"{', '.join(SYSTEMS)}, one of gs.models, or a model file (.toml, .urdf, "
             f".xml, .sdf); default: "
             f"{next(iter(SYSTEMS))}.")(function))


def method_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of ``gs.stepper`` to a command with a PROBLEM, but --system and --frame."""
    options = [
        click.option("--scheme", metavar="NAME", shell_complete=completing(SCHEMES),
                     help=f"{join_or(SCHEMES)} (default: {DEFAULT})."),
        click.option("--stages", metavar="S", help="Stages of " + " or ".join(
            f"{scheme.name} ({scheme.fewest}..)" for scheme in SCHEMES.values()
            if scheme.takes_stages)
            + f" (default: {DEFAULT_STAGES})."),
        click.option("--order", metavar="N", help="Order of splitting: 2, 4, 6, 8 or 10."),
        click.option("--composition", metavar="NAME", shell_complete=completing(COMPOSITIONS),
                     help="Composition of splitting by name, instead of --order."),
        click.option("--rep", metavar="NAME", shell_complete=completing(REPS),
                     help="Inertia: gamma (default) or alpha."),
        click.option("--tableau", metavar="FILE", type=PATH,
                     help="A SPARK tableau as JSON, instead of --scheme and --stages."),
        click.option("--real", metavar="TYPE", shell_complete=completing(REALS),
                     help=f"{join_or(REALS)} (default: double)."),
        click.option("--energy", is_flag=True,
                     help="With G-L of at least 2 stages: exact energy in every step."),
    ]
    # click lists the option that is applied last first
    for option in reversed(options):
        function = option(function)
    return function


class Grouped(click.Command):
    """A command whose help lists its options under headings.

    ``groups`` are headings → names of the parameters under them; others stand at the end.
    """

    groups: ClassVar[Mapping[str, Sequence[str]]] = MappingProxyType({})

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a section for each group."""
        records = {option.name: record for option in self.get_params(ctx)
                   if isinstance(option, click.Option)
                   and (record := option.get_help_record(ctx)) is not None}
        for heading, names in self.groups.items():
            with formatter.section(heading):
                formatter.write_dl([records.pop(name) for name in names if name in records])
        with formatter.section("Others"):
            formatter.write_dl([*records.values()])


def frame_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --frame, of commands that make steppers."""
    return click.option("--frame", metavar="NAME", shell_complete=completing(FRAMES),
                        help="symmetries: with co-moving frames along the system's symmetries, a "
                             "parameter omega for each.")(function)


def json_option(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --json, which shows no progress."""

    def silence(context: click.Context, parameter: click.Parameter, value: bool) -> bool:
        """Silence messages about progress where JSON is printed."""
        if value:
            TERMINAL.setLevel(logging.CRITICAL)  # until terminal_messages ends
        return value

    return click.option("--json", "as_json", is_flag=True, callback=silence,
                        help="Print one JSON document and nothing else.")(function)


def is_given(argument: Any) -> bool:
    """Return whether an option is given: an empty text is, as of a shell variable that is unset."""
    return argument is not None and argument is not False


def spec_from(
    scheme: str | None, stages: str | None, rep: str | None, system: str | None,
    tableau: Path | None, real: str | None, frame: str | None = None, energy: bool = False,
    order: str | None = None, composition: str | None = None
) -> Spec:
    """Return the checked spec that the options of a command describe."""
    count = optional(whole_number, "--stages", stages)
    degree = optional(whole_number, "--order", order)
    spec = Spec.from_arguments(scheme, count, rep, system, real, tableau, degree, composition)
    return spec.with_frame(frame).with_energy(energy)


def completing(names: Iterable[str]) -> Callable[..., list[str]]:
    """Return the shell completion of an option's text to one of the names."""
    return lambda context, parameter, text: [name for name in names if name.startswith(text)]


def optional(read: Callable[[str, str], Number], name: str, text: str | None) -> Number | None:
    """Return the number that ``read(name, text)`` returns; None of an option that is left out."""
    return None if text is None else read(name, text)


def whole_number(name: str, text: str) -> int:
    """Return the whole number in an option's text: 1000, 1e3, 1000.0; InputError names the option.
    """
    # up to 18 digits: numbers below 10^18 < 2^63 fit the counters of the C, int64_t
    if re.fullmatch(r"-?[0-9]{1,18}", text):
        return int(text)
    if re.fullmatch(r"-?[0-9]{1,18}(\.[0-9]{0,18})?([eE]\+?[0-9]{1,2})?", text):
        number = Decimal(text)  # exact: a double would round 2^53 + 1
        if number == number.to_integral_value() and abs(number) < 10**18:
            return int(number)
    raise InputError(f"{name} {text!r} is not a whole number; write digits, such as 3, or 1e3.")


def real_number(name: str, text: str) -> float:
    """Return the number in an option's text, with all its digits for wide steppers.

    Raises InputError with the option's name.
    """
    number = decimal(text)
    if number is None:
        raise InputError(f"{name} {text!r} is not a number; write for example 1e-3.")
    return number if isinstance(number, float) else Rounded(number)


def solver_from(text: str) -> Solver:
    """Return the solver that an option's text says: ``newton,tolerance=1e-12,max_iterations=20``.
    """
    kind, *parts = (entry.strip() for entry in text.split(","))
    readers = {"tolerance": real_number, "max_iterations": whole_number}
    settings: dict[str, Any] = {}
    for entry in parts:
        name, sign, number_text = (x.strip() for x in entry.partition("="))
        if not sign or name in settings or name not in readers:
            raise InputError(f"--solver {text!r} has {entry!r}; write NAME,KEY=VALUE with KEY once "
                             f"among {join_or(readers)}{proposal(name, readers)}.")
        settings[name] = readers[name](f"--solver {name}", number_text)
    return Solver(choose("solver", kind, get_args(SolverName)), **settings)


def check_writable(option: str, path: Path, *, folder: bool = False) -> None:
    """Refuse a file, or a folder, that cannot be written: before a long run, not after it."""
    if not path.name or (path.is_dir() and not folder):
        raise InputError(f"{option} {str(path)!r} is no file name; give one.")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass  # permissions alone do not decide: no file can be made in /proc
    except OSError as error:
        raise InputError(f"{option} {str(path)!r}: no file can be made in the folder "
                         f"{str(path.parent)!r} ({error.strerror}); make it or choose another."
                         ) from error


def check_folder(option: str, folder: Path) -> None:
    """Refuse a folder to write to that cannot be made or written, before long work."""
    check_no_file(option, folder)
    existing = next(path for path in (folder, *folder.absolute().parents) if os.path.lexists(path))
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise InputError(f"{option} {str(folder)!r}: {str(existing)!r} is no folder that can be "
                         "written; choose another.")


def check_no_file(option: str, folder: Path) -> None:
    """Refuse a name that says that it is a file, where a folder of files is written."""
    if ending_of(folder) in _FILES and not folder.is_dir():
        raise InputError(f"{option} {str(folder)!r} names a file, and several are written; give a "
                         "folder.")


def check_ending(option: str, path: Path, allowed: Sequence[str]) -> None:
    """Refuse a name with an ending of no format that can be written."""
    if ending_of(path) not in allowed:
        raise InputError(f"{option} {path.name!r} is no file that can be written; end its name in "
                         f"{', '.join(allowed)}.")


def check_film(path: Path) -> None:
    """Refuse a file of --show that no film can be written to."""
    from ..runtime.plotting.animation import check_film

    check_film(path)


def check_picture(path: Path) -> None:
    """Refuse a file of --plot that no picture can be written to."""
    from ..runtime.plotting.trajectory_plots import check_picture_path

    check_writable("--plot", path)
    check_picture_path(path)
