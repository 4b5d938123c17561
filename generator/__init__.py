"""Derive and write: from H, g and a tableau to the C of a stepper.

The pipeline, told once; ``pipeline.generate`` runs it. Each room does one part and imports from
rooms above it alone.

    text/         reads text of unknown origin
    algebra/      on expressions: bounded, proved where it can be
    discrete/     exact differences over a step, for EMS
    systems/      q, p, H, g, forces; redundancy, structure, smoothness
    mechanics/    systems of sympy.physics.mechanics
    tableaux/     nodes and coefficients, derived; what they satisfy
    spelling/     any spelling of H, g and F to its one canonical form
    bodies/       quaternion bodies, joints, models
    urdf/         robots of ROS to bodies and joints
    symmetry/     momentum maps
    model_files/  TOML to a model
    kernels/      expressions with inputs and outputs, and C text of them
    schemes/      what a step must solve; what sweeps may use
    emission/     kernels, tableau, templates and files of the engine to header, source and manifest

At the door: ``spec``, what is to be generated, and ``pipeline``.

1. **specify**  command line or Python call → ``Spec``
2. **system**   name, model file or Python → H(q, p), g(q), in one form whatever the spelling
3. **tableau**  scheme and s → exact coefficients from (A.8)-(A.18); what they satisfy is proved
4. **scheme**   system and tableau → what a step must solve: unknowns, kernels
5. **kernels**  expressions → statements with shared subexpressions
6. **emit**     kernels, tableau, templates → header, source, manifest, with the files of
   ``engine/`` that they need

Nothing in this package knows a compiler; nothing in ``runtime`` knows SymPy. The manifest is the
whole contract between the two. This file imports nothing, so ``spec`` costs no SymPy.
"""
