"""What the tests of the Python calls share: a top to call them with, and what to expect."""

from __future__ import annotations

import warnings
from itertools import product

import numpy as np
import pytest

import gyrospark as gs

TOP = gs.problems.fast_top()
PARAMETERS = TOP.parameters | {"gamma": gs.gamma_m(TOP.inertia)}
RUN = {"dt": 1e-3, "parameters": PARAMETERS}
SCHEMES = [("IMS", None), ("EMS", None), ("G-L", 1), ("G-L", 3), ("LIIIA-B", 2), ("LIIIA-B", 4)]


def identify(scheme):
    return f"{scheme[1] or ''}{scheme[0]}"


def equal(a, b):
    """Whether two trajectories agree bit for bit."""
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in
               ("t", "q", "p", "multipliers", "iterations", "energies", "g_errors", "f_errors"))


def refused(message):
    """Expect an InputError, which is a ValueError, with a sentence that has these words."""
    return pytest.raises(gs.InputError, match=message)


#: A top let go near its highest place: its steps get harder while it falls.
LATE = np.array([np.cos(0.15), np.sin(0.15), 0.0, 0.0]), np.zeros(4)


def late_failures():
    """Find runs from ``LATE`` that fail in the middle, by large steps and few iterations."""
    found = []
    for scheme in (("G-L", 2), ("EMS", None), ("LIIIA-B", 3)):
        step = gs.stepper(*scheme)
        for dt, most in product(np.arange(0.09, 0.4, 0.004).tolist(), (6, 8, 10, 14, 50)):
            options = {"dt": dt, "parameters": PARAMETERS, "max_iterations": most}
            try:
                with warnings.catch_warnings():  # runs that get to their end turn too far in a step
                    warnings.simplefilter("ignore", gs.InputWarning)
                    step.integrate(*LATE, steps=200, **options)
            except gs.StepFailed as failure:
                if 4 < failure.step < 40:
                    found.append((step, options, failure))
                    break
    return found
