"""``python -m gyrospark`` is the command line."""

from .commands import main

main()
