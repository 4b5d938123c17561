"""Multibody models: rigid bodies with quaternions, joints and forces.

In: bodies, joints and forces with numbers and symbols.
Out: a ``System`` with H(q, p), g(q, t), F(q, p, t), and a consistent start.
Open first: ``multibody.Multibody``, then ``assembly``.

    rigid_body      L(q), R(q), the α- and γ-type kinetic energies, the paper's systems
    symbols         symbols for formulas of one body, as ``gyrospark.symbols``
    body            symbols, points and velocities of one body
    joints          joints, springs and motors: their constraints, energies and forces
    rolling         discs, spheres and ellipsoids that roll on a plane
    beam            beams and cables: chains of segments that bend, twist and stretch
    gaps            gaps of spheres, points and boxes, where momenta jump
    coordinates     flywheels, chains of joints, laws of coordinates
    components      bodies, connections and forces of a model, found by name
    initial_poses   positions and attitudes at the start
    initial_motion  coordinates and velocities at the start: those given are kept, others follow
    assembly        constraints, H and forces from the components
    multibody       the builder of models, ``gyrospark.Multibody``
    model           a system with parameters and an initial state
    models          example models, as ``gyrospark.models``
"""
