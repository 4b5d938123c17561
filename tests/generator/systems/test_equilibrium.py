"""Static equilibria against closed forms, and their refusals."""

from __future__ import annotations

import itertools
import warnings
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from scipy.spatial.transform import Rotation

import gyrospark as gs
import lagrangians
from gyrospark.generator.systems.equilibrium import equilibrium

EPS = np.finfo(float).eps
EXAMPLES = Path(__file__).parents[3] / "examples"
q = sp.symbols("x y", real=True)
p = sp.symbols("u v", real=True)
g, k = sp.symbols("g k", positive=True)


def hanging_points(count: int, side: float = 1.0) -> gs.Model:
    """Return points joined by rods of length 1 and pulled aside at the end by ``side`` N."""
    build = gs.Multibody("points")
    points = [build.point_mass(f"p{i}", mass=1.0, position=(i + 1.0, 0, 0)) for i in range(count)]
    for i, point in enumerate(points):
        build.rod(f"rod{i}", points[i - 1] if i else build.ground, point)
    build.force(points[-1], (side, 0, 0))
    return build.model()


def test_a_hanging_chain_of_rods_and_a_rope_that_is_slack_at_the_start():
    # The force (side, Σ weights below) in rod i points along the rod.
    x = hanging_points(5).equilibrium().q0.reshape(-1, 3)
    rods = np.diff(x, axis=0, prepend=np.zeros((1, 3)))
    forces = np.stack([np.ones(5), np.zeros(5), -9.81 * np.arange(5, 0, -1)], axis=1)
    assert np.abs(rods - forces / np.linalg.norm(forces, axis=1)[:, None]).max() <= 64 * EPS
    # The jumper hangs where the rope is longer than l by m g/k; at the start nothing is stiff.
    jump = gs.load_model(EXAMPLES / "bungee.toml")
    mass, gravity, slack, stiffness = (float(jump.parameters[name]) for name in "mglk")
    length = slack + mass * gravity / stiffness
    assert np.abs(jump.equilibrium().q0 - [0, -length]).max() <= 8 * EPS * length


def test_the_stable_one_of_two_is_found():
    """A pendulum hangs from any start: off its upper equilibrium, close to it, off its circle."""
    system = gs.System(q, p, (g,), (p[0]**2 + p[1]**2) / 2 + g * q[1],
                       [q[0]**2 + q[1]**2 - 1], name="pendulum")
    for start in ([0.1, np.sqrt(0.99)], [1.2, -1.6], [-5.0, 3.0], [0.01, 0.2],
                  *([beside, 1.0] for beside in (1e-3, 1e-6, 1e-9, 1e-12))):
        position, force = equilibrium(system, {"g": 2.0}, np.array(start))
        assert np.abs(position - [0, -1]).max() <= 8 * EPS
        assert force == pytest.approx([1.0], abs=8 * EPS)  # g + 2 λ y = 0


@pytest.mark.parametrize("soft", [1e-4, 1e-8])
def test_an_equilibrium_far_from_the_start(soft):
    """A force of 1 N on a soft spring moves it to x = 1/k."""
    system = gs.System(q, p, (k,), (p[0]**2 + p[1]**2) / 2 + k * q[0]**2 / 2 - q[0]
                       + q[1]**2 / 2, name="soft_spring")
    position, _ = equilibrium(system, {"k": soft}, np.zeros(2))
    assert np.abs(position - [1 / soft, 0]).max() <= 8 * EPS / soft


@pytest.mark.parametrize(("M", "L", "T"), [
    (2.0**-86, 2.0**-33, 2.0**-40), (1.0, 2.0**20, 1.0), (2.0**80, 2.0**-20, 2.0**40)])
def test_an_equilibrium_does_not_depend_on_units(M, L, T):
    """Molecules or planets, powers of 2: a spring pulls a body, whose quaternion has no unit."""
    def equilibrium_of(M, L, T):
        build = gs.Multibody("leaning", gravity=(0, 0, -9.75 * L / T**2))
        rod = build.body("rod", mass=M, inertia=np.array([0.1, 0.11, 0.02]) * M * L**2,
                         position=(0, 0, -0.5 * L))
        build.ball("pin", build.ground, rod, at=(0, 0, 0))
        build.spring("spring", rod, build.ground, stiffness=3 * M / T**2, length=0.2 * L,
                     on_a=np.array([1, 0.5, 0]) * L, on_b=(2 * L, 0, 0))
        return build.model().equilibrium()
    one, other = equilibrium_of(1.0, 1.0, 1.0), equilibrium_of(M, L, T)
    units = np.array([1 if "_q" in str(x) else L for x in one.system.q])
    assert np.array_equal(other.q0 / units, one.q0)
    # no torque about the pin
    centre, attitude = one.q0[4:], Rotation.from_quat(one.q0[:4], scalar_first=True)
    end = centre + attitude.apply([1, 0.5, 0])
    pull = np.array([2, 0, 0]) - end
    pull *= 3 * (1 - 0.2 / np.linalg.norm(pull))
    assert np.abs(np.cross(centre, [0, 0, -9.75]) + np.cross(end, pull)).max() < 64 * EPS


def test_a_net_force_on_bodies_that_nothing_holds_is_refused():
    """30 N up, 10 N down and two weights of 9.81 N leave 0.38 N on two points."""
    build = gs.Multibody("pair")
    points = [build.point_mass(name, mass=1.0, position=(0, y, 1.0))
              for name, y in (("a", 0.0), ("b", 1.0))]
    build.rod("rod", *points)
    for point, force in zip(points, (30.0, -10.0), strict=True):
        build.force(point, (0, 0, force))
    with pytest.raises(gs.InputError, match=r"'pair'.*moves freely"):
        build.model().equilibrium()


def test_forces_without_a_potential_and_the_time():
    """The position solves k x = f(q, t) at t = 3, where drag is 0 at rest."""
    t = sp.Symbol("t", real=True)
    system = gs.System(q, p, (k,), (p[0]**2 + p[1]**2) / 2 + k * (q[0]**2 + q[1]**2) / 2,
                       forces=(t - q[1] - p[0], q[0]), time=t, name="pushed")
    position, _ = equilibrium(system, {"k": 2.0}, np.array([1.0, 0.0]), t=3.0)
    assert position == pytest.approx(np.linalg.solve([[2, 1], [-1, 2]], [3, 0]), abs=8 * EPS)


@pytest.mark.parametrize(("start", "rest"), [(0.0, 1.0), (0.0, 0.0), (1.0, 0.0), (1e-16, 1.0)])
def test_coordinates_of_zero(start, rest):
    """Coordinates may be 0 at the start and at rest in V = k (x − rest)²/2 + y²/2."""
    system = gs.System(q, p, (k,), (p[0]**2 + p[1]**2) / 2
                       + k * (q[0] - rest)**2 / 2 + q[1]**2 / 2, name="origin")
    position, _ = equilibrium(system, {"k": 2.0}, np.array([start, 0.0]))
    assert np.abs(position - [rest, 0]).max() <= 8 * EPS * max(rest, 1.0)


def test_a_pendulum_in_its_angle():
    """It hangs at angle 0, also from beside its upper equilibrium."""
    system = gs.System(q[:1], p[:1], (g,), p[0]**2 / 2 - g * sp.cos(q[0]), name="pendulum")
    for start in (0.0, 0.5, 1.5, 3.0):
        angle, _ = equilibrium(system, {"g": 2.0}, np.array([start]))
        assert abs(angle[0]) <= 8 * EPS


@pytest.mark.parametrize("stiff", [1e6, 1e14])
@pytest.mark.parametrize("soft", [1.0, 1e-4])
@pytest.mark.parametrize("start", [1.0, 1.3])
def test_what_is_soft_comes_to_rest_beside_what_is_stiff(stiff, soft, start):
    """K (x − 1)²/2 + k ((y − 1)²/2 + (y − 1)⁴/4) settles in y too, slow at the time scale of K."""
    K, x, y = sp.Symbol("K", positive=True), q[0] - 1, q[1] - 1
    system = gs.System(q, p, (K, k), (p[0]**2 + p[1]**2) / 2 + K * x**2 / 2
                       + k * (y**2 / 2 + y**4 / 4), name="two_springs")
    position, _ = equilibrium(system, {"K": stiff, "k": soft}, np.array([start, 0.0]))
    assert np.abs(position - 1).max() <= 8 * EPS


@pytest.mark.slow  # 131 unknowns
def test_rods_that_turn_freely_about_themselves():
    """The platform of a delta robot comes to rest on its axis of symmetry."""
    robot = gs.models.delta_robot().equilibrium()
    coordinates = dict(zip(map(str, robot.system.q), robot.q0, strict=True))
    assert np.abs([coordinates["platform_x"], coordinates["platform_y"]]).max() <= 64 * EPS


def test_refusals():
    falling = gs.System(q, p, (g,), (p[0]**2 + p[1]**2) / 2 + g * q[1], name="falling")
    turning = gs.System(q, p, (g,), (p[0]**2 + p[1]**2) / 2 - g * (q[0] * p[1] - q[1] * p[0]),
                        name="turning")
    t = sp.Symbol("t", real=True)
    moved = gs.System(q, p, (g,), (p[0]**2 + p[1]**2) / 2, [q[0] - g * t], time=t, name="moved")
    for system, words in ((falling, "reached"), (turning, "momenta are 0"), (moved, "time"),
                          (lagrangians.bead(), "Lagrangian")):
        values = dict.fromkeys(map(str, system.parameters), 1.0)
        with pytest.raises(gs.InputError, match=words):
            equilibrium(system, values, np.ones(system.n))


def test_a_stop_that_would_hold_a_rod_is_refused():
    """A rod with a stop on one side hangs straight down where the stop leaves room for it.

    It may touch the stop there, within rounding.
    """
    for lower, refused in ((-0.2, False), (0.0, False), (0.2, True)):
        build = gs.Multibody("stopped")
        rod = build.body("rod", mass=2.0, inertia=(0.2, 0.2, 0.01), position=(0, 0, -0.5))
        pin = build.revolute("pin", build.ground, rod, at=(0, 0, 0), axis=(0, 1, 0), angle=0.3)
        build.stop("end", pin, lower=lower)
        if refused:
            with pytest.raises(gs.InputError, match="gap 'end'"):
                build.model().equilibrium()
        else:
            hanging = build.model().equilibrium()
            assert np.abs(hanging.q0 - [1, 0, 0, 0, 0, 0, -0.5]).max() <= 8 * EPS


@pytest.mark.parametrize("angles", [*itertools.product((0.0, np.pi), repeat=2)])
def test_an_unstable_equilibrium_is_warned_of(angles):
    """V = −a cos θ₁ − b cos θ₂ has its one minimum where both rods hang, and rests at all four."""
    model = gs.models.double_pendulum(angles=angles)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        rest = model.equilibrium()
    assert ["unstable" in str(warning.message) for warning in caught] == [True] * any(angles)
    assert np.abs(rest.q0 - model.q0).max() <= 8 * EPS
