"""Programs at equal error: the cheapest run of each for an error, ``make bench WHAT="peers"``.

A problem has a reference for its end and a list of codes, each a program with one setting and a
run. The programs run one after another, in as many rounds as the command line says, each in a
process of its own if there is more than one round: a time is the least of them, each a median of
CPU seconds of all threads. A problem's reference is computed once, before the processes start.
"""

from __future__ import annotations

import multiprocessing
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any

import numpy as np
import sympy as sp

import gyrospark as gs

from .adaptive import kepler
from .attitudes import Array
from .bodies import our_centres
from .gradients import OUR_STEPS, FastTopGradient
from .peers import entries
from .peers.entry import PeerEntry
from .peers.exudyn_scenes import EXPLICIT, IMPLICIT, ExudynScene
from .peers.first_order import FirstOrder, diffrax_run, heyoka_run, scipy_run
from .peers.gradient_job import GradientJob, Job
from .peers.mujoco_scenes import MujocoScene
from .reference_states import distance
from .rows import Choice, Entry, Prepared, Row, cheapest, contest, markdown, text_of
from .scenes import scene_of
from .tops import INERTIA, MGL, euler_equations, state_of, tops

__all__ = ["PROBLEMS", "PROGRAMS", "Code", "Problem", "levels", "losses", "page",
           "peers"]

#: Programs that are compared; gyrospark first.
PROGRAMS = ("gyrospark", "heyoka", "scipy", "diffrax", "mujoco", "exudyn")
COST, ERROR = "CPU ms", "error"


@dataclass(frozen=True)
class Code:
    """A program with one setting.

    Attributes
    ----------
    program, setting : str
    prepare : callable
        Imports, compiles, and returns a run from the start to the end, which returns the end.
    quick : bool
        Whether it belongs to a quick run.
    """

    program: str
    setting: str
    prepare: Callable[[], Callable[[], Any]]
    quick: bool = False


@dataclass(frozen=True)
class Problem:
    """A motion, the reference of its end, and the codes that compute it.

    Attributes
    ----------
    about : str
        The motion, and its error.
    levels : tuple of float
        Errors for which the cheapest run of each program is looked up.
    reference : callable
        Returns the reference that ``error`` compares an end with; it can be pickled.
    codes : callable
        Returns the codes.
    error : callable
        Called with the end of a run and the reference.
    absent : mapping of str to str
        Program → why it has no code.
    quick : bool
        Whether it belongs to a quick run.
    """

    about: str
    levels: tuple[float, ...]
    reference: Callable[[], Any]
    codes: Callable[[], Iterable[Code]]
    error: Callable[[Any, Any], float]
    absent: Mapping[str, str] = field(default_factory=dict)
    quick: bool = True


# ---------------------------------------------------------------- measuring


def peers(choice: Choice) -> list[Row]:
    """Return a row for each problem, program and setting."""
    rows = []
    for name, problem in PROBLEMS.items():
        if choice.only in name and problem.quick >= choice.quick:
            choice.watch(f"{name}: reference")
            rows += _fastest(name, problem.reference(), choice)
    return rows


def _fastest(name: str, reference: Any, choice: Choice) -> list[Row]:
    """Return the rows of a problem, each with the least cost of all rounds.

    After the first round settings that are far from the cheapest for every error are left out.
    """
    best: dict[tuple[str, str], Row] = {}
    for number in range(choice.rounds):
        for program in filter(choice.programs.__contains__, PROGRAMS):
            settings = _near_cheapest([row for key, row in best.items() if key[0] == program],
                                      PROBLEMS[name].levels)
            if number and not settings:
                continue
            choice.watch(f"{name}: {program}, process {number + 1} of {choice.rounds}")
            job = _Job(name, program, reference, settings, choice.quick)
            for row in _in_own_process(job) if choice.rounds > 1 else job():
                previous = best.setdefault((program, row.setting), row)
                if row.numbers.get(COST, np.inf) < previous.numbers.get(COST, np.inf):
                    best[program, row.setting] = row
    return list(best.values())


def _near_cheapest(rows: Sequence[Row], levels: Sequence[float]) -> tuple[str, ...]:
    """Return the settings that cost up to 1.5 times as much as the cheapest for an error."""
    limits = {level: 1.5 * row.numbers[COST] for level in levels
              if (row := cheapest(rows, COST, ERROR, level)) is not None}
    return tuple(row.setting for row in rows if any(
        row.numbers.get(ERROR, np.inf) <= level and row.numbers[COST] <= limit
        for level, limit in limits.items()))


@dataclass(frozen=True)
class _Job:
    """The settings of a program that a process measures; no settings: all of them."""

    name: str
    program: str
    reference: Any
    settings: tuple[str, ...]
    quick: bool

    def __call__(self) -> list[Row]:
        problem = PROBLEMS[self.name]
        return contest(self.name, (
            Entry(code.program, code.setting, partial(_prepared, problem, code, self.reference),
                  code.quick) for code in problem.codes()
            if code.program == self.program and code.setting in (self.settings or [code.setting])),
            Choice((self.program,), self.quick, rounds=1))


def _in_own_process(job: _Job) -> list[Row]:
    """Return the rows of a job; a process that breaks gives a row with the error."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
        try:
            return process.submit(job).result()
        except BrokenProcessPool as error:
            return [Row(job.name, job.program, "", note=f"failed: {error}",
                        failed=job.program == PROGRAMS[0])]


def _prepared(problem: Problem, code: Code, reference: Any) -> Prepared:
    run = code.prepare()
    return Prepared({ERROR: problem.error(run(), reference)}, {"run": run},
                    lambda times: {COST: times["run"].median * 1e3})


# ---------------------------------------------------------------- codes


def _first_order(equations: FirstOrder, read: Callable[[Array], Any]) -> Iterator[Code]:
    """Yield heyoka, SciPy and diffrax; ``read`` takes the end from the variables."""
    def reader(make: Callable[[], Callable[[], Array]]) -> Callable[[], Any]:
        run = make()
        return lambda: read(run())

    for tol in ("", "1e-14", "1e-12", "1e-10", "1e-8", "1e-6"):
        options = {"tol": float(tol)} if tol else {}
        yield Code("heyoka", f"tol {tol}" if tol else "default",
                   partial(reader, partial(heyoka_run, equations, **options)), not tol)
    for tol in ("1e-7", "1e-9", "1e-11", "1e-13"):
        yield Code("scipy", f"DOP853 tol {tol}",
                   partial(reader, partial(scipy_run, equations, float(tol))), tol == "1e-9")
        yield Code("diffrax", f"Dopri8 tol {tol}",
                   partial(reader, partial(diffrax_run, equations, float(tol))), tol == "1e-9")


def _scene(model: Callable[[], gs.Model], t_end: float, read: Callable[[Any], Any],
           mujoco: Mapping[str, Sequence[float]], exudyn: Mapping[str, Sequence[float]]
           ) -> Iterator[Code]:
    """Yield MuJoCo and exudyn on bodies and joints: method → time steps."""
    def of_mujoco(method: str, dt: float) -> Callable[[], Any]:
        run = MujocoScene(scene_of(model())).prepare(method, t_end, round(t_end / dt))
        return lambda: read(run())

    def of_exudyn(method: str, dt: float) -> Callable[[], Any]:
        scene = ExudynScene(scene_of(model()), lie_group=method in EXPLICIT)
        return lambda: read(scene.run(method, t_end, round(t_end / dt)))

    for program, prepare, methods in (("mujoco", of_mujoco, mujoco), ("exudyn", of_exudyn, exudyn)):
        for method, dts in methods.items():
            for dt in dts:
                yield Code(program, f"{method} Δt={dt:g}", partial(prepare, method, dt),
                           dt == dts[0] and method == next(iter(methods)))


def _own_codes(make: Callable[[int], gs.Stepper], start: Any, t_end: float,
               settings: Sequence[tuple[int, float]], values: Mapping[str, float] | None = None,
               name: str = "{}-G-L", tolerance: float | None = None) -> Iterator[Code]:
    """Yield our runs of (stages or order, steps a second)."""
    def prepare(size: int, steps: int) -> Callable[[], Any]:
        step, solver = make(size), gs.Solver("auto", tolerance)
        return lambda: step.integrate(
            start, dt=t_end / steps, steps=steps, every=steps, parameters=values,
            solver=solver).q[-1]

    for size, rate in settings:
        yield Code("gyrospark", f"{name.format(size)} Δt={1 / rate:.3g}",
                   partial(prepare, size, round(t_end * rate)), size == 3)


def _largest(end: Array, reference: Array) -> float:
    return float(np.abs(end - reference).max())


# ---------------------------------------------------------------- free body

_MOMENTS, _SPIN, _TUMBLE = (6.0, 8.0, 3.0), (0.5, 0.6, 0.7), 100.0


def _free_bodies() -> Iterator[Code]:
    problem = gs.problems.free_body(_MOMENTS, _SPIN)
    own_codes = partial(_own_codes, start=problem.start, t_end=_TUMBLE,
                        values=problem.parameters)
    gauss = partial(gs.stepper, "G-L", rep="gamma")
    yield from own_codes(gauss, settings=(
        (3, 2), (3, 4), (4, 1), (4, 2), (6, 0.5), (6, 1), (6, 1.5), (6, 2), (8, 0.5), (8, 0.75),
        (8, 1), (10, 0.5)))
    yield from own_codes(gauss, settings=((8, 0.5), (8, 1)), name="{}-G-L tolerance 1e-12",
                         tolerance=1e-12)
    yield from own_codes(gauss, settings=((6, 0.5), (8, 0.4)), name="{}-G-L tolerance 1e-7",
                         tolerance=1e-7)
    yield from own_codes(lambda order: gs.stepper("splitting", order=order, rep="gamma"),
                         settings=((8, 1), (8, 2), (10, 1), (10, 2)), name="splitting of order {}")
    variables = sp.symbols("q0 q1 q2 q3 w1 w2 w3", real=True)
    yield from _first_order(FirstOrder(
        variables, euler_equations(*variables, *map(sp.Float, (*_MOMENTS, 0.0))),
        (1.0, 0.0, 0.0, 0.0, *_SPIN), _TUMBLE), lambda x: x[:4])

    def model() -> gs.Model:
        build = gs.Multibody("tumbling", gravity=(0, 0, 0))
        build.body("body", mass=1.0, inertia=_MOMENTS, angular_velocity=_SPIN)
        return build.model()

    yield from _scene(model, _TUMBLE, lambda motions: motions["body"].q,
                      {"RK4": (0.05, 0.02, 0.01, 0.005)},
                      {"RK67": (0.2, 0.1, 0.05, 0.02), "RK44": (0.05,)})


def _attitude_error(end: Array, reference: Array) -> float:
    """Return the largest error of q or of −q, which is the same attitude."""
    return min(_largest(end, reference), _largest(-np.asarray(end), reference))


# ---------------------------------------------------------------- fast top

_TOP_SECONDS = 10.0


def _tops() -> Iterator[Code]:
    def reader(entry: PeerEntry) -> Callable[[], Any]:
        run = entry.prepare()
        return lambda: run(_TOP_SECONDS).q

    for entry in entries(("gyrospark", "mujoco", "exudyn")):
        if "newton" not in entry.setting:
            yield Code(entry.program, entry.setting, partial(reader, entry), entry.quick)
    variables = sp.symbols("q0 q1 q2 q3 w1 w2 w3", real=True)
    start = state_of(tops()[0])
    yield from _first_order(FirstOrder(
        variables, euler_equations(*variables, *map(sp.Float, (*INERTIA, MGL))),
        (*start.q, *start.omega), _TOP_SECONDS), lambda x: x[:4])


# ---------------------------------------------------------------- double pendulum

#: Points of unit mass on unit rods in 9.81 m/s²: angles from the vertical, at rest, and angles at
#: 20 s by Taylor series in binary128; Gauss-Lobatto of 8 and 10 stages has the same 32 digits.
_ANGLES, _SWINGS = (0.5, 0.3), 20.0
_ANGLES_AT_END = ("-0.209673344683044332628841572651", "-0.667488826973104654738733491542")


def _double_pendulums() -> Iterator[Code]:
    a, b, u, v = variables = sp.symbols("a b u v", real=True)
    c = sp.cos(a - b)
    H = (u**2 + 2 * v**2 - 2 * u * v * c) / (2 * (2 - c**2)) - sp.Float(9.81) * (
        2 * sp.cos(a) + sp.cos(b))
    system = gs.System((a, b), (u, v), (), H, name="pendulum_in_angles")
    own_codes = partial(_own_codes, lambda stages: gs.stepper("G-L", stages, system=system),
                        gs.Start(_ANGLES, (0.0, 0.0)), _SWINGS)
    yield from own_codes((
        (3, 20), (3, 40), (4, 10), (4, 20), (6, 5), (6, 10), (6, 12), (6, 20), (8, 4), (8, 6),
        (8, 8)))
    yield from own_codes(((8, 4), (8, 5)), name="{}-G-L tolerance 1e-9", tolerance=1e-9)
    yield from own_codes(((8, 5), (8, 8), (10, 5)), name="{}-G-L tolerance 1e-12",
                         tolerance=1e-12)
    yield from _first_order(FirstOrder(
        variables, (*system.H_p, *(-rate for rate in system.H_q)), (*_ANGLES, 0.0, 0.0), _SWINGS),
        lambda x: x[:2])

    def model() -> gs.Model:
        """Return the points as bodies that are as small as MuJoCo lets them be."""
        build, above, hinge = gs.Multibody("pendulum_of_points", gravity=(0, -9.81, 0)), "ground", (
            np.zeros(3))
        for number, angle in enumerate(_ANGLES):
            end = np.add(hinge, (np.sin(angle), -np.cos(angle), 0.0))
            build.body(f"point{number}", mass=1.0, inertia=(1e-14,) * 3, position=tuple(end))
            build.revolute(f"hinge{number}", above, f"point{number}", axis=(0, 0, 1),
                           at=tuple(hinge))
            above, hinge = f"point{number}", end
        with warnings.catch_warnings():  # of tiny bodies beside long rods
            warnings.simplefilter("ignore", gs.errors.InputWarning)
            return build.model(redundant="leave out")

    def angles(motions: Any) -> Array:
        first, second = (motions[f"point{number}"].x for number in range(2))
        rods = np.array([first, second - first])
        rod_angles: Array = np.arctan2(rods[:, 0], -rods[:, 1])
        return rod_angles

    yield from _scene(model, _SWINGS, angles, {"RK4": (1e-2, 5e-3, 2e-3, 1e-3)},
                      {"trapezoidal index 2": (1e-2, 1e-3), "generalised α": (1e-3,)})


# ---------------------------------------------------------------- Kepler

#: A number of periods that is no integer: after an integer one errors along the orbit hide.
_PERIODS = 10.37


def _orbits(e: float) -> Iterator[Code]:
    """Yield codes whose run returns a position and its time, near ``t_end`` in scaled time."""
    orbit = kepler(e, _PERIODS)
    plain = orbit.system.with_time_scale(None)

    def prepare(system: gs.System, name: str, end: float, stages: int, steps: float
                ) -> Callable[[], tuple[Array, float]]:
        step, count = gs.stepper("G-L", stages, system=system), round(steps * _PERIODS)
        options: dict[str, Any] = {name: end / count, "steps": count, "every": count}
        start = gs.Start(orbit.q, orbit.p)

        def run() -> tuple[Array, float]:
            trajectory = step.integrate(start, **options)
            return trajectory.q[-1], float(trajectory.t[-1])

        return run

    scaled = {4: (16, 24), 6: (8, 10, 14, 20), 8: (8, 10, 12, 16)} if e > 0.3 else {}
    for stages, counts in scaled.items():
        for steps in counts:
            yield Code("gyrospark", f"{stages}-G-L scaled, {steps} steps a period", partial(
                prepare, orbit.system, "dtau", orbit.tau_end, stages, steps))
    for stages in (4, 6, 8):
        for steps in (round(n / (1 - e) ** 1.5, 1) for n in (4, 6, 8, 12, 16)):
            yield Code("gyrospark", f"{stages}-G-L, {steps:g} steps a period", partial(
                prepare, plain, "dt", orbit.t_end, stages, steps), stages == 4)
    variables = (*plain.q, *plain.p)
    yield from _first_order(FirstOrder(
        variables, (*plain.H_p, *(-rate for rate in plain.H_q)), (*orbit.q, *orbit.p),
        orbit.t_end), lambda z: (z[:2], orbit.t_end))


def _orbit_error(end: tuple[Array, float], e: float) -> float:
    position, t = end
    return _largest(position, kepler(e, _PERIODS).position(t))


# ---------------------------------------------------------------- bodies on joints

_LINKAGE_SECONDS = 1.0


def _linkages(model: Callable[[], gs.Model]) -> Iterator[Code]:
    for stages, dts in ((2, (2e-2, 1e-2, 5e-3)), (3, (2e-2, 1e-2, 5e-3, 2e-3)),
                        (4, (2e-2, 1e-2, 5e-3, 2e-3)), (6, (2e-2, 1e-2, 5e-3))):
        for dt in dts:
            yield Code("gyrospark", f"{stages}-G-L Δt={dt:g}", partial(_centres, model, stages, dt),
                       (stages, dt) == (2, 1e-2))
    shorter = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4, 6.25e-5)
    yield from _scene(model, _LINKAGE_SECONDS,
                      lambda motions: np.array([motion.x for motion in motions.values()]),
                      {"RK4": shorter}, dict.fromkeys(IMPLICIT, shorter))


def _centres(model: Callable[[], gs.Model], stages: int, dt: float, real: Any = "double"
             ) -> Callable[[], Array]:
    scene = scene_of(model())
    return partial(our_centres, scene, gs.stepper("G-L", stages, system=scene.model, real=real), dt)


def _reference_centres(model: Callable[[], gs.Model]) -> Array:
    return _centres(model, 6, 5e-4, "long-double")()


def _farthest(end: Array, reference: Array) -> float:
    return float(np.linalg.norm(end - reference, axis=1).max())


# ---------------------------------------------------------------- gradients

_top_gradient = cache(FastTopGradient)


def _gradients() -> Iterator[Code]:
    def prepare(make: Callable[[], Job]) -> Callable[[], GradientJob]:
        return make().gradient

    case = _top_gradient()
    for stages, dts in OUR_STEPS.items():
        for dt in dts:
            yield Code("gyrospark", f"{stages}-G-L adjoint Δt={dt:g}",
                       partial(prepare, partial(case.ours, stages, dt)), (stages, dt) == (3, 4e-3))
    for program, settings in (peer for peer in case.others() if peer[0] in PROGRAMS):
        for number, (setting, make) in enumerate(settings.items()):
            yield Code(program, setting, partial(prepare, make), number == 0)


def _gradient_error(end: GradientJob, truth: tuple[Array, Array]) -> float:
    return max(_top_gradient().errors(end, truth).values())


# ---------------------------------------------------------------- all of them

#: Programs → why they have no code of a problem.
_NO_GRAVITATION = dict.fromkeys(("mujoco", "exudyn"), "has no gravitation between bodies")
_NO_CONSTRAINTS = dict.fromkeys(("heyoka", "scipy", "diffrax"), "has no constraints")
_NO_GRADIENTS = dict.fromkeys(("scipy", "exudyn"), "has no gradients")


PROBLEMS: dict[str, Problem] = {
    "free body": Problem(
        "A body of moments 6, 8 and 3 kg m² that starts with Ω = (0.5, 0.6, 0.7) rad/s, 100 s. "
        "Largest error of its quaternion; the reference is in closed form by Jacobi's functions.",
        (1e-6, 1e-10, 1e-13), lambda: gs.exact.free_body(_MOMENTS, _SPIN).attitude([_TUMBLE])[0],
        _free_bodies, _attitude_error),
    "fast top": Problem(
        "The paper's top, 10 s. Distance of its mass centre in m; the reference is a Taylor "
        "integration in long double.",
        (1e-6, 1e-10, 1e-13), lambda: _TOP_SECONDS, _tops,
        lambda q, t: float(distance(q[None], t)[0])),
    "double pendulum": Problem(
        "Points of 1 kg on rods of 1 m, from rest at 0.5 and 0.3 rad, 20 s, in angles; MuJoCo and "
        "exudyn have bodies on hinges. Largest error of the angles in rad; the reference is a "
        "Taylor integration in binary128, which Gauss-Lobatto in binary128 confirms.",
        (1e-6, 1e-10, 1e-13), lambda: np.array([float(x) for x in _ANGLES_AT_END]),
        _double_pendulums, _largest),
    **{f"Kepler, e = {e}": Problem(
        f"An orbit of eccentricity {e}, 10.37 periods. Largest error of the position, of a "
        "semi-major axis of 1; the reference is Kepler's equation with 30 digits.",
        (1e-6, 1e-10, 1e-13), partial(float, e), partial(_orbits, e), _orbit_error,
        _NO_GRAVITATION) for e in (0.1, 0.6, 0.9)},
    **{name: Problem(
        f"{about}, 1 s. Largest distance of a centre of mass in m; the reference is 6-G-L at "
        "0.5 ms in long double, with which exudyn and MuJoCo agree as far as they converge.",
        (1e-3, 1e-6, 1e-10), partial(_reference_centres, model),
        partial(_linkages, model), _farthest, _NO_CONSTRAINTS, quick=False)
        for name, about, model in (
            ("chain of 8", "Eight bodies on ball joints", partial(gs.models.chain, 8)),
            ("four-bar", "Four-bar linkage, a closed loop", gs.models.four_bar))},
    "gradient": Problem(
        "|q(2 s) − q*|² of the fast top by its initial state and four parameters, value and "
        "gradient together. Error relative to the largest entry; the reference is the gradient of "
        "6-G-L at 2 ms in long double.",
        (1e-6, 1e-10, 1e-13), lambda: _top_gradient().truth[0], _gradients, _gradient_error,
        _NO_GRADIENTS, quick=False),
}


# ---------------------------------------------------------------- tables of rows


def levels(rows: Sequence[Row]) -> dict[str, list[list[str]]]:
    """Return problem → table: a line for each program, a column for each error.

    A cell has the CPU time of the cheapest run, its ratio to gyrospark's cheapest, and its setting.
    """
    tables = {}
    for name in dict.fromkeys(row.case for row in rows):
        problem = PROBLEMS[name]
        lines = [["program", *(f"{level:.0e}" for level in problem.levels)]]
        for program in PROGRAMS:
            program_rows = _rows_of(rows, name, program)
            if program_rows:
                our_cheapest, best = (_cheapest(rows, name, key) for key in (PROGRAMS[0], program))
                lines.append([program_rows[0].program, *(
                    _cell(row, our_cheapest[level]) for level, row in best.items())])
                notes = {row.note for row in program_rows if row.note}
                if not any(best.values()) and notes:
                    lines[-1][1] = min(notes)
            elif program in problem.absent:
                lines.append([program, problem.absent[program], *["–"] * (len(lines[0]) - 2)])
        tables[name] = lines
    return tables


def _rows_of(rows: Sequence[Row], name: str, program: str) -> list[Row]:
    return [row for row in rows if row.case == name and row.program.split()[0] == program]


def _cheapest(rows: Sequence[Row], name: str, program: str) -> dict[float, Row | None]:
    program_rows = _rows_of(rows, name, program)
    return {level: cheapest(program_rows, COST, ERROR, level) for level in PROBLEMS[name].levels}


def _cell(row: Row | None, base: Row | None) -> str:
    if row is None:
        return "–"
    ratio = [] if base is None else [f"{text_of(row.numbers[COST] / base.numbers[COST])} ×"]
    return ", ".join([f"{text_of(row.numbers[COST])} ms", *ratio, row.setting])


def losses(rows: Sequence[Row]) -> list[list[str]]:
    """Return a table of the problems and errors for which another program is cheaper."""
    lines = [["problem", "error", "cheapest", "its time over gyrospark's"]]
    for name in dict.fromkeys(row.case for row in rows):
        for level, our_cheapest in _cheapest(rows, name, PROGRAMS[0]).items():
            best = cheapest([row for row in rows if row.case == name], COST, ERROR, level)
            if best is not None and best is not our_cheapest:
                ratio = "–" if our_cheapest is None else text_of(
                    best.numbers[COST] / our_cheapest.numbers[COST])
                lines.append([name, f"{level:.0e}", best.program, ratio])
    return lines


_PAGE = """# Peers at equal error

`make bench WHAT="peers --out DIR"` measures what follows and writes it as `DIR/peers.md`, with all
settings in `DIR/bench.json`; `--only "free body"` measures one problem. A program that is not
installed is named. Measured on: {machine}.
Under load times vary by a factor of two, and ratios with them.

A time is the CPU time of all threads for one run from the start to the end, call included, without
deriving and compiling: a median of runs, the least of {rounds} round(s), in which the programs
take turns. A cell has the time of the cheapest setting whose error is at most the
column's, its ratio to gyrospark's time, and the setting; "–": none of the settings tried reaches
the error. Errors are those at the end of the run.

- **gyrospark**: s-stage Gauss-Lobatto in constant steps; for the free body also splitting, for
  eccentric orbits [steps that adapt](adaptive_steps.md).
- **heyoka**: Taylor's method with adaptive steps. **scipy**: `solve_ivp` with DOP853 and a
  right-hand side compiled by numba; the loop over steps is Python. **diffrax**: Dopri8, compiled
  with its loop. These have the explicit first-order equations, of bodies Euler's.
- **mujoco**, **exudyn**: bodies and joints, constant steps.

## Where another program is cheaper

{losses}
heyoka's steps are explicit and as long as the motion allows; gyrospark's solve implicit equations
by iteration, and their length is constant, or given by a scale of time. heyoka, SciPy and diffrax
have no solver for multipliers; in minimal coordinates they could run the chain and the four-bar
too, whose equations would have to be derived first.

"""


def page(rows: Sequence[Row], choice: Choice, machine: Mapping[str, Any]) -> str:
    """Return the page of the documents."""
    head = _PAGE.format(rounds=choice.rounds, losses=markdown(losses(rows)), machine=(
        f"{machine['processor']}, {machine['cores']} cores, load {machine['load']}, "
        f"{machine['compiler']}"))
    return head + "\n".join(
        f"## {name[0].upper()}{name[1:]}\n\n{PROBLEMS[name].about}\n\n{markdown(lines)}"
        for name, lines in levels(rows).items())
