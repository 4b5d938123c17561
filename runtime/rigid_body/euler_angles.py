"""Euler angles of unit quaternions, in any of the 24 sequences of axes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arguments import shown
from ...core.arrays import Array
from ...core.errors import InputError

__all__ = ["check_sequence", "euler_angles"]

#: Nearer than this to 0 or π the middle angle leaves the others undetermined but for their sum or
#: difference: the digits of these, 1e-16/1e-7, are fewer than anybody asks for.
_LOCK = 1e-7


def check_sequence(sequence: Any) -> tuple[list[int], bool]:
    """Return the axes' numbers of a sequence, and whether they turn with the body.

    Raises InputError unless it is three letters x, y, z, or X, Y, Z, neighbours different.
    """
    letters = sequence if isinstance(sequence, str) else ""
    valid_letters = len(letters) == 3 and ({*letters} <= {*"xyz"} or {*letters} <= {*"XYZ"})
    if not valid_letters or letters[1] in (letters[0], letters[2]):
        count = f", which has {len(letters)} letters" if letters and len(letters) != 3 else ""
        raise InputError(
            f"Euler angles have no sequence {shown(sequence)}{count}; give three axes, neighbours "
            "different: small letters, 'zyx', turn about the axes of space, capitals, 'ZXZ', "
            "about those of the body.")
    return ["xyz".index(letter) for letter in letters.lower()], letters.isupper()


def euler_angles(q: ArrayLike, sequence: str) -> Array:
    """Return the angles of q, shape (..., 4) and scalar first, in rad, shape (..., 3).

    ``"zyx"``: R(q) = R_x(c) R_y(b) R_z(a), turns by a, b, c about the axes of space, the first
    letter's first. Capitals turn about the axes that the body carries: ``"ZXZ"`` is
    R_z(a) R_x(b) R_z(c), the angles φ, θ, ψ of the paper's (81). These are SciPy's conventions. The
    first and the last angle lie in [−π, π], the middle one in [0, π] where the outer axes are the
    same, else in [−π/2, π/2]. Where the middle one stands at the end of its range (within 1e-7) the
    outer ones are not determined, and the last is 0.

    Source: Bernardes and Viollet, Quaternion to Euler angles conversion: a direct, general and
    computationally efficient method, PLOS ONE 17 (2022) e0276302. Raises InputError for another
    sequence.
    """
    axes, turning = check_sequence(sequence)
    # turns about carried axes are those about the axes of space in reverse order
    i, j, k = reversed(axes) if turning else axes
    # proper Euler angles have equal outer axes; k is then the third axis, and i + j + k = 3
    proper_angles = i == k
    k = 3 - i - j if proper_angles else k
    # 1 for a cyclic permutation of the axes, −1 for another
    sign = (i - j) * (j - k) * (k - i) / 2
    components = np.moveaxis(np.asarray(q, dtype=np.float64), -1, 0)
    w, x, y, z = components[0], components[1 + i], components[1 + j], sign * components[1 + k]
    if not proper_angles:  # after a turn by a right angle about j the outer axes are equal too
        w, x, y, z = w - y, x + z, y + w, z - x
    # w + i x = cos(θ/2) e^(i s), y + i z = sin(θ/2) e^(i d): θ is the middle angle, s and d half
    # the sum and half the difference of the outer ones
    middle = 2 * np.arctan2(np.hypot(y, z), np.hypot(w, x))
    half_sum, half_difference = np.arctan2(x, w), np.arctan2(z, y)
    first_angle, last_angle = _outer_angles(half_sum, half_difference, middle, turning)
    if not proper_angles:
        last_angle, middle = sign * last_angle, middle - np.pi / 2
    angles: NDArray[np.float64] = np.stack(
        [last_angle, middle, first_angle]
        if turning else [first_angle, middle, last_angle], axis=-1)
    # half sum and half difference lie in [−π, π], their sums in twice that range
    return np.where(np.abs(angles) > np.pi, angles - 2 * np.pi * np.sign(angles), angles)


def _outer_angles(
    half_sum: Array, half_difference: Array, middle: Array, turning: bool
) -> tuple[Array, Array]:
    """Return the first and the last angle about axes of space, from half their sum and difference.

    Angles are in rad, all of one shape. Where the ``middle`` angle is within ``_LOCK`` of 0 or π
    only the sum, or the difference, of the others is determined: the last letter of the sequence
    gets 0. With ``turning`` axes that is the first angle about axes of space.
    """
    first_angle, last_angle = half_sum - half_difference, half_sum + half_difference
    at_low_end, at_high_end = middle < _LOCK, middle > np.pi - _LOCK
    zero = np.zeros_like(first_angle)
    outer_sum = np.where(at_low_end, 2 * half_sum, 2 * half_difference * (1 if turning else -1))
    locked = at_low_end | at_high_end
    if turning:
        return np.where(locked, zero, first_angle), np.where(locked, outer_sum, last_angle)
    return np.where(locked, outer_sum, first_angle), np.where(locked, zero, last_angle)
