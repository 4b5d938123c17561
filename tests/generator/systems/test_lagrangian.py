"""Systems from a Lagrangian: the C factorises M(q), the second way inverts it in symbols.

    double   two links on a plane: M is full, n = 2, m = 0
    bead     in cylindrical coordinates (r, z, φ) that turn with w: b ≠ 0, r and z coupled in M, φ
             not, on r² + z² = l², damped and driven: n = 3, m = 1
"""

import pickle
import re
import runpy
from functools import cache

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy.core.cache import clear_cache

import gyrospark as gs
import systems
from calls import refused
from compilers import MAIN, compiler
from gyrospark.generator.kernels.statements import Kernel
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.symbolic.shared_subexpressions import Shared, share
from gyrospark.runtime.compilation.object_files import objects_of
from lagrangians import bead, case, double
from processes import ROOT, call
from strategies import EPS
from time_lagrangians import c, k, one, t, wire


@cache
def andrews():
    """Return the names that ``examples/andrews.py`` defines."""
    return runpy.run_path(str(ROOT / "examples" / "andrews.py"))


def test_energies_and_motion_are_those_of_the_hamiltonian_written_out():
    """H with M⁻¹ in symbols has the same values, and the same motion by SciPy."""
    step, entry = systems.stepper("shaken"), systems.case("shaken")
    hamiltonian = entry.system.legendre()
    values = {s: entry.parameters[str(s)] for s in hamiltonian.parameters}
    H, slopes = (
        sp.lambdify([*hamiltonian.q, *hamiltonian.p, hamiltonian.time], e.xreplace(values))
        for e in (hamiltonian.H, sp.Matrix([*hamiltonian.H_p, *(-e for e in hamiltonian.H_q)])))
    for q, p, now in np.random.default_rng(2).standard_normal((5, 3)):
        energy = step.energy([q], [p], parameters=entry.parameters, t=now)
        assert abs(energy - H(q, p, now)) <= 64 * EPS * (1 + abs(energy))
    run = systems.run("shaken", step, 200, dt=0.005, t=0.0)
    exact = solve_ivp(lambda now, z: np.ravel(slopes(*z, now)), (0, 1), [run.q[0, 0], run.p[0, 0]],
                      method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
    assert np.abs(exact - [run.q[-1, 0], run.p[-1, 0]]).max() <= 1e-8  # of order 4


def test_the_hamiltonian_written_out_has_inputs_and_quantities():
    """For L = k v²/2 − x²/2 and p = k v, the quantity v² is p²/k², and u stays an input."""
    x, v, u = sp.symbols("x v u", real=True)
    k = sp.Symbol("k", positive=True)
    system = gs.System.from_lagrangian(k * v**2 / 2 - x**2 / 2, [x], [v], [k], forces=[u - v],
                                       inputs=[u], quantities={"square": v**2}, name="driven")
    hamiltonian = system.legendre()
    (p,) = hamiltonian.p
    assert hamiltonian.inputs == (u,)
    assert hamiltonian.quantities["square"].equals(p**2 / k**2)
    assert hamiltonian.forces[0].equals(u - p / k)


def test_a_quantity_of_velocities_has_no_c():
    with refused("'speed'.*'vx'.*legendre"):
        gs.stepper("G-L", 2, system=lagrangian(quantities={"speed": VX}))


@pytest.mark.parametrize("name", ["lagrangian", "bead", "shaken"])
def test_velocities_are_the_way_back_of_momenta(name):
    """Velocities of the momenta of many states, each at its own time, are those of the start."""
    step, entry = systems.stepper(name), systems.case(name)
    rng, times = np.random.default_rng(3), np.linspace(0, 2, 12).reshape(3, 4)
    rows_q, rows_v = np.array(entry.q) + 0.1 * rng.standard_normal((2, 3, 4, step.n))
    options = {"parameters": entry.parameters}
    p = step.momenta(rows_q, rows_v, t=times, **options)
    assert p.shape == rows_q.shape
    each = [step.momenta(*state, t=time, **options) for *state, time in zip(
        rows_q.reshape(12, -1), rows_v.reshape(12, -1), times.ravel(), strict=True)]
    assert np.array_equal(p.reshape(12, -1), each)
    back = step.velocities(rows_q, p, t=times, **options)
    np.testing.assert_allclose(back, rows_v, rtol=0, atol=64 * EPS * np.abs(rows_v).max())
    with refused(r"\(4, 3\).*\(3, 4\)"):
        step.momenta(rows_q, rows_v, t=times.T, **options)
    with refused(rf"\({step.n},\).*\({step.n + 1},\)"):
        step.momenta(entry.q, [*entry.q, 0], **options)


def test_the_midpoint_rule_has_the_rates_of_the_lagrangian():
    """Δp/Δt = L_q + F and p̄ = L_v at q̄, v̄ = Δq/Δt and the middle of each step."""
    step, case = systems.stepper("lagrangian", "IMS"), systems.case("lagrangian")
    run, system = systems.run("lagrangian", step, 20), case.system
    mean = [(x[1:] + x[:-1]) / 2 for x in (run.q, run.t)]
    rates = sp.lambdify([*system.q, system.time, *system.velocities, *system.parameters], [
        [sp.diff(system.L, x) + F for x, F in zip(system.q, system.forces, strict=True)],
        [sp.diff(system.L, v) for v in system.velocities]])
    p_rate, p = np.array(rates(*mean[0].T, mean[1], *(np.diff(run.q, axis=0) / case.dt).T,
                               *(case.parameters[str(x)] for x in system.parameters)))
    size = np.abs(run.p).max()
    assert np.abs(p.T - (run.p[1:] + run.p[:-1]) / 2).max() <= 64 * EPS * size / case.dt
    assert np.abs(p_rate.T * case.dt - np.diff(run.p, axis=0)).max() <= 64 * EPS * size


def test_a_trajectory_keeps_its_velocities_in_files(tmp_path):
    """Velocities of a run follow from its momenta and times, are slopes of q, and survive files."""
    step = systems.stepper("lagrangian")
    run = systems.run("lagrangian", step, 20, dt=0.01)
    at_its_times = step.velocities(run.q, run.p, t=run.t,
                                   parameters=systems.case("lagrangian").parameters)
    np.testing.assert_allclose(run.velocities, at_its_times, rtol=0, atol=64 * EPS)
    slopes = (run.q[2:] - run.q[:-2]) / 0.02
    np.testing.assert_allclose(run.velocities[1:-1], slopes, rtol=0, atol=0.01)
    again = gs.load(run.save(tmp_path / "run.npz"))
    assert np.array_equal(again.velocities, run.velocities)
    heading = run.save(tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()[0]
    assert heading.endswith("vx,vy")


def test_long_kernels_are_compiled_once(tmp_path):
    """One object of a module has the text of a kernel; the objects that call it declare it."""
    files = generate(Spec.from_arguments("G-L", 2), system=andrews()["system"]).source.files()
    (tmp_path / "andrews_gl2.c").write_text(files["andrews_gl2.c"])
    kernel = re.compile(r"^(?!.*static).*\bvoid (\w*constraint_increment)\([^;{]*\)\s*{",
                        re.MULTILINE)
    texts = {}
    for unit in (unit for group in ("runs", "lanes")
                 for unit in objects_of("andrews_gl2", files, group)):
        (tmp_path / "andrews_gl2.h").write_text(unit.header)
        command = [*compiler(MAIN), "-E", "-P", *unit.flags, "andrews_gl2.c"]
        texts[unit.name] = kernel.findall(call(command, cwd=tmp_path).stdout)
    assert texts == {"object1": ["constraint_increment"], "object2": [],
                     "object4": ["lanes_constraint_increment"], "object3": []}


def test_equal_shared_parts_are_the_same():
    """Shared parts of equal expressions are one object, however they came about."""
    x, y = sp.symbols("x y", real=True)
    shared = Shared(x * (1 + y))
    clear_cache()  # SymPy's own keeps the last thousand
    assert Shared((y + 1) * x) is shared
    assert Shared(sp.Integer(2)) == 2
    assert pickle.loads(pickle.dumps(shared)) is shared


@pytest.mark.parametrize("factors", [True, False])
def test_what_cancels_is_not_written_and_nothing_has_two_names(factors):
    x, y, z = sp.symbols("x y z", real=True)
    first, second = share(x * y + z), Shared(Shared(z) + x * y)
    lost = share(first * sp.sin(x))
    statements = Kernel("k", "", {"v": [x, y, z]},
                        {"out": [lost * (first - second) + first, second * x]},
                        factors=factors).statements
    used = {s for _, e in (*statements.shared, *statements.outputs) for s in e.free_symbols}
    assert {symbol for symbol, _ in statements.shared} <= used
    assert not any(e.is_Symbol for _, e in statements.shared)
    assert not any(e.has(sp.sin) for _, e in statements.shared)


def test_degrees_zeros_of_m_and_names_of_momenta():
    v, w = sp.symbols("v w", real=True)
    x, y = sp.symbols("x y", real=True)
    L = sp.exp(2 * sp.log(1 + v**2) / 2) + w**2 * (1 + x**2) / 2
    system = gs.System.from_lagrangian(L, [x, y], [v, w], [])
    assert system.mass[0, 0].subs(v, 0) == 2
    system = bead()
    assert system.elimination.entries == 4  # three of the diagonal, one of r with z
    assert system.elimination.products == 1
    x, v, stiffness = sp.symbols("x v p_x", real=True)
    system = gs.System.from_lagrangian(v**2 / 2 - stiffness * x**2, [x], [v], [stiffness])
    assert [str(p) for p in system.p] == ["p_x_"]


X, Y, VX, VY, M = sp.symbols("x y vx vy m", real=True)
FREE = M * (VX**2 + VY**2) / 2


def lagrangian(L=FREE, q=(X, Y), v=(VX, VY), parameters=(M,), *more, **named):
    return gs.System.from_lagrangian(L, q, v, parameters, *more, **named)


@pytest.mark.parametrize(("arguments", "message"), [
    ({"L": M * sp.sqrt(1 + VX**2) + VY**2}, "quadratic"), ({"L": FREE + VX**3}, "quadratic"),
    # their second derivatives do not depend on the velocity
    *(({"L": FREE + e}, "quadratic") for e in (
        sp.Abs(VX), X * sp.Max(VX, 0), X * sp.floor(VY), sp.sign(VX - VY))),
    ({"L": M * VX**2 / 2}, r"singular.*\bvy\b"),
    ({"L": M * (VX + X * VY) ** 2 / 2}, "singular.*vx, vy"), ({"L": FREE * sp.Abs(X)}, "switches"),
    ({"v": (VX,)}, "2 coordinates.*1 velocities"),
    ({"v": (VX, sp.Integer(1))}, "velocities.*symbol"),
    ({"L": M * (VX**2 + X**2) / 2, "v": (VX, X)}, "'x'.*twice"), ({"q": X}, "q = x"),
    ({"L": "x"}, "SymPy"), ({"L": FREE + sp.Symbol("k")}, "unknown symbol 'k'"),
    ({"forces": (VX, sp.Symbol("k"))}, "Force 1.*unknown"),
    ({"forces": (VX,)}, "1 force.*2 coordinates"), ({"constraints": (X * VX,)}, "holonomic"),
])
def test_bad_input_is_refused(arguments, message):
    with refused(message):
        lagrangian(**arguments)


def test_velocities_of_a_hamiltonian_system_are_refused(gl3):
    with refused("heavy_top_gl3_gamma.*Hamiltonian"):
        gl3.momenta([1, 0, 0, 0], [0, 0, 0, 0], parameters={})


def test_what_needs_h_written_out_says_so():
    """Two profiles and certificates refuse Lagrangians."""
    for profile in ("control", "run"):
        with refused(f"{profile}.*Lagrangian"):
            generate(Spec.from_arguments("G-L", 2).with_profile(profile), system=double())
    entry = systems.case("heavy_bob")
    with refused("Lagrangian"):
        gs.certify(gs.Model(entry.system, entry.parameters, entry.q, entry.p, dt=0.01, steps=5),
                   "G-L", 2)


def test_consistent_starts_without_a_compiler():
    """Starts by SymPy equal the compiled projection's."""
    system, parameters, q, v = case(bead)
    step = systems.stepper("bead")
    p = step.momenta(q + 0.01, v, parameters=parameters)
    start = gs.consistent(system, q + 0.01, p, parameters=parameters)
    again = step.project(q + 0.01, p, parameters=parameters)
    np.testing.assert_allclose(start.q, again[0], rtol=0, atol=16 * EPS)
    np.testing.assert_allclose(start.p, again[1], rtol=0, atol=64 * EPS)


NUMBERS = {"w": 2.5, "a": 0.3, "b": 0.25, "g": 9.0}


@pytest.mark.slow  # a stepper for this
def test_bead_on_a_wire_that_turns():
    """The bead has r = r₀ cosh wt, and the rheonomic constraint the moment 2 m w r ṙ."""
    step = gs.stepper("G-L", 3, system=wire())
    numbers = {"m": 1.5, "w": 2.0}
    p = step.momenta([0.5, 0.0], [0.0, 2.0], parameters=numbers)
    run = step.integrate([0.5, 0.0], p, dt=0.01, steps=100, parameters=numbers)
    r, speed = 0.5 * np.cosh(2 * run.t), np.sinh(2 * run.t)
    np.testing.assert_allclose(run.q, np.transpose([r, 2 * run.t]), rtol=0, atol=64 * EPS)
    np.testing.assert_allclose(run.velocities, np.transpose([speed, 2 + 0 * r]), atol=256 * EPS)
    moment = -2 * 1.5 * 2 * r[-1] * speed[-1]  # λ has the sign of g_q: ṗ = … − g_qᵀλ
    assert abs(run.multipliers[-1, -1] / moment - 1) < 1e-6  # of a lower order than the state
    np.testing.assert_allclose(run.work, run.energies - run.energies[0], rtol=0, atol=1e-12)
    with refused("constraint"):
        step.integrate(gs.Start([0.5, 0.0], p, t=1.0), dt=0.01, steps=1, parameters=numbers)


def test_states_between_steps_and_crossings():
    """``at`` and events where a coordinate passes its level agree with a run of half the step."""
    step = systems.stepper("shaken")
    p = step.momenta([0.5], [0.1], parameters=NUMBERS)
    run, fine = (step.integrate([0.5], p, dt=0.02 / n, steps=100 * n, parameters=NUMBERS,
                                events=[gs.Event("x", level=0.2)]) for n in (1, 2))
    between = run.at(fine.t)
    np.testing.assert_allclose(between.q, fine.q, rtol=0, atol=1e-6)
    np.testing.assert_allclose(between.velocities, fine.velocities, rtol=0, atol=1e-5)
    crossings, fine_crossings = run.events["x"], fine.events["x"]
    assert len(crossings.t) == len(fine_crossings.t) >= 2
    np.testing.assert_allclose(crossings.t, fine_crossings.t, rtol=0, atol=1e-6)
    np.testing.assert_allclose(crossings.q, 0.2, rtol=0, atol=8 * EPS)


def test_time_that_nobody_declared_is_refused():
    x, v, _ = one("x")
    with refused("unknown.*'t'.*time"):
        gs.System.from_lagrangian(t * v**2, [x], [v], [])
    with refused("Constraint 0.*'t'.*holonomic"):
        gs.System.from_lagrangian(v**2 + c**2, [x, k], [v, c], [], [x - t])
