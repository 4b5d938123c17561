"""Forged checkpoints and stores: a result or an error, never a crash. ``fuzz`` has more of them.

The digest of a checkpoint has no key, so whoever changes a byte computes it anew.
"""

from __future__ import annotations

import hashlib
import shutil

import numpy as np
import pytest

import gyrospark as gs
from fuzz.checkpoints import EDGES, STEPS, case
from gyrospark.runtime.bindings.run_memory import Rows
from gyrospark.storage import array_layout
from gyrospark.storage.checkpoint import pack, unpack
from stores import record
from work_memory import integers_of

#: Integers that no step reads before it has written them: of a trajectory that is held, which
#: storage has none of, and of the last factorisation; operations are counted anew in each step.
UNREAD = ("simulation.options.", "simulation.report.", "simulation.state_changed", "products",
          "effort", "exponents", "pivots")


def state_of(stored, data=None):
    state = unpack(stored.binding, stored.sound if data is None else data, stored.events)
    assert state is not None
    return state


def gone_on(stored, state):
    """Return the bytes of a state after some more steps."""
    rows, run = Rows.allocate(stored.binding, STEPS), state.run
    status = stored.binding.integrate(stored.run.constants(stored.binding), STEPS, 1, run, rows)
    return status, run.q.tobytes(), run.p.tobytes(), rows.iterations.tobytes()


def signed(body):
    return np.concatenate([np.frombuffer(hashlib.sha256(body.tobytes()).digest(), np.uint8), body])


@pytest.mark.slow  # 2 CPU s each: every integer of a struct
@pytest.mark.parametrize("number", [0, 1, 2])
def test_each_integer_of_work_memory_is_checked_or_not_read(number, tmp_path):
    """The list comes from the structs as they are compiled: a new field is included here."""
    stored = case(number)
    places = integers_of(stored.stepper.name, stored.stepper.files, tmp_path)
    assert len(places["fast"]) > 10
    sound = gone_on(stored, state_of(stored))
    assert sound[0] == 0
    ignored = state_of(stored)
    for kind, integers in places.items():
        for integer in integers:
            if kind == "work" and integer.path.startswith(UNREAD):
                image = stored.binding.image(ignored.run.work)
                image[integer.offset : integer.offset + integer.size] = 0x5A
                continue
            for offset in range(integer.offset, integer.offset + integer.size, integer.item):
                for value in (-(2 ** (8 * integer.item - 1)), 2 ** (8 * integer.item - 1) - 1):
                    run = state_of(stored).run
                    struct = run.record if kind == "report" else run.work
                    stored.binding.image(struct)[offset : offset + integer.item] = np.frombuffer(
                        value.to_bytes(integer.item, "little", signed=True), np.uint8)
                    is_valid = stored.binding.function("is_valid")(run.record, run.work)
                    counts = kind == "report" and integer.path != "newton_steps" and value > 0
                    assert is_valid == counts, (kind, integer, value)
    assert gone_on(stored, ignored) == sound


def test_a_damaged_checkpoint_is_found_by_its_digest():
    """No check of a range can detect one wrong bit of a number."""
    stored = case(1)
    forged = stored.sound.copy()
    forged[60] ^= 1
    with pytest.raises(ValueError, match="damaged"):
        unpack(stored.binding, forged, stored.events)
    assert unpack(stored.binding, signed(forged[32:]), stored.events) is not None
    assert pack(stored.binding, state_of(stored)).tobytes() == stored.sound.tobytes()


@pytest.mark.parametrize("offset", [0, 8])
def test_status_and_iterations_are_checked(offset):
    """A status must name a reason, or an event of the run."""
    stored, allowed = case(1), {-1, *range(6), 7} if offset else range(2**31)
    for value in EDGES:
        body = stored.sound[32:].copy()
        body[offset : offset + 8] = np.array([value % 2**64], "<u8").view(np.uint8)
        if value in allowed:
            assert unpack(stored.binding, signed(body), stored.events) is not None
        else:
            with pytest.raises(ValueError, match="checkpoint"):
                unpack(stored.binding, signed(body), stored.events)


def test_more_steps_than_the_run_has_are_refused(tmp_path):
    """A forged count of steps would write rows that are not there."""
    stored, path = case(1), tmp_path / "run.zarr"
    shutil.copytree(stored.path, path)
    state = state_of(stored)
    state.run.record.steps = 121
    group = array_layout.open_group(path, write=True)
    array_layout.array_of(group, array_layout.CHECKPOINT)[:] = pack(stored.binding, state)
    with pytest.raises(gs.InputError, match="checkpoint"):
        record(stored.stepper, **stored.arguments, out=path, resume=True)
