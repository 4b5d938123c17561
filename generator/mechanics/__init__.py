"""Systems of ``sympy.physics.mechanics``.

    motion   how frames and points move, in as few terms as there are joints
    methods  what a method holds, as a system from its Lagrangian
"""
