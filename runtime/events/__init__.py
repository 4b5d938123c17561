"""Events: where a quantity of a run crosses a level.

    found   where it happened
    watch   the states of a run, looked at step by step
    roots   zeros of many functions at once, in brackets
"""
