"""Inputs of the tests of sweeps: a body, axes, a study of 1,280 cells."""

from __future__ import annotations

from pathlib import Path

import pytest

import gyrospark as gs

#: Of tests in which cells fail.
FAILURES = pytest.mark.filterwarnings("ignore:.*cells of the sweep failed")
TOP = gs.problems.fast_top()
GAMMAS, STEPS = [8e-4, 1.2e-3, 1.6e-3], [1e-3, 2e-3]
OVER = {"gamma": GAMMAS, "dt": STEPS}
STUDY = """
model = "fast-top"
scheme = "G-L 2"
steps = 100
[grid]
gamma = { from = 4e-4, to = 4e-3, count = 40, spacing = "log" }
dt = { from = 1e-4, to = 2e-3, count = 32, spacing = "log" }
"""


def study_file(folder: Path, text: str = STUDY) -> Path:
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path
