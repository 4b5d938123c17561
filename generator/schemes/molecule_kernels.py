"""Kernels of many equal molecules: vectors that a molecule carries, and forces of a pair.

A kick of all molecules takes three loops: over molecules, the vectors v = x + R(q) r or R(q) r;
over pairs, the forces −∂V/∂v on both; over molecules, the torque Σ (R r) × f and the force Σ f of
the points. Source: M. P. Allen and D. J. Tildesley, Computer Simulation of Liquids, chapter 3.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import sympy as sp

from ..kernels.statements import Kernel
from ..multibody.rigid_body import rotation_matrix
from ..symbolic.shared_subexpressions import share
from ..systems.molecular_system import MolecularSystem

__all__ = ["molecule_kernels"]


def molecule_kernels(
    system: MolecularSystem, hoisted: Callable[[Sequence[sp.Expr]], list[sp.Expr]]
) -> list[Kernel]:
    """Return the kernels of a kick and of the potential; ``hoisted`` sets constants of the run."""
    pair, q = system.pair, list(system.q)
    r = [_turned(system, vector.r) for vector in pair.vectors]
    x = system.layout.x
    vectors = [x[k] + e if vector.is_point else e
               for vector, turned in zip(pair.vectors, r, strict=True)
               for k, e in enumerate(turned)]
    force = [sp.Symbol(f"_f{k}", real=True) for k in range(3 * len(r))]
    rows = [sp.Matrix(force[3 * k : 3 * k + 3]) for k in range(len(r))]
    torque = sum((sp.Matrix(turned).cross(f) for turned, f in zip(r, rows, strict=True)),
                 sp.zeros(3, 1))
    pull = sum((f for vector, f in zip(pair.vectors, rows, strict=True) if vector.is_point),
               sp.zeros(3, 1))
    at = {"a": pair.first, "b": pair.second}
    forces, count = hoisted(pair.forces), len(force)
    return [
        Kernel("molecule_vectors", "points and vectors of a molecule in space", {"q": q},
               {"v": hoisted(vectors)}),
        Kernel("molecule_kick", "torque and force of the forces at these points and vectors",
               {"q": q, "f": force}, {"rate": hoisted([*torque, *pull])}),
        Kernel("pair_force", "forces of a pair: on molecule a, and on molecule b", at,
               {"on_a": forces[:count], "on_b": forces[count:]}),
        Kernel("pair_energy", "potential of a pair", at, {"V": hoisted([pair.V])[0]}),
    ]


def _turned(system: MolecularSystem, r: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Return R(q) r, temporaries of the C."""
    R = rotation_matrix(system.layout.q)
    return [share(e) for e in R * sp.Matrix(r)]
