"""LIIIA-B-α = LIIIA-B-γ for α = γ (erratum 23): the proof, and the same in round-off."""

from __future__ import annotations

from typing import Any

import numpy as np
import sympy as sp

from ..api import stepper
from ..core.arrays import Array
from ..generator.multibody.rigid_body import heavy_top
from ..generator.tableaux.families import lobatto_iiiab
from ..generator.tableaux.tableau import Tableau
from ..runtime.rigid_body.gamma_rules import mean_inertia
from ..runtime.rigid_body.problems import fast_top
from ..runtime.steppers.stepper import Stepper
from .case_runner import Engine
from .sampled_energy import run
from .study_result import Claim, Finding

__all__ = ["gradients_claim", "nodes_claim", "stages_claim", "study"]

STAGES = (2, 3, 4, 5)
DT, STEPS = 0.005, 64


def study(engine: Engine) -> Finding:
    """Prove that LIIIA-B-α and LIIIA-B-γ have equal trajectories, and measure it."""
    claims = [
        gradients_claim(),
        stages_claim(),
        nodes_claim([lobatto_iiiab(s) for s in range(2, 9)]),
        trajectories_claim(STEPS // 4 if engine.short else STEPS),
        multipliers_claim(),
    ]
    return Finding("alpha-equals-gamma", "LIIIA-B-α and LIIIA-B-γ are one method", _about(claims),
                   claims)


def _about(claims: list[Claim]) -> str:
    """Return the proof in words, with the defects that claims 4 and 5 of the study measured."""
    trajectories, multipliers = claims[3:]
    return f"""The paper observes and predicts that s-LIIIA-B-α and s-LIIIA-B-γ give the same \
results for α = γ. This is the proof, for every s.

The two Hamiltonians differ by H_γ − H_α = (1 − |q|²)|p|²/(8γ), identically in q and p. On |q| = 1 \
the difference and its derivative with respect to p vanish. Its derivative with respect to q is \
−|p|²q/(4γ), parallel to the constraint force.

In LIIIA-B every stage is a constraint node: Ã = Â and Ā = A, so Q_i = Q̃_(i−1) and |Q_i| = 1 at \
every stage. Given a solution of the α-step, let Λ_(i−1)^γ = Λ_(i−1)^α + |P_i|²/(8γ). At every \
stage k_i = H_p and the force −H_q(Q_i, P_i) − 2Q_iΛ_(i−1) are then the same for both types. The \
force enters P_i with the weights â_ij and the multiplier with ã_ij, which are equal, so all P_i \
and Q_i are unchanged and the γ-step is solved. The last column of both matrices is zero; its \
multiplier occurs in T2 only, with b̃ = b̂, and the same shift applies.

For IMS, EMS and G-L the stages lie between the constraint nodes, |Q_i| differs from 1, and the \
methods differ.

The compiled steppers agree: over the motion of the fast top the relative difference of q and p is \
at most {trajectories.found}, and the multipliers satisfy the relation to {multipliers.found}."""


# ---------------------------------------------------------------- proofs


def gradients_claim(alpha: sp.Expr | None = None) -> Claim:
    """Return the claim H_γ − H_α = (1 − |q|²)|p|²/(8γ), an identity in q and p.

    ``alpha`` replaces α = γ; the claim is false for any other α.
    """
    gamma_system, alpha_system = heavy_top("gamma"), heavy_top("alpha")
    gamma = gamma_system.parameters[-1]
    at_alpha = {alpha_system.parameters[-1]: gamma if alpha is None else alpha}
    q2, p2 = (sum(x**2 for x in v) for v in (gamma_system.q, gamma_system.p))
    difference = gamma_system.H - alpha_system.H.subs(at_alpha) - (1 - q2) * p2 / (8 * gamma)
    expanded = sp.expand(difference)
    return Claim(
        "H_γ − H_α = (1 − |q|²)|p|²/(8γ) for all q and p; hence on |q| = 1 the H_p are equal and "
        "the H_q differ by −|p|²q/(4γ).",
        f"difference of the sides {expanded}" if expanded == 0 else "the sides differ", "0",
        expanded == 0, "proved",
    )


def stages_claim(norm: sp.Expr = 1) -> Claim:
    """Return the claim that k_i and k̂_i + k̃_i of both forms are equal; false unless |Q_i|² = 1.

    With D = H_γ − H_α = (1 − |q|²)|p|²/(8γ), Λ^γ = Λ^α + |P|²/(8γ) and |Q|² = ``norm`` the rates
    k = H_p differ by D_p, and the forces k̂ + k̃ = −H_q − 2QΛ by −D_q − 2Q Λ^γ + 2Q Λ^α.
    """
    Q, P = sp.symbols("Q0:4"), sp.symbols("P0:4")
    gamma, Lambda_alpha = sp.symbols("gamma Lambda")
    P_squared = sum(x**2 for x in P)
    D = (1 - sum(x**2 for x in Q)) * P_squared / (8 * gamma)
    # |Q|² = norm, solved for the square of the first component
    on_node = {Q[0] ** 2: norm - sum(x**2 for x in Q[1:])}
    Lambda_gamma = Lambda_alpha + P_squared / (8 * gamma)
    differences = [D.diff(x).subs(on_node) for x in P]
    differences += [-D.diff(x) - 2 * x * Lambda_gamma + 2 * x * Lambda_alpha for x in Q]
    # expanded first: only then does Q₀² stand alone, for which |Q|² = norm is put in
    holds = all(sp.expand(sp.expand(e).subs(on_node)) == 0 for e in differences)
    return Claim(
        "With Λ^γ = Λ^α + |P_i|²/(8γ) a stage with |Q_i| = 1 has the same k_i and the same force "
        "k̂_i + k̃_i in both forms.",
        "identical" if holds else "different", "identical", holds, "proved",
    )


def nodes_claim(tableaux: list[Tableau]) -> Claim:
    """Return the claim that stages are constraint nodes with the same weights; false for G-L.

    The statement of ``_stages_are_constraint_nodes`` for each tableau, in exact arithmetic.
    """
    good = [t for t in tableaux if _stages_are_constraint_nodes(t)]
    return Claim(
        "Ã = Â, Ā = A, b̃ = b̂ = b; the first node is 0, the last node 1, and the last column of Ã "
        "is 0 (any s by construction, checked here in exact arithmetic).",
        f"{len(good)} of {len(tableaux)} tableaux, s = {', '.join(str(t.s) for t in good)}",
        f"all {len(tableaux)}", len(good) == len(tableaux), "proved",
    )


def _stages_are_constraint_nodes(t: Tableau) -> bool:
    """Return whether Ã = Â, Ā = A, b̃ = b̂ = b, c̃ = c with c_1 = 0 and c_s = 1, all exactly.

    The last column of Ã must vanish too: the multiplier Λ_p then has no effect on the stages.
    """
    basis = t.basis
    # p + 1 constraint nodes c̃_0 … c̃_p, and s stages
    if t.s != t.p + 1:
        return False
    equal_pairs = [("A_tilde", "A_hat"), ("A_bar", "A"), ("b_tilde", "b_hat"), ("b_hat", "b"),
                   ("c_tilde", "c")]
    last_column = basis["A_tilde"] * t.constraints.at(-1).transpose()
    end_nodes = [e.centre for e in (t.enclosures["c"][0], t.enclosures["c"][-1])]
    return bool(all(basis[x] == basis[y] for x, y in equal_pairs) and last_column.is_zero_matrix
                and end_nodes == [0, 1])


# ---------------------------------------------------------------- measured


def trajectories_claim(steps: int) -> Claim:
    """Return the claim that q and p of compiled α- and γ-steppers agree to round-off.

    The measure is the largest relative difference over s = 2..5 and ``steps`` of the fast top.
    """
    weight = mean_inertia(fast_top().inertia)
    maximum = 0.0
    for s in STAGES:
        runs = [run("LIIIA-B", s, DT, steps, weight, rep=rep) for rep in ("alpha", "gamma")]
        maximum = max(maximum, _difference(runs[0].q, runs[1].q), _difference(runs[0].p, runs[1].p))
    return Claim(
        f"Fast top, s = 2..5, Δt = {DT}, {steps} steps, α = γ = γ_m: largest relative difference "
        "of q and p.",
        f"{maximum:.1e}", "< 1e-11 (round-off)", maximum < 1e-11,
    )


def multipliers_claim() -> Claim:
    """Return the claim Λ_(i−1)^γ − Λ_(i−1)^α = |P_i|²/(8γ), measured in one step for s = 2..5."""
    weight = mean_inertia(fast_top().inertia)
    maximum = 0.0
    for s in STAGES:
        (P, Lambda_alpha), (_, Lambda_gamma) = (
            _stages(stepper("LIIIA-B", s, rep), s, rep, weight) for rep in ("alpha", "gamma")
        )
        # without the last stage: its multiplier belongs to the projection of the momentum
        expected = (P[:-1] ** 2).sum(axis=1) / (8 * weight)
        maximum = max(maximum, _difference(Lambda_gamma - Lambda_alpha, expected))
    return Claim(
        f"Λ_(i−1)^γ − Λ_(i−1)^α = |P_i|²/(8γ) in one step of Δt = {DT}, s = 2..5: relative defect.",
        f"{maximum:.1e}", "< 1e-10 (round-off)", maximum < 1e-10,
    )


def _stages(step: Stepper, s: int, rep: str, weight: float) -> tuple[Array, Array]:
    """Solve the stage equations of the first step; return P_1..P_s, (s, 4), and Λ_0..Λ_(s−2).

    Q_i = q + Δt Σ_j a_ij k_j and P_i = p + Δt Σ_j â_ij (k̂_j − 2 Q_j Λ_(j−1)), with Λ_(s−1) = 0;
    the unknowns are x = (k, k̂, Λ). ``weight`` is γ or α, as ``rep`` says.
    """
    problem = fast_top()
    run_options: dict[str, Any] = {"dt": DT, "parameters": problem.parameters | {rep: weight}}
    q, p = problem.q0, problem.p0
    x = step.guess(q, p, **run_options)
    for _ in range(12):  # Newton's method: four steps reach round-off
        x = x - np.linalg.solve(step.jacobian(x, q, p, **run_options),
                                step.residual(x, q, p, **run_options))
    table = lobatto_iiiab(s).numeric(20)
    A, A_hat = (np.array(table_rows, dtype=float) for table_rows in (table.A, table.A_hat))
    k, k_hat = x[: 4 * s].reshape(s, 4), x[4 * s : 8 * s].reshape(s, 4)
    Q = q + DT * A @ k
    constraint_force = -2 * Q * np.append(x[8 * s :], 0.0)[:, None]
    return p + DT * A_hat @ (k_hat + constraint_force), x[8 * s :]


def _difference(a: Array, b: Array) -> float:
    """Return max|a − b| / max|b|."""
    return float(np.abs(a - b).max() / np.abs(b).max())
