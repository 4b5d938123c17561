"""The parameters of a run: all that the stepper needs, in their domains, γ and α by their rules."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ...core.arguments import proposal, shown
from ...core.errors import InputError
from ...core.exact_numbers import as_double
from ...core.registry import AIMS
from ...core.warnings import warn
from ..bindings.array_checks import as_real
from ..rigid_body.gamma_rules import gamma_by_rule, has_inertia, is_inertia_parameter
from ..tuning.manifest_symmetries import Symmetry, refuse_broken

__all__ = ["as_parameters", "refuse_auto", "refuse_choice", "warn_of_negative"]


def as_parameters(
    given: Any, domains: Mapping[str, str], number: Callable[[Fraction], Any] = as_double,
    symmetries: Sequence[Symmetry] = (),
) -> dict[str, Any]:
    """Return the parameters a stepper needs, each checked against its domain.

    The rates of a co-moving frame, those of ``symmetries``, are 0 where they are not given.

    Raises
    ------
    InputError
        Naming a missing, unknown or unusable parameter.
    """
    if not isinstance(given, Mapping):
        raise InputError(f"parameters = {shown(given)} is not a dict; give {', '.join(domains)}.")
    frame = {symmetry.name: 0 for symmetry in symmetries}
    needed = [name for name in domains if name not in frame]
    missing = [name for name in needed if name not in given]
    if missing:
        raise InputError(
            f"Parameter {missing[0]!r} is not given; this stepper needs {', '.join(needed)}."
        )
    if frame and "frame" in given and "frame" not in domains:
        refuse_choice(given["frame"])
    unknown = [str(name) for name in given if name not in domains]
    if unknown:
        raise InputError(
            f"Parameter {unknown[0]!r} is unknown; this stepper takes {', '.join(domains)}"
            f"{proposal(unknown[0], domains)}."
        )
    whole = {**frame, **given}
    made = {name: _as_parameter(name, domain, whole, number) for name, domain in domains.items()}
    refuse_broken(symmetries, made)
    return made


def refuse_choice(value: Any) -> None:
    """Refuse ``"frame"`` among the parameters where nothing chooses."""
    raise InputError(f"Parameter frame = {shown(value)} is for runs, which look at their start: "
                     "'start' or, for integrate alone, 'auto'; here give rates, those of "
                     "choose_frame for example.")


def refuse_auto(name: str, value: Any) -> None:
    """Refuse the value "auto" where nothing chooses."""
    if isinstance(value, str) and value in AIMS:
        raise InputError(f"Parameter {name} = {value!r} is chosen by integrate alone; call "
                         "choose_gamma once and give its number.")


def _as_parameter(
    name: str, domain: str, given: Mapping[str, Any], number: Callable[[Fraction], Any]
) -> Any:
    value = given[name]
    refuse_auto(name, value)
    if isinstance(value, str) and is_inertia_parameter(name):
        value = gamma_by_rule(name, value, given)
    made = as_real(f"Parameter {name}", value, number)
    if domain == "positive" and made <= 0:
        raise InputError(f"Parameter {name} = {made} is not positive, as the system declares it; "
                         "give a number above 0. (Where 0 is meant, declare the symbol without "
                         "positive=True.)")
    if domain == "nonzero" and made == 0:
        raise InputError(f"Parameter {name} = 0 divides by zero; give a number other than 0.")
    return made


def warn_of_negative(parameters: Mapping[str, Any]) -> None:
    """Warn of γ and α below 0; each parameter is a number, or one for each of many runs."""
    for name, values in parameters.items():
        least = float(np.min(values)) if has_inertia(name, parameters) else 0.0
        if least < 0:
            warn(f"Parameter {name} = {least:.6g} is below 0. The motion does not depend on it, "
                 "but its error does: several times that of a value near the moments of inertia, "
                 "such as m.")
