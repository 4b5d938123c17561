"""Times that can be compared: CPU time, jobs in turn, medians.

Wall time counts what other programs do with the core; CPU time does not. Jobs that are compared
run alternately, so that a machine that slows down slows all of them, and the order turns round
after each round.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gyrospark.runtime.compilation.call_stack import thread_seconds

__all__ = ["Clock", "Sample", "alternate", "repeated", "stopwatch", "with_children"]

Clock = Callable[[], float]


@dataclass(frozen=True)
class Sample:
    """Seconds of each round, as measured."""

    seconds: tuple[float, ...]

    @property
    def median(self) -> float:
        """Median of the rounds."""
        return statistics.median(self.seconds)

    @property
    def spread(self) -> float:
        """Median distance from the median, relative to it."""
        middle = self.median
        away = statistics.median(abs(x - middle) for x in self.seconds)
        return away / middle if middle else 0.0

    def per(self, amount: float) -> Sample:
        """Return the seconds for each of ``amount`` equal parts."""
        return Sample(tuple(x / amount for x in self.seconds))


def with_children() -> float:
    """Return the CPU seconds of this process and of those it has waited for."""
    return time.process_time() + sum(os.times()[2:4])


def stopwatch(job: Callable[[], object], clock: Clock = thread_seconds) -> float:
    """Return the CPU seconds that this thread spends on a job."""
    start = clock()
    job()
    return clock() - start


def repeated(job: Callable[[], object], least: float) -> tuple[Callable[[], object], int]:
    """Return a job done so often that it takes ``least`` CPU seconds, and how often that is."""
    times = 1
    while stopwatch(again := _often(job, times)) < least:
        times *= 2
    return again, times


def _often(job: Callable[[], object], times: int) -> Callable[[], object]:
    return lambda: [job() for _ in range(times)]


def alternate(
    jobs: Mapping[str, Callable[[], object]], rounds: int, clock: Clock = thread_seconds
) -> dict[str, Sample]:
    """Run all jobs once a round, forwards and backwards by turns; return each job's times."""
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    names = list(jobs)
    for number in range(rounds):
        for name in names if number % 2 == 0 else reversed(names):
            seconds[name].append(stopwatch(jobs[name], clock))
    return {name: Sample(tuple(times)) for name, times in seconds.items()}
