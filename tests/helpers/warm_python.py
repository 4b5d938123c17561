"""Processes of Python that find packages imported: forks of one that has imported them.

    warm = WarmPython(sys.executable, environment())
    done = warm.call(["-m", "gyrospark", "--version"], environment(), cwd=folder)

Most of what a short process takes is the import of SymPy, matplotlib and Zarr, and what SymPy and
Jinja keep of the first derivation. A fork runs ``-c`` or ``-m`` as a new interpreter does, in a
folder and with variables of its own, to the end of the interpreter. Variables that Python or its
packages read when they begin (``PYTHONHASHSEED``, ``LC_ALL``) take a new process.

As a program it is the process that forks: a request is a line of JSON, the answer an exit code.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import importlib
import json
import os
import runpy
import select
import signal
import subprocess
import sys
import tempfile
import types
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

#: Seconds. No process of the tests takes a tenth of it; a hang shall not stop the run.
PATIENCE = 300
#: Packages that take long to import, in every environment as far as they are installed.
PACKAGES = ("numpy", "sympy", "jinja2", "cffi", "click", "rich.progress", "mpmath", "platformdirs",
            "matplotlib.pyplot", "mpl_toolkits.mplot3d", "scipy.spatial.transform", "zarr",
            "xarray")
#: Code that imports modules of the package under test, and derives a first stepper.
OURS = """
import gyrospark.commands.run.command, gyrospark.commands.verify
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
generate(Spec.from_arguments("G-L", 2, "gamma"))
"""


class WarmPython:
    """A process of Python with its forks, which has run some code; it ends with its maker."""

    def __init__(
        self, python: str | Path, environment: Mapping[str, str], code: str = OURS
    ) -> None:
        self._python, self._environment, self._code = python, dict(environment), code
        self._process: subprocess.Popen[str] | None = None

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            atexit.unregister(self.close)
            self._process.communicate()
            self._process = None

    def call(
        self, words: Sequence[str | Path], environment: Mapping[str, str], *,
        cwd: Path | None = None, text: str = "",
    ) -> subprocess.CompletedProcess[str]:
        """Run ``python WORDS`` to its end with a text on stdin, its output captured."""
        words = list(map(str, words))
        if sys.platform != "linux" or _early(environment) != _early(self._environment):
            return subprocess.run(
                [str(self._python), *words], cwd=cwd, env=dict(environment), text=True,
                capture_output=True, timeout=PATIENCE, check=False, input=text, encoding="utf-8",
                errors="surrogateescape")
        if self._process is None:
            self._process = subprocess.Popen(
                [self._python, __file__, self._code], env=self._environment, stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, text=True, encoding="utf-8", start_new_session=True)
            atexit.register(self.close)
        requests, answers = self._process.stdin, self._process.stdout
        assert requests is not None
        assert answers is not None
        with tempfile.TemporaryDirectory() as folder:
            files = [Path(folder, name) for name in ("stdin", "stdout", "stderr")]
            files[0].write_text(text, encoding="utf-8")
            requests.write(json.dumps({"words": words, "cwd": str(cwd or Path.cwd()),
                                       "environment": dict(environment),
                                       "files": list(map(str, files))}) + "\n")
            requests.flush()
            if not select.select([answers], [], [], PATIENCE)[0]:
                os.killpg(self._process.pid, signal.SIGKILL)  # with the fork
                raise subprocess.TimeoutExpired(words, PATIENCE)
            exit_code = answers.readline()
            return subprocess.CompletedProcess(words, int(exit_code), *(
                path.read_text(encoding="utf-8", errors="surrogateescape") for path in files[1:]))


def _early(variables: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that Python and its packages read when they begin."""
    names = ("PYTHON", "LC_", "LANG", "MPL", "OPENBLAS", "OMP")
    return {name: value for name, value in variables.items() if name.startswith(names)}


def _fork_on_request(code: str) -> dict[str, object]:
    """Return in each fork, with its request."""
    del sys.path[0]  # the folder of this file
    for name in PACKAGES:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    exec(code, {})
    sys.path.insert(0, "")
    gc.freeze()
    for line in sys.stdin:
        with warnings.catch_warnings():  # the threads of OpenBLAS look after themselves
            warnings.simplefilter("ignore", DeprecationWarning)
            number = os.fork()
        if number == 0:
            request: dict[str, object] = json.loads(line)
            return request
        print(os.waitstatus_to_exitcode(os.waitpid(number, 0)[1]), flush=True)
    sys.exit()


def _become(words: list[str], cwd: str, environment: dict[str, str], files: list[str]) -> None:
    """Do in a fork the work of a new interpreter."""
    for number, file in enumerate(files):
        opened = os.open(file, os.O_WRONLY | os.O_CREAT if number else os.O_RDONLY)
        os.dup2(opened, number)
        os.close(opened)
    sys.stdin = os.fdopen(0, encoding="utf-8", closefd=False)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(environment)
    kind, target, *arguments = words
    if kind == "-m":
        sys.argv = [target, *arguments]
        runpy.run_module(target, run_name="__main__", alter_sys=True)
    else:
        sys.argv = ["-c", *arguments]
        main = sys.modules["__main__"] = types.ModuleType("__main__")
        exec(compile(target, "<string>", "exec"), vars(main))


if __name__ == "__main__":
    _become(**_fork_on_request(sys.argv[1]))  # type: ignore[arg-type]
