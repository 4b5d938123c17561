"""Steppers as artefacts of other programs: ``gyrospark build TARGET MODEL`` and ``gs.build``.

In: a model and the name of a target.
Out: a folder or file that another program uses, checked bit by bit.
Open first: ``build.build``.

    build           ``gs.build``: from a model to an artefact that is written
    artefact        what a target is given, what it makes, and how it is written
    tools           programs and packages that targets need, and the cure where one is missing
    native          the same C, compiled here: the bits that every check compares with
    texts           templates of what targets write
    cpp, rust       a class of C++17 by value; a crate
    octave          a function of Octave and MATLAB
    arduino         a library of Arduino and PlatformIO
    fmu2, fmu3      an FMU for co-simulation, of FMI 2.0 and of FMI 3.0; what they share is in fmi/
    web             WebAssembly, and a page that integrates
    cuda            kernels of CUDA, a thread for each trajectory

A target is one module with

    files(manifest, sources, options)         path → text or bytes; pure
    compile(folder, platforms)                makes binaries of what ``files`` wrote to ``folder``;
                                              returns the artefact: ``folder``, or a file in it
    check(built)                              loads the artefact again, compares bits with
                                              ``native``; returns a sentence

and one line of ``TARGETS``. C, JavaScript and so on that is not derived lies beside the module,
in files that compile as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Protocol, cast

from ..core.manifest import Manifest
from ..core.real_types import RealName

if TYPE_CHECKING:
    from pathlib import Path

    from .artefact import Built, Options

__all__ = ["TARGETS", "Target", "TargetModule"]


class TargetModule(Protocol):
    """The functions of a target's module."""

    def files(
        self, manifest: Manifest, sources: Mapping[str, str], options: Options
    ) -> dict[str, str | bytes]:
        """Return path → content of each file; equal arguments give equal bytes."""

    def compile(self, folder: Path, platforms: tuple[str, ...]) -> Path:
        """Compile the files in ``folder``; return the artefact, ``folder`` or a file in it."""

    def check(self, built: Built) -> str:
        """Load the artefact and compare its bits with native C; return a sentence on the result."""


@dataclass(frozen=True)
class Target:
    """A form in which a stepper can be written, such as a crate or an FMU.

    Attributes
    ----------
    name, about : str
        On the command line; one line for ``--list``.
    module : str
        In this package.
    needs, checks : tuple of str
        Names in ``tools.TOOLS``: tools that write the artefact, and tools that check it.
    suffix : str
        Of the artefact's file; empty for a folder.
    platforms : tuple of str
        Choices of ``--for``, the platforms of its binaries; the first is the default.
    several : bool
        Whether several schemes go into one artefact.
    has_velocities : bool
        Whether the artefact starts from velocities in place of momenta, where H has them.
    real : str
        Floating-point type where none is chosen.
    """

    name: str
    module: str
    about: str
    needs: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()
    suffix: str = ""
    platforms: tuple[str, ...] = ()
    several: bool = False
    has_velocities: bool = False
    real: RealName = "double"

    def load(self) -> TargetModule:
        """Return the module."""
        return cast("TargetModule", import_module(f"{__name__}.{self.module}"))


#: One line for each target.
TARGETS: dict[str, Target] = {target.name: target for target in (
    Target("cpp", "cpp", "C++17: a class by value, CMake", checks=("c++", "cc")),
    Target("rust", "rust", "a Rust crate without std and dependencies", checks=("cargo", "cc")),
    Target("octave", "octave", "a function of Octave and MATLAB, one mex file",
           checks=("octave", "mkoctfile", "cc")),
    Target("arduino", "arduino", "a library of Arduino and PlatformIO", checks=("c++", "cc"),
           real="float"),
    Target("fmu2", "fmu2", "FMU for co-simulation, FMI 2.0", checks=("cc",), suffix=".fmu",
           platforms=("own", "linux", "windows", "mac"), has_velocities=True),
    Target("fmu3", "fmu3", "FMU for co-simulation, FMI 3.0", checks=("cc",), suffix=".fmu",
           platforms=("own", "linux", "windows", "mac", "aarch64"), has_velocities=True),
    Target("wasm", "web.webassembly", "WebAssembly without imports, and a class of JavaScript",
           needs=("zig",), checks=("wasmtime", "cc"), several=True),
    Target("web", "web.page", "a page that integrates, one HTML file without network",
           needs=("zig",), checks=("wasmtime", "cc"), suffix=".html", several=True),
    Target("cuda", "cuda", "CUDA: kernels with a thread for each trajectory", checks=("cc",)),
)}
