"""``gyrospark models``: everything with a name that can be run."""

from __future__ import annotations

import click

from ..catalogue import MODELS, PROBLEMS, SYSTEMS
from .options import json_option

__all__ = ["models"]

#: What is done with an entry of each kind.
_USES = {
    "problem": "gyrospark run {name}",
    "model": "gyrospark run {name}",
    "system": "generate --system {name}",
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
    width = max(len(str(row["name"])) for row in rows)
    for kind, use in _USES.items():
        click.echo(f"{kind}s: {use.format(name='NAME')}")
        for row in rows:
            if row["kind"] == kind:
                takes = f" (--set {', '.join(row['options'])})" if row["options"] else ""
                click.echo(f"  {row['name']:<{width}}  {row['about']}{takes}")
    click.echo("A model file is run by its name: gyrospark run FILE.toml")
    return 0
