"""System: refusals, derivatives, the hidden constraint; constants of a run."""

import dataclasses
import re

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy.physics.units import kilogram

import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.generator.kernels.kernel import Constants
from gyrospark.generator.multibody.rigid_body import free_body, heavy_top
from gyrospark.generator.schemes.step_equations import common_kernels, hoist_constants
from gyrospark.generator.systems.jacobians import gradient, jacobian, shortest, symmetric_jacobian
from gyrospark.generator.systems.system import System

q = sp.symbols("x y z", real=True)
p = sp.symbols("px py pz", real=True)
m, c = sp.symbols("m c", positive=True)
grav = sp.Symbol("g", real=True)
x, y, z = q
px, py, pz = p


def system(**changes):
    """Return a spherical pendulum, with changes."""
    arguments = {
        "name": "pendulum", "q": q, "p": p, "parameters": (m, grav),
        "H": (px**2 + py**2 + pz**2) / (2 * m) + m * grav * z,
        "constraints": (x**2 + y**2 + z**2 - 1,),
    }
    return System(**(arguments | changes))


@pytest.mark.parametrize(("changes", "message"), [
    *(({"name": name}, f"{name!r}.*identifier")
      for name in ("", "two words", "1body", "kreisel-α", "γ", "a-b")),
    ({"p": p[:2]}, "3 coordinates.*2 momenta"), ({"q": q[:1]}, "1 coordinate .*3 momenta"),
    ({"q": (), "p": ()}, "0 coordinates.*0 momenta"),
    ({"constraints": (x - 1, y, z)}, "3 constraints.*3 coordinates"),
    ({"constraints": (x,) * 4}, "3 .*4.*redundant"),
    ({"parameters": (m, grav, m)}, "'m'.*twice"), ({"parameters": (m, grav, x)}, "'x'.*twice"),
    ({"q": (x, x, z)}, "'x'.*twice"),
    ({"p": (px, py, sp.Symbol("x"))}, "'x'.*twice"),  # another symbol, the same name
    ({"H": px**2 / m + c * x}, "'pendulum'.*unknown symbol 'c'"),
    # the first of several, whatever the hash seed
    ({"H": px * sp.Symbol("B") + sp.Symbol("A") + sp.Symbol("C")}, "unknown symbol 'A'"),
    ({"H": px**2 / sp.Symbol("m")}, "'m'.*other assumptions"),
    ({"constraints": (sp.Symbol("x"),)}, "'x'.*other assumptions"),
    # SymPy simplifies by these: √a² is −a, cos(2 π a) is 1, and no run checks a
    *(({"parameters": (m, grav, sp.Symbol("a", **{name: True}))}, f"'a'.*{name}=True.*positive")
      for name in ("negative", "nonnegative", "nonpositive", "integer", "rational", "imaginary",
                   "infinite")),
    ({"parameters": (m, grav, sp.Symbol("a", commutative=False))}, "'a'.*commutative=False"),
    ({"q": (sp.Symbol("x", negative=True), y, z)}, "'x'.*negative=True"),
    ({"time": sp.Symbol("t", integer=True)}, "'t'.*integer=True"),
    *(({key: set(symbols)}, f"{key} =.*order.*list")  # a set has no order
      for key, symbols in (("q", q), ("p", p), ("parameters", (m, grav)))),
    *(({"quantities": {name: z}}, f"{name!r}.*another name") for name in ("x", "pz", "g")),
    *(({"H": px**2 / m + e * x}, message) for e, message in (
        (sp.asin(2), "not real"), (sp.Integer(-8) ** sp.Rational(1, 3), "not real"),
        (sp.Integral(c**2, (c, 0, 1)), "doit"), (sp.Sum(x**c, (c, 0, 3)), "doit"),
        (sp.Product(x + c, (c, 0, 3)), "doit"), (sp.Subs(sp.sin(c), c, x), "doit"),
        (sp.Limit(sp.sin(c) / c, c, 0), "doit"), (sp.CRootOf(c**5 - c - 1, 0), "evalf"),
        (kilogram, "kilogram.*number"), (kilogram * x / 2, "kilogram.*number"),
        (sp.Piecewise((1, sp.Contains(x, sp.Interval(0, 1))), (0, True)), "understood"))),
    ({"forces": (x, c, 0)}, "Force 1.*'pendulum'.*'c'"),
    ({"quantities": {"height": c}}, "'height'.*'pendulum'.*'c'"),
    ({"quantities": {"two words": x}}, "'pendulum'.*'two words'.*letters"),
    ({"constraints": (x, y - c)}, "Constraint 1.*'pendulum'.*'c'.*holonomic"),
    ({"constraints": (x - px,)}, "Constraint 0.*'pendulum'.*'px'.*holonomic"),
    *(({key: value} | further, "symbol")
      for name in ("two words", "I'", "γ", "double", "", "_k", "NAN", "bool", "1st")
      for key, value, further in (
          ("parameters", (m, grav, sp.Symbol(name, real=True)), {}),
          ("q", (sp.Symbol(name, real=True), y, z), {"H": py**2, "constraints": ()}))),
])
def test_what_is_no_system_is_refused(changes, message):
    with pytest.raises(InputError, match=message):
        system(**changes)


@pytest.mark.parametrize(("name", "proposed"), [
    ("ω1", "omega1"), ("é", ""), ("I'", ""), ("_x", ""), ("x 1", "")])
def test_proposed_names_are_names(name, proposed):
    with pytest.raises(InputError) as caught:
        system(parameters=(m, grav, sp.Symbol(name)))
    assert re.findall(r"Symbol\('(.*)'\)", str(caught.value)) == [proposed] * bool(proposed)


@pytest.mark.parametrize("assumptions", [
    {}, {"real": True}, {"positive": True}, {"nonzero": True}, {"real": True, "nonzero": True},
    {"finite": True}])
def test_assumptions_that_runs_check_are_taken(assumptions):
    a = sp.Symbol("a", **assumptions)
    assert system(parameters=(m, grav, a), H=px**2 / m + a * x).parameters[2] == a


def test_keys_of_a_dict_have_an_order():
    assert system(parameters={m: 1.0, grav: 2.0}.keys()).parameters == (m, grav)


@pytest.mark.parametrize(("changes", "message"), [
    ({"parameters": {"m": 1.0, "g": 1.0, "k": 2.0}}, "'k'.*g, m"),
    ({"parameters": {"m": 1.0}}, "'g'"),
    ({"rules": {"m": "m"}}, "'m'"), ({"rules": {"m": "n"}}, "'n'.*h"),
    ({"dt": float("nan")}, "dt.*nan"), ({"dt": "1 ms"}, "dt.*ms"),
    ({"visuals": {"": [3]}}, "3.*Shape"), ({"visuals": {"bob": []}}, "'bob'.*''"),
])
def test_what_is_no_model_is_refused(changes, message):
    model = {"parameters": {"m": 1.0, "g": 1.0}, "q0": [1, 0, 0], "p0": [0, 0, 0]} | changes
    with pytest.raises(InputError, match=message):
        gs.Model(system(), **model)


@pytest.mark.parametrize("changes", [{"H": 0}, {"H": 1.5}, {"constraints": (1,)}])
def test_plain_numbers_are_expressions(changes):
    assert system(**changes).n == 3


def test_sequences_become_tuples_and_parts_without_constraints_are_empty():
    pendulum = system(q=list(q), p=list(p), parameters=[m, grav], constraints=[x**2 - 1])
    assert (pendulum.q, pendulum.p, pendulum.parameters, pendulum.constraints) == (
        q, p, (m, grav), (x**2 - 1,))
    assert (pendulum.n, pendulum.m, pendulum.rigid_body) == (3, 1, False)
    with pytest.raises(dataclasses.FrozenInstanceError):
        pendulum.name = "other"
    pendulum = system(constraints=())
    assert (pendulum.m, pendulum.G, pendulum.hidden, pendulum.hidden_matrix) == (0, [], [], [])
    assert pendulum.curvature([]) == [[0] * 3] * 3
    assert [k.name for k in common_kernels(pendulum)] == ["hamiltonian"]


def test_hessians_hold_the_same_object_on_both_sides_of_the_diagonal():
    for top in (heavy_top("gamma"), heavy_top("alpha")):
        for H in (top.H_qq, top.H_pp):
            assert all(H[i][j] is H[j][i] for i in range(top.n) for j in range(top.n))


def test_jacobians_are_symmetric_and_curvature_is_the_derivative_of_GT_lambda_by_q():
    f = x**3 * y**2 + sp.exp(x * y * z)
    grad = gradient(f, q)
    assert sp.simplify(sp.Matrix(symmetric_jacobian(grad, q)) - sp.hessian(f, q)) == sp.zeros(3)
    assert sp.simplify(sp.Matrix(jacobian(grad, q)) - sp.hessian(f, q)) == sp.zeros(3)
    pendulum = system(constraints=(x**2 * y - z, sp.sin(x * z)))
    lam = sp.symbols("l0:2")
    force = sp.Matrix(pendulum.G).T * sp.Matrix(lam)
    assert sp.simplify(sp.Matrix(pendulum.curvature(lam)) - force.jacobian(q)) == sp.zeros(3)
    with pytest.raises(ValueError, match="longer than"):
        system().curvature([])


def times(rows, vector):
    return [sum(a * b for a, b in zip(row, vector, strict=True)) for row in rows]


def test_hidden_constraints_of_two_constraints_are_G_H_p_up_to_factors_that_cannot_vanish():
    pendulum = system(constraints=(x**2 + y**2 + z**2 - 1, x - y))
    expected = [px * x + py * y + pz * z, px - py]
    assert [sp.expand(f - e) for f, e in zip(pendulum.hidden, expected, strict=True)] == [0, 0]
    products = times(pendulum.G, pendulum.H_p)
    factors = [2 / m, 1 / m]
    for product, factor, f in zip(products, factors, pendulum.hidden, strict=True):
        assert sp.expand(product - factor * f) == 0
    W = sp.Matrix([[2 * (x**2 + y**2 + z**2), x - y], [2 * x - 2 * y, 2]])
    assert sp.expand(sp.Matrix(pendulum.hidden_matrix) - W) == sp.zeros(2)


def test_hidden_matrix_is_the_derivative_of_hidden_along_GT():
    for pendulum in (
            system(), system(constraints=(x * y - c * z, y**3 - 1), parameters=(m, grav, c))):
        rows = jacobian(pendulum.hidden, pendulum.p)
        W = sp.Matrix(rows) * sp.Matrix(pendulum.G).T
        assert sp.expand(W - sp.Matrix(pendulum.hidden_matrix)) == sp.zeros(pendulum.m)


def test_factors_that_are_constants_are_dropped_unless_they_may_be_zero():
    radius = x**2 + y**2 + z**2
    pendulum = system(H=radius * (px**2 + py**2 + pz**2) / (2 * m), constraints=(radius - c,),
                      parameters=(m, c))
    assert [sp.expand(f) for f in pendulum.hidden] == [px * x + py * y + pz * z]
    radius, k = x**2 + y**2 + z**2, sp.Symbol("k", real=True)
    pendulum = system(H=radius * (px**2 + py**2 + pz**2), constraints=(radius - k,),
                      parameters=(k,))
    assert pendulum.hidden[0].has(x**2)
    assert system(H=px**2, constraints=(z,)).hidden == [0]


@pytest.mark.parametrize(("kinetic", "parameters", "factor"), [
    (y * px**2 / 2, (), y),  # vanishes somewhere on the constraint
    (sp.Symbol("k", real=True) * px**2 / 2, (sp.Symbol("k", real=True),),
     sp.Symbol("k", real=True)),  # may be zero
    (sp.exp(y) * px**2 / 2, (), sp.exp(y)),  # no polynomial: kept, which is safe
])
def test_factor_that_may_vanish_is_kept(kinetic, parameters, factor):
    pendulum = system(H=kinetic, constraints=(x,), parameters=parameters)
    assert sp.expand(pendulum.hidden[0] - factor * px) == 0


@pytest.mark.parametrize(("e", "short"), [
    (x * y + x * z, x * (y + z)), (x * (y + z) - x * z, x * y), ((x + y) ** 5, (x + y) ** 5),
    (x * (y - z) + x * (z - y), sp.Integer(0)), (sp.sqrt(x**2 + 1) * y, sp.sqrt(x**2 + 1) * y),
])
def test_shortest_form_is_equal_and_has_no_more_operations(e, short):
    form = shortest(e)
    assert sp.expand(form - e) == 0
    assert sp.count_ops(form) == sp.count_ops(short)


def back(e, constants):
    """Return an expression with its constants replaced by their definitions."""
    return e.xreplace({symbol: definition for definition, symbol in constants.definitions.items()})


def is_fully_hoisted(e, constants):
    """Return whether numbers times symbols are the only operations of parameters alone."""
    symbols = {*constants.parameters, *constants.definitions.values()}
    return all(
        node.as_coeff_Mul()[1].is_Symbol
        for node in sp.preorder_traversal(e)
        if isinstance(node, sp.Expr) and node.free_symbols and node.free_symbols <= symbols
    )


@pytest.mark.parametrize("rep", ["alpha", "gamma", "original"])
@pytest.mark.parametrize("make", [heavy_top, free_body])
def test_hoisted_systems_are_the_original_ones(make, rep):
    original = make(rep)
    reduced, constants = hoist_constants(original)
    assert back(reduced.H, constants) == original.H
    assert tuple(back(g, constants) for g in reduced.constraints) == original.constraints
    assert is_fully_hoisted(reduced.H, constants)
    assert reduced.parameters[: len(original.parameters)] == original.parameters
    for definition in constants.definitions:
        assert definition.free_symbols <= set(original.parameters)
    assert reduced.rigid_body


def test_hoisted_constants_keep_whether_they_can_vanish():
    _, constants = hoist_constants(heavy_top("alpha"))
    by_definition = constants.definitions
    alpha = sp.Symbol("alpha", real=True, nonzero=True)
    assert by_definition[1 / alpha].is_nonzero
    _, constants = hoist_constants(heavy_top("gamma"))
    differences = [s for e, s in constants.definitions.items() if e.is_Add]
    assert len(differences) == 3
    assert all(s.is_nonzero is None for s in differences)


LEAVES = st.sampled_from([x, y, m, c, grav, sp.Integer(2), sp.Rational(-1, 3), sp.Integer(-1)])


def grow(children):
    pairs = st.tuples(children, children)
    return st.one_of(
        pairs.map(lambda t: t[0] + t[1]),
        pairs.map(lambda t: t[0] - t[1]),
        pairs.map(lambda t: t[0] * t[1]),
        st.tuples(children, st.integers(1, 3)).map(lambda t: t[0] ** t[1]),
        children.map(lambda e: 1 / (1 + e**2)),
        children.map(lambda e: sp.sqrt(1 + e**2)),
        children.map(sp.sin),
    )


@settings(max_examples=20, derandomize=True)
@given(st.lists(st.recursive(LEAVES, grow, max_leaves=8), min_size=1, max_size=3))
def test_hoisting_loses_nothing_and_leaves_nothing_to_hoist(expressions):
    constants = Constants((m, c, grav))
    for e in expressions:
        hoisted = constants.hoist(e)
        assert sp.expand(back(hoisted, constants) - e) == 0
        assert is_fully_hoisted(hoisted, constants)
        assert constants.hoist(e) == hoisted  # the same symbols the second time
    names = [str(s) for s in constants.definitions.values()]
    assert len(names) == len(set(names))


def test_constants_are_numbered_in_order_of_appearance_and_parameters_keep_their_names():
    constants = Constants((m, c))
    e = constants.hoist(x * sp.sqrt(m) + y * sp.sin(c))
    assert sorted(map(str, e.free_symbols)) == ["k0", "k1", "x", "y"]
    assert constants.hoist(3 * m) == 3 * m
    assert set(constants.names().values()) == {"c->m", "c->c", "c->k0", "c->k1"}
    k0 = sp.Symbol("k0", real=True)
    pendulum = system(H=sp.sqrt(m) * px**2 + k0 * x**2, parameters=(m, k0))
    reduced, constants = hoist_constants(pendulum)
    assert back(reduced.H, constants) == pendulum.H
