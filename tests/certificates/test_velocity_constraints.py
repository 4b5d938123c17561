"""Certificates of systems with velocity constraints: rows are guaranteed, ∮p·dq and H are not."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from gyrospark.certificates import certificate
from gyrospark.certificates.guarantees import SparkGuarantees
from gyrospark.certificates.momentum_maps import momentum_maps
from rolling_systems import (
    SKATE_CHAIN,
    SKATE_CHAIN_START,
    SLEIGH,
    skate_chain,
    sleigh,
    sleigh_state,
    transmission,
)


def guarantees(system, parameters, tableau=None):
    numbers = {s: sp.Rational(parameters[str(s)]) for s in system.parameters}
    return SparkGuarantees(system, numbers, tableau or gs.tableau("G-L", 2))


def test_a_certificate():
    model = gs.Model(skate_chain(), SKATE_CHAIN, *SKATE_CHAIN_START)
    found = gs.certify(model, "G-L", 2, dt=0.02, steps=50)
    assert found.holds
    assert found.line("largest |g_q H_p|, |A H_p + a|").holds
    assert found.line("largest |g(q)|").holds
    assert found.line("compiled").holds
    assert "A H_p + a" in found.line("compiled").quantity
    assert found.line("reversal").holds
    assert found.line("order").holds
    for quantity in ("loop", "energy"):
        assert found.line(quantity).holds is None
    assert found.line("loop").value > 1e-3


def test_another_row_is_noticed(monkeypatch):
    """A certificate compares the compiled rows with the model's, not with themselves."""
    compiled = systems.stepper("sleigh")
    row = sleigh().velocity_constraints[0] + sleigh().velocities[2] / 1000
    start = compiled.project(*sleigh_state(0.7, 1.5), parameters=SLEIGH)
    model = gs.Model(replace(sleigh(), velocity_constraints=(row,)), SLEIGH, *start)
    monkeypatch.setattr(certificate, "compile_model", lambda *args, **more: (model, compiled))
    line = gs.certify(model, "G-L", 2, dt=0.02, steps=10).line("compiled")
    assert line.holds is False
    assert line.value > 1e6


@pytest.mark.parametrize(("change", "said"), [
    ({}, "mirror"), ({"force": True}, "not reversible"), ({"affine": True}, "not reversible")])
def test_energy_is_near_or_drifts(change, said):
    """What is said follows from H, F and a; a motion without a mirror drifts all the same."""
    system = transmission()
    if "force" in change:
        system = replace(system, forces=(-system.p[0], sp.Integer(0), sp.Integer(0)))
    if "affine" in change:
        system = replace(system, velocity_constraints=(system.velocity_constraints[0] + 1,))
    found = guarantees(system, {"k": 0.25}).energy()
    assert not found.guaranteed
    assert ("not reversible" in found.why) == (said == "not reversible")
    assert "drift" in found.why
    assert "symmetric" in guarantees(system, {"k": 0.25}, gs.tableau("Radau-L", 2)).energy().why


def test_no_loop_invariant_is_claimed():
    assert not guarantees(sleigh(), SLEIGH).loop().guaranteed


def test_momentum_maps_that_reactions_leave_alone():
    """Momenta of a particle along and across a row."""
    q, p, v = (sp.symbols(f"{c}0:4", real=True) for c in "qpv")
    k = sp.Symbol("k", real=True)
    system = gs.System(q, p, (k,), sum(e**2 for e in p) / 2, velocities=v, name="edge",
                       velocity_constraints=(v[2] - q[0] * v[1],))
    state = np.array([0.2, 0.1, 0.3, 0]), np.array([0.5, 0.6, 0.12, 0.7])
    kept = {str(J.J): guarantees(system, {"k": 1}).momentum(J).guaranteed
            for J in momentum_maps(system, {"k": 1.0}, *state)}
    assert kept["p3"]
    assert kept["p0"]  # the row does not have the velocity of q0
    assert not kept["p1"]
    assert not kept["p2"]


def test_works_to_cite():
    assert "modin2020" in [work.key for work in gs.cite(systems.stepper("sleigh"))]
    assert "modin2020" not in [work.key for work in gs.cite(gs.stepper("G-L", 2))]
