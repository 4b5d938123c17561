"""Triangles to pixels in NumPy: z-buffer, light, shadows, oversampling, PNG.

All triangles are rasterized at once: rows of each triangle, spans of each row, fragments of each
span; of the fragments of a pixel the nearest remains. In screen coordinates the reciprocal of the
distance to the eye is linear, so it serves as depth.
"""

from __future__ import annotations

import struct
import zlib
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...core.records import dataclass

__all__ = ["BACKGROUNDS", "BackgroundName", "Camera", "Triangles", "encode_png", "rasterize",
           "render"]

Array = NDArray[np.float64]
BackgroundName = Literal["light", "dark"]

#: Samples of a pixel in each direction.
_OVER = 2
#: Light: of the surroundings, of the lamp, of its reflection; exponent of the reflection.
_AMBIENT, _DIRECT, _SHINE, _GLOSS = 0.62, 0.55, 0.25, 32
#: Pixels of the picture that the lamp sees, and softness of the shadow on the floor in parts of it.
_LAMP, _SOFT = 512, 0.016
#: Part of the light that a full shadow takes from the floor.
_FLOOR_SHADOW = 0.30
#: Part of the light that an outline leaves, and opacity of the lines of the floor.
_OUTLINE, _LINE = 0.62, 0.75
#: Where lines of the floor end, in parts of the reach of the scene.
_FADE = 2.2
#: Background at the top and at the bottom, and lines of the floor.
BACKGROUNDS = {"light": ((0.985, 0.988, 0.995), (0.90, 0.915, 0.935), (0.72, 0.75, 0.79)),
               "dark": ((0.13, 0.145, 0.17), (0.075, 0.085, 0.105), (0.30, 0.33, 0.37))}


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Attributes
    ----------
    eye : array, shape (3,)
    axes : array, shape (3, 3)
        Rows: right, up, and towards the eye.
    focus : float
        Pixels of a unit length at unit distance.
    middle : array, shape (2,)
        Pixel of the axis of sight.
    """

    eye: Array
    axes: Array
    focus: float
    middle: Array

    def project(self, points: Array) -> Array:
        """Return pixel and reciprocal distance of points, shape (..., 3)."""
        r = (points - self.eye) @ self.axes.T
        nearness = 1 / np.maximum(-r[..., 2], 1e-9)  # behind the eye: as if just before it
        return np.stack([self.middle[0] + self.focus * r[..., 0] * nearness,
                         self.middle[1] - self.focus * r[..., 1] * nearness, nearness], axis=-1)

    def rays(self, x: Array, y: Array) -> Array:
        """Return directions from the eye to pixels, of unit length along the axis of sight."""
        u, v = (x - self.middle[0]) / self.focus, (self.middle[1] - y) / self.focus
        return np.stack([u, v, -np.ones_like(u)], axis=-1) @ self.axes


@dataclass(frozen=True)
class Triangles:
    """Triangles to draw, each with its normals, colour, solid and opacity.

    Attributes
    ----------
    corners, normals : array, shape (n, 3, 3)
    colours : array, shape (n, 3)
    part : array of int, shape (n,)
        Solids with different numbers have an outline between them.
    alpha : array, shape (n,)
        Less than 1 for glass.
    """

    corners: Array
    normals: Array
    colours: Array
    part: NDArray[np.int64]
    alpha: Array



def rasterize(screen: Array, width: int, height: int, depth: Array | None = None,
              ) -> tuple[NDArray[np.int64], Array]:
    """Return the nearest triangle of each pixel, −1 for none, and its depth, larger if nearer.

    Three lists grow from each other: the rows of pixels of each triangle, the span of columns of
    each row, the fragments (pixels) of each span.

    Parameters
    ----------
    screen : array, shape (n, 3, 3)
        Pixel coordinates and depth of the corners.
    depth : array, shape (height, width), optional
        Depth of solids that hide triangles.
    """
    index = np.full(height * width, -1, dtype=np.int64)
    buffer = np.zeros(height * width) if depth is None else depth.ravel().copy()
    x, y, w = screen[..., 0], screen[..., 1], screen[..., 2]
    # twice the signed area; a pixel belongs to a triangle if its centre, at + ½, is inside
    area = ((x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0]))
    # each row that a triangle crosses; triangles without area, below 1e-12 pixels, cover none
    first_row, row_counts = _pixel_range(y.min(axis=1), y.max(axis=1), height)
    row_counts = np.where(np.abs(area) > 1e-12, row_counts, 0)
    triangle = np.repeat(np.arange(len(screen)), row_counts)
    row = first_row[triangle] + _concatenate_ranges(row_counts)
    # each pixel of these rows between the triangle's edges: a fragment
    left_bound, right_bound = _row_bounds(x, y, np.sign(area), triangle, row, float(width))
    first_column, column_counts = _pixel_range(left_bound, right_bound, width)
    fragment = np.repeat(np.arange(len(row)), column_counts)
    column = first_column[fragment] + _concatenate_ranges(column_counts)
    triangle, row = triangle[fragment], row[fragment]
    w0, wx, wy = _depth_planes(x, y, w, np.where(np.abs(area) > 1e-12, area, 1.0))
    fragment_depth = w0[triangle] + wx[triangle] * (column + 0.5) + wy[triangle] * (row + 0.5)
    pixel = row * width + column
    np.maximum.at(buffer, pixel, fragment_depth)
    nearest = fragment_depth == buffer[pixel]
    index[pixel[nearest]] = triangle[nearest]
    return index.reshape(height, width), buffer.reshape(height, width)


def _pixel_range(low: Array, high: Array, size: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first pixel i with its centre i + ½ from ``low`` to ``high``, and their number.

    Pixels are counted within 0 ≤ i < size; entry by entry of the arrays.
    """
    first = np.clip(np.ceil(low - 0.5), 0, size).astype(np.int64)
    end = np.clip(np.floor(high - 0.5) + 1, 0, size).astype(np.int64)
    return first, np.maximum(end - first, 0)


def _row_bounds(
    x: Array, y: Array, sign: Array, triangle: NDArray[np.int64], row: NDArray[np.int64],
    width: float,
) -> tuple[Array, Array]:
    """Return the least and the largest x of a triangle in a row, within 0 and ``width``.

    Inside of each edge a x + b y + c ≥ 0, with ``sign`` the orientation of the triangle: at
    y = row + ½ that bounds x from below where a > 0, from above where a < 0.
    """
    left_bound, right_bound = np.full(len(row), 0.0), np.full(len(row), width)
    for k in range(3):
        j = (k + 1) % 3
        a, b = sign * (y[:, k] - y[:, j]), sign * (x[:, j] - x[:, k])
        c = -(a * x[:, k] + b * y[:, k])
        edge_value, slope = (b[triangle] * (row + 0.5) + c[triangle]), a[triangle]
        with np.errstate(divide="ignore", invalid="ignore"):
            bound = -edge_value / slope
        left_bound = np.where(slope > 0, np.maximum(left_bound, bound), left_bound)
        right_bound = np.where(slope < 0, np.minimum(right_bound, bound), right_bound)
    return left_bound, right_bound


def _depth_planes(x: Array, y: Array, w: Array, area: Array) -> tuple[Array, Array, Array]:
    """Return w0, wx and wy of the depth w = w0 + wx x + wy y of each triangle on the screen.

    ``x``, ``y`` and ``w`` are of its corners, shape (triangles, 3); ``area`` is twice its area.
    """
    dw1, dw2 = w[:, 1] - w[:, 0], w[:, 2] - w[:, 0]
    wx = (dw1 * (y[:, 2] - y[:, 0]) - dw2 * (y[:, 1] - y[:, 0])) / area
    wy = (dw2 * (x[:, 1] - x[:, 0]) - dw1 * (x[:, 2] - x[:, 0])) / area
    return w[:, 0] - wx * x[:, 0] - wy * y[:, 0], wx, wy


def _length(vectors: Array) -> Array:
    """Return the lengths of the rows of ``vectors``, shape (rows, 1)."""
    lengths: Array = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))[:, None]
    return lengths


def _concatenate_ranges(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return 0, …, counts[0] − 1, 0, …, counts[1] − 1, … as one array."""
    range_ends = np.cumsum(counts)
    count_total = int(range_ends[-1]) if len(range_ends) else 0
    return np.arange(count_total) - np.repeat(range_ends - counts, counts)


def render(solid: Triangles, ribbons: Triangles, camera: Camera, size: tuple[int, int], *,
           up: Array, floor: float | None, cell: float, background: BackgroundName, centre: Array,
           reach: float) -> NDArray[np.uint8]:
    """Return a picture, shape (height, width, 3).

    Parameters
    ----------
    solid : Triangles
        In space.
    ribbons : Triangles
        Lines, on the screen as ``Camera.project`` has it, without light.
    camera, size : Camera, (int, int)
        The camera of a picture with this width and height in pixels.
    up : array, shape (3,)
        Unit vector in space; the lamp is above along it.
    floor : float, optional
        Height of the floor along ``up``; none without.
    cell : float
        Distance of its lines.
    background : {"light", "dark"}
        A key of ``BACKGROUNDS``.
    centre, reach : array, shape (3,), and float
        Centre and radius of the scene: the lines have faded at ``_FADE`` times the radius.
    """
    # drawn _OVER times as large, and averaged at the end, against jagged edges
    width, height = (_OVER * n for n in size)
    zoom = Camera(camera.eye, camera.axes, _OVER * camera.focus, _OVER * camera.middle)
    screen_corners = np.concatenate([zoom.project(solid.corners),
                                     ribbons.corners * [_OVER, _OVER, 1.0]])
    opaque = np.concatenate([solid.alpha, ribbons.alpha]) >= 1
    lamp = _Lamp(solid.corners[solid.alpha >= 1], camera.axes, up)
    image = _backdrop(camera, size[0], size[1], up, floor, cell, background, lamp, centre, reach)
    image = image.repeat(_OVER, axis=0).repeat(_OVER, axis=1)

    everything = Triangles(*(np.concatenate([getattr(solid, name), getattr(ribbons, name)])
                             for name in ("corners", "normals", "colours", "part", "alpha")))
    lit = np.arange(len(screen_corners)) < len(solid.part)  # in the arrays ribbons follow solids
    visible = np.flatnonzero(opaque)
    index, depth = rasterize(screen_corners[visible], width, height)
    _paint(image, index, visible, screen_corners, everything, lit, zoom, lamp)
    _outline(image, index, depth, everything.part[visible], lit[visible])
    # transparent triangles last, where no opaque one is nearer
    glass = np.flatnonzero(~opaque)
    if len(glass):
        index, _ = rasterize(screen_corners[glass], width, height, depth)
        _paint(image, index, glass, screen_corners, everything, lit, zoom, lamp)
    small = image.reshape(size[1], _OVER, size[0], _OVER, 3).mean(axis=(1, 3))
    pixels: NDArray[np.uint8] = (np.clip(small, 0, 1) * 255 + 0.5).astype(np.uint8)
    return pixels


def _paint(image: Array, index: NDArray[np.int64], triangle_numbers: NDArray[np.int64],
           screen: Array,
           triangles: Triangles, lit: NDArray[np.bool_], camera: Camera, lamp: _Lamp) -> None:
    """Shade the pixels of ``image`` that triangles cover: Lambert, Blinn-Phong, the lamp's shadow.

    colour ← colour (ambient + k_d v max(n·l, 0)) + k_s max(n·h, 0)^g, with the normal n, the
    direction l to the lamp and its visible share v, and h between l and the direction to the eye.
    ``index``, shape (height, width), has the place of the nearest triangle in ``triangle_numbers``,
    −1 for none; ``lit``, for each triangle, whether the lamp shines on it. ``screen`` as of
    ``rasterize``.
    """
    pixel_rows, pixel_columns = np.nonzero(index >= 0)
    if not len(pixel_rows):
        return
    covering = triangle_numbers[index[pixel_rows, pixel_columns]]
    px, py = pixel_columns.astype(float) + 0.5, pixel_rows.astype(float) + 0.5
    weight, nearness = _barycentric(screen[covering], px, py)
    colour = triangles.colours[covering]
    lit_fragments = lit[covering]
    normal = np.einsum("nk,nkj->nj", weight[lit_fragments],
                       triangles.normals[covering[lit_fragments]])
    normal /= np.maximum(_length(normal), 1e-12)  # opposite normals of corners may cancel
    rays = camera.rays(px[lit_fragments], py[lit_fragments])
    points = camera.eye + rays / nearness[lit_fragments, None]
    back = -rays / _length(rays)
    # both sides of a triangle are drawn: its normal is turned towards the eye
    normal *= np.where((normal * back).sum(axis=1) < 0, -1.0, 1.0)[:, None]
    facing = np.clip(normal @ lamp.towards, 0, 1) * lamp.reaches(points, normal)
    half = back + lamp.towards
    half /= _length(half)
    shine = np.clip((normal * half).sum(axis=1), 0, 1) ** _GLOSS * (facing > 0)
    ambient = _AMBIENT * (0.84 + 0.16 * (normal @ lamp.up))  # the sky is brighter than the floor
    shade = (ambient + _DIRECT * facing)[:, None]
    colour[lit_fragments] = colour[lit_fragments] * shade + _SHINE * shine[:, None]
    alpha = triangles.alpha[covering, None]
    behind = image[pixel_rows, pixel_columns]
    image[pixel_rows, pixel_columns] = (1 - alpha) * behind + alpha * np.clip(colour, 0, 1)


def _barycentric(screen: Array, px: Array, py: Array) -> tuple[Array, Array]:
    """Return the weights of a triangle's corners in space at a pixel, and its reciprocal distance.

    ``screen`` has pixel and reciprocal distance w_i of the corners, shape (n, 3, 3), ``px`` and
    ``py`` one pixel for each triangle. With the weights b_i on the screen, those in space are
    b_i w_i/Σ b_j w_j, shape (n, 3).
    """
    x, y, w = (screen[:, :, k] for k in range(3))
    area = ((x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0]))
    b1 = ((px - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (py - y[:, 0])) / area
    b2 = ((x[:, 1] - x[:, 0]) * (py - y[:, 0]) - (px - x[:, 0]) * (y[:, 1] - y[:, 0])) / area
    weight = np.stack([1 - b1 - b2, b1, b2], axis=1) * w
    nearness = weight.sum(axis=1)
    weight /= nearness[:, None]
    return weight, nearness


def _outline(
    image: Array, index: NDArray[np.int64], depth: Array, solid_of_triangle: NDArray[np.int64],
    lit: NDArray[np.bool_],
) -> None:
    """Darken pixels in front of another solid, which separates overlapping solids.

    ``image`` is changed, shape (height, width, 3); ``index`` and ``depth``, (height, width), are
    the nearest triangle of each pixel, −1 for none, and its depth. ``solid_of_triangle`` is the
    ``part`` of ``Triangles``. ``lit`` is false for the triangles of lines, which have no outline.
    """
    solid_of_pixel = np.where(index >= 0, np.where(lit[index], solid_of_triangle[index], -2), -1)
    edge = np.zeros(solid_of_pixel.shape, dtype=bool)
    for axis in (0, 1):
        for shift in (1, -1):
            # −1 is the background, −2 a line without light
            neighbour = np.roll(solid_of_pixel, shift, axis)
            in_front = depth >= np.roll(depth, shift, axis)
            edge |= (solid_of_pixel >= 0) & (neighbour != solid_of_pixel) & (neighbour != -2) & (
                in_front)
    image[edge] *= _OUTLINE


class _Lamp:
    """A distant lamp at the upper left of the camera, and the shadows of solids in its light."""

    def __init__(self, corners: Array, axes: Array, up: Array) -> None:
        """Place the lamp above the viewer's left shoulder, and draw the depths that it sees.

        ``corners`` of opaque triangles, (n, 3, 3), are projected along its direction l on a square
        of ``_LAMP`` pixels: a point is in the shadow where its depth is more than a bias behind.
        """
        right, over, back = axes
        towards = -0.5 * right + 0.2 * over + 0.65 * back + 0.8 * up
        self.towards, self.up = towards / np.linalg.norm(towards), up
        across = np.cross(self.towards, over)
        across /= np.linalg.norm(across)
        self._axes = np.stack([across, np.cross(self.towards, across), self.towards])
        # the depth map covers all corners, with a margin for the blurred edges of shadows
        lamp_corners = corners @ self._axes.T
        low, high = lamp_corners.reshape(-1, 3).min(axis=0), lamp_corners.reshape(-1, 3).max(axis=0)
        margin = 2.5 * _SOFT * _LAMP
        span = max(float((high - low)[:2].max()), 1e-12)
        self._scale = (_LAMP - 2 * margin) / span
        self._shift = margin - low[:2] * self._scale
        self._low = low[2] - span  # where the depth is 0: all corners have a larger one
        index, self._depth = rasterize(self._pixels(corners), _LAMP, _LAMP)
        # a surface does not shade itself: depths within the bias are equal
        self._bias = 0.02 * span
        self._mask = (index >= 0).astype(float)
        for _ in range(3):
            self._mask = _blur(self._mask, round(_SOFT * _LAMP))

    def _pixels(self, points: Array) -> Array:
        """Return points as the lamp sees them, shape (..., 3): pixel and depth, larger if nearer.
        """
        lamp_points = points @ self._axes.T
        return np.concatenate([lamp_points[..., :2] * self._scale + self._shift,
                               lamp_points[..., 2:] - self._low], axis=-1)

    def reaches(self, points: Array, normals: Array) -> Array:
        """Return the share of the lamp that is visible from each point, from 0 to 1."""
        # 0.6 of the bias off the surface and 0.5 in depth keep a surface from its own shadow, also
        # where light grazes it
        shadow_pixels = self._pixels(points + normals * self._bias * 0.6)
        unshadowed = np.zeros(len(points))
        # nine samples of the depth, 1.2 pixels apart, soften the edge of a shadow
        offsets = [(i, j) for i in (-1.2, 0.0, 1.2) for j in (-1.2, 0.0, 1.2)]
        for i, j in offsets:
            column = np.clip((shadow_pixels[:, 0] + i).astype(np.int64), 0, _LAMP - 1)
            row = np.clip((shadow_pixels[:, 1] + j).astype(np.int64), 0, _LAMP - 1)
            unshadowed += shadow_pixels[:, 2] + self._bias * 0.5 >= self._depth[row, column]
        return unshadowed / len(offsets)

    def darkens(self, points: Array) -> Array:
        """Return the soft shadow on a floor below all solids, from 0 to 1."""
        shadow_pixels = self._pixels(points)
        column, row = (np.clip(shadow_pixels[:, k].astype(np.int64), 0, _LAMP - 1) for k in (0, 1))
        return self._mask[row, column]


def _blur(image: Array, radius: int) -> Array:
    """Return means over squares of 2 radius + 1 pixels of an image of shape (height, width).

    Pixels outside of the image count as 0.
    """
    for axis in (0, 1):
        padded = np.pad(image, [(radius + 1, radius) if k == axis else (0, 0) for k in (0, 1)])
        # sums over a window as differences of cumulative sums, one axis after the other
        cumulative_sums = np.cumsum(padded, axis=axis)
        length = image.shape[axis]
        image = (np.take(cumulative_sums, np.arange(2 * radius + 1, 2 * radius + 1 + length), axis)
                 - np.take(cumulative_sums, np.arange(length), axis)) / (2 * radius + 1)
    return image


def _backdrop(camera: Camera, width: int, height: int, up: Array, floor: float | None, cell: float,
              background: BackgroundName, lamp: _Lamp, centre: Array, reach: float) -> Array:
    """Return the background: a gradient, and the floor with its lines and shadows.

    The ray of each pixel hits the floor, the plane x·up = floor, at the distance
    (floor − eye·up)/(ray·up) along the axis of sight.
    """
    above, below, line = (np.array(c) for c in BACKGROUNDS[background])
    s = (np.arange(height) + 0.5)[:, None, None] / height
    image = np.broadcast_to(above + (below - above) * s, (height, width, 3)).copy()
    if floor is None:
        return image
    y, x = np.mgrid[0:height, 0:width] + 0.5
    rays = camera.rays(x, y)
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (floor - camera.eye @ up) / (rays @ up)
    # in front of the eye, and within the radius at which the lines have faded
    on_floor = np.isfinite(distance) & (distance > 0)
    points_ahead = camera.eye + rays[on_floor] * distance[on_floor][:, None]
    on_floor[on_floor] = _length(points_ahead - centre)[:, 0] < _FADE * reach
    rays, distance = rays[on_floor], distance[on_floor]
    floor_points = camera.eye + rays * distance[:, None]
    fade = np.clip(_FADE - _length(floor_points - centre)[:, 0] / reach, 0, 1)
    lines = _floor_lines(floor_points, rays, distance / camera.focus, up, cell)
    strength = (lines * fade)[:, None]
    drawn_floor = image[on_floor] * (1 - _LINE * strength) + _LINE * strength * line
    image[on_floor] = drawn_floor * (1 - _FLOOR_SHADOW * lamp.darkens(floor_points)[:, None])
    return image


def _floor_lines(points: Array, rays: Array, pixel: Array, up: Array, cell: float) -> Array:
    """Return how much of each point of the floor a line covers, from 0 to 1; shape (points,).

    Lines are ``cell`` apart in two directions and one pixel wide; far away they fade before they
    meet. ``rays`` lead from the eye to the points, where a pixel has the width ``pixel`` across.
    """
    x_axis = np.eye(3)[np.argmin(np.abs(up))]
    x_axis = x_axis - (x_axis @ up) * up
    x_axis /= np.linalg.norm(x_axis)
    across = np.stack([x_axis, np.cross(up, x_axis)])
    coordinates = points @ across.T / cell  # whole on a line
    # a ray at the angle α to the floor makes a pixel 1/sin α times longer along its direction
    grazing = np.clip(np.abs(rays @ up) / _length(rays)[:, 0], 0.02, 1)
    direction = rays @ across.T
    direction = np.abs(direction) / np.maximum(_length(direction), 1e-12)
    extent = (pixel / cell)[:, None] * (1 + direction * (1 / grazing[:, None] - 1))
    line_distance = np.abs(coordinates - np.round(coordinates))
    # lines fade to 0 at a distance of a pixel, and where a pixel is half as wide as a cell
    covered = np.clip(1.1 - line_distance / extent, 0, 1) * np.clip(1.4 - 3 * extent, 0, 1)
    strength: Array = covered.max(axis=1)
    return strength


def encode_png(pixels: NDArray[np.uint8]) -> bytes:
    """Return a picture of shape (height, width, 3) as a PNG file."""
    height, width, _ = pixels.shape
    previous_rows = np.zeros_like(pixels)
    previous_rows[1:] = pixels[:-1]
    filter_up = np.full((height, 1), 2, np.uint8)  # PNG filter 2: differences to the row above
    filtered_rows = np.concatenate(
        [filter_up, (pixels - previous_rows).reshape(height, -1)], axis=1)

    def chunk(kind: bytes, data: bytes) -> bytes:
        """Return a chunk: its length, kind and bytes, and the CRC of the last two."""
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    # 8 bits a channel, colour type 2 (RGB), and the only methods there are
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head)
            + chunk(b"IDAT", zlib.compress(filtered_rows.tobytes(), level=9))
            + chunk(b"IEND", b""))
