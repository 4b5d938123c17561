"""Make ``references/digits.json`` again: ``python -m gyrospark.benchmarks.make_digits``.

Each problem goes two ways, and each number of both has the same 24 digits:

    stepped   8-stage Gauss-Lobatto in float128, with Δt and Δt/2
    closed    Jacobi's functions by mpmath with 50 digits, and 8-stage Gauss-Lobatto in float128;
              the four-bars by φ(t), and by the equation of motion of φ in mpmath's Taylor series
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import mpmath as mp

from ..facade import stepper
from ..references.catalogue import REFERENCES
from ..references.measuring import run_once
from ..references.problem import Reference
from ..references.truth import PATH
from ..runtime.call.quad import exact
from ..runtime.call.reals import rounding

__all__ = ["WAYS", "digits", "main"]

Numbers = Mapping[str, Sequence[Any]]
#: Digits that are kept, and the largest relative difference of a number by two ways.
_DIGITS, _AGREEMENT = 24, 2e-25
_WORK = 50


def main() -> None:
    """Write the digits, and print how far the two ways are apart."""
    found = {name: digits(REFERENCES[name]) for name in REFERENCES}
    PATH.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for name, truth in found.items():
        print(f"{name:18} {truth['agreement']:.1e}  {truth['made']}")


def digits(problem: Reference) -> dict[str, Any]:
    """Return the entry of a problem.

    Raises
    ------
    ArithmeticError
        If its two ways do not agree.
    """
    with mp.workdps(_WORK):
        made, (values, second) = WAYS[problem.name](problem)
        apart = max(_apart(values[group], second[group]) for group in problem.groups)
        if apart > _AGREEMENT:
            raise ArithmeticError(f"{problem.name}: the two ways differ by {apart:.1e}.")
        texts = {name: mp.nstr(value, _DIGITS) for group, names in problem.groups.items()
                 for name, value in zip(names, values[group], strict=True)}
    return {"values": texts, "made": made, "agreement": apart}


def _apart(values: Sequence[Any], second: Sequence[Any]) -> float:
    return float(max(abs(x / y - 1) for x, y in zip(values, second, strict=True)))


# ---------------------------------------------------------------- ways


def _run(problem: Reference, steps: int) -> Numbers:
    """Return the end by eight stages in float128, every number of the model rounded once."""
    model = problem.make().in_type(rounding("float128"))
    step = stepper("G-L", 8, system=model.system, real="float128")
    q, p = step.project(model.q0, model.p0, parameters=dict(model.parameters))
    if any(abs(a - b) > 1e-28 for a, b in zip((*q, *p), (*model.q0, *model.p0), strict=True)):
        raise ArithmeticError(f"{problem.name} does not start on its constraints.")
    model = replace(model, q0=q, p0=p)
    found = problem.read(run_once(problem, step, model, steps, "float128"))
    return {group: [_wide(x) for x in numbers] for group, numbers in found.items()}


def _wide(value: Any) -> Any:
    fraction = Fraction(exact(value))
    return mp.mpf(fraction.numerator) / fraction.denominator


def _stepped(steps: int) -> Callable[[Reference], tuple[str, tuple[Numbers, Numbers]]]:
    def way(problem: Reference) -> tuple[str, tuple[Numbers, Numbers]]:
        made = f"float128, 8-G-L, {2 * steps} steps, beside {steps}"
        return made, (_run(problem, 2 * steps), _run(problem, steps))

    return way


def _closed(formula: Callable[[Any], Numbers], steps: int
            ) -> Callable[[Reference], tuple[str, tuple[Numbers, Numbers]]]:
    def way(problem: Reference) -> tuple[str, tuple[Numbers, Numbers]]:
        made = f"closed form, mpmath, beside float128, 8-G-L, {steps} steps"
        return made, (formula(mp.mpf(problem.seconds)), _run(problem, steps))

    return way


# ---------------------------------------------------------------- closed forms


def _simple_pendulum(t: Any) -> Numbers:
    """θ = 2 asin(k sn(√g t − K)) from downward, k² = ½: from the horizontal at x = −1."""
    g, m = mp.mpf("9.81"), mp.mpf(1) / 2
    sn, cn, dn = _jacobi(mp.sqrt(g) * t - mp.ellipk(m), m)
    k = mp.sqrt(m)
    x, y, rate = 2 * k * sn * dn, 2 * m * sn**2 - 1, 2 * k * cn * mp.sqrt(g)
    return {"positions": [x, y], "velocities": [-rate * y, rate * x]}


def _spherical_pendulum(t: Any) -> Numbers:
    """z'² = z (2 g z² − z − 2 g) by sn², the azimuth by quadrature of 1/(1 − z²); L = 1."""
    g = mp.mpf("9.81")
    root = mp.sqrt(1 + 16 * g**2)
    low, high = (1 - root) / (4 * g), (1 + root) / (4 * g)
    m, rate = -low / (high - low), mp.sqrt(2 * g * (high - low)) / 2

    def height(s: Any) -> tuple[Any, Any]:
        sn, cn, dn = _jacobi(rate * s + mp.ellipk(m), m)
        return low - low * sn**2, -2 * low * sn * cn * dn * rate

    pieces = mp.linspace(0, t, 41)
    azimuth = mp.quadgl(lambda s: 1 / (1 - height(s)[0] ** 2), pieces)
    z, climb = height(t)
    radius = mp.sqrt(1 - z**2)
    out, turn = -z * climb / radius, 1 / radius
    c, s = mp.cos(azimuth), mp.sin(azimuth)
    return {"positions": [radius * c, radius * s, z],
            "velocities": [out * c - turn * s, out * s + turn * c, climb]}


def _four_bar(problem: Reference) -> tuple[str, tuple[Numbers, Numbers]]:
    """φ'' = c sin φ, φ = 0, φ' = 1: all rods turn alike; c = g ((N+1)/2 + N)/((N+1)/3 + N), N = 2.

    φ = π + 2 am(w t − K), w = ½ √(1 + 4c), m = 4c/(1 + 4c).
    """
    c, t = mp.mpf("9.81") * mp.mpf(7) / 6, mp.mpf(problem.seconds)
    m, w = 4 * c / (1 + 4 * c), mp.sqrt(1 + 4 * c) / 2
    sn, cn, _ = _jacobi(w * t - mp.ellipk(m), m)
    closed = {"positions": [-2 * sn * cn, 2 * sn**2 - 1]}
    with mp.workdps(32):
        phi = mp.odefun(lambda _, y: [y[1], c * mp.sin(y[0])], 0, [mp.mpf(0), mp.mpf(1)])(t)[0]
        second = {"positions": [mp.sin(phi), mp.cos(phi)]}
    return "closed form, mpmath, beside a Taylor series of φ'' = c sin φ", (closed, second)


def _jacobi(u: Any, m: Any) -> tuple[Any, Any, Any]:
    return tuple(mp.ellipfun(name, u, m=m) for name in ("sn", "cn", "dn"))


#: What is done for each problem.
WAYS: dict[str, Callable[[Reference], tuple[str, tuple[Numbers, Numbers]]]] = {
    "car-axis": _stepped(1000),
    "andrews": _stepped(600),
    "simple-pendulum": _closed(_simple_pendulum, 500),
    "spherical-pendulum": _closed(_spherical_pendulum, 500),
    "four-bar": _four_bar,
    "dzhanibekov": _stepped(500),
    "kovalevskaya": _stepped(500),
}

if __name__ == "__main__":
    main()
