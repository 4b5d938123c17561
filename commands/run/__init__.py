"""``gyrospark run``.

In: a problem, a model file or a robot, and options.
Out: the report of a run, states, pictures.
Open first: ``command.run``.

    command  the options, and the run
    starts   the stepper and the start of what is named
    choices  steps, γ, α and a moving frame, chosen as the options ask
    outputs  where the states go: memory and .npz, or a store
    report   the result as JSON and as text
"""
