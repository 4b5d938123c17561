"""γ and co-moving frames chosen by measurement: pilot runs, the law of their error, a verdict.

    motion_error  how far one motion is from another, path by path
    gamma_pilots  short runs with different γ
    gamma_law     the linear law of the error in 1/γ, and where it is smallest
    gamma_choice  ``choose_gamma``
    symmetries    what a co-moving frame may move along
"""
