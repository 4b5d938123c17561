"""Certificates: guaranteed and measured properties of a stepper, each number with its bound.

    guarantees           properties that a scheme guarantees for a model, derived
    round_off            bounds of round-off in a run
    measurements         reversal, separation, order, trend
    loop_invariant       ∮ p·dq over a closed curve of states
    measured_properties  measurements of the guaranteed properties in a run
    certificate          ``certify``: guarantees, measurements, verdict
    accuracy_over_time   errors over the step and over the time it takes, and their figure
    verification         ``gyrospark verify``: tableau, coefficients, order
    reference_motion     the motion to compare with
    citations            ``cite``: the works that a stepper rests on
"""
