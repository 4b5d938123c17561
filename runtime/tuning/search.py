"""The search for rates of a co-moving frame and for γ.

Tried are no frame, the least squares of the start and of the whole motion, the frequencies of its
spectrum, and parts of these; γ_m, γ_h, γ̃_m, γ̃_h, half and twice γ_m. From the best of them
Levenberg and Marquardt's steps minimise the error; with rates, of which many would fit the pilot
runs alone, over their first half. Chosen is the smallest of the largest error of a path, among
trials whose error is well below the base's on every path (``Pilots.is_clear``): no axis and no
point is sacrificed. Otherwise the base stays, γ_m without a frame.

Limits of the search for γ: rows at which the base is off by more than 0.3 rad are left out, because
the error is not linear in 1/γ there. If the error of the base does not grow like t (a motion slower
than the pilot runs, or a chaotic one), γ_m stays for longer runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import count_text
from ...core.arrays import Array
from ...core.registry import MEANS
from ..rigid_body.gamma_rules import mean_inertia
from .frame_start import Velocities, least_squares, start_rates
from .pilots import DIFFERENCE, Pilots
from .spectral_lines import SpectralLines

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory

__all__ = ["Search"]

#: γ stays within this factor of the moments: beyond it the law is an extrapolation.
_REACH = 10.0
#: The error of the motion is linear in 1/γ up to about this angle, in rad.
_LINEAR = 0.3
#: Fewer rows than these, two a quarter, show no growth.
_FEWEST = 8
#: Factor by which the growth of the error, over t, may vary from the second quarter to the last.
_STEADY = 1.5
#: Factor by which searched rates must beat tried ones: they may be right for the pilots alone.
_CLEARLY = 1.5
#: Searches, from the best trials; steps of each, and steps between two trials.
_SEARCHES, _STEPS, _BETWEEN = 3, 8, 4
#: Searches start from trials that differ by this part at least.
_APART = 0.04
#: Differences for derivatives: parts of the rates' scale, and of 1/γ, which enters linearly.
_CHANGE_OF_RATE, _CHANGE_OF_GAMMA = 1e-3, 0.1
#: What a step must promise of a path, a little more than is asked of the measurement.
_PROMISE = 0.9


class Search:
    """The search over rates and γ of one start."""

    def __init__(self, pilots: Pilots, velocities: Velocities, moments: Mapping[str, Any]) -> None:
        """Set the start, the scale and the bounds of the trials x.

        Their entries are the rates of the frame, then u_k = γ_m/γ_k of each body. The error is
        linear in u to leading order. ``moments`` maps each γ to its body's inertia.
        """
        self.pilots, self.velocities, self.moments = pilots, velocities, moments
        #: How many variables are rates, and how many of all, from the first on, are searched.
        self.rate_count, run = len(pilots.directions), pilots.arguments
        self.base = np.concatenate([np.zeros(self.rate_count), np.ones(len(moments))])
        self.start, self.searched_count = self.base, len(self.base)
        if self.rate_count:
            rates, _ = start_rates(velocities, pilots.directions, run.q, run.p, run.dt)
            self.start = self._with_rates(rates)
        self.scale = np.ones_like(self.base)
        # rates of a body at rest have the scale of one radian over the pilot run
        self.scale[: self.rate_count] = max(np.abs(self.start[: self.rate_count]).max(initial=0),
                                            1 / (float(abs(run.dt)) * run.steps))
        # rates have no bounds; γ stays between min I / _REACH and _REACH max I
        means, no_bounds = np.array([*pilots.means.values()]), np.full(self.rate_count, math.inf)
        largest, smallest = (np.array([*map(extreme, moments.values())]) for extreme in (max, min))
        self.low = np.concatenate([-no_bounds, means / (_REACH * largest)])
        self.high = np.concatenate([no_bounds, means / (smallest / _REACH)])

    def _with_rates(self, rates: Array) -> Array:
        """Return the trial with these rates and γ = γ_m."""
        return np.concatenate([rates, np.ones(len(self.moments))])

    def best(self) -> tuple[int, str]:
        """Return the index of the best pilot run, and the reason for it; the base is run 0."""
        pilots, name = self.pilots, "no frame" if self.rate_count else self._symbol("γ_m")
        finest = pilots.set_reference(self.base, self.start)
        base = pilots.measure(name, self.base)
        if pilots.is_round_off(base):
            return base, f"{name}: the error is round-off"
        trials = [base]
        if self.rate_count:
            start_frame = pilots.measure("least squares of the start", self.start)
            if pilots.is_round_off(start_frame) and pilots.is_clear(start_frame):
                return start_frame, "least squares of the start: the error is round-off"
            trials.append(start_frame)
            trials += [pilots.measure(*candidate) for candidate in self._frames(finest)]
        best_run, gamma_reason = self._choose(trials), ""
        if self.moments:
            gamma_reason = self._why_gamma_stays(best_run)
            self.searched_count = self.rate_count if gamma_reason else self.searched_count
            if not gamma_reason:
                trials += [pilots.measure(*candidate)
                           for candidate in self._gammas(best_run, trials)]
            best_run = self._choose(trials)
        searched = [index for trial in self._search_starts(trials)
                    for index in self._levenberg_marquardt(trial, best_run)]
        # Rates fitted to the pilot runs may fail later: they must beat tried ones clearly.
        best_run = self._choose(searched, best_run, _CLEARLY if self.rate_count else 1.0)
        return best_run, self._reason(best_run, gamma_reason)

    def _choose(self, indices: Iterable[int], best: int = 0, factor: float = 1.0) -> int:
        """Return the clear run with the smallest ``largest`` error, or ``best`` if none beats it.

        The error must be ``factor`` times smaller than with ``best``.
        """
        pilots = self.pilots
        index = min(filter(pilots.is_clear, indices), key=pilots.largest, default=best)
        return index if factor * pilots.largest(index) < pilots.largest(best) else best

    # ------------------------------------------------------------ trials

    def _frames(self, finest: Trajectory) -> Iterator[tuple[str, Array]]:
        """Yield (label, trial) of rates of the frame, with γ = γ_m.

        ``finest`` is a motion of small error, whose states are a sample for least squares and for
        the spectrum.
        """
        pilots = self.pilots
        sample_rows = slice(0, (len(finest.q) + 1) // 2, max(1, len(finest.q) // 24))
        q, p = (np.asarray(x, dtype=float) for x in (finest.q, finest.p))
        mean = least_squares(self.velocities, pilots.directions, q[sample_rows], p[sample_rows])
        yield "least squares of the motion", self._with_rates(mean)
        lines = SpectralLines(q, p, float(pilots.arguments.dt) * pilots.every,
                              [direction.A for direction in pilots.directions])
        order = pilots.stepper.order
        # an error of order r grows with a frequency about like ω^(r+1): two powers are tried
        for k in {order // 2 + 1, order + 1} if lines.is_resolved else ():
            yield f"frequencies, power {2 * k}", self._with_rates(lines.minimise(k, mean))
        for factor in (0.6, 0.8, 0.9, 1.1):
            yield (f"{factor} of the least squares",
                   self._with_rates(factor * self.start[: self.rate_count]))

    def _gammas(self, best: int, trials: list[int]) -> Iterator[tuple[str, Array]]:
        """Yield (label, trial): γ by each mean at the best rates, γ_m/2 and 2γ_m at all rates."""
        means = [*self.pilots.means.values()]
        for rule, symbol in MEANS.items():
            u = np.divide(means, [mean_inertia(inertia, rule) for inertia in self.moments.values()])
            yield self._symbol(symbol), np.concatenate(
                [self.pilots.trials[best][: self.rate_count], u])
        for index, factor in product(dict.fromkeys(trials), (0.5, 2.0)):
            x = self.pilots.trials[index].copy()
            x[self.rate_count :] = factor  # u = γ_m/γ of each body
            yield f"{self._symbol('γ_m')} times {1 / factor:g}", x

    def _symbol(self, symbol: str) -> str:
        """Return the symbol of a mean, with α in place of γ where all searched parameters are α."""
        alpha = bool(self.moments) and all(name.endswith("alpha") for name in self.moments)
        return symbol.replace("γ", "α") if alpha else symbol

    def _why_gamma_stays(self, index: int) -> str:
        """Return why the pilot runs give no γ, from the best run with γ_m; "" if they give one.

        Sets ``rows`` of the pilots, from which on errors are not linear in 1/γ any more.
        """
        pilots, steps = self.pilots, self.pilots.arguments.steps
        if pilots.aim == "energy" or pilots.errors(index) is None:
            return ""
        all_rows, linear_rows = pilots.rows, pilots.rows_before(index, _LINEAR)
        if linear_rows < all_rows:
            pilots.rows = max(linear_rows - 1, 1)
        if pilots.rows < _FEWEST:  # too few to show how the error grows
            if pilots.rows < all_rows:
                return f"the motion is lost within {(pilots.rows + 1) * pilots.every} steps"
            if pilots.longer:
                return f"pilot runs of {count_text(steps, 'step')} say nothing of a longer run"
        # the error over the middle time of quarters 2 to 4: the same if it grows like t
        growth = pilots.quarters(index)[1:] / np.array([[1.5], [2.5], [3.5]])
        above_round_off = pilots.sizes(index) > 4 * pilots.rounding
        is_unsteady = growth.max(axis=0) > _STEADY * growth.min(axis=0)
        if pilots.longer and is_unsteady[above_round_off].any():
            return ("the error of the motion does not grow like t, and pilot runs say nothing of a "
                    "longer run; let them see its slowest period")
        return ""

    # ------------------------------------------------------------ the search

    def _search_starts(self, trials: list[int]) -> list[Array]:
        """Return the best trials, at most ``_SEARCHES`` of them, no two close to each other.

        No trials where nothing is searched; a trial whose run failed is none of them.
        """
        pilots, beginnings = self.pilots, list[Array]()
        if not self.searched_count:
            return beginnings
        by_error = sorted(dict.fromkeys(trials),
                          key=lambda i: pilots.largest(i, pilots.searched_rows))
        for index in by_error:
            x = pilots.trials[index]
            is_apart = all(np.abs((x - beginning) / self.scale).max() > _APART
                           for beginning in beginnings)
            if is_apart and math.isfinite(pilots.largest(index)):
                beginnings.append(x)
        return beginnings[:_SEARCHES]

    def _levenberg_marquardt(self, x: Array, best: int) -> list[int]:
        """Return the indices of the runs of Levenberg-Marquardt steps from a trial.

        The trial x has the shape (unknowns,); runs are counted by ``pilots``. The steps minimise
        Σ_j w_j e_j², with the error e_j of path j and its weight w_j from ``_weighted_step``. A
        bisection towards run ``best`` follows if the last run makes a path less accurate. The first
        ``searched_count`` unknowns move; errors are of the rows ``searched_rows``.
        """
        pilots, indices, damping = self.pilots, list[int](), 1e-3
        index = pilots.measure("search", x)
        for _ in range(_STEPS):
            slopes = self._slopes(index)
            if slopes is None:  # a run beside this one fails
                break
            forms = self._square_forms(index, slopes)
            squares = pilots.sizes(index, pilots.searched_rows) ** 2
            for _ in range(4):  # tries of the damping
                change, weights = self._weighted_step(forms, damping)
                trial = pilots.trials[index].copy()
                trial[: self.searched_count] += change * self.scale[: self.searched_count]
                trial_index = pilots.measure("search", np.clip(trial, self.low, self.high))
                trial_squares = pilots.sizes(trial_index, pilots.searched_rows) ** 2
                # accepted: less damping, towards Gauss-Newton; else ten times more, towards
                # steepest descent
                if weights @ trial_squares < weights @ squares:
                    damping = max(damping / 10, 1e-12)
                    break
                damping *= 10
            else:
                break
            indices.append(trial_index)
            index = trial_index
            # less than 2 % gained: the search has converged
            if weights @ squares < 1.02**2 * (weights @ trial_squares):
                break
            if pilots.is_round_off(index):
                break
        return indices + self._bisect(index, best)

    def _bisect(self, index: int, best: int) -> list[int]:
        """Return runs of a bisection between the best clear run and the unclear end of a search.

        No runs if the end is clear, or no better than ``best``.
        """
        pilots, indices = self.pilots, list[int]()
        if pilots.is_clear(index) or pilots.largest(index) >= pilots.largest(best):
            return indices
        clear_trial, unclear_trial = pilots.trials[best], pilots.trials[index]
        for _ in range(_BETWEEN):
            middle = (clear_trial + unclear_trial) / 2
            indices.append(pilots.measure("search", middle))
            if pilots.is_clear(indices[-1]):
                clear_trial = middle
            else:
                unclear_trial = middle
        return indices

    def _slopes(self, index: int) -> Array | None:
        """Return scale_i ∂e/∂x_i of pilot run ``index``, shape (*e.shape, searched variables).

        e are its errors in the searched rows, x its searched rates and γ; the derivatives are
        forward differences of another pilot run for each x_i. None if a run fails.
        """
        pilots, slopes = self.pilots, list[Array]()
        x, base = pilots.trials[index], pilots.errors(index, pilots.searched_rows)
        for i in range(self.searched_count):
            change = _CHANGE_OF_RATE if i < self.rate_count else _CHANGE_OF_GAMMA
            shifted = x.copy()
            shifted[i] += change * self.scale[i]
            errors = pilots.errors(pilots.measure(DIFFERENCE, shifted), pilots.searched_rows)
            if errors is None or base is None:
                return None
            slopes.append((errors - base) / change)
        return np.stack(slopes, axis=-1)

    def _square_forms(self, index: int, slopes: Array) -> Array:
        """Return the quadratic form of each path's mean square error, shape (paths, k + 1, k + 1).

        With the errors e and their slopes S: e(x + change) ≈ e + S change, so that the form in
        (1, change) is [e S]ᵀ [e S]/rows.
        """
        errors = self.pilots.errors(index, self.pilots.searched_rows)
        assert errors is not None
        matrix, row_count = np.concatenate([errors[..., None], slopes], axis=-1), len(errors)
        columns = [matrix[:, path].reshape(-1, matrix.shape[-1]) for path in self.pilots.paths]
        return np.array([A.T @ A / row_count for A in columns])

    def _weighted_step(self, forms: Array, damping: float) -> tuple[Array, Array]:
        """Return the damped step that minimises Σ_j w_j e_j², and the weights w of the paths.

        ``forms``, shape (paths, 1 + k, 1 + k) for k variables, are the quadratic forms of e_j².
        With the sum of the weighted forms, [[c, bᵀ], [b, A]], and μ (``damping``) the step is
        change = −(A + μ diag A)⁻¹ b. Weights grow until no path's error is expected above the
        base's: they are multipliers of these inequalities.
        """
        pilots = self.pilots
        bound = (_PROMISE * pilots.sizes(0, pilots.searched_rows)) ** 2
        # a path whose error is round-off has nothing to keep
        bound = np.where(bound > (4 * pilots.rounding) ** 2, bound, math.inf)
        weights = np.ones(len(forms))
        for _ in range(60):
            A, b = (np.tensordot(weights, block, 1)
                    for block in (forms[:, 1:, 1:], forms[:, 1:, 0]))
            # damping in units of each variable's own curvature (Marquardt)
            change = -np.linalg.lstsq(A + damping * np.diag(np.diag(A)), b, rcond=None)[0]
            affine = np.concatenate([[1.0], change])  # the forms are in (1, change)
            exceeds = affine @ forms @ affine > bound
            if not exceeds.any():
                break
            weights = weights * np.where(exceeds, 1.25, 1.0)
        return change, weights / weights.max()

    # ------------------------------------------------------------ words

    def _reason(self, best: int, why_gamma_stays: str) -> str:
        """Return why run ``best`` is chosen and not the base, run 0, as a sentence."""
        pilots = self.pilots
        error_name = "error of the motion" if pilots.aim == "motion" else "energy error"
        best_pilot, base_pilot = pilots.pilot(best), pilots.pilot(0)
        gamma_text = f"; {self._symbol('γ_m')} stays: {why_gamma_stays}" if why_gamma_stays else ""
        if best == 0:
            return (f"{base_pilot.label}: no trial makes the {error_name} of every path 5 % "
                    f"smaller{gamma_text}")
        # by a search for a small energy error, the error of some path may grow
        cost_text = ""
        if pilots.aim == "energy" and best_pilot.worst > 1.05:
            cost_text = f"; the error of the motion grows up to {best_pilot.worst:.3g} times"
        return (f"{best_pilot.label}: the {error_name} is {pilots.gain(best):.3g} times smaller "
                f"than with {base_pilot.label}{cost_text}{gamma_text}")
