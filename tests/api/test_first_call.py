"""What a first call has to do, counted: no clock is looked at."""

from __future__ import annotations

import gc
import sys

import pytest

from gyrospark.core.lazy_imports import imported_for_good
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.systems.system import System


@pytest.mark.parametrize("scheme", [("G-L", 2), ("EMS", None)])
def test_the_constraint_on_the_momenta_is_derived_once(scheme, monkeypatch):
    """Of the system with its constants, whatever else has to know what it depends on."""
    derive, of = System.hidden.func, {}
    monkeypatch.setattr(System, "hidden", property(
        lambda system: of[system] if system in of else of.setdefault(system, derive(system))))
    made = generate(Spec.from_arguments(*scheme, "gamma"))
    assert list(of) == [made.scheme.system]


def test_what_is_imported_for_good_is_not_looked_through(monkeypatch):
    """The collector rests meanwhile; nothing is done for what is there already."""
    before = gc.get_freeze_count()  # what was there when all tests were collected
    with imported_for_good("gyrospark"):
        assert gc.isenabled()
    assert gc.get_freeze_count() <= before
    monkeypatch.delitem(sys.modules, "gyrospark.core.lazy_imports")
    kept = [[] for _ in range(1000)]
    with imported_for_good("gyrospark.core.lazy_imports"):
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_freeze_count() >= before + len(kept) // 2
