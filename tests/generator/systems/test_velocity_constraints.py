"""Velocity constraints A(q, t) q̇ + a(q, t) = 0 of a system: coefficients, copies, refusals."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.generator.models.model_file import load_model
from gyrospark.generator.normal_forms.canonical_system import canonical
from gyrospark.generator.schemes.step_equations import hoist_constants
from gyrospark.generator.systems.redundant_constraints import refuse_redundant_anywhere
from gyrospark.generator.systems.smoothness import refuse_kinks

x, y, th, px, py, pt, vx, vy, w, t = sp.symbols("x y th px py pt vx vy w t", real=True)
m, J, d = sp.symbols("m J d", positive=True)
SKATE = sp.cos(th) * vy - sp.sin(th) * vx - d * w


def sleigh(*rows: sp.Expr, **options: object) -> gs.System:
    """Return a Chaplygin sleigh, whose blade, d behind the centre of mass, does not slip."""
    H = (px**2 + py**2) / (2 * m) + pt**2 / 2 / J
    return gs.System((x, y, th), (px, py, pt), (m, J, d), H,
                     **{"velocities": (vx, vy, w), "name": "sleigh",
                        "velocity_constraints": rows or (SKATE,)} | options)


def test_rows_are_linear_or_affine_in_the_velocities_though_not_written_so():
    system = sleigh(SKATE + t * sp.cos(th), time=t)
    assert [[-sp.sin(th), sp.cos(th), -d]] == system.A
    assert system.a == [t * sp.cos(th)]
    assert system.is_time_dependent
    system = sleigh(((vx + 1)**2 - (vx - 1)**2) / 4 + sp.log(sp.exp(w * sp.cos(th))) - 0 * vy)
    assert [sp.simplify(e) for e in system.A[0]] == [1, 0, sp.cos(th)]
    assert system.a == [0]


def test_copies_hash_and_normal_form_carry_them():
    system = sleigh()
    negated = sleigh(-(sp.sin(th) * vx - sp.cos(th) * vy + d * w))
    assert hash(system) == hash(replace(system, quantities={"spin": th}))
    assert hash(system) != hash(sleigh(2 * SKATE))
    assert canonical(negated).velocity_constraints == canonical(system).velocity_constraints
    reduced, constants = hoist_constants(canonical(sleigh(m * d * SKATE)))
    assert m not in set().union(*(e.free_symbols for e in reduced.A[0]))
    assert [sp.expand(constants.expand_shared(e) - m * d * entry)
            for e, entry in zip(reduced.A[0], system.A[0], strict=True)] == [0, 0, 0]


@pytest.mark.parametrize(("rows", "named"), [
    ((vx**2 - vy,), "2*vx"), ((vx * vy,), "linear"), (((vx**2 + vx * vy) / (vx + vy),), "linear"),
    ((x * y,), "'A0'"), ((px * vx,), "'px'"), ((sp.Symbol("z") * vx,), "'z'"),
    ((vx, vy, w), "3 constraints"), ((vx, vy, vx * w), "linear"),
])
def test_refused(rows, named):
    with pytest.raises(InputError, match="'sleigh'") as refused:
        sleigh(*rows)
    assert named in str(refused.value)


@pytest.mark.parametrize("changes", [{"velocities": ()}, {"velocities": (vx, vy)},
                                  {"velocity_constraint_names": ("blade", "wheel")}])
def test_counts_must_agree(changes):
    with pytest.raises(InputError, match="'sleigh'"):
        sleigh(**changes)


def test_rows_that_jump_or_that_a_constraint_implies_are_refused():
    """A blade slipping on one side of x = 0 only is refused; a kink, as of |x|, is no jump."""
    refuse_kinks(sleigh(SKATE + abs(x) * vx))
    with pytest.raises(InputError, match=r"'A0'.*jumps where x"):
        refuse_kinks(sleigh(SKATE + sp.sign(x) * vx))
    around = sleigh(x * vx + y * vy, constraints=(x**2 + y**2 - d**2,))
    with pytest.raises(InputError, match="'A0'"):
        refuse_redundant_anywhere(around)


def test_model_files_and_notebooks_have_them(tmp_path):
    file = tmp_path / "skate.toml"
    file.write_text("""
name = "skate"
[system]
coordinates = ["x", "y", "th"]
momenta = ["px", "py", "pth"]
velocities = ["vx", "vy", "w"]
hamiltonian = "(px**2 + py**2)/2 + pth**2/2"
velocity_constraints = ["cos(th)*vy - sin(th)*vx - d*w"]
velocity_constraint_names = ["blade"]
[parameters]
d = 0.3
[start]
q = [0, 0, 0]
p = [1, 0.3, 1]
""", encoding="utf-8")
    model = load_model(file)
    assert [str(e) for e in model.system.A[0]] == ["-sin(th)", "cos(th)", "-d"]
    assert model.system.velocity_constraint_names == ("blade",)
    text = sleigh(velocity_constraint_names=("blade",))._repr_html_()
    assert "A v + a: blade" in text


@pytest.mark.parametrize(("rows", "named"), [
    ((SKATE, sp.cos(th) * SKATE), "redundant"),
    ((SKATE, sp.cos(th) * SKATE + 1), "contradict"),
])
def test_dependent_rows_are_refused(rows, named):
    with pytest.raises(InputError, match=named):
        refuse_redundant_anywhere(sleigh(*rows))


def test_momenta_are_projected_onto_the_rows():
    """p − Rᵀ(R H_pp Rᵀ)⁻¹(R H_p), R = (g_q, A), agrees with its closed form for one row."""
    system = sleigh(SKATE + sp.Rational(1, 2))
    q, p = np.array([0.1, 0.2, 0.3]), np.array([1.0, 2.0, 3.0])
    values = {"m": 1.0, "J": 1.0, "d": 0.4}
    moved = gs.consistent(system, q, p, parameters=values)
    A = np.array([-np.sin(0.3), np.cos(0.3), -0.4])
    np.testing.assert_allclose(moved.p, p - A * (A @ p + 0.5) / (A @ A), rtol=1e-14)
    assert moved.hidden_before["A0"] == pytest.approx(abs(A @ p + 0.5), rel=1e-14)
    assert moved.hidden_after["A0"] < 1e-15
    assert "A0" in str(moved)
