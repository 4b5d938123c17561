"""Figures of Lyapunov exponents and periodic orbits; needs matplotlib."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import count_text
from .trajectory_plots import check_picture_path, figure_class, save

if TYPE_CHECKING:
    from ..analysis.lyapunov import Lyapunov
    from ..analysis.periodic_orbit import PeriodicOrbit

__all__ = ["draw_exponents", "draw_orbit"]

_ACCENT = "#c0392b"
#: Lines that a legend names, and points of a line.
_NAMED, _POINTS = 12, 5000


def draw_exponents(lyapunov: Lyapunov, path: str | os.PathLike[str] | None) -> Any:
    """Draw running exponents, and MEGNO below; see ``Lyapunov.plot``."""
    target = None if path is None else check_picture_path(path)
    figure = figure_class()(figsize=(8, 6.5), layout="constrained")
    exponent_axes, megno_axes = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    shown_rows = slice(None, None, max(1, len(lyapunov.times) // _POINTS))
    t = lyapunov.times[shown_rows]
    for i, exponent in enumerate(lyapunov.running[shown_rows].T):
        label = rf"$\lambda_{{{i + 1}}}$ = {lyapunov.exponents[i]:.4g}"
        exponent_axes.plot(t, exponent, linewidth=1, label=label)
    exponent_axes.axhline(0, color="#7f8c8d", linewidth=0.6)
    # the first means are far off, and must not set the scale
    largest = np.abs(lyapunov.running[len(lyapunov.times) // 20 :]).max()
    exponent_axes.set_ylim(-1.3 * largest - 1e-3, 1.3 * largest + 1e-3)
    exponent_axes.set_ylabel("exponents so far [1/s]")
    if len(lyapunov.exponents) <= _NAMED:
        exponent_axes.legend(fontsize=8, ncols=1 + len(lyapunov.exponents) // 4)
    megno_axes.plot(t, lyapunov.running_megno[shown_rows], color=_ACCENT, linewidth=1)
    megno_axes.axhline(2, color="#7f8c8d", linewidth=0.6, linestyle="--")
    megno_axes.set_ylabel("MEGNO")
    megno_axes.set_xlabel("t [s]")
    for axes in (exponent_axes, megno_axes):
        axes.grid(alpha=0.3)
    figure.suptitle(f"{lyapunov.name}, Δt = {float(lyapunov.dt):g} s, "
                    f"{count_text(lyapunov.steps, 'step')}",
                    fontsize=11)
    if target is not None:
        save(figure, target)
    return figure


def draw_orbit(orbit: PeriodicOrbit, path: str | os.PathLike[str] | None) -> Any:
    """Draw coordinates over a period, and Floquet multipliers; see ``PeriodicOrbit.plot``."""
    target = None if path is None else check_picture_path(path)
    run = orbit.run()
    figure = figure_class()(figsize=(10, 4.5), layout="constrained")
    coordinate_axes, multiplier_axes = figure.subplots(1, 2, width_ratios=(1.6, 1))
    for name, coordinate in zip(run.coordinates, run.q.astype(float).T, strict=True):
        coordinate_axes.plot(run.t.astype(float), coordinate, linewidth=1.2, label=name)
    coordinate_axes.set_xlabel("t [s]")
    coordinate_axes.set_title(f"coordinates, period {float(orbit.period):.6g} s", fontsize=10)
    coordinate_axes.grid(alpha=0.3)
    if len(run.coordinates) <= _NAMED:
        coordinate_axes.legend(fontsize=8, ncols=1 + len(run.coordinates) // 8)
    # the unit circle, which the multipliers of a stable orbit lie on
    angle = np.linspace(0, 2 * np.pi, 200)
    multiplier_axes.plot(np.cos(angle), np.sin(angle), color="#7f8c8d", linewidth=0.8)
    multiplier_axes.scatter(orbit.multipliers.real, orbit.multipliers.imag, color=_ACCENT, s=24,
                            zorder=3)
    multiplier_axes.set_aspect("equal", adjustable="datalim")
    multiplier_axes.set_title("Floquet multipliers", fontsize=10)
    multiplier_axes.grid(alpha=0.3)
    figure.suptitle(run.manifest.name, fontsize=11)
    if target is not None:
        save(figure, target)
    return figure
