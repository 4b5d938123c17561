"""What ``gyrospark bench`` prints: a table for each benchmark."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ..benchmarks.batches import BatchRow
    from ..benchmarks.contest import ContestRow
    from ..benchmarks.drift import DriftRun
    from ..benchmarks.ensembles import EnsembleRow
    from ..benchmarks.events import EventRow
    from ..benchmarks.growth import Size
    from ..benchmarks.joined_bodies import BodyRow
    from ..benchmarks.steps import StepTiming
    from ..benchmarks.storing import StoreRow
    from ..benchmarks.sweeping import SweepRow

__all__ = ["PRINT"]


def _print_peers(rows: Sequence[ContestRow]) -> None:
    if not rows:
        click.echo("None of these peers has the fast top; they have bodies on joints.")
        return
    t_end = rows[0].t_end
    _print_rows(f"CPU time and errors at t = {t_end:g} s", [(row, []) for row in rows], [])


def _print_ensemble(rows: Sequence[EnsembleRow]) -> None:
    if not rows:
        click.echo("Only gyrospark and heyoka have ensembles.")
        return
    lines = [(row.row, [_number(row.wall_us_per_second, "{:.3g}")]) for row in rows]
    _print_rows(f"{rows[0].trajectories} tops, cost for each, worst error", lines, ["wall µs/s"])


def _print_rows(title: str, lines: Sequence[tuple[ContestRow, list[str]]], more: list[str]) -> None:
    names = ["µs/s", "±", "ns/step", "× base", "dx (m)", "ΔH/H", "|q| − 1", *more]
    grid = _grid(title, ["peer", "setting"], names)
    for row, extra in lines:
        numbers = [_number(row.us_per_second, "{:,.4g}"), _number(row.spread, "{:.0%}"),
                   _number(row.ns_per_step, "{:,.0f}"), _number(row.ratio, "{:.3g}"),
                   *(_number(x, "{:.1e}") for x in (row.error, row.energy_error, row.norm_error))]
        label = row.setting + (f"\n{row.note}" if row.note else "")
        grid.add_row(f"{row.peer} {row.version}".strip(), label, *numbers, *extra)
    _show(grid)


def _print_step(cells: Sequence[StepTiming]) -> None:
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


def _iterations(cell: StepTiming, solver: str) -> str:
    return f" [{cell.iterations[solver]:.1f}]" if solver in cell.iterations else ""


def _print_drift(courses: Sequence[DriftRun]) -> None:
    from ..benchmarks.reference_states import TIMES

    times = [t for t in TIMES if any(p.t == t for c in courses for p in c.points)]
    columns = [text for t in times for text in (f"ΔH/H\n{t} s", f"dx (m)\n{t} s")]
    grid = _grid("Drift", ["entry"], columns)
    for course in courses:
        at = {point.t: point for point in course.points}
        cells = [_number(x, "{:.1e}") for t in times for x in (
            (at[t].energy_error, at[t].error) if t in at else (None, None))]
        grid.add_row(course.name + (f"\n{course.note}" if course.note else ""), *cells)
    _show(grid)


def _print_growth(sizes: Sequence[Size]) -> None:
    from ..benchmarks.growth import DT, STAGES, laws

    if not sizes:
        return
    names = ["n", "m", "model s", "derive s", "cc s", "lines of C", "µs/step", "±", "µs/body",
             "sweeps", "ns/body/sweep", "|g|", "|f|", "ΔH/H"]
    grid = _grid(f"Chains of N bodies, G-L s={STAGES}, Δt = {DT:g} s, CPU time", ["N"], names)
    for size in sizes:
        times = [_number(x, "{:.2f}") for x in (size.model_s, size.generate_s, size.compile_s)]
        steps = [_number(size.us_per_step, "{:,.1f}"), _number(size.spread, "{:.0%}"),
                 _number(size.us_per_body, "{:.2f}"), _number(size.sweeps, "{:.1f}"),
                 _number(size.ns_per_body_and_sweep, "{:.0f}")]
        errors = [_number(x, "{:.0e}") for x in (
            size.constraint_max, size.momentum_constraint_max, size.energy_error)]
        label = f"{size.bodies}" + (f"\n{size.note}" if size.note else "")
        grid.add_row(label, str(size.coordinates), str(size.constraints), *times,
                     f"{size.lines:,}", *steps, *errors)
    _show(grid)
    found = laws(sizes)
    if found:
        click.echo("slopes of log(cost) against log(N) from 8 bodies on: "
                   + ", ".join(f"{name} {slope:.2f}" for name, slope in found.items()))


def _print_bodies(rows: Sequence[BodyRow]) -> None:
    from ..benchmarks.joined_bodies import PEERS, T_END

    if not rows:
        click.echo(f"Only {', '.join(PEERS)} have bodies on joints.")
        return
    grid = _grid(f"Bodies on joints, {T_END:g} s of motion", ["model", "program", "setting"],
                 ["CPU ms", "±", "µs/step", "error (m)", "limit (m)"])
    for row in rows:
        setting = row.name.removeprefix(row.peer).strip()
        grid.add_row(row.model, f"{row.peer} {row.version}".strip(),
                     setting + (f"\n{row.note}" if row.note else ""),
                     _number(row.seconds and row.seconds * 1e3, "{:,.2f}"),
                     _number(row.spread, "{:.0%}"), _number(row.us_per_step, "{:,.1f}"),
                     _number(row.error, "{:.1e}"), _number(row.limit, "{:.1e}"))
    _show(grid)
    _print_accuracies(rows)


def _print_accuracies(rows: Sequence[BodyRow]) -> None:
    """Print the cheapest measured run of each program for each accuracy."""
    from ..benchmarks.joined_bodies import ACCURACIES, PEERS, cheapest

    entered = [peer for peer in PEERS if any(row.peer == peer for row in rows)]
    grid = _grid("CPU ms of the cheapest run with at most this error, and over the first program's",
                 ["model", "error (m)", *entered], [])
    for model in dict.fromkeys(row.model for row in rows):
        for accuracy in ACCURACIES:
            best = {peer: cheapest(rows, model, peer, accuracy) for peer in entered}
            cells = [_cheapest(best[peer], best[entered[0]]) for peer in entered]
            grid.add_row(model, f"{accuracy:.0e}", *cells)
    _show(grid)


def _cheapest(row: BodyRow | None, base: BodyRow | None) -> str:
    """Return a row's cost, its setting, and its cost over another's."""
    if row is None or row.seconds is None:
        return "–"
    text = f"{row.seconds * 1e3:,.2f}  {row.name.removeprefix(row.peer).strip()}"
    if base is None or base is row or not base.seconds:
        return text
    return f"{text}\n× {row.seconds / base.seconds:.1f}"


def _print_batches(rows: Sequence[BatchRow]) -> None:
    if not rows:
        return
    names = ["µs/step", "alone", "ratio", "±", "sweeps", "alone", "differ by", "|g|", "ΔH (J)"]
    grid = _grid(f"{rows[0].trajectories} together in {rows[0].lanes} lanes: a step of each and of "
                 f"one alone, Δt = {rows[0].dt:g} s", ["model", "G-L"], names)
    for row in rows:
        label = row.model + (f"\n{row.note}" if row.note else "")
        grid.add_row(label, f"s={row.stages}", _number(row.us_batch, "{:,.1f}"),
                     _number(row.us_alone, "{:,.1f}"), _number(row.ratio, "{:.2f}"),
                     _number(row.spread, "{:.0%}"), _number(row.sweeps, "{:.1f}"),
                     _number(row.sweeps_alone, "{:.1f}"),
                     *(_number(x, "{:.0e}") for x in (row.difference, row.constraint_max,
                                                      row.energy_error)))
    _show(grid)


def _print_store(rows: Sequence[StoreRow]) -> None:
    if not rows:
        return
    grid = _grid("A run in memory and in a store; bytes a second to the store, and what the disk "
                 "takes of one forced file and of many",
                 ["every", "steps"],
                 ["memory ns", "stored ns", "added", "CPU added", "MB/s", "disk", "of files",
                  "B/state"])
    for row in rows:
        states = -(-row.steps // row.every) + 1
        grid.add_row(
            f"{row.every:,}", f"{row.steps:,}", *(f"{ns:,.0f}" for ns in row.ns),
            f"{row.overhead:+.1%}", f"{row.cpu_overhead:+.1%}",
            *(f"{x / 1e6:,.0f}" for x in (row.rate, row.disk, row.disk_files)),
            f"{row.stored_bytes / states:,.0f}")
    _show(grid)


def _print_sweeps(rows: Sequence[SweepRow]) -> None:
    from ..benchmarks.sweeping import WAYS

    if not rows:
        return
    names = [*(f"{way} ns" for way in WAYS), *(f"{way} share" for way in WAYS[1:]), "CPU ns",
             "10⁶ steps/s", "B/cell", "files"]
    grid = _grid("Sweeps beside their kernel: ns a step of a cell, share of the kernel's "
                 "throughput (and of its CPU time)",
                 ["grows", "scheme", "cells", "steps", "every", "workers"], names)
    for row in rows:
        shares = [f"{_number(row.share(way), '{:.0%}')} ({_number(row.cpu_share(way), '{:.0%}')})"
                  for way in WAYS[1:]]
        rate = row.ns("store")
        label = row.part + (f"\n{row.note}" if row.note else "")
        grid.add_row(
            label, row.scheme, f"{row.cells:,}", f"{row.steps:,}",
            "–" if row.every is None else f"{row.every:,}", str(row.workers),
            *(_number(row.ns(way), "{:,.0f}") for way in WAYS), *shares,
            _number(row.cpu_ns("store"), "{:,.0f}"), _number(rate and 1e3 / rate, "{:.3g}"),
            _number(row.bytes_per_cell, "{:,.0f}"), _number(row.files, "{:,}"))
    _show(grid)


def _print_events(rows: Sequence[EventRow]) -> None:
    if not rows:
        click.echo("Only gyrospark, heyoka and scipy have events.")
        return
    grid = _grid("Events and 1000 states between steps; errors of times relative, of angles in "
                 "rad, of mass centres in m", ["case", "program", "setting"],
                 ["run ms", "with event", "with states", "found", "times", "states"])
    for row in rows:
        costs = [row.median(what) for what in ("alone", "events", "dense")]
        grid.add_row(row.case, f"{row.peer} {row.version}".strip(),
                     row.setting + (f"\n{row.note}" if row.note else ""),
                     *(_number(x and x * 1e3, "{:,.3g}") for x in costs),
                     _number(row.found, "{:,}"), _number(row.time_error, "{:.0e}"),
                     _number(row.dense_error, "{:.0e}"))
    _show(grid)


#: Name of a result → what prints it.
PRINT: dict[str, Callable[[Any], None]] = {
    "peers": _print_peers, "step": _print_step, "ensemble": _print_ensemble,
    "drift": _print_drift, "growth": _print_growth, "bodies": _print_bodies,
    "batches": _print_batches, "store": _print_store, "sweeps": _print_sweeps,
    "events": _print_events,
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
