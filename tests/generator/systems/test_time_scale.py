"""Systems in scaled time as expressions: H̃ = σ(H + e), forces, the constraint on the momenta."""

import json
import random

import pytest
import sympy as sp

import gyrospark as gs
import systems
from gyrospark.generator.normal_forms.canonical_system import canonical
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.systems.system_digest import system_digest
from gyrospark.generator.systems.time_scale import scale_time

x, y, u, v, t = sp.symbols("x y u v t", real=True)
r = sp.sqrt(x**2 + y**2)
SCALABLE = ("kepler", "polar", "henon_heiles", "driven_oscillator", "pendulum", "ellipse",
            "breathing", "relativistic", "dragged_pendulum", "two_rods")


def kepler(**more):
    return gs.System([x, y], [u, v], (), (u**2 + v**2) / 2 - 1 / r, name="kepler", **more)


def scale_of(system):
    """Return a scale of a coordinate, a momentum and the time, if the system has one."""
    power = system.q[0] ** 2 + system.p[-1] ** 2 + (sp.sin(system.time) if system.time else 0)
    return 1 / sp.sqrt(2 + power)


def numbers(system, seed):
    """Return random numbers for all symbols, with H + e = 0."""
    draw = random.Random(seed)
    point = {s: sp.Float(draw.uniform(0.3, 0.9), 30)
             for s in (*system.q, *system.p[:-1], *system.parameters)}
    return point | {system.p[-1]: -system.energy.xreplace(point)}


@pytest.mark.parametrize("name", SCALABLE)
def test_rates_are_scaled_rates_where_energy_and_its_momentum_cancel(name):
    declared = systems.case(name).system
    scale = scale_of(declared)
    system, n = scale_time(canonical(declared.with_time_scale(scale))), declared.n
    point = numbers(system, name)
    sigma = scale.xreplace(point)
    forces = [*system.forces] or [sp.Integer(0)] * (n + 1)
    declared_forces = [*declared.forces] or [sp.Integer(0)] * n
    power = sum(F * velocity for F, velocity in zip(declared_forces, declared.H_p, strict=True))
    expected_rates = [sigma * e.xreplace(point) for e in (
        *declared.H_p, sp.Integer(1),
        *(F - e for F, e in zip(declared_forces, declared.H_q, strict=True)),
        -declared.H_t - power)]
    rates = [e.xreplace(point) for e in (
        *system.H_p, *(F - e for F, e in zip(forces, system.H_q, strict=True)))]
    for rate, expected in zip(rates, expected_rates, strict=True):
        assert abs(rate - expected) < 1e-25 * (1 + abs(expected))


@pytest.mark.parametrize("name", ["pendulum", "ellipse", "breathing", "relativistic", "two_rods"])
def test_constraint_on_the_momenta_is_that_of_the_declared_system(name):
    declared = systems.case(name).system
    system = scale_time(canonical(declared.with_time_scale(scale_of(declared))))
    point = numbers(system, name)
    full = [sum(a * b for a, b in zip(row, declared.H_p, strict=True)) + rate
            for row, rate in zip(declared.G, declared.g_t, strict=True)]
    for f, rate_of_g in zip(system.hidden, full, strict=True):  # up to a factor without momenta
        ratio = f.xreplace(point) / rate_of_g.xreplace(point)
        moved = point | {p: value + sp.Rational(1, 7) for p, value in point.items()
                         if p in declared.p}
        assert abs(f.xreplace(moved) - ratio * rate_of_g.xreplace(moved)) < 1e-25


def test_momenta_of_the_time_manifests_and_digests_of_a_scale():
    assert scale_time(kepler(time_scale=r)).forces == ()
    assert scale_time(kepler(time_scale=r * (2 + sp.cos(t)), time=t)).forces == (0, 0, 0)
    source = generate(Spec.from_arguments("G-L", 2), system=kepler(time_scale=r)).source
    manifest = json.loads(source.manifest)["system"]
    assert manifest["coordinates"] == ["x", "y"]
    assert manifest["clock"] == {"time": "t", "momentum": "p_t", "scale": "time_scale"}
    assert sp.sympify(manifest["quantities"]["time_scale"], {"x": x, "y": y}) == r
    assert sp.sympify(manifest["hamiltonian"], {"x": x, "y": y, "u": u, "v": v}) == kepler().H
    digests = {system_digest(kepler(time_scale=scale)) for scale in (None, r, r**2, 2 * r)}
    assert len(digests) == 4
    assert system_digest(kepler(time_scale=r)) == system_digest(kepler().with_time_scale(r))
    assert system_digest(kepler(time_scale=r).with_time_scale(None)) == system_digest(kepler())


def test_names_that_are_taken_are_left_alone():
    p_t = sp.Symbol("p_t", real=True)
    system = gs.System([x, t], [u, p_t], (), (u**2 + p_t**2) / 2 + x**2, name="s", time_scale=x**2,
                       quantities={"time_scale": x})
    scaled = scale_time(system)
    assert [str(s) for s in (*scaled.q, *scaled.p)] == ["x", "t", "t_", "u", "p_t", "p_t_"]
    assert scaled.quantities["time_scale"] == x
    assert scaled.quantities[scaled.scale_name] == x**2


FILES = {
    "system": """
time_scale = "1 / sqrt(w**2 + x**2)"
coordinates = ["x"]
momenta = ["u"]
hamiltonian = "u**2 / 2 + x**4"
[parameters]
w = 2.0
[start]
q = [1.0]
p = [0.0]
""",
    "body": """
time_scale = "1 / sqrt(w**2 + q1**2)"
[parameters]
w = 2.0
[body]
inertia = [1.0, 2.0, 3.0]
[start]
quaternion = [1.0, 0.0, 0.0, 0.0]
angular_velocity = [0.0, 1.0, 0.1]
""",
    "bodies": """
time_scale = "1 / sqrt(w**2 + pivot_rate**2)"
[parameters]
w = 2.0
[[bodies]]
name = "arm"
mass = 1.0
inertia = [0.1, 0.1, 0.1]
[[joints]]
name = "pivot"
type = "revolute"
bodies = ["ground", "arm"]
axis = [0.0, 1.0, 0.0]
on_b = [0.0, 0.0, 0.5]
""",
}


@pytest.mark.parametrize("kind", FILES)
def test_a_model_file_has_a_time_scale(kind, tmp_path):
    text, path = FILES[kind], tmp_path / "model.toml"
    head = f'name = "scaled"\n{"[system]" if kind == "system" else ""}'
    path.write_text(head + text, encoding="utf-8")
    model = gs.load_model(path)
    scale = model.system.time_scale
    assert "w" in map(str, scale.free_symbols)
    assert len(scale.free_symbols) > 1
    assert float(model.parameters["w"]) == 2.0
    assert scale_time(canonical(model.system)).n == model.system.n + 1
    path.write_text((head + text).replace("w**2", "wide**2"), encoding="utf-8")
    with pytest.raises(gs.InputError, match="wide"):
        gs.load_model(path)


def test_a_multibody_has_one_time_scale():
    build = gs.Multibody("pair")
    a, b = (build.point_mass(name, mass=1.0, position=position) for name, position in (
        ("a", (0, 0, 0)), ("b", (1, 0, 0))))
    build.time_scale(gs.scales.distance(a, b))
    scale = build.model().system.time_scale
    assert scale.subs(dict(zip(build.model().system.q, [0, 0, 0, 4, 0, 0], strict=True))) == 8
    with pytest.raises(gs.InputError, match=r"rates\("):
        build.time_scale(1)


def test_scales_are_powers_of_distances_and_smooth_minima():
    assert gs.scales.distance((x, y), (0, 0)) == r ** sp.Rational(3, 2)
    assert gs.scales.distance((x, y), (3, 0), power=1).subs({x: 0, y: 4}) == 5
    assert gs.scales.rates(3, 4) == sp.Rational(1, 5)
    assert gs.scales.rates(x, 2).subs(x, 0) == sp.Rational(1, 2)


@pytest.mark.parametrize(("make", "words"), [
    (lambda: gs.scales.distance((x, y), (0, 0), power=0), ["power = 0"]),
    (lambda: gs.scales.distance((x, y), (0, 0, 0)), ["2", "3"]),
    (lambda: gs.scales.distance((x, y), (x, y)), ["same point"]),
    (lambda: gs.scales.rates(x), ["1", "rates("]),
    (lambda: gs.scales.rates(), ["0", "rates("]),
])
def test_unusable_scales_are_refused(make, words):
    with pytest.raises(gs.InputError) as caught:
        make()
    assert all(word in str(caught.value) for word in words), caught.value


a, b = sp.symbols("a b", real=True)


@pytest.mark.parametrize(("make", "words"), [
    (lambda: kepler(time_scale=a * r), ["'a'", "parameters"]),
    (lambda: kepler(time_scale=r * t), ["'t'", "time"]),
    (lambda: kepler(time_scale="r"), ["'r'"]),
    (lambda: kepler(time_scale=-1 - x**2), ["-x**2 - 1", "positive"]),
    (lambda: kepler(time_scale=sp.Integer(0)), ["0", "positive"]),
    (lambda: gs.System([x], [u], (), u**2 / 2, forces=[a], inputs=[a], name="s",
                       time_scale=1 + x**2), ["a", "parameters"]),
    (lambda: gs.System([x, y], [u, v], (), (u**2 + v**2) / 2, velocities=[a, b], name="s",
                       velocity_constraints=[a - x * b], time_scale=1 + x**2),
     ["A0", "with_row_integrals"]),
    (lambda: gs.System.from_lagrangian(a**2 / 2, [x], [a], ()).with_time_scale(1 + x**2),
     ["Lagrangian", "System("]),
])
def test_unusable_scales_and_systems_are_refused(make, words):
    with pytest.raises(gs.InputError) as caught:
        make()
    assert all(word in str(caught.value) for word in words), caught.value


@pytest.mark.parametrize(("options", "word"), [
    ({"order": 4}, "splitting"), ({"frame": "symmetries"}, "frame"), ({"profile": "control"},
                                                                     "control"),
    ({"profile": "run"}, "run")])
def test_what_steps_in_scaled_time_do_not_have_is_refused(options, word):
    spec = (Spec.from_arguments(order=options["order"]) if "order" in options
            else Spec.from_arguments("G-L", 2))
    spec = spec.with_frame(options.get("frame")).with_profile(options.get("profile"))
    with pytest.raises(gs.InputError) as caught:
        generate(spec, system=kepler(time_scale=r))
    assert word in str(caught.value)
    assert "time_scale" in str(caught.value)
