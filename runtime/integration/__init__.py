"""Integration: checked arguments, the step loop in chunks, states between steps, failed steps.

In: a start, Δt, a number of steps or t_end.
Out: rows of states and the diagnostics of all steps.
Open first: ``step_loop.integrate``.

    consistency      whether states are on the constraints
    step_loop        one integration, in chunks
    linear_frequency the frequency of the linearised motion at the start of a run
    failure          why a step failed, and what would do
    call_memory      what a call recalls of the one before: all but the state
    starts           what an integration starts from: a start, and the call's arguments
    run_arguments    arguments of one run and of many, checked; the number of steps to a time
    manifest_symmetries  symmetries along which a stepper's frame may move
    lanes            trajectories side by side in a vector register
    dense_output     states of a run between its steps
"""
