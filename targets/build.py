"""``gs.build``: a model becomes an artefact of another program."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..api import consistent, derivation, text_of
from ..core.arguments import as_items, as_path, choose, shown, unknown
from ..core.errors import InputError
from ..core.exact_numbers import Number
from ..core.incompatibilities import refuse_together
from ..core.inertia import RepName
from ..core.manifest import Manifest
from ..core.progress import Progress, log_stages
from ..core.real_types import RealName
from ..core.registry import MEANS, SYSTEMS, entry_named
from ..core.start import Rule
from ..generator.schemes.named_schemes import SCHEMES
from ..generator.spec import Spec, is_model_file
from ..runtime.bindings.array_checks import as_array, as_step
from ..runtime.compilation.body_columns import built_inertias
from ..runtime.integration.run_arguments import as_parameters
from ..runtime.rigid_body.problems import Problem
from ..runtime.steppers.run_defaults import RunDefaults
from . import TARGETS, Target
from .artefact import Built, Options, Written, check_out, parameter_fields, place, staging
from .tools import require

if TYPE_CHECKING:
    from ..generator.multibody.model import Model
    from ..generator.systems.system import System

__all__ = ["Changed", "build", "target_named"]

#: How far a start may be from the constraints, relative to it: profile control does not project
#: starts. 1e-9 is below the rounding of float, 6e-8, and above that of ten typed digits.
_MAX_DISTANCE = 1e-9

#: Number types of profile control.
_REALS: tuple[RealName, ...] = ("float", "double")


@dataclass(frozen=True)
class Changed:
    """A model file, or a named model, with other values: what ``--set`` of the command names.

    Attributes
    ----------
    name : str
        The path of the file, or the name.
    values : mapping
        Key of the file → its text, or the arguments of the function that makes the named model.
    """

    name: str
    values: Mapping[str, Any]


def build(
    target: str,
    system: str | Path | System | Model | Problem,
    *,
    scheme: str | Sequence[str] | None = None,
    stages: int | None = None,
    rep: RepName | None = None,
    order: int | None = None,
    composition: str | None = None,
    real: RealName | None = None,
    dt: float | None = None,
    start: tuple[Any, Any] | None = None,
    parameters: Mapping[str, Number] | None = None,
    out: str | Path | None = None,
    platforms: str | Sequence[str] | None = None,
    progress: Progress = None,
) -> Built:
    """Write a stepper of profile control as an artefact that another program takes.

    Parameters
    ----------
    target : str
        What is written, a key of ``gyrospark.targets.TARGETS``: ``"cpp"``, …; ``gyrospark build
        --list`` says what each is.
    system : str, path, Problem, Model or System
        A problem (``"fast-top"``), the name of one of ``gyrospark.models``, a model file (TOML,
        URDF, MJCF or SDF), or an object that they make. A System has no numbers: give ``start``,
        ``parameters`` and ``dt``.
    scheme, stages, rep, order, composition, real
        As for ``stepper``; G-L with 3 stages where no scheme is named. A target that takes several
        schemes takes a list of them, such as ``["2-G-L", "3-G-L", "IMS"]``; ``stages``, ``order``
        and ``composition`` are then for those that leave them open.
    dt : float, optional
        Time step in s that the artefact starts with; the model's where it names one.
    start : tuple of two array_like, shape (n,), optional
        q and p at the start, on the constraints; the model's where left out.
    parameters : mapping, optional
        Numbers by name, in place of the model's; ``gs.gamma(inertia, "h")`` is one for γ and α.
        Where neither has them they are γ_m.
    out : path, optional
        The file or folder; the stepper's name in the working directory where left out. What
        gyrospark did not write there is never written over.
    platforms : str or sequence of str, optional
        For which platforms the artefact holds binaries, where the target has some.
    progress : callable or bool, optional
        As for ``integrate``; a function is called with the number of tasks that are done, and with
        2, the number of tasks: derivation, and the artefact.

    Returns
    -------
    Built
        ``.path``, ``.files``, ``.platforms``, and ``.check()``, which loads the artefact again and
        compares its bits with the same C compiled here.

    Raises
    ------
    InputError
        For an unknown target or platform; a model without dt or start; events; systems
        that profile control does not take (Lagrangians, more than 28 coordinates, co-moving frames,
        H or g in time); names that the language of the target keeps for itself; a start off the
        constraints, also of the model if ``parameters`` move them; γ or α that the model leaves to
        a search by runs; an ``out`` of somebody else's, or with another ending than the artefact's;
        a tool that is missing, with the cure.
    GyrosparkError
        Where ``out`` cannot be written, or a tool fails.

    Examples
    --------
    >>> import gyrospark as gs
    >>> built = gs.build("cpp", "fast-top", dt=1e-3, out=folder / "top")  # doctest: +SKIP
    >>> built.check()  # doctest: +SKIP
    """
    chosen_target = target_named(target)
    platform_names = _platforms(chosen_target, platforms)
    for name in chosen_target.needs:
        require(name, f"Target {chosen_target.name}")
    real_name = choose("floating-point type", chosen_target.real if real is None else real, _REALS)
    system = _resolve_system(system, rep)
    specs = [*dict.fromkeys(  # G-L with 3 stages and 3-G-L are one stepper
        _spec(*scheme_arguments, rep, real_name, system)
        for scheme_arguments in _schemes(chosen_target, scheme, stages, order, composition))]
    # arguments are checked before anything is derived, which takes seconds
    path = None if out is None else as_path("out", out, f"stepper{chosen_target.suffix}")
    if path is not None:
        check_out(path, chosen_target.suffix)
    # a System or a Model of the caller; None: the spec has the name of the system
    model = None if isinstance(system, (str, Problem, Changed)) else system
    changes = _changes(system)
    with log_stages(f"building {chosen_target.name}", 2, progress) as end_stage:
        files_and_defaults = [text_of(spec, model, **changes) for spec in specs]
        end_stage()
        steppers = tuple(_written_stepper(files) for files, _ in files_and_defaults)
        _, model_defaults = files_and_defaults[0]
        defaults = RunDefaults.of_problem(system) if isinstance(system, Problem) else model_defaults
        options = _options(steppers[0], defaults, dt, start, parameters, steppers)
        # the model's start is on its constraints, unless the caller changes their parameters
        if start is not None or not {*(parameters or ())}.isdisjoint(
                steppers[0].manifest.system.start_parameters):
            _refuse_off_constraints(specs[0], _system_of(specs[0], model, changes), options)
        if chosen_target.has_velocities:
            options = replace(options,
                              rates=_rates(_system_of(specs[0], model, changes), options))
        if path is None:
            # the name of the stepper is known only now
            path = Path(f"{steppers[0].name}{chosen_target.suffix}")
            check_out(path, chosen_target.suffix)
        artefact = _write(chosen_target, platform_names, path, options)
        end_stage()
        return artefact


def _write(target: Target, platforms: tuple[str, ...], path: Path, options: Options) -> Built:
    """Write the files of a target, compile them, and place the artefact at ``path``."""
    module, stepper = target.load(), options.steppers[0]
    facts = {"target": target.name, "stepper": stepper.name, "dt": options.dt, "q": options.q,
             "p": options.p, "parameters": dict(options.parameters), "platforms": platforms}
    with staging(path, module.files(stepper.manifest, stepper.sources, options)) as folder:
        names = place(module.compile(folder, platforms), path, facts)
    return Built(target, path, names, platforms, stepper, options)


def target_named(name: Any) -> Target:
    """Return the target of a name.

    Raises InputError naming them all.
    """
    return TARGETS[choose("target", name, TARGETS)]


def _platforms(target: Target, platforms: Any) -> tuple[str, ...]:
    """Return the names of the platforms of an artefact's binaries, each once; by default the first.

    ``platforms`` are names, or a text of names with commas; a target without binaries takes None.
    """
    if platforms is None:
        return target.platforms[:1]
    names = (platforms.split(",") if isinstance(platforms, str)
             else as_items("platforms", platforms, "names"))
    if not target.platforms:
        raise InputError(f"Target {target.name} holds no binaries, and platforms = "
                         f"{shown(platforms)} is given; leave it out.")
    for name in names:
        choose("platform", name, target.platforms)
    if not names:
        raise unknown("platform", platforms, target.platforms)
    return tuple(dict.fromkeys(names))


def _schemes(
    target: Target, schemes: Any, stages: Any, order: Any, composition: Any
) -> list[tuple[Any, Any, Any, Any]]:
    """Return scheme, stages, order and composition of each stepper; most targets take one.

    In a list of schemes, ``"2-G-L"`` names its stages; other schemes get the given stages, order
    and composition if they have such a choice. Raises InputError for those that no scheme takes.
    """
    if schemes is None or not target.several:
        return [(schemes, stages, order, composition)]
    names = schemes.split(",") if isinstance(schemes, str) else [
        str(name) for name in as_items("scheme", schemes, "names")]
    if not names:
        raise InputError("scheme = [] names none; give one such as 'G-L'.")
    # one scheme in a list takes the arguments as a scheme alone does
    if len(names) == 1 and names[0] in SCHEMES:
        return [(names[0], stages, order, composition)]
    scheme_arguments, takes_stages, is_composed = [], False, False
    for text in dict.fromkeys(names):
        stage_prefix = re.match(r"(\d+)-", text)
        name = text if stage_prefix is None else text[stage_prefix.end():]
        scheme = SCHEMES[choose("scheme", name, SCHEMES)]
        count = stages if scheme.takes_stages else None
        if stage_prefix is not None:
            count = int(stage_prefix[1])
        orders = (order, composition) if scheme.composed else (None, None)
        scheme_arguments.append((name, count, *orders))
        takes_stages = takes_stages or (scheme.takes_stages and stage_prefix is None)
        is_composed = is_composed or scheme.composed
    if stages is not None and not takes_stages:
        raise InputError(f"stages = {shown(stages)} is given, and each of {', '.join(names)} names "
                         "its stages or has none to choose; leave it out.")
    for option, value in (("order", order), ("composition", composition)):
        if value is not None and not is_composed:
            raise InputError(f"{option} = {shown(value)} belongs to scheme splitting, which is "
                             f"none of {', '.join(names)}; leave it out.")
    return scheme_arguments


def _spec(
    scheme: Any, stages: Any, order: Any, composition: Any, rep: Any, real: Any, system: Any
) -> Spec:
    """Return the checked spec of one stepper, of profile control."""
    system_source = system.system if isinstance(system, Problem) else (
        system.name if isinstance(system, Changed) else
        system if isinstance(system, str) else None)
    return Spec.from_arguments(scheme, stages, rep, system_source, real, order=order,
                               composition=composition).with_profile("control")


def _resolve_system(system: Any, rep: Any) -> Any:
    """Return the ``system`` of ``build`` as a Problem, the name of a model, a path, a Changed, a
    Model or a System."""
    if isinstance(system, (str, Path)):
        if is_model_file(str(system)):
            return str(system)
        entry = entry_named(str(system), "model")
        return entry.make() if entry.kind == "problem" else entry.name
    if system is None:
        raise InputError("system = None names nothing; give a problem such as 'fast-top', a model "
                         "or a model file.")
    if rep is not None and not isinstance(system, (Problem, Changed)):
        raise InputError("rep belongs to what is named; a System or Model brings its own H.")
    return system


def _written_stepper(files: Mapping[str, str]) -> Written:
    """Return the stepper of these files, name → text, with its manifest, which is the JSON among
    them."""
    text = next(text for name, text in files.items() if name.endswith(".json"))
    return Written(Manifest.from_text(text), files)


def _options(
    stepper: Written, model: RunDefaults | None, dt: Any, start: Any, parameters: Any,
    steppers: tuple[Written, ...],
) -> Options:
    """Return Δt, the start, the parameters and the description of an artefact, each checked.

    ``dt``, ``start`` = (q, p) and ``parameters`` are the caller's, None for the model's own. A
    model with events is refused: artefacts look for none.
    """
    system = stepper.manifest.system
    name, n = system.name, len(system.coordinates)
    refuse_together(artefact=f"an artefact of {name}", events=model is not None
                    and bool(model.events) and f"its event {model.events[0].name!r}")
    dt = dt if dt is not None or model is None else model.dt
    if dt is None:
        raise InputError(f"dt is not given and {name} names none; give one such as 1e-3 "
                         "(--dt 1e-3).")
    if start is None and model is None:
        raise InputError(f"{name} has no start; give start=(q, p), or the name of a problem or a "
                         "model instead of a system.")
    q, p = (model.q0, model.p0) if start is None and model is not None else _pair(start)
    q, p = (as_array(letter, x, (n,), np.float64).tolist() for letter, x in (("q", q), ("p", p)))
    dt = float(as_step(dt))
    parameter_values = _parameter_values(stepper.manifest, model, parameters)
    if stepper.manifest.real == "float":
        # a number that float cannot hold would be infinite or 0 on the controller
        names = (*system.coordinates, *system.momenta)
        _refuse_beyond_float({"dt": dt, **parameter_values,
                              **dict(zip(names, (*q, *p), strict=True))})
    return Options(dt, tuple(q), tuple(p), parameter_values,
                   "" if model is None else model.description, steppers=steppers)


def _refuse_beyond_float(numbers: Mapping[str, float]) -> None:
    """Refuse numbers outside the normal range of float."""
    limits = np.finfo(np.float32)
    for name, x in numbers.items():
        if x != 0 and not float(limits.tiny) <= abs(x) <= float(limits.max):
            raise InputError(f"{name} = {x!r} has no place in float, which has numbers from "
                             f"{float(limits.tiny):.2g} to {float(limits.max):.2g}; take real "
                             "double, or other units.")


def _changes(system: Any) -> dict[str, Any]:
    """Return the values of a Changed by the argument of ``derivation`` that takes them."""
    if not isinstance(system, Changed):
        return {}
    return {"settings" if is_model_file(system.name) else "options": system.values}


def _system_of(spec: Spec, model: Any, changes: Mapping[str, Any]) -> System:
    """Return the system of a file or a name, with its ``changes``, or of ``model``, the caller's.
    """
    if model is None:
        # of one of SYSTEMS, which has no numbers, the generator makes it from its name
        arguments = derivation(spec, **changes).arguments()
        model = arguments["model"] if arguments else SYSTEMS[spec.system].make(spec.rep)
    system: System = getattr(model, "system", model)
    return system


def _rates(system: System, options: Options) -> tuple[float, ...]:
    """Return q' = H_p at the start, from H itself: its text in a manifest rounds decimals."""
    from ..generator.systems.numeric_system import NumericSystem

    rates = NumericSystem(system, options.parameters).H_p(np.array(options.q), np.array(options.p))
    return tuple(rates.tolist())


def _refuse_off_constraints(spec: Spec, system: System, options: Options) -> None:
    """Refuse a start off the constraints at the artefact's parameters: steps do not project it."""
    # the struct in C has the time, too, and a member where there are no parameters
    own_names = {symbol.name for symbol in (*system.parameters, *system.inputs)}
    projection = consistent(system, options.q, options.p, parameters={
        name: number for name, number in options.parameters.items() if name in own_names})
    size = max(map(abs, (*options.q, *options.p)))
    # the projection moves a start by its distance from the constraints
    distance = max(projection.q_moved, projection.p_moved)
    if distance > _MAX_DISTANCE * size:
        raise InputError(f"The start is not on the constraints of {spec.model or spec.system} at "
                         f"these parameters: it is {distance:.2g} from them; give gs.consistent("
                         "...).q and .p, or change the model itself (--set of a model file).")


def _pair(start: Any) -> tuple[Any, Any]:
    """Return q and p of ``start`` = (q, p); InputError for anything else."""
    if not isinstance(start, (tuple, list)) or len(start) != 2:
        raise InputError(f"start = {shown(start)} is no pair of states; give (q, p).")
    return start[0], start[1]


def _parameter_values(
    manifest: Manifest, model: RunDefaults | None, parameters: Any
) -> dict[str, float]:
    """Return the value of every member of the parameters' struct: the caller's, else the model's.

    γ and α are means of the moments where neither names them; a rule that searches one by runs is
    refused.
    """
    domains = manifest.system.parameters
    if parameters is not None and not isinstance(parameters, Mapping):
        raise InputError(f"parameters = {shown(parameters)} is not a dict; give "
                         f"{', '.join(domains)}.")
    defaults: dict[str, Any] = {}
    if model is not None:
        means: dict[str, Any] = {}
        for name, inertia in model.bodies.items():
            rule = model.rules.get(name, "m")
            if rule not in MEANS and name in domains and name not in {
                    **model.parameters, **(parameters or {})}:
                raise InputError(f"{name} = {rule!r} is chosen for the motion of a run, which an "
                                 f"artefact does not make; give {name} a number or a mean, such as "
                                 f"--parameter {name}=m.")
            means[name] = Rule(rule, inertia)
        defaults = {name: x for name, x in {**means, **model.parameters}.items() if name in domains}
    values = as_parameters({**defaults, **(parameters or {})}, domains,
                           bodies=built_inertias(manifest.system))
    return {field: float(values.get(field, 0.0)) for field in parameter_fields(manifest)}
