"""Whether states are on the constraints, up to round-off: many of them at once.

Round-off is what 64 ε of each coordinate and momentum is worth in g and f, whatever their units,
and in f 64 ε of what forces add to the momenta in a step.
IMS and EMS let the momentum constraint oscillate at their truncation error (paper, Fig. 7), and
their own results must be usable as a start: there f may be as large as what an explicit Euler
step, without constraint forces, changes in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.arrays import Array
from ...core.errors import GyrosparkError, InputError
from ...core.manifest import Manifest
from ...core.projection import project
from ...core.records import dataclass
from ...core.registry import MEANS
from ...core.start import Rule
from ..bindings.array_checks import as_real
from ..bindings.binding import Binding, CompiledConstraints
from ..bindings.run_memory import ParameterStruct, WorkMemory
from ..rigid_body.gamma_rules import is_inertia_parameter

if TYPE_CHECKING:
    from ..steppers.evaluation import Evaluation
    from .run_arguments import RunArguments

__all__ = ["Defects", "ProjectedStart", "defects_of_starts", "project_start", "refuse_inconsistent",
           "refuse_singular_mass", "refuse_undefined_energy", "stand_in_values", "text_of_move"]

#: Most coordinates that are moved each by itself: for more of them that takes gigabytes.
_MOST_COORDINATES = 2000
#: Fractions by which a state is moved as a whole.
_DRAWS = 2
#: Round-off of a projected start, in ε of its size: of equations with a condition of thousands.
_ROUNDING = 4096
#: What typed digits are off by, in parts of the size: not worth a warning.
_TYPED = 1e-12


@dataclass(frozen=True)
class Defects:
    """|g| and |f| of states, and bounds of both; arrays with one entry a state."""

    g: Array
    f: Array
    g_bound: Array
    f_bound: Array

    @property
    def consistent(self) -> Array:
        """Whether each state is consistent; NaN counts as consistent, and its first step fails."""
        return ~((self.g > self.g_bound) | (self.f > self.f_bound))


def defects_of_starts(
    binding: Binding, keeps_f: bool, parameters: ParameterStruct, q: Array, p: Array, dt: Array
) -> Defects:
    """Return |g| and |f| of rows of q and p, (rows, n), with their bounds.

    There must be a constraint. ``parameters`` are one struct for all rows, or
    ``Binding.parameter_sets`` with a struct for each. ``keeps_f`` says whether the scheme keeps the
    momentum constraint; ``dt``, (rows,), is used if it does not.

    If all rows are within lower bounds, which take O(n) numbers, the bounds are these; otherwise
    sums over all coordinates, which take O(n²) numbers and are left out for thousands of them.
    """
    for moves_of in (_draws, _single_moves):
        defects = _defects_and_bounds(binding, keeps_f, parameters, q, p, dt, moves_of(binding.n))
        within = (defects.g <= defects.g_bound) & (defects.f <= defects.f_bound)
        if within.all() or binding.n > _MOST_COORDINATES:
            break
    return defects


class ProjectedStart(NamedTuple):
    """A start on the constraints of a run."""

    q: Any
    p: Any
    warning: str = ""  # how far the start has moved, if by more than round-off


def project_start(
    stepper: Evaluation, q: Any, p: Any, parameters: Mapping[str, Any], t: Any
) -> ProjectedStart:
    """Project the start (q, p) of a model onto g(q) = 0 and g_q H_p = 0 of a run.

    A consistent start keeps its bits. A start that cannot be projected is returned unchanged: the
    check of the run refuses it, after the checks of the other arguments.
    """
    binding = stepper.binding
    if not binding.conditions:
        return ProjectedStart(q, p)
    values = dict.fromkeys(binding.input_names, 0.0) | stand_in_values(parameters)
    try:
        state = stepper._state(q, p)
        t0 = as_real("t", t, binding.number)
        compiled_parameters = binding.parameters(stepper.check_parameters(values), t0)
        full_state = binding.start_in_scaled_time(compiled_parameters, *state, t0)
        # the bits of a start that is consistent stay: a projection would round them anew
        if binding.is_consistent(compiled_parameters, *full_state):
            return ProjectedStart(q, p)
        with np.errstate(all="ignore"):
            projected_state = stepper._project(*full_state, compiled_parameters)
    except GyrosparkError:
        return ProjectedStart(q, p)
    system = stepper.manifest.system
    q1, p1 = (x[: binding.shown] for x in projected_state)
    return ProjectedStart(q1, p1, text_of_move(binding, state[0], q1, system.coordinates)
                          or text_of_move(binding, state[1], p1, system.momenta))


def stand_in_values(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return values of parameters with which a start is projected, without a search.

    Constraints depend on no γ, α or rate of a frame, so that any number serves for these.
    """
    values: dict[str, Any] = {}
    for name, value in parameters.items():
        if not isinstance(value, Rule):
            values[name] = value
        elif is_inertia_parameter(name):  # a mean in place of a search
            values[name] = value if value.name in MEANS else Rule("m", value.inertia)
        # the rate of a frame by a rule is left out, which makes it 0
    return values


def text_of_move(binding: Binding, start: Array, end: Array, names: Sequence[str]) -> str:
    """Return a sentence on how far a projection moved q or p, (n,); empty if by round-off alone.

    ``names`` has a name for each entry.
    """
    start, end = (np.asarray(x, dtype=float) for x in (start, end))
    distances = np.abs(end - start)
    furthest = int(np.argmax(distances))
    if distances[furthest] <= max(_ROUNDING * binding.epsilon, _TYPED) * np.abs(start).max():
        return ""
    return (f"The start is off the constraints; {names[furthest]} = {start[furthest]:.9g} is moved "
            f"furthest, to {end[furthest]:.9g}.")


def refuse_inconsistent(binding: Binding, manifest: Manifest, run: RunArguments) -> None:
    """Refuse a start that is off the constraints by more than round-off."""
    if not binding.conditions:
        return
    parameters = binding.parameters(run.parameters, run.t0)
    if not binding.is_consistent(parameters, run.q, run.p):
        _refuse_off_constraints(binding, manifest, parameters, run)


@np.errstate(over="ignore", invalid="ignore")  # the steps judge what is not finite
def _refuse_off_constraints(
    binding: Binding, manifest: Manifest, parameters: ParameterStruct, run: RunArguments
) -> None:
    """Refuse a start whose |g(q)| or |f(q, p)| is above its bound, with the cure.

    The bound is the change of g or f by round-off of the coordinates and momenta.
    """
    defects = defects_of_starts(binding, manifest.scheme.keeps_momentum_constraint, parameters,
                                run.q[None], run.p[None], np.array([run.dt]))
    if defects.consistent[0]:
        return
    g, f, g_bound, f_bound = (float(x[0]) for x in (defects.g, defects.f, defects.g_bound,
                                                    defects.f_bound))
    q_size = float(np.linalg.norm(run.q[: binding.shown].astype(float)))
    rigid = manifest.system.rigid_body
    norm = f", |q| = {q_size:.15g}" if rigid else ""
    momentum_defect = "q^T p" if rigid else "the momentum constraint"
    if binding.rows:
        momentum_defect = "the constraints on momenta and velocities"
    raise InputError(
        f"The start is off the constraints: |g(q)| = {g:.3e}{norm}, {momentum_defect} = {f:.3e} "
        f"(allowed {g_bound:.1e} and {f_bound:.1e}). {_cure(binding, manifest, parameters, run)}")


def _cure(
    binding: Binding, manifest: Manifest, parameters: ParameterStruct, run: RunArguments
) -> str:
    """Return the cure of the error: how to move the start onto the constraints, or why not."""
    q, p = run.q.copy(), run.p.copy()
    # the compiled projection moves q and p in place, and returns a status that is not 0 if it
    # fails; that in NumPy, for doubles alone, names the constraints that cannot be met
    if binding.project(parameters, q, p) and binding.dtype is np.float64 and not binding.rows:
        try:
            with np.errstate(all="ignore"):
                # in scaled time the last coordinate is t; else t is not read
                project(CompiledConstraints(binding, manifest, parameters, t=run.q[-1]),
                        run.q[: binding.shown], run.p[: binding.shown])
        except InputError as error:
            return str(error)
    timed = binding.is_timed or binding.clocked
    cure = (f"`q, p = stepper.project(q, p, parameters=...{', t=t0' * timed})` "
            "moves it onto them.")
    start, projected = (np.concatenate([x[: binding.shown] for x in state]).astype(float)
                        for state in ((run.q, run.p), (q, p)))
    # a start that was once an array of float32 is off by its round-off: a frequent mistake
    single = float(np.finfo(np.float32).eps)
    if binding.epsilon < single and (start.astype(np.float32) == start).all() and (
            np.abs(projected - start).max() <= 8 * single * np.abs(start).max()):
        cure += (" All its numbers are of single precision: compute them from arrays of doubles, "
                 "x.astype(float).")
    return cure


def refuse_undefined_energy(binding: Binding, run: RunArguments) -> None:
    """Refuse a start where H is no finite number: its derivatives may be finite nevertheless."""
    parameters = binding.parameters(run.parameters, run.t0)
    if not binding.has_finite_energy(parameters, run.q, run.p):
        (H,) = binding.hamiltonian(parameters, run.q[None], run.p[None])
        cause = ("as of a root or a logarithm of a negative number, or of terms beyond the largest "
                 "number; start elsewhere, write H so that it is defined there, such as "
                 "log(abs(x)), or choose other units" if H != H else
                 "at a pole or beyond the largest number of its type; start elsewhere, or choose "
                 "larger units")
        raise InputError(f"H = {float(H)} at the start, {cause}.")


def refuse_singular_mass(binding: Binding, manifest: Manifest, run: RunArguments) -> None:
    """Refuse a start where the mass matrix M of a Lagrangian is singular, or has a wrong sign.

    Momenta of velocities v are p(q, v) = M(q) v + p(q, 0), so that column i of M is
    p(q, e_i) − p(q, 0). M is scaled to entries of at most 1 before its eigenvalues are compared.
    """
    system = manifest.system
    if not system.velocity_names:
        return
    n = binding.n
    # velocities 0 and e_i, a row each, all at the same q
    velocities = np.concatenate([np.zeros((1, n)), np.eye(n)]).astype(binding.dtype)
    at_rest, *columns = binding.momenta(
        binding.parameters(run.parameters, run.t0), np.repeat(run.q[None], n + 1, axis=0),
        velocities)
    M = (np.array(columns) - at_rest).astype(float)
    sizes = np.sqrt(np.abs(M).max(axis=1, initial=0))
    if not np.isfinite(M).all():
        return  # the first step fails, and says why
    massless = next((name for name, size in zip(system.velocity_names, sizes, strict=True)
                     if not size), "")
    eigenvalues = (np.linalg.eigvalsh(M / np.outer(sizes, sizes)) if not massless
                   else np.zeros(1))
    round_off = 8 * n * np.finfo(float).eps * np.abs(eigenvalues).max()
    if np.abs(eigenvalues).min() <= round_off:
        where = f": motion with {massless} costs no kinetic energy there" if massless else ""
        raise InputError("The mass matrix has no inverse at the start, so that momenta do not tell "
                         f"velocities{where}; start elsewhere, or take other coordinates.")
    # the generator has seen M only positive definite, and factorises it without pivots
    if eigenvalues[0] < 0 and not system.indefinite:
        raise InputError("The mass matrix is not positive definite at the start, and it was at "
                         "every place where it was looked at, so that it is factorised without "
                         "pivots; write the numbers of its parameters into L.")


@dataclass(frozen=True)
class _Moves:
    """Parts of |q| and |p| by which states are moved, shape (moves, n); the first move is 0.

    Attributes
    ----------
    change : callable
        From g or f after each move, shape (rows, moves, m), to changes, shape (rows, ·), of which
        the largest is compared.
    euler : float
        Factor of an explicit Euler step that is used as a move.
    """

    q: Array
    p: Array
    change: Callable[[Array], Array]
    euler: float


def _sum_changes(values: Array) -> Array:
    """Return Σₖ |d(xₖ) − d(x₀)| over the moves k, (rows, m); ``values`` are d, (rows, moves, m)."""
    sums: Array = np.abs(values[:, 1:] - values[:, :1]).sum(axis=1)
    return sums


def _forth_and_back(values: Array) -> Array:
    """Return |d(x + w) − d(x − w)|/2 of each draw w, shape (rows, draws · m), as ``_Moves.change``.
    """
    # moves are 0, then the draws, then the draws with the other sign
    plus, minus = values[:, 1 : _DRAWS + 1], values[:, _DRAWS + 1 :]
    half_differences: Array = np.abs(plus - minus).reshape(len(values), -1) / 2
    return half_differences


@lru_cache(maxsize=8)
def _single_moves(n: int) -> _Moves:
    """Return moves of each q and each p by itself, whose changes are added up."""
    none, unit, zeros = np.zeros((1, n)), np.eye(n), np.zeros((n, n))
    # 2 n + 1 moves: none, each q, each p; the Euler step is taken whole
    return _Moves(q=np.vstack([none, unit, zeros]), p=np.vstack([none, zeros, unit]),
                  change=_sum_changes, euler=1.0)


@lru_cache(maxsize=8)
def _draws(n: int) -> _Moves:
    """Return a few moves with changes of g and f below those of ``_single_moves``, to second order.

    |Σ wₖ aₖ| ≤ Σ |aₖ| if no |wₖ| exceeds 1: all q and p are moved at once, by fixed random
    fractions, forth and back. The difference has no term of second order, where moves of several
    coordinates would add to each other. No fraction is near 0.
    """
    rng = np.random.default_rng(0)
    # for q and for p: one row a draw
    draws = rng.choice([-1.0, 1.0], (2, _DRAWS, n)) * rng.uniform(0.5, 0.99, (2, _DRAWS, n))
    q_moves, p_moves = (np.vstack([np.zeros((1, n)), w, -w]) for w in draws)
    # an Euler step is no small move: half of it leaves room for terms of third order
    return _Moves(q_moves, p_moves, _forth_and_back, euler=0.5)


def _move_scales(binding: Binding) -> tuple[float, float]:
    """Return ν = 2⁻¹⁰ ε^¼, the size of a move as a part of |q| or |p|, and 64 ε/ν."""
    nudge = 2.0**-10 * binding.epsilon**0.25
    return nudge, 64 * binding.epsilon / nudge


def _defects_and_bounds(
    binding: Binding, keeps_f: bool, parameters: ParameterStruct, q: Array, p: Array, dt: Array,
    moves: _Moves
) -> Defects:
    """Return |g| and |f| of each row of q and p, shape (states, n), and their bounds by ``moves``.

    The bound of g is its change by a move of 64 ε |q|, computed with a larger move and scaled down.
    The bound of f is the like change of f; for rows beyond it, p also moves by 64 ε of the kick of
    forces in a step (``keeps_f``), or the change of f in an explicit Euler step is added.
    """
    nudge, epsilons = _move_scales(binding)
    dq, dp = (nudge * np.sqrt(np.einsum("ij,ij->i", x, x))
              for x in (x.astype(float, copy=False) for x in (q, p)))
    sizes = _sizes(binding, parameters, q, p, dq, dp, moves)
    g_bound, f_bound = epsilons * sizes.g_change, epsilons * sizes.f_change
    has_sets = binding.sets(parameters) > 1
    for i in np.flatnonzero(sizes.f > f_bound):
        row = slice(i, i + 1)
        own_parameters = binding.set_of(parameters, int(i)) if has_sets else parameters
        step = own_parameters, dt[i], q[i].copy(), p[i].copy(), binding.work()
        if keeps_f:  # near rest a step rounds what forces add to p, and constraints take away
            kick = _largest_kick(binding, *step)
            f_bound[row] = epsilons * _sizes(binding, own_parameters, q[row], p[row], dq[row],
                                             dp[row] + nudge * kick, moves).f_change
            continue
        # the unknowns of an explicit step: increments of q and p
        x = binding.guess(*step)
        n = binding.n
        by_q, by_p = (moves.euler * np.array([float(np.abs(d).max())])
                      for d in (x[:n], x[n : 2 * n]))
        f_bound[row] += _sizes(binding, own_parameters, q[row], p[row], by_q, by_p,
                               moves).f_change
    return Defects(sizes.g, sizes.f, g_bound, f_bound)


def _largest_kick(
    binding: Binding, parameters: ParameterStruct, dt: float, q: Array, p: Array, work: WorkMemory
) -> float:
    """Return the largest number that forces add to a momentum in a step, by an explicit step."""
    if not binding.solves:  # exact flows have no starting guess, and their step is explicit
        _, _, end = binding.step(parameters, binding.options(None, 1, "auto"), dt, q, p, work)
        return float(np.abs(end - p).max(initial=0))
    kick = float(np.abs(binding.guess(parameters, dt, q, p, work)[binding.kicks]).max(initial=0))
    return kick if binding.solves_increments else kick * abs(float(dt))


class _Sizes(NamedTuple):
    """Sizes of g and f at states, and of their largest changes by moves, shape (rows,) each."""

    g: Array
    f: Array
    g_change: Array
    f_change: Array


def _sizes(
    binding: Binding, parameters: ParameterStruct, q: Array, p: Array, dq: Array, dp: Array,
    moves: _Moves
) -> _Sizes:
    """Return max |g|, max |f| and their largest changes by ``moves``.

    One compiled call evaluates all. ``dq`` and ``dp``, (rows,), are sizes of the moves of each row.
    """
    states = []
    for x, size, move in ((q, dq, moves.q), (p, dp, moves.p)):
        neighbours = x[:, None] + size[:, None, None] * move  # (rows, moves, n)
        states.append(np.ascontiguousarray(neighbours.reshape(-1, binding.n), dtype=binding.dtype))
    defects = [d.reshape(len(q), len(moves.q), d.shape[1])
               for d in binding.defects(parameters, *states)]
    # the first move is 0: the state itself
    entries = [np.abs(d[:, 0]) for d in defects] + [moves.change(d) for d in defects]
    return _Sizes(*(x.max(axis=1, initial=0).astype(float, copy=False) for x in entries))
