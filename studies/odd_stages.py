"""Why LIIIA-B errs with 1/γ for even s and with γ for odd s (erratum 24, open in the paper).

The proofs are in ``odd_proof``, the formulas in ``energy_law``; here the law is held against
compiled steppers: the fast top, at the turning point of its nutation where the periodic energy
error peaks, and half way to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from ..core.real_types import RealName
from ..runtime.rigid_body.gamma_rules import mean_inertia
from ..runtime.rigid_body.problems import fast_top
from .case_runner import Engine
from .energy_law import Law, energy_law, node_numbers
from .line_fit import FittedLine, fit_line
from .odd_proof import (
    gamma_claim,
    identities_claim,
    parity_claim,
    step_claim_rational,
    step_claim_symbolic,
    variational_claim,
)
from .sampled_energy import energy_errors, run, top_along
from .study_result import Claim, Finding, Panel, Series

__all__ = ["GammaSweep", "law_growth", "limit", "study", "sweep", "turning_time"]

#: 1/γ in 1/(kg m²); 1/γ_m = 625.
INVERSE_GAMMA = (100.0, 150.0, 200.0, 300.0, 400.0, 600.0, 900.0, 1500.0)
#: For each s, how many steps lead to the turning point of the nutation: even numbers. With 72 steps
#: the part of H with γ changes by 3e-13 J for s = 4, by 3e-20 J for s = 5: lost in rounding.
STEPS = {2: (72, 36, 18), 3: (144, 72, 36), 4: (36, 24, 18), 5: (24, 20, 16)}


@dataclass(frozen=True)
class GammaSweep:
    """Energy errors of s-LIIIA-B with one Δt at one time, for all γ, and the derived law there.

    Odd s takes ``long double`` steppers: the part with γ is near the round-off of double.
    """

    stages: int
    dt: float
    gammas: tuple[float, ...]
    errors: tuple[float, ...]
    law: Law  # growth of A, B, C, X and Y from the start to that time

    @property
    def even(self) -> bool:
        """Whether 1/γ is the variable of the law."""
        return self.stages % 2 == 0

    @property
    def variable(self) -> list[float]:
        """1/γ for even s, γ for odd s."""
        return [1 / g if self.even else g for g in self.gammas]

    @cached_property
    def line(self) -> FittedLine:
        """The straight line through the errors."""
        return fit_line(self.variable, self.errors)

    @cached_property
    def wrong_line(self) -> FittedLine:
        """The line in the other variable."""
        return fit_line([1 / x for x in self.variable], self.errors)

    @property
    def derived_slope(self) -> float:
        """−h^{2s−2} ΔC for even s, −h^{2s} ΔB for odd s."""
        power, growth = (2 * self.stages - 2, self.law.C) if self.even else (
            2 * self.stages, self.law.B)
        return -(self.dt**power) * float(growth)

    @property
    def ratio(self) -> float:
        """Measured slope over derived slope."""
        return self.line.slope / self.derived_slope

    @cached_property
    def hidden_ratio(self) -> float:
        """For odd s: the measured coefficient of 1/γ over the derived −h^{2s−2} ΔC.

        The errors are fitted by a + bγ + cγ² + d/γ; d is the coefficient.
        """
        g = np.array(self.gammas)
        columns = np.stack([np.ones_like(g), g, g**2, 1 / g], axis=1)
        # γ is about 1e-3 and 1/γ about 1e3: columns of size 1 keep the least squares well posed
        scale = np.abs(columns).max(axis=0)
        fit = np.linalg.lstsq(columns / scale, np.array(self.errors), rcond=None)[0] / scale
        return float(fit[3]) / (-(self.dt ** (2 * self.stages - 2)) * float(self.law.C))


@cache
def turning_time() -> float:
    """Return the first t > 0 with V̇ = 0, half a period of the nutation, by secants."""
    times = [0.072, 0.073]  # about the first turning point of the fast top
    rates = [_potential_rate(t) for t in times]
    while abs(times[-1] - times[-2]) > 1e-13:
        slope = (rates[-1] - rates[-2]) / (times[-1] - times[-2])
        times.append(times[-1] - rates[-1] / slope)
        rates.append(_potential_rate(times[-1]))
    return times[-1]


def _potential_rate(t: float) -> float:
    """Return V̇ = mgl Γ̇₃ of the fast top at time t in s, by 4-stage Gauss-Lobatto in 72 steps."""
    gamma = mean_inertia(fast_top().inertia)
    top = top_along(run("G-L", 4, dt=t / 72, steps=72, parameter=gamma))
    return float(top.mgl * top.rates()[1][2][-1])


def sweep(s: int, steps: int) -> tuple[GammaSweep, GammaSweep]:
    """Return the energy errors for each γ, half way to the turning point and at it.

    ``steps`` of s-LIIIA-B lead to the turning point of the nutation; the number is even.
    """
    dt = turning_time() / steps
    gammas = tuple(1 / x for x in INVERSE_GAMMA)
    # for odd s the slope is two orders smaller, and doubles would round it away
    real: RealName = "long-double" if s % 2 else "double"
    runs = [run("LIIIA-B", s, dt, steps, g, real=real) for g in gammas]
    errors = [energy_errors(r) for r in runs]
    errors_half_way, errors_at_peak = (tuple(float(e[row]) for e in errors)
                                       for row in (steps // 2, steps))
    law_half_way, law_at_peak = law_growth(s)
    return (GammaSweep(s, dt, gammas, errors_half_way, law_half_way),
            GammaSweep(s, dt, gammas, errors_at_peak, law_at_peak))


@cache
def law_growth(s: int) -> tuple[Law, Law]:
    """Return the growth of A, B, C, X and Y along the exact motion since the start.

    First at half the time of the turning point, then at the turning point. The exact motion is
    4-stage Gauss-Lobatto in 72 steps, whose error is round-off.
    """
    gamma = mean_inertia(fast_top().inertia)
    motion = run("G-L", 4, dt=turning_time() / 72, steps=72, parameter=gamma)
    law = energy_law(s, top_along(motion, rows=[0, 36, 72]))
    terms = (law.A, law.B, law.C, law.X, law.Y)
    middle, peak = (Law(*(term[k] - term[0] for term in terms)) for k in (1, 2))
    return middle, peak


def study(engine: Engine) -> Finding:
    """Prove the law of the dependence on γ, and measure it.

    A short study proves the term in γ of s = 3 at numbers in place of symbols.
    """
    sweeps = {s: [sweep(s, n) for n in steps] for s, steps in STEPS.items()}
    proofs = [
        variational_claim(range(2, 9)),
        step_claim_symbolic(2),
        step_claim_rational(3) if engine.short else step_claim_symbolic(3),
        gamma_claim((2, 3)),
        identities_claim(),
        parity_claim((2, 3, 4) if engine.short else (2, 3, 4, 5)),
    ]
    at_peak = {s: [peak for _, peak in pairs] for s, pairs in sweeps.items()}
    measurements = [claim for s in at_peak for claim in slope_claims(s, at_peak[s])]
    hidden = hidden_claim([middle for middle, _ in sweeps[3]])
    return Finding(
        "odd-stages", "LIIIA-B: why odd s has no 1/γ", _about(at_peak, hidden),
        [*proofs, *measurements, hidden], _panels(at_peak),
    )


# ---------------------------------------------------------------- measured against derived


def limit(sweeps: Sequence[GammaSweep], ratios: Sequence[float]) -> float:
    """Return the ratio for h → 0, from the polynomial in h² through all ratios."""
    squares = [sweep.dt**2 for sweep in sweeps]
    return float(np.polyfit(squares, ratios, len(squares) - 1)[-1])


def slope_claims(s: int, sweeps: Sequence[GammaSweep]) -> list[Claim]:
    """Return three claims on the energy error as a function of 1/γ, or of γ for odd s.

    It is a straight line; the slope is O(h^(2s−2)) in 1/γ and O(h^(2s)) in γ; the slope tends to
    the derived one for h → 0. The first of ``sweeps`` has the smallest step.
    """
    first = sweeps[0]
    variable, power = ("1/γ", 2 * s - 2) if first.even else ("γ", 2 * s)
    # slope ~ h^order: a straight line in logarithms
    log_steps = np.log([x.dt for x in sweeps]).tolist()
    log_slopes = np.log([abs(x.line.slope) for x in sweeps]).tolist()
    order = fit_line(log_steps, log_slopes).slope
    ratio_limit = limit(sweeps, [x.ratio for x in sweeps])
    r_squared, wrong_r_squared = first.line.r_squared, first.wrong_line.r_squared
    ratios = ", ".join(f"{x.ratio:.4f}" for x in sweeps)
    steps = ", ".join(f"{x.dt:.4g}" for x in sweeps)
    return [
        Claim(f"{s}-LIIIA-B: the energy error is linear in {variable} (Δt = {first.dt:.4g} s).",
              f"R² = {r_squared:.7f} (in {'γ' if first.even else '1/γ'}: {wrong_r_squared:.3f})",
              "R² ≥ 0.999", r_squared >= 0.999),
        Claim(f"{s}-LIIIA-B: the slope in {variable} is O(h^{power}).",
              f"h^{order:.2f}", f"h^{power} ± 0.2", abs(order - power) < 0.2),
        Claim(f"{s}-LIIIA-B: measured over derived slope, Δt = {steps}, tends to 1.",
              f"{ratios} → {ratio_limit:.4f}", "limit 1 ± 0.01", abs(ratio_limit - 1) < 0.01),
    ]


def hidden_claim(middles: Sequence[GammaSweep]) -> Claim:
    """Return the claim that the coefficient of 1/γ for s = 3 is −h⁴ΔV̇²/256, half way.

    Between the turning points V̇ is not zero; the ratio of measured and derived tends to 1.
    """
    ratios = [x.hidden_ratio for x in middles]
    steps = ", ".join(f"{x.dt:.4g}" for x in middles)
    ratio_limit = limit(middles, ratios)
    return Claim(
        "3-LIIIA-B between the turning points: the coefficient of 1/γ is −h⁴ΔV̇²/256; measured over "
        f"derived at t = {turning_time() / 2:.4g} s, Δt = {steps}.",
        f"{', '.join(f'{r:.4f}' for r in ratios)} → {ratio_limit:.4f}", "limit 1 ± 0.02",
        abs(ratio_limit - 1) < 0.02,
    )


def _about(at_peak: dict[int, list[GammaSweep]], hidden: Claim) -> str:
    """Return the text of the finding, a paragraph for each step of the derivation.

    ``at_peak`` has the sweeps of each s, the smallest step first; ``hidden`` is the claim on the
    1/γ term of s = 3.
    """
    finest = {s: sweeps[0] for s, sweeps in at_peak.items()}
    return "\n\n".join([_QUESTION, _RADIAL_VELOCITY, _modified_energy(finest), _PARITY,
                        _effect_of_gamma(finest[3], hidden), _verification(finest)])


_QUESTION = """The paper finds errors linear in 1/γ for 2- and 4-LIIIA-B, other curves for 3- and \
5-LIIIA-B, and leaves the reason open. The reason is a parity."""

_RADIAL_VELOCITY = """\
Dependence on γ. LIIIA-B is the variational method of L_d = ext h Σ b_i L(Q_i, Q̇_i) with |Q_i| = \
1, Q of degree s and L = T + 2γρ² − V, where ρ_i = Q_i·Q̇_i is the radial velocity. The exact \
motion has ρ = 0. Q(t) lies on the sphere at the nodes only, so ρ_i is not 0, and by the envelope \
theorem ∂L_d/∂γ = 2h Σ b_i ρ_i² is the only effect of γ.

Radial velocity. Let M(t) = Π(t − c_i h). Since Q lies on the sphere at the s nodes, ρ_i = M′(c_i \
h)·(d − X(c_i h − h/2) + …) with one free number d. The momenta determine d: the P_i lie on a \
polynomial of degree s − 2, Σ_i b_i M′(c_i) P_i = 0, and Q_i·P_i = 4γρ_i, which gives d = −Y/(4γs) \
+ O(h²). Here Y_s = q·p^(s−1)/(s−1)! and X_s = q·q^(s+1)/(s+1)! + q̇ᵀH_pp p^(s−1)/s! along the \
exact motion."""

_PARITY = """\
Parity. Under time reversal Y has the sign (−1)^s and X the sign (−1)^(s+1). For even s, Y is an \
even function such as the kinetic energy, and 1/γ enters at the leading order h^(2s−2). For odd s, \
Y is odd, as V̇ is: it vanishes at the turning points of the nutation, where the periodic error \
has its maximum, and in every steady precession of a symmetric top. The terms with 1/γ of order \
h^(2s) come from d² and contain Y as a factor too. At these points the remainder is A + Bγ with B \
= O(h^(2s)), two orders above the order of the method: the curves of the paper are straight lines \
in γ. For even s X vanishes there."""


def _modified_energy(finest: dict[int, GammaSweep]) -> str:
    """Return the formulas of H̃, with μ, ς and ε of s = 2 and 3, and with the fast top's numbers."""
    two, three = node_numbers(2), node_numbers(3)
    # the growth of H along a run is the opposite of the growth of H̃ − H, as H̃ is conserved
    a2, c2 = -float(finest[2].law.A), -float(finest[2].law.C)
    a3, b3 = -float(finest[3].law.A), -float(finest[3].law.B)
    return f"""\
Modified energy. Because b_i M′(c_i)² = μ is the same for all i, the two parts of ρ do not mix. \
Integration over γ gives the energy that the method conserves: H̃ = H + h^(2s−2)(A_s + C_s/γ) + \
h^(2s)(B_s γ + terms without γ and in 1/γ), C_s = μY²/(8s), B_s = −2μςX², ς = Σ(c_i − ½)². For s = \
2, μ = {two.mu} and ς = {two.spread}: C_2 = T²/8. For s = 3, μ = {three.mu} and ς = \
{three.spread}: C_3 = V̇²/256. A_s does not depend on γ: A_s = μ/(8s) Σ_i (y_i)²/I_i + μ Σ_k \
p^(s−1−k)·q^(s+k)/((s−1−k)!(s+k)!) − ε [t^(2s−2)] q̇·p, with y_i the body components of \
p^(s−1)/(s−1)!, k = 1..s−1 and ε = Σ b_i c_i^(2s−2) − 1/(2s−1), {two.quadrature} and \
{three.quadrature}. From the initial state of the fast top to its turning point the energy error \
is then ΔH = h²({a2:.5g} {c2:+.5g}/γ) for s = 2 and ΔH = {a3:.5g}h⁴ {b3:+.4g}γh⁶ for s = 3 (SI)."""


def _effect_of_gamma(three: GammaSweep, hidden: Claim) -> str:
    """Return whether a γ can cancel the error; ``three`` is the sweep of s = 3 at its peak.

    ``hidden`` is the claim on the 1/γ term that vanishes at the turning points.
    h⁴ ΔA + h⁶ γ ΔB = 0 at γ = −ΔA/(h² ΔB).
    """
    cancelling = -float(three.law.A) / (three.dt**2 * float(three.law.B))
    return f"""\
For odd s the choice of γ therefore has little effect: A would be cancelled at γ = −ΔA_3/(h²ΔB_3) \
= {cancelling:.3g} kg m² for Δt = {three.dt:.3g} s, far from any moment of inertia. For even s \
it is cancelled at 1/γ = −ΔA_s/ΔC_s, to leading order for any Δt. For s = 3 the 1/γ term exists \
between the turning points, where its coefficient is −h⁴ΔV̇²/256 (ratio of measured and derived \
coefficient: {hidden.found})."""


def _verification(finest: dict[int, GammaSweep]) -> str:
    """Return how the law was verified, with the measured and the derived slope of each s."""
    slopes = "; ".join(
        f"s = {s}: {x.line.slope:.4g} measured, {x.derived_slope:.4g} derived (Δt = {x.dt:.4g} s)"
        for s, x in finest.items()
    )
    return f"""\
Verification. The energy error of one step was expanded in h by SymPy's polynomial rings, \
independently of the argument above, and compared with −d/dt of the modified energy: as \
polynomials in the state for the leading coefficients, in rational arithmetic with symbolic γ for \
the first term in γ. Compiled steppers (long double for odd s) gave, at t = {turning_time():.4g} s \
of the fast top, the slopes {slopes}."""


def _panels(at_peak: dict[int, list[GammaSweep]]) -> list[Panel]:
    """Return a panel of errors for each s, and one of the ratios of slopes over the step."""
    panels = []
    for s, sweeps in at_peak.items():
        # differences from the last γ: lines through 0, of which only the slope is compared
        finest = sweeps[0]
        origin = finest.variable[-1]
        measured = [e - finest.errors[-1] for e in finest.errors]
        derived = [finest.derived_slope * (x - origin) for x in finest.variable]
        name, unit = ("1/γ", "1/(kg m²)") if finest.even else ("γ", "kg m²")
        panels.append(Panel(
            f"{s}-LIIIA-B, Δt = {finest.dt:.4g} s", f"{name} in {unit}",
            f"ΔH − ΔH(γ = 1/{INVERSE_GAMMA[-1]:g}) in J",
            [Series("measured", finest.variable, measured, "o"),
             Series("derived", finest.variable, derived, "-")],
        ))
    panels.append(Panel(
        "measured over derived slope", "Δt in s", "ratio",
        [Series(f"s = {s}", [x.dt for x in sweeps], [x.ratio for x in sweeps], "o-")
         for s, sweeps in at_peak.items()], xscale="log",
    ))
    return panels
