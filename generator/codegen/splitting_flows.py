"""The C of a composition of flows: kernels, tables of bodies and points, weights, memory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import accumulate
from typing import Any

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

#: Kernels of states that runs of many trajectories record.
_RECORDED = ("hamiltonian", "constraint", "hidden_constraint")
#: Largest number of bytes of a vector register, and number of registers that are interleaved.
_LANE_BYTES, _REGISTERS = 64, 4


def flows_of(derived: Derived) -> Flows:
    """Return the kernels, tables and weights of a splitting; ``Flows`` explains the tables."""
    scheme, real, is_control = derived.scheme, derived.real, derived.profile == "control"
    assert isinstance(scheme, SplittingScheme)
    stages = max(composition.stages for composition in scheme.compositions)
    # C has no arrays of length 0; the flows are s + 1 drifts, and one that joins last and first
    size = {"n": scheme.system.n, "y": len(scheme.momenta),
            "bodies": max(len(scheme.splitting.bodies), 1),
            "axes": max(len(scheme.axes), 1), "further": max(len(scheme.further), 1),
            "drags": max(len(scheme.drag), 1), "stages": stages, "flows": stages + 2}
    members = _members(size, drag=scheme.has_drag, spaces=len(scheme.splitting.space))
    length = sum(_length(shape) for _, shape in members)
    target = replace(Target.scalar(real), explicit=is_control)
    # a controller does not count the work of forces
    kernels = [*scheme.kernels(), *scheme.flow_kernels(work=not is_control)]
    return Flows(
        kernels=[emit_kernel(k, derived.constants, real, target) for k in kernels],
        **_body_tables(scheme),
        **_space_tables(scheme),
        free=list(scheme.free),
        kicked=scheme.kicked_entries,
        momenta=len(scheme.momenta),
        stages=stages,
        compositions=[_composition(c, stages, real) for c in scheme.compositions],
        half_pi=half_pi_words(real, count=2),
        state=_step_state(size),
        members=members,
        numbers=length,
        memory=length * real.bytes + 256,  # enough at any number of lanes
        description=scheme.name,
    )


def _body_tables(scheme: SplittingScheme) -> dict[str, Any]:
    """Return the tables of bodies and of their rotations about axes, fields of ``Flows``."""
    bodies = scheme.splitting.bodies
    axis_of = {body: k for k, (body, _) in enumerate(scheme.axes)}
    return {
        "bodies": [list(body.q) for body in bodies],
        "body_axis": [axis_of.get(i, -1) for i in range(len(bodies))],
        "axis_which": [_axis_number(axis) for _, axis in scheme.axes],
        # further rotations, which symmetric bodies do not have, would change the rates
        "axis_steady": [int(axis.steady)
                        for body in scheme.symmetric.bodies for axis in body.axes],
        "further_body": [body for body, _ in scheme.further],
        "further_which": [_axis_number(axis) for _, axis in scheme.further],
    }


def _space_tables(scheme: SplittingScheme) -> dict[str, Any]:
    """Return the tables of rotations of space and of the points that they rotate."""
    spaces = scheme.splitting.space
    space_of = {body: k for k, space in enumerate(spaces) for body in space.bodies}
    points = [(k, list(point), [_momentum_index(scheme, i) for i in point])
              for k, space in enumerate(spaces) for point in space.points]
    return {"space_axes": len(spaces), "space_points": points,
            "body_space": [space_of.get(b, -1) for b in range(len(scheme.splitting.bodies))]}


def flow_lanes(derived: Derived, flows: Flows) -> LaneIteration:
    """Return the kernels on lanes of a composition of flows, and the bytes of its runs.

    Each lane has a trajectory, in the work memory of a run of many trajectories.
    """
    scheme, real = derived.scheme, derived.real
    assert isinstance(scheme, SplittingScheme)
    recorded = [k for k in scheme.state_kernels() if k.name in _RECORDED]
    kernels = [emit_kernel(k, derived.constants, real, Target.lanes(names={}))
               for k in [*recorded, *scheme.flow_kernels()]]
    constants = len(derived.constants.definitions) + 3
    # The engine interleaves several registers of lanes, which hides the latency of operations. For
    # each register: two structs of flows with their constants, two recorded states, 16 numbers.
    state_length = sum(_length(shape) for _, shape in flows.state)
    vectors = _REGISTERS * (2 * (flows.numbers + constants + 2 + 2 * state_length) + 16)
    vector_bytes = real.bytes if real.wide else _LANE_BYTES
    return LaneIteration(
        kernels=kernels, **called_functions(kernels),
        compensated=any(sums_products(k, prefix="lanes_") for k in kernels),
        factors=False, separable=False, affine=True, history=0, memory=flows.memory,
        batch_memory=vectors * vector_bytes + 4096)


def _momentum_index(scheme: SplittingScheme, i: int) -> int:
    """Return the index in y of the momentum of coordinate i of a point; −1 for i < 0.

    y has three angular momenta of each body, then the momenta of the free coordinates.
    """
    return -1 if i < 0 else 3 * len(scheme.splitting.bodies) + scheme.free.index(i)


def _members(size: dict[str, int], *, drag: bool, spaces: int) -> list[tuple[str, list[int]]]:
    """Return the members of struct ``flows`` in order: names and shapes.

    ``size`` has the number of bodies, of stages and so on; ``drag`` and ``spaces`` say whether
    there is drag, and how many rotations of space there are. The shape of a number is [].
    """
    stages, flows = size["stages"], size["flows"]
    members = [*((f"now.{name}", shape) for name, shape in _step_state(size)),
               ("h", []), ("t", []), ("drift", [flows]), ("kick", [stages]), ("gradient", [stages]),
               ("kick_time", [stages]), ("sphere", [size["bodies"]]), ("axis_rate", [size["axes"]]),
               ("axis_offset", [size["axes"]]), ("further_rate", [size["further"]]),
               ("further_offset", [size["further"]]), ("drag", [size["drags"]]),
               ("axis", [size["axes"], 3]), ("further_axis", [size["further"], 3]),
               ("cosine", [size["axes"], flows]), ("sine", [size["axes"], flows])]
    if drag:
        members += [("elapsed", [size["drags"], flows]), ("decay", [size["drags"], flows])]
    if spaces:
        members += [("space_cosine", [spaces, flows]), ("space_vector", [spaces, flows, 3])]
    return members


def _step_state(size: dict[str, int]) -> list[tuple[str, list[int]]]:
    """Return names and shapes of the members of struct ``flows`` that a step changes.

    Members ``…_low`` are the low words of compensated sums.
    """
    return [("q", [size["n"]]), ("q_low", [size["n"]]), ("y", [size["y"]]), ("y_low", [size["y"]]),
            ("work", []), ("work_low", [])]


def _length(shape: Sequence[int]) -> int:
    """Return the number of entries of an array."""
    return int(sp.prod(shape))


def _axis_number(axis: AxisRotation) -> int:
    """Return 0, 1 or 2 for a coordinate axis, else 3."""
    units = [tuple(sp.Integer(i == k) for i in range(3)) for k in range(3)]
    return units.index(axis.axis) if axis.axis in units else 3


def _composition(composition: Composition, stages: int, real: Real) -> CompositionText:
    """Return the weights as double words: drifts a_0, a_1 .. a_(s-1), a_s + a_0 and kicks b_i.

    The last drift of a step joins the first of the next one. Kick i takes place at the time
    a_0 + … + a_(i-1) of the step, in units of h. Tables are padded to ``stages``.
    """
    a, b = composition.drifts, composition.kicks
    times = list(accumulate(a))[:-1]
    # κ_i = −c_i/b_i of a kick by b_i (V + κ_i h² G): the engine multiplies the gradient with b_i
    ratios = [-c / x if x else Fraction(0) for c, x in zip(composition.gradients, b, strict=True)]

    def pad(texts: list[str], count: int, filler: str) -> list[str]:
        """Return the texts with fillers up to ``count``, the length of the longest composition."""
        return [*texts, *[filler] * (count - len(texts))]

    def two_words(weights: Sequence[Fraction], count: int) -> list[str]:
        """Return the weights as double words, padded with zeros."""
        return pad([_two_words(x, real) for x in weights], count, "{ 0, 0 }")

    return CompositionText(
        name=composition.name,
        stages=composition.stages,
        drift=two_words([a[0], *a[1:-1], a[-1] + a[0]], stages + 1),
        kick=two_words(b, stages),
        time=two_words(times, stages),
        gradient=pad([real.literal(x) for x in ratios], stages, "0"))


def _two_words(x: Fraction, real: Real) -> str:
    """Return the C of a weight as a double word: its rounded value and the rounded remainder."""
    return f"{{ {real.literal(x)}, {real.literal(x - round_binary(x, real.bits))} }}"


def half_pi_words(real: Real, count: int) -> list[str]:
    """Return the C of π/2 as a sum of ``count`` ≤ 3 numbers of the type, each a rounded remainder.
    """
    bits = 4 * real.bits  # one number more than three: all are rounded correctly
    with mp.workprec(bits + 64):
        remainder = Fraction(int(mp.floor(mp.ldexp(mp.pi / 2, bits))), 2**bits)
    literals = []
    for _ in range(count):
        literals.append(real.literal(remainder))
        remainder -= round_binary(remainder, real.bits)
    return literals
