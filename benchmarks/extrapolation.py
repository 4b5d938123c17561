"""Equations of motion by the midpoint rule, extrapolated (Gragg): numbers of any kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

__all__ = ["extrapolated"]

Rates = Callable[[Any, Sequence[Any]], list[Any]]


def extrapolated(rates: Rates, start: Sequence[Any], dt: Any, steps: int,
                 columns: int) -> list[Any]:
    """Return the state after steps of order 2·columns; the rates do not ask for the time."""
    state = list(start)
    for _ in range(steps):
        row: list[list[Any]] = []
        for k in range(1, columns + 1):
            row = _next_row(row, _midpoint(rates, state, dt, 2 * k), k)
        state = row[-1]
    return state


def _midpoint(rates: Rates, state: Sequence[Any], dt: Any, count: int) -> list[Any]:
    """Return the state after ``count`` parts of dt; its error is a series in 1/count²."""
    h = dt / count
    previous, current = state, [
        x + h * rate for x, rate in zip(state, rates(0, state), strict=True)]
    for _ in range(count - 1):
        previous, current = current, [
            x + 2 * h * rate for x, rate in zip(previous, rates(0, current), strict=True)]
    return current


def _next_row(above: Sequence[list[Any]], first: list[Any], k: int) -> list[list[Any]]:
    """Return row k of the tableau of Aitken and Neville, in (1/count)² with count = 2k."""
    row = [first]
    for j, entry in enumerate(above, 1):
        share = (k - j) ** 2, k**2 - (k - j) ** 2
        row.append([x + (x - y) * share[0] / share[1]
                    for x, y in zip(row[-1], entry, strict=True)])
    return row
