"""Timing of jobs against each other: CPU time, alternating rounds, medians.

Wall time includes the time of other programs on the core; CPU time does not. Compared jobs run
alternately, so that a slower machine slows all of them, and the order is reversed after each
round.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar

__all__ = ["Clock", "Sample", "alternate", "repeated", "stopwatch", "with_children"]

Clock = Callable[[], float]
Name = TypeVar("Name", bound=Hashable)


@dataclass(frozen=True)
class Sample:
    """Seconds of each round: CPU time (or the given clock) and wall time."""

    seconds: tuple[float, ...]
    wall_seconds: tuple[float, ...] = ()

    @property
    def median(self) -> float:
        """Median of the rounds."""
        return statistics.median(self.seconds)

    @property
    def wall(self) -> float:
        """Median of the rounds by the clock on the wall."""
        return statistics.median(self.wall_seconds)

    @property
    def spread(self) -> float:
        """Median distance from the median, relative to it."""
        deviation = statistics.median(abs(x - self.median) for x in self.seconds)
        return deviation / self.median if self.median else 0.0

    def per(self, amount: float) -> Sample:
        """Return the seconds for each of ``amount`` equal parts."""
        return Sample(tuple(x / amount for x in self.seconds),
                      tuple(x / amount for x in self.wall_seconds))


def with_children() -> float:
    """Return the CPU seconds of this process and of the children it has waited for."""
    return time.process_time() + sum(os.times()[2:4])


def stopwatch(job: Callable[[], object], clock: Clock = time.process_time) -> float:
    """Return the seconds that a job takes by a clock."""
    start = clock()
    job()
    return clock() - start


def repeated(job: Callable[[], object], shortest: float, clock: Clock = time.process_time
             ) -> tuple[Callable[[], object], int]:
    """Return the job repeated for at least ``shortest`` seconds, and the number of repetitions."""
    times = 1
    while stopwatch(_often(job, times), clock) < shortest:
        times *= 2
    return _often(job, times), times


def _often(job: Callable[[], object], times: int) -> Callable[[], object]:
    return lambda: [job() for _ in range(times)]


def alternate(
    jobs: Mapping[Name, Callable[[], object]], rounds: int, clock: Clock = time.process_time
) -> dict[Name, Sample]:
    """Run all jobs once a round, forwards and backwards by turns; return each job's times."""
    times: dict[Name, list[tuple[float, float]]] = {name: [] for name in jobs}
    names = list(jobs)
    for number in range(rounds):
        for name in names if number % 2 == 0 else reversed(names):
            start = time.perf_counter()
            seconds = stopwatch(jobs[name], clock)
            times[name].append((seconds, time.perf_counter() - start))
    return {name: Sample(*zip(*rows, strict=True)) for name, rows in times.items()}
