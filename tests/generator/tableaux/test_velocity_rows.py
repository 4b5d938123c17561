"""V of velocity constraints: its conditions, its entries, and the order without them."""

import mpmath as mp
import numpy as np
import pytest

from gyrospark.core.errors import TableauError
from gyrospark.generator.tableaux.conditions import velocity_conditions
from gyrospark.generator.tableaux.families import (
    first_weight,
    gauss_lobatto,
    lobatto_iiiab,
    radau_lobatto,
    solve_rows,
)
from gyrospark.generator.tableaux.velocity_rows import velocity_enclosures, velocity_matrix
from rolling_systems import SKATE_CHAIN, SKATE_CHAIN_START, skate_chain, stepper_of


@pytest.mark.parametrize("make", [gauss_lobatto, radau_lobatto])
@pytest.mark.parametrize("s", [1, 2, 3, 5, 8])
def test_conditions_hold(make, s):
    tableau = make(s)
    lines = velocity_conditions(tableau, velocity_matrix(tableau))
    assert all(line.holds and line.residual == "0" for line in lines)
    assert any(line.name == "V symmetric" for line in lines) == (make is gauss_lobatto)


@pytest.mark.parametrize("s", [1, 2, 4])
def test_entries_are_integrals_of_lagrange_polynomials(s):
    tableau = gauss_lobatto(s)
    nodes = tableau.numeric(30).c_tilde
    with mp.workdps(30):
        for i, row in enumerate(velocity_enclosures(tableau)):
            for j, entry in enumerate(row):
                integral = mp.quad(lambda x, j=j: mp.fprod(
                    (x - c) / (nodes[j] - c) for k, c in enumerate(nodes) if k != j),
                    [0, nodes[i]])
                exact = mp.mpf(entry.centre.numerator) / entry.centre.denominator
                assert abs(integral - exact) < mp.mpf(10) ** -25


def test_lobatto_iiiab_has_none():
    with pytest.raises(TableauError, match="liiiab3"):
        velocity_matrix(lobatto_iiiab(3))


def continuing(tableau):
    """Return the matrix that continues Ã: b̃_0 first, collocation at inner nodes, b̃ last."""
    nodes = tableau.constraints
    return solve_rows(nodes, nodes, tableau.p - 1, first_weight(nodes, tableau.basis["b_tilde"]))


@pytest.mark.parametrize("s", [2, 3, 4])
def test_the_row_that_continues_lacks_conditions(s):
    lines = {line.name: line for line in velocity_conditions(gauss_lobatto(s),
                                                             continuing(gauss_lobatto(s)))}
    assert lines["C of V"].found.endswith(f"k = {s - 1}")
    assert not lines["C of V"].holds


def test_orders_with_constraints_of_both_kinds():
    """The reaction of g at a node turns with the body, so its first moment has to be right."""
    step, errors = stepper_of(skate_chain, 2), []
    exact = step.integrate(*SKATE_CHAIN_START, dt=1 / 2000, steps=2000, parameters=SKATE_CHAIN)
    for steps in (10, 20):
        run = step.integrate(*SKATE_CHAIN_START, dt=1 / steps, steps=steps, parameters=SKATE_CHAIN)
        errors.append([np.abs(run.q[-1] - exact.q[-1]).max(),
                       np.abs(run.p[-1] - exact.p[-1]).max()])
    assert np.log2(np.divide(*errors)) == pytest.approx([4, 4], abs=0.15)
