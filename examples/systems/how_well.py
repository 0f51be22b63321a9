"""
How well, after a minute?
=========================

The same mass on a spring, its noise and what is known beforehand: posterior over prior deviation of
each combination. Near 1 nothing was learned.
"""

import gramian as gm

A = [[0.0, 1.0, 0.0, 0.0], [-0.25, -0.02, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]]
C = [[1.0, 0.0, 1.0, 0.0]]
names = ["position", "velocity", "offset", "drift"]
prior = {"position": 1.0, "velocity": 1.0, "offset": 0.1, "drift": 0.01}
found = gm.linear.degree(A, C, names=names, window=60.0, dt=0.5, R=[[1e-4]], prior=prior)
print(dict(zip(names, found.ratio.round(4).tolist(), strict=True)))
picture = found.plot()
