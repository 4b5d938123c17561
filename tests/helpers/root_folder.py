"""The root folder is the package that the tests import, and not a package of tests.

Without this plugin pytest imports its ``__init__.py`` under the folder's name: twice under any
name, and not at all where the name has a hyphen.
"""

from __future__ import annotations

from pathlib import Path

import pytest


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Return the root folder as a plain folder."""
    if path == parent.config.rootpath:
        return pytest.Dir.from_parent(parent, path=path)
    return None
