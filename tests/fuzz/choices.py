"""Bytes as a source of choices: whoever makes the bytes, a fuzzer or a seed, makes the input.

Bytes that have run out read as zeros, and a choice of zero is the plainest one: cutting an input
short makes it simpler, which is how ``shrink`` finds the least that still fails.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Any, TypeVar

T = TypeVar("T")

#: Where floating-point code breaks: signed zero, the ends of the normal and subnormal range,
#: neighbours of 1, numbers beyond ``int`` and ``long``, infinities and NaN.
DOUBLES = (
    0.0, -0.0, 1.0, -1.0, 0.5, 2.0, 1e-3, 5e-324, -5e-324, 2.2250738585072014e-308, 1e-300, 1e-160,
    1e-30, 2.0**-52, 1 + 2.0**-52, 1 - 2.0**-53, 1e15, 2.0**31, -(2.0**31) - 1, 2.0**53, 2.0**63,
    -(2.0**63) * 1.5, 1e30, 1e160, 1e300, 1.7976931348623157e308, -1.7976931348623157e308,
    math.inf, -math.inf, math.nan,
)


class Choices:
    """Reads choices from the front of some bytes."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def byte(self) -> int:
        self.at += 1
        return self.data[self.at - 1] if self.at <= len(self.data) else 0

    def bytes(self, count: int) -> bytes:
        chunk = self.data[self.at : self.at + count]
        self.at += count
        return chunk.ljust(count, b"\0")

    def rest(self) -> bytes:
        remainder = self.data[self.at :]
        self.at = len(self.data)
        return remainder

    def below(self, count: int) -> int:
        """Return a whole number from 0 to count − 1."""
        if count <= 256:
            return self.byte() % count
        return int.from_bytes(self.bytes(4), "little") % count

    def pick(self, options: Sequence[T]) -> T:
        return options[self.below(len(options))]

    def one_in(self, count: int) -> bool:
        """Return True once in so many calls; never when the bytes have run out."""
        return self.below(count) == count - 1

    def double(self) -> float:
        """Return a double: moderate, of any size, special, or any bits."""
        kind = self.below(8)
        if kind < 3:
            return (self.below(2001) - 1000) / 500
        if kind < 5:
            return math.ldexp(self.below(4001) / 2000 - 1, self.below(200) - 100)
        if kind < 7:
            return self.pick(DOUBLES)
        return float(struct.unpack("<d", self.bytes(8))[0])

    def whole(self) -> int:
        """Return an integer: small, at an edge of C's types, or of many digits."""
        kind = self.below(8)
        if kind < 5:
            return self.below(12) - 2
        if kind < 7:
            return self.pick((2**7, 2**31 - 1, 2**31, -(2**31), 2**32, 2**62, 2**63 - 1, 2**63,
                              -(2**63), 2**64, 10**18, 10**40)) + self.below(3) - 1
        return 10 ** self.pick((20, 308, 309, 400, 4299, 5000))

    def value(self) -> Any:
        """Return any value of JSON or TOML where a number is expected."""
        kind = self.below(12)
        if kind < 3:
            return self.double()
        if kind < 6:
            return self.whole()
        if kind < 8:
            return self.text()
        return self.pick((True, False, None, "", [], {}, [0.0], {"a": 1}, [[]], "nan", "1e999"))

    def text(self, limit: int = 12) -> str:
        """Return a text, of characters that have a meaning somewhere."""
        return "".join(self.pick(CHARACTERS) for _ in range(self.below(limit)))


CHARACTERS = (
    *"aexq019.-+*/()[]{}\"',=# \n\\_:;^%$&<>|~`@!?",
    "\t", "\r", "\0", "\x1b", "\x7f", "γ", "é", "𝛾", "\u202e", "\ufeff", "\ud800", "−", "٣", "²",
)
