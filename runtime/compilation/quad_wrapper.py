"""Declarations of a float128 stepper for cffi, which does not know ``_Float128`` or its size.

The type is opaque to cffi, so numbers travel by pointer only. Fields of that type are left out of
the structs (the C compiler tells cffi how large they are), and every function is called through
one that takes by pointer what the original takes by value.
"""

from __future__ import annotations

import re

__all__ = ["PREFIX", "TYPE", "is_quad", "wrap_declarations"]

#: The type in generated C.
TYPE = "_Float128"
#: Prefix of the functions that cffi calls.
PREFIX = "quad_"

_OPAQUE = "quad"
_STRUCT = re.compile(r"typedef struct \{(.*?)\} (\w+);", re.DOTALL)
_KNOWN_LATER = re.compile(r"typedef struct (\w+) \1;")
_ENUM = re.compile(r"enum \w+ \{.*?\};", re.DOTALL)
_FUNCTION = re.compile(r"(.*?)(\w+)\((.*)\)", re.DOTALL)


def is_quad(declarations: str) -> bool:
    """Whether these are the declarations of a float128 stepper."""
    return TYPE in declarations


def wrap_declarations(declarations: str) -> tuple[str, str]:
    """Return the declarations for cffi, and the C of the functions they declare."""
    text = re.sub(r"/\*.*?\*/", "", declarations, flags=re.DOTALL)
    structs = [_struct(body, name) for body, name in _STRUCT.findall(text)]
    prototypes = _KNOWN_LATER.sub("", _ENUM.sub("", _STRUCT.sub("", text)))
    functions = [_function(" ".join(prototype.split())) for prototype in prototypes.split(";")
                 if prototype.strip()]
    declared = [f"typedef ... {_OPAQUE};", *_ENUM.findall(text), *structs,
                *(match[0] for match in _KNOWN_LATER.finditer(text)),
                *(f"{head};" for head, _ in functions)]
    defined = [f"typedef {TYPE} {_OPAQUE};",
               *(f"static {head}\n{{\n    {body}\n}}" for head, body in functions)]
    return "\n".join(declared), "\n".join(defined)


def _struct(body: str, name: str) -> str:
    """Return a struct without its fields of float128; "...;" tells cffi to ask the C compiler."""
    fields = [field.strip() for field in body.split(";") if field.strip()]
    lines = [f"{field};" for field in fields if TYPE not in field]
    ellipsis = ["...;"] if len(lines) < len(fields) else []
    return f"typedef struct {{ {' '.join([*lines, *ellipsis])} }} {name};"


def _function(declaration: str) -> tuple[str, str]:
    """Return head and body of the function by which cffi calls a declared one.

    ``real f(real x, const real *y)`` gets ``quad_f(const quad *x, const quad *y)``, which calls
    ``f(*x, y)``. A result of the type becomes a double: the only one is the size of an increment.
    """
    match = _FUNCTION.fullmatch(declaration)
    if match is None:
        raise ValueError(f"No function of C: {declaration}")
    result, name, arguments = match.groups()
    parameters, call_arguments = [], []
    for argument in arguments.split(","):
        text = re.sub(r"(\w+)\[\d+\]", r"*\1", argument.strip())
        parameter = text.split()[-1].lstrip("*")
        by_value = TYPE in text and "*" not in text
        parameters.append(f"const {TYPE} *{parameter}" if by_value else text)
        call_arguments.append(f"*{parameter}" if by_value else parameter)
    call = f"{name}({', '.join(call_arguments) if parameters != ['void'] else ''});"
    head = f"{result.replace(TYPE, 'double')}{PREFIX}{name}({', '.join(parameters)})"
    body = call if result.strip() == "void" else f"return {'(double)' * (TYPE in result)}{call}"
    return head.replace(TYPE, _OPAQUE), body
