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
    """An impact ``since`` after the start of its step.

    ``before`` and ``after`` are p⁻ and p⁺, ``impulse`` is μ. ``gap`` is the index of the gap among
    the quantities; ``parameter`` the row of a direction by which e changes, if e is a parameter.
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
    """Return the impacts of a trajectory, step → its impacts in the order of the run.

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
        times_in_step = crossings.elapsed - times(0 * run.t0, run.dt, crossings.steps)
        for i, step in enumerate(crossings.steps.tolist()):
            # at the ends of a step its part before or behind the impact has length 0, and which
            # step it belongs to changes with the start
            if not times_in_step[i] or step >= run.steps:
                raise InputError(
                    f"The impact of {impact.name!r} at t = {float(crossings.t[i]):.9g} s is at the "
                    "start, at the end of a step, or in the last part of one, where it has no "
                    "derivatives; take another dt, or another t_end.")
            hits.setdefault(step, []).append(Hit(
                times_in_step[i], names.index(impact.quantity), impact, parameter, crossings.q[i],
                crossings.p_before[i], crossings.p[i], crossings.impulse[i]))
    for step, of_step in hits.items():
        of_step.sort(key=lambda hit: abs(hit.since))
        for earlier, later in pairwise(of_step):
            if earlier.since == later.since:
                raise InputError(
                    f"Impacts of {earlier.impact.name!r} and {later.impact.name!r} are at once in "
                    f"step {step}: which comes first changes with the start, and there are no "
                    "derivatives; start elsewhere.")
    return hits


def impact_step(
    stepper: Stepper, run: RunArguments, step: int, q: Array, p: Array
) -> ImpactStep:
    """Return a step with impacts from a state, with its derivatives.

    Its parts are linearised in turn. ``directions`` has the derivatives of the present state, the
    parameters, the length 0 and the present time, by all rows of a direction at the start.
    """
    binding, n = stepper._derivative_binding(), stepper.binding.n
    start = run.t0 + step * run.dt
    arguments = replace(run.at_step(step), steps=1, every=1, inputs=None, stored_steps=None,
                        hits=None)
    # rows: q, p, parameters, the length and the time of a part; t = t0 + step Δt at the start
    directions = np.eye(binding.rows, dtype=q.dtype)
    d_step, d_part_start = directions[-2].copy(), 0 * directions[-1]
    directions[-2], directions[-1] = 0, directions[-1] + step * d_step
    part_start, state = 0 * run.dt, (q, p)
    hits: list[Hit | None] = [*(run.hits or {})[step], None]
    for hit in hits:
        length = (run.dt if hit is None else hit.since) - part_start
        partial_step = SingleStep(stepper, replace(arguments, q=state[0], p=state[1], dt=length,
                                                   t0=start + part_start))
        # one more direction, the length h alone, gives v = ∂Φ_h/∂h
        along_length = np.eye(binding.rows, dtype=q.dtype)[:, -2:-1]
        ends = partial_step.tangent(np.concatenate([directions, along_length], axis=1))
        end_directions, v = ends[:, :-1], ends[:, -1]
        if hit is None:  # the last part ends with the step, whatever moves the impacts
            d_length = d_step - d_part_start
        else:
            parameters = binding.own.parameters(arguments.parameters, start + hit.since)
            quantity_rows = binding.quantity_derivatives(parameters, start + hit.since, hit.q,
                                                         hit.before)
            if quantity_rows is None:
                raise _too_long(stepper)
            # φ stays 0 at the end of this part: dh = −(φ_q dZ + φ_θ dθ + φ_t dt)/(φ_q v + φ_t)
            normal = quantity_rows[hit.gap]
            rate = rate_of(Point(step, hit.since, normal, hit.impact.name), v)
            d_length = -(normal @ np.concatenate([end_directions, directions[2 * n :]])) / rate
        directions[: 2 * n] = end_directions + np.outer(v, d_length)
        directions[-1], d_part_start = directions[-1] + d_length, d_part_start + d_length
        state = partial_step.end[:n], partial_step.end[n:]
        if hit is not None:
            directions[: 2 * n] = _jump(stepper, arguments, start + hit.since, hit) @ directions
            part_start, state = hit.since, (hit.q, hit.after)
    return ImpactStep(step, np.array([q, state[0]]), np.array([p, state[1]]),
                      binding.own.new(1, stepper.unknowns), directions[: 2 * n].copy())


def _too_long(stepper: Stepper) -> InputError:
    return InputError(f"The gaps of {stepper.name} are too many or too long for derivatives; use "
                      "differences of runs.")


def _jump(stepper: Stepper, run: RunArguments, t: Any, hit: Hit) -> Array:
    """Return the derivatives of (q, p⁺) by q, p⁻, parameters, step and time, shape (2 n, rows).

    The time step does not enter: its column is 0. With the gap φ and its rate r, the impulses μ of
    the gap and λ of the constraints, the restitution e, and y of f(q, p⁻ − Gᵀ y) = 0, the
    equations of the module, differentiated, are

        dp⁺ = dp⁻ + d(φ_qᵀ) μ + d(Gᵀ) λ + R (dμ, dλ),                      R = [φ_qᵀ Gᵀ]
        dr(q, p⁺ − Gᵀ y) + e dr(q, p⁻ − Gᵀ y) + r(q, p⁻ − Gᵀ y) de = 0
        df(q, p⁺) − df(q, p⁻) = 0
        d(Gᵀ y) = d(Gᵀ) y + Gᵀ W⁻¹ df(q, p⁻ − Gᵀ y) at fixed y,            W = f_p Gᵀ

    The two in the middle have residuals at dμ = dλ = 0, and (dμ, dλ) = −([r_p; f_p] R)⁻¹ residual.
    """
    binding, n, m = stepper._derivative_binding(), stepper.binding.n, stepper.m
    allocate, rows = binding.own.new, binding.rows
    e = as_real("restitution", hit.impact.restitution, stepper.binding.number)
    parameters = binding.own.parameters(run.parameters, t)
    quantity_rows = binding.quantity_derivatives(parameters, t, hit.q, hit.before)
    assert quantity_rows is not None
    phi_q, weights = quantity_rows[hit.gap, :n], allocate(len(quantity_rows))
    # columns are q, p⁻, parameters, step and time; C leaves out the step, and p⁻ of forces too
    columns_without_p = rows - n - 1

    def all_columns(derivatives: Array, states: int) -> Array:
        """Return derivatives with columns of 0 for those that C leaves out.

        ``states`` is how many columns of (q, p⁻) there are: n without p⁻, else 2 n.
        """
        complete = allocate(len(derivatives), rows)
        complete[:, :states] = derivatives[:, :states]
        complete[:, 2 * n : -2], complete[:, -1] = derivatives[:, states:-1], derivatives[:, -1]
        return complete

    def gap_derivatives(p: Array, impulse: Any, forces: Array) -> tuple[Array, Array]:
        """Return the derivatives of φ_qᵀ μ + Gᵀ λ at fixed μ and λ, and of the gap's rate r."""
        weights[hit.gap] = impulse
        of_forces, of_rates = allocate(n, columns_without_p), allocate(len(quantity_rows), rows - 1)
        stepper._jump_binding()(parameters, t, hit.q, p, weights, forces, of_forces, of_rates)
        return all_columns(of_forces, n), all_columns(of_rates[hit.gap : hit.gap + 1], 2 * n)

    # y and λ, from p⁻ and p⁺; dq and dp⁻ are rows of the unit matrix
    unit, no_force = np.eye(2 * n, rows, dtype=phi_q.dtype), allocate(m)
    dp_before = unit[n:]
    if m:
        g_rows, f_before = binding.constraint_derivatives(parameters, hit.q, hit.before)
        G, f_p = g_rows[:, :n], f_before[:, n : 2 * n]
        W = f_p @ G.T
        f = stepper.binding.defects(stepper.binding.parameters(run.parameters, t), hit.q[None],
                                    hit.before[None])[1][0]
        y = solved(W, f)
        constraint_impulse = hit.after - hit.before - phi_q * hit.impulse
        lam = solved(G @ G.T, G @ constraint_impulse)
        G_T = G.T
    else:
        G_T, lam, y = allocate(n, 0), no_force, no_force
    d_impulse, _ = gap_derivatives(hit.before, hit.impulse, lam)
    projected_before, projected_after = (p - G_T @ y for p in (hit.before, hit.after))
    d_projection, r_before = gap_derivatives(projected_before, 0, y)  # d(Gᵀ) y
    _, r_after = gap_derivatives(projected_after, 0, no_force)

    def along(derivatives: Array, dp: Array) -> Array:
        """Return derivatives by all rows where p moves by ``dp``: f_q dq + f_p dp + f_θ dθ."""
        derivative: Array = (derivatives[:, :n] @ unit[:n] + derivatives[:, n : 2 * n] @ dp
                             + derivatives[:, 2 * n :] @ np.eye(rows, dtype=phi_q.dtype)[2 * n :])
        return derivative

    # dp⁺ at fixed μ and λ, and d(Gᵀ y)
    dp_fixed = dp_before + d_impulse
    if m:
        f_projected = binding.constraint_derivatives(parameters, hit.q, projected_before)[1]
        f_after = binding.constraint_derivatives(parameters, hit.q, hit.after)[1]
        d_projection = d_projection + G_T @ solved(W, along(f_projected,
                                                                          dp_before - d_projection))
    # the residuals at dμ = dλ = 0, and their derivatives by μ and λ
    r_p = r_after[:, n : 2 * n]
    R = np.concatenate([phi_q[:, None], G_T], axis=1)
    residual = (along(r_after, dp_fixed - d_projection)
                + e * along(r_before, dp_before - d_projection))
    if hit.parameter is not None:
        # r de. C returns derivatives of r alone, but r is affine in p: its jump, −(1 + e) r, is
        # r_p (p⁺ − p⁻)
        residual[0, hit.parameter] -= (r_p @ (hit.after - hit.before))[0] / (1 + e)
    matrix = r_p @ R
    if m:
        residual = np.concatenate([residual, along(f_after, dp_fixed) - along(f_before, dp_before)])
        matrix = np.concatenate([matrix, f_p @ R])
    return np.concatenate([unit[:n], dp_fixed - R @ solved(matrix, residual)])
