"""Closed loops without a redundant equation named; tests/references has their motions."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.generator.multibody.initial_poses import rotation


def rods(points, *, thickness=0.1):
    """Yield the keywords of a body for each rod of 1 kg between neighbouring points."""
    for start, end in itertools.pairwise(points):
        along = np.asarray(end, dtype=float) - start
        length = np.linalg.norm(along)
        e = along / length
        across = (length**2 + thickness**2) / 12 * (np.eye(3) - np.outer(e, e))
        yield {"mass": 1.0, "inertia": across + thickness**2 / 6 * np.outer(e, e),
               "position": (np.asarray(start) + end) / 2}


def bricard():
    """Return IFToMM A04: five rods, six hinges, one freedom where counting says none."""
    build = gs.Multibody("bricard", gravity=(0, -9.81, 0))
    points = [(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)]
    for i, rod in enumerate(rods(np.array(points, dtype=float))):
        build.body(f"rod{i}", **rod)
    frames = ["ground", *(f"rod{i}" for i in range(5)), "ground"]
    for i, (point, axis) in enumerate(zip(points, "yzxyzx", strict=True)):
        build.revolute(f"h{i}", frames[i], frames[i + 1], axis=np.eye(3)["xyz".index(axis)],
                       at=point)
    return build


def test_bricards_mechanism_has_a_redundant_equation():
    build = bricard()
    model = build.model(redundant="leave out")
    assert (model.system.n, model.system.m) == (35, 34)
    assert build.redundancy.left_out == ("h5: axis 2",)


@pytest.mark.parametrize("turn", [0.5, 1.4, 1.7, np.pi])
def test_a_fixed_rotation_is_met_or_refused(turn):
    """The three constraints hold at half a turn more, too, where closing a far start may end."""
    build = gs.Multibody("doors")
    a, b = (build.body(name, mass=1, inertia=(0.1, 0.2, 0.3)) for name in "ab")
    for body in (a, b):
        build.revolute(f"hinge_{body.name}", "ground", body, at=(0, 0, 0), axis=(0, 0, 1))
    relative = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0],
                         [0, 0, 1]])
    build.fixed("both", a, b, on_a=(0, 0, 0), on_b=(0, 0, 0), rotation=relative)
    if turn > np.pi / 2:
        with pytest.raises(gs.InputError, match="'both'"):
            build.model(redundant="leave out")
        return
    model = build.model(redundant="leave out")
    R_a, R_b = (rotation(q) for q in np.reshape(model.q0, (2, 7))[:, :4])
    assert np.allclose(R_a.T @ R_b, relative, rtol=0, atol=1e-14)
