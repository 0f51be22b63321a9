"""Likelihoods that grow towards infinite range: told as such, not as unobservable."""

import numpy as np
import pytest

import gramian as gm

TIMES = np.arange(40) * 15.0
# Two legs: every target at constant velocity is observable.
PATH = np.stack([np.minimum(5 * TIMES, 1500), np.maximum(5 * (TIMES - 300), 0)], axis=1)
FAR = np.array([4000.0, 15000.0, 3.0, -1.0])


def bearings(state, sigma, trials, seed):
    offsets = state[:2] + TIMES[:, None] * state[2:] - PATH
    exact = np.arctan2(offsets[:, 0], offsets[:, 1])
    return exact + sigma * np.random.default_rng(seed).normal(size=(trials, TIMES.size))


def scene(sigma):
    ship = gm.tracks.Carrier(PATH, TIMES)
    sensor = gm.tracks.Sensor.bearing(ship, TIMES, sigma=sigma)
    return gm.tracks.Scene(gm.tracks.Motion.constant_velocity(), [sensor])


@pytest.mark.parametrize(("degrees", "share"), [(2.0, 0.98), (4.0, 0.95)])
def test_a_batch_of_far_targets_is_never_unobservable(degrees, share):
    sigma = np.deg2rad(degrees)
    seen = bearings(FAR, sigma, 200, 7)
    found = gm.bearings.localize_many(TIMES, seen, PATH, sigma)
    assert not (found.status == "unobservable").any()
    # States there are where the status says so, and the two engines nearly always agree on
    # the best: the batch follows the starts of one track no farther than to a good fit.
    assert np.isfinite(found.state[found.status == "weak"]).all()
    engine = gm.tracks.estimate_many(scene(sigma), seen)
    assert not (engine.status == "unobservable").any()
    both = found.status == "weak"
    assert (found.chi2[both] < engine.chi2[both] + 0.1).mean() > share


def unbounded(state, degrees, seed):
    """Bearings that no finite range explains best."""
    sigma = np.deg2rad(degrees)
    seen = bearings(state, sigma, 300, seed)
    status = gm.bearings.localize_many(TIMES, seen, PATH, sigma).status
    return seen[status == "unbounded"], sigma


@pytest.mark.parametrize(
    ("state", "degrees", "seed"), [(FAR, 4.0, 7), (FAR * [2, 2, 1, 1], 1.0, 3)]
)
def test_one_estimate_says_how_far_at_least(state, degrees, seed):
    records, sigma = unbounded(state, degrees, seed)
    assert len(records) > 3
    for seen in records[:6]:
        answer = gm.bearings.localize(TIMES, seen, PATH, sigma)
        assert answer.status == "weak"
        interval = answer.interval("range")
        _, high = interval.pieces[-1]
        assert high is None
        assert interval.certain
        # Nothing far away fits better by much.
        limit = gm.bearings.localize_many(TIMES, seen, PATH, sigma).chi2
        assert answer.fit.chi2 < limit + 6.0
        assert answer.unbounded == ("towards infinity" in answer.reason)


def test_a_turned_target_that_fits_best_at_infinity_is_a_misfit():
    # The rays of a target that runs ahead and turns: no constant velocity comes near.
    sigma = np.deg2rad(0.1)
    turned = np.stack(
        [4000 + 10 * TIMES, 9000 - 2 * TIMES + 0.02 * np.maximum(TIMES - 300, 0) ** 2], axis=1
    )
    offsets = turned - PATH
    seen = np.arctan2(offsets[:, 0], offsets[:, 1])
    seen += sigma * np.random.default_rng(1).normal(size=TIMES.size)
    answer = gm.bearings.localize(TIMES, seen, PATH, sigma)
    assert answer.status == "misfit"


def test_a_straight_observer_is_still_unobservable():
    straight = np.stack([3 * TIMES, 1 * TIMES], axis=1)
    offsets = FAR[:2] + TIMES[:, None] * FAR[2:] - straight
    seen = np.arctan2(offsets[:, 0], offsets[:, 1])
    for noise in (0.0, 0.01):
        z = seen + noise * np.random.default_rng(3).normal(size=(8, TIMES.size))
        batch = gm.bearings.localize_many(TIMES, z, straight, 0.01)
        assert (batch.status == "unobservable").all()
        answer = gm.bearings.localize(TIMES, z[0], straight, 0.01)
        assert answer.status == "unobservable"
        assert len(answer.null_combinations) == 1
