"""A top with which the tests of the Python calls call, and the results that they expect."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import gyrospark as gs

TOP = gs.problems.fast_top()
PARAMETERS = TOP.parameters | {"gamma": gs.gamma(TOP.inertia)}
RUN = {"dt": 1e-3, "parameters": PARAMETERS}
SCHEMES = [("EMS", None), ("G-L", 2)]


def identify(scheme):
    return f"{scheme[1] or ''}{scheme[0]}"


def equal(a, b):
    """Whether two trajectories agree bit for bit."""
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in
               ("t", "q", "p", "multipliers", "iterations", "energies", "g_errors", "f_errors"))


def by_names(function, *first, q, p=None, t0=None, **arguments):
    """Call a function that has a start by a table of arguments.

    The keys of the table may be q (or a start), p, t0, and the arguments of ``gs.Solver``.
    """
    limits = {name: arguments.pop(name) for name in ("tolerance", "max_iterations")
              if name in arguments}
    if limits:
        arguments["solver"] = gs.Solver(arguments.pop("solver", "auto"), **limits)
    begin = [q, p] if t0 is None else [gs.Start(q, p, t=t0)]
    return function(*first, *begin, **arguments)


def integrate(step, **arguments):
    """Integrate by a table of arguments."""
    return by_names(step.integrate, **arguments)


def refused(message):
    """Expect an InputError, which is a ValueError, with a sentence that has these words."""
    return pytest.raises(gs.InputError, match=message)


#: A top let go near its highest place: its steps get harder while it falls.
LATE = np.array([np.cos(0.15), np.sin(0.15), 0.0, 0.0]), np.zeros(4)


def late_failures():
    """Find runs from ``LATE`` that fail in the middle, by large steps and few iterations."""
    failures = []
    for scheme in SCHEMES:
        step = gs.stepper(*scheme)
        for dt in (0.12, 0.1, *np.arange(0.09, 0.2, 0.004).tolist()):  # 0.12 or 0.1 as a rule
            options = {"dt": dt, "parameters": PARAMETERS,
                       "solver": gs.Solver("auto", max_iterations=6)}
            try:
                with warnings.catch_warnings():  # runs that get to their end turn too far in a step
                    warnings.simplefilter("ignore", gs.errors.InputWarning)
                    step.integrate(*LATE, steps=200, **options)
            except gs.StepFailed as failure:
                if 4 < failure.step < 40:
                    failures.append((step, options, failure))
                    break
    return failures


def jacobian_by_differences(step, x, q, p, **options):
    """Return ∂r/∂x of a step's residual by central differences: 1e-12 and ε/h, h = 1e-6."""
    columns = [(step.residual(x + d, q, p, **options) - step.residual(x - d, q, p, **options))
               / 2e-6 for d in 1e-6 * np.eye(len(x))]
    return np.transpose(columns)
