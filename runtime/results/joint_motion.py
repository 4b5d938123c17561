"""One joint of a trajectory: its point, its angle, and the force and torque in it."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...core.arguments import as_flag, choose, count_text
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.html import card, table
from ...core.incompatibilities import refuse_together
from ...core.inertia import quaternion_product
from ...core.records import FixedAttributes
from ...core.warnings import warn
from ..compilation.body_columns import JointAt, Pull, numbers
from ..rigid_body.quaternion import left_matrix
from .body_motion import rotate

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = ["JointMotion", "cotangents_of_multipliers", "multipliers_at_states",
           "refuse_single_state", "shortest_rotation"]

_UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
#: Rad by which a rotation between two states may differ from one at a constant rate.
_STEADY = 0.5


@explain_arguments
class JointMotion(FixedAttributes):
    """One joint between two bodies a and b; made by ``Trajectory.joint``.

    Force and torque are exerted by a on b; b exerts the opposite on a. Every array has a row for
    each stored state.

    Attributes
    ----------
    name : str
        The joint's.
    bodies : tuple of two str
        The names of a and b; ``""`` is the ground.
    """

    _CURE = "it shows what the run has"

    name: str
    bodies: tuple[str, str]

    def __init__(self, trajectory: Trajectory, name: str, at: JointAt) -> None:
        self.name, self.bodies = name, (at.a, at.b)
        self._run, self._layout = trajectory, at

    def __repr__(self) -> str:
        body_names = ", ".join(name or "ground" for name in self.bodies)
        return f"<JointMotion of {self.name} ({body_names}): {count_text(len(self._run), 'state')}>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the bodies and the states."""
        return card(f"Joint {self.name} of {self._run.manifest.name}", table([
            *zip("ab", (name or "ground" for name in self.bodies), strict=True),
            *self._run._extent()]))

    def position(self) -> Array:
        """Return the joint's point on b in space, shape (N+1, 3), in m.

        Raises
        ------
        InputError
            For a joint that has no point on b: an axis alone, a moving point.
        """
        return self._point("b")

    # ------------------------------------------------------------ angle

    def angle(self, *, degrees: bool = False) -> Array:
        """Return by how much b is turned against a about their axis, shape (N+1,), in rad.

        The angle increases with rotation of b about the joint's axis, without jumps at full turns.
        If the model uses the angle, in a spring, a motor, a drive, a coupling or a quantity, it is
        that angle: at the model's start the value of ``angle=``, 0 by default, or of the drive's
        law; of a screw 2π times its travel by its lead. Otherwise it is 0 where the axes of both
        bodies agree; if the axis has different components in a and b, where the axes of b are those
        of a after the shortest rotation of one axis onto the other. It then lies in (−π, π] in the
        first state.

        Whole turns between two stored states follow from the mean of their rates. A warning is
        given where they are ambiguous: b turns by more than half a turn at a changing rate. A
        rotation that starts and stops between two states is not seen.

        Raises
        ------
        InputError
            For a joint without such an axis.
        """
        unit = np.degrees(1.0) if as_flag("degrees", degrees) else 1.0
        if self._is_measured("angle"):
            return self._run.quantity(f"{self.name}_angle") * unit
        n1, n2, e, axis_in_b = self._axes()
        turn: Array = (self._model_angle(n1, n2) if self._layout.zero
                       else self._plane_angle(n1, n2, axis_in_b))
        # whole turns between two states are those of the mean of their rates
        t, rate = self._run.t.astype(float), self._rate(e)
        mean_turn = np.concatenate([[0.0], np.cumsum(np.diff(t) * (rate[1:] + rate[:-1]) / 2)])
        turn = np.unwrap(turn - mean_turn) + mean_turn
        self._warn_of_turns(np.diff(t), rate, np.diff(turn - mean_turn))
        return turn * unit

    def _model_angle(self, n1: Array, n2: Array) -> Array:
        """Return the model's angle θ = 2 atan2(v, w) + turns up to 4π, shape (N+1,), in rad.

        (w, v e) = q̄_a q_b c with e = n₁ × n₂ in a; c and ``turns`` are ``zero`` of the joint.
        """
        *c, turns = numbers(self._layout.zero, self._run.parameters)
        q_a, q_b = self._attitudes()
        x = np.stack(quaternion_product(q_b.T, c), axis=-1)
        # q̄_a x has the scalar q_a·x and the vector L(q_a) x
        w = (q_a * x).sum(1)
        v = (left_matrix(q_a) @ x[..., None])[..., 0] @ np.cross(n1, n2)
        turn: Array = turns + 2 * np.arctan2(v, w)
        return turn

    def _plane_angle(self, n1: Array, n2: Array, axis_in_b: Array) -> Array:
        """Return the angle in (−π, π] of b's image of n₁ in the plane of n₁ and n₂, shape (N+1,).

        a carries the plane; the image is n₁ after the shortest rotation of the axis in a onto the
        axis in b.
        """
        q_a, q_b = self._attitudes()
        image = rotate(q_b, shortest_rotation(np.cross(n1, n2), axis_in_b, n1) @ n1)
        turn: Array = np.arctan2((rotate(q_a, n2) * image).sum(1),
                                 (rotate(q_a, n1) * image).sum(1))
        return turn

    def _is_measured(self, measure: str) -> bool:
        """Whether a quantity NAME_angle or NAME_rate of the system is the measure of the joint.

        Joints in series have such quantities in place of a common axis.
        """
        return not self.has_axis and f"{self.name}_{measure}" in self._run.quantities

    def _warn_of_turns(self, spans: Array, rate: Array, excess_turn: Array) -> None:
        """Warn if stored states are too far apart to count whole turns from their rates.

        ``spans``, (N,), are the times between states, ``rate``, (N+1,), the rates at states, and
        ``excess_turn``, (N,), the rotations of b less those at the mean of the rates.
        """
        if not len(spans):
            return
        # a turn by less than π has one angle, whatever the rates are
        ambiguous = np.abs(spans) * np.abs(rate).max() > np.pi
        steady = (np.abs(spans * np.diff(rate)) < _STEADY) & (np.abs(excess_turn) < _STEADY)
        if (ambiguous & ~steady).any():
            between = np.abs(spans[ambiguous & ~steady]).max()
            longest_interval = np.pi / 2 / np.abs(rate).max()
            warn(f"joint({self.name!r}).angle() counts whole turns by the rates of the stored "
                 f"states, and these are up to {between:.3g} s apart where it turns by up to "
                 f"{np.abs(rate).max():.3g} rad/s: it may be off by multiples of 2π. Store a "
                 f"state every {longest_interval:.2g} s or less, by a smaller every, or ask for "
                 "the angle of run.at(times).")

    def rate(self) -> Array:
        """Return the angular velocity of b against a about their axis, shape (N+1,), in rad/s.

        Raises the same errors as ``angle``.
        """
        if self._is_measured("rate"):
            return self._run.quantity(f"{self.name}_rate")
        return self._rate(self._axes()[2])

    def _rate(self, e: Array) -> Array:
        """Return (ω_b − ω_a)·e, shape (N+1,), with the axis e in space, a row a state."""
        # the ground, "", does not turn
        omega = np.zeros((*self._run.q.shape[:-1], 3))
        for name, sign in zip(self.bodies, (-1, 1), strict=True):
            if name:
                omega = omega + sign * self._run.body(name).angular_velocity("space")
        rate: Array = (omega * e).sum(axis=-1)
        return rate

    # ------------------------------------------------------------ reactions

    def force(self, frame: str = "space") -> Array:
        """Return the force that a exerts on b at the joint, shape (N+1, 3), in N.

        It is made of the constraints' multipliers, which a run has at nodes of its steps. SPARK
        schemes have them at both ends of a step: a state takes the mean of the two steps that meet
        there, the first and the last state take what their one step has. IMS and EMS have one for
        the middle of a step: a state takes the mean as well, and the first and the last go on from
        their neighbours in a straight line. Errors fall as Δt^s with G-L of s stages, as Δt^(s−1)
        with LIIIA-B and Radau-L, as Δt² with IMS and EMS: more slowly than those of the motion.
        A last state between two steps, at ``t_end`` or an event, takes the force of its own step.
        Where the states are not those after every step (``every`` > 1, ``t_eval``, ``at``), each
        takes the force of the step that ends there, to the first order with IMS and EMS, and the
        first is NaN. Where some constraints of a joint were left out because others imply them, it
        is the force of the remaining ones.

        Parameters
        ----------
        frame : str
            ``"space"``, or the name of a or b: the axes in which components are given.

        Raises
        ------
        InputError
            For another frame; for a joint of whose constraints it is not known how they act; for a
            run of one state, without the step to it.
        """
        force, _ = self._reaction()
        return self._in(frame, force)

    def torque(self, frame: str = "space") -> Array:
        """Return the torque that a exerts on b, about the joint's point on b, (N+1, 3), in N m.

        Takes the same argument as ``force``, with the same errors and the same accuracy.
        """
        _, torque = self._reaction()
        return self._in(frame, torque)

    def _reaction(self) -> tuple[Array, Array]:
        """Return force and torque Gᵀλ on b in space, shape (rows, 3) each, in N and N m."""
        if self._layout.pulls is None:
            raise InputError(f"The force and the torque of {self.name!r} are not known: it "
                             "acts on more than its two bodies, as a gear does, is of your own "
                             "class without a Pull, or a slide of a stepper of an earlier version. "
                             "Its multipliers are in run.multipliers.")
        refuse_single_state(self._run, self.name)
        force, torque = (np.zeros((len(self._run), 3)) for _ in range(2))
        multipliers = multipliers_at_states(self._run).astype(float)
        for pull in self._layout.pulls:
            factor = multipliers[:, pull.index, None]
            along = self._direction(pull)
            if pull.kind in ("torque", "axial"):
                torque = torque + factor * along
            elif pull.kind == "thread":  # a turn by 2π moves b along the axis by the lead
                lead, = numbers(pull.on_b, self._run.parameters)
                torque, force = torque - factor * along, force + factor * along * 2 * np.pi / lead
            else:  # its line of action is through the joint's point on b: no torque about it
                force = force + factor * along
        return force, torque

    def _direction(self, pull: Pull) -> Array:
        """Return the force or torque on b of a multiplier of 1 in space axes, (N+1, 3) or (1, 3).

        It is minus the derivative of the constraint g by the displacement or rotation of b; of a
        thread it is the axis of both.
        """
        if pull.kind == "distance":  # g = |d|² − l² with d from a to b
            return 2 * (self._point("a") - self._point("b"))
        on_a = numbers(pull.on_a, self._run.parameters)
        if pull.kind == "force":  # along a fixed direction in space
            return on_a[None]
        q_a, q_b = self._attitudes()
        if pull.kind in ("axial", "thread"):  # about an axis of a
            return rotate(q_a, on_a)
        if pull.kind == "normal":  # g = n·d of a normal n of a
            return -rotate(q_a, on_a)
        # g = u·v of a unit vector u of a and v of b, at right angles: the torque is u × v
        on_b = numbers(pull.on_b, self._run.parameters)
        return np.cross(rotate(q_a, on_a), rotate(q_b, on_b))

    @property
    def has_axis(self) -> bool:
        """Whether a and b keep an axis in common, and so have an angle."""
        return bool(self._layout.axis_b)

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw its angle, where it has one, and force and torque in it against time.

        Returns a matplotlib figure, which Jupyter shows; .png, .svg or .pdf where a path is given.
        """
        from ..plotting.motion_plots import draw_joint  # matplotlib is optional

        return draw_joint(self, self._run, path)

    # ------------------------------------------------------------ inside

    def _point(self, side: Literal["a", "b"]) -> Array:
        """Return the joint's point on a or b in space, (N+1, 3): those of a rod and a slide differ.

        Raises InputError for a joint without a point there.
        """
        layout = self._layout
        body, r = (layout.a, layout.on_a) if side == "a" else (layout.b, layout.on_b)
        if not r:
            raise InputError(f"Joint {self.name!r} has no point on {repr(body) if body else side}: "
                             "it keeps an axis in common, or is at a moving point.")
        point = numbers(r, self._run.parameters)
        return self._run.body(body).position(point) if body else np.broadcast_to(
            point, (*self._run.q.shape[:-1], 3))

    def _attitudes(self) -> tuple[Array, Array]:
        """Return the quaternions of a and b as doubles, (N+1, 4); (1, 0, 0, 0) of the ground."""
        q_a, q_b = (self._run.body(name).attitude.astype(float) if name else
                    np.broadcast_to(_UNTURNED, (*self._run.q.shape[:-1], 4))
                    for name in self.bodies)
        return q_a, q_b

    def _axes(self) -> tuple[Array, Array, Array, Array]:
        """Return n₁ and n₂ in a, e = n₁ × n₂ in space, and the axis in b.

        e has the shape (N+1, 3), the others (3,). Raises InputError for a joint without an axis.
        """
        if not self.has_axis:
            raise InputError(f"Joint {self.name!r} has no axis that its bodies keep in common, so "
                             "no angle; those of revolute and align have.")
        normals = numbers(self._layout.axis_a, self._run.parameters)
        n1, n2 = normals[:3], normals[3:]
        e = rotate(self._attitudes()[0], np.cross(n1, n2))
        return n1, n2, e, numbers(self._layout.axis_b, self._run.parameters)

    def _in(self, frame: str, vectors: Array) -> Array:
        """Return vectors in space axes, (N+1, 3), in those of ``frame``: "space" or a body."""
        choose(f"frame of joint {self.name!r}", frame, ["space", *filter(None, self.bodies)])
        if frame == "space":
            return vectors
        conjugate = self._run.body(frame).attitude * np.array([1, -1, -1, -1])
        return rotate(conjugate, vectors)


def refuse_single_state(run: Trajectory, name: str) -> None:
    """Refuse forces in a joint or a beam of a run of one state, which has no step to it."""
    if len(run) == 1:
        raise InputError(f"The force in {name!r} follows from multipliers of steps, and this run "
                         "has one state and no step to it; take a row of the forces of a run that "
                         "has the state before, as force()[-1:].")


def multipliers_at_states(trajectory: Trajectory) -> Array:
    """Return λ of every constraint at each stored state, shape (N+1, m).

    A state takes the mean of the ends of the two steps that meet there; the first and the last
    state take that of their one step. Schemes with one multiplier a step, in its middle,
    extrapolate there: λ_0 = 2 λ_1 − λ_2. A last state between two steps takes the end of its own
    step; the states before it are treated as a run of whole steps. If states of steps are missing,
    or an impact follows within the next step, a state takes the end of its step, the first state
    NaN.
    """
    step_multipliers = _multipliers_of_steps(trajectory)
    state_multipliers = np.full((len(trajectory), step_multipliers.shape[2]), np.nan,
                                step_multipliers.dtype)
    if not len(step_multipliers):
        return state_multipliers
    at_begin, at_end = step_multipliers[:, 0], step_multipliers[:, -1]
    clock = trajectory.manifest.system.clock
    if clock is not None:  # those of H in scaled time are σ times those of H
        scale = trajectory.quantity(clock.scale)[:, None]
        at_begin, at_end = at_begin / scale[:-1], at_end / scale[1:]
    state_multipliers[1:] = at_end
    steps = _whole_steps(trajectory)
    if steps:
        after_steps = state_multipliers[: steps + 1]
        after_steps[1:-1] = (at_end[: steps - 1] + at_begin[1:steps]) / 2
        after_steps[0] = at_begin[0]
        if step_multipliers.shape[1] == 1 and steps > 2:
            # one multiplier a step, in its middle, to which the scheme adds a term of alternating
            # sign: means of neighbours are without it, the first and last multiplier are not
            for end, neighbour, second_neighbour in ((0, 1, 2), (-1, -2, -3)):
                after_steps[end] = 2 * after_steps[neighbour] - after_steps[second_neighbour]
        # a step with an impact has the multipliers after it, which the state before has not yet
        before = _rows_before_impacts(trajectory)
        state_multipliers[before] = at_end[before - 1]
        state_multipliers[before[before == 0]] = np.nan
    return state_multipliers


def cotangents_of_multipliers(trajectory: Trajectory, w: Array) -> Array:
    """Return the transpose of ``multipliers_at_states`` applied to w, shape (N+1, m).

    Its steps are transposed in the reverse order: λ_0 = 2 λ_1 − λ_2 becomes w_1 += 2 w_0,
    w_2 −= w_0, w_0 = 0; the mean of two ends gives half of w to each.
    Raises InputError if a state after a step is missing: the first state then has no multipliers.
    """
    refuse_together(joint_gradients="gradients of forces in joints",
                    scaled=trajectory.manifest.system.clock is not None and "a time_scale")
    step_multipliers, w = _multipliers_of_steps(trajectory), w.copy()
    steps = _whole_steps(trajectory)
    if not steps:
        raise InputError("A function of multipliers at states needs the state after every step; "
                         "integrate with every = 1, or give cotangents of \"multipliers\".")
    # products with 0, here and below, are zeros of any number type, mpmath's too
    cotangents: Array = 0 * step_multipliers
    before = _rows_before_impacts(trajectory)
    cotangents[before[before > 0] - 1, -1] += w[before[before > 0]]
    w[before] = 0 * w[before]
    cotangents[steps:, -1] += w[steps + 1 :]  # of a last state between two steps
    after_steps, of_steps = w[: steps + 1], cotangents[:steps]
    if step_multipliers.shape[1] == 1 and steps > 2:
        for end, neighbour, second_neighbour in ((0, 1, 2), (-1, -2, -3)):
            after_steps[neighbour] += 2 * after_steps[end]
            after_steps[second_neighbour] -= after_steps[end]
            after_steps[end] = 0 * after_steps[end]
    of_steps[:-1, -1] += after_steps[1:-1] / 2
    of_steps[1:, 0] += after_steps[1:-1] / 2
    of_steps[0, 0] += after_steps[0]
    of_steps[-1, -1] += after_steps[-1]
    return cotangents.reshape(trajectory.multipliers.shape)


def _multipliers_of_steps(trajectory: Trajectory) -> Array:
    """Return the multipliers of each step, shape (N, nodes, m), in doubles or a wider type."""
    m = len(trajectory.manifest.system.constraints)
    multipliers = trajectory.multipliers
    multipliers = multipliers.astype(float) if multipliers.dtype == np.float32 else multipliers
    return multipliers.reshape(len(multipliers), trajectory.manifest.scheme.multipliers, m)


def _rows_before_impacts(trajectory: Trajectory) -> Array:
    """Return the rows of the states from which a step with an impact starts, each once."""
    return np.unique(np.concatenate([np.zeros(0, int), *(
        impacts.steps for impacts in trajectory.impacts.values())]))


def _whole_steps(trajectory: Trajectory) -> int:
    """Return the number of steps of a run whose states a trajectory has all; 0 if one is missing.

    Behind these it may have one more state, at which the run ends between two steps.
    """
    scaled, steps = trajectory.manifest.system.clock is not None, trajectory.report.steps
    t = (trajectory.tau if scaled else trajectory.t).astype(float)[: steps + 1]
    dt = float(trajectory.dt)
    is_complete = len(t) == steps + 1 and len(trajectory) <= steps + 2 and bool(
        (np.abs(t - t[0] - dt * np.arange(len(t))) < 1e-3 * abs(dt)).all())
    return steps if is_complete else 0


def shortest_rotation(a: Array, b: Array, normal: Array) -> Array:
    """Return the shortest rotation that takes the unit vector a to b, R = 1 + V + V²/(1 + c).

    V is the matrix of v × with v = a × b, and c = a·b. If a and b are opposite, all half turns from
    a to b are equally short; it turns about ``normal``, a unit vector at right angles to a.
    """
    v, c = np.cross(a, b), float(a @ b)
    if c < -1 + 1e-12:
        return 2 * np.outer(normal, normal) - np.eye(3)
    V = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    R: Array = np.eye(3) + V + V @ V / (1 + c)
    return R
