"""Analysis of motions by derivatives of their steps.

    unitary_frame   coordinates of tangent spaces in which Ω is J and the metric the identity
    lyapunov        Lyapunov exponents and vectors, MEGNO, finite-time exponents
    periodic_orbit  periodic orbits and their Floquet multipliers
"""
