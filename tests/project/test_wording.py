"""Tests look for names and values in messages, so that a sentence can be mended without them."""

from __future__ import annotations

import pytest

from messages import Sought, plain_words
from processes import ROOT

#: More than two words of prose, and why they are none.
NAMES = {
    "angular momentum about the body's axis 3": "the name of a quantity that is kept",
}


@pytest.mark.parametrize(("text", "words"), [
    ("gamma = 'x' is neither", 2), ("'beta'.*alpha or gamma", 0), (r"dt = 0\.1.*steps", 1),
    ("there is no such file", 5), (r"cannot be written to .*\.npz", 4), ("{} of 20 steps", 2),
    ("choose auto, newton or python", 1), (r"\[parameters\] m\b", 0), ("--out is", 1)])
def test_words_of_prose_are_distinguished_from_names(text, words):
    assert len(plain_words(text)) == words


def test_what_is_looked_for_is_found():
    source = '''
TABLE = {"a": (1, "one of a table"), "b": (2, "another")}
@pytest.mark.parametrize(("x", "words"), [(1, "in a row"), pytest.param(2, "of param", id="z")])
def test_a(x, words):
    with pytest.raises(ValueError, match=words): f()
@pytest.mark.parametrize(("x", "parts"), TABLE.values())
def test_b(x, parts):
    for part in parts:
        assert part in str(error.value)
    for call, said in [(f, "of a loop"), (g, f"{x} put in")]:
        refused(call(), said, "at once")
    assert answer.stderr == "all of it"
    assert "no message" in table
'''
    assert {text for _, text in Sought(source).found} == {
        "one of a table", "another", "in a row", "of param", "of a loop", "{} put in", "at once",
        "all of it"}


@pytest.mark.parametrize("folder", sorted(p.name for p in (ROOT / "tests").iterdir()
                                          if p.is_dir() and p.name not in ("data", "__pycache__")))
def test_no_sentence_is_looked_for(folder):
    """A pattern has at most two words of prose: a key word, a name, a value."""
    for path in sorted((ROOT / "tests" / folder).rglob("*.py")):
        for line, text in sorted(Sought(path.read_text(encoding="utf-8")).found):
            assert len(plain_words(text)) <= 2 or text in NAMES, f"{path}:{line}: {text!r}"
