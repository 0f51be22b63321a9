"""Paths by the length of the likelihood interval."""

import numpy as np
import pytest

import gramian as gm

FAR = ([4000.0, 15000.0, 3.0, -1.0], [0.0, 0.0], 8.0, 30.0, 24)
EFFORT = {"starts": 3, "restarts": 2}


@pytest.fixture(scope="module")
def found():
    return gm.maneuver.shortest_interval(
        *FAR, name="range at the end", sigma=0.035, legs=2, evaluations=60, **EFFORT
    )


def scene(path, sigma=0.035):
    times = FAR[3] * np.arange(FAR[4])
    carrier = gm.tracks.Carrier(path, times)
    sensor = gm.tracks.Sensor.bearing(carrier, times, sigma=sigma)
    return gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor], reference=0.0)


def test_the_length_is_that_of_an_estimate_from_exact_bearings(found):
    seen = scene(found.path)
    at = gm.tracks.estimate(seen, seen.values(FAR[0]))
    assert at.interval("range at the end").length == pytest.approx(found.length, rel=1e-6)
    assert found.headings.shape == found.speeds.shape == (FAR[4] - 1,)
    np.testing.assert_allclose(found.speeds, FAR[2], rtol=1e-9)


def test_it_is_not_the_path_of_the_smallest_ellipse(found):
    """At 15 km and 2 deg the interval is much longer than the ellipse says."""
    lengths = {name: length for name, length, _ in found.candidates}
    assert found.length == min(lengths.values())
    assert found.length < 0.95 * lengths["plan for D"]
    assert found.length > 1.05 * found.ellipse
    assert found.length == found.candidates[0][1]


def test_open_intervals_come_last_and_are_told(found):
    lengths = [length for _, length, _ in found.candidates]
    assert lengths == sorted(lengths)
    few = gm.maneuver.shortest_interval(
        *FAR[:4], 8, name="range", sigma=0.035, evaluations=5, **EFFORT
    )
    assert np.isinf(few.length)
    assert "open for 1 of 1 belief on every path" in few.reason
    assert few.to_dict()["length"] == "inf"


def test_limits_are_kept_and_the_seed_decides():
    def once():
        return gm.maneuver.shortest_interval(
            [0.0, 3000.0], [0.0, 0.0], 8.0, 20.0, 20, sigma=0.05, standoff=1500.0,
            keep_out=[[300.0, 800.0, 300.0]], evaluations=40, **EFFORT,
        )  # fmt: skip

    first, again = once(), once()
    np.testing.assert_array_equal(first.path, again.path)
    assert np.hypot(*(first.path - [0.0, 3000.0]).T).min() > 1500.0 - 1e-6
    assert np.hypot(*(first.path - [300.0, 800.0]).T).min() > 300.0 - 1e-6


def test_a_prior_makes_it_shorter_and_beliefs_count_by_their_weight():
    options = {"name": "x0", "sigma": 0.05, "evaluations": 0, **EFFORT}
    at = ([1000.0, 3000.0, 1.0, 0.0], [0.0, 0.0], 8.0, 20.0, 20)
    alone = gm.maneuver.shortest_interval(*at, **options)
    known = gm.maneuver.shortest_interval(*at, **options, prior={"speed": 0.5})
    assert known.length < 0.9 * alone.length
    two = [[1000.0, 3000.0, 1.0, 0.0], [1000.0, 5000.0, 1.0, 0.0]]
    spread = gm.maneuver.shortest_interval(two, *at[1:], **options, weights=[1, 3])
    assert spread.length == pytest.approx(spread.lengths @ [0.25, 0.75])
    worst = gm.maneuver.shortest_interval(two, *at[1:], **options, over="worst")
    assert worst.length == worst.lengths.max()


def test_towed_arrays_with_blind_arcs_and_an_unknown_bias():
    array = gm.maneuver.Sensing("cone_angle", 0.02, blind=[(2.6, 3.7)], bias="b")
    found = gm.maneuver.shortest_interval(
        [3000.0, 5000.0, 3.0, -1.0], [0.0, 0.0], 8.0, 30.0, 30,
        sensors=[array], legs=2, evaluations=10, **EFFORT,
    )  # fmt: skip
    assert np.isfinite(found.length)
    assert np.abs(np.diff(found.headings)).max() > 0.2  # it turns


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"name": "rang"}, 'name = .rang.: must be "range"'),
        ({"level": 2.0}, "level = 2.0: must be between 0 and 1"),
        ({"sigma": None}, "sigma is not given"),
        ({"criterion": "D"}, "criterion: shortest_interval plans for"),
        ({"time_limit": -1}, "time_limit = -1 s"),
        ({"evaluations": -3}, "evaluations = -3"),
        ({"target": [[[0.0, 3000.0], [500.0, 3000.0]]]}, "2 targets in a belief"),
    ],
)
def test_what_cannot_be_asked(options, words):
    asked = {"target": [0.0, 3000.0], "sigma": 0.05} | options
    target = asked.pop("target")
    with pytest.raises(gm.InputError, match=words):
        gm.maneuver.shortest_interval(target, [0.0, 0.0], 8.0, 10.0, 20, **asked)


def test_the_time_is_kept(monkeypatch):
    """A clock that has leapt on once the search goes: the best so far is the answer."""
    from gramian.models.maneuver import _shortest

    judged = 0

    def clock():
        return 1e9 if judged > 3 else 0.0

    def progress(done, of, best):
        nonlocal judged
        judged = done if of == 100_000 else judged

    monkeypatch.setattr(_shortest, "monotonic", clock)
    found = gm.maneuver.shortest_interval(
        *FAR, sigma=0.035, legs=2, evaluations=100_000, time_limit=60.0, progress=progress,
        **EFFORT,
    )  # fmt: skip
    assert judged == 4
    assert found.stopped == "time"
    assert "the time was up" in found.reason
    assert found.length == min(length for _, length, _ in found.candidates)


def test_numbers_of_any_kind_are_taken():
    from decimal import Decimal

    found = gm.maneuver.shortest_interval(
        [0.0, 3000.0], [0.0, 0.0], 8.0, 20.0, 8, sigma=Decimal("0.05"), evaluations=0, **EFFORT
    )
    assert found.length > 0
