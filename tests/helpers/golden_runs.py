"""Golden runs: named steppers run a little, and the bits of what they give become a line of text.

    python tests/helpers/golden_runs.py                     the quick ones, a line each
    python tests/helpers/golden_runs.py --all --base DIR    all, compared with another checkout

A refactoring of the generator or the engine keeps every line. Nothing is recorded in a file: bits
depend on the compiler and the CPU, so the other checkout is run on the same machine.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

import gyrospark as gs

ROOT = Path(gs.__file__).resolve().parent
REALS = ("double", "float", "long-double", "float128")


@dataclass(frozen=True)
class Golden:
    """A stepper and what to run it with."""

    step: Any
    q: Any
    p: Any
    dt: float
    parameters: Any


#: Name → the stepper and its start; those of QUICK take a path of their own through the generator.
CASES: dict[str, Callable[[], Golden]] = {}
QUICK: list[str] = []


def case(name: str, make: Callable[[], Golden], *, quick: bool = False) -> None:
    CASES[name] = make
    if quick:
        QUICK.append(name)


def named(scheme: str, stages: int | None, rep: str, real: str, system: str = "heavy_top"):
    def make() -> Golden:
        top = gs.problems.fast_top() if system == "heavy_top" else gs.problems.free_body()
        step = gs.stepper(scheme, stages, rep, system=system, real=real)
        size = gs.gamma(top.inertia)
        return Golden(step, top.q0, top.p0, 1e-3, top.parameters | {rep: size})

    return make


def of_model(scheme: str, stages: int | None, load: Callable[[], Any]):
    def make() -> Golden:
        model = load()
        values = dict(model.parameters)
        values |= {name: "m" for name in model.bodies if name not in values}
        return Golden(gs.stepper(scheme, stages, system=model), model.q0, model.p0,
                      model.dt or 1e-3, values)

    return make


def of_system(scheme: str, stages: int | None, system: Callable[[], gs.System], q, p,
              dt=1e-2, structured: bool | None = None, tableau: str | None = None, **values):
    def make() -> Golden:
        if structured is None:
            file = None if tableau is None else ROOT / "examples" / "tableaux" / f"{tableau}.json"
            chosen = (scheme, stages) if file is None else ()
            step = gs.stepper(*chosen, system=system(), tableau=file)
        else:
            from gyrospark.generator.pipeline import generate
            from gyrospark.generator.spec import Spec

            generated = generate(Spec.from_arguments(scheme, stages), system=system(),
                                 structured=structured)
            step = gs.Stepper(generated.source.name, generated.source.files())
        return Golden(step, np.array(q, float), np.array(p, float), dt, values)

    return make


def oscillator() -> gs.System:
    """A separable system without constraint that is not quadratic."""
    q, p = sp.symbols("x y", real=True), sp.symbols("px py", real=True)
    k = sp.Symbol("k", positive=True)
    return gs.System(q, p, (k,), (p[0]**2 + p[1]**2) / 2 + k*q[0]**2 / 2 + q[0]**2 * q[1]**2
                     + sp.cos(q[1]), name="oscillator")


def coupled() -> gs.System:
    """A system without constraint that is not separable."""
    q, p = sp.symbols("r a", positive=True), sp.symbols("pr pa", real=True)
    k = sp.Symbol("k", positive=True)
    return gs.System(q, p, (k,), p[0]**2 / 2 + p[1]**2 / (2*q[0]**2) - k / q[0], name="kepler")


def driven(constrained: bool) -> gs.System:
    """A system with drag and a force that depends on time."""
    q, p = sp.symbols("x y", real=True), sp.symbols("px py", real=True)
    t, k = sp.Symbol("t", real=True), sp.Symbol("k", positive=True)
    g = [q[0]**2 + q[1]**2 - 1] if constrained else []
    return gs.System(q, p, (k,), (p[0]**2 + p[1]**2) / 2 + k*q[1] + q[0]**2 / 2, constraints=g,
                     forces=[-p[0] / 5 + sp.cos(t), -p[1] / 5], time=t, name="driven",
                     quantities={"work_rate": p[0]*sp.cos(t)})


def ellipse() -> gs.System:
    """A particle on an ellipse: W is not constant."""
    q, p = sp.symbols("x y", real=True), sp.symbols("px py", real=True)
    k = sp.Symbol("k", positive=True)
    return gs.System(q, p, (k,), (p[0]**2 + p[1]**2) / 2 + k*q[1],
                     constraints=[q[0]**2 + 4*q[1]**2 - 1], name="ellipse")


def curved() -> gs.System:
    """A mass that depends on the place, and a constraint, for which no property is proved."""
    q, p = sp.symbols("x y", real=True), sp.symbols("px py", real=True)
    k = sp.Symbol("k", positive=True)
    return gs.System(q, p, (k,), (p[0]**2 + p[1]**2)*(2 + q[0]) / 4 + k*q[1],
                     constraints=[q[0]**2 + 4*q[1]**2 - 1], name="curved")


def parallelogram() -> gs.System:
    """A system with more constraints than half the coordinates."""
    q = sp.symbols("x1 y1 x2 y2", real=True)
    p = sp.symbols("px1 py1 px2 py2", real=True)
    g = sp.Symbol("g", positive=True)
    return gs.System(q, p, (g,), sum(x**2 for x in p) / 2 + g*(q[1] + q[3]),
                     constraints=[q[0]**2 + q[1]**2 - 1, (q[2] - 1)**2 + q[3]**2 - 1,
                                  (q[2] - q[0])**2 + (q[3] - q[1])**2 - 1], name="parallelogram")


def model_file(name: str):
    return lambda: gs.load_model(ROOT / "examples" / f"{name}.toml")


def add_cases() -> None:
    spark = [("G-L", s) for s in range(1, 9)] + [("LIIIA-B", s) for s in range(2, 6)]
    for real in REALS:
        for rep in ("gamma", "alpha"):
            for scheme, s in [("IMS", None), ("EMS", None), *spark]:
                quick = real == "double" and (scheme, s) in (
                    ("IMS", None), ("EMS", None), ("G-L", 1), ("G-L", 3), ("G-L", 5),
                    ("LIIIA-B", 2))
                quick |= rep == "gamma" and (scheme, s) in (("EMS", None), ("G-L", 2))
                case(f"{s or ''}{scheme} {rep} {real}", named(scheme, s, rep, real), quick=quick)
    for scheme, s in (("IMS", None), ("EMS", None), ("G-L", 2), ("LIIIA-B", 3)):
        quick = scheme in ("EMS", "G-L")
        prefix = f"{s or ''}{scheme}"
        case(f"{prefix} free body", named(scheme, s, "gamma", "double", "free_body"))
        for file in ("bungee", "double_pendulum", "double_top", "dragged_top", "pendulum",
                     "satellite", "sprung_body"):
            case(f"{prefix} {file}.toml", of_model(scheme, s, model_file(file)),
                 quick=quick and file in ("dragged_top", "sprung_body"))
        for model in ("gimbal", "four_bar", "chain"):
            case(f"{prefix} {model}", of_model(scheme, s, getattr(gs.models, model)),
                 quick=quick and model == "chain")
        for structured in (None, True):
            kind = " in forms" if structured else ""
            few = {"structured": structured}
            case(f"{prefix} oscillator{kind}",
                 of_system(scheme, s, oscillator, [1, .5], [0, .3], k=2.0, **few), quick=quick)
            case(f"{prefix} kepler{kind}",
                 of_system(scheme, s, coupled, [1, .5], [.1, 1.1], k=1.0, **few),
                 quick=quick and not structured)
            case(f"{prefix} driven{kind}",
                 of_system(scheme, s, lambda: driven(False), [1, 0], [0, 1], k=1.0, **few),
                 quick=quick)
            case(f"{prefix} driven on a circle{kind}",
                 of_system(scheme, s, lambda: driven(True), [1, 0], [0, 1], k=1.0, **few),
                 quick=quick)
            case(f"{prefix} ellipse{kind}",
                 of_system(scheme, s, ellipse, [1, 0], [0, 1], k=1.0, **few), quick=quick)
            case(f"{prefix} curved{kind}",
                 of_system(scheme, s, curved, [1, 0], [0, 1], k=1.0, **few),
                 quick=quick and not structured)
            case(f"{prefix} parallelogram{kind}",
                 of_system(scheme, s, parallelogram, [.6, .8, 1.6, .8], [-.4, .3, -.4, .3], g=9.81,
                           **few), quick=quick and not structured)
    for name in ("gauss_3_2", "gauss_lobatto_2", "lobatto_iiid_3", "radau_iia_2",
                 "radau_plain_2"):
        for system, start in ((ellipse, ([1, 0], [0, 1])), (oscillator, ([1, .5], [0, .3]))):
            case(f"{name} {system.__name__}",
                 of_system("G-L", 1, system, *start, k=2.0, tableau=name),
                 quick=name in ("lobatto_iiid_3", "radau_plain_2") and system is ellipse)


def digits(array: Any) -> bytes:
    """Return the numbers as bytes in which nothing but their value shows."""
    array = np.asarray(array)
    if array.dtype in (np.float64, np.float32) or array.dtype.kind in "iub":
        return np.ascontiguousarray(array).tobytes()
    return ",".join(repr(x) for x in array.ravel().tolist()).encode() \
        if array.dtype == object else ",".join(map(repr, array.ravel())).encode()


def runs(golden: Golden) -> Iterator[tuple[str, Callable[[], list[Any]]]]:
    """Yield the name and the arrays of each run of a stepper."""
    step, q, p, dt = golden.step, golden.q, golden.p, golden.dt
    with_values = {"parameters": golden.parameters}

    def arrays(run: Any) -> list[Any]:
        return [run.q, run.p, run.multipliers, run.iterations]

    def integrate(h: float, steps: int, **options: Any) -> list[Any]:
        try:
            return arrays(step.integrate(q, p, dt=h, steps=steps, **with_values, **options))
        except gs.StepFailed as failure:
            run = failure.trajectory
            return [*arrays(run), str(failure).encode()]

    yield "run", lambda: integrate(dt, 150)
    yield "newton", lambda: integrate(2*dt, 8, solver="newton")
    yield "sweeps", lambda: integrate(-dt, 12, solver="fixed-point")
    for factor in (8, 40, 150):
        yield f"{factor} dt", lambda factor=factor: integrate(factor*dt, 25)
    yield "tolerance", lambda: integrate(2*dt, 10, solver=gs.Solver("auto", tolerance=1e-6))

    def ensemble(**options: Any) -> list[Any]:
        count = 7
        steps = dt*np.array([1, 2, .5, 20, 1, 80, 3])
        members = step.integrate_ensemble(np.array([q]*count), np.array([p]*count), dt=steps,
                                          steps=40, workers=1, **with_values, **options)
        return [members.q, members.p, members.multipliers, members.iterations]

    yield "ensemble", lambda: ensemble(every=2)
    yield "ensemble of sweeps", lambda: ensemble(solver="fixed-point")

    def system() -> list[Any]:
        x = step.guess(q, p, dt=dt, **with_values)
        return [x, step.residual(x, q, p, dt=dt, **with_values),
                step.jacobian(x, q, p, dt=dt, **with_values)]

    yield "system", system
    if step.m:
        def projected() -> list[Any]:
            rng = np.random.default_rng(1)
            state = step.project(q + 1e-3*rng.standard_normal(len(q)),
                                 p + 1e-3*rng.standard_normal(len(p)), **with_values)
            return [*state]

        yield "project", projected


def bits_of(name: str) -> dict[str, str]:
    """Return the hash of each run of a case."""
    golden, hashes = CASES[name](), {}
    for run_name, make in runs(golden):
        try:
            arrays = make()
        except (gs.GyrosparkError, KeyError) as error:
            arrays = [f"{type(error).__name__}: {error}".encode()]
        parts = [a if isinstance(a, bytes) else digits(a) for a in arrays]
        hashes[run_name] = hashlib.blake2b(b"|".join(parts), digest_size=8).hexdigest()
    return hashes


def line_of(name: str) -> tuple[str, dict[str, str]]:
    try:
        return name, bits_of(name)
    except Exception as error:  # one of them fails: the others are still worth having
        return name, {"error": f"{type(error).__name__}: {error}"}


def all_bits(names: list[str], jobs: int) -> dict[str, dict[str, str]]:
    """Return the hashes of the cases with these names, computed by so many processes."""
    if jobs == 1:
        return dict(map(line_of, names))
    with ProcessPoolExecutor(jobs) as pool:
        return dict(pool.map(line_of, names))


def of_checkout(folder: Path, names: list[str], jobs: int) -> dict[str, dict[str, str]]:
    """Return the hashes of another checkout, run by this script with that package."""
    with tempfile.TemporaryDirectory() as parent:
        (Path(parent) / "gyrospark").symlink_to(folder.resolve(), target_is_directory=True)
        process = subprocess.run(
            [sys.executable, __file__, "--json", "--jobs", str(jobs), "--only", *names],
            env={**os.environ, "PYTHONPATH": parent}, cwd=parent, check=True, text=True,
            stdout=subprocess.PIPE)
    return json.loads(process.stdout)


def differences(hashes: dict[str, Any], base: dict[str, Any]) -> list[str]:
    """Return the cases and runs whose bits are not the same."""
    return [f"{name}: {run_name}" for name in hashes for run_name in hashes[name]
            if base.get(name, {}).get(run_name) != hashes[name][run_name] or run_name == "error"]


add_cases()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--all", action="store_true", help="not the quick ones alone")
    parser.add_argument("--base", type=Path, help="another checkout to compare with")
    parser.add_argument("--only", nargs="+", help="cases of these names, or with this in the name")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    names = list(CASES) if options.all else QUICK
    if options.only:
        names = [n for n in CASES if n in options.only] or \
            [n for n in CASES if any(o in n for o in options.only)]
    hashes = all_bits(names, options.jobs)
    if options.json:
        print(json.dumps(hashes))
        return 0
    if options.base is None:
        for name, bits in hashes.items():
            print(f"{name:40s}", *(f"{run_name}={bits[run_name]}" for run_name in bits))
        return 0
    differing = differences(hashes, of_checkout(options.base, names, options.jobs))
    print("\n".join(differing) or f"{len(hashes)} steppers, {sum(map(len, hashes.values()))} runs: "
          "the same bits")
    return bool(differing)


if __name__ == "__main__":
    sys.exit(main())
