"""Code generation: kernels, tableau and templates to the header, the source and the manifest.

    emit            the three files of a stepper
    emit_manifest   what is promised, for those who call it
    profiles        how much of a stepper is written: for Python, for a controller
    emit_control    what they are told of sweeps on plain numbers: profiles control and run
    emit_fast       what the templates are told of the fast path
    emit_mass       M(q) of a Lagrangian: how it is eliminated, what that costs
    emit_structure  what they are told of a structured system
    bytecode        templates as Python's bytecode, kept beside them
    engine          which files of ``engine/`` a stepper has, and how they are put in
    reachable       what the functions of a header come to
    c_lines         lines of C that fit on a screen
    solver_costs    what a sweep and a Newton iteration cost, counted
"""
