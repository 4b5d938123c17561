"""The speed: instructions of one step of the exported C are those that are checked in, ± 5 %.

``pytest tests/benchmarks/test_instructions.py --update`` makes the numbers again after a wanted
change.
"""

from __future__ import annotations

import pytest

from benchmarks.callgrind import (
    ALLOWED,
    FLAGS,
    STEPPERS,
    count_step,
    find_counter,
    recorded,
    write,
)

KNOWN = recorded()


def test_every_stepper_is_counted(pytestconfig):
    """With --update the test only counts and writes."""
    if pytestconfig.getoption("update"):
        counter = find_counter()
        if counter.missing:
            pytest.skip(counter.missing)
        write(counter, dict(count_step(counter, *stepper) for stepper in STEPPERS))
        return
    assert len(KNOWN["steps"]) == len(STEPPERS)
    assert KNOWN["flags"] == " ".join(FLAGS)


@pytest.mark.slow  # each is compiled for speed and run twice below valgrind
@pytest.mark.parametrize("stepper", STEPPERS, ids=lambda s: "-".join(map(str, s)))
def test_instructions(stepper, pytestconfig):
    if pytestconfig.getoption("update"):
        pytest.skip("the numbers are being made again")
    counter = find_counter(KNOWN["gcc"])
    if counter.missing:
        pytest.skip(counter.missing)
    name, count = count_step(counter, *stepper)
    expected = KNOWN["steps"][name]
    change = count / expected - 1
    assert abs(change) <= ALLOWED, (
        f"A step of {name} takes {count:,.0f} instructions, {expected:,} are checked in "
        f"({change:+.1%}); if that is wanted, "
        "`pytest tests/benchmarks/test_instructions.py --update`.")
