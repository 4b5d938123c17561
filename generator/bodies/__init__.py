"""Rigid bodies: quaternions, joints, and the models put together from them.

    rigid_body      L(q), R(q), the α- and γ-type kinetic energies, the paper's systems
    symbols         the symbols of formulas of one body, as ``gyrospark.symbols``
    bodies          a body as a maker of expressions: points and velocities in space
    joints          what joints and springs hold on to
    poses           where bodies are at the start
    pairs           joints that slide, screw, cross or mesh
    linkage         a method for each kind of joint
    loads           potentials, forces, motors, springs and quantities
    records         where they are in their system
    multibody       bodies, joints and forces, put into a model
    model           a system with the numbers to run it with
    example_models  models to start from, as ``gyrospark.models``
"""
