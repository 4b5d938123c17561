"""Certificates: guaranteed and measured properties of a stepper, each number with its bound.

In: a model and a scheme.
Out: a ``Certificate``: a line with value, bound and verdict for each property.
Open first: ``certificate.certify``.

    guarantees           properties that a scheme guarantees for a model, derived
    round_off            bounds of round-off in a run
    measurements         reversal, separation, order, trend
    loop_invariant       ∮ p·dq over a closed curve of states
    measured_properties  measurements of the guaranteed properties in a run
    certificate          ``certify``: guarantees, measurements, verdict
    accuracy_over_time   errors over the step and over the time it takes, and their figure
    verification         ``gyrospark verify``: tableau, coefficients, order
    citations            ``cite``: the works that a stepper rests on
    midpoint_conditions  conditions that IMS and EMS satisfy
    observed_order       the order of a tableau as measured
    momentum_maps        conserved momentum maps of symmetries, with their proofs
    near_symmetries      how far a field is from being a symmetry
    splitting_proofs     flows, invariants and sums of the parts of a splitting, proved by algebra
    lyndon_words         coefficients of products of exponentials, at Lyndon words
    composition_proofs   order conditions of compositions, by Newton and Krawczyk
    composition_order    the order of a composition as measured
    composition_checks   everything that verify checks of a composition
"""
