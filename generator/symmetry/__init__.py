"""Symmetries: vector fields that leave H, g = 0 and forces invariant; co-moving frames.

In: a system.
Out: linear vector fields that leave it invariant, for co-moving frames.
Open first: ``frame_symmetries.frame_of``.

    linear_fields        fields A q + a that are likely symmetries, with readable names
    rotations            fields whose flow is known in closed form
    symmetry_conditions  conditions of a symmetry, in exact arithmetic
    frame_symmetries     symmetries along which a frame may move
"""
