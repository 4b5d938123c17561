"""Figures of trajectories, Poincaré sections and ensembles; needs matplotlib."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import choose, count_text
from ...core.errors import MissingDependencyError
from ...core.extras import install
from ...core.file_formats import checked_path, ending_of, endings, result_file
from ...core.real_types import REALS
from ..compilation.body_columns import bodies_of

if TYPE_CHECKING:
    from ..events.poincare_section import Section
    from ..results.trajectory import Trajectory
    from ..steppers.ensemble import Ensemble

__all__ = ["check_picture_path", "draw_ensemble", "draw_section", "draw_trajectory", "draw_values",
           "figure_class", "names_and_path", "save", "thin"]

_INK = "#1f4e79"
_ACCENT = "#c0392b"
_POINTS = 20_000  # more cannot be told apart in a picture
_FEW = 300  # states that a line joins: between more of them it would be noise
_NAMED = 16  # lines that a legend names


def draw_trajectory(trajectory: Trajectory, path: str | os.PathLike[str] | None = None) -> Any:
    """Draw the axis trace on the sphere, the energy error and, if any, the constraint errors.

    With several bodies, the positions of their centres of mass replace the sphere; without bodies,
    the coordinates do.

    Parameters
    ----------
    trajectory : Trajectory
        At least one state.
    path : path, optional
        Where to write the picture: .png, .svg or .pdf.

    Returns
    -------
    matplotlib.figure.Figure
        Jupyter shows it where it is the last value of a cell; ``.savefig`` writes it.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    target = None if path is None else check_picture_path(path)
    output_panels = trajectory.panels()
    # A system without constraints has no error of them to look at.
    system = trajectory.manifest.system
    is_constrained = bool(system.constraints or system.velocity_constraint_names)
    error_panels = [_energy, _constraints] if is_constrained else [_energy]
    row_count = max(2, len(error_panels) + len(output_panels))
    figure = figure_class()(figsize=(11, 2.3 * row_count), layout="constrained")
    grid = figure.add_gridspec(row_count, 2, width_ratios=(1, 1.4))
    if len(trajectory.bodies) == 1:
        _sphere(figure.add_subplot(grid[:, 0], projection="3d"), trajectory)
    elif all(columns.centre
             for columns in bodies_of(trajectory.manifest).values()) and trajectory.bodies:
        _positions(figure, grid[:, 0], trajectory)
    else:
        _coordinates(figure.add_subplot(grid[:, 0]), trajectory)
    panel_cells = [grid[row, 1] for row in range(row_count)]
    # a single panel takes both rows
    if len(error_panels) + len(output_panels) < row_count:
        panel_cells = [grid[:, 1]]
    panels: list[Callable[..., None]] = [*error_panels, *(
        partial(_output, title=title, output=output) for title, output in output_panels.items())]
    for panel_cell, panel in zip(panel_cells, panels, strict=True):
        panel(figure.add_subplot(panel_cell), trajectory)
    figure.suptitle(f"{trajectory.manifest.name}, Δt = {float(trajectory.dt):g} s, "
                    f"{count_text(trajectory.report.steps, 'step')}", fontsize=11)
    if target is not None:
        save(figure, target)
    return figure


def check_picture_path(path: str | os.PathLike[str]) -> Path:
    """Return the path if a picture can be written as such a file, and drawn at all.

    Raises
    ------
    InputError
        For another ending than .png, .svg or .pdf.
    MissingDependencyError
        Without matplotlib.
    """
    target = checked_path(path, "top.png", "A picture", "picture")
    figure_class()
    return target


def save(figure: Any, target: Path) -> None:
    """Write a picture.

    Raises
    ------
    GyrosparkError
        If it cannot be written.
    """
    with result_file(target, "The picture") as partial_file:
        figure.savefig(partial_file, dpi=150)


def figure_class() -> Any:
    """Return the class of figures, which need no display.

    Raises
    ------
    MissingDependencyError
        Without matplotlib.
    """
    try:
        from .figure import Picture
    except ImportError as error:
        raise MissingDependencyError(f"Pictures need matplotlib; {install('plot')} brings "
                                     "it.") from error
    return Picture


def thin(trajectory: Trajectory) -> slice:
    """Return the slice of states that a picture shows, no more than its resolution."""
    return slice(None, None, max(1, len(trajectory) // _POINTS))


def _sphere(axes: Any, trajectory: Trajectory) -> None:
    """Draw the trace of the body's third axis."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 37), np.linspace(0, np.pi, 19))
    axes.plot_wireframe(np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v),
                        color="#b8c4d0", linewidth=0.4)
    x, y, z = trajectory.axis()[thin(trajectory)].T
    axes.plot(x, y, z, color=_INK, linewidth=1.2)
    axes.scatter(x[:1], y[:1], z[:1], color=_ACCENT, s=18, label="start")
    for direction, name in zip(np.eye(3), "xyz", strict=True):
        axes.plot(*np.outer(direction, (0, 1.25)), color="#7f8c8d", linewidth=0.8)
        axes.text(*(1.35 * direction), name, color="#7f8c8d", ha="center", va="center")
    axes.set_box_aspect((1, 1, 1), zoom=1.5)
    axes.set_axis_off()
    axes.set_title("third axis of the body in space", fontsize=10)
    axes.legend(loc="lower left", fontsize=8)


def _coordinates(axes: Any, trajectory: Trajectory) -> None:
    """Draw each coordinate against time."""
    shown_states = thin(trajectory)
    t = trajectory.t[shown_states].astype(float)
    for name, coordinate in zip(trajectory.coordinates, trajectory.q[shown_states].astype(float).T,
                                strict=True):
        axes.plot(t, coordinate, linewidth=1, label=name)
    _mark_impacts(axes, trajectory)
    axes.set_xlabel("t [s]")
    axes.set_title("coordinates", fontsize=10)
    axes.grid(alpha=0.3)
    if len(trajectory.coordinates) <= _NAMED:
        axes.legend(fontsize=8, ncols=1 + len(trajectory.coordinates) // 8)


def _positions(figure: Any, grid_cell: Any, trajectory: Trajectory) -> None:
    """Draw the centres of mass: one panel per axis of space, one line per body."""
    shown_states = thin(trajectory)
    t = trajectory.t[shown_states].astype(float)
    positions = {name: trajectory.body(name).position()[shown_states] for name in trajectory.bodies}
    panels = grid_cell.subgridspec(3, 1).subplots(sharex=True)
    for k, axes in enumerate(panels):
        for name, position in positions.items():
            axes.plot(t, position[:, k], linewidth=1, label=name)
        axes.set_ylabel(f"{'xyz'[k]} [m]")
        axes.grid(alpha=0.3)
    panels[0].set_title("centres of mass", fontsize=10)
    if len(positions) <= _NAMED:
        panels[0].legend(fontsize=8, loc="upper right", ncols=min(len(positions), 4))
    panels[2].set_xlabel("t [s]")
    _mark_impacts(panels[2], trajectory)


def _mark_impacts(axes: Any, trajectory: Trajectory) -> None:
    """Draw a tick at the time of each impact."""
    for impacts in trajectory.impacts.values():
        t = impacts.t[:: max(1, len(impacts) // _POINTS)].astype(float)
        # with this transform y is a share of the height of the axes, from below
        axes.plot(t, np.full(len(t), 0.03), "|", color=_ACCENT, markersize=7,
                  transform=axes.get_xaxis_transform())


def _energy(axes: Any, trajectory: Trajectory) -> None:
    """Draw the energy error against time."""
    shown_states = thin(trajectory)
    t = trajectory.t[shown_states].astype(float)
    error = trajectory.energy_error()[shown_states].astype(float)
    axes.plot(t, error, color=_INK, linewidth=0.8)
    _mark_impacts(axes, trajectory)
    axes.ticklabel_format(axis="y", style="sci", scilimits=(0, 0))
    work_term = " − W" if trajectory.manifest.system.forces else ""
    axes.set_title(f"energy error H − H₀{work_term}", fontsize=10)
    axes.grid(alpha=0.3)


def _output(axes: Any, trajectory: Trajectory, title: str, output: Any) -> None:
    """Draw an output against time, a line for each of its numbers.

    Outputs of steps have one row fewer than there are states.
    """
    shown_states, t = thin(trajectory), trajectory.t[-len(output) :]
    components = output.reshape(len(t), -1)[shown_states].astype(float)
    axes.plot(t[shown_states].astype(float), components, linewidth=0.8)
    axes.set_xlabel("t [s]")
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)


def _constraints(axes: Any, trajectory: Trajectory) -> None:
    """Draw the constraint errors; exact zeros are drawn at the bottom."""
    shown_states = thin(trajectory)
    t = trajectory.t[shown_states].astype(float)
    # a logarithmic axis has no 0
    floor = 1e-36 if REALS[trajectory.manifest.real].in_mpmath else 1e-18
    for errors, name, colour in zip(trajectory.constraint_errors(),
                                    ("|g(q)|", "momentum constraint"), (_INK, _ACCENT),
                                    strict=True):
        sizes = np.maximum(errors[shown_states].astype(float), floor)
        axes.semilogy(t, sizes, ".-" if len(t) <= _FEW else ".", markersize=2, linewidth=0.6,
                      color=colour, label=name)
    axes.set_xlabel("t [s]")
    axes.set_title("constraint errors", fontsize=10)
    axes.legend(fontsize=8, ncols=2, loc="upper right")
    axes.margins(y=0.25)
    axes.grid(alpha=0.3)


#: Points beyond which each is drawn as one dot.
_MANY = 20_000


def draw_section(section: Section, x: str, y: str, path: str | os.PathLike[str] | None) -> Any:
    """Draw the points of a section by two of their values; see ``Section.plot``."""
    target = None if path is None else check_picture_path(path)
    x_values, y_values = section.values(x).astype(float), section.values(y).astype(float)
    figure = figure_class()(figsize=(7, 6), layout="constrained")
    axes = figure.add_subplot()
    # many points are drawn as pixels: a vector file of them would be large
    is_dense = len(section) > _MANY
    axes.scatter(x_values, y_values, c=section.trajectory, s=0.2 if is_dense else 2, cmap="viridis",
                 linewidths=0, rasterized=is_dense)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    direction = {-1: ", falling", 0: "", 1: ", rising"}[section.event.direction]
    axes.set_title(f"{section.event.quantity} = {float(section.event.level):g}{direction}: "
                   f"{count_text(len(section), 'point')}", fontsize=11)
    if target is not None:
        save(figure, target)
    return figure


#: Trajectories that are drawn, spread over all of them; panels where no values are named.
_LINES, _PANELS = 200, 6


def names_and_path(
    names: Sequence[Any], path: str | os.PathLike[str] | None
) -> tuple[list[str], str | os.PathLike[str] | None]:
    """Return the names of values and the path of a picture.

    Without ``path``, the last of ``names`` is the path if it ends in .png, .svg or .pdf.
    """
    value_names = list(names)
    if path is None and value_names and (isinstance(value_names[-1], os.PathLike) or (
            isinstance(value_names[-1], str)
            and ending_of(Path(value_names[-1])) in endings("picture"))):
        path = value_names.pop()
    return value_names, path


def draw_ensemble(
    ensemble: Ensemble, names: Sequence[str], path: str | os.PathLike[str] | None
) -> Any:
    """Draw values against time, a line for each trajectory; see ``Ensemble.plot``."""
    first_member, count = ensemble.members[0], len(ensemble)
    # spread evenly over all trajectories
    drawn_indices = np.unique(np.linspace(0, count - 1, min(count, _LINES)).astype(int))
    selection_note = f", {len(drawn_indices)} of them drawn" if len(drawn_indices) < count else ""
    default = [*(first_member.quantities or first_member.coordinates)[:_PANELS], "energy_error"]
    return draw_values([ensemble.members[i] for i in drawn_indices], names or default, path,
                       f"{first_member.manifest.name}: "
                       f"{count_text(count, 'trajectory')}{selection_note}, "
                       f"{len(ensemble.failures):,} failed")


def draw_values(
    runs: Sequence[Trajectory], names: Sequence[str], path: str | os.PathLike[str] | None,
    title: str = "",
) -> Any:
    """Draw values of runs against time, a panel for each name and a line for each run."""
    target = None if path is None else check_picture_path(path)
    available = _plottable_values(runs[0])
    value_names = [choose("value of a run", name, available) for name in names]
    figure = figure_class()(figsize=(9, 2 + 1.8 * (len(value_names) - 1)), layout="constrained")
    panels = np.atleast_1d(figure.subplots(len(value_names), 1, sharex=True))
    for i, run in enumerate(runs):
        shown_states = thin(run)
        colour = (0.27 + 0.5 * i / len(runs), 0.2 + 0.5 * (1 - i / len(runs)), 0.5)
        run_values = _plottable_values(run)
        for axes, name in zip(panels, value_names, strict=True):
            # iterations belong to steps: one number fewer than states
            series = run_values[name]()
            axes.plot(run.t[len(run) - len(series):][shown_states].astype(float),
                      series[shown_states].astype(float), color=colour, linewidth=0.7)
            _mark_impacts(axes, run)
    work_term = " − W" if runs[0].manifest.system.forces else ""
    for axes, name in zip(panels, value_names, strict=True):
        axes.set_title(f"energy error H − H₀{work_term}" if name == "energy_error" else name,
                       fontsize=10)
        axes.grid(alpha=0.3)
    panels[-1].set_xlabel("t [s]")
    figure.suptitle(title or f"{runs[0].manifest.name}, Δt = {float(runs[0].dt):g} s", fontsize=11)
    if target is not None:
        save(figure, target)
    return figure


def _plottable_values(run: Trajectory) -> dict[str, Callable[[], NDArray[Any]]]:
    """Return name → function without arguments, which evaluates a quantity at each state.

    Names of the system replace names such as "energy".
    """
    functions: dict[str, Callable[[], NDArray[Any]]] = {
        "energy": run.energy, "energy_error": run.energy_error, "work": lambda: run.work,
        "iterations": lambda: run.iterations, "g_error": lambda: run.g_errors,
        "f_error": lambda: run.f_errors}
    for names, attribute in ((run.momenta, "p"), (run.coordinates, "q")):
        functions |= {name: partial(_column, run, attribute, i) for i, name in enumerate(names)}
    return functions | {name: partial(run.quantity, name) for name in run.quantities}


def _column(run: Trajectory, attribute: str, i: int) -> NDArray[Any]:
    """Return coordinate or momentum i of all states; ``attribute`` is "q" or "p"."""
    column: NDArray[Any] = getattr(run, attribute)[:, i]
    return column
