"""The stiff flyball governor, problem A05 of IFToMM's library: python examples/flyball_governor.py

A shaft rotates about z; two rods with 5 kg at their ends are hinged to it near its top; a slider
moves along the shaft, connected to the middle of each rod by a spring and a stiff damper. Its
motion relative to the rods decays at 8100 1/s = 2C (L_s²/M + L_β²/I), L being the springs' length.
Steps that are longer than the decay time do not damp this motion with G-L, |R(∞)| = 1, but do with
Radau-L, R(∞) = 0.
"""

from __future__ import annotations

import math

import numpy as np

import gyrospark as gs

GRAVITY, DENSITY, RATE = 9.81, 3000, 2 * math.pi
STIFFNESS, DAMPING, LENGTH = 8e5, 4e4, 0.5  # N/m, N s/m, m
BELOW = math.radians(30)  # the rods, from the horizontal
WIDTH, SIDE, BALL = 0.01, 0.1, 5.0  # m, m, kg
ROD = DENSITY * WIDTH**2  # kg, of 1 m
ALONG, ACROSS = ROD * WIDTH**2 / 6, ROD * (1 + WIDTH**2) / 12


def governor(damping: float = DAMPING, slider_speed: float = 0.0) -> gs.Model:
    """Return the governor with its initial values; ``slider_speed`` in m/s excites the dampers."""
    build = gs.Multibody("flyball_governor", gravity=(0, 0, -GRAVITY), dt=0.01, steps=100)
    spin = np.array([0, 0, RATE])
    shaft = build.body("shaft", mass=ROD, inertia=(ACROSS, ACROSS, ALONG), position=(0, 0, 0.5))
    block = DENSITY * SIDE**3
    slider = build.body("slider", mass=block, inertia=(block * SIDE**2 / 6,) * 3,
                        position=(0, 0, 0.5))
    build.revolute("pivot", "ground", shaft, axis=(0, 0, 1), at=(0, 0, 0), rate=RATE)
    build.prismatic("slide", shaft, slider, axis=(0, 0, 1), at=(0, 0, 0.5), speed=slider_speed)
    mass, centre = ROD + BALL, (ROD / 2 + BALL) / (ROD + BALL)  # of a rod with its ball
    swing = ACROSS + ROD * (centre - 0.5) ** 2 + BALL * (1 - centre) ** 2
    for name, side in (("right", 1), ("left", -1)):
        along = np.array([side * math.cos(BELOW), 0, -math.sin(BELOW)])
        turn = np.column_stack([along, (0, 1, 0), np.cross(along, (0, 1, 0))])
        hinge = np.array([side * SIDE / 2, 0, 1])
        rod = build.body(name, mass=mass, inertia=(ALONG, swing, swing), rotation=turn,
                         position=hinge + centre * along, angular_velocity=turn.T @ spin,
                         velocity=np.cross(spin, hinge + centre * along))
        build.revolute(f"{name}_hinge", shaft, rod, axis=(0, 1, 0), at=hinge)
        build.spring(f"{name}_damper", rod, slider, stiffness=STIFFNESS, length=LENGTH,
                     damping=damping, on_a=(0.5 - centre, 0, 0), on_b=(side * SIDE / 2, 0, 0))
    return build.model()


if __name__ == "__main__":
    for scheme in ("Radau-L", "G-L"):
        model = governor(slider_speed=0.05)
        run = gs.stepper(scheme, 2, system=model).integrate(
            model, dt=2.5e-3, steps=8)
        speeds = run.body("slider").velocity()[:, 2]
        print(f"{scheme:8} slider's speed:", *(f"{v:9.5f}" for v in speeds))
