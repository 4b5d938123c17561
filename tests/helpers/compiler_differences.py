"""What compilers make of the same C: ``python tests/helpers/compiler_differences.py``.

Every function of a stepper that evaluates and takes no step (H, g and f, quantities, residual, its
Jacobian, the starting guess) is compiled by gcc and clang at -O1 and -O3 with vectors of 256 and
512 bits, and called at random points.

    exact     the same text in long double, -O1, nothing contracted: its constants are to the bit
              those of the text in double, so that the difference is round-off alone
    plain     in double, -O1, nothing contracted, no vectors: |plain − exact| is what rounding does
    bound     8 max |plain − exact| over the points, of each entry; and 8 ε max |exact| of the
              function, for entries in which the plain order happens to cancel exactly

A compiler that rounds in another order stays below the bound; one that takes a wrong number is
above it by many powers of ten. Kernels, those of lanes too, are compared with their statements in
NumPy as after each compilation (``runtime.compilation.kernel_check``), at as many points.

With names, only those steppers; ``--minutes`` of CPU time after which no other one is begun.
"""

from __future__ import annotations

import argparse
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any

import cffi
import numpy as np
from numpy.typing import NDArray

from gyrospark.api import files_of
from gyrospark.core.errors import GyrosparkError
from gyrospark.core.real_types import REALS
from gyrospark.core.registry import MODELS
from gyrospark.generator.models.model_file import load_model
from gyrospark.generator.multibody.model import Model
from gyrospark.generator.pipeline import generate
from gyrospark.generator.schemes.named_schemes import SchemeName
from gyrospark.generator.spec import PAPER_SPECS, Spec
from gyrospark.references.problem_registry import REFERENCES
from gyrospark.runtime.compilation.compiler import (
    SPEED_FLAGS,
    Compiler,
    compile_module,
    is_whole,
    read_declarations,
)
from gyrospark.runtime.compilation.kernel_check import differences
from gyrospark.runtime.compilation.manifest import read_manifest
from gyrospark.runtime.compilation.object_files import (
    WITHOUT_PERMUTATIONS,
    ModuleKind,
    has_newton_apart,
    has_permutation,
    objects_of,
)
from gyrospark.runtime.compilation.verified_build import import_module
from gyrospark.runtime.rigid_body.problems import fast_top

__all__ = ["BUILDS", "Build", "KernelDifference", "StepperSource", "compare", "compare_kernels",
           "main", "sources"]

Array = NDArray[Any]

#: Random points, and entries of all points of a function with long results.
POINTS, ENTRIES = 10_000, 1_000_000
SEED, DT, SPREAD = 1, 0.01, 0.3
_FUNCTIONS = ("hamiltonian", "defects", "quantities", "residual", "jacobian", "guess")
_SCHEMES: tuple[tuple[SchemeName, int | None], ...] = (("G-L", 4), ("IMS", None))
_EXACT = ["-O1", "-ffp-contract=off", "-DGYROSPARK_PLAIN"]


@dataclass(frozen=True)
class Build:
    """A compiler and its flags; ``mended`` as Python builds, without what gcc gets wrong."""

    kind: str
    flags: tuple[str, ...]
    mended: bool = True

    def __str__(self) -> str:
        return " ".join((self.kind, *self.flags))

    def compile(self, source: Path, target: Path) -> int:
        """Compile and link a file; return how often that was done again."""
        tries = [[], *(WITHOUT_PERMUTATIONS if self.mended and self.kind == "gcc" else ())]
        again = 0
        while again == 0 or (again < len(tries) and has_permutation(target.read_bytes())):
            subprocess.run([self.kind, "-std=c11", "-w", "-fPIC", "-shared", *SPEED_FLAGS,
                            *self.flags, *tries[again], str(source), "-o", str(target), "-lm"],
                           check=True)
            again += 1
        return again - 1


BUILDS = tuple(Build(kind, (level, "-march=native", f"-mprefer-vector-width={bits}"))
               for kind in ("gcc", "clang") for level in ("-O1", "-O3") for bits in (256, 512))


@dataclass(frozen=True)
class StepperSource:
    """The files of a stepper, and a state and parameters of its system."""

    name: str
    files: Mapping[str, str]
    q: Array
    p: Array
    parameters: Mapping[str, Any]


@dataclass(frozen=True)
class KernelDifference:
    """The entry of a function that is furthest from the exact one.

    Attributes
    ----------
    entries
        How many were compared.
    error, bound
        |found − exact| and what rounding explains, where their ratio is largest.
    again
        Compilations until gcc's wrong permutation was gone.
    """

    stepper: str
    build: str
    function: str
    entries: int
    error: float
    bound: float
    again: int

    @property
    def holds(self) -> bool:
        """Whether rounding explains it; NaN and infinity are never explained."""
        return self.error <= self.bound


# ---------------------------------------------------------------- what is compared


def of_model(
    name: str, make: Callable[[], Model], scheme: SchemeName, stages: int | None
) -> StepperSource:
    """Return a stepper of a model, generated."""
    model = make()
    made = generate(Spec.from_arguments(scheme, stages, None, None, "double", None),
                    system=model.system)
    return StepperSource(f"{name} {made.source.name}", made.source.files(), *_start(model))


def _start(model: Model) -> tuple[Array, Array, dict[str, Any]]:
    return (np.array(model.q0, float), np.array(model.p0, float), dict(model.parameters))


def sources() -> Iterator[tuple[str, Callable[[], StepperSource]]]:
    """Yield the names of all steppers and what makes each."""
    for spec in PAPER_SPECS:
        yield spec.name, partial(_of_paper, spec)
    models: dict[str, Callable[[], Model]] = {
        **{name: entry.make for name, entry in MODELS.items()},
        **{name: found.make for name, found in REFERENCES.items()},
        **{path.stem: partial(load_model, path, None, {"ignore": "all"}) for path in robots()}}
    for name, make in models.items():
        for scheme, stages in _SCHEMES:
            yield name, partial(of_model, name, make, scheme, stages)


def robots() -> list[Path]:
    """Return the robots of PyPI's example-robot-data; none where it is not installed."""
    try:
        files = metadata.files("example-robot-data") or []
    except metadata.PackageNotFoundError:
        return []
    return [Path(str(file.locate())) for file in files if file.name.endswith(".urdf")]


def _of_paper(spec: Spec) -> StepperSource:
    name, files, problem = spec.name, files_of(spec), fast_top()
    values = {"gamma": 0.0013, "alpha": 0.0007, **problem.parameters}
    wanted = read_manifest(name, files).system.parameters
    return StepperSource(name, files, problem.q0, problem.p0, {key: values[key] for key in wanted})


# ---------------------------------------------------------------- comparing


class _Functions:
    """The functions of a stepper from one build, called at points."""

    def __init__(self, source: StepperSource, library: Path, real: str) -> None:
        self.source, self.real = source, real
        self.dtype: Any = np.longdouble if real == "long double" else np.float64
        self.name = next(f[:-2] for f in source.files if f.endswith(".c"))
        declarations = read_declarations(source.files[f"{self.name}.h"])
        self.declarations = re.sub(r"\bdouble\b", real, declarations)
        self.ffi = cffi.FFI()
        self.ffi.cdef(self.declarations)
        self.lib = self.ffi.dlopen(str(library))
        manifest = read_manifest(self.name, source.files)
        system, self.unknowns = manifest.system, int(manifest.scheme.unknowns)
        self.n, self.m = len(system.coordinates), len(system.constraints)
        self.quantities = len(system.quantities)
        self.parameters = self.ffi.new(
            f"{self.name}_parameters *", {k: float(v) for k, v in source.parameters.items()})
        self.work = np.zeros(int(getattr(self.lib, f"{self.name}_work_size")()) + 64, np.uint8)

    def has(self, function: str) -> bool:
        return re.search(rf"\b{self.name}_{function}\(", self.declarations) is not None

    def call(self, function: str, q: Array, p: Array, x: Array) -> Array:
        """Return what a function gives at each point, in rows."""
        found = re.search(rf"\b{self.name}_{function}\(([^;]*)\);", self.declarations)
        assert found is not None, function
        names = [re.findall(r"\w+", part.split("[")[0])[-1] for part in found[1].split(",")]
        count = len(q)
        sizes = {"H": 1, "g": self.m, "f": self.m, "out": self.quantities, "r": self.unknowns,
                 "J": self.unknowns**2} | ({"x": self.unknowns} if function == "guess" else {})
        outputs = {name: np.zeros((count, sizes[name]), self.dtype) for name in names
                   if name in sizes}
        given = {"q": q, "p": p, "x": x, "t": np.zeros(count)} | outputs
        arrays = {name: np.ascontiguousarray(a, self.dtype) for name, a in given.items()}
        arrays |= outputs
        rows = range(count) if "count" not in names else [slice(None)]
        start = -self.work.ctypes.data % 64
        for row in rows:
            arguments: dict[str, Any] = {
                "parameters": self.parameters, "count": count, "dt": DT,
                "work": self.ffi.cast(f"{self.name}_work *", self.work.ctypes.data + start)}
            arguments |= {name: self.ffi.from_buffer(f"{self.real}[]", a[row])
                          for name, a in arrays.items() if a[row].size}
            getattr(self.lib, f"{self.name}_{function}")(
                *(arguments.get(name, self.ffi.NULL) for name in names))
        return np.concatenate([outputs[name] for name in names if name in outputs], axis=1)


def compare(
    source: StepperSource, builds: Sequence[Build] = BUILDS, points: int = POINTS
) -> Iterator[KernelDifference]:
    """Yield for each build and function how far it is from the exact numbers."""
    with tempfile.TemporaryDirectory() as folder:
        exact = _compiled(source, Build(builds[0].kind, tuple(_EXACT), mended=False),
                          Path(folder) / "exact", "long double")[0]
        plain = _compiled(source, Build(builds[0].kind, tuple(_EXACT), mended=False),
                          Path(folder) / "plain")[0]
        rng = np.random.default_rng(SEED)
        wanted = {}
        for function in filter(exact.has, _FUNCTIONS):
            size = {"jacobian": exact.unknowns**2, "residual": exact.unknowns,
                    "guess": exact.unknowns}.get(function, 0)
            count = max(4, min(points, ENTRIES // size)) if size else points
            moved = max(SPREAD * float(np.abs(source.p).max()), 1e-3)
            at = (source.q + SPREAD * rng.normal(size=(count, exact.n)),
                  source.p + moved * rng.normal(size=(count, exact.n)),
                  SPREAD * rng.normal(size=(count, exact.unknowns if size else 0)))
            right, rounded = exact.call(function, *at), plain.call(function, *at)
            if not right.shape[1]:
                continue
            usable = np.isfinite(right).all(1) & np.isfinite(rounded).all(1)
            right, rounded = right[usable], rounded[usable]
            if not usable.any():
                continue
            bound = 8 * np.abs(rounded - right).max(0) + (
                8 * np.finfo(float).eps * np.abs(right).max())
            wanted[function] = at, usable, right, bound
        for number, build in enumerate(builds):
            made, again = _compiled(source, build, Path(folder) / str(number))
            for function, (at, usable, right, bound) in wanted.items():
                error = np.abs(made.call(function, *at)[usable] - right).max(0)
                error = np.where(np.isfinite(error), error, np.inf)
                worst = int(np.argmax(error / np.maximum(bound, np.finfo(float).tiny)))
                yield KernelDifference(source.name, str(build), function, right.size,
                                       float(error[worst]), float(bound[worst]), again)


def compare_kernels(
    source: StepperSource, builds: Sequence[Build] = BUILDS, points: int = POINTS
) -> Iterator[KernelDifference]:
    """Yield for each build the kernels that differ from their statements, or that all agree."""
    name = next(f[:-2] for f in source.files if f.endswith(".c"))
    manifest = read_manifest(name, source.files)
    parts: list[ModuleKind] = ["runs", "lanes"] if manifest.fast_path.available else ["runs"]
    if not is_whole() and has_newton_apart(name, source.files):
        parts.append("newton")
    for build in builds:
        compiler = Compiler((build.kind,), _version(build.kind))
        for module_kind in parts:
            with tempfile.TemporaryDirectory() as folder:
                path, checks = compile_module(name, dict(source.files), compiler, Path(folder),
                                              module_kind, (*build.flags, "-Wno-error"))
                found, kernels, _ = differences(import_module(name, path, module_kind), checks,
                                                REALS[manifest.real], points - points % 16)
            entries = points * sum(kernels.values())
            yield KernelDifference(source.name, str(build),
                                   f"{len(kernels)} kernels of {module_kind}",
                                   entries,
                                   0.0, 1.0, 0)
            for one in found:
                yield KernelDifference(source.name, str(build), one.kernel, points,
                                       abs(one.compiled - one.expected), one.allowed, 0)


def _version(kind: str) -> str:
    return subprocess.run([kind, "--version"], capture_output=True, text=True, check=True).stdout


def _compiled(
    source: StepperSource, build: Build, folder: Path, real: str = "double"
) -> tuple[_Functions, int]:
    """Compile the object with the functions that evaluate; return them."""
    folder.mkdir()
    name = next(f[:-2] for f in source.files if f.endswith(".c"))
    made = next(o for o in objects_of(name, source.files, "runs") if o.name in ("object1", "whole"))
    static = rf"__attribute__\(\(unused\)\) static (size_t {name}_work_size)"
    texts = {f"{name}.h": re.sub(static, r"\1", made.header),
             f"{name}.c": source.files[f"{name}.c"]}
    for file, text in texts.items():
        if real != "double":
            text = re.sub(r"\bdouble\b", real, text).replace("<math.h>", "<tgmath.h>")
        (folder / file).write_text(text, encoding="utf-8")
    number = tuple(flag for flag in made.flags if flag.startswith("-D"))
    again = replace(build, flags=(*build.flags, *number)).compile(
        folder / f"{name}.c", folder / "made.so")
    return _Functions(source, folder / "made.so", real), again


# ---------------------------------------------------------------- the program


def main(arguments: Sequence[str]) -> int:
    """Compare the steppers named, or all; return 1 where rounding does not explain a difference."""
    parser = argparse.ArgumentParser(prog="python tests/helpers/compiler_differences.py")
    parser.add_argument("names", nargs="*", help="of the paper, models, references, robots")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="of CPU time")
    parser.add_argument("--points", type=int, default=POINTS)
    chosen = parser.parse_args(arguments)
    worst, left = [], 0
    if not robots():
        print("Robots are left out: pip install example-robot-data (131 MB).")
    for name, make in sources():
        if chosen.names and name not in chosen.names:
            continue
        if _cpu_seconds() > 60 * chosen.minutes:
            left += 1
            continue
        try:
            source = make()
        except GyrosparkError as error:
            print(f"{name} is left out: {error}")
            continue
        found = [*compare(source, BUILDS, chosen.points),
                 *compare_kernels(source, BUILDS, chosen.points)]
        furthest = max(found, key=lambda one: one.error / max(one.bound, 1e-300))
        worst += [one for one in found if not one.holds]
        print(f"{source.name:<44} {len({one.function for one in found})} functions, "
              f"{sum(one.entries for one in found):>12,} numbers, "
              f"compiled again {sum({one.build: one.again for one in found}.values())}, largest "
              f"{furthest.error:.1e} where rounding explains {furthest.bound:.1e} "
              f"({furthest.function}, {furthest.build})", flush=True)
    for one in worst:
        print(f"WRONG: {one}")
    if left:
        print(f"{left} steppers are left out: {chosen.minutes:g} minutes are over.")
    return 1 if worst else 0


def _cpu_seconds() -> float:
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
