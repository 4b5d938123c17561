"""A trajectory as a table: CSV, a pandas DataFrame, an xarray Dataset, under the model's names."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import as_flag, as_path
from ...core.errors import InputError, MissingDependencyError
from ...core.extras import install
from ...core.file_formats import ending_of, result_file
from ..rigid_body.euler_angles import check_sequence
from .body_motion import FrameName
from .run_arrays import OUTPUTS, about, labels_of, parts
from .state_columns import headings, places_of, save_events, states_of, write_csv

if TYPE_CHECKING:
    import pandas
    import xarray

    from .trajectory import Trajectory

__all__ = ["to_csv", "to_dataframe", "to_xarray"]

Array = NDArray[Any]


def to_csv(
    trajectory: Trajectory, path: str | os.PathLike[str], *, euler: str | None = None,
    degrees: bool = False, angular_velocity: FrameName | None = None,
    columns: str | Iterable[str] | None = None,
) -> Path:
    """Write the columns of ``to_dataframe`` and the time as CSV, numbers with all their digits.

    Returns the path; the file appears complete or not at all. Events stand in a second file, as
    ``save`` writes them: ``run.events.csv``.

    Raises
    ------
    InputError
        For another ending than .csv, and as ``to_dataframe``.
    GyrosparkError
        If the file cannot be written.
    """
    target = as_path("path", path, "run.csv")
    if ending_of(target) != ".csv":
        raise InputError(f"{target.name!r} is no name of a CSV file; end it in .csv.")
    found = _columns(trajectory, euler, degrees, angular_velocity, columns)
    save_events(trajectory, target)
    with result_file(target, "The table") as part:
        write_csv(part, list(found), [list(found.values())])
    return target


def to_dataframe(
    trajectory: Trajectory, *, euler: str | None = None, degrees: bool = False,
    angular_velocity: FrameName | None = None, columns: str | Iterable[str] | None = None,
) -> pandas.DataFrame:
    """Return the states as a pandas DataFrame, a row a state, the time as its index.

    Columns have the names of coordinates, momenta and quantities; what belongs to a step, such as
    its multipliers, stands in the row of the state where it ends.

    Parameters
    ----------
    euler : str, optional
        A sequence of axes, such as ``"ZYX"``: Euler angles of every body, as ``BodyMotion.euler``
        gives them, in columns ``bus_euler1_Z``, ``bus_euler2_Y``, ``bus_euler3_X``.
    degrees : bool
        Whether these are in degrees.
    angular_velocity : {"body", "space"}, optional
        The axes of columns ``bus_omega1`` to ``bus_omega3``, of every body.
    columns : str or list of str, optional
        Those that are wanted, beside the time and in this order: names, patterns such as
        ``"*_angle"``, and arrays, ``"q"``, ``"multipliers"``, ``"quantities"``. By default all.

    Raises
    ------
    InputError
        For another sequence or frame; where these are asked for and there is no body; for a
        column that is not there.
    MissingDependencyError
        Without pandas.
    """
    try:
        import pandas
    except ImportError as error:
        raise MissingDependencyError(
            f"Data frames need pandas; {install('pandas')} brings it."
        ) from error
    found = _columns(trajectory, euler, degrees, angular_velocity, columns)
    time = pandas.Index(found.pop("time"), name="time")
    return pandas.DataFrame(found, index=time)


def to_xarray(
    trajectory: Trajectory, *, euler: str | None = None, degrees: bool = False,
    angular_velocity: FrameName | None = None,
) -> xarray.Dataset:
    """Return the states as an xarray Dataset along ``time``, with names along every dimension.

    ``dataset.q.sel(coordinate="x")`` is a coordinate, ``dataset.attitude.sel(body="bus")`` the
    quaternions of a body. Arguments and what is raised are those of ``to_dataframe``: ``euler`` and
    ``angular_velocity`` become variables of these names along ``body``; xarray comes with the extra
    ``storage``.
    """
    try:
        import xarray
    except ImportError as error:
        raise MissingDependencyError(
            f"Datasets need xarray; {install('storage')} brings it."
        ) from error
    manifest, values = trajectory.manifest, states_of(trajectory)
    variables: dict[str, Any] = {}
    for one in OUTPUTS:
        inner = [dimension for dimension, _ in one.inner(manifest) or ()] if not one.split else []
        for name in parts(one, manifest):
            variables[name] = (["time", *inner], values[name], about(one, manifest, name))
    names = {key: (key, found, {"long_name": meaning})
             for key, (found, meaning) in labels_of(manifest["system"]).items()}
    if trajectory.bodies:
        variables |= _of_bodies(trajectory, euler, degrees, angular_velocity)
        names["body"] = ("body", list(trajectory.bodies), {"long_name": "name of the body"})
    elif euler is not None or angular_velocity is not None:
        trajectory.body()  # which says that there is none
    used = {dimension for dimensions, *_ in variables.values() for dimension in dimensions}
    run = {"stepper": manifest["name"], "dt": float(trajectory.dt), "every": trajectory.every,
           **{f"parameter_{name}": float(x) for name, x in trajectory.parameters.items()}}
    return xarray.Dataset({key: value for key, value in variables.items() if key != "time"},
                          {"time": variables["time"], **{key: value for key, value in names.items()
                                                         if key in used}}, run)


def _of_bodies(trajectory: Trajectory, euler: str | None, degrees: bool,
               frame: FrameName | None) -> dict[str, Any]:
    """Return the variables along ``body``."""
    bodies = [trajectory.body(name) for name in trajectory.bodies]
    found = {"attitude": (["time", "body", "component"], [body.attitude for body in bodies],
                          {"long_name": "unit quaternion, scalar first, body to space axes"})}
    if euler is not None:
        angles = [body.euler(euler, degrees=degrees) for body in bodies]
        found["euler"] = (["time", "body", "angle"], angles, {
            "long_name": f"Euler angles {euler}", "units": "degree" if degrees else "rad"})
    if frame is not None:
        found["angular_velocity"] = (
            ["time", "body", "axis"], [body.angular_velocity(frame) for body in bodies],
            {"long_name": f"angular velocity in {frame} axes", "units": "rad s-1"})
    return {name: (dimensions, np.stack(arrays, axis=1), said)
            for name, (dimensions, arrays, said) in found.items()}


def _columns(trajectory: Trajectory, euler: str | None, degrees: bool,
             frame: FrameName | None, wanted: Any = None) -> dict[str, Array]:
    """Return a column for each number of a state, and those of the bodies that are asked for.

    ``wanted`` chooses some of all these.
    """
    arrays = states_of(trajectory)
    titles = headings(trajectory.manifest["system"],
                      {name: array.shape[1:] for name, array in arrays.items()})
    flat = [array.reshape(len(array), -1) for array in arrays.values()]
    columns = dict(zip(titles, (column for array in flat for column in array.T), strict=True))
    as_flag("degrees", degrees)
    if euler is not None:
        check_sequence(euler)
    bodies = trajectory.bodies or (None,)  # asked for one, a trajectory says that there is none
    for name in bodies if euler is not None or frame is not None else ():
        body = trajectory.body(name)
        if euler is not None:
            for k, angle in enumerate(body.euler(euler, degrees=degrees).T):
                _add(columns, f"{body.name}_euler{k + 1}_{euler[k]}", angle)
        if frame is not None:
            for k, rate in enumerate(body.angular_velocity(frame).T, start=1):
                _add(columns, f"{body.name}_omega{k}", rate)
    titles = list(columns)
    sizes = {name: values.shape[1] for name, values in zip(arrays, flat, strict=True)}
    return {titles[i]: columns[titles[i]] for i in places_of(wanted, titles, sizes)}


def _add(columns: dict[str, Array], title: str, values: Array) -> None:
    """Add a column, under another name where one of the system's has it."""
    while title in columns:
        title = f"body_{title}"
    columns[title] = values
