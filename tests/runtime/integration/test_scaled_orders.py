"""Orders of steps in scaled time beside motions by a second way: other coordinates, equations
without constraints, 40 digits (``helpers/scaled_motions.py``)."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
import scaled_motions
import systems

#: Δτ of one stage to six at which errors begin to follow their order, and are not yet round-off.
STEPS = {
    "eccentric": (0.02, 0.1, 0.4, 0.6, 0.8, 1.0),
    "very_eccentric": (0.02, 0.1, 0.4, 0.6, 0.8, 1.0),
    "tethered_pair": (0.02, 0.05, 0.1, 0.1, 0.12, 0.15),
    "scaled_pendulum": (0.05, 0.1, 0.15, 0.12, 0.16, 0.2),
    "eccentric_satellite": (0.02, 0.1, 0.2, 0.2, 0.3, 0.45),
}
_QUICK = {(name, 2) for name in STEPS if name != "eccentric_satellite"}


def errors(name, scheme, stages, real="double", count=3):
    """Largest errors of q and p at the end, in parts of the largest of them; Δτ falls by 1.5."""
    step = systems.stepper(name, scheme, stages, real)
    motion, (start, end) = scaled_motions.MOTIONS[name], scaled_motions.states(name)
    begin = gs.Start(*start.reshape(2, step.n), t=np.longdouble(motion.t0))
    runs = [step.integrate(begin, dtau=STEPS[name][stages - 1] / 1.5**k,
                           t_end=np.longdouble(motion.t_end),
                           parameters=systems.case(name).parameters) for k in range(count)]
    assert all(run.report.constraint_max < 64 * np.finfo(run.q.dtype).eps for run in runs)
    return np.array([np.abs(np.concatenate([run.q[-1], run.p[-1]]) - end).max()
                     for run in runs]) / np.abs(end).max()


def slope(errors):
    """The mean slope: single ones of many stages scatter where the error passes through zero."""
    return np.log(errors[0] / errors[-1]) / np.log(1.5) / (len(errors) - 1)


@pytest.mark.parametrize(("name", "stages"), [
    pytest.param(name, stages, marks=[] if (name, stages) in _QUICK else pytest.mark.slow)
    for name in STEPS for stages in (1, 2)])
def test_one_stage_has_order_2_and_two_have_4(name, stages):
    assert abs(slope(errors(name, "G-L", stages)) - 2 * stages) < 0.15


@pytest.mark.slow  # twenty steppers in long double, for errors below the round-off of doubles
@pytest.mark.parametrize("stages", [3, 4, 5, 6])
@pytest.mark.parametrize("name", STEPS)
def test_more_stages_have_twice_their_number_as_order(name, stages):
    """A symmetric method has an even order: 0.7 tells it from the next ones."""
    assert abs(slope(errors(name, "G-L", stages, "long-double", 4)) - 2 * stages) < 0.7


@pytest.mark.slow  # twelve steppers
@pytest.mark.parametrize("stages", [2, 3])
@pytest.mark.parametrize("name", STEPS)
def test_lobatto_steps_have_order_2s_less_2(name, stages):
    assert abs(slope(errors(name, "LIIIA-B", stages, "long-double", 4)) - 2 * (stages - 1)) < 0.4


@pytest.mark.slow  # 40 digits in Python
@pytest.mark.parametrize("name", STEPS)
def test_stored_motions_are_those_of_their_equations(name):
    found = np.array([[np.longdouble(x) for x in numbers]
                      for numbers in scaled_motions.digits(name)])
    assert np.abs(found - scaled_motions.states(name)).max() < 1e-18


@pytest.mark.slow  # a million steps
@pytest.mark.parametrize("name", ["very_eccentric", "tethered_pair"])
def test_the_energy_error_is_bounded_over_a_million_steps(name):
    """H + e without a drift: its largest in each tenth is the same; e and J are constant."""
    step = systems.stepper(name)
    run = systems.run(name, step, 10**6, every=100, dtau=0.1)
    tenths = np.abs(run.energies + run.time_momentum)[1:].reshape(10, -1).max(axis=1)
    assert tenths.max() < 1.02 * tenths.min()
    assert np.ptp(run.time_momentum) == 0
    half = run.q.shape[1] // 2
    J = sum(run.q[:, i] * run.p[:, i + 1] - run.q[:, i + 1] * run.p[:, i]
            for i in range(0, 2 * half, 2))
    assert np.abs(J - J[0]).max() < 1e-11 * np.abs(J[0])
