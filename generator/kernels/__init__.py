"""Kernels: expressions with inputs and outputs, their common parts, and C text of them.

    kernel     what a kernel is, constants of a run, common subexpressions, operation counts
    c_printer  SymPy expressions as C
"""
