"""Momenta of velocities: H_p at these momenta equals the rates of the velocities, in numbers."""

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.multibody.rigid_body import heavy_top
from gyrospark.generator.schemes.start_kernels import StartKernels
from gyrospark.generator.splitting import quotient


def oscillators(count):
    """Return masses on springs whose H_pp couples all of them and depends on q."""
    q, p = (sp.symbols(f"{letter}0:{count}", real=True) for letter in "xy")
    H = sum(y**2 for y in p) + sum(p) ** 2 / (2 + sp.sin(q[0])) / 2 + p[0] * q[1] / 3
    return gs.System(q, p, (), H, name="oscillators")


def mass_with_quotient():
    """Return H_pp = x/(x + √2 x² + 1), whose division by x + √2 x² + 1 has no end."""
    x, p = sp.symbols("x p", real=True)
    return gs.System((x,), (p,), (), p**2 / 2 * x / (x + sp.sqrt(2) * x**2 + 1), name="quotient")


SYSTEMS = {
    "gamma": lambda: heavy_top("gamma"), "alpha": lambda: heavy_top("alpha"),
    "four bars": lambda: gs.models.four_bar().system, "coupled": lambda: oscillators(3),
    "quotient": mass_with_quotient,
}


@pytest.mark.parametrize("name", SYSTEMS)
def test_velocities_of_momenta_are_those_of_h(name, monkeypatch):
    system = SYSTEMS[name]()
    if name == "quotient":  # with the allowance of users it takes ten seconds
        monkeypatch.setattr(quotient, "_MAX_PRODUCTS", 1000)
    kernels = StartKernels(system)
    assert kernels.exists
    random = np.random.default_rng(5)
    q = {x: float(random.normal()) for x in system.q}
    for body in system.bodies:
        size = np.linalg.norm([q[x] for x in body.q])
        q |= {x: q[x] / size for x in body.q}
    values = q | {x: float(random.uniform(1, 2)) for x in system.parameters}
    u = {x: float(random.normal()) for x in kernels.symbols}

    def numbers(expressions, extra):
        substitutions = values | extra
        return np.array([float(e.evalf(30, subs=substitutions))
                         for e in map(sp.sympify, expressions)])

    p = dict(zip(system.p, numbers(kernels.momenta(kernels.symbols), u), strict=True))
    rates = numbers(kernels.rates(kernels.symbols), u)
    assert numbers(system.H_p, p) == pytest.approx(rates, rel=1e-12, abs=1e-13)
    assert numbers(kernels.velocities, p) == pytest.approx(list(u.values()), rel=1e-12)
    for body in system.bodies:  # the condition of a unit quaternion on its momenta
        assert sum(q[x] * p[y] for x, y in zip(system.q, system.p, strict=True)
                   if x in body.q) == pytest.approx(0, abs=1e-13)


def test_conditions_of_quaternions_and_systems_without_momenta_of_velocities():
    """D of four rows is not inverted; an H of fourth degree has no momenta of velocities."""
    assert not StartKernels(heavy_top("gamma")).conditions
    assert len(StartKernels(gs.models.four_bar().system).conditions) == 17
    x, y = sp.symbols("x y", real=True)
    assert not StartKernels(oscillators(4)).exists
    assert not StartKernels(gs.System((x,), (y,), (), y**4, name="quartic")).exists
