"""Frozen dataclasses as JSON, and back: each value is checked against its type.

Fields stand in JSON in their order, under their names. A field with a default is left out where it
has that value; with ``field(metadata={"beside": NAME})`` where field NAME is false or empty; with
``metadata={"implied": function}`` where it has the value of the function of the record; with
``metadata={"written": True}`` never.
Types may be ``str``, ``int``, ``float``, ``bool``, ``Literal``, unions of these and None,
``tuple``, ``Mapping[str, ...]`` and other such dataclasses.
"""

from __future__ import annotations

import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from typing import Any, Literal, TypeVar, Union, get_args, get_origin

from .arguments import shown
from .errors import InputError
from .frozen_dict import FrozenDict

__all__ = ["UnfitError", "as_json", "from_json"]

Record = TypeVar("Record")
Decoder = Callable[[Any], Any]


class UnfitError(InputError):
    """A value of JSON has another type than its field; ``place`` is its path in the content."""

    def __init__(self, reason: str, path: str = "") -> None:
        super().__init__(reason)
        self.reason, self.place = reason, path

    def __str__(self) -> str:
        return f"{self.place.removeprefix('.') or 'it'} {self.reason}"


def as_json(record: Any) -> dict[str, Any]:
    """Return a record as JSON has it: dicts and lists, fields in their order."""
    return {field.name: _encode(getattr(record, field.name))
            for field in fields(record) if _in_json(field, record)}


def from_json(cls: type[Record], content: Any) -> Record:
    """Return the record of JSON content; values of other types and unknown keys are refused.

    Raises UnfitError with the place and the type that belongs there.
    """
    decode: Callable[[Any], Record] = _decoder(cls)  # type: ignore[arg-type]  # a class is hashable
    return decode(content)


def _encode(value: Any) -> Any:
    """Return a value as JSON has it: tuples as lists, records as objects."""
    if isinstance(value, tuple):
        return [_encode(item) for item in value]
    if isinstance(value, Mapping):
        return {key: _encode(item) for key, item in value.items()}
    return as_json(value) if is_dataclass(value) else value


def _in_json(field: Field[Any], record: Any) -> bool:
    """Return whether a field is in the JSON; by default it is unless it has its default value.

    The metadata "written", "beside" and "implied" say otherwise: see the module.
    """
    value = getattr(record, field.name)
    if "written" in field.metadata:
        return True
    if "beside" in field.metadata:
        return bool(getattr(record, field.metadata["beside"]))
    if "implied" in field.metadata:
        return bool(value != field.metadata["implied"](record))
    if field.default_factory is not MISSING:
        return bool(value != field.default_factory())
    return field.default is MISSING or bool(value != field.default)


def _refuse(value: Any, expected: str) -> Any:
    """Raise UnfitError: a value is not of the type that ``expected`` names."""
    raise UnfitError(f"is {shown(value)}, not {expected}")


def _at(path: str, decode: Decoder, value: Any) -> Any:
    """Return a decoded value; errors get its ``path`` in front of their place within the value."""
    try:
        return decode(value)
    except UnfitError as error:
        error.place = f"{path}{error.place}"
        raise


@cache
def _decoder(hint: Any) -> Decoder:
    """Return the function that checks a value of JSON against a type.

    It returns the value: records and tuples as such, all else unchanged, an int for float too. It
    raises UnfitError for another type.
    """
    origin, type_arguments = get_origin(hint), get_args(hint)
    if is_dataclass(hint):
        return _of_record(hint)
    if origin is Literal:
        return lambda value: (value if isinstance(value, str) and value in type_arguments
                              else _refuse(value, f"one of {', '.join(type_arguments)}"))
    if origin in (Union, types.UnionType):
        return _of_union(type_arguments)
    if origin is tuple:
        if type_arguments[1:] == (...,):
            return _of_items(_decoder(type_arguments[0]))
        return _of_row([_decoder(argument) for argument in type_arguments])
    if origin is not None and issubclass(origin, Mapping):
        return _of_mapping(_decoder(type_arguments[1]))
    kinds = (int, float) if hint is float else (hint,)  # JSON writes 1.0 as 1 as well
    name = {str: "text", int: "a whole number", float: "a number", bool: "true or false",
            type(None): "null"}[hint]
    # not isinstance, for which True is an int
    return lambda value: value if type(value) in kinds else _refuse(value, name)


def _of_union(types_of_union: tuple[Any, ...]) -> Decoder:
    """Return a decoder of the first type of a union that fits the value."""
    decoders = [_decoder(argument) for argument in types_of_union]

    def decode(value: Any) -> Any:
        """Return the value of the first type that fits; the error of the last one if none does."""
        for decoder in decoders[:-1]:
            try:
                return decoder(value)
            except UnfitError:
                continue
        return decoders[-1](value)

    return decode


def _of_items(decode_one: Decoder) -> Decoder:
    """Return a decoder of lists of any length, as tuples, by the decoder of one item."""
    def decode(value: Any) -> Any:
        """Return the list as a tuple; an error names the index."""
        if type(value) is not list:
            _refuse(value, "a list")
        return tuple(_at(f"[{i}]", decode_one, item) for i, item in enumerate(value))

    return decode


def _of_row(decoders: list[Decoder]) -> Decoder:
    """Return a decoder of lists of one length, as tuples, by a decoder for each item."""
    def decode(value: Any) -> Any:
        """Return the list as a tuple; an error names the index."""
        if type(value) is not list or len(value) != len(decoders):
            _refuse(value, f"a list of {len(decoders)}")
        return tuple(_at(f"[{i}]", decode_one, item)
                     for i, (decode_one, item) in enumerate(zip(decoders, value, strict=True)))

    return decode


def _of_mapping(decode_one: Decoder) -> Decoder:
    """Return a decoder of objects with values of one type, by the decoder of one value."""
    def decode(value: Any) -> Any:
        """Return the object as a dict that refuses changes; an error names the key."""
        if type(value) is not dict:
            _refuse(value, "an object")
        return FrozenDict({key: _at(f".{key}", decode_one, item)
                           for key, item in value.items()})

    return decode


def _of_record(cls: Any) -> Decoder:
    """Return a decoder of a dataclass: unknown and missing keys are refused."""
    hints = typing.get_type_hints(cls)
    decoders = {field.name: _decoder(hints[field.name]) for field in fields(cls)}
    required = [field.name for field in fields(cls)
                if field.default is MISSING and field.default_factory is MISSING]

    def decode(value: Any) -> Any:
        """Return the record of an object; an error names the key."""
        if type(value) is not dict:
            _refuse(value, "an object")
        for key in value:
            if key not in decoders:
                raise UnfitError(f"has the unknown key {key!r:.60}")
        for key in required:
            if key not in value:
                raise UnfitError(f"lacks {key!r}")
        return cls(**{key: _at(f".{key}", decoders[key], item) for key, item in value.items()})

    return decode
