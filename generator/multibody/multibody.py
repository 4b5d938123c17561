"""Multibody models in Python: a builder with a method for each kind of body, joint and force.

``JOINTS`` are the methods that a model file may name as ``type``; its keys are their arguments.
Coordinates of joints are symbols until ``model()`` replaces them by expressions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from ...core.arguments import (
    as_flag,
    as_integer,
    as_items,
    as_mapping,
    as_text,
    choose,
    count_text,
    few,
    shown,
)
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.event import Impact
from ...core.html import card, table
from ...core.inertia import (
    Inertia,
    RepName,
    as_inertia,
    is_number,
    is_tensor,
    moments_of,
    quaternion_product,
    real_array,
    warn_of_degrees,
    warn_of_shift,
)
from ...core.projection import Projection
from ...core.records import FixedAttributes
from ...core.registry import function_of
from ...core.shapes import Shape
from ...core.start import HasStart, as_start
from ...core.warnings import warn
from ..symbolic.derivatives import derivative
from ..systems.expression_arguments import as_expression
from ..systems.numeric_system import NumericSystem
from ..systems.redundant_constraints import Redundancy
from .assembly import Assembly
from .beam import (
    COLOUR,
    Beam,
    BeamEnd,
    BeamJoint,
    curve_of,
    moments_of_segment,
    stiffness_of,
)
from .body import GROUND, Body, Frame, MovingPoint, Particle, three_expressions
from .components import TIME, Components
from .coordinates import BallFlywheel, Chain, Coordinate, Flywheel, FlywheelBody, Law, Link
from .gaps import gaps_of_plane, gaps_of_spheres, points_of
from .initial_poses import (
    InitialState,
    attitude,
    check_rep,
    conjugate,
    count,
    finite,
    initial_state,
    non_negative,
    nonzero,
    onto,
    optional_vector,
    positive,
    rotation,
    unit,
    vector,
)
from .joints import (
    RATE_OF,
    Align,
    Connection,
    Coupling,
    Cylindrical,
    Fixed,
    Gear,
    HingedJoint,
    Joint,
    JointSpring,
    Motor,
    Planar,
    Prismatic,
    Revolute,
    RheonomicConstraint,
    Rod,
    Screw,
    Spring,
    Universal,
    hinge_of,
    named_number,
    named_vector,
)
from .model import Model
from .rolling import Rolling

__all__ = ["AXES", "JOINTS", "Multibody"]

Joined = TypeVar("Joined", bound=Connection)
#: Arguments that give the axis of a joint; a call has one of them.
AXES = ("axis", "axis_on_body", "axis_in_space")
#: The values of ``AXES`` in a call, None for arguments that are left out.
Axes: TypeAlias = tuple[ArrayLike | None, ArrayLike | None, ArrayLike | None]
#: The default point of a contact. A point that is passed is another object, equal or not.
_ORIGIN = (0.0, 0.0, 0.0)
#: An axis is the same in space and on a body if its components are to within this.
_SAME_AXIS = 1e-9

#: Coordinates of joints, of which a cylindrical joint and a screw have both.
CoordinateName = Literal["angle", "travel"]

JOINTS = ("ball", "fixed", "fixed_point", "revolute", "align", "rod", "prismatic", "cylindrical",
          "planar", "screw", "universal", "rolls")


class Multibody(FixedAttributes):
    """A builder of models: add bodies, joints and forces, then ask for ``model()``.

    Attributes
    ----------
    name : str
        A C identifier, the system's name.
    ground : Frame
        Space, wherever a joint or spring takes a body.
    time : Symbol
        t, for forces, torques and quantities.

    Examples
    --------
    >>> import gyrospark as gs
    >>> arm = gs.Multibody("arm")
    >>> upper = arm.body("upper", mass=1.0, inertia=(0.1, 0.1, 0.01))
    >>> lower = arm.body("lower", mass=1.0, inertia=(0.1, 0.1, 0.01))
    >>> _ = arm.fixed_point("shoulder", upper, on_body=(0, 0, 0.5), at=(0, 0, 0))
    >>> _ = arm.ball("elbow", upper, lower, on_a=(0, 0, -0.5), on_b=(0, 0, 0.5))
    >>> model = arm.model()
    >>> float(model.q0[-1]), model.system.n, model.system.m
    (-1.5, 14, 8)
    """

    name: str
    ground: Frame
    time: sp.Symbol

    def __init__(
        self, name: str, *, gravity: ArrayLike = (0.0, 0.0, -9.81),
        dt: float | None = None, steps: int | None = None, description: str = "",
    ) -> None:
        self.name = as_text("name of a Multibody", name)
        self.ground, self.time = GROUND, TIME
        self._start: Projection | None = None
        self._redundancy: Redundancy | None = None
        values: dict[str, float] = {}
        acceleration = named_vector("gravity", vector("gravity", gravity).tolist(), values)
        self._components = Components(self.name, acceleration, values)
        self._visuals: dict[str, list[Shape]] = {}
        #: Arguments of ``Model`` that the user chose.
        self._about: dict[str, Any] = {
            "dt": None if dt is None else float(finite("time step", dt, shape=())),
            "steps": None if steps is None else count(steps),
            "description": as_text("description", description),
        }
        #: Whether bodies are described where they start, as robots' files place them.
        self._describes_start = False

    @classmethod
    def from_file(cls, path: str | Path, rep: RepName | None = None, **options: Any) -> Multibody:
        """Return the bodies and joints of a robot's file, to which more can be added.

        Parameters
        ----------
        path : path
            A file in URDF, MJCF or SDF.
        rep : {"gamma", "alpha"}, optional
            Inertia representation.
        **options
            Those of ``gyrospark.load_model`` for the format.

        Returns
        -------
        Multibody
            A body for the links that are fixed to each other, with the name and the axes of the
            first of them; joints, and in MJCF an input for each actuator. In names, ``_`` stands
            for characters that C does not allow. Geoms of groups 0 to 2 of MJCF, and visuals, are
            drawn. Equalities of MJCF are exact constraints, and soft in MuJoCo. In SDF a joint
            whose child has a parent already closes a loop.

        Raises
        ------
        InputError
            With file, line, link or joint, and cure; for an option of another format.
        """
        load_robot = function_of("generator.models.robots", "load_robot")
        builder: Multibody = load_robot(path, rep, options)
        return builder

    def __repr__(self) -> str:
        return (f"<Multibody {self.name}: "
                f"bodies {few(body.name for body in self._components.bodies)}; "
                f"joints {few(link.name for link in self._components.connections)}>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the names of bodies, joints and parameters."""
        parts = self._components
        return card(f"Multibody {self.name}", table([
            ("about", self._about["description"] or self.name), ("gravity", few(self.gravity)),
            ("bodies", few(body.name for body in parts.bodies)),
            ("joints", few(link.name for link in parts.connections)),
            ("parameters", few(f"{name} = {x:g}" for name, x in parts.values.items()))]))

    @property
    def gravity(self) -> tuple[sp.Expr, ...]:
        """Its acceleration in space, as symbols."""
        return self._components.gravity

    @property
    def start(self) -> Projection | None:
        """The projection of the initial state onto the constraints, after ``model()``."""
        return self._start

    @property
    def redundancy(self) -> Redundancy | None:
        """The constraints left out, and those that imply them, after ``model(redundant=...)``."""
        return self._redundancy

    # ------------------------------------------------------------ bodies

    def body(
        self, name: str, *, mass: float, inertia: ArrayLike, rep: RepName = "gamma",
        weight: float | None = None, position: ArrayLike | None = None,
        quaternion: ArrayLike | None = None, rotation: Any = None,
        velocity: ArrayLike | None = None, angular_velocity: ArrayLike | None = None,
    ) -> Body:
        """Add a body with 7 coordinates, quaternion and position of its centre of mass.

        Parameters
        ----------
        name : str
            Begins the names of its symbols: a_q0, …, a_x, a_p0, …, a_px, a_m, a_I1, a_gamma.
        mass : float
            In kg.
        inertia : three floats, or 3 × 3
            About the centre of mass in kg m²: principal moments, body axes being principal axes, or
            the tensor in any body axes. Joints, points, attitude and angular velocity, before a run
            and after it, are in the same axes.
        rep : {"gamma", "alpha"}
            Inertia representation.
        weight : float, optional
            γ or α in kg m², not 0; by default the mean of the moments.
        position, velocity : three floats, optional
            Of the centre of mass in space; by default as joints require, else 0.
        quaternion, rotation : optional
            Attitude from body to space axes: four numbers, scalar first, or a 3 × 3 matrix or
            SciPy Rotation; by default body and space axes agree.
        angular_velocity : three floats, optional
            In body axes, rad/s; by default as revolute joints require, else 0.

        Returns
        -------
        Body
            For joints, and for expressions: ``.point(r)``, ``.velocity``, ``.angular_velocity``.

        Raises
        ------
        InputError
            For names used twice and for numbers that no body can have.
        """
        self._components.claim(name, "body")
        check_rep(name, rep)
        checked_inertia = as_inertia(inertia, f"inertia of {name!r}")
        start = initial_state(name, quaternion, rotation, position, velocity, angular_velocity)
        body = Body.free(name, rep, tensor=is_tensor(checked_inertia))
        return self._add(body, start, mass, checked_inertia, weight)

    def top(
        self, name: str, *, mass: float, inertia: ArrayLike, centre: ArrayLike,
        at: ArrayLike = (0.0, 0.0, 0.0), rep: RepName = "gamma", weight: float | None = None,
        quaternion: ArrayLike | None = None, rotation: Any = None,
        angular_velocity: ArrayLike | None = None,
    ) -> Body:
        """Add a body that turns about a fixed point: 4 coordinates, no joint needed.

        ``inertia`` holds the principal moments about that point, or the tensor, ``centre`` the
        centre of mass from it in body axes, ``at`` where in space it is. All else as for ``body``.
        """
        self._components.claim(name, "body")
        check_rep(name, rep)
        checked_inertia = as_inertia(inertia, f"inertia of {name!r}")
        origin = vector(f"fixed point of {name!r}", at)
        middle = vector(f"centre of {name!r}", centre)
        body = Body.with_fixed_point(
            name, rep, named_vector(f"{name}_at", origin.tolist(), self._components.values),
            named_vector(f"{name}_centre", middle.tolist(), self._components.values),
            tensor=is_tensor(checked_inertia),
        )
        start = initial_state(name, quaternion, rotation, origin, velocity=(0, 0, 0),
                              omega=angular_velocity)
        self._add(body, start, mass, checked_inertia, weight)
        warn_of_shift(checked_inertia, float(mass), middle.astype(float), f"inertia of {name!r}")
        return body

    def chain_of_rods(
        self, points: ArrayLike, *, mass: float | Sequence[float], radius: float = 0.01,
        axis: ArrayLike | None = None, a: Frame | str | None = GROUND, name: str = "rod",
        rep: RepName = "gamma",
    ) -> list[Body]:
        """Add uniform rods from point to point, each joined to the one before it.

        Parameters
        ----------
        points : array_like, shape (N + 1, 3)
            Ends of the N rods in space at the start, in m.
        mass : float or N floats
            Of each rod, in kg.
        radius : float
            Of the rods, in m.
        axis : array_like, shape (3,), optional
            Direction of all hinges in space at the start; by default the joints are balls.
        a : Body, ``ground``, a name or None
            Holds the first point; None leaves it free.
        name : str
            The rods are ``rod_1`` … ``rod_N``, their first ends the joints ``rod_1_joint`` ….

        Returns
        -------
        list of Body
            From the first to the last, each with its axis 1 from point to point.

        Raises
        ------
        InputError
            For fewer than two points, and points that coincide with the next.
        """
        nodes = real_array(points)
        if nodes is None or nodes.ndim != 2 or nodes.shape[0] < 2 or nodes.shape[1] != 3 or not (
                np.isfinite(nodes).all()):
            raise InputError(f"points = {shown(points)} is no list of two or more points; give "
                             "rows of three finite numbers.")
        masses = [mass] * (len(nodes) - 1) if is_number(mass) else as_items("mass", mass, "numbers")
        if len(masses) != len(nodes) - 1:
            raise InputError(f"mass has {len(masses)} numbers for {len(nodes) - 1} rods; give one "
                             "of each, or one of all.")
        rods: list[Body] = []
        previous: Frame | str | None = a  # holds the first end of the next rod; None: free
        for k, (start, end, m) in enumerate(zip(nodes[:-1], nodes[1:], masses, strict=True), 1):
            if not np.any(end - start):
                raise InputError(f"Points {k} and {k + 1} of {name!r} coincide; leave out one.")
            rod = self._uniform_rod(f"{name}_{k}", start, end, m, rep, radius)
            if previous is not None and axis is None:
                self.ball(f"{name}_{k}_joint", previous, rod, at=start)
            elif previous is not None:
                self.revolute(f"{name}_{k}_joint", previous, rod, axis_in_space=axis, at=start)
            previous = rod
            rods.append(rod)
        return rods

    def _uniform_rod(
        self, name: str, start: Array, end: Array, mass: float, rep: RepName, radius: float = 0.01
    ) -> Body:
        """Add a uniform rod of length l between two points in space, along its axis 1.

        Moments: m r²/2 about the rod, m (l²/12 + r²/4) across it.
        """
        m, r = positive(f"mass of {name!r}", mass), positive(f"radius of {name!r}", radius)
        length = float(np.linalg.norm(end - start))
        e = (end - start) / length
        # axis 2, across the rod: e × the coordinate axis that makes the largest angle with e
        f = np.cross(e, np.eye(3)[int(np.abs(e).argmin())])
        f /= np.linalg.norm(f)
        across = m * (length**2 / 12 + r**2 / 4)
        return self.body(
            name, mass=m, inertia=(m * r**2 / 2, across, across), rep=rep,
            position=(start + end) / 2, rotation=np.stack([e, f, np.cross(e, f)], axis=1))

    def point_mass(
        self, name: str, *, mass: float, position: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
    ) -> Particle:
        """Add a point with mass, 3 coordinates: for balls, rods, springs and forces at the point.

        ``mass`` is in kg; ``position`` in m and ``velocity`` in m/s are in space, by default as
        ball joints require, else 0.
        """
        self._components.claim(name, "body")
        point = Particle.with_name(name)
        self._components.values[str(point.mass)] = positive(f"mass of {name!r}", mass)
        self._components.bodies[point] = initial_state(
            name, quaternion=None, rotation=None, position=position, velocity=velocity,
            omega=(0, 0, 0))
        return point

    def rotor(
        self, name: str, body: Frame | str, *, mass: float, inertia: Sequence[float],
        axis: ArrayLike | None = None, axis_on_body: ArrayLike | None = None,
        axis_in_space: ArrayLike | None = None, at: ArrayLike | None = None,
        on_body: ArrayLike | None = None, rate: float | None = None,
    ) -> Body:
        """Add a wheel that spins on a body, on the bearing ``NAME_bearing``, a revolute.

        Parameters
        ----------
        inertia : two floats
            In kg m²: the moment about its axis, which is its own third one, then that across.
        axis, axis_on_body, axis_in_space, rate : optional
            The axis, in space or in the axes of the body, and how fast the wheel spins about it
            against the body: as for ``revolute``.
        at, on_body : three floats, optional
            Where the wheel's centre is, in space or on the body; by default the body's origin.
        """
        moment_about_axis, moment_across = finite(
            f"inertia of rotor {name!r}, about its axis and across it,", inertia, (2,))
        carrier = self._components.frame(body, shown(name))
        # the wheel is not there yet: the carrier alone has axes in which the axis may be given
        direction = self._axis(name, carrier, carrier, (axis, axis_on_body, axis_in_space))
        wheel = self.body(name, mass=mass,
                          inertia=(moment_across, moment_across, moment_about_axis),
                          quaternion=onto(direction))
        if at is None and on_body is None:
            on_body = (0, 0, 0)
        self.revolute(f"{name}_bearing", body, wheel, axis_in_space=direction, at=at,
                      on_a=on_body, on_b=(0, 0, 0), rate=rate)
        return wheel

    def beam(
        self, name: str, *, count: int, mass: float, bending: float | tuple[float, float],
        twisting: float, start: ArrayLike | None = None, end: ArrayLike | None = None,
        points: ArrayLike | None = None, stretching: float | None = None,
        shearing: float | None = None, damping: float = 0.0, rest: ArrayLike | None = None,
        normal: ArrayLike | None = None, twist: float = 0.0, radius: float | None = None,
        inertia: ArrayLike | None = None, velocity: ArrayLike | None = None,
        angular_velocity: ArrayLike | None = None, rep: RepName = "gamma",
    ) -> Beam:
        """Add a beam or cable: rigid segments that bend and twist against each other.

        Errors fall as the square of the length of a segment. ``fixed`` clamps an end, with half a
        segment that bends; ``ball``, ``rod``, ``spring`` and ``force`` take the point of an end.
        Other joints hold the axes of the first or last segment, with an error of one segment.

        Parameters
        ----------
        name : str
            Begins the names of segments, ``NAME_1`` to ``NAME_count``, ends, ``NAME_first`` and
            ``NAME_last``, and parameters, such as ``NAME_bending``, that all segments share.
        count : int
            Number of segments, 2 or more.
        mass : float
            Of the whole, in kg.
        bending : float or two floats
            EI in N m², or EI₁ and EI₂ about the first and second axis of the section.
        twisting : float
            GJ in N m².
        start, end : three floats
            Ends of a straight beam in space at the start, m.
        points : array_like, shape (k, 3)
            In their place, a polygon that the beam follows: points of a curve, as many as it needs.
        stretching, shearing : float, optional
            EA and GA in N, of the section and with the shear coefficient; both, or neither for a
            beam that keeps its length, whose segments are joined by constraints.
        damping : float
            Retardation time τ in s of a Kelvin-Voigt material: each stiffness times τ resists the
            rate of its strain.
        rest : three floats, optional
            Curvature without moment in 1/m, about the axes of the section, the third one its
            torsion; by default the start is free of moments.
        normal : three floats, optional
            Direction of the first axis of the section at the start of the beam, in space; by
            default the first axis of space after the smallest rotation of the third one into the
            tangent.
        twist : float
            Angle in rad by which the section turns about the tangent from the start to the end.
        radius : float, optional
            Of a round section, in m: segments have the inertia of cylinders, and pictures a tube.
        inertia : three floats, optional
            Inertia of segments about the axes of the section per length, in kg m; by default
            segments are cylinders of ``radius``, and without one have m h²/12 about each axis.
        velocity, angular_velocity : three floats, optional
            Velocity of the first end of the beam in m/s and angular velocity in rad/s, in space:
            the beam starts in motion as one rigid body. By default as joints require, else 0.
        rep : {"gamma", "alpha"}
            Representation of the inertia of the segments.

        Returns
        -------
        Beam
            With ``first`` and ``last``, its ends, and ``segments``.

        Raises
        ------
        InputError
            For less than two segments, stiffnesses that are not above 0, only one of stretching and
            shearing, points that coincide, and a curve that turns back.
        """
        self._components.claim(name, "body")
        check_rep(name, rep)
        segment_count, EI, GJ, extension, tau = stiffness_of(
            name, count, bending, twisting, stretching, shearing, damping)
        curve = curve_of(name, start, end, points, segment_count)
        # of the first end, of each segment, and of the last end: segment_count + 2 quaternions
        attitudes = curve.attitudes(name, normal, float(finite(f"twist of {name!r}", twist, ())))
        # h: length of the beam along a segment, for inertia and stiffness; the chord between its
        # joints is shorter where the beam is curved
        nodes, h = curve.nodes, curve.length / segment_count
        m = positive(f"mass of {name!r}", mass) / segment_count
        checked_radius = None if radius is None else positive(f"radius of {name!r}", radius)
        moments = as_inertia(moments_of_segment(name, inertia, m, h, checked_radius),
                             f"inertia of {name!r}")
        halves = np.linalg.norm(curve.chords, axis=1) / 2
        v, omega = (optional_vector(f"{option} of {name!r}", entry) for option, entry in (
            ("velocity", velocity), ("angular velocity", angular_velocity)))
        segments, segment_attitudes = list[Body](), attitudes[1:-1]
        for k, (q, half) in enumerate(zip(
                segment_attitudes, halves.tolist(), strict=True), start=1):
            self._components.claim(f"{name}_{k}", "body")
            state = _segment_state(f"{name}_{k}", q, (nodes[k - 1] + nodes[k]) / 2, nodes[0], v,
                                   omega)
            body = Body.of_beam(f"{name}_{k}", rep, name)
            # γ or α, the ``weight``, is the mean of the moments
            segments.append(self._add(body, state, m, moments, weight=None))
            # a beam without a radius is drawn slender
            self.visual(body, Shape.bar((0, 0, -half), (0, 0, half), checked_radius or h / 8,
                                        COLOUR))
        beam = Beam(
            name, tuple(segments),
            BeamEnd(f"{name}_first", segments[0], np.array([0, 0, -halves[0]]), attitudes[0],
                    nodes[0], is_first=True),
            BeamEnd(f"{name}_last", segments[-1], np.array([0, 0, halves[-1]]), attitudes[-1],
                    nodes[-1], is_first=False),
            spacing=h, bending=EI, twisting=GJ, extension=extension, damping=tau,
            rest=None if rest is None else vector(f"rest of {name!r}", rest))
        self._components.beams.append(beam)
        self._join_segments(beam, segment_attitudes, halves)
        return beam

    def _join_segments(self, beam: Beam, attitudes: Sequence[Array], halves: Array) -> None:
        """Join the N segments of a beam with attitudes, shape (N, 4), and half lengths in m, (N,).

        Joint k is between the segments k and k + 1, at the distance k h from the start.
        """
        h, segment_count = beam.spacing, len(beam.segments)
        for k in range(1, segment_count):
            # A joint has the extension of the half segments on both sides, ``gap`` in m. Those at
            # the ends of the beam have no joint of their own, and the next one has theirs too. A
            # beam without extension keeps its length, and its joints have no gap.
            outer_count = (k == 1) + (k == segment_count - 1)
            self._join(BeamJoint(
                f"{beam.name}_joint_{k}", beam.segments[k - 1], beam.segments[k],
                np.array([0, 0, halves[k - 1]]), np.array([0, 0, -halves[k]]), beam=beam,
                rest=beam.rest_strain(attitudes[k - 1], attitudes[k], factor=2), arc=k * h,
                gap=(1 + outer_count / 2) * h if beam.extension else 0.0))

    # ------------------------------------------------------------ joints

    def ball(
        self, name: str, a: Frame | str, b: Frame | str, *, at: ArrayLike | None = None,
        on_a: ArrayLike | None = None, on_b: ArrayLike | None = None,
    ) -> Joint:
        """Join a point of a to a point of b: three constraints, ``name: x``, ``y`` and ``z``.

        Parameters
        ----------
        a, b : Body, ``ground``, or a name
            In the order of the chain.
        at : three floats, optional
            Where in space the joint is at the start.
        on_a, on_b : three floats, optional
            Where on the bodies it is, in body axes from their origins. Two of the three are
            enough; a position that is not given follows from them. ``at`` alone is enough for
            bodies in known places.
        """
        return self._join(Joint(name, **self._pair(name, a, b, at, on_a, on_b)))

    def fixed_point(
        self, name: str, body: Frame | str, *, at: ArrayLike | None = None,
        on_body: ArrayLike | None = None,
    ) -> Joint:
        """Hold a point of a body at a point of space: three constraints.

        Prefer ``top`` where it is the only joint to the ground: it needs no constraint.
        """
        return self.ball(name, GROUND, body, at=at, on_b=on_body)

    def fixed(
        self, name: str, a: Frame | str, b: Frame | str, *, at: ArrayLike | None = None,
        on_a: ArrayLike | None = None, on_b: ArrayLike | None = None, rotation: Any = None,
    ) -> Fixed | BeamJoint:
        """Fix b to a: six constraints, ``name: x``, ``y``, ``z``, ``turn x``, ``y``, ``z``.

        For bodies of closed loops; without a loop, model both as one body.
        ``rotation`` is the attitude of b in the axes of a, a 3 × 3 matrix or SciPy Rotation; by
        default their relative attitude at the start. Other arguments as for ``ball``.
        The end of a beam is clamped: three constraints, and a potential of half a segment.
        """
        q = None if rotation is None else attitude(f"{name!r}", quaternion=None, matrix=rotation)
        pair = self._pair(name, a, b, at, on_a, on_b)
        if {pair["a"], pair["b"]} & {x for beam in self._components.beams for x in beam.segments}:
            return self._join(self._clamp(name, (a, b), pair, q))
        return self._join(Fixed(name, **pair, relative=None if q is None else _matrix(q)))

    def _clamp(
        self, name: str, frames: tuple[Frame | str, Frame | str], pair: dict[str, Any],
        q: Array | None,
    ) -> BeamJoint:
        """Return the clamp of an end of a beam: half a segment that bends against the holder.

        ``frames`` are a and b as the user gave them, one of them the end of a beam; ``pair`` has
        the arguments of the joint's points. ``q`` is the attitude of b in the axes of a; by
        default the section keeps its attitude at the start.
        """
        ends = [self._components.end(frame) for frame in frames]
        end = ends[0] or ends[1]
        holder = pair["b"] if ends[0] else pair["a"]
        is_segment = any(holder in beam.segments for beam in self._components.beams)
        if end is None or is_segment:
            raise InputError(
                f"{name!r} fixes {'two beams to each other' if all(ends) else 'an inner segment'}; "
                "a beam is fixed at an end, beam.first or beam.last, to the ground or to a body, "
                "which may be between two beams.")
        beam = next(candidate for candidate in self._components.beams
                    if end in (candidate.first, candidate.last))
        holder_attitude = (np.array([1.0, 0, 0, 0])
                           if holder is GROUND or isinstance(holder, MovingPoint)
                           else self._components.bodies[holder].q)
        # attitude in space of the section at the clamp
        section = end.q
        if q is not None:
            # q turns from a to b, so that a beam at a has the inverse turn from the holder at b
            section = np.array(quaternion_product(holder_attitude, conjugate(q) if ends[0] else q))
            # q and −q are one attitude: the sign that is nearer to the start
            section = section * (1 if section @ end.q >= 0 else -1)
        q_segment = self._components.bodies[end.segment].q
        # half a segment bends: κ = (4/h) u
        rest_strain = (beam.rest_strain(end.q, q_segment, factor=4) if end.is_first else
                       beam.rest_strain(q_segment, end.q, factor=4))
        return BeamJoint(name, **pair, beam=beam, factor=4, rest=rest_strain,
                         relative=quaternion_product(conjugate(holder_attitude), section),
                         arc=0.0 if end.is_first else beam.spacing * len(beam.segments))

    def revolute(
        self, name: str, a: Frame | str, b: Frame | str, *, axis: ArrayLike | None = None,
        axis_on_body: ArrayLike | None = None, axis_in_space: ArrayLike | None = None,
        at: ArrayLike | None = None, on_a: ArrayLike | None = None,
        on_b: ArrayLike | None = None, rate: float | None = None,
        angle: float | None = None,
    ) -> Revolute:
        """Join a and b by a hinge: five constraints, ``name: x``, ``y``, ``z``, ``axis 1, 2``.

        ``axis`` is its direction in space at the start, of any length, as ``axis_in_space`` is;
        ``axis_on_body`` is its direction in the axes of a, or of b where a is the ground. A
        warning is given if ``axis`` differs in the axes of a. ``rate`` is the angular
        velocity of b against a about it in rad/s, from which an angular velocity that is not
        given follows; ``angle``, in rad, turns b and the bodies beyond it to the start, from the
        positions, attitudes and axes that are given, where it is 0. All else as for ``ball``.
        """
        return self._join(Revolute(name, **self._pair(name, a, b, at, on_a, on_b),
                                   hinge=self._hinge(
                                       name, a, b, (axis, axis_on_body, axis_in_space), rate,
                                       angle)))

    def align(
        self, name: str, a: Frame | str, b: Frame | str, *, axis: ArrayLike | None = None,
        axis_on_body: ArrayLike | None = None, axis_in_space: ArrayLike | None = None,
        rate: float | None = None,
        angle: float | None = None,
    ) -> Align:
        """Keep one axis of a and b in common: two constraints, ``name: axis 1`` and ``axis 2``.

        For bodies that have a point in common anyway, such as tops in one place, it is a hinge.
        ``axis``, ``rate`` and ``angle`` as for ``revolute``.
        """
        return self._join(self._hinge(name, a, b, (axis, axis_on_body, axis_in_space), rate, angle))

    def prismatic(
        self, name: str, a: Frame | str, b: Frame | str, *, axis: ArrayLike | None = None,
        axis_on_body: ArrayLike | None = None, axis_in_space: ArrayLike | None = None,
        at: ArrayLike | None = None, on_a: ArrayLike | None = None,
        on_b: ArrayLike | None = None, speed: float | None = None,
        travel: float | None = None,
    ) -> Prismatic:
        """Let b slide along an axis of a without turning: five constraints.

        ``axis`` is its direction in space at the start, along which b moves at ``speed`` in m/s;
        ``at`` any point of it; ``travel``, in m, moves b and the bodies beyond it to the start,
        from the given positions, where it is 0. All else as for ``ball``. Constraints:
        ``name: axis 1``, ``axis 2``, ``across 1``, ``across 2``, ``turn``.
        """
        return self._join(Prismatic(
            name, **self._pair(name, a, b, at, on_a, on_b),
            hinge=self._hinge(name, a, b, (axis, axis_on_body, axis_in_space)),
            speed=_number_or_none(f"speed of {name!r}", speed), **self._travel(name, travel)))

    def cylindrical(
        self, name: str, a: Frame | str, b: Frame | str, *, axis: ArrayLike | None = None,
        axis_on_body: ArrayLike | None = None, axis_in_space: ArrayLike | None = None,
        at: ArrayLike | None = None, on_a: ArrayLike | None = None,
        on_b: ArrayLike | None = None, rate: float | None = None,
        speed: float | None = None, angle: float | None = None, travel: float | None = None,
    ) -> Cylindrical:
        """Let b slide along an axis of a and turn about it: four constraints.

        They are those of ``prismatic`` without ``turn``; arguments as there and for ``revolute``.
        """
        return self._join(Cylindrical(
            name, **self._pair(name, a, b, at, on_a, on_b),
            hinge=self._hinge(name, a, b, (axis, axis_on_body, axis_in_space), rate, angle),
            speed=_number_or_none(f"speed of {name!r}", speed), **self._travel(name, travel)))

    def planar(
        self, name: str, a: Frame | str, b: Frame | str, *, axis: ArrayLike | None = None,
        axis_on_body: ArrayLike | None = None, axis_in_space: ArrayLike | None = None,
        at: ArrayLike | None = None, on_a: ArrayLike | None = None,
        on_b: ArrayLike | None = None, rate: float | None = None,
        angle: float | None = None,
    ) -> Planar:
        """Keep a plane of b on one of a: three constraints.

        ``axis`` is the normal in space at the start, ``at`` a point of both planes. All else as
        for ``revolute``. Constraints: ``name: axis 1``, ``axis 2``, ``distance``.
        """
        return self._join(Planar(name, **self._pair(name, a, b, at, on_a, on_b),
                                 hinge=self._hinge(
                                     name, a, b, (axis, axis_on_body, axis_in_space), rate,
                                     angle)))

    def screw(
        self, name: str, a: Frame | str, b: Frame | str, *, lead: float,
        axis: ArrayLike | None = None, axis_on_body: ArrayLike | None = None,
        axis_in_space: ArrayLike | None = None, at: ArrayLike | None = None,
        on_a: ArrayLike | None = None, on_b: ArrayLike | None = None, rate: float | None = None,
        travel: float | None = None,
    ) -> Screw:
        """Let b turn about an axis of a and move along it by ``lead`` (m) a turn: five constraints.

        A lead below 0 is a left-handed thread. The angle is 2π times the travel over the lead. All
        else as for ``prismatic``, with ``rate`` in rad/s in place of ``speed``, and ``thread`` in
        place of ``turn``.
        """
        h = float(finite(f"lead of {name!r}", lead, shape=()))
        if not h:
            raise InputError(f"The lead of {name!r} is 0, and a screw moves; take a revolute.")
        hinge = self._hinge(name, a, b, (axis, axis_on_body, axis_in_space), rate)
        travels = self._travel(name, travel)
        # no argument gives the angle of the hinge: it follows from the travel
        hinge.angle = 2 * math.pi * travels["travel"] / h
        if travels["start_travel"] is not None:
            hinge.start_angle = 2 * math.pi * travels["start_travel"] / h
        return self._join(Screw(name, **self._pair(name, a, b, at, on_a, on_b), lead=h,
                                hinge=hinge, **travels))

    def universal(
        self, name: str, a: Frame | str, b: Frame | str, *, axis_a: ArrayLike,
        axis_b: ArrayLike, at: ArrayLike | None = None, on_a: ArrayLike | None = None,
        on_b: ArrayLike | None = None, rate_a: float | None = None,
        rate_b: float | None = None,
    ) -> Universal:
        """Join a and b by a cross with an axis in each, Cardan's joint: four constraints.

        ``axis_a`` and ``axis_b`` are the directions of its arms in space at the start, at right
        angles; b turns about them at ``rate_a`` and ``rate_b`` in rad/s. All else as for ``ball``.
        """
        arms = _direction(name, "axis_a", axis_a), _direction(name, "axis_b", axis_b)
        # arms of unit length: 1e-6 rad is the rounding of directions with six digits
        if abs(float(arms[0] @ arms[1])) > 1e-6:
            raise InputError(f"The axes of {name!r} are not at right angles: {shown(axis_a)} and "
                             f"{shown(axis_b)}; correct one of them.")
        rates = (_number_or_none(f"rate_a of {name!r}", rate_a),
                 _number_or_none(f"rate_b of {name!r}", rate_b))
        return self._join(Universal(name, **self._pair(name, a, b, at, on_a, on_b),
                                    arms=arms, rates=rates))

    def rolls(
        self, name: str, body: Frame | str, *, disc: float | None = None,
        sphere: float | None = None, ellipsoid: ArrayLike | None = None,
        on_body: ArrayLike | None = None, axis_on_body: ArrayLike | None = None,
        normal: ArrayLike | None = None, at: ArrayLike | None = None, turning: float = 0.0,
    ) -> Rolling:
        """Let a body roll on a plane of space without slip: one constraint, two on velocities.

        They are ``name: height``, and ``name: slip 1`` and ``slip 2`` along two tangents of the
        plane. A position and a velocity that are not given follow from them. The force of the
        plane on the body is −λ along the normal, with λ of the height in ``run.multipliers``, and
        −μ along the tangents, with μ in ``run.reactions``; one that pulls, λ > 0, is not refused.

        Parameters
        ----------
        disc, sphere : float, optional
            Radius in m of a thin disc with a sharp rim, or of a sphere.
        ellipsoid : three floats, optional
            Semi-axes in m, along the body axes. One of the three shapes has to be given.
        on_body : three floats, optional
            The middle of the shape in body axes; by default the body's origin.
        axis_on_body : three floats, optional
            The axis of a disc in body axes, by default the third one.
        normal, at : three floats, optional
            Normal of the plane, towards the body, and a point of it, in space; by default
            (0, 0, 1) and the origin.
        turning : float
            Angular velocity in rad/s at which the plane turns about its normal through ``at``.

        Raises
        ------
        InputError
            From ``model()``, if the body starts off the plane.
        """
        shapes = {key: e for key, e in (("disc", disc), ("sphere", sphere),
                                        ("ellipsoid", ellipsoid)) if e is not None}
        if len(shapes) != 1:
            raise InputError(f"{name!r} has {' and '.join(shapes) or 'no shape'}; give one of "
                             "disc, sphere and ellipsoid.")
        ((shape, size),) = shapes.items()
        # a point mass has no attitude, so it cannot roll
        roller = self._components.body(body, shown(name))
        if isinstance(roller, Particle):
            raise InputError(f"{name!r} asks for axes of {roller.name!r}, a point mass, which "
                             "has none; give a body.")
        label = f"{shape} of {name!r}"
        sizes = finite(label, size, (3,) if shape == "ellipsoid" else ()).reshape(-1).tolist()
        return self._join(Rolling(
            name, GROUND, roller, shape=shape, sizes=tuple(positive(label, x) for x in sizes),
            axis=_direction(name, "axis_on_body", (0, 0, 1) if axis_on_body is None
                            else axis_on_body),
            middle=vector(f"on_body of {name!r}", (0, 0, 0) if on_body is None else on_body),
            normal=_direction(name, "normal", (0, 0, 1) if normal is None else normal),
            at=vector(f"at of {name!r}", (0, 0, 0) if at is None else at),
            turning=float(finite(f"turning of {name!r} in rad/s", turning, shape=()))))

    def rod(
        self, name: str, a: Frame | str, b: Frame | str, *, on_a: ArrayLike = (0.0, 0.0, 0.0),
        on_b: ArrayLike = (0.0, 0.0, 0.0), length: float | None = None,
    ) -> Rod:
        """Keep two points at a distance: one constraint.

        It is ``length`` in m, by default their distance at the start; ``on_a`` and ``on_b`` are in
        body axes.
        """
        if length is not None:
            length = positive(f"length of {name!r}", length)
        return self._join(Rod(
            name, *self._components.frames(name, a, b), *self._points(name, (a, b), (on_a, on_b)),
            length=length))

    def spring(
        self, name: str, a: Frame | str, b: Frame | str, *, stiffness: float, length: float = 0.0,
        on_a: ArrayLike = (0.0, 0.0, 0.0), on_b: ArrayLike = (0.0, 0.0, 0.0),
        damping: float = 0.0,
    ) -> Spring:
        """Add V = ½ k (|d| − l)² between a point of a and a point of b (body axes; N/m, m).

        With ``damping`` c ≥ 0, in N s/m, a parallel damper with force c d|d|/dt.
        """
        return self._join(Spring(
            name, *self._components.frames(name, a, b), *self._points(name, (a, b), (on_a, on_b)),
            stiffness=float(finite(f"stiffness of {name!r}", stiffness, shape=())),
            length=non_negative(f"length of {name!r}", length),
            damping=non_negative(f"damping of {name!r}", damping),
        ))

    def gear(
        self, name: str, first: Connection | str, second: Connection | str, *,
        teeth: tuple[int, int],
    ) -> Gear:
        """Let two joints turn as gears in mesh: one constraint, ``name: mesh``.

        z₁ θ₁ + z₂ θ₂ is constant, for any number of turns, of hinges and of flywheels. ``teeth``
        are z₁ and z₂; for a ring gear, whose teeth are inside, with a minus.
        """
        counts = [as_integer(z) for z in np.ravel(np.asarray(teeth, dtype=object)).tolist()]
        if len(counts) != 2 or not all(counts):
            raise InputError(f"The teeth of {name!r} are {shown(teeth)}; give two whole numbers "
                             "other than 0.")
        # as 34 and 86 mesh like 17 and 43; no count is None here, which type checkers do not see
        whole_numbers = [int(z or 0) for z in counts]
        z1, z2 = (z // math.gcd(*whole_numbers) for z in whole_numbers)
        joint1, joint2 = (self._components.turning_joint(f"Gear {name!r}", joint)
                          for joint in (first, second))
        return self._join(Gear(name, joint1.b, joint2.b, joints=(joint1, joint2), teeth=(z1, z2)))

    def couple(
        self, name: str, first: Connection | str, second: Connection | str, *,
        ratio: float = 1.0, offset: float = 0.0,
    ) -> Coupling:
        """Let the second joint's coordinate be ratio × the first's + offset: one constraint.

        Coordinates are the angle of a joint that turns and the travel of one that slides, as a
        cylindrical one and a screw do (rad, m).
        Angles in a ratio of small whole numbers are coupled over any number of turns. Any other
        coupling of an angle holds within the range that ``angle`` has.
        """
        joint1, joint2 = (self._components.joint(joint, f"{name!r}") for joint in (first, second))
        return self._join(Coupling(
            name, joint1.b, joint2.b, joints=(joint1, joint2),
            quantities=(_coordinate(joint1), _coordinate(joint2)),
            ratio=float(finite(f"ratio of {name!r}", ratio, shape=())),
            offset=float(finite(f"offset of {name!r}", offset, shape=()))))

    def flywheel(
        self, name: str, joint: Connection | str, *, inertia: float, ratio: float = 1.0
    ) -> Flywheel | BallFlywheel:
        """Have a joint turn a flywheel, T = p²/(2a): one coordinate, one constraint ``ratio``.

        A ball joint turns it about any axis, T = ½ a |ω|² of its relative angular velocity: four
        coordinates, four constraints, ratio 1.

        What robots have as rotor inertia, and MuJoCo as ``armature``: a n² is added to the joint's
        entry of the mass matrix. Its axis turns with no body, so that it has no gyroscopic effect,
        which a ``rotor`` with ``couple`` has.

        Parameters
        ----------
        joint : joint
            A joint with an angle or a travel, or a ball joint.
        inertia : float
            a in kg m², or in kg where the joint slides and ``ratio`` is 1.
        ratio : float
            n, how many times it turns while the joint turns once; rad/m on a joint that slides.

        Returns
        -------
        Flywheel
            A joint whose ``angle`` or ``travel`` is n times the joint's, over any number of turns;
            motors and springs may act on it. The flywheel of a ball joint has no angle.

        Raises
        ------
        InputError
            For names used twice, an inertia that is not above 0, a ratio 0, and other ratios than
            1 on a ball.
        """
        driver = self._components.joint(joint, f"Flywheel {name!r}")
        if type(driver) is Joint:
            if ratio != 1:
                raise InputError(f"Flywheel {name!r} is on the ball joint {driver.name!r} with the "
                                 f"ratio {shown(ratio)}; leave the ratio out, or scale the "
                                 "inertia by its square.")
            # |ω|² = 4 |ż|², so that T = ½ (4 a) |ż|²
            quaternion = self._flywheel_body(name, inertia, factor=4.0, indices="0123")
            return self._join(BallFlywheel(name, driver.b, quaternion, joints=(driver,)))
        kind = _coordinate(driver)
        if not isinstance(driver, Align | HingedJoint):
            raise InputError(f"Flywheel {name!r} is on {driver.name!r}, which is no joint of "
                             "bodies with an axis; name one.")
        n = nonzero(f"ratio of {name!r}", ratio)
        body = self._flywheel_body(name, inertia)
        return self._join(Flywheel(name, driver.b, body, joints=(driver,), kind=kind, ratio=n))

    def chain(
        self, name: str, a: Frame | str, b: Frame | str, joints: Iterable[Mapping[str, Any]]
    ) -> Chain:
        """Join a and b by joints in a row without bodies between them: six constraints.

        Each joint is a coordinate with an inertia of its own, as ``flywheel`` has: without bodies
        between, nothing else would say how fast it may begin to move.

        Parameters
        ----------
        a, b : Body, ``ground``, or a name
        joints : iterable of mappings
            From a to b: ``name``, by which motors, springs, ``angle`` and ``travel`` know it;
            ``axis`` in space at the start; ``inertia`` in kg m², kg for a slide; ``at``, a point
            of the axis of a hinge in space at the start; ``angle`` and ``rate`` of a hinge, or
            ``travel`` and ``speed`` of a slide, at the start, one of which makes it a hinge or a
            slide; angles and travels move the bodies beyond, as those of ``revolute`` do.

        Raises
        ------
        InputError
            For a joint without a name, an axis or an inertia, for other keys, and for more than 6
            joints.
        """
        frame_a, frame_b = self._components.frames(name, a, b)
        links = [self._chain_link(name, frame_a, joint) for joint in as_items(
            "joints", joints, "mappings")]
        hinges = [link for link in links if link.coordinate.kind == "angle"]
        if not 1 <= len(links) <= 6:
            raise InputError(f"Chain {name!r} has {count_text(len(links), 'joint')}; give 1 to 6.")
        for link in links:
            self._join(link.coordinate)
        # the point of b on the axis of the last hinge, which then leaves it where it is
        point = hinges[-1].at if hinges else np.zeros(3)
        return self._join(Chain(
            name, frame_a, frame_b, on_a=None, on_b=None, at=point, links=links))

    def _chain_link(self, chain: str, a: Frame, description: Any) -> Link:
        """Return one joint of a chain from its keys: a coordinate, its axis and its point.

        "travel" or "speed" makes it a slide; any other joint is a hinge. ``a`` is the frame at
        which the chain begins.
        """
        keys = as_mapping(f"joints of {chain!r}", description, "{'name': 'hip', 'axis': (1, 0, 0)}")
        name = as_text(f"name of a joint of {chain!r}", keys.get("name"))
        kind, rate = ("travel", "speed") if {"travel", "speed"} & keys.keys() else ("angle", "rate")
        for key in keys:
            choose(f"key of {name!r} in chain {chain!r}", key,
                   ("name", "axis", "inertia", "at", kind, rate))
        if "axis" not in keys or "inertia" not in keys:
            raise InputError(f"Joint {name!r} of chain {chain!r} needs an axis and an inertia; "
                             "give both.")
        axis = _direction(name, "axis", keys["axis"])
        point = vector(f"at of {name!r}", keys.get("at", (0.0, 0.0, 0.0)))
        # T = p²/(2 a) of the coordinate itself, as of a flywheel
        body = self._flywheel_body(name, keys["inertia"])
        value, start_value = self._value(_number_or_none(f"{kind} of {name!r}", keys.get(kind)))
        return Link(Coordinate(
            name, a, body, kind=kind, value=value, start_value=start_value,
            speed=_number_or_none(f"{rate} of {name!r}", keys.get(rate))), axis, point)

    def _flywheel_body(
        self, name: str, inertia: float, factor: float = 1.0, indices: Sequence[str] = ("",)
    ) -> FlywheelBody:
        """Return the body of a flywheel: a coordinate for each of ``indices``, T = p²/(2 a).

        a is ``factor`` times the inertia: a ball has four coordinates with a = 4 inertia.
        """
        body = FlywheelBody.of(name, indices)
        self._components.claim(body.name, "body")
        # a "mass", for the coordinates are those of a point
        self._components.values[str(body.mass)] = factor * positive(f"inertia of {name!r}", inertia)
        zero = np.zeros(len(indices))
        self._components.bodies[body] = InitialState(
            q=np.array([1.0, 0, 0, 0]), x=zero, v=zero, omega=np.zeros(3))
        return body

    def law(self, name: str, joints: Iterable[Connection | str], f: Callable[..., Any]) -> Law:
        """Let f(c₁, c₂, …) of the coordinates of joints be 0: one constraint, ``name: law``.

        Coordinates are the angle of a joint that turns, in rad, within the range that ``angle``
        has, and the travel of one that slides, as a cylindrical one and a screw do, in m; f returns
        an expression of them, ``time`` and parameters.

        Raises
        ------
        InputError
            For joints without a coordinate, and an f that returns no expression.
        """
        measured_joints = [self._components.joint(joint, f"Law {name!r}")
                           for joint in as_items("joints", joints, "joints")]
        if not measured_joints or not callable(f):
            raise InputError(f"Law {name!r} needs joints and a function of their coordinates, such "
                             "as lambda x, y: x - y**2.")
        # stand for the coordinates, whose expressions are known only when the model is made
        symbols = [sp.Dummy(f"{name}_c{k}", real=True) for k in range(len(measured_joints))]
        try:
            expression = as_expression(f(*symbols))
        except TypeError as error:
            raise InputError(f"The function of law {name!r} fails: {error}; let it take "
                             f"{count_text(len(measured_joints), 'coordinate')}.") from None
        if not expression.free_symbols & {*symbols}:
            raise InputError(f"Law {name!r} is {shown(str(expression))}, without a coordinate; "
                             "return what is to be 0.")
        return self._join(Law(
            name, measured_joints[0].b, measured_joints[-1].b, joints=tuple(measured_joints),
            coordinates=tuple(symbols),
            quantities=tuple(map(_coordinate, measured_joints)), expression=expression))

    def drive(self, name: str, joint: Connection | str, *, angle: Any) -> RheonomicConstraint:
        """Have the angle of a hinge be a law of t: one constraint, ``name: angle``.

        Parameters
        ----------
        joint : a joint with an angle, such as ``revolute``, a flywheel on it, or its name
        angle : expression of ``time`` and parameters
            φ = f(t) of the second body against the first about the axis, in rad. f(0) is the
            joint's angle and f'(0) its rate at the start, and a screw has the travel
            f(0) · lead/2π; the law moves no body to there. The multiplier is the torque about the
            axis, in N m, that the drive exerts on the second body, as a motor does, and its
            opposite on the first; ``trajectory.joint(name).torque()`` has it in space axes. The
            angle of a flywheel is ``ratio`` times that of its joint, which is driven.

        Raises
        ------
        InputError
            If the law has no finite value or rate at t = 0, or the joint starts at another rate
            or angle.
        """
        hinge_joint = self._components.turning_joint(f"Drive {name!r}", joint)
        if isinstance(hinge_joint, Flywheel):
            # its angle is ratio times that of its joint, which is driven in its place
            angle = as_expression(angle) / hinge_joint.ratio
            hinge_joint = hinge_joint.joints[0]
        if isinstance(hinge_joint, Coordinate):
            raise InputError(f"The drive {name!r} needs a joint of bodies, and "
                             f"{hinge_joint.name!r} is one of a chain; name another joint, or "
                             "write a motor.")
        law = self._law(f"angle of {name!r}", angle)
        begin, rate = self._components.initial_value_and_rate(f"angle of {name!r}", law)
        # at t = 0 the joint has the angle and the rate of the law
        hinge = hinge_of(hinge_joint)
        _refuse_other_start(name, hinge_joint, begin, rate)
        hinge.rate = rate
        # a joint described without an angle has the angle of the law: no body moves
        if hinge.start_angle is None:
            hinge.angle = begin
            if isinstance(hinge_joint, Screw):
                hinge_joint.travel = begin * hinge_joint.lead / (2 * math.pi)
        return self._join(RheonomicConstraint(
            name, hinge_joint.a, hinge_joint.b, joints=(hinge_joint,), law=law))

    # ------------------------------------------------------------ forces, parameters and quantities

    def parameter(self, name: str, value: float, *, positive: bool = False) -> sp.Symbol:
        """Return a symbol for potentials, forces and quantities, with its value.

        With ``positive`` SymPy simplifies expressions for a symbol above 0, and other values are
        refused.
        """
        self._components.claim(name, "parameter")
        domain = {"positive": True} if as_flag("positive", positive) else {"real": True}
        number = float(finite(f"parameter {name!r}", value, shape=()))
        if positive and number <= 0:
            raise InputError(f"The parameter {name!r} is {number:g} and declared positive=True; "
                             "leave that out where 0 or less is meant.")
        self._components.values[name] = number
        self._components.symbols[name] = sp.Symbol(name, **domain)
        return self._components.symbols[name]

    def input(self, name: str, value: float = 0.0) -> sp.Symbol:
        """Return a symbol for forces, torques and motors whose value may change in each step.

        The output of a controller is one; ``value`` is the default.
        """
        self._components.inputs.append(self.parameter(name, value))
        return self._components.inputs[-1]

    def potential(self, expression: Any) -> None:
        """Add to H: an expression in symbols of the bodies and of ``parameter``.

        It may contain momenta, as −n·l does for axes that turn at n.
        """
        self._components.potentials.append(as_expression(expression))

    def force(
        self, body: Body | str, force: Sequence[Any], *, on_body: ArrayLike | None = None
    ) -> None:
        """Let a force (in space axes, N) act at a point of a body, or of the body of that name.

        By default it acts at the body's origin. Its components are expressions of the bodies'
        symbols, momenta, ``time`` and parameters.
        """
        loaded_body = self._components.body(body, "A force")
        F = three_expressions(f"force on {loaded_body.name!r}", force)
        r = self._point(f"point of the force on {loaded_body.name!r}", body, on_body)
        self._components.forces += loaded_body.force_at([0, 0, 0] if r is None else r.tolist(), F)

    def torque(self, body: Body | str, torque: Sequence[Any]) -> None:
        """Let a torque (in body axes, N m) act on a body, as expressions like a force's.

        For a top it is taken about the fixed point.
        """
        loaded_body = self._components.body(body, "A torque")
        if isinstance(loaded_body, Particle):
            raise InputError(f"A torque on {loaded_body.name!r}, a point mass, turns nothing; give "
                             "a force, or a body.")
        self._components.forces += loaded_body.torque_on(
            three_expressions(f"torque on {loaded_body.name!r}", torque))

    def motor(
        self, name: str, joint: Connection | str, *, torque: Any = None, force: Any = None
    ) -> Motor:
        """Add a motor: a torque about the axis of a joint (N m), or a force along it (N).

        Either is a number, or an expression of ``time``, parameters, symbols of bodies, and
        ``angle(joint)``, ``rate(joint)``, …. It acts on the joint's second body, and its opposite
        on the first.
        """
        quantity, effort = ("travel", force) if torque is None else ("angle", torque)
        if effort is None or (torque is not None and force is not None):
            raise InputError(f"Motor {name!r} needs a torque or a force, one of them.")
        driven = self._components.joint(joint, f"Motor {name!r}")
        self._components.refuse_measure(driven, quantity)
        return self._join(Motor(name, driven.a, driven.b, joints=(driven,), quantity=quantity,
                                effort=as_expression(effort)))

    def joint_spring(
        self, name: str, joint: Connection | str, *, stiffness: float | None = None,
        damping: float | None = None, rest: float | tuple[float, float] | None = None,
        coordinate: CoordinateName | None = None,
    ) -> JointSpring:
        """Add V = ½ k (c − rest)² of a joint's coordinate c, and a damper.

        c is the travel of a joint that slides, as cylindrical ones and screws do, unless
        ``coordinate`` is "angle", and the angle of others. One of ``stiffness`` k and ``damping`` ≥
        0 is given, or both, in N m/rad and N m s/rad about an axis, N/m and N s/m along one;
        ``rest``, by default 0, goes with a stiffness. Where it is an interval, (lower, upper), the
        spring is slack in it and pushes back from beyond: elastic ends of the range of a joint. The
        force is continuous and its slope is not, so that a step across an end has an error of
        O(Δt²), with any scheme.
        """
        if stiffness is None and (damping is None or rest is not None):
            raise InputError(f"Spring {name!r} has no stiffness; give one, or damping alone.")
        spring_joint = self._components.joint(joint, f"Spring {name!r}")
        quantity = _coordinate(spring_joint, coordinate)
        return self._join(JointSpring(
            name, spring_joint.a, spring_joint.b, joints=(spring_joint,), quantity=quantity,
            coordinate=self._measure(spring_joint, quantity),
            rate=self._measure(spring_joint, RATE_OF[quantity]),
            stiffness=_number_or_none(f"stiffness of {name!r}", stiffness) or 0.0,
            damping=non_negative(f"damping of {name!r}", 0.0 if damping is None else damping),
            rest=_rest(f"rest of {name!r}", 0.0 if rest is None else rest)))

    def contact(
        self, name: str, a: Frame | str | None = None, b: Frame | str = GROUND, *,
        gap: Any = None, on_a: ArrayLike = _ORIGIN, on_b: ArrayLike = _ORIGIN,
        normal: ArrayLike | None = None, radius: ArrayLike = 0.0, box: ArrayLike | None = None,
        restitution: Any = 1.0,
    ) -> tuple[Impact, ...]:
        """Let momenta jump where a gap φ ≥ 0 closes, by Newton's law (``gyrospark.Impact``).

            φ = R_b n · d − ϱ            a point or sphere of a, and a plane of b
            φ = |d| − ϱ_a − ϱ_b          two spheres,   d = x_a + R_a r_a − x_b − R_b r_b

        Runs of the model have these impacts: ``run.impacts[name]``. They are frictionless.

        Parameters
        ----------
        a, b : Body, ``ground``, a moving point or a name
            The bodies; a plane of the ground may move, ``moving_point``. None with ``gap``.
        gap : expression, or several
            φ in m, of coordinates, ``time`` and parameters, in place of bodies.
        on_a : array_like, shape (3,) or (N, 3)
            Points r_a, or centres of spheres, in axes of a; of N points each has a gap of its own,
            ``NAME_1`` … ``NAME_N``.
        on_b : array_like, shape (3,)
            A point r_b of the plane, or the centre of the sphere, in axes of b.
        normal : array_like, shape (3,), optional
            n in axes of b, towards a, in any length; by default (0, 0, 1) on the ground. Without
            it a body b is a sphere.
        radius : float or two floats
            ϱ in m; of two spheres of both, or one of each.
        box : array_like, shape (3,), optional
            Half the edges of a box about ``on_a``, along the axes of a: its corners are the points.
        restitution : number or parameter
            e, from 0 (plastic) to 1 (elastic).

        Returns
        -------
        tuple of Impact
            One of each gap.

        Raises
        ------
        InputError
            For bodies or shapes beside a gap, or neither; for a restitution outside of [0, 1].
        """
        if (gap is None) == (a is None):
            raise InputError(f"{name!r} has {'a gap and a body' if a else 'neither bodies nor gap'}"
                             "; give gap=, or the bodies that touch.")
        if a is None:
            _refuse_shapes_beside_gap(name, b=b is not GROUND, on_a=on_a is not _ORIGIN,
                                      on_b=on_b is not _ORIGIN, normal=normal is not None,
                                      radius=not (is_number(radius) and radius == 0),
                                      box=box is not None)
            is_list = isinstance(gap, Sequence) and not isinstance(gap, str)
            return self._contact(
                name, [as_expression(e) for e in (gap if is_list else [gap])], restitution)
        frames = self._components.frames(name, a, b)
        # points at an end of a beam are given from there: ``on`` is the end in its segment's axes
        end_a, end_b = (end.on if end else 0.0 for end in map(self._components.end, (a, b)))
        points_a = points_of(name, on_a, box) + end_a
        point_b = vector(f"on_b of {name!r}", on_b) + end_b
        # a point mass has no points beside its own
        _refuse_other_points(f"{'on_a' if box is None else 'box'} of {name!r}", frames[0], points_a,
                             on_a if box is None else box)
        _refuse_other_points(f"on_b of {name!r}", frames[1], point_b, on_b)
        if normal is not None and isinstance(frames[1], Particle):
            raise InputError(f"The normal of {name!r} asks for axes of {frames[1].name!r}, a point "
                             "mass, which has none; give radius= of two spheres, or a body.")
        if normal is None and frames[1] is GROUND:
            normal = (0.0, 0.0, 1.0)
        values = self._components.values
        gaps = (gaps_of_spheres(name, frames, points_a, point_b, radius, values)
                if normal is None else
                gaps_of_plane(name, frames, points_a, point_b, normal, radius, values))
        return self._contact(name, gaps, restitution)

    def latch(
        self, name: str, a: Frame | str | None = None, b: Frame | str = GROUND, *,
        close: Connection | str | Iterable[Connection | str], **gap: Any,
    ) -> tuple[Impact, ...]:
        """End runs where a gap closes, after which joints hold.

        The joints are open, and left out, until ``model(closed=name, start=run[-1])`` returns the
        model in which they are closed: the momenta are projected onto its constraints, in the
        metric of H_pp, which is the plastic impact. ``model(start=run[-1])`` opens them again.

        Parameters
        ----------
        a, b, **gap
            As of ``contact``, without a restitution.
        close : joint, or several
            Their points are given by ``on_a`` and ``on_b``; their axes are those at the start.

        Raises
        ------
        InputError
            As ``contact``, and for an unknown joint.
        """
        closing = [close] if isinstance(close, Connection | str) else as_items(
            "close", close, "joints")
        joints = [self._components.joint(joint, f"Latch {name!r}") for joint in closing]
        if "restitution" in gap:
            raise InputError(f"Latch {name!r} has a restitution, and closes; leave it out.")
        impacts = tuple(replace(impact, restitution=0.0, terminal=True)
                        for impact in self.contact(name, a, b, **gap))
        self._components.contacts[name] = impacts
        self._components.latches[name] = joints
        return impacts

    def stop(
        self, name: str, joint: Connection | str, *, lower: float | None = None,
        upper: float | None = None, restitution: Any = 1.0,
        coordinate: CoordinateName | None = None,
    ) -> tuple[Impact, ...]:
        """End the range of a joint, whose angle (rad) or travel (m) rebounds, as in ``contact``.

        It is the travel if the joint slides, as a cylindrical one and a screw do, unless
        ``coordinate`` is "angle". With both ends the gaps are ``NAME_lower`` and ``NAME_upper``.
        """
        link = self._components.joint(joint, f"Stop {name!r}")
        measured = self._measure(link, _coordinate(link, coordinate))
        bounds = {key: float(finite(f"{key} of {name!r}", end, shape=())) for key, end in (
            ("lower", lower), ("upper", upper)) if end is not None}
        if not bounds or (len(bounds) == 2 and bounds["lower"] >= bounds["upper"]):
            raise InputError(f"Stop {name!r} has lower = {lower} and upper = {upper}; give one of "
                             "them, or a lower end below the upper one.")
        # φ = c − lower ≥ 0 and φ = upper − c ≥ 0
        signs = {"lower": 1, "upper": -1}
        gaps = [signs[key] * (measured - named_number(f"{name}_at_{key}", end,
                                                        self._components.values))
                for key, end in bounds.items()]
        return self._contact(name, gaps, restitution, [*bounds])

    def moving_point(self, name: str, path: Sequence[Any]) -> MovingPoint:
        """Return a moving point of the ground, for joints, rods and springs.

        Parameters
        ----------
        name : str
            Joints may name it.
        path : three expressions
            Where in space it is, m: of ``time`` and parameters. At t = 0 bodies that follow from
            it begin there, with its velocity.
        """
        self._components.claim(name, "body")
        x, y, z = (self._law(f"path of {name!r}", e) for e in three_expressions(
            f"path of {name!r}", path))
        point = MovingPoint(name, (x, y, z), three_expressions(
            f"velocity of {name!r}", [derivative(e, TIME) for e in (x, y, z)]))
        # refuses a path without a finite place and velocity at t = 0
        self._components.start_of_point(point)
        self._components.moving_points.append(point)
        return point

    def quantity(self, name: str, expression: Any) -> None:
        """Have an expression computed along trajectories under a name.

        Warns if it is 0, such as a derivative of ``rate(joint)`` by ``time``: symbols of bodies
        and joints do not depend on ``time``. Raises InputError for a name used twice.
        """
        as_text("name of a quantity", name)
        checked = as_expression(expression)
        if checked == 0:
            warn(f"Quantity {shown(name)} is 0 at all times. The symbols of bodies and joints do "
                 "not depend on build.time, so that their derivatives by it are 0.")
        if name in (impact.quantity for impact in self._components.impacts):
            raise InputError(f"Quantity {name!r} is a gap in Multibody {self.name!r}; choose "
                             "another name.")
        if name in self._components.quantities:
            raise InputError(f"Quantity {name!r} is in Multibody {self.name!r} already; choose "
                             "another name.")
        self._components.quantities[name] = checked

    def time_scale(self, expression: Any) -> None:
        """Scale time, dt = σ dτ: constant steps Δτ are then steps of t that adapt to the motion.

        σ is a positive expression of the symbols of bodies and joints, momenta, ``time`` and
        parameters, such as ``gyrospark.scales.rates`` returns.
        """
        if self._components.time_scale is not None:
            raise InputError(f"Multibody {self.name!r} has a time scale already; give one "
                             "expression, such as rates(...) of all rates.")
        self._components.time_scale = as_expression(expression)

    # ------------------------------------------------------------ measures of joints

    def angle(self, joint: Connection | str) -> sp.Symbol:
        """Return the symbol of the angle of a joint in forces, potentials and quantities, in rad.

        It is followed for two turns to either side of the start; a screw's, 2π times its travel by
        its lead, without limit.
        """
        return self._measure(joint, "angle")

    def rate(self, joint: Connection | str) -> sp.Symbol:
        """Return the symbol of the rate of a joint's angle, in rad/s."""
        return self._measure(joint, "rate")

    def travel(self, joint: Connection | str) -> sp.Symbol:
        """Return the symbol of the travel along a joint's axis, in m."""
        return self._measure(joint, "travel")

    def speed(self, joint: Connection | str) -> sp.Symbol:
        """Return the symbol of the speed along a joint's axis, in m/s."""
        return self._measure(joint, "speed")

    def measured(self, taken: Collection[str] = ()) -> dict[str, dict[str, sp.Symbol]]:
        """Return measure → name → symbol of all measures of all joints.

        Names are JOINT_MEASURE; those that are in ``taken`` are left out.
        """
        symbols: dict[str, dict[str, sp.Symbol]] = {}
        for link in self._components.connections:
            for quantity in link.MEASURES:
                if f"{link.name}_{quantity}" not in taken:
                    names = symbols.setdefault(quantity, {})
                    names[f"{link.name}_{quantity}"] = self._measure(link, quantity)
        return symbols

    def visual(self, body: Frame | str, shape: Shape) -> None:
        """Draw a body, or the ground, with a shape; it moves nothing.

        Parameters
        ----------
        body : Body, Frame or str
            The body whose axes the shape is given in, or ``ground``. It is drawn with all shapes
            that it is given, instead of a solid of equal inertia.
        shape : Shape

        Raises
        ------
        InputError
            For an unknown body, and a value that is no ``gyrospark.Shape``.
        """
        if not isinstance(shape, Shape):
            raise InputError(f"shape = {shown(shape)} is no shape; give a gyrospark.Shape.")
        frame = self._components.frame(body, "a visual")
        # "" is the ground, which has no name
        self._visuals.setdefault(getattr(frame, "name", ""), []).append(shape)

    # ------------------------------------------------------------ the model

    def model(
        self, *, without: Iterable[str] = (),
        redundant: Literal["refuse", "leave out"] = "refuse",
        closed: str | Iterable[str] = (), start: HasStart | None = None,
    ) -> Model:
        """Return the model: system, parameters, and a consistent state at t = 0.

        Parameters
        ----------
        without : iterable of str
            Names of constraints to leave out because others imply them, such as ``"hinge: z"``.
        redundant : {"refuse", "leave out"}
            What to do with constraints that others imply; ``redundancy`` names them.
        closed : iterable of str
            Names of latches that are closed.
        start : Start, model or row of a run, optional
            The state to start from, of the same bodies, where latches close or open, its
            parameters, which become the model's, and its time t, at which constraints are
            evaluated. The model's own start is at t = 0: runs go on from
            ``model.start.replace(t=t)``.

        Raises
        ------
        InputError
            For constraints that depend on each other, with their names and a smallest set to
            leave out; for a start that cannot meet them.
        """
        if not self._components.bodies:
            raise InputError(f"Multibody {self.name!r} has no body; add one with body(...).")
        choose("redundant", redundant, ("refuse", "leave out"))
        left_out = {without} if isinstance(without, str) else {
            as_text("a constraint to leave out", name)
            for name in as_items("without", without, "constraints' names", is_ordered=False)}
        latches = self._closed_latches(closed)
        assembly = Assembly(self._components, left_out, latches)
        # a given start takes the place of the described one, before latches project its momenta
        t = 0.0 if start is None else _begin_at(assembly, start)
        assembly.warn_of_sizes()
        if latches or start is not None:
            assembly.refuse_open(t)
        self._redundancy = assembly.redundancy(t)
        if redundant == "refuse":
            self._redundancy.refuse('; redundant="leave out" does so')
        system, store = assembly.make_system(self._redundancy.left_out), assembly.store
        numbers = NumericSystem(system, store, t)
        self._start = assembly.closed_state(numbers) if latches or start is not None else (
            assembly.consistent_state(numbers))
        bodies = {str(body.weight): moments for body, moments in self._components.inertia.items()}
        # the gaps of a latch that is closed are constraints now, and have no impacts
        return Model(system, store, self._start.q, self._start.p, bodies, visuals=self._visuals,
                     events=[impact for name, impacts in self._components.contacts.items()
                             if name not in latches for impact in impacts], **self._about)

    # ------------------------------------------------------------ inside

    def _closed_latches(self, closed: str | Iterable[str]) -> list[str]:
        """Return the names of closed latches as a list; refuse names of no latch."""
        latches = [closed] if isinstance(closed, str) else as_items("closed", closed, "latches")
        if latches and not self._components.latches:
            raise InputError(f"closed = {shown(closed)} names a latch, and Multibody "
                             f"{self.name!r} has none; add one with latch(...).")
        for latch in latches:
            choose("latch", latch, self._components.latches)
        return latches

    def _join(self, link: Joined) -> Joined:
        """Add a connection; refuse a name in use, and a joint that needs axes of a point mass."""
        point = next((frame for frame in link.frames if isinstance(frame, Particle)), None)
        if point is not None and type(link) not in (Joint, Rod, Spring) and (
                not isinstance(point, FlywheelBody)):
            raise InputError(f"{link.name!r} asks for axes of {point.name!r}, a point mass, which "
                             "has none; join it by a ball, a rod or a spring, or give a body.")
        self._components.claim(link.name, "joint")
        self._components.connections.append(link)
        if self._describes_start:
            self._components.placed.add(link)
        return link

    def _contact(
        self, name: str, gaps: Sequence[sp.Expr], restitution: Any,
        labels: Sequence[str] | None = None,
    ) -> tuple[Impact, ...]:
        """Add gaps φ as quantities, and return their impacts.

        They are called NAME if there is one gap, NAME_LABEL with ``labels``, else NAME_1, ….
        ``restitution`` is a number, a parameter's symbol or its name.
        """
        self._components.claim(name, "joint")
        e = str(restitution) if isinstance(restitution, sp.Symbol) else restitution
        if isinstance(e, str) and not (e in self._components.symbols
                                       and e in self._components.values):
            raise InputError(f"The restitution of {name!r} is {e!r}, which is no parameter; give a "
                             "number, or what parameter(name, value) returns.")
        keys = labels or range(1, len(gaps) + 1)
        impacts = tuple(Impact(name if len(gaps) == 1 else f"{name}_{key}", e) for key in keys)
        for impact, gap in zip(impacts, gaps, strict=True):
            if impact.quantity in self._components.quantities:
                raise InputError(f"Gap {impact.quantity!r} is a quantity in Multibody "
                                 f"{self.name!r} already; choose another name.")
            self.quantity(impact.quantity, gap)
        self._components.contacts[name] = impacts
        return impacts

    def _pair(
        self, name: str, a: Frame | str, b: Frame | str, at: Any, on_a: Any, on_b: Any
    ) -> dict[str, Any]:
        """Return the arguments a, b, on_a, on_b and at of a joint with a common point, by name.

        A joint at an end of a beam for which no point is given is where that end is at the start.
        """
        frame_a, frame_b = self._components.frames(name, a, b)
        point_a, point_b = self._points(name, (a, b), (on_a, on_b))
        end = self._components.end(a) or self._components.end(b)
        if end and at is None and on_a is None and on_b is None:
            at = end.at
        return {"a": frame_a, "b": frame_b, "on_a": point_a, "on_b": point_b,
                "at": optional_vector(f"at of {name!r}", at)}

    def _points(
        self, name: str, frames: Sequence[Frame | str], points: Sequence[Any]
    ) -> tuple[Array | None, Array | None]:
        """Return the points of a connection in the axes of its two frames; None where none is."""
        on_a, on_b = (self._point(f"{label} of {name!r}", frame, r) for label, frame, r in
                      zip(("on_a", "on_b"), frames, points, strict=True))
        return on_a, on_b

    def _point(self, label: str, frame: Frame | str, entry: Any) -> Array | None:
        """Return a point in the axes of a body; at an end of a beam, ``entry`` is from that end.

        A point mass has one point, 0 in its axes.
        """
        r, end = optional_vector(label, entry), self._components.end(frame)
        if end is None:
            if isinstance(body := self._components.frame(frame, label), Particle):
                _refuse_other_points(label, body, np.zeros(3) if r is None else r, entry)
                return np.zeros(3)
            return r
        return end.on if r is None else end.on + r

    def _hinge(
        self, name: str, a: Frame | str, b: Frame | str, axes: Axes, rate: float | None = None,
        angle: float | None = None,
    ) -> Align:
        """Return the hinge of a joint: its axis, and its angle and rate if they are given.

        ``axes`` has the arguments axis, axis_on_body and axis_in_space; ``angle`` is in rad.
        """
        frame_a, frame_b = self._components.frames(name, a, b)
        described, start = self._value(_number_or_none(f"angle of {name!r} in rad", angle))
        if start is not None:
            warn_of_degrees(f"The angle of {name!r}", [start],
                            cure=f'{math.radians(start):.6g}, or "{start:g} deg" in a file')
        return Align(name, frame_a, frame_b, self._axis(name, frame_a, frame_b, axes),
                     _number_or_none(f"rate of {name!r} in rad/s", rate), described, start)

    def _travel(self, name: str, travel: float | None) -> dict[str, Any]:
        """Return the arguments ``travel`` and ``start_travel`` of a joint that slides."""
        described, start = self._value(_number_or_none(f"travel of {name!r}", travel))
        return {"travel": described, "start_travel": start}

    def _value(self, value: float | None) -> tuple[float, float | None]:
        """Return (coordinate of a joint in the described pose, coordinate given for the start).

        A robot's file describes its bodies at the start, with all angles and travels. Elsewhere
        the description has coordinates 0, and given ones move the bodies from there.
        """
        return (value or 0.0, None) if self._describes_start else (0.0, value)

    def _axis(self, name: str, a: Frame, b: Frame, axes: Axes) -> Array:
        """Return the unit vector of an axis in space at the start.

        ``axes`` has the arguments axis, axis_on_body and axis_in_space, of which one is given.
        ``axis`` is in space, too, but a user may mean components on the body: a warning is given
        if these differ.
        """
        entries = {key: e for key, e in zip(AXES, axes, strict=True) if e is not None}
        if len(entries) != 1:
            raise InputError(f"{name!r} has {' and '.join(entries) or 'no axis'}; give one of "
                             "axis, axis_on_body and axis_in_space.")
        ((key, e),) = entries.items()
        axis = _direction(name, "axis", e)
        # the first frame that may be tilted; without one, all axes are axes of space
        carrier = next((frame for frame in (a, b) if isinstance(frame, Body)), None)
        if carrier is None:
            return axis
        in_space: Array = rotation(self._components.bodies[carrier].q) @ axis
        if key == "axis_on_body":
            return in_space
        if key == "axis" and carrier is a and np.abs(in_space - axis).max() > _SAME_AXIS:
            warn(f"The axis of {name!r} is {shown(e)} in space, and {carrier.name!r} is tilted "
                 f"at the start, so that its components on the body differ. Write axis_on_body= "
                 f"if they are components in the axes of {carrier.name!r}, or axis_in_space= if "
                 "they are in space.")
        return axis

    def _add(
        self, body: Body, start: InitialState, mass: float, inertia: Inertia, weight: float | None
    ) -> Body:
        """Add a body with its mass, inertia and weight γ or α, by default the mean of its moments.
        """
        self._components.values[str(body.mass)] = positive(f"mass of {body.name!r}", mass)
        mean = float(np.mean(moments_of(inertia)))
        self._components.values[str(body.weight)] = mean if weight is None else nonzero(
            f"{body.rep} of {body.name!r}", weight)
        self._components.inertia[body] = inertia
        start.is_placed = self._describes_start
        self._components.bodies[body] = start
        return body

    def _measure(self, joint: Connection | str, quantity: str) -> sp.Symbol:
        """Return the symbol of a measure; the assembly replaces it by the joint's expression."""
        link = self._components.joint(joint, f"The {quantity}")
        self._components.refuse_measure(link, quantity)
        symbol = sp.Symbol(f"{link.name}_{quantity}", real=True)
        if symbol not in self._components.measures:
            self._components.claim(str(symbol), "parameter")
            self._components.symbols[str(symbol)] = symbol
            self._components.measures[symbol] = link, quantity
        return symbol

    def _law(self, label: str, entry: Any) -> sp.Expr:
        """Return an expression of time and parameters, or raise InputError for other symbols."""
        law = as_expression(entry)
        other_symbols = law.free_symbols - {TIME} - {
            symbol for name, symbol in self._components.symbols.items()
            if name in self._components.values}
        if other_symbols:
            raise InputError(f"The {label} contains {min(map(str, other_symbols))!r}; it may "
                             "contain time and parameters.")
        return law


def _begin_at(assembly: Assembly, start: HasStart) -> float:
    """Take coordinates, momenta and parameters of a start into an assembly; return its time."""
    state = as_start(start)
    assembly.q0, assembly.p0 = (finite(name, x, assembly.q0.shape) for name, x in (
        ("q of start", state.q), ("p of start", state.p)))
    # a run may have had other values than the bodies: impulses depend on masses
    assembly.store.update((name, float(finite(name, value, shape=())))
                          for name, value in state.parameters.items() if name in assembly.store)
    return float(state.t)


def _refuse_other_start(name: str, joint: Connection, begin: float, rate: float) -> None:
    """Refuse a drive whose angle and rate at t = 0 are not the given ones of its joint."""
    hinge = hinge_of(joint)
    if not _agrees(hinge.rate, rate):
        raise InputError(f"The drive {name!r} begins at {rate:.6g} rad/s and its joint at "
                         f"{hinge.rate:.6g}: no start satisfies both; leave out the joint's "
                         "rate.")
    # an angle 0 of the described pose is the default, and contradicts no law
    if not (_agrees(hinge.start_angle, begin) and _agrees(hinge.angle or None, begin)):
        value = "travel" if isinstance(joint, Screw) else "angle"
        raise InputError(f"The drive {name!r} begins at {begin:.6g} rad and its joint at "
                         f"{hinge.start_angle or hinge.angle:.6g}: these are one angle; "
                         f"leave out the joint's {value}.")


def _refuse_shapes_beside_gap(name: str, **is_given: bool) -> None:
    """Refuse arguments of bodies that touch, where an expression is the gap of a contact."""
    keys_of_bodies = [key for key in is_given if is_given[key]]
    if keys_of_bodies:
        raise InputError(f"{name!r} has a gap and {few(keys_of_bodies)}, which belong to "
                         "bodies that touch; leave one of them out.")


def _segment_state(
    name: str, q: Array, x: Array, start: Array, v: Array | None, omega: Array | None
) -> InitialState:
    """Return the state of a segment of a beam that moves as one rigid body.

    Its middle x has the velocity v + ω × (x − x₀), where v is the velocity of the beam's
    start x₀; the angular velocity is in axes of the segment, whose attitude is q. A v or ω that is
    None follows from joints.
    """
    v_turning = np.zeros(3) if omega is None else np.cross(omega, x - start)
    return initial_state(name, q, rotation=None, position=x,
                         velocity=None if v is None else v + v_turning,
                         omega=None if omega is None else rotation(q).T @ omega)


def _matrix(q: Array) -> Array:
    """Return R(q), for a method in which the argument ``rotation`` hides that function."""
    return rotation(q)


def _direction(name: str, label: str, entry: ArrayLike) -> Array:
    """Return a direction, given in any length but 0, as a unit vector; ``label`` names it."""
    direction = vector(f"{label} of {name!r}", entry)
    if not direction.any():
        raise InputError(f"The {label} of {name!r} is zero; give its direction.")
    return unit(direction)


def _refuse_other_points(label: str, frame: Frame, points: Array, entry: Any) -> None:
    """Refuse points of a point mass, (3,) or rows of three, other than 0; ``entry`` gave them.

    A force there would have a torque, which turns nothing: the angular momentum would not be kept.
    """
    if isinstance(frame, Particle) and points.any():
        raise InputError(f"The {label} is {shown(entry)}, and {frame.name!r}, a point mass, has no "
                         "point but (0, 0, 0); leave it out, or give a body.")


def _rest(label: str, entry: Any) -> float | tuple[float, float]:
    """Return the rest length or angle of a spring: a number, or an interval (lower, upper)."""
    array = real_array(entry)
    if array is None or array.shape != (2,):
        return float(finite(label, entry, shape=()))
    lower, upper = finite(label, entry, (2,)).tolist()
    if lower > upper:
        raise InputError(f"The {label} is {shown(entry)}; give the lower end first.")
    return lower, upper


def _number_or_none(label: str, entry: Any) -> float | None:
    """Return a finite number, or None where none is given."""
    return None if entry is None else float(finite(label, entry, shape=()))


def _agrees(number: float | None, law: float) -> bool:
    """Return whether a number of a joint is None, or a law's within 1e-12, relative or in SI units.
    """
    return number is None or math.isclose(number, law, rel_tol=1e-12, abs_tol=1e-12)


def _coordinate(joint: Connection, chosen: str | None = None) -> str:
    """Return the measure of a joint that is its coordinate: "travel" if it slides, or "angle".

    A cylindrical joint has both, of which one may be chosen.
    """
    coordinates = [measure for measure in ("travel", "angle") if measure in joint.MEASURES]
    if not coordinates:
        raise InputError(f"Joint {joint.name!r} has no coordinate, neither an angle nor a travel.")
    if chosen is None:
        return coordinates[0]
    return choose(f"coordinate of {joint.name!r}", chosen, coordinates)
