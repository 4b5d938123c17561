"""What notebooks show: whole HTML, with the numbers and formulas of the object, text escaped."""

from __future__ import annotations

import re
import types
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import RUN, TOP
from gyrospark.certificates.certificate import Certificate
from gyrospark.certificates.measured_properties import CertificateLine
from gyrospark.core.arguments import few
from gyrospark.core.html import curve, table
from result_classes import RESULT_CLASSES, result_class

HOSTILE = "<script>alert(1)</script> & \"x\""


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


def shown(thing):
    return Reader(thing._repr_html_())


@pytest.fixture(scope="module")
def run(gl3):
    return gl3.integrate(TOP.q0, TOP.p0, steps=600, **RUN)


def test_a_trajectory_shows_its_report_and_a_curve(run):
    found = shown(run)
    assert any("601 of 600" in cell for cell in found.cells)
    assert f"{run.report.energy_error_max:.2e}" in found.cells
    points = np.array([[float(x) for x in pair.split(",")] for pair in found.points.split()])
    assert 250 < len(points) <= 301
    error = run.energy_error()[:: len(run) // 300]
    assert np.argmin(points[:, 1]) == np.argmax(error)  # down the page is up the axis
    assert (np.diff(points[:, 0]) > 0).all()


def test_a_corner_without_a_text_is_no_head():
    assert Reader(table([("a", 1)], ("", "n"))).tags.count("th") == 1


def test_what_others_wrote_stays_text(run):
    manifest = replace(run.manifest, name=HOSTILE)
    line = CertificateLine(HOSTILE, HOSTILE, HOSTILE, False, HOSTILE)
    for thing in (replace(run, manifest=manifest),
                  Certificate(HOSTILE, HOSTILE, 2, 0.1, 3, {}, [line])):
        text = thing._repr_html_()
        assert "<script" not in text
        assert "&lt;script&gt;alert(1)" in text
        Reader(text)


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_an_ensemble_says_what_failed(gl3):
    many = gl3.integrate_ensemble([TOP.q0] * 3, [TOP.p0] * 3, dt=[1e-3, 1.0, 1e-3], steps=5,
                                  parameters=RUN["parameters"])
    cells = shown(many).cells
    assert cells[:4] == ["trajectories", "3 of 6 states", "failed", "1"]
    assert cells[4:] == ["trajectory 1", str(many.failures[1])]


def test_a_stepper_and_a_problem_say_what_a_run_needs(gl3):
    cells = shown(gl3).cells
    assert cells[cells.index("method") + 1] == "3-G-L, order 6, 27 unknowns"
    assert all(name in cells[cells.index("parameters") + 1] for name in gl3.parameter_domains)
    assert "heavy_top" in cells[cells.index("system") + 1]
    cells = shown(TOP).cells
    assert "mgl = 0.3924" in cells[cells.index("parameters") + 1]
    cells = shown(systems.stepper("double_top")).cells
    assert cells[cells.index("bodies") + 1] == "a, b"
    assert few([*"abcdefghij"]).endswith("(10)")


def test_a_system_and_a_model_show_their_formulas():
    model = gs.models.lagrange_top()
    cells = shown(model).cells
    H = cells[cells.index("H") + 1]
    assert f"\\({sp.latex(model.system.H)}\\)" == H
    assert cells[cells.index("g: a: unit quaternion") + 1].startswith("\\(a_{q0}^{2}")
    assert "a_I1 = 0.004" in cells[cells.index("parameters") + 1]
    long = gs.models.chain(6)
    cells = shown(long).cells
    assert re.fullmatch(r"\d+ terms .*[\d,]+ parts", cells[cells.index("H") + 1])
    assert len(long._repr_html_()) < 6000
    x, u, c = sp.symbols("x u c", real=True)
    pushed = gs.System([x], [u], [c], u**2 / 2, name="pushed", forces=[-c * u])
    cells = shown(pushed).cells
    assert cells[cells.index("F(u)") + 1] == "\\(- c u\\)"


def test_a_tableau_is_butchers_table():
    two = shown(gs.tableau("G-L", stages=2))
    assert two.tags.count("table") == 4
    half, root = sp.Rational(1, 2), sp.sqrt(3)
    assert two.cells[:3] == [f"\\({sp.latex(e)}\\)"
                             for e in (half - root / 6, half / 2, half / 2 - root / 6)]
    for stages in (5, 9):  # where exact entries are pages long
        found = gs.tableau("G-L", stages=stages)
        cells = shown(found).cells
        first = found.numeric(digits=30).A[0][1]
        assert abs(float(cells[2]) - float(first)) < 1e-12
        assert float(cells[0]) == pytest.approx(float(found.numeric(digits=30).c[0]), abs=1e-12)


def test_a_certificate_is_a_row_a_promise():
    made = gs.certify(TOP, "G-L", 2, dt=1e-3, steps=20)
    found = shown(made)
    assert found.tags.count("tr") == 1 + len(made.lines)
    assert "every guarantee" in made._repr_html_()
    assert found.cells[3::4] == [line.verdict for line in made.lines]


def test_curves_and_tables_of_little():
    assert curve([], [], "H") == curve([0.0], [1.0], "H") == ""
    assert curve([0.0, 1.0, 2.0], [np.nan, np.inf, 1.0], "H") == ""
    assert "polyline" in curve([0.0, 1.0], [2.0, 2.0], "H")
    assert Reader(table([["a < b", 3]])).cells == ["a < b", "3"]


def test_completion_offers_public_names(run):
    for module in (gs, gs.models, gs.problems, gs.symbols):
        for name in dir(module):
            value = getattr(module, name)
            assert not isinstance(value, types.ModuleType) or module is gs, name
    offered = {name for name in dir(run.body()) if not name.startswith("_")}
    assert {"attitude", "euler", "angular_velocity", "position", "momentum"} <= offered
    assert not {"np", "run", "at"} & offered


def test_results_of_analyses_and_simulations_have_cards(gl3):
    """With the numbers of the object."""
    step = systems.differentiable("pendulum")
    start = gs.Start(*systems.start("pendulum", step), systems.case("pendulum").parameters)
    simulation = gl3.start(TOP, dt=1e-3)
    simulation.advance(3)
    assert shown(simulation).cells[1::2][:2] == ["0.003 s", "3"]
    run = step.integrate(start, dt=0.01, steps=20)
    name = next(iter(start.parameters))
    fit = gs.fit(step, start, run.t[1:], run.q[1:], dt=0.01, observe="q", free=[name])
    assert name in shown(fit).cells
    found = gs.lyapunov(step, start, dt=0.01, steps=20, count=2)
    assert len(shown(found).cells) == 9
    level = float(run.q[10, 0])
    section = gs.section(step, [start], event=gs.Event(step.manifest.system.coordinates[0], level),
                         dt=0.01, steps=20)
    assert shown(section).cells[-3] == f"{len(section)}"
    assert len(section) > 0
    fall = systems.run("ball", systems.stepper("ball"), 6, dt=0.1, events=gs.Impact("floor"))
    assert f"{float(fall.impacts['floor'].impulse[0]):.6g}" in shown(fall.impacts["floor"]).cells

def test_every_result_has_a_card():
    """Classes whose objects calls return, and builders."""
    builders = (gs.Ensemble, gs.Model, gs.Multibody, gs.Simulation, gs.Start, gs.Stepper, gs.System,
                gs.Trajectory)
    for cls in (*map(result_class, RESULT_CLASSES), *builders):
        assert hasattr(cls, "_repr_html_"), cls


def test_parts_of_a_run_have_cards(gl3, run):
    report = run.report
    cells = shown(report).cells
    assert cells[:3] == ["iterations a step", str(report.iterations_max),
                         f"{report.iterations_mean:.1f}"]
    assert cells[cells.index("energy") + 1] == f"{report.energy_error_max:.2e}"
    body = shown(run.body()).cells
    assert body[body.index("last attitude") + 1] == few(f"{x:.6g}" for x in run.q[-1])
    double = systems.stepper("double_top")
    begin = gs.models.double_top()
    joint = next(iter(double.manifest.system.joints))
    pair = double.integrate(begin, dt=1e-3, steps=2)
    assert shown(pair.joint(joint)).cells[5] == "3 of 2 steps of 0.001 s"
    level = gs.Event("q1", float(run.q[300, 1]))
    crossings = gl3.integrate(TOP, dt=RUN["dt"], steps=400, events=level).events[level.name]
    cells = shown(crossings).cells
    assert len(cells) == 3 * min(10, len(crossings)) > 0
    assert float(cells[0]) == pytest.approx(float(crossings.t[0]), rel=1e-8)
    assert cells[2] == ("up" if crossings.rising[0] else "down")


def test_a_gradient_and_a_projection_have_cards():
    step = systems.differentiable("heavy_top")
    names = ("mgl", "I1")
    found = step.integrate(TOP, dt=1e-3, steps=3).gradient({"q": [1.0, 0.0, 0.0, 0.0]}, wrt=names)
    assert shown(found).cells == [c for name in names for c in (name, f"{found[name]:.6g}")]
    moved = step.consistent(2 * TOP.q0, TOP.p0, parameters=TOP.parameters)
    (name,) = moved.before
    second = step.hessian(step.integrate(TOP, dt=1e-3, steps=3), {"q": [1.0, 0.0, 0.0, 0.0]},
                         wrt=["mgl"])
    assert shown(second).cells == ["mgl", f"{second.gradient[0]:.6g}",
                                   f"{second.matrix[0, 0]:.6g}"]
    along = step.integrate(TOP, dt=1e-3, steps=3, tangents=gs.Tangents(parameters=["mgl"])).tangents
    assert shown(along).cells[-3:] == ["mgl", "0", f"{np.linalg.norm(along['mgl'][-1]):.6g}"]
    assert shown(moved).cells[2:5] == [name, f"{moved.before[name]:.1e}",
                                       f"{moved.after[name]:.1e}"]


def test_builders_artefacts_and_citations_have_cards(gl3, tmp_path):
    arm = gs.Multibody("arm", description=HOSTILE)
    upper = arm.body("upper", mass=1.5, inertia=(0.1, 0.1, 0.01))
    arm.fixed_point("shoulder", upper, on_body=(0, 0, 0.5), at=(0, 0, 0))
    cells = shown(arm).cells
    assert cells[1] == HOSTILE
    assert cells[cells.index("bodies") + 1] == "upper"
    assert cells[cells.index("joints") + 1] == "shoulder"
    assert "upper_m = 1.5" in cells[cells.index("parameters") + 1]
    made = gs.build("cpp", TOP, scheme="EMS", dt=1e-3, out=tmp_path / "built")
    assert shown(made).cells[1] == str(made.path)
    cited = gs.cite(gl3)
    assert shown(cited).cells[1::2] == list(cited.reasons.values())


def test_progress_of_ensembles_sections_and_fits(gl3):
    """What is done grows up to the end, and is the same that the results say."""
    step = systems.differentiable("pendulum")
    start = gs.Start(*systems.start("pendulum", step), systems.case("pendulum").parameters)
    run = step.integrate(start, dt=0.01, steps=20)
    for workers in (1, 2):
        done = []
        gl3.integrate_ensemble([TOP.q0] * 64, [TOP.p0] * 64, steps=100, **RUN, workers=workers,
                               events=gs.Event("q1"), progress=done.append)
        assert done == sorted(done)
        assert done[-1] == 64 * 100
    done = []
    gs.section(step, [start], event=gs.Event(step.manifest.system.coordinates[0]), dt=0.01,
               steps=20, progress=done.append)
    assert done[-1] == 20
    done = []
    gs.fit(step, start, run.t[1:], run.q[1:], dt=0.01, observe="q", free=[next(iter(
        start.parameters))], horizons=[10, 15], progress=done.append)
    assert sorted(set(done)) == [0, 1, 2, 3]
    assert done == sorted(done)
