"""``generate``: write a stepper's C, compile it, print its properties."""

from __future__ import annotations

import difflib
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.arguments import count_text, join_or
from ..core.errors import CompilerError, InputError
from ..core.file_formats import staged_file
from ..core.lazy_imports import imported_for_good
from ..core.manifest import Manifest
from ..core.progress import log_task
from ..core.registry import MODELS
from ..engine.amalgamate import complete
from ..generator.codegen.profiles import PROFILES
from ..generator.fingerprint import generator_fingerprint
from ..generator.spec import PAPER_SPECS, Spec
from .options import (
    PATH,
    check_no_file,
    completing,
    frame_option,
    is_given,
    spec_from,
    stepper_options,
)

if TYPE_CHECKING:
    from ..generator.pipeline import Generated
    from ..runtime.compilation.object_files import ModuleKind

__all__ = ["generate"]


@click.command(no_args_is_help=True, context_settings={"help_option_names": ["-h", "--help"]})
@stepper_options
@frame_option
@click.option("--profile", metavar="NAME", shell_complete=completing(PROFILES),
              help=f"How much is written: {join_or(PROFILES)} (default: full, which Python needs).")
@click.option("--out", type=PATH, default=Path("generated"),
              show_default=True, metavar="DIR", help="Where the three files go.")
@click.option("--check", is_flag=True,
              help="Write nothing; fail with a diff if the files in DIR are not up to date.")
@click.option("--all", "everything", is_flag=True, help="Every stepper of the paper.")
@click.option("--no-compile", is_flag=True,
              help="Only write the C; cc -I \"$(gyrospark include)\" builds it.")
@click.option("--standalone", is_flag=True,
              help="Put the engine into the C, which cc then builds alone; profiles control "
                   "and run are always written so.")
@click.option("--derivatives", is_flag=True,
              help="Write tangents and adjoints of steps and runs, too.")
@click.option("--allow-invalid", is_flag=True,
              help="Generate from a tableau although it violates required conditions.")
def generate(
    profile: str | None, out: Path, check: bool, everything: bool, no_compile: bool,
    standalone: bool, derivatives: bool, allow_invalid: bool, **choice: Any,
) -> int:
    """Write DIR/<name>.h, .c and .json for a stepper, and compile it.

    \b
    gyrospark generate --scheme G-L --stages 3 --rep gamma
    gyrospark generate --scheme EMS --rep alpha --no-compile --out exported
    gyrospark generate --scheme G-L --stages 2 --system examples/pendulum.toml
    gyrospark generate --tableau examples/tableaux/gauss_lobatto_2.json
    gyrospark generate --scheme G-L --stages 2 --real float --profile control
    gyrospark generate --scheme G-L --stages 3 --frame symmetries
    gyrospark generate --scheme G-L --stages 3 --profile run --derivatives
    gyrospark generate --scheme G-L --stages 3 --energy
    gyrospark generate --check --all
    """
    specs = _specs(profile, choice, everything=everything, check=check)
    check_no_file("--out", out)
    if check:  # all of them: a diff of each, not of the first alone
        return max(check_files(spec, out, allow_invalid, standalone, derivatives)
                   for spec in specs)
    for spec in specs:
        write_stepper(spec, out, compile_it=not no_compile and spec.profile == "full",
                      allow_invalid=allow_invalid, standalone=standalone, derivatives=derivatives)
    return 0


def _specs(
    profile: str | None, choice: dict[str, Any], *, everything: bool, check: bool
) -> list[Spec]:
    """Return the steppers of the options: all of the paper, as of --check alone, or the chosen one.
    """
    has_choices = any(map(is_given, [*choice.values(), profile]))
    if not (everything or (check and not has_choices)):
        return [spec_from(**choice).with_profile(profile)]
    if has_choices:
        raise InputError("--all takes every stepper of the paper; leave out the other choices.")
    return list(PAPER_SPECS)


def write_stepper(
    spec: Spec, out: Path, *, compile_it: bool, allow_invalid: bool, standalone: bool,
    derivatives: bool = False,
) -> None:
    """Generate, write, compile (where that is for Python) and report one stepper.

    ``out`` is the folder; ``standalone`` puts the engine into the C, ``derivatives`` adds tangents
    and adjoints, ``allow_invalid`` takes a tableau that violates its conditions.
    """
    started_at = time.perf_counter()
    # steppers of named systems are cached by their names, others by their content
    is_named = spec.tableau is None and spec.model is None and spec.system not in MODELS
    with log_task(f"making {spec.model or spec.name}"):  # the summary says how long it took
        if is_named and not derivatives:
            files = _load_or_derive(spec)
            written_files = complete(files) if standalone else files
        else:
            source = _generate(spec, allow_invalid, derivatives).source
            files, written_files = source.files(), source.files(standalone=standalone)
        name = next(file for file in files if file.endswith(".json")).removesuffix(".json")
        module_kind: ModuleKind = "derivatives" if derivatives else "runs"
        if compile_it:
            files = complete(files)
            refuse_without_compiler(files, module_kind)
        write_files(written_files, out)
        derived_at = time.perf_counter()
        if compile_it:
            from ..api import Derivation
            from ..runtime.compilation.stepper_module import load_module

            load_module(name, files, module_kind)
            if is_named and not derivatives:
                Derivation(spec).keep(files)
    compiled_at = time.perf_counter()
    click.echo(summary(name, Manifest.from_text(files[f"{name}.json"]), out,
                       derived_at - started_at,
                       compiled_at - derived_at if compile_it else None))


def refuse_without_compiler(files: dict[str, str], module_kind: ModuleKind) -> None:
    """Refuse to compile, before anything is written, where nothing on this machine can."""
    from ..runtime.compilation.compiler import find_compiler
    from ..runtime.compilation.prebuilt import prebuilt_module

    try:
        find_compiler()
    except CompilerError as error:
        if prebuilt_module(files, module_kind) is None:
            raise CompilerError(f"{error} Nothing was written; --no-compile writes the C without "
                                "compiling it.") from error


def summary(
    name: str, manifest: Manifest, out: Path, derive: float, compile_seconds: float | None
) -> str:
    """Return the properties of a generated stepper, in a few lines.

    ``derive`` and ``compile_seconds`` are seconds, the latter None for what was not compiled.
    """
    scheme, system = manifest.scheme, manifest.system
    remarks = "".join(f"  {subject}: {remark}\n" for subject, remark in manifest.warnings)
    seconds = f"derived and written in {derive:.2f} s"
    if compile_seconds is not None:
        seconds += f", compiled in {compile_seconds:.2f} s"
    return (
        f"{name}: order {scheme.order}, {count_text(scheme.unknowns, 'unknown')} a step, "
        f"{count_text(scheme.multipliers * len(system.constraints), 'multiplier')}\n"
        f"{remarks}"
        f"  kernels: {sum_operations(manifest)}\n"
        f"  {out / name}.h .c .json\n"
        f"  {seconds}"
    )


def sum_operations(manifest: Manifest) -> str:
    """Return e.g. ``gradient 96, hessian 295 operations``."""
    counts = {name: sum(kinds.values()) for name, kinds in manifest.operations.items()}
    return ", ".join(f"{name} {count}" for name, count in counts.items()) + " operations"


def check_files(
    spec: Spec, out: Path, allow_invalid: bool, standalone: bool, derivatives: bool = False
) -> int:
    """Compare freshly generated text with the files in ``out``; print a unified diff.

    Return the exit code: 1 if a file differs.
    """
    generated = _generate(spec, allow_invalid, derivatives)
    stale = 0  # the exit code
    for name, text in generated.source.files(standalone=standalone).items():
        path = out / name
        present_text = _text_of(path)
        diff = list(difflib.unified_diff(
            present_text.splitlines(keepends=True), text.splitlines(keepends=True),
            str(path), f"{path} (generated)",
        ))
        click.echo("".join(diff), nl=False)
        stale |= bool(diff)
    click.echo(f"{generated.source.name}: {'STALE' if stale else 'up to date'}", err=bool(stale))
    return stale


def _text_of(path: Path) -> str:
    """Return a file's text, its line ends untouched; empty if it is not there."""
    try:  # in bytes: read_text() would hide that a checkout has changed the line ends
        return path.read_bytes().decode("utf-8", errors="replace") if path.is_file() else ""
    except OSError as error:
        raise InputError(f"{str(path)!r} cannot be read: {error.strerror or error}; change its "
                         "permissions or choose another folder with --out.") from error


def write_files(files: dict[str, str], out: Path) -> None:
    """Write files so that each appears complete or not at all."""
    try:
        out.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            with staged_file(out / name) as temporary:
                temporary.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"The output folder {str(out)!r} cannot be written: "
                         f"{error.strerror or error}; choose another with --out.") from error


def _load_or_derive(spec: Spec) -> dict[str, str]:
    """Return the files of a named stepper, name → text, derived once and cached.

    Their C includes the engine's headers, which are not part of the cached text.
    """
    from ..runtime.compilation.build_cache import digest, read_cache, write_cache
    # other versions of the generator have other keys
    key = digest([str(spec), "without engine", generator_fingerprint()])
    name = f"{spec.name}-{key}.source.json"
    files: dict[str, str] | None = read_cache(name)
    if files is None:
        files = _generate(spec, allow_invalid=False).source.files(standalone=False)
        write_cache(name, files)
    return files


def _generate(spec: Spec, allow_invalid: bool, derivatives: bool = False) -> Generated:
    """Derive and print the C of a specification; sympy is imported here, where nothing is cached.
    """
    with log_task(f"deriving {spec.model or spec.name}"):
        with imported_for_good("sympy"):  # only when needed
            from ..generator.pipeline import generate as run_pipeline

        return run_pipeline(spec, allow_invalid=allow_invalid, derivatives=derivatives)
