"""Options of a study file that are handed to the stepper and its runs."""

from __future__ import annotations

from pathlib import Path

from gyrospark.sweeps.study_file import parse_study

TEXT = """
model = "fast-top"
scheme = "G-L"
stages = 2
rep = "gamma"
real = "double"
frame = "symmetries"
dt = 1e-3
steps = 1e3
every = 10
solver = "newton"
tolerance = 1e-12
max_iterations = 30
keep = ["energy_error_max"]
[grid]
gamma = [4e-4, 8e-4]
"""


def test_every_option_reaches_the_study():
    made = parse_study(TEXT, Path("options.toml"))
    study, (step,) = made.study, made.study.steppers
    assert made.keep == ["energy_error_max"]
    assert step.name == "heavy_top_gl2_gamma_frame"
    assert (study.name, study.dt, study.steps, study.every, study.solver, study.tolerance,
            study.max_iterations) == ("options", 1e-3, 1000, 10, "newton", 1e-12, 30)
