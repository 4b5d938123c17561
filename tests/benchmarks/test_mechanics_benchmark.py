"""Models of sympy.physics.mechanics in the benchmark: ours, and PyDy's compiled right-hand side."""

from __future__ import annotations

import time

import numpy as np
import pytest
import sympy as sp

from benchmarks import mechanics
from benchmarks.peers import optional, pydy_mechanics


@pytest.fixture
def small(monkeypatch):
    """What is made for these tests alone is not optimised."""
    monkeypatch.setenv("GYROSPARK_OPTIMISE", "0")
    return mechanics.arm(2)


@pytest.mark.parametrize("model", [mechanics.arm(3), mechanics.tree(3)], ids=lambda m: m.name)
def test_centres_are_those_of_the_system(model):
    """By SymPy's frames and points, at angles that are all different."""
    system, q = model.system(), np.array([0.3, -0.5, 0.8])
    values = dict(zip(system.q, q, strict=True)) | {
        sp.Symbol("l", positive=True): mechanics.VALUES["l"]}
    found = model.centres(q)
    moving = [body for body in system.bodies if body.name != "ground"]
    for body, centre in zip(moving, found, strict=True):
        place = body.masscenter.pos_from(system.fixed_point).to_matrix(system.frame)
        wanted = np.array(place.subs(values), dtype=float).ravel()
        assert centre == pytest.approx(wanted, rel=0, abs=1e-15)


def test_two_links_hang_on_each_but_the_last():
    assert mechanics.tree(7).parents == (None, 0, 0, 1, 1, 2, 2)
    assert mechanics.arm(3).parents == (None, 0, 1)
    assert [model.name for model in mechanics.links()] == ["arm of 7", "tree of 30"]


@pytest.mark.slow  # derives by SymPy's mechanics and compiles
def test_ours_arrives(small):
    coarse, fine = mechanics.compare_mechanics([small], ["gyrospark"], 1, 1e-4, quick=True)
    assert fine.error < coarse.error * 0.4**4 * 1.2  # fourth order
    assert fine.reference_error < 1e-15
    assert fine.us_per_step > 0


def test_a_model_that_pydy_cannot_make_is_a_row(small, monkeypatch):
    """As is a PyDy that is not installed."""
    def broken(system, values):
        raise ArithmeticError("no equations")

    def missing(name, package=None):
        raise optional.Unavailable("not installed (pip install pydy)")

    monkeypatch.setattr(mechanics, "_reference", lambda model, system: (np.zeros(3), 0.0))
    with monkeypatch.context() as patch:
        patch.setattr(pydy_mechanics, "PydyMechanics", broken)
        row, = mechanics.compare_mechanics([small], ["pydy"], 1, 1e-4, quick=True)
    assert row.failed
    assert "no equations" in row.note
    monkeypatch.setattr(pydy_mechanics, "need", missing)
    row, = mechanics.compare_mechanics([small], ["pydy"], 1, 1e-4, quick=True)
    assert "pip install pydy)" in row.note
    assert not row.failed


def test_deriving_has_a_limit():
    """And the alarm is off after it."""
    with (pytest.raises(optional.Unavailable, match=r"in 0\.02 s"),
          pydy_mechanics._limited(0.02)):
        time.sleep(5)
    with pydy_mechanics._limited(0.02):
        pass
    time.sleep(0.03)
