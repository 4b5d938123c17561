"""The second way to a step: Newton's method in Python over the compiled residual and Jacobian.

The rules are the same as in ``engine/gyrospark/newton/newton.h``; the linear solver and the record
of a run are others. ``integrate(step, …, solver="python")`` runs a trajectory in this way: events,
stored states and signals are the same as in compiled runs.
"""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from gyrospark.core.solver import as_solver
from gyrospark.runtime.bindings.compiled_module import Compiled
from gyrospark.runtime.bindings.run_memory import RunConstants
from gyrospark.runtime.integration.call_memory import CallMemory
from gyrospark.runtime.integration.run_arguments import RunArguments
from gyrospark.runtime.results.outputs import defect_sizes

__all__ = ["integrate", "newton_in_python", "one_step"]


def all_finite(array):
    """Whether all entries, mpmath's among them, are finite."""
    return all(entry - entry == 0 for entry in array.flat)


def integrate(step, *start, solver="auto", **options):
    """Return the run of a stepper; ``solver`` may be "python", and a ``gs.Solver`` of that kind."""
    method = as_solver("newton" if solver == "python" else solver)
    if solver != "python":
        return step.integrate(*start, solver=method, **options)
    with newton_in_python():
        return step.integrate(*start, solver=method, **options)


def one_step(step, *start, solver="auto", **options):
    """Return q and p after a step."""
    end = integrate(step, *start, steps=1, solver=solver, **options)
    return end.q[-1], end.p[-1]


@contextmanager
def newton_in_python():
    """Have ``newton_step`` take the steps of runs with solver newton."""
    compiled, constants = Compiled.integrate, RunArguments.constants

    def with_run(run, binding):
        return ConstantsOfRun(**vars(constants(run, binding)), run=run)

    def integrate(binding, constants, steps, every, state, rows, row=0):
        if state.steps == 0:  # the compiled code starts the record; no step is taken
            compiled(binding, constants, 0, 1, state, rows[:0])
        return advance(binding, constants, steps, every, state, rows[row:])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunArguments, "constants", with_run)
        patch.setattr(CallMemory, "recall", lambda *_: None)  # it holds memory of compiled runs
        patch.setattr(Compiled, "integrate", integrate)
        yield


@dataclass(frozen=True)
class ConstantsOfRun(RunConstants):
    """The constants of a run, with the arguments in Python's numbers."""

    run: Any = None


def advance(binding, constants, steps, every, state, rows):
    """Advance as ``Compiled.integrate`` does, with ``newton_step`` for each step."""
    run, q, p, report, iterations_max = constants.run, state.q, state.p, state.record, 0

    def parameters_at(ends):
        step, inputs = int(report.steps), {}
        if run.inputs is not None:
            inputs = dict(zip(run.inputs.names, run.inputs.at(step), strict=True))
        return binding.parameters({**run.parameters, **inputs}, binding.times(
            run.t0, run.dt, np.array([step + ends]))[0])

    for k in range(1, steps + 1):
        parameters = parameters_at(0)
        status, q[:], p[:], multipliers, iterations, work = newton_step(
            binding, parameters, run.tolerance, run.max_iterations, run.dt, q, p, state.work)
        if status:
            return status
        parameters = parameters_at(1)
        iterations_max = max(iterations_max, iterations)
        if binding.has_forces:
            add_work(binding, report, work)
        observe(binding, parameters, q, p, iterations, report)
        if k % every == 0:
            total = recorded(binding, report, "work") if binding.has_forces else 0
            row = rows[k // every - 1]
            row.q[:], row.p[:], row.multipliers[:] = q, p, multipliers
            rows.iterations[k // every - 1], rows.work[k // every - 1] = iterations_max, total
            iterations_max = 0
    return 0


# ---------------------------------------------------------------- the record of a run


def observe(binding, parameters, q, p, iterations, report):
    """Add a state to the running record, as the compiled ``observe`` does."""
    report.steps += 1
    report.iterations += iterations
    report.iterations_max = max(report.iterations_max, iterations)
    error = number(binding, binding.hamiltonian(parameters, q[None], p[None])[0]) - recorded(
        binding, report, "energy_start")
    if binding.has_forces:
        error = error - recorded(binding, report, "work")
    g, f = (float(d[0]) for d in defect_sizes(binding, parameters, q[None], p[None]))
    for name, size in {"energy_error": abs(float(error)), "constraint": g, "hidden": f}.items():
        largest, total = f"{name}_max", f"{name}_sum"
        setattr(report, largest, max(float(getattr(report, largest)), size))
        setattr(report, total, float(getattr(report, total)) + size)


def number(binding, x):
    """Return a number to compute with: long double and float128 as they are, others as double."""
    return x if binding.dtype in (np.longdouble, object) else float(x)


def recorded(binding, report, name):
    """Return a number of a running record; cffi hands a long double over as an object."""
    if binding.dtype is not np.longdouble:
        return number(binding, getattr(report, name))
    return np.frombuffer(binding.ffi.buffer(report), dtype=binding.report_type)[name][0]


def add_work(binding, report, step_work):
    """Add the work of a step to a running record, in a compensated sum."""
    before = recorded(binding, report, "work")
    share = number(binding, step_work) + recorded(binding, report, "work_low")
    total = before + share
    added = total - before
    passed = getattr(binding, "_cffi_value", lambda x: x) if binding.dtype is not object else (
        lambda x: x)
    report.work = passed(total)
    report.work_low = passed((before - (total - added)) + (share - added))


# ---------------------------------------------------------------- a step


def newton_step(binding, parameters, tolerance, max_iterations, dt, q, p, work):
    """Return status, q1, p1, multipliers, the number of iterations and the work of one step."""
    status, x, iterations = solve_stages(binding, parameters, tolerance, max_iterations, dt, q, p,
                                         work)
    if status != 0:
        return status, q, p, binding.new(binding.multipliers), iterations, 0
    status, q1, p1, multipliers = binding.finish(parameters, dt, q, p, x, work)
    work_done = binding.new(1)
    if binding.has_forces:
        binding.function("step_work")(
            parameters, dt, *map(binding.pointer, (q, p, x, work_done)), work)
    return status, q1, p1, multipliers, iterations, work_done[0]


def solve_stages(binding, parameters, tolerance, max_iterations, dt, q, p, work):
    """Return status, the unknowns x and the number of iterations (T1).

    From the rates at the start of the step, and where that fails, from a momentum that stays.
    """
    x = binding.guess(parameters, dt, q, p, work)
    equations = binding, parameters, tolerance
    status, solution, iterations = iterate(*equations, max_iterations, dt, q, p, x, work)
    if status == 0 or iterations == max_iterations:
        return status, solution, iterations
    x[binding.kicks] = 0
    restart_status, solution, restart_iterations = iterate(*equations, max_iterations - iterations,
                                                           dt, q, p, x, work)
    return restart_status and status, solution, iterations + restart_iterations


def iterate(binding, parameters, tolerance, max_iterations, dt, q, p, x, work):
    """Return status, the unknowns from a guess x and the number of iterations."""
    epsilon = binding.epsilon
    size, ratio = 0.0, 0.0
    for iterations in range(1, max_iterations + 1):
        r = binding.residual(parameters, dt, q, p, x, work)
        J = binding.jacobian(parameters, dt, q, p, x, work)
        if not (all_finite(r) and all_finite(J)):
            return 3, x, iterations
        scale = np.abs(J).max(axis=1)
        if not scale.all():
            return 2, x, iterations
        try:
            with np.errstate(all="ignore"):  # dx is checked below
                dx = solve(binding, (J.T / scale).T, r / scale)
        except np.linalg.LinAlgError:
            return 2, x, iterations
        previous, size = size, increment_size(binding, dt, q, p, x, dx, work)
        x = x - dx
        if not np.isfinite(size):
            return 3, x, iterations
        shrinks, ratio = ratio < 0.5, size / previous if iterations > 1 else 0.0
        if size <= (tolerance or 0.0):
            return checked(binding, dt, q, x, work), x, iterations
        if iterations == 1:
            continue
        stops = ratio >= 0.5 and is_rounding(binding, parameters, dt, q, p, dx, size, work)
        quadratic = not tolerance and shrinks and size < 1e-3 and ratio < 0.1
        if stops or (quadratic and size * ratio**2 < epsilon / 64):
            return checked(binding, dt, q, x, work), x, iterations
    return (1 if ratio < 0.5 else 4 if size < 1e-3 else 5), x, max_iterations


def checked(binding, dt, q, x, work):
    """Return the status of unknowns whose step must end on the constraints."""
    return int(binding.function("satisfies_constraints")(
        dt, binding.pointer(q), binding.pointer(x), work))


def increment_size(binding, dt, q, p, x, dx, work):
    """Return how large an increment is, relative to the state; work of the last residual."""
    return float(binding.function("increment_size")(
        dt, *map(binding.pointer, (q, p, x, dx)), work))


def is_rounding(binding, parameters, dt, q, p, dx, size, work):
    """Whether an increment, no smaller than half the one before, is so by rounding.

    A stiff spring k rounds its force by ε k |q|, and Δt times that may be large beside a small
    momentum: states and guesses two units in the last place away tell by how much the residual is
    uncertain. They are those at the start, for an iteration that has gone astray proves nothing.
    """
    if size <= 64 * binding.epsilon:
        return True
    chance = np.random.default_rng(1)
    ulps = 2 * binding.epsilon
    x = binding.guess(parameters, dt, q, p, work)
    r = binding.residual(parameters, dt, q, p, x, work)
    size = increment_size(binding, dt, q, p, x, dx, work)
    unit = abs(float(dt)) if binding.solves_increments else 1.0
    rounding = 0.0
    for _ in range(4):
        q_near, p_near, x_near = (
            np.ascontiguousarray(y + ulps * chance.choice([-1, 1], len(y)) * y, y.dtype)
            for y in (q, p, x))
        change = binding.residual(parameters, dt, q_near, p_near, x_near, work) - r
        rounding = max(rounding, unit * increment_size(binding, dt, q, p, x, change, work))
    return size <= 16 * rounding


def solve(binding, A, b):
    """Return A⁻¹b: by LAPACK in double, of float128 by elimination with partial pivoting."""
    if binding.dtype is not object:
        x = np.linalg.solve(A.astype(float), b.astype(float))
        return np.ascontiguousarray(x, dtype=binding.dtype)
    A, x = A.copy(), b.copy()
    for k in range(len(x)):
        pivot = k + int(np.argmax(np.abs(A[k:, k])))
        if not A[pivot, k]:
            raise np.linalg.LinAlgError("Singular matrix")
        A[[k, pivot]], x[[k, pivot]] = A[[pivot, k]], x[[pivot, k]]
        factors = A[k + 1 :, k] / A[k, k]
        A[k + 1 :, k:] -= np.multiply.outer(factors, A[k, k:])
        x[k + 1 :] -= factors * x[k]
    for k in reversed(range(len(x))):
        x[k] = (x[k] - A[k, k + 1 :] @ x[k + 1 :]) / A[k, k]
    return x
