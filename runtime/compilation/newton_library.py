"""Newton's method as a shared library of its own, compiled when a step first needs it.

Most runs never leave the fixed-point iteration, and Newton's method takes a quarter of the time of
the C compiler. So the module of a stepper has functions of the same names that call a table of
pointers instead. The first of these calls asks Python for the table: the library is taken from the
cache, or compiled into it. The object of the library is the same as in a module that contains it:
its text, header and flags are, and therefore its bits.

An error on the way (no compiler any more, a full disk) cannot pass through C: the functions return
"not converged", or nothing, and the call from Python that led to them raises the error afterwards.
The next call that needs the library tries again.
"""

from __future__ import annotations

import ctypes
import re
import threading
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cffi

from .object_files import NEWTON_CALLS, newton_functions

__all__ = [
    "CHECK",
    "connect",
    "declarations",
    "open_library",
    "raise_library_errors",
    "table_text",
    "trampolines",
]

#: The place of the check function in the table, behind the functions that objects call.
CHECK = len(NEWTON_CALLS)


class _Pending(threading.local):
    """The error of a library that could not be loaded, until the call that asked for it ends."""

    error: BaseException | None = None


_pending = _Pending()


def declarations(name: str) -> str:
    """Return the cffi declarations of a module that calls the library."""
    return f'extern void *{name}_newton_table;\nextern "Python+C" void {name}_load_newton(void);\n'


def trampolines(name: str, header: str, *, public: bool) -> str:
    """Return the C of functions that call those of the library, ``public`` ones or not.

    Each takes its pointer from the table, which is loaded first where it is not there. If that
    failed, a function of type int returns 1, "not converged", and others return 0 or nothing.
    """
    parts = [f"""
typedef void (*newton_function)(void);
/* of the type that cffi declares: gcc 14 and clang 16 refuse another one */
void *{name}_newton_table = 0;
void {name}_load_newton(void);

static const newton_function *newton_table(void)
{{
    if (!{name}_newton_table)
        {name}_load_newton();
    return {name}_newton_table;
}}
"""]
    # function → declaration in the header, "" for functions that objects alone call
    declaration_of = dict.fromkeys(NEWTON_CALLS, "") | _public_declarations(name, header)
    for index, (function, declaration) in enumerate(_in_table(declaration_of)):
        # "" is the check, called from Python alone; modules of lanes have no public functions of
        # Newton's method
        if function == "" or (declaration and not public):
            continue
        text = declaration or _internal(name, header, function)
        result = text.partition(f"{name}_")[0].strip()
        call = f"((__typeof__(&{name}_{function}))table[{index}])({', '.join(_names(text))})"
        calls = {"void": f"        {call};\n", "int": f"        return {call};\n    return 1;\n"}
        end = calls.get(result, f"        return {call};\n    return 0;\n")
        parts.append(f"{text};\n{text}\n{{\n    const newton_function *table = newton_table();\n"
                     f"    if (table)\n{end}}}\n")
    return "\n".join(parts)


def table_text(name: str, header: str, check: str) -> str:
    """Return the C of the table, compiled beside the library's object.

    ``check`` is the declaration of the function that evaluates the kernels of the object.
    """
    declaration_of = dict.fromkeys(NEWTON_CALLS, "") | _public_declarations(name, header)
    lines, entries = [], []
    for function, declaration in _in_table(declaration_of):
        if function and not declaration:
            lines.append(f"{_internal(name, header, function)};")
        target = f"{name}_{function}" if function else re.findall(r"\w+(?=\()", check)[0]
        entries.append(f"    (newton_function){target},")
    return (f'#include "{name}.h"\n{check}\n' + "\n".join(lines)
            + "\ntypedef void (*newton_function)(void);\n"
            f"extern const newton_function {name}_newton_table[];\n"
            f"const newton_function {name}_newton_table[] = {{\n" + "\n".join(entries) + "\n};\n")


def open_library(name: str, path: Path, check: str) -> Any:
    """Return the library with the address of its table, and ``ffi`` and ``lib`` for its check.

    Raises ImportError if it cannot be loaded, or is another one.
    """
    try:
        library = ctypes.CDLL(str(path))
        table = (ctypes.c_void_p * (CHECK + 1)).in_dll(library, f"{name}_newton_table")
    except (OSError, ValueError) as error:
        raise ImportError(f"{path}: {error}") from error
    ffi = cffi.FFI()
    function = ffi.cast("void (*)(int, long, const double *, double *, double *, void *)",
                        table[CHECK])
    return SimpleNamespace(address=ctypes.addressof(table), library=library, ffi=ffi,
                           lib=SimpleNamespace(**{check: function}))


def connect(module: Any, name: str, load: Callable[[], Any]) -> Any:
    """Return a module whose first call of the library loads it with ``load``.

    A module that has Newton's method itself is returned as it is.
    """
    if not hasattr(module.lib, f"{name}_newton_table"):
        return module

    @module.ffi.def_extern(name=f"{name}_load_newton")  # type: ignore[untyped-decorator]
    def load_newton() -> None:
        """Load the library of Newton's method, at the first step that needs it; C calls this."""
        try:
            library = load()
            module.newton = library  # stays open as long as the module
            setattr(module.lib, f"{name}_newton_table", module.ffi.cast("void *", library.address))
        except BaseException as error:
            # no exception passes through C: ``raise_library_errors`` raises it afterwards
            _pending.error = error

    return module


def raise_library_errors(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a compiled function that raises the error of a library that could not be loaded."""
    def call(*arguments: Any) -> Any:
        """Call the function, and raise the error of a library that could not be loaded meanwhile.
        """
        value = function(*arguments)
        error = _pending.error
        if error is not None:
            _pending.error = None
            raise error
        return value

    return call


def _in_table(declaration_of: dict[str, str]) -> list[tuple[str, str]]:
    """Return (function, declaration) of each entry of the table.

    First what objects call, without declarations, then the check as "", then the public functions.
    """
    calls, public = ([(name, text) for name, text in declaration_of.items()
                      if bool(text) is is_public]
                     for is_public in (False, True))
    return [*calls, ("", ""), *sorted(public)]


def _public_declarations(name: str, header: str) -> dict[str, str]:
    """Return the public functions of the library and their declarations without semicolon."""
    names = newton_functions(name, header)
    return {match[1]: match[0][:-1] for match in re.finditer(
        rf"^\w[\w ]*? \*?{name}_(\w+)\([^;]*;", header, re.MULTILINE) if match[1] in names}


def _internal(name: str, header: str, function: str) -> str:
    """Return the declaration of a function that objects call; its structs are not public."""
    match = re.search(rf"^int {name}_T1\([^;]*?\b(\w[\w ]*?) dt\b", header, re.MULTILINE)
    assert match is not None
    real = match[1]
    end_arguments = (f"{real} *q1, {real} *p1, {real} *multipliers" if function == "object_advance"
            else f"{real} *x")
    return (f"int {name}_{function}(void *w, const void *options, {real} dt, const {real} *q, "
            f"const {real} *p, {end_arguments}, int *iterations)")


def _names(declaration: str) -> list[str]:
    """Return the names of a declaration's arguments."""
    arguments = declaration[declaration.index("(") + 1 : declaration.rindex(")")]
    return [re.findall(r"\w+", re.sub(r"\[[^\]]*\]", "", argument))[-1]
            for argument in arguments.split(",")]
