"""Mechanisms with closed loops over many steps: constraints, energy, error and cost of programs.

    gyrospark    G-L with 2 and 3 stages
    MuJoCo       its four integrators; loops closed by its soft constraints, at their stiffest
    exudyn       trapezoidal rule of index 2, generalised α
    Pinocchio    semi-implicit Euler, loops by multipliers with Baumgarte's stabilisation

Each program gets bodies, joints, springs and gravity of a model. What it returns becomes states of
the model, whose constraints and energy are evaluated by one and the same code for all.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.registry import MODELS
from .peers import exudyn_scenes, mujoco_scenes, pinocchio_scenes
from .peers.optional import Unavailable, version
from .scenes import Array, ReferenceScene, SceneMotion, scene_of

if TYPE_CHECKING:
    from ..runtime.steppers.stepper import Stepper

__all__ = ["MECHANISMS", "LongRun", "long_runs_page", "measure_long_runs"]

#: Models of ``gs.models`` → titles.
MECHANISMS = {"four_bar": "Four-bar linkage", "delta_robot": "Delta robot on springs",
              "stewart_platform": "Stewart platform on springs"}
#: Seconds of a step, of all programs, and of the shorter run whose end is compared.
DT, COMPARED = 1e-3, 1.0
#: States that are looked at, evenly over a run.
SAMPLES = 100
#: Pieces of a run: how the bodies move at the end of each.
Pieces = Callable[[int, int], Iterator[Mapping[str, SceneMotion]]]


@dataclass(frozen=True)
class LongRun:
    """What a program does with a mechanism.

    Attributes
    ----------
    mechanism, program, method : str
    steps : int
        Of ``DT`` seconds; fewer than asked for where they take too long.
    cpu_seconds : float
        Of a step.
    constraint, energy : float
        Largest \\|g\\| (m, and 1 for directions) and \\|H − H₀\\| (J) over ``SAMPLES`` states.
    drift : sequence of float
        \\|H − H₀\\| at each of these states.
    error : float
        Largest distance in m of a body's origin from where it is at ``COMPARED`` seconds.
    note : str
        Why it ended early.
    """

    mechanism: str
    program: str
    method: str
    steps: int
    cpu_seconds: float
    constraint: float
    energy: float
    drift: Sequence[float]
    error: float
    note: str = ""

    @property
    def name(self) -> str:
        """Program and method."""
        return f"{self.program} {self.method}"

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self)


def measure_long_runs(
    mechanism: str, *, steps: int = 1_000_000, stages: Sequence[int] = (2, 3),
    peers: bool = False, most_seconds: float = 60.0,
    watch: Callable[[str], None] = lambda text: None,
) -> Iterator[LongRun]:
    """Yield the runs of one of ``MECHANISMS``.

    Parameters
    ----------
    steps : int
        Of ``DT`` seconds each.
    stages : sequence of int
        Of our G-L; ends are compared with that of the last, in steps of a fifth.
    peers : bool
        Other programs too, of those that are installed.
    most_seconds : float
        CPU seconds of a run; a program that needs more takes fewer steps.
    watch : callable
        Is told what is at work, and what is left out.
    """
    scene = _scene(mechanism)
    follow = partial(_followed, scene, _true_end(mechanism, stages[-1]), steps, most_seconds)
    for s in stages:
        watch(f"{mechanism}, {s}-G-L")
        yield follow("gyrospark", f"{s}-G-L", partial(_ours, scene, s))
    if not peers:
        return
    for program, ways in (("MuJoCo", _mujoco), ("exudyn", _exudyn), ("Pinocchio", _pinocchio)):
        try:
            for method, pieces in ways(scene):
                watch(f"{mechanism}, {program} {method}")
                yield follow(f"{program} {version(_PACKAGES[program])}", method, pieces)
        except Unavailable as missing:
            watch(f"{program} is left out of {mechanism}: {missing}.")


_PACKAGES = {"MuJoCo": "mujoco", "exudyn": "exudyn", "Pinocchio": "pin"}


# ---------------------------------------------------------------- programs


@cache
def _scene(mechanism: str) -> ReferenceScene:
    return scene_of(MODELS[mechanism].make())


@cache
def _stepper(mechanism: str, stages: int) -> Stepper:
    from ..api import stepper

    return stepper("G-L", stages, system=_scene(mechanism).model)


def _ours(scene: ReferenceScene, stages: int, steps: int, count: int) -> Iterator[Any]:
    """Yield (q, p); a run is one run, whose compensated sums go on from piece to piece."""
    model, step = scene.model, _stepper(scene.name, stages)
    sim = step.start(model.q0, model.p0, dt=DT, parameters=model.parameters)
    for _ in range(count):
        sim.advance(steps)
        yield np.array(sim.q), np.array(sim.p)


def _mujoco(scene: ReferenceScene) -> Iterator[tuple[str, Pieces]]:
    machine = mujoco_scenes.MujocoScene(scene)
    for method in ("Euler", "implicitfast", "implicit", "RK4"):
        yield method, partial(machine.pieces, method, DT)


def _exudyn(scene: ReferenceScene) -> Iterator[tuple[str, Pieces]]:
    machine = exudyn_scenes.ExudynScene(scene)
    for method in exudyn_scenes.IMPLICIT:
        yield method, partial(machine.pieces, method, DT)


def _pinocchio(scene: ReferenceScene) -> Iterator[tuple[str, Pieces]]:
    yield "Euler, Baumgarte", partial(pinocchio_scenes.PinocchioScene(scene).pieces, DT)


# ---------------------------------------------------------------- what is measured


def _followed(scene: ReferenceScene, true: Mapping[str, Array], steps: int, most_seconds: float,
              program: str, method: str, pieces: Any) -> LongRun:
    end, cpu = _compared(scene, pieces)
    error = max(float(np.linalg.norm(end[name] - at)) for name, at in true.items())
    trial = round(COMPARED / DT)
    steps = min(steps, max(trial, int(most_seconds / cpu) * trial))
    piece, drift, constraint, note = max(1, steps // SAMPLES), [], 0.0, ""
    energy = _energy(scene, *_at_start(scene))
    start = time.thread_time()
    spent, done = 0.0, 0
    try:
        for found in pieces(piece, min(SAMPLES, steps)):
            spent += time.thread_time() - start
            done += piece
            q, p = _state(scene, found)
            g, _ = _stepper(scene.name, 2).defects(q, p, parameters=scene.model.parameters)
            drift.append(abs(_energy(scene, q, p) - energy))
            constraint = max(constraint, float(np.abs(g).max()))
            start = time.thread_time()
    except Unavailable as failure:
        note = str(failure)
    return LongRun(scene.name, program, method, done, spent / max(done, 1), constraint,
                   max(drift, default=math.inf), tuple(drift), error, note)


def _compared(scene: ReferenceScene, pieces: Any) -> tuple[dict[str, Array], float]:
    """Return where the bodies are at ``COMPARED`` seconds, and the CPU seconds it takes."""
    start = time.thread_time()
    (found,) = pieces(round(COMPARED / DT), 1)
    return _places(scene, found), time.thread_time() - start


@cache
def _true_end(mechanism: str, stages: int) -> dict[str, Array]:
    """Return where the bodies are at ``COMPARED`` seconds, by G-L in steps of a fifth."""
    scene = _scene(mechanism)
    step, model, parts = _stepper(mechanism, stages), scene.model, 5 * round(COMPARED / DT)
    run = step.integrate(model.q0, model.p0, dt=COMPARED / parts, steps=parts, every=parts,
                         parameters=model.parameters)
    return _places(scene, (run.q[-1], run.p[-1]))


def _places(scene: ReferenceScene, found: Any) -> dict[str, Array]:
    q, _ = _state(scene, found)
    places = {x: i for i, x in enumerate(scene.model.system.q)}
    return {at.name: q[[places[x] for x in at.x]] for at in scene.model.system.bodies}


def _state(scene: ReferenceScene, found: Any) -> tuple[Array, Array]:
    if isinstance(found, tuple):
        return found
    end = scene.end(found)
    return end.q[0], end.p[0]


def _at_start(scene: ReferenceScene) -> tuple[Array, Array]:
    return np.asarray(scene.model.q0, dtype=float), np.asarray(scene.model.p0, dtype=float)


def _energy(scene: ReferenceScene, q: Array, p: Array) -> float:
    return float(_stepper(scene.name, 2).energy(q, p, parameters=scene.model.parameters))


# ---------------------------------------------------------------- the page

_HEAD = """# Mechanisms with closed loops over many steps

`gyrospark reference robots --peers --out docs/reference_robots.md --plot docs/reference_robots.png`
writes this page: the constraints, the energy, the error and the cost of one step, of gyrospark and
of programs that robots are simulated with. Each receives the bodies, joints, springs and gravity of
a model of `gs.models`, without friction, damping, contact and motors, and takes steps of 1 ms.

Constraints and energy are evaluated by the equations of the model at 100 states of each run, for
all programs alike: the largest abs(g) in m (of directions without unit), and the largest deviation
of H. The error is the largest distance of a body from its position after 1 s by 3-stage
Gauss-Lobatto in steps of 0.2 ms. Times are CPU seconds of one run on a machine that does other work
too. Runs of a program that would take more than a minute have fewer steps.

MuJoCo closes loops by soft constraints, at their largest stiffness for the time step, and exudyn by
multipliers. Pinocchio has no integrator: here semi-implicit Euler in Python, with Baumgarte's
stabilization of five steps, so that its time is that of Python.

`gs.models.four_bar()`, `gs.models.delta_robot()` and `gs.models.stewart_platform()` are the models;
`gyrospark run delta_robot --view delta.html` shows one.
"""


def long_runs_page(measured: Mapping[str, Sequence[LongRun]], picture: str = "") -> str:
    """Return the page of all mechanisms, with a picture of a file name."""
    parts = [_HEAD]
    if picture:
        alternative = "Deviation of the energy over time, a panel for each mechanism"
        parts.append(f"![{alternative}]({picture})\n")
    for mechanism, runs in measured.items():
        parts.append(f"## {MECHANISMS[mechanism]}\n\n`gs.models.{mechanism}()`\n")
        parts.append("| program | steps | µs a step | constraints | energy (J) | error (m) |\n"
                     "| --- | --- | --- | --- | --- | --- |\n" + "".join(
            f"| {run.name} | {run.steps:,} | {run.cpu_seconds * 1e6:.3g} | {run.constraint:.0e} "
            f"| {run.energy:.0e} | {run.error:.0e} |\n" for run in runs))
        parts += [f"{run.name}: {run.note}.\n" for run in runs if run.note]
    return "\n".join(parts)
