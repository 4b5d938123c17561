"""Specification of a stepper, checked before anything expensive is imported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from ..core.arguments import as_flag, as_integer, choose, join_or, shown
from ..core.errors import InputError
from ..core.inertia import REPS
from ..core.real_types import REALS, RealName
from ..core.records import dataclass
from ..core.registry import FRAMES, MODELS, PROBLEMS, SYSTEMS, unknown_name
from .codegen.profiles import PROFILES, ProfileName
from .parsing.text_file import MODEL_FILES
from .schemes.named_schemes import (
    DEFAULT_SCHEME,
    DEFAULT_STAGES,
    MAX_STAGES,
    SCHEMES,
    Scheme,
    scheme_named,
)

__all__ = ["MAX_STAGES", "PAPER_SPECS", "Spec", "is_model_file"]

#: The scheme of a spec whose tableau is given.
OWN = "SPARK"


@dataclass(frozen=True)
class Spec:
    """A stepper to generate: scheme, stages, representation, system, floating-point type.

    ``tableau`` names a JSON file; scheme and stages are then the file's. ``model`` names a TOML
    file; the system is then the file's, and so is the representation unless ``rep`` says
    otherwise; likewise where ``system`` names one of ``gyrospark.models``. Construct with
    ``Spec.from_arguments`` or ``Spec.of_tableau``, which raise one-sentence errors.
    """

    scheme: str
    stages: int | None = None
    rep: str = "gamma"
    system: str = "heavy_top"
    real: RealName = "double"
    tableau: Path | None = None
    model: Path | None = None
    profile: ProfileName = "full"
    frame: str = ""
    order: int | None = None
    composition: str = ""
    energy: bool = False

    def with_frame(self, frame: Any) -> Spec:
        """Return the spec with a co-moving frame, along the system's symmetries, or none.

        Raises InputError naming the value and the allowed ones.
        """
        return self if frame is None else replace(self, frame=choose("frame", frame, FRAMES))

    def with_energy(self, energy: Any) -> Spec:
        """Return the spec of the method with exact energy: tableau A + θ Z (``energy_parameter``).

        Every step solves H(q₁, p₁) = H(q₀, p₀) for its θ. Raises InputError for schemes without
        a Z, and for fewer than two stages.
        """
        if not as_flag("energy", energy):
            return self
        if self.scheme == OWN or not scheme_named(self.scheme).energy or (self.stages or 0) < 2:
            takes = join_or(name for name, scheme in SCHEMES.items() if scheme.energy)
            raise InputError(f"energy = True takes {takes} with at least 2 stages, not "
                             f"{self.title}; leave out energy.")
        return replace(self, energy=True)

    def with_profile(self, profile: Any) -> Spec:
        """Return the spec with a profile: the extent of the generated stepper.

        Raises InputError naming the value and the allowed ones.
        """
        name = "full" if profile is None else choose("profile", profile, PROFILES)
        return replace(self, profile=name)

    @classmethod
    def from_arguments(
        cls, scheme: Any = None, stages: Any = None, rep: Any = None, system: str | None = None,
        real: Any = None, tableau: Path | None = None, order: Any = None, composition: Any = None
    ) -> Spec:
        """Return a spec from a user's arguments, each of them checked; None takes its default.

        ``system`` is a name, or the path of a model file. Raises InputError naming the value, the
        allowed ones and the cure.
        """
        if tableau is not None:
            refuse_beside_tableau(scheme=scheme, stages=stages, order=order,
                                  composition=composition)
            return cls.of_tableau(rep, system, real, tableau)
        if scheme is None:
            splits = order is not None or composition is not None
            scheme = "splitting" if splits else DEFAULT_SCHEME
        record = scheme_named(scheme)
        count = _stages(record, stages)
        chosen_order, composed = _composition(record, order, composition)
        source = _system_source(system, rep)
        return cls(scheme, count, source.rep, source.name, _real(real), tableau=None,
                   model=source.file, order=chosen_order, composition=composed)

    @classmethod
    def of_tableau(
        cls, rep: Any = None, system: str | None = None, real: Any = None,
        tableau: Path | None = None,
    ) -> Spec:
        """Return the spec of a tableau: of one in a file, or of one that the caller passes on.

        Raises InputError naming the value, the allowed ones and the cure.
        """
        source = _system_source(system, rep)
        return cls(OWN, stages=None, rep=source.rep, system=source.name, real=_real(real),
                   tableau=tableau, model=source.file)

    @property
    def method(self) -> str:
        """Short name of scheme and stages: ``ims``, ``gl3``, ``liiiab4``."""
        if self.scheme == OWN:
            return OWN.lower()
        scheme = scheme_named(self.scheme)
        if scheme.composed:
            return f"{scheme.key}_{self.composition}" if self.composition else \
                f"{scheme.key}{self.order}"
        exact = "_energy" if self.energy else ""
        return f"{scheme.key}{self.stages}{exact}" if scheme.takes_stages else scheme.key

    @property
    def title(self) -> str:
        """Scheme and stages as the paper writes them: ``IMS``, ``3-G-L``."""
        if self.order is not None:
            return f"splitting of order {self.order}" + (
                f", {self.composition}" if self.composition else "")
        counted = self.scheme != OWN and scheme_named(self.scheme).takes_stages
        exact = " with exact energy" if self.energy else ""
        return f"{self.stages}-{self.scheme}{exact}" if counted else self.scheme

    @property
    def name(self) -> str:
        """Name of the generated files, e.g. ``heavy_top_gl3_gamma``; not of a model file's."""
        return join_name(self.system, self.method, self.rep, self.real, framed=bool(self.frame))


def refuse_beside_tableau(**arguments: Any) -> None:
    """Refuse choices of a method, each None or given, where a tableau is given."""
    for name, argument in arguments.items():
        if argument is not None:
            raise InputError(f"{name} = {shown(argument)} and a tableau are both given, and a "
                             f"tableau fixes the scheme and its stages; leave out {name}.")


def join_name(system: str, method: str, rep: str, real: str, *, framed: bool = False) -> str:
    """Return the name of a stepper from its parts; a ``real`` "double" is not mentioned."""
    parts = [system, method, rep, "frame" if framed else "",
             "" if real == "double" else real.replace("-", "_")]
    return "_".join(word for word in parts if word)


class _SystemSource(NamedTuple):
    """Where a system comes from: a model file, or a system or model of the registry."""

    name: str
    file: Path | None  # of a model file
    rep: str  # the inertia representation; "" where a model file chooses it


def _system_source(system: str | None, rep: Any) -> _SystemSource:
    """Return the source of a system: a model file, or a name; by default the heavy top.

    A name of SYSTEMS is a system for any numbers, one of MODELS a system with its numbers.
    """
    rep_name = "" if rep is None else choose("representation", rep, REPS)
    if system is not None and is_model_file(system):
        return _SystemSource(system, Path(system), rep_name)
    name = ("heavy_top" if system is None else system).replace("-", "_")
    if name not in {*SYSTEMS, *MODELS}:
        problem = PROBLEMS.get(name.replace("_", "-"))
        if problem is not None:
            raise InputError(f"{shown(system)} is a problem, not a system; choose its system, "
                             f"{problem.make().system}.")
        raise unknown_name("system", system, [*SYSTEMS, *MODELS])
    # a system needs a representation; the function that makes a model has a default of its own
    default_rep = "gamma" if name in SYSTEMS else ""
    return _SystemSource(name, file=None, rep=rep_name or default_rep)


def _real(real: Any) -> RealName:
    """Return the name of a floating-point type, by default "double"; refuse unknown ones."""
    return choose("floating-point type", "double" if real is None else real, REALS)


def _stages(scheme: Scheme, stages: Any) -> int | None:
    """Return the number of stages, given or the scheme's own; None for a scheme without stages.

    Raises InputError for another number than the scheme takes.
    """
    if scheme.fewest == 0:
        if stages is not None:
            raise InputError(f"{scheme.name} has no stages, but stages = {shown(stages)} is given; "
                             "leave it out.")
        return None
    allowed = f"{scheme.name} takes {scheme.fewest}" + (
        f" to {scheme.most}" if scheme.takes_stages else " and no other number")
    if stages is None:
        return DEFAULT_STAGES if scheme.takes_stages else scheme.fewest
    count = as_integer(stages)
    if count is None:
        raise InputError(f"Stages {shown(stages)} is not a whole number; {allowed}.")
    if not scheme.fewest <= count <= scheme.most:
        raise InputError(f"Stages {count} is out of range; {allowed}.")
    return count


def _composition(scheme: Scheme, order: Any, named: Any) -> tuple[int | None, str]:
    """Return order and composition of a splitting; None and "" for another scheme.

    ``named`` is the name of a composition; without one ``order`` chooses it, and "" is returned.
    Raises InputError for an order that is not the composition's, and for both with another scheme.
    """
    if not scheme.composed:
        for option, value in (("order", order), ("composition", named)):
            if value is not None:
                raise InputError(f"{option} = {shown(value)} belongs to scheme splitting, and "
                                 f"{scheme.name} has its order from its stages; leave it out.")
        return None, ""
    # numbers of compositions are read from a file, which other schemes do not need
    from .tableaux.compositions import composition, composition_named

    if named is None:
        if order is None:
            raise InputError("The order is not given; splitting takes 2, 4, 6, 8 or 10.")
        return composition(order).order, ""
    schedule = composition_named(named)
    if order not in (None, schedule.order):
        raise InputError(f"Composition {schedule.name} has order {schedule.order}, not "
                         f"{shown(order)}; leave out order.")
    return schedule.order, schedule.name


def is_model_file(system: str) -> bool:
    """Whether the name of a system is a path of a model file."""
    return system.endswith((*MODEL_FILES,))


#: The steppers of the paper, whose output is checked in.
PAPER_SPECS = tuple(
    Spec(scheme, stages, rep)
    for scheme, counts in (("IMS", (None,)), ("EMS", (None,)),
                           ("G-L", (1, 2, 3, 4)), ("LIIIA-B", (2, 3, 4, 5)))
    for stages in counts
    for rep in REPS
)
