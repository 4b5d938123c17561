"""Systems: q, p, H, g and forces, and their analysis before code is generated.

In: expressions of users: H or L, g, F.
Out: a checked ``System`` with its derivatives and structure.
Open first: ``system.System``.

    system                 a constrained Hamiltonian system and its derivatives
    lagrangian             a system from its Lagrangian, M(q) never inverted in symbols
    sympy_mechanics        a system from sympy.physics.mechanics
    sympy_motion           how frames and points of sympy.physics.mechanics move
    expression_arguments   expressions that a user passes, checked
    body_layout            coordinates of bodies and joints in a system
    numeric_system         g, g_q and H_p with numbers, in NumPy
    equilibrium            static equilibria, by pseudo-transient continuation
    redundant_constraints  constraints that others imply
    velocity_coefficients  coefficients of velocity constraints, extracted exactly
    integrable_rows        velocity constraints that are rates of functions of position
    jacobians              matrices of derivatives
    moving_frame           a system whose energy is not the H of its motion; a co-moving frame
    time_scale             a system in scaled time, whose steps adapt
    scales                 ready time scales: distances, rates
    repeated_structure     element templates that many terms share, and their sparsity
    elimination_order      elimination orders with little fill-in
    run_functions          sums over the states of a run, and their derivatives
    units                  units of numbers, completed by each other
    system_digest          a digest of a system, the name of its cached derivation
    smoothness             points where an expression is not smooth
"""
