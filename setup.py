"""The README as a package index shows it; everything else of the build is in pyproject.toml.

An index has none of the repository's files and, as yet, no address of it: pictures are left out,
and of a link to a file its text is kept.
"""

import re
from pathlib import Path

from setuptools import setup

PICTURE = re.compile(r"^!\[[^]]*\]\((?!https:)[^)]*\)\n\n", flags=re.MULTILINE)
LINK = re.compile(r"\[([^]]*)\]\((?!https:|#)[^)]*\)")

readme = Path(__file__).with_name("README.md").read_text(encoding="utf-8")
setup(
    script_name="setup.py",  # lies in the package's folder and is no module of it
    long_description=LINK.sub(r"\1", PICTURE.sub("", readme)),
    long_description_content_type="text/markdown",
)
