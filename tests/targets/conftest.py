"""Flags with which the quick run compiles artefacts."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from gyrospark.targets import arduino, cpp, native
from gyrospark.targets.fmi import archive


@pytest.fixture(scope="module", autouse=True)
def quickly_compiled(request: pytest.FixtureRequest) -> Iterator[None]:
    """Compile at -O0, with the same bits, for nothing is contracted; slow tests use all flags."""
    with pytest.MonkeyPatch.context() as patch:
        if request.config.option.markexpr == "not slow":
            for module, name in ((native, "C_FLAGS"), (cpp, "C_FLAGS"), (arduino, "C_FLAGS"),
                                 (archive, "_FLAGS")):
                flags = [flag for flag in getattr(module, name) if not flag.startswith("-O")]
                patch.setattr(module, name, ("-O0", *flags))
        yield
