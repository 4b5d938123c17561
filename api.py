"""Where generator and runtime meet: sources from the checked-in folder, the cache, or SymPy."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from .core.arguments import as_flag, join_or, shown
from .core.errors import InputError
from .core.inertia import RepName
from .core.mesh_files import locate_all
from .core.progress import Progress, log_stages, log_task
from .core.projection import Projection, project
from .core.real_types import RealName
from .core.records import dataclass
from .core.registry import MODELS
from .core.start import HasStart, Start, as_start
from .core.warnings import capture_warnings, warn
from .engine.amalgamate import complete
from .generator.fingerprint import generator_fingerprint
from .generator.parsing.text_file import (
    UnusableFileError,
    is_robot,
    model_text,
    read_text,
    states_of_files,
)
from .generator.schemes.named_schemes import SCHEMES, SchemeName
from .generator.spec import Spec, refuse_beside_tableau
from .runtime.bindings.array_checks import as_array, as_real
from .runtime.bindings.real_numbers import rounding
from .runtime.compilation.build_cache import digest, read_cache, write_cache
from .runtime.integration.run_arguments import as_parameters
from .runtime.integration.starts import start_parameters
from .runtime.steppers.differentiation import Derive
from .runtime.steppers.run_defaults import RunDefaults
from .runtime.steppers.stepper import Stepper

if TYPE_CHECKING:
    from .generator.models.robot_options import MjcfOptions, UrdfOptions
    from .generator.multibody.model import Model
    from .generator.systems.system import System
    from .generator.tableaux.tableau import Tableau

__all__ = ["Derivation", "checked_in_files", "consistent", "derivation", "files_of", "load_model",
           "model_stepper", "stepper", "stepper_of", "tableau", "text_of"]

ROOT = Path(__file__).resolve().parent
_NONE: Mapping[str, Any] = MappingProxyType({})


def stepper(
    scheme: SchemeName | None = None,
    stages: int | None = None,
    rep: RepName | None = None,
    *,
    system: str | Path | System | Model | None = None,
    tableau: str | Path | Tableau | None = None,
    real: RealName = "double",
    frame: str | None = None,
    energy: bool = False,
    allow_invalid: bool = False,
    order: int | None = None,
    composition: str | None = None,
    progress: Progress = None,
) -> Stepper:
    """Return a compiled stepper, generated and compiled on first use, from the cache after.

    Parameters
    ----------
    scheme : SchemeName
        ``"IMS"``, ``"EMS"``, ``"G-L"`` (default), ``"LIIIA-B"``, ``"Radau-L"``, ``"splitting"``;
        left out when a tableau is given.
    stages : int
        Stages of a scheme that has a choice of them: G-L and Radau-L (from 1) or LIIIA-B (from 2);
        3 by default.
    rep : {"gamma", "alpha"}
        Inertia representation of the named systems and of model files.
    system : str, path, System or Model
        ``"heavy_top"`` (default), ``"free_body"``, the name of one of ``gyrospark.models``, a model
        file (TOML, URDF, MJCF or SDF), a ``gyrospark.System`` or a ``gyrospark.Model``, whose
        system it is.
    tableau : path or Tableau
        A user's tableau: a JSON file, or an object from ``gyrospark.tableau``. Scheme, stages,
        order and composition are then left out.
    real : RealName
        ``"double"``, ``"float"``, ``"long-double"``, ``"float128"``: floating-point type of the
        compiled code. Arrays of float128 hold mpmath numbers of 113 bits.
    frame : {"symmetries"}, optional
        Derive co-moving frames along the system's symmetries: a parameter omega for each of
        ``Stepper.symmetries``, 0 where it is not given (docs/frames.md).
    energy : bool
        Of G-L with at least 2 stages: H(q, p) less the work of forces is exact in every step, by
        one free number of the tableau (docs/theory/discrete_gradients.md). Steps in which no small
        number does that are counted in ``Report.energy_waits``.
    allow_invalid : bool
        Use a tableau although it violates required conditions, and a system although some of its
        constraints follow from others.
    order : {2, 4, 6, 8, 10}
        Of scheme splitting: exact flows of parts of H in turn, for bodies without joints.
    composition : str, optional
        Of scheme splitting, in place of ``order``: a composition by name, such as ``"SABAG6"``.
    progress : callable or bool, optional
        As of ``integrate``; a function is called with the stages done, and their number, 2:
        derivation and compilation.

    Raises
    ------
    InputError
        For unusable choices, with the allowed ones; for redundant constraints, with their names;
        for an H that has no splitting.
    TableauError
        For a tableau that violates required conditions.
    CompilerError
        If there is no C compiler, or it fails.

    Examples
    --------
    >>> import gyrospark as gs
    >>> step = gs.stepper("G-L", stages=3, rep="gamma")
    >>> step.order
    6
    """
    if frame is None:
        frame = getattr(system, "frame", None) or None  # of a Model
    visuals, events = getattr(system, "visuals", {}), getattr(system, "events", ())
    if getattr(system, "system_digest", None) is None:  # else of a Model whose system can wait
        system = getattr(system, "system", system)
    as_flag("allow_invalid", allow_invalid)
    if isinstance(system, Path):
        system = str(system)
    system_name = system if isinstance(system, str) or system is None else None
    file = Path(tableau) if isinstance(tableau, (str, Path)) else None
    own_tableau = None if file is not None else tableau
    if own_tableau is not None:
        refuse_beside_tableau(scheme=scheme, stages=stages, order=order, composition=composition)
        spec = Spec.of_tableau(rep, system_name, real)
    else:
        spec = Spec.from_arguments(scheme, stages, rep, system_name, real, file, order, composition)
    spec = spec.with_frame(frame).with_energy(energy)
    if system_name is None and system is not None and rep is not None:
        raise InputError("rep belongs to the named systems; a System brings its own H.")
    with log_stages(f"making {spec.name}", 2, progress) as end_stage:
        compiled = stepper_of(spec, None if system_name is not None else system, own_tableau,
                              allow_invalid, derived=end_stage)
        end_stage()
    if visuals:
        compiled.__dict__["visuals"] = visuals
    if events:
        compiled._model_events = events
    return compiled


def consistent(
    system: System | Stepper, start: HasStart | ArrayLike, p: ArrayLike | None = None, /, *,
    parameters: Mapping[str, float] | None = None, t: float | None = None,
) -> Projection:
    """Return the projection of a start, or of (q, p), on g(q) = 0 and g_q H_p = 0, with its report.

        q ← q − g_qᵀ (g_q g_qᵀ)⁻¹ g,   p ← p − g_qᵀ (g_q H_pp g_qᵀ)⁻¹ g_q H_p

    until nothing moves, with steps halved while |g| would grow.

    Parameters
    ----------
    system : System or Stepper
        A system needs no compiler for this.
    start, p
        As of ``Stepper.integrate``: a start, or q and p, near the constraints.
    parameters : mapping, optional
        Values that replace those of the start; together one of every parameter.
    t : float, optional
        The time, where constraints depend on it; g_q H_p + g_t = 0 is then asked for. By default
        that of the start, 0 of arrays.

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
        return system.consistent(start, p, parameters=parameters, t=t)
    from .generator.codegen.manifest_numbers import domain_of
    from .generator.systems.numeric_system import numeric
    from .generator.systems.system import System as AnySystem

    if not isinstance(system, AnySystem):
        raise InputError(f"system = {shown(system)} is neither a gyrospark.System nor a stepper.")
    q: Any = start
    numbers_of_start = as_start(start) if p is None else Start(q, p)
    domains = {symbol.name: domain_of(symbol) for symbol in (*system.parameters, *system.inputs)}
    values = as_parameters(start_parameters(domains, numbers_of_start, parameters), domains)
    state = (as_array(name, getattr(numbers_of_start, name), (system.n,), np.float64)
             for name in "qp")
    return project(numeric(system, values, float(as_real("t",
                                                         numbers_of_start.t if t is None else t))),
                   *state)


@overload
def load_model(
    path: str | Path, rep: RepName | None = None, *, real: RealName = "double",
    set: Mapping[str, Any] | None = None,
) -> Model: ...
@overload
def load_model(
    path: str | Path, rep: RepName | None = None, *, real: RealName = "double",
    **options: Unpack[UrdfOptions],
) -> Model: ...
@overload
def load_model(
    path: str | Path, rep: RepName | None = None, *, real: RealName = "double",
    **options: Unpack[MjcfOptions],
) -> Model: ...
def load_model(
    path: str | Path, rep: RepName | None = None, *, real: RealName = "double",
    set: Mapping[str, Any] | None = None, angles: Mapping[str, Any] | None = None,
    rates: Mapping[str, Any] | None = None, ignore: str | Iterable[str] | None = None,
    gravity: ArrayLike | None = None, limits: float | Literal["stops"] | None = None,
    loops: str | Path | None = None, keyframe: str | int | None = None,
    base: Literal["fixed", "floating"] | None = None, position: ArrayLike | None = None,
    quaternion: ArrayLike | None = None, velocity: ArrayLike | None = None,
    angular_velocity: ArrayLike | None = None,
) -> Model:
    """Return the model of a TOML, URDF, MJCF or SDF file: its system, parameters and start.

    A file that ends in .xml is MJCF, URDF or SDF, as its outermost element says. The system of a
    robot has the quantities JOINT_angle and JOINT_rate, or JOINT_travel and JOINT_speed. Redundant
    constraints of its loops are left out, with a warning that names them, unless ``loops`` names
    others. ``Multibody.from_file`` returns a robot's bodies and joints, to which more can be added.

    Parameters
    ----------
    path : path
        The file, UTF-8: of TOML at most 256 KiB; of a robot 1 MiB, with all that MJCF includes
        from its folder, and with macros of xacro expanded. MJCF is read by MuJoCo's compiler, of
        the extra ``robots``.
    rep : {"gamma", "alpha"}, optional
        Inertia representation; of TOML it takes the place of the file's ``[body] rep``.
    real : RealName
        The type of the numbers, as for ``stepper``. Those of a file are decimals and formulas,
        rounded once: with ``"float128"`` to mpmath numbers of 113 bits, with ``"long-double"`` to
        NumPy's.
    set : mapping of str, optional
        TOML: other values for parameters, or for keys of tables such as ``"start.euler"``; numbers,
        lists, or texts as in the file.
    angles, rates : mapping of str, optional
        Robots: coordinates of joints at the start (0, in MJCF the keyframe's), and their rates;
        rad, m, rad/s and m/s, or texts with a unit, "45 deg", "10 rpm"; of ball and free joints of
        MJCF as many numbers as in qpos and qvel. Joints with <mimic> follow theirs. Closed loops
        are then projected.
    ignore : str or sequence of str, optional
        Robots: content of the file to leave out: "limits", "friction", or "all"; in URDF and SDF
        "collision", "extension", in URDF "contact", "gazebo", in SDF "plugin"; in MJCF "contact",
        "fluid", "tendon", "actuator", "deformable". Content that is neither read nor ignored is
        refused. Visuals, sensors, transmissions and settings of solvers move nothing.
    gravity : array_like, shape (3,), optional
        Robots: in space axes, in m/s²; by default the file's, else (0, 0, -9.81) (in a world of SDF
        9.8 down).
    limits : float or "stops", optional
        Robots: stiffness of one-sided springs at the ends of joint ranges, N m/rad or N/m, as in
        ``Multibody.joint_spring``; or stops, as ``Multibody.stop``, whose restitution is the
        parameter ``restitution`` of the model, 1. By default limits are refused or ignored.
    loops : path, optional
        URDF and MJCF: a TOML file of joints that close loops, or join bodies of the file.
    keyframe : str or int, optional
        MJCF: name or number of the <key> that is the start; by default qpos0, at rest.
    base : {"fixed", "floating"}, optional
        URDF and SDF: whether the root link is space, or a body. By default it is space in URDF,
        and in SDF a body unless a joint has the parent ``world``.
    position, quaternion : array_like, optional
        URDF and SDF: place of the root link's frame, in SDF of the file's world, in space.
    velocity, angular_velocity : array_like, shape (3,), optional
        URDF and SDF, of a floating root: of its centre of mass in space, and in its own axes.

    Raises
    ------
    InputError
        With file, key or line, and cure, for whatever in the file is no model; for an option of
        another format.
    """
    from .generator.models.model_file import load_model as load

    number = rounding(Spec.from_arguments("EMS", real=real).real)  # or says what may be chosen
    options = {
        "set": set, "angles": angles, "rates": rates, "ignore": ignore, "gravity": gravity,
        "limits": limits, "loops": loops, "keyframe": keyframe, "base": base, "position": position,
        "quaternion": quaternion, "velocity": velocity, "angular_velocity": angular_velocity}
    return load(path, rep, options).in_type(number)


@overload
def tableau(scheme: SchemeName | str | Path, stages: int | None = None) -> Tableau: ...
@overload
def tableau(
    *, A: ArrayLike, b: ArrayLike, c: ArrayLike | None = None, A_hat: ArrayLike | None = None,
    b_hat: ArrayLike | None = None, A_tilde: ArrayLike | None = None,
    A_bar: ArrayLike | None = None, b_tilde: ArrayLike | None = None,
    c_tilde: ArrayLike | None = None, name: str = "butcher",
) -> Tableau: ...
def tableau(
    scheme: SchemeName | str | Path | None = None, stages: int | None = None, *,
    A: ArrayLike | None = None, b: ArrayLike | None = None, c: ArrayLike | None = None,
    A_hat: ArrayLike | None = None, b_hat: ArrayLike | None = None,
    A_tilde: ArrayLike | None = None, A_bar: ArrayLike | None = None,
    b_tilde: ArrayLike | None = None, c_tilde: ArrayLike | None = None, name: str = "butcher",
) -> Tableau:
    """Return an exact SPARK tableau: of a named scheme, of a JSON file, or of a Butcher tableau.

    Parameters
    ----------
    scheme : str or path
        ``"G-L"``, ``"LIIIA-B"``, ``"Radau-L"``, or a JSON file.
    stages : int
        Of a named scheme, 3 by default.
    A, b, c : array_like of numbers or texts, shapes (s, s), (s,) and (s,)
        A Butcher tableau: decimals, fractions, or texts such as ``"1/4 - sqrt(3)/6"``; c is by
        default the row sums of A. Decimals with more than 8 digits count as rounded.
    A_hat, b_hat : array_like, optional
        Weights of forces; by default b, and the symplectic partner b_i â_ij + b_j a_ji = b_i b_j.
    A_tilde, A_bar, b_tilde, c_tilde : array_like, optional
        The parts of constraint forces. By default they are derived so that they form a symplectic
        pair, for the highest order (docs/choosing.md).
    name : str
        Of A and b, part of the names in C: a letter, then letters, digits and underscores in lower
        case.

    Returns
    -------
    Tableau
        ``.A .A_hat .A_tilde .A_bar .b .b_hat .b_tilde .c .c_tilde`` are exact nested tuples,
        ``.order`` the proved order, ``.free_order`` that without constraints, both lower bounds,
        ``.numeric(digits=50)`` the entries as nested lists of mpmath numbers. Velocity constraints
        take G-L and Radau-L alone.

    Raises
    ------
    InputError
        For a scheme without a tableau.
    TableauError
        Naming the entry, or the condition that fails, if the parts are no tableau.

    Examples
    --------
    >>> import gyrospark as gs
    >>> gs.tableau(A=[["5/12", "-1/12"], ["3/4", "1/4"]], b=["3/4", "1/4"], name="radau_iia")
    <Tableau radau_iia: 2 stages, p = 2, proved order 3 with constraints, 3 without>
    """
    from .generator.pipeline import tableau_of
    from .generator.tableaux.tableau_file import butcher_tableau

    parts = {"A": A, "A_hat": A_hat, "A_tilde": A_tilde, "A_bar": A_bar, "b": b, "b_hat": b_hat,
             "b_tilde": b_tilde, "c": c, "c_tilde": c_tilde}
    keys = [key for key, array in parts.items() if array is not None]
    if scheme is None and stages is None:
        return butcher_tableau(name, parts)
    keys += ["name"] if name != "butcher" else []
    if keys or scheme is None:
        conflicting = " and ".join(["stages" if scheme is None else "a scheme", *keys])
        raise InputError("Give a scheme with its stages, a file, or A and b of a Butcher tableau; "
                         f"not {conflicting}.")
    if isinstance(scheme, Path) or str(scheme).endswith(".json"):
        if stages is not None:
            raise InputError("A tableau file fixes its stages; leave out stages.")
        result = tableau_of(Spec.from_arguments(tableau=Path(scheme)))
    else:
        result = tableau_of(Spec.from_arguments(scheme, stages))
    if result is None:
        names = [scheme.name for scheme in SCHEMES.values() if scheme.tableau is not None]
        raise InputError(f"{scheme} has no SPARK tableau; choose {join_or(names)}.")
    return result


@dataclass(frozen=True)
class Record:
    """Files of a stepper as the cache holds them.

    Attributes
    ----------
    name : str
        Of the stepper and its files.
    files : mapping of str to str
        Header, source and manifest by their names.
    start : RunDefaults or None
        The numbers of its model.
    """

    name: str
    files: dict[str, str]
    start: RunDefaults | None


@dataclass(frozen=True)
class Derivation:
    """A stepper to be derived: its files come from the cache, else from the generator.

    Attributes
    ----------
    spec : Spec
        Scheme, representation and so on.
    identity : sequence or None
        What the files depend on besides the spec, as JSON; None for a system or a tableau without
        a digest, whose files are not cached.
    arguments : callable
        Makes arguments of ``generate`` where the cache has no files: ``system``, ``tableau``, or
        ``model``, whose numbers are then cached too; and ``free``, as ``RunDefaults`` has it.
    allow_invalid : bool
        As for ``stepper``.
    subject : str
        What messages call the system and what the cache calls its files, of objects in this
        process; another process cannot derive these.
    """

    spec: Spec
    identity: Sequence[Any] | None = ()
    arguments: Callable[[], dict[str, Any]] = dict
    allow_invalid: bool = False
    subject: str = ""

    def stepper(
        self, derived: Callable[[], object] = lambda: None
    ) -> tuple[Stepper, RunDefaults | None]:
        """Return the stepper, and the numbers of its model; ``derived`` is called before C is
        compiled."""
        record = self.record()
        derived()
        compiled = Stepper(record.name, record.files,
                           Derive(self.further_files, portable=not self.subject))
        if record.start is not None:  # cached without the folder of the file
            compiled.__dict__["visuals"] = locate_all(record.start.visuals, self.spec.model or "")
            compiled._model_events = record.start.events
        return compiled, record.start

    def further_files(self, *, second: bool = False, control: bool = False) -> dict[str, str]:
        """Return the files with tangents and adjoints, or second derivatives; or of control."""
        return self.record("control" if control else "second" if second else "derivatives").files

    def record(self, kind: str = "") -> Record:
        """Return the files of the spec, or those of ``kind`` "derivatives", "second", "control".

        Warnings about the system are issued with the files of the spec.
        """
        # an object without a digest has the identity None
        if self.identity is not None and not (kind or self.identity
                                              or self.spec.profile != "full"):
            files = checked_in_files(self.spec.name)
            if files is not None:
                return Record(self.spec.name, files, None)
        key = None if self.identity is None else self.key(kind)
        content = None if key is None else read_cache(key)
        if content is None:
            content = self._generate(kind)
            if key is not None:
                write_cache(key, content)
        name, files, start, messages = content
        for message in () if kind else messages:
            warn(message)
        return Record(name, files, None if start is None else RunDefaults.from_json(start))

    def key(self, kind: str) -> str:
        """Return the name of the files in the cache."""
        label = "model" if self.spec.model else "system" if self.subject else self.spec.name
        tableau = "" if self.spec.tableau is None else _text_of(self.spec.tableau)
        content = digest([str(self.spec), tableau, self.identity, self.allow_invalid, kind,
                          generator_fingerprint()])
        return f"{label}-{content}.source.json"

    def keep(self, files: dict[str, str]) -> None:
        """Write generated files of a named system to the cache."""
        write_cache(self.key(""), [self.spec.name, files, None, []])

    def _generate(self, kind: str) -> list[Any]:
        """Return name, files, numbers of the model and warnings, as JSON."""
        from .generator.pipeline import generate

        spec = self.spec.with_profile("control") if kind == "control" else self.spec
        label = self.subject or str(spec.model or spec.name)
        label = f"{kind} of {label}" if kind else label
        method = "" if label.endswith(spec.name) else f" with {spec.method}"
        with capture_warnings() as messages, log_task(f"deriving {label}{method}",
                                                      f"derived {label}"):
            arguments = self.arguments()
            free_names = arguments.pop("free", [])
            source = generate(spec, allow_invalid=self.allow_invalid, **arguments,
                              derivatives=kind in ("derivatives", "second"),
                              second=kind == "second").source
        model = arguments.get("model")
        start = None if model is None else replace(RunDefaults.of(model), free=free_names).as_json()
        return [source.name, source.files(), start, messages]


def derivation(
    spec: Spec, system: Any = None, tableau: Any = None, allow_invalid: bool = False, *,
    settings: Mapping[str, str] = _NONE, options: Mapping[str, Any] = _NONE,
    with_numbers: bool = False,
) -> Derivation:
    """Return the derivation of a spec; a system and a tableau take the place of the spec's.

    Parameters
    ----------
    spec : Spec
        Names a system, a model, or a model file.
    system : System or Model, optional
    tableau : Tableau, optional
    allow_invalid : bool
        As for ``stepper``.
    settings : mapping of str to str
        Other values for keys of the model file, as ``generator.model_file.read_model`` takes them.
    options : mapping
        Arguments of the named model's function.
    with_numbers : bool
        Whether the files depend on the numbers of a Model, as those of profile control do.
    """
    if system is not None or tableau is not None:
        return _of_objects(spec, system, tableau, allow_invalid, with_numbers)
    if spec.model is not None:
        text = model_text(spec.model)
        beside = states_of_files(spec.model, text) if is_robot(spec.model) else []
        if is_robot(spec.model) and "loops" in settings:
            beside.append(model_text(settings["loops"]))
        return Derivation(spec, [text, *sorted(settings.items()), *beside],
                          partial(_model_of_file, spec, text, dict(settings)), allow_invalid)
    if spec.system in MODELS:
        return Derivation(spec, ["model", *sorted(options.items())],
                          partial(_named_model, spec, dict(options)), allow_invalid)
    return Derivation(spec, allow_invalid=allow_invalid)


def _of_objects(
    spec: Spec, system: Any, tableau: Any, allow_invalid: bool, with_numbers: bool
) -> Derivation:
    """Return the derivation of a system or a tableau that the caller has made."""
    import sympy

    from .generator.multibody.model import Model
    from .generator.systems.system import System
    from .generator.systems.system_digest import system_digest
    from .generator.tableaux.tableau import Tableau

    model = system if isinstance(system, Model) else None
    if system is not None and model is None and not isinstance(system, System):
        raise InputError(f"system = {shown(system)} is neither a name nor a gyrospark.System.")
    if tableau is not None and not isinstance(tableau, Tableau):
        raise InputError(f"tableau = {shown(tableau)} is neither a file nor a tableau; make "
                         "one with gyrospark.tableau.")
    # what the C depends on; None: such expressions have no digest, and nothing is cached
    of_system = getattr(model, "system_digest", None) or system_digest(
        system if model is None else model.system)
    of_tableau = system_digest(tableau)
    identity: list[Any] | None = None
    if of_system is not None and of_tableau is not None:
        identity = [of_system, of_tableau, sympy.__version__,
                    "" if spec.model is None else model_text(spec.model)]
        if with_numbers and model is not None:
            identity += [RunDefaults.of(model).as_json(), dict(model.units)]

    def arguments() -> dict[str, Any]:
        numbers = {"model": model} if with_numbers else {}
        return {"system": system if model is None else model.system, "tableau": tableau, **numbers}

    name = spec.name if system is None else system.name
    return Derivation(spec, identity, arguments, allow_invalid, subject=name)


@lru_cache(maxsize=64)
def _named_stepper(spec: Spec) -> Stepper:
    compiled, _ = derivation(spec).stepper()
    return compiled


def stepper_of(
    spec: Spec, system: Any = None, tableau: Any = None, allow_invalid: bool = False,
    derived: Callable[[], object] = lambda: None,
) -> Stepper:
    """Return the stepper of a spec; a system and a tableau take the place of the spec's.

    ``derived`` is called between derivation and compilation, to report progress.
    """
    files = spec.model or spec.tableau
    if system is None and tableau is None and files is None and not allow_invalid:
        paper_stepper = _named_stepper(spec)
        derived()
        return paper_stepper
    compiled, _ = derivation(spec, system, tableau, allow_invalid).stepper(derived)
    return compiled


def model_stepper(
    spec: Spec, *, settings: Mapping[str, str] = _NONE, options: Mapping[str, Any] = _NONE
) -> tuple[Stepper, RunDefaults]:
    """Return the stepper of a spec with a model file or a named model, and the model's numbers.

    Both are cached: SymPy is not imported for a file that is known, nor for other values of
    parameters that no other number of the file depends on. Warnings about the file are issued
    every time.

    Parameters
    ----------
    spec : Spec
        With the file, or the name.
    settings, options
        As for ``derivation``.

    Raises
    ------
    InputError
        With file, key and cure, for whatever in the file is no model.
    """
    def with_values(values: Mapping[str, str]) -> tuple[Stepper, RunDefaults]:
        compiled, start = derivation(spec, settings=values, options=options).stepper()
        assert start is not None
        return compiled, start

    numbers = {key: number for key, text in settings.items()
               if (number := _plain_number(text)) is not None}
    if not settings or len(numbers) < len(settings) or is_robot(spec.model or ""):
        return with_values(settings)
    compiled, start = with_values({})
    if numbers.keys() <= {*start.free}:
        return compiled, replace(start, parameters={**start.parameters, **numbers})
    return with_values(settings)


def cached_model(name: str, options: Mapping[str, Any], make: Callable[[], Model]) -> Model:
    """Return a model whose numbers are cached; its system is made when it is first asked for.

    Parameters
    ----------
    name : str
        The name of a function that makes models, and ``options`` its arguments, as JSON holds them.
    make : callable
        Makes the model where its numbers are not in the cache, or damaged.
    """
    import sympy

    from .generator.multibody.model import Model
    from .generator.systems.system_digest import system_digest

    made_by = [name, options, sympy.__version__, generator_fingerprint()]
    key = f"model-{digest(made_by)}.source.json"
    cached = read_cache(key)
    if cached is not None:
        return Model.of_numbers(RunDefaults.from_json(cached[1]), cached[0], make)
    model = make()
    of_system = system_digest(model.system)
    if of_system is not None:
        write_cache(key, [of_system, RunDefaults.of(model).as_json()])
    return model


def files_of(spec: Spec) -> dict[str, str]:
    """Return header, source and manifest of a named stepper without SymPy if they are known."""
    return derivation(spec).record().files


def text_of(
    spec: Spec, system: Any = None, *, settings: Mapping[str, str] = _NONE,
    options: Mapping[str, Any] = _NONE,
) -> tuple[dict[str, str], RunDefaults | None]:
    """Return the files of a stepper of any profile, and the numbers of its model if it has some.

    Nothing is compiled. ``system``, a System or a Model, takes the place of the spec's;
    ``settings`` and ``options`` are those of ``derivation``. Raises InputError for a system that
    the profile does not support, and a file that is no model.
    """
    record = derivation(spec, system, settings=settings, options=options,
                        with_numbers=True).record()
    return record.files, record.start


def _named_model(spec: Spec, options: dict[str, Any]) -> dict[str, Any]:
    return {"model": MODELS[spec.system].make(**options, **({"rep": spec.rep} if spec.rep else {}))}


def _model_of_file(spec: Spec, text: str, settings: Mapping[str, str]) -> dict[str, Any]:
    """Return the model of a file's text and the names that it leaves free."""
    from .generator.models.model_file import read_model

    content = read_model(text, spec.model or "", spec.rep or None, settings)
    return {"model": content.model, "free": content.free}


def _plain_number(text: str) -> float | None:
    """Return the number that a text is, without units and formulas; None if it is none."""
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) and "_" not in text else None


def _text_of(path: Path) -> str:
    """Return the text of a tableau file; empty if it is unusable: reading it says why."""
    try:
        return read_text(path, 2**20)
    except UnusableFileError:
        return ""


def checked_in_files(name: str) -> dict[str, str] | None:
    """Return the files of a stepper in ``generated/``; None if it is not there."""
    paths = [ROOT / "generated" / f"{name}.{end}" for end in ("h", "c", "json")]
    if not all(path.is_file() for path in paths):
        return None
    return complete({path.name: path.read_text(encoding="utf-8") for path in paths})
