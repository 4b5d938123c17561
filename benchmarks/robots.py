"""Mechanisms with closed loops over many steps: constraints, energy, error and cost of programs.

    gyrospark    G-L with 2 and 3 stages
    MuJoCo       its four integrators; loops closed by its soft constraints, at their stiffest
    exudyn       trapezoidal rule of index 2, generalised α
    Pinocchio    semi-implicit Euler, loops by multipliers with Baumgarte's stabilisation

Each program gets bodies, joints, springs and gravity of a model. The motions that it returns become
states of the model, whose constraints and energy are evaluated by the same code for all.
"""

from __future__ import annotations

import math
import textwrap
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree

import numpy as np

import gyrospark as gs

from .attitudes import Array
from .peers import exudyn_scenes, mujoco_scenes, pinocchio_scenes
from .peers.mujoco_files import MujocoFile
from .peers.optional import Unavailable, need, version
from .reference_scenes import andrews_released
from .rows import Choice, Row, markdown, text_of
from .scenes import ReferenceScene, SceneMotion, bodies_of, scene_of

__all__ = ["MECHANISMS", "Mechanism", "conservative_text", "draw_drift", "page", "robots", "runs"]

#: States that are measured, evenly over a run.
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
        The MJCF that the model was read from, for MuJoCo alone.
    """

    name: str
    title: str
    source: str
    make: Callable[[], gs.Model]
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
        with TemporaryDirectory() as folder:
            file = Path(folder) / path.name
            file.write_text(text, encoding="utf-8")
            keyframe = ElementTree.fromstring(text).find("keyframe/key")
            model = gs.Multibody.from_file(
                file, keyframe=None if keyframe is None else 0).model(redundant="leave out")
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
    def _steppers(self) -> dict[int, gs.Stepper]:
        return {}

    def stepper(self, stages: int) -> gs.Stepper:
        """Return our G-L of some stages."""
        if stages not in self._steppers:
            self._steppers[stages] = gs.stepper("G-L", stages, system=self.scene.model)
        return self._steppers[stages]


def _of_models(name: str, title: str) -> Mechanism:
    return Mechanism(name, title, f"`gs.models.{name}()`", getattr(gs.models, name))


_MENAGERIE = "https://github.com/google-deepmind/mujoco_menagerie/blob/main"
#: Name of a model in MJCF → title and source.
_FILES = {name: (title, f"[{path}]({_MENAGERIE}/{path}) of MuJoCo Menagerie{detail}")
          for name, title, path, detail in (
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


def robots(choice: Choice) -> list[Row]:
    """Return the runs of all mechanisms, and of the robots of files."""
    steps = 1000 if choice.quick else 1_000_000
    return [row for mechanism in mechanisms(choice) for row in runs(mechanism, choice, steps)]


def mechanisms(choice: Choice) -> list[Mechanism]:
    """Return the mechanisms that are chosen."""
    selected = [mechanism for mechanism in MECHANISMS.values() if choice.only in mechanism.name]
    return [*selected, *map(Mechanism.of_file, choice.mjcf)]


def runs(mechanism: Mechanism, choice: Choice, steps: int, stages: Sequence[int] = (2, 3)
         ) -> Iterator[Row]:
    """Yield the runs of a mechanism in ``steps`` steps; errors refer to the last of ``stages``."""
    true = _true_end(mechanism, stages[-1])
    follow = partial(_followed, mechanism, true, steps)
    for s in stages:
        choice.watch(f"{mechanism.name}, {s}-G-L")
        yield follow("gyrospark", f"{s}-G-L", partial(_ours, mechanism, s))
    for program, ways in _PROGRAMS.items():
        package = _PACKAGES[program]
        if package not in choice.programs or (mechanism.mjcf and program != "MuJoCo"):
            continue
        try:
            for method, pieces in ways(mechanism):
                choice.watch(f"{mechanism.name}, {program} {method}")
                yield follow(f"{program} {version(package)}", method, pieces)
        except Unavailable as missing:
            yield Row(mechanism.name, program, "", note=str(missing))


_PACKAGES = {"MuJoCo": "mujoco", "exudyn": "exudyn", "Pinocchio": "pin"}


# ---------------------------------------------------------------- programs


def _ours(mechanism: Mechanism, stages: int, steps: int, count: int) -> Iterator[Any]:
    """Yield (q, p) of one run, whose compensated sums go on from piece to piece."""
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


# ---------------------------------------------------------------- measurements


def _followed(mechanism: Mechanism, true: Mapping[str, Array], steps: int,
              program: str, method: str, pieces: Any) -> Row:
    scene, step = mechanism.scene, mechanism.stepper(2)
    model = scene.model
    end, cpu = _compared(scene, pieces)
    error = max(float(np.linalg.norm(end[name] - position)) for name, position in true.items())
    steps = min(steps, max(COMPARED, int(MOST_SECONDS / cpu) * COMPARED))
    piece, drift, constraint, note = max(1, steps // SAMPLES), [], 0.0, ""
    energy = step.energy(model.q0, model.p0, parameters=model.parameters)
    start = time.thread_time()
    spent, steps_run = 0.0, 0
    try:
        for motion in pieces(piece, min(SAMPLES, steps)):
            spent += time.thread_time() - start
            steps_run += piece
            q, p = _state(scene, motion)
            g, _ = step.defects(q, p, parameters=model.parameters)
            drift.append(abs(float(step.energy(q, p, parameters=model.parameters) - energy)))
            constraint = max(constraint, float(np.abs(g).max()))
            start = time.thread_time()
    except (Unavailable, gs.StepFailed) as failure:
        note = str(failure).partition(". ")[0]
    return Row(mechanism.name, program, method, {
        "µs/step": spent / max(steps_run, 1) * 1e6, "steps": float(steps_run),
        "constraints": constraint, "energy (J)": max(drift, default=math.inf), "error (m)": error},
        energy_drift=tuple(drift), note=note)


def _compared(scene: ReferenceScene, pieces: Any) -> tuple[dict[str, Array], float]:
    """Return where the bodies are after ``COMPARED`` steps, and their CPU seconds."""
    start = time.thread_time()
    (end,) = pieces(COMPARED, 1)
    return _places(scene, end), time.thread_time() - start


def _true_end(mechanism: Mechanism, stages: int) -> dict[str, Array]:
    """Return where the bodies are after ``COMPARED`` steps, by G-L in steps of a fifth."""
    model, parts = mechanism.scene.model, 5 * COMPARED
    run = mechanism.stepper(stages).integrate(
        model.q0, model.p0, dt=mechanism.dt / 5, steps=parts, every=parts,
        parameters=model.parameters)
    return _places(mechanism.scene, (run.q[-1], run.p[-1]))


def _places(scene: ReferenceScene, motion: Any) -> dict[str, Array]:
    q, _ = _state(scene, motion)
    places = {x: i for i, x in enumerate(scene.model.system.q)}
    return {layout.name: q[[places[x] for x in layout.x]] for layout in scene.model.system.bodies}


def _state(scene: ReferenceScene, motion: Any) -> tuple[Array, Array]:
    if isinstance(motion, tuple):
        return motion
    end = scene.end(motion)
    return end.q[0], end.p[0]


# ---------------------------------------------------------------- the page

_HEAD = """# Mechanisms with closed loops over many steps

This page compares gyrospark with MuJoCo, exudyn and Pinocchio: the errors of the constraints, of
the energy and of the motion, and the cost of one step. This command writes the page:

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
all programs alike: the largest abs(g) in m (constraints on directions have no unit), and the
largest deviation of H. The error is the largest distance, after 1000 steps, of a body from its
position in a run of 3-stage Gauss-Lobatto with a fifth of the time step. Times are CPU seconds of
one run on a machine that also does other work. Runs that would take more than a minute have fewer
steps. A run ends where its motion becomes unstable or not finite; a note follows the table.

MuJoCo closes loops by soft constraints, at their largest stiffness for the time step, and exudyn by
multipliers. Pinocchio has no integrator: the steps are semi-implicit Euler in Python, with
Baumgarte's stabilisation at a time constant of five steps, so its time is mostly Python's. Models
from files are run by gyrospark and MuJoCo only. Joints of files have no limits here, so linkages
pass close to singular configurations, where the energy of our runs deviates in jumps. At the two
largest jumps of the 2F-85 in its first 24 s, the smallest singular value of its constraint
Jacobian, with rows of length one, is a third of its median.

These commands show a model, and a file:

```
gyrospark run delta_robot --show delta.html
gyrospark run cassie.xml --set ignore=all --set keyframe=home --show cassie.html
```
"""


def page(rows: Sequence[Row], shown: Sequence[Mechanism], picture: str = "") -> str:
    """Return the page of mechanisms, with a picture of a file name."""
    parts = [_HEAD]
    if picture:
        alternative = "Deviation of the energy over time, a panel for a mechanism"
        parts.append(f"![{alternative}]({picture})\n")
    for mechanism in shown:
        about = f"{mechanism.source}; steps of {mechanism.dt * 1e3:g} ms."
        mechanism_rows = [row for row in rows if row.case == mechanism.name and row.numbers]
        parts += [f"## {mechanism.title}\n", textwrap.fill(
            about, 100, break_on_hyphens=False, break_long_words=False) + "\n", markdown([
                ["program", "method", "steps", "µs a step", "constraints", "energy (J)",
                 "error (m)"],
                *([row.program, row.setting, *(text_of(row.numbers[name]) for name in (
                    "steps", "µs/step", "constraints", "energy (J)", "error (m)"))]
                  for row in mechanism_rows)])]
        parts += [f"{row.program} {row.setting}: {row.note}.\n"
                  for row in mechanism_rows if row.note]
    return "\n".join(parts)


def draw_drift(rows: Sequence[Row], shown: Sequence[Mechanism], path: Path) -> None:
    """Draw the deviation of the energy against time, a panel for each mechanism."""
    columns, lines = min(3, len(shown)), -(-len(shown) // 3)
    figure = need("matplotlib.figure", "matplotlib").Figure(
        figsize=(3.2 * columns + 1, 2.6 * lines + 0.8), layout="constrained")
    legend: dict[str, Any] = {}
    for number, mechanism in enumerate(shown, start=1):
        axes = figure.add_subplot(lines, columns, number)
        axes.set_title(mechanism.title, fontsize=8)
        for row in rows:
            drift = row.energy_drift
            if row.case == mechanism.name and drift:
                seconds = mechanism.dt * row.numbers["steps"] * np.arange(1, len(drift) + 1)
                program = f"{row.program} {row.setting}"
                line, = axes.plot(
                    seconds / len(drift), np.maximum(drift, 1e-16), lw=0.8,
                    color=f"C{list(legend).index(program) if program in legend else len(legend)}",
                    linestyle="-" if row.program.startswith("gyrospark") else "--")
                legend.setdefault(program, line)
        axes.set(xscale="log", yscale="log")
        axes.tick_params(labelsize=6)
    figure.supxlabel("time (s)", fontsize=8)
    figure.supylabel("deviation of the energy (J)", fontsize=8)
    figure.legend(legend.values(), legend.keys(), loc="outside upper center", fontsize=7, ncols=4)
    figure.savefig(path, dpi=90)


# ---------------------------------------------------------------- files

_ELEMENTS = ("compiler", "option", "default", "worldbody", "body", "frame", "inertial", "joint",
             "freejoint", "equality", "connect", "weld", "keyframe", "key")
#: Attributes that stay, of elements that lose others.
_STAYS = {"option": ("gravity", "timestep"), "key": ("name", "qpos"),
          "joint": ("name", "class", "type", "pos", "axis", "ref", "stiffness", "springref",
                    "armature", "joint1", "joint2", "polycoef", "active")}


def conservative_text(path: Path) -> str:
    """Return bodies, joints, equalities and springs of a file in MJCF, for both programs alike.

    Left out are contact, limits, friction, dampers, motors, tendons, and the free joint of the
    base, which is fixed.

    Raises
    ------
    InputError
        If the file is not MJCF, or has more than one body on the ground.
    """
    try:
        top = ElementTree.fromstring(path.read_text(encoding="utf-8"))
    except (OSError, ElementTree.ParseError) as error:
        raise gs.InputError(f"The model file {str(path)!r} is not usable: {error}.") from None
    bases = top.findall("worldbody/body")
    if top.tag != "mujoco" or len(bases) != 1:
        raise gs.InputError(f"The model file {str(path)!r} has the root <{top.tag}> and "
                            f"{len(bases)} bodies on the ground; give MJCF of a single robot.")
    free = [joint for joint in bases[0] if joint.tag == "freejoint"
            or (joint.tag, joint.get("type")) == ("joint", "free")]
    for joint in free:
        bases[0].remove(joint)
    for key in top.iterfind("keyframe/key"):
        numbers = key.get("qpos", "").split()
        key.set("qpos", " ".join(numbers[7 * len(free):]))
    return ElementTree.tostring(_stripped(top), encoding="unicode")


def _stripped(element: ElementTree.Element) -> ElementTree.Element:
    stays = _STAYS.get(element.tag, element.attrib)
    bare = ElementTree.Element(element.tag, {
        key: value for key, value in element.attrib.items() if key in stays})
    bare.extend(_stripped(child) for child in element if child.tag in _ELEMENTS)
    return bare
