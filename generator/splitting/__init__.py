"""Splitting of H into parts whose flows are known in closed form.

    find      the search for a splitting of a system
    parts     the parts: rotations, translations, kicks, and their flows
    kicks     torques of potentials and forces in space axes
    quotient  normal forms modulo |q|² = 1
"""
