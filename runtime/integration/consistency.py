"""Whether states are on the constraints, up to round-off: many of them at once.

Round-off is what 64 ε of each coordinate and momentum is worth in g and f, whatever their units.
IMS and EMS let the momentum constraint oscillate at their truncation error (paper, Fig. 7), and
their own results must be usable as a start: there f may be as large as what an explicit Euler
step, without constraint forces, changes in it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ..bindings.binding import Binding
from ..results.run_arrays import defect_sizes

if TYPE_CHECKING:
    from .run_arguments import RunArguments

__all__ = ["Defects", "defects_of_starts", "refuse_inconsistent", "refuse_singular_mass"]

Array = NDArray[Any]

#: Fractions by which a state is moved as a whole.
_DRAWS = 2


@dataclass(frozen=True)
class Defects:
    """|g| and |f| of states, and their bounds; arrays with one entry a state."""

    g: Array
    f: Array
    g_bound: Array
    f_bound: Array

    @property
    def consistent(self) -> Array:
        """Whether each state is consistent; NaN counts as such, and its first step fails."""
        return ~((self.g > self.g_bound) | (self.f > self.f_bound))


def defects_of_starts(
    binding: Binding, keeps_f: bool, parameters: Any, q: Array, p: Array, dt: Array
) -> Defects:
    """Return the defects of rows of q and p; there must be a constraint.

    ``parameters`` are those of all rows, or ``Binding.parameter_sets`` with one set for each.
    ``keeps_f`` says whether the scheme keeps the momentum constraint; ``dt`` is used if not.

    If all rows are within lower bounds, which take O(n) numbers, the bounds are these; otherwise
    the sums over all coordinates, which take O(n²).
    """
    g, f = (size.astype(float) for size in defect_sizes(binding, parameters, q, p))
    for changes in (_least_changes, _changes):
        found = Defects(g, f, *_bounds(binding, keeps_f, parameters, q, p, dt, f, changes))
        if ((g <= found.g_bound) & (f <= found.f_bound)).all():
            break
    return found


def refuse_inconsistent(binding: Binding, manifest: dict[str, Any], run: RunArguments) -> None:
    """Refuse a start that is off the constraints by more than round-off."""
    if not binding.conditions:
        return
    parameters = binding.parameters(run.parameters, run.t0)
    found = defects_of_starts(binding, manifest["scheme"]["keeps_momentum_constraint"], parameters,
                              run.q[None], run.p[None], np.array([run.dt]))
    if found.consistent[0]:
        return
    g, f, g_bound, f_bound = (float(x[0]) for x in (found.g, found.f, found.g_bound,
                                                    found.f_bound))
    q_size = float(np.linalg.norm(run.q.astype(float)))
    rigid = manifest["system"]["rigid_body"]
    norm = f", |q| = {q_size:.15g}" if rigid else ""
    what = "q^T p" if rigid else "the momentum constraint"
    if binding.rows:
        what = "the constraints on momenta and velocities"
    raise InputError(
        f"The start is off the constraints: |g(q)| = {g:.3e}{norm}, {what} = {f:.3e} "
        f"(allowed {g_bound:.1e} and {f_bound:.1e}). "
        f"`q, p = stepper.project(q, p, parameters=...{', t=t0' * binding.is_timed})` "
        "moves it onto them."
    )


def refuse_singular_mass(binding: Binding, manifest: dict[str, Any], run: RunArguments) -> None:
    """Refuse a start where the M of a Lagrangian has no inverse, or not the sign it was seen with.

    Its columns are what momenta gain by one velocity each.
    """
    system = manifest["system"]
    if "velocity_names" not in system:
        return
    n = binding.n
    moving = np.concatenate([np.zeros((1, n)), np.eye(n)]).astype(binding.dtype)
    at_rest, *columns = binding.momenta(
        binding.parameters(run.parameters, run.t0), np.repeat(run.q[None], n + 1, axis=0), moving)
    M = (np.array(columns) - at_rest).astype(float)
    sizes = np.sqrt(np.abs(M).max(axis=1, initial=0))
    if not np.isfinite(M).all():
        return  # the first step fails, and says why
    still = next((name for name, size in zip(system["velocity_names"], sizes, strict=True)
                  if not size), "")
    values = np.linalg.eigvalsh(M / np.outer(sizes, sizes)) if not still else np.zeros(1)
    small = 8 * n * np.finfo(float).eps * np.abs(values).max()
    if np.abs(values).min() <= small:
        where = f": motion with {still} costs no kinetic energy there" if still else ""
        raise InputError("The mass matrix has no inverse at the start, so that momenta do not tell "
                         f"velocities{where}; start elsewhere, or take other coordinates.")
    if values[0] < 0 and not system.get("indefinite", False):
        raise InputError("The mass matrix is not positive definite at the start, and it was at "
                         "every place where it was looked at, so that it is factorised without "
                         "pivots; write the numbers of its parameters into L.")


def _bounds(
    binding: Binding, keeps_f: bool, parameters: Any, q: Array, p: Array, dt: Array, f: Array,
    changes: Callable[..., tuple[Array, Array]],
) -> tuple[Array, Array]:
    """Return the bounds of |g| and |f| in each row, by ``_changes`` or a bound below them."""
    sizes = [np.sqrt((x.astype(float) ** 2).sum(axis=1)) for x in (q, p)]
    nudge = 2.0**-10 * binding.epsilon**0.25
    epsilons = 64 * binding.epsilon / nudge
    g_bound, f_bound = (epsilons * size for size in changes(
        binding, parameters, q, p, nudge * sizes[0], nudge * sizes[1]))
    for i in np.flatnonzero(f > f_bound) if not keeps_f else ():
        row = slice(i, i + 1)
        own = parameters + i if binding.sets(parameters) > 1 else parameters
        x = binding.guess(own, dt[i], q[i].copy(), p[i].copy(), binding.work())
        n = binding.n
        # An Euler step is no small move: half of it leaves room for terms of third order.
        part = 1.0 if changes is _changes else 0.5
        euler = [part * np.array([float(np.abs(d).max())]) for d in (x[:n], x[n : 2 * n])]
        f_bound[row] += changes(binding, own, q[row], p[row], *euler)[1]
    return g_bound, f_bound


def _changes(
    binding: Binding, parameters: Any, q: Array, p: Array, dq: Array, dp: Array
) -> tuple[Array, Array]:
    """Return how much g and f change when each q moves by dq and each p by dp, added up."""
    unit = np.eye(binding.n)
    still = np.zeros((binding.n + 1, binding.n))
    return _sizes(np.abs(d[:, 1:] - d[:, :1]).sum(axis=1, keepdims=True) for d in _moved(
        binding, parameters, q, p, dq, dp, np.vstack([still[:1], unit, still[1:]]),
        np.vstack([still, unit])))


def _least_changes(
    binding: Binding, parameters: Any, q: Array, p: Array, dq: Array, dp: Array
) -> tuple[Array, Array]:
    """Return a bound below ``_changes``, up to terms of second order, by few states.

    |Σ wₖ aₖ| ≤ Σ |aₖ| if no |wₖ| exceeds 1: all q and p are moved at once, by fixed random
    fractions, forth and back. The difference has no term of second order, where moves of several
    coordinates would add to each other.
    """
    forth, back = (np.vstack([w, -w]) for w in _fractions(binding.n))
    return _sizes(np.abs(d[:, :_DRAWS] - d[:, _DRAWS:]) / 2 for d in _moved(
        binding, parameters, q, p, dq, dp, forth, back))


@lru_cache(maxsize=8)
def _fractions(n: int) -> Array:
    """Return the fractions of dq and of dp, shape (2, draws, n); none is near 0."""
    rng = np.random.default_rng(0)
    return rng.choice([-1.0, 1.0], (2, _DRAWS, n)) * rng.uniform(0.5, 0.99, (2, _DRAWS, n))


def _moved(
    binding: Binding, parameters: Any, q: Array, p: Array, dq: Array, dp: Array,
    q_moves: Array, p_moves: Array,
) -> tuple[Array, Array]:
    """Return g and f, shape (rows, moves, entries), of q + dq q_moves and p + dp p_moves."""
    moved = [x[:, None] + step[:, None, None] * moves
             for x, step, moves in ((q, dq, q_moves), (p, dp, p_moves))]
    states = [np.ascontiguousarray(x.reshape(-1, binding.n), dtype=binding.dtype) for x in moved]
    g, f = binding.defects(parameters, *states)
    shape = len(q), len(q_moves)
    return g.reshape(*shape, binding.m), f.reshape(*shape, binding.conditions)


def _sizes(changes: Iterable[Array]) -> tuple[Array, Array]:
    """Return the largest of the changes of g and of f in each row."""
    g, f = (d.max(axis=(1, 2), initial=0).astype(float) for d in changes)
    return g, f
