"""Where rigid bodies and joints are in the arrays of a run, as the manifest says it.

A vector is a list of numbers and of names of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import choose
from ...core.errors import InputError
from ...core.inertia import Inertia, as_moments, tensor_of_inverse

__all__ = ["BodyAt", "JointAt", "PlacedAt", "Pull", "bodies_of", "body_named", "joint_named",
           "joints_of", "numbers", "placed_of"]

Array = NDArray[np.float64]
Entry = str | float
#: Vectors of a joint, where it has them, and how many entries they have.
_VECTORS = {"on_a": 3, "on_b": 3, "axis_a": 6, "axis_b": 3, "zero": 5}
#: How a multiplier acts → how many entries its vectors on a and on b have.
_PULLS = {"force": (3, 0), "torque": (3, 3), "distance": (0, 0), "axial": (3, 0)}


@dataclass(frozen=True)
class BodyAt:
    """Where a body is in the arrays of a run.

    Attributes
    ----------
    q : list of int
        The columns of its unit quaternion; its momenta have the same.
    inertia : list of str
        The parameters I1, I2, I3, or K11, K12, K13, K22, K23, K33 of J⁻¹.
    x : list of int
        The columns of the position of its origin, the centre of mass; none where it is held.
    origin : list of entries
        Where the origin is held in space, if it is.
    centre : list of entries
        The centre of mass in body axes from the origin; none where nobody says.
    mass : entry or None
    """

    q: list[int]
    inertia: list[str]
    x: list[int]
    origin: list[Entry]
    centre: list[Entry]
    mass: Entry | None

    def inertia_of(self, parameters: Mapping[str, float]) -> Inertia:
        """Return the body's inertia from the values of a run's parameters."""
        values = [parameters[name] for name in self.inertia]
        return as_moments(values) if len(values) == 3 else tensor_of_inverse(values)

    def mass_of(self, parameters: Mapping[str, float]) -> float | None:
        """Return the mass, None where nobody says."""
        return None if self.mass is None else float(numbers([self.mass], parameters)[0])


@dataclass(frozen=True)
class PlacedAt:
    """Which quantities are the place of a body's centre of mass, and its first two axes in space.

    ``axes`` is empty for a particle.
    """

    x: list[str]
    axes: list[str]


@dataclass(frozen=True)
class Pull:
    """How the multiplier λ of one constraint of a joint acts on b; on a acts the opposite.

    ``kind`` is ``"force"``, λ e with e = ``on_a`` in space; ``"torque"``, λ (R_a n) × (R_b e) with
    n = ``on_a`` and e = ``on_b``; ``"distance"``, the force 2λ (P_a − P_b); or ``"axial"``, the
    torque λ R_a e with e = ``on_a``. ``index`` is the constraint's row.
    """

    index: int
    kind: str
    on_a: list[Entry]
    on_b: list[Entry]


@dataclass(frozen=True)
class JointAt:
    """What joins two bodies.

    Attributes
    ----------
    a, b : str
        The bodies' names; "" is the ground.
    on_a, on_b : list of entries
        Its point in the axes of each; none where it has none.
    axis_a, axis_b : list of entries
        n₁ and n₂, two vectors of a, and n₁ × n₂ in b; none where there is no axis in common.
    zero : list of entries
        Of a joint whose angle the system goes by, c and full turns: θ = 2 atan2(v, w) + turns with
        (w, v e) = q̄_a q_b c.
    pulls : list of Pull, or None
        None where it is not known how each of its constraints acts.
    constraints : int
        How many it has: none of a spring.
    """

    a: str
    b: str
    on_a: list[Entry]
    on_b: list[Entry]
    axis_a: list[Entry]
    axis_b: list[Entry]
    zero: list[Entry]
    pulls: list[Pull] | None
    constraints: int


def numbers(entries: list[Entry], parameters: Mapping[str, Any]) -> Array:
    """Return a vector from the values of a run's parameters."""
    return np.array([float(parameters[e]) if isinstance(e, str) else e for e in entries])


def bodies_of(manifest: Mapping[str, Any]) -> dict[str, BodyAt]:
    """Return the rigid bodies of a stepper by name.

    Raises ``ValueError``, ``TypeError``, ``KeyError`` or ``AttributeError`` for a manifest in
    which something is missing or of another type.
    """
    system = manifest["system"]
    found = {}
    at = {x: column for column, x in enumerate(system["coordinates"])}
    for name, body in system.get("bodies", {}).items():
        inertia = list(body["inertia"] if "inertia" in body else body["inverse_inertia"])
        if not {*inertia} <= {*system["parameters"]} or len(inertia) != (
                3 if "inertia" in body else 6):
            raise ValueError("the manifest holds another body")
        mass = _vector(system, [body["mass"]], 1)[0] if "mass" in body else None
        found[str(name)] = BodyAt(
            _columns(at, body["q"], 4), inertia, _columns(at, body.get("x", []), 0, 3),
            _vector(system, body.get("origin", [0.0, 0.0, 0.0]), 3),
            _vector(system, body.get("centre", []), 0, 3), mass)
    if system["rigid_body"] and not found:
        found["body"] = BodyAt([0, 1, 2, 3], ["I1", "I2", "I3"], [], [0.0, 0.0, 0.0], [], None)
    return found


def placed_of(manifest: Mapping[str, Any]) -> dict[str, PlacedAt]:
    """Return the bodies that quantities tell the place of; raises as ``bodies_of`` does."""
    system = manifest["system"]
    found = {}
    for name, placed in system.get("placed", {}).items():
        x, axes = list(placed["x"]), list(placed["axes"])
        if len(x) != 3 or len(axes) not in (0, 6) or not {*x, *axes} <= {*system["quantities"]}:
            raise ValueError("the manifest holds another body")
        found[str(name)] = PlacedAt(x, axes)
    return found


def joints_of(manifest: Mapping[str, Any]) -> dict[str, JointAt]:
    """Return the joints of a stepper by name; raises as ``bodies_of`` does."""
    system = manifest["system"]
    found = {}
    for name, joint in system.get("joints", {}).items():
        a, b = joint["bodies"]
        if not {a, b} <= {"", *system["bodies"]}:
            raise ValueError("the manifest holds a joint of another body")
        on_a, on_b, axis_a, axis_b, zero = (
            _vector(system, joint.get(key, []), 0, length) for key, length in _VECTORS.items())
        pulls = [_pull(system, key, pull) for key, pull in joint["constraints"].items()]
        known = [pull for pull in pulls if pull is not None]
        found[str(name)] = JointAt(a, b, on_a, on_b, axis_a, axis_b, zero,
                                   known if len(known) == len(pulls) else None, len(pulls))
    return found


def body_named(manifest: Mapping[str, Any], name: Any) -> tuple[str, BodyAt | PlacedAt]:
    """Return a body and its name; None is the name of a single one.

    Raises
    ------
    InputError
        Where there is no body, or several and none is named.
    """
    system = manifest["system"]["name"]
    bodies: dict[str, BodyAt | PlacedAt] = {**bodies_of(manifest), **placed_of(manifest)}
    if not bodies:
        raise InputError(
            f"System {system!r} is not one rigid body; t, q, p, multipliers and energy() are "
            "defined for it. (That a gyrospark.System is one, rigid_body=True says.)")
    if name is None and len(bodies) > 1:
        raise InputError(f"System {system!r} is not one rigid body but {len(bodies)}, "
                         f"{', '.join(bodies)}; say which, as in body({next(iter(bodies))!r}).")
    known = next(iter(bodies)) if name is None else choose(
        f"body of system {system!r}:", name, bodies)
    return known, bodies[known]


def joint_named(manifest: Mapping[str, Any], name: Any) -> tuple[str, JointAt]:
    """Return a joint and its name; None is the name of a single one.

    Raises
    ------
    InputError
        Where there is no joint, or several and none is named.
    """
    system = manifest["system"]["name"]
    joints = {key: at for key, at in joints_of(manifest).items() if at.constraints}
    if not joints:
        raise InputError(f"System {system!r} has no joints; those of gyrospark.Multibody and "
                         "of [[joints]] in model files are asked for here.")
    if name is None and len(joints) > 1:
        raise InputError(f"System {system!r} has {len(joints)} joints, {', '.join(joints)}; "
                         f"say which, as in joint({next(iter(joints))!r}).")
    known = next(iter(joints)) if name is None else choose(
        f"joint of system {system!r}:", name, joints)
    return known, joints[known]


def _pull(system: Mapping[str, Any], name: str, pull: Any) -> Pull | None:
    index = system["constraint_names"].index(name)
    if pull is None:
        return None
    lengths = _PULLS[pull["kind"]]
    vectors = [_vector(system, pull.get(side, []), length)
               for side, length in zip(("on_a", "on_b"), lengths, strict=True)]
    return Pull(index, pull["kind"], *vectors)


def _columns(at: Mapping[str, int], names: Any, *lengths: int) -> list[int]:
    """Return the columns of coordinates, by their names."""
    columns = [at[x] for x in names]
    if len(columns) not in lengths:
        raise ValueError("the manifest holds another body")
    return columns


def _vector(system: Mapping[str, Any], entries: Any, *lengths: int) -> list[Entry]:
    """Return a vector of so many names of parameters and numbers."""
    for e in entries:
        if not (isinstance(e, str) and e in system["parameters"]) and not (
                isinstance(e, float) and math.isfinite(e)):
            raise ValueError(f"the manifest has {e!r} for a parameter or a number")
    if not isinstance(entries, list) or len(entries) not in lengths:
        raise ValueError("the manifest holds a vector of another length")
    return entries
