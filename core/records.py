"""Records: classes whose attributes stay as they are, frozen dataclasses among them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

__all__ = ["FixedAttributes", "dataclass", "replace_fields"]

Record = TypeVar("Record")


class FixedAttributes:
    """Base of classes whose public attributes are those that they declare, each assigned once.

    Any other assignment would change nothing that the package reads, and is refused; properties
    with a setter, private names, and classes that users derive are free.
    """

    #: How to get an object with another value, as the refusal says it.
    _CURE: ClassVar[str] = "make another one"
    #: Whether declared attributes may be assigned again.
    _REASSIGNED: ClassVar[bool] = False

    #: Names of properties with a setter, and of declared attributes: computed for each class once.
    _SETTERS: ClassVar[frozenset[str]] = frozenset()
    _DECLARED: ClassVar[frozenset[str]] = frozenset()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        members = {name: member for base in reversed(cls.__mro__)
                   for name, member in vars(base).items()}
        cls._SETTERS = frozenset(name for name, member in members.items()
                                 if isinstance(member, property) and member.fset is not None)
        cls._DECLARED = frozenset(name for base in cls.__mro__
                                  for name in vars(base).get("__annotations__", ()))

    def __setattr__(self, name: str, value: Any) -> None:
        if not name.startswith("_") and name not in self._SETTERS:
            is_fixed = name in self.__dict__ and not self._REASSIGNED
            if (is_fixed or name not in self._DECLARED) and _is_ours(type(self)):
                raise _unassignable(type(self), name, self._CURE)
        object.__setattr__(self, name, value)


def _is_ours(cls: type) -> bool:
    """Whether a class is of this package: classes that users derive from its own take more."""
    return cls.__module__.partition(".")[0] == __name__.partition(".")[0]


def _unassignable(cls: type, name: str, cure: str) -> AttributeError:
    """Return the refusal of an assignment to an attribute, with the cure."""
    exists = any(name in (*vars(base), *getattr(base, "__annotations__", ()))
                 for base in cls.__mro__)
    reason = f"{name!r} is fixed" if exists else f"there is no attribute {name!r} to assign"
    return dataclasses.FrozenInstanceError(f"{cls.__name__.lstrip('_')}: {reason}; {cure}.")


def replace_fields(record: Record, **changes: Any) -> Record:
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
        """Return the decorator ``dataclasses.dataclass``, with methods that are not compiled.

        The standard library writes and compiles ``__eq__``, ``__hash__`` and ``__repr__`` of each
        class, a tenth of what a process computes until its first step.
        """
        return lambda cls: _with_methods(cls, **options)


def _with_methods(cls: type, *, eq: bool = True, repr: bool = True, **options: Any) -> type:
    """Return a dataclass of ``cls``, whose ==, hash and repr are closures over its fields' names.

    ``dataclasses`` would compile these methods for each class, which takes much of an import.
    """
    attributes = {**cls.__dict__}  # before the decorator adds its own
    record: type = dataclasses.dataclass(eq=False, repr=False, **options)(cls)
    fields = dataclasses.fields(record)
    compared = [f.name for f in fields if f.compare]
    names = [f.name for f in fields if f.init]
    hashed = [f.name for f in fields if (f.compare if f.hash is None else f.hash)]

    def is_equal(self: Any, other: object) -> Any:
        """Compare the fields of records of one class."""
        if type(other) is not type(self):
            return NotImplemented
        return _values(self, compared) == _values(other, compared)

    def hash_of(self: Any) -> int:
        """Return a hash of the fields that take part in it: the compared ones by default."""
        return hash(_values(self, hashed))

    @recursive_repr()
    def text(self: Any) -> str:
        """Return the constructor call of the record."""
        field_texts = (f"{f.name}={getattr(self, f.name)!r}" for f in fields if f.repr)
        return f"{type(self).__qualname__}({', '.join(field_texts)})"

    def refuse(self: Any, name: str, value: object) -> None:
        """Refuse an assignment, with the cure."""
        cls = type(self)
        if cls is not record and name not in names and not _is_ours(cls):
            object.__setattr__(self, name, value)
            return
        copied = f"dataclasses.replace(..., {name}=...) returns a copy with another value"
        cure = copied if name in names else FixedAttributes._CURE
        raise _unassignable(cls, name, getattr(cls, "_CURE", cure))

    methods: dict[str, Any] = {"__eq__": is_equal, "__hash__": hash_of} if eq else {}
    methods |= {"__setattr__": refuse} if options.get("frozen") else {}
    for name, method in (methods | ({"__repr__": text} if repr else {})).items():
        if attributes.get(name) is None:  # a class with __eq__ has __hash__ = None
            setattr(record, name, method)
    return record


def _values(record: object, names: Sequence[str]) -> tuple[Any, ...]:
    """Return the fields of a record with these names."""
    return tuple([getattr(record, name) for name in names])
