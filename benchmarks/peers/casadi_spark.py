"""CasADi: the same SPARK Gauss-Lobatto by its Newton solver, and its own collocation.

Both as C that CasADi writes, compiled with -O3 -march=native. The SPARK equations are written
here a second time, with CasADi's derivatives of H: they share the tableau with gyrospark and
nothing else. The guess for a step is the last step's solution. The steps of a run are a loop in C
(``Function.fold``, a tenth of a second a call), which costs CasADi next to nothing.
"""

from __future__ import annotations

import os
import shlex
import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

import gyrospark as gs

from ..attitudes import Array, angular_velocity
from ..tops import INERTIA, MGL, TopState, euler_equations, parameters, state_of, tops
from .entry import PeerEntry, Run
from .optional import Unavailable, need

__all__ = ["PACKAGE", "entries"]

PACKAGE = "casadi"
#: Simulated seconds of one call of the generated C.
_BLOCK = 0.1
_SPARK = ((2, 1e-3, True), (3, 1e-3, False), (4, 1e-3, False), (4, 1e-2, False), (6, 1e-2, False),
          (8, 1e-2, False))
_COLLOCATION = ((2, 1e-3, True), (4, 1e-2, False), (8, 1e-2, False))


def entries() -> list[PeerEntry]:
    """Return SPARK and collocation with several stages."""
    return [
        *(PeerEntry("casadi", f"SPARK G-L s={s} Δt={dt:g} generated C",
                    partial(_prepare, _spark, s, dt), dt, quick) for s, dt, quick in _SPARK),
        *(PeerEntry("casadi", f"collocation s={s} Δt={dt:g} generated C",
                    partial(_prepare, _collocation, s, dt), dt, quick)
          for s, dt, quick in _COLLOCATION),
    ]


def _prepare(build: Callable[[int, float], tuple[Any, Array, Any]], stages: int, dt: float) -> Run:
    """Compile a step x → x and return the run that repeats it."""
    step, initial, read = build(stages, dt)
    block = _compiled(step.fold(round(_BLOCK / dt)), f"block_{stages}")

    def run(t_end: float) -> TopState:
        x = initial
        for _ in range(_blocks(t_end)):
            x = block(x)
        end: TopState = read(np.array(x).ravel())
        return end

    return run


def _blocks(t_end: float) -> int:
    """Return how many calls reach t_end.

    Raises
    ------
    Unavailable
        If t_end is no multiple of the time of a call.
    """
    blocks = round(t_end / _BLOCK)
    if abs(blocks * _BLOCK - t_end) > 1e-9 * t_end:
        raise Unavailable(f"goes by {_BLOCK} s, and {t_end:g} s is no number of them")
    return blocks


def _compiled(function: Any, name: str) -> Any:
    """Return a function as CasADi's C, compiled and loaded again."""
    casadi = need("casadi")
    folder = Path(mkdtemp(prefix="gyrospark-casadi-"))
    generator = casadi.CodeGenerator(f"{name}.c")
    generator.add(function)
    generator.generate(f"{folder}/")
    library = folder / f"{name}.so"
    command = [*shlex.split(os.environ.get("CC", "cc")), "-O3", "-march=native", "-fPIC", "-shared",
               str(folder / f"{name}.c"), "-o", str(library), "-lm"]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    if process.returncode:
        raise Unavailable(f"its C does not compile: {shlex.join(command)}")
    return casadi.external(function.name(), str(library))


# ---------------------------------------------------------------- SPARK Gauss-Lobatto


def _spark(stages: int, dt: float) -> tuple[Any, Array, Any]:
    """Return the step of (q, p, unknowns), its start, and a function that reads a state from it."""
    casadi = need("casadi")
    q, p, z = casadi.MX.sym("q", 4), casadi.MX.sym("p", 4), casadi.MX.sym("z", 9 * stages)
    residual, finish = _equations(stages, dt)
    solver = casadi.rootfinder("solve", "fast_newton", residual, {"abstol": 1e-10})
    unknowns = solver(z, casadi.vertcat(q, p))
    x = casadi.vertcat(q, p, z)
    step = casadi.Function("step", [x], [casadi.vertcat(finish(casadi.vertcat(q, p), unknowns),
                                                        unknowns)])
    top = tops()[0]
    H_p, H_q = _derivatives()
    k, k_hat = np.array(H_p(top.q, top.p)).ravel(), -np.array(H_q(top.q, top.p)).ravel()
    guess = np.concatenate([np.tile(k, stages), np.tile(k_hat, stages), np.zeros(stages)])

    def read(x: Array) -> TopState:
        return TopState(x[:4], angular_velocity(x[:4], x[4:8], INERTIA))

    return step, np.concatenate([top.q, top.p, guess]), read


def _derivatives() -> tuple[Any, Any]:
    """Return H_p and H_q of the γ form as CasADi functions of (q, p)."""
    casadi = need("casadi")
    q, p = casadi.SX.sym("q", 4), casadi.SX.sym("p", 4)
    q0, q1, q2, q3 = casadi.vertsplit(q)
    L = casadi.vertcat(casadi.horzcat(-q1, q0, q3, -q2), casadi.horzcat(-q2, -q3, q0, q1),
                       casadi.horzcat(-q3, q2, -q1, q0))
    gamma = parameters()["gamma"]
    inverse = [1 / moment - 1 / gamma for moment in INERTIA]
    turned = L @ p
    H = casadi.dot(p, p) / (8 * gamma) + casadi.dot(casadi.DM(inverse) * turned, turned) / 8
    H += MGL * (q0**2 - q1**2 - q2**2 + q3**2)
    return (casadi.Function("H_p", [q, p], [casadi.gradient(H, p)]),
            casadi.Function("H_q", [q, p], [casadi.gradient(H, q)]))


def _equations(s: int, h: float) -> tuple[Any, Any]:
    """Return the residual r(z, (q, p)) of (B.2) and the end of the step from its solution."""
    casadi = need("casadi")
    numbers = gs.tableau("G-L", s)
    A, A_hat, A_tilde, A_bar = (np.array(getattr(numbers.numeric(30), name), dtype=float)
                                for name in ("A", "A_hat", "A_tilde", "A_bar"))
    b, b_tilde = (np.array(getattr(numbers.numeric(30), n), dtype=float) for n in ("b", "b_tilde"))
    H_p, H_q = _derivatives()
    state, z = casadi.SX.sym("state", 8), casadi.SX.sym("z", 9 * s)
    q, p = state[:4], state[4:]
    K, K_hat = casadi.reshape(z[: 4 * s], 4, s), casadi.reshape(z[4 * s : 8 * s], 4, s)
    Lambda = z[8 * s :]
    ones = casadi.DM.ones(1, s)
    Q, nodes = q @ ones + h * K @ A.T, q @ casadi.DM.ones(1, s + 1) + h * K @ A_bar.T
    force = casadi.horzcat(*(2 * nodes[:, j] * Lambda[j] for j in range(s)))
    P = p @ ones + h * K_hat @ A_hat.T - h * force @ A_tilde[:, :s].T
    rows = [*(K[:, i] - H_p(Q[:, i], P[:, i]) for i in range(s)),
            *(K_hat[:, i] + H_q(Q[:, i], P[:, i]) for i in range(s)),
            *(casadi.dot(nodes[:, j], nodes[:, j]) - 1 for j in range(1, s + 1))]
    residual = casadi.Function("residual", [z, state], [casadi.vertcat(*rows)])
    q1 = q + h * K @ b
    free = p + h * K_hat @ b - h * force @ b_tilde[:s]
    p1 = free - q1 * casadi.dot(q1, free) / casadi.dot(q1, q1)
    end = casadi.Function("end", [state, z], [casadi.vertcat(q1, p1)])
    return residual, end


# ---------------------------------------------------------------- collocation


def _collocation(stages: int, dt: float) -> tuple[Any, Array, Any]:
    """Return the step of CasADi's own collocation at Gauss nodes on Euler's equations."""
    casadi = need("casadi")
    x = casadi.SX.sym("x", 7)
    arguments = [*casadi.vertsplit(x), *INERTIA, MGL]
    right = casadi.vertcat(*euler_equations(*arguments))
    options = {"number_of_finite_elements": 1, "interpolation_order": stages,
               "collocation_scheme": "legendre", "rootfinder": "fast_newton", "simplify": True,
               "rootfinder_options": {"abstol": 1e-10}}
    integrator = casadi.integrator("motion", "collocation", {"x": x, "ode": right}, 0.0, dt,
                                   options)
    state = casadi.MX.sym("state", 7)
    step = casadi.Function("step", [state], [integrator(x0=state)["xf"]])
    start = state_of(tops()[0])
    return step, np.concatenate([start.q, start.omega]), lambda x: TopState(x[:4], x[4:])
