"""γ chosen by measurement: short pilot runs, the law of the error, its minimum, and the choice.

What is aimed at is the motion or the energy, and one is not the other: on a symmetric top the γ
that cancels the energy error of 2-stage LIIIA-B triples the error of the axis. By default it is
the motion, and γ_m is left only where every path (each body's three axes in space, every point)
was measured to be nearer to the true one by 5 % or more. Where pilots cannot tell, γ_m stays.

    gamma_search    the runs, their errors, the law in 1/γ and its minimum
    gamma_choice    the call, and which γ is chosen
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_mapping, choose, shown
from ...core.errors import InputError
from ...core.exact_numbers import Number
from ...core.frozen_dict import NO_PARAMETERS
from ...core.interrupts import before_start
from ...core.registry import AIMS, Aim
from ..bindings.array_checks import as_positive_count
from ..rigid_body.gamma_rules import known_inertia, principal_moments
from .gamma_search import REACH, WORTHWHILE, GammaSearch, Pilot, Pilots

if TYPE_CHECKING:
    from ..integration.run_arguments import RunArguments
    from ..steppers.stepper import Stepper

__all__ = ["PILOT_STEPS", "GammaChoice", "choose_gamma", "with_gamma"]

#: Steps of a pilot run, unless the run itself is shorter.
PILOT_STEPS = 1000
_ERRORS: dict[Aim, str] = {"motion": "error of the motion", "energy": "energy error"}


@dataclass(frozen=True)
class GammaChoice:
    """A choice of γ (or α), and the pilot runs behind it.

    Attributes
    ----------
    values : dict
        Name of each inertia parameter → its value in kg m².
    aim : {"motion", "energy"}
        Whose error was made small.
    expected_gain : float
        Error with γ_m (the first of ``pilots``) over the error that the law expects at its
        minimum, of what was aimed at.
    measured_gain : float
        Error with γ_m over the error measured with ``values``: ``gains[aim]``.
    gains : dict
        The measured gain of both: below 1 where the error grew. That of the motion is the mean
        over the paths, none of which grew if the motion was aimed at.
    law : {"1/γ", "γ"}
        The variable in which the law was used (α for α).
    reason : str
        Why these values, in one sentence.
    pilots : tuple of Pilot
        Every run, the first with γ_m.
    """

    values: dict[str, float]
    aim: Aim
    expected_gain: float
    gains: dict[Aim, float]
    law: str
    reason: str
    pilots: tuple[Pilot, ...]

    @property
    def measured_gain(self) -> float:
        """The measured gain of what was aimed at."""
        return self.gains[self.aim]

    @property
    def gamma(self) -> float:
        """The value, if there is one body.

        Raises
        ------
        InputError
            For several bodies: each has its own in ``values``.
        """
        if len(self.values) != 1:
            raise InputError(f"There are {len(self.values)} values, for {', '.join(self.values)}; "
                             "read them from .values.")
        return next(iter(self.values.values()))

    def __repr__(self) -> str:
        values = [f"{name} = {value:.6g}" for name, value in self.values.items()]
        shown = ", ".join([*values[:4], *(["…"] if len(values) > 4 else [])])
        return (f"<GammaChoice {shown}: mean error of the {self.aim} {self.measured_gain:.3g} "
                f"times smaller than with γ_m, {len(self.pilots)} pilots>")

    def __str__(self) -> str:
        """Return the reason and a table of the pilots with both errors, that aimed at first."""
        columns: list[tuple[str, str]] = [("motion", "motion"), ("worst", "worst path"),
                                          ("energy", "energy")]
        if self.aim == "energy":
            columns = [columns[2], *columns[:2]]
        columns.append(("expected", "expected"))
        rows = [self.reason, "  ".join(f"{head:>10}" for _, head in columns) + "  values"]
        for pilot in self.pilots:
            numbers = (getattr(pilot, name) for name, _ in columns)
            cells = "  ".join(" " * 10 if x is None else f"{x:10.3e}" for x in numbers)
            values = ", ".join(f"{name} = {x:.6g}" for name, x in pilot.values.items())
            rows.append(f"{cells}  {values} ({pilot.label})")
        return "\n".join(rows)


def choose_gamma(
    stepper: Stepper,
    q: ArrayLike,
    p: ArrayLike,
    *,
    dt: Number,
    parameters: Mapping[str, Any] = NO_PARAMETERS,
    bodies: Mapping[str, Sequence[float]] | None = None,
    aim: Aim | None = None,
    steps: int = PILOT_STEPS,
    run_steps: int | None = None,
    t0: Number = 0.0,
) -> GammaChoice:
    """Return the γ of each body that makes the error of runs from (q, p) smallest.

    Parameters
    ----------
    stepper : Stepper
        Any compiled stepper whose system has inertia parameters.
    q, p : array_like, shape (n,)
        The start; the choice is for this motion.
    dt : float
        The time step the choice is for, in s.
    parameters : mapping
        The stepper's other parameters; values given for ``bodies`` are not looked at.
    bodies : mapping of str to three floats, optional
        Name of each parameter to choose → I₁, I₂, I₃ of its body in kg m². By default the
        parameters whose value is ``"auto"`` or ``"auto-energy"``, with the moments that stand
        beside them.
    aim : {"motion", "energy"}, optional
        What to make small: the distance of every path from the true one, or |H_k − H_0| (with
        forces |H_k − H_0 − W_k|). By default the motion, or what the parameters say. For the
        motion γ_m is left only if no path of any body gets worse; for the energy the motion is
        not looked at, only reported.
    steps : int
        Length of the pilot runs, at least 2. They should see the motion's slowest period.
    run_steps : int, optional
        Length of the run that the choice is for, if it is no longer than the pilots: then they
        have seen all of it, whereas for a longer one the motion's error must be seen to grow
        like t.
    t0 : float
        Time at the start, for forces that depend on it.

    Raises
    ------
    InputError
        For bodies that the stepper has no parameter for; for α where the error does not depend
        on it.
    StepFailed
        If the steps converge with none of γ_m, γ_h, γ̃_m, γ̃_h.

    Examples
    --------
    >>> import gyrospark as gs
    >>> step, top = gs.stepper("G-L", stages=3), gs.problems.fast_top()
    >>> choice = gs.choose_gamma(step, top.q0, top.p0, dt=1e-3, parameters=top.parameters,
    ...                          bodies={"gamma": top.inertia})
    >>> parameters = top.parameters | choice.values
    """
    if aim is not None:
        aim = choose("aim", aim, AIMS.values())
    if not hasattr(stepper, "parameter_domains"):
        raise InputError(f"stepper = {shown(stepper)} is no stepper; make one with "
                         "gyrospark.stepper.")
    parameters = as_mapping("parameters", parameters, "{'mgl': 0.4}")
    count = as_positive_count("steps", steps, least=2)
    longer = run_steps is None or as_positive_count("run_steps", run_steps) > count
    return _search(stepper, stepper.run_arguments(q, p, dt=dt, steps=count, parameters=parameters,
                                                  t0=t0), bodies, aim, longer=longer)


def with_gamma(stepper: Stepper, run: RunArguments) -> RunArguments:
    """Return a run with every ``"auto"`` among its parameters replaced by its choice."""
    parameters: Any = run.parameters
    if not isinstance(parameters, dict) or {*map(type, parameters.values())} == {float} or (
            not any(map(_is_auto, parameters.values()))):
        return run
    pilot = run.pilot(min(max(run.steps, 2), PILOT_STEPS))
    with before_start("γ"):
        choice = _search(stepper, replace(pilot, inputs=None), None, None,
                         longer=run.steps > pilot.steps)
    return replace(run, parameters={**parameters, **choice.values})


def _search(
    stepper: Stepper, run: RunArguments, bodies: Mapping[str, Sequence[float]] | None,
    aim: Aim | None, *, longer: bool,
) -> GammaChoice:
    """Return the choice by pilots with these arguments, for a run that may be longer."""
    known = _checked_bodies(stepper, run.parameters, bodies)
    others = {name: value for name, value in run.parameters.items() if name not in known}
    pilots = Pilots(stepper, replace(run, parameters=others), known,
                    aim or _aim_of(run.parameters), longer=longer)
    searches = [GammaSearch(pilots, f"1/{pilots.letter}")]
    if pilots.inconclusive is None:
        searches[0].run()
        unsettled = pilots.best() < pilots.rules and not searches[0].right
        if searches[0].clipped is not None or unsettled:
            searches.append(GammaSearch(pilots, pilots.letter))
            searches[1].run()
    choice = _choice_of(pilots, searches)
    if any(name.endswith("alpha") for name in known):
        _refuse_idle_alpha(stepper, pilots)
    return choice


# ---------------------------------------------------------------- the choice


def _choice_of(pilots: Pilots, searches: list[GammaSearch]) -> GammaChoice:
    """Return the best run as the choice; a recommendation nearly as good is preferred."""
    best = pilots.base if pilots.inconclusive else pilots.best()
    least_rule = min(range(pilots.rules), key=pilots.score)
    if not pilots.inconclusive and WORTHWHILE * pilots.score(least_rule) <= pilots.score(best):
        best = least_rule
    used = next((s for s in searches if best in s.runs), searches[0])
    promised = [pilots.done[n].expected for n in used.runs[:1]]
    chosen, base = pilots.done[best], pilots.done[pilots.base]
    expected = next((x for x in promised if x is not None), chosen.error(pilots.aim))
    return GammaChoice(
        values=dict(chosen.values), aim=pilots.aim,
        expected_gain=_ratio(base.error(pilots.aim), expected),
        gains={aim: _ratio(base.error(aim), chosen.error(aim)) for aim in _ERRORS},
        law=used.law, reason=_reason(pilots, best, used), pilots=tuple(pilots.done),
    )


def _ratio(start: float, end: float) -> float:
    if start == end or math.isnan(start):  # NaN: round-off in every path
        return 1.0
    return math.inf if end == 0 else start / end


def _reason(pilots: Pilots, best: int, used: GammaSearch) -> str:
    what, chosen = _ERRORS[pilots.aim], pilots.done[best]
    if pilots.inconclusive is not None:
        return f"{chosen.label}: {pilots.inconclusive}"
    if best < pilots.rules:
        return f"{chosen.label}{_reason_of_rule(pilots, best, used)}"
    name = chosen.label if chosen.expected is not None else \
        f"{chosen.label}, better than the minimum of the law"
    return f"{name} of the {what}{_price(pilots, chosen)}{_limits(used)}"


def _reason_of_rule(pilots: Pilots, best: int, used: GammaSearch) -> str:
    """Return why a recommendation is chosen: what the law's minimum lacks."""
    what = _ERRORS[pilots.aim]
    ratios = [pilots.error_scale.ratios(e) for e in map(pilots.aimed, range(len(pilots.done)))
              if e is not None]
    if np.max(ratios) < 1 / WORTHWHILE * np.min(ratios):
        return f": the {what} hardly depends on it"
    if used.stayed == best:
        return f": it is the minimum of the law of the {what}{_price(pilots, pilots.done[best])}"
    if best != pilots.base:
        return f": no other γ found makes the {what} smaller{_price(pilots, pilots.done[best])}"
    if pilots.aim == "motion":
        return ": no γ found makes every path's error smaller by 5 %"
    return f": no γ found makes the {what} smaller by 5 %"


def _price(pilots: Pilots, chosen: Pilot) -> str:
    """Return by how much the motion's error grows for a smaller energy error, if it does."""
    if pilots.aim == "motion" or not chosen.worst > 1 / WORTHWHILE:
        return ""
    return f"; the error of the motion grows up to {chosen.worst:.3g} times"


def _limits(used: GammaSearch) -> str:
    if used.clipped is None:
        return ""
    asked = ", ".join(f"{x:.3g}" for x in used.clipped)
    return (f"; the law asked for {asked} kg m², more than {REACH:g} times beyond the moments, and "
            "was held there")


def _refuse_idle_alpha(stepper: Stepper, pilots: Pilots) -> None:
    """Refuse to choose α where the measured errors do not depend on it (paper, (39))."""
    errors = [error for pilot in pilots.done
              if math.isfinite(error := pilot.error(pilots.aim))]
    if errors and max(errors) <= min(errors) / WORTHWHILE:
        values = [x for pilot in pilots.done for x in pilot.values.values()]
        raise InputError(
            f"alpha cannot be chosen for {stepper.name}: its error is the same to "
            f"{max(errors) / min(errors) - 1:.1%} for alpha from {min(values):.3g} to "
            f"{max(values):.3g} kg m²; take m, or the gamma-type representation."
        )


# ---------------------------------------------------------------- what is chosen


def _is_auto(value: Any) -> bool:
    return isinstance(value, str) and value in AIMS


def _aim_of(parameters: Mapping[str, Any]) -> Aim:
    """Return the aim that "auto" or "auto-energy" among the parameters names."""
    said = {value for value in parameters.values() if _is_auto(value)}
    if len(said) > 1:
        raise InputError("The parameters ask for auto and for auto-energy; all bodies have one "
                         "aim, write one of them.")
    return AIMS[said.pop()] if said else "motion"


def _checked_bodies(
    stepper: Stepper, parameters: Mapping[str, Any], bodies: Mapping[str, Sequence[float]] | None
) -> dict[str, tuple[float, float, float]]:
    """Return the bodies with their moments as floats."""
    if bodies is None:
        asked = [name for name, value in parameters.items() if _is_auto(value)]
        bodies = {name: known_inertia(name, parameters) for name in asked}
    for name in as_mapping("bodies", bodies, "{'gamma': (I1, I2, I3)}"):
        if name not in stepper.parameter_domains:
            raise InputError(f"{stepper.name} has no parameter {name!r} to choose; it has "
                             f"{', '.join(stepper.parameter_domains)}.")
    if not bodies:
        raise InputError("There is nothing to choose; give bodies={'gamma': (I1, I2, I3)}, or the "
                         "value 'auto' in parameters.")
    return {name: principal_moments(moments) for name, moments in bodies.items()}
