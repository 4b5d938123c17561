"""Derivatives of a step with impacts: parts of the step, jumps, and the shifts of their times.

A part of length h leads from z at t to Φ_h(z), where φ is 0. With v = ∂Φ_h/∂h its end moves by

    dh = −(φ_q dZ + φ_θ dθ + φ_t dt)/(φ_q v + φ_t),   dz = dZ + v dh

with dZ at fixed h, and the next part is shorter by dh. The jump p⁺ = p⁻ + φ_qᵀ μ + Gᵀ λ, with the
rate r(q, p) = φ_q H_p + φ_t of the gap and f = G H_p + g_t, solves

    f(q, p⁻ − Gᵀ y) = 0,   f(q, p⁺) = f(q, p⁻),   r(q, p⁺ − Gᵀ y) = −e r(q, p⁻ − Gᵀ y)

for y, λ and μ, by which it is differentiated. (docs/theory/impacts.md)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.event import Impact, with_restitutions
from ...core.records import dataclass
from ..bindings.array_checks import as_real
from ..integration.run_arguments import RunArguments
from .binding import ImpactStep
from .kept_steps import SingleStep
from .points import Point, rate_of
from .tangent_space import solved

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory
    from ..steppers.stepper import Stepper

__all__ = ["hits_of", "impact_step"]


@dataclass(frozen=True)
class Hit:
    """An impact ``since`` after the start of its step: the gap's quantity and e, q, p⁻, p⁺, μ.

    ``parameter`` is the row of a direction by which e changes, if it is a parameter.
    """

    since: Any
    gap: int
    impact: Impact
    parameter: int | None
    q: Array
    before: Array
    after: Array
    impulse: Any


def hits_of(
    stepper: Stepper, run: RunArguments, trajectory: Trajectory, impacts: Sequence[Impact]
) -> dict[int, list[Hit]]:
    """Return the impacts of a trajectory by their steps.

    Raises InputError for impacts at the start, at the end of a step, in the last part of one, and
    several at once, which have no derivatives.
    """
    names, times = list(stepper.manifest.system.quantities), stepper.binding.times
    hits: dict[int, list[Hit]] = {}
    for impact, event in zip(with_restitutions(impacts, run.parameters), impacts, strict=True):
        parameter = None
        if isinstance(event.restitution, str):
            parameter = 2 * stepper.binding.n + stepper.binding.parameter_names.index(
                event.restitution)
        crossings = trajectory.impacts[impact.name]
        since = crossings.elapsed - times(0 * run.t0, run.dt, crossings.steps)
        for i, step in enumerate(crossings.steps.tolist()):
            # at the ends of a step its part before or behind the impact has length 0, and which
            # step it belongs to changes with the start
            if not since[i] or step >= run.steps:
                raise InputError(
                    f"The impact of {impact.name!r} at t = {float(crossings.t[i]):.9g} s is at the "
                    "start, at the end of a step, or in the last part of one, where it has no "
                    "derivatives; take another dt, or another t_end.")
            hits.setdefault(step, []).append(Hit(
                since[i], names.index(impact.quantity), impact, parameter, crossings.q[i],
                crossings.p_before[i], crossings.p[i], crossings.impulse[i]))
    for step, of_step in hits.items():
        of_step.sort(key=lambda hit: abs(hit.since))
        for first, second in pairwise(of_step):
            if first.since == second.since:
                raise InputError(
                    f"Impacts of {first.impact.name!r} and {second.impact.name!r} are at once in "
                    f"step {step}: which comes first changes with the start, and there are no "
                    "derivatives; start elsewhere.")
    return hits


def impact_step(
    stepper: Stepper, run: RunArguments, step: int, q: Array, p: Array
) -> ImpactStep:
    """Return a step with impacts from a state, with its derivatives."""
    binding, n = stepper._derivative_binding(), stepper.binding.n
    start = run.t0 + step * run.dt
    arguments = replace(run.at_step(step), steps=1, every=1, inputs=None, stored_steps=None,
                        hits=None)
    # rows: q, p, parameters, the length and the time of a part
    directions = np.eye(binding.rows, dtype=q.dtype)
    of_step, later = directions[-2].copy(), 0 * directions[-1]
    directions[-2], directions[-1] = 0, directions[-1] + step * of_step
    since, state = 0 * run.dt, (q, p)
    hits: list[Hit | None] = [*(run.hits or {})[step], None]
    for hit in hits:
        length = (run.dt if hit is None else hit.since) - since
        piece = SingleStep(stepper, replace(arguments, q=state[0], p=state[1], dt=length,
                                           t0=start + since))
        unit = np.eye(binding.rows, dtype=q.dtype)[:, -2:-1]
        ends = piece.tangent(np.concatenate([directions, unit], axis=1))
        end_directions, v = ends[:, :-1], ends[:, -1]
        if hit is None:
            longer = of_step - later
        else:
            parameters = binding.own.parameters(arguments.parameters, start + hit.since)
            rows = binding.quantity_derivatives(parameters, start + hit.since, hit.q, hit.before)
            if rows is None:
                raise _too_long(stepper)
            normal = rows[hit.gap]
            rate = rate_of(Point(step, hit.since, normal, hit.impact.name), v)
            longer = -(normal @ np.concatenate([end_directions, directions[2 * n :]])) / rate
        directions[: 2 * n] = end_directions + np.outer(v, longer)
        directions[-1], later = directions[-1] + longer, later + longer
        state = piece.end[:n], piece.end[n:]
        if hit is not None:
            directions[: 2 * n] = _jump(stepper, arguments, start + hit.since, hit) @ directions
            since, state = hit.since, (hit.q, hit.after)
    return ImpactStep(step, np.array([q, state[0]]), np.array([p, state[1]]),
                      binding.own.new(1, stepper.unknowns), directions[: 2 * n].copy())


def _too_long(stepper: Stepper) -> InputError:
    return InputError(f"The gaps of {stepper.name} are too many or too long for derivatives; use "
                      "differences of runs.")


def _jump(stepper: Stepper, run: RunArguments, t: Any, hit: Hit) -> Array:
    """Return the derivatives of (q, p⁺) by q, p⁻, the parameters, the step (0) and the time."""
    binding, n, m = stepper._derivative_binding(), stepper.binding.n, stepper.m
    new, rows = binding.own.new, binding.rows
    e = as_real("restitution", hit.impact.restitution, stepper.binding.number)
    parameters = binding.own.parameters(run.parameters, t)
    normal = binding.quantity_derivatives(parameters, t, hit.q, hit.before)
    assert normal is not None
    row, weights = normal[hit.gap, :n], new(len(normal))

    def by_rows(matrix: Array, states: int) -> Array:
        """Return derivatives by states, parameters and time as those by all rows."""
        full = new(len(matrix), rows)
        full[:, :states] = matrix[:, :states]
        full[:, 2 * n : -2], full[:, -1] = matrix[:, states:-1], matrix[:, -1]
        return full

    def of_gap(p: Array, impulse: Any, forces: Array) -> tuple[Array, Array]:
        """Return the derivatives of φ_qᵀ μ + Gᵀ λ and of the rate of the gap."""
        weights[hit.gap] = impulse
        by_force, by_rate = (new(n, n + rows - 2 * n - 1), new(len(normal), rows - 1))
        stepper._jump_binding()(parameters, t, hit.q, p, weights, forces, by_force, by_rate)
        return by_rows(by_force, n), by_rows(by_rate[hit.gap : hit.gap + 1], 2 * n)

    unit, no_force = np.eye(2 * n, rows, dtype=row.dtype), new(m)
    dp = unit[n:]
    if m:
        g, f_before = binding.constraint_derivatives(parameters, hit.q, hit.before)
        G, f_p = g[:, :n], f_before[:, n : 2 * n]
        W = f_p @ G.T
        f = stepper.binding.defects(stepper.binding.parameters(run.parameters, t), hit.q[None],
                                    hit.before[None])[1][0]
        y = solved(W, f)
        pulled = hit.after - hit.before - row * hit.impulse
        lam = solved(G @ G.T, G @ pulled)
        pulls = G.T
    else:
        pulls, lam, y = new(n, 0), no_force, no_force
    by_jump, _ = of_gap(hit.before, hit.impulse, lam)
    projected = [p - pulls @ y for p in (hit.before, hit.after)]
    by_pull, r_before = of_gap(projected[0], 0, y)
    _, r_after = of_gap(projected[1], 0, no_force)

    def along(derivatives: Array, directions: Array) -> Array:
        """Return derivatives at dq and ``directions`` of p."""
        total: Array = (derivatives[:, :n] @ unit[:n] + derivatives[:, n : 2 * n] @ directions
                        + derivatives[:, 2 * n :] @ np.eye(rows, dtype=row.dtype)[2 * n :])
        return total

    fixed = dp + by_jump  # of p⁺, at fixed μ and λ
    shift = by_pull
    if m:
        f_projected = binding.constraint_derivatives(parameters, hit.q, projected[0])[1]
        f_after = binding.constraint_derivatives(parameters, hit.q, hit.after)[1]
        shift = shift + pulls @ solved(W, along(f_projected, dp - by_pull))
    r_p = r_after[:, n : 2 * n]
    directions = np.concatenate([row[:, None], pulls], axis=1)
    error = along(r_after, fixed - shift) + e * along(r_before, dp - shift)
    if hit.parameter is not None:  # r is affine in p, so that its jump −(1 + e) r is r_p (p⁺ − p⁻)
        error[0, hit.parameter] -= (r_p @ (hit.after - hit.before))[0] / (1 + e)
    matrix = r_p @ directions
    if m:
        error = np.concatenate([error, along(f_after, fixed) - along(f_before, dp)])
        matrix = np.concatenate([matrix, f_p @ directions])
    return np.concatenate([unit[:n], fixed - directions @ solved(matrix, error)])
