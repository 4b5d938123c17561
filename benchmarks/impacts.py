"""Elastic impacts, beside heyoka, MuJoCo and exudyn: cost and error.

    ball    falls from 1 m, g = 9.81: a parabola, again and again
    stop    x'' = -x from 1, with a stop at -½: from a turning point to the next in 4π/3

Errors are of x at the end, half a fall after a turning point. heyoka has an event whose
callback turns the velocity round; MuJoCo and exudyn have stiff springs for contacts, whose impacts
take a time, π√(m/k).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import sympy as sp

import gyrospark as gs

from .peers.mujoco_scenes import mujoco_module
from .peers.optional import need
from .rows import Choice, Entry, Prepared, Row, contest

__all__ = ["Case", "impacts"]


@dataclass(frozen=True)
class Case:
    """A point with x'' = -stiffness x - gravity that starts at rest at 1, x ≥ floor.

    Attributes
    ----------
    hits : int
        Impacts of the run, which ends half way between two.
    """

    name: str
    gravity: float
    stiffness: float
    floor: float
    hits: int

    @property
    def fall(self) -> float:
        """Time from the turning point to an impact."""
        return float(np.arccos(self.floor) if self.stiffness
                     else np.sqrt(2 * (1 - self.floor) / self.gravity))

    @property
    def t_end(self) -> float:
        """Seconds: half a fall after the turning point behind the last impact."""
        return (2 * self.hits + 0.5) * self.fall

    @property
    def exact(self) -> float:
        """The position at the end."""
        return float(np.cos(self.fall / 2) if self.stiffness
                     else 1 - self.gravity * (self.fall / 2)**2 / 2)

    def prepared(self, run: Callable[[], float]) -> Prepared:
        """Return the error at the end, and the run to time."""
        return Prepared({"error (m)": abs(run() - self.exact)}, {"run": run},
                        lambda seconds: {"CPU µs/hit": seconds["run"].median * 1e6 / self.hits})

    def ours(self, stages: int, dt: float) -> Prepared:
        """Return a run with an impact of the gap."""
        x, p, g, k, a = sp.symbols("x p g k a", real=True)
        step = gs.stepper("G-L", stages, system=gs.System(
            (x,), (p,), (g, k, a), p**2 / 2 + k * x**2 / 2 + g * x, name="point_and_floor",
            quantities={"gap": x - a}))
        steps = int(np.ceil(self.t_end / dt))
        parameters = {"g": self.gravity, "k": self.stiffness, "a": self.floor}
        return self.prepared(lambda: float(step.integrate(
            [1.0], [0.0], dt=dt, t_end=self.t_end, every=steps, parameters=parameters,
            events=gs.Impact("gap")).q[-1, 0]))

    def heyoka(self) -> Prepared:
        """Return a run with a terminal event whose callback turns the velocity round."""
        heyoka = need("heyoka")
        x, v = heyoka.make_vars("x", "v")

        def bounce(motion: Any, sign: int) -> bool:
            motion.state[1] *= -1
            return True

        motion = heyoka.taylor_adaptive(
            [(x, v), (v, -self.stiffness * x - self.gravity)], [1.0, 0.0],
            t_events=[heyoka.t_event(x - self.floor, callback=bounce,
                                     direction=heyoka.event_direction.negative)])

        def run() -> float:
            motion.time = 0.0
            motion.state[:] = 1, 0
            motion.propagate_until(self.t_end)
            return float(motion.state[0])

        return self.prepared(run)

    def mujoco(self, dt: float) -> Prepared:
        """Return a run with a stop of a sliding joint, a spring as stiff as dt lets it be."""
        mujoco = mujoco_module()
        model = mujoco.MjModel.from_xml_string(
            f'<mujoco><compiler boundmass="0" boundinertia="0"/><option gravity="0 0 '
            f'{-self.gravity}" integrator="RK4" timestep="{dt!r}"/><worldbody><body><joint '
            f'type="slide" axis="0 0 1" limited="true" range="{self.floor - 1!r} 9" stiffness="'
            f'{self.stiffness!r}" springref="-1" solreflimit="{-0.2 / dt**2!r} 0" solimplimit="'
            '.9999 .9999 .001 .5 2"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
            '</worldbody></mujoco>')
        data, steps = mujoco.MjData(model), round(self.t_end / dt)

        def run() -> float:
            mujoco.mj_resetData(model, data)
            mujoco.mj_step(model, data, steps)
            return float(data.qpos[0] + 1 + data.qvel[0] * (self.t_end - steps * dt))

        return self.prepared(run)

    def exudyn(self, dt: float) -> Prepared:
        """Return a run with a contact of a coordinate, a spring as stiff as dt lets it be."""
        exudyn = need("exudyn")
        items = need("exudyn.itemInterface", "exudyn")
        main = exudyn.SystemContainer().AddSystem()
        ground = main.AddNode(items.PointGround())
        node = main.AddNode(items.Node1D(referenceCoordinates=[0], initialCoordinates=[1]))
        main.AddObject(items.Mass1D(nodeNumber=node, physicsMass=1))
        fixed, free = (main.AddMarker(items.MarkerNodeCoordinate(nodeNumber=number, coordinate=0))
                        for number in (ground, node))
        data = main.AddNode(items.NodeGenericData(initialCoordinates=[1 - self.floor],
                                                  numberOfDataCoordinates=1))
        main.AddObject(items.ObjectContactCoordinate(
            markerNumbers=[fixed, free], nodeNumber=data, contactStiffness=0.2 / dt**2,
            contactDamping=0, offset=self.floor))
        main.AddObject(items.CoordinateSpringDamper(markerNumbers=[fixed, free],
                                                    stiffness=self.stiffness))
        main.AddLoad(items.LoadCoordinate(markerNumber=free, load=-self.gravity))
        main.Assemble()
        settings = exudyn.SimulationSettings()
        settings.timeIntegration.endTime = self.t_end
        settings.timeIntegration.numberOfSteps = round(self.t_end / dt)
        settings.timeIntegration.verboseMode = 0
        settings.solution.file.write = settings.solutionSettings.sensorsWriteFileHeader = False

        def run() -> float:
            main.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.TrapezoidalIndex2,
                              updateInitialValues=False)
            return float(main.GetNodeOutput(node, exudyn.OutputVariableType.Coordinates))

        return self.prepared(run)


def impacts(choice: Choice) -> list[Row]:
    """Return a row for each case, program and setting."""
    rows = []
    for case in (Case("ball", 9.81, 0.0, 0.0, 10 if choice.quick else 30),
                 Case("stop", 0.0, 1.0, -0.5, 10 if choice.quick else 30)):
        if choice.only in case.name:
            rows += contest(case.name, [
                *(Entry("gyrospark", f"G-L s={stages} Δt={dt:g}", partial(case.ours, stages, dt))
                  for stages, dt in ((2, 0.01), (4, 0.2))),
                Entry("heyoka", "default", case.heyoka),
                *(Entry(program, f"Δt={dt:g}", partial(run, dt), quick=dt == 1e-3)
                  for program, run in (("mujoco", case.mujoco), ("exudyn", case.exudyn))
                  for dt in (1e-3, 3e-4))], choice)
    return rows
