"""Pictures of the results: work against precision, and drift; needs matplotlib."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gyrospark.runtime.plotting.trajectory_plots import figure_class

from .contest import ContestRow
from .drift import DriftRun
from .growth import Size, laws
from .joined_bodies import BodyRow
from .long_runs import LongRun, Mechanism

if TYPE_CHECKING:
    from .gradients import GradientRow
    from .sweeping import SweepRow

__all__ = ["draw_bodies", "draw_drift", "draw_gradients", "draw_growth",
           "draw_sweeps", "draw_work_precision"]

_MARKS = "osD^vPX*<>hp"
_COLOURS = [*(f"C{number}" for number in range(10)), "black", "gold", "navy", "darkgreen"]
#: Errors below this are round-off and are drawn at it.
_FLOOR = 1e-18
#: The same of errors that are relative and at a double's rounding.
_ROUNDED = 1e-16


def draw_work_precision(rows: Sequence[ContestRow], path: Path) -> None:
    """Draw cost against error; a line joins those settings of a family that no other beats.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    figure = figure_class()(figsize=(8.5, 5.5), layout="constrained")
    axes = figure.add_subplot()
    drawn = [row for row in rows if row.us_per_second and row.error is not None]
    for number, family in enumerate(dict.fromkeys(_family(row) for row in drawn)):
        points = sorted((max(row.error or 0.0, _FLOOR), row.us_per_second or 0.0)
                        for row in drawn if _family(row) == family)
        line, = axes.plot(*zip(*points, strict=True), _MARKS[number % len(_MARKS)], label=family,
                          alpha=0.85)
        axes.plot(*zip(*_best(points), strict=True), "-", color=line.get_color(), alpha=0.85)
    t_end = drawn[0].t_end if drawn else 0
    _finish(axes, f"distance of the mass centre to the reference at t = {t_end:g} s, in m",
            "CPU µs for a simulated second")
    figure.savefig(path, dpi=150)


def draw_drift(courses: Sequence[DriftRun], path: Path) -> None:
    """Draw energy error and position error against time.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    figure = figure_class()(figsize=(11, 5), layout="constrained")
    energy, position = figure.subplots(1, 2)
    for number, course in enumerate(c for c in courses if c.points):
        mark = _MARKS[number % len(_MARKS)] + "-"
        times = [point.t for point in course.points]
        energy.plot(times, _seen(p.energy_error for p in course.points), mark, ms=4,
                    label=course.name, alpha=0.85)
        known = [p for p in course.points if p.error is not None]
        position.plot([p.t for p in known], _seen(p.error or 0.0 for p in known), mark, ms=4,
                      alpha=0.85)
    _finish(energy, "t in s", "|H − H₀| / |H₀|")
    _finish(position, "t in s", "distance of the mass centre to the reference, in m")
    figure.savefig(path, dpi=150)


def draw_growth(sizes: Sequence[Size], path: Path) -> None:
    """Draw what it takes to make a chain's stepper, and a step of it, against N.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    figure = figure_class()(figsize=(11, 5), layout="constrained")
    making, stepping = figure.subplots(1, 2)
    slopes = laws(sizes)
    parts = {
        making: {"model_s": (1.0, "model and its start"), "generate_s": (1.0, "derive and emit"),
                 "compile_s": (1.0, "compile")},
        stepping: {"us_per_step": (1.0, "a step"), "us_per_body": (1.0, "a body of a step"),
                   "ns_per_body_and_sweep": (1e-3, "a body of a sweep")},
    }
    for axes, costs in parts.items():
        for mark, (cost, (unit, text)) in zip(_MARKS, costs.items(), strict=False):
            known = [(size.bodies, y * unit) for size in sizes if (y := getattr(size, cost))]
            law = f", ~ N^{slopes[cost]:.2f}" if cost in slopes else ""
            if known:
                axes.plot(*zip(*known, strict=True), mark + "-", ms=4, label=text + law)
    for axes, y in ((making, "CPU seconds"), (stepping, "CPU µs")):
        axes.set(xscale="log", yscale="log", xlabel="bodies", ylabel=y)
        axes.set_xticks([size.bodies for size in sizes],
                        [str(size.bodies) for size in sizes], minor=False)
        axes.set_xticks([], minor=True)
        axes.grid(True, which="major", alpha=0.3)
        axes.legend(fontsize=8)
    figure.savefig(path, dpi=150)


def draw_bodies(rows: Sequence[BodyRow], path: Path) -> None:
    """Draw CPU time against error for each linkage, a line for each program and method.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    figure = figure_class()(figsize=(11, 5), layout="constrained")
    drawn = [row for row in rows if row.seconds and row.error is not None]
    models = list(dict.fromkeys(row.model for row in drawn))
    families = list(dict.fromkeys(row.family for row in drawn))
    for number, model in enumerate(models):
        axes = figure.add_subplot(1, len(models), number + 1, title=model)
        for mark, family in zip(cycle(_MARKS), families, strict=False):
            points = [(max(row.error or 0.0, _FLOOR), (row.seconds or 0.0) * 1e3) for row in drawn
                      if (row.model, row.family) == (model, family)]
            if points:
                axes.plot(*zip(*points, strict=True), mark + "-", ms=4, alpha=0.85,
                          label=family if number == 0 else None)
        _finish(axes, "largest distance of a mass centre to the reference, in m", "CPU ms")
    figure.savefig(path, dpi=150)


def draw_gradients(rows: Sequence[GradientRow], path: Path) -> None:
    """Draw CPU time against error of gradients for each case, a line for each program and method.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    drawn = [row for row in rows if row.error is not None]
    cases = list(dict.fromkeys(row.case for row in drawn))
    named: dict[str, Any] = {}
    figure = figure_class()(figsize=(4 * len(cases) + 3, 5), layout="constrained")
    for number, case in enumerate(cases):
        axes = figure.add_subplot(1, len(cases), number + 1, title=case)
        for place, family in enumerate(dict.fromkeys(row.family for row in drawn)):
            points = sorted((max(row.error or 0.0, _ROUNDED), (row.median("gradient") or 0.0) * 1e3)
                            for row in drawn if (row.case, row.family) == (case, family))
            if points:
                line, = axes.plot(*zip(*points, strict=True), "-", ms=4, alpha=0.85,
                                  marker=_MARKS[place % len(_MARKS)],
                                  color=_COLOURS[place % len(_COLOURS)])
                named.setdefault(family, line)
        _finish(axes, "error relative to the largest entry", "CPU ms of value and gradient")
    figure.legend(named.values(), named.keys(), loc="outside right upper", fontsize=7)
    figure.savefig(path, dpi=150)


def draw_long_runs(measured: Mapping[Mechanism, Sequence[LongRun]], path: Path) -> None:
    """Draw the deviation of the energy against time, a panel for each mechanism.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    columns = min(3, len(measured))
    rows = -(-len(measured) // columns)
    figure = figure_class()(figsize=(3.2 * columns + 1, 2.6 * rows + 0.8), layout="constrained")
    named: dict[str, Any] = {}
    for number, (mechanism, runs) in enumerate(measured.items(), start=1):
        axes = figure.add_subplot(rows, columns, number)
        axes.set_title(mechanism.title, fontsize=8)
        for run in runs:
            program, own = run.name, run.program == "gyrospark"
            seconds = run.dt * run.steps * np.arange(1, len(run.drift) + 1) / max(len(run.drift), 1)
            line, = axes.plot(seconds, np.maximum(run.drift, _ROUNDED), lw=1.2 if own else 0.8,
                              color=_COLOURS[len(named) if program not in named
                                             else list(named).index(program)],
                              linestyle="-" if own else "--")
            named.setdefault(program, line)
        axes.set(xscale="log", yscale="log")
        axes.tick_params(labelsize=6)
    figure.supxlabel("time (s)", fontsize=8)
    figure.supylabel("deviation of the energy (J)", fontsize=8)
    figure.legend(named.values(), named.keys(), loc="outside upper center", fontsize=7, ncols=4)
    figure.savefig(path, dpi=90)


def draw_sweeps(rows: Sequence[SweepRow], path: Path) -> None:
    """Draw what a step of a cell costs against the steps of a cell, and against the cells.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    from .sweeping import WAYS  # needs the extra storage, which other pictures do without

    figure = figure_class()(figsize=(11, 5), layout="constrained")
    for axes, part in zip(figure.subplots(1, 2), ("steps", "cells"), strict=True):
        for mark, scheme in zip(_MARKS, dict.fromkeys(row.scheme for row in rows), strict=False):
            for way, line in zip(WAYS, ("-", "--", ":"), strict=True):
                points = sorted((getattr(row, part), cost) for row in rows
                                if (row.part, row.scheme) == (part, scheme)
                                and (cost := row.ns(way)))
                if points:
                    axes.plot(*zip(*points, strict=True), mark + line, ms=4,
                              label=f"{scheme}, {way}" if part == "steps" else None)
        _finish(axes, f"{part} of a cell" if part == "steps" else "cells, 100 steps each",
                "ns a step of a cell")
    figure.savefig(path, dpi=150)


def _family(row: ContestRow) -> str:
    """Return peer and method; ours is told by scheme and solver."""
    words = row.setting.split()
    kinds = {"gyrospark": [words[0], words[-1]], "casadi": words[:1]}
    return " ".join([row.peer, *kinds.get(row.peer, [])])


def _best(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points, sorted by error, that cost less than every more exact one."""
    kept: list[tuple[float, float]] = []
    for point in points:
        if not kept or point[1] < kept[-1][1]:
            kept.append(point)
    return kept


def _seen(values: Iterable[float]) -> list[float]:
    return [max(value, _FLOOR) for value in values]


def _finish(axes: Any, x: str, y: str) -> None:
    axes.set(xscale="log", yscale="log", xlabel=x, ylabel=y)
    axes.grid(True, which="major", alpha=0.3)
    if axes.get_legend_handles_labels()[1]:
        axes.figure.legend(loc="outside right upper", fontsize=7)
