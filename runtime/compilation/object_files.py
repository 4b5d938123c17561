"""A stepper's C as objects that compile side by side, and the modules that are made of them.

Runs of one trajectory, which every stepper is made for, are in one module; those of many side by
side, on lanes, in another one that is made when they are first asked for. Each module is linked of
objects of the same text: Newton and all that is evaluated once, beside the sweeps, and for one
trajectory beside what its run is set up with and learns. An object defines some of the public
functions. The others are static in its header, so that the compiler drops them, and what only they
call.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from .kernel_check import Kind

__all__ = ["Object", "Part", "declarations_of", "objects_of"]

#: Which of the two modules.
Part = Literal["runs", "lanes"]

#: Of both modules: how many trajectories lie side by side, and the size of work memory.
_BOTH = {"lanes", "work_size"}
_RUNS = {"step", "integrate", "begin", "advance", *_BOTH}
_LANES = {"integrate_lanes", "integrate_many", *_BOTH}
#: Which kernels an object is made of, by its number: Newton's of numbers, those of sweeps of lanes.
_CHECKS: dict[int, tuple[Kind, ...]] = {1: ("numbers",), 2: ("lanes",), 3: ("lanes",)}
#: Of objects that have functions which nothing in them calls.
_FLAGS = ("-fvisibility=hidden", "-Wno-unused-function")


@dataclass(frozen=True)
class Object:
    """One compilation of the text of a stepper: its header, and flags beside those of all."""

    name: str
    header: str
    flags: tuple[str, ...] = ()
    #: Whether it has no loops that sweeps or iterations go through.
    seldom: bool = False
    #: Kernels of these kinds are compared with their statements when it has been compiled.
    checks: tuple[Kind, ...] = ()


def objects_of(
    name: str, files: Mapping[str, str], part: Part, *, whole: bool = False
) -> list[Object]:
    """Return the objects that a module is linked of, the slowest to compile first.

    ``whole`` asks for one object. At -O0 gcc keeps static functions that nothing calls, so that
    each of several objects would take as long as the whole text.
    """
    header = files[f"{name}.h"]
    if not _has_lanes(name, header):
        return [Object("whole", header, checks=("numbers",))]
    if whole:
        return [Object("whole", header, _FLAGS, checks=("numbers", "lanes"))]
    if part == "lanes":
        made: dict[int, set[str]] = {3: _LANES, 1: set()}
    else:
        made = {2: _RUNS, 1: _functions(name, header) - _RUNS - _LANES, 4: set()}
    return [_object(name, header, number, functions) for number, functions in made.items()]


def declarations_of(name: str, header: str, part: Part) -> str:
    """Return a header with the functions that are in a module, for cffi."""
    if not _has_lanes(name, header):
        return header
    functions = _functions(name, header)
    kept = functions - (_LANES - _BOTH) if part == "runs" else _LANES
    return _declaration(name, r"[^;]*;\n").sub(
        lambda found: found[0] if found[1] in kept else "", header)


def _object(name: str, header: str, number: int, functions: set[str]) -> Object:
    made = _declaration(name).sub(
        lambda found: found[0] if found[1] in functions
        else f"__attribute__((unused)) static {found[0]}", header)
    return Object(f"object{number}", made,
                  (f"-DGYROSPARK_OBJECT={number}", *_FLAGS), seldom=number == 4,
                  checks=_CHECKS.get(number, ()))


def _has_lanes(name: str, header: str) -> bool:
    return "lanes" in _functions(name, header)


def _functions(name: str, header: str) -> set[str]:
    """Return the functions that a header declares, by their short names."""
    return set(_declaration(name).findall(header))


def _declaration(name: str, rest: str = "") -> re.Pattern[str]:
    return re.compile(rf"^(?:const )?\w[\w ]* \*?{name}_(\w+)\({rest}", re.MULTILINE)
