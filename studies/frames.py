"""Tables 4, 6 and 7 again in co-moving frames: the cones have no error, the fast top a smaller one.

The frame's rates are those of the start ("start", least squares) or chosen by short runs ("auto");
scheme, γ or α, Δt, N_t and norms are the tables' own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .accuracy import SLIM_CONE, TOP, WIDE_CONE, Setting
from .case_runner import Case, Engine, Frame, Quantity
from .labels import NORMS
from .printed import COLUMNS, TABLE_4, TABLE_6, TABLE_7, Printed
from .study_result import Claim, Finding, Panel, Series

__all__ = ["study"]


def study(engine: Engine) -> Finding:
    """Compute the cells of the three tables without a frame and with one."""
    claims = [_cone_claim(engine, 6, SLIM_CONE, TABLE_6),
              _cone_claim(engine, 7, WIDE_CONE, TABLE_7),
              *(_gain_claim(engine, quantity) for quantity in ("x", "z", "H")),
              _every_cell_claim(engine), _ems_claim(engine)]
    return Finding("frames", "Tables 4, 6 and 7 in co-moving frames", _ABOUT, claims,
                   [_panel(engine)])


_ABOUT = """With a linear symmetry of H and g a method can integrate H − ωJ and rotate the result \
back: order, conserved quantities and cost are unchanged for any ω (see docs/frames.md). A top has \
two symmetries: the rotations about its own axis and about the vertical.

The regular precession of Tables 6 and 7 is a relative equilibrium: a rotation about the vertical \
at one rate and about the body's axis at another. In the frame with these two rates it is \
stationary, and a method of any order has no error. The differences between IMS, EMS and 2-G-L and \
between γ_m, γ_h, γ̃_h and α vanish.

The fast top of Table 4 nutates, so a frame removes only a part of its motion, and methods of \
higher order gain more. For IMS and EMS the frame of the initial state increases E[|Δz|] by half; \
the chosen frame increases no error of the axis. EMS conserves the energy H − ωJ of the frame. It \
conserves H as accurately as J, and the J of a body's own axis to the order of the method only."""


def _cases(setting: Setting, printed: Printed) -> list[tuple[Case, Quantity]]:
    """Return (case, quantity) of every cell of a table, row by row."""
    return [(setting.case(method, rep, rule), quantity)
            for quantity, rep, rule in printed for method in COLUMNS]


def _cone_claim(engine: Engine, table: int, setting: Setting, printed: Printed) -> Claim:
    """Return the claim that every cell of a table is round-off in the frame of the start.

    A cell counts if its mean error is at most ε · N_t · size (``Engine.floor``).
    """
    cells = _cases(setting, printed)
    frames: tuple[Frame, ...] = ("", "start")
    without_frame, in_frame = (
        sum(engine.mean(replace(case, frame=frame), quantity) <= engine.floor(case, quantity)
            for case, quantity in cells) for frame in frames)
    return Claim(f"Table {table}, E[|ΔH|], E[|Δz|] and E[|Δx|]: cells at round-off, "
                 "ε · N_t · size, in the frame of the start; without a frame.",
                 f"{in_frame}; {without_frame}", f"all {len(cells)}", in_frame == len(cells))


def _gain(engine: Engine, case: Case, quantity: Quantity, frame: Frame) -> float:
    """Return the mean error without a frame, divided by the mean error in the frame."""
    in_frame = replace(case, frame=frame)
    return engine.mean(case, quantity) / engine.mean(in_frame, quantity)


def _gain_claim(engine: Engine, quantity: Quantity) -> Claim:
    """Return the claim that the chosen frame reduces the error of every method at γ = γ_m.

    The text has both gains of a method: in the frame of the start, and in the chosen frame.
    """
    gain_texts, gains_of_choice = [], []
    for method in COLUMNS:
        # EMS has no energy error but round-off
        if (method, quantity) != ("EMS", "H"):
            case = TOP.case(method, "gamma", "m")
            start, auto = (_gain(engine, case, quantity, frame) for frame in ("start", "auto"))
            gain_texts.append(f"{method} {_short(start)} / {_short(auto)}")
            gains_of_choice.append(auto)
    return Claim(f"Table 4, γ = γ_m: {NORMS[quantity]} without a frame, divided by its value with "
                 "\"start\" / with \"auto\".", ", ".join(gain_texts),
                 "chosen: all above 1", min(gains_of_choice) > 1)


def _every_cell_claim(engine: Engine) -> Claim:
    """Return the claim that no cell of Table 4 gets worse by the choice, EMS's energy aside."""
    gains = [_gain(engine, case, quantity, "auto") for case, quantity in _cases(TOP, TABLE_4)
             if (case.scheme, quantity) != ("EMS", "H")]
    return Claim("Table 4, all three γ: this ratio for the chosen frame, median and minimum of "
                 f"{len(gains)} cells.",
                 f"{_short(float(np.median(gains)))} and {_short(min(gains))}",
                 "least above 1", min(gains) > 1)


def _ems_claim(engine: Engine) -> Claim:
    """Return the claim that EMS conserves H − Σ ωJ in the chosen frame, and not H.

    ω is the frame's rate about a symmetry axis and J the momentum of that symmetry.
    """
    case = replace(TOP.case("EMS", "gamma", "m"), frame="auto")
    run, symmetries = engine.trajectory(case), engine.stepper(case).symmetries
    omega_J = [run.parameters[s.name] * s.momentum(run.q, run.p) for s in symmetries]
    energy = run.energy() - sum(omega_J)
    # the terms of H − ΣωJ may cancel; round-off is relative to each of them
    size = abs(run.energy()[0]) + sum(abs(term[0]) for term in omega_J)
    floor = float(np.finfo(float).eps * case.steps * size)
    mean_energy_error = float(abs(energy - energy[0]).mean())
    H = engine.mean(case, "H")
    errors_measured = "round-off" if mean_energy_error <= floor else f"{mean_energy_error:.1e}"
    return Claim("Table 4, EMS, γ = γ_m in the chosen frame: it conserves H − ωJ, and H to its "
                 "order only.", f"{errors_measured}; {H:.0e} J",
                 "round-off; more than that", mean_energy_error <= floor < H)


def _short(gain: float) -> str:
    """Return a number with two digits, without the exponent that "{:.2g}" gives above 99."""
    return f"{float(f'{gain:.2g}'):g}"


def _panel(engine: Engine) -> Panel:
    """Return the panel of the distance of the axis of 2-G-L from the true one, over time."""
    series = []
    labels: dict[Frame, str] = {"": "no frame", "start": "of the start", "auto": "chosen"}
    for frame, label in labels.items():
        case = replace(TOP.case("2-G-L", "gamma", "m"), frame=frame)
        run = engine.trajectory(case)
        distance = np.linalg.norm(run.axis() - engine.axis_reference(case), axis=1)
        # without the start, whose distance 0 a logarithmic axis lacks
        series.append(Series(label, run.t[1:].tolist(), distance[1:].tolist(), "-"))
    return Panel("fast top, 2-G-L-γ, γ = γ_m, Δt = 0.001 s", "t [s]",
                 "distance of the unit axis from the true one", series, yscale="log")
