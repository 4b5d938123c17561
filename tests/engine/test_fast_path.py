"""The fast path: what it assumes is proved, what it gives is Newton's to round-off."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP
from gyrospark.core.real_types import REALS
from gyrospark.generator.multibody.rigid_body import free_body, heavy_top
from gyrospark.generator.schemes.fast_path import FastSystem, Folds
from gyrospark.generator.schemes.fast_tableau import FastTableau
from gyrospark.generator.tableaux.families import gauss_lobatto, lobatto_iiiab

FAMILIES = [*map(gauss_lobatto, (1, 2, 3, 5, 8)), *map(lobatto_iiiab, (2, 3, 8))]
BODIES = {f"{make.__name__}_{rep}": make(rep) for make in (heavy_top, free_body)
          for rep in ("alpha", "gamma")}


#: Several constraints, H neither separable nor quadratic, and no constraints.
OTHERS = ("two_rods", "relativistic", "driven_oscillator")


def another(name):
    """Return stepper, start and parameters."""
    step = systems.stepper(name)
    return step, *systems.start(name, step), systems.case(name).parameters


@pytest.mark.parametrize("name", BODIES)
def test_the_schur_matrix_of_a_body_is_one_over_its_parameter(name):
    system = BODIES[name]
    fast = FastSystem(system)
    parameter = next(x for x in system.parameters if str(x) in ("alpha", "gamma"))
    assert fast.schur == [[1 / parameter]]
    assert fast.correction == 1 / (4 * parameter)
    assert fast.is_affine
    assert not fast.is_separable
    assert len(fast.shared_sums) == 3  # the components of L(q) p


@pytest.mark.parametrize("name", BODIES)
def test_identities_hold_at_states_on_the_constraint(name):
    """Numbers confirm G H_pp Gᵀ, H_pp Gᵀ = c Gᵀ, and that a force leaves them alone."""
    system = BODIES[name]
    fast = FastSystem(system)
    values = {x: sp.Rational(k + 2, 7) for k, x in enumerate(system.parameters)}
    unit = [sp.Rational(1, 10) * k for k in (1, 3, 3, 9)]
    state = dict(zip([*system.q, *system.p], [*unit, 3, -1, 2, 5], strict=True)) | values
    H_pp = sp.Matrix(system.H_pp).subs(state)
    G = sp.Matrix(system.G).subs(state)
    assert G * H_pp * G.T == sp.Matrix(fast.schur).subs(state)
    assert H_pp * G.T == fast.correction.subs(state) * G.T
    for u in fast.shared_sums:
        moved = u.subs({y: y + 5 * x for x, y in zip(system.q, system.p, strict=True)})
        assert sp.expand(moved - u) == 0


def test_what_is_not_constant_is_not_taken_for_constant():
    fast = FastSystem(systems.case("two_rods").system)
    assert fast.schur_inverse is None
    assert fast.correction is None
    assert fast.is_separable
    assert not FastSystem(systems.case("relativistic").system).is_affine


def test_a_division_by_g_leaves_roots_of_momenta_alone():
    """W of a relativistic system is SymPy's remainder, and G H_pp Gᵀ where g = 0."""
    system = systems.case("relativistic").system
    fast, draw = FastSystem(system), np.random.default_rng(6)
    (W,), forces = fast.schur[0], [row[0] for row in fast.forces]
    product = sum(a * b for a, b in zip(system.G[0], forces, strict=True))
    remainder = sp.reduced(sp.expand(product), [*system.constraints], *system.q)[1]
    for x, *values in draw.uniform(0.2, 0.9, (2, 6)):
        for y, expected in ((values[0], remainder), (np.sqrt(1 - x**4), product)):
            state = dict(zip([*system.q, *system.p, *system.parameters], [x, y, *values[1:]],
                             strict=True))
            assert abs(W.subs(state) / expected.subs(state) - 1) < 1e-13


def test_folds_take_powers_of_two_into_constants():
    k, l, x = sp.symbols("k l x", real=True)  # noqa: E741
    folds = Folds({k, l})
    assert folds(2 * x) == 2 * x
    assert folds(k * x / 3) == k * x / 3
    folded = folds(sp.Rational(1, 4) * k * x**2 - 2 * l * x)
    assert folded.xreplace({s: e for e, s in folds.definitions.items()}) == k * x**2 / 4 - 2 * l * x
    assert len(folds.definitions) == 2


@pytest.mark.parametrize("real", ["float", "double", "long-double"])
@pytest.mark.parametrize("tableau", FAMILIES, ids=lambda t: t.name)
def test_rounded_coefficients_are_symplectic_and_symmetric_exactly(tableau, real):
    """Rounded numbers have μ̂_ij = 1 − μ_ji, ν̃_ij = 1 − ν_ji and reversal as exact fractions."""
    fast, kind = FastTableau(tableau), REALS[real]
    assert fast.refusal is None
    assert fast.is_symplectic(kind)
    tables, s = fast.tables(kind), tableau.s
    for name in ("mu", "mu_hat"):
        for i in range(s):
            for j in range(s):
                assert tables[name][i][j] + tables[name][s - 1 - i][s - 1 - j] == 1
    centres = fast.centres
    for name, exact, weights in (("mu", "A", "b"), ("mu_hat", "A_hat", "b_hat")):
        for i in range(s):
            for j in range(s):
                error = tables[name][i][j] - centres[exact][i][j] / centres[weights][j]
                assert abs(error) <= Fraction(1, 2**kind.bits) * max(1, abs(tables[name][i][j]))


def whole(half, rows, columns):
    """Return the table that sums and differences multiply by."""
    pairs, table = columns // 2, []
    for i in range(rows):
        row = half[min(i, rows - 1 - i)]
        sign = 0 if 2 * i + 1 == rows else 1 if 2 * i < rows else -1
        even = row[pairs:] + row[pairs:2 * pairs][::-1]
        if columns % 2:
            even = [*row[pairs:2 * pairs], row[2 * pairs], *row[pairs:2 * pairs][::-1]]
        odd = [*row[:pairs], *[0] * (columns % 2), *(-e for e in row[:pairs][::-1])]
        table.append([Fraction(1, 2) + o + sign * e for o, e in zip(odd, even, strict=True)])
    return table


@pytest.mark.parametrize("real", ["float", "double", "float128"])
@pytest.mark.parametrize(("scheme", "s"), [("G-L", 7), ("G-L", 8), ("LIIIA-B", 8)])
def test_halves_of_symmetric_tables_are_symplectic_and_symmetric_exactly(scheme, s, real):
    """Tables that products of lanes represent are so in rational arithmetic."""
    kind = REALS[real]
    tableau = gs.tableau(scheme, s)
    fast, p = FastTableau(tableau), tableau.p
    half = fast.even_odd_tables(kind)
    mu, mu_hat = (whole(half[name], s, s) for name in ("mu", "mu_hat"))
    nu, nu_tilde = whole(half["nu"], p - 1, s), whole(half["nu_tilde"], s, p - 1)
    assert all(mu_hat[i][j] == 1 - mu[j][i] for i in range(s) for j in range(s))
    assert all(nu_tilde[i][j] == 1 - nu[j][i] for i in range(s) for j in range(p - 1))
    exact = fast.tables(REALS["float128"])
    for name, table in (("mu", mu), ("mu_hat", mu_hat), ("nu", nu), ("nu_tilde", nu_tilde)):
        for row, mirrored, exact_row in zip(table, table[::-1], exact[name], strict=False):
            assert all(x + y == 1 for x, y in zip(row, mirrored[::-1], strict=True))
            for x, y in zip(row, exact_row, strict=False):
                assert abs(x - y) <= Fraction(1, 2**(kind.bits - 1)) + Fraction(1, 2**112)


def test_tables_are_halved_where_that_is_less_work_and_time_can_be_reversed():
    double = REALS["double"]
    assert FastTableau(gs.tableau("G-L", 3)).even_odd_tables(double) == {}
    assert set(FastTableau(gs.tableau("G-L", 8)).even_odd_tables(double)) == {
        "mu", "mu_hat", "nu", "nu_tilde"}
    fast = FastTableau(gs.tableau("G-L", 8))
    uneven = [[Fraction(i + 1, j + 9) for j in range(8)] for i in range(8)]
    vars(fast)["scaled_coefficients"] = fast.scaled_coefficients | {"mu": uneven}
    assert fast.even_odd_tables(double) == {}


@pytest.mark.parametrize("tableau", FAMILIES, ids=lambda t: t.name)
def test_stages_continued_by_their_polynomial_are_exact_for_polynomials(tableau):
    """A polynomial of degree s − 1 is continued from the stages to the stages of the next step."""
    centres, s = FastTableau(tableau).centres, tableau.s
    table = FastTableau(tableau).tables(REALS["long-double"])["onward"]
    for degree in range(s):
        values = [c**degree * b for c, b in zip(centres["c"], centres["b"], strict=True)]
        for i in range(s):
            onward = sum(x * y for x, y in zip(table[i], values, strict=True))
            terms = sum(abs(x * y) for x, y in zip(table[i], values, strict=True))
            expected = (1 + centres["c"][i])**degree * centres["b"][i]
            assert abs(onward - expected) <= terms * Fraction(2, 2**64)


@pytest.mark.filterwarnings("ignore:The linearised motion")
@pytest.mark.parametrize("name", OTHERS)
def test_auto_does_every_step_that_newton_can_do(name):
    """Newton takes steps where sweeps fail; where none fails, sweeps, which cost less, do all."""
    step, q, p, parameters = another(name)
    for dt in np.geomspace(0.02, 0.2, 8).tolist():
        run = {"dt": dt, "steps": 40, "parameters": parameters}
        full, fast = (step.integrate(q, p, solver=solver, **run) for solver in ("newton", "auto"))
        try:
            step.integrate(q, p, solver="fixed-point", **run)
            assert fast.report.newton_steps == 0
        except gs.StepFailed:
            assert fast.report.newton_steps > 0
        # In 40 steps two rods multiply the rounding of a step, some eps, by a hundred.
        assert np.abs(fast.q - full.q).max() < 2**10 * np.finfo(float).eps


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@pytest.mark.parametrize(("scheme", "stages", "rep"), [
    ("G-L", 2, "gamma"), ("EMS", None, "gamma")])
def test_largest_step_of_auto_is_not_below_that_of_newton(scheme, stages, rep):
    step = gs.stepper(scheme, stages, rep)
    parameters = TOP.parameters | {rep: gs.gamma(TOP.inertia)}
    largest = {}
    for solver in ("newton", "auto", "fixed-point"):
        for dt in (0.008 * 1.15 ** np.arange(18)).tolist():
            try:
                step.integrate(TOP.q0, TOP.p0, dt=dt, steps=10, parameters=parameters,
                               solver=solver)
            except gs.StepFailed:
                break
            largest[solver] = dt
    assert largest["auto"] >= largest["newton"] > largest["fixed-point"]


def test_angles_of_any_size_have_the_sines_of_newton():
    """Lanes take sines from polynomials, beyond 1e6 quarters of a turn from <math.h>, as Newton
    does."""
    step = systems.stepper("tilted")
    angles = np.array([0.0, 0.7, -2.4, 31.5, -800.0, 1e5, -1.5e6, 1.6e6, 3e9, -1e16])[:, None]
    dt, steps = 0.01, 3

    def members(x):
        return step.integrate_ensemble(x, np.zeros_like(x), dt=dt, steps=steps, workers=1).members

    for angle, member in zip(angles, members(angles), strict=True):
        (single,) = members(angle[None])  # neighbouring lanes change no bit
        assert single.p.tobytes() == member.p.tobytes()
        single = step.integrate(angle, np.zeros(1), dt=dt, steps=steps)
        newton = step.integrate(angle, np.zeros(1), dt=dt, steps=steps, solver="newton")
        # increments of 1e16 are coarser than the change of a step
        assert single.report.newton_steps == 0 or np.abs(angle) > 1e15
        # forces up to 1.2, of angles that are rounded in each step
        size = dt * steps * (np.spacing(4.0) + np.spacing(abs(angle[0])))
        for run in (single, member):
            assert np.abs(run.p[-1] - newton.p[-1]).max() < 4 * size, angle


def test_hopeless_sweeps_hand_over_to_newton_and_say_so():
    step, q, p, parameters = another("two_rods")
    run = {"dt": 0.2, "steps": 30, "parameters": parameters}
    with pytest.raises(gs.StepFailed, match="diverged"):
        step.integrate(q, p, solver="fixed-point", **run)
    trajectory = step.integrate(q, p, solver="auto", **run)
    assert trajectory.report.newton_steps > 0
    assert step.integrate(q, p, solver="newton", **run).report.newton_steps == 0


@pytest.mark.parametrize(("dt", "most"), [(1e-4, 2), (1e-3, 3), (5e-3, 4)])
def test_newton_stops_when_the_next_increment_is_round_off(dt, most):
    """Convergence is quadratic: the next size is (size/previous)^2, and no increment is in vain."""
    trajectory = gs.stepper("G-L", 2).integrate(TOP.q0, TOP.p0, dt=dt, steps=100,
                                                parameters=PARAMETERS, solver="newton")
    assert set(trajectory.iterations.tolist()) == {most}
