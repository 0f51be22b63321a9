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
