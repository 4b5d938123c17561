"""Motions in closed form, as ``gyrospark.exact.free_body(...)``."""

from .runtime.rigid_body.closed_forms import free_body, regular_precession

__all__ = ["free_body", "regular_precession"]


def __dir__() -> list[str]:
    return __all__
