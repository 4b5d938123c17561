"""``gyrospark fit``: parameters and the start of a motion from measured data."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from ..core.arguments import few, join_or
from ..core.errors import InputError
from ..core.registry import MODELS, PROBLEMS
from ..core.strict_json import json_text
from .options import (
    PATH,
    completing,
    json_option,
    method_options,
    optional,
    real_number,
)
from .run.starts import start_of, stepper_and_start

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..runtime.analysis.fit import Fit

__all__ = ["fit"]


@click.command(no_args_is_help=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("problem", metavar="PROBLEM", shell_complete=completing([*PROBLEMS, *MODELS]))
@click.argument("data", metavar="DATA.csv", type=PATH)
@method_options
@click.option("--observe", metavar="NAME,...", default="attitude", show_default=True,
              help="What is measured: attitude (of all bodies), 'upper attitude' (of one), "
                   "angular_velocity, q, p, or names of coordinates and momenta.")
@click.option("--free", metavar="NAME,...",
              help="What is fitted: parameters, and start (default: all, without γ and α).")
@click.option("--fixed", metavar="NAME,...", help="What is not fitted.")
@click.option("--dt", metavar="DT",
              help="Time step in seconds; it divides the times of all samples (default: the "
                   "smallest distance of two).")
@click.option("--dtau", metavar="DTAU",
              help="In place of --dt, of a system with time_scale: step of the scaled time; "
                   "samples may lie at any times.")
@click.option("--sigma", metavar="SIGMA",
              help="One standard deviation of the noise, of attitudes in rad (default: that of the "
                   "residuals).")
@click.option("--set", "settings", metavar="KEY=VALUE", multiple=True,
              help="As of gyrospark run: the time of the start, t=0.5, first guesses of the "
                   "parameters of a model file, and keys such as "
                   "start.angular_velocity='[0, 0, 40]'.")
@json_option
def fit(
    problem: str, data: Path, observe: str, free: str | None, fixed: str | None, dt: str | None,
    dtau: str | None, sigma: str | None, settings: tuple[str, ...], as_json: bool, **choice: Any,
) -> int:
    """Fit parameters and the start of PROBLEM to measured data: one of the paper's problems,
    (PROBLEMS); one of gs.models, (MODELS); or a model file (.toml, .urdf, .xml, .sdf), whose
    values are the first guess.

    The first line of DATA.csv names its columns: time, and those of what is measured, as
    the CSV file of a run has them; of an attitude the four coordinates of its quaternion,
    scalar first; of an angular velocity NAME_omega1 to NAME_omega3, rad/s in body axes.
    Other columns are ignored. Combinations of parameters that the data do not determine are
    named. Exit code 1 if the fit has not converged.

    \b
    gyrospark run examples/damped_top.toml --dt 5e-3 --steps 240 --every 4 --out seen.csv
    gyrospark fit examples/damped_top.toml seen.csv --dt 5e-3 --set c=1e-4 --free c,start
    gyrospark fit examples/damped_top.toml seen.csv --dt 5e-3 --fixed mgl --sigma 2e-3 --json
    gyrospark fit examples/pendulum.toml swing.csv --observe x,y --free l,g,start
    """
    from ..runtime.analysis.fit import fit as fit_model
    from ..runtime.analysis.observations import observation_of

    _, step, start, t0 = stepper_and_start(problem, settings, choice, scaled=True)
    # DATA.csv has a column for each number that is observed
    observed_names = _names(observe)
    names = observation_of(step, observed_names).names
    for name in names:
        if names.count(name) > 1:  # the same samples twice would make the deviations too small
            raise InputError(f"--observe {observe!r} has the column {name!r} {names.count(name)} "
                             "times; name it once.")
    times, rows = _read_columns(data, names)
    state = start_of(step, start, t0)
    outcome = fit_model(
        step, state, times, rows, observe=observed_names,
        dt=optional(real_number, "--dt", dt),
        dtau=optional(real_number, "--dtau", dtau),
        free=None if free is None else _names(free), fixed=_names(fixed or ""),
        sigma=optional(real_number, "--sigma", sigma))
    click.echo(json_text(_result(outcome))
               if as_json else repr(outcome)[1:-1])  # without < and >
    return 0 if outcome.converged else 1


fit.help = (fit.help or "").replace("(PROBLEMS)", join_or(PROBLEMS)).replace(
    "(MODELS)", join_or(MODELS))


def _names(text: str) -> list[str]:
    """Return the names in a text with commas."""
    return [name.strip() for name in text.split(",") if name.strip()]


def _read_columns(path: Path, names: list[str]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the times (samples,) and the named columns (samples, columns) of a CSV file.

    Raises InputError for a file without these columns, and for entries that are no numbers.
    """
    headings = ["time", *names]
    lines = _csv_lines(path, headings)
    header = [name.strip() for name in lines[0][1]]
    columns = _column_indices(path, header, headings)
    samples = np.empty((len(lines) - 1, len(columns)))
    for i, (number, line) in enumerate(lines[1:]):
        for j, column in enumerate(columns):
            # a line that ends early has empty cells, which are refused as such
            text = line[column].strip() if column < len(line) else ""
            samples[i, j] = _number(text)
            if not math.isfinite(samples[i, j]):
                raise InputError(f"{str(path)!r}, line {number}: {header[column]} is {text!r}, no "
                                 "finite number; leave out lines with missing samples.")
    return samples[:, 0], samples[:, 1:]


def _csv_lines(path: Path, headings: list[str]) -> list[tuple[int, list[str]]]:
    """Return the cells of each line that is not empty, with its number: the header and samples.

    ``headings`` are the columns that the refusal of a file without samples names.
    """
    try:
        # spreadsheets write a byte order mark
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            lines = [(reader.line_num, line) for line in reader if line]
    except (OSError, UnicodeError, csv.Error) as error:
        raise InputError(f"{str(path)!r} cannot be read as a table: "
                         f"{getattr(error, 'strerror', None) or error}.") from None
    if len(lines) < 2:
        raise InputError(f"{str(path)!r} has no samples; give a line of names, "
                         f"{','.join(headings)}, and a line for each sample.")
    return lines


def _column_indices(path: Path, header: list[str], headings: list[str]) -> list[int]:
    """Return the index of each heading in the header of a file; refuse missing and repeated ones.
    """
    for name in headings:
        if header.count(name) > 1:
            raise InputError(f"{str(path)!r} has {header.count(name)} columns {name!r}; rename all "
                             "but the one that is meant.")
        if name not in header:
            raise InputError(f"{str(path)!r} has no column {name!r}, but {few(header)}; name its "
                             f"columns {','.join(headings)}, or choose others with --observe.")
    return [header.index(name) for name in headings]


def _number(text: str) -> float:
    """Return a cell of the table as a number, NaN if it is none."""
    try:
        return math.nan if "_" in text else float(text)  # Python alone reads 1_000 as a number
    except ValueError:
        return math.nan


def _result(outcome: Fit) -> dict[str, Any]:
    """Return the numbers of the report; a standard deviation that the data leave open is infinite.
    """
    return {
        "converged": outcome.converged, "samples": len(outcome.residuals), "rms": outcome.rms,
        "truncation": outcome.truncation, "iterations": outcome.iterations,
        "horizons": outcome.horizons, "parameters": outcome.parameters,
        "sigma": outcome.sigma,
        "undetermined": outcome.undetermined, "q": outcome.q.tolist(), "p": outcome.p.tolist(),
    }
