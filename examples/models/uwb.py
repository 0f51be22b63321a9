"""
UWB time differences
====================

Differences of arrival times for all pairs of anchors: redundant, with a singular covariance.
Redundant pairs add nothing.
"""

from itertools import combinations

import numpy as np

import gramian as gm

ANCHORS = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 8.0], [0.0, 8.0]])  # m
PAIRS = list(combinations(range(4), 2))


def model(at=(3.0, 2.0), sigma=0.1):
    difference = np.zeros((len(PAIRS), 4))
    for row, (i, j) in zip(difference, PAIRS, strict=True):
        row[[i, j]] = 1.0, -1.0
    covariance = sigma**2 * difference @ difference.T  # of rank 3
    return gm.from_function(
        lambda p: difference @ np.hypot(*(p - ANCHORS).T),
        at,
        covariance,
        ["east", "north"],
        units=["m", "m"],
    )


if __name__ == "__main__":
    answer = gm.analyze(model())
    print(answer.summary())
    picture = answer.plot()
