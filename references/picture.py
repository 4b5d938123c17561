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

    Those of a peer are alike; tolerances of one of its schemes are one line.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    columns = min(4, len(measured))
    rows = -(-len(measured) // columns)
    figure = figure_class()(figsize=(3 * columns + 1, 2.4 * rows + 0.8), layout="constrained")
    families = list(dict.fromkeys(run.peer or run.scheme for _, runs in measured for run in runs))
    peers = {run.peer for _, runs in measured for run in runs}
    named: dict[str, Any] = {}
    for number, (title, runs) in enumerate(measured, start=1):
        axes = figure.add_subplot(rows, columns, number)
        axes.set_title(title, fontsize=8)
        for place, family in enumerate(families):
            for points in _lines([run for run in runs if (run.peer or run.scheme) == family]):
                line, = axes.plot(*zip(*points, strict=True), color=_COLOURS[place], ms=3, lw=1,
                                  marker=_MARKS[place % len(_MARKS)],
                                  linestyle="--" if family in peers else "-")
                named.setdefault(family, line)
        axes.axhline(LIMIT, color="0.6", lw=0.6)
        axes.set(xscale="log", yscale="log", ylim=(_ROUNDED / 2, 1))
        costs = np.log10([run.cpu_seconds * 1e3 for run in runs])
        axes.set_xlim(10.0 ** np.floor(costs.min()), 10.0 ** (np.floor(costs.max()) + 1))
        axes.tick_params(labelsize=6)
        axes.tick_params(which="minor", labelbottom=False)
    figure.supxlabel("CPU ms", fontsize=8)
    figure.supylabel("error", fontsize=8)
    figure.legend(named.values(), named.keys(), loc="outside upper center", fontsize=8,
                  ncols=min(len(named), 3 * columns))
    figure.savefig(path, dpi=80)


def _lines(runs: Sequence[WorkPrecisionRun]) -> list[list[tuple[float, float]]]:
    """Return CPU ms and error of runs, scheme by scheme; those with one run each are a line."""
    schemes = dict.fromkeys(run.scheme for run in runs)
    if len(schemes) == len(runs):
        schemes = {"": None}
    return [[(run.cpu_seconds * 1e3, max(run.error, _ROUNDED)) for run in runs
             if scheme in ("", run.scheme)] for scheme in schemes] if runs else []
