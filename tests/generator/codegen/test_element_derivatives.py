"""Derivatives of systems whose C loops over the instances of element templates."""

import json
import re

import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec


@pytest.mark.parametrize("scheme", [("G-L", 2), ("IMS", None)], ids=["SPARK", "IMS"])
def test_constants_of_h_have_no_derivatives(scheme):
    """The constant in H of a preloaded spring is a template without coordinates."""
    x, y, px, py = sp.symbols("x y px py", real=True)
    m, k = sp.symbols("m k", positive=True)
    H = (px**2 + py**2) / (2 * m) + k * x * y + k / 2
    system = gs.System((x, y), (px, py), (m, k), H, [x**2 + y**2 - 1], name="preloaded")
    generated = generate(
        Spec.from_arguments(*scheme), system=system, derivatives=True, structured=True)
    assert "preloaded" in generated.source.name
    assert any("_tangent" in text for text in generated.source.files().values())


def test_products_leave_out_entries_that_are_always_zero():
    """The C multiplies by the entries of H_pp = 1/m, H_qq of k x y and K = 2 lambda alone."""
    x, y, px, py = sp.symbols("x y px py", real=True)
    m, k = sp.symbols("m k", positive=True)
    H = (px**2 + py**2) / (2 * m) + k * x * y
    system = gs.System((x, y), (px, py), (m, k), H, [x**2 + y**2 - 1], name="saddle")
    generated = generate(
        Spec.from_arguments("G-L", 2), system=system, derivatives=True, structured=True)
    text = "".join(generated.source.files().values())
    factors = {name: set(re.findall(rf"m->\w+\[i\]\.{name}\[(\d)\]\[(\d)\]\*", text))
               for name in ("H_pp", "H_qq", "K")}
    assert factors == {"H_pp": {("0", "0")},  # one template, with px and with py
                       "H_qq": {("0", "1"), ("1", "0")}, "K": {("0", "0"), ("1", "1")}}


def test_comments_of_a_frame_have_the_energy_that_the_code_has():
    """A frame adds products of q and p, ω J, to H of its motion, and none to the energy."""
    x, y, px, py = sp.symbols("x y px py", real=True)
    m, k = sp.symbols("m k", positive=True)
    system = gs.System((x, y), (px, py), (m, k), (px**2 + py**2) / (2 * m) + k * (x**2 + y**2)**2,
                       name="turning")
    spec = Spec.from_arguments("G-L", 2).with_frame("symmetries")
    source = generate(spec, system=system, structured=True).source
    header = re.findall(r"times H = (.*)", source.header)
    assert {*header} == {*re.findall(r"H of (.*?)\. \d", source.source)}
    assert header
    manifest = json.loads(source.manifest)["system"]["hamiltonian"]
    for text in header:
        assert text in manifest
        assert not re.search(r"_x\d\*_y\d", text)
    assert re.search(r"h in the frame = .*_x\d\*_y\d", source.source)
