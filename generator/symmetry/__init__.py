"""Symmetries: vector fields that leave H, g and forces alone, along which a frame may move.

    linear_fields        fields A q + a that are likely symmetries, with names for people
    rotations            fields whose flow is known in closed form
    symmetry_conditions  conditions of a symmetry, in exact arithmetic
    frame_symmetries     symmetries along which a frame may move
"""
