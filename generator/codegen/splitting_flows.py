"""The C of a composition of flows: kernels, tables of bodies and points, weights, memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import accumulate

import mpmath as mp
import sympy as sp

from ...core.real_types import Real, round_binary
from ..kernels.kernel import Target, emit_kernel, sums_products
from ..schemes.splitting_scheme import SplittingScheme
from ..splitting.parts import AxisRotation
from ..tableaux.compositions import Composition
from .lane_iteration import called_functions
from .program import CompositionText, Derived, Flows, LaneIteration

__all__ = ["flow_lanes", "flows_of"]

#: Kernels of states that runs of many record with.
_RECORDED = ("hamiltonian", "constraint", "hidden_constraint")
#: Bytes of a register, at most, and how many take turns.
_LANE_BYTES, _REGISTERS = 64, 4


def flows_of(derived: Derived) -> Flows:
    """Return the flows of a splitting as the templates print them."""
    scheme, real = derived.scheme, derived.real
    assert isinstance(scheme, SplittingScheme)
    bodies = scheme.splitting.bodies
    stages = max(one.stages for one in scheme.compositions)
    axis_of = {body: k for k, (body, _) in enumerate(scheme.axes)}
    size = {"n": scheme.system.n, "y": len(scheme.momenta), "bodies": max(len(bodies), 1),
            "axes": max(len(scheme.axes), 1), "further": max(len(scheme.further), 1),
            "drags": max(len(scheme.drag), 1), "stages": stages, "flows": stages + 2}
    spaces = scheme.splitting.space
    shapes = _members(size, drag=scheme.has_drag, spaces=len(spaces))
    numbers = sum(_length(shape) for _, shape in shapes)
    target = replace(Target.scalar(real), explicit=derived.profile == "control")
    return Flows(
        kernels=[emit_kernel(k, derived.constants, real, target)
                 for k in [*scheme.kernels(),
                           *scheme.flow_kernels(work=derived.profile != "control")]],
        bodies=[list(body.q) for body in bodies],
        body_axis=[axis_of.get(i, -1) for i in range(len(bodies))],
        axis_which=[_which(axis) for _, axis in scheme.axes],
        axis_steady=[int(axis.steady)
                     for body in scheme.symmetric.bodies for axis in body.axes],
        further_body=[body for body, _ in scheme.further],
        further_which=[_which(axis) for _, axis in scheme.further],
        free=list(scheme.free),
        kicked=scheme.kicked,
        momenta=len(scheme.momenta),
        space_axes=len(spaces),
        body_space=[next((k for k, space in enumerate(spaces) if b in space.bodies), -1)
                    for b in range(len(bodies))],
        space_points=[(k, list(point), [_in_y(scheme, i) for i in point])
                      for k, space in enumerate(spaces) for point in space.points],
        stages=stages,
        compositions=[_composition(one, stages, real) for one in scheme.compositions],
        half_pi=_half_pi(real),
        state=_now(size),
        members=shapes,
        numbers=numbers,
        memory=numbers * real.bytes + 256,  # enough at any number of lanes
        description=scheme.name,
    )


def flow_lanes(derived: Derived, flows: Flows) -> LaneIteration:
    """Return what runs of many need on lanes."""
    scheme, real = derived.scheme, derived.real
    assert isinstance(scheme, SplittingScheme)
    own = [*(k for k in scheme.state_kernels() if k.name in _RECORDED), *scheme.flow_kernels()]
    kernels = [emit_kernel(k, derived.constants, real, Target.lanes({})) for k in own]
    constants = len(derived.constants.definitions) + 3
    # Two kinds of flows with their constants in each register, what is recorded, and kinds.
    moving = sum(_length(shape) for _, shape in flows.state)
    vectors = _REGISTERS * (2 * (flows.numbers + constants + 2 + 2 * moving) + 16)
    wide = real.bytes if real.wide else _LANE_BYTES
    return LaneIteration(
        kernels=kernels, folded={}, **called_functions(kernels), tables={}, even_odd_tables={},
        compensated=any(sums_products(k, "lanes_") for k in kernels), factors=False,
        constant_schur=False, scalar_schur=False, separable=False, shared=0, affine=True,
        history=0, memory=flows.memory, batch_memory=vectors * wide + 4096)


def _in_y(scheme: SplittingScheme, i: int) -> int:
    """Return where in y the momentum of a coordinate of a point is; -1 for none."""
    return -1 if i < 0 else 3 * len(scheme.splitting.bodies) + scheme.free.index(i)


def _members(
    size: dict[str, int], *, drag: bool, spaces: int
) -> list[tuple[str, list[int]]]:
    """Return the numbers of ``flows`` by name, with their shapes, in order."""
    stages, flows = size["stages"], size["flows"]
    made = [*((f"now.{name}", shape) for name, shape in _now(size)),
            ("h", []), ("t", []), ("drift", [flows]), ("kick", [stages]), ("gradient", [stages]),
            ("kick_time", [stages]), ("sphere", [size["bodies"]]), ("axis_rate", [size["axes"]]),
            ("axis_offset", [size["axes"]]), ("further_rate", [size["further"]]),
            ("further_offset", [size["further"]]), ("drag", [size["drags"]]),
            ("axis", [size["axes"], 3]), ("further_axis", [size["further"], 3]),
            ("cosine", [size["axes"], flows]), ("sine", [size["axes"], flows])]
    if drag:
        made += [("elapsed", [size["drags"], flows]), ("decay", [size["drags"], flows])]
    if spaces:
        made += [("space_cosine", [spaces, flows]), ("space_vector", [spaces, flows, 3])]
    return made


def _now(size: dict[str, int]) -> list[tuple[str, list[int]]]:
    """Return the part of it that a step changes."""
    return [("q", [size["n"]]), ("q_low", [size["n"]]), ("y", [size["y"]]), ("y_low", [size["y"]]),
            ("work", []), ("work_low", [])]


def _length(shape: Sequence[int]) -> int:
    return int(sp.prod(shape))


def _which(axis: AxisRotation) -> int:
    """Return 0, 1 or 2 for a coordinate axis, else 3."""
    units = [tuple(sp.Integer(i == k) for i in range(3)) for k in range(3)]
    return units.index(axis.axis) if axis.axis in units else 3


def _composition(one: Composition, stages: int, real: Real) -> CompositionText:
    """Return weights in two words: drifts a_0, then a_1 .. a_(s-1) and a_s + a_0."""
    a, b = one.drifts, one.kicks
    times = list(accumulate(a))[:-1]
    ratios = [-c / x if x else Fraction(0) for c, x in zip(one.gradients, b, strict=True)]

    def padded(texts: list[str], count: int, empty: str) -> list[str]:
        return [*texts, *[empty] * (count - len(texts))]

    def words(values: Sequence[Fraction], count: int) -> list[str]:
        return padded([_words(x, real) for x in values], count, "{ 0, 0 }")

    return CompositionText(
        one.name, one.stages, words([a[0], *a[1:-1], a[-1] + a[0]], stages + 1),
        words(b, stages), words(times, stages),
        padded([real.literal(x) for x in ratios], stages, "0"))


def _words(x: Fraction, real: Real) -> str:
    """Return a weight as its rounded value and the rounded rest."""
    return f"{{ {real.literal(x)}, {real.literal(x - round_binary(x, real.bits))} }}"


def _half_pi(real: Real) -> list[str]:
    """Return π/2 as its rounded value and the rounded rest."""
    bits = 4 * real.bits
    with mp.workprec(bits + 64):
        value = Fraction(int(mp.floor(mp.ldexp(mp.pi / 2, bits))), 2**bits)
    return [real.literal(value), real.literal(value - round_binary(value, real.bits))]
