"""Each feature of a system with each consumer of its steps; the second way is a run, or a loop.

A feature is a case of the catalogue that has it. Cells that the law of the catalogue already fills
(constraints, reversal, solvers) are not repeated.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from stores import record
from systems import case, differentiable, run, start, stepper, timed_start

EPS = np.finfo(float).eps
FEATURES = {
    "constraint": "ellipse", "time": "breathing", "forces": "dragged_pendulum",
    "inputs": "pushed_pendulum", "all of these": "driven_pendulum", "Lagrangian": "lagrangian",
    "Lagrangian with constraint, time, forces": "bead", "rolling": "sleigh",
    "frame": "heavy_top_in_frame", "bodies": "double_top", "scaled time": "scaled_pendulum",
}
#: Systems whose steps a simulation and a loop make too.
OTHERS = ["driven_oscillator", "kepler", "relativistic", "pendulum", "two_rods", "heavy_bob",
          "skate_chain", "eccentric", "tethered_pair", "heavy_top", "four_bar"]
#: A parameter that changes the motion, where that is not the first.
CHANGED = {"heavy_top_in_frame": "omega_body", "bead": "k", "breathing": "k",
           "driven_pendulum": "c"}
#: The parts of a trajectory that a consumer must not change.
PARTS = ("t", "q", "p", "velocities", "energies", "work", "quantity_values", "multipliers",
         "reactions")


def features(*left_out):
    """Return a decorator with the name of a case for each feature but some."""
    return pytest.mark.parametrize("name", [
        pytest.param(name, id=feature) for feature, name in FEATURES.items()
        if feature not in left_out])


def options(name, **changes):
    """Return the arguments of a run of a case besides the number of steps."""
    entry = case(name)
    return entry.step | {"parameters": entry.parameters} | changes


def same(trajectory, expected, parts=PARTS, bits=True):
    """Compare trajectories part by part."""
    for name in parts:
        a, b = getattr(trajectory, name), getattr(expected, name)
        if bits:
            assert np.array_equal(a, b), name
        else:
            assert np.shape(a) == np.shape(b)
            assert np.abs(a - b).max(initial=0) <= 4096 * EPS * (1 + np.abs(b).max(initial=0)), name


def model_of(name):
    """Return a case as a model that starts at t = 0, on its constraints."""
    entry = case(name)
    system, (q, p) = entry.system, stepper(name).project(entry.q, entry.p,
                                                         parameters=entry.parameters)
    if isinstance(system, str):
        return gs.problems.fast_top()
    if hasattr(system, "system"):
        return system
    return gs.Model(system, dict(entry.parameters), q, p, dt=entry.dt, steps=20)


# ---------------------------------------------------------------- simulation, loop


@pytest.mark.parametrize("name", [*FEATURES.values(), *OTHERS])
def test_a_simulation_and_a_loop_of_steps_have_the_bits_of_a_run(name):
    """A copy that goes on alone, and the record of the simulation, have the same bits, too."""
    step, entry = stepper(name), case(name)
    full_run = run(name, step, 12)
    simulation = step.start(timed_start(name, step), **options(name), record=True)
    simulation.advance(5)
    copy = simulation.copy()
    simulation.advance(7)
    same(simulation.trajectory, full_run)
    assert simulation.t == full_run.t[-1]
    assert simulation.report == full_run.report
    copy.advance(7)
    assert np.array_equal(copy.q, full_run.q[-1])
    assert np.array_equal(copy.p, full_run.p[-1])
    if "scaled" in entry.features:
        return  # step returns no time
    q, p = full_run.q[0], full_run.p[0]
    for i in range(12):
        q, p = step.step(gs.Start(q, p, t=entry.t0 + i * entry.dt), **options(name))
    # t₀ + i Δt is rounded; many bodies begin the next sweeps where the last step's ended
    bound = 64 * EPS * bool(entry.features & {"time", "bodies"})
    assert np.abs(q - full_run.q[-1]).max() <= bound
    assert np.abs(p - full_run.p[-1]).max() <= bound * max(1, np.abs(p).max())


@pytest.mark.parametrize(("name", "scheme"), [
    ("pushed_pendulum", ("G-L", 2)), ("driven_pendulum", ("EMS", None))])
def test_inputs_by_rows_by_names_and_one_run_a_step_are_the_same(name, scheme):
    step, entry = stepper(name, *scheme), case(name)
    inputs = [str(s) for s in entry.system.inputs]
    rows = np.random.default_rng(2).standard_normal((6, len(inputs))) / 4
    plain = {key: value for key, value in entry.parameters.items() if key not in inputs}
    arguments = {"dt": entry.dt, "parameters": plain}
    begin = timed_start(name, step)
    q, p = begin.q, begin.p
    expected = step.integrate(begin, steps=22, inputs=gs.Inputs(rows, hold=4), **arguments)
    step_rows = np.repeat(rows, 4, axis=0)[:22]
    same(step.integrate(begin, steps=22, inputs=step_rows, **arguments), expected)
    same(step.integrate(begin, steps=22, inputs=dict(zip(inputs, step_rows.T, strict=True)),
                        **arguments),
         expected)
    assert np.isnan(expected.parameters[inputs[0]])  # it is no one number
    thin = step.integrate(begin, steps=22, inputs=gs.Inputs(rows, hold=4), every=5, **arguments)
    assert np.array_equal(thin.q, expected.q[[0, 5, 10, 15, 20, 22]])
    simulation = step.start(begin, **arguments | {"parameters": entry.parameters})
    for i, row in enumerate(step_rows):
        simulation.advance(**dict(zip(inputs, row, strict=True)))
        single = step.integrate(gs.Start(expected.q[i], expected.p[i], t=expected.t[i]), steps=1,
                                dt=entry.dt, parameters=plain | dict(zip(inputs, row, strict=True)))
        assert np.abs(single.q[-1] - expected.q[i + 1]).max() <= 256 * EPS
        assert np.abs(single.p[-1] - expected.p[i + 1]).max() <= 256 * EPS * (
            1 + np.abs(expected.p).max())
    q1, p1 = q, p
    for i, row in enumerate(step_rows):  # a step from the time of the run, with its row
        q1, p1 = step.step(gs.Start(q1, p1, t=expected.t[i]), dt=entry.dt, parameters=plain,
                           inputs=row)
        assert np.abs(q1 - expected.q[i + 1]).max() <= 256 * EPS
    assert np.array_equal(simulation.q, expected.q[-1])
    assert simulation.parameters[inputs[-1]] == step_rows[-1][-1]
    member_rows = np.array([rows, -rows])
    ensemble = step.integrate_ensemble([begin] * 2, steps=22,
                                       inputs=gs.Inputs(member_rows, hold=4), **arguments)
    assert np.abs(ensemble.q[0] - expected.q).max() <= 256 * EPS
    assert np.abs(ensemble.q[1] - expected.q).max() > 1e-6


# ---------------------------------------------------------------- ensembles


@pytest.mark.parametrize(("name", "scheme"), [
    *((name, ("G-L", 2)) for name in FEATURES.values()),
    *((name, ("EMS", None)) for name in ("driven_pendulum", "bead"))])
def test_members_of_an_ensemble_are_single_runs(name, scheme):
    """Each has its own start, parameter and time; there are five, for a lane is never full."""
    step, entry = stepper(name, *scheme), case(name)
    changed = CHANGED.get(name, next(iter(entry.parameters)))
    sets = [entry.parameters | {changed: entry.parameters[changed] * (1 + i / 50)}
            for i in range(5)]
    times = [entry.t0 + i / 8 if "time" in entry.features else entry.t0 for i in range(5)]
    starts = [step.project(*start(name, step), parameters=numbers, t=time)
              for numbers, time in zip(sets, times, strict=True)]
    ensemble = step.integrate_ensemble(gs.Start(*map(np.array, zip(*starts, strict=True)), t=times),
                                       steps=20, every=3, **options(name, parameters=sets))
    for (q, p), numbers, time, member in zip(starts, sets, times, ensemble.members, strict=True):
        single = step.integrate(gs.Start(q, p, t=time), steps=20, every=3,
                                **options(name, parameters=numbers))
        same(member, single, ("t", "q", "p", "work", "quantity_values"), bits=False)
    assert np.abs(ensemble.q[0] - ensemble.q[4]).max() > 1e-9


# ---------------------------------------------------------------- between steps


@features("scaled time")  # of which no part of a step is known beforehand
def test_dense_output_is_a_step_of_a_part_of_dt(name):
    step, entry = stepper(name), case(name)
    shares = np.array([0.25, 3.5, 7.875, 2.0])
    full_run = run(name, step, 8)
    for every in (1, 3):
        between = run(name, step, 8, every=every).at(entry.t0 + shares * entry.dt)
        for share, q, p in zip(shares, between.q, between.p, strict=True):
            k = int(share)
            short_step = step.integrate(gs.Start(full_run.q[k], full_run.p[k], t=full_run.t[k]),
                                        steps=int(share > k),
                                        **options(name, dt=(share - k) * entry.dt or entry.dt))
            assert np.abs(short_step.q[-1] - q).max() <= 256 * EPS * (1 + np.abs(q).max())
            assert np.abs(short_step.p[-1] - p).max() <= 1024 * EPS * (1 + np.abs(p).max())


@features()
def test_events_are_where_a_coordinate_passes_its_level(name):
    """States by ``at``, in an ensemble, and at the end of a run lie on the level."""
    step = stepper(name)
    full_run = run(name, step, 20)
    travel = np.abs(full_run.q[-1] - full_run.q[0])
    axis = int(np.argmax(travel))
    level = float(full_run.q[10, axis] * 0.7 + full_run.q[11, axis] * 0.3)
    event = gs.Event(full_run.coordinates[axis], level=level, name="level")
    with_events = run(name, step, 20, events=event)
    same(with_events, full_run)
    times = with_events.events["level"].t
    assert any(full_run.t[10] <= time <= full_run.t[11] for time in times)
    scale = 1 + abs(level)
    assert np.abs(with_events.events["level"].q[:, axis] - level).max() <= 64 * EPS * scale
    assert np.abs(full_run.at(times).q[:, axis] - level).max() <= 64 * EPS * scale
    ensemble = step.integrate_ensemble([timed_start(name, step)] * 2, steps=20, events=event,
                                       **options(name))
    np.testing.assert_allclose(ensemble.events["level"][1].t, times, rtol=0, atol=1e-12)
    ended = run(name, step, 20, events=replace(event, terminal=True))
    assert ended.t[-1] == times[0]
    assert abs(ended.q[-1, axis] - level) <= 64 * EPS * scale


# ---------------------------------------------------------------- files, stores, tables


def test_a_stored_run_of_flows_has_the_bits_of_one_call(tmp_path):
    """Compositions of exact flows have no multipliers, nor has their store."""
    same_in_files("heavy_top", stepper("heavy_top", "splitting", order=2), tmp_path)


@features("constraint", "time", "forces", "inputs", "Lagrangian")  # of others' parts
def test_a_stored_run_in_pieces_has_the_bits_of_one_call(name, tmp_path):
    same_in_files(name, stepper(name), tmp_path)


def same_in_files(name, step, tmp_path):
    """Compare a run with its store, begun and resumed, and with its .npz file."""
    out = tmp_path / "run.zarr"
    begin = timed_start(name, step)
    full_run = run(name, step, 20, every=2)
    for steps in (7, 20):
        record(step, begin, steps=steps, every=2, out=out, resume=True, **options(name))
    stored = gs.load(out)[:]
    loaded = gs.load(full_run.save(tmp_path / "run.npz"))
    same(stored, full_run)
    same(loaded, full_run)
    assert loaded.report == full_run.report
    assert stored.quantities == loaded.quantities == full_run.quantities


@features()
def test_a_table_has_the_states(name, tmp_path):
    trajectory = run(name, stepper(name), 4)
    heading, *lines = trajectory.save(tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()
    names = heading.split(",")
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines])
    assert np.array_equal(table[:, names.index("time")], trajectory.t)
    states = np.concatenate([trajectory.q, trajectory.p], axis=1)
    assert np.array_equal(table[:, 1:1 + states.shape[1]], states)
    for quantity in trajectory.quantities:
        assert np.array_equal(table[:, names.index(quantity)], trajectory.quantity(quantity))


@features("scaled time")
def test_a_cell_of_a_sweep_is_a_run(name):
    entry, model = case(name), model_of(name)
    changed = CHANGED.get(name, next(iter(entry.parameters)))
    values = [entry.parameters[changed], 1.02 * entry.parameters[changed]]
    frame = {"frame": "symmetries"} if "frame" in entry.features else {}
    if "velocity_constraints" in entry.features:  # they make each parameter part of the start
        values = values[:1]
    study = gs.sweep(model, {changed: values, "dt": [entry.dt, entry.dt / 2]},
                     parameters={key: value for key, value in entry.parameters.items()
                                 if key != changed}, scheme="G-L", stages=2, steps=10, **frame)
    step = stepper(name)
    for i, value in enumerate(values):
        for j, dt in enumerate((entry.dt, entry.dt / 2)):
            numbers = entry.parameters | {changed: value}
            begin = step.project(model.q0, model.p0, parameters=numbers)
            single = step.integrate(*begin, steps=10, dt=dt, parameters=numbers)
            bound = 4096 * EPS * (1 + np.abs(single.q).max())
            assert np.abs(study.q.values[i, j] - single.q[-1]).max() <= bound


# ---------------------------------------------------------------- model files, commands


def as_file(name):
    """Return the text of a model file of a case with a Hamiltonian."""
    entry, (q, p) = case(name), start(name, stepper(name))
    system = entry.system

    def quoted(rows):
        return "[" + ", ".join(f'"{e}"' for e in rows) + "]"

    inputs = [str(s) for s in system.inputs]
    parameters = {key: value for key, value in entry.parameters.items() if key not in inputs}
    lines = [f'name = "{name}"', "[system]", f"coordinates = {quoted(system.q)}",
             f"momenta = {quoted(system.p)}", f'hamiltonian = "{system.H}"']
    lines += [f"{key} = {quoted(rows)}" for key, rows in (
        ("constraints", system.constraints), ("forces", system.forces),
        ("velocities", system.velocities), ("velocity_constraints", system.velocity_constraints),
    ) if rows]
    lines += [f'{key} = "{symbol}"' for key in ("time", "time_scale")
              if (symbol := getattr(system, key)) is not None]
    for table, numbers in (("parameters", parameters), ("inputs", {k: entry.parameters[k]
                                                                   for k in inputs})):
        lines += [f"[{table}]", *(f"{key} = {float(value)!r}" for key, value in numbers.items())
                  ] if numbers else []
    if system.quantities:
        lines += ["[quantities]", *(f'{key} = "{e}"' for key, e in system.quantities.items())]
    return "\n".join([*lines, "[start]", f"q = {q.tolist()}", f"p = {p.tolist()}", "[run]",
                      f"dt = {entry.dt}", "steps = 10", ""])


@features("Lagrangian", "Lagrangian with constraint, time, forces", "frame", "bodies")
def test_a_model_file_is_the_system(name, tmp_path):
    entry, path = case(name), tmp_path / f"{name}.toml"
    path.write_text(as_file(name), encoding="utf-8")
    model = gs.load_model(path)
    loaded, expected = model.system, entry.system
    plain = {s: sp.Symbol(str(s)) for system in (loaded, expected) for s in (
        *system.q, *system.p, *system.velocities, *system.parameters, *system.inputs,
        *([system.time] if system.time else []))}
    for field in ("H", "constraints", "forces", "velocity_constraints", "time_scale"):
        a, b = (sp.Matrix(np.ravel(getattr(s, field) or 0)).xreplace(plain)
                for s in (loaded, expected))
        assert (a - b).expand() == sp.zeros(*a.shape), field
    assert [*map(str, loaded.inputs)] == [*map(str, expected.inputs)]
    assert {k: float(v) for k, v in model.parameters.items()} == {
        k: float(v) for k, v in entry.parameters.items()}
    assert [*loaded.quantities] == [*expected.quantities]


@pytest.mark.parametrize("name", ["driven_pendulum", "sleigh"])
def test_run_of_a_model_file_ends_where_a_run_does(name, gyrospark, tmp_path):
    entry, path = case(name), tmp_path / f"{name}.toml"
    path.write_text(as_file(name), encoding="utf-8")
    command = ["run", path, "--scheme", "G-L", "--stages", "2", "--json", "--set", f"t={entry.t0}"]
    calls = [((), {})]
    if entry.system.inputs:
        changed = str(entry.system.inputs[0])
        calls.append((("--set", f"inputs.{changed}=1"), {changed: 1.0}))
    for words, parameters in calls:
        document = gyrospark(*command, *words).document
        end = run(name, stepper(name), 10, parameters=entry.parameters | parameters)
        for key, expected in (("q", end.q[-1]), ("p", end.p[-1])):
            values = np.array([float(x) for x in document[key]])
            assert np.abs(values - expected).max() <= 256 * EPS * (1 + np.abs(expected).max())


@pytest.mark.parametrize("name", ["driven_pendulum", "sleigh"])
def test_generate_writes_the_files_of_the_stepper(name, gyrospark, tmp_path):
    path = tmp_path / f"{name}.toml"
    path.write_text(as_file(name), encoding="utf-8")
    answer = gyrospark("generate", "--scheme", "G-L", "--stages", "2", "--system", path,
                       "--no-compile", "--standalone", "--out", tmp_path)
    assert answer.code == 0, answer.stderr
    files = gs.stepper("G-L", 2, system=path).files
    for file, text in files.items():
        if file.startswith(name):
            assert (tmp_path / file).read_text(encoding="utf-8") == text, file


# ---------------------------------------------------------------- derivatives, certificate


@pytest.mark.parametrize("name", ["driven_pendulum", "bead", "heavy_top_in_frame"])
def test_tangents_are_differences_of_runs(name):
    """Central differences, extrapolated as by Richardson, agree along the tangents of the start."""
    step, entry = differentiable(name), case(name)
    q, p = start(name, step)
    trajectory = step.integrate(gs.Start(q, p, t=entry.t0), steps=5,
                                tangents=gs.Tangents(start="all"), **options(name))
    basis, n = trajectory.tangents.start, step.n
    direction = basis @ np.random.default_rng(1).standard_normal(basis.shape[1])
    coefficients = np.linalg.lstsq(basis, direction, rcond=None)[0]
    derivative = np.concatenate([trajectory.tangents.q[-1],
                                 trajectory.tangents.p[-1]]) @ coefficients

    def end(h):
        begin = step.project(q + h * direction[:n], p + h * direction[n:],
                             parameters=entry.parameters, t=entry.t0)
        single = step.integrate(gs.Start(*begin, t=entry.t0), steps=5, **options(name))
        return np.concatenate([single.q[-1], single.p[-1]])

    h = 1e-3 * min(1.0, np.abs(p).max() or 1.0)
    coarse, fine = ((end(x) - end(-x)) / (2 * x) for x in (h, h / 2))
    slope = (4 * fine - coarse) / 3
    assert np.abs(slope - derivative).max() <= 1e-7 * (1 + np.abs(derivative).max())


@pytest.mark.parametrize(("name", "scheme"), [
    ("breathing", "EMS"), ("driven_pendulum", "G-L"), ("sleigh", "G-L")])
def test_a_certificate_holds_with_the_feature(name, scheme):
    """The energy is less the work where a force does work; the motion can be reversed."""
    certificate = gs.certify(model_of(name), scheme, 2 if scheme == "G-L" else None)
    assert certificate.holds, certificate
    assert certificate.line("reversal").holds
    lines = {line.quantity: line for line in certificate.lines}
    (energy,) = [line for key, line in lines.items() if "energy" in key][:1]
    assert energy.holds is (True if scheme == "EMS" else None)
    assert ("less work" in energy.quantity) == bool(
        case(name).features & {"time", "forces", "inputs"})
