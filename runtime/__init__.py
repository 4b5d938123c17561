"""Compile a stepper's C once, cache it, call it. Knows cffi and NumPy, no SymPy.

A package imports only from packages above it.

    compilation/  text of a stepper to its loaded module
    bindings/     compiled functions on arrays of every type
    rigid_body/   quaternions, inertia rules for γ, exact motions, the paper's problems
    plotting/     figures, films, pages
    results/      trajectories, diagnostics, crossings, tables, files
    integration/  the step loop, its arguments, dense output, failed steps
    tuning/       γ, rates of moving frames and Δt by pilot runs
    events/       detection and location of events, Poincaré sections
    derivatives/  tangents and adjoints of steps and runs, gradients
    devices/      ensembles on graphics cards
    steppers/     steppers, simulations, ensembles
    analysis/     fits, Lyapunov exponents, periodic orbits
"""
