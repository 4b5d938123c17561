"""Calling compiled functions: arrays, numbers of every type, memory, and their checks.

In: a loaded module and NumPy arrays.
Out: arrays of the same type, written by the C.
Open first: ``binding.Binding``.

    array_checks          arrays and numbers that callers pass, converted and never reinterpreted
    real_numbers          rounding to the stepper's type, numbers as text and bytes; memory
    inputs                inputs of forces, new in every step
    run_memory            structs of compiled code, states of runs, rows of stored states
    binary128             IEEE binary128 as mpmath numbers and 16 bytes
    compiled_module       a compiled module: pointers, structs, whole runs
    binding               the functions of a stepper on NumPy arrays
    binary128_binding     the functions of a float128 stepper
"""
