"""The trajectories of an ensemble on a device: launches, slice by slice, and stored states."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import field
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from ...core.arrays import Array
from ...core.records import dataclass
from ..bindings.binding import Binding
from ..bindings.run_memory import Rows, RunRecord
from ..integration.lanes import EnsembleStates
from ..integration.run_arguments import EnsembleArguments
from ..integration.step_loop import ChunkSize
from ..results.outputs import defect_sizes
from .device import Device, Memory, View

__all__ = ["DeviceStates", "Trajectories", "gather_states"]

#: Bytes of stored states that lie on the device before they are copied to the host.
_WINDOW = 2**28


@dataclass(frozen=True)
class Window:
    """Stored states on the device: rows ``first`` to ``first + len(q)`` of all."""

    first: int
    #: (rows, n, trajectories)
    q: Memory
    p: Memory
    #: (rows, trajectories)
    iterations: Memory


class Trajectories:
    """The trajectories of an ensemble in memory of a device, from their start on.

    Parameters
    ----------
    device : Device
        Where they run.
    name, text : str
        Of the stepper, and what ``cuda_text`` says for it.
    binding : Binding
        Of the stepper on the CPU, which knows the order of its parameters.
    runs : EnsembleArguments
        Checked.
    state : Memory, optional
        q and p of all trajectories, (2 n, trajectories), where they lie there already.
    """

    def __init__(
        self, device: Device, name: str, text: str, binding: Binding, runs: EnsembleArguments,
        state: Memory | None = None,
    ) -> None:
        """Allocate memory of the card, and begin each trajectory there.

        ``state`` has (q, p), (2 n, trajectories), where they lie on the card already.
        """
        self.device, self.runs, self.n, self.dtype = device, runs, binding.n, binding.dtype
        self.program = device.load(name, text)
        count, number = len(runs), self.dtype
        sizes = device.zeros((2,), np.int64)
        device.launch(self.program, "measure", 1, sizes)
        # the kernel says how much memory a trajectory takes, and how many parameters it reads
        words, fields = device.get(sizes).tolist()
        # the trajectory is the last axis of all arrays: threads side by side read numbers side by
        # side, which a card fetches at once
        parameters = binding.parameter_rows(runs.parameters, runs.t0)
        assert parameters.shape[1] == fields, "profile control has the parameters of the stepper"
        self.state = device.put(np.concatenate([runs.q.T, runs.p.T])) if state is None else state
        self.words = device.zeros((words, count), np.uint32)
        self.status = device.zeros((count,), np.intc)
        self.steps, self.iterations = (device.zeros((count,), np.int64) for _ in range(2))
        first_run = runs.first
        self._launch("begin_trajectories", device.put(parameters.T.astype(number)),
                     device.put(runs.dt.astype(number)),
                     number(first_run.tolerance or 0),  # 0: down to round-off
                     np.intc(min(first_run.max_iterations, 2**31 - 1)),  # an int of C
                     self.state, self.words, self.status, self.steps, self.iterations)

    def integrate(
        self, rows: int, store: Callable[[Window], None], stop: Callable[[], bool]
    ) -> int:
        """Take all steps, or those before ``stop()`` is true; return how many.

        ``store`` is called with each window of ``rows`` stored states when it is full; the start is
        in the first one.
        """
        first_run, pace = self.runs.first, ChunkSize(clock=time.perf_counter)
        step_count = row = 0
        while True:
            # a window at a time: the states of all rows may exceed the memory of the card
            window = self._window(row, min(rows, first_run.rows + 1 - row))
            end = min((row + window.q.shape[0] - 1) * first_run.every, first_run.steps)
            if row == 0:
                # no step: stores the start
                self._advance(first_step=0, end_step=0, window=window)
            # launches of a fraction of a second, so that Ctrl-C is heard
            while step_count < end and not stop():
                count = min(pace.begin(), end - step_count)
                self._advance(step_count, step_count + count, window)
                step_count += count
                pace.end(count)
            store(window)
            if step_count < end or end == first_run.steps:
                return step_count
            row += window.q.shape[0]

    @property
    def steps_done(self) -> Array:
        """Completed steps of each trajectory."""
        return self.device.get(self.steps)

    def states(self, binding: Binding, stop: Callable[[], bool]) -> DeviceStates:
        """Take all steps, or those before ``stop()`` is true; return the stored states on the host.

        Windows of states are copied one by one, so that the card need not hold all of them.
        """
        runs, count, n = self.runs, len(self.runs), self.n
        rows = runs.first.rows + 1
        q, p = binding.new(count, rows, n), binding.new(count, rows, n)
        iterations = np.zeros((count, rows), np.intc)

        def store(window: Window) -> None:
            """Copy the rows of a window from the card to the host's arrays."""
            window_rows = slice(window.first, window.first + window.q.shape[0])
            q[:, window_rows] = self.device.get(window.q).transpose(2, 0, 1)
            p[:, window_rows] = self.device.get(window.p).transpose(2, 0, 1)
            iterations[:, window_rows] = self.device.get(window.iterations).T

        self.integrate(max(_WINDOW // (2 * n * count * q.itemsize), 1), store, stop)
        # profile control keeps neither multipliers nor work
        unknown = binding.new(1)[0] + np.nan
        multipliers = np.broadcast_to(unknown, (count, rows, binding.multipliers))
        work = np.broadcast_to(unknown if binding.has_forces else unknown.dtype.type(0),
                               (count, rows))
        state = self.device.get(self.state)
        # no more steps are taken on the host: nothing reads ``parameters``, and there are no lanes
        return DeviceStates(
            binding, runs, in_lanes=False, batch=1, rows=Rows(q, p, multipliers, iterations, work),
            q=np.ascontiguousarray(state[:n].T), p=np.ascontiguousarray(state[n:].T),
            status=self.device.get(self.status), reports=[], parameters=runs.dt, dt=runs.dt,
            steps=self.steps_done, iterations=self.device.get(self.iterations))

    def _window(self, first: int, rows: int) -> Window:
        """Allocate memory for stored states, from row ``first`` on."""
        count = len(self.runs)
        q, p = (self.device.zeros((rows, self.n, count), self.dtype) for _ in range(2))
        return Window(first, q, p, self.device.zeros((rows, count), np.intc))

    def _advance(self, first_step: int, end_step: int, window: Window) -> None:
        """Advance all trajectories from step ``first_step`` to ``end_step`` in one launch; wait."""
        run = self.runs.first
        counts = map(np.int64, (first_step, end_step, run.every, run.steps, window.first))
        self._launch("advance_trajectories", *counts, self.state, self.words, self.status,
                     self.steps, self.iterations, window.q, window.p, window.iterations)
        self.device.wait()

    def _launch(self, kernel: str, *arguments: Any) -> None:
        """Begin a kernel with a thread for each trajectory; its first argument is their number."""
        self.device.launch(self.program, kernel, len(self.runs), np.int64(len(self.runs)),
                           *arguments)


def gather_states(device: Device, name: str, text: str, q: View, p: View) -> Memory:
    """Return q and p of all trajectories, (2 n, trajectories), from arrays with any strides."""
    count, n = q.memory.shape
    state = device.zeros((2 * n, count), q.memory.dtype)
    device.launch(device.load(name, text), "gather_states", count, np.int64(count), q.memory,
                  *map(np.int64, q.strides), p.memory, *map(np.int64, p.strides), state)
    return state


@dataclass(frozen=True)
class DeviceStates(EnsembleStates):
    """Stored states copied from a device, with status, report and steps of each trajectory.

    Multipliers are NaN: a step of profile control keeps none. So is the work of forces.
    """

    #: Steps and iterations of each trajectory.
    steps: Array = field(kw_only=True)
    iterations: Array = field(kw_only=True)

    @property
    def row_counts(self) -> list[int]:
        """The stored states of each trajectory, its start among them."""
        return [self.runs.first.rows_after(step_count) + 1 for step_count in self.steps.tolist()]

    def report(self, i: int) -> RunRecord:
        """Return the running record of a trajectory, with errors at stored states alone.

        Profile control records no errors of each step. With forces, whose work it does not sum up,
        errors of the energy are NaN.
        """
        binding, run, step_count = self.binding, self.runs[i], int(self.steps[i])
        rows = run.rows_after(step_count) + 1
        parameters = binding.parameters(run.parameters, run.t0)
        t = binding.times(run.t0, run.dt, run.steps_of_rows(step_count)).astype(binding.dtype)
        q, p = self.rows.q[i, :rows], self.rows.p[i, :rows]
        H = binding.hamiltonian(parameters, q, p, t).astype(float)
        # the work is not known, and the energy error with it
        errors = np.abs(H - H[0] - (np.nan if binding.has_forces else 0))
        g, f = defect_sizes(binding, parameters, q, p, t)
        return cast(RunRecord, SimpleNamespace(
            steps=step_count, recorded=rows, iterations=int(self.iterations[i]),
            iterations_max=int(self.rows.iterations[i, 1:rows].max(initial=0)), newton_steps=0,
            energy_start=H[0], energy_error_max=errors.max(), energy_error_sum=errors.sum(),
            constraint_max=g.max(), constraint_sum=g.sum(), hidden_max=f.max(), hidden_sum=f.sum(),
            work=np.nan))
