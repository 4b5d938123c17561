"""Public errors, as ``gyrospark.errors.StorageError``."""

from .core.errors import *  # noqa: F403
from .core.errors import __all__ as __all__


def __dir__() -> list[str]:
    return __all__
