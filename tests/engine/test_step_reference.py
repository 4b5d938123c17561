"""One step of every stepper against an independent one in 50 digits.

The doubles of a step have these errors at most, with ε = 2⁻⁵² and sizes as largest components:

    q      32 ε |q|
    p      32 ε |p|
    Λ, λ   ‖(ĀÃ)⁻¹‖ γ/Δt² · ε, and 32 ε |Λ|

32 ε is loose: a run stays below 2 ε, as ``pytest -rP`` shows. The reason is that g(q) at the
start is evaluated in twice the working precision. The multipliers must undo its error δg within
the step: by −Δt² ĀÃ ⊗ g_q H_pp g_qᵀ, with g_q H_pp g_qᵀ = 1/γ, it is worth (ĀÃ)⁻¹ γ δg/Δt² in Λ,
so 4γ δg/Δt in p along q; SPARK's T2 projects that away, IMS and EMS keep it. With g(q) rounded
to double, δg ≤ ½ε, the momenta of IMS and EMS were off by up to 104 ε along q.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.generator.spec import Spec
from reference import doubles, reference
from strategies import (
    EPS,
    HIGH_SPECS,
    PAPER_SPECS,
    cases,
    few,
    identify,
    random_case,
    stepper_of,
    tableau_of,
)

BOUND = 32 * EPS


def largest(x):
    return float(np.abs(x).max())


def stiffness(spec):
    """Return ‖(ĀÃ)⁻¹‖, what one unit of constraint defect costs in multipliers; 4 without tableau.

    Λ_p comes from T2 instead, as qᵀP/(2Δt b̃_p); 1/(2b̃_p) ≤ s² is below the norm or near it.
    """
    if spec.stages is None:
        return 4.0
    tableau = tableau_of(spec.scheme, spec.stages)
    product = doubles(tableau.A_bar)[1:] @ doubles(tableau.A_tilde)[:, :-1]
    return max(4.0, float(np.linalg.norm(np.linalg.inv(product), np.inf)))


def errors(spec, case):
    """Return the errors of one step: of q and p in units of ε, of Λ in units of its bound."""
    exact = reference(spec, case).step()
    trajectory = stepper_of(spec).integrate(case.q, case.p, steps=1, **case.run)
    # Subtracted before rounding: the reference is not blurred to a double first.
    dq, dp = doubles(trajectory.q[1] - exact.q), doubles(trajectory.p[1] - exact.p)
    dL = doubles(trajectory.multipliers[0] - exact.multipliers[:, 0])
    unit = abs(case.weight / case.dt)
    L_bound = (stiffness(spec) * unit / abs(case.dt) * EPS
               + BOUND * largest(doubles(exact.multipliers)))
    return {
        "q": largest(dq) / largest(doubles(exact.q)) / EPS,
        "p": largest(dp) / largest(doubles(exact.p)) / EPS,
        "multipliers_of_bound": largest(dL) / L_bound,
    }


def check(sizes):
    assert sizes["q"] <= 32
    assert sizes["p"] <= 32
    assert sizes["multipliers_of_bound"] <= 1


def check_many(spec, count):
    """Check steps from random states, forwards and backwards; the worst is printed."""
    rng = np.random.default_rng(2026)
    worst = {}
    for index in range(count):
        case = random_case(rng, spec.rep)
        if index % 2:
            case = replace(case, dt=-case.dt)
        sizes = errors(spec, case)
        check(sizes)
        worst = {name: max(worst.get(name, 0.0), value) for name, value in sizes.items()}
    print("WORST", identify(spec), *(f"{name} {value:.2f}" for name, value in worst.items()))


@pytest.mark.parametrize("spec", few(PAPER_SPECS), ids=identify)
def test_paper_steppers(spec):
    check_many(spec, 4)


@pytest.mark.parametrize("spec", [
    Spec("G-L", 8), pytest.param(Spec("LIIIA-B", 8, "alpha"), marks=pytest.mark.slow)],
    ids=identify)
def test_many_stages(spec):
    check_many(spec, 2)


@pytest.mark.slow
@pytest.mark.parametrize("spec", [*PAPER_SPECS, *HIGH_SPECS], ids=identify)
def test_many_bodies(spec):
    check_many(spec, 20)


@pytest.mark.parametrize(
    "spec", [Spec("EMS"), Spec("G-L", 2), *(
        pytest.param(spec, marks=pytest.mark.slow) for spec in (Spec("IMS"), Spec("LIIIA-B", 3)))],
    ids=identify)
@settings(max_examples=4, derandomize=True)
@given(data=st.data())
def test_special_states(spec, data):
    """Hypothesis seeks the corners: zeros in q and Ω, mgl = 0, γ at the ends of its range."""
    check(errors(spec, data.draw(cases(spec.rep))))


def test_a_wrong_digit_shows():
    """An error of 3e-13 in one moment exceeds the bound of q in most steps."""
    spec, detected = Spec("G-L", 3), 0
    rng = np.random.default_rng(1)
    for _ in range(8):
        case = random_case(rng, "gamma", turn=(0.2, 0.3))
        spoiled = replace(case, parameters=case.parameters | {
            "I1": case.parameters["I1"] * (1 + 3e-13)})
        exact = reference(spec, spoiled).step()
        trajectory = stepper_of(spec).integrate(case.q, case.p, steps=1, **case.run)
        detected += largest(doubles(trajectory.q[1] - exact.q)) > BOUND
    assert detected >= 4
