"""Rows of arguments have an order; a noun agrees with its number in messages, tables and reprs."""

from __future__ import annotations

import re

import pytest

import gyrospark as gs
import systems
from gyrospark.core.arguments import as_items, count_text


def test_a_noun_agrees_with_its_number():
    assert [count_text(count, "step") for count in (0, 1, 2000)] == ["0 steps", "1 step",
                                                                     "2,000 steps"]
    assert [count_text(count, "body") for count in (1, 2)] == ["1 body", "2 bodies"]


def test_one_of_each_is_in_the_singular():
    """A bead on a circle: one constraint; runs, ensembles and sections of one step or state."""
    case, step = systems.case("pendulum"), systems.stepper("pendulum")
    start = gs.Start(*systems.start("pendulum", step), case.parameters)
    run = step.integrate(start, dt=case.dt, steps=1)
    simulation = step.start(start, dt=case.dt)
    simulation.advance()
    model = gs.Model(case.system, case.parameters, start.q, start.p, steps=1, dt=case.dt)
    shown = [step._repr_html_(), case.system, model, run, run[:1], run[-1:]._repr_html_(),
             run.report, simulation, step.integrate_ensemble([start], dt=case.dt, steps=1),
             gs.section(step, [start], event=gs.Event("x"), dt=case.dt, steps=1)]
    texts = [text if isinstance(text, str) else repr(text) for text in shown]
    # "1 steps", "1 more states"; not "0.1 s", "of 1 of 3 steps", "11 states"
    wrong = re.compile(r"(?<![\w.,])1 (?:\w+ )?(?!unless|this|its|was|is)[a-z]{3,}s\b")
    assert [text for text in texts if wrong.search(text)] == []
    assert sum(bool(re.search(r"(?<![\w.,])1 [a-z]", text)) for text in texts) >= 8


@pytest.mark.parametrize("kind", [set, frozenset])
def test_sets_are_refused_where_the_order_has_an_effect(kind):
    assert as_items("names", {"b": 1, "a": 2}.keys(), "names") == ["b", "a"]
    assert sorted(as_items("names", kind("ab"), "names", is_ordered=False)) == ["a", "b"]
    with pytest.raises(gs.InputError, match=r"names.*list"):
        as_items("names", kind("ab"), "names")
