"""What a system is told of its bodies and joints, for trajectories to know whose a number is."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import sympy as sp

from ..systems.body_layout import BodyAt, Entries, Entry, JointAt, Pull
from .body import Body, Frame
from .joints import Connection, Poses, Store
from .sliding_joints import hinge_of

__all__ = ["body_at", "joint_at"]


def body_at(body: Body, kept: set[sp.Symbol], values: Mapping[str, float]) -> BodyAt:
    """Return where a body is; ``kept`` are the system's parameters, ``values`` those of all."""
    held: dict[str, Any] = {} if body.x else {"origin": _entries(body.origin, kept, values)}
    return BodyAt(body.name, body.q, body.inverse or body.inertia, body.x, **held,
                  centre=_entries(body.centre, kept, values),
                  mass=_entry(body.mass, kept, values))


def joint_at(
    link: Connection, poses: Poses, equations: Iterable[str], kept: set[sp.Symbol],
    values: Mapping[str, float], counted: bool,
) -> JointAt:
    """Return where a joint is; ``equations`` are the names of the constraints that there are.

    ``counted`` says whether the system goes by its angle.
    """
    store: Store = {}  # of values that are known
    there = set(equations)
    (on_a, on_b), (axis_a, axis_b) = link.places(store), link.axes(poses, store)
    zero = hinge_of(link).zero(poses, store) if counted else ()
    pulls = [(equation.name, None if equation.pull is None else _pull(equation.pull, kept, values))
             for equation in link.equations(poses, store) if equation.name in there]
    return JointAt(link.name, _name(link.a), _name(link.b), _entries(on_a, kept, values),
                   _entries(on_b, kept, values), _entries(axis_a, kept, values),
                   _entries(axis_b, kept, values), _entries(zero, kept, values), tuple(pulls))


def _name(frame: Frame) -> str:
    return frame.name if isinstance(frame, Body) else ""


def _pull(pull: Pull, kept: set[sp.Symbol], values: Mapping[str, float]) -> Pull:
    return Pull(pull.kind, _entries(pull.on_a, kept, values), _entries(pull.on_b, kept, values))


def _entries(given: Sequence[Any], kept: set[sp.Symbol], values: Mapping[str, float]) -> Entries:
    return tuple(_entry(e, kept, values) for e in given)


def _entry(e: Any, kept: set[sp.Symbol], values: Mapping[str, float]) -> Entry:
    """Return a parameter of the system, or the number that stands for another one."""
    if not isinstance(e, sp.Symbol):
        return float(e)
    return e if e in kept else float(values[str(e)])
