"""Other libraries: the page's blocks run where their library is installed; SciPy with gradients."""

from __future__ import annotations

import importlib
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.optimize import minimize

from documents import FENCE
from flows import start_of, stepper_of
from gyrospark.core.errors import MissingDependencyError
from gyrospark.core.extras import install
from processes import ROOT

HEAD, *SECTIONS = (ROOT / "docs" / "interop.md").read_text(encoding="utf-8").split("\n## ")


def blocks(text):
    return "\n".join(block[2] for block in FENCE.finditer(text) if block[1] in ("py", "python"))


def check_jax(namespace):
    assert namespace["loss"](namespace["parameters"]) > 0
    assert namespace["jax"].vmap(namespace["end"])(namespace["many"]).shape == (16, 8)


def check_pytorch(namespace):
    assert abs(float(namespace["scale"].grad) - 10.8) < 0.05


def check_casadi(namespace):
    run = namespace["swing"].integrate([0, -1], [0, 0], dt=0.1, steps=20, parameters={"g": 9.81},
                                       inputs=namespace["controls"][:, None])
    assert np.abs(run.q[-1] - [0, 1]).max() < 1e-6


def check_scipy(namespace):
    assert np.abs(namespace["fit"].x - 1).max() < 1e-9


CHECKS = {"JAX": ("jax", check_jax), "PyTorch": ("torch", check_pytorch),
          "CasADi": ("casadi", check_casadi), "SciPy": ("scipy", check_scipy)}


@pytest.mark.parametrize("title", CHECKS)
@pytest.mark.filterwarnings("ignore:.*torch.jit.*:DeprecationWarning")
def test_blocks_of_a_section(title):
    package, check = CHECKS[title]
    if find_spec(package) is None:
        pytest.skip(f"{title} is not installed: the extra {package} brings it")
    (section,) = (text for text in SECTIONS if text.startswith(f"{title}\n"))
    namespace: dict[str, object] = {}
    try:
        exec(blocks(HEAD) + blocks(section), namespace)
        check(namespace)
    finally:
        if package == "jax":
            namespace["jax"].config.update("jax_enable_x64", False)


def test_each_section_with_code_is_run():
    assert {section.partition("\n")[0] for section in SECTIONS if blocks(section)} == CHECKS.keys()


@pytest.mark.parametrize("name", ["jax", "torch", "casadi"])
def test_a_missing_package_is_named(name, monkeypatch):
    for module in [loaded for loaded in sys.modules if loaded.partition(".")[0] == name]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, f"gyrospark.interop.{name}", raising=False)
    with pytest.raises(MissingDependencyError) as refusal:
        importlib.import_module(f"gyrospark.interop.{name}")
    assert install(name) in str(refusal.value)


def test_minimize_finds_inputs():
    """By the adjoint, little effort turns a pendulum nearly into a prescribed state."""
    step, steps = stepper_of("pushed"), 20
    q, p, parameters, dt, _ = start_of("pushed")
    goal = np.array([0.0, 1.0])

    def miss(run):
        difference = run.q[-1] - goal
        return difference @ difference + run.p[-1] @ run.p[-1], {
            "q": 2 * difference, "p": 2 * run.p[-1]}

    f = step.value_and_gradient(miss, q, p, wrt=["inputs"], parameters=parameters, dt=dt,
                                steps=steps, inputs=np.zeros((steps, 2)))

    def loss(x):
        value, gradient = f(x)
        return value + 1e-6 * x @ x, gradient + 2e-6 * x

    result = minimize(loss, np.full(2 * steps, 0.1), jac=True, method="L-BFGS-B",
                      options={"maxiter": 100})
    assert result.success
    assert result.nfev < 60
    run = step.integrate(q, p, dt=dt, steps=steps, parameters=parameters,
                         inputs=result.x.reshape(steps, 2))
    assert np.abs(run.q[-1] - goal).max() < 1e-2
