"""Without its package each module says which extra brings it."""

from __future__ import annotations

import importlib
import sys

import pytest

from gyrospark.core.errors import MissingDependencyError
from gyrospark.core.extras import install


@pytest.mark.parametrize("name", ["jax", "torch", "casadi"])
def test_a_missing_package_is_named(name, monkeypatch):
    for module in [one for one in sys.modules if one.partition(".")[0] == name]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, f"gyrospark.interop.{name}", raising=False)
    with pytest.raises(MissingDependencyError) as refusal:
        importlib.import_module(f"gyrospark.interop.{name}")
    assert install(name) in str(refusal.value)
