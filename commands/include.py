"""``gyrospark include``: the folder of the engine's headers."""

from __future__ import annotations

import click

from ..core.errors import GyrosparkError
from ..engine.amalgamate import FOLDER

__all__ = ["include"]


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
def include() -> None:
    """Print the folder of the engine's headers, for the option -I of a compiler.

    \b
    generate --scheme G-L --stages 3 --no-compile
    cc -O2 -I "$(gyrospark include)" -c generated/heavy_top_gl3_gamma.c
    """
    if not (FOLDER / "gyrospark" / "engine.h").is_file():
        raise GyrosparkError(f"The headers of the engine are missing in {str(FOLDER)!r}; install "
                             "gyrospark again.")
    click.echo(FOLDER)
