"""Model files: TOML of a user's own model, read key by key.

    model_file         the door: one file to a ``Model``
    model_table        tables of TOML; every refusal names file and key
    model_expressions  formulas in named symbols
    model_parts        parameters, quantities, run length: what all kinds share
    attitude           the start of a body in numbers, to 50 digits
    model_body         a body with a fixed point
    model_bodies       several bodies with joints
    robots             URDF, and what closes a robot's loops
    model_system       any Hamiltonian system
"""
