"""What steppers remark of their schemes, beside the numbers that the remarks are of."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
from splitting_systems import ASYMMETRIC, SYSTEMS, start


def test_the_work_of_drag_on_an_asymmetric_body_has_order_2() -> None:
    """The motion has order 4; the energy error is of the work alone, and the stepper says so."""
    step = gs.stepper("splitting", order=4, system=SYSTEMS["drag"][0])
    values = {name: x for name, x in (ASYMMETRIC | {"k": 0.3}).items() if name != "alpha"}
    q, p = start((1.0, 0.7, -0.4), values)
    runs = [step.integrate(q, p, dt=1 / n, steps=n, every=n, parameters=values)
            for n in (40, 80, 1280)]
    coarse, fine = (np.abs(run.q[-1] - runs[-1].q[-1]).max() for run in runs[:2])
    assert coarse / fine == pytest.approx(2**4, rel=0.1)
    coarse, fine = (run.report.energy_error_max for run in runs[:2])
    assert coarse / fine == pytest.approx(2**2, rel=0.1)
    assert any("work of drag" in remark and "order 2" in remark for remark in step.warnings)
    assert not gs.stepper("splitting", order=2, system=SYSTEMS["drag"][0]).warnings


@pytest.mark.parametrize("stages", [2, 3])
def test_exact_energy_with_2_stages_costs_accuracy(stages: int) -> None:
    said = [remark for remark in gs.stepper("G-L", stages, energy=True).warnings
            if "3 stages" in remark]
    assert bool(said) == (stages == 2)
