"""The Python calls with arrays and options of any kind: wild shapes, types, strides, numbers."""

from __future__ import annotations

import decimal
import fractions
import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

import gyrospark as gs
from gyrospark.core.errors import GyrosparkError
from gyrospark.runtime.bindings.binding import REASONS

from .choices import Choices
from .sentences import refuse_unless_sentence
from .steppers import NAMES, Case, case

DTYPES = ("f8", "f4", "f2", "g", "i8", "u1", "?", "c16", "O", "U3", "S2", ">f8", "M8[s]", "V4",
          "m8[s]")


def array(choices: Choices, base: np.ndarray) -> Any:
    """Return what is given as an array: like ``base``, or in a way unlike it."""
    kind = choices.below(16)
    if kind < 5:
        return base
    if kind == 5:
        with np.errstate(all="ignore"):
            return base * (1 + 1e-9 * choices.double())
    if kind == 6 and base.size:
        changed = base.copy()
        changed.flat[choices.below(base.size)] = choices.double()
        return changed
    if kind == 7:
        return base.tolist()
    if kind == 8:
        return cast(base, choices.pick(DTYPES))
    if kind == 9:
        return np.repeat(base, 2, axis=-1)[..., ::2]  # strides that are not the usual
    if kind == 10:
        return base[..., ::-1][..., ::-1]
    if kind == 11:
        return np.broadcast_to(np.float64(choices.double()), base.shape)
    if kind == 12:
        return np.resize(base, tuple(choices.below(5) for _ in range(choices.below(4))))
    if kind == 13:
        return np.ma.masked_invalid(base) if choices.below(2) else base.view(np.recarray)
    if kind == 14:
        return [[*base], [1.0]] if choices.below(2) else (x for x in base)
    return odd(choices)


def cast(base: np.ndarray, dtype: str) -> Any:
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return base.astype(dtype)
        except (TypeError, ValueError):
            return np.zeros(base.shape, dtype=dtype)


def odd(choices: Choices) -> Any:
    """Return anything that is no array of numbers, or a number of an odd kind."""
    import pandas as pd

    return choices.pick((
        None, "abc", b"", {}, {1: 2}, set(), object(), 1, 1.5, True, math.nan, 10**400,
        fractions.Fraction(1, 3), decimal.Decimal("0.1"), np.float32(1), np.int64(3), np.bool_(1),
        np.array(1.0), np.array([]), np.zeros((0, 4)), np.array([None] * 4), [[]], [10**400] * 4,
        np.longdouble("1e4000"), float, 1j, "auto", np.datetime64("2020"), [1, "a", 2, 3],
        "m", lambda *a: None, sp.Symbol("x"), sp.pi, sp.eye(2), pd.Series([1.0, 2.0]),
        pd.DataFrame({"a": [1.0]}), ["a", "b"], np.array(["a", "b", "c", "d"]), {1.0, 2.0},
        [None] * 4, [True] * 4, 1e1, -0.0, np.zeros((2, 3, 4)), Path("nowhere"), "\ud800",
    ))


def number(choices: Choices, good: Any) -> Any:
    kind = choices.below(8)
    return good if kind < 5 else choices.double() if kind == 5 else (
        choices.whole() if kind == 6 else odd(choices))


def few(choices: Choices, good: int) -> Any:
    """Return a count; the large ones are beyond what is allowed."""
    kind = choices.below(8)
    return choices.below(4) if kind < 3 else good if kind < 6 else odd(choices) if kind == 6 else (
        choices.pick((-1, 2**63, 10**30, np.int8(3), 2.0)))


def parameters(choices: Choices, case: Case) -> Any:
    given: dict[Any, Any] = dict(case.parameters)
    kind = choices.below(8)
    if kind == 0:
        return odd(choices)
    if kind < 3:
        given[choices.pick(sorted(case.parameters))] = number(choices, choices.double())
    elif kind == 3:
        given[choices.pick(("gamma ", "", 3, None, "x"))] = 1.0
    elif kind == 4:
        del given[choices.pick(sorted(given))]
    return given


def options(choices: Choices) -> dict[str, Any]:
    """Return some options; iterations are few, or more than an ``int`` holds and not needed."""
    found: dict[str, Any] = {}
    if choices.one_in(3):
        found["solver"] = choices.pick(("auto", "newton", "fixed-point", "magic", "", 3,
                                        None, [], {}))
    if choices.one_in(4):
        found["tolerance"] = number(choices, 1e-12)
    if choices.one_in(4):
        found["max_iterations"] = few(choices, 50)
    if choices.one_in(4):
        found["t0"] = number(choices, 0.5)
    return found


def check(data: bytes) -> str:
    """Make one call; what comes back is finite, or refused in a sentence."""
    choices = Choices(data)
    what = case(choices.pick(NAMES))
    call = CALLS[choices.below(len(CALLS))]
    try:
        result = call(what, choices)
    except gs.StepFailed as error:
        return examined(error)
    except GyrosparkError as error:
        refuse_unless_sentence(error)
        return "refused"
    assert all(np.isfinite(np.asarray(x, dtype=float)).all() for x in result), "not finite"
    return "accepted"


def examined(error: gs.StepFailed) -> str:
    """A step that fails says why; what was before it is there, and finite."""
    assert error.reason in REASONS.values()
    assert np.isfinite(error.trajectory.q.astype(float)).all()
    return "step failed"


def step(what: Case, choices: Choices) -> tuple[Any, ...]:
    return what.step.step(array(choices, what.q), array(choices, what.p), dt=number(choices, 1e-3),
                          parameters=parameters(choices, what), **options(choices))


def integrate(what: Case, choices: Choices) -> tuple[Any, ...]:
    made = what.step.integrate(
        array(choices, what.q), array(choices, what.p), dt=number(choices, 1e-3),
        steps=few(choices, 4), every=few(choices, 1), parameters=parameters(choices, what),
        **options(choices))
    assert len(made) == len(made.q) == len(made.t)
    return made.t, made.q, made.p


def ensemble(what: Case, choices: Choices) -> tuple[Any, ...]:
    count = choices.below(4)
    q, p = np.tile(what.q, (count, 1)), np.tile(what.p, (count, 1))
    dt = array(choices, np.full(count, 1e-3)) if choices.below(2) else number(choices, 1e-3)
    sets: Any = parameters(choices, what)
    if choices.one_in(3):
        sets = [sets] * choices.below(4)
    elif choices.one_in(3) and isinstance(sets, dict):
        sets = {name: array(choices, np.full(count, value)) if isinstance(value, float) else value
                for name, value in sets.items()}
    workers = {} if choices.below(4) else {"workers": choices.pick((1, 2, 0, -1, 1.5, "x"))}
    made = what.step.integrate_ensemble(
        array(choices, q), array(choices, p), dt=dt, steps=few(choices, 3), parameters=sets,
        every=few(choices, 1), **workers, **options(choices))
    return tuple(member.q for member in made.members)


def residual(what: Case, choices: Choices) -> tuple[Any, ...]:
    x = np.zeros(what.step.unknowns)
    call = what.step.residual if choices.below(2) else what.step.jacobian
    return finite_or_nothing(call(
        array(choices, x), array(choices, what.q), array(choices, what.p),
        dt=number(choices, 1e-3), parameters=parameters(choices, what)))


def about(what: Case, choices: Choices) -> tuple[Any, ...]:
    """Energy, defects, quantities, guess of any states: numbers, finite or not."""
    q, p = array(choices, what.q), array(choices, what.p)
    kind, given = choices.below(4), {"parameters": parameters(choices, what)}
    if kind == 0:
        return finite_or_nothing(what.step.energy(q, p, **given))
    if kind == 1:
        return finite_or_nothing(*what.step.defects(q, p, **given))
    if kind == 2:
        return finite_or_nothing(*what.step.quantities(q, p, t=number(choices, 0.5),
                                                       **given).values())
    return finite_or_nothing(what.step.guess(q, p, dt=number(choices, 1e-3), **given))


def project(what: Case, choices: Choices) -> tuple[Any, ...]:
    q, p = array(choices, what.q), array(choices, what.p)
    given = {"parameters": parameters(choices, what)}
    if choices.below(2):
        return what.step.project(q, p, **given)
    found = what.step.consistent(q, p, **given)
    assert str(found)
    return found.q, found.p


def finite_or_nothing(*results: Any) -> tuple[Any, ...]:
    """Values of formulas may overflow; they are numbers all the same."""
    for result in results:
        assert isinstance(result, np.ndarray)
    return ()


CALLS: tuple[Callable[[Case, Choices], tuple[Any, ...]], ...] = (
    step, integrate, ensemble, residual, about, project)
