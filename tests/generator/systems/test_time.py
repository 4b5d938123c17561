"""Time in H and in constraints: driven systems against themselves with time as a coordinate.

The second way to every number is H + p_τ with the coordinate τ: q and p agree with the direct way,
and W = −(p_τ − p_τ(0)).
"""

from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.certificates.midpoint_conditions import check_mean_scheme
from gyrospark.core.errors import InputError
from gyrospark.generator.pipeline import generate
from gyrospark.generator.schemes.step_equations import MeanScheme
from gyrospark.generator.spec import Spec
from strategies import EPS
from systems import case, start, stepper

t = sp.Symbol("t", real=True)
w, a = sp.symbols("w a", positive=True)
def symbols(text, prefix="p"):
    names = text.split()
    return (sp.symbols(names, real=True), sp.symbols([prefix + x for x in names], real=True))


@cache
def wire():
    (x, y), p = symbols("x y")
    return gs.System((x, y), p, (w, a), sum(u**2 for u in p) / 2,
                     [y * sp.cos(w * t) - x * sp.sin(w * t)], time=t, name="wire")


def as_coordinate(system):
    """Return the system H + p_τ, with time as one more coordinate."""
    tau, p_tau = sp.symbols("tau p_tau", real=True)
    there = {system.time: tau}
    forces = [f.xreplace(there) for f in system.forces]
    return gs.System((*system.q, tau), (*system.p, p_tau), system.parameters,
                     system.H.xreplace(there) + p_tau,
                     [g.xreplace(there) for g in system.constraints], inputs=system.inputs,
                     forces=[*forces, 0] if forces else (), name=system.name + "_tau")


@pytest.mark.slow  # two steppers; closed forms with time are laws
def test_time_as_a_coordinate_gives_the_same():
    name = "driven_pendulum"
    step, entry = stepper(name), case(name)
    extended = gs.stepper("G-L", 2, system=as_coordinate(entry.system))
    q, p = start(name, step)
    options = {"dt": entry.dt, "steps": 40, "parameters": entry.parameters}
    n, p_tau = len(q), 0.0
    for solver in ("auto", "newton"):
        run = step.integrate(gs.Start(q, p, t=entry.t0), **options, solver=solver)
        extended_run = extended.integrate([*q, entry.t0], [*p, p_tau], **options, solver=solver)
        assert np.abs(run.q - extended_run.q[:, :n]).max() <= 1e4 * EPS * np.abs(run.q).max()
        assert np.abs(run.p - extended_run.p[:, :n]).max() <= 1e4 * EPS * np.abs(run.p).max()
        assert np.abs(run.t - extended_run.q[:, n]).max() <= 60 * EPS
        work = run.work - (extended_run.work if extended.binding.has_forces else 0)
        assert np.abs(work + extended_run.p[:, n]).max() <= 1e4 * EPS * (
            1 + np.abs(run.energy()).max())


@pytest.mark.parametrize("name", ["wire", "breathing", "shaken"])
def test_balance_and_constraint_work_are_identities(name):
    system = wire() if name == "wire" else case(name).system
    if system.velocities:
        system = system.legendre()
    lines = {line.name: line for line in check_mean_scheme(MeanScheme(system, discrete=True))}
    for law in ("energy", "constraint work", "symmetric", "consistent", "order"):
        assert lines[law].holds, lines[law]
    if name == "wire":  # no root: proved
        assert "D_t" in lines["energy"].equation


def test_time_that_nobody_declared_is_refused():
    (x, y), p = symbols("x y")
    for H, g in ((p[0]**2 + x * t, []), (p[0]**2, [x - sp.sin(t)])):
        with pytest.raises(InputError, match=r"'t'.* time"):
            gs.System((x, y), p, (), H, g, name="undeclared")


def test_a_start_off_a_moving_constraint_is_refused():
    step, entry = stepper("breathing"), case("breathing")
    q, p = start("breathing", step)
    options = {"dt": 0.01, "steps": 1, "parameters": entry.parameters}
    for momenta, t0 in ((p + 0.1, entry.t0), (p, entry.t0 + 0.1)):
        with pytest.raises(InputError, match="project"):
            step.integrate(gs.Start(q, momenta, t=t0), **options)
    for now in (entry.t0, 0.1):
        consistent = gs.consistent(entry.system, q, p, parameters=entry.parameters, t=now)
        compiled = step.consistent(q, p, parameters=entry.parameters, t=now)
        assert np.allclose(consistent.q, compiled.q, atol=8 * EPS)
        assert np.allclose(consistent.p, compiled.p, atol=8 * EPS)


def test_control_says_that_it_takes_time_in_forces_only():
    spec = Spec.from_arguments("G-L", 2).with_profile("control")
    with pytest.raises(InputError, match="profile full"):
        generate(spec, system=wire())
