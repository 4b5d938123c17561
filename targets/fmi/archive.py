"""The libraries of an FMU, and the file that holds them with their sources."""

from __future__ import annotations

import os
import platform
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from ...core.errors import InputError
from ..tools import require, run_tool

__all__ = ["OWN", "PLATFORMS", "Platform", "compile_fmu", "library_of", "own_platform"]

#: The platform of this machine, by its own compiler.
OWN = "own"
#: One set for all: ziglang compiles a C library for each set of flags. With -O2 the library of the
#: double pendulum has 161 kB instead of 76, and a step of it takes 5.3 µs instead of 6.2.
_FLAGS = ("-std=c11", "-Os", "-ffp-contract=off", "-fvisibility=hidden", "-Wall", "-Wextra")
#: The start of the calendar of zip files.
_NO_TIME = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class Platform:
    """A platform for which a library is compiled.

    Attributes
    ----------
    folders : tuple of str
        In ``binaries/`` of FMI 2.0 and of FMI 3.0; empty where the version has no name for it.
    target : str
        Of zig.
    suffix : str
    """

    folders: tuple[str, str]
    target: str
    suffix: str

    def flags(self, library: str) -> list[str]:
        """Return the flags of this platform; no path of the folder enters the library."""
        flags_by_suffix = {".so": ["-fPIC", "-s"], ".dll": [],
                           ".dylib": ["-fPIC", f"-Wl,-install_name,@rpath/{library}"]}
        return [*flags_by_suffix[self.suffix], "-shared"]


# glibc 2.17, of 2012, is that of manylinux2014: later ones load libraries that are linked with it
_LINUX = Platform(("linux64", "x86_64-linux"), "x86_64-linux-gnu.2.17", ".so")
_ARM_LINUX = Platform(("", "aarch64-linux"), "aarch64-linux-gnu.2.17", ".so")
_WINDOWS = Platform(("win64", "x86_64-windows"), "x86_64-windows-gnu", ".dll")
_MAC = Platform(("darwin64", "x86_64-darwin"), "x86_64-macos", ".dylib")
_ARM_MAC = Platform(("", "aarch64-darwin"), "aarch64-macos", ".dylib")

#: By the names of ``--for``.
PLATFORMS: dict[str, tuple[Platform, ...]] = {
    "linux": (_LINUX,), "windows": (_WINDOWS,), "mac": (_MAC, _ARM_MAC),
    "aarch64": (_ARM_LINUX,),
}


def own_platform(version: int) -> Platform:
    """Return the platform of this machine.

    Raises InputError where that version of FMI has no name for it.
    """
    # as FMI 3 spells them
    machine = {"amd64": "x86_64", "arm64": "aarch64"}.get(platform.machine().lower(),
                                                          platform.machine())
    system = {"win32": "windows"}.get(sys.platform, sys.platform)
    for candidate in chain.from_iterable(PLATFORMS.values()):
        # entry 0 is the folder of FMI 2, entry 1 that of FMI 3; empty without a name
        if candidate.folders[1] == f"{machine}-{system}" and candidate.folders[version - 2]:
            return candidate
    raise InputError(f"FMI {version}.0 has no name for this machine ({machine}-{system}); choose "
                     f"other platforms of {', '.join(PLATFORMS)}.")


def compile_fmu(folder: Path, name: str, version: int, platforms: tuple[str, ...]) -> Path:
    """Compile ``folder/sources`` for platforms into ``folder/binaries``; return the FMU.

    The file is the same to the byte for the same sources and compilers: its members are sorted and
    have no time. Raises InputError where a compiler is missing, or the version has no name for a
    platform; GyrosparkError where a compiler fails.
    """
    purpose = f"Target fmu{version}"
    compilers = _compilers(version, platforms, purpose)

    def link(target: Platform) -> None:
        """Compile and link the library of one platform."""
        library = folder / _library(name, version, target)
        library.parent.mkdir(parents=True, exist_ok=True)
        run_tool([*compilers[target], *_FLAGS, *target.flags(library.name), f"fmi{version}.c",
                  f"{name}.c",
                  "-o", f"../{_library(name, version, target)}", "-lm"], folder / "sources",
                 purpose)
        for file in library.parent.iterdir():
            if file != library:  # beside a DLL zig writes .pdb and .lib
                file.unlink()

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(link, compilers))
    fmu = folder / f"{name}.fmu"
    with zipfile.ZipFile(fmu, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for path in sorted(path for path in folder.rglob("*") if path.is_file() and path != fmu):
            member = zipfile.ZipInfo(path.relative_to(folder).as_posix(), _NO_TIME)
            # 3 is Unix: by default this byte depends on the machine
            member.compress_type, member.create_system = zipfile.ZIP_DEFLATED, 3
            member.external_attr = 0o644 << 16  # Unix keeps its permissions in the upper half
            archive.writestr(member, path.read_bytes())
    return fmu


def _compilers(version: int, platforms: tuple[str, ...], purpose: str) -> dict[Platform, list[str]]:
    """Return the command that compiles for each named platform.

    "own" is this machine's platform, which its own C compiler serves. A platform that is named,
    even if it is this one, is compiled by zig.
    """
    compilers: dict[Platform, list[str]] = {}
    for name in platforms:
        members = (own_platform(version),) if name == OWN else PLATFORMS[name]
        members = tuple(member for member in members if member.folders[version - 2])
        if not members:
            raise InputError(f"FMI {version}.0 has no name for platform {name!r}; take fmu3, or "
                             "leave it out.")
        for member in members:
            if name != OWN:
                compilers[member] = [*require("zig", purpose), "cc", "-target", member.target, "-s"]
            elif member not in compilers:
                compilers[member] = require("cc", purpose)
    return compilers


def _library(name: str, version: int, target: Platform) -> str:
    """Return the path in an FMU of the library for a platform."""
    return f"binaries/{target.folders[version - 2]}/{name}{target.suffix}"


def library_of(fmu: Path, name: str, version: int, folder: Path) -> Path:
    """Extract the library of this machine into ``folder`` and return its path.

    Raises InputError where the FMU has none.
    """
    target = own_platform(version)
    member = _library(name, version, target)
    with zipfile.ZipFile(fmu) as archive:
        if member not in archive.namelist():
            raise InputError(f"{fmu.name} holds no library for this machine, {target.folders[1]}; "
                             f"build it for platform {OWN!r}, too.")
        return Path(archive.extract(member, folder))
