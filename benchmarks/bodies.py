"""Bodies on joints by gyrospark and other programs: CPU time against error after 1 s.

    chain of 8, four-bar    beside exudyn, MuJoCo and, the chain, PyDy
    arm of 7, tree of 30    models of sympy.physics.mechanics, beside PyDy
    batches                 eight starts of the first two in the lanes of a register, beside alone

The error is the largest distance of a centre of mass from a reference in long double; "limit" is
the distance of Richardson's extrapolation with the row of twice the time step, and checks the
reference independently of us.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import sympy as sp
from sympy.physics import mechanics as me

import gyrospark as gs

from .attitudes import Array, rotation_matrix
from .peers.exudyn_scenes import IMPLICIT, ExudynScene
from .peers.mujoco_scenes import MujocoScene
from .peers.pydy_bodies import TOLERANCES, PydyBodies
from .peers.pydy_mechanics import PydyMechanics
from .rows import Choice, Entry, Prepared, Row, contest
from .scenes import ReferenceScene, SceneMotion, scene_of
from .timing import Sample

__all__ = ["ACCURACIES", "COST", "ERROR", "Links", "arm", "batches", "bodies",
           "mechanics", "our_centres", "scenes", "tree"]

T_END = 1.0
COST, ERROR = "CPU ms", "error (m)"
#: Errors in m for which the cheapest run of each program is looked up.
ACCURACIES = (1e-3, 1e-4, 1e-5, 1e-6)
#: Stages → time steps of ours, and time steps of others.
_OURS = {2: (2e-2, 1e-2, 5e-3, 2e-3, 1e-3), 3: (2e-2, 1e-2, 5e-3, 2e-3),
         4: (2e-2, 1e-2, 5e-3, 2e-3)}
_THEIRS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4, 6.25e-5)
#: Stages and time step of the coarser reference; half the step gives the reference.
_REFERENCE = (6, 1e-3)
#: Returns the centres of mass at the end of a run.
Centres = Callable[[], Array]


class Motion:
    """Ends of runs on one model, and their errors.

    Parameters
    ----------
    ours : callable
        Stepper and time step → centres of mass at the end.
    make : callable
        Stages and floating-point type → stepper.
    """

    def __init__(self, ours: Callable[[gs.Stepper, float], Array],
                 make: Callable[..., gs.Stepper]) -> None:
        self.ours, self.make, self.ends = ours, make, dict[tuple[str, float], Array]()
        stages, dt = _REFERENCE
        step = make(stages, real="long-double")
        coarse, self.reference = (ours(step, h) for h in (dt, dt / 2))
        self.trust = float(np.linalg.norm(self.reference - coarse, axis=1).max())

    def prepared(self, method: str, dt: float | None, order: int, run: Centres) -> Prepared:
        """Return a run with its error, and with its limit where twice the step was run before."""
        end = run()
        errors = {ERROR: self.distance(end), "reference off by (m)": self.trust}
        if dt is not None:
            self.ends[method, dt] = end
            coarse = self.ends.get((method, 2 * dt))
            if coarse is not None:
                errors["limit (m)"] = self.distance(end + (end - coarse) / (2**order - 1))

        def costs(seconds: Mapping[str, Sample]) -> dict[str, float]:
            total = seconds["run"].median
            return {COST: total * 1e3, **({} if dt is None else {"µs/step": total * dt * 1e6})}

        return Prepared(errors, {"run": run}, costs)

    def distance(self, end: Array) -> float:
        """Return the largest distance of a centre of mass from the reference."""
        return float(np.linalg.norm(end - self.reference, axis=1).max())

    def entries(self, steps: Mapping[int, tuple[float, ...]]) -> Iterator[Entry]:
        """Yield our entries: stages → time steps."""
        for stages, dts in steps.items():
            for dt in dts:
                yield Entry("gyrospark", f"G-L s={stages} Δt={dt:g}",
                            partial(self._entered, stages, dt), stages == 2 and dt in dts[1:3])

    def _entered(self, stages: int, dt: float) -> Prepared:
        step = self.make(stages)
        return self.prepared(f"G-L s={stages}", dt, 2 * stages, partial(self.ours, step, dt))


# ---------------------------------------------------------------- scenes


def scenes(choice: Choice) -> list[ReferenceScene]:
    """Return the chain of 8 and the four-bar; in a quick run a chain of 2 and the four-bar."""
    rods = 2 if choice.quick else 8
    return [replace(scene_of(gs.models.chain(rods)), name=f"chain of {rods}"),
            replace(scene_of(gs.models.four_bar()), name="four-bar")]


def bodies(choice: Choice) -> list[Row]:
    """Return the rows of the chain and the four-bar."""
    rows = []
    for scene in scenes(choice):
        if choice.only in scene.name:
            choice.watch(f"{scene.name}: reference")
            motion = Motion(partial(our_centres, scene), partial(_make, scene.model))
            rows += contest(scene.name, [
                *motion.entries(_OURS), *_exudyn(motion, scene), *_mujoco(motion, scene),
                *_pydy(motion, scene)], choice)
    return rows


def _make(model: gs.Model | gs.System, stages: int, real: Any = "double") -> gs.Stepper:
    return gs.stepper("G-L", stages, system=model, real=real)


def our_centres(scene: ReferenceScene, step: gs.Stepper, dt: float) -> Array:
    """Return the centres of mass after 1 s."""
    model, steps = scene.model, round(T_END / dt)
    start = model.q0, model.p0
    if step.manifest.real != "double":  # the start rounded to double is off its constraints
        start = step.project(*start, parameters=model.parameters)
    end = step.integrate(*start, dt=dt, steps=steps, every=steps, parameters=model.parameters)
    return np.array([end.body(name).position()[-1] for name in scene.bodies], dtype=float)


def _centres(motions: Mapping[str, SceneMotion]) -> Array:
    return np.array([motion.x for motion in motions.values()])


def _exudyn(motion: Motion, scene: ReferenceScene) -> Iterator[Entry]:
    def prepare(method: str, dt: float) -> Prepared:
        machine = ExudynScene(scene)
        return motion.prepared(method, dt, 2, lambda: _centres(
            machine.run(method, T_END, round(T_END / dt))))

    for method in IMPLICIT:
        for dt in _THEIRS:
            yield Entry("exudyn", f"{method} Δt={dt:g}", partial(prepare, method, dt),
                        method == next(iter(IMPLICIT)) and dt in _THEIRS[:2])


def _mujoco(motion: Motion, scene: ReferenceScene) -> Iterator[Entry]:
    has_loops = len(scene.joints) > len(scene.bodies)

    def prepare(integrator: str, dt: float) -> Prepared:
        run = MujocoScene(scene).prepare(integrator, T_END, round(T_END / dt))
        order = (2 if has_loops else 4) if integrator == "RK4" else 1
        return motion.prepared(integrator, dt, order, lambda: _centres(run()))

    for integrator in ("RK4", "implicitfast", "implicit"):
        for dt in _THEIRS:
            yield Entry("mujoco", f"{integrator} Δt={dt:g}", partial(prepare, integrator, dt),
                        integrator == "RK4" and dt in _THEIRS[:2])


def _pydy(motion: Motion, scene: ReferenceScene) -> Iterator[Entry]:
    cache: list[PydyBodies] = []

    def prepare(tolerance: float) -> Prepared:
        cache[:] = cache or [PydyBodies(scene)]
        return motion.prepared("DOP853", None, 8, partial(cache[0].run, tolerance, T_END))

    for tolerance in TOLERANCES:
        yield Entry("pydy", f"DOP853 tol {tolerance:g}", partial(prepare, tolerance),
                    tolerance == TOLERANCES[-1])


# ---------------------------------------------------------------- sympy.physics.mechanics

#: m, l (half the length of a link), I, g in SI units.
_VALUES = {"m": 1.0, "l": 0.2, "I": 0.02, "g": 9.81}


@dataclass(frozen=True)
class Links:
    """Links by the numbers of their parents; None is the ground.

    All links are alike. Each hangs on the end of its parent, and turns about x, y or z of the
    parent, in turn.
    """

    name: str
    parents: tuple[int | None, ...]

    @property
    def start(self) -> Array:
        """Angles at t = 0, all different: from 0.3 to 0.6 rad, at rest."""
        return np.linspace(0.3, 0.6, len(self.parents))

    def system(self) -> Any:
        """Return the ``System`` of SymPy."""
        space, origin = me.ReferenceFrame("N"), me.Point("O")
        origin.set_vel(space, 0)
        mass, length, inertia, gravity = sp.symbols(list(_VALUES), positive=True)
        system, ground = me.System(space, origin), me.RigidBody("ground", origin, space)
        links: list[Any] = []
        for i, parent in enumerate(self.parents):
            parent_body = ground if parent is None else links[parent]
            axes, centre = me.ReferenceFrame(f"A{i}"), me.Point(f"C{i}")
            links.append(me.RigidBody(f"link{i}", centre, axes, mass, (
                me.inertia(axes, inertia, inertia, inertia / 10), centre)))
            system.add_joints(me.PinJoint(
                f"joint{i}", parent_body, links[i], *me.dynamicsymbols(f"q{i} u{i}"),
                parent_point=origin if parent is None else parent_body.masscenter.locatenew(
                    f"P{i}", length * parent_body.frame.z),
                child_point=centre.locatenew(f"Q{i}", -length * axes.z),
                joint_axis=(parent_body.frame.x, parent_body.frame.y, parent_body.frame.z)[i % 3]))
            system.add_loads(me.Force(centre, -mass * gravity * space.z))
        return system

    def centres(self, q: Any) -> Array:
        """Return the centres of mass at the angles q, shape (links, 3)."""
        R: dict[int | None, Array] = {None: np.eye(3)}
        ends: dict[int | None, Array] = {None: np.zeros(3)}
        places = []
        for i, (parent, angle) in enumerate(zip(self.parents, np.asarray(q, float), strict=True)):
            half = np.zeros(4)
            half[0], half[1 + i % 3] = np.cos(angle / 2), np.sin(angle / 2)
            R[i] = R[parent] @ rotation_matrix(half)
            arm_ = _VALUES["l"] * R[i][:, 2]
            places.append(ends[parent] + arm_)
            ends[i] = ends[parent] + 2 * arm_
        return np.array(places)


def arm(count: int) -> Links:
    """Return ``count`` links in a row."""
    return Links(f"arm of {count}", tuple(i - 1 if i else None for i in range(count)))


def tree(count: int) -> Links:
    """Return ``count`` links in a binary tree."""
    return Links(f"tree of {count}", tuple((i - 1) // 2 if i else None for i in range(count)))


def mechanics(choice: Choice) -> list[Row]:
    """Return the rows of the arm and the tree; in a quick run of an arm of two."""
    rows = []
    for links in [arm(2)] if choice.quick else [arm(7), tree(30)]:
        if choice.only not in links.name:
            continue
        choice.watch(f"{links.name}: derive")
        system = gs.from_mechanics(links.system(), name=links.name.replace(" ", "_"))
        motion = Motion(partial(_swung, links), partial(_make, system))
        rows += contest(links.name, [
            *motion.entries({2: (1e-2, 5e-3, 2e-3, 1e-3), 3: (1e-2, 5e-3, 2e-3, 1e-3),
                             4: (1e-2, 5e-3, 2e-3)}), *_pydy_links(motion, links)], choice)
    return rows


def _swung(links: Links, step: gs.Stepper, dt: float) -> Array:
    steps = round(T_END / dt)
    end = step.integrate(links.start, np.zeros_like(links.start), dt=dt, steps=steps, every=steps,
                         parameters=_VALUES)
    return links.centres(end.q[-1])


def _pydy_links(motion: Motion, links: Links) -> Iterator[Entry]:
    cache: list[PydyMechanics] = []

    def prepare(tolerance: float) -> Prepared:
        cache[:] = cache or [PydyMechanics(links.system(), _VALUES)]
        prepared = motion.prepared("DOP853", None, 8, lambda: links.centres(
            cache[0].run(tolerance, links.start, T_END)))
        return replace(prepared, errors=prepared.errors | {"derived in (s)": cache[0].cost})

    for tolerance in (*TOLERANCES, 1e-10):
        yield Entry("pydy", f"DOP853 tol {tolerance:g}", partial(prepare, tolerance),
                    tolerance == TOLERANCES[-1])


# ---------------------------------------------------------------- batches

#: Trajectories of a batch, and how far their starts are apart: relative to q, and to the largest p.
_TRAJECTORIES, _SPREAD = 8, 0.02


def batches(choice: Choice) -> list[Row]:
    """Return a step of a trajectory in a batch, and alone, with the largest difference of q."""
    rows = []
    for scene in scenes(choice):
        for stages in (2,) if choice.quick else (2, 3, 4, 6):
            if choice.only in scene.name:
                rows += contest(scene.name, [Entry(
                    "gyrospark", f"G-L s={stages}",
                    partial(_batch, scene.model, stages, 50 if choice.quick else 500))], choice)
    return rows


def _batch(model: gs.Model, stages: int, steps: int) -> Prepared:
    step, chance = _make(model, stages), np.random.default_rng(1)
    q, p = np.array([step.project(
        model.q0 + offset[0], model.p0 + offset[1] * np.abs(model.p0).max(),
        parameters=model.parameters) for offset in (
            _SPREAD * chance.standard_normal((2, len(model.q0))) * (i > 0)
            for i in range(_TRAJECTORIES))]).swapaxes(0, 1)
    run: dict[str, Any] = {"dt": 2e-3, "steps": steps, "every": steps,
                           "parameters": model.parameters}

    def alone() -> list[gs.Trajectory]:
        return [step.integrate(*start, **run) for start in zip(q, p, strict=True)]

    def together() -> gs.Ensemble:
        ends = step.integrate_ensemble(q, p, workers=1, **run)
        for failure in ends.failures.values():
            raise failure
        return ends

    ends, ensemble = alone(), together()
    total_steps = _TRAJECTORIES * steps
    return Prepared(
        {"iterations": float(np.mean([trajectory.report.iterations_mean
                                      for trajectory in ensemble.members])),
         "differs by": float(max(np.abs(ensemble.q[i, -1] - trajectory.q[-1]).max()
                                 for i, trajectory in enumerate(ends))),
         "|g|": max(trajectory.report.constraint_max for trajectory in ensemble.members)},
        {"together": together, "alone": alone},
        lambda seconds: {"µs/step": seconds["together"].median / total_steps * 1e6,
                         "alone µs/step": seconds["alone"].median / total_steps * 1e6,
                         "ratio": seconds["together"].median / seconds["alone"].median})
