"""``python -m gyrospark`` is the command line, and this is where its scripts begin.

Ctrl-C in the tenth of a second that the imports take ends the program as any later one does.
"""

from __future__ import annotations

import sys
from typing import NoReturn


def main() -> NoReturn:
    """Begin ``gyrospark``."""
    try:
        from .commands import main
    except KeyboardInterrupt:
        _interrupted("gyrospark")
    main()


def main_generate() -> NoReturn:
    """Begin ``generate``, the same as ``gyrospark generate``."""
    try:
        from .commands import main_generate
    except KeyboardInterrupt:
        _interrupted("generate")
    main_generate()


def _interrupted(name: str) -> NoReturn:
    sys.stderr.write(f"\n{name}: Interrupted.\n")  # below the terminal's ^C, as click does
    sys.exit(130)


if __name__ == "__main__":
    main()
