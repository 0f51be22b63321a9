"""
Direction finding
=================

An emitter straight behind two stations, where the angle wraps: ``angles=True`` unwraps it.
"""

import numpy as np

import gramian as gm

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
    picture = answer.plot()
