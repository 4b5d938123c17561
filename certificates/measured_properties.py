"""Measured properties of a run, a line for each property of its scheme."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..core.arrays import Array
from ..core.errors import InputError
from ..core.manifest import SchemeManifest
from ..generator.multibody.model import Model
from ..generator.symbolic.derivatives import derivative
from ..generator.symbolic.numeric_evaluation import evaluate
from ..generator.symbolic.rounding_errors import rounding
from ..generator.symbolic.shared_subexpressions import substitute
from ..generator.systems.moving_frame import energy_of
from ..generator.systems.smoothness import Switching
from ..generator.systems.system import System
from ..runtime.results.trajectory import Trajectory
from ..runtime.steppers.stepper import Stepper
from .guarantees import Guarantee, Guarantees, make_guarantee, no_guarantee
from .loop_invariant import loop_drift
from .measurements import measure_order, reversal, step_keyword, trend
from .momentum_maps import (
    MAX_COORDINATES,
    MomentumMap,
    momentum_map_of,
    momentum_maps,
)
from .round_off import RoundOff

__all__ = ["CertificateLine", "Examination"]

#: A step so short that only the residual of the initial state is left.
_SHORT = 1e-30


@dataclass(frozen=True)
class CertificateLine:
    """One property of a scheme on a model.

    Attributes
    ----------
    quantity : str
        The conserved quantity or other property.
    found : str
        The measurement, as text.
    expected : str
        The expected value or bound, as text.
    holds : bool or None
        The result; None where nothing is guaranteed.
    why : str
        The reason for the expectation.
    value, bound : float or None
        The measured number, and its bound.
    """

    quantity: str
    found: str
    expected: str
    holds: bool | None
    why: str
    value: float | None = None
    bound: float | None = None

    def __repr__(self) -> str:
        return (f"<CertificateLine {self.quantity}: {self.found}; should be {self.expected}: "
                f"{self.verdict}>")

    @property
    def verdict(self) -> str:
        """``holds``, ``FAILS``, or ``-`` for a line that is for information."""
        return {True: "holds", False: "FAILS", None: "-"}[self.holds]


def bound_line(
    quantity: str, measured: str, expected: str, guarantee: Guarantee, value: float, bound: float
) -> CertificateLine:
    """Return a line that holds if value ≤ bound; NaN fails.

    A guarantee refuted in exact algebra fails for any value. If the value is within the bound all
    the same, the line says that the run does not show the violation.
    """
    within = bool(value <= bound)
    why = guarantee.why
    if guarantee.refuted:
        why = f"refuted in exact algebra: {guarantee.refuted}"
        measured += " (not told from round-off in this run)" if within else ""
    return CertificateLine(quantity, measured, expected, within and not guarantee.refuted, why,
                           float(value),
                           float(bound))


def info_line(
    quantity: str, measured: str, expected: str, why: str, value: float | None = None
) -> CertificateLine:
    """Return a line for information."""
    return CertificateLine(quantity, measured, expected, None, why,
                           None if value is None else float(value))


@dataclass(frozen=True)
class Examination:
    """One run of a model, and the lines that come of it."""

    model: Model
    #: The system of the model; in scaled time with t among the coordinates.
    system: System
    step: Stepper
    guarantees: Guarantees
    run: Trajectory
    parameters: dict[str, float]
    round_off: RoundOff

    @property
    def steps(self) -> int:
        """Steps of the run."""
        return self.run.report.steps

    @cached_property
    def switching(self) -> Switching:
        """Switches of H and the forces, such as |x|: guarantees need a smooth motion."""
        return Switching(self.system)

    def lines(self) -> Iterator[CertificateLine]:
        """Yield the lines, the strictest properties first."""
        yield self._compiled_system()
        yield self._loop()
        yield self._reversal()
        if self.step.binding.conditions:
            yield from self._constraints()
        yield from self._energies()
        yield from self._motion_energy()
        yield from self._damping()
        yield from self._momentum_maps()
        yield self._order()
        yield from self._quantities()

    # ------------------------------------------------------------ the compiled equations

    def _compiled_system(self) -> CertificateLine:
        """Compare compiled H, H_p, H_q - F, g, A H_p + a with the model's, in units of ε.

        All other lines are measured with the compiled stepper alone, which would agree with itself
        if it were one of another system. The residual at x = 0 (SPARK; for IMS and EMS at the start
        itself) is (-H_p, H_q - F, g) in the limit of a short step; its last rows are A H_p + a. A
        composition of flows has no residual: H and g are compared, and the line on energy shows
        that its flows are flows of H.
        """
        system, step = self.system, self.step
        solves = step.binding.solves
        rates = [*system.H_p, *system.minus_p_rate] if solves else []
        slip = substitute(system.velocity_constraints,
                          dict(zip(system.velocities, system.H_p, strict=bool(system.velocities))))
        expressions = [energy_of(system), *rates, *system.constraints, *slip]
        sample_rows = np.unique(np.linspace(0, self.steps, 5).astype(int))  # five states at most
        symbol_values = self.round_off.values(sample_rows)
        if step.binding.clocked:  # a residual is that of a start, where e = −H
            symbol_values[system.p[-1]] = -self.run.energies[sample_rows].astype(float)
        expected = np.broadcast_to(evaluate(expressions, symbol_values),
                                   (len(expressions), len(sample_rows)))
        sizes = np.broadcast_to(rounding(expressions, symbol_values, {}), expected.shape)
        compiled_values = np.array([
            self._compiled_values(self.run.q[row], self.run.p[row], self.run.t[row], len(slip))
            for row in sample_rows], dtype=float).T
        sizes = sizes + sizes.max() * self.round_off.epsilon  # some vanish, at a time of 1e-30 s
        with np.errstate(all="ignore"):
            differences = np.abs(compiled_values - expected) / (self.round_off.epsilon * sizes)
        differences[compiled_values == expected] = 0.0
        largest = float(differences.max())
        functions = "compiled H, H_p, H_q − F, g" if solves else "compiled H, g"
        # shared subexpressions and fused operations round otherwise than the estimate, by units
        return bound_line(f"{functions}{', A H_p + a' * bool(slip)}",
                          f"{largest:.2g} times the estimated round-off", "≤ 16",
                          make_guarantee("compiled from this model's H, g and F"), largest, 16.0)

    def _compiled_values(self, q: Array, p: Array, t: Any, slip_count: int) -> list[float]:
        """Return compiled H, H_p, H_q − F, g and A H_p + a at a state; of flows H and g alone."""
        step, n, stages = self.step, self.system.n, self._scheme.stages or 1
        # rates of a co-moving frame are 0: H and not H − Σ ω_i J_i is the model's
        parameters = self.parameters | {symmetry.name: 0.0 for symmetry in step.symmetries}
        energy = float(step.energy(q, p, parameters=parameters, t=t))
        if not step.binding.solves:
            g, _ = step.defects(q, p, parameters=parameters, t=t)
            return [energy, *g]
        x = np.zeros(step.unknowns)
        if self._scheme.unknowns_are_state:
            x[: 2 * n] = np.concatenate(step.binding.start_in_scaled_time(
                step.binding.parameters(parameters), q, p, t))
        r = step.residual(x, q, p, parameters=parameters, t=t,
                          **step_keyword(step, _SHORT)).astype(float)
        # the rows of a SPARK residual: −H_p and H_q − F of each stage, g, …, A H_p + a at the end
        end = 2 * stages * n
        return [energy, *-r[:n], *r[stages * n : (stages + 1) * n], *r[end : end + step.m],
                *r[len(r) - slip_count :]]

    # ------------------------------------------------------------ symplecticity, symmetry

    def _loop(self) -> CertificateLine:
        """Return the line of the loop invariant: ∮p·dq over a loop of starts, and its drift."""
        quantity = f"loop invariant ∮p·dq{' + e dt' * self.step.binding.clocked}"
        guarantee = self.guarantees.loop()
        rounded = self.round_off
        loop = loop_drift(self.step, self.run.q[0], self.run.p[0], self._loop_sizes(),
                          (rounded.q_sizes, rounded.p_sizes), dt=self.run.dt, steps=self.steps,
                          parameters=self.parameters)
        # without a number only algebra can refute the invariant
        if loop is None or not loop.is_resolved:
            why = f"refuted in exact algebra: {guarantee.refuted}; " if guarantee.refuted else ""
            return CertificateLine(
                quantity, "no loop could be followed", "-", False if guarantee.refuted else None,
                f"{why}neighbours of the start part too fast, or some have no step")
        # relative to the effect of ε in the states, as the bound is
        drift, bound = loop.drift / loop.scale, rounded.walk
        measured = f"{loop.start:.6g}, drift {loop.drift:.1e}, {loop.points} points"
        if not guarantee.guaranteed:
            return info_line(quantity, measured, "not guaranteed", guarantee.why, drift)
        if self.switching.description and not guarantee.refuted:
            return info_line(quantity, measured, "kept by smooth motion",
                             f"across {self.switching.description} loops have kinks", drift)
        return bound_line(quantity, measured, f"drift ≤ {bound * loop.scale:.1e}", guarantee, drift,
                          bound)

    def _loop_sizes(self) -> tuple[Any, Any]:
        """Return the half widths, in each coordinate and momentum, of the loop of starts on which
        ∮p·dq is evaluated.

        The width of each momentum is √(E/H_pp), so that a light body does not get the momentum of
        a heavy one. E is the largest |p·H_p| of the run, twice its kinetic energy, or the spread of
        its energy if that is larger; for a motion at rest, of which both are round-off, the size of
        the terms of H.
        """
        system, n = self.model.system, self.model.system.n
        q, p = (np.abs(x.astype(float)).max(axis=0) for x in (self.run.q, self.run.p))
        # a coordinate that stays near 0 gets a tenth of the largest one
        q_widths = np.maximum(q, 0.1 * (q.max() or 1.0))
        energy, inverse_inertia = float(np.ptp(self.run.energy())), np.zeros(n)
        # H_p and the diagonal of H_pp
        rates = [*system.H_p,
                 *(derivative(v, x) for v, x in zip(system.H_p, system.p, strict=True))]
        for symbol_values, _ in self.round_off.states(rates):
            rate_values = evaluate(rates, symbol_values)
            momenta = np.array([symbol_values[s] for s in system.p])
            energy = max(energy, float(np.abs((momenta * rate_values[:n]).sum(axis=0)).max()))
            inverse_inertia = np.maximum(inverse_inertia, np.abs(rate_values[n:]).max(axis=1))
        size = self.round_off.energy
        if energy < math.sqrt(self.round_off.epsilon) * size:
            energy = size
        with np.errstate(all="ignore"):
            p_widths = np.sqrt(energy / inverse_inertia)
        # a momentum without H_pp gets the largest one of the run
        has_width = np.isfinite(p_widths) & (p_widths > 0)
        return q_widths, np.where(has_width, p_widths, p.max() or 1.0)

    def _reversal(self) -> CertificateLine:
        """Return the line of reversibility: N steps of Δt, then N of −Δt, compared with the start.

        Round-off grows with the distance of neighbours, whose growth is measured.
        """
        quantity = "reversal, N steps and back"
        # round-off of q and of p in units of ε
        sizes = q_size, p_size = self.round_off.sizes_of_steps(self.run.dt)
        reversed_run = reversal(self.step, self.run, self.parameters, sizes)
        if reversed_run is None:
            return info_line(quantity, "a step of the way back, or of a neighbour, failed", "-",
                             "neighbours part too fast")
        # how much multipliers that follow from g alone enlarge the round-off of p
        kicks = 1 + self._kick / p_size
        # rounding adds up like a random walk, √(2N) units over both ways; 8 of its deviations
        random_walk = max(64, 8 * (2 * self.steps) ** 0.5)
        bound = reversed_run.growth * kicks * self.round_off.epsilon * random_walk
        error = max(reversed_run.q_error / q_size, reversed_run.p_error / p_size)
        measured = f"q {reversed_run.q_error:.1e}, p {reversed_run.p_error:.1e}"
        if not self.guarantees.symmetric:
            why = "the reversed step has another θ" if self._scheme.exact_energy else \
                "the tableau is not symmetric"
            return info_line(quantity, measured, "not guaranteed", why, error)
        jumps = self.switching.named_jumps(discrete=self.guarantees.discrete)
        if jumps:
            return info_line(quantity, measured, "by the same steps back",
                             f"forces jump at {jumps}: a step may have several ends, or none",
                             error)
        expected = f"≤ {bound * q_size:.0e}, {bound * p_size:.0e}"
        guarantee = make_guarantee(f"symmetric; neighbours part {reversed_run.growth:.3g} times")
        return bound_line(quantity, measured, expected, guarantee, error, bound)

    @property
    def _kick(self) -> float:
        """Largest round-off that multipliers add to a momentum in a step, in units of ε.

        Multipliers that follow from g = 0 alone carry the round-off of g, divided by Δt, into p.
        It is 0 without constraints, and if each step ends with a projection of p.
        """
        if self._projects or not self.step.m:
            return 0.0
        return float(self.round_off.impulse.max() / abs(self.run.dt))

    @property
    def _projects(self) -> bool:
        """Whether each step ends with a projection of p onto g_q H_p = 0, its part T2."""
        return bool(self._scheme.keeps_momentum_constraint)

    @property
    def _scheme(self) -> SchemeManifest:
        """The record of the scheme in the stepper's manifest: stages, order, invariants."""
        return self.step.manifest.scheme

    # ------------------------------------------------------------ constraints and energy

    def _constraints(self) -> Iterator[CertificateLine]:
        """Yield the lines of g = 0, of f = g_q H_p = 0 and of A H_p + a = 0.

        Row 0, the start, is the user's and left out. ``unit`` times the size of a constraint's
        terms bounds the residual of each step.
        """
        unit = 16 * self.round_off.epsilon
        # sizes of terms of g and f, and the largest |g| and |f| of the run, all over its states
        g_size, f_size = (float(sizes.max(initial=0)) for sizes in self.round_off.constraints)
        g, f = (float(x[1:].max()) for x in self.run.constraint_errors())
        if self.step.m:
            yield bound_line("largest |g(q)|", f"{g:.1e}", f"≤ {unit * g_size:.1e}",
                         make_guarantee("g(q) = 0 is solved in every step, to 16 ε of the size of "
                                        "its terms"), g, unit * g_size)
        quantity = "largest |g_q H_p|"
        if self.step.binding.rows:  # velocity constraints are among the equations of every step
            yield bound_line(f"{quantity}, |A H_p + a|" if self.step.m else "largest |A H_p + a|",
                         f"{f:.1e}", f"≤ {unit * f_size:.1e}",
                         make_guarantee("solved in every step, at its end and at every node"), f,
                         unit * f_size)
            return
        guarantee = self.guarantees.momentum_constraint()
        if not guarantee.guaranteed:
            yield info_line(quantity, f"{f:.1e}", "O(Δt²), comes back", guarantee.why, f)
            return
        # without a projection of p the round-off of the steps adds up
        bound = f_size * (unit if self._projects else self.round_off.walk)
        yield bound_line(quantity, f"{f:.1e}", f"≤ {bound:.1e}", guarantee, f, bound)

    @cached_property
    def moving(self) -> list[tuple[float, MomentumMap]]:
        """The rates of the co-moving frame that are not 0, each with its momentum map."""
        return [(rate, momentum_map_of(symmetry.A, symmetry.meaning, self.system,
                                       any_parameters=not symmetry.condition))
                for symmetry in self.step.symmetries
                if (rate := float(self.parameters[symmetry.name]))]

    def _energies(self) -> Iterator[CertificateLine]:
        """Yield the line of H; in a co-moving frame the guarantee is for H − Σ ω_i J_i.

        H itself is then kept if every J_i is; otherwise a second line has H − Σ ω_i J_i.
        """
        guarantee = self.guarantees.energy()
        lost = [J.name for _, J in self.moving if not self.guarantees.momentum(J).guaranteed]
        if not (guarantee.guaranteed and lost):
            yield self._energy(guarantee)
            return
        yield self._energy(no_guarantee(f"H − Σ ω_i J_i is kept, not each J_i: not "
                                        f"{', '.join(lost)}"))
        q, p, rounded = self.run.q, self.run.p, self.round_off
        errors = self.run.energy_error().astype(float)
        bound = rounded.walk * rounded.energy
        # ΔH − Σ ω_i ΔJ_i, and the round-off of its terms
        for rate, J in self.moving:
            momentum = J.values(q, p)
            errors = errors - rate * (momentum - momentum[0])
            bound += rounded.walk * abs(rate) * float(J.sizes(rounded.q_sizes, rounded.p_sizes))
        error = float(np.abs(errors).max())
        yield bound_line("energy in the frame, H − Σ ω_i J_i", f"largest error {error:.1e}",
                         f"≤ {bound:.1e}", guarantee, error, bound)

    def _motion_energy(self) -> Iterator[CertificateLine]:
        """Yield the line of the energy of the motion, where the scheme does not keep f = 0: H then
        contains kinetic energy off the constraints."""
        if not self.step.m or self.guarantees.momentum_constraint().guaranteed:
            return
        error = float(np.abs(self.run.energy_error(of_motion=True).astype(float)).max())
        # of ½ fᵀW⁻¹f with f = O(Δt^order), where H itself is kept
        order = self.step.order * (1 + self.guarantees.energy().guaranteed)
        yield info_line("energy of the motion, H at p on g_q H_p = 0",
                        f"largest error {error:.1e}", f"O(Δt^{order})",
                        "H also contains ½ fᵀW⁻¹f of the momenta with f = g_q H_p ≠ 0, which "
                        "the motion does not have: (qᵀp)²/8γ of a body", error)

    def _energy(self, guarantee: Guarantee) -> CertificateLine:
        """Return the line of the energy: its largest error, and the linear trend of the error."""
        system = self.model.system
        works = system.forces or system.is_time_dependent or any(system.a)
        quantity = ("energy H + e" if self.step.binding.clocked else
                    "energy H less work" if works else "energy H")
        error = self.run.energy_error().astype(float)
        # a drift shows as a trend, an error that only oscillates as a swing
        linear, swing = trend(self.run.t, error)
        largest = float(np.abs(error).max())
        measured = f"largest error {largest:.1e}, trend {linear:+.0e}, swing {swing:.0e}"
        if not guarantee.guaranteed:
            crossed = self.switching.description
            why = f"; each crossing of {crossed} leaves an error of its own" if crossed else ""
            return info_line(
                quantity, measured, f"O(Δt^{self.step.order})"
                f"{' between crossings' if crossed else ''}", guarantee.why + why, largest)
        waits = self.run.report.energy_waits  # steps for which no θ makes the energy exact
        if waits:
            return info_line(quantity, f"{measured}; {waits} steps without a small θ",
                             f"O(Δt^{self.step.order}) in those steps, else round-off",
                             f"{guarantee.why}; where H(q₁, p₁) hardly depends on θ, a later step "
                             "compensates the error", largest)
        bound = self.round_off.walk * self.round_off.energy
        return bound_line(quantity, measured, f"≤ {bound:.1e}", guarantee, largest, bound)

    def _damping(self) -> Iterator[CertificateLine]:
        """Yield lines on the method's damping; none for a method without an R(z).

        R(∞) decides on dampers that are fast relative to Δt, |R(iωΔt)| on oscillations without any.
        """
        stability = self.guarantees.stability
        if stability is None:
            return
        if self.decay:
            why = "what decays faster than Δt is gone after a step" if stability.l_stable else \
                "what decays faster than Δt goes on as R(∞)^k: it rings"
            stiffness = float(self.decay * abs(self.run.dt))
            yield info_line("dampers", f"λΔt up to {stiffness:.2g}; {stability}", "-", why,
                            stiffness)
        if stability.damping is not None:
            share, power = stability.damping
            yield info_line("numerical damping",
                            f"{float(share):.2g} (ωΔt)^{power} of an oscillation "
                            "ω a step", "-", "|R(iωΔt)| < 1: the method itself damps what is fast")

    @cached_property
    def decay(self) -> float:
        """λ, the fastest decay that dampers make: |eigenvalues| of ∂F/∂p over the run, in 1/s."""
        system = self.system
        damped = [i for i, force in enumerate(system.forces) if force.has(*system.p)]
        # ∂F/∂p without its rows and columns of zeros
        slopes = [derivative(system.forces[i], system.p[j]) for i in damped for j in damped]
        fastest = 0.0
        for symbol_values, count in self.round_off.states(slopes) if damped else ():
            jacobians = evaluate(slopes, symbol_values).reshape(len(damped), len(damped), count)
            usable = np.isfinite(jacobians).all(axis=(0, 1))
            # eigvals takes the matrices along the first axis
            rates = np.linalg.eigvals(jacobians.transpose(2, 0, 1)[usable])
            fastest = max(fastest, float(np.abs(rates).max(initial=0.0)))
        return fastest

    # ------------------------------------------------------------ momentum maps

    def _momentum_maps(self) -> Iterator[CertificateLine]:
        """Yield a line for each momentum map J = p·(A q + a) of a symmetry: its largest change."""
        system, rounded = self.system, self.round_off
        q, p = rounded.states_of_run
        # H or F may contain a function that cannot be evaluated, and g a switch
        try:
            maps = momentum_maps(system, self.parameters, q[0], p[0])
        except InputError as error:
            yield info_line("momentum maps", "not searched", "-", str(error))
            return
        if not maps:
            searched = "any A and a" if system.n <= MAX_COORDINATES else "translations, rotations"
            yield info_line("momentum maps", "none", "-",
                            f"no symmetry q → q + ε(Aq + a) of H and g is found ({searched})")
        for J in maps:
            momentum = J.values(q, p)
            guarantee = self._in_frame(J, self.guarantees.momentum(J))
            drift = float(np.abs(momentum - momentum[0]).max())
            bound = rounded.walk * float(J.sizes(rounded.q_sizes, rounded.p_sizes))
            measured = f"{float(momentum[0]):.6g}, drift {drift:.1e}"
            if guarantee.guaranteed:
                yield bound_line(J.name, measured, f"drift ≤ {bound:.1e}", guarantee, drift, bound)
            else:
                yield info_line(J.name, measured, "not guaranteed", guarantee.why, drift)

    def _in_frame(self, J: MomentumMap, guarantee: Guarantee) -> Guarantee:
        """Return the guarantee for J in the co-moving frame.

        The frame moves with q' = A q, A = Σ ω_i A_i, and carries J = pᵀ(A_J q + a_J) along unless
        A A_J = A_J A and A a_J = 0.
        """
        A = sum((rate * frame_map.A for rate, frame_map in self.moving), np.zeros_like(J.A))
        size = np.abs(A).max() * np.abs(J.A).max()
        if not guarantee.guaranteed or (np.abs(A @ J.A - J.A @ A).max() <= 1e-9 * size
                                        and np.abs(A @ J.a).max() <= 1e-9 * np.abs(A).max()):
            return guarantee
        return no_guarantee(f"it turns in the frame: kept to O(Δt^{self.step.order})")

    # ------------------------------------------------------------ order, quantities

    def _order(self) -> CertificateLine:
        """Return the line of the order: the slope of |y_h − y_(h/2)| over h, where it is steady."""
        quantity, derived_order = "order", self.step.order
        run = self.run
        measurement = measure_order(self.step, run.q[0], run.p[0], run.dt, self.parameters,
                                    self.round_off.sizes_of_steps)
        if measurement is None:
            return info_line(quantity, "errors are round-off", str(derived_order),
                             "fewer than three errors |y_h − y_(h/2)| stand out of it")
        if not measurement.agrees:
            slopes = ", ".join(f"{slope:.2f}" for slope in measurement.slopes)
            return info_line(
                quantity, f"slopes {slopes}", str(derived_order),
                "no two neighbours agree to 0.2: steps are too long for the order to show")
        estimate = f"{measurement.order:.2f} at Δt = {measurement.dt:.2g}"
        if self.switching.description:
            return info_line(quantity, estimate, f"{derived_order} between crossings",
                             f"steps across {self.switching.description} have a lower one",
                             measurement.order)
        if self.decay * measurement.dt > 1:
            return info_line(quantity, estimate, f"{derived_order} once λΔt is small",
                             f"dampers are stiff, λΔt = {self.decay * measurement.dt:.2g}: orders "
                             "fall to about the stage order", measurement.order)
        lacking = derived_order - measurement.order  # a run may happen to be better than its method
        guarantee = make_guarantee("|y_h − y_(h/2)| over halved steps lacks at most 0.3")
        return bound_line(quantity, estimate, f"at least {derived_order}", guarantee, lacking, 0.3)

    def _quantities(self) -> Iterator[CertificateLine]:
        """Yield for each quantity of the system its first value and its largest drift."""
        for name in self.run.quantities:
            quantity = self.run.quantity(name).astype(float)
            drift = float(np.abs(quantity - quantity[0]).max())
            yield info_line(name, f"{quantity[0]:.6g}, drift {drift:.1e}", "-", "", drift)
