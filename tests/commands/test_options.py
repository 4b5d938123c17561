"""Options of the command line are arguments of Python's calls, with their names and defaults."""

from __future__ import annotations

import inspect
from pathlib import Path

import click
import pytest

import gyrospark as gs
from command_line import refused
from gyrospark.commands import gyrospark as command_line
from gyrospark.core.former_names import FORMER_OPTIONS
from gyrospark.runtime.analysis.lyapunov import Lyapunov
from gyrospark.targets.artefact import Built
from processes import ROOT

STEPPER = (gs.stepper, gs.load_model, gs.Start)
#: Command → the calls that it is.
CALLS = {
    "run": (*STEPPER, gs.tune, gs.Stepper.integrate),
    "lyapunov": (*STEPPER, gs.lyapunov),
    "fit": (*STEPPER, gs.fit),
    "sweep": (gs.sweep,),
    "build cpp": (gs.build, gs.load_model),
    "export": (gs.Trajectory.save,),
    "verify": (gs.certify,),
}
#: Options that are methods or functions of their name: their value is an argument, or they are set.
METHODS = {
    "run --plot": gs.Trajectory.plot, "run --show": gs.Trajectory.show, "run --resume": gs.resume,
    "lyapunov --plot": Lyapunov.plot, "build cpp --check": Built.check,
}
#: Arguments of another name: a repeated option is one of many, α is γ of another representation.
OTHERS = {"run --alpha": "gamma", "run --event": "events", "build cpp --parameter": "parameters",
          "verify --model": "model", "verify --system": "model"}
#: The form of the answer; of sweeps what is computed and drawn of it.
ANSWERS = {"--json", "sweep --dry-run", "sweep --plot", "sweep --show", "verify --plot"}


def command(words: str) -> click.Command:
    current: click.Command = command_line
    for word in words.split():
        current = current.get_command(click.Context(current), word)
    return current


def options(words: str) -> list[click.Option]:
    return [parameter for parameter in command(words).params if isinstance(parameter, click.Option)]


def value_of(words: str, option: click.Option) -> object:
    """Return the value of an option that a command line leaves out."""
    context = command(words).make_context(words, ["x"], resilient_parsing=True)
    return context.params.get(option.name)


@pytest.mark.parametrize("words", CALLS)
def test_each_option_is_an_argument(words):
    calls = [inspect.signature(call).parameters for call in CALLS[words]]
    for option in options(words):
        flag = option.opts[0]
        default = value_of(words, option)
        name = OTHERS.get(f"{words} {flag}", flag.removeprefix("--").replace("-", "_"))
        if {flag, f"{words} {flag}"} & ANSWERS:
            continue
        if f"{words} {flag}" in METHODS:
            assert METHODS[f"{words} {flag}"].__name__ == name
            assert default in (None, False, ())
            continue
        defaults = [call[name].default for call in calls if name in call]
        assert defaults, f"{words} {flag} is an argument of no call"
        if default not in (None, ()):  # else the call's own holds
            assert str(default) in map(str, defaults), flag


def test_run_has_few_options():
    assert len(options("run")) <= 25


@pytest.mark.parametrize("former", FORMER_OPTIONS)
def test_former_options_name_the_present_one(former, gyrospark):
    words, flag = former.split()
    assert flag not in {name for option in options(words) for name in option.opts}
    refused(gyrospark(words, "fast-top", *(["x.csv"] if words == "fit" else []), flag, "1"), flag)
    assert not [*Path().iterdir()]


@pytest.mark.parametrize(("text", "word"), [
    ("python", "'python'"), ("newton,tol=1e-9", "tolerance"), ("newton,tolerance", "KEY=VALUE"),
    ("auto,max_iterations=1,max_iterations=2", "once"), ("newton,tolerance=small", "'small'"),
])
def test_a_solver_that_is_none(text, word, gyrospark):
    refused(gyrospark("run", "fast-top", "--dt", "1e-3", "--steps", "1", "--solver", text), word)


@pytest.mark.parametrize("options", [(), ("dt",), ("steps",), ("dt", "t_end")])
def test_a_model_has_its_step_and_their_number(options, gyrospark):
    """The model's dt and steps hold where a call leaves them out, for runs and simulations."""
    path = ROOT / "examples" / "pendulum.toml"
    model, numbers = gs.load_model(path), {"dt": 0.004, "steps": 7, "t_end": 0.02}
    named = {name: numbers[name] for name in options}
    words = [word for name in options
             for word in (f"--{name.replace('_', '-')}", str(numbers[name]))]
    answer = gyrospark("run", path, "--scheme", "G-L", "--stages", "2", "--json",
                       *words).document
    step = gs.stepper("G-L", 2, system=model)
    run = step.integrate(model, **named)
    assert run.report.steps == answer["steps"]
    assert run.q[-1] == pytest.approx(answer["q"], rel=1e-12)
    assert float(run.dt) == (named.get("dt") or model.dt)
    ensemble = step.integrate_ensemble(model, parameters={"m": [1.0, 1.0]}, **named)
    assert ensemble.members[0].q[-1] == pytest.approx(answer["q"], rel=1e-12)
    if "steps" in options:
        sim = step.start(model.start.replace(t=1.0))
        sim.advance(7)
        assert sim.t == 1.0 + 7 * model.dt


def test_a_solver_has_its_arguments(gyrospark):
    run = ["run", "fast-top", "--dt", "1e-3", "--steps", "3", "--json", "--solver"]
    answer = gyrospark(*run, "newton, tolerance=1e-6, max_iterations=9").document
    step = gs.stepper()
    trajectory = step.integrate(gs.problems.fast_top(), dt=1e-3, steps=3,
                                solver=gs.Solver("newton", tolerance=1e-6, max_iterations=9))
    assert answer["q"] == trajectory.q[-1].tolist()
    assert answer["iterations_mean"] == trajectory.report.iterations_mean
