"""Target rust: a crate without dependencies, ``no_std``, whose build.rs calls a C compiler."""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from ..core.manifest import Manifest
from .artefact import EXAMPLE_STEPS, Built, Options, fill_template, refuse_names, template_values
from .native import refuse_difference
from .tools import require, run_tool

__all__ = ["check", "compile", "files"]

# Of Rust 2024; C has some of them as well.
_WORDS = (
    "abstract as async await become box break const continue crate do dyn else enum extern false "
    "final fn for gen if impl in let loop macro match mod move mut override priv pub ref return "
    "self Self static struct super trait true try type typeof unsafe unsized use virtual where "
    "while yield")
_KEYWORDS = frozenset(_WORDS.split())


def files(
    manifest: Manifest, sources: Mapping[str, str], options: Options
) -> dict[str, str | bytes]:
    """Return path → text of the crate: the C, build.rs, which compiles it, lib.rs and an example.
    """
    refuse_names(manifest, _KEYWORDS, "Rust")
    template_fields = template_values(manifest, sources, options)
    # the crate's work memory is an array of u64, which aligns it to 8 bytes as the C's struct is
    template_fields |= {"f": "f32" if template_fields["real"] == "float" else "f64",
                        "words": math.ceil(template_fields["work_size"] / 8)}
    return {**{f"c/{name}": text for name, text in sources.items()},
            "Cargo.toml": fill_template("Cargo.toml", **template_fields),
            "build.rs": fill_template("build.rs"),
            "src/lib.rs": fill_template("lib.rs", **template_fields),
            "examples/steps.rs": fill_template("steps.rs", **template_fields)}


def compile(folder: Path, platforms: tuple[str, ...]) -> Path:
    """Return the folder: cargo compiles it."""
    return folder


def check(built: Built) -> str:
    """Run the tests of a copy of the crate, and its example; compare the bits."""
    cargo = require("cargo", "Checking target rust")
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name) / "crate"
        for name in built.files:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(built.path / name, folder / name)
        run_tool([*cargo, "test", "--offline", "--quiet"], folder, "Testing the crate")
        bits = run_tool([*cargo, "run", "--offline", "--quiet", "--example", "steps", "bits"],
                        folder, "The example")
    return refuse_difference("Rust", bits, built, EXAMPLE_STEPS)
