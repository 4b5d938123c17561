"""What a model keeps when it is integrated: each promise of a scheme beside its measurement.

Like ``facade`` and ``verification`` one of the places where generator and runtime meet: what must
hold is derived (the tableau's conditions, SymPy's momentum maps), what does hold is measured.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .arguments import as_mapping
from .body_values import RepName
from .catalogue import SYSTEMS
from .errors import InputError
from .facade import stepper as make_stepper
from .facade import tableau as make_tableau
from .generator.conditions import check_tableau, is_zero
from .generator.evaluation import evaluate
from .generator.model import Model
from .generator.momentum_maps import MAX_COORDINATES, MomentumMap, momentum_maps
from .generator.scheme import DEFAULT_SCHEME, DEFAULT_STAGES, SchemeName, scheme_named
from .generator.smoothness import Switching
from .naming import shown
from .runtime.checks import as_positive_count, as_step
from .runtime.inertia import gamma_m
from .runtime.loop_invariant import loop_drift
from .runtime.measurements import constraint_scales, order_seen, reversal, trend
from .runtime.problems import Problem
from .runtime.stepper import Stepper
from .runtime.trajectory import Trajectory

if TYPE_CHECKING:
    from .generator.tableau import Tableau

__all__ = ["Certificate", "Line", "certify"]

EPS = float(np.finfo(float).eps)
#: Steps where the model names none; of a named problem also the step.
STEPS, PROBLEM_DT = 1000, 1e-3


@dataclass(frozen=True)
class Line:
    """One promise of a scheme on a model.

    Attributes
    ----------
    quantity : str
        What is kept.
    found : str
        What was measured, for people.
    expected : str
        What it should be.
    holds : bool or None
        The verdict; None where the scheme promises nothing.
    why : str
        Where the expectation comes from.
    value, bound : float or None
        The number that is judged, and its bound.
    """

    quantity: str
    found: str
    expected: str
    holds: bool | None
    why: str
    value: float | None = None
    bound: float | None = None

    def __repr__(self) -> str:
        return f"<Line {self.quantity}: {self.found}; should be {self.expected}: {self.verdict}>"

    @property
    def verdict(self) -> str:
        """``holds``, ``FAILS``, or ``-`` for a line that is for information."""
        return {True: "holds", False: "FAILS", None: "-"}[self.holds]


@dataclass(frozen=True)
class Certificate:
    """The lines of a certificate, and what was run for it."""

    model: str
    stepper: str
    order: int
    dt: float
    steps: int
    parameters: dict[str, float]
    lines: list[Line]

    def __repr__(self) -> str:
        judged = [line for line in self.lines if line.holds is not None]
        return (f"<Certificate of {self.model} with {self.stepper}, {self.steps:,} steps of "
                f"{self.dt:g} s: {sum(line.holds is True for line in judged)} of {len(judged)} "
                "promises hold>")

    @property
    def holds(self) -> bool:
        """Whether no promise is broken."""
        return all(line.holds is not False for line in self.lines)

    def line(self, quantity: str) -> Line:
        """Return the first line whose quantity begins so; KeyError if there is none."""
        for line in self.lines:
            if line.quantity.startswith(quantity):
                return line
        raise KeyError(quantity)

    def as_dict(self) -> dict[str, Any]:
        """Return the certificate as JSON can hold it: what is not finite becomes None."""
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
    dt: float | None = None,
    steps: int | None = None,
    parameters: Mapping[str, float] | None = None,
) -> Certificate:
    """Integrate a model and check what the scheme promises to keep.

    Parameters
    ----------
    model : Model or Problem
        A system with its numbers, or one of ``gyrospark.problems``.
    scheme, stages, tableau, allow_invalid
        As for ``gyrospark.stepper``; G-L with 3 stages if neither scheme nor tableau is given.
    rep : {"gamma", "alpha"}
        Inertia representation of a named problem.
    dt, steps : float, int
        Step in s and number of steps; by default the model's own.
    parameters : mapping, optional
        Values in place of the model's. An inertia parameter of a body without a value is γ_m.

    Returns
    -------
    Certificate
        Lines for the loop invariant ∮p·dq, reversibility, |g|, the constraint on the momenta,
        energy, each momentum map and the order, with ``holds`` of each and of all.

    Raises
    ------
    InputError
        For unusable arguments, a start off the constraints included.
    StepFailed
        If the run itself does not get to its end.
    """
    if scheme is None and tableau is None:
        scheme, stages = DEFAULT_SCHEME, stages or DEFAULT_STAGES
    known, step = _compiled(model, scheme, stages, rep, tableau, allow_invalid)
    if tableau is None:
        made = scheme_named(scheme).tableau
        exact = None if made is None else make_tableau(str(scheme), stages)
    else:
        exact = make_tableau(Path(tableau)) if isinstance(tableau, (str, Path)) else tableau
    if dt is None:
        dt = known.dt
    if dt is None:
        raise InputError(f"Model {known.name!r} names no time step; give dt.")
    count = as_positive_count("steps", (known.steps or STEPS) if steps is None else steps, least=2)
    values = _parameters(known, {} if parameters is None else as_mapping(
        "parameters", parameters, '{"mgl": 0.4}'))
    run = step.integrate(known.q0, known.p0, dt=as_step(dt), steps=count, parameters=values)
    values = dict(run.parameters)  # with a number where a rule was given
    examination = _Examination(known, step, Promises(known, exact, str(scheme)), run, values)
    return Certificate(model.name, step.name, step.order, run.dt, count, values,
                       list(examination.lines()))


def _compiled(
    model: Model | Problem, scheme: SchemeName | None, stages: int | None, rep: RepName | None,
    tableau: str | Path | Tableau | None, allow_invalid: bool,
) -> tuple[Model, Stepper]:
    """Return the model and its stepper; a named problem has its stepper checked in."""
    if isinstance(model, Problem):
        rep = "gamma" if rep is None else rep
        made = make_stepper(scheme, stages, rep, system=model.system, tableau=tableau,
                            allow_invalid=allow_invalid)
        system = SYSTEMS[model.system].make(rep)
        known = {str(s) for s in system.parameters}
        return Model(system, {k: v for k, v in model.parameters.items() if k in known}, model.q0,
                     model.p0, {rep: model.inertia}, PROBLEM_DT, STEPS, model.description), made
    if not isinstance(model, Model):
        raise InputError(f"model = {shown(model)} is no gyrospark.Model; make one with "
                         "gyrospark.Model(system, parameters, q0, p0).")
    if rep is not None:
        raise InputError("rep belongs to the named problems; a Model brings its own H.")
    return model, make_stepper(scheme, stages, system=model.system, tableau=tableau,
                               allow_invalid=allow_invalid)


def _parameters(model: Model, changes: Mapping[str, float]) -> dict[str, float]:
    """Return a value for every parameter, γ_m for inertia parameters that have none."""
    chosen = {name: gamma_m(inertia) for name, inertia in model.bodies.items()}
    values: dict[str, Any] = chosen | dict(model.parameters) | dict(changes)
    for name in changes:
        if name not in {str(s) for s in model.system.parameters}:
            raise InputError(f"{name!r} is no parameter of model {model.name!r}; its parameters "
                             f"are {', '.join(map(str, model.system.parameters)) or 'none'}.")
    return values


def judged(
    quantity: str, found: str, expected: str, why: str, value: float, bound: float
) -> Line:
    """Return a line that holds if its value is within its bound; NaN is not."""
    return Line(quantity, found, expected, bool(value <= bound), why, float(value), float(bound))


def told(
    quantity: str, found: str, expected: str, why: str, value: float | None = None
) -> Line:
    """Return a line for information."""
    return Line(quantity, found, expected, None, why, None if value is None else float(value))


# ---------------------------------------------------------------- what must hold


@dataclass(frozen=True)
class Promises:
    """What a scheme promises of a system, and why; derived, not listed.

    SPARK with b_i â_ij + b̂_j a_ji = b_i b̂_j, b_i ã_ij + b̃_j ā_ji = b_i b̃_j and b = b̂ is
    symplectic, and keeps every J bilinear in q and p: summed over a step,

        J_(k+1) − J_k = Δt Σ_i b_i {J, H}(Q_i, P_i) − Δt Σ_j b̃_j Λ_jᵀ g_q(Q̃_j) X(Q̃_j),

    where {J, H} = 0 everywhere and g_q X = 0 on g(Q̃_j) = 0. The same holds for IMS with one stage
    at the midpoint, which is off g = 0: there g_q X must vanish everywhere.
    """

    model: Model
    tableau: Tableau | None
    scheme: str

    @property
    def forced(self) -> bool:
        """Whether forces act that H does not know."""
        return bool(self.model.system.forces)

    @cached_property
    def violation(self) -> str:
        """The condition that keeps a tableau from being symplectic, or nothing."""
        if self.tableau is None:
            return ""
        irrelevant = "" if self.model.system.m else "symplectic, constraints"
        for line in check_tableau(self.tableau):
            asked = line.name.startswith("symplectic") and line.name != irrelevant
            if asked and line.found != "yes":
                return f"{line.equation} is off by {line.residual}"
        basis = self.tableau.basis
        same = is_zero(basis["b"] - basis["b_hat"], self.tableau)
        return "" if same else "b and b̂ differ"

    @property
    def disclaimed(self) -> bool:
        """Whether the tableau's file says itself that it is not symplectic."""
        return self.tableau is not None and self.tableau.claims.get("symplectic") == 0

    @property
    def symplectic(self) -> bool:
        """Whether the map should be: every SPARK method that does not deny it."""
        if self.forced or self.disclaimed:
            return False
        return self.tableau is not None or (self.scheme == "IMS" and not self.model.system.m)

    @property
    def why_symplectic(self) -> str:
        """The reason for ``symplectic``."""
        if self.forced:
            return "forces that are no gradient do work on the loop"
        if self.tableau is not None:
            return self.violation or "b_i â_ij + b̂_j a_ji = b_i b̂_j, b_i ã_ij + b̃_j ā_ji = b_i b̃_j"
        if self.symplectic:
            return "the implicit midpoint rule"
        return f"{self.scheme} is not symplectic: it strays with Δt²"

    @cached_property
    def places(self) -> str:
        """Where H or forces switch sides, as |x| does; nothing where they are smooth.

        A loop that crosses it has a kink, and an order is that of smooth motion.
        """
        return Switching(self.model.system).named

    @cached_property
    def jumps(self) -> str:
        """Where forces jump: a step across may have no solution, or two."""
        return Switching(self.model.system).named_jumps(discrete=self.scheme == "EMS")

    @cached_property
    def symmetric(self) -> bool:
        """Whether step(−h) undoes step(h)."""
        if self.tableau is None:
            return True
        return any(line.name == "symmetric" and line.found == "yes"
                   for line in check_tableau(self.tableau))

    def keeps(self, J: MomentumMap) -> tuple[bool, str]:
        """Return whether a momentum map must stay, and why."""
        domain = "" if J.any_parameters else " at these parameters"
        if not J.everywhere:
            return False, f"{{J, H}} = 0 on the constraints only{domain}: the motion keeps it, " \
                          "stages do not; write V for any q"
        if self.disclaimed:
            return False, self.violation
        if self.tableau is not None:
            return True, self.violation or f"{{J, H}} = 0{domain} ({J.proof})"
        if self.scheme == "IMS" and J.turns_constraints:
            return True, f"{{J, H}} = 0 and g_q X = 0 everywhere{domain} ({J.proof})"
        if self.scheme == "IMS":
            return False, "g_q X = 0 on the constraints only, and midpoints are off them"
        return False, f"{{J, H}} = 0{domain}; D need not turn as the gradient does"


# ---------------------------------------------------------------- what does hold


@dataclass(frozen=True)
class _Examination:
    """One run of a model, and the lines that come of it."""

    model: Model
    step: Stepper
    promises: Promises
    run: Trajectory
    parameters: dict[str, float]

    @property
    def walk(self) -> float:
        """What rounding may add up to: a random walk of 4 ε a step, and at least 32 ε."""
        return EPS * max(32.0, 4 * math.sqrt(self.run.report.steps))

    def lines(self) -> Iterator[Line]:
        """Yield the lines, the strictest promises first."""
        yield self._loop()
        yield self._reversal()
        if self.step.m:
            yield from self._constraints()
        yield self._energy()
        yield from self._momentum_maps()
        yield self._order()
        yield from self._quantities()

    # ------------------------------------------------------------ symplecticity, symmetry

    def _loop_sizes(self) -> tuple[Any, Any]:
        """Return how far the loop may reach in each coordinate and momentum.

        Momenta are worth the kinetic energy of the run, each by itself, so that a light body is
        not torn away by the momentum of a heavy one.
        """
        q, p = (np.asarray(x, float) for x in (self.run.q, self.run.p))
        widths = np.abs(q).max(axis=0)
        widths = np.maximum(widths, 0.1 * (widths.max() or 1.0))
        system = self.model.system
        at = self._at(q, p)
        with np.errstate(all="ignore"):
            twice = np.abs((p * evaluate(system.H_p, at).T).sum(axis=1)).max()
            twice = max(twice, np.ptp(self.run.energy().astype(float)), EPS)
            masses = evaluate([system.H_pp[i][i] for i in range(system.n)],
                              {s: np.ravel(x)[:1] for s, x in at.items()})[:, 0]
            momenta = np.sqrt(twice / np.abs(masses.astype(float)))
        largest = np.abs(p).max() or 1.0
        return widths, np.where(np.isfinite(momenta) & (momenta > 0), momenta, largest)

    def _at(self, q: Any, p: Any) -> dict[Any, Any]:
        """Return the values of all symbols along the run."""
        system = self.model.system
        at: dict[Any, Any] = {s: self.parameters[str(s)] for s in system.parameters}
        at |= dict(zip((*system.q, *system.p), (*q.T, *p.T), strict=True))
        if system.time is not None:
            at[system.time] = self.run.t
        return at

    def _loop(self) -> Line:
        quantity, promised = "loop invariant ∮p·dq", self.promises.symplectic
        sizes = self._loop_sizes()
        loop = loop_drift(self.step, self.run.q[0], self.run.p[0], sizes, dt=self.run.dt,
                          steps=self.run.report.steps, parameters=self.parameters)
        if loop is None or not loop.resolved:
            return told(quantity, "no loop could be followed", "-",
                        "neighbours of the start part too fast, or some have no step")
        bound = min(1e-12, 4 * self.walk)  # the points of a loop part from each other
        drift = loop.drift / loop.size
        found = f"{loop.start:.6g}, drift {drift:.1e} of {loop.size:.3g}, {loop.points} points"
        if not promised:
            return told(quantity, found, "not kept", self.promises.why_symplectic, drift)
        if self.promises.places:
            return told(quantity, found, "kept by smooth motion",
                        f"across {self.promises.places} loops have kinks", drift)
        return judged(quantity, found, f"drift ≤ {bound:.0e} of ∮|p dq|",
                      self.promises.why_symplectic, drift, bound)

    def _reversal(self) -> Line:
        quantity = "reversal, N steps and back"
        back = reversal(self.step, self.run, self.parameters)
        if back is None:
            return told(quantity, "a step back failed", "-", "neighbours part too fast")
        rounding = back.growth * EPS * max(64.0, 8 * math.sqrt(2 * back.steps))
        p_rounding = rounding * (1 + self._multiplier_rounding() / (back.p_size or 1.0))
        value = max(back.q_error / (back.q_size or 1.0) / rounding,
                    back.p_error / (back.p_size or 1.0) / p_rounding) * rounding
        found = f"q {back.q_error:.1e}, p {back.p_error:.1e}"
        if not self.promises.symmetric:
            return told(quantity, found, "not the identity", "the tableau is not symmetric", value)
        if self.promises.jumps:
            return told(quantity, found, "by the same steps back", "forces jump at "
                        f"{self.promises.jumps}: a step may have several ends, or none", value)
        return judged(quantity, found, f"≤ {rounding:.0e} relative",
                      f"symmetric; neighbours part {back.growth:.3g} times", value, rounding)

    def _multiplier_rounding(self) -> float:
        """Return what ε of g, or of the energy, is worth in p: IMS and EMS divide it by Δt.

        Δp = g_qᵀ (g_q H_pp g_qᵀ)⁻¹ δg/Δt with δg of the size of g's terms (4γ/Δt for a quaternion).
        """
        if self.promises.tableau is not None or not self.step.m:
            return 0.0
        system = self.model.system
        q, p = self.run.q[:1].astype(float), self.run.p[:1].astype(float)
        at, n = self._at(q, p) | {s: self.run.t[0] for s in (system.time,) if s}, system.n
        G = evaluate([e for row in system.G for e in row], at).reshape(system.m, n)
        masses = evaluate([e for row in system.H_pp for e in row], at).reshape(n, n)
        terms = np.abs(G) @ np.abs(q[0]) * np.eye(system.m)
        impulse = G.T @ np.linalg.pinv(G @ masses @ G.T) @ terms
        return float(np.abs(impulse).sum(axis=1).max() / abs(self.run.dt))

    # ------------------------------------------------------------ constraints and energy

    def _constraints(self) -> Iterator[Line]:
        places = {0, len(self.run.t) // 2, len(self.run.t) - 1}
        scales = np.array([constraint_scales(self.step, self.run.q[k], self.run.p[k],
                                             self.parameters) for k in places]).max(axis=0)
        report = self.run.report
        g_bound, f_bound = 16 * EPS * scales[0], 16 * EPS * scales[1]
        yield judged("largest |g(q)|", f"{report.constraint_max:.1e}", f"≤ {g_bound:.1e}",
                     "g(q) = 0 is solved in every step: 16 ε of what rounding q is worth in it",
                     report.constraint_max, g_bound)
        quantity = "largest |g_q H_p|"
        found = f"{report.momentum_constraint_max:.1e}"
        if self.step.manifest["scheme"]["keeps_momentum_constraint"]:
            yield judged(quantity, found, f"≤ {f_bound:.1e}", "T2 projects p in every step",
                         report.momentum_constraint_max, f_bound)
        else:
            yield told(quantity, found, "O(Δt²), comes back",
                       f"{self.promises.scheme} has no projection of p",
                       report.momentum_constraint_max)

    def _energy(self) -> Line:
        system = self.model.system
        q, p = (np.asarray(x, float) for x in (self.run.q, self.run.p))
        H = (self.run.energy() - self.run.work).astype(float)
        quantity = "energy H less work" if self.promises.forced else "energy H"
        at = self._at(q, p)
        with np.errstate(all="ignore"):
            slopes = evaluate([*system.H_q, *system.H_p], at)
            sizes = np.abs(slopes * np.concatenate([q.T, p.T])).sum(axis=0) + np.abs(H)
        scale = float(np.nanmax(sizes)) or 1.0
        linear, swing = trend(self.run.t, H)
        value = float(np.abs(H - H[0]).max())
        found = f"largest error {value:.1e}, trend {linear:+.0e}, swing {swing:.0e}"
        if self.promises.tableau is None and self.promises.scheme == "EMS":
            bound = self.walk * scale
            return judged(quantity, found, f"≤ {bound:.1e}",
                          "ΔH = Δp·D_pH + Δq·D_qH is an identity", value, bound)
        if self.promises.places:
            return told(quantity, found, f"O(Δt^{self.step.order}) between crossings",
                        f"each crossing of {self.promises.places} leaves an error of its own; EMS "
                        "alone keeps H", value)
        kept = "swings, no trend" if self.promises.symplectic and not self.promises.violation \
            else f"O(Δt^{self.step.order})"
        return told(quantity, found, kept,
                    f"an error of order {self.step.order} in Δt; EMS alone keeps H", value)

    # ------------------------------------------------------------ momentum maps

    def _momentum_maps(self) -> Iterator[Line]:
        system = self.model.system
        q, p = (np.asarray(x, float) for x in (self.run.q, self.run.p))
        try:
            found = momentum_maps(system, self.parameters, self.run.q[0], self.run.p[0])
        except InputError as error:
            yield told("momentum maps", "not searched", "-", str(error))
            return
        if not found:
            searched = "any A and a" if system.n <= MAX_COORDINATES else "translations, rotations"
            yield told("momentum maps", "none", "-",
                       f"no symmetry q → q + ε(Aq + a) of H and g ({searched})")
        for J in found:
            values, size = J.values(q, p), float(J.sizes(q, p).max())
            value, bound = float(np.abs(values - values[0]).max()), self.walk * size
            required, why = self.promises.keeps(J)
            text = f"{values[0]:.6g}, drift {value:.1e}"
            if required:
                yield judged(J.name, text, f"drift ≤ {bound:.1e}", why, value, bound)
            else:
                yield told(J.name, text, "not promised", why, value)

    # ------------------------------------------------------------ order, quantities

    def _order(self) -> Line:
        quantity, wanted = "order", self.step.order
        seen = order_seen(self.step, self.run.q[0], self.run.p[0], self.run.dt, self.parameters)
        if seen is None:
            return told(quantity, "errors are round-off", str(wanted),
                        "fewer than three errors |y_h − y_(h/2)| stand out of it")
        if not seen.agrees:
            slopes = ", ".join(f"{slope:.2f}" for slope in seen.slopes)
            return told(quantity, f"slopes {slopes}", str(wanted),
                        "no two neighbours agree to 0.2: steps are too long for the order to show")
        found = f"{seen.order:.2f} at Δt = {seen.dt:.2g}"
        if self.promises.places:
            return told(quantity, found, f"{wanted} between crossings",
                        f"steps across {self.promises.places} have a lower one", seen.order)
        lacking = wanted - seen.order  # a run may happen to be better than its method
        return judged(quantity, found, str(wanted),
                      "|y_h − y_(h/2)| over halved steps lacks at most 0.3", lacking, 0.3)

    def _quantities(self) -> Iterator[Line]:
        for name in self.run.quantities:
            values = self.run.quantity(name).astype(float)
            drift = float(np.abs(values - values[0]).max())
            yield told(name, f"{values[0]:.6g}, drift {drift:.1e}", "-", "", drift)
