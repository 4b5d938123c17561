"""Tables, pictures, pages, films of a trajectory, and its display in a notebook."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, cast

from ...core.arguments import count_text
from ...core.arrays import Array
from ...core.html import card, curve, table
from .body_motion import FrameName
from .outputs import OUTPUTS, names_in_files
from .table import as_dataset, as_frame, table_of_run

if TYPE_CHECKING:
    import pandas
    import xarray

    from .trajectory import Trajectory

__all__ = ["Shown"]


class Shown:
    """The part of ``Trajectory`` that draws its states or returns them as tables."""

    @property
    def _run(self) -> Trajectory:
        """The trajectory itself, of which this class is a part."""
        return cast("Trajectory", self)

    def _extent(self) -> list[tuple[str, str]]:
        """Return "stored states of steps of Δt" and the first and last time, as rows of a card."""
        run, t = self._run, self._run.t.astype(float)
        return [("states", f"{len(run):,} of {count_text(run.report.steps, 'step')} of "
                           f"{float(run.dt):g} s"),
                ("time", f"{t[0]:.6g} to {t[-1]:.6g} s" if len(t) else "none")]

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the report, and the energy error over time."""
        run = self._run
        report, t = run.report, run.t.astype(float)
        work_term = " − W" if run.manifest.system.forces else ""
        report_rows = [*self._extent(),
                       ("bodies", ", ".join(run.bodies) or "none"),
                       ("iterations",
                        f"{report.iterations_mean:.1f} a step, {report.iterations_max} at most"),
                       (f"largest |H − H₀{work_term}|", f"{report.energy_error_max:.2e}"),
                       ("largest |g(q)|", f"{report.constraint_max:.2e}"),
                       ("largest |g_q H_p|", f"{report.momentum_constraint_max:.2e}")]
        return card(f"Trajectory of {run.manifest.name}", table(report_rows),
                    curve(t, run.energy_error().astype(float), f"H − H₀{work_term}"))

    def table(
        self, columns: str | Iterable[str] | None = None, *, euler: str | None = None,
        degrees: bool = False, angular_velocity: FrameName | None = None,
    ) -> pandas.DataFrame:
        """Return the states as a pandas DataFrame, a row a state, the time as its index.

        Columns have the names of coordinates, momenta and quantities. Numbers of a step, such as
        its multipliers, are in the row of the state where the step ends.

        Parameters
        ----------
        columns : str or list of str, optional
            The columns in this order: names, patterns such as ``"*_angle"``, and arrays, ``"q"``,
            ``"multipliers"``, ``"quantities"``. By default all.
        euler : str, optional
            A sequence of axes, such as ``"ZYX"``: Euler angles of every body, as
            ``BodyMotion.euler`` gives them, in columns ``bus_euler1_Z``, ``bus_euler2_Y``,
            ``bus_euler3_X``.
        degrees : bool
            Whether these are in degrees.
        angular_velocity : {"body", "space"}, optional
            The axes of columns ``bus_omega1`` to ``bus_omega3``, of every body.

        Raises
        ------
        InputError
            For another sequence or frame; where these are asked for and there is no body; for a
            column that is not there.
        MissingDependencyError
            Without pandas.

        Examples
        --------
        >>> run.table(["*_angle", "energy"])                      # doctest: +SKIP
        """
        return as_frame(table_of_run(self._run, euler=euler, degrees=degrees,
                                     angular_velocity=angular_velocity), columns)

    def dataset(
        self, *, euler: str | None = None, degrees: bool = False,
        angular_velocity: FrameName | None = None,
    ) -> xarray.Dataset:
        """Return the states as an xarray Dataset along ``time``, with names along every dimension.

        ``dataset.q.sel(coordinate="x")`` is a coordinate, ``dataset.attitude.sel(body="bus")`` the
        quaternions of a body. The arguments are those of ``table``: ``euler`` and
        ``angular_velocity`` become variables along ``body``.
        """
        run = self._run
        table = table_of_run(run, euler=euler, degrees=degrees, angular_velocity=angular_velocity,
                             attitudes=True)
        return as_dataset(table, {
            "stepper": run.manifest.name, "dt": float(run.dt), "every": run.every,
            **{f"parameter_{name}": float(x) for name, x in run.parameters.items()}})

    def panels(self) -> dict[str, Array]:
        """Return the outputs that pictures show in panels of their own, by title."""
        return {output.panel: getattr(self._run, output.attribute) for output in OUTPUTS
                if output.panel and names_in_files(output, self._run.manifest)}

    def plot(self, *names: str | os.PathLike[str],
             path: str | os.PathLike[str] | None = None) -> Any:
        """Draw the motion with its energy and constraint errors, or values by name against time.

        Parameters
        ----------
        names : str
            Quantities, coordinates, momenta, or "energy", "energy_error", "work", "iterations",
            "g_error", "f_error": a panel each. By default the axis of a body, the places of
            several, or the coordinates, with all errors.
        path : path, optional
            Where to write the picture: .png, .svg or .pdf. A name with such an ending is a path
            too: ``run.plot("energy", "x.png")``.

        Returns
        -------
        matplotlib.figure.Figure
            Jupyter shows it.

        Examples
        --------
        >>> run.plot("energy")                                    # doctest: +SKIP
        """
        from ..plotting.trajectory_plots import draw_trajectory, draw_values, names_and_path

        value_names, target = names_and_path(names, path)
        if value_names:
            return draw_values([self._run], value_names, target)
        return draw_trajectory(self._run, target)

    def plot_phase(self, *coordinates: str, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw phase portraits: each named coordinate, or the first six, against its momentum.

        Returns a matplotlib figure, which Jupyter shows; .png, .svg or .pdf where a path is given.

        Raises
        ------
        InputError
            For a name that no coordinate has.
        """
        from ..plotting.motion_plots import draw_phase  # matplotlib is optional

        return draw_phase(self._run, coordinates, path)

    def show(self, path: str | os.PathLike[str] | None = None, **options: Any) -> Any:
        """Show the bodies in motion: in a notebook, as a page, a picture, a film or a 3-D model.

        Parameters
        ----------
        path : path, optional
            Where to write. The ending says what: .html a page that moves and needs no network;
            .png a picture; .gif or .mp4 a film; .glb a 3-D model for Blender and other viewers.
            Without a path the page is returned, which Jupyter shows; with the ending ``".png"``
            alone the picture.
        options
            Of pages ``shape`` and ``meshes``; of pictures ``size``, ``time``, ``azimuth``,
            ``elevation``, ``background`` and ``traces``; of films ``seconds``, ``fps`` and
            ``shape``; of models ``meshes``: see ``runtime.plotting``.

        Returns
        -------
        View, RenderedPicture or Path
            The page or the picture, which Jupyter shows; of films and models where they are.

        Raises
        ------
        InputError
            Where there is no rigid body; for another ending, and options of other kinds.
        MissingDependencyError
            For films without matplotlib, or ffmpeg.
        GyrosparkError
            If the file cannot be written.

        Examples
        --------
        >>> run.show("top.html")                                  # doctest: +SKIP
        >>> run.show("top.png", time=1.5, azimuth=30)             # doctest: +SKIP
        """
        from ..plotting.show import show

        return show(self._run, path, options)
