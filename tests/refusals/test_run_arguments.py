"""Refused arguments of runs: argument -> bad values -> words of the sentence, at every entrance.

The rows of ``TABLE`` are arguments, the columns ``ENTRANCES``. A value that an entrance takes, or
refuses without these words, fails.
"""

from __future__ import annotations

import re
from decimal import Decimal
from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP, by_names, refused
from command_line import refused as refused_by_command
from stores import record

NO_NUMBERS = [None, "0.1", b"1", 1j, True, [0.1], np.array([0.1]), sp.Symbol("x"), mp.mpc(1),
              np.timedelta64(1)]
NOT_FINITE = [np.nan, np.inf, -np.inf, Decimal("NaN"), mp.inf, Decimal("1e999999")]
TOO_LARGE = [10**400, -10**400, mp.mpf(10) ** 400]
NUMBERS = [*NO_NUMBERS, *NOT_FINITE, *TOO_LARGE]
NO_COUNTS = [-1, 2.5, "3", np.nan, True, [3], 2**64, 10**30]
ZERO = [0, 0.0, -0.0, np.float32(0), Fraction(0)]

#: Neither an array of four numbers nor, in an ensemble, rows of them.
NO_ARRAYS = [None, 1.0, [1, 0, 0], [1, 0, 0, 0, 0], [], [1, [0, 0], 0, 0], b"1000",
             ["1", "0", "0", "0"], [None, 0, 0, 0], [True, False, False, False],
             np.array([1j, 0, 0, 0]), [mp.mpc(1), 0, 0, 0], [sp.Symbol("x"), 0, 0, 0], {"q": 1},
             {1, 2, 3, 4}, np.array(["2026-01-01"] * 4, dtype="datetime64[D]"),
             np.zeros(4, dtype=[("a", float)])]
NO_STATES = [*NO_ARRAYS, [[1, 0, 0, 0]], [[1], [0], [0], [0]], [1, 0, np.nan, 0], [1, 0, np.inf, 0],
             [1, 0, -np.inf, 0], [Decimal("inf"), 0, 0, 0], [10**400, 0, 0, 0]]

#: A call of each entrance with every argument it has; the others are left out.
STATE, RUN = ("q", "p", "dt", "parameters"), ("t0", "steps", "solver", "tolerance",
                                              "max_iterations")
ENTRANCES = {
    "integrate": (lambda step, a: by_names(step.integrate, **a), {*STATE, *RUN, "every", "progress",
                                                        "events"}),
    "integrate_ensemble": (lambda step, a: by_names(step.integrate_ensemble, **a),
                           {*STATE, *RUN, "every", "workers", "events", "progress"}),
    "start": (lambda step, a: by_names(step.start, **{
        k: v for k, v in a.items() if k != "steps"}).advance(a["steps"]), {*STATE, *RUN}),
    "step": (lambda step, a: by_names(step.step, **a), {*STATE, "t0", "solver", "tolerance"}),
    "record": (lambda step, a: record(step, out="run.zarr", **a),
               {*STATE, *RUN, "every", "progress", "events"}),
    "sweep": (lambda step, a: gs.sweep(TOP, {"I3": [1e-3]}, scheme="G-L", stages=2, **a),
              {"dt", "parameters", "steps", "solver", "every", "progress", "workers"}),
    "residual": (lambda step, a: by_names(step.residual, np.zeros(18), **a), {*STATE}),
    "jacobian": (lambda step, a: by_names(step.jacobian, np.zeros(18), **a), {*STATE}),
    "guess": (lambda step, a: by_names(step.guess, **a), {*STATE}),
    "project": (lambda step, a: by_names(step.project, **a), {"q", "p", "parameters"}),
    "defects": (lambda step, a: by_names(step.defects, **a), {"q", "p", "parameters"}),
    "energy": (lambda step, a: by_names(step.energy, **a), {"q", "p", "parameters"}),
}
TABLE = [
    ("dt", NUMBERS, r"^(Trajectory 0: )?dt (=|has|is not)"),
    ("dt", ZERO, "dt = 0 .*negative"),
    ("t0", NUMBERS[1:], r"^(Trajectory 0: )?t (=|has)"),
    ("steps", [*NO_COUNTS, None], "steps"),
    ("every", [*NO_COUNTS[:-2], 0], "every = "),
    ("max_iterations", [*NO_COUNTS[:-2], 0], "max_iterations = "),
    ("tolerance", [0, -1e-9, np.nan, np.inf, "1e-9", True], "tolerance = "),
    ("solver", ["fast", "", None, 3, "Newton"], "solver.*auto, newton"),
    ("workers", [-1, 0, 1.5, "2"], "workers = "),
    ("progress", [3, "bar"], "progress = .*function"),
    ("events", ["q1", 3], r"events = .*gs\.Event"),
    ("parameters", [3, [1, 2], "gamma"], "parameters = "),
    ("parameters", [PARAMETERS | {"alpha": 1}], "'alpha'.*I1"),
    *(("parameters", [PARAMETERS | {name: bad} for bad in NUMBERS], f"(arameter )?{name}")
      for name in ("mgl", "gamma")),
    ("parameters", [PARAMETERS | {"gamma": zero} for zero in ZERO], "gamma.*(than 0|nonzero)"),
    ("parameters", [PARAMETERS | {"I1": bad} for bad in (0, -1e-3, -0.0)], "I1.*(above 0|positi)"),
    ("q", NO_ARRAYS, "^q "),
    ("p", NO_ARRAYS, "^p |^q and p have shapes"),
]


@pytest.fixture
def check(tmp_path, monkeypatch):
    """Return a function that calls an entrance with a bad value and reads the sentence."""
    monkeypatch.chdir(tmp_path)
    step = systems.stepper("heavy_top")

    def refuse(entrance, argument, bad, words):
        call, accepted = ENTRANCES[entrance]
        state = {"q": TOP.q0, "p": TOP.p0}
        if entrance == "integrate_ensemble":
            state = {name: [array, array] for name, array in state.items()}
        call_arguments = {name: value for name, value in (
            state | {"dt": 1e-3, "steps": 3, "parameters": PARAMETERS} | {argument: bad}).items()
            if name in accepted}
        with pytest.raises(gs.InputError) as error:
            call(step, call_arguments)
        assert re.search(words, str(error.value)), (bad, str(error.value))
        assert isinstance(error.value, ValueError)
        assert not list(tmp_path.iterdir())

    return refuse


@pytest.mark.parametrize(("argument", "entrance"), [
    (argument, entrance) for argument in dict.fromkeys(row[0] for row in TABLE)
    for entrance, (_, taken) in ENTRANCES.items() if argument in taken])
def test_bad_values_are_refused_in_a_sentence(argument, entrance, check):
    for name, values, words in TABLE:
        if name == argument:
            for bad in values:
                check(entrance, argument, bad, words)


@pytest.mark.parametrize("argument", ["q", "p"])
def test_states_of_a_single_trajectory(argument, check):
    """Rows and numbers that are not finite are refused, but for the energy of such states."""
    for entrance in ("integrate", "start", "step", "record", "residual", "project", "defects"):
        for bad in NO_STATES[len(NO_ARRAYS):]:
            check(entrance, argument, bad, f"^{argument} ")


@pytest.mark.parametrize("name", [name for name in PARAMETERS if name != "gamma"])
def test_a_missing_parameter_is_named_with_all_others(name, check):
    incomplete = {key: value for key, value in PARAMETERS.items() if key != name}
    for entrance in ("integrate", "integrate_ensemble", "start", "step", "record", "project"):
        check(entrance, "parameters", incomplete, f"'{name}'.*I1, I2, I3, mgl, gamma")


@pytest.mark.parametrize("call", ["start", "step", "integrate", "integrate_ensemble"])
def test_a_start_has_its_momenta(call):
    """A step in place of the momenta is refused with its value."""
    steps_argument = {"steps": 3} if "integrate" in call else {}
    with refused(r"p = 0\.25.*start"):
        getattr(systems.stepper("heavy_top"), call)(TOP, 0.25, dt=1e-3, **steps_argument)


COMMAND = ["run", "fast-top", "--scheme", "G-L", "--stages", "2"]


@pytest.mark.parametrize(("option", "values"), [
    ("--dt", ["0", "-0.0", "nan", "inf", "1e400", "soon", ""]),
    ("--t-end", ["nan", "soon"]),
    ("--steps", ["-1", "2.5", "many", "1e30"]),
    ("--every", ["0", "-1", "2.5", "x"]),
    ("--solver", ["fast", "Newton"]),
    ("--gamma", ["0", "nan", "much"]),
    ("--set", ["I1=0", "I1=-1", "I1=x", "I4=1", "I1", "t=nan", "t=inf", "t=soon", "t"]),
])
def test_the_command_line_refuses_bad_values(option, values, gyrospark, tmp_path):
    """A refusal is one line with exit code 2, nothing on stdout, and no file."""
    default = {"--dt": "1e-3", "--steps": "3"} if option != "--t-end" else {"--dt": "1e-3"}
    for bad in values:
        words = [word for pair in (default | {option: bad}).items() for word in pair]
        answer = gyrospark(*COMMAND, *words, "--out", "x.npz")
        refused_by_command(answer, *({option.strip("-").split("-")[0]} if "=" not in bad else
                                     {bad.split("=")[0]}))
        assert answer.stdout == ""
        assert not list(tmp_path.iterdir())
