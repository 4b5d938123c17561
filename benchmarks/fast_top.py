"""The paper's fast top by gyrospark and other programs: cost, error, solvers, ensembles, drift.

    top         CPU time of a simulated second and errors at ``t_end``
    step        a step by each solver of gyrospark, over dense Newton
    ensemble    64 tops at once, by one and two workers, and by heyoka's batches
    drift       errors of energy and position at 1, 2, 5, 10, … s

Errors: distance of the mass centre from the reference in long double, |H − H₀|/|H₀|, ||q| − 1|; of
ensembles the largest of all tops.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

import gyrospark as gs

from .attitudes import angular_velocity
from .peers import entries
from .peers.entry import PeerEntry, Run
from .peers.heyoka_taylor import prepare_batch
from .peers.optional import Unavailable
from .reference_states import TIMES, distance
from .rows import Choice, Entry, Prepared, Row, contest
from .timing import Sample, stopwatch
from .tops import FREE_RATE, INERTIA, TopState, energy, parameters, state_of, tops

__all__ = ["drift", "drift_times", "ensemble", "errors_of", "step", "top"]

#: CPU seconds that a run to ``t_end`` may take, and those of a quick contest.
_MOST, _QUICK_MOST = 60.0, 2.0
#: Every time step divides it: simulated seconds of the run that foretells a long one's cost.
_SHORT = 0.2


def _end(choice: Choice, t_end: float) -> float:
    end = choice.t_end or (1.0 if choice.quick else t_end)
    if end not in TIMES:
        raise gs.InputError(f"There is no reference at t = {end:g} s; choose --t-end "
                            f"{', '.join(map(str, TIMES[:-1]))} or {TIMES[-1]}.")
    return end


def errors_of(end: TopState, t_end: float) -> dict[str, float]:
    """Return the largest errors of tops at ``t_end``."""
    q = np.atleast_2d(end.q)
    H0 = np.array([energy(state_of(top)) for top in tops(len(q))])
    position_error = {"dx (m)": float(distance(q, t_end).max())} if t_end in TIMES else {}
    return {**position_error, "ΔH/H": float(np.abs((np.atleast_1d(energy(end)) - H0) / H0).max()),
            "|q| − 1": float(np.abs((q**2).sum(axis=-1) - 1).max() / 2)}


def _arrived(run: Run, t_end: float, limit: float) -> TopState:
    """Return the end of a run, unless a short run foretells more than ``limit`` CPU seconds."""
    short = max(_SHORT, t_end / 100)
    expected = t_end / short * min(stopwatch(partial(run, short)) for _ in range(2))
    if expected > limit:
        raise Unavailable(f"not run to its end: {t_end:g} s take about {expected:.0f} s")
    return run(t_end)


def _prepared(entry: PeerEntry, t_end: float, limit: float, count: int = 1) -> Prepared:
    """Return the job of an entry and its errors; costs are of one of ``count`` tops."""
    run = entry.prepare()
    errors = errors_of(_arrived(run, t_end, limit), t_end)

    def costs(seconds: Mapping[str, Sample]) -> dict[str, float]:
        per_second = seconds["run"].per(t_end * count)
        steps = {} if entry.dt is None else {"ns/step": per_second.median * entry.dt * 1e9}
        wall = {"wall µs/s": per_second.wall * 1e6} if count > 1 else {}
        return {"CPU µs/s": per_second.median * 1e6, **wall, **steps}

    return Prepared(errors, {"run": partial(run, t_end)}, costs)


def _contest(case: str, entries: list[PeerEntry], choice: Choice, t_end: float, count: int = 1
             ) -> list[Row]:
    limit = _QUICK_MOST if choice.quick else _MOST
    return contest(case, [Entry(entry.program, entry.setting,
                                partial(_prepared, entry, t_end, limit, count), entry.quick)
                          for entry in entries], choice)


def top(choice: Choice) -> list[Row]:
    """Return cost and errors of each program and setting."""
    t_end = _end(choice, 10.0)
    return _contest(f"fast top, {t_end:g} s", entries(choice.programs), choice, t_end)


# ---------------------------------------------------------------- solvers


def step(choice: Choice) -> list[Row]:
    """Return the time of a step by each solver, over the same run."""
    methods: list[tuple[str, str, str, Callable[[], Any], tuple[int, ...]]] = [
        ("G-L γ", "G-L", "gamma", gs.problems.fast_top, (2, 3, 4, 6, 8)),
        ("G-L α", "G-L", "alpha", gs.problems.fast_top, (2, 3, 4, 6, 8)),
        ("LIIIA-B γ", "LIIIA-B", "gamma", gs.problems.fast_top, (3, 4, 6, 8)),
        ("asymmetric body γ", "G-L", "gamma", gs.problems.free_body, (2, 3, 4, 6, 8)),
        ("free body γ", "G-L", "gamma", partial(
            gs.problems.free_body, (0.002, 0.002, 0.0008), (0.0, 6.0, 125.0)), (2, 3, 4, 6, 8))]
    if choice.quick:
        methods = [(*methods[0][:4], (2, 3))]
    rows = []
    for name, scheme, rep, problem, counts in methods:
        for stages in counts:
            for dt in (1e-3,) if choice.quick else (1e-3, 1e-2):
                stepper = gs.stepper(scheme, stages, rep)  # type: ignore[arg-type]
                rows += contest(f"{name}, s={stages}, Δt={dt:g}", [
                    Entry("gyrospark", solver, partial(_solved, stepper, problem(), dt, solver))
                    for solver in ("newton", "auto", "fixed-point")], choice)
    return rows


def _solved(stepper: gs.Stepper, problem: Any, dt: float, solver: Any, steps: int = 200
            ) -> Prepared:
    values = {name: value for name, value in problem.parameters.items()
              if name in stepper.parameter_domains}

    def run(kind: Any) -> gs.Trajectory:
        return stepper.integrate(problem.q0, problem.p0, dt=dt, steps=steps, every=steps,
                                 parameters=values, solver=kind)

    end, newton = run(solver), run("newton")
    return Prepared({"iterations": float(end.report.iterations_mean),
                     "differs by": float(np.abs(end.q[-1] - newton.q[-1]).max())},
                    {"run": partial(run, solver)},
                    lambda seconds: {"ns/step": seconds["run"].median / steps * 1e9})


# ---------------------------------------------------------------- ensembles


def ensemble(choice: Choice) -> list[Row]:
    """Return the cost of a simulated second of one of many tops, by CPU and by wall time."""
    count, t_end = 8 if choice.quick else 64, _end(choice, 10.0)
    return _contest(f"{count} tops, {t_end:g} s", list(_ensembles(count)), choice, t_end, count)


def _ensembles(count: int) -> Iterator[PeerEntry]:
    near, frame = {"gamma": 1.1 * INERTIA[2]}, {"gamma": INERTIA[0], "omega_body": FREE_RATE}
    for stages, dt, values, tolerance, note in (
            (4, 1e-2, {}, None, ""), (8, 1e-2, {}, None, ""), (8, 2e-2, {}, None, ""),
            (8, 2.5e-2, near, None, ", γ=1.1I₃"), (8, 2.5e-2, near, 1e-14, ", γ=1.1I₃ tol 1e-14"),
            (8, 4e-2, frame, None, ", γ=I₁ in its frame"),
            (8, 4e-2, frame, 5e-15, ", γ=I₁ in its frame, tol 5e-15")):
        make = partial(gs.stepper, "G-L", stages, "gamma",
                       frame="symmetries" if values is frame else None)
        for workers in (1, 2):
            yield PeerEntry("gyrospark", f"G-L s={stages} {workers} workers Δt={dt:g}{note}",
                            partial(_many, make, count, dt, values, workers, tolerance), dt,
                            quick=stages == 4)
    for order, dt in ((4, 7.5e-3), (8, 2.5e-2), (10, 1.25e-2)):
        make = partial(gs.stepper, "splitting", order=order, rep="gamma")
        yield PeerEntry("gyrospark", f"splitting of order {order}, Δt={dt:g}",
                        partial(_many, make, count, dt, {}, 1, None), dt, quick=order == 4)
    for width, tol in ((None, "default"), (8, "default"), (None, "1e-14"), (None, "1e-12"),
                       (None, "1e-9")):
        lanes = "SIMD width" if width is None else str(width)
        options = {} if tol == "default" else {"tol": float(tol)}
        yield PeerEntry("heyoka", f"batch of {lanes}, tol {tol}",
                        partial(prepare_batch, count, width, options), quick=tol == "default")


def _many(make: Callable[[], gs.Stepper], count: int, dt: float, values: Mapping[str, float],
          workers: int, tolerance: float | None) -> Run:
    starts, stepper = tops(count), make()
    q, p = np.array([top.q for top in starts]), np.array([top.p for top in starts])

    def run(t_end: float) -> TopState:
        steps = round(t_end / dt)
        ends = stepper.integrate_ensemble(
            q, p, dt=dt, steps=steps, every=max(steps, 1), parameters={**parameters(), **values},
            workers=workers, solver=gs.Solver("auto", tolerance))
        for failure in ends.failures.values():
            raise failure
        q_end = np.asarray(ends.q[:, -1], dtype=np.float64)
        return TopState(q_end, angular_velocity(q_end, ends.p[:, -1], INERTIA))

    return run


# ---------------------------------------------------------------- drift


def drift(choice: Choice) -> list[Row]:
    """Return the errors of each entry at times evenly spread in the logarithm."""
    t_end, rows = _end(choice, 1000.0), []
    for entry in entries(choice.programs):
        if choice.quick and not entry.quick:
            continue
        choice.watch(entry.name)
        row = Row("fast top", entry.program, entry.setting)
        try:
            run = entry.prepare()
            for t in drift_times(t_end):
                errors = errors_of(_arrived(run, t, _QUICK_MOST if choice.quick else _MOST), t)
                rows.append(replace(row, numbers={"t (s)": t, **errors}))
        except Unavailable as reason:
            rows.append(replace(row, note=str(reason)))
        except Exception as error:  # other programs raise anything; their row has it
            rows.append(replace(row, note=f"failed: {error!r}",
                                failed=entry.program == "gyrospark"))
    return rows


def drift_times(t_end: float) -> list[float]:
    """Return 1, 2, 5, 10, ... up to t_end seconds, t_end included."""
    times = [float(m * 10**k) for k in range(6) for m in (1, 2, 5)]
    return [*(t for t in times if t < t_end), float(t_end)]
