"""Drag, dry friction, a rope, a rocket and a servo: a model file against closed forms.

One file has them all, a coordinate each; the same in SymPy's words is the same system.
"""

import re

import numpy as np
import pytest
import sympy as sp

import budget
import gyrospark as gs
from gyrospark.generator.normal_forms.canonical_system import canonical
from strategies import EPS

TEXT = """
name = "fairground"
[system]
coordinates = ["car", "block", "jumper", "rocket", "servo"]
momenta = ["pcar", "pblock", "pjumper", "procket", "pservo"]
hamiltonian = \"\"\"(pcar**2 + pblock**2 + pjumper**2 + procket**2 + pservo**2)/2
    - g*jumper + k/2*max(0, jumper - l)**2\"\"\"
forces = [
    "-c*abs(pcar)*pcar",
    "g/2 - mu*g*sign(pblock)",
    "0",
    "if(t < burn, thrust, 0) - g",
    "min(max(-16*servo - 8*pservo, -1), 1)",
]
[parameters]
g = 9.81
c = 0.3
mu = 0.4
l = 2
k = 40
burn = 0.5
thrust = "3*g"
[start]
q = [0, 0, 0, 0, 1]
p = [2, 0.5, 0, 0, 0]
[run]
dt = 2e-3
steps = 1000
[quantities]
flying = "heaviside(rocket)"
turn = "mod(servo, 0.25)"
phase = "if(jumper < l and pjumper > 0, 1, if(jumper >= l, 2, 3))"
"""
G, RATE, MU, L, K, BURN = 9.81, 0.3, 0.4, 2.0, 40.0, 0.5


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return a run of the file."""
    path = tmp_path_factory.mktemp("fairground") / "fairground.toml"
    path.write_text(TEXT, encoding="utf-8")
    model = gs.load_model(path)
    with budget.shared():
        step = gs.stepper("G-L", 2, system=model)
    return step.integrate(model, dt=model.dt, steps=model.steps)


def coordinate(run, name):
    index = ["car", "block", "jumper", "rocket", "servo"].index(name)
    return run.q[:, index], run.p[:, index]


def test_drag_sliding_friction_and_thrust_that_ends(run):
    # v̇ = −c|v|v: v = v₀/(1 + c v₀ t), to round-off of an order 4 of such short steps.
    q, p = coordinate(run, "car")
    assert np.abs(p - 2 / (1 + RATE * 2 * run.t)).max() <= 1e-12
    assert np.abs(q - np.log(1 + RATE * 2 * run.t) / RATE).max() <= 1e-12
    q, p = coordinate(run, "block")
    pull = G / 2 - MU * G
    assert np.abs(p - 0.5 - pull * run.t).max() <= 64 * EPS
    assert np.abs(q - run.t / 2 - pull * run.t**2 / 2).max() <= 64 * EPS
    # Ends at a step's end: every step has a constant force, and is exact.
    q, p = coordinate(run, "rocket")
    burning = run.t <= BURN * (1 + 4 * EPS)
    at_end = np.array([2 * G * BURN**2 / 2, 2 * G * BURN])
    coasting = run.t - BURN
    exact = np.where(burning, 2 * G * run.t**2 / 2,
                     at_end[0] + at_end[1] * coasting - G * coasting**2 / 2)
    assert np.abs(q - exact).max() <= 1024 * EPS * np.abs(q).max()
    rate = np.where(burning, 2 * G * run.t, at_end[1] - G * coasting)
    assert np.abs(p - rate).max() <= 1024 * EPS * np.abs(rate).max()


def test_rope_that_pulls_only(run):
    """The jumper falls freely to the rope's length, swings harmonically and falls freely again."""
    q, _ = coordinate(run, "jumper")
    fall, frequency = np.sqrt(2 * L / G), np.sqrt(K)
    middle, swing = L + G / K, np.hypot(G / K, np.sqrt(2 * G * L) / frequency)
    phase = np.arcsin(G / K / swing)
    turn = (np.pi + 2 * phase) / frequency
    on_rope = (run.t >= fall) & (run.t <= fall + turn)
    after = run.t - fall - turn - fall  # from the upper turning point
    exact = np.where(run.t < fall, G * run.t**2 / 2,
                     np.where(on_rope, middle + swing * np.sin(frequency * (run.t - fall) - phase),
                              G * after**2 / 2))
    assert on_rope.any()
    assert run.t[-1] > fall + turn
    assert np.abs(q - exact).max() <= 1e-5  # one step over each end of the swing
    phases = run.quantity("phase")
    inside = np.abs(run.t - fall) > 2e-3
    assert np.array_equal(phases[inside] == 2, (q >= L)[inside])


def test_quantities_and_warnings(run):
    servo = run.q[:, 4]
    assert run.quantity("turn") == pytest.approx(np.mod(servo, 0.25), abs=4 * EPS)
    assert run.quantity("flying")[0] == 0.5  # at 0: half
    assert (run.quantity("flying")[1:] == 1).all()
    order, jumps = run.manifest.system.remarks
    assert re.search(r"order 4 .*burn - t = 0, jumper - l =", order)
    assert "forces jump at pblock = 0" in jumps


def test_the_same_in_the_words_of_sympy(tmp_path):
    """Piecewise, Max, Min, Abs, sign and Heaviside make the system that the file makes."""
    path = tmp_path / "fairground.toml"
    path.write_text(TEXT, encoding="utf-8")
    read = gs.load_model(path).system
    q, p, t = read.q, read.p, read.time
    g, c, mu, length, k, burn, thrust = (
        next(s for s in read.parameters if str(s) == name)
        for name in ("g", "c", "mu", "l", "k", "burn", "thrust"))
    H = sum(y**2 for y in p) / 2 - g * q[2] + k * sp.Max(0, q[2] - length) ** 2 / 2
    forces = (-c * sp.Abs(p[0]) * p[0], g / 2 - mu * g * sp.sign(p[1]), 0,
              sp.Piecewise((thrust, t < burn), (0, True)) - g,
              sp.Min(sp.Max(-16 * q[4] - 8 * p[4], -1), 1))
    quantities = {
        "flying": sp.Heaviside(q[3]), "turn": sp.Mod(q[4], sp.Rational(1, 4)),
        "phase": sp.Piecewise((1, (q[2] < length) & (p[2] > 0)), (2, q[2] >= length), (3, True))}
    system = gs.System(q, p, read.parameters, H, name="fairground", forces=forces, time=t,
                       quantities=quantities)
    assert canonical(system) == canonical(read)
