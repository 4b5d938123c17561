"""``gyrospark reference``: problems of the field with true digits, and our error against cost."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..core.arguments import choose
from ..core.errors import InputError
from .generate import write_files
from .options import PATH, check_ending, check_picture, check_writable, json_option

if TYPE_CHECKING:
    from ..references.problem import Reference
    from ..references.work_precision import WorkPrecisionRun

__all__ = ["reference"]


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("name", metavar="list|NAME|all", default="list")
@click.option("--quick", is_flag=True, help="The first scheme of each problem alone, timed once.")
@click.option("--plot", metavar="FILE.png", type=PATH,
              help="Draw error against CPU time, a panel for each problem.")
@click.option("--out", metavar="FILE.md", type=PATH,
              help="Write a page with digits and runs, as docs/references.md is.")
@json_option
def reference(name: str, quick: bool, plot: Path | None, out: Path | None, as_json: bool) -> int:
    """Run problems of the field with known digits: error against CPU seconds for our schemes.

    Exits with 1 unless one of the schemes has the digits of each problem to 1e-12.

    \b
    gyrospark reference list
    gyrospark reference spherical-pendulum
    gyrospark reference all --json
    gyrospark reference all --out references.md --plot references.png
    """
    from ..references.problem_registry import names
    from ..references.problem_registry import reference as named
    from ..references.results_page import reached
    from ..references.work_precision import measure

    if name == "list":
        for option, value in (("--quick", quick), ("--plot", plot), ("--out", out)):
            if value:
                raise InputError(f"{option} belongs to runs of problems; name one, or all.")
        _list([named(problem) for problem in names()], as_json)
        return 0
    if out is not None:
        check_writable("--out", out)
        check_ending("--out", out, (".md",))
    if plot is not None:
        check_picture(plot)
    chosen = choose("reference problem", name, [*names(), "all"])
    problems = [named(problem) for problem in (names() if chosen == "all" else [chosen])]
    rounds = 1 if quick else 3  # the median of three leaves out a round that was interrupted
    measured = [(problem, list(measure(problem, rounds=rounds, quick=quick)))
                for problem in problems]
    _write(measured, plot, out, as_json=as_json)
    missed = [problem.name for problem, runs in measured if not reached(runs)]
    if missed:
        click.echo(f"reference: no scheme has the digits of {', '.join(missed)}.", err=True)
    return 1 if missed else 0


def _write(
    measured: list[tuple[Reference, list[WorkPrecisionRun]]], plot: Path | None,
    out: Path | None, *, as_json: bool,
) -> None:
    """Print the runs of problems, draw them and write their page."""
    import json

    from ..references.results_page import page

    if as_json:
        rows = [run.as_dict() for _, runs in measured for run in runs]
        click.echo(json.dumps(rows, ensure_ascii=False, indent=2))
    else:
        for problem, runs in measured:
            _print(problem, runs)
    if plot is not None:
        from ..references.picture import draw_references

        draw_references([(problem.name, runs) for problem, runs in measured], plot)
    if out is not None:
        # the page refers to the picture beside it
        picture = "" if plot is None else Path(os.path.relpath(plot, out.parent)).as_posix()
        write_files({out.name: page(measured, picture)}, out.parent)


def _list(problems: Sequence[Reference], as_json: bool) -> None:
    """Print names, titles and sources of the problems, or all that is known of them as JSON."""
    import json

    if as_json:
        rows = [{"name": problem.name, "title": problem.title, "source": problem.source,
                 "seconds": float(problem.seconds), "truth": dict(problem.truth.values),
                 "made": problem.truth.made, "published": problem.published and {
                     "source": problem.published.source, "values": dict(problem.published.values),
                     "off_by": dict(problem.deviations)}}
                for problem in problems]
        click.echo(json.dumps(rows, ensure_ascii=False, indent=2))
        return
    width = max(len(problem.name) for problem in problems)
    for problem in problems:
        click.echo(f"{problem.name:<{width}}  {problem.title} ({problem.source})")


def _print(problem: Reference, runs: Sequence[WorkPrecisionRun]) -> None:
    """Print where the digits come from, and error, cost and invariants of each run."""
    click.echo(f"{problem.title}, t = {problem.seconds} s; digits: {problem.truth.made}")
    if problem.published is not None:
        label, off = max(problem.deviations.items(), key=lambda deviation: deviation[1])
        click.echo(f"  published ({problem.published.source}): off by up to {off:.0e}, in {label}")
    for run in runs:
        invariants = ", ".join(f"{name} {error:.0e}" for name, error in run.invariants.items())
        click.echo(f"  {run.label:<10} {run.steps:>6} steps  error {run.error:.1e}  "
                   f"{run.cpu_seconds * 1e3:9.2f} ms  {invariants}")
