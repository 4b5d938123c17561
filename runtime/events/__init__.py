"""Events: where a quantity of a run crosses a level. Their record is ``results.crossings``.

In: states of a run, step by step, and levels.
Out: times and states of crossings and impacts.
Open first: ``detection.EventDetector``.

    detection         steps in which a value changes its sign
    zeros             zeros of many functions by Chandrupatla's method
    location          times and states of events, by short real steps
    last_step         the part of a step to a time between two steps
    observer          the events of a long run, located in pieces
    end_time          the end of a run in scaled time
    impact_observer   runs with impacts, which compiled code locates
    poincare_section  Poincaré sections of many starts
"""
