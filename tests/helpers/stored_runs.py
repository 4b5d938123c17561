"""Runs of different kinds to be stored and exported."""

from __future__ import annotations

import gyrospark as gs
from calls import PARAMETERS, TOP
from forced_systems import PARAMETERS as FORCED
from forced_systems import pendulum
from stores import START
from structured_systems import made, start


def forced_run(out):
    """A run with forces, quantities and time, of 13 rows in blocks of 4."""
    step = gs.stepper("G-L", 2, system=pendulum())
    q, p = step.project([0.6, -0.8], [0.8, 0.6], parameters=FORCED)
    return gs.record(step, q, p, out=out, dt=0.01, steps=35, every=3, t0=0.3, parameters=FORCED)


def two_constraints(out):
    q, p, parameters = start(driven=True)
    return gs.record(made("G-L", 2, structured=True, driven=True), q, p, out=out, dt=1e-3,
                     steps=10, parameters=parameters)


def wide(out, real="long-double"):
    step = gs.stepper("EMS", real=real)
    q, p = step.project(TOP.q0, TOP.p0, parameters=PARAMETERS)
    return gs.record(step, q, p, out=out, dt=1e-3, steps=20, parameters=PARAMETERS)


RUNS = {
    "top": lambda out: gs.record(gs.stepper("EMS"), **START, steps=25, every=2, out=out, seed=3),
    "forced": forced_run, "two constraints": two_constraints, "long double": wide,
    "float128": lambda out: wide(out, "float128"),
    "float": lambda out: wide(out, "float"),
    "one state": lambda out: gs.record(gs.stepper("EMS"), **START, steps=0, out=out),
}
