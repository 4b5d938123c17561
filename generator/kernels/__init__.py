"""Kernels: functions of arrays, given by expressions, and their C.

    statements     a kernel as statements: shared subexpressions, then outputs
    kernel         C of a kernel: constants of a run, operation counts
    c_printer      SymPy expressions as C
"""
