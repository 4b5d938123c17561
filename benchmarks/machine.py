"""Machine and versions with which a result was measured."""

from __future__ import annotations

import os
import platform
import shlex
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import gyrospark as gs

from .peers.optional import version
from .reference_states import about as reference_about

__all__ = ["about"]


def about(packages: Iterable[str]) -> dict[str, Any]:
    """Return machine, compiler and the versions of the packages that are installed."""
    compiler = shlex.split(os.environ.get("CC", "cc"))
    version_output = subprocess.run([*compiler, "--version"], check=True, capture_output=True,
                                    text=True)
    versions = {name: version(name) for name in ("numpy", *packages)}
    return {
        "gyrospark": gs.__version__,
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1),  # other work shares the caches and lengthens times
        "compiler": version_output.stdout.splitlines()[0],
        "packages": {name: number for name, number in versions.items() if number},
        "reference": reference_about(),
    }


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
