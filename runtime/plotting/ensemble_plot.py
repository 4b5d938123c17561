"""Pictures of ensembles; needs matplotlib."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import as_items, choose
from .trajectory_plots import check_picture_path, figure_class, save, thin

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory
    from ..steppers.ensemble import Ensemble

__all__ = ["draw"]

#: Trajectories that are drawn, spread over all of them; panels where no values are named.
_LINES, _PANELS = 200, 6


def draw(ensemble: Ensemble, values: Sequence[str], path: str | os.PathLike[str] | None) -> Any:
    """Draw values against time, a line for each trajectory; see ``Ensemble.plot``."""
    target = None if path is None else check_picture_path(path)
    first = ensemble.members[0]
    known = [*first.quantities, *first.coordinates, *first.momenta]
    wanted = as_items("values", values, "names of quantities, coordinates or momenta")
    names = [choose("value of an ensemble", name, known) for name in wanted] or [
        *(first.quantities or first.coordinates)][:_PANELS]
    figure = figure_class()(figsize=(9, 2 + 1.8 * len(names)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(names) + 1, 1, sharex=True))
    shown = np.unique(np.linspace(0, len(ensemble) - 1, min(len(ensemble), _LINES)).astype(int))
    for i in shown:
        one = ensemble.members[i]
        some = thin(one)
        colour = (0.27 + 0.5 * i / len(ensemble), 0.2 + 0.5 * (1 - i / len(ensemble)), 0.5)
        rows = [_values(one, name) for name in names] + [one.energy_error()]
        for axes, row in zip(panels, rows, strict=True):
            axes.plot(one.t[some].astype(float), row[some].astype(float), color=colour,
                      linewidth=0.7)
    less = " − W" if "forces" in first.manifest["system"] else ""
    for axes, title in zip(panels, [*names, f"energy error H − H₀{less}"], strict=True):
        axes.set_title(title, fontsize=10)
        axes.grid(alpha=0.3)
    panels[-1].set_xlabel("t [s]")
    some_of = f", {len(shown)} of them drawn" if len(shown) < len(ensemble) else ""
    figure.suptitle(f"{first.manifest['name']}: {len(ensemble):,} trajectories{some_of}, "
                    f"{len(ensemble.failures):,} failed", fontsize=11)
    if target is not None:
        save(figure, target)
    return figure


def _values(run: Trajectory, name: str) -> NDArray[Any]:
    """Return a quantity, a coordinate or a momentum of each state."""
    if name in run.quantities:
        return run.quantity(name)
    names, rows = ((run.coordinates, run.q) if name in run.coordinates else
                   (run.momenta, run.p))
    found: NDArray[Any] = rows[:, names.index(name)]
    return found
