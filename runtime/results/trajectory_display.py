"""Tables, pictures, pages, films of a trajectory, and its display in a notebook."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from numpy.typing import NDArray

from ...core.html import card, curve, table
from ..plotting.html_view import View, view
from ..plotting.meshes import MeshesName
from ..plotting.picture import BackgroundName, RenderedPicture, draw_picture
from ..plotting.scene import DrawnName
from . import trajectory_tables
from .body_motion import FrameName
from .run_arrays import OUTPUTS, parts

if TYPE_CHECKING:
    import pandas
    import xarray

    from .trajectory import Trajectory

__all__ = ["Shown"]

Array = NDArray[Any]


class Shown:
    """The part of ``Trajectory`` that makes something to look at of its states."""

    @property
    def _run(self) -> Trajectory:
        return cast("Trajectory", self)

    def _repr_html_(self) -> str:
        """Return what notebooks show: the report, and the energy error over time."""
        run = self._run
        report, t = run.report, run.t.astype(float)
        less = " − W" if "forces" in run.manifest["system"] else ""
        rows = [("states", f"{len(run):,} of {report.steps:,} steps of {float(run.dt):g} s"),
                ("time", f"{t[0]:.6g} to {t[-1]:.6g} s"),
                ("bodies", ", ".join(run.bodies) or "none"),
                ("iterations", f"{report.iterations_mean:.1f} a step, {report.iterations_max} "
                               "at most"),
                (f"largest |H − H₀{less}|", f"{report.energy_error_max:.2e}"),
                ("largest |g(q)|", f"{report.constraint_max:.2e}"),
                ("largest |g_q H_p|", f"{report.momentum_constraint_max:.2e}")]
        return card(f"Trajectory of {run.manifest['name']}", table(rows),
                    curve(t, run.energy_error().astype(float), f"H − H₀{less}"))

    def to_csv(
        self, path: str | os.PathLike[str], *, euler: str | None = None, degrees: bool = False,
        angular_velocity: FrameName | None = None, columns: str | Iterable[str] | None = None,
    ) -> Path:
        """Write the states as CSV, with Euler angles and such where asked for; return the path.

        See ``to_dataframe`` for the columns.

        Examples
        --------
        >>> run.to_csv("run.csv", euler="ZYX", degrees=True)      # doctest: +SKIP
        >>> run.to_csv("run.csv", columns=["*_angle", "energy"])  # doctest: +SKIP
        """
        return trajectory_tables.to_csv(self._run, path, euler=euler, degrees=degrees,
                                        angular_velocity=angular_velocity, columns=columns)

    def to_dataframe(
        self, *, euler: str | None = None, degrees: bool = False,
        angular_velocity: FrameName | None = None, columns: str | Iterable[str] | None = None,
    ) -> pandas.DataFrame:
        """Return the states as a pandas DataFrame; see ``trajectory_tables.to_dataframe``."""
        return trajectory_tables.to_dataframe(self._run, euler=euler, degrees=degrees,
                                              angular_velocity=angular_velocity, columns=columns)

    def to_xarray(
        self, *, euler: str | None = None, degrees: bool = False,
        angular_velocity: FrameName | None = None,
    ) -> xarray.Dataset:
        """Return the states as an xarray Dataset; see ``trajectory_tables.to_xarray``."""
        return trajectory_tables.to_xarray(self._run, euler=euler, degrees=degrees,
                                           angular_velocity=angular_velocity)

    def panels(self) -> dict[str, Array]:
        """Return the outputs that pictures show in panels of their own, by title."""
        return {one.panel: getattr(self._run, one.attribute) for one in OUTPUTS
                if one.panel and parts(one, self._run.manifest)}

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw axis trace, energy error and constraint errors; write them where a path is given.

        Returns a matplotlib figure, which Jupyter shows; see ``trajectory_plots.draw_trajectory``.
        """
        from ..plotting.trajectory_plots import draw_trajectory  # matplotlib is optional

        return draw_trajectory(self._run, path)

    def plot_phase(self, *coordinates: str, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw phase portraits: each of these coordinates, or the first six, against its momentum.

        Returns a matplotlib figure, which Jupyter shows; .png, .svg or .pdf where a path is given.

        Raises
        ------
        InputError
            For a name that no coordinate has.
        """
        from ..plotting.motion_plots import draw_phase  # matplotlib is optional

        return draw_phase(self._run, coordinates, path)

    def view(self, path: str | os.PathLike[str] | None = None, *,
             shape: DrawnName = "auto", meshes: MeshesName = "small") -> View:
        """Return the run as a page that moves, which Jupyter shows; write it where a path is given.

        One HTML file without network: bodies as discs, bars and boxes of their inertia, or as the
        meshes of a robot's file, joints, traces, a slider, and the energy error beside it; see
        ``runtime.plotting.html_view.view``.

        Examples
        --------
        >>> run.view("top.html")                                  # doctest: +SKIP
        """
        return view(self._run, path, shape=shape, meshes=meshes)

    def picture(
        self, path: str | os.PathLike[str] | None = None, *, size: tuple[int, int] = (640, 480),
        time: float | None = None, azimuth: float | None = None, elevation: float | None = None,
        background: BackgroundName = "light", traces: bool = True,
    ) -> RenderedPicture:
        """Return a picture of the bodies, which Jupyter shows; write it as .png where a path is
        given. It needs no extra; see ``runtime.plotting.picture.draw_picture``.

        Examples
        --------
        >>> run.picture("top.png", time=1.5, azimuth=30, elevation=20)   # doctest: +SKIP
        """
        return draw_picture(self._run, path, size=size, time=time, azimuth=azimuth,
                            elevation=elevation, background=background, traces=traces)

    def export(self, path: str | os.PathLike[str], *, meshes: MeshesName = "full") -> Path:
        """Write bodies, joints and motion as a 3-D model, .glb; return the path.

        Binary glTF 2.0 for Blender and other viewers; see ``runtime.plotting.gltf``.

        Examples
        --------
        >>> run.export("top.glb")                                 # doctest: +SKIP
        """
        from ..plotting.gltf import export_gltf

        return export_gltf(self._run, path, meshes=meshes)

    def animate(self, path: str | os.PathLike[str], *, seconds: float = 6.0, fps: int = 20,
                shape: DrawnName = "auto") -> Path:
        """Write the run as a film, .gif or .mp4, and return its path; see ``plotting.animation``.

        Examples
        --------
        >>> run.animate("flip.gif")                               # doctest: +SKIP
        """
        from ..plotting.animation import animate  # matplotlib is optional

        return animate(self._run, path, seconds=seconds, fps=fps, shape=shape)
