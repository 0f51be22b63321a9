"""
How large a turn?
=================

The bound and the error of the estimator against the observer's turn. Without a turn there is no
bound and no estimate.
"""

import numpy as np

import gramian as gm

t = np.arange(60) * 10.0


def turned(degrees):
    a, late = np.radians(degrees), np.maximum(t - 300, 0)
    path = np.stack([5 * late * np.sin(a), np.minimum(5 * t, 1500) + 5 * late * np.cos(a)], axis=1)
    return gm.monte_carlo.Bearings(t, path, [2000.0, 5000.0, -2.0, 1.0], np.radians(0.1))


swept = gm.monte_carlo.sweep(turned, {"degrees": [0, 15, 30, 60, 90, 120]}, 1_000, seed=1)
print(swept.values("bound", "y0"))
picture = swept.plot()
