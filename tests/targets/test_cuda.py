"""Ensembles on a card: the CUDA text as C, C++ and for a card, and refusals of a card.

No test needs a card: launches go to ``HostDevice``, which compiles the same text as C. The code
that talks to a card is called where there is one.
"""

from __future__ import annotations

import itertools
import os
import re
import shutil
import signal
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.api import text_of
from gyrospark.core.errors import InputError, MissingDependencyError, Stopped
from gyrospark.core.extras import install
from gyrospark.core.manifest import Manifest
from gyrospark.generator.spec import Spec
from gyrospark.runtime.devices import ensemble as devices
from gyrospark.runtime.devices import trajectories
from gyrospark.runtime.devices.cuda_text import KERNELS, THREADS, cuda_text
from gyrospark.runtime.devices.device import Memory
from gyrospark.runtime.devices.ensemble import DeviceEnsemble
from gyrospark.runtime.devices.host_device import HostDevice
from gyrospark.targets.artefact import Options, Written
from gyrospark.targets.native import native_bits
from processes import call

TOP = gs.problems.fast_top()
PARAMETERS = TOP.parameters | {"gamma": gs.gamma(TOP.inertia)}
COUNT, STEPS, EVERY = 3, 50, 7
#: Numbers before and behind all memory.
BAND = 1024
#: A step that has no solution, and the warning of it.
LONG = 0.5
WARNED = pytest.mark.filterwarnings("ignore:The fastest rotation")
RUN = {"dt": 1e-3, "steps": STEPS, "every": EVERY,
       "parameters": PARAMETERS | {"mgl": PARAMETERS["mgl"] * np.array([1, 1.1, 1.2])}}
MANY = np.tile(TOP.q0, (COUNT, 1)), np.tile(TOP.p0, (COUNT, 1))
SPECS = {"gl2": Spec("G-L", 2, "gamma"), "gl2_float": Spec("G-L", 2, "gamma", real="float"),
         "splitting4": Spec.from_arguments("splitting", rep="gamma", order=4)}


@pytest.fixture(scope="module")
def host():
    """A device that caches its compiled programs."""
    return HostDevice()


@pytest.fixture
def card(host, monkeypatch):
    """The host device in place of every card: launches are counted, no write is out of bounds."""
    counted = SimpleNamespace(launches=[], at_launch=lambda: None, bands=[])
    launch = host.launch

    def put(array):
        padded = np.full(array.size + 2 * BAND, 7, array.dtype)
        counted.bands.append(padded)
        inner = padded[BAND:-BAND].reshape(array.shape)
        inner[...] = array
        return Memory(inner, array.shape, array.dtype)

    def count(program, kernel, threads, *arguments):
        counted.launches.append((kernel, *arguments[1:3]))
        launch(program, kernel, threads, *arguments)
        counted.at_launch()

    monkeypatch.setattr(host, "put", put)
    monkeypatch.setattr(host, "launch", count)
    monkeypatch.setattr(devices, "open_card", lambda number: host)
    yield counted
    assert all((padded[:BAND] == 7).all() and (padded[-BAND:] == 7).all()
               for padded in counted.bands)


@pytest.fixture(scope="module")
def step():
    return gs.stepper("G-L", stages=2, rep="gamma")


@pytest.fixture(scope="module")
def texts():
    """Manifest, files and CUDA text of some steppers, by name."""
    by_kind = {}
    for kind, spec in SPECS.items():
        files, _ = text_of(spec.with_profile("control"))
        name = next(file for file in files if file.endswith(".h"))[:-2]
        by_kind[kind] = SimpleNamespace(name=name, files=files, text=cuda_text(name, files),
                                        manifest=Manifest.from_text(files[f"{name}.json"]))
    return by_kind


class OnCard:
    """An array of a library whose memory is on a card."""

    def __init__(self, array):
        self.array = array

    def __dlpack_device__(self):
        return 2, 0

    def __dlpack__(self, **options):
        return self.array.__dlpack__(**options)


def test_a_trajectory_has_the_bits_of_profile_control(card, step):
    ensemble = step.integrate_ensemble(*MANY, **RUN, device="cuda")
    files = step._control_files()
    stepper_files = Written(Manifest.from_text(files[f"{step.name}.json"]), files)
    start = Options(RUN["dt"], tuple(TOP.q0), tuple(TOP.p0),
                    PARAMETERS | {"mgl": PARAMETERS["mgl"] * 1.2})
    bits = ensemble.q[2, -1].tobytes() + ensemble.p[2, -1].tobytes()
    assert bits.hex() == native_bits(stepper_files, start, STEPS)
    assert not ensemble.failures
    assert np.isfinite(ensemble.q).all()
    assert (ensemble.iterations > 0).all()


def test_bits_do_not_depend_on_how_steps_are_launched(card, step, monkeypatch):
    full_run = step.integrate_ensemble(*MANY, **RUN | {"every": 1}, device="cuda")
    slices = [pair for kernel, *pair in card.launches if kernel == "advance_trajectories"]
    assert [b for _, b in slices[:-1]] == [a for a, _ in slices[1:]]  # one goes on where one ended
    assert len(slices) > 2
    monkeypatch.setattr(trajectories, "_WINDOW", 1)  # each row is copied to the host by itself
    thinned = step.integrate_ensemble(*MANY, **RUN, device="cuda")
    rows = [*range(0, STEPS, EVERY), STEPS]
    for name in ("t", "q", "p"):
        np.testing.assert_array_equal(getattr(thinned, name), getattr(full_run, name)[:, rows])
    iterations_max = [full_run.iterations[:, a:b].max(axis=1) for a, b in itertools.pairwise(rows)]
    np.testing.assert_array_equal(thinned.iterations, np.transpose(iterations_max))


def test_more_iterations_than_an_int_of_c_holds_are_the_most_it_holds(card, step):
    ensemble = step.integrate_ensemble(*MANY, **RUN, device="cuda",
                                       solver=gs.Solver("auto", max_iterations=2**40))
    assert (ensemble.q == step.integrate_ensemble(*MANY, **RUN, device="cuda").q).all()


def test_results_are_those_of_the_cpu_but_for_rounding(card, step):
    on_device = step.integrate_ensemble(*MANY, **RUN, device="cuda")
    on_cpu = step.integrate_ensemble(*MANY, **RUN)
    np.testing.assert_allclose(on_device.q, on_cpu.q, rtol=0, atol=1e-13)
    device_member, cpu_member = on_device.members[1], on_cpu.members[1]
    assert device_member.report.steps == STEPS
    assert device_member.report.iterations >= device_member.iterations.sum()
    np.testing.assert_allclose(device_member.energies, cpu_member.energies, rtol=1e-13)
    assert device_member.report.energy_error_max == abs(
        device_member.energies - device_member.energies[0]).max()
    assert np.isnan(device_member.multipliers).all()
    assert device_member.multipliers.shape == cpu_member.multipliers.shape


def test_trajectories_fill_more_than_a_block(card, step):
    """Threads beyond the last trajectory are idle, all others do the same."""
    ensemble = step.integrate_ensemble(
        np.tile(TOP.q0, (THREADS + 2, 1)), np.tile(TOP.p0, (THREADS + 2, 1)), dt=1e-3, steps=20,
        every=20, parameters=PARAMETERS, device="cuda")
    assert (ensemble.q == ensemble.q[:1]).all()
    assert not ensemble.failures


@WARNED
def test_a_trajectory_that_fails_stops_alone(card, step):
    dt = np.array([1e-3, LONG, 1e-3])
    ensemble = step.integrate_ensemble(*MANY, **RUN | {"dt": dt, "every": 1}, device="cuda")
    without_failure = step.integrate_ensemble(*MANY, **RUN | {"every": 1}, device="cuda")
    assert [*ensemble.failures] == [1]
    failure = ensemble.failures[1]
    assert failure.reason in ("diverged", "not converged", "not finite")
    assert np.isfinite(ensemble.q[1, : failure.step]).all()
    for values in (ensemble.t, ensemble.q, ensemble.p):
        assert np.isnan(values[1, failure.step :]).all()
    np.testing.assert_array_equal(ensemble.q[[0, 2]], without_failure.q[[0, 2]])
    assert len(failure.trajectory) == failure.step


def test_ctrl_c_returns_what_was_done(card, step):
    def interrupt():
        if len(card.launches) == 5:
            os.kill(os.getpid(), signal.SIGINT)

    card.at_launch = interrupt
    with pytest.raises(Stopped) as stopped:
        step.integrate_ensemble(*MANY, **RUN | {"steps": 10**6, "every": 10}, device="cuda")
    ensemble = stopped.value.ensemble
    rows = np.isfinite(ensemble.t[0]).sum()
    assert 1 < rows < 10**5
    assert np.isfinite(ensemble.q[:, :rows]).all()
    assert np.isnan(ensemble.q[:, rows:]).all()
    assert not ensemble.failures


def test_arrays_on_a_card_stay_there(card, step, monkeypatch):
    """Strides are free; the result is a view of the output of the last launch."""
    expected = step.integrate_ensemble(*MANY, **RUN, device="cuda")
    state = np.concatenate(MANY, axis=1).T.copy()  # (2 n, trajectories)
    q, p = OnCard(state[:4].T), OnCard(np.repeat(state[4:].T, 2, axis=0)[::2])
    ensemble = step.integrate_ensemble(q, p, **RUN)
    assert isinstance(ensemble, DeviceEnsemble)
    for name in ("t", "q", "p"):
        np.testing.assert_array_equal(getattr(ensemble, name), getattr(expected, name))
    np.testing.assert_array_equal(ensemble.iterations[:, 1:], expected.iterations)
    assert (ensemble.steps == STEPS).all()
    assert not ensemble.failures
    assert ensemble.q.strides[0] == ensemble.q.itemsize
    assert "3 trajectories of 9 states" in repr(ensemble)
    library = SimpleNamespace(from_dlpack=lambda shared: ("its own", shared.shape))
    monkeypatch.setitem(sys.modules, "a_library", library)
    monkeypatch.setattr(OnCard, "__module__", "a_library.arrays")
    assert step.integrate_ensemble(q, p, **RUN).q == ("its own", (COUNT, 9, 4))


@WARNED
def test_failures_on_a_card_are_named(card, step):
    dt = np.array([1e-3, LONG, 1e-3])
    ensemble = step.integrate_ensemble(*map(OnCard, MANY), **RUN | {"dt": dt})
    assert [*ensemble.failures] == [1]
    assert np.isnan(ensemble.q[1, -1]).all()
    assert np.isfinite(ensemble.q[::2]).all()


@pytest.mark.parametrize(("arguments", "said"), [
    ({"solver": "newton"}, "newton"),  # others are of test_incompatibilities.py
    ({"device": "gpu"}, "'gpu'"), ({"device": "cuda:1"}, "cuda:1"),
    ({"parameters": PARAMETERS | {"I1": -1.0}}, "I1"), ({"q": 2 * MANY[0]}, "Trajectory 0"),
])
def test_what_a_card_does_not_have_is_refused(card, step, arguments, said):
    options = {"device": "cuda"} | RUN | arguments
    with pytest.raises(InputError, match=re.escape(said)):
        step.integrate_ensemble(options.pop("q", MANY[0]), MANY[1], **options)
    assert not card.launches


@pytest.mark.parametrize(("q", "p", "device", "said"), [
    (OnCard(MANY[0]), MANY[1], None, "one library"),
    (*map(OnCard, MANY), "cpu", "NumPy"),
    (OnCard(MANY[0][:, :3]), OnCard(MANY[1][:, :3]), None, "(3, 3)"),
    (OnCard(MANY[0][:2]), OnCard(MANY[1]), None, "(2, 4)"),
    (OnCard(np.float32(MANY[0])), OnCard(MANY[1]), None, "float32"),
])
def test_arrays_that_do_not_fit_are_refused(card, step, q, p, device, said):
    with pytest.raises(InputError, match=re.escape(said)):
        step.integrate_ensemble(q, p, **RUN, device=device)


def test_without_cuda_core_the_extra_is_named(step, monkeypatch):
    monkeypatch.setitem(sys.modules, "cuda", None)
    with pytest.raises(MissingDependencyError) as refusal:
        step.integrate_ensemble(*MANY, **RUN, device="cuda")
    assert install("cuda") in str(refusal.value)


@pytest.mark.parametrize("kind", SPECS)
def test_every_function_is_one_of_a_card(texts, kind):
    texts_of_kind = texts[kind]
    kernels = [f"GS_KERNEL NAME({name})(" for name in KERNELS]
    assert all(texts_of_kind.text.count(kernel) == 1 for kernel in kernels)
    of_host = [line for line in texts_of_kind.text.splitlines()
               if re.match(r"[a-z_A-Z]\w*[ (].*\(.*[^;]$|static", line)
               and not line.startswith(("GS_DEVICE ", "GS_KERNEL ", "INLINE "))]
    assert not of_host
    assert "#include \"" not in texts_of_kind.text
    assert texts_of_kind.text.index("#include <") < texts_of_kind.text.index("#define GS_DEVICE")


def test_the_target_is_complete_and_its_check_compares_bits(tmp_path, monkeypatch):
    which = shutil.which
    monkeypatch.setattr(shutil, "which", lambda name: None if name == "nvcc" else which(name))
    artefact = gs.build("cuda", "fast-top", scheme="G-L", stages=2, dt=1e-3, real="float",
                        out=tmp_path / "top")
    name = "heavy_top_gl2_gamma_float"
    assert {*artefact.files} >= {f"{name}.cu", f"{name}_cuda.h", "main.cu"}
    assert "the bits of C" in artefact.check()
    file = artefact.path / f"{name}.cu"
    text = file.read_text()
    file.write_text(text.replace("q[a] = state[a*count + i]", "q[a] = state[i]"))
    assert file.read_text() != text
    with pytest.raises(gs.GyrosparkError):
        artefact.check()
    header = (artefact.path / f"{name}_cuda.h").read_text()
    declared = re.findall(rf"{name}_\w+(?=\()", header)
    assert len(declared) == 3
    assert all(re.search(rf"\b{function}\(", text) for function in declared)


@pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++")
def test_the_text_is_cpp_too(texts):
    splitting = texts["splitting4"]
    library, _ = HostDevice(["g++", "-std=c++17", "-Wall", "-Wextra", "-Wno-unused-function"]).load(
        splitting.name, splitting.text)
    assert hasattr(library, f"{splitting.name}_measure")


@pytest.mark.skipif(shutil.which("nvcc") is None, reason="there is no nvcc")
@pytest.mark.slow  # seconds each
@pytest.mark.parametrize("kind", SPECS)
def test_nvcc_compiles_it_for_a_card(texts, kind, tmp_path):
    texts_of_kind = texts[kind]
    (tmp_path / "text.cu").write_text(texts_of_kind.text)
    process = call(["nvcc", "-arch=sm_90", "-fmad=false", "-std=c++17", "-cubin", "-Xptxas", "-v",
                    "text.cu", "-o", "text.cubin"], cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    spills = re.findall(r"(\d+) bytes spill stores, (\d+) bytes spill loads", process.stderr)
    assert len(spills) >= len(KERNELS)
    assert all(int(bytes_) < 64 for pair in spills for bytes_ in pair)


def test_nvrtc_compiles_it_without_a_card(texts):
    pytest.importorskip("cuda.core")
    pytest.importorskip("cuda.bindings.nvrtc")
    from gyrospark.runtime.devices.cuda_device import compile_cubin

    gauss_lobatto = texts["gl2"]
    for architecture in ("sm_80", "sm_90"):
        assert len(bytes(compile_cubin(gauss_lobatto.name, gauss_lobatto.text,
                                       architecture).code)) > 10_000


def test_a_card_gives_the_bits_of_the_host(step, host, monkeypatch):
    pytest.importorskip("cuda.core")
    from gyrospark.runtime.devices.cuda_device import CudaDevice

    try:
        cuda_device = CudaDevice()
    except InputError as error:
        pytest.skip(str(error))
    ensembles = []
    for device in (cuda_device, host):
        monkeypatch.setattr(devices, "open_card", lambda number, device=device: device)
        ensembles.append(step.integrate_ensemble(*MANY, **RUN, device="cuda"))
    np.testing.assert_array_equal(ensembles[0].q, ensembles[1].q)
    np.testing.assert_array_equal(ensembles[0].p, ensembles[1].p)
