"""The check of starts agrees with a sum over every single coordinate, for O(n) numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP
from generic_systems import EXAMPLES, stepper_for
from gyrospark.runtime.bindings.binding import Binding
from gyrospark.runtime.integration.call_memory import CallMemory
from gyrospark.runtime.integration.consistency import defects_of_starts
from gyrospark.sweeps.results import BAD_START


def by_each_coordinate(binding, keeps_f, parameters, q, p, dt):
    """Return whether each row is a start: Σₖ |g(q + h eₖ) − g(q)| and so on, a state at a time."""
    def defects(q, p, values):
        return [x[0] for x in binding.defects(values, *(np.ascontiguousarray(x[None])
                                                        for x in (q, p)))]

    def added(q, p, values, dq, dp):
        start, sums = defects(q, p, values), np.zeros((2, binding.m))
        for k in range(binding.n):
            unit = np.eye(binding.n)[k]
            for moved in (defects(q + dq * unit, p, values), defects(q, p + dp * unit, values)):
                sums += [np.abs(new - old) for new, old in zip(moved, start, strict=True)]
        return sums.max(axis=1)

    h, verdicts = 2.0**-10 * binding.epsilon**0.25, []
    for i in range(len(q)):
        values = parameters + i if binding.sets(parameters) > 1 else parameters
        g, f = (np.abs(x).max() for x in defects(q[i], p[i], values))
        g_bound, f_bound = 64 * binding.epsilon / h * added(
            q[i], p[i], values, h * np.linalg.norm(q[i]), h * np.linalg.norm(p[i]))
        if f > f_bound:
            x = binding.guess(values, dt[i], q[i].copy(), p[i].copy(), binding.work())
            n = binding.n
            if keeps_f:  # 64 ε of what forces add to p in a step
                kick = dt[i] * np.abs(x[binding.kicks]).max()
                f_bound = 64 * binding.epsilon / h * added(
                    q[i], p[i], values, h * np.linalg.norm(q[i]),
                    h * (np.linalg.norm(p[i]) + kick))[1]
                verdicts.append(g <= g_bound and f <= f_bound)
                continue
            f_bound += added(q[i], p[i], values, np.abs(x[:n]).max(), np.abs(x[n : 2 * n]).max())[1]
        verdicts.append(g <= g_bound and f <= f_bound)
    return verdicts


SYSTEMS = {
    "top": lambda: (systems.stepper("heavy_top"), PARAMETERS, TOP.q0, TOP.p0),
    "pendulum": lambda: (stepper_for("pendulum", "G-L", 2), *(
        getattr(EXAMPLES["pendulum"], field) for field in ("parameters", "q", "p"))),
}


@settings(max_examples=40)
@given(st.sampled_from(list(SYSTEMS)), st.integers(0, 2**32 - 1), st.booleans(), st.booleans(),
       st.floats(-17, -6), st.integers(1, 4))
def test_starts_are_those_of_the_sum_over_all_coordinates(
    name, seed, keeps_f, varied, size, count
):
    """Rows are off by less and more than round-off; some have parameters of their own."""
    step, parameters, q0, p0 = SYSTEMS[name]()
    rng, binding = np.random.default_rng(seed), step.binding
    rows = []
    for _ in range(count):
        q, p = step.project(np.array(q0) * (1 + 0.1 * rng.standard_normal(step.n)),
                            np.array(p0) * (1 + 0.1 * rng.standard_normal(step.n)),
                            parameters=parameters)
        departure = 10**size * rng.uniform(0, 1, (2, 1)) * rng.standard_normal((2, step.n))
        rows.append((q + departure[0] * np.abs(q).max(), p + departure[1] * np.abs(p).max()))
    q, p = (np.array(x) for x in zip(*rows, strict=True))
    changed = ("I3", "g")
    columns = {key: np.full(count, value) * (rng.uniform(0.9, 1.1, count) if key in changed else 1)
               for key, value in parameters.items()}
    sets = binding.parameter_sets(columns, np.zeros(count)) if varied else binding.parameters(
        {key: float(value) for key, value in parameters.items()}, 0.0)
    dt = rng.uniform(1e-4, 1e-2, count)
    verdicts = defects_of_starts(binding, keeps_f, sets, q, p, dt).consistent
    expected = by_each_coordinate(binding, keeps_f, sets, q, p, dt)
    # A row is checked by itself or, if another one is off, by the exact sum.
    assert verdicts.tolist() == expected
    for i in range(count):  # the first check of a run passes no other rows
        row_set = binding.set_of(sets, i) if varied else sets
        assert not binding.is_consistent(row_set, q[i], p[i]) or expected[i]


def test_what_a_scheme_lets_oscillate_is_allowed_by_few_states(monkeypatch):
    """IMS and EMS allow a momentum constraint that is off by less than an Euler step changes it."""
    step = systems.stepper("heavy_top")
    p = TOP.p0 + 1e-6 * np.abs(TOP.p0).max() * np.array(TOP.q0)
    arguments = (step.binding, False, step.binding.parameters(PARAMETERS, 0.0), TOP.q0[None].copy(),
                 p[None], np.array([1e-3]))
    states = counted(monkeypatch)
    assert defects_of_starts(*arguments).consistent[0]
    assert sum(states) < 12
    assert not defects_of_starts(step.binding, True, *arguments[2:]).consistent[0]


def counted(monkeypatch):
    """Return a list to which each call adds how many states g and f are evaluated at."""
    states, defects = [], Binding.defects
    monkeypatch.setattr(Binding, "defects", lambda self, parameters, q, p, t=None: [
        states.append(len(q)), defects(self, parameters, q, p, t)][1])
    return states


@pytest.mark.parametrize("name", ["heavy_top", "double_top"])
def test_a_good_start_is_checked_without_moves_of_each_coordinate(name, monkeypatch):
    """Compiled code accepts a good start of 4 or 11 coordinates; a bad one needs the moves."""
    case, step = systems.case(name), systems.stepper(name)
    options = {"dt": 1e-3, "steps": 0, "parameters": case.parameters}
    q, p = systems.start(name, step)
    states, step._memory = counted(monkeypatch), CallMemory()
    step.integrate(q, p, **options)
    assert not states
    with pytest.raises(gs.InputError, match="constraints"):
        step.integrate(q * (1 + 1e-6), p, **options)
    assert sum(states) > 2 * step.n


def test_a_run_goes_on_from_its_end_near_rest():
    """A damped pendulum settles: p vanishes, but not the round-off that forces add to it."""
    step = systems.stepper("dragged_pendulum")
    steady = {"k": 1e-9, "c": 15.0, "f": 6.75, "omega": 1e-9}  # it rests aside, atan(f/9)
    q, p = np.array([np.sin(1), -np.cos(1)]), np.zeros(2)
    for _ in range(200):
        run = step.integrate(q, p, dt=0.01, steps=20, parameters=steady)
        q, p = run.q[-1], run.p[-1]
    assert np.abs(p).max() <= 64 * np.finfo(float).eps
    with pytest.raises(gs.InputError, match="constraints"):
        step.integrate(q, p + 1e-12 * q, dt=0.01, steps=1, parameters=steady)


@pytest.mark.parametrize("options", [{}, {"scheme": "splitting", "order": 2}], ids=["G-L", "flows"])
def test_a_bad_momentum_at_rest_is_measured_by_what_forces_add_to_it(options):
    """The bound of |qᵀp| is some 64 ε Δt |V_q| = 1e-17, for compositions of exact flows too."""
    step = systems.stepper("heavy_top", **options)
    step.integrate(TOP.q0, 1e-18 * TOP.q0, dt=1e-3, steps=1, parameters=PARAMETERS)
    bad = 1e-16 * TOP.q0
    with pytest.raises(gs.InputError, match=r"stepper\.project"):
        step.integrate(TOP.q0, bad, dt=1e-3, steps=1, parameters=PARAMETERS)
    starts = (np.array([TOP.q0] * 2), np.array([0 * bad, bad]))
    with pytest.raises(gs.InputError, match="Trajectory 1"):
        step.integrate_ensemble(*starts, dt=1e-3, steps=1, parameters=PARAMETERS)


def test_messages_of_starts_name_their_cause():
    """Single precision is named; a start that cannot be projected has no hint to project it."""
    step = systems.stepper("heavy_top")
    q = np.array(TOP.q0, dtype=np.float32) + np.float32(0.1)
    q /= np.linalg.norm(q)
    with pytest.raises(gs.InputError, match="astype"):
        step.integrate(q, np.zeros(4), dt=1e-3, steps=1, parameters=PARAMETERS)
    with pytest.raises(gs.InputError, match="'rod' vanishes here") as refused:
        systems.stepper("pendulum").integrate([0.0, 0.0], [1.0, 0.5], dt=0.01, steps=1,
                                              parameters=systems.case("pendulum").parameters)
    assert "stepper.project" not in str(refused.value)


def test_a_start_without_an_energy_is_refused():
    """In log(x) at x < 0 motion is real and H is not: runs, ensembles and sweeps refuse it."""
    step, case = systems.stepper("logarithm"), systems.case("logarithm")
    run = {"dt": 0.01, "parameters": case.parameters}
    for _ in range(2):
        with pytest.raises(gs.InputError, match=r"H = nan.*abs"):
            step.integrate([-1.0], [0.0], steps=2, **run)
        step.integrate([1.0], [0.0], steps=2, **run)  # the call that the next one repeats
    with pytest.raises(gs.InputError, match="H = nan"):
        step.start([-1.0], [0.0], **run)
    for steps in (2, 10**12):  # long ones are refused before a step is taken
        with pytest.raises(gs.InputError, match="Trajectory 1: H = nan"):
            step.integrate_ensemble([[1.0], [-1.0]], [[0.0]] * 2, steps=steps, every=steps, **run)
    model = gs.Model(case.system, case.parameters, [1.0], [0.0])
    with pytest.warns(gs.errors.InputWarning, match=f"1 of 2 .*status {BAD_START}"):
        cells = gs.sweep(model, {"start": {"q": [[-1.0], [1.0]], "p": [[0.0]] * 2}}, scheme="G-L",
                         stages=2, dt=0.01, steps=2)
    assert cells.status.values.tolist() == [BAD_START, 0]
