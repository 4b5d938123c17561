"""Derivatives of steps and runs: tangents, adjoints, gradients, Hessians.

In: a run and directions of its start, or cotangents.
Out: tangents, gradients and Hessians of the discrete motion.
Open first: ``gradient.gradient_of``.

    frame               states of a co-moving frame in space, and their derivatives
    tangent_space       directions of a start on the constraints
    binding             the compiled module of derivatives; steps with their unknowns
    kept_steps          steps of a run that are kept; a single one with its derivatives
    points              states within steps, at given times and at events, with derivatives
    impacts             a step with impacts: derivatives of its parts, jumps and times
    tangent_run         tangents along a run
    gradient            gradients of functions of a run
    second_order        Hessians of functions of a run, and the module for them
    motion              accelerations of states and mass matrices, and the module for them
    value_and_gradient  a function of a vector with its gradient, for optimisers
"""
