"""Reference problems: digits against another code, runs against digits, the page."""

from __future__ import annotations

import re
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from operator import mul

import mpmath as mp
import numpy as np
import pytest

import gyrospark as gs
from benchmarks import loops, make_digits
from benchmarks.references import measure_peers
from gyrospark.commands.reference import _print
from gyrospark.generator.systems.numeric_system import NumericSystem
from gyrospark.references.problem import Attempt, largest_error
from gyrospark.references.problem_registry import REFERENCES
from gyrospark.references.results_page import page, reached
from gyrospark.references.work_precision import LIMIT, measure
from gyrospark.runtime.rigid_body.quaternion import left_matrix, rotation_matrix
from processes import ROOT
from robots import Motion
from strategies import EPS

every = pytest.mark.parametrize("name", REFERENCES)
#: Results of another code: mpmath with 32 to 40 digits, extrapolated modified midpoint with two
#: numbers of steps, and closed forms; as many digits as agreed.
OTHER = {
    "car-axis": {
        "xl": "0.049345578427524092132", "yl": "0.49698946023000810676",
        "xr": "1.0417425248854261152", "yr": "0.37391102726536581936",
        "xl'": "-0.077058368403592084284", "yl'": "0.0074468665920684164914",
        "xr'": "0.01755681575354173663", "yr'": "0.77034104377960106312"},
    "andrews": {
        "beta": "15.8107711951537071", "theta": "-15.75637105841183947",
        "gamma": "0.04082224011964580486", "phi": "-0.5347301163420795938",
        "delta": "0.5244099658799540694", "omega": "0.5347301163420795938",
        "epsilon": "1.048080741041937873", "beta'": "1139.920302259106064",
        "theta'": "-1424.379295177540073", "gamma'": "11.03291191061859375",
        "phi'": "19.29337410503204083", "delta'": "0.5735699148295024538",
        "omega'": "-19.29337410503204083", "epsilon'": "0.323179149249130875"},
    "simple-pendulum": {"x": "-0.27508746257611686", "y": "-0.961419205099125064"},
    "spherical-pendulum": {
        "x": "0.218611338000210502", "y": "0.046728350139105571", "z": "-0.974692538286322818"},
    "dzhanibekov": {
        "q0": "0.283152033889099888", "q1": "0.0137111148475205974", "q2": "-0.957225806168766734",
        "q3": "-0.0579282922125169067", "Omega1": "-0.117326383719772847",
        "Omega2": "0.993093912821562219", "Omega3": "0.0677433399352767348"},
    "kovalevskaya": {
        "q0": "0.365509374554041967", "q1": "0.340051246418328319", "q2": "-0.832877164037846789",
        "q3": "0.23892190470262048", "Omega1": "0.223679553297493491",
        "Omega2": "0.667560414375855056", "Omega3": "-0.168762229173479245"},
    "four-bar": {"x_B0": "0.328458111540815379", "y_B0": "0.944518538178600962"},
    "four-bars-40": {"x_B0": "0.18051222668672839", "y_B0": "0.983572740582311575"},
    "bricard": {
        "x_P1": "0.9999999638063", "z_P1": "-2.690488800787e-4", "x_P3": "0.9999999638063",
        "y_P3": "-1.000269012696", "z_P3": "0.9997309511199"},
    "slider-crank": {"x_C": "0.2249255150864"},
    "flyball-governor": {
        "psi": "0.6221066814027", "beta": "0.4961738690759", "s": "0.5238364755696",
        "psi'": "6.103717808831", "beta'": "-0.522673929754", "s'": "0.459271810436"},
    "free-body": {
        "q0": "0.887094310264289125", "q1": "-0.261678695032792263", "q2": "0.225839107427755072",
        "q3": "0.305916071527624956", "Omega2": "-0.590418524333427169"},
    "heavy-top": {
        "q0": "0.122947135041533", "q1": "-0.491079892550027", "q2": "0.350430030343621",
        "q3": "-0.787986887550486", "Omega1": "0.12223321949739", "Omega2": "150",
        "Omega3": "-5.8556245892055"},
    "neumann": {
        "x": "-0.68481240258151709", "y": "-0.703775170998832686", "z": "0.189030373104678544",
        "x'": "-0.546403132285606727", "y'": "0.746878462259911112", "z'": "0.801198628592205072"},
    "ellipsoid": {
        "x": "0.690990708467968132", "y": "-0.809776411035365989", "z": "0.88241242710260256",
        "x'": "-0.55502039155629111", "y'": "-0.725068272216247961", "z'": "0.407711130068883753"},
}


@pytest.mark.parametrize("name", OTHER)
def test_digits_are_those_of_another_code(name):
    """They agree to the last digit of each number but one, which was rounded."""
    true = REFERENCES[name].truth
    for number, text in OTHER[name].items():
        digits, _, power = text.partition("e")
        last = Fraction(10) ** (int(power or 0) - len(digits.partition(".")[2]))
        assert abs(true.value(number) - Fraction(text)) <= 2 * last, number


@every
def test_digits_are_made_by_the_script(name):
    """The stored digits agree in two ways; names are the problem's, with 24 digits each."""
    problem = REFERENCES[name]
    true = problem.truth
    assert 0 < true.agreement <= 2e-25
    assert list(true.values) == [x for names in problem.groups.values() for x in names]
    assert all(len(re.sub(r"\D", "", text).lstrip("0")) == 24 for text in true.values.values())
    assert name in make_digits.WAYS


@pytest.mark.parametrize("name", ["kovalevskaya", "goryachev-chaplygin", "dzhanibekov",
                                  "free-body"])
def test_integrals_of_tops_have_no_rate_at_any_state(name):
    """The top of Goryachev and Chaplygin has its own where l_z = 0."""
    model, draw = REFERENCES[name].make().in_type(float), np.random.default_rng(5)
    q, m = draw.normal(size=4), draw.normal(size=3)
    q /= np.linalg.norm(q)
    if name == "goryachev-chaplygin":
        vertical = rotation_matrix(q)[2]  # in body axes
        m -= vertical * (vertical @ m)
    motion = Motion(replace(model, q0=q, p0=2 * left_matrix(q).T @ m))
    for quantity in model.system.quantities:
        assert abs(motion.acceleration(quantity)) < 64 * EPS, quantity


@pytest.mark.parametrize("name", [
    "simple-pendulum", "bead", "growing-mass", "heavy-top",
    *(pytest.param(name, marks=pytest.mark.slow) for name in (
        "spherical-pendulum", "dzhanibekov", "free-body"))])  # quadratures in 32 digits
def test_closed_forms(name):
    """They begin at the model's start and agree with the stored digits."""
    problem, form = REFERENCES[name], make_digits.CLOSED[name]
    model = problem.make().in_type(float)
    group, *_ = problem.groups
    with mp.workdps(32):
        start, end = form(mp.mpf(0)), form(mp.mpf(problem.seconds))
        assert np.abs(np.array(start[group], dtype=float) - model.q0).max() < 2e-15
        for group, names in problem.groups.items():
            values = [Fraction(mp.nstr(x, 30)) for x in end[group]]
            assert largest_error(values, [problem.truth.value(x) for x in names]) < 1e-18


@pytest.mark.slow
@every
def test_the_script_gives_the_stored_digits(name):
    computed = make_digits.digits(REFERENCES[name])
    assert computed["values"] == dict(REFERENCES[name].truth.values)


#: A point; each other compiles a stepper of its own.
FEW = ("spherical-pendulum",)


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name not in FEW)) for name in REFERENCES])
def test_a_scheme_reaches_the_digits(name):
    """The error reaches 1e-12, and does not grow with more steps until then."""
    runs = list(measure(REFERENCES[name], rounds=1, quick=True))
    assert reached(runs)
    for coarser, finer in pairwise(runs):
        assert finer.error < max(coarser.error, LIMIT)
    assert all(run.cpu_seconds > 0 for run in runs)
    assert all(run.invariants["constraints"] < 1e-14 for run in runs)
    assert all(drift < 1e-10 for drift in runs[-1].invariants.values())


@pytest.mark.slow  # two steppers
def test_a_stiff_damper_lingers_with_gauss_and_not_with_radau():
    """In five steps of λΔt = 163, |R|⁵ is 0.29 with 4-G-L and 1.3e-9 with 3-Radau-L."""
    problem = REFERENCES["flyball-governor-stiff"]
    by_scheme = replace(problem, attempts=[
        Attempt("G-L", 4, (5,)), Attempt("Radau-L", 3, (5, 500))])
    gauss, radau, radau_500 = (run.error for run in measure(by_scheme, rounds=1))
    assert radau < 1e-8 < 1e-4 < gauss
    assert radau_500 < LIMIT


@pytest.mark.parametrize(("motion", "here"), [
    (loops.slider_crank, ("0.1", {2: "0.226812187053632"})),
    (loops.bricard, ("1", {0: "0.5105014611872", 4: "0.1401231145532"})),
    pytest.param(loops.bricard, ("0.5", {0: "0.9682836791068", 3: "-1.224625159436"}),
                 marks=pytest.mark.slow),
])
def test_loops_by_quadrature(motion, here):
    """Positions at other times than the digits' agree with another code."""
    time, expected = here
    with mp.workdps(20):
        positions = motion(mp.mpf(time))["positions"]
    for index, text in expected.items():
        assert float(positions[index]) == pytest.approx(float(text), abs=1e-12)


def test_a_loop_begins_with_the_rate_it_is_given():
    """After 1 µs at θ' = 2 rad/s P1 is at (cos θ, 0, −sin θ), up to θ'' t², 1e-6."""
    with mp.workdps(20):
        x, z, *_ = loops.bricard(mp.mpf("1e-6"), "2")["positions"]
    assert float(x) == pytest.approx(1 - 2e-12, rel=0, abs=1e-16)
    assert float(z) == pytest.approx(-2e-6, rel=5e-6)


def test_a_parallelogram_goes_through_a_hundred_change_points():
    """The closed form counts the points, φ an odd multiple of π/2, and the title has their
    number."""
    problem = REFERENCES["parallelogram"]
    c = make_digits.forms.four_bar_constant(1)
    m, w = 4 * c / (1 + 4 * c), mp.sqrt(1 + 4 * c) / 2
    phi = mp.pi + 2 * make_digits.forms.amplitude(w * 100 - mp.ellipk(m), m)
    assert problem.seconds == "100"
    passed = int(mp.floor(phi / mp.pi + mp.mpf(1) / 2))
    assert passed >= 100
    assert f" {passed} " in problem.title
    assert problem.make().system.n == 3 * 7  # two cranks and a rod


@pytest.mark.parametrize(("name", "left_out"), [("bricard", 1), ("four-bar", 6)])
def test_redundant_constraints_are_left_out_by_themselves(name, left_out):
    """One freedom remains: n - m = 1, though joints seem to take away six or so more."""
    system = REFERENCES[name].make().system
    joints = {"bricard": 30, "four-bar": 35}[name]
    bodies = system.n // 7
    assert system.m == bodies + joints - left_out
    assert system.n - system.m == 1


@pytest.mark.slow  # seconds of derivation
def test_bennetts_constraints_stay_independent():
    """Rounding does not grow with steps, for omitted constraints are not nearly needed."""
    problem = REFERENCES["bennett"]
    model = problem.make().in_type(float)
    run = gs.stepper("G-L", 3, system=model.system).integrate(
        model.q0, model.p0, dt=5 / 4000, steps=4000, every=200, parameters=model.parameters)
    assert problem.error(run) < 2e-14
    numbers = NumericSystem(model.system, model.parameters)
    for q in run.q:
        rows = numbers.G(q)
        rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
        assert np.linalg.svd(rows, compute_uv=False)[-1] > 0.05  # of x and y, 0.008


def test_what_was_published_is_off():
    """Andrews' velocities are off by 5e-8, a velocity of the car axis by 7e-10."""
    deviations = REFERENCES["andrews"].deviations
    assert 4e-8 < max(deviations.values()) == deviations["epsilon'"] < 6e-8
    assert 1e-8 < deviations["gamma'"] < 4e-8
    deviations = REFERENCES["car-axis"].deviations
    assert max(deviations.values()) < 1e-8
    assert deviations["yl'"] > 1e-10
    assert REFERENCES["simple-pendulum"].deviations == {}


def test_a_run_with_wrong_digits_is_a_miss(gyrospark, monkeypatch):
    """The command ends with exit code 1, and a sentence with the name."""
    problem = REFERENCES["spherical-pendulum"]
    values = dict(problem.truth.values) | {"z": "-0.97469253829"}
    monkeypatch.setattr("gyrospark.references.problem.truth",
                        lambda name: gs.references.Truth(values, "by hand", 1.0))
    answer = gyrospark("reference", "spherical-pendulum", "--quick", "--json")
    assert answer.code == 1
    assert "spherical-pendulum" in answer.stderr
    assert min(row["error"] for row in answer.document) > 1e-13


def test_the_command_prints_the_largest_deviation_of_published_digits(capsys):
    problem = REFERENCES["andrews"]
    _print(problem, [])
    assert f"{max(problem.deviations.values()):.0e}" in capsys.readouterr().out


def test_the_command(gyrospark, tmp_path):
    answer = gyrospark("reference", "spherical-pendulum", "--quick", "--json", "--out", "page.md",
                       "--plot", "error.svg")
    assert answer.code == 0, answer.stderr
    picture = (tmp_path / "error.svg").read_text(encoding="utf-8")
    assert "3-G-L" in picture
    assert re.search(r'<path d="[^"]*" clip-path="[^"]*" style="fill: none; stroke: #1f', picture)
    assert {"name", "scheme", "steps", "error", "cpu_seconds"} <= set(answer.document[0])
    assert answer.document[-1]["steps"] == 4000
    scene_reference = (tmp_path / "page.md").read_text(encoding="utf-8")
    stored = (ROOT / "docs" / "references.md").read_text(encoding="utf-8")
    assert "](error.svg)" in scene_reference
    with_stored_picture = scene_reference.replace("](error.svg)", "](references.png)")
    assert with_stored_picture.partition("\n|")[0] == stored.partition("\n|")[0]
    output = gyrospark("reference", "list").stdout
    assert all(name in output for name in REFERENCES)
    rows = gyrospark("reference", "list", "--json").document
    assert [row["name"] for row in rows] == list(gs.references.names())
    assert rows[1]["published"]["off_by"]["gamma'"] > 1e-8


def test_peers_reach_the_digits_by_themselves():
    """SciPy does so without multipliers; a missing program is left out, with a remark."""
    scene_reference = []
    runs = list(measure_peers(REFERENCES["neumann"], rounds=1, watch=scene_reference.append))
    scipy = [run for run in runs if run.peer == "SciPy"]
    assert [run.error < 10 * 10.0**power
            for run, power in zip(scipy, (-6, -9, -12, -13), strict=True)] == [True] * 4
    assert not reached(scipy)  # they do not count as ours
    if not any(run.peer == "heyoka" for run in runs):
        assert any("pip install heyoka)" in line for line in scene_reference)
    assert list(measure_peers(REFERENCES["car-axis"], watch=scene_reference.append)) == []
    assert "car-axis: " in scene_reference[-1]


@pytest.mark.parametrize(("arguments", "said"), [
    (["andrews", "--plot", "x.txt"], r"'x\.txt'.*\.png"),
    (["andrew"], "'andrew'.*andrews"),
    (["andrews", "--out", "x.txt"], r"'x\.txt'.*\.md"),
    (["andrews", "--out", "no/x.md"], "'no'"),
])
def test_refusals(arguments, said, gyrospark):
    answer = gyrospark("reference", *arguments)
    assert answer.code == 2
    assert re.search(said, answer.stderr)


@pytest.mark.parametrize(("arguments", "said"), [
    ({"problem": "andrews"}, "'andrews'"), ({"rounds": 0}, "rounds = 0"), ({"quick": 2}, "quick"),
])
def test_refused_measurements(arguments, said):
    arguments = {"problem": REFERENCES["andrews"]} | arguments
    with pytest.raises(gs.InputError, match=said):
        next(gs.references.measure(**arguments))


def test_the_page_is_what_the_command_writes():
    """Titles, digits and heads of tables agree; times depend on the machine that wrote them."""
    stored = (ROOT / "docs" / "references.md").read_text(encoding="utf-8")
    run = gs.references.WorkPrecisionRun("", "G-L", 1, 1.0, 1.0, {"energy": 0.0})
    written = page([(problem, [run]) for problem in REFERENCES.values()], "references.png")
    assert _fixed(written) == _fixed(stored)
    assert "missed" not in stored
    assert 0 < (ROOT / "docs" / "references.png").stat().st_size < 300_000


def _fixed(text):
    """Return the lines that no run changes: no rows of schemes, no summary, no invariants."""
    changing = re.compile(r"\| (`|\d-|G-L|LIIIA|EMS|IMS|SciPy|heyoka|exudyn|MuJoCo)|Invariants: ")
    return [line for line in text.splitlines() if not changing.match(line)]


def test_an_ellipsoid_begins_on_itself_along_the_x_axis():
    """The normal, e_x and the velocity of length 1 lie in one plane."""
    model = REFERENCES["ellipsoid"].make()
    axes, q, p = [1, 2, 4], [*model.q0], [*model.p0]
    n = [x / b for x, b in zip(q, axes, strict=True)]
    for value, expected in ((sum(map(mul, q, n)), 1), (sum(map(mul, p, n)), 0),
                            (sum(map(mul, p, p)), 1), (n[1] * p[2] - n[2] * p[1], 0)):
        assert abs(value - expected) < Fraction(1, 10**45)
    assert p[0] > 0
