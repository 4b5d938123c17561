"""How fast, how exact: gyrospark beside other programs on the paper's fast top.

    tops.py         the problem, as gyrospark and as its peers see it
    reference_states.py    where the top is at t = 1, 10, 100 and 1000 s, in long double
    peers/          one file a program; each is optional
    timing.py       CPU time, contestants in turn, medians
    contest.py      entries timed and judged: the table of ``make bench WHAT="peers"``
    steps.py        one step by each solver, over dense Newton: ``make bench WHAT="step"``
    ensembles.py    many tops at once: ``make bench WHAT="ensemble"``
    drift.py        energy and position over a long time: ``make bench WHAT="drift"``
    growth.py       chains of bodies: ``make bench WHAT="bodies"``, with ``joined_bodies.py`` and
                    ``batches.py``
    scaling.py      bodies, stages, trajectories, stored numbers: ``make bench WHAT="scale"``
    storing.py      runs in memory and in a store: ``make bench WHAT="store"``
    sweeping.py     sweeps beside their kernel: ``make bench WHAT="sweeps"``
    events.py       events and states between steps: ``make bench WHAT="events"``
    gradients.py    gradients of a loss: ``make bench WHAT="gradients"``; ``derivative_cost.py``
    fits.py         fits to noisy data from many seeds: ``python -m benchmarks.fits``
    make_digits.py  digits of reference problems two ways: ``exact_motions_mp.py``, ``loops.py``,
                    ``equations.py``, ``extrapolation.py``
    long_runs.py    mechanisms with closed loops over many steps: ``gyrospark reference robots``
    derivative_accuracy.py  derivatives of one step of every problem and model
    callgrind.py    instructions of one step, which guard the speed in CI

Every time is CPU time on one machine in one run; ratios travel, times do not.
"""
