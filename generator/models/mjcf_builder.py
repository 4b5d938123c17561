"""An MJCF file to bodies and joints: bodies in their own axes, joints with their coordinates.

    bodies, joints        as of all robots (``robot_builder``)
    actuator              an input of its name, and a motor
    composite             a chain with the potentials of a beam
    connect, weld, joint  a ball, a fixed joint, a coupling or a law; tendon: a law
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ...core.arguments import join_or, proposal, shown
from ...core.errors import InputError
from ...core.inertia import quaternion_of_matrix, quaternion_product
from ..multibody.body import Body
from ..multibody.initial_poses import clean, conjugate, optional_vector, rotation, unit
from ..multibody.multibody import Multibody
from .mjcf_cables import MjcfCable
from .mjcf_reader import (
    EXTRAS,
    MjcfActuator,
    MjcfEquality,
    MjcfKey,
    MjcfRobot,
    MjcfTendon,
    read_mjcf_robot,
)
from .robot_builder import (
    Close,
    RobotBuilder,
    Start,
    as_names,
    ends_of_ranges,
    reference_of,
    refuse_extras,
    take_values,
    with_unit_quaternion,
)
from .robot_options import MjcfOptions
from .robot_tree import IDENTITY, Mount, Placement, place_bodies
from .robot_visuals import Look, draw

__all__ = ["parse_mjcf"]


def parse_mjcf(
    text: str, path: str | Path, rep: Any, options: MjcfOptions, close: Close | None = None
) -> Multibody:
    """Return the bodies and joints of a text that was read from a file; see ``load_model``.

    ``close`` adds loop joints, given the placement of each body.
    """
    left_out = as_names(options.get("ignore", ()))
    gravity = optional_vector("gravity", options.get("gravity"))
    limits = ends_of_ranges(options.get("limits"))
    file = Path(path)
    try:
        robot = read_mjcf_robot(text, file)
        robot.limits = limits
        # no model here has the range of a ball; other ranges are read if the option is given
        robot.extras["limits"] += sum(
            joint.range is not None and (limits is None or joint.kind == "ball")
            for joint in robot.joints.values())
        refuse_extras(robot.extras, EXTRAS, left_out)
        if gravity is not None:
            robot.gravity = gravity
        mjcf_builder = MjcfBuilder(robot, _start(robot, options), rep, file)
        builder = mjcf_builder.build()
    except InputError as error:
        raise InputError(f"The model file {str(path)!r} is not usable: {error}") from None
    if close is not None:
        close(builder, mjcf_builder.mounts())
    return builder


# ---------------------------------------------------------------- the start


@dataclass
class MjcfStart(Start):
    """Coordinates and rates of joints as in qpos and qvel, and values of actuators."""

    controls: dict[str, float]


def _start(robot: MjcfRobot, options: MjcfOptions) -> MjcfStart:
    """Return the start of the robot: a keyframe, or its pose in the file."""
    start = MjcfStart(*reference_of(robot), {actuator.name: 0.0 for actuator in robot.actuators})
    if options.get("keyframe") is not None:
        _take_key(robot, start, _keyframe(robot, options["keyframe"]))
    take_values(robot, start, options.get("angles"), options.get("rates"))
    return start


def _keyframe(robot: MjcfRobot, keyframe: Any) -> MjcfKey:
    """Return a keyframe by its name or number; refuse a keyframe that the file has not."""
    # a name goes before a number: a keyframe may be called "1"
    names = [key.name for key in robot.keys]
    if isinstance(keyframe, str) and keyframe in names:
        return robot.keys[names.index(keyframe)]
    number = int(keyframe) if isinstance(keyframe, str) and keyframe.isdigit() else keyframe
    if isinstance(number, int) and not isinstance(number, bool) and 0 <= number < len(names):
        return robot.keys[number]
    key_names = [name or str(number) for number, name in enumerate(names)]
    raise InputError(f"keyframe = {shown(keyframe)} is none of the file; "
                     f"{'choose ' + join_or(key_names) if key_names else 'it has no <key>'}"
                     f"{proposal(keyframe, key_names)}.")


def _take_key(robot: MjcfRobot, start: MjcfStart, key: MjcfKey) -> None:
    """Set coordinates, rates and controls of ``start`` to those of a keyframe.

    qpos and qvel have the coordinates and rates of all joints, one joint after the other. Raises
    InputError for a keyframe that moves a mocap body.
    """
    if key.moved_mocap:
        raise InputError(f"keyframe {shown(key.name)} places body {shown(key.moved_mocap)}, a "
                         "mocap, otherwise than the file; write its pos and quat in <body>.")
    joints = [*robot.joints.values()]
    for numbers, values, counts in (
            (key.qpos, start.coordinates, [joint.count for joint in joints]),
            (key.qvel, start.rates, [joint.freedoms for joint in joints])):
        for joint, entries in zip(joints, np.split(numbers, np.cumsum(counts)[:-1]), strict=True):
            # quaternions of a keyframe need not have length 1
            has_quaternion = values is start.coordinates and joint.kind in ("ball", "free")
            values[joint.name] = (with_unit_quaternion(joint, entries) if has_quaternion
                                  else entries)
    start.controls = {actuator.name: float(key.ctrl[actuator.control])
                      for actuator in robot.actuators}


# ---------------------------------------------------------------- building


class MjcfBuilder(RobotBuilder):
    """Bodies and joints of a robot, its motors, tendons and equalities, and its looks."""

    def __init__(self, robot: MjcfRobot, start: MjcfStart, rep: Any, file: Path) -> None:
        """Place the bodies at the reference pose, from which equalities count; name the inputs."""
        super().__init__(robot, start, rep)
        self.mjcf, self.controls, self.file = robot, start.controls, file
        coordinates, _ = reference_of(robot)
        self.at_reference = place_bodies(robot, coordinates)
        self.inputs = [self.parameter_names.free(actuator.name) for actuator in robot.actuators]

    def _add_more(self) -> None:
        """Add actuators, tendons, equalities and visual shapes."""
        for label, actuator in zip(self.inputs, self.mjcf.actuators, strict=True):
            self._add_actuator(label, actuator)
        for name, tendon in self.mjcf.tendons.items():
            if tendon.stiffness or tendon.damping:
                self._add_tendon(name, tendon)
        for cable in self.mjcf.cables:
            self._add_cable(cable)
        for equality in self.mjcf.equalities:
            self._add_equality(equality)
        for limb in self.frames:
            self._draw(limb)

    def mounts(self) -> dict[str, Mount]:
        """Return name → frame of each body and site of the file, in its limb and in space."""
        sites = {name: self._mount(carrier, site)
                 for name, (carrier, site) in self.mjcf.sites.items()}
        return sites | super().mounts()

    def _draw(self, limb: int) -> None:
        """Draw a limb, or the ground, with its geoms of groups 0 to 2, else with the others.

        MuJoCo's viewer shows groups 0 to 2; files put collision shapes into higher groups.
        """
        robot = self.mjcf
        visible: list[Look] = []
        colliding: list[Look] = []
        for k in range(-1, len(robot.bodies)):
            if robot.limb(k) != limb:
                continue
            inner = robot.inner(k)
            for group, (placement, shape) in robot.looks[k]:
                (colliding if group > 2 else visible).append((inner.then(placement), shape))
        draw(self.builder, self.frames[limb], Placement(-self.centres[limb], np.eye(3)),
             visible or colliding, colliding, self.file)

    # ------------------------------------------------------------ actuators and equalities

    def _add_actuator(self, label: str, actuator: MjcfActuator) -> None:
        """Add an actuator's effort on its joints: gear (gain u + b₀ + b₁ l + (b₂ + drag u) l̇).

        u is the input ``label``, the actuator's name as C takes it, l = gear · Σ coefficient ·
        coordinate the actuator's length, and (b₀, b₁, b₂) its ``bias``.
        """
        build, gear = self.builder, actuator.gear
        length, rate = (gear * e for e in self._length(
            f"actuator {shown(actuator.name)}", actuator.joints))
        # an input that acts nowhere would be refused
        u: Any = 0
        if actuator.gain or actuator.drag:
            u = build.input(label, self.controls[actuator.name])
        b0, b1, b2 = actuator.bias
        effort = gear * (actuator.gain * u + b0 + b1 * length + (b2 + actuator.drag * u) * rate)
        self._add_motors(label, actuator.joints, effort)

    def _add_tendon(self, name: str, tendon: MjcfTendon) -> None:
        """Add V = ½ k (l − rest)² and the damper −c l̇ of a fixed tendon's length l."""
        length, rate = self._length(f"tendon {shown(name)}", tendon.joints)
        label = self.parameter_names.free(name, "tendon")
        k = self.builder.parameter(f"{label}_stiffness", tendon.stiffness)
        c = self.builder.parameter(f"{label}_damping", tendon.damping)
        if tendon.stiffness:
            self.builder.potential(k * (length - tendon.rest) ** 2 / 2)
        if tendon.damping:
            self._add_motors(label, tendon.joints, -c * rate)

    def _length(self, owner: str, joints: Sequence[tuple[str, float]]) -> tuple[Any, Any]:
        """Return Σ coefficient · coordinate of joints, and its rate, as expressions.

        ``joints`` has (name, coefficient); ``owner`` begins the message for a joint without a
        coordinate.
        """
        for name, _ in joints:
            if name not in self._measured:
                raise InputError(f"{owner} acts on {shown(name)}, which has no coordinate here; "
                                 "write armature for each joint of its body.")
        length, rate = (sum(c * self._symbols(name)[k] for name, c in joints) for k in (0, 1))
        return length, rate

    def _add_motors(self, label: str, joints: Sequence[tuple[str, float]], effort: Any) -> None:
        """Add motors with an effort along Σ coefficient · coordinate: coefficient · effort each."""
        for name, coefficient in joints:
            effort_kind = "torque" if self.robot.joints[name].kind == "hinge" else "force"
            self.builder.motor(self.joint_names.free(f"{label}_motor"), self._measured[name],
                               **{effort_kind: coefficient * effort})

    def _add_cable(self, cable: MjcfCable) -> None:
        """Add V = (2/h) Σ B_k (u_k − u°_k)² of neighbours, w + u = q̄_a q_b, as in ``beam``.

        q_a and q_b are the attitudes of the sections, h is the distance of the bodies' origins, and
        u° is the strain in the file's pose, 0 for a cable that is flat. u = sin(θ/2) e for a turn
        by θ about e, so that V is ½ (B/h) θ² for small θ.
        """
        numbers = {body.name: k for k, body in enumerate(self.robot.bodies)}
        names = ("twisting", "bending1", "bending2")
        B = [self._new_parameter(f"{cable.name}_{name}", value)
             for name, value in zip(names, cable.stiffness, strict=True)]
        for a, b in pairwise(numbers[name] for name in cable.bodies):
            body_b = self.robot.bodies[b]
            (q_a, start_a), (q_b, start_b) = (self._section_attitude(body) for body in (a, b))
            _, *u = quaternion_product(conjugate(q_a), q_b)
            # u and −u are one rotation: the rest strain has the sign of the start
            sign = 1 if quaternion_product(conjugate(start_a), start_b)[0] >= 0 else -1
            rest_strain = np.zeros(3) if cable.is_flat else sign * clean(
                np.array(quaternion_of_matrix(body_b.place.R)[1:]))
            h = self._new_parameter(f"{body_b.name}_spacing", float(np.linalg.norm(body_b.place.x)))
            strains = [x - (self._new_parameter(f"{body_b.name}_rest{k}", x0) if x0 else 0)
                       for k, (x, x0) in enumerate(zip(u, rest_strain.tolist(), strict=True))]
            self.builder.potential(
                2 / h * sum(B_k * x**2 for B_k, x in zip(B, strains, strict=True)))

    def _section_attitude(self, body: int) -> tuple[Any, Any]:
        """Return the quaternion of a body of the file, and its numbers at the start.

        Limbs alone have coordinates: it is the attitude of the limb with which the body moves,
        times the turn of the body in that limb.
        """
        limb, turn = self.robot.limb(body), quaternion_of_matrix(self.robot.inner(body).R)
        frame = self.frames[limb]
        start = (self.builder._components.bodies[frame].q if isinstance(frame, Body)
                 else [1, 0, 0, 0])
        attitude = (frame.attitude if limb == body
                    else quaternion_product(frame.attitude, turn.tolist()))
        return attitude, quaternion_product(start, turn)

    def _new_parameter(self, name: str, value: float) -> Any:
        """Return a parameter with a value, as a symbol; its name is made free."""
        return self.builder.parameter(self.parameter_names.free(name), value)

    def _add_equality(self, equality: MjcfEquality) -> None:
        """Add an <equality>: a point or a pose in common, or a law of two joints or tendons."""
        name = self.joint_names.free(equality.name, "equality")
        if equality.kind == "connect":
            self._add_connect(name, equality)
        elif equality.kind == "weld":
            self._add_weld(name, equality)
        else:
            self._add_law(name, equality)

    def _at_reference(self, body: int) -> Placement:
        """Return the placement of a body in space at the reference pose; −1 is the ground."""
        return IDENTITY if body < 0 else self.at_reference.bodies[body]

    def _add_connect(self, name: str, equality: MjcfEquality) -> None:
        """Add a ball joint of two bodies or sites.

        The points are the sites' origins, or the first six numbers of ``data`` in the bodies' axes.
        """
        points = np.zeros((2, 3)) if equality.sites else equality.data[:6].reshape(2, 3)
        anchors = []
        for (body, site), point in zip(equality.ends, points, strict=True):
            placement, limb = self._at_reference(body).then(site), self.robot.limb(body)
            anchors.append((limb, self._on(limb, self.at_reference,
                                        placement.x + placement.R @ point)))
        (a, on_a), (b, on_b) = anchors
        self.builder.ball(name, self.frames[a], self.frames[b], on_a=on_a, on_b=on_b)

    def _add_weld(self, name: str, equality: MjcfEquality) -> None:
        """Add a fixed joint of two bodies or sites, with the relative pose of the file.

        A closed weld has R_2 = R_1 R_rel. The frames are fixed in the limbs a and b, R_1 = R_a C_1
        and R_2 = R_b C_2 with the constants C of the reference pose, so that R_aᵀ R_b =
        C_1 R_rel C_2ᵀ is constant.
        """
        (body1, site1), (body2, site2) = equality.ends
        first, second = self._at_reference(body1).then(site1), self._at_reference(body2).then(site2)
        # a point of the second frame, and the pose of this point and these axes in the first frame
        point, relative = np.zeros(3), IDENTITY
        if not equality.sites:
            point = equality.data[:3]
            relative = Placement(equality.data[3:6], rotation(unit(equality.data[6:10])))
        a, b = self.robot.limb(body1), self.robot.limb(body2)
        R_a, R_b = (np.eye(3) if k < 0 else self.at_reference.bodies[k].R for k in (a, b))
        fixed_rotation = R_a.T @ first.R @ relative.R @ second.R.T @ R_b
        start_a, start_b = (np.eye(3) if k < 0 else self.poses.bodies[k].R for k in (a, b))
        # The trace is 1 + 2 cos θ. The constraints of a fixed joint also hold for bodies turned by
        # π, and the projection of a start beyond 90° could end there.
        if np.trace(fixed_rotation.T @ start_a.T @ start_b) < 1:
            raise InputError(f"weld {shown(equality.name)} holds its bodies turned by more than 90 "
                             "degrees from where they start; give a keyframe, or angles, nearer.")
        self.builder.fixed(
            name, self.frames[a], self.frames[b],
            on_a=self._on(a, self.at_reference, first.x + first.R @ relative.x),
            on_b=self._on(b, self.at_reference, second.x + second.R @ point),
            rotation=fixed_rotation)

    def _add_law(self, name: str, equality: MjcfEquality) -> None:
        """Add y₁ − y₁(0) = c₀ + c₁ (y₂ − y₂(0)) + … of two joints or of two tendons.

        y₁ and y₂ belong to the first and second of ``equality.ends``: each is the coordinate of a
        joint, or the length of a tendon, Σ factor · coordinate. y₂ may be missing. A linear law of
        two joints is a coupling.
        """
        # c₀, …, c₄
        coefficients = equality.data[:5].tolist()
        # each y as a sum of terms (joint, factor)
        sums = [((end, 1.0),) if equality.kind == "joint" else self.mjcf.tendons[end].joints
                for end in equality.ends]
        for joint, _ in (term for terms in sums for term in terms):
            if joint not in self.coordinates:
                raise InputError(
                    f"equality {shown(equality.name)} is on {shown(joint)}, which has no "
                    "coordinate here; write armature for each joint of its body.")
        # y₁(0) and y₂(0)
        at_reference = [sum(factor * self.robot.joints[joint].ref for joint, factor in terms)
                        for terms in sums]
        if equality.kind == "joint" and len(sums) == 2 and not any(coefficients[2:]):
            c0, c1 = coefficients[:2]
            # c₁ = 0 fixes y₁: no coupling of two joints
            if c1:
                dependent, independent = (self.coordinates[end] for end in equality.ends)
                # y₁ = c₁ y₂ + (c₀ + y₁(0) − c₁ y₂(0))
                self.builder.couple(name, independent, dependent, ratio=c1,
                                   offset=c0 + at_reference[0] - c1 * at_reference[1])
                return
        links = [self.coordinates[joint] for terms in sums for joint, _ in terms]
        self.builder.law(
            name, links, partial(_deviation_from_law, coefficients, sums, at_reference))


def _deviation_from_law(
    coefficients: Sequence[float], sums: Sequence[Sequence[tuple[str, float]]],
    at_reference: Sequence[float], *coordinates: Any,
) -> Any:
    """Return y₁ − y₁(0) − Σ c_k (y₂ − y₂(0))^k, which a constraint holds at 0.

    ``sums`` has the terms (joint, factor) of y₁ and of y₂, which may be missing;
    ``at_reference`` has y(0), ``coordinates`` are one for each term, in their order.
    """
    remaining = iter(coordinates)
    dependent, *independent = (
        sum(factor * next(remaining) for _, factor in terms) - y_at_reference
        for terms, y_at_reference in zip(sums, at_reference, strict=True))
    polynomial = sum(c * (independent[0] if independent else 0) ** k
                     for k, c in enumerate(coefficients) if c)
    return dependent - polynomial
