"""Where rigid bodies and joints are in the arrays of a run, as the manifest says it.

A vector is a list of numbers and of names of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from ...core.arguments import choose, few
from ...core.arrays import Floats
from ...core.errors import InputError
from ...core.inertia import Inertia, as_moments, tensor_of_inverse
from ...core.json_records import UnfitError
from ...core.manifest import (
    ConstraintForceManifest,
    Entry,
    Manifest,
    SectionManifest,
    SystemManifest,
)
from ...core.records import dataclass

__all__ = ["BodyAt", "JointAt", "PlacedAt", "Pull", "beam_named", "bodies_of", "body_named",
           "built_inertias", "joint_named", "joints_of", "numbers", "placed_of"]

#: Vectors of a joint, where it has them, and how many entries they have.
_VECTORS = {"on_a": 3, "on_b": 3, "axis_a": 6, "axis_b": 3, "zero": 5}
#: How a multiplier acts → how many entries its vectors on a and on b have.
_PULLS = {"force": (3, 0), "torque": (3, 3), "distance": (0, 0), "normal": (3, 0), "axial": (3, 0),
          "thread": (3, 1)}


@dataclass(frozen=True)
class BodyAt:
    """Columns of a body in the arrays of a run, and its inertia.

    Attributes
    ----------
    q : list of int
        The columns of its unit quaternion; its momenta have the same columns of p.
    inertia : list of str
        The parameters I1, I2, I3, or K11, K12, K13, K22, K23, K33 of J⁻¹.
    x : list of int
        The columns of the position of its origin, the centre of mass; none where it is held.
    origin : list of entries
        Where the origin is held in space, if it is.
    centre : list of entries
        The centre of mass in body axes from the origin; empty where the model does not give it.
    mass : entry or None
        None where the model does not give it.
    """

    q: list[int]
    inertia: list[str]
    x: list[int]
    origin: list[Entry]
    centre: list[Entry]
    mass: Entry | None

    def inertia_of(self, parameters: Mapping[str, float]) -> Inertia:
        """Return the body's inertia, in kg m², from the values of a run's parameters."""
        values = [parameters[name] for name in self.inertia]
        return as_moments(values) if len(values) == 3 else tensor_of_inverse(values)

    def mass_of(self, parameters: Mapping[str, float]) -> float | None:
        """Return the mass in kg; None where the model does not give it."""
        return None if self.mass is None else float(numbers([self.mass], parameters)[0])


@dataclass(frozen=True)
class PlacedAt:
    """Names of the quantities that are a body's centre of mass x and its first two axes in space.

    x has three names, ``axes`` six, or none for a particle.
    """

    x: list[str]
    axes: list[str]


@dataclass(frozen=True)
class Pull:
    """Force or torque of the multiplier λ of a joint's constraint on body b; its opposite is on a.

    ``kind`` is ``"force"``, λ e with e = ``on_a`` in space; ``"torque"``, λ (R_a n) × (R_b e) with
    n = ``on_a`` and e = ``on_b``; ``"distance"``, the force 2λ (P_a − P_b); ``"normal"``, the force
    −λ R_a n with n = ``on_a``; ``"axial"``, the torque λ R_a e with e = ``on_a``; or ``"thread"``,
    the torque −λ R_a e and the force λ (2π/h) R_a e with the lead h = ``on_b``. Forces act on both
    bodies at P_b. ``index`` is the constraint's row.
    """

    index: int
    kind: str
    on_a: list[Entry]
    on_b: list[Entry]


@dataclass(frozen=True)
class JointAt:
    """Layout of a joint: its bodies, points, axes and constraint forces.

    Attributes
    ----------
    a, b : str
        The bodies' names; "" is the ground.
    on_a, on_b : list of entries
        Its point in the axes of each; none where it has none.
    axis_a, axis_b : list of entries
        n₁ and n₂, two vectors of a, and n₁ × n₂ in b; none where there is no axis in common.
    zero : list of entries
        Of a joint whose angle is in the model, a quaternion c and full turns in rad:
        θ = 2 atan2(v, w) + turns with (w, v e) = q̄_a q_b c. Empty for other joints.
    pulls : list of Pull, or None
        None where the force of one of its constraints is not known.
    constraints : int
        Number of its constraints: 0 for a spring.
    section : SectionManifest, optional
        The section of a beam at this joint.
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
    section: SectionManifest | None = None

    @property
    def slides(self) -> bool:
        """Whether its point on b slides on a line or a plane of a.

        Older stores have no forces of slides.
        """
        return self.pulls is None or any(pull.kind == "normal" for pull in self.pulls)


def numbers(entries: list[Entry], parameters: Mapping[str, Any]) -> Floats:
    """Return a vector of numbers and names of parameters as doubles, by a run's parameters."""
    return np.array([float(parameters[e]) if isinstance(e, str) else e for e in entries])


def bodies_of(manifest: Manifest) -> dict[str, BodyAt]:
    """Return the rigid bodies of a stepper by name.

    Raises UnfitError for a body with other names than the system has.
    """
    system = manifest.system
    columns = {x: column for column, x in enumerate(system.coordinates)}
    bodies = {}
    for name, body in system.bodies.items():
        key = f"system.bodies.{name}"
        inertia = body.inertia or body.inverse_inertia
        if not {*inertia} <= {*system.parameters} or len(inertia) != (3 if body.inertia else 6):
            raise UnfitError("has another inertia", key)
        if not {*body.q, *body.x} <= {*columns} or len(body.q) != 4 or len(body.x) not in (0, 3):
            raise UnfitError("has other coordinates", key)
        bodies[name] = BodyAt(
            q=[columns[x] for x in body.q], inertia=list(inertia), x=[columns[x] for x in body.x],
            origin=_vector(system, key, body.origin or (0.0, 0.0, 0.0), 3),
            centre=_vector(system, key, body.centre, 0, 3),
            mass=None if body.mass is None else _vector(system, key, [body.mass], 1)[0])
    # a user's system with rigid_body=True has the coordinates and parameters of the paper's body
    if system.rigid_body and not bodies:
        bodies["body"] = BodyAt(q=[0, 1, 2, 3], inertia=["I1", "I2", "I3"], x=[],
                                origin=[0.0, 0.0, 0.0], centre=[], mass=None)
    return bodies


def placed_of(manifest: Manifest) -> dict[str, PlacedAt]:
    """Return the bodies whose places are quantities, by name; raises as ``bodies_of`` does."""
    system = manifest.system
    for name, placed in system.placed.items():
        if len(placed.x) != 3 or len(placed.axes) not in (0, 6) or not (
                {*placed.x, *placed.axes} <= {*system.quantities}):
            raise UnfitError("has other quantities", f"system.placed.{name}")
    return {name: PlacedAt(list(placed.x), list(placed.axes))
            for name, placed in system.placed.items()}


def joints_of(manifest: Manifest) -> dict[str, JointAt]:
    """Return the joints of a stepper by name; raises as ``bodies_of`` does.

    ``pulls`` of a joint is None if the force of one of its constraints is not known.
    """
    system = manifest.system
    joints = {}
    for name, joint in system.joints.items():
        path = f"system.joints.{name}"
        if not {*joint.bodies} <= {"", *system.bodies}:
            raise UnfitError("has other bodies", path)
        # a vector that the joint does not have is empty
        vectors = {key: _vector(system, path, getattr(joint, key), 0, length)
                   for key, length in _VECTORS.items()}
        # a force that is not known leaves the force of the whole joint unknown
        pulls = [_pull(system, path, key, pull) for key, pull in joint.constraints.items()]
        forces = [pull for pull in pulls if pull is not None]
        a, b = joint.bodies
        joints[name] = JointAt(
            a=a, b=b, **vectors, pulls=forces if len(forces) == len(pulls) else None,
            constraints=len(pulls), section=_section(system, path, joint.section))
    return joints


def beam_named(manifest: Manifest, name: Any) -> tuple[str, list[JointAt]]:
    """Return a beam's name and its joints, ordered by arc length; None is the name of a single one.

    Raises InputError where there is no beam, or several and none is named.
    """
    beams = dict[str, list[JointAt]]()
    for joint in joints_of(manifest).values():
        if joint.section is not None:
            beams.setdefault(joint.section.beam, []).append(joint)
    beam_name = _choose(manifest, "beam", name, beams)
    return beam_name, sorted(beams[beam_name],
                             key=lambda joint: joint.section.arc if joint.section else 0.0)


def _section(
    system: SystemManifest, path: str, section: SectionManifest | None
) -> SectionManifest | None:
    """Return the section of a joint, its vectors checked; raise UnfitError for other lengths."""
    if section is None:
        return None
    # a section at a clamp has the attitude of the beam in its holder, a quaternion
    turn_length = 4 if section.holder else 0
    for vector, lengths in (
            (section.stiffness, (3,)), (section.rest, (3,)), (section.extension, (0, 3)),
            (section.turn, (turn_length,)), ([section.spacing, section.damping], (2,))):
        _vector(system, path, vector, *lengths)
    return section


def built_inertias(system: SystemManifest) -> dict[str, tuple[str, ...]]:
    """Return the inertia parameters of each body of a builder, body → names.

    They are moments of a body, which obey triangle inequalities. Moments of other systems may be
    effective ones, to which fluid or rotors add: these are left out.
    """
    entries = {} if system.rigid_body else {
        name: body.inertia or body.inverse_inertia for name, body in system.bodies.items()}
    return {name: names for name, names in entries.items() if {*names} <= system.parameters.keys()}


def body_named(manifest: Manifest, name: Any) -> tuple[str, BodyAt | PlacedAt]:
    """Return a body and its name; None is the name of a single one.

    Raises InputError where there is no body, or several and none is named, and for a point.
    """
    system, coordinates = manifest.system.name, manifest.system.coordinates
    bodies: dict[str, BodyAt | PlacedAt] = {**bodies_of(manifest), **placed_of(manifest)}
    position = [f"{name}_{axis}" for axis in "xyz"]
    if isinstance(name, str) and name not in bodies and {*position} <= {*coordinates}:
        first = coordinates.index(position[0])
        raise InputError(f"{name!r} in system {system!r} is a point, which has no attitude; its "
                         f"position is in the columns {', '.join(position)} of q, "
                         f"run.q[:, {first}:{first + 3}], its momenta in the same ones of run.p.")
    if not bodies:
        raise InputError(
            f"System {system!r} has no rigid body; the columns of points and of other coordinates "
            f"are in q and p: {few(coordinates)}. (That a gyrospark.System is one, "
            "rigid_body=True says.)")
    body_name = _choose_of_several(system, "body", name, bodies,
                                   f"System {system!r} is not one rigid body but {len(bodies)},")
    return body_name, bodies[body_name]


def joint_named(manifest: Manifest, name: Any) -> tuple[str, JointAt]:
    """Return a joint and its name; None is the name of a single one.

    Raises InputError where there is no joint, or several and none is named, and for a connection of
    a point mass or a moving point.
    """
    # a spring has no constraints, and so no multipliers
    joints = {key: layout for key, layout in joints_of(manifest).items() if layout.constraints}
    if isinstance(name, str) and name not in {*joints, *manifest.system.bodies}:
        multipliers = [constraint for constraint in manifest.system.constraint_names
                       if constraint.startswith(f"{name}: ")]
        if multipliers:
            raise InputError(f"The force of {name!r} in system {manifest.system.name!r} is not "
                             "computed: it connects a point mass, slides or keeps a distance at a "
                             "moving point, or is a slide of a chain; its multipliers are in "
                             f"run.multipliers: {few(multipliers)}.")
    joint_name = _choose(manifest, "joint", name, joints)
    return joint_name, joints[joint_name]


def _choose(manifest: Manifest, kind: str, name: Any, components: Collection[str]) -> str:
    """Return the name of a beam or joint of a system; None is the name of a single one."""
    system = manifest.system.name
    if not components:
        raise InputError(f"System {system!r} has no {kind}s; those of gyrospark.Multibody and "
                         f"of [[{kind}s]] in model files are asked for here.")
    return _choose_of_several(system, kind, name, components,
                              f"System {system!r} has {len(components)} {kind}s,")


def _choose_of_several(
    system: str, kind: str, name: Any, components: Collection[str], several: str
) -> str:
    """Return the name of a body or joint, which may be left out if there is one alone.

    ``several`` is the beginning of the error if there are several and none is named.
    """
    first = next(iter(components))
    if name is None and len(components) > 1:
        raise InputError(f"{several} {', '.join(components)}; say which, as in {kind}({first!r}).")
    return first if name is None else choose(f"{kind} of system {system!r}:", name, components)


def _pull(
    system: SystemManifest, path: str, name: str, pull: ConstraintForceManifest | None
) -> Pull | None:
    """Return how a constraint acts on its bodies; None if its force is not known.

    ``name`` names the constraint, ``pull`` is its entry in the manifest. Raises UnfitError, with
    the ``path`` of the entry, for an unknown constraint and vectors of another length.
    """
    if name not in system.constraint_names:
        raise UnfitError("has other constraints", path)
    if pull is None:
        return None
    length_on_a, length_on_b = _PULLS[pull.kind]
    on_a = _vector(system, path, pull.on_a, length_on_a)
    on_b = _vector(system, path, pull.on_b, length_on_b)
    return Pull(system.constraint_names.index(name), pull.kind, on_a, on_b)


def _vector(
    system: SystemManifest, path: str, entries: Sequence[Entry], *lengths: int
) -> list[Entry]:
    """Return a vector of names of parameters and finite numbers; raise UnfitError for another.

    ``lengths`` are the numbers of entries that it may have.
    """
    if len(entries) not in lengths or not all(
            e in system.parameters if isinstance(e, str) else math.isfinite(e) for e in entries):
        raise UnfitError("has another vector", path)
    return list(entries)
