"""Keep and run: compile a stepper's C once, cache it, call it. Knows cffi and NumPy, no SymPy."""
