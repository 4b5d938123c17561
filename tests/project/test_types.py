"""mypy on programs of users: right lines pass, and each wrong one is flagged."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PROGRAMS = sorted((ROOT / "tests" / "data" / "programs").glob("*.py"))
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
step.integrate(top, dt=1e-3, tend=1)
step.integrate(top, dt=1e-3, t_end=1, parameter={"mgl": 0.3})
step.integrate(top, dt=1e-3, t_end=1, solver="newtn")
step.integrate([1, 0, 0, 0], dt=1e-3, steps=1)
step.integrate(top, dt=1e-3, steps=1, t0=0.5)
gs.Solver("newton", tol=1e-9)
gs.stepper("GL", stages=3)
gs.stepper("G-L", stages="3")
gs.record(step, top, dt=1e-3, steps=1, out="x.zarr")
gs.load_mjcf("arm.xml")
gs.sweep(top, {"mgl": [0.3]}, dt=1e-3, duration=1.0)
gs.lyapunov(step, top, dt=1e-3, t_end=2, cuont=2)
step.start(top, dt=1e-3).advance("10")
run.view("top.html")
"""


@pytest.mark.slow  # mypy reads the package
def test_right_programs_pass_and_each_wrong_line_is_flagged(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(RIGHT + WRONG, encoding="utf-8")
    # within the repository they would be modules of a second package, named as its folder
    copies = [shutil.copy(path, tmp_path) for path in PROGRAMS]
    source = Path(sys.prefix, "src")
    mypy = [sys.executable, "-m", "mypy", "--strict", "--config-file", ROOT / "pyproject.toml"]
    process = subprocess.run([*mypy, program, *copies], cwd=source,
                             env=os.environ | {"MYPYPATH": str(source)},
                             capture_output=True, text=True, check=False)
    flagged = re.findall(r"(\w+\.py):(\d+): error", process.stdout)
    first = RIGHT.count("\n") + 2
    lines = range(first, first + len(WRONG.strip().splitlines()))
    assert {(name, int(line)) for name, line in flagged} == {
        ("program.py", line) for line in lines}, process.stdout


@pytest.mark.slow  # derives and compiles ten systems
@pytest.mark.parametrize("path", PROGRAMS, ids=lambda path: path.stem)
def test_right_programs_run(path, tmp_path):
    if path.stem == "gradient":
        pytest.importorskip("jax", reason="pip install gyrospark[jax]")
    if path.stem == "robot":
        pytest.importorskip("mujoco", reason="pip install gyrospark[robots]")
    subprocess.run([sys.executable, path], cwd=tmp_path, check=True, capture_output=True)
