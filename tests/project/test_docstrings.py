"""Examples in public docstrings do what they show; those of runs that are too long say so."""

from __future__ import annotations

import doctest
import inspect

import pytest

import gyrospark as gs


def public():
    """Yield the name of everything public with a docstring of ours: names, methods, functions."""
    yield "gyrospark", gs
    for name in gs.__all__:
        thing = getattr(gs, name)
        yield name, thing
        if isinstance(thing, type):
            yield from ((f"{name}.{key}", one) for key, one in inspect.getmembers(
                thing, inspect.isfunction) if not key.startswith("_"))
        elif inspect.ismodule(thing):
            yield from ((f"{name}.{key}", getattr(thing, key)) for key in thing.__all__
                        if callable(getattr(thing, key)))


EXAMPLES = {name: test for name, thing in public()
            for test in doctest.DocTestFinder(recurse=False).find(thing, name, globs={})
            if any(doctest.SKIP not in example.options for example in test.examples)}


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_of_a_docstring(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    result = doctest.DocTestRunner().run(EXAMPLES[name])
    assert result.failed == 0, capsys.readouterr().out


def test_there_are_examples():
    assert {"gyrospark", "Multibody", "stepper", "tune", "cite"} <= EXAMPLES.keys()
