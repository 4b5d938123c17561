"""Checks of the numbers of a rigid body: moments of inertia, attitude, angles.

What no body can have is refused. What was perhaps meant otherwise is taken, with a remark that
names the value and the cure: angles in degrees, a quaternion with the scalar last or of another
length than 1, moments that only rounding can have made.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Any, Literal, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from .arguments import few, shown
from .arrays import Array, Floats
from .errors import InputError
from .exact_numbers import Rounded, exact, knowing
from .warnings import warn

__all__ = ["REPS", "Inertia", "InertiaLike", "Moments", "RepName", "Tensor", "as_inertia",
           "as_moments", "as_moments_or_tensor", "inertia_matrix", "inertia_rows",
           "inverse_entries", "is_number", "is_tensor", "moments_of", "quaternion_of_matrix",
           "quaternion_product", "real_array", "refuse_impossible_inertias", "tensor_of_inverse",
           "unit_quaternions", "warn_of_degrees", "warn_of_shift"]

#: The two representations of the inertia, by the parameter that each adds; ``RepName`` are its
#: entries, for editors and type checkers.
RepName = Literal["alpha", "gamma"]
REPS: tuple[RepName, ...] = ("alpha", "gamma")
Moments: TypeAlias = tuple[float, float, float]
Tensor: TypeAlias = tuple[Moments, Moments, Moments]
#: Three principal moments, or the tensor in body axes.
Inertia: TypeAlias = Moments | Tensor
#: What callers give for one.
InertiaLike: TypeAlias = Sequence[float] | Sequence[Sequence[float]] | NDArray[Any]

#: Numbers written with two digits are right to 5 %: by so much the largest moment may exceed the
#: sum of the others.
_TWO_DIGITS = 0.05
_EPS = float(np.finfo(float).eps)
#: Bodies up to which floats are faster than arrays.
_FEW = 8


# ---------------------------------------------------------------- moments of inertia


def real_array(value: Any) -> Floats | None:
    """Return real numbers of whatever type and shape as floats; None for anything else."""
    if isinstance(value, (str, bytes, set, frozenset, Mapping)):
        return None
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiuO":  # of floats, integers and objects
            return None
        # float() would take these for numbers, or None for NaN
        not_numbers = (str, bytes, bool, type(None))
        if array.dtype.kind == "O" and any(isinstance(x, not_numbers) for x in array.flat):
            return None
        return np.array(array, dtype=float)
    except (TypeError, ValueError, OverflowError):  # ragged, symbols, beyond 1e308
        return None


def is_number(value: Any) -> bool:
    """Whether a value is one real number, not several and not text."""
    array = real_array(value)
    return array is not None and array.ndim == 0


def is_tensor(inertia: Any) -> bool:
    """Whether an inertia is given as rows of numbers, a tensor."""
    array = real_array(inertia)
    return array is not None and array.ndim == 2


def as_inertia(inertia: Any, label: str = "inertia") -> Inertia:
    """Return the inertia of a body in kg m²: three principal moments, or a tensor in body axes.

    A tensor that is diagonal comes back as its three moments. Raises InputError unless it is three
    numbers above 0, or a symmetric positive definite 3 × 3 matrix, and such as a body can have: no
    moment exceeds the sum of the other two.
    """
    checked = as_moments_or_tensor(inertia, label)
    I1, I2, I3 = sorted(moments_of(checked))
    # ∫(x² + y²) dm ≤ ∫(y² + z²) dm + ∫(x² + z²) dm; equal for a plate, to the eigenvalues' rounding
    excess = I3 - (I1 + I2)
    if excess > 8 * _EPS * I3:
        sentence = (f"The {label} is {shown(inertia)}, and no body has it: the principal moment "
                    f"{I3:.6g} exceeds the sum {I1 + I2:.6g} of the other two")
        if excess > _TWO_DIGITS * I3:
            raise InputError(
                f"{sentence}; correct the moments. (Moments that fluid or rotors add to are "
                "parameters of a gyrospark.System, which takes any.)")
        warn(f"{sentence}. It is taken as it is, as if by rounding; give more digits.")
    return checked


def warn_of_shift(inertia: Inertia, mass: float, centre: Array, label: str) -> None:
    """Warn of an inertia about a point that no body of the mass has, with its centre at ``centre``.

    About the centre of mass it is J − m (|c|² 1 − c cᵀ), whose moments are not negative.
    """
    J = np.array(inertia, dtype=float)
    J = np.diag(J) if J.ndim == 1 else J
    central = J - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    moments = np.linalg.eigvalsh(central)
    if moments[0] < -_TWO_DIGITS * np.abs(J).max():
        warn(f"The {label} is {shown(inertia)} about the fixed point, which no body of {mass:g} kg "
             f"has with its centre of mass at ({few(f'{x:g}' for x in centre)}): about that centre "
             f"its moments would be {few(f'{x:.3g}' for x in moments)}. If it is the inertia about "
             "the centre of mass, add m (|c|² 1 − c cᵀ).")


def as_moments_or_tensor(inertia: Any, label: str = "inertia") -> Inertia:
    """Return an inertia whose moments are finite and above 0; other conditions are not checked."""
    if not is_tensor(inertia):
        return as_moments(inertia, label)
    tensor = np.array(inertia, dtype=float)
    if tensor.shape != (3, 3) or not np.isfinite(tensor).all():
        raise InputError(f"The {label} {shown(inertia)} is not 3 × 3 finite numbers; give the "
                         "tensor in body axes, or I1, I2 and I3, in kg m².")
    size = float(np.abs(tensor).max())
    # programs that export tensors write six digits or more
    if np.abs(tensor - tensor.T).max() > 1e-6 * size:
        raise InputError(f"The {label} {shown(inertia)} is not symmetric, as inertia tensors are; "
                         "give both products of inertia of a pair of axes one value, −∫xy dm.")
    # entries keep their types, such as mpmath's, unless round-off makes the mean of two of them
    rows = [[_keep_digits(x) for x in row] for row in inertia]
    if not (np.tril(tensor, -1).any() or np.triu(tensor, 1).any()):
        return as_moments([rows[i][i] for i in range(3)], label)
    tensor = tensor / 2 + tensor.T / 2  # the sum of two of them may overflow
    # eigenvalues of entries up to 1 are right to some eps: below 8 eps one may as well be 0
    if not size or np.linalg.eigvalsh(tensor / size).min() <= 8 * _EPS:
        raise InputError(f"The {label} {shown(inertia)} is not positive definite: one of its "
                         "principal moments is not above 0; correct its products of inertia.")
    symmetric = [[rows[i][j] if rows[i][j] == rows[j][i] else float(tensor[i, j])
                  for j in range(3)] for i in range(3)]
    return cast("Tensor", tuple(map(tuple, symmetric)))


def as_moments(inertia: Any, label: str = "inertia", *, zeros: int = 0) -> Moments:
    """Return three principal moments as floats, or as given where those lose digits, in kg m².

    Raises InputError unless there are three finite moments above 0; up to ``zeros`` of them may be
    0.
    """
    array = real_array(inertia)
    if array is None or array.ndim != 1:
        raise InputError(
            f"The {label} {shown(inertia)} is not three numbers; give I1, I2 and I3 in kg m².")
    moments: list[float] = array.tolist()
    if len(moments) != 3:
        raise InputError(f"The {label} has {len(moments)} moments; give the three principal "
                         "moments I1, I2, I3, or a 3 × 3 tensor.")
    for axis, moment in enumerate(moments, start=1):
        # the rules for γ take a thin rod, whose moment about itself is 0
        vanishing_allowed = moment == 0 and moments.count(0.0) <= zeros
        if not math.isfinite(moment) or (moment <= 0 and not vanishing_allowed):
            where = "" if label == "inertia" else f", in the {label}"
            raise InputError(f"The moment I{axis} = {moment!r} kg m² must be finite and above 0"
                             f"{where}.")
    I1, I2, I3 = (_keep_digits(moment) for moment in inertia)
    return I1, I2, I3


def _keep_digits(value: Any) -> float:
    """Return a number unchanged if a double would lose digits of it, else as a float."""
    return cast("float", value) if isinstance(knowing(value), Rounded) else float(value)


def moments_of(inertia: Inertia) -> Moments:
    """Return the principal moments as floats; those of a tensor in rising order."""
    if not is_tensor(inertia):
        I1, I2, I3 = map(float, cast("Moments", inertia))
        return I1, I2, I3
    matrix = np.array(inertia, dtype=float)
    size = np.abs(matrix).max()  # so that no square leaves the range of doubles
    I1, I2, I3 = (np.linalg.eigvalsh(matrix / size) * size).tolist()
    return I1, I2, I3


def inertia_matrix(inertia: Inertia) -> Floats:
    """Return J, 3 × 3, in body axes, as doubles."""
    return np.array(inertia_rows(inertia), dtype=float)


def inertia_rows(inertia: Inertia) -> Sequence[Sequence[float]]:
    """Return the rows of J, 3 × 3, in body axes, with all digits."""
    if is_tensor(inertia):
        return cast("Tensor", inertia)
    I1, I2, I3 = cast("Moments", inertia)
    return (I1, 0.0, 0.0), (0.0, I2, 0.0), (0.0, 0.0, I3)


def inverse_entries(inertia: Inertia) -> list[float]:
    """Return K11, K12, K13, K22, K23, K33 of J⁻¹ of a tensor, exactly: adj J / det J."""
    J = [[Fraction(cast("Any", exact(x))) for x in row] for row in inertia_rows(inertia)]

    def cofactor(i: int, j: int) -> Fraction:
        """Return the cofactor of J_ij; cyclic indices give its sign."""
        row, next_row = J[(i + 1) % 3], J[(i + 2) % 3]
        column, next_column = (j + 1) % 3, (j + 2) % 3
        return row[column] * next_row[next_column] - row[next_column] * next_row[column]

    determinant = sum(J[0][j] * cofactor(0, j) for j in range(3))
    return [knowing(cofactor(j, i) / determinant) for i in range(3) for j in range(i, 3)]


def tensor_of_inverse(entries: Sequence[float]) -> Tensor:
    """Return J from the entries K11, K12, K13, K22, K23, K33 of J⁻¹.

    Raises InputError if no inertia has this inverse.
    """
    K = np.zeros((3, 3))
    K[np.triu_indices(3)] = np.array(entries, dtype=float)
    K = K + np.triu(K, 1).T
    size = np.abs(K).max()
    if not (np.isfinite(size) and size and np.linalg.eigvalsh(K / size).min() > 0):
        raise InputError(f"K11, K12, K13, K22, K23, K33 = {shown(list(entries))} are no J⁻¹: the "
                         "matrix is not positive definite.")
    J = np.linalg.inv(K / size) / size
    return cast("Tensor", tuple(tuple(row) for row in ((J + J.T) / 2).tolist()))


def refuse_impossible_inertias(
    bodies: Mapping[str, Sequence[str]], parameters: Mapping[str, Any]
) -> None:
    """Refuse inertias among parameters that ``as_inertia`` refuses.

    Parameters
    ----------
    bodies : mapping
        The parameters of each body: I1, I2, I3, or K11, K12, K13, K22, K23, K33 of J⁻¹.
    parameters : mapping
        One number for each parameter, or a column for each.

    Raises
    ------
    InputError
        With the body's name.
    """
    if len(bodies) <= _FEW and _are_plainly_possible(bodies, parameters):
        return
    for count in (3, 6):
        names = {body: names_of_inertia for body, names_of_inertia in bodies.items()
                 if len(names_of_inertia) == count}
        if not names:
            continue
        values = np.array([[parameters[name] for name in names_of_inertia]
                           for names_of_inertia in names.values()], dtype=float)
        moments = values if count == 3 else _moments_of_inverses(values)
        with np.errstate(over="ignore"):
            largest = moments.max(axis=1)
            sums_of_smaller = moments.sum(axis=1) - largest
        # also where a singular J⁻¹ has made them NaN
        impossible = ~(largest - sums_of_smaller <= _TWO_DIGITS * largest)
        if impossible.any():
            # the first body, and the row of it where parameters are columns
            body, *row = np.argwhere(impossible)[0].tolist()
            inertia = values[(body, slice(None), *row)].tolist()
            # raises the error
            as_inertia(inertia if count == 3 else tensor_of_inverse(inertia),
                       f"inertia of {list(names)[body]!r}")


def _are_plainly_possible(
    bodies: Mapping[str, Sequence[str]], parameters: Mapping[str, Any]
) -> bool:
    """Return whether each inertia is three floats with max I ≤ the sum of the others, to rounding.

    Each call of a step checks them: arrays take longer. False leaves the answer to the caller.
    """
    for names_of_inertia in bodies.values():
        values = [*map(parameters.__getitem__, names_of_inertia)]
        if len(values) != 3 or {*map(type, values)} != {float}:
            return False
        largest = max(values)
        if not largest - (sum(values) - largest) <= _TWO_DIGITS * largest:
            return False
    return True


def _moments_of_inverses(values: Floats) -> Floats:
    """Return principal moments, shape (bodies, 3, ...), NaN unless J⁻¹ is positive definite.

    ``values`` are K11, K12, K13, K22, K23, K33 of K = J⁻¹, shape (bodies, 6, ...).
    """
    upper = np.moveaxis(values, 1, -1)
    K = np.zeros((*upper.shape[:-1], 3, 3))
    # the lower half, which eigvalsh reads, row by row: K11; K12, K22; K13, K23, K33
    K[(..., *np.tril_indices(3))] = upper[..., [0, 1, 3, 2, 4, 5]]
    inverse_moments = np.linalg.eigvalsh(K)
    moments = 1 / np.where(inverse_moments > 0, inverse_moments, np.nan)
    return np.moveaxis(moments, -1, 1)


# ---------------------------------------------------------------- attitude


def unit_quaternions(values: Any, label: str = "quaternion") -> Floats:
    """Return unit quaternions, scalar first, of one or of rows of any length but 0.

    Raises InputError unless the last axis holds four finite numbers, not all 0.
    """
    q = real_array(values)
    if q is None or q.ndim not in (1, 2) or q.shape[-1] != 4 or not np.isfinite(q).all():
        raise InputError(f"The {label} is {shown(values)}; give 4 finite numbers, scalar first.")
    sizes = np.abs(q).max(axis=-1, keepdims=True)
    if not sizes.all():
        raise InputError(f"The {label} is zero; take (1, 0, 0, 0) for no turn.")
    scaled = q / sizes  # so that no square leaves the range of doubles
    norms = np.linalg.norm(scaled, axis=-1, keepdims=True)
    lengths = norms * sizes
    # of length 1 they stay as they are
    unit: Floats = np.where(abs(lengths - 1) <= 4 * _EPS, q, scaled / norms)
    _warn_of_length(label, values, lengths.ravel())
    _warn_of_order(label, values, unit)
    return unit


def _warn_of_length(label: str, values: Any, norms: Floats) -> None:
    """Warn of quaternions whose length differs from 1 by more than rounding.

    Entries rounded to d decimals have errors of 10⁻ᵈ/2 each, and |q| one of 10⁻ᵈ at most; d = 2
    is the fewest that anybody rounds to.
    """
    array = np.asarray(values)
    eps = float(np.finfo(array.dtype).eps) if array.dtype.kind == "f" else _EPS
    # decimals of the entries as they are written; 400 entries show those of a long table
    decimals = max(-int(Decimal(repr(float(x))).as_tuple().exponent) for x in array.ravel()[:400])
    bound = 10.0 ** -min(max(decimals, 2), 17) + 4 * max(eps, _EPS)
    worst_row = int(np.abs(norms - 1).argmax())
    if abs(norms[worst_row] - 1) > bound:
        where = "" if len(norms) == 1 else f" in row {worst_row + 1}"
        warn(f"The {label}{where} has length {norms[worst_row]:.9g}, not 1, and was divided by it; "
             "write a unit quaternion if another was meant.")


def _warn_of_order(label: str, values: Any, unit: Floats) -> None:
    """Warn of quaternions that seem to have the scalar last.

    It warns if every |x₃| > cos 30°: scalar last, these are turns by less than 60°, and
    scalar first by more than 120°. One random attitude in seventeen is like that.
    """
    scalars_if_last = np.abs(unit[..., 3])
    if not (scalars_if_last > math.cos(math.pi / 6)).all():
        return
    quaternion = np.atleast_2d(unit)[0]
    scalar_first, scalar_last = (
        math.degrees(2 * math.acos(min(abs(float(x)), 1.0))) for x in quaternion[[0, 3]])
    # + 0.0 makes 0 of −0
    scalar_first_text = ", ".join(f"{x + 0.0:.6g}" for x in quaternion[[3, 0, 1, 2]])
    warn(f"The {label} {shown(values)} is read scalar first, a turn by {scalar_first:.0f}°. If its "
         f"scalar stands last, a turn by {scalar_last:.0f}°, write ({scalar_first_text}); else "
         "give it as a rotation, which has this unsaid.")


def quaternion_product(x: Any, *factors: Any) -> list[Any]:
    """Return Hamilton's product of quaternions from the left, scalar first: R(xy) = R(x) R(y).

    Components are numbers, expressions or arrays of equal shape.
    """
    product = list(x)
    for y in factors:
        (x0, x1, x2, x3), (y0, y1, y2, y3) = product, y
        product = [x0 * y0 - (x1 * y1 + x2 * y2 + x3 * y3),
                   x0 * y1 + x1 * y0 + (x2 * y3 - x3 * y2),
                   x0 * y2 + x2 * y0 + (x3 * y1 - x1 * y3),
                   x0 * y3 + x3 * y0 + (x1 * y2 - x2 * y1)]
    return product


def quaternion_of_matrix(matrix: Any, label: str = "rotation") -> Floats:
    """Return the unit quaternion, scalar first and not negative, of a 3 × 3 rotation matrix.

    Raises InputError if it is no rotation.
    """
    R = real_array(matrix)
    if R is None or R.shape != (3, 3) or not np.isfinite(R).all():
        raise InputError(f"The {label} is {shown(matrix)}; give 3 × 3 finite numbers or a SciPy "
                         "Rotation.")
    with np.errstate(over="ignore", invalid="ignore"):  # no rotation, then
        error, determinant = np.abs(R @ R.T - np.eye(3)).max(), np.linalg.det(R)
    if not error <= 1e-6 or determinant < 0:  # of matrices typed with six digits and more
        raise InputError(f"The {label} is no rotation matrix: |R Rᵀ − 1| = {error:.1e}, "
                         f"det R = {determinant:.3g}; give orthogonal columns, right-handed.")
    # K = 4 q qᵀ from R. Every row is a multiple of q; that of the largest 4 q_i², which is at least
    # 1, has no cancellation.
    t = np.trace(R)
    K = np.empty((4, 4))
    K[0, 0] = 1 + t
    K[0, 1:] = K[1:, 0] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    K[1:, 1:] = R + R.T + (1 - t) * np.eye(3)
    q: Floats = K[int(np.argmax(np.diag(K)))]
    q = q / np.linalg.norm(q)
    return q if q[0] >= 0 else -q


# ---------------------------------------------------------------- angles


def warn_of_degrees(label: str, angles: Sequence[float], *, cure: str) -> None:
    """Warn of angles beyond a full turn, which may be degrees."""
    if any(abs(x) > 2 * math.pi for x in angles):
        listed = ", ".join(f"{x:.6g}" for x in angles)
        warn(f"{label} is [{listed}], taken as radians, more than a turn; if degrees are meant, "
             f"write {cure}.")

