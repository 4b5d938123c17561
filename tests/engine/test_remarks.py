"""Remarks of steppers on their schemes, beside the numbers that support them."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.runtime.compilation.manifest import read_manifest
from splitting_systems import ASYMMETRIC, SYSTEMS, start

DRAG = SYSTEMS["drag"][0]


def remarks(spec: Spec, system: gs.System | None = None) -> list[str]:
    """Return the remarks of a stepper, which is not compiled."""
    source = generate(spec, system=system).source
    return [text for _, text in read_manifest(source.name, source.files()).warnings]


def test_the_work_of_drag_on_an_asymmetric_body_is_remarked() -> None:
    (remark,) = remarks(Spec("splitting", order=4), DRAG)
    assert "work of drag" in remark
    assert "order 2" in remark
    assert not remarks(Spec("splitting", order=2), DRAG)


@pytest.mark.slow  # a stepper of order 4 with drag
def test_the_work_of_drag_on_an_asymmetric_body_has_order_2() -> None:
    """The motion has order 4; the energy error is of the work alone."""
    step = gs.stepper("splitting", order=4, system=DRAG)
    values = {name: x for name, x in (ASYMMETRIC | {"k": 0.3}).items() if name != "alpha"}
    q, p = start((1.0, 0.7, -0.4), values)
    runs = [step.integrate(q, p, dt=1 / n, steps=n, every=n, parameters=values)
            for n in (40, 80, 1280)]
    coarse, fine = (np.abs(run.q[-1] - runs[-1].q[-1]).max() for run in runs[:2])
    assert coarse / fine == pytest.approx(2**4, rel=0.1)
    coarse, fine = (run.report.energy_error_max for run in runs[:2])
    assert coarse / fine == pytest.approx(2**2, rel=0.1)


@pytest.mark.parametrize("stages", [2, 3])
def test_exact_energy_with_2_stages_costs_accuracy(stages: int) -> None:
    stage_remarks = [text for text in remarks(Spec("G-L", stages, energy=True))
                     if "3 stages" in text]
    assert bool(stage_remarks) == (stages == 2)
