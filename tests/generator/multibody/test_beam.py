"""Beams: shapes and loads against closed forms, motions against digits of finer integrations."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import budget
import gyrospark as gs
import systems
from gyrospark.generator.models.model_file import parse_model
from gyrospark.generator.multibody.initial_poses import rotation
from gyrospark.generator.symbolic.numeric_evaluation import evaluate
from robots import Motion

EPS = np.finfo(float).eps
STRAIGHT = {"start": (0, 0, 0), "end": (1, 0, 0), "mass": 1.0, "bending": 1.0, "twisting": 1.0}


def builder(name: str = "beams") -> gs.Multibody:
    return gs.Multibody(name, gravity=(0, 0, 0))


def tip(model: gs.Model, h: float) -> np.ndarray:
    """Return the position of the end of the last segment."""
    return model.q0[-3:] + rotation(model.q0[-7:-3]) @ [0, 0, h / 2]


def cantilever(count: int, force: tuple[float, float, float], **options) -> gs.Model:
    """Return a beam of length 1, clamped at its start, with a dead load at its end."""
    build = builder()
    beam = build.beam("rod", count=count, **STRAIGHT | options)
    build.fixed("clamp", build.ground, beam.first)
    build.force(beam.last, force)
    return build.model()


# ---------------------------------------------------------------- statics against closed forms


def elastica(load: float) -> tuple[float, float]:
    """Return (x, deflection) of the tip of a cantilever, F L²/EI = load (elliptic integrals)."""
    with mp.workdps(25):
        def modulus(angle):
            return (1 + mp.sin(angle)) / 2

        def amplitude(m):
            return mp.asin(1 / mp.sqrt(2 * m))

        angle = mp.findroot(lambda angle: mp.ellipk(modulus(angle)) - mp.ellipf(
            amplitude(modulus(angle)), modulus(angle)) - mp.sqrt(load),
            (0.4, 0.5) if load < 2 else (1.2, 1.3), solver="secant")
        m = modulus(angle)
        bent = mp.ellipe(m) - mp.ellipe(amplitude(m), m)
        return (float(mp.sqrt(2 * mp.sin(angle) / load)), float(1 - 2 * bent / mp.sqrt(load)))


@pytest.mark.parametrize("load", [pytest.param(1.0, marks=pytest.mark.slow), 10.0])
def test_a_cantilever_is_an_elastica_to_order_two(load):
    exact = elastica(load)
    errors = []
    for count in (4, 8):
        x, _, z = tip(cantilever(count, (0, 0, -load)).equilibrium(), 1 / count)
        errors.append(np.array([x - exact[0], -z - exact[1]]))
    coarse, fine = np.abs(errors)
    assert fine.max() <= {1.0: 3e-3, 10.0: 1e-2}[load]
    assert np.log2(coarse / fine).min() > 1.8


def test_a_torque_about_the_tangent_twists_by_ml_over_gj():
    """Each joint, and the clamp for half a segment, has u₃ = sin(θ/2), θ = 2 asin(M h/(2 GJ))."""
    build, count, GJ, M = builder(), 4, 0.3, 0.2
    beam = build.beam("rod", count=count, **STRAIGHT | {"twisting": GJ})
    build.fixed("clamp", build.ground, beam.first)
    build.torque(beam.last, (0, 0, M))
    model = build.model().equilibrium()
    before, after = build.model().q0[-7:-3], model.q0[-7:-3]
    turned = 2 * np.arccos(before @ after)
    h = 1 / count
    # M is the derivative of (f/h) GJ sin²(θ/2) = (f/2h) GJ (1 − cos θ).
    joint, clamp = np.arcsin(2 * M * h / (2 * GJ)), np.arcsin(2 * M * h / (4 * GJ))
    assert abs(turned - ((count - 1) * joint + clamp)) <= 64 * EPS


def test_stretching_of_a_pulled_beam_is_exact():
    """The elongation is F L/EA: the end joints have the compliance of the ends beside them."""
    EA, force = 40.0, 3.0
    model = cantilever(3, (force, 0, 0), stretching=EA, shearing=15.0).equilibrium()
    assert np.abs(tip(model, 1 / 3) - [1 + force / EA, 0, 0]).max() <= 16 * EPS


def test_a_sheared_cantilever_bends_and_shears():
    """Small loads bend it by F L³/(3 EI₂) + F L/GA about the second axis of the section."""
    EI, GA, force = (5.0, 2.0), 7.0, 1e-6
    errors = []
    for count in (3, 6):
        model = cantilever(count, (0, 0, force), bending=EI, stretching=50.0, shearing=GA,
                           normal=(0, 0, 1)).equilibrium()
        z = tip(model, 1 / count)[2]
        errors.append(z / force - (1 / (3 * EI[1]) + 1 / GA))
    assert abs(errors[1]) <= 0.02 * (1 / 6 + 1 / 7)
    assert np.log2(errors[0] / errors[1]) > 1.8


def test_a_straight_beam_bent_to_a_circle_has_its_energy():
    """The energy tends to ½ EI₁ κ² L; κ = (2/h) sin(h/2) at joints, (4/h) sin(h/4) at clamps.

    The polygon of the circle has 20,000 edges, its end directions an error of half of one.
    """
    angle = np.linspace(0, np.pi, 20_001)
    arc = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    options = STRAIGHT | {"bending": (2.0, 3.0), "points": arc, "start": None, "end": None,
                          "normal": (0, 0, 1)}
    energies = []
    for count, rest in ((4, (0, 0, 0)), (8, (0, 0, 0)), (4, None)):
        build = builder()
        beam = build.beam("arc", count=count, rest=rest, **options)
        for end in ("first", "last"):
            build.fixed(f"clamp_{end}", build.ground, getattr(beam, end))
        energies.append(Motion(build.model()).energy())
    for count, energy in zip((4, 8), energies, strict=False):
        h = np.pi / count
        joints, clamps = 2 * np.sin(h / 2) ** 2, 4 * np.sin(h / 4) ** 2
        assert energy == pytest.approx(2.0 / h * ((count - 1) * joints + 2 * clamps), rel=1e-3)
    assert abs(energies[2]) <= 64 * EPS


@pytest.mark.slow  # a beam of four hundred segments
def test_sections_of_a_helix_are_transported_in_parallel():
    """Sections turn by −∫τ ds against the Frenet frame, whose normals at both ends agree."""
    radius, pitch = 1.0, 0.5
    angle = np.linspace(0, 2 * np.pi, 4001)
    helix = np.stack([radius * np.cos(angle), radius * np.sin(angle), pitch * angle], axis=1)
    build = builder()
    beam = build.beam("helix", points=helix, count=400, mass=1, bending=1, twisting=1,
                      normal=(-1, 0, 0))
    first, last = (rotation(end.q) for end in (beam.first, beam.last))
    torsion = pitch / (radius**2 + pitch**2)
    turn = -torsion * 2 * np.pi * np.hypot(radius, pitch)
    c, s = np.cos(turn), np.sin(turn)
    # The tangents agree after a whole turn, so that the section has turned about the tangent.
    assert np.abs(last - first @ [[c, -s, 0], [s, c, 0], [0, 0, 1]]).max() <= 2e-3


def test_a_twisted_section_turns_and_is_free_of_moments():
    build = builder()
    beam = build.beam("blade", count=3, twist=0.6, **STRAIGHT)
    build.fixed("clamp", beam.last, build.ground)
    first, last = (rotation(end.q) for end in (beam.first, beam.last))
    assert np.arccos(first[:, 0] @ last[:, 0]) == pytest.approx(0.6, abs=1e-12)
    model = build.model()
    assert np.abs(model.equilibrium().q0 - model.q0).max() <= 64 * EPS


@pytest.mark.parametrize("angle", [0.3, -1.9])
@pytest.mark.parametrize("is_held_first", [True, False])
def test_a_clamp_that_is_turned_twists_half_a_segment(angle, is_held_first):
    """The rotation of b in a: V = (4/h) GJ (sin ½(φ − θ) − sin ½φ)² of a clamp turned by θ.

    To the middle of its segment, a quarter of the beam, the section twists by φ at rest.
    """
    build = builder()
    beam = build.beam("rod", count=2, twist=0.4, **STRAIGHT | {"twisting": 3.0})
    turn = np.array([np.cos(angle / 2), np.sin(angle / 2), 0, 0])
    turned = rotation(turn) @ rotation(beam.first.q)
    frames = (build.ground, beam.first) if is_held_first else (beam.first, build.ground)
    build.fixed("clamp", *frames, rotation=turned if is_held_first else turned.T)
    strain = np.sin((0.1 - angle) / 2) - np.sin(0.1 / 2)
    assert Motion(build.model()).energy() == pytest.approx(4 / 0.5 * 3.0 * strain**2, rel=1e-12)


# ---------------------------------------------------------------- dynamics


def damped(extension: dict) -> tuple[gs.Model, object]:
    build = builder()
    beam = build.beam("rod", count=2, damping=0.2, bending=(1.0, 2.0), twisting=3.0, mass=1,
                      start=(0, 0, 0), end=(1, 0, 0), **extension)
    if not extension:
        body = build.body("hub", mass=1, inertia=(1, 1, 1), position=(0, 0, 0),
                          quaternion=(0.8, 0.6, 0, 0))
        build.fixed("clamp", body, beam.first)
    return build.model(), beam


@pytest.mark.parametrize("extension", [{}, {"stretching": 7.0, "shearing": 4.0}],
                         ids=["balls", "springs"])
def test_damping_dissipates_and_conserves_momenta(extension):
    """Damping has no net force or torque and negative power, and resists no rigid motion.

    Two segments of a beam of 1 m that move at v without a rotation lose τ v·C v, with EA along the
    tangents, of which neither is preferred, and GA across.
    """
    model, _ = damped(extension)
    system, rng = model.system, np.random.default_rng(3)
    q = model.q0 + 0.1 * rng.normal(size=system.n)
    for k in range(0, system.n, 7):
        q[k : k + 4] /= np.linalg.norm(q[k : k + 4])
    p = rng.normal(size=system.n)
    for k in range(0, system.n, 7):
        p[k : k + 4] -= q[k : k + 4] * (q[k : k + 4] @ p[k : k + 4])

    def forces(p):
        state = dict(zip((*system.q, *system.p), (*q, *p), strict=True))
        state |= {s: model.parameters[str(s)] for s in system.parameters}
        F, v = (evaluate(e, state) for e in (system.forces, system.H_p))
        total, torque = np.zeros(3), np.zeros(3)
        for k in range(0, system.n, 7):
            (q0, *u), (f0, *f) = q[k : k + 4], F[k : k + 4]
            total += F[k + 4 : k + 7]
            torque += (q0 * np.array(f) - f0 * np.array(u) + np.cross(f, u) * -1) / 2
            torque += np.cross(q[k + 4 : k + 7], F[k + 4 : k + 7])
        return F @ v, total, torque, F

    power, total, torque, F = forces(p)
    size = np.abs(F).max()
    assert power < -1e-3
    assert np.abs(total).max() <= 64 * EPS * size
    assert np.abs(torque).max() <= 256 * EPS * size
    spin, rigid = np.array([0.3, -0.5, 0.7]), np.zeros(system.n)
    values = model.parameters
    for k in range(0, system.n, 7):
        hub = system.bodies[k // 7].name == "hub"
        J, m = (np.eye(3), values["hub_m"]) if hub else (
            np.diag([values[f"rod_I{i}"] for i in (1, 2, 3)]), values["rod_m"])
        R = rotation(q[k : k + 4])
        (q0, q1, q2, q3) = q[k : k + 4]
        L = np.array([[-q1, q0, q3, -q2], [-q2, -q3, q0, q1], [-q3, q2, -q1, q0]])
        rigid[k : k + 4] = 2 * L.T @ J @ R.T @ spin
        rigid[k + 4 : k + 7] = m * np.cross(spin, q[k + 4 : k + 7])
    assert np.abs(forces(rigid)[3]).max() <= 64 * EPS
    if extension:
        v, tangents = np.array([0.3, -0.2, 0.5]), [rotation(q[k : k + 4])[:, 2] for k in (0, 7)]
        p = np.append(np.zeros(11), values["rod_m"] * v)
        along = np.mean([(t @ v) ** 2 for t in tangents])
        assert forces(p)[0] == pytest.approx(
            -0.2 * (7.0 * along + 4.0 * (v @ v - along)), rel=1e-14)


@pytest.mark.parametrize("count", [2, pytest.param(4, marks=pytest.mark.slow)])
def test_a_column_buckles_at_the_load_of_its_segments(count):
    """The load is P = 4 sin²(φ/2) EI/h², φ = π/2N, with θ_i = sin((i − ½) φ); Euler's in the limit.

    At P the least eigenvalue of the stiffness H_qq + λ g_qq on g_q δq = 0 changes its sign.
    """
    critical = 4 * np.sin(np.pi / (4 * count)) ** 2 * count**2
    assert critical == pytest.approx(np.pi**2 / 4, rel=0.06 * (2 / count) ** 2)
    build = builder()
    beam = build.beam("rod", count=count, **STRAIGHT | {"twisting": 9.0})
    build.fixed("clamp", build.ground, beam.first)
    build.potential(build.parameter("load", 1.0) * beam.last.point()[0])
    model = build.model()
    system = model.system

    def least(load):
        def at(q):
            return {**dict(zip(system.q, q, strict=True)), **dict.fromkeys(system.p, 0.0),
                    **{s: {**model.parameters, "load": load}[str(s)] for s in system.parameters}}

        def matrix(rows, q):
            return evaluate([e for row in rows for e in row], at(q)).reshape(len(rows), -1)

        G, q0 = matrix(system.G, model.q0), model.q0
        force, *_ = np.linalg.lstsq(G.T, -evaluate(system.H_q, at(q0)), rcond=None)
        # g is of degree 2, so that differences of g_q are exact.
        bending = np.stack([(matrix(system.G, q0 + e) - G).T @ force for e in np.eye(system.n)])
        free = np.linalg.svd(G)[2][system.m :].T
        return np.linalg.eigvalsh(free.T @ (matrix(system.H_qq, q0) + bending) @ free)[0]

    assert least(0.999 * critical) > 1e-5
    assert abs(least(critical)) <= 1e-12
    assert least(1.001 * critical) < -1e-5


def spaghetti(count: int) -> gs.Model:
    """Return Simo and Vu-Quoc's flying rod (J. Appl. Mech. 53, 1986) in the plane."""
    build = builder("spaghetti")
    beam = build.beam("rod", start=(0, 0, 0), end=(6, 8, 0), count=count, mass=10, bending=500,
                      twisting=500, inertia=(10, 10, 10))
    t = build.time
    load = sp.Piecewise((32 * t, t < 2.5), (32 * (5 - t), t < 5), (0, True))
    build.force(beam.first, (load / 10, 0, 0))
    build.torque(beam.first, [-load * x for x in beam.segments[0].rotation[2, :]])
    for name, x in zip("xy", beam.last.point(), strict=False):
        build.quantity(name, x)
    return build.model()


@pytest.mark.slow  # ten segments
def test_the_flying_spaghetti():
    """Ten segments have the recorded digits, which six stages and a quarter of the step confirm."""
    with budget.shared():
        model = spaghetti(10)
        step = gs.stepper("G-L", 3, system=model)
    run = step.integrate(model, dt=0.01, t_end=10.0, every=500)
    tips = np.stack([run.quantity("x"), run.quantity("y")], axis=1)[1:]
    expected = [[9.908697803870, -0.616441525560], [22.107890071905, 6.846164613665]]
    assert np.abs(tips - expected).max() <= 2e-11  # of order 6, the digits are written to 1e-12
    assert run.energies[1:] == pytest.approx([96.840229615949] * 2, abs=1e-11)
    assert run.total_angular_momentum()[1:, 2] == pytest.approx([-245.803383101742] * 2, abs=1e-11)
    assert run.total_momentum()[1:] == pytest.approx(np.array([[20, 0, 0]] * 2), abs=1e-13)


@pytest.mark.parametrize("extension", [
    pytest.param({}, id="balls"),
    pytest.param({"stretching": 4e4, "shearing": 4e4}, id="springs", marks=pytest.mark.slow)])
def test_frequencies_of_a_cantilever(extension):
    """Roots of the eigenvalues of K against M on the tangent space meet Timoshenko's 3.51499."""
    frequencies = []
    for count in (2, 4):
        build = builder()
        beam = build.beam("rod", count=count, inertia=(1e-4, 1e-4, 2e-4), **STRAIGHT | extension)
        build.fixed("clamp", build.ground, beam.first)
        frequencies.append(lowest_frequency(build.model()))
    exact = 3.5149944278800102071
    errors = exact - np.array(frequencies)
    assert errors[1] < 0.07
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.2)


def lowest_frequency(model: gs.Model) -> float:
    """Return ω of the slowest motion about the start, which is an equilibrium with λ = 0."""
    system = model.system
    state = dict(zip((*system.q, *system.p), (*model.q0, *model.p0), strict=True))
    state |= {s: model.parameters[str(s)] for s in system.parameters}

    def matrix(rows):
        return evaluate([e for row in rows for e in row], state).reshape(len(rows), -1)

    # Neither |q|² = 1 nor the balls of a straight beam without load carry forces.
    K, W, G = matrix(system.H_qq), matrix(system.H_pp), matrix(system.G)
    free = np.linalg.svd(G)[2][system.m :].T
    M = free.T @ np.linalg.solve(W, free)
    values = np.linalg.eigvals(np.linalg.solve(M, free.T @ K @ free)).real
    return float(np.sqrt(values[values > 1e-6].min()))


# ---------------------------------------------------------------- results


@cache
def loaded(extension: tuple[float, ...] = (), count: int = 2) -> tuple[gs.Model, gs.Trajectory]:
    """Return a loaded cantilever in equilibrium and two steps that keep it there, clamped b-a."""
    build = builder()
    stiffnesses = dict(zip(("stretching", "shearing"), extension, strict=False))
    beam = build.beam("rod", count=count, **STRAIGHT | {
        "bending": (1.0, 2.0), "twisting": 3.0} | stiffnesses)
    build.fixed("clamp", beam.first, build.ground)
    build.force(beam.last, LOAD)
    with budget.shared():
        model = build.model().equilibrium()
        step = gs.stepper("IMS", system=model)
    return model, step.integrate(model, dt=1e-3, steps=2)


LOAD = np.array([0.3, 0.5, -0.8])


@pytest.mark.parametrize(("extension", "count"), [
    pytest.param((), 2, id="balls"),
    pytest.param((), 3, id="more balls", marks=pytest.mark.slow),
    pytest.param((40.0, 25.0), 3, id="springs", marks=pytest.mark.slow)])  # a long derivation
def test_forces_and_moments_of_sections_balance_the_load(extension, count):
    """Sections have n = F and M = (P_tip − P) × F of the load, which need no stiffness."""
    model, run = loaded(extension, count)
    beam = run.beam("rod")
    assert f">{len(beam.segments)}<" in beam._repr_html_()
    line = beam.line()
    assert line[0, -1] == pytest.approx(tip(model, np.linalg.norm(line[0, -1] - line[0, -2])),
                                        abs=16 * EPS if not extension else 1e-2)
    assert np.abs(line[:, 0]).max() <= 64 * EPS
    assert beam.arc == pytest.approx(np.arange(count) / count)
    assert np.abs(beam.force() - LOAD).max() <= 1e-8  # multipliers of steps of 1e-3 s
    assert np.abs(beam.moment() - np.cross(line[:, -1:] - line[:, :-1], LOAD)).max() <= 1e-12
    assert np.linalg.norm(beam.force("section"), axis=2) == pytest.approx(np.linalg.norm(LOAD))
    if not extension:
        with pytest.raises(gs.InputError, match=r"'rod'.*one state"):
            run[-1:].beam("rod").tension()
    tangents = beam.directors()[..., 2]
    middle = tangents[:, :-1] + tangents[:, 1:]
    middle /= np.linalg.norm(middle, axis=2)[..., None]
    # The mean of the tangents is the tangent of a section halfway, but for the twist between them.
    assert beam.tension()[:, 1:] == pytest.approx(
        (middle * beam.force()[:, 1:]).sum(axis=2), rel=1e-4)
    # At the clamp, m = B κ about the axes of the section: half the angle, no axial part.
    B = np.array([1.0, 2.0, 3.0])
    assert beam.moment("section")[0, 0] == pytest.approx(B * beam.curvature()[0, 0], rel=2e-2)


def test_results_of_beams_survive_a_file_and_other_ones_are_refused(tmp_path):
    _, run = loaded()
    run.save(tmp_path / "run.npz")
    reloaded = gs.load(tmp_path / "run.npz").beam()
    assert np.array_equal(reloaded.moment(), run.beam().moment())
    assert reloaded.segments == ("rod_1", "rod_2")
    for call, words in ((lambda: run.beam("rope"), ("rope", "rod")),
                        (lambda: run.beam().force("body"), ("body", "section"))):
        with pytest.raises(gs.InputError) as refusal:
            call()
        assert all(word in str(refusal.value) for word in words)


def test_sections_of_damped_beams_resist_rates_of_strain():
    """Damping adds 0.2 times the rates of n and κ, by differences, to forces and moments."""
    run = systems.run("beam", systems.stepper("beam", "IMS"), 2)
    beam = run.beam()
    sections = [replace(joint, section=replace(joint.section, damping=0.2))
                for joint in beam._sections]
    damped = type(beam)(run, "rod", sections)
    rate = np.gradient(beam.force()[:, 0], 1e-4, axis=0)[1]
    added = (damped.force() - beam.force())[1, 0]
    assert np.abs(added).max() > 0.1
    assert added == pytest.approx(0.2 * rate, abs=1e-6)
    rate = np.gradient(beam.curvature()[:, 0], 1e-4, axis=0)[1]
    assert (damped.moment() - beam.moment())[1, 0] == pytest.approx(
        0.2 * beam.directors()[1, 0] @ rate, abs=1e-5)


# ---------------------------------------------------------------- joints with bodies


def test_a_beam_has_whole_parameters_and_is_drawn_as_a_tube():
    """A beam is drawn as bars with round ends of one radius and colour, as long as its segments."""
    build = builder()
    build.beam("rod", count=4, radius=0.02, **STRAIGHT)
    shapes = [shape for shapes in build.model().visuals.values() for shape in shapes]
    assert {(shape.kind, shape.colour) for shape in shapes} == {("bar", shapes[0].colour)}
    assert shapes[0].colour
    assert np.array([shape.size for shape in shapes]) == pytest.approx(
        np.array([[0.02, 0.02, 1 / 8]] * 4))
    model = cantilever(4, (0, 0, -1))
    assert model.parameters["rod_bending"] == 1.0
    softer = replace(model, parameters={**model.parameters, "rod_bending": 0.5})
    assert tip(softer.equilibrium(), 0.25)[2] < tip(model.equilibrium(), 0.25)[2]


def test_an_end_is_a_frame_at_the_end_of_its_segment():
    build = builder()
    beam = build.beam("rod", count=2, velocity=(1, 0, 0), angular_velocity=(0, 0, 2), **STRAIGHT)
    box = build.body("box", mass=1, inertia=(1, 1, 1))
    build.ball("hook", "rod_last", box, on_b=(0, 0, 0.5))
    model = build.model()
    assert model.q0[-3:] == pytest.approx([1, 0, -0.5], abs=4 * EPS)
    values = dict(zip((*model.system.q, *model.system.p), (*model.q0, *model.p0), strict=True))
    values |= {s: model.parameters[str(s)] for s in model.system.parameters}
    state = evaluate([*beam.last.point((0, 0, 0.1)), *beam.last.point_velocity()], values)
    assert state == pytest.approx([1.1, 0, 0, 1, 2, 0], abs=16 * EPS)


# ---------------------------------------------------------------- model files

FILE = """
name = "mast"
bodies = [{name = "hub", mass = 2, inertia = [1, 1, 1], position = [0, 0, 3.1]}]
beams = [
    {name = "mast", points = [[0, 0, 0], [0, 0, "1/2"], [0, 0.1, 2], [0, 0, 3]], count = 3, \
     mass = 0.4, bending = [5, 7], twisting = 2, stretching = 900, shearing = 400, damping = 0, \
     rest = [0, 0, 0.1], normal = [1, 0, 0], twist = "10 deg", radius = 0.01, \
     inertia = [0.01, 0.02, 0.03], velocity = [0, 1, 0], angular_velocity = [0, 0, "60 rpm"], \
     rep = "alpha"},
]
joints = [{name = "top", type = "ball", bodies = ["mast_last", "hub"], on_b = [0, 0, -0.1]}]
forces = [{type = "force", bodies = ["mast_last"], force = ["2", "0", "sin(t)"]}]
contacts = [{name = "floor", bodies = ["mast_2"], radius = 0.25}]
quantities = {lean = "mast_last_y + mast_2_x + mast_first_R33"}
"""


def test_files_have_beams():
    model = parse_model(FILE, "mast.toml")
    build = gs.Multibody("mast")
    hub = build.body("hub", mass=2, inertia=(1, 1, 1), position=(0, 0, 3.1))
    beam = build.beam(
        "mast", points=[(0, 0, 0), (0, 0, 0.5), (0, 0.1, 2), (0, 0, 3)], count=3, mass=0.4,
        bending=(5, 7), twisting=2, stretching=900, shearing=400, rest=(0, 0, 0.1),
        normal=(1, 0, 0), twist=np.radians(10), radius=0.01, inertia=(0.01, 0.02, 0.03),
        velocity=(0, 1, 0), angular_velocity=(0, 0, 2 * np.pi), rep="alpha")
    build.ball("top", beam.last, hub, on_b=(0, 0, -0.1))
    build.force(beam.last, (2, 0, sp.sin(build.time)))
    build.contact("floor", beam.segments[1], radius=0.25)
    build.quantity("lean", beam.last.point()[1] + beam.segments[1].x[0] + beam.first.direction(
        (0, 0, 1))[2])
    built = build.model()
    assert model.system.H == built.system.H
    assert model.system.forces == built.system.forces
    assert model.system.quantities == built.system.quantities
    assert np.abs(model.q0 - built.q0).max() <= 4 * EPS
    assert np.abs(model.p0 - built.p0).max() <= 64 * EPS
    assert dict(model.parameters) == pytest.approx(dict(built.parameters), rel=4 * EPS)


@pytest.mark.parametrize(("old", "new", "words"), [
    ("count = 3", "count = 1", ("beams", "count", "2")),
    ("count = 3", "count = 100000", ("100000", "1000")),
    ("twisting = 2, ", "", ("twisting", "missing")),
    ("twisting = 2", "torsion = 2", ("torsion", "twisting")),
    ("shearing = 400, ", "", ("shearing",)),
    ("bending = [5, 7]", 'bending = "stiff"', ("bending",)),
    ("[0, 0.1, 2]", "[0, 0.1]", ("points, row 3", "3 numbers")),
    ("[0, 0.1, 2]", "3", ("points, row 3",)),
    ("[0, 0.1, 2]", '[0, 0, "1/2"]', ("coincide",)),
    ('rep = "alpha"', 'rep = "beta"', ("rep", "alpha")),
    ('"mast_last", "hub"', '"mast_end", "hub"', ("mast_end", "mast_last")),
])
def test_files_with_other_beams(old, new, words):
    assert old in FILE
    with pytest.raises(gs.InputError) as refusal:
        parse_model(FILE.replace(old, new), "mast.toml")
    assert all(word in str(refusal.value) for word in ("mast.toml", *words))


def test_clamps_inside_and_names_of_beams_that_are_taken_are_refused_in_files():
    text = FILE.replace('type = "ball"', 'type = "fixed"').replace('["mast_last"', '["mast_2"', 1)
    with pytest.raises(gs.InputError, match=r"mast\.toml.*first"):
        parse_model(text, "mast.toml")
    build = builder()
    build.beam("rod", count=2, **STRAIGHT)
    for name in ("rod", "rod_1", "rod_last"):
        with pytest.raises(gs.InputError, match=name):
            build.body(name, mass=1, inertia=(1, 1, 1))


# ---------------------------------------------------------------- refusals


@pytest.mark.parametrize(("change", "words"), [
    ({"count": 1}, ("count", "1", "2")), ({"count": 2.5}, ("count", "2.5")),
    ({"bending": 0}, ("bending", "0")), ({"bending": (1, -1)}, ("bending", "-1")),
    ({"bending": (1, 1, 1)}, ("bending", "2 finite")), ({"twisting": -2}, ("twisting", "-2")),
    ({"stretching": 5}, ("shearing", "stretching")), ({"shearing": 5}, ("stretching", "shearing")),
    ({"stretching": 0, "shearing": 1}, ("stretching", "0")), ({"damping": -1}, ("damping", "-1")),
    ({"end": (0, 0, 0)}, ("coincide",)), ({"end": None}, ("start and end", "points")),
    ({"points": [(0, 0, 0), (1, 0, 0)]}, ("points and",)),
    ({"points": [(0, 0, 0), (1, 0)], "start": None, "end": None}, ("three finite",)),
    ({"points": [(0, 0, 0), (1, 0, 0), (0, 0, 0)], "start": None, "end": None}, ("turns back",)),
    ({"normal": (2, 0, 0)}, ("normal", "across")), ({"twist": 20}, ("twists", "more segments")),
    ({"rest": (9, 0, 0)}, ("rest", "more segments")), ({"radius": 0}, ("radius", "0")),
    ({"inertia": (1, 1, 9)}, ("inertia",)), ({"mass": 0}, ("mass", "0")),
])
def test_descriptions_that_no_beam_has(change, words):
    with pytest.raises(gs.InputError) as refusal:
        builder().beam("rod", **STRAIGHT | {"count": 2} | change)
    assert all(word in str(refusal.value) for word in words)


@pytest.mark.parametrize("frames", [("ground", "rod_2"), ("rod_first", "other_last"),
                                    ("rod_2", "other_last"), ("hub", "rod_1")])
def test_clamps_inside_are_refused(frames):
    build = builder()
    build.beam("rod", count=3, **STRAIGHT)
    build.beam("other", count=3, **STRAIGHT)
    build.body("hub", mass=1, inertia=(1, 1, 1))
    with pytest.raises(gs.InputError, match="first"):
        build.fixed("clamp", *frames)
