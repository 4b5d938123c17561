"""Frozen dataclasses, and copies of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any, TypeVar, cast

__all__ = ["changed", "dataclass"]

Record = TypeVar("Record")


def changed(record: Record, **changes: Any) -> Record:
    """Return a copy of a frozen dataclass with other values of some fields.

    As ``dataclasses.replace``, which takes ten times as long and evaluates every field. The class
    must have neither ``__post_init__`` nor ``__slots__``.
    """
    copy = object.__new__(type(record))
    copy.__dict__.update(record.__dict__, **changes)
    return copy


if TYPE_CHECKING:
    from dataclasses import dataclass
else:
    def dataclass(**options: Any) -> Callable[[type], type]:
        """Return the decorator ``dataclasses.dataclass(frozen=True)``, which compiles one method.

        The standard library writes and compiles six methods of each class, a fifth of what a
        process computes until its first step. Here all but ``__init__`` are shared.
        """
        return lambda cls: _with_methods(cls, **options)


def _with_methods(
    cls: type, *, frozen: bool, eq: bool = True, repr: bool = True, **options: Any
) -> type:
    """Return a frozen dataclass with methods that read its fields when they are called."""
    if not frozen:
        raise TypeError(f"{cls.__name__} is not frozen; take dataclasses.dataclass.")
    attributes = {**cls.__dict__}
    # what inherits from a record is left to the standard library, which asks its params
    derived = any(map(dataclasses.is_dataclass, cls.__mro__[1:]))
    record: Any = dataclasses.dataclass(
        init=derived, frozen=derived, eq=False, repr=False, **options)(cls)
    record.__dataclass_params__.frozen = True
    fields = dataclasses.fields(record)
    compared = [f.name for f in fields if f.compare]
    hashed = [f.name for f in fields if (f.compare if f.hash is None else f.hash)]

    def is_equal(self: Any, other: object) -> Any:
        if type(other) is not type(self):
            return NotImplemented
        return _values(self, compared) == _values(other, compared)

    def hash_of(self: Any) -> int:
        return hash(_values(self, hashed))

    @recursive_repr()
    def text(self: Any) -> str:
        shown = (f"{f.name}={getattr(self, f.name)!r}" for f in fields if f.repr)
        return f"{type(self).__qualname__}({', '.join(shown)})"

    methods: dict[str, Any] = {"__eq__": is_equal, "__hash__": hash_of} if eq else {}
    methods |= {"__repr__": text} if repr else {}
    if not derived:
        methods |= {"__init__": _init_of(record), "__setattr__": _set, "__delattr__": _delete}
    for name, method in methods.items():
        if attributes.get(name) is None:  # a class with __eq__ has __hash__ = None
            setattr(record, name, method)
    return cast("type", record)


def _init_of(record: type) -> Callable[..., None]:
    """Return the ``__init__`` of a dataclass, which sets all fields at once."""
    constants: dict[str, Any] = {"_factory": _FACTORY}
    positional, named, values = ["self"], list[str](), list[str]()
    fields = dataclasses.fields(record)
    for f in fields:
        has_factory = f.default_factory is not dataclasses.MISSING
        has_default = has_factory or f.default is not dataclasses.MISSING
        constants[f"_default_{f.name}"] = f.default_factory if has_factory else f.default
        if f.init:
            default = "_factory" if has_factory else f"_default_{f.name}"
            (named if f.kw_only else positional).append(
                f"{f.name}={default}" if has_default else f.name)
        if has_factory:
            make = f"_default_{f.name}()"
            values.append(f"{f.name}={make} if {f.name} is _factory else {f.name}" if f.init
                          else f"{f.name}={make}")
        elif f.init:
            values.append(f"{f.name}={f.name}")
    arguments = ", ".join([*positional, *(["*", *named] if named else [])])
    lines = [f"def __init__({arguments}):", f" self.__dict__.update({', '.join(values)})"]
    if hasattr(record, "__post_init__"):
        lines.append(" self.__post_init__()")
    exec("\n".join(lines), constants)  # names of fields alone are in it
    init: Callable[..., None] = constants["__init__"]
    init.__module__, init.__qualname__ = record.__module__, f"{record.__qualname__}.__init__"
    init.__annotations__ = {f.name: f.type for f in fields if f.init} | {"return": None}
    return init


class _Factory:
    """The default of arguments that a factory makes."""

    def __repr__(self) -> str:
        return "<factory>"


_FACTORY = _Factory()


def _set(self: Any, name: str, value: Any) -> None:
    """Refuse to change a record; a subclass that is none may have further attributes."""
    _refuse(self, name, "assign to")
    object.__setattr__(self, name, value)


def _delete(self: Any, name: str) -> None:
    _refuse(self, name, "delete")
    object.__delattr__(self, name)


def _refuse(self: Any, name: str, verb: str) -> None:
    if "__dataclass_fields__" in vars(type(self)) or name in self.__dataclass_fields__:
        raise dataclasses.FrozenInstanceError(f"cannot {verb} field {name!r}")


def _values(record: object, names: Sequence[str]) -> tuple[Any, ...]:
    return tuple([getattr(record, name) for name in names])
