"""What a run returns: states, what is computed of each, the record of every step, the file.

    report           diagnostics over every step
    outputs          the list of a run's arrays, for all that holds, writes, reads or draws them
    trajectory       what an integration returns
    trajectory_file  its .npz
    body_motion      one body of it: attitude, angles, velocities, momenta
    placed_motion    motion of a body whose place and attitude are quantities
    joint_motion     one joint of it: angle, force, torque
    turning          how far the fastest body turns in a step, and how far can be borne
    shown            what it shows of itself
    tables           CSV, pandas, xarray
    ensemble_table   an ensemble as xarray, .npz, .csv, .nc
    states           the states as columns, under their names
"""
