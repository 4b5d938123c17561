"""The free numbers of exact energy: what holds for all their values, computed a second way."""

from fractions import Fraction

import mpmath as mp
import pytest

import gyrospark as gs
from gyrospark.core.errors import TableauError
from gyrospark.generator.tableaux.conditions import energy_conditions
from gyrospark.generator.tableaux.energy_parameter import energy_values, with_energy_parameter


@pytest.mark.parametrize("s", [2, 3, 5])
def test_conditions_hold_for_every_theta(s):
    lines = energy_conditions(gs.tableau("G-L", s))
    assert all(line.holds and line.residual == "0" for line in lines)
    assert {line.found for line in lines} == {"yes", str(2*s - 2), str(2*s)}


@pytest.mark.parametrize("s", [2, 3, 4])
@mp.workdps(50)
def test_coefficients_in_decimals(s):
    """The moved A and Ā follow Legendre polynomials at 50 digits, symplectic at θ = (2/7, −1/3)."""
    tableau, theta = gs.tableau("G-L", s), (Fraction(2, 7), Fraction(-1, 3))
    n, moved = tableau.numeric(50), with_energy_parameter(tableau, theta).numeric(50)

    def legendre(k, x):
        return mp.legendre(k, 2*x - 1)

    u, v = ([legendre(k, c) for c in n.c] for k in (s - 1, s - 2))
    w = [legendre(s, c) - legendre(s - 2, c) for c in n.c_tilde]
    assert max(abs(w[0]), abs(w[-1])) < 1e-45
    small = mp.mpf(10)**-40
    for i in range(s):
        for j in range(s):
            expected = n.A[i][j] + mp.mpf(2)/7*n.b[j]*(u[i]*v[j] - v[i]*u[j])
            assert abs(moved.A[i][j] - expected) < small
            pair = n.b[i]*moved.A_hat[i][j] + n.b[j]*moved.A[j][i] - n.b[i]*n.b[j]
            assert abs(pair) < small
        for k in range(s + 1):
            expected = n.A_bar[k][i] - mp.mpf(1)/3*w[k]*n.b[i]*u[i]
            assert abs(moved.A_bar[k][i] - expected) < small
            pair = (n.b[i]*moved.A_tilde[i][k] + n.b_tilde[k]*moved.A_bar[k][i]
                    - n.b[i]*n.b_tilde[k])
            assert abs(pair) < small
    values = energy_values(tableau, constrained=True)
    assert [float(e.centre) for e in values["u"]] == pytest.approx([float(x) for x in u], abs=1e-15)
    assert [float(e.centre) for e in values["w"]] == pytest.approx([float(x) for x in w], abs=1e-15)
    assert set(energy_values(tableau, constrained=False)) == {"u", "v"}


def test_directions_that_are_not_skew_and_one_stage_are_refused():
    assert not all(line.holds for line in energy_conditions(gs.tableau("Radau-L", 2)))
    with pytest.raises(TableauError, match="2 stages"):
        with_energy_parameter(gs.tableau("G-L", 1), (1, 0))
