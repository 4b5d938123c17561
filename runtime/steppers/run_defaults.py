"""Default parameters and start of a model: numbers, no formulas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, field, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from ...core.arguments import count_text
from ...core.event import Event, Impact
from ...core.exact_numbers import Rounded, exact, knowing
from ...core.records import dataclass
from ...core.shapes import Shape
from ...core.start import Start

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..rigid_body.problems import Problem

    Array = NDArray[Any]

__all__ = ["RunDefaults"]

#: The fields of a start with numbers in them.
_NUMBERS = ("parameters", "q0", "p0", "bodies", "dt")
#: The fields of an event or an impact with a number in them.
_EXACT = ("level", "restitution")


@dataclass(frozen=True)
class RunDefaults:
    """Parameters and the state at t = 0, in doubles that carry the digits of a file.

    Attributes
    ----------
    name, description : str
        Name of the model, and what it is.
    parameters : mapping of str to float
        All but those of ``bodies`` that are left to be chosen.
    q0, p0 : list of float
        State at t = 0.
    bodies : mapping of str to list
        Name of each inertia parameter (γ or α of a body) → the body's inertia: three principal
        moments, or a tensor in rows.
    dt, steps : float and int, or None
        Where the model names them.
    rules : mapping of str to str
        Name of an inertia parameter without a value → its rule, "m" for the others; "frame" →
        "start" for rates of a co-moving frame by least squares.
    free : list of str
        Parameters that another value may be given for and nothing else changes.
    events : tuple of Event and Impact
        What its runs look for, and their impacts.
    visuals : mapping of str to sequence of Shape
        What its bodies are drawn with, by their names; "" is the ground.
    """

    name: str
    description: str
    parameters: Mapping[str, float]
    q0: list[float]
    p0: list[float]
    bodies: Mapping[str, Any]
    dt: float | None
    steps: int | None
    rules: Mapping[str, str] = field(default_factory=dict)
    free: list[str] = field(default_factory=list)
    events: tuple[Event | Impact, ...] = ()
    visuals: Mapping[str, Sequence[Shape]] = field(default_factory=dict)

    def __repr__(self) -> str:
        return (f"<RunDefaults of {self.name}: {count_text(len(self.q0), 'coordinate')}, "
                f"{count_text(len(self.parameters), 'parameter')}>")

    @classmethod
    def of_problem(cls, problem: Problem) -> RunDefaults:
        """Return the numbers of a built-in problem, one rigid body."""
        inertia = list(problem.inertia)
        return cls(problem.name, problem.description, problem.parameters, q0=problem.q0.tolist(),
                   p0=problem.p0.tolist(), bodies={"gamma": inertia, "alpha": inertia}, dt=None,
                   steps=None)

    @classmethod
    def of(cls, model: Any) -> RunDefaults:
        """Return the numbers of a ``gyrospark.Model``, or of an object with its attributes."""
        return cls(
            model.name, model.description,
            parameters={name: knowing(x) for name, x in model.parameters.items()},
            q0=[knowing(x) for x in model.q0], p0=[knowing(x) for x in model.p0],
            # a tensor has rows, which are tuples
            bodies={name: [_map_leaves(list(x), knowing) if isinstance(x, tuple) else knowing(x)
                           for x in inertia] for name, inertia in model.bodies.items()},
            dt=None if model.dt is None else knowing(model.dt), steps=model.steps,
            rules={**model.rules, **({"frame": "start"} if model.frame else {})},
            events=tuple(model.events), visuals=dict(getattr(model, "visuals", {})),
        )

    @property
    def start(self) -> Start:
        """Where a run of it starts; γ and α without a value are found by its rules."""
        return Start(*self.state, self.parameters).of_model(self.bodies, self.rules,
                                                            events=self.events)

    @property
    def state(self) -> tuple[Array, Array]:
        """The state as arrays of objects: NumPy's own would lose digits."""
        import numpy as np

        q0, p0 = (np.array(x, dtype=object) for x in (self.q0, self.p0))
        return q0, p0

    def as_json(self) -> dict[str, Any]:
        """Return a JSON value: a double, or text for a number with more digits."""
        content = asdict(replace(self, visuals={}))  # shapes hold arrays, which JSON does not
        del content["visuals"]
        if self.visuals:
            content["visuals"] = {name: [shape.as_json() for shape in shapes]
                                  for name, shapes in self.visuals.items()}
        events = []
        for event in self.events:
            numbers = {key: getattr(event, key) for key in _EXACT if hasattr(event, key)}
            events.append(asdict(event) | {key: _exact_text(x) for key, x in numbers.items()})
        return content | {name: _map_leaves(content[name], _text) for name in _NUMBERS} | {
            "events": events}

    @classmethod
    def from_json(cls, content: dict[str, Any]) -> RunDefaults:
        """Read the result of ``as_json``."""
        events = []
        for fields in content["events"]:
            numbers = {key: _exact_number(fields[key]) for key in _EXACT if key in fields}
            kind = Impact if "restitution" in fields else Event  # an event has no restitution
            events.append(kind(**fields | numbers))
        visuals = {name: [Shape(**fields) for fields in shapes]
                   for name, shapes in content.get("visuals", {}).items()}
        return cls(**content | {name: _map_leaves(content[name], _number) for name in _NUMBERS} | {
            "events": tuple(events), "visuals": visuals})


def _map_leaves(content: Any, change: Any) -> Any:
    """Return a JSON value with ``change`` applied to its numbers and texts, not to its keys."""
    if isinstance(content, dict):
        return {key: _map_leaves(value, change) for key, value in content.items()}
    if isinstance(content, list):
        return [_map_leaves(value, change) for value in content]
    return change(content)


def _exact_text(value: Any) -> str:
    """Return a number as text that keeps all its digits, or the name of a parameter unchanged."""
    return value if isinstance(value, str) else str(exact(value))


def _exact_number(text: str) -> Any:
    """Return the inverse of ``_exact_text``: a fraction, or the name of a parameter.

    Names begin with a letter or an underscore.
    """
    return Fraction(text) if text[0].isdigit() or text[0] == "-" else text


def _text(value: Any) -> Any:
    """Return the text of a number that carries more digits than a double, else the argument."""
    return str(value.whole) if isinstance(value, Rounded) else value


def _number(value: Any) -> Any:
    """Return the inverse of ``_text``."""
    return Rounded(Fraction(value)) if isinstance(value, str) else value
