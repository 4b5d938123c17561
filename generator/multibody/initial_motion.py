"""The start of a multibody model: given coordinates and velocities are kept, others are free.

Positions, attitudes and axes describe a pose in which all angles and travels of joints are 0. The
bodies are moved from there along a spanning tree of the joints. Loops that this opens are closed by

    min |r(q)|   subject to  g(q) = 0            r: how far given angles and travels are off

in steps from the description to the start, so that its assembly mode is kept. Velocities solve

    min |D u − d|,  then  min |S (u − u₀)|,   subject to  g_q H_p(q, B u) + g_t = 0,  A H_p + a = 0

with u the velocities of all bodies, D u = d the given velocities, u₀ the velocities along the tree,
p = B u, and |S u|² twice the kinetic energy. Both problems are solved by Gauss-Newton steps in the
null space of the constraints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import sympy as sp

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import Inertia, inertia_matrix
from ...core.projection import as_dense, project_momenta
from ...core.records import dataclass
from ...core.warnings import warn
from ..systems.numeric_system import NumericConstraints, NumericSystem
from .body import Body, Frame
from .coordinates import BallFlywheel, Coordinate, FlywheelBody
from .initial_poses import InitialState, Pose
from .joints import (
    FRACTION,
    Align,
    Connection,
    Cylindrical,
    HingedJoint,
    Joint,
    Rod,
    StartRate,
    StartValue,
)

__all__ = ["Velocities", "close_loops", "move_bodies", "warn_of_moved_bodies",
           "warn_of_moved_joints"]

EPS = float(np.finfo(float).eps)

#: Round-off of a solution, relative to its size, for equations with a condition of some thousands.
ROUNDING = 4096 * EPS
#: Largest relative correction of given numbers, with a warning: they have three digits or more.
TYPED = 1e-3
#: Stages from the description to the start, after each of which loops are closed.
_PARTS = 32
#: Gauss-Newton steps of a stage at most, and the largest change of a coordinate in a step.
_STEPS = 60
_LONGEST = 0.3
#: Gauss-Newton steps for velocities at most.
_VELOCITY_STEPS = 20
#: Singular values below this, relative to the largest, count as zero.
_RANK = 1e-10


def move_bodies(links: Sequence[Connection], poses: Mapping[Frame, Pose]) -> dict[Frame, Pose]:
    """Return poses at the start: each joint of a spanning tree moves the bodies beyond it.

    The tree grows from the ground outward, along joints with given coordinates first; bodies that
    only rods join move with these. With the motion M_a of the body before a joint and its own
    motion J in the described pose, the next body moves by M_b = M_a J.
    """
    # False sorts before True: joints with given coordinates come first
    joints = sorted((link for link in links if isinstance(link, Joint | Align)),
                    key=lambda link: not any(link.start_values(poses, store={})))
    rods = [link for link in links if isinstance(link, Rod)]
    start = {frame: pose for frame, pose in poses.items() if not isinstance(frame, Body)}
    bodies = [frame for frame in poses if isinstance(frame, Body)
              and not isinstance(frame, FlywheelBody)]
    while any(body not in start for body in bodies):
        # the next link of the tree has one end that is placed
        joint = next((link for link in (*joints, *rods) if (link.a in start) != (link.b in start)),
                     None)
        if joint is None:
            # no joint leads on: a floating body, or the first of a group, stays as described, in a
            # copy, as the velocities of a pose are set later
            root = next(body for body in bodies if body not in start)
            start[root] = replace(poses[root])
            continue
        motion, origin, body = joint.motion(poses), joint.a, joint.b
        if joint.b in start:
            motion, origin, body = motion.inverse(), joint.b, joint.a
        assert isinstance(body, Body)
        start[body] = poses[body].after(start[origin].motion @ motion, is_held=not body.x)
    # flywheels and joints of chains have a coordinate in place of a pose
    for link in links:
        if isinstance(link, Coordinate):
            x = poses[link.b].x
            assert x is not None
            start[link.b] = replace(poses[link.b], x=x + link.displacement)
        elif isinstance(link, BallFlywheel):
            start[link.b] = replace(poses[link.b])
            link.begin(start)
    return {frame: start[frame] for frame in poses}


def close_loops(
    constraints: NumericConstraints, targets: Sequence[StartValue], described: Array, start: Array
) -> Array:
    """Return coordinates q, shape (n,), on the constraints with the given angles and travels.

    Parameters
    ----------
    targets : sequence of StartValue
        The given angles and travels; there is at least one.
    described, start : ndarray, shape (n,)
        Coordinates of the described pose, and after ``move_bodies``.

    Raises
    ------
    InputError
        For angles and travels that contradict the constraints, with the nearest possible ones.
    """
    # sin and cos of (angle − target); in place of the sine (travel − target): 0 if targets are met
    sines, cosines = _sines_and_cosines(constraints.symbols, constraints.values, targets)
    tolerance = ROUNDING * max(float(np.abs(start).max()), 1.0)
    if max(np.abs(constraints.g(start)).max(initial=0.0),
           np.abs(sines.g(start)).max()) <= tolerance:
        return start
    # The start of the tree may belong to another assembly mode. Therefore the given values grow in
    # small parts from those of the description, and the loops are closed after each.
    q = described
    for stage in range(_PARTS + 1):
        sines.set_value(FRACTION, stage / _PARTS)
        q = _minimise_on_constraints(constraints, sines, q)
    g = np.abs(constraints.g(q))
    if not g.max(initial=0.0) <= tolerance:
        label = constraints.constraint_names[int(np.argmax(g))]
        raise InputError(f"No start with the given angles and travels of joints meets {label!r}: "
                         f"it stays at |g| = {g.max():.3e}; leave out some of them.")
    offsets = _offsets(targets, sines, cosines, q)
    if max(map(abs, offsets)) <= tolerance:
        return q
    nearest = _list_nearest(targets, offsets)
    # numbers typed with few digits are moved to the nearest consistent ones with a warning: a
    # travel by a part of itself, an angle by a part of a radian
    allowed = [max(tolerance, TYPED * (abs(e.value) if e.cosine is None else 1)) for e in targets]
    if all(abs(d) <= bound for d, bound in zip(offsets, allowed, strict=True)):
        warn(f"The given angles and travels of joints do not meet the constraints; the nearest "
             f"ones that do are taken: {nearest}.")
        return q
    raise InputError(f"The given angles and travels of joints contradict the constraints; the "
                     f"nearest possible start has {nearest}. Leave some of them out: what is not "
                     "given follows.")


def _sines_and_cosines(
    symbols: Sequence[sp.Symbol], values: Mapping[str, float], targets: Sequence[StartValue]
) -> tuple[NumericConstraints, NumericConstraints]:
    """Return sin and cos of (angle − target value) of all targets, each as a g(q) with numbers.

    A travel has its difference itself in place of the sine, and no cosine. ``FRACTION`` is 1: the
    values are those of the start.
    """
    constants = {**values, str(FRACTION): 1.0}
    sines = NumericConstraints(
        symbols, [e.sine for e in targets], [e.joint for e in targets], constants)
    return sines, NumericConstraints(
        symbols, [e.cosine for e in targets if e.cosine is not None],
        [e.joint for e in targets if e.cosine is not None], constants)


def _offsets(
    targets: Sequence[StartValue], sines: NumericConstraints, cosines: NumericConstraints, q: Array
) -> list[float]:
    """Return each coordinate at q less its target: a travel, or an angle in rad from −π to π.

    ``sines`` and ``cosines`` are those of ``_sines_and_cosines``; q has the shape (n,).
    """
    cosine = iter(cosines.g(q).tolist() if cosines.expressions else [])
    return [sine if e.cosine is None else float(np.arctan2(sine, next(cosine)))
            for e, sine in zip(targets, sines.g(q).tolist(), strict=True)]


def _list_nearest(targets: Sequence[StartValue], offsets: Sequence[float]) -> str:
    """Return the nearest possible value of each target beside the given one, as text."""
    return ", ".join(f"{e.measure} of {e.joint!r} {e.value + d:.9g} (given {e.value:.9g})"
                     for e, d in zip(targets, offsets, strict=True))


def warn_of_moved_joints(
    symbols: Sequence[sp.Symbol], values: Mapping[str, float], links: Sequence[Connection],
    poses: Mapping[Frame, Pose], q: Array
) -> None:
    """Warn of angles and travels of a robot's file, other than 0, that q does not have.

    ``links`` are the joints of the file, ``poses`` the poses in which it describes the bodies.
    """
    store = dict(values)
    targets = [e for link in links for e in _with_targets(link).start_values(poses, store)]
    if not targets:
        return
    offsets = _offsets(targets, *_sines_and_cosines(symbols, store, targets), q)
    missed_targets = [(target, offset) for target, offset in zip(targets, offsets, strict=True)
                      if abs(offset) > ROUNDING * max(float(np.abs(q).max()), 1.0)]
    if missed_targets:
        warn(f"The loops move the start: {_list_nearest(*zip(*missed_targets, strict=True))}.")


def _with_targets(link: Connection) -> Connection:
    """Return a joint whose described angle and travel, unless 0, are targets of the start."""
    if isinstance(link, Cylindrical):
        link = replace(link, start_travel=link.travel or None)
    if isinstance(link, HingedJoint):
        return replace(link, hinge=replace(link.hinge, start_angle=link.hinge.angle or None))
    if isinstance(link, Align):
        return replace(link, start_angle=link.angle or None)
    return link


def _minimise_on_constraints(
    constraints: NumericConstraints, sines: NumericConstraints, q: Array
) -> Array:
    """Return the q with g(q) = 0 and the least |r(q)|, by Gauss-Newton steps; r are the sines.

    Each step δ satisfies g_q δ = −g, and has the least |r_q δ + r| among all such steps.
    """
    for _ in range(_STEPS):
        step = nearest_step(as_dense(constraints.G(q)), constraints.g(q),
                            as_dense(sines.G(q)), sines.g(q))
        largest = float(np.abs(step).max())
        # a longer step could leave the assembly mode of q
        q = q + min(1.0, _LONGEST / (largest or 1.0)) * step
        # the step is round-off of the least squares
        if largest <= 16 * EPS * float(np.abs(q).max()):
            break
    return q


def nearest_step(G: Array, g: Array, R: Array, r: Array) -> Array:
    """Return the x, (n,), with G x = −g and the least |R x + r|; the shortest if there are several.

    G is (m, n), R (k, n). Dependent rows of G are allowed: its null space comes from a singular
    value decomposition.
    """
    if not len(G):
        return -np.asarray(np.linalg.lstsq(R, r, rcond=_RANK)[0])
    # the rows of V beyond the rank of G span its null space
    _, singular_values, V = np.linalg.svd(G)
    rank = int(np.sum(singular_values > _RANK * singular_values.max(initial=0.0)))
    particular = -np.linalg.lstsq(G, g, rcond=_RANK)[0]
    null_space = V[rank:].T
    if not null_space.shape[1] or not len(R):
        return np.asarray(particular)
    # x = particular + null_space y has G x = −g for every y: least squares for y remain
    y = np.linalg.lstsq(R @ null_space, -(r + R @ particular), rcond=_RANK)[0]
    return np.asarray(particular + null_space @ y)


def warn_of_moved_bodies(
    bodies: Mapping[Body, InitialState], before: Mapping[Frame, Pose], after: Mapping[Frame, Pose]
) -> None:
    """Warn of given positions and attitudes that a projection moved by more than round-off."""
    corrections: list[tuple[float, str]] = []  # relative change, text
    for body, initial in bodies.items():
        # tops have no x of their own, flywheels have coordinates that are no position
        for quantity, is_given, attribute in (
                ("position", initial.x is not None and len(body.x) == 3, "x"),
                ("attitude", initial.is_turned, "q")):
            if initial.is_placed or not is_given:
                continue
            value, projected = getattr(before[body], attribute), getattr(after[body], attribute)
            change = np.abs(projected - value).max()
            size = max(np.abs(value).max(), np.abs(projected).max())
            if change > ROUNDING * size:
                corrections.append((
                    float(change / size), f"The {quantity} of {body.name!r} is given as "
                    f"{_text(value)}, and the constraints move it to {_text(projected)}"))
    if corrections:
        warn(f"{_largest(corrections)}. Correct these numbers, or give these with more digits.")


def _largest(corrections: Sequence[tuple[float, str]]) -> str:
    """Return the text of the largest correction, and the number of others; entries (change, text).
    """
    suffix = f", and {len(corrections) - 1} more like it" if len(corrections) > 1 else ""
    _, text = max(corrections)
    return f"{text}{suffix}"


def _text(vector: Array) -> str:
    """Return a vector as text with nine digits; components at round-off of the largest are 0."""
    vector = np.where(np.abs(vector) > ROUNDING * np.abs(vector).max(), vector, 0.0)
    return "[" + ", ".join(f"{x:.9g}" for x in vector.tolist()) + "]"


@dataclass(frozen=True)
class _Target:
    """A given velocity D u = d: its name in messages, rows of D, and their value d."""

    label: str
    rows: Array  # shape (k, velocities), k = 3 for a vector, 1 for a rate
    value: Array  # shape (k,), in space
    axes: Array  # (k, k): from space to the axes in which the velocity is given


class _Block(NamedTuple):
    """The blocks of B and S of one body's angular velocity, or of its velocity."""

    rows: slice  # of p
    columns: slice  # of u
    B: Array
    S: Array


class Velocities:
    """Velocities of all bodies at the start: angular velocities and velocities in space, stacked.

    Parameters
    ----------
    bodies : mapping of Body to InitialState
    poses : mapping of Frame to Pose
        At the start, with velocities along the tree.
    inertia : mapping of Body to Inertia
    masses : mapping of Body to float

    Attributes
    ----------
    u : ndarray
        ω ("spin") and velocity ("v") of each body in space.
    slots : dict of (Body, str) to slice
        Places of "spin" and "v" of a body in u.
    """

    def __init__(
        self, bodies: Mapping[Body, InitialState], poses: Mapping[Frame, Pose],
        inertia: Mapping[Body, Inertia], masses: Mapping[Body, float],
    ) -> None:
        """Collect u from the poses, and the blocks of p = B u and of S, body by body."""
        self.bodies, self.poses = bodies, poses
        self.slots: dict[tuple[Body, str], slice] = {}
        # p = B u, and S = Lᵀ of M = L Lᵀ, so that |S u|² = uᵀ M u is twice the kinetic energy;
        # a quaternion has four momenta for three rates, so that B has a column for each unit spin
        self._blocks: list[_Block] = []
        u, count, row_count = [], 0, 0
        for body in bodies:
            pose = poses[body]
            for quantity, unknowns in (("spin", 3 if body.q else 0), ("v", len(body.x))):
                if not unknowns:
                    continue
                self.slots[body, quantity] = slice(count, count + unknowns)
                if quantity == "spin":
                    M = pose.R @ inertia_matrix(inertia[body]) @ pose.R.T
                    block = np.column_stack([
                        replace(pose, spin=e).momenta(inertia[body]) for e in np.eye(3)])
                else:
                    M = masses[body] * np.eye(unknowns)
                    block = M
                self._blocks.append(_Block(
                    slice(row_count, row_count + len(block)), self.slots[body, quantity], block,
                    np.linalg.cholesky(M).T))
                u.append(getattr(pose, quantity))
                count, row_count = count + unknowns, row_count + len(block)
        self.u = np.concatenate(u)

    def _momenta(self, u: Array) -> Array:
        """Return B u, for each column of u."""
        return np.concatenate([block.B @ u[block.columns] for block in self._blocks])

    def _velocities(self, p: Array) -> Array:
        """Return the u with B u nearest to p."""
        return np.concatenate([np.linalg.lstsq(block.B, p[block.rows], rcond=None)[0]
                               for block in self._blocks])

    def _scale(self, u: Array) -> Array:
        """Return S u."""
        return np.concatenate([block.S @ u[block.columns] for block in self._blocks])

    def _unscale(self, y: Array) -> Array:
        """Return S⁻¹ y, for each column of y."""
        return np.concatenate([np.linalg.inv(block.S) @ y[block.columns]
                               for block in self._blocks])

    def list_targets(self, links: Sequence[Connection]) -> list[_Target]:
        """Return the velocities that the user gives to bodies, and the rates of joints.

        A target is rows · u = value, with the velocities u of all bodies. Bodies of a robot's file
        have none: its joints give their motion.
        """
        targets = []
        for body, initial in self.bodies.items():
            if initial.is_placed or isinstance(body, FlywheelBody):
                continue
            # ω is given in body axes, and its target has axes of space
            for quantity, name, value, axes in (
                    ("v", "velocity", initial.v, np.eye(3)),
                    ("spin", "angular velocity", initial.omega, self.poses[body].R)):
                if value is not None and (body, quantity) in self.slots:
                    rows = np.zeros((3, len(self.u)))
                    rows[:, self.slots[body, quantity]] = np.eye(3)
                    targets.append(
                        _Target(f"The {name} of {body.name!r}", rows, axes @ value, axes.T))
        for link in links:
            targets += [target for rate in link.start_rates(self.poses)
                        if (target := self._rate(rate)) is not None]
        return targets

    def _rate(self, rate: StartRate) -> _Target | None:
        """Return the row of D of a given rate Σ (c_v·v + c_ω·ω), and its value d.

        Frames with a prescribed motion, which are no part of u, have their share subtracted from d.
        None if no velocity of u changes the rate and it is the given one; else InputError.
        """
        name, given_value, coefficients = rate
        value, row = given_value, np.zeros((1, len(self.u)))
        for frame, gradients in coefficients.items():
            for quantity, gradient in zip(("v", "spin"), gradients, strict=True):
                columns = self.slots.get((frame, quantity)) if isinstance(frame, Body) else None
                prescribed = getattr(self.poses[frame], quantity)
                if columns is not None:
                    row[0, columns] = gradient
                # the ground and moving points; a body with a fixed point has no velocity v
                elif len(gradient) == len(prescribed):
                    value = value - float(gradient @ prescribed)
        size = max(float(np.abs(gradient).max(initial=0.0))
                   for gradients in coefficients.values() for gradient in gradients)
        if np.abs(row).max() <= ROUNDING * size:
            share = given_value - value
            if abs(value) > ROUNDING * max(abs(given_value), abs(share)):
                raise InputError(f"The rate of {name!r} is given as {given_value:.9g}, but no "
                                 f"motion of its bodies changes it from {share:.9g}; give this "
                                 "number, or leave it out.")
            return None
        return _Target(f"The rate of {name!r}", row, np.array([value]), np.eye(1))

    def keep(
        self, numbers: NumericSystem, links: Sequence[Connection], q: Array, p: Array
    ) -> Array:
        """Return momenta p = B u, shape (n,), on the constraints with the given velocities.

        q and p, of the same shape, are the start with the velocities along the tree. With y = S u,
        |y|² is twice the kinetic energy. Among the u that satisfy the constraints g_q H_p + g_t = 0
        and A H_p + a = 0, the result has the least |D u − d| and, among several, the least |y − S
        u₀|, where u₀ are the velocities along the tree.

        Raises
        ------
        InputError
            For velocities that the constraints do not allow, with the nearest possible ones.
        """
        targets = self.list_targets(links)
        projected = project_momenta(numbers, q, p)
        R, d = self._scaled_targets(targets)
        y = self._scale(self.u)
        tolerance = ROUNDING * max(float(np.linalg.norm(y)), float(np.abs(d).max(initial=0.0)))
        # usually the projected momenta have the given velocities already
        shift = self._scale(self._velocities(projected - self._momenta(self.u)))
        if np.abs(R @ (y + shift) - d).max(initial=0.0) <= tolerance:
            return projected
        solution = self._fit_on_constraints(numbers, q, R, d)
        u = self._unscale(solution)
        self._refuse_missed(targets, u, R @ solution - d, d, tolerance)
        return self._momenta(u)

    def _scaled_targets(self, targets: Sequence[_Target]) -> tuple[Array, Array]:
        """Return R and r of R y = r, the given velocities D u = d in y = S u.

        |y|² is twice the kinetic energy. Rows of D S⁻¹ y = d are divided by their lengths:
        velocities and angular velocities then compare. No row is 0, as each target has a velocity
        of u.
        """
        R = np.concatenate([np.zeros((0, len(self.u))), *(target.rows for target in targets)])
        for block in self._blocks:
            R[:, block.columns] = R[:, block.columns] @ np.linalg.inv(block.S)
        lengths = np.linalg.norm(R, axis=1)
        d = np.concatenate([np.zeros(0), *(target.value for target in targets)])
        return R / lengths[:, None], d / lengths

    def _fit_on_constraints(self, numbers: NumericSystem, q: Array, R: Array, d: Array) -> Array:
        """Return the y = S u on the constraints with the least |R y − d|, nearest to y₀ = S u₀.

        Gauss-Newton steps, each from y₀: one is enough if H_p is linear in p.
        """
        y = solution = self._scale(self.u)
        G = as_dense(numbers.rows(q))
        momenta_by_y = self._momenta(self._unscale(np.eye(len(y))))
        for _ in range(_VELOCITY_STEPS):
            momenta = self._momenta(self._unscale(solution))
            rates = numbers.H_pp_times(q, momenta, momenta_by_y)
            # the constraints' rates f are A (y − solution) more at y; rows get the length 1
            A = G @ rates
            lengths = np.linalg.norm(A, axis=1)
            # Rotations keep |q| = 1: that row is 0, but for its round-off. A rate of a coordinate
            # that is nearly 0 has the round-off of the other coordinates of its body, so that the
            # size of a row is that of its largest rates.
            sizes = np.where(G != 0, np.linalg.norm(rates, axis=1), 0.0).max(axis=1, initial=0.0)
            independent = lengths > ROUNDING * np.linalg.norm(G, axis=1) * sizes
            f = numbers.f(q, momenta) + A @ (y - solution)
            step = nearest_step(A[independent] / lengths[independent, None],
                                f[independent] / lengths[independent],
                                R, R @ y - d)
            change, solution = float(np.abs(y + step - solution).max()), y + step
            if change <= 16 * EPS * float(np.abs(solution).max()):
                break
        return solution

    def warn_of_moved(self, p: Array) -> None:
        """Warn of bodies of a robot's file whose velocities by its joints' rates are not kept.

        A velocity of 0 by the rates may change without a warning: it is the file's default.
        """
        u = self._velocities(p)
        tolerance = ROUNDING * max(np.abs(self.u).max(), np.abs(u).max())
        u = np.where(np.abs(u) > tolerance, u, 0.0)
        corrections = []
        for (body, quantity), columns in self.slots.items():
            change = float(np.abs(u[columns] - self.u[columns]).max())
            if (self.bodies[body].is_placed and not isinstance(body, FlywheelBody)
                    and self.u[columns].any() and change > tolerance):
                name = "velocity" if quantity == "v" else "angular velocity"
                corrections.append((change, f"the {name} of {body.name!r} in space is "
                                    f"{_text(u[columns])} "
                                    f"({_text(self.u[columns])} by the rates of joints)"))
        if corrections:
            warn(f"The loops move the start: {_largest(corrections)}. Give rates that the loops "
                 "allow, of all joints.")

    def _refuse_missed(
        self, targets: Sequence[_Target], u: Array, residual: Array, d: Array, tolerance: float
    ) -> None:
        """Refuse given velocities that u does not have; warn where rounding of input explains it.

        ``residual`` is R y − d of ``keep``, with an entry for each component of each target, as d
        has; an error up to ``tolerance`` is round-off.
        """
        # the entries of each target in d and the residual end at its entry of ``ends``
        ends = np.cumsum([len(target.value) for target in targets])
        corrections = []
        for target, indices in zip(targets, np.split(np.arange(len(d)), ends[:-1]), strict=True):
            error = float(np.linalg.norm(residual[indices]))
            if error > tolerance:
                value, nearest = target.axes @ target.value, target.axes @ (target.rows @ u)
                relative_error = error / max(float(np.linalg.norm(d[indices])),
                                             np.finfo(float).tiny)
                corrections.append((
                    relative_error, f"{target.label} is given as {_text(value)}, which "
                    f"the constraints do not allow; the nearest possible is {_text(nearest)}"))
        if not corrections:
            return
        largest, text = max(corrections)
        if largest <= TYPED:
            warn(f"{text}, which is taken.")
        else:
            raise InputError(f"{text}. Give that, or leave it out: velocities that are not given "
                             "follow.")
