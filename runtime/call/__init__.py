"""Calling compiled functions: arrays, numbers of every type, memory, and the checks of both.

    checks                what callers pass in, converted and never reinterpreted
    reals                 numbers rounded once to the stepper's type
    inputs                numbers that forces have anew in every step
    memory                memory whose bytes mean the same wherever they lie
    wide                  numbers wider than a double as bytes
    quad                  IEEE binary128 as mpmath numbers and 16 bytes
    compiled              a compiled module: pointers, structs, whole runs
    binding               the functions of a stepper on NumPy arrays
    quad_binding          the same of a float128 stepper
    compiled_constraints  g and g_q of a compiled stepper
"""
