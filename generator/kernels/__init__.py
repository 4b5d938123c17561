"""Kernels: expressions with inputs and outputs, their common parts, C text and numbers of them.

    statements  what a kernel is; neutral: names, expressions, places of the outputs
    kernel      C of it: constants of a run, operation counts
    c_printer   SymPy expressions as C
    in_numpy    the same statements carried out by NumPy, the second way to their numbers
"""
