"""mypy on programs of users: right lines pass, and each wrong one is flagged."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RIGHT = """
from fractions import Fraction
import numpy as np
import gyrospark as gs
top, step = gs.problems.fast_top(), gs.stepper("G-L", stages=3)
tuned = gs.tune(step, top, dt=1e-3, gamma="auto", aim="energy")
run = step.integrate(top, dt=tuned.dt, t_end=1, parameters=tuned.parameters)
mean = gs.gamma(top.inertia, "h")
step.integrate(run[-1], dt=Fraction(1, 1000), steps=3, parameters={"gamma": mean})
step.integrate_ensemble([top, top], dt=1e-3, steps=3, parameters={
    "mgl": np.linspace(0.3, 0.4, 2), "gamma": [1e-3, 2e-3], "I1": 2e-3})
"""
WRONG = """
step.integrate(top, dt=1e-3, t_end=1, parameters={"gamma": "auto"})
step.integrate(top, dt="auto", t_end=1)
step.integrate_ensemble([top, top], dt=1e-3, steps=3, parameters={"gamma": "auto"})
gs.tune(step, top, dt=1e-3, gamma="fast")
gs.gamma(top.inertia, "fast")
gs.Start([1.0], [0.0], {"m": "1"})
"""


@pytest.mark.slow  # mypy reads the package
def test_text_in_place_of_numbers_is_flagged(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(RIGHT + WRONG, encoding="utf-8")
    source = Path(sys.prefix, "src")
    mypy = [sys.executable, "-m", "mypy", "--strict", "--config-file", ROOT / "pyproject.toml"]
    done = subprocess.run([*mypy, program], cwd=source, env=os.environ | {"MYPYPATH": str(source)},
                          capture_output=True, text=True, check=False)
    flagged = {int(line) for line in re.findall(r"program\.py:(\d+): error", done.stdout)}
    first = RIGHT.count("\n") + 2
    assert flagged == set(range(first, first + len(WRONG.strip().splitlines()))), done.stdout
