"""Analysis of motions by derivatives of their steps: fits, exponents, periodic orbits.

In: a stepper and a start or data.
Out: parameters, exponents or orbits, with their uncertainty.
Open first: ``fit.fit``.

    fit              parameters and start of a motion from measured data, by least squares
    observations     measured quantities of a state: residuals and their derivatives
    fit_coordinates  coordinates of parameters in which each step stays physical
    least_squares    the method of Levenberg and Marquardt; undetermined combinations
    unitary_frame    coordinates of tangent spaces in which Ω is J and the metric the identity
    lyapunov         Lyapunov exponents and vectors, MEGNO, finite-time exponents
    periodic_orbit   periodic orbits and their Floquet multipliers
"""
