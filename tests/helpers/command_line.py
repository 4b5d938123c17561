"""A command line that runs, one that fails, and how a refused one answers."""

from __future__ import annotations

from processes import ROOT

EXAMPLE = ROOT / "examples" / "tableaux" / "gauss_lobatto_2.json"
#: Keys of the JSON of every run.
CONTRACT = {
    "steps", "dt", "t_end", "q", "p", "energy_error_max", "energy_error_mean", "constraint_max",
    "momentum_constraint_max", "iterations_mean", "iterations_max", "seconds", "ns_per_step",
}
RUN = ["run", "fast-top", "--scheme", "G-L", "--stages", "2", "--dt", "1e-3", "--steps", "20"]
FAILS = ["run", "fast-top", "--scheme", "G-L", "--stages", "2", "--dt", "1", "--steps", "20"]
#: The eccentric orbit of the catalogue as a file, which so has its stepper.
ECCENTRIC = """name = "eccentric"
[system]
coordinates = ["x", "y"]
momenta = ["u", "v"]
hamiltonian = "(u**2 + v**2)/2 - k/sqrt(x**2 + y**2)"
time_scale = "(x**2 + y**2)**(3/4)"
[parameters]
k = 1
[start]
q = [0.4, 0]
p = [0, 2]
"""


def refused(answer, *fragments, code=2):
    """Check one line on stderr with all fragments, nothing on stdout, and the exit code."""
    assert answer.code == code, answer.stderr
    assert answer.stdout == ""
    assert answer.stderr.count("\n") == 1
    assert answer.stderr.endswith("\n")
    assert "Traceback" not in answer.stderr
    for fragment in fragments:
        assert fragment in answer.stderr, answer.stderr
