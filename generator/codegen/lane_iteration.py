"""The fixed-point iteration of profile ``full``, on lanes: kernels, tables, memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

from ...core.real_types import Real
from ..kernels.c_printer import ON_LANES, CPrinter
from ..kernels.kernel import EmittedKernel, Target, emit_kernel, sums_products
from ..schemes.fast_path import fast_system
from ..schemes.fast_tableau import FastTableau
from ..schemes.step_equations import SparkScheme
from ..systems.repeated_structure import Structure
from .program import Derived, Elements, LaneIteration, Table

__all__ = ["called_functions", "lane_iteration"]


def lane_iteration(derived: Derived, elements: Elements | None) -> tuple[LaneIteration | None, str]:
    """Return the fixed-point iteration of a step on SIMD lanes, of stages or of trajectories.

    The second entry is "", or the reason why there is none: Newton's method takes every step then.
    """
    scheme, real = derived.implicit, derived.real
    # coefficients of the scaled unknowns; IMS and EMS have one mean value and no tables
    tables: dict[str, list[list[Fraction]]] = {}
    even_odd: dict[str, list[list[Fraction]]] = {}
    if scheme.system.velocity_count:
        return None, "reactions of velocity constraints are found by Newton's method"
    if isinstance(scheme, SparkScheme):
        if scheme.exact_energy:
            return None, "exact energy is solved for by Newton's method alone"
        tableau = FastTableau(scheme.tableau)
        if tableau.refusal is not None:
            return None, tableau.refusal
        tables, even_odd = tableau.tables(real), tableau.even_odd_tables(real)
        if not scheme.system.m:  # no constraint nodes
            tables = {name: tables[name] for name in ("mu", "mu_hat", "onward")}
            even_odd = {name: rows for name, rows in even_odd.items() if name in tables}
    iteration = (_iteration_of_kernels(derived) if elements is None
                 else _iteration_of_elements(derived, elements))
    return replace(iteration, tables=_literals(tables, real),
                   even_odd_tables=_literals(even_odd, real)), ""


def _iteration_of_elements(derived: Derived, elements: Elements) -> LaneIteration:
    """Return the iteration with kernels of element templates, without tables.

    W = G H_pp Gᵀ of a sum over elements is factorised at each node: whether it is constant, or a
    multiple of the identity, is not examined.
    """
    structure = Structure(derived.scheme.system)
    constant_count = len(elements.used_constants)
    factor_length = elements.elimination["entries"]
    kernels = [k for k in elements.kernels if k.name.startswith("lanes_")]
    return LaneIteration(
        kernels=[], **called_functions(kernels),
        compensated=any(sums_products(k, prefix="lanes_") for k in kernels),
        factors=derived.scheme.system.m > 0, separable=structure.is_separable,
        affine=structure.is_quadratic,
        history=_history_length(derived),
        memory=_memory_bytes(derived, constant_count, factor_length, single=True),
        batch_memory=_memory_bytes(derived, constant_count, factor_length, single=False))


def _iteration_of_kernels(derived: Derived) -> LaneIteration:
    """Return the iteration with kernels of the whole system, without tables."""
    scheme, real, m = derived.implicit, derived.real, derived.scheme.system.m
    system = fast_system(scheme.system)
    fast_kernels = (system.spark_kernels() if isinstance(scheme, SparkScheme)
                    else system.mean_kernels(scheme))
    # folds, subexpressions of constants of a run, are further members of the struct of constants
    folds = {symbol: f"c->{symbol.name.lstrip('_')}"
             for symbol in system.folds.definitions.values()}
    kernels = [emit_kernel(k, derived.constants, real, Target.lanes(folds)) for k in fast_kernels]
    # lanes copy the constants of a run from the plain numbers, which C has as ``from``
    printer = CPrinter(real, {s: f"from->{s}" for s in scheme.system.parameters})
    # parameters, about as many subexpressions of theirs, and folds
    constant_count = 2 * len(scheme.system.parameters) + len(system.folds.definitions)
    is_constant = m > 0 and system.schur_inverse is not None
    return LaneIteration(
        kernels=kernels,
        folded={symbol.name.lstrip("_"): printer(e)
                for e, symbol in system.folds.definitions.items()},
        **called_functions(kernels),
        compensated=any(sums_products(k, prefix="lanes_") for k in kernels),
        # a constant W is inverted once a run; SPARK factorises it too, for the momentum
        factors=m > 0 and (derived.is_spark or not is_constant),
        constant_schur=is_constant,
        scalar_schur=m > 0 and system.correction is not None,
        separable=system.is_separable,
        shared=len(system.shared_sums),
        affine=system.is_affine,
        history=_history_length(derived),
        memory=_memory_bytes(derived, constant_count, m * m, single=True),
        batch_memory=_memory_bytes(derived, constant_count, m * m, single=False))


def _literals(tables: dict[str, list[list[Fraction]]], real: Real) -> dict[str, Table]:
    """Return name → matrix with each number as a literal of the type in C."""
    return {name: [[real.literal(e) for e in row] for row in matrix]
            for name, matrix in tables.items()}


def called_functions(kernels: Sequence[EmittedKernel]) -> dict[str, Any]:
    """Return the functions that kernels on lanes call: one lane a call, and all lanes a call."""
    names = set[str]().union(*(k.functions for k in kernels))
    return {"functions": sorted(names - ON_LANES), "switches": sorted(names & ON_LANES)}


def _history_length(derived: Derived) -> int:
    """Return the number of past steps that predict the next one: more for least squares (SPARK)."""
    return 32 if derived.implicit.tableau else 16


def _memory_bytes(derived: Derived, constants: int, factor: int, *, single: bool) -> int:
    """Return an upper bound of the bytes of the iteration's state; the C asserts that they suffice.

    ``constants`` is the number of constants of a run, ``factor`` the number of entries of the
    factors of W at a node. ``single``: lanes are stages of one trajectory; else trajectories.
    """
    scheme, real, history = derived.implicit, derived.real, _history_length(derived)
    n, m = scheme.system.n, scheme.system.m
    s, p = (scheme.tableau.s, scheme.tableau.p) if scheme.tableau else (1, 1)
    lanes = 64 // real.bytes if not real.wide else 1  # of AVX-512, the widest registers
    # stages and nodes in blocks of lanes, or one by one with trajectories in the lanes
    blocks, nodes = (-(-s // lanes), -(-p // lanes)) if single else (s, p)
    # Numbers below count registers, the members of the state in ``fixed_point/state.h``, with room
    # to spare; x are the unknowns k, k̂ and λ.
    x = 2 * blocks * n + nodes * m
    # x, the constraint forces C at the stages, Y and D at the nodes, the factors of W
    iterate = x + (blocks + 2 * nodes) * n + nodes * factor
    # mu, mu_hat and onward; nu; nu_tilde; inverse and onward_nodes; which nodes are free
    tables = 3 * s * blocks + s * nodes + p * blocks + 2 * p * nodes + nodes if single else 0
    forced = n if single else s * n
    # the step, and the times of constraints and of forces at the nodes
    constants += 3 + 2 * nodes if scheme.system.is_time_dependent else 0
    state = 5 * n + 3 * blocks  # q, p, their compensation, zeros; h b, h b̂ and h c of the stages
    constraint_state = 4 * m + m * m  # weights of rows, g twice, an impulse, W⁻¹
    past = (history + 1) * x  # unknowns of previous steps, which predict the next
    # 2 REGRESSORS coefficients a block (``predictor/least_squares.h``), where REGRESSORS ≤ s + 30,
    # from six stages on s + 40; two predictions; coefficients of the multipliers
    least_squares = 2 * (s + (30 if s < 6 else 40)) * blocks + 2 * x + 24 if scheme.tableau else 0
    # for q, p and the multipliers: 16 coefficients of a recurrence, and the triangular factor of
    # its fit with the right-hand side; then 24 contraction rates
    recurrence = 3 * (16 + 17 * 17) + 24
    registers = (state + constants + forced + tables + 2 * iterate + past + least_squares
                 + constraint_state + recurrence + 42)  # 42 single numbers
    return registers * lanes * real.bytes + 512
