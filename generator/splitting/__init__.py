"""Splitting of H into parts whose flows are known in closed form.

In: a system of bodies without joints.
Out: a ``Splitting``: H = T₁ + … + V, each part with an exact flow.
Open first: ``decomposition.split``.

    decomposition  the splitting of a system, derived from its H
    parts          the parts: rotations, translations, kicks, and their flows
    kicks          torques of potentials and forces in space axes
    quotient       normal forms modulo |q|² = 1
"""
