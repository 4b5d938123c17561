"""Parameter sweeps: each cell is its single run, and impossible axes are refused."""

from __future__ import annotations

import itertools
import pickle
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
import systems
from gyrospark.runtime.bindings.binding import REASONS
from gyrospark.runtime.rigid_body.gamma_rules import known_inertia
from gyrospark.sweeps import compute_tile, tiles
from gyrospark.sweeps.axes import value_axis
from gyrospark.sweeps.plan import plan
from gyrospark.sweeps.results import BAD_START, StoreSink, fields_of, meanings
from gyrospark.sweeps.sweep_model import starts
from sweep_studies import FAILURES, GAMMAS, OVER, STEPS, TOP

EPS = np.finfo(float).eps


def model_of(name):
    """Return a case of the catalogue as a model."""
    case = systems.case(name)
    return gs.Model(case.system, dict(case.parameters), case.q, case.p, dt=case.dt)


def alone(step, parameters, dt, steps, q=TOP.q0, p=TOP.p0, **options):
    """Return one trajectory by itself, in the lanes that sweeps use."""
    ensemble = step.integrate_ensemble(np.array([q]), np.array([p]), dt=dt, steps=steps,
                                       parameters=parameters, **options)
    return ensemble.members[0]


@pytest.mark.parametrize(("method", "rep", "real"), [
    ({"scheme": "G-L", "stages": 2}, "alpha", "double"), ({"scheme": "EMS"}, "gamma", "double"),
    ({"order": 4}, "gamma", "double"), ({"scheme": "G-L", "stages": 2}, "gamma", "long-double")])
def test_cells_are_runs_to_the_bit(method, rep, real):
    over = {rep: GAMMAS, "dt": STEPS}
    result = gs.sweep("fast-top", over, **method, rep=rep, real=real, steps=30, every=10)
    step = gs.stepper(**method, rep=rep, real=real)
    q, p = step.project(TOP.q0, TOP.p0, parameters=TOP.parameters | {rep: GAMMAS[0]})
    assert result.energy_error_max.dims == (rep, "dt")
    for (i, value), (j, dt) in itertools.product(enumerate(GAMMAS), enumerate(STEPS)):
        cell = result.isel({rep: i, "dt": j})
        run = alone(step, TOP.parameters | {rep: value}, dt, 30, q, p, every=10)
        report = run.report
        assert np.array_equal(cell.q, run.q[-1].astype(float))
        assert np.array_equal(cell.p_samples, run.p.astype(float))
        assert cell.energy_error_max == report.energy_error_max
        assert cell.energy_error_mean == pytest.approx(report.energy_error_mean, rel=1e-6)
        assert cell.constraint_max == report.constraint_max
        assert cell.momentum_constraint_max == report.momentum_constraint_max
        assert cell.iterations_mean == report.iterations_mean
        assert (cell.iterations_max, cell.steps_done) == (report.iterations_max, 30)
        assert cell.status == 0


@pytest.mark.parametrize("solver", ["newton", "fixed-point"])
def test_solvers(solver):
    result = gs.sweep(TOP, OVER, scheme="G-L", stages=2, steps=20, solver=solver)
    step = gs.stepper("G-L", 2)
    run = alone(step, TOP.parameters | {"gamma": GAMMAS[1]}, STEPS[1], 20, solver=solver)
    assert np.array_equal(result.q[1, 1], run.q[-1])
    mean = np.abs(run.energies - run.energies[0]).mean()
    assert result.energy_error_mean[1, 1] == pytest.approx(mean, rel=1e-9)


def test_schemes_starts_lists_and_draws():
    spins = [[0, 0, 100.0], [0, 1.0, 120.0]]
    over = {"scheme": ["EMS", ("G-L", 2), "LIIIA-B 3"], "start": {"angular_velocity": spins},
            "pair": {"gamma": [1e-3, 2e-3], "dt": [1e-3, 5e-4]},
            "drawn": {"count": 3, "seed": 5, "mgl": {"from": 0.3, "to": 0.5}}}
    result = gs.sweep("fast-top", over, steps=7)
    assert dict(result.sizes) == {"scheme": 3, "start": 2, "pair": 2, "drawn": 3, "coordinate": 4}
    assert list(result["coordinate"].values) == ["q0", "q1", "q2", "q3"]
    assert list(result.scheme.values) == ["EMS", "G-L 2", "LIIIA-B 3"]
    assert result.attrs["seed"] == 5
    assert ((result.mgl >= 0.3) & (result.mgl <= 0.5)).all()
    again = gs.sweep("fast-top", over, steps=7)
    assert result.identical(again)
    for k, (scheme, stages) in enumerate([("EMS", None), ("G-L", 2), ("LIIIA-B", 3)]):
        parameters = TOP.parameters | {"gamma": 2e-3, "mgl": result.mgl.values[2]}
        q, p = TOP.q0, gs.Start.of_body(TOP.q0, spins[1], TOP.inertia).p
        run = alone(gs.stepper(scheme, stages), parameters, 5e-4, 7, q, p)
        assert np.array_equal(result.q[k, 1, 1, 2], run.q[-1])


def test_means_and_starts_follow_the_moments_of_a_cell():
    """A cell has γ_m of its moments, not of the model's, and p = 2 L(q)ᵀ J Ω with them."""
    step, moments = gs.stepper("EMS"), TOP.parameters | {"I2": 2.5e-3}
    for over in ({"I1": [2e-3, 3e-3]}, {"point": {"I1": [2e-3, 3e-3]}}):
        result = gs.sweep(TOP, over, parameters={"I2": 2.5e-3}, scheme="EMS", dt=1e-3, steps=7)
        for i, I1 in enumerate((2e-3, 3e-3)):
            gamma = gs.gamma([I1, 2.5e-3, TOP.parameters["I3"]])
            run = alone(step, moments | {"I1": I1, "gamma": gamma}, 1e-3, 7)
            assert np.array_equal(result.q[i], run.q[-1])
    spins = {"start": {"angular_velocity": [[0, 1.0, 120.0]]}}
    result = gs.sweep(TOP, spins, parameters={"I3": 1e-3}, scheme="EMS", dt=1e-3, steps=1)
    inertia = [TOP.parameters["I1"], TOP.parameters["I2"], 1e-3]
    assert np.array_equal(result.p_start[0], gs.Start.of_body(TOP.q0, [0, 1.0, 120.0], inertia).p)


def test_spins_and_means_follow_an_inverse_inertia():
    """p = 2 L(q)ᵀ J Ω and γ_m are of J⁻¹ of the parameters, not of the model's J."""
    J = np.array([[2.0, 0.1, 0.2], [0.1, 2.5, -0.3], [0.2, -0.3, 3.0]])
    entries = dict(zip(("K11", "K12", "K13", "K22", "K23", "K33"),
                       np.linalg.inv(J)[np.triu_indices(3)], strict=True))
    model = SimpleNamespace(bodies={"gamma": TOP.inertia}, q0=TOP.q0, parameters=entries)
    spin = [0.3, 1.0, -0.7]
    axis = starts({"angular_velocity": [spin]}, model, entries, set())
    assert axis.columns["p"][0] == pytest.approx(gs.Start.of_body(TOP.q0, spin, J).p)
    assert gs.gamma(known_inertia("gamma", entries)) == pytest.approx(gs.gamma(J))


def test_first_steps_in_scaled_time_are_the_step_by_the_scale_of_each_start():
    model = model_of("eccentric")
    study = plan(model, {"dtau": [0.05, 0.1], "start": {
        "q": [[0.4, 0.0], [0.6, -0.3]], "p": [[0.0, 2.0], [0.1, 1.0]]}}, scheme="G-L", stages=2,
        steps=5)
    (tile,) = tiles.tiles_of(study)
    cells = tiles.cells_of(study, tile)
    steps = compute_tile.first_steps(study, study.steppers[0], cells, np.array([1, 2, 3]))
    lengths = np.linalg.norm([[0.6, -0.3], [0.4, 0.0], [0.6, -0.3]], axis=1)
    assert steps == pytest.approx([0.05, 0.1, 0.1] * lengths**1.5, rel=8 * EPS)


@pytest.mark.parametrize(("axis", "column"), [
    ("status", "mgl"), ("coordinate", "mgl"), ("sample", "mgl"), ("energy_start", "mgl"),
    ("point", "q")])
def test_names_of_results_name_no_axis(axis, column):
    with pytest.raises(gs.InputError, match=axis):
        gs.sweep(TOP, {axis: {column: [0.3, 0.4]}}, scheme="EMS", dt=1e-3, steps=4, every=2)


def test_a_system_of_ones_own_with_forces_time_and_quantities():
    model = model_of("dragged_pendulum")
    result = gs.sweep(model, {"c": [0.2, 0.4]}, scheme="G-L", stages=2, steps=40)
    step = systems.stepper("dragged_pendulum")
    q, p = step.project(model.q0, model.p0, parameters=model.parameters)
    run = alone(step, model.parameters | {"c": 0.4}, model.dt, 40, q, p)
    assert result.work[1] == run.report.work != 0
    assert result.quantity_height[1] == run.quantity("height")[-1]
    assert result.energy_error_max[1] == run.report.energy_error_max


def test_no_fast_path_no_constraint_no_parameter():
    """The system has no lanes, no constraint and no parameter: cells are computed one by one."""
    model = model_of("swing")
    result = gs.sweep(model, {"dt": [0.01, 0.02, 0.05]}, scheme="EMS", steps=50, solver="newton")
    run = alone(systems.stepper("swing", "EMS"), {}, 0.05, 50, model.q0, model.p0,
                solver="newton")
    assert np.array_equal(result.q[2], run.q[-1])


def test_t_end_gives_each_step_its_number():
    result = gs.sweep(TOP, {"dt": [1e-3, 3e-4, 7e-3]}, scheme="EMS", t_end=0.02)
    assert list(result.steps_done) == [20, 67, 3]
    back = gs.sweep(TOP, {"dt": [-1e-3, -3e-4]}, scheme="EMS", t_end=-0.02)
    assert list(back.steps_done) == [20, 67]


@settings(max_examples=5)
@given(st.integers(1, 9), st.integers(1, 40), st.integers(1, 3), st.integers(0, 2**31))
def test_tiles_cover_every_cell_once_and_change_nothing(rows, columns, workers, seed):
    numbers = np.random.default_rng(seed)
    over = {"gamma": list(numbers.uniform(6e-4, 3e-3, rows)),
            "dt": list(numbers.uniform(1e-4, 3e-3, columns))}
    study = plan(TOP, over, scheme="G-L", stages=2, steps=3)
    with pytest.MonkeyPatch.context() as patch:
        untiled = gs.sweep(TOP, over, scheme="G-L", stages=2, steps=3)
        patch.setattr(tiles, "_cells_of_a_tile", lambda study, stored: int(numbers.integers(1, 30)))
        fixed = tiles.tile_shape(study)
        patch.setattr(tiles, "tile_shape", lambda study, is_stored=True: fixed)
        counts = np.zeros(study.shape, dtype=int)
        for tile in tiles.tiles_of(study):
            counts[tile.slices] += 1
        assert (counts == 1).all()
        tiled = gs.sweep(TOP, over, scheme="G-L", stages=2, steps=3, workers=workers)
    assert tiled.equals(untiled)


@FAILURES
@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_a_diverging_cell_is_nan_with_its_reason_and_the_others_stay():
    over = {"gamma": [1.6e-3], "dt": [1e-3, 0.3, 2e-3, 50.0]}
    result = gs.sweep(TOP, over, scheme="G-L", stages=2, steps=10)
    good = gs.sweep(TOP, {"gamma": [1.6e-3], "dt": [1e-3, 2e-3]}, scheme="G-L", stages=2, steps=10)
    assert list(result.status[0] == 0) == [True, False, True, False]
    assert result.isel(dt=[0, 2]).drop_vars("dt").equals(good.drop_vars("dt"))
    lost = result.isel(gamma=0, dt=1)
    assert np.isnan(lost.q).all()
    assert np.isnan(lost.energy_error_max)
    assert lost.steps_done < 10
    assert int(lost.status) in meanings()
    words = result.status.attrs["flag_meanings"].split()
    assert words[result.status.attrs["flag_values"].index(int(lost.status))] in (
        "not_converged", "singular_matrix", "not_finite")


def test_reasons_of_failed_steps_keep_their_status():
    assert REASONS.items() <= meanings().items()


@FAILURES
@pytest.mark.parametrize("scheme", ["G-L 2", "EMS"])
def test_a_start_off_the_constraints_is_reported(scheme):
    q = np.array([TOP.q0, 1.001 * TOP.q0, TOP.q0])
    p = np.array([TOP.p0, TOP.p0, TOP.p0 + 0.1 * TOP.q0])
    result = gs.sweep(TOP, {"start": (q, p)}, scheme=scheme, dt=1e-3, steps=5)
    assert list(result.status) == [0, BAD_START, BAD_START]
    assert list(result.steps_done) == [5, 0, 0]
    assert np.isnan(result.q[1:]).all()


def test_a_cell_with_an_inertia_that_no_body_has_is_refused():
    with pytest.raises(gs.InputError, match=r"'a'.*100"):
        gs.sweep(systems.case("double_top").system, {"a_I3": [0.03, 100.0]}, scheme="G-L",
                 stages=2, dt=1e-3, steps=2)


def test_a_model_that_starts_off_its_constraints_is_moved_with_a_warning():
    model = model_of("pendulum")
    moved = replace(model, q0=1.01 * np.array(model.q0, dtype=float))
    with pytest.warns(gs.errors.InputWarning, match=r"constraints.*moved"):
        result = gs.sweep(moved, {"g": [1.0, 2.0]}, scheme="G-L", stages=2, steps=2)
    assert result.status.values.tolist() == [0, 0]


@pytest.mark.parametrize("masses", [[1.1, 1.5, 2.0], [2.0, 1.5, 1.1]])
@pytest.mark.parametrize("events", [(), gs.Event("y", level=10.0, name="far")])
def test_a_start_is_projected_with_the_parameters_of_its_cell(masses, events):
    """A cell has the bits of a run alone, whichever comes first; momenta fit one mass alone."""
    step, case = systems.stepper("driven_pendulum"), systems.case("driven_pendulum")
    start = step.consistent(case.q, case.p, parameters=case.parameters)
    model = replace(model_of("driven_pendulum"), q0=start.q, p0=start.p)
    result = gs.sweep(model, {"m": masses}, scheme="G-L", stages=2, steps=5, dt=0.02,
                      events=events)
    assert not result.status.any()
    for i, m in enumerate(masses):
        parameters = case.parameters | {"m": m}
        q, p = step.project(model, parameters=parameters)
        assert abs(q @ p / m - 2 * parameters["a"] * q[1]) < 8 * EPS  # ġ = 0 at t = 0
        run = alone(step, parameters, 0.02, 5, q, p)
        assert np.array_equal(result.q[i], run.q[-1])
        assert np.array_equal(result.p[i], run.p[-1])


def test_a_length_moves_the_start_of_its_cell():
    """The pendulum's g depends on l: the model's start fits one length only."""
    model = model_of("pendulum")
    result = gs.sweep(model, {"l": [1.0, 1.5], "g": [1.0, 2.0]}, scheme="G-L", stages=2, steps=5)
    assert not result.status.any()
    assert np.allclose(np.hypot(*np.moveaxis(result.q.values, -1, 0)), [[1.0] * 2, [1.5] * 2],
                       atol=1e-14)


def test_cells_that_fail_are_counted_in_a_warning():
    states = {"q": [TOP.q0, 1.001 * TOP.q0], "p": [TOP.p0, TOP.p0]}
    with pytest.warns(gs.errors.InputWarning, match=f"1 of 2 .*status {BAD_START}"):
        gs.sweep(TOP, {"start": states}, scheme="EMS", dt=1e-3, steps=5)


@pytest.mark.parametrize("count", [2, 3, 50])
def test_logarithmic_range_ends_at_the_largest_double(count):
    largest = np.finfo(float).max
    values = value_axis("gamma", {"from": 1e300, "to": largest, "count": count,
                                  "spacing": "log"}).columns["gamma"]
    assert (values[0], values[-1]) == (1e300, largest)
    assert (np.diff(values) > 0).all()


@pytest.mark.parametrize(("over", "options", "fragments"), [
    ({}, {}, ["Nothing varies"]),
    ({"gamma": []}, {}, ["gamma", "no list"]),
    ({"I1": [1e-3, -1e-3]}, {}, ["I1", "-0.001", "positive"]),
    ({"gamma": [1e-3, 0]}, {}, ["gamma", "nonzero"]),
    ({"gamma": [[1e-3]]}, {}, ["gamma"]),
    ({"gamma": "abc"}, {}, ["gamma"]),
    ({"gamma": [float("nan")]}, {}, ["finite"]),
    ({"gama": [1e-3]}, {}, ["gama"]),
    ({"dt": [0.0, 1e-3]}, {"dt": None}, ["dt"]),
    ({"gamma": {"from": 0, "to": 1, "count": 3, "spacing": "log"}}, {}, ["logarithm"]),
    ({"gamma": {"from": -1e-200, "to": 1e-200, "count": 3, "spacing": "log"}}, {}, ["logarithm"]),
    ({"gamma": {"from": 1e-200, "to": 1e200, "count": 3, "spacing": "log"}}, {}, ["wider"]),
    ({"gamma": {"from": 1e200, "to": 1e-200, "count": 3, "spacing": "log"}}, {}, ["wider"]),
    ({"gamma": {"from": -1e308, "to": 1e308, "count": 3}}, {}, ["wider"]),
    ({"gamma": {"from": 1e-3, "to": 1e-2}}, {}, ["count"]),
    ({"gamma": {"from": 1e-3, "to": 1e-2, "count": 2, "spacing": "cubic"}}, {}, ["cubic"]),
    ({"gamma": {"from": 1e-3, "to": 1e-2, "count": 2, "step": 1}}, {}, ["range"]),
    ({"a": {"gamma": [1e-3]}, "b": {"gamma": [1e-3]}}, {}, ["varies along", "'a'", "'b'"]),
    ({"a": {"gamma": [1e-3, 2e-3], "dt": [1e-3]}}, {"dt": None}, ["different lengths"]),
    ({"a": {"nothing": [1.0]}}, {}, ["nothing"]),
    ({"start": [1, 2]}, {}, ["start"]),
    ({"start": {"q": [[1, 0, 0, 0]], "p": [[0, 0, 0]]}}, {}, ["shapes"]),
    ({"start": {"q": [[1, 0, 0]], "p": [[0, 0, 0]]}}, {}, ["3 numbers"]),
    ({"scheme": ["EMS"]}, {}, ["leave", "scheme"]),
    ({"gamma": [1e-3]}, {"scheme": "G-L x"}, ["G-L x"]),
    ({"gamma": [1e-3]}, {"steps": None}, ["steps", "t_end"]),
    ({"gamma": [1e-3]}, {"t_end": 1.0}, ["steps", "t_end"]),
    ({"gamma": [1e-3]}, {"steps": None, "t_end": -1.0}, ["t_end = -1.0", "dt = 0.001"]),
    ({"dt": [1e-3, -2e-3]}, {"steps": None, "t_end": 1.0, "dt": None},
     ["t_end = 1.0", "dt = -0.002"]),
    ({"dt": [1e-300]}, {"steps": None, "t_end": 1e10, "dt": None}, ["t_end = 10000000000.0",
                                                                    "dt = 1e-300"]),
    ({"dt": [1e-3]}, {}, ["dt = 0.001", "axis"]),
    ({"a": {"mgl": [0.3], "scheme": [0]}}, {}, ["'scheme'", "'a'"]),
    ({"start": {"q": [["1", 0, 0, 0]], "p": [[0, 0, 0, 0]]}}, {}, ["q", "U"]),
    ({"gamma": [1e-3]}, {"steps": None, "t_end": "late"}, ["t_end", "late"]),
    ({"gamma": [1e-3]}, {"steps": None, "t_end": 1.0, "every": 2}, ["every needs"]),
    ({"gamma": [1e-3]}, {"steps": None, "duration": 1.0}, ["'duration'", "t_end"]),
    ({"mgl": [0.3]}, {"parameters": {"gamma": "h"}}, ["gamma = 'h'", "gyrospark.gamma("]),
    ({"gamma": [1e-3]}, {"keep": ["energy"]}, ["'energy'", "energy_error_max"]),
    ({"gamma": [1e-3]}, {"dt": None}, ["dt"]),
    ({"gamma": [1e-3]}, {"resume": True}, ["resume"]),
    ([("gamma", [1e-3])], {}, ["no dict"]),
])
def test_refusals_come_before_anything_is_computed(over, options, fragments, monkeypatch):
    monkeypatch.setattr(compute_tile, "compute", None)
    choice = {"scheme": "EMS", "steps": 10, "dt": 1e-3} | options
    with pytest.raises(gs.InputError) as error:
        gs.sweep("fast-top", over, **choice)
    assert all(fragment in str(error.value) for fragment in fragments), str(error.value)


def test_a_parameter_named_as_the_step_cannot_be_an_axis():
    """One axis would be both the step and the strength."""
    with pytest.raises(gs.InputError, match="'dt' is a parameter"):
        gs.sweep(model_of("logarithm"), {"dt": [4.0, 9.0]}, scheme="G-L", stages=2, steps=1)


def test_every_negative_gamma_of_an_axis_is_warned_of():
    with pytest.warns(gs.errors.InputWarning, match=r"gamma = -0\.002"):
        gs.sweep(TOP, {"gamma": [1e-3, -2e-3]}, scheme="EMS", dt=1e-3, steps=1)


def test_a_system_without_a_start_is_refused_with_the_cure():
    with pytest.raises(gs.InputError, match=r"gs\.Model\(system, "):
        gs.sweep(model_of("pendulum").system, {"dt": [0.1]}, scheme="EMS", steps=1)


def test_studies_and_stores_travel():
    study = plan(TOP, OVER, scheme="EMS", steps=5)
    unpickled = pickle.loads(pickle.dumps((study, StoreSink(Path("x")))))[0]
    tile = next(tiles.tiles_of(study))
    fields = fields_of(study)
    expected = compute_tile.compute(study, fields, tile)
    for name, values in compute_tile.compute(unpickled, fields, tile).items():
        assert np.array_equal(values, expected[name])
