"""Sparse matrices against dense ones, and the models that are projected with them."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.core.sparse_matrix import BandCholesky, SparseMatrix, find_colours
from gyrospark.generator.systems import numeric_system


def _random(rng: np.random.Generator, m: int, n: int, band: int) -> SparseMatrix:
    i, j = np.indices((m, n)).reshape(2, -1)
    near = abs(i * n - j * m) <= band * n
    return SparseMatrix.of((m, n), i[near], j[near], rng.standard_normal(near.sum()))


@pytest.mark.parametrize(("m", "n", "band"), [(1, 3, 0), (40, 70, 2), (97, 150, 3)])
def test_products_and_solutions_are_those_of_dense_matrices(m, n, band):
    rng = np.random.default_rng(m)
    A, B, x, y = _random(rng, m, n, band), _random(rng, n, m, band), *map(
        rng.standard_normal, (n, m))
    dense = A.toarray()
    assert np.allclose(A @ x, dense @ x, atol=1e-14)
    assert np.allclose((A @ B).toarray(), dense @ B.toarray(), atol=1e-13)
    assert np.array_equal(A.T.toarray(), dense.T)
    assert np.array_equal(abs(A).toarray(), abs(dense))
    assert A.norm_1() == pytest.approx(np.linalg.norm(dense, 1))
    scale = rng.uniform(1, 2, m)
    AA, at = A @ A.T, np.arange(m)
    square = SparseMatrix.of((m, m), np.append(AA.rows, at), np.append(AA.columns, at),
                             np.append(AA.values, scale)).scaled(scale, scale)
    full = (dense @ dense.T + np.diag(scale)) * np.outer(scale, scale)
    assert np.allclose(square.toarray(), full, atol=1e-12)
    assert np.array_equal(square.diagonal(), np.diag(square.toarray()))
    assert np.allclose(BandCholesky(square).solve(y), np.linalg.solve(full, y), rtol=1e-8)
    least = np.linalg.eigvalsh(full)[0]
    BandCholesky(square, 0.99 * least)
    with pytest.raises(np.linalg.LinAlgError):
        BandCholesky(square, 1.01 * least)


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
