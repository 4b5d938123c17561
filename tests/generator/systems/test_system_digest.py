"""The digest of a system: equal in every process, and different after any change."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
from gyrospark.api import text_of
from gyrospark.generator.spec import Spec
from gyrospark.generator.systems.system import System
from gyrospark.generator.systems.system_digest import system_digest
from gyrospark.runtime.compilation.build_cache import entries
from helpers.processes import python

Q, P, T = sp.symbols("q0:2"), sp.symbols("p0:2"), sp.Symbol("t")
A = sp.symbols("a0:2", positive=True)
EMS = Spec("EMS")
TERMS = (Q[0] ** 2, Q[0] * Q[1], sp.cos(Q[1]), A[0] * Q[1] ** 4, sp.Rational(1, 3) * A[1] * Q[0],
         sp.exp(-Q[0] ** 2), Q[1] ** 2 / A[1], sp.Float("0.1") * Q[1] ** 2,
         sp.Max(Q[0], Q[1]) ** 3)


def _system(H: sp.Expr, **more: object) -> System:
    return System(Q, P, A, P[0] ** 2 / 2 + P[1] ** 2 / 2 + H, **more)


@settings(max_examples=20)
@given(st.lists(st.sampled_from(TERMS), min_size=1, max_size=5),
       st.lists(st.integers(-5, 5).filter(bool), min_size=5, max_size=5),
       st.integers(0, 11))
def test_every_change_has_another_digest(terms, factors, change):
    H = sum(f * e for f, e in zip(factors, terms, strict=False))
    system = _system(H, quantities={"height": Q[0]})
    first, renamed = sp.symbols("a0", real=True), sp.Symbol("b", positive=True)
    changed = (
        lambda: _system(H + Q[0] ** 6, quantities={"height": Q[0]}),
        lambda: replace(system, quantities={"heigth": Q[0]}),
        lambda: replace(system, quantities={"height": Q[0] * 2}),
        lambda: replace(system, quantities={}),
        lambda: replace(system, name="other"),
        lambda: replace(system, constraints=(Q[0] - Q[1],), constraint_names=()),
        lambda: replace(system, forces=(-P[0], sp.Integer(0))),
        lambda: replace(system, time=T),
        lambda: replace(system, parameters=A[::-1]),
        lambda: replace(system, parameters=(*A, renamed)),
        lambda: replace(system, H=system.H.subs(A[0], first), parameters=(first, A[1])),
        lambda: replace(system, inputs=(sp.Symbol("u"),), forces=(sp.Symbol("u"), sp.Integer(0))),
    )[change]()
    assert system_digest(system) == system_digest(_system(H, quantities={"height": Q[0]}))
    assert system_digest(system) is not None
    assert system_digest(changed) not in (None, system_digest(system))
    assert system_digest(system, 1) != system_digest(system, 1.0) != system_digest(system, True)


def test_floats_and_exact_numbers_differ_and_what_is_not_known_everywhere_has_none():
    numbers = (sp.Float("0.1"), sp.Float("0.1", 40), sp.Rational(1, 10), sp.Float(0.5),
               sp.Rational(1, 2))
    assert len({system_digest(_system(x * Q[0])) for x in numbers}) == len(numbers)
    class Own(sp.Function):
        pass

    assert system_digest(Q[0] + sp.Dummy("x")) is None
    assert system_digest(Own(Q[0])) is None
    assert system_digest(sp.Function("cos2")(Q[0])) is None
    assert system_digest(object()) is None


def test_the_digest_is_the_same_in_other_processes():
    code = ("import gyrospark; "
            "from gyrospark.generator.systems.system_digest import system_digest; "
            "print(system_digest(gyrospark.models.double_pendulum().system))")
    digest = python(code, PYTHONHASHSEED="3").strip()  # another hash seed than this process has
    assert digest == str(system_digest(gs.models.double_pendulum().system))


def test_a_known_system_is_not_derived_again(tmp_path, monkeypatch):
    monkeypatch.setenv("GYROSPARK_CACHE", str(tmp_path))
    system = _system(Q[0] ** 2 + Q[1] ** 2 * Q[0] ** 2, name="kept")
    files, _ = text_of(EMS, system)
    cached = [path for path in entries() if path.name.startswith("system-")]
    assert len(cached) == 1

    def fail(*_: object, **__: object) -> None:
        raise AssertionError("derived again")

    with monkeypatch.context() as patched:
        patched.setattr("gyrospark.generator.pipeline.generate", fail)
        assert text_of(EMS, replace(system)) == (files, None)
        with pytest.raises(AssertionError):
            text_of(Spec("IMS"), system)
    cached[0].write_text(cached[0].read_text().replace("kept", "kapt", 1))
    assert text_of(EMS, system) == (files, None)


def test_warnings_of_a_kept_derivation_are_issued_again(tmp_path, monkeypatch):
    """The second time nothing is derived, and the same warnings are issued."""
    monkeypatch.setenv("GYROSPARK_CACHE", str(tmp_path))
    system = System(Q, P, (), P[0] ** 2 / 2 + P[1] ** 2 / 2, velocities=sp.symbols("v0:2"),
                    velocity_constraints=(sp.Symbol("v0") - sp.Symbol("v1"),))
    with pytest.warns(gs.errors.InputWarning) as derived:
        text_of(Spec("G-L", 1), system)
    monkeypatch.setattr("gyrospark.generator.pipeline.generate",
                        lambda *_, **__: pytest.fail("derived again"))
    with pytest.warns(gs.errors.InputWarning) as kept:
        text_of(Spec("G-L", 1), system)
    assert [str(w.message) for w in kept] == [str(w.message) for w in derived]


class Symbol(sp.Symbol):
    """A class of a user: its symbols have no digest; SymPy sorts them by their class's name."""


def test_a_system_without_a_digest_is_derived_itself():
    """Without a digest its spec equals the one of the heavy top, which the package has in C."""
    x, u = Symbol("x", real=True), sp.Symbol("u", real=True)
    k = sp.Symbol("k", positive=True)
    # its C is the C of the catalogue's oscillator
    oscillator = System((x,), (u,), (k,), u**2 / 2 + k * x**2 / 2, name="oscillator")
    assert system_digest(oscillator) is None
    run = gs.stepper("G-L", 2, system=oscillator).integrate([1.0], [0.0], dt=0.01, steps=100,
                                                            parameters={"k": 1.0})
    assert run.q[-1] == pytest.approx([math.cos(1)], abs=1e-10)  # (0.01)**4/1440 of a rad a step
    with pytest.raises(gs.InputError, match="V"):
        gs.stepper("G-L", 2, system=replace(oscillator, H=u**2 + sp.Function("V")(x)))
