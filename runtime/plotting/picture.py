"""A picture of a run as a PNG file, without matplotlib and without a browser."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import as_flag, as_path, choose, shown
from ...core.errors import InputError
from ...core.file_formats import ending_of, result_file
from ...core.inertia import real_array
from ...core.shapes import Shape, axes_about
from ..rigid_body.quaternion import rotation_matrix
from .body_shapes import METAL, STAND
from .html_view import with_visuals
from .meshes import IndexedMesh
from .rasterizer import (
    BACKGROUNDS,
    BackgroundName,
    Camera,
    Triangles,
    encode_png,
    rasterize,
    render,
)
from .scene import JOINT, ROD, Scene, ScenePart, Tie, is_held, scene_of
from .solids import COARSE, COLOURS, Mesh, colour_of, mesh_of, mesh_of_file, tube

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory

__all__ = ["BackgroundName", "RenderedPicture", "SceneDrawing", "check_picture_file",
           "draw_picture", "draw_scene"]

Array = NDArray[np.float64]

#: States of which the one with the largest extent is shown, points of a trace; poses in all.
_FRAMES, _POSES = 4000, 40_000
#: Pixels of a side: fewer show nothing, more take seconds.
_LEAST, _MOST = 16, 4096
#: Distance of the eye, in radii of the scene, and how much of the picture the scene fills.
_AWAY, _FILL = 5.0, 0.90
#: Radii of a spring's wire and coil in parts of the reach of the scene.
_WIRE, _COIL = 0.0055, 0.026
#: Spheres of more shapes have fewer triangles.
_COARSE = 100
#: Opacity of glass.
_GLASS = 0.25
#: Windings of a spring.
_TURNS = 9
#: Width of a trace in pixels of a picture 480 pixels high.
_TRACE = 2.2
#: A motion in a plane is seen from this far beside the normal of the plane, in degrees.
_ASIDE = 18.0


class RenderedPicture:
    """A picture of bodies; Jupyter shows it where it is the last value of a cell.

    Attributes
    ----------
    pixels : array of uint8, shape (height, width, 3)
    time : float
        Time of the state shown.
    path : Path or None
        Where it was written.
    """

    def __init__(self, title: str, pixels: NDArray[np.uint8], time: float) -> None:
        self._title, self.pixels, self.time = title, pixels, time
        self.path: Path | None = None

    def __repr__(self) -> str:
        height, width, _ = self.pixels.shape
        where = "" if self.path is None else f" in {str(self.path)!r}"
        return f"<picture of {self._title} at t = {self.time:g}: {width} × {height}{where}>"

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the picture to a file whose name ends in .png; return its path.

        Raises
        ------
        InputError
            For another ending.
        GyrosparkError
            If the file cannot be written.
        """
        self.path = check_picture_file(path)
        with result_file(self.path, "The picture") as partial_file:
            partial_file.write_bytes(encode_png(self.pixels))
        return self.path

    def _repr_png_(self) -> bytes:
        """Return the PNG for Jupyter."""
        return encode_png(self.pixels)


def check_picture_file(path: str | os.PathLike[str]) -> Path:
    """Return the path if a picture of bodies can be written as such a file.

    Raises
    ------
    InputError
        For another ending than .png.
    """
    target = as_path("path", path, "top.png")
    if ending_of(target) != ".png":
        raise InputError(f"A picture of bodies cannot be written as {target.name!r}; end it in "
                         ".png. plot writes curves as .svg and .pdf.")
    return target


def draw_picture(
    trajectory: Trajectory, path: str | os.PathLike[str] | None = None, *,
    size: tuple[int, int] = (640, 480), time: float | None = None, azimuth: float | None = None,
    elevation: float | None = None, background: BackgroundName = "light", traces: bool = True,
) -> RenderedPicture:
    """Return a picture of one state, and write it where a path is given.

    Bodies are drawn from their inertia and joints: a body that spins on a point as a top, one that
    turns about its symmetry axis as a wheel, a body between joints as bars, a body around others as
    a box of glass.

    Parameters
    ----------
    trajectory : Trajectory
        Of at least one rigid body.
    path : path, optional
        A name that ends in .png.
    size : (int, int)
        Width and height in pixels, from 16 to 4096.
    time : float, optional
        The stored state nearest to this time is shown; default: the one of largest extent.
    azimuth, elevation : float, optional
        Direction of the camera in degrees: about the vertical, and above the horizon, from −90
        to 90. Default: a motion in a plane is seen from the front.
    background : {"light", "dark"}
    traces : bool
        Whether the paths of the bodies up to this time are drawn.

    Raises
    ------
    InputError
        Where there is no rigid body, and for other values.
    GyrosparkError
        If the file cannot be written.
    """
    target = None if path is None else check_picture_file(path)
    choose("background", background, tuple(BACKGROUNDS))
    traces = as_flag("traces", traces)
    # the poses of all bodies together are bounded
    count = min(_FRAMES, max(2, _POSES // max(len(trajectory.bodies), 1)))
    if time is None:
        scene, frame = scene_of(trajectory, count), None
    else:
        t = trajectory.t.astype(float)
        shown_time = _number("time", time, -1e300, 1e300, "a number of seconds")
        nearest = int(np.argmin(np.abs(t - shown_time)))
        scene = scene_of(trajectory, count, include=nearest)
        frame = int(np.argmin(np.abs(scene.t - t[nearest])))
    scene_with_visuals, meshes = with_visuals(trajectory, scene, meshes="small")
    picture = draw_scene(scene_with_visuals, meshes, size=size, frame=frame, azimuth=azimuth,
                         elevation=elevation, background=background, traces=traces)
    if target is not None:
        picture.save(target)
    return picture


def draw_scene(
    scene: Scene, files: Mapping[str, IndexedMesh] | None = None, *,
    size: tuple[int, int] = (640, 480), frame: int | None = None,
    azimuth: float | None = None, elevation: float | None = None,
    background: BackgroundName = "light", traces: bool = True,
) -> RenderedPicture:
    """Return a picture of a scene at ``scene.t[frame]``, by default the frame of largest extent.

    ``files``: name of a mesh file → its mesh. Other arguments as for ``draw_picture``.
    """
    shown_frame = _widest(scene) if frame is None else frame
    drawing = SceneDrawing(scene, files or {}, [shown_frame], size=size, azimuth=azimuth,
                           elevation=elevation, background=background, traces=traces)
    return RenderedPicture(scene.title, drawing.pixels(shown_frame), float(scene.t[shown_frame]))


class SceneDrawing:
    """A scene before one camera, which has some of its frames in view; see ``draw_picture``."""

    def __init__(
        self, scene: Scene, files: Mapping[str, IndexedMesh], frames: Sequence[int], *,
        size: tuple[int, int], azimuth: float | None = None, elevation: float | None = None,
        background: BackgroundName = "light", traces: bool = True,
    ) -> None:
        """Choose the camera's direction, where none is given, and a frame that all states fit into.
        """
        self.scene, self.files, self.size, self.background = scene, files, _size(size), background
        self.paths = _paths(scene)
        self._meshes = {frame: list(_meshes(scene, frame, files)) for frame in frames}
        solid = _triangles([mesh for meshes in self._meshes.values() for mesh in meshes])
        self.traced = _traced_bodies(scene, self.paths) if traces else []
        lines = self._lines(max(frames))
        #: Height of the floor, where there is gravity, and supports of the bodies on it.
        self.floor: float | None = None
        self.stands: list[_DrawnMesh] = []
        if scene.gravity:
            self.floor = _lowest_height(scene, [solid.corners, *lines])
            self.stands = list(_supports(scene, frames[0], self.floor))
        framed = np.concatenate([solid.corners.reshape(-1, 3), *lines]
                                + [mesh.points for mesh, _, _ in self.stands])
        low, high = framed.min(axis=0), framed.max(axis=0)
        #: The centre of all points, and half the diagonal of their box.
        self.centre = (low + high) / 2
        self.reach = max(float(np.linalg.norm(high - low)) / 2, 1e-12)
        axes = _sight(scene.up, *self._camera_direction(
            frames, solid.corners, azimuth, elevation))
        eye = self.centre + _AWAY * self.reach * axes[2]
        self.camera = _camera(framed, eye, axes, *self.size)

    def _camera_direction(
        self, frames: Sequence[int], corners: Array, azimuth: float | None,
        elevation: float | None,
    ) -> tuple[float, float]:
        """Return azimuth and elevation in radians.

        The azimuth is the argument, or by the plane of the motion, or across a leaning top, or the
        one from which most of the triangles, ``corners``, is seen.
        """
        facing, tilt = _direction(self.scene, self.paths)
        if azimuth is not None:
            facing = np.radians(_number("azimuth", azimuth, -1e9, 1e9, "an angle in degrees"))
        if elevation is not None:
            tilt = np.radians(_number("elevation", elevation, -90, 90, "degrees from -90 to 90"))
        if facing is None:
            facing = _across_a_top(self.scene, frames)
        if facing is None:
            facing = _best_azimuth(corners, self.scene.up, tilt)
        return facing, tilt

    def pixels(self, frame: int) -> NDArray[np.uint8]:
        """Return a frame, shape (height, width, 3)."""
        meshes = self._meshes.get(frame) or list(_meshes(self.scene, frame, self.files))
        ribbons = _ribbons(self.camera, self._lines(frame),
                           [colour_of(_body_colour(i)) for i in self.traced],
                           _TRACE * self.size[1] / 480)
        return render(_triangles(meshes + self.stands), ribbons, self.camera, self.size,
                      up=self.scene.up, floor=self.floor, cell=_cell(self.reach),
                      background=self.background, centre=self.centre, reach=self.reach)

    def _lines(self, frame: int) -> list[Array]:
        """Return the traces up to a frame."""
        return [self.paths[: frame + 1, i] for i in self.traced]


def _lowest_height(scene: Scene, points: Sequence[Array]) -> float:
    """Return the least x·up of points, shapes (..., 3), and of the bodies during the run."""
    frames = np.unique(np.linspace(0, len(scene.t) - 1, 100).astype(int))
    return float(min((x @ scene.up).min() for x in (*points, scene.points(frames))))


def _number(name: str, argument: Any, low: float, high: float, allowed: str) -> float:
    """Return a number from ``low`` to ``high``; ``allowed`` says in the error what to give."""
    array = real_array(argument)
    if array is None or array.ndim or not low <= float(array) <= high:
        raise InputError(f"{name} = {shown(argument)} is no direction or time of a picture; give "
                         f"{allowed}.")
    return float(array)


def _size(size: Any) -> tuple[int, int]:
    """Return width and height of a picture in pixels, or raise InputError."""
    array = real_array(size)
    if (array is None or array.shape != (2,) or (array != np.round(array)).any()
            or array.min() < _LEAST or array.max() > _MOST):
        raise InputError(f"size = {shown(size)} is no size of a picture; give its width and height "
                         f"in pixels, two whole numbers from {_LEAST} to {_MOST}.")
    return int(array[0]), int(array[1])


def _point_in_space(scene: Scene, frame: int, i: int, r: Array) -> Array:
    """Return the point r of body i in space at a frame; body −1 is the ground."""
    if i < 0:
        return r
    body = scene.parts[i]
    point: Array = body.x[frame] + rotation_matrix(body.q[frame]) @ r
    return point


def _paths(scene: Scene) -> Array:
    """Return the tip of each body in space, shape (frames, bodies, 3)."""
    return np.stack([body.at(body.tip)[:, 0] for body in scene.parts], axis=1)


def _widest(scene: Scene) -> int:
    """Return the latest frame at which the extent of the scene is within 2 % of its maximum."""
    frames = np.unique(np.linspace(0, len(scene.t) - 1, 100).astype(int))
    points = scene.points(frames)
    # the diagonal of the box around all points
    extent = np.linalg.norm(np.ptp(points, axis=1), axis=1)
    return int(frames[np.flatnonzero(extent >= 0.98 * extent.max())[-1]])


def _basis(up: Array) -> tuple[Array, Array]:
    """Return two horizontal unit vectors, orthogonal to ``up``; azimuths count from the first one.
    """
    # x, or y where x is nearly vertical
    first = np.array([1.0, 0, 0]) if abs(up[0]) < 0.9 else np.array([0, 1.0, 0])
    first = first - (first @ up) * up
    first = first / np.linalg.norm(first)
    return first, np.cross(up, first)


def _direction(scene: Scene, paths: Array) -> tuple[float | None, float]:
    """Return azimuth and elevation of the camera in radians, by the plane of the motion.

    The singular values of all displacements of points of the bodies say whether they lie in a
    plane; the right singular vector of the least one is its normal. A vertical plane is seen from
    beside its normal, a horizontal one from above. The azimuth is None for a motion in space.
    """
    frames = np.unique(np.linspace(0, len(scene.t) - 1, 60).astype(int))
    x_axis, y_axis = _basis(scene.up)
    displacements = []
    for body in scene.parts:
        size = float(body.sizes["box"].max())
        # three points, on its principal axes: they show rotations as well
        axis_ends = body.at(body.centre + size * body.axes.T)[frames]
        displacements.append((axis_ends - axis_ends[0]).reshape(-1, 3))
    _, spread, directions = np.linalg.svd(np.concatenate(displacements), full_matrices=False)
    if spread[2] < 2e-3 * spread[1]:  # a motion in a plane
        normal = directions[2]
        if abs(normal @ scene.up) < 0.3:  # a vertical plane, nearly
            # of both normals the one towards −y, from where pictures are usually seen
            normal = normal * (-1 if normal @ y_axis > 1e-9 else 1)
            facing = float(np.arctan2(normal @ y_axis, normal @ x_axis))
            return facing + np.radians(_ASIDE), np.radians(13.0)
        # a horizontal plane, in which not only attitudes change
        if abs(normal @ scene.up) > 0.9 and np.ptp(paths, axis=0).max() > 0:
            return None, np.radians(38.0)
    return None, np.radians(16.0)


def _across_a_top(scene: Scene, frames: Sequence[int]) -> float | None:
    """Return the azimuth across the lean of a top, from where its flywheel does not hide its point.

    None where there is no top, or where it stands upright.
    """
    if scene.parts[0].rim is None or len(scene.parts) > 1:
        return None
    axis = (rotation_matrix(scene.parts[0].q[frames]) @ scene.parts[0].axes[:, 2]).mean(axis=0)
    x_axis, y_axis = _basis(scene.up)
    lean = np.array([axis @ x_axis, axis @ y_axis])
    return None if np.linalg.norm(lean) < 0.05 else float(np.arctan2(-lean[0], lean[1]))


def _best_azimuth(corners: Array, up: Array, tilt: float) -> float:
    """Return the azimuth in radians, near −50°, from which the bodies cover the most pixels.

    ``corners`` of their triangles, shape (n, 3, 3), are drawn small from six directions.
    """
    best_facing, largest_area, size = 0.0, -1.0, 72
    for degrees in range(-140, 40, 30):
        facing = np.radians(degrees)
        screen_corners = corners @ _sight(up, facing, tilt).T
        screen_points = screen_corners.reshape(-1, 3)
        low = screen_points.min(axis=0)
        scale = size / max(float((screen_points.max(axis=0) - low)[:2].max()), 1e-12)
        # depths above 0, which is the depth of no triangle
        index, _ = rasterize((screen_corners - low) * scale + [0, 0, 1], size, size)
        # the usual direction decides between areas that differ by less than 15 %
        area = float((index >= 0).sum()) / scale**2 * (1.12 - 0.0016 * abs(degrees + 50))
        if area > largest_area:
            best_facing, largest_area = float(facing), area
    return best_facing


def _sight(up: Array, facing: float, tilt: float) -> Array:
    """Return the axes of a camera as rows: right, over, and back towards the eye."""
    first, second = _basis(up)
    back = np.cos(tilt) * (np.cos(facing) * first + np.sin(facing) * second) + np.sin(tilt) * up
    right = np.cos(facing) * second - np.sin(facing) * first
    return np.stack([right, np.cross(back, right), back])


def _traced_bodies(scene: Scene, paths: Array) -> list[int]:
    """Return the numbers of the bodies whose paths are drawn.

    Of at most twelve bodies, those that move by 8 % of the scene: one or two of them, else the
    last. ``paths`` has the tips, shape (frames, bodies, 3).
    """
    extent = np.linalg.norm(np.ptp(paths, axis=0), axis=1)
    size = max(float(np.linalg.norm(np.ptp(paths.reshape(-1, 3), axis=0))), 1e-12)
    moving = np.flatnonzero(extent > 0.08 * size)
    if len(scene.parts) > 12:
        return []
    return [int(i) for i in (moving if len(moving) <= 2 else moving[-1:])]


def _body_colour(i: int) -> str:
    """Return the colour of body i, "#rrggbb"."""
    return COLOURS[i % len(COLOURS)]


class _DrawnMesh(NamedTuple):
    """A mesh in space as it is drawn."""

    mesh: Mesh
    colour: Array  # red, green and blue, from 0 to 1
    opacity: float = 1.0


class _Pivot(NamedTuple):
    """A body that the ground holds at a point."""

    body: ScenePart
    point: Array  # in space, shape (3,), m
    axis: Array | None  # of a hinge, a unit vector in space


def _meshes(scene: Scene, frame: int, files: Mapping[str, IndexedMesh],
            ) -> Iterator[_DrawnMesh]:
    """Yield the meshes of ground, bodies and ties in a frame, its number in ``scene.t``."""
    reach = scene.reach(frame)
    # light = 0, here and below: no faces are lighter than others
    for shape in (*scene.ground, *scene.joints_on(-1, reach)):
        mesh = mesh_of_file(shape, files[shape.file]) if shape.file else mesh_of(shape)
        yield _DrawnMesh(replace(mesh, light=0 * mesh.light), colour_of(shape.colour or STAND))
    # segments of a circle: few of them if there are many shapes, which are small on the picture
    around = (COARSE,) * (sum(len(body.shapes) for body in scene.parts) > _COARSE)
    for i, body in enumerate(scene.parts):
        R, x = rotation_matrix(body.q[frame]), body.x[frame]
        shapes = [*(body.shapes or [Shape("box", body.sizes["box"], body.centre, body.axes)]),
                  *scene.joints_on(i, reach)]
        shapes_with_opacity = [(shape, 1.0) for shape in shapes]
        if body.glass:  # a frame has panes inside of its edges
            pane = Shape("box", 0.96 * body.sizes["box"], body.centre, body.axes)
            shapes_with_opacity.append((pane, _GLASS))
        for shape, alpha in shapes_with_opacity:
            mesh = (mesh_of_file(shape, files[shape.file]) if shape.file else
                    mesh_of(shape, *around))
            light = 0 * mesh.light if shape.colour else mesh.light
            yield _DrawnMesh(Mesh(x + mesh.points @ R.T, mesh.normals @ R.T, mesh.faces, light),
                             colour_of(shape.colour or _body_colour(i)), alpha)
    for tie in scene.ties:
        for mesh, colour in () if scene.hides(tie) else _tie_meshes(scene, tie, frame, reach):
            yield _DrawnMesh(replace(mesh, light=0 * mesh.light), colour_of(colour))


def _supports(scene: Scene, frame: int, floor: float) -> Iterator[_DrawnMesh]:
    """Yield supports of the bodies that the ground holds: one post, two at a hinge, a plate above.

    ``floor`` is the height of the floor in m. The plate is above the point if the body hangs below
    it. A vertical hinge of a body that reaches down to the floor has no support.
    """
    up, metal = scene.up, colour_of(STAND)
    r = JOINT * scene.reach(frame)
    for body, pivot, axis in _pivots(scene):
        if body.own:  # the model's visuals show what holds it
            continue
        hangs = float(np.max(body.at(body.centre)[:, 0] @ up)) < pivot @ up
        R = rotation_matrix(body.q[frame])
        lowest = min(float((mesh_of(shape).points @ R.T @ up).min()) for shape in body.shapes)
        height = float(pivot @ up) - floor
        # a body that turns about a vertical axis and reaches down to the floor
        if axis is not None and abs(axis @ up) >= 0.5 and (
                lowest + body.x[frame] @ up < floor + 2 * r):
            continue
        feet = [np.zeros(3)]
        if axis is not None and abs(axis @ up) < 0.5:  # a horizontal hinge is held at both sides
            feet = [2.6 * r * side * axis for side in (-1, 1)]
        shapes: Iterable[Shape] = ()
        if hangs:
            shapes = _ceiling_shapes(pivot, feet, up, r)
        elif height >= 2 * r:  # a lower pivot leaves no room for a post
            shapes = _post_shapes(pivot, feet, up, r, height)
        for shape in shapes:
            mesh = mesh_of(shape)
            yield _DrawnMesh(replace(mesh, light=0 * mesh.light), metal)


def _ceiling_shapes(pivot: Array, feet: list[Array], up: Array, r: float) -> Iterator[Shape]:
    """Yield short bars from a pivot up to a plate, one at each of ``feet`` beside it."""
    for foot in feet:
        yield Shape.bar(pivot + foot, pivot + foot + 2.4 * r * up, 0.55 * r)
    yield Shape("disc", np.array([4 * r, 4 * r, 0.4 * r]), pivot + 2.8 * r * up, axes_about(up))


def _post_shapes(
    pivot: Array, feet: list[Array], up: Array, r: float, height: float
) -> Iterator[Shape]:
    """Yield a post with its foot plate from the floor, ``height`` below a pivot, for each foot."""
    top = 0 if len(feet) == 2 else -r  # one post ends below the ball, two end at the pin
    for foot in feet:
        yield Shape.bar(pivot + foot + top * up, pivot + foot - height * up, 0.55 * r)
        yield Shape("disc", np.array([1.6 * r, 1.6 * r, 0.25 * r]),
                    pivot + foot + (0.25 * r - height) * up, axes_about(up))


def _pivots(scene: Scene) -> Iterator[_Pivot]:
    """Yield the pivots of the bodies that a point or a hinge fixes to the ground."""
    for i, body in enumerate(scene.parts):
        if is_held(scene.parts, scene.ties, i):
            yield _Pivot(body, body.x[0], axis=None)
    for tie in scene.ties:
        # the ground has the index −1
        if min(tie.a, tie.b) < 0 and tie.kind in ("ball", "hinge") and not tie.slides:
            body = scene.parts[max(tie.a, tie.b)]
            axis = tie.axis  # in the axes of b
            if axis is not None and tie.b >= 0:
                axis = rotation_matrix(body.q[0]) @ axis
            yield _Pivot(body, tie.on_a if tie.a < 0 else tie.on_b, axis)


def _tie_meshes(scene: Scene, tie: Tie, frame: int, reach: float) -> Iterator[tuple[Mesh, str]]:
    """Yield the meshes of a tie in space with their colours: a rail, a rod, or a coil spring.

    The wire of a spring from a to b, with e along it and u, v across, is the helix

        x(s) = a + s (b − a) + r(s) (cos φ u + sin φ v)

    whose radius r and angle φ are 0 and constant near its ends, s < 0.08 and s > 0.92.
    """
    a, b = (_point_in_space(scene, frame, i, point)
            for i, point in ((tie.a, tie.on_a), (tie.b, tie.on_b)))
    along = float(np.linalg.norm(b - a))
    if tie.slides and tie.axis is not None:
        yield mesh_of(_rail(scene, tie, frame, 0.5 * JOINT * reach)), STAND
    elif tie.kind == "rod" and along > 0:
        yield mesh_of(Shape.bar(a, b, ROD * reach)), METAL
    elif tie.kind == "spring" and along > 0:
        s = np.linspace(0, 1, 20 * _TURNS + 1)
        u, v, e = axes_about((b - a) / along).T
        # straight ends of a tenth of the length, and between them the windings
        coil_share = np.clip((s - 0.1) / 0.8, 0, 1)
        coil_radius = _COIL * reach * np.clip(8 * np.minimum(s - 0.08, 0.92 - s), 0, 1)[:, None]
        turn = 2 * np.pi * _TURNS * coil_share[:, None]
        yield tube(a + along * s[:, None] * e + coil_radius * (np.cos(turn) * u + np.sin(turn) * v),
                   _WIRE * reach), METAL


def _rail(scene: Scene, tie: Tie, frame: int, radius: float) -> Shape:
    """Return the bar on which b slides, as long as its travel e·(r_b − r_a) over the run.

    e is the axis of the tie, fixed in b; the bar has ``radius`` and sticks out at both ends.
    """
    axis = np.zeros(3) if tie.axis is None else tie.axis
    frames = np.unique(np.linspace(0, len(scene.t) - 1, 100).astype(int))
    slider_positions = scene.parts[tie.b].at(tie.on_b)[frames, 0] if tie.b >= 0 else tie.on_b[None]
    R = [np.eye(3) if tie.b < 0 else rotation_matrix(scene.parts[tie.b].q[k]) for k in frames]
    axes = np.array([turn @ axis for turn in R])
    starts = np.array([_point_in_space(scene, int(k), tie.a, tie.on_a) for k in frames])
    # along the axis, which may turn with its body
    travel = np.einsum("ij,ij->i", slider_positions - starts, axes)
    overhang = 4 * radius
    first, last = min(travel.min(), 0) - overhang, max(travel.max(), 0) + overhang
    present = int(np.argmin(np.abs(frames - frame)))
    return Shape.bar(starts[present] + first * axes[present],
                     starts[present] + last * axes[present], radius)


def _triangles(meshes: list[_DrawnMesh]) -> Triangles:
    """Return the triangles of meshes with their colours and opacities as one set.

    Light faces are mixed with white. Neighbours in the list with one colour count as one solid.
    """
    corners, normals, colours, solid_numbers, alphas = [], [], [], [], []
    solid_number, previous_key = 0, None
    for mesh, colour, alpha in meshes:
        key = (*colour, alpha)
        solid_number += key != previous_key  # no outline between neighbours of one colour
        previous_key = key
        corners.append(mesh.points[mesh.faces])
        normals.append(mesh.normals[mesh.faces])
        colours.append(colour + 0.6 * mesh.light[:, None] * (1 - colour))
        solid_numbers.append(np.full(len(mesh.faces), solid_number))
        alphas.append(np.full(len(mesh.faces), alpha))
    return Triangles(np.concatenate(corners), np.concatenate(normals), np.concatenate(colours),
                     np.concatenate(solid_numbers), np.concatenate(alphas))


def _camera(points: Array, eye: Array, axes: Array, width: int, height: int) -> Camera:
    """Return the camera at ``eye`` whose picture, width × height pixels, the points fill.

    focus = fill · min(width/Δx, height/Δy), of the extents Δx and Δy of the points as projected
    with the focus 1.
    """
    pixels = Camera(eye, axes, focus=1.0, middle=np.zeros(2)).project(points)[:, :2]
    lowest, highest = pixels.min(axis=0), pixels.max(axis=0)
    span = np.maximum(highest - lowest, 1e-12)
    focus = _FILL * float(min(width / span[0], height / span[1]))
    return Camera(eye, axes, focus,
                  np.array([width, height]) / 2 - focus * (lowest + highest) / 2)


def _ribbons(camera: Camera, lines: list[Array], colours: list[Array], width: float) -> Triangles:
    """Return lines as strips on the screen, slightly nearer than the surfaces they touch.

    A strip has two triangles for each piece of its line, ``width`` pixels wide across it; at the
    joints of pieces the two normals are averaged.
    """
    corners, shades = [], []
    for line, colour in zip(lines, colours, strict=True):
        pixels = camera.project(line)
        distinct = np.append(True, np.linalg.norm(np.diff(pixels[:, :2], axis=0), axis=1) > 0.05)
        pixels = pixels[distinct]
        if len(pixels) < 2:
            continue
        step = np.diff(pixels[:, :2], axis=0)
        step /= np.linalg.norm(step, axis=1, keepdims=True)
        across = np.stack([-step[:, 1], step[:, 0]], axis=1)
        joint = np.concatenate([across[:1], across[1:] + across[:-1], across[-1:]])
        # the bound keeps a sharp turn, whose normals cancel, from becoming a spike
        joint /= np.maximum(np.linalg.norm(joint, axis=1, keepdims=True), 0.3)
        offset = np.column_stack([joint * width / 2, np.zeros(len(joint))])
        # depth is the reciprocal distance: larger by 0.05 %, the surface below hides no line
        raised_pixels = pixels * [1, 1, 1.0005]
        left_edge, right_edge = raised_pixels + offset, raised_pixels - offset
        corners += [np.stack([left_edge[:-1], right_edge[:-1], right_edge[1:]], axis=1),
                    np.stack([left_edge[:-1], right_edge[1:], left_edge[1:]], axis=1)]
        shades += [np.broadcast_to(0.85 * colour, (len(step), 3))] * 2
    n = sum(len(c) for c in corners)
    if not n:
        return Triangles(np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)),
                         np.zeros(0, np.int64), np.zeros(0))
    # −2 is no solid: lines have no outline
    return Triangles(np.concatenate(corners), np.zeros((n, 3, 3)), np.concatenate(shades),
                     part=np.full(n, -2), alpha=np.ones(n))


def _cell(reach: float) -> float:
    """Return the distance of the floor's lines: the largest 1, 2 or 5 times 10^k up to reach/2."""
    power = 10.0 ** np.floor(np.log10(0.5 * reach))
    times = 0.5 * reach / power
    return float(power * (5 if times >= 5 else 2 if times >= 2 else 1))
