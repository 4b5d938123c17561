"""Immutable dict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

__all__ = ["NO_PARAMETERS", "FrozenDict"]

Key = TypeVar("Key")
Value = TypeVar("Value")


class FrozenDict(dict[Key, Value]):
    """Immutable dict, in place of ``types.MappingProxyType``.

    Pickle, copy and json take it as they take a dict; ``a | b`` and ``dict(a)`` are dicts that can
    be changed.
    """

    if not TYPE_CHECKING:
        def _refuse(self, *arguments: Any, **entries: Any) -> NoReturn:
            """Refuse a change, whose cure the error names."""
            raise TypeError("These entries are fixed; make a dict of them that can be changed, by "
                            "dict(...) or by ... | {'name': value}.")

        __setitem__ = __delitem__ = __ior__ = _refuse
        clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle as a dict; by default pickle sets the entries one by one, which is refused."""
        return type(self), (dict(self),)


#: The default of ``parameters``: of a system that has none.
NO_PARAMETERS: Mapping[str, Any] = FrozenDict()
