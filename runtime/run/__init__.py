"""Running: a stepper, one trajectory or many, why they fail.

    stepper      a compiled stepper, the class of the contract
    evaluation   what a stepper says of a state, and of what a step solves
    parameters   the parameters of a run, in their domains
    start        what a run needs to know of a model
    consistency  whether states are on the constraints
    integration  one integration, in chunks
    newton       T1 driven from Python, open to inspection
    simulation   a trajectory that is held between calls
    failure      why a step failed, and what would do
    runs         many runs, checked all at once
    lanes        trajectories side by side in a vector register
    ensemble     many trajectories on threads
"""
