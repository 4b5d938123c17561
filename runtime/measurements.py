"""What is measured of a stepper on a model: reversal, separation of neighbours, order, trend."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise, takewhile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import GyrosparkError, StepFailed
from .stepper import Stepper
from .trajectory import Trajectory

__all__ = ["OrderSeen", "Reversal", "constraint_scales", "order_seen", "reversal", "trend"]

Array = NDArray[Any]

#: Errors below this, relative to the state, are too near round-off to show an order.
_MEASURABLE = 1e-11
#: How often a step is halved to see slopes.
_HALVINGS = 6
#: A slope below this is that of round-off: it stays where it is, or grows as steps shrink.
_NO_ORDER = 0.5


@dataclass(frozen=True)
class Reversal:
    """The error of N steps forward and N back.

    ``q_error`` and ``p_error`` are largest differences, ``q_size`` and ``p_size`` the largest
    coordinate and momentum of the run, ``growth`` how many times further apart the flow moved
    neighbours on the way there or back.
    """

    q_error: float
    p_error: float
    q_size: float
    p_size: float
    growth: float
    steps: int


def reversal(
    stepper: Stepper, run: Trajectory, parameters: Mapping[str, float]
) -> Reversal | None:
    """Go back from the end of a run, step by step; None if that fails."""
    steps = run.report.steps
    try:
        back = stepper.integrate(run.q[-1], run.p[-1], dt=-run.dt, steps=steps,
                                 parameters=parameters, t0=float(run.t[-1]))
    except GyrosparkError:
        return None
    growth = max(_growth(stepper, run.q[0], run.p[0], run.dt, run, parameters),
                 _growth(stepper, run.q[-1], run.p[-1], -run.dt, back, parameters))
    return Reversal(
        q_error=_largest(back.q[-1] - run.q[0]), p_error=_largest(back.p[-1] - run.p[0]),
        q_size=_largest(run.q), p_size=_largest(run.p), growth=growth, steps=steps,
    )


def _growth(
    stepper: Stepper, q: Array, p: Array, dt: float, run: Trajectory,
    parameters: Mapping[str, float],
) -> float:
    """Return how many times further from a run its neighbours are, at most, than at its start.

    Six neighbours, 1e-6 of the sizes away, in seeded directions; distances in units of the sizes.
    """
    rng, count = np.random.default_rng(11), 6
    sizes = [_largest(x) or 1.0 for x in (run.q, run.p)]
    near = [x + 1e-6 * size * rng.standard_normal((count, len(x)))
            for x, size in zip((q, p), sizes, strict=True)]
    try:
        starts = [stepper.project(*state, parameters=parameters)
                  for state in zip(*near, strict=True)]
        qs, ps = (np.array(part) for part in zip(*starts, strict=True))
        many = stepper.integrate_ensemble(qs, ps, dt=dt, steps=run.report.steps,
                                          parameters=parameters, t0=float(run.t[0]))
    except GyrosparkError:
        return 1.0
    distance = np.maximum(
        np.abs(many.q - run.q).max(axis=2) / sizes[0], np.abs(many.p - run.p).max(axis=2) / sizes[1]
    ).astype(float)
    ratio = distance / distance[:, :1]
    return max(1.0, float(np.nanmax(ratio)))


def _largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))


# ---------------------------------------------------------------- constraints


def constraint_scales(
    stepper: Stepper, q: Array, p: Array, parameters: Mapping[str, float]
) -> tuple[float, float]:
    """Return what a relative change of every coordinate and momentum changes in g and in f.

    Σ_i |∂g/∂q_i| |q| and Σ_i |∂f/∂q_i| |q| + |∂f/∂p_i| |p| by differences, |q| and |p| the norms;
    the largest entry of each: times ε this is what rounding a state is worth in them.
    """
    if not stepper.m:
        return 0.0, 0.0
    nudge = 2.0**-15
    at = [np.asarray(x, float) for x in stepper.defects(q, p, parameters=parameters)]
    totals = [np.zeros(stepper.m), np.zeros(stepper.m)]
    for which, x in enumerate((q, p)):
        width = nudge * float(np.linalg.norm(x))
        for i in range(len(x)):
            moved = [np.array(q, float), np.array(p, float)]
            moved[which][i] += width
            there = stepper.defects(*moved, parameters=parameters)
            for total, a, b in zip(totals, there, at, strict=True):
                total += np.abs(np.asarray(a, float) - b) / nudge
    return float(totals[0].max()), float(totals[1].max())


# ---------------------------------------------------------------- order


@dataclass(frozen=True)
class OrderSeen:
    """log2 of successive errors' ratio for halved steps, and how much two such slopes differ.

    ``slopes`` are all that were seen from one longest step on; ``order`` is the second of the two
    neighbours among them that differ least, and ``dt`` the shortest step it was seen at.
    """

    order: float
    spread: float
    dt: float
    slopes: tuple[float, ...]

    @property
    def agrees(self) -> bool:
        """Whether the two slopes tell one order."""
        return self.spread <= 0.2


def order_seen(
    stepper: Stepper, q: Array, p: Array, dt: float, parameters: Mapping[str, float]
) -> OrderSeen | None:
    """Measure the order by Richardson: e(h) = |y_h − y_(h/2)| after eight steps of the longest.

    The longest step is dt, doubled until three errors stand out of round-off, or halved until two
    neighbouring slopes agree. None if there are no two.
    """
    sizes = [_largest(x) or 1.0 for x in (q, p)]
    found: list[OrderSeen] = []
    h, doubled = dt, False
    for _ in range(14):
        errors = _halving_errors(stepper, q, p, h, sizes, parameters)
        seen = None if errors is None else _agreeing(errors, h)
        if errors is None or (seen is None and found):
            break
        if seen is None:
            h, doubled = 2 * h, True
            continue
        found.append(seen)
        if doubled or seen.agrees:
            break
        h = h / 2
    return min(found, key=lambda seen: seen.spread, default=None)


def _agreeing(errors: list[float], h: float) -> OrderSeen | None:
    """Return the two neighbouring slopes from step h on that differ least; None if there are none.

    After two that agree the first that falls ends them: there round-off, which may grow like 1/h
    as that of multipliers does, takes over.
    """
    slopes = list(takewhile(lambda slope: slope > _NO_ORDER,
                            (math.log2(a / b) for a, b in pairwise(errors))))
    best: OrderSeen | None = None
    for k, (one, other) in enumerate(pairwise(slopes)):
        if best is not None and best.agrees and other < one - 0.3:
            break
        seen = OrderSeen(other, abs(other - one), h / 2 ** (k + 3), tuple(slopes))
        best = seen if best is None or seen.spread < best.spread else best
    return best


def _halving_errors(
    stepper: Stepper, q: Array, p: Array, h: float, sizes: list[float],
    parameters: Mapping[str, float],
) -> list[float] | None:
    """Return e(h), e(h/2), … relative to the sizes, down to round-off; None if a step fails."""
    ends: list[tuple[Array, Array]] = []
    errors: list[float] = []
    for k in range(_HALVINGS + 1):
        try:
            run = stepper.integrate(q, p, dt=h / 2**k, steps=8 * 2**k, parameters=parameters,
                                    every=8 * 2**k)
        except StepFailed:
            return None
        ends.append((run.q[-1], run.p[-1]))
        if k == 0:
            continue
        error = max(_largest(a - b) / size for a, b, size in zip(*ends[-2:], sizes, strict=True))
        if error < _MEASURABLE:
            break
        errors.append(error)
    return errors


# ---------------------------------------------------------------- trend


def trend(t: Array, values: Array) -> tuple[float, float]:
    """Return the change over the run by a straight line through the values, and what is left."""
    if len(t) < 3:
        return 0.0, float(np.ptp(values)) if len(values) else 0.0
    x = (t - t.mean()) / (t[-1] - t[0])
    slope = float((x * (values - values.mean())).sum() / (x * x).sum())
    return slope, float(np.ptp(values - slope * x))
