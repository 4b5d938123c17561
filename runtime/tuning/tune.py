"""``gs.tune``: its arguments, the rules of a model, its result."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from numpy.typing import ArrayLike

from ...core.arguments import as_mapping, check_stepper, choose, count_text, few, shown
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.exact_numbers import Number, exact
from ...core.html import card, table
from ...core.interrupts import before_start
from ...core.progress import Progress, log_progress
from ...core.records import dataclass
from ...core.registry import AIMS, MEANS, Aim
from ...core.start import HasStart, Rule
from ..bindings.array_checks import as_positive_count, as_real
from ..bindings.inputs import Inputs
from ..integration.run_arguments import StartNumbers, end_of_run, step_argument, step_count
from ..integration.starts import Span, merged_start
from ..rigid_body.gamma_rules import has_inertia, inertia_of, is_inertia_parameter, mean_inertia
from .frame_start import Direction, Velocities, directions_of, start_rates
from .pilots import Pilot, Pilots
from .search import Search
from .step_search import FEWEST, StepSearch

if TYPE_CHECKING:
    from ..integration.run_arguments import RunArguments
    from ..steppers.stepper import Stepper

__all__ = ["Tuned", "tune", "tuned_run"]

#: Steps of a pilot run, unless the run itself is shorter; fewest.
PILOT_STEPS, _LEAST = 1000, 8
#: Pilot runs of a long search, of which progress is a part.
_MOST_RUNS = 150


@explain_arguments
@dataclass(frozen=True)
class Tuned:
    """Parameters and a time step, and the pilot runs behind them.

    Attributes
    ----------
    parameters : dict of str to float
        γ or α in kg m² and rates in rad/s, those that were asked for: for ``parameters=`` of runs.
    dt : number
        The time step in s: as given, or (t_end − t)/n, a fraction; in scaled time Δτ.
    error : float
        The error of the chosen pilot run, which may be shorter than the run: of the motion the
        largest of a path, root mean square, with ``step_error`` its maximum over the whole run; of
        the energy the root mean square. NaN where nothing was measured.
    gain : float
        The error with γ_m and without a frame over that of the choice: 1 where these stay, NaN
        where nothing was searched.
    reason : str
        Why, in a sentence.
    pilots : tuple of Pilot
        All pilot runs.
    clocked : bool
        Whether the time is scaled, so that dt is Δτ.
    """

    parameters: dict[str, float]
    dt: Number
    error: float
    gain: float
    reason: str
    pilots: tuple[Pilot, ...]
    clocked: bool = False

    def _settings(self) -> list[str]:
        """Return the chosen numbers with their names, as "gamma = 0.5"."""
        return [*(f"{name} = {x:.6g}" for name, x in self.parameters.items()),
                self._shown_step(self.dt)]

    def _shown_step(self, dt: Number) -> str:
        """Return a step with its name, as "dt = 0.01 s"; in scaled time it is Δτ."""
        return f"dtau = {float(dt):.6g}" if self.clocked else f"dt = {float(dt):.6g} s"

    def __repr__(self) -> str:
        return f"<Tuned {few(self._settings())}: {count_text(len(self.pilots), 'pilot run')}>"

    def __str__(self) -> str:
        """Return the reason and a table of the pilot runs."""
        lines = [self.reason, f"{'motion':>10}  {'worst path':>10}  {'energy':>10}  pilot run"]
        for pilot in self.pilots:
            cells = "  ".join(" " * 10 if math.isnan(x) else f"{x:10.3e}"
                              for x in (pilot.motion, pilot.worst, pilot.energy))
            parameters = ", ".join(f"{name} = {x:.8g}" for name, x in pilot.parameters.items())
            numbers = parameters or self._shown_step(pilot.dt)
            lines.append(f"{cells}  {numbers}" + f" ({pilot.label})" * (numbers != pilot.label))
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the chosen numbers, the reason and the pilot runs."""
        cells = [(pilot.label, few(f"{x:.6g}" for x in pilot.parameters.values()),
                  f"{pilot.dt:.6g}", f"{pilot.motion:.3e}", f"{pilot.energy:.3e}")
                 for pilot in self.pilots]
        # "dt / s", or "dtau", which has no unit of its own
        step_title = "dtau" if self.clocked else "dt / s"
        return card(f"Tuned: {few(self._settings())}", table([(self.reason,)]), table(
            cells, ("pilot run", "parameters", step_title, "error of the motion", "of the energy")))


def tune(
    step: Stepper,
    start: HasStart | ArrayLike,
    p: ArrayLike | None = None,
    /,
    *,
    dt: Number | None = None,
    dtau: Number | None = None,
    t_end: Number | None = None,
    steps: int | None = None,
    step_error: Number | None = None,
    gamma: Literal["m", "h", "mt", "ht", "auto"] | None = None,
    frame: Literal["start", "auto"] | None = None,
    aim: Aim = "motion",
    parameters: Mapping[str, Number] | None = None,
    inputs: Inputs | Mapping[str, Any] | ArrayLike | None = None,
    pilot_steps: int = PILOT_STEPS,
    progress: Progress = None,
) -> Tuned:
    """Return γ, the rates of a co-moving frame and the time step for runs from a start.

    Parameters
    ----------
    step : Stepper
    start, p
        As for ``integrate``: a start, or q and p. The result is for this motion.
    dt : float, optional
        The time step that γ and rates are for, in s; or
    step_error : float, optional
        the error for which the time step is searched: the largest of the motion up to ``t_end``,
        attitudes in rad and points in parts of their largest coordinate.
    dtau : float, optional
        In scaled time the largest step that is tried, such as 0.4; with ``step_error``.
    t_end, steps : float, int, optional
        The end of the run, as for ``integrate``. Where it is longer than ``pilot_steps``, γ and
        rates are those of pilot runs of that many steps; with the aim "motion" γ_m stays unless the
        error of the motion grows like t in them.
    gamma : {"auto", "m", "h", "mt", "ht"}, optional
        "auto" searches γ (or α) of every body that ``parameters`` give none for; the others are
        means of its moments (``gyrospark.gamma``).
    frame : {"auto", "start"}, optional
        "auto" searches the rates of a frame; "start" takes the least squares of the start, without
        a run. For a stepper with ``frame="symmetries"``.
    aim : {"motion", "energy"}
        The error that searches minimise. "motion": the largest of a path, of each body's three axes
        and of points, and each path must be more accurate than with γ_m and without a frame.
        "energy": |H_k − H_0 − W_k|; the error of the motion may grow, which the result reports.
    parameters, inputs, progress
        As for ``integrate``.
    pilot_steps : int
        Length of pilot runs. They should see the motion's slowest period.

    Raises
    ------
    InputError
        For a stepper without γ or without a frame, where these are asked for; for an error below
        round-off, and other unusable arguments.
    StepFailed
        If the steps of no pilot run converge.

    Examples
    --------
    >>> import gyrospark as gs
    >>> step, top = gs.stepper("G-L", stages=3), gs.problems.fast_top()
    >>> tuned = gs.tune(step, top, dt=1e-3, gamma="auto")
    >>> run = step.integrate(top, dt=tuned.dt, t_end=10, parameters=tuned.parameters)
    """
    check_stepper(step, "step")
    fixed = as_mapping("parameters", {} if parameters is None else parameters, "{'mgl': 0.4}")
    state = merged_start(step, start, p, fixed)
    rules = _rules_of(step, state.parameters, fixed, gamma, frame, aim)
    pilot_limit = as_positive_count("pilot_steps", pilot_steps, minimum=_LEAST)
    state = replace(state, parameters={**state.parameters, **rules})
    length = Span(dt, dtau, t_end, steps)
    with log_progress(f"tuning {step.name}", _MOST_RUNS, progress) as report:
        if step_error is not None:
            return _tuned_step(step, state, rules, length, step_error, inputs, pilot_limit, report)
        return _tuned_parameters(step, state, rules, length, inputs, pilot_limit, report)


def _tuned_step(
    step: Stepper, state: StartNumbers, rules: Mapping[str, Rule], length: Span, step_error: Any,
    inputs: Any, pilot_limit: int, report: Callable[[int], Any] | None,
) -> Tuned:
    """Return a time step for a run up to t_end, and numbers for the rules; see ``tune``."""
    dt, dtau, t_end, steps = length
    clock = step.manifest.system.clock
    span = _span(step_error, t_end, state.t, dt=dt, steps=steps, inputs=inputs)
    if clock is not None or dtau is not None:
        largest = exact(as_real("dtau", step_argument(step.binding, dt, dtau)))
        assert clock is not None  # or dtau is refused
        assert isinstance(largest, Fraction)
        # raises the error if dtau leads away from t_end
        end_of_run(clock, events=(), t0=state.t, t_end=t_end, dt=largest)
        # how long a run to t_end takes in τ is not known: the search begins with the fewest steps
        span = FEWEST * largest
    run = step._run_arguments(state, dt=span, steps=1, inputs=inputs, scaled=clock is not None)
    return _Rules(step, run, rules, report).tuned_step(
        span, float(step_error), pilot_limit, None if clock is None else t_end)


def _tuned_parameters(
    step: Stepper, state: StartNumbers, rules: Mapping[str, Rule], length: Span, inputs: Any,
    pilot_limit: int, report: Callable[[int], Any] | None,
) -> Tuned:
    """Return numbers for the rules at a fixed time step; see ``tune``."""
    dt, _, t_end, steps = length
    if dt is None or not rules:
        raise InputError("There is nothing to choose: give dt with gamma='auto' or frame='auto', "
                         "or step_error with t_end.")
    # without an end the run is as long as anyone continues it
    unbounded = steps is None and t_end is None
    count = pilot_limit if unbounded else step_count(steps, t_end, state.t, dt)
    run = step._run_arguments(state, dt=dt, steps=count, inputs=inputs)
    return _Rules(step, run, rules, report).choose(
        pilot_limit, longer=unbounded or count > pilot_limit)


def tuned_run(stepper: Stepper, run: RunArguments) -> RunArguments:
    """Return a run with numbers for the parameters that its model leaves to searches.

    A run of 0 steps, as of a simulation, may continue after the pilot runs.
    """
    rules = _searches(run.parameters)
    may_be_longer = run.steps == 0 or run.steps > PILOT_STEPS
    tuned = _Rules(stepper, run, rules).choose(PILOT_STEPS, longer=may_be_longer)
    return replace(run, parameters={**run.parameters, **tuned.parameters})


# ---------------------------------------------------------------- arguments


def _rules_of(
    step: Stepper, parameters: Mapping[str, Any], fixed: Mapping[str, Any], gamma: Any, frame: Any,
    aim: Any,
) -> dict[str, Rule]:
    """Return parameter → the rule of its value: of the model first, then of the arguments.

    ``parameters`` has the numbers and rules of the model, ``fixed`` the numbers of the caller.
    """
    aim = choose("aim", aim, AIMS.values())
    if aim == "energy" and "auto" not in (gamma, frame):
        raise InputError("aim = 'energy' is for gamma='auto' or frame='auto'; give one of them.")
    rules = _searches(parameters)
    if gamma is not None or frame is not None or rules:
        step._refuse_scaled(rules="a choice of γ or of a frame")
    if gamma is not None:
        rule = choose("gamma", gamma, (*MEANS, "auto"))
        rules |= _gammas(step, parameters, fixed, rule, aim)
    if frame is not None:
        rules |= _rates(step, fixed, choose("frame", frame, ("auto", "start")), aim)
    return rules


def _searches(parameters: Mapping[str, Any]) -> dict[str, Rule]:
    """Return the rules other than means: searches and least squares that a model asks for."""
    return {name: x for name, x in parameters.items()
            if isinstance(x, Rule) and x.name not in MEANS}


def _gammas(
    step: Stepper, parameters: Mapping[str, Any], fixed: Mapping[str, Any], rule: str, aim: Aim
) -> dict[str, Rule]:
    """Return the rule of each γ and α with a known inertia, but for those that are fixed."""
    inertias = {name: number_or_rule.inertia for name, number_or_rule in parameters.items()
                if isinstance(number_or_rule, Rule)}
    names = [name for name in step.parameter_domains if is_inertia_parameter(name)
             and name not in fixed and (name in inertias or has_inertia(name, parameters))]
    if not names:
        fixed_inertias = [name for name in fixed if is_inertia_parameter(name)]
        raise InputError(f"gamma = {rule!r} is asked for, and {step.name} has no gamma or alpha to "
                         f"choose, of its parameters {few(step.parameter_domains)}; leave out "
                         f"{few(fixed_inertias) if fixed_inertias else 'gamma'}.")
    return {name: Rule(_rule_of(rule, aim), inertias.get(name)) for name in names}


def _rates(step: Stepper, fixed: Mapping[str, Any], rule: str, aim: Aim) -> dict[str, Rule]:
    """Return the rule of each rate of the frame by name; refuse a rate that is fixed."""
    if not step.symmetries:
        raise InputError(f"{step.name} has no co-moving frame; make the stepper with "
                         "frame='symmetries'.")
    names = [symmetry.name for symmetry in step.symmetries]
    if fixed_rates := [name for name in names if name in fixed]:
        raise InputError(f"{fixed_rates[0]} is given besides frame = {rule!r}, which chooses it; "
                         "give one of them.")
    return dict.fromkeys(names, Rule(_rule_of(rule, aim)))


def _rule_of(rule: str, aim: Aim) -> str:
    """Return ``rule``, or for "auto" the search that minimises the error of this aim."""
    return next(name for name, error in AIMS.items() if error == aim) if rule == "auto" else rule


def _span(step_error: Any, t_end: Any, t: Any, **excluded: Any) -> Fraction:
    """Return t_end − t, over which a step is searched, as a fraction.

    ``excluded`` are the arguments that a search of the step does not take, None if left out.
    """
    if as_real("step_error", step_error) <= 0:
        raise InputError(f"step_error = {shown(step_error)} is not positive; give one such as "
                         "1e-9.")
    for name, argument in excluded.items():
        if argument is not None:
            raise InputError(f"step_error is for a search of the time step, and {name} depends on "
                             "it; leave one of them away.")
    if t_end is None:
        raise InputError("step_error needs t_end, the time of the last state.")
    # exactly: the steps are fractions of the span
    start_time, end_time = (exact(as_real(name, x)) for name, x in (("t", t), ("t_end", t_end)))
    assert isinstance(start_time, Fraction)
    assert isinstance(end_time, Fraction)
    if start_time == end_time:
        raise InputError(f"t_end = {shown(t_end)} is the time of the start: there is no step to "
                         "choose.")
    return end_time - start_time


# ---------------------------------------------------------------- rules


class _StepCount(NamedTuple):
    """A number of steps whose error is small enough, as measured by pilot runs."""

    steps: int
    pilot: Pilot  # the pilot run with this number of steps
    pilots: tuple[Pilot, ...]  # all pilot runs, in their order


class _Rules:
    """Rules for some parameters of a run: means, least squares, searches."""

    def __init__(
        self, stepper: Stepper, run: RunArguments, rules: Mapping[str, Rule],
        report: Callable[[int], Any] | None = None,
    ) -> None:
        """Sort the rules into rates of the frame and γ or α; searches must have one aim."""
        self.stepper, self.run, self.rules, self.report = stepper, run, rules, report
        rates = {symmetry.name for symmetry in stepper.symmetries}
        self.rates = {name: x.name for name, x in rules.items() if name in rates}
        self.gammas = {name: x.name for name, x in rules.items() if name not in rates}
        self.moments = {name: inertia_of(name, rules[name], run.parameters)
                        for name in self.gammas}
        searches = {*self.rates.values(), *self.gammas.values()} & {*AIMS}
        if len(searches) > 1:
            raise InputError(f"The parameters ask for {' and for '.join(sorted(searches))}; all "
                             "bodies have one aim, write one of them.")
        self.aim = AIMS[searches.pop()] if searches else None
        self.reasons: list[str] = []

    def initial_parameters(self) -> dict[str, Any]:
        """Return parameters without a search: γ by its mean or γ_m, rates by least squares or 0."""
        means = {name: mean_inertia(self.moments[name], rule if rule in MEANS else "m")
                 for name, rule in self.gammas.items()}
        parameters = {**self.run.parameters, **means, **dict.fromkeys(self.rates, 0.0)}
        if "start" in self.rates.values():
            parameters |= self._least_squares(parameters)
        return parameters

    def choose(self, pilot_limit: int, *, longer: bool) -> Tuned:
        """Return the values of γ, α and rates that the rules ask for.

        Pilot runs have ``pilot_limit`` steps, or those of the run itself. ``longer`` says that the
        run continues after its pilot runs: their late quarters must have smaller errors, too.
        """
        length = pilot_limit if longer else max(self.run.steps, _LEAST)
        pilot = self.stepper._checked_run(replace(self.run.pilot(length),
                                                  parameters=self.initial_parameters()))
        parameters = {name: float(pilot.parameters[name]) for name in (*self.gammas, *self.rates)}
        moments = {name: self.moments[name] for name, rule in self.gammas.items() if rule in AIMS}
        directions = self._directions(pilot, longer=longer)
        # means of moments and least squares rates need no pilot runs
        if not moments and not directions:
            return Tuned(parameters, self.run.dt, error=math.nan, gain=math.nan,
                         reason="; ".join(self.reasons) or "a mean of the moments", pilots=(),
                         clocked=self.stepper.binding.clocked)
        assert self.aim is not None
        means = {name: float(mean_inertia(inertia)) for name, inertia in moments.items()}
        pilots = Pilots(self.stepper, pilot, directions, means, self.aim, self.report,
                        longer=longer)
        velocities = Velocities(self.stepper, pilot.parameters, pilot.t0)
        with before_start("the parameters"):
            best_run, reason = Search(pilots, velocities, moments).best()
        return Tuned(parameters | pilots.parameters(pilots.trials[best_run]), self.run.dt,
                     error=pilots.largest(best_run), gain=pilots.gain(best_run),
                     reason="; ".join([*self.reasons, reason]), pilots=pilots.pilots(),
                     clocked=self.stepper.binding.clocked)

    def tuned_step(
        self, span: Fraction, bound: float, pilot_limit: int, t_end: Any = None
    ) -> Tuned:
        """Return the largest time step with which a run over ``span`` has an error below ``bound``.

        It is span/n for whole numbers n. Numbers for the rules are searched with this step; a
        larger one may suffice with them, so the step is searched again. In scaled time, which has
        no rules, runs end at ``t_end``, and ``span`` are the steps that the search begins with.
        """
        parameters = self.initial_parameters()
        steps, last_pilot, pilots = self._steps(parameters, span, bound, t_end)
        tuned = Tuned(parameters={}, dt=span / steps, error=last_pilot.motion, gain=math.nan,
                      reason="", pilots=(), clocked=self.stepper.binding.clocked)
        if self.gammas or self.rates:
            # To leading order the best numbers do not depend on dt: the pilot runs see all of it.
            count = min(steps, pilot_limit)
            run = replace(self.run, dt=self.stepper.binding.number(span / count), steps=count)
            rules = _Rules(self.stepper, run, self.rules, self.report)
            tuned = rules.choose(pilot_limit, longer=False)
            pilots += tuned.pilots
            if any(parameters[name] != x for name, x in tuned.parameters.items()):
                steps, last_pilot, further_pilots = self._steps(
                    parameters | tuned.parameters, span, bound)
                pilots += further_pilots
        reason = f"{last_pilot.label}: the error of the motion is {last_pilot.motion:.2g} at most"
        return replace(tuned, dt=span / steps, error=last_pilot.motion, pilots=pilots,
                       reason="; ".join(filter(None, [tuned.reason, reason])))

    def _steps(
        self, parameters: Mapping[str, Any], span: Fraction, bound: float, t_end: Any = None
    ) -> _StepCount:
        """Return the least number of steps over ``span`` seconds with an error up to ``bound``.

        ``parameters`` has numbers in place of rules; ``bound`` is relative to the motion.
        """
        search = StepSearch(self.stepper, span, bound,
                            replace(self.run, parameters=dict(parameters)), self.report, t_end)
        with before_start("dt"):
            return _StepCount(*search.best(), tuple(search.pilots))

    def _directions(self, pilot: RunArguments, *, longer: bool) -> list[Direction]:
        """Return the free rates of the frame, which are searched.

        Where there are none, the list is empty and ``reasons`` says why.
        """
        if not {*self.rates.values()} & {*AIMS}:
            return []
        directions = directions_of(self.stepper, pilot.q, pilot.p, pilot.parameters)
        if not directions:
            self.reasons.append("no frame: there is no symmetry with these parameters")
        elif longer and self.stepper.binding.has_forces:
            self.reasons.append("no frame: forces may change the motion after the pilot runs; take "
                                "frame='start' anew for each block of steps")
            return []
        return directions

    def _least_squares(self, parameters: Mapping[str, Any]) -> dict[str, float]:
        """Return the rates of the frame by least squares of the start, parameter → rad/s.

        Rates of a frame that would turn faster than the motion are 0: see ``start_rates``. The
        reason is added to ``reasons``.
        """
        rates = dict.fromkeys(self.rates, 0.0)
        run = self.run
        checked_run = self.stepper._checked_run(replace(run, parameters=dict(parameters)))
        checked_parameters = checked_run.parameters
        directions = directions_of(self.stepper, run.q, run.p, checked_parameters)
        if not directions:
            self.reasons.append("no frame: there is no symmetry with these parameters")
            return rates
        chosen_rates, left_out = start_rates(Velocities(self.stepper, checked_parameters, run.t0),
                                             directions, run.q, run.p, run.dt)
        # rotations of one group share a rate: each has its component along their momenta
        for rate, direction in zip(chosen_rates.tolist(), directions, strict=True):
            for name, weight in direction.weights.items():
                rates[name] += rate * weight
        names = few(name for i in left_out for name in directions[i].weights)
        self.reasons.append("least squares of the start" + (
            f", without {names}: near its axis a frame would turn faster than the motion"
            if left_out else ""))
        return rates
