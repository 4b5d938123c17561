"""``python -m gyrospark`` is the command line, and this is where its scripts begin.

Ctrl-C in the tenth of a second that the imports take ends the program as any later one does.
"""

from __future__ import annotations

import sys
from types import ModuleType

from .core.lazy_imports import imported_for_good


def main() -> None:
    """Begin ``gyrospark``."""
    _commands("gyrospark").main()


def main_generate() -> None:
    """Begin ``generate``, the same as ``gyrospark generate``."""
    _commands("generate").main_generate()


def _commands(name: str) -> ModuleType:
    try:
        with imported_for_good("click"):
            from . import commands
    except KeyboardInterrupt:
        sys.stderr.write(f"\n{name}: Interrupted.\n")  # below the terminal's ^C, as click does
        sys.exit(130)
    return commands


if __name__ == "__main__":
    main()
