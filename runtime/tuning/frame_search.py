"""Short runs in different co-moving frames, and their errors.

The error is that of the motion, q_k − q(t_k), attitudes as angles and points in units of their
reach (``motion_distance``), with q(t) extrapolated from the same method at Δt/4 and Δt/8: without a
frame, or in the frame of the start, if that agrees with it as far as it can tell and is more exact.
The search for rates uses the first half of the runs, the choice all of them.

Rates of a frame from the lines in the spectrum of one motion, without further runs.

In the joint eigenvectors of the A_i a frame shifts frequencies and changes nothing else,
c_j(ν) → c_j(ν − α_j·ω). So what a method of some order sees of the motion,

    M_k(ω) = Σ_j Σ_ν |c_j(ν)|² (ν − α_j·ω)^2k,

is a convex polynomial of ω, and Newton's steps find where it is least.

What is tried of the rates of a co-moving frame, and of γ, and what is chosen.

Tried are no frame, the least squares of the start and of the whole motion, what the lines of its
spectrum ask for, and parts of these; from the best of them Levenberg and Marquardt's steps go on,
for the errors are polynomials of ω and of 1/γ. All of that on the first half of the pilots. What is
then best on all of them is chosen, if it is better than no frame by 5 % and by more than the
reference may be wrong; what was searched for must beat the least squares of the start, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError, StepFailed
from ..rigid_body.gamma_rules import mean_inertia
from .frame_start import Direction, Velocities, least_squares, start_rates
from .motion_distance import MotionError

if TYPE_CHECKING:
    from ..integration.run_arguments import RunArguments
    from ..results.trajectory import Trajectory
    from ..steppers.stepper import Stepper

__all__ = ["AGREES", "CLEAR", "SMALL", "FrameChoice", "FramePilot", "FramePilots", "FrameSearch",
           "SpectralLines"]

Array = NDArray[Any]

#: Rows of a run that errors are taken of, at most.
_ROWS = 250
#: How far two references may be apart, in parts of what the worse one changed by when refined.
AGREES = 4.0
#: How far apart at least, in parts of the measured error, where that is larger.
SMALL = 0.01
#: By how much a frame must be better than none.
CLEAR = 1.05


@dataclass(frozen=True)
class _Reference:
    """A motion by extrapolation; ``change``: from the one before, ``doubt``: its own error."""

    motion: Array
    error: MotionError
    scale: Array
    change: float
    doubt: float
    finest: Trajectory


@dataclass(frozen=True)
class FramePilot:
    """One short run: why it was made, its rates and γ, and its errors.

    Attributes
    ----------
    label : str
    values : dict
        Rates in rad/s, and γ in kg m² where it is chosen too.
    half, whole : float
        Root mean square error of the motion over the first half and over all of the run, in rad
        or in parts of a point's reach; infinite where a step did not converge.
    """

    label: str
    values: dict[str, float]
    half: float
    whole: float


class FramePilots:
    """Makes short runs and remembers them; a choice is an array: rates, then γ_m/γ of each body."""

    def __init__(
        self, stepper: Stepper, arguments: RunArguments, directions: list[Direction],
        bodies: Mapping[str, Any],
    ) -> None:
        self.stepper, self.arguments, self.steps = stepper, arguments, arguments.steps
        self.directions, self._bodies = directions, bodies
        self.means = {name: float(mean_inertia(inertia)) for name, inertia in bodies.items()}
        self.done: list[FramePilot] = []
        self._known: dict[bytes, tuple[int, Array | None]] = {}
        self._halves: list[float] = []

    @property
    def rates(self) -> int:
        """How many rates there are."""
        return len(self.directions)

    def values(self, x: Array) -> dict[str, float]:
        """Return the parameters of a choice."""
        found: dict[str, float] = {symmetry.name: 0.0 for symmetry in self.stepper.symmetries}
        for rate, direction in zip(x, self.directions, strict=False):
            for name, weight in direction.weights.items():
                found[name] += float(rate) * weight
        inverse = x[self.rates :]
        return found | {name: mean / float(u)
                        for (name, mean), u in zip(self.means.items(), inverse, strict=True)}

    def run(self, x: Array, finer: int = 1) -> Trajectory | None:
        """Return a run, with steps so many times finer; None where one did not converge."""
        try:
            return self.stepper.run(self.stepper.checked_run(replace(
                self.arguments.refined(finer), every=finer * self.every,
                parameters=self.arguments.parameters | self.values(x))))
        except StepFailed:
            return None

    def coarser(self) -> FramePilots:
        """Return runs over the same time by steps twice as long."""
        run = self.arguments
        inputs = run.inputs and replace(run.inputs, values=run.inputs.values[:, ::2].copy())
        return FramePilots(self.stepper, replace(run, dt=2 * run.dt, steps=-(-run.steps // 2),
                                                 inputs=inputs), self.directions, self._bodies)

    @property
    def every(self) -> int:
        """Steps between two rows that errors are taken of."""
        return max(1, self.steps // _ROWS)

    def set_reference(self, none: Array, start: Array) -> Trajectory | None:
        """Extrapolate the motion, without a frame and in the start's frame; None if both fail.

        The frame's is taken where it is more exact, and no further from the other than that may be
        wrong: near an axis every run in one frame may err alike. Returns the finest run.
        """
        plain = self._reference(none)
        found, doubt = plain, math.inf if plain is None else plain.doubt
        moved = None if np.array_equal(start, none) else self._reference(start)
        if moved is not None and moved.doubt < doubt and (
                plain is None or self._agrees(plain, moved, self.run(none))):
            found = moved
        if found is None:
            return None
        epsilon = self.stepper.binding.epsilon
        self._motion, self._scale = found.error, found.scale
        self.doubt = found.doubt + epsilon * (2 + math.sqrt(self.steps) / 4)
        return found.finest

    def _agrees(self, plain: _Reference, moved: _Reference, run: Trajectory | None) -> bool:
        """Whether two references agree to within their own errors, or a part of a run's error."""
        apart, error = (0.0 if q is None else _size(plain.error(np.asarray(q))[1:] / plain.scale)
                        for q in (moved.motion, None if run is None else run.q))
        return apart <= max(AGREES * plain.change, SMALL * error)

    def _reference(self, x: Array) -> _Reference | None:
        """Return the motion in a frame, extrapolated; None where a run did not converge."""
        runs = [self.run(x, finer) for finer in (2, 4, 8)]
        second, fourth, eighth = (None if run is None else np.asarray(run.q) for run in runs)
        if second is None or fourth is None or eighth is None or runs[-1] is None:
            return None
        factor = 2**self.stepper.order - 1
        motion = eighth + (eighth - fourth) / factor
        coarser = fourth + (fourth - second) / factor
        error = MotionError(motion, np.asarray(eighth, dtype=float))
        units = _units(error)
        change = _size(error(coarser)[1:] / units)
        return _Reference(motion, error, units, change, change / 2 ** (self.stepper.order + 2),
                          runs[-1])

    def measure(self, label: str, x: Array) -> int:
        """Run and return the number of the run; what is known is not run again."""
        key = np.asarray(x, dtype=float).tobytes()
        if key not in self._known:
            run = self.run(x)
            errors = None
            if run is not None:
                errors = self._motion(np.asarray(run.q))[1:] / self._scale
            half, whole = (math.inf, math.inf) if errors is None else (
                _size(errors[: (len(errors) + 1) // 2]), _size(errors))
            self._known[key] = len(self.done), errors
            self._halves.append(math.inf if errors is None else _size(errors[len(errors) // 2 :]))
            self.done.append(FramePilot(label, self.values(x), half, whole))
        return self._known[key][0]

    def is_clear(self, number: int, plain: int = 0) -> bool:
        """Whether a run's error is below another's by more than can be wrong with either.

        By 5 % and the doubt of both, over all of the run and over its second half.
        """
        pairs = ((self.done[number].whole, self.done[plain].whole),
                 (self._halves[number], self._halves[plain]))
        return all(CLEAR * (moved + self.doubt) <= still - self.doubt for moved, still in pairs)

    def errors(self, x: Array) -> Array | None:
        """Return the errors of the first half as one array, of a choice that was measured."""
        errors = self._known[np.asarray(x, dtype=float).tobytes()][1]
        return None if errors is None else errors[: (len(errors) + 1) // 2].ravel()


def _units(error: MotionError) -> Array:
    """Return the unit of each column of an error: 1 rad, or the reach of a point."""
    units = np.ones(max(max(path) for path in error.paths) + 1)
    for path, unit in zip(error.paths, error.units, strict=True):
        units[path] = unit or 1.0
    return units


def _size(errors: Array) -> float:
    """Return the root mean square over time of the distance."""
    size = float(np.sqrt((errors**2).sum(axis=1).mean())) if len(errors) else 0.0
    return size if math.isfinite(size) else math.inf


#: Of the window: what leaks from a line is below round-off.
_KAISER = 38.0
#: Lines below this part of the strongest are left out: round-off, and what the window leaks.
_FAINT = 1e-13
#: The part of the power in the last eighth of the band above which lines may be folded into it.
_FOLDED = 1e-10


class SpectralLines:
    """The lines of q and p of a motion, sampled evenly.

    Parameters
    ----------
    q, p : ndarray, shape (rows, n)
    dt : float
        Between two rows.
    generators : list of ndarray
        The A_i, which commute.
    """

    def __init__(self, q: Array, p: Array, dt: float, generators: list[Array]) -> None:
        mixed = sum((A / np.sqrt(i + 2) for i, A in enumerate(generators)),
                    np.zeros_like(generators[0]))
        _, vectors = np.linalg.eig(mixed)
        back = np.linalg.inv(vectors)
        shifts = np.array([np.einsum("ji,ik,kj->j", back, A, vectors).imag for A in generators]).T
        frequencies = 2 * np.pi * np.fft.fftfreq(len(q), dt)
        window = np.kaiser(len(q), _KAISER)[:, None]
        turning = np.abs(shifts).max(axis=1) > 1e-9
        power, nu, alpha = [], [], []
        for x in (q, p) if all(np.array_equal(A, -A.T) for A in generators) else (q,):
            modes = (x @ back.T)[:, turning]
            found = np.abs(np.fft.fft(window * modes, axis=0)) ** 2
            found /= found.sum() or 1.0
            power.append(found.ravel())
            nu.append(np.broadcast_to(frequencies[:, None], found.shape).ravel())
            alpha.append(np.broadcast_to(shifts[turning], (*found.shape, shifts.shape[1])).reshape(
                -1, shifts.shape[1]))
        self._power, self._nu, self._alpha = (np.concatenate(x) for x in (power, nu, alpha))
        self._band = float(np.abs(frequencies).max())
        outer = np.abs(self._nu) > 0.875 * self._band
        self.resolved = bool(self._power[outer].sum() <= _FOLDED * self._power.sum())
        kept = self._power > _FAINT * self._power.max(initial=0)
        self._power, self._nu, self._alpha = (x[kept] for x in (self._power, self._nu,
                                                                self._alpha))

    def least(self, k: int, start: Array) -> Array:
        """Return the ω of least M_k, from a start."""
        omega = np.array(start, dtype=float)
        for _ in range(60):
            rest = (self._nu - self._alpha @ omega) / self._band
            slope = self._alpha.T @ (self._power * rest ** (2 * k - 1))
            weighted = self._alpha * (self._power * rest ** (2 * k - 2))[:, None]
            bend = (2 * k - 1) * self._alpha.T @ weighted / self._band
            step = np.linalg.lstsq(bend, slope, rcond=1e-12)[0]
            omega = omega + step
            if np.abs(step).max() <= 1e-9 * max(np.abs(omega).max(), 1e-9 * self._band):
                break
        return omega


#: By how much what was searched for must beat least squares: it may be right for the pilots alone.
_CLEARLY = 1.5
#: Searches, from the best of what was tried; steps of each.
_SEARCHES, _STEPS = 3, 8
#: Runs of fewer steps see too little.
_FEW = 32
#: Of what is chosen by steps twice as long.
_COARSER = "chosen at twice the step"
#: Label of runs for derivatives, which are not reported.
_SLOPE = "slope"
#: Searches start from choices that differ by this part at least.
_APART = 0.04


@dataclass(frozen=True)
class FrameChoice:
    """A choice of rates, and of γ where it was asked for, and the pilot runs behind it.

    Attributes
    ----------
    frame : dict
        Name of each rate → its value in rad/s.
    gammas : dict
        Name of each inertia parameter that was chosen too → its value in kg m².
    expected_gain : float
        Error without a frame and with γ_m over the error of the choice, on the first half of the
        pilots, where it was looked for.
    measured_gain : float
        The same on all of them: at least 1, and infinite where the steps converge in a frame only.
    reason : str
        Why this choice, in one sentence.
    pilots : tuple of FramePilot
        What was tried, the first without a frame.
    """

    frame: dict[str, float]
    gammas: dict[str, float]
    expected_gain: float
    measured_gain: float
    reason: str
    pilots: tuple[FramePilot, ...]

    @property
    def values(self) -> dict[str, float]:
        """All that was chosen, for ``parameters | choice.values``."""
        return self.frame | self.gammas

    @property
    def gamma(self) -> float | None:
        """γ where one was chosen, of one body; None where none was.

        Raises
        ------
        InputError
            For several bodies: each has its own in ``gammas``.
        """
        if len(self.gammas) > 1:
            raise InputError(f"There are {len(self.gammas)} values, for "
                             f"{', '.join(self.gammas)}; read them from .gammas.")
        return next(iter(self.gammas.values()), None)

    def __repr__(self) -> str:
        values = [f"{name} = {value:.6g}" for name, value in self.values.items()]
        shown_values = ", ".join([*values[:4], *(["…"] if len(values) > 4 else [])])
        return (f"<FrameChoice {shown_values}: error of the motion {self.measured_gain:.3g} times "
                f"smaller than without a frame, {len(self.pilots)} pilots>")

    def __str__(self) -> str:
        """Return the reason and a table of the pilots."""
        rows = [self.reason, f"{'first half':>10}  {'whole':>10}  values"]
        for pilot in self.pilots:
            values = ", ".join(f"{name} = {x:.8g}" for name, x in pilot.values.items())
            rows.append(f"{pilot.half:10.3e}  {pilot.whole:10.3e}  {values} ({pilot.label})")
        return "\n".join(rows)


class FrameSearch:
    """The search over rates and γ."""

    def __init__(self, pilots: FramePilots, velocities: Velocities) -> None:
        self.pilots, self.velocities = pilots, velocities
        self.ones = np.ones(len(pilots.means))
        self.none = np.concatenate([np.zeros(pilots.rates), self.ones])
        self.start = self.none
        if pilots.rates:
            run = pilots.arguments
            self.start = self._with(start_rates(velocities, pilots.directions, run.q, run.p,
                                                run.dt)[0])

    def _with(self, rates: Array) -> Array:
        return np.concatenate([rates, self.ones])

    def choice(self) -> FrameChoice:
        """Return the choice."""
        pilots = self.pilots
        finest = pilots.set_reference(self.none, self.start)
        if finest is None:
            pilots.stepper.run(pilots.stepper.checked_run(pilots.arguments.refined(8)))  # says why
            raise AssertionError("a step that failed has not failed again")
        best, reason, _ = self._best(finest)
        return self._chosen(0, best, reason)

    def _best(self, finest: Trajectory) -> tuple[int, str, Array]:
        """Return the run that is best, why, and its choice; the first run is that without a frame.
        """
        pilots = self.pilots
        always = [pilots.measure("no frame", self.none),
                  pilots.measure("least squares of the start", self.start)]
        if self._is_rounding(always[0]) or not (pilots.rates or len(self.ones)):
            why = "the error is round-off" if pilots.rates or len(self.ones) else (
                "there is no symmetry with these parameters")
            return always[0], f"no frame: {why}", self.none
        if pilots.rates and self._is_rounding(always[1]) and pilots.is_clear(always[1]):
            label = pilots.done[always[1]].label  # of rounding the next is no better
            return always[1], f"{label}: its error is round-off", self.start
        tried = {always[0]: self.none, always[1]: self.start}
        for label, x in self._candidates(finest):
            tried.setdefault(pilots.measure(label, x), x)
        searched: dict[int, Array] = {}
        for x in self._beginnings(tried):
            searched |= self._searched(x)
        best = always[1] if pilots.is_clear(always[1]) else always[0]
        for numbers, needed in ((tried, 1.0), (searched, _CLEARLY)):
            # the best of the first half; whether it is any good, all of it says
            found = min(numbers, key=lambda i: pilots.done[i].half, default=best)
            if (pilots.done[found].whole * needed < pilots.done[best].whole
                    and pilots.is_clear(found)):
                best = found
        known = tried | searched
        if self._is_rounding(best):
            coarser = self._at_twice_the_step()
            if coarser is not None:
                number = pilots.measure(_COARSER, coarser)
                known[number] = coarser
                best = number if self._is_rounding(number) else best
        return best, pilots.done[best].label, known[best]

    def _is_rounding(self, number: int) -> bool:
        return bool(self.pilots.done[number].whole <= 4 * self.pilots.doubt)

    def _at_twice_the_step(self) -> Array | None:
        """Return the choice of longer steps: of the same polynomial of ω, clear of rounding."""
        if self.pilots.steps < _FEW:
            return None
        search = FrameSearch(self.pilots.coarser(), self.velocities)
        finest = search.pilots.set_reference(search.none, search.start)
        return None if finest is None else search._best(finest)[2]

    def _chosen(self, plain: int, best: int, reason: str) -> FrameChoice:
        done, doubt = self.pilots.done, self.pilots.doubt
        values = done[best].values
        return FrameChoice(
            frame={name: x for name, x in values.items() if name not in self.pilots.means},
            gammas={name: x for name, x in values.items() if name in self.pilots.means},
            expected_gain=_gain(done[plain].half, done[best].half, doubt),
            measured_gain=_gain(done[plain].whole, done[best].whole, doubt),
            reason=reason, pilots=tuple(pilot for pilot in done if pilot.label != _SLOPE))

    def _candidates(self, finest: Trajectory) -> Iterator[tuple[str, Array]]:
        """Yield what is tried, each with a label."""
        pilots = self.pilots
        found = [("no frame", self.none), ("least squares of the start", self.start)]
        if pilots.rates:
            rows = slice(0, (len(finest.q) + 1) // 2, max(1, len(finest.q) // 24))
            q, p = (np.asarray(x, dtype=float) for x in (finest.q, finest.p))
            mean = least_squares(self.velocities, pilots.directions, q[rows], p[rows])
            found.append(("least squares of the motion", self._with(mean)))
            lines = SpectralLines(q, p, float(pilots.arguments.dt) * pilots.every,
                          [direction.A for direction in pilots.directions])
            order = pilots.stepper.order
            for k in {order // 2 + 1, order + 1} if lines.resolved else ():
                found.append((f"lines, power {2 * k}", self._with(lines.least(k, mean))))
            found += [(f"{part} of the least squares", self._with(
                part * self.start[: pilots.rates])) for part in (0.6, 0.8, 0.9, 1.1)]
        yield from found
        for factor in (0.5, 2.0) if len(self.ones) else ():
            for label, x in found:
                yield f"{label}, γ_m times {1 / factor:g}", np.concatenate(
                    [x[: pilots.rates], factor * x[pilots.rates :]])

    def _beginnings(self, tried: Mapping[int, Array]) -> list[Array]:
        """Return the best of what was tried, of what is apart."""
        found: list[Array] = []
        for number in sorted(tried, key=lambda i: self.pilots.done[i].half):
            x = tried[number]
            if math.isfinite(self.pilots.done[number].half) and all(
                    np.abs(x - other).max() > _APART * np.abs(other).max() for other in found):
                found.append(x)
        return found[:_SEARCHES]

    def _searched(self, x: Array) -> dict[int, Array]:
        """Return where Levenberg and Marquardt's steps go from here, as runs."""
        pilots, found = self.pilots, dict[int, Array]()
        label, damping = "searched for", 1e-3
        scale = np.ones_like(x)
        scale[: pilots.rates] = max(np.abs([x, self.start])[:, : pilots.rates].max(initial=0),
                                    1 / (float(abs(pilots.arguments.dt)) * pilots.steps))
        errors = pilots.errors(x)
        for _ in range(_STEPS):
            slopes = self._slopes(x, scale)
            if errors is None or slopes is None:
                break
            square, right = slopes.T @ slopes, slopes.T @ errors
            for _ in range(4):
                bent = square + damping * np.diag(np.diag(square))
                step = -np.linalg.lstsq(bent, right, rcond=None)[0] * scale
                new = x + step
                usable = bool((new[pilots.rates :] > 0.05).all())
                number = pilots.measure(label, new) if usable else -1
                after = pilots.errors(new) if usable else None
                if after is not None and after @ after < errors @ errors:
                    damping = max(damping / 10, 1e-12)
                    break
                damping *= 10
            else:
                break
            found[number] = new
            gained = math.sqrt(float(errors @ errors) / max(float(after @ after), 1e-300))
            x, errors = new, after
            if gained < 1.02 or pilots.done[number].half <= pilots.doubt:
                break
        return found

    def _slopes(self, x: Array, scale: Array) -> Array | None:
        """Return the derivative of the errors by x/scale, by differences."""
        columns, pilots = [], self.pilots
        base = pilots.errors(x)
        for i in range(len(x)):
            moved = x.copy()
            moved[i] += 1e-3 * scale[i]
            pilots.measure(_SLOPE, moved)
            errors = pilots.errors(moved)
            if errors is None or base is None:
                return None
            columns.append((errors - base) / 1e-3)
        return np.stack(columns, axis=1)


def _gain(plain: float, chosen: float, doubt: float) -> float:
    """Return how many times smaller an error is, bounded by its uncertainty."""
    if plain == chosen:
        return 1.0
    return plain / max(chosen, doubt)
