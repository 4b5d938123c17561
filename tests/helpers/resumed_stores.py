"""Runs that are stored in pieces: their stores end with the same bytes."""

from __future__ import annotations

import contextlib
import shutil

import pytest

import gyrospark as gs
from stores import Interrupted, assert_same_bytes, ends_after, record, recorded


def in_pieces(step, out, calls, **arguments):
    """Record a run that is ended after so many calls of progress, again and again.

    Returns how often it was ended.
    """
    shutil.rmtree(out, ignore_errors=True)
    for number, count in enumerate(calls):
        try:
            record(step, out=out, resume=True, progress=ends_after(count), **arguments)
        except Interrupted:
            continue
        except gs.StepFailed:
            pass
        return number
    with contextlib.suppress(gs.StepFailed):
        record(step, out=out, resume=True, **arguments)
    return len(calls)


def check(step, folder, calls, chunk=None, **arguments):
    """Check that an interrupted run ends with the bytes of an uninterrupted one.

    ``chunk`` is how many steps a call of compiled code does in the interrupted one.
    """
    with contextlib.suppress(gs.StepFailed):
        recorded(step, folder / "whole.zarr", **arguments)
    with pytest.MonkeyPatch.context() as patch:
        if chunk:
            patch.setattr("gyrospark.runtime.integration.step_loop._CHUNK", chunk)
        ends = in_pieces(step, folder / "pieces.zarr", calls, **arguments)
    assert_same_bytes(folder / "whole.zarr", folder / "pieces.zarr")
    return ends
