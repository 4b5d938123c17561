"""Bases of tangent spaces: orthonormal, complete, also where rows depend on each other."""

from __future__ import annotations

import numpy as np
import pytest

from gyrospark.runtime.derivatives.tangent_space import null_space


@pytest.mark.parametrize(("size", "count", "dependent"), [
    (8, 2, 0), (28, 16, 1), (14, 6, 2), (6, 0, 0), (5, 5, 1)])
def test_a_basis_is_orthonormal_and_complete(size, count, dependent):
    rows = np.random.default_rng(0).normal(size=(count, size))
    for k in range(dependent):
        rows[-1 - k] = rows[0] + (k + 1) * rows[1]
    basis = null_space(rows)
    assert basis.shape == (size, size - count + dependent)
    assert np.abs(rows @ basis).max(initial=0) < 1e-14 * max(np.abs(rows).max(initial=1), 1)
    assert np.abs(basis.T @ basis - np.eye(basis.shape[1])).max() < 1e-15
