"""Bounded algebra on expressions, on top of SymPy, with proofs where possible.

In: expressions.
Out: derivatives, factors, equalities; each is proved, or said to be sampled.
Open first: ``derivatives``, then ``identities``.

    bounded_algebra        bounds of the size of an expansion or a factorisation
    polynomials            expansion of polynomials with rational coefficients
    derivatives            derivatives by SymPy's rules, in fewer operations
    construction           sums and products that need no simplification
    shared_subexpressions  expressions as directed acyclic graphs
    switching_functions    functions with switches: |u|, max, min, if
    piecewise              an expression with conditions as a piecewise function of one variable
    cardinal_functions     f(z)/z, which divided differences contain
    phases                 t = t0 + τ: no digits are lost at a late time
    numeric_evaluation     values of expressions, by NumPy or mpmath
    rounding_errors        a running error analysis of an expression
    identities             equality of two expressions: proved, or sampled at random points
    finite_fields          test for zero, in exact arithmetic modulo primes
    null_spaces            exact null spaces over the rational numbers
"""
