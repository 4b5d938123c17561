"""``gyrospark bench``: our speed and precision beside those of other programs."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from .generate import write_files
from .options import real_number, whole_number

if TYPE_CHECKING:
    from ..benchmarks.contest import Limits, Row
    from ..benchmarks.drift import Course
    from ..benchmarks.ensembles import EnsembleRow
    from ..benchmarks.steps import Cell

__all__ = ["bench"]

_WHAT = ("peers", "step", "ensemble", "drift")


@dataclass(frozen=True)
class _Choice:
    """The options, checked."""

    peers: list[str]
    quick: bool
    t_end: float | None
    rounds: int
    base: str | None

    def limits(self, t_end: float) -> Limits:
        from ..benchmarks.contest import Limits

        return Limits(self.t_end or (1.0 if self.quick else t_end), self.rounds,
                      least=0.005 if self.quick else 0.05, most=2.0 if self.quick else 60.0)


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("what", default="peers")
@click.option("--peers", metavar="A,B", help="Only these, by name (default: all).")
@click.option("--quick", is_flag=True, help="A run of seconds: few settings, short.")
@click.option("--t-end", metavar="T", help="Simulated seconds: 1, 10, 100 or 1000 (default 10; "
              "drift 1000; with --quick 1).")
@click.option("--rounds", metavar="N", help="Timed runs of each (default 5; with --quick 3).")
@click.option("--base", metavar="TEXT", help="Costs are given over the first row with TEXT in its "
              "name (default: the first).")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR",
              help="Write DIR/bench.json and the pictures.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document and nothing else.")
def bench(
    what: str, peers: str | None, quick: bool, t_end: str | None, rounds: str | None,
    base: str | None, out: Path | None, as_json: bool,
) -> int:
    """Measure WHAT on the paper's fast top: peers (default), step, ensemble, drift or all.

    peers: cost and error beside other programs. step: each solver over dense Newton. ensemble:
    many tops at once. drift: energy and position up to 1000 s.

    CPU time, contestants in turn, medians; errors against a long-double reference. Peers are
    optional: pip install "gyrospark[bench]" brings those that are on PyPI. For steady numbers pin
    the run to one core (taskset -c 0 gyrospark bench), all but ensemble, which has two workers.
    Exit code 1 if one of gyrospark's own runs fails.

    \b
    gyrospark bench
    gyrospark bench --peers gyrospark,heyoka --base "heyoka default" --out bench
    gyrospark bench step --quick
    gyrospark bench drift --t-end 100 --out bench
    """
    if what not in (*_WHAT, "all"):
        raise InputError(f"Unknown benchmark {what!r}; choose {', '.join(_WHAT)} or all.")
    choice = _checked(peers, quick, t_end, rounds, base)
    names = _WHAT if what == "all" else (what,)
    results: dict[str, Any] = {}
    with _progress(quiet=as_json) as watch:
        for name in names:
            results[name] = _MEASURE[name](choice, watch)
    if out is not None:
        _write(results, choice, out)
    if as_json:
        click.echo(_json(results, choice), nl=False)
    else:
        for name, result in results.items():
            _PRINT[name](result)
        if out is not None:
            click.echo(f"wrote {', '.join(str(path) for path in sorted(out.glob('*')))}")
    return 1 if any(_failed(part) for result in results.values() for part in result) else 0


def _checked(
    peers: str | None, quick: bool, t_end: str | None, rounds: str | None, base: str | None
) -> _Choice:
    from ..benchmarks import reference
    from ..benchmarks.peers import chosen

    seconds = None if t_end is None else real_number("--t-end", t_end)
    if seconds is not None and not reference.has(seconds):
        times = ", ".join(map(str, reference.TIMES[:-1]))
        raise InputError(f"There is no reference at t = {seconds:g} s; choose --t-end {times} or "
                         f"{reference.TIMES[-1]}.")
    count = whole_number("--rounds", rounds) if rounds is not None else 3 if quick else 5
    if count < 1:
        raise InputError(f"--rounds {count} measures nothing; give 1 or more.")
    return _Choice(chosen(peers), quick, seconds, count, base)


# ---------------------------------------------------------------- measure


def _measure_peers(choice: _Choice, watch: Callable[[str], None]) -> Sequence[Row]:
    from ..benchmarks.contest import compete, with_ratios
    from ..benchmarks.peers import entries

    found = compete(entries(choice.peers, quick=choice.quick), choice.limits(10.0), watch)
    return with_ratios(found, _base(choice, found))


def _base(choice: _Choice, rows: Sequence[Row]) -> str | None:
    if choice.base is not None and not any(choice.base in row.name for row in rows):
        raise InputError(f"No row has {choice.base!r} in its name; --base takes a part of "
                         f"peer and setting, such as {rows[0].name!r}.")
    return choice.base


def _measure_step(choice: _Choice, watch: Callable[[str], None]) -> Sequence[Cell]:
    from ..benchmarks.steps import compare_steps, variants

    dts = (1e-3,) if choice.quick else (1e-3, 1e-2)
    least = choice.limits(10.0).least
    return list(compare_steps(variants(quick=choice.quick), dts, choice.rounds, least, watch))


def _measure_ensemble(choice: _Choice, watch: Callable[[str], None]) -> Sequence[EnsembleRow]:
    from ..benchmarks.ensembles import compare_ensembles, ensemble_entries

    count = 8 if choice.quick else 64
    found = [entry for entry in ensemble_entries(count, quick=choice.quick)
             if entry.peer in choice.peers]
    return compare_ensembles(found, choice.limits(10.0), count, watch)


def _measure_drift(choice: _Choice, watch: Callable[[str], None]) -> Sequence[Course]:
    from ..benchmarks.drift import follow
    from ..benchmarks.peers import entries

    return follow(entries(choice.peers, quick=choice.quick), choice.limits(1000.0), watch)


_MEASURE: dict[str, Callable[[_Choice, Callable[[str], None]], Sequence[Any]]] = {
    "peers": _measure_peers, "step": _measure_step, "ensemble": _measure_ensemble,
    "drift": _measure_drift,
}


def _failed(part: Any) -> bool:
    """Return whether a run of ours that should work did not."""
    row = getattr(part, "row", part)
    return bool(row.failed) and getattr(row, "peer", "gyrospark") == "gyrospark"


@contextmanager
def _progress(*, quiet: bool) -> Iterator[Callable[[str], None]]:
    """Yield a callback that says on the terminal what is measured."""
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield lambda text: None
        return
    from rich.console import Console

    with Console(stderr=True).status("") as status:
        yield lambda text: status.update(text)


# ---------------------------------------------------------------- files


def _json(results: dict[str, Sequence[Any]], choice: _Choice) -> str:
    from ..benchmarks.machine import about

    document = {"about": about(choice.peers)} | {
        name: [part.as_dict() for part in result] for name, result in results.items()}
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _write(results: dict[str, Sequence[Any]], choice: _Choice, out: Path) -> None:
    from ..benchmarks.pictures import draw_drift, draw_work_precision

    write_files({"bench.json": _json(results, choice)}, out)
    if "peers" in results:
        draw_work_precision(results["peers"], out / "work_precision.png")
    if "drift" in results:
        draw_drift(results["drift"], out / "drift.png")


# ---------------------------------------------------------------- what is printed


def _print_peers(rows: Sequence[Row]) -> None:
    t_end = rows[0].t_end
    _print_rows(f"CPU time and errors at t = {t_end:g} s", [(row, []) for row in rows], [])


def _print_ensemble(rows: Sequence[EnsembleRow]) -> None:
    if not rows:
        click.echo("Only gyrospark and heyoka have ensembles.")
        return
    lines = [(row.row, [_number(row.wall_us_per_second, "{:.3g}")]) for row in rows]
    _print_rows(f"{rows[0].trajectories} tops, cost for each, worst error", lines, ["wall µs/s"])


def _print_rows(title: str, lines: Sequence[tuple[Row, list[str]]], more: list[str]) -> None:
    names = ["µs/s", "±", "ns/step", "× base", "dx (m)", "ΔH/H", "|q| − 1", *more]
    grid = _grid(title, ["peer", "setting"], names)
    for row, extra in lines:
        numbers = [_number(row.us_per_second, "{:,.4g}"), _number(row.spread, "{:.0%}"),
                   _number(row.ns_per_step, "{:,.0f}"), _number(row.ratio, "{:.3g}"),
                   *(_number(x, "{:.1e}") for x in (row.error, row.energy_error, row.norm_error))]
        label = row.setting + (f"\n{row.note}" if row.note else "")
        grid.add_row(f"{row.peer} {row.version}".strip(), label, *numbers, *extra)
    _show(grid)


def _print_step(cells: Sequence[Cell]) -> None:
    from ..benchmarks.steps import BASE

    solvers = list(dict.fromkeys(s for cell in cells for s in (*cell.ns, *cell.notes)))
    others = [solver for solver in solvers if solver != BASE]
    columns = [f"{s} ns" for s in solvers] + [f"{BASE} / {s}" for s in others] + ["differ by"]
    grid = _grid("A step by each solver", ["method", "s", "Δt"], columns)
    for cell in cells:
        times = [_number(cell.ns.get(s), "{:,.0f}") + _iterations(cell, s) for s in solvers]
        ratios = [_number(cell.ratio.get(s), "{:.1f}") for s in others]
        worst = max(cell.difference.values(), default=None)
        grid.add_row(cell.variant, str(cell.stages), f"{cell.dt:g}", *times, *ratios,
                     _number(worst, "{:.0e}"))
    _show(grid)
    for text in dict.fromkeys(f"{s}: {note}" for cell in cells for s, note in cell.notes.items()):
        click.echo(text)


def _iterations(cell: Cell, solver: str) -> str:
    return f" [{cell.iterations[solver]:.1f}]" if solver in cell.iterations else ""


def _print_drift(courses: Sequence[Course]) -> None:
    from ..benchmarks.reference import TIMES

    times = [t for t in TIMES if any(p.t == t for c in courses for p in c.points)]
    columns = [text for t in times for text in (f"ΔH/H\n{t} s", f"dx (m)\n{t} s")]
    grid = _grid("Drift", ["entry"], columns)
    for course in courses:
        at = {point.t: point for point in course.points}
        cells = [_number(x, "{:.1e}") for t in times for x in (
            (at[t].energy_error, at[t].error) if t in at else (None, None))]
        grid.add_row(course.name + (f"\n{course.note}" if course.note else ""), *cells)
    _show(grid)


_PRINT: dict[str, Callable[[Any], None]] = {
    "peers": _print_peers, "step": _print_step, "ensemble": _print_ensemble,
    "drift": _print_drift,
}


def _grid(title: str, texts: Sequence[str], numbers: Sequence[str]) -> Any:
    from rich.table import Table

    grid = Table(title=title, title_justify="left")
    for text in texts:
        grid.add_column(text)
    for number in numbers:
        grid.add_column(number, justify="right", no_wrap=True)
    return grid


def _show(grid: Any) -> None:
    from rich.console import Console

    console = Console()
    if not console.is_terminal:  # a file has no width of its own
        console = Console(width=160)
    console.print(grid)


def _number(value: float | None, form: str) -> str:
    return "–" if value is None else form.format(value)
