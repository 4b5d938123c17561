"""Calls of everything public with absurd arguments, one at a time.

Each call is one that works; then each of its arguments in turn is each of ``WRONG``. What comes
back is a result or an error of gyrospark's own, in a sentence: never an AttributeError, KeyError
or TypeError from within.
"""

from __future__ import annotations

import decimal
import fractions
import importlib
import inspect
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

import gyrospark as gs
import systems
from calls import PARAMETERS, TOP
from stores import record


class Later:
    """An object that is built when a call happens; its attributes and results are later too."""

    def __init__(self, make: Callable[[], Any]) -> None:
        self._make = cache(make)

    def __getattr__(self, name: str) -> Later:
        return Later(lambda: getattr(self._make(), name))

    def __call__(self, *arguments: Any) -> Later:
        return Later(lambda: self._make()(*map(resolve, arguments)))


def resolve(value: Any) -> Any:
    """Return an object, built now if it was to be built later."""
    return value._make() if isinstance(value, Later) else value


WRONG: dict[str, Any] = {
    "text": "abc", "empty text": "", "bytes": b"ab", "none": None, "function": lambda *a: None,
    "texts": ["a", "b"], "nan": math.nan, "inf": math.inf, "complex": 1j, "huge": 10**400,
    "bool": True, "minus": -1, "zero": 0, "half": 0.5, "block": np.zeros((2, 3, 4)),
    "empty": [], "dict": {}, "other dict": {1: object()}, "set": {1.0, 2.0}, "object": object(),
    "class": float, "symbol": sp.Symbol("x"), "pi": sp.pi, "matrix": sp.eye(2),
    "fraction": fractions.Fraction(1, 3), "decimal": decimal.Decimal("NaN"),
    "ragged": [[1.0], [1.0, 2.0]], "strings": np.array(["a", "b", "c", "d"]),
    "complexes": np.array([1j, 2, 3, 4]), "nones": [None] * 4, "bools": [True] * 4,
    "series": Later(lambda: importlib.import_module("pandas").Series([1.0, 2.0])),
    "frame": Later(lambda: importlib.import_module("pandas").DataFrame({"a": [1.0]})),
    "date": np.datetime64("2020-01-01"), "generator": (x for x in ()), "path": Path("nowhere"),
    "surrogate": "\ud800", "nul": "a\0b", "long": "x" * 1000,
}


@dataclass(frozen=True)
class Call:
    """A call that works: ``make()`` returns a function and its arguments."""

    name: str
    make: Callable[[], tuple[Callable[..., Any], dict[str, Any]]]
    #: Arguments that are left as they are: whatever stands there is meant so, or costs too much.
    kept: tuple[str, ...] = ()
    #: Wrong values that are left out.
    spared: tuple[str, ...] = field(default=())

    def variants(self) -> Iterator[tuple[str, str]]:
        """Yield the names of arguments and of wrong values."""
        _, arguments = self.make()
        for argument in arguments:
            if argument not in self.kept:
                for wrong in WRONG:
                    # a class can be called
                    spared = argument in ("progress", "observe", "slopes") and wrong == "class"
                    if wrong not in self.spared and not spared:
                        yield argument, wrong

    def try_one(self, argument: str, wrong: str) -> str:
        """Make the call with one wrong argument; return how it ended."""
        function, arguments = self.make()
        try:
            call(function, arguments | {argument: resolve(WRONG[wrong])})
        except gs.GyrosparkError as error:
            text = str(error)
            assert text.rstrip().endswith((".", ")", "]", "?")) or "\n" in text, text
            assert len(text) < 3000, text[:200]
            return "refused"
        return "accepted"


def call(function: Callable[..., Any], arguments: dict[str, Any]) -> Any:
    """Call a function with arguments by names, and with positional-only ones by position."""
    first: list[Any] = []
    remaining = dict(arguments)
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is parameter.POSITIONAL_ONLY:
            first.append(remaining.pop(name))
        elif parameter.kind is parameter.VAR_POSITIONAL and name in remaining:
            several = remaining.pop(name)
            first += several if isinstance(several, tuple) else [several]
    return function(*first, **remaining)


def value_and_gradient(step: gs.Stepper) -> Callable[..., Any]:
    """Return a function that makes an objective and evaluates it."""
    def evaluate(**arguments: Any) -> Any:
        arguments["loss"] = lambda run: (float(run.q[-1, 0]), {"q": [1.0, 0.0, 0.0, 0.0]})
        return call(step.value_and_gradient, arguments)([0.002])

    evaluate.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [parameter.replace(kind=parameter.KEYWORD_ONLY)
         for name, parameter in inspect.signature(step.value_and_gradient).parameters.items()
         if name != "options"])
    return evaluate


def calls(tmp_path: Path) -> list[Call]:
    """Return a call for everything public; nothing is compiled before a call begins."""
    step = Later(lambda: systems.stepper("heavy_top"))
    q, p = TOP.q0, TOP.p0
    run = {"dt": 1e-3, "parameters": PARAMETERS}
    either = run | {"dtau": None}
    state = {"start": q, "p": p}
    trajectory = Later(lambda: resolve(step).integrate(q, p, steps=3, **run))
    ensemble = Later(lambda: resolve(step).integrate_ensemble([q, q], [p, p], steps=3, workers=1,
                                                              **run))
    x, y = sp.symbols("x y", real=True)
    m = sp.Symbol("m", positive=True)

    def plain(name: str, function: Callable[..., Any], /, **arguments: Any) -> Call:
        return Call(name, lambda: (resolve(function), {
            key: resolve(value) for key, value in arguments.items()}))

    robot = {"base": "fixed", "angles": None, "rates": None, "ignore": (), "gravity": (0, 0, -9.81),
             "position": (0, 0, 0), "quaternion": None, "velocity": None,
             "angular_velocity": None, "loops": None, "limits": None}
    table = [
        plain("stepper", gs.stepper, scheme="G-L", stages=3, rep="gamma", system="heavy_top",
              tableau=None, real="double", frame=None, allow_invalid=False, energy=False,
              order=None, composition=None, progress=None),
        plain("tableau", gs.tableau, scheme=None, stages=None, A=[[0.5]], b=[1], c=None,
              A_hat=None, b_hat=None, A_tilde=None, A_bar=None, b_tilde=None, c_tilde=None,
              name="own"),
        plain("gamma", gs.gamma, inertia=TOP.inertia, rule="m"),
        plain("rotation_matrix", gs.symbols.rotation_matrix, x=sp.symbols("q0:4")),
        plain("of_body", gs.Start.of_body, attitude=np.eye(3), omega=(1, 2, 3),
              inertia=TOP.inertia, parameters=None),
        plain("consistent", gs.consistent, system=step, **state, parameters=PARAMETERS, t=0.0),
        plain("consistent", gs.consistent, system=gs.System((x,), (y,), (m,), y**2 / (2 * m)),
              start=[1.0], p=[1.0], parameters={"m": 1.0}, t=0.0),
        plain("tune", gs.tune, step=Later(lambda: systems.stepper("heavy_top_in_frame")),
              start=q, p=p, dt=1e-2, dtau=None, t_end=None, steps=8, step_error=None, gamma="auto",
              frame="start", aim="motion", parameters=TOP.parameters, inputs=None, pilot_steps=8,
              progress=None),
        plain("load_sweep", gs.load_sweep, path=str(tmp_path / "none.zarr")),
        plain("fast_top", gs.problems.fast_top),
        plain("regular_precession", gs.problems.regular_precession, radius_ratio=0.5, rate=30.0,
              height=0.1, density=2700.0, mass=1.0, gravity=9.81),
        plain("free_body", gs.problems.free_body, inertia=(2, 1.5, 1), angular_velocity=(1, 2, 3),
              attitude=(1, 0, 0, 0)),
        plain("cone_mass", gs.problems.cone_mass, density=1.0, radius=1.0, height=1.0),
        plain("Problem", gs.problems.Problem, name="a", parameters={}, q0=q, p0=p,
              inertia=TOP.inertia, system="heavy_top", exact=None, description=""),
        plain("lagrange_top", gs.models.lagrange_top, rep="gamma"),
        plain("satellite", gs.models.satellite, rate=1e-3, inertia=(100, 120, 30)),
        plain("double_pendulum", gs.models.double_pendulum, angles=(1, 2)),
        plain("double_top", gs.models.double_top, rep="gamma"),
        plain("gimbal", gs.models.gimbal, rep="gamma"),
        plain("four_bar", gs.models.four_bar, rate=1.0),
        plain("delta_robot", gs.models.delta_robot, rep="gamma"),
        plain("stewart_platform", gs.models.stewart_platform, rep="gamma"),
        plain("chain", gs.models.chain, count=1, rep="gamma"),
        plain("step", step.step, **state, **run, solver="auto", inputs=None),
        plain("integrate", step.integrate, **state, **either, steps=3, every=1,
              solver=gs.Solver(tolerance=1e-12), progress=None, events=gs.Event("q1"), inputs=None,
              t_eval=[0.001, 0.0025], t_end=None, tangents=None,
              out=None),
        plain("integrate", step.integrate, start=TOP, p=None, **either, steps=None, every=1,
              solver="auto", progress=None, events=(), inputs=None, t_eval=None, t_end=0.003,
              tangents=gs.Tangents(), out=None),
        plain("Tangents", gs.Tangents, start="all", parameters=["I1"], dt=True, t0=False,
              project=False, multipliers=False),
        plain("jvp", step.jvp, start=q, direction=(p, [0, 1, 0, 0], np.zeros(4)), **run,
              d={"I1": 1.0}, inputs=None, project=True),
        plain("vjp", step.vjp, **state, **run, wrt=["start", "I1"], inputs=None),
        plain("gradient", step.gradient, run=trajectory, cotangents={"q": q}, loss=None, wrt=None,
              memory="1 MB", solver="auto"),
        plain("Trajectory.gradient", trajectory.gradient, cotangents={"q": q}, stepper=step),
        plain("hvp", step.hvp, start=q, directions=(p, [0, 1, 0, 0], np.zeros(4), q, q), **run,
              d={"I1": 1.0}, inputs=None, project=True),
        plain("hessian", step.hessian, run=trajectory, cotangents={"q": q}, loss=None, slopes=None,
              wrt=["I1"], memory="1 MB", solver="auto"),
        plain("Trajectory.hessian", trajectory.hessian, cotangents={"q": q}, stepper=step),
        Call("value_and_gradient", lambda: (value_and_gradient(resolve(step)), {
            "loss": x, **state, **run, "wrt": ["I1"], "steps": 3, "t_end": None, "inputs": None,
            "every": 1, "t_eval": None, "events": (), "solver": "auto", "memory": "1 MB"}),
            kept=("loss", "t_eval")),  # the loss asks for the last row
        plain("fit", gs.fit, stepper=step, start=TOP, t=trajectory.t, data=trajectory.q,
              parameters=PARAMETERS, observe="attitude", dt=1e-3, dtau=None, free=["I1"],
              fixed=["I2"], sigma=1e-3, horizons=None, inputs=None, max_iterations=3,
              progress=None),
        plain("lyapunov", gs.lyapunov, stepper=step, **state, **run, steps=40, t_end=None, count=1,
              every=20, inputs=None, solver="auto", covariant=False, progress=None),
        plain("periodic_orbit", gs.periodic_orbit, stepper=step, **state, **run, steps=40,
              fix="energy", free=None, max_iterations=2, progress=None),
        plain("integrate_ensemble", step.integrate_ensemble, starts=[q, q], p=[p, p], **either,
              steps=3, t_end=None, every=1, solver=gs.Solver(), workers=1,
              events=gs.Event("q1"), inputs=None, tangents=gs.Tangents(), device="cpu",
              progress=None),
        plain("at", trajectory.at, times=[0.0015], stepper=step),
        plain("Trajectory.at", trajectory.at, times=[0.0015], stepper=step),
        plain("start", step.start, **state, **either, solver="auto", record=False),
        plain("advance", Later(lambda: resolve(step).start(q, p, **run)).advance, steps=2,
              inputs=None),
        plain("Start", gs.Start, q=q, p=p, parameters=PARAMETERS, t=0.0, inputs={}),
        plain("Solver", gs.Solver, kind="newton", tolerance=1e-12, max_iterations=50),
        plain("Inputs", gs.Inputs, values=[0.1], hold=2),
        plain("Event", gs.Event, quantity="q1", level=0.0, direction=1, terminal=False, name="a"),
        plain("Impact", gs.Impact, quantity="q1", restitution=0.5, terminal=False, name="a"),
        plain("section", gs.section, stepper=step, starts=[q, q], p=[p, p], **run, dtau=None,
              steps=3, t_end=None, event=gs.Event("q1"), solver="auto", workers=1, tangents=None,
              progress=None),
        plain("build", gs.build, target="cpp", system="fast-top", scheme="EMS", stages=None,
              rep="gamma", order=None, composition=None, real="double", dt=1e-3, start=(q, p),
              parameters=PARAMETERS, out=tmp_path / "built", platforms=None,
              progress=None),
        plain("playground", gs.playground, system="fast-top", scheme="EMS", stages=None,
              rep="gamma", order=None, composition=None, real="double", dt=1e-3, start=(q, p),
              parameters=PARAMETERS, progress=None),
        plain("load_model", gs.load_model, path=str(tmp_path / "none.urdf"), rep="gamma",
              real="double", set=None, **robot, keyframe=None),
        plain("from_file", gs.Multibody.from_file, path=str(tmp_path / "none.urdf"), rep="gamma",
              **robot),
        plain("residual", step.residual, x=np.zeros(18), **state, **either, t=0.0),
        plain("jacobian", step.jacobian, x=np.zeros(18), **state, **either, t=0.0),
        plain("guess", step.guess, **state, **either, t=0.0),
        plain("energy", step.energy, **state, parameters=PARAMETERS, t=0.0, of_motion=False),
        plain("accelerations", step.accelerations, **state, parameters=PARAMETERS, t=0.0),
        plain("mass_matrix", step.mass_matrix, **state, joints=None, parameters=PARAMETERS, t=0.0),
        plain("inverse_dynamics", step.inverse_dynamics, start=q, accelerations=(p, [0, 0, 0, 0]),
              inputs=None, parameters=PARAMETERS, t=0.0),
        plain("quantities", step.quantities, **state, parameters=PARAMETERS, t=0.0),
        plain("defects", step.defects, **state, parameters=PARAMETERS, t=0.0),
        plain("project", step.project, **state, parameters=PARAMETERS, t=0.0),
        plain("Stepper.consistent", step.consistent, **state, parameters=PARAMETERS, t=0.0),
        plain("quantity", trajectory.quantity, name="none"),
        plain("axis", trajectory.axis, body=None),
        plain("rotation", trajectory.rotation, body=None),
        plain("angular_velocity", trajectory.angular_velocity, body=None),
        plain("save", trajectory.save, path=tmp_path / "a.csv", columns="q", euler="zyx",
              degrees=False, angular_velocity="body"),
        plain("load", gs.load, path=tmp_path / "none.npz"),
        plain("plot", trajectory.plot, names=("energy",), path=tmp_path / "a.png"),
        plain("body", trajectory.body, name=None),
        plain("joint", trajectory.joint, name=None),
        plain("euler", trajectory.body().euler, sequence="zyx", degrees=False),
        plain("Body.angular_velocity", trajectory.body().angular_velocity, frame="body"),
        plain("Body.angular_momentum", trajectory.body().angular_momentum, frame="space"),
        plain("Body.position", trajectory.body().position, on_body=(0.0, 0.0, 1.0)),
        plain("Body.velocity", trajectory.body().velocity, on_body=(0.0, 0.0, 1.0)),
        plain("Body.plot", trajectory.body().plot, path=tmp_path / "b.png", euler="zyx",
              degrees=True),
        plain("plot_phase", trajectory.plot_phase, path=tmp_path / "c.png"),
        plain("table", trajectory.table, euler="zyx", degrees=False, angular_velocity="body",
              columns="q"),
        plain("dataset", trajectory.dataset, euler="zyx", degrees=False, angular_velocity="body"),
        plain("Ensemble.dataset", ensemble.dataset),
        plain("Ensemble.table", ensemble.table, columns="q"),
        plain("Ensemble.show", ensemble.show, path=tmp_path / "many.html", member=1, shape="box"),
        plain("Ensemble.save", ensemble.save, path=tmp_path / "many.csv", columns="q"),
        plain("Ensemble.plot", ensemble.plot, path=tmp_path / "many.png", names=("q1",)),
        plain("show", trajectory.show, path=tmp_path / "a.html", shape="box", meshes="none"),
        plain("show", trajectory.show, path=tmp_path / "a.glb", meshes="none"),
        plain("Shape", gs.Shape, kind="box", size=(1.0, 1.0, 1.0), centre=(0, 0, 0),
              axes=np.eye(3), colour="#4c78a8", file=""),
        plain("show", trajectory.show, path=tmp_path / "d.png", size=(32, 24), time=0.01,
              azimuth=10.0, elevation=20.0, background="dark", traces=True),
        plain("show", trajectory.show, path=tmp_path / "a.gif", seconds=0.2, fps=10, shape="box"),
        plain("System", gs.System, q=(x,), p=(y,), parameters=(m,), H=y**2 / (2 * m) + x**2,
              constraints=(), name="a", constraint_names=(), forces=(), time=None,
              quantities={"z": x}, rigid_body=False, bodies=(), inputs=(), joints=(),
              velocity_constraints=(), velocities=(), velocity_constraint_names=(),
              time_scale=1 + x**2),
        Call("from_mechanics", lambda: (gs.from_mechanics, {
            "method": free_particle(), "name": "a", "inputs": (), "bodies": False})),
        plain("body_system", gs.body_system, name="a", rep="gamma", potential=sp.Integer(0),
              parameters=(), torque=(), time_scale=None, quantities={}, tensor=False),
        plain("Multibody", gs.Multibody, name="a", gravity=(0, 0, -9.81), dt=0.1, steps=3,
              description=""),
        Call("certify", lambda: (gs.certify, {
            "model": gs.problems.fast_top(), "scheme": "IMS", "stages": None, "rep": "gamma",
            "tableau": None, "allow_invalid": False, "frame": None, "dt": 1e-3,
            "dtau": None, "steps": 2, "parameters": {}, "real": "double", "energy": False,
            "order": None, "composition": None, "progress": None}),
            kept=("allow_invalid",), spared=("half", "none", "zero", "empty text", "fraction",
                                             "dict", "pi")),
        plain("cite", gs.cite, stepper=step),
        Call("resume", lambda: (gs.resume, {"path": str(tmp_path / "none.zarr"), "t_end": None,
                                            "steps": 3, "progress": None})),
        Call("sweep", lambda: (gs.sweep, {
            "model": TOP, "over": {"mgl": [0.3, 0.4]}, "scheme": "IMS", "stages": None,
            "order": None, "rep": "gamma", "real": "double", "frame": None, "parameters": {},
            "dt": 1e-3, "dtau": None, "steps": 2, "t_end": None, "every": None, "solver": "auto",
            "keep": None, "out": None, "resume": False, "workers": 1, "dask": None,
            "progress": None, "events": gs.Event("q1")})),
    ]
    return [*table, *recording_calls(tmp_path), *model_calls(), *multibody_calls()]


def recording_calls(tmp_path: Path) -> Iterator[Call]:
    """Yield calls of the methods of a stored run."""
    @cache
    def stored():
        return record(systems.stepper("heavy_top"), TOP.q0, TOP.p0, dt=1e-3, steps=3,
                         parameters=PARAMETERS, out=tmp_path / "kept.zarr")

    yield Call("Recording.save", lambda: (stored().save, {
        "path": tmp_path / "a.csv", "euler": "ZXZ", "degrees": True, "columns": "q",
        "angular_velocity": "body"}))


def model_calls() -> Iterator[Call]:
    """Yield calls about models and their numbers."""
    x, y = sp.symbols("x y", real=True)
    system = gs.System((x,), (y,), (), H=y**2 / 2)

    def model() -> tuple[Callable[..., Any], dict[str, Any]]:
        return gs.Model, {"system": system, "parameters": {}, "q0": [1.0], "p0": [1.0],
                          "bodies": {}, "dt": 0.1, "steps": 3, "description": "", "frame": "",
                          "rules": {}, "events": [gs.Event("x")], "units": {"x": "m"},
                          "visuals": {"": [gs.Shape("box", (1.0, 1.0, 1.0))]}}

    yield Call("Model", model)


def free_particle() -> Any:
    """Return the method of a particle on a line."""
    import sympy.physics.mechanics as me

    x = me.dynamicsymbols("x")
    return me.LagrangesMethod(x.diff(me.dynamicsymbols._t) ** 2, [x])


def multibody_calls() -> Iterator[Call]:
    """Yield calls of every method of a builder, and of a body."""
    inertia = (0.1, 0.12, 0.13)
    none: dict[str, Any] = dict.fromkeys(("axis", "axis_on_body", "axis_in_space"))
    axis, on_body, in_space = (none | {name: (0, 0, 1)} for name in none)

    def of(method: str, /, **arguments: Any) -> Call:
        def make() -> tuple[Callable[..., Any], dict[str, Any]]:
            build = gs.Multibody("b")
            top = build.top("t", mass=1, inertia=inertia, centre=(0, 0, 1))
            body = build.body("u", mass=1, inertia=inertia)
            components = {"top": top, "body": body, "ground": build.ground}
            used_names = {*map(str, (*arguments.values(), *arguments.get("joints", ())))}
            if {"hinge", "other", "slide"} & used_names:
                for joint in ("hinge", "other"):
                    wheel = build.body(f"{joint}_wheel", mass=1, inertia=inertia)
                    components[joint] = build.revolute(joint, build.ground, wheel, axis=(0, 0, 1),
                                                       at=(0, 0, 0))
                cart = build.body("cart", mass=1, inertia=inertia)
                components["slide"] = build.prismatic("slide", build.ground, cart, axis=(1, 0, 0),
                                                      at=(0, 0, 0))
            resolved = {key: components.get(value, value) if isinstance(value, str) else value
                        for key, value in arguments.items()}
            return getattr(build, method), resolved

        return Call(f"Multibody.{method}", make)

    yield of("body", name="c", mass=1.0, inertia=inertia, rep="gamma", weight=0.1,
             position=(0, 0, 0), quaternion=(1, 0, 0, 0), velocity=(0, 0, 0),
             angular_velocity=(0, 0, 0))
    yield of("body", name="c", mass=1.0, inertia=inertia, rotation=np.eye(3))
    yield of("top", name="c", mass=1.0, inertia=inertia, centre=(0, 0, 1), at=(0, 0, 0),
             rep="gamma", weight=0.1, quaternion=(1, 0, 0, 0), angular_velocity=(0, 0, 0))
    yield of("point_mass", name="c", mass=1.0, position=(0, 0, 0), velocity=(0, 0, 0))
    yield of("rotor", name="c", body="body", mass=1.0, inertia=(1.0, 0.6), **axis,
             at=None, on_body=(0, 0, 0), rate=1.0)
    yield of("ball", name="j", a="top", b="body", at=None, on_a=(0, 0, 1), on_b=(0, 0, 0))
    yield of("fixed_point", name="j", body="body", at=(0, 0, 0), on_body=(0, 0, 1))
    yield of("revolute", name="j", a="top", b="body", **axis, at=None, on_a=(0, 0, 1),
             on_b=(0, 0, 0), rate=1.0, angle=0.0)
    yield of("align", name="j", a="top", b="body", **on_body, rate=1.0, angle=0.0)
    yield of("rod", name="j", a="top", b="body", on_a=(0, 0, 1), on_b=(0, 0, 0), length=1.0)
    yield of("spring", name="j", a="top", b="body", stiffness=1.0, length=1.0, on_a=(0, 0, 1),
             on_b=(0, 0, 0), damping=0.0)
    pair = {"name": "j", "a": "top", "b": "body", "at": None, "on_a": (0, 0, 1),
            "on_b": (0, 0, 0)}
    yield of("prismatic", **pair, **in_space, speed=1.0, travel=0.0)
    yield of("cylindrical", **pair, **axis, rate=1.0, speed=1.0, angle=0.0, travel=0.0)
    yield of("planar", **pair, **axis, rate=1.0, angle=0.0)
    yield of("screw", **pair, **axis, lead=0.1, rate=1.0, travel=0.0)
    yield of("universal", **pair, axis_a=(1, 0, 0), axis_b=(0, 1, 0), rate_a=1.0, rate_b=0.0)
    for shape in ({"disc": 1.0}, {"sphere": 1.0}, {"ellipsoid": (1, 2, 3)}):
        yield of("rolls", name="j", body="body", on_body=(0, 0, 0.1), axis_on_body=(0, 0, 1),
                 normal=(0, 0, 1), at=(0, 0, 0), turning=1.0,
                 **dict.fromkeys(("disc", "sphere", "ellipsoid")) | shape)
    yield of("fixed", **pair, rotation=None)
    yield of("flywheel", name="j", joint="hinge", inertia=0.1, ratio=2.0)
    yield of("chain_of_rods", points=[(0, 0, 5), (0, 0, 4)], mass=1.0, radius=0.01, axis=(1, 0, 0),
             a=None, name="extra", rep="gamma")
    yield of("beam", name="c", count=2, mass=1.0, bending=1.0, twisting=1.0, start=None, end=None,
             points=[(0, 0, 5), (0, 0, 4)], stretching=10.0, shearing=10.0, damping=0.0,
             rest=(0, 0, 0), normal=(1, 0, 0), twist=0.0, radius=0.1, inertia=None,
             velocity=(0, 0, 0), angular_velocity=(0, 0, 0), rep="gamma")
    yield of("chain", name="j", a="top", b="body", joints=[
        {"name": "k", "axis": (1, 0, 0), "inertia": 0.1, "at": (0, 0, 0), "rate": 1.0}])
    yield of("law", name="j", joints=["hinge", "slide"], f=lambda x, y: x - y)
    yield of("gear", name="j", first="hinge", second="other", teeth=(20, 30))
    yield of("couple", name="j", first="hinge", second="other", ratio=2.0, offset=0.0)
    yield of("drive", name="j", joint="hinge", angle=sp.Integer(1))
    yield of("motor", name="j", joint="hinge", torque=1.0, force=None)
    yield of("joint_spring", name="j", joint="hinge", stiffness=1.0, damping=0.1, rest=0.0,
             coordinate="angle")
    yield of("moving_point", name="j", path=(0.0, 0.0, 1.0))
    yield of("contact", name="j", a="body", b="ground", gap=None, on_a=(0.0, 0.0, 0.1),
             on_b=(0.0, 0.0, -9.0), normal=(0.0, 0.0, 1.0), radius=0.1, box=None, restitution=0.5)
    yield of("latch", name="j", a="body", b="ground", close=["hinge"], on_a=(0.0, 0.0, 0.1),
             on_b=(0.0, 0.0, -9.0), normal=(0.0, 0.0, 1.0), radius=0.1)
    yield of("stop", name="j", joint="hinge", lower=-1.0, upper=1.0, restitution=0.5,
             coordinate="angle")
    yield of("angle", joint="hinge")
    yield of("rate", joint="hinge")
    yield of("travel", joint="slide")
    yield of("speed", joint="slide")
    yield of("potential", expression=sp.Integer(1))
    yield of("parameter", name="k", value=1.0, positive=False)
    yield of("input", name="k", value=1.0)
    yield of("force", body="body", force=(0, 0, 1), on_body=(0, 0, 1))
    yield of("torque", body="body", torque=(0, 0, 1))
    yield of("time_scale", expression=2)
    yield of("quantity", name="k", expression=sp.Integer(1))
    yield of("visual", body="body", shape=gs.Shape("box", (1.0, 1.0, 1.0)))
    yield of("model", without=(), redundant="refuse", closed=(), start=None)
    build = gs.Multibody("b")
    body = build.body("u", mass=1, inertia=inertia)
    for method, argument in (("point", "r"), ("direction", "v"), ("point_velocity", "r")):
        yield Call(f"Body.{method}", lambda method=method, argument=argument: (
            getattr(body, method), {argument: (0, 0, 1)}))
