"""One H, one C: equivalent expressions have one normal form, and it is the same function."""

import random
from dataclasses import replace

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
from equivalent_forms import HALF, TEN, everywhere, lattice, links, rewritten, stand_ins
from gyrospark.generator.multibody.rigid_body import heavy_top, kinetic_energy
from gyrospark.generator.normal_forms import additive_terms, expansion
from gyrospark.generator.normal_forms.canonical_system import canonical
from gyrospark.generator.normal_forms.shortest_sum import cost
from gyrospark.generator.pipeline import generate
from gyrospark.generator.schemes.step_equations import hoist_constants
from gyrospark.generator.spec import Spec
from gyrospark.generator.symbolic.identities import compare
from gyrospark.generator.systems.repeated_structure import Structure
from gyrospark.generator.systems.system import System

x, y, z = sp.symbols("x y z", real=True)
px, py, pz = sp.symbols("px py pz", real=True)
a, b, c = sp.symbols("a b c", real=True)
m, k, L, r = sp.symbols("m k L r", positive=True)


def body(rep, moments, weight):
    """Return a body whose moments are numbers or symbols."""
    q, p = sp.symbols("q0:4", real=True), sp.symbols("p0:4", real=True)
    H = kinetic_energy(rep, q, p, moments, weight) + a * (q[0] ** 2 + q[3] ** 2)
    symbols = sorted({s for e in (*moments, weight) for s in sp.sympify(e).free_symbols}, key=str)
    return System(q, p, (*symbols, a), H, (sum(e**2 for e in q) - 1,), name="body")


def plane(H, *parameters, **options):
    """Return a system of two coordinates."""
    return System((x, y), (px, py), parameters, (px**2 + py**2) / (2 * m) + H
                  if m in parameters else H, name="plane", **options)


def dragged():
    """Return masses with forces between them, and a drive."""
    t = sp.Symbol("t", real=True)
    v = [e / m for e in (px, py, pz)]
    drag = sp.sqrt(v[0] ** 2 + v[1] ** 2)
    return System(
        (x, y, z), (px, py, pz), (m, k, c), (px**2 + py**2 + pz**2) / (2 * m)
        + k * ((x - y) ** 2 + (y - z) ** 2) / 2, name="dragged", time=t,
        forces=[-c * (v[0] - v[1]) - k * v[0] * drag, -c * (2 * v[1] - v[0] - v[2]),
                -c * (v[2] - v[1]) * (1 + sp.sin(3 * t))],
        quantities={"power": c * (v[0] - v[1]) ** 2})


def pendulum():
    """Return the double pendulum in angles: an H with a denominator in q."""
    d, (l1, l2, m1, m2, g) = x - y, sp.symbols("l1 l2 m1 m2 g", positive=True)
    T = (m2 * l2**2 * px**2 + (m1 + m2) * l1**2 * py**2 - 2 * m2 * l1 * l2 * px * py * sp.cos(d))
    T /= 2 * m2 * l1**2 * l2**2 * (m1 + m2 * sp.sin(d) ** 2)
    return plane(T - (m1 + m2) * g * l1 * sp.cos(x) - m2 * g * l2 * sp.cos(y), l1, l2, m1, m2, g)


ROOT = sp.sqrt(x**2 + y**2)
SYSTEMS = {
    "springs of a length": lambda: lattice(4, lambda d: a * (d - b) ** 2 / 2, a, b),
    "alpha-chain": lambda: lattice(4, lambda d: a * d**2 / 2 + b * d**3 / 3, a, b),
    "Toda": lambda: lattice(4, lambda d: a * sp.exp(b * d), a, b),
    "phi-4 in numbers": lambda: lattice(4, lambda d: d**2 / 2, site=lambda u: (u**2 - 1) ** 2 / 4),
    "chain of bodies": lambda: gs.models.chain(2).system,
    "four-bar": lambda: gs.models.four_bar().system,
    "satellite": lambda: gs.models.satellite().system,
    "alpha body": lambda: body("alpha", sp.symbols("I1:4", positive=True), r),
    "body in numbers": lambda: body("gamma", (sp.Rational(1, 5), sp.Rational(1, 7), HALF), 2),
    "symmetric body in numbers": lambda: body("gamma", (HALF, HALF, sp.Rational(1, 3)), 2),
    "dragged": dragged,
    "double pendulum": pendulum,
    "vector potential": lambda: plane(((px + b * y / 2) ** 2 + (py - b * x / 2) ** 2) / (2 * k)
                                      + a * (x**2 - y**2), a, b, k),
    "two anchors": lambda: plane(k * (sp.sqrt((x - a) ** 2 + y**2) - L) ** 2 / 2
                                 + c * (sp.sqrt((x + b) ** 2 + y**2) - r) ** 2 / 2,
                                 a, b, c, m, k, L, r),
    "Kepler in a trap": lambda: plane(-k / ROOT + c * ROOT**2 / 2, c, m, k),
    "ring": lambda: plane(k * (x**2 + y**2 - L**2) ** 2, m, k, L),
    "two on springs": lambda: plane((x**2 + y**2 + (x - y) ** 2) / 2 + x + y),
    "hard spring": lambda: plane(k * (ROOT - L) ** 2 / 2 + c * (ROOT - L) ** 4 / 4, c, m, k, L),
    "reduced mass": lambda: plane((px**2 + py**2) * (r + L) / (2 * r * L) + (r + L) * y, r, L),
}

zoo = pytest.mark.parametrize("system", [
    pytest.param(system, id=name, marks=[pytest.mark.slow] if name in (
        "four-bar", "chain of bodies", "satellite", "alpha body", "body in numbers") else [])
    for name, system in SYSTEMS.items()])


def parts(system):
    return [system.H, *system.constraints, *system.forces, *system.quantities.values()]


def test_ten_equivalent_forms_of_a_chain():
    system = links(2, equal=False)
    written = [everywhere(change)(system) for change in TEN.values()]
    assert len({(system.H, system.constraints) for system in written}) >= 7
    for name, variant in zip(TEN, written, strict=True):
        assert canonical(variant) == canonical(system), name


@zoo
def test_forms_of_other_systems(system):
    """Sums and quotients are rebuilt; the form is the same function, and its own form."""
    written = system()
    form = canonical(written)
    for name in ("with common denominators", "nested"):
        assert parts(canonical(everywhere(TEN[name])(written))) == parts(form), name
    assert compare(parts(written), parts(form), thorough=False).holds
    assert parts(canonical(replace(form, name="again"))) == parts(form)


def test_a_common_denominator_hides_no_terms():
    """For fifty masses, (Σ p²)/(2m) once hid the terms: 85,000 lines of C instead of 4,600."""
    count = 3 * 10
    q, p = sp.symbols(f"x0:{count}", real=True), sp.symbols(f"p0:{count}", real=True)
    links_ = [sum((u - v) ** 2 for u, v in zip(q[i : i + 3], q[i - 3 : i] or (0, 0, 0),
                                               strict=True)) - L**2 for i in range(0, count, 3)]
    sources = [generate(Spec.from_arguments("G-L", 2), system=System(
        q, p, (m, k, L), H, links_, name="chain")).source.files() for H in (
            sum(e**2 for e in p) / (2 * m) + m * k * sum(q[2::3]),
            sum(e**2 / (2 * m) for e in p) + sum(m * k * e for e in q[2::3]))]
    assert sources[0] == sources[1]
    assert max(text.count("\n") for text in sources[0].values()) < 8000


@st.composite
def systems(draw):
    """Draw masses with springs of several kinds between some of them, rods, drag and holders."""
    count, dims = draw(st.integers(2, 4)), draw(st.integers(1, 3))
    q = sp.symbols(f"x0:{count * dims}", real=True)
    p = sp.symbols(f"p0:{count * dims}", real=True)
    X = [q[i * dims : (i + 1) * dims] for i in range(count)]
    numbers = [sp.Integer(1), sp.Integer(3), sp.Rational(5, 2), sp.Rational(1, 7)]
    value = st.sampled_from([*numbers, m, k, L, r])
    H = sum(y**2 / (2 * draw(value)) for y in p) + draw(value) * sum(e[-1] for e in X)
    if draw(st.booleans()):
        H += draw(value) * sum(e**2 for e in q) / 2
    pairs = [(i, j) for i in range(count) for j in range(i)]
    for i, j in draw(st.lists(st.sampled_from(pairs), max_size=4, unique=True)):
        square = sum((u - v) ** 2 for u, v in zip(X[i], X[j], strict=True))
        stiffness, length = draw(value), draw(value)
        H += draw(st.sampled_from([
            stiffness * square / 2, -stiffness / (1 + square),
            stiffness * (sp.sqrt(length + square) - length) ** 2 / 2,
            stiffness * (sp.sqrt(square) - length) ** 2 / 2 if dims > 1 else sp.Integer(0)]))
    g = [sum((u - v) ** 2 for u, v in zip(X[1], X[0], strict=True)) - L**2] * draw(
        st.integers(0, 1))
    drag = draw(value)
    forces = [-drag * (u - v) for u, v in zip(p, [*p[dims:], *p[:dims]], strict=True)]
    return System(q, p, (m, k, L, r), H, g, name="random",
                  forces=forces if draw(st.booleans()) else ())


@settings(max_examples=5)
@given(system=systems(), seed=st.integers(0, 2**32 - 1))
def test_random_equivalent_forms_of_random_systems(system, seed):
    draw = random.Random(seed)
    variant = everywhere(lambda e: rewritten(e, draw))(system)
    form, again = canonical(system), canonical(variant)
    assert parts(form) == parts(again)
    assert compare(parts(system), parts(form), thorough=False).holds


def test_decimals_stay_decimals():
    """The form has as many digits as the expression."""
    H = canonical(plane(sp.Float(0.1) * x**2 / 3 + 0.5 * y**2)).H
    assert sp.Float(0.1) * x**2 / 3 + y**2 / 2 == H
    assert canonical(plane(0.1 * x + sp.Float("0.3", 40) * y)).H.coeff(y) == sp.Float("0.3", 40)


def test_names_do_not_matter():
    """Renamed symbols in the same order give the same H in the new names."""
    system = links(3, equal=False)
    symbols = [*system.q, *system.p, *system.parameters]
    names = {s: sp.Symbol(f"z{len(symbols) - i}", **s.assumptions0) for i, s in enumerate(symbols)}
    renamed = replace(system, H=sp.expand(system.H).xreplace(names),
                      constraints=[e.xreplace(names) for e in system.constraints],
                      **{side: [names[s] for s in getattr(system, side)]
                         for side in ("q", "p", "parameters")})
    form = canonical(system)
    assert parts(canonical(renamed)) == [e.xreplace(names) for e in parts(form)]


def test_equal_parts_of_a_chain_have_one_form():
    """Masses, heights, springs and rods share templates in any spelling; the first rod does not."""
    for change in (sp.expand, sp.together):
        structure = Structure(hoist_constants(canonical(everywhere(change)(links(4))))[0])
        assert sorted(len(form.instances) for form in structure.templates) == [2, 4, 8]
        assert [len(form.instances) for form in structure.constraint_templates] == [1, 1]


def test_equal_forces_of_a_chain_are_reduced_once(monkeypatch):
    """Dampers between neighbours, each in two forces, take no more for a chain twice as long."""
    calls = []
    split = additive_terms.split
    monkeypatch.setattr(additive_terms, "split", lambda *args: calls.append(1) or split(*args))
    counts = []
    for count in (4, 8):
        chain = lattice(count, lambda d: a * d**2 / 2, a, c)
        q, p = chain.q, chain.p
        forces = [sp.Integer(0)] * count
        for i, j in zip(range(count), range(1, count), strict=False):
            damper = c * q[i] * q[j] * (p[i] - p[j]) * (q[i] ** 2 + q[j] ** 2)
            forces[i], forces[j] = forces[i] - damper, forces[j] + damper
        system = replace(chain, H=sp.expand(chain.H), forces=forces)
        calls.clear()
        reduced = canonical.__wrapped__(system)
        counts.append(len(calls))
        assert compare(parts(system), parts(reduced), thorough=False).holds
    assert counts[0] == counts[1]


@pytest.mark.parametrize("model", [gs.models.lagrange_top, gs.models.double_top])
def test_models_of_bodies_cost_no_more(model):
    """Computing H takes no more operations than as written, and g at most 5 % more."""
    written = model().system
    form = canonical(written)
    names = stand_ins((*written.q, *written.p), written.parameters)
    before, after = ([cost([e.xreplace(names) for e in side]) for side in (
        [system.H], system.constraints)] for system in (written, form))
    assert after[0] <= before[0]
    assert after[1] <= 1.05 * before[1]


@pytest.mark.parametrize("rep", ["gamma", "alpha"])
def test_the_papers_top_is_canonical(rep):
    """H of (26) and g of (22) are their own normal forms, also when expanded."""
    top = heavy_top(rep)
    for change in (lambda e: e, sp.expand):
        assert parts(canonical(everywhere(change)(top))) == parts(top)


def test_points_that_nothing_couples_have_the_forms_of_each_alone():
    """A constant in H completes the square k (x − b)²/2 of one point or of both."""
    springs = sp.expand(k * ((x - b) ** 2 + (y - b) ** 2) / 2)
    sums, squares = ([k * form(z) / 2 for z in (x, y)]
                     for form in (lambda z: z * (z - 2 * b), lambda z: (z - b) ** 2))
    for missing, potential in enumerate((squares, (squares[0], sums[1]), sums)):
        H = canonical(plane((px**2 + py**2) / 2 + springs - missing * k * b**2 / 2, k, b)).H
        assert sp.Add(px**2 / 2, py**2 / 2, *potential) == H
    alone = [canonical(System((u,), (v,), (k, b), v**2 / 2 + k * sp.cosh(b * u) * u)).H
             for u, v in ((x, px), (y, py))]
    both = plane((px**2 + py**2) / 2 + k * (sp.cosh(b * x) * x + sp.cosh(b * y) * y), k, b)
    assert sp.Add(*alone) == canonical(both).H


ENDLESS = {
    "power of a power": ((x + y + 1) ** 9 + px) ** 9 + py**2,
    "many factors": sp.Mul(*(x + i * y + px**2 + 1 for i in range(1, 30))) + py**2,
    "sum of many": sum(sp.Symbol(f"w{i}") for i in range(200)) ** 7 * px + py**2,
    "bars in bars": sum((px**2 + x) / (1 + x / (2 + y / (3 + x * y / (x + i)))) ** 3
                        for i in range(1, 6)),
    "roots in roots": sp.sqrt(1 + sp.sqrt(2 + (px + sp.sqrt(3 + (x + py) ** 8)) ** 8) ** 7) ** 5,
}


@pytest.mark.parametrize("H", [
    pytest.param(H, id=name, marks=[pytest.mark.slow] * (name == "bars in bars"))
    for name, H in ENDLESS.items()])
def test_nothing_is_multiplied_out_without_end(H, monkeypatch):
    """Expansion stays within its allowance of products, and H stays the same function."""
    spent = []
    spend = expansion.NormalForm.spend
    monkeypatch.setattr(expansion.NormalForm, "spend",
                        lambda self, products: (spent.append(min(products, self.allowance)),
                                                spend(self, products)))
    system = plane(H, *sorted(H.free_symbols - {x, y, px, py}, key=str))
    form = canonical.__wrapped__(system)
    assert sum(spent) < 200_000
    assert compare([H], [form.H], thorough=False).holds
    names = stand_ins((x, y, px, py))
    assert cost([form.H.xreplace(names)]) <= 1.1 * cost([H.xreplace(names)])
