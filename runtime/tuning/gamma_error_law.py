"""The linear law of the error in 1/γ, or in γ, and where it is smallest.

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

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..rigid_body.gamma_rules import gamma_m
from .gamma_pilots import WORTHWHILE, Pilots, mean_of

__all__ = ["REACH", "GammaSearch", "least"]

Array = NDArray[Any]

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
        self.scale = np.array([gamma_m(moments) for moments in pilots.bodies.values()])
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
