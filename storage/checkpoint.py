"""The bytes from which a run goes on: how far it is, its state, its record, its memory.

Of a run with events also what looking for them goes on from, and how many of each are stored.

The compiled code keeps all that a run has learned (compensation terms, the predictor's past, the
rate at which sweeps converge) in its work memory, and that is kept byte for byte.

The digest detects damage, not intent: anyone can compute it. Every integer that indexes, counts or
selects is therefore checked against its range before a run continues, those of work memory by the
compiled function ``is_valid``, which knows where they are.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.bindings.binding import REASONS, Binding
from ..runtime.bindings.real_numbers import as_bytes, from_bytes
from ..runtime.events.detection import TAIL, Memory

__all__ = ["Seen", "State", "pack", "room", "unpack"]

Array = NDArray[Any]
_DIGEST = 32
_UNSOUND = "the checkpoint holds numbers that no run leaves"


@dataclass(frozen=True)
class Seen:
    """What is known of the events of a run: how often each has happened, what looking needs."""

    counts: Array
    memory: Memory

    @classmethod
    def none(cls, binding: Binding, events: int) -> Seen:
        """Return what is known before the first step."""
        no_rows = binding.new(0, binding.n)
        return cls(np.zeros(events, int), Memory(no_rows, no_rows, np.zeros(events, bool)))


@dataclass(frozen=True)
class State:
    """Where a run stands.

    Attributes
    ----------
    q, p : array, shape (n,)
    report, work : compiled structs
        The running record and the work memory.
    most : int
        Most iterations of a step since the last stored state.
    status : int
        Why the last step failed; 0 if it did not; −1 − i where event i has ended the run.
    seen : Seen or None
        Of a run with events.
    """

    q: Array
    p: Array
    report: Any
    work: Any
    most: int = 0
    status: int = 0
    seen: Seen | None = None

    @property
    def steps(self) -> int:
        """Steps done."""
        return int(self.report.steps)

    @property
    def ended_by(self) -> int | None:
        """Which event has ended the run."""
        return -1 - self.status if self.status < 0 else None


def room(binding: Binding, events: int = 0) -> int:
    """Return how many bytes a checkpoint has."""
    start = binding.new(binding.n)
    seen = Seen.none(binding, events) if events else None
    return len(pack(binding, State(start, start, binding.report(), binding.work(), seen=seen)))


def pack(binding: Binding, state: State) -> Array:
    """Return a state as bytes, the same for the same state: a digest, then the parts."""
    binding.clear_padding(state.report, state.work)
    numbers = np.array([state.most, state.status], dtype="<i8")
    parts = [numbers, as_bytes(state.q), as_bytes(state.p), binding.image(state.report),
             binding.image(state.work), *_packed(binding, state.seen)]
    body = np.concatenate([np.ascontiguousarray(part).view(np.uint8).reshape(-1)
                           for part in parts])
    digest = np.frombuffer(hashlib.sha256(body.data).digest(), dtype=np.uint8)
    return np.concatenate([digest, body])


def _packed(binding: Binding, seen: Seen | None) -> list[Array]:
    """Return what is known of events in parts of one length, however many rows there are."""
    if seen is None:
        return []
    memory, rows = seen.memory, binding.new(2, TAIL, binding.n)
    rows[0, : len(memory.q)], rows[1, : len(memory.p)] = memory.q, memory.p
    return [np.array([len(memory.q), *seen.counts, *memory.closed], dtype="<i8"), as_bytes(rows)]


def unpack(binding: Binding, data: Array, events: int = 0) -> State | None:
    """Return the state of ``pack``'s bytes, None where nothing was packed yet.

    Raises
    ------
    ValueError
        If the bytes are damaged, or an integer is outside of its range.
    """
    digest, body = data[:_DIGEST], data[_DIGEST:]
    if not data.any():
        return None
    if hashlib.sha256(body.data).digest() != digest.tobytes():
        raise ValueError("the checkpoint is damaged")
    report, work = binding.report(), binding.work()
    at = 0

    def take(size: int) -> Array:
        """Return the next bytes, no part of the data: a run changes its state in place."""
        nonlocal at
        at += size
        return body[at - size : at].copy()

    def numbers(*shape: int) -> Array:
        empty = as_bytes(binding.new(*shape))
        return from_bytes(take(empty.nbytes).reshape(empty.shape), binding.dtype)

    most, status = (int(x) for x in take(16).view("<i8"))
    q, p = numbers(binding.n), numbers(binding.n)
    for struct in (report, work):
        image = binding.image(struct)
        image[:] = take(image.size)
    if not (0 <= most < 2**31 and (-events <= status <= 0 or status in REASONS)
            and binding.function("is_valid")(report, work)):
        raise ValueError(_UNSOUND)
    if not events:
        return State(q, p, report, work, most, status)
    rows, *known = (int(x) for x in take(8 * (1 + 2 * events)).view("<i8"))
    if not (0 <= rows <= TAIL and min(known) >= 0 and max(known[events:]) <= 1):
        raise ValueError(_UNSOUND)
    tail = numbers(2, TAIL, binding.n)[:, :rows]
    memory = Memory(tail[0], tail[1], np.array(known[events:], bool))
    return State(q, p, report, work, most, status, Seen(np.array(known[:events]), memory))
