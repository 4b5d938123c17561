"""Rows of benchmarks: they are measured in turn, and written as tables, JSON and pictures."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import gyrospark as gs

from .peers.optional import Unavailable, need, version
from .timing import Clock, Sample, alternate, repeated

__all__ = ["Choice", "Entry", "Prepared", "Row", "accuracies", "as_json", "cheapest", "contest",
           "draw", "markdown", "power_laws", "table", "text_of"]


@dataclass(frozen=True)
class Row:
    """Costs and errors of one program with one setting.

    Attributes
    ----------
    case, program, setting : str
        The problem; the program with its version; scheme, time step, tolerance.
    numbers : dict of str to float
        Column with its unit, such as "CPU µs/s" or "error (m)" → number.
    samples : dict of str to tuple of float
        Job → seconds of one repetition, for each round.
    energy_drift : tuple of float
        |H − H₀| in J at equal intervals of a long run.
    note : str
        Why numbers are missing.
    failed : bool
        Whether the row ought to have numbers.
    """

    case: str
    program: str
    setting: str
    numbers: dict[str, float] = field(default_factory=dict)
    samples: dict[str, tuple[float, ...]] = field(default_factory=dict)
    energy_drift: tuple[float, ...] = ()
    note: str = ""
    failed: bool = False

    @property
    def family(self) -> str:
        """Program and method, without version, time step and tolerance."""
        method = re.split(r"(?:^|,? )(?:Δt=|tol |γ=|1e-)", self.setting)[0]
        return f"{self.program.split()[0]} {method}".strip()


@dataclass(frozen=True)
class Choice:
    """Options of the command line.

    Attributes
    ----------
    programs : tuple of str
        Programs that take part.
    quick : bool
        Few settings and short runs.
    rounds : int
        Timed runs of each job.
    t_end : float, optional
        Simulated seconds, where a benchmark has a choice.
    only : str
        Text that the name of a case contains.
    base : str
        Text in the program and setting of the row whose cost divides the others.
    mjcf : tuple of Path
        Robots of files.
    watch : callable
        Called with the name of each measurement.
    """

    programs: tuple[str, ...] = ("gyrospark",)
    quick: bool = False
    rounds: int = 5
    t_end: float | None = None
    only: str = ""
    base: str = ""
    mjcf: tuple[Path, ...] = ()
    watch: Callable[[str], None] = lambda text: None

    @property
    def least(self) -> float:
        """Shortest CPU time of a timed job, in s: faster functions are repeated."""
        return 0.005 if self.quick else 0.05


@dataclass(frozen=True)
class Prepared:
    """Timed functions of an entry, compiled, with the errors of one run.

    Attributes
    ----------
    errors : dict of str to float
        Column → error of one run.
    jobs : dict of str to callable
        Name → timed function.
    costs : callable
        Called with job name → times of one repetition each; returns columns of the row.
    """

    errors: dict[str, float]
    jobs: dict[str, Callable[[], object]]
    costs: Callable[[Mapping[str, Sample]], Mapping[str, float]]


@dataclass(frozen=True)
class Entry:
    """A program with one setting; ``prepare`` imports, compiles and runs it once.

    ``prepare`` raises ``Unavailable`` where the program or the setting cannot run.
    """

    program: str
    setting: str
    prepare: Callable[[], Prepared]
    quick: bool = True


def contest(case: str, entries: Iterable[Entry], choice: Choice,
            clock: Clock = time.process_time) -> list[Row]:
    """Return the rows of entries of one case: each is prepared, then all are timed in turn."""
    rows: list[Row] = []
    prepared_entries: dict[int, Prepared] = {}
    for entry in entries:
        if entry.program not in choice.programs or (choice.quick and not entry.quick):
            continue
        choice.watch(f"{case}: {entry.program} {entry.setting}")
        number = gs.__version__ if entry.program == "gyrospark" else version(entry.program)
        row = Row(case, f"{entry.program} {number}".strip(), entry.setting)
        try:
            prepared_entries[len(rows)] = prepared = entry.prepare()
            row = replace(row, numbers=dict(prepared.errors))
        except Unavailable as reason:
            row = replace(row, note=str(reason))
        except Exception as error:  # other programs raise anything; their row has it
            note = str(error) if isinstance(error, gs.GyrosparkError) else f"failed: {error!r}"
            row = replace(row, note=note, failed=entry.program == "gyrospark")
        rows.append(row)
    jobs = {(i, name): repeated(job, choice.least, clock)
            for i, prepared in prepared_entries.items() for name, job in prepared.jobs.items()}
    choice.watch(f"{case}: {len(jobs)} jobs in turn, {choice.rounds} rounds")
    samples = alternate({key: job for key, (job, _) in jobs.items()}, choice.rounds, clock)
    for i, prepared in prepared_entries.items():
        entry_samples = {name: samples[i, name].per(jobs[i, name][1]) for name in prepared.jobs}
        spread = {"±": next(iter(entry_samples.values())).spread} if entry_samples else {}
        costs = prepared.costs(entry_samples)
        rows[i] = replace(rows[i], numbers={**costs, **spread, **rows[i].numbers},
                          samples={name: sample.seconds for name, sample in entry_samples.items()})
    return rows


# ---------------------------------------------------------------- cheapest rows and power laws


def cheapest(rows: Sequence[Row], cost: str, error: str, accuracy: float) -> Row | None:
    """Return the cheapest of the rows with an error up to ``accuracy``."""
    exact = [row for row in rows if cost in row.numbers
             and row.numbers.get(error, math.inf) <= accuracy]
    return min(exact, key=lambda row: row.numbers[cost], default=None)


def accuracies(
    rows: Sequence[Row], cost: str, error: str, levels: Sequence[float], unit: str,
    competitor: Callable[[Row], str] = lambda row: row.program, extra_columns: Sequence[str] = (),
) -> list[Row]:
    """Return the cheapest run of each competitor for each case and accuracy.

    The columns are the cost and ``extra_columns``.
    """
    best_rows = []
    for case in dict.fromkeys(row.case for row in rows):
        of_case = [row for row in rows if row.case == case]
        for level in levels:
            for name in dict.fromkeys(map(competitor, of_case)):
                best = cheapest([row for row in of_case if competitor(row) == name], cost, error,
                                level)
                if best is not None:
                    numbers = {key: best.numbers[key] for key in (cost, *extra_columns)
                               if key in best.numbers}
                    best_rows.append(replace(best, case=f"{case}, {level:.0e}{unit}",
                                             numbers=numbers, samples={}))
    return best_rows


def power_laws(points: Mapping[float, Mapping[str, float]], smallest_size: float = 0.0
               ) -> dict[str, float]:
    """Return the slope of log(cost) against log(size) of each cost that two sizes have.

    ``points`` is size → cost by name; sizes below ``smallest_size`` are left out.
    """
    slopes = {}
    for name in dict.fromkeys(name for costs in points.values() for name in costs):
        points_of_name = [(size, costs[name]) for size, costs in points.items()
                          if size >= smallest_size and costs.get(name, 0) > 0]
        if len(points_of_name) > 1:
            x, y = np.log(np.array(points_of_name, dtype=float)).T
            slopes[name] = float(np.polyfit(x, y, 1)[0])
    return slopes


# ---------------------------------------------------------------- text and pictures


def text_of(number: float) -> str:
    """Return a number with three digits: 12,300 or 1.2e-09."""
    if not math.isfinite(number):
        return f"{number}"
    if number == 0 or 1e-3 <= abs(number) < 1e6:
        return f"{float(f'{number:.3g}'):,.10g}"
    return f"{number:.1e}"


def table(rows: Sequence[Row], base: str = "") -> list[list[str]]:
    """Return head and lines of rows of one benchmark; the last column is cost over the base's.

    The base of a case is its first row that has a cost, which is the first column, and whose name
    contains ``base``.
    """
    columns = list(dict.fromkeys(name for row in rows for name in row.numbers))
    lines = [["case", "program", "setting", *columns, "× base"]]
    for row in rows:
        costs = [(f"{reference.program.split()[0]} {reference.setting}",
                  next(iter(reference.numbers.values())))
                 for reference in rows
                 if reference.case == row.case and reference.numbers and not reference.note]
        unit = next((cost for name, cost in costs if base in name and cost), None)
        row_cost = next(iter(row.numbers.values()), None)
        lines.append([
            row.case, row.program, row.setting + (f" ({row.note})" if row.note else ""),
            *(text_of(row.numbers[name]) if name in row.numbers else "–" for name in columns),
            "–" if unit is None or row_cost is None else text_of(row_cost / unit)])
    return lines


def markdown(lines: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown; the first line is its head."""
    rules = ["---:" if index > 2 else "---" for index in range(len(lines[0]))]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in (lines[0], rules, *lines[1:]))


def draw(rows: Sequence[Row], x: str, y: str, path: Path) -> None:
    """Draw column ``y`` against ``x``, a panel for each case and a line for each family.

    Zeros are drawn at the smallest positive number of their axis. Raises ``Unavailable`` without
    matplotlib.
    """
    shown = [row for row in rows if x in row.numbers and y in row.numbers]
    cases = list(dict.fromkeys(row.case for row in shown))
    families = list(dict.fromkeys(row.family for row in shown))
    columns, lines = min(4, len(cases)) or 1, -(-len(cases) // 4) or 1
    figure = need("matplotlib.figure", "matplotlib").Figure(
        figsize=(4 * columns + 3, 3.6 * lines + 1), layout="constrained")
    lowest = {name: min((row.numbers[name] for row in shown if row.numbers[name] > 0), default=1.0)
              for name in (x, y)}
    legend: dict[str, Any] = {}
    for panel_number, case in enumerate(cases, start=1):
        axes = figure.add_subplot(lines, columns, panel_number, title=case)
        for number, family in enumerate(families):
            points = sorted(tuple(max(row.numbers[name], lowest[name]) for name in (x, y))
                            for row in shown if (row.case, row.family) == (case, family))
            if points:
                line, = axes.plot(*zip(*points, strict=True), marker="osD^vPX*<>hp"[number % 12],
                                  color=f"C{number % 10}", ms=4, alpha=0.85)
                legend.setdefault(family, line)
        axes.set(xscale="log", yscale="log", xlabel=x, ylabel=y)
        axes.grid(visible=True, which="major", alpha=0.3)
    figure.legend(legend.values(), legend.keys(), loc="outside right upper", fontsize=7)
    figure.savefig(path, dpi=120)


def as_json(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return rows as JSON has them."""
    return [asdict(row) for row in rows]
