"""Measurements of a stepper on a model: reversal, separation of neighbours, order, trend."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise, takewhile
from typing import Any

import numpy as np

from ..core.arrays import Array
from ..core.errors import GyrosparkError, StepFailed
from ..core.start import Start
from ..runtime.results.outputs import full_states
from ..runtime.results.trajectory import Trajectory
from ..runtime.steppers.stepper import Stepper

__all__ = ["MeasuredOrder", "Reversal", "constraint_scales", "measure_order", "reversal",
           "step_keyword", "trend"]

#: Errors below this, relative to the state and in units of ε, are too near round-off to show an
#: order.
_MEASURABLE = 2**9
#: How often a step is halved to see slopes.
_HALVINGS = 6
#: A slope below this is that of round-off: it stays where it is, or grows as steps shrink.
_NO_ORDER = 0.5


@dataclass(frozen=True)
class Reversal:
    """The error of N steps forward and N back.

    ``q_error`` and ``p_error`` are largest differences, ``growth`` how many times further apart the
    flow moved neighbours on the way there or back.
    """

    q_error: float
    p_error: float
    growth: float


def step_keyword(stepper: Stepper, size: float) -> dict[str, Any]:
    """Return a step as an argument by its name: dt, in scaled time dtau."""
    return {"dtau" if stepper.binding.clocked else "dt": size}


def reversal(
    stepper: Stepper, run: Trajectory, parameters: Mapping[str, float],
    sizes: tuple[float, float],
) -> Reversal | None:
    """Integrate back from the end of a run; None if that run, or one of a neighbour, fails.

    ``sizes`` are the sizes of coordinates and momenta over the whole run.
    """
    steps = run.report.steps
    try:
        reverse = stepper.integrate(run[-1], steps=steps, parameters=parameters,
                                    **step_keyword(stepper, -run.dt))
        growth = max(_growth(stepper, trajectory, parameters, sizes)
                     for trajectory in (run, reverse))
    except GyrosparkError:
        return None
    q_error, p_error = (_largest(x[-1] - y[0])
                        for x, y in zip(full_states(reverse), full_states(run), strict=True))
    return Reversal(q_error, p_error, growth)


def _growth(
    stepper: Stepper, run: Trajectory, parameters: Mapping[str, float],
    sizes: tuple[float, float],
) -> float:
    """Return the largest factor by which neighbours separate from a run after its start.

    There are six neighbours, 1e-6 of ``sizes`` (of q and of p) away in seeded directions; all
    distances are in units of ``sizes``.
    """
    rng, count = np.random.default_rng(11), 6
    neighbours = [x[0].astype(float) + 1e-6 * size * rng.standard_normal((count, x.shape[1]))
                  for x, size in zip((run.q, run.p), sizes, strict=True)]
    # onto the constraints, from which random neighbours are displaced
    starts = [stepper.project(*state, parameters=parameters, t=float(run.t[0]))
              for state in zip(*neighbours, strict=True)]
    qs, ps = (np.array(components) for components in zip(*starts, strict=True))
    ensemble = stepper.integrate_ensemble(
        Start(qs, ps, parameters, float(run.t[0])), steps=run.report.steps,
        **step_keyword(stepper, run.dt))
    # shape (neighbours, stored states): the larger one of the distances in q and in p
    distance = np.maximum(*(np.abs(states - run_states).max(axis=2) / size
                            for states, run_states, size in
                            zip((ensemble.q, ensemble.p), (run.q, run.p), sizes, strict=True)))
    with np.errstate(all="ignore"):  # a neighbour may be projected onto the start
        ratio = distance.astype(float) / distance[:, :1].astype(float)
    return float(np.max(ratio, where=np.isfinite(ratio), initial=1.0))


def _largest(x: Array) -> float:
    """Return the largest |x| of an array; 0 of an empty one."""
    return float(np.abs(x).max(initial=0.0))


# ---------------------------------------------------------------- constraints

#: Most numbers in memory at a time.
_MOST_NUMBERS = 2**20


def constraint_scales(
    stepper: Stepper, run: Trajectory, parameters: Mapping[str, float],
    sizes: tuple[Array, Array],
) -> tuple[Array, Array]:
    """Return the scales of g and of f = g_q H_p, an entry for each row, from the scales of q and p.

    ``sizes`` are r and s, shape (n,) each. The scales are Σ_i |∂g/∂q_i| r_i and
    Σ_i |∂f/∂q_i| r_i + |∂f/∂p_i| s_i, the largest over the run; if r and s are the round-off of q
    and p in units of ε, they are the round-off of g and f.
    """
    # differences over 2⁻¹⁵ of the sizes: a power of 2, by which division is exact
    n, increment, binding = stepper.binding.n, 2.0**-15, stepper.binding
    m = binding.conditions
    parameter_struct = binding.parameters(dict(parameters))
    # row 0 is the state itself, row 1 + i has its entry i displaced
    displacements = increment * np.concatenate([np.zeros((1, 2 * n)),
                                                np.diag(np.concatenate(sizes))])
    largest = [np.zeros(stepper.m), np.zeros(m)]
    count = max(1, _MOST_NUMBERS // (2 * n * (n + m)))  # states at a time: bounded memory
    run_states = np.concatenate(full_states(run), axis=1).astype(float)
    for start in range(0, len(run.q), count):
        block = slice(start, start + count)
        states = run_states[block]
        # 2n + 1 states for each state of the run, below one another
        displaced = (states[:, None] + displacements).reshape(-1, 2 * n)
        q, p = (np.ascontiguousarray(x, dtype=binding.dtype)
                for x in (displaced[:, :n], displaced[:, n:]))
        t = np.repeat(run.t[block].astype(binding.dtype), 2 * n + 1)
        for k, defects in enumerate(binding.defects(parameter_struct, q, p, t)):
            d = defects.reshape(len(q) // (2 * n + 1), 2 * n + 1, len(largest[k]))
            # increment · Σ_i |∂/∂x_i| size_i of each state and constraint
            changes = np.abs(d[:, 1:] - d[:, :1]).sum(axis=1).astype(float)
            largest[k] = np.maximum(largest[k], changes.max(axis=0))
    return largest[0] / increment, largest[1] / increment


# ---------------------------------------------------------------- order


@dataclass(frozen=True)
class MeasuredOrder:
    """log2 of successive errors' ratio for halved steps, and how much two such slopes differ.

    ``slopes`` are all measured slopes from one longest step on; ``order`` is the second of the two
    neighbouring slopes that differ least, and ``dt`` the shortest step in it.
    """

    order: float
    spread: float
    dt: float
    slopes: tuple[float, ...]

    @property
    def agrees(self) -> bool:
        """Whether the two slopes agree on the order."""
        return self.spread <= 0.2


def measure_order(
    stepper: Stepper, q: Array, p: Array, dt: float, parameters: Mapping[str, float],
    sizes: Callable[[float], tuple[float, float]],
) -> MeasuredOrder | None:
    """Measure the order by Richardson: e(h) = |y_h − y_(h/2)| after eight of the longest steps.

    q and p, shapes (n,), are the start. The longest step h is dt, doubled until three errors exceed
    round-off, or halved until two neighbouring slopes agree. Returns None without two slopes.
    ``sizes(h)`` returns the sizes of q and p; ε times these is the round-off of steps of length h.
    """
    measurements: list[MeasuredOrder] = []
    h, doubled = dt, False
    for _ in range(14):  # a factor of 2¹⁴ in the step: no order shows by then
        errors = _halving_errors(stepper, q, p, h, sizes(h), parameters)
        measurement = None if errors is None else _closest_slopes(errors, h)
        # a step has no solution, or shorter steps show round-off alone: the search ends
        if errors is None or (measurement is None and measurements):
            break
        if measurement is None:  # errors are round-off: longer steps have larger ones
            h, doubled = 2 * h, True
            continue
        measurements.append(measurement)
        if doubled or measurement.agrees:
            break
        h = h / 2  # the step is too long for its order to show
    return min(measurements, key=lambda measurement: measurement.spread, default=None)


def _closest_slopes(errors: list[float], h: float) -> MeasuredOrder | None:
    """Return the two neighbouring slopes from step h on that differ least; None without two.

    After two slopes that agree, the first lower slope ends the search: it shows round-off, which
    may grow like 1/h, as in multipliers.
    """
    # an error that does not fall is round-off, as are all after it
    slopes = list(takewhile(lambda measured_slope: measured_slope > _NO_ORDER,
                            (math.log2(a / b) for a, b in pairwise(errors))))
    closest: MeasuredOrder | None = None
    for k, (first_slope, next_slope) in enumerate(pairwise(slopes)):
        if closest is not None and closest.agrees and next_slope < first_slope - 0.3:
            break
        # slope k + 1 is of e(h/2^(k+1)) and e(h/2^(k+2)), whose shorter steps are h/2^(k+3)
        candidate = MeasuredOrder(next_slope, abs(next_slope - first_slope), h / 2 ** (k + 3),
                                  tuple(slopes))
        closest = candidate if closest is None or candidate.spread < closest.spread else closest
    return closest


def _halving_errors(
    stepper: Stepper, q: Array, p: Array, h: float, sizes: tuple[float, float],
    parameters: Mapping[str, float],
) -> list[float] | None:
    """Return e(h), e(h/2), … relative to the sizes, down to round-off; None if a step fails.

    e(h) is the difference of the states after 8 h of steps of h/2 and of h; for a method of order p
    halving h divides it by 2ᵖ. q and p, shapes (n,), are the start, ``sizes`` the sizes of both.
    """
    end_states: list[tuple[Array, Array]] = []
    errors: list[float] = []
    for k in range(_HALVINGS + 1):
        try:
            run = stepper.integrate(q, p, steps=8 * 2**k, parameters=parameters, every=8 * 2**k,
                                    **step_keyword(stepper, h / 2**k))
        except StepFailed:
            return None
        end_q, end_p = full_states(run)
        end_states.append((end_q[-1], end_p[-1]))
        if k == 0:  # a difference needs two ends
            continue
        error = max(_largest(a - b) / size
                    for a, b, size in zip(*end_states[-2:], sizes, strict=True))
        if error < _MEASURABLE * stepper.binding.epsilon:
            break
        errors.append(error)
    return errors


# ---------------------------------------------------------------- trend


def trend(t: Array, series: Array) -> tuple[float, float]:
    """Return the change over the run of a straight line fitted to a series, and the residual range.

    ``t`` and ``series`` have the shape (samples,); fewer than three samples have no line.
    """
    if len(t) < 3:
        return 0.0, float(np.ptp(series)) if len(series) else 0.0
    x = (t - t.mean()) / (t[-1] - t[0])  # time in units of the run: the slope is a change over it
    slope = float((x * (series - series.mean())).sum() / (x * x).sum())
    return slope, float(np.ptp(series - slope * x))
