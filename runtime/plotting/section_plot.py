"""Pictures of Poincaré sections; needs matplotlib."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

from .trajectory_plots import check_picture_path, figure_class, save

if TYPE_CHECKING:
    from ..events.poincare_section import Section

__all__ = ["draw"]

#: Points beyond which each is drawn as one dot.
_MANY = 20_000


def draw(section: Section, x: str, y: str, path: str | os.PathLike[str] | None) -> Any:
    """Draw the points of a section by two of their values; see ``Section.plot``."""
    target = None if path is None else check_picture_path(path)
    across, up = section.values(x).astype(float), section.values(y).astype(float)
    figure = figure_class()(figsize=(7, 6), layout="constrained")
    axes = figure.add_subplot()
    many = len(section) > _MANY
    axes.scatter(across, up, c=section.trajectory, s=0.2 if many else 2, cmap="viridis",
                 linewidths=0, rasterized=many)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    way = {-1: ", falling", 0: "", 1: ", rising"}[section.event.direction]
    axes.set_title(f"{section.event.quantity} = {float(section.event.level):g}{way}: "
                   f"{len(section):,} points", fontsize=11)
    if target is not None:
        save(figure, target)
    return figure
