"""Steppers: one trajectory or many.

In: a loaded module and its manifest.
Out: the classes of the public face: ``Stepper``, ``Simulation``, ``Ensemble``.
Open first: ``stepper.Stepper``.

    stepper          a compiled stepper, the class of the contract
    evaluation       energy, constraints and the equations of a step at a state
    differentiation  derivatives of a step and of functions of a run
    dynamics         accelerations, inverse dynamics, mass matrices
    run_defaults     parameters and start of a model, for its runs
    simulation       a trajectory that is held between calls
    ensemble         many trajectories on threads
"""
