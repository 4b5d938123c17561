"""Runs of different kinds to be stored and exported."""

from __future__ import annotations

from functools import partial

import gyrospark as gs
import systems
from stores import record


def record_case(out, name="heavy_top", real="double", steps=25, every=2, **options):
    """Return the stored run of a case of the catalogue."""
    step, case = systems.stepper(name, real=real), systems.case(name)
    q, p = systems.start(name, step)
    return record(step, gs.Start(q, p, t=case.t0), out=out, dt=case.dt, steps=steps,
                     every=every, parameters=case.parameters, **options)


RUNS = {
    "top": record_case,
    "forced": partial(record_case, name="dragged_pendulum", steps=35, every=3),
    "two constraints": partial(record_case, name="two_rods", steps=10, every=1),
    "long double": partial(record_case, real="long-double"),
    "one state": partial(record_case, steps=0, every=1),
}
