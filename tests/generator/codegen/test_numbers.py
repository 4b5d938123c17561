"""Numbers in the manifests of profile ``control``: roles, units, values; the hash."""

import json
import re
from dataclasses import replace

import pytest

import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.core.manifest import Manifest, NumberManifest
from gyrospark.generator.models.model_file import parse_model
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from processes import ROOT

SPEC = Spec.from_arguments("IMS", None, None).with_profile("control")
PENDULUM = """
name = "spring"
[system]
coordinates = ["s", "a"]
momenta = ["ps", "pa"]
hamiltonian = "ps**2/(2*m) + k*(s - l)**2/2 + pa**2/(2*I) + c*sin(a) + d*sign(s)*s + 9.81*m*e"
forces = ["-b*ps/m", "f"]
[parameters]
m = 2
k = 3
l = 4
I = 5
c = 6
b = 7
d = 8
e = 9
[inputs]
f = 0
[quantities]
power = "k*s*ps/m"
[units]
UNITS
[start]
q = [0, "30 deg"]
p = [4, 10]
"""


def numbers(model, **more):
    source = generate(SPEC, model=model, system=model.system, **more).source
    manifest = Manifest.from_text(source.manifest)
    return {number.name: number for number in manifest.system.numbers}, manifest, source


@pytest.fixture(scope="module")
def satellite():
    return gs.load_model(ROOT / "examples/control_c/satellite.toml")


def test_numbers_of_a_body(satellite):
    by_name, manifest, source = numbers(satellite)
    assert manifest.schema == 3
    assert manifest.system.dt == 0.1
    roles = ["parameter", "input", "q", "p", "velocity", "quantity"]
    assert {number.role for number in by_name.values()} == {*roles}
    assert [name for name, number in by_name.items() if number.role == "velocity"] == re.findall(
        r"velocity\[\d\] = (\w+)", source.header)
    fields = re.search(r"typedef struct \{([^}]*)\} \w+_parameters", source.header)[1]
    assert [name for name, number in by_name.items() if number.role in roles[:2]] == re.findall(
        r"double (\w+);", fields)
    assert by_name["I2"] == NumberManifest(name="I2", role="parameter", domain="positive",
                                           unit="kg.m2", start=10.0)
    assert by_name["gamma"].start == gs.gamma((12.0, 10.0, 3.0))
    assert [by_name[f"body_omega_{x}"].start for x in "xyz"] == pytest.approx(
        [0.02, -0.03, 0.05], rel=1e-15)
    assert {name: by_name[name].unit for name in ("u1", "q0", "p0", "omega1")} == {
        "u1": "N.m", "q0": "1", "p0": "N.m.s", "omega1": "rad/s"}


def test_units_complete_each_other():
    """Units of mass, length and angle determine all but the unit that stands beside a decimal."""
    model = parse_model(PENDULUM.replace("UNITS", 'm = "kg"\nl = "m"\na = "rad"'), "spring.toml")
    by_name, _, _ = numbers(model)
    assert {name: number.unit for name, number in by_name.items()} == {
        "m": "kg", "k": "N/m", "l": "m", "I": "kg.m2", "c": "J", "d": "N", "e": None,
        "b": "N.s/m", "f": "N.m", "s": "m", "a": "rad", "ps": "kg.m/s", "pa": "N.m.s",
        "s_dot": "m/s", "a_dot": "rad/s", "power": "W"}
    assert by_name["a_dot"].start == 2
    silent, _, _ = numbers(parse_model(PENDULUM.replace("UNITS", ""), "spring.toml"))
    assert {number.unit for number in silent.values()} == {None}


@pytest.mark.parametrize(("units", "message"), [
    ('q = "kg"', "'q'"), ('m = "pound"', "'pound'"), ("m = 3", "is 3"),
])
def test_bad_units_are_refused(units, message):
    with pytest.raises(InputError, match=rf"spring\.toml.*{message}"):
        parse_model(PENDULUM.replace("UNITS", units), "spring.toml")


def test_the_hash_is_of_the_model_and_in_the_header(satellite):
    _, manifest, source = numbers(satellite)
    assert re.fullmatch("[0-9a-f]{32}", manifest.hash)
    assert f'_HASH "{manifest.hash}"' in source.header
    assert numbers(satellite)[1].hash == manifest.hash
    changed = replace(satellite, parameters={**satellite.parameters, "I1": 12.5})
    assert numbers(changed)[1].hash != manifest.hash
    pendulum = parse_model(PENDULUM.replace("UNITS", ""), "spring.toml")
    full = [json.loads(generate(replace(SPEC, profile="full"), model=case, system=case.system)
                       .source.manifest) for case in (pendulum, replace(pendulum, parameters={
                           name: 2 * value for name, value in pendulum.parameters.items()}))]
    assert full[0] == full[1], "builds from Python depend on no value"
