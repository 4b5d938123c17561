"""Results of a run: states, computed quantities, diagnostics, crossings, files.

In: rows of states and a manifest.
Out: a ``Trajectory``: computed quantities by name, tables, files.
Open first: ``trajectory.Trajectory``.

    diagnostics         diagnostics over every step
    crossings           the crossings of an event, in one run and in many
    outputs          the list of a run's arrays, for all that holds, writes, reads or draws them
    trajectory          what an integration returns
    tangent_rows        derivatives of the stored states of a run
    trajectory_file     its .npz
    body_motion         one body of it: attitude, angles, velocities, momenta
    joint_motion        one joint of it: angle, force, torque
    beam_motion         a beam of it: centre line, curvature, force and moment of its sections
    present_motion      bodies and joints of a simulation, at its present state
    start_of_row        the start that a state of a run is for another run
    rotation_rate       how far the fastest body turns in a step, and how far is sound
    missed_rates        whether a time scale misses a rate of the motion
    trajectory_display  tables, figures, pages, films and notebook output of a trajectory
    table               a run or an ensemble as a dataset, a data frame, .csv, .nc, .parquet
    load                the run of a file or store
    state_columns       the states as columns, under their names
"""
