"""Where generator and runtime meet: sources from the checked-in folder, the cache, or SymPy."""

from __future__ import annotations

import numbers
from collections.abc import Mapping
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ._version import __version__
from .errors import InputError
from .generator.spec import Spec
from .generator.text_file import UnusableFileError, model_text, read_text
from .projection import Projection, project
from .runtime.cache import digest, keep, kept
from .runtime.checks import as_array, shown
from .runtime.notices import doing
from .runtime.reals import rounding
from .runtime.start import Start
from .runtime.stepper import Stepper

if TYPE_CHECKING:
    from .generator.model import Model
    from .generator.pipeline import Generated
    from .generator.system import System
    from .generator.tableau import Tableau

__all__ = ["checked_in_files", "consistent", "files_of", "load_model", "model_stepper", "stepper",
           "tableau"]

ROOT = Path(__file__).resolve().parent


def stepper(
    scheme: str | None = None,
    stages: int | None = None,
    rep: str | None = None,
    *,
    system: str | Path | System | Model | None = None,
    tableau: str | Path | Tableau | None = None,
    real: str = "double",
    allow_invalid: bool = False,
) -> Stepper:
    """Return a compiled stepper, generated and compiled on first use, from the cache after.

    Parameters
    ----------
    scheme : {"IMS", "EMS", "G-L", "LIIIA-B"}
        The scheme; left out when a tableau is given.
    stages : int
        Stages of G-L (from 1) or LIIIA-B (from 2).
    rep : {"gamma", "alpha"}
        Inertia representation of the named systems and of model files.
    system : str, path, System or Model
        ``"heavy_top"`` (default), ``"free_body"``, a model file (TOML), a ``gyrospark.System`` or
        the system of a ``gyrospark.Model``.
    tableau : path or Tableau
        A user's tableau: a JSON file, or an object from ``gyrospark.tableau``.
    real : {"double", "float", "long-double", "float128"}
        Floating-point type of the compiled code. Arrays of float128 hold mpmath numbers of 113
        bits.
    allow_invalid : bool
        Use a tableau although it violates required conditions, and a system although some of its
        constraints follow from others.

    Raises
    ------
    InputError
        For unusable choices, with the allowed ones; for redundant constraints, with their names.
    TableauError
        For a tableau that violates required conditions.
    CompilerError
        If there is no C compiler, or it fails.

    Examples
    --------
    >>> step = gyrospark.stepper("G-L", stages=3, rep="gamma")  # doctest: +SKIP
    """
    stages = _plain(stages)
    system = getattr(system, "system", system)  # of a Model
    if isinstance(system, Path):
        system = str(system)
    named = system if isinstance(system, str) or system is None else None
    file = Path(tableau) if isinstance(tableau, (str, Path)) else None
    own_tableau = None if file is not None else tableau
    if own_tableau is not None:
        if scheme is not None or stages is not None:
            raise InputError("A tableau fixes the scheme and its stages; leave out scheme and "
                             "stages.")
        spec = replace(Spec.checked("EMS", None, rep, named, real), scheme="SPARK")
    else:
        spec = Spec.checked(scheme, stages, rep, named, real, file)
    if named is None and system is not None and rep is not None:
        raise InputError("rep belongs to the named systems; a System brings its own H.")
    if own_tableau is None and spec.model is not None:
        return model_stepper(spec, allow_invalid)[0]
    if own_tableau is None and file is None and (system is None or named is not None):
        return _named_stepper(spec)
    made = _generate(spec, None if named is not None else system, own_tableau, allow_invalid)
    return Stepper(made.source.name, made.source.files())


def consistent(
    system: System | Stepper, q: ArrayLike, p: ArrayLike, parameters: Mapping[str, float]
) -> Projection:
    """Return the state next to (q, p) with g(q) = 0 and g_q H_p = 0, and what was moved.

        q ← q − g_qᵀ (g_q g_qᵀ)⁻¹ g,   p ← p − g_qᵀ (g_q H_pp g_qᵀ)⁻¹ g_q H_p

    until nothing moves, with steps halved while |g| would grow.

    Parameters
    ----------
    system : System or Stepper
        A system needs no compiler for this.
    q, p : array_like, shape (n,)
        A state near the constraints.
    parameters : mapping
        The value of every parameter by name.

    Returns
    -------
    Projection
        ``.q``, ``.p``, and the report: largest moves, |g| and |g_q H_p| before and after by the
        constraints' names. Printed it is a short table.

    Raises
    ------
    InputError
        Naming the constraints that depend on each other or cannot be met from here.
    """
    if isinstance(system, Stepper):
        return system.consistent(q, p, parameters=parameters)
    from .generator.numeric_system import NumericSystem
    from .generator.system import System as AnySystem

    if not isinstance(system, AnySystem):
        raise InputError(f"system = {shown(system)} is neither a gyrospark.System nor a stepper.")
    state = (as_array("q", q, (system.n,), np.float64), as_array("p", p, (system.n,), np.float64))
    return project(NumericSystem(system, parameters), *state)


def load_model(path: str | Path, rep: str | None = None, *, real: str = "double") -> Model:
    """Return the model of a TOML file: its system, parameters and start.

    Parameters
    ----------
    path : path
        The file, at most 256 KiB of UTF-8.
    rep : {"gamma", "alpha"}, optional
        Takes the place of the file's ``[body] rep``.
    real : {"double", "float", "long-double", "float128"}
        The type of the numbers. Those of a file are decimals and formulas, rounded once: with
        ``"float128"`` to mpmath numbers of 113 bits, with ``"long-double"`` to NumPy's.

    Raises
    ------
    InputError
        With file, key and cure, for whatever in the file is no model.
    """
    from .generator.model_file import load_model as load

    number = rounding(Spec.checked("EMS", real=real).real)  # or says what may be chosen
    return load(path, rep).in_type(number)


def tableau(scheme: str | Path, stages: int | None = None) -> Tableau:
    """Return an exact SPARK tableau: ``"G-L"`` or ``"LIIIA-B"`` with stages, or a JSON file.

    ``.A .A_hat .A_tilde .A_bar .b .b_hat .b_tilde .c .c_tilde`` are exact nested tuples,
    ``.numeric(digits=50)`` the same attributes as nested lists of mpmath numbers, ``.order`` the
    derived order.
    """
    from .generator.pipeline import tableau_of

    if isinstance(scheme, Path) or str(scheme).endswith(".json"):
        if stages is not None:
            raise InputError("A tableau file fixes its stages; leave out stages.")
        found = tableau_of(Spec.checked(tableau=Path(scheme)))
    else:
        found = tableau_of(Spec.checked(scheme, _plain(stages)))
    if found is None:
        raise InputError(f"{scheme} has no SPARK tableau; choose G-L or LIIIA-B.")
    return found


def _plain(stages: Any) -> Any:
    """Return NumPy's and others' whole numbers as int, all else as it is."""
    plain = isinstance(stages, bool) or not isinstance(stages, numbers.Integral)
    return stages if plain else int(stages)


@lru_cache(maxsize=64)
def _named_stepper(spec: Spec) -> Stepper:
    return Stepper(spec.name, files_of(spec))


def model_stepper(spec: Spec, allow_invalid: bool = False) -> tuple[Stepper, Start]:
    """Return the stepper of a spec with a model file, and the numbers of the file.

    Both are kept: the second time the same file asks for the same stepper, no SymPy is imported.

    Raises
    ------
    InputError
        With file, key and cure, for whatever in the file is no model.
    """
    text = model_text(spec.model or "")
    own = "" if spec.tableau is None else _text_of(spec.tableau)
    key = f"model-{_source_key(spec, text, own, allow_invalid)}.source.json"
    found = kept(key)
    if found is None:
        made = _generate_model(spec, text, allow_invalid)
        keep(key, [*made[:2], made[2].as_json()])
        name, files, start = made
    else:
        name, files, start = found[0], found[1], Start.from_json(found[2])
    return Stepper(name, files), start


def _generate_model(
    spec: Spec, text: str, allow_invalid: bool
) -> tuple[str, dict[str, str], Start]:
    from .generator.model_file import parse_model
    from .generator.pipeline import generate

    with doing(f"deriving {spec.model} with {spec.method}", f"derived {spec.model}"):
        model = parse_model(text, spec.model or "", spec.rep or None)
        source = generate(spec, model=model, allow_invalid=allow_invalid).source
    return source.name, source.files(), Start.of(model)


def _text_of(path: Path) -> str:
    """Return the text of a tableau file; empty if it is unusable: reading it says why."""
    try:
        return read_text(path, 2**20)
    except UnusableFileError:
        return ""


def files_of(spec: Spec) -> dict[str, str]:
    """Return header, source and manifest of a named stepper without SymPy if they are known."""
    found = checked_in_files(spec.name)
    if found is not None:
        return found
    files: dict[str, str] | None = kept(_kept_name(spec))
    if files is None:
        files = _generate(spec, None, None, False).source.files()
        keep_files(spec, files)
    return files


def keep_files(spec: Spec, files: dict[str, str]) -> None:
    """Keep generated files for later calls."""
    keep(_kept_name(spec), files)


def _kept_name(spec: Spec) -> str:
    return f"{spec.name}-{_source_key(spec)}.source.json"


def checked_in_files(name: str) -> dict[str, str] | None:
    """Return the files of a stepper in ``generated/``; None if it is not there."""
    paths = [ROOT / "generated" / f"{name}.{end}" for end in ("h", "c", "json")]
    if not all(path.is_file() for path in paths):
        return None
    return {path.name: path.read_text(encoding="utf-8") for path in paths}


def _source_key(spec: Spec, *texts: object) -> str:
    return digest([str(spec), *texts, _generator_fingerprint()])


@cache
def _generator_fingerprint() -> str:
    """Return a hash of the generator's own text, so that no old source outlives a change to it."""
    paths = [*(ROOT / "generator").glob("*.py"), *(ROOT / "templates").glob("*.jinja")]
    return digest([__version__, *(path.read_text(encoding="utf-8") for path in sorted(paths))])


def _generate(
    spec: Spec, system: Any, own_tableau: Any, allow_invalid: bool
) -> Generated:
    from .generator.pipeline import generate
    from .generator.system import System
    from .generator.tableau import Tableau

    if system is not None and not isinstance(system, System):
        raise InputError(f"system = {shown(system)} is neither a name nor a gyrospark.System.")
    if own_tableau is not None and not isinstance(own_tableau, Tableau):
        raise InputError(f"tableau = {shown(own_tableau)} is neither a file nor a tableau; make "
                         "one with gyrospark.tableau.")
    what = spec.name if system is None else f"{system.name} with {spec.method}"
    with doing(f"deriving {what}", f"derived {what}"):
        return generate(spec, system=system, tableau=own_tableau, allow_invalid=allow_invalid)
