"""How costs grow: with bodies, with stages, with trajectories, with stored numbers.

    bodies          chains of N bodies: model, derivation, C compiler, a call of one step, a step
    stages          G-L of s stages on the fast top: the same, but for the model
    trajectories    an ensemble of so many fast tops, ten steps each: the call, its largest memory
    numbers         a run of the fast top that stores every state: the run, a read of 1000 of its
                    states, the largest memory of this read

Times are CPU seconds, of all threads and child processes. The law of a cost is the slope of
log(cost) against log(size) over all its sizes: 1 for linear growth. A size for which the disk has
no room is left out, and its row says so.
"""

from __future__ import annotations

import math
import shutil
import statistics
import tempfile
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gyrospark.api import stepper
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.runtime.rigid_body.problems import fast_top
from gyrospark.storage.record import record

from .growth import compile_seconds, forget, grow
from .timing import stopwatch, with_children

__all__ = ["QUICK", "SIZES", "Scale", "compare_scales", "page", "slopes", "tables"]

#: Axis → its sizes.
SIZES: dict[str, tuple[int, ...]] = {
    "bodies": (10, 30, 100, 300, 1000), "stages": (2, 3, 4, 6, 8, 12),
    "trajectories": (100, 1000, 10_000, 100_000),
    "numbers": (10**6, 10**7, 10**8, 10**9)}
QUICK: dict[str, tuple[int, ...]] = {
    "bodies": (2, 4), "stages": (2, 3), "trajectories": (100, 1000),
    "numbers": (10**5, 10**6)}
DT, STEPS, MEMBER_STEPS, READ = 1e-3, 1000, 10, 1000
_BYTE_COSTS = {"memory", "read memory", "disk"}
#: A store takes less than so many bytes for each of its numbers.
_BYTES = 10


@dataclass(frozen=True)
class Scale:
    """The costs of one size on an axis: CPU seconds; "memory", "read memory", "disk": bytes."""

    axis: str
    size: int
    costs: dict[str, float] = field(default_factory=dict)
    note: str = ""
    failed: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self)


def compare_scales(
    sizes: dict[str, tuple[int, ...]], rounds: int, least: float,
    watch: Callable[[str], None] = lambda name: None, folder: Path | None = None,
) -> list[Scale]:
    """Return a row for each size on each axis; medians of ``rounds`` rounds, of three at most."""
    few = min(rounds, 3)
    found = [
        Scale("bodies", row.bodies, {
            name: value for name, value in (
                ("model", row.model_s), ("derive", row.generate_s), ("compile", row.compile_s),
                ("call of a step", row.call_s),
                ("step", row.us_per_step and row.us_per_step * 1e-6)) if value},
            row.note, row.failed)
        for row in grow(sizes["bodies"], STEPS, few, least, watch)]
    for axis, measure in (("stages", _stages), ("trajectories", _trajectories)):
        for size in sizes[axis]:
            watch(f"{size:,} {axis}")
            found.append(Scale(axis, size, _median([measure(size) for _ in range(few)])))
    with tempfile.TemporaryDirectory(prefix="gyrospark-scale-", dir=folder) as name:
        for size in sizes["numbers"]:
            watch(f"{size:,} numbers")
            free = shutil.disk_usage(name).free
            if free < _BYTES * size:
                found.append(Scale("numbers", size, note=f"{_text(_BYTES * size)}B are "
                                   f"needed and {_text(free)}B free"))
            else:
                found.append(Scale("numbers", size, _stored(size, Path(name) / "run.zarr")))
    return found


def slopes(rows: Sequence[Scale], axis: str) -> dict[str, float]:
    """Return the slope of log(cost) against log(size) of each cost that two sizes have."""
    found = {}
    for name in _costs(rows, axis):
        points = [(row.size, row.costs[name]) for row in rows
                  if row.axis == axis and row.costs.get(name)]
        if len(points) > 1:
            x, y = np.log(np.array(points, dtype=float)).T
            found[name] = float(np.polyfit(x, y, 1)[0])
    return found


def tables(rows: Sequence[Scale]) -> dict[str, list[list[str]]]:
    """Return a table for each axis: its head, a line for each size, and the slopes."""
    made = {}
    for axis in dict.fromkeys(row.axis for row in rows):
        names, found = _costs(rows, axis), slopes(rows, axis)
        lines = [[axis, *names]]
        for row in rows:
            if row.axis == axis:
                cells = [_shown(name, row.costs.get(name)) for name in names]
                lines.append([f"{row.size:,}" + (f" ({row.note})" if row.note else ""), *cells])
        lines.append(["slope", *(f"{found[name]:.2f}" if name in found else "–"
                                 for name in names)])
        made[axis] = lines
    return made


_PAGE = """# How costs grow

`make bench WHAT="scale --out DIR"` measures the costs below and writes this page as `DIR/scale.md`;
without `--largest` it takes up to 1000 bodies, 12 stages, 1e5 trajectories and 1e9 stored numbers.
These are the results of

    make bench WHAT="scale{options} --out DIR"

on {machine}. Times are CPU seconds of all threads
and of the compiler, medians of at most three rounds. The slope is that of log(cost) against
log(size): 1 is linear growth. Every size of a chain and every number of stages is derived and
compiled without a cache.

- **bodies**: a chain of bodies, 3-G-L; *step* is one of {steps} steps of 2 ms, *call of a step* an
  `integrate` of one step.
- **stages**: G-L on the fast top, Δt = 1 ms; *step* is one of {steps} steps.
- **trajectories**: `integrate_ensemble` of fast tops, 3-G-L, {members} steps.
- **numbers**: a run of the fast top that stores every state, so many numbers in all; *read* are
  {read} of its states by `Recording.trajectory(thin=...)`, *read memory* is the largest memory of
  that call, *disk* the size of the store.
"""


def page(rows: Sequence[Scale], machine: str, options: str) -> str:
    """Return the page with all tables, in Markdown; ``options`` are those of the command."""
    parts = [_PAGE.format(options=options, machine=machine, steps=STEPS, members=MEMBER_STEPS,
                          read=READ)]
    for axis, (head, *lines) in tables(rows).items():
        table = [head, ["---"] + ["---:"] * (len(head) - 1), *lines]
        parts.append(f"## {axis.capitalize()}\n\n"
                     + "".join(f"| {' | '.join(cells)} |\n" for cells in table))
    return "\n".join(parts)


# ---------------------------------------------------------------- measure


def _median(rounds: Sequence[dict[str, float]]) -> dict[str, float]:
    return {name: statistics.median(one[name] for one in rounds) for name in rounds[0]}


def _stages(count: int) -> dict[str, float]:
    forget()
    seconds = {}
    began = with_children()
    made = generate(Spec.checked("G-L", count, "gamma"))
    seconds["derive"] = with_children() - began
    seconds["compile"] = compile_seconds(made)
    step = stepper("G-L", count, "gamma")
    top, run = fast_top(), _run()
    step.integrate(top.q0, top.p0, steps=2, **run)
    for name, steps in (("call of a step", 1), ("step", STEPS)):
        job = partial(step.integrate, top.q0, top.p0, steps=steps, every=steps, **run)
        seconds[name] = statistics.median(stopwatch(job) / steps for _ in range(5))
    return seconds


def _trajectories(count: int) -> dict[str, float]:
    step, top = stepper("G-L", 3, "gamma"), fast_top()
    states = [np.repeat(np.array(x)[None], count, axis=0) for x in (top.q0, top.p0)]

    def call() -> object:
        return step.integrate_ensemble(*states, steps=MEMBER_STEPS, **_run())

    step.integrate_ensemble(*(x[:9] for x in states), steps=1, **_run())
    seconds = stopwatch(call, with_children)
    return {"call": seconds, "for each": seconds / count, "memory": _memory(call)}


def _stored(numbers: int, path: Path) -> dict[str, float]:
    step, top = stepper("G-L", 3, "gamma"), fast_top()
    probe = step.integrate(top.q0, top.p0, steps=1, **_run())
    width = sum(x[0].size for x in (probe.q, probe.p, probe.multipliers)) + 5
    steps = max(numbers // width, READ)
    begin = with_children()
    recording = record(step, top.q0, top.p0, out=path, steps=steps, **_run())
    seconds = with_children() - begin
    size = sum(p.stat().st_size for p in path.rglob("*") if p.is_file())

    def read() -> object:
        return recording.trajectory(thin=max(steps // READ, 1))

    found = {"run": seconds, "disk": float(size), "read": stopwatch(read, with_children),
             "read memory": _memory(read)}
    shutil.rmtree(path)
    return found


def _run() -> dict[str, Any]:
    return {"dt": DT, "parameters": fast_top().parameters | {"gamma": "m"}}


def _memory(call: Callable[[], object]) -> float:
    """Return the largest memory in bytes of Python and of arrays while a call runs."""
    tracemalloc.start()
    try:
        call()
        return float(tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()


# ---------------------------------------------------------------- text


def _costs(rows: Sequence[Scale], axis: str) -> list[str]:
    return list(dict.fromkeys(name for row in rows if row.axis == axis for name in row.costs))


def _shown(name: str, value: float | None) -> str:
    if value is None:
        return "–"
    return _text(value) + ("B" if name in _BYTE_COSTS else "s")


def _text(value: float) -> str:
    """Return a number with a prefix of its unit: 0.0012 as "1.2 m"."""
    power = math.floor(math.log10(value) / 3) if value > 0 else 0
    power = min(max(power, -3), 4)
    return f"{value / 1000.0**power:.3g} {'nµm kMGT'[power + 3].strip()}"
