"""Frozen dataclasses with shared methods: equal, hashed and printed as the standard library's."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest

from gyrospark.core.records import dataclass, replace_fields


def make(decorator: Any, **options: Any) -> Any:
    """Return a class of fields that a decorator has processed."""

    @decorator(frozen=True, **options)
    class Point:
        x: Any
        y: Any = 2
        name: str = dataclasses.field(default="", compare=False)
        secret: int = dataclasses.field(default=0, repr=False)
        tags: Any = dataclasses.field(default=(), hash=False)

    return Point


@pytest.mark.parametrize("options", [{}, {"kw_only": True}, {"eq": False}, {"repr": False}])
def test_methods_are_those_of_the_standard_library(options):
    ours, theirs = make(dataclass, **options), make(dataclasses.dataclass, **options)
    nan = float("nan")
    values = [{"x": 1}, {"x": 1, "name": "a"}, {"x": 1, "secret": 1}, {"x": nan}, {"x": [1]},
              {"x": 1, "tags": [1]}, {"x": 1, "y": 3}]
    for a in values:
        assert (ours(**a) == ours(**a)) == (theirs(**a) == theirs(**a))
        for b in values:
            assert (ours(**a) == ours(**b)) == (theirs(**a) == theirs(**b))
        assert ours(**a) != theirs(**a)
    assert (repr(ours(x=1, secret=4)) == repr(theirs(x=1, secret=4))) == (options.get("repr", True))
    if options.get("eq", True):
        assert hash(ours(x=1, tags=[1])) == hash(theirs(x=1, tags=[1]))
        with pytest.raises(TypeError):
            hash(ours(x=[1]))


def test_fields_are_frozen_and_copied():
    point = make(dataclass)(1)
    for change in (lambda: setattr(point, "x", 2), lambda: delattr(point, "x"),
                   lambda: setattr(point, "z", 2)):
        with pytest.raises(dataclasses.FrozenInstanceError):
            change()
    assert dataclasses.replace(point, x=2) == replace_fields(point, x=2) == type(point)(2) != point
    assert [f.name for f in dataclasses.fields(point)] == ["x", "y", "name", "secret", "tags"]


def test_methods_of_the_class_stay():
    @dataclass(frozen=True)
    class Named:
        name: str

        def __repr__(self):
            return self.name

        def __eq__(self, other):
            return self.name.lower() == other.name.lower()

    assert repr(Named("a")) == "a"
    assert Named("a") == Named("A")
    assert hash(Named("a")) == hash(Named("a"))
