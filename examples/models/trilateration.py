"""
Trilateration
=============

Ranges to beacons. On the line between two of them nothing is known sideways to first order;
which further beacon would help most?
"""

import numpy as np

import gramian as gm

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
    picture = between.plot()
