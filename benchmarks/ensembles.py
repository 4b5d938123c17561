"""Many tops at once: cost of one trajectory and simulated second, by CPU and by wall time.

Eight tops of different tilt and spin, repeated; the error is that of the worst of them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from gyrospark._version import __version__
from gyrospark.api import stepper
from gyrospark.core.solver import Solver
from gyrospark.runtime.rigid_body.quaternion import angular_velocity
from gyrospark.runtime.steppers.stepper import Stepper

from .contest import ContestRow, Limits, judged
from .peers.entry import PeerEntry, Run
from .peers.heyoka_taylor import prepare_batch
from .peers.optional import version
from .timing import alternate
from .tops import FREE_RATE, INERTIA, LANES, TopState, parameters, tops

__all__ = ["EnsembleRow", "compare_ensembles", "ensemble_entries"]

#: Stages, time step, γ (None: γ_m), tolerance (None: round-off) and frame's rate of our rows.
_OURS: tuple[tuple[int, float, float | None, float | None, float], ...] = (
    (4, 1e-2, None, None, 0.0), (8, 1e-2, None, None, 0.0), (8, 2e-2, None, None, 0.0),
    (8, 2.5e-2, 1.1 * INERTIA[2], None, 0.0), (8, 2.5e-2, 1.1 * INERTIA[2], 1e-14, 0.0),
    (8, 4e-2, INERTIA[0], None, FREE_RATE), (8, 4e-2, INERTIA[0], 5e-15, FREE_RATE),
)
#: Order and time step of rows by compositions of exact flows.
_COMPOSED = ((4, 7.5e-3), (8, 2.5e-2), (10, 1.25e-2))
#: Lanes (None: the machine's SIMD width, as heyoka recommends it) and tolerance of its rows.
_BATCHES: tuple[tuple[int | None, str], ...] = (
    (None, "default"), (8, "default"), (None, "1e-14"), (None, "1e-12"), (None, "1e-9"),
)


@dataclass(frozen=True)
class EnsembleRow:
    """A row of the contest, its cost for each trajectory, and the wall time beside it.

    Attributes
    ----------
    row
        Errors of the worst trajectory; µs of CPU time for a trajectory's simulated second.
    wall_us_per_second
        The same in wall time, which workers shorten.
    wall_samples
        Wall seconds of every round.
    """

    row: ContestRow
    trajectories: int
    wall_us_per_second: float | None = None
    wall_samples: tuple[float, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self)


def ensemble_entries(count: int, *, quick: bool = False) -> list[PeerEntry]:
    """Return our ensembles with one and two workers, and heyoka's batches."""
    ours = [
        PeerEntry("gyrospark", __version__,
                  f"G-L s={stages} Δt={dt:g}{_note(gamma, tolerance, spin)}, {_workers(workers)}",
                  partial(_prepare, count, stages, dt, gamma, tolerance, spin, workers), dt,
                  stages < 8)
        for stages, dt, gamma, tolerance, spin in _OURS for workers in (1, 2)
    ]
    ours += [
        PeerEntry("gyrospark", __version__, f"splitting of order {order} Δt={dt:g}, 1 worker",
                  partial(_prepare_composed, count, order, dt), dt, order == 4)
        for order, dt in _COMPOSED
    ]
    theirs = [_batch(count, width, tol) for width, tol in _BATCHES]
    return [entry for entry in (*ours, *theirs) if entry.quick or not quick]


def _batch(count: int, width: int | None, tol: str) -> PeerEntry:
    options = {} if tol == "default" else {"tol": float(tol)}
    lanes = "SIMD width" if width is None else str(width)
    return PeerEntry("heyoka", version("heyoka"), f"batch of {lanes}, tol {tol}",
                     partial(prepare_batch, count, width, options), None, tol == "default")


def _workers(count: int) -> str:
    return "1 worker" if count == 1 else f"{count} workers"


def _note(gamma: float | None, tolerance: float | None, spin: float) -> str:
    named = "" if gamma is None else " γ=1.1I₃" if not spin else " γ=I₁ in its frame"
    return named + ("" if tolerance is None else f" tol {tolerance:g}")


def _prepare_composed(count: int, order: int, dt: float) -> Run:
    step = stepper("splitting", order=order, rep="gamma")
    return _run(step, count, dt, parameters(), 1, None)


def _prepare(
    count: int, stages: int, dt: float, gamma: float | None, tolerance: float | None,
    spin: float, workers: int,
) -> Run:
    step = stepper("G-L", stages, "gamma", frame="symmetries" if spin else None)
    values = parameters(gamma) | ({"omega_body": spin} if spin else {})
    return _run(step, count, dt, values, workers, tolerance)


def _run(
    step: Stepper, count: int, dt: float, values: dict[str, float], workers: int,
    tolerance: float | None,
) -> Run:
    starts = tops(count)
    q, p = np.array([top.q for top in starts]), np.array([top.p for top in starts])

    def run(t_end: float) -> TopState:
        steps = round(t_end / dt)
        ends = step.integrate_ensemble(q, p, dt=dt, steps=steps, every=max(steps, 1),
                                       parameters=values, workers=workers,
                                       solver=Solver("auto", tolerance=tolerance))
        for failure in ends.failures.values():
            raise failure
        last = np.asarray(ends.q[:, -1], dtype=np.float64)
        return TopState(last, angular_velocity(last, ends.p[:, -1], INERTIA))

    return run


def compare_ensembles(
    entries: Sequence[PeerEntry], limits: Limits, count: int = LANES,
    watch: Callable[[str], None] = lambda name: None,
) -> list[EnsembleRow]:
    """Return a row for each entry: alternately timed by process CPU time, then by wall time."""
    rows, runs = {}, {}
    for entry in entries:
        watch(entry.name)
        rows[entry.name], run = judged(entry, limits)
        if run is not None:
            runs[entry.name] = run
    amount = limits.t_end * count
    jobs = {name: partial(run, limits.t_end) for name, run in runs.items()}
    watch(f"{len(jobs)} entries in turn, {limits.rounds} rounds")
    cpu = alternate(jobs, limits.rounds, time.process_time)
    wall = alternate(jobs, limits.rounds, time.perf_counter)
    found = []
    for entry in entries:
        row = rows[entry.name]
        if entry.name not in jobs:
            found.append(EnsembleRow(row, count))
            continue
        sample = cpu[entry.name]
        cost = sample.per(amount).median
        row = replace(row, us_per_second=cost * 1e6, spread=sample.spread, span=limits.t_end,
                      ns_per_step=None if entry.dt is None else cost * entry.dt * 1e9,
                      samples=sample.seconds)
        elapsed = wall[entry.name]
        found.append(EnsembleRow(row, count, elapsed.per(amount).median * 1e6, elapsed.seconds))
    return found
