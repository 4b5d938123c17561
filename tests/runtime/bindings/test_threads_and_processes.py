"""One stepper for many threads and processes: the same bits, no leak, no harm by an interrupt."""

from __future__ import annotations

import signal
import sys
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import gyrospark as gs
from fuzz.steppers import NAMES, case
from processes import FAST_TOP, ROOT, python

THREADS = 16


def run_of(name: str, shift: int = 0, steps: int = 60) -> gs.Trajectory:
    """Return a run; different shifts are different runs."""
    setup = case(name)
    return setup.step.integrate(setup.q, setup.p, dt=1e-3 * (1 + shift / 128), steps=steps,
                                parameters=setup.parameters)


def bits(run: gs.Trajectory) -> list[bytes]:
    return [getattr(run, name).tobytes() for name in ("t", "q", "p", "multipliers", "energies")]


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name in ("ims", "ems", "beads", "chain")))
    for name in NAMES])
def test_threads_on_one_stepper_give_the_bits_of_one(name):
    """Threads share no memory: they start together, each with a run of its own."""
    expected = [bits(run_of(name, shift)) for shift in range(THREADS)]
    assert expected[0] != expected[1]
    together = threading.Barrier(THREADS)

    def work(shift: int) -> list[bytes]:
        together.wait()
        return bits(run_of(name, shift))

    with ThreadPoolExecutor(THREADS) as pool:
        assert list(pool.map(work, range(THREADS))) == expected


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_failures_in_threads_are_each_their_own():
    """Each run in a thread fails as it does alone, beside runs that do not fail."""
    setup = case("gl3")

    def outcome(shift: int) -> object:
        try:
            return bits(setup.step.integrate(setup.q, setup.p, dt=2e-3 * (1 + 4 * shift), steps=40,
                                             parameters=setup.parameters))
        except gs.StepFailed as error:
            return error.step, error.reason, bits(error.trajectory)

    expected = [outcome(shift) for shift in range(THREADS)]
    assert {type(x) for x in expected} == {list, tuple}
    with ThreadPoolExecutor(THREADS) as pool:
        assert list(pool.map(outcome, range(THREADS))) == expected


def test_interrupt_ends_an_ensemble_and_its_threads():
    setup, before, expected = case("gl3"), threading.active_count(), bits(run_of("gl3"))
    q, p = np.tile(setup.q, (64, 1)), np.tile(setup.p, (64, 1))
    presses = [signal.SIGINT]  # a second one would be raised at once
    with pytest.raises(KeyboardInterrupt):
        setup.step.integrate_ensemble(
            q, p, dt=1e-3, steps=10**7, every=10**6, workers=4, parameters=setup.parameters,
            progress=lambda done: signal.raise_signal(presses.pop()) if done and presses else None)
    assert threading.active_count() == before
    assert bits(run_of("gl3")) == expected


FORK_IN_THREADS = FAST_TOP + '''
import os, sys, threading
step = gs.stepper("G-L", 3)
def run(steps=200):
    return step.integrate(top.q0, top.p0, dt=1e-3, steps=steps, parameters=parameters).q.tobytes()
wanted, ended = run(), threading.Event()
def busy():
    while not ended.is_set():
        run(20000)
threads = [threading.Thread(target=busy) for _ in range(4)]
for thread in threads:
    thread.start()
codes = []
import warnings
warnings.simplefilter("ignore", DeprecationWarning)  # of Python 3.12, of forking with threads
for _ in range(4):
    child = os.fork()
    if child == 0:
        os._exit(0 if run() == wanted else 1)
    codes.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
ended.set()
for thread in threads:
    thread.join()
print(codes == [0]*4)
'''


@pytest.mark.skipif(not hasattr(signal, "SIGCHLD"), reason="there is no fork")
def test_fork_while_threads_integrate():
    """Compiled code has no lock that a forked child could wait for without end."""
    assert python(FORK_IN_THREADS).strip() == "True"


FORK_IN_MEMBERS = FAST_TOP + '''
import os, signal, threading, warnings
step = gs.stepper("G-L", 3)
def ensemble():
    return step.integrate_ensemble([top.q0]*2, [top.p0]*2, dt=1e-3, steps=2, parameters=parameters)
one, other, inside, ended = ensemble(), ensemble(), threading.Event(), threading.Event()
make = one._make
def slowly(i):
    inside.set()
    ended.wait()
    return make(i)
object.__setattr__(one, "_make", slowly)
thread = threading.Thread(target=lambda: one.members)
thread.start()
inside.wait()
warnings.simplefilter("ignore", DeprecationWarning)
child = os.fork()
if child == 0:
    signal.alarm(200)  # ends a child that waits for the thread it does not have
    os._exit(len(other.members))
code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
ended.set()
thread.join()
print(code, one.members is one.members)
'''


@pytest.mark.skipif(not hasattr(signal, "SIGCHLD"), reason="there is no fork")
def test_fork_while_a_thread_makes_members():
    """No lock guards the members that an ensemble creates when first asked for them."""
    assert python(FORK_IN_MEMBERS).split() == ["2", "True"]


LEAKS = FAST_TOP + '''
import resource
import warnings
from pathlib import Path

def resident():
    """Return bytes of resident memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages*resource.getpagesize()

step = gs.stepper("G-L", 3)
good = {"dt": 1e-3, "parameters": parameters}

def one(k):
    kind = k % 20
    if kind < 14:
        step.step(top.q0, top.p0, **good)
    elif kind == 14:
        step.integrate(top.q0, top.p0, steps=5, **good)
    elif kind == 15:
        step.energy(top.q0, top.p0, parameters=parameters)
    elif kind == 16:
        step.project(top.q0, top.p0, parameters=parameters)
    elif kind == 17:
        try:
            with warnings.catch_warnings(action="ignore"):
                step.step(top.q0, top.p0, dt=1e3, parameters=parameters,
                          solver=gs.Solver("auto", max_iterations=3))
        except gs.StepFailed:
            pass
    elif kind == 18:
        try:
            step.step(top.q0, top.p0, dt=0, parameters=parameters)
        except gs.InputError:
            pass
    elif k % 200 == 19:
        step.integrate_ensemble([top.q0]*8, [top.p0]*8, steps=2, workers=2, **good)

for k in range(100_000):  # what allocators keep settles within these
    one(k)
before = resident()
for k in range(1_000_000):
    one(k)
print(before, resident())
'''

#: Of resident memory over all calls, in bytes: less than one byte a call would be for a million,
#: and what allocators keep here and there.
ALLOWED = 2**20


@pytest.mark.slow  # fewer calls would hide a leak in what allocators keep
@pytest.mark.skipif(sys.platform != "linux", reason="/proc is a thing of Linux")
def test_no_leak_in_a_million_calls(monkeypatch):
    monkeypatch.setattr("processes.PATIENCE", 3600)
    before, after = map(int, python(LEAKS).split())
    assert after - before < ALLOWED


def test_nothing_of_runs_is_behind_a_lock_of_a_class():
    """No source uses ``cached_property``, which has one lock for all instances in Python 3.11.

    A forked child may have it locked for ever.
    """
    sources = [path for folder in ("runtime", "sweeps", "storage")
               for path in sorted((ROOT / folder).rglob("*.py"))]
    assert len(sources) > 50
    assert not [path.name for path in sources if "cached_property" in path.read_text("utf-8")]
