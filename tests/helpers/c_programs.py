"""Writing, compiling and running C programs around generated files."""

from __future__ import annotations

import cffi
import numpy as np

from compilers import MAIN, compiler
from gyrospark.core.manifest import Manifest
from gyrospark.runtime.compilation.compiler import read_declarations
from processes import call

STRICT = ["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]


def write(files, folder):
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")


def run(command, folder, **changes):
    """Run a command that must succeed without a word on stderr."""
    process = call(command, cwd=folder, **changes)
    assert process.returncode == 0, process.stderr
    assert not process.stderr
    return process.stdout


class Program:
    """A stepper of any profile, compiled as a user of C compiles it, and its functions by cffi."""

    def __init__(self, source, folder, *flags):
        folder.mkdir(exist_ok=True)
        write(source.files(), folder)
        self.name, header = source.name, source.header
        self.path = folder / f"{self.name}.so"
        run([*compiler(MAIN), *STRICT, *flags, "-ffp-contract=off", "-shared", "-fPIC",
             f"{self.name}.c", "-o", self.path, "-lm"], folder)
        if "begin declarations" in header:
            declared = read_declarations(header)
        else:  # of profile control, which cffi never reads
            declared = header[header.index("/* Status codes"):].partition(
                f"#ifdef {self.name.upper()}_WORK")[0]
        self.ffi = cffi.FFI()
        self.ffi.cdef(declared)
        self.library = self.ffi.dlopen(str(self.path))
        self.manifest = Manifest.from_text(source.manifest)
        self.c_type = self.manifest.real.replace("-", " ")
        self.type = {"float": np.float32, "double": np.float64}.get(self.c_type, np.longdouble)

    def __getattr__(self, function):
        return getattr(self.library, f"{self.name}_{function}")

    def parameters(self, values):
        return self.ffi.new(f"{self.name}_parameters *", dict(values))

    def options(self, *values):
        return self.ffi.new(f"{self.name}_options *", values)

    def new_work(self):
        """Return work memory; only the last one stays alive."""
        self.memory = self.ffi.new("char[]", self.work_size())
        return self.ffi.cast(f"{self.name}_work *", self.memory)

    def pointer(self, array):
        return self.ffi.cast(f"{self.c_type} *", array.ctypes.data)
