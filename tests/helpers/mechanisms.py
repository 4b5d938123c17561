"""Mechanisms that tests run: closed loops of point masses, and Andrews' squeezing mechanism."""

from __future__ import annotations

import functools
from math import cos, sin

import numpy as np
import sympy as sp

import gyrospark as gs

GRAVITY = {"g": 9.81}


def _masses(name: str, constraints) -> gs.System:
    """Two unit masses in a plane, in gravity, with constraints on (x1, y1, x2, y2)."""
    q = sp.symbols("x1 y1 x2 y2", real=True)
    p = sp.symbols("px1 py1 px2 py2", real=True)
    g = sp.Symbol("g", positive=True)
    return gs.System(q, p, (g,), sum(x**2 for x in p) / 2 + g * (q[1] + q[3]), constraints(*q),
                     name=name)


@functools.cache
def parallelogram() -> gs.System:
    """Four bars of length 1; in a line all its constraints depend on each other."""
    return _masses("parallelogram", lambda x1, y1, x2, y2: [
        x1**2 + y1**2 - 1, (x2 - 1)**2 + y2**2 - 1, (x2 - x1)**2 + (y2 - y1)**2 - 1])


def parallelogram_at(angle: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    c, s = cos(angle), sin(angle)
    return np.array([c, s, 1 + c, s]), rate * np.array([-s, c, -s, c])


@functools.cache
def slider_crank() -> gs.System:
    """Crank and rod of length 1, a slider on y = 0; upright, both branches meet."""
    return _masses("slider_crank", lambda x1, y1, x2, y2: [
        x1**2 + y1**2 - 1, (x2 - x1)**2 + (y2 - y1)**2 - 1, y2])


def slider_crank_at(angle: float, rate: float) -> tuple[np.ndarray, np.ndarray]:
    c, s = cos(angle), sin(angle)
    return np.array([c, s, 2 * c, 0]), rate * np.array([-s, c, -2 * s, 0])


@functools.cache
def andrews() -> gs.System:
    """Andrews' squeezing mechanism, seven bodies in angles: H = pᵀM⁻¹p/2 + spring − torque.

    Numbers of the IVP test set (problem "andrews"); M has blocks of 2, inverted by hand.
    """
    number = sp.Rational
    m1, m2, m3, m4, m5, m6, m7 = map(number, (
        "0.04325", "0.00365", "0.02373", "0.00706", "0.07050", "0.00706", "0.05498"))
    I1, I2, I3, I4, I5, I6, I7 = map(number, (
        "2.194e-6", "4.410e-7", "5.255e-6", "5.667e-7", "1.169e-5", "5.667e-7", "1.912e-5"))
    xa, ya, xb, yb, xc, yc = map(number, (
        "-0.06934", "-0.00227", "-0.03635", "0.03273", "0.014", "0.072"))
    c0, l0, torque = map(number, ("4530", "0.07785", "0.033"))
    d, da, e, ea, rr, ra = map(number, ("0.028", "0.0115", "0.02", "0.01421", "0.007", "0.00092"))
    ss, sa, sb, sc, sd = map(number, ("0.035", "0.01874", "0.01043", "0.018", "0.02"))
    ta, tb, u, ua, ub = map(number, ("0.02308", "0.00916", "0.04", "0.01228", "0.00449"))
    zf, zt, fa = map(number, ("0.02", "0.04", "0.01421"))
    beta, theta, gamma, phi, delta, omega, eps = q = sp.symbols(
        "beta theta gamma_ phi delta omega_ epsilon_", real=True)
    p = sp.symbols("p1:8", real=True)
    sin, cos = sp.sin, sp.cos
    swing = zt * (e - ea) * sin(phi)
    turn = u * (zf - fa) * sin(omega)

    def pair(a, b, c, x, y):
        """Return (x, y) [[a, b], [b, c]]⁻¹ (x, y)ᵀ / 2."""
        return (c * x**2 - 2 * b * x * y + a * y**2) / (2 * (a * c - b * b))

    x = sd * cos(gamma) + sc * sin(gamma) + xb - xc
    y = sd * sin(gamma) - sc * cos(gamma) + yb - yc
    H = (
        pair(m1 * ra**2 + m2 * (rr**2 - 2 * da * rr * cos(theta) + da**2) + I1 + I2,
             m2 * (da**2 - da * rr * cos(theta)) + I2, m2 * da**2 + I2, p[0], p[1])
        + p[2]**2 / (2 * (m3 * (sa**2 + sb**2) + I3))
        + pair(m4 * (e - ea)**2 + I4, m4 * ((e - ea)**2 + swing) + I4,
               m4 * (zt**2 + 2 * swing + (e - ea)**2) + m5 * (ta**2 + tb**2) + I4 + I5, p[3], p[4])
        + pair(m6 * (zf - fa)**2 + I6, m6 * ((zf - fa)**2 - turn) + I6,
               m6 * ((zf - fa)**2 - 2 * turn + u**2) + m7 * (ua**2 + ub**2) + I6 + I7, p[5], p[6])
        + c0 * (sp.sqrt(x**2 + y**2) - l0)**2 / 2 - torque * beta)
    X = rr * cos(beta) - d * cos(beta + theta)
    Y = rr * sin(beta) - d * sin(beta + theta)
    constraints = [
        X - ss * sin(gamma) - xb, Y + ss * cos(gamma) - yb,
        X - e * sin(phi + delta) - zt * cos(delta) - xa,
        Y + e * cos(phi + delta) - zt * sin(delta) - ya,
        X - zf * cos(omega + eps) - u * sin(eps) - xa,
        Y - zf * sin(omega + eps) + u * cos(eps) - ya,
    ]
    return gs.System(q, p, (), H, constraints, name="andrews")


#: At rest; right to the last bit of a double.
ANDREWS_START = np.array([
    -0.0617138900142764496, 0.0, 0.4552798191630703803, 0.2226683901658858847,
    0.4873649795438425502, -0.2226683901658858847, 1.2305474445498211925]), np.zeros(7)
