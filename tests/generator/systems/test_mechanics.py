"""Systems of sympy.physics.mechanics, against the equations of motion that it derives itself.

M q̈ = L_q + F − (L_v)_q q̇ − (L_v)_t: both sides at random states, without a step taken.
"""

import numpy as np
import pytest
import sympy as sp
import sympy.physics.mechanics as me

import gyrospark as gs
from calls import refused
from gyrospark.generator.symbolic.finite_fields import vanish
from gyrospark.generator.symbolic.numeric_evaluation import evaluate
from gyrospark.generator.symbolic.shared_subexpressions import parts_of
from gyrospark.generator.systems.sympy_motion import FrameMotion
from mechanics_systems import T, joints, sides
from strategies import EPS


def numbers(matrix, q, u, values, t=0.0):
    """Return a matrix of SymPy's in numbers, at coordinates and speeds that are functions of t."""
    rates = [x.diff(T) for x in q[0]]
    coordinates = dict(zip(q[0], q[1], strict=True))
    names = {**coordinates, **dict(zip(u[0], u[1], strict=True))}
    matrix = me.msubs(matrix, dict(zip(rates, u[1], strict=True)), names)
    return np.array(matrix.subs({**{s: values[str(s)] for s in matrix.free_symbols - {T}}, T: t})
                    ).astype(float)


def state(n, seed=1):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((2, n))


def particles(lift=sp.S.Zero):
    """Return two particles on massless rods in a plane, on a pivot that a law may lift.

    The four items are frame, coordinates, points with velocities, and bodies.
    """
    q = me.dynamicsymbols("q1 q2")
    m, length = sp.symbols("m l", positive=True)
    N, O = me.ReferenceFrame("N"), me.Point("O")  # noqa: E741
    O.set_vel(N, 0)
    pivot = O.locatenew("pivot", lift * N.y)
    pivot.set_vel(N, lift.diff(T) * N.y)
    points = [pivot]
    for i, x in enumerate(q):
        arm = N.orientnew(f"A{i}", "Axis", [x, N.z])
        points.append(points[-1].locatenew(f"P{i}", length * arm.x))
        points[-1].v2pt_theory(points[-2], N, arm)
    bodies = [me.Particle(f"b{i}", P, m) for i, P in enumerate(points[1:])]
    return N, q, points[1:], bodies


VALUES = {"m": 1.3, "l": 0.7, "g": 9.81, "k": 0.4, "I1": 0.3, "I2": 0.2, "c": 0.6, "a": 0.2,
          "w": 3.0}
A, W = sp.symbols("a w", positive=True)
#: The height of a base that goes up and down.
LIFT = A * sp.cos(W * T)


def check_forcing(method, system, values, v, t, speeds):
    """Compare M and the right side with the method's matrices at a time."""
    M, right = sides(system, VALUES, values, v, t)
    arguments = (list(method.q), values), (speeds, v)
    np.testing.assert_allclose(M, numbers(method.mass_matrix, *arguments, VALUES, t),
                               rtol=1e3 * EPS, atol=64 * EPS)
    np.testing.assert_allclose(right, numbers(method.forcing, *arguments, VALUES, t).ravel(),
                               rtol=1e4 * EPS, atol=64 * EPS)


def test_lagranges_method():
    """Equations agree on a driven base, with drag, weights and a force that depends on the time."""
    N, q, points, bodies = particles(LIFT)
    g, k, m, c = sp.symbols("g k m c", positive=True)
    loads = [(points[1], -k * points[1].vel(N)), *((P, -m * g * N.y) for P in points),
             (points[0], c * sp.cos(3 * T) * N.x)]
    method = me.LagrangesMethod(me.Lagrangian(N, *bodies), q, loads, bodies, N)
    method.form_lagranges_equations()
    system = gs.from_mechanics(method, name="double")
    assert [str(x) for x in (*system.q, *system.p, *system.velocities)] == [
        "q1", "q2", "p_q1", "p_q2", "q1_t", "q2_t"]
    assert [str(x) for x in system.parameters] == ["a", "c", "g", "k", "l", "m", "w"]
    assert system.clock == T
    assert system.potential.has(g)  # weights have a potential, from a point at rest
    assert not any(force.has(g) for force in system.forces)
    check_forcing(method, system, *state(2), 0.3, [x.diff(T) for x in q])


def test_holonomic_constraints_of_both_methods():
    N, q, points, bodies = particles()
    offset = points[1].pos_from(points[0]).dot(N.x)
    method = me.LagrangesMethod(me.Lagrangian(N, *bodies), q, None, bodies, N, [offset])
    system = gs.from_mechanics(method)
    assert system.m == 1
    assert not system.forces
    assert sp.simplify(system.constraints[0] - sp.Symbol("l", positive=True)
                       * sp.cos(system.q[1])) == 0
    method = particle(lambda q, u: 2 * q[0] * u[0] + 2 * q[1] * u[1],
                      places=lambda q: q[0] ** 2 + q[1] ** 2 - 1)
    system = gs.from_mechanics(method)
    x, y = system.q
    assert system.constraints == (x**2 + y**2 - 1,)
    assert [str(v) for v in system.velocities] == ["vx", "vy"]


def test_a_driven_base_of_kanes_method():
    N, q, points, bodies = particles(LIFT)
    u = me.dynamicsymbols("u1 u2")
    method = me.KanesMethod(N, q, u, [a.diff(T) - b for a, b in zip(q, u, strict=True)],
                            bodies=bodies, forcelist=[(points[1], -VALUES["g"] * N.y)])
    method.kanes_equations()
    system = gs.from_mechanics(method, name="driven")
    assert [str(v) for v in system.velocities] == ["u1", "u2"]
    values, v = state(2)
    M, right = sides(system, VALUES, values, v, 0.7)
    rates = (q, values), ([x.diff(T) for x in q], v)
    kane = [numbers(me.msubs(e, dict(zip(u, rates[1][0], strict=True))), *rates, VALUES, 0.7)
            for e in (method.mass_matrix, method.forcing)]
    np.testing.assert_allclose(np.linalg.solve(M, right),
                               np.linalg.solve(kane[0], kane[1]).ravel(), rtol=1e3 * EPS)


def test_a_chain_on_a_driven_base_is_long_and_has_its_time():
    """A long Lagrangian of joints and actuators shares its recurring parts, with equal values."""
    method = joints(3, LIFT)
    system = gs.from_mechanics(method, name="arm")
    assert [str(x) for x in system.velocities] == ["u0", "u1", "u2"]
    assert system.potential.has(sp.Symbol("g", positive=True))
    assert system.is_long
    assert "M(q" in system.texts()[0]
    assert system.clock == T
    method.form_eoms()
    check_forcing(method, system, *state(3, 3), 0.7, list(method.u))
    angle, rate = state(3, 4)
    values = dict(zip((*system.q, *system.velocities), (*angle, *rate), strict=True)) | {
        s: VALUES[str(s)] for s in system.parameters}
    (power,) = evaluate([system.H_t], values | {T: 0.7})
    (slope,) = evaluate([system.L], values | {T: 0.7 + 1e-100j}).imag / 1e-100
    assert abs(power + slope) <= 256 * EPS * abs(slope)


def test_constraints_that_move():
    """x = a cos wt along an axis may stand beside its rate; another rate is refused."""
    def bound_particle(speed):
        return particle(lambda q, u: u[1] - speed, places=lambda q: q[1] - LIFT)

    system = gs.from_mechanics(bound_particle(LIFT.diff(T)))
    assert system.clock == T
    assert system.g_t == [(-LIFT).diff(T)]
    with refused("contradicts"):
        gs.from_mechanics(bound_particle(sp.Integer(0)))
    with refused("contradicts"):
        gs.from_mechanics(bound_particle(LIFT.diff(T) + 1))


def length_of_energy(count):
    """Return the number of different parts of T of a chain."""
    method = joints(count)
    return len(list(parts_of([FrameMotion(method.frame).energy(method.bodies)])))


@pytest.mark.slow  # six links
def test_kinetic_energy_grows_with_the_links():
    """The number of parts grows linearly with the links; it once grew with their square."""
    two, four, six = map(length_of_energy, (2, 4, 6))
    assert six - four <= 1.1 * (four - two)
    assert six < 60 * 6


def test_velocities_that_were_given_are_the_rates_of_places():
    """The rate of a point's position has the values of v2pt_theory and is shorter."""
    N, P = me.ReferenceFrame("N"), me.Point("O")
    P.set_vel(N, 0)
    before = N
    for i, x in enumerate(me.dynamicsymbols("q1:8")):
        arm = before.orientnew(f"A{i}", "Axis", [x, (before.x, before.z)[i % 2]])
        P, fixed = P.locatenew(f"P{i}", arm.y), P
        P.v2pt_theory(fixed, N, arm)
        before = arm
    motion = FrameMotion(N)
    short, axes = motion.velocity(P)
    declared = motion.components(P.vel(N), axes)
    assert vanish([a - b for a, b in zip(short, declared, strict=True)])
    assert len(list(parts_of(short))) < len(list(parts_of(declared)))


def test_velocities_that_are_no_rates_are_taken_as_given_and_unknown_ones_refused():
    """A velocity set by the user holds, as of a point on a belt; an unknown one is refused."""
    N, _, points, _ = particles()
    u = me.dynamicsymbols("u")
    points[1].set_vel(N, u * N.x)
    motion = FrameMotion(N)
    velocity, axes = motion.velocity(points[1])
    assert velocity == motion.components(u * N.x, axes)
    with refused("P in N"):
        FrameMotion(me.ReferenceFrame("N")).velocity(me.Point("P"))


def particle(constraint=None, **options):
    """Return KanesMethod of a particle on a plane, with a bound rate or position if given."""
    q, u = me.dynamicsymbols("x y"), me.dynamicsymbols("vx vy")
    N, P = me.ReferenceFrame("N"), me.Point("P")
    P.set_vel(N, u[0] * N.x + u[1] * N.y)
    body = me.Particle("b", P, sp.Symbol("m"))
    bound = {"velocity_constraints": [constraint(q, u)], "u_dependent": u[1:]} if constraint else {}
    places = options.pop("places", None)
    if places:
        bound |= {"configuration_constraints": [places(q)], "q_dependent": q[1:]}
    ends = 1 if places else 2
    return me.KanesMethod(N, q[:ends], u[: 1 if constraint else 2],
                          [a.diff(T) - b for a, b in zip(q, u, strict=True)],
                          bodies=[body], **bound, **options)


def with_function():
    N, q, points, bodies = particles()
    f = me.dynamicsymbols("f")
    return me.LagrangesMethod(me.Lagrangian(N, *bodies), q, [(points[0], f * N.x)], bodies, N)


def without_bodies():
    q, u = me.dynamicsymbols("q u")
    return me.KanesMethod(me.ReferenceFrame("N"), [q], [u], [q.diff(T) - u])


def with_load(where, load, **options):
    N, q, points, bodies = particles()
    L = me.Lagrangian(N, *bodies)
    return me.LagrangesMethod(L, q, [(where or points[0], load or N.x)], bodies,
                              **{"frame": N} | options)


def with_kinematics(*equations):
    """Return a System of a particle in a plane with two speeds."""
    (x, y), (u, w) = q, speeds = me.dynamicsymbols("x y"), me.dynamicsymbols("u w")
    system = me.System()
    system.fixed_point.set_vel(system.frame, 0)
    P = system.fixed_point.locatenew("P", x * system.frame.x + y * system.frame.y)
    P.set_vel(system.frame, u * system.frame.x + w * system.frame.y)
    system.add_bodies(me.Particle("b", P, sp.Symbol("m")))
    system.add_coordinates(*q)
    system.add_speeds(*speeds)
    system.add_kdes(*equations)
    return system


def on_velocities(*rows):
    """Return a particle in a plane with constraints on its velocities."""
    x, y = q = me.dynamicsymbols("x y")
    rates = {"a": x.diff(T), "b": y.diff(T), "f": me.dynamicsymbols("f")}
    return me.LagrangesMethod((x.diff(T)**2 + y.diff(T)**2) / 2, q,
                              nonhol_coneqs=[sp.sympify(row).subs(rates) for row in rows])


@pytest.mark.parametrize(("make", "message"), [
    (lambda: with_load(me.Particle("b7"), None), "b7.*masscenter"),
    (lambda: with_load(None, 3), r"3\).*force"),
    (lambda: with_load(None, me.ReferenceFrame("Z").x), "frame Z.*orient"),
    (lambda: with_load(me.ReferenceFrame("Z"), None), "frame Z.*orient"),
    (lambda: with_load(None, None, frame=None), "frame="),
    (lambda: with_kinematics(), "0 kinematic.*2"),
    (lambda: on_velocities("a*f - b"), r"f\(t\)"),
    # the slope at rest of a product of velocities is 0, as in a row that says nothing
    (lambda: on_velocities("a*b"), "A0.*linear"),
    (lambda: on_velocities("a - b", "(a - b)**2"), "A1.*linear"),
    (with_function, r"f\(t\)"),
    (without_bodies, "KanesMethod.*bodies"),
    (me.System, "System.*bodies"),
    (lambda: 3, "method = 3.*LagrangesMethod, KanesMethod or System"),
])
def test_what_is_no_system_is_refused(make, message):
    with refused(message):
        gs.from_mechanics(make())


def test_kinematic_equations_are_linear_in_the_speeds():
    x, y, u, w = me.dynamicsymbols("x y u w")
    with refused(r"u\(t\)\*\*2.*linear"):
        gs.from_mechanics(with_kinematics(x.diff(T) - u**2, y.diff(T) - w))


def test_a_row_of_zeros_restricts_nothing():
    assert gs.from_mechanics(on_velocities("0", "a - b")).velocity_count == 1


def test_bodies_of_one_name_are_refused_where_names_count():
    N, q, points, _ = particles()
    twins = [me.Particle("twin", P, sp.Symbol("m")) for P in points]
    method = me.LagrangesMethod(me.Lagrangian(N, *twins), q, None, twins, N)
    assert gs.from_mechanics(method).n == 2
    with refused("'twin'"):
        gs.from_mechanics(method, bodies=True)


def test_an_input_is_a_function_of_time():
    N, q, points, bodies = particles()
    f = sp.Function("f")(q[0])
    method = me.LagrangesMethod(me.Lagrangian(N, *bodies), q, [(points[0], f * N.x)], bodies, N)
    with refused(r"f\(q1\(t\)\).*dynamicsymbols"):
        gs.from_mechanics(method, inputs=[f])
