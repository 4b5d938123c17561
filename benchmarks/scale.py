"""How costs grow: with bodies, with stages, with trajectories, with stored numbers.

    bodies          chains of N bodies: model, derivation, C compiler, a call of one step, a step
    stages          G-L of s stages on the fast top: the same costs except the model
    trajectories    an ensemble of fast tops, ten steps each: the call, its largest memory
    numbers         a run of the fast top that stores every state: the run, a read of 1000 of its
                    states, the largest memory of this read

Times are CPU seconds, of all threads and child processes; derivation and compilation begin in a
new process with an empty cache. The law of a cost is the slope of log(cost) against log(size):
1 for linear growth. A size for which the disk has no room is left out, and its row has a note.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import tracemalloc
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import gyrospark as gs

from .rows import Choice, Row, power_laws
from .timing import stopwatch, with_children

__all__ = ["build_seconds", "laws", "scale"]

#: Axis → its sizes; of a quick run.
SIZES: dict[str, tuple[int, ...]] = {
    "bodies": (1, 2, 4, 8, 16, 32, 64, 100, 300, 1000), "stages": (2, 3, 4, 6, 8, 12),
    "trajectories": (100, 1000, 10_000, 100_000), "numbers": (10**6, 10**7, 10**8, 10**9)}
QUICK: dict[str, tuple[int, ...]] = {
    "bodies": (1, 2), "stages": (2, 3), "trajectories": (100, 1000), "numbers": (10**5, 10**6)}
STEPS, READ = 1000, 1000
#: An upper bound of a store's bytes for each of its numbers.
_BYTES = 10
#: Bodies from which on a law is fitted: below, costs that all sizes have in common weigh more.
_LAW_FROM = {"bodies": 8}
_ROOT = Path(__file__).resolve().parents[1]
#: A small system first, so that imports are not measured.
_BUILD = """
import json, os, sys, time
import gyrospark as gs
import sympy as sp
q, p, k = sp.symbols("q p k")
gs.stepper("G-L", 1, system=gs.System((q,), (p,), (k,), p**2/2 + k*q**2, name="first"))
def clock():
    used = os.times()
    return time.process_time(), used.children_user + used.children_system
what, size = sys.argv[1], int(sys.argv[2])
times = [clock()]
model = gs.models.chain(size) if what == "bodies" else None
times.append(clock())
if what == "bodies":
    gs.stepper("G-L", 3, system=model)
else:  # a type of which no stepper is in the package
    gs.stepper("G-L", size, "gamma", real="long-double")
times.append(clock())
print(json.dumps([times[1][0] - times[0][0], times[2][0] - times[1][0],
                  times[2][1] - times[1][1]]))
"""


def scale(choice: Choice) -> list[Row]:
    """Return a row for each size on each axis: medians of three rounds at most."""
    rounds = min(choice.rounds, 3)
    measure: dict[str, Callable[[int], dict[str, float]]] = {
        "bodies": _chain, "stages": _stages, "trajectories": _trajectories}
    rows = []
    for axis, sizes in (QUICK if choice.quick else SIZES).items():
        for size in sizes if choice.only in axis else ():
            choice.watch(f"{size:,} {axis}")
            row = Row(axis, "gyrospark", f"{size:,}", {"size": float(size)})
            if axis in measure:
                costs = [measure[axis](size) for _ in range(rounds)]
                row.numbers.update({name: statistics.median(sample[name] for sample in costs)
                                    for name in costs[0]})
            else:
                row = _stored(row, size)
            rows.append(row)
    return rows


def laws(rows: list[Row]) -> list[Row]:
    """Return a row with the slopes of each axis."""
    law_rows = []
    for axis in dict.fromkeys(row.case for row in rows):
        points = {row.numbers["size"]: row.numbers for row in rows if row.case == axis}
        slopes = power_laws(points, _LAW_FROM.get(axis, 0))
        law_rows.append(Row(axis, "gyrospark", "slope", {
            name: slope for name, slope in slopes.items() if name != "size"}))
    return law_rows


def build_seconds(kind: str, size: int) -> tuple[float, float, float]:
    """Return CPU seconds of model, derivation and compilers in a new process without a cache."""
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.run([sys.executable, "-c", _BUILD, kind, str(size)], check=True,
                                 capture_output=True, text=True, cwd=_ROOT,
                                 env={**os.environ, "GYROSPARK_CACHE": folder})
    model, derive, compiling = json.loads(process.stdout.splitlines()[-1])
    return model, derive, compiling


def _chain(count: int) -> dict[str, float]:
    seconds = dict(zip(("model (s)", "derive (s)", "compile (s)"),
                       build_seconds("bodies", count), strict=True))
    model = gs.models.chain(count)
    step = gs.stepper("G-L", 3, system=model)
    run: dict[str, Any] = {"dt": 2e-3, "parameters": model.parameters}
    report = step.integrate(model.q0, model.p0, steps=STEPS, every=STEPS, **run).report
    return {**seconds, **_steps(step, model.q0, model.p0, run),
            "iterations": report.iterations_mean, "|g|": report.constraint_max,
            "|g_q H_p|": report.momentum_constraint_max,
            "ΔH/H": report.energy_error_max / abs(report.energy_start)}


def _stages(count: int) -> dict[str, float]:
    _, derive, compiling = build_seconds("stages", count)
    top = gs.problems.fast_top()
    return {"derive (s)": derive, "compile (s)": compiling, **_steps(
        gs.stepper("G-L", count, "gamma"), top.q0, top.p0, _run())}


def _steps(step: gs.Stepper, q: Any, p: Any, run: dict[str, Any]) -> dict[str, float]:
    """Return the seconds of a call of one step, and of a step of many."""
    step.integrate(q, p, steps=2, **run)
    return {name: statistics.median(stopwatch(partial(
        step.integrate, q, p, steps=steps, every=steps, **run)) / steps for _ in range(5))
        for name, steps in (("call of a step (s)", 1), ("step (s)", STEPS))}


def _trajectories(count: int) -> dict[str, float]:
    step, top = gs.stepper("G-L", 3, "gamma"), gs.problems.fast_top()
    states = [np.repeat(np.array(x)[None], count, axis=0) for x in (top.q0, top.p0)]

    def call() -> object:
        return step.integrate_ensemble(*states, steps=10, **_run())

    step.integrate_ensemble(*(x[:9] for x in states), steps=1, **_run())
    seconds = stopwatch(call, with_children)
    return {"call (s)": seconds, "each (s)": seconds / count, "memory (B)": _memory(call)}


def _stored(row: Row, numbers: int) -> Row:
    with tempfile.TemporaryDirectory(prefix="gyrospark-scale-") as folder:
        free = shutil.disk_usage(folder).free
        if free < _BYTES * numbers:
            return Row(row.case, row.program, row.setting, row.numbers,
                       note=f"{_BYTES * numbers:,} B are needed and {free:,} B free")
        step, top = gs.stepper("G-L", 3, "gamma"), gs.problems.fast_top()
        trajectory = step.integrate(top.q0, top.p0, steps=1, **_run())
        width = sum(x[0].size for x in (trajectory.q, trajectory.p, trajectory.multipliers)) + 5
        steps, path = max(numbers // width, READ), Path(folder) / "run.zarr"
        begin = with_children()
        stored = step.integrate(top.q0, top.p0, out=path, steps=steps, **_run())
        seconds = with_children() - begin

        def read() -> object:
            return stored[::max(steps // READ, 1)]

        row.numbers.update({
            "run (s)": seconds, "disk (B)": float(sum(
                file.stat().st_size for file in path.rglob("*") if file.is_file())),
            "read (s)": stopwatch(read, with_children), "read memory (B)": _memory(read)})
    return row


def _run() -> dict[str, Any]:
    return {"dt": 1e-3, "parameters": gs.problems.fast_top().parameters}


def _memory(call: Callable[[], object]) -> float:
    """Return the largest memory in bytes of Python and of arrays while a call runs."""
    tracemalloc.start()
    try:
        call()
        return float(tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()
