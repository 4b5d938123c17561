"""Derivatives of reference problems and models, by the script that measures all of them."""

from __future__ import annotations

import warnings

import pytest

import gyrospark as gs
from benchmarks.derivative_accuracy import measure, subjects

#: Of 567 coordinates, which takes minutes.
LARGE = {"four-bars-40"}


@pytest.mark.slow  # compiles the derivatives of each
@pytest.mark.parametrize("name", [name for name in (*gs.references.names(), *gs.models.__all__)
                                  if name not in LARGE])
def test_one_step(name):
    (subject,) = subjects([name])
    small = subject.model.system.n <= 7
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gs.errors.InputWarning)  # of rotations a step
        accuracy = measure(subject, "float128" if small else "double")
    assert accuracy.differences < (1e-18 if small else 1e-4)
    assert accuracy.transposed < 1e-14
    assert accuracy.tangent < 1e-13
    assert (accuracy.symplectic or 0) < 4e-15
    assert (accuracy.backwards or 0) < 1e-14
