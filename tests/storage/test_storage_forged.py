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


def state_of(one, data=None):
    found = unpack(one.binding, one.sound if data is None else data, one.events)
    assert found is not None
    return found


def gone_on(one, state):
    """Return the bytes of a state after some more steps."""
    rows, run = Rows.allocate(one.binding, STEPS), state.run
    status = one.binding.integrate(one.run.constants(one.binding), STEPS, 1, run, rows)
    return status, run.q.tobytes(), run.p.tobytes(), rows.iterations.tobytes()


def signed(body):
    return np.concatenate([np.frombuffer(hashlib.sha256(body.tobytes()).digest(), np.uint8), body])


@pytest.mark.slow  # 2 CPU s each: every integer of a struct
@pytest.mark.parametrize("number", [0, 1, 2])
def test_each_integer_of_work_memory_is_checked_or_not_read(number, tmp_path):
    """The list is that of the structs as they are compiled: what is added is found here."""
    one = case(number)
    places = integers_of(one.stepper.name, one.stepper.files, tmp_path)
    assert len(places["fast"]) > 10
    sound = gone_on(one, state_of(one))
    assert sound[0] == 0
    ignored = state_of(one)
    for kind, found in places.items():
        for place in found:
            if kind == "work" and place.path.startswith(UNREAD):
                image = one.binding.image(ignored.run.work)
                image[place.offset : place.offset + place.size] = 0x5A
                continue
            for at in range(place.offset, place.offset + place.size, place.item):
                for value in (-(2 ** (8 * place.item - 1)), 2 ** (8 * place.item - 1) - 1):
                    run = state_of(one).run
                    struct = run.record if kind == "report" else run.work
                    one.binding.image(struct)[at : at + place.item] = np.frombuffer(
                        value.to_bytes(place.item, "little", signed=True), np.uint8)
                    is_valid = one.binding.function("is_valid")(run.record, run.work)
                    counts = kind == "report" and place.path != "newton_steps" and value > 0
                    assert is_valid == counts, (kind, place, value)
    assert gone_on(one, ignored) == sound


def test_a_damaged_checkpoint_is_found_by_its_digest():
    """One bit of a number, which no check of a range can tell."""
    one = case(1)
    forged = one.sound.copy()
    forged[60] ^= 1
    with pytest.raises(ValueError, match="damaged"):
        unpack(one.binding, forged, one.events)
    assert unpack(one.binding, signed(forged[32:]), one.events) is not None
    assert pack(one.binding, state_of(one)).tobytes() == one.sound.tobytes()


@pytest.mark.parametrize("at", [0, 8])
def test_status_and_iterations_are_checked(at):
    """A status names a reason, or an event that there is."""
    one, allowed = case(1), {-1, *range(6), 7} if at else range(2**31)
    for value in EDGES:
        body = one.sound[32:].copy()
        body[at : at + 8] = np.array([value % 2**64], "<u8").view(np.uint8)
        if value in allowed:
            assert unpack(one.binding, signed(body), one.events) is not None
        else:
            with pytest.raises(ValueError, match="checkpoint"):
                unpack(one.binding, signed(body), one.events)


def test_more_steps_than_the_run_has_are_refused(tmp_path):
    """A forged count of steps would write rows that are not there."""
    one, path = case(1), tmp_path / "run.zarr"
    shutil.copytree(one.path, path)
    state = state_of(one)
    state.run.record.steps = 121
    group = array_layout.open_group(path, write=True)
    array_layout.array_of(group, array_layout.CHECKPOINT)[:] = pack(one.binding, state)
    with pytest.raises(gs.InputError, match="checkpoint"):
        record(one.stepper, **one.arguments, out=path, resume=True)
