"""The model file of one body with a fixed point: [body], potential, [start] attitude and rotation.

Formulas know q0..q3, R11..R33 (R(q), body to space axes), I1..I3 (J11..J33 of an inertia tensor),
mass if it is given, and the file's parameters; torques and quantities know p0..p3, omega1..omega3
(body axes) and t as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import chain
from typing import Any, NamedTuple, cast

import sympy as sp
from mpmath import mp

from ...core.errors import InputError
from ...core.exact_numbers import Rounded, exact
from ...core.inertia import (
    REPS,
    Inertia,
    Moments,
    as_inertia,
    inertia_rows,
    inverse_entries,
    is_tensor,
    quaternion_product,
    warn_of_degrees,
)
from ...core.registry import RULES
from ...core.warnings import warn
from ..multibody import initial_poses, rigid_body
from ..multibody.model import Model, exact_array
from ..multibody.rigid_body import INVERSE, Rep, body_system, left_matrix, moments, p, q
from ..parsing.grammar import ANGLES, RATES
from .common_tables import Formulas, run_length
from .toml_tables import TomlTable

__all__ = ["ATTITUDES", "from_euler", "inertia_numbers", "momentum", "read_attitude", "read_body",
           "read_rep", "unit"]

ATTITUDES = ("quaternion", "euler", "rotation")


class _Formulas(NamedTuple):
    """The formulas of a file: V in J, torque in body axes in N m, quantities, and σ = dt/dτ."""

    potential: sp.Expr
    torque: list[sp.Expr]  # three, or none
    quantities: dict[str, sp.Expr]
    time_scales: list[sp.Expr]  # one, or none


def read_body(content: TomlTable, name: str, formulas: Formulas, rep: str | None) -> Model:
    """Return the model of a file with [body]; ``rep``, unless None, replaces the file's.

    Raises InputError with file, key and cure.
    """
    content.allow("name", "description", "frame", "potential", "body", "parameters", "inputs",
                  "start", "run", "quantities", "forces", "events", "units", "time_scale")
    body = content.table("body")
    body.allow("inertia", "mass", "rep", *REPS)
    body.require("inertia")
    representation = read_rep(body) if rep is None else rep
    inertia = _inertia(body)
    has_tensor = is_tensor(inertia)
    has_rule = body.content.get(representation) in RULES
    # {"gamma" or "alpha": value}; {} if none is given, or a rule computes it when a run begins
    gamma_or_alpha = {} if has_rule else _gamma_or_alpha(body, representation)
    # ``formulas`` then knows the mass, and the entries of J
    _add_mass(body, formulas)
    if has_tensor:
        _add_tensor(inertia, formulas)
    # scales: the time scale σ, or nothing
    potential, torque, quantities, scales = _read_formulas(content, formulas, has_tensor)
    system_symbol_of, values = formulas.in_use(
        [potential, *torque, *quantities.values(), *scales])
    values |= gamma_or_alpha | _inertia_values(inertia)
    system = body_system(
        name,
        cast("Rep", representation),
        potential.xreplace(system_symbol_of),
        list(system_symbol_of.values()),
        torque=[e.xreplace(system_symbol_of) for e in torque],
        quantities={key: e.xreplace(system_symbol_of) for key, e in quantities.items()},
        tensor=has_tensor,
        time_scale=scales[0].xreplace(system_symbol_of) if scales else None,
    )
    # named neither in a formula nor in the arithmetic text of a number, such as "mass*2"
    if "mass" in body and "mass" not in formulas.mentioned | formulas.numbers.values.mentioned:
        warn("[body] mass is in no formula: a weight needs a potential, such as "
             '"mass*9.81*0.04*R33".')
    q0, p0 = _start(content.table("start"), inertia)
    return Model(system, values, exact_array(q0), exact_array(p0), bodies={representation: inertia},
                 rules={representation: body.text(representation)} if has_rule else {},
                 units={"mass": "kg"} if "mass" in values else {},
                 **run_length(content))


def _inertia_values(inertia: Inertia) -> dict[str, float]:
    """Return the parameters of the kinetic energy: three moments, or of a tensor J the J⁻¹ in H."""
    if is_tensor(inertia):
        return dict(zip(map(str, INVERSE), inverse_entries(inertia), strict=True))
    return dict(zip(map(str, moments), cast("Moments", inertia), strict=True))


def _read_formulas(content: TomlTable, formulas: Formulas, has_tensor: bool) -> _Formulas:
    """Return the formulas of a file with [body].

    A potential may contain the attitude; torques, quantities and the time scale also the motion.
    """
    forces = content.table("forces")
    # the moments of inertia; the entries of a tensor are among the parameters
    letters = () if has_tensor else moments
    position = _position_symbols(letters)
    # t is the time, unless the file has a parameter of this name
    symbols = position if "t" in formulas.parameters else position | {"t": rigid_body.time}
    potential = sp.Integer(0)
    if "potential" in content:
        potential = formulas.read(content, "potential", content.formula("potential"), symbols,
                                  letters)
    motion = position | _motion_symbols(INVERSE if has_tensor else moments)
    forces.allow("torque")
    torque = formulas.read_all(forces, "torque", motion, letters, count=3) if (
        "torque" in forces) else []
    quantities = formulas.quantities(motion, letters)
    scales = [formulas.read(content, "time_scale", content.formula("time_scale"), motion, letters)
              ] if "time_scale" in content else []
    return _Formulas(potential, torque, quantities, scales)


def read_rep(body: TomlTable) -> str:
    """Return the representation of a table; refuse γ or α of the other one alone."""
    rep = body.choice("rep", REPS, "gamma")
    for other in REPS:
        if other in body and rep not in body:
            raise body.error(other, f"belongs to rep = {other!r}, and rep is {rep!r}; write {rep}, "
                                    f"or rep = {other!r}.")
    return rep


def _inertia(body: TomlTable) -> Inertia:
    """Return the three principal moments, or the tensor, of a table, in kg m²."""
    try:
        return as_inertia(inertia_numbers(body), "inertia")
    except InputError as problem:
        raise body.error("inertia", f"cannot be used: {problem}") from None


def inertia_numbers(body: TomlTable) -> list[Any]:
    """Return the numbers of an inertia under the key ``inertia``: three, or three rows of three."""
    return body.matrix("inertia", 3) if body.is_matrix("inertia") else body.vector("inertia", 3)


def _gamma_or_alpha(body: TomlTable, rep: str) -> dict[str, float]:
    """Return {"gamma" or "alpha": value in kg m²}, {} if it is not given; refuse 0."""
    if rep not in body:
        return {}
    if body.number(rep) == 0:
        raise body.error(rep, "is 0, and the kinetic energy divides by it; write another number.")
    return {rep: body.number(rep)}


def _add_mass(body: TomlTable, formulas: Formulas) -> None:
    """Make the mass, if it is given, a parameter of the formulas; refuse one that is not above 0.
    """
    if "mass" not in body:
        return
    if body.number("mass") <= 0:
        raise body.error("mass", f"is {body.number('mass')}; write a mass above 0, in kg.")
    if "mass" in formulas.parameters:
        raise body.error("mass", "is among [parameters] too; give it once.")
    formulas.numbers.values["mass"] = body.number("mass")
    formulas.parameters["mass"] = sp.Symbol("mass", real=True)


def _add_tensor(inertia: Inertia, formulas: Formulas) -> None:
    """Make the entries J11 … J33 of a tensor of inertia parameters of the formulas."""
    entries = chain.from_iterable(inertia_rows(inertia))
    for symbol, value in zip(rigid_body.tensor_symbols(), entries, strict=True):
        formulas.numbers.values[str(symbol)] = value
        formulas.parameters[str(symbol)] = symbol


def _position_symbols(letters: Sequence[sp.Symbol]) -> dict[str, sp.Expr]:
    """Return name → expression for formulas of the attitude: q0…, ``letters`` and R11…R33."""
    R = rigid_body.rotation_matrix(q)
    entries = {f"R{i + 1}{j + 1}": R[i, j] for i in range(3) for j in range(3)}
    return {str(symbol): symbol for symbol in (*q, *letters)} | entries


def _motion_symbols(inertia: Sequence[sp.Symbol]) -> dict[str, sp.Expr]:
    """Return name → expression for formulas of the motion: p0…, t and omega1…omega3."""
    omega = rigid_body.angular_velocity(inertia=inertia)
    return {str(symbol): symbol for symbol in (*p, rigid_body.time)} | {
        f"omega{i}": e for i, e in enumerate(omega, 1)}


def _start(start: TomlTable, inertia: Inertia) -> tuple[list[float], list[float]]:
    """Return q and p at t = 0, four numbers each, of the table [start]."""
    start.allow(*ATTITUDES, "angular_velocity")
    start.require("angular_velocity")
    q0 = read_attitude(start)
    if q0 is None:
        raise start.error("attitude", f"is missing; give one of {', '.join(ATTITUDES)}.")
    return q0, momentum(q0, start.vector("angular_velocity", 3, RATES), inertia)


def read_attitude(table: TomlTable) -> list[float] | None:
    """Return the unit quaternion of a table with quaternion, euler or rotation; None without one.

    Raises InputError for several of them, and for numbers that are no attitude.
    """
    keys = [key for key in ATTITUDES if key in table]
    if not keys:
        return None
    if len(keys) > 1:
        raise table.error("attitude", f"is given as {' and '.join(keys)}; give one of them.")
    key = keys[0]
    if key == "euler":
        angles = table.vector(key, 3, ANGLES)
        if table.is_plain(key):  # numbers without a unit are radians; large ones look like degrees
            degrees = ", ".join(f'"{x:.6g} deg"' for x in angles)
            warn_of_degrees(f"{table.where}euler", angles, cure=f"[{degrees}]")
        return from_euler(*angles)
    quaternion = table.vector(key, 4) if key == "quaternion" else None
    matrix = table.matrix(key, 3) if key == "rotation" else None
    try:
        R = initial_poses.attitude(table.where.strip(" ,"), quaternion, matrix)
    except InputError as problem:
        raise table.error(key, f"is no attitude: {problem}") from None
    return unit(quaternion) if quaternion else R.tolist()


#: Digits of the arithmetic in which attitudes and momenta are computed: more than the 36 that the
#: widest type of steppers, float128, can tell apart.
_DIGITS = 50


def from_euler(phi: float, theta: float, psi: float) -> list[float]:
    """Return the quaternion of R_z(φ) R_x(θ) R_z(ψ), (81) of the paper; angles in rad."""
    with mp.workdps(_DIGITS):
        (a, b), (c, d), (e, f) = ((mp.cos(x), mp.sin(x)) for x in
                                  (_mpf(angle) / 2 for angle in (phi, theta, psi)))
        return _round_to_doubles(quaternion_product([a, 0, 0, b], [c, d, 0, 0], [e, 0, 0, f]))


def unit(quaternion: Sequence[float]) -> list[float]:
    """Return q/|q| of a quaternion that is not 0, computed in 50 digits."""
    with mp.workdps(_DIGITS):
        entries = [_mpf(x) for x in quaternion]
        size = mp.sqrt(sum(x * x for x in entries))
        return _round_to_doubles([x / size for x in entries])


def _mpf(value: float) -> Any:
    """Return a number of a file as mpmath's, with all digits that the file has."""
    number = exact(value)
    assert isinstance(number, Fraction)
    return mp.mpf(number.numerator) / number.denominator


def _round_to_doubles(values: Sequence[Any]) -> list[float]:
    """Round numbers of mpmath to doubles that keep the exact value."""
    return [Rounded(x) for x in map(exact, values) if isinstance(x, Fraction)]


def momentum(q: Sequence[float], omega: Sequence[float], inertia: Inertia) -> list[float]:
    """Return p = 2 L(q)ᵀ J Ω, (82) of the paper, Ω in body axes; qᵀp = 0, as L(q) q = 0."""
    with mp.workdps(_DIGITS):
        l = [sum(_mpf(I) * _mpf(x) for I, x in zip(row, omega, strict=True))  # noqa: E741
             for row in inertia_rows(inertia)]
        columns = left_matrix([_mpf(x) for x in q]).T.tolist()
        return _round_to_doubles([2 * sum(mp.mpf(a) * b for a, b in zip(column, l, strict=True))
                                  for column in columns])
