"""
When does a trajectory tell?
============================

A car with constant velocity, then a turn, seen by the bearing of one beacon: the bound of each
state from windows of three seconds, and the rank. Only windows that hold the turn determine all.
"""

import numpy as np

import gramian as gm


def drive(t, x):
    return np.array([x[2], x[3], 0 * x[0], 0.5 * (t > 4) + 0 * x[0]])


def bearing(t, x):
    return [np.arctan(x[0] / x[1])]


path = gm.dynamics.from_ode(
    drive,
    bearing,
    [3.0, 40.0, 2.0, 0.5],
    np.arange(0, 10.5, 0.5),
    ["x", "y", "vx", "vy"],
    sigma=1e-3,
)
windows = path.windows(3.0)
print(windows.rank)
print(windows.null_combinations[0])
picture = windows.plot()
