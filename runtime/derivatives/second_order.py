"""Second derivatives: how an adjoint changes along a direction, and Hessians of functions of a run.

A function L of a run is one of its start (q, p), which is projected onto the constraints, and of
parameters and times. Its gradient is Π(z)ᵀ z̄, where z̄ is the cotangent that the adjoint of the
steps leads to and Π the derivative of the projection (``tangent_space``). Along a direction in the
range of Π, tangent to the constraints, it changes by

    (Πᵀ z̄)' = Πᵀ z̄' + Π'ᵀ z̄

z̄' by the compiled derivative of the adjoint, Π' by the derivative of the Jacobians of g and f.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from ...core.arguments import few, shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.html import card, table
from ...core.records import dataclass
from ..bindings.binding import Binding
from ..bindings.run_memory import ParameterStruct
from ..integration.run_arguments import RunArguments
from .binding import DerivativeBinding, KeptSteps
from .gradient import Cotangents, as_bytes
from .kept_steps import linearisation_error, refuse_run, split, step_bytes
from .tangent_space import TangentSpace, solve

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["Hessian", "SecondBinding", "Slopes", "hessian_of", "pulled_back_slope", "step_slope"]

#: Steps whose tangents are kept at a time.
_BLOCK = 512

#: From the directions of stored states, {"q", "p", "t", "parameters"}, to those of cotangents.
Slopes = Callable[[dict[str, Any]], Mapping[str, Any]]


class _Inputs(NamedTuple):
    """Inputs of steps, shape (steps, inputs) each, in the order of the arguments of C."""

    direction: Array  # the change of the inputs along the direction
    cotangents: Array
    cotangent_slopes: Array


@dataclass(frozen=True)
class CotangentSlopes:
    """Cotangents on their way back through steps, each with its slope along one direction.

    Attributes
    ----------
    w : tuple of 2 array, shape (2 n,)
        The cotangent of the present state, and its slope.
    z_bar : tuple of 2 array, shape (rows,)
        The cotangent of start, parameters and Δt so far, and its slope.
    inputs : _Inputs
    """

    w: tuple[Array, Array]
    z_bar: tuple[Array, Array]
    inputs: _Inputs

    @classmethod
    def at_end(cls, second: SecondBinding, w: Array, w_slope: Array, steps: int) -> Self:
        """Return the cotangents at the last state, w and its slope, (2 n,) each, and zeros.

        The inputs of the ``steps`` steps before it do not move along the direction.
        """
        new = second.module.new
        return cls((w.copy(), w_slope.copy()), (new(second.rows), new(second.rows)),
                   _inputs_of(second, steps))

    def before(self, second: SecondBinding, steps: int) -> Self:
        """Return the same w and z_bar with arrays of inputs for the ``steps`` steps before."""
        return replace(self, inputs=_inputs_of(second, steps))


def _inputs_of(second: SecondBinding, steps: int) -> _Inputs:
    """Return zeros for the direction, the cotangents and their slopes of the inputs of steps."""
    return _Inputs(*(second.module.new(steps, len(second.module.input_names)) for _ in range(3)))


class SecondBinding:
    """Calls into the module of second derivatives; ``module`` makes its structs."""

    def __init__(self, binding: Binding, first: DerivativeBinding) -> None:
        """Take the module of second derivatives, and the sizes of a direction from the first ones.
        """
        self.module, self.n, self.rows = binding, first.n, first.rows
        self._size = int(binding.function("second_size")())

    def integrate_second(
        self, run: RunArguments, parameters: ParameterStruct, steps: KeptSteps, tangents: Array,
        dz: Array, rows: tuple[Array, Array], every: int, cotangents: CotangentSlopes,
    ) -> int:
        """Take ``cotangents`` backwards through kept steps, in place; return the status.

        ``dz``, shape (rows,), is the direction at the start; its q and p before each step are
        ``tangents``, (steps, 2 n). ``rows`` are the cotangents of the states before these steps
        that are stored, at each ``every``-th step of the run, and their slopes, (·, 2 n) each.
        """
        binding = self.module
        memory, _owner = binding.bytes_at(self._size)
        inputs = ([*binding.input_arguments(run.inputs)[:2],
                   *map(binding.pointer, cotangents.inputs)]
                  if binding.input_names else [])
        return int(binding.function("integrate_second")(
            parameters, *inputs, run.dt, steps.first, steps.count,
            *map(binding.pointer, (steps.q, steps.p, steps.x, tangents, dz, *rows)), every,
            *map(binding.pointer, (*cotangents.w, *cotangents.z_bar)), memory))

    def constraint_slopes(
        self, parameters: ParameterStruct, q: Array, p: Array, dz: Array
    ) -> tuple[Array, Array]:
        """Return the derivatives along dz of ∂g and ∂f, shape (m, rows) each."""
        binding = self.module
        memory, _owner = binding.bytes_at(self._size)
        g, f = binding.new(binding.m, self.rows), binding.new(binding.m, self.rows)
        if binding.m:
            binding.function("constraint_second")(
                parameters, *map(binding.pointer, (q, p, dz, g, f)), memory)
        return g, f


def pulled_back_slope(
    second: SecondBinding, space: TangentSpace, parameters: ParameterStruct, q: Array, p: Array,
    dz: Array, z_bar: Array, z_bar_slope: Array,
) -> Array:
    """Return the derivative of ``space.pulled_back(z_bar)`` along dz, shape (rows,) each.

    dz is tangent to the constraints at (q, p), and ``z_bar_slope`` the derivative of ``z_bar``
    along it. By the product rule (A⁻¹ b)' = A⁻¹ (b' − A' A⁻¹ b), for A = W = f_p Gᵀ and A = G Gᵀ,
    it follows from

        z̄ ← z̄ − fᵀ W⁻ᵀ G p̄,   then   z̄ ← z̄ − gᵀ (G Gᵀ)⁻¹ G q̄,

    where f and g are the derivatives of the constraints by all rows, (m, rows).
    """
    slope = z_bar_slope.copy()
    if not len(space.g):
        return slope
    n, g, f = space.n, space.g, space.f
    g_slope, f_slope = second.constraint_slopes(parameters, q, p, np.ascontiguousarray(dz))
    G, G_slope = g[:, :n], g_slope[:, :n]

    if space.binding.keeps_momentum:
        f_p, f_p_slope = f[:, n : 2 * n], f_slope[:, n : 2 * n]
        # the transposes of ``TangentSpace.project`` in reverse order: first that of p
        W, W_slope = f_p @ G.T, f_p_slope @ G.T + f_p @ G_slope.T
        of_p, of_p_slope = _correction(G, G_slope, f, f_slope, W.T, W_slope.T, z_bar[n : 2 * n],
                                      z_bar_slope[n : 2 * n])
        z_bar, slope = z_bar - of_p, slope - of_p_slope
    half_slope = G_slope @ G.T  # (G Gᵀ)' = G' Gᵀ + (G' Gᵀ)ᵀ
    _, of_q_slope = _correction(G, G_slope, g, g_slope, G @ G.T, half_slope + half_slope.T,
                                z_bar[:n], slope[:n])
    return slope - of_q_slope


def _correction(
    G: Array, G_slope: Array, rows: Array, rows_slope: Array, A: Array, A_slope: Array, z: Array,
    z_slope: Array,
) -> tuple[Array, Array]:
    """Return rowsᵀ A⁻¹ G z and its slope; G, rows, A and z come with their slopes."""
    y = solve(A, G @ z)
    y_slope = solve(A, G_slope @ z + G @ z_slope - A_slope @ y)
    return rows.T @ y, rows_slope.T @ y + rows.T @ y_slope


@dataclass(frozen=True)
class Hessian:
    """The second derivatives of a function of a run.

    Attributes
    ----------
    matrix : array, shape (k, k)
        Second derivatives by ``names``: the symmetric part of the computed matrix.
    asymmetry : float
        The largest entry of the other part, relative to the largest of the matrix: round-off.
    names : tuple of str
        "start[0]" and so on are coordinates y of the tangent space, z0 + B y, of which ``basis`` is
        B. Parameters that move the constraints move the start too, in the first order, before it is
        projected; with a start that stays, second derivatives by them differ (docs/derivatives.md).
    gradient : array, shape (k,)
        The first derivatives by the same.
    value : float or None
        The function, where ``loss`` computed it.
    """

    matrix: Array
    asymmetry: float
    names: tuple[str, ...]
    gradient: Array
    basis: Array
    value: Any = None

    def __repr__(self) -> str:
        return f"<Hessian by {few(self.names)}>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the gradient and the first columns of the matrix."""
        rows = [(name, f"{float(slope):.6g}", few(f"{float(x):.6g}" for x in row)) for
                name, slope, row in zip(self.names, self.gradient, self.matrix, strict=True)]
        return card("Hessian", table(rows, ("", "gradient", "second derivatives")))


def _refuse_first_order_alone(cotangents: Cotangents) -> None:
    """Refuse a function of multipliers or of states within steps: they have a gradient alone."""
    if cotangents.multipliers.size:
        raise InputError("A Hessian is of states, and this function depends on multipliers, which "
                         "have first derivatives alone; leave them out.")
    if cotangents.points:
        raise InputError("A Hessian is of states at the ends of steps, and this function depends "
                         "on states within them; give cotangents of rows alone.")


def hessian_of(
    stepper: Stepper, run: RunArguments, cotangents: Cotangents, slopes: Slopes | None,
    checked: Callable[[Mapping[str, Any]], Cotangents], wrt: tuple[str, ...], memory: Any,
    value: Any = None,
) -> Hessian:
    """Return the Hessian Dᵀ (Πᵀ z̄)' of a function of a checked run, one column a direction of D.

    z̄, shape (rows,), are the function's derivatives by z = (q₀, p₀, parameters, Δt, t0), and
    (Πᵀ z̄)' are slopes along the columns of D, shape (rows, k), directions tangent to the
    constraints: one for each name of ``wrt``, and for "start" a basis. ``cotangents`` are the
    function's derivatives by the stored states; ``slopes`` says how these change along a direction
    (None: they do not), and ``checked`` checks its answers. All steps are kept, in at most
    ``memory``; ``value`` goes into the result. Raises InputError for what a Hessian is not taken
    by, for states within steps, for too little memory; StepFailed as the run itself does.
    """
    refuse_run(run)
    _refuse_first_order_alone(cotangents)
    stored_run = _StoredRun(stepper, run, memory)
    space = TangentSpace(stored_run.first_order, stored_run.parameters, run.q, run.p,
                         stepper.constraint_names)
    names, D = _directions(stepper, space, wrt, run)
    stored_tangents, block_tangents = stored_run.tangents(D)
    new = stored_run.first_order.module.new
    # t_k = t0 + k Δt of each stored state, along each direction: D[-2] are dΔt, D[-1] are dt0; the
    # zeros have the stepper's type of numbers
    time_directions = (new(len(stored_tangents), len(names))
                       + run.steps_of_rows(run.steps)[:, None] * D[-2] + D[-1])
    columns: list[Array] = []
    gradient = new(len(names))
    # forward over reverse: the tangents of all directions once, then a pass back for each one
    for j in range(len(names)):
        dz = np.ascontiguousarray(D[:, j])
        cotangent_slopes = _cotangent_slopes(stepper, stored_tangents[:, :, j],
                                             time_directions[:, j], dz, slopes, checked)
        # z̄, z̄' along dz, and (Πᵀ z̄)' = Πᵀ z̄' + Π'ᵀ z̄
        z_bar, z_bar_slope = stored_run.adjoint(
            dz, [tangents[:, j] for tangents in block_tangents], cotangents, cotangent_slopes)
        start_slope = pulled_back_slope(stored_run.second_order, space,
                                        stored_run.second_parameters, run.q, run.p, dz, z_bar,
                                        z_bar_slope)
        columns.append(D.T @ start_slope)
        gradient[j] = dz @ space.pulled_back(z_bar)  # z̄ is the same in every pass
    matrix, asymmetry = _symmetric_part(np.array(columns).T)
    return Hessian(matrix, asymmetry, names, gradient, space.basis(), value)


def _symmetric_part(A: Array) -> tuple[Array, float]:
    """Return S = ½ (A + Aᵀ), and the round-off max ½ |A − Aᵀ| / max |S|; 0 for S = 0."""
    matrix, defect = (A + A.T) / 2, np.abs(A - A.T) / 2
    size = float(np.abs(matrix).max(initial=0))
    return matrix, float(defect.max(initial=0)) / size if size > 0 else 0.0


class _StoredRun:
    """All steps of a run in blocks, for tangents forwards and cotangents with slopes backwards.

    Attributes
    ----------
    first_order, second_order : DerivativeBinding, SecondBinding
        The compiled modules, with ``parameters`` and ``second_parameters`` of the run.
    blocks : list of KeptSteps
        At most ``_BLOCK`` steps each; tangents are stored at the start of each block alone.
    """

    def __init__(self, stepper: Stepper, run: RunArguments, memory: Any) -> None:
        """Integrate the run; raise InputError if its steps do not fit in ``memory``."""
        self.stepper, self.run = stepper, run
        self.first_order, self.second_order = (stepper._derivative_binding(),
                                               stepper._second_binding())
        steps = _all_steps(stepper, run, memory)
        self.parameters, self.second_parameters = (
            binding.module.parameters(run.parameters, run.t0)
            for binding in (self.first_order, self.second_order))
        self.blocks = split(steps, np.arange(0, run.steps, _BLOCK)) if run.steps else []

    def tangents(self, D: Array) -> tuple[Array, list[Array]]:
        """Return the directions of the stored states, (stored states, 2 n, k), and of blocks.

        ``D``, shape (rows, k), has the directions of the start in columns. The list has the
        directions of the state at the start of each block, (2 n, k).
        """
        run, new = self.run, self.first_order.module.new
        count, size = D.shape[1], 2 * self.first_order.n
        tangents = D[:size].copy()
        tangent_rows, block_tangents = [D[None, :size]], []
        for block in self.blocks:
            block_tangents.append(tangents.copy())
            row_count = (block.first + block.count) // run.every - block.first // run.every
            rows = new(row_count, size, count)
            status = self.first_order.integrate_tangent(
                run, self.parameters, block, np.ascontiguousarray(D), every=run.every, rows=rows,
                multipliers=new(0), tangents=tangents)
            if status:
                raise linearisation_error(block.first, status)
            tangent_rows.append(rows)
        if run.steps % run.every:  # the last state is stored in any case
            tangent_rows.append(tangents[None].copy())
        stored_tangents: Array = np.concatenate(tangent_rows)
        return stored_tangents, block_tangents

    def adjoint(
        self, dz: Array, block_tangents: list[Array], cotangents: Cotangents,
        cotangent_slopes: Cotangents,
    ) -> tuple[Array, Array]:
        """Return the cotangent z̄ of the start and all parameters, and its slope, (rows,) each.

        The slope is along the direction ``dz`` of the start, (rows,); ``block_tangents`` are its
        q and p at the start of each block. ``cotangent_slopes`` are the derivatives
        of ``cotangents`` along it.
        """
        run, second_order = self.run, self.second_order
        # each block allocates the arrays of its own inputs
        adjoint = CotangentSlopes.at_end(second_order, cotangents.rows[-1],
                                         cotangent_slopes.rows[-1], steps=0)
        _add_explicit(self.stepper, run, cotangents, adjoint.z_bar[0])
        _add_explicit(self.stepper, run, cotangent_slopes, adjoint.z_bar[1])
        for block, tangent in zip(reversed(self.blocks), reversed(block_tangents), strict=True):
            adjoint = adjoint.before(second_order, block.count)
            status = second_order.integrate_second(
                run, self.second_parameters, block,
                tangents=self._tangents_before_steps(block, dz, tangent), dz=dz,
                rows=(_stored_rows(run, block, cotangents.rows),
                      _stored_rows(run, block, cotangent_slopes.rows)),
                every=run.every, cotangents=adjoint)
            if status:
                raise linearisation_error(block.first, status)
        z_bar, z_bar_slope = adjoint.z_bar
        # at the start w is the cotangent of q₀ and p₀
        size = 2 * self.first_order.n
        z_bar[:size], z_bar_slope[:size] = adjoint.w
        return z_bar, z_bar_slope

    def _tangents_before_steps(self, block: KeptSteps, dz: Array, tangent: Array) -> Array:
        """Return the direction before each step of a block, shape (steps, 2 n).

        ``tangent``, (2 n,), is the direction at the start of the block, from which the others
        follow anew; ``dz``, (rows,), the direction of the start of the run.
        """
        new, advanced = self.first_order.module.new, tangent[:, None].copy()
        rows = new(block.count, len(tangent))
        # no status: ``tangents`` has linearised the same steps without failure
        self.first_order.integrate_tangent(
            self.run, self.parameters, block, dz[:, None].copy(), every=1, rows=rows,
            multipliers=new(0), tangents=advanced)
        # C returns directions after each step
        rows[1:], rows[0] = rows[:-1].copy(), tangent
        return rows


def _all_steps(stepper: Stepper, run: RunArguments, memory: Any) -> KeptSteps:
    """Return all steps of a run, kept; raise InputError if they do not fit in ``memory``."""
    limit, needed = as_bytes(memory), run.steps * step_bytes(stepper)
    if limit is None or needed > limit:
        raise InputError(f"memory = {memory!r} is too little: a Hessian keeps all "
                         f"{run.steps:,} steps, {needed:,} bytes; give these.")
    kept_run = stepper._derivative_binding().begin(run)
    steps, status = kept_run.keep(run.steps)
    if status:
        stepper._run(run)  # says why it fails, with everything before
        raise linearisation_error(kept_run.steps_done, status)
    return steps


def _directions(
    stepper: Stepper, space: TangentSpace, wrt: tuple[str, ...], run: RunArguments
) -> tuple[tuple[str, ...], Array]:
    """Return names of k directions, and D, shape (rows, k): the directions in columns.

    They are tangent to the constraints at the start. For "start" in ``wrt`` they are a basis of the
    tangent space; each other name, a parameter or a time, is one direction.
    """
    binding, n = space.binding, stepper.n
    labels = [*stepper.binding.parameter_names, "dt", "t0"]
    names: list[str] = []
    columns: list[Array] = []
    for name in wrt:
        if name in ("q", "p", "inputs"):
            raise InputError(f"A Hessian is not taken by {name!r}; choose 'start', parameters, "
                             "'dt' or 't0'.")
        if name == "start":
            basis = space.basis().T
            names += [f"start[{k}]" for k in range(len(basis))]
            for direction in basis:
                columns.append(binding.module.new(binding.rows))
                columns[-1][: 2 * n] = direction
        else:
            names.append(name)
            columns.append(binding.module.new(binding.rows))
            columns[-1][2 * n + labels.index(name)] = 1
    D = space.project(np.ascontiguousarray(np.array(columns).T))
    # inputs are parameters to the C; each step has its own, which the projection does not move
    if run.inputs is not None:
        D[[2 * n + labels.index(u) for u in stepper.binding.input_names]] = 0
    return tuple(names), D


def _cotangent_slopes(
    stepper: Stepper, tangents: Array, time_direction: Array, dz: Array,
    slopes: Slopes | None, checked: Callable[[Mapping[str, Any]], Cotangents],
) -> Cotangents:
    """Return the derivatives of the cotangents along a direction dz, by the user's ``slopes``.

    ``tangents``, shape (rows, 2 n), and ``time_direction``, (rows,), are the direction at the
    stored states and of their times; ``dz``, of the start, has the parameters. ``checked`` checks
    what ``slopes`` returns. Without ``slopes`` the derivatives are 0.
    """
    n = stepper.n
    cotangents: Mapping[str, Any] = {}
    if slopes is not None:
        names = stepper.binding.parameter_names
        if not callable(slopes):
            raise InputError(f"slopes = {shown(slopes)} is no function; give one of directions "
                             "{'q': ..., 'p': ...} that returns how the cotangents change.")
        cotangents = slopes({"q": tangents[:, :n], "p": tangents[:, n:], "t": time_direction,
                             "parameters": dict(zip(names, dz[2 * n : -2].tolist(), strict=True))})
    return checked(cotangents)


def _add_explicit(
    stepper: Stepper, run: RunArguments, cotangents: Cotangents, z_bar: Array
) -> None:
    """Add to ``z_bar``, (rows,), derivatives by parameters at fixed states, and by times of rows.

    t_k = t0 + k Δt: the cotangent of t_k adds to that of t0, and k times to that of Δt.
    """
    names = stepper.binding.parameter_names
    for name, slope in cotangents.parameters.items():
        z_bar[2 * stepper.n + names.index(name)] += slope
    z_bar[-1] += cotangents.times.sum()
    z_bar[-2] += (cotangents.times * run.steps_of_rows(run.steps)).sum()


def _stored_rows(run: RunArguments, steps: KeptSteps, rows: Array) -> Array:
    """Return the rows of the stored states before the steps, shape (·, 2 n).

    ``rows`` has a row for each stored state of the run.
    """
    first_row = steps.first // run.every
    step_rows: Array = rows[first_row : (steps.first + steps.count - 1) // run.every + 1].copy()
    if steps.first % run.every:
        step_rows[0] = 0  # the state is not stored: its row belongs to an earlier one
    return step_rows


def step_slope(
    stepper: Stepper, run: RunArguments, space: TangentSpace, end: Array, unknowns: Array,
    dz: Array, w: Array,
) -> Array:
    """Return the derivative along dz of D(z)ᵀ z̄, with z̄ = Φ_zᵀ w, for one step Φ, (rows,).

    z̄ is the cotangent of its start, w, (2 n,), of its end, which does not change along ``dz``,
    (rows,). ``end`` is the state after the step, ``unknowns`` the solution of its equations.
    """
    refuse_run(run)
    second, n = stepper._second_binding(), stepper.n
    binding = second.module
    parameters = binding.parameters(run.parameters, run.t0)
    steps = KeptSteps(first=0, q=np.stack([run.q, end[:n]]), p=np.stack([run.p, end[n:]]),
                      x=unknowns[None])
    # the state before the step is stored, and nothing depends on it but through the step
    zero_row = binding.new(1, 2 * n)
    adjoint = CotangentSlopes.at_end(second, w, w_slope=binding.new(2 * n), steps=1)
    status = second.integrate_second(
        run, parameters, steps, np.ascontiguousarray(dz[None, : 2 * n]), dz,
        rows=(zero_row, zero_row), every=1, cotangents=adjoint)
    if status:
        raise linearisation_error(step=0, status=status)
    z_bar, z_bar_slope = adjoint.z_bar
    z_bar[: 2 * n], z_bar_slope[: 2 * n] = adjoint.w
    return pulled_back_slope(second, space, parameters, run.q, run.p, dz, z_bar, z_bar_slope)
