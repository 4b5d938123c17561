"""The stepper and the start of a problem, a named model or a model file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ...core.arguments import proposal
from ...core.errors import InputError
from ...core.registry import Entry, entry_named
from ...generator.spec import is_model_file
from ...runtime.steppers.run_defaults import RunDefaults
from ..options import real_number, spec_from

if TYPE_CHECKING:
    from ...core.start import Start
    from ...runtime.rigid_body.problems import Problem
    from ...runtime.steppers.stepper import Stepper

__all__ = ["arguments_of", "refuse_repeated_keys", "settings_of", "start_of", "stepper_and_start"]


class StepperAndStart(NamedTuple):
    """A stepper, and the numbers with which its runs start."""

    paper_problem: Problem | None  # None for a named model or a model file
    stepper: Stepper
    defaults: RunDefaults
    t0: float  # s


def stepper_and_start(
    problem: str, settings: tuple[str, ...], choice: dict[str, Any], *, scaled: bool = False
) -> StepperAndStart:
    """Return the stepper and the start of a problem, a named model or a model file.

    ``settings`` are the NAME=VALUE of --set, ``choice`` the options of ``spec_from``. Raises
    InputError for settings that the problem does not have, and for systems in scaled time unless
    they are allowed by ``scaled``.
    """
    from ...api import model_stepper, stepper_of

    refuse_repeated_keys(settings)
    settings, t0 = _without_time(settings)
    entry = None if is_model_file(problem) else entry_named(problem)
    options = {} if entry is None else arguments_of(entry, settings)
    if entry is not None and entry.kind == "problem":
        # a problem of the paper has one body, and its exact motion where that is known
        paper_problem = entry.make(**options)
        return StepperAndStart(
            paper_problem, stepper_of(spec_from(**choice, system=paper_problem.system)),
            RunDefaults.of_problem(paper_problem), t0)
    spec = spec_from(**choice, system=problem if entry is None else entry.name)
    step, defaults = (model_stepper(spec, settings=settings_of(settings)) if entry is None else
                      model_stepper(spec, options=options))
    if not scaled:
        step._refuse_scaled(command="this command")
    return StepperAndStart(paper_problem=None, stepper=step, defaults=defaults, t0=t0)


def refuse_repeated_keys(settings: tuple[str, ...]) -> None:
    """Refuse settings with a key that another one has."""
    keys = [_key(text) for text in settings]
    for key in keys:
        if keys.count(key) > 1:
            raise InputError(f"--set {key}=… is given {keys.count(key)} times; give it once.")


def _key(setting: str) -> str:
    """Return the key of a setting KEY=VALUE."""
    return setting.partition("=")[0].strip()


def _without_time(settings: tuple[str, ...]) -> tuple[tuple[str, ...], float]:
    """Return the settings other than t=..., and the time of the start t0, by default 0."""
    times = [text for text in settings if _key(text) == "t"]
    if not times:
        return settings, 0.0
    # one at most, for ``refuse_repeated_keys`` is called before
    time_text = times[-1].partition("=")[2].strip()
    t0 = real_number("--set t", time_text)
    if isinstance(t0, float) and not math.isfinite(t0):
        raise InputError(f"--set t={time_text} is not finite; write for example t=0.5.")
    return tuple(text for text in settings if text not in times), t0


def arguments_of(entry: Entry, settings: tuple[str, ...]) -> dict[str, Any]:
    """Return the settings as arguments of the function that makes a problem or a model.

    A setting is KEY=NUMBER or KEY=NUMBER,NUMBER,...; InputError for a key that the entry does not
    have.
    """
    allowed = entry.options if settings else []
    arguments: dict[str, Any] = {}
    for setting in settings:
        key, sign, numbers_text = setting.partition("=")
        if not sign or key not in allowed:
            raise InputError(
                f"--set {setting!r} does not fit {entry.name}; write KEY=VALUE with KEY among "
                f"{', '.join(allowed) or 'none: it takes no settings'}{proposal(key, allowed)}. "
                "(Masses, lengths and the like are keys of a model file, "
                f"{_file_like(entry.name)}; in Python they are parameters of a run.)"
            )
        # several numbers, as of an inertia, are a tuple
        numbers = [real_number(f"--set {key}", number) for number in numbers_text.split(",")]
        arguments[key] = numbers[0] if len(numbers) == 1 else tuple(numbers)
    return arguments


def _file_like(name: str) -> str:
    """Return the path of an example file of that name, or of another example."""
    example = f"examples/{name}.toml"
    is_in_checkout = Path(__file__).parents[2].joinpath(example).is_file()
    return example if is_in_checkout else "such as examples/pendulum.toml"


def settings_of(settings: tuple[str, ...]) -> dict[str, str]:
    """Return the settings of a model file, KEY=VALUE each, as key → text.

    Raises InputError for a setting without a value.
    """
    changes = {}
    for setting in settings:
        key, sign, setting_text = setting.partition("=")
        if not sign:
            raise InputError(f"--set {setting!r} has no value; write KEY=VALUE, such as k=3.")
        changes[key.strip()] = setting_text.strip()
    return changes


def start_of(step: Stepper, defaults: RunDefaults, t0: float) -> Start:
    """Return the start with those parameters that the stepper has."""
    values = {name: x for name, x in defaults.parameters.items() if name in step.parameter_domains}
    return defaults.start.replace(parameters=values, t=t0)
