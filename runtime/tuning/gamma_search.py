"""Pilot runs with different γ, their errors, and the law of the error in 1/γ.

Every run has two errors. That of the energy is H_k − H_0 − W_k. That of the motion is q_k − q(t_k),
path by path (``motion_distance``), with q(t) extrapolated from the same method at Δt/2 and Δt/4:
(2^r q_(Δt/4) − q_(Δt/2))/(2^r − 1), r the order. Sizes are means over the run, in units of those
of the first run that converges, the base, by rule that of γ_m: the ratio of errors that grow like t
stays what it is however long a run becomes.

What these runs cannot tell is said (``Pilots.inconclusive``): an error that is round-off counts for
nothing; where the base is turned by more than 0.3 rad no law is linear, and rows are left out;
where the error does not grow like t (a motion slower than the pilots, or a chaotic one) nothing
follows for a run that is longer than they.

The linear law of the error in 1/γ, or in γ, and where it is smallest.

To leading order in the step the error of a run is linear in 1/γ of each body b (paper, (34)):

    e_k(γ) = d_k + Σ_b K_kb / γ_b,    k = 1..N

for the energy as for every component of the motion, for both come of one truncation error, and
that is linear in 1/γ. Odd-stage LIIIA-B has the same law in γ (its slope in 1/γ is of higher
order). One run to start from, and one more a body with that body's γ changed alone, give d and K;
the slope of a body does not depend on the γ of another. The mean square of each path's error is
then a quadratic form in 1/γ, and ``least`` finds where all of them together are smallest.

The law is straight to leading order only. Its minimum is therefore measured, and where the error is
not what the law had said the slope is corrected (Broyden; for one body the secant through the last
two runs) and the minimum sought again, as long as that helps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import StepFailed
from ...core.registry import MEANS, Aim
from ..rigid_body.gamma_rules import mean_inertia
from .motion_distance import MotionError, sizes

if TYPE_CHECKING:
    from ..integration.run_arguments import RunArguments
    from ..results.trajectory import Trajectory
    from ..steppers.stepper import Stepper

__all__ = ["REACH", "WORTHWHILE", "GammaSearch", "Pilot", "Pilots", "least"]

Array = NDArray[Any]

#: γ_m is left only where every path's error falls to this part of its own, or further.
WORTHWHILE = 1 / 1.05
#: The motion's error is linear in 1/γ up to about this angle, in rad.
_LINEAR = 0.3
#: Fewer rows than these, two a quarter, tell no growth.
_FEWEST = 8
#: By which factor the growth of the error, over t, may vary from the second quarter to the last.
_STEADY = 1.5


@dataclass(frozen=True)
class Pilot:
    """One short run: why it was made, γ of each body in kg m², and its errors.

    Attributes
    ----------
    label : str
    values : dict
    motion : float
        Root mean square over the paths of their mean errors, each in units of its own with γ_m;
        NaN where all of them are round-off.
    worst : float
        The largest of these ratios.
    energy : float
        Mean |H_k − H_0|, with forces |H_k − H_0 − W_k|, in the units of H.
    expected : float or None
        What the law said before the run: of ``motion`` or ``energy``, whichever was aimed at.

    All are infinite where a step did not converge.
    """

    label: str
    values: dict[str, float]
    motion: float
    worst: float
    energy: float
    expected: float | None = None

    def error(self, aim: Aim) -> float:
        """Return ``motion`` or ``energy``."""
        return self.motion if aim == "motion" else self.energy


@dataclass(frozen=True)
class ErrorScale:
    """How errors are measured: columns of each path, their size in the base, its doubt.

    ``doubt`` is the part of each size that may be the reference's error, or round-off; ``quarters``
    are the sizes in each quarter of the base, if a longer run must follow from them.
    """

    paths: list[list[int]]
    size: Array
    doubt: Array
    quarters: Array | None = None

    def ratios(self, errors: Array) -> Array:
        """Return the size of each path's error in units of the base."""
        return sizes(errors, self.paths) / self.size

    def score(self, errors: Array) -> float:
        """Return the mean ratio if no path's is above 1/1.05, nor 1 in a late quarter, else ∞."""
        ratios = self.ratios(errors)
        worse = np.any(ratios + self.doubt > WORTHWHILE)
        if self.quarters is not None:
            worse |= np.any(quarters_of(errors, self.paths)[1:] > self.quarters[1:])
        return math.inf if worse else mean_of(ratios)

    @property
    def steady(self) -> bool:
        """Whether every path's error grows like t from the second quarter on."""
        if self.quarters is None:
            return True
        growth = self.quarters[1:] / np.array([[1.5], [2.5], [3.5]])
        return bool(np.all(growth.max(axis=0) <= _STEADY * growth.min(axis=0)))


def quarters_of(errors: Array, paths: list[list[int]]) -> Array:
    """Return the mean distance of each path in each quarter of the rows, shape (4, J)."""
    return np.array([sizes(part, paths) for part in np.array_split(errors, 4)])


def mean_of(ratios: Array) -> float:
    """Return the root mean square, NaN of none."""
    return float(np.sqrt((ratios**2).mean())) if len(ratios) else math.nan


class Pilots:
    """Makes short runs and remembers them; γ of all bodies as an array in kg m²."""

    def __init__(
        self, stepper: Stepper, arguments: RunArguments,
        bodies: dict[str, tuple[float, float, float]], aim: Aim, *, longer: bool,
    ) -> None:
        """``longer``: the choice is for a run that goes on where these end."""
        self.stepper, self.arguments, self.steps = stepper, arguments, arguments.steps
        self.bodies, self.aim = bodies, aim
        self.longer = longer
        self.letter = "α" if all(name.endswith("alpha") for name in bodies) else "γ"
        self.done: list[Pilot] = []
        self.errors: list[dict[Aim, Array] | None] = []
        self.inconclusive: str | None = None
        self._measure_rules()

    # ------------------------------------------------------------ runs

    def measure(self, label: str, gammas: Array, expected: float | None = None) -> int:
        """Run with these γ and return the number of the run; what is known is not run again."""
        values = self._named(gammas)
        for number in range(len(self.done)):
            if np.allclose(gammas, self.gammas(number), rtol=1e-12, atol=0):
                return number
        try:
            run: Trajectory | None = self._run(values)
        except StepFailed:
            run = None
        return self._add(label, values, run, expected)

    def _measure_rules(self) -> None:
        """Run the paper's four recommendations; raises if the steps converge with none."""
        runs: dict[str, tuple[dict[str, float], Trajectory | None]] = {}
        failure: StepFailed | None = None
        for rule, label in MEANS.items():
            values = self._named(np.array([mean_inertia(moments, rule)
                                           for moments in self.bodies.values()]))
            if any(values == other for other, _ in runs.values()):
                continue
            try:
                runs[label] = values, self._run(values)
            except StepFailed as error:
                runs[label], failure = (values, None), failure or error
        base = next(((v, run) for v, run in runs.values() if run is not None), None)
        if base is None:
            assert failure is not None
            raise failure
        self.base = next(i for i, (v, _) in enumerate(runs.values()) if v == base[0])
        self._set_error_scales(*base)
        for label, (values, run) in runs.items():
            self._add(label, values, run)
        self.rules = len(self.done)

    def _named(self, gammas: Array) -> dict[str, float]:
        return {name: float(x) for name, x in zip(self.bodies, gammas, strict=True)}

    def _run(self, values: dict[str, float], finer: int = 1) -> Trajectory:
        run = self.arguments.refined(finer)
        return self.stepper.run(self.stepper.checked_run(
            replace(run, parameters={**run.parameters, **values})))

    def _add(
        self, label: str, values: dict[str, float], run: Trajectory | None,
        expected: float | None = None,
    ) -> int:
        errors = None if run is None else self._errors_of(run)
        self.errors.append(errors)
        numbers = (math.inf,) * 3
        if errors is not None:
            ratios = self.error_scales["motion"].ratios(errors["motion"])
            numbers = (mean_of(ratios), float(ratios.max()) if len(ratios) else math.nan,
                       float(sizes(errors["energy"], [[0]])[0]))
        self.done.append(Pilot(label, values, *numbers, expected))
        return len(self.done) - 1

    # ------------------------------------------------------------ errors

    def _errors_of(self, run: Trajectory) -> dict[Aim, Array]:
        energy = np.asarray(run.energy_error()[1:], dtype=float)[:, None]
        return {"motion": self._motion(run.q)[1 : self.rows + 1], "energy": energy}

    def _set_error_scales(self, values: dict[str, float], base: Trajectory) -> None:
        """Make the reference of the motion, and what both errors are held against."""
        order = self.stepper.order
        half, quarter = (self._run(values, finer).q for finer in (2, 4))
        self._motion = MotionError(_extrapolated(half, quarter, order), base.q)
        motion = self._motion(base.q)
        turned = np.abs(motion[:, self._motion.turning]).max(axis=1, initial=0) > _LINEAR
        self.rows = max(int(turned.argmax()) - 1, 1) if turned.any() else self.steps
        epsilon = self.stepper.binding.epsilon
        # States are rounded once, and compensated sums stray by some part of ε √N.
        rounding = epsilon * (2 + math.sqrt(self.steps) / 4) * self._motion.units
        errors = self._errors_of(base)
        # One extrapolation lower: what it lacks, 2^(r+2) times less, is what this one lacks.
        lower = self._motion(_extrapolated(base.q, half, order))[1 : self.rows + 1]
        lacks = sizes(lower, self._motion.paths) / 2 ** (order + 2)
        H = np.abs(np.asarray(base.energies, dtype=float)).max(keepdims=True)
        whole = self.rows == self.steps and not self.longer
        self.error_scales: dict[Aim, ErrorScale] = {
            "motion": _error_scale(errors["motion"], self._motion.paths, rounding, rounding + lacks,
                                 quarters=self.longer and self.rows >= _FEWEST),
            "energy": _error_scale(errors["energy"], [[0]], epsilon * H, 0 * H),
        }
        if self.aim == "motion" and self.rows < _FEWEST and not whole:
            self.inconclusive = (f"pilots of {self.steps} steps say nothing of a run that is longer"
                            if self.rows == self.steps else
                            f"with it the motion is lost within {self.rows + 1} steps")
        elif not self.error_scale.paths:
            self.inconclusive = "the error is round-off"
        elif not self.error_scale.steady:
            self.inconclusive = (
                "the error of the motion does not grow like t, and pilots say nothing of a run "
                "that is longer; give steps that see its slowest period")

    # ------------------------------------------------------------ judging

    @property
    def error_scale(self) -> ErrorScale:
        """What the aimed error is measured by."""
        return self.error_scales[self.aim]

    def aimed(self, number: int) -> Array | None:
        """Return the aimed error of a run, rows over time; None if it failed."""
        errors = self.errors[number]
        return None if errors is None else errors[self.aim]

    def gammas(self, number: int) -> Array:
        """Return the γ of a run."""
        return np.array(list(self.done[number].values.values()))

    def score(self, number: int) -> float:
        """Return the error of a run over the base's; ∞ if any path is not well below it."""
        errors = self.aimed(number)
        if number == self.base:
            return 1.0
        return math.inf if errors is None else self.error_scale.score(errors)

    def best(self) -> int:
        """Return the number of the best run."""
        return min(range(len(self.done)), key=self.score)


def _extrapolated(coarse: Array, fine: Array, order: int) -> Array:
    """Return Richardson's extrapolation of two runs, the second with half the step."""
    extrapolated: Array = fine + (fine - coarse) / (2**order - 1)
    return extrapolated


def _error_scale(
    base: Array, paths: list[list[int]], rounding: Array, doubt: Array, *, quarters: bool = False
) -> ErrorScale:
    """Return the yardstick of a base run; paths whose error is round-off are left out."""
    size = sizes(base, paths)
    at = [i for i in range(len(paths)) if size[i] > rounding[i]]
    kept = [paths[i] for i in at]
    return ErrorScale(kept, size[at], doubt[at] / size[at],
                     quarters_of(base, kept) if quarters else None)


#: A minimum farther than this from the body's moments is an extrapolation no pilot supports.
REACH = 10.0
#: By how much a pilot changes 1/γ: large against round-off, small against the law's curvature.
_CHANGE = 0.2
#: Corrections of the slope; at small steps the first minimum stands.
_ROUNDS = 4
#: What the law must promise, a little more than what is then asked of the measurement.
_PROMISE = 0.98 * WORTHWHILE


class GammaSearch:
    """The law in one variable: u_b = γ_m/γ_b or γ_b/γ_m, near 1 for every body."""

    def __init__(self, pilots: Pilots, law: str) -> None:
        self.pilots, self.law, self.inverse = pilots, law, law.startswith("1/")
        self.scale = np.array([mean_inertia(moments) for moments in pilots.bodies.values()])
        bounds = [(min(moments) / REACH, max(moments) * REACH)
                  for moments in pilots.bodies.values()]
        ends = self.variable(np.array(bounds).T)
        self.low, self.high = ends.min(axis=0), ends.max(axis=0)
        self.runs: list[int] = []
        self.clipped: Array | None = None  # the γ the law asked for beyond the bounds
        self.stayed: int | None = None  # the run that is the law's minimum already
        self.right = False  # whether the last run was as the law had said

    def variable(self, gammas: Array) -> Array:
        """Return u of these γ."""
        return self.scale / gammas if self.inverse else gammas / self.scale

    def gammas(self, u: Array) -> Array:
        """Return γ of this u."""
        return self.scale / u if self.inverse else u * self.scale

    def run(self) -> None:
        """Fit the law, measure its minimum; where it errs correct the slope and seek again."""
        pilots = self.pilots
        at = pilots.best()
        slopes, missed = self._slopes(at), False
        for _ in range(_ROUNDS):
            errors = pilots.aimed(at)
            assert errors is not None
            u = self.variable(pilots.gammas(at))
            wanted = u + least(self._forms(errors, slopes))
            new = np.clip(wanted, self.low, self.high)
            if not self.runs and np.any(new != wanted):
                self.clipped = self.gammas(wanted)
            change = new - u
            if np.abs(change).max() < 1e-6 * np.abs(u).max():
                self.stayed = at
                return
            predicted = errors + slopes @ change
            before, expected = pilots.score(pilots.best()), self._size(predicted)
            number = pilots.measure(f"minimum of the law in {self.law}", self.gammas(new),
                                    expected)
            self.runs.append(number)
            found, score = pilots.aimed(number), pilots.score(number)
            if found is None:
                return
            self.right = abs(pilots.done[number].error(pilots.aim) - expected) <= 0.05 * expected
            worse = score >= before
            if self.right or (missed and worse) or 0.9 * before < score < before:
                return
            missed = worse
            slopes = slopes + (found - predicted)[..., None] * change / (change @ change)
            at = number

    def _size(self, errors: Array) -> float:
        """Return the size of errors as a pilot has it."""
        scale = self.pilots.error_scale
        unit = float(scale.size[0]) if self.pilots.aim == "energy" else 1.0
        return mean_of(scale.ratios(errors)) * unit

    def _forms(self, errors: Array, slopes: Array) -> Array:
        """Return the quadratic form in (1, x) of each path's error, in units of the base."""
        base, forms = self.pilots.aimed(self.pilots.base), []
        assert base is not None
        joined = np.concatenate([errors[..., None], slopes], axis=-1)
        for path in self.pilots.error_scale.paths:
            columns = joined[:, path].reshape(-1, joined.shape[-1])
            forms.append(columns.T @ columns / (base[:, path] ** 2).sum())
        return np.array(forms)

    def _slopes(self, at: int) -> Array:
        """Return K from one more run a body; zeros where these do not converge."""
        pilots, base = self.pilots, self.pilots.aimed(at)
        assert base is not None
        columns = []
        for body, name in enumerate(pilots.bodies):
            column = np.zeros_like(base)
            for factor in (1 + _CHANGE, 1 / (1 + _CHANGE)):
                gammas = pilots.gammas(at)
                gammas[body] /= factor
                errors = pilots.aimed(pilots.measure(f"pilot for {name}", gammas))
                if errors is not None:
                    change = self.variable(gammas)[body] - self.variable(pilots.gammas(at))[body]
                    column = (errors - base) / change
                    break
            columns.append(column)
        return np.stack(columns, axis=-1)


def least(forms: Array) -> Array:
    """Return the x with the smallest Σ_j r_j^p, r_j² = (1, x) F_j (1, x)ᵀ; F is (J, B+1, B+1).

    p is 2, the mean square, if all r_j are then below 1/1.05, else the smallest of 4, 8, ... 64
    for which they are: the sum turns by degrees into the largest r_j, and where even that stays
    above, nothing is to be had. Each sum is convex, and Newton's steps go from one to the next.
    """
    A, b = forms[:, 1:, 1:], forms[:, 1:, 0]

    def squares(x: Array) -> Array:
        r2: Array = np.maximum(forms[:, 0, 0] + 2 * b @ x + (A @ x) @ x, 0.0)
        return r2

    def power_sum(x: Array) -> float:
        r2 = squares(x)
        return float(r2.max() * ((r2 / (r2.max() or 1.0)) ** (p / 2)).sum() ** (2 / p))

    x: Array = -np.linalg.lstsq(A.sum(axis=0), b.sum(axis=0), rcond=None)[0]
    for p in (4, 8, 16, 32, 64):
        if squares(x).max() <= _PROMISE**2:
            break
        for _ in range(20):
            r2, slopes = squares(x), b + A @ x
            weights = (r2 / r2.max()) ** (p / 2 - 1)
            bend = np.tensordot(weights, A, 1) + (slopes.T * (weights * (p - 2) / r2)) @ slopes
            step = -np.linalg.lstsq(bend, weights @ slopes, rcond=None)[0]
            while power_sum(x + step) > power_sum(x) and np.abs(step).max() > 1e-9:
                step = step / 2
            x = x + step
            if np.abs(step).max() <= 1e-6 * np.abs(x).max():
                break
    return x
