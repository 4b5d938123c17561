"""A tableau of one's own, end to end: nodes, file, conditions, C, steps, order, refusals."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
import systems
from gyrospark.certificates.observed_order import observed_order
from gyrospark.certificates.verification import verify_stepper
from gyrospark.core.errors import TableauError
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.tableaux.conditions import _bounds, check_tableau, remarks
from gyrospark.generator.tableaux.families import gauss_lobatto, lobatto_iiiab
from gyrospark.generator.tableaux.multipliers import multiplier_condition, multiplier_inverse
from gyrospark.generator.tableaux.tableau import FIELDS
from gyrospark.generator.tableaux.tableau_file import read_tableau
from gyrospark.studies.gamma_trials import asymmetric_top
from own_tableaux import FOLDER, in_decimals, make

EXAMPLES = {"gauss_3_2": 4, "lobatto_iiid_3": 4, "radau_iia_2": 3, "radau_plain_2": 3}
TOP = gs.problems.fast_top()
BODY = asymmetric_top((1.0, 1.7, 0.6), 0.2, 0.9, [0.9, -1.4, 1.1])
PARAMETERS = TOP.parameters | {"gamma": gs.gamma(TOP.inertia)}


@cache
def stepper_of(name: str) -> gs.Stepper:
    return gs.stepper(tableau=FOLDER / f"{name}.json")


@pytest.mark.parametrize("name", [
    "gl2", "gl02", "liiiab3", "radaul2", "ims", "ems", "gl2_energy", "splitting4", "gl2_frame",
    "gl2_float", "ims_long_double", "gl2_energy_frame_float128"])
def test_a_name_of_a_scheme_is_refused(name):
    """Its files would have the names of the scheme's: heavy_top_gl2_gamma.c."""
    own = gs.tableau(A=[["1/2"]], b=[1], name=name)
    with pytest.raises(TableauError, match=name):
        generate(Spec.of_tableau("gamma", "free_body"), tableau=own)


def test_a_tableau_of_a_scheme_keeps_its_name():
    """Beside names that only begin as a scheme's do."""
    for own, part in ((gs.tableau("G-L", 1), "gl1"),
                      (gs.tableau(A=[["1/2"]], b=[1], name="gl1_mine"), "gl1_mine")):
        source = generate(Spec.of_tableau("gamma", "free_body"), tableau=own).source
        assert part in source.name


@pytest.fixture
def written(tmp_path: Path) -> Any:
    """Write a table as a file; return its path."""

    def write(table: dict[str, Any], **changes: Any) -> Path:
        path = tmp_path / f"{table['name']}.json"
        path.write_text(make().text(table | changes), encoding="utf-8")
        return path

    return write


def on_nodes(name: str, c: list[Any], c_tilde: list[Any]) -> dict[str, Any]:
    """Return the symplectic tableau on these nodes without a claim."""
    table = make().collocation(name, *([sp.sympify(x) for x in nodes] for nodes in (c, c_tilde)), 1)
    return {key: value for key, value in table.items() if key != "order"}


def failed(path: Path) -> list[str]:
    return [line.name for line in check_tableau(read_tableau(path)) if not line.holds]


# ---------------------------------------------------------------- the examples


def test_examples_and_families_are_what_the_script_derives(tmp_path: Path, written: Any) -> None:
    """The script's Gauss-Lobatto and Lobatto IIIA-B equal the generator's, solved another way."""
    make().main(tmp_path)
    assert {path.stem for path in tmp_path.iterdir()} == EXAMPLES.keys()
    for path in tmp_path.iterdir():
        assert (FOLDER / path.name).read_text(encoding="utf-8") == path.read_text(encoding="utf-8")
    script = make()
    for s, family in ((2, gauss_lobatto(2)), (3, gauss_lobatto(3)), (3, lobatto_iiiab(3))):
        stages = script.lobatto_nodes(s) if family.p == s - 1 else script.gauss_nodes(s)
        tableau = read_tableau(written(on_nodes("own", stages, script.lobatto_nodes(family.p + 1))))
        for key in FIELDS:
            a, b = (np.array(getattr(t.numeric(30), key), dtype=float) for t in (tableau, family))
            assert np.abs(a - b).max() <= 2.0**-52, key


@pytest.mark.slow  # what is derived is verified and compiled, each example by itself
@pytest.mark.parametrize("name", EXAMPLES)
def test_compiled_order_and_constraints(name: str) -> None:
    """Compiled steps of an asymmetric top have the derived order, constraints at round-off."""
    assert verify_stepper(Spec.from_arguments(tableau=FOLDER / f"{name}.json")).holds
    step, body = stepper_of(name), BODY
    parameters = body.parameters | {"gamma": 1.0}
    exact = gs.stepper("G-L", 8).integrate(body.q0, body.p0, dt=0.01, steps=200,
                                           parameters=parameters).q[-1]
    errors = []
    for steps in (50, 100, 200):
        run = step.integrate(body.q0, body.p0, dt=2 / steps, steps=steps, parameters=parameters)
        errors.append(np.abs(run.q[-1] - exact).max())
        assert run.report.constraint_max < 4 * 2.0**-52
        assert run.report.momentum_constraint_max < 4 * 2.0**-52 * np.linalg.norm(body.p0)
    assert np.log2(errors[-2] / errors[-1]) == pytest.approx(step.order, abs=0.1)


def test_the_energy_of_a_symplectic_tableau_stays() -> None:
    """Energy stays by Radau IIA with its symplectic partner, and decays by Radau IIA alone."""
    run = stepper_of("radau_iia_2").integrate(TOP.q0, TOP.p0, dt=1e-3, steps=2000,
                                              parameters=PARAMETERS)
    errors = np.abs(run.energies - run.energies[0])
    assert errors[1500:].max() == pytest.approx(errors[:500].max(), rel=0.02)


def test_solvers_agree() -> None:
    for solver in ("newton", "fixed-point"):
        ends = [stepper_of("radau_iia_2").integrate(
            TOP.q0, TOP.p0, dt=1e-3, steps=20, parameters=PARAMETERS, solver=kind).q[-1]
            for kind in ("auto", solver)]
        assert ends[0] == pytest.approx(ends[1], abs=64 * 2.0**-52)


# ---------------------------------------------------------------- off the families


CASES = {
    # name: stage nodes, constraint nodes, order
    "s1": (["1/3"], [0, 1], 1),
    "fewer_constraints": (["1/2 - sqrt(15)/10", "1/2", "1/2 + sqrt(15)/10"], [0, 1], 2),
    "outside": (["-1/5", "3/5"], [0, "1/2", 1], 2),
}


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name == "fewer_constraints")) for name in CASES])
def test_other_nodes(name: str, written: Any) -> None:
    c, c_tilde, order = CASES[name]
    path = written(on_nodes(name, c, c_tilde))
    tableau = read_tableau(path)
    assert failed(path) == []
    assert tableau.order == order
    assert observed_order(tableau) == pytest.approx(order, abs=0.1)


@pytest.mark.slow  # an order is measured in many digits
def test_an_order_that_decimals_hide_is_not_measured(tmp_path: Path) -> None:
    """A tableau passes unmeasured where the rounding of its digits hides the claimed order."""
    family, path = gauss_lobatto(3), tmp_path / "rounded.json"
    table = {"name": "rounded"} | {key: getattr(family, key) for key in FIELDS}
    path.write_text(json.dumps(in_decimals(table, 9)), encoding="utf-8")
    assert read_tableau(path).order == 6
    verdict = verify_stepper(Spec.from_arguments(tableau=path))
    assert verdict.holds
    measured = next(line for line in verdict.conditions if line.name == "order, measured")
    assert "9 digits" in measured.found
    assert measured.residual == "not measured"


def triple_jump() -> dict[str, Any]:
    """Return Yoshida's composition of three 1-stage steps, order 4; 2^(1/3) in 40 decimals."""
    first = 1 / (2 - sp.root(2, 3))
    b = [first, 1 - 2 * first, first]
    ends = [sum(b[:k], sp.Integer(0)) for k in range(4)]
    b_tilde = [(x + y) / 2 for x, y in zip([0, *b], [*b, 0], strict=True)]
    zero = sp.Integer(0)
    return in_decimals({
        "name": "triple_jump", "order": 4, "symmetric": True, "symplectic": True,
        "A": [[b[j] if j < i else b[i] / 2 if j == i else zero for j in range(3)]
              for i in range(3)],
        "A_tilde": [[b_tilde[j] if j <= i else zero for j in range(4)] for i in range(3)],
        "A_bar": [[b[j] if j < i else zero for j in range(3)] for i in range(4)],
        "b": b, "b_tilde": b_tilde, "c": [x + y / 2 for x, y in zip(ends[:3], b, strict=True)],
        "c_tilde": ends,
    }, 40)


def test_a_symmetric_method_has_an_even_order(tmp_path: Path) -> None:
    """A composition of which C(1) and D(1) prove order 3 is symmetric, and so of order 4."""
    path = tmp_path / "triple_jump.json"
    path.write_text(json.dumps(triple_jump()), encoding="utf-8")
    tableau = read_tableau(path)
    assert min(bound for bound, _ in _bounds(tableau)) == 3
    assert tableau.order == 4
    assert failed(path) == []
    assert observed_order(tableau) == pytest.approx(4, abs=0.1)
    assert remarks(tableau) == []


@pytest.mark.parametrize(("order", "holds"), [(3.98, True), (3.4, False)])
def test_the_measured_order_is_at_least_the_proved_one(
    order: float, holds: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The conditions are sufficient: a higher measured order is no failure, and is reported."""
    monkeypatch.setattr("gyrospark.certificates.verification.observed_order", lambda tableau: order)
    lines = verify_stepper(Spec.from_arguments(tableau=FOLDER / "radau_iia_2.json")).conditions
    measured = next(line for line in lines if line.name == "order, measured")
    assert measured.holds is holds
    assert ("proved" in measured.found) == (order > 3.5)


def zero_weight() -> dict[str, Any]:
    """Return a method of order 1 whose middle stage has b_2 = 0; not symplectic."""
    h = sp.Rational(1, 2)
    table = {
        "A": [[0, 0, 0], [h, 0, 0], [h, 0, h]], "A_hat": [[h, 0, 0], [h, 0, 0], [h, 0, h]],
        "A_tilde": [[h, 0]] * 3, "A_bar": [[0, 0, 0], [h, 0, h]], "b": [h, 0, h],
        "b_tilde": [h, h], "c": [0, h, 1], "c_tilde": [0, 1],
    }  # fmt: skip
    return {"name": "zero_weight"} | {
        key: [[*map(sp.sympify, row)] if isinstance(row, list) else sp.sympify(row)
              for row in entries]
        for key, entries in table.items()
    }


def test_a_weight_of_zero_takes_newton(written: Any) -> None:
    """There is no fast path; the remark says so, and the steps keep the constraints.

    So they do for a system of one's own, an ellipse here.
    """
    step = gs.stepper(tableau=written(zero_weight()), system=systems.case("ellipse").system)
    assert step.order == 1
    assert any("b_i is zero" in remark for remark in step.warnings)
    assert any(remark.startswith("not symplectic") for remark in step.warnings)
    x, y = systems.start("ellipse", step)
    run = systems.run("ellipse", step, 50, dt=1e-3)
    assert run.report.constraint_max < 4 * 2.0**-52
    assert np.abs(run.q[-1] - x).max() > 1e-3
    assert np.abs(run.p[-1] - y).max() > 1e-3


# ---------------------------------------------------------------- remarks before a step


SINGULAR = {
    "more constraint intervals than stages":
        (["1/2 - sqrt(3)/6", "1/2 + sqrt(3)/6"], [0, "1/2 - sqrt(5)/10", "1/2 + sqrt(5)/10", 1]),
    "a constraint node without weight": (["1/2 - sqrt(3)/6", "1/2 + sqrt(3)/6"], [0, "1/3", 1]),
}


@pytest.mark.parametrize("nodes", SINGULAR.values(), ids=SINGULAR.keys())
def test_undetermined_multipliers_are_refused(nodes: Any, written: Any) -> None:
    path = written(on_nodes("singular", *nodes))
    assert failed(path) == ["multipliers"]
    assert multiplier_inverse(read_tableau(path)) is None
    with pytest.raises(TableauError, match=r"multipliers \(det M ≠ 0"):
        gs.stepper(tableau=path)


def test_undetermined_multipliers_matter_with_constraints_alone(written: Any) -> None:
    path = written(on_nodes("singular", *SINGULAR["a constraint node without weight"]))
    broken = {line.name: line
              for line in verify_stepper(Spec.from_arguments(tableau=path)).conditions
              if not line.holds}
    assert broken.keys() == {"multipliers", "order, measured"}
    assert "singular" in broken["order, measured"].found
    path = written(on_nodes("singular", *SINGULAR["a constraint node without weight"]))
    spring = systems.case("oscillator").system
    assert generate(Spec.from_arguments(tableau=path),
                    system=spring).source.name == "oscillator_singular"


@pytest.mark.parametrize("s", [1, 10])
def test_multipliers_of_the_families_are_determined(s: int) -> None:
    assert 1 <= multiplier_condition(gauss_lobatto(s)) < 1e5


def test_several_violations_are_all_named(written: Any) -> None:
    table = on_nodes("bent", ["1/3", 1], [0, "1/2", 1])
    table["A_bar"][0][0], table["A_bar"][-1] = sp.Rational(1, 9), [sp.Rational(1, 2)] * 2
    with pytest.raises(TableauError, match=r"ā_0j = 0 \(.*; residual 0\.111.*ā_pj = b_j \("):
        gs.stepper(tableau=written(table))


def test_remarks_name_what_limits_the_order_in_manifests_of_given_tableaux_only() -> None:
    limited, = remarks(read_tableau(FOLDER / "gauss_3_2.json"))
    assert re.search(r"order 4 .*order 6.* B̃, C̃\(1\)", limited)
    assert remarks(read_tableau(FOLDER / "lobatto_iiid_3.json")) == []
    plain = remarks(read_tableau(FOLDER / "radau_plain_2.json"))
    assert re.search(r"symplectic.*b_i â_ij \+ b̂_j a_ji = b_i b̂_j; residual 0\.", plain[0])
    assert plain[1].startswith("not symmetric")
    path = FOLDER / "radau_plain_2.json"
    about = json.loads(generate(Spec.from_arguments(tableau=path)).source.manifest)["tableau"]
    assert about["remarks"] == remarks(read_tableau(path))
    assert about["conditions"]["symplectic, constraints"]["found"] == "yes"
    family = gs.stepper("G-L", 2)
    assert family.warnings == []
    assert family.manifest.tableau is None


@pytest.mark.parametrize(("claim", "broken"), [
    ({"symplectic": True}, ["symplectic, forces"]), ({"symplectic": False}, []),
    ({}, ["symplectic, forces"]), ({"symplectic": False, "symmetric": True}, ["symmetric"]),
])
def test_claims_of_a_method_that_is_not_symplectic(
    claim: dict[str, bool], broken: list[str], tmp_path: Path
) -> None:
    """A false or missing claim to be symplectic fails; a false claim stops any stepper."""
    table = json.loads((FOLDER / "radau_plain_2.json").read_text(encoding="utf-8"))
    del table["symplectic"]
    path = tmp_path / "claims.json"
    path.write_text(json.dumps(table | claim), encoding="utf-8")
    assert failed(path) == broken
    if True in claim.values():
        with pytest.raises(TableauError, match="violates"):
            gs.stepper(tableau=path)
    else:
        assert generate(Spec.from_arguments(tableau=path)).scheme.order == 3


# ---------------------------------------------------------------- any nodes


@settings(max_examples=4)
@given(
    st.lists(st.fractions(0, 1, max_denominator=9), min_size=2, max_size=4, unique=True),
    st.lists(st.fractions("1/9", "8/9", max_denominator=9), max_size=2, unique=True),
)
def test_symplectic_by_construction_or_no_step(c: Any, inner: Any) -> None:
    """Any nodes give a symplectic, consistent tableau, refused if multipliers are undetermined."""
    import tempfile

    nodes, c_tilde = sorted(c), [0, *sorted(inner), 1]
    script = make()
    if 0 in script.weights([sp.Rational(x) for x in nodes], sp.Integer(1)):
        return  # no symplectic partner
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "any.json"
        path.write_text(script.text(on_nodes("any_nodes", nodes, c_tilde)), encoding="utf-8")
        try:
            tableau = read_tableau(path)
        except TableauError as error:
            assert "b_tilde" in str(error)  # noqa: PT017 (on most nodes it is not)
            return
        broken = failed(path)
    if 0 in tableau.b_tilde[:-1] or tableau.p > tableau.s:
        assert "multipliers" in broken
    else:
        assert set(broken) <= {"multipliers"}
        assert tableau.order >= 1
