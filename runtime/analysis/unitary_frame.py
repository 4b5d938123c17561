"""Coordinates of the tangent spaces of T*M: the symplectic form is J, the metric the identity.

The kinetic metric of directions (dq, dp), with the second as unit of time,

    |(dq, dp)|² = dqᵀ M dq + dpᵀ M⁻¹ dp,   M⁻¹ = H_pp,

is compatible with Ω in R²ⁿ, where M^(1/2) dq, M^(-1/2) dp are canonical and orthonormal. It is not
on a tangent space {G dq = 0, f_q dq + f_p dp = 0}. There Ω is a skew matrix W in an orthonormal
basis, and its polar decomposition W = J (WᵀW)^(1/2) gives the nearest compatible metric, with
|y|² = yᵀ (WᵀW)^(1/2) y (McDuff, Salamon, Introduction to Symplectic Topology, section 2.5). A
symplectic map between two such spaces is a symplectic matrix, whose singular values are pairs σ,
1/σ at any time, not in the limit only.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arrays import Array

if TYPE_CHECKING:
    from ..derivatives.binding import DerivativeBinding

__all__ = ["UnitaryFrame", "canonical_form", "isotropic_flag", "tangent_projection"]

#: Least eigenvalue of H_pp in parts of the largest: coordinates without inertia have finite length.
_LEAST = 1e-12
#: Least kinetic energy of the differences that give H_pp, in parts of H: eight bits of it are lost.
#: The momenta grow by a power of two until it is reached.
_SHARE, _LARGER, _MOST_SCALES = 2.0**-8, 2.0**10, 64
#: Round-off of a second difference of H in parts of eps |H|: four sums, of some operations each.
_ROUND_OFF = 64


class UnitaryFrame:
    """Coordinates c of the directions at a state (q, p) at time t; in double.

    Attributes
    ----------
    J : array, shape (2 d, 2 d)
        The symplectic form: orthogonal and skew; d = n − m.
    """

    def __init__(
        self, binding: DerivativeBinding, parameters: dict[str, Any], t: Any, q: Array, p: Array
    ) -> None:
        """Compute the maps c ↔ (dq, dp) and J = |W|^-½ W |W|^-½ of the module.

        Raises LinAlgError where they are not finite.
        """
        n = binding.n
        constraint_rows, projection = tangent_projection(
            binding, binding.module.parameters(parameters, t), q, p)
        eigenvalues, axes = np.linalg.eigh(_inverse_mass(binding, parameters, t, q, p))
        # units in which H_pp is 1: q → H_pp^-½ q, p → H_pp^½ p; a direction without inertia gets a
        # small one, so that there is an inverse
        eigenvalues = np.abs(eigenvalues)
        eigenvalue_floor = max(_LEAST * eigenvalues.max(), np.finfo(float).tiny)
        eigenvalue_roots = np.sqrt(np.maximum(eigenvalues, eigenvalue_floor))
        H_root, H_inverse_root = ((axes * eigenvalue_roots) @ axes.T,
                                  (axes / eigenvalue_roots) @ axes.T)
        to_unit, from_unit = _blocks(H_inverse_root, H_root), _blocks(H_root, H_inverse_root)
        # an orthonormal basis of the tangent space in these units
        normals = (constraint_rows @ from_unit).T
        basis = np.linalg.qr(normals, mode="complete")[0][:, normals.shape[1] :]
        W = basis.T @ canonical_form(n) @ basis
        # |W| = (WᵀW)^½ commutes with W, the symplectic form on the tangent space: so
        # J = |W|^-½ W |W|^-½ is orthogonal, and J² = −1
        _, stretches, rotations = np.linalg.svd(W)
        W_root = (rotations.T * np.sqrt(stretches)) @ rotations
        W_inverse_root = (rotations.T / np.sqrt(stretches)) @ rotations
        self.J = W_inverse_root @ W @ W_inverse_root
        self._to = W_root @ basis.T @ to_unit @ projection
        self._from = from_unit @ basis @ W_inverse_root
        if not all(np.isfinite(matrix).all() for matrix in (self.J, self._to, self._from)):
            raise np.linalg.LinAlgError("The metric of the state is not finite.")

    def coordinates(self, directions: Array) -> Array:
        """Return c of directions (rows q and p, a column each), projected onto the space."""
        coordinates: Array = self._to @ directions.astype(float)
        return coordinates

    def directions(self, c: Array) -> Array:
        """Return the directions with these coordinates."""
        directions: Array = self._from @ c
        return directions


def tangent_projection(
    binding: DerivativeBinding, parameters: Any, q: Array, p: Array
) -> tuple[Array, Array]:
    """Return the normals of the tangent space, (2 m, 2 n), and the projection onto it, (2 n, 2 n).

    Both are in double. Like ``project`` with states, the projection moves dq along Gᵀ and then dp
    along Gᵀ; Ω of directions with G dq = 0 does not change. IMS and EMS need it: their steps keep
    g = 0 but not f = dg/dt = 0.
    """
    n = binding.n
    g, f = (derivatives[:, : 2 * n].astype(float)
            for derivatives in binding.constraint_derivatives(parameters, q, p))
    G, unit = g[:, :n], np.eye(n)
    position_projection = unit - G.T @ np.linalg.solve(G @ G.T, G)
    # dp ← dp − Gᵀ W⁻¹ (f_q dq + f_p dp), W = f_p Gᵀ
    lift = G.T @ np.linalg.inv(f[:, n:] @ G.T)
    projection = _blocks(position_projection, unit - lift @ f[:, n:])
    projection[n:, :n] = -lift @ f[:, :n] @ position_projection
    return np.concatenate([g, f]), projection


def canonical_form(n: int) -> Array:
    """Return Ω with Ω(u, v) = u_q·v_p − u_p·v_q, shape (2 n, 2 n)."""
    form = np.zeros((2 * n, 2 * n))
    form[:n, n:], form[n:, :n] = np.eye(n), -np.eye(n)
    return form


def isotropic_flag(J: Array) -> Array:
    """Return orthonormal columns v_1..v_d, J v_d..J v_1, the first half without J v_i.

    The span of the last 2 d − k is then the Ω-complement of that of the first k. A symplectic
    matrix keeps this, so that the diagonal of R in its QR decomposition is pairs r, 1/r. The
    directions are random, so that they have components along all exponents:

        v ← v − Σ_u (u uᵀ + J u (J u)ᵀ) v   over the earlier u, then v ← v/|v|
    """
    size, random, vectors = len(J), np.random.default_rng(0), list[Array]()
    for _ in range(size // 2):
        v = random.standard_normal(size)
        for _ in range(2):  # once leaves components of round-off over |v|
            for u in vectors:
                v -= u * (u @ v) + J @ u * ((J @ u) @ v)
        vectors.append(v / np.linalg.norm(v))
    # reshaped, because an array of no vectors has one axis
    return np.array([*vectors, *(J @ v for v in reversed(vectors))]).T.reshape(size, size)


def _blocks(first: Array, second: Array) -> Array:
    """Return the matrix with two square blocks of equal size on its diagonal."""
    n = len(first)
    matrix = np.zeros((2 * n, 2 * n))
    matrix[:n, :n], matrix[n:, n:] = first, second
    return matrix


def _inverse_mass(
    binding: DerivativeBinding, parameters: dict[str, Any], t: Any, q: Array, p: Array
) -> Array:
    """Return H_pp, shape (n, n), by second differences: exact to rounding for H quadratic in p.

        H_ij = (H(p + e_i + e_j) − H(p + e_i) − H(p + e_j) + H(p)) / s²,   |e_i| = s

    s is the size of p. Near rest the kinetic energy drowns in the round-off of the potential one: s
    grows until the differences have enough digits, or change by more than round-off, as those of an
    H that is not quadratic do. If no s gives digits, as of an H that is linear in p, the first one
    is kept.
    """
    p_scale = np.float64(np.abs(p.astype(float)).max(initial=0.0))
    with np.errstate(all="ignore"):  # numbers beyond the doubles are infinite, and refused later
        p_scale = p_scale if p_scale**2 else np.float64(1.0)  # the differences divide by its square
        # ``unit`` is |H|/s²: the round-off of the differences is a part of it
        first, unit = _second_differences(binding, parameters, t, q, p, p_scale)
        inverse_mass = first
        for _ in range(_MOST_SCALES):
            size = np.abs(inverse_mass).max()
            if not size < _SHARE * unit:
                return inverse_mass
            p_scale *= _LARGER
            larger, unit_of_larger = _second_differences(binding, parameters, t, q, p, p_scale)
            round_off = _ROUND_OFF * max(binding.primal.epsilon, np.finfo(float).eps) * unit
            if size > round_off and not np.abs(larger - inverse_mass).max() <= 2 * round_off:
                return inverse_mass
            if not np.isfinite(larger).all():
                break
            inverse_mass, unit = larger, unit_of_larger
    return first


def _second_differences(
    binding: DerivativeBinding, parameters: dict[str, Any], t: Any, q: Array, p: Array,
    scale: np.float64
) -> tuple[Array, float]:
    """Return the second differences of H by p of size s = ``scale``, shape (n, n), and max |H|/s².

    They are forward differences, which are H_pp if H is quadratic in p.
    """
    primal, n = binding.primal, binding.n
    # rows: p; p + e_i for each i; p + e_i + e_j for each pair
    momentum_changes = [np.zeros(n), *np.eye(n)]
    index_pairs = [(i, j) for i in range(n) for j in range(i + 1)]
    momentum_changes += [momentum_changes[i + 1] + momentum_changes[j + 1] for i, j in index_pairs]
    momenta = primal.to_real(np.array(momentum_changes) * scale) + p
    H = primal.hamiltonian(primal.parameters(parameters, t),
                           np.repeat(q[None], len(momenta), axis=0), momenta)
    differences = (H - H[0]).astype(float)  # in the stepper's own type: the digits cancel here
    second = np.zeros((n, n))
    for (i, j), energy in zip(index_pairs, differences[n + 1 :], strict=True):
        second[i, j] = second[j, i] = (
            energy - differences[i + 1] - differences[j + 1]) / scale**2
    return second, float(np.abs(H).max() / scale**2)
