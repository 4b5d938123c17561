"""How cost grows with the number of bodies: to derive, to compile, and to step a chain.

    derive      CPU seconds of the model with its start, and of the generator, caches of SymPy empty
    compile     CPU seconds of the C compiler and of cffi, nothing taken from the cache
    step        µs of a step of the same simulated span, default solver; the sweeps it takes

A law is the slope of log(cost) against log(N): 0 for what does not grow, 1 for linear growth.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gyrospark.core.errors import GyrosparkError
from gyrospark.generator.multibody.model import Model
from gyrospark.generator.multibody.models import build_chain
from gyrospark.generator.pipeline import Generated, generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.symbolic.derivatives import derivative
from gyrospark.generator.systems.repeated_structure import Structure
from gyrospark.runtime.compilation.compiler import compile_module, find_compiler
from gyrospark.runtime.results.trajectory import Trajectory
from gyrospark.runtime.steppers.stepper import Stepper

from .timing import Sample, alternate, repeated, stopwatch, with_children

__all__ = ["COUNTS", "QUICK", "Size", "compile_seconds", "forget", "grow", "laws"]

COUNTS = (1, 2, 4, 8, 16, 32, 64, 100)
QUICK = (1, 2, 4)
STAGES = 3
DT = 2e-3
#: From so many bodies on a law is fitted: below, what all sizes have in common weighs more.
_LAW_FROM = 8
#: Costs that have a law.
_COSTS = ("model_s", "generate_s", "compile_s", "lines", "us_per_step", "us_per_body",
          "ns_per_body_and_sweep")


@dataclass(frozen=True)
class Size:
    """A chain of so many bodies.

    Attributes
    ----------
    structured
        Whether its C loops over bodies instead of naming each.
    model_s, generate_s, compile_s
        Median CPU seconds, of three rounds at most: to build the model with redundancy check and
        consistent start, to derive and emit the C, and to compile it.
    lines
        Of the C file.
    call_s
        Median CPU seconds of a call of ``integrate`` with one step.
    us_per_step, spread
        Median CPU time of a step in µs, and the rounds' median deviation, relative.
    sweeps, newton_steps
        Mean iterations of a step; steps that dense or banded Newton had to finish.
    constraint_max, momentum_constraint_max, energy_error
        Largest |g| and |g_q H_p| over all steps, largest |H − H₀|/|H₀|.
    samples
        CPU seconds of every round of the run, for ``steps`` steps.
    """

    bodies: int
    coordinates: int
    constraints: int
    structured: bool
    model_s: float
    generate_s: float
    compile_s: float
    lines: int
    steps: int = 0
    us_per_step: float | None = None
    call_s: float | None = None
    spread: float | None = None
    sweeps: float | None = None
    newton_steps: int = 0
    constraint_max: float | None = None
    momentum_constraint_max: float | None = None
    energy_error: float | None = None
    samples: tuple[float, ...] = ()
    note: str = ""
    failed: bool = False

    @property
    def us_per_body(self) -> float | None:
        """µs of a step for each body."""
        return None if self.us_per_step is None else self.us_per_step / self.bodies

    @property
    def ns_per_body_and_sweep(self) -> float | None:
        """ns of a sweep for each body: what is left of the growth when sweeps are counted."""
        if self.us_per_body is None or not self.sweeps:
            return None
        return self.us_per_body / self.sweeps * 1e3

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self) | {"us_per_body": self.us_per_body,
                               "ns_per_body_and_sweep": self.ns_per_body_and_sweep}


@dataclass(frozen=True)
class _GeneratedChain:
    """A chain that is ready to run."""

    model: Model
    stepper: Stepper
    about: dict[str, Any]

    def run(self, steps: int) -> Trajectory:
        return self.stepper.integrate(self.model.q0, self.model.p0, dt=DT, steps=steps,
                                      every=steps, parameters=self.model.parameters)


def grow(
    counts: Sequence[int], steps: int, rounds: int, least: float,
    watch: Callable[[str], None] = lambda name: None,
) -> list[Size]:
    """Return a row for each number of bodies; runs of all sizes take turns."""
    _generated(build_chain(1))  # imports, tableau and compiler are not a matter of size
    made = []
    for count in counts:
        watch(f"chain of {count}: derive and compile")
        made.append(_make(count, min(rounds, 3)))
    watch(f"{len(made)} chains in turn, {rounds} rounds")
    reports: dict[str, dict[str, Any]] = {}
    jobs, times = {}, {}
    for one in made:
        name = one.model.name
        try:
            reports[name] = _report(one.run(steps)) | {"call_s": statistics.median(
                stopwatch(_job(one, 1)) for _ in range(5))}
            jobs[name], times[name] = repeated(_job(one, steps), least)
        except GyrosparkError as error:
            reports[name] = {"note": str(error), "failed": True}
    for name, sample in alternate(jobs, rounds).items():
        reports[name] |= _timed(sample, steps * times[name])
    return [Size(**one.about, **reports[one.model.name]) for one in made]


def laws(sizes: Sequence[Size]) -> dict[str, float]:
    """Return the slope of log(cost) against log(N) of each cost, from 8 bodies on.

    Fewer than three sizes give none.
    """
    fitted = {}
    for cost in _COSTS:
        points = [(s.bodies, y) for s in sizes
                  if s.bodies >= _LAW_FROM and (y := getattr(s, cost))]
        if len(points) >= 3:
            N, y = np.log(np.array(points, dtype=float)).T
            fitted[cost] = float(np.polyfit(N, y, 1)[0])
    return fitted


def _make(count: int, rounds: int) -> _GeneratedChain:
    seconds: dict[str, list[float]] = {"model_s": [], "generate_s": [], "compile_s": []}
    for _ in range(rounds):
        forget()
        start = time.process_time()
        model = build_chain(count)
        middle = time.process_time()
        made = _generated(model)
        end = time.process_time()
        seconds["model_s"].append(middle - start)
        seconds["generate_s"].append(end - middle)
        seconds["compile_s"].append(compile_seconds(made))
    files = made.source.files()
    text = files[f"{made.source.name}.c"]
    return _GeneratedChain(model, Stepper(made.source.name, files), {
        "bodies": count, "coordinates": model.system.n, "constraints": model.system.m,
        "structured": Structure(made.scheme.system).is_worthwhile,
        "lines": text.count("\n"),
        **{name: statistics.median(values) for name, values in seconds.items()}})


def _generated(model: Model) -> Generated:
    return generate(Spec.checked("G-L", STAGES), system=model.system)


def forget() -> None:
    """Empty what remembers expressions, so that a chain does not profit from the last one."""
    from sympy.core.cache import clear_cache

    clear_cache()
    derivative.cache_clear()


def compile_seconds(made: Generated) -> float:
    """Return the CPU seconds, cffi's and the compilers', of a module that is then thrown away."""
    start = with_children()
    with tempfile.TemporaryDirectory() as folder:
        compile_module(made.source.name, made.source.files(), find_compiler(), Path(folder))
    return with_children() - start


def _job(one: _GeneratedChain, steps: int) -> Callable[[], object]:
    return lambda: one.run(steps)


def _report(end: Trajectory) -> dict[str, Any]:
    report = end.report
    return {
        "sweeps": report.iterations_mean, "newton_steps": report.newton_steps,
        "constraint_max": report.constraint_max,
        "momentum_constraint_max": report.momentum_constraint_max,
        "energy_error": report.energy_error_max / abs(report.energy_start)}


def _timed(sample: Sample, steps: int) -> dict[str, Any]:
    return {"us_per_step": sample.median / steps * 1e6, "spread": sample.spread, "steps": steps,
            "samples": sample.seconds}
