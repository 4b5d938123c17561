"""Figures of Lyapunov exponents and periodic orbits; needs matplotlib."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from .trajectory_plots import check_picture_path, figure_class, save

if TYPE_CHECKING:
    from ..analysis.lyapunov import Lyapunov
    from ..analysis.periodic_orbit import PeriodicOrbit

__all__ = ["draw_exponents", "draw_orbit"]

_ACCENT = "#c0392b"
#: Lines that a legend names, and points of a line.
_NAMED, _POINTS = 12, 5000


def draw_exponents(found: Lyapunov, path: str | os.PathLike[str] | None) -> Any:
    """Draw running exponents, and MEGNO below; see ``Lyapunov.plot``."""
    target = None if path is None else check_picture_path(path)
    figure = figure_class()(figsize=(8, 6.5), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    some = slice(None, None, max(1, len(found.times) // _POINTS))
    t = found.times[some]
    for i, values in enumerate(found.running[some].T):
        label = rf"$\lambda_{{{i + 1}}}$ = {found.exponents[i]:.4g}"
        above.plot(t, values, linewidth=1, label=label)
    above.axhline(0, color="#7f8c8d", linewidth=0.6)
    outer = np.abs(found.running[len(found.times) // 20 :]).max()
    above.set_ylim(-1.3 * outer - 1e-3, 1.3 * outer + 1e-3)
    above.set_ylabel("exponents so far [1/s]")
    if len(found.exponents) <= _NAMED:
        above.legend(fontsize=8, ncols=1 + len(found.exponents) // 4)
    below.plot(t, found.running_megno[some], color=_ACCENT, linewidth=1)
    below.axhline(2, color="#7f8c8d", linewidth=0.6, linestyle="--")
    below.set_ylabel("MEGNO")
    below.set_xlabel("t [s]")
    for axes in (above, below):
        axes.grid(alpha=0.3)
    figure.suptitle(f"{found.name}, Δt = {float(found.dt):g} s, {found.steps:,} steps", fontsize=11)
    if target is not None:
        save(figure, target)
    return figure


def draw_orbit(orbit: PeriodicOrbit, path: str | os.PathLike[str] | None) -> Any:
    """Draw coordinates over a period, and Floquet multipliers; see ``PeriodicOrbit.plot``."""
    target = None if path is None else check_picture_path(path)
    run = orbit.run()
    figure = figure_class()(figsize=(10, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.6, 1))
    for name, values in zip(run.coordinates, run.q.astype(float).T, strict=True):
        left.plot(run.t.astype(float), values, linewidth=1.2, label=name)
    left.set_xlabel("t [s]")
    left.set_title(f"coordinates, period {float(orbit.period):.6g} s", fontsize=10)
    left.grid(alpha=0.3)
    if len(run.coordinates) <= _NAMED:
        left.legend(fontsize=8, ncols=1 + len(run.coordinates) // 8)
    turn = np.linspace(0, 2 * np.pi, 200)
    right.plot(np.cos(turn), np.sin(turn), color="#7f8c8d", linewidth=0.8)
    right.scatter(orbit.multipliers.real, orbit.multipliers.imag, color=_ACCENT, s=24, zorder=3)
    right.set_aspect("equal", adjustable="datalim")
    right.set_title("Floquet multipliers", fontsize=10)
    right.grid(alpha=0.3)
    figure.suptitle(run.manifest.name, fontsize=11)
    if target is not None:
        save(figure, target)
    return figure
