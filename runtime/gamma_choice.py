"""γ chosen by measurement: short pilot runs, the linear law of the error, its zero.

To leading order in the step the error of a run is linear in 1/γ of each body b (paper, (34)):

    e_k(γ) = d_k + Σ_b K_kb / γ_b,    k = 1..N

for the energy (e_k = H_k − H_0) as for the motion (e_k = q_k − q(t_k)). Odd-stage LIIIA-B has the
same law in γ in place of 1/γ (its slope in 1/γ is of higher order). Two values of each γ give d and
K: one run to start from, and one more a body, with that body's γ changed alone. The slope of a
body does not depend on the γ of another, so they need not be varied together. The zero of the law
is the γ with the smallest Σ_k |e_k|, found by least squares with weights 1/|e_k|.

The law is straight to leading order only. The zero is therefore measured, and as long as a
measurement improves on the one before it, the slope is corrected (Broyden; for one body the secant
through the last two runs) and the zero sought again. γ_m, γ_h, γ̃_m and γ̃_h are measured too, and
what is best by measurement is returned: on the pilots' length never worse than any of these.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError, StepFailed
from .checks import as_positive_count, as_step
from .inertia import MEANS_BY_SYMBOL, gamma_m, principal_moments

if TYPE_CHECKING:
    from .stepper import Stepper

__all__ = ["PILOT_STEPS", "GammaChoice", "Pilot", "choose_gamma", "known_inertia", "with_choice"]

Array = NDArray[Any]
Quantity = Literal["energy", "motion"]

#: Steps of a pilot run, unless the run itself is shorter.
PILOT_STEPS = 1000
#: By how much a pilot changes 1/γ: large against round-off, small against the law's curvature.
_CHANGE = 0.2
#: A zero farther than this from the body's moments is an extrapolation no pilot supports.
_REACH = 10.0
#: Corrections of the slope; at small steps the first zero stands.
_ROUNDS = 4
#: A recommended value is left only for an error smaller than this part of its own.
_WORTHWHILE = 1 / 1.05


@dataclass(frozen=True)
class Pilot:
    """One short run: why it was made, γ of each body in kg m², the mean |error|.

    ``error`` is infinite where a step did not converge, ``expected`` what the law said before the
    run, or None.
    """

    label: str
    values: dict[str, float]
    error: float
    expected: float | None = None


@dataclass(frozen=True)
class GammaChoice:
    """A choice of γ (or α) with what it was chosen by.

    Attributes
    ----------
    values : dict
        Name of each inertia parameter → its value in kg m².
    quantity : {"energy", "motion"}
        Whose mean error was made small: |H_k − H_0| in the units of H, or |q_k − q(t_k)|.
    expected_gain : float
        Error with γ_m (that of ``pilots[0]``) over the error that the law expects at its zero.
    measured_gain : float
        Error with γ_m over the error measured with ``values``.
    law : {"1/γ", "γ"}
        The variable in which the law was used (α for α).
    reason : str
        Why these values, in one sentence.
    pilots : tuple of Pilot
        Every run, the first with γ_m.
    """

    values: dict[str, float]
    quantity: Quantity
    expected_gain: float
    measured_gain: float
    law: str
    reason: str
    pilots: tuple[Pilot, ...]

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

    def __str__(self) -> str:
        rows = [self.reason, f"{'error':>10}  {'expected':>10}  values"]
        for pilot in self.pilots:
            expected = "" if pilot.expected is None else f"{pilot.expected:.3e}"
            values = ", ".join(f"{name} = {x:.6g}" for name, x in pilot.values.items())
            rows.append(f"{pilot.error:10.3e}  {expected:>10}  {values} ({pilot.label})")
        return "\n".join(rows)


def choose_gamma(
    stepper: Stepper,
    q: ArrayLike,
    p: ArrayLike,
    *,
    dt: float,
    parameters: Mapping[str, Any],
    bodies: Mapping[str, Sequence[float]] | None = None,
    steps: int = PILOT_STEPS,
    quantity: Quantity | None = None,
    t0: float = 0.0,
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
        parameters whose value is ``"auto"``, with the moments that stand beside them.
    steps : int
        Length of the pilot runs, at least 2. They should see the motion's slowest period.
    quantity : {"energy", "motion"}, optional
        What to make small. By default the energy; the motion for EMS, which keeps the energy by
        itself, and for systems with forces, which change it. The motion is compared with a run at
        Δt/4 (Δt/8 up to order 2).
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
    >>> choice = gyrospark.choose_gamma(step, top.q0, top.p0, dt=1e-3, parameters=top.parameters,
    ...                                 bodies={"gamma": top.inertia})  # doctest: +SKIP
    >>> parameters = top.parameters | choice.values  # doctest: +SKIP
    """
    if quantity not in (None, "energy", "motion"):
        raise InputError(f"quantity = {quantity!r} is unknown; choose energy or motion.")
    known = _checked_bodies(stepper, parameters, bodies)
    pilots = _Pilots(
        stepper, q, p, as_step(dt), as_positive_count("steps", steps, least=2),
        {name: value for name, value in parameters.items() if name not in known},
        known, quantity or _default_quantity(stepper), t0,
    )
    pilots.measure_rules()
    searches = [_Search(pilots, f"1/{pilots.letter}")]
    searches[0].run()
    if searches[0].clipped is not None or pilots.best() < pilots.rules:
        searches.append(_Search(pilots, pilots.letter))
        searches[1].run()
    choice = _judged(pilots, searches)
    if any(name.endswith("alpha") for name in known):
        _refuse_idle_alpha(stepper, pilots)
    return choice


def with_choice(
    stepper: Stepper, q: ArrayLike, p: ArrayLike, *, dt: float, steps: int,
    parameters: Mapping[str, Any], t0: float = 0.0,
) -> Mapping[str, Any]:
    """Return the parameters of a run with every ``"auto"`` replaced by its choice."""
    if not isinstance(parameters, Mapping) or "auto" not in [
            value for value in parameters.values() if isinstance(value, str)]:
        return parameters
    count = min(max(as_positive_count("steps", steps), 2), PILOT_STEPS)
    choice = choose_gamma(stepper, q, p, dt=dt, parameters=parameters, steps=count,
                          t0=t0)
    return {**parameters, **choice.values}


def known_inertia(name: str, parameters: Mapping[str, Any]) -> tuple[float, float, float]:
    """Return the moments beside an inertia parameter: I1.. for gamma, a_I1.. for a_gamma.

    Raises
    ------
    InputError
        If they are not all there.
    """
    prefix = name.removesuffix("gamma").removesuffix("alpha")
    wanted = [f"{prefix}I{axis}" for axis in (1, 2, 3)]
    missing = [moment for moment in wanted if moment not in parameters]
    if missing:
        raise InputError(
            f"{name} cannot be chosen: the moment {missing[0]!r} of its body is no parameter; "
            f"give the moments to choose_gamma(..., bodies={{{name!r}: (I1, I2, I3)}})."
        )
    return principal_moments([parameters[moment] for moment in wanted])


# ---------------------------------------------------------------- the runs


class _Pilots:
    """Makes short runs and remembers them; γ of all bodies as an array in kg m²."""

    def __init__(
        self, stepper: Stepper, q: ArrayLike, p: ArrayLike, dt: float, steps: int,
        parameters: dict[str, Any], bodies: dict[str, tuple[float, float, float]],
        quantity: Quantity, t0: float,
    ) -> None:
        self.stepper, self.q, self.p, self.dt, self.steps = stepper, q, p, dt, steps
        self.parameters, self.bodies, self.quantity, self.t0 = parameters, bodies, quantity, t0
        self.letter = "α" if all(name.endswith("alpha") for name in bodies) else "γ"
        self.done: list[Pilot] = []
        self.errors: list[Array | None] = []
        self.failure: StepFailed | None = None

    def measure(self, label: str, gammas: Array, expected: float | None = None) -> int:
        """Run with these γ and return the number of the run; what is known is not run again."""
        values = {name: float(x) for name, x in zip(self.bodies, gammas, strict=True)}
        for number, pilot in enumerate(self.done):
            if pilot.values == values:
                return number
        try:
            errors: Array | None = self._errors(values)
        except StepFailed as failure:
            errors, self.failure = None, self.failure or failure
        size = math.inf if errors is None else float(np.abs(errors).mean())
        self.done.append(Pilot(label, values, size, expected))
        self.errors.append(errors)
        return len(self.done) - 1

    def measure_rules(self) -> None:
        """Run the paper's four recommendations; raises if the steps converge with none."""
        for label, rule in MEANS_BY_SYMBOL.items():
            self.measure(label, np.array([rule(moments) for moments in self.bodies.values()]))
        self.rules = len(self.done)
        if self.failure is not None and self.best_rule_error == math.inf:
            raise self.failure

    @property
    def best_rule_error(self) -> float:
        """The smallest error of the recommendations."""
        return min(pilot.error for pilot in self.done[: self.rules])

    def gammas(self, number: int) -> Array:
        """Return the γ of a run."""
        return np.array(list(self.done[number].values.values()))

    def best(self) -> int:
        """Return the number of the best run."""
        return min(range(len(self.done)), key=lambda number: self.done[number].error)

    def _errors(self, values: dict[str, float]) -> Array:
        run = self.stepper.integrate(self.q, self.p, dt=self.dt, steps=self.steps, t0=self.t0,
                                     parameters=self.parameters | values)
        if self.quantity == "energy":
            errors = run.energy_error()[1:]
        else:
            errors = (run.q[1:] - self.reference).ravel()
        return np.asarray(errors, dtype=float)

    @cached_property
    def reference(self) -> Array:
        """The motion at the pilots' times, by the same stepper with γ_m and smaller steps."""
        finer = 8 if self.stepper.order <= 2 else 4
        values = {name: gamma_m(moments) for name, moments in self.bodies.items()}
        run = self.stepper.integrate(self.q, self.p, dt=self.dt / finer, steps=self.steps * finer,
                                     every=finer, t0=self.t0, parameters=self.parameters | values)
        return np.asarray(run.q[1:])


# ---------------------------------------------------------------- the law and its zero


class _Search:
    """The law in one variable: u_b = γ_m/γ_b or γ_b/γ_m, near 1 for every body."""

    def __init__(self, pilots: _Pilots, law: str) -> None:
        self.pilots, self.law, self.inverse = pilots, law, law.startswith("1/")
        self.scale = np.array([gamma_m(moments) for moments in pilots.bodies.values()])
        bounds = [(min(moments) / _REACH, max(moments) * _REACH)
                  for moments in pilots.bodies.values()]
        ends = np.array([[self._one(x, scale) for x in pair]
                         for pair, scale in zip(bounds, self.scale, strict=True)])
        self.low, self.high = ends.min(axis=1), ends.max(axis=1)
        self.runs: list[int] = []
        self.clipped: Array | None = None  # the γ the law asked for beyond the bounds
        self.stayed: int | None = None  # the run that the law has its zero at already

    def _one(self, gamma: float, scale: float) -> float:
        return scale / gamma if self.inverse else gamma / scale

    def variable(self, gammas: Array) -> Array:
        """Return u of these γ."""
        return self.scale / gammas if self.inverse else gammas / self.scale

    def gammas(self, u: Array) -> Array:
        """Return γ of this u."""
        return self.scale / u if self.inverse else u * self.scale

    def run(self) -> None:
        """Fit the law, measure its zero, correct the slope and go on while it helps."""
        pilots = self.pilots
        at = pilots.best()
        slopes = self._slopes(at)
        for _ in range(_ROUNDS):
            errors = pilots.errors[at]
            assert errors is not None
            u = self.variable(pilots.gammas(at))
            wanted = u + smallest_sum(slopes, errors)
            new = np.clip(wanted, self.low, self.high)
            if not self.runs and np.any(new != wanted):
                self.clipped = self.gammas(wanted)
            if np.abs(new - u).max() < 1e-6 * np.abs(u).max():
                self.stayed = at
                return
            predicted = errors + slopes @ (new - u)
            number = pilots.measure(f"zero of the law in {self.law}", self.gammas(new),
                                    float(np.abs(predicted).mean()))
            self.runs.append(number)
            found = pilots.errors[number]
            if found is None or pilots.done[number].error > 0.9 * pilots.done[at].error:
                return
            change = new - u
            slopes = slopes + np.outer(found - predicted, change) / (change @ change)
            at = number

    def _slopes(self, at: int) -> Array:
        """Return K from one more run a body; a column of zeros where these do not converge."""
        pilots, base = self.pilots, self.pilots.errors[at]
        assert base is not None
        columns = []
        for body, name in enumerate(pilots.bodies):
            column = np.zeros_like(base)
            for factor in (1 + _CHANGE, 1 / (1 + _CHANGE)):
                gammas = pilots.gammas(at)
                gammas[body] /= factor
                number = pilots.measure(f"pilot for {name}", gammas)
                errors = pilots.errors[number]
                if errors is not None:
                    change = self.variable(gammas)[body] - self.variable(pilots.gammas(at))[body]
                    column = (errors - base) / change
                    break
            columns.append(column)
        return np.array(columns).T


def smallest_sum(slopes: Array, errors: Array) -> Array:
    """Return the x with the smallest Σ_k |errors_k + (slopes x)_k|.

    Least squares with weights 1/|e_k| of the solution before (Lawson); the weights stay bounded.
    The sum comes within a hundredth of the least one: it is measured afterwards anyway.
    """
    x: Array = np.linalg.lstsq(slopes, -errors, rcond=None)[0]
    for _ in range(100):
        left = np.abs(errors + slopes @ x)
        weights = 1 / np.sqrt(np.maximum(left, 1e-6 * left.max() or 1.0))
        before, x = x, np.linalg.lstsq(slopes * weights[:, None], -errors * weights, rcond=None)[0]
        if np.abs(x - before).max() <= 1e-6 * np.abs(x).max():
            break
    return x


# ---------------------------------------------------------------- the verdict


def _judged(pilots: _Pilots, searches: list[_Search]) -> GammaChoice:
    """Return the best run as the choice; a zero must beat the recommendations to be taken."""
    rules = pilots.done[: pilots.rules]
    best = pilots.best()
    if pilots.done[best].error > _WORTHWHILE * pilots.best_rule_error:
        best = next(number for number, pilot in enumerate(rules)
                    if _WORTHWHILE * pilot.error <= pilots.best_rule_error)
    used = next((s for s in searches if best in s.runs), searches[0])
    promised = [pilots.done[n].expected for n in used.runs[:1]]
    expected = next((x for x in promised if x is not None), pilots.done[best].error)
    start = rules[0].error if math.isfinite(rules[0].error) else pilots.best_rule_error
    return GammaChoice(
        dict(pilots.done[best].values), pilots.quantity, _ratio(start, expected),
        _ratio(start, pilots.done[best].error), used.law,
        _reason(pilots, best, used), tuple(pilots.done),
    )


def _ratio(start: float, end: float) -> float:
    if end == 0:
        return 1.0 if start == 0 else math.inf
    return start / end


def _reason(pilots: _Pilots, best: int, used: _Search) -> str:
    what = {"energy": "energy error", "motion": "error of the motion"}[pilots.quantity]
    chosen = pilots.done[best]
    limits = ""
    if used.clipped is not None:
        asked = ", ".join(f"{x:.3g}" for x in used.clipped)
        limits = (f"; the law asked for {asked} kg m², more than {_REACH:g} times beyond the "
                  "moments, and was held there")
    if best >= pilots.rules and chosen.expected is None:
        return f"{chosen.label}, better than the zero of the law of the {what}{limits}"
    if best >= pilots.rules:
        return f"{chosen.label} of the {what}{limits}"
    errors = [p.error for p in pilots.done if math.isfinite(p.error)]
    if max(errors) < 1.05 * min(errors):
        return f"{chosen.label}: the {what} hardly depends on it{limits}"
    if used.stayed == best:
        return f"{chosen.label}: it is the zero of the law of the {what}"
    return f"{chosen.label}: the zero of the law does not make the {what} smaller{limits}"


def _refuse_idle_alpha(stepper: Stepper, pilots: _Pilots) -> None:
    """Refuse to choose α where the measured errors do not depend on it (paper, (39))."""
    errors = [pilot.error for pilot in pilots.done if math.isfinite(pilot.error)]
    if max(errors) <= 1.05 * min(errors):
        values = [x for pilot in pilots.done for x in pilot.values.values()]
        raise InputError(
            f"alpha cannot be chosen for {stepper.name}: its error is the same to "
            f"{max(errors) / min(errors) - 1:.1%} for alpha from {min(values):.3g} to "
            f"{max(values):.3g} kg m²; take m, or the gamma-type representation."
        )


# ---------------------------------------------------------------- what is chosen


def _default_quantity(stepper: Stepper) -> Quantity:
    keeps_energy = stepper.manifest["scheme"]["method"] == "EMS"
    return "motion" if keeps_energy or stepper.manifest["system"].get("forces") else "energy"


def _checked_bodies(
    stepper: Stepper, parameters: Mapping[str, Any], bodies: Mapping[str, Sequence[float]] | None
) -> dict[str, tuple[float, float, float]]:
    """Return the bodies with their moments as floats."""
    if bodies is None:
        asked = [name for name, value in parameters.items()
                 if isinstance(value, str) and value == "auto"]
        bodies = {name: known_inertia(name, parameters) for name in asked}
    for name in bodies:
        if name not in stepper.parameter_domains:
            raise InputError(f"{stepper.name} has no parameter {name!r} to choose; it has "
                             f"{', '.join(stepper.parameter_domains)}.")
    if not bodies:
        raise InputError("There is nothing to choose; give bodies={'gamma': (I1, I2, I3)}, or the "
                         "value 'auto' in parameters.")
    return {name: principal_moments(moments) for name, moments in bodies.items()}
