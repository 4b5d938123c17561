"""How fast, how exact: gyrospark beside other programs; ``make bench``, no part of the package.

In: a choice of the command line (``Choice``).
Out: rows of a table: program, setting, errors, CPU time.
Open first: ``rows.contest``.

What comes in is public: ``import gyrospark as gs``.

    rows             a row of any benchmark: measured in turn, printed, drawn, JSON
    timing           CPU time, jobs in turn, medians
    machine          what a result was measured with
    peers/           one file a program; each is optional
    equal_error      programs at equal error: the page docs/peers.md
    tops, fast_top   the paper's fast top: top, step, ensemble, drift
    reference_states   where the top is at t = 1, 10, 100 and 1000 s, in long double
    scenes, attitudes  bodies on joints as other programs build them; rotations
    bodies           a chain, a four-bar, models of sympy.physics.mechanics, batches
    scale            costs against bodies, stages, trajectories and stored numbers
    stores, sweeps   runs in a store; sweeps beside ensembles
    events           events and states between steps
    impacts          elastic impacts of a ball and of a stop
    adaptive         eccentric orbits in scaled time
    gradients        gradients of a loss, and what derivatives cost over the run
    references, reference_bodies, reference_scenes   problems with known digits, other programs
    robots           mechanisms with closed loops over many steps

Programs of their own: ``python -m benchmarks.NAME``::

    fits                  how often estimates of ``gs.fit`` are within two standard deviations
    derivative_accuracy   derivatives of one step of every problem and model
    make_digits           digits of reference problems two ways: ``exact_motions_mp``, ``loops``,
                          ``equations``, ``extrapolation``
    make_reference        the states of ``reference_states``, with heyoka
    callgrind             instructions of one step, which guard the speed in CI

Every time is CPU time on one machine in one run; ratios travel, times do not.
"""
