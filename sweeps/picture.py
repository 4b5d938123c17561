"""A result of a sweep as a picture: a line over one axis, colours over two."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from ..runtime.plots import check_target, figure_class, save

if TYPE_CHECKING:
    import xarray

__all__ = ["draw"]

_LABELS = {"gamma": "γ (kg m²)", "alpha": "α (kg m²)", "dt": "Δt (s)"}
#: Cells along an axis of a picture; more cannot be told apart.
_MOST = 2000


def draw(dataset: xarray.Dataset, name: str, path: str | os.PathLike[str] | None = None) -> Any:
    """Draw a result over the sweep's axes: the longest two of them, at the others' first values.

    Cells that failed are left white.

    Parameters
    ----------
    dataset : xarray.Dataset
        From ``gyrospark.sweep``.
    name : str
        The result, e.g. ``"energy_error_max"``.
    path : path, optional
        Where to write the picture: .png, .svg or .pdf.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    InputError
        If there is no such result, or it is no number of a cell.
    MissingDependencyError
        Without matplotlib.
    """
    target = None if path is None else check_target(path)
    inner = {"coordinate", "sample"}
    drawable = [str(n) for n, a in dataset.items() if not inner & set(a.dims)]
    if name not in drawable:
        raise InputError(f"{name!r} cannot be drawn; choose {', '.join(drawable)}.")
    array = dataset[name]
    shown = sorted(array.dims, key=lambda d: -array.sizes[d])[:2]
    shown = [d for d in array.dims if d in shown]
    array = array.isel({d: 0 for d in array.dims if d not in shown})
    array = array.isel({d: slice(None, None, -(-array.sizes[d] // _MOST)) for d in shown})
    figure = figure_class()(figsize=(7.2, 5), layout="constrained")
    axes = figure.add_subplot()
    (_line if len(shown) == 1 else _colours)(figure, axes, array, [str(d) for d in shown])
    axes.set_title(f"{dataset.attrs.get('title', '')}", fontsize=11)
    if target is not None:
        save(figure, target)
    return figure


def _line(figure: Any, axes: Any, array: xarray.DataArray, names: list[str]) -> None:
    values = np.asarray(array)
    axes.plot(_ticks(axes.xaxis, axes.set_xscale, array, names[0]), values, lw=1.2)
    axes.set_ylabel(_said(array))
    if _logarithmic(values):
        axes.set_yscale("log")


def _colours(figure: Any, axes: Any, array: xarray.DataArray, names: list[str]) -> None:
    from matplotlib.colors import LogNorm

    values = np.asarray(array.transpose(names[1], names[0]), dtype=float)
    x = _ticks(axes.xaxis, axes.set_xscale, array, names[0])
    y = _ticks(axes.yaxis, axes.set_yscale, array, names[1])
    norm = LogNorm() if _logarithmic(values) else None
    image = axes.pcolormesh(x, y, np.ma.masked_invalid(values), norm=norm, shading="nearest",
                            rasterized=True)
    figure.colorbar(image, ax=axes, label=_said(array))


def _ticks(axis: Any, set_scale: Any, array: xarray.DataArray, name: str) -> Any:
    """Return the places along an axis; values of one sign and many sizes stand evenly in log."""
    values = np.asarray(array[name]) if name in array.coords else np.arange(array.sizes[name])
    if values.dtype.kind not in "iuf":
        axis.set_ticks(np.arange(len(values)), [str(v) for v in values])
        return np.arange(len(values))
    axis.set_label_text(_LABELS.get(name, name))
    if len(values) > 2 and values.min() > 0 and values.max() > 8 * values.min():
        set_scale("log")
    return values


def _logarithmic(values: Any) -> bool:
    finite = values[np.isfinite(values)]
    return bool(len(finite)) and bool((finite > 0).all()) and finite.max() > 30 * finite.min()


def _said(array: xarray.DataArray) -> str:
    units = array.attrs.get("units")
    text = str(array.attrs.get("long_name", array.name))
    return f"{text} ({units})" if units else text
