"""Gradients beside other programs: error against cost, ``make bench WHAT="gradients"``.

    fast top      |q(2 s) − q*|² with q* = (½, ½, ½, ½), by the start, I1, I2, I3 and mgl
    four-bar      |x(1 s)|² of the last body's centre of mass, by the start, gravity and masses
    chain of 8    the same

Each program has the equations that suit it; its derivatives by (q, p) are compared as ours are,
by coordinates of the tangent space at the start. Truth is our gradient in long double. Timed are
value and gradient together, and beside them a run alone: CPU time, contestants in turn.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property, partial
from typing import Any

import numpy as np
import sympy as sp

import gyrospark as gs
from gyrospark.runtime.derivatives.tangent_space import TangentSpace

from .attitudes import Array
from .peers import casadi_gradients, diffrax_gradients, heyoka_gradients, mujoco_gradients
from .peers.gradient_job import GradientJob, Job
from .rows import Choice, Entry, Prepared, Row, contest
from .scenes import scene_of
from .timing import with_children
from .tops import INERTIA, MGL, parameters, tops

__all__ = ["OUR_STEPS", "FastTopGradient", "LinkageGradient", "derivatives", "gradients"]

#: Stages → time steps.
OUR_STEPS = {3: (1e-3, 2e-3, 4e-3), 4: (1e-3, 2e-3, 4e-3), 5: (8e-3,), 6: (5e-3, 1e-2)}
#: Stages and time step of the coarser truth; half the step gives the truth.
_TRUTH = (6, 4e-3)


class _Case:
    """A motion, a loss |z_i(T) − z*|² of some coordinates, and the parameters of its gradient."""

    name: str
    t_end: float
    q0: Array
    p0: Array
    values: Mapping[str, float]
    #: Parameters that the gradient is taken by.
    wrt: tuple[str, ...]
    #: Coordinates of the loss, and their target z*.
    watched: slice
    target: Array

    def make(self, stages: int, real: Any = "double") -> gs.Stepper:
        """Return our stepper."""
        raise NotImplementedError

    def others(self) -> Iterator[tuple[str, Mapping[str, Callable[[], Job]]]]:
        """Yield each program with its settings: name → function that prepares a gradient."""
        raise NotImplementedError

    def prepared(self, make: Callable[[], Job]) -> Prepared:
        """Return a gradient with its errors, relative to the largest entry."""
        begin = with_children()
        job = make()
        gradient = job.gradient()
        built = with_children() - begin
        truth, truth_error = self.truth
        errors = self.errors(gradient, truth)
        return Prepared(
            {"error": max(errors.values()), **errors, "truth off by": truth_error,
             "built in (s)": built},
            {"gradient": job.gradient, "run": job.primal},
            lambda seconds: {"gradient (ms)": seconds["gradient"].median * 1e3,
                             "run (ms)": seconds["run"].median * 1e3,
                             "ratio": seconds["gradient"].median / seconds["run"].median})

    def loss(self, run: Any) -> tuple[Any, dict[str, Array]]:
        """Return the loss of a run and its cotangents."""
        deviation = run.q[-1][self.watched] - self.target
        by_q = np.zeros_like(run.q[-1])
        by_q[self.watched] = 2 * deviation
        return deviation @ deviation, {"q": by_q}

    def _run(self, dt: float) -> dict[str, Any]:
        steps = round(self.t_end / dt)
        return {"dt": dt, "steps": steps, "every": steps, "parameters": self.values}

    def _start(self, step: gs.Stepper) -> tuple[Array, Array]:
        return step.project(self.q0, self.p0, parameters=self.values)

    def ours(self, stages: int, dt: float, real: Any = "double") -> Job:
        """Return our gradient by the adjoint: the run, and backwards through its steps."""
        step = self.make(stages, real)
        q, p = self._start(step)

        def gradient() -> GradientJob:
            partials = step.gradient(step.integrate(q, p, **self._run(dt)), loss=self.loss)
            return GradientJob(partials.q, partials.p, [partials[name] for name in self.wrt])

        return Job(gradient, lambda: step.integrate(q, p, **self._run(dt)))

    def our_tangents(self, stages: int, dt: float) -> Job:
        """Return our gradient by tangents along all directions of the start and parameters."""
        step = self.make(stages)
        q, p = self._start(step)
        tangents, space = gs.Tangents(parameters=self.wrt), self._space
        basis = space.basis()

        def gradient() -> GradientJob:
            run = step.integrate(q, p, **self._run(dt), tangents=tangents)
            columns = self.loss(run)[1]["q"] @ run.tangents.q[-1]
            split = len(columns) - len(self.wrt)
            by_start = np.zeros(space.binding.rows)
            by_start[: 2 * step.n] = basis @ columns[:split]
            by_start = space.pulled_back(by_start)  # else parameters would move the start once more
            return GradientJob(by_start[: step.n], by_start[step.n : 2 * step.n], columns[split:])

        return Job(gradient, lambda: step.integrate(q, p, **self._run(dt)))

    # ------------------------------------------------------------ error of a gradient

    @cached_property
    def _space(self) -> TangentSpace:
        """The tangent space at the start, in double."""
        step = self.make(3)
        q, p = self._start(step)
        binding = step._derivative_binding()
        numbers = step.integrate(q, p, dt=1e-3, steps=0, parameters=self.values).parameters
        self._names = binding.module.parameter_names
        return TangentSpace(binding, binding.module.parameters(numbers, 0.0), q, p,
                            step.constraint_names)

    def vector(self, gradient: GradientJob) -> tuple[Array, Array]:
        """Return the gradient by coordinates of the tangent space, and θ ∂/∂θ.

        Parameters that move the constraints move the start too, as ``consistent`` does.
        """
        space, n = self._space, self._space.n
        z_bar = np.zeros(space.binding.rows)
        z_bar[:n], z_bar[n : 2 * n] = (np.asarray(x, dtype=float) for x in (gradient.q, gradient.p))
        indices = [2 * n + self._names.index(name) for name in self.wrt]
        if gradient.parameters is not None:
            z_bar[indices] = np.asarray(gradient.parameters, dtype=float)
        z_bar = space.pulled_back(z_bar)
        scaled = z_bar[indices] * [self.values[name] for name in self.wrt]
        return space.basis().T @ z_bar[: 2 * n], scaled

    def errors(self, gradient: GradientJob, truth: tuple[Array, Array]) -> dict[str, float]:
        """Return the errors of a gradient, relative to the largest entry of the true one."""
        by_start, scaled = self.vector(gradient)
        errors = {"by start": _off(by_start, truth[0])}
        if gradient.parameters is not None:
            errors["by parameters"] = _off(scaled, truth[1])
        return errors

    @cached_property
    def truth(self) -> tuple[tuple[Array, Array], float]:
        """The gradient in long double, and its distance from the gradient with twice the step."""
        stages, dt = _TRUTH
        coarse, fine = (self.vector(self.ours(stages, h, "long-double").gradient())
                        for h in (dt, dt / 2))
        return fine, max(_off(x, y) for x, y in zip(coarse, fine, strict=True))



def _off(computed: Array, truth: Array) -> float:
    return float(np.abs(computed - truth).max() / np.abs(truth).max())


class FastTopGradient(_Case):
    """The paper's top (80); peers have Euler's equations in (q, Ω)."""

    name = "fast top"
    wrt = ("I1", "I2", "I3", "mgl")
    watched = slice(0, 4)
    target = np.full(4, 0.5)

    def __init__(self, t_end: float = 2.0) -> None:
        top = tops()[0]
        self.t_end, self.q0, self.p0, self.values = t_end, top.q, top.p, parameters()

    def make(self, stages: int, real: Any = "double") -> gs.Stepper:
        """Return the heavy top's stepper."""
        return gs.stepper("G-L", stages, "gamma", real=real)

    def others(self) -> Iterator[tuple[str, Mapping[str, Callable[[], Job]]]]:
        """Yield heyoka, diffrax, CasADi and MuJoCo."""
        for program, module in (("heyoka", heyoka_gradients), ("diffrax", diffrax_gradients),
                                ("casadi", casadi_gradients), ("mujoco", mujoco_gradients)):
            yield program, module.of_top(self.t_end, self.target)


class LinkageGradient(_Case):
    """Bodies on joints; peers have our (q, p) and H, or build their own bodies."""

    target = np.zeros(3)

    def __init__(self, name: str, model: gs.Model, t_end: float = 1.0) -> None:
        self.model, self.name, self.t_end = model, name, t_end
        self.q0, self.p0, self.values = model.q0, model.p0, model.parameters
        n = len(self.q0)
        self.watched = slice(n - 3, n)
        self.wrt = tuple(name for name in model.parameters
                         if name.startswith("gravity") or name.endswith("_m"))

    def make(self, stages: int, real: Any = "double") -> gs.Stepper:
        """Return the model's stepper."""
        return gs.stepper("G-L", stages, system=self.model, real=real)

    def others(self) -> Iterator[tuple[str, Mapping[str, Callable[[], Job]]]]:
        """Yield CasADi and MuJoCo."""
        yield "casadi", casadi_gradients.of_model(self.model, self.wrt, self.t_end)
        yield "mujoco", mujoco_gradients.of_scene(scene_of(self.model), self.t_end)


def gradients(choice: Choice) -> list[Row]:
    """Return a row for each case, program and setting; in a quick run of 0.2 s of the top."""
    cases: list[_Case] = [FastTopGradient(0.2)] if choice.quick else [
        FastTopGradient(), LinkageGradient("four-bar", gs.models.four_bar()),
        LinkageGradient("chain of 8", gs.models.chain(8))]
    rows = []
    for case in cases:
        if choice.only in case.name:
            choice.watch(f"{case.name}: truth")
            rows += contest(case.name, [*_ours(case), *(
                Entry(program, setting, partial(case.prepared, make), number == 0)
                for program, settings in case.others()
                for number, (setting, make) in enumerate(settings.items()))], choice)
    return rows


def _ours(case: _Case) -> Iterator[Entry]:
    for stages, dts in OUR_STEPS.items():
        for dt in dts:
            yield Entry("gyrospark", f"G-L s={stages} adjoint Δt={dt:g}",
                        partial(case.prepared, partial(case.ours, stages, dt)),
                        (stages, dt) == (3, 4e-3))
    for dt in (1e-3, 4e-3):
        yield Entry("gyrospark", f"G-L s=3 tangents Δt={dt:g}",
                    partial(case.prepared, partial(case.our_tangents, 3, dt)), dt == 4e-3)


# ---------------------------------------------------------------- over the run itself

#: Directions of the start that tangents are taken along.
COUNTS = (1, 8, 16)


def derivatives(choice: Choice) -> list[Row]:
    """Return the costs of a gradient by the adjoint and of tangents, in costs of the run.

    A gradient repeats the steps of a run and takes a cotangent of its end backwards. Tangents are
    computed during the run, along directions of its start. A quick choice measures one top.
    """
    cases: list[tuple[str, Callable[[], _Motion], float, int]] = [
        ("top, quaternions", _top, 1e-3, 100 if choice.quick else 2000)]
    if not choice.quick:
        cases += [("top, angles", _in_angles, 1e-3, 2000),
                  ("chain of 8", partial(_chain, 8), 2e-3, 200),
                  ("chain of 100", partial(_chain, 100), 2e-3, 20)]
    return [row for name, make, dt, steps in cases if choice.only in name for row in contest(
        name, [Entry("gyrospark", f"3-G-L Δt={dt:g}", partial(_costs, make, dt, steps))], choice)]


#: A stepper and the start of a run: q, p, parameters.
_Motion = tuple[gs.Stepper, Array, Array, Mapping[str, float]]


def _costs(make: Callable[[], _Motion], dt: float, steps: int) -> Prepared:
    step, q, p, values = make()
    run: dict[str, Any] = {"dt": dt, "steps": steps, "every": steps, "parameters": values}
    begin = with_children()
    random, end = np.random.default_rng(1), step.integrate(q, p, **run)
    ends = {"q": random.normal(size=step.n), "p": random.normal(size=step.n)}
    step.gradient(end, ends)
    built = with_children() - begin
    jobs: dict[str, Callable[[], object]] = {
        "run": partial(step.integrate, q, p, **run), "gradient": partial(step.gradient, end, ends)}
    for count in COUNTS:
        tangents = gs.Tangents(random.normal(size=(2 * step.n, count)), project=True)
        jobs[f"{count} tangents"] = partial(step.integrate, q, p, **run, tangents=tangents)
    return Prepared(
        {"derivatives built in (s)": built}, jobs,
        lambda seconds: {"µs/step": seconds["run"].median / steps * 1e6, **{
            f"{name} / run": sample.median / seconds["run"].median
            for name, sample in seconds.items() if name != "run"}})


def _top() -> _Motion:
    step, top = gs.stepper("G-L", 3, "gamma"), tops()[0]
    return step, *step.project(top.q, top.p, parameters=parameters()), parameters()


def _in_angles() -> _Motion:
    q, v = sp.symbols("phi theta psi"), sp.symbols("dphi dtheta dpsi")
    I1, I3, mgl = sp.symbols("I1 I3 mgl", positive=True)
    kinetic = (I1 * (v[1]**2 + v[0]**2 * sp.sin(q[1])**2)
               + I3 * (v[2] + v[0] * sp.cos(q[1]))**2) / 2
    step = gs.stepper("G-L", 3, system=gs.System.from_lagrangian(
        kinetic - mgl * sp.cos(q[1]), q, v, [I1, I3, mgl], name="top_in_angles"))
    start = np.array([0.0, math.pi / 6, 0.0])
    values = {"I1": INERTIA[0], "I3": INERTIA[2], "mgl": MGL}
    return step, start, step.momenta(start, [0, 0, 40 * math.pi], parameters=values), values


def _chain(rods: int) -> _Motion:
    model = gs.models.chain(rods)
    step = gs.stepper("G-L", 3, system=model)
    return (step, *step.project(model.q0, model.p0, parameters=model.parameters),
            model.parameters)
