"""γ, co-moving frames and Δt chosen by measurement: pilot runs and the law of their errors.

    motion_distance      how far one motion is from another, path by path
    gamma_pilots         short runs with different γ
    gamma_error_law      the linear law of the error in 1/γ, and its minimum
    gamma_choice         ``choose_gamma``
    frame_start          the rates of a frame by least squares, from states alone
    frame_spectrum       the same from the lines of a spectrum
    frame_pilots         short runs in different frames
    frame_search         the search over frames
    frame_choice         ``choose_frame``
    step_choice          the time step that an error asks for
    manifest_symmetries  symmetries along which a stepper's frame may move
"""
