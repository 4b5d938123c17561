"""Derivatives of a step with impacts: parts of the step, jumps, and the shifts of their times.

A part of length h leads from z at t to Φ_h(z), where φ is 0. With v = ∂Φ_h/∂h its end moves by

    dh = −(φ_q dZ + φ_θ dθ + φ_t dt)/(φ_q v + φ_t),   dz = dZ + v dh

with dZ at fixed h, and the next part is shorter by dh. The jump p⁺ = p⁻ + φ_qᵀ μ + Gᵀ λ, with the
rate r(q, p) = φ_q H_p + φ_t of the gap and f = G H_p + g_t, solves

    f(q, p⁻ − Gᵀ y) = 0,   f(q, p⁺) = f(q, p⁻),   r(q, p⁺ − Gᵀ y) = −e r(q, p⁻ − Gᵀ y)

for y, λ and μ, by which it is differentiated. (docs/theory/impacts.md)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
from .tangent_space import solve

if TYPE_CHECKING:
    from ..results.crossings import Impacts
    from ..steppers.stepper import Stepper

__all__ = ["hits_of", "impact_step"]

#: Rows of a direction: the length of a part of a step, and the time at its start.
_LENGTH, _TIME = -2, -1


@dataclass(frozen=True)
class Hit:
    """An impact in a step.

    Attributes
    ----------
    since : number
        Time from the start of the step to the impact.
    gap : int
        Index of the gap φ among the quantities of the system.
    impact : Impact
        The user's impact, with its restitution e as a number.
    parameter : int or None
        Row of a direction that has de, where e is a parameter.
    q, p_before, p_after : array, shape (n,)
        q, p⁻ and p⁺ at the impact.
    impulse : number
        μ, the impulse of the gap.
    """

    since: Any
    gap: int
    impact: Impact
    parameter: int | None
    q: Array
    p_before: Array
    p_after: Array
    impulse: Any


def hits_of(
    stepper: Stepper, run: RunArguments, impacts_by_name: Mapping[str, Impacts],
    impacts: Sequence[Impact],
) -> dict[int, list[Hit]]:
    """Return the impacts of a run, index of a step → its impacts in the order of the run.

    Raises InputError for impacts that have no derivatives: at the start of the run, at the end of
    a step, in a last step shorter than Δt, and several at one time.
    """
    names, times = list(stepper.manifest.system.quantities), stepper.binding.times
    hits: dict[int, list[Hit]] = {}
    # ``impact`` has the restitution as a number, ``declared`` perhaps as the name of a parameter
    for impact, declared in zip(with_restitutions(impacts, run.parameters), impacts, strict=True):
        parameter = None
        if isinstance(declared.restitution, str):
            parameter = 2 * stepper.binding.n + stepper.binding.parameter_names.index(
                declared.restitution)
        crossings = impacts_by_name[impact.name]
        # less the times at which the steps begin, counted from t0 as ``elapsed`` is
        times_in_step = crossings.elapsed - times(0 * run.t0, run.dt, crossings.steps)
        for i, step in enumerate(crossings.steps.tolist()):
            # at the ends of a step the part before or after the impact has the length 0, and
            # the step that the impact belongs to changes with the start of the run
            if not times_in_step[i] or step >= run.steps:
                raise InputError(
                    f"The impact of {impact.name!r} at t = {float(crossings.t[i]):.9g} s is at the "
                    "start, at the end of a step, or in the last part of one, where it has no "
                    "derivatives; take another dt, or another t_end.")
            hits.setdefault(step, []).append(Hit(
                since=times_in_step[i], gap=names.index(impact.quantity), impact=impact,
                parameter=parameter, q=crossings.q[i], p_before=crossings.p_before[i],
                p_after=crossings.p[i],
                # in the type of q, which products with arrays then keep
                impulse=crossings.q.dtype.type(crossings.impulse[i])))
    _sort_in_steps(hits)
    return hits


def _sort_in_steps(hits: Mapping[int, list[Hit]]) -> None:
    """Sort the impacts of each step by their times; refuse two at one time."""
    for step, hits_of_step in hits.items():
        # |since|: Δt < 0 in a run backwards in time
        hits_of_step.sort(key=lambda hit: abs(hit.since))
        for earlier, later in pairwise(hits_of_step):
            if earlier.since == later.since:
                raise InputError(
                    f"Impacts of {earlier.impact.name!r} and {later.impact.name!r} are at once in "
                    f"step {step}: which comes first changes with the start, and there are no "
                    "derivatives; start elsewhere.")


def impact_step(stepper: Stepper, run: RunArguments, step: int, q: Array, p: Array) -> ImpactStep:
    """Return step number ``step`` of a run, which has impacts, from the state (q, p) before it.

    Its ``matrix``, M = ∂(q₁, p₁)/∂(q, p, parameters, Δt, t₀), shape (2 n, rows), is the product of
    the derivatives of the partial steps from impact to impact and of the jumps between them. The
    columns of ``directions``, shape (rows, rows), are derivatives of the present state, of the
    parameters and of the time at the start of a part; v is the derivative of its end by its length.
    """
    binding, n = stepper._derivative_binding(), stepper.binding.n
    start = run.t0 + step * run.dt
    arguments = replace(run.at_step(step), steps=1, every=1, inputs=None, stored_steps=None,
                        hits=None)
    directions = np.eye(binding.rows, dtype=q.dtype)
    d_step = directions[_LENGTH].copy()
    # the row of the length stays 0: lengths enter through v; the step begins at t0 + step Δt
    directions[_LENGTH] = 0
    directions[_TIME] += step * d_step
    d_part_start = 0 * d_step
    # counted from the start of the step: 0 in the type of Δt
    part_start, q_start, p_start = 0 * run.dt, q, p
    for hit in (run.hits or {})[step]:
        t = start + hit.since
        partial_run = replace(arguments, q=q_start, p=p_start, dt=hit.since - part_start,
                              t0=start + part_start)
        _, dZ, v = _linearised_part(stepper, partial_run, directions)
        # φ stays 0 at the end of this part: dh = −(φ_q dZ + φ_θ dθ + φ_t dt)/(φ_q v + φ_t)
        normal = _gap_derivatives(stepper, arguments, t, hit)[hit.gap]
        rate = rate_of(Point(step, hit.since, normal, hit.impact.name), v)
        d_length = -(normal @ np.concatenate([dZ, directions[2 * n :]])) / rate
        directions[: 2 * n] = dZ + np.outer(v, d_length)
        directions[_TIME] += d_length
        d_part_start = d_part_start + d_length
        directions[: 2 * n] = _jump(stepper, arguments, t, hit) @ directions
        part_start, q_start, p_start = hit.since, hit.q, hit.p_after
    # the last part ends with the step, however the impacts move: its length changes by the rest
    partial_run = replace(arguments, q=q_start, p=p_start, dt=run.dt - part_start,
                          t0=start + part_start)
    end, dZ, v = _linearised_part(stepper, partial_run, directions)
    # zeros for the unknowns, in place of which this step has a matrix
    return ImpactStep(step, np.array([q, end[:n]]), np.array([p, end[n:]]),
                      x=binding.module.new(1, stepper.unknowns),
                      matrix=dZ + np.outer(v, d_step - d_part_start))


def _linearised_part(
    stepper: Stepper, run: RunArguments, directions: Array
) -> tuple[Array, Array, Array]:
    """Return the end z = Φ_h of a partial step, dZ at fixed length h, and v = ∂Φ_h/∂h.

    Their shapes are (2 n,), (2 n, k) and (2 n,). ``run`` is a run of this one step; ``directions``
    has the directions at its start in k columns, (rows, k), whose row of the length is 0.
    """
    partial_step = SingleStep(stepper, run)
    # one more direction, the length h alone, gives v
    along_length = np.zeros_like(directions[:, :1])
    along_length[_LENGTH] = 1
    dz_end = partial_step.tangent(np.concatenate([directions, along_length], axis=1))
    return partial_step.end, dz_end[:, :-1], dz_end[:, -1]


def _gap_derivatives(stepper: Stepper, run: RunArguments, t: Any, hit: Hit) -> Array:
    """Return the derivatives of all quantities, gaps among them, just before an impact at t.

    Their shape is (quantities, rows). Raises InputError where the module was compiled without them.
    """
    binding = stepper._derivative_binding()
    derivatives = binding.quantity_derivatives(
        binding.module.parameters(run.parameters, t), t, hit.q, hit.p_before)
    if derivatives is None:
        raise _error_of_gaps(stepper)
    return derivatives


def _error_of_gaps(stepper: Stepper) -> InputError:
    """Return the error of gaps whose derivatives were not compiled."""
    return InputError(f"The gaps of {stepper.name} are too many or too long for derivatives; use "
                      "differences of runs.")


class _JumpEquations:
    """Functions of a jump at q, from p⁻ to p⁺, and their derivatives.

    A derivative has a column for each entry of (q, p⁻, parameters, Δt, t); the column of Δt is 0,
    for a jump has no length. Without constraints, m = 0, f, y and λ are empty arrays.
    """

    def __init__(self, stepper: Stepper, run: RunArguments, t: Any, hit: Hit) -> None:
        """Evaluate φ_q, G, f_p and W = f_p Gᵀ at (q, p⁻, t)."""
        self._stepper, self._t, self._hit = stepper, t, hit
        self._binding, n = stepper._derivative_binding(), stepper.binding.n
        self.n, self._allocate, self._rows = n, self._binding.module.new, self._binding.rows
        self._parameters = self._binding.module.parameters(run.parameters, t)
        quantities = _gap_derivatives(stepper, run, t, hit)
        self.phi_q, self._quantity_count = quantities[hit.gap, :n], len(quantities)
        g, self.f_before = self._binding.constraint_derivatives(
            self._parameters, hit.q, hit.p_before)
        self.G, self.f_p = g[:, :n], self.f_before[:, n : 2 * n]
        self.W = self.f_p @ self.G.T
        #: dq and dp⁻ are rows of the unit matrix.
        unit = np.eye(2 * n, self._rows, dtype=self.phi_q.dtype)
        self.dq, self.dp_before = unit[:n], unit[n:]

    def constraint_impulses(self, run: RunArguments) -> tuple[Array, Array]:
        """Return y of f(q, p⁻ − Gᵀ y) = 0 and λ of Gᵀ λ = p⁺ − p⁻ − φ_qᵀ μ, shape (m,) each."""
        hit, primal = self._hit, self._stepper.binding
        _, (f,) = primal.defects(primal.parameters(run.parameters, self._t), hit.q[None],
                                 hit.p_before[None])
        # f is affine in p with the derivative W by −y; λ by the normal equations of Gᵀ
        y = solve(self.W, f[: len(self.W)])  # behind f come conditions of velocities
        impulse = hit.p_after - hit.p_before - self.phi_q * hit.impulse
        return y, solve(self.G @ self.G.T, self.G @ impulse)

    def f_derivatives(self, p: Array) -> Array:
        """Return the derivatives of f at (q, p), shape (m, rows)."""
        return self._binding.constraint_derivatives(self._parameters, self._hit.q, p).f

    def impulse_derivatives(self, p: Array, mu: Any, lam: Array) -> Array:
        """Return the derivatives of φ_qᵀ μ + Gᵀ λ at fixed μ and λ, shape (n, rows)."""
        impulses, _ = self._module_derivatives(p, mu, lam)
        return impulses

    def rate_derivatives(self, p: Array) -> Array:
        """Return the derivatives of the rate r(q, p) of the gap, shape (1, rows)."""
        _, rates = self._module_derivatives(p, mu=0, lam=self._allocate(len(self.G)))
        return rates

    def along(self, derivatives: Array, dp: Array) -> Array:
        """Return f_q dq + f_p dp + f_θ dθ of a function f, whose p moves by ``dp``, unlike p⁻.

        ``derivatives`` are f_q, f_p and f_θ in columns; ``dp`` has the shape (n, rows).
        """
        at_fixed_p = derivatives.copy()
        at_fixed_p[:, self.n : 2 * self.n] = 0
        total: Array = at_fixed_p + derivatives[:, self.n : 2 * self.n] @ dp
        return total

    def _module_derivatives(self, p: Array, mu: Any, lam: Array) -> tuple[Array, Array]:
        """Return the derivatives of the impulses φ_qᵀ μ + Gᵀ λ and of the rate φ̇ by the state.

        Shapes (n, rows) and (1, rows), by the compiled code: by q, p, parameters and t.
        """
        n, gap = self.n, self._hit.gap
        impulses = self._allocate(self._quantity_count)
        impulses[gap] = mu
        # columns of the C are q, p, parameters and t; impulses along φ_qᵀ and Gᵀ do not depend on p
        forces = self._allocate(n, self._rows - n - 1)
        rates = self._allocate(self._quantity_count, self._rows - 1)
        self._stepper._jump_binding()(self._parameters, self._t, self._hit.q, p, impulses, lam,
                                      forces, rates)
        return self._pad_columns(forces, n), self._pad_columns(rates[gap : gap + 1], 2 * n)

    def _pad_columns(self, derivatives: Array, state_columns: int) -> Array:
        """Return derivatives of the C with columns of 0 for those that it leaves out: (·, rows).

        The first ``state_columns`` are by q (n), or by q and p (2 n); those of parameters and the
        time follow.
        """
        complete: Array = self._allocate(len(derivatives), self._rows)
        complete[:, :state_columns] = derivatives[:, :state_columns]
        complete[:, 2 * self.n : -2] = derivatives[:, state_columns:-1]
        complete[:, -1] = derivatives[:, -1]
        return complete


def _jump(stepper: Stepper, run: RunArguments, t: Any, hit: Hit) -> Array:
    """Return the derivatives of (q, p⁺) by q, p⁻, parameters, step and time, shape (2 n, rows).

    With the gap φ and its rate r, the impulses μ of the gap and λ of the constraints, the
    restitution e, and y of f(q, p⁻ − Gᵀ y) = 0, the equations of a jump, differentiated, are

        dp⁺ = dp⁻ + d(φ_qᵀ) μ + d(Gᵀ) λ + R (dμ, dλ),                      R = [φ_qᵀ Gᵀ]
        dr(q, p⁺ − Gᵀ y) + e dr(q, p⁻ − Gᵀ y) + r(q, p⁻ − Gᵀ y) de = 0
        df(q, p⁺) − df(q, p⁻) = 0
        d(Gᵀ y) = d(Gᵀ) y + Gᵀ W⁻¹ df(q, p⁻ − Gᵀ y) at fixed y,            W = f_p Gᵀ

    The two in the middle have residuals at dμ = dλ = 0, and (dμ, dλ) = −([r_p; f_p] R)⁻¹ residual.
    """
    jump = _JumpEquations(stepper, run, t, hit)
    n, G_T, along = jump.n, jump.G.T, jump.along
    e = as_real("restitution", hit.impact.restitution, stepper.binding.number)
    y, lam = jump.constraint_impulses(run)
    # dp⁺ at dμ = dλ = 0
    dp_fixed = jump.dp_before + jump.impulse_derivatives(hit.p_before, hit.impulse, lam)
    # r is taken at momenta that keep f = 0: p − Gᵀ y
    projected_before, projected_after = (p - G_T @ y for p in (hit.p_before, hit.p_after))
    # d(Gᵀ y): at fixed y, and with dy
    d_projection = jump.impulse_derivatives(projected_before, mu=0, lam=y)
    d_projection = d_projection + G_T @ solve(jump.W, along(
        jump.f_derivatives(projected_before), jump.dp_before - d_projection))
    r_before, r_after = (jump.rate_derivatives(p) for p in (projected_before, projected_after))
    r_p = r_after[:, n : 2 * n]
    rate_residual = (along(r_after, dp_fixed - d_projection)
                     + e * along(r_before, jump.dp_before - d_projection))
    if hit.parameter is not None:
        # r de. C returns derivatives of r alone, but r is affine in p: its jump, −(1 + e) r, is
        # r_p (p⁺ − p⁻)
        rate_residual[0, hit.parameter] -= (r_p @ (hit.p_after - hit.p_before))[0] / (1 + e)
    f_residual = (along(jump.f_derivatives(hit.p_after), dp_fixed)
                  - along(jump.f_before, jump.dp_before))
    residual = np.concatenate([rate_residual, f_residual])
    R = np.concatenate([jump.phi_q[:, None], G_T], axis=1)
    by_impulses = np.concatenate([r_p, jump.f_p]) @ R
    return np.concatenate([jump.dq, dp_fixed - R @ solve(by_impulses, residual)])
