"""Redundant, contradicting and empty constraints are refused by name; others pass."""

import numpy as np
import pytest
import sympy as sp
from scipy.sparse import csr_array

import gyrospark as gs
from gyrospark.core.projection import as_dense
from gyrospark.generator.multibody.initial_poses import rotation
from gyrospark.generator.systems import redundant_constraints
from gyrospark.generator.systems.redundant_constraints import (
    _scale_columns,
    _units_of_columns,
    refuse_redundant_anywhere,
)

x, y, z, w, a, b, c, d = sp.symbols("x y z w a b c d", real=True)
k = sp.Symbol("k", positive=True)
SPHERE = x**2 + y**2 + z**2 - 1


def system(*constraints, parameters=(), names=()):
    H = (a**2 + b**2 + c**2 + d**2) / 2
    return gs.System((x, y, z, w), (a, b, c, d), parameters, H, constraints, name="plain",
                     constraint_names=names)


def four_bar(points, closed=True, unit=1.0):
    """Return the builder of a linkage through four points of the plane z = 0, in a unit of length.
    """
    build = gs.Multibody("linkage", gravity=(0, -9.81, 0))
    points = [np.array([*point, 0.0]) * unit for point in points]
    inertia = np.array([0.01, 0.02, 0.02]) * unit**2
    bars = [build.body(f"bar{i}", mass=1.0, inertia=inertia,
                       position=(points[i] + points[i + 1]) / 2) for i in range(3)]
    frames = [build.ground, *bars, build.ground]
    for i, point in enumerate(points if closed else points[:3]):
        build.revolute(f"hinge{i}", frames[i], frames[i + 1], axis=(0, 0, 1), at=point)
    return build


SQUARE = [(0, 0), (0.1, 0.4), (0.9, 0.8), (1.0, 0.0)]


def test_closed_loop_names_three_to_leave_out():
    """By Grübler, 4·5 equations on 3·6 freedoms leave mobility 1 with 20 − 17 = 3 redundant."""
    with pytest.raises(gs.InputError, match=r"3 of the 23 .*'linkage'") as caught:
        four_bar(SQUARE).model()
    message = str(caught.value)
    to_remove = message.split("Leave out ")[1].split(";")[0].replace("'", "").split(", ")
    assert to_remove == ["hinge3: z", "hinge3: axis 1", "hinge3: axis 2"]
    assert "'hinge0: x'" not in message  # equations in the plane do not take part
    assert "'hinge1: axis 2'" in message
    model = four_bar(SQUARE).model(without=to_remove)
    assert (model.system.n, model.system.m) == (21, 20)
    with pytest.raises(gs.InputError, match="1 of the 21 "):
        four_bar(SQUARE).model(without=to_remove[:2])
    assert four_bar(SQUARE, closed=False).model().system.m == 18


@pytest.mark.parametrize("unit", [2.0**-33, 2.0**33])
def test_redundant_constraints_are_those_of_any_unit_of_length(unit):
    """The parts of a row, of positions and of quaternions, are not round-off of each other."""
    with pytest.raises(gs.InputError) as caught:
        four_bar(SQUARE).model()
    with pytest.raises(gs.InputError) as again:
        four_bar(SQUARE, unit=unit).model()
    assert str(again.value) == str(caught.value)


def test_units_of_sparse_rows_are_those_of_dense_ones():
    G, lengths = np.array([[1e7, 0, 1.0], [0, 2.0, 0], [3e6, 1.0, 0]]), np.array([0, 0, 1]) > 0
    for rows in (G, csr_array(G)):
        units = _units_of_columns(rows, lengths)
        assert units.tolist() == [1, 1, 1e7]
        assert np.array_equal(as_dense(_scale_columns(rows, units)), G * units)


@pytest.mark.parametrize("far", [1.5, 5.0])
def test_points_that_cannot_meet_contradict_each_other(far):
    """Two points of a body 1 m apart cannot be held at points of another distance."""
    build = gs.Multibody("held")
    body = build.body("bar", mass=1, inertia=(1, 1, 1))
    build.ball("one", build.ground, body, on_a=(0, 0, 0), on_b=(0, 0, 0))
    build.ball("two", build.ground, body, on_a=(far, 0, 0), on_b=(1, 0, 0))
    with pytest.raises(gs.InputError, match="'two: x' of 'held' contradict"):
        build.model()


def test_what_is_redundant_is_left_out_when_asked():
    """Redundant rows are left out as by name; a singular position is refused all the same."""
    build = four_bar(SQUARE)
    model = build.model(redundant="leave out")
    assert (model.system.n, model.system.m) == (21, 20)
    assert build.redundancy.left_out == ("hinge3: z", "hinge3: axis 1", "hinge3: axis 2")
    assert "hinge0: x" not in build.redundancy.involved
    again = four_bar(SQUARE, closed=False)
    assert again.model(redundant="leave out").system.m == 18
    assert str(again.redundancy).startswith("The 18 constraints of 'linkage' ")
    stretched = four_bar([(0, 0), (0.5, 0), (1.5, 0), (1.0, 0)])
    with pytest.raises(gs.InputError, match='redundant="leave out"'):
        four_bar(SQUARE).model()
    for redundant in ("refuse", "leave out"):
        with pytest.raises(gs.InputError, match="singular position"):
            stretched.model(redundant=redundant)


@pytest.mark.parametrize("factor", [1, -3, k])
def test_a_constraint_twice(factor):
    twice = system(SPHERE, factor * SPHERE, parameters=(k,), names=("ball", "again"))
    with pytest.raises(gs.InputError, match=r"1 of the 2.*'again'.*'ball', 'again'"):
        refuse_redundant_anywhere(twice)
    with pytest.raises(gs.InputError, match="Leave out 'again'"):
        gs.stepper("IMS", system=twice)


def test_dependence_on_the_manifold_only_and_independent_constraints():
    # (g₁, g₂, g₁g₂ + g₁): the third has another gradient everywhere but where g = 0.
    plane = x + 2 * y - z + w
    with pytest.raises(gs.InputError, match=r"redundant.*'g2'"):
        refuse_redundant_anywhere(system(SPHERE, plane, SPHERE * plane + SPHERE))
    for constraints in ((SPHERE,), (SPHERE, x - k * y), (SPHERE, x * y * z - k / 9, w - z**2), ()):
        refuse_redundant_anywhere(system(*constraints, parameters=(k,)))
    refuse_redundant_anywhere(gs.models.four_bar().system)


def test_contradicting_constraints_and_constants_are_named_before_they_are_counted():
    for names, constraints in ((("one", "two"), (x - 1, x - 2)), (("k", "two"), (x - k, x - 2))):
        with pytest.raises(gs.InputError, match=r"'two'.*contradict"):
            gs.System((x,), (sp.Symbol("u", real=True),), (k,), sp.Symbol("u", real=True)**2 / 2,
                      constraints, constraint_names=names)
    with pytest.raises(gs.InputError, match=r"'g0', 'g1'.*contradict"):
        refuse_redundant_anywhere(system(SPHERE, SPHERE - 1))
    with pytest.raises(gs.InputError, match=r"'g1'.*always"):
        refuse_redundant_anywhere(system(SPHERE, sp.Integer(0)))
    with pytest.raises(gs.InputError, match=r"'g1'.*reads 2 = 0"):
        refuse_redundant_anywhere(system(SPHERE, (x + 1) ** 2 - x**2 - 2 * x + 1))


def test_a_body_held_twice():
    """Two ball joints to the ground leave a turn; a third one takes it with two redundant rows."""
    build = gs.Multibody("door", gravity=(0, 0, 0))
    door = build.body("door", mass=1, inertia=(1, 1, 1))
    for i, point in enumerate([(0, 0, 1), (0, 0, -1), (1, 0, 0)]):
        build.fixed_point(f"pin{i}", door, at=point)
        if i == 1:
            with pytest.raises(gs.InputError, match=r"1 of the 7.*'pin1: z'"):
                build.model()
    with pytest.raises(gs.InputError, match="3 of the 10"):
        build.model()


def test_what_varies_is_not_multiplied_out(monkeypatch):
    """Products of twelve sums, a minute to expand, stay as they are; constants are still seen."""
    x = sp.symbols("x0:12", real=True)
    long = sp.prod(a + b**2 for a, b in zip(x, x[1:] + x[:1], strict=True)) - 3
    hidden = (x[0] + 1)**2 - x[0]**2 - 2 * x[0] - 1
    with pytest.raises(gs.InputError, match="g1"):
        redundant_constraints.refuse_constant("s", [long, hidden], ["g0", "g1"])
    monkeypatch.setattr(redundant_constraints.sp, "expand", lambda e: pytest.fail("multiplied out"))
    redundant_constraints.refuse_constant("s", [long], ["g0"])


def test_constraints_on_parameters_and_greek_symbols_are_refused():
    x, px, k = sp.symbols("x px k", real=True)
    with pytest.raises(gs.InputError, match=r"'g0'.*k - 1 = 0.*coordinate"):
        gs.stepper("G-L", 2, system=gs.System((x,), (px,), (k,), px**2 / 2 + x, (k - 1,)))
    angle = sp.Symbol("α_1", real=True)
    with pytest.raises(gs.InputError, match=r"'α_1'.*Symbol\('alpha_1'\)"):
        gs.System((angle,), (a,), (), a**2 / 2)


@pytest.mark.parametrize("turn", [0.5, 1.4, 1.7, np.pi])
def test_a_fixed_rotation_is_met_or_refused(turn):
    """A far start is refused: its three constraints hold at half a turn more, too."""
    build = gs.Multibody("doors")
    a, b = (build.body(name, mass=1, inertia=(0.1, 0.2, 0.3)) for name in "ab")
    for body in (a, b):
        build.revolute(f"hinge_{body.name}", "ground", body, at=(0, 0, 0), axis=(0, 0, 1))
    relative = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0],
                         [0, 0, 1]])
    build.fixed("both", a, b, on_a=(0, 0, 0), on_b=(0, 0, 0), rotation=relative)
    if turn > np.pi / 2:
        with pytest.raises(gs.InputError, match="'both'"):
            build.model(redundant="leave out")
        return
    model = build.model(redundant="leave out")
    R_a, R_b = (rotation(q) for q in np.reshape(model.q0, (2, 7))[:, :4])
    assert np.allclose(R_a.T @ R_b, relative, rtol=0, atol=1e-14)
