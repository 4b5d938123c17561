"""Events: where a quantity of a run crosses a level.

    event   what is asked for, and what was found
    watch   the states of a run, looked at step by step
    roots   zeros of many functions at once, in brackets
"""
