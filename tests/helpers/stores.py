"""Runs that the tests of stored runs store, and comparisons of stores."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from calls import PARAMETERS, TOP, by_names
from gyrospark.core.event import as_events
from gyrospark.runtime.bindings.real_numbers import as_bytes
from gyrospark.runtime.integration.run_arguments import step_argument
from gyrospark.runtime.integration.starts import merged_start
from gyrospark.storage import array_layout, recorder
from gyrospark.storage.record import record as recording_of
from interruption import differences

ARRAYS = ("t", "q", "p", "multipliers", "iterations", "energies", "g_errors", "f_errors", "work",
          "quantity_values")
START = {"q": TOP.q0, "p": TOP.p0, "dt": 1e-3, "parameters": PARAMETERS}


class Interrupted(Exception):  # noqa: N818 (no error: the end that a test wants)
    """The exception by which a progress callback ends a run."""


def ends_after(calls):
    """Return a progress callback that ends the run at its so-many-th call."""
    remaining = iter(range(calls))

    def progress(done):
        if next(remaining, None) is None:
            raise Interrupted(done)

    return progress


def bits(array):
    """Return the type, shape and bytes of an array: equal if and only if two agree to the bit."""
    return array.dtype, array.shape, as_bytes(array).tobytes()


def assert_same(stored, computed):
    """Check that every array and entry of two trajectories agrees to the bit."""
    for name in ARRAYS:
        assert bits(getattr(stored, name)) == bits(getattr(computed, name)), name
    for name in ("dt", "every", "parameters", "report", "manifest"):
        assert getattr(stored, name) == getattr(computed, name), name


def assert_same_states(beginning, trajectory):
    """Check that a trajectory is the beginning of another one, to the bit."""
    for name in ARRAYS:
        begun = getattr(beginning, name)
        assert bits(begun) == bits(getattr(trajectory, name)[: len(begun)]), name


def assert_same_bytes(store, other_store):
    """Check that two stores have the same files with the same bytes."""
    assert any(store.rglob("*"))
    assert differences(store, other_store) == []


def small_blocks(monkeypatch, rows, seconds=0.0):
    """Let runs write few rows at a time, and commit as often as the writer can.

    Writes are not forced to the disk, which would take most of the time and only counts when the
    power fails.
    """
    monkeypatch.setattr(os, "fsync", lambda handle: None)
    monkeypatch.setattr(array_layout, "_MOST_ROWS", rows)
    monkeypatch.setattr(recorder, "COMMIT_SECONDS", seconds)


def record(stepper, *start, **options):
    """Return the stored run from a start, or from q and p, also as keys of ``options``."""
    names = dict(zip("qp", start, strict=False))
    if "resume" not in options:
        return by_names(stepper.integrate, **names, **options)
    return by_names(_recorded_by_a_command, stepper, **names, **options)


def _recorded_by_a_command(stepper, begin, p=None, *, out, resume=False, progress=None,
                           events=(), parameters=None, dt=None, dtau=None, steps, every=1,
                           solver="auto"):
    """Begin a run in a store, or resume it, as the command line does."""
    state = merged_start(stepper, begin, p, parameters)
    run = stepper._resolve(stepper._run_arguments(
        state, dt=step_argument(stepper.binding, dt, dtau), steps=steps, every=every,
        solver=solver, scaled=True))
    run_events = as_events(events, stepper.manifest.system.event_quantities)
    return recording_of(stepper, run, run_events, out, resume=resume, progress=progress)


def recorded(stepper, out, **arguments):
    """Return the run of these arguments, recorded without an interruption in a new store."""
    shutil.rmtree(out, ignore_errors=True)
    return record(stepper, out=out, **arguments)


def as_files(store: Path) -> dict[str, bytes]:
    """Return every file of a store by its name."""
    return {str(path.relative_to(store)): path.read_bytes()
            for path in sorted(store.rglob("*")) if path.is_file()}
