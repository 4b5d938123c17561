"""The command line as people and scripts meet it: answers, exit codes, a line for each mistake."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import sys
from pathlib import Path

import click
import numpy as np
import pytest

import gyrospark as gs
from command_line import CONTRACT, EXAMPLE, FAILS, RUN, refused
from gyrospark.commands import generate as command
from gyrospark.commands.run.command import run
from processes import ROOT, call

IMS = ["run", "fast-top", "--scheme", "IMS", "--dt", "1e-3", "--steps", "5"]
TWO = ["--scheme", "G-L", "--stages", "2"]


def test_an_unknown_command_has_the_nearest(gyrospark):
    refused(gyrospark("runn"), "'runn'", "mean run?")


# ---------------------------------------------------------------- bad choices

SCHEMES = ["IMS", "EMS", "G-L", "LIIIA-B", "Radau-L"]
CHOICES = {
    "scheme": (["--scheme", "RK4"], ["'RK4'", *SCHEMES]),
    "scheme in the wrong case": (["--scheme", "ims"], ["'ims'", *SCHEMES]),
    "rep": (["--scheme", "IMS", "--rep", "beta"], ["'beta'", "alpha", "gamma"]),
    "system": (["--scheme", "IMS", "--system", "car"], ["heavy_top", "free_body"]),
    "real": (["--scheme", "IMS", "--real", "half"], ["'half'", "double", "float"]),
    "stages 0": (["--scheme", "G-L", "--stages", "0"], ["0", "1 to 16"]),
    "stages 17": (["--scheme", "G-L", "--stages", "17"], ["17", "1 to 16"]),
    "stages 1 of LIIIA-B": (["--scheme", "LIIIA-B", "--stages", "1"], ["1", "2 to 16"]),
    "stages three": (["--scheme", "G-L", "--stages", "three"], ["'three'", "whole number"]),
    "stages 9e999": (["--scheme", "G-L", "--stages", "9" * 999], ["whole number"]),
    "stages of IMS": (["--scheme", "IMS", "--stages", "2"], ["IMS", "no stages", "leave"]),
    "scheme and tableau": (["--scheme", "G-L", "--tableau", str(EXAMPLE)], ["leave out"]),
    "option": (["--scheme", "IMS", "--stage", "2"], ["--stage"]),
    "value missing": (["--scheme"], ["--scheme"]),
    "no such tableau": (["--tableau", "none.json"], ["'none.json'", "such file"]),
}


@pytest.mark.parametrize(("arguments", "fragments"), CHOICES.values(), ids=CHOICES.keys())
def test_bad_choice_is_refused(arguments, fragments, gyrospark, generate):
    """generate, its twin, verify and run have the same message: value, allowed ones, cure."""
    refused(generate(*arguments), *fragments)
    refused(gyrospark("generate", *arguments), *fragments)
    refused(gyrospark("verify", *arguments), *fragments)
    if "--system" not in arguments:
        refused(gyrospark("run", "fast-top", "--dt", "1e-3", "--steps", "5", *arguments),
                *fragments)
    assert not list(Path().iterdir())


NUMBERS = {
    "gamma word": (["--gamma", "mean"], ["--gamma", "'mean'", "m, h, mt, ht"]),
    "alpha 0": (["--scheme", "G-L", "--stages", "2", "--rep", "alpha", "--alpha", "0"],
                ["--alpha", "'0'", "other than 0"]),
    "alpha with gamma": (["--alpha", "m"], ["--alpha", "--rep gamma", "--gamma"]),
    "gamma with alpha": ([*TWO, "--rep", "alpha", "--gamma", "m"], ["--gamma", "--alpha"]),
    "steps too many": (["--steps", "9" * 18], ["memory", "every"]),
    "tolerance 0": (["--solver", "newton,tolerance=0"], ["tolerance", "not positive"]),
    "tolerance nan": (["--solver", "newton,tolerance=nan"], ["tolerance", "nan"]),
    "iterations 0": (["--solver", "auto,max_iterations=0"], ["max_iterations = 0", "at least 1"]),
    "setting": (["--set", "mass=2"], ["'mass=2'", "no settings"]),
}


@pytest.mark.parametrize(("arguments", "fragments"), NUMBERS.values(), ids=NUMBERS.keys())
def test_bad_value_is_refused_by_run(arguments, fragments, gyrospark):
    refused(gyrospark(*IMS, *arguments), *fragments)
    assert not list(Path().iterdir())


@pytest.mark.parametrize(("option", "file", "fragments"), [
    *((option, f"none/top{ending}", ["'none'"]) for option, ending in {
        "--out": ".npz", "--plot": ".png", "--show": ".gif"}.items()),
    ("--out", "", ["--out", "''"]), ("--out", ".", ["file name"]),
    ("--out", "top.xlsx", ["'top.xlsx'", ".npz, .csv, .nc, .parquet, .zarr"]),
    ("--plot", "top.txt", ["'top.txt'", ".png", ".svg", ".pdf"]),
    ("--show", "top.svg", ["'top.svg'", ".png", ".html", ".gif"]),
    ("--out", "top.npz --resume", ["--resume", ".zarr"]),
    ("--plot", "top.png --show ./top.png", ["--plot", "--show", "'top.png'"]),
    ("--show", "top.gif --show top.gif", ["--show", "'top.gif'"]),
])
def test_files_that_cannot_be_written_are_refused_before_the_run(
        option, file, fragments, gyrospark, monkeypatch):
    monkeypatch.setattr(gs.Stepper, "integrate",
                        lambda *arguments, **options: pytest.fail("it runs"))
    refused(gyrospark(*IMS, option, *(file.split() or [""])), *fragments)
    assert not list(Path().iterdir())


SETTINGS = {
    "inertia 0": (["inertia=0,1,1"], ["I1", "above 0"]),
    "no moment": (["inertia="], ["--set inertia", "''"]),
    "words": (["inertia=a,b,c"], ["--set inertia", "'a'"]),
    "unknown key": (["moment=1"], ["'moment=1'", "inertia", "angular_velocity", "attitude"]),
    "no value": (["inertia"], ["'inertia'", "KEY=VALUE"]),
    "attitude 0": (["attitude=0,0,0,0"], ["attitude", "zero"]),
    "angular velocity": (["angular_velocity=1,2"], ["angular_velocity", "3"]),
    "twice": (["inertia=1,1,1", "inertia=1,1,2"], ["inertia", "once"]),
    "two times": (["t=1", "t=2"], ["--set t", "once"]),
}


@pytest.mark.parametrize(("settings", "fragments"), SETTINGS.values(), ids=SETTINGS.keys())
def test_bad_setting_is_refused(settings, fragments, gyrospark):
    flags = [word for setting in settings for word in ("--set", setting)]
    refused(gyrospark("run", "free-body", "--scheme", "IMS", "--dt", "1e-3", "--steps", "5",
                      *flags), *fragments)


@pytest.mark.parametrize("setting", ["rate=0", "radius_ratio=-1", "density=inf", "height=1,2",
                                     "height=1e200"])
def test_bad_cone_is_refused(setting, gyrospark):
    """A number may be fine by itself, and overflow in a value that follows from it."""
    refused(gyrospark("run", "regular-precession", "--scheme", "IMS", "--dt", "1e-3", "--steps",
                      "5", "--set", setting))


@pytest.mark.parametrize(("arguments", "fragments"), [
    (["run", "slow-top", "--scheme", "IMS", "--dt", "1", "--steps", "1"],
     ["'slow-top'", "fast-top", "regular-precession", "free-body"]),
    (["run", "fast-top", "--scheme", "IMS", "--steps", "1"], ["--dt"]),
    (["run", "fast-top", "--scheme", "IMS", "--dt", "1"], ["--steps"]),
    (["fly"], ["fly"]),
    (["verify", "heavy_top_gl3"], ["'heavy_top_gl3'", "heavy_top_gl3_gamma"]),
    (["verify", "heavy_top_gl99_gamma"], ["99", "1 to 16"]),
    (["verify", "heavy_top_gl3_gamma", "--scheme", "G-L"], ["give one"]),
    (["verify", "heavy_top_gl3_gamma", "--energy"], ["--energy", "give one"]),
    (["build", "cpp", "fast-top", "--parameter", "mgl=1", "--parameter", "mgl=2"],
     ["mgl", "once"]),
    (["build", "cpp", "free-body", "--set", "inertia=1,1,1", "--set", "inertia=1,1,2"],
     ["inertia", "once"]),
    (["verify", "nothing.json"], ["'nothing.json'", "such file"]),
    (["cache", "burn"], ["burn"]),
    (["reference", "--out", "page.md"], ["--out", "name one"]),
    (["reference", "list", "--quick"], ["--quick", "name one"]),
    (["generate", "--all", "--scheme", "IMS"], ["--all", "leave out"]),
    (["generate", "--all", "--profile", "control"], ["--all"]),
    (["generate", "--profile", "contrl"], ["'contrl'", "control, run or full"]),
    (["generate", "--profile", "control", "--real", "long-double"], ["float or double"]),
    # an empty text, of a shell variable that is unset, is no default
    *((arguments, [f"{kind} ''"]) for arguments, kind in (
        (["verify", "--scheme", ""], "scheme"), (["verify", "--system", ""], "system"),
        (["generate", "--system", ""], "system"), (["generate", "--check", "--rep", ""],
                                                   "representation"))),
    (["generate", "--no-compile", "--out", ""], ["--out", "''"]),
    (["export", "", "table.csv"], ["STORE", "''"]),
])
def test_bad_command_is_refused(arguments, fragments, gyrospark):
    refused(gyrospark(*arguments), *fragments)


@pytest.mark.parametrize("command", ["", "generate", "verify", "run", "cache", "cache list"])
def test_help_has_examples(command, gyrospark):
    answer = gyrospark(*command.split(), "--help")
    assert answer.code == 0
    assert answer.stderr == ""
    assert "Usage: gyrospark" in answer.stdout
    assert all(len(line) <= 100 for line in answer.stdout.splitlines())
    if not command.startswith("cache"):
        assert re.search(r"^  (gyrospark|generate) .*--scheme", answer.stdout, re.MULTILINE)
    assert gyrospark(*command.split(), "-h").stdout == answer.stdout


# ---------------------------------------------------------------- run


def test_json_is_one_document_with_the_keys_of_the_contract(gyrospark):
    answer = gyrospark(*RUN, "--json")
    assert answer.code == 0
    assert answer.stderr == ""
    document = answer.document
    assert set(document) >= CONTRACT
    assert document["steps"] == 20
    assert document["dt"] == 1e-3
    assert document["t_end"] == pytest.approx(0.02)
    assert len(document["q"]) == len(document["p"]) == 4
    assert document["ns_per_step"] == pytest.approx(document["seconds"] / 20 * 1e9)
    top = gs.problems.fast_top()
    trajectory = gs.stepper("G-L", 2).integrate(
        top.q0, top.p0, dt=1e-3, steps=20,
        parameters=top.parameters | {"gamma": gs.gamma(top.inertia)})
    assert document["q"] == trajectory.q[-1].tolist()
    assert document["p"] == trajectory.p[-1].tolist()
    assert document["energy_error_max"] == abs(trajectory.energy() - trajectory.energy()[0]).max()
    assert document["energy_error_mean"] == pytest.approx(
        abs(trajectory.energy() - trajectory.energy()[0]).mean(), abs=1e-16)
    assert document["constraint_max"] == trajectory.report.constraint_max
    assert document["constraint_max"] == pytest.approx(  # 4 squares and 4 sums round in |q|² − 1
        abs((trajectory.q**2).sum(axis=1) - 1).max(), abs=4 * np.finfo(float).eps)
    assert document["iterations_max"] == trajectory.iterations.max()
    assert document["iterations_mean"] == trajectory.iterations.mean()


@pytest.mark.parametrize("arguments", [
    ["--gamma", "mt", "--dt", "-1e-3", "--every", "7"],
    ["--gamma", "0.001", "--steps", "0"], ["--steps", "1e1", "--solver", "newton"],
    ["--steps", "5.0", "--solver", "newton,tolerance=1e-9"],
    ["--every", "9" * 17, "--solver", "auto,max_iterations=" + "9" * 12],
    ["--scheme", "G-L", "--stages", "2", "--real", "float"],
])
def test_run_takes(arguments, gyrospark):
    answer = gyrospark(*IMS, *arguments, "--json")
    assert answer.code == 0, answer.stderr
    assert answer.stderr == ""
    assert set(answer.document) >= CONTRACT


def test_tables_4_and_6_come_out(gyrospark):
    """Regular precession has a closed form: axis errors are reported without an option."""
    answer = gyrospark("run", "regular-precession", "--scheme", "EMS", "--dt", "1e-3", "--steps",
                       "50", "--json")
    assert answer.document["axis_reference"] == "closed form"
    assert 0 < answer.document["axis_x_error_mean"] < 1e-2


def test_text_says_what_matters(gyrospark):
    answer = gyrospark(*RUN)
    assert answer.code == 0
    for word in ("constraint", "momentum", "energy", "iterations", "a step", "20 steps",
                 "order 4"):
        assert word in answer.stdout


def test_out_and_plot_are_written_and_named(gyrospark):
    pytest.importorskip("matplotlib")
    answer = gyrospark(*RUN, "--out", "top.npz", "--plot", "top.png", "--json")
    assert answer.code == 0, answer.stderr
    assert answer.document["out"] == "top.npz"
    assert answer.document["plot"] == ["top.png"]
    assert gs.load("top.npz").q.shape == (21, 4)
    assert Path("top.png").read_bytes().startswith(b"\x89PNG")
    assert sorted(p.name for p in Path().iterdir()) == ["top.npz", "top.png"]


@pytest.fixture(scope="module")
def late_failure():
    """Return a failure that is neither at step 1 nor behind a multiple of 3, and its command."""
    top = gs.problems.free_body(angular_velocity=(0.01, 60, 0.01))  # it turns over now and then
    step = gs.stepper("G-L", 2, system="free_body")
    parameters = {"gamma": gs.gamma(top.inertia)} | {
        name: value for name, value in top.parameters.items() if name in step.parameter_domains}
    for dt in np.arange(0.044, 0.08, 0.002).round(4).tolist():
        for limit in (6, 7, 8, 10):
            try:
                step.integrate(top.q0, top.p0, dt=dt, steps=400, parameters=parameters,
                               solver=gs.Solver("auto", max_iterations=limit))
            except gs.StepFailed as failure:
                if failure.step > 5 and (failure.step - 1) % 3:
                    return failure, ["run", "free-body", "--scheme", "G-L", "--stages", "2",
                                     "--set", "angular_velocity=0.01,60,0.01", "--dt", str(dt),
                                     "--steps", "400", "--solver",
                                     f"auto,max_iterations={limit}"]
    raise AssertionError("no run fails late")


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@pytest.mark.parametrize("options", [["--every", "3"], []], ids=" ".join)
def test_failed_step_is_reported_and_all_before_it_kept(late_failure, options, gyrospark):
    """Step, time and reason are on stderr, all states before in JSON and file; the code is 1."""
    failure, arguments = late_failure
    answer = gyrospark(*arguments, *options, "--json", "--out", "kept.npz")
    assert answer.code == 1
    assert answer.stderr.count("\n") == 1
    number = answer.document["failed"]["step"]
    assert number == failure.step
    for fragment in (f"Step {number:g} ", failure.reason, "t = ", "dt = "):
        assert fragment in answer.stderr
    document = answer.document
    assert set(document) >= CONTRACT
    assert document["steps"] == number - 1
    assert document["failed"]["t"] == pytest.approx((number - 1) * document["dt"])
    assert document["failed"]["reason"] == failure.reason
    saved = gs.load("kept.npz")
    assert len(saved) == (number - 1) // (3 if "3" in options else 1) + 1
    assert saved.report.steps == number - 1
    assert document["q"] == list(saved.report.q)


@pytest.mark.parametrize("options", [["--json"], ["--plot", "first.png", "--out", "first.npz"]],
                         ids=" ".join)
def test_failure_of_the_first_step(options, gyrospark):
    """Only the start is left, which is drawn and saved without a warning."""
    if "--plot" in options:
        pytest.importorskip("matplotlib")
    answer = gyrospark(*FAILS, "--solver", "auto,max_iterations=1", *options)
    assert answer.code == 1
    assert answer.stderr.count("\n") == 1
    assert "Step 1 " in answer.stderr
    assert "not converged" in answer.stderr
    assert "--json" in options or re.search("step 1 .*not converged", answer.stdout)


@pytest.mark.parametrize("arguments", [
    ["--dt", "1e300"], ["--dt", "1e-320"], ["--gamma", "1e-320"], ["--gamma", "1e308"],
    [*TWO, "--real", "float", "--dt", "1e-60"]], ids=" ".join)
def test_json_has_no_nan(arguments, gyrospark):
    """Numbers at the edge of the range are refused, fail in one line, or work; JSON stays JSON."""
    answer = gyrospark(*IMS, *arguments, "--json")
    assert answer.code in (0, 1, 2)
    assert answer.stderr.count("\n") == min(answer.code, 1)
    if answer.code == 2:  # H of the start is no number
        assert "H = nan" in answer.stderr
        assert not answer.stdout
    else:
        assert set(answer.document) >= CONTRACT


@pytest.mark.parametrize("setting", ["mass=1e300", "density=1e-300", "rate=1e150"])
def test_extreme_cones_end_in_one_line(setting, gyrospark):
    answer = gyrospark("run", "regular-precession", "--scheme", "EMS", "--dt", "1e-3", "--steps",
                       "5", "--set", setting, "--json")
    assert answer.code in (0, 1, 2)
    assert answer.stderr.count("\n") == min(answer.code, 1)
    if answer.code < 2:
        assert set(answer.document) >= CONTRACT


def test_a_result_that_cannot_be_saved_is_still_printed(gyrospark, monkeypatch):
    """The disk fills up during the run: numbers are printed, the exit code reports the loss."""
    def full(self, path, **options):
        raise gs.GyrosparkError(f"The trajectory cannot be written to {str(path)!r}: No space.")

    monkeypatch.setattr(gs.Trajectory, "save", full)
    answer = gyrospark(*RUN, "--out", "top.npz", "--json")
    assert answer.code == 2
    assert answer.document["steps"] == 20
    assert "No space" in answer.stderr
    assert answer.stderr.count("\n") == 1


# ---------------------------------------------------------------- generate


def test_generate_writes_three_files_and_reports(generate):
    answer = generate("--scheme", "G-L", "--stages", "2", "--rep", "gamma")
    assert answer.code == 0, answer.stderr
    assert answer.stderr == ""
    assert sorted(p.name for p in Path("generated").iterdir()) == [
        f"heavy_top_gl2_gamma.{end}" for end in ("c", "h", "json")]
    for fragment in ("heavy_top_gl2_gamma", "order 4", "18 unknowns", "operations", "compiled in",
                     " s"):
        assert fragment in answer.stdout


def test_generated_files_are_the_checked_in_ones(generate):
    assert generate("--scheme", "IMS", "--no-compile", "--out", "here").code == 0
    for path in Path("here").iterdir():
        assert path.read_bytes() == (ROOT / "generated" / path.name).read_bytes()


def test_named_stepper_is_derived_once(generate, monkeypatch, tmp_path):
    """The text is cached without the engine, and is derived anew where the cache is damaged."""
    monkeypatch.setenv("GYROSPARK_CACHE", str(tmp_path / "cache"))
    derived, derive = [], command._generate
    monkeypatch.setattr(command, "_generate",
                        lambda *a, **k: (derived.append(a), derive(*a, **k))[1])

    def written(*options):
        answer = generate("--scheme", "IMS", "--no-compile", "--out", "here", *options)
        assert "order 2, 9 unknowns" in answer.stdout
        return {path.name: path.read_bytes() for path in Path("here").iterdir()}

    assert written() == written()
    alone = written("--standalone")["heavy_top_ims_gamma.c"]
    assert len(derived) == 1
    assert b'#include "gyrospark/' not in alone
    (entry,) = (tmp_path / "cache").glob("*.source.json")
    entry.write_bytes(entry.read_bytes().replace(b"constraint", b"construint"))
    assert written("--standalone")["heavy_top_ims_gamma.c"] == alone
    assert len(derived) == 2


def test_check_says_up_to_date_or_shows_the_difference(generate):
    choice = ["--scheme", "IMS", "--out", "here"]
    assert generate(*choice, "--no-compile").code == 0
    answer = generate(*choice, "--check")
    assert answer.code == 0
    assert re.fullmatch("heavy_top_ims_gamma: .*\n", answer.stdout)
    source = Path("here/heavy_top_ims_gamma.c")
    good = source.read_bytes()
    source.write_bytes(good.replace(b" + ", b" - ", 1))
    assert source.read_bytes() != good
    answer = generate(*choice, "--check")
    assert answer.code == 1
    on_disk, generated = (
        re.search(rf"^\{sign} .*", answer.stdout, re.MULTILINE)[0] for sign in "-+")
    assert on_disk[1:] == generated[1:].replace(" + ", " - ", 1)
    assert re.search(r"^--- .*\n\+\+\+ .*\n@@ ", answer.stdout, re.MULTILINE)
    assert "STALE" in answer.stderr
    assert source.read_bytes() != good  # --check writes nothing


def test_check_sees_every_difference(generate):
    """Differences are other line ends, bytes that are no UTF-8, and a missing file."""
    choice = ["--scheme", "IMS", "--check"]
    for path in (ROOT / "generated").glob("heavy_top_ims_gamma.*"):
        shutil.copy(path, Path())
    path = Path("heavy_top_ims_gamma.h")
    good = path.read_bytes()
    for damaged in (b"", good.replace(b"\n", b"\r\n"), b"\xff\xfe" + good):
        path.write_bytes(damaged)
        answer = generate(*choice, "--out", ".")
        assert answer.code == 1
        assert "STALE" in answer.stderr
    assert generate(*choice, "--out", "nowhere").code == 1
    assert not Path("nowhere").exists()


def test_check_all_looks_at_every_stepper_of_the_paper(generate, monkeypatch):
    module = sys.modules["gyrospark.commands.generate"]
    monkeypatch.setattr(module, "PAPER_SPECS", module.PAPER_SPECS[1:4:2])
    answer = generate("--check", "--out", ROOT / "generated")
    assert answer.code == 0
    assert re.fullmatch("heavy_top_ims_gamma: .*\nheavy_top_ems_gamma: .*\n", answer.stdout)


@pytest.mark.parametrize("out", ["/proc/gyrospark", "/dev/null", "/dev/null/x", "file", "file/x"])
def test_output_folder_that_cannot_be_is_refused(out, generate):
    Path("file").touch()
    answer = generate("--scheme", "IMS", "--no-compile", "--out", out)
    refused(answer, "--out", f"'{out}'", "written")
    assert [p.name for p in Path().iterdir()] == ["file"]


def test_file_in_the_way_is_refused(generate):
    Path("here/heavy_top_ims_gamma.c").mkdir(parents=True)
    refused(generate("--scheme", "IMS", "--no-compile", "--out", "here"), "'here'", "--out")
    refused(generate("--scheme", "IMS", "--no-compile", "--out", "top.c"), "'top.c'", "folder")
    assert not list(Path("here").glob(".*"))


@pytest.fixture
def small_disk(tmp_path):
    """Mount a file system of 64 KiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if call(["mount", "-t", "tmpfs", "-o", "size=64k", "none", disk]).returncode:
        pytest.skip("mounting a small file system is not allowed here")
    yield disk
    call(["umount", "-l", disk])


def test_full_output_folder_is_reported(small_disk, generate):
    (small_disk / "filler").write_bytes(bytes(45_000))
    refused(generate("--scheme", "G-L", "--stages", "3", "--no-compile", "--out", small_disk),
            "space", "--out")
    for path in small_disk.glob("heavy_top*"):  # each is complete or not there
        assert path.read_bytes() == (ROOT / "generated" / path.name).read_bytes()
    assert not list(small_disk.glob(".*"))


def test_full_output_folder_of_run_is_reported(small_disk, gyrospark):
    answer = gyrospark(*IMS, "--steps", "3000", "--out", small_disk / "top.npz", "--json")
    assert answer.code == 2
    assert answer.document["steps"] == 3000
    assert "space" in answer.stderr
    assert not list(small_disk.iterdir())


def test_read_only_output_folder_is_reported(small_disk, generate, gyrospark):
    if call(["mount", "-o", "remount,ro", small_disk]).returncode:
        pytest.skip("remounting is not allowed here")
    refused(generate("--scheme", "IMS", "--no-compile", "--out", small_disk), "Read-only")
    refused(gyrospark(*IMS, "--out", small_disk / "top.npz"), "--out")


def test_no_compile_needs_no_compiler(generate, gyrospark, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setitem(sys.modules, "ziglang", None)
    assert generate("--scheme", "IMS", "--no-compile", "--out", "here").code == 0
    answer = generate("--scheme", "IMS", "--out", "there")
    refused(answer, "No C compiler", "gcc", "CC", "ziglang", "--no-compile")
    assert not Path("there").exists()


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="there is no /proc")
def test_a_folder_without_files_is_refused_with_its_reason(gyrospark):
    for name in ("x.csv", "x.zarr", "x.npz"):
        refused(gyrospark(*IMS, "--out", f"/proc/{name}"), f"'/proc/{name}'",
                os.strerror(errno.ENOENT))


# ---------------------------------------------------------------- verify

@pytest.mark.parametrize("arguments", [
    ["heavy_top_gl2_alpha"],
    *(pytest.param(choice, marks=pytest.mark.slow) for choice in ([EXAMPLE], [])),  # all of them
], ids=str)
def test_paper_steppers_hold(arguments, gyrospark):
    answer = gyrospark("verify", *arguments)
    assert answer.code == 0, answer.stderr
    assert answer.stderr == ""
    assert answer.stdout.splitlines()[-1].endswith("holds")
    assert "FAILS" not in answer.stdout


def test_verify_json_is_one_document(gyrospark):
    answer = gyrospark("verify", "--scheme", "G-L", "--stages", "2", "--json")
    assert answer.code == 0
    assert answer.stderr == ""
    document = answer.document
    assert document["holds"] is True
    (only,) = document["verified"]
    assert (only["name"], only["order"], only["holds"]) == ("heavy_top_gl2_gamma", 4, True)
    names = " ".join(line["name"] for line in only["conditions"])
    for word in ("B", "C", "symplectic", "symmetr", "order", "compiled coefficients"):
        assert word in names
    compiled = next(c for c in only["conditions"] if c["name"] == "compiled coefficients")
    assert compiled["residual"] == "0"


#: Of a tableau that misses one condition.
BENT = [["1/4 + 1/10000", "1/4 - sqrt(3)/6"], ["1/4 + sqrt(3)/6", "1/4"]]


def perturbed(**changes):
    content = json.loads(EXAMPLE.read_text(encoding="utf-8"))
    content.update(changes)
    Path("mine.json").write_text(json.dumps(content), encoding="utf-8")
    return "mine.json"


def test_violated_condition_is_named_and_refused_unless_allowed(gyrospark, generate, tmp_path):
    name = perturbed(A_hat=BENT, name="bent")
    answer = gyrospark("verify", name)
    assert answer.code == 1
    assert answer.stderr == ""
    document = gyrospark("verify", name, "--json").document
    assert document["holds"] is False
    failed = [c for c in document["verified"][0]["conditions"] if not c["holds"]]
    assert failed
    last = answer.stdout.splitlines()[-1]
    assert last.endswith("FAILS: " + ", ".join(c["name"] for c in failed))
    assert any("symplectic" in c["name"] for c in failed)
    assert all(c["residual"] not in ("0", "") for c in failed)
    refused(generate("--tableau", name), "'bent'", "violates", "verify", "--allow-invalid")
    assert not Path("generated").exists()
    answer = generate("--tableau", name, "--allow-invalid", "--no-compile")
    assert answer.code == 0, answer.stderr
    assert Path("generated/heavy_top_bent_gamma.c").is_file()


@pytest.mark.parametrize(("changes", "fragments"), [  # others of test_tableau_file.py
    ({"A": [["1/4"], ["1/4", "1/4"]]}, ["A", "row 1"]),
    ({"b": ["__import__('os').system('touch evil')", "1/2"]}, ["b", "entry 1"])])
def test_bad_tableau_file_is_refused(changes, fragments, gyrospark, generate):
    """The message has file, key and reason; nothing in the file is evaluated."""
    name = perturbed(**changes)
    for answer in (gyrospark("verify", name), generate("--tableau", name, "--no-compile"),
                   gyrospark("run", "fast-top", "--tableau", name, "--dt", "1e-3", "--steps", "1")):
        refused(answer, "'mine.json'", *fragments)
    assert [p.name for p in Path().iterdir()] == ["mine.json"]


def test_tableau_runs(gyrospark):
    """A run has the bits of Python and is near another method; first lines name lost properties."""
    path = EXAMPLE.with_name("radau_plain_2.json")
    size = ("--dt", "1e-3", "--steps", "20", "--json")
    answer = gyrospark("run", "free-body", "--tableau", path, *size)
    assert answer.code == 0, answer.stderr
    lines = gyrospark("run", "free-body", "--tableau", path, *size[:-1]).stdout.splitlines()
    assert [f"tableau: {remark}" for remark in answer.document["warnings"]] == lines[:2]
    assert ["not symplectic" in lines[0], "not symmetric" in lines[1]] == [True] * 2
    step = gs.stepper(tableau=path)
    run = step.integrate(gs.problems.free_body(), dt=1e-3, steps=20)
    assert answer.document["q"] == list(run.report.q)
    other_method = gyrospark("run", "free-body", "--scheme", "G-L", "--stages", "2", *size).document
    assert 1e-12 < np.abs(np.subtract(answer.document["q"], other_method["q"])).max() < 1e-3


def test_verify_model(gyrospark):
    verify = ("verify", "--model", "fast-top", "--scheme", "IMS", "--steps", "40")
    answer = gyrospark(*verify, "--json")
    assert answer.code == 0
    document = answer.document
    assert document["holds"] is True
    assert document["steps"] == 40
    assert {"quantity", "found", "expected", "holds", "why", "value", "bound"} <= set(
        document["lines"][0])
    text = gyrospark(*verify)
    assert text.code == 0
    assert "∮p·dq" in text.stdout
    assert all(line["found"].split()[0] in text.stdout for line in document["lines"])
    assert text.stdout.rstrip().endswith("holds")
    assert max(map(len, text.stdout.splitlines()[:-1])) <= 80


def test_verify_model_fails_for_a_broken_tableau(gyrospark):
    answer = gyrospark("verify", "--model", "fast-top", "--tableau",
                       perturbed(A_hat=BENT, name="bent"), "--steps", "100")
    assert answer.code == 1
    assert "FAILS: " in answer.stdout


@pytest.mark.parametrize(("arguments", "fragments"), [
    (["--model", "fast-top", "--system", "heavy_top"], ["--system"]),
    (["--model", "fast-top", "--real", "float"], ["--real"]),
    (["--model", "fast-top", "heavy_top_gl3_gamma"], ["besides --model"]),
    (["--model", "slow-top"], ["'slow-top'", "fast-top"]),
    (["heavy_top_ims_alpha", "--rep", "gamma"], ["--rep 'gamma'", "'heavy_top_ims_alpha'"]),
    (["--dt", "1e-3"], ["--dt", "--model"]),
    (["--model", "fast-top", "--dt", "x"], ["--dt", "not a number"]),
])
def test_verify_model_refuses(gyrospark, arguments, fragments):
    refused(gyrospark("verify", *arguments), *fragments)


def test_gamma_auto_reports_its_gain(gyrospark):
    """The report agrees with gs.tune."""
    run = ("run", "fast-top", "--scheme", "G-L", "--stages", "2", "--dt", "1e-3", "--steps", "80")
    step, top = gs.stepper("G-L", 2), gs.problems.fast_top()
    for word, aim in (("auto", "motion"), ("auto-energy", "energy")):
        document = gyrospark(*run, "--gamma", word, "--json").document
        tuned = gs.tune(step, top, dt=1e-3, steps=80, gamma="auto", aim=aim)
        assert document["parameters"]["gamma"] == tuned.parameters["gamma"]
        assert document["tuned"]["gain"] == tuned.gain > 1.2
        assert tuned.reason in gyrospark(*run, "--gamma", word).stdout
    assert "tuned" not in gyrospark(*run, "--json").document


def test_alpha_stays_where_it_is_idle(gyrospark):
    run = ("run", "fast-top", "--scheme", "G-L", "--stages", "2", "--rep", "alpha", "--dt", "1e-3",
           "--steps", "50")
    assert "α_m" in gyrospark(*run, "--alpha", "auto", "--json").document["tuned"]["reason"]
    refused(gyrospark(*run, "--gamma", "auto"), "--alpha")


# ---------------------------------------------------------------- cache


def test_cache_is_listed_and_cleared(gyrospark, generate, monkeypatch, tmp_path):
    monkeypatch.setenv("GYROSPARK_CACHE", str(tmp_path / "cache"))
    answer = gyrospark("cache", "list")
    assert answer.code == 0
    assert answer.stdout == f"0 files in {tmp_path / 'cache'}\n"
    assert gyrospark("cache", "clear").code == 0
    assert generate("--scheme", "IMS", "--no-compile").code == 0
    answer = gyrospark("cache", "list")
    assert "heavy_top_ims_gamma-" in answer.stdout
    stranger = tmp_path / "cache" / "thesis.tex"
    stranger.write_text("years of work", encoding="utf-8")
    answer = gyrospark("cache", "clear")
    assert re.fullmatch(r"[1-9] files .*\n", answer.stdout)
    assert [p.name for p in (tmp_path / "cache").iterdir()] == ["thesis.tex"]


def test_help_of_run_lists_every_option_once_under_a_heading(gyrospark):
    """The help also explains the settings of a robot."""
    text = gyrospark("run", "--help").stdout
    options = [parameter for parameter in run.params if isinstance(parameter, click.Option)]
    for option in options:
        lines = re.findall(rf"^  {option.opts[0]}(?![\w-])", text, re.MULTILINE)
        assert len(lines) == 1, option.name
    headings = re.findall(r"^([A-Z][\w ]+):$", text, re.MULTILINE)
    assert len(headings) >= 5
    for word in (".urdf", "ignore=", "base=floating"):
        assert word in text
