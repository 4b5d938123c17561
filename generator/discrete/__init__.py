"""Exact differences over a step: the discrete gradient that the energy-momentum scheme needs.

    difference          an expression seen from both ends of a step
    discrete_functions  differences of powers and elementary functions
    discrete_switches   differences of functions with two sides
    discrete_gradient   differentiation with an exact chain rule, and the list of its rules
"""
