"""The Whipple bicycle from bodies, hinges and rolling wheels against its published benchmark."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import gyrospark as gs

BICYCLE = runpy.run_path(str(Path(gs.__file__).parent / "examples" / "bicycle.py"))

# Meijaard, Papadopoulos, Ruina, Schwab, Proc. R. Soc. A 463 (2007): M q̈ + v C₁ q̇ + (g K₀ + v² K₂) q
M = np.array([[80.81722, 2.31941332208709], [2.31941332208709, 0.29784188199686]])
K0 = np.array([[-80.95, -2.59951685249872], [-2.59951685249872, -0.80329488458618]])
K2 = np.array([[0, 76.59734589573222], [0, 2.65431523794604]])
C1 = np.array([[0, 33.86641391492494], [-0.85035641456978, 1.68540397397560]])


def published(speed):
    """Return the eigenvalues of the published matrices."""
    first_order = np.block([[np.zeros((2, 2)), np.eye(2)],
                            [-np.linalg.solve(M, 9.81 * K0 + speed**2 * K2),
                             -speed * np.linalg.solve(M, C1)]])
    return sorted(np.linalg.eigvals(first_order), key=lambda x: (-x.real, -x.imag))


@pytest.mark.slow  # wheels, forks and frames have tests of their own
@pytest.mark.parametrize(("speed", "printed"), [
    (0.0, [5.53094372, 3.13164325, -3.13164325, -5.53094372]),
    (5.0, [-0.32286643, -0.77534188 + 4.46486771j, -0.77534188 - 4.46486771j, -14.07838969]),
])
def test_eigenvalues_of_the_benchmark(speed, printed):
    eigenvalues = BICYCLE["eigenvalues"](BICYCLE["bicycle"](speed))
    np.testing.assert_allclose(eigenvalues, printed, atol=5.1e-9, rtol=0)
    np.testing.assert_allclose(eigenvalues, published(speed), rtol=1e-10)


def test_it_starts_on_all_its_constraints():
    model = BICYCLE["bicycle"](5.0)
    assert (model.system.n, model.system.m, model.system.velocity_count) == (28, 21, 4)
    moved = gs.consistent(model.system, model.q0, model.p0, parameters=model.parameters)
    assert max(moved.q_moved, moved.p_moved) < 1e-12
