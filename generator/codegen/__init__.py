"""Code generation: from a derived stepper to the header, the source and the manifest.

In: a scheme for a system, its kernels, a tableau.
Out: three texts: header, source, manifest.
Open first: ``emit.emit``.

    profiles         the amount of C: for Python, for programs in C, for a controller
    program          the C program as one typed description
    mass_tables      the elimination of the mass matrix of a Lagrangian
    elements         a system as sums over element templates
    element_derivatives  kernels of element templates for derivatives of a step
    derivatives      tangents and adjoints of a stepper
    second_order     second derivatives of a stepper, by dual numbers
    lane_iteration   the fixed-point iteration of profile full, on lanes
    plain_iteration  the fixed-point iteration of profiles control and run, on plain numbers
    splitting_flows  compositions of exact flows: tables, weights, kernels
    condensation     pattern of Newton's system without the rates of momenta
    constant_loops   constants of a run as loops over tables
    solver_costs     operation counts of an iteration of either solver
    state_functions  functions of one state: energy, quantities, momenta of velocities
    manifest_numbers roles, units and values of a stepper's numbers
    manifest         the guarantees of the C, for its callers
    bytecode         templates as Python's bytecode, cached beside them
    c_lines          line breaks in generated C
    emit             the three files of a stepper
"""
