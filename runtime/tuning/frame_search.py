"""What is tried of the rates of a co-moving frame, and of γ, and what is chosen.

Tried are no frame, the least squares of the start and of the whole motion, what the lines of its
spectrum ask for, and parts of these; from the best of them Levenberg and Marquardt's steps go on,
for the errors are polynomials of ω and of 1/γ. All of that on the first half of the pilots. What is
then best on all of them is chosen, if it is better than no frame by 5 % and by more than the
reference may be wrong; what was searched for must beat the least squares of the start, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from .frame_pilots import FramePilot, FramePilots
from .frame_spectrum import SpectralLines
from .frame_start import Velocities, least_squares, start_rates

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory

__all__ = ["FrameChoice", "FrameSearch"]

Array = NDArray[Any]

#: By how much what was searched for must beat least squares: it may be right for the pilots alone.
_CLEARLY = 1.5
#: Searches, from the best of what was tried; steps of each.
_SEARCHES, _STEPS = 3, 8
#: Runs of fewer steps see too little.
_FEW = 32
#: Of what is chosen by steps twice as long.
_COARSER = "chosen at twice the step"
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


class FrameSearch:
    """What is tried, and what of it is chosen."""

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
    """Return how many times smaller an error is, no more than can be told."""
    if plain == chosen:
        return 1.0
    return plain / max(chosen, doubt)
