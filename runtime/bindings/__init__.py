"""Calling compiled functions: arrays, numbers of every type, memory, and their checks.

    array_checks          arrays and numbers that callers pass, converted and never reinterpreted
    real_numbers          numbers rounded once to the stepper's type
    inputs                inputs of forces, new in every step
    struct_memory         memory whose bytes mean the same wherever they lie
    wide_numbers          numbers wider than a double as bytes
    binary128             IEEE binary128 as mpmath numbers and 16 bytes
    compiled_module       a compiled module: pointers, structs, whole runs
    binding               the functions of a stepper on NumPy arrays
    binary128_binding     the same of a float128 stepper
    compiled_constraints  g and g_q of a compiled stepper
"""
