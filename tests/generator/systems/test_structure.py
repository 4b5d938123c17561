"""Structured systems: templates, sparse factors, and the same numbers as from dense code."""

from __future__ import annotations

import random
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
from gyrospark.generator.pipeline import generate
from gyrospark.generator.schemes.step_equations import hoist_constants
from gyrospark.generator.spec import Spec
from gyrospark.generator.systems.elimination_order import (
    connected_components,
    eliminate,
    reverse_cuthill_mckee,
)
from gyrospark.generator.systems.repeated_structure import Structure
from gyrospark.generator.systems.system import System
from python_newton import integrate
from structured_systems import BEADS, beads, made_beads, start_of_beads

EPS = 2.0**-52


def chain(links: int) -> System:
    """Return bodies hanging from each other by ball joints."""
    return gs.models.chain(links).system


def compare(loops, dense, start, parameters, t0):
    """Compare residual, Jacobian, projection and trajectories to round-off."""
    q, p = start
    options = {"dt": 0.01, "parameters": parameters} | ({"t": t0} if dense.binding.is_timed else {})
    noise = np.random.default_rng(1).normal(size=dense.unknowns)
    x = dense.guess(q, p, **options) + 0.01 * noise
    for name in ("residual", "jacobian"):
        a, b = (getattr(step, name)(x, q, p, **options) for step in (loops, dense))
        assert np.abs(a - b).max() <= 64 * EPS * max(np.abs(b).max(), 1 / 0.01)
    del options["dt"]
    a, b = (step.project(q + 0.01, p, **options) for step in (loops, dense))
    assert np.abs(np.array(a) - np.array(b)).max() <= 64 * EPS * np.abs(b).max()
    run_options = {"dt": 4e-3, "steps": 40, "parameters": parameters}
    begin = gs.Start(q, p, t=t0)
    b = dense.integrate(begin, **run_options)
    for solver in ("auto", "newton", "python"):
        a = integrate(loops, begin, solver=solver, **run_options)
        # 40 steps of round-off, each of some ε; by EMS, the round-off of g by Δt in p
        assert np.abs(a.q - b.q).max() <= 256 * EPS
        assert np.abs(a.p - b.p).max() <= 256 * EPS * (np.abs(b.p).max() + 4 / 4e-3)
        assert np.abs(a.work - b.work).max() <= 256 * EPS * (1 + np.abs(b.energies).max())
        assert a.report.newton_steps == 0 or solver == "newton"
    ensemble = loops.integrate_ensemble([begin] * 2, **run_options)
    assert np.abs(ensemble.q[1] - b.q).max() <= 256 * EPS


def test_structured_code_computes_what_dense_code_does():
    assert Structure(hoist_constants(beads(4))[0]).is_worthwhile
    loops, dense = (made_beads("G-L", 2, kind) for kind in (True, False))
    compare(loops, dense, start_of_beads(dense, 0.4), BEADS, 0.4)


def test_parts_of_one_structure_share_a_template():
    """The time and a constant, or a decimal and its fraction, share no template."""
    t, a, b = sp.symbols("t a b", real=True)
    q, p = sp.symbols("x0:5", real=True), sp.symbols("y0:5", real=True)
    forces = (a * q[0], t * q[1], b * q[2], q[3] / 2, sp.Float(0.5) * q[4])
    structure = Structure(System(q, p, (a, b), sum(y**2 for y in p) / 2, forces=forces, time=t))
    instances = [sorted((i.rows, i.constants) for i in template.instances)
                 for template in structure.force_templates]
    assert sorted(instances) == [[((0,), (0,)), ((2,), (1,))], [((1,), ())], [((3,), ())],
                                 [((4,), ())]]


def test_what_dampers_couple_lies_close_together():
    """Points with dampers from each to the next are neighbours in the band order."""
    q, p = sp.symbols("x0:8", real=True), sp.symbols("y0:8", real=True)
    pulls = [p[i + 1] - p[i] for i in range(7)]
    forces = [after - before for after, before in zip([*pulls, 0], [0, *pulls], strict=True)]
    H = sum(y**2 for y in p) / 2 + sum(x**4 for x in q) / 4
    structure = Structure(hoist_constants(System(q, p, (), H, forces=forces, name="dampers"))[0])
    for pair in ({("q", i), ("q", i + 1)} for i in range(7)):
        assert any(pair <= nodes for nodes in structure.coupled_sets)
    position = {node: i for i, node in enumerate(structure.band_order)}
    assert max(abs(position["q", i + 1] - position["q", i]) for i in range(7)) == 1


@pytest.mark.slow  # a stepper; test_elements.py has its derivatives
def test_structured_ems_balances_energy_and_work():
    """Energy and work balance by each solver, an identity that needs no dense code."""
    step = made_beads("EMS", None, True)
    for solver in ("auto", "newton", "python"):
        run = integrate(step, gs.Start(*start_of_beads(step, 0.4), t=0.4), dt=4e-3, steps=40,
                        parameters=BEADS, solver=solver)
        size = np.abs(run.energies).max() + np.abs(run.work).max()
        assert run.report.energy_error_max <= 64 * EPS * size
        assert np.abs(run.work).max() > 1e-3 * size
        assert run.report.constraint_max <= 64 * EPS
    exact = made_beads("G-L", 2, True).integrate(gs.Start(*start_of_beads(step, 0.4), t=0.4),
                                                 dt=4e-3, steps=40, parameters=BEADS)
    assert np.abs(run.q - exact.q).max() <= 1e-4  # of order 2


@pytest.mark.parametrize("links", [2, 5])
def test_forms_of_a_chain(links):
    """A chain of any length has three templates in H and three of constraints."""
    structure = Structure(hoist_constants(chain(links))[0])
    assert [len(form.instances) for form in structure.templates] == [links, 2 * links, links]
    assert sorted(len(form.instances) for form in structure.constraint_templates) == sorted(
        [links, 1, links - 1])
    assert structure.is_worthwhile


def test_factors_of_a_chain_grow_linearly_and_text_hardly_at_all():
    # Half-bandwidth 7 and no fill: 22 entries and some 60 products for a further body.
    entries, products = zip(*(
        (s.elimination.entries, s.elimination.products)
        for s in (Structure(hoist_constants(chain(links))[0]) for links in (3, 4, 5, 8))),
                            strict=True)
    assert entries[1] - entries[0] == entries[2] - entries[1]
    assert products[1] - products[0] == products[2] - products[1]
    assert entries[3] - entries[2] == 3 * (entries[1] - entries[0])
    assert products[3] - products[2] == 3 * (products[1] - products[0])
    # Kernels are the same; only tables of indices grow.
    lines = {links: [line for line in generate(
        Spec.from_arguments("G-L", 2), system=beads(links),
        structured=True).source.source.splitlines()
                     if not set(line) <= set("0123456789{}, -;")] for links in (3, 5)}
    kernels = [[line for line in lines[links] if "c->values[" not in line] for links in (3, 5)]
    assert len(kernels[1]) - len(kernels[0]) < 40


@settings(max_examples=20)
@given(parents=st.integers(2, 20).flatmap(lambda n: st.tuples(
    *(st.integers(0, b - 1) for b in range(1, n)))))
def test_trees_of_bodies_have_no_fill(parents):
    """Norms and ball joints of a tree, which couple pairwise on each body, have no fill."""
    of_body = [set(range(4 * b, 4 * b + 4)) for b in range(len(parents) + 1)]
    for child, parent in enumerate(parents, start=1):
        of_body[parent] |= {4 * child + 1, 4 * child + 2, 4 * child + 3}
    neighbours = {row: set() for row in range(4 * len(of_body))}
    for rows in of_body:
        for row in rows:
            neighbours[row] |= rows - {row}
    pattern = len(neighbours) + sum(map(len, neighbours.values())) // 2
    assert eliminate(neighbours).entries == pattern


graphs = st.integers(1, 12).flatmap(lambda n: st.lists(
    st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)), max_size=30).map(
        lambda pairs: _graph(n, pairs)))


def _graph(n: int, pairs: list[tuple[int, int]]) -> dict[int, set[int]]:
    neighbours: dict[int, set[int]] = {a: set() for a in range(n)}
    for a, b in pairs:
        if a != b:
            neighbours[a].add(b)
            neighbours[b].add(a)
    return neighbours


@settings(max_examples=30)
@given(graph=graphs, seed=st.integers(0, 2**32 - 1))
def test_elimination_solves(graph, seed):
    """LDLᵀ of numbers by the tables gives the dense solution."""
    n = len(graph)
    tables = eliminate(graph)
    rng = np.random.default_rng(seed)
    A = np.diag(rng.uniform(n + 1, n + 2, n))
    for a, neighbours in graph.items():
        for b in neighbours:
            A[a, b] = A[b, a] = rng.uniform(-0.5, 0.5)
    W = np.zeros(tables.entries)
    for (a, b), slot in tables.slot_of.items():
        W[slot] = A[a, b]
    for pivot, slots, rows, targets in zip(tables.order, tables.slots, tables.rows, tables.targets,
                                           strict=True):
        targets = iter(targets)
        W[pivot] = 1 / W[pivot]
        for i, slot in enumerate(slots):
            factor = W[slot] * W[pivot]
            for j in range(i):
                W[next(targets)] -= factor * W[slots[j]]
            W[rows[i]] -= factor * W[slot]
        for slot in slots:
            W[slot] *= W[pivot]
    assert [slot for slots in tables.slots for slot in slots] == list(range(n, tables.entries))
    b = rng.normal(size=n)
    x = b.copy()
    for pivot, before in zip(tables.order, tables.before, strict=True):
        x[pivot] -= sum(W[slot] * x[row] for row, slot in before)
    for pivot, slots, rows in reversed(list(zip(
            tables.order, tables.slots, tables.rows, strict=True))):
        x[pivot] = x[pivot] * W[pivot] - sum(W[s] * x[r] for s, r in zip(slots, rows, strict=True))
    assert np.abs(A @ x - b).max() <= 64 * n * EPS * np.abs(b).max()


@settings(max_examples=30)
@given(graph=graphs)
def test_orders_name_every_node_once(graph):
    named = {("q", a): {("q", b) for b in neighbours} for a, neighbours in graph.items()}
    order = reverse_cuthill_mckee(named)
    assert sorted(order) == sorted(named)
    assert sorted(eliminate(graph).order) == sorted(graph)


def test_pivots_are_those_of_a_search_through_all_rows():
    for seed in range(60):
        draw = random.Random(seed)
        n = draw.randint(1, 20)
        graph = _graph(n, [(draw.randrange(n), draw.randrange(n))
                           for _ in range(draw.randint(0, 4 * n))])
        remaining, order = {row: set(neighbours) for row, neighbours in graph.items()}, []
        while remaining:
            rows = sorted(remaining, key=lambda row: (len(remaining[row]), row))
            free = [row for row in rows
                    if all(remaining[row] <= remaining[neighbour] | {neighbour}
                           for neighbour in remaining[row])]
            order.append([*free, rows[0]][0])
            neighbours = remaining.pop(order[-1])
            for row in neighbours:
                remaining[row] = (remaining[row] | neighbours) - {row, order[-1]}
        assert [*eliminate(graph).order] == order


def test_a_path_has_bandwidth_one_and_no_fill():
    shuffled = [3, 7, 0, 5, 1, 6, 2, 4]
    path = _graph(8, list(pairwise(shuffled)))
    order = reverse_cuthill_mckee({("q", a): {("q", b) for b in o} for a, o in path.items()})
    position = {node[1]: k for k, node in enumerate(order)}
    assert max(abs(position[a] - position[b])
               for a, neighbours in path.items() for b in neighbours) == 1
    assert eliminate(path).entries == 8 + 7


@given(sets=st.lists(st.frozensets(st.integers(0, 20), min_size=1, max_size=4), max_size=8))
def test_connected_sets_are_disjoint_unions(sets):
    unions = connected_components(sets)
    assert all(any(s <= u for u in unions) for s in sets)
    assert sum(map(len, unions)) == len(frozenset().union(*sets, frozenset()))


def test_names_do_not_matter():
    """Bodies of other names have the same forms, as long as they come in the same order."""
    system = chain(3)
    letters = {s: sp.Symbol(f"z{k}_{s}", **s.assumptions0)
               for k, s in enumerate(reversed(system.parameters))}
    renamed = replace(system, H=system.H.xreplace(letters),
                      constraints=[g.xreplace(letters) for g in system.constraints],
                      parameters=[letters[s] for s in system.parameters])
    ours, theirs = (Structure(hoist_constants(s)[0]) for s in (system, renamed))
    assert [f.expressions for f in ours.templates] == [f.expressions for f in theirs.templates]


def test_a_constant_in_H_is_no_body():
    """A constant in H, which once ended the generation, adds no node to the structure."""
    system = beads(3)
    plain, shifted = (Structure(hoist_constants(replace(system, H=system.H + value))[0])
                      for value in (0, 3))
    assert shifted.coupled_sets == plain.coupled_sets
    assert generate(Spec.from_arguments("G-L", 1), system=replace(system, H=system.H + 3),
                    structured=True).source
