"""Exact motions to measure a stepper against: regular precession and the free rigid body.

The free body's sn, cn, dn are Jacobi's with the parameter m = k². Source: Landau and Lifshitz,
Mechanics, §37, and Whittaker, Analytical Dynamics, §69; the precession angle is written with
Carlson's R_J (DLMF 19.25.14), which is regular for every body. Numbers of the free body are
computed with at least 40 digits from the given doubles, taken as exact, and rounded once at the
end. A regular precession is computed in doubles: angles φ̇t and ψ̇t have a relative error of one
rounding.

Motions known in closed form, by what defines them: the public names of ``gyrospark.exact``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import InertiaLike, quaternion_product
from ...core.records import dataclass
from ..bindings.array_checks import as_numbers, as_real, converted_to
from .quaternion import axis, euler_quaternion

__all__ = ["free_body", "regular_precession"]


def __dir__() -> list[str]:
    return __all__


#: Decimal digits of elliptic functions; a float128 has 34.
DIGITS = 40
#: Angle in rad up to which a double of an attitude is right to its last digit: 40 digits less 20.
_LARGEST_ANGLE = 1e20


class ExactMotion(Protocol):
    """A motion known in closed form; t in seconds, shape (N,), or (...) in general."""

    def attitude(self, t: ArrayLike) -> Array:
        """Return q(t), shape (N, 4), continuous in t; −q is the same attitude."""
        ...

    def angular_velocity(self, t: ArrayLike) -> Array:
        """Return Ω(t) in body axes, shape (N, 3), in rad/s."""
        ...

    def axis(self, t: ArrayLike) -> Array:
        """Return (R13, R23, R33) at t, shape (N, 3): the body's third axis in space."""
        ...


@dataclass(frozen=True)
class RegularPrecession:
    """A top whose axis keeps the angle θ₀ and turns about the vertical at a constant rate.

        φ = φ̇ t,  ψ = ψ̇ t,  Ω = (φ̇ sin θ₀ sin ψ, φ̇ sin θ₀ cos ψ, ψ̇ + φ̇ cos θ₀)

    Attributes
    ----------
    rate
        φ̇, in rad/s.
    spin
        ψ̇ of erratum 10, in rad/s.
    nutation
        θ₀, in rad.
    """

    rate: float
    spin: float
    nutation: float

    def attitude(self, t: ArrayLike) -> Array:
        """Return q(t) by erratum 9, shape (N, 4), continuous in t."""
        times = _times(t)
        return euler_quaternion(self.rate * times, self.nutation, self.spin * times)

    def angular_velocity(self, t: ArrayLike) -> Array:
        """Return Ω(t) in body axes, shape (N, 3), in rad/s; (86) at t = 0."""
        psi = self.spin * _times(t)
        across = self.rate * np.sin(self.nutation)
        along = np.full_like(psi, self.spin + self.rate * np.cos(self.nutation))
        return np.stack([across * np.sin(psi), across * np.cos(psi), along], axis=-1)

    def axis(self, t: ArrayLike) -> Array:
        """Return the body's axis in space, (sin θ₀ sin φ̇t, −sin θ₀ cos φ̇t, cos θ₀), shape (N, 3).
        """
        phi = self.rate * _times(t)
        sine, cosine = np.sin(self.nutation), np.cos(self.nutation)
        return np.stack(
            [sine * np.sin(phi), -sine * np.cos(phi), np.full_like(phi, cosine)], axis=-1
        )


class _PreciseMotion:
    """Rounds a motion that is given in mpmath numbers to doubles, time by time.

    An object has one mpmath context: use it from one thread at a time.
    """

    #: Of all times, in rad/s: the largest |Ω|, or a bound of it.
    _fastest: Any

    def __init__(self, *arguments: Sequence[float]) -> None:
        self._arguments = arguments

    def __reduce__(self) -> tuple[type, tuple[Sequence[float], ...]]:
        # A context and its numbers cannot be pickled; the arguments say everything.
        return type(self), self._arguments

    def precise_attitude(self, t: Any) -> list[Any]:
        """Return q(t) in at least 30 digits, as mpmath numbers; t is one number."""
        raise NotImplementedError

    def precise_angular_velocity(self, t: Any) -> list[Any]:
        """Return Ω(t) in at least 30 digits, as mpmath numbers; t is one number."""
        raise NotImplementedError

    def attitude(self, t: ArrayLike) -> Array:
        """Return q(t), shape (N, 4), continuous in t; −q is the same attitude."""
        return self._evaluate_at(self.precise_attitude, t, 4)

    def angular_velocity(self, t: ArrayLike) -> Array:
        """Return Ω(t) in body axes, shape (N, 3), in rad/s."""
        return self._evaluate_at(self.precise_angular_velocity, t, 3)

    def axis(self, t: ArrayLike) -> Array:
        """Return (R13, R23, R33) at t, shape (N, 3): the body's third axis in space."""
        return axis(self.attitude(t))

    def _evaluate_at(
        self, precise: Callable[[Any], list[Any]], t: ArrayLike, length: int
    ) -> Array:
        """Return a vector function of one time at all times, in doubles, shape (*t.shape, length).

        Raises InputError for times at which the digits do not reach the angle.
        """
        times = _times(t)
        furthest = float(np.abs(times).max(initial=0.0))
        if self._fastest * furthest > _LARGEST_ANGLE:
            raise InputError(f"t = {furthest:g} s is after more than {_LARGEST_ANGLE:g} rad, whose "
                             f"{DIGITS} digits do not tell the attitude; give times up to "
                             f"{_LARGEST_ANGLE / float(self._fastest):.0e} s.")
        vectors = [[float(x) for x in precise(time)] for time in times.ravel().tolist()]
        return np.array(vectors, dtype=np.float64).reshape(*times.shape, length)


class SteadyRotation(_PreciseMotion):
    """A free body with Ω × JΩ = 0: Ω is constant and q(t) = q₀ ∘ (cos |Ω|t/2, Ω/|Ω| sin |Ω|t/2)."""

    def __init__(self, angular_velocity: Sequence[float], attitude: Sequence[float]) -> None:
        """Keep Ω and q(0) as mpmath numbers."""
        super().__init__(angular_velocity, attitude)
        self._mp = _context(DIGITS)
        self._omega = [self._mp.mpf(x) for x in angular_velocity]
        self._q0 = [self._mp.mpf(x) for x in attitude]
        self._speed = self._fastest = self._mp.sqrt(sum(x**2 for x in self._omega))

    def precise_angular_velocity(self, t: Any) -> list[Any]:
        """Return Ω, which does not depend on t, as mpmath numbers."""
        return list(self._omega)

    def precise_attitude(self, t: Any) -> list[Any]:
        """Return q(t) in at least 30 digits, as mpmath numbers; t is one number."""
        half = self._speed * t / 2
        scale = self._mp.sin(half) / self._speed if self._speed else self._mp.mpf(0)
        turn = [self._mp.cos(half), *(scale * x for x in self._omega)]
        return quaternion_product(self._q0, turn)


class FreeRotation(_PreciseMotion):
    """A free body in general, with Ω × JΩ ≠ 0.

    Axis i is the one of the largest or smallest moment that Ω circles about, j the one of the
    middle moment, k the third. With ℓ² = |JΩ|², 2T = Ω·JΩ, u = u₀ + κt:

        Ω_i = B_i dn u,  Ω_j = B_j sn u,  Ω_k = B_k cn u
        B_i² = (ℓ² − 2T I_k) / (I_i (I_i − I_k)),  B_j² = (2T I_i − ℓ²) / (I_j (I_i − I_j)),
        B_k² = (2T I_i − ℓ²) / (I_k (I_i − I_k)),  κ² = (ℓ² − 2T I_k)(I_i − I_j) / (I_1 I_2 I_3),
        m = (I_j − I_k)(2T I_i − ℓ²) / ((I_i − I_j)(ℓ² − 2T I_k)) ≤ 1

    Euler's angles (φ, θ, ψ) of axis i against the fixed angular momentum, by the right-handed
    triad (a, b, i): l = ℓ (sin θ sin ψ, sin θ cos ψ, cos θ), and φ̇ = ℓ (Ω_a l_a + Ω_b l_b)/(l_a²
    + l_b²) integrates to

        φ = ℓ t/I_k + (ℓ/κ)(1/I_k − 1/I_i)[Π(n; am u) − u] from u₀ to u,
        n = −I_i (I_j − I_k) / (I_k (I_i − I_j)) ≤ 0.

    With e(t) the quaternion of these angles, q(t) = q₀ ∘ e(0)⁻¹ ∘ e(t). On the separatrix m = 1
    sn, cn, dn are tanh, sech, sech; for a symmetric body m = n = 0.

    Parameters
    ----------
    inertia
        Principal moments, in any order, finite and above 0, in kg m².
    angular_velocity
        Ω at t = 0 in body axes, in rad/s.
    attitude
        q at t = 0, of unit length, scalar first.
    """

    def __init__(
        self, inertia: Sequence[float], angular_velocity: Sequence[float],
        attitude: Sequence[float]
    ) -> None:
        """Compute the axes i, j, k, the parameter m, the amplitudes B and rate κ, and the start.

        With ℓ² = Σ (I Ω)² and 2T = Σ I Ω², m is 1 on the separatrix ℓ² = 2T I_j.
        """
        super().__init__(inertia, angular_velocity, attitude)
        # in fractions nothing cancels and m = 1 is decided exactly
        I = [Fraction(x) for x in inertia]  # noqa: E741 (the paper's letter)
        w = [Fraction(x) for x in angular_velocity]
        i, j, k = self._axes = _elliptic_axes(I, w)
        # ℓ² − 2T I_k and 2T I_i − ℓ², from which the terms of Ω_k and of Ω_i drop out
        excess_i = I[i] * (I[i] - I[k]) * w[i] ** 2 + I[j] * (I[j] - I[k]) * w[j] ** 2
        excess_k = I[j] * (I[i] - I[j]) * w[j] ** 2 + I[k] * (I[i] - I[k]) * w[k] ** 2
        m = (I[j] - I[k]) * excess_k / ((I[i] - I[j]) * excess_i)
        n = -I[i] * (I[j] - I[k]) / (I[k] * (I[i] - I[j]))

        self._mp = mp = _context(DIGITS + _lost_digits(1 - m))
        # the parameter m = k² of the elliptic functions, the characteristic n, and m₁ = 1 − m
        self._m, self._n, self._m1 = (_number(mp, x) for x in (m, n, 1 - m))
        self._set_amplitudes(I, w, excess_i, excess_k)
        self._inertia = [_number(mp, x) for x in I]
        self._momentum = _root(mp, sum((x * y) ** 2 for x, y in zip(I, w, strict=True)))
        self._fastest = self._momentum / min(self._inertia)
        # the factor (ℓ/κ)(1/I_k − 1/I_i) of φ
        self._drift = self._momentum * _number(mp, 1 / I[k] - 1 / I[i]) / self._rate
        self._scale, self._ladder = _landen_ladder(mp, self._m1)
        # Π(n; π/2) − K, which m = 1 does not need: am u never reaches π/2
        self._quarter_excess = (self._third_kind_on_quarter(mp.mpf(1), mp.mpf(0)) if m != 1
                                else mp.mpf(0))
        self._set_start(w, attitude)

    def _set_amplitudes(
        self, J: list[Fraction], w: list[Fraction], excess_i: Fraction, excess_k: Fraction
    ) -> None:
        """Compute B_i, B_j, B_k and κ of Ω = (B_i dn u, B_j sn u, B_k cn u), u = u₀ + κ t.

        ``J`` has I_1, I_2, I_3; ``excess_i`` is ℓ² − 2T I_k, ``excess_k`` 2T I_i − ℓ².
        """
        mp, (i, j, k) = self._mp, self._axes
        self._even = (j - i) % 3 == 1  # (i, j, k) is an even permutation of the axes
        self._upright = w[k] >= 0  # B_k takes the sign of Ω_k: am u₀ lies within a quarter turn
        # B_i takes the sign of Ω_i, B_j is positive, and Euler's equations give κ its sign
        sign_i, sign_k = (1 if w[i] > 0 else -1), (1 if self._upright else -1)
        sign_rate = sign_i * sign_k * (1 if self._even else -1) * (1 if J[k] > J[i] else -1)
        self._amplitudes = (
            sign_i * _root(mp, excess_i / (J[i] * (J[i] - J[k]))),
            _root(mp, excess_k / (J[j] * (J[i] - J[j]))),
            sign_k * _root(mp, excess_k / (J[k] * (J[i] - J[k]))),
        )
        self._rate = sign_rate * _root(mp, excess_i * (J[i] - J[j]) / (J[0] * J[1] * J[2]))

    def _set_start(self, w: list[Fraction], attitude: Sequence[float]) -> None:
        """Compute u₀ with sn u₀ = Ω_j/B_j and cn u₀ = Ω_k/B_k, and q₀ ∘ e(0)⁻¹.

        w is Ω and ``attitude`` q₀, both at t = 0.
        """
        mp, (_, j, k) = self._mp, self._axes
        _, b_j, b_k = self._amplitudes
        am = mp.atan2(_number(mp, w[j]) / b_j, _number(mp, w[k]) / b_k)
        # u = F(am, m); on the separatrix it is the inverse of the Gudermannian function
        self._u0 = mp.ellipf(am, self._m) if self._m1 else mp.asinh(mp.tan(am))
        self._third_kind0 = self._third_kind(am, self._u0)
        q0 = [mp.mpf(x) for x in attitude]
        w0, x0, y0, z0 = self._relative_attitude(mp.mpf(0))
        # the inverse of a unit quaternion is its conjugate
        self._to_space = quaternion_product(q0, [w0, -x0, -y0, -z0])

    def precise_angular_velocity(self, t: Any) -> list[Any]:
        """Return Ω(t) in at least 30 digits, as mpmath numbers; t is one number."""
        _, sn, cn, dn = self._jacobi(self._u0 + self._rate * t)
        omega = [self._mp.mpf(0)] * 3
        for axis_index, amplitude, x in zip(self._axes, self._amplitudes, (dn, sn, cn),
                                            strict=True):
            omega[axis_index] = amplitude * x
        return omega

    def precise_attitude(self, t: Any) -> list[Any]:
        """Return q(t) in at least 30 digits, as mpmath numbers; t is one number."""
        return quaternion_product(self._to_space, self._relative_attitude(t))

    def _relative_attitude(self, t: Any) -> list[Any]:
        """Return e(t): the body against axes whose third is the angular momentum's direction."""
        mp, (i, j, k) = self._mp, self._axes
        u = self._u0 + self._rate * t
        am, sn, cn, dn = self._jacobi(u)
        l_i, l_j, l_k = (
            self._inertia[axis_index] * abs(amplitude) * x
            for axis_index, amplitude, x in zip(
                (i, j, k), self._amplitudes, (dn, sn, cn), strict=True)
        )
        theta = mp.atan2(mp.hypot(l_j, l_k), l_i if self._amplitudes[0] > 0 else -l_i)
        # The angle of (l_k, l_j) without jumps: it stays within a quarter turn of am.
        psi = am + mp.atan2(l_j * cn - l_k * sn, l_k * cn + l_j * sn)
        psi = psi if self._upright else mp.pi - psi
        psi = psi if self._even else mp.pi / 2 - psi
        phi = self._momentum * t / self._inertia[k]
        phi += self._drift * (self._third_kind(am, u) - self._third_kind0)
        return self._from_euler(phi, theta, psi)

    def _from_euler(self, phi: Any, theta: Any, psi: Any) -> list[Any]:
        """Return the quaternion of erratum 9, its third axis being the body's axis i.

        With j and k the next two axes in cyclic order:

            e_0 = cos((φ+ψ)/2) cos(θ/2),   e_i = sin((φ+ψ)/2) cos(θ/2)
            e_j = cos((φ−ψ)/2) sin(θ/2),   e_k = sin((φ−ψ)/2) sin(θ/2)
        """
        mp, i = self._mp, self._axes[0]
        # all four entries, of which the last three are then set
        e = [mp.cos((phi + psi) / 2) * mp.cos(theta / 2)] * 4
        e[1 + (i + 1) % 3] = mp.cos((phi - psi) / 2) * mp.sin(theta / 2)
        e[1 + (i + 2) % 3] = mp.sin((phi - psi) / 2) * mp.sin(theta / 2)
        e[1 + i] = mp.sin((phi + psi) / 2) * mp.cos(theta / 2)
        return e

    def _jacobi(self, u: Any) -> tuple[Any, Any, Any, Any]:
        """Return am u, sn u, cn u, dn u; am by Landen's descending ladder (DLMF 22.20(ii)).

            φ_n = 2^n a_n u,   φ_(k−1) = (φ_k + asin((c_k/a_k) sin φ_k))/2,   am u = φ_0
        """
        mp = self._mp
        if not self._m1:  # m = 1: hyperbolic functions
            return 2 * mp.atan(mp.tanh(u / 2)), mp.tanh(u), mp.sech(u), mp.sech(u)
        am = self._scale * u
        for ratio in reversed(self._ladder):
            am = (am + mp.asin(ratio * mp.sin(am))) / 2
        sn, cn = mp.sin(am), mp.cos(am)
        return am, sn, cn, mp.sqrt(cn**2 + self._m1 * sn**2)

    def _third_kind(self, am: Any, u: Any) -> Any:
        """Return Π(n; am u) − u = Π − F at any am; it grows by 2 (Π(n; π/2) − K) in each half turn.
        """
        mp = self._mp
        if not self._n:
            return mp.mpf(0)
        if not self._m1:
            # m = 1, the separatrix: sn u = tanh u, so that Π − u = ∫ du/(1 − n tanh² u) − u
            root = mp.sqrt(-self._n)
            return (u + root * mp.atan(root * mp.tanh(u))) / (1 - self._n) - u
        # R_J is used for |am| ≤ π/2 alone
        half_turns = mp.nint(am / mp.pi)
        remainder = am - half_turns * mp.pi
        remainder_integral = self._third_kind_on_quarter(mp.sin(remainder), mp.cos(remainder))
        return 2 * half_turns * self._quarter_excess + remainder_integral

    def _third_kind_on_quarter(self, sn: Any, cn: Any) -> Any:
        """Return Π − F = (n/3) sn³ R_J(cn², 1 − m sn², 1, 1 − n sn²) for |am| ≤ π/2."""
        dn2 = cn**2 + self._m1 * sn**2
        integral = self._mp.elliprj(cn**2, dn2, 1, 1 - self._n * sn**2)
        return self._n / 3 * sn**3 * integral


def free_motion(
    inertia: Sequence[float], angular_velocity: Sequence[float], attitude: Sequence[float]
) -> SteadyRotation | FreeRotation:
    """Return the exact motion of a free body: steady when Ω × JΩ = 0, elliptic otherwise.

    Arguments as for ``FreeRotation``, already checked.
    """
    I = [Fraction(x) for x in inertia]  # noqa: E741 (the paper's letter)
    w = [Fraction(x) for x in angular_velocity]
    # the components of Ω × JΩ, exactly
    if any((I[a] - I[b]) * w[a] * w[b] for a, b in ((0, 1), (1, 2), (2, 0))):
        return FreeRotation(inertia, angular_velocity, attitude)
    return SteadyRotation(angular_velocity, attitude)


def _elliptic_axes(I: list[Fraction], w: list[Fraction]) -> tuple[int, int, int]:  # noqa: E741
    """Return the axes (i, j, k) of FreeRotation: j has the middle moment, and m ≤ 1.

    m ≤ 1 for i of the largest moment if ℓ² ≥ 2T I_j, else for i of the smallest one: ℓ² − 2T I_j is
    the difference of the two terms below.
    """
    smallest, middle, largest = sorted(range(3), key=I.__getitem__)
    about_largest = I[largest] * (I[largest] - I[middle]) * w[largest] ** 2
    about_smallest = I[smallest] * (I[middle] - I[smallest]) * w[smallest] ** 2
    if about_largest >= about_smallest:
        return largest, middle, smallest
    return smallest, middle, largest


def _landen_ladder(mp: Any, complement: Any) -> tuple[Any, list[Any]]:
    """Return 2^N a_N and the ratios c_n/a_n, n = 1..N, of the arithmetic-geometric mean.

    a_0 = 1, b_0 = √(1 − m), a_(n+1) = (a_n + b_n)/2, b_(n+1) = √(a_n b_n), c_(n+1) = (a_n − b_n)/2;
    ``complement`` is 1 − m.
    """
    a, b, scale, ratios = mp.mpf(1), mp.sqrt(complement), mp.mpf(1), []
    # a − b may stay above 0 by round-off; for complement = 0 the mean is 0, reached by no iteration
    while complement and a - b > 4 * mp.eps:
        a, b, c = (a + b) / 2, mp.sqrt(a * b), (a - b) / 2
        scale *= 2
        ratios.append(c / a)
    return scale * a, ratios


def _lost_digits(complement: Fraction) -> int:
    """Return the decimal digits of m that do not reach 1 − m; none on the separatrix."""
    lost_bits = 0
    if complement:
        lost_bits = complement.denominator.bit_length() - complement.numerator.bit_length()
    return max(0, lost_bits * 3 // 10 + 1)


def _context(digits: int) -> Any:
    """Return a separate mpmath context, so that the caller's precision does not change."""
    from mpmath import MPContext

    mp = MPContext()
    mp.dps = digits
    return mp


def _number(mp: Any, value: Fraction) -> Any:
    """Return a fraction as a number of mpmath."""
    return mp.mpf(value.numerator) / value.denominator


def _root(mp: Any, value: Fraction | int) -> Any:
    """Return the square root of a fraction as a number of mpmath."""
    return mp.sqrt(_number(mp, Fraction(value)))


def _times(t: ArrayLike) -> Array:
    """Return times in seconds as doubles; InputError unless they are finite real numbers."""
    times: Array = converted_to(np.float64, as_numbers("t", t))
    if not np.isfinite(times).all():
        raise InputError(f"The times {t!r} are not all finite; give seconds as finite numbers.")
    return times


def free_body(
    inertia: InertiaLike, angular_velocity: ArrayLike, attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0)
) -> ExactMotion:
    """Return the motion of a rigid body without forces, I Ω̇ = (I Ω) × Ω, in closed form.

    Jacobi's elliptic functions, computed with 40 digits and rounded once (Landau and Lifshitz,
    Mechanics, §37; Whittaker, Analytical Dynamics, §69).

    Parameters
    ----------
    inertia
        Principal moments in any order, in kg m².
    angular_velocity
        Ω at t = 0 in body axes, in rad/s.
    attitude
        The unit quaternion at t = 0, scalar first, body to space.

    Returns
    -------
    ExactMotion
        ``.attitude(t)`` is q, shape (N, 4); ``.angular_velocity(t)`` Ω in body axes, shape (N, 3);
        ``.axis(t)`` the body's third axis in space, shape (N, 3); t in seconds.

    Raises
    ------
    InputError
        Unless the moments are those of a body, and the others finite, the attitude not 0.

    Examples
    --------
    >>> import gyrospark as gs
    >>> motion = gs.exact.free_body((0.003, 0.002, 0.0015), (0.01, 5.0, 0.01))
    >>> motion.attitude([0.0, 1.0]).shape
    (2, 4)
    """
    from . import problems  # which imports this module

    return cast("ExactMotion", problems.free_body(inertia, angular_velocity, attitude).exact)


def regular_precession(rate: float, spin: float, nutation: float) -> ExactMotion:
    """Return the motion of a symmetric top in regular precession: φ = φ̇ t, ψ = ψ̇ t, θ = θ₀.

    Parameters
    ----------
    rate, spin
        φ̇ and ψ̇ in rad/s.
    nutation
        θ₀ in rad.

    Returns
    -------
    ExactMotion
        As of ``free_body``. For the spin that a top's weight asks for see
        ``gyrospark.problems.regular_precession``.

    Raises
    ------
    InputError
        Unless all are finite numbers.
    """
    arguments = {"rate": rate, "spin": spin, "nutation": nutation}
    return RegularPrecession(**{
        name: float(as_real(name, value)) for name, value in arguments.items()})
