"""A run up to a time: the steps that lead there, or what would fit."""

from __future__ import annotations

import re
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gyrospark as gs
from calls import RUN, TOP, refused
from command_line import refused as refused_by_command
from gyrospark.runtime.integration.run_arguments import span_of, step_count

COMMAND = ["run", "fast-top", "--scheme", "G-L", "--stages", "3", "--json"]
plain = st.floats(1e-6, 1e3)


@given(n=st.integers(0, 10**6), dt=plain, t0=st.one_of(st.just(0.0), plain), back=st.booleans())
def test_what_is_a_whole_number_but_for_rounding_is_one(n, dt, t0, back):
    dt = -dt if back else dt
    assert step_count(None, t0 + n * dt, t0, dt) == n


@pytest.mark.parametrize("n", [1, 3, 1000])
def test_a_unit_of_a_double_is_what_times_may_be_off_by(n):
    """|t_end - n dt| <= 2^-52 (|t_end| + n dt), to the last digit of a fraction."""
    unit = Fraction(1, 2**52)
    most = 2 * unit / (1 - unit)  # x <= unit (2 + x), of t_end = n (1 + x)
    for off in (most, -2 * unit / (1 + unit)):
        assert step_count(None, n * (1 + off), 0, 1) == n
        with pytest.raises(gs.InputError):
            step_count(None, n * (1 + off * (1 + Fraction(1, 2**20))), 0, 1)


@pytest.mark.parametrize(("t_end", "dt", "n"), [
    (600, 0.1, 6000), (0.3, 0.1, 3), (1, 1 / 3, 3), (2 * np.pi, 2 * np.pi / 1000, 1000),
    (Decimal("0.7"), Fraction(1, 10), 7), (-0.3, -0.1, 3), (0, 0.1, 0), (np.float32(0.5), 0.25, 2),
])
def test_numbers_of_any_type(t_end, dt, n):
    assert step_count(None, t_end, 0, dt) == n


@given(t_end=plain, dt=plain, t0=st.one_of(st.just(0.0), plain))
def test_what_is_named_fits(t_end, dt, t0):
    dt = -dt if t_end < t0 else dt
    try:
        step_count(None, t_end, t0, dt)
    except gs.InputError as error:
        said = str(error)
    else:
        return
    times, steps = re.search(r".* t_end = (.*), or dt = (.*)\.$", said).groups()
    counts = [step_count(None, float(t), t0, dt) for t in times.split(" and ")]
    assert counts in ([1], [counts[0], counts[0] + 1])
    exact = (Fraction(t_end) - Fraction(t0)) / Fraction(dt)
    assert counts[-1] - 1 < exact < counts[-1]
    assert [step_count(None, t_end, t0, float(x)) for x in steps.split(" or ")] == counts[::-1]


def test_a_run_up_to_a_time_is_that_of_its_steps(gl3, gyrospark):
    made = gl3.integrate(gs.Start(TOP.q0, TOP.p0, t=0.5), steps=30, **RUN)
    to = gl3.integrate(gs.Start(TOP.q0, TOP.p0, t=0.5), t_end=0.53, **RUN)
    assert np.array_equal(to.q, made.q)
    said = gyrospark(*COMMAND, "--dt", "1e-3", "--set", "t=0.5", "--t-end", "0.53").document
    assert said["steps"] == 30
    assert said["q"] == made.q[-1].tolist()


def test_wrong_use_is_refused(gl3, gyrospark):
    for more in ({}, {"steps": 3, "t_end": 1}):
        with refused("steps.*t_end"):
            gl3.integrate(TOP.q0, TOP.p0, **more, **RUN)
    with refused(r"t_end = -1\.0.*t = 0\.0.*dt = -0\.001"):
        gl3.integrate(TOP.q0, TOP.p0, t_end=-1, **RUN)
    with refused("t_end = nan"):
        gl3.integrate(TOP.q0, TOP.p0, t_end=float("nan"), **RUN)
    refused_by_command(gyrospark("lyapunov", *COMMAND[1:-1], "--dt", "0.3", "--t-end", "1"),
                       "t_end = 0.9 and 1.2, or dt = 0.25 or 0.3333333333333333.")
    refused_by_command(gyrospark(*COMMAND, "--dt", "0.3", "--t-end", "1", "--steps", "3"),
                       "--steps 3 and --t-end 1")
    refused_by_command(gyrospark(*COMMAND, "--dt", "0.3", "--t-end", "soon"), "--t-end 'soon'")


@given(t_end=st.floats(-1e3, 1e3), dt=plain, t0=st.one_of(st.just(0.0), plain))
def test_whole_steps_and_the_rest_lead_to_any_time(t_end, dt, t0):
    """Exactly, unless rounding cannot tell the end from that of a whole step."""
    dt = -dt if t_end < t0 else dt
    count, rest = span_of(None, t_end, t0, dt)
    left = Fraction(t_end) - Fraction(t0) - count * Fraction(dt)
    assert rest in (0, left)
    assert (0 < rest / Fraction(dt) < 1) if rest else abs(left) <= abs(Fraction(dt)) / 2
