"""Steps of a splitting solve the equations of motion of its system, to their order."""

from __future__ import annotations

from itertools import chain

import numpy as np
import pytest

from gyrospark.generator.splitting.find import split
from splitting_flows import Flows, _rotation, compiled, motion
from splitting_systems import SYSTEMS, molecules, start


def error(flows, step, q0, p0, exact, t_end, steps):
    """Return the difference to the exact state after so many steps."""
    x = flows.start(q0, p0)
    for _ in range(steps):
        step(x, t_end / steps)
    assert x.t == pytest.approx(t_end)
    return max(np.abs(x.q - exact[0]).max(), np.abs(flows.momenta(x) - exact[1]).max())


@pytest.mark.parametrize("name", SYSTEMS)
def test_symmetric_steps_have_order_two(name):
    system, values, symmetric = SYSTEMS[name]
    splitting = split(system, symmetric=symmetric)
    flows = Flows(splitting, values)
    q0, p0 = start((0.3, -0.5, 1.2), values)
    exact = motion(system, values, q0, p0, 0.5, 100)
    coarse, fine = (error(flows, flows.strang, q0, p0, exact, 0.5, n) for n in (10, 20))
    assert splitting.other_forces is (name == "driven")
    assert coarse < 4e-3
    assert 3.8 < coarse / fine < 4.2


@pytest.mark.parametrize("name", ["gamma", "drag"])
def test_force_gradients_give_order_four(name):
    system, values, _ = SYSTEMS[name]
    flows = Flows(split(system, symmetric=True), values)
    q0, p0 = start((0.3, -0.5, 1.2), values)
    exact = motion(system, values, q0, p0, 1.0, 400)
    coarse, fine = (error(flows, flows.forward4, q0, p0, exact, 1.0, n) for n in (8, 16))
    assert coarse < 1e-5
    assert 14 < coarse / fine < 18


@pytest.mark.parametrize(("inertia", "order", "t_end"), [
    ((1, 1.4, 0.8), 2, 0.5),
    pytest.param((1, 1, 0.8), 4, 1.0, marks=pytest.mark.slow)])  # gradients of two bodies
def test_molecules_have_order_two_and_four(inertia, order, t_end):
    model = molecules(2, inertia)
    splitting = split(model.system, symmetric=order == 4)
    flows = Flows(splitting, model.parameters)
    exact = motion(model.system, model.parameters, model.q0, model.p0, t_end, 100)
    step = flows.forward4 if order == 4 else flows.strang
    coarse, fine = (error(flows, step, model.q0, model.p0, exact, t_end, n) for n in (8, 16))
    assert coarse < 1e-4
    assert coarse / fine == pytest.approx(2**order, rel=0.1)


@pytest.mark.slow  # the gradient of three bodies in one piece takes eight seconds
def test_templates_add_up_to_the_gradient():
    model = molecules(3, (1, 1, 0.8), neighbours=1)
    splitting = split(model.system)
    flows = Flows(splitting, model.parameters)
    whole = flows._function(splitting.gradient)
    x = flows.start(model.q0, model.p0)
    at = [*x.q, *x.l.ravel(), *x.p, 0.0]
    kick = np.array(flows.kick_of(*at))
    torques, forces = kick[:9].reshape(3, 3), dict(zip(splitting.points, kick[9:], strict=True))
    turning, found, moved = [], np.zeros((3, 3)), dict.fromkeys(splitting.points, 0.0)
    for body, N in zip(splitting.bodies, torques, strict=True):
        R = _rotation(x.q[list(body.q)])
        S = np.array(body.S.xreplace(flows.values), float)
        turning.append(R @ S @ R.T @ N)
    for template in splitting.templates:
        names = [y for slot in template.bodies for y in slot]
        slope = compiled([*names, *template.coordinates, *template.constants,
                          *(y for rate in template.rates for y in rate)],
                         [*chain(*template.slope.torques), *template.slope.forces])
        for one in template.instances:
            rates = slope(
                *(x.q[i] for b in one.bodies for i in splitting.bodies[b].q),
                *(x.q[i] for i in one.coordinates),
                *(model.parameters[str(model.system.parameters[i])] for i in one.constants),
                *(w for b in one.bodies for w in turning[b]),
                *(flows._number(splitting.translation.inverse_mass[i, i]) * forces[i]
                  for i in one.coordinates))
            for k, b in enumerate(one.bodies):
                found[b] += rates[3 * k : 3 * k + 3]
            for i, e in zip(one.coordinates, rates[3 * len(one.bodies) :], strict=True):
                moved[i] += e
    np.testing.assert_allclose([*found.ravel(), *moved.values()], whole(*at),
                               rtol=1e-12, atol=1e-15)
