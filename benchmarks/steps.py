"""One step by each solver over one by dense Newton, method by method.

Solvers of one cell run alternately from the same start and must arrive at the same state. The
ratio is Newton's time over the solver's: above 1 is a gain.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from gyrospark import gamma as gamma_of
from gyrospark.api import stepper
from gyrospark.core.arguments import choose
from gyrospark.core.errors import GyrosparkError
from gyrospark.core.inertia import RepName
from gyrospark.generator.schemes.named_schemes import SchemeName
from gyrospark.runtime.rigid_body.problems import Problem, fast_top, free_body
from gyrospark.runtime.steppers.stepper import SOLVERS as KNOWN
from gyrospark.runtime.steppers.stepper import Stepper

from .peers.ours import SOLVERS, available
from .timing import alternate, stopwatch

__all__ = ["BASE", "StepTiming", "Variant", "compare_steps", "variants"]

#: The solver that others are compared with.
BASE = "newton"


@dataclass(frozen=True)
class Variant:
    """A method on a problem."""

    name: str
    scheme: SchemeName
    rep: RepName
    problem: Callable[[], Problem]
    stages: tuple[int, ...]


@dataclass(frozen=True)
class StepTiming:
    """One variant, number of stages and time step.

    Attributes
    ----------
    ns
        Median CPU nanoseconds of a step by each solver.
    ratio
        Time of dense Newton over the time of each other solver.
    iterations
        Mean iterations of a step by each solver.
    difference
        Largest difference of q at the end to dense Newton's.
    samples
        CPU seconds of every round, for so many ``steps``.
    notes
        Why a solver has no numbers.
    """

    variant: str
    stages: int
    dt: float
    steps: dict[str, int]
    ns: dict[str, float] = field(default_factory=dict)
    ratio: dict[str, float] = field(default_factory=dict)
    iterations: dict[str, float] = field(default_factory=dict)
    difference: dict[str, float] = field(default_factory=dict)
    samples: dict[str, tuple[float, ...]] = field(default_factory=dict)
    notes: dict[str, str] = field(default_factory=dict)
    failed: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self)


def variants(*, quick: bool = False) -> list[Variant]:
    """Return the methods that are compared; a quick run takes the first, with few stages."""
    if quick:
        return [Variant("G-L γ", "G-L", "gamma", fast_top, (2, 3))]
    stages = (2, 3, 4, 6, 8)
    return [
        Variant("G-L γ", "G-L", "gamma", fast_top, stages),
        Variant("G-L α", "G-L", "alpha", fast_top, stages),
        Variant("LIIIA-B γ", "LIIIA-B", "gamma", fast_top, (3, 4, 6, 8)),
        Variant("asymmetric body γ", "G-L", "gamma", _asymmetric, stages),
        Variant("free body γ", "G-L", "gamma", _free_symmetric, stages),
    ]


def _asymmetric() -> Problem:
    return free_body((0.002, 0.0013, 0.0008), (30.0, -40.0, 100.0))


def _free_symmetric() -> Problem:
    return free_body((0.002, 0.002, 0.0008), (0.0, 6.0, 125.0))


def compare_steps(
    chosen: Sequence[Variant], dts: Sequence[float], rounds: int, least: float,
    watch: Callable[[str], None] = lambda name: None,
) -> Iterator[StepTiming]:
    """Yield a cell for each variant, number of stages and time step."""
    for variant in chosen:
        for stages in variant.stages:
            watch(f"{variant.name}, {stages} stages")
            step = stepper(variant.scheme, stages, variant.rep)
            for dt in dts:
                yield _cell(variant, step, stages, dt, rounds, least)


def _cell(variant: Variant, step: Stepper, stages: int, dt: float, rounds: int, least: float
          ) -> StepTiming:
    runs = {solver: _run(variant, step, dt, solver) for solver in SOLVERS if available(solver)}
    notes = {solver: "not available" for solver in SOLVERS if solver not in runs}
    ends: dict[str, Any] = {}
    for solver in list(runs):
        try:
            ends[solver] = runs[solver](200)
        except GyrosparkError as error:
            notes[solver] = str(error)
            del runs[solver]
    steps = {solver: _enough(run, least) for solver, run in runs.items()}
    samples = alternate({solver: _job(run, steps[solver]) for solver, run in runs.items()}, rounds)
    ns = {solver: sample.median / steps[solver] * 1e9 for solver, sample in samples.items()}
    base = ends.get(BASE)
    return StepTiming(
        variant.name, stages, dt, steps, ns,
        ratio={s: ns[BASE] / ns[s] for s in ns if s != BASE and BASE in ns},
        iterations={s: float(end.report.iterations_mean) for s, end in ends.items()},
        difference={s: float(np.abs(end.q[-1] - base.q[-1]).max()) for s, end in ends.items()
                    if base is not None and s != BASE},
        samples={s: sample.seconds for s, sample in samples.items()},
        notes=notes, failed=len(ends) < sum(available(s) for s in SOLVERS))


def _run(variant: Variant, step: Stepper, dt: float, solver: str) -> Callable[[int], Any]:
    problem = variant.problem()
    values = {name: value for name, value in problem.parameters.items()
              if name in step.parameter_domains} | {variant.rep: gamma_of(problem.inertia)}
    return lambda steps: step.integrate(problem.q0, problem.p0, dt=dt, steps=steps, every=steps,
                                        parameters=values, solver=choose("solver", solver, KNOWN))


def _enough(run: Callable[[int], Any], least: float) -> int:
    """Return how many steps take a solver at least ``least`` CPU seconds."""
    steps = 200
    while stopwatch(_job(run, steps)) < least:
        steps *= 2
    return steps


def _job(run: Callable[[int], Any], steps: int) -> Callable[[], object]:
    return lambda: run(steps)
