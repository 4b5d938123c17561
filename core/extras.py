"""Optional packages: the extras of pyproject.toml.

Messages name the packages, so that what they say to type works wherever gyrospark came from.
"""

from __future__ import annotations

import re
from pathlib import Path

__all__ = ["install", "packages_of"]

_PACKAGE = __name__.partition(".")[0]
_OWN = re.compile(rf"{_PACKAGE}\[([\w,-]+)\]")
_EXTRA = re.compile(r"""extra\s*==\s*["']([\w-]+)["']""")


def install(extra: str) -> str:
    """Return the command that installs the packages of an extra, in backticks."""
    return "`pip install " + " ".join(f'"{package}"' for package in packages_of(extra)) + "`"


def packages_of(extra: str) -> list[str]:
    """Return the requirements of an extra, with extras among them replaced by their own."""
    requirements: list[str] = []
    for requirement in _extras()[extra]:
        match = _OWN.match(requirement)
        if match is None:
            requirements.append(requirement.partition(";")[0].strip())
            continue
        for name in match[1].split(","):
            requirements += packages_of(name)
    return list(dict.fromkeys(requirements))


def _extras() -> dict[str, list[str]]:
    """Return the requirements of each extra, by name.

    In a checkout they are read from pyproject.toml, which may be newer than the metadata of the
    installation; a wheel has the metadata alone.
    """
    import tomllib  # both cost time, and most programs miss nothing
    from importlib import metadata

    project = Path(__file__).parents[1] / "pyproject.toml"
    if project.is_file():
        content = tomllib.loads(project.read_text(encoding="utf-8"))
        extras: dict[str, list[str]] = content["project"]["optional-dependencies"]
        return extras
    requirements_of: dict[str, list[str]] = {}
    for requirement in metadata.requires(_PACKAGE) or ():
        for name in _EXTRA.findall(requirement):
            requirements_of.setdefault(name, []).append(requirement)
    return requirements_of
