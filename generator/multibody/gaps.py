"""Gaps of contacts: expressions that are positive while two bodies are apart, 0 where they touch.

    sphere and plane   φ = R_b n · d − ϱ
    two spheres        φ = |d| − ϱ_a − ϱ_b,       d = x_a + R_a r_a − x_b − R_b r_b

with n the unit normal of a plane of b, towards a; r_a and r_b are points in the axes of a and b. A
point is a sphere of radius 0, a box its eight corners.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from ...core.arguments import shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import is_number, real_array
from .body import Frame, dot
from .initial_poses import finite, unit, vector
from .joints import Store, named_number, named_vector, unit_vector

__all__ = ["gaps_of_plane", "gaps_of_spheres", "points_of"]


def points_of(name: str, on_a: Any, box: ArrayLike | None) -> Array:
    """Return the points of a contact in the axes of a, shape (points, 3).

    ``on_a`` is one point or rows of points; with a ``box``, half the lengths of its edges, the
    points are its eight corners about ``on_a``. Raises InputError for values that are no points,
    and for a box without extent.
    """
    points = real_array(on_a)
    if points is None or points.ndim not in (1, 2) or points.shape[-1] != 3 or not (
            points.size and np.isfinite(points).all()):
        raise InputError(f"on_a of {name!r} is {shown(on_a)}; give three finite numbers, or rows "
                         "of three.")
    points = np.atleast_2d(points)
    if box is None:
        return points
    half = vector(f"box of {name!r}", box)
    if not (half > 0).all() or len(points) != 1:
        raise InputError(f"box of {name!r} is {shown(box)} about {len(points)} points; give half "
                         "the lengths of its edges, above 0, about one point.")
    corners: Array = points[0] + half * np.array([*itertools.product((-1, 1), repeat=3)])
    return corners


def gaps_of_plane(
    name: str, frames: tuple[Frame, Frame], points: Array, on_b: Array, normal: ArrayLike,
    radius: Any, store: Store,
) -> list[sp.Expr]:
    """Return the gap φ = R_b n · d − ϱ of each point of a, or sphere about it, to a plane of b.

    d leads to the point from a point of the plane, and ϱ is ``radius``. ``frames`` are a and b;
    ``points``, shape (points, 3), are in axes of a; ``on_b``, the point of the plane, (3,), and
    ``normal`` n in axes of b.
    Values of parameters go into ``store``. Raises InputError for a normal of length 0 and for a
    negative radius.
    """
    direction = vector(f"normal of {name!r}", normal)
    if not direction.any():
        raise InputError(f"The normal of {name!r} is zero; give its direction.")
    (sphere_radius,) = _radii(name, radius, 1, store)
    n = frames[1].direction(unit_vector(f"{name}_normal", unit(direction), store))
    return [dot(n, d) - sphere_radius for d in _distances(name, frames, points, on_b, store)]


def gaps_of_spheres(
    name: str, frames: tuple[Frame, Frame], points: Array, on_b: Array, radius: Any, store: Store
) -> list[sp.Expr]:
    """Return the gap φ = |d| − ϱ_a − ϱ_b of each sphere of a to a sphere of b.

    d leads from centre to centre. ``frames`` are a and b, ``points`` and ``on_b`` the centres of
    the spheres in their axes.
    ``radius`` is one number for both bodies, or ϱ_a and ϱ_b. Values of parameters go into
    ``store``. Raises InputError for negative radii, and where both are 0.
    """
    radii = _radii(name, radius, 2, store)
    if not any(radii):
        raise InputError(f"{name!r} has two points, which never touch; give radius=, or normal= "
                         "of a plane of the second body.")
    return [sp.sqrt(dot(d, d)) - sp.Add(*radii)
            for d in _distances(name, frames, points, on_b, store)]


def _distances(
    name: str, frames: tuple[Frame, Frame], points: Array, on_b: Array, store: Store
) -> list[Sequence[sp.Expr]]:
    """Return d = x_a + R_a r_a − x_b − R_b r_b, three expressions, for each point r_a.

    ``frames`` are a and b, ``points``, (points, 3), has r_a as rows, and ``on_b``, (3,), is r_b.
    """
    a, b = frames
    point_b = b.point(named_vector(f"{name}_b", on_b.tolist(), store))
    # NAME_a of a single point, NAME_a1, NAME_a2, … of several
    labels = [f"{name}_a{i}" for i in range(1, len(points) + 1)] if len(points) > 1 else [
        f"{name}_a"]
    distances: list[Sequence[sp.Expr]] = []
    for label, r in zip(labels, points, strict=True):
        point_a = a.point(named_vector(label, r.tolist(), store))
        distances.append([x - y for x, y in zip(point_a, point_b, strict=True)])
    return distances


def _radii(name: str, radius: Any, count: int, store: Store) -> list[sp.Expr]:
    """Return ``count`` radii as parameters: NAME_radius of all, or NAME_radius_a and NAME_radius_b.

    ``radius`` is one number for all, or ``count`` numbers. Raises InputError for anything else and
    for negative numbers.
    """
    is_common = is_number(radius)
    radii = finite(f"radius of {name!r}", [radius] * count if is_common else radius, (count,))
    if radii.min() < 0:
        raise InputError(f"radius of {name!r} is {shown(radius)}; give 0 or more.")
    suffixes = [""] * count if is_common or count == 1 else ["_a", "_b"]
    return [named_number(f"{name}_radius{end}", r, store)
            for end, r in zip(suffixes, radii.tolist(), strict=True)]
