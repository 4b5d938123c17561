"""Closed loops without a redundant equation named: Bricard's, four-bars in a row, change points."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import gyrospark as gs
from robots import Motion

EPS = np.finfo(float).eps


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


@pytest.mark.slow  # five bodies take five seconds to derive
def test_bricards_mechanism():
    """P1 and P3 of the exact reduction (1 + sin θ)(1 + sin φ) = 1, integrated in 24 digits."""
    build = bricard()
    model = build.model(redundant="leave out")
    assert (model.system.n, model.system.m) == (35, 34)
    assert build.redundancy.left_out == ("h5: axis 2",)
    step = gs.stepper("G-L", 3, system=model.system)
    done = step.integrate(model.q0, model.p0, dt=0.02, steps=500, parameters=model.parameters)
    wanted = {25: (0.9682836791068, 0.0, -0.2498533905622), 50: (0.5105014611872, 0.0,
              -0.8598768854468), 100: (-0.9693403447777, 0.0, -0.2457219892202),
              500: (0.9999999638063, 0.0, -2.690488800787e-4)}
    for k, point in wanted.items():
        centre = done.q[k, 4:7]  # of the first rod, from the origin to P1
        assert np.abs(2 * centre - point).max() <= 1e-12
    assert np.abs(done.energies - done.energies[0]).max() <= 1e-11
    R = done.rotation("rod4").as_matrix()  # what was left out holds all the same
    assert np.abs(R[:, 0] - [1, 0, 0]).max() <= 1e-13


def parallelogram():
    """Return two cranks of 1 m and a coupler of 2 m, which turn over their change points."""
    build = gs.Multibody("parallelogram3", gravity=(0, 0, 0))
    points = np.array([[0, 0, 0], [0, 1, 0], [2, 1, 0], [2, 0, 0]], dtype=float)
    rates = (6.0, 0.0, 6.0)
    for i, (rod, rate) in enumerate(zip(rods(points), rates, strict=True)):
        build.body(f"rod{i}", **rod, angular_velocity=(0, 0, rate))
    frames = ["ground", "rod0", "rod1", "rod2", "ground"]
    for i, point in enumerate(points):
        build.revolute(f"h{i}", frames[i], frames[i + 1], axis=(0, 0, 1), at=point)
    return build


@pytest.mark.slow  # a hundred turns; of a plane four-bar the next one has a short run
def test_a_parallelogram_through_its_change_points():
    """Without gravity it turns steadily: 100 change points, where all bars are in a line."""
    build = parallelogram()
    model = build.model(redundant="leave out")
    assert model.system.m == model.system.n - 1
    step = gs.stepper("G-L", 3, system=model.system)
    seconds = 50 * 2 * math.pi / 6.0
    done = step.integrate(model.q0, model.p0, dt=seconds / 5230, steps=5230,
                          parameters=model.parameters)
    angle = 6.0 * done.t
    crank = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    assert np.abs(done.q[:, 7:11] - model.q0[7:11]).max() <= 1e-9  # the coupler does not turn
    assert np.abs(2 * done.q[:, 4:6] - crank).max() <= 1e-9
    assert done.report.constraint_max <= 4 * EPS


def four_bars(count, tilt=0.0):
    """Return IFToMM A02: so many four-bar linkages in a row, which start at 1 rad/s.

    Its rods are upright, but for a tilt.
    """
    build = gs.Multibody(f"a02_{count}", gravity=(0, -9.81, 0))
    upright, lying = (1 / 12, 1e-3, 1 / 12), (1e-3, 1 / 12, 1 / 12)
    x, y = math.sin(tilt), math.cos(tilt)
    for i in range(count + 1):
        build.body(f"v{i}", mass=1, inertia=upright, position=(i + x / 2, y / 2, 0),
                   velocity=(y / 2, -x / 2, 0), angular_velocity=(0, 0, -1.0))
        if i:
            build.body(f"c{i}", mass=1, inertia=lying, position=(i - 0.5 + x, y, 0),
                       velocity=(y, -x, 0))
    for i in range(count + 1):
        build.revolute(f"g{i}", "ground", f"v{i}", axis=(0, 0, 1), at=(i, 0, 0))
    for i in range(1, count + 1):
        build.revolute(f"l{i}", f"v{i - 1}", f"c{i}", axis=(0, 0, 1), at=(i - 1 + x, y, 0))
        build.revolute(f"r{i}", f"c{i}", f"v{i}", axis=(0, 0, 1), at=(i + x, y, 0))
    return build


def test_one_four_bar():
    """φ'' = 6 g/5 sin φ of the three rods together, and no equation too many."""
    build = four_bars(1, tilt=0.5)
    motion = Motion(build.model(redundant="leave out"))
    assert len(build.redundancy.left_out) == 3
    faster = 1.2 * 9.81 * math.sin(0.5)
    along, outward = np.array([[math.cos(0.5), -math.sin(0.5)], [math.sin(0.5), math.cos(0.5)]])
    np.testing.assert_allclose(motion.dp[4:6], (faster * along - outward) / 2, rtol=1e-12)


@pytest.mark.slow  # the published benchmark, of 40 loops
def test_four_bars_in_a_row():
    """All upright rods turn alike: B0 after 10 s by φ'' = c sin φ in 22 digits, to round-off."""
    build = four_bars(40)
    model = build.model(redundant="leave out")
    assert len(build.redundancy.left_out) == 120  # what a plane loop says twice
    assert model.system.m == model.system.n - 1
    step = gs.stepper("G-L", 3, system=model.system)
    done = step.integrate(model.q0, model.p0, dt=0.002, steps=5000, every=5000,
                          parameters=model.parameters)
    end = (0.18051222666672839, 0.983572740582311575)
    assert np.abs(2 * done.q[-1, 4:6] - end).max() <= 1e-13
