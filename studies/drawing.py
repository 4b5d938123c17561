"""Draw panels as SVG that reads on a light and on a dark page, with the same bytes every time.

Axes and text take the page's colour (``currentColor``); curves have colours of middle brightness
and differ in marks and dashes as well.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

from ..runtime.plotting.trajectory_plots import figure_class
from .study_result import Panel, Series

__all__ = ["draw"]

#: Stands for the page's colour until the text is written.
_INK = "#010203"
_COLOURS = ("#2f7fd0", "#d9622b", "#1a9c78", "#b565c9", "#b98a00", "#7a869a", "#d2527f", "#4f9d2f")
_THEME = ("<style>svg{color:#1c2733}"
          "@media(prefers-color-scheme:dark){svg{color:#dfe6ee}}</style>")
_WIDTH, _HEIGHT = 4.3, 3.0


def draw(panels: Sequence[Panel], columns: int) -> str:
    """Return an SVG document with panels in rows of ``columns``.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    figure_type = figure_class()
    from matplotlib import rc_context

    columns = min(columns, len(panels))
    heights = [max(map(_height, panels[first : first + columns]))
               for first in range(0, len(panels), columns)]
    inks = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
    # a salt in place of random names of elements; letters as paths, whatever fonts a reader has
    with rc_context({"svg.hashsalt": "gyrospark", "svg.fonttype": "path", "font.size": 9,
                     **dict.fromkeys(inks, _INK)}):
        figure = figure_type(figsize=(_WIDTH * columns, sum(heights)), layout="constrained")
        grid = figure.add_gridspec(len(heights), columns, height_ratios=heights)
        for number, panel in enumerate(panels):
            _draw_panel(figure.add_subplot(grid[divmod(number, columns)]), panel)
        text = io.StringIO()
        # a date or the version of matplotlib would change the bytes
        figure.savefig(text, format="svg", transparent=True,
                       metadata={"Date": None, "Creator": None})
    # the colour of the page is no colour that matplotlib could write
    return text.getvalue().replace(_INK, "currentColor").replace("<defs>", _THEME + "<defs>", 1)


def _height(panel: Panel) -> float:
    """Return the height in inches, with room for a long legend below."""
    return _HEIGHT + 0.2 * (_legend_rows(panel) if _is_legend_below(panel) else 0)


def _is_legend_below(panel: Panel) -> bool:
    """Return whether the legend is too long for a place between the curves."""
    return len(panel.series) > 2


def _legend_rows(panel: Panel) -> int:
    """Return the rows of a legend of two columns: ⌈number of series / 2⌉."""
    return -(-len(panel.series) // 2)


def _draw_panel(axes: Any, panel: Panel) -> None:
    """Draw the series of a panel with its titles, scales and legend."""
    for number, series in enumerate(panel.series):
        _draw_series(axes, series, _COLOURS[number % len(_COLOURS)])
    axes.set_title(panel.title, fontsize=9.5)
    axes.set_xlabel(panel.xlabel)
    axes.set_ylabel(panel.ylabel)
    axes.set_xscale(panel.xscale)
    axes.set_yscale(panel.yscale)
    if panel.xscale == "log":
        _mark_points(axes, panel)
    if panel.yscale == "linear":
        axes.ticklabel_format(axis="y", style="sci", scilimits=(-3, 4), useOffset=False)
    if panel.zero:  # the axis shows 0: with 15 % of room beyond the extremes
        heights = [0.0, *(y for series in panel.series for y in series.y)]
        axes.set_ylim(1.15 * min(heights), 1.15 * max(heights))
    axes.grid(color=_INK, alpha=0.15, linewidth=0.6)
    if _is_legend_below(panel):
        axes.legend(fontsize=8, frameon=False, ncols=2, loc="upper center",
                    bbox_to_anchor=(0.5, -0.2))
    elif len(panel.series) > 1:
        axes.legend(fontsize=8, framealpha=0, loc="best")


def _mark_points(axes: Any, panel: Panel) -> None:
    """Put ticks with plain numbers at the points of a log axis, as far as they have room."""
    ticks: list[float] = []
    for x in sorted({x for series in panel.series for x in series.x}):
        # labels of closer points would overlap
        if not ticks or x > 1.5 * ticks[-1]:
            ticks.append(x)
    axes.set_xticks(ticks, [f"{x:g}" for x in ticks])
    axes.set_xticks([], minor=True)


def _draw_series(axes: Any, series: Series, colour: str) -> None:
    """Draw a curve; circles are empty, so that curves below them stay visible."""
    axes.plot(series.x, series.y, series.style, color=colour, label=series.label, linewidth=1.3,
              markersize=4, markerfacecolor="none" if "o" in series.style else colour)
