"""γ, co-moving frames and Δt chosen by measurement: pilot runs and the law of their errors.

    motion_distance      how far one motion is from another, path by path
    gamma_search         short runs with different γ, the law of their errors in 1/γ
    gamma_choice         ``choose_gamma``
    frame_start          the rates of a frame by least squares, from states alone
    frame_search         short runs in different frames, spectral lines, the search
    frame_choice         ``choose_frame``
    step_choice          the time step that an error asks for
    manifest_symmetries  symmetries along which a stepper's frame may move
"""
