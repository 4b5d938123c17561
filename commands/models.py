"""``gyrospark models`` lists named models, ``gyrospark examples`` the example files."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import click

from ..core.arguments import join_or, proposal, shown
from ..core.errors import InputError
from ..core.registry import MODELS, PROBLEMS, SYSTEMS
from .options import PATH, json_option

__all__ = ["examples", "models"]

#: What is done with an entry of each kind.
_USES = {
    "problem": "gyrospark run {name} --dt 1e-3 --t-end 1",
    "model": "gyrospark run {name}",
    "system": "gyrospark generate --system {name}",
}


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@json_option
def models(as_json: bool) -> int:
    """List the problems, models and systems that have names, with what each takes by --set.

    \b
    gyrospark models
    gyrospark models --json
    """
    import json

    rows = [{"name": entry.name, "kind": entry.kind, "about": entry.about,
             "options": entry.options if entry.kind != "system" else []}
            for entry in (*PROBLEMS.values(), *MODELS.values(), *SYSTEMS.values())]
    if as_json:
        click.echo(json.dumps(rows, ensure_ascii=False, indent=2))
        return 0
    # names in a column
    width = max(len(str(row["name"])) for row in rows)
    for kind, use in _USES.items():
        click.echo(f"{kind}s: {use.format(name='NAME')}")
        for row in rows:
            if row["kind"] == kind:
                takes = f" (--set {', '.join(row['options'])})" if row["options"] else ""
                click.echo(f"  {row['name']:<{width}}  {row['about']}{takes}")
    click.echo("A model file is run by its name: gyrospark run FILE.toml")
    return 0


#: Comes with the package, wherever it is installed.
_EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
def examples() -> None:
    """List the examples that come along, and copy them to change them.

    \b
    gyrospark examples list
    gyrospark examples copy satellite.toml
    gyrospark examples copy control_c --to robots
    """


@examples.command("list", context_settings={"help_option_names": ["-h", "--help"]})
@json_option
def list_examples(as_json: bool) -> int:
    """Print each example, a file or a folder of files, and what it is.

    \b
    gyrospark examples list
    gyrospark examples list --json
    """
    import json

    rows = [{"name": path.name, "about": _about(path)} for path in _examples()]
    if as_json:
        click.echo(json.dumps(rows, ensure_ascii=False, indent=2))
        return 0
    width = max(len(row["name"]) for row in rows)
    for row in rows:
        click.echo(f"{row['name']:<{width}}  {row['about']}")
    click.echo("A model file is run where it is: gyrospark run examples/NAME.toml")
    return 0


@examples.command("copy", context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("names", metavar="NAME...", nargs=-1, required=True)
@click.option("--to", "folder", metavar="DIR", default=".", type=PATH,
              help="The folder to copy them into (default: this one).")
def copy_examples(names: tuple[str, ...], folder: Path) -> int:
    """Copy examples by NAME, or "all", to where they can be changed; nothing is written over.

    \b
    gyrospark examples copy satellite.toml
    gyrospark examples copy crane.urdf pendulum.toml
    gyrospark examples copy all --to examples
    """
    example_of_name = {path.name: path for path in _examples()}
    for name in names:
        if name != "all" and name not in example_of_name:
            raise InputError(f"There is no example {shown(name)}; choose "
                             f"{join_or(example_of_name)}, or "
                             f"all{proposal(name, example_of_name)}.")
    # all are checked before the first is copied
    paths = [path for name, path in example_of_name.items() if name in names or "all" in names]
    for path in paths:
        if (folder / path.name).exists():
            raise InputError(f"{str(folder / path.name)!r} is there already; choose another folder "
                             "with --to, or remove it.")
    folder.mkdir(parents=True, exist_ok=True)
    for path in paths:
        if path.is_dir():
            shutil.copytree(path, folder / path.name, ignore=_PACKAGE_FILES)
        else:
            shutil.copyfile(path, folder / path.name)
        click.echo(str(folder / path.name))
    return 0


#: Files that make a folder of examples a package of Python; a copy is none.
_PACKAGE_FILES = shutil.ignore_patterns("__pycache__", "__init__.py")


def _examples() -> list[Path]:
    """Return the paths of the examples, files and folders, sorted by name."""
    return sorted(path for path in _EXAMPLES.iterdir() if not path.name.startswith("__"))


def _about(path: Path) -> str:
    """Return the first sentence of the description in a file, or in the main file of a folder."""
    if path.is_dir():
        main_files = [path / name for name in ("README.md", "main.c", "make.py")]
        path = next((file for file in (*main_files, *sorted(path.iterdir()))
                     if file.is_file()), path)
    if path.suffix == ".json":  # which has no comments
        return ""
    # without the marks of comments in Markdown, TOML, Python, XML and C
    lines = [re.sub(r'^\s*(#+|"""|<!--|/\*+|\*)\s?', "", line).strip()
             for line in path.read_text(encoding="utf-8").splitlines()
             if not line.startswith("<?xml")]
    start = next((index for index, line in enumerate(lines) if line), 0)
    sentence = " ".join(lines[start:start + 4])  # an empty line leaves two blanks
    return sentence.partition(". ")[0].partition("  ")[0].removesuffix('"""').strip().rstrip(".:")
