"""Models whose numbers are cached: equal to new ones, and their systems wait."""

from __future__ import annotations

import gc
import sys
from dataclasses import fields, replace

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.api import text_of
from gyrospark.core.lazy_imports import imported_for_good
from gyrospark.generator.multibody import models
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.systems.system import System
from gyrospark.runtime.compilation.build_cache import entries


@pytest.fixture
def pair(tmp_path, monkeypatch):
    """A chain as the builder returns it, and from the cache."""
    monkeypatch.setenv("GYROSPARK_CACHE", str(tmp_path))
    monkeypatch.setattr(models, "_MANY_RODS", 1)
    return gs.models.chain(1), gs.models.chain(1)


def _numbers(model: gs.Model) -> dict[str, object]:
    return {field.name: getattr(model, field.name) for field in fields(model)
            if field.name not in ("system", "q0", "p0")}


def test_a_cached_model_has_the_numbers_and_the_system_of_a_new_one(pair, monkeypatch):
    new, cached = pair
    assert "system" not in vars(cached)
    assert cached.name == new.name
    assert _numbers(cached) == _numbers(new)
    assert np.array_equal(cached.q0, new.q0)
    assert np.array_equal(cached.p0, new.p0)
    assert not cached.q0.flags.writeable
    copy = replace(cached, steps=3)
    assert (copy.steps, copy.system) == (3, new.system)
    assert "system" in vars(cached)
    assert cached.system is cached.system
    with pytest.raises(AttributeError):
        _ = cached.systems


def test_a_stepper_of_a_cached_model_does_not_make_its_system(pair, monkeypatch):
    new, _ = pair
    spec = Spec.from_arguments("IMS")
    files, _ = text_of(spec, new)
    cached = gs.models.chain(1)
    files_of_cached, _ = text_of(spec, cached)
    assert "system" not in vars(cached)
    assert files_of_cached == files
    assert text_of(spec, cached.system)[0] == files


def test_damaged_numbers_are_made_anew(pair):
    new, _ = pair
    (entry,) = [path for path in entries() if path.name.startswith("model-")]
    entry.write_text(entry.read_text().replace("0.2", "0.3", 1))
    rebuilt = gs.models.chain(1)
    assert "system" in vars(rebuilt)
    assert _numbers(rebuilt) == _numbers(new)
    assert "system" not in vars(gs.models.chain(1))


def test_other_arguments_have_other_numbers(pair):
    new, _ = pair
    assert gs.models.chain(3).q0.shape == (21,)
    assert "b0_alpha" in gs.models.chain(2, rep="alpha").bodies
    assert "b0_gamma" in new.bodies
    with pytest.raises(gs.InputError):
        gs.models.chain(2, rep="delta")


@pytest.mark.parametrize("scheme", [("G-L", 2), ("EMS", None)])
def test_the_constraint_on_the_momenta_is_derived_once(scheme, monkeypatch):
    """Only the system with its constants derives it, for whatever depends on it."""
    derive, derived = System.hidden.func, {}
    monkeypatch.setattr(System, "hidden", property(
        lambda system: derived[system] if system in derived
        else derived.setdefault(system, derive(system))))
    generated = generate(Spec.from_arguments(*scheme, "gamma"))
    assert list(derived) == [generated.scheme.system]


def test_what_is_imported_for_good_is_not_looked_through(monkeypatch):
    """The collector rests meanwhile; an import that was done before changes no count."""
    count = gc.get_freeze_count()  # objects at the collection of all tests
    with imported_for_good("gyrospark"):
        assert gc.isenabled()
    assert gc.get_freeze_count() <= count
    monkeypatch.delitem(sys.modules, "gyrospark.core.lazy_imports")
    lists = [[] for _ in range(1000)]
    with imported_for_good("gyrospark.core.lazy_imports"):
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_freeze_count() >= count + len(lists) // 2
