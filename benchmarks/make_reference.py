"""Make ``reference.json`` again: ``python -m benchmarks.make_reference`` (with heyoka).

Every top starts from its (q, p) in double, taken as exact: q is normalised and Ω computed in long
double. A Taylor integration in long double goes to t = 1000 s; gyrospark's 6-stage Gauss-Lobatto
in long double with Δt = 2⁻¹⁰ s, an exact number, goes to t = 10 s from the same start.
"""

from __future__ import annotations

import importlib.metadata
import json
from typing import Any

import numpy as np

import gyrospark as gs

from .attitudes import Array
from .peers.heyoka_taylor import equations
from .peers.optional import need
from .reference_states import PATH, TIMES
from .tops import INERTIA, LEVER, Top, axis, parameters, spin_of, tops

__all__ = ["main"]

_REAL = np.longdouble
_CHECK = 10


def main() -> None:
    """Write the reference, and print how far the two integrations are apart."""
    motions = [_taylor(top) for top in tops(8)]
    checks = [_distance(_own(top), motion[_CHECK]) for top, motion in zip(tops(8), motions,
                                                                        strict=True)]
    about = {
        "what": "the body's third axis in space of eight tops (benchmarks.tops)",
        "made with": f"heyoka {importlib.metadata.version('heyoka')}, long double, its default "
                     "tolerance",
        "checked with": f"gyrospark G-L, 6 stages, long double, dt = 2^-10 s, at t = {_CHECK} s",
        "largest difference of the mass centres in the check": f"{max(checks):.1e} m",
        "lever": LEVER,
    }
    axes = {f"{t}": [[_text(x) for x in axis(motion[t][:4])] for motion in motions]
            for t in TIMES}
    PATH.write_text(json.dumps({"about": about, "axes": axes}, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(about, indent=1))


def _taylor(top: Top) -> dict[int, Array]:
    """Return (q, Ω) at each time of the reference."""
    heyoka = need("heyoka")
    q, omega = _start(top)
    motion = heyoka.taylor_adaptive(equations(_REAL), np.concatenate([q, omega]), fp_type=_REAL)
    states = {}
    for t in TIMES:
        motion.propagate_until(_REAL(t))
        states[t] = np.array(motion.state)
    return states


def _start(top: Top) -> tuple[Array, Array]:
    q = top.q.astype(_REAL)
    return q / np.sqrt((q * q).sum()), spin_of(top, _REAL)


def _own(top: Top) -> Array:
    """Return q at the time of the check by our own stepper in long double."""
    step = gs.stepper("G-L", 6, "gamma", real="long-double")
    q, omega = _start(top)
    q0, q1, q2, q3 = q
    L = np.array([[-q1, q0, q3, -q2], [-q2, -q3, q0, q1], [-q3, q2, -q1, q0]])
    p = 2 * L.T @ (np.array(INERTIA, dtype=_REAL) * omega)
    steps = 1024 * _CHECK
    end: Array = step.integrate(q, p, dt=2.0**-10, steps=steps, every=steps,
                                parameters=parameters()).q[-1]
    return end


def _distance(q: Any, motion: Array) -> float:
    difference = axis(np.asarray(q)) - axis(motion[:4])
    return LEVER * float(np.sqrt((difference**2).sum()))


def _text(x: Any) -> str:
    return np.format_float_scientific(x, precision=21, trim="-")


if __name__ == "__main__":
    main()
