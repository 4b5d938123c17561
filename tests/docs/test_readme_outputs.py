"""Outputs of commands in README, typed again; ``pytest --update`` pastes the answers.

Times vary and stay as they were pasted, for tests compile without optimisation; errors at the level
of round-off vary with the processor: words are compared to the letter, numbers by ``close``.
"""

from __future__ import annotations

import ast
import re

import pytest

import documents
import gyrospark as gs
import systems
from processes import ROOT

README = ROOT / "README.md"
TIME = re.compile(r"[\d.,]+ (?:ns|µs|ms|s)(?= a step)")
NUMBER = re.compile(r"\d[\d,]*(?:\.\d+)?(?:e[+-]?\d+)?")


def close(old: str, new: str) -> bool:
    """Compare within a factor of 10 below 1e-10, the level of round-off, else within a tenth."""
    a, b = (float(text.replace(",", "")) for text in (old, new))
    return max(a, b) < (10 * min(a, b) if max(a, b) < 1e-10 else 1.1 * min(a, b) + 1e-300)


def differences(old: str, new: str) -> list[tuple[str, str]]:
    """Return the pairs of lines that differ by more than times and round-off."""
    old, new = (TIME.sub("…", text) for text in (old, new))
    lines = list(zip(old.splitlines(), new.splitlines(), strict=False))
    return [pair for pair in lines if NUMBER.sub("#", pair[0]) != NUMBER.sub("#", pair[1])
            or not all(map(close, *map(NUMBER.findall, pair)))] or (
        [] if old.count("\n") == new.count("\n") else [(old, new)])


def compare(pattern: str, printed: str, request) -> None:
    """Compare the block of a pattern with the printed text, or paste the text in its place."""
    text = README.read_text(encoding="utf-8")
    (block,) = re.finditer(pattern, text, flags=re.DOTALL)
    times = iter(TIME.findall(block[1]))
    printed = TIME.sub(lambda time: next(times, time[0]), printed)
    if request.config.getoption("--update") and differences(block[1], printed):
        README.write_text(text[:block.start(1)] + printed + text[block.end(1):], "utf-8")
        return
    assert differences(block[1], printed) == [], "stale: `make generated`, or pytest --update"


def test_output_of_the_demo_is_up_to_date(request, gyrospark, gl3):
    pytest.importorskip("matplotlib")
    answer = gyrospark(*documents.recipe("demo").split()[1:])
    assert answer.code == 0, answer.stderr
    compare(r"\$ make demo\n(.*?)```", answer.stdout, request)


@pytest.mark.slow  # a stepper for this
def test_report_of_the_first_program_is_up_to_date(request, monkeypatch, tmp_path):
    program = documents.blocks(README, "python")[0].text
    call = next(node for node in ast.walk(ast.parse(program)) if isinstance(node, ast.Call)
                and ast.unparse(node.func) == "gs.stepper")
    assert ast.unparse(call) == "gs.stepper('G-L', stages=3, system=model)"
    step = systems.stepper("double_top", "G-L", 3)
    monkeypatch.setattr(gs, "stepper", lambda *_, **__: step)  # whose cost is no case's
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(compile(program, "README.md", "exec"), names)
    assert (tmp_path / "double_top.html").stat().st_size < 1e6
    compare(r"the errors of every step:\n\n```\n(.*?)```", f"{names['run'].report!r}\n", request)


@pytest.mark.parametrize(("old", "new", "differ"), [
    ("a 3.30, 2 s, 1.28 µs a step", "a 3.31, 2 s, 9.9 µs a step", False),
    ("mean 4.26", "mean 3.30", True), ("1.5e-16", "9e-16", False), ("1.5e-16", "2e-13", True),
    ("wrote a.png\n", "wrote b.png\n", True), ("one\n", "one\ntwo\n", True), ("", "one\n", True)])
def test_a_stale_output_is_seen(old, new, differ):
    assert bool(differences(old, new)) == differ
