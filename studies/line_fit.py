"""Straight lines through measured points, with what they leave unexplained."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

__all__ = ["FittedLine", "crossing", "fit_line", "fit_slope"]


@dataclass(frozen=True)
class FittedLine:
    """y ≈ slope · x + offset, with R² = 1 − Σ(y − fit)²/Σ(y − ȳ)²."""

    slope: float
    offset: float
    r_squared: float

    @property
    def quality(self) -> str:
        """R² to six places, rounded down, so that 1 means 1."""
        return f"{math.floor(self.r_squared * 1e6) / 1e6:.6f}"

    def at(self, x: float) -> float:
        """Return the line's value."""
        return self.slope * x + self.offset


def fit_line(x: Sequence[float], y: Sequence[float]) -> FittedLine:
    """Return the line that minimises Σ(y − slope · x − offset)².

    slope = Σ(x − x̄)(y − ȳ) / Σ(x − x̄)². For constant y, which the line meets exactly, R² is 1.
    """
    xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    slope = float((xs - xs.mean()) @ (ys - ys.mean()) / ((xs - xs.mean()) @ (xs - xs.mean())))
    offset = float(ys.mean() - slope * xs.mean())
    residuals = ys - slope * xs - offset
    spread = float((ys - ys.mean()) @ (ys - ys.mean()))
    return FittedLine(slope, offset, 1 - float(residuals @ residuals) / spread if spread else 1.0)


def fit_slope(
    dt: Sequence[float], errors: Sequence[float], floors: Sequence[float]
) -> tuple[float, int]:
    """Return the slope of log error over log Δt, the observed order, and the number of its points.

    Points less than ten times above their round-off floor are dropped. The slope is NaN where
    fewer than three remain, since any two points lie on a line.
    """
    resolved = [(h, e) for h, e, floor in zip(dt, errors, floors, strict=True) if e > 10 * floor]
    if len(resolved) < 3:
        return float("nan"), len(resolved)
    hs, es = zip(*resolved, strict=True)
    return fit_line(np.log(hs).tolist(), np.log(es).tolist()).slope, len(resolved)


def crossing(x: Sequence[float], y: Sequence[float], floor: float = 0.0) -> list[float]:
    """Return the zeros of the polygon through the points with |y| > ``floor``.

    On a segment with y₀y₁ < 0 the zero is x₀ − y₀ (x₁ − x₀)/(y₁ − y₀).
    """
    points = [(a, b) for a, b in zip(x, y, strict=True) if abs(b) > floor]
    return [x0 - y0 * (x1 - x0) / (y1 - y0)
            for (x0, y0), (x1, y1) in pairwise(points) if y0 * y1 < 0]
