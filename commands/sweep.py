"""``gyrospark sweep``: integrate a model for every combination of what varies."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.arguments import count_text
from ..core.errors import GyrosparkError, InputError, Stopped
from ..core.interrupts import catch_signals
from ..core.strict_json import json_text
from . import exit_code_of
from .options import (
    PATH,
    check_ending,
    check_picture,
    check_writable,
    is_given,
    json_option,
    whole_number,
)

if TYPE_CHECKING:
    from ..sweeps.cost_estimate import Estimate
    from ..sweeps.study import Study

__all__ = ["sweep"]


@click.command(no_args_is_help=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("study", metavar="STUDY.toml", type=PATH)
@click.option("--out", type=PATH, metavar="STORE",
              help="The Zarr store (default: STUDY.zarr in this folder).")
@click.option("--resume", is_flag=True,
              help="Go on with the sweep in the store; begin it if there is none.")
@click.option("--workers", metavar="N", help="Threads (default: all cores).")
@click.option("--dask", metavar="ADDRESS",
              help="A Dask cluster in their place: its scheduler's tcp://HOST:PORT.")
@click.option("--dry-run", is_flag=True,
              help="Say what it will cost, from a few cells, and compute nothing else.")
@click.option("--plot", type=PATH, metavar="FILE",
              help="Draw a result over the axes (.png, .svg, .pdf).")
@click.option("--show", metavar="RESULT", default="energy_error_max", show_default=True,
              help="The result to draw and to summarise.")
@json_option
def sweep(
    study: Path, out: Path | None, resume: bool, workers: str | None, dask: str | None,
    dry_run: bool, plot: Path | None, show: str, as_json: bool,
) -> int:
    """Integrate a model for every cell of a grid; the axes are in STUDY.toml.

    \b
    gyrospark sweep examples/studies/gamma_dt.toml --dry-run
    gyrospark sweep examples/studies/gamma_dt.toml --plot gamma_dt.png
    gyrospark sweep examples/studies/gamma_dt.toml --out big.zarr --resume
    gyrospark sweep examples/studies/gamma_dt.toml --dask tcp://192.168.0.7:8786 --out /share/b.zarr
    """
    from ..sweeps.results import fields_of, is_complete
    from ..sweeps.run_sweep import run_study
    from ..sweeps.study_file import load_study

    store = out if out is not None else Path(f"{study.stem}.zarr")
    _check_targets(store, plot)
    for option, value in (("--plot", plot), ("--resume", resume), ("--dask", dask)):
        if dry_run and is_given(value):
            raise InputError(f"{option} belongs to cells that are computed, and --dry-run leaves "
                             "them out; leave one out.")
    loaded = load_study(study)
    fields = fields_of(loaded.study, loaded.keep)
    names = [f.name for f in fields if not f.inner]  # a picture shows one number of each cell
    if show not in names:
        raise InputError(f"--show {show!r} is no result of this sweep; choose {', '.join(names)}.")
    threads = _thread_count(workers)
    if dry_run:
        from ..storage.staging import is_new
        from ..sweeps.cost_estimate import estimate

        is_new(store, resume, "sweep")  # an existing store is refused, as by the sweep itself
        _print_estimate(estimate(loaded.study, fields), loaded.study, threads, as_json=as_json)
        return 0
    started = time.perf_counter()
    failure: GyrosparkError | None = None
    with catch_signals() as interrupts:  # to the end: a sweep that is complete is reported
        trouble = _run_to_end(partial(run_study, loaded.study, keep=loaded.keep, out=store,
                                      resume=resume, dask=dask,
                                      workers=None if workers is None else threads))
        if trouble is None or is_complete(loaded.study, store):
            result = _result(loaded.study, store, show, time.perf_counter() - started)
            if plot is not None:
                failure = _draw(store, show, plot, result)
            click.echo(json_text(result) if as_json else _text(result))
    return exit_code_of(trouble or failure, interrupts, "sweep")


def _run_to_end(run: Callable[[], object]) -> Stopped | None:
    """Run a sweep; return the error of one that a signal stops. A second signal ends the process.
    """
    try:
        run()
    except Stopped as error:
        return error
    except KeyboardInterrupt:  # the second one: Python would wait for the tiles in work
        click.echo("gyrospark: Interrupted; every finished cell is stored.", err=True)
        sys.stderr.flush()
        os._exit(130)  # without joining the threads that compute tiles
    return None


def _check_targets(store: Path, plot: Path | None) -> None:
    """Refuse a store and a picture that cannot be written."""
    check_writable("--out", store, folder=True)
    check_ending("--out", store, ("", ".zarr"))
    if plot is not None:
        check_picture(plot)


def _thread_count(workers: str | None) -> int:
    """Return the number of threads that --workers asks for; without it, one for each core."""
    if workers is None:
        return os.cpu_count() or 1
    threads = whole_number("--workers", workers)
    if threads < 1:
        raise InputError(f"--workers {workers!r} are no threads; give 1 or more.")
    return threads


def _result(study: Study, store: Path, show: str, seconds: float) -> dict[str, Any]:
    """Return the report as JSON has it: axes, counts of statuses, and the extremes of ``show``."""
    from ..sweeps.results import count_statuses, meanings, summary

    meaning_of, counts = meanings(), count_statuses(study, store)
    return {
        "sweep": study.name,
        "steppers": [s.name for s in study.steppers],
        "axes": {axis.name: len(axis) for axis in study.axes},
        "cells": study.size,
        "seconds": seconds,
        "statuses": {meaning_of[code]: count for code, count in sorted(counts.items())},
        "shown": show,
        **summary(study, store, show),
        "out": str(store),
    }


def _draw(store: Path, show: str, plot: Path, result: dict[str, Any]) -> GyrosparkError | None:
    """Draw one result of a sweep; return the error if that fails, so that the numbers are printed.
    """
    from ..sweeps.results import load_sweep
    from ..sweeps.sweep_plots import draw

    try:
        draw(load_sweep(store), show, plot)
        result["plot"] = str(plot)
    except GyrosparkError as error:  # the numbers are still printed
        return error
    return None


def _text(result: dict[str, Any]) -> str:
    """Return the report for people: cells, time, statuses, and the extremes of one result."""
    axes = " × ".join(f"{length:,} {name}" for name, length in result["axes"].items())
    lines = [f"{result['sweep']} with {', '.join(result['steppers'])}",
             f"  {count_text(result['cells'], 'cell')} ({axes}) in {result['seconds']:.1f} s"]
    lines += [f"  {name:<23} {count:,}" for name, count in result["statuses"].items()]
    if result["least"] is not None:
        location = ", ".join(f"{name} = {axis_value:.6g}" if isinstance(axis_value, float)
                             else f"{name} = {axis_value}"
                             for name, axis_value in result["least_at"].items())
        lines += [f"  {result['shown']:<23} from {result['least']:.3e} to {result['most']:.3e}",
                  f"  least at                {location}"]
    lines += [f"  wrote {result[key]}" for key in ("out", "plot") if key in result]
    return "\n".join(lines)


def _print_estimate(estimate: Estimate, study: Study, workers: int, *, as_json: bool) -> None:
    """Print the time and the bytes that a sweep would take with ``workers`` workers."""
    from dataclasses import asdict

    wall = estimate.cpu_seconds / workers
    if as_json:
        totals = {"workers": workers, "wall_seconds": wall}
        click.echo(json_text(asdict(estimate) | totals))
        return
    # cells are independent, so that workers share them evenly
    spread = f"({_duration(estimate.low / workers)} to {_duration(estimate.high / workers)})"
    place = f"on {count_text(workers, 'core')} here"
    click.echo("\n".join([
        f"{study.name} with {', '.join(s.name for s in study.steppers)}",
        f"  {count_text(estimate.cells, 'cell')}, {count_text(estimate.steps, 'step')} in "
        f"{count_text(estimate.tiles, 'tile')}",
        f"  {place:<24}{_duration(wall)} {spread}; one core "
        f"{_duration(estimate.cpu_seconds)}",
        f"  on the disk             {_bytes(estimate.disk_bytes)} in "
        f"{count_text(estimate.files, 'file')}",
        f"  in a worker's memory    {_bytes(estimate.memory_bytes)}",
    ]))


def _duration(seconds: float) -> str:
    """Return seconds as text in a unit that suits them."""
    for unit, size in (("days", 86400), ("h", 3600), ("min", 60)):
        if seconds >= 2 * size:  # 90 s says more than 1.5 min
            return f"{seconds / size:.1f} {unit}"
    return f"{seconds:.1f} s"


def _bytes(count: float) -> str:
    """Return a number of bytes as text in a unit that suits it."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"
