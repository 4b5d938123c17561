"""Accuracy of a stepper on a model, over its step and over its CPU time, and the plot of it."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..core.arrays import Array
from ..core.errors import StepFailed
from ..core.warnings import capture_warnings
from ..runtime.plotting.trajectory_plots import figure_class, save
from ..runtime.results.trajectory import Trajectory
from ..runtime.steppers.stepper import Stepper

__all__ = ["Accuracy", "accuracy", "draw"]

#: Steps of the longest of runs that are compared, and how often the step is halved from there.
_MOST_STEPS, _HALVINGS = 250, 6
#: Ratio of the shortest tested step to the step of the reference.
_FINER = 4
#: The shortest CPU time that is reported, in s: a plot over log(time) has no place for 0 or less.
_TICK = 1e-6


@dataclass(frozen=True)
class Accuracy:
    """Errors of one motion at its end, for steps 4 dt, 2 dt, dt, ….

    Attributes
    ----------
    stepper, order : str and int
        Its name, and its order as derived.
    t_end : float
        Where the motion ends, in s.
    dt, error, seconds : list of float
        The step, max |y − y_ref| relative to the sizes of q and p, and the CPU time of the steps:
        the least of three runs, less the least of three calls that take one step. Steps that find
        no solution have none.
    """

    stepper: str
    order: int
    t_end: float
    dt: list[float]
    error: list[float]
    seconds: list[float]

    @property
    def slopes(self) -> list[float]:
        """log(e/e')/log(h/h') of successive steps h > h', h' = h/2 unless a step between them
        failed: about the order where errors are not round-off; one number fewer than errors, ±inf
        or NaN where an error is 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            error_ratios, step_ratios = (np.log2(np.divide(x[:-1], x[1:]))
                                         for x in (self.error, self.dt))
        slopes: list[float] = (error_ratios / step_ratios).tolist()
        return slopes


def accuracy(stepper: Stepper, q: Array, p: Array, *, dt: float, steps: int,
             parameters: Mapping[str, Any]) -> Accuracy:
    """Integrate a motion with the step 4 dt, halved six times, and compare its ends.

    q and p, shapes (n,), are the start; ``steps`` steps of dt are the length of the motion. The
    reference has a step four times shorter than the shortest: for a method of order r its error is
    4^−r of the error at the shortest step. Raises StepFailed if the reference, or no other run,
    gets to its end.
    """
    longest, count = 4 * dt, max(1, min(steps, _MOST_STEPS) // 4)

    def run(step: float, n: int) -> tuple[Trajectory, float]:
        """Return the run of ``n`` steps, its last state alone, and its CPU time in seconds."""
        start_time = time.process_time()
        with capture_warnings():
            trajectory = stepper.integrate(q, p, dt=step, steps=n, every=n, parameters=parameters)
        return trajectory, time.process_time() - start_time

    def fastest(step: float, n: int) -> tuple[Trajectory, float]:
        """Return the one of three equal runs with the least CPU time, and this time in seconds."""
        runs = [run(step, n) for _ in range(3)]
        return min(runs, key=lambda trajectory_and_seconds: trajectory_and_seconds[1])

    finest = longest / 2**_HALVINGS / _FINER
    reference, _ = run(finest, count * 2**_HALVINGS * _FINER)
    _, overhead = fastest(finest, n=1)  # a call costs this without steps, and is subtracted
    measurements: list[tuple[float, float, float]] = []
    for k in range(_HALVINGS + 1):
        step, n = longest / 2**k, count * 2**k  # every run ends at the same time
        try:
            trajectory, seconds_spent = fastest(step, n)
        except StepFailed:  # the longest steps may have no solution; shorter ones have
            if k == _HALVINGS and not measurements:
                raise
            continue
        # q and p have units of their own, so each is compared with its own largest entry
        error = max(np.abs(end[-1] - exact[-1]).max() / (np.abs(exact).max() or 1.0)
                    for end, exact in ((trajectory.q, reference.q), (trajectory.p, reference.p)))
        measurements.append((step, float(error), max(seconds_spent - overhead, _TICK)))
    dts, errors, seconds = (list(column) for column in zip(*measurements, strict=True))
    return Accuracy(stepper.name, stepper.order, longest * count, dts, errors, seconds)


def draw(model: str, accuracy: Accuracy, target: Path) -> None:
    """Draw the error over the step, with a line of the derived order, and over the CPU time.

    ``model`` is the name in the title, ``target`` the file; errors of 0 are left out.
    """
    figure = figure_class()(figsize=(9, 3.8), layout="constrained")
    order_axes, work_axes = figure.subplots(1, 2, sharey=True)
    dt, error, seconds = map(np.array, (accuracy.dt, accuracy.error, accuracy.seconds))
    positive = error > 0  # 0 has no place on a logarithmic axis
    order_axes.loglog(dt[positive], error[positive], "o-", label=accuracy.stepper)
    if positive.any():
        first = int(np.argmax(positive))  # the line begins at the error of the longest step
        guide = error[first] * (dt / dt[first]) ** accuracy.order
        # a line that goes on far below the errors would stretch the axis
        in_range = guide >= error[positive].min() / 10
        order_axes.loglog(dt[in_range], guide[in_range], "--", color="#7f8c8d",
                          label=f"Δt^{accuracy.order}")
    order_axes.set_xlabel("Δt [s]")
    order_axes.set_ylabel("relative error")
    order_axes.set_title(f"order, at t = {accuracy.t_end:.4g} s", fontsize=10)
    work_axes.loglog(seconds[positive], error[positive], "o-", label=accuracy.stepper)
    work_axes.set_xlabel("CPU time of the steps [s]")
    work_axes.set_title("work and precision", fontsize=10)
    for axes in (order_axes, work_axes):
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize=8)
    figure.suptitle(f"{model} with {accuracy.stepper}", fontsize=11)
    save(figure, target)
