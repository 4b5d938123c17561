"""Accelerations of states, inverse dynamics and mass matrices: exact, by one linear solve.

    q̇ = v = H_p,   ṗ = F − H_q − g_qᵀ λ,   W λ = d/dt (g_q H_p + g_t) at λ = 0,   W = g_q H_pp g_qᵀ
    q̈ = H_pq v + H_pp ṗ + H_pt

Rates y = C(q) v of joints and bodies have the accelerations ẏ = C q̈ + (dC/dt) v, and forces τ on
them add Cᵀτ to ṗ, so that on the constraints

    ẏ(τ) = ẏ(0) + M⁻¹ τ,   M⁻¹ = C H_pp Cᵀ − C H_pp g_qᵀ W⁻¹ g_q H_pp Cᵀ

with M the mass matrix of the joints. (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 8;
Hairer-Lubich-Wanner, VII.1.2)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from ...core.arguments import count_text, shown, unknown
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.manifest import Manifest
from ...core.records import dataclass
from ..bindings.binding import REASONS, Binding
from ..bindings.run_memory import ParameterStruct
from ..compilation.body_columns import BodyAt, JointAt, bodies_of, joints_of, numbers
from ..rigid_body.quaternion import rotation_matrix

__all__ = ["Accelerations", "Kinematics", "Layout", "MotionBinding", "StateMotion",
           "joint_inertia"]

#: Condition of a scaled inverse mass matrix beyond which its rates depend on each other.
_DEPENDENT = 1e12


class MotionBinding:
    """Calls into the module of accelerations."""

    def __init__(self, binding: Binding, manifest: Manifest) -> None:
        """Take the compiled module, and the places of bodies and joints in a manifest."""
        self.module, self.layout = binding, Layout.of(manifest)
        self._size = int(binding.function("derivative_size")())

    def accelerations(
        self, parameters: ParameterStruct, q: Array, p: Array
    ) -> tuple[int, list[Array]]:
        """Return the status, and the arrays v = H_p, ṗ and q̈, (n,) each, and λ, (m,), of a state.

        A status other than 0 says that W has no inverse; the arrays then have no meaning.
        """
        binding = self.module
        memory, _owner = binding.bytes_at(self._size)
        arrays = [binding.new(binding.n), binding.new(binding.n), binding.new(binding.n),
                  binding.new(binding.m)]
        status = binding.function("accelerations")(
            parameters, binding.pointer(q), binding.pointer(p), *map(binding.pointer, arrays),
            memory)
        return int(status), arrays

    def inverse_mass(self, parameters: ParameterStruct, q: Array, p: Array) -> Array:
        """Return H_pp, (n, n), of a state, in doubles."""
        binding = self.module
        memory, _owner = binding.bytes_at(self._size)
        H_pp = binding.new(binding.n, binding.n)
        binding.function("inverse_mass")(parameters, binding.pointer(q), binding.pointer(p),
                                         binding.pointer(H_pp), memory)
        return H_pp.astype(float)

    def constraint_jacobian(self, parameters: ParameterStruct, q: Array, p: Array) -> Array:
        """Return g_q, (m, n), of a state, in doubles."""
        binding = self.module
        memory, _owner = binding.bytes_at(self._size)
        # the C returns ∂g and ∂f by (q, p, parameters, Δt, t)
        columns = 2 * binding.n + len(binding.parameter_names) + 2
        g, f = binding.new(binding.m, columns), binding.new(binding.m, columns)
        if binding.m:
            binding.function("constraint_derivatives")(
                parameters, binding.pointer(q), binding.pointer(p), binding.pointer(g),
                binding.pointer(f), memory)
        return g[:, : binding.n].astype(float)

    def quantity_rates(
        self, parameters: ParameterStruct, t: Any, q: Array, p: Array, dq: Array, dp: Array, dt: int
    ) -> dict[str, Any]:
        """Return A_q dq + A_p dp + A_t dt of each quantity A(q, p, t), name → number.

        dq and dp have the shape (n,); ``dt`` is 1 for a rate, and 0 at a fixed time.
        """
        binding = self.module
        if not binding.quantity_names:
            return {}
        rates, time, step = binding.new(len(binding.quantity_names)), binding.new(1), binding.new(1)
        time[0], step[0] = t, dt
        binding.function("quantity_rates")(
            parameters, *([binding.pointer(time)] if binding.quantities_take_time else []),
            *map(binding.pointer, (q, p, dq, dp, step, rates)))
        return dict(zip(binding.quantity_names, rates, strict=True))


@dataclass(frozen=True)
class Layout:
    """Where bodies and joints of a system are.

    Attributes
    ----------
    bodies, joints : dict
        By their names.
    slides : frozenset of str
        The joints that slide and do not turn.
    measures : dict of str to str
        Joint → the quantity of the system that is its rate, "hinge" → "hinge_rate".
    """

    bodies: dict[str, BodyAt]
    joints: dict[str, JointAt]
    slides: frozenset[str]
    measures: dict[str, str]

    @classmethod
    def of(cls, manifest: Manifest) -> Layout:
        """Return the layout that a manifest has."""
        system = manifest.system
        # the generator names quantities JOINT_speed along a slide, and JOINT_rate about a hinge
        measures = {name.removesuffix(f"_{kind}"): name for kind in ("speed", "rate")
                    for name in system.quantities if name.endswith(f"_{kind}")}
        # A slide is the joint whose constraints hold the rotation, or that has a speed and no rate:
        # of two quantities ``measures`` has the later one, the rate.
        slides = frozenset(name for name, joint in system.joints.items()
                           if f"{name}: turn" in joint.constraints
                           or measures.get(name, "").endswith("_speed"))
        return cls(bodies_of(manifest), joints_of(manifest), slides, measures)

    def is_joint(self, name: str) -> bool:
        """Return True for the name of a joint, False for the name of a body.

        Raises InputError for an unknown name, with the known ones.
        """
        joints = dict.fromkeys([*self.measures, *self.joints])
        if name not in joints and name not in self.bodies:
            if not joints and not self.bodies:
                raise InputError(f"The system has neither joints nor bodies, so no {shown(name)}; "
                                 "use the accelerations of its coordinates.")
            raise unknown("joint or body", name, [*joints, *self.bodies])
        return name in joints


class Kinematics:
    """Rates of bodies and joints at one q as rows C of y = C(q) v, with (dC/dt) v.

    C has the shape (rates, n), and v = dq/dt the shape (n,). The body "" is the ground.
    """

    def __init__(self, layout: Layout, parameters: Mapping[str, Any], q: Array) -> None:
        """Take the places of bodies and joints, numbers of parameters, and q, shape (n,)."""
        self.bodies, self.joints, self._slides = layout.bodies, layout.joints, layout.slides
        self._parameters, self._q = parameters, q.astype(float)

    def _rotation(self, body: str) -> Array:
        """Return R, (3, 3), from axes of the body to axes of space."""
        return rotation_matrix(self._q[self.bodies[body].q]) if body else np.eye(3)

    def _turning(self, body: str) -> Array:
        """Return the rows of ω = 2 Im(q̇ q̄) in space axes, (3, n), by a body's quaternion q.

        C is linear in q, so that its drift, 2 Im(q̇ q̇*), is 0 for the conjugate q̇*: ω' = C q̈.
        """
        rows = np.zeros((3, len(self._q)))
        if body:  # the ground does not turn
            columns = self.bodies[body].q
            w, x, y, z = self._q[columns]
            # q̇ q̄ written as a matrix of q times q̇, without its real row, q·q̇ = 0
            rows[:, columns] = 2 * np.array([[-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]])
        return rows

    def _point(self, body: str, r: Array, v: Array) -> tuple[Array, Array]:
        """Return rows C, (3, n), of the velocity ẋ + ω × R r of the point r of a body, and drift.

        r, (3,), is in axes of the body. The drift (dC/dt) v is ω × (ω × R r), shape (3,).
        """
        rows, turning = np.zeros((3, len(self._q))), self._turning(body)
        if not body:
            return rows, np.zeros(3)
        columns, arm = self.bodies[body].x, self._rotation(body) @ r
        if columns:  # a body whose origin is held has no x
            rows[:, columns] = np.eye(3)
        # the row of coordinate k is (∂ω/∂q̇_k) × R r
        rows += np.cross(turning.T, arm).T
        omega = turning @ v
        return rows, np.cross(omega, np.cross(omega, arm))

    def body(self, name: str, v: Array) -> tuple[Array, Array]:
        """Return rows C of a body's velocity and ω in space axes, and their drift (dC/dt) v.

        A body that moves freely has six rows, the first three of the velocity of its origin; a
        body whose origin is held has the three rows of ω. The drift has as many entries, 0 for ω
        (``_turning``).
        """
        turning, no_drift = self._turning(name), np.zeros(3)
        if not self.bodies[name].x:
            return turning, no_drift
        rows, drift = self._point(name, np.zeros(3), v)
        return np.vstack([rows, turning]), np.concatenate([drift, no_drift])

    def joint(self, name: str, v: Array) -> tuple[Array, Array]:
        """Return the row C, (1, n), of a joint's rate about its axis, or speed along it, and drift.

        The drift (dC/dt) v has the shape (1,). With the axis a in space, which turns with ω_a of
        the joint's body a, and the relative angular or linear velocity u of its bodies, the rate is
        a·u, and the drift a·(drift of u) + (ω_a × a)·u. Raises InputError for a joint without an
        axis that its bodies keep in common.
        """
        layout = self.joints[name]
        if not layout.axis_b:
            raise InputError(f"Joint {name!r} has no axis that its bodies keep in common, so no "
                             "one acceleration; ask for those of its bodies.")
        # the manifest has two unit vectors normal to the axis, in axes of body a
        normals = numbers(layout.axis_a, self._parameters)
        axis = self._rotation(layout.a) @ np.cross(normals[:3], normals[3:])
        axis_rate = np.cross(self._turning(layout.a) @ v, axis)
        if name not in self._slides:
            rows, drift = self._turning(layout.b) - self._turning(layout.a), np.zeros(3)
        else:
            rows_a, drift_a = self._point(layout.a, numbers(layout.on_a, self._parameters), v)
            rows_b, drift_b = self._point(layout.b, numbers(layout.on_b, self._parameters), v)
            rows, drift = rows_b - rows_a, drift_b - drift_a
        return (axis @ rows)[None], np.array([axis @ drift + axis_rate @ (rows @ v)])


class RateRows(NamedTuple):
    """The rates y of a joint or a body in a state, linear in q̇."""

    rows: Array  # C = ∂y/∂q̇, shape (rates, n); C H_pp = ∂y/∂p if ``by_momentum``
    y_rate: Array  # ẏ, shape (rates,)
    by_momentum: bool


class StateMotion:
    """Motion at one state: accelerations, H_pp, g_q, and rates of joints and bodies by name."""

    def __init__(
        self, binding: MotionBinding, values: Mapping[str, Any], t: Any, q: Array, p: Array,
    ) -> None:
        """Solve for v, ṗ, q̈ and λ at (q, p, t); raise InputError if W is singular there."""
        self._binding, self._t, self._q, self._p = binding, t, q, p
        self._parameters = binding.module.parameters(dict(values), t)
        self._kinematics = Kinematics(binding.layout, values, q)
        status, (self.v, self.p_rate, self.acceleration, self.multipliers) = (
            binding.accelerations(self._parameters, q, p))
        if status:
            raise InputError(f"The multipliers of the state q = {shown(q)} have no solution: "
                             f"{REASONS[status]}. Its constraints depend on each other there; move "
                             "it, or leave some out.")

    def inverse_mass(self) -> Array:
        """Return H_pp, shape (n, n), in doubles."""
        return self._binding.inverse_mass(self._parameters, self._q, self._p)

    def constraint_jacobian(self) -> Array:
        """Return g_q, shape (m, n), in doubles."""
        return self._binding.constraint_jacobian(self._parameters, self._q, self._p)

    def quantity_rates(self) -> dict[str, Any]:
        """Return the time derivative of each quantity, name → number."""
        return self._along(self.v, self.p_rate, dt=1)

    def rate(self, name: str) -> RateRows:
        """Return the rates y = C q̇ of a joint or a body as rows of C, with ẏ = C q̈ + Ċ q̇.

        A joint without an axis that its bodies keep in common may have a quantity of the system as
        its rate: then the row is ∂y/∂p = C H_pp. Raises InputError for an unknown name, with the
        known ones, and for a joint without an axis.
        """
        binding, layout = self._binding.module, self._binding.layout
        is_joint, v = layout.is_joint(name), self.v.astype(float)
        has_axis = name in layout.joints and bool(layout.joints[name].axis_b)
        # without an axis in common there is no C(q): derivatives of the quantity by each momentum
        if name in layout.measures and not has_axis:
            quantity, no_dq, by_momenta = layout.measures[name], binding.new(binding.n), []
            for k in range(binding.n):
                dp = binding.new(binding.n)
                dp[k] += 1
                by_momenta.append(float(self._along(no_dq, dp, dt=0)[quantity]))
            y_rate = float(self.quantity_rates()[quantity])
            return RateRows(np.array([by_momenta]), np.array([y_rate]), by_momentum=True)
        kinematics = self._kinematics
        rows, drift = kinematics.joint(name, v) if is_joint else kinematics.body(name, v)
        return RateRows(rows, rows @ self.acceleration.astype(float) + drift, by_momentum=False)

    def _along(self, dq: Array, dp: Array, dt: int) -> dict[str, Any]:
        """Return the derivative of each quantity along (dq, dp, dt)."""
        return self._binding.quantity_rates(self._parameters, self._t, self._q, self._p, dq, dp, dt)


def joint_inertia(motion: StateMotion, names: Sequence[str]) -> tuple[Array, list[Array]]:
    """Return the mass matrix M of the rates y of joints and bodies, and ẏ of each name.

        M⁻¹ = C (H_pp − H_pp Gᵀ (G H_pp Gᵀ)⁻¹ G H_pp) Cᵀ

    M has the shape (rates, rates), with the rates of all names one after another. Raises
    InputError for unknown names, and for rates that depend on each other.
    """
    H_pp, G = motion.inverse_mass(), motion.constraint_jacobian()
    rates = [motion.rate(name) for name in names]
    # rows by p are C H_pp, and H_pp is symmetric: C = rows H_pp⁻¹ = (H_pp⁻¹ rowsᵀ)ᵀ
    C = np.vstack([_solve(H_pp, rate.rows.T, names).T if rate.by_momentum else rate.rows
                   for rate in rates])
    C_H = C @ H_pp
    C_H_G = C_H @ G.T
    mobility = C_H @ C.T
    if len(G):
        mobility = mobility - C_H_G @ _solve(G @ H_pp @ G.T, C_H_G.T, names)
    # rates have different units: scaled to a unit diagonal, the condition number has none
    scale = np.sqrt(np.abs(np.diag(C_H @ C.T)))
    scaled = mobility / np.outer(scale, scale)
    if not np.isfinite(scaled).all() or np.linalg.cond(scaled) > _DEPENDENT:
        raise InputError(f"The rates of {', '.join(names)} depend on each other on the "
                         "constraints, so that no force on them follows from accelerations; leave "
                         "one out.")
    mass = np.linalg.inv(scaled) / np.outer(scale, scale)
    # symmetric but for round-off
    return (mass + mass.T) / 2, [rate.y_rate for rate in rates]


def _solve(A: Array, b: Array, names: Sequence[str]) -> Array:
    """Return A⁻¹ b for A of shape (k, k) and columns b.

    Raises InputError, which names the bodies and joints of ``names``, if A is singular.
    """
    try:
        x: Array = np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        raise InputError(f"The mass matrix of {', '.join(names)} does not exist: H_pp or "
                         "g_q H_pp g_qᵀ is singular at this state.") from None
    return x


@explain_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Accelerations:
    """Accelerations of states; made by ``Stepper.accelerations``. Leading axes as of q.

    Attributes
    ----------
    q : array, shape (..., n)
        d²q/dt² of the coordinates.
    p : array, shape (..., n)
        dp/dt of the momenta, with the forces of the constraints.
    velocities : array, shape (..., n)
        dq/dt.
    multipliers : array, shape (..., m)
        λ in dp/dt = F − H_q − g_qᵀ λ.
    quantities : dict of str to array, shape (...)
        The time derivative of each quantity of the system.
    """

    q: Array
    p: Array
    velocities: Array
    multipliers: Array
    quantities: dict[str, Array]
    _layout: Layout
    _parameters: Mapping[str, Any]
    _states: Array  # q of the states, a row each

    def __repr__(self) -> str:
        return (f"<Accelerations of {count_text(len(self._states), 'state')}, {self.q.shape[-1]} "
                "coordinates>")

    def joint(self, name: str) -> Any:
        """Return d²θ/dt² of a hinge in rad/s², or d²s/dt² of a slide in m/s², shape (...).

        A cylindrical joint or a screw counts as a hinge, or as a slide where the system has the
        quantity NAME_speed and no NAME_rate.

        Raises
        ------
        InputError
            For an unknown name, and a joint that has neither angle nor travel.
        """
        if not self._layout.is_joint(name):
            raise InputError(f"{shown(name)} is a body; ask for body({name!r}).")
        if name in self._layout.measures:
            return self.quantities[self._layout.measures[name]]
        return self._accelerations(name, "joint")[..., 0][()]  # a number for one state

    def body(self, name: str) -> tuple[Array, Array]:
        """Return the acceleration of a body's origin and dω/dt, in space axes, shapes (..., 3).

        The origin is the centre of mass of a body that moves freely; held, it has none: zeros.

        Raises
        ------
        InputError
            For an unknown name, with the known ones.
        """
        if name not in self._layout.bodies:
            self._layout.is_joint(name)  # raises for an unknown name
            raise InputError(f"{shown(name)} is a joint; ask for joint({name!r}).")
        rows = self._accelerations(name, "body")
        angular = rows[..., -3:]
        return (rows[..., :3] if rows.shape[-1] == 6 else 0 * angular), angular

    def _accelerations(self, name: str, kind: str) -> Array:
        """Return C q̈ + (dC/dt) v of a joint or a body at each state, shape (..., rates).

        ``kind`` is "joint", with 1 rate, or "body", with 6, or 3 where its origin is held.
        """
        n, accelerations = self.q.shape[-1], []
        width = 6 if kind == "body" else 1  # of an array without states
        velocities = self.velocities.reshape(-1, n).astype(float)
        coordinate_accelerations = self.q.reshape(-1, n).astype(float)
        for q, v, a in zip(self._states, velocities, coordinate_accelerations, strict=True):
            kinematics = Kinematics(self._layout, self._parameters, q)
            rows, drift = (kinematics.joint if kind == "joint" else kinematics.body)(name, v)
            accelerations.append(rows @ a + drift)
            width = len(drift)
        return np.array(accelerations).reshape(*self.q.shape[:-1], width)
