"""Every public function answers whatever it is given: `make attack` runs 10^5 such calls."""

import contextlib

import pytest

import gramian as gm
from attack.attack import called, run, targets
from attack.baselines import CALLS, WITHOUT, public


def test_every_public_function_has_a_call():
    names = set(public())
    assert names <= {*CALLS, *WITHOUT}
    assert {*CALLS, *WITHOUT} <= names


@pytest.mark.parametrize("name", sorted(targets()))
def test_the_call_works_as_it_is(name):
    make, arguments = targets()[name]
    called(make(), arguments)


RAGGED = [[1.0], [1.0, 2.0]]


@pytest.mark.parametrize("junk", [RAGGED, [None, [1.0]], {"a": RAGGED}], ids=str)
def test_ragged_lists_are_refused_or_answered(junk):
    """Of every function, in the place of every argument; what a user's own h raises is its own."""
    for make, arguments in targets().values():
        for key in (key for key, value in arguments.items() if key != "*" and not callable(value)):
            with contextlib.suppress(gm.InputError, MemoryError):
                called(make(), {**arguments, key: junk})


def test_calls_gone_wrong_are_answered():
    report = run(3000)
    assert not report.findings, report.table()
