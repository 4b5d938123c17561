"""Many equal molecules: kicks against NumPy, order, momenta, pieces of runs, refusals."""

from __future__ import annotations

import math
import threading
from itertools import pairwise

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix

#: Two blocks of lanes at any number of them, with some lanes left over.
COUNT = 11
SITES = {(0.0, 0.0, 0.0655): -0.834, (0.757, 0.0, -0.5205): 0.417, (-0.757, 0.0, -0.5205): 0.417}
VALUES = {"k": 332.06, "A": 582000.0, "B": 595.0}


def square(a, b, r, s):
    return sum((x - y)**2 for x, y in zip(a.point(r), b.point(s), strict=True))


def tip3p(a, b, k, A, B):
    oxygen = next(iter(SITES))
    r2 = square(a, b, oxygen, oxygen)
    return A / r2**6 - B / r2**3 + k * sum(c * d / sp.sqrt(square(a, b, r, s))
                                           for r, c in SITES.items() for s, d in SITES.items())


def box(count=COUNT, pair_potential=tip3p, parameters=VALUES, name="waters", **options):
    rng, size = np.random.default_rng(3), math.ceil(count ** (1 / 3))
    grid = 3.1 * np.indices((size,) * 3).reshape(3, -1).T[:count]
    return gs.molecules(
        name, count, **{"mass": 18.0, "inertia": (1.34, 1.93, 0.6)} | options,
        pair_potential=pair_potential, parameters=parameters, positions=grid,
        quaternions=rng.standard_normal((count, 4)), velocities=0.1 * rng.standard_normal(
            (count, 3)), angular_velocities=0.5 * rng.standard_normal((count, 3)))


@pytest.fixture(scope="module")
def waters():
    model = box()
    return model, gs.stepper("splitting", order=2, system=model)


def forces(q):
    """Return V, and the forces and torques on all waters, site by site."""
    R, r, charge = rotation_matrix(q[:, :4]), np.array([*SITES]), np.array([*SITES.values()])
    arms = np.einsum("nij,sj->nsi", R, r)
    points, total, F = q[:, None, 4:] + arms, 0.0, np.zeros((len(q), len(r), 3))
    for i, j in zip(*np.triu_indices(len(q), 1), strict=True):
        d = points[i][:, None] - points[j][None]
        distance = np.linalg.norm(d, axis=-1)
        V = VALUES["k"] * np.outer(charge, charge) / distance
        slope, oxygen = V / distance**2, distance[0, 0]
        V[0, 0] += VALUES["A"] / oxygen**12 - VALUES["B"] / oxygen**6
        slope[0, 0] += 12 * VALUES["A"] / oxygen**14 - 6 * VALUES["B"] / oxygen**8
        total += V.sum()
        F[i] += (slope[..., None] * d).sum(axis=1)
        F[j] -= (slope[..., None] * d).sum(axis=0)
    return total, F.sum(axis=1), np.cross(arms, F).sum(axis=1)


def test_kicks_are_those_of_numpy_to_round_off(waters):
    """From rest, a step of order 2 is one kick at the start."""
    model, step = waters
    p0, h = np.zeros_like(model.p0), 1e-4
    V, F, N = forces(model.q0.reshape(-1, 7))
    assert step.energy(model.q0, p0, parameters=model.parameters) == pytest.approx(V, rel=1e-13)
    run = step.integrate(model.q0, p0, dt=h, steps=1, parameters=model.parameters)
    p = run.p[-1].reshape(-1, 7)[:, 4:]
    l = np.array([run.body(f"m_{i}").angular_momentum()[-1] for i in range(COUNT)])  # noqa: E741
    assert np.abs(p / h - F).max() < 1e-14 * np.abs(F).max()
    assert np.abs(l / h - N).max() < 1e-14 * np.abs(N).max()


def test_energy_has_order_2_and_momenta_stay(waters):
    model, step = waters
    errors = []
    for steps in (50, 100):
        run = step.integrate(model.q0, model.p0, dt=0.4 / steps, steps=steps,
                             parameters=model.parameters)
        errors.append(np.abs(run.energy_error()).max())
        for momentum in (run.total_momentum(), run.total_angular_momentum()):
            assert np.abs(momentum - momentum[0]).max() < 1e-12
        assert max(run.constraint_errors()[0].max(), run.constraint_errors()[1].max()) < 1e-14
    assert 3.2 < errors[0] / errors[1] < 5


def test_a_run_has_the_same_bits_in_pieces_and_in_ensembles(waters):
    model, step = waters
    run = step.integrate(model.q0, model.p0, dt=4e-3, steps=40, parameters=model.parameters)
    held = step.start(model.q0, model.p0, dt=4e-3, parameters=model.parameters)
    for steps in (1, 30, 9):
        held.advance(steps)
    assert np.array_equal(held.q, run.q[-1])
    assert held.report == run.report
    many = step.integrate_ensemble(np.tile(model.q0, (3, 1)), [model.p0, 0.5 * model.p0, model.p0],
                                   dt=4e-3, steps=40, every=8, parameters=model.parameters)
    assert np.array_equal(many.q[2], run.q[::8])
    assert not np.array_equal(many.q[1], run.q[::8])
    assert many.members[0].report == run.report
    crossed = step.integrate(model.q0, model.p0, dt=4e-3, steps=40, parameters=model.parameters,
                             events=[gs.Event("m_x_10", level=run.q[20, 74])])
    assert crossed.events["m_x_10"].t[0] == pytest.approx(0.08, abs=1e-9)


def test_a_step_that_fails_keeps_what_was_before_it(waters):
    model, step = waters
    q = model.q0.copy()
    q[4:7] = q[11:14] + 1e-60  # two on one place
    with pytest.raises(gs.StepFailed) as failed:
        step.integrate(q, model.p0, dt=1e-3, steps=40, parameters=model.parameters)
    assert failed.value.step == 1
    moved, _ = step.project(1.01 * model.q0, model.p0, parameters=model.parameters)
    assert np.linalg.norm(moved.reshape(-1, 7)[:, :4], axis=1) == pytest.approx(1, abs=1e-15)


@pytest.mark.slow  # derives order 4 with a well
def test_order_4_with_dipoles_in_a_well():
    """Symmetric molecules in one block with vectors and a well; then in rotating axes."""
    def dipoles(a, b, k):
        d = [x - y for x, y in zip(a.x, b.x, strict=True)]
        r2 = sum(x**2 for x in d) + 1
        u, v = a.direction((0, 0, 1)), b.rotation[:, 2]
        inner = [sum(x * y for x, y in zip(one, other, strict=True))
                 for one, other in ((u, v), (u, d), (v, d))]
        return k * (inner[0] / sp.sqrt(r2)**3 - 3 * inner[1] * inner[2] / sp.sqrt(r2)**5)

    def well(a, w, turn):
        momentum = a.angular_momentum[2] + a.x[0] * a.p_x[1] - a.x[1] * a.p_x[0]
        return w * sum(x**2 for x in a.point((0.3, 0, 0))) / 2 - turn * momentum

    model = box(3, dipoles, {"k": 20.0, "w": 0.3, "turn": 0.0}, "dipoles", inertia=(1, 1, 0.6),
                mass=1.5, potential=well)
    step = gs.stepper("splitting", order=4, system=model)
    ends = []
    for steps in (160, 320, 640):
        run = step.integrate(model.q0, model.p0, dt=4 / steps, steps=steps, every=steps,
                             parameters=model.parameters)
        ends.append(np.concatenate([run.q[-1], run.p[-1]]))
    errors = [np.abs(x - y).max() for x, y in pairwise(ends)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.1)
    assert np.abs(run.energy_error()).max() < 1e-6
    turning = step.integrate(model.q0, model.p0, dt=4 / steps, steps=steps, every=steps,
                             parameters=dict(model.parameters) | {"turn": 0.7})
    R = rotation_matrix(np.array([np.cos(1.4), 0, 0, -np.sin(1.4)]))
    for q, p, inertial in zip(turning.q[-1].reshape(3, 7), turning.p[-1].reshape(3, 7),
                              ends[-1].reshape(2, 3, 7).swapaxes(0, 1), strict=True):
        assert np.abs(q[4:] - R @ inertial[0, 4:]).max() < 1e-12
        assert np.abs(p[4:] - R @ inertial[1, 4:]).max() < 1e-12


def test_what_molecules_cannot_have_is_refused():
    model = box(2)
    calls = [
        lambda: gs.stepper("G-L", stages=2, system=model),
        lambda: gs.stepper("splitting", composition="G4", system=model),
        lambda: gs.consistent(model.system, model.q0[:7], model.p0[:7], model.parameters),
        lambda: gs.certify(model, "splitting", order=2, dt=1e-3),
        lambda: box(1),
        lambda: box(2, inertia=np.eye(3) + 0.1),
        lambda: box(2, lambda a, b, k, A, B: a.x[0] - b.x[0] + k + A + B),
        lambda: box(2, lambda a, b: 1),
        lambda: box(2, lambda a, b, k, A, B: k + A + B),
        lambda: box(2, parameters=VALUES | {"C": 1.0}),
        lambda: box(2, lambda a, b, k, **_: k * square(a, b, (0, 0, 0), (0, 0, 0))),
        lambda: box(2, lambda a, b, **_: sp.Symbol("z") * square(a, b, (0, 0, 0), (0, 0, 0))),
        lambda: box(2, potential=lambda a: a.x[0] * sp.Symbol("z")),
        lambda: gs.models.waters(1),
    ]
    for number, call in enumerate(calls):
        with pytest.raises(InputError):
            pytest.fail(f"call {number} returned {call()}")


@pytest.fixture(scope="module")
def springs():
    """Many molecules, with a spring between every two; the last block has one molecule."""
    def pair(a, b, k):
        return k * square(a, b, (0, 0, 0), (0, 0, 0)) / 2

    def cubic(a, c):
        return c * a.x[0]**3

    model = box(1001, pair, {"k": 1.0, "c": 30.0}, "springs", potential=cubic, mass=1)
    return model, gs.stepper("splitting", order=2, system=model)


def test_stacks_do_not_grow_with_the_number_of_molecules(springs):
    """A thread of 192 KB, in which their state has no room."""
    model, step = springs
    values, found = model.parameters, []

    def work():
        run = step.integrate(model.q0, model.p0, dt=1e-6, steps=1, parameters=values)
        q1, p1, *_ = step.step(model.q0, model.p0, dt=1e-6, parameters=values)
        found.extend([run, q1, step.project(q1, p1, parameters=values)[0]])

    usual = threading.stack_size(192 * 1024)
    try:
        thread = threading.Thread(target=work)
        thread.start()
    finally:
        threading.stack_size(usual)
    thread.join()
    run, q1, projected = found
    assert np.array_equal(run.q[-1], q1)
    assert np.abs(projected - q1).max() < 1e-14


def test_lanes_without_molecules_end_no_run(springs):
    """Alone, the first of them falls to −∞ in a cubic potential; springs hold it."""
    model, step = springs
    q0 = np.tile([1.0, 0, 0, 0, 0, 0, 0], 1001)
    q0[4] = -1
    run = step.integrate(q0, 0 * q0, dt=1e-2, steps=50, every=10, parameters=model.parameters)
    assert np.abs(run.q).max() < 1.5
    x, v = -1.0, 0.0
    for _ in range(50):
        v -= 1e-2 * 3 * model.parameters["c"] * x * x
        x += 1e-2 * v
    assert x == -math.inf


def test_asymmetry_is_found_on_both_sides_of_each_switch():
    def up(a):
        return a.direction((0, 0, 1))[2]

    def within(value, r2, R, beyond=0):
        return sp.Piecewise((value, r2 < R**2), (beyond, True))

    asymmetric = [
        lambda a, b, r2: within((2 - sp.sqrt(r2))**3 * up(a), r2, 2),
        lambda a, b, r2: within(up(a), r2, sp.Rational(1, 10**6), r2),
        lambda a, b, r2: within(within(0, r2, 3, up(b)), r2, sp.Rational(301, 100)),
        lambda a, b, r2: sp.Max(0, 1 - r2)**2 * up(a),
        lambda a, b, r2: (abs(1 - r2) + 1 - r2) * up(b),
        lambda a, b, r2: sp.Piecewise((1, up(a) < 0), (r2, True)),
        lambda a, b, r2: sp.Piecewise((1, sp.And(up(a) < 0, r2 < 1)), (r2, True)),
        lambda a, b, r2: sp.exp(-r2) * (2 + up(a)),
        lambda a, b, r2: r2**-6 + sp.exp(-r2) * up(a),
    ]
    symmetric = [
        lambda a, b, r2: within((2 - sp.sqrt(r2))**3 * up(a) * up(b), r2, 2),
        lambda a, b, r2: sp.Piecewise((a.x[0]**2 * b.x[1], a.x[0] < b.x[0]),
                                      (b.x[0]**2 * a.x[1], True)),
        lambda a, b, r2: a.rotation[0, 2] * b.rotation[0, 2] * r2,
        lambda a, b, r2: sp.Max(up(a), up(b), 0) + sp.Min(up(b), r2, up(a)),
        lambda a, b, r2: sp.Piecewise((r2, sp.Or(up(a) < 0, up(b) < 0)), (sp.log(1 - r2), True)),
    ]
    for number, V in enumerate([*asymmetric, *symmetric]):
        def pair(a, b, k, V=V):
            return k * V(a, b, square(a, b, (0, 0, 0), (0, 0, 0)))

        if number >= len(asymmetric):
            assert box(2, pair, {"k": 1.0}).system.copies == 2
            continue
        with pytest.raises(InputError, match="swapped"):
            pytest.fail(f"potential {number} gave {box(2, pair, {'k': 1.0})}")
