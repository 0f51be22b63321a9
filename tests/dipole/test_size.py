"""Passes so far from a gradiometer that noise hides their size: refused, with the nearest range."""

import re

import numpy as np
import pytest

import gramian as gm

TIMES = np.arange(21.0)
R0, V, M = np.array([-10.0, -9.0, 5.0]), np.array([1.0, 0.8, 0.1]), np.array([10.0, 20.0, -10.0])
BASELINE = [0.0, 0.0, 1.0]
CLOSEST = np.linalg.norm(np.cross(R0, V)) / np.linalg.norm(V)


def answers(noise, seeds, **options):
    exact = gm.dipole.measure(R0, V, M, TIMES, baselines=BASELINE)
    sigma = noise * abs(exact).max()
    for seed in seeds:
        y = exact + sigma * np.random.default_rng(seed).normal(size=exact.shape)
        try:
            yield gm.dipole.localize(TIMES, y, baselines=BASELINE, sigma=sigma, **options)
        except gm.UnobservableError as error:
            yield error


def test_what_is_too_far_to_tell_is_refused_with_the_least_range():
    limits = []
    for found in answers(0.05, range(16)):
        if not isinstance(found, gm.UnobservableError):
            # The interval of the others has no upper end either, or holds the truth.
            assert found.status != "not_converged"
            continue
        text = str(found)
        assert text.startswith("too far to tell: the pass fits as well at any larger size")
        assert "speed" in text
        limits.append(float(re.search(r"at least ([\d.]+) m", text)[1]))
        assert len(found.null_combinations) == 1
    # Where the noise is a twentieth, half of the records are so.
    assert len(limits) >= 4
    assert max(limits) < CLOSEST


def test_a_known_speed_or_less_noise_tells_the_size():
    for found in answers(0.05, range(3), known={"speed": float(np.linalg.norm(V))}):
        assert found.closest.range == pytest.approx(CLOSEST, rel=0.5)
    for found in answers(1e-4, range(3)):
        interval = found.interval("range")
        assert CLOSEST in interval
        assert interval.pieces[-1][1] < 1.2 * CLOSEST
