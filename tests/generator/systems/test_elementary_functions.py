"""Systems with sin, exp, log, roots and arcs: energy of EMS at round-off, orders, verification."""

from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from calls import jacobian_by_differences
from gyrospark.certificates.midpoint_conditions import check_mean_scheme
from gyrospark.generator.pipeline import generate
from gyrospark.generator.schemes.step_equations import MeanScheme
from gyrospark.generator.spec import Spec
from strategies import EPS

x, y, u, v = sp.symbols("x y u v", real=True)
a, b = sp.symbols("a b", positive=True)
@cache
def particle():
    """Return a particle of the plane that circles the origin in a V of all elementary functions.

    V has Morse's exponential, a galaxy's logarithm, Toda's lattice, arcs, powers, and an angle that
    crosses the cut of atan2 in every turn.
    """
    V = (a * (1 - sp.cos(x)) + a * (1 - sp.exp(-b * y)) ** 2 + sp.exp(x - y)
         + sp.log(a + x**2 + y**2 / b) / 2 + 4 * (x**2 + y**2) + sp.atan(x * y) + sp.asin(x / 9)
         + sp.atan2(y, x + 7) + sp.tanh(x) + a ** (x + y) + (1 + x**2) ** b
         + sp.sqrt(2 + x * y / 9) + a * sp.cos(3 * sp.atan2(y, x) + b) / 9)
    return gs.System((x, y), (u, v), (a, b), (u**2 + v**2) / 2 + V, name="functions")


PARAMETERS = {"a": 1.4, "b": 0.3}
START = np.array([0.7, 0.2]), np.array([-0.4, 1.3])
RUN = {"dt": 0.01, "parameters": PARAMETERS}
#: The size of the terms of H.
SIZE = 12


@pytest.fixture(scope="module")
def step():
    return gs.stepper("EMS", system=particle())
def test_EMS_keeps_the_energy_to_round_off_over_many_steps(step):
    run = step.integrate(*START, steps=600, **RUN)
    # A few roundings of the terms of H in a step, and they add up like a random walk.
    assert run.report.energy_error_max <= 4 * EPS * np.sqrt(600) * SIZE
    assert run.report.newton_steps == 0
    turns = np.unwrap(np.arctan2(run.q[:, 1], run.q[:, 0]))[-1] / (2 * np.pi)
    assert abs(turns) > 1.8


def test_jacobian_is_that_of_the_residual(step):
    """The Jacobian, which has derivatives of all cardinal functions, equals central differences."""
    unknowns = step.guess(*START, **RUN) * 1.1
    J = step.jacobian(unknowns, *START, **RUN)
    assert np.abs(jacobian_by_differences(step, unknowns, *START, **RUN) - J).max() <= (
        1e-7 * np.abs(J).max())


def test_conditions_hold_and_say_how_they_were_found():
    scheme = MeanScheme(particle(), discrete=True)
    lines = {line.name: line for line in check_mean_scheme(scheme)}
    assert all(line.holds for line in lines.values())
    assert lines["energy"].found.startswith("seen at 8 random points to 30 digits")
    assert lines["constraint work"].found == "proved"


def test_a_state_outside_the_domain_of_H_fails_as_not_finite(step):
    """A state beyond x = 9, where the arc sine ends, is refused as not finite."""
    with pytest.raises(gs.StepFailed, match="not finite"):
        step.integrate([8.0, 0.2], [900.0, 0.0], steps=50, **RUN)


def test_a_wrong_gradient_is_refuted():
    class Wrong(MeanScheme):
        @property
        def mean_gradient(self):
            D_q, D_p = super().mean_gradient
            return [D_q[0] * sp.Rational(10**12 + 1, 10**12)], D_p

    angle = gs.System((x,), (u,), (a,), u**2 / 2 - a * sp.cos(x), name="angle")
    scheme = Wrong(angle, discrete=True)
    lines = {line.name: line for line in check_mean_scheme(scheme)}
    assert lines["consistent"].found == lines["energy"].found == "refuted"
    assert lines["symmetric"].holds
    assert not lines["order"].holds
    assert scheme.order == 0


def test_logarithm_of_a_parameter_is_computed_once_a_run():
    system = gs.System((x,), (u,), (a,), u**2 / 2 + a**x + a ** (-2 * x), name="once")
    source = generate(Spec.from_arguments("EMS"), system=system).source.source
    assert source.count("log(") == 1
    assert "pow(c->" not in source
