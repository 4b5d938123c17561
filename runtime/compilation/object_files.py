"""A stepper's C as objects that compile side by side, and the modules that are made of them.

Runs of one trajectory, which every stepper is made for, are in one module; those of many side by
side, on lanes, in another one that is made when they are first asked for, and so are tangents and
adjoints, second derivatives, accelerations, and runs with impacts, whose texts have more kernels.
Newton's method is a library of its own, ``newton_library``, unless its steps need it in any case.
Each module is linked of objects of the same text: Newton and all that is evaluated once, apart from
the fixed-point iteration, and for one trajectory beside what its run is set up with and learns. An
object defines some of the public functions. The others are static in its header, so that the
compiler drops them, and what only they call.

``has_permutation`` finds objects in which gcc may have permuted a vector of eight doubles wrongly.

gcc compiles a constant permutation x → (x[i_0], ..., x[i_7]) of a 512-bit vector of doubles to
``vpermilpd`` with an immediate, which moves within pairs, even if i_2 or i_3 are 4 to 7: its
``avx_vpermilp_parallel`` (i386.cc) bounds both from below alone. Lane 2 or 3 of the result is then
x[2] or x[3]. Four elements of eight, as in

    (v4){ x[1], x[1], x[2], x[6] }

are such a permutation for the optimiser (tree-ssa-forwprop.cc), and the vectoriser writes them
wherever straight code, an inlined kernel say, reads an array that a vectorised loop has filled. Of
1,700 permutations gcc 12.2 gets 650 wrong, all with this instruction and all by this rule. clang
does not.

So no wrong permutation is in an object without the instruction. The few objects with it, right or
wrong, are compiled again without the passes that make permutations.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Literal

from ...core.manifest import Manifest
from ...core.records import dataclass
from .kernel_check import Kind

__all__ = ["NEWTON_CALLS", "WITHOUT_PERMUTATIONS", "Level", "ModuleKind", "Object",
           "declarations_of", "has_newton_apart", "has_permutation", "newton_functions",
           "objects_of", "with_inline_functions"]

#: A stepper is compiled as several modules, each when it is first needed.
ModuleKind = Literal["runs", "lanes", "newton", "derivatives", "second", "motion", "impacts",
                     "jumps"]

#: How much of -O3 an object has: all, most, or no more than -O2.
Level = Literal["all", "most", "seldom"]

#: Functions of both modules: the number of lanes, and the size of work memory.
_BOTH = {"lanes", "work_size"}
_RUNS = {"step", "integrate", "begin", "advance", *_BOTH}
_LANES = {"integrate_lanes", "integrate_many", *_BOTH}
_DERIVATIVES = {"derivative_size", "keep", "frame_state", "integrate_and_keep", "tangent",
                "adjoint", "integrate_tangent", "integrate_adjoint", "constraint_derivatives",
                "quantities_by_state", "count_switches", *_BOTH}
#: What objects call of Newton's method, and what Python calls.
NEWTON_CALLS = ("object_newton", "object_simplified_newton", "object_advance")
_NEWTON = {"T1", "T2", "guess", "residual", "jacobian", "increment_size", "satisfies_constraints",
           "last_increment", "step_work"}
#: Functions of the modules that have a text of their own, made when they are first asked for.
_LATER: dict[ModuleKind, set[str]] = {
    "derivatives": _DERIVATIVES,
    "second": {"second_size", "integrate_second", "constraint_second", *_BOTH},
    "motion": {"derivative_size", "accelerations", "inverse_mass", "constraint_derivatives",
               "quantity_rates", *_BOTH},
    "impacts": {"derivative_size", "impact_size", "integrate_impacts", "inverse_mass", *_BOTH},
    "jumps": {"impacts_by_state", *_BOTH}}
#: The kernels of an object by its number: Newton's on numbers, the fixed-point iteration's on
#: lanes.
_CHECKS: dict[int, tuple[Kind, ...]] = {
    1: ("numbers",), 2: ("lanes",), 3: ("lanes",), 5: ("numbers",)}
#: The levels of objects by their numbers: the loops of one trajectory, what is evaluated seldom.
_LEVELS: dict[int, Level] = {2: "most", 4: "seldom", 5: "seldom"}
#: Flags of objects that have functions which nothing in them calls.
_FLAGS = ("-fvisibility=hidden", "-Wno-unused-function")


@dataclass(frozen=True)
class Object:
    """One compilation of the text of a stepper: its header and additional flags."""

    name: str
    header: str
    flags: tuple[str, ...] = ()
    #: How much of -O3 makes it faster.
    level: Level = "all"
    #: Kernels of these kinds are compared with their statements when it has been compiled.
    checks: tuple[Kind, ...] = ()
    #: Whether most functions of the text are not called, so that it pays to have them dropped.
    sparse: bool = False


def objects_of(
    name: str, files: Mapping[str, str], module_kind: ModuleKind, *, as_one: bool = False,
    apart: bool = False,
) -> list[Object]:
    """Return the objects that a module is linked of, the slowest to compile first.

    The macro GYROSPARK_OBJECT has the number of an object (run/objects.h): 1, Newton's method and
    the functions without iteration; 2, the iteration of one trajectory; 3, that of many side by
    side; 4, what a run calls at most once a step; 5, object 1 without Newton's method.

    ``apart`` leaves Newton's method to the module "newton".

    ``as_one`` asks for one object. At -O0 gcc keeps static functions that nothing calls, so that
    each of several objects would take as long as the whole text.
    """
    header = files[f"{name}.h"]
    if module_kind in _LATER:
        only = _only(name, header, _LATER[module_kind])
        return [Object(module_kind, with_inline_functions(only) if as_one else only, _FLAGS,
                       level="all" if module_kind == "derivatives" else "most", sparse=as_one)]
    if not _has_lanes(name, header):
        return [Object("whole", header, checks=("numbers",))]
    if as_one:
        return [Object("whole", header, _FLAGS, checks=("numbers", "lanes"))]
    if "T1" not in _functions(name, header):  # nothing is solved: a module is one object
        lane_functions = (_LANES if module_kind == "lanes" else
                          _functions(name, header) - (_LANES - _BOTH))
        checks: tuple[Kind, ...] = ("lanes",) if module_kind == "lanes" else ("numbers",)
        return [Object(module_kind, _only(name, header, lane_functions), _FLAGS, checks=checks)]
    once = _functions(name, header) - _RUNS - _LANES
    # object → the public functions that it defines; object 1 of lanes and 4 are called by objects
    groups: dict[int, set[str]] = {
        "newton": {1: once}, "lanes": {3: _LANES, 1: set()}, "runs": {2: _RUNS, 1: once, 4: set()},
    }[module_kind]
    if apart and module_kind != "newton":
        groups.pop(1)
        groups |= {5: once - _NEWTON} if module_kind == "runs" else {}
    return [_object(name, header, number, functions) for number, functions in groups.items()]


def has_newton_apart(name: str, files: Mapping[str, str]) -> bool:
    """Return whether Newton's method of a stepper can be a library of its own.

    It cannot where all steps need it, with velocity constraints, nor where objects share the long
    kernels of object 1.
    """
    header = files[f"{name}.h"]
    return (_has_lanes(name, header) and "T1" in _functions(name, header)
            and not Manifest.from_text(files[f"{name}.json"]).system.velocity_constraints
            and "NUMBERS_ELSEWHERE" not in files[f"{name}.c"])


def newton_functions(name: str, header: str) -> set[str]:
    """Return the public functions of Newton's method that a header declares."""
    return _functions(name, header) & _NEWTON


def declarations_of(name: str, header: str, module_kind: ModuleKind) -> str:
    """Return a header with the functions that are in a module, for cffi."""
    functions = _functions(name, header)
    if module_kind in _LATER:
        names = _LATER[module_kind]
    elif not _has_lanes(name, header):
        return header
    else:
        names = functions - (_LANES - _BOTH) if module_kind == "runs" else _LANES
    return _declaration(name, r"[^;]*;\n").sub(
        lambda match: match[0] if match[1] in names else "", header)


def _object(name: str, header: str, number: int, functions: set[str]) -> Object:
    """Return an object file that compiles the functions that ``functions`` names."""
    return Object(f"object{number}", _only(name, header, functions),
                  (f"-DGYROSPARK_OBJECT={number}", *_FLAGS),
                  level=_LEVELS.get(number, "all"),
                  checks=_CHECKS.get(number, ()))


def _only(name: str, header: str, functions: set[str]) -> str:
    """Return a header whose other functions are static, so that the compiler drops them."""
    return _declaration(name).sub(
        lambda match: match[0] if match[1] in functions
        else f"__attribute__((unused)) static {match[0]}", header)


def with_inline_functions(text: str) -> str:
    """Return C whose static functions are inline: at -O0 gcc drops no others, called or not."""
    return _STATIC_FUNCTION.sub(r"\1static inline ", text)


def _has_lanes(name: str, header: str) -> bool:
    """Whether a stepper integrates many trajectories side by side, on lanes."""
    return "lanes" in _functions(name, header)


def _functions(name: str, header: str) -> set[str]:
    """Return the functions that a header declares, by their short names."""
    return set(_declaration(name).findall(header))


def _declaration(name: str, arguments: str = "") -> re.Pattern[str]:
    """Return the pattern of a function's declaration; its group is the name without prefix."""
    return re.compile(rf"^(?:const )?\w[\w ]* \*?{name}_(\w+)\({arguments}", re.MULTILINE)


_STATIC_FUNCTION = re.compile(
    r"^(__attribute__\(\(unused\)\) |)static (?!inline\b)(?=[^;={\[]*\([^={;]*\)\s*[;{])",
    re.MULTILINE)

#: Flags to compile with instead, until no instruction is left: without joining elements to
#: permutations, which costs next to nothing; without vectorising, of which nothing is left to join.
#: Less is then known of variables, and gcc takes some for uninitialised that it did not before; and
#: of vectors that it does not join gcc 12 drops stores as dead that are read later, or reads what
#: was there before: by their types, its analysis across functions (ipa-modref) takes them for
#: others.
WITHOUT_PERMUTATIONS = (
    ["-fno-tree-forwprop", "-fno-tree-dse", "-fno-strict-aliasing", "-Wno-error"],
    ["-fno-tree-forwprop", "-Wno-error", "-fno-tree-vectorize", "-fno-tree-slp-vectorize"],
)

#: EVEX.512.66.0F3A.W1 05: prefix, map 3 with any registers, W1 and 66, 512 bits, opcode.
_VPERMILPD = re.compile(
    rb"\x62[\x03\x13\x23\x33\x43\x53\x63\x73\x83\x93\xa3\xb3\xc3\xd3\xe3\xf3]\xfd"
    rb"[\x40-\x5f\xc0-\xdf]\x05", re.DOTALL)


def has_permutation(machine_code: bytes) -> bool:
    """Return whether machine code for x86-64 has a 512-bit ``vpermilpd`` with an immediate."""
    return _VPERMILPD.search(machine_code) is not None
