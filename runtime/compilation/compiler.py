"""Find a C compiler and turn a stepper's two files into an extension module."""

from __future__ import annotations

import functools
import importlib.util
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path

import cffi
import numpy as np

from ...core.errors import CompilerError, InputError
from ...core.real_types import REALS, Real
from ...core.records import dataclass
from . import call_stack, newton_library
from .kernel_check import CheckFunction, check_functions, check_text
from .kernel_text import kernels_of
from .object_files import (
    WITHOUT_PERMUTATIONS,
    Level,
    ModuleKind,
    declarations_of,
    has_newton_apart,
    has_permutation,
    objects_of,
    with_inline_functions,
)
from .quad_wrapper import is_quad, wrap_declarations

__all__ = [
    "Compiler",
    "compile_module",
    "exit_reason",
    "find_compiler",
    "read_declarations",
]

#: For the generated kernel: it must be clean under all of these.
STRICT_FLAGS = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
#: For float128 and its like: ISO C11 has neither type nor literals, which -Wpedantic says of each.
EXTENDED_FLAGS = [flag for flag in STRICT_FLAGS if flag != "-Wpedantic"]
#: Contraction to FMA is wanted here and stated; exported C is built with it off.
SPEED_FLAGS = ["-ffp-contract=fast", "-fno-math-errno"]
#: For gcc, which knows names of parts of -O3: flags of objects whose level is lower.
LOWER_FLAGS: dict[Level, list[str]] = {
    "most": ["-O2", "-ftree-vectorize", "-fvect-cost-model=dynamic", "-fpeel-loops"],
    "seldom": ["-O2"]}
#: For gcc: products of dual numbers, which are complex ones in C, look for no infinity.
DUAL_FLAGS = ["-fcx-limited-range"]
#: For cffi's wrapper, which hands arguments on and computes nothing: what builds fastest.
WRAPPER_FLAGS = ["-O0", "-w", "-fPIC"]

#: NumPy's types → the standard ones of C with the same numbers.
_STANDARD = {np.float32: "float", np.float64: "double", np.longdouble: "long double"}

#: Modules that call Newton's method.
_WITH_NEWTON = ("runs", "lanes")

#: Names the compiler's level of optimisation: lower ones build faster and run slower.
OPTIMISE = "GYROSPARK_OPTIMISE"

#: ziglang's first call unpacks itself, on a slow disk too.
_VERSION_SECONDS = 120

#: What generated C needs of compiler and C library for float128.
_QUAD_PROBE = """#define __STDC_WANT_IEC_60559_TYPES_EXT__ 1
#include <float.h>
#include <math.h>
_Float128 root(_Float128 x);
_Float128 root(_Float128 x) { return sqrtf128(x)*1.5F128 + FLT128_EPSILON; }
"""

#: A declaration of a function: what it returns, and its name.
_FUNCTION = re.compile(r"^((?:const )?\w[\w ]* \*?)(\w+)\(", re.MULTILINE)

#: A command, and the process that carries it out.
_Running = tuple[list[str], subprocess.Popen[str]]

_CURE = (
    "Install gcc or clang, set CC to a compiler, or `pip install ziglang`, which brings one from "
    "PyPI."
)


@dataclass(frozen=True)
class Compiler:
    """A C compiler: its command, the answer to --version, and its target.

    ``portable`` code runs on any machine of this architecture, other code on this one.
    """

    command: tuple[str, ...]
    version: str
    portable: bool = False

    @property
    def flags(self) -> list[str]:
        """Flags for code that runs on this machine, or on any of its architecture."""
        flags = [optimisation(), *SPEED_FLAGS]
        if self.portable:
            return [*flags, "-fPIC"]
        # on ARM and POWER the option that names a CPU is -mcpu
        native = "-march=native" if platform.machine() in ("x86_64", "AMD64") else "-mcpu=native"
        return [*flags, native, "-fPIC"]

    @property
    def lower_flags(self) -> dict[Level, list[str]]:
        """Flags added behind ``flags`` for objects that full -O3 makes no faster.

        Loops of an iteration have constant numbers of turns and long kernels are straight lines:
        they run as fast with "most" of -O3, and what is called once a step or a run does with -O2.
        The compiler takes a sixth to a third less time.
        """
        return LOWER_FLAGS if self.is_gcc and optimisation() == "-O3" else {}

    @property
    def is_gcc(self) -> bool:
        """Whether it is gcc itself, and not another compiler that takes its options."""
        return "Free Software Foundation" in self.version

    @property
    def link_flags(self) -> list[str]:
        """Linker flags of a Python extension module."""
        if sys.platform == "darwin":
            return ["-bundle", "-undefined", "dynamic_lookup"]
        return ["-shared"]


def find_compiler() -> Compiler:
    """Return the compiler to use: ``CC``, else cc, gcc or clang, else ziglang from PyPI.

    Raises CompilerError if there is none, or CC does not start.
    """
    command = os.environ.get("CC")
    if command and command.strip():
        return _probe(_split_command(command), f"The compiler CC={command!r}")
    for name in ("cc", "gcc", "clang"):
        path = shutil.which(name)
        if path:
            return _probe((path,), f"The compiler {path!r}")
    if importlib.util.find_spec("ziglang") is not None:
        return _probe((sys.executable, "-m", "ziglang", "cc"), "The compiler of ziglang")
    raise CompilerError(f"No C compiler was found (CC, cc, gcc, clang, ziglang). {_CURE}")


def _split_command(command: str) -> tuple[str, ...]:
    """Return the words of CC, or raise CompilerError for quotes without an end."""
    try:
        return tuple(shlex.split(command))
    except ValueError as error:
        raise CompilerError(f"CC={command!r} is not a command: {error}. {_CURE}") from error


@functools.cache
def _probe(command: tuple[str, ...], label: str) -> Compiler:
    """Return the compiler of a command, which must answer ``--version``; asked once a process."""
    try:
        version = subprocess.run([*command, "--version"], capture_output=True, check=False,
                                encoding="utf-8", errors="replace", stdin=subprocess.DEVNULL,
                                timeout=_VERSION_SECONDS)
    except subprocess.TimeoutExpired as error:
        raise CompilerError(f"{label} does not answer --version. {_CURE}",
                            command=list(command)) from error
    except OSError as error:
        quoted = ""
        if len(command) > 1 and label.startswith("The compiler CC="):
            quoted = (" Blanks part a command from its options: quote a path that has some, as in "
                      f"CC={shlex.quote(shlex.quote(' '.join(command)))}.")
        raise CompilerError(f"{label} does not start: {error.strerror}.{quoted} {_CURE}",
                            command=list(command)) from error
    if version.returncode != 0:
        raise CompilerError(f"{label} answers --version with exit code {version.returncode}. "
                            f"{_CURE}",
                            command=list(command), stderr=version.stderr)
    return Compiler(command, version.stdout.strip())


def optimisation() -> str:
    """Return the flag for the level of optimisation: ``GYROSPARK_OPTIMISE``, by default 3."""
    level = os.environ.get(OPTIMISE) or "3"
    if level not in ("0", "1", "2", "3"):
        raise InputError(f"{OPTIMISE} = {level!r} is no level of optimisation; set 0, 1, 2 or 3, "
                         "or nothing for 3.")
    return f"-O{level}"


def is_whole() -> bool:
    """Whether a stepper is compiled as one object and one module: at -O0 several take longer."""
    return optimisation() == "-O0"


def read_declarations(header: str) -> str:
    """Return the part of a generated header that cffi is to read."""
    start = header.index("/* [begin declarations] */")
    return header[start : header.index("/* [end declarations] */")]


def compile_module(
    name: str, files: dict[str, str], compiler: Compiler, folder: Path,
    module_kind: ModuleKind = "runs",
    more_flags: Sequence[str] = (),
) -> tuple[Path, list[CheckFunction]]:
    """Compile a stepper in ``folder``; return the path of the extension module and its checks.

    ``module_kind`` names one of the modules of a stepper (``object_files.ModuleKind``): "runs" of
    one trajectory, "lanes" of many, "newton", the library that these two call, and those of
    derivatives and impacts. Its objects are compiled side by side under strict warnings, with
    ``more_flags`` behind all others; so is, without these, its wrapper, the C that cffi writes to
    make functions callable from Python. The checks are C functions in the objects that evaluate
    their kernels, for ``kernel_check``. Raises CompilerError with the command and its stderr; also
    if a step succeeds and leaves no file; OSError if the folder cannot be written.
    """
    for file, text in files.items():
        (folder / file).write_text(text, encoding="utf-8")
    declarations = read_declarations(files[f"{name}.h"])
    if is_quad(declarations):
        _refuse_without_quad(compiler, folder)
    # where a portable module runs, no compiler can make the library when a step needs it (prebuilt)
    newton_apart = not (is_whole() or compiler.portable) and has_newton_apart(name, files)
    objects, checks = _start_objects(name, files, compiler, folder, module_kind, more_flags,
                                     newton_apart=newton_apart)
    wrapper = _write_wrapper(name, files, checks, folder, module_kind, newton_apart=newton_apart)
    include = sysconfig.get_paths()["include"]
    wrapper_object = _start([*compiler.command, *WRAPPER_FLAGS, f"-I{include}", "-I.", "-c",
                             wrapper.name, "-o", "wrapper.o"], folder)
    running = [*objects, wrapper_object]
    _wait_for(running)
    for command, _ in running:
        _refuse_missing(folder / command[-1], command)
    # gcc may have compiled a permutation wrongly, which shows in the object alone (object_files)
    if compiler.is_gcc:
        _replace_permutations([command for command, _ in running], folder)
    object_names = ["wrapper.o", *(command[-1] for command, _ in objects)]
    target = folder / (module_name(name) + extension_suffix())
    link = [*compiler.command, *compiler.link_flags, *object_names, "-lm", "-o", target.name]
    _wait_for([_start(link, folder)])
    _refuse_missing(target, link)
    return target, checks


def _refuse_missing(file: Path, command: list[str]) -> None:
    """Raise CompilerError if a command that ended well has left no file."""
    if not file.is_file():
        raise CompilerError(f"The C compiler says it succeeded but made no {file.name}: "
                            f"{shlex.join(command)}. {_CURE}", command=command)


def _start_objects(
    name: str, files: dict[str, str], compiler: Compiler, folder: Path, module_kind: ModuleKind,
    more_flags: Sequence[str], *, newton_apart: bool,
) -> tuple[list[_Running], list[CheckFunction]]:
    """Start to compile the objects of a module; return the commands and the objects' checks.

    Each object has a folder with a header of its own, which declares its public functions. The last
    word of a command is the object's file. With ``newton_apart`` Newton's method is in no object of
    the module, but in a library.
    """
    source = files[f"{name}.c"]
    extended = _optional_type(read_declarations(files[f"{name}.h"]))
    compile_command = [*compiler.command, *compiler.flags, *call_stack.FLAGS,
                       *(EXTENDED_FLAGS if extended else STRICT_FLAGS)]
    running, checks, kernels = list[_Running](), list[CheckFunction](), kernels_of(source)
    for object_file in objects_of(name, files, module_kind, as_one=is_whole(), apart=newton_apart):
        object_folder = folder / object_file.name
        object_folder.mkdir(exist_ok=True)
        (object_folder / f"{name}.h").write_text(object_file.header, encoding="utf-8")
        object_checks = check_functions(f"{name}_{object_file.name}", kernels, object_file.checks)
        checks += object_checks
        # an object of few functions has no checks
        text = (with_inline_functions(source) if object_file.sparse
                else source + check_text(object_checks, source))
        (object_folder / f"{name}.c").write_text(text, encoding="utf-8")
        # second derivatives compute with dual numbers
        on_duals = compiler.is_gcc and "typedef _Complex" in source
        options = [*object_file.flags, *compiler.lower_flags.get(object_file.level, ()),
                   *more_flags, *(DUAL_FLAGS if on_duals else ())]
        running.append(_start([*compile_command, *options, "-c", f"{object_file.name}/{name}.c",
                               "-o", f"{object_file.name}.o"], folder))
    return running, checks


def _replace_permutations(commands: Sequence[list[str]], folder: Path) -> None:
    """Compile objects with suspect permutations again, without the passes that make them.

    ``commands`` compiled the objects; their last words are -o and the object's file.
    """
    for flags in WITHOUT_PERMUTATIONS:
        suspects = [command for command in commands
                    if has_permutation((folder / command[-1]).read_bytes())]
        _wait_for([_start([*command[:-2], *flags, *command[-2:]], folder) for command in suspects])


def _write_wrapper(
    name: str, files: dict[str, str], checks: Sequence[CheckFunction], folder: Path,
    module_kind: ModuleKind, *, newton_apart: bool,
) -> Path:
    """Write the C that makes a module's functions callable from Python; return its path.

    The library of Newton's method has a table of pointers, and no module of Python.
    """
    header = files[f"{name}.h"]
    if module_kind == "newton":
        table = folder / "table.c"
        (check,) = checks
        table.write_text(newton_library.table_text(name, header, check.declaration),
                         encoding="utf-8")
        return table
    calls = (newton_library.trampolines(name, header, public=module_kind == "runs")
             if newton_apart and module_kind in _WITH_NEWTON else "")
    # one module has all functions at -O0
    if not (is_whole() and module_kind in _WITH_NEWTON):
        header = declarations_of(name, header, module_kind)
    return _write_cffi_wrapper(name, header, checks, folder, calls)


def _write_cffi_wrapper(
    name: str, header: str, checks: Sequence[CheckFunction], folder: Path, calls: str
) -> Path:
    """Write cffi's C for a header and the functions of the check; return its path.

    ``calls`` are functions that call Newton's method in its library.
    """
    declarations, functions, type_macro = read_declarations(header), "", ""
    if is_quad(declarations):
        declarations, functions = wrap_declarations(declarations)
    elif real := _optional_type(declarations):  # cffi knows the standard type with the same numbers
        standard = _STANDARD[real.dtype]
        declarations = f"typedef {standard} {real.c_type};\n{declarations}"
        type_macro = f"#define {real.c_type} {standard}\n"
    ffi = cffi.FFI()
    check_declarations = "\n".join(check.declaration for check in checks)
    declarations, pointers = _as_pointers(f"{declarations}\n{check_declarations}")
    # work memory is opaque to callers; the C compiler tells cffi its size
    ffi.cdef(f"{declarations}\nstruct {name}_work {{ ...; }};\n"
             + (newton_library.declarations(name) if calls else ""))
    ffi.set_source(module_name(name), f'{type_macro}#define {name.upper()}_WORK\n'
                   f'#include "{name}.h"\n{calls}{functions}\n{check_declarations}\n'
                   f'{pointers}',
                   compiler_verbose=0)
    wrapper = folder / f"{module_name(name)}.c"
    ffi.emit_c_code(str(wrapper))
    return wrapper


def _as_pointers(declarations: str) -> tuple[str, str]:
    """Return declarations with pointers in place of functions, and the C of the pointers.

    Of a function cffi writes a hundred lines that unpack its arguments, which take longer to
    compile than all else of the wrapper; it calls a pointer with the same arguments itself.
    """
    names = [name for _, name in _FUNCTION.findall(declarations)]
    pointers = "\n".join(f"static __typeof__({name}) *const {name}_pointer = {name};\n"
                         f"#define {name} {name}_pointer" for name in names)
    return _FUNCTION.sub(r"\1(*const \2)(", declarations), pointers


def _optional_type(declarations: str) -> Real | None:
    """Return the type of numbers of these declarations if not every C compiler has it, or None."""
    return next((real for real in REALS.values() if not real.standard
                 and re.search(rf"\b{real.c_type}\b", declarations)), None)


def _refuse_without_quad(compiler: Compiler, folder: Path) -> None:
    """Refuse a compiler, or a C library, without binary128."""
    (folder / "binary128.c").write_text(_QUAD_PROBE, encoding="utf-8")
    command = [*compiler.command, *EXTENDED_FLAGS, "-fPIC", *compiler.link_flags, "binary128.c",
               "-lm", "-o", "binary128.out"]
    try:
        _wait_for([_start(command, folder)])
    except CompilerError as error:
        raise CompilerError(
            f"The compiler {shlex.join(compiler.command)!r} has no float128 (_Float128 and "
            "functions such as sqrtf128): that takes gcc 7 or later and glibc 2.26 or later. Set "
            "CC to such a gcc, or choose double, float or long-double.",
            command=error.command, stderr=error.stderr,
        ) from error


def module_name(name: str) -> str:
    """Return the name of the extension module of a stepper."""
    return f"_{name}"


def extension_suffix() -> str:
    """Return the file ending of extension modules of this interpreter."""
    return str(sysconfig.get_config_var("EXT_SUFFIX"))


def _start(command: list[str], folder: Path) -> _Running:
    """Start a compiler in a folder; raise CompilerError if the command cannot be run."""
    try:
        return command, subprocess.Popen(
            command, cwd=folder, stdin=subprocess.DEVNULL, encoding="utf-8", errors="replace",
            stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    except OSError as error:
        raise CompilerError(f"The compiler does not start: {error.strerror}. {_CURE}") from error


def exit_reason(code: int) -> str:
    """Return how a process failed: with an exit code, or by a signal, which subprocess negates."""
    return f"failed with exit code {code}" if code > 0 else f"was ended by signal {-code}"


def _wait_for(running: list[_Running]) -> None:
    """Wait for commands that run side by side; raise CompilerError for the first that failed.

    All are waited for, so that none writes into a folder that is removed.
    """
    outputs = [process.communicate() for _, process in running]
    for (command, process), (_, stderr) in zip(running, outputs, strict=True):
        if process.returncode != 0:
            raise CompilerError(f"The C compiler {exit_reason(process.returncode)}: "
                                f"{shlex.join(command)}\n{stderr.strip()}",
                                command=command,
                                stderr=stderr)
