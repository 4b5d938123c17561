"""Bounds of round-off in a run: of states, of H, of constraints, of multipliers.

Bounds are taken over all states of the run: at a few instants the motion may be at rest. They are
in units of ε, the distance from 1 to the next number of the stepper's type.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from ..core.arrays import Floats
from ..generator.symbolic.numeric_evaluation import evaluate
from ..generator.symbolic.rounding_errors import rounding
from ..generator.symbolic.shared_subexpressions import parts_of
from ..generator.systems.system import System
from ..generator.systems.time_scale import ScaledSystem
from ..runtime.results.outputs import full_states
from ..runtime.results.trajectory import Trajectory
from ..runtime.steppers.stepper import Stepper
from .measurements import constraint_scales

__all__ = ["RoundOff"]

#: Most numbers in memory at a time, of all subexpressions.
_MOST_NUMBERS = 2**22


@dataclass(frozen=True)
class RoundOff:
    """Round-off of a run in which every step is stored.

    The round-off of a momentum is ε max |p| + Δt δ(H_q − F), with δ the error bound of evaluation:
    a momentum that stays 0 between balanced forces has the round-off of these forces. The
    round-off of a coordinate is ε max |q| + Δt δ(H_p).
    """

    system: System
    run: Trajectory
    parameters: Mapping[str, float]
    step: Stepper

    @property
    def epsilon(self) -> float:
        """ε of the stepper's type."""
        return self.step.binding.epsilon

    @property
    def walk(self) -> float:
        """Bound of accumulated round-off: a random walk of 4 ε a step, and at least 32 ε."""
        return self.epsilon * max(32.0, 4 * math.sqrt(self.run.report.steps))

    @cached_property
    def states_of_run(self) -> tuple[Floats, Floats]:
        """q and p of each state; in scaled time with t and its momentum."""
        return full_states(self.run)

    @cached_property
    def q_sizes(self) -> Floats:
        """Round-off of each coordinate in units of ε."""
        return _largest_of(self.states_of_run[0]) + self._q_step

    @cached_property
    def p_sizes(self) -> Floats:
        """Round-off of each momentum in units of ε."""
        return _largest_of(self.states_of_run[1]) + self._p_step

    @cached_property
    def _q_step(self) -> Floats:
        """Δt δ(H_p), the round-off of one step in each coordinate; δ includes the error of p."""
        errors = self._errors(self.system.p, self.p_sizes)
        return abs(float(self.run.dt)) * self._largest(self.system.H_p, errors)

    @cached_property
    def _p_step(self) -> Floats:
        """Δt δ(H_q − F), the round-off of one step in each momentum."""
        return abs(float(self.run.dt)) * self._largest(self.system.minus_p_rate, {})

    def sizes_of_steps(self, dt: float) -> tuple[float, float]:
        """Return the largest round-off of q and of p, in units of ε, in steps of another length."""
        longer = abs(dt / float(self.run.dt))
        # δ(H_p) itself grows with the round-off of p, so with the length of the step
        q = _largest_of(self.states_of_run[0]) + longer * max(1.0, longer) * self._q_step
        p = _largest_of(self.states_of_run[1]) + longer * self._p_step
        return float(q.max()) or 1.0, float(p.max()) or 1.0

    def _errors(self, symbols: Sequence[sp.Symbol], sizes: Floats) -> dict[sp.Symbol, float]:
        """Return symbol → its round-off in units of ε, as ``rounding`` takes errors of symbols."""
        return dict(zip(symbols, sizes.tolist(), strict=True))

    @cached_property
    def energy(self) -> float:
        """Round-off of H, in scaled time of H + e: of the states and of the arithmetic, in ε."""
        system = self.system
        H = system.conserved_function if isinstance(system, ScaledSystem) else system.H
        errors = self._errors(system.q, self.q_sizes) | self._errors(system.p, self.p_sizes)
        return float(self._largest([H], errors)[0])

    @cached_property
    def constraints(self) -> tuple[Floats, Floats]:
        """Round-off of each constraint, and of each on the momenta, in units of ε."""
        return constraint_scales(self.step, self.run, self.parameters,
                                 (self.q_sizes, self.p_sizes))

    @cached_property
    def impulse(self) -> Floats:
        """Δt times the round-off of each p that round-off of g causes, (n,), in units of ε.

        A round-off δg moves multipliers that follow from g = 0 alone, and they move p by
        Δp = g_qᵀ (g_q H_pp g_qᵀ)⁻¹ δg/Δt, for a quaternion 4γ δg/Δt.
        """
        system, n = self.system, self.system.n
        largest = np.zeros(n)
        entries = [*(e for row in system.G for e in row), *(e for row in system.H_pp for e in row)]
        for symbol_values, count in self.states(entries):
            # shape (states, m + n, n): g_q above H_pp
            derivatives = evaluate(entries, symbol_values).reshape(-1, n, count).transpose(2, 0, 1)
            G, masses = derivatives[:, : system.m], derivatives[:, system.m :]
            with np.errstate(all="ignore"):
                usable = np.isfinite(derivatives).all(axis=(1, 2))
                inverse = np.linalg.pinv((G @ masses @ G.transpose(0, 2, 1))[usable])
                kicks = np.abs(G.transpose(0, 2, 1)[usable] @ inverse) @ self.constraints[0]
            largest = np.maximum(largest, kicks.max(axis=0, initial=0.0))
        return largest

    # ------------------------------------------------------------ over the run

    def _largest(self, expressions: Sequence[sp.Expr], errors: Mapping[sp.Symbol, Any]) -> Floats:
        """Return δ of each expression, the largest of its error bounds over the run, in ε.

        ``errors`` has the error of each inexact symbol; others are exact. Bounds that are not
        finite are left out.
        """
        largest = np.zeros(len(expressions))
        for symbol_values, _ in self.states(expressions):
            bounds = rounding(expressions, symbol_values, errors)
            finite = np.where(np.isfinite(bounds), bounds, 0.0)
            largest = np.maximum(largest, finite.max(axis=1, initial=0.0))
        return largest

    def states(self, expressions: Sequence[sp.Expr]) -> Iterator[tuple[dict[Any, Any], int]]:
        """Yield the values of all symbols at blocks of states, and the number of states of each.

        Blocks are so long that all subexpressions of ``expressions`` fit in memory.
        """
        parts = sum(1 for _ in parts_of(expressions)) + 1
        size = max(16, _MOST_NUMBERS // parts)
        for start in range(0, len(self.run.t), size):
            block = slice(start, start + size)
            yield self.values(block), len(self.run.t[block])

    def values(self, states: slice | NDArray[np.int64]) -> dict[Any, Any]:
        """Return the values of all symbols at states of the run, in double."""
        system, run = self.system, self.run
        symbol_values: dict[Any, Any] = {s: self.parameters[str(s)] for s in system.parameters}
        for symbols, rows in zip((system.q, system.p), self.states_of_run, strict=True):
            symbol_values |= dict(zip(symbols, rows[states].astype(float).T, strict=True))
        if system.time is not None:
            symbol_values[system.time] = run.t[states]
        return symbol_values


def _largest_of(states: Any) -> Floats:
    """Return the largest |x_i| over the states, from shape (states, n) to (n,)."""
    return np.asarray(np.abs(states.astype(float)).max(axis=0))
