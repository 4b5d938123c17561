"""Certificates: what a stepper promises and what it shows, each number beside its bound.

    promises        what a scheme promises of a model, derived
    round_off       how large round-off may be in a run
    measurements    reversal, separation, order, trend
    loop_invariant  ∮ p·dq over a closed curve of states
    examination     what a run shows of the promises
    certificate     ``certify``: promises, examination, verdict
    accuracy        errors over the step and over the time it takes, and their picture
    verification    ``gyrospark verify``: tableau, coefficients, order
    reference       the motion to compare with
    citations       ``cite``: the works that a stepper rests on
"""
