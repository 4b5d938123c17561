"""What is to be generated, checked before anything expensive is imported."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError

__all__ = ["MAX_STAGES", "PAPER_SPECS", "REALS", "REPS", "SCHEMES", "SYSTEMS", "Spec",
           "is_model_file"]

#: Scheme → the fewest stages it has; 0 for the schemes without stages.
SCHEMES = {"IMS": 0, "EMS": 0, "G-L": 1, "LIIIA-B": 2}
REPS = ("alpha", "gamma")
SYSTEMS = ("heavy_top", "free_body")
REALS = ("double", "float", "long-double", "float128")
MAX_STAGES = 16


@dataclass(frozen=True)
class Spec:
    """A stepper to generate: scheme, stages, representation, system, floating-point type.

    ``tableau`` names a JSON file; scheme and stages are then the file's. ``model`` names a TOML
    file; the system is then the file's, and so is the representation unless ``rep`` says
    otherwise. Construct with ``Spec.checked``, which says what is wrong in one sentence.
    """

    scheme: str
    stages: int | None = None
    rep: str = "gamma"
    system: str = "heavy_top"
    real: str = "double"
    tableau: Path | None = None
    model: Path | None = None

    @classmethod
    def checked(
        cls,
        scheme: str | None = None,
        stages: int | None = None,
        rep: str | None = None,
        system: str | None = None,
        real: str | None = None,
        tableau: Path | None = None,
    ) -> Spec:
        """Return a spec whose every field is usable.

        Raises
        ------
        InputError
            Naming the value, the allowed ones and the cure.
        """
        model = Path(system) if system is not None and is_model_file(system) else None
        real = real or "double"
        if rep is not None or model is None:
            rep = rep or "gamma"
            _choose("representation", rep, REPS)
        if model is None:
            system = (system or "heavy_top").replace("-", "_")
            _choose("system", system, SYSTEMS, " or a model file ending in .toml")
        _choose("floating-point type", real, REALS)
        if tableau is not None:
            if scheme is not None or stages is not None:
                raise InputError(
                    "A tableau file fixes the scheme and its stages; leave out scheme and stages."
                )
            return cls("SPARK", None, rep or "", system or "", real, Path(tableau), model)
        if scheme is None:
            raise InputError(f"No scheme is given; choose {_listed(SCHEMES)}.")
        _choose("scheme", scheme, SCHEMES)
        _check_stages(scheme, stages)
        return cls(scheme, stages, rep or "", system or "", real, None, model)

    @property
    def method(self) -> str:
        """Short name of scheme and stages: ``ims``, ``gl3``, ``liiiab4``."""
        return self.scheme.lower().replace("-", "") + ("" if self.stages is None
                                                       else str(self.stages))

    @property
    def name(self) -> str:
        """Name of the generated files, e.g. ``heavy_top_gl3_gamma``; not of a model file's."""
        return join_name(self.system, self.method, self.rep, self.real)


def join_name(system: str, method: str, rep: str, real: str) -> str:
    """Return the name of a stepper; double is not mentioned."""
    parts = [system, method, rep, "" if real == "double" else real.replace("-", "_")]
    return "_".join(part for part in parts if part)


def _check_stages(scheme: str, stages: int | None) -> None:
    fewest = SCHEMES[scheme]
    if fewest == 0:
        if stages is not None:
            raise InputError(
                f"{scheme} has no stages, but stages = {stages!r} is given; leave it out."
            )
        return
    allowed = f"{scheme} takes {fewest} to {MAX_STAGES}"
    if stages is None:
        raise InputError(f"The number of stages is not given; {allowed}.")
    if isinstance(stages, bool) or not isinstance(stages, int):
        raise InputError(f"Stages {stages!r} is not a whole number; {allowed}.")
    if not fewest <= stages <= MAX_STAGES:
        raise InputError(f"Stages {stages} is out of range; {allowed}.")


def is_model_file(system: str) -> bool:
    """Whether the name of a system is a path of a model file."""
    return system.endswith(".toml")


def _choose(
    what: str, value: str, allowed: tuple[str, ...] | dict[str, int], more: str = ""
) -> None:
    if value not in allowed:
        raise InputError(f"Unknown {what} {value!r}; choose {_listed(allowed)}{more}.")


def _listed(allowed: tuple[str, ...] | dict[str, int]) -> str:
    *first, last = allowed
    return f"{', '.join(first)} or {last}"


#: The steppers of the paper, whose output is checked in.
PAPER_SPECS = tuple(
    Spec(scheme, stages, rep)
    for scheme, counts in (("IMS", (None,)), ("EMS", (None,)),
                           ("G-L", (1, 2, 3, 4)), ("LIIIA-B", (2, 3, 4, 5)))
    for stages in counts
    for rep in REPS
)
