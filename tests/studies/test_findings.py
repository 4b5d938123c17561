"""The findings beyond the paper: every claim holds, and every proof can fail."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy as sp
from sympy import QQ

from gyrospark import stepper
from gyrospark.generator.tableaux.families import gauss_lobatto, lobatto_iiiab
from gyrospark.runtime.rigid_body.quaternion import momentum
from gyrospark.studies import odd_proof
from gyrospark.studies.beyond import FINDINGS
from gyrospark.studies.body_frame import BodyFrameTop, motion
from gyrospark.studies.case_runner import Engine
from gyrospark.studies.energy_law import energy_law, node_numbers
from gyrospark.studies.equivalence import gradients_claim, nodes_claim, stages_claim
from gyrospark.studies.gamma_auto import LONGER, energy_claim, gain_claim, longer_claim
from gyrospark.studies.gamma_trials import BODIES
from gyrospark.studies.one_step import energy_error
from gyrospark.studies.power_series import PowerSeries
from gyrospark.studies.study_result import Claim
from gyrospark.studies.zeros import integrable_claim

#: Findings that rest on measurement alone.
MEASURED = ("one-stage-alpha", "gamma-auto", "frames")
STATE = odd_proof._rational_tops()[0]


#: The proofs of the slow one are checked by themselves below.
every_finding = pytest.mark.parametrize("key", [
    pytest.param(key, marks=pytest.mark.slow) if key in (
        "odd-stages", "frames", "gamma-auto", "one-stage-alpha", "alpha-equals-gamma",
        "zero-of-the-error")
    else key for key in FINDINGS])  # proofs and searches of several seconds


@pytest.mark.parametrize(("claim", "times"), [(energy_claim, 1), (longer_claim, LONGER)])
def test_claims_on_the_energy_hold_for_gains_of_their_runs(claim: Any, times: int) -> None:
    def trial(method: str, **gains: float) -> Any:
        gain_of = {1: gains["short"], LONGER: gains["long"]}
        return SimpleNamespace(method=method, energy_gain=lambda times: gain_of[times],
                               at_round_off=lambda times=1: gain_of[times] == 0)

    good, without_gain = trial("IMS", short=2.0, long=3.0), trial("EMS", short=0, long=0)
    assert claim(BODIES[0], [good, without_gain]).holds
    bad = trial("G-L", **{"short": 3.0, "long": 3.0, "short" if times == 1 else "long": 0.9})
    assert not claim(BODIES[0], [good, bad]).holds


def test_gains_are_those_at_the_second_time() -> None:
    """The median of the gains decides; a trial that has lost the motion does not count."""
    times = (1.0, 10.0, 100.0)

    def trial(gain: float) -> Any:
        gain_of = {times[0]: 1 / gain, times[1]: gain, times[2]: 1 / gain}
        return SimpleNamespace(gain=lambda rule="γ_m", times=times: gain_of[times[-1]],
                               gamma=lambda: 2.0, rule=lambda name: 1.0)

    assert gain_claim([trial(1.2), trial(1.1), trial(math.nan), trial(0.9)], times).holds
    assert not gain_claim([trial(1.2), trial(0.9), trial(math.nan), trial(0.8)], times).holds


@every_finding
def test_every_claim_holds(key: str) -> None:
    finding = FINDINGS[key](Engine(short=True))
    assert finding.key == key
    assert finding.about.count("\n\n") >= 2
    assert [c for c in finding.claims if not c.holds] == []
    assert any(c.how == "proved" for c in finding.claims) or key in MEASURED
    for panel in finding.panels:
        for series in panel.series:
            assert len(series.x) == len(series.y) > 1
            assert all(type(v) is float and math.isfinite(v) for v in (*series.x, *series.y))


def test_forms_differ_for_another_alpha() -> None:
    assert gradients_claim().holds
    assert not gradients_claim(sp.Symbol("other")).holds


def test_forms_differ_off_the_sphere() -> None:
    assert stages_claim().holds
    assert not stages_claim(sp.Symbol("norm")).holds
    assert not stages_claim(sp.Rational(99, 100)).holds


@pytest.mark.parametrize("s", [1, 2, 3])
def test_gauss_stages_are_no_constraint_nodes(s: int) -> None:
    assert not nodes_claim([gauss_lobatto(s)]).holds


def test_exchanged_pair_is_no_lobatto_iiiab() -> None:
    tableau = lobatto_iiiab(3)
    basis = tableau.basis | {"A": tableau.basis["A_hat"], "A_hat": tableau.basis["A"]}
    assert odd_proof.variational(tableau)
    assert not odd_proof.variational(dataclasses.replace(tableau, basis=basis))


def two_stages() -> Claim:
    return odd_proof.step_claim_symbolic(2)


def three_stages() -> Claim:
    return odd_proof.step_claim_rational(3)


@pytest.mark.parametrize("claim", [
    *(pytest.param(one, marks=pytest.mark.slow) for one in (two_stages, three_stages)),
    odd_proof.identities_claim, lambda: odd_proof.gamma_claim((2,)),
    lambda: odd_proof.variational_claim(range(2, 5))])
def test_the_law_of_odd_stages_is_proved(claim: Any) -> None:
    assert claim().holds


@pytest.mark.parametrize(("term", "claim"), [
    ("C", three_stages),
    pytest.param("B", lambda: odd_proof.gamma_claim((2,)), marks=pytest.mark.slow),
    pytest.param("A", two_stages, marks=pytest.mark.slow)])  # 2 CPU s of algebra
def test_a_wrong_law_is_refuted(monkeypatch: pytest.MonkeyPatch, term: str, claim: Any) -> None:
    def wrong(s: int, top: BodyFrameTop) -> Any:
        law = energy_law(s, top)
        return dataclasses.replace(law, **{term: getattr(law, term) * 2})

    monkeypatch.setattr(odd_proof, "energy_law", wrong)
    assert not claim().holds


def test_energy_of_another_gamma_is_not_quadratic() -> None:
    assert not integrable_claim(sp.Symbol("other")).holds


def test_series_keep_powers_of_both_signs() -> None:
    a = PowerSeries({(0, 0): 1, (1, -1): 2}, 3)
    b = PowerSeries({(1, 1): 3, (3, 0): 5}, 3)
    assert (a * b).terms == {(1, 1): 3, (2, 0): 6, (3, 0): 5}
    assert (a - a).terms == {}
    assert b.shift(h=-1).terms == {(0, 1): 3, (2, 0): 5}
    with pytest.raises(ValueError, match="below"):
        a.shift(h=-1)


@pytest.mark.parametrize("s", range(2, 5))
def test_node_numbers_are_those_of_the_quadrature(s: int) -> None:
    numbers, table = node_numbers(s), lobatto_iiiab(s).numeric(30)
    for i, (b, c) in enumerate(zip(table.b, table.c, strict=True)):
        slope = math.prod(float(c - d) for k, d in enumerate(table.c) if k != i)
        assert float(b) * slope**2 == pytest.approx(float(numbers.mu), rel=1e-12)
    spread = sum(float(c - sp.Rational(1, 2)) ** 2 for c in table.c)
    assert spread == pytest.approx(float(numbers.spread), rel=1e-12)


def test_exact_motion_stays_on_its_constraints() -> None:
    x, y = motion(STATE, 8)
    for n in range(1, 9):
        assert sum(a * b for k in range(n + 1) for a, b in zip(x[k], x[n - k], strict=True)) == 0
        assert sum(a * b for k in range(n + 1) for a, b in zip(x[k], y[n - k], strict=True)) == 0


@pytest.mark.slow  # series of expressions to high orders
@pytest.mark.parametrize("s", [3, 2])
def test_expansion_is_that_of_the_compiled_step(s: int) -> None:
    gamma, dt = 0.7, 0.04
    top = [[float(v) for v in vector]
           for vector in (STATE.l, STATE.vertical, STATE.inverse_inertia)]
    step = stepper("LIIIA-B", s, "gamma")
    inertia = [1 / j for j in top[2]]
    parameters = dict(zip(("I1", "I2", "I3"), inertia, strict=True)) | {
        "mgl": float(STATE.mgl), "gamma": gamma}
    q, p = _state(top[0], top[1], inertia)
    series = energy_error(lobatto_iiiab(s), STATE, 2 * s + 2)
    remainders = []
    for h in (dt, 2 * dt, 4 * dt):
        q1, p1 = step.step(q, p, dt=h, parameters=parameters)
        change = float(step.energy(q1, p1, parameters=parameters)
                       - step.energy(q, p, parameters=parameters))
        expected = sum(float(a) * h**n * gamma**g for (n, g), a in series.terms.items())
        remainders.append(abs(change - expected))
        assert remainders[-1] < 0.02 * h**2 * abs(expected) + 1e-15
    assert QQ(0) == series.coefficient(2 * s - 2)


def _state(l: list[float], vertical: list[float], inertia: list[float]) -> tuple[Any, Any]:  # noqa: E741
    """Return q, p of a body with the given momentum and vertical in its own axes."""
    half = math.acos(vertical[2]) / 2
    axis = np.array([vertical[1], -vertical[0], 0.0]) / math.hypot(*vertical[:2])
    q = np.array([math.cos(half), *(math.sin(half) * axis)])
    q /= np.linalg.norm(q)
    p = momentum(q, [a / i for a, i in zip(l, inertia, strict=True)], inertia)
    return q, p - (q @ p) * q
