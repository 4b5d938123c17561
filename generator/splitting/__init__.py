"""Splitting of H into parts whose flows are known in closed form.

    parts   the parts: rotations, translations, kicks, and their flows
    find    the search for a splitting of a system
    proofs  flows, invariants and sums of the parts, proved by algebra
"""
