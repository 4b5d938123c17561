"""Where axes of joints and centres of rotors are, on bodies that are tilted at the start."""

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.core.errors import InputError, InputWarning
from gyrospark.runtime.rigid_body.quaternion import left_matrix, rotation_matrix

TILT = np.array([0.5, 0.5, -0.1, 0.7])
HINGES = ("revolute", "align", "prismatic", "cylindrical", "planar", "screw")


def bus():
    """Return a builder with a tilted body away from the origin."""
    build = gs.Multibody("satellite", gravity=(0, 0, 0))
    build.body("bus", mass=5.0, inertia=(0.3, 0.4, 0.5), position=(1, -2, 3), quaternion=TILT,
               angular_velocity=(0, 0, 0))
    return build


def satellite(**placement):
    """Return the builder of ``bus`` with a wheel that turns at 20 rad/s."""
    build = bus()
    build.rotor("wheel", "bus", mass=0.5, inertia=(0.01, 0.006), rate=20.0, **placement)
    return build


def rotation():
    return np.array(gs.symbols.rotation_matrix(TILT).tolist(), dtype=float)


def spin(model):
    """Return the angular momentum of the wheel in the axes of the bus, and its centre."""
    names = [str(q) for q in model.system.q]
    first, centre = names.index("wheel_q0"), names.index("wheel_x")
    q, p = model.q0[first : first + 4], model.p0[first : first + 4]
    in_space = rotation_matrix(q) @ left_matrix(q) @ p / 2
    return rotation().T @ in_space, model.q0[centre : centre + 3]


def test_an_axis_on_a_tilted_body_and_a_rotor_at_its_origin():
    momentum, _ = spin(satellite(axis_on_body=(0, 0, 2)).model())
    np.testing.assert_allclose(momentum, [0, 0, 0.2], atol=1e-15)
    momentum, _ = spin(satellite(axis_in_space=(0, 0, 1)).model())
    np.testing.assert_allclose(momentum, 0.2 * rotation()[2], atol=1e-15)
    _, centre = spin(satellite(axis_on_body=(1, 0, 0)).model())
    np.testing.assert_allclose(centre, [1, -2, 3], atol=1e-15)
    _, centre = spin(satellite(axis_on_body=(1, 0, 0), on_body=(0, 0.5, 0)).model())
    np.testing.assert_allclose(centre, rotation() @ [0, 0.5, 0] + [1, -2, 3], atol=1e-15)


def test_an_axis_is_given_in_one_way_and_reported_if_it_could_be_meant_on_the_body():
    with pytest.warns(InputWarning, match="axis_on_body"):
        satellite(axis=(0, 0, 1))
    satellite(axis=TILT[1:])  # about which the body is tilted: the same on the body
    for axes in ({}, {"axis": (0, 0, 1), "axis_on_body": (0, 0, 1)}):
        with pytest.raises(InputError, match="axis_on_body"):
            satellite(**axes)


@pytest.mark.parametrize("kind", [
    pytest.param(kind, marks=[pytest.mark.slow] * (kind in ("planar", "cylindrical")))
    for kind in HINGES])
def test_every_joint_takes_an_axis_on_its_body(kind):
    """An axis on the body makes the same model as in space, also where one body is the ground."""
    options = {"lead": 0.1} if kind == "screw" else {}
    options |= {} if kind == "align" else {"at": (1, -2, 3)}
    on_body = np.array([0.6, 0, 0.8])
    models = []
    for ends in (("bus", "arm"), ("ground", "bus")):
        for axis in ({"axis_on_body": on_body}, {"axis_in_space": rotation() @ on_body}):
            build = bus()
            build.body("arm", mass=1.0, inertia=(0.1, 0.2, 0.3), position=(1, -2, 3),
                       quaternion=(0.6, 0, 0.8, 0))
            getattr(build, kind)("joint", *ends, **axis, **options)
            models.append(build.model())
    for body_model, space_model in (models[:2], models[2:]):
        assert body_model.system.constraints == space_model.system.constraints
        values = [list(model.parameters.values()) for model in (body_model, space_model)]
        np.testing.assert_allclose(*values, atol=1e-15)
        np.testing.assert_allclose(body_model.p0, space_model.p0, atol=1e-15)


FILE = """
name = "satellite"
gravity = [0, 0, 0]
bodies = [
    {name = "bus", mass = 5, inertia = [0.3, 0.4, 0.5], position = [1, -2, 3], \
     quaternion = [0.5, 0.5, -0.1, 0.7], angular_velocity = [0, 0, 0]},
]
rotors = [
    {name = "wheel", bodies = ["bus"], mass = 0.5, inertia = [0.01, 0.006], \
     axis_on_body = [0, 0, 1], rate = 20},
]
"""


def test_axes_on_bodies_in_a_model_file(tmp_path):
    path = tmp_path / "satellite.toml"
    path.write_text(FILE)
    model, built = gs.load_model(path), satellite(axis_on_body=(0, 0, 1)).model()
    np.testing.assert_allclose(model.p0.astype(float), built.p0, atol=1e-15)
    np.testing.assert_allclose(model.q0.astype(float), built.q0, atol=1e-15)
    path.write_text(FILE.replace("axis_on_body", "axis"))
    with pytest.warns(InputWarning, match="axis_in_space"):
        gs.load_model(path)
