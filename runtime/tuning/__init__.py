"""γ, rates of co-moving frames and Δt by pilot runs.

In: a stepper, a start and an error or a duration.
Out: γ, rates of a frame and Δt, with the error to expect.
Open first: ``tune.tune``.

    motion_distance  distance of one motion from another, path by path
    pilots           pilot runs and their errors
    frame_start      rates of a frame by least squares of a state, without a run
    spectral_lines   rates from the spectrum of one motion
    search           trials of rates and γ, Levenberg and Marquardt's steps, the choice
    step_search      the time step that an error asks for
    tune             ``gs.tune``
"""
