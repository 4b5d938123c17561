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


def options(name, **more):
    """Return what a run of a case takes besides the number of steps."""
    entry = case(name)
    return entry.step | {"parameters": entry.parameters} | more


def same(found, wanted, parts=PARTS, bits=True):
    """Compare trajectories part by part."""
    for part in parts:
        a, b = getattr(found, part), getattr(wanted, part)
        if bits:
            assert np.array_equal(a, b), part
        else:
            assert np.shape(a) == np.shape(b)
            assert np.abs(a - b).max(initial=0) <= 4096 * EPS * (1 + np.abs(b).max(initial=0)), part


def model_of(name):
    """Return a case as a model that starts at t = 0, on its constraints."""
    entry = case(name)
    known, (q, p) = entry.system, stepper(name).project(entry.q, entry.p,
                                                        parameters=entry.parameters)
    if isinstance(known, str):
        return gs.problems.fast_top()
    if hasattr(known, "system"):
        return known
    return gs.Model(known, dict(entry.parameters), q, p, dt=entry.dt, steps=20)


# ---------------------------------------------------------------- simulation, loop


@pytest.mark.parametrize("name", [*FEATURES.values(), *OTHERS])
def test_a_simulation_and_a_loop_of_steps_have_the_bits_of_a_run(name):
    """Also a copy that goes on alone, and what the simulation recorded."""
    step, entry = stepper(name), case(name)
    whole = run(name, step, 12)
    held = step.start(timed_start(name, step), **options(name), record=True)
    held.advance(5)
    copy = held.copy()
    held.advance(7)
    same(held.trajectory, whole)
    assert held.t == whole.t[-1]
    assert held.report == whole.report
    copy.advance(7)
    assert np.array_equal(copy.q, whole.q[-1])
    assert np.array_equal(copy.p, whole.p[-1])
    if "scaled" in entry.features:
        return  # step returns no time
    q, p = whole.q[0], whole.p[0]
    for i in range(12):
        q, p = step.step(gs.Start(q, p, t=entry.t0 + i * entry.dt), **options(name))
    # t₀ + i Δt is rounded; many bodies begin the next sweeps where the last step's ended
    bound = 64 * EPS * bool(entry.features & {"time", "bodies"})
    assert np.abs(q - whole.q[-1]).max() <= bound
    assert np.abs(p - whole.p[-1]).max() <= bound * max(1, np.abs(p).max())


@pytest.mark.parametrize(("name", "scheme"), [
    ("pushed_pendulum", ("G-L", 2)), ("driven_pendulum", ("EMS", None))])
def test_inputs_by_rows_by_names_and_one_run_a_step_are_the_same(name, scheme):
    step, entry = stepper(name, *scheme), case(name)
    inputs = [str(s) for s in entry.system.inputs]
    rows = np.random.default_rng(2).standard_normal((6, len(inputs))) / 4
    plain = {key: value for key, value in entry.parameters.items() if key not in inputs}
    how = {"dt": entry.dt, "parameters": plain}
    begin = timed_start(name, step)
    q, p = begin.q, begin.p
    held = step.integrate(begin, steps=22, inputs=gs.Inputs(rows, hold=4), **how)
    each = np.repeat(rows, 4, axis=0)[:22]
    same(step.integrate(begin, steps=22, inputs=each, **how), held)
    same(step.integrate(begin, steps=22, inputs=dict(zip(inputs, each.T, strict=True)), **how),
         held)
    assert np.isnan(held.parameters[inputs[0]])  # it is no one number
    thin = step.integrate(begin, steps=22, inputs=gs.Inputs(rows, hold=4), every=5, **how)
    assert np.array_equal(thin.q, held.q[[0, 5, 10, 15, 20, 22]])
    fed = step.start(begin, **how | {"parameters": entry.parameters})
    for i, row in enumerate(each):
        fed.advance(**dict(zip(inputs, row, strict=True)))
        one = step.integrate(gs.Start(held.q[i], held.p[i], t=held.t[i]), steps=1, dt=entry.dt,
                             parameters=plain | dict(zip(inputs, row, strict=True)))
        assert np.abs(one.q[-1] - held.q[i + 1]).max() <= 256 * EPS
        assert np.abs(one.p[-1] - held.p[i + 1]).max() <= 256 * EPS * (1 + np.abs(held.p).max())
    q1, p1 = q, p
    for i, row in enumerate(each):  # a step from the time of the run, with its row
        q1, p1 = step.step(gs.Start(q1, p1, t=held.t[i]), dt=entry.dt, parameters=plain,
                           inputs=row)
        assert np.abs(q1 - held.q[i + 1]).max() <= 256 * EPS
    assert np.array_equal(fed.q, held.q[-1])
    assert fed.parameters[inputs[-1]] == each[-1][-1]
    own = np.array([rows, -rows])
    many = step.integrate_ensemble([begin] * 2, steps=22, inputs=gs.Inputs(own, hold=4), **how)
    assert np.abs(many.q[0] - held.q).max() <= 256 * EPS
    assert np.abs(many.q[1] - held.q).max() > 1e-6


# ---------------------------------------------------------------- ensembles


@pytest.mark.parametrize(("name", "scheme"), [
    *((name, ("G-L", 2)) for name in FEATURES.values()),
    *((name, ("EMS", None)) for name in ("driven_pendulum", "bead"))])
def test_members_of_an_ensemble_are_single_runs(name, scheme):
    """Each with a start, a parameter and a time of its own; five, for a lane is never full."""
    step, entry = stepper(name, *scheme), case(name)
    changed = CHANGED.get(name, next(iter(entry.parameters)))
    sets = [entry.parameters | {changed: entry.parameters[changed] * (1 + i / 50)}
            for i in range(5)]
    times = [entry.t0 + i / 8 if "time" in entry.features else entry.t0 for i in range(5)]
    starts = [step.project(*start(name, step), parameters=numbers, t=time)
              for numbers, time in zip(sets, times, strict=True)]
    many = step.integrate_ensemble(gs.Start(*map(np.array, zip(*starts, strict=True)), t=times),
                                   steps=20, every=3, **options(name, parameters=sets))
    for (q, p), numbers, time, member in zip(starts, sets, times, many.members, strict=True):
        alone = step.integrate(gs.Start(q, p, t=time), steps=20, every=3,
                               **options(name, parameters=numbers))
        same(member, alone, ("t", "q", "p", "work", "quantity_values"), bits=False)
    assert np.abs(many.q[0] - many.q[4]).max() > 1e-9


# ---------------------------------------------------------------- between steps


@features("scaled time")  # of which no part of a step is known beforehand
def test_dense_output_is_a_step_of_a_part_of_dt(name):
    step, entry = stepper(name), case(name)
    shares = np.array([0.25, 3.5, 7.875, 2.0])
    whole = run(name, step, 8)
    for every in (1, 3):
        found = run(name, step, 8, every=every).at(entry.t0 + shares * entry.dt)
        for share, q, p in zip(shares, found.q, found.p, strict=True):
            k = int(share)
            at = step.integrate(gs.Start(whole.q[k], whole.p[k], t=whole.t[k]),
                                steps=int(share > k),
                                **options(name, dt=(share - k) * entry.dt or entry.dt))
            assert np.abs(at.q[-1] - q).max() <= 256 * EPS * (1 + np.abs(q).max())
            assert np.abs(at.p[-1] - p).max() <= 1024 * EPS * (1 + np.abs(p).max())


@features()
def test_events_are_where_a_coordinate_passes_its_level(name):
    """On the level by ``at``, in an ensemble, and as the end of a run."""
    step = stepper(name)
    whole = run(name, step, 20)
    travel = np.abs(whole.q[-1] - whole.q[0])
    axis = int(np.argmax(travel))
    level = float(whole.q[10, axis] * 0.7 + whole.q[11, axis] * 0.3)
    event = gs.Event(whole.coordinates[axis], level=level, name="level")
    found = run(name, step, 20, events=event)
    same(found, whole)
    times = found.events["level"].t
    assert any(whole.t[10] <= time <= whole.t[11] for time in times)
    scale = 1 + abs(level)
    assert np.abs(found.events["level"].q[:, axis] - level).max() <= 64 * EPS * scale
    assert np.abs(whole.at(times).q[:, axis] - level).max() <= 64 * EPS * scale
    many = step.integrate_ensemble([timed_start(name, step)] * 2, steps=20, events=event,
                                   **options(name))
    np.testing.assert_allclose(many.events["level"][1].t, times, rtol=0, atol=1e-12)
    ended = run(name, step, 20, events=replace(event, terminal=True))
    assert ended.t[-1] == times[0]
    assert abs(ended.q[-1, axis] - level) <= 64 * EPS * scale


# ---------------------------------------------------------------- files, stores, tables


@features("constraint", "time", "forces", "inputs", "Lagrangian")  # of others' parts
def test_a_stored_run_in_pieces_has_the_bits_of_one_call(name, tmp_path):
    step, out = stepper(name), tmp_path / "run.zarr"
    begin = timed_start(name, step)
    whole = run(name, step, 20, every=2)
    for steps in (7, 20):
        record(step, begin, steps=steps, every=2, out=out, resume=True, **options(name))
    stored = gs.load(out)[:]
    loaded = gs.load(whole.save(tmp_path / "run.npz"))
    same(stored, whole)
    same(loaded, whole)
    assert loaded.report == whole.report
    assert stored.quantities == loaded.quantities == whole.quantities


@features()
def test_a_table_has_the_states(name, tmp_path):
    found = run(name, stepper(name), 4)
    heading, *lines = found.save(tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()
    names = heading.split(",")
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines])
    assert np.array_equal(table[:, names.index("time")], found.t)
    states = np.concatenate([found.q, found.p], axis=1)
    assert np.array_equal(table[:, 1:1 + states.shape[1]], states)
    for quantity in found.quantities:
        assert np.array_equal(table[:, names.index(quantity)], found.quantity(quantity))


@features("scaled time")
def test_a_cell_of_a_sweep_is_a_run(name):
    entry, model = case(name), model_of(name)
    changed = CHANGED.get(name, next(iter(entry.parameters)))
    values = [entry.parameters[changed], 1.02 * entry.parameters[changed]]
    frame = {"frame": "symmetries"} if "frame" in entry.features else {}
    if "velocity_constraints" in entry.features:  # they make each parameter part of the start
        values = values[:1]
    found = gs.sweep(model, {changed: values, "dt": [entry.dt, entry.dt / 2]},
                     parameters={key: value for key, value in entry.parameters.items()
                                 if key != changed}, scheme="G-L", stages=2, steps=10, **frame)
    step = stepper(name)
    for i, value in enumerate(values):
        for j, dt in enumerate((entry.dt, entry.dt / 2)):
            numbers = entry.parameters | {changed: value}
            begin = step.project(model.q0, model.p0, parameters=numbers)
            one = step.integrate(*begin, steps=10, dt=dt, parameters=numbers)
            bound = 4096 * EPS * (1 + np.abs(one.q).max())
            assert np.abs(found.q.values[i, j] - one.q[-1]).max() <= bound


# ---------------------------------------------------------------- model files, commands


def as_file(name):
    """Return the text of a model file of a case with a Hamiltonian."""
    entry, (q, p) = case(name), start(name, stepper(name))
    system = entry.system

    def quoted(rows):
        return "[" + ", ".join(f'"{e}"' for e in rows) + "]"

    inputs = [str(s) for s in system.inputs]
    rest = {key: value for key, value in entry.parameters.items() if key not in inputs}
    lines = [f'name = "{name}"', "[system]", f"coordinates = {quoted(system.q)}",
             f"momenta = {quoted(system.p)}", f'hamiltonian = "{system.H}"']
    lines += [f"{key} = {quoted(rows)}" for key, rows in (
        ("constraints", system.constraints), ("forces", system.forces),
        ("velocities", system.velocities), ("velocity_constraints", system.velocity_constraints),
    ) if rows]
    lines += [f'{key} = "{one}"' for key in ("time", "time_scale")
              if (one := getattr(system, key)) is not None]
    for table, numbers in (("parameters", rest), ("inputs", {k: entry.parameters[k]
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
    read, own = model.system, entry.system
    plain = {s: sp.Symbol(str(s)) for system in (read, own) for s in (
        *system.q, *system.p, *system.velocities, *system.parameters, *system.inputs,
        *([system.time] if system.time else []))}
    for part in ("H", "constraints", "forces", "velocity_constraints", "time_scale"):
        a, b = (sp.Matrix(np.ravel(getattr(s, part) or 0)).xreplace(plain) for s in (read, own))
        assert (a - b).expand() == sp.zeros(*a.shape), part
    assert [*map(str, read.inputs)] == [*map(str, own.inputs)]
    assert {k: float(v) for k, v in model.parameters.items()} == {
        k: float(v) for k, v in entry.parameters.items()}
    assert [*read.quantities] == [*own.quantities]


@pytest.mark.parametrize("name", ["driven_pendulum", "sleigh"])
def test_run_of_a_model_file_ends_where_a_run_does(name, gyrospark, tmp_path):
    entry, path = case(name), tmp_path / f"{name}.toml"
    path.write_text(as_file(name), encoding="utf-8")
    command = ["run", path, "--scheme", "G-L", "--stages", "2", "--json", "--set", f"t={entry.t0}"]
    calls = [((), {})]
    if entry.system.inputs:
        changed = str(entry.system.inputs[0])
        calls.append((("--set", f"inputs.{changed}=1"), {changed: 1.0}))
    for more, parameters in calls:
        document = gyrospark(*command, *more).document
        end = run(name, stepper(name), 10, parameters=entry.parameters | parameters)
        for key, wanted in (("q", end.q[-1]), ("p", end.p[-1])):
            found = np.array([float(x) for x in document[key]])
            assert np.abs(found - wanted).max() <= 256 * EPS * (1 + np.abs(wanted).max())


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
    """Central differences with Richardson's step, along the tangents of the start."""
    step, entry = differentiable(name), case(name)
    q, p = start(name, step)
    found = step.integrate(gs.Start(q, p, t=entry.t0), steps=5, tangents=gs.Tangents(start="all"),
                           **options(name))
    basis, n = found.tangents.start, step.n
    direction = basis @ np.random.default_rng(1).standard_normal(basis.shape[1])
    along = np.linalg.lstsq(basis, direction, rcond=None)[0]
    wanted = np.concatenate([found.tangents.q[-1], found.tangents.p[-1]]) @ along

    def end(h):
        begin = step.project(q + h * direction[:n], p + h * direction[n:],
                             parameters=entry.parameters, t=entry.t0)
        one = step.integrate(gs.Start(*begin, t=entry.t0), steps=5, **options(name))
        return np.concatenate([one.q[-1], one.p[-1]])

    h = 1e-3 * min(1.0, np.abs(p).max() or 1.0)
    coarse, fine = ((end(x) - end(-x)) / (2 * x) for x in (h, h / 2))
    slope = (4 * fine - coarse) / 3
    assert np.abs(slope - wanted).max() <= 1e-7 * (1 + np.abs(wanted).max())


@pytest.mark.parametrize(("name", "scheme"), [
    ("breathing", "EMS"), ("driven_pendulum", "G-L"), ("sleigh", "G-L")])
def test_a_certificate_holds_with_the_feature(name, scheme):
    """Energy less the work where something does work, and turning back."""
    found = gs.certify(model_of(name), scheme, 2 if scheme == "G-L" else None)
    assert found.holds, found
    assert found.line("reversal").holds
    lines = {line.quantity: line for line in found.lines}
    (energy,) = [line for key, line in lines.items() if "energy" in key][:1]
    assert energy.holds is (True if scheme == "EMS" else None)
    assert ("less work" in energy.quantity) == bool(
        case(name).features & {"time", "forces", "inputs"})
