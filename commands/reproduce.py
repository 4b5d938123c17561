"""``gyrospark reproduce``: a table or figure of the paper, ours beside the printed one."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.errors import InputError, MissingDependencyError
from ..core.progress import hide_tasks
from .generate import write_files
from .options import PATH, check_folder, check_writable, json_option

if TYPE_CHECKING:
    from ..studies.study_result import Claim, Result, Table

__all__ = ["reproduce"]

#: Verdict → its colour on the terminal.
_COLOURS = {"agrees": "green", "round-off": "blue", "misprint": "yellow", "differs": "red",
            "not printed": "default"}


@click.command(no_args_is_help=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("name")
@click.option("--out", type=PATH, metavar="DIR",
              help="Write DIR/paper.md with JSON, CSV and SVG beside it (for all: report).")
@json_option
@click.option("--summary", type=PATH, metavar="FILE",
              help="Write what was found as Markdown; docs/paper.md is made like this.")
def reproduce(name: str, out: Path | None, as_json: bool, summary: Path | None) -> int:
    """Compute NAME again: table-2 to table-14, figure-5 to figure-16, a finding, or all.

    Exit code 1 if a claim does not hold, or a number differs, and no reason is known.

    \b
    gyrospark reproduce table-4
    gyrospark reproduce figure-13 --out figure
    gyrospark reproduce all --out report
    gyrospark reproduce all --out report --summary docs/paper.md
    """
    from ..studies.case_runner import Engine
    from ..studies.study_registry import chosen, compute

    names = chosen(name)
    out, remark = _report_folder(name, out, as_json=as_json)
    if summary is not None:
        check_writable("--summary", summary)
        if out is not None and summary.resolve() in {
                (out / file).resolve() for file in _file_names(names)}:
            raise InputError(f"--summary {str(summary)!r} is a file that --out {str(out)!r} "
                             "writes; give another name.")
    # files and folders are checked above: computing all results takes minutes
    with _progress(len(names), quiet=as_json) as (advance, watch):
        results = compute(names, Engine(watch=watch), advance)
    if out is not None:
        from ..studies.report import report_files

        write_files(report_files(results), out)
    if summary is not None:
        from ..studies.report import page

        write_files({summary.name: page(results)}, summary.parent)
    if as_json:
        _print_json(name, results)
    else:
        _print(name, results, out, summary)
        if remark:
            click.echo(remark)
    return 0 if _sound(results) else 1


def _file_names(names: Sequence[str]) -> list[str]:
    """Return the names of the files that a report of these results may have."""
    return ["paper.md", "results.json",
            *(f"{name}.{'csv' if name.startswith('table-') else 'svg'}" for name in names)]


def _report_folder(name: str, out: Path | None, *, as_json: bool) -> tuple[Path | None, str]:
    """Return the folder of the report, or None, and a line on why there is no report, or "".

    Raises, before hours of computing, InputError for a folder that cannot be written, and
    MissingDependencyError for a report with figures without matplotlib.
    """
    from ..runtime.plotting.trajectory_plots import figure_class

    if out is not None:
        check_folder("--out", out)
        if not name.startswith("table-"):  # a table alone has no figures
            figure_class()  # raises the error now
        return out, ""
    if name != "all" or as_json:
        return None, ""
    try:
        figure_class()
    except MissingDependencyError as error:  # the numbers need no picture
        return None, f"no report: {error}"
    check_folder("--out", Path("report"))
    return Path("report"), ""


def _sound(results: Sequence[Result]) -> bool:
    """Return whether all claims hold and all differences have a reason, but for known exceptions.
    """
    from ..studies.summary import tables_of, unexpected, unexplained

    return not unexpected(results) and not any(unexplained(table) for table in tables_of(results))


@contextmanager
def _progress(
    result_count: int, *, quiet: bool
) -> Iterator[tuple[Callable[[str, int], None] | None, Callable[[str], None] | None]]:
    """Yield callbacks of progress: a bar on a terminal, elsewhere one line for each result.

    The first takes the name of a result and the number of results done, the second a text on what
    is being computed; None where nothing is shown.
    """
    if quiet or sys.stderr is None or (result_count == 1 and not sys.stderr.isatty()):
        yield None, None
        return
    if not sys.stderr.isatty():
        yield (lambda name, results_done: click.echo(f"{name}: {results_done + 1} of "
                                                     f"{result_count}", err=True)), None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.fields[result]:>14}"), BarColumn(),
               TextColumn("{task.completed:.0f} of {task.total:.0f}"), TimeElapsedColumn(),
               TextColumn("{task.description}"))
    with hide_tasks(), Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        # one bar for all results, with the name of the present one
        task = bar.add_task("", total=result_count, result="")
        yield (lambda name, results_done: bar.update(task, completed=results_done, result=name,
                                                     description=""),
               lambda text: bar.update(task, description=text))


# ---------------------------------------------------------------- what is printed


def _print_json(name: str, results: Sequence[Result]) -> None:
    """Print one result, or all of them, as JSON."""
    from ..studies.report import as_json, json_text

    text = as_json(results) if name == "all" else json_text(results[0].as_dict())
    click.echo(text, nl=False)


def _print(name: str, results: Sequence[Result], out: Path | None, summary: Path | None) -> None:
    """Print one result with its table, or the counts and the failing claims of all; then the files.
    """
    from ..studies.summary import counts_line, failing, requirements, tables_of, unexpected

    if name == "all":
        claims = [claim for result in results for claim in result.claims]
        click.echo(f"{len(results)} results: {counts_line(tables_of(results))}")
        _print_claims([*requirements(results), *(claim for _, claim in failing(results))])
        suffix = "" if not failing(results) or unexpected(results) else (
            "; why the others do not is known")
        click.echo(f"{sum(claim.holds for claim in claims)} of {len(claims)} claims hold{suffix}")
    else:
        _print_result(results[0])
    for path in (out / "paper.md" if out is not None else None, summary):
        if path is not None:
            click.echo(f"wrote {path}")


def _print_result(result: Result) -> None:
    """Print a result's heading, its table if it has one, and its claims."""
    from ..studies.report import heading
    from ..studies.study_result import Table

    click.echo(f"{heading(result)}\n{result.about}\n")
    if isinstance(result, Table):
        _print_table(result)
    _print_claims(result.claims)


def _print_table(table: Table) -> None:
    """Print a table: in each cell our number above the paper's, with a mark of how they compare."""
    from rich.console import Console
    from rich.table import Table as Grid
    from rich.text import Text

    from ..studies.report import MARKS, is_scientific, number_text
    from ..studies.summary import counts_line, notes

    # rows and columns in the paper's order; a cell may be empty
    cells = {(cell.row, cell.column): cell for cell in table.cells}
    columns = list(dict.fromkeys(cell.column for cell in table.cells))
    scientific = is_scientific(table)
    grid = Grid("ours\npaper", *columns)
    for row in dict.fromkeys(cell.row for cell in table.cells):
        line: list[Any] = [row]
        for column in columns:
            cell = cells.get((row, column))
            text = Text()
            if cell is not None:
                text.append(number_text(cell.ours, scientific, digits=3))
                if cell.paper is not None:
                    text.append(f"\n{number_text(cell.paper, scientific, digits=2)}"
                                f"\n{MARKS[cell.verdict]} {cell.verdict}", _COLOURS[cell.verdict])
                elif cell.note:
                    text.append(f"\n{cell.note}")
            line.append(text)
        grid.add_row(*line)
    Console().print(grid)
    click.echo(counts_line([table]))
    for group in notes(table):
        click.echo(f"{group.verdict}: {group.places}" + (f": {group.note}" if group.note else ""))


def _print_claims(claims: Sequence[Claim]) -> None:
    """Print each claim: its outcome, what was computed and what the paper says."""
    for claim in claims:
        mark = "FAILS" if claim.outcome == "fails" else claim.outcome
        suffix = f"; {claim.known}" if claim.known else ""
        click.echo(f"{mark}: {claim.statement}: {claim.found} (wanted: {claim.wanted}{suffix})")
