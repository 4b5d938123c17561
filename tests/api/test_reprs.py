"""Objects have a line or two with the name at a prompt, and escaped HTML in a notebook."""

from __future__ import annotations

import copy
import inspect
import json
import pickle
import re
import types
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import PARAMETERS, RUN, TOP
from gyrospark.certificates.certificate import Certificate
from gyrospark.certificates.measured_properties import CertificateLine
from gyrospark.certificates.verification import verify_stepper
from gyrospark.core.arguments import few
from gyrospark.core.html import curve, table
from gyrospark.generator.spec import Spec
from gyrospark.generator.systems.system_digest import system_digest
from gyrospark.runtime.devices.ensemble import DeviceEnsemble
from gyrospark.runtime.steppers.run_defaults import RunDefaults
from result_classes import RESULT_CLASSES, result_class
from stores import record

HOSTILE = "<script>alert(1)</script> & \"x\""


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
    """Objects of every public class, and of the classes of their attributes and results."""
    step = systems.stepper("heavy_top")
    run = step.integrate(TOP.q0, TOP.p0, steps=300, **RUN)
    model, tableau = systems.case("double_top").system, gs.tableau("G-L", stages=3)
    tuned = gs.tune(step, TOP, dt=1e-3, gamma="auto", steps=20)
    certificate = gs.certify(TOP, "EMS", dt=1e-3, steps=20)
    dip = gs.Event("q1", level=0.2)
    section = gs.section(step, [TOP.q0] * 2, [TOP.p0] * 2, event=dip, steps=300, **RUN)
    tops = systems.run("double_top", systems.stepper("double_top"), 3)
    with_events = step.integrate(TOP.q0, TOP.p0, steps=300, events=dip, **RUN)
    ensemble = step.integrate_ensemble([TOP.q0] * 30, [TOP.p0] * 30, steps=100, **RUN)
    with_tangents = step.integrate(TOP.q0, TOP.p0, steps=3,
                                   tangents=gs.Tangents(parameters=["mgl"]), **RUN)
    out = tmp_path_factory.mktemp("reprs") / "run.zarr"
    return [
        *systems.stepper("heavy_top_in_frame").symmetries,
        step, step.start(TOP.q0, TOP.p0, **RUN), TOP, RunDefaults.of_problem(TOP), run, run.report,
        ensemble,
        DeviceEnsemble(ensemble.t, ensemble.q, ensemble.p, ensemble.iterations, ensemble.t, {},
                       "top"),
        tableau, tableau.stages, tableau.numeric(digits=50), gs.tableau("G-L", stages=7).stages,
        tuned, *tuned.pilots,
        certificate, *certificate.lines, verify_stepper(Spec("EMS", None, "gamma")), model,
        model.system, small_system(), *built(),
        step.consistent(TOP.q0, TOP.p0 + 0.1, parameters=PARAMETERS),
        with_tangents, with_tangents.tangents, run.gradient({"q": run.q[-1]}), gs.Tangents(),
        step.hessian(with_tangents, {"q": [1.0, 0.0, 0.0, 0.0]}, wrt=["mgl"]),
        gs.lyapunov(step, TOP.q0, TOP.p0, steps=40, every=20, **RUN),
        gs.fit(step, TOP, run.t[::100], run.q[::100], free=["I1"], **RUN),
        gs.periodic_orbit(systems.stepper("pendulum"), [0.6, -0.8], [0.0, 0.0], dt=6.5 / 40,
                          steps=40, parameters=systems.case("pendulum").parameters, fix="x"),
        TOP.start, run[-1], tops.body("a"), tops.joint(),
        gs.Solver("newton", tolerance=1e-9), gs.Inputs([0.1, 0.2], hold=3),
        gs.Impact("floor"), fallen().impacts["floor"],
        systems.run("beam", systems.stepper("beam", "IMS"), 2).beam("rod"),
        gs.Shape("disc", (0.1, 0.1, 0.02)), dip, section, with_events.events["q1"], gs.cite(step),
        record(step, TOP.q0, TOP.p0, steps=3, **RUN, out=out),
        gs.build("cpp", "fast-top", scheme="EMS", dt=1e-3, out=out.parent / "cpp"),
    ]


def test_every_public_class_is_looked_at(shown):
    classes = {entry for entry in (getattr(gs, name) for name in gs.__all__)
               if inspect.isclass(entry) and not issubclass(entry, BaseException)}
    classes |= set(map(result_class, RESULT_CLASSES))
    assert classes <= {type(entry) for entry in shown}


def test_reprs_are_short_and_say_what_it_is(shown):
    for entry in shown:
        text, name = repr(entry), type(entry).__name__
        assert len(text) < 300, text
        assert text.count("\n") < 3
        assert name in text
        assert not re.search(r"\bat 0x|object at", text), text


def test_every_object_is_pickled_and_copied(shown):
    for entry in shown:
        for copied in (copy.copy(entry), pickle.loads(pickle.dumps(entry))):
            assert type(copied) is type(entry)
            assert repr(copied) == repr(entry)


def test_every_attribute_is_there_or_absent(shown):
    """hasattr and inspect.getmembers take an AttributeError, and no other error."""
    for entry in shown:
        if not isinstance(entry, gs.System) or entry.n < 10:  # it derives what it is asked for
            assert inspect.getmembers(entry)
    (simulation,) = (entry for entry in shown if isinstance(entry, gs.Simulation))
    assert not hasattr(simulation, "trajectory")
    with pytest.raises(gs.InputError, match="record"):
        _ = simulation.trajectory


def test_a_model_and_its_system_are_the_same_in_another_process(shown):
    model = gs.models.double_pendulum()
    unpickled = pickle.loads(pickle.dumps(model))
    assert "_make" not in vars(unpickled)
    assert system_digest(unpickled.system) == system_digest(model.system)
    assert unpickled.parameters == model.parameters
    assert json.loads(json.dumps(model.parameters)) == dict(model.parameters)
    with pytest.raises(TypeError, match="dict"):
        unpickled.parameters["g"] = 3.0


def test_errors_are_pickled_with_what_they_carry():
    for error in (gs.errors.Stopped("Stopped at step 3 of 5.", 2, dataset="the cells"),
                  gs.errors.CompilerError("failed", command=["cc"], stderr="why")):
        unpickled = pickle.loads(pickle.dumps(error))
        assert (str(unpickled), vars(unpickled)) == (str(error), vars(error))


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
    """The repr has the sentence, and not the trajectory of the error."""
    with pytest.raises(gs.StepFailed) as failure:
        gl3.integrate(TOP.q0, TOP.p0, dt=1.0, steps=3, parameters=PARAMETERS)
    stopped = gs.errors.Stopped("Stopped at step 3 of 5.", 2, trajectory=failure.value.trajectory)
    for error in (failure.value, stopped):
        assert len(repr(error)) < 300
        assert str(error) in repr(error)


# ---------------------------------------------------------------- cards of notebooks


class Reader(HTMLParser):
    """Reads strictly: every tag is closed where it was opened."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.cells, self.points = [], [], [], ""
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.open.append(tag)
        self.tags.append(tag)
        if tag == "td" and "thead" not in self.open:
            self.cells.append("")
        self.points = dict(attrs).get("points", self.points)

    def handle_startendtag(self, tag, attrs):
        self.points = dict(attrs).get("points", self.points)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "td" and "thead" not in self.open:
            self.cells[-1] += data


def card(shown_object):
    return Reader(shown_object._repr_html_())


@pytest.fixture(scope="module")
def run(shown):
    return next(entry for entry in shown if type(entry) is gs.Trajectory)


CARDS = {
    "Stepper": lambda one: ["2-G-L, order 4, 18 unknowns", "heavy_top", *one.parameter_domains],
    "Problem": lambda one: ["I1 = 0.002, I2 = 0.002, I3 = 0.0008, mgl = 0.3924"],
    "Simulation": lambda one: ["0 s", "0"],
    "Report": lambda one: ["iterations a step", str(one.iterations_max),
                           f"{one.iterations_mean:.1f}", f"{one.energy_error_max:.2e}"],
    "BodyMotion": lambda one: [few(f"{x:.6g}" for x in one.attitude[-1])],
    "JointMotion": lambda one: ["4 of 3 steps of 0.002 s"],
    "Crossings": lambda one: [f"{float(one.t[0]):.9g}", "up" if one.rising[0] else "down"],
    "Impacts": lambda one: [f"{float(one.impulse[0]):.6g}"],
    "Gradient": lambda one: ["mgl", f"{one['mgl']:.6g}"],
    "Hessian": lambda one: ["mgl", f"{one.gradient[0]:.6g}", f"{one.matrix[0, 0]:.6g}"],
    "TangentRows": lambda one: ["mgl", f"{np.linalg.norm(one['mgl'][-1]):.6g}"],
    "Projection": lambda one: [text for name in one.before for text in (
        name, f"{one.before[name]:.1e}", f"{one.after[name]:.1e}")],
    "Fit": lambda one: ["I1"],
    "Lyapunov": lambda one: [f"{one.exponents[0]:.6g}"],
    "Section": lambda one: [str(len(one))],
    "Certificate": lambda one: [line.verdict for line in one.lines],
    "Multibody": lambda one: ["a, b", "shoulder, elbow, knee, rod, spring"],
    "Built": lambda one: [str(one.path)],
    "Citations": lambda one: [*one.reasons.values()],
}


@pytest.mark.parametrize("kind", CARDS)
def test_a_card_has_the_numbers_of_its_object(kind, shown):
    entry = next(candidate for candidate in shown if type(candidate).__name__ == kind)
    cells = card(entry).cells
    for text in CARDS[kind](entry):
        assert any(text in cell for cell in cells), (text, cells)


def test_every_result_has_a_card():
    """Classes of results and of builders have a card."""
    builders = (gs.Ensemble, gs.Model, gs.Multibody, gs.Simulation, gs.Start, gs.Stepper, gs.System,
                gs.Trajectory)
    for cls in (*map(result_class, RESULT_CLASSES), *builders):
        assert hasattr(cls, "_repr_html_"), cls


def test_a_trajectory_shows_its_report_and_a_curve(run):
    parsed_card = card(run)
    assert any("301 of 300" in cell for cell in parsed_card.cells)
    assert f"{run.report.energy_error_max:.2e}" in parsed_card.cells
    points = np.array([[float(x) for x in pair.split(",")] for pair in parsed_card.points.split()])
    assert 250 < len(points) <= 301
    error, height = run.energy_error(), -points[:, 1]  # down the page is up the axis
    assert height[np.argmax(error)] == height.max() > height.min() == height[np.argmin(error)]
    assert (np.diff(points[:, 0]) > 0).all()


def test_what_others_wrote_stays_text(run):
    manifest = replace(run.manifest, name=HOSTILE)
    line = CertificateLine(HOSTILE, HOSTILE, HOSTILE, False, HOSTILE)
    for hostile in (replace(run, manifest=manifest),
                    Certificate(HOSTILE, HOSTILE, 2, 0.1, 3, {}, [line])):
        text = hostile._repr_html_()
        assert "<script" not in text
        assert "&lt;script&gt;alert(1)" in text
        Reader(text)


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_an_ensemble_says_what_failed(gl3):
    ensemble = gl3.integrate_ensemble([TOP.q0] * 3, [TOP.p0] * 3, dt=[1e-3, 1.0, 1e-3], steps=5,
                                      parameters=RUN["parameters"])
    cells = card(ensemble).cells
    assert cells[:4] == ["trajectories", "3 of 6 states", "failed", "1"]
    assert cells[4:] == ["trajectory 1", str(ensemble.failures[1])]


def test_a_system_and_a_model_show_their_formulas():
    model = gs.models.lagrange_top()
    cells = card(model).cells
    H = cells[cells.index("H") + 1]
    assert f"\\({sp.latex(model.system.H)}\\)" == H
    assert cells[cells.index("g: a: unit quaternion") + 1].startswith("\\(a_{q0}^{2}")
    assert "a_I1 = 0.004" in cells[cells.index("parameters") + 1]
    long = gs.models.chain(6)
    cells = card(long).cells
    assert re.fullmatch(r"\d+ terms .*[\d,]+ parts", cells[cells.index("H") + 1])
    assert len(long._repr_html_()) < 6000
    x, u, c = sp.symbols("x u c", real=True)
    pushed = gs.System([x], [u], [c], u**2 / 2, name="pushed", forces=[-c * u])
    cells = card(pushed).cells
    assert cells[cells.index("F(u)") + 1] == "\\(- c u\\)"


def test_a_tableau_is_butchers_table():
    two = card(gs.tableau("G-L", stages=2))
    assert two.tags.count("table") == 4
    half, root = sp.Rational(1, 2), sp.sqrt(3)
    assert two.cells[:3] == [f"\\({sp.latex(e)}\\)"
                             for e in (half - root / 6, half / 2, half / 2 - root / 6)]
    for stages in (5, 9):  # where exact entries are pages long
        tableau = gs.tableau("G-L", stages=stages)
        cells = card(tableau).cells
        first = tableau.numeric(digits=30).A[0][1]
        assert abs(float(cells[2]) - float(first)) < 1e-12
        assert float(cells[0]) == pytest.approx(float(tableau.numeric(digits=30).c[0]), abs=1e-12)


def test_curves_and_tables_of_little():
    assert Reader(table([("a", 1)], ("", "n"))).tags.count("th") == 1
    assert curve([], [], "H") == curve([0.0], [1.0], "H") == ""
    assert curve([0.0, 1.0, 2.0], [np.nan, np.inf, 1.0], "H") == ""
    assert "polyline" in curve([0.0, 1.0], [2.0, 2.0], "H")
    assert Reader(table([["a < b", 3]])).cells == ["a < b", "3"]
    assert few([*"abcdefghij"]).endswith("(10)")


def test_completion_offers_public_names(run):
    for module in (gs, gs.models, gs.problems, gs.symbols):
        for name in dir(module):
            value = getattr(module, name)
            assert not isinstance(value, types.ModuleType) or module is gs, name
    offered = {name for name in dir(run.body()) if not name.startswith("_")}
    assert {"attitude", "euler", "angular_velocity", "position", "momentum"} <= offered
    assert not {"np", "run", "at"} & offered


def test_progress_of_ensembles_sections_and_fits(gl3):
    """The count grows up to the end, and is the same as in the results."""
    step = systems.differentiable("pendulum")
    start = gs.Start(*systems.start("pendulum", step), systems.case("pendulum").parameters)
    run = step.integrate(start, dt=0.01, steps=20)
    for workers in (1, 2):
        counts = []
        gl3.integrate_ensemble([TOP.q0] * 64, [TOP.p0] * 64, steps=100, **RUN, workers=workers,
                               events=gs.Event("q1"), progress=counts.append)
        assert counts == sorted(counts)
        assert counts[-1] == 64 * 100
    counts = []
    gs.section(step, [start], event=gs.Event(step.manifest.system.coordinates[0]), dt=0.01,
               steps=20, progress=counts.append)
    assert counts[-1] == 20
    counts = []
    gs.fit(step, start, run.t[1:], run.q[1:], dt=0.01, observe="q", free=[next(iter(
        start.parameters))], horizons=[10, 15], progress=counts.append)
    assert sorted(set(counts)) == [0, 1, 2, 3]
    assert counts == sorted(counts)
