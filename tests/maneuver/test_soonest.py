"""How soon an accuracy is reached: the fewest samples, and a count that none goes below."""

import numpy as np
import pytest

import gramian as gm

GIVEN = ([0.0, 1000.0], [0.0, 0.0], 20.0, 1.0, 20)
OPTIONS = {"sigma": 0.01, "standoff": 300.0, "starts": 2, "restarts": 1}


def range_deviation(path):
    offset = np.array(GIVEN[0]) - path
    rows = offset[:, ::-1] * [1, -1] / (0.01 * (offset**2).sum(axis=1)[:, None])
    return np.sqrt(np.linalg.inv(rows.T @ rows)[1, 1])


@pytest.fixture(scope="module")
def found():
    return gm.maneuver.soonest(*GIVEN, accuracy=("range", 60.0), **OPTIONS)


def test_the_path_is_as_accurate_as_it_says(found):
    assert found.samples == len(found.plan.path) < 20
    assert found.time == (found.samples - 1) * 1.0
    assert range_deviation(found.plan.path) == pytest.approx(found.reached, rel=1e-9)
    assert found.reached <= 60.0
    assert found.stopped == "done"


def test_one_sample_fewer_does_not_do(found):
    counts = {n: (reached, least) for n, reached, least in found.tried}
    assert counts[found.samples - 1][0] > 60.0
    assert 2 <= found.at_least <= found.samples
    # A longer search does not find a path below what is said to be certain.
    for n in {max(2, found.at_least - 1), found.samples - 1}:
        plan = gm.maneuver.plan(
            *GIVEN[:4],
            n,
            criterion={"combination": "range"},
            sigma=0.01,
            standoff=300.0,
            bound=False,
        )
        assert np.sqrt(plan.value) > 60.0


def test_more_accuracy_takes_longer(found):
    finer = gm.maneuver.soonest(*GIVEN, accuracy=("range", 20.0), **OPTIONS)
    assert finer.samples > found.samples
    assert finer.at_least >= found.at_least


def test_what_is_not_reached_is_said():
    never = gm.maneuver.soonest(*GIVEN[:4], 8, accuracy=("range", 0.1), **OPTIONS)
    assert never.samples is None
    assert never.time == np.inf
    assert never.at_least == 9
    assert "no path found in 8 samples" in never.reason


def test_a_search_that_runs_out_of_time_says_so():
    early = gm.maneuver.soonest(
        *GIVEN[:4], 60, accuracy=("range", 20.0), sigma=0.01, time_limit=0.3
    )
    assert early.stopped == "time"
    assert early.reason.endswith("the time was up")
    assert early.to_dict()["stopped"] == "time"


def test_a_way_home_counts_for_every_number_of_samples():
    home = gm.maneuver.soonest(
        *GIVEN, accuracy=("range", 60.0), return_to=[200.0, 0.0, 10.0], **OPTIONS
    )
    assert np.hypot(*(home.plan.path[-1] - [200.0, 0.0])) <= 10.0 + 1e-6
    assert home.samples is None or home.samples >= 11


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"accuracy": ("depth", 1.0)}, "combination = 'depth'"),
        ({"accuracy": ("range", 0.0)}, r"accuracy\[1\] = 0.0: must be > 0"),
        ({"accuracy": "range"}, "must be \\(name, deviation\\)"),
        ({"accuracy": 3.0}, "must be \\(name, deviation\\)"),
        ({"accuracy": (1.0, 2.0)}, r"accuracy\[0\] = 1.0"),
        ({"criterion": "D"}, "criterion: soonest plans for the variance"),
        ({"time_limit": -1.0}, "time_limit"),
    ],
)
def test_bad_input_is_named(change, words):
    with pytest.raises(gm.InputError, match=words):
        gm.maneuver.soonest(*GIVEN, **{"accuracy": ("range", 60.0), **OPTIONS, **change})
