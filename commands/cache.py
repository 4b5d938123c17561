"""``gyrospark cache``: see and empty the folder of generated sources and compiled modules."""

from __future__ import annotations

import contextlib

import click

from ..core.arguments import count_text

__all__ = ["cache"]


@click.group()
def cache() -> None:
    """List or clear the cache of generated and compiled steppers (folder: GYROSPARK_CACHE)."""


@cache.command(name="list")
def list_entries() -> None:
    """Print the cached files with their sizes."""
    from ..runtime.compilation.build_cache import cache_folder, entries

    files = entries()
    for path in files:
        with contextlib.suppress(FileNotFoundError):  # cleared meanwhile, by another process
            click.echo(f"{path.stat().st_size:>10,}  {path.name}")
    click.echo(f"{count_text(len(files), 'file')} in {cache_folder()}")


@cache.command()
def clear() -> None:
    """Remove every finished file, and what builds of more than a day ago have left."""
    from ..runtime.compilation import build_cache as store

    click.echo(f"{store.clear()} files removed from {store.cache_folder()}")
