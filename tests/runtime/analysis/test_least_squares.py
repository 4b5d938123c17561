"""Least squares: the least sum is where the normal equations say, and steps are short enough."""

from __future__ import annotations

import numpy as np
import pytest

from gyrospark.runtime.analysis.least_squares import Linear, minimise

#: Residuals A x − b of four numbers by two unknowns.
A = 100 * np.array([[1.0, 0.5], [0.0, 3.0], [2.0, -1.0], [0.3, 0.2]])
B = A @ [3.0, -2.0] + [0.3, -0.2, 0.1, 0.7]


@pytest.mark.parametrize("longest", [np.inf, 0.05])
def test_steps_are_no_longer_than_they_may_be(longest):
    """To the solution of the normal equations, in steps of the largest length where it is far."""
    lengths = []

    def moved(x, y):
        lengths.append(np.linalg.norm(y))
        return x + y

    found = minimise(
        np.array([3.3, -1.7]), lambda x: A @ x - B, lambda x: Linear(A @ x - B, A, np.ones(2)),
        moved, lambda x, y: np.linalg.norm(y) / longest, tolerance=1e-20, iteration_limit=60)
    assert found.converged
    assert np.abs(found.point - np.linalg.solve(A.T @ A, A.T @ B)).max() < 1e-9
    assert max(lengths) <= longest * (1 + 1e-15)
    assert lengths[:4] == pytest.approx(lengths[:1] * 4) or longest == np.inf
