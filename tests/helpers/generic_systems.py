"""Systems that are no quaternion, each with starts and parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

import systems
from gyrospark.generator.systems.system import System
from reference import Equations


@dataclass(frozen=True)
class Example:
    """A system twice, and a region to start in."""

    symbolic: System
    by_hand: Any  # number → Equations
    parameters: dict[str, float]
    q: tuple[float, ...]
    p: tuple[float, ...]


def pendulum() -> Example:
    entry = systems.case("two_rods")
    parameters = entry.parameters | {"l": 0.8}

    def by_hand(number):
        g, length = (number(parameters[name]) for name in "gl")
        weight = g * np.array([0 * g, 1 + 0 * g, 0 * g, 1 + 0 * g])

        def G(q):
            x, y = q[2] - q[0], q[3] - q[1]
            return 2 * np.array([[q[0], q[1], 0 * x, 0 * x], [-x, -y, x, y]])

        def mean_gradient(q0, p0, q1, p1):  # H and g are quadratic: at the mean
            return weight + 0 * q0, (p0 + p1) / 2

        return Equations(
            H=lambda q, p: p @ p / 2 + weight @ q,
            H_q=lambda q, p: weight + 0 * q,
            H_p=lambda q, p: 1 * p,
            g=lambda q: np.array([q[0] ** 2 + q[1] ** 2 - 1,
                                  (q[2] - q[0]) ** 2 + (q[3] - q[1]) ** 2
                                  - length**2]),
            G=G, mean_gradient=mean_gradient, mean_constraint=lambda q0, q1: G((q0 + q1) / 2),
        )

    return Example(entry.system, by_hand, parameters, (0.7, -0.6, 1.3, -1.1), (1.0, 0.4, -0.6, 0.9))


def runner() -> Example:
    entry = systems.case("relativistic")
    parameters = entry.parameters

    def by_hand(number):
        M, k = (number(parameters[name]) for name in ("m", "k"))

        def root(p):
            return (M**2 + p @ p) ** 0.5

        def stretch(q):
            return 1 + q[0] ** 2 / 4

        def mean_gradient(q0, p0, q1, p1):
            roots, q = root(p0) + root(p1), (q0 + q1) / 2
            D_p = (stretch(q0) + stretch(q1)) / 2 * (p0 + p1) / roots
            return np.array([roots * q[0] / 4, -k / ((2 + q0[1]) * (2 + q1[1]))]), D_p

        def mean_constraint(q0, q1):
            (x0, y0), (x1, y1) = q0, q1
            return np.array([[(x0 + x1) * (x0**2 + x1**2), y0 + y1]])

        return Equations(
            H=lambda q, p: root(p) * stretch(q) + k / (2 + q[1]),
            H_q=lambda q, p: np.array([root(p) * q[0] / 2, -k / (2 + q[1]) ** 2]),
            H_p=lambda q, p: p / root(p) * stretch(q),
            g=lambda q: np.array([q[0] ** 4 + q[1] ** 2 - 1]),
            G=lambda q: np.array([[4 * q[0] ** 3, 2 * q[1]]]),
            mean_gradient=mean_gradient, mean_constraint=mean_constraint,
        )

    return Example(entry.system, by_hand, parameters, entry.q, entry.p)


def oscillator() -> Example:
    entry = systems.case("henon_heiles")

    def by_hand(number):
        third = 1 / number(3)

        def mean_gradient(q0, p0, q1, p1):
            q, y0, y1 = (q0 + q1) / 2, q0[1], q1[1]
            square = (q0[0] ** 2 + q1[0] ** 2) / 2
            D_q = np.array([q[0] + 2 * q[0] * q[1],
                            q[1] + square - third * (y0**2 + y0 * y1 + y1**2)])
            return D_q, (p0 + p1) / 2

        return Equations(
            H=lambda q, p: (p @ p + q @ q) / 2 + q[0] ** 2 * q[1] - third * q[1] ** 3,
            H_q=lambda q, p: np.array([q[0] + 2 * q[0] * q[1], q[1] + q[0] ** 2 - q[1] ** 2]),
            H_p=lambda q, p: 1 * p,
            g=lambda q: np.zeros(0), G=lambda q: np.zeros((0, 2)),
            mean_gradient=mean_gradient, mean_constraint=lambda q0, q1: np.zeros((0, 2)),
        )

    return Example(entry.system, by_hand, {}, entry.q, entry.p)


EXAMPLES = {make.__name__: make() for make in (pendulum, runner, oscillator)}


def stepper_for(name, scheme, stages):
    catalogue = {"pendulum": "two_rods", "runner": "relativistic", "oscillator": "henon_heiles"}
    return systems.stepper(catalogue[name], scheme, stages)
