"""exudyn and MuJoCo on the reference problems that are bodies on joints: error against cost.

    exudyn    trapezoidal rule of index 2 and generalised α, of order 2; a body on no joints by
              explicit Runge-Kutta methods too, of order 4 and 6, on its Lie group
    MuJoCo    RK4 and implicit, of order 4 and 1; loops are closed by soft constraints
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import partial
from typing import Any

from gyrospark.references import Reference, WorkPrecisionRun

from .peers import exudyn_scenes, mujoco_scenes
from .peers.optional import Unavailable
from .reference_scenes import SceneReference, scene_reference
from .scenes import ReferenceScene, SceneMotion
from .timing import stopwatch

__all__ = ["largest_error", "measure_bodies"]

Go = Callable[[], Mapping[str, SceneMotion]]
#: Steps and seconds → the function that runs them.
Prepare = Callable[[int, float], Go]

#: CPU seconds of a method's last run; the factor from run to run of its steps; most runs.
_DEAR, _FACTOR, _MOST = 0.5, 4, 6
#: An error that more steps do not reduce.
_ENOUGH = 1e-13


def measure_bodies(problem: Reference, *, rounds: int = 3, quick: bool = False,
                   watch: Callable[[str], None] = lambda text: None) -> Iterator[WorkPrecisionRun]:
    """Yield runs of a problem by exudyn and MuJoCo, from as many steps as our fewest on.

    Parameters
    ----------
    problem, rounds
        As in ``gs.references.measure``.
    quick : bool
        Two numbers of steps alone.
    watch : callable
        Receives a line for each problem, missing package and failed step.
    """
    try:
        scene = scene_reference(problem)
    except Unavailable as reason:
        watch(f"exudyn and MuJoCo are left out of {problem.name}: {reason}.")
        return
    for peer, ways in (("exudyn", _exudyn), ("MuJoCo", _mujoco)):
        watch(f"{problem.name}, {peer}")
        try:
            for scheme, prepare in ways(scene.scene):
                yield from _finer(problem, scene, peer, scheme, prepare, rounds,
                                  2 if quick else _MOST, watch)
        except Unavailable as missing:
            watch(f"{peer} is left out: {missing}.")


def _exudyn(scene: ReferenceScene) -> Iterator[tuple[str, Prepare]]:
    for methods, lie_group in ((exudyn_scenes.IMPLICIT, False), (exudyn_scenes.EXPLICIT, True)):
        if lie_group and scene.joints:
            continue  # explicit methods take no joints
        machine = exudyn_scenes.ExudynScene(scene, lie_group=lie_group)
        for method in methods:
            yield method, partial(_of_exudyn, machine, method)


def _of_exudyn(machine: exudyn_scenes.ExudynScene, method: str, steps: int, seconds: float) -> Go:
    return partial(machine.run, method, seconds, steps)


def _mujoco(scene: ReferenceScene) -> Iterator[tuple[str, Prepare]]:
    machine = mujoco_scenes.MujocoScene(scene)
    for integrator in mujoco_scenes.INTEGRATORS:
        yield integrator, partial(_of_mujoco, machine, integrator)


def _of_mujoco(
    machine: mujoco_scenes.MujocoScene, integrator: str, steps: int, seconds: float
) -> Go:
    return machine.prepare(integrator, seconds, steps)


def _finer(problem: Reference, scene: SceneReference, peer: str, scheme: str, prepare: Prepare,
           rounds: int,
           largest_count: int, watch: Callable[[str], None]) -> Iterator[WorkPrecisionRun]:
    """Yield runs with ever more steps; ``watch`` receives a line for one that fails."""
    steps = min(min(attempt.steps) for attempt in problem.attempts)
    for _ in range(largest_count):
        go, start = prepare(steps, float(problem.seconds)), time.thread_time()
        try:
            end = go()
        except Unavailable as failure:
            watch(f"{peer} with {steps} steps is left out of {problem.name}: {failure}.")
            error, cost = math.inf, time.thread_time() - start
        else:
            error, cost = _error(problem, scene, end), time.thread_time() - start
            if cost < _DEAR:
                cost = statistics.median([cost, *(stopwatch(go) for _ in range(rounds - 1))])
            yield WorkPrecisionRun(problem.name, scheme, steps, error, cost, {}, peer)
        if cost > _DEAR or error < _ENOUGH:
            return
        steps *= _FACTOR


def _error(problem: Reference, scene: SceneReference, end: Mapping[str, SceneMotion]) -> float:
    """Return how far the end of a run is from the truth, as ``Reference.error`` does for ours."""
    groups = scene.read(end)
    return max(largest_error(groups[group], [problem.truth.value(name) for name in names])
               for group, names in problem.groups.items())


def largest_error(computed: Sequence[Any], true: Sequence[Fraction]) -> float:
    """Return the largest difference of numbers, relative to the largest true one."""
    differences = [abs(Fraction(float(x)) - y) for x, y in zip(computed, true, strict=True)]
    return float(max(differences) / max(map(abs, true)))
