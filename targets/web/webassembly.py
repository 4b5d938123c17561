"""Target wasm: one module of one or several steppers, and a class of JavaScript that calls it."""

from __future__ import annotations

import json
import re
import struct
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...core.errors import GyrosparkError, InputError
from ...core.manifest import Manifest, NumberManifest
from ..artefact import Built, Options, Written
from ..native import C_FLAGS, refuse_difference
from ..tools import TOOLS, require, run_tool

__all__ = ["check", "compare", "compile", "compile_module", "files", "read", "start_of",
           "velocities_of"]

_HERE = Path(__file__).resolve().parent
#: Without an entry of its own the module imports nothing; a step needs little of a stack.
_LINK = ("-Wl,--no-entry", "-Wl,-z,stack-size=65536", "-Wl,--export=__heap_base", "-s")
#: Headers and the whole C library, which ziglang compiles at first, in 50 s of CPU time.
_WITH_LIBRARY = ("-target", "wasm32-wasi", "-mexec-model=reactor")
#: Functions of compiled code alone, fma, sin and their like, which ziglang compiles in 7 s.
_WITHOUT_LIBRARY = ("-target", "wasm32-freestanding")
#: Functions of glue.c.
_OWN = ("repeat", "defects")
#: Where the C of an artefact is.
SOURCES = "c"
#: Steps of a check.
_STEPS = 2000
#: Memory of WebAssembly grows by pages.
_PAGE_BYTES = 65536


def files(
    manifest: Manifest, sources: Mapping[str, str], options: Options
) -> dict[str, str | bytes]:
    """Return the C, and ``NAME.mjs`` with the class ``Stepper``, names and numbers."""
    name = manifest.name
    facts = {"schemes": schemes_of(options), "start": start_of(manifest, options),
             "velocities": [x.name for x in velocities_of(manifest)]}
    constants = "".join(f"export const {constant_name} = {json.dumps(content)};\n"
                        for constant_name, content in facts.items())
    script = f"{read('stepper.js')}\n{constants}export {{ Stepper }};\n"
    return {**c_files(options), f"{name}.mjs": script}


def c_files(options: Options) -> dict[str, str | bytes]:
    """Return the C of all steppers, and glue.c, which is compiled with each."""
    c_sources: dict[str, str | bytes] = {f"{SOURCES}/glue.c": read("glue.c")}
    for stepper in options.steppers:
        refuse_different_inputs(options.steppers[0], stepper)
        c_sources |= {f"{SOURCES}/{file}": text for file, text in stepper.sources.items()}
    return c_sources


def refuse_different_inputs(first: Written, stepper: Written) -> None:
    """Refuse a stepper whose coordinates or parameters differ: all steppers share one start."""
    for key in ("coordinates", "parameters"):
        if getattr(stepper.manifest.system, key) != getattr(first.manifest.system, key):
            raise InputError(f"{stepper.manifest.scheme.method} has other {key} than "
                             f"{first.manifest.scheme.method}; build them apart.")


def schemes_of(options: Options) -> list[dict[str, str]]:
    """Return label and name of each stepper."""
    return [{"label": stepper.manifest.scheme.method, "name": stepper.name}
            for stepper in options.steppers]


def velocities_of(manifest: Manifest) -> list[NumberManifest]:
    """Return the numbers that ``NAME_start`` takes as velocities; none where it is not there."""
    return [x for x in manifest.system.numbers if x.role == "velocity"]


def start_of(manifest: Manifest, options: Options) -> dict[str, Any]:
    """Return the numbers that ``Stepper`` of stepper.js begins with."""
    return {"real": manifest.real, "dt": options.dt, "parameters": dict(options.parameters),
            "q": list(options.q), "p": list(options.p),
            "velocities": len(velocities_of(manifest))}


def read(name: str) -> str:
    """Return a file of this folder."""
    return (_HERE / name).read_text(encoding="utf-8")


def compile(folder: Path, platforms: tuple[str, ...]) -> Path:
    """Compile the module; return the folder."""
    module = next(folder.glob("*.mjs")).with_suffix(".wasm")
    compile_module(folder / SOURCES, module)
    return folder


def compile_module(folder: Path, module: Path, level: str = "-O2") -> None:
    """Compile all steppers of a folder, each with glue.c, as one module that imports nothing."""
    compiler = [*require("zig", "WebAssembly"), "cc"]
    # vector registers, which all engines have, make products in twice the precision fast
    flags = ["-msimd128", *C_FLAGS, level]
    manifests = [Manifest.from_text(path.read_text(encoding="utf-8"))
                 for path in sorted(folder.glob("*.json"))]
    for manifest in manifests:
        run_tool([*compiler, *_WITH_LIBRARY, *flags, *definitions(manifest), "-c", "glue.c", "-o",
                  f"{manifest.name}.o"], folder, "Compiling WebAssembly")
    objects = [f"{manifest.name}.o" for manifest in manifests]
    exports = [f"-Wl,--export={function}" for manifest in manifests
               for function in exported_functions(
                   manifest.name, (folder / f"{manifest.name}.h").read_text(encoding="utf-8"))]
    # without the C library, unless a function of mathematics is missing then
    for target in (_WITHOUT_LIBRARY, _WITH_LIBRARY):
        try:
            run_tool([*compiler, *target, *flags, *_LINK, *exports, *objects, "-o",
                      str(module.resolve())], folder, "Linking WebAssembly")
            break
        except GyrosparkError as error:
            if target is _WITH_LIBRARY or "undefined symbol" not in str(error):
                raise
    for name in objects:
        (folder / name).unlink()


def definitions(manifest: Manifest) -> list[str]:
    """Return the compiler's definitions for glue.c: stepper, kind of scheme, constraints."""
    kind = manifest.scheme.kind
    return [f'-DSTEPPER="{manifest.name}.c"', f"-DSPARK={int(kind == 'spark')}",
            f"-DSPLITTING={int(kind == 'splitting')}",
            f"-DCONSTRAINTS={len(manifest.system.constraints)}"]


def exported_functions(name: str, header: str) -> list[str]:
    """Return the functions of a stepper in the module: those of its header, and of glue.c."""
    declared = re.findall(rf"^[\w ]*?\b{name}_(\w+)\(", header, re.MULTILINE)
    return [f"{name}_{function}" for function in (*dict.fromkeys(declared), *_OWN)]


# ---------------------------------------------------------------- checks


def check(built: Built) -> str:
    """Run the module in wasmtime and Node, where they are, and compare bits with native C."""
    name = built.stepper.name
    return compare(built, (built.path / f"{name}.wasm").read_bytes())


def compare(built: Built, module: bytes) -> str:
    """Compare all steppers of a module with native C, in each engine that is here.

    Raises InputError where there is neither wasmtime nor Node; GyrosparkError where a bit differs.
    """
    engines = {name: run for name, run in (("wasmtime", _in_wasmtime), ("node", _in_node))
               if TOOLS[name].find() is not None}
    if not engines:
        require("wasmtime", f"Checking target {built.target.name}")
    steppers = built.options.steppers
    return "; ".join(
        refuse_difference(f"{stepper.name} in {engine}", bits, built, _STEPS, stepper)
        for engine, run in engines.items()
        for stepper, bits in zip(steppers, run(module, built.options), strict=True))


def _in_node(module: bytes, options: Options) -> list[str]:
    """Return the bits of q and p of each stepper after the steps of a check, in Node."""
    about = {"schemes": schemes_of(options), "steps": _STEPS,
             "start": start_of(options.steppers[0].manifest, options)}
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        (folder / "stepper.wasm").write_bytes(module)
        (folder / "about.json").write_text(json.dumps(about), encoding="utf-8")
        (folder / "check.mjs").write_text(read("stepper.js") + read("check.js"), encoding="utf-8")
        return run_tool([*require("node", "This check"), "check.mjs"], folder, "Node").split()


def _in_wasmtime(module: bytes, options: Options) -> list[str]:
    """Return the bits of q and p of each stepper after the steps of a check, in wasmtime."""
    import wasmtime

    store = wasmtime.Store()
    instance = wasmtime.Instance(store, wasmtime.Module(store.engine, module), [])
    exports = instance.exports(store)
    bits = []
    for stepper in options.steppers:
        # "<": WebAssembly is little-endian on every machine
        real = "f" if stepper.manifest.real == "float" else "d"
        arrays = [struct.pack(f"<{len(numbers)}{real}", *numbers) for numbers in (
            [*options.parameters.values()], options.q, options.p)]
        arrays.append(struct.pack(f"<{real}i", 0.0, options.max_iterations))
        work_size = exports[f"{stepper.name}_work_size"](store)
        arrays += [bytes(16), bytes(work_size)]  # where "repeat" counts steps, and solver memory
        addresses = _written_to_memory(store, exports, arrays)
        parameters, q, p, limits, count, work = addresses
        exports[f"{stepper.name}_begin"](store, work, parameters, limits, options.dt, q, p)
        exports[f"{stepper.name}_repeat"](store, work, q, p, _STEPS, count)
        memory = exports["memory"]
        state = [memory.read(store, address, address + len(array))
                 for address, array in zip((q, p), arrays[1:3], strict=True)]
        bits.append(b"".join(state).hex())
    return bits


def _written_to_memory(store: Any, exports: Any, arrays: Sequence[bytes]) -> list[int]:
    """Write arrays behind each other to the free memory of a module; return their addresses.

    Each begins at a multiple of 16 bytes, which every type of number is aligned to.
    """
    memory: Any = exports["memory"]
    base = exports["__heap_base"].value(store)
    addresses, end = [], _rounded_up(base, 16)
    for array in arrays:
        addresses.append(end)
        end += _rounded_up(len(array), 16)
    missing_bytes = end - memory.data_len(store)
    if missing_bytes > 0:
        memory.grow(store, _rounded_up(missing_bytes, _PAGE_BYTES) // _PAGE_BYTES)
    for address, array in zip(addresses, arrays, strict=True):
        memory.write(store, array, address)
    return addresses


def _rounded_up(number: int, unit: int) -> int:
    """Return the least multiple of ``unit`` that is not below ``number``."""
    return (number + unit - 1) // unit * unit
