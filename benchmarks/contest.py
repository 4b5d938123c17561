"""Entries timed in turn and judged: cost of a simulated second, and error where it ends.

1. prepare    import, generate, compile; an entry that cannot says why and is a row without numbers
2. judge      one run to ``t_end``: distance of the mass centre to the reference, energy, |q| − 1
3. stretch    lengthen the timed span until a run takes long enough for the clock
4. time       all entries alternately, several rounds; medians
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from gyrospark.core.errors import GyrosparkError

from .peers.entry import PeerEntry, Run
from .peers.optional import Unavailable
from .reference_states import distance, has
from .timing import alternate, stopwatch
from .tops import TopState, energy, state_of, tops

__all__ = ["ContestRow", "Limits", "compete", "judged", "with_ratios"]

#: Every time step divides it; simulated seconds of the run that foretells the cost of a long one.
_SHORT = 0.2
#: Tells which entry is at work.
Watch = Callable[[str], None]


@dataclass(frozen=True)
class Limits:
    """How long a contest may take.

    Attributes
    ----------
    t_end
        Simulated seconds of a run, at least.
    rounds
        Timed runs of each entry.
    least
        CPU seconds that a timed run shall take at least.
    most
        CPU seconds that a run may take at most; a dearer entry is left out and says so.
    """

    t_end: float = 10.0
    rounds: int = 5
    least: float = 0.05
    most: float = 60.0


@dataclass(frozen=True)
class ContestRow:
    """What was found of one entry; numbers are None where there is none.

    Attributes
    ----------
    us_per_second, ns_per_step
        CPU time of a simulated second in µs, and of a step in ns.
    spread
        Median deviation of the rounds, relative.
    error, energy_error, norm_error
        Distance of the mass centre to the reference in m, |H − H₀|/|H₀| and ||q| − 1| at t_end.
    ratio
        ``us_per_second`` over that of the base row.
    samples
        CPU seconds of every round, for ``span`` simulated seconds.
    note
        Why there are no numbers.
    failed
        Whether it should have worked.
    """

    peer: str
    version: str
    setting: str
    t_end: float
    us_per_second: float | None = None
    spread: float | None = None
    ns_per_step: float | None = None
    error: float | None = None
    energy_error: float | None = None
    norm_error: float | None = None
    ratio: float | None = None
    span: float | None = None
    samples: tuple[float, ...] = ()
    note: str = ""
    failed: bool = False

    @property
    def name(self) -> str:
        """Peer and setting."""
        return f"{self.peer} {self.setting}"

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self)


def compete(entries: Sequence[PeerEntry], limits: Limits, watch: Watch = lambda name: None
            ) -> list[ContestRow]:
    """Return a row for each entry, in their order."""
    rows: dict[str, ContestRow] = {}
    spans: dict[str, tuple[Run, float]] = {}
    for entry in entries:
        watch(entry.name)
        rows[entry.name], run = judged(entry, limits)
        if run is not None:
            spans[entry.name] = run, _stretch(run, limits)
    jobs = {name: _job(run, span) for name, (run, span) in spans.items()}
    watch(f"{len(jobs)} entries in turn, {limits.rounds} rounds")
    for name, sample in alternate(jobs, limits.rounds).items():
        span, entry = spans[name][1], next(e for e in entries if e.name == name)
        cost = sample.per(span).median
        rows[name] = replace(
            rows[name], us_per_second=cost * 1e6, spread=sample.spread, span=span,
            ns_per_step=None if entry.dt is None else cost * entry.dt * 1e9,
            samples=sample.seconds)
    return [rows[entry.name] for entry in entries]


def judged(entry: PeerEntry, limits: Limits) -> tuple[ContestRow, Run | None]:
    """Return a row with the errors at ``t_end``, and the run if it is good for timing."""
    row = ContestRow(entry.peer, entry.version, entry.setting, limits.t_end)
    try:
        run = entry.prepare()
        short = max(_SHORT, limits.t_end / 100)
        expected = limits.t_end / short * min(stopwatch(_job(run, short)) for _ in range(2))
        if expected > limits.most:
            note = f"not run to its end: {limits.t_end:g} s take about {expected:.0f} s"
            return _foretold(row, entry, expected / limits.t_end, note), None
        return _with_errors(row, run(limits.t_end)), run
    except Unavailable as reason:
        return replace(row, note=str(reason)), None
    except Exception as error:  # other programs raise what they like; it is their row
        note = str(error) if isinstance(error, GyrosparkError) else f"failed: {error!r}"
        return replace(row, note=note, failed=True), None


def _foretold(row: ContestRow, entry: PeerEntry, cost: float, note: str) -> ContestRow:
    """Return the row of an entry that is too dear to run: its cost from a short run, no errors."""
    return replace(row, us_per_second=cost * 1e6, note=note,
                   ns_per_step=None if entry.dt is None else cost * entry.dt * 1e9)


def _with_errors(row: ContestRow, end: TopState) -> ContestRow:
    """Return the row with the errors of the worst top of a run."""
    q = np.atleast_2d(end.q)
    starts = [state_of(top) for top in tops(len(q))]
    H0 = np.array([energy(start) for start in starts])
    return replace(
        row,
        error=float(distance(q, row.t_end).max()) if has(row.t_end) else None,
        energy_error=float(np.max(np.abs((np.atleast_1d(energy(end)) - H0) / H0))),
        norm_error=float(np.max(np.abs((q**2).sum(axis=-1) - 1)) / 2),
    )


def _stretch(run: Run, limits: Limits) -> float:
    """Return the simulated seconds that take at least ``limits.least`` CPU seconds."""
    span = limits.t_end
    while (seconds := stopwatch(_job(run, span))) < limits.least:
        span *= 2 if seconds > limits.least / 4 else 4
    return span


def _job(run: Run, t_end: float) -> Callable[[], object]:
    return lambda: run(t_end)


def with_ratios(rows: Sequence[ContestRow], base: str | None = None) -> list[ContestRow]:
    """Return the rows with their cost over that of the base: the first timed row it occurs in.

    Without a row to compare with, there are no ratios.
    """
    timed = [row for row in rows if row.us_per_second and (base or "") in row.name]
    if not timed:
        return list(rows)
    unit = timed[0].us_per_second or 1.0
    return [replace(row, ratio=row.us_per_second / unit) if row.us_per_second else row
            for row in rows]
