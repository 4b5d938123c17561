"""Calls around steps: memory that is used again, batches of one call, arrays computed late."""

from __future__ import annotations

import pickle
import warnings
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
import systems
from calls import PARAMETERS, RUN, TOP, by_names, equal
from gyrospark.core.exact_numbers import as_double
from gyrospark.core.manifest import BodyManifest, SystemManifest
from gyrospark.runtime.compilation.body_columns import BodyAt
from gyrospark.runtime.integration import lanes, run_arguments
from gyrospark.runtime.integration.call_memory import CallMemory
from gyrospark.runtime.results.rotation_rate import Rotations

ARRAYS = ("q", "p", "multipliers", "iterations")
RNG = np.random.default_rng(5)


# ---------------------------------------------------------------- repeated calls


@pytest.mark.parametrize("every", [1, 200])
def test_a_repeated_run_of_short_time_is_one_call_of_compiled_code(every) -> None:
    """The repeated run has the bits of the run in chunks."""
    step = systems.stepper("heavy_top", "G-L", 2)
    arguments = {"dt": 1e-3, "steps": 200, "every": every, "parameters": TOP.parameters}
    runs, calls, integrate = [], [], step.binding.integrate
    step.binding.integrate = lambda *a: (calls.append(a), integrate(*a))[1]
    try:
        for _ in range(3):
            runs.append(step.integrate(TOP.q0, TOP.p0, **arguments))
            calls.append(None)
    finally:
        del step.binding.integrate
    assert [*map(bool, calls[-3:])] == [True, False, False]  # the last run made none
    for run in runs[1:]:
        assert equal(run, runs[0])
        assert run.report == runs[0].report


def test_recalled_parameters_are_those_of_the_call(gl3) -> None:
    """Parameters are checked again if their dict changed, or if numbers only compare equal."""
    def start(parameters: object) -> dict[str, float]:
        return gl3.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1, parameters=parameters).parameters

    numbers = dict(TOP.parameters)
    first = start(numbers)
    first["gamma"] = -1.0  # the caller's own
    assert start(numbers)["gamma"] == start(dict(reversed(numbers.items())))["gamma"] > 0
    numbers["gamma"] = 2.0
    assert start(numbers)["gamma"] == 2.0
    for wrong in (True, np.array([2.0]), "x"):
        with pytest.raises(gs.InputError, match="gamma"):
            start({**numbers, "gamma": wrong})
    with pytest.raises(gs.InputError, match="delta"):
        start({**numbers, "delta": 1.0})


def test_a_recalled_call_gives_what_a_first_call_gives(gl3) -> None:
    """Each call follows a usual one, is repeated, and is repeated without memory of it."""
    def outcome(*start, **changes):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                run = gl3.integrate(*start, **{"dt": 1e-3, "steps": 1} | changes)
            except gs.errors.GyrosparkError as error:
                return type(error), str(error)
        return (run.t.tobytes(), run.q.tobytes(), run.p.tobytes(), run.parameters, run.report,
                [*run.events], [str(x.message) for x in caught])

    numbers = {**TOP.parameters}
    usual = TOP.start
    heavier = usual.replace(parameters={**numbers, "mgl": 0.5})
    faster, busy = usual.replace(p=30 * TOP.p0), usual.replace()
    busy._events = (gs.Event("q0"),)
    tuned = usual.replace()
    tuned._rules = {"gamma": "h"}
    for start, parameters in (((TOP.q0, TOP.p0), numbers), ((usual,), None), ((usual,), numbers)):
        states = [start, (usual,), (TOP.q0, TOP.p0), (TOP.q0, 30 * TOP.p0), (1.01 * TOP.q0, TOP.p0),
                  (TOP.q0, TOP.p0 * np.nan), (TOP.q0[:3], TOP.p0), (-TOP.q0, -TOP.p0),
                  (TOP, TOP.p0), (heavier,), (faster,), (busy,), (tuned,),
                  (usual.replace(t=2.0),), (usual.replace(q=1.01 * TOP.q0),),
                  (gs.Start(TOP.q0, TOP.p0, numbers),)]
        calls = [(x, {"parameters": parameters}) for x in states]
        calls += [(start, {"parameters": parameters} | changes) for changes in (
            {"dt": -1e-3}, {"dt": True}, {"dt": None}, {"steps": 1.0}, {"steps": True},
            {"steps": None, "t_end": 2e-3}, {"every": 0}, {"solver": "newton"}, {"solver": "x"},
            {"inputs": {"u": 1.0}}, {"events": [gs.Event("q0")]}, {"dtau": 1.0})]
        calls += [(start, {"parameters": numbers | changes}) for changes in (
            {"gamma": -1.0}, {"gamma": 1}, {"I1": 9.0}, {"mgl": np.array([0.4])}, {"delta": 1.0})]
        gl3._memory = CallMemory()
        first = outcome(*start, parameters=parameters)
        for state, arguments in calls:
            assert outcome(*start, parameters=parameters) == first
            assert gl3._memory._last is not None
            second, third = (outcome(*state, **arguments) for _ in range(2))
            gl3._memory = CallMemory()
            assert second == third == outcome(*state, **arguments), (state, arguments)
    outcome(*start, parameters=numbers)
    numbers["mgl"] = 0.5
    assert outcome(*start, parameters=numbers)[3]["mgl"] == 0.5


def test_a_solver_with_the_fields_of_the_last_one_recalls_its_call(gl3) -> None:
    def memory(*fields):
        gl3.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1, parameters=TOP.parameters,
                      solver=gs.Solver(*fields))
        return gl3._memory._last

    first = memory("auto", 1e-12, 20)
    assert memory("auto", 1e-12, 20) is first
    for fields in (("newton", 1e-12, 20), ("auto", 1e-9, 20), ("auto", 1e-12, 21), ("auto",)):
        assert memory(*fields).plan.run.tolerance == (fields[1] if fields[1:] else None)
        assert memory("auto", 1e-12, 20) is not first


def test_what_a_start_says_of_its_run_is_its_own(gl3) -> None:
    """A start has its step and number of steps, and a γ that is searched for at its state."""
    for steps in (3, 2):
        begin = TOP.start.replace()
        begin._span = 1e-3, steps
        assert len(gl3.integrate(begin)) == steps + 1
    slow, fast = TOP.start.replace(), TOP.start.replace(p=2 * TOP.p0)
    slow._rules = fast._rules = {"gamma": "auto"}
    weights = [gl3.integrate(x, dt=1e-3, steps=2).parameters["gamma"] for x in (slow, fast)]
    gl3._memory = CallMemory()
    assert weights[1] == gl3.integrate(fast, dt=1e-3, steps=2).parameters["gamma"] != weights[0]


def test_impacts_are_of_the_start_that_has_them() -> None:
    step = systems.stepper("ball")
    plain = gs.Start(*systems.start("ball", step), systems.case("ball").parameters)
    bouncing = plain.replace()
    bouncing._events = (gs.Impact("floor"),)
    runs = [step.integrate(start, dt=0.1, steps=6) for start in (bouncing, plain)]
    assert [len(run.impacts) for run in runs] == [1, 0]


@pytest.mark.parametrize("name", ["driven_oscillator", "bead", "heavy_top_in_frame", "pendulum",
                                  "eccentric"])
def test_repeated_calls_of_other_systems_give_what_first_calls_give(name) -> None:
    """Systems have a driven force, velocities, a frame; calls have other times and states."""
    step, entry = systems.stepper(name), systems.case(name)
    begin, options = systems.timed_start(name, step), entry.step | {"parameters": entry.parameters}
    later = step.integrate(begin, steps=1, **options)[-1]
    starts = [begin, begin.replace(t=begin.t + 2 * entry.dt), begin.replace(q=later.q, p=later.p)]

    def outcome(span, start, memory=None):
        step._memory = memory or step._memory
        if span:
            run = step.integrate(start, **span, **options)
        else:
            sim = step.start(start, record=True, **options)
            sim.advance(1)
            run = sim.trajectory
        return run.t.tobytes(), run.q.tobytes(), run.p.tobytes(), run.report

    # one span after the other: a call is recalled for the next start alone
    calls = [(span, start) for span in ({"steps": 1}, {"t_end": begin.t + 4 * entry.dt}, {})
             for start in starts]
    fresh = [outcome(*call, CallMemory()) for call in calls]
    assert len({repr(result) for result in fresh}) == 2 * len(starts)
    for call, expected in zip(calls * 2, fresh * 2, strict=True):
        assert outcome(*call) == outcome(*call) == expected, call


def test_parameters_of_a_loop_of_calls_are_checked_once(gl3, monkeypatch) -> None:
    """Later calls with these parameters, from a start on the constraints, are compiled code."""
    evaluated, as_parameters = [], run_arguments.as_parameters
    monkeypatch.setattr(run_arguments, "as_parameters", lambda *x: (
        evaluated.append(x), as_parameters(*x))[1])
    changes = {"mgl": 0.375}  # a number that no other test gives
    for _ in range(2):
        gl3.integrate(TOP, dt=1e-3, steps=1, parameters=changes)
    assert len(evaluated) == 1
    for q, p in ((TOP.q0 * 1.01, TOP.p0), (TOP.q0, TOP.p0 + TOP.q0)):
        with pytest.raises(gs.InputError, match="constraints"):
            gl3.integrate(q, p, dt=1e-3, steps=1, parameters=TOP.parameters | changes)


def test_a_late_report_is_of_its_own_run(gl3) -> None:
    """A trajectory, read later, is as it was when its call returned."""
    runs = [gl3.integrate(TOP.q0, TOP.p0, steps=k, **RUN) for k in (1, 3)]
    sim = gl3.start(TOP.q0, TOP.p0, record=True, **RUN)
    sim.advance(3)
    early = sim.trajectory
    sim.advance(5)
    assert [run.report.steps for run in runs] == [1, 3]
    assert early.report == runs[1].report == pickle.loads(pickle.dumps(runs[1])).report
    assert equal(early, runs[1])


def test_a_member_outlives_its_ensemble(gl3) -> None:
    """A member has a record of its own: the memory of an ensemble's records is used for others."""
    def run():
        return gl3.integrate_ensemble(TOP.q0[None], TOP.p0[None], dt=1e-3, steps=3,
                                      parameters=PARAMETERS)

    members = [run().members[0] for _ in range(20)]
    ensemble = run()
    assert all(member.report == ensemble.members[0].report for member in members)
    assert all(equal(member, ensemble.members[0]) for member in members)


# ---------------------------------------------------------------- memory


@pytest.mark.parametrize("solver", ["auto", "newton"])
def test_memory_needs_no_initialisation(solver, step) -> None:
    """Whatever the memory holds, a run and a batch of runs have the same bits."""
    def runs():
        run = step.integrate(TOP.q0, TOP.p0, steps=20, solver=solver, **RUN)
        ensemble = step.integrate_ensemble([TOP.q0] * 3, [TOP.p0] * 3, steps=20, solver=solver,
                                           **RUN)
        return run, ensemble

    expected = runs()
    assert step.binding.works._free
    assert solver == "newton" or step._binding_of_many.batches._free
    for byte in (0x00, 0x7F, 0xFF):
        for pool in (step.binding.works, step.binding.batches, step._binding_of_many.batches):
            for memory in pool._free:
                for struct in memory if isinstance(memory, tuple) else [memory]:
                    step.binding.image(struct)[:] = byte
        again = runs()
        assert equal(again[0], expected[0])
        assert again[0].report == expected[0].report
        assert all(np.array_equal(getattr(again[1], x), getattr(expected[1], x)) for x in ARRAYS)


def test_a_run_within_a_run_has_memory_of_its_own(gl3) -> None:
    """A run in a callback changes nothing of the run around it."""
    inner = []

    def progress(done: int) -> None:
        inner.append(gl3.integrate(TOP.p0 / np.linalg.norm(TOP.p0), 0 * TOP.p0, steps=3, **RUN))

    run = gl3.integrate(TOP.q0, TOP.p0, steps=100, progress=progress, **RUN)
    assert len(inner) > 1
    assert equal(run, gl3.integrate(TOP.q0, TOP.p0, steps=100, **RUN))


# ---------------------------------------------------------------- batches


def of_tops(step):
    """Return arguments of tops with their own moments, γ and time steps, along one motion."""
    run = step.integrate(TOP.q0, TOP.p0, steps=60, **RUN)
    columns = {"mgl": RNG.uniform(0.3, 0.5, 61), "gamma": RNG.uniform(0.9, 1.1, 61)}
    return {"q": run.q, "p": run.p, "dt": RNG.uniform(5e-4, 2e-3, 61),
            "parameters": PARAMETERS | columns}


def of_pushed(step):
    """Return arguments of pendulums, each pushed in its own way in each step."""
    angles = RNG.uniform(-1, 1, 61)
    q = np.column_stack([np.sin(angles), -np.cos(angles)])
    return {"q": q, "p": 0 * q, "dt": 0.01, "parameters": {"k": 1.0},
            "inputs": RNG.uniform(-1, 1, (61, 6, 2))}


@pytest.mark.parametrize(("make", "arguments"), [
    (lambda: gs.stepper("G-L", 3), of_tops),
    pytest.param(lambda: systems.stepper("heavy_top_in_frame"), of_tops, marks=pytest.mark.slow),
    (lambda: gs.stepper("splitting", order=4), of_tops),
    (lambda: systems.stepper("pushed_pendulum"), of_pushed)],
    ids=["tops", "frames", "flows", "inputs"])
def test_many_batches_in_one_call_have_the_bits_of_single_ones(make, arguments, monkeypatch):
    step = make()
    options = arguments(step)
    options["parameters"] = options["parameters"] | {
        symmetry.name: RNG.uniform(1, 2, 61) for symmetry in step.symmetries
        if not symmetry.condition}
    binding = type(step._binding_of_many)
    called = binding.integrate_lanes
    for every in (1, 3, 4):
        sizes, ensembles = [], []

        def counted(self, constants, *values, counts=sizes, **named_values):
            counts.append(len(constants.dt))
            return called(self, constants, *values, **named_values)

        monkeypatch.setattr(binding, "integrate_lanes", counted)
        for together in (16, 1):
            monkeypatch.setattr(lanes, "_TOGETHER", together)
            ensembles.append(by_names(
                step.integrate_ensemble, steps=6, every=every, **options))
        size = step.binding.lanes
        assert [sizes[0], sizes[-1]] == [size if every == 4 else 61, 61 % size]
        for name in ARRAYS:
            assert np.array_equal(getattr(ensembles[0], name), getattr(ensembles[1], name))
        assert [x.report for x in ensembles[0].members] == [x.report for x in ensembles[1].members]


def test_a_trajectory_that_fails_is_found_within_many_batches(gl3) -> None:
    """One trajectory turns too far in its only step."""
    dt = np.full(60, 1e-3)
    dt[45] = 0.5
    with pytest.warns(gs.errors.InputWarning, match="rotation"):
        ensemble = gl3.integrate_ensemble([TOP.q0] * 60, [TOP.p0] * 60, dt=dt, steps=1,
                                          parameters=PARAMETERS,
                                          solver=gs.Solver("auto", max_iterations=10))
    assert list(ensemble.failures) == [45]
    assert np.isnan(ensemble.q[45, 1]).all()
    assert np.isfinite(np.delete(ensemble.q, 45, axis=0)).all()


# ---------------------------------------------------------------- arrays made late


def test_arrays_are_computed_when_asked_for_and_kept(gl3) -> None:
    run = gl3.integrate(TOP.q0, TOP.p0, steps=5, **RUN)
    assert "energies" not in vars(run)
    assert run.energies is run.energies
    assert np.array_equal(run.energies, gl3.energy(run.q, run.p, parameters=PARAMETERS))
    with pytest.raises(AttributeError, match="no attribute 'energys'"):
        run.energys  # noqa: B018


def test_arrays_and_parameters_that_are_changed_change_no_other_one(gl3) -> None:
    """A pickle has all arrays and parameters."""
    run, reference = (gl3.integrate(TOP.q0, TOP.p0, steps=5, **RUN) for _ in range(2))
    read = pickle.loads(pickle.dumps(run))
    for array in (run.t, run.q, run.p, run.multipliers, run.iterations, run.work):
        array[...] = 3
    run.parameters["mgl"] = 1e3
    assert np.array_equal(run.energies, reference.energies)
    assert np.array_equal(run.g_errors, reference.g_errors)
    assert read._states is None
    assert equal(read, reference)


# ---------------------------------------------------------------- checks of many at once

NUMBERS = st.one_of(
    st.floats(), st.integers(-2, 2), st.booleans(), st.none(), st.text("a1. é", max_size=2),
    st.fractions(), st.floats().map(np.float64), st.floats(width=32).map(np.float32),
    st.sampled_from([0.0, -0.0, 1.0, 5e-324, 1 + 0j, np.array(1.0), [1.0]]))
DOMAINS = {"mass": "positive", "shift": "real", "ratio": "nonzero"}


@settings(max_examples=60)
@given(st.fixed_dictionaries(dict.fromkeys(DOMAINS, NUMBERS)))
def test_parameters_that_pass_at_once_pass_one_by_one(parameters) -> None:
    plain = run_arguments._as_plain_parameters(parameters, DOMAINS, as_double)
    single = {name: run_arguments._as_parameter(name, domain, parameters, as_double)
              for name, domain in DOMAINS.items()} if plain else None
    assert repr(plain) == repr(single)
    assert not plain or {*map(type, plain.values())} == {float}


def test_the_fastest_of_many_bodies_is_the_fastest_of_each() -> None:
    """Bodies have moments or tensors; some of them are at rest or not finite."""
    bodies, parameters = {}, {}
    for i in range(40):
        names = [f"b{i}_{k}" for k in (("I1", "I2", "I3") if i % 3 else (
            "K11", "K12", "K13", "K22", "K23", "K33"))]
        parameters |= dict(zip(names, RNG.uniform(0.5, 2, len(names)), strict=True))
        bodies[f"b{i}"] = BodyManifest(
            q=tuple(f"q{k}" for k in range(4 * i, 4 * i + 4)),
            **{"inertia" if i % 3 else "inverse_inertia": (*names,)})
    q, p = (tuple(f"{x}{k}" for k in range(160)) for x in "qp")
    system = SystemManifest(
        name="bodies", coordinates=q, momenta=p, parameters=dict.fromkeys(parameters, "real"),
        hamiltonian="0", constraints=(), hidden=(), start_parameters=(), rigid_body=False,
        bodies=bodies)
    rotations = Rotations(SimpleNamespace(
        system=system, frame=None, scheme=SimpleNamespace(order=6, longest_flow=None)))
    assert all(isinstance(x, BodyAt) for x in rotations.bodies.values())
    for factor in (1.0, 1e160, np.inf):
        q, p = RNG.standard_normal((2, 1, 160))
        p[0, 100:120] *= factor
        with np.errstate(invalid="ignore"):
            fastest = rotations.fastest(parameters, 0.1, q, p)
            rows = rotations.fastest(parameters, 0.1, np.repeat(q, 2, 0), np.repeat(p, 2, 0))
        assert (fastest.body, fastest.limit) == (rows.body, rows.limit)
        assert fastest.radians == pytest.approx(rows.radians, rel=1e-14)
