"""A trajectory as a film: bodies and traces as in pictures, and the energy error."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import choose, shown
from ...core.errors import InputError, MissingDependencyError
from ...core.file_formats import checked_path, ending_of, result_file
from ...core.inertia import real_array
from ...core.shapes import Shape, ShapeKind
from .html_view import with_visuals
from .meshes import IndexedMesh
from .picture import SceneDrawing
from .scene import DRAWN, DrawnName, Scene, ShapeName, scene_of
from .solids import COLOURS
from .trajectory_plots import figure_class, thin

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory

__all__ = ["animate", "check_film"]

#: Each takes a hundredth of a second or more to draw.
_MOST_FRAMES = 2000
#: Pixels of the bodies; the energy below has a quarter of the height.
_SIZE, _DPI = (480, 360), 80
#: Frames that the camera has in view, and bytes of meshes: each frame is drawn anew.
_VIEW_FRAMES, _BUDGET = 24, 60_000
#: States of a trace.
_TRACE = 1000


def animate(
    trajectory: Trajectory, path: str | os.PathLike[str], *, seconds: float = 6.0, fps: int = 20,
    shape: DrawnName = "auto",
) -> Path:
    """Write a film of the whole run, ``seconds`` long, and return its path.

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
    shape : {"auto", "box", "ellipsoid"}
        What bodies look like: as in ``picture``, or the box or ellipsoid of their inertia.

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
    choose("shape", shape, DRAWN)
    picture_count, writer = _picture_count(seconds, fps), _writer(target, fps)
    # as many states as the pictures and the traces need
    scene = scene_of(trajectory, max(picture_count, _TRACE))
    # fewer stored states than pictures make a shorter film
    shown_frames = np.unique(np.linspace(0, len(scene.t) - 1, picture_count).astype(int)).tolist()
    meshes: dict[str, IndexedMesh] = {}
    if shape == "auto":
        scene, meshes = with_visuals(trajectory, scene, meshes="small", budget=_BUDGET)
    else:
        scene = _with_inertia_shapes(scene, shape)
    width, height = _SIZE
    full_height = height * 1.25  # with the energy below the bodies
    figure = figure_class()(figsize=(width / _DPI, full_height / _DPI), dpi=_DPI)
    stage = _Stage(figure, scene, meshes, shown_frames)
    stage.draw_energy(trajectory)
    with (result_file(target, "The film") as partial_file,
          writer.saving(figure, partial_file, dpi=_DPI)):
        for frame in shown_frames:
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
    target = checked_path(path, "flip.gif", "A film", "film")
    _writer(target, fps=20)
    return target


def _picture_count(seconds: Any, fps: Any) -> int:
    """Return the number of pictures of a film, seconds · fps; InputError for fewer than 2 or too
    many."""
    arrays = [real_array(number) for number in (seconds, fps)]
    numbers = [float(number) for number in arrays
               if number is not None and number.ndim == 0 and number > 0]
    count = numbers[0] * numbers[1] if len(numbers) == 2 else np.nan
    if not 2 <= count <= _MOST_FRAMES:  # NaN as well
        raise InputError(f"A film of seconds = {shown(seconds)} and fps = {shown(fps)} has no "
                         "number of pictures; give two numbers with a product from 2 to "
                         f"{_MOST_FRAMES}.")
    return round(count)


def _writer(target: Path, fps: int) -> Any:
    """Return matplotlib's writer of films: Pillow for .gif, the program ffmpeg for .mp4.

    Raises MissingDependencyError without matplotlib or ffmpeg.
    """
    figure_class()  # or says that matplotlib is missing
    from matplotlib.animation import FFMpegWriter, PillowWriter

    if ending_of(target) == ".gif":
        return PillowWriter(fps=fps)
    if not FFMpegWriter.isAvailable():
        raise MissingDependencyError("Films that end in .mp4 need the program ffmpeg; install it, "
                                     "or write a .gif.")
    return FFMpegWriter(fps=fps)


class _Stage:
    """The picture of the bodies and the energy of a film, which are updated for each frame."""

    def __init__(self, figure: Any, scene: Scene, meshes: Mapping[str, IndexedMesh],
                 frames: list[int]) -> None:
        """Place the camera so that all frames fit, and draw the parts of the figure that stay."""
        from matplotlib.patches import Patch

        self.scene = scene
        # the camera stands still: it is placed so that these frames fit
        in_view = [*frames[::max(1, len(frames) // _VIEW_FRAMES)], frames[-1]]
        self.drawing = SceneDrawing(scene, meshes, in_view, size=_SIZE)
        self.image = figure.figimage(np.zeros((*_SIZE[::-1], 3), np.uint8), 0, _SIZE[1] // 4)
        self.energy = figure.add_axes((0.14, 0.085, 0.83, 0.08))
        self.now = self.energy.axvline(scene.t[0], color="#c0392b", linewidth=1)
        # visuals of a model have colours of their own
        legend_entries = [(body.name, colour) for body, colour in zip(scene.parts, cycle(COLOURS))
                          if not body.own]
        # one body needs no name, and more than ten would cover the scene
        if 1 < len(legend_entries) <= 10:
            patches = [Patch(color=colour, label=name) for name, colour in legend_entries]
            figure.legend(handles=patches, fontsize=8, loc="upper right", framealpha=0.5)
        figure.suptitle(scene.title, fontsize=11)

    def draw_energy(self, trajectory: Trajectory) -> None:
        """Draw the energy error of all stored states, also those without a picture."""
        shown_states = thin(trajectory)
        self.energy.plot(trajectory.t[shown_states].astype(float),
                         trajectory.energy_error()[shown_states].astype(float), linewidth=0.8)
        self.energy.set_title("energy error H − H₀ − W", fontsize=9)
        self.energy.set_xlabel("t [s]", fontsize=8, labelpad=0)
        self.energy.tick_params(labelsize=7)
        self.energy.grid(alpha=0.3)

    def show(self, frame: int) -> None:
        """Draw the bodies of a frame and move the mark of the time in the energy plot."""
        self.image.set_data(self.drawing.pixels(frame))
        self.now.set_xdata([self.scene.t[frame]] * 2)


def _with_inertia_shapes(scene: Scene, shape: ShapeName) -> Scene:
    """Return a scene whose bodies are boxes or ellipsoids of their inertia, in place of other
    shapes."""
    kind: ShapeKind = "box" if shape == "box" else "sphere"
    return replace(scene, parts=[
        replace(body, shapes=[Shape(kind, body.sizes[shape], body.centre, body.axes)], glass=False)
        for body in scene.parts])
