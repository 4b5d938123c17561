"""The page on other libraries: its blocks run where their library is installed."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
import pytest

from documents import FENCE
from processes import ROOT

HEAD, *SECTIONS = (ROOT / "docs" / "interop.md").read_text(encoding="utf-8").split("\n## ")


def blocks(text):
    return "\n".join(found[2] for found in FENCE.finditer(text) if found[1] in ("py", "python"))


def check_jax(there):
    assert there["loss"](there["parameters"]) > 0
    assert there["jax"].vmap(there["end"])(there["many"]).shape == (16, 8)


def check_pytorch(there):
    assert abs(float(there["scale"].grad) - 10.8) < 0.05


def check_casadi(there):
    run = there["swing"].integrate([0, -1], [0, 0], dt=0.1, steps=20, parameters={"g": 9.81},
                                   inputs=there["controls"][:, None])
    assert np.abs(run.q[-1] - [0, 1]).max() < 1e-6


def check_scipy(there):
    assert np.abs(there["fit"].x - 1).max() < 1e-9


CHECKS = {"JAX": ("jax", check_jax), "PyTorch": ("torch", check_pytorch),
          "CasADi": ("casadi", check_casadi), "SciPy": ("scipy", check_scipy)}


@pytest.mark.parametrize("title", CHECKS)
@pytest.mark.filterwarnings("ignore:.*torch.jit.*:DeprecationWarning")
def test_blocks_of_a_section(title):
    package, check = CHECKS[title]
    if find_spec(package) is None:
        pytest.skip(f"{title} is not installed: the extra {package} brings it")
    (section,) = (one for one in SECTIONS if one.startswith(f"{title}\n"))
    there: dict[str, object] = {}
    try:
        exec(blocks(HEAD) + blocks(section), there)
        check(there)
    finally:
        if package == "jax":
            there["jax"].config.update("jax_enable_x64", False)


def test_each_section_with_code_is_run():
    assert {one.partition("\n")[0] for one in SECTIONS if blocks(one)} == CHECKS.keys()
