"""Additional kernels of the derivatives of a step.

The linearised equations of a step (docs/theory/derivatives.md) have second derivatives of H and of
g, which Newton's method has already, and derivatives by the constants of a run and by the time.
Constants are functions of the parameters; their derivatives are applied once a run, so every
kernel here has one column for each constant, and behind them columns for the time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import sympy as sp

from ..kernels.statements import Kernel
from ..symbolic.derivatives import derivative, slopes
from ..symbolic.shared_subexpressions import share_repeated, tree_size
from ..symbolic.switching_functions import switches_of
from ..systems.jacobians import jacobian, transposed_product
from ..systems.lagrangian import LagrangianSystem
from ..systems.system import System
from ..systems.time_scale import ScaledSystem
from .lagrangian_midpoint import LagrangianEMS
from .splitting_scheme import SplittingScheme
from .step_equations import MeanScheme, SparkScheme
from .system_differences import TIME_STEP, time_input, vector

__all__ = [
    "derivative_kernels",
    "derivative_rows",
    "flow_transposes",
    "impact_derivatives",
    "quantity_derivatives",
    "quantity_rates",
    "time_columns",
]

Rows = list[list[sp.Expr]]

#: Nodes of quantities, times the columns of their derivatives, up to which these are generated.
_LARGEST_QUANTITIES = 50_000


def time_columns(scheme: SparkScheme | MeanScheme | SplittingScheme) -> list[sp.Symbol]:
    """Return the columns after the constants: t, and Δt of mean values if H or g depends on time.

    A system without explicit time has none.
    """
    system = scheme.system
    if system.time is None or not system.is_nonautonomous:
        return []
    between = isinstance(scheme, MeanScheme) and system.is_time_dependent
    return [system.time, TIME_STEP] if between else [system.time]


def derivative_kernels(
    scheme: SparkScheme | MeanScheme | SplittingScheme, columns: Sequence[sp.Symbol]
) -> list[Kernel]:
    """Return the kernels of a scheme, written out in full.

    Parameters
    ----------
    scheme : SparkScheme, MeanScheme or SplittingScheme
        Of any system without element templates.
    columns : sequence of Symbol
        Constants of the run, then ``time_columns``.
    """
    if isinstance(scheme, SplittingScheme):
        return _constraint_kernels(scheme.system, columns) if scheme.system.m else []
    if isinstance(scheme, SparkScheme):
        return _spark_kernels(scheme.system, columns)
    return _mean_kernels(scheme, columns)


def flow_transposes(scheme: SplittingScheme, columns: Sequence[sp.Symbol]) -> list[Kernel]:
    """Return the transposed derivatives of the kernels of a step of a splitting.

    For y = f(x, c), a kernel takes the cotangent ȳ and returns x̄ = f_xᵀ ȳ and c̄ = f_cᵀ ȳ, with the
    constants c of ``columns``.
    """
    constants = {"c": list(columns)}
    kernels = {k.name: k for k in (*scheme.kernels(), *scheme.flow_kernels(work=False))}
    kick, free_motion = kernels["kick_rate"], kernels["free_velocity"]
    # rates and axes of rotations are functions of the constants alone
    of_constants = [name for name in ("flow_rates", "axis_directions", "space_rates")
                    if name in kernels]
    # the change of momenta is the rates of the kick times its duration, and the cotangent of the
    # duration is the value
    return [_transpose(kick, {**kick.inputs, **constants}, with_value=True),
            _transpose(free_motion, {**free_motion.inputs, **constants}),
            *(_transpose(kernels[name], constants) for name in of_constants)]


def _transpose(
    kernel: Kernel, variables: Mapping[str, Sequence[sp.Symbol]], *, with_value: bool = False
) -> Kernel:
    """Return the kernel of Σ w ∂(output)/∂x for each x of ``variables``: reverse differentiation.

    ``variables`` has arrays by name; ``with_value`` adds Σ w (output). Weights w of an output y
    are in the array ``y_bar``, the results of an array x in ``x_bar``.
    """
    entries_of = {name: _flat(output) for name, output in kernel.outputs.items()}
    weights = {f"{name}_bar": vector(f"_w_{name}", len(entries))
               for name, entries in entries_of.items()}
    # equal subexpressions of different outputs are differentiated once
    shared_entries = share_repeated([e for entries in entries_of.values() for e in entries])
    flat_weights = [w for symbols in weights.values() for w in symbols]
    total = sp.Add(*(w * e for w, e in zip(flat_weights, shared_entries, strict=True)))
    flat_variables = tuple(x for symbols in variables.values() for x in symbols)
    cotangents = iter(slopes(total, flat_variables))
    outputs: dict[str, Any] = {f"{name}_bar": [next(cotangents) for _ in symbols]
                               for name, symbols in variables.items()}
    if with_value:
        outputs["value"] = [total]
    return Kernel(f"{kernel.name}_transposed", f"transposed derivatives of {kernel.name}",
                  {**kernel.inputs, **weights}, outputs)


def _flat(output: Sequence[Any]) -> list[sp.Expr]:
    """Return the entries of a vector or matrix, row by row."""
    entries: list[sp.Expr] = []
    for row in output:
        entries += row if isinstance(row, list | tuple) else [row]
    return entries


def quantity_derivatives(system: System) -> Kernel | None:
    """Return the kernel of the derivatives of quantities by q, p, the parameters and the time.

    In scaled time the last row is H: the momentum of the time starts at −H. None without
    quantities, or if their derivatives would cost more than the derivatives of the steps.
    """
    expressions = list(system.quantities.values())
    # a column for the time in any case, of zeros for a symbol that nothing contains
    time = [sp.Dummy() if system.time is None else system.time]
    columns = [*system.q, *system.p, *system.parameters, *time]
    if isinstance(system, ScaledSystem):
        expressions.append(system.energy)
    elif not expressions or tree_size(expressions) * len(columns) > _LARGEST_QUANTITIES:
        return None
    times = {} if system.time is None else {"t": time}
    return Kernel("quantity_derivatives", "derivatives of quantities by q, p, parameters and time",
                  {**times, "q": list(system.q), "p": list(system.p)},
                  {"rows": derivative_rows(expressions, columns)})


def quantity_rates(system: System) -> Kernel | None:
    """Return the kernel of Σ ∂(quantity)/∂x dx over q, p and the time; None without quantities."""
    if not system.quantities:
        return None
    dq, dp, (dt,) = vector("dq", system.n), vector("dp", system.n), vector("dt", 1)
    step = dict(zip([*system.q, *system.p], [*dq, *dp], strict=True))
    times: dict[str, Any] = {}
    if system.time is not None:
        step[system.time] = dt
        times = {"t": [system.time]}
    rates = [sp.Add(*(derivative(e, x) * step[x] for x in step if e.has(x)))
             for e in system.quantities.values()]
    return Kernel("quantity_rates", "derivatives of quantities along (dq, dp, dt)",
                  {**times, "q": list(system.q), "p": list(system.p), "dq": dq, "dp": dp,
                   "dt": [dt]}, {"rates": rates})


def impact_derivatives(system: System) -> Kernel | None:
    """Return the kernel from which the derivatives of the law of impacts are assembled.

    The gaps φ are the quantities of q and the time. ``forces`` are the derivatives of
    φ_qᵀ μ + g_qᵀ λ by q, the parameters and the time, ``rates`` the derivatives of φ_q H_p + φ_t by
    q, p, the parameters and the time. None without gaps, or if they are too long.
    """
    # a quantity of p or of inputs is no gap; its place among the gaps is kept by a 0
    not_of_gaps = {*system.p, *system.inputs}
    gaps = [e if e.free_symbols.isdisjoint(not_of_gaps) else sp.Integer(0)
            for e in system.quantities.values()]
    time = sp.Dummy() if system.time is None else system.time
    columns = [*system.parameters, time]
    velocities = [derivative(system.H, p) for p in system.p]
    rates: list[sp.Expr] = []
    for gap in gaps:  # φ_q H_p + φ_t
        terms = [derivative(gap, x) * v for x, v in zip(system.q, velocities, strict=True)]
        rates.append(sp.Add(derivative(gap, time), *terms))
    if not any(gaps) or tree_size(rates) * len(columns) > _LARGEST_QUANTITIES:
        return None
    mu, lam = vector("mu", len(gaps)), vector("lambda", system.m)
    weighted = list(zip([*gaps, *system.constraints], [*mu, *lam], strict=True))
    forces = [sp.Add(*(derivative(e, x) * weight for e, weight in weighted)) for x in system.q]
    inputs = {"t": [time], "q": list(system.q), "p": list(system.p), "mu": mu}
    if lam:  # C has no arrays of length 0
        inputs["lambda"] = lam
    return Kernel("impact_derivatives", "derivatives of the impulses and rates of gaps", inputs,
                  {"forces": derivative_rows(forces, [*system.q, *columns]),
                   "rates": derivative_rows(rates, [*system.q, *system.p, *columns])})


def switch_kernel(system: System) -> Kernel | None:
    """Return the kernel of the switching functions of H and the forces; None if there are none.

    Those that depend on anything but q, p, parameters and the time are left out, as are those that
    depend on parameters alone, which do not change in a run.
    """
    time = [sp.Dummy() if system.time is None else system.time]
    states = {*system.q, *system.p, *time}
    symbols = states | ({*system.parameters} - {*system.inputs})
    switches = [w for w in switches_of([system.H, *system.forces])
                if w.free_symbols <= symbols and not w.free_symbols.isdisjoint(states)]
    if not switches:
        return None
    return Kernel("switching_functions", "what is negative on one side of a switch and positive on "
                  "the other", {"t": time, "q": list(system.q), "p": list(system.p)},
                  {"w": switches})


def derivative_rows(expressions: Sequence[sp.Expr], columns: Sequence[sp.Symbol]) -> Rows:
    """Return the derivative of each expression (row) by each symbol (column), in plain form."""
    return [[derivative(e, x) for x in columns] for e in expressions]


def _spark_kernels(system: System, columns: Sequence[sp.Symbol]) -> list[Kernel]:
    """Return the kernels of SPARK methods: rates and constraint forces by constants of the run."""
    if not system.m:
        return _rate_kernels(system, columns)
    q, lam = list(system.q), vector("lambda", system.m)
    return [
        *_rate_kernels(system, columns),
        Kernel("force_by_constants", "d(G^T lambda)/dc", {"q": q, "lambda": lam},
               {"force_c": derivative_rows(transposed_product(system.G, lam), columns)}),
        *_constraint_kernels(system, columns),
    ]


def _constraint_kernels(system: System, columns: Sequence[sp.Symbol]) -> list[Kernel]:
    """Return the kernels of the manifold g = 0, f = 0: g_c, f_q, f_p and f_c by constants c.

    For a Lagrangian, f = G v + g_t is a function of q and v, and its derivatives are at fixed v.
    """
    q = {"q": list(system.q)}
    by_constants = Kernel("constraint_by_constants", "dg/dc", q,
                          {"g_c": derivative_rows(system.constraints, columns)})
    if isinstance(system, LagrangianSystem):
        hidden = Kernel("velocity_constraint", "derivatives of G v + g_t by q and c at fixed v",
                        q | {"v": list(system.velocities)},
                        {"f_q": jacobian(system.hidden, system.q),
                         "f_c": derivative_rows(system.hidden, columns)})
    else:
        hidden = Kernel("hidden_derivative", "derivatives of f(q, p) by q, p and c",
                        q | {"p": list(system.p)},
                        {"f_q": jacobian(system.hidden, system.q),
                         "f_p": jacobian(system.hidden, system.p),
                         "f_c": derivative_rows(system.hidden, columns)})
    return [by_constants, hidden]


def _rate_kernels(system: System, columns: Sequence[sp.Symbol]) -> list[Kernel]:
    """Return the kernels of rates at one state by constants: (H_q − F)_c and H_pc.

    For a Lagrangian they are L_vc and (L_q + F)_c at fixed v.
    """
    if isinstance(system, LagrangianSystem):
        arguments = {"q": list(system.q), "v": list(system.velocities)}
        return [
            Kernel("momentum_by_constants", "d(dL/dv)/dc at fixed v", arguments,
                   {"momentum_c": derivative_rows(system.L_v, columns)},
                   factors=not system.is_long),
            Kernel("generalised_force_by_constants", "d(dL/dq + F)/dc at fixed v",
                   arguments | time_input(system),
                   {"R_c": derivative_rows(system.generalised_force, columns)},
                   factors=not system.is_long),
        ]
    state = {"q": list(system.q), "p": list(system.p), **time_input(system)}
    return [Kernel("rates_by_constants", "derivatives of dH/dq - F and dH/dp by constants", state,
                   {"H_qc": derivative_rows(system.minus_p_rate, columns),
                    "H_pc": derivative_rows(system.H_p, columns)})]


def _mean_kernels(scheme: MeanScheme, columns: Sequence[sp.Symbol]) -> list[Kernel]:
    """Return the kernels of IMS and EMS: derivatives of mean rates and of the constraint force.

    The mean rates D_p and F − D_q and the force Ḡᵀ λ, with the mean Ḡ of g_q over a step, are
    differentiated by the means q̄ and p̄ at fixed increments, and by constants.
    """
    system = scheme.system
    (qm, pm), (dq, dp) = scheme.means, scheme.differences
    if isinstance(scheme, LagrangianEMS):
        kernels = _discrete_lagrangian_kernels(scheme, columns)
    elif isinstance(system, LagrangianSystem):
        kernels = _rate_kernels(system, columns)  # IMS of a Lagrangian: the rates at the midpoint
    else:
        D_q, D_p = scheme.mean_rates
        arguments: dict[str, Any] = {"qm": qm, "pm": pm, "dq": dq, "dp": dp, **time_input(system)}
        kernels = [Kernel(
            "mean_rates_derivative", "derivatives of D_q - F and D_p by qm, pm and constants",
            arguments,
            {"D_qq": jacobian(D_q, qm), "D_qp": jacobian(D_q, pm), "D_pq": jacobian(D_p, qm),
             "D_pp": jacobian(D_p, pm), "D_qc": derivative_rows(D_q, columns),
             "D_pc": derivative_rows(D_p, columns)})]
    if not system.m:
        return kernels
    lam = vector("lambda", system.m)
    force = transposed_product(scheme.mean_constraint, lam)
    between: dict[str, Any] = {"qm": qm, "dq": dq, "lambda": lam}
    return [
        *kernels,
        Kernel("mean_constraint_by_start", "derivatives of G^T lambda by qm and constants",
               between, {"K": jacobian(force, qm), "force_c": derivative_rows(force, columns)}),
        *_constraint_kernels(system, columns),
    ]


def _discrete_lagrangian_kernels(
    scheme: LagrangianEMS, columns: Sequence[sp.Symbol]
) -> list[Kernel]:
    """Return the derivatives of L_v and of the mean generalised force R of EMS of a Lagrangian.

    R depends on the means of q, the velocities v0 and v1 of both ends, and constants; derivatives
    are by those in ``columns``.
    """
    system, (v0, v1) = scheme.system, scheme.ends
    arguments = {"qm": scheme.means.q, "dq": scheme.differences.q, "v0": v0, "v1": v1}
    R = scheme.mean_generalised_force
    momentum = {"q": list(system.q), "v": list(system.velocities)}
    kernels = [
        Kernel("momentum_by_constants", "d(dL/dv)/dc at fixed v", momentum,
               {"momentum_c": derivative_rows(system.L_v, columns)}),
        Kernel("mean_generalised_force_by_state", "derivatives of R by qm, v0, v1 and constants",
               arguments | time_input(system),
               {"R_q": derivative_rows(R, scheme.means.q), "R_v0": derivative_rows(R, v0),
                "R_v1": derivative_rows(R, v1), "R_c": derivative_rows(R, columns)}),
    ]
    return [Kernel(k.name, k.doc, k.inputs, k.outputs, factors=not system.is_long)
            for k in kernels]
