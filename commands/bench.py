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

from ..core.arguments import unknown
from ..core.errors import InputError
from ..core.progress import hushed
from .bench_tables import PRINT
from .generate import write_files
from .options import check_folder, json_option, real_number, whole_number

if TYPE_CHECKING:
    from ..benchmarks.batches import BatchRow
    from ..benchmarks.contest import ContestRow, Limits
    from ..benchmarks.drift import DriftRun
    from ..benchmarks.ensembles import EnsembleRow
    from ..benchmarks.events import EventRow
    from ..benchmarks.growth import Size
    from ..benchmarks.joined_bodies import BodyRow
    from ..benchmarks.steps import StepTiming
    from ..benchmarks.storing import StoreRow
    from ..benchmarks.sweeping import SweepRow

__all__ = ["bench"]

_WHAT = ("peers", "step", "ensemble", "drift", "bodies", "store", "sweeps", "events")
#: What has more than one result.
_PARTS = {"bodies": ("growth", "bodies", "batches")}


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
@json_option
def bench(
    what: str, peers: str | None, quick: bool, t_end: str | None, rounds: str | None,
    base: str | None, out: Path | None, as_json: bool,
) -> int:
    """Measure WHAT: peers (default), step, ensemble, drift, store, sweeps (fast top), bodies,
    events, all.

    peers: cost and error beside other programs. step: each solver over dense Newton. ensemble:
    many tops at once. drift: energy and position up to 1000 s. bodies: how chains grow up to 100
    bodies; the chain of 8 and a four-bar beside exudyn, MuJoCo and PyDy; an arm of 7 links and a
    tree of 30 by sympy.physics.mechanics beside PyDy; 1 s of motion; and eight of the first two
    together beside one alone. store: what streaming a run to a store adds, beside what the disk
    takes. sweeps: what a sweep costs beside its bare kernel, with steps, cells, stored states,
    threads and Dask workers.
    events: a pendulum through the bottom and the fast top's height, with states between steps,
    beside heyoka and SciPy.

    CPU time, contestants in turn, medians; errors against a long-double reference. Peers are
    optional: pip install ".[bench]" in a checkout brings those that are on PyPI. For steady
    numbers pin the run to one core (taskset -c 0 gyrospark bench), all but ensemble and sweeps,
    which have several workers.
    Exit code 1 if one of gyrospark's own runs fails.

    \b
    gyrospark bench
    gyrospark bench --peers gyrospark,heyoka --base "heyoka default" --out bench
    gyrospark bench step --quick
    gyrospark bench drift --t-end 100 --out bench
    gyrospark bench bodies --rounds 3 --out bench
    gyrospark bench store --rounds 5
    gyrospark bench sweeps --out bench
    gyrospark bench events --peers gyrospark,heyoka
    """
    if what not in (*_WHAT, "all"):
        raise unknown("benchmark", what, [*_WHAT, "all"])
    choice = _checked(peers, quick, t_end, rounds, base)
    if out is not None:  # before hours of work
        from ..runtime.plotting.trajectory_plots import figure_class

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
    if {"store", "sweeps"} & set(names):
        from .. import storage  # noqa: F401
    if out is not None:
        from ..runtime.plotting.trajectory_plots import figure_class

        figure_class()


def _checked(
    peers: str | None, quick: bool, t_end: str | None, rounds: str | None, base: str | None
) -> _Choice:
    from ..benchmarks import reference_states
    from ..benchmarks.peers import chosen

    seconds = None if t_end is None else real_number("--t-end", t_end)
    if seconds is not None and not reference_states.has(seconds):
        times = ", ".join(map(str, reference_states.TIMES[:-1]))
        raise InputError(f"There is no reference at t = {seconds:g} s; choose --t-end {times} or "
                         f"{reference_states.TIMES[-1]}.")
    count = whole_number("--rounds", rounds) if rounds is not None else 3 if quick else 5
    if count < 1:
        raise InputError(f"--rounds {count} measures nothing; give 1 or more.")
    return _Choice(chosen(peers), quick, seconds, count, base)


# ---------------------------------------------------------------- measure


def _measure_peers(choice: _Choice, watch: Callable[[str], None]) -> Sequence[ContestRow]:
    from ..benchmarks.contest import compete, with_ratios
    from ..benchmarks.peers import entries

    found = compete(entries(choice.peers, quick=choice.quick), choice.limits(10.0), watch)
    return with_ratios(found, _base(choice, found))


def _base(choice: _Choice, rows: Sequence[ContestRow]) -> str | None:
    if choice.base is not None and rows and not any(choice.base in row.name for row in rows):
        raise InputError(f"No row has {choice.base!r} in its name; --base takes a part of "
                         f"peer and setting, such as {rows[0].name!r}.")
    return choice.base


def _measure_step(choice: _Choice, watch: Callable[[str], None]) -> Sequence[StepTiming]:
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


def _measure_drift(choice: _Choice, watch: Callable[[str], None]) -> Sequence[DriftRun]:
    from ..benchmarks.drift import follow
    from ..benchmarks.peers import entries

    return follow(entries(choice.peers, quick=choice.quick), choice.limits(1000.0), watch)


def _measure_growth(choice: _Choice, watch: Callable[[str], None]) -> Sequence[Size]:
    from ..benchmarks.growth import COUNTS, QUICK, grow

    if "gyrospark" not in choice.peers:
        return []
    counts, steps = (QUICK, 100) if choice.quick else (COUNTS, 1000)
    return grow(counts, steps, choice.rounds, choice.limits(1.0).least, watch)


def _measure_bodies(choice: _Choice, watch: Callable[[str], None]) -> Sequence[BodyRow]:
    from ..benchmarks.joined_bodies import PEERS, compare_bodies, linkages
    from ..benchmarks.mechanics import compare_mechanics, links

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
    from ..benchmarks.batches import compare_batches
    from ..benchmarks.joined_bodies import linkages

    if "gyrospark" not in choice.peers:
        return []
    return compare_batches(linkages(quick=choice.quick), choice.rounds, quick=choice.quick,
                           watch=watch)


def _measure_store(choice: _Choice, watch: Callable[[str], None]) -> Sequence[StoreRow]:
    from ..benchmarks.storing import CASES, QUICK, compare_stores

    if "gyrospark" not in choice.peers:
        return []
    return compare_stores(QUICK if choice.quick else CASES, choice.rounds, watch)


def _measure_sweeps(choice: _Choice, watch: Callable[[str], None]) -> Sequence[SweepRow]:
    from ..benchmarks.sweeping import CASES, QUICK, SCHEMES, compare_sweeps

    if "gyrospark" not in choice.peers:
        return []
    cases, schemes = (QUICK, SCHEMES[:1]) if choice.quick else (CASES, SCHEMES)
    return compare_sweeps(cases, schemes, choice.rounds, watch)


def _measure_events(choice: _Choice, watch: Callable[[str], None]) -> Sequence[EventRow]:
    from ..benchmarks.events import FastTop, Pendulum, compare_events

    cases = Pendulum(20 if choice.quick else 1000), FastTop(choice.t_end or (
        1.0 if choice.quick else 10.0))
    return compare_events(cases, choice.peers, choice.rounds, choice.limits(1.0).least, watch)


_MEASURE: dict[str, Callable[[_Choice, Callable[[str], None]], Sequence[Any]]] = {
    "peers": _measure_peers, "step": _measure_step, "ensemble": _measure_ensemble,
    "drift": _measure_drift, "growth": _measure_growth, "bodies": _measure_bodies,
    "batches": _measure_batches, "store": _measure_store, "sweeps": _measure_sweeps,
    "events": _measure_events,
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

    with hushed(), Console(stderr=True).status("") as status:
        yield lambda text: status.update(text)


# ---------------------------------------------------------------- files


def _json(results: dict[str, Sequence[Any]], choice: _Choice) -> str:
    from ..benchmarks.machine import about

    document = {"about": about(choice.peers)} | {
        name: [part.as_dict() for part in result] for name, result in results.items()}
    if "growth" in results:
        from ..benchmarks.growth import laws

        document["growth_laws"] = laws(results["growth"])
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def _write(results: dict[str, Sequence[Any]], choice: _Choice, out: Path) -> None:
    from ..benchmarks.pictures import (
        draw_bodies,
        draw_drift,
        draw_growth,
        draw_sweeps,
        draw_work_precision,
    )

    write_files({"bench.json": _json(results, choice)}, out)
    if "peers" in results:
        draw_work_precision(results["peers"], out / "work_precision.png")
    if "drift" in results:
        draw_drift(results["drift"], out / "drift.png")
    if results.get("growth"):
        draw_growth(results["growth"], out / "growth.png")
    if results.get("bodies"):
        draw_bodies(results["bodies"], out / "bodies.png")
    if results.get("sweeps"):
        draw_sweeps(results["sweeps"], out / "sweeps.png")
