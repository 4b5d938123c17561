"""Keep and run: compile a stepper's C once, cache it, call it. Knows cffi and NumPy, no SymPy.

    build/   text of a stepper to its loaded module
    call/    compiled functions on arrays of every type
    body/    the rigid body in numbers
    choice/  γ chosen by measurement
    events/  where a quantity crosses a level
    show/    pictures, endings of files
    output/  what a run returns, and its file
    steps/   one integration, step by step
    run/     steppers, single runs, ensembles

At the door: ``interrupts``, Ctrl-C and the end a cluster asks for, and ``notices``, what takes
seconds is said.
"""
