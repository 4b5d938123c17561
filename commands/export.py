"""``gyrospark export``: a stored run as .npz, .csv or NetCDF."""

from __future__ import annotations

from pathlib import Path

import click

from ..core.arguments import count_text
from ..core.file_formats import format_of
from .options import PATH, check_writable

__all__ = ["export"]


@click.command(no_args_is_help=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("store", metavar="STORE", type=PATH)
@click.argument("target", metavar="FILE", type=PATH)
@click.option("--columns", metavar="NAME,...",
              help="Of a .csv or .parquet file, beside the time: headings, patterns such as "
                   "'wheel*', and arrays: q, p, multipliers, quantities (default: all).")
@click.option("--euler", metavar="AXES",
              help="Euler angles of every body as columns of a .csv or .parquet file: ZYX and the "
                   "like about the axes of the body, zyx about those of space.")
@click.option("--degrees", is_flag=True, help="Write these angles in degrees.")
def export(store: Path, target: Path, columns: str | None, euler: str | None, degrees: bool) -> int:
    """Write the states of STORE (run --out NAME.zarr), finished or not, to FILE.

    \b
    gyrospark export night.zarr night.nc       NetCDF-4, for xarray, MATLAB, R
    gyrospark export night.zarr night.csv      a column a number
    gyrospark export night.zarr night.parquet  the columns of .csv, for data frames
    gyrospark export night.zarr night.npz      for gyrospark.load
    gyrospark export night.zarr night.csv --euler ZYX --degrees
    gyrospark export night.zarr night.csv --columns "energy,wheel*"
    """
    from ..storage.recording import open_recording

    format_of(target, "A run", "states").require_packages()
    check_writable("FILE", target)
    recording = open_recording(store)
    names = None if columns is None else [name.strip() for name in columns.split(",")]
    recording.save(target, euler=euler, degrees=degrees, columns=names)
    click.echo(f"{target}: {count_text(recording.states, 'state')} of "
               f"{count_text(recording.steps_done, 'step')} "
               f"({recording.status})")
    return 0
