"""Pictures of bodies: pixels of known shapes, shapes with the inertia of their bodies, files."""

from __future__ import annotations

import struct
import zlib
from types import SimpleNamespace

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import RUN, TOP
from gyrospark.core.shapes import Shape
from gyrospark.runtime.plotting.body_shapes import rim_of
from gyrospark.runtime.plotting.picture import SceneDrawing, draw_picture, draw_scene
from gyrospark.runtime.plotting.rasterizer import rasterize
from gyrospark.runtime.plotting.scene import drawn_joints, is_held, scene_of
from gyrospark.runtime.plotting.solids import colour_of, mesh_of

SMALL = {"size": (120, 90)}


@pytest.fixture(scope="module")
def top(gl3):
    return gl3.integrate(TOP.q0, TOP.p0, steps=60, **RUN)


def motion_of(name):
    case, step = systems.case(name), systems.stepper(name)
    return step.integrate(*systems.start(name, step), dt=1e-3, steps=3, parameters=case.parameters)


def test_motors_of_hinges_are_not_drawn():
    """A force along the angle of a joint has no place of its own."""
    joints = drawn_joints(systems.stepper("arm", "IMS").manifest)
    assert {name: kind for name, (kind, _) in joints.items()} == {
        "hinge0": "hinge", "hinge1": "hinge"}


def decoded(data):
    """Return the pixels of a PNG of 8 bits with filters 0 and 2, by the definition of PNG."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    chunks, offset = {}, 8
    while offset < len(data):
        length, kind = struct.unpack(">I4s", data[offset:offset + 8])
        body = data[offset + 8:offset + 8 + length]
        assert struct.unpack(">I", data[offset + 8 + length:offset + 12 + length])[0] == zlib.crc32(
            kind + body)
        chunks[kind], offset = body, offset + 12 + length
    width, height, depth, colour = struct.unpack(">IIBB", chunks[b"IHDR"][:10])
    assert (depth, colour) == (8, 2)
    rows = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(height, -1)
    pixels, above = [], np.zeros(3 * width, np.uint8)
    for row in rows:
        assert row[0] in (0, 2)
        above = row[1:] + (above if row[0] == 2 else 0)
        pixels.append(above)
    return np.array(pixels).reshape(height, width, 3)


def test_fragments_are_those_of_each_pixel_and_the_nearest_remains():
    rng = np.random.default_rng(4)
    screen = rng.uniform(-5, 25, (40, 3, 3))
    screen[..., 2] = rng.uniform(0.1, 1, (40, 3))
    index, depth = rasterize(screen, 20, 15)
    y, x = np.mgrid[0:15, 0:20] + 0.5
    best, nearest = np.zeros((15, 20)), np.full((15, 20), -1)
    for k, ((ax, ay, aw), (bx, by, bw), (cx, cy, cw)) in enumerate(screen):
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        v = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
        w = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
        deep = np.where((v >= 0) & (w >= 0) & (v + w <= 1), aw + v * (bw - aw) + w * (cw - aw), 0)
        nearest, best = np.where(deep > best, k, nearest), np.maximum(deep, best)
    assert (nearest >= 0).mean() > 0.5
    assert np.array_equal(index, nearest)
    assert np.abs(depth - best).max() < 1e-9
    hidden, _ = rasterize(screen[:0], 20, 15, depth)
    assert (hidden == -1).all()


def test_meshes_are_closed_and_as_large_as_their_shapes():
    """Signed tetrahedra of all faces, turned outwards by normals, have the volume of the shape."""
    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    r, h, centre = 0.3, 0.8, np.array([1.0, -2.0, 0.5])
    for kind, size, volume, error in (
            ("box", (0.4, 0.5, 0.6), 8 * 0.4 * 0.5 * 0.6, 0.02),
            ("sphere", (0.4, 0.5, 0.6), 4 / 3 * np.pi * 0.4 * 0.5 * 0.6, 0.02),
            ("disc", (r, 1.2 * r, h), 2 * np.pi * 1.2 * r**2 * h, 0.02),
            ("bar", (r, r, h), 2 * np.pi * r**2 * h + 4 / 3 * np.pi * r**3, 0.04)):
        mesh = mesh_of(Shape(kind, np.array(size), centre, axes))
        corners, normals = mesh.points[mesh.faces] - centre, mesh.normals[mesh.faces].sum(axis=1)
        crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        outwards = np.sign((crossed * normals).sum(axis=1))[:, None] * crossed
        assert abs((outwards * corners[:, 0]).sum() / 6 / volume - 1) < error, kind
        assert np.abs(outwards.sum(axis=0)).max() < 1e-12 * np.abs(outwards).sum()
        assert np.abs(np.linalg.norm(mesh.normals, axis=1) - 1).max() < 1e-12


def test_a_top_of_unknown_mass_is_a_rim_with_its_moments_and_weight(top):
    """Moments about the fixed point are b²/2 + l², a²/2 + l², (a² + b²)/2 times the mass m."""
    for moments, weight in (([0.002, 0.002, 0.0008], 0.3924), ([2.0, 1.3, 0.9], 5.0)):
        m, distance, (a, b) = rim_of(np.array(moments), weight)
        expected = [b**2 / 2 + distance**2, a**2 / 2 + distance**2, (a**2 + b**2) / 2]
        assert np.abs(m * np.array(expected) - moments).max() < 1e-15
        assert abs(m * 9.81 * distance - weight) < 1e-15 * (1 + 8 * weight)
    (scene_part,) = scene_of(top, 5).parts
    flywheel = scene_part.shapes[0]
    assert flywheel.kind == "disc"
    assert np.abs(flywheel.size[:2] - np.sqrt(0.0008)).max() < 1e-12  # of the paper's 1 kg
    assert np.abs(flywheel.centre - [0, 0, 0.04]).max() < 1e-12
    assert scene_part.to_scale
    tips = [shape for shape in scene_part.shapes if shape.kind == "bar"]
    reach = max(float((shape.centre + shape.axes[:, 2] * shape.size[2])[2]) for shape in tips)
    assert reach < scene_part.tip[2] < 1.2 * reach


def test_a_top_is_seen_from_its_side(top):
    """The camera looks across the lean, so that the flywheel does not hide the point."""
    scene = scene_of(top, 5)
    (scene_part,) = scene.parts
    for frame in (0, 4):
        sight = SceneDrawing(scene, {}, [frame], size=(40, 30)).camera.axes[2]
        axis = (scene_part.at(scene_part.axes[:, 2]) - scene_part.x[:, None])[frame, 0]
        assert abs(axis[:2] @ sight[:2]) < 1e-12


def test_the_ground_holds_an_origin_that_rests_off_the_centre_of_mass():
    rest, moving = np.zeros((3, 3)), np.arange(9.0).reshape(3, 3)
    joint, axle = (SimpleNamespace(a=0, b=-1, on_a=np.array(r), on_b=np.ones(3))
                   for r in ([0, 0, 0], [0, 0, 1]))
    for centre, x, ties, held in (([0, 0, 2], rest, [], True), ([0, 0, 2], rest, [axle], True),
                                  ([0, 0, 0], rest, [], False), ([0, 0, 2], moving, [], False),
                                  ([0, 0, 2], rest, [axle, joint], False)):
        assert is_held([SimpleNamespace(centre=np.array(centre), x=x)], ties, 0) is held


def test_a_top_between_joints_has_its_flywheel_at_its_centre_of_mass():
    """The stem begins at the first joint and passes the second."""
    scene = scene_of(motion_of("double_top"), 2)
    assert len(scene.parts) == 2
    for scene_part in scene.parts:
        flywheel, _, stem, foot = scene_part.shapes[:4]
        assert flywheel.kind == "disc"
        assert np.abs(flywheel.centre - scene_part.centre).max() < 1e-12
        assert (flywheel.centre - foot.centre) @ (stem.centre - foot.centre) > 0


def test_a_flat_free_body_is_a_t_with_its_moments(gl3):
    """Two rods about their centre of mass have the ratio of I₁ and I₂."""
    free = gs.problems.free_body((1, 2, 3), (0.01, 5, 0.01))
    scene = scene_of(gl3.integrate(free, dt=0.01, steps=4), 4)
    assert not scene.gravity
    assert scene.parts[0].rim is None
    across, stem = scene.parts[0].shapes
    a, c = across.size[2], float(across.centre @ stem.axes[:, 2])
    n, middle = 2 * stem.size[2], float(stem.centre @ stem.axes[:, 2])
    mass = np.array([2 * a, n])
    assert abs(mass @ [c, middle]) < 1e-9 * a
    I1, I2 = mass @ [c**2, n**2 / 12 + middle**2], mass[0] * a**2 / 3
    assert pytest.approx(0.5, rel=1e-6) == I1 / I2


def test_a_picture_has_its_size_and_is_a_file(top, tmp_path):
    picture = draw_picture(top, tmp_path / "top.png", **SMALL)
    assert picture.pixels.shape == (90, 120, 3)
    data = picture.path.read_bytes()
    assert np.array_equal(decoded(data), picture.pixels)
    assert data == picture._repr_png_()
    assert "120 × 90" in repr(picture)
    assert [p.name for p in tmp_path.iterdir()] == ["top.png"]
    # Pixels have the colour of the first body and, at the corners, of the background.
    blue = colour_of("#4c78a8")
    tone = picture.pixels / np.maximum(picture.pixels.sum(axis=2, keepdims=True), 1)
    assert (np.abs(tone - blue / blue.sum()).max(axis=2) < 0.05).sum() > 300
    assert picture.pixels[0, 0].min() > 240
    assert draw_picture(top, background="dark", **SMALL).pixels[0, 0].max() < 60


def test_time_and_direction_of_a_picture(top):
    assert draw_picture(top, time=0.0203, **SMALL).time == pytest.approx(0.02)
    early, late = (draw_picture(top, time=t, traces=False, **SMALL).pixels for t in (0.0, 0.055))
    assert np.abs(early.astype(int) - late).max() > 50
    first = draw_picture(top, azimuth=10, traces=False, time=0, **SMALL).pixels
    turned = draw_picture(top, azimuth=370, traces=False, time=0, **SMALL).pixels
    assert np.array_equal(turned, first)
    above = draw_picture(top, azimuth=10, elevation=90, traces=False, time=0, **SMALL).pixels
    assert np.abs(above.astype(int) - first).max() > 50


def test_a_motion_in_a_plane_is_seen_from_the_front():
    """The first bar moves in a plane: its picture is wide from the front, narrow from aside."""
    scene, widths = scene_of(motion_of("four_bar"), 2), []
    for direction in ({}, {"azimuth": 0}):
        pixels = draw_scene(scene, size=(200, 200), traces=False, **direction).pixels.astype(int)
        coloured = np.abs(pixels - colour_of("#4c78a8") * 255).max(axis=2) < 60
        widths.append(np.ptp(np.flatnonzero(coloured.any(axis=0))))
    assert widths[0] > 60
    assert widths[1] < 0.5 * widths[0]


@pytest.mark.parametrize(("options", "message"), [
    ({"size": (10, 400)}, "size = "), ({"size": 400}, "size = 400"),
    ({"size": (400.5, 300)}, "400.5"), ({"size": (9000, 300)}, "9000"),
    ({"azimuth": "north"}, "azimuth = 'north'"), ({"elevation": 91}, "elevation = 91"),
    ({"time": [1]}, "time = "), ({"time": float("nan")}, "time = nan"),
    ({"background": "pink"}, "'pink'"), ({"path": "top.svg"}, r"'top.svg'.*\.png")])
def test_what_is_no_picture(top, options, message):
    with pytest.raises(gs.InputError, match=message):
        draw_picture(top, **options)


def test_meshes_of_files_are_drawn(tmp_path):
    """A cube from a file has the pixels of a box, except at the bevelled edges."""
    corners = [f"v {x} {y} {z}" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = ["1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"]
    (tmp_path / "cube.obj").write_text("\n".join([*corners, *(f"f {face}" for face in faces)]))
    size, pictures = np.array([0.3, 0.2, 0.1]), []
    tops = motion_of("double_top")
    with pytest.MonkeyPatch.context() as patch:
        for shape in (Shape("mesh", size, file=str(tmp_path / "cube.obj")), Shape("box", size)):
            for name in tops.bodies:
                patch.setitem(tops._stepper.visuals, name, [shape])
            pictures.append(draw_picture(tops, traces=False, **SMALL).pixels.astype(int))
    differ = np.abs(pictures[0] - pictures[1]).max(axis=2) > 40
    assert 0 < differ.sum() < 0.05 * differ.size
    blue = np.abs(pictures[0] - colour_of("#4c78a8") * 255).max(axis=2) < 60
    assert blue.sum() > 200
