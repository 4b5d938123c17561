"""A stored run as .npz, .csv or NetCDF, block by block: memory stays constant but for .npz."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError, MissingDependencyError, StorageError
from .durable import finished, one_line

if TYPE_CHECKING:
    import xarray

    from .recording import Recording

__all__ = ["EXPORTS", "check_export", "export"]

EXPORTS = (".npz", ".csv", ".nc")
#: Rows of a CSV file that are in memory as Python's numbers.
_ROWS = 2**13


def check_export(path: Path) -> None:
    """Refuse what no run can be exported to.

    Raises
    ------
    InputError, MissingDependencyError
    """
    if path.suffix not in EXPORTS:
        raise InputError(f"{str(path)!r} is no file to export to; give a name that ends in "
                         f"{', '.join(EXPORTS)}.")
    if path.suffix == ".nc":
        try:
            import h5netcdf  # noqa: F401
            import h5py  # noqa: F401
        except ImportError as error:
            raise MissingDependencyError(
                "NetCDF needs h5netcdf; `pip install gyrospark[netcdf]` brings it."
            ) from error


def export(recording: Recording, path: Path) -> Path:
    """Write the states of a run; the file appears complete or not at all.

    .npz is what ``Trajectory.load`` reads, with all digits; .csv has a column a number (q0, q1,
    ...), each with the digits that give the double back; .nc is NetCDF-4, with attributes as text.

    Raises
    ------
    InputError
        For another ending, or a run without a state.
    StorageError
        If the file cannot be written.
    """
    check_export(path)
    if recording.report is None:
        raise InputError(f"{str(recording.path)!r} holds no state yet; go on with its run first.")
    if path.suffix == ".npz":
        return recording.trajectory().save(path)
    write = _write_csv if path.suffix == ".csv" else _write_netcdf
    dataset = recording.dataset
    try:
        with finished(path) as part:
            write(dataset, part)
    except (ValueError, RuntimeError) as error:  # a checksum is wrong, say
        raise InputError(f"{str(recording.path)!r} is damaged: {one_line(error)}.") from error
    except OSError as error:
        raise StorageError(f"The file {str(path)!r} cannot be written: {error.strerror or error}."
                           ) from error
    return path


def _write_csv(dataset: xarray.Dataset, path: Path) -> None:
    table = {"time": dataset["time"], **{str(name): array for name, array in dataset.items()
                                         if "byte" not in array.dims}}
    with path.open("w", encoding="utf-8", newline="") as file:
        lines = csv.writer(file)
        lines.writerow([heading for name, array in table.items()
                        for heading in _headings(name, array)])
        begin = 0
        for length in dataset.chunksizes["time"]:  # each block is read once
            block = [np.asarray(array[begin : begin + length]).reshape(length, -1)
                     for array in table.values()]
            for start in range(0, length, _ROWS):
                parts = [numbers[start : start + _ROWS].tolist() for numbers in block]
                lines.writerows([number for part in row for number in part]
                                for row in zip(*parts, strict=True))
            begin += length


def _headings(name: str, array: xarray.DataArray) -> Iterator[str]:
    """Yield the headings of an array: its name, with an index for each inner dimension."""
    for index in np.ndindex(array.shape[1:]):
        yield name + "_".join(map(str, index))


def _write_netcdf(dataset: xarray.Dataset, path: Path) -> None:
    import dask

    plain = dataset.assign_attrs({name: _plain(value) for name, value in dataset.attrs.items()})
    for name in (*plain.data_vars, *plain.coords):
        array = plain[name]
        array.attrs = {key: _plain(value) for key, value in array.attrs.items()}
        array.encoding = {}  # Zarr's chunks and codecs mean nothing there
    # In this thread: after an error others would go on, and open the removed file anew.
    with dask.config.set(scheduler="synchronous"):
        plain.to_netcdf(path, engine="h5netcdf")


def _plain(value: Any) -> Any:
    """Return an attribute as NetCDF can hold it."""
    return value if isinstance(value, (str, int, float)) else json.dumps(value)
