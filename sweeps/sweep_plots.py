"""A result of a sweep as a picture: lines over one axis, or colours over two."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.arrays import Array
from ..core.errors import InputError
from ..runtime.plotting.trajectory_plots import check_picture_path, figure_class, save

if TYPE_CHECKING:
    import xarray

__all__ = ["draw"]

_LABELS = {"gamma": "γ (kg m²)", "alpha": "α (kg m²)", "dt": "Δt (s)", "dtau": "Δτ"}
#: Most cells along an axis of a picture, for a readable picture.
_MOST = 2000
#: Most lines of a legend.
_LINES = 10
#: Points of a line that are marked.
_MARKED = 40
#: Ends of a logarithmic axis nearer to each other than that have names for 2 and 5 as well.
_NEAR = 50


@dataclass(frozen=True)
class _Axis:
    """A drawn dimension: the positions, labels and names of its cells.

    Attributes
    ----------
    dimension, label : str
    places : array
        Positions of its cells: their values, or their indices if they have no single number.
    names : list of str
        The name of each cell in a legend.
    numeric : bool
        Whether places are values.
    """

    dimension: str
    label: str
    places: Array
    names: list[str]
    numeric: bool

    def __len__(self) -> int:
        return len(self.places)

    @property
    def logarithmic(self) -> bool:
        """Whether the logarithms of the values are spaced more evenly."""
        values = np.sort(self.places)
        if not self.numeric or len(values) < 3 or values[0] <= 0:
            return False
        return _unevenness(np.log(values)) < _unevenness(values)


def draw(dataset: xarray.Dataset, name: str, path: str | os.PathLike[str] | None = None) -> Any:
    """Draw a result over the sweep's axes: the longest two of them, at the others' first values.

    If one of the two has few values, or values that are names, such as ``scheme``, each of its
    values is one curve over the other axis; two axes of many numbers are drawn in colours. Of an
    axis with more than ``_MOST`` values, every second, third, … is drawn. An axis is logarithmic
    where its values were spaced so. Cells of the sweep that failed are left white.

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
        Jupyter shows it where it is the last value of a cell.

    Raises
    ------
    InputError
        If there is no such result, or a cell of the sweep has several numbers of it.
    MissingDependencyError
        Without matplotlib.
    """
    target = None if path is None else check_picture_path(path)
    inner_dimensions = {"coordinate", "sample"}
    drawable = [str(n) for n, a in dataset.items() if not inner_dimensions & set(a.dims)]
    if name not in drawable:
        raise InputError(f"{name!r} cannot be drawn; choose {', '.join(drawable)}.")
    array = dataset[name]
    # two axes are drawn, with at most _MOST values each; the others are held at their first value
    longest = sorted(array.dims, key=lambda d: -array.sizes[d])[:2]
    fixed_axes = [_axis(array, str(d)) for d in array.dims if d not in longest]
    array = array.isel({axis.dimension: 0 for axis in fixed_axes})
    strides = {d: math.ceil(array.sizes[d] / _MOST) for d in longest}
    array = array.isel({d: slice(None, None, stride) for d, stride in strides.items()})
    figure = figure_class()(figsize=(7.2, 5), layout="constrained")
    axes = figure.add_subplot()
    drawn_axes = [_axis(array, str(d)) for d in array.dims]
    line_axis = _line_axis(drawn_axes)
    if len(drawn_axes) == 2 and line_axis is None:
        _colours(figure, axes, array, *drawn_axes)
    else:
        along = next(axis for axis in drawn_axes if axis is not line_axis)
        _lines(axes, array, along, line_axis)
    fixed_values = ", ".join(f"{axis.label} = {axis.names[0]}" for axis in fixed_axes)
    axes.set_title("\n".join(filter(None, [dataset.attrs.get("title", ""), fixed_values])),
                   fontsize=11)
    if target is not None:
        save(figure, target)
    return figure


def _axis(array: xarray.DataArray, dimension: str) -> _Axis:
    """Return a dimension for drawing: with its own values, or the only quantity along it."""
    along = {str(name): np.asarray(values) for name, values in array.coords.items()
             if values.dims == (dimension,)}
    # an axis of one parameter may have another name than that
    label = dimension if dimension in along or len(along) != 1 else next(iter(along))
    values = along.get(label)
    if values is not None and values.dtype.kind in "iuf":
        return _Axis(dimension, _LABELS.get(label, label), values, [f"{v:.4g}" for v in values],
                     numeric=True)
    size = array.sizes[dimension]
    if values is not None:
        names = [str(coordinate) for coordinate in values]
    elif along:
        names = [", ".join(f"{name} = {column[i]:.4g}" for name, column in along.items())
                 for i in range(size)]
    else:
        names = [str(i) for i in range(size)]
    return _Axis(dimension, label, np.arange(size), names, numeric=False)


def _line_axis(axes: list[_Axis]) -> _Axis | None:
    """Return the axis each of whose cells is a line over the other; None for colours."""
    short_axes = [axis for axis in axes if len(axis) <= _LINES]
    if len(axes) < 2 or not short_axes:
        return None
    # names before numbers, which have an order that colours of lines would not show
    return min(short_axes, key=lambda axis: (axis.numeric, len(axis)))


def _lines(axes: Any, array: xarray.DataArray, along: _Axis, line_axis: _Axis | None) -> None:
    """Draw a quantity along an axis, a line for each value of ``line_axis``, if there is one."""
    order = np.argsort(along.places, kind="stable")
    if line_axis is not None:  # a row for each line
        array = array.transpose(line_axis.dimension, along.dimension)
    lines = np.asarray(array, dtype=float).reshape(-1, len(along))
    names = [None] if line_axis is None else line_axis.names
    style = "o" if not along.numeric else "o-" if len(along) <= _MARKED else "-"
    for line, name in zip(lines, names, strict=True):
        axes.plot(along.places[order], line[order], style, ms=3.5, lw=1.2, label=name)
    _scale(axes.xaxis, axes.set_xscale, along)
    axes.set_ylabel(_label(array))
    if _spread(lines):
        axes.set_yscale("log")
    axes.grid(alpha=0.3)
    if line_axis is not None:
        axes.legend(title=line_axis.label, fontsize=8)


def _colours(figure: Any, axes: Any, array: xarray.DataArray, x: _Axis, y: _Axis) -> None:
    """Draw a quantity over the axes x and y of a sweep as colours, in ``axes`` of a figure."""
    from matplotlib.colors import LogNorm

    cell_values = np.asarray(array.transpose(y.dimension, x.dimension), dtype=float)
    x_order, y_order = (np.argsort(axis.places, kind="stable") for axis in (x, y))
    cell_values = cell_values[np.ix_(y_order, x_order)]
    norm = LogNorm() if _spread(cell_values) else None
    image = axes.pcolormesh(x.places[x_order], y.places[y_order],
                            np.ma.masked_invalid(cell_values), norm=norm,
                            shading="nearest", rasterized=True)
    _scale(axes.xaxis, axes.set_xscale, x)
    _scale(axes.yaxis, axes.set_yscale, y)
    figure.colorbar(image, ax=axes, label=_label(array))


def _scale(axis: Any, set_scale: Any, sweep_axis: _Axis) -> None:
    """Give an axis of a picture the label, scale and ticks of an axis of the sweep.

    ``set_scale`` is Matplotlib's method for this one, such as ``axes.set_xscale``.
    """
    axis.set_label_text(sweep_axis.label)
    if not sweep_axis.numeric and len(sweep_axis) <= _LINES:
        axis.set_ticks(sweep_axis.places, sweep_axis.names)
    if sweep_axis.logarithmic:
        set_scale("log")
        # labels at 2 and 5 of a decade, unless there are so many decades that they would touch
        if sweep_axis.places.max() < _NEAR * sweep_axis.places.min():
            from matplotlib.ticker import LogFormatterSciNotation, LogLocator

            axis.set_minor_locator(LogLocator(subs=(2, 5)))
            axis.set_minor_formatter(LogFormatterSciNotation(minor_thresholds=(2, 2)))


def _unevenness(values: Array) -> float:
    """Return the standard deviation of the distances between sorted values over their mean; 0 if
    equal."""
    distances = np.diff(values)
    return float(distances.std() / distances.mean()) if distances.any() else 0.0


def _spread(values: Array) -> bool:
    """Whether finite results are positive and the largest is more than 30 times the smallest.

    Above this ratio a linear scale would draw the small errors at 0.
    """
    finite = values[np.isfinite(values)]
    return bool(len(finite)) and bool((finite > 0).all()) and finite.max() > 30 * finite.min()


def _label(array: xarray.DataArray) -> str:
    """Return the description of a result with its unit, for an axis or a colour bar."""
    units = array.attrs.get("units")
    text = str(array.attrs.get("long_name", array.name))
    return f"{text} ({units})" if units else text
