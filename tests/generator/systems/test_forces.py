"""Forces without a potential: sums shared with H_p, the time, and no steps."""

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.multibody.rigid_body import free_body
from gyrospark.generator.schemes.fast_path import FastSystem
from gyrospark.generator.schemes.step_equations import hoist_constants
from systems import case, start, stepper

x, y, u, v, tau = sp.symbols("x y u v tau", real=True)
c = sp.Symbol("c", positive=True)
PARAMETERS = case("dragged_pendulum").parameters


def test_the_manifest_has_forces_and_time_where_there_is_one():
    for name, timed in (("pushed_pendulum", False), ("dragged_pendulum", True)):
        manifest = stepper(name).manifest.system
        assert manifest.forces == tuple(str(e) for e in case(name).system.forces)
        assert (manifest.time is not None) == timed


def body_with_drag(rep):
    """Return a symmetric body with torque τ = −c Ω: F = 2 L(q)ᵀ τ, since Ω = 2 L(q) q̇."""
    free = free_body(rep)
    q, p = sp.Matrix(free.q), sp.Matrix(free.p)
    L = sp.Matrix([[-q[1], q[0], q[3], -q[2]], [-q[2], -q[3], q[0], q[1]],
                   [-q[3], q[2], -q[1], q[0]]])
    inertia = [s for s in free.parameters if str(s).startswith("I")]
    rates = [w / (2 * moment) for w, moment in zip(L * p, inertia, strict=True)]
    torque = sp.Matrix([-c * w for w in rates])
    return gs.System(free.q, free.p, (*free.parameters, c), free.H, free.constraints,
                     forces=tuple(2 * L.T * torque), name="dragged_body", rigid_body=True,
                     quantities={f"Omega{i + 1}": w for i, w in enumerate(rates)})


@pytest.mark.parametrize("rep", ["gamma", "alpha"])
def test_what_the_fast_path_proves_of_forces(rep):
    """The torque's L(q)p is evaluated once with H_p, for no constraint force along q changes it."""
    system, _ = hoist_constants(body_with_drag(rep))
    fast = FastSystem(system)
    assert len(fast.shared_sums) == 3
    for shared in fast.shared_sums:
        slope = sum(sp.diff(shared, p) * q for q, p in zip(system.q, system.p, strict=True))
        assert sp.expand(slope) == 0
        assert any(force.has(shared) for force in system.forces)


def test_nothing_is_shared_across_places():
    """With H_pq = 0, sweeps evaluate H_q − F at newer places than H_p; nor is time shared."""
    swirl = x * v - y * u
    kinetic = (u**2 + v**2) / 2
    circle = (x**2 + y**2 - 1,)
    separable = gs.System((x, y), (u, v), (), kinetic, circle, forces=(-y * swirl, x * swirl))
    assert FastSystem(separable).is_separable
    assert FastSystem(separable).shared_sums == []
    timed = gs.System((x, y), (u, v), (), kinetic + swirl**2 * x, circle,
                      forces=(tau * y + swirl * (u - tau), 0), time=tau)
    assert all(tau not in u.free_symbols for u in FastSystem(timed).shared_sums)


def test_time_at_a_failure():
    """A failed step is reported at the time of its own run, alone and in an ensemble."""
    step, usual = stepper("breathing"), case("breathing").parameters
    small = usual | {"l": 0.1}  # an ellipse that vanishes on the way
    starts = [step.project([0.9, 0.7], [0.5, 0.4], parameters=parameters, t=0.5)
              for parameters in (small, usual)]
    with pytest.raises(gs.StepFailed) as caught:
        step.integrate(gs.Start(*starts[0], t=0.5), dt=0.25, steps=100, parameters=small)
    failure = caught.value
    assert failure.step > 1
    assert failure.t == 0.5 + (failure.step - 1) * 0.25
    ensemble = step.integrate_ensemble(gs.Start(*map(np.array, zip(*starts, strict=True)), t=0.5),
                                       dt=0.25, steps=100, parameters=[small, usual])
    assert list(ensemble.failures) == [0]
    assert ensemble.failures[0].t == 0.5 + (ensemble.failures[0].step - 1) * 0.25
    assert np.isfinite(ensemble.members[0].report.work)
    assert ensemble.members[0].report.work == ensemble.members[0].work[-1]


def test_no_steps_and_no_forces():
    step = stepper("dragged_pendulum")
    q, p = start("dragged_pendulum", step)
    run = step.integrate(gs.Start(q, p, t=3.0), dt=0.1, steps=0, parameters=PARAMETERS)
    assert run.t.tolist() == [3.0]
    assert run.work.tolist() == [0.0]
    ensemble = step.integrate_ensemble([q], [p], dt=0.1, steps=0, parameters=PARAMETERS)
    assert ensemble.members[0].work.tolist() == [0.0]
    with pytest.raises(gs.InputError, match="t = nan"):
        step.integrate(gs.Start(q, p, t=float("nan")), dt=0.1, steps=1, parameters=PARAMETERS)
