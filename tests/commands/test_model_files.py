"""Model files on the command line: examples run, malicious files are refused."""

from __future__ import annotations

import contextlib
import os
import signal
from pathlib import Path

import numpy as np
import pytest

import gyrospark as gs
import systems
from command_line import CONTRACT, ECCENTRIC, refused
from processes import PATIENCE, ROOT

EPS = float(np.finfo(float).eps)
EXAMPLES = sorted((ROOT / "examples").glob("*.toml"))
PENDULUM, SATELLITE = (ROOT / "examples" / f"{name}.toml" for name in ("pendulum", "satellite"))


@pytest.fixture
def document(gyrospark):
    """Return a function that runs a command, which must succeed, and returns its JSON."""
    def caller(*arguments):
        done = gyrospark(*arguments, "--json")
        assert done.code == 0, done.stderr
        assert done.stderr == ""
        return done.document

    return caller


# Each is derived and compiled; the others are read above.
@pytest.mark.parametrize("path", [
    path if path.stem == "pendulum"
    else pytest.param(path, marks=pytest.mark.slow) for path in EXAMPLES], ids=lambda p: p.stem)
def test_example_runs(path, document):
    """Twenty steps with the file's own dt keep every constraint."""
    result = document("run", path, "--scheme", "G-L", "--stages", "2", "--steps", "20")
    model = gs.load_model(path)
    assert set(result) >= CONTRACT
    assert result["problem"] == path.stem
    assert result["steps"] == 20
    assert result["dt"] == model.dt
    assert len(result["q"]) == model.system.n
    assert set(result["parameters"]) >= set(model.parameters) | set(model.bodies)
    size = max(1.0, *map(abs, result["q"]))
    assert result["constraint_max"] <= 64 * EPS * size**2
    assert np.isfinite(result["energy_error_max"])


def test_commands_in_the_headers_of_examples_exist():
    from gyrospark.commands.run.command import run

    options = {opt for p in run.params for opt in p.opts}
    for path in EXAMPLES:
        header = [line for line in path.read_text(encoding="utf-8").splitlines()
                  if line.startswith("#   gyrospark run")]
        assert header, path
        for line in header:
            words = line.removeprefix("#").split()
            assert words[2] == f"examples/{path.name}"
            assert {word for word in words if word.startswith("--")} <= options


def test_text_fits_the_system(orbit, gyrospark, document):
    done = gyrospark("run", PENDULUM, "--scheme", "IMS", "--steps", "5")
    assert "|g(q)|" in done.stdout
    assert "qᵀ" not in done.stdout
    done = gyrospark(*orbit, "--dtau", "0.1", "--steps", "5")
    assert done.code == 0, done.stderr
    assert "constraint" not in done.stdout
    result = document(*orbit, "--dtau", "0.1", "--steps", "5")
    assert result["constraint_max"] == result["momentum_constraint_max"] == 0


def test_start_typed_with_few_digits_is_moved_and_told(tmp_path, gyrospark, document):
    text = PENDULUM.read_text(encoding="utf-8").replace('q = ["l", 0]', "q = [0.3, 0.4001]")
    path = tmp_path / "rough.toml"
    path.write_text(text, encoding="utf-8")
    result = gyrospark("run", path, "--scheme", "IMS", "--steps", "5", "--json").document
    assert 1e-5 < result["start_moved"] < 1e-3
    assert "start_moved" not in document("run", PENDULUM, "--scheme", "IMS", "--steps", "5")
    warning = gyrospark("run", path, "--scheme", "IMS", "--steps", "5").stderr
    assert "constraints" in warning
    model, step = gs.load_model(path), gs.stepper("IMS", system=path)
    with pytest.warns(gs.errors.InputWarning, match="y = 0.4001"):
        run = step.integrate(model, steps=5)
    assert run.q[-1].tolist() == result["q"]
    with pytest.raises(gs.InputError, match="constraints"):
        step.integrate(model.q0, model.p0, dt=1e-3, steps=1, parameters=model.parameters)


@pytest.mark.parametrize("lengths", [[0.5, 0.6], [0.7, 0.7]])
def test_a_model_starts_on_the_constraints_of_its_run(lengths):
    """A start is projected with the parameters of its run, in an ensemble with its member's."""
    model, step = gs.load_model(PENDULUM), gs.stepper("G-L", stages=2, system=PENDULUM)
    with pytest.warns(gs.errors.InputWarning, match="constraints"):
        ensemble = step.integrate_ensemble(model, steps=3, parameters={"l": lengths})
    for member, length in zip(ensemble.members, lengths, strict=True):
        assert np.hypot(*member.q[0]) == pytest.approx(length, rel=1e-15)
        with contextlib.nullcontext() if length == 0.5 else pytest.warns(gs.errors.InputWarning):
            alone = step.integrate(model, steps=3, parameters={"l": length})
        assert member.q == pytest.approx(alone.q, rel=1e-14)


def test_models_in_doubles_start_in_float128():
    step = systems.stepper("heavy_top", real="float128")
    run = step.integrate(gs.problems.fast_top(), dt=1e-3, steps=2)
    assert run.report.constraint_max < 1e-32


def test_the_system_of_a_file_is_verified(document):
    result = document("verify", "--scheme", "IMS", "--system", PENDULUM)
    assert result["holds"]
    assert result["verified"][0]["name"] == "pendulum_ims"


def test_events_of_a_file_are_those_of_its_runs(tmp_path, gyrospark, document):
    path = tmp_path / "watched.toml"
    path.write_text(PENDULUM.read_text(encoding="utf-8")
                    + '\n[events]\nlow = "angle = 0"\nend = "x = -0.3 stop"\n', encoding="utf-8")
    model, step = gs.load_model(path), gs.stepper("G-L", stages=2, system=path)
    answer = document("run", path, "--stages", "2", "--scheme", "G-L")
    run = step.integrate(model)
    assert run.events["low"].t.tolist() == answer["events"]["low"]["t"]
    assert run.t[-1] == run.events["end"].t[0] == answer["ended"]["t"]
    assert run.t[-1] == answer["t_end"]
    assert (run.q[-1].tolist(), run.p[-1].tolist()) == (answer["q"], answer["p"])
    stored = step.integrate(model, out=tmp_path / "run.zarr")
    assert stored.ended_by == "end"
    np.testing.assert_array_equal(stored[:].q, run.q)
    assert not step.integrate(model, steps=200, events=()).events
    assert {*step.integrate(model, steps=9, events=gs.Event("x")).events} == {"x"}
    with pytest.raises(gs.InputError, match="terminal"):
        step.integrate_ensemble([model, model], steps=3, dt=1e-3, events=model.events)
    with pytest.raises(gs.InputError, match="terminal"):
        step.integrate_ensemble(model, steps=3, parameters={"m": [1.0, 2.0]})


@pytest.mark.parametrize("out", [(), ("--out", "run.zarr")])
def test_a_gap_that_stays_closed_ends_a_run_in_memory_and_in_a_store(
        out, gyrospark):
    """It does so at 3 √(2 h/g), where halved bounces add up, also in the last part of a step."""
    Path("bounce.toml").write_text(
        'name = "bounce"\ngravity = [0, 0, -9.81]\n[[point_masses]]\nname = "ball"\nmass = 1\n'
        'position = [0, 0, 1]\n[[contacts]]\nname = "floor"\nbodies = ["ball"]\n'
        "restitution = 0.5\n", encoding="utf-8")
    rest = 3 * np.sqrt(2 / 9.81)
    for t_end, ends in (("1.4", True), ("1.3549", True), ("1.34", False)):
        done = gyrospark("run", "bounce.toml", "--scheme", "G-L", "--stages", "2", "--dt", "0.01",
                         "--t-end", t_end, *(text.replace("run", t_end) for text in out), "--json")
        assert (done.code, "ended" in done.document, "floor" in done.stderr) == (0, ends, ends)
        if ends:
            assert done.document["ended"] == {"event": "floor", "t": pytest.approx(rest, abs=1e-14)}


def test_stepper_of_a_file_and_of_its_model_agree():
    model = gs.load_model(PENDULUM)
    run = {"dt": model.dt, "steps": 3, "parameters": dict(model.parameters)}
    ends = [gs.stepper("IMS", system=system).integrate(model.q0, model.p0, **run).q[-1]
            for system in (PENDULUM, str(PENDULUM), model, model.system)]
    assert all(np.array_equal(end, ends[0]) for end in ends)


def write(folder: Path, content: str | bytes) -> Path:
    path = folder / "hostile.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def pendulum(old: str, new: str) -> str:
    text = PENDULUM.read_text(encoding="utf-8")
    assert old in text
    return text.replace(old, new)


H = "(px**2 + py**2)/(2*m) + m*g*y"
HOSTILE = {
    "empty": ("", ["[body], [system]"]),
    "brackets": ("x = " + "[" * 200_000, ["nested"]),
    "tables": ("x = " + "{a = " * 40_000, ["nested"]),
    "dotted key": ("a" + ".a" * 100_000 + " = 1", ["dots"]),
    "huge integer": (pendulum("m = 1.0", "m = " + "9" * 5000), ["TOML"]),
    "parentheses": (pendulum(H, "(" * 1900 + "x" + ")" * 1900), ["nested"]),
    "import": (pendulum(H, "__import__('os').system('touch /tmp/x')"), ["meaning"]),
    "huge power": (pendulum(H, "x**10**9"), ["±64"]),
    "redundant": (pendulum('constraints = ["', 'constraints = ["x**2 + y**2 - l**2", "').replace(
        '["rod"]', '["rod", "again"]'), ["constraint"]),
    "off any constraint": (pendulum('q = ["l", 0]', "q = [0, 0]"), ["'rod'", "start elsewhere"]),
}


@pytest.fixture
def bounded(gyrospark):
    """Return the command line, with little memory and little patience."""
    resource = pytest.importorskip("resource")

    def impatient(number, frame):
        raise TimeoutError("no end")

    before = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    used = pages * resource.getpagesize()
    handler = signal.signal(signal.SIGALRM, impatient)
    resource.setrlimit(resource.RLIMIT_AS, (used + (3 << 30), before[1]))
    signal.alarm(PATIENCE)
    yield gyrospark
    signal.alarm(0)
    resource.setrlimit(resource.RLIMIT_AS, before)
    signal.signal(signal.SIGALRM, handler)


@pytest.mark.parametrize(("content", "fragments"), HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_file_is_refused(content, fragments, bounded, tmp_path):
    refused(bounded("run", write(tmp_path, content), "--scheme", "IMS", "--dt", "0.01", "--steps",
                    "5"), *fragments)


def test_paths_that_are_no_file(bounded, tmp_path):
    run = ("--scheme", "IMS", "--dt", "0.01", "--steps", "5")
    refused(bounded("run", tmp_path / "none.toml", *run), "such file")
    (tmp_path / "folder.toml").mkdir()
    refused(bounded("run", tmp_path / "folder.toml", *run), "regular")
    os.mkfifo(tmp_path / "pipe.toml")
    refused(bounded("run", tmp_path / "pipe.toml", *run), "regular")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    refused(bounded("run", tmp_path / "zero.toml", *run), "regular")
    with (tmp_path / "large.toml").open("wb") as file:
        file.truncate(50 * 2**20)
    refused(bounded("generate", "--scheme", "IMS", "--system", tmp_path / "large.toml"),
            "262144")


@pytest.mark.parametrize(("arguments", "fragments"), [
    (["--gamma", "m"], ["--gamma", "no body"]),
    (["--rep", "gamma"], ["rep 'gamma'", "[body]"]),
    (["--set", "m=0"], ["m", "divides"]),
    (["--stages", "2"], ["IMS", "no stages"]),
])
def test_options_that_do_not_fit_a_model(arguments, fragments, bounded):
    refused(bounded("run", PENDULUM, "--scheme", "IMS", *arguments), *fragments)


def test_what_a_run_lacks_is_said(bounded, tmp_path):
    refused(bounded("verify", PENDULUM), "--model", "--system")
    text = PENDULUM.read_text(encoding="utf-8")
    path = write(tmp_path, text.replace("dt = 0.005\n", ""))
    refused(bounded("run", path, "--scheme", "IMS"), "--dt", "pendulum")
    path = write(tmp_path, text.replace("steps = 2000\n", ""))
    refused(bounded("run", path, "--scheme", "IMS"), "--steps", "pendulum")


#: The system of test_run_names.py.
RULED = """
name = "settled"
potential = "k*R33"
[body]
inertia = [12, 10, "6*half"]
gamma = "{rule}"
[parameters]
half = 0.5
k = 1
spin = "8*half"
[start]
euler = [0, 0.1, 0]
angular_velocity = [0.3, 0.2, "spin/8"]
[run]
dt = 0.1
"""


@pytest.fixture
def ruled(tmp_path):
    """Return a function that writes the file of a body with a rule for its gamma."""
    def write(rule):
        path = tmp_path / "ruled.toml"
        path.write_text(RULED.format(rule=rule), encoding="utf-8")
        return path

    return write


def test_a_file_says_by_which_rule_gamma_is_found(ruled, document):
    """A rule in the file does what the option does, which overrides it, also in Python."""
    run = ("--scheme", "G-L", "--stages", "2", "--steps", "10")
    inertia = (12.0, 10.0, 3.0)
    expected = {"h": gs.gamma(inertia, "h"), "auto-energy": document(
        "run", ruled("h"), *run, "--gamma", "auto-energy")["parameters"]["gamma"]}
    assert len({*expected.values(), gs.gamma(inertia)}) == 3
    for rule, gamma in expected.items():
        path = ruled(rule)
        assert document("run", path, *run)["parameters"]["gamma"] == gamma
        model = gs.load_model(path)
        assert model.rules == {"gamma": rule}
        assert "gamma" not in model.parameters
    assert document("run", path, *run, "--gamma", "m")["parameters"]["gamma"] == gs.gamma(inertia)
    tops = systems.case("double_top").system
    numbers = {name: x for name, x in tops.parameters.items() if name != "a_gamma"}
    by_rule = gs.Model(tops.system, numbers, tops.q0, tops.p0, dt=tops.dt, bodies=tops.bodies,
                       rules={"a_gamma": "h"})
    assert gs.certify(by_rule, "G-L", 2, steps=10).parameters["a_gamma"] == gs.gamma(
        tops.bodies["a_gamma"], "h")


def test_a_sweep_has_no_motion_to_choose_for(ruled):
    axis = {"dt": [0.1, 0.2]}
    with pytest.raises(gs.InputError, match="gamma = 'auto'"):
        gs.sweep(ruled("auto"), axis, scheme="G-L", stages=2, steps=3)
    by_rule = gs.sweep(ruled("h"), axis, scheme="G-L", stages=2, steps=3)
    by_number = gs.sweep(ruled("m"), axis, scheme="G-L", stages=2, steps=3,
                         parameters={"gamma": gs.gamma((12.0, 10.0, 3.0), "h")})
    assert np.array_equal(by_rule["q"], by_number["q"])


def test_another_word_is_no_rule(ruled, gyrospark):
    done = gyrospark("run", ruled("automatic"), "--steps", "3")
    assert done.code == 2
    assert "gamma" in done.stderr
    model = gs.load_model(SATELLITE)
    arguments = {"parameters": model.parameters, "q0": model.q0, "p0": model.p0,
                 "bodies": model.bodies}
    with pytest.raises(gs.InputError, match=r"rules\['gamma'\].*auto"):
        gs.Model(model.system, **arguments, rules={"gamma": "automatic"})
    with pytest.raises(gs.InputError, match="rule for 'mu'"):
        gs.Model(model.system, **arguments, rules={"mu": "m"})


def test_rules_are_those_of_the_option(gyrospark):
    from gyrospark.core.registry import RULES

    help_text = "".join(gyrospark("run", "--help").stdout.split())
    assert f"--gamma{{{','.join(RULES)},NUMBER}}" in help_text


@pytest.fixture
def orbit(tmp_path):
    """Return the arguments of a run of the catalogue's eccentric orbit from a file."""
    path = tmp_path / "eccentric.toml"
    path.write_text(ECCENTRIC)
    return "run", str(path), "--scheme", "G-L", "--stages", "2"


def test_a_run_in_scaled_time_is_that_of_python(orbit, document, gyrospark):
    step, entry = systems.stepper("eccentric"), systems.case("eccentric")
    run = step.integrate(gs.Start(entry.q, entry.p, entry.parameters), dtau=0.1, t_end=7)
    result = document(*orbit, "--dtau", "0.1", "--t-end", "7")
    assert result.keys() >= CONTRACT
    assert result["t_end"] == run.t[-1] == 7
    for name in ("q", "p"):
        assert np.abs(result[name] - getattr(run, name)[-1]).max() < 1e3 * EPS
    assert result["steps"] == run.report.steps
    assert result["dtau"] == 0.1
    # the mean lies between those of the whole steps and of all with the short last one
    assert result["dt_min"] < 7 / (result["steps"] + 1) < result["dt"] < 7 / result["steps"]
    assert result["dt"] * run.tau[-1] == pytest.approx(0.7, rel=4 * EPS)
    assert result["dt"] < result["dt_max"]
    assert "0.1" in gyrospark(*orbit, "--dtau", "0.1", "--steps", "3").stdout


def test_a_stored_run_in_scaled_time_is_resumed(orbit, document, tmp_path, gyrospark):
    out = "--dtau", "0.1", "--out", str(tmp_path / "a.zarr")
    document(*orbit, *out, "--steps", "20")
    resumed = document(*orbit, *out, "--steps", "40", "--resume")
    full_run = document(*orbit, "--dtau", "0.1", "--steps", "40")
    assert resumed["resumed_at"] == 20
    assert (resumed["q"], resumed["t_end"]) == (full_run["q"], full_run["t_end"])
    refused(gyrospark(*orbit, *out[:3], str(tmp_path / "b.zarr"), "--t-end", "5"), "t_end", "steps")


def test_steps_of_scaled_time_are_asked_for(orbit, document, gyrospark):
    refused(gyrospark(*orbit, "--dt", "0.1", "--t-end", "5"), "0.1", "dtau")
    refused(gyrospark(*orbit, "--t-end", "5"), "dtau")
    refused(gyrospark("run", "fast-top", "--dtau", "0.1", "--steps", "5"), "0.1", "dt")
    result = document(*orbit, "--dtau", "0.4", "--step-error", "1e-5", "--t-end", "7")
    assert result["tuned"]["error"] <= 1e-5
    assert result["dtau"] == result["tuned"]["dt"] < 0.2


def test_a_sweep_and_a_fit_in_scaled_time_are_those_of_python(orbit, document, gyrospark, tmp_path):
    """Cells of a study have rows of equal τ; samples of the fit lie between steps of its run."""
    study = tmp_path / "eccentricities.toml"
    study.write_text("""model = "eccentric.toml"
scheme = "G-L 2"
dtau = 0.1
steps = 12
[grid]
k = [1.0, 1.1]
""")
    summary = document("sweep", study, "--out", tmp_path / "e.zarr", "--show", "t")
    run = systems.run("eccentric", systems.stepper("eccentric"), 12)
    cells = gs.load_sweep(tmp_path / "e.zarr")
    assert abs(float(cells.t[0]) - run.t[-1]) < 1e3 * EPS
    assert summary["least"] == float(cells.t.min())
    table = tmp_path / "seen.csv"
    document(*orbit, "--dtau", "0.05", "--steps", "60", "--every", "7", "--out", table)
    fit = document("fit", orbit[1], table, *orbit[2:], "--dtau", "0.05", "--observe", "x,y",
                   "--set", "parameters.k=1.01", "--free", "k")
    assert abs(fit["parameters"]["k"] - 1) < 1e-9
    refused(gyrospark("fit", orbit[1], table, *orbit[2:], "--observe", "x,y"), "dtau")


def test_a_certificate_in_scaled_time(orbit, document, gyrospark):
    result = document("verify", "--model", *orbit[1:], "--dtau", "0.1", "--steps", "40")
    assert result["holds"]
    assert (result["dt"], result["steps"]) == (0.1, 40)
    verify = "verify", "--model", *orbit[1:]
    assert "τ" in gyrospark(*verify, "--dtau", "0.1", "--steps", "4").stdout
    refused(gyrospark(*verify), "dtau")
    refused(gyrospark(*verify, "--dtau", "0.1", "--plot", "a.png"), "--plot")


#: A particle that runs to x = 0, where its potential ends, and no step leads on.
TO_THE_ROOT = """
name = "root"
[system]
coordinates = ["x"]
momenta = ["u"]
hamiltonian = "u**2/2 + sqrt(x)"
forces = ["0.1"]
[quantities]
twice = "2*x"
logarithm = "log(x - 1/2)"
[start]
q = [1]
p = [-1]
[run]
dt = 0.1
steps = 100
"""


@pytest.mark.parametrize("out", [(), ("--out", "x.zarr")], ids=["memory", "store"])
def test_the_numbers_of_an_end_belong_to_one_state(out, tmp_path, gyrospark):
    """A run fails behind its last row; its quantity log(-0.3), which JSON has not, is null."""
    path = tmp_path / "root.toml"
    path.write_text(TO_THE_ROOT)
    answer = gyrospark("run", path, "--stages", "2", "--every", "5", "--json", *out)
    result = answer.document
    assert (answer.code, "failed" in result, result["steps"] % 5 > 0) == (1, True, True)
    assert result["t_end"] == pytest.approx(result["failed"]["t"], rel=4 * EPS)
    assert result["quantities"] == {"twice": 2 * result["q"][0], "logarithm": None}
    # the energy balance of that state
    (x,), (u,) = result["q"], result["p"]
    assert u**2 / 2 + x**0.5 - result["energy_start"] - result["work"] == pytest.approx(
        0, abs=2 * result["energy_error_max"])
