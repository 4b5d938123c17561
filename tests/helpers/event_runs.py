"""A pendulum with events, its period, and how stored events are compared."""

from __future__ import annotations

import contextlib
import shutil

import mpmath
import numpy as np
import sympy as sp

import gyrospark as gs
from stores import Interrupted, bits, ends_after, record

#: A model file: a ball that is thrown from a tower and lands.
BALL = """
name = "ball"
[system]
coordinates = ["x", "y"]
momenta = ["u", "v"]
hamiltonian = "(u**2 + v**2)/2 + g*y"
[parameters]
g = 10
h = 5
[quantities]
height = "y"
[start]
q = [0, "h"]
p = ["3/2", 0]
[run]
dt = 0.03
steps = 1000
[events]
half = "height = h/2 down"
landing = "y=0 stop"
"""


def pendulum(real: str = "double", scheme: str = "G-L", stages: int | None = None):
    """Return its stepper: five stages for closed forms in double, two otherwise."""
    if scheme == "G-L" and stages is None:
        stages = 5 if real == "double" else 2
    x, y, u, v, g = sp.symbols("x y u v g")
    system = gs.System((x, y), (u, v), (g,), (u**2 + v**2) / 2 + g * y, (x**2 + y**2 - 1,),
                       name="event_pendulum", quantities={"side": x, "height": y})
    return gs.stepper(scheme, stages, system=system, real=real)


def start(angle: float = 1.0):
    return [np.sin(angle), -np.cos(angle)], [0.0, 0.0]


def period(angle: float = 1.0):
    """Return the period of a pendulum released at an angle, g = l = 1: 4 K(sin²(θ/2))."""
    with mpmath.workdps(40):
        return 4 * mpmath.ellipk(mpmath.sin(mpmath.mpf(angle) / 2) ** 2)


def assert_same_events(stored, computed):
    """Check that the events of two runs agree to the bit."""
    assert stored.keys() == computed.keys()
    for name, events in computed.items():
        for field in ("t", "q", "p", "steps", "rising", "elapsed"):
            assert bits(getattr(stored[name], field)) == bits(getattr(events, field)), (name, field)


def in_pieces(step, out, calls, **run):
    """Record a run that is ended after so many calls of progress, again and again."""
    shutil.rmtree(out, ignore_errors=True)
    for count in calls:
        with contextlib.suppress(Interrupted):
            record(step, out=out, resume=True, progress=ends_after(count), **run)
    return record(step, out=out, resume=True, **run)
