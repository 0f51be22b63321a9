"""Experiments and estimators that worker processes can import."""

import os
import signal
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import gramian as gm

TIMES = np.arange(0.0, 600.0, 10.0)
PATH = np.stack([np.where(TIMES < 300, 0, 5 * (TIMES - 300)), np.minimum(5 * TIMES, 1500)], axis=1)
STATE = np.array([2000.0, 5000.0, -2.0, 1.0])
SIGMA = float(np.radians(0.1))


def scene(sigma=SIGMA):
    return gm.monte_carlo.Bearings(TIMES, PATH, STATE, sigma)


def _linear():
    offsets = STATE[:2] + TIMES[:, None] * STATE[2:] - PATH
    exact = np.arctan2(offsets[:, 0], offsets[:, 1])
    rows = gm.bearings.rows(TIMES, PATH, STATE, 1.0)
    return exact, np.linalg.pinv(rows), np.linalg.inv(rows.T @ rows) * SIGMA**2


EXACT, GAIN, COVARIANCE = _linear()


def linear_estimate(bearings):
    """The maximum-likelihood estimate of the linearised problem."""
    return STATE + (GAIN * (bearings - EXACT)).sum(axis=1)


def with_covariance(bearings):
    return linear_estimate(bearings), COVARIANCE


def sometimes_fails(bearings):
    """Raises, returns NaN or the wrong shape in some trials."""
    first = (bearings[0] - EXACT[0]) / SIGMA
    if first > 2:
        raise ValueError(f"too far: {first:.3f}")
    if first < -2:
        return [np.nan] * 4
    if first > 1.9:
        return [0.0] * 3
    return linear_estimate(bearings)


def slow(bearings, seconds=0.002):
    time.sleep(seconds)
    return linear_estimate(bearings)


def _die_once(bearings, flag):
    try:
        Path(flag).touch(exist_ok=False)
    except FileExistsError:
        return linear_estimate(bearings)
    os.kill(os.getpid(), signal.SIGKILL)
    return None


def dies_once(flag):
    """An estimator whose first call, in whichever process, ends that process."""
    return partial(_die_once, flag=str(flag))


def always_dies(bearings):
    os.kill(os.getpid(), signal.SIGKILL)


@dataclass(frozen=True)
class Level(gm.monte_carlo.Experiment):
    """The mean of some samples; `simulate` counts its calls in a file if asked."""

    samples: int = 10
    sigma: float = 1.0
    names = ("level",)
    truth = np.array([3.0])

    def simulate(self, seed, first, trials):
        return 3.0 + self.sigma * gm.monte_carlo.normals(seed, first, trials, self.samples)

    def problem(self):
        return gm.Problem(np.ones((self.samples, 1)) / self.sigma, self.names)


def mean(samples):
    return [samples.mean()]


def slow_mean(samples):
    time.sleep(0.002)
    return [samples.mean()]
