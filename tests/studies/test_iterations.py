"""Tables 8-14: the Newton driver of the studies, the inexact Jacobian, and the issue's targets."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.studies import iterations, robustness
from gyrospark.studies.case_runner import Engine, parameter_value
from gyrospark.studies.inexact_jacobian import InexactTop, dropped_term, inexact_stepper
from gyrospark.studies.iterations import (
    table_11,
    table_12,
    table_13,
    table_14,
    within_one,
)
from gyrospark.studies.newton_study import March, Rule, march
from gyrospark.studies.printed_iterations import DIVERGENT, ITERATIONS, ROWS, STEPS, TABLE_8
from gyrospark.studies.robustness import largest_count, largest_step, table_8

TOP = gs.problems.fast_top()
STATE = (TOP.q0, TOP.p0)


def parameters(rep, rule="m"):
    return TOP.parameters | {rep: parameter_value(rule, TOP.inertia)}


@pytest.mark.parametrize(
    ("scheme", "stages", "start", "rep", "plain"),
    [("IMS", None, "state", "gamma", False), ("EMS", None, "state", "gamma", True),
     ("G-L", 2, "previous", "alpha", False), ("LIIIA-B", 3, "rates", "gamma", True)],
)
def test_the_driver_takes_the_products_steps(scheme, stages, start, rep, plain):
    """With the same equations, but another start and stop, 20 steps agree to round-off."""
    step = gs.stepper(scheme, stages, rep)
    rule = Rule(start, "r", 1e-11, 50, plain=plain)
    run = march(step, parameters(rep), STATE, 2e-3, 20, rule)
    assert not run.divergent
    assert run.unsolved == 0
    end = step.integrate(*STATE, dt=2e-3, steps=20, parameters=parameters(rep))
    np.testing.assert_allclose(run.end[0], end.q[-1], rtol=0, atol=1e-11)
    np.testing.assert_allclose(run.end[1], end.p[-1], rtol=0, atol=1e-11)


def test_every_norm_counts():
    step = gs.stepper("IMS", rep="gamma")
    counts = {
        on: march(step, parameters("gamma"), STATE, 0.01, 8, Rule("state", on, 1e-9, 50)).mean
        for on in ("dx", "d(q,p)", "r")
    }
    assert all(3 < count < 8 for count in counts.values())
    assert counts["d(q,p)"] <= counts["dx"]


def test_largest_entry_is_no_larger_than_the_euclidean_norm():
    step = gs.stepper("LIIIA-B", 3, "gamma")
    runs = [march(step, parameters("gamma"), STATE, 0.01, 8,
                  Rule("previous", "r", 1e-10, 50, size)).mean
            for size in ("largest", "euclidean")]
    assert runs[0] <= runs[1]


def test_a_march_that_strays_is_divergent():
    """EMS at Δt = 0.02 with α = 0.01γ_m diverges, as the paper prints."""
    run = march(gs.stepper("EMS", rep="alpha"), parameters("alpha", "0.01m"), STATE, 0.02, 80,
                Rule("state", "dx", 1e-12, 100))
    assert run.divergent
    assert len(run.iterations) < 80


def test_stagnation_is_not_divergence_unless_nothing_is_solved():
    step = gs.stepper("IMS", rep="gamma")
    run = march(step, parameters("gamma"), STATE, 1e-3, 10, Rule("state", "dx", 1e-15, 20))
    assert 0 < run.unsolved < 10
    assert not run.divergent
    hopeless = Rule("state", "dx", 1e-30, 20)
    assert march(step, parameters("gamma"), STATE, 1e-3, 10, hopeless).failure == \
        "no step converged"
    strict = march(step, parameters("gamma"), STATE, 1e-3, 10, hopeless, all_solved=True)
    assert strict.failure == "not converged"
    assert len(strict.iterations) == 1


@pytest.mark.parametrize("rep", ["gamma", pytest.param("alpha", marks=pytest.mark.slow)])
def test_only_the_intended_term_is_dropped(rep):
    """The term is d(L(q)ᵀ)·u with u = D L(q)p/4, here by finite matrices instead of derivatives."""
    from gyrospark.generator.multibody.rigid_body import heavy_top, left_matrix

    exact = heavy_top(rep)
    inexact = InexactTop(exact.q, exact.p, exact.parameters, exact.H, exact.constraints,
                         name=exact.name)
    rng = np.random.default_rng(5)
    values = {s: float(v) for s, v in zip(
        (*exact.q, *exact.p, *exact.parameters),
        rng.uniform(0.5, 2, 8 + len(exact.parameters)), strict=True)}
    by_name = {str(s): v for s, v in values.items()}

    def left(x):
        return np.array(left_matrix(list(x)).tolist(), dtype=float)

    q, p = (np.array([values[s] for s in group]) for group in (exact.q, exact.p))
    D = np.array([1 / by_name[f"I{i}"] for i in (1, 2, 3)])
    if rep == "gamma":
        D = D - 1 / by_name["gamma"]
    u = D * (left(q) @ p) / 4
    expected = np.column_stack([left(e).T @ u for e in np.eye(4)])
    matrices = [[[float(e.subs(values)) for e in row] for row in matrix]
                for matrix in (exact.H_pq, inexact.H_pq, dropped_term(exact).tolist())]
    np.testing.assert_allclose(matrices[2], expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(np.array(matrices[0]) - matrices[1], expected, rtol=1e-12,
                               atol=1e-12)
    for name in ("H_q", "H_p", "H_qq", "H_pp", "G"):
        assert getattr(inexact, name) == getattr(exact, name)


def test_same_residual_other_jacobian():
    exact, inexact = gs.stepper("LIIIA-B", 3, "gamma"), inexact_stepper("LIIIA-B", 3, "gamma")
    keywords = {"dt": 1e-2, "parameters": parameters("gamma")}
    x = exact.guess(*STATE, **keywords)
    x *= 1 + 0.01 * np.random.default_rng(3).standard_normal(len(x))
    np.testing.assert_allclose(inexact.residual(x, *STATE, **keywords),
                               exact.residual(x, *STATE, **keywords), rtol=0, atol=1e-11)
    J = [s.jacobian(x, *STATE, **keywords) for s in (exact, inexact)]
    is_changed = np.abs(J[0] - J[1]) > 1e-11 * np.abs(J[0]).max()
    assert is_changed.any()
    assert not is_changed[24:].any()  # g(Q̃): nothing of H in it
    # ∂r_k/∂k̂ = −Δt â H_pp has no H_pq
    assert not is_changed[:12, 12:24].any()


def test_inexact_converges_linearly():
    exact, inexact = gs.stepper("LIIIA-B", 3, "gamma"), inexact_stepper("LIIIA-B", 3, "gamma")
    counts = [march(step, parameters("gamma"), STATE, 0.01, 8,
                    Rule("previous", "r", 1e-12, 100)).mean for step in (exact, inexact)]
    assert counts[1] > 2 * counts[0]
    assert "inexact" not in exact.files["heavy_top_liiiab3_gamma.c"]


def test_within_one_compares_at_the_printed_digits():
    assert within_one(28.99, "30")
    assert within_one(13.07, "14.1")
    assert not within_one(12.89, "14.1")
    assert within_one(DIVERGENT, DIVERGENT)
    assert not within_one(DIVERGENT, "13")
    assert not within_one(100.0, DIVERGENT)


def test_the_printed_tables_are_complete():
    assert all(set(table) == set(ROWS) for table in ITERATIONS.values())
    assert all(len(row) == len(STEPS) for table in ITERATIONS.values() for row in table.values())
    assert sum(text is not None for row in ITERATIONS[10].values() for text in row) == 19
    assert sum(text is not None for row in TABLE_8.values() for text in row) == 60
    for row in (("alpha", "m"), ("alpha", "h")):
        assert ITERATIONS[12][row] == ITERATIONS[11][row]


@pytest.mark.parametrize(
    ("edge", "first", "expected"),
    [(17, 1, 17), (64, 1, 64), (0, 1, 0), (500, 1, 200), (4, 5, 0), (5, 5, 5), (199, 5, 199)],
)
def test_search(edge, first, expected):
    def converges(n):
        return n <= edge

    assert largest_count(converges, converges, first, 200) == expected


def test_search_does_not_trust_the_short_run():
    assert largest_count(lambda n: n <= 100, lambda n: n <= 9, 1, 200) == 9


@pytest.mark.slow  # a printed number; compiles a stepper and its inexact one for it
def test_table_8_with_the_inexact_jacobian():
    """For α = 100γ_m it is the printed 0.0022 exactly; the exact Jacobian reaches further."""
    assert largest_step("LIIIA-B", 4, "alpha", "100m", 1e-4, 160, True) == pytest.approx(0.0022)
    assert largest_step("LIIIA-B", 4, "alpha", "100m", 1e-4, 160, False) > 0.004


def test_cells_of_table_8(monkeypatch):
    """IMS and EMS have the exact Jacobian, SPARK methods the inexact one beside it."""
    monkeypatch.setattr(robustness, "largest_step", lambda *given: 0.01)
    monkeypatch.setattr(robustness, "_one_stage_alpha", lambda engine: [])
    assert len(table_8(Engine(short=True)).cells) == 12 + 2 * 48


@pytest.mark.parametrize(("printed", "step", "verdict"), [
    ("0.010", 0.0104, "agrees"), ("0.010", 0.0106, "differs"), ("0.010", 0.0, "differs"),
    ("divergent", 0.0, "agrees"), ("divergent", 0.01, "differs"),
    ("0.2", 0.2, "differs")])  # the search ends there
def test_verdicts_of_table_8(printed, step, verdict):
    assert robustness._cell("G-L", "2", printed, step, inexact=False).verdict == verdict


def test_misprints_are_named(monkeypatch):
    monkeypatch.setattr(iterations, "_march", lambda *given: March([3] * 16))
    for number, make in ((11, table_11), (13, table_13), (14, table_14)):
        assert make(Engine(short=True)).number == number
    cells = table_12(Engine(short=True)).cells
    misprinted = {c.row for c in cells if c.verdict == "misprint"}
    assert misprinted == {"α = γ_m", "α = γ_h"}
    assert all("erratum 19" in c.note for c in cells if c.verdict == "misprint")
