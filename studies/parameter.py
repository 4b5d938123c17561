"""Figs. 11-15: the periodic error against 1/γ and 1/α.

The periodic error of a run is its error of largest size, with its sign, over 0.32 s of the fast
top. Laws checked: A + B/γ for IMS, EMS, G-L and even-stage LIIIA-B, with one zero; no influence
of α; A + B·γ for odd-stage LIIIA-B (erratum 24).

Δt is 0.001 where the paper says so or says nothing and the error stands above round-off there;
schemes of order 6 and 8 need a larger one, and 5-LIIIA-B the longer floating-point type.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..core.inertia import RepName
from ..core.real_types import RealName
from .case_runner import Case, Engine, Quantity, scheme_of
from .labels import letter
from .line_fit import FittedLine, crossing, fit_line
from .study_result import Claim, Figure, Panel, Series

__all__ = ["figure_11", "figure_12", "figure_13", "figure_14", "figure_15"]

DURATION = 0.32
#: 1/γ in 1/(kg m²): 1/γ_m = 625, 1/γ_h = 750, 1/γ̃_h = 500.
INVERSES = tuple(float(inverse) for inverse in range(100, 1201, 50))
#: 1/γ of the error-time curves of Figs. 11 and 12.
CURVES = (300.0, 500.0, 625.0, 750.0)
_TOLERANCE = 0.01

#: Zero of the error in 1/γ by erratum 25; IMS and EMS have theirs at γ = I₁, 1/γ = 500.
ZEROS = {"IMS": 500.5, "EMS": 501.4, "1-G-L": 440.0, "2-G-L": 903.0, "3-G-L": 938.0,
         "2-LIIIA-B": 550.0, "4-LIIIA-B": 917.0}


@dataclass(frozen=True)
class ParameterSweep:
    """One curve: a scheme, Δt and the quantity whose error is measured."""

    method: str
    dt: float
    rep: RepName = "gamma"
    quantity: Quantity = "H"
    real: RealName = "double"

    def case(self, inverse: float) -> Case:
        """Return the case of 1/γ or 1/α."""
        scheme, stages = scheme_of(self.method)
        return Case("fast-top", scheme, stages, self.rep, 1 / inverse, self.dt,
                    round(DURATION / self.dt), real=self.real)

    @property
    def name(self) -> str:
        """E.g. "2-G-L-γ"."""
        return f"{self.method}-{letter(self.rep)}"

    @property
    def symbol(self) -> str:
        """The symbol of the measured error."""
        return "Δl₃" if self.quantity == "l3" else "ΔH"


FIGURE_11 = ParameterSweep("IMS", 0.001)
FIGURE_12 = ParameterSweep("EMS", 0.001, quantity="l3")
FIGURE_13 = (ParameterSweep("1-G-L", 0.001), ParameterSweep("2-G-L", 0.001),
             ParameterSweep("3-G-L", 0.005),
             ParameterSweep("4-G-L", 0.005))
FIGURE_14 = (ParameterSweep("IMS", 0.001, rep="alpha"),
             ParameterSweep("EMS", 0.001, rep="alpha", quantity="l3"),
             ParameterSweep("2-G-L", 0.001, rep="alpha"),
             ParameterSweep("3-G-L", 0.005, rep="alpha"),
             ParameterSweep("4-G-L", 0.01, rep="alpha"))
FIGURE_15 = (ParameterSweep("2-LIIIA-B", 0.001), ParameterSweep("3-LIIIA-B", 0.001),
             ParameterSweep("4-LIIIA-B", 0.005),
             ParameterSweep("5-LIIIA-B", 0.004, real="long-double"))


def measure(engine: Engine, sweep: ParameterSweep) -> tuple[list[float], list[float]]:
    """Return 1/γ, or 1/α, in 1/(kg m²) and the signed periodic errors over 0.32 s."""
    inverses = engine.thin(INVERSES)
    return inverses, [engine.peak(sweep.case(inverse), sweep.quantity) for inverse in inverses]


# ---------------------------------------------------------------- figures


def figure_11(engine: Engine) -> Figure:
    """Return Fig. 11: energy error of IMS-γ over time, and its peak over 1/γ."""
    return _curves_and_line(engine, 11, "Energy error of IMS-γ", FIGURE_11)


def figure_12(engine: Engine) -> Figure:
    """Return Fig. 12: error of l₃ of EMS-γ over time, and its peak over 1/γ."""
    return _curves_and_line(engine, 12, "Error of l₃ for EMS-γ", FIGURE_12)


def figure_13(engine: Engine) -> Figure:
    """Return Fig. 13: periodic energy error of s-G-L-γ over 1/γ, s = 1..4."""
    panels, claims = [], []
    for mark, sweep in zip("abcd", FIGURE_13, strict=True):
        panel, sweep_claims = _inverse_line(engine, sweep, mark)
        panels.append(panel)
        claims += sweep_claims
    return Figure(13, "Periodic energy error of G-L-γ against 1/γ",
                  f"Fast top, {DURATION} s. The paper gives no Δt; the higher orders have a larger "
                  "one, since their error is round-off at smaller steps.", panels,
                  claims=[_law_claim(engine, "For every s the error is linear in 1/γ", FIGURE_13),
                          *claims])


def figure_14(engine: Engine) -> Figure:
    """Return Fig. 14: periodic error of IMS-α, EMS-α and G-L-α over 1/α."""
    panels, claims = [], []
    for mark, sweep in zip("abcde", FIGURE_14, strict=True):
        x, y = measure(engine, sweep)
        panels.append(_panel(sweep, mark, [Series(sweep.name, x, y, "o-")], zero=True))
        claims.append(_idle_claim(engine, sweep, y))
    return Figure(14, "Periodic error against 1/α",
                  f"Fast top, {DURATION} s. Energy error; for EMS, which conserves the energy, "
                  "the error of l₃. The higher orders have a larger Δt, since their error is "
                  "round-off at smaller steps.",
                  panels, claims=claims)


def figure_15(engine: Engine) -> Figure:
    """Return Fig. 15: periodic energy error of s-LIIIA-B-γ over 1/γ, s = 2..5.

    Erratum 24: the law is A + B/γ for even s and A + B·γ for odd s.
    """
    panels, claims = [], []
    for mark, sweep in zip("abcd", FIGURE_15, strict=True):
        law_panel = _inverse_line if follows_inverse(sweep) else _direct_line
        panel, sweep_claims = law_panel(engine, sweep, mark)
        panels.append(panel)
        claims += sweep_claims
    return Figure(15, "Periodic energy error of LIIIA-B-γ against 1/γ",
                  f"Fast top, {DURATION} s. Even s: a line in 1/γ. Odd s, called logarithmic in "
                  "the paper: a line in γ, hence a hyperbola here (erratum 24). The higher "
                  "orders have a larger Δt, and s = 5 is computed in long double, since their "
                  "error is round-off otherwise.", panels,
                  claims=[_law_claim(engine, "The error is linear in 1/γ for even s and in γ for "
                                     "odd s", FIGURE_15), *claims])


def _curves_and_line(engine: Engine, number: int, title: str, sweep: ParameterSweep) -> Figure:
    """Return the figure of the error over time for four γ, and of its peak over 1/γ."""
    curves = []
    for inverse in CURVES:
        case = sweep.case(inverse)
        curves.append(Series(f"1/γ = {inverse:g}", engine.trajectory(case).t.tolist(),
                             engine.errors(case, sweep.quantity).tolist()))
    line, claims = _inverse_line(engine, sweep, "b")
    in_time = Panel(f"(a) {sweep.symbol} of {sweep.name}", "t [s]", sweep.symbol, curves)
    return Figure(number, f"{title}, fast spinning top",
                  f"Δt = {sweep.dt:g}, N_t = {round(DURATION / sweep.dt)}. Marks: periodic errors, "
                  "signed; line: least squares.", [in_time, line], claims=claims)


def _inverse_line(engine: Engine, sweep: ParameterSweep, mark: str) -> tuple[Panel, list[Claim]]:
    """Return the panel of the periodic error with the line A + B/γ, and the claims on that law.

    The claims: the law is linear in 1/γ, and it has one zero. ``mark`` is the panel's letter.
    """
    x, y = measure(engine, sweep)
    line = fit_line(x, y)
    series = [Series(sweep.name, x, y, "o"),
              Series("A + B/γ", [x[0], x[-1]], [line.at(x[0]), line.at(x[-1])], "-")]
    return (_panel(sweep, mark, series),
            [_line_claim(f"{sweep.name}: {sweep.symbol} is linear in 1/γ", line),
             _zero_claim(engine, sweep, x, y)])


def follows_inverse(sweep: ParameterSweep) -> bool:
    """Return whether the law is A + B/γ; odd-stage LIIIA-B has A + B·γ (erratum 24)."""
    return not sweep.method.endswith("LIIIA-B") or int(sweep.method[0]) % 2 == 0


def _direct_line(engine: Engine, sweep: ParameterSweep, mark: str) -> tuple[Panel, list[Claim]]:
    """Return the panel of the periodic error with the curve A + B·γ, and the claim on that law.

    The axis is 1/γ, so that the law, a line in γ, is a hyperbola. ``mark`` is the panel's letter.
    """
    x, y = measure(engine, sweep)
    line = fit_line([1 / inverse for inverse in x], y)
    line_in_inverse = fit_line(x, y)
    series = [Series(sweep.name, x, y, "o"),
              Series("A + B·γ", x, [line.at(1 / inverse) for inverse in x], "-")]
    claim = Claim(f"{sweep.name}: {sweep.symbol} is linear in γ, not in 1/γ",
                  f"R² = {line.quality} in γ, {line_in_inverse.r_squared:.2f} in 1/γ",
                  "R² at least 0.999 in γ", line.r_squared >= 0.999)
    return _panel(sweep, mark, series), [claim]


def _panel(
    sweep: ParameterSweep, mark: str, series: list[Series], *, zero: bool = False
) -> Panel:
    """Return a panel over 1/γ or 1/α; with ``zero`` its vertical axis reaches down to 0."""
    return Panel(f"({mark}) {sweep.name}, Δt = {sweep.dt:g}", f"1/{letter(sweep.rep)} [1/(kg m²)]",
                 f"periodic {sweep.symbol}", series, zero=zero)


# ---------------------------------------------------------------- claims


def _law_claim(engine: Engine, statement: str, sweeps: tuple[ParameterSweep, ...]) -> Claim:
    """Return the claim that all sweeps have linear errors, by the least R² of the fitted lines.

    The variable is 1/γ, or γ for LIIIA-B with odd s.
    """
    lines = []
    for sweep in sweeps:
        inverses, errors = measure(engine, sweep)
        variable = inverses if follows_inverse(sweep) else [1 / inverse for inverse in inverses]
        lines.append(fit_line(variable, errors))
    worst_line = min(lines, key=lambda line: line.r_squared)
    return Claim(f"{statement}: least R² of {len(lines)}", worst_line.quality, "at least 0.999",
                 worst_line.r_squared >= 0.999)


def _line_claim(statement: str, line: FittedLine) -> Claim:
    """Return the claim that a fitted line has R² of at least 0.999."""
    return Claim(statement, f"R² = {line.quality}", "R² at least 0.999",
                 line.r_squared >= 0.999)


def _zero_claim(engine: Engine, sweep: ParameterSweep, x: list[float], y: list[float]) -> Claim:
    """Return the claim that the error y over x = 1/γ has one zero, within 1 % of ``ZEROS``.

    Only the number of zeros is claimed for schemes that are not in ``ZEROS``.
    """
    # H₀ and l₃ at the start, and with them the floor, are the same for every γ
    floor = engine.floor(sweep.case(x[0]), sweep.quantity)
    zeros = crossing(x, y, floor)
    zero_text = " and ".join(f"1/γ = {zero:.1f}" for zero in zeros) or "nowhere"
    expected = ZEROS.get(sweep.method)
    if expected is None:
        return Claim(f"{sweep.name}: the error crosses zero once", zero_text, "once",
                     len(zeros) == 1)
    holds = len(zeros) == 1 and abs(zeros[0] / expected - 1) <= _TOLERANCE
    return Claim(f"{sweep.name}: the error crosses zero once", zero_text,
                 f"once, at {expected:g} within {_TOLERANCE:.0%} (erratum 25)", holds)


def _idle_claim(engine: Engine, sweep: ParameterSweep, y: list[float]) -> Claim:
    """Return the claim that α hardly changes the periodic error y: (max − min)/|mean| ≤ 0.02."""
    change = (max(y) - min(y)) / abs(sum(y) / len(y))
    noise = engine.floor(sweep.case(INVERSES[0]), sweep.quantity) / abs(y[0])
    size = "round-off" if change <= noise else f"{change:.1e}"
    return Claim(f"{sweep.name}: α from {1 / INVERSES[-1]:.1e} to {1 / INVERSES[0]:.0e} kg m² has "
                 "nearly no influence; relative change of the periodic error", size,
                 "at most 0.02", change <= 0.02)
