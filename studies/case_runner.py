"""Runs a case once and remembers it: the only loop that the studies share.

A ``Case`` says as data what is integrated. The ``Engine`` answers with the trajectory and with
the errors of its invariants and of the body's axis, in the paper's norms (87)-(91):

    mean(case, c) = 1/(N_t + 1) Σ_k |c_k|,    c = ΔH, Δl₃, Δx, Δz, g(q), qᵀp

ΔH with the scheme's own H (erratum 16); Δx, Δz of the unit axis (R13, R33) against the closed
form or the 8-stage reference (erratum 17); l₃ = I₃Ω₃.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Literal, TypeVar

import numpy as np

from ..api import stepper
from ..core.arrays import Array
from ..core.errors import InputError
from ..core.inertia import RepName
from ..core.real_types import RealName
from ..core.registry import MEANS, PROBLEMS
from ..generator.schemes.named_schemes import SchemeName, scheme_named
from ..runtime.results.trajectory import Trajectory
from ..runtime.rigid_body.gamma_rules import mean_inertia
from ..runtime.rigid_body.problems import Problem
from ..runtime.steppers.stepper import Stepper
from ..runtime.tuning.tune import tune
from .reference_motion import reference_axis

__all__ = ["Case", "Engine", "Frame", "Quantity", "parameter_value", "scheme_of"]

Frame = Literal["", "start", "auto"]
Quantity = Literal["H", "E", "l3", "x", "z", "g", "qp"]
_Value = TypeVar("_Value")


@dataclass(frozen=True)
class Case:
    """A run: problem, stepper, parameter, time step and frame.

    Attributes
    ----------
    problem, settings
        Name of the problem and arguments of its function, e.g. ``(("radius_ratio", 1.5),)``.
    scheme, stages, rep, real
        The stepper.
    parameter
        γ or α: a number in kg m², or a rule such as "m", "ht" or "0.01m".
    dt, steps
        Δt in seconds and N_t.
    frame
        The rule for the rates of a co-moving frame, "start" or "auto"; "" for no frame.
    """

    problem: str
    scheme: SchemeName
    stages: int | None
    rep: RepName
    parameter: float | str
    dt: float
    steps: int
    settings: tuple[tuple[str, float], ...] = ()
    real: RealName = "double"
    frame: Frame = ""

    @property
    def method(self) -> str:
        """The scheme as the paper writes it, e.g. "3-LIIIA-B"."""
        return self.scheme if self.stages is None else f"{self.stages}-{self.scheme}"

    def __str__(self) -> str:
        return f"{self.problem}, {self.method}-{'γ' if self.rep == 'gamma' else 'α'}"


def scheme_of(method: str) -> tuple[SchemeName, int | None]:
    """Return scheme and stages of the paper's name, ("LIIIA-B", 3) for "3-LIIIA-B"."""
    stages, sign, scheme = method.partition("-")
    if sign and stages.isdecimal():
        return scheme_named(scheme).name, int(stages)
    return scheme_named(method).name, None


class Engine:
    """Integrates cases and remembers them.

    Parameters
    ----------
    short : bool
        Fewer points in sweeps, for tests; tables keep all their cells.
    watch : callable, optional
        Called with a short text before every integration.
    """

    def __init__(self, *, short: bool = False, watch: Callable[[str], None] | None = None) -> None:
        self.short = short
        self.watch = watch
        self._trajectories: dict[Case, Trajectory] = {}
        self._axes: dict[Case, Array] = {}

    # ------------------------------------------------------------ what a case means

    def problem(self, case: Case) -> Problem:
        """Return the case's problem."""
        return _problem(case.problem, case.settings)

    def stepper(self, case: Case) -> Stepper:
        """Return the case's compiled stepper."""
        return stepper(case.scheme, case.stages, case.rep, system=self.problem(case).system,
                       real=case.real, frame="symmetries" if case.frame else None)

    def parameter(self, case: Case) -> float:
        """Return γ or α of the case in kg m²."""
        return parameter_value(case.parameter, self.problem(case).inertia)

    def parameters(self, case: Case) -> dict[str, float]:
        """Return all parameters of the case's stepper."""
        return self.problem(case).parameters | {case.rep: self.parameter(case)}

    def thin(self, values: Sequence[_Value]) -> list[_Value]:
        """Return the values, in short mode only every third, with both ends."""
        if not self.short:
            return list(values)
        return [*values[:-1:3], values[-1]]

    # ------------------------------------------------------------ runs

    def trajectory(self, case: Case) -> Trajectory:
        """Return the case's trajectory, which is computed once.

        Raises
        ------
        StepFailed
            When a step does not converge.
        """
        if case not in self._trajectories:
            if self.watch is not None:
                self.watch(str(case))
            step, parameters = self.stepper(case), self.parameters(case)
            q0, p0 = self.problem(case).q0, self.problem(case).p0
            # the problem's start meets the constraints to double precision only
            if case.real != "double":
                q0, p0 = step.project(q0, p0, parameters=parameters)
            if case.frame:
                parameters |= tune(step, q0, p0, dt=case.dt, steps=case.steps,
                                   parameters=parameters, frame=case.frame).parameters
            self._trajectories[case] = step.integrate(q0, p0, dt=case.dt, steps=case.steps,
                                                      parameters=parameters,
                                                      solver="newton")  # as the paper
        return self._trajectories[case]

    def axis_reference(self, case: Case) -> Array:
        """Return the true axis at the case's times, shape (N_t + 1, 3)."""
        if case not in self._axes:
            self._axes[case], _ = reference_axis(self.problem(case), self.trajectory(case))
        return self._axes[case]

    # ------------------------------------------------------------ errors

    def errors(self, case: Case, quantity: Quantity) -> Array:
        """Return the signed errors at k = 0..N_t, shape (N_t + 1,).

        "H", "E", "l3": c_k − c_0 of the energy, of the energy with p projected onto qᵀp = 0, and
        of l₃ = I₃Ω₃; "x", "z": R13, R33 less the true ones; "g": qᵀq − 1; "qp": qᵀp.
        """
        run = self.trajectory(case)
        if quantity == "H":
            return np.asarray(run.energy() - run.energy()[0])
        if quantity == "E":
            return np.asarray(run.energy_error(of_motion=True))
        if quantity == "l3":
            l3 = self.problem(case).inertia[2] * run.angular_velocity()[:, 2]
            return np.asarray(l3 - l3[0])
        if quantity in ("x", "z"):
            column = "xyz".index(quantity)
            return np.asarray(run.axis()[:, column] - self.axis_reference(case)[:, column])
        factor, target = (run.q, 1) if quantity == "g" else (run.p, 0)
        return np.asarray((run.q * factor).sum(axis=1) - target)

    def mean(self, case: Case, quantity: Quantity) -> float:
        """Return the mean error (87)-(91): 1/(N_t + 1) Σ_k |c_k|, c the errors of ``errors``."""
        return float(np.abs(self.errors(case, quantity)).mean())

    def peak(self, case: Case, quantity: Quantity) -> float:
        """Return the error of largest size with its sign: the periodic error of Figs. 10-16."""
        errors = self.errors(case, quantity)
        return float(errors[np.argmax(np.abs(errors))])

    def size(self, case: Case, quantity: Quantity) -> float:
        """Return the scale of a quantity's relative error: |H₀|, |l₃,₀|, |q||p₀| or 1."""
        problem = self.problem(case)
        if quantity in ("H", "E"):
            return abs(float(self.trajectory(case).energy()[0]))
        if quantity == "l3":
            return abs(problem.inertia[2] * float(self.trajectory(case).angular_velocity()[0, 2]))
        return float(np.linalg.norm(problem.p0)) if quantity == "qp" else 1.0

    def floor(self, case: Case, quantity: Quantity) -> float:
        """Return the round-off floor ε · N_t · size, ε the machine epsilon of the case's type.

        It is the sum of N_t roundings, each of relative size ε and all of one sign: an error below
        it cannot be distinguished from zero after N_t steps.
        """
        epsilon = float(np.finfo(self.stepper(case).binding.dtype).eps)
        return epsilon * case.steps * self.size(case, quantity)


@cache
def _problem(name: str, settings: tuple[tuple[str, float], ...]) -> Problem:
    """Return a problem of the registry; ``settings`` are the arguments of its function."""
    make: Callable[..., Problem] = PROBLEMS[name].make
    return make(**dict(settings))


def parameter_value(parameter: float | str, inertia: Sequence[float]) -> float:
    """Return γ or α in kg m².

    ``parameter`` is a number in kg m², or a mean of the moments of inertia, "m", "h", "mt", "ht",
    with an optional factor before it, e.g. "100m".
    """
    if not isinstance(parameter, str):
        return float(parameter)
    match = re.fullmatch(rf"([0-9.]*)({'|'.join(MEANS)})", parameter)
    if match is None:
        raise InputError(f"Unknown parameter rule {parameter!r}; write m, h, mt or ht, with a "
                         "factor before it if need be, as in 100m.")
    factor, rule = match.groups()
    return float(factor or 1) * mean_inertia(inertia, rule)
