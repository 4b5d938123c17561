"""Options that several commands share. Values are checked by ``Spec``, in its own words."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from ..errors import InputError
from ..exact import Rounded, decimal
from ..generator.spec import Spec

__all__ = ["check_picture", "check_writable", "real_number", "spec_from", "stepper_options",
           "whole_number"]


def stepper_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --scheme, --stages, --rep, --system, --tableau and --real."""
    options = [
        click.option("--scheme", metavar="NAME", help="IMS, EMS, G-L or LIIIA-B."),
        click.option("--stages", metavar="S", help="Stages of G-L (1..) or LIIIA-B (2..)."),
        click.option("--rep", metavar="NAME", help="Inertia: gamma (default) or alpha."),
        click.option("--system", metavar="NAME or FILE",
                     help="heavy_top (default), free_body, or a model file (TOML)."),
        click.option("--tableau", metavar="FILE", type=click.Path(path_type=Path),
                     help="A SPARK tableau as JSON, instead of --scheme and --stages."),
        click.option("--real", metavar="TYPE",
                     help="double (default), float, long-double or float128."),
    ]
    for option in reversed(options):
        function = option(function)
    return function


def spec_from(
    scheme: str | None,
    stages: str | None,
    rep: str | None,
    system: str | None,
    tableau: Path | None,
    real: str | None,
) -> Spec:
    """Return the checked spec of these options."""
    count = None if stages is None else whole_number("--stages", stages)
    return Spec.checked(scheme, count, rep, system, real, tableau)


def whole_number(name: str, text: str) -> int:
    """Return the number an option's text says, in plain decimal digits."""
    if not re.fullmatch("-?[0-9]{1,18}", text):
        raise InputError(f"{name} {text!r} is not a whole number; write digits, such as 3.")
    return int(text)


def real_number(name: str, text: str) -> float:
    """Return the number an option's text says; wide steppers get all its digits."""
    number = decimal(text)
    if number is None:
        raise InputError(f"{name} {text!r} is not a number; write for example 1e-3.")
    return number if isinstance(number, float) else Rounded(number)


def check_writable(option: str, path: Path, *, folder: bool = False) -> None:
    """Refuse a file, or a folder, that cannot be written: before a long run, not after it."""
    if not path.name or (path.is_dir() and not folder):
        raise InputError(f"{option} {str(path)!r} is no file name; give one.")
    if not path.parent.is_dir() or not os.access(path.parent, os.W_OK):
        raise InputError(f"{option} {str(path)!r}: the folder {str(path.parent)!r} is not there or "
                         "cannot be written; make it or choose another.")


def check_picture(path: Path) -> None:
    """Refuse a file of --plot that no picture can be written to."""
    from ..runtime.plots import check_target

    check_writable("--plot", path)
    check_target(path)
