"""The bytes from which a run goes on: how far it is, its state, its record, its memory.

The compiled code keeps all that a run has learned (compensation terms, the predictor's past, the
rate at which sweeps converge) in its work memory, and that is kept byte for byte.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.call.binding import Binding
from .wide import as_bytes, from_bytes

__all__ = ["State", "pack", "room", "unpack"]

Array = NDArray[Any]
_DIGEST = 32


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
        Why the last step failed; 0 if it did not.
    """

    q: Array
    p: Array
    report: Any
    work: Any
    most: int = 0
    status: int = 0

    @property
    def steps(self) -> int:
        """Steps done."""
        return int(self.report.steps)


def room(binding: Binding) -> int:
    """Return how many bytes a checkpoint has."""
    start = binding.new(binding.n)
    return len(pack(binding, State(start, start, binding.report(), binding.work())))


def pack(binding: Binding, state: State) -> Array:
    """Return a state as bytes, the same for the same state: a digest, then the parts."""
    binding.clear_padding(state.report, state.work)
    numbers = np.array([state.most, state.status], dtype="<i8")
    parts = [numbers, as_bytes(state.q), as_bytes(state.p), binding.image(state.report),
             binding.image(state.work)]
    body = np.concatenate([np.ascontiguousarray(part).view(np.uint8).reshape(-1)
                           for part in parts])
    digest = np.frombuffer(hashlib.sha256(body.data).digest(), dtype=np.uint8)
    return np.concatenate([digest, body])


def unpack(binding: Binding, data: Array) -> State | None:
    """Return the state of ``pack``'s bytes, None where nothing was packed yet.

    Raises
    ------
    ValueError
        If the bytes are damaged.
    """
    digest, body = data[:_DIGEST], data[_DIGEST:]
    if not data.any():
        return None
    if hashlib.sha256(body.data).digest() != digest.tobytes():
        raise ValueError("the checkpoint is damaged")
    state = State(binding.new(binding.n), binding.new(binding.n), binding.report(),
                  binding.work())
    empty = as_bytes(state.q)
    most, status = (int(x) for x in body[:16].view("<i8"))
    at = 16
    vectors = []
    for _ in "qp":
        part = body[at : at + empty.nbytes].reshape(empty.shape)
        vectors.append(from_bytes(part, binding.dtype))
        at += empty.nbytes
    for struct in (state.report, state.work):
        image = binding.image(struct)
        image[:] = body[at : at + image.size]
        at += image.size
    return State(vectors[0], vectors[1], state.report, state.work, most, status)
