"""Certificate of a stepper on a model: each guaranteed property with its measurement.

Like ``api`` and ``verification`` one of the places where generator and runtime meet: what must
hold is derived (``guarantees``), what does hold is measured (``measured_properties``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from ..api import stepper as make_stepper
from ..api import tableau as make_tableau
from ..core.arguments import as_mapping, choose, count_text, shown
from ..core.calls import explain_arguments
from ..core.errors import InputError
from ..core.exact_numbers import Number
from ..core.html import card, table
from ..core.inertia import RepName
from ..core.progress import Progress, log_stages
from ..core.real_types import REALS, RealName
from ..core.registry import FRAMES, SYSTEMS
from ..core.start import without_events
from ..core.warnings import capture_warnings
from ..generator.multibody.model import Model
from ..generator.schemes.named_schemes import (
    DEFAULT_SCHEME,
    DEFAULT_STAGES,
    SchemeName,
    scheme_named,
)
from ..generator.symbolic.numeric_evaluation import as_rational
from ..generator.systems.system import System
from ..generator.systems.time_scale import scale_time
from ..runtime.bindings.array_checks import as_positive_count, as_step
from ..runtime.integration.run_arguments import step_argument
from ..runtime.rigid_body.problems import Problem
from ..runtime.steppers.stepper import Stepper
from .guarantees import Guarantees, MeanGuarantees, SparkGuarantees, SplittingGuarantees
from .measured_properties import CertificateLine, Examination
from .measurements import step_keyword
from .round_off import RoundOff

if TYPE_CHECKING:
    from ..generator.tableaux.tableau import Tableau

__all__ = ["Certificate", "CertificateLine", "certify", "compile_model"]

#: Steps where the model names none; of a named problem also the step.
STEPS, PROBLEM_DT = 1000, 1e-3


@explain_arguments
@dataclass(frozen=True)
class Certificate:
    """The lines of a certificate, with the stepper, time step and parameters of its run."""

    model: str
    stepper: str
    order: int
    dt: float
    steps: int
    parameters: dict[str, float]
    lines: list[CertificateLine]
    #: Whether dt is a step of scaled time.
    scaled: bool = False

    @property
    def step_text(self) -> str:
        """The step with its unit."""
        return f"Δτ = {self.dt:g}" if self.scaled else f"{self.dt:g} s"

    def __repr__(self) -> str:
        compared = [line for line in self.lines if line.holds is not None]
        return (f"<Certificate of {self.model} with {self.stepper}, "
                f"{count_text(self.steps, 'step')} of "
                f"{self.step_text}: {sum(line.holds is True for line in compared)} of "
                f"{count_text(len(compared), 'guarantee')} hold>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: a row for each property, its measurement and the result."""
        table_rows = [(line.quantity, line.found, line.expected, line.verdict)
                      for line in self.lines]
        outcome = "every guarantee holds" if self.holds else "a guarantee is missed"
        return card(f"Certificate of {self.model} with {self.stepper}, "
                    f"{count_text(self.steps, 'step')} of "
                    f"{self.step_text}: {outcome}",
                    table(table_rows, ("kept", "found", "should be", "verdict")))

    @property
    def holds(self) -> bool:
        """Whether no property is refuted or missed."""
        return all(line.holds is not False for line in self.lines)

    def line(self, quantity: str) -> CertificateLine:
        """Return the first line whose quantity begins so; KeyError if there is none."""
        for line in self.lines:
            if line.quantity.startswith(quantity):
                return line
        raise KeyError(quantity)

    def as_dict(self) -> dict[str, Any]:
        """Return the certificate for JSON; numbers that are not finite become None."""
        content = asdict(self) | {"holds": self.holds}
        for line in content["lines"]:
            for key in ("value", "bound"):
                if line[key] is not None and not math.isfinite(line[key]):
                    line[key] = None
        return content


def certify(
    model: Model | Problem,
    scheme: SchemeName | None = None,
    stages: int | None = None,
    *,
    rep: RepName | None = None,
    tableau: str | Path | Tableau | None = None,
    allow_invalid: bool = False,
    frame: str | None = None,
    energy: bool = False,
    real: RealName = "double",
    dt: float | None = None,
    dtau: float | None = None,
    steps: int | None = None,
    parameters: Mapping[str, Number] | None = None,
    order: int | None = None,
    composition: str | None = None,
    progress: Progress = None,
) -> Certificate:
    """Integrate a model and check the properties that the scheme guarantees.

    Parameters
    ----------
    model : Model or Problem
        A system with its numbers, or one of ``gyrospark.problems``.
    scheme, stages, order, composition, tableau, allow_invalid, frame, energy
        As for ``gyrospark.stepper``; G-L with 3 stages if neither scheme nor tableau is given.
    real : {"double", "float"}
        Floating-point type of the stepper; what is measured of its states is in doubles.
    rep : {"gamma", "alpha"}
        Inertia representation of a named problem.
    dt, steps : float, int
        Step in s and number of steps; by default the model's own, or 1000
        steps; a named problem has 1e-3 s and 1000 steps.
    dtau : float
        In place of dt, of a system with ``time_scale``: the step of scaled time. Properties are
        those of the extended system in (q, t, p, e), e = −H.
    parameters : mapping, optional
        Values in place of the model's. With co-moving frames the rates too, by default the least
        squares of the start.
    progress : callable or bool, optional
        As for ``integrate``; a function is called with the number of tasks that are done, and with
        3, the number of tasks: the stepper, its run, the properties.

    Returns
    -------
    Certificate
        Lines for the loop invariant ∮p·dq, reversibility, |g|, the constraint on the momenta,
        energy, each momentum map and the order, each with ``holds``; ``holds`` of the certificate
        is that of all lines. They are of the motion without the model's events and impacts.

    Raises
    ------
    InputError
        For unusable arguments, a start off the constraints included.
    StepFailed
        If the run itself does not get to its end.
    """
    if scheme is None and tableau is None and order is None and composition is None:
        scheme, stages = DEFAULT_SCHEME, DEFAULT_STAGES if stages is None else stages
    if choose("real", real, REALS) not in ("double", "float"):
        raise InputError(f"real = {real!r} has more digits than the doubles in which a certificate "
                         "is measured; choose double or float.")
    with log_stages("certifying", 3, progress) as end_stage:
        explicit_model, step = compile_model(model, rep, {
            "scheme": scheme, "stages": stages, "tableau": tableau, "allow_invalid": allow_invalid,
            "frame": frame, "real": real, "energy": energy, "order": order,
            "composition": composition})
        end_stage()
        size = _step_size(explicit_model, step, dt, dtau)
        # two steps are the least from which a trend and a drift can be seen
        count = as_positive_count(
            "steps", (explicit_model.steps or STEPS) if steps is None else steps, minimum=2)
        changes = _changed_parameters(parameters, step, model.name)
        # events and impacts would end and change this run alone, not those of loops and orders
        start = without_events(explicit_model.start)
        run = step.integrate(start, steps=count, parameters=changes, **step_keyword(step, size))
        end_stage()
        numbers = dict(run.parameters)
        # with time_scale: the extended system in (q, t, p, e), which is what the run keeps
        system = scale_time(explicit_model.system)
        guarantees = _guarantees(system, step, scheme, stages, tableau, numbers)
        round_off = RoundOff(system, run, numbers, step)
        with capture_warnings():  # the run above has warned already
            lines = list(Examination(
                explicit_model, system, step, guarantees, run, numbers, round_off).lines())
        end_stage()
        if step.binding.clocked:  # in scaled time run.dt is Δτ
            lines = _in_scaled_time(lines)
        return Certificate(model.name, step.name, step.order, run.dt, count, numbers, lines,
                           step.binding.clocked)


def _changed_parameters(
    parameters: Mapping[str, Number] | None, step: Stepper, model_name: str
) -> Mapping[str, Number]:
    """Return the parameters that the caller of ``certify`` changes, by name; empty for None.

    Raises InputError for a name that is no parameter of the stepper.
    """
    if parameters is None:
        return {}
    changes: Mapping[str, Number] = as_mapping("parameters", parameters, '{"mgl": 0.4}')
    for name in changes:
        if name not in step.parameter_domains:
            raise InputError(f"{name!r} is no parameter of model {model_name!r}; its "
                             f"parameters are {', '.join(step.parameter_domains) or 'none'}.")
    return changes


def _in_scaled_time(lines: list[CertificateLine]) -> list[CertificateLine]:
    """Return the lines with Δτ in place of Δt: the step of scaled time is the step of the run."""
    texts = ("found", "expected", "why")
    return [replace(line, **{name: getattr(line, name).replace("Δt", "Δτ") for name in texts})
            for line in lines]


class MethodOptions(TypedDict, total=False):
    """Arguments of ``gyrospark.stepper`` besides system and representation."""

    scheme: SchemeName | None
    stages: int | None
    tableau: str | Path | Tableau | None
    allow_invalid: bool
    frame: str | None
    real: RealName
    energy: bool
    order: int | None
    composition: str | None


def compile_model(
    model: Model | Problem, rep: RepName | None, options: MethodOptions
) -> tuple[Model, Stepper]:
    """Return a model, with the H of a named problem written out, and its compiled stepper.

    A named problem becomes a model with the H of its system; its stepper is the named one, whose C
    is kept in ``generated/``.
    """
    frame = options.get("frame")
    if isinstance(model, Problem):
        # as a model: H in closed form, with the parameters that this form has
        rep = "gamma" if rep is None else rep
        stepper = make_stepper(rep=rep, system=model.system, **options)
        system = SYSTEMS[model.system].make(rep)
        parameter_names = {str(s) for s in system.parameters}
        return Model(system, {k: v for k, v in model.parameters.items() if k in parameter_names},
                     model.q0, model.p0, bodies={rep: model.inertia}, dt=PROBLEM_DT, steps=STEPS,
                     description=model.description, frame=frame or ""), stepper
    if not isinstance(model, Model):
        raise InputError(f"model = {shown(model)} is no gyrospark.Model; make one with "
                         "gyrospark.Model(system, parameters, q0, p0).")
    if rep is not None:
        raise InputError("rep belongs to the named problems; a Model brings its own H.")
    if frame is not None:
        model = replace(model, frame=choose("frame", frame, FRAMES))
    options = {**options, "frame": model.frame or None}
    return model, make_stepper(system=model.system, **options)


def _step_size(model: Model, step: Stepper, dt: float | None, dtau: float | None) -> float:
    """Return the step of the run: Δt in s, by default the model's, or Δτ in scaled time.

    Of ``dt`` and ``dtau`` at most one is a number. Raises InputError if there is no step, and for a
    system from a Lagrangian, whose H is not written out.
    """
    if step.manifest.system.velocity_names:
        raise InputError(f"System {model.system.name!r} is from a Lagrangian, and its H is not "
                         "written out: guarantees are not proved for it. Certify a model with the "
                         "system that its legendre() returns.")
    if dt is None and not step.binding.clocked:
        dt = model.dt
        if dt is None and dtau is None:
            raise InputError(f"Model {model.name!r} names no time step; give dt.")
    size: float = as_step(step_argument(step.binding, dt, dtau))
    return size


def _guarantees(
    system: System, step: Stepper, scheme: SchemeName | None, stages: int | None,
    tableau: str | Path | Tableau | None, parameters: Mapping[str, float],
) -> Guarantees:
    """Return the guarantees of the stepper's kind of scheme, at the parameters of the run.

    A stepper that solves no equations is a composition of flows; a scheme without a tableau is IMS
    or EMS, with a mean or discrete gradient; every other is a SPARK method with its tableau, which
    is the user's if ``tableau`` is not None.
    """
    # the doubles of the run, as fractions: a proof is about these numbers
    exact_parameters = {s: as_rational(parameters[str(s)]) for s in system.parameters}
    if not step.binding.solves:
        return SplittingGuarantees(system, exact_parameters, step.order)
    if tableau is None and scheme_named(scheme).tableau is None:
        return MeanGuarantees(system, exact_parameters, str(scheme), step.order)
    if tableau is None:
        return SparkGuarantees(system, exact_parameters, make_tableau(str(scheme), stages),
                               bool(step.manifest.scheme.exact_energy))
    # a text or path names the file of a tableau
    exact = make_tableau(Path(tableau)) if isinstance(tableau, (str, Path)) else tableau
    return SparkGuarantees(system, exact_parameters, exact)
