"""The events of a run that somebody else takes on, piece by piece: solved for now and then."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from ...core.event import Event
from ..integration.lanes import fill_ensemble, threads_of
from ..integration.run_arguments import EnsembleArguments, RunArguments
from ..integration.step_loop import Rows
from ..results.crossings import Crossings
from .detection import Levels, Memory
from .location import crossings_of, detectors_for, ending, row_of_event

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["Observer", "TerminalEvent"]

Array = NDArray[Any]

#: Steps that are seen to have events, of which no more shall wait.
_MOST = 2**14


@dataclass(frozen=True)
class TerminalEvent:
    """Where an event ends a run: its place among the events, the state there, the row to it."""

    event: int
    at: Crossings
    row: Rows


class Observer:
    """Detection and location of the events of a run while it is stored.

    What it finds, and where that ends the run, is what ``integrate`` finds, however the run is cut
    into pieces and wherever events are solved for.

    Attributes
    ----------
    events : tuple of Event
    run : RunArguments
        With the watch that looks at each state.
    """

    def __init__(self, stepper: Stepper, run: RunArguments, events: tuple[Event, ...]) -> None:
        self.events = events
        self._stepper, self._levels = stepper, Levels.of(stepper.binding, stepper.manifest, events)
        self._runs = EnsembleArguments.of([run], stepper.binding.number_type)
        (self._watch,) = detectors_for(stepper, self._levels, self._runs)
        self.run = replace(run, detector=self._watch)

    @property
    def terminal(self) -> bool:
        """Whether an event may end the run."""
        return self._watch.terminal

    @property
    def at_end(self) -> bool:
        """Whether a terminal event happens in the next step."""
        return self._watch.ends_in is not None

    @property
    def full(self) -> bool:
        """Whether what is seen should be solved for before the run goes on."""
        return self._watch.noted >= _MOST

    @property
    def memory(self) -> Memory:
        """What looking goes on from."""
        return self._watch.memory

    def go_on(self, done: int, memory: Memory) -> None:
        """Go on after so many steps."""
        self._watch.go_on(done, memory)

    def settle(
        self, ahead: tuple[Array, Array] | None = None
    ) -> tuple[dict[str, Crossings], TerminalEvent | None]:
        """Return what has happened since the last time, and where that ends the run.

        ``ahead`` is the state one step on, of a run that a terminal event may end: what has
        happened is then known for good, and the run need not go back behind this place.
        """
        detector, run = self._watch, self.run
        detector.close(ahead)
        (found,) = crossings_of(self._stepper, self._levels, self._runs, [detector],
                                lambda computed: fill_ensemble(computed, threads_of(None),
                                                           lambda: False))
        brackets, name = detector.brackets, ending(self.events, found, run.dt)
        detector.forget()
        if name is None or brackets is None:
            return found, None
        last = found[name].first
        end = TerminalEvent([one.name for one in self.events].index(name), last,
                  row_of_event(self._stepper, run, brackets, last))
        return {key: one.until(last, run.dt) for key, one in found.items()}, end
