"""Many equal molecules from one pair: the kicks of an explicit system, and a thousand waters."""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.splitting.find import split
from gyrospark.generator.splitting.repeated import repeat
from splitting_flows import Flows, compiled

#: Three charged sites, on the molecule; the first repels others of its kind at short range.
SITES = {(0.0, 0.0, 0.0655): -0.834, (0.757, 0.0, -0.5205): 0.417, (-0.757, 0.0, -0.5205): 0.417}
INERTIA = (1.34, 1.93, 0.6)


def waters(count, *, sites=3, spacing=3.0):
    """Return a model of rigid waters with so many charges each, held by a spring to the origin."""
    rng, charges = np.random.default_rng(3), dict(list(SITES.items())[:sites])
    build = gs.Multibody("waters", gravity=(0, 0, 0))
    charge, well = build.parameter("charge", 332.06), build.parameter("well", 0.01)
    size = math.ceil(count ** (1 / 3))
    bodies = []
    for i in range(count):
        place = spacing * np.array([i % size, i // size % size, i // size**2]) - spacing * size / 2
        turn = rng.standard_normal(4)
        bodies.append(build.body(f"w{i}", mass=18.0, inertia=INERTIA, position=place,
                                 quaternion=turn / np.linalg.norm(turn),
                                 angular_velocity=rng.standard_normal(3)))
        build.potential(well * sum(x**2 for x in bodies[-1].point((0, 0, 0))) / 2)
    for a, b in combinations(bodies, 2):
        for s, u in charges.items():
            for t, v in charges.items():
                square = sum((x - y)**2 for x, y in zip(a.point(s), b.point(t), strict=True))
                build.potential(charge * u * v / sp.sqrt(square))
        square = sum((x - y)**2 for x, y in zip(a.point(next(iter(SITES))),
                                                b.point(next(iter(SITES))), strict=True))
        build.potential(582000 / square**6 - 595 / square**3)
    return build.model()


class Box:
    """Molecules of ``repeat`` in NumPy: one kernel for all pairs."""

    def __init__(self, molecules, values):
        self.m, parameters = molecules, molecules.pair.system.parameters
        self.kernels = []
        for template in (*molecules.single, *molecules.pairs):
            at = molecules.instance(template, 0, 1)
            names = dict(zip(template.constants, (sp.Float(values[str(parameters[k])], 17)
                                                  for k in at.constants), strict=True))
            arguments = [*(x for q in template.bodies for x in q), *template.coordinates]
            rows = [template.V, *(e for N in template.kick.torques for e in N),
                    *template.kick.forces]
            self.kernels.append((template, at, compiled(
                arguments, [e.xreplace(names) for e in rows])))

    def kick(self, q):
        """Return V, torques and forces for coordinates (count, 7)."""
        count = len(q)
        i, j = np.triu_indices(count, 1)
        V, torques, forces = 0.0, np.zeros((count, 3)), np.zeros((count, 3))
        for template, at, kernel in self.kernels:
            places = (i, j) if template in self.m.pairs else (np.arange(count),)
            columns = [q[places[b], k] for b in at.bodies for k in range(4)]
            columns += [q[places[x // 7], x % 7] for x in at.coordinates]
            found = [np.broadcast_to(e, len(places[0])) for e in kernel(*columns)]
            V += found[0].sum()
            for n, b in enumerate(at.bodies):
                for k in range(3):
                    torques[:, k] += np.bincount(places[b], found[1 + 3 * n + k], count)
            for e, x in zip(found[1 + 3 * len(at.bodies):], at.coordinates, strict=True):
                forces[:, x % 7 - 4] += np.bincount(places[x // 7], e, count)
        return V, torques, forces


def test_kicks_are_those_of_the_explicit_system():
    pair, three = waters(2, sites=1), waters(3, sites=1)
    molecules = repeat(split(pair.system), 3)
    assert len(molecules.single) == 1
    box = Box(molecules, pair.parameters)
    whole = Flows(split(three.system), three.parameters)
    x = whole.start(three.q0, three.p0)
    wanted = np.array(whole.kick_of(*x.q, *x.l.ravel(), *x.p, 0.0))
    V, torques, forces = box.kick(three.q0.reshape(3, 7))
    np.testing.assert_allclose([*torques.ravel(), *forces.ravel()], wanted, rtol=1e-10, atol=1e-12)
    H = sp.lambdify([three.system.q], whole.s.V.xreplace(whole.values))
    np.testing.assert_allclose(V, H(three.q0), rtol=1e-12)


@pytest.mark.parametrize(("count", "t_end"), [
    (20, 0.1), pytest.param(1000, 0.02, marks=pytest.mark.slow)])
def test_waters_keep_their_energy(count, t_end):
    pair = waters(2)
    box = Box(repeat(split(pair.system), count), pair.parameters)
    rng, size = np.random.default_rng(5), math.ceil(count ** (1 / 3))
    grid = 3.0 * (np.array([[i % size, i // size % size, i // size**2] for i in range(count)])
                  - size / 2)
    turns = rng.standard_normal((count, 4))
    start = np.column_stack([turns / np.linalg.norm(turns, axis=1)[:, None], grid])
    errors = []
    for h in (0.01, 0.005):
        energies = list(run(box, start.copy(), rng=np.random.default_rng(6), h=h,
                            steps=round(0.05 / h)))
        errors.append(abs(energies[-1] - energies[0]) / count)
    assert errors[0] < 0.05
    assert errors[0] / errors[1] > 3


def run(box, q, *, rng, h, steps):
    """Yield the energy along symmetric steps of asymmetric molecules."""
    moments, mass = np.array(INERTIA), 18.0
    l, p = rng.standard_normal((len(q), 3)), mass * 0.1 * rng.standard_normal((len(q), 3))  # noqa: E741
    V, torques, forces = box.kick(q)
    yield energy(q, l, p, V, moments, mass)
    for _ in range(steps):
        l, p = l + h / 2 * torques, p + h / 2 * forces  # noqa: E741
        body = q[:, :4]
        for axis, d, t in ((1, 1 / moments[1] - 1 / moments[0], h / 2), (None, None, h),
                           (1, 1 / moments[1] - 1 / moments[0], h / 2)):
            if axis is None:
                body = right(body, l, 2, 1 / moments[2] - 1 / moments[0], h)
                body = left(body, l / moments[0], h)
            else:
                body = right(body, l, axis, d, t)
        q = np.column_stack([body, q[:, 4:] + h * p / mass])
        V, torques, forces = box.kick(q)
        l, p = l + h / 2 * torques, p + h / 2 * forces  # noqa: E741
        yield energy(q, l, p, V, moments, mass)


def energy(q, l, p, V, moments, mass):  # noqa: E741
    m = np.einsum("nji,nj->ni", matrices(q), l)
    return V + (m**2 / moments).sum() / 2 + (p**2).sum() / (2 * mass)


def matrices(q):
    """Return R(q) of each row."""
    v, w = q[:, 1:4], q[:, 0]
    across = np.cross(v[:, None, :], np.eye(3)[None])  # row k is v × e_k
    return (np.einsum("n,ij->nij", w**2 - (v**2).sum(1), np.eye(3))
            + 2 * v[:, :, None] * v[:, None, :] + 2 * w[:, None, None] * np.swapaxes(across, 1, 2))


def times(a, b):
    return np.column_stack([a[:, 0] * b[:, 0] - (a[:, 1:] * b[:, 1:]).sum(1),
                            a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:]
                            + np.cross(a[:, 1:], b[:, 1:])])


def turning(w):
    size = np.linalg.norm(w, axis=1)
    return np.column_stack([np.cos(size), w * np.sinc(size / np.pi)[:, None]])


def left(q, W, t):
    return times(turning(t * W / 2), q)


def right(q, l, axis, d, t):  # noqa: E741
    rate = d * (matrices(q)[:, :, axis] * l).sum(1)
    return times(q, turning(t / 2 * rate[:, None] * np.eye(3)[axis]))


def test_other_systems_are_refused():
    with pytest.raises(gs.GyrosparkError, match="no pair"):
        repeat(split(gs.models.satellite().system), 10)
    with pytest.raises(gs.GyrosparkError, match="count"):
        repeat(split(waters(2).system), 1)
    build = gs.Multibody("unlike", gravity=(0, 0, 0))
    bodies = [build.body(name, mass=1, inertia=(1, 2, 2.5)) for name in "ab"]
    build.potential(bodies[0].x[0]**2 / 2)
    with pytest.raises(gs.GyrosparkError, match="alone"):
        repeat(split(build.model().system), 3)
