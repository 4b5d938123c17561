"""Rigid bodies: quaternions, joints, and the models put together from them.

    rigid_body      L(q), R(q), the α- and γ-type kinetic energies, the paper's systems
    body_symbols    the symbols of formulas of one body, as ``gyrospark.symbols``
    body            one body: its symbols, points and velocities in space
    joints          joints and springs: attachments and equations
    sliding_joints  joints that slide, screw, cross or mesh
    connections     a method for each kind of joint
    forces          potentials, forces, motors, springs and quantities
    initial_poses   positions and attitudes at the start
    layout_records  coordinates of bodies and joints in their system
    multibody       bodies, joints and forces, put into a model
    model           a system with the numbers to run it with
    example_models  models to start from, as ``gyrospark.models``
"""
