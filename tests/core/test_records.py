"""Frozen dataclasses with shared methods: equal, hashed and printed as the standard library's."""

from __future__ import annotations

import dataclasses
import inspect
from typing import Any

import pytest

from gyrospark.core.records import changed, dataclass


def make(decorator: Any, **options: Any) -> Any:
    """Return a class of fields that a decorator has made."""

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


def test_arguments_are_those_of_the_standard_library():
    """Defaults, factories, keywords, fields without an argument and what follows: as there."""
    def derived(decorator: Any) -> Any:
        @decorator(frozen=True)
        class Base:
            x: int
            entries: list[int] = dataclasses.field(default_factory=list)
            made: dict[str, int] = dataclasses.field(default_factory=dict, init=False)

        @decorator(frozen=True, kw_only=True)
        class Derived(Base):
            y: int
            z: float = 1.5

            def __post_init__(self) -> None:
                self.made["y"] = self.y

        return Derived

    ours, theirs = derived(dataclass), derived(dataclasses.dataclass)
    assert str(inspect.signature(ours)) == str(inspect.signature(theirs))
    for arguments, named in (((1,), {"y": 2}), ((1, [3]), {"y": 2, "z": 0.5})):
        assert repr(ours(*arguments, **named)) == repr(theirs(*arguments, **named))
        assert vars(ours(*arguments, **named)) == vars(theirs(*arguments, **named))
    assert ours(1, y=2).entries is not ours(1, y=2).entries
    for arguments, named in (((), {"y": 2}), ((1, [], 2), {"y": 2}), ((1,), {}), ((1,), {"w": 1})):
        texts = []
        for record in (ours, theirs):
            with pytest.raises(TypeError) as error:
                record(*arguments, **named)
            texts.append(str(error.value).rpartition(".")[2])
        assert texts[0] == texts[1]
    with pytest.raises(TypeError):
        dataclass(frozen=False)(object)


def test_dataclasses_of_the_standard_library_inherit():
    @dataclasses.dataclass(frozen=True)
    class Named(make(dataclass)):
        label: str = ""

    assert Named(1, label="a").label == "a"
    with pytest.raises(dataclasses.FrozenInstanceError):
        Named(1).label = "b"
    with pytest.raises(TypeError):  # frozen, as its base
        dataclasses.dataclass(type("Other", (make(dataclass),), {}))


def test_subclasses_that_are_no_records_have_attributes_of_their_own():
    class Named(make(dataclass)):
        pass

    point = Named(1)
    point.label = "a"
    del point.label
    for change in (lambda: setattr(point, "x", 2), lambda: delattr(point, "x")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            change()


def test_fields_are_frozen_and_copied():
    point = make(dataclass)(1)
    for change in (lambda: setattr(point, "x", 2), lambda: delattr(point, "x"),
                   lambda: setattr(point, "z", 2)):
        with pytest.raises(dataclasses.FrozenInstanceError):
            change()
    assert dataclasses.replace(point, x=2) == changed(point, x=2) == type(point)(2) != point
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
