"""Derive and write: from H, g and a tableau to the C of a stepper.

``pipeline.generate`` runs the steps below. A package imports only from packages above it.

    parsing/       text of unknown origin to expressions and numbers
    symbolic/      algebra on expressions: bounded, proved where it can be
    kernels/       expressions with inputs and outputs, and C text of them
    systems/       q, p, H, g, forces; redundant constraints, structure, smoothness
    tableaux/      nodes and coefficients, derived; what they satisfy
    normal_forms/  H, g and F in one normal form
    multibody/     quaternion bodies, joints, models
    symmetry/      momentum maps, symmetries of moving frames
    models/        model files: TOML and URDF
    splitting/     H as a sum of parts with flows in closed form, proved
    schemes/       equations of a step; discrete gradients; structure for fixed-point iteration
    codegen/       kernels, tableau, templates and files of the engine to header, source, manifest

Beside the packages: ``spec``, the checked request, ``pipeline``, and ``fingerprint``, of this text.

1. **specify**  command line or Python call → ``Spec``
2. **system**   name, model file or Python → H(q, p), g(q) in normal form
3. **tableau**  scheme and s → exact coefficients from (A.8)-(A.18); what they satisfy is proved
4. **scheme**   system and tableau → the equations of a step: unknowns, kernels
5. **kernels**  expressions → statements with shared subexpressions
6. **emit**     kernels, tableau, templates → header, source, manifest, with the files of
   ``engine/`` that they need

Nothing in this package knows a compiler; nothing in ``runtime`` knows SymPy. The manifest is the
whole contract between the two. This file imports nothing, so ``spec`` costs no SymPy.
"""
