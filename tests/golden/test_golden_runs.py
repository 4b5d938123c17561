"""The golden runs can tell bits apart, and see the same ones twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import golden_runs
from processes import ROOT

FEW = ["2G-L gamma double", "EMS gamma double"]


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_two_runs_give_the_same_bits_and_another_stepper_others():
    first, second = (golden_runs.all_bits(FEW, jobs=1) for _ in range(2))
    assert golden_runs.differences(first, second) == []
    assert not any("error" in bits for bits in first.values())
    swapped = {FEW[0]: first[FEW[1]], FEW[1]: first[FEW[0]]}
    assert len(golden_runs.differences(first, swapped)) >= 10


def test_one_bit_is_seen():
    x = np.ones(3)
    assert golden_runs.digits(x) != golden_runs.digits(np.nextafter(x, 2))
    assert golden_runs.digits(x.astype(np.longdouble)) != golden_runs.digits(
        np.nextafter(x.astype(np.longdouble), 2))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The fastest rotation")  # runs in processes inherit filters
def test_another_checkout_of_the_same_text_has_the_same_bits():
    quick = golden_runs.QUICK[:6]
    hashes = golden_runs.all_bits(quick, jobs=2)
    assert golden_runs.differences(hashes, golden_runs.of_checkout(Path(ROOT), quick, jobs=2)) == []
