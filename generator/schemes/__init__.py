"""Schemes: their names, and the equations of a step of each, for any system.

In: a system and a tableau.
Out: unknowns of a step and kernels of its equations.
Open first: ``step_equations.SparkScheme``.

    named_schemes        the record of each named scheme; imports no SymPy
    step_equations       unknowns and kernels of SPARK methods and of IMS and EMS
    discrete_gradient    discrete differentiation: difference quotients with an exact chain rule
    discrete_functions   exact differences of powers, elementary and switching functions
    system_differences   H and g between two states or times; symbols of kernel inputs
    lagrangian_kernels   kernels of a system from its Lagrangian
    lagrangian_midpoint  IMS and EMS of a system from its Lagrangian
    splitting_scheme     flows and compositions of a step, for bodies without joints
    derivative_kernels   kernels of the derivatives of a step
    start_kernels        momenta of velocities, and constraint defects of a start
    frame_kernels        rotation back from a co-moving frame
    fast_path            identities of a system for the fixed-point iteration, derived by algebra
    fast_tableau         coefficients of the fixed-point iteration, scaled and rounded
"""
