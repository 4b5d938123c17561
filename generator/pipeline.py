"""The pipeline of ``generator``: a spec, or a system and a tableau, to the three files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..core.arguments import few, listed
from ..core.errors import InputError, TableauError
from ..core.inertia import REPS
from ..core.real_types import REALS
from ..core.registry import MODELS, SYSTEMS
from .codegen.emit import Source, emit
from .codegen.program import Derived
from .models.model_file import load_model
from .multibody.model import Model
from .normal_forms.canonical_system import canonical
from .schemes.lagrangian_midpoint import mean_scheme
from .schemes.named_schemes import SCHEMES, scheme_named
from .schemes.splitting_scheme import SplittingScheme, splitting_scheme
from .schemes.step_equations import MeanScheme, SparkScheme, hoisted, with_work_of_time
from .spec import Spec, join_name
from .symmetry.frame_symmetries import frame_of
from .systems.integrable_rows import warn_of_row_integrals
from .systems.redundant_constraints import refuse_redundant_anywhere
from .systems.smoothness import refuse_kinks
from .systems.system import System
from .systems.time_scale import scaled
from .tableaux.conditions import Condition, check_tableau
from .tableaux.tableau import Tableau
from .tableaux.tableau_file import read_tableau

__all__ = ["Generated", "generate", "refuse_violations", "tableau_of"]


@dataclass(frozen=True)
class Generated:
    """A stepper's text and the exact objects it was derived from."""

    source: Source
    scheme: SparkScheme | MeanScheme | SplittingScheme
    system: System
    tableau: Tableau | None


def generate(
    spec: Spec,
    *,
    system: System | None = None,
    model: Model | None = None,
    tableau: Tableau | None = None,
    allow_invalid: bool = False,
    structured: bool | None = None,
    derivatives: bool = False,
    second: bool = False,
) -> Generated:
    """Run the pipeline.

    Parameters
    ----------
    spec : Spec
        What to generate.
    system : System, optional
        Takes the place of the named system and representation.
    model : Model, optional
        What the spec's model file or named model is, if it has been made already.
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
    given = system is not None or spec.model is not None
    if system is None and spec.model is not None:
        model = model or load_model(spec.model, spec.rep or None)  # type: ignore[arg-type]
    if spec.order is not None:
        _refuse_beyond_splitting(spec, model)
    framed = spec.frame or ("" if system is not None or model is None else model.frame)
    if framed and spec.profile != "full":
        raise InputError(f"Profile {spec.profile!r} has no co-moving frame; leave out frame, or "
                         "take profile 'full'.")
    for part, asked in (("co-moving frame", framed), ("derivatives", derivatives),
                        (f"profile {spec.profile!r}", spec.profile != "full")):
        if spec.energy and asked:
            raise InputError(f"Steps with exact energy (energy = True) have no {part}; leave out "
                             "one of the two.")
    if system is None and spec.model is None and spec.system not in SYSTEMS:
        model = model or MODELS[spec.system].make(**({"rep": spec.rep} if spec.rep else {}))
    system, rep = _system(spec, system, model)
    _refuse_velocity_constraints(spec, system, own_tableau=tableau is not None)
    if system.velocity_count:
        _refuse_without_velocity_constraints(spec, system, derivatives, structured)
    if given and not allow_invalid:
        refuse_kinks(system)
        refuse_redundant_anywhere(system)
        warn_of_row_integrals(system)
    _refuse_beyond_scaled_time(spec, system, framed=bool(framed))
    system = scaled(canonical(system))
    frame = frame_of(system) if framed else None
    if frame is not None:
        system = frame.moving(system)
    system = with_work_of_time(system)
    reduced, constants = hoisted(system)
    coefficients = tableau or tableau_of(spec)
    scheme: SparkScheme | MeanScheme | SplittingScheme
    if spec.order is not None:
        scheme = splitting_scheme(system, reduced, constants, spec.order, spec.composition)
        method, method_name = spec.title, spec.method
    elif coefficients is None:
        scheme = mean_scheme(reduced, discrete=scheme_named(spec.scheme).discrete)
        method, method_name = spec.scheme, spec.method
    else:
        if not allow_invalid:
            refuse_violations(coefficients, constrained=system.m > 0)
        scheme = SparkScheme(reduced, coefficients, spec.energy)
        method = spec.title if spec.stages else f"SPARK {coefficients.name}"
        method_name = spec.method if spec.stages else coefficients.name
    name = join_name(system.name, method_name, rep, spec.real, framed=frame is not None)
    source = emit(Derived(name, method, scheme, system, constants, REALS[spec.real],
                          spec.profile, frame, derivatives or second, second, model), structured)
    return Generated(source, scheme, system, coefficients)


def _refuse_beyond_splitting(spec: Spec, model: Model | None) -> None:
    """Refuse what compositions of flows do not have, or do not need."""
    if spec.frame or (model is not None and model.frame):
        raise InputError("Scheme splitting has no co-moving frame: each of its flows commutes with "
                         "the symmetries, so that the motion would be the same; leave out frame.")


def _refuse_beyond_scaled_time(spec: Spec, system: System, *, framed: bool) -> None:
    """Refuse what steps in scaled time do not have."""
    if system.time_scale is None:
        return
    for asked, what in ((spec.order is not None, f"scheme {spec.title}"),
                        (framed, "co-moving frame"),
                        (spec.profile != "full", f"profile {spec.profile!r}")):
        if asked:
            raise InputError(f"System {system.name!r} has a time_scale, and steps in scaled time "
                             f"have no {what}; leave out one of the two.")


def _refuse_velocity_constraints(spec: Spec, system: System, *, own_tableau: bool) -> None:
    """Refuse velocity constraints with a scheme that has no equations for them."""
    own_tableau = own_tableau or spec.tableau is not None
    if not system.velocity_count or (
            not own_tableau and scheme_named(spec.scheme).velocity_constraints):
        return
    others = [scheme.name for scheme in SCHEMES.values() if scheme.velocity_constraints]
    cure = f"choose {listed(others)}" if others else "no scheme has; leave them out"
    what = "A given tableau" if own_tableau else f"Scheme {spec.scheme!r}"
    raise InputError(
        f"{what} has no equations for the velocity constraints of {system.name!r}, "
        f"{few(system.velocity_constraint_names)}; {cure}.")


def _refuse_without_velocity_constraints(
    spec: Spec, system: System, derivatives: bool, structured: bool | None
) -> None:
    """Refuse what no stepper with velocity constraints has."""
    asked = [(spec.profile != "full", f"Profile {spec.profile!r} does", "take profile 'full'"),
             (derivatives, "Derivatives of steps and runs do", "use differences of runs"),
             (structured, "Loops over element templates do", "leave out structured"),
             (spec.energy, "Steps with exact energy do", "leave out energy")]
    for wanted, what, cure in asked:
        if wanted:
            raise InputError(
                f"{what} not know velocity constraints, and {system.name!r} has "
                f"{few(system.velocity_constraint_names)}; {cure}.")


def _system(spec: Spec, system: System | None, model: Model | None) -> tuple[System, str]:
    """Return the system to generate for, and the representation that belongs into its name."""
    if system is not None:
        return system, ""
    if spec.model is not None and model is not None:
        return model.system, next((rep for rep in REPS if rep in model.bodies), "")
    if spec.system in SYSTEMS:
        made: System = SYSTEMS[spec.system].make(spec.rep)
        return made, spec.rep
    assert model is not None
    return model.system, spec.rep


def tableau_of(spec: Spec) -> Tableau | None:
    """Return the tableau of a spec, exact; None for IMS and EMS."""
    if spec.tableau is not None:
        return read_tableau(Path(spec.tableau))
    make = scheme_named(spec.scheme).tableau
    return None if make is None else make(spec.stages or 0)


def violations(tableau: Tableau) -> list[Condition]:
    """Return the required conditions that do not hold."""
    return [line for line in check_tableau(tableau) if line.required and not line.holds]


def refuse_violations(tableau: Tableau, *, constrained: bool = True) -> None:
    """Raise if a given tableau violates a required condition; derived ones hold by derivation.

    Without constraints there are no multipliers to be determined.
    """
    if not tableau.given:
        return
    broken = [line for line in violations(tableau) if constrained or line.name != "multipliers"]
    if broken:
        listed = "; ".join(f"{line.name} ({line.equation}; residual {line.residual})"
                           for line in broken[:4])
        more = f"; and {len(broken) - 4} more" if len(broken) > 4 else ""
        raise TableauError(
            f"Tableau {tableau.name!r} violates {listed}{more}; see `gyrospark verify`, or pass "
            "--allow-invalid."
        )
