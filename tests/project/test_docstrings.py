"""Examples in public docstrings have the output they show; examples of long runs say so."""

from __future__ import annotations

import doctest
import inspect

import pytest

import gyrospark as gs


def public():
    """Yield the name of everything public with a docstring of ours: names, methods, functions."""
    yield "gyrospark", gs
    for name in gs.__all__:
        value = getattr(gs, name)
        yield name, value
        if isinstance(value, type):
            yield from ((f"{name}.{key}", member) for key, member in inspect.getmembers(
                value, inspect.isfunction) if not key.startswith("_"))
        elif inspect.ismodule(value):
            yield from ((f"{name}.{key}", getattr(value, key)) for key in value.__all__
                        if callable(getattr(value, key)))


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
