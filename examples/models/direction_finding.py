"""
Direction finding
=================

An emitter straight behind two stations, where the angle wraps: ``angles=True`` unwraps it.
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, ellipse, figure

STATIONS = np.array([[0.0, 0.0], [0.0, 500.0]])  # m


def model(at=(-2000.0, 0.0)):
    def bearings(p):
        offset = p - STATIONS
        return np.arctan2(offset[:, 1], offset[:, 0])

    return gm.from_function(
        bearings, at, np.radians(1.0), ["east", "north"], units=["m", "m"], angles=True
    )


if __name__ == "__main__":
    answer = gm.analyze(model())
    print(answer.summary())
    picture = figure(6.4, 4.0)
    axes = picture.subplots()
    for station in STATIONS:
        axes.plot(*np.stack([station, [-2000.0, 0.0]]).T, color=COLORS["muted"], lw=0.8)
    axes.plot(*STATIONS.T, "^", color=COLORS["observer"], label="stations")
    axes.plot(-2000.0, 0.0, "o", color=COLORS["target"], label="emitter")
    outline = np.array([-2000.0, 0.0]) + ellipse(answer.covariance(), 0.95)
    axes.plot(*outline.T, color=COLORS["target"], label="95 % region")
    axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
