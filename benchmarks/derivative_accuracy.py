"""Derivatives of one step of each reference problem and of each model: how exact they are.

    python -m benchmarks.derivative_accuracy [NAME ...] [--real float128] [--json FILE]

Columns, all of steppers in double except for the differences:

    differences   tangents against central differences of order 4 of the step itself, by a
                  direction of the start and by each parameter; in double they have 8 to 10 digits,
                  in float128 all
    transposed    ⟨w, Φ'v⟩ − ⟨Φ'ᵀw, v⟩, relative to the sum of the terms
    tangent       distance of the images to the tangent space at the end
    symplectic    Φ'ᵀΩΦ' − Ω on the tangent space, where there are no forces
    backwards     Φ'ᵀΩu − Ω Φ_(−h)'u, under the same condition: the adjoint is the tangent back
"""

from __future__ import annotations

import argparse
import json
import re
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import gyrospark as gs

from .attitudes import Array

__all__ = ["Accuracy", "Subject", "measure", "subjects"]

#: Relative changes of central differences.
_SHIFT = {"double": 2.0**-11, "float128": 2.0**-36}


@dataclass(frozen=True)
class Subject:
    """A stepper and a start for it."""

    name: str
    scheme: str
    stages: int
    model: gs.Model
    dt: float

    def stepper(self, real: Any) -> gs.Stepper:
        """Return the compiled stepper."""
        return gs.stepper(self.scheme, self.stages, system=self.model,  # type: ignore[arg-type]
                          real=real)

    @property
    def parameters(self) -> dict[str, Any]:
        """Values of all parameters."""
        free = {name: "m" for name in self.model.bodies if name not in self.model.parameters}
        return {**self.model.parameters, **free}


@dataclass(frozen=True)
class Accuracy:
    """Errors of one subject; None where a column has no meaning."""

    name: str
    coordinates: int
    constraints: int
    directions: int
    differences: float | None
    transposed: float | None
    tangent: float | None
    symplectic: float | None
    backwards: float | None
    seconds: float


def subjects(names: Sequence[str] = ()) -> Iterator[Subject]:
    """Yield the reference problems and the models, all or only the named ones."""
    for name in gs.references.names():
        if not names or name in names:
            problem = gs.references.reference(name)
            attempt = problem.attempts[0]
            yield Subject(name, attempt.scheme, attempt.stages or 0, problem.make(),
                          float(problem.seconds) / attempt.steps[-1])
    for name in gs.models.__all__:
        if (not names or name in names) and callable(make := getattr(gs.models, name)):
            model = make()
            yield Subject(name, "G-L", 2, model, model.dt or 1e-3)


def measure(subject: Subject, real: str = "double") -> Accuracy:
    """Return the errors of the derivatives of one step."""
    started = time.perf_counter()
    step = subject.stepper("double")
    values = dict(step.integrate(subject.model.q0, subject.model.p0, dt=subject.dt, steps=0,
                                 parameters=subject.parameters).parameters)
    state = step.consistent(subject.model.q0, subject.model.p0, parameters=values)
    single_step = _Step(step, state.q, state.p, values, subject.dt, 0.0)
    basis, images = single_step.tangents()
    end = single_step.end()
    forward = _Step(step, end[0], end[1], values, subject.dt, subject.dt)
    conservative = not step.manifest.system.forces
    form = _omega(step.n)
    size = max(1.0, float(np.abs(images).max()) ** 2)
    symplectic = backwards = None
    if conservative:
        symplectic = float(np.abs(images.T @ form @ images - basis.T @ form @ basis).max()) / size
        backwards = _backwards(single_step, forward)
    quad = single_step if real == "double" else _exact(subject, values, real)
    outside = images - (B := forward.basis()) @ (B.T @ images)
    return Accuracy(
        subject.name, step.n, step.m, basis.shape[1] + len(values) + 1,
        _differences(quad, _SHIFT[real]), _transposed(single_step),
        float(np.abs(outside).max() / np.abs(images).max()), symplectic, backwards,
        time.perf_counter() - started)


class _Step:
    """One step and its derivatives."""

    def __init__(self, step: gs.Stepper, q: Array, p: Array, values: Mapping[str, Any], dt: Any,
                 t0: Any) -> None:
        self.step, self.q, self.p, self.values, self.dt, self.t0 = step, q, p, values, dt, t0

    def tangents(self) -> tuple[Array, Array]:
        """Return the basis at the start and its images."""
        run = self.step.integrate(gs.Start(self.q, self.p, t=self.t0), dt=self.dt, steps=1,
                                  parameters=self.values, tangents=gs.Tangents())
        return run.tangents.start, np.concatenate([run.tangents.q[-1], run.tangents.p[-1]])

    def basis(self) -> Array:
        """Return a basis of the tangent space at the start."""
        zero = self.q - self.q
        basis: Array = self.back()(zero, zero).basis
        return basis

    def back(self) -> Any:
        """Return the transposed derivative."""
        return self.step.vjp(gs.Start(self.q, self.p, t=self.t0), dt=self.dt,
                             parameters=self.values)[2]

    def forth(self, v: Array, d: Mapping[str, Any] | None = None, sign: int = 1) -> Array:
        """Return the derivative along v and d, of the step back where ``sign`` is −1."""
        n = self.step.n
        images = self.step.jvp(gs.Start(self.q, self.p, t=self.t0), v[:n], v[n:], dt=sign * self.dt,
                               d=d, parameters=self.values)
        return np.concatenate(images[2:])

    def end(self, v: Array | None = None, d: Mapping[str, Any] | None = None, shift: Any = 0
            ) -> tuple[Array, Array]:
        """Return the end of the step from a start that is moved along v and d."""
        q, p, d, n = self.q, self.p, d or {}, self.step.n
        if v is not None:
            q, p = q + shift * v[:n], p + shift * v[n:]
        values = {k: x + shift * d.get(k, 0) for k, x in self.values.items()}
        if self.step.m and shift:
            consistent = self.step.consistent(q, p, parameters=values, t=self.t0)
            q = consistent.q
            p = consistent.p if self.step.manifest.scheme.keeps_momentum_constraint else p
        run = self.step.integrate(gs.Start(q, p, t=self.t0), dt=self.dt + shift * d.get("dt", 0),
                                  steps=1, parameters=values)
        return run.q[-1], run.p[-1]


def _exact(subject: Subject, values: Mapping[str, Any], real: str) -> _Step:
    step = subject.stepper(real)
    zero = step.binding.new(1)[0]
    numbers = {k: zero + x for k, x in values.items()}
    consistent = step.consistent(subject.model.q0, subject.model.p0, parameters=numbers)
    return _Step(step, consistent.q, consistent.p, numbers, zero + subject.dt, zero)


def _omega(n: int) -> Array:
    zero, identity = np.zeros((n, n)), np.eye(n)
    return np.block([[zero, identity], [-identity, zero]])


def _transposed(step: _Step) -> float:
    rng, n = np.random.default_rng(2), step.step.n
    w = rng.normal(size=2 * n)
    gradient = step.back()(w[:n], w[n:])
    y = rng.normal(size=gradient.basis.shape[1])
    d = {k: rng.normal() * (abs(float(x)) or 1.0) for k, x in step.values.items()} | {"dt": step.dt}
    image = step.forth(gradient.basis @ y, d)
    terms = [*(w * image), *(-gradient.start * y), *(-gradient[k] * x for k, x in d.items())]
    return abs(float(np.sum(terms))) / float(np.abs(terms).sum())


def _backwards(step: _Step, forward: _Step) -> float:
    n, form = step.step.n, _omega(step.step.n)
    back, worst = step.back(), 0.0
    for u in forward.basis().T[:4]:
        w = form @ u
        gradient = back(w[:n], w[n:])
        expected = gradient.basis.T @ form @ forward.forth(u, sign=-1)
        worst = max(worst, float(np.abs(gradient.start - expected).max()
                                 / max(1.0, float(np.abs(expected).max()))))
    return worst


def _differences(step: _Step, shift: float) -> float:
    """Return the largest error of q and of p, relative to the largest entry: columns are scaled."""
    basis = step.basis()
    zero = basis[:, 0] - basis[:, 0]
    rng = np.random.default_rng(3)
    direction = basis @ (rng.normal(size=basis.shape[1]) / basis.shape[1] ** 0.5)
    size = np.abs(np.concatenate([step.q, step.p])).max()
    columns: list[tuple[Array, dict[str, Any]]] = [(direction * size, {})]
    # entries of I⁻¹ move less: the inertia of a linkage's rod is nearly impossible for a body
    columns += [(zero, {k: (x / 64 if re.search("_K[1-3]{2}$", k) else x) if x != 0 else 1.0})
                for k, x in step.values.items()]
    columns.append((zero, {"dt": step.dt}))
    differences = np.array([step.forth(v, d) for v, d in columns])
    expected = np.array([_slope(step, v, d, shift) for v, d in columns])
    n = step.step.n
    errors, sizes = np.abs(differences - expected), np.abs(expected)
    return max(float(errors[:, half].max() / sizes[:, half].max())
               for half in (slice(n), slice(n, None)))


def _slope(step: _Step, v: Array, d: Mapping[str, Any], shift: float) -> Array:
    def rise(e: float) -> Array:
        difference: Array = np.concatenate(step.end(v, d, e)) - np.concatenate(step.end(v, d, -e))
        return difference

    slope: Array = (8 * rise(shift) - rise(2 * shift)) / (12 * shift)
    return slope


def main() -> None:
    """Print a line for each subject."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--real", choices=[*_SHIFT], default="double")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    columns = ("differences", "transposed", "tangent", "symplectic", "backwards")
    print(f"{'':24}{'n':>5}{'m':>5}{'by':>5}", *(f"{name:>12}" for name in columns), " seconds")
    rows = []
    for subject in subjects(options.names):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", gs.errors.InputWarning)  # large rotations in a step
            row = measure(subject, options.real)
        rows.append(asdict(row))
        cells = ("–" if (x := getattr(row, name)) is None else f"{x:.1e}" for name in columns)
        print(f"{row.name:24}{row.coordinates:5}{row.constraints:5}{row.directions:5}",
              *(f"{cell:>12}" for cell in cells), f"{row.seconds:8.1f}", flush=True)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
