"""γ searched by ``gs.tune`` against γ_m, γ_h, γ̃_m and γ̃_h: gains, and where there are none.

There are two choices of γ, one for the motion (the default) and one for the energy. Each is
measured by the error that it reduces, on runs longer than the pilots, and by the other's error.
"""

from __future__ import annotations

import numpy as np

from ..core.registry import MEANS
from ..runtime.rigid_body.gamma_rules import mean_inertia
from .case_runner import Engine
from .gamma_trials import (
    ASYMMETRIC_TOPS,
    BODIES,
    ENERGY_BODIES,
    FREE_BODY,
    METHODS,
    TIMES,
    Trial,
    TrialBody,
)
from .line_fit import FittedLine, fit_line
from .study_result import Claim, Finding, Panel, Series

__all__ = ["study"]

#: A run of the tables times this: does the choice for the energy still hold?
LONGER = 10
#: Largest ratio of an error with the chosen γ to the error with γ_m. The search leaves γ_m only
#: where its pilot runs have errors smaller by this factor (``_CLEAR`` of runtime/tuning/pilots.py).
ALLOWED = 1.05


def study(engine: Engine) -> Finding:
    """Return the finding: γ chosen for eleven motions and eight methods, beside the paper's γ."""
    # a short study has every fourth method, six bodies and two times
    methods = METHODS[::4] if engine.short else METHODS
    bodies, times = (ENERGY_BODIES, TIMES[:2]) if engine.short else (BODIES, TIMES)
    trials = {body: [Trial(body, *method) for method in methods] for body in bodies}
    all_trials = [trial for trials_of_body in trials.values() for trial in trials_of_body]
    ims = {body: Trial(body, "IMS", stages=None) for body in ENERGY_BODIES}
    claims = [
        *(motion_claim(body, row, times) for body, row in trials.items()),
        gain_claim(all_trials, times),
        price_claim(all_trials, times),
        ims_claim([trial for body, trial in ims.items() if body.symmetric]),
        *(energy_claim(body, trials[body]) for body in ENERGY_BODIES),
        *(longer_claim(body, trials[body]) for body in ENERGY_BODIES),
        kinetic_claim([Trial(body, "LIIIA-B", 2) for body in ASYMMETRIC_TOPS]),
        idle_claim(ims[FREE_BODY]),
    ]
    return Finding("gamma-auto", "γ chosen by pilot runs", _about(ims), claims,
                   [_panel(Trial(body, "G-L", 2)) for body in ENERGY_BODIES])


# ---------------------------------------------------------------- the motion


def motion_claim(body: TrialBody, trials: list[Trial], times: tuple[float, ...]) -> Claim:
    """Return the claim that no axis has an error more than 5 % above its error with γ_m.

    ``trials`` are the methods for the body; each has the largest ratio of its three axes at
    ``times`` (s), 0 where the motion is lost with γ_m at all of them.
    """
    worst_ratios = [float(np.nanmax(trial.ratios(times=times), initial=0)) for trial in trials]
    text = ", ".join(f"{trial.method} {_ratio(ratio)}"
                     for trial, ratio in zip(trials, worst_ratios, strict=True))
    return Claim(f"{body.name}, γ chosen for the motion: distance of each of the body's three axes "
                 f"over that with γ_m, up to {_spoken(times)}; the largest.", text,
                 f"all at most {ALLOWED}", max(worst_ratios) <= ALLOWED)


def gain_claim(trials: list[Trial], times: tuple[float, ...]) -> Claim:
    """Return the claim that the choice has a median gain of at least 1 over every recommendation.

    The gain is the largest distance of an axis with a recommended γ over the one with the chosen
    γ, up to the second of ``times``; trials that lost the motion count for nothing.
    """
    texts, medians = [], []
    for rule in MEANS.values():
        gains = np.array([trial.gain(rule, times[:2]) for trial in trials])
        gains = gains[np.isfinite(gains)]
        medians.append(float(np.median(gains)))
        texts.append(f"over {rule} {medians[-1]:.2f} ({gains.min():.2f} to {_short(gains.max())})")
    # elsewhere the choice is γ_m itself, with a gain of 1
    changed_trials = [trial for trial in trials if trial.gamma() != trial.rule("γ_m")]
    gains = np.array([trial.gain(times=times[:2]) for trial in changed_trials])
    text = (f"{', '.join(texts)}; where it is not γ_m, in {len(changed_trials)} of {len(trials)}, "
            f"over γ_m {float(np.nanmedian(gains)):.2f}")
    return Claim(f"All methods and motions: the largest distance of an axis up to {times[1]:g} s "
                 "with a recommendation, divided by that with the chosen γ, median (and range).",
                 text, "no median below 1",
                 min(medians) >= 1)


def price_claim(trials: list[Trial], times: tuple[float, ...]) -> Claim:
    """Return the claim that the γ of least energy error can increase the error of an axis.

    A trial counts if some axis is more than 5 % worse than with γ_m, at one of ``times``.
    """
    prices = {trial: float(np.nanmax(trial.price(times), initial=0)) for trial in trials}
    worst_trial = max(prices, key=lambda trial: prices[trial])
    count, gain = sum(w > ALLOWED for w in prices.values()), worst_trial.energy_gain("γ_m")
    return Claim("γ chosen for the energy: number of these motions with an error of some axis "
                 "more than 5 % above γ_m.",
                 f"{count} of {len(trials)}; most {worst_trial.body.name}, {worst_trial.method}: "
                 f"{_short(prices[worst_trial])} times, for an energy error {_short(gain)} times "
                 "smaller",
                 "not none: the two criteria differ", count > 0)


# ---------------------------------------------------------------- the energy


def ims_claim(trials: list[Trial]) -> Claim:
    """Return the claim that IMS on symmetric tops gains far more than 3 over γ_m and γ_h."""
    gains = [trial.energy_gain(rule) for trial in trials for rule in ("γ_m", "γ_h")]
    return Claim("IMS-γ on the symmetric tops: energy error with γ_m and γ_h, divided by the "
                 "error with the chosen γ; minimum.", f"{min(gains):.1e}", "at least 3",
                 min(gains) >= 3)


def energy_claim(body: TrialBody, trials: list[Trial]) -> Claim:
    """Return the claim that no recommended γ has an energy error 5 % below the chosen γ's.

    The runs have the length of the pilot runs; errors at round-off are left out.
    """
    resolved_trials = [trial for trial in trials if not trial.at_round_off()]
    return _energy_claim(f"{body.name}: energy error with the best of γ_m, γ_h, γ̃_m, γ̃_h, "
                         f"divided by the error with the chosen γ, {body.steps} steps of "
                         f"{body.dt:g} s, errors at round-off excluded.", resolved_trials, 1)


def longer_claim(body: TrialBody, trials: list[Trial]) -> Claim:
    """Return the claim of ``energy_claim`` for runs of ten times the steps of the pilot runs."""
    resolved_trials = [trial for trial in trials if not trial.at_round_off(LONGER)]
    return _energy_claim(f"{body.name}: the same γ over {LONGER * body.steps} steps, errors at "
                         "round-off excluded.", resolved_trials, LONGER)


def _energy_claim(statement: str, resolved_trials: list[Trial], times: int) -> Claim:
    """Return the claim that every gain, recommended over chosen γ, is at least 1/1.05.

    ``times`` is the length of the runs in lengths of the pilot runs.
    """
    gains = [trial.energy_gain(times=times) for trial in resolved_trials]
    text = ", ".join(f"{trial.method} {_short(gain)}"
                     for trial, gain in zip(resolved_trials, gains, strict=True))
    # 1e-4: the rounding of a gain of exactly 1/1.05
    return Claim(statement, text, f"all at least 1/{ALLOWED}",
                 min(gains, default=1) >= 1 / (ALLOWED + 1e-4))


def kinetic_claim(trials: list[Trial]) -> Claim:
    """Return the claim that the 1/γ part of the energy error of 2-LIIIA-B is −h² (T² − T₀²)/8."""
    lines = [kinetic_line(trial) for trial in trials]
    text = "; ".join(f"slope {line.slope:.4f}, R² = {line.quality}" for line in lines)
    return Claim("2-LIIIA-B, asymmetric tops: the part of the energy error that is linear in 1/γ "
                 "against h²(T² − T₀²), Δt quartered; derived: C_2 = T²/8.", text,
                 "slope −1/8 ± 1 %, R² ≥ 0.999",
                 all(abs(8 * line.slope + 1) < 0.01 and line.r_squared > 0.999 for line in lines))


def kinetic_line(trial: Trial) -> FittedLine:
    """Return the line of ∂(H_k − H_0)/∂(1/γ) over h²(T_k² − T_0²), at a quarter of Δt.

    The derivative is the difference quotient between γ = γ_m and γ_m/1.2, whose 1/γ differ by
    0.2/γ_m; T = H − V is the kinetic energy.
    """
    finer = Trial(TrialBody(trial.body.name, trial.body.make, trial.body.dt / 4,
                            4 * trial.body.steps),
                  trial.scheme, trial.stages)
    problem = trial.body.problem
    gamma, steps = mean_inertia(problem.inertia), finer.body.steps
    low, high = finer.run(gamma, steps), finer.run(gamma / 1.2, steps)
    slope = (high.energies - low.energies) / (0.2 / gamma)
    T = low.energies - problem.parameters["mgl"] * low.axis()[:, 2]
    return fit_line((finer.body.dt**2 * (T**2 - T[0] ** 2)).tolist(), slope.tolist())


def idle_claim(trial: Trial) -> Claim:
    """Return the claim that the energy error of IMS for a free body does not depend on γ.

    The measure is max/min − 1 of the mean energy error over γ_m, γ_h, γ̃_m and γ̃_h (``MEANS``).
    """
    errors = [trial.energy_error(trial.rule(name)) for name in MEANS.values()]
    spread = max(errors) / min(errors) - 1
    return Claim("IMS-γ, free body: γ has no part in the energy error; change of its mean over "
                 "the four recommendations.",
                 f"{spread:.1e}", "at most 1e-2", spread <= 1e-2)


# ---------------------------------------------------------------- text and panels


def _ratio(ratio: float) -> str:
    """Return a ratio of distances, or "lost" for 0: the motion was lost at every time."""
    return f"{ratio:.2f}" if ratio else "lost"


def _short(gain: float) -> str:
    """Return a gain with two decimals, from 100 on with an exponent."""
    return f"{gain:.2f}" if gain < 100 else f"{gain:.1e}"


def _spoken(times: tuple[float, ...]) -> str:
    """Return e.g. "1, 10 and 100 s"."""
    *first, last = (f"{t:g}" for t in times)
    return f"{', '.join(first)} and {last} s"


def _about(ims: dict[TrialBody, Trial]) -> str:
    """Return the text of the finding, with the gains of IMS over γ_m for asymmetric bodies."""
    asymmetric = ", ".join(f"{body.name} {trial.energy_gain('γ_m'):.2f}"
                           for body, trial in ims.items() if not body.symmetric)
    return f"""The law (34), error = d + K/γ, is linear to leading order at every step of a run \
and for every component of the motion, not only for the energy, because the truncation error is \
linear in 1/γ. Two short runs with different γ determine d and K, and the mean square of any \
error is a quadratic function of 1/γ whose minimum has a closed form: a step of Levenberg and \
Marquardt's method. A run there measures the error, and steps follow as long as it decreases; the \
four values of the paper are measured as well. A choice takes some 25 pilot runs and a reference \
of three with finer steps, 50 ms.

The γ with the smallest energy error differs from the γ with the smallest error of the motion. \
The default criterion is the motion. It needs more than one number: the error of a top's axis, \
and of its centre of mass, is tens of times smaller than the error of its spin, and one γ seldom \
reduces both. The choice has the smallest of the largest error of the body's three axes, over all \
γ that reduce the error of each of the three; if there is no such γ, the choice is γ_m. The \
reference motion is extrapolated from runs with Δt/4 and Δt/8. The errors of regular motions grow \
like t, so their ratio to the errors with γ_m over 1000 steps holds for 100 000, until the error \
reaches 0.3 rad. If they do not grow like t (a motion slower than the pilot runs, or a chaotic \
one), the choice is γ_m.

The energy criterion (aim="energy") gains much for symmetric tops. Their motion has one remaining \
degree of freedom, all d_k and K_k follow the same curve, and one γ cancels the error at every \
step: by two or three orders of magnitude for G-L and even-stage LIIIA-B. For IMS this γ is \
exactly I₁ (see "The γ without energy error"), which equals γ̃_m and γ̃_h: relative to these \
there is no gain.

For asymmetric bodies in a potential the gain is small. d_k and K_k are then different functions \
of the motion, and no γ cancels one by the other; without a potential G-L and 4-LIIIA-B gain \
much. For 2-LIIIA-B the 1/γ part is −h²(T² − T₀²)/8 if a potential does work; the remaining error \
has other frequencies. Gains of IMS over γ_m: {asymmetric}. For a free body T is the constant \
energy, and the energy error of 2-LIIIA-B does not depend on γ, nor, as measured, does that of \
IMS; the choice is γ_m. For odd-stage LIIIA-B the γ term is two orders above the error (see \
"LIIIA-B: why odd s has no 1/γ"), with a gain at large Δt only. EMS conserves the energy for \
every γ, and most of its error of the motion is a phase drift that hardly depends on γ."""


def _panel(trial: Trial) -> Panel:
    """Return the panel of the mean energy error over γ_m/γ, with marks at six values of γ.

    The marks, vertical dashes, are the four recommendations and both choices.
    """
    mean = trial.rule("γ_m")
    x = np.linspace(0.4, 2.2, 19)
    marks = {**{name: trial.rule(name) for name in MEANS.values()},
             "for the motion": trial.gamma(), "for the energy": trial.gamma("energy")}
    return Panel(
        f"{trial.body.name}, {trial.method}-γ", "γ_m/γ", "mean |ΔH| in J",
        [Series("mean error", x.tolist(), [trial.energy_error(mean / u) for u in x.tolist()], "-"),
         *(Series(name, [mean / gamma] * 2,
                  [trial.energy_error(gamma), trial.energy_error(gamma) * 3], "--")
           for name, gamma in marks.items())],
        yscale="log",
    )
