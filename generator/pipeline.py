"""The pipeline of ``generator``: a spec, or a system and a tableau, to the three files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..core.arguments import few
from ..core.errors import TableauError
from ..core.incompatibilities import refuse_together
from ..core.inertia import REPS
from ..core.real_types import REALS
from ..core.records import dataclass
from ..core.registry import MODELS, SYSTEMS
from .codegen.emit import Source, emit
from .codegen.program import Derived
from .kernels.kernel import Constants
from .normal_forms.canonical_system import canonical
from .schemes.lagrangian_midpoint import mean_scheme
from .schemes.named_schemes import SCHEMES, scheme_named
from .schemes.splitting_scheme import SplittingScheme, splitting_scheme
from .schemes.step_equations import MeanScheme, SparkScheme, hoist_constants, with_work_of_time
from .spec import Spec, join_name
from .symmetry.frame_symmetries import CoMovingFrame, frame_of
from .systems.integrable_rows import warn_of_row_integrals
from .systems.redundant_constraints import refuse_redundant_anywhere
from .systems.smoothness import refuse_kinks
from .systems.system import System
from .systems.time_scale import scale_time
from .tableaux.conditions import Condition, check_tableau
from .tableaux.tableau import Tableau
from .tableaux.tableau_file import read_tableau

if TYPE_CHECKING:
    from .multibody.model import Model

__all__ = ["Generated", "generate", "refuse_violations", "tableau_of"]


@dataclass(frozen=True)
class Generated:
    """A stepper's text and the exact objects it was derived from."""

    source: Source
    scheme: SparkScheme | MeanScheme | SplittingScheme
    system: System
    tableau: Tableau | None


def generate(
    spec: Spec, *, system: System | None = None, model: Model | None = None,
    tableau: Tableau | None = None, allow_invalid: bool = False, structured: bool | None = None,
    derivatives: bool = False, second: bool = False
) -> Generated:
    """Return the C of a stepper with its manifest, and the equations that they were derived from.

    Parameters
    ----------
    spec : Spec
        What to generate: the names of system and scheme, or their files, and the kind of numbers.
    system : System, optional
        Takes the place of the named system and representation.
    model : Model, optional
        The model of the spec's file or name, if it has been built already.
    tableau : Tableau, optional
        Takes the place of the scheme's or the file's.
    allow_invalid : bool
        Generate although required conditions of the tableau are violated, or constraints of the
        system depend on each other.
    structured : bool, optional
        Whether the C loops over the instances of the system's forms (``repeated_structure``); by
        default where that saves work.
    derivatives : bool
        Whether the C has tangents and adjoints of steps too.
    second : bool
        Whether it has derivatives of adjoints, beside tangents and adjoints.

    Raises
    ------
    InputError
        If constraints of a given system are redundant or have kinks, with their names.
    TableauError
        If the tableau violates required conditions.
    """
    # 1. system and model: refuse features that exclude each other, kinks and redundant constraints
    subject = _subject(spec, system, model, own_tableau=tableau is not None,
                       derivatives=derivatives or second, structured=bool(structured))
    if (system is not None or spec.model is not None) and not allow_invalid:  # a user's system
        refuse_kinks(subject.system)
        refuse_redundant_anywhere(subject.system)
        warn_of_row_integrals(subject.system)
    # 2. the system on which everything below depends
    system, frame = _in_normal_form(subject.system, framed=subject.is_framed)
    # 3. tableau and the equations of a step, with constants of the run
    coefficients = tableau or tableau_of(spec)
    is_splitting = spec.order is not None
    if coefficients is not None and not is_splitting and not allow_invalid:
        refuse_violations(coefficients, constrained=system.m > 0)
    reduced, constants = hoist_constants(system)
    scheme, title, c_name = _method(spec, system, reduced, constants, coefficients)
    # 4. kernels and templates
    name = join_name(system.name, c_name, subject.rep, spec.real, framed=frame is not None)
    source = emit(Derived(name, title, scheme, system, constants, REALS[spec.real],
                          spec.profile, frame, derivatives=derivatives or second, second=second,
                          model=subject.model), structured)
    return Generated(source, scheme, system, coefficients)


class _Subject(NamedTuple):
    system: System
    rep: str  # the representation that belongs into the name of the stepper, or ""
    model: Model | None  # of the system, with its numbers
    is_framed: bool  # whether steps are taken in a co-moving frame


def _subject(
    spec: Spec, system: System | None, model: Model | None, *, own_tableau: bool,
    derivatives: bool, structured: bool,
) -> _Subject:
    """Return the system to generate for, with its model; refuse features that exclude each other.

    ``system`` and ``model`` are the caller's, or None; ``own_tableau``, ``derivatives`` and
    ``structured`` say what the caller asks for beside ``spec``.
    """
    if system is None and model is None and spec.model is not None:
        from .models.model_file import load_model  # readers of robots: named systems need none

        model = load_model(spec.model, spec.rep or None)  # type: ignore[arg-type]
    model_frame = "" if model is None else model.frame
    if spec.order is not None:  # a splitting
        has_frame = bool(spec.frame or model_frame)
        refuse_together(splitting="scheme splitting", frame=has_frame and "a co-moving frame")
    # a system of the caller's own has no frame of a model
    is_framed = bool(spec.frame or (system is None and model_frame))
    # feature of the table of ``incompatibilities`` → its name in messages, or False if it is absent
    features = {"profile": spec.profile != "full" and f"profile {spec.profile!r}",
                "frame": is_framed and "a co-moving frame",
                "derivatives": derivatives and "derivatives of steps and runs",
                "energy": spec.energy and "exact energy (energy = True)",
                "structured": structured and "loops over element templates"}
    refuse_together(**features)
    # a name that is not of SYSTEMS is one of MODELS, whose model is made after the refusals
    if system is None and model is None and spec.model is None and spec.system not in SYSTEMS:
        model = MODELS[spec.system].make(**({"rep": spec.rep} if spec.rep else {}))
    system, rep = _system_and_rep(spec, system, model)
    _refuse_features(spec, system, own_tableau=own_tableau, features=features)
    return _Subject(system, rep, model, is_framed)


def _in_normal_form(system: System, *, framed: bool) -> tuple[System, CoMovingFrame | None]:
    """Return the system in normal form and in scaled time, and its co-moving frame or None.

    If it is ``framed``, the system is in that frame. Work of the time is accumulated in it.
    """
    system = scale_time(canonical(system))
    frame = frame_of(system) if framed else None
    if frame is not None:
        system = frame.moving(system)
    return with_work_of_time(system), frame


class _Method(NamedTuple):
    scheme: SparkScheme | MeanScheme | SplittingScheme  # the equations of a step
    title: str
    c_name: str


def _method(
    spec: Spec, system: System, reduced: System, constants: Constants, tableau: Tableau | None
) -> _Method:
    """Return the method of a spec.

    ``reduced`` is the system with subexpressions that are constant in a run as ``constants``;
    ``tableau`` is None for IMS, EMS and splittings.
    """
    if spec.order is not None:
        scheme = splitting_scheme(system, reduced, constants, spec.order, spec.composition)
        return _Method(scheme, spec.title, spec.method)
    if tableau is None:
        return _Method(mean_scheme(reduced, discrete=scheme_named(spec.scheme).discrete),
                       spec.scheme, spec.method)
    spark = SparkScheme(reduced, tableau, spec.energy)
    if spec.stages:
        return _Method(spark, spec.title, spec.method)
    # a user's tableau has no stages in its spec, and a name of its own
    if tableau.is_given_in_numbers:
        _refuse_scheme_name(tableau.name)
    return _Method(spark, f"SPARK {tableau.name}", tableau.name)


def _refuse_scheme_name(name: str) -> None:
    """Refuse a user's tableau whose files would have the names of a scheme's, such as ``gl2``.

    Without a representation what follows the scheme in ``join_name`` may end the tableau's name.
    """
    reals = "|".join(join_name("", "", "", real) for real in REALS if real != "double")
    for scheme in SCHEMES.values():
        counted = r"(\d+|_\w+)" if scheme.composed else r"\d*(_energy)?"
        if re.fullmatch(rf"{scheme.key}{counted}(_frame)?(_({reals}))?", name):
            raise TableauError(f"Tableau {name!r} has a name that scheme {scheme.name!r} has in "
                               f"names of files; give it another name, such as 'my_{name}'.")


def _refuse_features(
    spec: Spec, system: System, *, own_tableau: bool, features: Mapping[str, str | bool]
) -> None:
    """Refuse the features that exclude velocity constraints or a time scale of the system.

    ``features`` are the features of ``refuse_together`` that the caller asks for;
    ``own_tableau`` says whether the caller passes a tableau.
    """
    if system.velocity_count:
        refuse_together(
            velocity_constraints=f"the velocity constraints "
                                 f"{few(system.velocity_constraint_names)} of {system.name!r}",
            other_scheme=_without_velocity_constraints(spec, own_tableau=own_tableau), **features)
    if system.time_scale is not None:
        refuse_together(scaled=f"the time_scale of {system.name!r}",
                        splitting=spec.order is not None and "scheme splitting", **features)


def _without_velocity_constraints(spec: Spec, *, own_tableau: bool) -> str:
    """Return the name of the scheme where it has no equations for velocity constraints, else ""."""
    if own_tableau or spec.tableau is not None:
        return "a given tableau"
    return "" if scheme_named(spec.scheme).velocity_constraints else f"scheme {spec.scheme!r}"


def _system_and_rep(spec: Spec, system: System | None, model: Model | None) -> tuple[System, str]:
    """Return the system to generate for, and the representation that belongs into its name, or "".
    """
    if system is not None:
        return system, ""
    if spec.model is not None and model is not None:
        return model.system, next((rep for rep in REPS if rep in model.bodies), "")
    if spec.system in SYSTEMS:
        derived: System = SYSTEMS[spec.system].make(spec.rep)
        return derived, spec.rep
    assert model is not None
    return model.system, spec.rep


def tableau_of(spec: Spec) -> Tableau | None:
    """Return the tableau of a spec, exact; None for IMS, EMS and splittings, which have none."""
    if spec.tableau is not None:
        return read_tableau(Path(spec.tableau))
    make = scheme_named(spec.scheme).tableau
    return None if make is None else make(spec.stages or 0)


def violations(tableau: Tableau) -> list[Condition]:
    """Return the required conditions that do not hold."""
    return [line for line in check_tableau(tableau) if line.required and not line.holds]


def refuse_violations(tableau: Tableau, *, constrained: bool = True) -> None:
    """Raise if a given tableau violates a required condition; derived ones hold by derivation.

    The condition on multipliers is required of a ``constrained`` system alone: others have none.
    """
    if not tableau.is_given_in_numbers:
        return
    broken = [line for line in violations(tableau) if constrained or line.name != "multipliers"]
    if broken:
        listed = "; ".join(f"{line.name} ({line.equation}; residual {line.residual})"
                           for line in broken[:4])
        count = f"; and {len(broken) - 4} more" if len(broken) > 4 else ""
        raise TableauError(f"Tableau {tableau.name!r} violates {listed}{count}; see `gyrospark "
                           "verify`, or pass --allow-invalid.")
