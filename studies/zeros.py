"""The γ at which the periodic error of each scheme vanishes, beside γ_m and γ_h (erratum 25)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import sympy as sp

from ..generator.multibody.rigid_body import double_momentum, gravity_potential, heavy_top, moments
from ..generator.schemes.named_schemes import SchemeName
from ..runtime.rigid_body.gamma_rules import mean_inertia
from ..runtime.rigid_body.problems import fast_top
from .case_runner import Engine
from .line_fit import FittedLine, fit_line
from .odd_stages import law_growth
from .sampled_energy import energy_errors, peak, run
from .study_result import Claim, Finding, Panel, Series

__all__ = ["ErrorLine", "ZeroCase", "integrable_claim", "study"]

#: 1/γ in 1/(kg m²).
INVERSE_GAMMA = (200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0, 900.0, 1000.0, 1100.0, 1200.0)
DURATION = 0.32  # s, as in Tables 4 and 5


@dataclass(frozen=True)
class ZeroCase:
    """A scheme with its Δt and the zero that erratum 25 gives for it.

    The error is that of H; for EMS, which conserves H, the error of l₃.
    """

    scheme: SchemeName
    stages: int | None
    dt: float
    expected: float | None

    @property
    def name(self) -> str:
        """As the paper writes it."""
        return self.scheme if self.stages is None else f"{self.stages}-{self.scheme}"

    def error(self, inverse_gamma: float) -> float:
        """Return the error of largest size, with its sign, of H or l₃ over 0.32 s of the top."""
        steps = round(DURATION / self.dt)
        motion = run(self.scheme, self.stages, self.dt, steps, 1 / inverse_gamma)
        if self.scheme != "EMS":
            return peak(energy_errors(motion))
        l3 = fast_top().inertia[2] * motion.angular_velocity()[:, 2]
        return peak(l3 - l3[0])


@dataclass(frozen=True)
class ErrorLine:
    """The errors of a case over 1/γ with their straight line."""

    case: ZeroCase
    x: tuple[float, ...]
    y: tuple[float, ...]

    @cached_property
    def line(self) -> FittedLine:
        """The linear law of the paper."""
        return fit_line(self.x, self.y)

    @property
    def zero(self) -> float:
        """1/γ where the line crosses zero."""
        return -self.line.offset / self.line.slope

    def left_over(self, inverse_gamma: float) -> float:
        """Return |line(1/γ)| / |line(0)|: the part of the error that this γ does not remove."""
        return abs(self.line.at(inverse_gamma) / self.line.offset)


#: A higher order needs a larger Δt: at 0.001 s its error would be near round-off.
CASES = (
    ZeroCase("IMS", None, 0.001, 500.5),
    ZeroCase("EMS", None, 0.001, 501.4),
    ZeroCase("G-L", 1, 0.001, 440.0),
    ZeroCase("LIIIA-B", 2, 0.001, 550.0),
    ZeroCase("G-L", 2, 0.002, 903.0),
    ZeroCase("LIIIA-B", 4, 0.004, 917.0),
    ZeroCase("G-L", 3, 0.004, 938.0),
    ZeroCase("G-L", 4, 0.006, None),
)


def study(engine: Engine) -> Finding:
    """Return the finding: the linear law of every scheme's error in 1/γ, and its zero."""
    xs = INVERSE_GAMMA[::5] if engine.short else INVERSE_GAMMA
    laws = [ErrorLine(c, xs, tuple(c.error(x) for x in xs)) for c in CASES]
    inertia = fast_top().inertia
    rules = {"γ_m": 1 / mean_inertia(inertia), "γ_h": 1 / mean_inertia(inertia, "h")}
    claims = [
        *(zero_claim(law) for law in laws if law.case.expected is not None),
        integrable_claim(),
        *(exact_claim(case) for case in CASES[:2]),
        *(derived_claim(law) for law in laws if law.case.scheme == "LIIIA-B"),
        rules_claim(laws, rules),
    ]
    return Finding("zero-of-the-error", "The γ without energy error", _about(laws, rules, claims),
                   claims, [_panel(law, rules) for law in laws])


# ---------------------------------------------------------------- claims


def zero_claim(law: ErrorLine) -> Claim:
    """Return the claim that the line is straight and has its zero within 0.5 % of erratum 25's."""
    expected = law.case.expected or float("nan")
    quantity = "l₃" if law.case.scheme == "EMS" else "energy"
    r_squared = law.line.r_squared
    return Claim(
        f"{law.case.name}-γ: zero of the {quantity} error in 1/γ, Δt = {law.case.dt:g} s.",
        f"{law.zero:.1f} (R² = {r_squared:.6f})", f"{expected:g} ± 0.5 %, R² ≥ 0.999",
        abs(law.zero / expected - 1) < 0.005 and r_squared >= 0.999,
    )


def integrable_claim(gamma: sp.Expr = moments[0]) -> Claim:
    """Return the claim H = |p|²/(8I₁) + V(q) + ½ l₃²(1/I₃ − 1/I₁) for I₂ = I₁ = γ.

    An identity in q and p, with l₃ = ½ (L(q)p)₃; ``gamma`` replaces I₁, and the claim is then
    false.
    """
    system = heavy_top("gamma")
    q, p, (I1, I2, I3) = system.q, system.p, moments
    l3 = double_momentum(q, p)[2] / 2
    quadratic = sum(x**2 for x in p) / (8 * I1) + gravity_potential(q)
    H = system.H.subs({system.parameters[-1]: gamma}).subs({I2: I1})
    remainder = sp.expand(H - quadratic - l3**2 * (1 / I3 - 1 / I1) / 2)
    return Claim(
        "For I₁ = I₂ = γ the γ-type energy is |p|²/(8I₁) + V(q) + ½ l₃²(1/I₃ − 1/I₁).",
        "identical" if remainder == 0 else "different", "identical", remainder == 0, "proved",
    )


def exact_claim(case: ZeroCase) -> Claim:
    """Return the claim that the error at γ = I₁ is below 1e-5 of the error at γ = I₁/1.2."""
    I1 = fast_top().inertia[0]
    size, beside = abs(case.error(1 / I1)), abs(case.error(1.2 / I1))
    return Claim(
        f"{case.name}-γ at γ = I₁ = γ̃_h: largest error over that at γ = I₁/1.2.",
        f"{size / beside:.1e}", "< 1e-5 (round-off)", size < 1e-5 * beside,
    )


def derived_claim(law: ErrorLine) -> Claim:
    """Return the claim that the measured zero of LIIIA-B is the derived 1/γ = −ΔA_s/ΔC_s.

    ΔA and ΔC are the growth of A and C of the modified energy to the turning point of the
    nutation, where the error has its maximum. The derivation holds for h → 0.
    """
    s = law.case.stages or 0
    _, growth = law_growth(s)
    derived = -float(growth.A) / float(growth.C)
    return Claim(
        f"{law.case.name}: the zero derived in odd-stages, 1/γ = −ΔA_{s}/ΔC_{s} (Δt → 0), against "
        "the measured one.",
        f"{derived:.1f} against {law.zero:.1f}", "within 0.5 %",
        abs(law.zero / derived - 1) < 0.005,
    )


def rules_claim(laws: list[ErrorLine], rules: dict[str, float]) -> Claim:
    """Return the claim that γ_m and γ_h leave between 0.05 and 0.95 of every scheme's error.

    ``rules``: "γ_m" and "γ_h" → 1/γ.
    """
    left_over = {name: [law.left_over(x) for law in laws] for name, x in rules.items()}
    text = "; ".join(f"{name}: {min(v):.2f} to {max(v):.2f}" for name, v in left_over.items())
    return Claim(
        "Error at γ_m and γ_h over the error without the γ term (1/γ = 0).", text,
        "between 0.05 and 0.95: better, not optimal",
        all(0.05 < value < 0.95 for values in left_over.values() for value in values),
    )


# ---------------------------------------------------------------- text and panels


def _about(laws: list[ErrorLine], rules: dict[str, float], claims: list[Claim]) -> str:
    """Return the text of the finding, with fitted zeros, 1/γ of the rules, and measured errors."""
    zeros = ", ".join(f"{law.case.name} {law.zero:.1f}" for law in laws)
    marks = " and ".join(f"{x:.0f} (1/{name})" for name, x in rules.items())
    exact = ", ".join(c.statement.split("-γ")[0] + " " + c.found
                      for c in claims if c.statement.startswith(("IMS-γ at", "EMS-γ at")))
    I1 = fast_top().inertia[0]
    return f"""The periodic error of the fast top is linear in 1/γ for IMS, EMS, G-L and \
even-stage LIIIA-B, and therefore has a zero. Fitted straight lines have it at 1/γ = {zeros}; the \
paper's recommendations are {marks}. These are reasonable, not optimal: the remaining fraction of \
the error without the γ term is {claims[-1].found}. The best γ depends on the scheme and, by the \
derivation for LIIIA-B, on the motion; no mean of the moments alone is best for all.

For IMS and EMS the zero is exactly γ = I₁ (1/γ = {1 / I1:g}), which is γ̃_h of a symmetric top; \
the law is linear up to O(h²) only, which explains the deviation of the fitted line. With I₁ = I₂ \
= γ the energy is a quadratic form of the state plus a function of l₃. Both are quadratic \
invariants of the motion, which the midpoint rule of IMS conserves; hence IMS conserves H exactly. \
The discrete gradient of EMS is then the gradient at the midpoint except for the mean of l₃, and \
EMS conserves l₃. Remaining error at γ = I₁ relative to γ = I₁/1.2: {exact}.

EMS conserves H by construction; its error here is the error of l₃."""


def _panel(law: ErrorLine, rules: dict[str, float]) -> Panel:
    """Return the panel of the errors of a scheme over 1/γ, with its line and the rules' marks."""
    x = list(law.x)
    quantity = "l₃ error in kg m²/s" if law.case.scheme == "EMS" else "energy error in J"
    marks = [Series(f"1/{name}", [position, position], [min(law.y), max(law.y)], "--")
             for name, position in rules.items()]
    return Panel(
        f"{law.case.name}-γ, Δt = {law.case.dt:g} s, zero at {law.zero:.1f}",
        "1/γ in 1/(kg m²)", quantity,
        [Series("compiled", x, list(law.y), "o"),
         Series("line", x, [float(v) for v in np.vectorize(law.line.at)(x)], "-"), *marks],
    )
