"""The 3-D model of a run, read as glTF 2.0 specifies, has the motion of the run."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest

import systems
from calls import RUN, TOP
from gyrospark.runtime.plotting.scene import scene_of
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix

KINDS = {5125: ("<u4", 4), 5126: ("<f4", 4)}
WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


@pytest.fixture(scope="module")
def tied():
    return systems.run("tied", systems.stepper("tied", "IMS"), 40)


def read(path):
    """Return the JSON of a file and its accessors as arrays, each checked."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<II", data, 12)
    assert kind == 0x4E4F534A
    assert size % 4 == 0
    content = json.loads(data[20:20 + size])
    count, kind = struct.unpack_from("<II", data, 20 + size)
    numbers = data[28 + size:]
    assert kind == 0x004E4942
    assert count == len(numbers) == content["buffers"][0]["byteLength"]
    arrays = []
    for accessor in content["accessors"]:
        view = content["bufferViews"][accessor["bufferView"]]
        form, width = KINDS[accessor["componentType"]]
        columns = WIDTHS[accessor["type"]]
        assert view["byteOffset"] % 4 == 0
        assert view["byteLength"] == accessor["count"] * columns * width
        values = np.frombuffer(numbers, form, accessor["count"] * columns, view["byteOffset"])
        values = values.reshape(-1, columns)
        assert np.isfinite(values).all()
        assert np.array_equal(values.min(axis=0), np.array(accessor["min"], form))
        assert np.array_equal(values.max(axis=0), np.array(accessor["max"], form))
        arrays.append(values)
    for mesh in content["meshes"]:
        for primitive in mesh["primitives"]:
            assert arrays[primitive["indices"]].max() < len(
                arrays[primitive["attributes"]["POSITION"]])
            if "NORMAL" in primitive["attributes"]:
                normals = arrays[primitive["attributes"]["NORMAL"]]
                assert np.abs(np.linalg.norm(normals, axis=1) - 1).max() < 1e-6
            assert primitive["material"] < len(content["materials"])
    return content, arrays


def motion(content, arrays, name):
    """Return node, and (times, values) of each animated property."""
    number = next(i for i, node in enumerate(content["nodes"]) if node["name"] == name)
    animation, animated = content["animations"][0], {}
    for channel in animation["channels"]:
        if channel["target"]["node"] == number:
            sampler = animation["samplers"][channel["sampler"]]
            assert sampler["interpolation"] == "LINEAR"
            animated[channel["target"]["path"]] = arrays[sampler["input"]][:, 0], arrays[
                sampler["output"]]
    return content["nodes"][number], animated


def test_its_motion_is_that_of_the_run(tied, tmp_path):
    content, arrays = read(tied.show(tmp_path / "tied.glb"))
    assert content["asset"]["version"] == "2.0"
    assert content["nodes"][0]["children"] == [1, 2, 3, 4, 5]
    for name in "bc":
        node, animated = motion(content, arrays, name)
        times, places = animated["translation"]
        assert np.abs(times - tied.t).max() < 1e-7
        assert np.abs(places - tied.body(name).position()).max() < 1e-6
        assert np.abs(np.array(node["translation"]) - tied.body(name).position()[0]).max() < 1e-12
    times, rotations = animated["rotation"]
    turned = rotation_matrix(rotations[:, [3, 0, 1, 2]].astype(float))
    assert np.abs(turned - rotation_matrix(tied.body("c").attitude)).max() < 1e-6
    assert (np.sum(rotations[1:] * rotations[:-1], axis=1) > 0).all()
    # Up is +Y: the turn of the root takes the third axis there.
    x, y, z, w = content["nodes"][0]["rotation"]
    up = rotation_matrix(np.array([[w, x, y, z]]))[0] @ [0, 0, 1]
    assert np.abs(up - [0, 1, 0]).max() < 1e-12


def test_rods_and_springs_reach_from_point_to_point(tied, tmp_path):
    content, arrays = read(tied.show(tmp_path / "tied.glb"))
    assert [tie.kind for tie in scene_of(tied, 9).ties] == ["rod", "spring"]
    for name, body, end in (("rod", "b", tied.body("c").position()),
                            ("spring", "a", np.tile((0, 1, 0), (len(tied), 1)))):
        node, animated = motion(content, arrays, name)
        moving = {path: values for path, (_, values) in animated.items()}
        middle = moving.get("translation", np.array([node["translation"]]))
        q = moving.get("rotation", np.array([node["rotation"]]))
        half = moving.get("scale", np.array([node["scale"]]))[:, 2:]
        along = rotation_matrix(q[:, [3, 0, 1, 2]].astype(float)) @ [0, 0, 1]
        ends = np.stack([middle - half * along, middle + half * along])
        expected = np.stack([tied.body(body).position(), end])
        assert np.abs(ends - expected).max() < 2e-6


def test_a_state_alone_is_a_model_that_rests(gl3, tmp_path):
    run = gl3.integrate(TOP.q0, TOP.p0, steps=0, **RUN)
    content, _ = read(run.show(tmp_path / "top.glb"))
    assert "animations" not in content
