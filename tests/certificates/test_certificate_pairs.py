"""Right and spoilt: each pair differs by 1e-6, 1e-9 or 1e-12, and both verdicts are known before.

No right method or model is accused, no wrong one praised. In a run, round-off hides an error of
1e-12: there exact algebra decides, and the certificate says that the run cannot show it.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
import sympy as sp

import gyrospark as gs
import systems
from command_line import EXAMPLE
from gyrospark.certificates.guarantees import (
    MeanGuarantees,
    SparkGuarantees,
    SplittingGuarantees,
)
from gyrospark.certificates.momentum_maps import momentum_maps
from gyrospark.certificates.observed_order import observed_order
from gyrospark.core.real_types import REALS
from gyrospark.generator.multibody.rigid_body import body_system, heavy_top, mgl, rotation_matrix
from gyrospark.generator.schemes.fast_tableau import FastTableau
from gyrospark.generator.tableaux.conditions import check_tableau
from gyrospark.generator.tableaux.tableau_file import read_tableau

SIZES = (1e-6, 1e-9, 1e-12)
HOLDS, FAILS, SHOWN, ABSENT = True, False, None, "absent"

x, y, z, px, py, pz = sp.symbols("x y z px py pz", real=True)
k, s, f, h, d, tilt, r = sp.symbols("k s f h d tilt r", real=True)

#: An oscillator: round for k = 1, linear for s = 0; pushed with a gradient for f = h, damped by d.
PLANE = gs.System((x, y), (px, py), (k, s, f, h, d),
                  (px**2 + py**2 + x**2 + k * y**2) / 2 + s * x**4, name="plane",
                  forces=(-f * y - d * px, -h * x - d * py))
#: A spherical pendulum: round for k = 1, upright for tilt = 0, its constraint quadratic for r = 0.
SPHERE = gs.System((x, y, z), (px, py, pz), (k, tilt, r),
                   (px**2 + py**2 + pz**2) / 2 + 9 * z + tilt * x,
                   (x**2 + k * y**2 + z**2 + r * x**4 - 1,), name="sphere")
#: A top: free for mgl = 0, symmetric for I1 = I2.
TOP = heavy_top("gamma")
RIGHT = {"plane": {"k": 1.0, "s": 0.0, "f": 0.25, "h": 0.25, "d": 0.0},
         "sphere": {"k": 1.0, "tilt": 0.0, "r": 0.0},
         TOP.name: {"I1": 1.5, "I2": 1.5, "I3": 0.75, "gamma": 1.0, "mgl": 0.0}}
STARTS = {"plane": ([0.6, -0.3], [0.2, 0.5]), "sphere": ([0.0, 0.6, -0.8], [0.7, 0.4, 0.3]),
          TOP.name: ([0.8, 0.6, 0.0, 0.0], [0.06, -0.08, 0.2, 0.3])}
ROUND = RIGHT["plane"] | {"f": 0.0, "h": 0.0}


def verdict(certificate: Any, quantity: str) -> Any:
    """Return the verdict of a line, ABSENT without one."""
    return next((line.holds for line in certificate.lines if line.quantity.startswith(quantity)),
                ABSENT)


@dataclass(frozen=True)
class Pair:
    """A model by its parameters, one of which is off by a given size; two verdicts on a line."""

    system: gs.System
    scheme: str
    quantity: str
    right: dict[str, float]
    changed: str
    verdicts: tuple[Any, Any]


LOOP, ENERGY, TURN, VERTICAL = "loop", "energy", "angular momentum", "angular momentum about e3"
PUSHED, LEVEL, FREE = RIGHT["plane"], RIGHT["sphere"], RIGHT[TOP.name]
MODELS = {
    "a linear oscillator keeps its energy with IMS":
        Pair(PLANE, "IMS", ENERGY, ROUND, "s", (HOLDS, SHOWN)),
    "a linear oscillator keeps its energy with G-L":
        Pair(PLANE, "G-L", ENERGY, ROUND, "s", (HOLDS, SHOWN)),
    "a linear oscillator or not, EMS keeps its energy":
        Pair(PLANE, "EMS", ENERGY, ROUND, "s", (HOLDS, HOLDS)),
    "EMS is the midpoint rule on a linear oscillator, and so symplectic":
        Pair(PLANE, "EMS", LOOP, ROUND, "s", (HOLDS, SHOWN)),
    "G-L is symplectic on any oscillator":
        Pair(PLANE, "G-L", LOOP, ROUND, "s", (HOLDS, HOLDS)),
    "a round oscillator keeps its angular momentum":
        Pair(PLANE, "G-L", TURN, ROUND, "k", (HOLDS, SHOWN)),
    "a round oscillator keeps its angular momentum with EMS":
        Pair(PLANE, "EMS", TURN, ROUND, "k", (HOLDS, SHOWN)),
    "IMS is symplectic without constraints":
        Pair(PLANE, "IMS", LOOP, ROUND, "s", (HOLDS, HOLDS)),
    "a push that is a gradient is symplectic":
        Pair(PLANE, "G-L", LOOP, PUSHED, "f", (HOLDS, SHOWN)),
    "a push that is a gradient is symplectic with IMS":
        Pair(PLANE, "IMS", LOOP, PUSHED, "h", (HOLDS, SHOWN)),
    "damping is no gradient":
        Pair(PLANE, "G-L", LOOP, ROUND, "d", (HOLDS, SHOWN)),
    "a damped run is still in balance with EMS":
        Pair(PLANE, "EMS", ENERGY, ROUND, "d", (HOLDS, HOLDS)),
    "a round sphere keeps the angular momentum about the vertical":
        Pair(SPHERE, "G-L", VERTICAL, LEVEL, "k", (HOLDS, SHOWN)),
    "upright gravity keeps the angular momentum about e3":
        Pair(SPHERE, "G-L", VERTICAL, LEVEL, "tilt", (HOLDS, ABSENT)),
    "gravity of any direction keeps the angular momentum about that":
        Pair(SPHERE, "G-L", TURN, LEVEL, "tilt", (HOLDS, HOLDS)),
    "a quadratic constraint does no work in IMS":
        Pair(SPHERE, "IMS", ENERGY, LEVEL, "r", (HOLDS, SHOWN)),
    "a constraint of any kind keeps G-L symplectic":
        Pair(SPHERE, "G-L", LOOP, LEVEL, "r", (HOLDS, HOLDS)),
    "a constraint that is not round takes IMS's angular momentum":
        Pair(SPHERE, "IMS", VERTICAL, LEVEL, "r", (HOLDS, SHOWN)),
    "flows and a kick that is a gradient are symplectic":
        Pair(PLANE, "splitting", LOOP, PUSHED, "f", (HOLDS, SHOWN)),
    "a free symmetric top is one exact flow":
        Pair(TOP, "splitting", ENERGY, FREE, "mgl", (HOLDS, SHOWN)),
    "a free asymmetric top is more than one exact flow":
        Pair(TOP, "splitting", ENERGY, FREE, "I2", (HOLDS, SHOWN)),
    "each flow of a free top keeps the angular momentum in space":
        Pair(TOP, "splitting", TURN + " about e1", FREE, "I2", (HOLDS, HOLDS)),
}


#: Pairs that are run and certified, one with each scheme; the others are decided in algebra alone.
CERTIFIED = ("a push that is a gradient is symplectic",
             "a round oscillator keeps its angular momentum")


def promised(pair: Pair, values: dict[str, float]) -> Any:
    """Return the verdict of exact algebra on a pair at some parameters."""
    numbers = {s: sp.Rational(values[str(s)]) for s in pair.system.parameters}
    if pair.scheme == "G-L":
        promises: Any = SparkGuarantees(pair.system, numbers, gs.tableau("G-L", 2))
    elif pair.scheme == "splitting":
        promises = SplittingGuarantees(pair.system, numbers, 2)
    else:
        promises = MeanGuarantees(pair.system, numbers, pair.scheme, 2)
    if pair.quantity.startswith(TURN):
        J = next((J for J in momentum_maps(pair.system, values, *STARTS[pair.system.name])
                  if J.name.startswith(pair.quantity)), None)
        if J is None:
            return ABSENT
        guarantee = promises.momentum(J)
    else:
        guarantee = {LOOP: promises.loop, ENERGY: promises.energy}[pair.quantity]()
    assert not guarantee.refuted
    return HOLDS if guarantee.guaranteed else SHOWN


@pytest.mark.parametrize("name", MODELS)
def test_models(name: str) -> None:
    pair = MODELS[name]
    assert promised(pair, pair.right) is pair.verdicts[0]
    for size in SIZES:
        values = pair.right | {pair.changed: pair.right[pair.changed] + size}
        assert promised(pair, values) is pair.verdicts[1], size
    if name not in CERTIFIED:
        return
    stages = 2 if pair.scheme == "G-L" else None
    for error, expected in ((0.0, pair.verdicts[0]), (SIZES[2], pair.verdicts[1])):
        values = pair.right | {pair.changed: pair.right[pair.changed] + error}
        model = gs.Model(pair.system, values, *STARTS[pair.system.name], dt=0.02, steps=100)
        certificate = gs.certify(model, pair.scheme, stages)
        assert verdict(certificate, pair.quantity) is expected
        assert certificate.holds  # the method does what it promises of that model as well


@pytest.mark.parametrize("variable", ["q", "p"])
def test_starts_off_the_constraints_are_moved_there(variable: str) -> None:
    """A move by 1e-12 is silent, a larger one has a warning."""
    case, step = systems.case("pendulum"), systems.stepper("pendulum")
    q, p = step.project(case.q, [0.5, 1.0], parameters=case.parameters)
    for size in (SIZES[2], 1e-3):
        (q if variable == "q" else p)[1] += size
        model = gs.Model(case.system, case.parameters, q, p, dt=0.02, steps=10)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            assert gs.certify(model, "G-L", 2).holds
        assert bool(caught) is (size == 1e-3)


@pytest.mark.parametrize(("method", "why"), [
    ({"scheme": "G-L", "stages": 2}, "{J, H} = 0 (expanded)"),
    ({"order": 4}, "{J, ·} = 0 with each part of H")], ids=["G-L", "splitting"])
def test_nearly_symmetric_tops(method: Any, why: str) -> None:
    """I₂ = I₁ (1 + 1e-15) breaks the map about the figure axis, not the one about the vertical."""
    top = gs.problems.fast_top()
    moments = {"I2": top.parameters["I1"] * (1 + 1e-15)}
    certificate = gs.certify(top, **method, steps=50, parameters=moments)
    assert certificate.holds
    assert verdict(certificate, VERTICAL) is HOLDS
    assert certificate.line(VERTICAL).why == why
    figure = next(line for line in certificate.lines if "body's axis 3" in line.quantity)
    assert figure.holds is SHOWN  # as far as it is near
    assert "a near symmetry" in figure.why


@pytest.mark.parametrize("size", [1e-6, 1e-15])
def test_tilted_potentials(size: float) -> None:
    """Gravity along (size, 0, 1) conserves the angular momentum about this axis, for any size."""
    q = sp.symbols("q0:4", real=True)
    R = rotation_matrix(q)
    system = body_system("tilted", "gamma", mgl * (R[2, 2] + tilt * R[0, 2]), (mgl, tilt))
    parameters = {"I1": 1.0, "I2": 2.0, "I3": 2.5, "mgl": 0.7, "gamma": 1.8, "tilt": size}
    (J,) = momentum_maps(system, parameters, [0.8, 0.6, 0, 0], [0.06, -0.08, 0.2, 0.3])
    assert J.name == f"angular momentum about ({size:.6g}, 0, 1)"
    assert J.everywhere
    assert J.proof == "expanded"
    exact = sp.Rational(size)
    e1, e3 = (J.J.coeff(system.p[i]).coeff(q[0]) for i in (1, 3))
    assert abs(e1 / e3) == exact


def spoilt(size: float, *places: tuple[str, int, int], sign: int = 1) -> dict[str, Any]:
    """Return Gauss-Lobatto 2 with a fraction added to some entries, and no claims."""
    table = json.loads(EXAMPLE.read_text(encoding="utf-8"))
    table = {key: entries for key, entries in table.items() if key not in ("order", "symmetric")}
    table = {"A_hat": table["A"], "b_hat": table["b"]} | json.loads(json.dumps(table))
    for key, i, j in places:
        entries = table[key] = json.loads(json.dumps(table[key]))
        row = entries if j < 0 else entries[i]
        column = i if j < 0 else j
        row[column] = f"{row[column]} + {sign * Fraction(size).limit_denominator(10**15)}"
    return table


@pytest.fixture
def read(tmp_path: Path) -> Callable[..., Any]:
    """Return the tableau of a table."""

    def tableau(table: dict[str, Any], **changes: Any) -> Any:
        path = tmp_path / "table.json"
        path.write_text(json.dumps(table | changes), encoding="utf-8")
        return read_tableau(path)

    return tableau


def guarantees(tableau: Any, system: gs.System = PLANE, values: Any = None) -> SparkGuarantees:
    values = values or {"plane": ROUND, "sphere": LEVEL}[system.name]
    return SparkGuarantees(system, {s: sp.Rational(values[str(s)]) for s in system.parameters},
                           tableau)


def turning(system: gs.System = PLANE) -> Any:
    """Return the angular momentum of a system."""
    values = {"plane": ROUND, "sphere": LEVEL}[system.name]
    return next(J for J in momentum_maps(system, values, *STARTS[system.name])
                if J.name.startswith(TURN))


@pytest.mark.parametrize("size", SIZES)
def test_a_tableau_spoilt_in_one_matrix(read: Callable[..., Any], size: float) -> None:
    """With Â spoilt: not symplectic, no angular momentum, no quadratic energy, not symmetric."""
    right, wrong = (guarantees(read(spoilt(e, ("A_hat", 0, 0)))) for e in (0, size))
    assert right.loop().guaranteed
    assert not right.loop().refuted
    assert f"off by {size / 2:.0e}".replace("e-0", "e-") in wrong.loop().refuted.replace(".0e", "e")
    assert not right.momentum(turning()).refuted
    assert wrong.momentum(turning()).refuted
    assert right.energy().guaranteed
    assert not wrong.energy().guaranteed
    assert right.symmetric
    assert not wrong.symmetric


@pytest.mark.parametrize("size", SIZES)
def test_a_tableau_spoilt_in_its_constraints(read: Callable[..., Any], size: float) -> None:
    """With Ã spoilt: not symplectic with constraints; without them no property is refuted."""
    wrong = read(spoilt(size, ("A_tilde", 0, 0), ("A_tilde", 1, 0)))
    assert guarantees(wrong, SPHERE).loop().refuted
    assert guarantees(wrong, SPHERE).momentum(turning(SPHERE)).refuted
    assert not guarantees(wrong, PLANE).loop().refuted
    assert guarantees(wrong, PLANE).energy().guaranteed


@pytest.mark.parametrize("size", SIZES)
def test_a_partitioned_tableau_is_still_symplectic(read: Callable[..., Any], size: float) -> None:
    """With a_11 up and â_11 down, bilinear invariants stay and quadratic ones do not."""
    table = spoilt(size, ("A", 0, 0))
    table["A_hat"] = spoilt(size, ("A_hat", 0, 0), sign=-1)["A_hat"]
    wrong = guarantees(read(table))
    assert wrong.loop().guaranteed
    assert not wrong.loop().refuted
    assert not wrong.momentum(turning()).refuted
    assert not wrong.energy().guaranteed
    assert "b_i a_ij" in wrong.energy().why


@pytest.mark.parametrize("size", SIZES)
def test_linear_momenta_are_kept_by_any_tableau(read: Callable[..., Any], size: float) -> None:
    """A method that is not symplectic is not accused of losing an invariant of every method."""
    system = gs.System((x, y), (px, py), (), (px**2 + py**2) / 2 - sp.cos(y), name="sliding")
    (J,) = momentum_maps(system, {}, [0.1, 0.2], [0.3, 0.4])
    assert J.name == "momentum px"
    for error in (0, size):
        guarantee = SparkGuarantees(system, {}, read(spoilt(error, ("A_hat", 0, 0)))).momentum(J)
        assert guarantee.guaranteed
        assert not guarantee.refuted


def test_weights_and_nodes(read: Callable[..., Any]) -> None:
    """Two kinds of weights are not symplectic; wrong nodes alone are not symmetric in time."""
    right = guarantees(read(spoilt(0)))
    assert right.symmetric
    assert not right.loop().refuted
    for size in SIZES:
        assert guarantees(read(spoilt(size, ("b_hat", 0, -1)))).loop().refuted
        assert not guarantees(read(spoilt(size, ("c", 0, -1)))).symmetric


@pytest.mark.parametrize("size", SIZES)
def test_claims(read: Callable[..., Any], size: float) -> None:
    """Claims of a file, order, symmetry and symplecticity, are refuted one by one."""
    claims = {"order": 4, "symmetric": True, "symplectic": True}
    right = read(spoilt(0), **claims)
    assert all(line.holds for line in check_tableau(right))
    wrong = read(spoilt(size, ("A_hat", 0, 0)), **claims)
    failed = {line.name for line in check_tableau(wrong) if not line.holds}
    assert failed == {"order", "symmetric", "symplectic, forces"}
    assert wrong.order == 1


def test_order_is_measured_in_steps_short_enough(read: Callable[..., Any]) -> None:
    """An error of 1e-12 in one coefficient shows in steps of 1e-10."""
    tableau = read(spoilt(SIZES[2], ("A_hat", 0, 0)))
    assert tableau.order == 1
    assert observed_order(tableau) == pytest.approx(1, abs=0.1)


def decimals(digits: int, size: float = 0.0) -> dict[str, Any]:
    """Return Gauss-Lobatto 2 in decimals, with an error in â_11."""
    exact = gs.tableau("G-L", stages=2)

    def text(number: sp.Expr) -> str:
        return str(sp.N(number, 40).round(digits))

    table: dict[str, Any] = {"name": "rounded"}
    for key in ("A", "A_hat", "A_tilde", "A_bar"):
        table[key] = [[text(e) for e in row] for row in getattr(exact, key)]
    for key in ("b", "b_tilde", "c"):
        table[key] = [text(e) for e in getattr(exact, key)]
    table["A_hat"][0][0] = text(exact.A_hat[0][0] + sp.Rational(size))
    return table


@pytest.mark.parametrize("size", SIZES)
def test_tableaux_in_decimals(read: Callable[..., Any], size: float) -> None:
    """To 16 digits the rounded tableau is symplectic, and the spoilt one is not.

    To 12 digits an error of 1e-12 is a rounding; the verdict then is about 12 digits.
    """
    right, wrong = read(decimals(16)), read(decimals(16, size))
    assert "16 digits" in guarantees(right).loop().why
    assert not guarantees(right).loop().refuted
    assert {line.residual for line in check_tableau(right)} == {"0 to 16 digits"}
    assert guarantees(wrong).loop().refuted
    coarse = guarantees(read(decimals(12, size))).loop()
    assert bool(coarse.refuted) == (size > 1e-12)
    assert "12 digits" in coarse.why


def test_the_order_of_decimals_is_measured_in_steps_whose_errors_exceed_their_rounding(
        read: Callable[..., Any]) -> None:
    assert observed_order(read(decimals(12))) == pytest.approx(4, abs=0.1)


def test_the_fast_path_of_decimals_is_symplectic_to_the_bit(read: Callable[..., Any]) -> None:
    """Rounded pairs add up to 1, though those of decimals do not; a late first node has none."""
    double = REALS["double"]
    rounded, exact = FastTableau(read(decimals(16))), FastTableau(gs.tableau("G-L", 2))
    assert rounded.refusal is None
    assert rounded.is_symplectic(double)
    for name in ("mu", "mu_hat", "nu", "nu_tilde", "inverse"):
        for row, exact_row in zip(*(x.tables(double)[name] for x in (rounded, exact)), strict=True):
            for entry, exact_entry in zip(row, exact_row, strict=True):
                assert abs(entry - exact_entry) < 1e-14 * max(1, abs(exact_entry)), name
    assert "first" in str(FastTableau(read(decimals(16) | {
        "A_bar": [["0.1", "0.1"], ["0.5", "0"], ["0.5", "0.5"]]})).refusal)


@pytest.mark.slow  # a stepper of one tableau
def test_a_compiled_tableau(tmp_path: Path) -> None:
    """Exact algebra refutes 1e-12, and the line says that no run measures it."""
    path = tmp_path / "table.json"
    path.write_text(json.dumps(spoilt(SIZES[2], ("A_hat", 0, 0))), encoding="utf-8")
    certificate = gs.certify(gs.Model(PLANE, ROUND, *STARTS["plane"], dt=0.02, steps=100),
                             tableau=path, allow_invalid=True)
    loop = certificate.line(LOOP)
    assert certificate.holds is loop.holds is certificate.line(TURN).holds is False
    assert certificate.line(ENERGY).holds is certificate.line("reversal").holds is SHOWN
    assert "exact" in loop.why
    assert "b_i â_ij" in loop.why
    assert loop.value <= loop.bound
    assert "round-off" in loop.found


def test_a_central_force_with_ems() -> None:
    """D of 1/r turns as the gradient does, of 1/√(x² + k y²) it does not."""
    system = gs.System((x, y), (px, py), (k,),
                       (px**2 + py**2) / 2 - 1 / sp.sqrt(x**2 + k * y**2), name="centre")
    for value, is_invariant in ((1.0, True), (1 + SIZES[2], False)):
        (J,) = momentum_maps(system, {"k": value}, [1.0, 0.2], [0.1, 1.0])
        means = MeanGuarantees(system, {k: sp.Rational(value)}, "EMS", 2)
        assert means.momentum(J).guaranteed is is_invariant
        assert means.energy().guaranteed
        assert not means.energy().refuted
        assert not means.loop().guaranteed


def test_momentum_constraints_that_are_not_linear_are_not_promised() -> None:
    system = systems.case("relativistic").system
    numbers = {x: sp.Integer(1) for x in system.parameters}
    assert not MeanGuarantees(system, numbers, "EMS", 2).momentum_constraint().guaranteed


def test_constraints_that_turn_into_one_another_with_ems() -> None:
    """G-L keeps the momentum of two joined points; of EMS algebra does not see it."""
    system = gs.System((x, y, z, s), (px, py, pz, d), (k,), (px**2 + py**2 + pz**2 + d**2) / 2
                       + k * (x**2 + y**2 + z**2 + s**2), (x - z, y - s), name="joined")
    (J,) = momentum_maps(system, {"k": 1.5}, [0.6, -0.3, 0.6, -0.3], [0.2, 0.5, 0.2, 0.5])
    numbers = {k: sp.Rational(3, 2)}
    assert SparkGuarantees(system, numbers, gs.tableau("G-L", 2)).momentum(J).guaranteed
    assert not MeanGuarantees(system, numbers, "EMS", 2).momentum(J).guaranteed
