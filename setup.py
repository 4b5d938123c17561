"""Steps of the build that need code; everything else is in pyproject.toml.

The README for a package index: an index has none of the repository's files and, as yet, no
address of it, so pictures are left out, and a link to a file is replaced by its text.

A wheel has the C of all steppers of the paper: those of ``generated/`` that the repository lacks
are derived into it, so that its users need not derive them.

A wheel for one platform (RELEASE.md), where GYROSPARK_PREBUILT names steppers of ``generated/``:
with their compiled modules in it, its user's first steps take no compiler.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

PICTURE = re.compile(r"^!\[[^]]*\]\((?!https:)[^)]*\)\n\n", flags=re.MULTILINE)
LINK = re.compile(r"\[([^]]*)\]\((?!https:|#)[^)]*\)")
PREBUILT = os.environ.get("GYROSPARK_PREBUILT", "").split()
#: Run with the package as it will be installed, in its parent folder.
DERIVE = """
from pathlib import Path
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import PAPER_SPECS
folder = Path("gyrospark", "generated")
for spec in PAPER_SPECS:
    if not (folder / f"{spec.name}.json").is_file():
        for name, text in generate(spec).source.files(standalone=False).items():
            (folder / name).write_bytes(text.encode())
"""
PREBUILD = """
import sys
from pathlib import Path
from gyrospark.api import checked_in_files
from gyrospark.runtime.compilation.prebuilt import FOLDER, prebuild
prebuild({name: checked_in_files(name) for name in sys.argv[1:]}, FOLDER)
"""


class BuildWithSteppers(build_py):
    """Derives and compiles steppers beside the copied package."""

    def run(self):
        """Copy, derive, then compile."""
        super().run()
        if self.editable_mode:
            return
        folder = Path(self.build_lib).resolve()
        packages = os.pathsep.join([str(folder), *filter(None, sys.path)])  # of pip wheel, too
        for program, names in ((DERIVE, []), *([(PREBUILD, PREBUILT)] if PREBUILT else [])):
            subprocess.run([sys.executable, "-B", "-c", program, *names], check=True,
                           env=os.environ | {"PYTHONPATH": packages}, cwd=folder)


class WithModules(Distribution):
    """A distribution with the compiled modules of GYROSPARK_PREBUILT."""

    def has_ext_modules(self):
        """Return whether the wheel contains compiled modules."""
        return bool(PREBUILT)


class WheelOfAPlatform(bdist_wheel):
    """One wheel for this Python and all later ones, where it has compiled modules."""

    def get_tag(self):
        """Return Python, its interface and the platform."""
        python, abi, platform = super().get_tag()
        return ("cp311", "abi3", platform) if PREBUILT else (python, abi, platform)


readme = Path(__file__).with_name("README.md").read_text(encoding="utf-8")
setup(
    script_name="setup.py",  # lies in the package's folder and is no module of it
    long_description=LINK.sub(r"\1", PICTURE.sub("", readme)),
    long_description_content_type="text/markdown",
    distclass=WithModules,
    cmdclass={"build_py": BuildWithSteppers, "bdist_wheel": WheelOfAPlatform},
)
