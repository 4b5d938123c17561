"""Assembly of a multibody model: initial poses, constraints, H and forces.

    H = Σ T_i(q_i, p_i) + |p_x,i|²/(2 m_i) + V,    g = (|q_i|² − 1, joints),  body by body

The coordinates are ordered body by body, the constraints with the later body of each joint: in a
chain every constraint then meets its two neighbours only, and g_q H_pp g_qᵀ is block-tridiagonal.
Lengths, masses and moments are parameters, not numbers, so that equal joints have equal form.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import sympy as sp

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import inverse_entries, moments_of, quaternion_product
from ...core.projection import Projection, project_coordinates, project_momenta, report
from ...core.warnings import warn
from ..systems.body_layout import (
    BodyLayout,
    ConstraintForce,
    Entries,
    Entry,
    JointLayout,
    SectionLayout,
)
from ..systems.numeric_system import NumericConstraints, NumericSystem
from ..systems.redundant_constraints import Redundancy, find_redundant
from ..systems.system import System
from ..systems.velocity_coefficients import coefficients_of
from .beam import BeamJoint
from .body import GROUND, Body, Frame, MovingPoint, Particle, dot
from .components import TIME, Components
from .coordinates import Arm, BallFlywheel, Coordinate, Law, Slide
from .initial_motion import (
    ROUNDING,
    Velocities,
    close_loops,
    move_bodies,
    warn_of_moved_bodies,
    warn_of_moved_joints,
)
from .initial_poses import (
    Pose,
    RigidMotion,
    conjugate,
    in_range,
    propagate_all,
    rotation,
)
from .joints import (
    Align,
    Connection,
    Coupling,
    Equation,
    Fixed,
    HingedJoint,
    Joint,
    Planar,
    Poses,
    RheonomicConstraint,
    Store,
    copies,
    hinge_of,
)
from .rolling import Rolling

__all__ = ["Assembly"]

#: Factors by which a radius of gyration exceeds the model, or falls below the body's own arms, from
#: which on units in g or mm are more likely than such a body.
_LARGE, _SMALL = 30, 300
#: Largest opening of a joint whose latch closes, relative to the coordinates.
_OPEN = 1e-8


class _Formulas(NamedTuple):
    """H, forces, quantities and time scale of a system in q, p, t and parameters."""

    H: sp.Expr
    forces: tuple[sp.Expr, ...]  # one for each momentum, or none
    quantities: dict[str, sp.Expr]
    time_scales: tuple[sp.Expr, ...]  # one or none
    counted_joints: set[str]  # joints whose full turns count


class Assembly:
    """The components of a multibody system, put together at their initial poses.

    Parameters
    ----------
    components : Components
    without : set of str
        Names of constraints to leave out.
    closed : collection of str
        Names of latches whose joints are closed; those of others are left out.

    Raises
    ------
    InputError
        For a joint without a position, an unknown constraint, and numbers out of range.
    """

    def __init__(
        self, components: Components, without: set[str], closed: Collection[str] = ()
    ) -> None:
        self.components = components
        # copies, which the initial poses complete: the builder's joints stay as they were given
        self.connections = copies(components.connections)
        latched = {joint for joints in components.latches.values() for joint in joints}
        self.links = [copy for link, copy in self.connections.items() if link not in latched]
        self.store = components.values | self._body_values()
        # products of given numbers may exceed the range of a double: that is an error of the model
        with in_range(f"Multibody {components.name!r}"):
            # the poses of the description, to which the equations refer
            self.poses = self._poses()
            self._equations_of = {link: list(link.equations(self.poses, self.store))
                                  for link in self.links}
            self.equations, self.velocity_equations = self._equations(without)
            self.start = self._start()
            self.q0, self.p0 = self._coordinates_at(self.start), self._momenta_at(self.start)
            # latches that are closed: their joints hold at the start, not in the described pose
            for name in closed:
                for joint in components.latches[name]:
                    self._close(self.connections[joint])
            self.equations, self.velocity_equations = self._equations(without)

    def _close(self, link: Connection) -> None:
        """Add the joint of a latch, which does not hold in the described pose.

        Its points cannot follow from that pose, so that both must be given.
        """
        if isinstance(link, Joint) and (link.on_a is None or link.on_b is None):
            raise InputError(f"Joint {link.name!r} of a latch is open at the start; give its "
                             "points, on_a= and on_b=.")
        self.links.append(link)
        self._equations_of[link] = list(link.equations(self.poses, self.store))

    def redundancy(self, t: float) -> Redundancy:
        """Return the constraints that depend on others at the start, at time t."""
        lengths = np.array([x not in getattr(body, "q", ())
                            for body in self.components.bodies for x in body.coordinates])
        return find_redundant(self.components.name, self._constraints_at(t), self.q0, lengths)

    def _constraints_at(self, t: float) -> NumericConstraints:
        """Return the constraints and the velocity constraints at time t."""
        A, a = coefficients_of([e.expression for e in self.velocity_equations], self._velocities)
        return NumericConstraints(
            self._coordinate_symbols, [e.expression for e in self.equations],
            [e.name for e in self.equations], self.store | {str(TIME): t}, A, a,
            [e.name for e in self.velocity_equations])

    def refuse_open(self, t: float) -> None:
        """Refuse a state at time t in which a joint of a latch is open, or holds half a turn off.
        """
        constraints = self._constraints_at(t)
        # numbers that are not finite end in a refusal
        with np.errstate(all="ignore"):
            g = constraints.g(self.q0)
            widest = int(np.abs(g).argmax()) if g.size else 0
            if g.size and not abs(g[widest]) <= _OPEN * max(1.0, np.abs(self.q0).max()):
                raise InputError(f"{constraints.names[widest]!r} is open by {g[widest]:.3g} in the "
                                 "start; give start=run[-1] of a run with this constraint, or of "
                                 "one that ended where its latch closes.")
        self._refuse_half_turns(self._poses_at(self.q0), "where its latch closes; give a start "
                                "at which they are nearer to it")

    def _refuse_half_turns(self, poses: Mapping[Frame, Pose], cure: str) -> None:
        """Refuse poses in which a fixed joint holds, but half a turn off.

        ``cure`` ends the message.
        """
        for link in self.links:
            if isinstance(link, Fixed):
                link.refuse_half_turn(self.poses, poses, cure)

    def warn_of_sizes(self) -> None:
        """Warn of bodies whose radius of gyration is far from the lengths of the model.

        Inertia in kg mm², or a mass in g, is wrong by a factor of 1000 or more. A body may be small
        on a long arm: the radius of gyration is compared with the body's own arms from below, and
        with the extent of the whole model from above.
        """
        arms: dict[Frame, list[float]] = {body: [] for body in self.components.inertia}
        points = [np.zeros(3)]
        for link in self.links:
            for frame, r in ((link.a, getattr(link, "on_a", None)),
                             (link.b, getattr(link, "on_b", None))):
                if r is not None:
                    arms.setdefault(frame, []).append(math.hypot(*r))
                    # from the origin of b: where in space the model is does not count
                    points.append(self.poses[frame].space(r) - np.asarray(self.poses[link.b].x))
        extent = max(math.hypot(*r) for r in points)
        # segments of a beam are thin, and the inertia of a robot's file is measured or drawn
        segments = {body for beam in self.components.beams for body in beam.segments}
        for body, inertia in self.components.inertia.items():
            if self.components.bodies[body].is_placed or body in segments:
                continue
            mass = self.components.values[str(body.mass)]
            radius_of_gyration = math.sqrt(max(moments_of(inertia)) / mass)
            longest_arm = max(arms[body], default=0.0)
            is_small = longest_arm and radius_of_gyration < longest_arm / _SMALL
            if is_small or (extent and radius_of_gyration > _LARGE * extent):
                length = longest_arm if is_small else extent
                warn(f"The inertia of {body.name!r} and its mass, {mass:.6g} kg, have the radius "
                     f"of gyration {radius_of_gyration:.3g} m, and its joints are within "
                     f"{length:.3g} m; check the units, kg and kg m².")

    @property
    def _coordinate_symbols(self) -> list[sp.Symbol]:
        """q of the system, body by body."""
        return [x for body in self.components.bodies for x in body.coordinates]

    @property
    def _velocities(self) -> tuple[sp.Symbol, ...]:
        """The symbols of q̇, body by body."""
        return tuple(v for body in self.components.bodies for v in body.velocities)

    def _poses(self) -> dict[Frame, Pose]:
        """Return the poses of the description, with angles and travels 0, or as files have them.

        Positions and points that are not given are propagated from body to body along the joints.
        """
        poses: dict[Frame, Pose] = {GROUND: Pose.ground()}
        poses |= {body: start.pose() for body, start in self.components.bodies.items()}
        for point in self.components.moving_points:
            poses[point] = Pose.ground()
            poses[point].x, poses[point].v = np.array(self.components.start_of_point(point)).T
        joints = [link for link in self.links if isinstance(link, Joint)]
        rolling = [link for link in self.links if isinstance(link, Rolling)]
        # a rolling body is put on its plane only where no joint says where it is
        propagate_all(poses, "x", [joint.propagate_point for joint in joints],
                      [partial(link.set_position, self.store) for link in rolling])
        for joint in joints:
            if joint.on_a is None or joint.on_b is None:
                raise InputError(f"Joint {joint.name!r} has no position; give at= in "
                                 "space, or on_a= and on_b= in body axes.")
        for coordinate in self._coordinates:
            coordinate.begin(poses)
        return poses

    @property
    def _coordinates(self) -> list[Coordinate | BallFlywheel]:
        """Connections with coordinates of their own: flywheels and joints of chains."""
        return [link for link in self.links if isinstance(link, Coordinate | BallFlywheel)]

    def _start(self) -> dict[Frame, Pose]:
        """Return poses and velocities at the start, with the given angles, travels and rates.

        Three steps: the described poses move along a tree of joints, loops are closed, and
        velocities propagate from body to body.
        """
        start_values = [value for link in self.links
                        for value in link.start_values(self.poses, self.store)]
        poses = dict(self.poses)
        if start_values:
            poses = move_bodies(self.links, poses)
            constraints = NumericConstraints(
                self._coordinate_symbols, [e.expression for e in self.equations],
                [e.name for e in self.equations], self.store | {str(TIME): 0.0})
            q = close_loops(constraints, start_values, *map(self._coordinates_at,
                                                            (self.poses, poses)))
            # poses that need no closing keep their bits
            if (q != self._coordinates_at(poses)).any():
                poses = self._poses_at(q)
        joints = [link for link in self.links if isinstance(link, Joint)]
        rolling = [link for link in self.links if isinstance(link, Rolling)]
        propagate_all(poses, "spin", [link.propagate_spin for link in self.links])
        propagate_all(poses, "v", [joint.propagate_velocity for joint in joints],
                      [partial(link.set_velocity, self.store) for link in rolling])
        for link in rolling:
            link.refuse_off_ground(self.store, poses)
        for coordinate in self._coordinates:
            coordinate.begin_rate(poses)
        return poses

    def _equations(self, without: set[str]) -> tuple[list[Equation], list[Equation]]:
        """Return the constraints and the velocity constraints, without those that are left out.

        Constraints of a joint follow |q|² = 1 of the later of its bodies. Raises InputError for a
        name in ``without`` that no constraint has.
        """
        order = {body: index for index, body in enumerate(self.components.bodies)}
        # |q|² − 1 = 0 first, then the joints of each body with bodies before it: G M⁻¹ Gᵀ of a
        # chain is block-tridiagonal
        equations_of = {
            body: [Equation(f"{body.name}: unit quaternion", body.unit)] if body.q else []
            for body in self.components.bodies}
        for link in self.links:
            bodies = [frame for frame in link.frames if isinstance(frame, Body)]
            equations_of[max(bodies, key=order.__getitem__)] += self._equations_of[link]
        equations = [e for body in self.components.bodies for e in equations_of[body]]
        velocity_equations = [e for link in self.links if isinstance(link, Rolling)
                              for e in link.velocity_equations(self.store)]
        names = [e.name for e in (*equations, *velocity_equations)]
        unknown = without - {*names}
        if unknown:
            raise InputError(
                f"There is no constraint {min(unknown)!r} to leave out; the constraints are "
                f"{', '.join(map(repr, names))}.")
        return ([e for e in equations if e.name not in without],
                [e for e in velocity_equations if e.name not in without])

    def _hamiltonian(self) -> sp.Expr:
        """Return H = Σ (T − m g·x) of bodies, V of connections, and potentials."""
        terms = []
        for body in self.components.bodies:
            terms.append(body.kinetic_energy)
            terms.append(-body.mass * dot(self.components.gravity, body.centre_of_mass))
        terms += [link.energy(self.store) for link in self.links]
        return sp.Add(*terms, *self.components.potentials)

    def make_system(self, left_out: Collection[str]) -> System:
        """Return the system without the constraints ``left_out``, such as redundant ones.

        Parameters that no expression of the system contains are deleted from the store: a model
        asks for none of them. Raises InputError for a parameter without a value, an input that
        acts nowhere, and a parameter with the name of a coordinate.
        """
        equations, velocity_equations = (
            [e for e in candidates if e.name not in left_out]
            for candidates in (self.equations, self.velocity_equations))
        components, store = self.components, self.store
        q = tuple(x for body in components.bodies for x in body.coordinates)
        p = tuple(x for body in components.bodies for x in body.momenta)
        formulas = self._formulas(p)
        self._refuse_parameters_named(*q, *p)
        constraints = tuple(equation.expression for equation in equations)
        velocity_constraints = tuple(equation.expression for equation in velocity_equations)
        velocities = self._velocities if velocity_constraints else ()
        symbols = self._symbols(formulas, (*constraints, *velocity_constraints))
        # in the order in which the model was described, which names do not change
        parameters = tuple(sorted(symbols - {*q, *p, *velocities, TIME}, key=_by_first_use(store)))
        self._refuse_unused(parameters, symbols)
        # layouts of bodies and joints need the deleted ones too, as numbers
        values = dict(store)
        for name in store.keys() - set(map(str, parameters)):
            del store[name]
        return System(
            q, p, parameters, formulas.H, constraints, name=components.name,
            forces=formulas.forces,
            constraint_names=tuple(equation.name for equation in equations),
            velocity_constraints=velocity_constraints, velocities=velocities,
            velocity_constraint_names=tuple(equation.name for equation in velocity_equations),
            time=TIME if TIME in symbols else None, quantities=formulas.quantities,
            time_scale=formulas.time_scales[0] if formulas.time_scales else None,
            inputs=tuple(components.inputs),
            bodies=tuple(body_at(body, {*parameters}, values) for body in components.bodies
                         if body.q),
            joints=self._joint_layouts({*equations}, {*parameters}, values,
                                       formulas.counted_joints))

    def _symbols(self, formulas: _Formulas, constraints: Sequence[sp.Expr]) -> set[sp.Symbol]:
        """Return the symbols of a system's expressions, and of restitutions of impacts."""
        components = self.components
        restitutions = {components.symbols[impact.restitution] for impact in components.impacts
                        if isinstance(impact.restitution, str)}
        return restitutions.union(*(e.free_symbols for e in (
            formulas.H, *constraints, *formulas.forces, *formulas.quantities.values(),
            *formulas.time_scales)))

    def _refuse_parameters_named(self, *states: sp.Symbol) -> None:
        """Refuse a parameter with the name of a coordinate or momentum."""
        clash = next((x for x in states if str(x) in self.store), None)
        if clash is not None:
            raise InputError(f"{str(clash)!r} in Multibody {self.components.name!r} is both a "
                             "coordinate of a body and a parameter; rename one of the two.")

    def _formulas(self, p: Sequence[sp.Symbol]) -> _Formulas:
        """Return H, forces on the momenta p, quantities and the time scale.

        Users write the angles and rates of joints as symbols; these are replaced by expressions of
        q and p. Values of parameters go into the store.
        """
        components = self.components
        forces_on = self._forces_on_momenta()
        H = self._hamiltonian()
        scales = () if components.time_scale is None else (components.time_scale,)
        measures = {symbol: self.connections[joint].measure(measure, self.poses, self.store)
                    for symbol, (joint, measure) in components.measures.items()}
        # before the symbols are replaced: formulas contain the symbols of joints' angles
        force_terms = [e for addends in forces_on.values() for e in addends]
        counted = self._counted_joints(set().union(*(e.free_symbols for e in (
            H, *force_terms, *components.quantities.values(), *scales))))
        forces = tuple(sp.Add(*forces_on.get(x, ())).xreplace(measures)
                       for x in p) if forces_on else ()
        quantities = {name: e.xreplace(measures) for name, e in components.quantities.items()}
        return _Formulas(H.xreplace(measures), forces, quantities,
                         tuple(e.xreplace(measures) for e in scales), counted)

    def _forces_on_momenta(self) -> dict[sp.Symbol, list[sp.Expr]]:
        """Return momentum → the generalised forces on it, in the order of the connections.

        They are added up once, in that order, so that C does not depend on the order of sets.
        """
        generalised_forces = [*self.components.forces, *(
            force for link in self.links for force in link.forces(self.poses, self.store))]
        forces_on: dict[sp.Symbol, list[sp.Expr]] = defaultdict(list)
        for momenta, force in generalised_forces:
            for x, e in zip(momenta, force, strict=True):
                forces_on[x].append(e)
        return forces_on

    def _counted_joints(self, symbols: Collection[sp.Symbol]) -> set[str]:
        """Return the joints whose full turns are counted: their angle is used beyond ±π.

        Such a joint has its angle among the ``symbols`` of H, forces and quantities, starts at an
        angle, or is driven or coupled by its angle.
        """
        # an arm of a universal joint has no hinge, and its angle no full turns
        counted = {joint.name for symbol, (joint, measure) in self.components.measures.items()
                   if symbol in symbols and measure == "angle" and not isinstance(joint, Arm)}
        for link in self.links:
            # the pose that is described may have an angle, too
            if isinstance(link, Align | HingedJoint) and (
                    hinge_of(link).start_angle is not None or hinge_of(link).angle):
                counted.add(link.name)
            if isinstance(link, RheonomicConstraint):
                counted |= {link.name, link.joints[0].name}
            elif isinstance(link, Coupling | Law):
                counted |= {
                    joint.name for joint, quantity in zip(link.joints, link.quantities, strict=True)
                    if quantity == "angle" and not isinstance(joint, Arm)}
        return counted

    def _refuse_unused(
        self, parameters: Sequence[sp.Symbol], symbols: Collection[sp.Symbol]
    ) -> None:
        """Refuse parameters without a value, and inputs that are not among the ``symbols`` of the
        system: they act nowhere."""
        unknown = [s for s in parameters if str(s) not in self.store]
        if unknown:
            raise InputError(f"{str(unknown[0])!r} in Multibody {self.components.name!r} has no "
                             "value; make it with parameter(name, value) or input(name).")
        without_force = [u for u in self.components.inputs if u not in symbols]
        if without_force:
            raise InputError(f"Input {str(without_force[0])!r} of Multibody "
                             f"{self.components.name!r} is in no force; write it where it acts, or "
                             "remove it.")

    def _joint_layouts(
        self, equations: Collection[Equation], parameters: set[sp.Symbol],
        values: Mapping[str, Any], counted: Collection[str],
    ) -> tuple[JointLayout, ...]:
        """Return the layouts of the joints, aliases of joints last.

        ``equations`` are the system's constraints, ``counted`` the names of joints whose full
        turns count. A ``Slide`` and connections of point masses have no layout. Of the connections
        of moving points, only joints that hold a point or an axis have one. ``parameters`` and
        ``values`` are as of ``joint_at``.
        """
        def layout(link: Connection, *, is_counted: bool) -> JointLayout:
            """Return the layout of a joint, with those of its constraints that the system keeps."""
            kept_equations = [e for e in self._equations_of[link] if e in equations]
            return joint_at(link, self.poses, kept_equations, parameters, values,
                            is_counted=is_counted)

        layouts = [layout(link, is_counted=link.name in counted) for link in self.links
                   if _has_layout(link)]
        # an alias shares its joint's point and reaction, but has no angle of its own
        layouts += [replace(layout(self.connections[joint], is_counted=False), name=name,
                            axis_a=(), axis_b=())
                    for name, joint in self.components.aliases.items()]
        return tuple(layouts)

    def closed_state(self, numbers: NumericSystem) -> Projection:
        """Return the state with latches closed: p is projected onto g_q H_p = 0, a plastic impact.
        """
        # numbers that are not finite end in a refusal
        with np.errstate(all="ignore"):
            q = project_coordinates(numbers, self.q0)
            p = project_momenta(numbers, q, self.p0)
        return report(numbers, (self.q0, self.p0), (q, p), (numbers.g(self.q0), numbers.g(q)),
                      (numbers.f(self.q0, self.p0), numbers.f(q, p)))

    def consistent_state(self, numbers: NumericSystem) -> Projection:
        """Return the start on the constraints, with the given coordinates and velocities.

        Raises InputError for velocities that the constraints do not allow, with the nearest
        possible ones.
        """
        # numbers that are not finite end in a refusal
        with np.errstate(all="ignore"):
            q = project_coordinates(numbers, self.q0)
            poses, p = self.start, self.p0
            # The projection moved the bodies: momenta 2 L(q)ᵀ J Ω are computed at the new q. The
            # coordinates of joints that are ``placed``, of a robot's file, give way with a warning.
            if np.abs(q - self.q0).max() > ROUNDING * np.abs(q).max():
                poses = self._poses_at(q, self.start)
                warn_of_moved_bodies(self.components.bodies, self.start, poses)
                warn_of_moved_joints(
                    self._coordinate_symbols, self.components.values | self._body_values(),
                    [copy for link, copy in self.connections.items()
                     if link in self.components.placed], self.poses, q)
                p = self._momenta_at(poses)
            self._refuse_half_turns(poses, "where they start; start them nearer to it, by their "
                                    "attitudes or by angles of joints")
            masses = {body: self.components.values[str(body.mass)]
                      for body in self.components.bodies}
            velocities = Velocities(
                self.components.bodies, poses, self.components.inertia, masses)
            p = velocities.keep(numbers, [copy for link, copy in self.connections.items()
                                          if link not in self.components.placed], q, p)
            velocities.warn_of_moved(p)
            return report(
                numbers, (self.q0, self.p0), (q, p), (numbers.g(self.q0), numbers.g(q)),
                (numbers.f(q, self.p0), numbers.f(q, p)))

    def _coordinates_at(self, poses: Mapping[Frame, Pose]) -> Array:
        """Return q, shape (n,), of all bodies at ``poses``: quaternion, then position of each."""
        q: list[Array] = []
        for body in self.components.bodies:
            pose = poses[body]
            if body.q:
                q.append(pose.q)
            if body.x:
                assert pose.x is not None
                q.append(pose.x)
        return np.concatenate(q)

    def _momenta_at(self, poses: Mapping[Frame, Pose]) -> Array:
        """Return p, shape (n,), of all bodies in motion: 2 L(q)ᵀ J Ω and m v of each."""
        p: list[Array] = []
        for body in self.components.bodies:
            pose = poses[body]
            if body.q:
                p.append(pose.momenta(self.components.inertia[body]))
            if body.x:
                assert pose.v is not None
                p.append(self.components.values[str(body.mass)] * pose.v)
        return np.concatenate(p)

    def _poses_at(self, q: Array, of: Mapping[Frame, Pose] | None = None) -> dict[Frame, Pose]:
        """Return the poses at coordinates q, shape (n,), with the velocities of the poses ``of``.

        ``of`` is by default the poses that the model describes. Angular velocities are in body
        axes, and keep their components there.
        """
        poses, offset = dict(self.poses if of is None else of), 0
        for body in self.components.bodies:
            pose, described = poses[body], self.poses[body]
            offset, attitude = offset + len(body.q), q[offset : offset + len(body.q)]
            offset, x = offset + len(body.x), q[offset : offset + len(body.x)]
            if not body.q:
                poses[body] = replace(pose, x=x)
                continue
            # the motion from the described pose, q° and x°, to this one: r ↦ R(t) (r − x°) + x with
            # the turn t = q q̄°
            turn = RigidMotion(
                np.array(quaternion_product(attitude, conjugate(described.q))), np.zeros(3))
            assert described.x is not None
            position = x if body.x else described.x
            motion = RigidMotion(turn.q, position - turn.direction(described.x))
            R = rotation(attitude)
            spin = None if pose.spin is None else R @ (pose.R.T @ pose.spin)
            poses[body] = Pose(attitude, R, position, pose.v, spin, motion)
        return poses

    def _body_values(self) -> dict[str, float]:
        """Return name → value of the moments of all bodies, or of the entries of J and J⁻¹."""
        values: dict[str, float] = {}
        for body, inertia in self.components.inertia.items():
            numbers = np.ravel(inertia).tolist()
            values |= dict(zip(map(str, body.inertia), numbers, strict=True))
            if body.inverse:
                values |= dict(zip(map(str, body.inverse), inverse_entries(inertia), strict=True))
        return values


def _by_first_use(store: Mapping[str, float]) -> Any:
    """Return a sort key for symbols: the order in which their values were stored, then names."""
    order = {name: index for index, name in enumerate(store)}
    return lambda symbol: (order.get(str(symbol), len(order)), str(symbol))


def body_at(body: Body, parameters: set[sp.Symbol], values: Mapping[str, float]) -> BodyLayout:
    """Return the layout of a body.

    ``parameters`` are the system's; ``values`` has also the values of parameters that no expression
    of the system contains: these become numbers in the layout.
    """
    origin: dict[str, Any] = {} if body.x else {"origin": _entries(body.origin, parameters, values)}
    return BodyLayout(body.name, body.q, body.inverse or body.inertia, body.x, **origin,
                  centre=_entries(body.centre, parameters, values),
                  mass=_entry(body.mass, parameters, values))


def _has_layout(link: Connection) -> bool:
    """Whether force, angle and rate of a connection follow from bodies alone."""
    holds_point_or_axis = isinstance(link, Joint | Align) and not isinstance(
        link, BeamJoint | Planar)
    unknown_frames = Particle if holds_point_or_axis else MovingPoint | Particle
    return not isinstance(link, Slide) and not any(
        isinstance(frame, unknown_frames) for frame in link.frames)


def joint_at(
    link: Connection, poses: Poses, equations: Iterable[Equation], parameters: set[sp.Symbol],
    values: Mapping[str, float], *, is_counted: bool,
) -> JointLayout:
    """Return the layout of a joint: its points, axes and constraint forces.

    ``equations`` are its constraints that the system has. ``parameters`` are the system's,
    ``values`` have also the parameters that no expression contains: these become numbers.
    ``is_counted``: the system depends on its angle, so that full turns count.
    """
    def entries(expressions: Sequence[Any]) -> Entries:
        # values of points and angles that no expression contains are in ``store`` alone
        return _entries(expressions, parameters, {**values, **store})

    store: Store = {}
    (on_a, on_b), (axis_a, axis_b) = link.local_points(store), link.axes(poses, store)
    zero = hinge_of(link).zero(poses, store) if is_counted else ()
    constraint_forces = tuple(
        (equation.name, _force_entries(equation.constraint_force, parameters, values))
        for equation in equations)
    # no entry can say where a moving point is at a time: the joint's point on it is left out
    on_a, on_b = (() if isinstance(frame, MovingPoint) else point
                  for frame, point in ((link.a, on_a), (link.b, on_b)))
    return JointLayout(
        link.name, _name(link.a), _name(link.b), entries(on_a), entries(on_b), entries(axis_a),
        entries(axis_b), entries(zero), constraint_forces,
        _section(link, parameters, values))


def _section(
    link: Connection, parameters: set[sp.Symbol], values: Mapping[str, float]
) -> SectionLayout | None:
    """Return the section of a joint of a beam with parameters or numbers; None for other joints.

    Parameters that no expression of the system contains become numbers.
    """
    if not isinstance(link, BeamJoint):
        return None
    store: Store = {}
    section = link.section(store)
    values = {**values, **store}
    stiffness, rest_strain, turn, extension = (
        _entries(entries, parameters, values)
        for entries in (section.stiffness, section.rest, section.turn, section.extension))
    return replace(section, spacing=_entry(section.spacing, parameters, values),
                   stiffness=stiffness, rest=rest_strain,
                   turn=turn, extension=extension,
                   damping=_entry(section.damping, parameters, values))


def _name(frame: Frame) -> str:
    """Return a body's name; "" for the ground and moving points, which have no columns."""
    return frame.name if isinstance(frame, Body) else ""


def _force_entries(
    force: ConstraintForce | None, parameters: set[sp.Symbol], values: Mapping[str, float]
) -> ConstraintForce | None:
    """Return a constraint force with entries that are parameters or numbers; None for None."""
    return force and ConstraintForce(force.kind, _entries(force.on_a, parameters, values),
                                     _entries(force.on_b, parameters, values))


def _entries(
    expressions: Sequence[Any], parameters: set[sp.Symbol], values: Mapping[str, float]
) -> Entries:
    """Return each expression as a parameter of the system, or as a number."""
    return tuple(_entry(e, parameters, values) for e in expressions)


def _entry(e: Any, parameters: set[sp.Symbol], values: Mapping[str, float]) -> Entry:
    """Return a symbol unchanged if it is a parameter of the system, else the number of ``e``.

    Another symbol has its number in ``values``, by name; what is no symbol is a number already.
    """
    if not isinstance(e, sp.Symbol):
        return float(e)
    return e if e in parameters else float(values[str(e)])
