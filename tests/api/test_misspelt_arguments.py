"""A wrong argument or an absent name is refused in a sentence with the nearest name."""

from __future__ import annotations

import importlib
import inspect
import pickle
import pkgutil
import re

import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import RUN, TOP
from gyrospark.core.errors import ArgumentError
from gyrospark.core.former_names import FORMER_NAMES
from gyrospark.generator.tableaux.tableau import Tableau
from result_classes import RESULT_CLASSES, result_class

MODULES = [name for name in gs.__all__ if inspect.ismodule(getattr(gs, name))]
CLASSES = [thing for thing in (getattr(gs, name) for name in gs.__all__)
           if inspect.isclass(thing) and not issubclass(thing, BaseException)]
CLASSES += map(result_class, RESULT_CLASSES)


def functions():
    """Yield every public function, and every method of a public class with a self that is none."""
    for name in gs.__all__:
        public = getattr(gs, name)
        if inspect.isfunction(public):
            yield public, ()
        if inspect.ismodule(public):
            yield from ((getattr(public, name_of_function), ())
                        for name_of_function in public.__all__
                        if inspect.isfunction(getattr(public, name_of_function)))
    for cls in (*CLASSES, Tableau, gs.problems.Problem):
        for name in dir(cls):
            member = inspect.getattr_static(cls, name)
            if not name.startswith("_") or name == "__init__":
                if inspect.isfunction(member):
                    yield member, (object(),)
                elif isinstance(member, (classmethod, staticmethod)):
                    yield getattr(cls, name), ()


def test_every_public_function_refuses_a_misspelt_argument_by_a_sentence():
    checked = 0
    for function, itself in functions():
        kinds = {parameter.kind for parameter in inspect.signature(function).parameters.values()}
        if inspect.Parameter.VAR_KEYWORD in kinds:
            continue
        with pytest.raises(ArgumentError, match="misspelt_by_purpose"):
            function(*itself, misspelt_by_purpose=1)
        checked += 1
    assert checked > 150


def test_the_nearest_name_is_proposed(gl3):
    for call, proposal in (
            (lambda: gl3.integrate(TOP.q0, TOP.p0, tend=1.0, **RUN), "t_end"),
            (lambda: gs.lyapunov(gl3, TOP.q0, TOP.p0, cuont=2, steps=3, **RUN), "count"),
            (lambda: gs.stepper(skeme="G-L"), "scheme"),
            (lambda: gs.Event("q1", lvel=3.0), "level"),
            (lambda: gs.models.double_pendulum(lenght=3), "double_pendulum")):
        with pytest.raises(gs.InputError, match=proposal):
            call()
        with pytest.raises(TypeError):  # as of any other function
            call()


def test_missing_and_surplus_arguments_are_named(gl3):
    for call, argument in ((lambda: gl3.step(TOP.q0, TOP.p0), "dt"),
                           (lambda: gl3.integrate(TOP.q0, TOP.p0, 1e-3, 3), "2 .* 4"),
                           (lambda: gl3.integrate(TOP.q0, q=TOP.q0), "without names"),
                           (lambda: gs.Start.of_body(TOP.q0, attitude=TOP.q0), "'attitude' twice")):
        with pytest.raises(ArgumentError, match=argument):
            call()


def test_errors_from_within_stay_what_they_are():
    with pytest.raises(TypeError) as failure:
        gs.Start.of_body(TOP.inertia, TOP.q0)
    assert isinstance(failure.value, ArgumentError)
    with pytest.raises(ZeroDivisionError):
        gs.fit(*([None] * 3), 1 / 0, parameters=None)


def test_functions_keep_their_signature_and_their_place():
    assert "t_end" in inspect.signature(gs.Stepper.integrate).parameters
    assert gs.fit is importlib.import_module(gs.fit.__module__).fit
    assert pickle.loads(pickle.dumps(gs.fit)) is gs.fit


@pytest.mark.parametrize(("module", "name", "meant"), [
    (gs, "steper", "stepper"), (gs.problems, "fasttop", "fast_top"),
    (gs.models, "doublependulum", "double_pendulum"), (gs.exact, "freebody", "free_body")])
def test_an_absent_name_has_the_nearest(module, name, meant):
    with pytest.raises(AttributeError, match=meant):
        getattr(module, name)
    assert not hasattr(module, name)


@pytest.mark.parametrize("name", FORMER_NAMES)
def test_a_former_name_is_refused_with_its_replacement(name):
    with pytest.raises(AttributeError, match=rf"\b{name}\b.*gyrospark") as failure:
        getattr(gs, name)
    present = re.findall(r"gyrospark[.\w]*\w", str(failure.value))[-1]
    assert callable(pkgutil.resolve_name(present))
    assert not hasattr(gs, name)


def test_a_system_without_parameters_needs_none():
    """Calls need no parameters of it; for a system with parameters the missing ones are named."""
    step, q, p = systems.stepper("swing", "EMS"), np.array([1.0]), np.zeros(1)
    run = step.integrate(q, p, dt=0.1, steps=3)
    assert np.array_equal(run.q, step.integrate(q, p, dt=0.1, steps=3, parameters={}).q)
    assert step.energy(q, p) == pytest.approx(9 * (1 - np.cos(1)))
    assert step.start(q, p, dt=0.1).steps == 0
    assert step.integrate_ensemble([q], [p], dt=0.1, steps=3).q.shape == (1, 4, 1)
    assert np.array_equal(gs.consistent(step, q, p).q, q)
    for function, _itself in functions():
        parameter = inspect.signature(function).parameters.get("parameters")
        if parameter is not None and parameter.kind is parameter.KEYWORD_ONLY:
            assert parameter.default is not parameter.empty, function.__qualname__
    with pytest.raises(gs.InputError, match="I1"):
        gs.stepper("G-L", 3).integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1)
