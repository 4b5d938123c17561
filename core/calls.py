"""Calls whose arguments do not fit: a sentence with the nearest name in place of a bare TypeError.
"""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable, Iterable
from types import FunctionType, ModuleType
from typing import Any, TypeVar

from .arguments import proposal
from .errors import ArgumentError
from .former_names import FORMER_MEMBERS, former_argument

__all__ = ["explain_arguments", "explain_module", "explain_names"]

Class = TypeVar("Class", bound=type)

_PACKAGE = __name__.partition(".")[0]
#: Classes and modules whose calls are explained.
_EXPLAINED: set[object] = set()


def explain_arguments(cls: Class) -> Class:
    """Return a class whose constructor and public methods refuse wrong arguments by a sentence.

    Methods of its bases in this package are included. ``gyrospark.NAME`` does this to all public
    classes; it decorates those whose instances other calls return.
    """
    for base in cls.__mro__:
        # classes of other packages keep their own errors
        if base.__module__.partition(".")[0] != _PACKAGE or base in _EXPLAINED:
            continue
        _EXPLAINED.add(base)
        for name, member in list(vars(base).items()):
            if name.startswith("_") and name != "__init__":
                continue
            shown_name = base.__name__ if name == "__init__" else name
            if isinstance(member, FunctionType):
                setattr(base, name, _explain(member, shown_name, bound=True))
            elif isinstance(member, (classmethod, staticmethod)):
                kind = type(member)
                setattr(base, name, kind(_explain(
                    member.__func__, shown_name, bound=kind is classmethod)))
        if base.__name__ in FORMER_MEMBERS:
            _refuse_former_members(base)
    return cls


def _refuse_former_members(cls: type) -> None:
    """Let a class refuse its former attributes by a sentence with the present ones.

    ``__getattr__`` does it, which Python calls for attributes that are not there.
    """
    former, inherited = FORMER_MEMBERS[cls.__name__], getattr(cls, "__getattr__", None)

    def refuse(self: Any, name: str) -> Any:
        """Raise AttributeError for a former attribute, with the present one, and for unknown ones.
        """
        if name in former:
            raise AttributeError(f"{cls.__name__}.{name} is now {former[name]}.")
        if inherited is not None:
            return inherited(self, name)
        raise AttributeError(f"{cls.__name__!r} object has no attribute {name!r}")

    setattr(cls, "__getattr__", refuse)  # noqa: B010  mypy knows no such attribute


def explain_names(module: ModuleType, names: Iterable[str]) -> None:
    """Let functions and classes of a module refuse wrong arguments by a sentence."""
    for name in names:
        member = vars(module).get(name)
        if isinstance(member, FunctionType):
            explained = _explain(member, name, bound=False)
            setattr(module, name, explained)
            setattr(sys.modules[member.__module__], name, explained)  # where pickle looks for it
        elif isinstance(member, type) and not issubclass(member, BaseException):
            explain_arguments(member)


def explain_module(module: ModuleType) -> ModuleType:
    """Return a module whose public calls refuse wrong arguments, and unknown names, by a sentence.

    The refusal of a name proposes the nearest one of ``__all__``.
    """
    names = module.__all__
    if module in _EXPLAINED:
        return module
    _EXPLAINED.add(module)

    # a module's __getattr__ is called for the names that it does not have (PEP 562)
    def refuse(name: str) -> Any:
        """Raise AttributeError for an unknown name, with the nearest one."""
        raise AttributeError(
            f"module {module.__name__!r} has no attribute {name!r}{proposal(name, names)}")

    explain_names(module, names)
    vars(module).setdefault("__getattr__", refuse)
    return module


def _explain(function: Any, shown: str, *, bound: bool) -> Any:
    """Return a function that refuses wrong arguments by a sentence.

    The sentence calls it ``shown``; ``bound`` says that its first argument is self or cls.
    """
    if hasattr(function, "__explained__"):  # reached before, by another name or module
        return function

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        """Call the function; raise ArgumentError, in a sentence, if the arguments do not fit."""
        try:
            return function(*arguments, **named)
        except TypeError as error:
            # Without a frame of the function it was not entered: the arguments do not fit.
            if error.__traceback__ is None or error.__traceback__.tb_next is not None:
                raise
        raise ArgumentError(_refusal(function, shown, arguments[bound:], named, bound=bound))

    call.__explained__ = True  # type: ignore[attr-defined]
    return call


def _refusal(
    function: Callable[..., Any], shown_name: str, arguments: tuple[Any, ...],
    keywords: dict[str, Any], *, bound: bool,
) -> str:
    """Return the sentence for arguments that do not fit a function, which is called ``shown_name``.

    ``bound``: its first parameter is self. The first reason that applies: former and unknown
    names, too many arguments, one given twice, missing ones.
    """
    # of a bound function without the first one
    parameters = list(inspect.signature(function).parameters.values())[bound:]
    by_place = [parameter.name for parameter in parameters
                if parameter.kind in (parameter.POSITIONAL_ONLY, parameter.POSITIONAL_OR_KEYWORD)]
    by_name = [parameter.name for parameter in parameters
               if parameter.kind in (parameter.POSITIONAL_OR_KEYWORD, parameter.KEYWORD_ONLY)]
    takes = ", ".join(by_name) or "none by name"
    takes_any_name = any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters)
    unknown = [] if takes_any_name else [name for name in keywords if name not in by_name]
    # before proposals by spelling: the present name of a former argument may look unlike it
    for name in unknown:
        if cure := former_argument(shown_name, name, {parameter.name for parameter in parameters}):
            return f"{shown_name} has no argument {name!r} any more; {cure}."
    # functions take steps; a class, whose name has capitals, may have another dt, as Tangents has
    if "dtau" in unknown and "dt" in by_name and shown_name.islower():
        return (f"{shown_name} has no argument 'dtau': it takes steps of t, dt=...; for a system "
                "with time_scale take integrate(..., dtau=...) and run.gradient(...), or a stepper "
                "of the system without time_scale.")
    if unknown:
        return (f"{shown_name} has no argument {unknown[0]!r}{proposal(unknown[0], by_name)}; it "
                f"takes {takes}.")
    if len(arguments) > len(by_place) and not any(
            parameter.kind is parameter.VAR_POSITIONAL for parameter in parameters):
        return (f"{shown_name} takes {len(by_place)} arguments without a name, and got "
                f"{len(arguments)}; name the others, of {takes}.")
    repeated = [name for name in by_place[:len(arguments)] if name in keywords]
    if repeated:
        return f"{shown_name} got {repeated[0]!r} twice, by place and by name; give it once."
    missing = [parameter.name for parameter in parameters if parameter.default is parameter.empty
               and parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
               and parameter.name not in keywords
               and parameter.name not in by_place[:len(arguments)]]
    return f"{shown_name} needs {', '.join(missing)} too; it takes {takes}."
