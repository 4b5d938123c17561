"""Figures, films and pages of trajectories.

In: a trajectory.
Out: a figure, picture, film, page or 3-D model.
Open first: ``scene.scene_of`` for bodies, ``trajectory_plots`` for curves.

    figure            a figure that Jupyter shows
    trajectory_plots  figures of trajectories, Poincaré sections and ensembles
    analysis_plots    figures of Lyapunov exponents and periodic orbits
    motion_plots      figures of a body, a joint, phase portraits
    scene             bodies and joints in space
    body_shapes       the shapes that bodies are drawn with: tops, wheels, bars
    solids            triangles of shapes
    rasterizer        triangles to pixels, and PNG
    show              a page, a picture, a film or a model by the ending of a name
    picture           a picture of bodies
    animation         a film
    gltf              a 3-D model that moves, for other programs
    meshes            meshes of robots within the bytes of a page
    html_view         a page that moves: view.html, view.css, view.js; solids.js has the shapes of
                      bodies, webgl.js draws triangles, scene.js a scene, also without WebGL;
                      the camera is in scene.js, for pictures in picture
"""
