"""Messages on the way: in a notebook, in an interactive Python, on a terminal, and nowhere else."""

from __future__ import annotations

import logging
import re
import sys
import types

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP
from gyrospark.core import progress
from stores import record

LOGGER = logging.getLogger("gyrospark")


@pytest.fixture
def fresh(monkeypatch):
    """Restore the handlers and the level of the logger; a task is shown at once."""
    monkeypatch.setattr(LOGGER, "handlers", [])
    # --json of a command that CliRunner invokes leaves it higher
    monkeypatch.setattr(progress.TERMINAL, "level", logging.NOTSET)
    monkeypatch.setattr(progress, "_FIRST", 0.0)
    monkeypatch.setattr(progress, "_NEXT", 0.0)
    level = LOGGER.level
    yield
    LOGGER.setLevel(level)


@pytest.fixture
def notebook(fresh, monkeypatch):
    """Replace the used modules of a kernel; return a list of the texts below the cell."""
    texts: list[str] = []

    def display(data, raw, display_id):
        assert raw
        assert display_id
        texts.append(data["text/plain"])
        return types.SimpleNamespace(update=lambda data, raw: texts.append(data["text/plain"]))

    shell = types.SimpleNamespace(kernel=object())
    for name, module in (("ipykernel", types.SimpleNamespace()),
                         ("IPython", types.SimpleNamespace(get_ipython=lambda: shell)),
                         ("IPython.display", types.SimpleNamespace(display=display))):
        monkeypatch.setitem(sys.modules, name, module)
    return texts


START = {"dt": 1e-3, "parameters": PARAMETERS}


def integrate(step, **options):
    return step.integrate(TOP.q0, TOP.p0, steps=3000, **START, **options)


def stored(step, **options):
    pytest.importorskip("zarr")
    return record(step, TOP.q0, TOP.p0, steps=300, out="run.zarr", **START, **options)


def ensemble(step, workers):
    return step.integrate_ensemble([TOP.q0] * 64, [TOP.p0] * 64, steps=600, workers=workers,
                                   **START)


def fit(step):
    run = step.integrate(TOP.q0, TOP.p0, steps=40, progress=False, **START)
    return gs.fit(step, TOP, run.t[::10], run.q[::10], free=["I1"], **START)


def sweep(step):
    pytest.importorskip("xarray")
    gs.sweep(TOP, {"gamma": [1e-3, 2e-3]}, scheme="G-L", stages=2, dt=1e-3, steps=3)


CALLS = {
    "integrate": integrate, "record": stored, "fit": fit, "sweep": sweep,
    "one thread": lambda s: ensemble(s, 1),
    "threads": lambda s: ensemble(s, 2),
    "lyapunov": lambda s, **o: gs.lyapunov(s, TOP.q0, TOP.p0, steps=40, **START, **o)}


@pytest.mark.parametrize("name", CALLS)
def test_a_notebook_shows_what_is_under_way(name, notebook, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    CALLS[name](systems.stepper("heavy_top"))
    assert any("%" in text and ("gl2" in text or "cells" in text) for text in notebook), notebook
    assert notebook[-1] == ""


def test_a_notebook_shows_what_is_derived_and_compiled(notebook):
    with progress.log_task("deriving a", "derived a"), progress.log_task("compiling b"):
        pass
    assert notebook == ["", "deriving a …", "compiling b …", "deriving a …", ""]


def test_an_interactive_python_and_who_reads_the_log_hear_of_a_task(fresh, monkeypatch, caplog):
    with caplog.at_level("INFO", "gyrospark"), progress.log_task("compiling b", "compiled b"):
        pass
    assert re.fullmatch(r"compiled b in [\d.]+ s", caplog.messages[-1])
    assert progress.TERMINAL not in LOGGER.handlers
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    with progress.log_task("compiling b"):
        assert progress.TERMINAL in LOGGER.handlers


@pytest.mark.parametrize("name", ["integrate", "lyapunov"])
def test_a_script_shows_nothing_unless_it_asks(name, fresh, capsys):
    step = systems.stepper("heavy_top")
    CALLS[name](step)
    assert capsys.readouterr() == ("", "")
    CALLS[name](step, progress=True)
    out, err = capsys.readouterr()
    assert out == ""
    assert "%" in err
    assert LOGGER.handlers == []
    CALLS[name](step)
    assert capsys.readouterr() == ("", "")


def test_false_is_silence_in_a_notebook_and_bits_are_the_same(notebook, gl3):
    with_progress, silent = integrate(gl3, progress=True), integrate(gl3, progress=False)
    count = len(notebook)
    assert count > 1
    integrate(gl3, progress=False)
    assert len(notebook) == count
    assert np.array_equal(with_progress.q, silent.q)


@pytest.mark.parametrize(("seconds", "total", "left"), [
    (100.0, 100, ["0:13:20"]), (0.5, 100, []), (100.0, 2**60, [])])
def test_the_time_left_is_of_the_speed_so_far(seconds, total, left, fresh, monkeypatch, caplog):
    """80 steps are as fast as 10 before; the last seconds and an open end have no estimate."""
    clock = [0.0]
    monkeypatch.setattr(progress, "time", types.SimpleNamespace(perf_counter=lambda: clock[-1]))
    monkeypatch.setattr(progress, "_NEXT_LINE", 0.0)
    with caplog.at_level("DEBUG", "gyrospark"), progress.log_progress("a run", total) as report:
        report(10)
        clock.append(seconds)
        report(20)
    first, second, _ = caplog.messages
    assert re.findall(r"\d+:\d\d:\d\d", first) == []
    assert re.findall(r"\d+:\d\d:\d\d", second) == left


def test_stages_of_what_has_no_steps_are_counted(tmp_path):
    """Derivation and compilation, a certificate and an artefact count their stages."""
    top, reports = gs.problems.fast_top(), []

    def report(done, total):
        reports.append((done, total))

    gs.stepper("G-L", 2, progress=report)
    gs.build("cpp", "fast-top", dt=1e-3, out=tmp_path / "top", progress=report)
    with pytest.raises(gs.InputError, match="'m'"):
        gs.certify(top, "EMS", dt=1e-3, steps=2, parameters={"m": 1.0}, progress=report)
    assert reports == [(1, 2), (2, 2), (1, 2), (2, 2), (1, 3)]
    for call in (lambda: gs.stepper("EMS", progress=3), lambda: gs.certify(top, progress=3)):
        with pytest.raises(gs.InputError, match="progress = 3"):
            call()
