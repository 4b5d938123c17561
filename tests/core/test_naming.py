"""One registry for each kind of name: lists agree, and a wrong name gets the closest match."""

from __future__ import annotations

import inspect
import re
from dataclasses import replace
from types import ModuleType
from typing import get_args

import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.commands.verify import spec_of_name
from gyrospark.core import arguments
from gyrospark.core.inertia import REPS, RepName
from gyrospark.core.real_types import REALS, RealName
from gyrospark.core.registry import AIMS, MODELS, PROBLEMS, SYSTEMS, Aim, entry_named
from gyrospark.generator.models.formulas import parse_formula
from gyrospark.generator.pipeline import generate, tableau_of
from gyrospark.generator.schemes.named_schemes import SCHEMES, SchemeName
from gyrospark.generator.spec import Spec
from gyrospark.runtime.bindings.binding import SOLVERS, SolverName

TOP = gs.problems.fast_top()


@pytest.mark.parametrize(("names", "records"), [
    (SchemeName, SCHEMES), (RealName, REALS), (RepName, REPS), (SolverName, SOLVERS),
    (Aim, AIMS.values()),
], ids=["scheme", "real", "rep", "solver", "aim"])
def test_literals_are_the_records(names, records):
    """The names that editors complete are the accepted names, in the same order."""
    assert get_args(names) == tuple(records)


def test_a_scheme_of_one_number_of_stages_is_called_by_its_name(monkeypatch):
    """Its stages may be left out, and are in no name; a family needs them."""
    scheme = replace(SCHEMES["LIIIA-B"], name="RATTLE", most=2)
    monkeypatch.setitem(SCHEMES, "RATTLE", scheme)
    spec = Spec.from_arguments("RATTLE")
    assert (spec.stages, spec.method, spec.title) == (2, "rattle", "RATTLE")
    assert spec == Spec.from_arguments("RATTLE", 2)
    assert spec_of_name("heavy_top_rattle_gamma") == spec
    with pytest.raises(gs.InputError, match=r"RATTLE.* 2 "):
        Spec.from_arguments("RATTLE", 3)
    assert tableau_of(spec).A == tableau_of(Spec.from_arguments("LIIIA-B", 2)).A
    assert Spec.from_arguments("LIIIA-B", 2).title == "2-LIIIA-B"


def test_what_lists_names_lists_all_of_them(gyrospark):
    """Help and the docstrings of the calls list all names; for refusals see below."""
    help_text = "".join(gyrospark("run", "--help").stdout.split())
    for name in (*PROBLEMS, *MODELS, *SCHEMES, *REALS, *SOLVERS):
        assert name in help_text
    for name in (*SCHEMES, *REALS, *REPS):
        assert f'"{name}"' in gs.stepper.__doc__


def test_public_modules_offer_what_is_theirs():
    """gs.problems.<Tab> has no numpy and no math."""
    for module in (getattr(gs, name) for name in gs.__all__):
        if isinstance(module, ModuleType) and module is not gs.interop:  # a package of modules
            assert set(dir(module)) == set(module.__all__)
            assert not any(isinstance(getattr(module, x), ModuleType) for x in dir(module))


def test_catalogue_is_what_python_offers():
    def makers(module):
        objects = [getattr(module, name) for name in module.__all__]
        return {f.__name__ for f in objects if inspect.isfunction(f)
                and f.__annotations__["return"] in ("Problem", "Model")}

    assert makers(gs.problems) == {name.replace("-", "_") for name in PROBLEMS}
    assert makers(gs.models) == set(MODELS)
    for name, entry in PROBLEMS.items():
        assert entry.make().name == name
        assert SYSTEMS[entry.make().system].make("gamma").name == entry.make().system


def test_names_are_taken_with_either_sign():
    for name in (*PROBLEMS, *MODELS):
        for spelt in (name.replace("_", "-"), name.replace("-", "_")):
            assert entry_named(spelt).name == name


@pytest.mark.parametrize("refuse", [entry_named, lambda name: gs.stepper("IMS", system=name)])
@pytest.mark.parametrize(("name", "meant"), [
    ("satellite_with_wheel", "examples/satellite_with_wheel.toml"),
    ("slider-crank", "examples/slider_crank.toml"), ("satelite", "satellite"),
    ("double-tops", "double_top")])
def test_an_example_that_is_a_file_is_proposed_as_one(refuse, name, meant):
    with pytest.raises(gs.InputError, match=re.escape(f"{meant}?")):
        refuse(name)


def test_a_system_in_no_registry_is_refused():
    with pytest.raises(gs.InputError, match=r"'spinning_top'.*heavy_top"):
        replace(TOP, system="spinning_top")


@pytest.mark.parametrize("scheme", ["RK4", "SPARK", None, ["G-L"]])
def test_an_unknown_scheme_never_becomes_ims(scheme):
    """A spec from ``Spec`` itself is checked, too."""
    spec = Spec(scheme, 2)
    for use in (tableau_of, generate, lambda spec: spec.name):
        if scheme == "SPARK" and use not in (tableau_of, generate):
            continue  # a given tableau's
        with pytest.raises(gs.InputError, match=r"scheme.*IMS, EMS, G-L,"):
            use(spec)


@pytest.mark.parametrize(("call", "words"), [
    (lambda: gs.stepper("GL", 3), r"'GL'.*IMS.*G-L\?\)\.$"),
    (lambda: gs.stepper("liiia-b", 3), r"LIIIA-B\?"),
    (lambda: gs.stepper("G-L", 3, "gama"), r"'gama'.*gamma\?"),
    (lambda: gs.stepper("G-L", 3, real="long_double"), r"long-double\?"),
    (lambda: gs.stepper("G-L", 3, system="Heavy-Top"), r"heavy_top\?"),
    (lambda: gs.stepper("G-L", 3, system="double_pendlum"), r"double_pendulum\?"),
    (lambda: gs.stepper("G-L", 3, system="fast-top"), r"fast-top.*heavy_top\."),
    (lambda: gs.tableau("Lobatto", 3), r"'Lobatto'.*IMS, EMS, G-L, LIIIA-B.*Radau-L.*\.$"),
    (lambda: gs.certify(TOP, "EMX"), r"EMS\?"),
    (lambda: gs.sweep("fast-topp", {"mgl": [1]}, scheme="IMS"), r"fast-top\?"),
    (lambda: gs.sweep(TOP, {"mlg": [1]}, scheme="IMS", dt=1, steps=1), "'mlg'"),
    (lambda: gs.sweep(TOP, {"mgl": [1]}, scheme="GL 3", dt=1, steps=1), r"G-L\?"),
    (lambda: gs.Multibody("m").body("a", mass=1, inertia=(1, 1, 1), rep="alfa"), "mean alpha"),
    (lambda: parse_formula("2*lenght", {"length": sp.Symbol("length")}), r"lenght.*length\?"),
], ids=range(14))
def test_a_wrong_name_ends_in_the_allowed_ones_and_a_proposal(call, words):
    with pytest.raises(gs.InputError, match=words):
        call()


def test_wrong_names_of_a_run_are_proposed_for(gl3):
    parameters = TOP.parameters | {"gamma": 1e-3}
    run = {"dt": 1e-3, "steps": 2, "parameters": parameters}
    for changed, words in [({"solver": "newtn"}, r"newton\?"),
                           ({"parameters": parameters | {"gama": 1}}, r"gamma\?")]:
        with pytest.raises(gs.InputError, match=words):
            gl3.integrate(TOP.q0, TOP.p0, **run | changed)
    trajectory = gs.stepper("IMS").integrate(TOP.q0, TOP.p0, **run)
    with pytest.raises(gs.InputError, match=r"'heavy_top'.*'bdy'.*body"):
        trajectory.axis("bdy")


def test_proposals_are_near():
    assert arguments.proposal("xyz", ["IMS", "EMS"]) == ""
    assert arguments.proposal(3, ["IMS"]) == arguments.proposal("a", []) == ""
    assert arguments.proposal("g l", ["G-L"]).endswith(" G-L?)")
    assert arguments.join_or(["a"]) == "a"


def test_what_a_shell_completes():
    from gyrospark.commands.run.command import run

    options = {o.name: o for o in run.params}
    for name, text, expected in [("scheme", "", list(SCHEMES)), ("scheme", "L", ["LIIIA-B"]),
                                 ("rep", "g", ["gamma"]),
                                 ("real", "f", [name for name in REALS if name[0] == "f"])]:
        items = options[name].shell_complete(None, text)
        assert [item.value for item in items] == expected
