"""The benchmark of gradients: rows, errors, the costs over a run. No times are asserted."""

from __future__ import annotations

import importlib.util
import json
import sys

import numpy as np
import pytest

from benchmarks import gradients, pictures
from benchmarks.__main__ import PRINT
from benchmarks.gradients import FastTopGradient, GradientRow, compare_gradients
from benchmarks.peers.gradient_job import of_euler, top_start
from benchmarks.tops import INERTIA, spin_of, tops


@pytest.fixture(scope="module")
def top():
    return FastTopGradient(0.2)


@pytest.mark.slow  # compiles derivatives for speed
def test_gradients_of_ours_and_of_what_is_missing(top, monkeypatch, tmp_path, capsys):
    """Adjoint and tangents agree with long double; each missing program says so in its row."""
    for module in ("heyoka", "diffrax", "jax", "casadi", "mujoco"):
        monkeypatch.setitem(sys.modules, module, None)
    rows = compare_gradients([top], gradients.PEERS, 1, 1e-4, quick=True)
    ours = [row for row in rows if row.peer == "gyrospark"]
    assert [row.setting.split()[-1] for row in ours] == ["adjoint", "tangents"]
    for row in ours:
        assert row.truth_error < 1e-12 < row.error < 1e-6
        assert max(row.by_start, row.by_parameters) == row.error
        assert min(row.median("gradient"), row.median("primal"), row.built) > 0
    assert ours[0].by_start == pytest.approx(ours[1].by_start, rel=1e-3)
    others = {row.peer: row for row in rows if row not in ours}
    assert others.keys() == {*gradients.PEERS} - {"gyrospark"}
    for row in others.values():
        assert "pip install" in row.note
        assert not row.failed
        assert row.error is row.median("gradient") is None
    if importlib.util.find_spec("matplotlib"):
        pictures.draw_gradients(rows, tmp_path / "drawn.png")
        assert (tmp_path / "drawn.png").stat().st_size > 1000
    PRINT["gradients"](rows)
    said = capsys.readouterr().out
    assert all(row.peer in said for row in rows)
    assert json.loads(json.dumps([row.as_dict() for row in rows]))[0]["gradient"]


def test_gradients_by_spin_are_those_by_momentum():
    """Along any direction (dq, dp) and change of moments, against differences of Ω(q, p, I)."""
    random = np.random.default_rng(0)
    by_state, by_values = random.normal(size=7), random.normal(size=4)
    found = of_euler(by_state, by_values)
    start, step = tops()[0], 1e-6
    dq, dp, dI = random.normal(size=4), random.normal(size=4) * 0.1, random.normal(size=3) * 1e-3

    def state(h: float) -> np.ndarray:
        moved = type(start)(start.q + h * dq, start.p + h * dp)
        return np.concatenate([moved.q, spin_of(moved) * INERTIA / (INERTIA + h * dI)])

    assert np.array_equal(state(0.0), top_start())
    rate = (state(step) - state(-step)) / (2 * step)
    given = found.q @ dq + found.p @ dp + found.parameters[:3] @ dI
    assert given == pytest.approx(by_state @ rate + by_values[:3] @ dI, rel=1e-7)


def test_rows_of_a_method_are_a_family():
    names = [GradientRow("top", "ours", "1", f"G-L s=3 Δt={dt:g} adjoint").family
             for dt in (1e-3, 2e-3)]
    assert names[0] == names[1] == "ours G-L s=3 adjoint"
