"""Make ``references/digits.json`` again: ``python -m benchmarks.make_digits``.

Each problem goes two ways, and each number of both has the same 24 digits:

    stepped   8-stage Gauss-Lobatto in float128, with Δt and Δt/2
    closed    Jacobi's functions by mpmath with 50 digits, and 8-stage Gauss-Lobatto in float128;
              the four-bars by φ(t), and by a quadrature for t(φ)
    loop      quadrature of the one coordinate that a closed loop has, and 8-stage Gauss-Lobatto in
              float128 on all bodies and joints
    series    mpmath's Taylor series of equations of motion without multipliers or constraints, and
              8-stage Gauss-Lobatto in float128

With names of problems, only their digits are computed again.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import mpmath as mp

import gyrospark as gs
from gyrospark.references.problem import Reference
from gyrospark.references.problem_registry import REFERENCES, reference
from gyrospark.references.true_digits import PATH
from gyrospark.references.work_precision import run_once
from gyrospark.runtime.bindings.binary128 import exact
from gyrospark.runtime.bindings.real_numbers import rounding

from . import equations, loops
from . import exact_motions_mp as forms
from .exact_motions_mp import Numbers
from .extrapolation import extrapolated

__all__ = ["WAYS", "digits", "main"]

Way = Callable[[Reference], tuple[str, tuple[Numbers, Numbers]]]
#: Digits that are written, and the largest relative difference of a number by two ways.
_DIGITS, _AGREEMENT = 24, 2e-25
_WORK, _SERIES = 50, 32


def main(names: Sequence[str] = ()) -> None:
    """Write the digits of all problems, or of some, and print how far the two ways are apart."""
    known_digits = json.loads(PATH.read_text(encoding="utf-8")) if names else {}
    known_digits |= {name: digits(reference(name)) for name in names or REFERENCES}
    all_digits = {name: known_digits[name] for name in REFERENCES if name in known_digits}
    PATH.write_text(json.dumps(all_digits, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for name, truth in all_digits.items():
        print(f"{name:18} {truth['agreement']:.1e}  {truth['made']}")


def digits(problem: Reference) -> dict[str, Any]:
    """Return the entry of a problem.

    Raises
    ------
    ArithmeticError
        If its two ways disagree.
    """
    with mp.workdps(_WORK):
        origin, (values, second) = WAYS[problem.name](problem)
        difference = max(_apart(values[group], second[group]) for group in problem.groups)
        if difference > _AGREEMENT:
            raise ArithmeticError(f"{problem.name}: the two ways differ by {difference:.1e}.")
        texts = {name: mp.nstr(value, _DIGITS, strip_zeros=False)
                 for group, names in problem.groups.items()
                 for name, value in zip(names, values[group], strict=True)}
    return {"values": texts, "made": origin, "agreement": difference}


def _apart(values: Sequence[Any], second: Sequence[Any]) -> float:
    return float(max(abs(x / y - 1) for x, y in zip(values, second, strict=True)))


# ---------------------------------------------------------------- ways


def _run(problem: Reference, steps: int) -> Numbers:
    """Return the end by eight stages in float128, every number of the model rounded once."""
    model = problem.make().in_type(rounding("float128"))
    step = gs.stepper("G-L", 8, system=model.system, real="float128")
    q, p = step.project(model.q0, model.p0, parameters=dict(model.parameters))
    if any(abs(a - b) > 1e-28 for a, b in zip((*q, *p), (*model.q0, *model.p0), strict=True)):
        raise ArithmeticError(f"{problem.name} does not start on its constraints.")
    model = replace(model, q0=q, p0=p)
    groups = problem.read(run_once(problem, step, model, steps, "float128"))
    return {group: [_wide(x) for x in numbers] for group, numbers in groups.items()}


def _wide(value: Any) -> Any:
    fraction = Fraction(exact(value))
    return mp.mpf(fraction.numerator) / fraction.denominator


def _stepped(steps: int) -> Way:
    def way(problem: Reference) -> tuple[str, tuple[Numbers, Numbers]]:
        origin = f"float128, 8-G-L, {2 * steps} steps, compared with {steps}"
        return origin, (_run(problem, 2 * steps), _run(problem, steps))

    return way


def _closed(name: str, steps: int) -> Way:
    def way(problem: Reference) -> tuple[str, tuple[Numbers, Numbers]]:
        origin = f"closed form, mpmath, compared with float128, 8-G-L, {steps} steps"
        return origin, (CLOSED[name](mp.mpf(problem.seconds)), _run(problem, steps))

    return way


def _loop(motion: Callable[[Any], Numbers], steps: int) -> Way:
    """Return the way by quadrature of one coordinate, compared with all bodies and joints."""
    def way(problem: Reference) -> tuple[str, tuple[Numbers, Numbers]]:
        with mp.workdps(40):
            values = motion(mp.mpf(problem.seconds))
        origin = ("quadrature of one coordinate, mpmath, compared with float128, 8-G-L, "
                  f"{steps} steps")
        return origin, (values, _run(problem, steps))

    return way


def _four_bars(count: int) -> Way:
    """Return sin φ and cos φ, compared with t(φ) by quadrature."""
    def way(problem: Reference) -> tuple[str, tuple[Numbers, Numbers]]:
        t = mp.mpf(problem.seconds)
        closed_form = {"positions": forms.four_bars(count, t)}
        return ("closed form, mpmath, compared with t(φ) by quadrature",
                (closed_form, loops.four_bars(forms.four_bar_constant(count), t)))

    return way


def _series(motion: Callable[[], tuple[Callable[..., Any], Sequence[Any]]], steps: int) -> Way:
    """Return the way by Taylor series of an equation of motion, whose state is compared."""
    def way(problem: Reference) -> tuple[str, tuple[Numbers, Numbers]]:
        with mp.workdps(_SERIES):
            rates, start = motion()
            end = iter(mp.odefun(rates, 0, start)(mp.mpf(problem.seconds)))
            second = {group: [next(end) for _ in names] for group, names in problem.groups.items()}
        origin = f"float128, 8-G-L, {steps} steps, compared with Taylor series by mpmath"
        return origin, (_run(problem, steps), second)

    return way


def _midpoint(motion: Callable[[], equations.Motion], parts: Sequence[tuple[str, int]],
              steps: int) -> Way:
    """Return the way by the extrapolated midpoint rule; ``parts`` are seconds and steps of each.

    Few steps would do for the later, damped part of a motion, but explicit ones have to be short.
    """
    def way(problem: Reference) -> tuple[str, tuple[Numbers, Numbers]]:
        with mp.workdps(40):
            rates, state = motion()
            for seconds, count in parts:
                state = extrapolated(rates, state, mp.mpf(seconds) / count, count, 14)
            end = iter(state)
            second = {group: [next(end) for _ in names] for group, names in problem.groups.items()}
        origin = (f"float128, 8-G-L, {steps} steps, compared with the extrapolated midpoint rule "
                  "by mpmath")
        return origin, (_run(problem, steps), second)

    return way


def _dzhanibekov(t: Any) -> Numbers:
    return forms.free_body([mp.mpf(x) for x in (1, 2, 3)],
                           [mp.mpf(x) for x in ("0.001", "2", "0.003")], t)


def _free_body(t: Any) -> Numbers:
    angle = mp.mpf("1.1")
    return forms.free_body([mp.mpf(2), mp.mpf(1), mp.mpf(2) / 3],
                           [mp.cos(angle), mp.mpf(0), mp.sin(angle)], t)


def _bruels(t: Any) -> Numbers:
    moments = [mp.mpf(x) for x in ("15.234375", "0.46875", "15.234375")]
    return forms.heavy_top(moments, mp.mpf("147.15"), mp.mpf(150), mp.mpf("-4.61538"), t)


#: Motions at t in closed form.
CLOSED: dict[str, Callable[[Any], Numbers]] = {
    "simple-pendulum": forms.simple_pendulum,
    "spherical-pendulum": forms.spherical_pendulum,
    "bead": forms.bead,
    "growing-mass": forms.growing_mass,
    "dzhanibekov": _dzhanibekov,
    "free-body": _free_body,
    "heavy-top": _bruels,
}
#: Problem → its two ways, with the number of the engine's steps.
WAYS: dict[str, Way] = {
    "car-axis": _stepped(1000),
    "andrews": _stepped(600),
    "simple-pendulum": _closed("simple-pendulum", 500),
    "spherical-pendulum": _closed("spherical-pendulum", 500),
    "bead": _closed("bead", 200),
    "growing-mass": _closed("growing-mass", 400),
    "dzhanibekov": _closed("dzhanibekov", 1000),
    "free-body": _closed("free-body", 2000),
    "heavy-top": _closed("heavy-top", 2000),
    "four-bar": _four_bars(2),
    "four-bars-40": _four_bars(40),
    "parallelogram": _four_bars(1),
    "bricard": _loop(loops.bricard, 500),
    "bricard-pushed": _loop(lambda t: loops.bricard(t, "2"), 1000),
    "bennett": _loop(loops.bennett, 500),
    "slider-crank": _loop(loops.slider_crank, 5000),
    "flyball-governor": _midpoint(equations.flyball_governor, (("0.01", 60), ("0.09", 300)),
                                  1000),
    "flyball-governor-stiff": _midpoint(lambda: equations.flyball_governor("4e5", "0.05"),
                                        (("0.001", 80), ("0.009", 300)), 2000),
    "kovalevskaya": _series(equations.kovalevskaya, 1000),
    "goryachev-chaplygin": _series(equations.goryachev_chaplygin, 1000),
    "neumann": _series(equations.neumann, 1000),
    "ellipsoid": _series(equations.ellipsoid, 1000),
}

if __name__ == "__main__":
    main(sys.argv[1:])
