"""Builds of the same C by different compilers and flags: short versions of the study of all."""

from __future__ import annotations

import numpy as np
import pytest

from compiler_differences import (
    BUILDS,
    Build,
    KernelDifference,
    compare,
    main,
    sources,
)
from compilers import COMPILERS, compiler

POINTS = 100


def source(name):
    return next(make for found, make in sources() if found == name)()


class Wrong(Build):
    """A compiler that changes the twelfth digit of the sums in a constraint."""

    def compile(self, source, target):
        text, total = source.read_text(encoding="utf-8"), "sum[0] = total;"
        assert total in text
        source.write_text(text.replace(total, "sum[0] = total*(1 + 1e-12);"), encoding="utf-8")
        return super().compile(source, target)


@pytest.mark.slow  # three compilations, of a study that only slow tests make
def test_a_wrong_digit_is_not_explained_by_rounding():
    kind = next(iter(COMPILERS), None) or pytest.skip("gcc and clang are not installed")
    made = compare(source("heavy_top_gl1_gamma"), [Wrong(kind, ("-O0",))], POINTS)
    found = {one.function: one.holds for one in made}
    assert not found["defects"]
    assert found["hamiltonian"]


def test_what_is_not_finite_does_not_hold():
    assert not KernelDifference("s", "b", "f", 1, np.inf, 1.0, 0).holds
    assert not KernelDifference("s", "b", "f", 1, np.nan, 1.0, 0).holds


@pytest.mark.slow
def test_all_steppers_by_all_compilers(capsys):
    for kind in {build.kind for build in BUILDS}:
        compiler(kind)
    assert main(["--points", "1000", "--minutes", "15"]) == 0, capsys.readouterr().out
