"""Pictures of one body, of one joint, and of a coordinate against its momentum."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import proposal, shown
from ...core.errors import InputError
from .trajectory_plots import check_picture_path, figure_class, save, thin

if TYPE_CHECKING:
    from ..results.body_motion import BodyMotion
    from ..results.joint_motion import JointMotion
    from ..results.trajectory import Trajectory

__all__ = ["draw_body", "draw_joint", "draw_phase"]

Array = NDArray[Any]
#: Title of a panel, names of its lines, and a column for each.
Panel = tuple[str, Sequence[str], Array]
#: Phase portraits of a picture that nobody chose them for.
_PORTRAITS = 6


def draw_body(body: BodyMotion, run: Trajectory, path: str | os.PathLike[str] | None,
              euler: str, degrees: bool) -> Any:
    """Draw Euler angles, angular velocity, position and momentum of a body against time."""
    unit = "°" if degrees else "rad"
    # without jumps by full turns
    angles = np.unwrap(body.euler(euler, degrees=degrees), axis=0,
                       period=360 if degrees else 2 * np.pi)
    # A panel for each: the angle of spin grows by turns, beside which nutation is a straight line.
    panels: list[Panel] = [
        *((f"{ordinal} Euler angle of {euler} [{unit}]", [f"about {axis}"], angle[:, None])
          for ordinal, axis, angle in zip(("first", "second", "third"), euler, angles.T,
                                          strict=True)),
        ("angular velocity, body axes [rad/s]", ["Ω₁", "Ω₂", "Ω₃"], body.angular_velocity()),
        ("angular momentum, space axes [kg m²/s]", ["x", "y", "z"], body.angular_momentum())]
    if body.moves:
        panels += [("centre of mass [m]", ["x", "y", "z"], body.position()),
                   ("momentum [kg m/s]", ["x", "y", "z"], body.momentum())]
    return _panels(f"{body.name} of {run.manifest.name}", run, panels, path)


def draw_joint(joint: JointMotion, run: Trajectory, path: str | os.PathLike[str] | None) -> Any:
    """Draw the angle of a joint, where it has one, and force and torque in it against time."""
    panels: list[Panel] = []
    if joint.has_axis:
        panels += [("angle [°]", ["angle"], joint.angle(degrees=True)[:, None])]
    b = joint.bodies[1] or "the ground"
    panels += [(f"force on {b} [N]", ["x", "y", "z"], joint.force()),
               (f"torque on {b} about the joint [N m]", ["x", "y", "z"], joint.torque())]
    return _panels(f"{joint.name} of {run.manifest.name}", run, panels, path)


def draw_phase(run: Trajectory, names: Sequence[str], path: str | os.PathLike[str] | None) -> Any:
    """Draw phase portraits: each coordinate against the momentum that belongs to it.

    Raises
    ------
    InputError
        For a name that no coordinate has.
    """
    target = None if path is None else check_picture_path(path)
    for name in names:
        if name not in run.coordinates:
            raise InputError(f"System {run.manifest.system.name!r} has no coordinate "
                             f"{shown(name)}; it has {', '.join(run.coordinates)}"
                             f"{proposal(name, run.coordinates)}.")
    # by default coordinates that move: one that stays is a point
    moving = [name for name, q in zip(run.coordinates, run.q.T, strict=True) if (q != q[0]).any()]
    portrait_names = names or (moving or run.coordinates)[:_PORTRAITS]
    column_count = min(len(portrait_names), 3)
    row_count = math.ceil(len(portrait_names) / column_count)
    figure = figure_class()(figsize=(3.6 * column_count, 3.2 * row_count), layout="constrained")
    shown_states = thin(run)
    for k, name in enumerate(portrait_names, start=1):
        axes = figure.add_subplot(row_count, column_count, k)
        column = run.coordinates.index(name)
        q, p = (states[shown_states, column].astype(float) for states in (run.q, run.p))
        axes.plot(q, p, linewidth=0.8)
        axes.plot(q[:1], p[:1], "o", markersize=4, color="#c0392b", label="start")
        axes.set_xlabel(name)
        axes.set_ylabel(run.momenta[column])
        axes.grid(alpha=0.3)
        if k == 1:
            axes.legend(fontsize=8)
    figure.suptitle(run.manifest.name, fontsize=11)
    if target is not None:
        save(figure, target)
    return figure


def _panels(title: str, run: Trajectory, panels: Sequence[Panel],
            path: str | os.PathLike[str] | None) -> Any:
    """Draw panels above each other, a line for each column.

    A panel is its title, the names of its columns and their numbers, (states, columns); ``title``
    is above all, and ``path`` is where the picture is written.
    """
    target = None if path is None else check_picture_path(path)
    figure = figure_class()(figsize=(8, 0.6 + 1.9 * len(panels)), layout="constrained")
    shown_states = thin(run)
    t, first_axes = run.t[shown_states].astype(float), None
    for k, (panel_title, names, columns) in enumerate(panels, start=1):
        # panels share the time axis of the first one
        axes = figure.add_subplot(len(panels), 1, k, sharex=first_axes)
        first_axes = first_axes or axes
        for name, column in zip(names, columns[shown_states].astype(float).T, strict=True):
            axes.plot(t, column, linewidth=1, label=name)
        axes.set_title(panel_title, fontsize=10)
        axes.legend(fontsize=8, loc="upper right", ncols=len(names))
        axes.grid(alpha=0.3)
        axes.label_outer()
    axes.set_xlabel("t [s]")
    figure.suptitle(title, fontsize=11)
    if target is not None:
        save(figure, target)
    return figure
