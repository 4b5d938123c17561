"""Tableaux: exact nodes and coefficients, derived from conditions, and the conditions they satisfy.

In: a family and s, a user's A, b, c, or a composition.
Out: exact coefficients, and the conditions that they satisfy.
Open first: ``families.gauss_lobatto``.

    node_algebra       functions on a set of nodes, exactly
    nodes              roots of polynomials, exact and in certified enclosures
    families           Gauss-Lobatto, Lobatto IIIA-B and Radau-Lobatto from (A.8)-(A.16)
    tableau            a SPARK tableau: exact, rounded once
    completion         a Butcher tableau, completed to a SPARK tableau
    tableau_file       a user's tableau, from JSON or Python
    enclosures         enclosures of the coefficients, proved
    separation_bounds  a proof that a number with radicals is zero, or is not
    multipliers        M = Ā Ã, the effect of multipliers on constraints at the nodes
    velocity_rows      V, weights of constraint forces where velocity constraints hold
    stability          R(z) of a fast decay: A-stable, L-stable, numerical damping
    energy_parameter   free numbers of Gauss-Lobatto for a step of exact energy
    conditions         each condition as a residual, and predicates derived from it
    compositions       compositions of exact flows, with 60 digits from compositions.json
"""
