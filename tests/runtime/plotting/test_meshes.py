"""Meshes: files against arrays, clusters against their bounds, robots whose links have some."""

from __future__ import annotations

import base64
import json
import re
import struct
import zlib

import numpy as np
import pytest
from scipy.spatial import ConvexHull

import gyrospark as gs
from gyrospark.core import mesh_files
from gyrospark.core.mesh_files import locate, read_triangles
from gyrospark.core.shapes import Shape
from gyrospark.runtime.plotting.meshes import IndexedMesh, encode, read_meshes
from gyrospark.runtime.plotting.solids import mesh_of_file
from robots import BAR

#: A tetrahedron, seen counterclockwise from outside.
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
TRIANGLES = CORNERS[FACES]


def binary(triangles, name="solid but binary"):
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in triangles)
    return name.encode().ljust(80) + struct.pack("<I", len(triangles)) + rows


def text(triangles):
    facets = "".join("facet normal 0 0 0\nouter loop\n" + "".join(
        f"vertex {x:g} {y:g} {z:g}\n" for x, y, z in triangle) + "endloop\nendfacet\n"
        for triangle in triangles)
    return f"solid a\n{facets}endsolid a\n".encode()


OBJ = b"""# a quadrilateral base, corners with textures and normals, numbers from the end
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0.5 0.5 1
f 4/1/1 3/2/1 2/3/1 1/4/1
f 1 2 -1
"""


def sphere(count):
    """Return the triangles of a sphere of radius 1."""
    theta, phi = np.linspace(0, np.pi, count + 1), np.linspace(0, 2 * np.pi, 2 * count + 1)
    net = np.stack([np.outer(np.sin(theta), np.cos(phi)), np.outer(np.sin(theta), np.sin(phi)),
                    np.outer(np.cos(theta), np.ones_like(phi))], axis=-1).round(12)
    a, b, c, d = net[:-1, :-1], net[1:, :-1], net[1:, 1:], net[:-1, 1:]
    return np.concatenate([np.stack([a, b, c], -2), np.stack([a, c, d], -2)]).reshape(-1, 3, 3)


@pytest.mark.parametrize(("name", "content"), [("a.stl", binary(TRIANGLES)),
                                               ("a.STL", text(TRIANGLES))])
def test_stl_is_read_in_both_forms(tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content)
    assert np.array_equal(read_triangles(path), TRIANGLES)


def test_obj_is_read_with_polygons_and_numbers_from_the_end(tmp_path):
    path = tmp_path / "a.obj"
    path.write_bytes(OBJ)
    triangles = read_triangles(path)
    assert triangles.shape == (3, 3, 3)
    assert np.array_equal(triangles[0], [[0, 1, 0], [1, 1, 0], [1, 0, 0]])
    assert np.array_equal(triangles[2], [[0, 0, 0], [1, 0, 0], [0.5, 0.5, 1]])


@pytest.mark.parametrize(("name", "content", "message"), [
    ("a.dae", b"<COLLADA/>", r"'\.dae'.*convert"), ("a.stl", b"", "no triangles"),
    ("a.stl", binary(TRIANGLES)[:-7], "no triangles"),
    ("a.stl", b"solid\nvertex 1 2\n", "no STL"), ("a.stl", b"vertex 1 2 nan\n" * 3, "finite"),
    ("a.obj", b"v 1 2 3\nf 1 2 3\n", "no OBJ"), ("a.obj", b"v 1 2 3\nf -9 1 1\n", "no OBJ"),
])
def test_files_that_are_no_meshes_are_refused(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(gs.InputError, match=message):
        read_triangles(path)


def test_edges_are_sharp_and_rounds_are_smooth():
    """Normals at a right angle belong to the faces; on a sphere they vary over each facet."""
    shape = Shape("mesh", np.ones(3), file="a.stl")
    flat = mesh_of_file(shape, IndexedMesh(CORNERS / [1, 2, 3], FACES))
    sides = np.array([[0, 0, -1], [0, -1, 0], [-1, 0, 0], 3 * [np.sqrt(1 / 3)]])
    assert np.abs(flat.normals - np.repeat(sides, 3, axis=0)).max() < 1e-15
    rng = np.random.default_rng(3)
    points = rng.standard_normal((2000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    hull = ConvexHull(points)
    outwards = (np.cross(*(points[hull.simplices[:, k]] - points[hull.simplices[:, 0]]
                           for k in (1, 2))) * hull.equations[:, :3]).sum(axis=1) > 0
    faces = np.where(outwards[:, None], hull.simplices, hull.simplices[:, ::-1])
    round_ = mesh_of_file(shape, IndexedMesh(points, faces))
    assert ((round_.normals * round_.points).sum(axis=1) > 0.98).all()
    assert (np.ptp(round_.normals.reshape(-1, 3, 3), axis=1).max(axis=1) > 1e-3).all()


def test_files_that_are_too_large_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "a.stl"
    path.write_bytes(binary(TRIANGLES))
    monkeypatch.setattr(mesh_files, "MAX_TRIANGLES", 3)
    with pytest.raises(gs.InputError, match=r"4 triangles .* 3 "):
        read_triangles(path)
    monkeypatch.setattr(mesh_files, "MAX_BYTES", 100)
    with pytest.raises(gs.InputError, match="MiB"):
        read_triangles(path)
    with pytest.raises(gs.InputError, match="such file"):
        read_triangles(tmp_path / "b.stl")


def test_clusters_stay_within_a_cell_and_keep_the_shape():
    mesh = IndexedMesh.of(sphere(60))
    assert mesh.extent == pytest.approx(2)
    assert len(mesh.points) == 2 + 59 * 120  # each vertex once
    clustered = mesh.cluster(0.2)
    assert 100 < len(clustered.triangles) < len(mesh.triangles) / 5
    radii = np.linalg.norm(clustered.points, axis=1)
    assert radii.max() <= 1 + 1e-9
    assert radii.min() > 1 - 0.2
    corners = clustered.points[clustered.triangles]
    volume = np.linalg.det(corners).sum() / 6  # closed still, and seen from outside
    assert volume == pytest.approx(4 / 3 * np.pi, rel=0.03)
    assert np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).sum(
        axis=0)).max() < 1e-12


def test_meshes_of_a_page_fit_and_are_decoded_to_their_digits(tmp_path):
    path = tmp_path / "a.stl"
    path.write_bytes(binary(sphere(40)))
    full, _ = read_meshes([str(path)], "full")
    assert len(full[str(path)].triangles) > 6000
    small, refused = read_meshes([str(path), str(tmp_path / "b.dae")], "small", 6000)
    assert list(refused) == [str(tmp_path / "b.dae")]
    content = encode(small[str(path)])
    assert 2000 < len(content["data"]) <= 6000
    data = zlib.decompress(base64.b64decode(content["data"]))
    n = content["vertices"]
    points = np.cumsum(np.frombuffer(data, "<u2", 3 * n).reshape(3, n), axis=1) % 65536
    points = np.array(content["low"]) + points.T / 65535 * content["width"]
    corners = np.cumsum(np.frombuffer(data, "<u4", offset=6 * n).astype(np.int64)) % 2**32
    decoded = points[corners].reshape(-1, 3, 3).mean(axis=1)
    mesh = small[str(path)]
    expected = mesh.points[mesh.triangles].mean(axis=1)
    assert decoded.shape == expected.shape
    assert np.abs(np.sort(decoded, axis=0) - np.sort(expected, axis=0)).max() < 2 / 65535
    assert read_meshes([str(path)], "none") == ({}, {})


@pytest.fixture
def robot(tmp_path):
    folder = tmp_path / "shown"
    (folder / "meshes").mkdir(parents=True)
    (folder / "meshes" / "a.stl").write_bytes(binary(TRIANGLES))
    path = folder / "robot.urdf"
    path.write_text(BAR, encoding="utf-8")
    return path


def test_links_look_as_their_file_says(robot):
    visuals = gs.load_model(robot).visuals
    (base,), (mesh, rod, hand) = visuals[""], visuals["bar"]
    assert base.file == mesh.file == str(robot.parent / "meshes" / "a.stl")
    assert mesh.colour == "#ff0000"
    assert np.abs(mesh.size - 0.1).max() == 0
    assert np.abs(mesh.centre - [0, 0, 1]).max() < 1e-15  # from the centre of mass
    assert np.abs(mesh.axes[:, 0] - [0, 1, 0]).max() < 1e-15
    assert (rod.kind, rod.size.tolist()) == ("disc", [0.05, 0.05, 0.5])
    assert np.abs(hand.centre - [1, 0, 0.5]).max() < 1e-15
    assert locate(Shape("mesh", np.ones(3), file="package://else/a.stl"), robot).file == (
        "package://else/a.stl")


def test_a_page_has_the_meshes_and_names_those_that_it_has_not(robot, gyrospark):
    options = ["--scheme", "IMS", "--dt", "1e-3", "--steps", "2"]
    page = robot.parent / "page.html"
    answer = gyrospark("run", str(robot), *options, "--show", str(page))
    assert answer.code == 0
    assert re.search(r"b\.dae.*convert", answer.stderr + answer.stdout)
    scene = json.loads(re.search(r'id="scene">(.*?)</script>', page.read_text(encoding="utf-8"),
                                 flags=re.DOTALL)[1])
    assert [(mesh["vertices"], mesh["triangles"]) for mesh in scene["meshes"]["0"]] == [(4, 4)]
    assert scene["ground"][0]["mesh"] == scene["bodies"][0]["shapes"][0]["mesh"] == 0
    assert scene["bodies"][0]["shapes"][1]["kind"] != "mesh"
    assert any("b.dae" in remark for remark in scene["remarks"])
    assert gyrospark("run", str(robot), *options, "--show", str(page.with_suffix(".glb"))).code == 0
    assert page.with_suffix(".glb").stat().st_size > 1000


def test_a_model_is_drawn_with_shapes_of_its_own():
    build = gs.Multibody("own")
    body = build.body("ball", mass=1.0, inertia=(0.1, 0.1, 0.1))
    build.visual(body, gs.Shape("sphere", (0.5, 0.5, 0.5), colour="#112233"))
    build.visual("ground", gs.Shape.bar((0, 0, 0), (0, 0, 1), 0.1))
    model = build.model()
    assert [shape.colour for shape in model.visuals["ball"]] == ["#112233"]
    assert model.visuals[""][0].size.tolist() == [0.1, 0.1, 0.5]
    with pytest.raises(gs.InputError, match="'bell'"):
        build.visual("bell", gs.Shape("sphere", (1, 1, 1)))
    with pytest.raises(gs.InputError, match=r"gyrospark\.Shape"):
        build.visual("ball", "sphere")


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_a_bar_of_any_size_has_its_direction(unit):
    """Between equal points it is a ball."""
    bar = gs.Shape.bar((0, 0, 0), (2 * unit, 0, 0), unit)
    assert bar.axes[:, 2].tolist() == [1, 0, 0]
    assert bar.size.tolist() == [unit, unit, unit]
    ball = gs.Shape.bar((unit, 0, 0), (unit, 0, 0), unit)
    assert ball.centre.tolist() == [unit, 0, 0]
    assert 0 < ball.size[2] < 1e-5 * unit


@pytest.mark.parametrize(("arguments", "words"), [
    ({"kind": "cone"}, "kind.*'cone'"), ({"size": (1, 0, 1)}, "size.*above 0"),
    ({"size": (1, 1)}, "size.*3"), ({"size": (1, -1, 1)}, "size.*above 0"),
    ({"centre": (0, 0, np.nan)}, "centre.*finite"), ({"axes": 2 * np.eye(3)}, "axes.*orthonormal"),
    ({"colour": "red"}, "colour.*'red'"), ({"file": "a.stl"}, "box.*'a.stl'"),
    ({"kind": "mesh"}, "mesh.*file")])
def test_shapes_that_are_none_are_refused(arguments, words):
    with pytest.raises(gs.InputError, match=words):
        gs.Shape(**{"kind": "box", "size": (1, 1, 1)} | arguments)
