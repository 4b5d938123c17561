"""Ensembles and threads."""

from __future__ import annotations

import pickle
from fractions import Fraction

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP, equal, refused


def members(count=6):
    """Return starts, time steps and parameters of different members."""
    rng = np.random.default_rng(3)
    q = rng.standard_normal((count, 4))
    q /= np.linalg.norm(q, axis=1)[:, None]
    q /= np.linalg.norm(q, axis=1)[:, None]
    omega = rng.standard_normal((count, 3)) * 20
    p = np.array([gs.Start.of_body(*state, TOP.inertia).p for state in zip(q, omega, strict=True)])
    step = systems.stepper("heavy_top")
    states = [step.project(*state, parameters=PARAMETERS) for state in zip(q, p, strict=True)]
    q, p = (np.array(values) for values in zip(*states, strict=True))
    return q, p, np.linspace(1e-4, 1e-3, count), np.linspace(0.5, 2, count) * PARAMETERS["gamma"]


def test_ensemble_of_newton_equals_single_runs_bit_for_bit(step):
    q, p, dts, gammas = members()
    run = {"steps": 20, "every": 3, "solver": "newton"}
    ensemble = step.integrate_ensemble(q, p, dt=dts, parameters=PARAMETERS | {"gamma": gammas},
                                       **run)
    from_list = step.integrate_ensemble(q, p, dt=dts, workers=2,
                                        parameters=[PARAMETERS | {"gamma": g} for g in gammas],
                                        **run)
    assert len(ensemble) == 6
    assert not ensemble.failures
    assert ensemble.q.shape == ensemble.p.shape == (6, 8, 4)
    assert ensemble.t.shape == (6, 8)
    assert ensemble.multipliers.shape == (6, 7, step.manifest.scheme.multipliers)
    assert ensemble.iterations.shape == (6, 7)
    for i in range(6):
        single = step.integrate(q[i], p[i], dt=dts[i], parameters=PARAMETERS | {"gamma": gammas[i]},
                                **run)
        assert equal(ensemble.members[i], single)
        assert equal(from_list.members[i], single)
        for name in ("t", "q", "p", "multipliers", "iterations"):
            assert np.array_equal(getattr(ensemble, name)[i], getattr(single, name))


@pytest.mark.parametrize("count", [1, 11])
def test_a_trajectory_does_not_depend_on_its_neighbours(step, count):
    """Lanes share instructions only: any number of neighbours, any order, same bits."""
    q, p, dts, gammas = members(count)
    run = {"steps": 90, "every": 7}
    ensemble = step.integrate_ensemble(q, p, dt=dts, parameters=PARAMETERS | {"gamma": gammas},
                                       **run)
    reversed_order = step.integrate_ensemble(q[::-1], p[::-1], dt=dts[::-1], workers=1,
                                             parameters=PARAMETERS | {"gamma": gammas[::-1]}, **run)
    for i in range(count):
        parameters = PARAMETERS | {"gamma": gammas[i]}
        batch_of_one = step.integrate_ensemble(q[i : i + 1], p[i : i + 1], dt=dts[i],
                                               parameters=parameters, **run)
        assert equal(ensemble.members[i], batch_of_one.members[0])
        assert equal(ensemble.members[i], reversed_order.members[count - 1 - i])
        assert ensemble.members[i].report == batch_of_one.members[0].report
        single = step.integrate(q[i], p[i], dt=dts[i], parameters=parameters, **run)
        assert np.abs(single.q - ensemble.q[i]).max() < 1e-13
        assert np.abs(single.p - ensemble.p[i]).max() < 1e-13 * np.abs(p[i]).max()


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_failing_member_does_not_touch_the_others(gl3):
    q, p, dts, _ = members()
    dts[2] = 5.0
    ensemble = gl3.integrate_ensemble(q, p, dt=dts, steps=12, parameters=PARAMETERS)
    failing = gl3.integrate_ensemble(q[2:3], p[2:3], dt=5.0, steps=12, parameters=PARAMETERS)
    failure, caught = ensemble.failures[2], failing.failures[0]
    assert list(ensemble.failures) == [2]
    assert (failure.step, failure.reason) == (caught.step, caught.reason)
    rows = failure.step
    assert np.array_equal(ensemble.q[2, :rows], caught.trajectory.q)
    assert np.isnan(ensemble.q[2, rows:]).all()
    assert np.isnan(ensemble.t[2, rows:]).all()
    assert np.isnan(ensemble.multipliers[2, rows - 1:]).all()
    assert not ensemble.iterations[2, rows - 1:].any()
    for i in (0, 1, 3, 4, 5):
        single = gl3.integrate_ensemble(q[i : i + 1], p[i : i + 1], dt=dts[i], steps=12,
                                        parameters=PARAMETERS)
        assert equal(ensemble.members[i], single.members[0])


def test_unusable_member_is_named(gl3):
    q, p, dts, gammas = members()
    gammas[3] = 0
    with refused("Trajectory 3.*gamma"):
        gl3.integrate_ensemble(q, p, dt=dts, steps=3, parameters=PARAMETERS | {"gamma": gammas})
    dts[4] = np.nan
    with refused("Trajectory 4: dt"):
        gl3.integrate_ensemble(q, p, dt=dts, steps=3, parameters=PARAMETERS)
    q[1] *= 1.1
    with refused("Trajectory 1.*start"):
        gl3.integrate_ensemble(q, p, dt=1e-3, steps=3, parameters=PARAMETERS)


@pytest.mark.parametrize(("change", "words"), [
    ({"gamma": "auto"}, "Trajectory 3.*gamma = 'auto'.*tune"),
    ({"gamma": np.inf}, "Trajectory 3.*gamma = inf"),
    ({"gamma": 10**400}, "Trajectory 3.*gamma = 1000"),
    ({"I2": -1.0}, r"Trajectory 3.*I2 = -1\.0"),
    ({"delta": 1.0}, "Trajectory 3.*'delta'"),
    ({"I3": None}, "Trajectory 3.*I3 = None"),
], ids=str)
def test_unusable_parameters_are_those_of_a_trajectory(change, words, gl3):
    q, p, dts, _ = members()
    sets = [PARAMETERS] * 3 + [PARAMETERS | change] + [PARAMETERS] * 2
    with refused(words):
        gl3.integrate_ensemble(q, p, dt=dts, steps=3, parameters=sets)
    sets[3] = {name: x for name, x in PARAMETERS.items() if name != "I1"}
    with refused("Trajectory 3.*'I1'"):
        gl3.integrate_ensemble(q, p, dt=dts, steps=3, parameters=sets)


def test_plain_numbers_are_checked_all_at_once(gl3, monkeypatch):
    """One check covers the numbers that all members share, and not one check each."""
    looks, check = [], type(gl3)._checked_run
    monkeypatch.setattr(type(gl3), "_checked_run",
                        lambda *arguments, **options: looks.append(0)
                        or check(*arguments, **options))
    q, p, dts, gammas = members(40)
    columns, run = PARAMETERS | {"gamma": gammas}, {"dt": dts, "steps": 3}
    ensemble = gl3.integrate_ensemble(q, p, parameters=columns, **run)
    assert len(looks) == 1
    for sets in ([PARAMETERS | {"gamma": g} for g in gammas],
                 [PARAMETERS | {"gamma": Fraction(g)} for g in gammas]):
        from_list = gl3.integrate_ensemble(q, p, parameters=sets, **run)
        assert np.array_equal(from_list.q, ensemble.q)
    assert len(looks) == 1 + 1 + 40
    inertia = PARAMETERS | {"I2": PARAMETERS["I2"] * np.linspace(0.9, 1.1, 40)}
    del inertia["gamma"]
    gammas_of_I2 = [gs.gamma([inertia["I1"], I2, inertia["I3"]]) for I2 in inertia["I2"]]
    ruled = gl3.integrate_ensemble(q, p, parameters=inertia, **run)
    with_gamma = gl3.integrate_ensemble(q, p, parameters=inertia | {"gamma": gammas_of_I2}, **run)
    assert np.array_equal(ruled.q, with_gamma.q)
    assert len(looks) == 1 + 1 + 40 + 2


def test_remarks_on_members_are_made(gl3):
    q, p, dts, gammas = members()
    gammas[4] *= -1
    with pytest.warns(gs.errors.InputWarning, match="gamma = -"):
        gl3.integrate_ensemble(q, p, dt=dts, steps=1, parameters=PARAMETERS | {"gamma": gammas})


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_members_are_made_when_they_are_asked_for(gl3):
    """Members come from the stored rows, whatever becomes of the arrays; also from a pickle."""
    q, p, dts, _ = members()
    dts[2] = 5.0
    run = {"dt": dts, "steps": 12, "parameters": PARAMETERS}
    ensemble, overwritten = gl3.integrate_ensemble(q, p, **run), gl3.integrate_ensemble(q, p, **run)
    assert "members" not in vars(ensemble)
    unpickled = pickle.loads(pickle.dumps(ensemble))
    overwritten.q[:] = 0
    for i in range(6):
        assert equal(ensemble.members[i], unpickled.members[i])
        assert equal(ensemble.members[i], overwritten.members[i])
        assert ensemble.members[i].report == unpickled.members[i].report
        rows = len(ensemble.members[i])
        assert np.array_equal(ensemble.q[i, :rows], ensemble.members[i].q)
    assert ensemble.members is ensemble.members
    assert ensemble.members[2] is ensemble.failures[2].trajectory


def test_defects_with_parameters_of_their_own_are_those_one_by_one(step):
    q, p, _, _ = members()
    binding = step.binding
    names = binding.parameter_names
    columns = {name: np.full(6, PARAMETERS.get(name, 1.0)) for name in names}
    columns[names[0]] *= np.linspace(1, 2, 6)
    sets = binding.parameter_sets(columns, np.zeros(6))
    p = p * np.linspace(1, 2, 6)[:, None] + 0.25  # no longer on the constraints
    for repeats in (1, 2):
        defects = binding.defects(sets, np.repeat(q, repeats, axis=0),
                                  np.repeat(p, repeats, axis=0))
        for i in range(6):
            parameters = binding.parameters({name: float(columns[name][i]) for name in names})
            single_defects = binding.defects(parameters, q[i : i + 1], p[i : i + 1])
            for joint_defects, single_defect in zip(defects, single_defects, strict=True):
                assert np.array_equal(joint_defects[i * repeats : (i + 1) * repeats],
                                      [single_defect[0]] * repeats)


@pytest.mark.parametrize(("changes", "words"), [
    ({"q": [1, 0, 0, 0]}, "q has shape"), ({"q": np.zeros((5, 4))}, "shapes"),
    ({"q": np.zeros((0, 4)), "p": np.zeros((0, 4))}, "shapes"),
    ({"q": [[1, 0], [1]]}, "^q.*0 has 2.*1 has 1"), ({"dt": [1e-3] * 5}, "^dt has shape"),
    ({"dt": [1j] * 6}, "^dt "), ({"dt": [[1e-3] * 6]}, "^dt has shape"),
    ({"parameters": 3}, "parameters"), ({"parameters": [PARAMETERS] * 5}, "5 sets"),
    ({"parameters": [1] * 6}, "parameters"),
    ({"parameters": PARAMETERS | {"gamma": [1.0] * 5}}, "gamma.*shape"),
], ids=str)
def test_unusable_ensemble_argument_is_refused(changes, words, gl3):
    q, p, _, _ = members()
    options = {"q": q, "p": p, "dt": 1e-3, "steps": 3, "parameters": PARAMETERS} | changes
    with refused(words):
        gl3.integrate_ensemble(options.pop("q"), options.pop("p"), **options)


def test_ensemble_stops_when_one_member_is_refused(gl3):
    """The other members do not run to their end: this would take hours."""
    q, p, _, _ = members(2)
    q[1] *= 1.1
    with refused("Trajectory 1"):
        gl3.integrate_ensemble(q, p, dt=1e-5, steps=10**9, every=10**9, parameters=PARAMETERS,
                               workers=2)
