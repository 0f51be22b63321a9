"""Every public function answers whatever it is given: `make attack` runs 10^5 such calls."""

import pytest

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


def test_calls_gone_wrong_are_answered():
    report = run(3000)
    assert not report.findings, report.table()
