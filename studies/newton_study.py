"""T1 by Newton as the paper's tables annotate it, over the compiled residual and Jacobian.

    solve J(x) dx = r(x),  x ← x − dx,  until ‖·‖ < ε_r or iter_max

A ``Rule`` says as data where the iteration starts, which norm stops it and when. The product's
steppers stop at round-off by themselves; this driver exists to count what the paper counted.

Two things are done as the paper's formulas are written, because its numbers show them:

- the constraint is evaluated as g = Q̃ᵀQ̃ − 1 (``plain``). Its rounding, about 1e-16, comes back
  in λ and Λ multiplied by 1/Δt² and makes a small Δt stagnate. The product's own residual adds
  increments, g(q) + Δg, and stagnates less;
- a step that uses up iter_max is counted with iter_max and the run goes on (section 5.4), as long
  as its last error is small. A march is *divergent* when that error is above 1e-6, when the matrix
  is singular or a number is not finite, or when no step at all was solved: what would follow is
  no motion of the top.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median
from typing import Literal, NamedTuple

import numpy as np

from ..core.arrays import Array
from ..runtime.steppers.stepper import Stepper

__all__ = ["March", "Rule", "march"]

#: Above it, the last error of a step that used up iter_max is no round-off.
STRAYED = 1e-6


@dataclass(frozen=True)
class Rule:
    """How a step is solved.

    Attributes
    ----------
    start
        "state": (q_{k−1}, p_{k−1}, 0), for IMS and EMS. "previous": the unknowns of the step
        before (increments for IMS and EMS), for the first step the stepper's guess. "rates":
        the stepper's guess every time.
    stops_on
        "dx": the whole increment. "d(q,p)": its part without the multipliers. "r": the residual,
        tested before each linear solution; the last test counts as an iteration.
    size
        "euclidean" or "largest" entry.
    tolerance, most
        ε_r and iter_max.
    plain
        Whether g is evaluated as Q̃ᵀQ̃ − 1; otherwise by increments, as the product does.
    """

    start: Literal["state", "previous", "rates"]
    stops_on: Literal["dx", "d(q,p)", "r"]
    tolerance: float
    most: int
    size: Literal["euclidean", "largest"] = "euclidean"
    plain: bool = True

    def __str__(self) -> str:
        return f"‖{self.stops_on}‖{'' if self.size == 'euclidean' else '∞'} < {self.tolerance:.0e}"


@dataclass
class March:
    """The outcome of a run: the iterations of each finished step, and the reason of its end."""

    iterations: list[int] = field(default_factory=list)
    unsolved: int = 0  # steps that used up iter_max
    failure: str = ""  # why the march is divergent; empty if it is not
    end: tuple[Array, Array] | None = None  # (q, p) after the last step, if it did not fail

    @property
    def divergent(self) -> bool:
        """Whether the run stopped being a solution."""
        return bool(self.failure)

    @property
    def mean(self) -> float:
        """Mean number of iterations of a step."""
        return sum(self.iterations) / len(self.iterations)

    @property
    def typical(self) -> float:
        """Median number of iterations: stagnation of a few steps does not move it."""
        return float(median(self.iterations))


def march(
    stepper: Stepper, parameters: Mapping[str, float], state: tuple[Array, Array], dt: float,
    steps: int, rule: Rule, *, all_solved: bool = False,
) -> March:
    """Integrate ``steps`` steps from ``state`` = (q, p), and return the iterations of each.

    The march ends early where it diverges; with ``all_solved`` at the first step that uses up
    iter_max, whatever its last error.
    """
    run = _Run(stepper, parameters, dt, rule)
    run.q[:], run.p[:] = state
    march = March()
    for _ in range(steps):
        # an overflow is no warning: run.solve reports "not finite"
        with np.errstate(over="ignore", invalid="ignore"):
            iteration_count, error, march.failure = run.solve()
        march.iterations.append(iteration_count)
        if not march.failure and not error < rule.tolerance:
            march.unsolved += 1
            if all_solved or not error < STRAYED:
                march.failure = "not converged"
        if not march.failure and run.advance():
            march.failure = "no momentum on the constraint"
        if march.failure:
            return march
    # a tolerance that no step meets is no convergence, even if the run goes on
    if march.unsolved == steps:
        march.failure = "no step converged"
    march.end = run.q, run.p
    return march


class _NewtonEnd(NamedTuple):
    """How the iteration of a step ended."""

    iterations: int
    error: float  # last size of the tested quantity: dx, d(q, p) or r
    failure: str = ""


class _Run:
    """Buffers and pointers of one march: each iteration is two compiled calls and one solution."""

    def __init__(
        self, stepper: Stepper, parameters: Mapping[str, float], dt: float, rule: Rule
    ) -> None:
        """Allocate the arrays that the compiled residual and Jacobian read and write."""
        self.b = b = stepper.binding
        self.dt, self.rule = dt, rule
        self.parameters, self.work = b.parameters(dict(parameters)), b.work()
        self.is_state = bool(stepper.manifest.scheme.unknowns_are_state)
        self.q, self.p = b.new(b.n), b.new(b.n)
        self.x, self.J = b.new(b.unknowns), b.new(b.unknowns, b.unknowns)
        self.r = b.new(b.unknowns)
        # a system without constraints has no such row
        self.constraints = b.unknowns if not b.m else self._first_constraint()
        # Ā of the constraint nodes Q̃_i, from the stepper; IMS and EMS have none
        self.A_bar = None if self.is_state else np.frombuffer(
            b.ffi.buffer(b.function("coefficients")().A_bar), dtype=b.dtype).reshape(
                -1, stepper.manifest.scheme.stages or 1)
        self.before: Array | None = None  # unknowns of the step before
        self.pointers = [b.pointer(a) for a in (self.q, self.p, self.x, self.r, self.J)]

    def _first_constraint(self) -> int:
        """Return the row of the first constraint: p of them in T1 of SPARK, 1 in IMS and EMS."""
        b = self.b
        return b.unknowns - (b.multipliers if self.is_state else b.multipliers - b.m)

    def solve(self) -> _NewtonEnd:
        """Solve r(x) = 0 of one step by Newton's method: J(x) dx = r(x), x ← x − dx.

        The solution stays in ``self.x``.
        """
        rule = self.rule
        origin = self._origin()
        y = self._start(origin)
        error = math.inf
        for iteration in range(1, rule.most + 1):
            self._linearise(y, origin)
            # a residual is tested before the step, a change after it
            if rule.stops_on == "r":
                error = self._size(self.r)
                if error < rule.tolerance:
                    return _NewtonEnd(iteration, error)
            try:
                dx = np.linalg.solve(self.J, self.r)
            except np.linalg.LinAlgError:
                return _NewtonEnd(iteration, error, "singular matrix")
            y -= dx
            if rule.stops_on != "r":
                # the unknowns before the first constraint's row are q and p
                error = self._size(dx if rule.stops_on == "dx" else dx[: self.constraints])
            if not math.isfinite(float(dx @ dx)):
                return _NewtonEnd(iteration, error, "not finite")
            if rule.stops_on != "r" and error < rule.tolerance:
                break
        np.subtract(y, origin, out=self.x)
        return _NewtonEnd(iteration, error)

    def _linearise(self, y: Array, origin: Array) -> None:
        """Evaluate residual r and Jacobian J at the iterate y, with g as the rule asks.

        Shapes: y and ``origin`` (unknowns,), r (unknowns,), J (unknowns, unknowns). The compiled
        code takes x = y − origin, the increment from the state for IMS and EMS; the paper iterates,
        and measures, the state itself.
        """
        q, p, x, r, J = self.pointers
        np.subtract(y, origin, out=self.x)
        self.b.function("residual")(self.parameters, self.dt, q, p, x, r, self.work)
        self.b.function("jacobian")(self.parameters, self.dt, q, p, x, J, self.work)
        if self.rule.plain:
            self._plain_constraint(y)

    def advance(self) -> int:
        """Set q and p to the end of the step; return the status of its projection, 0 for success.

        The projection, T2 of the paper, puts p on qᵀp = 0 by the last multiplier.
        """
        status, self.q[:], self.p[:], _ = self.b.finish(
            self.parameters, self.dt, self.q, self.p, self.x, self.work)
        self.before = self.x.copy()
        return status

    def _origin(self) -> Array:
        """Return the origin of x: the state for IMS and EMS, which solve for increments, else 0."""
        origin = self.b.new(self.b.unknowns)
        if self.is_state:
            origin[: 2 * self.b.n] = np.concatenate([self.q, self.p])
        return origin

    def _start(self, origin: Array) -> Array:
        """Return the first iterate y, by the rule: state, previous unknowns or stepper's guess."""
        if self.rule.start == "state":
            return origin.copy()
        if self.rule.start == "previous" and self.before is not None:
            return origin + self.before
        return origin + self.b.guess(self.parameters, self.dt, self.q, self.p, self.work)

    def _plain_constraint(self, y: Array) -> None:
        """Put g_i = Q̃_iᵀQ̃_i − 1 into the constraint rows of r.

        The constraint nodes are Q̃ = q + Δt Ā k with the rates k = y[: s n], shape (s, n), of SPARK
        methods, without the node c̃ = 0, at which g holds; for IMS and EMS Q̃ is the new q itself.
        """
        n = self.b.n
        if self.A_bar is None:
            Q = y[None, :n]
        else:
            k = y[: self.A_bar.shape[1] * n].reshape(-1, n)
            Q = self.q + self.dt * self.A_bar[1:] @ k
        self.r[self.constraints :] = np.einsum("ij,ij->i", Q, Q) - 1

    def _size(self, v: Array) -> float:
        """Return the norm of a vector by the rule: Euclidean, or its largest entry."""
        if self.rule.size == "largest":
            return float(np.abs(v).max())
        return math.sqrt(float(v @ v))
