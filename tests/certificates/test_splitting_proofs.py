"""Proofs hold for true statements and fail for false ones."""

from __future__ import annotations

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.certificates import splitting_proofs as proofs
from gyrospark.certificates.guarantees import SplittingGuarantees
from gyrospark.certificates.verification import verify_stepper
from gyrospark.generator.multibody.body import Body
from gyrospark.generator.multibody.rigid_body import heavy_top, p, q
from gyrospark.generator.spec import Spec
from gyrospark.generator.splitting.decomposition import split
from gyrospark.generator.splitting.kicks import space_matrix, space_torque
from gyrospark.generator.splitting.parts import Kick
from gyrospark.generator.splitting.quotient import Quotient, unit_quaternions
from gyrospark.generator.symbolic.shared_subexpressions import expand_shared
from splitting_systems import SYSTEMS, molecules


def test_flows_of_the_catalogue_are_proved():
    lines = proofs.prove_flows()
    assert all(line.holds for line in lines)
    assert {line.name for line in lines} == {
        "sphere", "axis", "symmetric body with drag", "space", "parts of T"}


@pytest.mark.parametrize("change", [
    lambda flow: {"H": 2 * flow.H},
    lambda flow: {"drag": flow.drag + 1},
    lambda flow: {"rates": {x: 2 * e for x, e in flow.rates.items()}},
    lambda flow: {"q": [flow.q[0] + 1, *flow.q[1:]]},
    lambda flow: {"l": [2 * flow.l[0], *flow.l[1:]]},
])
def test_wrong_flows_are_not_proved(change):
    for flow in islice(proofs._flows(), 1):
        assert not all(line.holds for line in replace(flow, **change(flow)).proofs())


@pytest.mark.parametrize("name", [*SYSTEMS, pytest.param("molecules", marks=pytest.mark.slow)])
def test_parts_add_up_to_H(name):
    if name in SYSTEMS:
        system, _, symmetric = SYSTEMS[name]
    else:
        symmetric, system = False, molecules(2, (1, 1.4, 0.8)).system
    splitting = split(system, symmetric=symmetric)
    assert all(line.holds for line in proofs.prove_splitting(splitting))
    body = splitting.bodies[0]
    wrong = replace(splitting, bodies=(replace(body, a=2 * body.a), *splitting.bodies[1:]))
    assert not proofs.prove_splitting(wrong)[0].holds


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_body_is_symmetric_about_any_axis(axis):
    top, moments = heavy_top("gamma"), sp.symbols("I1 I2 I3", positive=True)
    equal, third = (moment for i, moment in enumerate(moments) if i != axis)
    splitting = split(replace(top, H=top.H.subs(equal, third)))
    assert [axis_part.axis
            for axis_part in splitting.bodies[0].axes] == [tuple(np.eye(3, dtype=int)[axis])]
    assert not splitting.bodies[0].further
    assert all(line.holds for line in proofs.prove_splitting(splitting))


def test_parts_of_a_charge_in_a_plane_add_up_to_H():
    """In a magnetic field the charge moves straight on while the plane turns at −c/b."""
    x, y, u, v, b, c = sp.symbols("x y u v b c", real=True)
    H = ((u - c * y)**2 + (v + c * x)**2) / (2 * b)
    splitting = split(gs.System((x, y), (u, v), (b, c), H, name="plane"))
    assert all(line.holds for line in proofs.prove_splitting(splitting))
    turn = replace(splitting.space[0], omega=(0, 0, c / b))
    assert not proofs.prove_splitting(replace(splitting, space=(turn,)))[0].holds


def test_parts_that_do_not_commute_are_no_exact_flow():
    splitting = split(heavy_top("gamma"))
    body = splitting.bodies[0]
    merged = replace(splitting,
                     bodies=(replace(body, axes=(*body.axes, *body.further), further=()),))
    sums, commute = proofs.prove_splitting(merged)
    assert sums.holds
    assert not commute.holds


def gradient_is_proved(splitting):
    """Whether ``gradient`` is the kick of G = −{V, {T, V}}, without forces."""
    ring, system = proofs._Ring(splitting), splitting.system
    T = sp.Add(*(x for name, x in proofs.hamiltonians(splitting) if name != "V"))
    inner = proofs.bracket(T, splitting.V, system.q, system.p)
    G = -proofs.bracket(splitting.V, inner, system.q, system.p)
    expected = [*(e for x in splitting.quaternions
                  for e in space_torque(x, [-sp.diff(G, y) for y in x])),
                *(-sp.diff(G, system.q[i]) for i in splitting.points)]
    kick = [*(e for N in splitting.gradient.torques for e in N), *splitting.gradient.forces]
    return all(ring.vanishes(x - expand_shared(y)) for x, y in zip(expected, kick, strict=True))


@pytest.mark.parametrize("name", [
    pytest.param("alpha", marks=pytest.mark.slow), "gamma", "gyrostat"])
def test_the_gradient_is_the_double_bracket(name):
    """The gyrostat has a torque about its axis."""
    splitting = split(SYSTEMS[name][0], symmetric=True)
    assert gradient_is_proved(splitting)
    wrong = replace(splitting)
    wrong.__dict__["gradient"] = Kick(
        tuple(tuple(-e for e in N) for N in splitting.gradient.torques), ())
    assert not gradient_is_proved(wrong)


def test_the_gradient_of_points_and_of_an_unsteady_axis():
    x, px, m = sp.symbols("x px m", positive=True)
    spring = gs.System((x,), (px,), (m,), px**2 / (2 * m) + x**4, name="spring")
    splitting = split(spring)
    (force,) = splitting.gradient.forces
    assert sp.expand(force.replace(lambda e: e.func.__name__ == "Shared", lambda e: e.args[0])
                     + sp.diff((4 * x**3)**2 / m, x)) == 0
    assert gradient_is_proved(splitting)


def test_invariants():
    top = split(heavy_top("gamma"), symmetric=True)
    assert [name for name, _ in proofs.invariants(top)] == [
        "angular momentum about e3", "angular momentum about the body's axis 3"]
    asymmetric = split(heavy_top("gamma"))
    assert [name for name, _ in proofs.invariants(asymmetric)] == ["angular momentum about e3"]
    assert not proofs.invariants(split(SYSTEMS["drag"][0]))
    assert not proofs.is_invariant(top, q[0] * p[1])
    # a certificate has the parts of the moments of inertia that it is given
    for I2, count in ((2, 2), (3, 1)):
        numbers = {x: sp.Integer(I2 if x.name == "I2" else 2) for x in top.system.parameters}
        parts = SplittingGuarantees(top.system, numbers, 2).splitting
        assert len(list(proofs.invariants(parts))) == count


@pytest.mark.parametrize(("name", "symmetric"), [("gamma", True), ("drag", True),
                                                 ("driven", False)])
def test_forces_without_a_closed_flow_are_not_symmetric(name, symmetric):
    """Isotropic drag has an exact flow, drag about one axis has none."""
    system, _, _ = SYSTEMS[name]
    promises = SplittingGuarantees(system, {x: sp.Integer(2) for x in system.parameters}, 2)
    assert promises.symmetric is symmetric
    assert promises.loop().guaranteed is (name == "gamma")
    assert not promises.energy().guaranteed


def test_parts_and_flows_are_conditions_of_a_stepper():
    conditions = verify_stepper(Spec.from_arguments("splitting", order=2)).conditions
    assert all(line.holds for line in conditions)
    assert {line.name for line in conditions} >= {
        line.name for line in (*proofs.prove_flows(), *proofs.prove_splitting(
            split(heavy_top("gamma"), symmetric=True)))}


def test_the_space_torque_is_the_rate_of_angular_momentum():
    momentum = Body.free("a", "gamma").angular_momentum
    names = dict(zip(sp.symbols("a_q0:4 a_p0:4", real=True), (*q, *p), strict=True))
    expected = space_matrix(q) * sp.Matrix(p) / 2
    assert [e.xreplace(names) for e in momentum] == [sp.expand(e) for e in expected] or all(
        sp.expand(e.xreplace(names) - x) == 0 for e, x in zip(momentum, expected, strict=True))


def test_normal_forms_modulo_the_sphere():
    ring = Quotient(unit_quaternions([q]))
    square = sum(x**2 for x in q)
    assert ring.vanishes(square**3 - 1)
    assert ring.vanishes(sp.cos(square * q[1]) - sp.cos(q[1]))
    assert not ring.vanishes(square - 2)
    assert ring.expression(q[0]**5) == sp.expand(
        q[0] * (1 - q[1]**2 - q[2]**2 - q[3]**2)**2)
