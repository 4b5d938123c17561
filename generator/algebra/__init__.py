"""Algebra on expressions, beside SymPy: bounded, without detours, and proved where it can be.

    bounded_algebra  multiplying out and factoring, given up where they take too long
    derivatives      derivatives without SymPy's detours
    sharing          expressions as graphs: what they share is visited once
    switches         functions with two sides: |u|, max, where
    pieces           an expression with conditions as pieces of one variable
    cardinal         f(z)/z, what a divided difference leaves of a function
    evaluation       expressions as numbers, by NumPy or mpmath
    rounding         what rounding is worth in an expression: a running error analysis
    identities       whether two expressions are the same function: proved, or seen
    residues         whether an expression vanishes, decided in finite fields
    rational_spaces  null spaces over the rational numbers, exactly
"""
