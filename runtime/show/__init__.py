"""Pictures of trajectories, and what the ending of a file says.

    endings  .npz, .csv, .nc, .zarr, .png, ...
    picture  a figure that Jupyter shows
    plots    pictures of a trajectory
    scene    its bodies and joints in space
    view     a page that moves, of view.html and view.js
"""
