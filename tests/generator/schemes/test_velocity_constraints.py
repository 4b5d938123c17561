"""The equations of a step with velocity constraints: orders, derivatives, work, refusals."""

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from calls import jacobian_by_differences
from gyrospark.core.errors import InputError
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from rolling_systems import (
    DISC,
    SKATE_CHAIN,
    SKATE_CHAIN_START,
    SLEIGH,
    disc,
    disc_state,
    skate_chain,
    sleigh,
    sleigh_end,
    sleigh_state,
    stepper_of,
)


def test_order_on_the_sleigh():
    """With a trigonometric row and no g, θ and p converge to their closed form with order 4."""
    u, w, th = sleigh_end(0.7, 1.5, 0.3, 2.0)
    p, errors = sleigh_state(u, w, th)[1], []
    for count in (32, 64):
        run = stepper_of(sleigh, 2).integrate(*sleigh_state(0.7, 1.5), dt=2 / count, steps=count,
                                              parameters=SLEIGH)
        errors.append([abs(run.q[-1, 2] - th), np.abs(run.p[-1] - p).max()])
    assert np.log2(np.divide(*errors)) == pytest.approx([4, 4], abs=0.12)


@pytest.mark.slow
@pytest.mark.parametrize(("make", "parameters", "start"), [
    (sleigh, SLEIGH, sleigh_state(0.7, 1.5)), (disc, DISC, disc_state()),
    (skate_chain, SKATE_CHAIN, SKATE_CHAIN_START)])
@pytest.mark.parametrize("s", [1, 2, 3, 4])
def test_orders_in_113_bits(make, parameters, start, s):
    step, best = (stepper_of(make, count, real="float128") for count in (s, 7))
    start = step.project(*start, parameters=parameters)
    run = best.integrate(*start, dt=0.0125, steps=40, parameters=parameters)
    errors = []
    for steps in (40, 80):
        ours = step.integrate(*start, dt=0.5 / steps, steps=steps, parameters=parameters)
        errors.append([float(abs(ours.q[-1] - run.q[-1]).max()),
                       float(abs(ours.p[-1] - run.p[-1]).max())])
    assert np.log2(np.divide(*errors)) == pytest.approx([2 * s, 2 * s], abs=0.1)


def driven_sleigh():
    """Return the Lagrangian of the sleigh with a row that moves, forces of time, and the time."""
    system, t = sleigh(), sp.Symbol("t", real=True)
    (row,), v, (m, inertia, _) = system.velocity_constraints, system.velocities, system.parameters
    row += sp.sin(2 * t) * sp.cos(system.q[0]) / 3 - t * v[1] / 5
    return gs.System.from_lagrangian(
        (m * (v[0]**2 + v[1]**2) + inertia * v[2]**2) / 2, system.q, v, system.parameters,
        velocity_constraints=[row], forces=(-m * v[0] / 7, sp.sin(t), sp.sin(t)), time=t,
        name="driven_sleigh")


def test_jacobian_of_rows_that_move_is_the_derivative_of_the_residual():
    step, start = stepper_of(driven_sleigh, 2), sleigh_state(0.7, 1.5)
    x = np.random.default_rng(3).standard_normal(step.unknowns)
    options = {"dt": 0.3, "parameters": SLEIGH, "t": 0.4}
    J = step.jacobian(x, *start, **options)
    differences = jacobian_by_differences(step, x, *start, **options)
    assert np.abs(differences - J).max() < 1e-8 * np.abs(J).max()


def test_work_of_rows_that_move():
    """H of a blade on a belt gains μ·a, to the order of the method; rows hold at their own time."""
    step = stepper_of(driven_sleigh, 2)
    start = step.project(*sleigh_state(0.7, 1.5), parameters=SLEIGH)
    runs = [step.integrate(*start, dt=2 / n, steps=n, parameters=SLEIGH) for n in (32, 64)]
    gain = runs[1].energies[-1] - runs[1].energies[0]
    assert abs(gain) > 0.05
    assert abs(runs[1].report.work - gain) < 1e-6 * abs(gain)
    ratio = runs[0].report.energy_error_max / runs[1].report.energy_error_max
    assert np.log2(ratio) == pytest.approx(4, abs=0.15)
    assert runs[1].report.momentum_constraint_max < 4e-15


def test_reactions_are_those_of_the_equations():
    """The sleigh, which no force pushes, has μ = −u w/(1/m + a²/I) at the times of the stages."""
    step = stepper_of(sleigh, 2)
    run = step.integrate(*sleigh_state(0.7, 1.5), dt=0.01, steps=1, parameters=SLEIGH)
    m, inertia, a = SLEIGH.values()
    for c, mu in zip(gs.tableau("G-L", 2).numeric(17).c, run.reactions[0, :, 0], strict=True):
        u, w, _ = sleigh_end(0.7, 1.5, 0.3, 0.01 * float(c))
        assert mu == pytest.approx(-u * w / (1 / m + a * a / inertia), rel=1e-5)


@pytest.mark.parametrize(("scheme", "stages"), [("IMS", None), ("EMS", None), ("LIIIA-B", 3)])
def test_schemes_without_equations_for_them_are_refused(scheme, stages):
    with pytest.raises(InputError, match=rf"{scheme}.*sleigh.*G-L or Radau-L"):
        gs.stepper(scheme, stages, system=sleigh())


@pytest.mark.parametrize(("options", "named"), [
    ({"spec": Spec.from_arguments("G-L", 2).with_profile("control")}, "control"),
    ({"spec": Spec.from_arguments("G-L", 2).with_profile("run")}, "run"),
    ({"spec": Spec.from_arguments("G-L", 2).with_frame("symmetries")}, "frame"),
    ({"derivatives": True}, "[Dd]erivatives"), ({"structured": True}, "structured"),
    ({"tableau": gs.tableau("G-L", 2)}, "tableau")])
def test_what_does_not_know_them_is_refused(options, named):
    with pytest.raises(InputError, match=rf"{named}[^.]*sleigh|sleigh[^.]*{named}"):
        generate(**{"spec": Spec.from_arguments("G-L", 2)} | options, system=sleigh())


def test_derivatives_of_steps_are_refused():
    with pytest.raises(InputError, match=r"sleigh"):
        stepper_of(sleigh, 2).vjp(*sleigh_state(0.7, 1.5), dt=0.1, parameters=SLEIGH)
