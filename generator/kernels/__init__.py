"""Kernels: expressions with inputs and outputs, their common parts, C text and numbers of them.

    statements     a kernel as statements: names, expressions, outputs
    kernel         C of it: constants of a run, operation counts
    c_printer      SymPy expressions as C
"""
