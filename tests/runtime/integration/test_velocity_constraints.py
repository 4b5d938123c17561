"""Runs with velocity constraints: rows to round-off, reactions, energy and its drift."""

import json

import numpy as np
import pytest

import gyrospark as gs
import systems
from gyrospark.core.errors import InputError
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.runtime.bindings.run_memory import Rows, RunConstants, RunState
from processes import DATA
from rolling_systems import (
    DISC,
    RATTLEBACK,
    SKATE_CHAIN,
    SKATE_CHAIN_START,
    SLEIGH,
    disc,
    disc_state,
    rattleback,
    rattleback_state,
    skate_chain,
    sleigh,
    sleigh_state,
    stepper_of,
    transmission,
)
from stores import record
from work_memory import integers_of

#: Rows A H_p + a and g after a step.
ROUND_OFF = 4e-15


def skates(steps, **options):
    return stepper_of(skate_chain, 2).integrate(*SKATE_CHAIN_START, dt=0.02, steps=steps,
                                                parameters=SKATE_CHAIN, **options)


@pytest.mark.parametrize(("make", "parameters", "start", "s", "steps"), [
    (sleigh, SLEIGH, sleigh_state(0.7, 1.5), 2, 2000), *(pytest.param(*row, marks=pytest.mark.slow)
        for row in ((sleigh, SLEIGH, sleigh_state(0.7, 1.5), 3, 10**6),
                    (skate_chain, SKATE_CHAIN, SKATE_CHAIN_START, 2, 10**6),
                    (disc, DISC, disc_state(), 1, 10**6), (disc, DISC, disc_state(), 2, 300)))])
def test_rows_hold_to_round_off(make, parameters, start, s, steps):
    run = stepper_of(make, s).integrate(*start, dt=0.02, steps=steps, every=steps,
                                        parameters=parameters)
    assert run.report.constraint_max <= ROUND_OFF
    assert run.report.momentum_constraint_max <= ROUND_OFF


def test_a_start_off_the_rows_is_refused_and_projected():
    step, (q, p) = stepper_of(skate_chain, 2), map(np.array, SKATE_CHAIN_START)
    with pytest.raises(InputError, match=r"velocities.*project"):
        step.integrate(q, p + 0.1, dt=0.01, steps=1, parameters=SKATE_CHAIN)
    projected = step.consistent(q, p + 0.1, parameters=SKATE_CHAIN)
    assert max(projected.hidden_after.values()) < 1e-15
    assert set(projected.hidden_after) == {"g0", "A0"}
    step.integrate(*step.project(q, p + 0.1, parameters=SKATE_CHAIN), dt=0.01, steps=1,
                   parameters=SKATE_CHAIN)
    # The way is along the rows: M⁻¹ times it does no virtual work.
    moved = projected.p - (p + 0.1)
    again = step.project(q, projected.p + 3 * moved, parameters=SKATE_CHAIN)[1]
    assert np.abs(again - projected.p).max() < 1e-14


def test_multipliers_and_reactions_have_their_places():
    run = skates(4)
    assert run.multipliers.shape == (4, 3)
    assert run.reactions.shape == (4, 2, 1)
    dataset = run.dataset()
    assert dataset.reactions.dims == ("time", "stage", "velocity_constraint")
    free = systems.run("heavy_top", systems.stepper("heavy_top", "EMS"), 2)
    assert free.reactions.shape == (2, 0, 0)


def test_reactions_go_with_the_states():
    """States at requested times have reactions, and so have members of an ensemble."""
    step, run = stepper_of(skate_chain, 2), skates(50)
    states = run.at(run.t[[0, 7, 50]])
    assert (states.reactions == run.reactions[[6, 49]]).all()
    assert np.abs(run.at([0.333]).f_errors).max() < 1e-14
    ensemble = step.integrate_ensemble(*(np.array([x, x]) for x in SKATE_CHAIN_START), dt=0.02,
                                       steps=50, parameters=SKATE_CHAIN)
    assert (ensemble.members[1].reactions == run.reactions).all()


def test_a_resumed_store_has_the_reactions(tmp_path):
    """The last block is read again: multipliers of g and of the rows, side by side."""
    step, run = stepper_of(skate_chain, 2), skates(20, every=2)
    for steps in (7, 20):
        stored = record(step, *SKATE_CHAIN_START, dt=0.02, steps=steps, every=2, resume=True,
                           parameters=SKATE_CHAIN, out=tmp_path / "run.zarr")[:]
    assert (stored.multipliers == run.multipliers).all()
    assert (stored.reactions == run.reactions).all()


def test_integers_of_work_memory_are_checked(tmp_path):
    """History and factors go from step to step, and from a store to a run that is resumed."""
    step = stepper_of(sleigh, 2)
    binding = step.binding
    constants = RunConstants(binding.parameters(SLEIGH, 0.0), binding.options(None, 50, "auto"),
                             0.1)
    state = RunState.at_start(binding, *sleigh_state(0.7, 1.5))
    report, work = state.record, state.work
    assert binding.integrate(constants, 20, 1, state, Rows.allocate(binding, 20)) == 0
    assert binding.function("is_valid")(report, work)
    by_path = {}
    for integer in integers_of(step.name, step.files, tmp_path)["work"]:
        if integer.path not in ("stored", "order", "has_factors", "pivots", "exponents"):
            continue
        image, sound = binding.image(work), binding.image(work).copy()
        for value in (-(2**31), 2**31 - 1):
            image[integer.offset : integer.offset + 4] = np.frombuffer(
                value.to_bytes(4, "little", signed=True), np.uint8)
            by_path.setdefault(integer.path, []).append(binding.function("is_valid")(report, work))
        image[:] = sound
    assert len(by_path) == 5
    assert not any(any(verdicts) for verdicts in by_path.values()), by_path


def test_events_end_a_run_on_the_rows():
    run = skates(50, events=[gs.Event("x", level=0.5, terminal=True)])
    assert abs(run.q[-1, 0] - 0.5) < 1e-12
    assert run.t[-1] < 1
    assert run.reactions.shape == (len(run.t) - 1, 2, 1)
    assert run.f_errors[-1] < 1e-14


@pytest.mark.slow
def test_a_rattleback_has_the_digits_of_its_reference():
    reference = json.loads((DATA / "rattleback.json").read_text())
    step = stepper_of(rattleback, 8)
    run = step.integrate(*rattleback_state(), dt=2.5e-3, steps=2400, every=2400,
                         parameters=RATTLEBACK)
    names = ("x", "y", "q0", "q1", "q2", "q3")
    errors = run.q[-1, [0, 1, 3, 4, 5, 6]] - [float(reference[name]) for name in names]
    assert np.abs(errors).max() < 1e-8


@pytest.mark.parametrize(("make", "parameters", "start", "steps"), [
    (sleigh, SLEIGH, sleigh_state(0.7, 1.5), 1000),
    *(pytest.param(disc, DISC, disc_state(), steps, marks=pytest.mark.slow)  # its derivation
      for steps in (1000, 100_000))])
def test_the_energy_stays_near(make, parameters, start, steps):
    run = stepper_of(make, 2).integrate(*start, dt=0.05, steps=steps, parameters=parameters)
    errors = np.abs(run.energies - run.energies[0])
    tenth = steps // 10
    assert errors[-tenth:].max() < 1.5 * errors[:tenth].max() < 1e-4


@pytest.mark.parametrize("k", [0.0, 0.3])
def test_energy_drifts_where_a_motion_has_no_mirror(k):
    """The pendulum turns over: with an even potential s → −s maps its motion to itself."""
    step = stepper_of(transmission, 1)
    run = step.integrate(np.array([1.0, 0.3, 0.0]), np.array([0.4, 0.0, 2.2]), dt=0.2, steps=20_000,
                         parameters={"k": k})
    error = np.abs(run.energies - run.energies[0])
    assert (error.max() < 0.05) == (k == 0.0)
    assert error[-1] > 100 * error[:200].max() or k == 0.0
    assert run.report.momentum_constraint_max < 1e-8


@pytest.mark.parametrize("kind", ["derivatives", "second"])
def test_no_derivatives_are_generated(kind):
    system = systems.case("sleigh").system
    with pytest.raises(gs.InputError, match=r"A0.*differences"):
        generate(Spec.from_arguments("G-L", 2), system=system, **{kind: True})
