"""Errors, argument checks, numbers, registries: used by every package, importing none.

In: values that users pass.
Out: the same values, checked and converted, or an error with its cure.
Open first: ``errors``, then ``manifest``.

    errors         every error that is raised on purpose
    arguments      checks of names, paths, flags and lists, with the closest match for a wrong name
    arrays         types of arrays in annotations
    calls          arguments that do not fit a function, told by a sentence
    former_names   names of earlier versions, and the present ones
    exact_numbers  real numbers of any kind, exactly, and their one rounding
    real_types     floating-point types: float, double, long double, float128
    units          SI units by name
    inertia        moments of inertia, attitude and angles of a rigid body, checked
    mesh_files     triangles of STL and OBJ files
    shapes         boxes, spheres, discs, bars and meshes that bodies are drawn with
    incompatibilities  pairs of features that cannot be combined, with reason and cure
    event          an event: a quantity of a run crosses a level
    start          where a motion starts: state, parameters, time, inputs
    solver         how the equations of a step are solved
    registry       named systems, problems and models
    warnings       warnings about accepted but suspicious input
    projection     states projected onto the constraints
    frozen_dict    a dict that refuses changes
    records        copies of frozen dataclasses, made without their checks
    json_records   frozen dataclasses as JSON, and back
    strict_json    JSON text, with null for numbers that JSON does not have
    manifest       the manifest of a stepper: the contract of generator and runtime
    html           tables and formulas as HTML for notebooks
    file_formats   the ending of a file's name
    interrupts     Ctrl-C and signals: finish the step, then stop
    progress       messages about work that takes seconds
    extras         optional packages and the command that installs them
    lazy_imports   large imports without garbage collection
"""
