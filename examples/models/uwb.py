"""
UWB time differences
====================

Differences of arrival times for all pairs of anchors: redundant, with a singular covariance.
Redundant pairs add nothing.
"""

from itertools import combinations

import numpy as np

import gramian as gm
from gramian.plot import COLORS, ellipse, figure

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
    picture = figure(6.4, 4.6)
    axes = picture.subplots()
    axes.plot(*ANCHORS.T, "^", color=COLORS["observer"], label="anchors")
    for at in np.stack(np.meshgrid([1.5, 4, 6.5, 9], [1.5, 4, 6.5]), axis=-1).reshape(-1, 2):
        outline = at + ellipse(gm.analyze(model(at)).covariance(), 0.95)
        axes.plot(*outline.T, color=COLORS["target"], lw=1.2)
    axes.plot([], [], color=COLORS["target"], label="95 % regions")
    axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
