"""Schemes: which have names, and what a step of each must solve, in terms of any system.

    scheme           the record of each scheme with a name; costs no SymPy
    inputs           symbols of the inputs of kernels
    schemes          unknowns and kernels of SPARK methods and of means
    differences      H and g between two states, and between two times
    legendre         kernels of a system from its Lagrangian
    legendre_means   IMS and EMS of such a system
    mean_conditions  what IMS and EMS satisfy
    frame_kernels    back from a co-moving frame
    fast_path        what sweeps may use of a system, found by algebra
    fast_tableau     the coefficients of sweeps, scaled and rounded
"""
