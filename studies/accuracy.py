"""Tables 4-7 and Figs. 8, 9: how accurate energy and axis are, (87) and (88).

    Tables 4, 5   fast top           Δt = 0.001  N_t = 320
    Table 6       cone, r = h/2      Δt = 0.005  N_t = 80
    Table 7       cone, r = 3h/2     Δt = 0.01   N_t = 80

The cones precess at 30 rad/s, not the printed 10, with the printed mass (erratum 18).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..core.arguments import choose
from ..core.inertia import REPS
from ..runtime.rigid_body.exact import RegularPrecession
from .case_runner import Case, Engine, Quantity, scheme_of
from .labels import NORMS, row_name
from .printed import COLUMNS, MISPRINTS, TABLE_4, TABLE_6, TABLE_7
from .study_result import Cell, Claim, Figure, Panel, Series, Table
from .verdict import ROUND_OFF, compare_value, same_digits

__all__ = ["figure_8", "figure_9", "table_4", "table_5", "table_6", "table_7"]

_NORMS_USED = (
    "E[|ΔH|]: mean of |H(q_k, p_k) − H₀| in joules, with the scheme's own H. E[|Δx|], E[|Δz|]: "
    "mean error of the unit axis (R13, R33)"
)
_TOP_ABOUT = f"{_NORMS_USED} against 8-stage Gauss-Lobatto."
_CONE_ABOUT = f"{_NORMS_USED} against the exact precession."


@dataclass(frozen=True)
class Setting:
    """The arguments common to all cells of a table."""

    problem: str
    dt: float
    steps: int
    settings: tuple[tuple[str, float], ...] = ()

    def __str__(self) -> str:
        return f"Δt = {self.dt:g}, N_t = {self.steps}"

    def case(self, method: str, rep: str, parameter: float | str) -> Case:
        """Return the case of one cell."""
        scheme, stages = scheme_of(method)
        kind = choose("representation", rep, REPS)
        return Case(self.problem, scheme, stages, kind, parameter, self.dt, self.steps,
                    self.settings)


TOP = Setting("fast-top", 0.001, 320)
SLIM_CONE = Setting("regular-precession", 0.005, 80)
WIDE_CONE = Setting("regular-precession", 0.01, 80, (("radius_ratio", 1.5),))

#: The rows of Table 5, whose numbers our copy of the paper lost.
TABLE_5: tuple[tuple[Quantity, str], ...] = tuple(
    (quantity, rule) for quantity in ("H", "z", "x") for rule in ("m", "h", "100m")
)


def table_4(engine: Engine) -> Table:
    """Return Table 4: mean errors of H and of the axis of the fast top, γ-type."""
    return Table(
        4, "Fast spinning top: accuracy of the γ-type",
        f"{TOP}. {_TOP_ABOUT}",
        _cells(engine, 4, TOP, TABLE_4),
    )


def table_5(engine: Engine) -> Table:
    """Return Table 5: mean errors of H and of the axis of the fast top, α-type.

    Our copy of the paper lost the printed numbers, so that the conclusions of its text are checked.
    """
    cells = [
        _cell_without_print(engine, TOP.case(method, "alpha", rule), quantity, rule)
        for quantity, rule in TABLE_5 for method in COLUMNS
    ]
    return Table(
        5, "Fast spinning top: accuracy of the α-type",
        f"{TOP}. {_TOP_ABOUT} Our copy of the paper lacks the printed numbers; the conclusions of "
        "its text are checked instead.",
        cells,
        [_alpha_is_idle(engine), _gamma_is_better(engine), _lobatto_types_agree(engine)],
    )


def table_6(engine: Engine) -> Table:
    """Return Table 6: mean errors of H and of the axis, regular precession of a cone, r = h/2."""
    return Table(
        6, "Regular precession: accuracy, r = h/2",
        _cone_about(engine, SLIM_CONE),
        _cells(engine, 6, SLIM_CONE, TABLE_6),
        [_corrected_mean_is_better(engine), _nutation_is_exact(engine)],
    )


def table_7(engine: Engine) -> Table:
    """Return Table 7: mean errors of H and of the axis, regular precession of a cone, r = 3h/2."""
    return Table(
        7, "Regular precession: accuracy, r = 3h/2",
        _cone_about(engine, WIDE_CONE),
        _cells(engine, 7, WIDE_CONE, TABLE_7),
        [_wide_cone_suits_harmonic_mean(engine)],
    )


def _cone_about(engine: Engine, setting: Setting) -> str:
    """Return the text above a table of the cone: Δt, N_t, precession rate, mass and norms.

    Erratum 18: the paper prints φ̇ = 10 rad/s and computed with 30, and with the printed mass
    m = ρπ²h/3 instead of the cone's ρπr²h/3.
    """
    # scheme and γ do not matter: the exact motion belongs to the problem
    precession = engine.problem(setting.case("IMS", "gamma", "m")).exact
    assert isinstance(precession, RegularPrecession)
    return (f"{setting}, φ̇ = {precession.rate:g} rad/s and m = ρπ²h/3 as actually used in the "
            f"paper (erratum 18). {_CONE_ABOUT}")


def _cell_without_print(engine: Engine, case: Case, quantity: Quantity, rule: str) -> Cell:
    """Return our mean error of a case as a cell without a printed number, which our copy lost.

    ``rule`` names the value of γ or α in the row; the note says "round-off" below the floor.
    """
    ours = engine.mean(case, quantity)
    note = ROUND_OFF if ours <= engine.floor(case, quantity) else ""
    return compare_value(row_name(quantity, case.rep, rule), case.method, ours, printed=None,
                         reason=note)


def _cells(
    engine: Engine, table: int, setting: Setting,
    printed: dict[tuple[Quantity, str, str], tuple[str, ...]],
) -> list[Cell]:
    """Return the cells of a table: our means beside the printed ones, in the columns of methods.

    ``printed``: (quantity, representation, rule of γ or α) → the printed numbers of the four
    methods ``COLUMNS``, as text.
    """
    cells = []
    for (quantity, rep, rule), numbers in printed.items():
        for method, number in zip(COLUMNS, numbers, strict=True):
            case = setting.case(method, rep, rule)
            ours, floor = engine.mean(case, quantity), engine.floor(case, quantity)
            misprint = MISPRINTS.get((table, quantity, rule, method))
            cell = compare_value(row_name(quantity, rep, rule), method, ours, number, floor,
                                 misprint)
            # the reason costs two more runs, and only a difference needs one
            if cell.verdict == "differs":
                cell = compare_value(cell.row, method, ours, number, floor, misprint,
                                     _sensitivity(engine, case, quantity, ours, number))
            cells.append(cell)
    return cells


def _sensitivity(
    engine: Engine, case: Case, quantity: Quantity, ours: float, printed: str
) -> str:
    """Return why our mean E and the printed one differ, if a rounding of γ explains it; else "".

    Near a zero of the error in γ, E depends strongly on γ. The relative change of γ that gives the
    printed mean is δ = (E_printed − E)/(dE/d ln γ), with a one-sided difference for the slope.
    A δ of at most 5e-6, half a unit of γ's sixth digit, is a rounding; one more run confirms it.
    """
    step, gamma = 1e-6, engine.parameter(case)  # of ln γ
    nearby_mean = engine.mean(replace(case, parameter=gamma * (1 + step)), quantity)
    slope = (nearby_mean - ours) / step
    # below ten floors the difference, and with it the slope, is round-off
    if abs(nearby_mean - ours) < 10 * engine.floor(case, quantity):
        return ""
    change = (float(printed) - ours) / slope
    if abs(change) > 5e-6:
        return ""
    changed_mean = engine.mean(replace(case, parameter=gamma * (1 + change)), quantity)
    if not same_digits(changed_mean, printed):
        return ""
    return (f"the error is close to its zero in γ: γ changed by {change:.1e} of itself, a rounded "
            "sixth digit, gives the printed number")


# ---------------------------------------------------------------- claims of the text


def _alpha_is_idle(engine: Engine) -> Claim:
    """Return the claim that α does not change the means of IMS, EMS and 2-G-L.

    The measure is the largest max/min − 1 over α = γ_m, γ_h and 100 γ_m, as in Table 5, of E[|ΔH|],
    E[|Δz|] and E[|Δx|].
    """
    spreads = []
    for method in ("IMS", "EMS", "2-G-L"):
        for quantity in ("H", "z", "x"):
            # EMS conserves H: its energy error is round-off, whose ratios mean nothing
            if (method, quantity) != ("EMS", "H"):
                means = [engine.mean(TOP.case(method, "alpha", rule), quantity)
                         for rule in ("m", "h", "100m")]
                spreads.append(max(means) / min(means) - 1)
    return Claim("The accuracy of IMS-α, EMS-α and 2-G-L-α does not depend on α: largest "
                 "relative change of a mean over the three α", f"{max(spreads):.1e}",
                 "at most 1e-02", max(spreads) <= 1e-2)


def _gamma_is_better(engine: Engine) -> Claim:
    """Return the claim that γ = γ_m gives smaller means than α = γ_m, in every cell.

    The energy error of EMS is left out: it is round-off for both.
    """
    gains = []
    for method in ("IMS", "EMS", "2-G-L"):
        for quantity in ("H", "z", "x"):
            if (method, quantity) != ("EMS", "H"):
                alpha_mean = engine.mean(TOP.case(method, "alpha", "m"), quantity)
                gains.append(alpha_mean / engine.mean(TOP.case(method, "gamma", "m"), quantity))
    return Claim("IMS, EMS and 2-G-L are more accurate with γ = γ_m than with α = γ_m: ratio of "
                 "the errors of α-type and γ-type", f"{min(gains):.2f} to {max(gains):.1f}",
                 "all above 1", min(gains) > 1)


def _lobatto_types_agree(engine: Engine) -> Claim:
    """Return the claim that 3-LIIIA-B-α and 3-LIIIA-B-γ have equal means for α = γ.

    Erratum 23: |Q_i| = 1 at every stage, so that the types differ by a force along Q_i, which the
    multipliers absorb. The distance of two means is measured in round-off floors.
    """
    distances = []
    for quantity, rule in TABLE_5:
        alpha, gamma = (TOP.case("3-LIIIA-B", rep, rule) for rep in ("alpha", "gamma"))
        difference = abs(engine.mean(alpha, quantity) - engine.mean(gamma, quantity))
        distances.append(difference / engine.floor(gamma, quantity))
    distance = max(distances)
    return Claim("3-LIIIA-B-α and 3-LIIIA-B-γ are the same method for α = γ (erratum 23): the "
                 "means of Tables 4 and 5 agree", "equal to round-off" if distance <= 1 else
                 f"{distance:.1f} round-off floors apart", "equal to round-off", distance <= 1)


def _corrected_mean_is_better(engine: Engine) -> Claim:
    """Return the claim that γ̃_h gives smaller errors of the axis than γ_h for the slim cone.

    The cone has I₁ = 8.5 I₃: the corrected mean γ̃_h is made for moments that differ much.
    """
    gains = [
        engine.mean(SLIM_CONE.case(method, "gamma", "h"), "x")
        / engine.mean(SLIM_CONE.case(method, "gamma", "ht"), "x")
        for method in ("IMS", "EMS")
    ]
    return Claim("γ̃_h is better than γ_h where the moments differ much: E[|Δx|] of IMS and EMS is "
                 "smaller by", " and ".join(f"{gain:.1f}" for gain in gains), "both above 1",
                 min(gains) > 1)


def _nutation_is_exact(engine: Engine) -> Claim:
    """Return the claim that IMS and EMS with γ = γ̃_h = I₁ conserve the tilt of the cone.

    Erratum 25: at this γ a regular precession, cos θ = z_c/l = const, is reproduced exactly.
    """
    cases = [SLIM_CONE.case(method, "gamma", "ht") for method in ("IMS", "EMS")]
    exact = all(engine.mean(case, "z") <= engine.floor(case, "z") for case in cases)
    return Claim("With γ = γ̃_h = I₁ IMS and EMS conserve the tilt of the cone: E[|Δz|]",
                 "round-off" if exact else
                 f"{max(engine.mean(case, 'z') for case in cases):.1e}", "round-off", exact)


def _wide_cone_suits_harmonic_mean(engine: Engine) -> Claim:
    """Return the claim that γ_h loses less against γ_m for the wide cone than for the slim one.

    The measure of a cone is E[|Δz|] with γ_h over E[|Δz|] with γ_m, for IMS and for EMS.
    """
    def penalty(setting: Setting, method: str) -> float:
        """Return E[|Δz|] with γ_h over E[|Δz|] with γ_m."""
        return (engine.mean(setting.case(method, "gamma", "h"), "z")
                / engine.mean(setting.case(method, "gamma", "m"), "z"))

    slim = [penalty(SLIM_CONE, method) for method in ("IMS", "EMS")]
    wide = [penalty(WIDE_CONE, method) for method in ("IMS", "EMS")]
    return Claim(
        "γ_h loses its disadvantage when the moments are closer: E[|Δz|] with γ_h over that with "
        "γ_m, IMS and EMS", f"{slim[0]:.1f} and {slim[1]:.1f} for r = h/2, {wide[0]:.2f} and "
        f"{wide[1]:.2f} for r = 3h/2", "smaller for r = 3h/2",
        all(a > b for a, b in zip(slim, wide, strict=True)),
    )


# ---------------------------------------------------------------- figures


def figure_8(engine: Engine) -> Figure:
    """Return Fig. 8: x and z of the fast top's mass centre, IMS beside 8-stage Gauss-Lobatto."""
    return _axis_figure(engine, 8, Setting("fast-top", 0.01, 160), "8-stage Gauss-Lobatto",
                        "Trajectory of the mass centre, fast spinning top")


def figure_9(engine: Engine) -> Figure:
    """Return Fig. 9: x and z of the cone's mass centre, IMS beside the exact precession."""
    return _axis_figure(engine, 9, Setting("regular-precession", 0.007, 60), "exact",
                        "Trajectory of the mass centre, regular precession")


def _axis_figure(engine: Engine, number: int, setting: Setting, truth: str, title: str) -> Figure:
    """Return the panels of x_c/l and z_c/l of IMS with γ = γ_m and α = γ_m, and of the true motion.

    ``truth`` is the legend of the true motion, ``setting`` the problem with Δt and N_t.
    """
    gamma, alpha = (setting.case("IMS", rep, "m") for rep in ("gamma", "alpha"))
    t = engine.trajectory(gamma).t.tolist()

    def panel(quantity: Quantity, letter: str) -> Panel:
        """Return the panel of one component of the axis over t: the true one, with α and with γ."""
        column = "xyz".index(quantity)
        curves: Sequence[tuple[str, list[float], str]] = (
            (truth, engine.axis_reference(gamma)[:, column].tolist(), "-"),
            ("IMS-α, α = γ_m", engine.trajectory(alpha).axis()[:, column].tolist(), "--"),
            ("IMS-γ, γ = γ_m", engine.trajectory(gamma).axis()[:, column].tolist(), "x"),
        )
        return Panel(f"({letter}) {quantity} of the mass centre", "t [s]", f"{quantity}_c / l",
                     [Series(label, t, y, style) for label, y, style in curves])

    return Figure(
        number, title,
        f"{setting} (our choice of N_t), in units of the distance l of the mass centre.",
        [panel("x", "a"), panel("z", "b")],
        claims=[_gain(engine, gamma, alpha, quantity) for quantity in ("z", "x")],
    )


#: States of the interval on which the claim is decided: 0.32 s, as in Table 4, 32 steps of Fig. 8.
_EARLY = 33


def _gain(engine: Engine, gamma: Case, alpha: Case, quantity: Quantity) -> Claim:
    """Return the claim that IMS-γ follows the true motion more closely than IMS-α.

    The measure is the ratio of mean errors of a coordinate, α-type over γ-type, over the first
    ``_EARLY`` states, which decide, and over the whole figure.
    """
    early_ratio, full_ratio = (
        float(abs(engine.errors(alpha, quantity)[:states]).mean()
              / abs(engine.errors(gamma, quantity)[:states]).mean())
        for states in (_EARLY, gamma.steps + 1)
    )
    return Claim("IMS-γ with γ_m follows the true motion more closely than IMS-α: ratio of "
                 f"{NORMS[quantity]} of α-type and γ-type",
                 f"{early_ratio:.2f} over the first {_EARLY - 1} steps, {full_ratio:.2f} over all",
                 "above 1 over the first steps", early_ratio > 1)
