"""Kernels: functions of arrays, given by expressions, and their C.

In: arrays of symbols, and expressions of them.
Out: statements in C with shared subexpressions, and their operation counts.
Open first: ``kernel.emit_kernel``.

    statements             a kernel as statements: shared subexpressions, then outputs
    common_subexpressions  temporaries for what recurs, as ``sympy.cse`` has them
    kernel                 C of a kernel: constants of a run, operation counts
    c_printer              SymPy expressions as C
"""
