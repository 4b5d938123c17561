"""A trajectory as a film: bodies, traces and the energy error, drawn by matplotlib."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import as_path, choose, shown
from ...core.errors import InputError, MissingDependencyError
from ...core.file_formats import ending_of, format_of, result_file
from ...core.inertia import real_array
from .scene import SHAPES, Scene, ScenePart, ShapeName, scene_of
from .trajectory_plots import figure_class, thin

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory

__all__ = ["animate", "check_film"]

Array = NDArray[Any]

_MOST_FRAMES = 2000
#: Rings and slices of an ellipsoid.
_RINGS, _SLICES = 8, 12
_LIGHTER = 0.45


def animate(
    trajectory: Trajectory, path: str | os.PathLike[str], *, seconds: float = 6.0, fps: int = 20,
    shape: ShapeName = "box",
) -> Path:
    """Write a film of the whole run, so many seconds long, and return its path.

    Parameters
    ----------
    trajectory : Trajectory
        Of at least one rigid body.
    path : path
        A name that ends in .gif, or in .mp4, for which the program ffmpeg is needed.
    seconds : float
        How long the film is.
    fps : int
        Pictures a second, each a stored state; where fewer are stored it has fewer pictures.
    shape : {"box", "ellipsoid"}
        Of the bodies.

    Raises
    ------
    InputError
        Where there is no rigid body; for another ending or shape, and for a film of fewer than two
        pictures or of more than 2000.
    MissingDependencyError
        Without matplotlib, or ffmpeg.
    GyrosparkError
        If the file cannot be written.
    """
    target = check_film(path)
    choose("shape", shape, SHAPES)
    frames, writer = _frames(seconds, fps), _writer(target, fps)
    scene = scene_of(trajectory, frames)
    figure = figure_class()(figsize=(6, 5.6), layout="constrained")
    stage = _Stage(figure, scene, shape)
    stage.draw_energy(trajectory)
    with result_file(target, "The film") as part, writer.saving(figure, part, dpi=80):
        for frame in range(len(scene.t)):
            stage.show(frame)
            writer.grab_frame()
    return target


def check_film(path: str | os.PathLike[str]) -> Path:
    """Return the path if a film can be written as such a file, and drawn at all.

    Raises
    ------
    InputError
        For another ending than .gif or .mp4.
    MissingDependencyError
        Without matplotlib, or ffmpeg.
    """
    target = as_path("path", path, "flip.gif")
    format_of(target, "A film", "film")
    _writer(target, fps=20)
    return target


def _frames(seconds: Any, fps: Any) -> int:
    """Return how many pictures a film has."""
    given = [real_array(value) for value in (seconds, fps)]
    known = [float(value) for value in given if value is not None and value.ndim == 0 < value]
    count = known[0] * known[1] if len(known) == 2 else np.nan
    if not 2 <= count <= _MOST_FRAMES:
        raise InputError(f"A film of seconds = {shown(seconds)} and fps = {shown(fps)} is none; "
                         f"give two numbers with a product from 2 to {_MOST_FRAMES}.")
    return round(count)


def _writer(target: Path, fps: int) -> Any:
    """Return matplotlib's writer of a film."""
    figure_class()  # or says that matplotlib is missing
    from matplotlib.animation import FFMpegWriter, PillowWriter

    if ending_of(target) == ".gif":
        return PillowWriter(fps=fps)
    if not FFMpegWriter.isAvailable():
        raise MissingDependencyError("Films that end in .mp4 need the program ffmpeg; install it, "
                                     "or write a .gif.")
    return FFMpegWriter(fps=fps)


class _Stage:
    """The axes and artists of a film, which are updated for each frame."""

    def __init__(self, figure: Any, scene: Scene, shape: ShapeName) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        FigureCanvasAgg(figure)
        grid = figure.add_gridspec(2, 1, height_ratios=(5, 1))
        self.scene, self.axes = scene, figure.add_subplot(grid[0], projection="3d")
        self.energy = figure.add_subplot(grid[1])
        self.now = self.energy.axvline(scene.t[0], color="#c0392b", linewidth=1)
        self.turn = _upright(scene.up)
        self.bodies, self.traces, reach = [], [], []
        for k, part in enumerate(scene.parts):
            faces = _faces(part, shape)
            points = part.at(faces.reshape(-1, 3)).reshape(len(scene.t), -1, 4, 3) @ self.turn.T
            colours = _colours(f"C{k % 10}", shape, len(faces))
            solid = Poly3DCollection(points[0], facecolors=colours, edgecolors="#00000030",
                                     linewidths=0.4)
            self.axes.add_collection3d(solid)
            trace = part.at(part.tip)[:, 0] @ self.turn.T
            (line,) = self.axes.plot(*trace[:1].T, color=f"C{k % 10}", linewidth=1.2,
                                     label=part.name)
            self.bodies.append((solid, points))
            self.traces.append((line, trace))
            reach += [points.reshape(-1, 3), trace]
        self._frame_around(np.concatenate(reach))
        figure.suptitle(scene.title, fontsize=11)

    def draw_energy(self, trajectory: Trajectory) -> None:
        """Draw the energy error of all states, more than a film has."""
        some = thin(trajectory)
        self.energy.plot(trajectory.t[some].astype(float),
                         trajectory.energy_error()[some].astype(float), linewidth=0.8)
        self.energy.set_title("energy error H − H₀ − W", fontsize=9)
        self.energy.set_xlabel("t [s]", fontsize=9)
        self.energy.grid(alpha=0.3)

    def _frame_around(self, points: Array) -> None:
        low, high = points.min(axis=0), points.max(axis=0)
        half = max((high - low).max() / 2, 1e-12)
        for set_limits, middle in zip((self.axes.set_xlim, self.axes.set_ylim, self.axes.set_zlim),
                                      (low + high) / 2, strict=True):
            set_limits(middle - half, middle + half)
        self.axes.set_box_aspect((1, 1, 1), zoom=1.45)
        self.axes.set_axis_off()
        # A motion in a plane is seen from before it.
        flat = int(np.argmin(high - low)) if (high - low).min() < 0.2 * 2 * half else -1
        self.axes.view_init(elev=18, azim={0: 15, 1: -75}.get(flat, -55))
        if len(self.scene.parts) > 1 and len(self.scene.parts) <= 10:
            self.axes.legend(fontsize=8, loc="upper right")

    def show(self, frame: int) -> None:
        """Bring bodies, traces and the mark in the energy to a frame."""
        for solid, points in self.bodies:
            solid.set_verts(points[frame])
        for line, trace in self.traces:
            line.set_data_3d(*trace[: frame + 1].T)
        self.now.set_xdata([self.scene.t[frame]] * 2)


def _upright(up: Array) -> Array:
    """Return the rotation after which ``up`` is the third axis."""
    first = np.array([1.0, 0, 0]) if abs(up[0]) < 0.9 else np.array([0, 1.0, 0])
    first = first - (first @ up) * up
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(up, first), up])


def _faces(part: ScenePart, shape: ShapeName) -> Array:
    """Return the faces of a body in body axes, shape (number, 4, 3)."""
    if shape == "box":
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        unit = np.stack([np.insert(corners, k, side, axis=1) for k in range(3)
                         for side in (-1, 1)]).astype(float)
    else:
        theta, phi = np.linspace(0, np.pi, _RINGS + 1), np.linspace(0, 2 * np.pi, _SLICES + 1)
        ball = np.stack([np.outer(np.sin(theta), np.cos(phi)), np.outer(np.sin(theta), np.sin(phi)),
                         np.outer(np.cos(theta), np.ones_like(phi))], axis=-1)
        unit = np.stack([ball[:-1, :-1], ball[1:, :-1], ball[1:, 1:], ball[:-1, 1:]],
                        axis=2).reshape(-1, 4, 3)
    faces: Array = part.centre + (unit * part.sizes[shape]) @ part.axes.T
    return faces


def _colours(colour: str, shape: ShapeName, faces: int) -> Array:
    """Return a colour for each face: some are lighter, so that turning is seen."""
    from matplotlib.colors import to_rgb

    base = np.array(to_rgb(colour))
    numbers = np.arange(faces)
    lighter = numbers == 1 if shape == "box" else numbers % _SLICES * 4 // _SLICES % 2 == 0
    shade = np.array([0.75, 1.0, 0.85, 0.9, 0.8, 0.95])[numbers % 6] if shape == "box" else 1.0
    mixed = np.where(lighter[:, None], base + _LIGHTER * (1 - base), base)
    found: Array = mixed * np.broadcast_to(shade, faces)[:, None]
    return found
