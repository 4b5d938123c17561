"""The command line, run in this process just as ``main`` runs it.

Arguments are grown from a grammar of the real commands, options and values, then some are changed.
Work is kept tiny by which values the grammar knows, never by changing the program; what takes
seconds even then (deriving) gets an option that is refused, but for a rare few.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

from gyrospark import commands

from .choices import Choices
from .file_texts import MODEL, TABLEAU
from .mutations import changed_text
from .scratch import scratch

#: Values of options; those in front are good ones. None of them asks for much work.
STEPPERS = (
    ("IMS", None), ("EMS", None), ("G-L", "1"), ("G-L", "2"), ("G-L", "3"), ("G-L", "4"),
    ("LIIIA-B", "2"), ("LIIIA-B", "3"), ("LIIIA-B", "5"),
)
MODELS = ("pendulum.toml", "satellite.toml", "dragged_top.toml")
VALUES: dict[str, Sequence[str]] = {
    "--scheme": ("IMS", "EMS", "G-L", "LIIIA-B", "gl", "G-L ", "SPARK", "", "g-l"),
    "--stages": ("2", "3", "1", "0", "-1", "17", "3.0", "١", "1e0", "9"*20, "", "x"),
    "--rep": ("gamma", "alpha", "beta", "", "GAMMA"),
    "--system": ("heavy_top", "heavy-top", "pendulum.toml", "none.toml", "bad.toml", ".toml", "",
                 "light_top", "folder.toml"),
    "--tableau": ("gauss_3_2.json", "none.json", "bad.json", "folder.toml", "", "pendulum.toml",
                  "radau_plain_2.json"),
    "--real": ("double", "double", "half", "", "float32", "Double"),
    "--gamma": ("m", "h", "mt", "ht", "fast", "0.001", "-1", "0", "nan", "inf", "1e-320", "1e308",
                "auto", "auto-energy", "m,h", "", "γ", "1_0"),
    "--alpha": ("m", "h", "0.001", "0", "nan", "x"),
    "--dt": ("1e-3", "-1e-3", "0", "nan", "inf", "1e308", "5e-324", "1e999", "1_0", "٣", "",
             "0x1p3", "1e-3 "),
    "--steps": ("1", "0", "10", "7", "200", "-1", "1.5", "9999999999999999999", "1e3", "", "x"),
    "--every": ("1", "3", "0", "-2", "999999999999999999", "x"),
    "--solver": ("auto", "newton", "fixed-point", "magic", "", "newton,tolerance=1e-10", ",",
                 "auto,max_iterations=1", "newton,tolerance=nan", "auto,max_iterations=-1",
                 "newton,tolerance=1e-300,max_iterations=2", "auto,steps=1", "auto,tolerance",
                 "auto,max_iterations=1,max_iterations=2"),
    "--set": ("radius_ratio=1.5", "radius_ratio=0", "radius_ratio=nan", "inertia=2,1.3,0.8",
              "inertia=0,0,0", "inertia=1,1", "angular_velocity=1,2,3",
              "angular_velocity=1e300,0,0", "x=1", "=", "",
              "inertia", "inertia=,", "rate=1", "density=-1", "mass=1e-300",
              "attitude=0,0,0", "inertia=1e-310,1e-310,1e-310", "gravity=0"),
    "--out": ("out", "out.npz", "out.zarr",
              "folder.toml", "none/out.npz", ".", "", "..", "x\0y",
              "pendulum.toml"),
    "--plot": ("plot.png", "plot.xyz", "none/plot.png", "", ".", "plot"),
    "--t-end": ("1", "2", "nan", "-1", "1e999", "x"),
    "--model": ("fast-top", "free-body", "pendulum.toml", "none.toml", "bad.toml", "bad", ""),
    "--summary": ("summary.md", "none/summary.md", ""),
}
FLAGS = ("--resume", "--json", "--check", "--all", "--no-compile", "--allow-invalid",
         "--quick", "--help", "-h", "--version")
SHARED = ("--scheme", "--stages", "--rep", "--system", "--tableau", "--real")
RUN = ("--gamma", "--alpha", "--dt", "--steps", "--every", "--solver", "--set", "--out", "--json",
       "--resume")
PROBLEMS = ("fast-top", "regular-precession", "free-body", "pendulum.toml", "satellite.toml",
            "dragged_top.toml", "bad.toml", "none.toml", "slow-top", "", "fast_top", ".toml")
TARGETS = ("heavy_top_gl3_gamma", "heavy_top_ims_alpha", "gauss_3_2.json", "bad.json", "none.json",
           "heavy_top_gl99_gamma", "heavy_top_gl3", "", "pendulum.toml", "folder.toml")
RESULTS = ("table-1", "table-99", "figure-1", "finding-", "", "all ", "table_4", "Table-4")
#: Each is refused before any work: what takes long is not begun.
FAULTS = (["--nonsense"], ["--scheme", "nobody"], ["--stages", "x"], ["--real", "half"],
          ["--system", "none.toml"], ["--rep", "beta"], ["--tableau", "none.json"])
WORDS = ("--", "-", "=", "--json=1", "--steps=2", "-h", "\0", "\n", "é", "\udcff", "%s", "{}", "~",
         "$HOME", "*", "'", '"')


def arguments(choices: Choices) -> list[str]:
    """Return the words behind ``gyrospark``."""
    command = choices.pick(("run", "run", "run", "run", "generate", "verify", "reproduce", "cache",
                            "export", "", "unknown"))
    words = GROWERS[command](choices) if command in GROWERS else [
        choices.pick((*FLAGS, *WORDS)) for _ in range(choices.below(3))]
    for _ in range(max(0, choices.below(6) - 3)):
        change(words, choices)
    return [*([command] if command else []), *words]


def change(words: list[str], choices: Choices) -> None:
    """Leave out, double, swap or change a word; what keeps work away may not stand in danger."""
    if not words:
        return
    at = choices.below(len(words))
    kind = choices.below(5)
    if kind == 0:
        del words[at]
    elif kind == 1:
        words.insert(at, words[at])
    elif kind == 2:
        words.insert(at, choices.pick(WORDS))
    elif kind == 3:
        words[at] = changed_text(words[at], choices, WORDS).replace("/", "").replace("~", "")
    else:
        words.insert(at, choices.pick(tuple(VALUES)))


def option(choices: Choices, name: str) -> list[str]:
    if name in FLAGS:
        return [name]
    known = VALUES[name]
    value = known[choices.below(len(known))] if choices.one_in(2) else known[
        choices.below(min(2, len(known)))]
    return [f"{name}={value}"] if choices.one_in(5) else [name, value]


def some(choices: Choices, names: Sequence[str], most: int) -> list[str]:
    return [word for _ in range(choices.below(most))
            for word in option(choices, choices.pick(names))]


def stepper(choices: Choices) -> list[str]:
    """Return a good --scheme with --stages."""
    scheme, stages = choices.pick(STEPPERS)
    return ["--scheme", scheme, *([] if stages is None else ["--stages", stages])]


def run(choices: Choices) -> list[str]:
    good = not choices.one_in(3)
    problem = choices.pick(PROBLEMS[:6] if good else PROBLEMS)
    # Of each model few steppers, and those of good words only: they are derived once.
    spec = ["--scheme", choices.pick(("EMS", "IMS"))] if problem.endswith(".toml") else (
        stepper(choices))
    length = ["--dt", choices.pick(VALUES["--dt"][:2] if good else VALUES["--dt"]),
              "--steps", choices.pick(VALUES["--steps"][:4] if good else VALUES["--steps"])]
    more = some(choices, RUN, 4 if good else 6)
    return [problem, *spec, *length, *more, *([] if good else some(choices, SHARED, 2))]


def generate(choices: Choices) -> list[str]:
    if choices.one_in(200):
        return ["--scheme", choices.pick(("IMS", "EMS")), "--no-compile", "--out", "made"]
    words = [*stepper(choices), *some(choices, (*SHARED, "--out", "--check", "--no-compile"), 4)]
    return [*words, *choices.pick(FAULTS)]


def verify(choices: Choices) -> list[str]:
    if choices.one_in(100):
        return [choices.pick(TARGETS[:3]), "--json"]
    names = (*SHARED, "--model", "--dt", "--steps", "--json")
    target = [choices.pick(TARGETS)] if choices.one_in(2) else stepper(choices)
    return [*target, *some(choices, names, 4), *choices.pick(FAULTS)]


def reproduce(choices: Choices) -> list[str]:
    return [choices.pick(RESULTS), *some(choices, ("--json", "--out", "--summary"), 3)]


def cache_command(choices: Choices) -> list[str]:
    return [choices.pick(("list", "clear", "", "empty", "--help")), *some(choices, FLAGS, 2)]


def export(choices: Choices) -> list[str]:
    stores = ("sound.zarr", "sound.zarr", "out.zarr", "none.zarr", "folder.toml", "out.npz",
              "pendulum.toml", "")
    targets = ("e.npz", "e.csv", "e.nc", "e.txt", "e", "", "none/e.npz", "folder.toml", "e.NC")
    return [choices.pick(stores), choices.pick(targets)]


GROWERS = {"run": run, "generate": generate, "verify": verify, "reproduce": reproduce,
           "cache": cache_command, "export": export}


# ---------------------------------------------------------------- running it


@cache
def folder() -> Path:
    """Return a folder with the examples, in which commands are run."""
    from processes import ROOT

    made = scratch() / "a" / "b" / "here"  # what an argument calls ".." is ours as well
    made.mkdir(parents=True)
    for path in (*(ROOT / "examples").glob("*.toml"),
                 *(ROOT / "examples" / "tableaux").glob("*.json")):
        shutil.copy(path, made)
    (made / "folder.toml").mkdir()
    return made


@cache
def store() -> Path:
    """Return a sound stored run."""
    words = ["run", "fast-top", "--scheme", "IMS", "--dt", "1e-3", "--steps", "10", "--every", "2",
             "--out", "sound.zarr"]
    code, _, err = call(words)
    assert code == 0, err
    return folder() / "sound.zarr"


def passed(word: str) -> str:
    """Return a word as a system passes it: any bytes but NUL, which Python decodes."""
    return os.fsdecode(word.replace("\0", "").encode("utf-8", "surrogatepass"))


def call(words: Sequence[str], program: str = "gyrospark") -> tuple[Any, str, str]:
    """Return exit code, stdout and stderr of a command line."""
    entry = commands.main if program == "gyrospark" else commands.main_generate
    streams = [io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors=errors)
               for errors in ("strict", "backslashreplace")]
    before = sys.argv, sys.stdout, sys.stderr, os.getcwd()  # noqa: PTH109
    sys.argv, sys.stdout, sys.stderr = [program, *words], *streams
    os.chdir(folder())
    try:
        code = ended(entry)
    finally:
        sys.argv, sys.stdout, sys.stderr = before[:3]
        os.chdir(before[3])
    for stream in streams:
        stream.flush()
    out, err = (stream.buffer.getvalue().decode() for stream in streams)  # type: ignore[attr-defined]
    return code, out, err


def ended(entry: Any) -> Any:
    try:
        entry()
    except SystemExit as end:
        return end.code
    raise AssertionError("the command line returned instead of ending")


@contextlib.contextmanager
def cache_for(words: Sequence[str]) -> Iterator[None]:
    """Give ``cache clear`` another folder than the one that spares us compiling."""
    before = os.environ.get("GYROSPARK_CACHE")
    if "cache" in words:
        os.environ["GYROSPARK_CACHE"] = str(scratch() / "cache")
    try:
        yield
    finally:
        os.environ.pop("GYROSPARK_CACHE", None)
        if before is not None:
            os.environ["GYROSPARK_CACHE"] = before


def check(data: bytes) -> str:
    """Run one command line: an exit code of the four, and one line where input is bad."""
    choices = Choices(data)
    bad = choices.below(16)
    words = arguments(choices)
    place = folder()
    (place / "bad.toml").write_bytes(MODEL.content(choices) if bad == 1 else b"name = 1\n")
    (place / "bad.json").write_bytes(TABLEAU.content(choices) if bad == 2 else b"{}")
    store()
    words = [passed(word) for word in words]
    with cache_for(words):
        if words[:1] == ["generate"] and bad == 3:
            code, out, err = call(words[1:], "generate")
        else:
            code, out, err = call(words)
    examine(words, code, out, err)
    return {0: "accepted", 1: "failed step or check", 2: "refused", 130: "interrupted"}[code]


def examine(words: Sequence[str], code: Any, out: str, err: str) -> None:
    """Fail unless a command ended as promised."""
    about = f"{words}: {code!r}\n{out[-500:]}\n{err[-1500:]}"
    assert code in (0, 1, 2, 130), about
    assert "Traceback" not in out + err, about
    if code == 2:
        usage = "Usage:" in err  # a command without arguments shows its help
        assert err.strip(), about
        assert usage or len(err.splitlines()) == 1, about
        assert usage or err.startswith(("gyrospark: ", "generate: ")), about
    if code == 0:
        assert not err, about
        if "--json" in words and "Usage:" not in out and "--version" not in words:
            json.loads(out, parse_constant=refuse_constant)
    return


def refuse_constant(name: str) -> NoReturn:
    raise AssertionError(f"{name} is no JSON")
