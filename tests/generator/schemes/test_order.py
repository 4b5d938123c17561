"""Observed orders of convergence on an asymmetric heavy top, which has no closed form.

The slope of log error against log Δt over halved steps. Points under the round-off plateau are
dropped, and at least three must be left: an order is no order by fewer.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.generator.spec import PAPER_SPECS
from strategies import EPS, few, identify, make_case, stepper_of

SPAN = 2.0
#: Over 500 steps a random walk of 1 ε steps ends at 25 ε; 40 times that leaves 3 % at the plateau.
PLATEAU = 1000 * EPS
#: Of the slope. The next term of an even method is smaller by C Δt², C Δt² < 1/10 where it counts.
TOLERANCE = 0.15
#: Slopes are taken over the finest of the points kept.
POINTS = 4


@cache
def top(rep):
    """Return a body with three moments, in gravity that bends its motion, and |Ω| = 2 or so."""
    return make_case(rep, (1.0, 1.7, 0.6), 0.2, 0.9, (0.5, -0.3, 0.7, 0.4), (0.9, -1.4, 1.1), 1.0)


def expected_order(spec):
    """Return the order of Table 1, or 2."""
    if spec.stages is None:
        return 2
    return 2 * spec.stages if spec.scheme == "G-L" else 2 * spec.stages - 2


def observed_order(dts, errors):
    return float(np.polyfit(np.log(dts), np.log(errors), 1)[0])


@cache
def exact_end():
    """Return the end by G-L 8, order 16, with Δt|Ω| = 0.04: truncation below 1e-18."""
    case = top("gamma")  # the motion is the same in both representations
    run = gs.stepper("G-L", 8).integrate(case.q, case.p, dt=SPAN / 100, steps=100,
                                              parameters=case.parameters)
    return run.q[-1], run.p[-1]


def end_error(spec, steps):
    """Return the errors of q and p at the end, relative to their sizes."""
    case = top(spec.rep)
    run = stepper_of(spec).integrate(case.q, case.p, dt=SPAN / steps, steps=steps,
                                     parameters=case.parameters, every=steps)
    q, p = exact_end()
    return [np.abs(run.q[-1] - q).max(), np.abs(run.p[-1] - p).max() / np.abs(p).max()]


@pytest.mark.parametrize("spec", few(PAPER_SPECS), ids=identify)
def test_order(spec):
    step = stepper_of(spec)
    assert step.order == expected_order(spec)
    counts = np.array(sorted(first * 2**k for first in (4, 6) for k in range(7)))
    errors = np.array([end_error(spec, int(count)) for count in counts])
    for name, error in zip("qp", errors.T, strict=True):
        kept = error > PLATEAU
        assert kept.sum() >= 3
        slope = observed_order(SPAN / counts[kept][-POINTS:], error[kept][-POINTS:])
        print("SLOPE", identify(spec), name, f"{slope:.3f}", f"{kept.sum()} points")
        assert abs(slope - step.order) < TOLERANCE
