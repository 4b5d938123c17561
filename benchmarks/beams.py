"""A thin steel rod, clamped at one end, that falls from the horizontal: cost and error.

Length 1 m, radius 1 mm, E = 200 GPa, ν = 0.3: slenderness 1000. The error is the largest one of
the end's position after 0.1, 0.2, … 0.5 s; the exact one is extrapolated from 40 and 80 segments
with 3-G-L, as the error is of second order in the length of a segment. The explicit scheme of
PyElastica needs steps below 2/ω of the shear of a section, ω² = κ G A/(ρ I) with κ = 27/28; the
plane cables of exudyn have an implicit scheme.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import gyrospark as gs

from .attitudes import Array
from .peers.optional import need
from .rows import Choice, Entry, Prepared, Row, contest

__all__ = ["beams", "rod"]

_RADIUS, _DENSITY, _YOUNG, _SHEAR, _GRAVITY = 1e-3, 7850.0, 2e11, 2e11 / 2.6, 9.81
_AREA, _MOMENT = np.pi * _RADIUS**2, np.pi * _RADIUS**4 / 4
_T_END, _INSTANTS = 0.5, 5
#: Position (x, z) of the end after each tenth of a second, in m.
_EXACT = np.array([
    (0.997062, -0.071513),
    (0.969513, -0.228510),
    (0.927487, -0.348314),
    (0.930248, -0.342496),
    (0.973378, -0.215147)])


def rod(count: int, stretches: bool) -> gs.Model:
    """Return the clamped rod of segments that keep their length, or stretch and shear."""
    build = gs.Multibody(f"steel_rod_{count}{'_stretches' * stretches}", gravity=(0, 0, -_GRAVITY))
    beam = build.beam("rod", start=(0, 0, 0), end=(1, 0, 0), count=count, radius=_RADIUS,
                      mass=_DENSITY * _AREA, bending=_YOUNG * _MOMENT,
                      twisting=2 * _MOMENT * _SHEAR,
                      stretching=_YOUNG * _AREA if stretches else None,
                      shearing=27 / 28 * _AREA * _SHEAR if stretches else None)
    build.fixed("clamp", build.ground, beam.first)
    return build.model()


def ours(count: int, stages: int, dt: float, stretches: bool = False) -> Prepared:
    """Return a run of G-L."""
    model, steps = rod(count, stretches), round(_T_END / dt)
    step = gs.stepper("G-L", stages, system=model)

    def run() -> Array:
        motion = step.integrate(model, dt=dt, steps=steps, every=steps // _INSTANTS)
        ends: Array = motion.beam("rod").line()[1:, -1, ::2]
        return ends

    return _prepared(run, steps)


def _prepared(run: Callable[[], Array], steps: int) -> Prepared:
    return Prepared({"error (m)": float(np.linalg.norm(run() - _EXACT, axis=-1).max())},
                    {"run": run}, lambda seconds: {
                        "CPU ms": seconds["run"].median * 1e3, "steps": steps})


def pyelastica(count: int, dt: float) -> Prepared:
    """Return a run of PyElastica's Verlet scheme, from a fresh rod each time."""
    elastica = need("elastica", "pyelastica")
    modules = need("elastica.modules", "pyelastica")
    steppers = need("elastica.timestepper.symplectic_steppers", "pyelastica")
    parts = (modules.BaseSystemCollection, modules.Constraints, modules.Forcing)
    steps = round(_T_END / dt)

    def run() -> Array:
        collection = type("Collection", parts, {})()
        beam = elastica.CosseratRod.straight_rod(
            count, np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), 1.0, _RADIUS,
            _DENSITY, youngs_modulus=_YOUNG, shear_modulus=_SHEAR)
        collection.append(beam)
        collection.constrain(beam).using(elastica.OneEndFixedBC, constrained_position_idx=(0,),
                                         constrained_director_idx=(0,))
        collection.add_forcing_to(beam).using(elastica.GravityForces,
                                              acc_gravity=np.array([0, 0, -_GRAVITY]))
        collection.finalize()
        verlet, t, ends = steppers.PositionVerlet(), np.float64(0.0), []
        for k in range(1, steps + 1):
            t = verlet.step(collection, t, np.float64(dt))
            if k % (steps // _INSTANTS) == 0:
                ends.append(beam.position_collection[::2, -1].copy())
        return np.array(ends)

    return _prepared(run, steps)


def exudyn(count: int, dt: float) -> Prepared:
    """Return a run of plane ANCF cables, which neither shear nor twist."""
    module, utilities = need("exudyn"), need("exudyn.utilities", "exudyn")
    steps = round(_T_END / dt)

    def run() -> Array:
        main = module.SystemContainer().AddSystem()
        nodes = need("exudyn.beams", "exudyn").GenerateStraightLineANCFCable2D(
            main, [0, 0, 0], [1, 0, 0], count, utilities.Cable2D(
                physicsMassPerLength=_DENSITY * _AREA, physicsBendingStiffness=_YOUNG * _MOMENT,
                physicsAxialStiffness=_YOUNG * _AREA), [0, -_GRAVITY, 0],
            fixedConstraintsNode0=[1, 1, 0, 1])[0]
        sensor = main.AddSensor(utilities.SensorNode(
            nodeNumber=nodes[-1], storeInternal=True,
            outputVariableType=module.OutputVariableType.Position))
        main.Assemble()
        settings: Any = module.SimulationSettings()
        settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = _T_END, steps
        settings.timeIntegration.newton.useModifiedNewton = True
        settings.timeIntegration.verboseMode = 0
        settings.solutionSettings.writeSolutionToFile = False
        settings.solutionSettings.sensorsWritePeriod = _T_END / _INSTANTS
        main.SolveDynamic(settings)
        ends: Array = main.GetSensorStoredData(sensor)[1:, 1:3]
        return ends

    return _prepared(run, steps)


def beams(choice: Choice) -> list[Row]:
    """Return a row for each program and setting; PyElastica's take minutes."""
    return contest("steel rod", [
        *(Entry("gyrospark", f"{'extensible, ' * stretches}N={count} G-L s=2 Δt={dt:g}",
                partial(ours, count, 2, dt, stretches), quick=count == 10)
          for stretches, count, dt in (
              (False, 10, 0.1), (False, 10, 0.01), (False, 20, 0.01), (True, 10, 0.01))),
        *(Entry("exudyn", f"N={count} generalised α Δt={dt:g}", partial(exudyn, count, dt),
                quick=count == 4)
          for count, dt in ((4, 0.02), (8, 0.02), (8, 0.01))),
        Entry("pyelastica", "N=10 Δt=2.5e-07", partial(pyelastica, 10, 2.5e-7), quick=False)],
        choice)
