"""Assembly of a multibody model: initial poses, constraints, H and forces.

    H = Σ T_i(q_i, p_i) + |p_x,i|²/(2 m_i) + V,    g = (|q_i|² − 1, joints),  body by body

The coordinates are ordered body by body, the constraints with the later body of each joint: in a
chain every constraint then meets its two neighbours only, and g_q H_pp g_qᵀ is block-tridiagonal.
Lengths, masses and moments are parameters, not numbers, so that equal joints have equal form.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.inertia import inverse_entries
from ..systems.body_layout import BodyLayout, ConstraintForce, Entries, Entry, JointLayout
from ..systems.numeric_system import NumericConstraints
from ..systems.redundant_constraints import Redundancy, find_redundant
from ..systems.system import System
from ..systems.velocity_coefficients import coefficients_of
from .body import GROUND, Body, Frame, MovingPoint, Particle, dot
from .components import TIME, Components
from .coordinates import Arm, BallFlywheel, Coordinate, Law, Slide
from .initial_poses import Pose, in_range, propagate_all
from .joints import (
    Connection,
    Coupling,
    Equation,
    Joint,
    Poses,
    RheonomicConstraint,
    Store,
    copies,
    hinge_of,
)
from .rolling import Rolling

__all__ = ["Assembly"]

Array = NDArray[Any]


class Assembly:
    """The components of a multibody system, put together at their initial poses.

    Parameters
    ----------
    components : Components
    without : set of str
        Names of constraints to leave out.

    Raises
    ------
    InputError
        For a joint without a position, an unknown constraint, and numbers out of range.
    """

    def __init__(self, components: Components, without: set[str]) -> None:
        self.components = components
        self.connections = copies(components.connections)  # completed by the initial poses
        self.links = [*self.connections.values()]
        self.store = components.values | self._body_values()
        with in_range(f"Multibody {components.name!r}"):
            self.poses = self._poses()
            self._of_link = {link: list(link.equations(self.poses, self.store))
                             for link in self.links}
            self.equations, self.velocity_equations = self._equations(without)
            self.q0, self.p0 = self._state()

    def redundancy(self) -> Redundancy:
        """Return which constraints depend on others at the start."""
        coordinates = [x for body in self.components.bodies for x in body.coordinates]
        A, a = coefficients_of([e.expression for e in self.velocity_equations], self._velocities)
        return find_redundant(self.components.name, NumericConstraints(
            coordinates, [e.expression for e in self.equations],
            [e.name for e in self.equations], self.store | {str(TIME): 0.0}, A, a,
            [e.name for e in self.velocity_equations]), self.q0)

    @property
    def _velocities(self) -> tuple[sp.Symbol, ...]:
        return tuple(v for body in self.components.bodies for v in body.velocities)

    def _poses(self) -> dict[Frame, Pose]:
        poses: dict[Frame, Pose] = {GROUND: Pose.ground()}
        poses |= {body: start.pose() for body, start in self.components.bodies.items()}
        for point in self.components.moving_points:
            poses[point] = Pose.ground()
            poses[point].x, poses[point].v = (
                np.array(part) for part in zip(*self.components.start_of_point(point), strict=True))
        joints = [link for link in self.links if isinstance(link, Joint)]
        propagate_all(poses, "spin", [link.turn for link in self.links])
        rolling = [link for link in self.links if isinstance(link, Rolling)]
        propagate_all(poses, "x", [joint.place for joint in joints],
                      [partial(link.place, self.store) for link in rolling])
        for joint in joints:
            if joint.on_a is None or joint.on_b is None:
                raise InputError(f"Joint {joint.name!r} has no position; give at= in "
                                 "space, or on_a= and on_b= in body axes.")
        propagate_all(poses, "v", [joint.move for joint in joints],
                      [partial(link.move, self.store) for link in rolling])
        for link in rolling:
            link.refuse_off_ground(self.store, poses)
        for coordinate in self.links:
            if isinstance(coordinate, Coordinate | BallFlywheel):
                coordinate.begin(poses)
        return poses

    def _equations(self, without: set[str]) -> tuple[list[Equation], list[Equation]]:
        """Return the constraints, each with the later of its bodies, and those on velocities."""
        order = {body: index for index, body in enumerate(self.components.bodies)}
        rows = {body: [Equation(f"{body.name}: unit quaternion", body.unit)] if body.q else []
                for body in self.components.bodies}
        for link in self.links:
            own = [frame for frame in link.frames if isinstance(frame, Body)]
            rows[max(own, key=order.__getitem__)] += self._of_link[link]
        found = [equation for body in self.components.bodies for equation in rows[body]]
        slips = [equation for link in self.links if isinstance(link, Rolling)
                 for equation in link.velocity_equations(self.store)]
        unknown = without - {equation.name for equation in (*found, *slips)}
        if unknown:
            raise InputError(
                f"There is no constraint {min(unknown)!r} to leave out; the constraints are "
                f"{', '.join(repr(equation.name) for equation in (*found, *slips))}."
            )
        return ([equation for equation in found if equation.name not in without],
                [equation for equation in slips if equation.name not in without])

    def _hamiltonian(self) -> sp.Expr:
        terms = []
        for body in self.components.bodies:
            terms.append(body.kinetic_energy)
            terms.append(-body.mass * dot(self.components.gravity, body.centre_of_mass))
        terms += [link.energy(self.store) for link in self.links]
        return sp.Add(*terms, *self.components.potentials)

    def make_system(self, left_out: Collection[str]) -> System:
        """Return the system without some constraints; unused parameters leave the store."""
        equations, slips = ([e for e in part if e.name not in left_out]
                            for part in (self.equations, self.velocity_equations))
        store = self.store
        pushes = [*self.components.forces, *(push for link in self.links
                                             for push in link.forces(self.poses, store))]
        H = self._hamiltonian()
        measures = {symbol: self.connections[joint].measure(what, self.poses, store)
                    for symbol, (joint, what) in self.components.measures.items()}
        acting: dict[sp.Symbol, list[sp.Expr]] = {x: [] for xs, _ in pushes for x in xs}
        for xs, force in pushes:
            for x, e in zip(xs, force, strict=True):
                acting[x].append(e)
        named = set().union(*(e.free_symbols for e in (
            H, *(e for _, force in pushes for e in force), *self.components.quantities.values())))
        counted = {joint.name for symbol, (joint, what) in self.components.measures.items()
                   if symbol in named and what == "angle" and not isinstance(joint, Arm)}
        for link in self.links:
            if isinstance(link, RheonomicConstraint):
                counted |= {link.name, link.joints[0].name}
            elif isinstance(link, Coupling | Law):
                counted |= {joint.name for joint, what in zip(link.joints, link.what, strict=True)
                            if what == "angle" and not isinstance(joint, Arm)}
        H = H.xreplace(measures)
        quantities = {name: e.xreplace(measures) for name, e in self.components.quantities.items()}
        q = tuple(x for body in self.components.bodies for x in body.coordinates)
        p = tuple(x for body in self.components.bodies for x in body.momenta)
        forces = tuple(sp.Add(*acting.get(x, ())).xreplace(measures) for x in p) if acting else ()
        constraints = tuple(equation.expression for equation in equations)
        rows = tuple(equation.expression for equation in slips)
        velocities = self._velocities if rows else ()
        used: set[sp.Symbol] = set().union(*(
            e.free_symbols for e in (H, *constraints, *rows, *forces, *quantities.values())))
        parameters = tuple(sorted(used - {*q, *p, *velocities, TIME}, key=_by_first_use(store)))
        unknown = [s for s in parameters if str(s) not in store]
        if unknown:
            raise InputError(f"{str(unknown[0])!r} in Multibody {self.components.name!r} has no "
                             "value; make it with parameter(name, value) or input(name).")
        unfelt = [u for u in self.components.inputs if u not in used]
        if unfelt:
            raise InputError(f"Input {str(unfelt[0])!r} of Multibody {self.components.name!r} is "
                             "in no force; write it where it acts, or remove it.")
        kept, values, there = set(parameters), dict(store), set(equations)
        for name in store.keys() - set(map(str, parameters)):
            del store[name]
        return System(
            q, p, parameters, H, constraints, name=self.components.name, forces=forces,
            constraint_names=tuple(equation.name for equation in equations),
            velocity_constraints=rows, velocities=velocities,
            velocity_constraint_names=tuple(equation.name for equation in slips),
            time=TIME if TIME in used else None, quantities=quantities,
            inputs=tuple(self.components.inputs),
            bodies=tuple(body_at(body, kept, values) for body in self.components.bodies if body.q),
            joints=tuple(joint_at(link, self.poses, [e for e in self._of_link[link] if e in there],
                                  kept, values, link.name in counted)
                         for link in self.links
                         if not isinstance(link, Slide) and not any(
                             isinstance(frame, MovingPoint | Particle) for frame in link.frames)),
        )

    def _state(self) -> tuple[Array, Array]:
        q: list[Array] = []
        p: list[Array] = []
        for body in self.components.bodies:
            pose = self.poses[body]
            if body.q:
                q.append(pose.q)
                p.append(pose.momenta(self.components.inertia[body]))
            if body.x:
                assert pose.x is not None
                assert pose.v is not None
                q.append(pose.x)
                p.append(self.components.values[str(body.mass)] * pose.v)
        return np.concatenate(q), np.concatenate(p)

    def _body_values(self) -> dict[str, float]:
        values: dict[str, float] = {}
        for body, inertia in self.components.inertia.items():
            numbers = np.ravel(inertia).tolist()
            values |= dict(zip(map(str, body.inertia), numbers, strict=True))
            if body.inverse:
                values |= dict(zip(map(str, body.inverse), inverse_entries(inertia), strict=True))
        return values


def _by_first_use(store: Mapping[str, float]) -> Any:
    order = {name: index for index, name in enumerate(store)}
    return lambda symbol: (order.get(str(symbol), len(order)), str(symbol))


def body_at(body: Body, kept: set[sp.Symbol], values: Mapping[str, float]) -> BodyLayout:
    """Return the layout of a body; ``kept`` are the system's parameters, ``values`` of all."""
    held: dict[str, Any] = {} if body.x else {"origin": _entries(body.origin, kept, values)}
    return BodyLayout(body.name, body.q, body.inverse or body.inertia, body.x, **held,
                  centre=_entries(body.centre, kept, values),
                  mass=_entry(body.mass, kept, values))


def joint_at(
    link: Connection, poses: Poses, equations: Iterable[Equation], kept: set[sp.Symbol],
    values: Mapping[str, float], counted: bool,
) -> JointLayout:
    """Return the layout of a joint; ``equations`` are those of its constraints that remain.

    ``counted``: the system depends on its angle, so that full turns count.
    """
    store: Store = {}  # of values that are known
    (on_a, on_b), (axis_a, axis_b) = link.places(store), link.axes(poses, store)
    zero = hinge_of(link).zero(poses, store) if counted else ()
    constraint_forces = [
        (equation.name, _force_entries(equation.constraint_force, kept, values))
        for equation in equations]
    return JointLayout(link.name, _name(link.a), _name(link.b), _entries(on_a, kept, values),
                   _entries(on_b, kept, values), _entries(axis_a, kept, values),
                   _entries(axis_b, kept, values), _entries(zero, kept, values),
                   tuple(constraint_forces))


def _name(frame: Frame) -> str:
    return frame.name if isinstance(frame, Body) else ""


def _force_entries(
    force: ConstraintForce | None, kept: set[sp.Symbol], values: Mapping[str, float]
) -> ConstraintForce | None:
    return force and ConstraintForce(force.kind, _entries(force.on_a, kept, values),
                                     _entries(force.on_b, kept, values))


def _entries(given: Sequence[Any], kept: set[sp.Symbol], values: Mapping[str, float]) -> Entries:
    return tuple(_entry(e, kept, values) for e in given)


def _entry(e: Any, kept: set[sp.Symbol], values: Mapping[str, float]) -> Entry:
    """Return a parameter of the system, or the value of another one."""
    if not isinstance(e, sp.Symbol):
        return float(e)
    return e if e in kept else float(values[str(e)])
