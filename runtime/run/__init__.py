"""Running: a stepper, one trajectory or many.

    stepper      a compiled stepper, the class of the contract
    evaluation   what a stepper says of a state, and of what a step solves
    start        what a run needs to know of a model
    simulation   a trajectory that is held between calls
    runs         many runs, checked all at once
    lanes        trajectories side by side in a vector register
    ensemble     many trajectories on threads
    between      states of a run between its steps
    crossings    where events happen, by short real steps
    observer     the events of a run that goes on for long
    section      Poincaré sections of many starts
"""
