"""
Trilateration
=============

Ranges to beacons. On the line between two of them nothing is known sideways to first order;
which further beacon would help most?
"""

import numpy as np

import gramian as gm
from gramian.plot import COLORS, ellipse, figure

BEACONS = np.array([[0.0, 0.0], [100.0, 0.0], [40.0, 80.0]])  # m


def model(at=(50.0, 30.0), beacons=BEACONS):
    return gm.from_function(
        lambda p: np.hypot(*(p - beacons).T), at, 0.5, ["east", "north"], units=["m", "m"]
    )


if __name__ == "__main__":
    answer = gm.analyze(model())
    print(answer.summary())
    between = gm.analyze(model((50.0, 0.0), BEACONS[:2]))
    print(between.summary())
    # Which further beacon would help most?
    offered = np.array([[0.0, 60.0], [90.0, 90.0], [52.0, 300.0]])
    for one in answer.candidates(model(beacons=offered)):
        print(offered[one.rows[0]], one.crlb_std)
    picture = figure(6.4, 4.4)
    axes = picture.subplots()
    axes.plot(*BEACONS.T, "^", color=COLORS["observer"], label="beacons")
    inside, line = np.array([50.0, 30.0]), np.array([50.0, 0.0])
    outline = inside + 10 * ellipse(answer.covariance(), 0.95)
    axes.plot(*outline.T, color=COLORS["good"], label="three ranges: 95 % region, times 10")
    axes.plot(*inside, "o", color=COLORS["good"])
    axes.plot(*line, "o", color=COLORS["bad"])
    axes.axline(line, line + between.null_space[:, 0], color=COLORS["bad"], ls="--", lw=1)
    axes.set(xlabel="east (m)", ylabel="north (m)", aspect="equal", ylim=(-40, 95))
    axes.plot([], [], "--", color=COLORS["bad"], label="two ranges: this direction is open")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize="small")
