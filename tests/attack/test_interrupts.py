"""Ctrl-C ends every long call: `python tests/attack/interrupts.py` prints how soon."""

from collections.abc import Iterator

import pytest

from attack.interrupts import CASES, Interrupted


@pytest.fixture(scope="module")
def child() -> Iterator[Interrupted]:
    with Interrupted() as process:
        yield process


@pytest.mark.parametrize("name", CASES)
def test_an_interrupt_ends_a_long_call(name, child):
    # Within a second on a machine that does nothing else.
    assert child.seconds(name, patience=10.0) < 3.0


def test_the_call_after_interrupted_ones_does_not_wait_for_them():
    # What is interrupted goes on for a while, each on a thread of the pool: with all of them
    # taken the next call would stand behind, deaf to Ctrl-C.
    before = ("linear.piecewise", "analyze", "large.analyze_sparse", "maneuver.fisher_det")
    with Interrupted() as process:
        for name in before:
            process.seconds(name, patience=10.0)
        assert process.seconds("maneuver.closed_loop", patience=10.0) < 3.0
