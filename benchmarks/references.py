"""Other programs on the reference problems.

    SciPy    DOP853 at a tolerance, the state projected onto |q| = 1 or the surface, and the
             velocity onto its tangent, after every step
    heyoka   Taylor series, compiled for the equations, at a tolerance
    exudyn, MuJoCo    where the problem is bodies on joints, by ``reference_bodies``

SciPy and heyoka go where equations of motion need no multipliers. A package that is not installed
is left out with a sentence.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import gyrospark as gs
from gyrospark.references import Reference, WorkPrecisionRun

from . import equations
from .peers.optional import Unavailable, need
from .reference_bodies import largest_error, measure_bodies
from .rows import Choice, Row

__all__ = ["measure_peers", "page_of", "references"]

Array = NDArray[np.float64]
_TOLERANCES = (1e-6, 1e-9, 1e-12, 1e-14)


@dataclass(frozen=True)
class _PeerEquations:
    """Equations of motion, and the projection of a state onto its constraints."""

    motion: Callable[[], equations.Motion]
    back: Callable[[Array], Array]


def _on_surface(squares: Sequence[float]) -> Callable[[Array], Array]:
    """Return the projection of (q, v) onto Σ q²/b = 1 and its tangent: one step of Newton."""
    weights = 1 / np.array(squares)

    def back(state: Array) -> Array:
        q, v = state[:3], state[3:]
        normal = weights * q
        q = q - normal * ((q @ normal - 1) / (2 * normal @ normal))
        normal = weights * q
        return np.concatenate([q, v - normal * (v @ normal / (normal @ normal))])

    return back


def _unit(state: Array) -> Array:
    """Return (q, Ω) with |q| = 1."""
    return np.concatenate([state[:4] / np.linalg.norm(state[:4]), state[4:]])


_WAYS: Mapping[str, _PeerEquations] = {
    "kovalevskaya": _PeerEquations(equations.kovalevskaya, _unit),
    "goryachev-chaplygin": _PeerEquations(equations.goryachev_chaplygin, _unit),
    "neumann": _PeerEquations(equations.neumann, _on_surface((1, 1, 1))),
    "ellipsoid": _PeerEquations(equations.ellipsoid, _on_surface((1, 2, 4))),
}


def measure_peers(problem: Reference, *, rounds: int = 3, quick: bool = False,
                  watch: Callable[[str], None] = lambda text: None) -> Iterator[WorkPrecisionRun]:
    """Yield runs of a problem by peers; none where they cannot compute it.

    Parameters
    ----------
    problem, rounds
        As in ``gs.references.measure``.
    quick : bool
        As in ``measure_bodies``.
    watch : callable
        Called with a line for each program, and for a program that is left out.
    """
    if problem.name in _WAYS:
        yield from _measure_equations(problem, rounds, watch)
    yield from measure_bodies(problem, rounds=rounds, quick=quick, watch=watch)


def _measure_equations(problem: Reference, rounds: int,
                       watch: Callable[[str], None]) -> Iterator[WorkPrecisionRun]:
    for peer, prepare in (("SciPy", _scipy), ("heyoka", _heyoka)):
        watch(f"{problem.name}, {peer}")
        try:
            yield from _runs(problem, peer, prepare, rounds)
        except Unavailable as missing:
            watch(f"{peer} is left out: {missing}.")


Prepared = Callable[[], tuple[Array, int]]


def _runs(problem: Reference, peer: str,
          prepare: Callable[[_PeerEquations, float, float], Prepared],
          rounds: int) -> Iterator[WorkPrecisionRun]:
    true = [[problem.truth.value(name) for name in names] for names in problem.groups.values()]
    scheme = {"SciPy": "DOP853, projected", "heyoka": "Taylor"}[peer]
    for tolerance in _TOLERANCES:
        go = prepare(_WAYS[problem.name], tolerance, float(problem.seconds))
        seconds = []
        for _ in range(rounds):
            start = time.thread_time()
            end, steps = go()
            seconds.append(time.thread_time() - start)
        parts = np.split(end, [len(true[0])])
        error = max(largest_error(computed.tolist(), exact)
                    for computed, exact in zip(parts, true, strict=True))
        yield WorkPrecisionRun(problem.name, f"{scheme}, {tolerance:.0e}", steps, error,
                               statistics.median(seconds), {}, peer)


def _scipy(equations: _PeerEquations, tolerance: float, seconds: float) -> Prepared:
    integrate = need("scipy.integrate", "scipy")
    rates, start = equations.motion()
    initial = np.array([float(x) for x in start])

    def right(t: float, state: Array) -> Array:
        return np.array(rates(t, state.tolist()))

    def go() -> tuple[Array, int]:
        solver = integrate.DOP853(right, 0.0, initial, seconds, rtol=max(tolerance, 3e-14),
                                  atol=tolerance)
        steps = 0
        while solver.status == "running":
            solver.step()
            solver.y = equations.back(solver.y)
            solver.f = right(solver.t, solver.y)
            steps += 1
        return solver.y, steps

    return go


def _heyoka(equations: _PeerEquations, tolerance: float, seconds: float) -> Prepared:
    heyoka = need("heyoka")
    rates, start = equations.motion()
    initial = np.array([float(x) for x in start])
    variables = heyoka.make_vars(*(f"x{i}" for i in range(len(initial))))
    motion = heyoka.taylor_adaptive(list(zip(variables, rates(None, variables), strict=True)),
                                    initial, tol=max(tolerance, 2.3e-16))

    def go() -> tuple[Array, int]:
        motion.time = 0.0
        motion.state[:] = initial
        steps = motion.propagate_until(seconds)[3]
        return motion.state.copy(), int(steps)

    return go


# ---------------------------------------------------------------- rows and page


def references(choice: Choice) -> list[Row]:
    """Return the runs of all problems: error against CPU time."""
    rows = []
    for name in gs.references.names():
        if choice.only in name:
            problem, rounds = gs.references.reference(name), 1 if choice.quick else 3
            runs = [*gs.references.measure(problem, rounds=rounds, quick=choice.quick),
                    *(measure_peers(problem, rounds=rounds, quick=choice.quick,
                                    watch=choice.watch) if len(choice.programs) > 1 else ())]
            rows += [Row(name, run.peer or "gyrospark", run.scheme, {
                "CPU ms": run.cpu_seconds * 1e3, "steps": float(run.steps), "error": run.error,
                **run.invariants}) for run in runs]
    return rows


def page_of(rows: Sequence[Row], picture: str) -> str:
    """Return the page of the documents."""
    problems = {name: gs.references.reference(name) for name in dict.fromkeys(
        row.case for row in rows)}
    return gs.references.page([(problem, [WorkPrecisionRun(
        name, row.setting, int(row.numbers["steps"]), row.numbers["error"],
        row.numbers["CPU ms"] / 1e3, {key: value for key, value in row.numbers.items()
                                      if key not in ("CPU ms", "steps", "error")},
        "" if row.program == "gyrospark" else row.program) for row in rows if row.case == name])
        for name, problem in problems.items()], picture)
