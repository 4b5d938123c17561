"""The compiled functions of one stepper as Python callables on NumPy arrays.

Functions of a step and of states; those of runs are in ``compiled_module``.

``CompiledConstraints`` has the constraints of a compiled stepper, with difference quotients for
their derivatives. Compiled code projects on its own; they are for its failures: damped steps, and
names in messages.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np

from ...core.arrays import Array
from ...core.manifest import Manifest
from .compiled_module import SOLVERS, Compiled, SolverName
from .run_memory import OptionStruct, ParameterStruct, WorkMemory

__all__ = ["REASONS", "SOLVERS", "Binding", "CompiledConstraints", "SolverName"]

#: Why a call failed, by its status.
REASONS = {1: "not converged", 2: "singular matrix", 3: "not finite", 4: "stagnated",
           5: "diverged", 7: "time stopped"}


class Binding(Compiled):
    """Calls into a compiled module; one instance may serve many threads."""

    def guess(
        self, parameters: ParameterStruct, dt: float, q: Array, p: Array, work: WorkMemory
    ) -> Array:
        """Return the starting guess of the unknowns x of a step from (q, p)."""
        x = self.new(self.unknowns)
        self.function("guess")(parameters, dt, self.pointer(q), self.pointer(p), self.pointer(x),
                               work)
        return x

    def residual(
        self, parameters: ParameterStruct, dt: float, q: Array, p: Array, x: Array, work: WorkMemory
    ) -> Array:
        """Return the residual r(x) of the equations T1 of a step from (q, p), shape (unknowns,)."""
        r = self.new(self.unknowns)
        self.function("residual")(parameters, dt, self.pointer(q), self.pointer(p),
                                  self.pointer(x), self.pointer(r), work)
        return r

    def jacobian(
        self, parameters: ParameterStruct, dt: float, q: Array, p: Array, x: Array, work: WorkMemory
    ) -> Array:
        """Return the Jacobian dr/dx of the equations T1, shape (unknowns, unknowns)."""
        J = self.new(self.unknowns, self.unknowns)
        self.function("jacobian")(parameters, dt, self.pointer(q), self.pointer(p),
                                  self.pointer(x), self.pointer(J), work)
        return J

    def step(
        self, parameters: ParameterStruct, options: OptionStruct, dt: float, q: Array, p: Array,
        work: WorkMemory,
    ) -> tuple[int, Array, Array]:
        """Try one step from (q, p), which stay; return its status and the state after it."""
        # q, p and the multipliers after the step, which C writes; an empty array would be NULL
        outputs = self.new(self.n), self.new(self.n), self.new(max(self.multipliers, 1))
        iterations = self.ffi.new("int *")
        status = self.function("step")(parameters, options, dt, self.pointer(q), self.pointer(p),
                                       *map(self.pointer, outputs), iterations, work)
        return int(status), *outputs[:2]

    def first_half(
        self, parameters: ParameterStruct, options: OptionStruct, dt: float, q: Array, p: Array,
        work: WorkMemory,
    ) -> tuple[int, float]:
        """Solve r(x) = 0 of a step, its first half T1, by Newton's method.

        The Jacobian is computed in every iteration; the solution x is not returned, for a diagnosis
        asks how the iteration ends. q and p have the shape (n,). Returns the status, 0 for success,
        and the size of the last increment relative to the state.
        """
        x, iterations = self.new(self.unknowns), self.ffi.new("int *")
        status = self.function("T1")(parameters, options, dt, self.pointer(q), self.pointer(p),
                                     self.pointer(x), iterations, work)
        return int(status), self.last_increment(work)

    def last_increment(self, work: WorkMemory) -> float:
        """Return the size of Newton's last increment, relative to the state."""
        return float(self.function("last_increment")(work))

    def finish(
        self, parameters: ParameterStruct, dt: float, q: Array, p: Array, x: Array, work: WorkMemory
    ) -> tuple[int, Array, Array, Array]:
        """Evaluate the second half T2 of a step, the state after it, from the solution x of T1.

        q and p, shapes (n,), are the state before the step, x has the shape (unknowns,). Returns
        the status, 0 for success, q1 and p1, shapes (n,), and the multipliers of the step.
        """
        q1, p1 = self.new(self.n), self.new(self.n)
        multipliers = self.new(max(self.multipliers, 1))  # an empty array would be NULL
        status = self.function("T2")(
            parameters, dt, self.pointer(q), self.pointer(p), self.pointer(x), self.pointer(q1),
            self.pointer(p1), self.pointer(multipliers), work)
        return int(status), q1, p1, multipliers[: self.multipliers]

    def quantities(self, parameters: ParameterStruct, t: Array, q: Array, p: Array) -> Array:
        """Return the user's quantities of each row of q and p, a column each."""
        values = self.new(len(q), len(self.quantity_names))
        if self.quantity_names:
            times = [self.pointer(t)] if self.quantities_take_time else []
            self.function("quantities")(parameters, len(q), *times, self.pointer(q),
                                        self.pointer(p), self.pointer(values))
        return values

    def near(
        self, parameters: ParameterStruct, t: Array, q: Array, p: Array, columns: Array,
        levels: Array, last_values: Array,
    ) -> tuple[int, int] | None:
        """Return the first and the last row that follows a state near a level, or None.

        ``columns`` are the observed columns of (q, p, quantities), ``levels`` their levels.
        ``last_values`` has their values at the two states before, NaN at first; the values of the
        last rows replace them.
        """
        times = [self.pointer(t)] if self.quantities_take_time else []
        rows = self.ffi.new("long[2]")
        is_near = self.function("near")(
            parameters, len(q), *times, self.pointer(q), self.pointer(p), len(columns),
            self.ffi.from_buffer("int[]", columns), self.pointer(levels), self.pointer(last_values),
            rows)
        return (rows[0], rows[1]) if is_near else None

    def hamiltonian(
        self, parameters: ParameterStruct, q: Array, p: Array, t: Array | None = None
    ) -> Array:
        """Return H of each row of q and p, at the times t; by default that of the parameters."""
        H = self.new(len(q))
        self.function("hamiltonian")(parameters, len(q), *self._times(t), self.pointer(q),
                                     self.pointer(p), self.pointer(H))
        return H

    def has_finite_energy(self, parameters: ParameterStruct, q: Array, p: Array) -> bool:
        """Return whether H of a state is a finite number, at the time of ``parameters``."""
        H = self.new(1)
        self.function("hamiltonian")(parameters, 1, *self._times(t=None), self.pointer(q),
                                     self.pointer(p), self.pointer(H))
        return bool(abs(H[0]) < math.inf)  # in its type: a wide number may be beyond any double

    def in_scaled_time(
        self, parameters: ParameterStruct, q: Array, p: Array, t: Array
    ) -> tuple[Array, Array]:
        """Return states completed, in scaled time, by t in q and e = −H(q, p, t) in p.

        q and p have shape (N, n), t (N,). If time is not scaled they are returned unchanged.
        """
        if not self.clocked:
            return q, p
        # H needs t in its place before e = −H can be computed
        full_q, full_p = (np.concatenate([x, self.new(len(q), 1)], axis=1) for x in (q, p))
        full_q[:, -1] = self.to_real(t)
        full_p[:, -1] = -self.hamiltonian(parameters, full_q, full_p)
        return full_q, full_p

    def time_of(self, q: Array) -> Any:
        """Return the time of a state in scaled time: its last coordinate, as a ``number``."""
        return q[-1] if self.dtype in (object, np.longdouble) else float(q[-1])

    def time_scales(self, parameters: ParameterStruct, q: Array, p: Array) -> Array:
        """Return σ = dt/dτ of rows of states in scaled time."""
        no_times = self.new(len(q))  # the time is the last coordinate
        scales: Array = self.quantities(parameters, no_times, q, p)[:, self.scale_place]
        return scales

    def start_in_scaled_time(
        self, parameters: ParameterStruct, q: Array, p: Array, t: Any
    ) -> tuple[Array, Array]:
        """Return one state with t and e = −H(q, p, t), as ``in_scaled_time`` does for rows."""
        if not self.clocked:
            return q, p
        full_q, full_p = self.new(2, self.n)
        full_q[:-1], full_p[:-1], full_q[-1] = q, p, t
        full_p[-1:] = -self.hamiltonian(parameters, full_q[None], full_p[None])
        return full_q, full_p

    def velocities(
        self, parameters: ParameterStruct, q: Array, p: Array, t: Array | None = None
    ) -> Array:
        """Return the velocities of each row of q and p, of a system from its Lagrangian."""
        return self._other_rates("velocities", parameters, q, p, t)

    def momenta(
        self, parameters: ParameterStruct, q: Array, v: Array, t: Array | None = None
    ) -> Array:
        """Return the momenta of each row of q and velocities, of a system from its Lagrangian."""
        return self._other_rates("momenta", parameters, q, v, t)

    def _other_rates(
        self, name: str, parameters: ParameterStruct, q: Array, rates: Array, t: Array | None
    ) -> Array:
        """Return velocities of momenta, or momenta of velocities, by the C function ``name``.

        ``rates`` are the momenta or the velocities, shape (states, n) as q.
        """
        result = self.new(len(q), self.n)
        self.function(name)(parameters, len(q), *self._times(t),
                            *map(self.pointer, (q, rates, result)))
        return result

    def _times(self, t: Array | None) -> list[Any]:
        """Return the argument with the times of states, NULL for the time in the parameters.

        No argument where neither H nor g has time.
        """
        if not self.is_timed:
            return []
        return [self.ffi.NULL if t is None else self.pointer(t)]

    def defects(
        self, parameters: ParameterStruct, q: Array, p: Array, t: Array | None = None
    ) -> tuple[Array, Array]:
        """Return g(q), shape (rows, m), and the conditions on momenta, shape (rows, conditions).

        These are f(q, p), and A H_p + a of velocity constraints A q̇ + a = 0. The times are t, or
        those of the parameters. An array of parameter structs has one for each group of rows, and
        all groups are equally long.
        """
        g, f = self.new(len(q), self.m), self.new(len(q), self.conditions)
        if not self.conditions:
            return g, f
        function, sets = self.function("defects"), self.sets(parameters)
        arrays, rows = [*map(self.pointer, (q, p, g, f))], len(q) // sets
        if sets == 1:
            function(parameters, rows, *self._times(t), *arrays)
            return g, f
        # each struct has a group of rows of its own
        widths = [rows * width for width in (self.n, self.n, self.m, self.conditions)]
        for i in range(sets):
            pointers = [array + i * width for array, width in zip(arrays, widths, strict=True)]
            function(self.set_of(parameters, i), rows, *self._times(t=None), *pointers)
        return g, f

    def is_consistent(self, parameters: ParameterStruct, q: Array, p: Array) -> bool:
        """Return whether a few moves show that g and f of a state are at round-off level.

        These moves may find too little change: ``defects_of_starts`` decides about others.
        """
        return not self.conditions or bool(self.function("is_consistent")(
            parameters, self.pointer(q), self.pointer(p)))

    def sets(self, parameters: ParameterStruct) -> int:
        """Return the number of parameter structs in an array of them, or 1 for one struct."""
        is_array = self.ffi.typeof(parameters).kind == "array"
        return len(cast(Any, parameters)) if is_array else 1

    def set_of(self, parameters: ParameterStruct, i: int) -> ParameterStruct:
        """Return the parameters of run i of an array of parameter structs."""
        return ParameterStruct(cast(Any, parameters) + i)

    def project(self, parameters: ParameterStruct, q: Array, p: Array) -> int:
        """Move (q, p) onto the constraints in place; return the status."""
        if not self.conditions:
            return 0
        return int(self.function("project")(parameters, self.pointer(q), self.pointer(p)))


class CompiledConstraints:
    """g, f and their derivatives at given parameters, in double; in scaled time at the time t."""

    def __init__(
        self, binding: Binding, manifest: Manifest, parameters: ParameterStruct, t: Any = 0.0
    ) -> None:
        """Take the constraints of a stepper with numbers for its parameters, at the time t."""
        self._binding, self._parameters, self._t = binding, parameters, t
        system = manifest.system
        self.coordinates, self.momenta = system.coordinates, system.momenta
        self.constraint_names = system.constraint_names
        self.velocity_constraint_names = system.velocity_constraint_names

    def g(self, q: Array) -> Array:
        """Return g(q), shape (m,)."""
        no_momenta = np.zeros((1, len(q)))  # g does not depend on them
        g, _ = self._defects(q[None], no_momenta)
        of_state: Array = g[0]
        return of_state

    def f(self, q: Array, p: Array) -> Array:
        """Return the conditions on the momenta: f(q, p), then A H_p + a; shape (conditions,)."""
        _, f = self._defects(q[None], p[None])
        of_state: Array = f[0]
        return of_state

    def G(self, q: Array) -> Array:
        """Return g_q, shape (m, n), by central differences: nine digits, enough for Newton.

        Column j is (g(q + h e_j) − g(q − h e_j))/(2 h), all in one call.
        """
        h = _step(q) * np.eye(len(q))
        no_momenta = np.zeros((2 * len(q), len(q)))
        g, _ = self._defects(np.vstack([q + h, q - h]), no_momenta)
        slopes: Array = (g[: len(q)] - g[len(q) :]).T / (2 * h[0, 0])
        return slopes

    # without rows of velocity constraints: with these compiled code alone projects
    rows = G

    def W(self, q: Array, p: Array, G: Array) -> Array:
        """Return W = f_p Gᵀ, shape (m, m): column j is (f(p + h G_jᵀ) − f(p − h G_jᵀ))/(2 h)."""
        # p moves by the same length as for the derivatives by its entries
        h = _step(p) / max(float(np.linalg.norm(G, axis=1).max(initial=0.0)), 1e-300)
        _, f = self._defects(np.tile(q, (2 * len(G), 1)), np.vstack([p + h * G, p - h * G]))
        matrix: Array = (f[: len(G)] - f[len(G) :]).T / (2 * h)
        return matrix

    def _defects(self, q: Array, p: Array) -> tuple[Array, Array]:
        """Return g and f of each state in doubles, shapes (rows, m) and (rows, conditions).

        In scaled time, t and −H complete the states.
        """
        states = [np.ascontiguousarray(x, dtype=self._binding.dtype) for x in (q, p)]
        g, f = self._binding.defects(self._parameters, *self._binding.in_scaled_time(
            self._parameters, states[0], states[1], np.full(len(q), self._t)))
        return g.astype(float), f.astype(float)


def _step(x: Array) -> float:
    """Return the step of a central difference: |x| 2⁻¹⁷, about |x| ε^⅓.

    With this step truncation and round-off are about equal.
    """
    size = float(np.linalg.norm(x))
    return 2.0**-17 * (size or 1.0)
