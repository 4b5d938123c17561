"""The rates of a co-moving frame from a state alone: least squares, no run.

    min_ω (H_p − Σ ω_i A_i q)ᵀ H_pp⁻¹ (H_p − Σ ω_i A_i q)

in the metric of the kinetic energy, which knows no units: ω = 𝕀⁻¹J with the locked inertia
𝕀_ij = (A_i q)ᵀ H_pp⁻¹ A_j q. On a relative equilibrium nothing is left over, and ω is its rate.

Three rotations of space do not commute: a frame about another axis than that of the angular
momentum l would lose l. So they go together, about l.

Near an axis of a symmetry A q and J are small and ω is large: the frame fits the velocity of this
instant and nothing else. Whether it does, the acceleration in the frame tells,

    d²q̃/dt² = q̈ − 2 Ω q̇ + Ω² q,    Ω = Σ ω_i A_i,

0 on a relative equilibrium, and |ω||q̇| where the motion passes an axis. ``start_rates`` leaves out
a direction that makes it more than twice as large.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array
from ...core.errors import InputError, StepFailed
from ...core.start import Start
from ..integration.manifest_symmetries import Symmetry

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["Direction", "Velocities", "directions_of", "least_squares", "start_rates"]

#: A direction that makes the acceleration so many times larger is left out.
_FASTER = 2.0
#: Error of a difference for q̈, in units of |q̈| ε^⅓.
_NOISE = 16.0
#: Singular values below this part of the largest are 0.
_RANK = 1e-9


class Direction:
    """A free rate of the frame: of one symmetry, or of three rotations of space about l.

    Attributes
    ----------
    weights : dict of str to float
        Name of each parameter → its part of the rate.
    A : ndarray, shape (n, n)
        The generator.
    """

    def __init__(self, symmetries: list[Symmetry], weights: Array) -> None:
        """Take the sums Σ w_k A_k and the weights w_k of the symmetries by name."""
        self.weights = {s.name: float(w) for s, w in zip(symmetries, weights, strict=True)}
        self.A: Array = sum((w * s.A for s, w in zip(symmetries, weights, strict=True)),
                            np.zeros_like(symmetries[0].A))


def directions_of(
    stepper: Stepper, q: ArrayLike, p: ArrayLike, parameters: Mapping[str, Any]
) -> list[Direction]:
    """Return the free rates of the frame: one per symmetry group that holds at the parameters.

    Three rotations share one rate, along their momenta l; none if l = 0.
    """
    position, momenta = (np.array(x, dtype=float) for x in (q, p))
    directions = []
    for _, group in groupby(stepper.symmetries, key=lambda symmetry: symmetry.group):
        symmetries = list(group)
        if not all(symmetry.holds(parameters) for symmetry in symmetries):
            continue
        weights = np.ones(1)  # a symmetry alone turns at the whole rate
        if len(symmetries) > 1:
            # three rotations do not commute: they turn together about l
            weights = np.array([symmetry.momentum(position, momenta) for symmetry in symmetries])
            size = float(np.linalg.norm(weights))
            if size == 0:
                continue
            weights = weights / size
        directions.append(Direction(symmetries, weights))
    return directions


class Velocities:
    """H_p of states in doubles, from the residual of no step, and its derivative by p."""

    def __init__(self, stepper: Stepper, parameters: Mapping[str, Any], t0: Any = 0.0) -> None:
        """Keep parameters and time for the compiled functions, without the rates of a frame."""
        self._stepper, self._t = stepper, t0
        rates = {symmetry.name for symmetry in stepper.symmetries}
        self._parameters = {name: x for name, x in parameters.items() if name not in rates}
        self.epsilon: float = stepper.binding.epsilon
        self._unknowns_are_state = bool(stepper.manifest.scheme.unknowns_are_state)

    def __call__(self, q: Array, p: Array) -> Array:
        """Return H_p, shape (n,): the negative residual of q at x = 0 for a step of 1 s.

        Unknowns that are the state itself have its values in place of 0.
        """
        n, x = self._stepper.n, np.zeros(self._stepper.unknowns)
        if self._unknowns_are_state:
            x[: 2 * n] = [*q, *p]
        residual = self._stepper.residual(x, q, p, dt=1.0, parameters=self._parameters, t=self._t)
        return -np.array(residual[:n], dtype=float)

    def acceleration(self, q: ArrayLike, p: ArrayLike, dt: Any) -> Array | None:
        """Return q̈ = (H_p(h) − H_p(0))/h, shape (n,), by a step h = Δt ε^⅓.

        Its truncation and its round-off are then about equal. None if that step fails: the run
        itself then raises the error.
        """
        step, h = self._stepper, float(dt) * self.epsilon ** (1 / 3)
        try:
            # such a scheme starts from states on g = 0 alone, where H_p leaves the constraints
            if step.m and not step.manifest.scheme.keeps_momentum_constraint:
                q, p = step.project(q, p, parameters=self._parameters, t=self._t)
            end = step.integrate(Start(q, p, self._parameters, self._t), dt=h, steps=1)
        except (InputError, StepFailed):
            return None
        return np.asarray((self(end.q[-1], end.p[-1]) - self(end.q[0], end.p[0])) / h)

    def root_of_mass(self, q: Array, p: Array) -> Array:
        """Return W with WᵀW = H_pp⁻¹, H_pp by differences: exact where H is quadratic in p.

        q and p have the shape (n,), W the shape (k, n). With H_pp = V diag(λ) Vᵀ it is
        diag(λ^−½) Vᵀ, without the n − k directions in which H_pp has no inertia.
        """
        size = float(np.abs(p).max()) or 1.0
        steps = size * np.eye(len(p))
        H_pp = np.array([self(q, p + e) - self(q, p - e) for e in steps]) / (2 * size)
        eigenvalues, eigenvectors = np.linalg.eigh((H_pp + H_pp.T) / 2)
        usable = eigenvalues > 1e-12 * max(eigenvalues.max(), 0.0)
        return np.asarray((eigenvectors[:, usable] / np.sqrt(eigenvalues[usable])).T)


def least_squares(
    velocities: Velocities, directions: list[Direction], q: ArrayLike, p: ArrayLike
) -> Array:
    """Return the ω that minimises Σ |W (H_p − Σ ω_i A_i q)|² over all rows of q and p, (rows, n).

    A_i are the generators of ``directions``; |W v|² is twice the kinetic energy of velocities v.
    """
    matrices, right_sides = [], []
    for position, momenta in zip(np.atleast_2d(np.array(q, dtype=float)),
                                 np.atleast_2d(np.array(p, dtype=float)), strict=True):
        root = velocities.root_of_mass(position, momenta)
        matrices.append(root @ np.stack([d.A @ position for d in directions], axis=1))
        right_sides.append(root @ velocities(position, momenta))
    rates, *_ = np.linalg.lstsq(np.concatenate(matrices), np.concatenate(right_sides), rcond=_RANK)
    return np.asarray(rates)


def start_rates(
    velocities: Velocities, directions: list[Direction], q: ArrayLike, p: ArrayLike, dt: Any
) -> tuple[Array, list[int]]:
    """Return the rates ω_i that minimise |q̇ − Ω q|, Ω = Σ ω_i A_i, and the directions left out.

    Rates have the shape (directions,), 0 for those that are left out, in rad/s; q and p the shape
    (n,). Norms are taken in the metric of the kinetic energy. The acceleration in the frame is q̈ −
    2 Ω q̇ + Ω² q; directions are left out one by one while this more than halves the acceleration
    in the frame.
    """
    position, momenta = (np.array(x, dtype=float) for x in (q, p))
    root, velocity = velocities.root_of_mass(position, momenta), velocities(position, momenta)
    columns = root @ np.stack([d.A @ position for d in directions], axis=1)

    def rates_without(left_out: list[int]) -> Array:
        """Return the least squares rates, shape (directions,), with 0 for those left out."""
        frame_indices = [i for i in range(len(directions)) if i not in left_out]
        rates = np.zeros(len(directions))
        rates[frame_indices] = np.linalg.lstsq(columns[:, frame_indices], root @ velocity,
                                               rcond=_RANK)[0]
        return rates

    def acceleration_norm(rates: Array) -> float:
        """Return the norm of the acceleration in a frame, in the metric of the kinetic energy."""
        Omega = sum((w * d.A for w, d in zip(rates, directions, strict=True)), 0 * directions[0].A)
        return float(np.linalg.norm(root @ (
            acceleration - 2 * Omega @ velocity + Omega @ (Omega @ position))))

    left_out: list[int] = []
    rates, acceleration = rates_without(left_out), velocities.acceleration(q, p, dt)
    if acceleration is None:
        return rates, left_out
    # accelerations are differences of velocities: less than their round-off is no gain
    noise = _NOISE * velocities.epsilon ** (1 / 3) * float(np.linalg.norm(root @ acceleration))
    # of the directions that are left, the one without which the acceleration is the smallest
    while len(left_out) < len(directions):
        candidates = [[*left_out, i] for i in range(len(directions)) if i not in left_out]
        subset = min(candidates, key=lambda candidate: acceleration_norm(rates_without(candidate)))
        if acceleration_norm(rates) <= _FASTER * acceleration_norm(rates_without(subset)) + noise:
            break
        rates, left_out = rates_without(subset), subset
    return rates, left_out
