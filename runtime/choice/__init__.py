"""γ, co-moving frames and Δt chosen by measurement: pilot runs, their law, a verdict.

    motion_error  how far one motion is from another, path by path
    gamma_pilots  short runs with different γ
    gamma_law     the linear law of the error in 1/γ, and where it is smallest
    gamma_choice  ``choose_gamma``
    frame_start   the rates of a frame by least squares, from states alone
    frame_lines   the same from the lines of a spectrum
    frame_pilots  short runs in different frames
    frame_search  what is tried of frames, and what is chosen
    frame_choice  ``choose_frame``
    step_choice   the time step that an error asks for
    symmetries    what a co-moving frame may move along
"""
