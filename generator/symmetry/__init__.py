"""Symmetries: vector fields that leave H, g and forces alone, and the momentum maps they give.

    linear_fields        fields A q + a that are likely symmetries, with names for people
    rotations            fields whose flow is known in closed form
    symmetry_conditions  conditions of a symmetry, in exact arithmetic
    near_symmetries      how far a field is from being one
    momentum_maps        conserved momentum maps, with their proofs
    frame_symmetries     symmetries along which a frame may move
"""
