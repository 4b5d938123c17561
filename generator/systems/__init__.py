"""Systems: q, p, H, g and forces, and what is found out about them before anything is emitted.

    system          a constrained Hamiltonian system and its derivatives
    given           what a caller gives of one, checked
    places          where bodies and joints are in it
    given           what users give, as expressions
    lagrangian      a system from its Lagrangian, M(q) never inverted in symbols
    numeric_system  the same with numbers, in NumPy
    redundancy      constraints that others imply
    jacobians       matrices of derivatives
    moving          a system in a co-moving frame
    structure       the few forms that many terms have, and how they hang together
    elimination     orders of rows that leave zeros what they are
    smoothness      where sides do not meet smoothly
"""
