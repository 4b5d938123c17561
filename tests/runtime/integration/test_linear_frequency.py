"""Motions that a step does not follow, although it keeps their energy, are warned of."""

import numpy as np
import pytest

import systems
from gyrospark.errors import InputWarning
from gyrospark.runtime.integration.linear_frequency import fastest_frequency
from gyrospark.runtime.integration.run_arguments import StartNumbers


@pytest.mark.parametrize(("name", "scheme", "omega"), [
    ("driven_oscillator", ("G-L", 2), 2), ("henon_heiles", ("EMS", None), 1)])
def test_an_oscillator_at_five_rad_a_step_is_warned_of(name, scheme, omega):
    """Near rest; the warning has ω Δt, and steps of the dt that it names are followed."""
    step = systems.stepper(name, *scheme)
    parameters = dict.fromkeys(systems.case(name).parameters, 1e-300)
    if parameters:
        parameters["k"] = omega**2
    q, p = (1e-6 * x for x in systems.start(name, step))
    dt = 5 / omega
    with pytest.warns(InputWarning, match=rf"{omega} rad.*order [24]") as warnings:
        step.integrate(q, p, dt=dt, steps=3, parameters=parameters)
    cure = float(str(warnings[0].message).rpartition("below ")[2].rstrip("."))
    step.integrate(q, p, dt=cure, steps=3, parameters=parameters)  # no warning


def test_a_constrained_motion_has_the_frequency_of_its_tangent_space():
    """A pendulum released at rest: ω² = g cos(θ)/l, here beside the lowest point."""
    step = systems.stepper("pendulum", "EMS")
    q, p = np.array([np.sin(1e-4), -np.cos(1e-4)]), np.zeros(2)
    parameters = {"m": 1.0, "g": 9.0, "l": 1.0}
    run = step._run_arguments(StartNumbers(q, p, parameters, 0.0), dt=3.0, steps=5)
    assert fastest_frequency(step.binding, run, 2) == pytest.approx(3.0, rel=1e-5)


