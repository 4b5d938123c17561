"""Schemes: their names, and the equations of a step of each, for any system.

    named_schemes        the record of each scheme with a name; costs no SymPy
    step_equations       unknowns and kernels of SPARK methods and of IMS and EMS
    discrete_gradient    discrete differentiation: difference quotients with an exact chain rule
    discrete_functions   exact differences of powers, elementary and switching functions
    system_differences   H and g between two states or times; symbols of kernel inputs
    lagrangian_kernels   kernels of a system from its Lagrangian
    lagrangian_midpoint  IMS and EMS of such a system
    splitting_scheme     flows and compositions of a step, for bodies without joints
    derivative_kernels   kernels that derivatives of a step need beside its own
    start_kernels        momenta of velocities, and what constraints say of both
    frame_kernels        rotation back from a co-moving frame
    fast_path            structure of a system for the fixed-point iteration, found by algebra
    fast_tableau         coefficients of the fixed-point iteration, scaled and rounded
"""
