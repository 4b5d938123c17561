"""Rigid bodies together: bodies, joints and forces, put into a ``Model`` with its start.

    H = Σ T_i(q_i, p_i) + |p_x,i|²/(2 m_i) + V,    g = (|q_i|² − 1, joints),  body by body

The coordinates are ordered body by body, the constraints with the later body of each joint: in a
chain every constraint then meets its two neighbours only, and g_q H_pp g_qᵀ is block-tridiagonal.
Lengths, masses and moments are parameters, not numbers, so that equal joints have equal form.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray

from ...core.arguments import as_items, as_text, choose, few, shown
from ...core.errors import InputError
from ...core.inertia import (
    Inertia,
    RepName,
    as_inertia,
    inverse_entries,
    is_tensor,
    moments_of,
)
from ...core.projection import Projection, project
from ..systems.numeric_system import NumericConstraints, NumericSystem
from ..systems.redundant_constraints import Redundancy, find_redundant
from ..systems.system import System
from .body import GROUND, Body, Frame, Moving, Particle, Push, dot
from .forces import Machine
from .initial_poses import (
    Pose,
    Start,
    check_rep,
    count,
    finite,
    in_range,
    nonzero,
    onto,
    positive,
    settle,
    start_of,
    three,
)
from .joints import Connection, Equation, Joint, copies, named_vector
from .layout_records import body_at, joint_at
from .model import Model
from .sliding_joints import Coupling, Drive

__all__ = ["Multibody"]

Array = NDArray[Any]


class Multibody(Machine):
    """A builder of models: add bodies, joints and forces, then ask for ``model()``.

    Attributes
    ----------
    name : str
        A C identifier, the system's name.
    ground : Frame
        Space, wherever a joint or spring takes a body.
    time : Symbol
        t, for forces, torques and quantities.
    start : Projection or None
        After ``model()``: what its start was moved by to be consistent.
    redundancy : Redundancy or None
        After ``model(redundant="leave out")``: what was left out, and what it depends on.

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

    def __init__(
        self, name: str, *, gravity: ArrayLike = (0.0, 0.0, -9.81),
        dt: float | None = None, steps: int | None = None, description: str = "",
    ) -> None:
        super().__init__(name)
        self.start: Projection | None = None
        self.redundancy: Redundancy | None = None
        self._gravity = named_vector("gravity", three("gravity", gravity).tolist(), self._values)
        self._about: dict[str, Any] = {
            "dt": None if dt is None else float(finite("time step", dt, ())),
            "steps": None if steps is None else count(steps),
            "description": as_text("description", description),
        }
        self._inertia: dict[Body, Inertia] = {}

    def __repr__(self) -> str:
        return (f"<Multibody {self.name}: bodies {few(body.name for body in self._bodies)}; "
                f"joints {few(link.name for link in self._links)}>")

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
            Of the centre of mass in space; by default what joints tell, else 0.
        quaternion, rotation : optional
            Attitude from body to space axes: four numbers, scalar first, or a 3 × 3 matrix or
            SciPy Rotation; by default body and space axes agree.
        angular_velocity : three floats, optional
            In body axes, rad/s; by default what revolute joints tell, else 0.

        Returns
        -------
        Body
            For joints, and for expressions: ``.point(r)``, ``.velocity``, ``.angular_velocity``.

        Raises
        ------
        InputError
            For names used twice and for numbers that no body can have.
        """
        self._claim(name)
        check_rep(name, rep)
        given = as_inertia(inertia, f"inertia of {name!r}")
        start = start_of(name, quaternion, rotation, position, velocity, angular_velocity)
        body = Body.free(name, rep, tensor=is_tensor(given))
        return self._add(body, start, mass, given, weight)

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
        self._claim(name)
        check_rep(name, rep)
        given = as_inertia(inertia, f"inertia of {name!r}")
        origin = three(f"fixed point of {name!r}", at)
        middle = three(f"centre of {name!r}", centre)
        body = Body.held(
            name, rep, named_vector(f"{name}_at", origin.tolist(), self._values),
            named_vector(f"{name}_centre", middle.tolist(), self._values),
            tensor=is_tensor(given),
        )
        start = start_of(name, quaternion, rotation, origin, (0, 0, 0), angular_velocity)
        return self._add(body, start, mass, given, weight)

    def point_mass(
        self, name: str, *, mass: float, position: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
    ) -> Particle:
        """Add a point with mass, 3 coordinates: for balls, rods, springs and forces.

        ``position`` and ``velocity`` are in space; by default what balls tell, else 0.
        """
        self._claim(name)
        point = Particle.named(name)
        self._values[str(point.mass)] = positive(f"mass of {name!r}", mass)
        self._bodies[point] = start_of(name, None, None, position, velocity, (0, 0, 0))
        return point

    def rotor(
        self, name: str, body: Frame | str, *, mass: float, inertia: Sequence[float],
        axis: ArrayLike | None = None, axis_on_body: ArrayLike | None = None,
        axis_in_space: ArrayLike | None = None, at: ArrayLike | None = None,
        on_body: ArrayLike | None = None, rate: float = 0.0,
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
        along, across = finite(
            f"inertia of rotor {name!r}, about its axis and across it,", inertia, (2,))
        carrier = self._frame(body, shown(name))
        direction = self._axis(name, carrier, carrier, (axis, axis_on_body, axis_in_space))
        wheel = self.body(name, mass=mass, inertia=(across, across, along),
                          quaternion=onto(direction))
        if at is None and on_body is None:
            on_body = (0, 0, 0)
        self.revolute(f"{name}_bearing", body, wheel, axis_in_space=direction, at=at,
                      on_a=on_body, on_b=(0, 0, 0), rate=rate)
        return wheel

    # ------------------------------------------------------------ the model

    def model(
        self, *, without: Iterable[str] = (), redundant: Literal["refuse", "leave out"] = "refuse"
    ) -> Model:
        """Return the model: system, parameters, and a consistent state at t = 0.

        Parameters
        ----------
        without : iterable of str
            Names of constraints to leave out because others imply them, such as ``"hinge: z"``.
        redundant : {"refuse", "leave out"}
            What to do with constraints that others imply; ``redundancy`` tells which they are.

        Raises
        ------
        InputError
            For constraints that depend on each other, with their names and a smallest set to
            leave out; for a start that cannot meet them.
        """
        if not self._bodies:
            raise InputError(f"Multibody {self.name!r} has no body; add one with body(...).")
        choose("redundant", redundant, ("refuse", "leave out"))
        left_out = {without} if isinstance(without, str) else {
            as_text("a constraint to leave out", name)
            for name in as_items("without", without, "constraints' names")}
        links = copies(self._links)  # placing completes them
        store = dict(self._values)
        store |= self._body_values()
        with in_range(f"Multibody {self.name!r}"):
            poses = self._poses([*links.values()])
            equations = self._equations([*links.values()], poses, store, left_out)
            q0, p0 = self._state(poses)
        coordinates = [x for body in self._bodies for x in body.coordinates]
        self.redundancy = find_redundant(self.name, NumericConstraints(
            coordinates, [e.expression for e in equations], [e.name for e in equations],
            store | {str(self.time): 0.0}), q0)
        if redundant == "refuse":
            self.redundancy.refuse()
        equations = [e for e in equations if e.name not in self.redundancy.left_out]
        pushes = [*self._pushes, *(push for link in links.values()
                                   for push in link.forces(poses, store))]
        H = self._hamiltonian([*links.values()], store)
        measures = {symbol: links[joint].measure(what, poses, store)
                    for symbol, (joint, what) in self._measures.items()}
        system = self._system(H, equations, pushes, measures, store, [*links.values()], poses)
        self.start = project(NumericSystem(system, store), q0, p0)
        bodies = {str(body.weight): moments for body, moments in self._inertia.items()}
        return Model(system, store, self.start.q, self.start.p, bodies, **self._about)

    def _poses(self, links: Sequence[Connection]) -> dict[Frame, Pose]:
        poses: dict[Frame, Pose] = {GROUND: Pose.ground()}
        poses |= {body: start.pose() for body, start in self._bodies.items()}
        for point in self._moving:
            poses[point] = Pose.ground()
            poses[point].x, poses[point].v = (
                np.array(part) for part in zip(*self.beginning(point), strict=True))
        joints = [link for link in links if isinstance(link, Joint)]
        settle(poses, "spin", [link.turn for link in links])
        settle(poses, "x", [joint.place for joint in joints])
        for joint in joints:
            if joint.on_a is None or joint.on_b is None:
                raise InputError(f"Joint {joint.name!r} does not say where it is; give at= in "
                                 "space, or on_a= and on_b= in body axes.")
        settle(poses, "v", [joint.move for joint in joints])
        return poses

    def _equations(
        self, links: Sequence[Connection], poses: Mapping[Frame, Pose], store: dict[str, float],
        without: set[str],
    ) -> list[Equation]:
        """Return the constraints, each with the later of its bodies."""
        order = {body: index for index, body in enumerate(self._bodies)}
        rows = {body: [Equation(f"{body.name}: unit quaternion", body.unit)] if body.q else []
                for body in self._bodies}
        for link in links:
            own = [frame for frame in link.frames if isinstance(frame, Body)]
            rows[max(own, key=order.__getitem__)] += link.equations(poses, store)
        found = [equation for body in self._bodies for equation in rows[body]]
        unknown = without - {equation.name for equation in found}
        if unknown:
            raise InputError(
                f"There is no constraint {min(unknown)!r} to leave out; the constraints are "
                f"{', '.join(repr(equation.name) for equation in found)}."
            )
        return [equation for equation in found if equation.name not in without]

    def _hamiltonian(self, links: Sequence[Connection], store: dict[str, float]) -> sp.Expr:
        terms = []
        for body in self._bodies:
            terms.append(body.kinetic_energy)
            terms.append(-body.mass * dot(self._gravity, body.centre_of_mass))
        terms += [link.energy(store) for link in links]
        return sp.Add(*terms, *self._potential)

    def _system(
        self, H: sp.Expr, equations: Sequence[Equation], pushes: Sequence[Push],
        measures: Mapping[sp.Symbol, sp.Expr], store: dict[str, float],
        links: Sequence[Connection], poses: Mapping[Frame, Pose],
    ) -> System:
        """Return the system; parameters that nothing uses are dropped from it and the store."""
        acting: dict[sp.Symbol, list[sp.Expr]] = {x: [] for xs, _ in pushes for x in xs}
        for xs, force in pushes:
            for x, e in zip(xs, force, strict=True):
                acting[x].append(e)
        named = set().union(*(e.free_symbols for e in (
            H, *(e for _, force in pushes for e in force), *self._quantities.values())))
        counted = {joint.name for symbol, (joint, what) in self._measures.items()
                   if symbol in named and what == "angle"}
        for link in links:
            if isinstance(link, Drive):
                counted |= {link.name, link.joints[0].name}
            elif isinstance(link, Coupling):
                counted |= {joint.name for joint, what in zip(link.joints, link.what, strict=True)
                            if what == "angle"}
        H = H.xreplace(measures)
        quantities = {name: e.xreplace(measures) for name, e in self._quantities.items()}
        q = tuple(x for body in self._bodies for x in body.coordinates)
        p = tuple(x for body in self._bodies for x in body.momenta)
        forces = tuple(sp.Add(*acting.get(x, ())).xreplace(measures) for x in p) if acting else ()
        constraints = tuple(equation.expression for equation in equations)
        used: set[sp.Symbol] = set().union(*(
            e.free_symbols for e in (H, *constraints, *forces, *quantities.values())))
        parameters = tuple(sorted(used - {*q, *p, self.time}, key=_by_first_use(store)))
        unknown = [s for s in parameters if str(s) not in store]
        if unknown:
            raise InputError(f"{str(unknown[0])!r} in Multibody {self.name!r} has no value; make "
                             "it with parameter(name, value) or input(name).")
        unfelt = [u for u in self._inputs if u not in used]
        if unfelt:
            raise InputError(f"Input {str(unfelt[0])!r} of Multibody {self.name!r} is in no force; "
                             "write it where it acts, or remove it.")
        kept, values = set(parameters), dict(store)
        for name in store.keys() - set(map(str, parameters)):
            del store[name]
        return System(
            q, p, parameters, H, constraints, name=self.name, forces=forces,
            constraint_names=tuple(equation.name for equation in equations),
            time=self.time if self.time in used else None, quantities=quantities,
            inputs=tuple(self._inputs),
            bodies=tuple(body_at(body, kept, values) for body in self._bodies if body.q),
            joints=tuple(joint_at(link, poses, [e.name for e in equations], kept, values,
                                  link.name in counted)
                         for link in links
                         if not any(isinstance(frame, Moving | Particle) for frame in link.frames)),
        )

    def _state(self, poses: Mapping[Frame, Pose]) -> tuple[Array, Array]:
        q: list[Array] = []
        p: list[Array] = []
        for body in self._bodies:
            pose = poses[body]
            if body.q:
                q.append(pose.q)
                p.append(pose.momenta(self._inertia[body]))
            if body.x:
                assert pose.x is not None
                assert pose.v is not None
                q.append(pose.x)
                p.append(self._values[str(body.mass)] * pose.v)
        return np.concatenate(q), np.concatenate(p)

    def _body_values(self) -> dict[str, float]:
        values: dict[str, float] = {}
        for body, inertia in self._inertia.items():
            numbers = np.ravel(inertia).tolist()
            values |= dict(zip(map(str, body.inertia), numbers, strict=True))
            if body.inverse:
                values |= dict(zip(map(str, body.inverse), inverse_entries(inertia), strict=True))
        return values

    # ------------------------------------------------------------ inside

    def _add(
        self, body: Body, start: Start, mass: float, inertia: Inertia, weight: float | None
    ) -> Body:
        self._values[str(body.mass)] = positive(f"mass of {body.name!r}", mass)
        mean = float(np.mean(moments_of(inertia)))
        self._values[str(body.weight)] = mean if weight is None else nonzero(
            f"{body.rep} of {body.name!r}", weight)
        self._inertia[body] = inertia
        self._bodies[body] = start
        return body


def _by_first_use(store: Mapping[str, float]) -> Any:
    order = {name: index for index, name in enumerate(store)}
    return lambda symbol: (order.get(str(symbol), len(order)), str(symbol))
