"""What derivatives cost over the run itself: ``make bench WHAT="gradients"``, its second table.

    top             in quaternions with γ, 3-G-L at 1 ms: several steps at once in lanes
    top, angles     in Euler's angles by its Lagrangian: one step after another
    chain of 8, 100 rods on ball joints, by element templates, at 2 ms

A gradient is by the adjoint, from a run that is there: its steps done again and kept, and a
cotangent of the end taken backwards. Tangents are along 1, 8 and 16 directions of the start,
together with the run. Deriving and compiling are of a new process with an empty cache.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from gyrospark.api import stepper
from gyrospark.generator.multibody.models import chain
from gyrospark.generator.systems.system import System
from gyrospark.runtime.derivatives.tangent_space import Tangents
from gyrospark.runtime.steppers.stepper import Stepper

from .timing import Sample, alternate, repeated
from .tops import INERTIA, MGL, parameters, tops

__all__ = ["COUNTS", "DerivativeCase", "DerivativeCost", "Motion", "build", "cases",
           "compare_derivatives"]

Array = NDArray[Any]

ROOT = Path(__file__).resolve().parents[1]
#: Directions of the start that tangents are taken along.
COUNTS = (1, 8, 16)


@dataclass(frozen=True)
class Motion:
    """A stepper, and the start of a run."""

    step: Stepper
    q: Array
    p: Array
    values: Mapping[str, float]


@dataclass(frozen=True)
class DerivativeCase:
    """What makes a motion, and how long a run of it is."""

    name: str
    make: Callable[[], Motion]
    dt: float
    steps: int


@dataclass(frozen=True)
class DerivativeCost:
    """Costs of one case.

    Attributes
    ----------
    primal, gradient
        CPU seconds of a run alone and of a gradient from it, in each round.
    tangents
        The same of a run with tangents, by the number of directions.
    derive, compile
        CPU seconds until the first run: model and derivation, and compilers.
    derive_more, compile_more
        The same of derivatives when they are first asked for; they derive the whole again.
    """

    case: str
    dt: float
    steps: int
    unknowns: int
    primal: tuple[float, ...] = ()
    gradient: tuple[float, ...] = ()
    tangents: Mapping[int, tuple[float, ...]] | None = None
    derive: float = 0.0
    compile: float = 0.0
    derive_more: float = 0.0
    compile_more: float = 0.0
    failed: bool = False

    @property
    def us_per_step(self) -> float:
        """CPU time of a step in µs."""
        return Sample(self.primal).median / self.steps * 1e6

    def over_primal(self, directions: int | None = None) -> float:
        """Return the cost of a gradient, or of a run with tangents, over that of the run."""
        seconds = self.gradient if directions is None else (self.tangents or {})[directions]
        return Sample(seconds).median / Sample(self.primal).median

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self)


def cases(*, quick: bool = False) -> list[DerivativeCase]:
    """Return the four; in a quick run the top with 100 steps."""
    found = [DerivativeCase("top", _top, 1e-3, 100 if quick else 2000)]
    if quick:
        return found
    return [*found, DerivativeCase("top, angles", _in_angles, 1e-3, 2000),
            DerivativeCase("chain of 8", partial(_chain, 8), 2e-3, 200),
            DerivativeCase("chain of 100", partial(_chain, 100), 2e-3, 20)]


def _top() -> Motion:
    step, top = stepper("G-L", 3, "gamma"), tops()[0]
    return Motion(step, *step.project(top.q, top.p, parameters=parameters()), parameters())


def _in_angles() -> Motion:
    q, v = sp.symbols("phi theta psi"), sp.symbols("dphi dtheta dpsi")
    I1, I3, mgl = sp.symbols("I1 I3 mgl", positive=True)
    kinetic = (I1 * (v[1]**2 + v[0]**2 * sp.sin(q[1])**2)
               + I3 * (v[2] + v[0] * sp.cos(q[1]))**2) / 2
    step = stepper("G-L", 3, system=System.from_lagrangian(
        kinetic - mgl * sp.cos(q[1]), q, v, [I1, I3, mgl], name="top_in_angles"))
    start = np.array([0.0, math.pi / 6, 0.0])
    values = {"I1": INERTIA[0], "I3": INERTIA[2], "mgl": MGL}
    return Motion(step, start, step.momenta(start, [0, 0, 40 * math.pi], parameters=values), values)


def _chain(rods: int) -> Motion:
    model = chain(rods)
    step = stepper("G-L", 3, system=model)
    return Motion(step, *step.project(model.q0, model.p0, parameters=model.parameters),
                  model.parameters)


def compare_derivatives(
    chosen: Sequence[DerivativeCase], rounds: int, least: float,
    watch: Callable[[str], None] = lambda name: None,
) -> list[DerivativeCost]:
    """Return the costs of each case."""
    found = []
    for case in chosen:
        watch(f"{case.name}: derive and compile")
        derive, derive_more, compiling, compiling_more = _build_in_new_process(case.name)
        motion = case.make()
        row = DerivativeCost(case.name, case.dt, case.steps, motion.step.unknowns, derive=derive,
                             compile=compiling, derive_more=derive_more,
                             compile_more=compiling_more)
        watch(f"{case.name}: run, gradient, tangents")
        found.append(_timed(row, motion, rounds, least))
    return found


def _timed(row: DerivativeCost, motion: Motion, rounds: int, least: float) -> DerivativeCost:
    step, q, p = motion.step, motion.q, motion.p
    given: dict[str, Any] = {"dt": row.dt, "steps": row.steps, "every": row.steps,
                             "parameters": motion.values}
    random = np.random.default_rng(1)
    run = step.integrate(q, p, **given)
    ends = {"q": random.normal(size=step.n), "p": random.normal(size=step.n)}
    jobs: dict[str, Callable[[], object]] = {
        "primal": partial(step.integrate, q, p, **given),
        "gradient": partial(step.gradient, run, ends)}
    for count in COUNTS:
        along = Tangents(random.normal(size=(2 * step.n, count)), project=True)
        jobs[f"tangents {count}"] = partial(step.integrate, q, p, **given, tangents=along)
    often = {name: repeated(job, least) for name, job in jobs.items()}
    samples = {name: sample.per(often[name][1]).seconds for name, sample in alternate(
        {name: job for name, (job, _) in often.items()}, rounds).items()}
    return replace(row, primal=samples["primal"], gradient=samples["gradient"],
                   tangents={count: samples[f"tangents {count}"] for count in COUNTS})


def _seconds() -> tuple[float, float]:
    """Return the CPU seconds of this process, and of those it has waited for."""
    used = os.times()
    return time.process_time(), used.children_user + used.children_system


def _build_in_new_process(name: str) -> list[float]:
    """Return the CPU seconds of ``build`` where nothing is derived or compiled yet."""
    with TemporaryDirectory() as folder:
        done = subprocess.run(
            [sys.executable, "-m", "benchmarks.derivative_cost", name], check=True,
            capture_output=True, text=True, cwd=ROOT, env={**os.environ, "GYROSPARK_CACHE": folder})
    seconds: list[float] = json.loads(done.stdout)
    return seconds


def build(case: DerivativeCase) -> list[float]:
    """Return CPU seconds by this process for a stepper, for its derivatives; by compilers."""
    begin = _seconds()
    step = case.make().step
    middle = _seconds()
    step.derivative_binding()  # derives and compiles
    end = _seconds()
    return [middle[0] - begin[0], end[0] - middle[0], middle[1] - begin[1], end[1] - middle[1]]


if __name__ == "__main__":
    print(json.dumps(build(next(case for case in cases() if case.name == sys.argv[1]))))
