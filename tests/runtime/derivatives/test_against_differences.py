"""Tangents of one step against central differences of float128 steps.

Every column is a relative change of its variable, and errors are relative to the largest entry of
their row: some columns are truncation errors of the step, and have no size of their own.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import gyrospark as gs
from derivative_cases import (
    case_of,
    difference,
    directions,
    label,
    moved_step,
    product,
    start_of,
    stepper_for,
    tangents_of_step,
)

#: SPARK with everything that a system may have. Each compiles a stepper in float128; mean values,
#: sums over elements and Lagrangians are quick in double.
FEW = [("driven_pendulum", ("G-L", 2), "float128"), ("breathing", ("EMS", None), "double"),
       ("beads", ("G-L", 2), "double"), *(("lagrangian", scheme, "double") for scheme in (
           ("G-L", 2), ("IMS", None), ("EMS", None)))]
MANY = [pytest.param(*case, marks=[] if case in FEW else pytest.mark.slow,
                     id=f"{case[0]}-{label(case[1])}-{case[2]}") for case in (
    *FEW, *((*pair, "float128") for pair in [*product(), ("beads", ("G-L", 2))]
            if (*pair, "float128") not in FEW))]
#: The size of a difference of order 4, and the digits that it has.
SIZES = {"float128": (2.0**-36, 2e-21, 1e-18), "double": (2.0**-10, 1e-10, 1e-7)}


@pytest.mark.parametrize(("name", "scheme", "real"), MANY)
def test_tangents_are_the_limits_of_differences(name, scheme, real):
    """Columns are the start, each parameter and input, the rate of a frame, dt, and the start time.

    Multipliers have the digits of the state, less those of 1/h².
    """
    step, (size, close, close_forces) = stepper_for(name, scheme, real), SIZES[real]
    case, (q, p) = case_of(name), start_of(name, step)
    every = directions(name)
    tangents = step.integrate(gs.Start(q, p, t=case.t0), dt=case.dt, steps=1,
                              parameters=case.parameters, tangents=gs.Tangents(
               "all", [*case.parameters], dt=True, t0="t0" in every[-1],
               multipliers=step.m > 0)).tangents
    rows, start = tangents.together()[-1], 2 * (step.n - step.m)
    along = np.array([[direction.get(name, 0.0) for name in tangents.names[start:]]
                      for direction in every]).T
    rows = np.concatenate([rows[:, :start], rows[:, start:] @ along], axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gs.errors.InputWarning)  # of steps long for their order
        columns = [difference(lambda e, dz=dz: moved_step(name, step, {}, e, dz), size)
                   for dz in tangents.start[:, :start].T]
        columns += [difference(lambda e, d=direction: moved_step(name, step, d, e), size)
                    for direction in every]
    expected = np.array(columns).T
    errors = (np.abs(rows - expected) / np.abs(expected).max(axis=1)[:, None]).max(axis=1)
    assert expected.shape == (2 * step.n + step.binding.multipliers, start + len(every))
    assert float(errors[: 2 * step.n].max()) < close
    assert float(errors[2 * step.n :].max(initial=0)) < close_forces


@pytest.mark.parametrize("real", ["double", *(pytest.param(x, marks=pytest.mark.slow)
                                              for x in ("float", "long-double"))])
def test_other_types_have_the_digits_of_their_kind(real):
    name = "driven_pendulum"
    step, exact = (stepper_for(name, ("G-L", 2), kind) for kind in (real, "float128"))
    (basis, tangents), (exact_basis, expected) = (tangents_of_step(name, s) for s in (step, exact))
    turned = np.asarray(basis.T @ basis, float)
    assert np.abs(turned - np.eye(2)).max() < 40 * float(step.binding.epsilon)
    along = exact_basis.T.astype(float) @ basis.astype(float)  # one space, another basis
    error = np.abs(tangents.astype(float) - expected.astype(float) @ along).max()
    assert error < max(100 * float(step.binding.epsilon), 1e-14)
