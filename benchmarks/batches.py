"""Chains and loops side by side in lanes: a trajectory of a batch over one that runs alone.

Eight starts of each linkage, a few per cent apart. In turn they run alone, one after another, and
together as an ensemble on one thread; a round's ratio is that of its own two times.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from gyrospark.api import stepper
from gyrospark.core.errors import GyrosparkError
from gyrospark.runtime.results.trajectory import Trajectory
from gyrospark.runtime.steppers.ensemble import Ensemble
from gyrospark.runtime.steppers.stepper import Stepper

from .peer_linkages import Array, Linkage
from .timing import alternate

__all__ = ["DT", "STAGES", "TRAJECTORIES", "BatchRow", "compare_batches", "starts"]

STAGES = (2, 3, 4, 6)
TRAJECTORIES = 8
DT = 2e-3
#: Steps of a run; of a quick one.
_STEPS, _QUICK = 500, 50
#: How far starts are from one another: q by so much, p by so much of its largest entry.
_SPREAD = 0.02


@dataclass(frozen=True)
class BatchRow:
    """A linkage with a number of stages; numbers are None where a run failed.

    Attributes
    ----------
    us_alone, us_batch
        Median CPU time of a step of one trajectory in µs: alone, and in a batch.
    ratio, spread
        Median over the rounds of batch over alone, and its median deviation, relative.
    sweeps_alone, sweeps
        Sweeps of a step, mean of all trajectories: alone, and in a batch.
    newton_steps
        Steps of a batch that Newton had to finish.
    difference
        Largest |q| by which the two ways differ at the end: what rounding has grown to.
    energy_error, constraint_max
        Largest |H − H₀| and |g| of all steps in the batch, in J and as the constraints are scaled.
    """

    model: str
    stages: int
    dt: float
    steps: int
    trajectories: int = TRAJECTORIES
    lanes: int = 1
    us_alone: float | None = None
    us_batch: float | None = None
    ratio: float | None = None
    spread: float | None = None
    sweeps_alone: float | None = None
    sweeps: float | None = None
    newton_steps: int = 0
    difference: float | None = None
    energy_error: float | None = None
    constraint_max: float | None = None
    note: str = ""
    failed: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self)


@dataclass(frozen=True)
class _Batch:
    """The same starts, alone and together."""

    step: Stepper
    q: Array
    p: Array
    options: dict[str, Any]

    def alone(self) -> list[Trajectory]:
        return [self.step.integrate(q, p, **self.options)
                for q, p in zip(self.q, self.p, strict=True)]

    def together(self) -> Ensemble:
        found = self.step.integrate_ensemble(self.q, self.p, workers=1, **self.options)
        for failure in found.failures.values():
            raise failure
        return found


def starts(linkage: Linkage, step: Stepper, count: int = TRAJECTORIES) -> tuple[Array, Array]:
    """Return q and p of so many starts on the constraints; the first is the linkage's own."""
    model, chance = linkage.model, np.random.default_rng(1)
    found = []
    for i in range(count):
        away = _SPREAD * chance.standard_normal((2, len(model.q0))) if i else np.zeros((2, 1))
        found.append(step.project(model.q0 + away[0], model.p0 + away[1] * np.abs(model.p0).max(),
                                  parameters=model.parameters))
    return np.array([q for q, _ in found]), np.array([p for _, p in found])


def compare_batches(
    chosen: Sequence[Linkage], rounds: int, *, quick: bool = False,
    watch: Callable[[str], None] = lambda name: None,
) -> list[BatchRow]:
    """Return a row for each linkage and number of stages."""
    steps = _QUICK if quick else _STEPS
    return [_row(linkage, stages, steps, rounds, watch)
            for linkage in chosen for stages in (STAGES[:1] if quick else STAGES)]


def _row(
    linkage: Linkage, stages: int, steps: int, rounds: int, watch: Callable[[str], None]
) -> BatchRow:
    watch(f"{linkage.name}: {TRAJECTORIES} together, G-L s={stages}")
    step = stepper("G-L", stages, system=linkage.model)
    row = BatchRow(linkage.name, stages, DT, steps, lanes=step.binding.lanes)
    batch = _Batch(step, *starts(linkage, step), {
        "dt": DT, "steps": steps, "every": steps, "parameters": linkage.model.parameters})
    try:
        alone, together = batch.alone(), batch.together()
    except GyrosparkError as error:
        return replace(row, note=str(error), failed=True)
    jobs: dict[str, Callable[[], object]] = {"alone": batch.alone, "together": batch.together}
    samples = alternate(jobs, rounds, time.process_time)
    pairs = zip(samples["together"].seconds, samples["alone"].seconds, strict=True)
    ratios = [mine / other for mine, other in pairs]
    ratio = statistics.median(ratios)
    each = TRAJECTORIES * steps * 1e-6
    reports = [one.report for one in together.members]
    return replace(
        row, us_alone=samples["alone"].median / each,
        us_batch=samples["together"].median / each, ratio=ratio,
        spread=statistics.median(abs(x / ratio - 1) for x in ratios),
        sweeps_alone=statistics.fmean(one.report.iterations_mean for one in alone),
        sweeps=statistics.fmean(report.iterations_mean for report in reports),
        newton_steps=sum(report.newton_steps for report in reports),
        difference=max(float(np.abs(together.q[i, -1] - one.q[-1]).max())
                       for i, one in enumerate(alone)),
        energy_error=max(report.energy_error_max for report in reports),
        constraint_max=max(report.constraint_max for report in reports))
