"""Bounded algebra on expressions, on top of SymPy, with proofs where possible.

    bounded_algebra        expansion and factoring, given up where they take too long
    derivatives            derivatives without SymPy's detours
    shared_subexpressions  expressions as graphs: a shared part is visited once
    switching_functions    functions with two sides: |u|, max, where
    piecewise              an expression with conditions as a piecewise function of one variable
    cardinal_functions     f(z)/z, which divided differences contain
    phases                 a late time as a start and the time since, which keeps its digits
    numeric_evaluation     expressions as numbers, by NumPy or mpmath
    rounding_errors        a running error analysis of an expression
    identities             whether two expressions are the same function: proved, or sampled
    finite_fields          whether an expression vanishes, decided modulo primes
    null_spaces            null spaces over the rational numbers, exactly
"""
