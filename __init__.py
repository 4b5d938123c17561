"""gyrospark: compiled steppers for rigid-body motion on its constraint, generated from symbols.

>>> import gyrospark as gs
>>> step = gs.stepper("G-L", stages=3, rep="gamma")
>>> top = gs.problems.fast_top()
>>> trajectory = step.integrate(top, dt=1e-3, steps=320)

Importing this package imports no SymPy; generating a stepper does. The public names are the
imports of ``__init__.pyi``, one in a line; each is imported when it is first asked for.
"""

from __future__ import annotations

import os
from importlib import import_module

from ._version import __version__ as __version__

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any


def _imports() -> dict[str, tuple[str, str]]:
    """Return each public name's module, and its name in there, from ``__init__.pyi``."""
    path = os.path.join(os.path.dirname(__file__), "__init__.pyi")  # noqa: PTH118, PTH120
    with open(path, encoding="utf-8") as file:  # noqa: PTH123  pathlib takes longer to import
        lines = [line.split() for line in file if line.startswith("from ")]
    return {public: (module, name) for _, module, _, name, _, public in lines}


_HOMES = _imports()
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    from .core.arguments import proposal
    from .core.calls import explain_module, explain_names
    from .core.errors import MissingDependencyError
    from .core.former_names import FORMER_NAMES

    if name in FORMER_NAMES:
        raise AttributeError(f"{__name__}.{name} is now {FORMER_NAMES[name]}.")
    if name not in _HOMES:
        near = "" if name.startswith("_") else proposal(name, __all__)  # inspectors ask for many
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{near}")
    module, inner = _HOMES[name]
    try:
        home = import_module(module, __name__)
        explain_names(home, [inner])
        member = vars(home).get(inner)
        if member is None or isinstance(member, type(os)):
            member = explain_module(import_module(f"{home.__name__}.{inner}"))
    except MissingDependencyError as error:
        return _missing(name, str(error))
    globals()[name] = member  # the next access does not come here
    return member


def _missing(name: str, message: str) -> Any:
    """Return a substitute for a function whose extra is not installed: calls of it are refused.

    Its documentation is read from its file, which cannot be imported.
    """
    import ast
    from pathlib import Path

    def refuse(*arguments: object, **options: object) -> Any:
        from .core.errors import MissingDependencyError

        raise MissingDependencyError(message)

    module, inner = _HOMES[name]
    path = Path(__file__).parent.joinpath(*module.split(".")).with_suffix(".py")
    node = next(each for each in ast.parse(path.read_text(encoding="utf-8")).body
                if isinstance(each, ast.FunctionDef) and each.name == inner)
    refuse.__name__ = refuse.__qualname__ = name
    refuse.__doc__ = f"{name}({ast.unparse(node.args)})\n\n{message}\n\n{ast.get_docstring(node)}"
    return refuse


def __dir__() -> list[str]:
    return sorted(__all__)
