"""Trajectory files, damaged: as bytes, or as sound archives with other arrays or JSON inside.

A file that is loaded all the same must answer every question about itself.
"""

from __future__ import annotations

import io
import json
import warnings
import zipfile
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

import gyrospark as gs
from gyrospark.core.errors import GyrosparkError, InputError

from .choices import Choices
from .file_texts import text_of
from .judging import refuse_unless_sentence, scratch
from .mutations import changed_bytes, changed_tree

WORDS = ("float128", "float", "double", "heavy_top", "name", "null", "true", "-1", "[]", "{}", "q0")
DTYPES = ("f8", "f4", "g", "i8", "u1", "c16", "?", "U3", "S2", ">f8", "M8[s]", "V4", "f2")


@cache
def made() -> gs.Trajectory:
    top = gs.problems.fast_top()
    parameters = top.parameters | {"gamma": gs.gamma(top.inertia)}
    return gs.stepper("EMS").integrate(top.q0, top.p0, dt=1e-3, steps=6, every=2,
                                       parameters=parameters)


@cache
def archive() -> dict[str, bytes]:
    """Return the members of a sound file."""
    path = made().save(scratch() / "sound.npz")
    with zipfile.ZipFile(path) as file:
        return {name: file.read(name) for name in file.namelist()}


@cache
def about() -> Any:
    with np.load(scratch() / "sound.npz") as file:
        return json.loads(str(file["about"]))


def check(data: bytes) -> str:
    """Load one trajectory file; ask it everything."""
    choices = Choices(data)
    path = scratch() / "damaged.npz"
    path.write_bytes(content(choices))
    try:
        loaded = gs.load(path)
    except InputError as error:
        refuse_unless_sentence(error, "damaged.npz")
        return "refused"
    question(loaded)
    return "accepted"


def content(choices: Choices) -> bytes:
    members = dict(archive())
    kind = choices.below(8)
    if kind == 0:
        return changed_bytes((scratch() / "sound.npz").read_bytes(), choices)
    if kind < 3:
        members["about.npy"] = npy(np.array(text_of(changed_tree(about(), choices, value))
                                            .encode("utf-8", "replace").decode()))
    elif kind < 5:
        name = choices.pick(sorted(members))
        members[name] = npy(array(choices))
    elif kind == 5:
        name = choices.pick(sorted(members))
        members[name] = changed_bytes(members[name], choices)
    elif kind == 6:
        name, source = choices.pick(sorted(members)), choices.pick(sorted(members))
        members[name] = members[source]
        if choices.one_in(3):
            del members[source]
    else:
        return choices.rest()
    return zipped(members)


def value(choices: Choices) -> Any:
    return choices.pick(WORDS) if choices.one_in(3) else choices.value()


def array(choices: Choices) -> np.ndarray:
    """Return an array of some type and shape; often of the shape that was expected."""
    shape = choices.pick(((4,), (4, 4), (3,), (3, 1), (4, 0), (0,), (), (1,), (5, 4), (4, 1),
                          (2, 2), (4, 4, 16), (3, 1, 1), (0, 4)))
    dtype = np.dtype(choices.pick(DTYPES))
    flat = np.frombuffer(bytes(choices.byte() for _ in range(32)) * (
        1 + int(np.prod(shape)) * dtype.itemsize // 32), dtype="u1")
    count = int(np.prod(shape)) * dtype.itemsize
    if dtype.kind in "U?":  # not every bit pattern is one
        return np.zeros(shape, dtype=dtype)
    return np.frombuffer(flat[:count].tobytes(), dtype=dtype).reshape(shape)


def npy(content: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, content, allow_pickle=False)
    return stream.getvalue()


def zipped(members: dict[str, bytes]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        for name, content in members.items():
            file.writestr(name, content)
    return stream.getvalue()


def question(loaded: gs.Trajectory) -> None:
    """Ask a trajectory everything; a refusal is an answer."""
    names = [*loaded.quantities, "nothing"]
    questions: list[Callable[[], Any]] = [
        loaded.energy, loaded.energy_error, loaded.constraint_errors, loaded.axis,
        loaded.angular_velocity, loaded.rotation, lambda: len(loaded),
        lambda: loaded.report.iterations_mean, lambda: [loaded.quantity(name) for name in names],
    ]
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of numbers that mean nothing
        for ask in questions:
            try:
                ask()
            except GyrosparkError as error:
                refuse_unless_sentence(error)
    loaded_again = gs.load(loaded.save(scratch() / "again.npz"))
    assert loaded_again.q.tobytes() == loaded.q.tobytes()
