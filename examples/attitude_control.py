"""Attitude control of a satellite by reaction wheels: a PD controller, sampled at 10 Hz, 600 s.

The folder control_c has the same loop in C, in single precision.
"""

import numpy as np

import gyrospark as gs

model = gs.load_model("examples/control_c/satellite.toml")
step = gs.stepper("G-L", 2, system=model)
sim = step.start(model, dt=0.02)
seen = []  # attitude error in degrees, at each sample

for _ in range(6000):
    e = sim.q
    omega = sim.body().angular_velocity()  # gyroscope output
    turn = np.copysign(e[1:], e[0] * e[1:])  # the smaller rotation
    torque = np.clip(-0.5 * turn - 4.0 * omega, -0.2, 0.2)  # N m
    sim.advance(5, **dict(zip(("u1", "u2", "u3"), torque, strict=True)))  # held for 0.1 s
    seen.append(np.degrees(2 * np.arctan2(np.linalg.norm(e[1:]), abs(e[0]))))

if __name__ == "__main__":
    for k in range(0, 6000, 1000):
        print(f"{k // 10:4} s: {seen[k]:.1e} degrees off")
    print(sim.report)
