"""What ``stepper`` and ``tableau`` take, and what they refuse."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from calls import refused
from gyrospark import api
from gyrospark.api import stepper_of
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from processes import ROOT


@pytest.mark.parametrize(("arguments", "words"), [
    (("RK4",), "'RK4'.*LIIIA-B, Radau-L or splitting"), (("RK4",), "'RK4'.*tableau"),
    ((3,), "3.*IMS"),
    (("G-L", 0), "0.*1 to 16"), (("G-L", -1), "-1"),
    (("G-L", 17), "17.*16"), (("G-L", "three"), "'three'"), (("G-L", 2.5), "2.5.*whole"),
    (("G-L", True), "True.*whole"), (("LIIIA-B", 1), "1.*2 to 16"), (("IMS", 2), "no stages"),
    (("IMS", None, "beta"), "'beta'.*gamma"),
], ids=str)
def test_unusable_stepper_choice_is_refused(arguments, words):
    with refused(words):
        gs.stepper(*arguments)


def test_whole_numbers_of_any_type_count_stages():
    for two in (np.int64(2), 2.0, np.float32(2)):
        assert gs.stepper("G-L", two).name == "heavy_top_gl2_gamma"


def test_problems_of_a_sweep_have_the_stepper_of_the_process():
    assert stepper_of(Spec.from_arguments("G-L", 2)) is stepper_of(Spec.from_arguments("G-L", 2))


def test_unusable_system_and_tableau_are_refused():
    tableau = gs.tableau("G-L", 2)
    pendulum = gs.System(sp.symbols("x:2"), sp.symbols("y:2"), (),
                         H=sum(y**2 for y in sp.symbols("y:2")) / 2,
                         constraints=[sum(x**2 for x in sp.symbols("x:2")) - 1], name="p")
    for options, words in [
        ({"scheme": "IMS", "system": "car"}, "'car'.*heavy_top, free_body.*model file"),
        ({"scheme": "IMS", "system": 42}, "42"),
        ({"scheme": "IMS", "real": "quad"}, "'quad'.*double"),
        ({"tableau": tableau, "real": "quad"}, "'quad'"),
        ({"tableau": tableau, "rep": "beta"}, "'beta'"),
        ({"tableau": tableau, "system": "car"}, "'car'"),
        ({"tableau": tableau, "scheme": "G-L"}, "leave out"),
        ({"tableau": tableau, "stages": 2}, "leave out"),
        ({"tableau": 42}, "42"),
        ({"tableau": [[1]]}, "tableau"),
        ({"tableau": "none.json"}, "'none.json'"),
        ({"tableau": "none.json", "scheme": "IMS"}, "leave out"),
        ({"scheme": "IMS", "system": pendulum, "rep": "gamma"}, "rep"),
    ]:
        with refused(words):
            gs.stepper(**options)


def test_tableau_object_goes_with_any_named_system(monkeypatch):
    """As the named scheme does; free_body is not silently taken for heavy_top."""
    tableau = gs.tableau(ROOT / "examples" / "tableaux" / "radau_plain_2.json")
    source = generate(Spec.of_tableau("gamma", "free_body"), tableau=tableau).source
    monkeypatch.setattr(api, "stepper_of", lambda *given, **more: given)
    spec, system, of_object = gs.stepper(tableau=tableau, system="free_body", rep="gamma")[:3]
    assert (spec.system, system, of_object) == ("free_body", None, tableau)
    assert source.name.startswith("free_body_")
    assert set(json.loads(source.manifest)["system"]["parameters"]) == {"I1", "I2", "I3", "gamma"}


def test_unusable_tableau_request_is_refused():
    for arguments, words in [(("IMS",), "SPARK"), (("G-L", 0), "1 to 16"), (("RK4", 4), "'RK4'"),
                             (("none.json",), "'none.json'"), ((Path("none"),), "'none'"),
                             ((ROOT / "examples/tableaux/gauss_lobatto_2.json", 2), "leave out")]:
        with refused(words):
            gs.tableau(*arguments)
