"""The rates of a co-moving frame, and γ with them, chosen by measurement.

Tried are no frame, the least squares of the start and of the whole motion, what the lines of its
spectrum ask for, and parts of these; from the best of them Levenberg and Marquardt's steps go on,
for the errors are polynomials of ω and of 1/γ. All of that on the first half of the pilots. What is
then best on all of them is chosen; no frame and the least squares of the start are always among
what it is chosen from, and what was searched for must beat them clearly.

    frame_start     least squares
    frame_lines     from the spectrum
    frame_pilots    the runs and their errors
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...arguments import as_mapping
from ...errors import InputError, Stopped
from ...exact import Number
from ...naming import choose, shown
from ..body.inertia import AIMS, gamma_m, known_inertia, principal_moments, ruled
from ..call.checks import as_positive_count, as_step
from .frame_lines import Lines
from .frame_pilots import FramePilot, FramePilots
from .frame_start import Velocities, directions_of, least_squares
from .gamma_choice import PILOT_STEPS

if TYPE_CHECKING:
    from ..output.trajectory import Trajectory
    from ..run.stepper import Stepper

__all__ = ["FRAME_CHOICES", "FrameChoice", "asks_for_frame", "choose_frame", "start_frame",
           "with_frame"]

Array = NDArray[Any]

#: What ``parameters["frame"]`` may say.
FRAME_CHOICES = ("start", "auto")
#: By how much what was searched for must beat least squares: it may be right for the pilots alone.
_CLEARLY = 1.5
#: Searches, from the best of what was tried; steps of each.
_SEARCHES, _STEPS = 3, 8
#: Runs for derivatives, of which nobody need be told.
_SLOPE = "slope"
#: Searches start from choices that differ by this part at least.
_APART = 0.04


@dataclass(frozen=True)
class FrameChoice:
    """A choice of rates, and of γ where it was asked for, with what it was chosen by.

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


def choose_frame(
    stepper: Stepper,
    q: ArrayLike,
    p: ArrayLike,
    *,
    dt: Number,
    parameters: Mapping[str, Any],
    bodies: Mapping[str, Sequence[float]] | None = None,
    steps: int = PILOT_STEPS,
    t0: Number = 0.0,
) -> FrameChoice:
    """Return the rates of the co-moving frame that makes the error of runs from (q, p) smallest.

    Parameters
    ----------
    stepper : Stepper
        Made with ``frame="symmetries"``.
    q, p : array_like, shape (n,)
        The start; the choice is for this motion.
    dt : float
        The time step the choice is for, in s.
    parameters : mapping
        The stepper's other parameters; rates among them are not looked at.
    bodies : mapping of str to three floats, optional
        Name of each γ to choose as well → I₁, I₂, I₃ of its body in kg m². By default the
        parameters whose value is ``"auto"``, with the moments that stand beside them.
    steps : int
        Length of the pilot runs, at least 8. They should see the motion's slowest period.
    t0 : float
        Time at the start, for forces that depend on it.

    Raises
    ------
    InputError
        For a stepper without symmetries, or unusable arguments.
    StepFailed
        If the steps converge with nothing that was tried.

    Examples
    --------
    >>> choice = gyrospark.choose_frame(step, top.q0, top.p0, dt=1e-3,
    ...                                 parameters=parameters)  # doctest: +SKIP
    >>> parameters = parameters | choice.values  # doctest: +SKIP
    """
    known = _usable(stepper, parameters)
    rates = {symmetry.name for symmetry in stepper.symmetries}
    known = {name: value for name, value in known.items() if name not in rates}
    if bodies is None:
        bodies = {name: known_inertia(name, known) for name, value in known.items()
                  if isinstance(value, str) and value in AIMS}
    bodies = as_mapping("bodies", bodies, "{'gamma': (I1, I2, I3)}")
    for name in bodies:
        if name not in stepper.parameter_domains or name in rates:
            raise InputError(f"{stepper.name} has no parameter {name!r} to choose; it has "
                             f"{', '.join(stepper.parameter_domains)}.")
    numbers = {**known, **{name: "m" if name in known and known[name] in AIMS else
                           _mean_of(name, inertia) for name, inertia in bodies.items()}}
    stepper.checked_run(q, p, dt=dt, steps=0, every=1, parameters=numbers, solver="auto",
                        tolerance=None, max_iterations=50, t0=t0)
    numbers = _ruled(numbers)
    pilots = FramePilots(stepper, q, p, as_step(dt, stepper.binding.number),
                         as_positive_count("steps", steps, least=8), numbers,
                         directions_of(stepper, q, p, numbers), bodies, t0)
    return _Search(pilots, Velocities(stepper, numbers, t0)).choice()


def start_frame(
    stepper: Stepper, q: ArrayLike, p: ArrayLike, parameters: Mapping[str, Any]
) -> dict[str, float]:
    """Return the rates of the least squares of a start, without a run.

    Raises
    ------
    InputError
        For a stepper without symmetries.
    """
    known = _ruled(_usable(stepper, parameters))
    found = {symmetry.name: 0.0 for symmetry in stepper.symmetries}
    directions = directions_of(stepper, q, p, known)
    if not directions:
        return found
    rates = least_squares(Velocities(stepper, known), directions, q, p)
    for rate, direction in zip(rates.tolist(), directions, strict=True):
        for name, weight in direction.weights.items():
            found[name] += rate * weight
    return found


def with_frame(
    stepper: Stepper, q: ArrayLike, p: ArrayLike, *, dt: Number, steps: int,
    parameters: Any, t0: Number = 0.0,
) -> Any:
    """Return the parameters of a run with ``"frame"`` replaced by the rates it stands for."""
    if not isinstance(parameters, Mapping) or not asks_for_frame(stepper, parameters):
        return parameters
    mode = choose("frame among the parameters:", parameters["frame"], FRAME_CHOICES)
    others = {name: value for name, value in parameters.items() if name != "frame"}
    given = [symmetry.name for symmetry in stepper.symmetries if symmetry.name in others]
    if given:
        raise InputError(f"Parameter {given[0]} is given besides frame = {mode!r}, which chooses "
                         "it; give one.")
    if mode == "start":
        return others | start_frame(stepper, q, p, others)
    run = as_positive_count("steps", steps)
    try:
        choice = choose_frame(stepper, q, p, dt=dt, parameters=others, t0=t0,
                              steps=min(max(run, 8), PILOT_STEPS))
    except Stopped as stopped:  # its trajectory is a pilot's
        raise Stopped("Stopped before the first step, while the frame was chosen.", stopped.signal
                      ) from None
    return others | choice.values


def asks_for_frame(stepper: Stepper, parameters: Mapping[str, Any]) -> bool:
    """Whether ``"frame"`` among parameters asks for a choice: it is no parameter of the system."""
    return "frame" in parameters and "frame" not in stepper.parameter_domains


# ---------------------------------------------------------------- the search


class _Search:
    """What is tried, and what of it is chosen."""

    def __init__(self, pilots: FramePilots, velocities: Velocities) -> None:
        self.pilots, self.velocities = pilots, velocities
        self.ones = np.ones(len(pilots.means))
        self.none = np.concatenate([np.zeros(pilots.rates), self.ones])
        self.start = self.none
        if pilots.rates:
            self.start = self._with(least_squares(velocities, pilots.directions, pilots.q,
                                                  pilots.p))

    def _with(self, rates: Array) -> Array:
        return np.concatenate([rates, self.ones])

    def choice(self) -> FrameChoice:
        """Return the choice."""
        pilots = self.pilots
        finest = pilots.set_reference([self.start, self.none])
        if finest is None:
            pilots.stepper.integrate(pilots.q, pilots.p, dt=pilots.dt / 8, steps=8 * pilots.steps,
                                     parameters=pilots.parameters, t0=pilots.t0)  # says why
            raise AssertionError("a step that failed has not failed again")
        always = [pilots.measure("no frame", self.none),
                  pilots.measure("least squares of the start", self.start)]
        plain = pilots.done[always[0]]
        if plain.whole <= 4 * pilots.doubt or not (pilots.rates or len(self.ones)):
            why = "the error is round-off" if pilots.rates or len(self.ones) else (
                "there is no symmetry with these parameters")
            return self._chosen(always[0], always[0], f"no frame: {why}")
        tried = {always[0]: self.none, always[1]: self.start}
        for label, x in self._candidates(finest):
            tried.setdefault(pilots.measure(label, x), x)
        searched: dict[int, Array] = {}
        for x in self._beginnings(tried):
            searched |= self._searched(x)
        best = min(always, key=lambda i: pilots.done[i].whole)
        for numbers, needed in ((tried, 1.0), (searched, _CLEARLY)):
            # the best of the first half; whether it is any good, all of it says
            found = min(numbers, key=lambda i: pilots.done[i].half, default=best)
            if pilots.done[found].whole * needed < pilots.done[best].whole:
                best = found
        return self._chosen(always[0], best, pilots.done[best].label)

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
            lines = Lines(q, p, float(pilots.dt) * pilots.every,
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
                                    1 / (float(abs(pilots.dt)) * pilots.steps))
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
    """Return how many times smaller an error is, no more than can be told."""
    if plain == chosen:
        return 1.0
    return plain / max(chosen, doubt)


# ---------------------------------------------------------------- arguments


def _usable(stepper: Stepper, parameters: Any) -> dict[str, Any]:
    """Return the parameters, or refuse a stepper without a frame."""
    if not hasattr(stepper, "symmetries"):
        raise InputError(f"stepper = {shown(stepper)} is no stepper; make one with "
                         "gyrospark.stepper.")
    if not stepper.symmetries:
        raise InputError(f"{stepper.name} has no co-moving frame; make the stepper with "
                         "frame='symmetries'.")
    return dict(as_mapping("parameters", parameters, "{'mgl': 0.4}"))


def _ruled(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters with rules as numbers; "auto" stands for γ_m as yet."""
    return {name: ruled(name, "m" if value in AIMS else value, parameters)
            if isinstance(value, str) else value for name, value in parameters.items()}


def _mean_of(name: str, inertia: Any) -> float:
    return float(gamma_m(principal_moments(inertia)))


