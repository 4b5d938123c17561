"""A digest of a system and a tableau, equal in every process: the name of a stored derivation."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import sympy as sp

from ..symbolic.shared_subexpressions import parts_of

__all__ = ["system_digest"]

_OWN = __name__.partition(".generator.")[0]


def system_digest(*parts: Any) -> str | None:
    """Return a digest of all that the C of a system depends on, as hexadecimal text, or None.

    A symbol enters by its class, its name and its assumptions, on which simplifications depend; a
    number by its exact value; a function by its class. A ``Dummy``, which differs in each process,
    has no digest, nor has an object of a class outside of SymPy and this package, whose code is
    unknown.

    Parameters
    ----------
    parts : System, Tableau, or plain values
        Dataclasses, mappings, sequences, texts and numbers of them.
    """
    try:
        return _digest_of(parts, digests={}).hex()
    except TypeError:
        return None


def _digest_of(value: Any, digests: dict[sp.Basic, bytes]) -> bytes:
    """Return the digest of a value; equal values have equal digests in every process.

    ``digests`` collects the digests of subexpressions. Raises TypeError for a value without one.
    """
    if isinstance(value, sp.Basic):
        # parts come before the expressions that contain them; a shared part is hashed once
        for subexpression in parts_of([value]):
            if subexpression not in digests:
                digests[subexpression] = _digest_of_expression(subexpression, digests)
        return digests[value]
    if value is None or isinstance(value, (str, bool, int, float)):
        return _hash(type(value).__name__, repr(value))
    if isinstance(value, Mapping):
        return _hash("mapping", *(_digest_of(x, digests) for pair in value.items() for x in pair))
    if isinstance(value, (tuple, list)):
        return _hash("sequence", *(_digest_of(x, digests) for x in value))
    if is_dataclass(value):
        return _hash(_name_of_class(value), *(_digest_of(getattr(value, field.name), digests)
                                              for field in fields(value)))
    raise TypeError(f"{type(value).__name__} has no digest")


def _digest_of_expression(e: sp.Basic, digests: Mapping[sp.Basic, bytes]) -> bytes:
    """Return the digest of an expression from the digests of its arguments."""
    kind = _name_of_class(e)
    if isinstance(e, sp.Dummy):
        raise TypeError("a Dummy is another one in each process")
    if isinstance(e, sp.Symbol):
        return _hash(kind, e.name, repr(sorted(e.assumptions0.items())))
    if not e.args:
        return _hash(kind, sp.srepr(e))
    return _hash(kind, *(digests[argument] for argument in e.args))


def _name_of_class(value: Any) -> str:
    """Return module and name of a class of SymPy or of this package; raise TypeError for others."""
    kind = type(value)
    package = kind.__module__ or ""
    # a class that its module does not contain under its name was made by a user's function
    if not f"{package}.".startswith(("sympy.", f"{_OWN}.")) or getattr(
            sys.modules.get(package), kind.__name__, None) is not kind:
        raise TypeError(f"{kind.__name__} is neither of SymPy nor of this package")
    return f"{package}.{kind.__name__}"


def _hash(*parts: str | bytes) -> bytes:
    """Return a hash of texts with their lengths, so that "ab", "c" and "a", "bc" differ."""
    blake = hashlib.blake2b(digest_size=16)
    for part in parts:
        encoded = part.encode() if isinstance(part, str) else part
        blake.update(len(encoded).to_bytes(8, "little") + encoded)
    return blake.digest()
