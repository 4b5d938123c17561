"""Tables 2, 3 and Figs. 5-7: which invariants each scheme keeps exactly, (88)-(91).

    theory   IMS  l₃, g      EMS  H, g      LIIIA-B, G-L  l₃, g, qᵀp

with and without a γ or α of whatever value. EMS-α keeps qᵀp as well: erratum 5's scheme has
0 = q̄ᵀΔq = Δt q̄ᵀD_pH = Δt |q̄|² mean(qᵀp)/(4α), so mean(qᵀp) = 0 and qᵀp stays 0.

Kept exactly means a mean error below the round-off floor ε · N_t · size. Our copy
of the paper lost the numbers of both tables and says neither Δt nor N_t: Table 2 takes Δt = 0.01
from Figs. 5-7, Table 3 takes Δt = 0.005 from Table 6.
"""

from __future__ import annotations

import numpy as np

from .accuracy import Setting
from .case_runner import Case, Engine, Quantity
from .labels import NORMS, PARAMETERS, row_name
from .printed import COLUMNS
from .study_result import Cell, Claim, Figure, Panel, Series, Table
from .verdict import CONSERVED_EXACTLY, compare_value

__all__ = ["CONSERVED", "figure_5", "figure_6", "figure_7", "table_2", "table_3"]

STEPS = 1000
TOP = Setting("fast-top", 0.01, STEPS)
CONE = Setting("regular-precession", 0.005, STEPS)

#: Scheme → what the theory says it keeps exactly.
CONSERVED: dict[str, set[Quantity]] = {
    "IMS": {"l3", "g"}, "EMS": {"H", "g"},
    "3-LIIIA-B": {"l3", "g", "qp"}, "2-G-L": {"l3", "g", "qp"},
}
#: The rows for each quantity: representation and value of γ or α.
VARIANTS = (("gamma", "m"), ("gamma", "h"), ("alpha", "m"), ("alpha", "h"))
_QUANTITIES: tuple[Quantity, ...] = ("H", "E", "l3", "g", "qp")
_NAMES: dict[Quantity, str] = {"H": "H", "E": "H(q, Pp)", "l3": "l₃", "g": "g", "qp": "qᵀp",
                               "x": "x", "z": "z"}


def table_2(engine: Engine) -> Table:
    """Return Table 2: mean errors of the invariants of the fast top."""
    return _table(engine, 2, "Fast spinning top: conservation of invariants", TOP)


def table_3(engine: Engine) -> Table:
    """Return Table 3: mean errors of the invariants, regular precession of the cone r = h/2."""
    return _table(engine, 3, "Regular precession: conservation of invariants", CONE)


def _table(engine: Engine, number: int, title: str, setting: Setting) -> Table:
    """Return the table of H, H(q, Pp), l₃, g and qᵀp for every method, γ and α, with its claims."""
    about = (
        f"{setting} (our choice: our copy of the paper lacks the numbers and Δt). Means of the "
        "absolute errors of energy and l₃ = I₃Ω₃, and of the defects of |q| = 1 and qᵀp = 0. "
        "Conserved exactly: error below ε · N_t · magnitude. EMS-α conserves qᵀp too, since 0 = "
        "q̄ᵀΔq = Δt |q̄|² mean(qᵀp)/(4α) with the midpoint q̄. H(q, Pp): the energy of the motion, "
        "with p projected onto qᵀp = 0; H(q, p) = H(q, Pp) + (qᵀp)²/(8γ), or /(8α), on |q| = 1, "
        "so that H(q, Pp) is conserved where H and qᵀp are."
    )
    cells = [
        _cell(engine, setting.case(method, rep, rule), quantity, rule)
        for quantity in _QUANTITIES for rep, rule in VARIANTS for method in COLUMNS
    ]
    claims = [_conserved_claim(engine, setting, method) for method in COLUMNS]
    return Table(number, title, about, cells,
                 [_overall_claim(engine, setting), *claims, _periodic_claim(engine, setting)])


def _cell(engine: Engine, case: Case, quantity: Quantity, rule: str) -> Cell:
    """Return our mean error; our copy of the paper lost the printed one. ``rule`` names γ or α."""
    note = CONSERVED_EXACTLY if _keeps(engine, case, quantity) else ""
    return compare_value(row_name(quantity, case.rep, rule), case.method,
                         engine.mean(case, quantity), None,
                         reason=note)


def _keeps(engine: Engine, case: Case, quantity: Quantity) -> bool:
    """Return whether a case conserves a quantity: mean error at most ε · N_t · size.

    H(q, Pp) differs from H by (qᵀp)²/(8γ), which may be below the floor of H though qᵀp is not
    conserved: both H and qᵀp must be.
    """
    conditions: tuple[Quantity, ...] = ("H", "qp") if quantity == "E" else (quantity,)
    return all(engine.mean(case, q) <= engine.floor(case, q) for q in conditions)


def _overall_claim(engine: Engine, setting: Setting) -> Claim:
    """Return the claim that each scheme conserves the quantities of ``CONSERVED``.

    Pairs of a case and a quantity are counted, over all methods and all values of γ and α.
    """
    expected_pairs = [(setting.case(method, rep, rule), quantity) for method in COLUMNS
                      for rep, rule in VARIANTS for quantity in CONSERVED[method]]
    conserved_pairs = [pair for pair in expected_pairs if _keeps(engine, *pair)]
    return Claim("Neither γ nor α affects the invariants: conserved to round-off as derived",
                 f"{len(conserved_pairs)}", f"all {len(expected_pairs)}",
                 len(conserved_pairs) == len(expected_pairs))


def _conserved_claim(engine: Engine, setting: Setting, method: str) -> Claim:
    """Return the claim that a method conserves what ``CONSERVED`` lists, for all γ and α."""
    conserved: dict[str, list[set[Quantity]]] = {"gamma": [], "alpha": []}
    for rep, rule in VARIANTS:
        case = setting.case(method, rep, rule)
        conserved[rep].append({quantity for quantity in _QUANTITIES
                               if _keeps(engine, case, quantity)})
    # conserved by a type: for both values of γ, or of α
    gamma, alpha = set.intersection(*conserved["gamma"]), set.intersection(*conserved["alpha"])
    measured_text = f"γ-type {_list_in_order(gamma)}; α-type {_list_in_order(alpha)}"
    return Claim(
        f"{method} conserves exactly, for any γ and α", measured_text,
        f"{_list_in_order(CONSERVED[method])} at least",
        CONSERVED[method] <= gamma and CONSERVED[method] <= alpha,
    )


def _list_in_order(quantities: set[Quantity]) -> str:
    """Return e.g. "l₃, g", in the order of the table's rows, or "nothing"."""
    return ", ".join(_NAMES[c] for c in _QUANTITIES if c in quantities) or "nothing"


def _periodic_claim(engine: Engine, setting: Setting) -> Claim:
    """Return the claim that errors of the quantities that are not conserved stay bounded.

    The growth is the largest |error| of the second half of the run over the first half's.
    """
    # 1.05: the ratio of a periodic error is 1 (measured: at most 1.001), of one that grows like √t
    # it is 1.41, like t it is 2
    growth = []
    for method in COLUMNS:
        for rep, rule in VARIANTS:
            case = setting.case(method, rep, rule)
            for quantity in _QUANTITIES:
                if not _keeps(engine, case, quantity):
                    first, second = np.array_split(np.abs(engine.errors(case, quantity)), 2)
                    growth.append(float(second.max() / first.max()))
    return Claim("Errors of the other quantities are periodic: largest error of the second half "
                 "of the run relative to the first", f"at most {max(growth):.3f}", "at most 1.05",
                 max(growth) <= 1.05)


# ---------------------------------------------------------------- figures

#: Steps drawn: 2 s.
_DRAWN = 201


def figure_5(engine: Engine) -> Figure:
    """Return Fig. 5: errors of energy and l₃ over time, IMS and EMS."""
    panels: tuple[tuple[str, Quantity], ...] = (("IMS", "H"), ("EMS", "H"), ("IMS", "l3"),
                                                ("EMS", "l3"))
    return _figure(engine, 5, "Conservation of invariants, fast top: IMS-γ and EMS-γ", panels)


def figure_6(engine: Engine) -> Figure:
    """Return Fig. 6: errors of energy and l₃ over time, 3-LIIIA-B."""
    return _figure(engine, 6, "Conservation of invariants, fast top: 3-LIIIA-B-γ",
                   (("3-LIIIA-B", "H"), ("3-LIIIA-B", "l3")))


def figure_7(engine: Engine) -> Figure:
    """Return Fig. 7: qᵀp over time, IMS and EMS."""
    return _figure(engine, 7, "The orthogonal condition, fast top", (("IMS", "qp"), ("EMS", "qp")))


def _figure(
    engine: Engine, number: int, title: str, panel_cases: tuple[tuple[str, Quantity], ...]
) -> Figure:
    """Return a figure of errors against time, γ = γ_m, with a claim for each panel.

    ``panel_cases`` has a method and a quantity for each panel.
    """
    panels, claims = [], []
    for letter, (method, quantity) in zip("abcd", panel_cases, strict=False):
        case = TOP.case(method, "gamma", "m")
        errors = engine.errors(case, quantity)[:_DRAWN].tolist()
        t = engine.trajectory(case).t[:_DRAWN].tolist()
        name = "qᵀp" if quantity == "qp" else f"Δ{_NAMES[quantity]}"
        panels.append(Panel(f"({letter}) {name}, {method}-γ", "t [s]", name,
                            [Series(f"{method}-γ", t, errors)]))
        claims.append(_exactness_claim(engine, case, quantity))
    return Figure(number, title, f"Δt = {TOP.dt:g}, γ = {PARAMETERS['m']}; the first "
                  f"{(_DRAWN - 1) * TOP.dt:g} s of the {STEPS * TOP.dt:g} s of Table 2.",
                  panels, claims=claims)


def _exactness_claim(engine: Engine, case: Case, quantity: Quantity) -> Claim:
    """Return the claim that a quantity is conserved exactly if, and only if, theory says so."""
    is_conserved, is_expected = _keeps(engine, case, quantity), quantity in CONSERVED[case.method]
    size = "round-off" if is_conserved else f"{engine.mean(case, quantity):.3e}"
    return Claim(f"{case.method}-γ {'conserves' if is_expected else 'does not conserve'} "
                 f"{_NAMES[quantity]} exactly: {NORMS[quantity]}", size,
                 "round-off" if is_expected else "above round-off", is_conserved == is_expected)

