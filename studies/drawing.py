"""Draw panels as SVG that reads on a light and on a dark page, with the same bytes every time.

Axes and text take the page's colour (``currentColor``); curves have colours of middle brightness
and differ in marks and dashes as well.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from html import escape
from typing import Any

from ..runtime.plotting.trajectory_plots import figure_class
from .study_result import Panel, Series

__all__ = ["arrange", "draw", "inline"]

#: Stands for the page's colour until the text is written.
_INK = "#010203"
_COLOURS = ("#2f7fd0", "#d9622b", "#1a9c78", "#b565c9", "#b98a00", "#7a869a", "#d2527f", "#4f9d2f")
_THEME = ("<style>svg{color:#1c2733}"
          "@media(prefers-color-scheme:dark){svg{color:#dfe6ee}}</style>")
_WIDTH, _HEIGHT = 4.3, 3.0


def draw(panel: Panel) -> str:
    """Return an SVG document of one panel.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    figure_type = figure_class()
    from matplotlib import rc_context

    inks = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
    with rc_context({"svg.hashsalt": "gyrospark", "svg.fonttype": "path", "font.size": 9,
                     **dict.fromkeys(inks, _INK)}):
        figure = figure_type(figsize=(_WIDTH, _height(panel)), layout="constrained")
        _draw_panel(figure.add_subplot(), panel)
        text = io.StringIO()
        figure.savefig(text, format="svg", transparent=True,
                       metadata={"Date": None, "Creator": None})
    return text.getvalue().replace(_INK, "currentColor")


def inline(drawing: str, key: str, label: str) -> str:
    """Return a drawing as an element of a page: it scales, and its ids begin with ``key``."""
    return _bare(drawing, key).replace("<svg", f'<svg role="img" aria-label="{escape(label)}"', 1)


def _bare(drawing: str, key: str) -> str:
    """Return the svg element alone, without a size, its ids begun with ``key``."""
    element = drawing[drawing.index("<svg"):]
    element = re.sub(r"<metadata>.*?</metadata>\s*", "", element, flags=re.DOTALL)
    for name in (" width", " height", " xmlns", " xmlns:xlink"):  # HTML knows both name spaces
        element = re.sub(rf'(<svg[^>]*?){name}="[^"]*"', r"\1", element, count=1)
    element = re.sub(r'(\bid="|xlink:href="#|url\(#)', rf"\g<1>{key}-", element)
    return element.replace("xlink:href", "href")


def arrange(drawings: Sequence[str], columns: int) -> str:
    """Return one SVG document with the drawings in rows of ``columns``."""
    parts, left, top, row_height, width = [], 0.0, 0.0, 0.0, 0.0
    for number, drawing in enumerate(drawings):
        if number and number % columns == 0:
            left, top, row_height = 0.0, top + row_height, 0.0
        wide, high = _size(drawing)
        place = f'<svg x="{left:g}" y="{top:g}" width="{wide:g}" height="{high:g}"'
        parts.append(_bare(drawing, f"p{number}").replace("<svg", place, 1))
        left, row_height = left + wide, max(row_height, high)
        width = max(width, left)
    height = top + row_height
    return (f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}pt" height="{height:g}pt" '
            f'viewBox="0 0 {width:g} {height:g}">\n{_THEME}\n' + "\n".join(parts) + "\n</svg>\n")


def _size(drawing: str) -> tuple[float, float]:
    """Return width and height in points."""
    found = re.search(r'viewBox="0 0 ([0-9.]+) ([0-9.]+)"', drawing)
    assert found is not None, "matplotlib writes a viewBox from the origin"
    return float(found[1]), float(found[2])


def _height(panel: Panel) -> float:
    """Return the height in inches, with room for a long legend below."""
    return _HEIGHT + 0.2 * (_legend_rows(panel) if _legend_below(panel) else 0)


def _legend_below(panel: Panel) -> bool:
    return len(panel.series) > 2


def _legend_rows(panel: Panel) -> int:
    return -(-len(panel.series) // 2)


def _draw_panel(axes: Any, panel: Panel) -> None:
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
    if panel.zero:
        values = [0.0, *(value for series in panel.series for value in series.y)]
        axes.set_ylim(1.15 * min(values), 1.15 * max(values))
    axes.grid(color=_INK, alpha=0.15, linewidth=0.6)
    if _legend_below(panel):
        axes.legend(fontsize=8, frameon=False, ncols=2, loc="upper center",
                    bbox_to_anchor=(0.5, -0.2))
    elif len(panel.series) > 1:
        axes.legend(fontsize=8, framealpha=0, loc="best")


def _mark_points(axes: Any, panel: Panel) -> None:
    """Put ticks with plain numbers at the points of a log axis, as far as they have room."""
    ticks: list[float] = []
    for x in sorted({x for series in panel.series for x in series.x}):
        if not ticks or x > 1.5 * ticks[-1]:
            ticks.append(x)
    axes.set_xticks(ticks, [f"{x:g}" for x in ticks])
    axes.set_xticks([], minor=True)


def _draw_series(axes: Any, series: Series, colour: str) -> None:
    axes.plot(series.x, series.y, series.style, color=colour, label=series.label, linewidth=1.3,
              markersize=4, markerfacecolor="none" if "o" in series.style else colour)
