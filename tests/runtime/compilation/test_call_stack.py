"""Calls run on a stack that is large enough where they take more than a thread has."""

from __future__ import annotations

import ctypes
import subprocess
import sys
import threading

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.runtime.compilation import call_stack
from gyrospark.runtime.compilation.compiler import find_compiler

TOP = gs.problems.fast_top()
RUN = {"dt": 1e-3, "steps": 5, "parameters": TOP.parameters}
BYTES = 48 * 2**20  # more than a thread has

DEEP = f"""
int deep(int n);
int deep(int n)
{{
    volatile char used[{BYTES}];
    for (long i = 0; i < {BYTES}; i += 4096)
        used[i] = (char)n;
    return used[0] + used[{BYTES} - 4096];
}}
"""


@pytest.fixture(scope="module")
def deep(tmp_path_factory):
    """Return a function with a large frame, and the size of it that the compiler reports."""
    folder = tmp_path_factory.mktemp("deep")
    (folder / "deep.c").write_text(DEEP)
    command = find_compiler().command
    for arguments in (["-c", "-fPIC", *call_stack.FLAGS, "deep.c", "-o", "deep.o"],
                      ["-shared", "deep.o", "-o", "deep.so"]):
        subprocess.run([*command, *arguments], cwd=folder, check=True)
    if not list(folder.glob("*.su")):
        pytest.skip("this compiler does not report frames")
    return ctypes.CDLL(str(folder / "deep.so")).deep, call_stack.frames_of(folder)


def test_a_frame_larger_than_the_stack_is_called_in_a_thread(deep):
    function, frames = deep
    assert .99 * BYTES <= frames < 1.01 * BYTES
    call, before = call_stack.on_large_stack(function, frames), threading.stack_size()
    results = []
    thread = threading.Thread(target=lambda: results.append(call(5)))
    thread.start()
    thread.join()
    assert [call(3), *results] == [6, 10]
    assert threading.stack_size() == before


def test_seconds_of_calls_in_threads_are_counted(monkeypatch):
    """Seconds of calls on another stack count too, for the time of steps and for benchmarks."""
    monkeypatch.setattr(call_stack, "_available", lambda: 0)
    start = call_stack.thread_seconds()
    call_stack.on_large_stack(lambda: sum(range(10**6)), 2**20)()
    assert call_stack.thread_seconds() - start > 0.003


def test_small_frames_are_called_as_they_are_and_errors_are_raised_by_the_call(tmp_path):
    assert call_stack.on_large_stack(abs, 1000) is abs
    with pytest.raises(ZeroDivisionError):
        call_stack.on_large_stack(lambda: 1 // 0, 2**28)()
    assert call_stack.frames_of(tmp_path) is None  # a folder without reports gives no bound


@pytest.mark.parametrize("stack", [0, None])
def test_a_stepper_knows_its_frames_and_its_steps_are_the_same_in_a_thread(stack, monkeypatch):
    """A run, an ensemble and Newton's method have the same bits in threads; frames are bounded."""
    step = gs.stepper("G-L", 2, rep="gamma")

    def runs(step):
        ensemble = step.integrate_ensemble([TOP.q0] * 3, [TOP.p0] * 3, **RUN)
        return [ensemble.q, *(step.integrate(TOP.q0, TOP.p0, solver=solver, **RUN).q
                              for solver in ("auto", "newton"))]

    expected, loaded = runs(step), gs.Stepper(step.name, step.files)
    assert 2000 < loaded.binding.frames < 2**21
    monkeypatch.setattr(call_stack, "_SMALL", 0)
    used, start = [], call_stack._in_thread
    monkeypatch.setattr(call_stack, "_in_thread", lambda *a: (used.append(a), start(*a))[1])
    if stack is not None:
        monkeypatch.setattr(call_stack, "_available", lambda: stack)
    for states, expected_states in zip(runs(loaded), expected, strict=True):
        np.testing.assert_array_equal(states, expected_states)
    assert bool(used) is (stack == 0)


@pytest.mark.skipif(sys.platform == "win32", reason="threads of POSIX")
def test_the_room_of_a_thread_is_known():
    import resource

    limit = resource.getrlimit(resource.RLIMIT_STACK)[0]
    assert limit == resource.RLIM_INFINITY or call_stack._available() == limit
    sizes = []
    before = threading.stack_size(2**22)
    try:
        thread = threading.Thread(target=lambda: sizes.append(call_stack._available()))
        thread.start()
        thread.join()
    finally:
        threading.stack_size(before)
    assert sizes == [2**22]
