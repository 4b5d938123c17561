"""Sphinx extension: words that a reader types → the place that answers, first in the search.

A word is an entry of Sphinx's search index, as of an ``index`` directive: typed as a whole, it has
a higher score than titles and text (searchtools.js: 100 against 16).
"""

from __future__ import annotations

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util import logging

__all__ = ["SYNONYMS"]

LOGGER = logging.getLogger(__name__)

#: Page, and a heading of it where the answer is not at its top → words, at most one place each.
SYNONYMS = {
    "bodies": "joint, hinge, revolute, pin joint, slider, spherical joint, rigid body, multibody, "
              "spring, damper, gear, motor, actuator, linkage, mechanism, rotor, flywheel, "
              "armature, fixed, fixed joint, weld, motor torque, joint torque",
    "bodies#contacts-and-stops": "contact, contacts, collision, impact, impacts, restitution, "
                                 "bouncing ball, joint limit, joint limits, end stop",
    "beams": "beam, beams, cable, rope, rod, elastica, flexible, flexible body",
    "benchmarks": "speed, performance, benchmark",
    "build": "export, library, rust, c++, octave, arduino",
    "c": "microcontroller, embedded, c code, misra, export c, raspberry pi, esp32, stm32",
    "chaotic_motion": "lyapunov, lyapunov exponent, chaos, chaotic, poincaré section, "
                      "poincare section, megno",
    "cheat_sheet": "cheat sheet, overview, quick start, quickstart, commands",
    "choosing#step": "timestep, time step, step size, stepsize, dt, tolerance",
    "choosing#scheme": "integrator, solver, scheme, method, rk4, runge-kutta, verlet, implicit, "
                       "order of accuracy, rattle, shake, stiff, stiff system, radau",
    "choosing#the-parameter-γ": "gamma, alpha, inertia representation",
    "comparison": "alternatives, versus, comparison",
    "coming_from#pinocchio": "pinocchio, crba, rnea, aba, nle, frame jacobian, "
                             "jacobian of a point, regressor",
    "coming_from": "mujoco, exudyn, heyoka, pydy, matlab, simscape, simulink, ode45, translation",
    "controllers": "controller, real time, real-time, control loop, cortex, deploy, "
                   "hardware in the loop, hil, flight computer, on-board",
    "conventions": "units, quaternion order, scalar first, axes, euler angles, gimbal lock, "
                   "angular velocity, moment of inertia, attitude, inertia matrix, "
                   "products of inertia, inertia tensor",
    "cuda": "gpu, graphics card, nvidia",
    "derivatives": "gradient, sensitivity, adjoint, optimisation, optimization, jacobian",
    "fmu": "fmi, co-simulation, dymola, export fmu, fmu export",
    "frames": "spin, fast rotation, co-rotating frame",
    "gallery/fitted_top": "fit, fitting, parameter estimation, calibration, least squares, "
                          "fitting parameters",
    "glossary": "degrees of freedom, degree of freedom, dof, glossary, holonomic, "
                         "nonholonomic",
    "install": "getting started, installation, compiler, pip, windows, conda, gyrospark_cache",
    "lagrangian": "lagrangian, mass matrix, kane, sympy mechanics",
    "limits": "limits, limitations, friction",
    "long_runs": "resume, store, zarr, checkpoint, restart, restart simulation, continue a run",
    "models": "toml, model file",
    "models#a-robot-from-a-file": "robot, robots, robot from a file, a robot from a file, "
                                  "robot arm, humanoid, load robot",
    "models#robots-in-mjcf": "mjcf, mujoco xml, keyframe, dampratio",
    "models#robots-in-sdf": "sdf, gazebo",
    "models#robots-in-urdf": "urdf, ros, xacro",
    "python#ensembles": "batch, monte carlo, parallel, simd",
    "results#pictures-and-animations-of-bodies": "animation, video, movie, 3d view, gui, viewer, "
                                                 "visualisation, visualization, render, gif, "
                                                 "animation gif",
    "results": "reaction force, constraint force, csv, pandas, output, joint angle, joint angles",
    "results#bodies": "end effector, tool centre point",
    "models#limits-of-joints": "joint range, range of a joint, limits of joints",
    "results#accelerations": "acceleration, accelerations, qacc, inverse dynamics, "
                             "gravity compensation",
    "results#pictures": "plot, figure, plot trajectory, plot energy",
    "citing": "license, licence, bsd, cite, citation, doi",
    "tutorials/forces_and_control": "pid, pid controller, feedback",
    "python#initial-values": "initial conditions, initial condition, initial state, "
                             "initial velocity, angular velocity to momentum, "
                             "initial angular velocity",
    "adaptive_steps": "adaptive, adaptive step, adaptive time step, variable step, "
                      "variable time step, error control",
    "optimal_control": "optimal control, trajectory optimisation, trajectory optimization, "
                       "shooting, collocation, ipopt, mpc, tracking, "
                       "model predictive control, reference tracking",
    "identification": "identification, system identification, identify, friction coefficient",
    "solving": "newton, convergence, fixed point, iteration",
    "stability": "version, deprecation, semantic versioning, api changes",
    "sweeps": "parameter sweep, parameter scan, grid, study",
    "systems": "hamiltonian, own system, constraint, dae, index 3, "
               "differential-algebraic equation, index 3 dae, custom system, custom hamiltonian, "
               "potential",
    "systems#events": "event, events, zero crossing, root finding, stop condition",
    "systems#forces": "force, drag, damping, external force",
    "systems#inputs": "input, control input, actuation, zero-order hold, zero order hold",
    "theory/symplecticity": "symplectic, symplecticity, energy drift",
    "troubleshooting": "error, help, faq, troubleshooting, stagnated, diverged, change point, "
                       "not converged, energy error, slow, inverse kinematics, error message, "
                       "error messages, forward kinematics",
    "tutorials/reaction_wheels": "reaction wheel, reaction wheels, attitude control, satellite, "
                                 "pd controller",
    "tutorials/forces_and_control#a-linear-quadratic-regulator": "lqr, "
                                                                 "linear quadratic regulator, "
                                                                 "state space, linearise, "
                                                                 "linearize, linearisation, "
                                                                 "linearization, kalman filter, "
                                                                 "riccati, cart-pole, cart pole, "
                                                                 "cartpole, discrete time, "
                                                                 "transfer function",
    "gallery/satellite": "gravity gradient, orbital motion, jacobi constant, orbit axes, "
                         "lvlh, nadir",
    "gallery/dzhanibekov": "torque free, torque-free, free rigid body, tennis racket, "
                           "intermediate axis",
    "gallery/work_and_precision": "work precision, convergence order, convergence plot",
    "gallery/many_digits": "float128, quadruple precision, extended precision",
    "theory/multipliers": "lagrange multiplier, lagrange multipliers",
    "theory/discrete_gradients": "energy conservation, discrete gradient",
    "install#in-a-notebook": "jupyter, notebook, google colab, colab",
    "tutorials/pendulum_to_chain": "first example, pendulum example, first steps, hello world",
    "reference/examples": "examples, example files",
}


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect the handler to Sphinx's event."""
    app.connect("doctree-read", add_words)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def add_words(app: Sphinx, tree: nodes.document) -> None:
    """Add the words of a page as entries of the index."""
    for place, words in SYNONYMS.items():
        page, _, heading = place.partition("#")
        if page != app.env.docname:
            continue
        ids = {one: section["ids"][0] for section in tree.findall(nodes.section)
               for one in (*section["ids"], section.get("slug", ""))}
        if heading and heading not in ids:
            LOGGER.warning("site_search.py names the heading %s, which is not there; choose one "
                           "of %s", place, ", ".join(sorted(filter(None, ids))), location=page)
            continue
        entries = [("single", word.strip(), ids[heading] if heading else "", "main", None)
                   for word in words.split(",")]
        tree.insert(0, addnodes.index(entries=entries))
