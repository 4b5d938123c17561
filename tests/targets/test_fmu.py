"""FMUs: bits, saved states, bad input, and descriptions of themselves."""

from __future__ import annotations

import ctypes
import gc
import importlib.util
import json
import math
import shutil
import sys
import zipfile
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from c_programs import STRICT, Program, run
from compilers import MAIN, compiler
from gyrospark.core.manifest import NumberManifest, SystemManifest
from gyrospark.generator.spec import Spec
from gyrospark.targets.artefact import MARKER, Options
from gyrospark.targets.build import _rates, _system_of
from gyrospark.targets.fmi.archive import library_of, own_platform
from gyrospark.targets.fmi.slave import Slave
from gyrospark.targets.fmi.variables import variables_of
from gyrospark.targets.tools import TOOLS
from processes import ROOT

SATELLITE = ROOT / "examples" / "control_c" / "satellite.toml"
DT = 0.1
#: Torques of the wheels at step k.
INPUTS = ("u1", "u2", "u3")
needs_zig = pytest.mark.skipif(TOOLS["zig"].find() is None, reason="ziglang is not installed")
needs_fmpy = pytest.mark.skipif(importlib.util.find_spec("fmpy") is None,
                                reason="fmpy is not installed")


def torques(step):
    return 0.1 * math.sin(0.07 * step), -0.05 * math.cos(0.03 * step), 0.02 if step % 7 else -0.1


class Fmu:
    """A built FMU, with its library for this machine."""

    def __init__(self, artefact, version, folder):
        self.built, self.version = artefact, version
        self.library = library_of(artefact.path, artefact.stepper.name, version, folder)
        with zipfile.ZipFile(artefact.path) as archive:
            self.texts = {name: archive.read(name) for name in archive.namelist()}
        self.description = ElementTree.fromstring(self.texts["modelDescription.xml"])
        self.token = self.description.get("guid") or self.description.get("instantiationToken")
        self.references = {variable.get("name"): int(variable.get("valueReference"))
                           for variable in self.description.find("ModelVariables")}

    def instance(self, token=None):
        return Slave(self.library, token or self.token, self.version, self.references)

    def started(self, **values):
        slave = self.instance()
        slave.start(values)
        return slave


@pytest.fixture(scope="module", params=[2, 3])
def satellite(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmu")
    artefact = gs.build(f"fmu{request.param}", SATELLITE, scheme="G-L", stages=2,
                        out=folder / "satellite.fmu")
    return Fmu(artefact, request.param, folder)


class Native(Program):
    """The same C, compiled here and called with other parameters before each step."""

    def __init__(self, artefact, folder):
        name, texts, self.built = artefact.stepper.name, artefact.stepper.sources, artefact
        super().__init__(SimpleNamespace(name=name, files=lambda: texts, header=texts[f"{name}.h"],
                                         manifest=texts[f"{name}.json"]), folder)

    def rows(self, steps, dt=DT):
        """Return q after each step, with torques."""
        start, rows, work = self.built.options, [], self.new_work()
        q, p = np.array(start.q), np.array(start.p)
        state = self.pointer(q), self.pointer(p)
        for step in range(steps):
            values = self.parameters(start.parameters | dict(zip(INPUTS, torques(step),
                                                                 strict=True)))
            if step == 0:
                assert self.begin(work, values, self.options(0.0, 50), dt, *state) == 0
            assert self.set_parameters(work, values) == 0
            assert self.advance(work, *state) == 0
            rows.append(q.tolist())
        return rows


@pytest.fixture(scope="module")
def native(tmp_path_factory):
    folder = tmp_path_factory.mktemp("native")
    return Native(gs.build("cpp", SATELLITE, scheme="G-L", stages=2, out=folder / "cpp"), folder)


ATTITUDE = ["q0", "q1", "q2", "q3"]
OUTPUTS = [*ATTITUDE, "omega1", "omega2", "omega3", "energy"]


def go(slave, step, size=DT):
    slave.set(dict(zip(INPUTS, torques(step), strict=True)))
    status = slave.step(step * DT, size)
    assert status == "OK", slave.messages


# ---------------------------------------------------------------- bits


def test_steps_with_inputs_have_the_bits_of_c(satellite, native):
    with satellite.started() as slave:
        attitudes = []
        for step in range(200):
            go(slave, step)
            attitudes.append(slave.get(ATTITUDE))
    assert attitudes == native.rows(200)
    assert not slave.messages


def test_rollbacks_to_random_states(satellite):
    """From a saved state the same inputs lead through the same bits, in any instance."""
    random = np.random.default_rng(8)
    with satellite.started() as slave, satellite.started(I1=11.0) as second_slave:
        rows, states = [], []
        for step in range(120):
            states.append(slave.keep())
            rows.append(slave.get(OUTPUTS))
            go(slave, step)
        rows.append(slave.get(OUTPUTS))
        for k in range(200):
            step = int(random.integers(len(states)))
            target = second_slave if k % 10 == 0 else slave
            if target is second_slave:
                state = second_slave.read(slave.write(states[step]))
                second_slave.restore(state)
                second_slave.free(state)
            else:
                slave.restore(states[step])
            for later in range(step, min(step + int(random.integers(1, 4)), len(states))):
                assert target.get(OUTPUTS) == rows[later]
                go(target, later)
                assert target.get(OUTPUTS) == rows[later + 1]
        for state in states:
            slave.free(state)
            assert not state


def test_two_instances_in_turns_do_not_know_each_other(satellite):
    with satellite.started() as first_slave, satellite.started(body_omega_x=0.3) as second_slave:
        for step in range(20):
            go(first_slave, step)
            assert second_slave.step(step * DT, DT) == "OK"
        with satellite.started() as reference:
            for step in range(20):
                go(reference, step)
            assert reference.get(OUTPUTS) == first_slave.get(OUTPUTS) != second_slave.get(OUTPUTS)


@pytest.mark.skipif(sys.platform != "linux", reason="glibc counts its bytes")
def test_an_instance_that_is_freed_leaves_no_memory(satellite):
    library = ctypes.CDLL(None)
    if not hasattr(library, "mallinfo2"):
        pytest.skip("glibc counts its bytes")

    class Counts(ctypes.Structure):
        _fields_ = [(f"field{k}", ctypes.c_size_t) for k in range(10)]

    count = library.mallinfo2
    count.restype = Counts

    def bytes_left(instances):
        before = count().field7  # bytes in use
        for _ in range(instances):
            with satellite.instance():
                pass
        gc.collect()  # the callbacks of an instance refer to it
        return count().field7 - before

    bytes_left(20)
    assert bytes_left(200) < 200 * 256  # an instance has more bytes than 256


def test_a_communication_step_is_split_into_equal_steps(satellite, native):
    """A step of 0.25 with dt = 0.1 equals three steps of 0.25/3, without inputs as in C."""
    with satellite.started() as slave, satellite.started(dt=0.25 / 3) as fine:
        for k in range(40):
            assert slave.step(0.25 * k, 0.25) == "OK"
            for third in range(3):
                assert fine.step(0.25 * k + third * 0.25 / 3, 0.25 / 3) == "OK"
        assert slave.get(OUTPUTS) == fine.get(OUTPUTS)
        energy = slave.get(["energy"])[0]
        for k, size in enumerate([0.1, 0.03, 0.5, 0.07] * 5):
            time = 10 + sum([0.1, 0.03, 0.5, 0.07][i % 4] for i in range(k))
            assert slave.step(time, size) == "OK"
        assert slave.get(["energy"])[0] == pytest.approx(energy, rel=1e-6)


def test_a_master_may_add_up_its_time(satellite):
    """Rounding of t does not begin the run anew, which would change last bits."""
    with satellite.started() as exact, satellite.started() as summed:
        time = 0.0
        for step in range(500):
            assert exact.step(step * DT, DT) == "OK"
            assert summed.step(time, (time + DT) - time) == "OK"
            time += DT
        assert exact.get(ATTITUDE) == summed.get(ATTITUDE)


# ---------------------------------------------------------------- starts


def test_starts_are_an_attitude_of_any_length_and_an_angular_velocity(satellite):
    omega = [0.3, -0.1, 0.2]
    names = ["body_omega_x", "body_omega_y", "body_omega_z"]
    with satellite.instance() as slave:
        slave.set({"q0": 3.0, "q1": 0.0, "q2": 4.0, "q3": 0.0, "I1": 6.0,
                   **dict(zip(names, omega, strict=True))})
        moments = [6.0, *slave.get(["I2", "I3"])]
        energy = sum(moment * w**2 for moment, w in zip(moments, omega, strict=True)) / 2
        assert slave.get(["energy"]) == pytest.approx([energy], rel=1e-14), "before the start"
        slave.start()
        assert slave.get(ATTITUDE) == pytest.approx([0.6, 0, 0.8, 0], abs=1e-16)
        assert slave.get(names) == pytest.approx(omega, rel=1e-14)
        assert slave.get(["omega1", "omega2", "omega3"]) == pytest.approx(omega, rel=1e-14)
        for step in range(50):
            assert slave.step(step * DT, DT) == "OK"
        assert slave.get(["energy"]) == pytest.approx([energy], rel=1e-8)


def test_starts_in_the_description_are_those_of_the_library(satellite):
    """Angular velocities come from H_p by complex steps there, from the C here."""
    meanings = {variable.get("name"): variable.get("description")
                for variable in satellite.description.find("ModelVariables")}
    assert all("body" in meanings[f"body_omega_{axis}"] for axis in "xyz")
    texts = {variable.get("name"): (variable if satellite.version == 3
                                    else variable.find("Real")).get("start")
             for variable in satellite.description.find("ModelVariables")}
    starts = {name: float(start) for name, start in texts.items() if start is not None}
    assert {"dt", "I1", "gamma", "u1", "q0", "body_omega_x"} <= starts.keys()
    assert "energy" not in starts
    with satellite.started() as slave:
        assert slave.get([*starts]) == pytest.approx([*starts.values()], rel=1e-14, abs=1e-16)
    assert [starts[f"body_omega_{axis}"] for axis in "xyz"] == pytest.approx([0.02, -0.03, 0.05])


def test_reset_and_time_of_the_start(satellite):
    with satellite.started() as slave:
        first = slave.get(OUTPUTS)
        go(slave, 0)
        slave.call_checked("Reset")
        slave.start(time=5.0)
        assert slave.get(["time"]) == [5.0]
        assert slave.get(OUTPUTS) == first
        assert slave.step(5.0, DT) == "OK"
        assert slave.get(["time"]) == [5.1]
        slave.call_checked("Terminate")
        assert slave.step(5.1, DT) == "Error"


@pytest.mark.parametrize("version", [pytest.param(2, marks=pytest.mark.slow), 3])  # the same C
def test_a_start_that_nothing_can_check_against_the_constraints_is_refused(version, tmp_path):
    """H is not quadratic in p: the C has no function from velocities to a state."""
    (x, y), p = sp.symbols("x y", real=True), sp.symbols("px py", real=True)
    length, weight = sp.symbols("length weight", positive=True)
    H = sp.sqrt(1 + p[0]**2 + p[1]**2) + weight * y
    pendulum = gs.System((x, y), p, (length, weight), H, (x**2 + y**2 - length**2,), name="fast")
    artefact = gs.build(f"fmu{version}", pendulum, start=([0.6, -0.8], [0, 0]), dt=0.01,
                        parameters={"length": 1, "weight": 2}, out=tmp_path / "fast.fmu")
    fmu = Fmu(artefact, version, tmp_path)
    for values in ({"x": 0.7}, {"px": 0.1}, {"length": 2.0}):
        with fmu.instance() as slave, pytest.raises(gs.GyrosparkError, match="constraints"):
            slave.start(values)
    for values in ({}, {"weight": 3.0}, {"dt": 0.005}, {"x": 0.6, "length": 1.0}):
        with fmu.started(**values) as slave:
            assert slave.step(0.0, 0.01) == "OK"
            assert math.hypot(*slave.get(["x", "y"])) == pytest.approx(1, rel=4e-16)


# ---------------------------------------------------------------- failures


def test_a_step_that_fails_is_discarded_and_nothing_is_done(satellite):
    """The iteration diverges in such a step; a master goes on with a shorter one."""
    with satellite.started(dt=1e4, body_omega_x=40.0) as slave:
        values_before = slave.get([*OUTPUTS, "time"])
        assert slave.step(0.0, 1e4) == "Discard"
        assert "1" in slave.messages[-1]
        assert slave.get([*OUTPUTS, "time"]) == values_before
        if satellite.version == 2:
            time, ended = ctypes.c_double(7), ctypes.c_int(7)
            slave.call_checked("GetRealStatus", 2, ctypes.byref(time))
            slave.call_checked("GetBooleanStatus", 3, ctypes.byref(ended))
            assert (time.value, ended.value) == (0, 0)
            assert slave.call("GetRealStatus", 0, ctypes.byref(time)) == "Error"
        for step in range(20):
            assert slave.step(step * 1e-3, 1e-3) == "OK"


@pytest.mark.parametrize(("values", "named"), [
    ({"I1": 0.0}, "I1 = 0"), ({"I3": -2.0}, "I3 = -2"), ({"dt": 0.0}, "dt = 0"),
    ({"gamma": 0.0}, "gamma"), (dict.fromkeys(ATTITUDE, 0.0), "attitude")])
def test_starts_out_of_their_domain_are_refused(satellite, values, named):
    with satellite.instance() as slave:
        with pytest.raises(gs.GyrosparkError, match="returns Error") as refused:
            slave.start(values)
        assert named in str(refused.value)
        assert slave.step(0.0, DT) == "Error"
        assert slave.get(["u1"]) == [0.0], "it lives on"


@pytest.mark.parametrize(("name", "value"), [("u1", math.nan), ("u1", math.inf), ("I1", 2.0),
                                             ("q0", 0.1), ("energy", 1.0), ("time", 1.0)])
def test_values_that_cannot_be_set_now(satellite, name, value):
    with satellite.started() as slave:
        values_before = slave.get([*OUTPUTS, "u1", "u2"])
        for values in ({"u2": 0.7, name: value}, {name: value, "u2": 0.7}):
            with pytest.raises(gs.GyrosparkError, match=name):
                slave.set(values)
        assert slave.get([*OUTPUTS, "u1", "u2"]) == values_before, "all or nothing"


@pytest.mark.parametrize(("time", "size"), [(0, 0), (0, -0.1), (0, math.nan), (0, math.inf),
                                            (math.nan, 0.1), (0.05, 0.1), (0, 1e12)])
def test_steps_that_cannot_be(satellite, time, size):
    with satellite.started() as slave:
        values_before = slave.get([*OUTPUTS, "time"])
        assert slave.step(time, size) == "Error"
        assert slave.messages[-1]
        assert slave.get([*OUTPUTS, "time"]) == values_before


def test_other_misuse_is_an_error(satellite):
    with satellite.started() as slave:
        unknown = (ctypes.c_uint32 * 1)(10_000)
        value = (ctypes.c_double * 1)(0)
        count = [] if satellite.version == 2 else [ctypes.c_size_t(1)]
        real = "Real" if satellite.version == 2 else "Float64"
        for access in ("Get", "Set"):
            assert slave.call(access + real, unknown, ctypes.c_size_t(1), value, *count) == "Error"
            assert "10000" in slave.messages[-1]
        state = slave.keep()
        content = slave.write(state)
        slave.free(state)
        for spoilt in (content[:-1], b"x" + content[1:], content + b"x"):
            with pytest.raises(gs.GyrosparkError, match=f"{len(spoilt)} bytes"):
                slave.read(spoilt)
        with pytest.raises(gs.GyrosparkError, match="no state"):
            slave.restore(ctypes.c_void_p())
        with pytest.raises(gs.GyrosparkError, match=r"EnterInitializationMode|SetupExperiment"):
            slave.start()
        assert slave.step(0.0, 0.1) == "OK"
        assert slave.step(0.1 + 1e-9, 0.1) == "OK"
        assert slave.step(0.20005, 0.1) == "Warning"
        assert "0.20005" in slave.messages[-1]
    with pytest.raises(gs.GyrosparkError, match="no instance"):
        satellite.instance(token="another")


# ---------------------------------------------------------------- what it says of itself


#: The functions of the two versions of FMI, without their prefixes.
_BOTH = """GetVersion SetDebugLogging FreeInstance EnterInitializationMode ExitInitializationMode
    Terminate Reset GetDirectionalDerivative EnterEventMode EnterContinuousTimeMode
    CompletedIntegratorStep SetTime SetContinuousStates GetEventIndicators GetContinuousStates
    GetNominalsOfContinuousStates DoStep"""
_TYPES = """Float32 Float64 Int8 UInt8 Int16 UInt16 Int32 UInt32 Int64 UInt64 Boolean String Binary
    Clock IntervalDecimal IntervalFraction ShiftDecimal ShiftFraction"""
INTERFACE = {
    2: _BOTH + """ GetTypesPlatform Instantiate SetupExperiment GetReal GetInteger GetBoolean
        GetString SetReal SetInteger SetBoolean SetString GetFMUstate SetFMUstate FreeFMUstate
        SerializedFMUstateSize SerializeFMUstate DeSerializeFMUstate NewDiscreteStates
        GetDerivatives SetRealInputDerivatives GetRealOutputDerivatives CancelStep GetStatus
        GetRealStatus GetIntegerStatus GetBooleanStatus GetStringStatus""",
    3: _BOTH + " ".join(f" Get{type_} Set{type_}" for type_ in _TYPES.split()) + """
        InstantiateModelExchange InstantiateCoSimulation InstantiateScheduledExecution
        GetNumberOfVariableDependencies GetVariableDependencies GetFMUState SetFMUState
        FreeFMUState SerializedFMUStateSize SerializeFMUState DeserializeFMUState
        GetAdjointDerivative EnterConfigurationMode ExitConfigurationMode EvaluateDiscreteStates
        UpdateDiscreteStates GetContinuousStateDerivatives GetNumberOfEventIndicators
        GetNumberOfContinuousStates GetOutputDerivatives EnterStepMode ActivateModelPartition"""}


def test_every_function_of_the_interface_is_there(satellite):
    version = satellite.version
    names = [f"fmi{version}{name}" for name in INTERFACE[version].split()]
    assert len(set(names)) == len(names) == {2: 44, 3: 75}[version]
    library = ctypes.CDLL(str(satellite.library))
    assert all(hasattr(library, name) for name in names)
    with satellite.started() as slave:
        absent = "GetIntegerStatus" if version == 2 else "EnterEventMode"
        status_arguments = [0, None] if version == 2 else []
        assert slave.call(absent, *status_arguments) == "Error"
        assert absent in slave.messages[-1]
        nothing = [None, ctypes.c_size_t(0), None, ctypes.c_size_t(0)]
        kind = "GetInteger" if version == 2 else "GetInt32"
        assert slave.call(kind, *nothing[:3 if version == 2 else 4]) == "OK"


def test_the_description(satellite):
    root, two = satellite.description, satellite.version == 2
    assert root.get("description") == satellite.built.options.description
    variables = {variable.get("name"): {**variable.attrib,
                                        **(variable.find("Real").attrib if two else {})}
                 for variable in root.find("ModelVariables")}
    units = {unit.get("name"): unit.find("BaseUnit").attrib
             for unit in root.find("UnitDefinitions")}
    assert units["kg.m2"] == {"kg": "1", "m": "2"}
    assert units["N.m"] == {"kg": "1", "m": "2", "s": "-2"}
    assert variables["I1"]["unit"] == "kg.m2"
    assert float(variables["I1"]["min"]) > 0
    assert "min" not in variables["u1"]
    assert variables["u1"]["causality"] == "input"
    assert variables["dt"]["start"] == "0.1"
    outputs = {name for name, variable in variables.items() if variable["causality"] == "output"}
    assert {*OUTPUTS} <= outputs
    structure = root.find("ModelStructure")
    rows = structure.find("Outputs") if two else structure.findall("Output")
    names = list(variables)
    dependencies = {names[int(row.get("index")) - 1] if two else
                    names[int(row.get("valueReference"))]: row.get("dependencies").split()
                    for row in rows}
    assert dependencies.keys() == outputs
    assert dependencies["q0"] == []
    assert not {names[int(k) - two] for k in dependencies["omega1"]} & {*INPUTS}
    flag = root.find("CoSimulation").attrib
    assert "providesDirectionalDerivatives" not in flag
    assert "providesDirectionalDerivative" not in flag
    assert flag["modelIdentifier"] == satellite.built.stepper.name


def test_the_same_model_is_the_same_file(satellite, tmp_path):
    """The files agree to the byte; another start has another token."""
    artefact, target = satellite.built, satellite.built.target.load()

    def texts(options):
        return target.files(artefact.stepper.manifest, artefact.stepper.sources, options)

    for name, text in texts(artefact.options).items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    if satellite.version == 3:  # both are linked by the same code
        assert target.compile(tmp_path, ("own",)).read_bytes() == artefact.path.read_bytes()
    assert json.loads(satellite.texts[f"resources/{MARKER}"])["name"] == artefact.stepper.name
    description = texts(replace(artefact.options, dt=0.05, description=""))[
        "modelDescription.xml"]
    # without a description of the model, the one of its stepper
    assert artefact.stepper.manifest.scheme.method in ElementTree.fromstring(description).get(
        "description")
    assert satellite.token not in description
    assert 'start="0.05"' in description


def test_sources_compile_without_a_warning(satellite, tmp_path):
    """The sources of a source code FMU are the files that its description names."""
    for name, text in satellite.texts.items():
        if name.startswith("sources/"):
            (tmp_path / name.partition("/")[2]).write_bytes(text)
    if satellite.version == 2:
        files = [source_file.get("name") for source_file in satellite.description.iter("File")]
    else:
        build = ElementTree.fromstring(satellite.texts["sources/buildDescription.xml"])
        files = [source_file.get("name") for source_file in build.iter("SourceFile")]
    assert len(files) == 2
    run([*compiler(MAIN), *STRICT, "-fsyntax-only", *files], tmp_path)
    prefix = f"FMI{satellite.version}_FUNCTION_PREFIX=satellite_"
    run([*compiler(MAIN), "-shared", "-fPIC", f"-D{prefix}", *files, "-o", "prefix.so", "-lm"],
        tmp_path)
    library = ctypes.CDLL(str(tmp_path / "prefix.so"))
    function = f"fmi{satellite.version}DoStep"
    assert hasattr(library, f"satellite_{function}")
    assert not hasattr(library, function)


def test_models_without_velocities_start_from_momenta(tmp_path):
    """H is not quadratic in p, with time in its force and awkward text."""
    q, p, k, t = sp.symbols("q p k t", real=True)
    H = sp.sqrt(1 + p**2) + k * q**2 / 2
    system = gs.System((q,), (p,), (k,), H, name="relativistic", time=t, forces=(sp.sin(3 * t),),
                       quantities={"speed": p / sp.sqrt(1 + p**2), "phase": sp.sin(3 * t)})
    artefact = gs.build("fmu3", system, scheme="IMS", dt=0.01, start=([0.5], [0.25]),
                        parameters={"k": 2.0}, out=tmp_path / "r.fmu")
    assert "2000 steps" in artefact.check()
    fmu = Fmu(artefact, 3, tmp_path)
    with fmu.instance() as slave:
        slave.start({"p": 0.75}, time=2.0)
        assert slave.get(["p", "energy", "speed", "phase"]) == pytest.approx(
            [0.75, 1.25 + 0.25, 0.6, math.sin(6.0)])
        for step in range(100):
            assert slave.step(2 + step * 0.01, 0.01) == "OK"
        q, p, *outputs = slave.get(["q", "p", "energy", "speed", "phase"])
    assert [q, p] == pytest.approx(midpoint(0.5, 0.75, 2.0, 0.01, 100), rel=1e-13)
    root = math.sqrt(1 + p**2)
    assert outputs == pytest.approx([root + 2.0 * q**2 / 2, p / root, math.sin(9.0)], rel=1e-13)


def test_velocities_of_a_start_are_those_of_either_representation():
    path, rates = ROOT / "examples" / "damped_top.toml", []
    for rep, number in (("gamma", 0.3), ("alpha", 0.2)):  # any, as q' of a start is on |q| = 1
        model = gs.load_model(path, rep=rep)
        system = _system_of(Spec.from_arguments("IMS", rep=rep, system=str(path)), None, {})
        options = Options(1e-3, model.q0, model.p0, {**model.parameters, rep: number})
        rates.append(_rates(system, options))
    assert rates[0] == pytest.approx(rates[1], rel=1e-13)
    assert max(rates[0]) > 1


def test_velocities_of_a_start_are_derived_from_h():
    """q' = H_p for any H: with functions and names that a formula of a file cannot have."""
    q, p, m, low = sp.symbols("q p m min", real=True)
    H = (p - sp.sin(q))**2 * sp.E / (2*m) * sp.acosh(2 + low**70) + sp.asinh(q)
    system = gs.System((q,), (p,), (m, low), H, name="one")
    roles = {"m": "parameter", "min": "parameter", "q": "q", "p": "p", "q_dot": "velocity"}
    numbers = tuple(NumberManifest(name=name, role=role, domain="real", unit=None, start=None)
                    for name, role in roles.items())
    manifest = SystemManifest(
        name="one", hamiltonian=str(H), coordinates=("q",), momenta=("p",), hidden=(),
        parameters={"m": "real", "min": "real"}, constraints=(), start_parameters=(),
        rigid_body=False, numbers=numbers)
    options = Options(0.1, (0.5,), (2.0,), {"m": 4.0, "min": 1.0})
    variables = {v.name: v for v in variables_of(
        SimpleNamespace(name="one", system=manifest),
        replace(options, rates=_rates(system, options)))}
    assert variables["q_dot"].start == pytest.approx(
        (2 - math.sin(0.5)) * math.e * math.acosh(3) / 4, rel=1e-15)
    assert variables["q_dot"].depends == variables["energy"].depends == ("m", "min")
    assert variables["q"].depends == ()
    assert "p" not in variables


@pytest.mark.slow  # compiled for this
def test_a_composition_of_exact_flows_has_no_iteration_to_keep(tmp_path):
    """Unchanged parameters are not set again, which would round the state."""
    artefact = gs.build("fmu2", SATELLITE, order=2, out=tmp_path / "s.fmu")
    assert "2000 steps" in artefact.check()


def midpoint(q, p, t, h, steps):
    """Return the end of so many steps of H = sqrt(1 + p^2) + q^2, F = sin 3t."""
    for k in range(steps):
        end = q, p
        for _ in range(30):
            qm, pm = (q + end[0]) / 2, (p + end[1]) / 2
            end = (q + h * pm / math.sqrt(1 + pm**2),
                   p + h * (math.sin(3 * (t + (k + 0.5) * h)) - 2 * qm))
        q, p = end
    return [q, p]


# ---------------------------------------------------------------- refusals


def test_a_file_that_is_no_library_is_refused(tmp_path):
    path = tmp_path / "text.so"
    path.write_text("no library")
    with pytest.raises(gs.GyrosparkError, match=r"text\.so"):
        Slave(path, "token", 3, {})


def test_what_cannot_be_an_fmu(tmp_path):
    arguments = {"scheme": "IMS", "dt": 0.01, "out": tmp_path / "no.fmu"}
    with pytest.raises(gs.InputError, match=r"dt = -0\.01.*positive"):
        gs.build("fmu3", SATELLITE, **arguments | {"dt": -0.01})
    for name in ("dt", "energy", "time", "GUID", "stdin"):
        q, p = sp.symbols("q p", real=True)
        k = sp.Symbol(name, positive=True)
        system = gs.System((q,), (p,), (k,), (p**2 + k * q**2) / 2, name="clash")
        with pytest.raises(gs.InputError, match=name):
            gs.build("fmu2", system, **arguments, start=([1.0], [0.0]), parameters={name: 1.0})
    assert not any(tmp_path.iterdir())


def test_platforms_that_cannot_be(tmp_path, monkeypatch):
    arguments = {"system": SATELLITE, "scheme": "IMS", "out": tmp_path / "no.fmu"}
    with pytest.raises(gs.InputError, match="aarch64"):
        gs.build("fmu2", **arguments, platforms="aarch64")
    monkeypatch.setattr(importlib.util, "find_spec", lambda *_: None)
    monkeypatch.setattr(shutil, "which", lambda *_: None)
    with pytest.raises(gs.InputError, match="ziglang"):
        gs.build("fmu3", **arguments, platforms="windows")
    monkeypatch.setattr("platform.machine", lambda: "riscv64")
    with pytest.raises(gs.InputError, match="riscv64"):
        own_platform(3)
    assert not any(tmp_path.iterdir())


# ---------------------------------------------------------------- with other tools


@needs_fmpy
def test_fmpy_finds_no_problem_and_simulates_the_same_bits(satellite, native):
    import fmpy
    from fmpy.validation import validate_fmu

    assert validate_fmu(str(satellite.built.path)) == []
    times = np.arange(200) * DT
    rows = [(time, *torques(step)) for step, time in enumerate(times)]
    signal = np.array(rows, dtype=[("time", float), *((name, float) for name in INPUTS)])
    results = fmpy.simulate_fmu(str(satellite.built.path), start_time=0, stop_time=100 * DT,
                                step_size=DT, output_interval=DT, input=signal, output=ATTITUDE)
    attitudes = np.stack([results[name] for name in ATTITUDE], -1)[1:101]
    assert abs(attitudes - native.rows(100)).max() < 1e-14, (
        "its times are summed, so its inputs differ")


@pytest.mark.slow
@needs_zig
@pytest.mark.parametrize("version", [2, 3])
def test_libraries_for_every_platform(version, tmp_path):
    """ziglang links the libraries; the jobs of each system load their own, as above."""
    names = ["linux", "windows", "mac", *(["aarch64"] if version == 3 else [])]
    arguments = {"scheme": "G-L", "stages": 2, "platforms": names}
    artefact = gs.build(f"fmu{version}", SATELLITE, **arguments, out=tmp_path / "all.fmu")
    fmu = Fmu(artefact, version, tmp_path)
    assert artefact.path.stat().st_size <= 150_000
    assert "2000 steps" in artefact.check()
    rebuilt = gs.build(f"fmu{version}", SATELLITE, **arguments, out=tmp_path / "again.fmu")
    assert rebuilt.path.read_bytes() == artefact.path.read_bytes()
    heads = {name: text[:4] for name, text in fmu.texts.items() if name.startswith("binaries/")}
    magic = {".so": b"\x7fELF", ".dll": b"MZ", ".dylib": b"\xcf\xfa\xed\xfe"}
    assert len(heads) == 2 * version - 1
    for name, start in heads.items():
        assert start.startswith(magic[name[name.rindex("."):]]), name


@pytest.mark.slow
@needs_fmpy
@pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake is not installed")
def test_a_source_code_fmu_is_compiled_by_others(satellite, tmp_path):
    """fmpy and cmake compile it without its library."""
    from fmpy import extract
    from fmpy.build import build_platform_binary

    path = tmp_path / "sources.fmu"
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in satellite.texts.items():
            if not name.startswith("binaries/"):
                archive.writestr(name, text)
    folder = extract(str(path), unzipdir=str(tmp_path / "open"))
    (tmp_path / "build").mkdir()
    build_platform_binary(folder, tmp_path / "build")
    with zipfile.ZipFile(path, "a") as archive:
        for library in (tmp_path / "open" / "binaries").rglob("*.so"):
            archive.write(library, library.relative_to(folder))
    assert "2000 steps" in replace(satellite.built, path=path).check()
