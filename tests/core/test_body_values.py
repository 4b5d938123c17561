"""Bodies from callers: inertia as moments or a tensor, attitudes, and values of no body."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import gyrospark as gs
import systems
from gyrospark.core.inertia import (
    as_inertia,
    inverse_entries,
    moments_of,
    refuse_impossible_inertias,
    tensor_of_inverse,
    unit_quaternions,
)
from gyrospark.generator.models.model_file import parse_model
from gyrospark.generator.multibody.rigid_body import kinetic_energy
from gyrospark.runtime.rigid_body.quaternion import (
    angular_velocity,
    attitude_quaternion,
    momentum,
    rotation_matrix,
)

EPS = float(np.finfo(float).eps)
MOMENTS = (0.002, 0.0013, 0.0008)
#: From the principal axes to the axes in which a tensor is given.
TILT = Rotation.from_rotvec([0.3, -0.5, 0.7])
TENSOR = TILT.as_matrix() @ np.diag(MOMENTS) @ TILT.as_matrix().T
TENSOR = (TENSOR + TENSOR.T) / 2


@pytest.mark.parametrize("inertia", [
    (2, 1, 1), (0.0017, 0.0015, 0.0002), tuple(7.3 * x for x in (0.1, 0.2, 0.3)),
    (1e-300, 1e-300, 2e-300), (1e300, 1e300, 1e300),
])
def test_moments_of_bodies_are_taken_in_silence(inertia):
    """Equality means a flat body; the sum may be off by its rounding."""
    assert as_inertia(inertia) == tuple(float(x) for x in inertia)


@pytest.mark.parametrize("inertia", [(10, 1, 1), (1, 1, 2.2), (0.5, 3, 1), (1, 0.1, 0.1),
                                     np.diag([10.0, 1, 1]), TENSOR + np.diag([0.1, 0, 0])])
def test_moments_that_no_body_has_are_refused(inertia):
    words = "moment.*gyrospark.System"
    build = gs.Multibody("m")
    for call in (lambda: as_inertia(inertia),
                 lambda: build.body("a", mass=1, inertia=inertia),
                 lambda: build.top("a", mass=1, inertia=inertia, centre=(0, 0, 1))):
        with pytest.raises(gs.InputError, match=words):
            call()
    if np.ndim(inertia) == 1:
        with pytest.raises(gs.InputError, match=words):
            gs.problems.free_body(inertia)


@pytest.mark.parametrize("inertia", [(0.11, 0.11, 0.23), (1, 2, 3.0001), (2.05, 1, 1)])
def test_moments_that_rounding_made_are_taken_with_a_remark(inertia):
    with pytest.warns(gs.errors.InputWarning, match="body.*rounding"):
        assert as_inertia(inertia) == tuple(float(x) for x in inertia)


def test_effective_moments_are_parameters_of_a_system(gl3):
    """Fluid and rotors add to moments, as the refusal proposes."""
    q, p = np.array([1.0, 0, 0, 0]), gs.Start.of_body([1, 0, 0, 0], [1, 2, 3], (10, 1, 1)).p
    parameters = {"I1": 10, "I2": 1, "I3": 1, "mgl": 0.1, "gamma": gs.gamma((10, 1, 1))}
    trajectory = gl3.integrate(q, p, dt=1e-2, steps=5, parameters=parameters)
    assert trajectory.report.energy_error_max < 1e-12


@pytest.mark.parametrize(("name", "value"), [("a_I3", 0.3), ("a_I1", 1e-3), ("a_m", -1.0)])
def test_parameters_of_a_model_are_those_of_bodies(name, value):
    """Runs, ensembles and axes of sweeps check them as the builder does, up to 5 % of rounding."""
    step, case = systems.stepper("double_top"), systems.case("double_top")
    model = case.options["system"]
    words = "a_m.*positive" if name == "a_m" else "inertia.*exceeds"
    right_value = case.parameters[name]
    for call in (lambda: step.integrate(model, dt=1e-3, steps=1, parameters={name: value}),
                 lambda: step.start(model, dt=1e-3, parameters={name: value}),
                 lambda: step.energy(model, parameters={name: value}),
                 lambda: step.integrate_ensemble(model, dt=1e-3, steps=1,
                                                 parameters={name: [right_value, value]}),
                 lambda: gs.sweep(model, {"a_I2": [0.12, 0.121], name: [right_value, value]},
                                  scheme="G-L", stages=2, steps=1)):
        with pytest.raises(gs.InputError, match=words):
            call()
    sum_of_others = case.parameters["a_I1"] + case.parameters["a_I3"]
    step.energy(model, parameters={"a_I2": 1.02 * sum_of_others})


@given(st.lists(st.floats(0.1, 1.0), min_size=3, max_size=3),
       st.lists(st.floats(-3, 3), min_size=3, max_size=3))
@settings(max_examples=20)
def test_inverses_of_tensors_are_refused_as_tensors_are(moments, turn):
    R = Rotation.from_rotvec(turn).as_matrix()
    K = (R @ np.diag(1 / np.array(moments)) @ R.T)[np.triu_indices(3)]
    excess = 2 * max(moments) - sum(moments)
    for of_body, columns in ((K.tolist(), ()), (np.repeat(K[:, None], 2, 1).tolist(), (2,))):
        names = {"a": [f"a_K{i}" for i in range(6)]}
        parameters = dict(zip(names["a"], of_body, strict=True))
        assert np.shape(parameters["a_K0"]) == columns
        if excess > 0.051 * max(moments):
            with pytest.raises(gs.InputError, match=r"inertia.*exceeds"):
                refuse_impossible_inertias(names, parameters)
        elif excess < 0.049 * max(moments):
            refuse_impossible_inertias(names, parameters)
    with pytest.raises(gs.InputError, match="definite"):
        refuse_impossible_inertias(names, dict(zip(names["a"], [1, 2, 0, 1, 0, 1], strict=True)))


@pytest.mark.parametrize(("inertia", "words"), [
    (np.diag([1.0, 1, -1]), "I3 = -1.0"), ([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]], "not symmetric"),
    ([[1, 2, 0], [2, 1, 0], [0, 0, 1]], "definite"), (np.zeros((3, 3)), "I1 = 0.0"),
    (np.eye(2), "3 × 3 finite"), (np.full((3, 3), np.nan), "3 × 3 finite"),
    (np.ones((3, 3)), "definite"), ([[1, 2], [3]], "three"),
])
def test_what_is_no_inertia_tensor_is_refused(inertia, words):
    for call in (as_inertia, gs.gamma, lambda x: gs.Start.of_body([1, 0, 0, 0], [1, 2, 3], x).p):
        with pytest.raises(gs.InputError, match=words):
            call(inertia)


def test_a_diagonal_tensor_is_its_moments():
    assert as_inertia(np.diag(MOMENTS)) == MOMENTS
    assert gs.gamma(np.diag(MOMENTS)) == gs.gamma(MOMENTS)


def test_entries_of_a_tensor_may_be_large():
    """Twice an entry overflows; the mean of the entry and its mirror image does not."""
    large = np.array(TENSOR) / np.abs(TENSOR).max() * 1e308
    assert np.array_equal(as_inertia(large), large)


@pytest.mark.parametrize("rule", ["m", "h", "mt", "ht"])
def test_means_of_a_tensor_are_those_of_its_moments(rule):
    assert gs.gamma(TENSOR, rule) == pytest.approx(gs.gamma(MOMENTS, rule), rel=8 * EPS)
    assert gs.gamma(TENSOR.tolist(), rule) == gs.gamma(TENSOR, rule)


@given(st.lists(st.floats(0.5, 1.0), min_size=3, max_size=3),
       st.lists(st.floats(-3, 3), min_size=3, max_size=3))
@settings(max_examples=20)
def test_a_tensor_and_its_inverse(moments, turn):
    R = Rotation.from_rotvec(turn).as_matrix()
    tensor = as_inertia(((R @ np.diag(moments) @ R.T) + (R @ np.diag(moments) @ R.T).T) / 2)
    if np.ndim(tensor) == 2:
        tensor_again = tensor_of_inverse(inverse_entries(tensor))
        assert np.allclose(tensor_again, tensor, rtol=0, atol=32 * EPS)
    assert np.allclose(sorted(moments_of(tensor)), sorted(moments), rtol=0, atol=32 * EPS)


def test_no_inverse_of_an_inertia_is_reported():
    with pytest.raises(gs.InputError, match="are no J⁻¹"):
        tensor_of_inverse([1, 2, 0, 1, 0, 1])


@pytest.mark.parametrize("rep", ["original", "alpha", "gamma"])
def test_kinetic_energy_of_a_tensor_is_that_of_the_moments(rep):
    """In principal axes K is diagonal: the expressions are the same."""
    import sympy as sp

    I1, I2, I3 = I = sp.symbols("I1:4", positive=True)  # noqa: E741
    K = (1 / I1, 0, 0, 1 / I2, 0, 1 / I3)
    assert sp.expand(kinetic_energy(rep, inertia=K) - kinetic_energy(rep, inertia=I)) == 0


def test_momentum_and_angular_velocity_of_a_tensor():
    """The body in its principal axes has Ω there = Aᵀ Ω here, and its l turns alike."""
    q, omega = unit_quaternions([0.5, 0.1, -0.7, 0.5]), np.array([3.0, -4, 10])
    p = momentum(q, omega, TENSOR)
    assert np.allclose(angular_velocity(q, p, TENSOR), omega, rtol=0, atol=1e-13)
    R = Rotation.from_matrix(rotation_matrix(q)) * TILT
    p_own = gs.Start.of_body(R, TILT.inv().apply(omega), MOMENTS).p
    energies = [0.5 * omega @ TENSOR @ omega,
                0.5 * np.sum(np.array(MOMENTS) * TILT.inv().apply(omega) ** 2)]
    assert energies[0] == pytest.approx(energies[1], rel=1e-14)
    assert np.linalg.norm(p) == pytest.approx(np.linalg.norm(p_own), rel=1e-14)


def test_a_builder_takes_a_tensor():
    """T equals ½ Ω·JΩ for any attitude."""
    omega = np.array([3.0, -2.0, 10.0])
    build = gs.Multibody("free_tensor", gravity=(0, 0, 0))
    build.top("a", mass=1, inertia=TENSOR, centre=(0, 0, 0), rotation=TILT.inv(),
              angular_velocity=omega)
    model = build.model()
    assert set(model.bodies) == {"a_gamma"}
    assert np.array_equal(model.bodies["a_gamma"], TENSOR)
    state = dict(zip((*model.system.q, *model.system.p), (*model.q0, *model.p0), strict=True))
    numbers = {str(name): value for name, value in model.parameters.items()}
    H = model.system.H.subs(state)
    H = H.subs({symbol: numbers[str(symbol)] for symbol in H.free_symbols})
    assert float(H) == pytest.approx(0.5 * omega @ TENSOR @ omega, rel=1e-14)


TENSOR_FILE = """
name = "tensor_file"
potential = "3/2*n**2*(J11*R31**2 + J22*R32**2 + J33*R33**2 + 2*J12*R31*R32)"
[body]
inertia = [[0.3, 0.02, 0], [0.02, 0.25, 0], [0, 0, "1/5"]]
[parameters]
n = 0.1
[start]
euler = [0.1, 0.2, 0.3]
angular_velocity = [0.1, 0.2, 1.0]
[quantities]
spin = "omega3"
roll = "omega1"
"""


def test_formulas_of_a_model_file_know_the_entries_of_a_tensor():
    model = parse_model(TENSOR_FILE, "t.toml")
    assert {"J11", "J12", "J22", "J33", "K11", "K23", "n"} <= set(model.parameters)
    assert "J13" not in model.parameters  # nothing asks for it


@pytest.mark.slow  # a stepper for this; others of a tensor are an arm's, and random bodies'
def test_a_model_file_takes_a_tensor():
    """Angular velocity and quantities agree."""
    model = parse_model(TENSOR_FILE, "t.toml")
    step = gs.stepper("G-L", 2, system=model.system)
    parameters = dict(model.parameters)
    trajectory = step.integrate(model.q0, model.p0, dt=0.01, steps=50, parameters=parameters)
    assert trajectory.parameters["gamma"] == pytest.approx(
        0.25, rel=8 * EPS)  # the trace over three
    assert np.allclose(trajectory.angular_velocity()[:, 2], trajectory.quantity("spin"), rtol=0,
                       atol=1e-14)
    assert np.allclose(trajectory.angular_velocity()[:, 0], trajectory.quantity("roll"), rtol=0,
                       atol=1e-14)
    assert np.allclose(trajectory.angular_velocity()[0], [0.1, 0.2, 1.0], rtol=0, atol=1e-15)
    J = np.array([[0.3, 0.02, 0], [0.02, 0.25, 0], [0, 0, 0.2]])
    omega, third = trajectory.angular_velocity(), trajectory.rotation().as_matrix()[:, 2, :]
    energy = 0.5 * np.einsum("ti,ij,tj->t", omega, J, omega) + 0.015 * np.einsum(
        "ti,ij,tj->t", third, J, third)
    assert np.allclose(energy, trajectory.energy(), rtol=0, atol=1e-15)
    free_tensor_turns_as_its_closed_form(step, model, J)


def free_tensor_turns_as_its_closed_form(step, model, J):
    """Check a body of tensor J without a field against a body with the moments of J."""
    moments, axes = np.linalg.eigh(J)
    principal = Rotation.from_matrix(axes * np.linalg.det(axes))
    omega = np.array([0.1, 0.2, 1.0])
    start = Rotation.from_matrix(rotation_matrix(model.q0)) * principal
    exact = gs.problems.free_body(moments, principal.inv().apply(omega),
                                  attitude=start.as_quat(scalar_first=True))
    errors = []
    for steps in (50, 100):
        trajectory = step.integrate(model.q0, model.p0, dt=5 / steps, steps=steps, every=steps,
                                    parameters=dict(model.parameters) | {"n": 0.0})
        turned = (trajectory.rotation() * principal).as_matrix()[:, :, 2]
        errors.append(np.abs(turned - exact.exact.axis(trajectory.t)).max())
    assert errors[1] < 1e-6
    assert 3.5 < math.log2(errors[0] / errors[1]) < 4.5  # order 4: nothing else is left


def test_bodies_of_a_file_take_tensors_too():
    text = """
name = "tensor_bodies"
[[bodies]]
name = "a"
mass = 1
inertia = [[0.3, 0.02, 0], [0.02, 0.25, 0], [0, 0, 0.2]]
angular_velocity = [1, 2, 3]
"""
    model = parse_model(text, "t.toml")
    J = np.array([[0.3, 0.02, 0], [0.02, 0.25, 0], [0, 0, 0.2]])
    assert np.allclose(model.p0[1:4] / 2, J @ [1, 2, 3], rtol=0, atol=1e-15)
    for wrong, words in [("[0, 0, 0.2]]", r"\[\[bodies\]\] 1.*definite"),
                         ("[0, 0.2]]", "row 3.* 2")]:
        changed = text.replace("[0, 0, 0.2]]", wrong.replace("0.2", "-0.2"))
        with pytest.raises(gs.InputError, match=words):
            parse_model(changed, "t.toml")


def test_a_rotation_matrix_is_taken_where_a_rotation_is():
    R = Rotation.from_rotvec([0.3, 1.2, -0.8])
    from_rotation = gs.Start.of_body(R, [1, 2, 3], MOMENTS)
    from_matrix = gs.Start.of_body(R.as_matrix(), [1, 2, 3], MOMENTS)
    for a, b in ((from_rotation.q, from_matrix.q), (from_rotation.p, from_matrix.p)):
        assert np.allclose(a, b, rtol=0, atol=4 * EPS)
    stack = Rotation.from_rotvec([[0.3, 1.2, -0.8], [3.1, 0, 0.1]])
    q = attitude_quaternion(stack.as_matrix().tolist())
    sign = np.sign((q * attitude_quaternion(stack)).sum(axis=1))[:, None]
    assert np.allclose(sign * q, attitude_quaternion(stack), rtol=0, atol=4 * EPS)
    for wrong in (2 * np.eye(3), np.diag([1, 1, -1.0]), np.eye(2), "x", None, np.zeros(4),
                  np.full(4, np.nan)):
        with pytest.raises(gs.InputError, match=r"rotation|attitude"):
            gs.Start.of_body(wrong, [1, 2, 3], MOMENTS)


@pytest.mark.parametrize("q", [
    (0.99, 0.14, 0, 0), (0.7071, 0.7071, 0, 0), (0.71, 0, 0, 0.7), (-1, 0, 0, 0),
    (0.6, 0, 0, 0.8), (0.707, 0, 0, -0.707),
    tuple(np.array([1, 2, 3, 4]) / math.sqrt(30)), np.float32([0.5, 0.5, 0.5, 0.5]),
    np.array([0.3, 0.4, 0.5, 0.707107], dtype=np.float32) / np.float32(1.0000002),
    [[1, 0, 0, 0], [0.6, 0, 0, 0.8]], [[1, 0, 0, 0], [0, 0, 0, 1]],
])
def test_attitudes_that_are_meant_so_are_taken_in_silence(q):
    """They are rounded to their written digits, or in their own type."""
    assert np.allclose(np.linalg.norm(unit_quaternions(q), axis=-1), 1, rtol=0, atol=2 * EPS)


@pytest.mark.parametrize(("q", "length"), [
    ((1, 1, 0, 0), "1.41421356"), ((0.99, 0.21, 0, 0), "1.012"),
    ((0.7073, 0.7073, 0, 0), "1.00027"), ((0.5, 0.5, 0.5, 0.500003), "1.0000015"),
    ((0, 2, 0, 0), "2"),
])
def test_a_length_that_rounding_does_not_explain_is_reported(q, length):
    with pytest.warns(gs.errors.InputWarning, match=f"length {length}"):
        unit = unit_quaternions(q)
    assert np.allclose(unit, np.array(q) / np.linalg.norm(q), rtol=0, atol=EPS)


@pytest.mark.parametrize(("q", "first"), [
    ((0, 0, 0, 1), "(1, 0, 0, 0)"), ((0.14, 0, 0, 0.99), "(0.99"), ((0, 0.28, 0, 0.96), "(0.96"),
    ((0, 0, 0, -1), "(-1, 0, 0, 0)"), ([[0, 0, 0, 1], [0.1, 0, 0, 0.995]], "(1, 0, 0, 0)"),
])
def test_a_scalar_that_seems_to_come_last_is_reported(q, first):
    with pytest.warns(gs.errors.InputWarning) as warnings_of_call:
        unit_quaternions(q)
    text = " ".join(str(warning.message) for warning in warnings_of_call)
    assert "scalar" in text
    assert f"write {first}" in text


def test_an_inertia_of_a_top_is_about_its_fixed_point():
    """Steiner: what is below m |c|² about the fixed point is negative about the centre of mass."""
    with pytest.warns(gs.errors.InputWarning, match=r"-0\.9"):
        gs.Multibody("m").top("a", mass=1, inertia=(0.1, 0.1, 0.05), centre=(0, 0, 1))
    tilted = TILT.as_matrix() @ np.diag([1.1, 1.1, 0.05]) @ TILT.as_matrix().T
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        gs.Multibody("m").top("a", mass=1, inertia=(tilted + tilted.T) / 2,
                              centre=TILT.apply([0, 0, 1.04]))
        # a bead on a rod
        gs.Multibody("m").top("a", mass=1, inertia=(1, 1, 1e-9), centre=(0, 0, 1))


def test_a_rotation_leaves_the_order_unsaid():
    """A rotation or a matrix has no order of components, as the remark proposes."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for rotation in (Rotation.from_quat([0, 0, 1, 0]), np.diag([-1.0, -1, 1])):
            build = gs.Multibody("m")
            build.top("a", mass=1, inertia=MOMENTS, centre=(0, 0, 0.01), rotation=rotation)
            assert np.allclose(np.abs(build.model().q0), [0, 0, 0, 1], rtol=0, atol=EPS)
    with pytest.raises(gs.InputError, match="single"):
        gs.Multibody("m").body("a", mass=1, inertia=MOMENTS,
                               rotation=Rotation.from_quat([[0, 0, 1, 0]] * 2))


@pytest.mark.parametrize("q", [(0, 0, 0, 0), (1, 0, 0), "abcd", None, [[[1, 0, 0, 0]]], 1,
                               (math.nan, 0, 0, 1), [[1, 0, 0, 0], [0, 0, 0, 0]], (1j, 0, 0, 0)])
def test_what_is_no_attitude_is_refused(q):
    with pytest.raises(gs.InputError, match="quaternion is"):
        unit_quaternions(q)
