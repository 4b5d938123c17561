"""``make bench``: speed and precision of gyrospark and other programs, in tables."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from gyrospark.commands import _call
from gyrospark.commands.generate import write_files
from gyrospark.commands.options import check_folder, json_option, real_number, whole_number
from gyrospark.core.arguments import unknown
from gyrospark.core.errors import InputError
from gyrospark.core.progress import hide_tasks

if TYPE_CHECKING:
    from gyrospark.references.work_precision import WorkPrecisionRun

    from .batches import BatchRow
    from .contest import ContestRow, Limits
    from .derivative_cost import DerivativeCost
    from .drift import DriftRun
    from .ensembles import EnsembleRow
    from .events import EventRow
    from .gradients import GradientRow
    from .growth import Size
    from .joined_bodies import BodyRow
    from .long_runs import LongRun
    from .scaling import Scale
    from .steps import StepTiming
    from .storing import StoreRow
    from .sweeping import SweepRow

__all__ = ["PRINT", "bench"]

def _print_peers(rows: Sequence[ContestRow]) -> None:
    if not rows:
        click.echo("None of these peers has a run of the fast top; they have bodies on joints, or "
                   "gradients.")
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
    from .steps import BASE

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
    from .reference_states import TIMES

    times = [t for t in TIMES if any(p.t == t for c in courses for p in c.points)]
    columns = [text for t in times for text in (f"ΔH/H\n{t} s", f"dx (m)\n{t} s")]
    grid = _grid("Drift", ["entry"], columns)
    for computed in courses:
        at = {point.t: point for point in computed.points}
        cells = [_number(x, "{:.1e}") for t in times for x in (
            (at[t].energy_error, at[t].error) if t in at else (None, None))]
        grid.add_row(computed.name + (f"\n{computed.note}" if computed.note else ""), *cells)
    _show(grid)


def _print_growth(sizes: Sequence[Size]) -> None:
    from .growth import DT, STAGES, laws

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
    from .joined_bodies import PEERS, T_END

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
    from .joined_bodies import ACCURACIES, PEERS, cheapest

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
    from .sweeping import WAYS

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


def _print_gradients(rows: Sequence[GradientRow]) -> None:
    from .gradients import PEERS

    if not rows:
        click.echo(f"Only {', '.join(PEERS)} have gradients.")
        return
    grid = _grid("Value and gradient of a loss at the end of a run: CPU ms, errors relative to the "
                 "largest entry", ["case", "program", "setting"],
                 ["gradient", "±", "run", "ratio", "by start", "by parameters", "built s"])
    for row in rows:
        cost, alone = row.median("gradient"), row.median("primal")
        grid.add_row(row.case, f"{row.peer} {row.version}".strip(),
                     row.setting + (f"\n{row.note}" if row.note else ""),
                     _number(cost and cost * 1e3, "{:,.3g}"), _number(row.spread, "{:.0%}"),
                     _number(alone and alone * 1e3, "{:,.3g}"),
                     _number(cost and alone and cost / alone, "{:.1f}"),
                     _number(row.by_start, "{:.1e}"), _number(row.by_parameters, "{:.1e}"),
                     _number(row.built, "{:.2f}"))
    _show(grid)


def _print_derivatives(rows: Sequence[DerivativeCost]) -> None:
    from .derivative_cost import COUNTS

    if not rows:
        return
    grid = _grid("Derivatives over the run itself, 3-G-L; CPU seconds to derive and compile a "
                 "stepper, and more when derivatives are first asked for", ["model"],
                 ["µs/step", "gradient", *(f"{k} tangents" for k in COUNTS), "derive", "compile",
                  "derive more", "compile more"])
    for row in rows:
        grid.add_row(row.case, f"{row.us_per_step:,.3g}", f"{row.over_primal():.1f}",
                     *(f"{row.over_primal(k):.1f}" for k in COUNTS),
                     *(f"{x:.2f}" for x in (row.derive, row.compile, row.derive_more,
                                            row.compile_more)))
    _show(grid)


def _print_scales(rows: Sequence[Scale]) -> None:
    from .scaling import tables

    for axis, (head, *lines) in tables(rows).items():
        grid = _grid(f"Costs by {axis}", head[:1], head[1:])
        for line in lines:
            grid.add_row(*line)
        _show(grid)


def _print_references(runs: Sequence[WorkPrecisionRun]) -> None:
    grid = _grid("Reference problems", ["problem", "scheme"], ["steps", "error", "CPU ms"])
    for run in runs:
        grid.add_row(run.name, run.label, f"{run.steps:,}", f"{run.error:.1e}",
                     f"{run.cpu_seconds * 1e3:.2f}")
    _show(grid)


def _print_robots(runs: Sequence[LongRun]) -> None:
    grid = _grid("Mechanisms with closed loops", ["mechanism", "program"],
                 ["steps", "µs/step", "constraints", "energy (J)", "error (m)"])
    for run in runs:
        grid.add_row(run.mechanism, run.name + (f"\n{run.note}" if run.note else ""),
                     f"{run.steps:,}", f"{run.cpu_seconds * 1e6:.3g}",
                     *(f"{x:.0e}" for x in (run.constraint, run.energy, run.error)))
    _show(grid)


#: Name of a result → what prints it.
PRINT: dict[str, Callable[[Any], None]] = {
    "peers": _print_peers, "step": _print_step, "ensemble": _print_ensemble,
    "drift": _print_drift, "growth": _print_growth, "bodies": _print_bodies,
    "batches": _print_batches, "store": _print_store, "sweeps": _print_sweeps,
    "events": _print_events, "gradients": _print_gradients, "derivatives": _print_derivatives,
    "scale": _print_scales, "references": _print_references, "robots": _print_robots,
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


_WHAT = ("peers", "step", "ensemble", "drift", "bodies", "store", "sweeps", "events",
         "gradients", "scale", "references", "robots")
#: Axes of scale.
_AXES = ("bodies", "stages", "trajectories", "numbers")
#: What has more than one result.
_PARTS = {"bodies": ("growth", "bodies", "batches"), "gradients": ("gradients", "derivatives")}


@dataclass(frozen=True)
class _Choice:
    """The options, checked."""

    peers: list[str]
    quick: bool
    t_end: float | None
    rounds: int
    base: str | None
    #: Axis of scale → its largest size.
    largest: dict[str, int] = field(default_factory=dict)
    problems: tuple[str, ...] = ()
    mjcf: tuple[Path, ...] = ()

    def limits(self, t_end: float) -> Limits:
        from .contest import Limits

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
@click.option("--largest", multiple=True, metavar="AXIS=N", help="Of scale: leave out sizes of "
              "AXIS (bodies, stages, trajectories, numbers) above N.")
@click.option("--problem", "problems", multiple=True, metavar="NAME",
              help="Of references: this problem; may be repeated (default: all).")
@click.option("--mjcf", multiple=True, type=click.Path(path_type=Path), metavar="FILE.xml",
              help="With robots: a robot in MJCF too, such as Cassie; may be repeated.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR",
              help="Write DIR/bench.json and the pictures.")
@json_option
def bench(
    what: str, peers: str | None, quick: bool, t_end: str | None, rounds: str | None,
    base: str | None, largest: tuple[str, ...], problems: tuple[str, ...], mjcf: tuple[Path, ...],
    out: Path | None, as_json: bool,
) -> int:
    """Measure WHAT: peers (default), step, ensemble, drift, store, sweeps (fast top), bodies,
    events, gradients, scale, references, robots, all.

    peers: cost and error beside other programs. step: each solver over dense Newton. ensemble:
    many tops at once. drift: energy and position up to 1000 s. bodies: how chains grow up to 100
    bodies; the chain of 8 and a four-bar beside exudyn, MuJoCo and PyDy; an arm of 7 links and a
    tree of 30 by sympy.physics.mechanics beside PyDy; 1 s of motion; and eight of the first two
    together beside one alone. store: what streaming a run to a store adds, beside what the disk
    takes. sweeps: what a sweep costs beside its bare kernel, with steps, cells, stored states,
    threads and Dask workers.
    events: a pendulum through the bottom and the fast top's height, with states between steps,
    beside heyoka and SciPy.
    gradients: of a loss at the end of a run of the fast top, a four-bar and a chain of 8, beside
    heyoka, diffrax, CasADi and MuJoCo; what gradients and tangents cost over the run itself.
    scale: how costs grow with bodies (to 1000), stages, trajectories (to 1e5) and stored numbers
    (to 1e9); with --out a page, scale.md.
    references: problems with known digits, error against cost, with SciPy, heyoka, exudyn and
    MuJoCo where they can go; with --out a page, references.md.
    robots: mechanisms with closed loops for a million steps (--quick: 1,000): constraints, energy,
    error and cost, with MuJoCo, exudyn and Pinocchio. cassie.xml and 2f85.xml for --mjcf are files
    of MuJoCo Menagerie, github.com/google-deepmind/mujoco_menagerie, in agility_cassie and
    robotiq_2f85; others with the mass and inertia of each body may be given, too.

    CPU time, contestants in turn, medians; errors against a long-double reference. Peers are
    optional: pip install ".[bench]" in a checkout brings those that are on PyPI. For steady
    numbers pin the run to one core (taskset -c 0 make bench), all but ensemble and sweeps,
    which have several workers.
    Exit code 1 if one of gyrospark's own runs fails.

    \b
    make bench
    make bench WHAT="--peers gyrospark,heyoka --base 'heyoka default' --out bench"
    make bench WHAT="step --quick"
    make bench WHAT="drift --t-end 100 --out bench"
    make bench WHAT="bodies --rounds 3 --out bench"
    make bench WHAT="store --rounds 5"
    make bench WHAT="sweeps --out bench"
    make bench WHAT="events --peers gyrospark,heyoka"
    make bench WHAT="gradients --out bench"
    make bench WHAT="scale --largest bodies=100 --out bench"
    make bench WHAT="references --problem neumann"
    make bench WHAT="robots --mjcf cassie.xml --out bench"
    """
    if what not in (*_WHAT, "all"):
        raise unknown("benchmark", what, [*_WHAT, "all"])
    choice = replace(_checked(peers, quick, t_end, rounds, base, largest), problems=problems,
                     mjcf=mjcf)
    if out is not None:  # before hours of work
        from gyrospark.runtime.plotting.trajectory_plots import figure_class

        check_folder("--out", out)
        figure_class()
    names = [part for name in (_WHAT if what == "all" else (what,))
             for part in _PARTS.get(name, (name,))]
    _refuse_without_extras(names, out)
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
            PRINT[name](result)
        if out is not None:
            click.echo(f"wrote {', '.join(str(path) for path in sorted(out.glob('*')))}")
    return 1 if any(_failed(part) for result in results.values() for part in result) else 0


def _refuse_without_extras(names: Sequence[str], out: Path | None) -> None:
    """Say which extra is missing before anything is measured, not after."""
    if {"store", "sweeps", "scale"} & set(names):
        from gyrospark import storage  # noqa: F401
    if out is not None:
        from gyrospark.runtime.plotting.trajectory_plots import figure_class

        figure_class()


def _checked(
    peers: str | None, quick: bool, t_end: str | None, rounds: str | None, base: str | None,
    largest: Sequence[str],
) -> _Choice:
    from . import reference_states
    from .peers import chosen

    seconds = None if t_end is None else real_number("--t-end", t_end)
    if seconds is not None and not reference_states.has(seconds):
        times = ", ".join(map(str, reference_states.TIMES[:-1]))
        raise InputError(f"There is no reference at t = {seconds:g} s; choose --t-end {times} or "
                         f"{reference_states.TIMES[-1]}.")
    count = whole_number("--rounds", rounds) if rounds is not None else 3 if quick else 5
    if count < 1:
        raise InputError(f"--rounds {count} measures nothing; give 1 or more.")
    bounds = {}
    for text in largest:
        axis, equals, number = text.partition("=")
        if not equals or axis not in _AXES:
            raise InputError(f"--largest {text!r} names no axis; give AXIS=N with AXIS one of "
                             f"{', '.join(_AXES)}, such as bodies=100.")
        bounds[axis] = whole_number(f"--largest {axis}", number)
    return _Choice(chosen(peers), quick, seconds, count, base, bounds)


# ---------------------------------------------------------------- measure


def _measure_peers(choice: _Choice, watch: Callable[[str], None]) -> Sequence[ContestRow]:
    from .contest import compete, with_ratios
    from .peers import entries

    found = compete(entries(choice.peers, quick=choice.quick), choice.limits(10.0), watch)
    return with_ratios(found, _base(choice, found))


def _base(choice: _Choice, rows: Sequence[ContestRow]) -> str | None:
    if choice.base is not None and rows and not any(choice.base in row.name for row in rows):
        raise InputError(f"No row has {choice.base!r} in its name; --base takes a part of "
                         f"peer and setting, such as {rows[0].name!r}.")
    return choice.base


def _measure_step(choice: _Choice, watch: Callable[[str], None]) -> Sequence[StepTiming]:
    from .steps import compare_steps, variants

    dts = (1e-3,) if choice.quick else (1e-3, 1e-2)
    least = choice.limits(10.0).least
    return list(compare_steps(variants(quick=choice.quick), dts, choice.rounds, least, watch))


def _measure_ensemble(choice: _Choice, watch: Callable[[str], None]) -> Sequence[EnsembleRow]:
    from .ensembles import compare_ensembles, ensemble_entries

    count = 8 if choice.quick else 64
    found = [entry for entry in ensemble_entries(count, quick=choice.quick)
             if entry.peer in choice.peers]
    return compare_ensembles(found, choice.limits(10.0), count, watch)


def _measure_drift(choice: _Choice, watch: Callable[[str], None]) -> Sequence[DriftRun]:
    from .drift import follow
    from .peers import entries

    return follow(entries(choice.peers, quick=choice.quick), choice.limits(1000.0), watch)


def _measure_growth(choice: _Choice, watch: Callable[[str], None]) -> Sequence[Size]:
    from .growth import COUNTS, QUICK, grow

    if "gyrospark" not in choice.peers:
        return []
    counts, steps = (QUICK, 100) if choice.quick else (COUNTS, 1000)
    return grow(counts, steps, choice.rounds, choice.limits(1.0).least, watch)


def _measure_bodies(choice: _Choice, watch: Callable[[str], None]) -> Sequence[BodyRow]:
    from .joined_bodies import PEERS, compare_bodies, linkages
    from .mechanics import compare_mechanics, links

    peers = [peer for peer in PEERS if peer in choice.peers]
    if not peers:
        return []
    least = choice.limits(1.0).least
    found = compare_bodies(linkages(quick=choice.quick), peers, choice.rounds, least,
                           quick=choice.quick, watch=watch)
    if {"gyrospark", "pydy"} & set(peers):
        found += compare_mechanics(links(quick=choice.quick), peers, choice.rounds, least,
                                   quick=choice.quick, watch=watch)
    return found


def _measure_batches(choice: _Choice, watch: Callable[[str], None]) -> Sequence[BatchRow]:
    from .batches import compare_batches
    from .joined_bodies import linkages

    if "gyrospark" not in choice.peers:
        return []
    return compare_batches(linkages(quick=choice.quick), choice.rounds, quick=choice.quick,
                           watch=watch)


def _measure_store(choice: _Choice, watch: Callable[[str], None]) -> Sequence[StoreRow]:
    from .storing import CASES, QUICK, compare_stores

    if "gyrospark" not in choice.peers:
        return []
    return compare_stores(QUICK if choice.quick else CASES, choice.rounds, watch)


def _measure_sweeps(choice: _Choice, watch: Callable[[str], None]) -> Sequence[SweepRow]:
    from .sweeping import CASES, QUICK, SCHEMES, compare_sweeps

    if "gyrospark" not in choice.peers:
        return []
    cases, schemes = (QUICK, SCHEMES[:1]) if choice.quick else (CASES, SCHEMES)
    return compare_sweeps(cases, schemes, choice.rounds, watch)


def _measure_events(choice: _Choice, watch: Callable[[str], None]) -> Sequence[EventRow]:
    from .events import FastTop, Pendulum, compare_events

    cases = Pendulum(20 if choice.quick else 1000), FastTop(choice.t_end or (
        1.0 if choice.quick else 10.0))
    return compare_events(cases, choice.peers, choice.rounds, choice.limits(1.0).least, watch)


def _measure_gradients(choice: _Choice, watch: Callable[[str], None]) -> Sequence[GradientRow]:
    from .gradients import PEERS, compare_gradients, gradient_cases

    return compare_gradients(
        gradient_cases(quick=choice.quick), [name for name in PEERS if name in choice.peers],
        choice.rounds, choice.limits(1.0).least, quick=choice.quick, watch=watch)


def _measure_derivatives(
    choice: _Choice, watch: Callable[[str], None]
) -> Sequence[DerivativeCost]:
    from .derivative_cost import cases, compare_derivatives

    if "gyrospark" not in choice.peers:
        return []
    return compare_derivatives(cases(quick=choice.quick), choice.rounds, choice.limits(1.0).least,
                               watch)


def _measure_scales(choice: _Choice, watch: Callable[[str], None]) -> Sequence[Scale]:
    from .scaling import QUICK, SIZES, compare_scales

    if "gyrospark" not in choice.peers:
        return []
    sizes = {axis: tuple(size for size in some if size <= choice.largest.get(axis, size))
             for axis, some in (QUICK if choice.quick else SIZES).items()}
    return compare_scales(sizes, choice.rounds, choice.limits(1.0).least, watch)


def _measure_references(
    choice: _Choice, watch: Callable[[str], None]
) -> Sequence[WorkPrecisionRun]:
    from gyrospark import references

    from .reference_peers import measure_peers

    rounds = 1 if choice.quick else 3
    found: list[WorkPrecisionRun] = []
    for name in choice.problems or references.names():
        problem = references.reference(name)
        found += references.measure(problem, rounds=rounds, quick=choice.quick)
        if len(choice.peers) > 1:
            found += measure_peers(problem, rounds=rounds, quick=choice.quick, watch=watch)
    return found


def _measure_robots(choice: _Choice, watch: Callable[[str], None]) -> Sequence[LongRun]:
    from .long_runs import MECHANISMS, Mechanism, measure_long_runs

    mechanisms = [*MECHANISMS.values(), *map(Mechanism.of_file, choice.mjcf)]
    return [run for mechanism in mechanisms for run in measure_long_runs(
        mechanism, steps=1000 if choice.quick else 1_000_000, peers=len(choice.peers) > 1,
        watch=watch)]


_MEASURE: dict[str, Callable[[_Choice, Callable[[str], None]], Sequence[Any]]] = {
    "peers": _measure_peers, "step": _measure_step, "ensemble": _measure_ensemble,
    "drift": _measure_drift, "growth": _measure_growth, "bodies": _measure_bodies,
    "batches": _measure_batches, "store": _measure_store, "sweeps": _measure_sweeps,
    "events": _measure_events, "gradients": _measure_gradients,
    "derivatives": _measure_derivatives, "scale": _measure_scales,
    "references": _measure_references, "robots": _measure_robots,
}


def _failed(part: Any) -> bool:
    """Return whether a run of ours that should work did not."""
    row = getattr(part, "row", part)
    return bool(getattr(row, "failed", False)) and getattr(row, "peer", "gyrospark") == "gyrospark"


@contextmanager
def _progress(*, quiet: bool) -> Iterator[Callable[[str], None]]:
    """Yield a callback that shows on the terminal which benchmark is running."""
    if quiet or sys.stderr is None or not sys.stderr.isatty():
        yield lambda text: None
        return
    from rich.console import Console

    with hide_tasks(), Console(stderr=True).status("") as status:
        yield lambda text: status.update(text)


# ---------------------------------------------------------------- files


def _json(results: dict[str, Sequence[Any]], choice: _Choice) -> str:
    from .machine import about

    document = {"about": about(choice.peers)} | {
        name: [part.as_dict() for part in result] for name, result in results.items()}
    if "growth" in results:
        from .growth import laws

        document["growth_laws"] = laws(results["growth"])
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _write(results: dict[str, Sequence[Any]], choice: _Choice, out: Path) -> None:
    from .pictures import (
        draw_bodies,
        draw_drift,
        draw_gradients,
        draw_growth,
        draw_sweeps,
        draw_work_precision,
    )

    write_files({"bench.json": _json(results, choice)}, out)
    if results.get("scale"):
        from .machine import about
        from .scaling import page

        machine = "{processor}, {cores} cores, {compiler}".format(**about(()))
        options = "".join(f" --largest {axis}={size}" for axis, size in choice.largest.items())
        options += " --quick" * choice.quick + f" --rounds {choice.rounds}"
        write_files({"scale.md": page(results["scale"], machine, options)}, out)
    if "peers" in results:
        draw_work_precision(results["peers"], out / "work_precision.png")
    if "drift" in results:
        draw_drift(results["drift"], out / "drift.png")
    if results.get("gradients"):
        draw_gradients(results["gradients"], out / "gradients.png")
    if results.get("growth"):
        draw_growth(results["growth"], out / "growth.png")
    if results.get("bodies"):
        draw_bodies(results["bodies"], out / "bodies.png")
    if results.get("sweeps"):
        draw_sweeps(results["sweeps"], out / "sweeps.png")
    if results.get("references"):
        from gyrospark import references
        from gyrospark.references.picture import draw_references
        from gyrospark.references.results_page import page as references_page

        problems = {name: [run for run in results["references"] if run.name == name]
                    for name in dict.fromkeys(run.name for run in results["references"])}
        draw_references(list(problems.items()), out / "references.png")
        write_files({"references.md": references_page([
            (references.reference(name), runs) for name, runs in problems.items()],
            "references.png")}, out)
    if results.get("robots"):
        from .long_runs import MECHANISMS, Mechanism, long_runs_page
        from .pictures import draw_long_runs

        measured = {mechanism: [run for run in results["robots"]
                                if run.mechanism == mechanism.name]
                    for mechanism in (*MECHANISMS.values(), *map(Mechanism.of_file, choice.mjcf))}
        draw_long_runs(measured, out / "reference_robots.png")
        write_files({"reference_robots.md": long_runs_page(measured, "reference_robots.png")}, out)


def main() -> NoReturn:
    """Entry point of ``make bench``."""
    _call(bench, "bench")


if __name__ == "__main__":
    main()
