"""Figure for Jupyter; the only module whose import loads matplotlib."""

from __future__ import annotations

import io
from typing import Any

from matplotlib.figure import Figure

__all__ = ["Picture"]

#: Dots of the shown picture for each dot of its size on a page: sharp on dense screens.
_DENSITY = 2
#: Dots an inch on a page.
_DPI = 72


class Picture(Figure):
    """A matplotlib figure that needs no display and no ``pyplot``.

    Jupyter shows a figure by itself only once ``pyplot`` is imported; this one always, and once:
    ``pyplot``, which shows its figures at the end of a cell, does not know it.
    """

    def _repr_png_(self) -> tuple[bytes, dict[str, Any]]:
        """Return the PNG for Jupyter, and its size on the page in pixels."""
        data = io.BytesIO()
        self.savefig(data, format="png", dpi=_DENSITY * _DPI)
        width, height = (round(_DPI * inches) for inches in self.get_size_inches())
        return data.getvalue(), {"width": width, "height": height}
