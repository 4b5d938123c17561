"""Gradients beside other programs: error against cost, ``make bench WHAT="gradients"``.

    fast top      |q(2 s) − q*|² with q* = (½, ½, ½, ½), by the start, I1, I2, I3 and mgl
    four-bar      |x(1 s)|² of the last body's centre of mass, by the start, gravity and masses
    chain of 8    the same

Each program has the equations that suit it; its derivatives by (q, p) are compared as ours are,
by coordinates of the tangent space at the start. Truth is our gradient in long double. What is
timed is value and gradient together, and beside it a run alone: CPU time, contestants in turn.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gyrospark._version import __version__
from gyrospark.api import stepper
from gyrospark.core.errors import GyrosparkError
from gyrospark.runtime.derivatives.tangent_space import Tangents, TangentSpace
from gyrospark.runtime.steppers.stepper import Stepper

from .peer_linkages import Linkage, chain_of, closed_loop
from .peers import casadi_gradients, diffrax_gradients, heyoka_gradients, mujoco_gradients
from .peers.gradient_job import GradientJob, Job
from .peers.optional import Unavailable, version
from .timing import Sample, alternate, repeated, with_children
from .tops import parameters, tops

__all__ = ["PEERS", "FastTopGradient", "GradientRow", "LinkageGradient", "compare_gradients",
           "gradient_cases"]

Array = NDArray[Any]

#: Programs with gradients; of some pip knows another name.
PEERS = ("gyrospark", "heyoka", "diffrax", "casadi", "mujoco")
#: Stages → time steps.
_OURS = {3: (1e-3, 2e-3, 4e-3), 4: (1e-3, 2e-3, 4e-3), 5: (8e-3,), 6: (5e-3, 1e-2)}
#: Stages and time step of the truth; half the step tells its error.
_TRUTH = (6, 4e-3)


@dataclass(frozen=True)
class GradientRow:
    """One program with one setting; numbers are None where there is none.

    Attributes
    ----------
    gradient, primal
        CPU seconds of each round: value and gradient, and a run alone.
    built
        CPU seconds until the first gradient, of compilers too; what was compiled before is not
        again.
    by_start, by_parameters
        Largest errors of the gradient by the start, and of θ ∂/∂θ, relative to the largest entry.
    truth_error
        The larger of these two between the truth and itself with half the time step.
    """

    case: str
    peer: str
    version: str
    setting: str
    gradient: tuple[float, ...] = ()
    primal: tuple[float, ...] = ()
    built: float | None = None
    by_start: float | None = None
    by_parameters: float | None = None
    truth_error: float | None = None
    note: str = ""
    failed: bool = False

    @property
    def name(self) -> str:
        """Program and setting."""
        return f"{self.peer} {self.setting}"

    @property
    def family(self) -> str:
        """Program and method, without time step and tolerance."""
        return " ".join(word for word in self.name.split()
                        if not word.startswith(("Δt=", "tol", "1e-")))

    @property
    def error(self) -> float | None:
        """The larger error."""
        return max((x for x in (self.by_start, self.by_parameters) if x is not None), default=None)

    def median(self, what: str) -> float | None:
        """Return the median seconds of "gradient" or "primal"."""
        seconds: tuple[float, ...] = getattr(self, what)
        return Sample(seconds).median if seconds else None

    @property
    def spread(self) -> float | None:
        """Median distance of the gradient's seconds from their median, relative to it."""
        return Sample(self.gradient).spread if self.gradient else None

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self)


class _Case:
    """A motion, a loss |z_i(T) − z*|² of some coordinates, and what it is differentiated by."""

    name: str
    t_end: float
    q0: Array
    p0: Array
    values: Mapping[str, float]
    #: Parameters that the gradient is taken by.
    wrt: tuple[str, ...]
    #: Coordinates of the loss, and what they are compared with.
    watched: slice
    target: Array

    def make(self, stages: int, real: Any = "double") -> Stepper:
        """Return our stepper."""
        raise NotImplementedError

    def others(self, *, quick: bool) -> Iterator[tuple[str, str, Callable[[], Job]]]:
        """Yield program, setting, and what prepares its gradient."""
        raise NotImplementedError

    def loss(self, run: Any) -> tuple[Any, dict[str, Array]]:
        """Return the loss of a run and its cotangents."""
        away = run.q[-1][self.watched] - self.target
        by_q = np.zeros_like(run.q[-1])
        by_q[self.watched] = 2 * away
        return away @ away, {"q": by_q}

    def _run(self, dt: float) -> dict[str, Any]:
        steps = round(self.t_end / dt)
        return {"dt": dt, "steps": steps, "every": steps, "parameters": self.values}

    def _start(self, step: Stepper) -> tuple[Array, Array]:
        return step.project(self.q0, self.p0, parameters=self.values)

    def ours(self, stages: int, dt: float, real: Any = "double") -> Job:
        """Return our gradient by the adjoint: the run, and backwards through its steps."""
        step = self.make(stages, real)
        q, p = self._start(step)

        def gradient() -> GradientJob:
            found = step.gradient(step.integrate(q, p, **self._run(dt)), loss=self.loss)
            return GradientJob(found.q, found.p, [found[name] for name in self.wrt])

        return Job(gradient, lambda: step.integrate(q, p, **self._run(dt)))

    def our_tangents(self, stages: int, dt: float) -> Job:
        """Return our gradient by tangents along all directions of the start and parameters."""
        step = self.make(stages)
        q, p = self._start(step)
        wanted, space = Tangents(parameters=self.wrt), self._space
        basis = space.basis()

        def gradient() -> GradientJob:
            run = step.integrate(q, p, **self._run(dt), tangents=wanted)
            columns = self.loss(run)[1]["q"] @ run.tangents.q[-1]
            split = len(columns) - len(self.wrt)
            by_start = np.zeros(space.binding.rows)
            by_start[: 2 * step.n] = basis @ columns[:split]
            by_start = space.pulled_back(by_start)  # else parameters would move it once more
            return GradientJob(by_start[: step.n], by_start[step.n : 2 * step.n], columns[split:])

        return Job(gradient, lambda: step.integrate(q, p, **self._run(dt)))

    # ------------------------------------------------------------ how far it is off

    @cached_property
    def _space(self) -> TangentSpace:
        """The tangent space at the start, in double."""
        step = self.make(3)
        q, p = self._start(step)
        binding = step.derivative_binding()
        given = step.resolved(step.run_arguments(q, p, dt=1e-3, steps=0, t0=0.0,
                                                 parameters=dict(self.values)))
        self._names = binding.own.parameter_names
        return TangentSpace(binding, binding.own.parameters(given.parameters, given.t0), q, p,
                            step.constraint_names)

    def vector(self, found: GradientJob) -> tuple[Array, Array]:
        """Return the gradient by coordinates of the tangent space, and θ ∂/∂θ.

        Parameters that move the constraints move the start too, as ``consistent`` does.
        """
        space, n = self._space, self._space.n
        z_bar = np.zeros(space.binding.rows)
        z_bar[:n], z_bar[n : 2 * n] = (np.asarray(x, dtype=float) for x in (found.q, found.p))
        places = [2 * n + self._names.index(name) for name in self.wrt]
        if found.parameters is not None:
            z_bar[places] = np.asarray(found.parameters, dtype=float)
        z_bar = space.pulled_back(z_bar)
        scaled = z_bar[places] * [self.values[name] for name in self.wrt]
        return space.basis().T @ z_bar[: 2 * n], scaled

    @cached_property
    def truth(self) -> tuple[tuple[Array, Array], float]:
        """The gradient in long double, and how far it is from itself with half the step."""
        stages, dt = _TRUTH
        coarse, fine = (self.vector(self.ours(stages, h, "long-double").gradient())
                        for h in (dt, dt / 2))
        return fine, max(_off(x, y) for x, y in zip(coarse, fine, strict=True))

    def errors(self, found: GradientJob) -> tuple[float, float | None]:
        """Return the relative errors by the start, and by the parameters where it has these."""
        (start, scaled), _ = self.truth
        mine = self.vector(found)
        return _off(mine[0], start), (
            None if found.parameters is None else _off(mine[1], scaled))


def _off(found: Array, truth: Array) -> float:
    return float(np.abs(found - truth).max() / np.abs(truth).max())


class FastTopGradient(_Case):
    """The paper's top (80); peers have Euler's equations in (q, Ω)."""

    name = "fast top"
    wrt = ("I1", "I2", "I3", "mgl")
    watched = slice(0, 4)
    target = np.full(4, 0.5)

    def __init__(self, t_end: float = 2.0) -> None:
        top = tops()[0]
        self.t_end, self.q0, self.p0, self.values = t_end, top.q, top.p, parameters()

    def make(self, stages: int, real: Any = "double") -> Stepper:
        """Return the heavy top's stepper."""
        return stepper("G-L", stages, "gamma", real=real)

    def others(self, *, quick: bool) -> Iterator[tuple[str, str, Callable[[], Job]]]:
        """Yield heyoka, diffrax, CasADi and MuJoCo."""
        for peer, module in (("heyoka", heyoka_gradients), ("diffrax", diffrax_gradients),
                             ("casadi", casadi_gradients), ("mujoco", mujoco_gradients)):
            settings = module.of_top(self.t_end, self.target)
            for setting in list(settings)[: 1 if quick else None]:
                yield peer, setting, settings[setting]


class LinkageGradient(_Case):
    """Bodies on joints; peers have our (q, p) and H, or build their own bodies."""

    target = np.zeros(3)

    def __init__(self, linkage: Linkage, t_end: float = 1.0) -> None:
        model = linkage.model
        self.linkage, self.name, self.t_end = linkage, linkage.name, t_end
        self.q0, self.p0, self.values = model.q0, model.p0, model.parameters
        n = len(self.q0)
        self.watched = slice(n - 3, n)
        self.wrt = tuple(name for name in model.parameters
                         if name.startswith("gravity") or name.endswith("_m"))

    def make(self, stages: int, real: Any = "double") -> Stepper:
        """Return the model's stepper."""
        return stepper("G-L", stages, system=self.linkage.model, real=real)

    def others(self, *, quick: bool) -> Iterator[tuple[str, str, Callable[[], Job]]]:
        """Yield CasADi and MuJoCo."""
        for peer, module in (("casadi", casadi_gradients), ("mujoco", mujoco_gradients)):
            settings = module.of_linkage(self.linkage, self.wrt, self.t_end)
            for setting in list(settings)[: 1 if quick else None]:
                yield peer, setting, settings[setting]


def gradient_cases(*, quick: bool = False) -> list[_Case]:
    """Return the three; in a quick run a fifth of a second of the fast top."""
    if quick:
        return [FastTopGradient(0.2)]
    return [FastTopGradient(), LinkageGradient(closed_loop()), LinkageGradient(chain_of(8))]


def compare_gradients(
    cases: Sequence[_Case], peers: Sequence[str], rounds: int, least: float, *,
    quick: bool = False, watch: Callable[[str], None] = lambda name: None,
) -> list[GradientRow]:
    """Return a row for each case, program and setting; those of a case take turns."""
    rows = []
    for case in cases:
        makers: dict[tuple[str, str], Callable[[], Job]] = {}
        if "gyrospark" in peers:
            makers |= {("gyrospark", name): make for name, make in _ours(case, quick=quick)}
        makers |= {(peer, setting): make for peer, setting, make in case.others(quick=quick)
                   if peer in peers}
        rows += _rows_of(case, makers, rounds, least, watch)
    return rows


def _ours(case: _Case, *, quick: bool) -> Iterator[tuple[str, Callable[[], Job]]]:
    for stages, dts in ({3: (4e-3,)} if quick else _OURS).items():
        for dt in dts:
            yield f"G-L s={stages} Δt={dt:g} adjoint", partial(case.ours, stages, dt)
    dt = 4e-3 if quick else 1e-3
    yield f"G-L s=3 Δt={dt:g} tangents", partial(case.our_tangents, 3, dt)


def _rows_of(
    case: _Case, makers: Mapping[tuple[str, str], Callable[[], Job]], rounds: int, least: float,
    watch: Callable[[str], None],
) -> list[GradientRow]:
    rows: dict[str, GradientRow] = {}
    jobs: dict[str, Callable[[], object]] = {}
    often: dict[str, int] = {}
    watch(f"{case.name}: truth")
    truth_error = case.truth[1]
    for (peer, setting), make in makers.items():
        number = __version__ if peer == "gyrospark" else version(peer)
        row = GradientRow(case.name, peer, number, setting, truth_error=truth_error)
        watch(f"{case.name}: {row.name}")
        start = with_children()
        try:
            job = make()
            found = job.gradient()
            built = with_children() - start
            by_start, by_parameters = case.errors(found)
            for what in ("gradient", "primal"):
                name = f"{row.name} {what}"
                jobs[name], often[name] = repeated(getattr(job, what), least)
        except Unavailable as reason:
            row = replace(row, note=str(reason))
        except Exception as error:  # other programs raise what they like; it is their row
            note = str(error) if isinstance(error, GyrosparkError) else f"failed: {error!r}"
            row = replace(row, note=note, failed=True)
        else:
            row = replace(row, built=built, by_start=by_start, by_parameters=by_parameters)
        rows[row.name] = row
    watch(f"{case.name}: all in turn")
    samples = alternate(jobs, rounds, time.process_time)  # what worker threads do counts too
    return [_timed(row, samples, often) for row in rows.values()]


def _timed(
    row: GradientRow, samples: Mapping[str, Sample], often: Mapping[str, int]
) -> GradientRow:
    if row.by_start is None:
        return row
    gradient, primal = (samples[name].per(often[name]).seconds for name in (
        f"{row.name} gradient", f"{row.name} primal"))
    return replace(row, gradient=gradient, primal=primal)
