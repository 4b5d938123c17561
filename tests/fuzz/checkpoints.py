"""Checkpoints of stored runs, forged: bits and integers changed, the digest computed anew."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import gyrospark as gs
from gyrospark.runtime.bindings.run_memory import Rows
from gyrospark.runtime.integration.run_arguments import StartNumbers
from gyrospark.storage import array_layout, recorder
from gyrospark.storage.checkpoint import pack, unpack
from stores import record
from work_memory import integers_of

from .choices import Choices
from .judging import scratch
from .mutations import changed_bytes

#: Steps that an accepted checkpoint is taken on by: fits and lessons of the predictor among them.
STEPS = 10
EDGES = (-1, -2, 0, 1, 2, 7, 24, 33, 2**31 - 1, -(2**31), 2**32, 2**33 + 46, 2**62, 2**63 - 1,
         -(2**63))


class EndedError(Exception):
    """The end of the sound run, half way."""


class Case:
    """A stepper with a run that was ended half way, and where its checkpoint has integers."""

    def __init__(self, stepper: Any, event: bool) -> None:
        top = gs.problems.fast_top()
        self.stepper, self.binding = stepper, stepper.binding
        self.events = ([gs.Event(stepper.manifest.system.coordinates[0], level=0.3)]
                       if event else [])
        parameters = top.parameters | {"gamma": gs.gamma(top.inertia)}
        q, p = stepper.project(top.q0, top.p0, parameters=parameters)
        self.arguments = {"q": q, "p": p, "dt": 1e-3, "steps": 120, "every": 3,
                          "parameters": parameters, "events": self.events}
        self.path = scratch() / f"{stepper.name}-{len(self.events)}.zarr"
        self._record()
        self.run = stepper._checked_run(stepper._run_arguments(
            StartNumbers(q, p, parameters, 0.0), dt=1e-3, steps=120, every=3))
        group = array_layout.open_group(self.path)
        self.sound = np.asarray(array_layout.array_of(group, array_layout.CHECKPOINT)[:])
        state = unpack(self.binding, self.sound, self.events)
        assert state is not None
        assert pack(self.binding, state).tobytes() == self.sound.tobytes()
        report, work = (self.binding.image(struct).size
                        for struct in (state.run.record, state.run.work))
        numbers = 2 * len(gs.runtime.bindings.real_numbers.as_bytes(state.run.q).reshape(-1))
        with tempfile.TemporaryDirectory() as folder:
            integers = integers_of(stepper.name, stepper.files, Path(folder))
        offsets = {"report": 48 + numbers, "work": 48 + numbers + report}
        offsets["fast"] = offsets["work"]
        self.integers = [(32, 8), (40, 8)] + [
            (offsets[kind] + integer.offset + i, integer.item) for kind, places in integers.items()
            for integer in places for i in range(0, integer.size, integer.item)]
        end = offsets["work"] + work
        if self.events:
            self.integers += 3 * [(end + 8 * i, 8) for i in range(1 + 2 * len(self.events))]

    def _record(self) -> None:
        chunk, rows, seconds = recorder.COMMIT_SECONDS, array_layout._MOST_ROWS, recorder.next_chunk
        recorder.COMMIT_SECONDS, array_layout._MOST_ROWS = 0.0, 16

        def small(run: Any, done: int, limit: int, *room: int) -> tuple[int, int]:
            return seconds(run, done, min(limit, 6), *room)

        def progress(done: int) -> None:
            if done > 70:
                raise EndedError

        recorder.next_chunk = small
        shutil.rmtree(self.path, ignore_errors=True)
        busy, recorder.Writer.busy = recorder.Writer.busy, False  # type: ignore[assignment]
        try:
            record(self.stepper, **self.arguments, out=self.path, progress=progress)
        except EndedError:
            pass
        finally:
            recorder.COMMIT_SECONDS, array_layout._MOST_ROWS = chunk, rows
            recorder.next_chunk = seconds
            recorder.Writer.busy = busy  # type: ignore[method-assign]


@cache
def case(number: int) -> Case:
    return (
        lambda: Case(gs.stepper("G-L", 3), event=False),
        lambda: Case(gs.stepper("EMS"), event=True),
        lambda: Case(gs.stepper("G-L", 2, frame="symmetries"), event=False),
        lambda: Case(gs.stepper("G-L", 2, real="long-double"), event=True),
    )[number]()


def check(data: bytes) -> str:
    """Go on from one forged checkpoint."""
    choices = Choices(data)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # of numbers that mean nothing
        stored, state = case(choices.below(4)), None
        try:
            state = unpack(stored.binding, forged(choices, stored), stored.events)
        except ValueError as error:
            if "checkpoint" not in str(error):  # none of ours
                raise
            return "refused"
        if state is None or state.status or state.steps > 2**40:
            return "accepted"
        status = stored.binding.integrate(stored.run.constants(stored.binding), STEPS, 1, state.run,
                                          Rows.allocate(stored.binding, STEPS))
    return "went on" if status == 0 else "step failed"


def forged(choices: Choices, stored: Case) -> np.ndarray:
    """Return a checkpoint of the right length with a digest that is mostly right."""
    body = bytearray(stored.sound[32:].tobytes())
    for _ in range(1 + choices.below(3)):
        kind = choices.below(8)
        if kind < 5:
            start, size = choices.pick(stored.integers)
            number = choices.pick(EDGES) if kind else choices.below(2**20) - 100
            body[start - 32 : start - 32 + size] = (number % 2 ** (8 * size)).to_bytes(
                size, "little")
        elif kind < 7:
            offset = choices.below(len(body))
            body[offset] ^= 1 << choices.below(8)
        else:
            offset = 8 * choices.below(len(body) // 8)
            body[offset : offset + 8] = np.float64(choices.double()).tobytes()
    digest = hashlib.sha256(bytes(body)).digest()
    if choices.one_in(32):
        digest = changed_bytes(digest, choices).ljust(32, b"\0")[:32]
    return np.frombuffer(digest + bytes(body), dtype=np.uint8)
