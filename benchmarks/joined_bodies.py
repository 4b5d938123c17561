"""Bodies on joints beside another program: the chain of 8 and the closed four-bar.

Both start from the same numbers and run to ``T_END``; the error is the largest distance of a
centre of mass to a long-double reference, and the cost the CPU time of the whole run. Where the
other program goes as its step goes to 0, by Richardson's extrapolation of its two last halvings,
says independently of us whether the reference is right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from gyrospark._version import __version__
from gyrospark.api import stepper
from gyrospark.core.errors import GyrosparkError
from gyrospark.runtime.steppers.stepper import Stepper

from .peer_linkages import Array, Linkage, chain_of, closed_loop
from .peers import exudyn_bodies, mujoco_bodies, pydy_bodies
from .peers.optional import Unavailable, version
from .timing import alternate, repeated

__all__ = ["ACCURACIES", "PEERS", "T_END", "BodyRow", "Contest", "Run", "cheapest",
           "compare_bodies", "linkages"]

PEERS = ("gyrospark", "exudyn", "mujoco", "pydy")
T_END = 1.0
#: Errors in m for which the cheapest run of each program is looked up.
ACCURACIES = (1e-3, 1e-4, 1e-5, 1e-6)

#: Stages → time steps.
_OURS = {2: (2e-2, 1e-2, 5e-3, 2e-3, 1e-3), 3: (2e-2, 1e-2, 5e-3, 2e-3),
         4: (2e-2, 1e-2, 5e-3, 2e-3)}
_THEIRS = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4, 6.25e-5)
#: Stages and time step of the reference; it is trusted as far as half the step agrees.
_REFERENCE = (6, 1e-3)

#: A run to ``T_END`` that returns the centres of mass.
Run = Callable[[], Array]


@dataclass(frozen=True)
class BodyRow:
    """One program with one setting on one linkage; numbers are None where there is none.

    Attributes
    ----------
    family
        Program and method, without the time step.
    seconds, spread, us_per_step
        Median CPU seconds of a run to ``T_END``, the rounds' relative deviation, µs of a step.
    error
        Largest distance of a centre of mass to the reference at ``T_END``, in m.
    limit
        The same of Richardson's extrapolation with this row and the one of twice the time step:
        what is left is of the next order.
    reference_error
        How far the reference is from itself with half the step, in m.
    samples
        CPU seconds of every round, for so many ``times`` a run.
    """

    model: str
    peer: str
    version: str
    method: str
    dt: float | None = None
    order: int = 2
    seconds: float | None = None
    spread: float | None = None
    us_per_step: float | None = None
    error: float | None = None
    limit: float | None = None
    reference_error: float | None = None
    times: int = 1
    samples: tuple[float, ...] = ()
    note: str = ""
    failed: bool = False

    @property
    def family(self) -> str:
        """Program and method."""
        return f"{self.peer} {self.method}"

    @property
    def name(self) -> str:
        """Program, method and time step."""
        return self.family if self.dt is None else f"{self.family} Δt={self.dt:g}"

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self) | {"family": self.family}


@dataclass
class Contest:
    """The runs on one model, where they end, and their rows."""

    model: str
    reference: Array
    reference_error: float
    rows: list[BodyRow] = field(default_factory=list)
    runs: dict[str, Run] = field(default_factory=dict)
    ends: dict[str, Array] = field(default_factory=dict)

    def enter(self, row: BodyRow, run: Run) -> float:
        """Judge a run once and return its error; one that fails is a row that says why."""
        row = replace(row, reference_error=self.reference_error)
        try:
            self.ends[row.name] = end = run()
            row = replace(row, error=self.distance(end), limit=self._limit(row, end))
            self.runs[row.name] = run
        except GyrosparkError as error:
            row = replace(row, note=str(error), failed=True)
        except Exception as error:  # other programs raise what they like; it is their row
            row = replace(row, note=f"failed: {error!r}", failed=True)
        self.rows.append(row)
        return math.inf if row.error is None else row.error

    def distance(self, end: Array) -> float:
        """Return the largest distance of a centre of mass to the reference."""
        return float(np.linalg.norm(end - self.reference, axis=1).max())

    def _limit(self, row: BodyRow, end: Array) -> float | None:
        coarse = self.ends.get(replace(row, dt=2 * (row.dt or 0.0)).name)
        if coarse is None:
            return None
        return self.distance(end + (end - coarse) / (2**row.order - 1))

    def timed(self, rounds: int, least: float) -> list[BodyRow]:
        """Run all in turn and return the rows with their costs."""
        often = {name: repeated(run, least) for name, run in self.runs.items()}
        samples = alternate({name: job for name, (job, _) in often.items()}, rounds)
        found = []
        for row in self.rows:
            if row.name in samples:
                sample, times = samples[row.name], often[row.name][1]
                seconds = sample.median / times
                row = replace(row, seconds=seconds, spread=sample.spread, times=times,
                              us_per_step=seconds / _steps(row.dt) * 1e6 if row.dt else None,
                              samples=sample.seconds)
            found.append(row)
        return found


def linkages(*, quick: bool = False) -> list[Linkage]:
    """Return the chain of 8 and the four-bar; in a quick run a chain of 2 and the four-bar."""
    return [chain_of(2 if quick else 8), closed_loop()]


def compare_bodies(
    chosen: Sequence[Linkage], peers: Sequence[str], rounds: int, least: float, *,
    quick: bool = False, watch: Callable[[str], None] = lambda name: None,
) -> list[BodyRow]:
    """Return the rows of every linkage, all programs on it timed in turn."""
    found = []
    for linkage in chosen:
        watch(f"{linkage.name}: reference")
        contest = Contest(linkage.name, *_reference(linkage))
        if "gyrospark" in peers:
            for row, run in _ours(linkage, quick=quick):
                watch(f"{linkage.name}: {row.name}")
                contest.enter(row, run)
        for peer in (name for name in peers if name in _ENTER):
            row = BodyRow(linkage.name, peer, version(peer), "")
            watch(f"{linkage.name}: {peer}")
            try:
                _ENTER[peer](contest, linkage, row, quick=quick)
            except Unavailable as reason:
                contest.rows.append(replace(row, note=str(reason)))
            except Exception as error:  # such as code that does not compile: their row, as above
                contest.rows.append(replace(row, note=f"failed: {error!r}", failed=True))
        watch(f"{linkage.name}: {len(contest.runs)} runs in turn, {rounds} rounds")
        found += contest.timed(rounds, least)
    return found


def cheapest(rows: Sequence[BodyRow], model: str, peer: str, accuracy: float) -> BodyRow | None:
    """Return the row of a program that costs least of those with an error up to ``accuracy``."""
    fit = [row for row in rows if row.model == model and row.peer == peer
           and row.seconds is not None and row.error is not None and row.error <= accuracy]
    return min(fit, key=lambda row: row.seconds or 0.0, default=None)


def _reference(linkage: Linkage) -> tuple[Array, float]:
    stages, dt = _REFERENCE
    step = stepper("G-L", stages, system=linkage.model, real="long-double")
    model = linkage.model  # its start, rounded to double, is off by more than a long double allows
    start = step.project(model.q0, model.p0, parameters=model.parameters)
    ends = [_integrate(linkage, step, h, start) for h in (dt, dt / 2)]
    return ends[1], float(np.linalg.norm(ends[1] - ends[0], axis=1).max())


def _ours(linkage: Linkage, *, quick: bool) -> Iterator[tuple[BodyRow, Run]]:
    for stages, dts in ({2: (1e-2, 5e-3)} if quick else _OURS).items():
        step = stepper("G-L", stages, system=linkage.model)
        for dt in dts:
            yield (BodyRow(linkage.name, "gyrospark", __version__, f"G-L s={stages}", dt,
                           2 * stages), partial(_integrate, linkage, step, dt))


def _enter_exudyn(contest: Contest, linkage: Linkage, row: BodyRow, *, quick: bool) -> None:
    machine = exudyn_bodies.ExudynBodies(linkage)
    for solver in list(exudyn_bodies.SOLVERS)[: 1 if quick else None]:
        for dt in _THEIRS[:2] if quick else _THEIRS:
            contest.enter(replace(row, method=solver, dt=dt),
                          partial(machine.run, solver, dt, _steps(dt)))


def _enter_mujoco(contest: Contest, linkage: Linkage, row: BodyRow, *, quick: bool) -> None:
    """Halve the time step until nothing better is asked for."""
    machine = mujoco_bodies.MujocoBodies(linkage)
    for integrator in list(mujoco_bodies.INTEGRATORS)[: 1 if quick else None]:
        order = machine.order(integrator)
        for dt in _THEIRS[:2] if quick else _THEIRS:
            if contest.enter(replace(row, method=integrator, dt=dt, order=order),
                             machine.prepare(integrator, dt, _steps(dt))) <= ACCURACIES[-1]:
                break


def _enter_pydy(contest: Contest, linkage: Linkage, row: BodyRow, *, quick: bool) -> None:
    machine = pydy_bodies.PydyBodies(linkage)
    for tolerance in pydy_bodies.TOLERANCES[-1:] if quick else pydy_bodies.TOLERANCES:
        contest.enter(replace(row, method=f"DOP853 tol {tolerance:g}"),
                      partial(machine.run, tolerance, T_END))


#: How the runs of another program are entered.
_ENTER = {"exudyn": _enter_exudyn, "mujoco": _enter_mujoco, "pydy": _enter_pydy}


def _integrate(
    linkage: Linkage, step: Stepper, dt: float, start: tuple[Any, Any] | None = None
) -> Array:
    steps = _steps(dt)
    q, p = start or (linkage.model.q0, linkage.model.p0)
    end = step.integrate(q, p, dt=dt, steps=steps, every=steps,
                         parameters=linkage.model.parameters)
    return linkage.centres(end.q[-1])


def _steps(dt: float) -> int:
    return round(T_END / dt)
