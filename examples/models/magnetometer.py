"""
Magnetometer calibration
========================

Bias and gains of three axes. Turns about the vertical do not separate the bias of z from its
gain; turns about two axes do.
"""

import numpy as np

import gramian as gm

FIELD = np.array([20.0, 0.0, 44.0])  # uT
NAMES = ["bx", "by", "bz", "sx", "sy", "sz"]


def model(*, tilted=True):
    angles = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    views = [
        np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]]) for a in angles
    ]
    if tilted:
        tip = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
        views += [view @ tip for view in views]
    true = np.array([view @ FIELD for view in views])

    def readings(x):
        return ((1 + x[3:]) * true + x[:3]).ravel()

    units = ["uT"] * 3 + [""] * 3
    return gm.from_function(
        readings, np.zeros(6), 0.2, NAMES, units=units, scale=[10] * 3 + [0.1] * 3
    )


if __name__ == "__main__":
    level = gm.analyze(model(tilted=False))
    print(level.summary())
    print(gm.analyze(model()).summary())
    picture = level.plot()
