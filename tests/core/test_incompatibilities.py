"""Pairs of features that cannot be combined: each is refused by a call; docs/limits.md has all."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

import gyrospark as gs
import systems
from gyrospark.commands.run import starts
from gyrospark.core.errors import InputError
from gyrospark.core.incompatibilities import FEATURES, PAIRS, refuse_together, table
from gyrospark.generator.pipeline import generate
from gyrospark.generator.schemes.fast_tableau import FastTableau
from gyrospark.generator.schemes.named_schemes import SCHEMES
from gyrospark.generator.spec import Spec
from gyrospark.interop.discrete_flow import DiscreteFlow
from gyrospark.runtime.devices.ensemble import refuse_on_device
from gyrospark.runtime.events.impact_observer import refuse_unusable
from gyrospark.runtime.results.joint_motion import cotangents_of_multipliers
from processes import ROOT

LIMITS = ROOT / "docs" / "limits.md"
SPEC = Spec.from_arguments("G-L", 2)


def derived(spec=SPEC, name=None, **options):
    """Return a call of the generator for a system of the catalogue."""
    system_argument = {} if name is None else {"system": systems.case(name).system}
    return lambda: generate(spec, **system_argument, **options)


def integrated(name, scheme="G-L", stages=None, **options):
    """Return a run of a system of the catalogue."""
    def call():
        step, case = systems.stepper(name, scheme, stages), systems.case(name)
        first = {"dt": case.dt, "steps": 3, "parameters": case.parameters} | options
        return step.integrate(gs.Start(*systems.start(name, step), t=case.t0), **first)
    return call


def gradient(name, memory="256 MB", **options):
    """Return the gradient of a run."""
    def call():
        run = integrated(name, **options)()
        return run.gradient({"q": np.ones(run.q.shape[1])}, memory=memory)
    return call


def many(name, **options):
    """Return an ensemble of two runs."""
    def call():
        step, case = systems.stepper(name), systems.case(name)
        q, p = (np.repeat(x[None], 2, axis=0) for x in systems.start(name, step))
        return step.integrate_ensemble(q, p, dt=case.dt, steps=2, parameters=case.parameters,
                                       **options)
    return call


def split(**options):
    """Return a run of the top by exact flows."""
    top = gs.problems.fast_top()
    return lambda: gs.stepper("splitting", order=4).integrate(
        top.q0, top.p0, dt=1e-3, steps=2, parameters=top.parameters | {"gamma": 1.0}, **options)


def swept(real="double", **options):
    """Return a sweep of tops."""
    return lambda: gs.sweep("fast-top", {"gamma": [1e-3, 2e-3]}, scheme="G-L", stages=2,
                            real=real, dt=1e-3, steps=2, **options)


def on_card(solver="auto", n=4, real="double", frame=(), rows=0, energy=False, reason=None,
            clocked=False, **asked):
    """Return the question whether a card has such a stepper and such arguments."""
    stepper = SimpleNamespace(
        name="stepper", n=n, symmetries=frame, binding=SimpleNamespace(
            rows=rows, solves=True, clocked=clocked),
        manifest=SimpleNamespace(
            real=real, scheme=SimpleNamespace(exact_energy=energy),
            fast_path=SimpleNamespace(available=reason is None, reason=reason)))
    return lambda: refuse_on_device(stepper, solver, **asked)


def without_iteration():
    """Derive a profile whose tableau has a weight of 0."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FastTableau, "refusal", "a weight b_i is zero")
        generate(SPEC.with_profile("run"))


def recorded():
    """Set a parameter of a simulation that records."""
    case, step = systems.case("kepler"), systems.stepper("kepler")
    sim = step.start(case.q, case.p, dt=case.dt, parameters=case.parameters, record=True)
    sim.parameters = {"k": 2.0}


def turned():
    """Differentiate multipliers in a frame that turns a plane and with it a wall, x = 0."""
    step = systems.differentiable("heavy_top_in_frame")
    binding = type(step._derivative_binding())
    original = binding.constraint_derivatives

    def with_wall(*state):
        derivatives = original(*state)
        return derivatives._replace(g=np.eye(*derivatives.g.shape))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(binding, "constraint_derivatives", with_wall)
        systems.run("heavy_top_in_frame", step, 3, tangents=gs.Tangents(multipliers=True))


def stored(name="kepler", **options):
    """Return a call that stores a run; it is refused before there is a store."""
    return lambda: integrated(name, out="never.zarr", **options)()


def scaled(call):
    """Return a call with a stepper in scaled time, a start and a run of it."""
    def with_stepper():
        step, entry = systems.stepper("eccentric"), systems.case("eccentric")
        start = gs.Start(entry.q, entry.p, entry.parameters)
        return call(step, start, step.integrate(start, steps=3, dtau=0.1))
    return with_stepper


def scaled_model():
    """Return a model whose system is in scaled time."""
    entry = systems.case("eccentric")
    return gs.Model(entry.system, entry.parameters, entry.q, entry.p)


def from_command():
    """Start the run of a model file whose system is in scaled time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gyrospark.api.model_stepper",
                      lambda spec, **given: (systems.stepper("eccentric"), None))
        starts.stepper_and_start("model.toml", (), dict.fromkeys(
            ("scheme", "stages", "rep", "tableau", "real")))


def watched():
    """Build an artefact of a model with an event."""
    entry = systems.case("kepler")
    model = gs.Model(entry.system, entry.parameters, entry.q, entry.p, events=gs.Event("x"),
                     dt=entry.dt)
    gs.build("cpp", model, scheme="G-L", stages=2, out="never")


def hit(name, *pair, **options):
    """Integrate a system of the catalogue with an impact of its first coordinate."""
    def call():
        step = systems.stepper(name)
        events = [gs.Impact(step.manifest.system.coordinates[0]), *pair]
        integrated(name, events=events, **options)()
    return call


def with_impact():
    """Return the run of a ball that falls on a floor."""
    return systems.run("ball", systems.stepper("ball"), 6, dt=0.1, events=gs.Impact("floor"))


def unhit(n=2, real="double", energy=False):
    """Refuse impacts of a stepper that costs much to compile."""
    stepper = SimpleNamespace(symmetries=(), binding=SimpleNamespace(
        n=n, solves=True, clocked=False, rows=0), manifest=SimpleNamespace(
            real=real, system=None, scheme=SimpleNamespace(exact_energy=energy)))
    return lambda: refuse_unusable(stepper, None, ())


CHANGING = {"push": [0.1, 0.2, 0.3], "pull": 0.1}
TERMINAL = gs.Event("q1", terminal=True)
#: Pair → a call that has both.
CALLS = {
    ("splitting", "frame"): derived(
        Spec.from_arguments("splitting", order=2).with_frame("symmetries")),
    ("splitting", "solver"): split(solver=gs.Solver(tolerance=1e-9)),
    ("profile", "frame"): derived(SPEC.with_profile("run").with_frame("symmetries")),
    ("profile", "lagrangian"): derived(SPEC.with_profile("run"), "heavy_bob"),
    ("profile", "large"): lambda: generate(
        SPEC.with_profile("control"), system=gs.models.chain(5).system),
    ("profile", "time"): derived(SPEC.with_profile("control"), "breathing"),
    ("profile", "newton_only"): without_iteration,
    ("control", "long_numbers"): derived(
        Spec.from_arguments("G-L", 2, real="long-double").with_profile("control")),
    ("energy", "frame"): derived(SPEC.with_energy(True).with_frame("symmetries")),
    ("energy", "profile"): derived(SPEC.with_energy(True).with_profile("run")),
    ("energy", "derivatives"): derived(SPEC.with_energy(True), derivatives=True),
    ("other_scheme", "velocity_constraints"): derived(Spec.from_arguments("EMS"), "sleigh"),
    ("profile", "velocity_constraints"): derived(SPEC.with_profile("run"), "sleigh"),
    ("frame", "velocity_constraints"): derived(SPEC.with_frame("symmetries"), "sleigh"),
    ("energy", "velocity_constraints"): derived(SPEC.with_energy(True), "sleigh"),
    ("derivatives", "velocity_constraints"): derived(SPEC, "sleigh", derivatives=True),
    ("structured", "velocity_constraints"): derived(SPEC, "sleigh", structured=True),
    ("frame", "time"): derived(SPEC.with_frame("symmetries"), "breathing"),
    ("frame", "lagrangian"): derived(SPEC.with_frame("symmetries"), "heavy_bob"),
    ("second", "lagrangian"): derived(SPEC, "heavy_bob", second=True),
    ("second", "frame"): derived(SPEC.with_frame("symmetries"), second=True),
    ("second", "large"): lambda: generate(
        SPEC, system=gs.models.chain(5).system, second=True),
    ("derivatives", "tolerance"): gradient("kepler", solver=gs.Solver("newton", tolerance=1e-6)),
    ("reversed", "inputs"): gradient("pushed_pendulum", "none", inputs=CHANGING),
    ("reversed", "frame"): gradient("heavy_top_in_frame", "none"),
    ("multiplier_derivatives", "turning_frame"): turned,
    ("splitting", "scaled"): derived(Spec.from_arguments("splitting", order=2), "scaled_pendulum"),
    ("frame", "scaled"): derived(SPEC.with_frame("symmetries"), "scaled_pendulum"),
    ("profile", "scaled"): derived(SPEC.with_profile("run"), "scaled_pendulum"),
    ("scaled", "velocity_constraints"): lambda: systems.case("sleigh").system.with_time_scale(2),
    ("scaled", "inputs"): lambda: systems.case("pushed_pendulum").system.with_time_scale(2),
    ("scaled", "lagrangian"): lambda: systems.case("heavy_bob").system.with_time_scale(2),
    ("second", "scaled"): scaled(lambda step, start, run: run.hessian({"q": np.ones(2)})),
    ("accelerations", "scaled"): scaled(lambda step, start, run: step.accelerations(start)),
    ("joint_gradients", "scaled"): scaled(
        lambda step, start, run: cotangents_of_multipliers(run, np.ones((len(run), 1)))),
    ("interop", "scaled"): scaled(lambda step, start, run: DiscreteFlow(step, 3)),
    ("command", "scaled"): from_command,
    ("rules", "scaled"): scaled(lambda step, start, run: gs.tune(
        step, start, dtau=0.1, t_end=1.0, step_error=1e-3, gamma="m")),
    ("sweep", "open_end"): lambda: gs.sweep(
        scaled_model(), {"k": [1.0, 2.0]}, scheme="G-L", stages=2, dtau=0.05, t_end=1.0),
    ("stored", "open_end"): scaled(lambda step, start, run: step.integrate(
        start, dtau=0.05, t_end=1.0, out="never.zarr")),
    ("stored", "t_eval"): stored(t_eval=[0.05]),
    ("stored", "tangents"): stored(tangents=gs.Tangents()),
    ("stored", "changing_inputs"): stored("pushed_pendulum", inputs=CHANGING),
    ("recording", "new_parameters"): recorded,
    ("ensemble", "terminal"): many("kepler", events=gs.Event("x", terminal=True)),
    ("sweep", "terminal"): swept(events=[TERMINAL]),
    ("sweep", "float128"): swept("float128"),
    ("impacts", "other_runs"): swept(events=gs.Impact("q1")),
    ("impacts", "events"): hit("kepler", gs.Event("x")),
    ("impacts", "second"): lambda: with_impact().hessian({"q": np.ones((7, 1))}),
    ("impacts", "tangents"): many("kepler", events=gs.Impact("x"), tangents=gs.Tangents()),
    ("reversed", "impacts"): lambda: with_impact().gradient(
        {"q": np.ones((7, 1))}, memory="none"),
    ("impacts", "splitting"): split(events=gs.Impact("q1")),
    ("impacts", "frame"): hit("heavy_top_in_frame"),
    ("impacts", "energy"): unhit(energy=True),
    ("impacts", "scaled"): scaled(lambda step, start, run: step.integrate(
        start, dtau=0.1, steps=2, events=gs.Impact("x"))),
    ("impacts", "velocity_constraints"): hit("sleigh"),
    ("impacts", "large"): unhit(n=29),
    ("impacts", "float128"): unhit(real="float128"),
    ("artefact", "events"): watched,
    ("fmu", "not_double"): lambda: gs.build(
        "fmu2", "fast-top", scheme="IMS", dt=0.01, out="never.fmu", real="float"),
    ("fixed_point", "newton_only"): integrated("sleigh", solver="fixed-point"),
    ("cuda", "events"): on_card(events=[TERMINAL]),
    ("cuda", "inputs"): on_card(inputs={"push": 1.0}),
    ("cuda", "tangents"): on_card(tangents=gs.Tangents()),
    ("cuda", "workers"): on_card(workers=2),
    ("cluster", "workers"): swept(workers=2, dask="tcp://127.0.0.1:1"),
    ("cuda", "newton"): on_card("newton"),
    ("cuda", "long_numbers"): on_card(real="float128"),
    ("cuda", "large"): on_card(n=29),
    ("cuda", "frame"): on_card(frame=[1]),
    ("cuda", "scaled"): on_card(clocked=True),
    ("cuda", "velocity_constraints"): on_card(rows=1),
    ("cuda", "energy"): on_card(energy=True),
    ("cuda", "newton_only"): on_card(reason="a weight b_i is zero"),
}
@pytest.mark.parametrize("pair", CALLS, ids="-".join)
def test_a_call_with_both_is_refused(pair, tmp_path, monkeypatch):
    """The refusal is the sentence of the pair, before a file is written."""
    monkeypatch.chdir(tmp_path)
    assert_refused(pair, CALLS[pair])
    assert not [*tmp_path.iterdir()]


def assert_refused(pair, call):
    (of_table,) = (entry for entry in PAIRS if (entry.first, entry.second) == pair)
    with pytest.raises(InputError) as error:
        call()
    assert str(error.value).endswith(f"{of_table.reason}; {of_table.cure}.")


def test_every_pair_has_a_call():
    assert {*CALLS} == {(pair.first, pair.second) for pair in PAIRS}
    assert len({(pair.first, pair.second) for pair in PAIRS}) == len(PAIRS)
    assert {*FEATURES} == {name for pair in PAIRS for name in (pair.first, pair.second)}


@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: f"{pair.first}-{pair.second}")
def test_one_of_two_is_accepted(pair):
    refuse_together(**{pair.first: "it", pair.second: False})
    refuse_together(**{pair.first: "", pair.second: "it"})
    with pytest.raises(InputError, match=r"^One .* two: "):
        refuse_together(**{pair.first: "one", pair.second: "two"})


def test_schemes_without_velocity_constraints_are_those_of_the_table():
    without = [name for name, scheme in SCHEMES.items() if not scheme.velocity_constraints]
    assert re.findall(r"[\w-]+", FEATURES["other_scheme"].partition(";")[0])[1:] == without
    (pair,) = (entry for entry in PAIRS if entry.first == "other_scheme")
    assert pair.cure == "choose " + " or ".join(name for name in SCHEMES if name not in without)


def test_the_page_of_limits_has_the_table(request):
    """``pytest tests/core/test_incompatibilities.py --update`` writes it again."""
    text = LIMITS.read_text(encoding="utf-8")
    updated, count = re.subn(r"\| feature \| cannot be combined.*?\n\n", lambda _: f"{table()}\n",
                             text, flags=re.DOTALL)
    assert count == 1
    if request.config.getoption("--update"):
        LIMITS.write_text(updated, encoding="utf-8")
    assert LIMITS.read_text(encoding="utf-8") == updated
