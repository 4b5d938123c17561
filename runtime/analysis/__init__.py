"""What a motion tells: parameters that fit measured data.

    fit                 parameters and start of a motion by least squares
    observations        what is measured of a state, its residuals and their derivatives
    fit_coordinates     coordinates of parameters in which each step stays physical
    least_squares       Levenberg-Marquardt by singular values; undetermined combinations
"""
