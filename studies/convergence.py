"""Figs. 10 and 16: the periodic relative error against Δt, and the order it shows.

    max_k |ΔH_k| / |H₀| over 0.32 s of the fast top; for EMS, which keeps H, max_k |Δl₃,k| / |l₃,₀|

The slope is fitted to log-log points that stand ten times above their round-off floor. The orders
6 and 8 of 4- and 5-LIIIA-B run in long double, the same generated C, so that enough points do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..core.inertia import RepName
from ..core.real_types import RealName
from .case_runner import Case, Engine, Quantity, scheme_of
from .labels import PARAMETERS, letter
from .line_fit import fit_slope
from .study_result import Claim, Figure, Panel, Series

__all__ = ["figure_10", "figure_16"]

DURATION = 0.32
STEPS = (0.0005, 0.001, 0.002, 0.0025, 0.004, 0.005, 0.008)
_TOLERANCE = 0.15


@dataclass(frozen=True)
class ConvergenceStudy:
    """One curve: a scheme with its expected order."""

    method: str
    order: int
    rep: RepName = "gamma"
    parameter: str = "m"
    real: RealName = "double"
    style: str = "o-"

    @property
    def quantity(self) -> Quantity:
        """The measured quantity: l₃ for EMS, which conserves H, otherwise H."""
        return "l3" if self.method == "EMS" else "H"

    @property
    def name(self) -> str:
        """E.g. "IMS-γ, γ_m"."""
        return f"{self.method}-{letter(self.rep)}, {PARAMETERS[self.parameter]}"

    def case(self, dt: float) -> Case:
        """Return the case of one step size."""
        scheme, stages = scheme_of(self.method)
        return Case("fast-top", scheme, stages, self.rep, self.parameter, dt,
                    round(DURATION / dt), real=self.real)


STYLES: tuple[tuple[RepName, str], ...] = (("gamma", "o-"), ("alpha", "x--"))
FIGURE_10 = tuple(
    ConvergenceStudy(method, order, rep, style=style)
    for method, order in (("IMS", 2), ("EMS", 2), ("3-LIIIA-B", 4), ("2-G-L", 4))
    for rep, style in STYLES
)
FIGURE_16 = {
    stages: tuple(
        ConvergenceStudy(f"{stages}-LIIIA-B", 2 * stages - 2, parameter=rule, style=style,
                         real="long-double" if stages > 3 else "double")
        for rule, style in (("m", "o-"), ("h", "s--"), ("100m", "x:"))
    )
    for stages in (2, 3, 4, 5)
}


class PeriodicErrors(NamedTuple):
    """Periodic errors: the error of largest size over 0.32 s, relative to |H₀| or |l₃,₀|."""

    dt: list[float]  # s, one entry for each of ``STEPS``, as the next two
    errors: list[float]
    floors: list[float]  # round-off of the errors


def measure(engine: Engine, study: ConvergenceStudy) -> PeriodicErrors:
    """Return the periodic errors of a scheme for each Δt."""
    errors, floors = [], []
    for dt in STEPS:
        case = study.case(dt)
        size = engine.size(case, study.quantity)
        errors.append(abs(engine.peak(case, study.quantity)) / size)
        floors.append(engine.floor(case, study.quantity) / size)
    return PeriodicErrors(list(STEPS), errors, floors)


def figure_10(engine: Engine) -> Figure:
    """Return Fig. 10: periodic error against Δt, schemes of order 2 and 4, γ- and α-type."""
    panel = _panel(engine, "IMS, EMS, 3-LIIIA-B, 2-G-L", FIGURE_10)
    claims = [_orders_claim(engine, FIGURE_10),
              *(_slope_claim(engine, study) for study in FIGURE_10)]
    return Figure(10, "Convergence, fast top: relative periodic error against Δt",
                  f"Largest |ΔH|/|H₀| over {DURATION} s, for EMS |Δl₃|/|l₃|, since EMS conserves "
                  "H; γ = γ_m, α = γ_m.", [panel], columns=1, claims=claims)


def figure_16(engine: Engine) -> Figure:
    """Return Fig. 16: periodic error against Δt, s-LIIIA-B with s = 2..5, three values of γ."""
    panels, claims = [], [_orders_claim(engine, [study[0] for study in FIGURE_16.values()])]
    for mark, (stages, studies) in zip("abcd", FIGURE_16.items(), strict=True):
        panels.append(_panel(engine, f"({mark}) {stages}-LIIIA-B-γ", studies))
        claims.append(_slope_claim(engine, studies[0]))
    claims += [_influence_claim(engine, stages) for stages in FIGURE_16]
    return Figure(16, "Convergence of LIIIA-B, fast top: relative periodic error against Δt",
                  f"Largest |ΔH|/|H₀| over {DURATION} s; s = 4, 5 in long double.", panels,
                  claims=claims)


def _panel(engine: Engine, title: str, studies: tuple[ConvergenceStudy, ...]) -> Panel:
    """Return the panel of the relative periodic errors over Δt, a series for each study.

    See ``PeriodicErrors``.
    """
    series = []
    for study in studies:
        dt, errors, _ = measure(engine, study)
        series.append(Series(study.name, dt, errors, study.style))
    return Panel(title, "Δt [s]", "relative periodic error", series, "log", "log")


def _orders_claim(engine: Engine, studies: Sequence[ConvergenceStudy]) -> Claim:
    """Return the claim that every slope of a figure is the scheme's order, within ± 0.15."""
    slopes: dict[int, list[float]] = {}  # order → slopes
    for study in studies:
        slope, *_ = fit_slope(*measure(engine, study))
        slopes.setdefault(study.order, []).append(slope)
    slope_ranges = ", ".join(_range(values) for values in slopes.values())
    return Claim("The schemes converge with their order: slopes in the log-log plot", slope_ranges,
                 f"{', '.join(str(order) for order in slopes)}, each ± {_TOLERANCE}",
                 all(abs(slope - order) <= _TOLERANCE
                     for order, values in slopes.items() for slope in values))


def _range(values: Sequence[float]) -> str:
    """Return e.g. "1.99 to 2.01", or one number if both ends have the same two decimals."""
    low, high = f"{min(values):.2f}", f"{max(values):.2f}"
    return low if low == high else f"{low} to {high}"


def _slope_claim(engine: Engine, study: ConvergenceStudy) -> Claim:
    """Return the claim that one curve has the slope of its order, within ± 0.15."""
    slope, point_count = fit_slope(*measure(engine, study))
    return Claim(f"{study.name}: slope in the log-log plot ({point_count} points)", f"{slope:.2f}",
                 f"{study.order} ± {_TOLERANCE}", abs(slope - study.order) <= _TOLERANCE)


def _influence_claim(engine: Engine, stages: int) -> Claim:
    """Return the claim that γ matters for Δt → 0 if s is even, and not if s is odd.

    The influence of γ is |e(100γ_m)/e(γ_m) − 1| with the periodic errors e; it is compared at the
    smallest and the largest Δt whose errors are ten times their round-off floor.
    """
    with_mean, _, with_100_means = FIGURE_16[stages]
    dt, errors, floors = measure(engine, with_mean)
    errors_of_100 = measure(engine, with_100_means).errors
    influences = [(h, abs(b / a - 1))
                  for h, a, b, floor in zip(dt, errors, errors_of_100, floors, strict=True)
                  if min(a, b) > 10 * floor]
    # steps are sorted from the smallest to the largest
    (small, fine), (large, coarse) = influences[0], influences[-1]
    even = stages % 2 == 0
    return Claim(
        f"s = {stages}: the influence of γ {'stays' if even else 'dies out'} as Δt shrinks; "
        "|e(100γ_m)/e(γ_m) − 1|", f"{coarse:.2f} at Δt = {large:g}, {fine:.2g} at Δt = {small:g}",
        "at least half of it left" if even else "less than half of it left",
        (fine >= coarse / 2) == even,
    )
