"""Quantities of a user: names and expressions, evaluated in compiled code."""

from __future__ import annotations

import difflib
import json
from types import SimpleNamespace
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from compilers import COMPILERS
from gyrospark.commands.run.outputs import RunOutcome
from gyrospark.commands.run.report import as_text, result_of
from gyrospark.core.errors import InputError
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from processes import call
from strategies import EPS

x, y, u, v, t = sp.symbols("x y u v t", real=True)
CASE = systems.case("dragged_pendulum")
QUANTITIES, PARAMETERS = CASE.system.quantities, CASE.parameters
NUMBERS = {s: PARAMETERS[str(s)] for s in CASE.system.parameters}


@pytest.fixture(scope="module")
def step():
    return systems.stepper("dragged_pendulum")


def exact(name, values):
    """Return a quantity in 50 digits by SymPy's own evaluation."""
    numbers = {s: sp.Rational(value) for s, value in values.items()}
    return mp.mpf(str(sp.N(QUANTITIES[name].subs(numbers), 50)))


def test_every_quantity_at_every_stored_state(step):
    """Values agree to 16 ε, a dozen operations of numbers of order one."""
    run = step.integrate(gs.Start([0.6, -0.8], [0.8, 0.6], t=0.4), dt=0.05, steps=7,
                         parameters=PARAMETERS, every=3)
    assert run.quantities == tuple(QUANTITIES)
    for row, time in enumerate(run.t.tolist()):
        values = dict(zip((x, y, u, v), [*run.q[row].tolist(), *run.p[row].tolist()], strict=True))
        values |= {t: time} | NUMBERS
        for name in QUANTITIES:
            right = float(exact(name, values))
            assert abs(run.quantity(name)[row] - right) <= 16 * EPS * max(1, abs(right))


def test_quantities_have_leading_axes_and_names(step):
    rng = np.random.default_rng(5)
    q, p, times = rng.standard_normal((3, 2, 2)), rng.standard_normal((3, 2, 2)), np.ones((3, 2))
    quantities = step.quantities(q, p, parameters=PARAMETERS, t=times)
    assert list(quantities) == list(QUANTITIES)
    assert quantities["spin"] == pytest.approx(q[..., 0] * p[..., 1] - q[..., 1] * p[..., 0])
    assert quantities["three"].tolist() == [[3.0] * 2] * 3
    single = step.quantities(q[1, 1], p[1, 1], parameters=PARAMETERS, t=1.0)
    assert all(single[name] == quantities[name][1, 1] for name in QUANTITIES)
    with pytest.raises(InputError, match="t has shape"):
        step.quantities(q, p, parameters=PARAMETERS, t=[1.0, 2.0])
    run = step.integrate([0.6, -0.8], [0.8, 0.6], dt=0.05, steps=1, parameters=PARAMETERS)
    with pytest.raises(InputError, match=r"'hight'.*height, drive, spin"):
        run.quantity("hight")
    top = gs.problems.fast_top()
    plain = gs.stepper("EMS").integrate(
        top.q0, top.p0, dt=1e-3, steps=1,
        parameters=top.parameters | {"gamma": gs.gamma(top.inertia)})
    assert plain.quantities == ()
    assert plain.work.tolist() == [0.0, 0.0]
    with pytest.raises(InputError, match="has none"):
        plain.quantity("height")


def test_kept_in_the_file(step, tmp_path):
    q, p = step.project([0.6, -0.8], [0.8, 0.6], parameters=PARAMETERS)
    run = step.integrate(gs.Start(q, p, t=0.5), dt=0.125, steps=4, parameters=PARAMETERS)
    again = gs.load(run.save(tmp_path / "run.npz"))
    assert again.quantities == run.quantities
    for name in QUANTITIES:
        assert np.array_equal(again.quantity(name), run.quantity(name))
    assert np.array_equal(again.work, run.work)
    assert np.array_equal(again.t, run.t)
    assert again.report == run.report
    assert run.report.work == float(run.work[-1]) != 0
    members = step.integrate_ensemble(gs.Start([q] * 2, [p] * 2, t=0.5), dt=0.125, steps=4,
                                      parameters=PARAMETERS).members
    assert np.abs(members[1].quantity_values - run.quantity_values).max() <= 256 * EPS


def test_reported_by_run(step):
    run = step.integrate([0.6, -0.8], [0.8, 0.6], dt=0.125, steps=5, every=2, parameters=PARAMETERS)
    problem: Any = SimpleNamespace(name="watched", q0=[0.6, -0.8], p0=[0.8, 0.6])
    outcome = RunOutcome(run, run, 1.0, 5, None, None)
    result = json.loads(json.dumps(result_of(problem, step, outcome)))
    assert result["work"] == run.report.work
    assert result["quantities"] == {name: run.quantity(name)[-1] for name in QUANTITIES}
    assert result["quantities"]["height"] == result["q"][1]
    text = as_text(result, step.manifest.system)
    assert "|H − H₀ − W|" in text
    assert "work of" in text
    assert "height" in text


def test_quantities_do_not_touch_the_steps():
    """The C of a stepper with quantities has the lines of one without them, and more."""
    spec, unused = Spec.from_arguments("G-L", 2), sp.Symbol("unused", positive=True)
    plain, watched = (generate(spec, system=gs.System(
        (x, y), (u, v), (unused,), (u**2 + v**2) / 2 + y, (x**2 + y**2 - 1,), name="watched",
        quantities=quantities, time=time)).source for quantities, time in (
            ({}, None), ({"ratio": unused * sp.sin(t) / (1 + x**2)}, t)))
    for without, having in ((plain.source, watched.source), (plain.header, watched.header)):
        changes = [line for line in difflib.ndiff(without.splitlines(), having.splitlines())
                   if line[0] in "-+"]
        assert any("watched_gl2_quantities" in line for line in changes)
        assert not any(line.startswith("-") or "work_done" in line for line in changes)
    assert "quantities" not in json.loads(plain.manifest)["system"]


def test_names_and_warnings(tmp_path):
    """Symbols, time and quantities named as the C's own variables give pedantic-clean C."""
    names = ["t", "work", "out", "w", "W", "late", "i", "count", "report", "t0", "F", "start"]
    q0, p0, *free = (sp.Symbol(name, real=True) for name in names)
    time = sp.Symbol("power", real=True)
    for clock in (None, time):
        drive = sum(free) * (1 if clock is None else sp.cos(clock))
        odd = gs.System((q0,), (p0,), free, p0**2 / 2, forces=(drive * q0 - p0,), time=clock,
                        name="odd", quantities={"int": drive, "q": q0, "H_q": p0 * drive})
        files = generate(Spec.from_arguments("EMS"), system=odd).source.files()
        for name, text in files.items():
            (tmp_path / name).write_text(text, encoding="utf-8")
        source = next(name for name in files if name.endswith(".c"))
        for compiler in COMPILERS.values():
            for macro in ("-DGYROSPARK_PLAIN", "-UGYROSPARK_PLAIN"):
                built = call([*compiler, "-std=c11", "-Wall", "-Wextra", "-Wpedantic",
                              "-Wconversion", "-Werror", macro, "-fsyntax-only", source],
                             cwd=tmp_path)
                assert built.returncode == 0, built.stderr
