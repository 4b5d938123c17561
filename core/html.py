"""HTML for notebooks: tables, formulas and small curves; text is escaped.

Nothing has a colour of its own but the current one, so that light and dark pages can show it.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence
from typing import Any

__all__ = ["Raw", "card", "curve", "formula", "table"]

#: Points of a small curve: more cannot be told apart.
_POINTS = 300
_WIDTH, _HEIGHT = 360, 70


class Raw(str):
    """HTML text, which is not escaped again."""

    __slots__ = ()


def _escape(content: object) -> str:
    """Return a text with HTML's signs escaped; ``Raw`` unchanged."""
    return content if isinstance(content, Raw) else html.escape(str(content))


def card(title: str, *parts: str) -> str:
    """Return a title, escaped, above parts that are HTML."""
    return f"<div><strong>{html.escape(title)}</strong>{''.join(parts)}</div>"


def table(rows: Iterable[Sequence[object]], heads: Sequence[object] = ()) -> Raw:
    """Return a table; cells are escaped unless they are ``Raw``."""
    def line(cells: Sequence[object], tag: str) -> str:
        """Return a row of the table in HTML."""
        # A corner without a text is no head of its column: screen readers would announce it.
        tags = [tag if cell else "td" for cell in cells] if tag == "th" else [tag] * len(cells)
        cells_html = "".join(f'<{cell_tag} style="text-align:left">{_escape(cell)}</{cell_tag}>'
                             for cell_tag, cell in zip(tags, cells, strict=True))
        return f"<tr>{cells_html}</tr>"

    top = f"<thead>{line(heads, 'th')}</thead>" if heads else ""
    body = "".join(line(row, "td") for row in rows)
    return Raw(f"<table>{top}<tbody>{body}</tbody></table>")


def formula(latex: str) -> Raw:
    """Return a formula that MathJax sets, which notebooks bring."""
    return Raw(f"\\({html.escape(latex)}\\)")


def curve(x: Any, y: Any, label: str) -> Raw:
    """Return a small curve as SVG, with its extremes; nothing where there is none to draw.

    ``x`` and ``y`` are rows of numbers.
    """
    stride = max(1, len(x) // _POINTS)
    points = [(float(a), float(b)) for a, b in zip(x[::stride], y[::stride], strict=True)
              if math.isfinite(a) and math.isfinite(b)]
    if len(points) < 2:
        return Raw("")
    (x0, x1), (y0, y1) = ((min(values), max(values)) for values in zip(*points, strict=True))
    x_range, y_range = (x1 - x0) or 1.0, (y1 - y0) or 1.0  # 1 for a straight line
    # with a margin of 4 on each side; y points down in SVG
    line = " ".join(f"{4 + (_WIDTH - 8) * (a - x0) / x_range:.1f},"
                    f"{_HEIGHT - 4 - (_HEIGHT - 8) * (b - y0) / y_range:.1f}" for a, b in points)
    caption = html.escape(f"{label}: {y0:.3g} to {y1:.3g}")
    return Raw(f'<figure style="margin:.3em 0"><svg width="{_WIDTH}" height="{_HEIGHT}" role="img" '
               f'aria-label="{caption}"><polyline points="{line}" fill="none" '
               'stroke="currentColor"/>'
               f"</svg><figcaption>{caption}</figcaption></figure>")
