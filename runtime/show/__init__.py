"""Pictures of trajectories, and what the ending of a file says.

    endings        .npz, .csv, .nc, .zarr, .png, ...
    picture        a figure that Jupyter shows
    plots          pictures of a trajectory
    section_plot   pictures of Poincaré sections
    ensemble_plot  pictures of an ensemble
    motion_plots   pictures of a body, a joint, phase portraits
    scene          its bodies and joints in space
    animation      a film
    view           a page that moves, of view.html and view.js
"""
