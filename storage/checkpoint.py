"""Checkpoints, from which a run resumes: step count, state, running record, work memory.

A run with events also stores the state of their detection, and the number stored of each; one with
impacts the round-off of the gaps.

The work memory of the compiled code holds compensation terms, the predictor's history and the
convergence rate of the fixed-point iteration; it is stored byte for byte.

The digest detects damage, not intent: anyone can compute it. Every integer that indexes, counts or
selects is therefore checked against its range before a run continues, those of work memory by the
compiled function ``is_valid``, which knows where they are.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.arrays import Array
from ..core.event import Event, Impact
from ..runtime.bindings.binding import REASONS, Binding
from ..runtime.bindings.real_numbers import as_bytes, from_bytes
from ..runtime.bindings.run_memory import RunState
from ..runtime.events.detection import TAIL, Memory

__all__ = ["CheckpointState", "EventProgress", "checkpoint_size", "pack", "unpack"]

Events = Sequence[Event | Impact]
#: Bytes of SHA-256.
_DIGEST = 32
_UNSOUND = "the checkpoint holds numbers that no run leaves"


@dataclass(frozen=True)
class EventProgress:
    """Event detection of a run: the count of each event, and the memory of detection."""

    counts: Array
    memory: Memory

    @classmethod
    def none(cls, binding: Binding, events: Events) -> EventProgress:
        """Return the progress before the first step."""
        no_rows, count = binding.new(0, binding.n), len(events)
        return cls(np.zeros(count, int), Memory(
            q=no_rows, p=no_rows, closed=np.zeros(count, bool),
            margins=binding.new(_gap_count(events))))


@dataclass(frozen=True)
class CheckpointState:
    """State of a run after a step.

    Attributes
    ----------
    run : RunState
        Its coordinates and momenta, running record and work memory.
    most_iterations : int
        Most iterations of a step since the last stored state.
    status : int
        Failure code of the last step; 0 for none; −1 − i if event i ended the run.
    event_progress : EventProgress or None
        Of a run with events.
    """

    run: RunState
    most_iterations: int = 0
    status: int = 0
    event_progress: EventProgress | None = None

    @property
    def steps(self) -> int:
        """Steps done."""
        return self.run.steps

    @property
    def ended_by(self) -> int | None:
        """Index of the event that ended the run."""
        return -1 - self.status if self.status < 0 else None

    def ended_at_event(self, event: int) -> CheckpointState:
        """Return the state as the end of the run by the event of this index."""
        return replace(self, status=-1 - event)


def _gap_count(events: Events) -> int:
    """Return the number of impacts among the events: each has a gap, whose round-off is stored."""
    return sum(isinstance(event, Impact) for event in events)


def checkpoint_size(binding: Binding, events: Events = ()) -> int:
    """Return the size of a checkpoint in bytes."""
    start = binding.new(binding.n)
    event_progress = EventProgress.none(binding, events) if events else None
    return len(pack(binding, CheckpointState(RunState.at_start(binding, start, start),
                                             event_progress=event_progress)))


def pack(binding: Binding, state: CheckpointState) -> Array:
    """Return a state as bytes, equal for equal states: a digest, then the content."""
    run = state.run
    binding.clear_padding(run.record, run.work)
    counters = np.array([state.most_iterations, state.status], dtype="<i8")
    arrays = [counters, as_bytes(run.q), as_bytes(run.p), binding.image(run.record),
              binding.image(run.work), *_packed_progress(binding, state.event_progress)]
    body = np.concatenate([np.ascontiguousarray(array).view(np.uint8).reshape(-1)
                           for array in arrays])
    digest = np.frombuffer(hashlib.sha256(body.data).digest(), dtype=np.uint8)
    return np.concatenate([digest, body])


def _packed_progress(binding: Binding, event_progress: EventProgress | None) -> list[Array]:
    """Return event progress as arrays whose length is constant for a run.

    Up to ``TAIL`` states before the checkpoint are stored, filled up with 0, and their number
    first.
    """
    if event_progress is None:
        return []
    memory, states = event_progress.memory, binding.new(2, TAIL, binding.n)
    states[0, : len(memory.q)], states[1, : len(memory.p)] = memory.q, memory.p
    return [np.array([len(memory.q), *event_progress.counts, *memory.closed], dtype="<i8"),
            as_bytes(states), as_bytes(memory.margins)]


def unpack(binding: Binding, packed: Array, events: Events = ()) -> CheckpointState | None:
    """Return the state of packed bytes, None if nothing was packed yet.

    The bytes are: digest of the rest; iterations and status; q and p; record and work memory; with
    events, also their counters, the last states before the checkpoint, and the gaps.

    Raises ValueError if the bytes are damaged, or an integer is outside of its range.
    """
    digest, body = packed[:_DIGEST], packed[_DIGEST:]
    if not packed.any():
        return None
    if hashlib.sha256(body.data).digest() != digest.tobytes():
        raise ValueError("the checkpoint is damaged")
    fields = _PackedFields(binding, body)
    # each integer is checked: compiled code would trust it
    iterations, status = fields.integers(2)
    run = RunState.at_start(binding, fields.numbers(binding.n), fields.numbers(binding.n))
    for struct in (run.record, run.work):
        image = binding.image(struct)
        image[:] = fields.take(image.size)
    # −1 − i: event i has ended the run
    is_status = -len(events) <= status <= 0 or status in REASONS
    if not (0 <= iterations < 2**31 and is_status
            and binding.function("is_valid")(run.record, run.work)):
        raise ValueError(_UNSOUND)
    return CheckpointState(run, iterations, status,
                           _unpacked_progress(binding, fields, events) if events else None)


class _PackedFields:
    """The bytes of a checkpoint behind its digest, taken field by field in their order."""

    def __init__(self, binding: Binding, body: Array) -> None:
        """Begin at the first byte; ``binding`` knows the type of numbers."""
        self._binding, self._body, self._position = binding, body, 0

    def take(self, size: int) -> Array:
        """Return a copy of the next ``size`` bytes: a run changes its state in place."""
        begin = self._position
        self._position += size
        return self._body[begin : self._position].copy()

    def integers(self, count: int) -> list[int]:
        """Return the next integers, eight bytes each."""
        return [int(x) for x in self.take(8 * count).view("<i8")]

    def numbers(self, *shape: int) -> Array:
        """Return the next numbers, in the stepper's type, as an array of this shape."""
        empty = as_bytes(self._binding.new(*shape))
        return from_bytes(self.take(empty.nbytes).reshape(empty.shape), self._binding.dtype)


def _unpacked_progress(binding: Binding, fields: _PackedFields, events: Events) -> EventProgress:
    """Return event progress, the inverse of ``_packed_progress``.

    Raises ValueError for an integer out of its range.
    """
    event_count = len(events)
    # of each event its crossings so far, then whether a turning is bracketed already
    state_count, *counters = fields.integers(1 + 2 * event_count)
    counts, bracketed = counters[:event_count], counters[event_count:]
    if not (0 <= state_count <= TAIL and min(counters) >= 0 and max(bracketed) <= 1):
        raise ValueError(_UNSOUND)
    tail = fields.numbers(2, TAIL, binding.n)[:, :state_count]
    return EventProgress(np.array(counts), Memory(tail[0], tail[1], np.array(bracketed, bool),
                                                  fields.numbers(_gap_count(events))))
