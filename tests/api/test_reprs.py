"""Objects at a prompt: a line or two with the name, no address."""

from __future__ import annotations

import copy
import inspect
import json
import pickle
import re

import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import PARAMETERS, RUN, TOP
from gyrospark.certificates.verification import verify_stepper
from gyrospark.generator.spec import Spec
from gyrospark.generator.systems.system_digest import system_digest
from gyrospark.runtime.devices.ensemble import DeviceEnsemble
from gyrospark.runtime.steppers.run_defaults import RunDefaults
from processes import python
from result_classes import RESULT_CLASSES, result_class
from stores import record


def built():
    build = gs.Multibody("arm")
    a, b = (build.body(name, mass=1, inertia=(1, 1, 1)) for name in "ab")
    build.fixed_point("shoulder", a, on_body=(0, 0, 0.5), at=(0, 0, 0))
    return [build, a, build.ground, build.ball("elbow", a, b, on_a=(0, 0, -0.5), on_b=(0, 0, 0.5)),
            build.revolute("knee", a, b, axis=(1, 0, 0), on_a=(0, 0, 1), on_b=(0, 0, 1)),
            build.rod("rod", a, b, on_a=(0, 0, 1), on_b=(0, 0, 1)),
            build.spring("spring", a, build.ground, on_a=(0, 0, 1), on_b=(0, 0, 1), stiffness=3.0),
            gs.Multibody("rods").beam("mast", count=2, mass=1.0, bending=1.0, twisting=1.0,
                                      start=(0, 0, 0), end=(0, 0, 1)).last]


def small_system():
    x, u, k = sp.symbols("x u k", real=True)
    return gs.System([x], [u], [k], u**2 / 2 + k * x**2, name="small", forces=[-u],
                     quantities={"size": x**2})


def fallen():
    """Return a run with an impact of a ball on a floor."""
    return systems.run("ball", systems.stepper("ball"), 6, dt=0.1, events=gs.Impact("floor"))


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """Objects of every public class, and of those that their attributes and calls return."""
    step = systems.stepper("heavy_top")
    run = step.integrate(TOP.q0, TOP.p0, steps=300, **RUN)
    model, tableau = systems.case("double_top").system, gs.tableau("G-L", stages=3)
    tuned = gs.tune(step, TOP, dt=1e-3, gamma="auto", steps=20)
    certificate = gs.certify(TOP, "EMS", dt=1e-3, steps=20)
    dip = gs.Event("q1", level=0.2)
    section = gs.section(step, [TOP.q0] * 2, [TOP.p0] * 2, event=dip, steps=300, **RUN)
    tops = systems.run("double_top", systems.stepper("double_top"), 3)
    swung = step.integrate(TOP.q0, TOP.p0, steps=300, events=dip, **RUN)
    many = step.integrate_ensemble([TOP.q0] * 30, [TOP.p0] * 30, steps=100, **RUN)
    moved = step.integrate(TOP.q0, TOP.p0, steps=3, tangents=gs.Tangents(), **RUN)
    out = tmp_path_factory.mktemp("reprs") / "run.zarr"
    return [
        *systems.stepper("heavy_top_in_frame").symmetries,
        step, step.start(TOP.q0, TOP.p0, **RUN), TOP, RunDefaults.of_problem(TOP), run, run.report,
        many, DeviceEnsemble(many.t, many.q, many.p, many.iterations, many.t, {}, "top"),
        tableau, tableau.stages, tableau.numeric(digits=50), gs.tableau("G-L", stages=7).stages,
        tuned, *tuned.pilots,
        certificate, *certificate.lines, verify_stepper(Spec("EMS", None, "gamma")), model,
        model.system, small_system(), *built(),
        step.consistent(TOP.q0, TOP.p0 + 0.1, parameters=PARAMETERS),
        moved, moved.tangents, run.gradient({"q": run.q[-1]}), gs.Tangents(),
        gs.lyapunov(step, TOP.q0, TOP.p0, steps=40, every=20, **RUN),
        gs.fit(step, TOP, run.t[::100], run.q[::100], free=["I1"], **RUN),
        gs.periodic_orbit(systems.stepper("pendulum"), [0.6, -0.8], [0.0, 0.0], dt=6.5 / 40,
                          steps=40, parameters=systems.case("pendulum").parameters, fix="x"),
        TOP.start, run[-1], tops.body("a"), tops.joint(),
        gs.Solver("newton", tolerance=1e-9), gs.Inputs([0.1, 0.2], hold=3),
        gs.Impact("floor"), fallen().impacts["floor"],
        systems.run("beam", systems.stepper("beam", "IMS"), 2).beam("rod"),
        gs.Shape("disc", (0.1, 0.1, 0.02)), dip, section, swung.events["q1"], gs.cite(step),
        record(step, TOP.q0, TOP.p0, steps=3, **RUN, out=out),
        gs.build("cpp", "fast-top", scheme="EMS", dt=1e-3, out=out.parent / "cpp"),
    ]


def test_every_public_class_is_looked_at(shown):
    classes = {thing for thing in (getattr(gs, name) for name in gs.__all__)
               if inspect.isclass(thing) and not issubclass(thing, BaseException)}
    classes |= set(map(result_class, RESULT_CLASSES))
    assert classes <= {type(thing) for thing in shown}


def test_reprs_are_short_and_say_what_it_is(shown):
    for thing in shown:
        text, name = repr(thing), type(thing).__name__
        assert len(text) < 300, text
        assert text.count("\n") < 3
        assert name in text
        assert not re.search(r"\bat 0x|object at", text), text


def test_every_object_is_pickled_and_copied(shown):
    for thing in shown:
        for other in (copy.copy(thing), copy.deepcopy(thing), pickle.loads(pickle.dumps(thing))):
            assert type(other) is type(thing)
            assert repr(other) == repr(thing)


@pytest.mark.slow  # it imports all that is plotted, solved and stored
def test_a_spawned_process_gets_every_object(shown, tmp_path):
    (tmp_path / "objects").write_bytes(pickle.dumps(shown))
    read = python("import pathlib, pickle\n"
                  "for thing in pickle.loads(pathlib.Path('objects').read_bytes()):\n"
                  "    print(type(thing).__name__)", cwd=tmp_path)
    assert read.split() == [type(thing).__name__ for thing in shown]


def test_every_attribute_is_there_or_absent(shown):
    """hasattr and inspect.getmembers take an AttributeError, and no other error."""
    for thing in shown:
        if not isinstance(thing, gs.System) or thing.n < 10:  # it derives what it is asked for
            assert inspect.getmembers(thing)
    (simulation,) = (thing for thing in shown if isinstance(thing, gs.Simulation))
    assert not hasattr(simulation, "trajectory")
    with pytest.raises(gs.InputError, match="record"):
        _ = simulation.trajectory


def test_a_model_and_its_system_are_the_same_in_another_process(shown):
    model = gs.models.double_pendulum()
    other = pickle.loads(pickle.dumps(model))
    assert "_make" not in vars(other)
    assert system_digest(other.system) == system_digest(model.system)
    assert other.parameters == model.parameters
    assert json.loads(json.dumps(model.parameters)) == dict(model.parameters)
    with pytest.raises(TypeError, match="dict"):
        other.parameters["g"] = 3.0


def test_errors_are_pickled_with_what_they_carry():
    for error in (gs.errors.Stopped("Stopped at step 3 of 5.", 2, dataset="the cells"),
                  gs.errors.CompilerError("failed", command=["cc"], stderr="why")):
        other = pickle.loads(pickle.dumps(error))
        assert (str(other), vars(other)) == (str(error), vars(error))


@pytest.mark.parametrize(("find", "text"), [
    (lambda gl3: gl3, "<Stepper heavy_top_gl3_gamma: order 6, 27 unknowns>"),
    (lambda gl3: small_system(),
     "<System small: coordinates x; parameters k; 0 constraints; forces; quantities size>"),
    (lambda gl3: gs.tableau("LIIIA-B", stages=2), "<Tableau liiiab2: 2 stages, p = 1, order 2>"),
    (lambda gl3: TOP, "<Problem fast-top (heavy_top): I1 = 0.002, I2 = 0.002, I3 = 0.0008, "
                      "mgl = 0.3924>"),
    (lambda gl3: built()[0], "<Multibody arm: bodies a, b; joints shoulder, elbow, knee, rod, "
                             "spring>"),
])
def test_what_they_say(find, text, gl3):
    assert repr(find(gl3)) == text


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_errors_say_their_sentence(gl3):
    """And not the trajectory that they carry."""
    with pytest.raises(gs.StepFailed) as failure:
        gl3.integrate(TOP.q0, TOP.p0, dt=1.0, steps=3, parameters=PARAMETERS)
    stopped = gs.errors.Stopped("Stopped at step 3 of 5.", 2, trajectory=failure.value.trajectory)
    for error in (failure.value, stopped):
        assert len(repr(error)) < 300
        assert str(error) in repr(error)
