"""``gs.build``: a model becomes an artefact of another program."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..api import consistent, load_model, text_of
from ..core.arguments import as_items, as_path, choose, shown, unknown
from ..core.errors import InputError
from ..core.exact_numbers import Number
from ..core.inertia import RepName
from ..core.manifest import Manifest
from ..core.real_types import RealName
from ..core.registry import MEANS, MODELS, SYSTEMS, entry_named
from ..core.start import Rule
from ..generator.schemes.named_schemes import DEFAULT_SCHEME, DEFAULT_STAGES, SCHEMES
from ..generator.spec import Spec, is_model_file
from ..runtime.bindings.array_checks import as_array, as_step
from ..runtime.integration.run_arguments import as_parameters
from ..runtime.rigid_body.problems import Problem
from ..runtime.steppers.run_defaults import RunDefaults
from . import TARGETS, Target
from .artefact import Built, Options, Written, check_out, parameter_fields, place, staging
from .tools import require

if TYPE_CHECKING:
    from ..generator.multibody.model import Model
    from ..generator.systems.system import System

__all__ = ["build", "target_named"]

#: How far a start may be from the constraints, relative to it: a few digits more than float has.
_OFF = 1e-9

#: Of profile control.
_REALS: tuple[RealName, ...] = ("float", "double")


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
) -> Built:
    """Write a stepper of profile control as an artefact that another program takes.

    Parameters
    ----------
    target : str
        What is written, a key of ``gyrospark.targets.TARGETS``: ``"cpp"``, …; ``gyrospark build
        --list`` says what each is.
    system : str, path, Problem, Model or System
        A problem (``"fast-top"``), the name of one of ``gyrospark.models``, a model file (TOML or
        URDF), or an object that they make. A System has no numbers: give ``start``,
        ``parameters`` and ``dt``.
    scheme, stages, rep, order, composition, real
        As for ``stepper``; G-L with 3 stages where no scheme is named. A target that takes several
        schemes takes a list of them, such as ``["2-G-L", "3-G-L", "IMS"]``.
    dt : float, optional
        Time step in s that the artefact starts with; the model's where it names one.
    start : tuple of two array_like, shape (n,), optional
        q and p at the start, on the constraints; the model's where left out.
    parameters : mapping, optional
        Values by name, in place of the model's; of γ and α also a rule such as ``"m"``.
    out : path, optional
        The file or folder; the stepper's name in the working directory where left out. What
        gyrospark did not write there is never written over.
    platforms : str or sequence of str, optional
        For which platforms the artefact holds binaries, where the target has some.

    Returns
    -------
    Built
        ``.path``, ``.files``, ``.platforms``, and ``.check()``, which loads the artefact again and
        compares its bits with those of the same C compiled here.

    Raises
    ------
    InputError
        For an unknown target or platform; a model without dt or start; events; systems
        that profile control does not take (Lagrangians, more than 28 coordinates, co-moving frames,
        H or g in time); names that the language of the target keeps for itself; an ``out`` of
        somebody else's; a tool that is missing, with the cure.
    GyrosparkError
        Where ``out`` cannot be written, or a tool fails.

    Examples
    --------
    >>> import gyrospark as gs
    >>> built = gs.build("cpp", "fast-top", dt=1e-3, out=folder / "top")  # doctest: +SKIP
    >>> built.check()  # doctest: +SKIP
    """
    chosen = target_named(target)
    module = chosen.load()
    wanted = _platforms(chosen, platforms)
    for name in chosen.needs:
        require(name, f"Target {chosen.name}")
    type_ = choose("floating-point type", chosen.real if real is None else real, _REALS)
    system = _resolved(system, rep)
    specs = [_spec(*one, rep, type_, system)
             for one in _schemes(chosen, scheme, stages, order, composition)]
    path = None if out is None else as_path("out", out, f"stepper{chosen.suffix}")
    if path is not None:
        check_out(path)
    given = None if isinstance(system, (str, Problem)) else system
    texts = [text_of(spec, given) for spec in specs]
    steppers = tuple(map(_written, (files for files, _ in texts)))
    first = steppers[0]
    defaults = RunDefaults.of_problem(system) if isinstance(system, Problem) else texts[0][1]
    numbers = _options(first, defaults, dt, start, parameters, steppers)
    if start is not None:
        _refuse_off_constraints(specs[0], given, numbers)
    if path is None:
        path = Path(f"{first.name}{chosen.suffix}")
        check_out(path)
    content = module.files(first.manifest, first.sources, numbers)
    facts = {"target": chosen.name, "stepper": first.name, "dt": numbers.dt, "q": numbers.q,
             "p": numbers.p, "parameters": dict(numbers.parameters), "platforms": wanted}
    with staging(path, content) as folder:
        names = place(module.compile(folder, wanted), path, facts)
    return Built(chosen, path, names, wanted, first, numbers)


def target_named(name: Any) -> Target:
    """Return the target of a name.

    Raises
    ------
    InputError
        Naming them all.
    """
    return TARGETS[choose("target", name, TARGETS)]


def _platforms(target: Target, given: Any) -> tuple[str, ...]:
    """Return the platforms of the artefact's binaries."""
    if given is None:
        return target.platforms[:1]
    names = given.split(",") if isinstance(given, str) else as_items("platforms", given, "names")
    if not target.platforms:
        raise InputError(f"Target {target.name} holds no binaries, and platforms = "
                         f"{shown(given)} is given; leave it out.")
    for name in names:
        choose("platform", name, target.platforms)
    if not names:
        raise unknown("platform", given, target.platforms)
    return tuple(dict.fromkeys(names))


def _schemes(
    target: Target, given: Any, stages: Any, order: Any, composition: Any
) -> list[tuple[Any, Any, Any, Any]]:
    """Return scheme, stages, order and composition of each stepper; most targets take one.

    Of several, ``"2-G-L"`` names its stages; another gets of these numbers what it has a choice of.
    """
    if given is None or not target.several:
        return [(given, stages, order, composition)]
    names = given.split(",") if isinstance(given, str) else [
        str(name) for name in as_items("scheme", given, "names")]
    if not names:
        raise InputError("scheme = [] names none; give one such as 'G-L'.")
    if len(names) == 1 and names[0] in SCHEMES:
        return [(names[0], stages, order, composition)]
    found = []
    for text in dict.fromkeys(names):
        number = re.match(r"(\d+)-", text)
        name = text if number is None else text[number.end():]
        scheme = SCHEMES[choose("scheme", name, SCHEMES)]
        count = int(number[1]) if number else stages if scheme.counted else None
        if scheme.counted and count is None:
            count = DEFAULT_STAGES
        found.append((name, count, *((order, composition) if scheme.composed else (None, None))))
    return found


def _spec(
    scheme: Any, stages: Any, order: Any, composition: Any, rep: Any, real: Any, system: Any
) -> Spec:
    """Return the checked spec of one stepper, of profile control."""
    if scheme is None and order is None and composition is None:
        scheme, stages = DEFAULT_SCHEME, DEFAULT_STAGES if stages is None else stages
    named = system.system if isinstance(system, Problem) else (
        system if isinstance(system, str) else None)
    return Spec.checked(scheme, stages, rep, named, real, None, order, composition
                        ).with_profile("control")


def _resolved(system: Any, rep: Any) -> Any:
    """Return a Problem, the name of a model or its file, a Model or a System."""
    if isinstance(system, (str, Path)):
        if is_model_file(str(system)):
            return str(system)
        entry = entry_named(str(system), "model")
        return entry.make() if entry.kind == "problem" else entry.name
    if system is None:
        raise InputError("system = None names nothing; give a problem such as 'fast-top', a model "
                         "or a model file.")
    if rep is not None and not isinstance(system, Problem):
        raise InputError("rep belongs to what is named; a System or Model brings its own H.")
    return system


def _written(files: Mapping[str, str]) -> Written:
    text = next(text for name, text in files.items() if name.endswith(".json"))
    return Written(Manifest.from_text(text), files)


def _options(
    stepper: Written, model: RunDefaults | None, dt: Any, start: Any, parameters: Any,
    steppers: tuple[Written, ...],
) -> Options:
    """Return the numbers of the start, each checked."""
    system = stepper.manifest.system
    name, n = system.name, len(system.coordinates)
    if model is not None and model.events:
        raise InputError(f"{name} has the event {model.events[0].name!r}, which no artefact looks "
                         "for; leave [events] out.")
    dt = dt if dt is not None or model is None else model.dt
    if dt is None:
        raise InputError(f"dt is not given and {name} names none; give one such as 1e-3 "
                         "(--dt 1e-3).")
    if start is None and model is None:
        raise InputError(f"{name} has no start; give start=(q, p), or the name of a problem or a "
                         "model instead of a system.")
    q, p = (model.q0, model.p0) if start is None and model is not None else _pair(start)
    q, p = (as_array(what, x, (n,), np.float64).tolist() for what, x in (("q", q), ("p", p)))
    dt, values = float(as_step(dt)), _values(stepper.manifest, model, parameters)
    if stepper.manifest.real == "float":
        names = (*system.coordinates, *system.momenta)
        _refuse_beyond_float({"dt": dt, **values, **dict(zip(names, (*q, *p), strict=True))})
    return Options(dt, tuple(q), tuple(p), values, "" if model is None else model.description,
                   steppers=steppers)


def _refuse_beyond_float(numbers: Mapping[str, float]) -> None:
    """Refuse numbers that would be infinite, or 0, in float."""
    limits = np.finfo(np.float32)
    for name, x in numbers.items():
        if x != 0 and not float(limits.tiny) <= abs(x) <= float(limits.max):
            raise InputError(f"{name} = {x!r} has no place in float, which has numbers from "
                             f"{float(limits.tiny):.2g} to {float(limits.max):.2g}; take real "
                             "double, or other units.")


def _refuse_off_constraints(spec: Spec, given: Any, options: Options) -> None:
    """Refuse a given state that is not on the constraints: no step would bring it there."""
    if spec.model is not None:
        given = load_model(spec.model)
    elif given is None:
        entry = {**SYSTEMS, **MODELS}[spec.system]
        given = entry.make(spec.rep) if entry.kind == "system" else entry.make()
    found = consistent(getattr(given, "system", given), options.q, options.p,
                       parameters=options.parameters)
    size = max(map(abs, (*options.q, *options.p)))
    if max(found.q_moved, found.p_moved) > _OFF * size:
        raise InputError(f"start is not on the constraints of {spec.model or spec.system}: it is "
                         f"{max(found.q_moved, found.p_moved):.2g} from them; give gs.consistent("
                         "...).q and .p.")


def _pair(start: Any) -> tuple[Any, Any]:
    if not isinstance(start, (tuple, list)) or len(start) != 2:
        raise InputError(f"start = {shown(start)} is no pair of states; give (q, p).")
    return start[0], start[1]


def _values(
    manifest: Manifest, model: RunDefaults | None, given: Any
) -> dict[str, float]:
    """Return the value of every member of the parameters' struct."""
    domains = manifest.system.parameters
    known: dict[str, Any] = {}
    if model is not None:
        rules = {name: model.rules.get(name, "m") for name in model.bodies}
        means = {name: Rule(rule if rule in MEANS else "m", model.bodies[name])
                 for name, rule in rules.items()}
        known = {name: x for name, x in {**means, **model.parameters}.items() if name in domains}
    if given is not None and not isinstance(given, Mapping):
        raise InputError(f"parameters = {shown(given)} is not a dict; give {', '.join(domains)}.")
    values = as_parameters({**known, **(given or {})}, domains)
    return {field: float(values.get(field, 0.0)) for field in parameter_fields(manifest)}
