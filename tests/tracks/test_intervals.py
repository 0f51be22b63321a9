"""Likelihood intervals where the measurements hardly determine the state."""

import numpy as np
import pytest

import gramian as gm

TIMES = 30.0 * np.arange(30)
TRUTH = [3000.0, 5000.0, 3.0, -1.0, 0.0]


def towed(turn, *more):
    """An array with an unknown bias on a path that bends by 2.6 deg."""
    headings = np.where(np.arange(29) < turn, -0.648, -0.694)
    steps = 240 * np.stack([np.sin(headings), np.cos(headings)], axis=1)
    carrier = gm.tracks.Carrier(np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)]), TIMES)
    array = gm.tracks.Sensor.cone_angle(carrier, TIMES, sigma=0.02, bias="b")
    motion = gm.tracks.Motion.constant_velocity()
    return gm.tracks.Scene(motion, [array, *more], reference=0.0)


@pytest.mark.parametrize("turn", [10, 15, 22])
@pytest.mark.parametrize("seed", [None, 1, 2])
def test_what_fits_is_in_the_interval(turn, seed):
    """A state at each range, found with the range as a measurement, that fits as well."""
    scene = towed(turn)
    z = scene.values(TRUTH) if seed is None else gm.tracks.simulate(scene, TRUTH, seed=seed)
    found = gm.tracks.estimate(scene, z, start=[TRUTH])
    interval = found.interval("range")
    ranger = gm.tracks.Sensor.range(gm.tracks.Carrier([0.0, 0.0]), [0.0], sigma=0.01)
    held = towed(turn, ranger)
    rng = np.random.default_rng(0)
    fitting = 0
    for distance in (1000.0, 2000.0, 8000.0, 16000.0):
        least = np.inf
        for _ in range(12):
            course = np.arctan2(3, 5) + 0.5 * rng.normal()
            velocity = rng.normal(size=2) * 6 * distance / 5831 + [3, -1]
            start = [
                distance * np.sin(course), distance * np.cos(course), *velocity,
                0.2 * rng.normal(),
            ]  # fmt: skip
            end = gm.tracks.estimate_many(held, np.append(z, distance), start=start)
            least = min(least, float(end.cost))
        if least < found.fit.chi2 + 3.5:
            fitting += 1
            assert distance in interval or not interval.certain
    assert fitting > 0
