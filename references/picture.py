"""Error against CPU time of the runs of reference problems; needs matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..runtime.plotting.trajectory_plots import figure_class
from .work_precision import LIMIT, WorkPrecisionRun

__all__ = ["draw_references"]

_MARKS = "osD^vPX*<>hp"
_COLOURS = [*(f"C{number}" for number in range(10)), "black", "gold", "navy", "darkgreen"]
#: Errors below the rounding of a double are drawn at it.
_ROUNDED = 1e-16


def draw_references(measured: Sequence[tuple[str, Sequence[WorkPrecisionRun]]], path: Path) -> None:
    """Draw error against CPU time, a panel for each problem and a line for each scheme.

    All lines of a peer look alike; the tolerances of one of its schemes form one line. Raises
    MissingDependencyError without matplotlib.
    """
    column_count = min(4, len(measured))
    row_count = -(-len(measured) // column_count)  # rounded up
    figure = figure_class()(figsize=(3 * column_count + 1, 2.4 * row_count + 0.8),
                            layout="constrained")
    # a peer, or one of our schemes: each has a colour and a mark in all panels
    families = list(dict.fromkeys(run.peer or run.scheme for _, runs in measured for run in runs))
    peers = {run.peer for _, runs in measured for run in runs}
    legend_lines: dict[str, Any] = {}
    for panel, (title, runs) in enumerate(measured, start=1):
        axes = figure.add_subplot(row_count, column_count, panel)
        axes.set_title(title, fontsize=8)
        for family_index, family in enumerate(families):
            for points in _lines([run for run in runs if (run.peer or run.scheme) == family]):
                line, = axes.plot(*zip(*points, strict=True), color=_COLOURS[family_index], ms=3,
                                  lw=1, marker=_MARKS[family_index % len(_MARKS)],
                                  linestyle="--" if family in peers else "-")
                legend_lines.setdefault(family, line)
        axes.axhline(LIMIT, color="0.6", lw=0.6)
        axes.set(xscale="log", yscale="log", ylim=(_ROUNDED / 2, 1))
        # whole decades: without them a panel of little range has no label
        costs = np.log10([run.cpu_seconds * 1e3 for run in runs])
        axes.set_xlim(10.0 ** np.floor(costs.min()), 10.0 ** (np.floor(costs.max()) + 1))
        axes.tick_params(labelsize=6)
        axes.tick_params(which="minor", labelbottom=False)
    figure.supxlabel("CPU ms", fontsize=8)
    figure.supylabel("error", fontsize=8)
    figure.legend(legend_lines.values(), legend_lines.keys(), loc="outside upper center",
                  fontsize=8, ncols=min(len(legend_lines), 3 * column_count))
    figure.savefig(path, dpi=80)


def _lines(runs: Sequence[WorkPrecisionRun]) -> list[list[tuple[float, float]]]:
    """Return the lines of a family of runs, each as pairs of CPU ms and error; none for no runs.

    Each scheme is a line. If every scheme has one run alone, as one of each tolerance, all runs
    together are a line.
    """
    if not runs:
        return []
    points_of: dict[str, list[tuple[float, float]]] = {}
    for run in runs:
        point = (run.cpu_seconds * 1e3, max(run.error, _ROUNDED))
        points_of.setdefault(run.scheme, []).append(point)
    if len(points_of) == len(runs):
        return [[point for points in points_of.values() for point in points]]
    return list(points_of.values())
