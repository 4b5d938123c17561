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
import textwrap
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gyrospark.core.errors import StepFailed
from gyrospark.core.registry import MODELS

from .peers import exudyn_scenes, mujoco_scenes, pinocchio_scenes
from .peers.mujoco_files import MujocoFile
from .peers.optional import Unavailable, version
from .reference_scenes import andrews_released
from .robot_files import conservative_text, model_of
from .scenes import Array, ReferenceScene, SceneMotion, bodies_of, scene_of

if TYPE_CHECKING:
    from gyrospark.generator.multibody.model import Model
    from gyrospark.runtime.steppers.stepper import Stepper

__all__ = ["MECHANISMS", "LongRun", "Mechanism", "long_runs_page", "measure_long_runs"]

#: States that are looked at, evenly over a run.
SAMPLES = 100
#: Steps of the shorter run whose end is compared.
COMPARED = 1000
#: CPU seconds of a run; a program that needs more takes fewer steps.
MOST_SECONDS = 60.0
#: Pieces of a run: how the bodies move at the end of each.
Pieces = Callable[[int, int], Iterator[Mapping[str, SceneMotion] | tuple[Array, Array]]]


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Bodies on joints that programs run.

    Attributes
    ----------
    name, title : str
    source : str
        Where it is from, in Markdown.
    make : callable
        Returns the model.
    dt : float
        Of a step, in s.
    mjcf : str
        The text that it was read from, for MuJoCo alone.
    """

    name: str
    title: str
    source: str
    make: Callable[[], Model]
    dt: float = 1e-3
    mjcf: str = ""

    @classmethod
    def of_file(cls, path: Path) -> Mechanism:
        """Return the robot of an MJCF file, in steps of a tenth of the file's.

        Raises
        ------
        InputError
            For a file that cannot be used.
        """
        text = conservative_text(path)
        model = model_of(path, text)
        assert model.dt is not None
        title, source = _FILES.get(model.name, (model.name, f"`{path.name}`"))
        return cls(path.stem, title, source, lambda: model, model.dt / 10, text)

    @cached_property
    def scene(self) -> ReferenceScene:
        """Its bodies and joints, and the model; of a file its bodies alone."""
        model = self.make().in_type(float)
        if self.mjcf:
            return ReferenceScene(model.name, model, np.zeros(3), bodies_of(model))
        return scene_of(model)

    @cached_property
    def _steppers(self) -> dict[int, Stepper]:
        return {}

    def stepper(self, stages: int) -> Stepper:
        """Return our G-L of some stages."""
        from gyrospark.api import stepper

        if stages not in self._steppers:
            self._steppers[stages] = stepper("G-L", stages, system=self.scene.model)
        return self._steppers[stages]


def _of_models(name: str, title: str) -> Mechanism:
    return Mechanism(name, title, f"`gs.models.{name}()`", MODELS[name].make)


_MENAGERIE = "https://github.com/google-deepmind/mujoco_menagerie/blob/main"
#: Name of a model in MJCF → title and source.
_FILES = {name: (title, f"[{path}]({_MENAGERIE}/{path}) of MuJoCo Menagerie{more}")
          for name, title, path, more in (
    ("cassie", "Cassie", "agility_cassie/cassie.xml", ", hung by its pelvis, four loops"),
    ("robotiq_2f85", "Robotiq 2F-85", "robotiq_2f85/2f85.xml", ", two loops and a coupling"))}
#: Name → mechanism.
MECHANISMS = {mechanism.name: mechanism for mechanism in (
    _of_models("four_bar", "Four-bar linkage"),
    _of_models("delta_robot", "Delta robot on springs"),
    _of_models("stewart_platform", "Stewart platform on springs"),
    Mechanism("andrews", "Andrews' squeezing mechanism",
              "Seven bodies on ten hinges with the numbers of "
              "[examples/andrews.py](../examples/andrews.py). They start at the "
              "[reference solution](references.md) at t = 0.03 s, where the crank has 1140 rad/s, "
              "and the torque is 0 from then on",
              andrews_released, dt=5e-5))}


@dataclass(frozen=True)
class LongRun:
    """What a program does with a mechanism.

    Attributes
    ----------
    mechanism, program, method : str
    dt : float
        Of a step, in s.
    steps : int
        Fewer than asked for where they take too long.
    cpu_seconds : float
        Of a step.
    constraint, energy : float
        Largest \\|g\\| (m, and 1 for directions) and \\|H − H₀\\| (J) over ``SAMPLES`` states.
    drift : sequence of float
        \\|H − H₀\\| at each of these states.
    error : float
        Largest distance in m of a body's origin from where it is after ``COMPARED`` steps.
    note : str
        Why it ended early.
    """

    mechanism: str
    program: str
    method: str
    dt: float
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
    mechanism: Mechanism, *, steps: int = 1_000_000, stages: Sequence[int] = (2, 3),
    peers: bool = False, watch: Callable[[str], None] = lambda text: None,
) -> Iterator[LongRun]:
    """Yield the runs of a mechanism.

    Parameters
    ----------
    steps : int
        Of the mechanism's ``dt`` each.
    stages : sequence of int
        Stages of the G-L runs; errors refer to the last of them with a fifth of the step.
    peers : bool
        Other programs too, of those that are installed.
    watch : callable
        Is told what is at work, and what is left out.
    """
    true = _true_end(mechanism, stages[-1])
    follow = partial(_followed, mechanism, true, steps)
    for s in stages:
        watch(f"{mechanism.name}, {s}-G-L")
        yield follow("gyrospark", f"{s}-G-L", partial(_ours, mechanism, s))
    if not peers:
        return
    for program, ways in _PROGRAMS.items():
        if mechanism.mjcf and program != "MuJoCo":
            continue
        try:
            for method, pieces in ways(mechanism):
                watch(f"{mechanism.name}, {program} {method}")
                yield follow(f"{program} {version(_PACKAGES[program])}", method, pieces)
        except Unavailable as missing:
            watch(f"{program} is left out of {mechanism.name}: {missing}.")


_PACKAGES = {"MuJoCo": "mujoco", "exudyn": "exudyn", "Pinocchio": "pin"}


# ---------------------------------------------------------------- programs


def _ours(mechanism: Mechanism, stages: int, steps: int, count: int) -> Iterator[Any]:
    """Yield (q, p); a run is one run, whose compensated sums go on from piece to piece."""
    model, step = mechanism.scene.model, mechanism.stepper(stages)
    sim = step.start(model.q0, model.p0, dt=mechanism.dt, parameters=model.parameters)
    for _ in range(count):
        sim.advance(steps)
        yield np.array(sim.q), np.array(sim.p)


def _mujoco(mechanism: Mechanism) -> Iterator[tuple[str, Pieces]]:
    machine = (MujocoFile(mechanism.mjcf, mechanism.scene) if mechanism.mjcf
               else mujoco_scenes.MujocoScene(mechanism.scene))
    for method in ("Euler", "implicitfast", "implicit", "RK4"):
        yield method, partial(machine.pieces, method, mechanism.dt)


def _exudyn(mechanism: Mechanism) -> Iterator[tuple[str, Pieces]]:
    machine = exudyn_scenes.ExudynScene(mechanism.scene)
    for method in exudyn_scenes.IMPLICIT:
        yield method, partial(machine.pieces, method, mechanism.dt)


def _pinocchio(mechanism: Mechanism) -> Iterator[tuple[str, Pieces]]:
    machine = pinocchio_scenes.PinocchioScene(mechanism.scene)
    yield "Euler, Baumgarte", partial(machine.pieces, mechanism.dt)


_PROGRAMS = {"MuJoCo": _mujoco, "exudyn": _exudyn, "Pinocchio": _pinocchio}


# ---------------------------------------------------------------- what is measured


def _followed(mechanism: Mechanism, true: Mapping[str, Array], steps: int,
              program: str, method: str, pieces: Any) -> LongRun:
    scene, step = mechanism.scene, mechanism.stepper(2)
    model = scene.model
    end, cpu = _compared(scene, pieces)
    error = max(float(np.linalg.norm(end[name] - at)) for name, at in true.items())
    steps = min(steps, max(COMPARED, int(MOST_SECONDS / cpu) * COMPARED))
    piece, drift, constraint, note = max(1, steps // SAMPLES), [], 0.0, ""
    energy = step.energy(model.q0, model.p0, parameters=model.parameters)
    start = time.thread_time()
    spent, done = 0.0, 0
    try:
        for found in pieces(piece, min(SAMPLES, steps)):
            spent += time.thread_time() - start
            done += piece
            q, p = _state(scene, found)
            g, _ = step.defects(q, p, parameters=model.parameters)
            drift.append(abs(float(step.energy(q, p, parameters=model.parameters) - energy)))
            constraint = max(constraint, float(np.abs(g).max()))
            start = time.thread_time()
    except (Unavailable, StepFailed) as failure:
        note = str(failure).partition(". ")[0]
    return LongRun(mechanism.name, program, method, mechanism.dt, done, spent / max(done, 1),
                   constraint, max(drift, default=math.inf), tuple(drift), error, note)


def _compared(scene: ReferenceScene, pieces: Any) -> tuple[dict[str, Array], float]:
    """Return where the bodies are after ``COMPARED`` steps, and their CPU seconds."""
    start = time.thread_time()
    (found,) = pieces(COMPARED, 1)
    return _places(scene, found), time.thread_time() - start


def _true_end(mechanism: Mechanism, stages: int) -> dict[str, Array]:
    """Return where the bodies are after ``COMPARED`` steps, by G-L in steps of a fifth."""
    model, parts = mechanism.scene.model, 5 * COMPARED
    run = mechanism.stepper(stages).integrate(
        model.q0, model.p0, dt=mechanism.dt / 5, steps=parts, every=parts,
        parameters=model.parameters)
    return _places(mechanism.scene, (run.q[-1], run.p[-1]))


def _places(scene: ReferenceScene, found: Any) -> dict[str, Array]:
    q, _ = _state(scene, found)
    places = {x: i for i, x in enumerate(scene.model.system.q)}
    return {at.name: q[[places[x] for x in at.x]] for at in scene.model.system.bodies}


def _state(scene: ReferenceScene, found: Any) -> tuple[Array, Array]:
    if isinstance(found, tuple):
        return found
    end = scene.end(found)
    return end.q[0], end.p[0]


# ---------------------------------------------------------------- the page

_HEAD = """# Mechanisms with closed loops over many steps

The constraints, the energy, the error and the cost of one step, of gyrospark and of programs that
robots are simulated with. This command writes the page:

```
make bench WHAT="robots --mjcf cassie.xml --mjcf 2f85.xml --out docs"
```

Each program receives the bodies, joints, springs and gravity of a model, without friction, damping,
contact and motors. The two files, `agility_cassie/cassie.xml` and `robotiq_2f85/2f85.xml`, are of
[MuJoCo Menagerie](https://github.com/google-deepmind/mujoco_menagerie), which gyrospark does not
contain; their meshes are not needed. Any other MJCF file of one robot with `<inertial>` elements
may follow `--mjcf`; its base is held, it starts at its first keyframe, and steps are a tenth of its
`timestep`.

Constraints and energy are evaluated by the equations of the model at 100 states of each run, for
all programs alike: the largest abs(g) in m (of directions without unit), and the largest deviation
of H. The error is the largest distance of a body after 1000 steps from its position by 3-stage
Gauss-Lobatto in steps of a fifth. Times are CPU seconds of one run on a machine that also does
other work. Runs that would take more than a minute have fewer steps.

MuJoCo closes loops by soft constraints, at their largest stiffness for the time step, and exudyn by
multipliers. Pinocchio has no integrator: here semi-implicit Euler in Python, with Baumgarte's
stabilization of five steps, so that its time is that of Python. A file runs in gyrospark and
MuJoCo. As joints of files have no limits here, linkages pass close to singular
configurations, where the energy of our runs deviates in jumps: at the two largest jumps
of the 2F-85 in its first 24 s the smallest singular value of its constraint Jacobian, with rows of
length one, is a third of the median.

These commands show a model, and a file:

```
gyrospark run delta_robot --view delta.html
gyrospark run cassie.xml --set ignore=all --set keyframe=home --view cassie.html
```
"""


def long_runs_page(measured: Mapping[Mechanism, Sequence[LongRun]], picture: str = "") -> str:
    """Return the page of all mechanisms, with a picture of a file name."""
    parts = [_HEAD]
    if picture:
        alternative = "Deviation of the energy over time, a panel for a mechanism"
        parts.append(f"![{alternative}]({picture})\n")
    for mechanism, runs in measured.items():
        told = f"{mechanism.source}; steps of {mechanism.dt * 1e3:g} ms."
        parts += [f"## {mechanism.title}\n", textwrap.fill(
            told, 100, break_on_hyphens=False, break_long_words=False) + "\n"]
        parts.append("| program | steps | µs a step | constraints | energy (J) | error (m) |\n"
                     "| --- | --- | --- | --- | --- | --- |\n" + "".join(
            f"| {run.name} | {run.steps:,} | {run.cpu_seconds * 1e6:.3g} | {run.constraint:.0e} "
            f"| {run.energy:.0e} | {run.error:.0e} |\n" for run in runs))
        parts += [f"{run.name}: {run.note}.\n" for run in runs if run.note]
    return "\n".join(parts)
