"""Figures, films and pages of trajectories.

    figure            a figure that Jupyter shows
    trajectory_plots  figures of a trajectory
    section_plot      figures of Poincaré sections
    ensemble_plot     figures of an ensemble
    motion_plots      figures of a body, a joint, phase portraits
    scene             bodies and joints in space
    animation         a film
    html_view         a page that moves, of view.html and view.js
"""
