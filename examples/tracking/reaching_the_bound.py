"""
Does the estimator reach its bound?
===================================

10 000 simulated tracks: the error cloud with the ellipse of the bound, errors beside bounds, and
whether the claimed covariance is honest.
"""

import numpy as np

import gramian as gm

t = np.arange(60) * 10.0
path = np.stack([np.where(t < 300, 0, 5 * (t - 300)), np.minimum(5 * t, 1500)], axis=1)
scene = gm.monte_carlo.Bearings(t, path, [2000.0, 5000.0, -2.0, 1.0], np.radians(0.1))
result = gm.monte_carlo.run(scene, 10_000, seed=1)
print(result.summary())
picture = result.plot()
