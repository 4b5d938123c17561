"""Residual and Jacobian of every paper stepper against the reference residual in 62 digits."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from reference import WORKING_DIGITS, doubles, numbers, reference
from strategies import (
    EPS,
    PAPER_SPECS,
    few,
    identify,
    random_case,
    stepper_of,
)

CASES = 2


def random_unknowns(spec, case, rng):
    """Return unknowns off the solution by a tenth, so that no row of r or J is trivially small."""
    method = reference(spec, case)
    x = method.guess()
    n = method.n
    stages = spec.stages or 1
    if spec.stages is None:
        moved = np.concatenate([case.q, case.p]) + abs(case.dt) * _rates(method)
        x[: 2 * n] = moved * (1 + 0.01 * rng.standard_normal(2 * n))
    else:
        x[: 2 * n * stages] *= 1 + 0.1 * rng.standard_normal(2 * n * stages)
    speed = np.linalg.norm(case.omega)
    forces = x[2 * n * stages :]
    forces[:] = np.linalg.norm(case.p) * speed * rng.standard_normal(len(forces))
    return method, x


def _rates(method):
    e, _, q, p = method.at(float)
    return np.concatenate([e.H_p(q, p), -e.H_q(q, p)])


def blocks(spec, case, method, x):
    """Yield the three blocks of rows with the size of what is added up in each."""
    n, rows = method.n, 4 * (spec.stages or 1)
    e, _, q, p = method.at(float)
    if spec.stages is None:
        rates = np.abs(x[: 2 * n] - np.concatenate([q, p])) / abs(case.dt)
        sizes = rates[:n].max(), max(rates[n:].max(), 2 * np.abs(x[2 * n :]).max())
    else:
        force = 2 * np.abs(x[2 * rows :]).max() * abs(case.dt)
        speed = np.linalg.norm(case.omega)
        sizes = np.abs(x[:rows]).max(), max(np.abs(x[rows : 2 * rows]).max(), force * speed)
    yield slice(0, rows), max(sizes[0], np.abs(e.H_p(q, p)).max())
    yield slice(rows, 2 * rows), max(sizes[1], np.abs(e.H_q(q, p)).max())
    yield slice(2 * rows, None), 1.0


@pytest.mark.parametrize("spec", few(PAPER_SPECS), ids=identify)
def test_residual(spec):
    """64 ε of the largest term: sums over up to 5 stages and 4 components, some nested."""
    step, rng = stepper_of(spec), np.random.default_rng(11)
    for _ in range(CASES):
        case = random_case(rng, spec.rep)
        method, x = random_unknowns(spec, case, rng)
        with mp.workdps(WORKING_DIGITS):
            error = doubles(step.residual(x, case.q, case.p, **case.run)
                            - method.residual(mp.mpf)(numbers(x, mp.mpf)))
        for rows, size in blocks(spec, case, method, x):
            assert np.abs(error[rows]).max() <= 64 * EPS * size


@pytest.mark.parametrize("spec", few(PAPER_SPECS), ids=identify)
def test_jacobian(spec):
    """1e-12 of the largest entry of the row, and of each of its blocks as far as rounding allows.

    Rows hold k (1/s), k̂ (J) or lengths, and columns rates or multipliers: a block of columns is
    compared with its own largest entry, unless it is small against the sums it comes from.
    """
    step, rng = stepper_of(spec), np.random.default_rng(12)
    for _ in range(CASES):
        case = random_case(rng, spec.rep)
        method, x = random_unknowns(spec, case, rng)
        exact = method.jacobian(x)
        made = step.jacobian(x, case.q, case.p, **case.run)
        assert made.shape == exact.shape == (step.unknowns, step.unknowns)
        error = np.abs(made - exact)
        assert np.all(error.max(axis=1) <= 1e-12 * np.abs(exact).max(axis=1))
        cut = step.n * (spec.stages or 1)
        parts = [slice(0, cut), slice(cut, 2 * cut), slice(2 * cut, None)]
        for rows in parts:
            for columns in parts:
                block = np.abs(exact[rows, columns])
                assert error[rows, columns].max() <= 1e-12 * block.max()
