"""The build of setuptools, whose wheels have the C that the package's own generator derives.

``setup.py`` runs the generator, which needs what the package needs; an editable installation
derives nothing.
"""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403


def get_requires_for_build_wheel(config_settings: Any = None) -> list[str]:
    """Return the requirements of setuptools, and the package's own: building derives steppers."""
    project = tomllib.loads(Path("pyproject.toml").read_text(encoding="utf-8"))["project"]
    compiler = ["ziglang>=0.13; platform_system == 'Windows'"]
    return [*build_meta.get_requires_for_build_wheel(config_settings), *project["dependencies"],
            *(compiler if os.environ.get("GYROSPARK_PREBUILT") else [])]
