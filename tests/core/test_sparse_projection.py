"""Projections with sparse matrices against dense ones, and the models that have them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

import gyrospark as gs
from gyrospark.core.projection import dependent_rows, solve_sparse
from gyrospark.generator.systems import numeric_system
from gyrospark.generator.systems.numeric_system import find_colours


def _banded(rng: np.random.Generator, m: int, n: int, band: int) -> np.ndarray:
    i, j = np.indices((m, n))
    return np.where(abs(i * n - j * m) <= band * n, rng.standard_normal((m, n)), 0)


@pytest.mark.parametrize(("m", "n", "band"), [(1, 3, 0), (40, 70, 2), (97, 150, 3)])
def test_solutions_are_those_of_dense_matrices(m, n, band):
    rng = np.random.default_rng(m)
    G, scale, y = _banded(rng, m, n, band), 10.0 ** rng.uniform(-9, 9, m), rng.standard_normal(m)
    A = G @ G.T + np.eye(m)
    wanted = np.linalg.solve(A, y / scale) / scale
    assert solve_sparse(csr_array(A * np.outer(scale, scale)), y) == pytest.approx(wanted, rel=1e-8)
    indefinite = A - 1.01 * np.linalg.eigvalsh(A)[0] * np.eye(m)
    with pytest.raises(np.linalg.LinAlgError):
        solve_sparse(csr_array(indefinite * np.outer(scale, scale)), y)


def test_dependent_rows_of_sparse_matrices_are_those_of_dense_ones():
    G = _banded(np.random.default_rng(7), 40, 70, 2)
    assert dependent_rows(csr_array(G)) == dependent_rows(G) == ([], [])
    G[30] = 2 * G[28] - G[29]
    assert dependent_rows(csr_array(G)) == dependent_rows(G) == ([28, 29, 30], [30])


def test_no_row_has_a_colour_twice():
    rows = [sorted(np.random.default_rng(k).choice(30, 5, replace=False).tolist())
            for k in range(40)]
    colours = find_colours(rows, 30)
    assert all(len({*colours[row]}) == len(row) for row in rows)
    assert colours.max() < 30
    assert find_colours([[k, k + 1] for k in range(29)], 30).max() == 1


@pytest.mark.parametrize("make", [
    lambda: gs.models.chain(5), gs.models.double_pendulum, gs.models.four_bar,
    lambda: _driven()])
def test_models_are_the_same_with_sparse_matrices(monkeypatch, make):
    dense = make()
    monkeypatch.setattr(numeric_system, "_SPARSE", 0)
    sparse = make()
    assert np.allclose(sparse.q0, dense.q0, atol=1e-14)
    assert np.allclose(sparse.p0, dense.p0, atol=1e-12 * abs(dense.p0).max())
    numbers = {**dense.parameters, **dict.fromkeys(dense.bodies, 0.02)}
    moved = gs.consistent(sparse.system, dense.q0 + 1e-3, dense.p0 + 1e-3, parameters=numbers)
    monkeypatch.undo()
    expected = gs.consistent(dense.system, dense.q0 + 1e-3, dense.p0 + 1e-3, parameters=numbers)
    assert np.allclose(moved.q, expected.q, atol=1e-13)
    assert np.allclose(moved.p, expected.p, atol=1e-12)
    assert np.abs(moved.q - dense.q0).max() > 1e-5


def _driven() -> gs.Model:
    """Return a body on a point that moves: constraints depend on t."""
    build = gs.Multibody("driven")
    body = build.body("a", mass=1.0, inertia=(0.1, 0.2, 0.3), angular_velocity=(1, 2, 3))
    point = build.moving_point("hook", (build.time, 2 * build.time**2, 0))
    build.ball("joint", point, body, on_b=(0, 0, 0.5), on_a=(0, 0, 0))
    return build.model()


def test_redundant_constraints_have_their_names_with_sparse_matrices(monkeypatch):
    monkeypatch.setattr(numeric_system, "_SPARSE", 0)
    build = gs.Multibody("two")
    body = build.body("a", mass=1.0, inertia=(0.1, 0.2, 0.3))
    for name in ("one", "other"):
        build.fixed_point(name, body, at=(0, 0, 0), on_body=(0, 0, 0.5))
    with pytest.raises(gs.InputError, match="other: x"):
        build.model()
