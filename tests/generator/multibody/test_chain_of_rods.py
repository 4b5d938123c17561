"""Rods from a list of points: where they are, their inertia, their joints."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.generator.systems.numeric_system import numeric

POINTS = np.array([(0, 0, 0), (0.3, 0, -0.4), (0.4, 0.5, -0.6), (0, 0.5, -1.0)])


@pytest.mark.parametrize(("points", "axis", "freedom"), [
    (POINTS, None, 9), (POINTS * (1, 0, 1) + (0, 2, 0), (0, 1, 0), 3)], ids=["balls", "hinges"])
def test_rods_lead_from_point_to_point(points, axis, freedom):
    build = gs.Multibody("rods")
    rods = build.chain_of_rods(points, mass=[1.0, 2.0, 3.0], radius=0.02, axis=axis)
    model = build.model()
    assert model.system.n - model.system.m == freedom
    values = numeric(model.system, model.parameters, 0.0)
    assert np.abs(values.g(model.q0)).max() < 1e-15
    for rod, start, end in zip(rods, points[:-1], points[1:], strict=True):
        half = np.linalg.norm(end - start) / 2
        q = dict(zip(map(str, model.system.q), model.q0, strict=True))
        for point, place in (((-half, 0, 0), start), ((half, 0, 0), end)):
            at = [float(e.subs({x: q[str(x)] for x in e.free_symbols})) for e in rod.point(point)]
            np.testing.assert_allclose(at, place, rtol=0, atol=1e-15)
    m, length = 3.0, np.linalg.norm(points[3] - points[2])
    across = m * (3 * 0.02**2 + length**2) / 12
    found = [model.parameters[f"rod_3_I{k}"] for k in (1, 2, 3)]
    np.testing.assert_allclose(found, [m * 0.02**2 / 2, across, across], rtol=4e-16)


def test_a_chain_is_free_or_held_by_a_body():
    build = gs.Multibody("rods")
    free = build.chain_of_rods(POINTS[:2], mass=1.0, a=None, name="a")
    build.chain_of_rods(POINTS[1:3], mass=1.0, a=free[0], name="b")
    system = build.model().system
    assert system.n - system.m == 9  # six of the first, three of the second


@pytest.mark.parametrize(("arguments", "words"), [
    ({"points": [(0, 0, 0)]}, "points"), ({"points": "abc"}, "points"),
    ({"points": [(0, 0, 0), (0, 0, 0)]}, "1 and 2"), ({"mass": [1.0]}, "mass.*3 rods"),
    ({"mass": -1.0}, "rod_1.*above"), ({"radius": 0.0}, "radius"), ({"a": "nobody"}, "'nobody'")])
def test_what_is_no_chain_is_refused(arguments, words):
    with pytest.raises(gs.InputError, match=words):
        gs.Multibody("rods").chain_of_rods(**{"points": POINTS, "mass": 1.0} | arguments)
