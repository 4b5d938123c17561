"""Error against cost: each attempt at a problem, run and timed."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from ..api import stepper
from ..core.arguments import as_flag, shown
from ..core.errors import InputError
from ..runtime.bindings.array_checks import as_positive_count
from ..runtime.bindings.real_numbers import rounding
from .problem import Reference

if TYPE_CHECKING:
    from ..core.real_types import RealName
    from ..generator.multibody.model import Model
    from ..runtime.results.trajectory import Trajectory
    from ..runtime.steppers.stepper import Stepper

__all__ = ["LIMIT", "WorkPrecisionRun", "measure", "run_once"]

#: Error that at least one of our schemes must reach.
LIMIT = 1e-12


@dataclass(frozen=True)
class WorkPrecisionRun:
    """One run of a problem.

    Attributes
    ----------
    name, scheme : str
        Names of the problem, and of the scheme with its stages.
    steps : int
        Number of steps to the time of comparison.
    error : float
        Error at the end, relative to the largest number of its kind.
    cpu_seconds : float
        CPU time of this thread in s, the median of the rounds; the stepper is compiled before.
    invariants : mapping of str to float
        Largest error of energy (or of its balance) and of the constraints over all steps, and the
        change of each other invariant from start to end.
    peer : str
        The program that ran it, "" for gyrospark.
    """

    name: str
    scheme: str
    steps: int
    error: float
    cpu_seconds: float
    invariants: dict[str, float]
    peer: str = ""

    @property
    def label(self) -> str:
        """As in tables: ``3-G-L``, ``heyoka Taylor, 1e-12``."""
        return f"{self.peer} {self.scheme}".strip()

    def as_dict(self) -> dict[str, Any]:
        """Return the run for JSON."""
        return asdict(self)


def measure(problem: Reference, *, rounds: int = 3, quick: bool = False,
            watch: Callable[[str], None] = lambda text: None) -> Iterator[WorkPrecisionRun]:
    """Yield a run for each scheme of a problem and each number of steps.

    Parameters
    ----------
    problem : Reference
        As ``reference(name)`` returns it.
    rounds : int
        Timed runs of each.
    quick : bool
        The first scheme of the problem alone.
    watch : callable
        Called with the name of each attempt before it runs.

    Raises
    ------
    StepFailed, CompilerError
    InputError
        For what is no problem, and for less than one round.
    """
    if not isinstance(problem, Reference):
        raise InputError(f"problem = {shown(problem)} is no problem; give that of "
                         "gyrospark.references.reference(name).")
    as_flag("quick", quick)
    rounds = as_positive_count("rounds", rounds, 1)
    # the exact numbers of the model are rounded once; their double arithmetic would add errors
    model = problem.make().in_type(rounding("double"))
    for attempt in problem.attempts[:1] if quick else problem.attempts:
        watch(f"{problem.name}, {attempt.name}")
        step = stepper(attempt.scheme, attempt.stages, system=model.system)
        for steps in attempt.steps:
            seconds = []  # other programs take time from a round; the median leaves these out
            for _ in range(rounds):
                start = time.thread_time()
                run = run_once(problem, step, model, steps)
                seconds.append(time.thread_time() - start)
            yield WorkPrecisionRun(problem.name, attempt.name, steps, problem.error(run),
                                   statistics.median(seconds), _invariants(problem, run))


def run_once(problem: Reference, step: Stepper, model: Model, steps: int,
             real: RealName = "double") -> Trajectory:
    """Return the start and the end of a run to the time of comparison.

    dt = seconds/steps is rounded once, from a fraction to the type ``real`` of the stepper.
    """
    parameters = dict(model.parameters)
    dt = rounding(real)(Fraction(problem.seconds) / steps)
    return step.integrate(model.q0, model.p0, dt=dt, steps=steps, every=steps,
                          parameters=parameters)


def _invariants(problem: Reference, run: Trajectory) -> dict[str, float]:
    """Return the largest energy and constraint errors, and the change of each integral over a run.
    """
    errors = {"energy": float(run.report.energy_error_max),
              "constraints": float(run.report.constraint_max)}
    invariants = {name: run.quantity(name) for name in problem.invariants if name in run.quantities}
    return errors | {name: abs(float(quantity[-1] - quantity[0]))
                     for name, quantity in invariants.items()}
